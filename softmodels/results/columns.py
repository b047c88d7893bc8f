"""What a state of a path leaves behind: its row of ``path.csv``, and what a restart needs of it."""

from __future__ import annotations

import dataclasses
import math
import re
from typing import Any

from softmodels.case.case import Case
from softmodels.materials.silicones import stretch_at_break
from softmodels.results.row import Cell, Row


def restart_of(point: Any) -> dict[str, Any]:
    """What a `Point` needs to be made again, beside its fields."""
    return {
        "P": point.state.P, "V": point.state.V, "requested": point.requested, "limit": point.limit, "jump": point.jump,
        "turn": point.turn, "step": point.step,
        "line": point.line, "factorised": point.factorised, "age": point.age, "stiffest": point.stiffest,
        "worn": point.worn, "largest": point.largest, "tangent": [point.tangent.P, point.tangent.V],
        "iterations": point.state.iterations, "signature": dataclasses.asdict(point.signature),
    }  # fmt: skip


def row_of(case: Case, fields: Any, point: Any, figures: Any, nodal: Any, number: int, come: float) -> Row:
    """The row of a `Point`, on rank 0.

    Args:
        case: What is run.
        fields: The device's `Fields`.
        point: The point.
        figures: Its figures.
        nodal: Its nodal fields.
        number: How many rows come before.
        come: How many steps a program has come.
    """
    # Of a program's pressures the highest stands for all.
    pressure = max(figures.cavity_pressures) if case.program else figures.pressure
    height = pressure / case.cm
    if point.requested and case.pressures_cm:  # as it was typed, without the rounding of two conversions
        height = min(case.pressures_cm, key=lambda asked: abs(asked - height))
    limit = stretch_at_break(case.material)
    cells: dict[str, Cell] = {
        "step": number,
        "pressure_cm": height,
        "pressure_Pa": pressure,
        "added_volume_ml": figures.added_volume * 1e6,
        **_driven(case, fields, figures, point),
        **_of_cavities(case, figures, come),
        **{f"{name}_mm": rise * 1e3 for name, rise in figures.rises.items()},
        **figures.device,
        "max_displacement_mm": figures.max_displacement * 1e3,
        "max_stretch": figures.max_stretch,
        **({} if limit is None else {"break_margin": limit / figures.max_stretch}),
        **{f"max_stretch_{axis}_mm": at * 1e3 for axis, at in zip("xyz", figures.max_stretch_at, strict=True)},
        "max_von_mises_kPa": figures.max_von_mises / 1e3,
        "J_min": figures.J_min,
        "J_max": figures.J_max,
        "newton_iterations": point.state.iterations,
        "stored_energy_mJ": figures.stored_energy * 1e3,
        "walls_touch": int(fields.walls.met(nodal["displacement"]) is not None),
        "requested": int(point.requested),
        "limit": int(point.limit),
        "jump": int(point.jump),
        "bifurcation": int(point.bifurcation),
        "stable_under_pressure": int(point.stable_under_pressure),
        "stable_under_volume": int(point.stable_under_volume),
        "negative_eigenvalues": point.signature.negative_eigenvalues,
        "lowest_eigenvalue_Pa_per_mm2": _eigenvalue(fields.equilibrium, point.signature.lowest),
        "following": point.line,
    }
    return Row(cells)


def _eigenvalue(equilibrium: Any, dimensionless: float) -> float | None:
    """In Pa/mm2; nothing where it was not found to within its tolerance."""
    if math.isnan(dimensionless):
        return None
    return float(dimensionless * equilibrium.stress_unit / (equilibrium.length_unit * 1e3) ** 2)


def cavity_columns(row: Row, what: str, unit: str) -> list[str]:
    """The columns that tell of each cavity, such as ``pressure_1_cm`` and ``pressure_2_cm``; of one alone ``pressure_cm``."""
    return [name for name in row if re.fullmatch(rf"{what}_\d+_{unit}", name)] or [f"{what}_{unit}"]


def _driven(case: Case, fields: Any, figures: Any, point: Any) -> dict[str, float]:
    """The syringe's columns of a row: its stroke, what the gas has taken up, and whether it holds the state."""
    if case.supply is None:
        return {}
    eq = fields.equilibrium
    cavity = fields.rest_volume * eq.volume_unit
    curve = case.supply.control(cavity, eq.stress_unit, eq.volume_unit)
    V, P = (cavity + figures.added_volume) / eq.volume_unit, figures.pressure / eq.stress_unit
    stroke = curve.value(V, P) * eq.volume_unit
    taken = {} if case.supply.leak else {
        "gas_energy_mJ": case.supply.gas_energy(stroke, figures.added_volume, figures.pressure, cavity) * 1e3
    }  # fmt: skip
    held = point.stable_under(curve.line(V, P))
    return {"stroke_ml": stroke * 1e6, **taken, "stroke_limit": int(point.turn), "stable_under_supply": int(held)}


def _of_cavities(case: Case, figures: Any, come: float) -> dict[str, float]:
    """The columns that tell of each cavity, where there are several."""
    each = {
        f"{what}_{i + 1}_{unit}": value * scale
        for what, unit, values, scale in (
            ("pressure", "cm", figures.cavity_pressures, 1 / case.cm),
            ("added_volume", "ml", figures.cavity_volumes, 1e6),
        )
        for i, value in enumerate(values)
    }
    return {**({"load_step": come} if case.program else {}), **(each if len(figures.cavity_volumes) > 1 else {})}
