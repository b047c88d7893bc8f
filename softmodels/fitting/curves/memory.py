"""Fit what a silicone remembers to histories of stretch in time: weights of branches, and softening.

The relaxation times are fixed, one per decade of what the data cover, so that the weights enter linearly; the stress of each
branch is computed once for each history.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Self

import numpy as np
from scipy.optimize import nnls

from softmodels.common.arrays import Array
from softmodels.fitting.curves.curve import HELD, TURN, TensileCurve, TensileError, corners, turns
from softmodels.fitting.curves.residuals import (
    RELATIVE,
    StressError,
    TensileResiduals,
    largest_strain,
    residuals_of,
    told,
)
from softmodels.fitting.least_squares import fit_parameters
from softmodels.fitting.problem import (
    CannotEvaluate,
    Changes,
    Extra,
    FitError,
    LawChoice,
    Parameter,
    by_bounds,
    closed_starts,
)
from softmodels.fitting.result import LeastSquaresFit
from softmodels.materials.laws import Material, MaterialError, NeoHookean
from softmodels.materials.memory import Branch, Memory, Softening
from softmodels.materials.specimens import FLOW, SOFTENING, branch_stress, respond, stress_in_time

STARTS = 3
"""Number of a law's starts that are tried with branches."""
LEAST_SHARE = 1e-4
"""Weights below it are left out of the material."""
DECISIVE = 10.0
"""Lead in AICc from which on a memory softens: no support for the other (Burnham & Anderson 2002, section 2.6)."""
MOST_DURATIONS = 1.6
"""Longest relaxation time over the longest test's duration, in which such a branch loses nearly half of its stress."""
SEVERAL_HOLDS = 2.0
"""Ratio of hold times from which on they differ."""
SEVERAL_RATES = 2.0
"""Ratio of rates that tell a law from its branches."""
AMPLITUDES = 1.2
"""Ratio of the largest strains of two reversals from which on they show how the softening grows."""


# ----------------------------------------------------------------------------------------------------------------------
# What the data can show.


