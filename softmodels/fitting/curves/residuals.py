"""Residuals of laws against tensile curves, and what tests show of a silicone's memory."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from softmodels.common import units
from softmodels.common.arrays import Array
from softmodels.fitting import least_squares, problem
from softmodels.fitting.curves.curve import (
    MIN_HOLD_SHARE,
    REVERSAL_TOLERANCE,
    TensileCurve,
    TensileError,
    corners,
    noise_of,
    segments,
    turns,
)
from softmodels.materials import memory, specimens
from softmodels.materials.laws import Material, MaterialError, NeoHookean
from softmodels.materials.memory import Memory


@dataclasses.dataclass(frozen=True, eq=False)
class TensileResiduals:
    """Residuals of a law against one curve: (gauge x model - measured) / error.

    Attributes:
        curve: The measured ramp, within the fit's range; the whole history with a spectrum.
        errors: Standard errors in Pa, shape (n,).
        gauge: Name of the test's own factor on the stress (cross-section, load cell), or empty.
        origin: Names of its slack and of its load cell's zero; empty where its curve has no `Origin`.
        spectrum: Relaxing branches of the law; None without a memory.
        further: Names of the free parameters of the softening, and of the branches' viscosity if that depends on stress.
        usual_errors: Standard errors in Pa as stated, or else usual for a test, shape (n,); see `Residuals`.
    """

    curve: TensileCurve
    choice: problem.LawChoice
    errors: Array
    gauge: str = ""
    spectrum: Spectrum | None = None
    further: tuple[str, ...] = ()
    usual_errors: Array | None = None
    origin: tuple[str, str] | tuple[()] = ()

    unit = "Pa"

    @property
    def label(self) -> str:
        return f"{self.curve.name} ({self.curve.mode})"

    @property
    def averaged_away(self) -> float | Array:
        """Standard deviation in Pa of the readings' noise that thinning has averaged out."""
        return noise(self.curve) * np.sqrt(1 - 1 / np.asarray(self.curve.readings))

    def part_scales(self, residuals: Array) -> Array:
        """Return by how much the errors of a history's points are to be scaled, shape (n,), so that its moving and its holding
        parts scatter alike about a fit with these standardised residuals; not below their noise or a load cell's resolution.

        The errors of a test as a whole are alike at all points of a hold, so that it shows relaxation more closely.
        """
        curve, scales = self.curve, np.ones(len(residuals))
        if curve.time is None:
            return scales
        parts = segments(curve.time, curve.stretch)
        mean = math.sqrt(float(np.mean(residuals**2)))
        still = np.zeros(len(residuals), dtype=bool)
        for a, b, held in parts:
            still[a + 1 : b + 1] = held
        for kind in (still, ~still):
            if kind.any() and mean > 0.0:
                scales[kind] = math.sqrt(float(np.mean(residuals[kind] ** 2))) / mean
        least = np.hypot(LEAST_ABSOLUTE * float(np.abs(curve.stress).max()), _left_noise(curve))
        return np.maximum(scales, np.minimum(least / self.errors, 1.0))

    def on_yardstick(self) -> TensileResiduals:
        """Return the residuals by which laws are compared, see `on_yardstick`; a history keeps its points."""
        if self.spectrum is not None and self.curve.time is not None:
            return dataclasses.replace(self, errors=told(self.curve) / np.sqrt(time_weights(self.curve)))
        curve = evened(self.curve) if self.spectrum is None else self.curve
        return dataclasses.replace(self, curve=curve, errors=told(curve), usual_errors=None)

    @property
    def parameters(self) -> tuple[str, ...]:
        weights = self.spectrum.all_names if self.spectrum else ()
        return (*self.choice.names, *weights, *self.further, *([self.gauge] if self.gauge else []), *self.origin)

    def evaluate(self, values: Mapping[str, float], derivatives: bool) -> tuple[Array, Array | None, list[str]]:
        """See `softmodels.fitting.problem.Residuals`."""
        curve = self.curve if not self.origin else self.curve.counting_from(*(values[name] for name in self.origin))
        times = self.spectrum.times_at(values) if self.spectrum else ()
        try:
            material = self.choice.material(values)
            if self.spectrum is not None:
                material = remembering(material, self.spectrum, values, -math.inf)
        except MaterialError as error:
            raise problem.CannotEvaluate(str(error)) from None
        names = self.choice.names if derivatives else ()
        if self.spectrum is not None and derivatives:
            names = (*names, *(f"share{k}" for k, _ in enumerate(self.spectrum.times, 1)), *self.further)
        stress, by = self._stress(material, curve, names, times)
        if self.spectrum is not None and self.spectrum.fitted and derivatives:
            weights = material.shear_modulus_0 * np.array([values[name] for name in self.spectrum.names])
            place = len(self.choice.names) + len(weights)
            by = np.hstack([by[:, :place], weights * branch_stress_slopes(curve, times), by[:, place:]])
        factor = values[self.gauge] if self.gauge else 1.0
        slopes = None
        if derivatives:
            columns = [factor * by, *([stress[:, None]] if self.gauge else [])]
            if self.origin:
                columns += [-factor * self._tangent(material, curve, times)[:, None], np.ones((len(stress), 1))]
            slopes = np.hstack(columns) / self.errors[:, None]
        return (factor * stress - curve.stress) / self.errors, slopes, [self.label] * len(stress)

    def form_slopes(self, values: Mapping[str, float], name: str) -> Array:
        """Return the derivatives of the residuals by a factor of `laws.FORM_ENERGIES`, shape (n,)."""
        curve = self.curve if not self.origin else self.curve.counting_from(*(values[name] for name in self.origin))
        factor = values[self.gauge] if self.gauge else 1.0
        law = specimens.respond(self.choice.material(values), curve.stretch, curve.mode, (name,))
        return np.asarray(factor * law.slopes[:, 0] / self.errors)

    def misfit(self, residuals: Array) -> float:
        """Return the mean square of a law's misfit as a share of the stress, for standardised residuals, shape (n,): beyond the
        noise of the readings (in 95 % of its draws), and without the toe (`TOE_STRETCH`) and the small stresses of a history,
        which passes through 0."""
        kept = (np.abs(self.curve.stretch - 1.0) > TOE_STRETCH) & (self.curve.stress != 0.0)
        if self.spectrum is not None:
            kept &= np.abs(self.curve.stress) > LEAST_SHARE_OF_STRESS * np.abs(self.curve.stress).max()
        if not kept.any():
            return 0.0
        away = np.broadcast_to(noise(self.curve) / np.sqrt(self.curve.readings), kept.shape)
        squares, by_noise = (errors[kept] ** 2 / self.curve.stress[kept] ** 2 for errors in (residuals * self.errors, away))
        likely = float(np.mean(by_noise) + 2.0 * np.linalg.norm(by_noise) * math.sqrt(2.0) / len(by_noise))
        return max(float(np.mean(squares)) - likely, 0.0)

    def _stress(
        self, material: Material, curve: TensileCurve, names: Sequence[str], times: tuple[float, ...]
    ) -> tuple[Array, Array]:
        """Return the nominal stress in Pa along a curve, and its derivatives by the named parameters."""
        if self.spectrum is None:
            response = specimens.respond(material, curve.stretch, curve.mode, names)
            return response.stress, response.slopes
        linear = None if specimens.FLOW[0] in self.further else branch_stresses(curve, times)
        return specimens.stress_in_time(material, curve.time, curve.stretch, curve.mode, names, linear)

    def _tangent(self, material: Material, curve: TensileCurve, times: tuple[float, ...]) -> Array:
        """Return the change of the stress in Pa by one of all stretches."""
        if self.spectrum is None:
            return specimens.respond(material, curve.stretch, curve.mode).tangent
        ends = [dataclasses.replace(curve, stretch=curve.stretch + step) for step in (-STRETCH_STEP, STRETCH_STEP)]
        low, high = (self._stress(material, end, (), times)[0] for end in ends)
        return (high - low) / (2.0 * STRETCH_STEP)


