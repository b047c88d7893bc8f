"""Text, tables and files of a fit: for the terminal, the report, and simulations."""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np

from softmodels.case import materials
from softmodels.common.files import read_text
from softmodels.common.units import with_prefix
from softmodels.fitting.comparison import FitReport, FittedLaw, parameter_rows
from softmodels.fitting.curves.curve import TensileCurve
from softmodels.fitting.curves.residuals import predicted
from softmodels.fitting.least_squares import singular_values, unseen


def correlation_rows(law: FittedLaw) -> list[list[str]]:
    """Return the correlations of the free parameters below the diagonal, as texts; empty for one parameter."""
    names, R = [p.name for p in law.fit.free if not p.hidden], law.fit.correlations
    return [[names[i], *(f"{R[i, j]:+.3f}" for j in range(i))] for i in range(1, len(names))]


def residual_rows(law: FittedLaw) -> list[tuple[str, str, str, str, str]]:
    """Return the group, rms, mean, largest residual and correlation length, as texts."""
    rows = []
    for name, group in law.fit.summaries.items():
        factor, unit = (1e-3, "kPa") if group.unit == "Pa" else (1.0, group.unit)
        numbers = [f"{value * factor:.3g} {unit}" for value in (group.rms, group.mean, group.largest)]
        rows.append((name, *numbers, f"{group.run:.0f} of {group.count}"))
    return rows  # type: ignore[return-value]


def as_text(report: FitReport) -> str:
    """Return the report for a terminal."""
    lines = [*report.ranges, report.how, ""]
    for law in report.laws:
        modulus, unit = with_prefix(law.material.shear_modulus_0, "Pa")
        lines.append(
            f"{law.choice.name}: shear modulus {modulus} {unit}, Poisson's ratio {law.material.poisson:g} (given)"
        )
        lines += [
            f"  {name:14s} {value:>12s} {unit:4s} 95 %: {interval}"
            for name, value, unit, interval in parameter_rows(law)
        ]
        for name, *others in correlation_rows(law):
            pairs = zip(law.fit.free, others, strict=False)
            lines.append(f"  correlation of {name}: " + ", ".join(f"{p.name} {text}" for p, text in pairs))
        for name, rms, mean, largest, run in residual_rows(law):
            lines.append(f"  {name}: rms {rms}, mean {mean}, largest {largest}; residual correlation length: {run}")
        lines += [
            f"  {one.device}: chi squared {one.chi2:.4g} of {one.count} values ({one.chi2 / one.count:.3g} per value)"
            for one in law.devices
        ]
        lines += [f"  {text}" for text in (law.material.remark,) if text]
        lines += [f"  {'rejected' if text in law.objections else 'warning'}: {text}" for text in law.warnings]
        lines += [f"  {text}" for text in (*unseen(law.fit), *law.verdict.notes)]
        lines.append("")
    if len(report.laws) > 1:
        lines += [f"  {law.fit.label:14s} AICc +{law.aicc:.4g}, BIC {law.bic:+.4g}" for law in report.comparison.ranked]
    lines.append(report.verdict)
    if report.separate:
        lines += ["", *report.separate.sentences]
    return "\n".join(lines)


def material_toml(law: FittedLaw, report: FitReport) -> str:
    """Return a material file for ``--material``, with the basis of the fit."""
    import tomli_w

    fit = law.fit
    intervals = {p.name: [float(end) for end in law.interval(p.name)] for p in fit.free if not p.hidden}
    hidden = {p.name for p in fit.parameters if p.hidden}
    about: dict[str, object] = {
        "range": report.ranges,
        "how": report.how,
        "sound": law.sound,
        "values": {name: float(value) for name, value in fit.values.items() if name not in hidden},
        "intervals_95": intervals,
        "warnings": [*law.warnings],
        "corrections": [*law.judgement.notes],
        "unseen": [*unseen(fit)],
        "stability": [*law.verdict.notes],
    }
    if report.separate:
        about["apart"] = report.separate.sentences
    return tomli_w.dumps({"material": materials.to_table(law.material), "fit": about})


def as_json(report: FitReport) -> str:
    """Return every number of the report, in Pa and pure numbers."""
    return json.dumps(
        {
            "range": report.ranges,
            "how": report.how,
            "chosen": report.chosen.choice.name,
            "preferred": report.comparison.preferred.label,
            "verdict": report.verdict,
            "apart": report.separate.sentences if report.separate else [],
            "laws": [_law_json(law, report) for law in report.laws],
        },
        indent=1,
    )