@dataclasses.dataclass(frozen=True)
class Spectrum:
    """Relaxation times of a fit.

    Attributes:
        times: In s, rising.
        sees: From which to which time in s the data see relaxation.
        why: What limits them, two clauses.
    """

    times: tuple[float, ...]
    sees: tuple[float, float]
    why: tuple[str, str]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the weights."""
        return tuple(f"share_{time:g}s" for time in self.times)

    def parameters(self, start: Mapping[str, float]) -> list[Parameter]:
        """Return the weights with their starting values."""
        return [Parameter(name, "", start[name], 0.0, answers=(0.0,)) for name in self.names]

    @property
    def sentence(self) -> str:
        """What the data show, and what not."""
        low, high = self.sees
        times = ", ".join(f"{time:g}" for time in self.times)
        return (
            f"relaxation times {times} s, one per decade that the data cover; they do not see the decades below {low:.2g} s "
            f"({self.why[0]}), nor above {high:.3g} s ({self.why[1]}): what relaxes later counts as equilibrium"
        )


def spectrum(curves: Sequence[TensileCurve], holds: Sequence[float] = ()) -> Spectrum:
    """Return the relaxation times that the data can show, one per decade.

    Of curves: from the sampling interval to about the duration, as far as the stresses show them. Of a device's photographs:
    between two hold times one, which relaxes most between them.

    Args:
        curves: Curves, those without times at equilibrium.
        holds: Hold times in s of photographs.

    Raises:
        TensileError: No curve has times, and there are not two hold times.
    """
    timed = [curve for curve in curves if curve.time is not None and np.ptp(curve.time) > 0.0]
    found = [_spectrum_of_curves(timed)] if timed else []
    if len(told := _distinct(holds)) > 1:
        between = [(b - a) / math.log(b / a) for a, b in itertools.pairwise(told)]
        times = tuple(sorted({float(f"1e{round(math.log10(time))}") for time in between}))
        why = "the shortest hold of a photograph", "the longest hold of a photograph"
        found.append(Spectrum(times, (told[0], told[-1]), why))
    if not found:
        raise TensileError("a fit of the memory needs a test with times; all curves are at equilibrium")
    low, high = min(found, key=lambda one: one.sees[0]), max(found, key=lambda one: one.sees[1])
    times = tuple(sorted({time for one in found for time in one.times}))
    return Spectrum(times, (low.sees[0], high.sees[1]), (low.why[0], high.why[1]))


def _distinct(holds: Sequence[float]) -> list[float]:
    """Return the hold times in s that differ clearly, rising."""
    found: list[float] = []
    for hold in sorted(hold for hold in holds if hold > 0.0):
        if not found or hold >= SEVERAL_HOLDS * found[-1]:
            found.append(hold)
    return found


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
    linear = [Branch(1.0, float(time)) for time in times]
    largest = np.zeros(len(times))
    for curve in timed:
        assert curve.time is not None
        static = float(np.abs(respond(spring, curve.stretch, curve.mode).stress).max())
        largest = np.maximum(
            largest, np.abs(branch_stress(curve.time, curve.stretch, curve.mode, linear)).max(axis=0) / static
        )
    shown = largest >= RELATIVE
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
        still = np.abs(dx) < TURN * np.ptp(curve.stretch)
        if len(turns(curve.stretch)) > 2 or dt[still].sum() > HELD * dt.sum():
            return True
        speeds.append(float(np.abs(dx).sum() / max(dt.sum(), 1e-300)))
    return max(speeds) > SEVERAL_RATES * min(speeds)


def may_soften(curves: Sequence[TensileCurve]) -> bool:
    """Return whether a history can tell softening from relaxation: by a second loading, or a hold after an unloading."""
    for curve in curves:
        if curve.time is None:
            continue
        reversals = turns(curve.stretch)
        if len(reversals) > 3:
            return True
        if len(reversals) == 3:
            room, peak = TURN * float(np.ptp(curve.stretch)), curve.stretch[reversals[1]]
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
    return bool(peaks) and max(peaks) > AMPLITUDES * min(peaks) and len(peaks) > 2


# ----------------------------------------------------------------------------------------------------------------------
# Residuals of a law with a memory.


def remembering(
    material: Material, spectrum: Spectrum, values: Mapping[str, float], least: float = LEAST_SHARE
) -> Material:
    """Return a law with its fitted memory, weights below ``least`` left out."""
    pairs = ((values[name], time) for name, time in zip(spectrum.names, spectrum.times, strict=True))
    onset, exponent = (values.get(name, getattr(Branch, name)) for name in FLOW)
    branches = tuple(Branch(share, time, onset, exponent) for share, time in pairs if share >= least)
    softening = None
    if SOFTENING[0] in values and (damage := values[SOFTENING[0]]) >= least:
        softening = Softening(1 / max(damage, 1e-12), values[SOFTENING[1]], values.get(SOFTENING[2], 0.0))
    return dataclasses.replace(material, memory=Memory(branches, softening) if branches or softening else None)


@dataclasses.dataclass(frozen=True, eq=False)
class MemoryResiduals(TensileResiduals):
    """Residuals of a law with branches, perhaps with softening, against one history.

    Attributes:
        spectrum: The branches.
        stresses: Of each over its G, shape (n, k), if it is linear.
        further: Names of the free parameters of the softening, and of the branches' viscosity if that depends on stress.
    """

    spectrum: Spectrum = Spectrum((), (0.0, 0.0), ("", ""))
    stresses: Array = dataclasses.field(default_factory=lambda: np.empty((0, 0)))
    further: tuple[str, ...] = ()

    def on_yardstick(self) -> Self:
        """Return them with the common errors of tests; a history keeps its points."""
        return dataclasses.replace(self, errors=told(self.curve))

    @property
    def _thins(self) -> bool:
        return FLOW[0] in self.further

    @property
    def parameters(self) -> tuple[str, ...]:
        own = (*self.choice.names, *self.spectrum.names, *self.further)
        return (*own, self.gauge) if self.gauge else own

    def evaluate(self, values: Mapping[str, float], derivatives: bool) -> tuple[Array, Array | None, list[str]]:
        """See `softmodels.fitting.problem.Residuals`."""
        try:
            material = remembering(self.choice.material(values), self.spectrum, values, -math.inf)
        except MaterialError as error:
            raise CannotEvaluate(str(error)) from None
        shares = [f"share{k}" for k, _ in enumerate(self.spectrum.times, 1)]
        names = (*self.choice.names, *shares, *self.further) if derivatives else ()
        stress, by = stress_in_time(
            material,
            self.curve.time,
            self.curve.stretch,
            self.curve.mode,
            names,
            None if self._thins else self.stresses,
        )
        factor = values[self.gauge] if self.gauge else 1.0
        slopes = None
        if derivatives:
            slopes = np.hstack([factor * by, *([stress[:, None]] if self.gauge else [])]) / self.errors[:, None]
        return (factor * stress - self.curve.stress) / self.errors, slopes, [self.label] * len(stress)


def memory_residuals(
    curves: Sequence[TensileCurve],
    stresses: Sequence[Array],
    choice: LawChoice,
    error: StressError,
    gauge_error: float,
    spectrum: Spectrum,
    level: bool = True,
) -> tuple[list[MemoryResiduals], Extra]:
    """Return the sources for histories, as `residuals_of` does for ramps, without softening.

    Args:
        curves: The histories.
        stresses: Of each, from `branch_stresses`.
        choice: The law.
        error: Standard errors.
        gauge_error: See `residuals_of`.
        spectrum: The branches.
        level: See `residuals_of`.
    """
    plain, extra = residuals_of(curves, choice, error, gauge_error, level)
    pairs = zip(plain, stresses, strict=True)
    return [MemoryResiduals(one.curve, choice, one.errors, one.gauge, spectrum, by) for one, by in pairs], extra


def branch_stresses(curves: Sequence[TensileCurve], spectrum: Spectrum) -> list[Array]:
    """Return for each curve the stress of each branch over its G, shape (n, k); zero at equilibrium."""
    return [
        np.zeros((len(curve.stretch), len(spectrum.times)))
        if curve.time is None
        else branch_stress(curve.time, curve.stretch, curve.mode, [Branch(1.0, time) for time in spectrum.times])
        for curve in curves
    ]


def fit_memory(
    sources: Sequence[MemoryResiduals],
    extra: Extra,
    changes: Changes,
    *,
    modulus: float,
    further: tuple[str, ...] = (),
    loss: str = "linear",
    errors: str = "unknown",
) -> LeastSquaresFit:
    """Fit a law and its memory to histories.

    Args:
        sources: From `memory_residuals`, all of one law.
        extra: The curves' own factors.
        changes: Fields of parameters to replace.
        modulus: Small-strain shear modulus in Pa of the data.
        further: See `MemoryResiduals`.
        loss, errors: See `softmodels.fitting.least_squares.fit_parameters`.

    Raises:
        FitError: See `softmodels.fitting.least_squares.fit_parameters`; or a change names no parameter.
    """
    sources = [dataclasses.replace(source, further=further) for source in sources]
    choice = sources[0].choice
    names = (*choice.names, *sources[0].spectrum.names, *further, *(p.name for p in extra.parameters))
    for name in changes:
        if name not in names:
            raise FitError(f"{choice.name} with its memory has no parameter {name!r}; it has {', '.join(names)}")
    energy = modulus * largest_strain([source.curve for source in sources]) / 2
    fits = []
    trouble: FitError | None = None
    for starts in by_bounds(choice, _starts(choice, sources, modulus)[:STARTS]):
        own = [*choice.parameters(starts[0])]
        own += sources[0].spectrum.parameters(starts[0])
        own += [one for one in _further_parameters(energy) if one.name in further]
        parameters = [p.changed(changes.get(p.name, {})) for p in (*own, *extra.parameters)]
        try:
            fits.append(fit_parameters(sources, parameters, loss=loss, starts=starts, errors=errors, label=choice.name))
        except FitError as error:
            trouble = error
    if not fits:
        raise FitError(f"{choice.name}: {trouble}")
    return settled(min(fits, key=lambda one: (not one.converged, one.deviance)))


def _further_parameters(energy: float) -> list[Parameter]:
    """Return the parameters of softening and viscosity for a largest energy in Pa."""
    return [
        Parameter(SOFTENING[0], "", 0.2, 0.0, 0.99, answers=(0.0,)),
        Parameter(SOFTENING[1], "Pa", 0.2 * energy, 1e-4 * energy, 1e2 * energy),
        Parameter(SOFTENING[2], "", 0.1, 0.0, 10.0, answers=(0.0,)),
        Parameter(FLOW[0], "", 0.3, 1e-3, 1e2),
        Parameter(FLOW[1], "", 0.3, 0.02, 3.0),
    ]


def _starts(choice: LawChoice, sources: Sequence[MemoryResiduals], modulus: float) -> list[dict[str, float]]:
    """Return the law's starts, each with the weights that fit best with its shape, by non-negative least squares.

    The law's start is that of what branches of any weight leave of the stresses (Frisch & Waugh 1933).
    """
    curves = [source.curve for source in sources]
    target = np.concatenate([source.curve.stress / source.errors for source in sources])
    branches = np.vstack([s.stresses / s.errors[:, None] for s in sources])
    Q, _ = np.linalg.qr(branches)

    def design(material: Material, names: Sequence[str]) -> Array:
        A = np.vstack(
            [respond(material, s.curve.stretch, s.curve.mode, names).slopes / s.errors[:, None] for s in sources]
        )
        return np.asarray(A - Q @ (Q.T @ A))

    made = []
    for start in closed_starts(choice, design, target - Q @ (Q.T @ target), modulus, largest_strain(curves)):
        try:
            material = choice.material(start)
        except MaterialError:
            continue
        law = np.concatenate([respond(material, s.curve.stretch, s.curve.mode).stress / s.errors for s in sources])
        A = np.column_stack([law, material.shear_modulus_0 * branches])
        if not np.isfinite(A).all():
            continue
        size = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
        found, misfit = nnls(A / size, target)
        factor, *shares = found / size
        if not factor > 0.0:
            continue
        scaled = {name: v * (factor if choice.unit(name) == "Pa" else 1.0) for name, v in start.items()}
        weights = {n: max(v / factor, 0.01) for n, v in zip(sources[0].spectrum.names, shares, strict=True)}
        made.append((misfit, {**scaled, **weights}))
    if not made:
        plain = choice.from_modulus(0.7 * modulus, largest_strain(curves))
        return [{**plain, **dict.fromkeys(sources[0].spectrum.names, 0.1)}]
    return [start for _, start in sorted(made, key=lambda one: one[0])]


def settled(fit: LeastSquaresFit) -> LeastSquaresFit:
    """Return a fit whose weights that ended at zero are zero, not a rounding away from it."""
    ends = {name: bound for name, bound in fit.at_bounds.items() if bound == 0.0}
    return dataclasses.replace(fit, values={**fit.values, **ends}) if ends else fit