LEAST_SHARE_OF_STRESS = 0.1
"""Share of the largest stress of a history below which readings are left out of the misfit."""
TOE_STRETCH = 0.05
"""Stretches this close to 1 are skipped, because of slack in the grips."""
STRETCH_STEP = 1e-5
"""Step of the stretch in a difference: truncation and rounding are both below 1e-8 of the stress."""


def predicted(material: Material, curve: TensileCurve) -> Array:
    """Return the nominal stress in Pa of a material at the points of a curve, through its times if both have a memory."""
    if material.memory is None:
        return specimens.respond(material, curve.stretch, curve.mode).stress
    return specimens.stress_in_time(material, curve.time, curve.stretch, curve.mode)[0]


def slopes_of(material: Material, curve: TensileCurve, names: Sequence[str]) -> Array:
    """Return the derivatives of `predicted` by parameters of the law, shape (n, m)."""
    if material.memory is None:
        return specimens.respond(material, curve.stretch, curve.mode, names).slopes
    return specimens.stress_in_time(material, curve.time, curve.stretch, curve.mode, names)[1]


def residuals_of(
    curves: Sequence[TensileCurve],
    choice: problem.LawChoice,
    error: StressError,
    gauge_error: float = 0.0,
    level: bool = False,
    spectrum: Spectrum | None = None,
) -> tuple[list[TensileResiduals], problem.Extra]:
    """Return the sources for curves, and the factors on their stress with relative error ``gauge_error``.

    With ``level``, and errors of unknown size, every curve weighs the same, however many points it has: a densely sampled
    curve must not silence a sparse one. With a spectrum the curves are histories.
    """
    sources, own = [], []
    mean = sum(len(curve.stretch) for curve in curves) / max(len(curves), 1)
    for i, curve in enumerate(curves, 1):
        name = f"gauge{i}" if gauge_error else ""
        errors = error.of(curve) if spectrum is None else error.weighed(curve)
        usual = errors if error.stated else USUAL_ERROR.of(curve)
        if level and not error.stated:
            errors = math.sqrt(len(curve.stretch) / mean) * errors
        if name:
            own.append(problem.Parameter(name, "", 1.0, 0.2, 5.0, problem.Prior(1.0, gauge_error)))
        origin = origin_parameters(curve, i)
        own += origin
        names = (origin[0].name, origin[1].name) if origin else ()
        sources.append(TensileResiduals(curve, choice, errors, name, spectrum, (), usual, names))
    return sources, problem.Extra((), own)


