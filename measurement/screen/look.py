"""The printed grid as one photograph shows it: is the camera where it was, and how much light do the lines take.

The setup gives the expected position of every line. Short profiles across the lines, outside the shadow, give its position in
this photograph: the difference tells a moved camera, and the mean profile tells how much light the ink takes at each distance
from a line's middle. Dividing by that lets an edge be found where it runs across or along a line, which would pull it to itself
otherwise. A camera moved by exactly one whole pitch looks unmoved; nothing in the picture can tell.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import numpy.typing as npt
from scipy.ndimage import correlate1d
from scipy.optimize import least_squares
from scipy.spatial import cKDTree
from scipy.special import ndtr

from measurement import pictures, robust
from measurement.screen.setup import Setup
from softmodels.common.arrays import Array

PROFILE_REACH = 0.2
"""Half length of a profile across a line, in pitches: shifts up to this are seen as shifts."""
MAX_INKED_LIGHT = 0.95
"""Share of light through the ink below which a place belongs to a line."""


@dataclasses.dataclass(frozen=True, eq=False)
class GridLook:
    """The printed grid in one photograph.

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
        """Return the terms (m, 3) of an affine function over those places where a line was seen, in pitches."""
        return np.column_stack([np.ones(int(chosen.sum())), self.place[chosen] / self.pitch])

    @functools.cached_property
    def number(self) -> npt.NDArray[np.int64]:
        """Numbers of the lines that were seen at `place`, shape (n,)."""
        on = np.where(self.axis == 0, self.place[:, 0], self.place[:, 1])
        return np.asarray(np.rint(on / self.pitch).astype(np.int64))

    def odd_line(self, allowed: float) -> tuple[int, int] | None:
        """Return the axis and the number of the only line off its place: without it, the others show a movement of up to
        ``allowed`` in m; None if there is none."""
        lines = sorted({(int(axis), int(number)) for axis, number in zip(self.axis, self.number, strict=True)})
        if not lines:
            return None
        moved, line = min((movement(self, line)[0], line) for line in lines)
        return line if moved <= allowed else None

    @property
    def line_reach(self) -> float:
        """Half length in pitches of the shortest profile across a line that still shows the bare screen on both sides."""
        inked = self.distance[(self.ink < MAX_INKED_LIGHT).any(axis=0)]
        return float(np.clip(2.2 * inked.max(initial=0.0) / self.pitch, 0.3 * PROFILE_REACH, PROFILE_REACH))

    @functools.cached_property
    def ink_reach(self) -> float:
        """Distance in m from a line's middle from which on there is no ink."""
        ends = self.distance[(np.roll(self.ink, 1, axis=1) < 1.0).any(axis=0)]
        return float(ends.max(initial=0.0))

    @functools.cached_property
    def lines(self) -> tuple[LineShape | None, LineShape | None]:
        """Width, depth and blur of the lines of constant X and of constant Z; None where none are seen."""
        return LineShape.fitted(self.distance, self.ink)

    def off_line(self, place: Array, axis: int) -> Array:
        """Return the signed distances (...) in m from the nearest line at places (...) along X or Z in m."""
        line = np.rint(place / self.pitch).astype(np.int64)
        return np.asarray(place - line * self.pitch - _look_up(self.offsets[axis], line))

    def transmission(self, places: Array) -> Array:
        """Return the share of light that the ink lets through at places (..., 2) in m on the screen."""
        cover = []
        # Of sharp ink, which alone covers all or nothing; a blurred line covers a part of each place.
        sharp = [line.depth for line in self.lines if line is not None]
        darkest = max(1.0 - float(self.ink.min()), *sharp, 1e-9)
        for axis in (0, 1):
            across = np.abs(self.off_line(places[..., axis], axis))
            cover.append((1.0 - np.interp(across, self.distance, self.ink[axis], right=1.0)) / darkest)
        # Ink on ink is the same ink: at a crossing the covered shares join as chances do, they do not multiply up.
        return 1.0 - darkest * (1.0 - (1.0 - cover[0]) * (1.0 - cover[1]))


PROFILE_SAMPLES = 161

