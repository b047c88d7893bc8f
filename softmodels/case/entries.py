"""Entries of case fields: each field's entry defines its table, its option and its messages.

An `Entry` reads a field from the tables of a case file or from the options of a command, and writes it. A new field is
one line in `softmodels.case.case.Case`, and one in `RequestOptions` for type checkers. First of all `Probes`, the points,
angles and profile that a user asks for.
"""

from __future__ import annotations

import abc
import dataclasses
import enum
import itertools
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, MutableMapping, Sequence
from typing import Final

import numpy as np

from geometries import Actuator
from geometries.actuator import Vector
from geometries.faces import Faces, faces, point
from softmodels.common import errors, schema, units
from softmodels.common.arrays import Array
from softmodels.common.errors import GeometryError
from softmodels.common.names import checked
from softmodels.common.schema import about
from softmodels.materials.laws import MaterialError
from softmodels.mechanics.component import ComponentError
from softmodels.path import steps
from softmodels.path.supply import SUPPLIES, AirSupply, SupplyError, Syringe


class Entry[V](abc.ABC):
    """Conversion of a field with values V to and from text; ``text`` is what it is, a clause. ``tables`` are those of the case
    file that it reads, ``keys`` its keys in a table that it shares with other fields."""

    tables: tuple[str, ...] = ()
    keys: tuple[str, ...] = ()

    def __init__(self, text: str):
        self.about = schema.About(schema.Words(), text)

    def of_field(self, name: str) -> Entry[V]:
        """Return it as the entry of the field of this name."""
        return self

    @abc.abstractmethod
    def read(self, tables: Tables) -> V | Missing:
        """Return the field's value, or `MISSING` if the file omits it; raise an error of `errors.PART_ERRORS` if it
        is invalid."""

    @abc.abstractmethod
    def write(self, value: V, text: schema.Text) -> Written:
        """Return the entries by table; empty for an empty value."""

    def known(self, key: str) -> bool:
        """Return whether a key of its table belongs to it."""
        return True

    def options(self) -> Iterator[Option]:
        """Yield the command options of the field; none by default."""
        yield from ()

    def arguments(self, field: str) -> dict[str, str]:
        """Return the Python names of a field's options that differ from the option's."""
        return {}

    def take(self, options: MutableMapping[str, object]) -> V | Missing:
        """Pop its options from a command's values; return the field's value, or `MISSING` if none was given."""
        return MISSING


@dataclasses.dataclass(frozen=True)
class Value(Entry[object]):
    """A single value of a table.

    Attributes:
        key, option: Its key in the table, the field's name if empty, and its option, the key if empty.
        hidden: Whether it is left out of a written file where it has its default.
    """

    table: str
    about: schema.About
    default: object
    key: str = ""
    hidden: bool = False
    metavar: str | None = None
    option: str = ""

    @property
    def tables(self) -> tuple[str, ...]:  # type: ignore[override]
        return (self.table,)

    @property
    def keys(self) -> tuple[str, ...]:  # type: ignore[override]
        return (self.key,)

    @property
    def _option(self) -> str:
        return self.option or self.key

    def of_field(self, name: str) -> Value:
        return dataclasses.replace(self, key=self.key or name)

    def known(self, key: str) -> bool:
        return key in self.keys

    def read(self, tables: Tables) -> object:
        value = table_of(tables, self.table).get(self.key, MISSING)
        return value if value is MISSING else self.about.kind.read(self.key, value)

    def settled(self, value: object) -> object:
        """Return a value given by code in plain form; raise an error of `errors.PART_ERRORS` if it is invalid."""
        return self.about.kind.settled(self.key, value)

    def write(self, value: object, text: schema.Text) -> Written:
        if self.hidden and value == self.default:
            return {}
        return {self.table: {self.key: self.about.kind.write(value, text)}}

    def options(self) -> Iterator[Option]:
        default = None if self.hidden else self.default
        yield Option(self._option, self.about, default, self.metavar)

    def arguments(self, field: str) -> dict[str, str]:
        return {self._option: f"{field}=True"} if isinstance(self.about.kind, schema.Flag) else {}

    def take(self, options: MutableMapping[str, object]) -> object:
        value = options.pop(self._option, None)
        return MISSING if value is None else value


