"""Leak of a device whose valve is closed, from pressures that fall: its kind, and its size with a 95 % interval.

Tubes, fittings and cavity hold an amount of gas X, counted as its volume at ambient pressure. It flows out at the rate s q(P):
q is a leak of one of the two kinds of `softmodels.path.supply`, an orifice or a laminar one, s its size. With G' = X'(P) / q(P)
the pressure at a time t is

    G(P) = G(P0) - s t,        dP/ds = -t / G'(P),        dP/dP0 = G'(P0) / G'(P)

so that neither steps in time nor differences are needed. Both kinds are fitted; the one that follows the readings better is
reported, and where they do not tell the two apart, the interval of the flow contains both.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from softmodels.common import cards, names, units
from softmodels.common.arrays import Array
from softmodels.common.names import checked
from softmodels.fitting import least_squares, problem
from softmodels.fitting.problem import FitError
from softmodels.path.supply import GASES, Reservoir


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Leak(cards.ResultCard):
    """A fitted leak.

    Attributes:
        kind: ``"orifice"`` or ``"laminar"``.
        size: Sonic conductance of an orifice in m3/(s Pa), the ``leak_conductance`` of `Reservoir`; of a laminar leak the bore
            in m, the ``leak_bore``, for the supply's ``leak_length`` (10 mm if it has none).
        interval: 95 % interval of the size, from a profile likelihood; from 0 where the readings show no leak.
        flow: What leaks at the first reading, in m3/s at ambient pressure, with its 95 % interval, which contains both kinds
            where the readings do not tell them apart.
        supply: The supply with this leak, for a simulation; a bore below 10 um is left out.
        fit: The fit.
        sentence: Why it is of that kind.
    """

    kind: str
    size: float
    interval: tuple[float, float]
    flow: tuple[float, float, float]
    supply: Reservoir
    fit: least_squares.LeastSquaresFit
    sentence: str

    @property
    def conductance(self) -> float:
        """Sonic conductance of an orifice in m3/(s Pa); 0 for a laminar leak."""
        return self.size if self.kind == ORIFICE else 0.0

    @property
    def bore(self) -> float:
        """Inner diameter of a laminar leak in m; 0 for an orifice."""
        return self.size if self.kind == LAMINAR else 0.0

    @property
    def words(self) -> str:
        """Its kind, with an article."""
        return "an orifice" if self.kind == ORIFICE else "a laminar leak"

    @property
    def _sized(self) -> str:
        if self.kind == ORIFICE:
            return f"conductance {self.conductance:.4g} m3/(s Pa)"
        over = f" over a length of {self.supply.leak_length * 1e3:.4g} mm" if self.supply.leak_length else ""
        return f"bore {self.bore * 1e3:.4g} mm{over}"

    def _line(self) -> str:
        return f"of {self.flow[0] * 60e6:.4g} ml/min at the first reading, {self.kind}, {self._sized}"

    def _figures(self) -> cards.Table:
        flow, low, high = (f"{value * 60e6:.4g}" for value in self.flow)
        factor = 1.0 if self.kind == ORIFICE else 1e3
        ends = " to ".join(f"{value * factor:.4g}" for value in self.interval)
        return [
            (self.kind, f"{self._sized} (95 %: {ends})"),
            ("flow at the first reading", f"{flow} ml/min at ambient pressure (95 %: {low} to {high})"),
        ]

    def _remarks(self) -> tuple[str, ...]:
        return (self.sentence, *self.fit.troubles)


SIZE, START = "size", "pressure"
"""Names of the parameters: size of the leak in the unit of its kind, and pressure in Pa at the first reading."""
ORIFICE, LAMINAR = "orifice", "laminar"
KINDS: dict[str, tuple[str, dict[str, float]]] = {
    ORIFICE: ("m^3/(s*Pa)", {"leak_conductance": 1.0, "leak_length": 0.0}),
    LAMINAR: ("m^4", {"leak_conductance": 0.0, "leak_bore": 1.0}),
}
"""Unit of the size of each kind of leak, and the fields of `Reservoir` for the size 1: a sonic conductance, or the fourth power
of the bore of a tube of the supply's ``leak_length``."""
USUAL_LENGTH = 0.01
"""Length in m of a laminar leak where the supply has none."""
SMALLEST_BORE = 1e-5
"""In m, of a case."""
DECISIVE_AICC = 6.0
"""Difference of two kinds' AICc above which the readings tell them apart: the wrong one is ahead by that much at most once in
exp(6 / 2) = 20 times."""
INTEGRAL_POINTS = 4001
"""Number of pressures at which the integral G is known."""
LARGEST_CAVITY = 1.0
"""In m3."""
INTEGRAL_RANGE = (0.2, 1.2)
"""They go from this share of the lowest reading to this multiple of the highest."""


