"""Entries of case fields: each field's entry defines its table, its option and its messages.

An `Entry` reads a field from the tables of a case file or from the options of a command, and writes it. A new field is
one line in `softmodels.case.case.Case`.
"""

from __future__ import annotations

import abc
import dataclasses
import enum
import itertools
import math
import re
from collections.abc import Iterable, Iterator, Mapping, MutableMapping, Sequence
from typing import Final

from softmodels.case.requests import ProbeError
from softmodels.common import schema
from softmodels.common.errors import FieldError, GeometryError, Spoken, known_are, meant
from softmodels.common.schema import About, Choice, Flag, Kind, Text, about
from softmodels.common.units import FACTORS, UnitError, brief, number, numbers, pascal_per_cm, quantity
from softmodels.materials.laws import MaterialError
from softmodels.mechanics.component import ComponentError
from softmodels.path.program import ProgramError
from softmodels.path.supply import SUPPLIES, AirSupply, SupplyError, Syringe

# ----------------------------------------------------------------------------------------------------------------------
# Parse series of requested values.


ML = 1e-6
"""m3 in one ml."""
SHORT_PAIR = re.compile(r"(\d{1,2}),(\d{1,2})")
"""Two values, or one with a decimal comma."""


MAX_PRESSURE = 1e6
"""Maximum pressure in Pa; above it the number or its unit is wrong for any silicone."""


class SeriesError(Spoken, ValueError):
    """A text is not a series of values; the message is for the user."""


class Typed(tuple[float, ...]):
    """Values as they were typed.

    Attributes:
        doubt: A sentence if the text is ambiguous; else empty.
    """

    doubt: str = ""


def _typed(values: Iterable[float], doubt: str) -> Typed:
    made = Typed(values)
    made.doubt = doubt
    return made


def series(text: object, what: str) -> Typed:
    """Return the requested values: ``"0:177"`` (from, to), ``"0:177:10"`` (from, to, step) or ``"0,70,130,177"``; or a list.

    Args:
        text: The text, or a sequence of numbers.
        what: ``"pressure"`` or ``"volume"``, for the messages.

    Returns:
        The values, rising; the end of a range is always among them.

    Raises:
        SeriesError: Not numbers, negative, not rising, or far too many.
    """
    if isinstance(text, str):
        separator = ":" if ":" in text else ","
        parts: list[object] = [part.strip() for part in text.split(separator)]
    elif isinstance(text, list | tuple):
        separator, parts = ",", list(text)
    else:
        separator, parts = ",", [text]
    try:
        values = numbers(parts)
    except UnitError as error:
        cure = _unit_at_the_end(separator, parts) or "write 0:177, 0:177:10 or 0,70,130,177"
        raise SeriesError(f"{what} {brief(text)} is not a list of numbers ({error}); {cure}") from None
    if below := [value for value in (values[:2] if separator == ":" else values) if value < 0]:
        raise SeriesError(
            f"{what} {below[0]:g} is negative; suction is not modelled, so give values of 0 or more, such as 0,5,10"
        )
    if separator == ":":
        values = _range(values, str(text), what)
    for before, after in itertools.pairwise(values):
        if after == before:
            raise SeriesError(f"{what} {after:g} is requested twice")
        if after < before:
            more = ", and decimals with a point" if isinstance(text, str) and "," in text else ""
            raise SeriesError(f"{what} falls from {before:g} to {after:g}; give the values from low to high{more}")
    if values and values[-1] == 0:
        raise SeriesError(f"the only {what} requested is 0; add a value above 0")
    return _typed(values, _decimal_comma(text, what) if isinstance(text, str) else getattr(text, "doubt", ""))


def _decimal_comma(text: str, what: str) -> str:
    """Return a sentence on two short numbers with a comma between them, which may be a decimal comma; not after a
    single zero."""
    match = SHORT_PAIR.fullmatch(text.strip())
    if match is None or (match[1] == "0" and len(match[2]) > 1):
        return ""
    first, second = match.groups()
    return (
        f"{what} {text.strip()!r} is read as two values, {first} and {second}; decimals have a point, so write "
        f"{first}.{second} for that value, or {first}:{second} for both values without this note"
    )


