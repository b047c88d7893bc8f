"""Scores of a law against measurements it was not fitted to: misfit, chi squared, coverage, worst point."""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from scipy.optimize import brentq
from scipy.special import chdtri

from geometries import Actuator
from measurement.outline.outline import Outline
from softmodels.case.case import Case
from softmodels.case.materials import MaterialErrors
from softmodels.common import cards, names, units
from softmodels.common.arrays import Array
from softmodels.common.errors import known_are
from softmodels.common.lazy import MPI
from softmodels.common.names import checked
from softmodels.common.processes import one_at_a_time
from softmodels.fitting import problem
from softmodels.fitting.curves import fit, residuals
from softmodels.fitting.curves.curve import TensileCurve, TensileError
from softmodels.fitting.outlines import inflations, views
from softmodels.fitting.outlines.device import MeasuredDevice
from softmodels.fitting.outlines.fit import fit_law_to_outlines, outlines_of, source_of, table_in
from softmodels.fitting.outlines.inflations import Inflation
from softmodels.fitting.outlines.residuals import READINGS, OutlineResiduals
from softmodels.fitting.outlines.views import SideView
from softmodels.fitting.problem import FitError
from softmodels.materials import silicones, specimens
from softmodels.materials.laws import FORM_ENERGIES, Material
from softmodels.mechanics import mpi

COLUMNS = [
    "material", "data", "values", "rms", "unit", "chi2_per_value", "chi2_measurement", "chi2_material", "coverage_95", "worst",
]  # fmt: skip
"""Of the table of scores."""
IDENTICAL_TOLERANCE = 0.95
"""Tolerance relative to its errors for identical materials."""


@dataclasses.dataclass(frozen=True, repr=False)
class Score(cards.ResultCard):
    """One material against one measurement.

    ``chi2`` is the sum of what the measurement's errors, the material's errors and neither explain.

    Attributes:
        material: Its name as asked for.
        data: What it was checked against.
        count: Measured values.
        rms: Root mean square of predicted minus measured, in ``unit``; across the outlines, where there are some.
        unit: Pa or m.
        chi2: Chi squared per value (per degree of freedom where the bench is fitted along): 1 where the law is off by no
            more than the measurement's error.
        chi2_material: The part that goes away when the material moves within the 95 % region of its errors (the covariance of
            its fit), to where it follows the measurement best; nan where they are not known. What is left of ``chi2`` neither
            explains: the law, the geometry, the mesh, another cast.
        coverage: Share of the values within the 95 % band of the measurement's error about the prediction.
        worst: Where the law is furthest off, in words.
    """

    material: str
    data: str
    count: int
    rms: float
    unit: str
    chi2: float
    coverage: float
    worst: str
    chi2_material: float = math.nan

    def _line(self) -> str:
        rms = " ".join(units.with_prefix(self.rms, self.unit))
        return f"of {self.material} against {self.data}: rms {rms}, chi squared {self.chi2:.3g} per value"

    def _figures(self) -> cards.Table:
        return [
            ("rms", f"{' '.join(units.with_prefix(self.rms, self.unit))} of {self.count} values"),
            ("chi squared per value", f"{self.chi2:.3g}"),
            *([("of it explained by the material's errors", f"{self.chi2_material:.3g}")] * math.isfinite(self.chi2_material)),
            ("within the 95 % band", f"{100 * self.coverage:.3g} %"),
            ("furthest off", self.worst),
        ]

    @property
    def chi2_measurement(self) -> float:
        """The part of ``chi2`` that the measurement's errors explain: 1, or less where ``chi2`` has less left."""
        return min(self.chi2 - (self.chi2_material if math.isfinite(self.chi2_material) else 0.0), 1.0)


