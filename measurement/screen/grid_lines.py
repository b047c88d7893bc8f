"""Long dark lines in a photograph: valleys of brightness that lie in a row."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
from numpy.typing import NDArray

from measurement.camera.camera import Camera, Points
from measurement.robust import deviations
from measurement.screen.grid_error import GridError

LONGER_SIDE = 1000
"""Pixels of the reduced picture's longer side: enough to tell lines, few enough to be quick."""

WIDTHS = (1.0, 1.7, 3.0, 5.0, 8.0, 13.0)
"""Standard deviations in reduced px of the blur under which a line may show best."""

BLOCK = 32
"""Side in reduced px of the squares in which the noise is judged."""

ANGLES = 720
"""Steps of half a turn in the Hough transform."""

SPREAD = 12
"""Steps to either side of its own direction for which a valley's point votes: 3 degrees."""


@dataclasses.dataclass(frozen=True, eq=False)
class Line:
    """A straight line in ideal px.

    Attributes:
        normal: Unit normal (2,).
        offset: Where ``normal`` . (x, y) is on the line.
        middle: Middle (2,) of the line's seen part.
        support: Number of valley points on it, about its length in reduced px.
        strength: Sum of their depths in the logarithm of light.
    """

    normal: Points
    offset: float
    middle: Points
    support: int
    strength: float


def find_lines(gray: NDArray[np.uint8], camera: Camera) -> list[Line]:
    """Long dark lines, the longest first.

    Args:
        gray: Photograph (h, w).
        camera: The camera, whose lens is taken out so that lines are straight.

    Raises:
        GridError: Nothing that looks like a line.
    """
    factor = max(1, round(max(gray.shape) / LONGER_SIDE))
    # A shadow multiplies light: in the logarithm lines are as deep in it as beside it.
    light = np.log(reduced(gray, factor) + 4.0)
    middle = np.array([camera.width - 1, camera.height - 1]) / 2
    tries = []
    for width in WIDTHS:
        seen, normals, depth = _valleys(light, width)
        ideal = camera.undistort((seen + 0.5) * factor - 0.5)
        known = np.isfinite(ideal).all(axis=1)
        tries.append(_straight((ideal[known] - middle) / factor, normals[known], depth[known], max(light.shape)))
    # A narrow blur does not reach across a wide line, and a wide one washes thin lines out: the narrowest that shows
    # nearly as much as any is taken.
    shown = [sum(line.strength for line in found) for found in tries]
    lines = next(found for found, strength in zip(tries, shown, strict=True) if strength >= 0.8 * max(shown))
    if not lines:
        raise GridError("no grid was found: the picture shows no long dark lines (too blurred, too faint or not there)")
    return [
        dataclasses.replace(
            line, offset=line.offset * factor + float(line.normal @ middle), middle=line.middle * factor + middle
        )
        for line in lines
    ]


