"""The printed grid as one photograph shows it: is the camera where it was, and how much light do the lines take.

The setup says where every line should be. Short profiles across the lines, outside the shadow, say where it is in this
photograph: the difference tells a moved camera, and the mean profile tells how much light the ink takes at each distance
from a line's middle. Dividing by that lets an edge be found where it runs across or along a line, which would pull it to
itself otherwise. A camera moved by exactly one whole pitch looks unmoved; nothing in the picture can tell.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import numpy.typing as npt

from measurement.camera.pixels import LIGHT, Pixels, sample_light
from measurement.screen.line_shape import LineShape
from measurement.screen.setup import Setup

Array = npt.NDArray[np.float64]

REACH = 0.2
"""Half length of a profile across a line, in pitches: shifts up to this are seen as shifts."""

SAMPLES = 161
"""Points of a profile."""

STATIONS = 12
"""Places along one line between two crossings."""

INKED = 0.95
"""Share of light through the ink below which a place belongs to a line."""

SEEN_DEPTH = 0.06
"""Least share of the light that a grid line takes away."""


@dataclasses.dataclass(frozen=True, eq=False)
class GridLook:
    """What one photograph shows of the printed grid.

    Attributes:
        pitch: Distance of the lines in m.
        seen: Share of the expected places where a line was seen.
        place: Where a line was seen: X and Z in m on the screen, shape (n, 2).
        shift: Signed distances in m of the lines there from where the setup has them, shape (n,).
        axis: Whether each is a shift along X (0) or along Z (1), shape (n,).
        ink: Share of light that a line lets through over the distance from its middle; values at `distance`, shape (2, k),
            first for the lines of constant X.
        distance: Distances in m from a line's middle, shape (k,).
        offsets: Where each line lies from where it should be in m: for X and for Z, by its number.
    """

    pitch: float
    seen: float
    place: Array
    shift: Array
    axis: npt.NDArray[np.int64]
    ink: Array
    distance: Array
    offsets: tuple[dict[int, float], dict[int, float]]

    def movement(self) -> tuple[float, float]:
        """How far the picture of the screen has moved since the setup, and what of the shifts that leaves, both in m.

        Returns:
            Root mean square of the affine movement that fits the shifts best, over the places where lines were seen, and
            the root mean square of the rest; infinite where too few lines were seen.
        """
        moved2, rest2 = 0.0, 0.0
        for axis in (0, 1):
            mine = self.axis == axis
            if mine.sum() < 12:
                return np.inf, np.inf
            terms = np.column_stack([np.ones(mine.sum()), self.place[mine] / self.pitch])
            shift, weight = self.shift[mine], np.ones(mine.sum())
            for _ in range(6):
                fit = terms @ np.linalg.lstsq(terms * weight[:, None], shift * weight, rcond=None)[0]
                rest = np.abs(shift - fit)
                scatter = 1.4826 * float(np.median(rest)) + 1e-9
                weight = np.sqrt(np.minimum(1.0, 2.0 * scatter / np.maximum(rest, 1e-15)))
            moved2 += float(np.mean(fit**2))
            rest2 += float(np.mean(np.minimum(rest, 5.0 * scatter) ** 2))
        return np.sqrt(moved2), np.sqrt(rest2)

    @property
    def line_reach(self) -> float:
        """Half length in pitches of the shortest profile across a line that still shows the bare screen on both sides."""
        inked = self.distance[(self.ink < INKED).any(axis=0)]
        return float(np.clip(2.2 * inked.max(initial=0.0) / self.pitch, 0.3 * REACH, REACH))

    @functools.cached_property
    def lines(self) -> tuple[LineShape | None, LineShape | None]:
        """Width, depth and blur of the lines of constant X and of constant Z; None where none are seen."""
        return LineShape.fitted(self.distance, self.ink)

    def off_line(self, place: Array, axis: int) -> Array:
        """Signed distances (...) in m from the nearest line at places (...) along X or Z in m."""
        line = np.rint(place / self.pitch).astype(np.int64)
        return np.asarray(place - line * self.pitch - _look_up(self.offsets[axis], line))

    def transmission(self, places: Array) -> Array:
        """Share of light that the ink lets through at places (..., 2) in m on the screen."""
        cover = []
        # Of sharp ink, which alone covers all or nothing; a blurred line covers a part of each place.
        sharp = [line.depth for line in self.lines if line is not None]
        darkest = max(1.0 - float(self.ink.min()), *sharp, 1e-9)
        for axis in (0, 1):
            across = np.abs(self.off_line(places[..., axis], axis))
            cover.append((1.0 - np.interp(across, self.distance, self.ink[axis], right=1.0)) / darkest)
        # Ink on ink is the same ink: at a crossing the covered shares join as chances do, they do not multiply up.
        return 1.0 - darkest * (1.0 - (1.0 - cover[0]) * (1.0 - cover[1]))


def look_at_grid(
    image: Pixels,
    setup: Setup,
    pitch: float,
    roi: tuple[int, int, int, int],
    is_lit: npt.NDArray[np.bool_],
    light: npt.NDArray[np.float32] = LIGHT,
    reach: float = REACH,
) -> GridLook:
    """Look at the grid lines where they should be.

    Args:
        image: The photograph, shape (h, w, 3).
        setup: Camera and screen; the lines lie at whole multiples of the pitch on the screen.
        pitch: Distance of the lines in m.
        roi: Region x0, y0, x1, y1 in px to look at.
        is_lit: Where the screen is lit, on the region made smaller.
        light: Light of every stored number.
        reach: Half length of a profile across a line, in pitches.
    """
    x0, y0, x1, y1 = roi
    columns, rows = np.meshgrid(np.linspace(x0, x1 - 1, 33), np.linspace(y0, y1 - 1, 33))
    places = setup.to_metres(np.column_stack([columns.ravel(), rows.ravel()])) * setup.magnification
    places = places[np.isfinite(places).all(axis=1)]
    low, high = places.min(axis=0) / pitch, places.max(axis=0) / pitch
    along = (np.arange(STATIONS) + 0.5) / STATIONS
    along = along[np.abs(along - 0.5) < 0.5 - 0.6 * reach]
    across = np.linspace(-reach * pitch, reach * pitch, SAMPLES)
    expected, seen, inks = 0, [], []
    offsets: tuple[dict[int, float], dict[int, float]] = ({}, {})
    for axis in (0, 1):
        lines = np.arange(np.ceil(low[axis]), np.floor(high[axis]) + 1)
        gaps = np.arange(np.floor(low[1 - axis]), np.ceil(high[1 - axis]))
        number, other = (part.ravel() for part in np.meshgrid(lines, (gaps[:, None] + along).ravel(), indexing="ij"))
        target = np.empty((number.size, 2))
        target[:, axis], target[:, 1 - axis] = number * pitch, other * pitch
        pixel = setup.to_pixels(target / setup.magnification)
        keep = np.isfinite(pixel).all(axis=1) & (pixel > [x0, y0]).all(axis=1) & (pixel < [x1 - 1, y1 - 1]).all(axis=1)
        number, target, pixel = number[keep], target[keep], pixel[keep]
        points = np.zeros((0, SAMPLES, 2))
        if len(pixel):
            inverse = np.linalg.inv(setup.jacobian(pixel) * setup.magnification)
            points = pixel[:, None, :] + across[None, :, None] * inverse[:, None, :, axis]
        keep = _all_lit(points, roi, is_lit)
        number, target, points = number[keep], target[keep], points[keep]
        expected += len(points)
        if not len(points):
            inks.append(np.ones(SAMPLES))
            continue
        centre, ink, clear = _lines_in(sample_light(image, points, light).mean(axis=2), across)
        inks.append(ink)
        seen.append((target[clear], centre[clear], np.full(int(clear.sum()), axis)))
        for line in np.unique(number):
            of_line = centre[clear & (number == line)]
            if len(of_line) >= 3:
                offsets[axis][int(line)] = float(np.median(of_line))
    place = np.concatenate([part[0] for part in seen]) if seen else np.zeros((0, 2))
    shift = np.concatenate([part[1] for part in seen]) if seen else np.zeros(0)
    axes = np.concatenate([part[2] for part in seen]) if seen else np.zeros(0, dtype=np.int64)
    half = SAMPLES // 2
    folded = np.array([0.5 * (ink[half:] + ink[: half + 1][::-1]) for ink in inks])
    share = len(shift) / expected if expected else 0.0
    return GridLook(pitch, share, place, shift, axes, folded, across[half:], offsets)


def _lines_in(value: Array, across: Array) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Middle of the dark line in each profile (n, k), the mean profile (k,) about it, and where a line is clear."""
    size = value.shape[1]
    ends = np.r_[0 : size // 6, size - size // 6 : size]
    # A straight base line through both ends takes uneven light and vignetting out.
    basis = np.column_stack([np.ones(size), across / across[-1]])
    base = value[:, ends] @ np.linalg.pinv(basis[ends]).T @ basis.T
    with np.errstate(divide="ignore", invalid="ignore"):
        through = value / base
    noise = 1.4826 * np.median(np.abs(through[:, ends] - 1.0), axis=1)
    kernel = np.ones(5) / 5.0
    smooth = np.apply_along_axis(np.convolve, 1, 1.0 - through, kernel, "same")
    depth = smooth.max(axis=1)
    clear = np.isfinite(depth) & (depth > np.maximum(SEEN_DEPTH, 4.0 * noise / np.sqrt(5.0)))
    weight = np.where(smooth > 0.4 * depth[:, None], smooth - 0.4 * depth[:, None], 0.0)
    centre = across[np.argmax(smooth, axis=1)]
    window = 0.6 * across[-1]
    for _ in range(2):
        near = np.where(np.abs(across - centre[:, None]) < window, weight, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            centre = near @ across / near.sum(axis=1)
    clear &= np.isfinite(centre) & (np.abs(centre) < 0.8 * across[-1])
    if not clear.any():
        return centre, np.ones(size), clear
    # Of hundreds of profiles each looks at the line from another sub-pixel place; aligned, they show it finely.
    aligned = [np.interp(across + shift, across, row) for shift, row in zip(centre[clear], through[clear], strict=True)]
    ink = np.median(aligned, axis=0)
    ink = np.where(1.0 - ink > 0.01, ink, 1.0)
    return centre, np.minimum(ink, 1.0), clear


def _all_lit(points: Array, roi: tuple[int, int, int, int], is_lit: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    x0, y0, x1, y1 = roi
    some = points[:, :: SAMPLES // 8]
    inside = ((some >= [x0 + 2, y0 + 2]) & (some <= [x1 - 3, y1 - 3])).all(axis=2)
    scale = np.array(is_lit.shape[::-1]) / [x1 - x0, y1 - y0]
    index = np.rint((some - [x0, y0] + 0.5) * scale - 0.5).astype(np.int64)
    index = np.clip(index, 0, np.array(is_lit.shape[::-1]) - 1)
    return (inside & is_lit[index[..., 1], index[..., 0]]).all(axis=1)


def _look_up(offsets: dict[int, float], line: npt.NDArray[np.int64]) -> Array:
    if not offsets:
        return np.zeros(line.shape)
    low, high = min(offsets), max(offsets)
    table = np.array([offsets.get(number, 0.0) for number in range(low, high + 1)])
    known = (line >= low) & (line <= high)
    return np.where(known, table[np.clip(line - low, 0, high - low)], 0.0)
