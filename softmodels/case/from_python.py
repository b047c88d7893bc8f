"""What is asked of a device as Python writes it, made into a case: arrays in SI units, or texts with a unit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypedDict, Unpack

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from softmodels.case.case import Case
from softmodels.case.entries import ML, CaseError, SeriesError, factor_of, of_text, one_of_text, series, split_text
from softmodels.case.load import LoadRequest, of_cavities
from softmodels.case.materials import AnyBand, band_of
from softmodels.case.requests import Probes
from softmodels.common.errors import FieldError, meant
from softmodels.common.names import doubt, one_of
from softmodels.common.schema import Quantity
from softmodels.common.units import FACTORS, WATER_DENSITY, UnitError, brief, number, pascal_per_cm, quantity
from softmodels.materials.laws import Material
from softmodels.mechanics.component import Component
from softmodels.path.program import VALVE, Program, from_tables, to_tables
from softmodels.path.supply import AirSupply

type Values = str | float | Sequence[float | str] | npt.NDArray[np.float64]
"""Requested values: a text with a unit such as ``"0:177 cm"``, texts such as ``["1 kPa", "2 kPa"]``, or numbers in SI units."""
SECONDS = Quantity("s")
LEAST_PRESSURE = 200.0
"""Pa; if all pressures given as numbers are below this, their unit is doubtful: most devices hardly move."""


class RequestOptions(TypedDict, total=False):
    """The fields of a `Case` that a call may give beside device, material and load."""

    strokes: Values | None
    driven: LoadRequest | None
    supply: AirSupply | None
    valve: Values | None
    name: str | None
    control: str
    formulation: str
    solver: str
    components: Component | Sequence[Component]
    band: AnyBand | str | Path | None
    load_unload: bool
    program: Program
    gauges: Probes | None
    water_density: float | str
    rate: str
    hold: float | str
    cycles: int
    time_tolerance: float


def case_of(
    device: Actuator,
    material: Material | str,
    pressures: Values | None = None,
    volumes: Values | None = None,
    times: Values | None = None,
    **options: Unpack[RequestOptions],
) -> Case:
    """A case.

    Args:
        device: The device.
        material: Its silicone, or the name of one.
        pressures: Requested pressures: numbers in Pa, or a text in cm of the water column or in a unit of pressure.
        volumes: Requested added volumes of the cavity: numbers in m3, or a text.
        times: When they are reached, in s or as texts; then they may fall too. A value that repeats is a hold.
        options: ``strokes`` of a syringe (m3, or a text) with the ``supply``; the opening of a supply's ``valve`` at the times;
            other fields of a `Case` by their names.

    Raises:
        ArgumentError, CaseError: Invalid input.
    """
    one_of("device", device, Actuator, "a device, such as sm.HollowDisk()")
    chosen = {key: value for key, value in options.items() if value is not None and key != "strokes"}
    try:
        density = Quantity("kg/m^3").settled("water_density", options.get("water_density", WATER_DENSITY))
    except FieldError as error:
        raise CaseError(str(error)) from None
    cm = pascal_per_cm(density)
    falls = times is not None
    asked = {
        "pressures_cm": in_unit("cm", pressures, "pressure", cm, falls),
        "volumes_ml": in_unit("ml", volumes, "volume", cm, falls),
    }
    if times is not None:
        chosen["program"] = _in_time(asked, times, len(device.ratios), options.get("supply"), options.get("valve"))
        chosen.pop("valve", None)
        asked = {}
    elif "valve" in chosen:
        raise CaseError("the valve opens and closes at times; give times too, one for each value")
    fields = {
        "name": device.stem,
        **({"pressures_cm": ()} if times is not None else asked),
        "strokes_ml": in_unit("ml", options.get("strokes"), "stroke", cm),
        **chosen,
    }
    if isinstance(band := fields.get("band"), str | Path):
        fields["band"] = band_of(band)
    case = Case(actuator=device, material=material, **fields)  # type: ignore[arg-type]
    _doubt_pressures(pressures, case)
    return case


def _in_time(
    asked: dict[str, tuple[float, ...]], times: Values, cavities: int, supply: AirSupply | None, valve: Values | None
) -> Program:
    """Return the program of requested values and their times."""
    given = {key: values for key, values in asked.items() if values}
    if len(given) != 1:
        raise CaseError("times belong to requested pressures or to added volumes; give one of these")
    (key, values), at = next(iter(given.items())), [SECONDS.settled("times", one) for one in _listed(times, "times")]
    if len(at) != len(values):
        raise CaseError(f"there are {len(values)} values but {len(at)} times; give one for each")
    key = {"pressures_cm": "pressure_cm", "volumes_ml": "volume_ml"}[key]
    if valve is not None and (supply is None or not supply.in_time):
        raise CaseError("a valve belongs to a supply in time; add supply=Reservoir()")
    opening = {} if valve is None else {VALVE: _listed(valve, "valve")}
    return from_tables({**to_tables(of_cavities(key, values, tuple(at), cavities, supply)), **opening})


def _doubt_pressures(pressures: Values | None, case: Case) -> None:
    """Warn of pressures so small that their unit is doubtful."""
    plain = isinstance(pressures, int | float) or (
        pressures is not None and not isinstance(pressures, str) and not any(isinstance(one, str) for one in pressures)
    )
    highest = float(np.max(np.asarray(pressures, dtype=float))) if plain else LEAST_PRESSURE
    if highest < LEAST_PRESSURE:
        doubt(
            f"the highest pressure is {highest:.4g} Pa, {highest / case.cm:.2g} cm of water; numbers are in Pa, so write "
            f"another unit as a text such as '{highest:g} kPa' or '{highest:g} cm'"
        )


def one_value(text: str, pascal_in_cm: float) -> tuple[str, float]:
    """Return whether a text such as ``"70 cm"`` is a ``"pressure"`` (Pa) or a ``"volume"`` (m3), and its value.

    Raises:
        CaseError: Neither.
    """
    number, unit = split_text(text)
    if unit == "cm":
        return "pressure", _scaled(number, "pressure") * pascal_in_cm
    for what, si in (("pressure", "Pa"), ("volume", "m^3")):
        if (factor := factor_of(unit, si)) is not None:
            return what, _scaled(number, what) * factor
    raise CaseError(
        f"{brief(text)} is neither a pressure nor a volume; write it like 70 cm, 7 kPa or 40 ml"
        + meant(unit, ["cm", *FACTORS["Pa"], *FACTORS["m^3"]])
    )


def _scaled(number: str, what: str) -> float:
    try:
        return quantity(number, "")
    except UnitError as error:
        raise CaseError(f"{what} {brief(number)}: {error}") from None


def in_unit(unit: str, values: Values | None, what: str, pascal_in_cm: float, falls: bool = False) -> tuple[float, ...]:
    """Return the requested values in cm of the column or in ml, as a case has them; a list may fall if ``falls``.

    Raises:
        CaseError: Invalid values.
    """
    if values is None:
        return ()
    scale = 1 / pascal_in_cm if unit == "cm" else 1 / ML
    try:
        if isinstance(values, str):
            return of_text(unit, values, what, pascal_in_cm)
        found = [
            one_of_text(unit, one, what, pascal_in_cm) if isinstance(one, str) else number(one) * scale
            for one in _listed(values, what)
        ]
        if not found:
            raise CaseError(f"the list of {what}s is empty; give at least one value, such as {EXAMPLES[unit]}")
        return tuple(found) if falls else series(found, what)
    except (SeriesError, UnitError) as error:
        raise CaseError(str(error)) from None


EXAMPLES = {"cm": "'0:177 cm'", "ml": "'0:60 ml'"}


def _listed(values: object, what: str) -> list[object]:
    """Return the requested values as a list of Python's numbers and texts.

    Raises:
        CaseError: They are something else.
    """
    if not isinstance(values, list | tuple):
        if not hasattr(values, "tolist") and (isinstance(values, bool) or not isinstance(values, int | float)):
            raise CaseError(f"{what} {brief(values)} is neither numbers nor a text with a unit")
        values = np.asarray(values).tolist()
    flat = values if isinstance(values, list | tuple) else [values]
    plain = [one.item() if isinstance(one, np.generic) else one for one in flat]
    if not all(isinstance(one, int | float | str) and not isinstance(one, bool) for one in plain):
        raise CaseError(f"{what} {brief(values)} is neither numbers nor a text with a unit")
    return plain