ORIGIN = ("slack", "load_zero")
"""Names of a test's shift of the stretch, and of its load cell's zero in Pa; the test's number follows."""
FARTHEST_SLACK = 0.1
"""Largest change of the slack in a fit, or as much as it is."""


def origin_parameters(curve: TensileCurve, number: int) -> list[problem.Parameter]:
    """Return the slack and the load cell's zero of the test of this number, if it has an `Origin`."""
    if (origin := curve.origin) is None:
        return []
    room = max(FARTHEST_SLACK, abs(origin.slack))
    priors = [
        None if error is None else problem.Prior(mean, abs(error))
        for mean, error in ((origin.slack, origin.slack_error), (origin.zero, origin.zero_error))
    ]
    slack, zero = (f"{name}{number}" for name in ORIGIN)
    return [
        problem.Parameter(slack, "", origin.slack, origin.slack - room, origin.slack + room, priors[0]),
        problem.Parameter(zero, "Pa", origin.zero, prior=priors[1]),
    ]


def counted_from(curves: Sequence[TensileCurve], values: Mapping[str, float]) -> list[TensileCurve]:
    """Return the curves that count from their fitted slack and zero of the load cell."""
    names = [tuple(f"{name}{i}" for name in ORIGIN) for i, _ in enumerate(curves, 1)]
    return [
        curve.counting_from(values[slack], values[zero]) if slack in values else curve
        for curve, (slack, zero) in zip(curves, names, strict=True)
    ]


def stretches_of(curves: Sequence[TensileCurve]) -> tuple[float, float] | None:
    """Return the range of stretch that curves cover together; None for no curves."""
    if not curves:
        return None
    return min(float(c.stretch.min()) for c in curves), max(float(c.stretch.max()) for c in curves)


SMALL_STRAIN = 1e-3
"""I1 - 3 of oscillations of small amplitude."""


def largest_strain(curves: Sequence[TensileCurve]) -> float:
    """Return the largest I1 - 3 in the curves; without one that of a small strain."""
    return max((float(specimens.strain_of(curve.mode, curve.stretch).max()) for curve in curves), default=SMALL_STRAIN)


# ----------------------------------------------------------------------------------------------------------------------
# What tests show of a silicone's memory, and a law with a fitted one: weights of branches, and softening.
#
# The relaxation times are fixed, one per decade of what the data cover, so that the weights enter linearly; the stress of each
# branch is computed once for each history.


MIN_BRANCH_STRESS = 0.02
"""Least stress of a branch over the largest one for its relaxation to be shown: the usual error of a test."""
LEAST_SHARE = 1e-4
"""Weights below it are left out of the material."""
MOST_DURATIONS = 1.6
"""Longest relaxation time over the longest test's duration, in which such a branch loses nearly half of its stress."""
TIME_REACH = 10.0
"""How far beyond what the data see a fitted relaxation time may lie, as a factor."""
TIME_STEP = 1e-4
"""Relative step of a relaxation time in a difference."""
SEVERAL_HOLDS = 2.0
"""Ratio of hold times from which on they differ."""
SEVERAL_RATES = 2.0
"""Ratio of rates that tell a law from its branches."""
MIN_AMPLITUDE_RATIO = 1.2
"""Ratio of the largest strains of two reversals from which on they show how the softening grows."""


# ----------------------------------------------------------------------------------------------------------------------
# What the data can show.