class SupplyEntry(Entry[AirSupply | None]):
    """The air supply: a table with the supply's name as its ``kind``, and its fields."""

    tables = ("supply",)

    def read(self, tables: Tables) -> AirSupply | Missing:
        if "supply" not in tables:
            return MISSING
        table = dict(table_of(tables, "supply"))
        supply = _supply(table.pop("kind", Syringe.name))
        return supply(**schema.from_table(supply, table, "the supply"))

    def write(self, value: AirSupply | None, text: schema.Text) -> Written:
        return {} if value is None else {"supply": {"kind": value.name, **schema.to_table(value, text)}}

    def options(self) -> Iterator[Option]:
        text = "air supply: a prescribed pressure or volume, or a syringe on a T-junction"
        yield Option("supply", schema.About(schema.Choice(("direct", *SUPPLIES)), text))
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
        raise SupplyError(f"supply {name!r} is unknown; {errors.known_are(name, SUPPLIES)}")
    return SUPPLIES[name]


def _options(supply: type[AirSupply]) -> set[str]:
    return {field.option or name for name, field in about(supply).items()}


# ----------------------------------------------------------------------------------------------------------------------
# User-defined outputs of a device: positions of named points, angles between them, a profile.
#
# [points]
# tip = "70, 0, 4 mm"                 # the nearest place on the surface is tracked
# base = "5, 0, 4 mm"
#
# [angles]
# bend = "face x = 70 mm"             # mean rotation of this flat face, positive towards the lift (bending angle)
# chord = "base to tip"               # rotation of this line: for a circular arc half the bending angle
# jaws = ["base to tip", "base to thumb"]     # the angle between two lines
#
# [profile]
# plane = "y = 0 mm"                  # plane of the drawn section


Line = tuple[str, str]

NAME = r"[A-Za-z]\w*"


class ProbeError(errors.OptionMessage, ValueError):
    """Invalid points, angles or profile; the message is for the user."""


