"""What is asked of a dead load: forces, moments, shares of the weight, or how far they move what they act on."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, MutableMapping

from geometries.errors import FieldError
from geometries.fields import About
from geometries.kinds import Quantity, Text, Words
from measurement.arguments import checked
from softmodels.case.entries import MISSING, Entry, Missing, Option, SeriesKind, Tables, Written, table_of
from softmodels.mechanics.dead_loads import LoadPart
from softmodels.mechanics.parts import Part
from softmodels.path.program import EVERY_KEY, LOAD_KEYS

ASKED = {
    "force_N": "forces in N on a face (--force), in place of pressures: 0:10 or 0,2,5",
    "travel_mm": "how far the face of the force moves along it in mm, in place of forces",
    "moment_Nmm": "moments in N mm on a face (--moment), in place of pressures",
    "turn_deg": "how far the face of the moment turns in degrees, in place of moments",
    "share": "shares of the weight (--gravity), in place of pressures: 0:1",
}
"""What can be requested of a dead load, with the help of its option."""
WORDS = {"force_N": "forces", "travel_mm": "travels", "moment_Nmm": "moments", "turn_deg": "turns", "share": "shares"}
OPTIONS = {"share": "weight_share"}
"""Names of the options where they are not the key."""


@checked
@dataclasses.dataclass(frozen=True)
class LoadRequest:
    """Requested values of one dead load, all others kept.

    Attributes:
        key: One of `ASKED`.
        values: In the key's unit, rising.
        on: Name of the load, where the device has several of the kind.
        at_pressure_cm: Pressure in cm of the column that is applied before and kept.
    """

    key: str
    values: tuple[float, ...]
    on: str = ""
    at_pressure_cm: float = 0.0

    @property
    def table(self) -> str:
        """The table of the loads that it can be of."""
        return next(table for table, keys in LOAD_KEYS.items() if self.key in keys)

    @property
    def held(self) -> bool:
        """Whether a travel is asked for, and not a force."""
        return EVERY_KEY[self.key].held

    def of(self, parts: tuple[Part, ...]) -> LoadPart:
        """The load.

        Raises:
            FieldError: There is none, or several.
        """
        found = [part for part in parts if isinstance(part, LoadPart) and part.table == self.table]
        named = [part for part in found if not self.on or part.name == self.on]
        if len(named) == 1:
            return named[0]
        if not found:
            raise FieldError(
                f"{WORDS[self.key]} are requested ({self.key}) and the device has no [{self.table}]; add one"
                f" (--{self.table})"
            )
        names = ", ".join(part.name or "without a name" for part in found)
        raise FieldError(
            f'{self.key} is of one {self.table} of the case, which has {names}; say which (on = "{found[0].name}")'
        )

    def column(self, load: LoadPart) -> str:
        """Column of ``path.csv`` with the requested values."""
        if self.key == "share":
            return load.share_column
        return load.travel_column if self.held else load.column


class LoadRequestEntry(Entry[LoadRequest | None]):
    """Requested values of a dead load, in the table of the load."""

    tables = ("load",)
    more = ("on", "at_pressure_cm")

    def known(self, key: str) -> bool:
        return key in ASKED or key in self.more

    def read(self, tables: Tables) -> LoadRequest | Missing | None:
        table = table_of(tables, "load")
        return self._made({key: table[key] for key in (*ASKED, *self.more) if key in table})

    def write(self, value: LoadRequest | None, text: Text) -> Written:
        if value is None:
            return {}
        written: dict[str, object] = {value.key: list(value.values)}
        written |= {"on": value.on} if value.on else {}
        return {"load": {**written, **({"at_pressure_cm": value.at_pressure_cm} if value.at_pressure_cm else {})}}

    def options(self) -> Iterator[Option]:
        for key, text in ASKED.items():
            yield Option(OPTIONS.get(key, key), About(SeriesKind(), text), metavar="SERIES")
        yield Option(
            "on", About(Words(), "name of the load that these are of, where a case has several"), metavar="NAME"
        )
        text = "pressure in cm of water that is applied first and kept, for forces on an inflated device"
        yield Option("at_pressure_cm", About(Quantity(), text))

    def arguments(self, field: str) -> dict[str, str]:
        return {OPTIONS.get(key, key): f"{field}={LoadRequest.__name__}(...)" for key in (*ASKED, *self.more)}

    def take(self, options: MutableMapping[str, object]) -> LoadRequest | Missing | None:
        given = {key: options.pop(OPTIONS.get(key, key), None) for key in (*ASKED, *self.more)}
        return self._made({key: value for key, value in given.items() if value is not None})

    def _made(self, given: dict[str, object]) -> LoadRequest | Missing | None:
        asked = [key for key in ASKED if key in given]
        if not asked:
            if given:
                raise FieldError(
                    f'{next(iter(given))} belongs to requested forces, such as force_N = "0:10" (--force-N)'
                )
            return MISSING
        if len(asked) > 1:
            raise FieldError(f"request one of {' and '.join(asked)}; for several things in turn write a program")
        values = SeriesKind().read(asked[0], given[asked[0]])
        on = Words().settled("on", given.get("on", ""))
        pressure = Quantity().read("at_pressure_cm", given.get("at_pressure_cm", 0.0))
        if pressure < 0.0:
            raise FieldError(f"at_pressure_cm is {pressure:g}; it must be 0 or more, suction is not modelled")
        return LoadRequest(asked[0], values, on, pressure)