@dataclasses.dataclass(frozen=True)
class Spectrum:
    """Relaxation times of a fit in s, rising, from which to which time in s the data see relaxation, two clauses on what limits
    them, and whether the times are fitted too."""

    times: tuple[float, ...]
    sees: tuple[float, float]
    why: tuple[str, str]
    fitted: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the weights."""
        return tuple(f"share{k}" if self.fitted else f"share_{time:g}s" for k, time in enumerate(self.times, 1))

    @property
    def all_names(self) -> tuple[str, ...]:
        """Names of the weights, and of the relaxation times that are fitted."""
        return (*self.names, *(f"time{k}" for k, _ in enumerate(self.times, 1) if self.fitted))

    def times_at(self, values: Mapping[str, float]) -> tuple[float, ...]:
        """Return the relaxation times in s at a fit's values."""
        return tuple(values[f"time{k}"] for k, _ in enumerate(self.times, 1)) if self.fitted else self.times

    def parameters(self, start: Mapping[str, float]) -> list[problem.Parameter]:
        """Return the weights with their starting values."""
        weights = [problem.Parameter(name, "", start[name], 0.0, answers=(0.0,)) for name in self.names]
        ends = self.sees[0] / TIME_REACH, self.sees[1] * TIME_REACH
        names = self.all_names[len(weights) :]
        return weights + [problem.Parameter(name, "s", time, *ends) for name, time in zip(names, self.times, strict=False)]

    @property
    def sentence(self) -> str:
        """What the data show, and what not."""
        low, high = self.sees
        times = ", ".join(f"{time:g}" for time in self.times)
        chosen = f"relaxation times {times} s, one per decade that the data cover"
        if self.fitted:
            chosen = f"{len(self.times)} branches, whose relaxation times are fitted to the data"
        return (
            f"{chosen}; they do not see the decades below {low:.2g} s "
            f"({self.why[0]}), nor above {high:.3g} s ({self.why[1]}): what relaxes later counts as equilibrium"
        )


def spectrum(
    curves: Sequence[TensileCurve], holds: Sequence[float] = (), frequencies: Sequence[float] = (), count: int = 0
) -> Spectrum:
    """Return the relaxation times that the data can show, one per decade; `TensileError` if no curve has times, and there are
    not two hold times.

    Of curves: from the sampling interval to about the duration, as far as the stresses show them. Of a device's photographs:
    between two hold times in s one, which relaxes most between them. Of oscillations: between the
    times that belong to the highest and the lowest frequency in Hz, 1 / (2 pi f). With a count so many branches, whose times
    are fitted from starts evenly among them.
    """
    timed = [curve for curve in curves if curve.time is not None and np.ptp(curve.time) > 0.0]
    spectra = [_spectrum_of_curves(timed)] if timed else []
    if len(told := _distinct_times(holds)) > 1:
        between = [(b - a) / math.log(b / a) for a, b in itertools.pairwise(told)]
        times = tuple(sorted({float(f"1e{round(math.log10(time))}") for time in between}))
        why = "the shortest hold of a photograph", "the longest hold of a photograph"
        spectra.append(Spectrum(times, (told[0], told[-1]), why))
    if len(frequencies):
        low, high = (1.0 / (2 * math.pi * end(frequencies)) for end in (max, min))
        if high < SEVERAL_HOLDS**2 * low:  # what damps most at another frequency damps there too
            low, high = low / SEVERAL_HOLDS, high * SEVERAL_HOLDS
        # A branch half a decade beyond an end still has more than half of its largest loss there.
        decades = range(math.ceil(math.log10(low) - 0.5), math.floor(math.log10(high) + 0.5) + 1)
        times = tuple(float(f"1e{k}") for k in decades) or (math.sqrt(low * high),)
        spectra.append(Spectrum(times, (low, high), ("the highest frequency", "the lowest frequency")))
    if not spectra:
        raise TensileError("a fit of the memory needs a test with times; all curves are at equilibrium")
    first, last = min(spectra, key=lambda branch: branch.sees[0]), max(spectra, key=lambda branch: branch.sees[1])
    times = tuple(sorted({time for branch in spectra for time in branch.times}))
    if count:
        steps = (np.arange(count) + 0.5) / count
        times = tuple((first.sees[0] * (last.sees[1] / first.sees[0]) ** steps).tolist())
    return Spectrum(times, (first.sees[0], last.sees[1]), (first.why[0], last.why[1]), fitted=bool(count))


def _distinct_times(holds: Sequence[float]) -> list[float]:
    """Return the hold times in s that differ clearly, rising."""
    distinct_times: list[float] = []
    for hold in sorted(hold for hold in holds if hold > 0.0):
        if not distinct_times or hold >= SEVERAL_HOLDS * distinct_times[-1]:
            distinct_times.append(hold)
    return distinct_times


