"""Tensile curves as a source of residuals."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from softmodels.fitting.curves.curve import TensileCurve
from softmodels.fitting.curves.stress_error import StressError, noise
from softmodels.fitting.law_parameters import LawChoice
from softmodels.fitting.problem import CannotEvaluate, Extra, Parameter, Prior
from softmodels.materials.material import MaterialError
from softmodels.materials.specimens import respond, strain_of

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class TensileResiduals:
    """Residuals of a law against one curve: (gauge x model - measured) / error.

    Attributes:
        curve: The measured ramp, within the fit's range.
        choice: The law.
        errors: Standard errors in Pa, shape (n,).
        gauge: Name of the test's own factor on the stress (cross-section, load cell), or empty.
    """

    curve: TensileCurve
    choice: LawChoice
    errors: Array
    gauge: str = ""

    unit = "Pa"

    @property
    def label(self) -> str:
        return f"{self.curve.name} ({self.curve.mode})"

    @property
    def averaged_away(self) -> float:
        """Standard deviation in Pa of the readings' noise that a thinned curve no longer shows."""
        return noise(self.curve) * math.sqrt(1 - 1 / self.curve.readings)

    @property
    def parameters(self) -> tuple[str, ...]:
        return (*self.choice.names, self.gauge) if self.gauge else self.choice.names

    def evaluate(self, values: Mapping[str, float], derivatives: bool) -> tuple[Array, Array | None, list[str]]:
        """See `softmodels.fitting.problem.Residuals`."""
        try:
            material = self.choice.material(values)
        except MaterialError as error:
            raise CannotEvaluate(str(error)) from None
        names = self.choice.names if derivatives else ()
        found = respond(material, self.curve.stretch, self.curve.mode, names)
        factor = values[self.gauge] if self.gauge else 1.0
        residuals = (factor * found.stress - self.curve.stress) / self.errors
        slopes = None
        if derivatives:
            columns = [factor * found.slopes, *([found.stress[:, None]] if self.gauge else [])]
            slopes = np.hstack(columns) / self.errors[:, None]
        return residuals, slopes, [self.label] * len(residuals)


def residuals_of(
    curves: Sequence[TensileCurve],
    choice: LawChoice,
    error: StressError,
    gauge_error: float = 0.0,
    level: bool = False,
) -> tuple[list[TensileResiduals], Extra]:
    """Sources for curves, and the factors on their stress if these are uncertain by ``gauge_error`` (a share).

    With ``level``, and errors of unknown size, every curve weighs the same, however many points it has: a densely sampled
    curve must not silence a sparse one.
    """
    sources, gauges = [], []
    mean = sum(len(curve.stretch) for curve in curves) / max(len(curves), 1)
    for i, curve in enumerate(curves, 1):
        name = f"gauge{i}" if gauge_error else ""
        weight = math.sqrt(len(curve.stretch) / mean) if level and not error.stated else 1.0
        sources.append(TensileResiduals(curve, choice, weight * error.of(curve), name))
        if name:
            gauges.append(Parameter(name, "", 1.0, 0.2, 5.0, Prior(1.0, gauge_error)))
    return sources, Extra((), gauges)


def stretches_of(curves: Sequence[TensileCurve]) -> tuple[float, float] | None:
    """Range of stretch that curves cover together; None for no curves."""
    if not curves:
        return None
    return min(float(c.stretch.min()) for c in curves), max(float(c.stretch.max()) for c in curves)


def largest_strain(curves: Sequence[TensileCurve]) -> float:
    """Largest I1 - 3 in the curves."""
    return max(float(strain_of(curve.mode, curve.stretch).max()) for curve in curves)