def reduced(gray: NDArray[np.uint8], factor: int) -> NDArray[np.float32]:
    """Means over squares of ``factor`` px; rows and columns that fill no square are left out."""
    height, width = (side // factor for side in gray.shape)
    whole = gray[: height * factor, : width * factor]
    if factor == 1:
        return whole.astype(np.float32)
    return cv2.resize(whole.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)


def _valleys(light: NDArray[np.float32], width: float) -> tuple[Points, Points, Points]:
    """Points (n, 2) on the floors of dark lines, the directions (n, 2) across them, and their depths (n,)."""
    smooth = cv2.GaussianBlur(light, (0, 0), width)
    along_x = cv2.Sobel(smooth, cv2.CV_32F, 2, 0, ksize=3) / 4
    along_y = cv2.Sobel(smooth, cv2.CV_32F, 0, 2, ksize=3) / 4
    mixed = cv2.Sobel(smooth, cv2.CV_32F, 1, 1, ksize=3) / 4
    half, mean = (along_x - along_y) / 2, (along_x + along_y) / 2
    bend = mean + np.hypot(half, mixed)
    angle = 0.5 * np.arctan2(mixed, half)  # of the largest curvature, which goes across the valley
    across = np.dstack([np.cos(angle), np.sin(angle)]).astype(np.float32)
    rows, columns = np.indices(light.shape, dtype=np.float32)

    def beside(distance: float) -> NDArray[np.float32]:
        return cv2.remap(
            smooth, columns + distance * across[..., 0], rows + distance * across[..., 1], cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip

    # Both sides must be lighter: at the edge of a shadow only one is.
    depth = np.minimum(beside(2.5 * width + 1.0), beside(-2.5 * width - 1.0)) - smooth
    lowest = (smooth <= beside(1.0)) & (smooth <= beside(-1.0)) & (bend > 0.0)
    floor = lowest & (depth > np.maximum(0.015, 2.5 * _local_noise(depth)))
    margin = int(2 * width) + 2
    floor[:margin], floor[-margin:], floor[:, :margin], floor[:, -margin:] = False, False, False, False
    y, x = np.nonzero(floor)
    return np.column_stack([x, y]).astype(float), across[y, x].astype(float), depth[y, x].astype(float)


def _local_noise(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Standard deviation of the noise around each pixel: in a shadow the logarithm makes it many times larger."""
    height, width = depth.shape
    blocks = np.abs(depth[: height // BLOCK * BLOCK, : width // BLOCK * BLOCK]).reshape(
        height // BLOCK, BLOCK, width // BLOCK, BLOCK
    )
    noise = deviations(blocks, (1, 3)).astype(np.float32)
    return cv2.resize(noise, (width, height), interpolation=cv2.INTER_LINEAR)


def _straight(points: Points, normals: Points, depth: Points, size: float) -> list[Line]:
    """Greedy Hough transform: take the line with the most votes, remove its points, go on."""
    shortest = 0.08 * size
    bin_width = 1.5
    steps = np.arange(-SPREAD, SPREAD + 1)
    own = np.round(np.arctan2(normals[:, 1], normals[:, 0]) * ANGLES / np.pi).astype(int)
    angles = (own[:, None] + steps) % ANGLES
    table = np.arange(ANGLES) * np.pi / ANGLES
    offsets = points[:, :1] * np.cos(table[angles]) + points[:, 1:] * np.sin(table[angles])
    reach = int(size / bin_width) + 2
    cells = angles * (2 * reach) + np.round(offsets / bin_width).astype(int) + reach
    votes = np.bincount(cells.ravel(), minlength=ANGLES * 2 * reach)
    left = np.ones(len(points), dtype=bool)
    lines: list[Line] = []
    for _ in range(400):
        best = int(np.argmax(votes))
        if votes[best] < 0.5 * shortest or len(lines) >= 200:
            break
        angle = table[best // (2 * reach)]
        offset = (best % (2 * reach) - reach) * bin_width
        line, on = _refined(points, normals, depth, left, np.array([np.cos(angle), np.sin(angle)]), offset)
        taken = on if on.any() else left & np.any(cells == best, axis=1)
        votes -= np.bincount(cells[taken].ravel(), minlength=votes.size)
        left &= ~taken
        if line is not None and line.support >= shortest:
            lines.append(line)
    return sorted(lines, key=lambda line: -line.support)


def _refined(
    points: Points, normals: Points, depth: Points, left: NDArray[np.bool_], normal: Points, offset: float
) -> tuple[Line | None, NDArray[np.bool_]]:
    on = np.zeros(len(points), dtype=bool)
    for tolerance in (3.0, 2.5, 2.5):
        on = left & (np.abs(points @ normal - offset) < tolerance) & (np.abs(normals @ normal) > 0.98)
        if on.sum() < 10:
            return None, on
        middle = points[on].mean(axis=0)
        _, _, axes = np.linalg.svd(points[on] - middle, full_matrices=False)
        normal, offset = axes[1], float(axes[1] @ middle)
    along = np.sort(points[on] @ axes[0])
    # Points strewn thinly over a long way are chance, not a line.
    dense = len(along) > 0.35 * (along[-1] - along[0])
    return (Line(normal, offset, middle, int(on.sum()), float(depth[on].sum())) if dense else None), on