def _explained_deviance(residuals: Array, slopes: Array, free: Array, errors: MaterialErrors) -> float:
    """Return the largest drop of chi squared as a material varies within the 95 % region of its errors, to first order.

    Residuals (n,) in standard errors are at the least squares of what is free beside the material; ``slopes`` (n, p) are
    their derivatives by the parameters of the errors, ``free`` (n, m) by what is free, which moves along.
    """
    moves = slopes @ errors.roots
    if free.shape[1]:
        size = np.linalg.norm(free, axis=0)
        basis = np.linalg.qr(free / np.where(size == 0.0, 1.0, size))[0]
        moves = moves - basis @ (basis.T @ moves)
    curvature, vectors = np.linalg.eigh(moves.T @ moves)
    slope = vectors.T @ (moves.T @ residuals)
    reach = math.sqrt(chdtri(len(slope), 1 - IDENTICAL_TOLERANCE))

    def step(shift: float) -> Array:
        return np.asarray(-slope / np.maximum(curvature + shift, 1e-150))

    shift, most = 0.0, float(np.linalg.norm(slope)) / reach  # at which the step is within reach whatever the curvature
    if most > 0.0 and np.linalg.norm(step(0.0)) > reach:
        shift = float(brentq(lambda trial: float(np.linalg.norm(step(trial))) - reach, 0.0, most))
    taken = step(shift) if most > 0.0 else np.zeros_like(slope)
    return -float(2 * slope @ taken + curvature @ taken**2)


def score_curve(
    name: str,
    material: Material,
    curve: TensileCurve,
    error: residuals.StressError,
    errors: MaterialErrors | None = None,
) -> Score:
    """Score a material, whose errors may be known, against a measured ramp, or the whole test with its times, through
    which a material with a memory is followed. Raises `TensileError` where the law has no stress on the curve."""
    stress = residuals.predicted(material, curve)
    if not np.isfinite(stress).all():
        first = float(curve.stretch[~np.isfinite(stress)][0])
        raise TensileError(f"{name} has no stress at stretch {first:.4g} of {curve.name}; limit the range with --stretch")
    off = stress - curve.stress
    sizes = off / error.of(curve)
    at = int(np.argmax(np.abs(sizes)))
    share = f", {100 * off[at] / curve.stress[at]:+.3g} %" if curve.stress[at] else ""
    when = "" if curve.time is None else f", {curve.time[at]:.4g} s"
    worst = f"{off[at] / 1e3:+.3g} kPa at stretch {curve.stretch[at]:.4g}{when} ({sizes[at]:+.2g} standard errors{share})"
    data = f"{curve.name} ({curve.mode}{', slack and zero taken off' if curve.origin else ''})"
    explained = math.nan
    if errors is not None:
        slopes = residuals.slopes_of(material, curve, errors.names) / error.of(curve)[:, None]
        explained = _explained_deviance(sizes, slopes, np.zeros((len(off), 0)), errors) / len(off)
    return Score(
        name, data, len(off), _rms(off), "Pa", _mean_square(sizes), _covered_shares(sizes), worst,
        chi2_material=explained,
    )  # fmt: skip