def _spectrum_of_curves(timed: Sequence[TensileCurve]) -> Spectrum:
    intervals = []
    for curve in timed:
        assert curve.time is not None
        steps = np.diff(curve.time)
        intervals.append(float(np.quantile(steps[steps > 0.0], 0.05)))
    sampled, longest = min(intervals), max(float(np.ptp(c.time)) for c in timed)  # type: ignore[arg-type]
    decades = range(math.ceil(math.log10(0.9 * sampled)), math.floor(math.log10(MOST_DURATIONS * longest)) + 1)
    times = np.array([float(f"1e{k}") for k in decades] or [math.sqrt(sampled * longest)])
    spring = NeoHookean(1.0, 0.5)
    linear = [memory.Branch(1.0, float(time)) for time in times]
    largest = np.zeros(len(times))
    for curve in timed:
        assert curve.time is not None
        static = float(np.abs(specimens.respond(spring, curve.stretch, curve.mode).stress).max())
        largest = np.maximum(
            largest, np.abs(specimens.branch_stress(curve.time, curve.stretch, curve.mode, linear)).max(axis=0) / static
        )
    shown = largest >= MIN_BRANCH_STRESS
    if not shown.any():
        raise TensileError(
            f"the tests are so slow that relaxation within their {longest:.3g} s would show nowhere; fit the law only, "
            "without its memory"
        )
    kept = tuple(times[shown].tolist())
    lowest, reason = sampled, "the sampling interval"
    if kept[0] > times[0]:
        lowest, reason = kept[0] / math.sqrt(10.0), "no test is fast enough to show it"
    return Spectrum(kept, (lowest, max(longest, kept[-1])), (reason, "the longest test"))


def separates(curves: Sequence[TensileCurve]) -> bool:
    """Return whether the tests tell the law from its branches: by an unloading, a hold, several rates or equilibrium."""
    speeds = []
    for curve in curves:
        if curve.time is None:
            return True
        places = corners(curve.time, curve.stretch)
        dt, dx = np.diff(curve.time[places]), np.diff(curve.stretch[places])
        still = np.abs(dx) < REVERSAL_TOLERANCE * np.ptp(curve.stretch)
        if len(turns(curve.stretch)) > 2 or dt[still].sum() > MIN_HOLD_SHARE * dt.sum():
            return True
        speeds.append(float(np.abs(dx).sum() / max(dt.sum(), 1e-300)))
    return not speeds or max(speeds) > SEVERAL_RATES * min(speeds)


def may_soften(curves: Sequence[TensileCurve]) -> bool:
    """Return whether a history can tell softening from relaxation: by a second loading, or a hold after an unloading."""
    for curve in curves:
        if curve.time is None:
            continue
        reversals = turns(curve.stretch)
        if len(reversals) > 3:
            return True
        if len(reversals) == 3:
            room, peak = REVERSAL_TOLERANCE * float(np.ptp(curve.stretch)), curve.stretch[reversals[1]]
            places = [i for i in corners(curve.time, curve.stretch) if i >= reversals[1]]
            for a, b in itertools.pairwise(places):
                back = min(abs(curve.stretch[i] - peak) for i in (a, b)) > room
                still = abs(curve.stretch[b] - curve.stretch[a]) < room
                if back and still and curve.time[b] - curve.time[a] > 0.1 * np.ptp(curve.time):
                    return True
    return False


def several_amplitudes(curves: Sequence[TensileCurve]) -> bool:
    """Return whether the histories turn back at more than one strain, so that they show how the softening grows with it."""
    peaks = [
        abs(math.log(curve.stretch[place]))
        for curve in curves
        if curve.time is not None
        for place in turns(curve.stretch)[1:-1]
    ]
    peaks = [peak for peak in peaks if peak > 0.1 * max(peaks)]
    return bool(peaks) and max(peaks) > MIN_AMPLITUDE_RATIO * min(peaks) and len(peaks) > 2


# ----------------------------------------------------------------------------------------------------------------------
# A law with a fitted memory.


def remembering(material: Material, spectrum: Spectrum, values: Mapping[str, float], least: float = LEAST_SHARE) -> Material:
    """Return a law with its fitted memory, weights below ``least`` left out."""
    pairs = ((values[name], time) for name, time in zip(spectrum.names, spectrum.times_at(values), strict=True))
    onset, exponent = (values.get(name, getattr(memory.Branch, name)) for name in specimens.FLOW)
    branches = tuple(memory.Branch(share, time, onset, exponent) for share, time in pairs if share >= least)
    softening = None
    if specimens.SOFTENING[0] in values and (damage := values[specimens.SOFTENING[0]]) >= least:
        softening = memory.Softening(
            1 / max(damage, 1e-12), values[specimens.SOFTENING[1]], values.get(specimens.SOFTENING[2], 0.0)
        )
    return dataclasses.replace(material, memory=Memory(branches, softening) if branches or softening else None)


def branch_stresses(curve: TensileCurve, times: tuple[float, ...]) -> Array:
    """Return the stress of each branch over its G along a curve, of their relaxation times in s, shape (n, k); zero at
    equilibrium."""
    if curve.time is None:
        return np.zeros((len(curve.stretch), len(times)))
    return _along(curve.time.tobytes(), curve.stretch.tobytes(), curve.mode, times)


