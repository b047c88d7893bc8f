"""Every check of photographs: what each asks, what it may see (`Evidence`), and its answer (`Doubt`).

A wrong answer that is called good is the worst that can happen here. So whatever would make an edge mean something else than
the actuator's surface rejects the photograph, and what merely weakens it makes the outline untrusted. The classes below stand
in the order in which they are asked; what no check computes is in the modules that `Evidence` names. To add one: `Check`.
"""

from __future__ import annotations

import abc
import dataclasses
import functools
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from measurement.outline.edge import Traced, widest_patch
from measurement.outline.zero import (
    ON_SURFACE,
    UNCLEAR,
    Bow,
    Displacement,
    Mask,
    ZeroLine,
    highest_ripple,
    rounded,
    scale_of,
    sharpest_turn,
)
from measurement.pictures import Unmeasurable
from measurement.series.witness import Run
from softmodels.common.arrays import Array
from softmodels.common.names import Registry

LIST, EDGE, TONE, ZERO, OUTLINE, RUN, COURSE = "list", "edge", "tone", "zero", "outline", "run", "course"
"""When a check is asked: before anything is measured; of an edge; of one whose tone was compared with another; of the zero
plane; of an outline above it; of all outlines of a run; and of those that are trusted after that."""

FEWEST_POINTS = 40
"""Points that an edge or an outline needs."""

BELOW = 4.0
"""Standard errors that a point may lie below the surface and still be on it."""

READING = 0.1
"""Movement in px that the grid's lines can tell from none."""

OR_MASK = "or cover it with setup --mask"
"""Of a thing that hides a part of the edge."""

STATED = 4.5
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


@dataclasses.dataclass(frozen=True, eq=False)
class Evidence:
    """What checks may see; each number is computed when the first check asks for it.

    Attributes:
        traced: The photograph, its grid and its shadow's edge: from `EDGE` to `OUTLINE`.
        zero: The zero plane: `ZERO` and `OUTLINE`.
        run: The whole run: `LIST`, `RUN` and `COURSE`.
        number: The photograph's number in it.
    """

    traced: Traced = None  # type: ignore[assignment]
    zero: ZeroLine = None  # type: ignore[assignment]
    run: Run = None  # type: ignore[assignment]
    number: int = 0

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
            error = np.hypot(error, np.sqrt(max(0.0, moved**2 - (READING * traced.scale) ** 2)))
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
        assert self.displaced is not None  # `Moved` rejects what lies beside the surface
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
        return np.asarray(self.placed[:, 1] > -np.maximum(BELOW * self.placing_error, ON_SURFACE))

    @functools.cached_property
    def top(self) -> int:
        """Index of the highest of them."""
        return int(np.argmax(np.where(self.above, self.placed[:, 1], -np.inf)))

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


def unsure_of(ripple: tuple[int, float, float]) -> float:
    """Return the error in m that a ripple leaves that is too low for a doubt: a thing of that height may lie on any length of
    the outline."""
    _, height, scatter = ripple
    return abs(height) if abs(height) > STATED * scatter else 0.0


class Check(abc.ABC):
    """One question about a photograph: the first line of a subclass' docstring.

    A subclass under `register_check` is asked about every photograph, after those of its stage that are registered already.

    Attributes:
        stage: When it is asked, and so which `Evidence` there is.
    """

    stage: ClassVar[str]

    def __init_subclass__(cls, stage: str = OUTLINE) -> None:
        cls.stage = stage

    @abc.abstractmethod
    def doubt(self, e: Evidence) -> Doubt | None:
        """Return what speaks against the photograph; None if nothing does."""


CHECKS: Registry[type[Check]] = Registry("check", lambda check: check.__name__)
"""Every check by its name, in the order in which they are asked."""
register_check = CHECKS.register


def asked(stage: str) -> list[Check]:
    """Return the checks of a stage."""
    return [check() for check in CHECKS.values() if check.stage == stage]