def score_outlines(
    name: str,
    material: Material,
    case: Actuator | Case | MeasuredDevice,
    outlines: Sequence[Outline | SideView],
    comm: MPI.Comm,
    errors: MaterialErrors | None = None,
) -> Score:
    """Score a material, whose errors may be known, against outlines of a device: with fixed law, while the bench
    corrections are fitted. Raises `FitError` where the device has no such states, or cannot be the one in the photographs."""
    choice = problem.LawChoice.of(material)
    measured = MeasuredDevice.of(case, views.seen_in(outlines))
    source, _ = source_of(measured, measured.model(choice, comm), outlines)
    fixed: problem.Changes = {key: {"start": value, "fixed": True} for key, value in material.parameters.items()}
    fit = fit_law_to_outlines(source, changes=fixed)
    matches = source.matches(fit.values)
    sizes = fit.residuals[: fit.count]
    off = np.concatenate([match.distances for match in matches])
    at = int(np.argmax(np.abs(sizes)))
    group = fit.rows.groups[at]
    if group == READINGS:
        matched = matches[source.read[at - (fit.count - len(source.read))]]
        told = f"{(matched.pressure - matched.true_pressure) / 1e3:+.3g} kPa of pressure for {matched.shape.source}"
    else:
        matched = next(match for match in matches if match.shape.source == group)
        told = f"{matched.distances[np.argmax(np.abs(matched.distances))] * 1e3:+.3g} mm in {group}"
    worst = f"{told} ({sizes[at]:+.2g} standard errors)"
    label = f"{len(source.shapes)} {source.what} of {measured.name}"
    freedom = max(len(fit.residuals) - len(fit.free), 1)
    explained = math.nan
    if errors is not None:
        source.fixed = source.fixed - set(errors.names)
        _, J, _ = source.evaluate(fit.values, True)
        assert J is not None
        slopes = np.zeros((len(fit.residuals), len(errors.names)))  # the bench's priors do not depend on the material
        slopes[: fit.count] = _slopes(J, source, fit.values, errors)
        explained = _explained_deviance(fit.residuals, slopes, fit.jacobian, errors) / freedom
    return Score(
        name,
        label,
        fit.count,
        _rms(off),
        "m",
        fit.deviance / freedom,
        _covered_shares(sizes),
        worst,
        chi2_material=explained,
    )


def score_inflation(
    name: str,
    material: Material,
    case: Actuator | Case | MeasuredDevice,
    inflation: Inflation,
    error: residuals.StressError,
    comm: MPI.Comm,
    errors: MaterialErrors | None = None,
) -> Score:
    """Score a material, whose errors may be known, against a table of a device's pressures, at the measured sizes and as they
    were read; ``error`` is that of the pressures. Raises `FitError` where the device has no such states."""
    choice = problem.LawChoice.of(material)
    measured = MeasuredDevice.of(case)
    source = inflations.InflationResiduals(measured.model(choice, comm), inflation)
    if errors is None:
        source.fixed = frozenset(source.parameters)
    values = {**source.model.lengths, "poisson": choice.poisson, **material.parameters}
    try:
        sizes, J, _ = source.evaluate(values, True)
    except problem.CannotEvaluate as trouble:
        raise FitError(str(trouble)) from None
    assert J is not None
    absolute = residuals.LEAST_ABSOLUTE * float(source.pressures.max()) if error.absolute is None else error.absolute
    weights = source.errors / np.hypot(error.relative * source.pressures, absolute)
    off, sizes = source.errors * sizes, weights * sizes
    at = int(np.argmax(np.abs(sizes)))
    where = source.size_of.text(float(source.measured[at]))
    explained = math.nan
    if errors is not None:
        slopes = weights[:, None] * _slopes(J, source, values, errors)
        explained = _explained_deviance(sizes, slopes, np.zeros((len(off), 0)), errors) / len(off)
    return Score(
        name, f"{source.label} ({measured.name})", len(off), _rms(off), "Pa", _mean_square(sizes), _covered_shares(sizes),
        f"{off[at] / 1e3:+.3g} kPa at {where} ({sizes[at]:+.2g} standard errors)", chi2_material=explained,
    )  # fmt: skip


def _slopes(
    J: Array, source: OutlineResiduals | inflations.InflationResiduals, values: Mapping[str, float], errors: MaterialErrors
) -> Array:
    """Return the columns of a Jacobian by the parameters of a material's errors; 0 of a memory's, at equilibrium."""
    columns = dict(zip(source.parameters, J.T, strict=True))
    columns |= {name: source.form_slopes(values, name) for name in errors.names if name in FORM_ENERGIES}
    return np.column_stack([columns.get(name, np.zeros(len(J))) for name in errors.names])


def _rms(values: Array) -> float:
    return math.sqrt(_mean_square(values))


def _mean_square(values: Array) -> float:
    return float(np.mean(values**2))


def _covered_shares(sizes: Array) -> float:
    return float(np.mean(np.abs(sizes) <= units.HALF_WIDTH_95))


