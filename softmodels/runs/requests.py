"""What is asked of a device, as a notebook writes it, made into a case: arrays in SI, or texts with a unit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypedDict, Unpack

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from measurement.units import WATER_DENSITY, UnitError, brief, pascal_per_cm, quantity
from softmodels.case.case import Case, CaseError
from softmodels.case.gauges import Gauges
from softmodels.case.material_errors import AnyBand, band_of
from softmodels.case.ranges import ML, SeriesError, factor_of, of_text, series, split_text
from softmodels.materials.laws import Material
from softmodels.mechanics.contact import Obstacle
from softmodels.mechanics.parts import Part
from softmodels.mechanics.sheet import Sheet
from softmodels.path.program import Program
from softmodels.path.syringe import Syringe

type Values = str | float | Sequence[float] | npt.NDArray[np.float64]
"""Requested values: a text with a unit such as ``"0:177 cm"``, or numbers in SI units."""


class Options(TypedDict, total=False):
    """The fields of a `Case` that a call may give beside device, material and load."""

    strokes: Values
    supply: Syringe
    name: str
    control: str
    formulation: str
    solver: str
    sheet: Sheet
    obstacle: Obstacle
    parts: Sequence[Part]
    band: AnyBand | str | Path
    cycle: bool
    program: Program
    gauges: Gauges
    water_density: float


def case_of(
    device: Actuator,
    material: Material,
    pressures: Values | None = None,
    volumes: Values | None = None,
    **options: Unpack[Options],
) -> Case:
    """A case.

    Args:
        device: The device.
        material: Its silicone.
        pressures: Requested pressures: numbers in Pa, or a text in cm of the water column or in a unit of pressure.
        volumes: Requested added volumes of the cavity: numbers in m3, or a text.
        options: ``strokes`` of a syringe (m3, or a text) with the ``supply``; other fields of a `Case` by their names.

    Raises:
        CaseError: What cannot be meant.
    """
    chosen = {key: value for key, value in options.items() if value is not None and key != "strokes"}
    cm = pascal_per_cm(options.get("water_density", WATER_DENSITY))
    fields = {
        "name": device.stem,
        "pressures_cm": _in("cm", pressures, "pressure", cm),
        "volumes_ml": _in("ml", volumes, "volume", cm),
        "strokes_ml": _in("ml", options.get("strokes"), "stroke", cm),
        **chosen,
    }
    if isinstance(band := fields.get("band"), str | Path):
        fields["band"] = band_of(band)
    return Case(actuator=device, material=material, **fields)  # type: ignore[arg-type]


def one_value(text: str, pascal_in_cm: float) -> tuple[str, float]:
    """Whether a text such as ``"70 cm"`` is a ``"pressure"`` (Pa) or a ``"volume"`` (m3), and its value.

    Raises:
        CaseError: Neither.
    """
    number, unit = split_text(text)
    if unit == "cm":
        return "pressure", _scaled(number, "pressure") * pascal_in_cm
    for what, si in (("pressure", "Pa"), ("volume", "m^3")):
        if (factor := factor_of(unit, si)) is not None:
            return what, _scaled(number, what) * factor
    raise CaseError(f"{brief(text)} is no pressure and no volume; write it like 70 cm, 7 kPa or 40 ml")


def _scaled(number: str, what: str) -> float:
    try:
        return quantity(number, "")
    except UnitError as error:
        raise CaseError(f"{what} {brief(number)}: {error}") from None


def _in(unit: str, values: Values | None, what: str, pascal_in_cm: float) -> tuple[float, ...]:
    """Requested values in cm of the column or in ml, as a case has them."""
    if values is None:
        return ()
    try:
        if isinstance(values, str):
            return of_text(unit, values, what, pascal_in_cm)
        return series(_numbers(values, what, 1 / pascal_in_cm if unit == "cm" else 1 / ML), what)
    except (SeriesError, UnitError) as error:
        raise CaseError(str(error)) from None


def _numbers(values: float | Sequence[float] | npt.NDArray[np.float64], what: str, scale: float) -> list[float]:
    try:
        return [float(value) * scale for value in np.atleast_1d(values)]
    except (TypeError, ValueError):
        raise CaseError(f"{what} {brief(values)} is neither numbers nor a text with a unit") from None
