"""How the fields of a case are written: each field names its entry, from which come table, option and messages.

An `Entry` reads a field from the tables of a case file or from the options of a command, and writes it. A field of another
kind is one line in `softmodels.case.case.Case`.
"""

from __future__ import annotations

import abc
import dataclasses
import enum
from collections.abc import Iterator, Mapping, MutableMapping
from typing import ClassVar, Final, Protocol

from geometries import Actuator, codec
from geometries.errors import FieldError
from geometries.fields import About, about
from geometries.kinds import Choice, Flag, Kind, Text, Words
from measurement.wording import known_are
from softmodels.case.ranges import series
from softmodels.path.air_supply import SUPPLIES, AirSupply, SupplyError
from softmodels.path.syringe import Syringe

type Tables = Mapping[str, object]
"""What a case file holds, by name: tables, and the case's name; see `table_of`."""
type Written = Mapping[str, Mapping[str, object]]
"""What is written into a case file, by table and key."""


class Missing(enum.Enum):
    """The type of `MISSING`."""

    MISSING = enum.auto()


MISSING: Final = Missing.MISSING
"""What an entry gives that is not there."""


def table_of(tables: Tables, name: str) -> Mapping[str, object]:
    """A table of a case file; an empty one where the file leaves it out.

    Raises:
        FieldError: It is no table.
    """
    table = tables.get(name, {})
    if not isinstance(table, Mapping):
        raise FieldError(f"{name} is {table!r}; it must be a table, which begins with a line [{name}]")
    return table


@dataclasses.dataclass(frozen=True)
class Option:
    """An option of a command line.

    Attributes:
        name: Its name, with underscores.
        about: Its kind and help.
        default: What stands in the help as its default.
        metavar: What stands for its value in the help.
    """

    name: str
    about: About
    default: object = None
    metavar: str | None = None


class Entry[V](abc.ABC):
    """The way of one field, with values V, to and from text.

    Attributes:
        tables: Tables of the case file that it reads.
    """

    tables: tuple[str, ...] = ()

    @abc.abstractmethod
    def read(self, tables: Tables) -> V | Missing:
        """The field's value, or `MISSING` where the file leaves it out; an error of `errors.PART_ERRORS` if it is none."""

    @abc.abstractmethod
    def write(self, value: V, text: Text) -> Written:
        """Entries by table; none for a value that says nothing."""

    def known(self, key: str) -> bool:
        """Whether a key of its table is its own."""
        return True

    def options(self) -> Iterator[Option]:
        """Options of a command that give it; none unless an entry says so."""
        yield from ()

    def arguments(self, field: str) -> dict[str, str]:
        """What Python has for its options where that is not an argument of the same name.

        Args:
            field: The field's name.
        """
        return {}

    def take(self, options: MutableMapping[str, object]) -> V | Missing:
        """Take its options out of a command's values; the field's value, or `MISSING` if none was given."""
        return MISSING


class SeriesKind(Kind):
    """Requested values."""

    def settled(self, name: str, value: object) -> tuple[float, ...]:
        return () if isinstance(value, tuple) and not value else series(value, name)

    def read(self, name: str, value: object) -> tuple[float, ...]:
        return series(value, name)