def write_scores(path: Path, scores: Sequence[Score]) -> None:
    """Write every number as CSV, one row per material and measurement."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(COLUMNS)
        for score in scores:
            material = f"{score.chi2_material:.9g}" if math.isfinite(score.chi2_material) else ""
            chi2 = [f"{score.chi2:.9g}", f"{score.chi2_measurement:.9g}", material]
            numbers = [f"{score.rms:.9g}", score.unit, *chi2, f"{score.coverage:.6g}"]
            rows.writerow([score.material, score.data, score.count, *numbers, score.worst])


READINGS_COLUMNS = [
    "data", "material", "stretch", "time_s", "measured_Pa", "error_Pa", "predicted_Pa", "predicted_low_Pa", "predicted_high_Pa",
]  # fmt: skip


def write_readings(
    path: Path,
    materials: Mapping[str, Material],
    curves: Sequence[TensileCurve],
    error: residuals.StressError,
    errors: Mapping[str, MaterialErrors] = MappingProxyType({}),
) -> None:
    """Write the nominal stress of every point of the curves as CSV: measured with its standard error, predicted with the ends
    of the 95 % band of the material's errors, which are empty where those are unknown."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(READINGS_COLUMNS)
        for curve in curves:
            times = [""] * len(curve.stretch) if curve.time is None else [f"{t:.9g}" for t in curve.time]
            for name, material in materials.items():
                predicted = residuals.predicted(material, curve)
                ends = [[""] * len(predicted)] * 2
                if (known := errors.get(name)) is not None:
                    moves = residuals.slopes_of(material, curve, known.names) @ known.roots
                    half = units.HALF_WIDTH_95 * np.linalg.norm(moves, axis=1)
                    ends = [[f"{v:.9g}" for v in predicted + side * half] for side in (-1, 1)]
                numbers = np.column_stack([curve.stress, error.of(curve), predicted])
                for stretch, time, row, low, high in zip(curve.stretch, times, numbers, *ends, strict=True):
                    rows.writerow([curve.name, name, f"{stretch:.9g}", time, *(f"{v:.9g}" for v in row), low, high])


# ----------------------------------------------------------------------------------------------------------------------
# Score materials against measurements they were not fitted to: from laws and data to a list of scores.


type Materials = Material | str | Sequence[Material | str] | Mapping[str, Material | str]
type Outlines = Path | str | Sequence[Outline | SideView | Inflation | Path | str]


@checked
@one_at_a_time
def score(
    materials: Materials,
    curves: fit.Curves = (),
    *,
    device: Actuator | Case | MeasuredDevice | None = None,
    outlines: Outlines = (),
    errors: Mapping[str, MaterialErrors | Path | str] = MappingProxyType({}),
    stretch: tuple[float, float] | None = None,
    stress_error: str = "auto",
    untrusted: bool = False,
) -> list[Score]:
    """Score materials against tensile curves, and against outlines of a device, without fitting.

    With outlines, systematic errors of the bench (an offset of the pressure, a leak, the zero plane) are fitted too, as in
    a fit. Under MPI all ranks call it.

    Args:
        materials: One, several, or by name, each a material or a silicone's name; without a name each is called by its law and
            numbers, or as the silicone it is.
        curves: Measured curves, or files with uniaxial ones (see `read_curves` for other tests). If a material has a memory,
            they are whole tests with their times.
        device: What was inflated, with ``outlines``.
        outlines: Outlines of it, or the files or folders that a measurement has written.
        errors: Of fitted materials, by their names: ``report.chosen.errors``, or the ``fitted.toml`` that ``fit`` has written.
            Scores then report how much of the misfit they explain.
        stretch: Range of stretch of the curves; None for the whole curves.
        stress_error: Standard error of the measured stress, such as ``"2%+0.5kPa"``; ``"auto"`` is 2 % and the curve's noise.
        untrusted: Whether outlines are taken that the measurement does not trust.

    Returns:
        A score for each measurement and material, for each measurement the best first.

    Raises:
        TensileError: A curve cannot be used, or a material has no stress somewhere on it.
        FitError: Outlines cannot be used, or the device has no such states under a material.
        MaterialError: Errors that are none, or those of another material.
    """
    known = _materials_by_name(materials)
    uncertain = _errors(errors, known)
    measured = names.several("curves", curves, (TensileCurve, Path, str), "a curve or its file")
    remembers = any(material.memory is not None for material in known.values())
    ready = fit.prepared(measured, names.span("stretch", stretch), remembers) if measured else []
    wanted = "an outline, or a file or folder of outlines"
    given = names.several("outlines", outlines, (Outline, SideView, Inflation, Path, str), wanted)
    names.flag("untrusted", untrusted)
    if (device is None) != (not given):
        raise FitError("a device needs its outlines and vice versa; give both, or neither")
    if not ready and not given:
        raise FitError("there are no measurements; give a tensile curve, or a device with its outlines")
    error = error_of(stress_error)
    scores = [
        score_curve(name, material, curve, error, uncertain.get(name)) for curve in ready for name, material in known.items()
    ]
    if device is not None:
        table = table_in([(device, given)])
        shown = outlines_of(given, untrusted) if table is None else table
        scores += against_outlines(known, device, shown, mpi.start(), uncertain, error)
    places = {data: place for place, data in enumerate(dict.fromkeys(score.data for score in scores))}
    return sorted(scores, key=lambda material_score: (places[material_score.data], material_score.chi2))