@checked
@dataclasses.dataclass(frozen=True)
class Probes:
    """Points by name, angles by name as one or two lines from point to point or as a face (such as "x = 70 mm"), and the plane
    of the profile, empty for none, all as written; `ProbeError` for a text of none of these forms or an unknown name."""

    points: tuple[tuple[str, str], ...] = ()
    angles: tuple[tuple[str, tuple[Line, ...]], ...] = ()
    plane: str = ""
    faces: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        names = {name for name, _ in self.points}
        for name in (*names, *(name for name, _ in (*self.angles, *self.faces))):
            if not re.fullmatch(NAME, name):
                raise ProbeError(f"{name!r} cannot be used as a column name; use letters, digits and '_'")
        for name, lines in self.angles:
            for line in lines:
                if missing := [end for end in line if end not in names]:
                    known = ", ".join(sorted(names)) or "none"
                    raise ProbeError(f"angle {name}: there is no point {missing[0]!r}; [points] has {known}")
                if line[0] == line[1]:
                    raise ProbeError(f"angle {name}: a line needs two different points, not {line[0]} twice")
        _ = self.places, self.cut, self.turning

    @property
    def places(self) -> dict[str, Vector]:
        """Wanted places by name in device coordinates, m."""
        return {name: _reworded(point, f"point {name}", _with_at(text)) for name, text in self.points}

    @property
    def turning(self) -> dict[str, Faces]:
        """Faces by the name of the angle of their mean rotation; each is selected by a plane or a box."""
        turning = {name: _reworded(faces, f"angle {name}", text) for name, text in self.faces}
        for name, face in turning.items():
            if face.normal is None and face.box is None:
                raise ProbeError(
                    f"angle {name} uses the face {face.text!r}; select the face by its position, such as 'face x = 70 mm'"
                )
        return turning

    @property
    def cut(self) -> tuple[Vector, float] | None:
        """Unit normal of the profile's plane, and its distance from the origin in m; None if there is none."""
        if not self.plane:
            return None
        plane = _reworded(faces, "profile plane", self.plane)
        if plane.normal is None:
            raise ProbeError(f"profile plane is {self.plane!r}; write a plane as 'y = 0 mm' or 'normal 1, -1, 0'")
        return plane.normal, plane.at

    def columns(self) -> list[str]:
        """Return the columns of positions and angles that it adds to ``path.csv``."""
        return [f"{name}_{axis}_mm" for name, _ in self.points for axis in "xyz"] + [
            f"{name}_deg" for name, _ in (*self.angles, *self.faces)
        ]

    @property
    def variables(self) -> list[str]:
        """The names of these columns without their units."""
        return [column.rpartition("_")[0] for column in self.columns()]

    @property
    def off_columns(self) -> dict[str, str]:
        """Columns with the distance of the tracked place from the named point, by the point's name."""
        return {name: f"{name}_off_mm" for name, _ in self.points}

    def check(self, actuator: Actuator) -> None:
        """Raise `ProbeError` for names whose columns already exist."""
        if self.faces and actuator.dimension == 2:
            raise ProbeError(f"angle {self.faces[0][0]}: faces of an axisymmetric section do not rotate; leave it out")
        taken = {*actuator.figure_columns.values(), *(f"max_stretch_{axis}_mm" for axis in "xyz")}
        for column in (*self.columns(), *self.off_columns.values()):
            if column in taken:
                raise ProbeError(f"{column} is already a column of path.csv; use another name in [points] or [angles]")

    def figures(
        self,
        rest: Mapping[str, Vector],
        moved: Mapping[str, Array],
        lift: Vector,
        normals: Mapping[str, tuple[Array, Array]] | None = None,
    ) -> dict[str, float]:
        """Return the values by column, from undeformed places and displacements by name in m, the direction of the device's
        lift, and the normals of the faces of `turning` by name: undeformed, and turned by the face's mean rotation."""
        now = {name: np.asarray(rest[name]) + moved[name] for name in rest}
        figures = {f"{name}_{axis}_mm": float(now[name][i]) * 1e3 for name, _ in self.points for i, axis in enumerate("xyz")}
        wanted = self.places
        figures |= {column: 1e3 * math.dist(rest[name], wanted[name]) for name, column in self.off_columns.items()}
        for name, lines in self.angles:
            first, *second = ([now[b] - now[a], np.asarray(rest[b]) - np.asarray(rest[a])] for a, b in lines)
            figures[f"{name}_deg"] = _angle(first[0], second[0][0]) if second else _turned(first[1], first[0], lift)
        for name, (before, now_there) in (normals or {}).items():
            figures[f"{name}_deg"] = _turned(before, now_there, lift)
        return figures


NO_PROBES = Probes()


def probes_from_tables(tables: Mapping[str, Mapping[str, object]]) -> Probes:
    """Read the tables ``[points]``, ``[angles]`` and ``[profile]`` of a case; `ProbeError` if they make no points, angles or
    plane."""
    points, angles, profile = (tables.get(name, {}) for name in ("points", "angles", "profile"))
    named: list[tuple[str, str]] = []
    for name, text in points.items():
        if not isinstance(text, str):
            raise ProbeError(f"point {name} is {text!r}; write a point as '70, 0, 4 mm'")
        named.append((name, text))
    if unknown := set(profile) - {"plane"}:
        raise ProbeError(f"[profile] has an unknown entry {min(unknown)!r}; known is plane")
    plane = profile.get("plane", "")
    if not isinstance(plane, str):
        raise ProbeError(f"profile plane is {plane!r}; write a plane as 'y = 0 mm'")
    turning = {name: face[1] for name, value in angles.items() if (face := _face_text(value))}
    lines = tuple((name, _lines(name, value)) for name, value in angles.items() if name not in turning)
    return Probes(tuple(named), lines, plane, tuple(turning.items()))


def probes_to_tables(gauges: Probes) -> dict[str, Mapping[str, object]]:
    """Return the tables that `from_tables` reads; none for nothing."""
    angles = {name: [" to ".join(line) for line in lines] for name, lines in gauges.angles}
    tables: dict[str, Mapping[str, object]] = {
        "points": dict(gauges.points),
        "angles": {name: lines[0] if len(lines) == 1 else lines for name, lines in angles.items()}
        | {name: f"face {text}" for name, text in gauges.faces},
        "profile": {"plane": gauges.plane} if gauges.plane else {},
    }
    return {name: table for name, table in tables.items() if table}


