"""Every check of photographs: what each asks, what it may see (its stage's evidence), and its answer (`Doubt`).

A wrong answer that is called good is the worst that can happen here. So whatever would make an edge mean something else than
the actuator's surface rejects the photograph, and what merely weakens it makes the outline untrusted. They stand below
in the order in which they are asked; what no check computes is in the modules that the evidence names. Add by `register_check`.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from measurement import pictures
from measurement.outline import edge, profiles
from measurement.outline.silhouette import Shape, Silhouette
from measurement.outline.zero import (
    MIN_END_DISTANCE,
    ON_SURFACE,
    Bow,
    Displacement,
    Mask,
    ZeroLine,
    highest_ripple,
    rounded,
    scale_of,
    sharpest_turn,
)
from measurement.series import witness
from softmodels.common import names
from softmodels.common.arrays import Array


@dataclasses.dataclass(frozen=True, eq=False)
class EdgeEvidence:
    """What checks may see of a photograph: its grid and its shadow's edge (``traced``)."""

    traced: edge.Traced

    @property
    def anyway(self) -> bool:
        """Whether the photograph shall be used in spite of doubts."""
        return self.traced.anyway


class ToneEvidence(EdgeEvidence):
    """The same, once its tone was compared with another."""


@dataclasses.dataclass(frozen=True, eq=False)
class ZeroEvidence(EdgeEvidence):
    """The photograph of the zero plane, and that plane; each number is computed when the first check asks for it."""

    zero: ZeroLine

    @functools.cached_property
    def placed(self) -> Array:
        """The smoothed edge as x along the surface and z above it in m, in order along the edge, shape (n, 2)."""
        placed = self.zero.place(self.traced.points)
        if self.zero.lift:
            # Beside the bulge, and as far above as the penumbra reaches, the surface's own depth has drawn the edge up.
            reach = self.traced.width_px * self.traced.scale
            placed[:, 1] -= self.zero.lift * np.exp(-0.5 * (placed[:, 1] / reach) ** 2)
        return placed

    @functools.cached_property
    def raw(self) -> Array:
        """The same of the edge as it was found."""
        return self.zero.place(self.traced.setup.to_metres(self.traced.edge.px))

    @functools.cached_property
    def upwards(self) -> Array:
        """Cosine of the angle between the way to the light and the surface's normal, shape (n,)."""
        return np.asarray(self.traced.normals @ self.zero.normal)

    @functools.cached_property
    def bow(self) -> Bow | None:
        """The bow of the undeformed surface; None where too little of it is visible."""
        seen = ~self.traced.line.bridged
        return Bow.of(self.zero, self.placed[seen], self.upwards[seen])

    @functools.cached_property
    def placing_error(self) -> Array:
        """Standard errors (n,) in m of the edge above the surface: edge, screen, surface and a camera that has moved.

        What all lengths and heights of a run share, the scale's error and the level's, is the outline's own.
        """
        traced, zero = self.traced, self.zero
        error = np.hypot(traced.own_error, zero.error_at(self.placed[:, 0]) * np.abs(self.upwards))
        # The model of the edge's shape moves outline and surface alike: the more, the wider the edge, each across itself.
        error = np.hypot(error, traced.model_error - zero.model_error * self.upwards)
        moved = traced.movement[0]
        if np.isfinite(moved):
            # What the grid's own reading leaves uncertain is in the plane's error already; only more than that has moved.
            error = np.hypot(error, np.sqrt(max(0.0, moved**2 - (GRID_READING_PX * traced.scale) ** 2)))
        return error

    @functools.cached_property
    def displaced(self) -> Displacement | None:
        """Where the surface beside the bulge lies; None where the edge lies beside it."""
        return Displacement.of(self.placed, self.upwards, self.placing_error, self.zero)

    @functools.cached_property
    def scale(self) -> float:
        """Width of the body's sides over that at zero pressure; NaN where they are not seen."""
        return self._errors[0]

    @property
    def error(self) -> Array:
        """Standard errors (n,) in m with those by a displaced body, by its scale, and by a ripple too low to be a doubt."""
        return self._errors[1]

    @functools.cached_property
    def _errors(self) -> tuple[float, Array]:
        assert self.displaced is not None  # `moved` rejects what lies beside the surface
        error = np.hypot(self.placing_error, self.displaced.error)
        scale, spread = scale_of(self.placed, self.upwards, error, self.traced.line.bridged, self.zero)
        error = np.hypot(error, spread * np.abs(self.placed[:, 1]))
        return scale, np.hypot(error, unsure_of(self.ripple))

    @functools.cached_property
    def ripple(self) -> tuple[int, float, float]:
        """The highest ripple of the edge: `shape.highest_ripple`."""
        return highest_ripple(self.raw)

    @functools.cached_property
    def above(self) -> Mask:
        """Which points do not lie below the surface, shape (n,)."""
        return np.asarray(self.placed[:, 1] > -np.maximum(MAX_ERRORS_BELOW * self.placing_error, ON_SURFACE))

    @functools.cached_property
    def top(self) -> int:
        """Index of the highest of them."""
        return int(np.argmax(np.where(self.above, self.placed[:, 1], -np.inf)))

    @functools.cached_property
    def pieces(self) -> list[npt.NDArray[np.int64]]:
        """Indices of the points of each piece of the edge that stands on the surface, along the edge."""
        stands = np.flatnonzero(self.placed[:, 1] > MIN_OBJECT_HEIGHT)
        parts = np.split(stands, np.flatnonzero(np.diff(stands) > 1) + 1)
        return [part for part in parts if len(part) >= MIN_SECOND_POINTS]

    @property
    def standing(self) -> bool:
        """Whether it rises above the surface."""
        return bool(self.placed[self.top, 1] > max(10.0 * self.placing_error[self.top], 3.0 * ON_SURFACE))

    @functools.cached_property
    def kept(self) -> np.ndarray:
        """Indices of the outline's points: those above, without the corners to the body's sides."""
        return np.flatnonzero(self.above & ~rounded(self.placed, self.upwards))

    @functools.cached_property
    def gaps(self) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
        """Indices of the points that were measured, from the outline's first to its last one, shape (k,), the lengths in m that
        are missing between them, and which of these the setup masks, both (k - 1,)."""
        inner = slice(self.kept[0], self.kept[-1] + 1)
        seen = np.flatnonzero(~self.traced.line.bridged[inner]) + inner.start
        lengths = np.linalg.norm(np.diff(self.placed[seen], axis=0), axis=1)
        above = np.isin(seen, self.kept)
        lengths[~(above[1:] | above[:-1])] = 0.0
        px = self.traced.line.px[seen]
        return seen, lengths, self.traced.masked(0.5 * (px[1:] + px[:-1]))


class OutlineEvidence(ZeroEvidence):
    """The same of an edge above the zero plane."""


@dataclasses.dataclass(frozen=True, eq=False)
class RunEvidence:
    """All outlines of a run, and the number of the photograph in question."""

    run: witness.Run
    number: int


class ListEvidence(RunEvidence):
    """The list, before anything is measured: its rows in ``run``."""