class LeakResiduals:
    """Residuals of the gauge pressures of a leaking device in Pa, with standard errors, at rising times in s, shape (n,); see
    `softmodels.fitting.problem.Residuals`.

    The supply has tubes, fittings, gas and a leak of the size 1; the cavity is pairs of a pressure in Pa and its volume in m3,
    rising, or one for a constant volume.
    """

    label, unit, parameters = "pressures", "Pa", (SIZE, START)

    def __init__(self, times: Array, pressures: Array, errors: Array, supply: Reservoir, cavity: Array):
        self.times, self.pressures, self.errors = times - times[0], pressures, errors
        P = np.geomspace(INTEGRAL_RANGE[0] * pressures.min(), INTEGRAL_RANGE[1] * pressures.max(), INTEGRAL_POINTS)
        V, slope = np.full(INTEGRAL_POINTS, cavity[0, 1]), np.zeros(INTEGRAL_POINTS)
        if len(cavity) > 1:
            course = PchipInterpolator(*cavity.T)
            V, slope = course(P), course.derivative()(P)
        power = 1.0 / GASES[supply.gas]
        held = (1.0 + P / supply.ambient) ** power * (slope + power / (supply.ambient + P) * (V + supply.dead))  # X'(P)
        flows = np.array([supply.lost(pressure)[0] for pressure in P.tolist()]) / supply.ambient
        self._log, self._slope = np.log(P), CubicSpline(np.log(P), held / flows * P)  # dG over d log P
        self._integral = self._slope.antiderivative()(self._log)

    def fallen(self, pressure: float) -> float:
        """Return G at a pressure in Pa."""
        return float(np.interp(np.log(pressure), self._log, self._integral))

    def evaluate(self, values: Mapping[str, float], derivatives: bool) -> tuple[Array, Array | None, list[str]]:
        """See `softmodels.fitting.problem.Residuals`; pressures far below the readings stay at the lowest known one."""
        start = values[START]
        logs = np.interp(self.fallen(start) - values[SIZE] * self.times, self._integral, self._log)
        P, labels = np.exp(logs), [self.label] * len(logs)
        if not derivatives:
            return (P - self.pressures) / self.errors, None, labels
        slopes = self._slope(logs) / P
        J = np.column_stack([-self.times / slopes, self._slope(np.log(start)) / start / slopes])
        return (P - self.pressures) / self.errors, J / self.errors[:, None], labels


@checked
def fit_leak(
    times: Sequence[float] | Array,
    pressures: Sequence[float] | Array,
    cavity: float | Sequence[tuple[float, float]] | Array,
    supply: Reservoir,
    error: float | None = None,
) -> Leak:
    """Fit the leak of a device whose valve is closed to pressures that fall: an orifice or a laminar leak, whichever follows
    them better.

    Args:
        times: In s, rising, shape (n,).
        pressures: Gauge pressures in Pa, shape (n,).
        cavity: Volume of the cavity in m3, constant; or pairs of a pressure in Pa and a volume in m3, as of a run.
        supply: Tubes and fittings behind the valve, gas, and of the leak the critical ratio and, if laminar, the length.
        error: Standard error of a reading in Pa; None for that of the scatter.

    Raises:
        FitError: Fewer than three readings, times that do not rise, pressures that are not above 0, or no volume.
    """
    names.one_of("supply", supply, Reservoir, "the supply behind the valve, such as sm.Reservoir(tube_length='1 m')")
    t, P, known = _numbers("times", times), _numbers("pressures", pressures), _numbers("cavity", cavity)
    known = known if known.ndim else np.array([[0.0, float(known)]])
    _check(t, P, known)
    if error is not None and not (_numbers("error", error).ndim == 0 and error > 0.0):
        raise FitError(
            f"the error of a reading is {units.brief(error)}, in Pa; it must be above 0, or None for that of the scatter"
        )
    made = [_fit_of_kind(kind, t, P, known, supply, error) for kind in KINDS]
    best, other = sorted(made, key=lambda candidate: candidate.fit.aicc)
    behind = other.fit.aicc - best.fit.aicc
    if behind >= DECISIVE_AICC:
        said = f"the readings are those of {best.words}: {other.words} is {behind:.3g} worse in AICc"
        return dataclasses.replace(best, sentence=f"{said} (decisive above {DECISIVE_AICC:g})")
    ends = (min(best.flow[1], other.flow[1]), max(best.flow[2], other.flow[2]))
    said = (
        f"the readings do not tell {best.words} from {other.words} ({behind:.2g} worse in AICc; decisive above "
        f"{DECISIVE_AICC:g}): the interval of the flow contains both; readings over a longer time, down to a tenth of "
        "the first, tell them apart"
    )
    return dataclasses.replace(best, flow=(best.flow[0], *ends), sentence=said)