def followed_text(name: str, away: float, place: Sequence[float] = ()) -> str:
    """Return a sentence on the distance (m) of a tracked point from its named position, with the undeformed place
    if given."""
    where = f" {', '.join(f'{1e3 * value:.5g}' for value in place)} mm," if len(place) else ""
    near = "on the surface" if away < 1e-9 else f"the nearest surface point of the model, {away * 1e3:.3g} mm away"
    return f"point {name} is tracked at{where} {near}"


def _face_text(value: object) -> re.Match[str] | None:
    return re.fullmatch(r"\s*face\s+(?!to\s)(.*\S)\s*", value) if isinstance(value, str) else None


def _lines(name: str, value: object) -> tuple[Line, ...]:
    texts = [value] if isinstance(value, str) else value
    if not isinstance(texts, list) or not 1 <= len(texts) <= 2 or not all(isinstance(text, str) for text in texts):
        raise ProbeError(f"angle {name} is {value!r}; write 'face x = 70 mm', 'base to tip', or two such lines in a list")
    matches = [re.fullmatch(rf"\s*({NAME})\s+to\s+({NAME})\s*", text) for text in texts]
    if not all(matches):
        raise ProbeError(
            f"angle {name} is {value!r}; write a line as 'base to tip', from point to point, or a face as 'face x = 70 mm'"
        )
    return tuple((match[1], match[2]) for match in matches if match)


def _with_at(text: str) -> str:
    return text if text.lstrip().startswith("at") else f"at {text.strip()}"


def place_of(name: str, text: str) -> Vector:
    """Return the place of a text such as ``"70, 0, 4 mm"`` in device coordinates, m; else `ProbeError`."""
    return _reworded(point, name, _with_at(text))


def _reworded[T](read: Callable[[str, str], T], field: str, text: str) -> T:
    try:
        return read(field, text)
    except GeometryError as error:
        raise ProbeError(str(error)) from None


def _angle(a: Array, b: Array) -> float:
    """Return the angle between two vectors in degrees, exact near 0 and 180 too."""
    return math.degrees(math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b)))


def _turned(rest: Array, now: Array, lift: Vector) -> float:
    """Return the rotation of a line in degrees; negative away from the lift."""
    up = np.asarray(lift)
    risen = float(now @ up / np.linalg.norm(now) - rest @ up / np.linalg.norm(rest))
    return math.copysign(_angle(rest, now), risen) if risen else _angle(rest, now)


# ----------------------------------------------------------------------------------------------------------------------
# Parse series of requested values.


M3_PER_ML = 1e-6
"""m3 in one ml."""
WITH_VACUUM = {"pressure": "cavity1.pressure_cm", "volume": "cavity1.volume_ml"}
"""Requested quantities that may be below 0, and their series in a case file."""
SHORT_PAIR = re.compile(r"(\d{1,2}),(\d{1,2})")
"""Two values, or one with a decimal comma."""

MAX_PRESSURE = 1e6
"""Maximum pressure in Pa; above it the number or its unit is wrong for any silicone."""


class SeriesError(errors.OptionMessage, ValueError):
    """A text is not a series of values; the message is for the user."""


class Typed(tuple[float, ...]):
    """Values as they were typed; ``doubt`` is a sentence if the text is ambiguous."""

    doubt: str = ""


def _typed(values: Iterable[float], doubt: str) -> Typed:
    made = Typed(values)
    made.doubt = doubt
    return made