class CourseEvidence(RunEvidence):
    """The outlines that are trusted after all other checks."""


@dataclasses.dataclass(frozen=True, eq=False)
class SideEvidence:
    """A thing seen from the side: its silhouette, and since the photograph without pressure by how many px the background
    moved, how many times brighter it is and how many times softer the edge (None where it is not known); whether it shall be
    used in spite of doubts."""

    silhouette: Silhouette
    moved_px: float | None
    brighter: float | None
    softer: float | None
    anyway: bool


@dataclasses.dataclass(frozen=True, eq=False)
class ViewEvidence(SideEvidence):
    """A device seen from the side: its shape, the same and the silhouette without pressure; the size of a pixel, the standard
    errors of its length and, in rad, of its tip's angle, its length without pressure with its error (None where it is not
    known), lengths in m; whether this is the photograph without pressure, whether it has faces along the line of sight, and
    whether it may leave its plane."""

    shape: Shape
    before: Shape | None
    silhouette_before: Silhouette | None
    pixel: float
    length_error: float
    angle_error: float
    length: tuple[float, float] | None
    is_zero: bool
    has_sides: bool
    in_space: bool


@dataclasses.dataclass(frozen=True, eq=False)
class SeriesEvidence:
    """All side views of a list that are trusted so far, in its order: their pressures and the errors of these in Pa (n,), the
    places (n, 3) in m of their tips and of the turn of their ends over the length, and the standard errors (n,) of these; the
    number in question; whether the list has photographs without pressure of which none is trusted, and whether its photographs
    have times, so that they may show motion."""

    pressure: Array
    pressure_error: Array
    course: Array
    error: Array
    number: int
    lost_zero: bool
    is_timed: bool


@dataclasses.dataclass(frozen=True, eq=False)
class RevolvedEvidence(SideEvidence):
    """A body of revolution seen from the side: root mean square distance in m of one half of its outline from the other one's
    mirror image, and the standard error of its points."""

    unlike: float
    error: float


FEWEST_POINTS = 40
"""Points that an edge or an outline needs."""

MAX_ERRORS_BELOW = 4.0
"""Standard errors that a point may lie below the surface and still be on it."""

BESIDE_ORIGIN = (("to the right of", "to the left of"), ("above", "below"))
"""Words for lines of constant X and of constant Z on the two sides of the grid's origin."""

GRID_READING_PX = 0.1
"""Movement in px that the grid's lines can tell from none."""

OR_MASK = "or cover it with setup --mask"
"""Of a thing that hides a part of the edge."""

MAX_STATED_RIPPLE = 4.5
"""Ripple in its own scatter from which the stated error has to carry it: the largest of good outlines reach 4."""


@dataclasses.dataclass(frozen=True)
class Doubt:
    """What speaks against a photograph.

    Attributes:
        verdict: What is wrong, with its value.
        remedy: What to do about it.
        rejects: Whether there is no outline at all; otherwise it is only untrusted.
        lasting: Whether there is none even of a photograph that shall be used anyway, since nothing is left to measure.
    """

    verdict: str
    remedy: str = ""
    rejects: bool = False
    lasting: bool = False

    def __str__(self) -> str:
        return f"{self.verdict}; {self.remedy}" if self.remedy else self.verdict


def unsure_of(ripple: tuple[int, float, float]) -> float:
    """Return the error in m that a ripple leaves that is too low for a doubt: a thing of that height may lie on any length of
    the outline."""
    _, height, scatter = ripple
    return abs(height) if abs(height) > MAX_STATED_RIPPLE * scatter else 0.0


type Check = Callable[[Any], Iterator[Doubt]]
"""A question about a photograph, its docstring's first line: it yields what speaks against it, of which the first counts."""

STAGES = (
    ListEvidence, EdgeEvidence, ToneEvidence, ZeroEvidence, OutlineEvidence, RunEvidence, CourseEvidence, SideEvidence,
    ViewEvidence, SeriesEvidence, RevolvedEvidence,
)  # fmt: skip
CHECKS: dict[type, names.Registry[Check]] = {stage: names.Registry("check") for stage in STAGES}
"""Every check by the evidence that it is asked of and its name, in the order in which they are asked."""


def register_check[C](
    stage: type[EdgeEvidence | RunEvidence | SideEvidence | SeriesEvidence] = OutlineEvidence,
) -> Callable[[C], C]:
    """Let a check be asked of every piece of evidence of a stage, after those registered already; a decorator of a function."""
    return CHECKS[stage].register


def answers(evidence: EdgeEvidence | RunEvidence | SideEvidence | SeriesEvidence) -> Iterator[Doubt]:
    """Yield the answers of the checks of this evidence that are doubts, those of anything seen from the side first."""
    stages: list[type] = [SideEvidence, type(evidence)] if isinstance(evidence, SideEvidence) else [type(evidence)]
    for check in itertools.chain.from_iterable(CHECKS[stage].values() for stage in stages):
        yield from itertools.islice(check(evidence), 1)


def doubts(evidence: EdgeEvidence | SideEvidence) -> tuple[str, ...]:
    """Return what the checks have against a photograph, one sentence each; `Unmeasurable` if one of them rejects it, although
    it is not to be used anyway, or leaves nothing to measure."""
    doubts = []
    for doubt in answers(evidence):
        if doubt.lasting or (doubt.rejects and not evidence.anyway):
            raise pictures.Unmeasurable(str(doubt))
        doubts.append(str(doubt))
    return tuple(doubts)


# ----------------------------------------------------------------------------------------------------------------------
# Before anything is measured.


@register_check(ListEvidence)
def repeated(e: ListEvidence) -> Iterator[Doubt]:
    """Is it another file than all others of the list?"""
    if same := e.run.repeated.get(e.run.rows[e.number].file):
        yield Doubt(same, rejects=True, lasting=True)


# ----------------------------------------------------------------------------------------------------------------------
# Of the photograph and its shadow's edge.


@register_check(EdgeEvidence)
def exposure(e: EdgeEvidence) -> Iterator[Doubt]:
    """Is it neither too dark nor saturated?"""
    bright = float(np.percentile(e.traced.small.mean(axis=2), 90))
    if bright < 0.015:
        verdict = f"it is underexposed: the screen has {bright:.1%} of the camera's range"
        yield Doubt(verdict, "increase the exposure", rejects=True)
    share = float((e.traced.small.min(axis=2) > 0.985).mean())
    if share > 0.2:
        verdict = f"it is overexposed: {share:.0%} of the picture is saturated, which would shift the edge"
        yield Doubt(verdict, "reduce the exposure", rejects=True)


MAX_SCREEN_MOVEMENT = (15e-6, 0.5)
"""Movement of the screen's picture since the setup from which it is rejected: the larger of these, in m and px."""
MAX_LINE_SCATTER = (60e-6, 1.5)
"""The same for the scatter of the grid's lines about where they should be."""
MIN_LINES_SEEN_SHARE, MIN_LINE_PLACES = 0.4, 24
"""Least share of the grid's expected lines that must be visible, and least number of places where one was seen."""


