"""Whether a fit may be used: what forbids it, whatever its law and its data."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping

import numpy as np

from softmodels.fitting.problem import Parameter
from softmodels.fitting.result import LeastSquaresFit
from softmodels.materials.material import MaterialError

NORMAL = 1.96
"""Half a 95 % interval in standard errors."""


@dataclasses.dataclass(frozen=True)
class Judgement:
    """What is known of a device, a bench and a silicone, and speaks against a fit.

    Attributes:
        objections: Sentences that forbid its use.
        warnings: Sentences that do not.
        notes: What was corrected.
    """

    objections: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


NOTHING = Judgement()


def objections(fit: LeastSquaresFit, modulus: Callable[[Mapping[str, float]], float]) -> tuple[str, ...]:
    """Sentences that forbid the use of a fit; none if it is sound.

    Args:
        fit: The fit.
        modulus: The law's small-strain shear modulus in Pa at parameter values.
    """
    found = [
        f"{p.words} ended at its bound {with_unit(bound, p)}, so that its value and its interval mean nothing"
        for p in fit.free
        if (bound := fit.at_bounds.get(p.name)) is not None and bound not in p.answers
    ]
    found += [f"the data do not determine {p.words}: {why}" for p in fit.free if (why := _undetermined(fit, p))]
    value, error = modulus(fit.values), _modulus_error(fit, modulus)
    if not found and not NORMAL * error < abs(value):
        found.append(
            f"the data do not determine the shear modulus: {value / 1e3:.4g} kPa with a standard error of {error / 1e3:.3g} kPa"
        )
    return tuple(found)


def with_unit(value: float, p: Parameter) -> str:
    """A parameter's value with its unit."""
    return f"{value:.4g} {p.unit}".rstrip()


def _undetermined(fit: LeastSquaresFit, p: Parameter) -> str:
    """Why a parameter is not determined, empty if it is; one with a prior always is."""
    if p.prior or p.hidden or p.name in fit.at_bounds:
        return ""
    if not math.isfinite(fit.error(p.name)):
        return "another one makes up for any change of it"
    low, high = (fit.values[p.name] + sign * NORMAL * fit.error(p.name) for sign in (-1.0, 1.0))
    whole = math.isfinite(p.upper - p.lower) and low <= p.lower and high >= p.upper
    return "its interval is as wide as its bounds" if whole and not p.answers else ""


def _modulus_error(fit: LeastSquaresFit, modulus: Callable[[Mapping[str, float]], float]) -> float:
    """Standard error of the shear modulus in Pa, by its derivatives; 0 where nothing it depends on is free."""
    slope = np.zeros(len(fit.free))
    for i, p in enumerate(fit.free):
        if p.name in fit.at_bounds or p.hidden or p.name == "poisson":
            continue
        step = 1e-6 * (abs(fit.values[p.name]) or p.scale)
        try:
            ends = [modulus({**fit.values, p.name: fit.values[p.name] + sign * step}) for sign in (-1.0, 1.0)]
        except MaterialError:  # a law at the edge of what it can be: its modulus is nothing but rounding
            return math.inf
        slope[i] = (ends[1] - ends[0]) / (2 * step)
    seen = slope != 0.0
    if not seen.any():
        return 0.0
    variance = float(slope[seen] @ fit.covariance[np.ix_(seen, seen)] @ slope[seen])
    return math.sqrt(variance) if variance >= 0.0 else math.inf