def doubts(stage: str, evidence: Evidence) -> tuple[str, ...]:
    """Return what the checks of a stage have against a photograph, one sentence each.

    Raises:
        Unmeasurable: One of them rejects it, although it is not to be used anyway, or leaves nothing to measure.
    """
    found = []
    for check in asked(stage):
        if doubt := check.doubt(evidence):
            if doubt.lasting or (doubt.rejects and not evidence.traced.anyway):
                raise Unmeasurable(str(doubt))
            found.append(str(doubt))
    return tuple(found)


# ----------------------------------------------------------------------------------------------------------------------
# Before anything is measured.


@register_check
class Repeated(Check, stage=LIST):
    """Is it another file than all others of the list?"""

    def doubt(self, e: Evidence) -> Doubt | None:
        same = e.run.repeated.get(e.run.rows[e.number].file)
        return Doubt(same, rejects=True, lasting=True) if same else None


# ----------------------------------------------------------------------------------------------------------------------
# Of the photograph and its shadow's edge.


@register_check
class Exposure(Check, stage=EDGE):
    """Is it neither too dark nor saturated?"""

    def doubt(self, e: Evidence) -> Doubt | None:
        bright = float(np.percentile(e.traced.small.mean(axis=2), 90))
        if bright < 0.015:
            verdict = f"it is underexposed: the screen has {bright:.1%} of the camera's range"
            return Doubt(verdict, "increase the exposure", rejects=True)
        share = float((e.traced.small.min(axis=2) > 0.985).mean())
        if share > 0.2:
            verdict = f"it is overexposed: {share:.0%} of the picture is saturated, which would shift the edge"
            return Doubt(verdict, "reduce the exposure", rejects=True)
        return None


@register_check
class Movement(Check, stage=EDGE):
    """Is the grid where the setup has it?

    An affine movement of its lines is the camera's or the screen's, and what it leaves of their shifts is noise, dust, or
    another setup.
    """

    MOVED = (15e-6, 0.5)
    """Movement of the screen's picture since the setup from which it is rejected: the larger of these, in m and px."""
    REST = (60e-6, 1.5)
    """The same for the scatter of the grid's lines about where they should be."""
    SEEN, FEWEST = 0.4, 24
    """Least share of the grid's expected lines that must be visible, and least number of places where one was seen."""

    def doubt(self, e: Evidence) -> Doubt | None:
        look, pixel = e.traced.look, e.traced.scale
        if look is None:
            return None
        if look.seen < self.SEEN or len(look.shift) < self.FEWEST:
            return Doubt(
                f"the grid is not where the setup has it ({look.seen:.0%} of its lines are seen): the camera or the screen has "
                "moved, the picture is turned or mirrored, or the grid cannot be seen",
                "photograph the grid again and rerun setup", rejects=True)  # fmt: skip
        moved, rest = e.traced.movement
        if not np.isfinite(moved):
            return Doubt(
                "too few of the grid's lines are seen beside the shadow, along one of their two directions, to check whether "
                "the camera has moved", "show more of the grid, or use one with a smaller pitch", rejects=True)  # fmt: skip
        if not moved <= max(self.MOVED[0], self.MOVED[1] * pixel):
            return Doubt(
                f"the camera or the screen has moved by {moved * 1e6:.0f} um since the setup or during the exposure, or the "
                "picture is turned, mirrored, cropped or too noisy",
                "photograph the grid again from the current camera position and rerun setup", rejects=True)  # fmt: skip
        if not rest <= max(self.REST[0], self.REST[1] * pixel):
            return Doubt(
                f"the grid's lines are {rest * 1e6:.0f} um off: the picture is too noisy, too much compressed or too dusty to "
                "see them, the screen has bent, or this is another setup",
                "clean and flatten the screen, and photograph grid and body again", rejects=True)  # fmt: skip
        return None