def _fit_of_kind(kind: str, t: Array, P: Array, cavity: Array, supply: Reservoir, error: float | None) -> Leak:
    """Return the fit of one kind of leak, without a sentence."""
    unit, fields = KINDS[kind]
    length = supply.leak_length or USUAL_LENGTH
    whole = dataclasses.replace(supply, **({"leak_length": length} | fields))  # type: ignore[arg-type]
    source = LeakResiduals(t, P, np.full(len(t), error or 1.0), whole, cavity)
    fallen = source.fallen(P[0]) - source.fallen(P[-1])
    least = source.fallen(P[0]) - source.fallen(0.999 * P[0])
    parameters = [
        problem.Parameter(SIZE, unit, max(fallen, least) / (t[-1] - t[0]), 0.0, answers=(0.0,)),
        problem.Parameter(START, "Pa", float(P[0]), float(0.9 * P.min()), float(1.1 * P.max())),
    ]
    fit = least_squares.settled(
        least_squares.fit_parameters([source], parameters, errors="unknown" if error is None else "stated", label=kind)
    )
    low, high = least_squares.profile(fit, SIZE).interval
    size, (flow, slope) = fit.values[SIZE], (value / supply.ambient for value in whole.lost(fit.values[START]))
    # The first pressure has an error too: the interval of the size, widened by the covariance of the two.
    towards = np.array([flow, size * slope])
    widened = math.sqrt(max(float(towards @ fit.covariance @ towards), 0.0)) / (fit.error(SIZE) or math.nan)
    reach = widened if math.isfinite(widened) else flow
    ends = (max(size * flow - reach * (size - low), 0.0), size * flow + reach * (high - size))
    least, most = low, high
    if kind == ORIFICE:
        leaking = dataclasses.replace(whole, leak_conductance=size)
    else:
        size, least, most = (value**0.25 for value in (size, low, high))
        tight = dataclasses.replace(supply, leak_conductance=0.0, leak_length=0.0)
        leaking = tight if size < SMALLEST_BORE else dataclasses.replace(whole, leak_bore=size)
    return Leak(kind, size, (least, most), (fit.values[SIZE] * flow, *ends), leaking, fit, "")


def _numbers(name: str, given: object) -> Array:
    try:
        numbers = np.asarray(units.plain(given), dtype=float)
    except units.UnitError as error:
        raise FitError(f"{name}: {error}") from None
    except (TypeError, ValueError, OverflowError):
        numbers = np.array(np.nan)
    if isinstance(given, bool | str | bytes) or not numbers.size or not np.isfinite(numbers).all():
        raise FitError(f"{name} {units.brief(given)} must be numbers in SI units")
    return numbers


def _check(t: Array, P: Array, cavity: Array) -> None:
    """Raise `FitError` for readings or volumes that no leak can be fitted to."""
    if t.ndim != 1 or t.shape != P.shape or len(t) < 3:
        raise FitError("a leak needs three readings or more, each with its time and its pressure")
    if not (np.diff(t) > 0.0).all():
        raise FitError("the times of a leak must rise from reading to reading")
    if not P.min() > 0.0:
        raise FitError(f"the pressures of a leak must be above 0, but one is {P.min():g} Pa; leave out what follows")
    if cavity.ndim != 2 or cavity.shape[1] != 2 or not (np.diff(cavity[:, 0]) > 0.0).all() or not cavity.min() >= 0.0:
        raise FitError("the cavity of a leak is a volume in m3, or pairs of a rising pressure in Pa and a volume in m3")
    if cavity[:, 1].max() > LARGEST_CAVITY:
        raise FitError(f"a cavity of {cavity[:, 1].max():g} m3 is too large for a soft device; volumes are in m3")
    if len(cavity) > 1 and not cavity[0, 0] <= P.min() <= P.max() <= cavity[-1, 0]:
        raise FitError(
            f"the volumes of the cavity go from {cavity[0, 0]:g} to {cavity[-1, 0]:g} Pa, the readings from {P.min():g} to "
            f"{P.max():g} Pa; give volumes over the whole range"
        )