@register_check(EdgeEvidence)
def movement(e: EdgeEvidence) -> Iterator[Doubt]:
    """Is the grid where the setup has it?

    An affine movement of its lines is the camera's or the screen's, and what it leaves of their shifts is noise, dust, or
    another setup.
    """
    look, pixel = e.traced.look, e.traced.scale
    if look is None:
        return
    if look.seen < MIN_LINES_SEEN_SHARE or len(look.shift) < MIN_LINE_PLACES:
        yield Doubt(
            f"the grid is not where the setup has it ({look.seen:.0%} of its lines are seen): the camera or the screen has "
            "moved, the picture is turned or mirrored, or the grid cannot be seen",
            "photograph the grid again and rerun setup", rejects=True)  # fmt: skip
    moved, rest = e.traced.movement
    if not np.isfinite(moved):
        yield Doubt(
            "too few of the grid's lines are seen beside the shadow, along one of their two directions, to check whether "
            "the camera has moved", "show more of the grid, or use one with a smaller pitch", rejects=True)  # fmt: skip
    allowed = max(MAX_SCREEN_MOVEMENT[0], MAX_SCREEN_MOVEMENT[1] * pixel)
    if not moved <= allowed:
        if (line := look.odd_line(allowed * e.traced.setup.magnification)) is not None:
            way, number = line
            yield Doubt(
                f"all lines of the grid but number {abs(number)} {BESIDE_ORIGIN[way][number < 0]} its origin are where they "
                "were: a second thing (a cable, a hose, a hair) lies along that one",
                f"take it away and photograph it again, {OR_MASK}", rejects=True)  # fmt: skip
        yield Doubt(
            f"the camera or the screen has moved by {moved * 1e6:.0f} um since the setup or during the exposure, or the "
            "picture is turned, mirrored, cropped or too noisy",
            "photograph the grid again from the current camera position and rerun setup", rejects=True)  # fmt: skip
    if not rest <= max(MAX_LINE_SCATTER[0], MAX_LINE_SCATTER[1] * pixel):
        yield Doubt(
            f"the grid's lines are {rest * 1e6:.0f} um off: the picture is too noisy, too much compressed or too dusty to "
            "see them, the screen has bent, or this is another setup",
            "clean and flatten the screen, and photograph grid and body again", rejects=True)  # fmt: skip


WIDEST_EDGE = 300e-6
"""Greatest standard deviation in m of penumbra and blur together."""
SEVERAL_EDGES = "the shadow has several edges, from a second lamp, a reflection or a double exposure"
ONE_LAMP = "use only one lamp, cover reflecting surfaces, and photograph it again"


@register_check(EdgeEvidence)
def sharp(e: EdgeEvidence) -> Iterator[Doubt]:
    """Is enough of the edge clear, and sharp enough for half of the light to be a place?"""
    edge = e.traced.edge
    if len(edge.px) < FEWEST_POINTS:
        yield Doubt(
            f"only {len(edge.px)} points of the edge are clear enough; at least {FEWEST_POINTS} are needed",
            "photograph it again with more light and contrast, and with no grid line along the surface",
            rejects=True, lasting=True)  # fmt: skip
    slope = e.traced.setup.jacobian(edge.px)
    width = edge.width * np.linalg.norm(slope @ edge.normal[..., None], axis=(1, 2))
    wide = float(np.percentile(width, 90))
    if not wide <= WIDEST_EDGE and edge.shape.misfit >= profiles.LARGEST_MISFIT:
        yield Doubt(
            f"the light falls in steps over {wide * 1e6:.0f} um (standard deviation), not as one lamp's: {SEVERAL_EDGES}",
            ONE_LAMP, rejects=True)  # fmt: skip
    elif not wide <= WIDEST_EDGE:
        yield Doubt(
            f"the edge is blurred over {wide * 1e6:.0f} um (standard deviation), more than {WIDEST_EDGE * 1e6:.0f} um",
            "focus on the screen, use a smaller lamp, or move the lamp away and the body closer to the screen",
            rejects=True)  # fmt: skip


SATURATED_LIGHT, MAX_SATURATED_SHARE = 0.985, 0.1
"""Light of a channel from which it is taken as saturated, and share of the edge that may lie beside such light."""


@register_check(EdgeEvidence)
def saturation(e: EdgeEvidence) -> Iterator[Doubt]:
    """Is the screen beside the edge darker than white?"""
    edge = e.traced.edge
    beside = e.traced.view.sample(edge.px + 3.0 * edge.width[:, None] * edge.normal)
    blank = float(np.mean((beside > SATURATED_LIGHT).any(axis=1)))
    if blank > MAX_SATURATED_SHARE:
        verdict = f"it is overexposed: beside {blank:.0%} of the edge the screen is saturated, which shifts the edge"
        yield Doubt(verdict, "reduce the exposure", rejects=True)


MOST_PART = 0.05
"""Share of the edge where light may fall over less than `MIN_PROFILE_DEPTH` of the shadow's depth."""
MAX_DEPTH_CHANGE, DEPTH_PIECES, MIN_POINTS_PER_PIECE = 0.08, 12, 20
"""Change of the shadow's depth along its edge that one lamp does not make, over means of so many pieces of the edge, each
of so many points at least."""