@register_check
class Sharp(Check, stage=EDGE):
    """Is enough of the edge clear, and sharp enough for half of the light to be a place?"""

    WIDEST = 300e-6
    """Greatest standard deviation in m of penumbra and blur together."""

    def doubt(self, e: Evidence) -> Doubt | None:
        edge = e.traced.edge
        if len(edge.px) < FEWEST_POINTS:
            return Doubt(
                f"only {len(edge.px)} points of the edge are clear enough; at least {FEWEST_POINTS} are needed",
                "photograph it again with more light and contrast, and with no grid line along the surface",
                rejects=True, lasting=True)  # fmt: skip
        slope = e.traced.setup.jacobian(edge.px)
        width = edge.width * np.linalg.norm(slope @ edge.normal[..., None], axis=(1, 2))
        wide = float(np.percentile(width, 90))
        if wide <= self.WIDEST:
            return None
        return Doubt(
            f"the edge is blurred over {wide * 1e6:.0f} um (standard deviation), more than {self.WIDEST * 1e6:.0f} um",
            "focus on the screen, use a smaller lamp, or move the lamp away and the body closer to the screen",
            rejects=True)  # fmt: skip


@register_check
class Saturation(Check, stage=EDGE):
    """Is the screen beside the edge darker than white?"""

    BLANK, MOST = 0.985, 0.1
    """Light of a channel from which it is taken as saturated, and share of the edge that may lie beside such light."""

    def doubt(self, e: Evidence) -> Doubt | None:
        edge = e.traced.edge
        beside = e.traced.view.sample(edge.px + 3.0 * edge.width[:, None] * edge.normal)
        blank = float(np.mean((beside > self.BLANK).any(axis=1)))
        if blank <= self.MOST:
            return None
        verdict = f"it is overexposed: beside {blank:.0%} of the edge the screen is saturated, which shifts the edge"
        return Doubt(verdict, "reduce the exposure", rejects=True)


