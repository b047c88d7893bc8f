"""Tolerances of a case: how well the lengths of the made device and the readings of the bench are known."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Self

from geometries import Actuator, actuator
from softmodels.case import load
from softmodels.case.entries import MISSING, CaseError, Entry, Missing, Tables, Written, table_of
from softmodels.common import errors, schema, units
from softmodels.common.names import checked
from softmodels.path.steps import PRESSURE

PROCESS, GAUGE, COLUMN = "process", "gauge", "water_density"
"""Keys of a table of tolerances beside the device's lengths."""
READINGS = (GAUGE, COLUMN)
"""Tolerances of the pressure that is read."""
PROCESSES: Mapping[str, tuple[float, float]] = MappingProxyType(
    {"resin": (0.1e-3, 0.001), "filament": (0.3e-3, 0.005), "machined": (0.05e-3, 0.0005)}
)
"""Tolerance of a mould's lengths by how it is made, m and relative to the length; the larger one counts. They are what services
promise for resin printed layer by layer, for filament, and for milling; a coupon measured on the own machine is better."""


@dataclasses.dataclass(frozen=True)
class Deviation:
    """Half of the 95 % interval of a length in m, or of a pressure: in Pa, or relative to the reading; and as written."""

    name: str
    half: float
    share: float
    text: str

    def of_pressure(self, pressure: float) -> float:
        """Return it at a pressure that is read, Pa."""
        return self.half + self.share * abs(pressure)


@checked
@dataclasses.dataclass(frozen=True)
class Tolerances:
    """Half widths of 95 % intervals, as written, by what they are of: lengths of the device, ``"gauge"`` and
    ``"water_density"``; and the ``process`` by which the mould was made, for all other lengths, or ""."""

    texts: tuple[tuple[str, str], ...] = ()
    process: str = ""

    def __post_init__(self) -> None:
        if self.process and self.process not in PROCESSES:
            raise CaseError(f"[tolerance] process is {self.process!r}; {errors.known_are(self.process, PROCESSES)}")
        if not self.texts and not self.process:
            raise CaseError(
                "[tolerance] is empty; name a length and its tolerance, such as membrane = '0.1 mm', or the process by which "
                f"the mould was made ({', '.join(PROCESSES)})"
            )

    @classmethod
    def of(cls, table: Mapping[str, object]) -> Self:
        """Return the tolerances of a table, such as ``{"membrane": "0.1 mm", "gauge": "1 %"}``; `CaseError` for a value that is
        no text."""
        if wrong := next((name for name, value in table.items() if not isinstance(value, str)), None):
            raise CaseError(f"tolerance of {wrong} is {table[wrong]!r}; write it with its unit, such as '0.1 mm' or '5 %'")
        texts = {name: str(value) for name, value in table.items()}
        process = texts.pop(PROCESS, "")
        return cls(tuple(texts.items()), process)

    def deviations(self, device: Actuator, cm: float) -> list[Deviation]:
        """Return them in SI for a device, ``cm`` being Pa in one cm of the column: lengths in the order of the device's fields,
        then the bench; `CaseError` for an unknown name, or a tolerance that is none."""
        lengths = [name for name in device.movable if actuator.is_length(device, name)]
        given = dict(self.texts)
        if unknown := next((name for name in given if name not in (*lengths, *READINGS)), None):
            what = f"the mesh of this {type(device).__name__} follows no length {unknown!r}"
            raise CaseError(f"[tolerance] {what}; {errors.known_are(unknown, [*lengths, *READINGS])}")
        made = [_length(device, name, given[name]) for name in lengths if name in given]
        made += [_by_process(device, name, self.process) for name in lengths if self.process and name not in given]
        return made + [_reading(name, given[name], cm) for name in READINGS if name in given]


def _length(device: Actuator, name: str, text: str) -> Deviation:
    share, value = percentage(name, text), actuator.parameter(device, name)
    half = _read(name, text, "m") if share is None else share * abs(value)
    if not 0.0 < half < abs(value):
        raise CaseError(f"tolerance of {name} is {text!r}; it must be above 0 and below {schema.shown(abs(value), 'm')}")
    return Deviation(name, half, 0.0, units.readable(half, "m"))


def _by_process(device: Actuator, name: str, process: str) -> Deviation:
    least, share = PROCESSES[process]
    value = abs(actuator.parameter(device, name))
    half = min(max(least, share * value), 0.5 * value)
    return Deviation(name, half, 0.0, units.readable(half, "m"))


def _reading(name: str, text: str, cm: float) -> Deviation:
    share, half = percentage(name, text), 0.0
    if share is None and name == COLUMN:
        share = _read(name, text, "kg/m^3") * 0.01 * units.STANDARD_GRAVITY / cm
    elif share is None:
        share, half = 0.0, abs(load.prescribed(PRESSURE, [text], cm, falls=True).values[0])
    if not (half > 0.0 or 0.0 < share < 1.0):
        raise CaseError(f"tolerance of {name} is {text!r}; it must be above 0, and below 100 %")
    return Deviation(name, half, share, text)


def percentage(name: str, text: str) -> float | None:
    """Return a percentage relative to 1; None for a text without the sign."""
    if not text.rstrip().endswith("%"):
        return None
    try:
        return units.number(text.rstrip()[:-1].strip()) / 100.0
    except units.UnitError as error:
        raise CaseError(f"tolerance of {name}: {error}") from None


def _read(name: str, text: str, unit: str) -> float:
    try:
        return units.quantity(text, unit)
    except units.UnitError as error:
        raise CaseError(f"tolerance of {name}: {error}") from None


class TolerancesEntry(Entry[Tolerances | None]):
    """The table ``[tolerance]``: the name of each length or reading with its half width, and ``process``."""

    tables = ("tolerance",)

    def read(self, tables: Tables) -> Tolerances | Missing:
        return Tolerances.of(table_of(tables, "tolerance")) if "tolerance" in tables else MISSING

    def write(self, value: Tolerances | None, text: schema.Text) -> Written:
        if value is None:
            return {}
        return {"tolerance": {**({PROCESS: value.process} if value.process else {}), **dict(value.texts)}}