def branch_stress_slopes(curve: TensileCurve, times: tuple[float, ...]) -> Array:
    """Return the derivatives of `branch_stresses` by the times, by central differences in the same steps."""
    ends = [time * (1.0 + step) for step in (TIME_STEP, -TIME_STEP) for time in times]
    up, down = np.split(branch_stresses(curve, tuple(ends)), 2, axis=1)
    return np.asarray((up - down) / (2 * TIME_STEP * np.array(times)))


@functools.lru_cache(maxsize=64)
def _along(time: bytes, stretch: bytes, mode: str, times: tuple[float, ...]) -> Array:
    return specimens.branch_stress(
        np.frombuffer(time), np.frombuffer(stretch), mode, [memory.Branch(1.0, instant) for instant in times]
    )


def further_parameters(modulus: float, strain: float) -> list[problem.Parameter]:
    """Return the parameters of softening and viscosity for a shear modulus in Pa and a largest I1 - 3."""
    energy = modulus * strain / 2
    return [
        problem.Parameter(specimens.SOFTENING[0], "", 0.2, 0.0, 0.99, answers=(0.0,)),
        problem.Parameter(specimens.SOFTENING[1], "Pa", 0.2 * energy, 1e-4 * energy, 1e2 * energy),
        problem.Parameter(specimens.SOFTENING[2], "", 0.1, 0.0, 10.0, answers=(0.0,)),
        problem.Parameter(specimens.FLOW[0], "", 0.3, 1e-3, 1e2),
        problem.Parameter(specimens.FLOW[1], "", 0.3, 0.02, 3.0),
    ]


# ----------------------------------------------------------------------------------------------------------------------
# Standard error of measured stresses: as given, or from the curve's noise.


DEFAULT_RELATIVE_ERROR = MIN_BRANCH_STRESS
"""Default relative error of a test's stress: cross-section, load cell, crosshead strain."""

LEAST_WEIGHT = 0.01
"""Minimum weight of a point by its time, relative to the mean: several rows of one time are not nothing."""

LEAST_ABSOLUTE = 0.003
"""Minimum absolute error, relative to the largest stress: a load cell's resolution."""


@dataclasses.dataclass(frozen=True)
class StressError:
    """Standard error of a measured stress: a share of it and a part in Pa, None to estimate that from the curve's own
    noise. Unless ``stated`` only the ratios count and the size follows from the scatter."""

    relative: float
    absolute: float | None
    stated: bool

    @classmethod
    def from_text(cls, text: str) -> StressError:
        """Read ``"2%+0.5kPa"``, ``"0.5kPa"``, ``"auto"``, or ``"constant"``: unweighted least squares on nominal stress."""
        if not isinstance(text, str):
            raise TensileError(
                f"stress error is {units.brief(text)}; it must be a text such as '2%+0.5kPa', 'auto' or 'constant'"
            )
        if text == "auto":
            return cls(DEFAULT_RELATIVE_ERROR, None, False)
        if text == "constant":
            return cls(0.0, 1e3, False)
        relative, absolute = 0.0, 0.0
        try:
            for part in text.split("+"):
                if part.strip().endswith("%"):
                    relative = units.quantity(part, "")
                else:
                    absolute = units.quantity(part, "Pa")
        except units.UnitError as error:
            raise TensileError(f"stress error {text!r}: {error}; write 2%+0.5kPa, auto or constant") from None
        if relative < 0.0 or absolute < 0.0 or relative + absolute == 0.0:
            raise TensileError(f"stress error {text!r} must be above zero")
        if absolute == 0.0:
            raise TensileError(f"stress error {text!r} is zero without stress; add an absolute part, such as {text}+0.1kPa")
        return cls(relative, absolute, True)

    def of(self, curve: TensileCurve) -> Array:
        """Return the error in Pa of each point of a curve."""
        absolute: float | Array | None = self.absolute
        if absolute is None:
            absolute = np.maximum(_left_noise(curve), LEAST_ABSOLUTE * float(np.abs(curve.stress).max()))
        return np.hypot(self.relative * curve.stress, absolute)

    def weighed(self, curve: TensileCurve) -> Array:
        """Return the errors in Pa to fit a history with, shape (n,): what disturbs the test as a whole weighs by time, see
        `time_weights`, and the noise by itself. A stated error is not weighed."""
        if self.absolute is not None or curve.time is None:
            return self.of(curve)
        whole = np.hypot(self.relative * curve.stress, LEAST_ABSOLUTE * float(np.abs(curve.stress).max()))
        return np.hypot(whole / np.sqrt(time_weights(curve)), _left_noise(curve))


USUAL_ERROR = StressError(DEFAULT_RELATIVE_ERROR, None, False)
"""Error of a test whose errors nobody has stated."""


def noise(curve: TensileCurve) -> float | Array:
    """Return the standard deviation in Pa of the noise of a curve's readings, see `noise_of`; averaged curves carry it."""
    return noise_of(curve) if curve.noise is None else curve.noise


