"""Tensile curves as a source of residuals, and the fit of a law to them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from measurement.units import UnitError, quantity
from softmodels.fitting.curves.curve import TensileCurve, TensileError, small_modulus
from softmodels.fitting.law_parameters import LawChoice, by_bounds, closed_starts
from softmodels.fitting.least_squares import fit_parameters
from softmodels.fitting.problem import NOTHING_ELSE, CannotEvaluate, Changes, Extra, FitError, Parameter, Prior
from softmodels.fitting.result import LeastSquaresFit
from softmodels.materials.material import Material, MaterialError
from softmodels.materials.specimens import respond, strain_of

Array = npt.NDArray[np.float64]

RELATIVE = 0.02
"""Share of the stress that a test is off by if nobody says: cross-section, load cell, crosshead strain."""
LEAST_ABSOLUTE = 0.003
"""Least absolute error, as a share of the largest stress: a load cell's resolution."""
MODULUS = 30e3
"""Shear modulus in Pa that a fit starts from where there are no curves."""
DENSE = 30
"""From this many points on, the noise of a curve can be told from its bend."""


@dataclasses.dataclass(frozen=True)
class StressError:
    """Standard error of a measured stress.

    Attributes:
        relative: Share of the stress.
        absolute: In Pa; None to estimate it from the curve's own noise.
        stated: Whether its size is known; else only the ratios count and the size follows from the scatter.
    """

    relative: float
    absolute: float | None
    stated: bool

    @classmethod
    def from_text(cls, text: str) -> StressError:
        """Read ``"2%+0.5kPa"``, ``"0.5kPa"``, ``"auto"``, or ``"constant"``: unweighted least squares on nominal stress."""
        if text == "auto":
            return cls(RELATIVE, None, False)
        if text == "constant":
            return cls(0.0, 1e3, False)
        relative, absolute = 0.0, 0.0
        try:
            for part in text.split("+"):
                if part.strip().endswith("%"):
                    relative = quantity(part, "")
                else:
                    absolute = quantity(part, "Pa")
        except UnitError as error:
            raise TensileError(f"stress error {text!r}: {error}; or write 2%+0.5kPa, auto or constant") from None
        if relative < 0.0 or absolute < 0.0 or relative + absolute == 0.0:
            raise TensileError(f"stress error {text!r} must be above zero")
        if absolute == 0.0:
            raise TensileError(f"stress error {text!r} vanishes at rest; add an absolute part, such as {text}+0.1kPa")
        return cls(relative, absolute, True)

    def of(self, curve: TensileCurve) -> Array:
        """Error in Pa of each point of a curve."""
        absolute = self.absolute
        if absolute is None:
            absolute = max(noise(curve), LEAST_ABSOLUTE * float(np.abs(curve.stress).max()))
        return np.hypot(self.relative * curve.stress, absolute)


def noise(curve: TensileCurve) -> float:
    """Standard deviation in Pa of a dense curve's noise, from third differences, which a smooth bend leaves small.

    The median makes jumps count little. 0 where the points are too few to tell noise from the bend. Averaged curves carry
    that of their readings.
    """
    if curve.noise is not None:
        return curve.noise
    if len(curve.stress) < DENSE:
        return 0.0
    return float(np.median(np.abs(np.diff(curve.stress, 3)))) / 0.6745 / math.sqrt(20)


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


def largest_strain(curves: Sequence[TensileCurve]) -> float:
    """Largest I1 - 3 in the curves."""
    return max(float(strain_of(curve.mode, curve.stretch).max()) for curve in curves)


def starts_for(choice: LawChoice, sources: Sequence[TensileResiduals]) -> list[dict[str, float]]:
    """Starting values of a law from the curves alone, best first."""
    curves = [source.curve for source in sources]

    def design(material: Material, names: Sequence[str]) -> Array:
        return np.vstack(
            [respond(material, s.curve.stretch, s.curve.mode, names).slopes / s.errors[:, None] for s in sources]
        )

    target = np.concatenate([source.curve.stress / source.errors for source in sources])
    modulus = float(np.median([small_modulus(curve) for curve in curves]))
    return closed_starts(choice, design, target, modulus, largest_strain(curves))


def fit_law_to_curves(
    choice: LawChoice,
    sources: Sequence[TensileResiduals],
    extra: Extra = NOTHING_ELSE,
    *,
    changes: Changes = MappingProxyType({}),
    loss: str = "linear",
    errors: str = "unknown",
    scale: float | None = None,
) -> LeastSquaresFit:
    """Fit a law to curves from starts in closed form.

    Args:
        choice: The law.
        sources: From `residuals_of`, for this law.
        extra: Parameters beside the law's, such as the curves' own factors, and further sources.
        changes: Fields of parameters to replace.
        loss: See `softmodels.fitting.least_squares.fit_parameters`.
        errors: See `softmodels.fitting.least_squares.fit_parameters`.
        scale: Size of the errors, in those of the sources, that a robust loss needs where they are unknown: one for all
            laws that are to be compared. None takes `spread` of a first fit without it.

    Raises:
        FitError: See `softmodels.fitting.least_squares.fit_parameters`; or a change names no parameter.
    """
    known = {*choice.names, *(p.name for p in extra.parameters)}
    for name in changes:
        if name not in known:
            raise FitError(f"{choice.name} has no parameter {name!r}; it has {', '.join(sorted(known))}")
    if loss != "linear" and errors == "unknown":
        if scale is None:
            scale = spread(fit_law_to_curves(choice, sources, extra, changes=changes, errors=errors))
        sources = [dataclasses.replace(s, errors=s.errors * scale) for s in sources]
    fits = []
    guesses = starts_for(choice, sources) if sources else [choice.from_modulus(MODULUS)]
    for starts in by_bounds(choice, guesses):
        parameters = [p.changed(changes.get(p.name, {})) for p in (*choice.parameters(starts[0]), *extra.parameters)]
        try:
            fits.append(
                fit_parameters(
                    [*sources, *extra.sources], parameters, loss=loss, starts=starts, errors=errors, label=choice.name
                )
            )
        except FitError as error:
            trouble = error
    if not fits:
        raise FitError(f"{choice.name}: {trouble}")
    return min(fits, key=lambda one: (not one.converged, one.deviance))


def spread(fit: LeastSquaresFit) -> float:
    """Standard deviation of a fit's residuals that outliers hardly change (median absolute deviation)."""
    return max(1.4826 * float(np.median(np.abs(fit.residuals[: fit.count]))), 1e-9)
