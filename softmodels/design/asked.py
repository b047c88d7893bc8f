"""What is asked of a design: quantities to be made large or small, and limits to be kept, from tables or as values."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import cast

from measurement.arguments import checked
from measurement.units import UnitError, brief, number_and_unit, quantity
from measurement.wording import known_are
from softmodels.case.case import Case
from softmodels.design.errors import DesignError
from softmodels.design.loads import PRESSURE, VOLUME, Load
from softmodels.design.quantities.base import Quantity
from softmodels.design.units import factor, read, shown_unit, text

CLEARANCES = "clearances"
"""Name of the quantity that has a value for each wall."""


MARGIN = "limit_margin"
"""Name of the quantity that is over the highest pressure anything is asked at."""


type Asked = Quantity
"""Something that is asked of a design."""


@dataclasses.dataclass(frozen=True)
class Term:
    """A quantity with its weight in the objective."""

    quantity: Asked
    weight: float


@checked
@dataclasses.dataclass(frozen=True)
class Keep:
    """A limit that a design has to keep.

    Attributes:
        quantity: What is limited.
        at_least, at_most: SI units; None for no limit.
    """

    quantity: Asked
    at_least: float | None = None
    at_most: float | None = None

    def keys(self, values: Mapping[str, float]) -> list[str]:
        """Keys of its values: one, or one for each wall."""
        if self.quantity.key in values:
            return [self.quantity.key]
        return [key for key in values if key.startswith(self.quantity.key.removesuffix("s") + ":")]


def shown(asked: Asked) -> str:
    """The unit in which people read a quantity."""
    return str(getattr(asked, "shown_unit", "") or shown_unit(asked.unit))


def in_words(asked: Asked, value: float, digits: int = 4) -> str:
    """A value of a quantity for people."""
    return text(value, shown(asked), asked.unit, digits)


def pressure_of(asked: Asked) -> float | None:
    """The pressure in Pa at which a quantity is taken; None where it is at none."""
    at = asked.at
    if at is None:
        return None
    load = Load.of(at)
    return load.value if load.kind == PRESSURE else None


def highest_pressure(asked: Asked) -> float | None:
    """The highest pressure in Pa at which a quantity, or what it is made of, is taken; None where it is at none."""
    found = [pressure_of(asked), *(pressure_of(part) for part in getattr(asked, "parts", ()))]
    return max((pressure for pressure in found if pressure is not None), default=None)


def label(asked: Asked, cm: float) -> str:
    """What a quantity is, with its pressure as the user wrote it; in cm of water, as on the bench, where it was a number."""
    pressure = pressure_of(asked)
    if pressure is None or asked.at is None:
        return asked.key
    return f"{asked.title} at {Load.of(asked.at).text or f'{pressure / cm:.5g} cm'}"


class Reader:
    """Reads quantities of a problem.

    Args:
        case: The case, for its column of water and its device.
        registry: Classes of quantities by name.
        bare: Whether numbers are taken for SI units.
        folder: From which a quantity's own file is counted.
    """

    def __init__(self, case: Case, registry: Mapping[str, type[Asked]], bare: bool, folder: Path | None):
        self.case, self.registry, self.bare, self.folder = case, registry, bare, folder

    def quantities(self, entry: object, where: str, more: Sequence[str] = ()) -> list[Asked]:
        """The quantities of a table, one for each pressure; a quantity that is given as a value stays.

        Args:
            entry: The table or the quantity.
            where: What the table is called.
            more: Entries that it may have beside those of the quantity.

        Raises:
            DesignError: An unknown quantity or entry, or one that is missing.
        """
        if not isinstance(entry, Mapping):
            if not hasattr(entry, "key") or not hasattr(entry, "unit"):
                raise DesignError(f"{where} is {brief(entry)}; it must be a quantity")
            return [self._checked(cast("Asked", entry), where)]
        kind = self._kind(entry.get("quantity"), where)
        fields = {field.name: field for field in dataclasses.fields(kind) if field.init}
        for key in entry:
            if key not in ("quantity", *fields, *more):
                names = [name for name in fields if name != "at" or _at_pressure(kind)]
                raise DesignError(f"{where} has an unknown entry {key!r}; {known_are(key, [*names, *more])}")
        given = {key: self._given(key, value) for key, value in entry.items() if key in fields and key != "at"}
        if "cm" in fields:  # of the column that a quantity's own file may count in
            given.setdefault("cm", self.case.cm)
        places: Sequence[object] = [None]
        if _at_pressure(kind):
            if "at" not in entry:
                raise DesignError(f'{where}: {kind.name} needs the pressure it is taken at, such as at = "177 cm"')
            at = entry["at"]
            places = [self._at(one, where) for one in (at if isinstance(at, list | tuple) else [at])]
            if not places:
                raise DesignError(f"{where}: at is empty; give a pressure, or several")
        elif "at" in entry:
            raise DesignError(f"{where}: {kind.name} is not taken at a pressure; leave at out")
        return [self._made(kind, {**given, **({} if place is None else {"at": place})}, where) for place in places]

    def _kind(self, name: object, where: str) -> type[Asked]:
        if name is None:
            raise DesignError(f"{where} names no quantity; {known_are('', self.registry)}")
        if not isinstance(name, str) or name not in self.registry:
            raise DesignError(f"{where}: quantity {brief(name)} is unknown; {known_are(name, self.registry)}")
        return self.registry[name]

    def _given(self, key: str, value: object) -> object:
        if key == "file":
            if not isinstance(value, str):
                raise DesignError(f"file is {brief(value)}; it must be a file's name")
            return value if self.folder is None else str(self.folder.resolve() / value)
        return _tuples(value)

    def _made(self, kind: type[Asked], values: Mapping[str, object], where: str) -> Asked:
        try:
            return self._checked(kind(**values), where)  # type: ignore[arg-type]  # the constructor checks
        except (ValueError, TypeError) as error:
            raise DesignError(str(error) if isinstance(error, DesignError) else f"{where}: {error}") from None

    def _checked(self, asked: Asked, where: str) -> Asked:
        """Refuse a probe or figure that the device does not have, and a pressure beyond the case's."""
        device, of = self.case.actuator, getattr(asked, "of", "")
        if of:
            known = [*device.probes, *device.device_figures(device.probes)]
            if of not in known:
                raise DesignError(
                    f"{where}: this {type(device).__name__} has no probe or figure {of!r}; {known_are(of, known)}"
                )
        if getattr(type(asked), "of_state", False) and asked.at is None:
            raise DesignError(f"{where}: {asked.name} needs the pressure it is taken at (at)")
        pressure, last = highest_pressure(asked), self.case.goals[-1]
        if pressure is not None and pressure > last * (1 + 1e-9):
            said, cm = getattr(asked.at, "text", ""), self.case.cm
            raise DesignError(
                f"{where}: {asked.title} is asked at {said or f'{pressure / cm:.5g} cm'}, above the case's last pressure, "
                f"{last / cm:.5g} cm ({last / 1e3:.5g} kPa)"
            )
        return asked

    def _at(self, value: object, where: str) -> object:
        """A pressure in Pa, or a `Load` of a text."""
        if not isinstance(value, str):
            return read(f"{where}: at", value, "Pa", self.bare)
        try:
            amount, unit = number_and_unit(value)
            if unit == "cm":
                return Load(PRESSURE, _positive(amount * self.case.cm, value, where), value)
            if unit and _is_volume(value):
                return Load(VOLUME, _positive(quantity(value, "m^3"), value, where), value)
            return Load(PRESSURE, _positive(quantity(value, "Pa"), value, where), value)
        except UnitError as error:
            raise DesignError(f"{where}: at is no pressure ({error}); write it like 177 cm or 17 kPa") from None

    def limit(self, entry: Mapping[str, object], side: str, asked: Asked, where: str) -> float | None:
        """The limit ``at_least`` or ``at_most`` in SI units; None where it is not given."""
        if entry.get(side) is None:
            return None
        return read(f"{where}: {side} of {asked.name}", entry[side], asked.unit, self.bare)


