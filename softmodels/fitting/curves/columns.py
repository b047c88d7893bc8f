"""Columns of a test machine's table: what a header means, in which unit, and which two make a curve."""

from __future__ import annotations

import csv
import dataclasses
import math
import re
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from measurement.units import UnitError, quantity
from measurement.wording import Spoken

Array = npt.NDArray[np.float64]

KINDS = {
    "stretch": "",
    "strain": "",
    "true-strain": "",
    "extension": "m",
    "radius": "m",
    "stress": "Pa",
    "true-stress": "Pa",
    "force": "N",
    "pressure": "Pa",
}
"""What a column can be, and the unit it is turned into. Strain and stress without ``true`` are the engineering ones."""

DEFORMATIONS = ("stretch", "strain", "true-strain", "extension", "radius")  # the first one found in a file counts
LOADS = ("stress", "true-stress", "force", "pressure")

_WORDS = (
    ("stretch", r"\bstretch|\blambda\b|\bextension ratio\b"),
    ("true-strain", r"(true|log|logarithmic|hencky).*strain"),
    ("strain", r"\bstrain\b|\belongation\b"),
    ("radius", r"\bradius\b"),
    ("extension", r"\bextension\b|\bdisplacement\b"),
    ("true-stress", r"(true|cauchy).*stress"),
    ("stress", r"\bstress\b"),
    ("force", r"\bforce\b|\bload\b"),
    ("pressure", r"\bpressure\b"),
)
_UNITS = {"%": "percent", "percent": "percent", "-": "", "1": "", "": "", "mm/mm": "", "m/m": "", "n/mm2": "N/mm^2",
          "n/mm^2": "N/mm^2", "n/mm²": "N/mm^2"}  # fmt: skip
_TAIL = re.compile(r"[ _](%|percent|g?pa|kpa|mpa|psi|ksi|bar|mbar|mn|kn|n|mm|cm|m|um)$", re.IGNORECASE)
_CASES = {"pa": "Pa", "kpa": "kPa", "mpa": "MPa", "gpa": "GPa", "kn": "kN", "n": "N"}


class TensileError(Spoken, ValueError):
    """A curve that cannot be used; the message is a sentence for the user."""


@dataclasses.dataclass(frozen=True)
class Column:
    """One column of a table.

    Attributes:
        kind: One of `KINDS`.
        unit: As written, ``""`` where none is.
        place: Counted from 0.
        header: What stands above it.
    """

    kind: str
    unit: str
    place: int
    header: str


@dataclasses.dataclass(frozen=True)
class Table:
    """A file's numbers: both columns as they stand, shape (n,), what they are, and the line of each row."""

    deformation: Column
    load: Column
    x: Array
    y: Array
    lines: tuple[int, ...]


def recognise(header: str, place: int) -> Column | None:
    """What a header means; None if it is neither deformation nor load."""
    unit, words = "", header.strip().strip('"')
    bracket = re.search(r"[(\[]([^)\]]*)[)\]]", words)
    tail = _TAIL.search(words)
    if bracket:
        unit, words = bracket[1].strip(), words[: bracket.start()]
    elif tail:
        unit, words = tail[1], words[: tail.start()]
    elif "," in words or "/" in words:
        words, unit = re.split(r"[,/]", words, maxsplit=1)
    words = re.sub(r"[_\s-]+", " ", words).lower().strip()
    if re.search(r"\b(rate|energy|error|sd|std|width|thickness|time)\b", words):
        return None
    for kind, pattern in _WORDS:
        if re.search(pattern, words):
            unit = _UNITS.get(unit.lower().strip(), unit.strip())
            return Column(
                kind, _CASES.get(unit.lower(), unit) if len(unit) > 1 else unit.replace("n", "N"), place, header
            )
    return None


def told_columns(text: str) -> dict[str, tuple[str, str | None]]:
    """Read ``"strain=Engineering Strain[%],stress=5[MPa]"``: by kind, a header or a number from 1, and a unit or None."""
    told: dict[str, tuple[str, str | None]] = {}
    for part in re.findall(r"[^,\[]+(?:\[[^\]]*\])?", text):
        kind, found, rest = part.strip().partition("=")
        if not found or kind not in KINDS:
            raise TensileError(f"columns {text!r}: {part.strip()!r} is not KIND=COLUMN[UNIT] with {', '.join(KINDS)}")
        name, _, unit = rest.partition("[")
        told[kind] = (name.strip(), unit.rstrip("]").strip() if "[" in rest else None)
    if len(set(told) & set(DEFORMATIONS)) != 1 or len(set(told) & set(LOADS)) != 1:
        raise TensileError(
            f"columns {text!r} must name one deformation ({', '.join(DEFORMATIONS)}) and one load ({', '.join(LOADS)})"
        )
    return told


