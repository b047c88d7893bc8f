"""Cross-check the photographs of a run: heights against pressures over the whole series.

What is wrong with a photograph cannot always be seen in it: a copy listed at another pressure, a pressure misread by a factor
of ten, two rows swapped, an actuator that was not let down for a second photograph at zero. It stands out from the others.
The list's order is the experiment's: a photograph that follows a higher one at a higher pressure may have been taken while
the pressure was let down, and lies then between the course upwards and `MAX_LAG_SHARE` below it.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares
from scipy.special import ndtr

from measurement import pictures
from measurement.outline import edge, zero
from measurement.outline.outline import Outline, reached
from measurement.series import photo_list
from measurement.series.photo_list import Photograph, copies
from softmodels.common.arrays import Array, Mask


@dataclasses.dataclass(frozen=True, eq=False)
class Run:
    """The photographs of a run in the list's order, and what each shows of the others. Outlines above one zero plane and
    patches of the pictures, as far as there are any, are by their numbers in the list; heights in m and pressures in Pa,
    with errors, have the shape (n,) of the outlines."""

    outlines: Mapping[int, Outline] = MappingProxyType({})
    samples: Mapping[int, pictures.Pixels] = MappingProxyType({})
    rows: Sequence[Photograph] = ()

    heights = functools.cached_property[Array](lambda run: run._each("height"))
    height_errors = functools.cached_property[Array](lambda run: run._each("height_error"))
    pressures = functools.cached_property[Array](lambda run: run._each("pressure"))
    pressure_errors = functools.cached_property[Array](lambda run: run._each("pressure_error"))

    def __getitem__(self, chosen: Mask) -> Run:
        return Run({k: outline for (k, outline), take in zip(self.outlines.items(), chosen, strict=True) if take})

    def _each(self, name: str) -> Array:
        return np.array([getattr(outline, name) for outline in self.outlines.values()], dtype=float)

    @property
    def trusted(self) -> Run:
        """The trusted outlines."""
        return self[np.array([outline.trusted for outline in self.outlines.values()], dtype=bool)]

    @property
    def is_zero(self) -> Mask:
        """Photographs whose pressure does not differ from zero by `photo_list.Photograph.is_zero`."""
        return np.abs(self.pressures) <= 2.0 * self.pressure_errors

    @property
    def later_in_hold(self) -> Mask:
        """Photographs that are not the first of their hold: the silicone has crept since, at the same pressure."""
        began = [outline.history[: reached(outline.history) + 1] for outline in self.outlines.values()]
        return np.array([bool(photograph) and photograph in began[:k] for k, photograph in enumerate(began)], dtype=bool)

    @property
    def course(self) -> Course:
        """The course through these photographs and, if none is at zero, the zero plane."""
        parts = [self.heights, self.pressures, self.height_errors, self.pressure_errors]
        if not self.is_zero.any():
            least = float(self.pressure_errors.min())
            parts = [np.append(part, value) for part, value in zip(parts, (0.0, 0.0, 0.0, least), strict=True)]
        return Course.through(*parts)

    @functools.cached_property
    def contradictions(self) -> dict[int, str]:
        """Trusted outlines that the others contradict, and by what; the others are no witnesses."""
        run = self.trusted
        if not run.outlines:
            return {}
        told = {**_risen_zeros(run), **_suction_photographs(run)}
        good = ~np.isin(np.arange(len(run.outlines)), list(told)) & ~run.later_in_hold
        odd = _contradicted(run[good])
        told.update({int(k): odd[place] for place, k in enumerate(np.flatnonzero(good)) if place in odd})
        return {number: told[k] for k, number in enumerate(run.outlines) if k in told}

    @functools.cached_property
    def sinking(self) -> Common:
        """How far the surface beside the bulge has sunk in m."""
        return self._common(self._each("sunk"), 0.2 * zero.ON_SURFACE)

    @functools.cached_property
    def scaling(self) -> Common:
        """By which share the body's sides lie farther apart than at zero pressure."""
        return self._common(self._each("scale") - 1.0, 1e-4)

    @functools.cached_property
    def odd_crown(self) -> OddCrown | None:
        """The outline whose top is curved least like those of the others; None where these are too few to tell."""
        raised = {
            k: o for k, o in self.outlines.items() if o.height > MIN_HEIGHT_RATIO * zero.ON_SURFACE and len(o.measured().x)
        }
        crowns = {k: crown for k, o in raised.items() if (crown := crown_of(o.measured())) is not None}
        return OddCrown.of(np.array([self.outlines[k].height for k in crowns]), crowns)

    def _common(self, values: Array, usual: float) -> Common:
        known = (self.heights > MIN_HEIGHT_RATIO * zero.ON_SURFACE) & np.isfinite(values)
        return Common(list(self.outlines), self.heights, values, known, usual)

    @property
    def unknown(self) -> dict[int, float]:
        """How far in m outlines may lie off because too few photographs tell a soft body from one that was moved."""
        if self.sinking.course is not None:
            return {}
        raised = self[self.sinking.known].outlines
        # What lies above the zero plane is off by its own error already.
        return {k: outline.sunk for k, outline in raised.items() if outline.sunk > 0.0}

    @functools.cached_property
    def copies(self) -> dict[int, str]:
        """Photographs that are copies of others, and why they must not be used."""
        return copies(self.outlines, self.samples)

    @functools.cached_property
    def repeated(self) -> dict[Path, str]:
        """Files with the same bytes as another one of the list, and why they must not be measured."""
        return photo_list.same_pictures(self.rows)


