"""The case of a report: device, material, load and solver as tables with units."""

from __future__ import annotations

from collections.abc import Sequence

from geometries import codec
from geometries import table as geometry_table
from geometries.fields import about
from measurement.units import readable
from softmodels.case import material_table
from softmodels.materials.material import parameter_fields
from softmodels.path.program import named
from softmodels.results.stored import States

Table = tuple[str, list[tuple[str, str, str]]]
"""A heading, and for each parameter its name, its value and what it is."""


def case_tables(states: States) -> list[Table]:
    """All tables of a case."""
    return [_device(states), _material(states), _load(states)]


def _device(states: States) -> Table:
    device = states.actuator
    table = geometry_table.to_table(device, readable)
    fields = about(device)
    rows = [(name, value, fields[name].help) for name, value in table.items() if name != "device"]
    return _parameters(f"Device: {type(device).__name__}", rows)


def _material(states: States) -> Table:
    material = states.case.material
    table = material_table.to_table(material, readable)
    texts = {field.name: field.metadata["help"] for field in parameter_fields(material)}
    texts["fitted_stretch"] = "range of stretch that the law was fitted over"
    rows = [(name, value, texts.get(name, "")) for name, value in table.items() if name != "law"]
    initial = f"{material.shear_modulus_0 / 1e3:.4g} kPa"
    return _parameters(
        f"Material: {material.name}", [*rows, ("initial shear modulus", initial, "of all terms together")]
    )


def _load(states: States) -> Table:
    case = states.case
    asked = [(case.load.requested.words, case.values, case.unit)]
    if case.program:
        asked = [
            (name, series.values, f"{series.unit}{' added' if series.key == 'volume_ml' else ''}")
            for name, series in named(case.program).items()
        ]
    rows = [
        *(
            (what, ", ".join(f"{value:g}" for value in values) + f" {unit}", "requested")
            for what, values, unit in asked
        ),
        *(
            [("water density", f"{case.water_density:g} kg/m^3", f"1 cm is {case.cm:.4g} Pa")]
            if case.load.has_pressure
            else []
        ),
        ("control", case.control, "what the path follows"),
        ("formulation", case.formulation, "unknowns of the equations"),
    ]
    if case.sheet is not None:
        rows.append(("sheet", f"{case.sheet.face}, {case.sheet.stiffness:g} N/m", "bonded thin sheet"))
    if case.obstacle is not None:
        rows.append(("contact", f"{case.obstacle.faces} on {case.obstacle.plane}", "rigid plane without friction"))
        unit = "shear moduli of pressure per sinking in by one size of the device"
        rows.append(("contact stiffness", f"{case.obstacle.stiffness:g}", unit))
    for part in case.parts:
        words, texts = part.write_table(readable), part.explained
        rows += [(f"{part.where.strip('[]')} {name}", str(value), texts.get(name, "")) for name, value in words.items()]
    if case.supply is not None:
        texts = {field.key or name: field.help for name, field in about(case.supply).items()}
        rows += [(name, value, texts[name]) for name, value in codec.to_table(case.supply, readable).items()]
    return _parameters("Load and solver", rows)


def _parameters(title: str, rows: Sequence[tuple[str, object, str]]) -> Table:
    return title, [(name.replace("_", " "), _text(value), words) for name, value, words in rows]


def _text(value: object) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(map(_text, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)
