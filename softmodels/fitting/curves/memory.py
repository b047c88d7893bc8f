"""What tests show of a silicone's memory, and a law with a fitted one: weights of branches, and softening.

The relaxation times are fixed, one per decade of what the data cover, so that the weights enter linearly; the stress of each
branch is computed once for each history.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from softmodels.common.arrays import Array
from softmodels.fitting.curves.curve import HELD, TURN, TensileCurve, TensileError, corners, turns
from softmodels.fitting.problem import Parameter
from softmodels.materials.laws import Material, NeoHookean
from softmodels.materials.memory import Branch, Memory, Softening
from softmodels.materials.specimens import FLOW, SOFTENING, branch_stress, respond

SHOWN = 0.02
"""Least stress of a branch over the largest one for its relaxation to be shown: the usual error of a test."""
LEAST_SHARE = 1e-4
"""Weights below it are left out of the material."""
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
    """Relaxation times of a fit in s, rising, from which to which time in s the data see relaxation, and two clauses on
    what limits them."""

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
    """Return the relaxation times that the data can show, one per decade; `TensileError` if no curve has times, and there are
    not two hold times.

    Of curves: from the sampling interval to about the duration, as far as the stresses show them. Of a device's photographs:
    between two hold times in s one, which relaxes most between them.
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
    shown = largest >= SHOWN
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
# A law with a fitted memory.


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


def branch_stresses(curve: TensileCurve, spectrum: Spectrum) -> Array:
    """Return the stress of each branch over its G along a curve, shape (n, k); zero at equilibrium."""
    if curve.time is None:
        return np.zeros((len(curve.stretch), len(spectrum.times)))
    return _along(curve.time.tobytes(), curve.stretch.tobytes(), curve.mode, spectrum.times)


@functools.lru_cache(maxsize=64)
def _along(time: bytes, stretch: bytes, mode: str, times: tuple[float, ...]) -> Array:
    return branch_stress(np.frombuffer(time), np.frombuffer(stretch), mode, [Branch(1.0, one) for one in times])


def further_parameters(modulus: float, strain: float) -> list[Parameter]:
    """Return the parameters of softening and viscosity for a shear modulus in Pa and a largest I1 - 3."""
    energy = modulus * strain / 2
    return [
        Parameter(SOFTENING[0], "", 0.2, 0.0, 0.99, answers=(0.0,)),
        Parameter(SOFTENING[1], "Pa", 0.2 * energy, 1e-4 * energy, 1e2 * energy),
        Parameter(SOFTENING[2], "", 0.1, 0.0, 10.0, answers=(0.0,)),
        Parameter(FLOW[0], "", 0.3, 1e-3, 1e2),
        Parameter(FLOW[1], "", 0.3, 0.02, 3.0),
    ]