@register_check(EdgeEvidence)
def one_lamp(e: EdgeEvidence) -> Iterator[Doubt]:
    """Does the light fall all the way from the screen's to the shadow's, alike along the edge?"""
    part = e.traced.edge.contrast / e.traced.coarse.colour.depth
    if np.median(part) < edge.MIN_PROFILE_DEPTH:
        yield Doubt(
            f"the light falls in steps, by {np.median(part):.0%} of the shadow's depth at this edge: {SEVERAL_EDGES}",
            ONE_LAMP, rejects=True)  # fmt: skip
    count = max(MIN_POINTS_PER_PIECE, len(part) // DEPTH_PIECES)
    level = np.convolve(part, np.ones(count) / count, "valid")
    if len(part) >= 2 * count and np.ptp(level) > MAX_DEPTH_CHANGE:
        yield Doubt(
            f"the shadow's depth changes by {np.ptp(level):.0%} along its edge: a second lamp, a reflection or stray light "
            "reaches a part of it")  # fmt: skip
    share = float(np.mean(part < edge.MIN_PROFILE_DEPTH))
    if share > MOST_PART:
        yield Doubt(f"along {share:.0%} of the edge the light falls only part of the way: a second shadow or a reflection")


BLURRED_PATCH, PATCH_NOISES = 0.12, 8.0
"""Logarithm of the width over its smooth course, and the same in its own scatter, from which a patch is blurred."""


@register_check(EdgeEvidence)
def drop(e: EdgeEvidence) -> Iterator[Doubt]:
    """Is the edge equally sharp along its length?"""
    more, scatter = edge.widest_patch(e.traced.edge, e.traced.scale)
    if not more <= max(BLURRED_PATCH, PATCH_NOISES * scatter):
        yield Doubt(
            f"a part of the edge is {np.expm1(more):.0%} more blurred than the rest: a drop or grease on the lens, which "
            "also shifts the edge, or a second object casts the shadow there")  # fmt: skip


@register_check(EdgeEvidence)
def thread(e: EdgeEvidence) -> Iterator[Doubt]:
    """Is the shadow free of thin things?"""
    if e.traced.touched:
        yield Doubt("a thin dark thing (hair, thread, tube, a speck) touches the shadow", f"take it away, {OR_MASK}")


MOST_NOISE = 50e-6
"""Greatest median standard error in m of the points of an edge."""


@register_check(EdgeEvidence)
def noise(e: EdgeEvidence) -> Iterator[Doubt]:
    """Is each point of the edge known, and well enough?"""
    traced = e.traced
    if not np.isfinite(traced.points).all():
        yield Doubt(
            "the shadow lies where the lens correction is not defined",
            "calibrate with boards up to the picture's corners, or aim the camera at the shadow",
            rejects=True, lasting=True)  # fmt: skip
    errors = traced.setup.error(traced.line.px, traced.line.error, traced.normals)
    typical = float(np.median(errors[~traced.line.bridged]))
    if not typical <= MOST_NOISE:
        yield Doubt(
            f"the edge is too noisy: its points have a standard error of {typical * 1e6:.0f} um",
            "photograph it again with more light, a lower sensitivity (ISO) or less compression", rejects=True)  # fmt: skip


MAX_LINE_OFFSET, MAX_OFFSET_ERRORS = 25e-6, 8.0
"""Distance of a piece of line from where it should be, in m and in standard errors, from which the outline beside it is
not trusted."""


@register_check(EdgeEvidence)
def flat(e: EdgeEvidence) -> Iterator[Doubt]:
    """Is the screen flat beside the edge?"""
    flat = e.traced.flatness
    off = flat.off * (flat.off >= np.maximum(MAX_LINE_OFFSET, MAX_OFFSET_ERRORS * flat.noise))
    if not off.any():
        return
    worst = int(np.argmax(off))
    yield Doubt(
        f"{flat.away[worst] * 1e3:.1f} mm beside the edge the printed grid is {off[worst] * 1e6:.0f} um off: the screen "
        "bulges or slides there, hot air or a drop on the lens bends the light, or the lens' correction is wrong"
    )


@register_check(ToneEvidence)
def tone(e: ToneEvidence) -> Iterator[Doubt]:
    """Does the edge's shape show how the file stores light, or would another tone do no harm?"""
    if e.traced.tone_error:
        yield Doubt(
            "the shape of the penumbra does not show how the file stores light; edges may be "
            f"{e.traced.tone_error * 1e6:.0f} um off",
            "give --tone srgb for a camera's JPEG, --tone linear for numbers in proportion to the light")  # fmt: skip


# ----------------------------------------------------------------------------------------------------------------------
# Of the zero plane.


MAX_BOW = 20e-6
"""Bow in m of the surface from which the lamp or the body is not level."""


@register_check(ZeroEvidence)
def level(e: ZeroEvidence) -> Iterator[Doubt]:
    """Does the light run along the undeformed surface?"""
    bow = e.bow
    if bow is None or bow.rise <= max(MAX_BOW, 4.0 * bow.error):
        return
    if np.isnan(bow.rise):
        yield Doubt("the surface reaches beyond what seem to be the body's sides, so that its level cannot be checked")
    if bow.by_depth(e.traced.lift):
        return
    bows = f"the undeformed surface bows up by {bow.rise * 1e6:.0f} um towards its middle, as the rim of a round body does"
    if e.traced.lift:
        yield Doubt(
            f"{bows} if the lamp is large: its penumbra widens with the body's depth",
            "use a smaller lamp or move it away, at the height of the surface, and repeat all photographs")  # fmt: skip
    yield Doubt(
        f"{bows} if the lamp or the body is at least {np.degrees(bow.rise / bow.radius):.1f} degrees off level: heights "
        "are too small by at least that much",
        "move the lamp to the height of the surface, level the body and repeat all photographs",
    )


# ----------------------------------------------------------------------------------------------------------------------
# Of an outline above the zero plane.


MIN_OBJECT_HEIGHT, MAX_DISTANCE_BESIDE, MIN_SECOND_POINTS = 150e-6, 0.5e-3, 10
"""Height in m above the surface from which a piece of the edge stands on it, distance in m beyond the body's sides from which
it is no part of the body, and points of a piece that is one."""


@register_check()
def second_thing(e: OutlineEvidence) -> Iterator[Doubt]:
    """Does nothing but the membrane between the body's sides stand above the surface?

    A ball, a hand, a hose or a ruler beside the body makes a part of the edge lie off the surface too. So this is asked before
    the actuator is said to have moved.
    """
    take = f"take it away and photograph it again, {OR_MASK}, or write anyway in the column use of the list"
    sides, z = e.zero.sides, e.placed[:, 1]
    if sides is not None:
        rim = e.traced.rim
        rim = e.zero.place(rim[~e.traced.masked(e.traced.setup.to_pixels(rim))])
        far, out = (
            (place[:, 1] > MIN_OBJECT_HEIGHT) & (sides.beyond(place[:, 0]) > MAX_DISTANCE_BESIDE) for place in (e.placed, rim)
        )
        both = len(np.unique(np.sign(e.placed[far, 0] - sides.middle))) == 2
        balloon = both and len(e.pieces) == 1 and not out.any()  # wider than the body it stands on
        if far.sum() + out.sum() >= MIN_SECOND_POINTS and not balloon:
            high = float(np.r_[z[far], rim[out, 1]].max())
            yield Doubt(
                f"beside the body something stands up to {high * 1e3:.1f} mm above its surface: a second thing (a ball, a "
                "hand, a hose, a ruler, a cable) is in the light", take, rejects=True)  # fmt: skip
    if len(e.pieces) > 1:
        least = min(float(z[piece].max()) for piece in e.pieces)
        yield Doubt(
            f"the outline is in {len(e.pieces)} pieces above the surface, the lowest one {least * 1e3:.1f} mm high: a second "
            "thing stands on the surface or before it, or the device has several bulges", take)  # fmt: skip


RIM_HEIGHT = 150e-6
"""Height in m up to which the shadow may meet the frame: a flat surface runs out of the picture, an actuator must not."""


@register_check(OutlineEvidence)
def rim(e: OutlineEvidence) -> Iterator[Doubt]:
    """Is there light all round the bulge?"""
    rim = e.traced.rim
    rim = rim[~e.traced.masked(e.traced.setup.to_pixels(rim))]
    if not len(rim):
        return
    height = e.zero.place(rim)[:, 1].max()
    # The rim is known to a pixel of the small version only.
    coarse = float(np.median(np.linalg.norm(np.diff(rim, axis=0), axis=1))) if len(rim) > 1 else 0.0
    if height > RIM_HEIGHT + 2.0 * coarse:
        yield Doubt(
            f"the shadow touches the frame or the region of interest {height * 1e3:.1f} mm above the surface",
            "widen setup --roi, or aim the camera so that light is seen all round the bulge", rejects=True)  # fmt: skip


@register_check(OutlineEvidence)
def top(e: OutlineEvidence) -> Iterator[Doubt]:
    """Is its highest place that of a surface seen from the side?"""
    placed, above = e.placed, np.flatnonzero(e.above)
    if len(above) < FEWEST_POINTS:
        return  # `moved` says so
    if e.standing and e.upwards[max(0, e.top - 3) : e.top + 4].mean() < 0.5:
        yield Doubt(
            "the shadow's highest point is not a rounded top: it hangs from above, or an object is in the light",
            "remove it, turn the picture upright before setup and photos, or exclude it with setup --roi",
            rejects=True)  # fmt: skip
    if e.standing and min(e.top - above[0], above[-1] - e.top) < 5:
        yield Doubt(
            "the outline ends at its highest point: part of it is hidden or outside of the picture",
            "aim the camera at all of it, and clear away what hides it", rejects=True)  # fmt: skip
    if placed[above, 1].max() - placed[above, 1].min() > 2.0 * np.ptp(placed[above, 0]):
        yield Doubt(
            "the shadow stands more than twice as high as it is wide, so it is not an inflated surface",
            "exclude other shadows with setup --roi", rejects=True)  # fmt: skip


MOST_MOVED = 200e-6
"""Distance in m of the surface beside the bulge from the zero plane from which nothing is measured."""


@register_check(OutlineEvidence)
def moved(e: OutlineEvidence) -> Iterator[Doubt]:
    """Is the body where it was at zero pressure?"""
    again = "photograph it at zero pressure again and list that, or correct setup --zero"
    if e.above.sum() < FEWEST_POINTS:
        yield Doubt(
            "the shadow is below the surface at zero pressure: the actuator has moved, or the zero is wrong",
            again, rejects=True, lasting=True)  # fmt: skip
    if not e.standing and np.median(e.upwards[e.above]) < 0.5:
        yield Doubt(
            "the edge on the surface's line is not level: the actuator has moved or is not in the picture", again, rejects=True
        )
    seen = e.displaced
    if seen is None:
        yield Doubt(
            "the shadow is beside the surface at zero pressure: the actuator has moved, or the zero is wrong",
            again, rejects=True, lasting=True)  # fmt: skip
        return
    off = abs(seen.off)
    if seen.seen and off > max(ON_SURFACE, seen.tolerance):
        yield Doubt(
            f"beside the bulge the surface lies {off * 1e3:.2f} mm {'above' if seen.off > 0.0 else 'below'} the zero "
            "plane: the actuator, the lamp or the camera has moved since the zero was taken",
            "photograph it at zero pressure again, or correct setup --zero",
            rejects=off > max(MOST_MOVED, seen.tolerance))  # fmt: skip
    if not seen.seen and seen.aslant > ON_SURFACE:
        yield Doubt(
            f"one end of the surface lies {2e3 * seen.aslant:.2f} mm lower than the other: the actuator, the lamp or the "
            "camera was tilted since the zero was taken", "photograph it at zero pressure again")  # fmt: skip


MIN_CREASE_TURN, MIN_CORNER_TURN = 8.0, 25.0
"""Turn in degrees, beyond that of the neighbouring edge, which no membrane makes by itself, and which is another thing."""
MAX_RIPPLE, MAX_RIPPLE_ERRORS = 15e-6, 8.0
"""Distance in m of the edge from its neighbourhood, and the same in its own scatter, from which it is no membrane's."""
MIN_WIDTH_SHARE = 0.08
"""Least width at half height of what stands on the surface, as a share of the surface that is visible."""


@register_check(OutlineEvidence)
def membrane(e: OutlineEvidence) -> Iterator[Doubt]:
    """Is the outline that of one membrane, and no second thing (hair, tube, drop, fibre, dust) on it or before it?

    Such a thing may show as a corner, by a small width, and as a bump: what it shows first is said.
    """
    place, turn = sharpest_turn(e.raw)
    high = f"{turn:.0f} degrees {e.raw[place, 1] * 1e3:.1f} mm above the surface"
    if turn > MIN_CORNER_TURN:
        yield Doubt(
            f"the edge has a corner of {high}: a second thing (hair, tube, drop, finger) merges with the shadow, or hides "
            "part of it", f"take it away and photograph it again, {OR_MASK}", rejects=True)  # fmt: skip
    x, z = e.placed.T
    top = int(np.argmax(z))
    if z[top] >= max(10.0 * e.error[top], ON_SURFACE):
        width = float(np.ptp(x[z > 0.5 * z[top]]))
        if width < MIN_WIDTH_SHARE * min(e.zero.extent[1] - e.zero.extent[0], float(np.ptp(x))):
            yield Doubt(
                f"the object on the surface is only {width * 1e3:.1f} mm wide at half its height: dust, a drop or another "
                "object", f"take it away, {OR_MASK}")  # fmt: skip
    at, bump, scatter = e.ripple
    if abs(bump) > max(MAX_RIPPLE, MAX_RIPPLE_ERRORS * scatter):
        yield Doubt(
            f"{e.raw[at, 1] * 1e3:.1f} mm above the surface the outline has a {'bump' if bump > 0.0 else 'hollow'} of "
            f"{abs(bump) * 1e6:.0f} um that is narrower than a membrane can bend: a fibre, a grain or a drop on it or "
            "on the lens, or the screen is not flat", f"take it away, {OR_MASK}")  # fmt: skip
    if turn > MIN_CREASE_TURN:
        yield Doubt(
            f"the edge bends sharply by {high}: something lies on it or hides part of it, or it is creased",
            f"take it away, {OR_MASK}",
        )


UNCLEAR_TOP = 5.0
"""Standard error of the highest place over the outline's usual one from which something must be wrong there."""


@register_check(OutlineEvidence)
def clear_top(e: OutlineEvidence) -> Iterator[Doubt]:
    """Is the edge as clear at its highest place as elsewhere?"""
    error = e.error[e.above]
    own, usual = float(error[np.argmax(e.placed[e.above, 1])]), float(np.median(error))
    if own >= max(UNCLEAR_TOP * usual, MIN_END_DISTANCE):
        yield Doubt(f"the edge is unclear at its highest place: {own * 1e6:.0f} um there, {usual * 1e6:.0f} um elsewhere")


@register_check(OutlineEvidence)
def zero_plane(e: OutlineEvidence) -> Iterator[Doubt]:
    """Is the zero plane's photograph free of doubt, and stored as this one?"""
    remarks = [f"of the zero plane's photograph: {doubt}" for doubt in e.zero.doubts]
    if e.zero.tone and e.zero.tone != e.traced.tone:
        remarks.append(
            f"it seems to store light as {e.traced.tone} but the zero plane's photograph as {e.zero.tone}; "
            "choose one with --tone"
        )
    if remarks:
        yield Doubt("; ".join(remarks))


LONGEST_DENT = 1e-3
"""Length in m from which it is one."""


@register_check(OutlineEvidence)
def dent(e: OutlineEvidence) -> Iterator[Doubt]:
    """Does the surface nowhere lie below the undeformed one between places where it does not?

    One that has sunk as a whole, or beside the bulge, is no dent.
    """
    if len(e.kept) < FEWEST_POINTS or e.displaced is None:
        return  # `whole` says so
    inner = slice(e.kept[0], e.kept[-1] + 1)
    sunken = ~(e.above | e.traced.line.bridged) & (e.placed[:, 1] < -ON_SURFACE - 2.0 * max(e.displaced.sunk, 0.0))
    ends = np.flatnonzero(np.diff(np.r_[False, sunken[inner], False].astype(int)))
    for part in e.kept[0] + ends.reshape(-1, 2):
        x, z = e.placed[slice(*part)].T
        if np.ptp(x) > LONGEST_DENT:
            yield Doubt(
                f"over {np.ptp(x) * 1e3:.1f} mm the surface lies up to {-z.min() * 1e3:.2f} mm below the undeformed one: "
                "it is dented or drawn in; only parts above that surface are measured",
                "raise the pressure, or photograph the zero again with the body in its present state",
                rejects=True)  # fmt: skip


MAX_TRUSTED_GAP, MAX_GAP = 1e-3, 4e-3
"""Missing length of edge in m that makes an outline untrusted, and that makes it none."""
TOP_GAP = 0.5e-3
"""Missing length in m that makes it untrusted where its highest place may lie in it."""


@register_check(OutlineEvidence)
def whole(e: OutlineEvidence) -> Iterator[Doubt]:
    """Was all of the outline measured?"""
    if len(e.kept) < FEWEST_POINTS:
        yield Doubt(
            "too little of the surface between the body's sides is visible",
            "move the camera closer, or photograph it again with all of its surface in the light",
            rejects=True, lasting=True)  # fmt: skip
    seen, lengths, masked = e.gaps
    words = "the outline has a gap of {:.1f} mm where no edge is clear"
    longest = 1e3 * lengths[~masked].max(initial=0.0)
    if longest > 1e3 * MAX_GAP:
        # What else speaks against the edge may tell why a part of it is missing.
        verdict = "; ".join([words.format(longest), *e.traced.doubts])
        yield Doubt(verdict, f"remove what hides it and photograph it again, {OR_MASK}", rejects=True)
    highest = float(e.placed[e.kept[0] : e.kept[-1] + 1, 1].max())
    doubts_of_whole = []
    for at in np.flatnonzero(lengths > TOP_GAP):
        part = slice(seen[at], seen[at + 1] + 1)
        reach = float((e.placed[part, 1] + 2.0 * e.error[part]).max())
        if highest > 3.0 * ON_SURFACE and reach > highest:
            doubts_of_whole.append(f"{words.format(lengths[at] * 1e3)}, and its highest place may lie in it")
        elif lengths[at] > MAX_TRUSTED_GAP and not masked[at]:
            doubts_of_whole.append(words.format(lengths[at] * 1e3))
    if doubts_of_whole:
        yield Doubt("; ".join(doubts_of_whole), f"remove what hides the edge there, {OR_MASK}")


MOST_OVERHANG = 0.01
"""Share of the outline's points that may lie behind the one before."""


@register_check(OutlineEvidence)
def overhang(e: OutlineEvidence) -> Iterator[Doubt]:
    """Can heights over x represent the outline?"""
    x, z = e.placed[e.kept].T
    error = e.error[e.kept]
    step = np.diff(x)
    forward = step if np.median(step) > 0.0 else -step
    share = float(np.mean((forward < -2.0 * np.minimum(error[1:], error[:-1])) & (z[1:] > ON_SURFACE)))
    if not share <= MOST_OVERHANG:
        yield Doubt(f"{share:.0%} of the outline overhangs, which heights over x cannot represent")


@register_check(OutlineEvidence)
def grid(e: OutlineEvidence) -> Iterator[Doubt]:
    """Is there a grid that shows whether the camera has moved?"""
    if not e.traced.setup.grid_pitch:
        yield Doubt("without a grid in the setup, camera movements cannot be detected")


# ----------------------------------------------------------------------------------------------------------------------
# Of all outlines of a run.


@register_check(RunEvidence)
def copy(e: RunEvidence) -> Iterator[Doubt]:
    """Is its noise its own?"""
    if copied := e.run.copies.get(e.number):
        yield Doubt(copied, rejects=True)


LEAST_SUNK, LEAST_SHARE = 15e-6, 0.08
"""Distance in m from the common course, and as a share of the deepest sinking, that tells of a body that was moved."""
OFF_SHARE = 0.2
"""Share of its own sinking, or change of scale, by which an outline may lie off the common course."""


@register_check(RunEvidence)
def settling(e: RunEvidence) -> Iterator[Doubt]:
    """Does the surface beside the bulge sink as the other photographs show that the body does?"""
    common = e.run.sinking
    place = common.numbers.index(e.number)
    if not (common.known & (np.abs(common.values) > LEAST_SUNK)).any():
        return
    depth, raised = float(common.values[place]), bool(common.known[place])
    where = f"{_length(depth)} {'below' if depth > 0.0 else 'above'}" if depth else "on"
    lies = f"beside the bulge the surface lies {where} the zero plane"
    if common.course is None:
        few = "a soft body cannot be distinguished from one moved since the zero was taken"
        if depth > ON_SURFACE:
            yield Doubt(f"{lies}; with fewer than four photographs of the raised part, {few}")
        return
    if not raised:
        return
    start, off = float(common.course(0.0)), depth - float(common.course(common.heights[place]))
    least = max(LEAST_SUNK, LEAST_SHARE * float(np.abs(common.values).max()))
    if abs(start) > least:
        yield Doubt(
            f"{lies}; by the other photographs it would lie {_length(start)} {'below' if start > 0.0 else 'above'} the "
            "plane without any pressure: the part, the lamp or the camera has moved since the zero was taken")  # fmt: skip
    if abs(off) > max(least, OFF_SHARE * abs(depth)):
        yield Doubt(
            f"{lies}, {_length(off)} {'more' if off > 0.0 else 'less'} than expected from the other photographs: the part "
            "was moved for this one")  # fmt: skip


def _length(value: float) -> str:
    return f"{abs(value) * 1e3:.2f} mm" if abs(value) >= 95e-6 else f"{abs(value) * 1e6:.0f} um"


MAX_CROWN_CHANGE, MAX_CROWN_ERRORS = 0.06, 4.0
"""Change of the top's curvature, as a share of it, and in its own standard errors, that no smooth course of a run has."""


@register_check(RunEvidence)
def crown(e: RunEvidence) -> Iterator[Doubt]:
    """Is its top as round as those of the other photographs lead one to expect?"""
    odd = e.run.odd_crown
    if odd is not None and odd.number == e.number and abs(odd.off) > max(MAX_CROWN_CHANGE, MAX_CROWN_ERRORS * odd.error):
        more = "more" if odd.off > 0.0 else "less"
        yield Doubt(
            f"its top is {abs(odd.off):.0%} {more} curved than expected from the other photographs: something smooth (a drop, "
            "a blob of silicone or grease) lies on it", "wipe it off and photograph it again")  # fmt: skip


SCALE_BOUND = 10e-6
"""Error of the height in m that a change of scale may make unnoticed."""


@register_check(RunEvidence)
def scaling(e: RunEvidence) -> Iterator[Doubt]:
    """Do the body's sides lie as far apart as at zero pressure, or as the other photographs show that they give way?"""
    common = e.run.scaling
    place = common.numbers.index(e.number)
    heights, larger = common.heights, common.values
    if not common.known[place] or not (np.abs(larger * heights)[common.known] > SCALE_BOUND).any():
        return
    own, high = float(larger[place]), float(heights[place])
    lie = f"the body's sides lie {abs(own):.2%} {'farther apart' if own > 0.0 else 'nearer'} than at zero pressure"
    if common.course is None:
        if abs(own) * high > SCALE_BOUND:
            yield Doubt(f"{lie}: it was moved along the light, or its sides deform, or a second thing stands beside it")
        return
    start, off = float(common.course(0.0)), own - float(common.course(high))
    if abs(start) * float(heights.max()) > SCALE_BOUND and abs(start) > 0.1 * np.abs(larger[common.known]).max():
        yield Doubt(
            f"{lie}, and by the other photographs they would do so without any pressure: the body, the lamp or the screen "
            "was moved along the light since the zero was taken")  # fmt: skip
    if abs(off) * high > max(SCALE_BOUND, OFF_SHARE * abs(own) * high):
        yield Doubt(f"{lie}, unlike in the other photographs: the body was moved along the light for this one")


@register_check(CourseEvidence)
def course(e: CourseEvidence) -> Iterator[Doubt]:
    """Do its height and pressure agree with those of the other photographs?"""
    if why := e.run.contradictions.get(e.number):
        yield Doubt(why)


# ----------------------------------------------------------------------------------------------------------------------
# Devices seen from the side.


LONGEST_GAP = 0.12
"""Share of an outline that may be missing in one piece."""

SECOND_AREA = 0.1
"""Area of a second thing over the device's from which it may be a part of it."""

SOFT_SHARE = 0.08
"""Share of an outline with a soft edge from which a cast shadow belongs to it."""

MAX_BACKGROUND_SHIFT = 0.5
"""Movement of the background in px from which the camera has moved."""

MAX_BASE_SHIFT = 3.0
"""Movement of the base in px that its own corners explain."""

MAX_BASE_WIDENING = 0.06
"""Share by which the base may become wider or narrower than without pressure."""

MAX_SHRINKAGE, MAX_STRETCH = 0.015, 0.35
"""Shares of its length by which a centre line may become shorter or longer in its plane."""

END_STATIONS, MAX_END_WIDENING = slice(-15, -4), 0.05
"""Points of the centre line in front of a flat tip, and share by which a device that stays in its plane may become wider
there."""

MAX_BRIGHTER = 1.6
"""How many times brighter or darker the background may be than without pressure."""

MAX_SOFTER = 2.0
"""How many times as wide as without pressure the edge may be."""

MAX_WIDENING = 1.7
"""How many times wider or narrower a device may become anywhere along its centre line, on the mean over a seventh of it."""

MAX_LENGTH_ERROR = 0.01
"""Share by which a device without pressure may differ from its stated length."""


@register_check(SideEvidence)
def frame(e: SideEvidence) -> Iterator[Doubt]:
    """Does the frame cut the device?"""
    if e.silhouette.cut:
        yield Doubt(
            "the frame or the region of interest cuts the device",
            "move the camera back, give setup --roi a larger region, or one that begins nearer to its base",
            True,
        )


@register_check(SideEvidence)
def uncovered(e: SideEvidence) -> Iterator[Doubt]:
    """Does the device stay clear of the scale and of masks?"""
    if e.silhouette.hidden > 0.0:
        yield Doubt(
            f"the scale or a mask covers {e.silhouette.hidden:.0%} of the outline",
            "move the scale away from the device's path, or give the setup --scale and smaller masks", True,
        )  # fmt: skip


@register_check(SideEvidence)
def seen_whole(e: SideEvidence) -> Iterator[Doubt]:
    """Is the outline seen all around?"""
    if e.silhouette.longest_gap > LONGEST_GAP:
        yield Doubt(
            f"{e.silhouette.longest_gap:.0%} of the outline is not clear in one piece",
            "take away what hides it, or use a background that differs more from the device",
        )


@register_check(SideEvidence)
def alone(e: SideEvidence) -> Iterator[Doubt]:
    """Is there nothing else in front of the background?"""
    area, x, y = e.silhouette.second
    if area > SECOND_AREA:
        yield Doubt(
            f"a second thing in the picture, about the pixel {x:.0f},{y:.0f}, has {area:.0%} of the device's area",
            "take it away, cover it with setup --mask, or select the device with setup --roi",
        )


@register_check(SideEvidence)
def cast_shadow(e: SideEvidence) -> Iterator[Doubt]:
    """Is a cast shadow taken for a part of the device?"""
    if e.silhouette.soft > SOFT_SHARE:
        yield Doubt(
            f"{e.silhouette.soft:.0%} of the edge is much softer than the rest, as that of a shadow or of fast motion",
            "light the background evenly or from behind, and photograph the device at rest",
        )


@register_check(SideEvidence)
def sharp_as_before(e: SideEvidence) -> Iterator[Doubt]:
    """Is the edge as sharp as without pressure?"""
    if e.softer is not None and e.softer > MAX_SOFTER:
        yield Doubt(
            f"the edge is {e.softer:.1f} times as wide as without pressure: blurred by motion or compression, or out of focus",
            "fix the focus, expose for a shorter time, take it while the device is at rest, and store it less compressed",
        )


@register_check(SideEvidence)
def camera_at_rest(e: SideEvidence) -> Iterator[Doubt]:
    """Does the background stay where it is?"""
    if e.moved_px is not None and e.moved_px > MAX_BACKGROUND_SHIFT:
        yield Doubt(
            f"the background moved by {e.moved_px:.1f} px since the photograph without pressure",
            "fix the camera, and photograph all pressures again",
        )


@register_check(ViewEvidence)
def base_at_rest(e: ViewEvidence) -> Iterator[Doubt]:
    """Does the base stay where it is?"""
    if e.before is not None and not next(camera_at_rest(e), None):
        shift = float(np.linalg.norm(e.shape.base - e.before.base)) / e.pixel
        if shift > MAX_BASE_SHIFT:
            yield Doubt(
                f"the base moved by {shift:.1f} px since the photograph without pressure",
                "fix camera and clamp, or give --base where nothing moves",
            )
        elif e.silhouette_before is not None:
            now, before = (float(np.linalg.norm(np.diff(s.base, axis=0))) for s in (e.silhouette, e.silhouette_before))
            if abs(now - before) > max(MAX_BASE_SHIFT, MAX_BASE_WIDENING * before):
                yield Doubt(
                    f"the base is {abs(now / before - 1.0):.0%} {'wider' if now > before else 'narrower'} than without "
                    "pressure: the device turned in its clamp, or something hides its base",
                    "fix the device as it was, take away what hides its base, or give --base where nothing swells",
                )


@register_check(ViewEvidence)
def in_plane(e: ViewEvidence) -> Iterator[Doubt]:
    """Is the length one that the device can have in its plane of motion?"""
    if e.before is None or e.in_space:
        return
    share = e.shape.length / e.before.length - 1.0
    remedy = (
        "look at its outline in the picture, and guide it in its plane, or photograph it from two sides (--in-space, "
        "softmodels measure join)"
    )
    if share < -MAX_SHRINKAGE or share > MAX_STRETCH:
        word = "shorter" if share < 0.0 else "longer"
        yield Doubt(
            f"the centre line is {abs(share):.1%} {word} than without pressure, as if the device left its plane of motion",
            remedy,
        )
    wider = float(np.median(e.shape.width[END_STATIONS] / e.before.width[END_STATIONS])) - 1.0
    has_sides = e.has_sides and e.silhouette_before is not None and e.silhouette_before.corners is not None
    if has_sides and abs(wider) > MAX_END_WIDENING:
        yield Doubt(
            f"before its tip the device is {abs(wider):.0%} {'wider' if wider > 0.0 else 'narrower'} than without pressure, "
            "as if it left its plane of motion and showed a side",
            f"{remedy}, or write anyway in the column use if it swells so much",
        )  # fmt: skip


MAX_ANGLE_ERROR = np.radians(1.0)
"""Standard error of a tip's angle in rad from which its face is not seen clearly."""


@register_check(ViewEvidence)
def clear_tip(e: ViewEvidence) -> Iterator[Doubt]:
    """Is the tip seen clearly?"""
    if e.angle_error > MAX_ANGLE_ERROR:
        yield Doubt(
            f"the direction of its tip is known to {np.degrees(e.angle_error):.1f} degrees only: noise or compression "
            "hides it, something sticks out there, or it has neither two corners nor a rounding",
            "photograph it with more light, less compressed, and with nothing on its tip; or write anyway in the column use, "
            "which keeps these errors",
        )


@register_check(SideEvidence)
def steady_light(e: SideEvidence) -> Iterator[Doubt]:
    """Is the light, and the exposure, that of the photograph without pressure?"""
    if e.brighter is not None and not 1.0 / MAX_BRIGHTER < e.brighter < MAX_BRIGHTER:
        times, word = (e.brighter, "brighter") if e.brighter > 1.0 else (1.0 / e.brighter, "darker")
        yield Doubt(
            f"the background is {times:.1f} times {word} than in the photograph without pressure",
            "set exposure and white balance by hand, and keep the light as it is",
        )


@register_check(ViewEvidence)
def same_shape(e: ViewEvidence) -> Iterator[Doubt]:
    """Is it as wide along its centre line as without pressure?"""
    if e.before is None:
        return
    count = len(e.shape.width) // 7
    now, before = (np.convolve(shape.width, np.ones(count) / count, "valid") for shape in (e.shape, e.before))
    times = np.maximum(now / before, before / now)
    worst = int(np.argmax(times))
    if times[worst] > MAX_WIDENING:
        word = "wider" if now[worst] > before[worst] else "narrower"
        place = (worst + 0.5 * (count - 1)) / (len(e.shape.width) - 1) * e.shape.length
        yield Doubt(
            f"{place * 1e3:.0f} mm from its base the outline is {times[worst]:.1f} times {word} than without pressure, as if "
            "something else belonged to it",
            "take away what touches the device in the picture, or write anyway in the column use if it swells so much",
        )


@register_check(ViewEvidence)
def stated_length(e: ViewEvidence) -> Iterator[Doubt]:
    """Does the device have its stated length without pressure?"""
    if e.length is None or not e.is_zero:
        return
    length, error = e.length
    missed = e.shape.length - length
    if abs(missed) > MAX_LENGTH_ERROR * length + 2.0 * float(np.hypot(error, e.length_error)):
        yield Doubt(
            f"the device is {e.shape.length * 1e3:.2f} mm long in the picture, but {length * 1e3:.2f} mm by --length: "
            "the scale lies in another plane, or the base is another one",
            "give --ahead, the device's distance from the scale's plane, and check --base; --length LENGTH+-ERROR if the "
            "device was made longer or shorter",
        )


@register_check(SeriesEvidence)
def known_zero(e: SeriesEvidence) -> Iterator[Doubt]:
    """Is there a photograph without pressure that it can be compared with?"""
    if e.lost_zero:
        yield Doubt(
            "the photograph without pressure is not trusted, so scale, camera and base cannot be checked here",
            "correct what is said of that one",
        )


MAX_BACKWARDS, MAX_BACKWARDS_ERRORS, FEW_ODD = 0.03, 4.0, 0.25
"""Share of the whole motion, and standard errors, by which a device may move back while the pressure rises, and share of the
steps between photographs that are odd up to which only theirs are in doubt."""


@register_check(SeriesEvidence)
def in_order(e: SeriesEvidence) -> Iterator[Doubt]:
    """Does it move on where the pressure rises from one photograph to the next, and back where it falls?"""
    if e.is_timed or len(e.pressure) < 3:
        return
    middle = e.course - e.course.mean(axis=0)
    moved = np.diff(middle @ np.linalg.svd(middle, full_matrices=False)[2][0])
    error = np.hypot(e.error[1:], e.error[:-1])
    rise = np.diff(e.pressure) / np.maximum(np.hypot(e.pressure_error[1:], e.pressure_error[:-1]), 1e-9)
    reach = float(np.linalg.norm(np.ptp(middle, axis=0)))
    clear = (np.abs(moved) > np.maximum(MAX_BACKWARDS * reach, MAX_BACKWARDS_ERRORS * error)) & (np.abs(rise) > 3.0)
    sign = np.sign(moved * rise) * clear
    odd = sign == -np.sign(sign.sum() or 1.0)
    if not odd.any() or len(sign) < 2:
        return
    if odd.sum() > FEW_ODD * clear.sum() or odd[max(0, e.number - 1) : e.number + 1].any():
        yield Doubt(
            "the device moves back where the listed pressure rises, or on where it falls, as if pressures of the list were "
            "exchanged", "compare the list with the log of the pressures, or write anyway in the column use if it moves so",
        )  # fmt: skip


MAX_UNLIKE, MAX_UNLIKE_ERRORS = 30e-6, 4.0
"""Distance in m, and in standard errors, up to which one half of a round body's outline lies on the other's mirror image."""


@register_check(RevolvedEvidence)
def mirrored(e: RevolvedEvidence) -> Iterator[Doubt]:
    """Is it as round as a body of revolution?"""
    if e.unlike > max(MAX_UNLIKE, MAX_UNLIKE_ERRORS * e.error):
        yield Doubt(
            f"the left half of the outline lies {_length(e.unlike)} (rms) off the right one's mirror image, as of no body of "
            "revolution",
            "photograph it square to its axis, take away what touches it, and check --base; leave out --revolved for others",
        )