def _left_noise(curve: TensileCurve) -> float | Array:
    """Return the noise in Pa of a curve's points. In a history averages have that of an average, because its parts differ in
    noise and in readings; that of a ramp stays that of a reading, a measure of what else disturbs the test."""
    return noise(curve) / np.sqrt(curve.readings) if curve.time is not None else noise(curve)


def time_weights(curve: TensileCurve) -> Array:
    """Return the weights of a history's points, shape (n,), of mean 1: by the time that each stands for and not by rows. Where
    the stretch is held, time counts by the logarithm of 1 + t / T with T the duration of the movement before, as silicone
    relaxes."""
    assert curve.time is not None
    t, measure, before = curve.time, np.zeros(len(curve.time)), 0.0
    for a, b, held in segments(t, curve.stretch):
        own = t[a : b + 1] - t[a]
        if held and before > 0.0:
            own = before * np.log1p(own / before)
        elif not held:
            before = float(own[-1])
        measure[a : b + 1] = measure[a] + own
    ends = np.r_[measure[0], (measure[1:] + measure[:-1]) / 2, measure[-1]]
    weights = np.diff(ends)
    if not weights.sum() > 0.0:
        return np.ones(len(t))
    weights = np.maximum(weights / weights.mean(), LEAST_WEIGHT)
    return weights / weights.mean()


# ----------------------------------------------------------------------------------------------------------------------
# Thin raw curves of test machines: average readings over equal steps of stretch, and report the error.
#
# A machine writes as many readings as its clock allows. Ten thousand readings of one test carry no more information than a
# hundred, because its errors (cross-section, grips, the specimen's history) are correlated over much of the curve.


MOST_POINTS = 100
"""Number of points above which a curve is averaged over steps of stretch."""
MAX_STEPS = 800
"""Maximum number of steps for sharply bent curves."""
HISTORY_POINTS = 400
"""The same for a history in time."""
LEAST_STEPS = 6
"""Minimum number of steps between two corners of a history."""
AVERAGING_TOLERANCE = 0.002
"""Tolerance of the averaged curve, relative to the largest stress; otherwise more steps are used."""


def thinned(curve: TensileCurve, most: int = MOST_POINTS) -> TensileCurve:
    """Return a curve of at most about ``most`` points, with a remark on the averaging.

    Stretch and stress are averaged over equal steps of stretch; a step without a reading gives no point. Where the averages,
    joined by straight lines, miss the curve's smoothed readings by more than `AVERAGING_TOLERANCE` of the largest stress,
    steps are halved. A curve of few points is unchanged; a history in time is averaged between corners (`_history_thinned`).
    """
    if curve.time is not None:
        return _history_thinned(curve, HISTORY_POINTS)
    if len(curve.stretch) <= most:
        return curve
    steps = most
    while True:
        stretch, stress, _ = averaged(curve, steps)
        missed = _averaging_error(curve, stretch, stress, 2 * steps)
        if missed <= AVERAGING_TOLERANCE * float(np.abs(curve.stress).max()) or 2 * steps > min(
            MAX_STEPS, len(curve.stretch) // 2
        ):
            break
        steps *= 2
    scatter = _scatter(curve, stretch, stress)
    remark = (
        f"{len(curve.stretch)} readings averaged over {steps} equal steps of stretch, {len(stretch)} points; scatter "
        f"of the readings {scatter / 1e3:.2g} kPa rms, averaging error at most {missed / 1e3:.2g} kPa"
    )
    remarks, readings = (*curve.remarks, remark), len(curve.stretch) / len(stretch)
    return dataclasses.replace(curve, stretch=stretch, stress=stress, remarks=remarks, noise=noise(curve), readings=readings)


