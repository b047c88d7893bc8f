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

NODES = 7
"""Places along each side of a window at which the lens is asked."""

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
    places = np.linspace(-1.0, 1.0, NODES)
    nodes = np.stack(np.meshgrid(places, places), axis=-1).reshape(-1, 2)
    # A lens is so smooth that a polynomial over a window stands for it, and spares sending every pixel through it.
    fit = np.linalg.pinv(polyvander2d(nodes[:, 0], nodes[:, 1], [DEGREE, DEGREE]))
    seen = corners.copy()
    for _ in range(10):
        # The window moves by whole pixels, so that nothing is taken between them; its weights move with the corner.
        middles = np.rint(seen).astype(int)
        ideal = camera.undistort((middles[:, None] + reach * nodes).reshape(-1, 2)).reshape(len(seen), -1, 2)
        starts, steps = camera.undistort(seen), np.zeros_like(seen)
        for number, (middle, lens) in enumerate(zip(middles, fit @ ideal, strict=True)):
            steps[number] = _step(slopes, middle, seen[number], starts[number], lens, reach)
        found = camera.distort(starts + steps)
        found = np.where(np.isfinite(found), found, seen)
        # A corner that runs away stays where it was: its window holds no corner.
        found = np.where(np.linalg.norm(found - corners, axis=1)[:, None] < 0.5 * reach, found, seen)
        moved = float(np.abs(found - seen).max())
        seen = found
        if moved < SETTLED:
            break
    return seen


def _step(
    slopes: list[Points], middle: NDArray[np.int64], seen: Points, start: Points, lens: Points, reach: int
) -> Points:
    """From a corner to the point that the edges of its window run through, in ideal pixels, shape (2,).

    Args:
        slopes: Slopes of the light along x and y (h, w).
        middle: The pixel in the middle of the window.
        seen: The corner in px of the photograph.
        start: The same in ideal pixels.
        lens: Coefficients ((DEGREE + 1)^2, 2) of the ideal place over that in the window.
        reach: Half width of the window in px.
    """
    span = [
        np.arange(max(at - reach, 1), min(at + reach, size - 2) + 1)
        for at, size in zip(middle, slopes[0].shape[::-1], strict=True)
    ]
    if not all(map(len, span)):
        return np.zeros(2)
    powers, rises, weights = [], [], []
    for pixels, at, exact in zip(span, middle, seen, strict=True):
        power = polyvander((pixels - at) / reach, DEGREE)
        powers.append(power)
        rises.append(np.pad(power[:, :-1] * np.arange(1, DEGREE + 1), ((0, 0), (1, 0))) / reach)
        weights.append(np.exp(-2.0 * (pixels - exact) ** 2 / reach**2))
    weight = weights[1][:, None] * weights[0]
    gx, gy = (slope[span[1][0] : span[1][-1] + 1, span[0][0] : span[0][-1] + 1].astype(float) for slope in slopes)
    table = lens.reshape(DEGREE + 1, DEGREE + 1, 2)
    (x, y), (x_x, y_x), (x_y, y_y) = (
        # Not by matrix products: BLAS would start threads for each of them.
        [np.einsum("yj,xj->yx", down, np.einsum("xi,ij->xj", across, table[..., axis])) for axis in (0, 1)]
        for across, down in ((powers[0], powers[1]), (rises[0], powers[1]), (powers[0], rises[1]))
    )
    # The light's gradient carried into ideal pixels.
    size = x_x * y_y - y_x * x_y
    cx, cy = (gx * y_y - gy * y_x) / size, (gy * x_x - gx * x_y) / size
    along = weight * (cx * (x - start[0]) + cy * (y - start[1]))
    mixed = np.sum(weight * cx * cy)
    normal = np.array([[np.sum(weight * cx**2), mixed], [mixed, np.sum(weight * cy**2)]])
    try:
        return np.linalg.solve(normal, np.array([np.sum(along * cx), np.sum(along * cy)]))
    except np.linalg.LinAlgError:  # a window without any edge
        return np.zeros(2)
