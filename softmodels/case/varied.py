"""The numbers of a case that a design may vary: of its device, its silicone, and its parts.

Those of the device have their own names (`geometries.actuator.parameter_names`). A number of a part is called by the part's
table, such as ``fibres.angle``, ``fibres.braid.angle`` or ``region.base.c1``; one of the silicone is ``material.c1``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from geometries.actuator import changed, parameter, parameter_names
from softmodels.case.case import Case
from softmodels.common.schema import about
from softmodels.mechanics.component import Component
from softmodels.mechanics.regions import number_of, variable_numbers, with_number
from softmodels.mechanics.sensitivity import RATIO

MATERIAL = "material"


def variable_names(case: Case) -> dict[str, str]:
    """Return the SI units of all numbers that may vary by their names; angles in degrees, empty units of pure numbers."""
    units = {name: _unit_of(case, name) for name in parameter_names(case.actuator)}
    units |= {f"{MATERIAL}.{name}": unit for name, unit in variable_numbers(case.material).items()}
    return units | {f"{part.key}.{name}": unit for part in case.components for name, unit in part.variable.items()}


def _unit_of(case: Case, name: str) -> str:
    """Return the unit of a device's number; a list's entries are pure numbers unless their kind has a unit."""
    kind = about(case.actuator)[name.partition("[")[0]].kind
    return kind.unit or str(getattr(getattr(kind, "of", None), "unit", ""))


def of_shape(case: Case, name: str) -> bool:
    """Return whether a number decides the device's shape."""
    return "." not in name and name not in case.actuator.ratio_parameters


def value_of(case: Case, name: str) -> float:
    """Return a number's value; `GeometryError` if the device has no such parameter."""
    where, _, own = name.rpartition(".")
    if not where:
        return parameter(case.actuator, name)
    return number_of(case.material, own) if where == MATERIAL else _part(case, where).number(own)


def varied(case: Case, values: Mapping[str, float]) -> Case:
    """Return a case with other values of its numbers; an error of the device, part, material or case if they are invalid."""
    device = {name: value for name, value in values.items() if "." not in name}
    material, components = case.material, {part.key: part for part in case.components}
    for name, value in values.items():
        where, _, own = name.rpartition(".")
        if where == MATERIAL:
            material = with_number(material, own, value)
        elif where:
            components[where] = components[where].varied(own, value)
    actuator = changed(case.actuator, device) if device else case.actuator
    return dataclasses.replace(case, actuator=actuator, material=material, components=tuple(components.values()))


def _part(case: Case, key: str) -> Component:
    return next(part for part in case.components if part.key == key)


def in_equations(case: Case, name: str) -> dict[str, float]:
    """Return the numbers of the equations (`Sensitivity.force`) that a number of no length sets, with their derivatives by
    it."""
    where, _, own = name.rpartition(".")
    if where:
        return {own if where == MATERIAL else name: 1.0}
    value = parameter(case.actuator, name)
    step = 1e-3 * max(abs(value), 1.0)
    ends = [changed(case.actuator, {name: value + sign * step}).ratios for sign in (1.0, -1.0)]
    rates = [(high - low) / (2 * step) for high, low in zip(*ends, strict=True)]
    return {f"{RATIO}.{i}": rate for i, rate in enumerate(rates) if rate}
