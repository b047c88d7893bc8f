"""The columns of ``path.csv``, each listed once: its name with the unit, what it is in words, and how it is computed.

A column of your own is one more entry, also from outside: ``COLUMNS.append(Column(...))``, or one that comes with an output
field (`OutputField.extremes`) or with a figure that all ranks compute together (`Measure`).
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator

from geometries import Actuator
from softmodels.case.case import Case
from softmodels.materials.silicones import stretch_at_break
from softmodels.mechanics.parts import PARTS
from softmodels.path.quantities import Supply
from softmodels.results.column import Column, Columns, Solved
from softmodels.results.forces import MEASURES
from softmodels.results.output_fields import FIELDS, Extreme, OutputField
from softmodels.results.row import Cell, Row
from softmodels.results.self_contact import OVERLAP
from softmodels.results.terms import Term, at_rise, described, split


def row_of(solved: Solved) -> Row:
    """The row of a state, on rank 0."""
    cells: dict[str, Cell] = {}
    for entry in every_column():
        cells |= entry.cells(solved)
    return Row(cells)


def every_column() -> Iterator[Column | Columns]:
    """All entries: `COLUMNS`, then those that output fields bring along."""
    yield from COLUMNS
    listed = {entry.name for entry in COLUMNS if isinstance(entry, Column)}
    for field in FIELDS:
        yield from (column for column in _extremes(field.name) if column.name not in listed)


def term(column: str, device: Actuator | None = None, supply: str = "supply") -> Term:
    """What a column of ``path.csv`` is. One that nobody knows of here is still shown, under its own name.

    Args:
        column: Its name.
        device: The device, for the columns that are its own.
        supply: What drives the air, in a word.
    """
    found = (entry.term(column, device) for entry in (DEVICE, *every_column(), NAMED))
    known = next((one for one in found if one is not None), described(column, (split(column)[0].replace("_", " "), "")))
    return known.told_of(supply)


def cavity_columns(row: Row, what: str, unit: str) -> list[str]:
    """The columns that tell of each cavity, such as ``pressure_1_cm`` and ``pressure_2_cm``; of one alone ``pressure_cm``.

    They are counted from 1 on: ``pressure_95_cm`` is half the 95 % band of the pressure, and of no cavity.
    """
    numbered = (f"{what}_{k}_{unit}" for k in itertools.count(1))
    return list(itertools.takewhile(row.__contains__, numbered)) or [f"{what}_{unit}"]


def loads_words(row: Row) -> list[str]:
    """The weights, forces and moments of a state in words, such as ``"force tip 2 N"``."""
    found = []
    for name in load_columns(row):
        words, unit = split(name)
        found.append(f"{words.replace('_', ' ')} {row[name]:.4g} {unit}")
    return found


def load_columns(row: Row) -> list[str]:
    """The columns with weights, forces and moments."""
    return [name for name in row if re.fullmatch(r"weight_N|force(_\w+)?_N|moment(_\w+)?_Nmm", name)]


def _height(solved: Solved) -> float:
    """Of the water column in cm."""
    height = solved.pressure / solved.case.cm
    asked = solved.case.pressures_cm if solved.point.requested else ()
    # As it was typed, without the rounding of two conversions.
    return next((typed for typed in asked if math.isclose(typed, height, rel_tol=1e-9)), height)


def _stroke(solved: Solved) -> float:
    """Of the supply in m3."""
    V, P, curve = _on_supply(solved)
    return float(curve.value(V, P) * solved.fields.system.volume_unit)


def _on_supply(solved: Solved) -> tuple[float, float, Supply]:
    """Dimensionless volume and pressure of a state, and the supply's curves."""
    eq, supply = solved.fields.system, solved.case.supply
    assert supply is not None
    cavity = solved.fields.rest_volume * eq.volume_unit
    curve = supply.control(cavity, eq.stress_unit, eq.volume_unit)
    return (cavity + solved.figures.added_volume) / eq.volume_unit, solved.figures.pressure / eq.stress_unit, curve


def _gas_energy(solved: Solved) -> float:
    supply, figures = solved.case.supply, solved.figures
    assert supply is not None
    cavity = solved.fields.rest_volume * solved.fields.system.volume_unit
    return supply.gas_energy(_stroke(solved), figures.added_volume, figures.pressure, cavity) * 1e3


def _held(solved: Solved) -> int:
    V, P, curve = _on_supply(solved)
    return int(solved.point.stable_under(curve.line(V, P)))