def series(text: object, what: str, ordered: bool = True) -> Typed:
    """Return the requested values of ``"0:177"`` (from, to), ``"0:177:10"`` (from, to, step) or ``"0,70,130,177"``, or of
    numbers.

    They all rise from 0 or above, or all fall from 0 or below, as under vacuum, unless they need not be ``ordered``; the end of
    a range is always among them. `SeriesError` for what is not so, or far too many. ``what`` is ``"pressure"`` or
    ``"volume"``, for the messages.
    """
    if isinstance(text, str):
        separator = ":" if ":" in text else ","
        parts: list[object] = [part.strip() for part in text.split(separator)]
    elif isinstance(text, list | tuple):
        separator, parts = ",", list(text)
    else:
        separator, parts = ",", [text]
    try:
        values = units.numbers(parts)
    except units.UnitError as error:
        cure = _unit_at_the_end(separator, parts) or "write 0:177, 0:177:10 or 0,70,130,177"
        raise SeriesError(f"{what} {units.brief(text)} is not a list of numbers ({error}); {cure}") from None
    if separator == ":":
        way = _way(values[:2], what) if ordered else 1 if values[:1] <= values[1:2] else -1
        values = [way * value + 0.0 for value in _range([way * value for value in values[:2]] + values[2:], str(text), what)]
    more = ", and decimals with a point" if isinstance(text, str) and "," in text else ""
    if ordered:
        check_order(values, what, more)
    return _typed(values, _decimal_comma(text, what) if isinstance(text, str) else getattr(text, "doubt", ""))


def check_order(values: Sequence[float], what: str, more: str = "") -> None:
    """Raise `SeriesError`, with ``more`` at its end, for values that neither rise from 0 or above nor fall from 0 or below."""
    way = _way(values, what)
    for before, after in itertools.pairwise(values):
        if after == before:
            raise SeriesError(f"{what} {units.written(after)} is requested twice")
        if way * after < way * before:
            turns, order = ("falls", "from low to high") if way > 0 else ("rises", "from high to low")
            raise SeriesError(
                f"{what} {turns} from {units.written(before)} to {units.written(after)}; give the values {order}{more}"
            )


def _way(values: Sequence[float], what: str) -> int:
    """Return the direction in which requested values go from 0: 1, or -1 under vacuum."""
    below = [value for value in values if value < 0]
    if not below:
        return 1
    if what not in WITH_VACUUM:
        raise SeriesError(f"{what} {units.written(below[0])} is negative; give values of 0 or more, such as 0,5,10")
    if above := [value for value in values if value > 0]:
        low, high = (f"{units.as_amount(value).number:g}" for value in (min(below), max(above)))
        raise SeriesError(
            f"{what} is both {units.written(below[0])} and {units.written(above[0])}; write what goes through 0 as "
            "a series in a case "
            f"file, such as {WITH_VACUUM[what]} = [0, {low}, {high}] under [load]"
        )
    return -1


