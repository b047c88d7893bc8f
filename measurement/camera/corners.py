"""Corners of a board measured again once the lens is known, so that its bending does not move them.

Around a corner every edge points at it (Förstner and Gülch 1987), and cv2.cornerSubPix finds the point that the edges of
a window agree on. A lens bends the edges, the more the wider the window, and with them the corner: by a hundredth of a
pixel and more, alike in all photographs, which is enough to bend the calibration. Here the same equations are solved in
ideal pixels, where edges are straight (the idea of Datta, Kim and Kanade 2009, doi 10.1109/ICCVW.2009.5457474, but with
the gradients carried through the lens instead of a warped picture).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.polynomial.polynomial import polyvander, polyvander2d
from numpy.typing import NDArray

from measurement.camera.camera import Camera, Points

DEGREE = 4
"""Degree of the polynomial that stands for the lens within a window."""

SETTLED = 1e-3
"""Step in px below which corners are where they belong."""


def straightened_corners(gray: NDArray[np.uint8], corners: Points, camera: Camera, reach: int) -> Points:
    """Corners (n, 2) in px of the photograph, measured along edges that the lens does not bend.

    Args:
        gray: Photograph (h, w).
        corners: The corners (n, 2) in px, right to a pixel.
        camera: The camera, known well enough to straighten a window.
        reach: Half width of the window around a corner in px.
    """
    light = gray.astype(np.float32)
    slopes = [cv2.Scharr(light, cv2.CV_32F, *order) / 32.0 for order in ((1, 0), (0, 1))]
    steps = np.arange(-reach, reach + 1)
    window = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    nodes, spread = _interpolation(reach, window)
    seen = corners.copy()
    for _ in range(10):
        # The window moves by whole pixels, so that nothing is taken between them; its weights move with the corner.
        start = np.rint(seen).astype(int)[:, None, :]
        pixels = start + window
        inside = np.all((pixels > 0) & (pixels < np.array(gray.shape[::-1]) - 1), axis=2)
        pixels = np.where(inside[..., None], pixels, 1)
        far = np.sum((pixels - seen[:, None]) ** 2, axis=2)
        weight = np.where(inside, np.exp(-2.0 * far / reach**2), 0.0)
        gradient = np.stack([slope[pixels[..., 1], pixels[..., 0]] for slope in slopes], axis=-1)
        straight = [
            part @ camera.undistort((start + nodes).reshape(-1, 2)).reshape(-1, len(nodes), 2) for part in spread
        ]
        found = _agreed(straight, gradient.astype(float), weight, seen, camera)
        # A corner that runs away stays where it was: its window holds no corner.
        found = np.where(np.linalg.norm(found - corners, axis=1)[:, None] < 0.5 * reach, found, seen)
        moved = float(np.abs(found - seen).max())
        seen = found
        if moved < SETTLED:
            break
    return seen


def _interpolation(reach: int, window: NDArray[np.int64]) -> tuple[Points, list[Points]]:
    """Nodes (m, 2) about a corner and matrices (k, m) that take what is known there to a window's pixels (k, 2).

    The first matrix gives the value, the others its derivatives in x and y. A lens is so smooth that a polynomial of the
    fourth degree over a window stands for it, and spares sending every pixel through it.
    """
    steps = np.linspace(-1.0, 1.0, 7)
    nodes = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    fit = np.linalg.pinv(polyvander2d(nodes[:, 0], nodes[:, 1], [DEGREE, DEGREE]))
    x, y = window.T / reach
    powers = np.arange(DEGREE)
    along = [polyvander(at, DEGREE) for at in (x, y)]
    slopes = [np.pad(part[:, :-1] * (powers + 1), ((0, 0), (1, 0))) / reach for part in along]
    pairs = ((along[0], along[1]), (slopes[0], along[1]), (along[0], slopes[1]))
    return nodes * reach, [
        np.einsum("ki,kj->kij", first, second).reshape(len(window), -1) @ fit for first, second in pairs
    ]


def _agreed(straight: list[Points], gradient: Points, weight: Points, seen: Points, camera: Camera) -> Points:
    """The points (n, 2) of the photograph that the edges (n, k) of each window run through in ideal pixels."""
    ideal, slope = straight[0], np.stack(straight[1:], axis=-1)
    carried = np.linalg.solve(np.swapaxes(slope, 2, 3), gradient[..., None])[..., 0]
    start = camera.undistort(seen)
    offset = ideal - start[:, None]
    weighted = carried * weight[..., None]
    normal = np.einsum("nki,nkj->nij", weighted, carried)
    right = np.einsum("nki,nk->ni", weighted, np.sum(carried * offset, axis=2))
    try:
        step = np.linalg.solve(normal, right[..., None])[..., 0]
    except np.linalg.LinAlgError:  # a window without any edge
        return seen
    found = camera.distort(start + step)
    return np.where(np.isfinite(found), found, seen)