@dataclasses.dataclass(frozen=True)
class Value(Entry[object]):
    """A single value of a table; the same is its option.

    Attributes:
        table, key: Where it stands.
        about: Its kind and help.
        default: What it is where it is left out.
        what: What messages call it; the key if empty.
        hidden: Whether it is left out of a written file where it has its default.
        option: Name of its option; the key if empty.
    """

    table: str
    key: str
    about: About
    default: object
    what: str = ""
    hidden: bool = False
    metavar: str | None = None
    option: str = ""

    @property
    def tables(self) -> tuple[str, ...]:  # type: ignore[override]
        return (self.table,)

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys of its table by which it may be given."""
        return (self.key,)

    @property
    def _option(self) -> str:
        return self.option or self.key

    def known(self, key: str) -> bool:
        return key in self.keys

    def read(self, tables: Tables) -> object:
        value = table_of(tables, self.table).get(self.key, MISSING)
        return value if value is MISSING else self.about.kind.read(self.what or self.key, value)

    def settled(self, value: object) -> object:
        """The value as code gives it, plain; an error of `errors.PART_ERRORS` if it is none."""
        return self.about.kind.settled(self.what or self.key, value)

    def write(self, value: object, text: Text) -> Written:
        if self.hidden and value == self.default:
            return {}
        return {self.table: {self.key: self.about.kind.write(value, text)}}

    def options(self) -> Iterator[Option]:
        default = None if self.hidden else self.default
        yield Option(self._option, self.about, default, self.metavar)

    def arguments(self, field: str) -> dict[str, str]:
        if isinstance(self.about.kind, SeriesKind):
            return {self._option: f"{self.what}s"}  # as the calls have it, with a unit
        return {self._option: f"{field}=True"} if isinstance(self.about.kind, Flag) else {}

    def take(self, options: MutableMapping[str, object]) -> object:
        value = options.pop(self._option, None)
        if value is None:
            return MISSING
        return self.about.kind.read(self.what, value) if isinstance(self.about.kind, SeriesKind) else value


class PartClass(Protocol):
    """A dataclass of something added to a device, such as a sheet.

    Attributes:
        table: Its table in a case file. On a command line its first field has this name, the others have it in front.
        needs: What is missing where not all fields without a default are given, a sentence.
    """

    table: ClassVar[str]
    needs: ClassVar[str]

    def check_on(self, actuator: Actuator) -> None: ...


@dataclasses.dataclass(frozen=True)
class Part[P: PartClass](Entry[P | None]):
    """Something added to a device, with a table of its own."""

    part: type[P]

    @property
    def tables(self) -> tuple[str, ...]:  # type: ignore[override]
        return (self.part.table,)

    def read(self, tables: Tables) -> P | Missing:
        table = self.part.table
        if table not in tables:
            return MISSING
        found = table_of(tables, table)
        own = {key: value for key, value in found.items() if not isinstance(value, Mapping)}
        if found and not own:  # [table.name] alone, which are parts
            return MISSING
        return self._made(codec.from_table(self.part, own, f"[{table}]", f"{table} "))

    def write(self, value: P | None, text: Text) -> Written:
        return {} if value is None else {self.part.table: codec.to_table(value, text)}

    def options(self) -> Iterator[Option]:
        defaults = {field.name: field.default for field in dataclasses.fields(self.part)}  # type: ignore[arg-type]
        for name, option in self._names().items():
            field = about(self.part)[name]
            default = None if defaults[name] is dataclasses.MISSING else defaults[name]
            yield Option(option, field, default, name.upper() if isinstance(field.kind, Words) else None)

    def take(self, options: MutableMapping[str, object]) -> P | Missing:
        given = {name: options.pop(option, None) for name, option in self._names().items()}
        given = {name: value for name, value in given.items() if value is not None}
        return self._made(given) if given else MISSING

    def arguments(self, field: str) -> dict[str, str]:
        return {option: f"{self.part.__name__}.{name}" for name, option in self._names().items()}

    def _names(self) -> dict[str, str]:
        """Options by field."""
        first, *others = about(self.part)
        return {first: self.part.table, **{name: f"{self.part.table}_{name}" for name in others}}

    def _made(self, values: Mapping[str, object]) -> P:
        required = [field.name for field in dataclasses.fields(self.part) if field.default is dataclasses.MISSING]  # type: ignore[arg-type]
        if any(values.get(name, "") == "" for name in required):
            raise FieldError(self.part.needs)
        return self.part(**values)


class Supply(Entry[AirSupply | None]):
    """What drives the air: a table with the supply's name as its ``kind``, and its fields."""

    tables = ("supply",)

    def read(self, tables: Tables) -> AirSupply | Missing:
        if "supply" not in tables:
            return MISSING
        table = dict(table_of(tables, "supply"))
        supply = _supply(table.pop("kind", Syringe.name))
        return supply(**codec.from_table(supply, table, "the supply"))

    def write(self, value: AirSupply | None, text: Text) -> Written:
        return {} if value is None else {"supply": {"kind": value.name, **codec.to_table(value, text)}}

    def options(self) -> Iterator[Option]:
        text = "what drives the air: the pressure (or volume) itself, or a syringe on a T-junction"
        yield Option("supply", About(Choice(("direct", *SUPPLIES)), text))
        seen = set()
        for supply in SUPPLIES.values():
            for name, field in about(supply).items():
                option = field.option or name
                if option not in seen:
                    yield Option(option, field, getattr(supply, name, None))
                seen.add(option)

    def take(self, options: MutableMapping[str, object]) -> AirSupply | Missing:
        names = {option.name for option in self.options()} - {"supply"}
        kind, given = options.pop("supply", None), {name: options.pop(name, None) for name in names}
        given = {name: value for name, value in given.items() if value is not None}
        if kind in (None, "direct"):
            for name in given:
                owner = next(supply.name for supply in SUPPLIES.values() if name in _options(supply))
                raise SupplyError(f"--{name.replace('_', '-')} belongs to a {owner}; add --supply {owner}")
            return MISSING
        supply = _supply(kind)
        for name in given:
            if name not in _options(supply):
                raise SupplyError(f"--{name.replace('_', '-')} does not belong to a {supply.name}; leave it out")
        return supply(**codec.from_options(supply, given))


def _supply(name: object) -> type[AirSupply]:
    if not isinstance(name, str) or name not in SUPPLIES:
        raise SupplyError(f"supply {name!r} is unknown; {known_are(name, SUPPLIES)}")
    return SUPPLIES[name]


def _options(supply: type[AirSupply]) -> set[str]:
    return {field.option or name for name, field in about(supply).items()}