def error_of(text: str) -> residuals.StressError:
    """Return the standard error of stresses; `TensileError` for none, since a score needs its absolute size."""
    if text == "auto":
        return residuals.StressError(residuals.DEFAULT_RELATIVE_ERROR, None, True)
    if text == "constant":
        raise TensileError("a score needs absolute errors: write 2%+0.5kPa, or auto")
    return residuals.StressError.from_text(text)


def against_outlines(
    materials: Mapping[str, Material],
    device: Actuator | Case | MeasuredDevice,
    outlines: Sequence[Outline | SideView] | Inflation,
    comm: MPI.Comm,
    errors: Mapping[str, MaterialErrors] = MappingProxyType({}),
    error: residuals.StressError = residuals.USUAL_ERROR,
) -> list[Score]:
    """Return the scores of materials against outlines of a device, with their errors by name, see `score_outlines`; or against
    a table of its pressures of a standard error. `FitError` names the material."""
    scores = []
    for name, material in materials.items():
        try:
            if isinstance(outlines, Inflation):
                scores.append(score_inflation(name, material, device, outlines, error, comm, errors.get(name)))
            else:
                scores.append(score_outlines(name, material, device, outlines, comm, errors.get(name)))
        except FitError as trouble:
            raise FitError(f"{name}: {trouble}") from trouble
    return scores


def _errors(errors: Mapping[str, MaterialErrors | Path | str], materials: Mapping[str, Material]) -> dict[str, MaterialErrors]:
    errors_by_name = {}
    for name, given in errors.items():
        if name not in materials:
            raise FitError(f"errors of {name!r} are given, but it is not scored; {known_are(name, list(materials))}")
        errors_by_name[name] = given if isinstance(given, MaterialErrors) else MaterialErrors.from_file(Path(given))
        errors_by_name[name].check(materials[name])
    return errors_by_name


def _materials_by_name(materials: Materials) -> dict[str, Material]:
    """Return the materials by their names in the scores; `FitError` for none, or one twice."""
    if isinstance(materials, Mapping):
        materials_by_name = {
            str(name): silicones.material_of(f"material {name}", material) for name, material in materials.items()
        }
    else:
        wanted = "a material, or the name of a silicone"
        given = [
            silicones.material_of("material", named) for named in names.several("materials", materials, (Material, str), wanted)
        ]
        materials_by_name = {silicones.named(named) or specimens.described(named): named for named in given}
        if len(materials_by_name) < len(given):
            raise FitError("a material is given twice")
    if not materials_by_name:
        raise FitError("there is no material; give at least one")
    return materials_by_name