def course_of(outlines: list[Outline]) -> Course | None:
    """Return the course through the trusted outlines of a run; None where they are too few or do not rise."""
    run = Run(dict(enumerate(outlines))).trusted
    return run.course if _course_is_known(run) else None


def _course_is_known(run: Run) -> bool:
    return len(run.outlines) >= MIN_PHOTOGRAPHS and float(run.heights.max()) > max(
        10.0 * float(np.median(run.height_errors)), zero.ON_SURFACE
    )


def _suction_photographs(run: Run) -> dict[int, str]:
    """Return the photographs at a pressure below zero: suction draws a surface in, where its shadow cannot show it."""
    suction_photographs = {}
    for k in np.nonzero(run.pressures < -CLEAR_ERRORS * run.pressure_errors)[0]:
        risen = run.heights[k] > CLEAR_ERRORS * run.height_errors[k] + zero.ON_SURFACE
        why = (
            f"and its outline rises by {run.heights[k] * 1e3:.2f} mm: the sign is wrong, or the two tubes are swapped"
            if risen
            else "and suction draws the surface in, which a shadow from the side cannot show"
        )
        suction_photographs[int(k)] = f"its pressure is negative ({run.pressures[k]:.0f} Pa), {why}"
    return suction_photographs


def _risen_zeros(run: Run) -> dict[int, str]:
    """Return the photographs at zero pressure whose outline does not lie in the zero plane."""
    raised = (run.pressures > 0.0) & ~run.is_zero
    # The lowest pressures tell best how far the reading's error may lift a surface at zero.
    lowest = np.nonzero(raised)[0][np.argsort(run.pressures[raised])][:3]
    slope = float(np.median(run.heights[lowest] / run.pressures[lowest])) if len(lowest) else 0.0
    pressure = np.abs(run.pressures) + CLEAR_ERRORS * run.pressure_errors
    allowed = zero.ON_SURFACE + CLEAR_ERRORS * run.height_errors + max(slope, 0.0) * pressure
    return {
        int(
            k
        ): f"at zero pressure its outline rises {run.heights[k] * 1e3:.2f} mm above the zero plane: it was taken at another "
        "pressure, the actuator was not let down or has kept a set, or was moved"
        for k in np.nonzero(run.is_zero & (run.heights > allowed))[0]
    }


def _contradicted(run: Run) -> dict[int, str]:
    """Return the photographs that the others contradict, each with what the others lead one to expect."""
    if not _course_is_known(run):
        return {}
    later = _let_down(run)
    together = _outliers(run)
    odd = together
    if later.any() and (~later).sum() >= MIN_PHOTOGRAPHS:
        first = np.nonzero(~later)[0]
        odd = np.zeros(len(later), dtype=bool)
        odd[first[_outliers(run[~later])]] = True
        odd |= later & together & ~_lagging(run, run[~later & ~odd].course)
    return _odd_sentences(run, odd)