@register_check
class OneLamp(Check, stage=EDGE):
    """Does the light fall all the way from the screen's to the shadow's, alike along the edge?"""

    PART, MOST = 0.7, 0.05
    """Share of the shadow's depth by which light must fall over its edge, and share of the edge where it may fall less."""
    UNEVEN, PIECES, LEAST = 0.08, 12, 20
    """Change of the shadow's depth along its edge that one lamp does not make, over means of so many pieces of the edge, each
    of so many points at least."""

    def doubt(self, e: Evidence) -> Doubt | None:
        colour = e.traced.coarse.colour
        whole = 1.0 / float(colour.direction @ colour.lit)
        part = e.traced.edge.contrast / whole
        if np.median(part) < self.PART:
            return Doubt(
                f"the light falls in steps, by {np.median(part):.0%} of the shadow's depth at this edge: the shadow has "
                "several edges, from a second lamp, a reflection or a double exposure",
                "use only one lamp, cover reflecting surfaces, and photograph it again", rejects=True)  # fmt: skip
        count = max(self.LEAST, len(part) // self.PIECES)
        level = np.convolve(part, np.ones(count) / count, "valid")
        if len(part) >= 2 * count and np.ptp(level) > self.UNEVEN:
            return Doubt(
                f"the shadow's depth changes by {np.ptp(level):.0%} along its edge: a second lamp, a reflection or stray light "
                "reaches a part of it")  # fmt: skip
        share = float(np.mean(part < self.PART))
        if share > self.MOST:
            return Doubt(
                f"along {share:.0%} of the edge the light falls only part of the way: a second shadow or a reflection"
            )
        return None


@register_check
class Drop(Check, stage=EDGE):
    """Is the edge equally sharp along its length?"""

    LEAST, NOISES = 0.12, 8.0
    """Logarithm of the width over its smooth course, and the same in its own scatter, from which a patch is blurred."""

    def doubt(self, e: Evidence) -> Doubt | None:
        more, scatter = widest_patch(e.traced.edge, e.traced.scale)
        if more <= max(self.LEAST, self.NOISES * scatter):
            return None
        return Doubt(
            f"a part of the edge is {np.expm1(more):.0%} more blurred than the rest: a drop or grease on the lens, which "
            "also shifts the edge, or a second object casts the shadow there")  # fmt: skip


@register_check
class Thread(Check, stage=EDGE):
    """Is the shadow free of thin things?"""

    def doubt(self, e: Evidence) -> Doubt | None:
        if not e.traced.touched:
            return None
        return Doubt("a thin dark thing (hair, thread, tube, a speck) touches the shadow", f"take it away, {OR_MASK}")


@register_check
class Noise(Check, stage=EDGE):
    """Is each point of the edge known, and well enough?"""

    MOST = 50e-6
    """Greatest median standard error in m of the points of an edge."""

    def doubt(self, e: Evidence) -> Doubt | None:
        traced = e.traced
        if not np.isfinite(traced.points).all():
            return Doubt(
                "the shadow lies where the lens correction is not defined",
                "calibrate with boards up to the picture's corners, or aim the camera at the shadow",
                rejects=True, lasting=True)  # fmt: skip
        errors = traced.setup.error(traced.line.px, traced.line.error, traced.normals)
        typical = float(np.median(errors[~traced.line.bridged]))
        if typical <= self.MOST:
            return None
        return Doubt(
            f"the edge is too noisy: its points have a standard error of {typical * 1e6:.0f} um",
            "photograph it again with more light, a lower sensitivity (ISO) or less compression", rejects=True)  # fmt: skip


@register_check
class Flat(Check, stage=EDGE):
    """Is the screen flat beside the edge?"""

    OFF, NOISES = 25e-6, 8.0
    """Distance of a piece of line from where it should be, in m and in standard errors, from which the outline beside it is
    not trusted."""

    def doubt(self, e: Evidence) -> Doubt | None:
        flat = e.traced.flatness
        off = flat.off * (flat.off >= np.maximum(self.OFF, self.NOISES * flat.noise))
        if not off.any():
            return None
        worst = int(np.argmax(off))
        return Doubt(
            f"{flat.away[worst] * 1e3:.1f} mm beside the edge the printed grid is {off[worst] * 1e6:.0f} um off: the screen "
            "bulges or slides there, hot air or a drop on the lens bends the light, or the lens' correction is wrong"
        )


@register_check
class Tone(Check, stage=TONE):
    """Does the edge's shape show how the file stores light, or would another tone do no harm?"""

    def doubt(self, e: Evidence) -> Doubt | None:
        if not e.traced.tone_error:
            return None
        return Doubt(
            "the shape of the penumbra does not show how the file stores light; edges may be "
            f"{e.traced.tone_error * 1e6:.0f} um off",
            "give --tone srgb for a camera's JPEG, --tone linear for numbers in proportion to the light")  # fmt: skip


# ----------------------------------------------------------------------------------------------------------------------
# Of the zero plane.


@register_check
class Level(Check, stage=ZERO):
    """Does the light run along the undeformed surface?"""

    BOWED = 20e-6
    """Bow in m of the surface from which the lamp or the body is not level."""

    def doubt(self, e: Evidence) -> Doubt | None:
        bow = e.bow
        if bow is None or bow.rise <= max(self.BOWED, 4.0 * bow.error):
            return None
        if np.isnan(bow.rise):
            return Doubt(
                "the surface reaches beyond what seem to be the body's sides, so that its level cannot be checked"
            )
        bows = f"the undeformed surface bows up by {bow.rise * 1e6:.0f} um towards its middle, as the rim of a round body does"
        if e.traced.lift:
            return Doubt(
                f"{bows} if the lamp is large: its penumbra widens with the body's depth",
                "use a smaller lamp or move it away, at the height of the surface, and repeat all photographs")  # fmt: skip
        return Doubt(
            f"{bows} if the lamp or the body is at least {np.degrees(bow.rise / bow.radius):.1f} degrees off level: heights "
            "are too small by at least that much",
            "move the lamp to the height of the surface, level the body and repeat all photographs",
        )  # fmt: skip


# ----------------------------------------------------------------------------------------------------------------------
# Of an outline above the zero plane.


@register_check
class Rim(Check, stage=OUTLINE):
    """Is there light all round the bulge?"""

    HEIGHT = 150e-6
    """Height in m up to which the shadow may meet the frame: a flat surface runs out of the picture, an actuator must not."""

    def doubt(self, e: Evidence) -> Doubt | None:
        rim = e.traced.rim
        if not len(rim):
            return None
        height = e.zero.place(rim)[:, 1].max()
        # The rim is known to a pixel of the small version only.
        coarse = float(np.median(np.linalg.norm(np.diff(rim, axis=0), axis=1))) if len(rim) > 1 else 0.0
        if height <= self.HEIGHT + 2.0 * coarse:
            return None
        return Doubt(
            f"the shadow touches the frame or the region of interest {height * 1e3:.1f} mm above the surface",
            "widen setup --roi, or aim the camera so that light is seen all round the bulge", rejects=True)  # fmt: skip


@register_check
class Top(Check, stage=OUTLINE):
    """Is its highest place that of a surface seen from the side?"""

    def doubt(self, e: Evidence) -> Doubt | None:
        placed, above = e.placed, np.flatnonzero(e.above)
        if len(above) < FEWEST_POINTS:
            return None  # `Moved` says so
        if e.standing and e.upwards[max(0, e.top - 3) : e.top + 4].mean() < 0.5:
            return Doubt(
                "the shadow's highest point is not a rounded top: it hangs from above, or an object is in the light",
                "remove it, turn the picture upright before setup and photos, or exclude it with setup --roi",
                rejects=True)  # fmt: skip
        if e.standing and min(e.top - above[0], above[-1] - e.top) < 5:
            return Doubt(
                "the outline ends at its highest point: part of it is hidden or outside of the picture",
                "aim the camera at all of it, and clear away what hides it", rejects=True)  # fmt: skip
        if placed[above, 1].max() - placed[above, 1].min() > 2.0 * np.ptp(placed[above, 0]):
            return Doubt(
                "the shadow stands more than twice as high as it is wide, so it is not an inflated surface",
                "exclude other shadows with setup --roi", rejects=True)  # fmt: skip
        return None


@register_check
class Moved(Check, stage=OUTLINE):
    """Is the body where it was at zero pressure?"""

    MOST = 200e-6
    """Distance in m of the surface beside the bulge from the zero plane from which nothing is measured."""

    def doubt(self, e: Evidence) -> Doubt | None:
        if e.above.sum() < FEWEST_POINTS:
            return Doubt(
                "the shadow is below the surface at zero pressure: the actuator has moved, or the zero is wrong",
                "photograph it at zero pressure again and list that, or correct setup --zero",
                rejects=True, lasting=True)  # fmt: skip
        if not e.standing and np.median(e.upwards[e.above]) < 0.5:
            return Doubt(
                "the edge on the surface's line is not level: the actuator has moved or is not in the picture",
                "photograph it at zero pressure again and list that, or correct setup --zero",
                rejects=True)  # fmt: skip
        seen = e.displaced
        if seen is None:
            return Doubt(
                "the shadow is beside the surface at zero pressure: the actuator has moved, or the zero is wrong",
                "photograph it at zero pressure again and list that, or correct setup --zero",
                rejects=True, lasting=True)  # fmt: skip
        off = abs(seen.off)
        if seen.seen and off > max(ON_SURFACE, seen.tolerance):
            return Doubt(
                f"beside the bulge the surface lies {off * 1e3:.2f} mm {'above' if seen.off > 0.0 else 'below'} the zero "
                "plane: the actuator, the lamp or the camera has moved since the zero was taken",
                "photograph it at zero pressure again, or correct setup --zero",
                rejects=off > max(self.MOST, seen.tolerance))  # fmt: skip
        if not seen.seen and seen.aslant > ON_SURFACE:
            return Doubt(
                f"one end of the surface lies {2e3 * seen.aslant:.2f} mm lower than the other: the actuator, the lamp or the "
                "camera was tilted since the zero was taken", "photograph it at zero pressure again")  # fmt: skip
        return None


@register_check
class Membrane(Check):
    """Is the outline that of one membrane, and no second thing (hair, tube, drop, fibre, dust) on it or before it?

    Such a thing may show as a corner, as a bump, and by a small width: what it shows first is said.
    """

    CREASE, CORNER = 8.0, 25.0
    """Turn in degrees, beyond that of the neighbouring edge, which no membrane makes by itself, and which is another thing."""
    RIPPLE, NOISES = 15e-6, 8.0
    """Distance in m of the edge from its neighbourhood, and the same in its own scatter, from which it is no membrane's."""
    NARROWEST = 0.08
    """Least width at half height of what stands on the surface, as a share of the surface that is visible."""

    def doubt(self, e: Evidence) -> Doubt | None:
        place, turn = sharpest_turn(e.raw)
        high = f"{turn:.0f} degrees {e.raw[place, 1] * 1e3:.1f} mm above the surface"
        if turn > self.CORNER:
            return Doubt(
                f"the edge has a corner of {high}: a second thing (hair, tube, drop, finger) merges with the shadow, or hides "
                "part of it", f"take it away and photograph it again, {OR_MASK}", rejects=True)  # fmt: skip
        at, bump, scatter = e.ripple
        if abs(bump) > max(self.RIPPLE, self.NOISES * scatter):
            return Doubt(
                f"{e.raw[at, 1] * 1e3:.1f} mm above the surface the outline has a {'bump' if bump > 0.0 else 'hollow'} of "
                f"{abs(bump) * 1e6:.0f} um that is narrower than a membrane can bend: a fibre, a grain or a drop on it or "
                "on the lens, or the screen is not flat", f"take it away, {OR_MASK}")  # fmt: skip
        if turn > self.CREASE:
            return Doubt(
                f"the edge bends sharply by {high}: something lies on it or hides part of it, or it is creased",
                f"take it away, {OR_MASK}",
            )
        x, z = e.placed.T
        top = int(np.argmax(z))
        if z[top] < max(10.0 * e.error[top], ON_SURFACE):
            return None
        width = float(np.ptp(x[z > 0.5 * z[top]]))
        if width >= self.NARROWEST * min(e.zero.extent[1] - e.zero.extent[0], float(np.ptp(x))):
            return None
        return Doubt(
            f"the object on the surface is only {width * 1e3:.1f} mm wide at half its height: dust, a drop or another object"
        )


@register_check
class ClearTop(Check, stage=OUTLINE):
    """Is the edge as clear at its highest place as elsewhere?"""

    BLURRED = 5.0
    """Standard error of the highest place over the outline's usual one from which something must be wrong there."""

    def doubt(self, e: Evidence) -> Doubt | None:
        error = e.error[e.above]
        own, usual = float(error[np.argmax(e.placed[e.above, 1])]), float(np.median(error))
        if own < max(self.BLURRED * usual, UNCLEAR):
            return None
        return Doubt(
            f"the edge is unclear at its highest place: {own * 1e6:.0f} um there, {usual * 1e6:.0f} um elsewhere"
        )


@register_check
class ZeroPlane(Check, stage=OUTLINE):
    """Is the zero plane's photograph free of doubt, and stored as this one?"""

    def doubt(self, e: Evidence) -> Doubt | None:
        found = [f"of the zero plane's photograph: {doubt}" for doubt in e.zero.doubts]
        if e.zero.tone and e.zero.tone != e.traced.tone:
            found.append(
                f"it seems to store light as {e.traced.tone} but the zero plane's photograph as {e.zero.tone}; "
                "choose one with --tone"
            )
        return Doubt("; ".join(found)) if found else None


@register_check
class Dent(Check, stage=OUTLINE):
    """Does the surface nowhere lie below the undeformed one between places where it does not?

    One that has sunk as a whole, or beside the bulge, is no dent.
    """

    LONGEST = 1e-3
    """Length in m from which it is one."""

    def doubt(self, e: Evidence) -> Doubt | None:
        if len(e.kept) < FEWEST_POINTS or e.displaced is None:
            return None  # `Whole` says so
        inner = slice(e.kept[0], e.kept[-1] + 1)
        sunken = ~(e.above | e.traced.line.bridged) & (e.placed[:, 1] < -ON_SURFACE - 2.0 * max(e.displaced.sunk, 0.0))
        ends = np.flatnonzero(np.diff(np.r_[False, sunken[inner], False].astype(int)))
        for part in e.kept[0] + ends.reshape(-1, 2):
            x, z = e.placed[slice(*part)].T
            if np.ptp(x) > self.LONGEST:
                return Doubt(
                    f"over {np.ptp(x) * 1e3:.1f} mm the surface lies up to {-z.min() * 1e3:.2f} mm below the undeformed one: "
                    "it is dented or drawn in; only parts above that surface are measured",
                    "raise the pressure, or photograph the zero again with the body in its present state",
                    rejects=True)  # fmt: skip
        return None


@register_check
class Whole(Check, stage=OUTLINE):
    """Was all of the outline measured?"""

    GAP, LARGEST = 1e-3, 4e-3
    """Missing length of edge in m that makes an outline untrusted, and that makes it none."""
    TOP = 0.5e-3
    """Missing length in m that makes it untrusted where its highest place may lie in it."""

    def doubt(self, e: Evidence) -> Doubt | None:
        if len(e.kept) < FEWEST_POINTS:
            return Doubt(
                "too little of the surface between the body's sides is visible",
                "move the camera closer, or photograph it again with all of its surface in the light",
                rejects=True, lasting=True)  # fmt: skip
        seen, lengths, masked = e.gaps
        words = "the outline has a gap of {:.1f} mm where no edge is clear"
        longest = 1e3 * lengths[~masked].max(initial=0.0)
        if longest > 1e3 * self.LARGEST:
            # What else speaks against the edge may tell why a part of it is missing.
            verdict = "; ".join([words.format(longest), *e.traced.doubts])
            return Doubt(verdict, f"remove what hides it and photograph it again, {OR_MASK}", rejects=True)
        highest = float(e.placed[e.kept[0] : e.kept[-1] + 1, 1].max())
        found = []
        for at in np.flatnonzero(lengths > self.TOP):
            part = slice(seen[at], seen[at + 1] + 1)
            reach = float((e.placed[part, 1] + 2.0 * e.error[part]).max())
            if highest > 3.0 * ON_SURFACE and reach > highest:
                found.append(f"{words.format(lengths[at] * 1e3)}, and its highest place may lie in it")
            elif lengths[at] > self.GAP and not masked[at]:
                found.append(words.format(lengths[at] * 1e3))
        return Doubt("; ".join(found), f"remove what hides the edge there, {OR_MASK}") if found else None


@register_check
class Overhang(Check, stage=OUTLINE):
    """Can heights over x represent the outline?"""

    MOST = 0.01
    """Share of the outline's points that may lie behind the one before."""

    def doubt(self, e: Evidence) -> Doubt | None:
        x, z = e.placed[e.kept].T
        error = e.error[e.kept]
        step = np.diff(x)
        forward = step if np.median(step) > 0.0 else -step
        share = float(np.mean((forward < -2.0 * np.minimum(error[1:], error[:-1])) & (z[1:] > ON_SURFACE)))
        if share <= self.MOST:
            return None
        return Doubt(f"{share:.0%} of the outline overhangs, which heights over x cannot represent")


@register_check
class Grid(Check, stage=OUTLINE):
    """Is there a grid that shows whether the camera has moved?"""

    def doubt(self, e: Evidence) -> Doubt | None:
        if e.traced.setup.grid_pitch:
            return None
        return Doubt("without a grid in the setup, camera movements cannot be detected")


# ----------------------------------------------------------------------------------------------------------------------
# Of all outlines of a run.


@register_check
class Copy(Check, stage=RUN):
    """Is its noise its own?"""

    def doubt(self, e: Evidence) -> Doubt | None:
        copied = e.run.copies.get(e.number)
        return Doubt(copied, rejects=True) if copied else None


@register_check
class Settling(Check, stage=RUN):
    """Does the surface beside the bulge sink as the other photographs show that the body does?"""

    LEAST, LEAST_SHARE = 15e-6, 0.05
    """Distance in m from the common course, and as a share of the deepest sinking, that tells of a body that was moved."""
    SHARE = 0.2
    """Share of its own sinking by which an outline may lie off the common course."""

    def doubt(self, e: Evidence) -> Doubt | None:
        common = e.run.sinking
        place = common.numbers.index(e.number)
        if not (common.known & (np.abs(common.values) > self.LEAST)).any():
            return None
        depth, raised = float(common.values[place]), bool(common.known[place])
        where = f"{_length(depth)} {'below' if depth > 0.0 else 'above'}" if depth else "on"
        lies = f"beside the bulge the surface lies {where} the zero plane"
        if common.course is None:
            few = "a soft body cannot be distinguished from one moved since the zero was taken"
            return (
                Doubt(f"{lies}; with fewer than four photographs of the raised part, {few}")
                if depth > ON_SURFACE
                else None
            )
        if not raised:
            return None
        start, off = float(common.course(0.0)), depth - float(common.course(common.heights[place]))
        least = max(self.LEAST, Settling.LEAST_SHARE * float(np.abs(common.values).max()))
        if abs(start) > least:
            return Doubt(
                f"{lies}; by the other photographs it would lie {_length(start)} {'below' if start > 0.0 else 'above'} the "
                "plane without any pressure: the part, the lamp or the camera has moved since the zero was taken")  # fmt: skip
        if abs(off) > max(least, self.SHARE * abs(depth)):
            return Doubt(
                f"{lies}, {_length(off)} {'more' if off > 0.0 else 'less'} than expected from the other photographs: the part "
                "was moved for this one")  # fmt: skip
        return None


def _length(value: float) -> str:
    return f"{abs(value) * 1e3:.2f} mm" if abs(value) >= 95e-6 else f"{abs(value) * 1e6:.0f} um"


@register_check
class Scaling(Check, stage=RUN):
    """Do the body's sides lie as far apart as at zero pressure, or as the other photographs show that they give way?"""

    BOUND = 10e-6
    """Error of the height in m that a change of scale may make unnoticed."""
    SHARE = 0.2
    """Share of its own change of scale by which an outline may lie off the common course."""

    def doubt(self, e: Evidence) -> Doubt | None:
        common = e.run.scaling
        place = common.numbers.index(e.number)
        heights, larger = common.heights, common.values
        if not common.known[place] or not (np.abs(larger * heights)[common.known] > self.BOUND).any():
            return None
        own, high = float(larger[place]), float(heights[place])
        lie = f"the body's sides lie {abs(own):.2%} {'farther apart' if own > 0.0 else 'nearer'} than at zero pressure"
        if common.course is None:
            moved = abs(own) * high > self.BOUND
            return Doubt(f"{lie}: it was moved along the light, or its sides deform") if moved else None
        start, off = float(common.course(0.0)), own - float(common.course(high))
        if abs(start) * float(heights.max()) > self.BOUND and abs(start) > 0.1 * np.abs(larger[common.known]).max():
            return Doubt(
                f"{lie}, and by the other photographs they would do so without any pressure: the body, the lamp or the screen "
                "was moved along the light since the zero was taken")  # fmt: skip
        if abs(off) * high > max(self.BOUND, self.SHARE * abs(own) * high):
            return Doubt(f"{lie}, unlike in the other photographs: the body was moved along the light for this one")
        return None


@register_check
class Course(Check, stage=COURSE):
    """Do its height and pressure agree with those of the other photographs?"""

    def doubt(self, e: Evidence) -> Doubt | None:
        why = e.run.contradictions.get(e.number)
        return Doubt(why) if why else None
