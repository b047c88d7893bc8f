"""Requested pressures as text: in cm of the column, or in any unit of pressure."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, MutableMapping

from geometries.errors import FieldError
from geometries.fields import About
from geometries.kinds import Quantity, Words
from measurement.units import WATER_DENSITY, brief, pascal_per_cm
from softmodels.case.entries import Option, Tables, Value, table_of
from softmodels.case.ranges import SeriesError, of_text, one_of_text, series

WITH_UNIT = "pressure"
"""Key and option of pressures that carry their unit."""
DENSITY = "water_density"
"""Key and option of the density of the column's liquid."""


@dataclasses.dataclass(frozen=True)
class Pressures(Value):
    """``pressure_cm``, heights of the column; or ``pressure`` with a unit, such as ``"0:4 kPa"``."""

    @property
    def keys(self) -> tuple[str, ...]:
        return self.key, WITH_UNIT

    def read(self, tables: Tables) -> object:
        table = table_of(tables, self.table)
        if WITH_UNIT not in table:
            return super().read(tables)
        return self._in_cm(table[WITH_UNIT], table.get(self.key), table.get(DENSITY, WATER_DENSITY))

    def options(self) -> Iterator[Option]:
        yield from super().options()
        text = "pressures with their unit, in place of heights of a column: 0:4kPa or 0,1,2kPa"
        yield Option(WITH_UNIT, About(Words(), text), metavar="SERIES")

    def arguments(self, field: str) -> dict[str, str]:
        return {**super().arguments(field), WITH_UNIT: f"{self.what}s"}

    def take(self, options: MutableMapping[str, object]) -> object:
        given, plain = options.pop(WITH_UNIT, None), options.get(self.key)
        if given is None:
            return super().take(options)
        options.pop(self.key, None)
        density = options.get(DENSITY)
        return self._in_cm(given, plain, WATER_DENSITY if density is None else density)

    def _in_cm(self, given: object, plain: object, density: object) -> tuple[float, ...]:
        if plain is not None:
            raise FieldError(f"pressures are requested twice, as {WITH_UNIT} and as {self.key}; leave one of them out")
        cm = pascal_per_cm(density if isinstance(density, float) else Quantity("kg/m^3").read(DENSITY, density))
        if isinstance(given, str):
            return of_text("cm", given, self.what, cm)
        if isinstance(given, list | tuple) and given and all(isinstance(one, str) for one in given):
            return series([one_of_text("cm", str(one), self.what, cm) for one in given], self.what)
        raise SeriesError(
            f'{WITH_UNIT} {brief(given)} has no unit; write it like "0:4 kPa" or ["1 kPa", "2 kPa"], or give {self.key}'
        )