def _cavity_cells(solved: Solved) -> dict[str, Cell]:
    """Pressure and added volume of each cavity, where there are several."""
    figures = solved.figures
    if len(figures.cavity_volumes) < 2:
        return {}
    pressures = {f"pressure_{i}_cm": value / solved.case.cm for i, value in enumerate(figures.cavity_pressures, 1)}
    return {**pressures, **{f"added_volume_{i}_ml": value * 1e6 for i, value in enumerate(figures.cavity_volumes, 1)}}


def _cavity_term(column: str, device: Actuator | None) -> Term | None:
    found = re.fullmatch(r"(pressure|added_volume)_(\d+)_(cm|ml)", column)
    if not found or found[2] == "95":  # the 95 % band's, see `cavity_columns`
        return None
    words = found[1].replace("_", " ")
    return described(column, (f"{words} of cavity{found[2]}", f"of the device's cavity{found[2]} alone"))


def _rise_term(column: str, device: Actuator | None) -> Term | None:
    probe, unit = split(column)
    if device is None or unit != "mm" or probe not in device.probes:
        return None
    return described(
        column, (f"rise of the {probe.replace('_', ' ')}", "displacement of that point along the device's lift")
    )


def _device_term(column: str, device: Actuator | None) -> Term | None:
    if device is not None and column in device.figure_texts:
        return described(column, device.figure_texts[column])
    for texts in (*(measure.texts for measure in MEASURES), *(kind.figure_texts for kind in PARTS.values())):
        for pattern, (title, text) in texts.items():
            if found := re.fullmatch(pattern, column):
                return described(column, (title.format(*found.groups()), text.format(*found.groups())))
    return None


def _named_term(column: str, device: Actuator | None) -> Term | None:
    """Of a point, an angle or a rigid part that the user has named."""
    name, unit = split(column)
    if unit == "mm" and (found := re.fullmatch(r"(\w+)_([xyz])", name)):
        text = "of a named point its place in this state, of a rigid part how far its centre has moved"
        return described(column, (f"{found[1].replace('_', ' ')}, {found[2]}", text))
    if unit == "mm" and name.endswith("_off"):
        text = "how far from where that point was named the place on the surface lies that is followed, undeformed"
        return described(column, (f"{name.removesuffix('_off').replace('_', ' ')}, off the surface", text))
    if unit == "°":
        return described(
            column, (name.replace("_", " "), "named angle: by how much its line has turned, or between its two lines")
        )
    return None


def _band_term(column: str, device: Actuator | None) -> Term | None:
    name, unit = split(column)
    if not name.endswith("_95") or not unit:
        return None
    if device is not None and column == at_rise(device.gauge):
        text = f"half the 95 % interval that the material's errors make, at the same rise of the {device.gauge}"
        return described(column, ("band of the pressure at equal rise", text))
    whole = term(f"{name.removesuffix('_95')}{column.removeprefix(name)}", device)
    kept = "at the same added volume" if name == "pressure_95" else "at the same requested value"
    return described(
        column, (f"band of the {whole.name}", f"half the 95 % interval that the material's errors make, {kept}")
    )


def _extremes(name: str) -> list[Column]:
    """The columns of an output field's least and largest values."""
    field = next(field for field in FIELDS if field.name == name)
    return [_extreme(field, one) for one in field.extremes]


def _extreme(field: OutputField, one: Extreme) -> Column:
    def value(solved: Solved) -> float:
        if one.peak:
            return solved.figures.peaks[field.name] / one.unit
        return solved.figures.extremes[field.name][0 if one.least else 1] / one.unit

    return Column(one.column, one.title, one.text, value)


def _place_of_largest(axis: str) -> Column:
    i = "xyz".index(axis)
    return Column(
        f"max_stretch_{axis}_mm", f"place of the largest stretch, {axis}", "in the undeformed device",
        lambda s: s.figures.max_stretch_at[i] * 1e3,
    )  # fmt: skip


def _break_margin(solved: Solved) -> float | None:
    limit = stretch_at_break(solved.case.material)
    return None if limit is None else limit / solved.figures.max_stretch


def _eigenvalue(solved: Solved) -> float | None:
    """In Pa/mm2; nothing where it was not found to within its tolerance."""
    eq, lowest = solved.fields.system, solved.point.signature.lowest
    return None if math.isnan(lowest) else float(lowest * eq.stress_unit / (eq.length_unit * 1e3) ** 2)


def _supplied(case: Case) -> bool:
    return case.supply is not None