def _decimal_comma(text: str, what: str, unit: str = "") -> str:
    """Return a sentence on two short numbers with a comma between them, which may be a decimal comma; not after a single
    zero, and not between two tens, such as 10,20, because no one writes the last zero of a decimal."""
    match = SHORT_PAIR.fullmatch(text.strip())
    if match is None or (match[1] == "0" and len(match[2]) > 1) or re.fullmatch(r"\d0,\d0", match[0]):
        return ""
    first, second = match.groups()
    return (
        f"{what} '{text.strip()}{unit}' is read as two values, {first} and {second}{unit}; decimals have a point, so write "
        f"'{first}.{second}{unit}' for that value, or '{first}:{second}{unit}' for both values without this note"
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
        highest = max(map(units.number, values)) * (units.COLUMN.pascal if unit == "cm" else factor_of(unit, "Pa") or 0.0)
    except units.UnitError:
        return ""
    if highest <= MAX_PRESSURE:
        return ""
    return (
        f"and {highest / 1e3:.4g} kPa is too high: silicone devices take 1 to 100 kPa, about 10 to 1000 cm of the column; "
        "write --pressure '0:30 kPa' or --pressure '0:300 cm'"
    )


def _range(numbers: list[float], text: str, what: str) -> list[float]:
    if len(numbers) not in (2, 3):
        raise SeriesError(f"{what} {units.brief(text)}: a range is from:to or from:to:step")
    start, stop = numbers[:2]
    if len(numbers) == 2 or stop <= start:
        return [start, stop]
    step = numbers[2]
    if step <= 0:
        raise SeriesError(f"{what} {units.brief(text)}: the step must be above zero")
    count = (stop - start) / step
    if count > 10000:
        raise SeriesError(f"{what} {units.brief(text)} asks for {count:.0f} values; use a larger step")
    inner = [start + step * i for i in range(math.floor(count * (1 - 1e-12)) + 1)]
    return [*(value for value in inner if value < stop), stop]


def of_text(unit: str, text: str, what: str, pascal_in_cm: float, ordered: bool = True) -> Typed:
    """Return the requested values in SI of a text with a unit, such as ``"0:17 kPa"``: volumes where the ``unit`` is ``"ml"``,
    else pressures, also in ``"cm"`` of the column; `SeriesError` as for `series`, or for the unit."""
    values, own = split_text(text)
    amount = _reader(unit, text, own, what, pascal_in_cm)
    return _typed(map(amount, series(values, what, ordered)), _decimal_comma(values, what, f" {own}"))


def one_of_text(unit: str, text: str, what: str, pascal_in_cm: float) -> units.Amount:
    """Return a single value of a text with a unit; see `of_text`."""
    value, own = split_text(text)
    amount = _reader(unit, text, own, what, pascal_in_cm)
    try:
        return amount(units.quantity(value, ""))
    except units.UnitError as error:
        raise SeriesError(f"{what} {units.brief(text)}: {error}") from None


def _reader(unit: str, text: str, own: str, what: str, pascal_in_cm: float) -> Callable[[float], units.Amount]:
    """Return what makes amounts of numbers in a text's own unit; volumes are kept in ml, as case files have them."""
    if own == unit or (not own and _is_zero(text)):
        usual = pascal_in_cm if unit == "cm" else M3_PER_ML
        return lambda number: units.Amount(number * usual, number, unit)
    factor = factor_of(own, "Pa" if unit == "cm" else "m^3")
    if factor is None:
        examples = "0:177 cm or 0:17 kPa" if unit == "cm" else "0:60 ml"
        known = ["cm", *units.FACTORS["Pa"]] if unit == "cm" else units.FACTORS["m^3"]
        trouble = f"an unknown unit, {units.brief(own)}" if own else "no unit"
        plain = "" if errors.at_command_line() else ", or give numbers in SI units"
        raise SeriesError(
            f"{what} {units.brief(text)} has {trouble}; write it like {examples}{plain}{errors.meant(own, known)}"
        )
    if unit == "cm":
        return lambda number: units.Amount(number * factor, number, own)
    return lambda number: units.Amount(number * (factor / M3_PER_ML) * M3_PER_ML, number * (factor / M3_PER_ML), unit)


def _is_zero(text: str) -> bool:
    try:
        return units.number(text) == 0.0
    except units.UnitError:
        return False


def split_text(text: str) -> tuple[str, str]:
    """Return the numbers of a text and the unit behind them; letters within a number are an exponent's."""
    match = re.fullmatch(r"\s*(.*?[\d.](?:[eE][+-]?\d+)?)?\s*([^\d\s.,:][^:,]*)?\s*", text)
    return (match[1] or "", (match[2] or "").strip()) if match else (text, "")


def factor_of(unit: str, si: str) -> float | None:
    """Return the SI value of a unit; None if it is of another kind, or unknown."""
    try:
        return units.quantity(f"1 {unit}", si) if unit else None
    except units.UnitError:
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
    """Return a table of a case file; empty if the file omits it, `FieldError` if it is none."""
    table = tables.get(name, {})
    if not isinstance(table, Mapping):
        raise errors.FieldError(f"{name} is {table!r}; it must be a table, starting with a line [{name}]")
    return table


@dataclasses.dataclass(frozen=True)
class Option:
    """An option of a command line: its name with underscores, its kind and help, and what stands in the help as its default
    and for its value."""

    name: str
    about: schema.About
    default: object = None
    metavar: str | None = None


# ----------------------------------------------------------------------------------------------------------------------
# Errors of a case, raised with a message for the user before anything is solved.


class CaseError(errors.OptionMessage, ValueError):
    """Invalid input, detected before anything is solved; the message is for the user."""


PART_ERRORS = (
    errors.FieldError, ProbeError, GeometryError, MaterialError, ComponentError, steps.StepError, SeriesError,
    SupplyError,
)  # fmt: skip
"""Errors raised by the parts of a case."""
INPUT_ERRORS = (CaseError, *PART_ERRORS)