STATIONS_PER_LINE = 12
"""Places along one line between two crossings."""
SEEN_DEPTH = 0.06
"""Least share of the light that a grid line takes away."""


def look_at_grid(view: View, pitch: float, is_lit: npt.NDArray[np.bool_], reach: float = PROFILE_REACH) -> GridLook:
    """Return the look at the grid lines where they should be, at whole multiples of the pitch in m on the screen, within
    ``is_lit``, on the region made smaller; ``reach`` is half the length of a profile across a line in pitches."""
    across = np.linspace(-reach * pitch, reach * pitch, PROFILE_SAMPLES)
    half, expected = PROFILE_SAMPLES // 2, 0
    places, shifts, inks, offsets = [], [], [], []
    for axis in (0, 1):
        number, target = _places_on_lines(view, pitch, reach, axis)
        number, target, points = _profiles_across(view, number, target, across, is_lit, axis)
        expected += len(points)
        centre, ink, clear = _lines_in(view.sample(points, EVERY_CHANNEL), across)
        lines = {int(line): centre[clear & (number == line)] for line in np.unique(number)}
        places.append(target[clear])
        shifts.append(centre[clear])
        inks.append(0.5 * (ink[half:] + ink[: half + 1][::-1]))
        offsets.append({line: float(np.median(cuts)) for line, cuts in lines.items() if len(cuts) >= 3})
    shift = np.concatenate(shifts)
    return GridLook(
        pitch, len(shift) / expected if expected else 0.0, np.concatenate(places), shift,
        np.repeat([0, 1], [len(along) for along in shifts]), np.array(inks), across[half:], (offsets[0], offsets[1]),
    )  # fmt: skip


