"""The fit of one law to tensile curves, from starts in closed form."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from softmodels.fitting.curves.curve import small_modulus
from softmodels.fitting.curves.curve_residuals import TensileResiduals, largest_strain
from softmodels.fitting.law_parameters import LawChoice, by_bounds, closed_starts
from softmodels.fitting.least_squares import fit_parameters
from softmodels.fitting.problem import NOTHING_ELSE, Changes, Extra, FitError
from softmodels.fitting.result import LeastSquaresFit
from softmodels.materials.material import Material
from softmodels.materials.specimens import respond

Array = npt.NDArray[np.float64]

MODULUS = 30e3
"""Shear modulus in Pa that a fit starts from where there are no curves."""


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