def _history_thinned(curve: TensileCurve, most: int) -> TensileCurve:
    """Return a history of about ``most`` points: corners of the stretch, and averages over steps of time between them. The
    steps grow from each corner on, where the silicone relaxes fastest: in a hold by a constant factor."""
    assert curve.time is not None
    n, time = len(curve.stretch), curve.time
    if n <= most:
        return curve
    parts = segments(time, curve.stretch)
    steps = max(most // len(parts), LEAST_STEPS)
    group = np.zeros(n, dtype=int)
    for a, b, held in parts:
        duration, first = float(time[b] - time[a]), float(time[min(a + 1, b)] - time[a])
        u = np.linspace(0.0, 1.0, steps + 1)[1:-1]
        edges = first * (duration / first) ** u if held and 0.0 < first < duration else duration * u**1.5
        inner = np.arange(a + 1, b)
        group[inner] = group[a] + 1 + np.searchsorted(edges, time[inner] - time[a])
        group[b] = group[a] + steps + 2
    _, member, counts = np.unique(group, return_inverse=True, return_counts=True)
    means = [np.bincount(member, values) / counts for values in (time, curve.stretch, curve.stress)]
    remark = f"{n} readings averaged over steps of time between {len(parts) + 1} corners, {len(counts)} points"
    return dataclasses.replace(
        curve, time=means[0], stretch=means[1], stress=means[2], remarks=(*curve.remarks, remark),
        noise=np.bincount(member, noise(curve)) / counts, readings=counts.astype(float),
    )  # fmt: skip


def averaged(curve: TensileCurve, steps: int) -> tuple[Array, Array, npt.NDArray[np.int64]]:
    """Return the mean stretch, mean stress and number of readings of every step that has any."""
    edges = np.linspace(curve.stretch[0], curve.stretch[-1], steps + 1)
    place = np.clip(np.searchsorted(edges, curve.stretch, "right") - 1, 0, steps - 1)
    counts = np.bincount(place, minlength=steps)
    here = counts > 0
    means = [np.bincount(place, values, steps)[here] / counts[here] for values in (curve.stretch, curve.stress)]
    return means[0], means[1], counts[here]


def _averaging_error(curve: TensileCurve, stretch: Array, stress: Array, halves: int) -> float:
    """Return the largest distance in Pa between the averages, joined by straight lines, and averages over halves of their
    steps."""
    finer, fine, counts = averaged(curve, halves)
    # A half step with few readings shows its noise instead of the curve's curvature.
    firm = (counts >= max(1, int(np.median(counts)) // 2)) & (finer >= stretch[0]) & (finer <= stretch[-1])
    off = np.abs(np.interp(finer, stretch, stress) - fine)[firm]
    chance = 4 * _scatter(curve, stretch, stress) / np.sqrt(counts[firm])
    return float(np.max(np.maximum(off - chance, 0.0), initial=0.0))


def _scatter(curve: TensileCurve, stretch: Array, stress: Array) -> float:
    """Return the root mean square distance in Pa of the readings from the averages, joined by straight lines."""
    return float(np.sqrt(np.mean((np.interp(curve.stretch, stretch, stress) - curve.stress) ** 2)))


# ----------------------------------------------------------------------------------------------------------------------
# Common basis for comparing laws: the same stretches and errors for every curve, independent of its sampling and fit.


STRETCH_STEPS = 25
"""Number of equal steps of stretch for every curve with enough points."""
COMMON_RELATIVE_ERROR, COMMON_RESOLUTION = 0.01, 0.005
"""Common error of tensile tests: relative to the stress, and relative to the largest stress."""


def on_yardstick(fitted: least_squares.LeastSquaresFit, sources: Sequence[TensileResiduals]) -> least_squares.LeastSquaresFit:
    """Return a law refitted to the curves of `evened`, with the common errors of tensile tests.

    Laws are compared by these fits, so that the choice of errors does not choose the law. Nor does the sampling: 37,512, 375
    and 93 readings of one pull give nearly the same values at the same stretches, and what one reading cannot tell counts as
    not reported, however many readings there are. Bounds, priors and fixed values stay.
    """
    even = [source.on_yardstick() for source in sources]
    loss, label = fitted.loss, fitted.label
    return least_squares.fit_parameters(
        even, fitted.parameters, loss=loss, starts=[fitted.values], errors="stated", label=label
    )


def evened(curve: TensileCurve) -> TensileCurve:
    """Return a curve as `STRETCH_STEPS` averages over equal steps of stretch; unchanged with fewer than two points per step.

    Every stretch counts the same then, also where a machine wrote more readings near the start. Each average stands at the
    middle of its step: the mean of its few readings lies beside that, which would judge a sparse curve elsewhere than a dense
    one, most of all at the ends, where laws miss most. The noise that averaging takes away is kept in the curve's ``noise``
    and ``readings``.
    """
    if len(curve.stretch) < 2 * STRETCH_STEPS:
        return curve
    means, stress, _ = averaged(curve, STRETCH_STEPS)
    edges = np.linspace(curve.stretch[0], curve.stretch[-1], STRETCH_STEPS + 1)
    middles = (edges[1:] + edges[:-1]) / 2
    stretch = middles[np.clip(np.searchsorted(edges, means, "right") - 1, 0, STRETCH_STEPS - 1)]
    stress = stress + np.gradient(stress, means) * (stretch - means)
    readings = curve.readings * len(curve.stretch) / len(stretch)
    return dataclasses.replace(curve, stretch=stretch, stress=stress, noise=noise(curve), readings=readings)


def told(curve: TensileCurve) -> Array:
    """Return the common error in Pa at each point of a curve, shape (n,)."""
    least = np.maximum(COMMON_RESOLUTION * float(np.abs(curve.stress).max()), _left_noise(curve))
    return np.hypot(COMMON_RELATIVE_ERROR * curve.stress, least)
