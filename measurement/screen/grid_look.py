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

from measurement.robust import deviations
from measurement.screen.line_shape import LineShape
from measurement.screen.view import View

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

    def affine_terms(self, chosen: npt.NDArray[np.bool_]) -> Array:
        """Terms (m, 3) of an affine function over those places where a line was seen, in pitches."""
        return np.column_stack([np.ones(int(chosen.sum())), self.place[chosen] / self.pitch])

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


def look_at_grid(view: View, pitch: float, is_lit: npt.NDArray[np.bool_], reach: float = REACH) -> GridLook:
    """Look at the grid lines where they should be: at whole multiples of the pitch on the screen.

    Args:
        view: The photograph.
        pitch: Distance of the lines in m.
        is_lit: Where lines are looked for, on the region made smaller.
        reach: Half length of a profile across a line, in pitches.
    """
    across = np.linspace(-reach * pitch, reach * pitch, SAMPLES)
    both = []
    for axis in (0, 1):
        number, target = _places_on_lines(view, pitch, reach, axis)
        number, target, points = _profiles_across(view, number, target, across, is_lit, axis)
        both.append(_family(view, number, target, points, across))
    expected = sum(family.expected for family in both)
    shift = np.concatenate([family.shift for family in both])
    half = SAMPLES // 2
    return GridLook(
        pitch,
        len(shift) / expected if expected else 0.0,
        np.concatenate([family.place for family in both]),
        shift,
        np.repeat([0, 1], [len(family.shift) for family in both]),
        np.array([0.5 * (family.ink[half:] + family.ink[: half + 1][::-1]) for family in both]),
        across[half:],
        (both[0].offsets, both[1].offsets),
    )


@dataclasses.dataclass(frozen=True, eq=False)
class _Family:
    """What is seen of the lines of one direction.

    Attributes:
        expected: Number of places where a line could be seen.
        place: Those where one was seen, X and Z in m on the screen, shape (n, 2).
        shift: Distances in m of the lines from there, shape (n,).
        ink: Share of light that a line lets through at each sample of a profile, shape (SAMPLES,).
        offsets: Where each line lies from where it should be in m, by its number.
    """

    expected: int
    place: Array
    shift: Array
    ink: Array
    offsets: dict[int, float]


def _family(view: View, number: Array, target: Array, points: Array, across: Array) -> _Family:
    """The lines with these numbers (n,) at places (n, 2), seen in profiles of pixels (n, SAMPLES, 2) across them."""
    if not len(points):
        return _Family(0, np.zeros((0, 2)), np.zeros(0), np.ones(SAMPLES), {})
    centre, ink, clear = _lines_in(view.sample(points).mean(axis=2), across)
    lines = {int(line): centre[clear & (number == line)] for line in np.unique(number)}
    offsets = {line: float(np.median(found)) for line, found in lines.items() if len(found) >= 3}
    return _Family(len(points), target[clear], centre[clear], ink, offsets)


def _places_on_lines(view: View, pitch: float, reach: float, axis: int) -> tuple[Array, Array]:
    """Numbers (n,) of the lines of one direction and places (n, 2) along them in m, wherever the region may show them."""
    low, high = (end / pitch for end in view.extent())
    along = (np.arange(STATIONS) + 0.5) / STATIONS
    along = along[np.abs(along - 0.5) < 0.5 - 0.6 * reach]
    lines = np.arange(np.ceil(low[axis]), np.floor(high[axis]) + 1)
    gaps = np.arange(np.floor(low[1 - axis]), np.ceil(high[1 - axis]))
    number, other = (part.ravel() for part in np.meshgrid(lines, (gaps[:, None] + along).ravel(), indexing="ij"))
    target = np.empty((number.size, 2))
    target[:, axis], target[:, 1 - axis] = number * pitch, other * pitch
    return number, target


def _profiles_across(
    view: View, number: Array, target: Array, across: Array, is_lit: npt.NDArray[np.bool_], axis: int
) -> tuple[Array, Array, Array]:
    """Those of the lines and places whose profiles lie in what is looked at, and the profiles' pixels (n, SAMPLES, 2)."""
    pixel = view.setup.to_pixels(target / view.setup.magnification)
    keep = np.isfinite(pixel).all(axis=1) & view.inside(pixel)
    number, target, pixel = number[keep], target[keep], pixel[keep]
    if not len(pixel):
        return number, target, np.zeros((0, SAMPLES, 2))
    inverse = np.linalg.inv(view.setup.jacobian(pixel) * view.setup.magnification)
    points = pixel[:, None, :] + across[None, :, None] * inverse[:, None, :, axis]
    some = points[:, :: SAMPLES // 8]
    index = np.rint(view.reduced(some, is_lit.shape)).astype(np.int64)
    index = np.clip(index, 0, np.array(is_lit.shape[::-1]) - 1)
    keep = (view.inside(some, 2.0) & is_lit[index[..., 1], index[..., 0]]).all(axis=1)
    return number[keep], target[keep], points[keep]


def _lines_in(value: Array, across: Array) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Middle of the dark line in each profile (n, k), the mean profile (k,) about it, and where a line is clear."""
    size = value.shape[1]
    ends = np.r_[0 : size // 6, size - size // 6 : size]
    # A straight base line through both ends takes uneven light and vignetting out.
    basis = np.column_stack([np.ones(size), across / across[-1]])
    base = value[:, ends] @ np.linalg.pinv(basis[ends]).T @ basis.T
    with np.errstate(divide="ignore", invalid="ignore"):
        through = value / base
    noise = deviations(through[:, ends] - 1.0, 1)
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


def _look_up(offsets: dict[int, float], line: npt.NDArray[np.int64]) -> Array:
    if not offsets:
        return np.zeros(line.shape)
    low, high = min(offsets), max(offsets)
    table = np.array([offsets.get(number, 0.0) for number in range(low, high + 1)])
    known = (line >= low) & (line <= high)
    return np.where(known, table[np.clip(line - low, 0, high - low)], 0.0)