def _places_on_lines(view: View, pitch: float, reach: float, axis: int) -> tuple[Array, Array]:
    """Return the numbers (n,) of the lines of one direction and places (n, 2) along them in m, wherever the region may show
    them."""
    low, high = (end / pitch for end in view.extent())
    along = (np.arange(STATIONS_PER_LINE) + 0.5) / STATIONS_PER_LINE
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
    """Return those of the lines and places whose profiles lie in what is looked at, and the profiles' pixels (n, SAMPLES,
    2)."""
    pixel = view.setup.to_pixels(target / view.setup.magnification)
    keep = np.isfinite(pixel).all(axis=1) & view.inside(pixel)
    number, target, pixel = number[keep], target[keep], pixel[keep]
    if not len(pixel):
        return number, target, np.zeros((0, PROFILE_SAMPLES, 2))
    inverse = np.linalg.inv(view.setup.jacobian(pixel) * view.setup.magnification)
    points = pixel[:, None, :] + across[None, :, None] * inverse[:, None, :, axis]
    some = points[:, :: PROFILE_SAMPLES // 8]
    index = np.rint(view.reduced(some, is_lit.shape)).astype(np.int64)
    index = np.clip(index, 0, np.array(is_lit.shape[::-1]) - 1)
    keep = (view.inside(some, 2.0) & is_lit[index[..., 1], index[..., 0]]).all(axis=1)
    return number[keep], target[keep], points[keep]


def _lines_in(value: Array, across: Array) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Return the middle of the dark line in each profile (n, k), the mean profile (k,) about it, and where a line is clear."""
    size = value.shape[1]
    if not len(value):
        return np.zeros(0), np.ones(size), np.zeros(0, dtype=bool)
    ends = np.r_[0 : size // 6, size - size // 6 : size]
    # A straight base line through both ends takes uneven light and vignetting out.
    basis = np.column_stack([np.ones(size), across / across[-1]])
    base = value[:, ends] @ np.linalg.pinv(basis[ends]).T @ basis.T
    with np.errstate(divide="ignore", invalid="ignore"):
        through = value / base
    noise = robust.deviations(through[:, ends] - 1.0, 1)
    smooth = correlate1d(1.0 - through, np.full(5, 0.2), axis=1, mode="constant")
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
    at = np.clip(np.arange(size) + centre[clear, None] / (across[1] - across[0]), 0.0, size - 1.0)
    left = np.minimum(at.astype(np.intp), size - 2)
    before, after = (np.take_along_axis(through[clear], place, axis=1) for place in (left, left + 1))
    ink = np.median(before + (at - left) * (after - before), axis=0)
    ink = np.where(1.0 - ink > 0.01, ink, 1.0)
    return centre, np.minimum(ink, 1.0), clear


def _look_up(offsets: dict[int, float], line: npt.NDArray[np.int64]) -> Array:
    if not offsets:
        return np.zeros(line.shape)
    low, high = min(offsets), max(offsets)
    table = np.array([offsets.get(number, 0.0) for number in range(low, high + 1)])
    known = (line >= low) & (line <= high)
    return np.where(known, table[np.clip(line - low, 0, high - low)], 0.0)


# ----------------------------------------------------------------------------------------------------------------------
# The grid's lines as the camera blurs them: how wide, how dark and how much out of focus.
#
# The blur of a photograph acts on the product of the shadow and the ink, not on each alone. A line of width L that takes the
# share D of the light, under a Gaussian blur s, lets T(d) = 1 - D (Phi((d + L/2) / s) - Phi((d - L/2) / s)) through. The
# blurred product of a penumbra S and the sharp line is S T less their covariance under the blur,
#
#     cov = -D (C(z, (d + L/2) / s; r) - C(z, (d - L/2) / s; r)),    C(a, b; r) = integral from 0 to r of phi2(a, b; t) dt,
#
# with z = u / w the place across the edge in its own width and r = s cos(angle) / w the correlation of both blurs, cos(angle)
# that of the edge's and the line's normals. What penumbra the lamp itself makes is part of w, not of s, so a sharp photograph
# of a soft shadow has nearly none of this, and one out of focus has much.
#
# Source of the bivariate normal integral: Z. Drezner, G. O. Wesolowsky, J. Stat. Comput. Simul. 35 (1990) 101,
# doi 10.1080/00949659008811236.


MAX_BLUR_CORRELATION = 0.97
"""Largest correlation of both blurs: an edge as sharp as the line along which it runs, but for the noise of both widths."""

LEAST_DEPTH = 0.02
"""Least share of the light that a blurred line takes, for its shape to be told."""

DEPTH_MISFIT = 0.005
"""Misfit that a factor of e in the depth makes from halfway between the least that is possible and black."""

QUADRATURE_RULE = np.polynomial.legendre.leggauss(8)


@dataclasses.dataclass(frozen=True)
class LineShape:
    """A straight line of the grid: its width, and the standard deviation of the picture's blur, in m on the screen, and
    the share of light that it takes where it is sharp."""

    width: float
    depth: float
    blur: float

    @classmethod
    def fitted(cls, distance: Array, inks: Array) -> tuple[LineShape | None, LineShape | None]:
        """Return the lines of both directions, of one ink and one blur, by the share of light (2, k) that they let through
        at distances (k,) in m from their middle to the profiles' end, relative to that there; None where there is no line
        to be seen."""
        seen = [axis for axis in (0, 1) if 1.0 - inks[axis].min() > LEAST_DEPTH]
        if not seen:
            return None, None
        inks = inks[seen]
        depth, end = float(1.0 - inks.min()), float(distance[-1])
        half = [float(distance[1.0 - ink > 0.5 * (1.0 - ink.min())].max()) for ink in inks]
        far = distance >= end * 2.0 / 3.0  # what a profile is taken relative to
        inked = inks < 1.0  # the faintest ink is left out of it

        def lines(logs: Array) -> list[LineShape]:
            values = np.exp(logs)
            return [cls(float(width), float(values[0]), float(values[1])) for width in values[2:]]

        def missed(logs: Array) -> Array:
            through = np.array([line.through(distance) for line in lines(logs)])
            rest = (through / through[:, far].mean(axis=1, keepdims=True) - inks)[inked]
            # A line much narrower than the blur does not tell whether it is faint and wide or black and thin.
            return np.r_[rest, DEPTH_MISFIT * (logs[0] - 0.5 * np.log(depth))]

        low = np.log([0.5 * depth, 0.003 * end, *[0.02 * end for _ in half]])
        high = np.log([1.0, end, *[2.0 * end for _ in half]])
        starts = ([depth, 0.2 * min(half), *(2.0 * value for value in half)], [min(1.0, 2.0 * depth), 0.8 * min(half), *half])
        fits = [
            least_squares(missed, np.clip(np.log(np.maximum(start, 1e-9)), low + 1e-6, high - 1e-6), bounds=(low, high))
            for start in starts
        ]
        shape_by_line = dict(zip(seen, lines(min(fits, key=lambda fit: float(fit.cost)).x), strict=True))
        return shape_by_line.get(0), shape_by_line.get(1)

    def through(self, off: Array) -> Array:
        """Return the share of light that the blurred line lets through at signed distances from its middle in m."""
        upper, lower = (off + 0.5 * self.width) / self.blur, (off - 0.5 * self.width) / self.blur
        return np.asarray(1.0 - self.depth * (ndtr(upper) - ndtr(lower)))

    def covariance(self, off: Array, z: Array, correlation: Array) -> Array:
        """Return the difference between the blurred product and blurred shadow times blurred line, per unit of the edge's
        rise, at signed distances in m from the line's middle and places ``z`` across the edge in its widths; the
        correlation of both blurs has the sign of d off / d z."""
        upper, lower = (off + 0.5 * self.width) / self.blur, (off - 0.5 * self.width) / self.blur
        r = np.clip(correlation, -MAX_BLUR_CORRELATION, MAX_BLUR_CORRELATION)
        # r = sin(t) takes the integrand's steepness near r = 1 away.
        half = 0.5 * np.arcsin(r)
        total = np.zeros(np.broadcast_shapes(off.shape, z.shape))
        for node, weight in zip(*QUADRATURE_RULE, strict=True):
            t = half * (1.0 + node)
            sine, cosine2 = np.sin(t), np.cos(t) ** 2
            for sign, place in ((1.0, upper), (-1.0, lower)):
                exponent = -0.5 * (z * z - 2.0 * sine * z * place + place * place) / cosine2
                total += sign * weight * np.exp(exponent)
        return np.asarray(-self.depth * total * half / (2.0 * np.pi))


# ----------------------------------------------------------------------------------------------------------------------
# A region of one photograph as light, and where it lies on the screen.


EVERY_CHANNEL = np.full(3, 1.0 / 3.0)
"""Weights of the channels in their mean."""

VIEW_NODES = 33
"""Places along each side of a region at which its reach on the screen is asked."""


@dataclasses.dataclass(frozen=True, eq=False)
class View:
    """Evaluated region x0, y0, x1, y1 in px of a photograph (h, w, 3), with the light of every stored number."""

    image: pictures.Pixels
    setup: Setup
    roi: tuple[int, int, int, int]
    light: npt.NDArray[np.float32] = dataclasses.field(default_factory=lambda: pictures.LIGHT_OF_SRGB)

    @property
    def size(self) -> Array:
        """Width and height of the region in px, shape (2,)."""
        return np.subtract(self.roi[2:], self.roi[:2]).astype(np.float64)

    @property
    def pixel(self) -> float:
        """Length in m of a pixel in the middle of the region, in the object's plane."""
        middle = np.array([[0.5 * (self.roi[0] + self.roi[2]), 0.5 * (self.roi[1] + self.roi[3])]])
        return float(np.sqrt(np.abs(np.linalg.det(self.setup.jacobian(middle)[0]))))

    def sample(self, points: Array, mix: Array | None = None) -> Array:
        """Return the light (..., 3) at pixels (..., 2), or its mix (...); NaN outside of the picture."""
        return pictures.sample_light(self.image, points, self.light, mix)

    def extent(self) -> tuple[Array, Array]:
        """Return the least and greatest X and Z in m on the screen that the region shows, shapes (2,)."""
        x0, y0, x1, y1 = self.roi
        columns, rows = np.meshgrid(np.linspace(x0, x1 - 1, VIEW_NODES), np.linspace(y0, y1 - 1, VIEW_NODES))
        places = self.setup.to_metres(np.column_stack([columns.ravel(), rows.ravel()])) * self.setup.magnification
        places = places[np.isfinite(places).all(axis=1)]
        return places.min(axis=0), places.max(axis=0)

    def inside(self, points: Array, margin: float = 0.0) -> npt.NDArray[np.bool_]:
        """Return which pixels (..., 2) lie in the region, and so far in px from its rim; shape (...)."""
        low, high = np.array(self.roi[:2]) + margin, np.array(self.roi[2:]) - 1.0 - margin
        return np.asarray(((points >= low) & (points <= high)).all(axis=-1))

    def reduced(self, points: Array, shape: tuple[int, ...]) -> Array:
        """Return the pixels (..., 2) of the photograph in those of the region made smaller to a picture of this shape (h,
        w)."""
        scale = np.array(shape[::-1]) / self.size
        return np.asarray((points - self.roi[:2] + 0.5) * scale - 0.5)

    def enlarged(self, points: Array, shape: tuple[int, ...]) -> Array:
        """Return the inverse of `reduced`."""
        scale = self.size / np.array(shape[::-1])
        return np.asarray((points + 0.5) * scale - 0.5 + self.roi[:2])


# ----------------------------------------------------------------------------------------------------------------------
# The screen's flatness near the outline.
#
# `movement` tells whether the picture of the whole screen has moved. A screen that bulges, or hot air before it, moves only a
# part of it, and the shadow's edge with it. So each printed line is looked at piece by piece, in the light and inside of the
# shadow, and what a piece lies off beyond the whole screen's movement counts for the outline near it.


STATIONS_PER_PIECE = 5
"""Places along a line that are taken together; their median does not see dust on one or two of them."""

MAX_PIECE_ERRORS = 6.0
"""Standard errors of such a median up to which a piece may lie where it should: the largest of some hundreds do."""

MAX_PIECE_DISTANCE = 1.0
"""Distance of a piece from the outline in pitches up to which it tells of it."""

FADING_DISTANCE = 0.5
"""Distance in pitches over which what a piece lies off fades to 1/e."""


def _pieces_of(looks: list[GridLook]) -> tuple[Array, Array, Array]:
    """Return the pieces of all lines that any of the looks has seen: middles (n, 2) in m on the screen, distances (n,) from
    where each should be in m, and their standard errors (n,); the first look tells the whole screen's movement."""
    places, offs, errors = [np.zeros((0, 2))], [np.zeros(0)], [np.zeros(0)]
    whole = [_affine(looks[0], axis) for axis in (0, 1)]
    for look in looks:
        every = np.ones(len(look.shift), dtype=bool)
        medians = [
            _medians(look, axis, look.shift - look.affine_terms(every) @ movement)
            for axis, movement in enumerate(whole)
            if movement is not None
        ]
        if not sum(len(part[1]) for part in medians):
            continue
        scatter = robust.deviation(np.concatenate([part[2] for part in medians]))
        # The median of n values has pi/2 times the variance of their mean; values about their own median scatter less.
        # A shadow's faint lines are read less well than the lit screen's, so each look has an error of its own.
        error = scatter * np.sqrt(np.pi / 2.0 / STATIONS_PER_PIECE) * 1.25
        places += [place for place, _, _ in medians]
        offs += [off for _, off, _ in medians]
        errors += [np.full(len(off), error) for _, off, _ in medians]
    return np.concatenate(places), np.concatenate(offs), np.concatenate(errors)


def _medians(look: GridLook, axis: int, shift: Array) -> tuple[Array, Array, Array]:
    """Return the middles (n, 2) of pieces of the lines of one axis, their medians (n,), and how far their values lie from these
    (n, k)."""
    places, medians, rests = [np.zeros((0, 2))], [np.zeros(0)], [np.zeros((0, STATIONS_PER_PIECE))]
    number = np.where(look.axis == axis, np.rint(look.place[:, axis] / look.pitch), np.nan)
    for line in np.unique(number[np.isfinite(number)]):
        on = np.flatnonzero(number == line)
        on = on[np.argsort(look.place[on, 1 - axis])]
        if len(on) < STATIONS_PER_PIECE:
            continue
        window = np.lib.stride_tricks.sliding_window_view(on, STATIONS_PER_PIECE)
        # A piece that reaches over a part where the line is not seen tells of neither end.
        window = window[np.ptp(look.place[window, 1 - axis], axis=1) < 1.2 * look.pitch]
        median = np.median(shift[window], axis=1)
        places.append(look.place[window[:, STATIONS_PER_PIECE // 2]])
        medians.append(median)
        rests.append(np.abs(shift[window] - median[:, None]))
    return np.concatenate(places), np.concatenate(medians), np.concatenate(rests).ravel()


@dataclasses.dataclass(frozen=True, eq=False)
class Flatness:
    """What the screen's own shape does to an edge: standard errors (n,) of its points, and of each piece of line beside
    the edge, shape (k,), the distance from where it should be beyond noise, the standard error of that, and the distance
    from the edge; all in m."""

    error: Array
    off: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    noise: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    away: Array = dataclasses.field(default_factory=lambda: np.zeros(0))


def flatness(looks: list[GridLook], points: Array) -> Flatness:
    """Return what the screen's own shape does to an edge at these points (n, 2) in m on the screen, by looks at its grid in the
    light and in the shadow; the first tells the whole screen's movement."""
    pitch, (place, off, noise) = looks[0].pitch, _pieces_of(looks)
    if not len(off):
        return Flatness(np.zeros(len(points)))
    # What the pieces have in common beyond their noise is the screen's own; far from all of them a point has more of it.
    common2 = robust.deviation(off[noise <= noise.min()]) ** 2 - float(noise.min()) ** 2
    far = cKDTree(place).query(points)[0] / (FADING_DISTANCE * pitch)
    error = np.sqrt(max(0.0, common2)) * np.minimum(1.0, far)
    near, _ = cKDTree(points).query(place, distance_upper_bound=MAX_PIECE_DISTANCE * pitch)
    beside = np.isfinite(near)
    beyond = np.abs(off) * (np.abs(off) > MAX_PIECE_ERRORS * noise)
    for number in np.flatnonzero(beyond > 0.0):
        far = np.linalg.norm(points - place[number], axis=1) / (FADING_DISTANCE * pitch)
        error = np.maximum(error, beyond[number] * np.exp(-far))
    return Flatness(error, beyond[beside], noise[beside], near[beside])


def _affine(look: GridLook, axis: int) -> Array | None:
    """Return the movement (3,) of the whole screen along one axis: a constant and its growth along X and Z; None if too little
    is visible."""
    mine = look.axis == axis
    if mine.sum() < 4 * STATIONS_PER_PIECE:
        return None
    return robust.robust_fit(look.affine_terms(mine), look.shift[mine], 8).coefficients


# ----------------------------------------------------------------------------------------------------------------------
# Detect movements of the camera or the screen since the setup.
#
# The printed grid tells: an affine movement of its lines is the camera's or the screen's, and what it leaves of their shifts is
# noise, dust, or another setup.


MIN_STATIONS_SEEN = 24
"""Least number of places where a line was seen."""


def movement(look: GridLook, without: tuple[int, int] | None = None) -> tuple[float, float]:
    """Return the root mean square in m of the affine movement that fits the lines' shifts since the setup best, over the
    places where lines were seen, and of what it leaves; infinite where too few were seen. One line may be left ``without``: its
    axis and its number."""
    moved2, rest2 = 0.0, 0.0
    for axis in (0, 1):
        mine = look.axis == axis
        if without is not None and axis == without[0]:
            mine &= look.number != without[1]
        if mine.sum() < MIN_STATIONS_SEEN // 2:
            return np.inf, np.inf
        fit = robust.robust_fit(look.affine_terms(mine), look.shift[mine], 6)
        moved2 += float(np.mean(fit.value**2))
        rest2 += float(np.mean(np.minimum(fit.rest, 5.0 * fit.scatter) ** 2))
    return np.sqrt(moved2), np.sqrt(rest2)