def _let_down(run: Run) -> Mask:
    """Return the photographs that follow a higher one at a higher pressure; none where the list's order is not the
    experiment's."""
    steps = np.sign(np.diff(run.pressures))
    steps = steps[steps != 0.0]
    if np.sum(steps[1:] != steps[:-1]) > MAX_REVERSALS:
        return np.zeros(len(run.outlines), dtype=bool)
    earlier = np.tri(len(run.outlines), k=-1, dtype=bool)
    above = run.pressures[None, :] - run.pressures[:, None] > CLEAR_ERRORS * run.pressure_errors[:, None]
    higher = run.heights[None, :] - run.heights[:, None] > CLEAR_ERRORS * run.height_errors[:, None]
    return np.any(earlier & above & higher, axis=1)


def _lagging(run: Run, course: Course) -> Mask:
    """Return whether each may have been taken while the pressure was let down, by the course upwards."""
    upwards, spread, _ = course.at(run.heights, run.pressure_errors)
    return (run.pressures < upwards + CLEAR_ERRORS * spread) & (
        run.pressures > (1.0 - MAX_LAG_SHARE) * upwards - CLEAR_ERRORS * spread
    )


def _outliers(run: Run) -> Mask:
    """Return the photographs that the others contradict.

    Several wrong ones hide each other, so the least likely are put aside one after the other first, likely or not, and are
    taken back, the likeliest first, as long as the course through the others allows.
    """
    kept = np.ones(len(run.outlines), dtype=bool)
    judged = ~run.is_zero | (run.heights > zero.ON_SURFACE)
    for _ in range(max(1, len(kept) // WRONG_SHARE)):
        if kept.sum() < MIN_PHOTOGRAPHS:
            break
        part = run[kept]
        tails = part.course.left_out()[2][: len(part.outlines)]
        tails = np.where(judged[kept], tails, np.inf)
        if not np.isfinite(tails).any():
            break
        kept[np.nonzero(kept)[0][int(np.argmin(tails))]] = False
    while not kept.all():
        aside = np.nonzero(~kept)[0]
        tails = _tail_probabilities(run, run[kept].course, aside, run.pressures[aside])
        likeliest = int(np.argmax(tails))
        if tails[likeliest] < MIN_PROBABILITY:
            break
        kept[aside[likeliest]] = True
    return ~kept


def _tail_probabilities(run: Run, course: Course, numbers: npt.NDArray[np.int64], pressures: Array) -> Array:
    """Return the probabilities that good photographs of these heights are as far off as at these pressures (k,) in Pa."""
    errors = np.hypot(run.pressure_errors[numbers], course.slope(run.heights[numbers]) * run.height_errors[numbers])
    table = course.at(run.heights[numbers], errors)[2]
    return course.tail(table, pressures)


def _odd_sentences(run: Run, odd: Mask) -> dict[int, str]:
    """Return a sentence for each photograph that is odd."""
    if not odd.any():
        return {}
    course = run[~odd].course
    numbers = np.nonzero(odd)[0]
    odd_sentences = {}
    for k in numbers:
        pressure, height = float(run.pressures[k]), float(run.heights[k])
        expected, spread, _ = course.at(np.array([height]), run.pressure_errors[[k]])
        at = course.height(pressure, height)
        there = f"{expected[0]:.0f} +- {spread[0]:.0f} Pa at its height"
        why = (
            f"expected from the other photographs: {at[0] * 1e3:.2f} +- {at[1] * 1e3:.2f} mm at its pressure "
            f"instead of {height * 1e3:.2f} mm, and {there}"
            if at
            else f"its pressure is outside the range of the other photographs, from which the expectation is {there}"
        )
        odd_sentences[int(k)] = why + _cause(run, course, int(k), numbers)
    return odd_sentences


def _cause(run: Run, course: Course, k: int, odd: npt.NDArray[np.int64]) -> str:
    """Return what would explain an odd photograph; empty if nothing simple does."""
    here = np.array([k])
    for factor, word in ((10.0, "a tenth of what it was"), (0.1, "ten times what it was")):
        if _tail_probabilities(run, course, here, run.pressures[here] * factor)[0] > MIN_FITTING_PROBABILITY:
            return f": the pressure in the list may be {word}"
    for other in odd:
        if other == k:
            continue
        pair = np.array([k, other])
        if (_tail_probabilities(run, course, pair, run.pressures[pair[::-1]]) > MIN_FITTING_PROBABILITY).all():
            return f": its row and that of {list(run.outlines.values())[other].source} may be swapped"
    return ""


@dataclasses.dataclass(frozen=True)
class Refusal:
    """A photograph that was not measured.

    Attributes:
        reason: Why, as a sentence for the user.
        file: The photograph.
    """

    reason: str
    file: Path


@dataclasses.dataclass(frozen=True, eq=False)
class Result:
    """Result of one photograph.

    Attributes:
        photograph: Its row of the list.
        outcome: Its outline, or why there is none.
        name: Stem of its files in the output folder.
        sample: Patches of its picture, by which copies are found; None where it could not be read.
    """

    photograph: Photograph
    outcome: Outline | Refusal
    name: str
    sample: pictures.Pixels | None = None


# ----------------------------------------------------------------------------------------------------------------------
# The smooth course of pressure over height through a run's photographs, and what it expects of each from all the others.
#
# A bulge's pressure is one smooth function of its height even where it has a greatest value (a limit point), where a volume is
# driven and the pressure falls, and on both sides of a snap: its height is none of its pressure there. So the course is
# p(h), and a photograph is compared with what the others predict at its height.
#
# The course is a Gaussian process: a straight line and the integrals of white noise, twice (the cubic smoothing spline) or
# three times, whose size, and a scatter beyond the readings' errors (creep, a leak, friction), are not fitted but averaged
# over with the weight that the other photographs give them. C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine
# Learning (2006), sections 5.4.2 (leaving one out) and 6.3 (splines).


ROUGHNESS_GRID = np.geomspace(0.1, 40.0, 7)
"""Sizes of the white noise, for pressure and height in units of their greatest values."""

USUAL_ROUGHNESS, ROUGHNESS_DEVIATION = 2.0, 1.2
"""Prior of the roughness: most probable value, and its deviation in natural logarithms."""

SCATTER_GRID = np.array([0.0, 0.0025, 0.005, 0.01, 0.03])
"""Scatter of the pressures beyond their errors in units of the greatest one."""

SCATTER_PROBABILITY = np.array([0.3, 0.2, 0.2, 0.2, 0.1])
"""Prior probability of each scatter."""

LINE_DEVIATION = 10.0
"""Prior standard deviation of the line's height and slope, which are unknown."""

PARABOLA_DEVIATION, NOISE_LEAD = 3.0, 0.2
"""Prior standard deviation of the parabola's coefficient, and how far before the lowest point the noise starts."""

INTEGRATION_ORDERS = (2, 3)
"""Times that the white noise is integrated."""


@dataclasses.dataclass(frozen=True, eq=False)
class Course:
    """The course through points of heights in m and pressures in Pa, with the standard errors of the pressures, those of
    the heights taken along, shape (n,)."""

    heights: Array
    pressures: Array
    errors: Array

    @classmethod
    def through(cls, heights: Array, pressures: Array, height_errors: Array, pressure_errors: Array) -> Course:
        """Return the course through points with errors in both directions, shapes (n,), in m and Pa."""
        plain = cls(heights, pressures, np.hypot(pressure_errors, 1e-4 * np.abs(pressures).max()))
        slope = plain.slope(heights)
        return dataclasses.replace(plain, errors=np.hypot(plain.errors, slope * height_errors))

    @property
    def scale(self) -> tuple[float, float]:
        """Greatest height in m and pressure in Pa, in the course."""
        return max(float(np.ptp(self.heights)), 1e-9), max(float(np.abs(self.pressures).max()), 1e-9)

    def left_out(self) -> tuple[Array, Array, Array]:
        """Return what all the others expect of each point: pressure in Pa, its standard error (the course's, the scatter's
        and the reading's own), and the probability that a good point is as far off, shapes (n,)."""
        u, q, noise = self._scaled()
        root, evidence, _ = _models(u, q, noise)
        precision = np.einsum("mji,mji->mi", root, root)
        pull = np.einsum("mji,mj->mi", root, root @ q)
        mean, deviation = q - pull / precision, 1.0 / np.sqrt(precision)
        alone = -0.5 * ((q - mean) / deviation) ** 2 - np.log(deviation * np.sqrt(2.0 * np.pi))
        weight = _weights(evidence[:, None] - alone)
        expected = np.sum(weight * mean, axis=0)
        spread = np.sqrt(np.sum(weight * (deviation**2 + (mean - expected) ** 2), axis=0))
        tail = np.sum(weight * 2.0 * ndtr(-np.abs(q - mean) / deviation), axis=0)
        pressure = self.scale[1]
        return expected * pressure, spread * pressure, tail

    def at(self, heights: Array, errors: Array | float = 0.0) -> tuple[Array, Array, Array]:
        """Return the expected pressure of further points and its standard error in Pa, as `left_out` for theirs, shapes
        (k,), and the tails' table for `tail`; ``errors`` are their readings' in Pa."""
        u, q, noise = self._scaled()
        length, pressure = self.scale
        v = (np.asarray(heights) - self.heights.min()) / length
        root, evidence, scatter = _models(u, q, noise)
        weight = _weights(evidence)
        cross, own = _prior(v, u), _prior(v, v, diagonal=True)
        pulled = cross @ root.transpose(0, 2, 1)
        mean = np.einsum("mkn,mn->mk", pulled, root @ q)
        variance = own - np.einsum("mkn,mkn->mk", pulled, pulled) + scatter[:, None] ** 2
        variance = np.maximum(variance, 1e-12) + (np.asarray(errors) / pressure) ** 2
        expected = np.einsum("m,mk->k", weight, mean)
        spread = np.sqrt(np.einsum("m,mk->k", weight, variance + (mean - expected) ** 2))
        table = np.stack([np.broadcast_to(weight[:, None], mean.shape), mean, np.sqrt(variance)])
        return expected * pressure, spread * pressure, table

    def tail(self, table: Array, pressures: Array) -> Array:
        """Return the probability that a good point is as far off as these pressures (k,) in Pa, by the table of `at`."""
        weight, mean, deviation = table
        return np.asarray(np.sum(weight * 2.0 * ndtr(-np.abs(pressures / self.scale[1] - mean) / deviation), axis=0))

    def height(self, pressure: float, near: float) -> tuple[float, float] | None:
        """Return the height in m, the nearest to ``near``, at which the course has a pressure, and its standard error; None if
        nowhere."""
        low, high = float(self.heights.min()), float(self.heights.max())
        reach = np.linspace(low - 0.1 * (high - low), high + 0.1 * (high - low), 400)
        expected, spread, _ = self.at(reach)
        off = expected - pressure
        crossing = np.nonzero(off[1:] * off[:-1] <= 0.0)[0]
        if not len(crossing):
            return None
        k = min(crossing, key=lambda k: abs(reach[k] - near))
        slope = (expected[k + 1] - expected[k]) / (reach[k + 1] - reach[k])
        if slope == 0.0:
            return None
        return float(reach[k] - off[k] / slope), float(spread[k] / abs(slope))

    def _scaled(self) -> tuple[Array, Array, Array]:
        length, pressure = self.scale
        return (self.heights - self.heights.min()) / length, self.pressures / pressure, self.errors / pressure

    def slope(self, heights: Array) -> Array:
        """Return the slope of the course in Pa/m at heights (k,)."""
        step = 1e-3 * self.scale[0]
        above, below = self.at(heights + step)[0], self.at(heights - step)[0]
        return np.abs(above - below) / (2.0 * step)


def _models(u: Array, q: Array, noise: Array) -> tuple[Array, Array, Array]:
    """Return the inverse roots L^-1 of the covariances L L^T (m, n, n), logarithms of the evidence (m,), and scatters
    (m,). Roots, because the line's wide prior leaves inverses of the covariances themselves with few digits."""
    prior = _prior(u, u)
    scatter = np.tile(SCATTER_GRID, len(prior) // len(SCATTER_GRID))
    matrix = prior + (scatter[:, None] ** 2 + noise**2)[:, :, None] * np.eye(len(u))
    lower = np.linalg.cholesky(matrix)
    root = np.linalg.solve(lower, np.broadcast_to(np.eye(len(u)), matrix.shape))
    size = 2.0 * np.log(np.einsum("mii->mi", lower)).sum(axis=1)
    fit = np.sum((root @ q) ** 2, axis=1)
    before = [
        np.log(likely) - 0.5 * (np.log(rough / USUAL_ROUGHNESS) / ROUGHNESS_DEVIATION) ** 2
        for _ in INTEGRATION_ORDERS for rough in ROUGHNESS_GRID for likely in SCATTER_PROBABILITY
    ]  # fmt: skip
    return root, -0.5 * (fit + size) + np.array(before), scatter


def _prior(v: Array, u: Array, diagonal: bool = False) -> Array:
    """Return the covariances (m, k, n) of the course at v (k,) and u (n,), or its variances (m, k) at v; one per model."""
    product = v * v if diagonal else v[:, None] * u
    first, second = (v, v) if diagonal else (v[:, None], u[None, :])
    covariances = []
    for times in INTEGRATION_ORDERS:
        # Noise that is integrated three times leaves a parabola open, not only a line.
        known = LINE_DEVIATION**2 * (1.0 + product) + (PARABOLA_DEVIATION**2 * product**2 if times > 2 else 0.0)
        kernel = _integrated_covariance(first, second, times)
        covariances += [known + rough**2 * kernel for rough in ROUGHNESS_GRID for _ in SCATTER_GRID]
    return np.stack(covariances)


def _integrated_covariance(v: Array, u: Array, times: int) -> Array:
    """Return the covariance of white noise integrated two or three times from a place before all points."""
    v, u = np.maximum(v + NOISE_LEAD, 0.0), np.maximum(u + NOISE_LEAD, 0.0)
    least, apart = np.minimum(v, u), np.abs(v - u)
    if times == 2:
        return np.asarray(least**3 / 3.0 + apart * least**2 / 2.0)
    return np.asarray(least**5 / 20.0 + apart * least**4 / 8.0 + apart**2 * least**3 / 12.0)


def _weights(logarithms: Array) -> Array:
    weight = np.exp(logarithms - logarithms.max(axis=0))
    return np.asarray(weight / weight.sum(axis=0))


MIN_PHOTOGRAPHS = 4
"""Photographs, one at zero among them, from which there is a course to compare with."""

MIN_PROBABILITY = 1e-3
"""Probability that a good photograph is as far off, below which one is not trusted."""

MIN_FITTING_PROBABILITY = 0.01
"""The same from which another pressure explains a photograph."""

WRONG_SHARE = 4
"""At most every so manieth photograph is taken for wrong before the course is looked for through the others."""

MAX_LAG_SHARE = 0.5
"""Greatest share of the pressure by which a height is kept at less while a soft body is let down."""

MAX_REVERSALS = 4
"""Turns between rising and falling pressure beyond which the list's order is not that of the experiment."""

CLEAR_ERRORS = 3.0
"""Standard errors from which a difference is one."""


# ----------------------------------------------------------------------------------------------------------------------
# What changes smoothly with the height in a run whose body stands still: how far the surface beside the bulge sinks, and how
# far apart the body's sides lie.
#
# Under pressure a soft body draws in the rubber beside its bulge, and its sides may give way: both grow smoothly with the
# height and vanish with it, from one photograph of a run to the next. A body that was moved after the zero photograph lies off
# by the same amount at every height, and one that was moved for a single photograph lies off in that one. Moved along the
# light, its shadow is larger or smaller as a whole, and so is the distance of its sides.


MIN_RAISED_OUTLINES = 4
"""Raised outlines from which their common course can be told from a body that was moved."""

MIN_CURVED_OUTLINES = 6
"""Raised outlines from which the course may bend."""

MIN_HEIGHT_RATIO = 5.0
"""Heights below this many times `ON_SURFACE` tell nothing of the course."""


@dataclasses.dataclass(frozen=True, eq=False)
class Common:
    """A value of each outline of a run, shape (n,), and its common course over the heights in m. ``known`` are the raised
    outlines that have one, ``usual`` is how far a value may lie off the course before it counts less."""

    numbers: list[int]
    heights: Array
    values: Array
    known: Mask
    usual: float

    @functools.cached_property
    def course(self) -> np.polynomial.Polynomial | None:
        """The values over the height; None where too few outlines tell it."""
        if self.known.sum() < MIN_RAISED_OUTLINES:
            return None
        heights, values = self.heights[self.known], self.values[self.known]
        scale = float(heights.max())
        # A line, or a parabola where there are points enough, that none of them draws away.
        terms = np.vander(heights / scale, 3 if len(heights) >= MIN_CURVED_OUTLINES else 2, increasing=True)
        fit = least_squares(
            lambda c: (terms @ c - values) / self.usual, np.zeros(terms.shape[1]), loss="soft_l1",
            jac=lambda c: terms / self.usual,
        )  # fmt: skip
        return np.polynomial.Polynomial(fit.x / scale ** np.arange(terms.shape[1]))


# ----------------------------------------------------------------------------------------------------------------------
# The curvature of the top over the height.
#
# A drop or a blob on the top is as smooth as the membrane, and its edge as clear: one photograph does not show it. But a bulge
# keeps nearly its shape as it rises, so that its curvature at the top, times the square of its half width over its height, is a
# smooth function of the height, from which only the photograph with the blob departs.


CROWN_SHARE = 0.15
"""Share of the height below the top over which its curvature is measured."""

LEAST_SCATTER = 0.01
"""Least scatter of that curvature about its course, as a share of it."""


def crown_of(outline: Outline) -> tuple[float, float] | None:
    """Return the curvature at an outline's top times the square of its half width over its height, and its standard error; None
    where too few points are seen."""
    x, z, error = outline.x - outline.x[outline.apex], outline.z, outline.error
    top = z > (1.0 - CROWN_SHARE) * outline.height
    half = 0.5 * float(np.ptp(x[z > 0.5 * outline.height]))
    if len(np.unique(x[top])) < edge.SMOOTHING_POINTS:
        return None
    bend = -2.0 * float(np.polynomial.Polynomial.fit(x[top], z[top], 2).convert().coef[-1])
    # Neighbours err together over a span of points, and the parabola is as deep as the part of the height.
    own = float(np.median(error[top])) / np.sqrt(float(top.sum()) / edge.SMOOTHING_POINTS) / (CROWN_SHARE * outline.height)
    value = bend * half**2 / outline.height
    return value, 3.0 * own * abs(value)


@dataclasses.dataclass(frozen=True)
class OddCrown:
    """The outline of a run whose top departs most from the others' course: its number, and by which share, with its standard
    error, its curvature lies off it."""

    number: int
    off: float
    error: float

    @classmethod
    def of(cls, heights: Array, crowns: Mapping[int, tuple[float, float]]) -> OddCrown | None:
        """Return that of outlines of these heights (n,) in m and curvatures with errors; None where fewer than
        `MIN_RAISED_OUTLINES` others tell what it should be."""
        if len(crowns) < MIN_RAISED_OUTLINES + 1:
            return None
        values, errors = np.array(list(crowns.values())).T
        best: tuple[float, OddCrown] | None = None
        for place, number in enumerate(crowns):
            others = np.arange(len(values)) != place
            order = 3 if len(values) > MIN_CURVED_OUTLINES else 2
            terms = np.vander(heights / heights.max(), order, increasing=True)
            slopes = np.linalg.pinv(terms[others])
            rest = values[others] - terms[others] @ slopes @ values[others]
            scatter = float(np.sqrt(np.sum(rest**2) / max(1, len(rest) - order)))
            expected = float(terms[place] @ slopes @ values[others])
            scatter = max(scatter, LEAST_SCATTER * abs(expected), float(np.median(errors)))
            reach = float(np.linalg.norm(terms[place] @ slopes))
            error = float(np.hypot(errors[place], scatter * np.hypot(1.0, reach))) / abs(expected)
            odd = cls(number, (float(values[place]) - expected) / abs(expected), error)
            if best is None or scatter < best[0]:
                best = scatter, odd
        return None if best is None else best[1]