def _gas(case: Case) -> bool:
    return case.supply is not None and case.supply.stores_energy


DEVICE = Columns(lambda s: s.figures.device, _device_term)
NAMED = Columns(lambda s: {}, _named_term)
"""Named points and angles: their values are among the device's."""

BAND = Columns(lambda s: s.band, _band_term)
"""Last in the file."""

COLUMNS: list[Column | Columns] = [
    Column("step", "step", "number of the state along the path, from rest", lambda s: s.number),
    Column("pressure_cm", "pressure",
           "of the air in the cavity, as the height of the water column that balances it", _height),
    Column("pressure_Pa", "pressure", "the same in pascal, above the pressure around", lambda s: s.pressure),
    Column("added_volume_ml", "added volume", "volume of the whole device's cavities less that at rest; with pressure ratios, "
           "what the common pressure works on", lambda s: s.figures.added_volume * 1e6),
    Column("stroke_ml", "stroke", "volume that the {supply} has displaced or let in",
           lambda s: _stroke(s) * 1e6, _supplied),
    Column("gas_energy_mJ", "gas energy", "work stored in the gas of {supply}, tubes and cavity", _gas_energy, _gas),
    Column("stroke_limit", "stroke limit",
           "1 where the stroke has a limit point of its own: beyond it the device jumps",
           lambda s: int(s.point.turn), _supplied),
    Column("stable_under_supply", "stable under the {supply}",
           "1 if the gas behind this state holds it, 0 if the device jumps", _held, _supplied),
    Column("load_step", "load step", "how many steps a program of several cavities has come",
           lambda s: s.load_step, lambda case: bool(case.program)),
    Columns(_cavity_cells, _cavity_term),
    Columns(lambda s: {f"{name}_mm": rise * 1e3 for name, rise in s.figures.rises.items()}, _rise_term),
    DEVICE,
    Column("max_displacement_mm", "largest displacement", "longest displacement of any node",
           lambda s: s.figures.max_displacement * 1e3),
    *_extremes("largest_stretch"),
    Column("break_margin", "break margin",
           "stretch at which the silicone broke when pulled over the largest one; below 1 it tears",
           _break_margin, lambda case: stretch_at_break(case.material) is not None),
    *(_place_of_largest(axis) for axis in "xyz"),
    *_extremes("von_mises"),
    *_extremes("J"),
    Column("newton_iterations", "Newton iterations", "that the equilibrium of this state took",
           lambda s: s.point.state.iterations),
    Column("stored_energy_mJ", "stored energy", "elastic energy of the whole device",
           lambda s: s.figures.stored_energy * 1e3),
    Column("least_gap_mm", "least gap",
           "smallest distance between walls that face each other across air, below zero where they overlap; empty where none "
           "is near another", lambda s: None if s.gap is None else s.gap.value * 1e3),
    Column("walls_touch", "walls overlap",
           f"1 where walls pass through each other by more than {OVERLAP:.0%} of their thickness: the state is not real",
           lambda s: int(s.gap is not None and s.gap.overlaps)),
    Column("requested", "requested", "1 for a state that was asked for", lambda s: int(s.point.requested)),
    Column("limit", "limit point",
           "1 where the pressure has a maximum or minimum: under a pressure alone the device jumps",
           lambda s: int(s.point.limit)),
    Column("jump", "jump", "1 for the state of rest in which a jump landed", lambda s: int(s.point.jump)),
    Column("bifurcation", "bifurcation", "1 where another branch of equilibria leaves the path, for another shape",
           lambda s: int(s.point.bifurcation)),
    Column("stable_under_pressure", "stable under a pressure", "1 if the state stands while the pressure is kept",
           lambda s: int(s.point.stable_under_pressure)),
    Column("stable_under_volume", "stable under a volume",
           "1 if the state stands while the amount of liquid in the cavity is kept",
           lambda s: int(s.point.stable_under_volume)),
    Column("negative_eigenvalues", "negative eigenvalues",
           "in how many independent directions the energy at this pressure falls: 0 is stable, each more is one way out",
           lambda s: s.point.signature.negative_eigenvalues),
    Column("lowest_eigenvalue_Pa_per_mm2", "lowest eigenvalue",
           "of the tangent at this pressure; zero where stability is lost", _eigenvalue),
    Column("following", "following", "what the step followed: pressure, volume, a supply's line or the arc length",
           lambda s: s.point.line),
    BAND,
]  # fmt: skip
"""In the order of the file."""