def _tuples(value: object) -> object:
    """Lists, and lists in them, as tuples."""
    return tuple(map(_tuples, value)) if isinstance(value, list | tuple) else value


def _at_pressure(kind: object) -> bool:
    return bool(getattr(kind, "of_state", False))


def _is_volume(value: str) -> bool:
    try:
        quantity(value, "m^3")
    except UnitError:
        return False
    return True


def _positive(value: float, said: str, where: str) -> float:
    if value <= 0.0:
        raise DesignError(f"{where}: at {said!r} is not above zero")
    return value


def check_limits(keep: Keep, where: str) -> None:
    """Refuse limits that cannot be meant.

    Raises:
        DesignError: None given, one above the other, or a margin below 1.
    """
    asked, low, high = keep.quantity, keep.at_least, keep.at_most
    if low is None and high is None:
        raise DesignError(f"{where}: {asked.title} has no limit; give at_least, at_most or both")
    if low is not None and high is not None and low > high:
        raise DesignError(
            f"{where}: {asked.title} is to be at least {in_words(asked, low)} and at most {in_words(asked, high)}, "
            "which nothing is; exchange them"
        )
    if asked.name == MARGIN and low is not None and low < 1.0:
        raise DesignError(
            f"{where}: a limit margin of at least {low:g} is below 1, and a device that jumps before its working pressure has "
            "no state there; ask for more than 1, such as 1.3"
        )


def shown_factor(asked: Asked) -> float:
    """SI units in one shown unit of a quantity."""
    return factor(shown(asked), asked.unit)