def _unit_at_the_end(separator: str, parts: list[object]) -> str:
    """Return how to write values that carry units; empty if they have none."""
    pairs = [split_text(part) if isinstance(part, str) else ("", "") for part in parts]
    units = list(dict.fromkeys(unit for _, unit in pairs if unit))
    if not units or not all(value for value, _ in pairs):
        return ""
    if len(units) > 1:
        return f"give all values in one unit ({' or '.join(units)}), once, at the end"
    text = f"{separator.join(value for value, _ in pairs)} {units[0]}"
    pressure = factor_of(units[0], "Pa") is not None or units[0] == "cm"
    volume = factor_of(units[0], "m^3") is not None
    if not pressure and not volume:
        return ""
    if pressure:
        values = [value for value, _ in pairs]
        return _too_much(values, units[0]) or f"give the unit once, at the end of the text: --pressure '{text}'"
    return f"give the unit once, at the end of the text ('{text}'), and not with volume_ml"


def _too_much(values: Sequence[str], unit: str) -> str:
    """Return the end of a sentence on pressures too high for silicone; else empty."""
    try:
        highest = max(map(number, values)) * (pascal_per_cm() if unit == "cm" else factor_of(unit, "Pa") or 0.0)
    except UnitError:
        return ""
    if highest <= MAX_PRESSURE:
        return ""
    return (
        f"and {highest / 1e3:.4g} kPa is too high: silicone devices take 1 to 100 kPa, about 10 to 1000 cm of the column; "
        "write --pressure '0:30 kPa' or --pressure '0:300 cm'"
    )


def _range(numbers: list[float], text: str, what: str) -> list[float]:
    if len(numbers) not in (2, 3):
        raise SeriesError(f"{what} {brief(text)}: a range is from:to or from:to:step")
    start, stop = numbers[:2]
    if len(numbers) == 2 or stop <= start:
        return [start, stop]
    step = numbers[2]
    if step <= 0:
        raise SeriesError(f"{what} {brief(text)}: the step must be above zero")
    count = (stop - start) / step
    if count > 10000:
        raise SeriesError(f"{what} {brief(text)} asks for {count:.0f} values; use a larger step")
    inner = [start + step * i for i in range(math.floor(count * (1 - 1e-12)) + 1)]
    return [*(value for value in inner if value < stop), stop]


def of_text(unit: str, text: str, what: str, pascal_in_cm: float) -> Typed:
    """Return the requested values of a text with a unit, such as ``"0:17 kPa"``, in cm of the column or in ml.

    Args:
        unit: ``"cm"`` or ``"ml"``.
        text: The text.
        what: ``"pressure"`` or ``"volume"``, for the messages.
        pascal_in_cm: Pa in one cm of the column.

    Raises:
        SeriesError: See `series`; a unit that is missing, unknown or of something else.
    """
    values, written = split_text(text)
    scale = _scale(unit, text, written, what, pascal_in_cm)
    read = series(values, what)
    return _typed((value * scale for value in read), read.doubt)


def one_of_text(unit: str, text: str, what: str, pascal_in_cm: float) -> float:
    """Return a single value of a text with a unit; see `of_text`."""
    value, written = split_text(text)
    scale = _scale(unit, text, written, what, pascal_in_cm)
    try:
        return quantity(value, "") * scale
    except UnitError as error:
        raise SeriesError(f"{what} {brief(text)}: {error}") from None


def _scale(unit: str, text: str, written: str, what: str, pascal_in_cm: float) -> float:
    if written == unit:
        return 1.0
    factor = factor_of(written, "Pa" if unit == "cm" else "m^3")
    if factor is None:
        examples = "0:177 cm or 0:17 kPa" if unit == "cm" else "0:60 ml"
        known = ["cm", *FACTORS["Pa"]] if unit == "cm" else FACTORS["m^3"]
        trouble = f"an unknown unit, {brief(written)}" if written else "no unit"
        raise SeriesError(
            f"{what} {brief(text)} has {trouble}; write it like {examples}, or give numbers in SI units{meant(written, known)}"
        )
    return factor / (pascal_in_cm if unit == "cm" else ML)


def split_text(text: str) -> tuple[str, str]:
    """Return the numbers of a text and the unit behind them; letters within a number are an exponent's."""
    match = re.fullmatch(r"\s*(.*?[\d.](?:[eE][+-]?\d+)?)?\s*([^\d\s.,:][^:,]*)?\s*", text)
    return (match[1] or "", (match[2] or "").strip()) if match else (text, "")


def factor_of(unit: str, si: str) -> float | None:
    """Return the SI value of a unit; None if it is of another kind, or unknown."""
    try:
        return quantity(f"1 {unit}", si) if unit else None
    except UnitError:
        return None