def read_table(text: str, told: Mapping[str, tuple[str, str | None]]) -> Table:
    """Find the header, whatever stands above it, and the numbers of the two columns that make a curve.

    Args:
        text: A file's text; fields apart by ``;``, tabs or commas, lines with ``#`` skipped.
        told: See `told_columns`; empty to go by the headers.

    Raises:
        TensileError: No header says what the columns are, or there are no numbers below it.
    """
    if not text.strip():
        raise TensileError("the file is empty")
    for separator in (";", "\t", ","):
        rows = _rows(text, separator)
        found = _told_header(rows, told) if told else _header(rows)
        if found:
            after, deformation, load = found
            return _numbers(rows[after:], deformation, load, decimal_comma=separator != ",")
    if told:
        names = " and ".join(repr(name) for name, _ in told.values())
        raise TensileError(f"no line of the file has the columns {names}")
    raise TensileError(
        "no line names a deformation and a load, such as 'strain (%)' and 'stress (MPa)'; "
        "say which columns they are with --columns 'strain=1[%],stress=2[MPa]'"
    )


def _rows(text: str, separator: str) -> list[tuple[int, list[str]]]:
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    fields = csv.reader((line for _, line in lines), delimiter=separator, skipinitialspace=True)
    return [(number, row) for (number, _), row in zip(lines, fields, strict=False)]


def _header(rows: list[tuple[int, list[str]]]) -> tuple[int, Column, Column] | None:
    for i, (_, row) in enumerate(rows):
        if len(row) < 2 or any(_is_number(cell) for cell in row):
            continue  # most lines of a long file, and quick to tell
        known = [column for place, cell in enumerate(row) if (column := recognise(cell, place))]
        if len(known) < 2:
            continue
        for group in (DEFORMATIONS, LOADS):
            twice = [c.header for c in known if c.kind == _first(known, group)]
            if len(twice) > 1:
                raise TensileError(f"the columns {' and '.join(map(repr, twice))} mean the same; choose with --columns")
        kinds = {column.kind: column for column in known}
        deformation, load = _first(known, DEFORMATIONS), _first(known, LOADS)
        if deformation and load:
            return i + 1, kinds[deformation], kinds[load]
    return None


def _first(known: Sequence[Column], kinds: Sequence[str]) -> str | None:
    present = {column.kind for column in known}
    return next((kind for kind in kinds if kind in present), None)


def _told_header(
    rows: list[tuple[int, list[str]]], told: Mapping[str, tuple[str, str | None]]
) -> tuple[int, Column, Column] | None:
    """Columns by name need a line that has them; by number, the first line of numbers."""
    numbers = all(name.isdigit() for name, _ in told.values())
    for i, (_, row) in enumerate(rows):
        made = {}
        cells = [cell.strip().strip('"') for cell in row]
        for kind, (name, unit) in told.items():
            if name.isdigit():
                place = int(name) - 1
            elif name in cells:
                place = cells.index(name)
            else:
                bare = [re.sub(r"\s*[(\[].*", "", cell) for cell in cells]
                place = bare.index(name) if name in bare else -1
            if not 0 <= place < len(row):
                break
            said = recognise(row[place], place)
            made[kind] = Column(kind, (said.unit if said else "") if unit is None else unit, place, row[place].strip())
        else:
            if numbers and not all(_is_number(row[column.place]) for column in made.values()):
                continue
            deformation = next(made[kind] for kind in DEFORMATIONS if kind in made)
            load = next(made[kind] for kind in LOADS if kind in made)
            return (i if numbers else i + 1), deformation, load
    return None


def _numbers(rows: list[tuple[int, list[str]]], deformation: Column, load: Column, decimal_comma: bool) -> Table:
    x: list[float] = []
    y: list[float] = []
    lines: list[int] = []
    for line, row in rows:
        cells = [row[c.place].strip() if c.place < len(row) else "" for c in (deformation, load)]
        if not x and not any(_is_number(cell) for cell in cells):
            continue  # a line of units between the header and the numbers
        values = []
        for cell, column in zip(cells, (deformation, load), strict=True):
            if not _is_number(cell):
                raise TensileError(f"line {line}: {cell!r} in the column {column.header!r} is not a number")
            values.append(float(cell.replace(",", ".") if decimal_comma else cell))
        if not all(map(math.isfinite, values)):
            raise TensileError(f"line {line} holds a value that is not finite ({', '.join(cells)})")
        x.append(values[0])
        y.append(values[1])
        lines.append(line)
    if not x:
        raise TensileError(f"there are no numbers below the header ({deformation.header!r}, {load.header!r})")
    return Table(deformation, load, np.array(x), np.array(y), tuple(lines))


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


def in_si(values: Array, column: Column) -> Array:
    """A column's numbers in the unit of its kind.

    Raises:
        TensileError: The unit is missing or of another kind.
    """
    wanted = KINDS[column.kind]
    if not column.unit and not wanted:
        return values
    if not column.unit:
        raise TensileError(
            f"the column {column.header!r} has no unit; write it into the header, such as '{column.kind} (kPa)', or tell it "
            f"with --columns {column.kind}={column.place + 1}[kPa],..."
        )
    try:
        return values * quantity(f"1 {column.unit}", wanted)
    except UnitError as error:
        raise TensileError(f"the column {column.header!r}: {error}") from None