def _law_json(law: FittedLaw, report: FitReport) -> dict[str, object]:
    fit = law.fit
    shown = [i for i, p in enumerate(fit.free) if not p.hidden]
    ranked = next(r for r in report.comparison.ranked if r.fit is fit)
    return {
        "law": law.choice.name,
        "material": materials.to_table(law.material),
        "parameters": [
            {
                "name": p.name, "unit": p.unit, "value": fit.values[p.name], "fixed": p.fixed,
                "standard_error": _finite(fit.error(p.name)),
                "interval_95": [_finite(end) for end in law.interval(p.name)],
                "start": p.start, "bounds": [_finite(p.lower), _finite(p.upper)],
                "prior": dataclasses.asdict(p.prior) if p.prior else None,
            }
            for p in fit.parameters if not p.hidden
        ],
        "hidden": [
            {
                "name": p.words, "unit": p.unit, "value": fit.values[p.name],
                "standard_error": _finite(fit.error(p.name)),
            }
            for p in fit.parameters if p.hidden
        ],
        "free": [fit.free[i].name for i in shown],
        "covariance": [[_finite(v) for v in row] for row in fit.covariance[np.ix_(shown, shown)]],
        "correlations": [[_finite(v) for v in row] for row in fit.correlations[np.ix_(shown, shown)]],
        "devices": [{"name": one.device, "chi2": one.chi2, "values": one.count} for one in law.devices],
        "singular_values": singular_values(fit)[0].tolist(),
        "residuals": {name: dataclasses.asdict(group) for name, group in fit.summaries.items()},
        "profiles": {
            name: {"values": p.values.tolist(), "rises": [*map(_finite, p.rises)], "limit": p.limit}
            for name, p in law.profiles.items()
        },
        "deviance": fit.deviance, "scatter": fit.scatter, "independent": fit.independent, "loss": fit.loss,
        "errors": fit.errors, "evaluations": fit.evaluations, "aicc": fit.aicc, "bic": fit.bic,
        "aicc_behind": ranked.aicc, "bic_behind": ranked.bic, "misfit_ratio": ranked.ratio,
        "sound": law.sound, "objections": list(law.objections), "corrections": list(law.judgement.notes),
        "converged": fit.converged, "warnings": list(law.warnings), "unseen": list(unseen(fit)),
        "stability": list(law.verdict.notes),
    }  # fmt: skip


def _finite(value: float) -> float | None:
    """Return a number, or None for infinity, which JSON does not have."""
    return float(value) if math.isfinite(value) else None


def write_curves(path: Path, laws: Sequence[FittedLaw], curves: Sequence[TensileCurve]) -> None:
    """Write measured and fitted nominal stresses in Pa, one row per point; times of curves without them are empty."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        timed = any(curve.time is not None for curve in curves)
        names = [*(["time_s"] if timed else []), "stretch", "measured_Pa", *(f"{law.choice.name}_Pa" for law in laws)]
        rows.writerow(["curve", "test", *names])
        for curve in curves:
            columns = [curve.stretch, curve.stress, *(predicted(law.material, curve) for law in laws)]
            if timed:
                columns.insert(0, np.full_like(curve.stretch, np.nan) if curve.time is None else curve.time)
            for row in np.column_stack(columns):
                rows.writerow([curve.name, curve.mode, *("" if np.isnan(v) else f"{v:.9g}" for v in row)])


# ----------------------------------------------------------------------------------------------------------------------
# Material files of a fit, with different names for accepted and rejected ones.


SOUND, UNSOUND, EARLIER = "fitted", "unsound", "earlier-"


def write_materials(report: FitReport, folder: Path, more: Mapping[str, str] = MappingProxyType({})) -> None:
    """Write each law's material file, as ``fitted.toml`` only if the chosen law is accepted.

    An earlier fit's ``fitted*.toml`` that this one does not replace is renamed to ``earlier-fitted*.toml``: nobody shall take
    it for this one's. An earlier ``unsound*.toml`` is removed.

    Args:
        report: The fit.
        folder: Where to.
        more: Texts of further files by their names.
    """
    texts = {name_of(report.chosen): material_toml(report.chosen, report)}
    if len(report.laws) > 1:
        texts |= {name_of(fitted, fitted.choice.name): material_toml(fitted, report) for fitted in report.laws}
    texts |= more
    retire(folder, set(texts))
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")


def name_of(fitted: FittedLaw, law: str = "") -> str:
    """Return the file name of a law's material; without a law, the chosen one's."""
    return f"{SOUND if fitted.sound else UNSOUND}{'-' + law if law else ''}.toml"


def retire(folder: Path, replaced: set[str] = frozenset()) -> None:  # type: ignore[assignment]
    """Rename an earlier fit's material files, except those in ``replaced``."""
    for stem in (SOUND, UNSOUND):
        for path in sorted({*folder.glob(f"{stem}.toml"), *folder.glob(f"{stem}-*.toml")}):
            if path.name in replaced or not _of_a_fit(path):
                continue
            if stem == UNSOUND:
                path.unlink()
            else:
                path.replace(path.with_name(f"{EARLIER}{path.name}"))


def _of_a_fit(path: Path) -> bool:
    """Return whether `write_materials` has written a file; a user's file stays."""
    with contextlib.suppress(OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return {"material", "fit"} <= set(tomllib.loads(read_text(path)))
    return False