type Tables = Mapping[str, object]
"""Content of a case file by name: tables, and the case's name; see `table_of`."""
type Written = Mapping[str, Mapping[str, object]]
"""Values to write into a case file, by table and key."""


class Missing(enum.Enum):
    """The type of `MISSING`."""

    MISSING = enum.auto()


MISSING: Final = Missing.MISSING
"""Value of an entry that is not given."""


def table_of(tables: Tables, name: str) -> Mapping[str, object]:
    """Return a table of a case file; empty if the file omits it.

    Raises:
        FieldError: It is no table.
    """
    table = tables.get(name, {})
    if not isinstance(table, Mapping):
        raise FieldError(f"{name} is {table!r}; it must be a table, starting with a line [{name}]")
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
    """Conversion of a field with values V to and from text.

    Attributes:
        tables: Tables of the case file that it reads.
    """

    tables: tuple[str, ...] = ()

    @abc.abstractmethod
    def read(self, tables: Tables) -> V | Missing:
        """Return the field's value, or `MISSING` if the file omits it; raise an error of `errors.PART_ERRORS` if it
        is invalid."""

    @abc.abstractmethod
    def write(self, value: V, text: Text) -> Written:
        """Return the entries by table; empty for an empty value."""

    def known(self, key: str) -> bool:
        """Return whether a key of its table belongs to it."""
        return True

    def options(self) -> Iterator[Option]:
        """Yield the command options of the field; none by default."""
        yield from ()

    def arguments(self, field: str) -> dict[str, str]:
        """Return the Python names of its options that differ from the option's.

        Args:
            field: The field's name.
        """
        return {}

    def take(self, options: MutableMapping[str, object]) -> V | Missing:
        """Pop its options from a command's values; return the field's value, or `MISSING` if none was given."""
        return MISSING


class SeriesKind(Kind):
    """Requested values."""

    def settled(self, name: str, value: object) -> tuple[float, ...]:
        return () if isinstance(value, tuple) and not value else series(value, name)

    def read(self, name: str, value: object) -> tuple[float, ...]:
        return series(value, name)


@dataclasses.dataclass(frozen=True)
class Value(Entry[object]):
    """A single value of a table, with an option of the same name.

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
        """Keys of its table that may set it."""
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
        """Return a value given by code in plain form; raise an error of `errors.PART_ERRORS` if it is invalid."""
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
            return {self._option: f"{self.what}s"}  # a text with a unit, as in calls
        return {self._option: f"{field}=True"} if isinstance(self.about.kind, Flag) else {}

    def take(self, options: MutableMapping[str, object]) -> object:
        value = options.pop(self._option, None)
        if value is None:
            return MISSING
        return self.about.kind.read(self.what, value) if isinstance(self.about.kind, SeriesKind) else value


class SupplyEntry(Entry[AirSupply | None]):
    """The air supply: a table with the supply's name as its ``kind``, and its fields."""

    tables = ("supply",)

    def read(self, tables: Tables) -> AirSupply | Missing:
        if "supply" not in tables:
            return MISSING
        table = dict(table_of(tables, "supply"))
        supply = _supply(table.pop("kind", Syringe.name))
        return supply(**schema.from_table(supply, table, "the supply"))

    def write(self, value: AirSupply | None, text: Text) -> Written:
        return {} if value is None else {"supply": {"kind": value.name, **schema.to_table(value, text)}}

    def options(self) -> Iterator[Option]:
        text = "air supply: a prescribed pressure or volume, or a syringe on a T-junction"
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
        return supply(**schema.from_options(supply, given))


def _supply(name: object) -> type[AirSupply]:
    if not isinstance(name, str) or name not in SUPPLIES:
        raise SupplyError(f"supply {name!r} is unknown; {known_are(name, SUPPLIES)}")
    return SUPPLIES[name]


def _options(supply: type[AirSupply]) -> set[str]:
    return {field.option or name for name, field in about(supply).items()}


# ----------------------------------------------------------------------------------------------------------------------
# Errors of a case, raised with a message for the user before anything is solved.


class CaseError(Spoken, ValueError):
    """Invalid input, detected before anything is solved; the message is for the user."""


PART_ERRORS = (
    FieldError, ProbeError, GeometryError, MaterialError, ComponentError, ProgramError, SeriesError,
    SupplyError,
)  # fmt: skip
"""Errors raised by the parts of a case."""
INPUT_ERRORS = (CaseError, *PART_ERRORS)
