"""The arms of a grid's crossing: cuts across them, and the straight line through each pair."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, median_filter

from measurement.camera.camera import Camera, Points
from measurement.robust import deviation
from measurement.screen.grid_lines import reduced
from measurement.screen.plane import Plane


@dataclasses.dataclass(frozen=True, eq=False)
class Arms:
    """The two arms of a crossing along one axis of the lattice, in ideal px.

    Attributes:
        centre: The crossing, shape (2,).
        unit: Direction along the line, shape (2,).
        normal: Direction across it, shape (2,).
        cells: Lengths of the cells before and behind the crossing: in perspective one is longer.
    """

    centre: Points
    unit: Points
    normal: Points
    cells: tuple[float, float]

    @classmethod
    def of(cls, plane: Plane, node: NDArray[np.int64], axis: int) -> Arms:
        """Those of a crossing of the lattice."""
        half = 0.5 * np.eye(2)[axis]
        centre, ahead, behind = plane.to_pixels(np.array([node, node + half, node - half], dtype=float))
        unit = (ahead - behind) / np.linalg.norm(ahead - behind)
        cells = 2.0 * float(np.linalg.norm(ahead - centre)), 2.0 * float(np.linalg.norm(behind - centre))
        return cls(centre, unit, np.array([-unit[1], unit[0]]), cells)

    def along(self, shares: Points) -> Points:
        """Distances (n,) in px from the crossing for shares (n,) of the cells, negative behind it."""
        return np.where(shares > 0, *self.cells) * shares


@dataclasses.dataclass(frozen=True, eq=False)
class LineLight:
    """A photograph as the logarithm of light.

    Attributes:
        value: Shape (h, w), made smaller.
        factor: Pixels of the photograph per pixel of it.
        camera: The camera.
    """

    value: NDArray[np.float32]
    factor: int
    camera: Camera

    @classmethod
    def of(cls, gray: NDArray[np.uint8], factor: int, camera: Camera) -> LineLight:
        """That of gray values (h, w)."""
        return cls(np.log(reduced(gray, factor) + 4.0), factor, camera)

    def cuts(self, arms: Arms, along: Points, across: Points) -> Points:
        """Light (rows, columns) at distances (rows,) along and (columns,) across arms in ideal px; NaN outside."""
        places = arms.centre + along[:, None, None] * arms.unit + across[None, :, None] * arms.normal
        raw = (self.camera.distort(places.reshape(-1, 2)).reshape(places.shape) + 0.5) / self.factor - 0.5
        height, width = self.value.shape
        inside = (raw >= 0.0).all(axis=2) & (raw[..., 0] <= width - 1) & (raw[..., 1] <= height - 1)
        x, y = np.moveaxis(raw.astype(np.float32), -1, 0)
        return np.where(inside, cv2.remap(self.value, x, y, cv2.INTER_LINEAR), np.nan)


def fit_line(shown: Points, across: Points, along: Points, depth: float) -> tuple[float, float, float] | None:
    """The straight line through the darkest places of cuts across it.

    Args:
        shown: The cuts, shape (n, k).
        across: Places of their samples across the line in px, shape (k,).
        along: Places of the cuts along it in px, shape (n,).
        depth: Depth of a line of this grid in the logarithm of light.

    Returns:
        Offset in px and slope of the line, and the offset's standard error; None where too few cuts show one.
    """
    edge = max(1, len(across) // 6)
    left, right = shown[:, :edge].mean(axis=1), shown[:, -edge:].mean(axis=1)
    outer = np.abs(across[0]) - (edge - 1) / 2 * (across[1] - across[0])
    ground = (left + right)[:, None] / 2 + (right - left)[:, None] / 2 * (across / outer)
    dark = ground - shown
    dip = dark[:, np.abs(across) <= np.abs(across[0]) / 3].mean(axis=1)
    # A cut must show this grid's line, with about the same light on both of its sides: no edge of a shadow, no dust.
    good = np.isfinite(dip) & (dip > 0.35 * depth) & (dip < 1.6 * depth) & ~_shaded(left - right, depth)
    if good.sum() < max(4, 0.4 * len(along)):
        return None
    places = np.full(len(along), np.nan)
    places[good] = (dark[good] @ across) / dark[good].sum(axis=1)
    good &= np.abs(places) < 0.8 * np.abs(across[0])
    for _ in range(4):
        if good.sum() < max(4, 0.35 * len(along)):
            return None
        design = np.column_stack([np.ones(good.sum()), along[good]])
        answer = np.linalg.lstsq(design, places[good])[0]
        missed = places - answer[0] - answer[1] * along
        spread = deviation(missed[good]) + 1e-3
        wanted = good & (np.abs(missed) < 3.5 * spread)
        if np.array_equal(wanted, good):
            break
        good = wanted
    design = np.column_stack([np.ones(good.sum()), along[good]])
    variance = float(np.sum(missed[good] ** 2)) / max(1, good.sum() - 2)
    error = np.sqrt(variance * np.linalg.inv(design.T @ design)[0, 0])
    return float(answer[0]), float(answer[1]), float(error)


def _shaded(difference: Points, depth: float) -> NDArray[np.bool_]:
    """Cuts whose sides differ in brightness because an edge of the shadow or dust is near, and the cuts beside them."""
    known = np.isfinite(difference)
    if not known.any():
        return ~known
    # The sides are compared over seven cuts at once, and no more strictly than noise allows.
    smooth = median_filter(np.where(known, difference, np.inf), size=7, mode="nearest")
    noise = deviation(difference[known] - np.median(difference[known])) / np.sqrt(7.0)
    return maximum_filter(np.abs(smooth) > np.clip(4.0 * noise, 0.06 * depth, 0.35 * depth), size=5, mode="nearest")
