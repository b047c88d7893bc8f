"""Columns of a test machine's table: what a header means, in which unit, and which two make a curve."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from measurement.reasons import reason
from measurement.units import UnitError, quantity
from measurement.user_table import Line, Sheet, named, not_a_number, pick, read_sheets
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
NONE = "dimensionless"
"""The unit of a column that is said to have none."""
_UNITS = {"%": "percent", "percent": "percent", "-": NONE, "1": NONE, "mm/mm": NONE, "m/m": NONE, "n/mm2": "N/mm^2",
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
        unit, words = bracket[1], words[: bracket.start()]
    elif tail:
        unit, words = tail[1], words[: tail.start()]
    elif "," in words or "/" in words:
        words, unit = re.split(r"[,/]", words, maxsplit=1)
    words = re.sub(r"[_\s-]+", " ", words).lower().strip()
    if re.search(r"\b(rate|energy|error|sd|std|width|thickness|time)\b", words):
        return None
    for kind, pattern in _WORDS:
        if re.search(pattern, words):
            return Column(kind, _unit(unit), place, header)
    return None


def _unit(text: str) -> str:
    """A unit in Pint's spelling."""
    unit = _UNITS.get(text.lower().strip(), text.strip())
    return _CASES.get(unit.lower(), unit) if len(unit) > 1 else unit.replace("n", "N")


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


def read_table(path: Path, told: Mapping[str, tuple[str, str | None]]) -> Table:
    """Find the header, whatever stands above it, and the numbers of the two columns that make a curve.

    Args:
        path: A text or a workbook, see `measurement.user_table.read_sheets`. A row of units may stand below the header.
        told: See `told_columns`; empty to go by the headers.

    Raises:
        TensileError: It cannot be read, no header or several say what the columns are, or there are no numbers below it.
    """

    def found(sheet: Sheet) -> tuple[int, Column, Column] | None:
        return _told_header(sheet.rows, told) if told else _header(sheet.rows)

    try:
        sheets = read_sheets(path)
        chosen = pick(path, sheets, found)
    except OSError as error:
        raise TensileError(f"the file cannot be read ({reason(error)})") from None
    if chosen is not None:
        sheet, (after, deformation, load) = chosen
        return _numbers(sheet, after, deformation, load, {kind for kind, (_, unit) in told.items() if unit is not None})
    if not any(sheet.rows for sheet in sheets):
        raise TensileError("the file is empty")
    where = f"no row of {named(sheets)}" if named(sheets) else "no line"
    if told:
        names = " and ".join(repr(name) for name, _ in told.values())
        raise TensileError(f"{where} of the file has the columns {names}")
    raise TensileError(
        f"{where} names a deformation and a load, such as 'strain (%)' and 'stress (MPa)'; "
        "say which columns they are with --columns 'strain=1[%],stress=2[MPa]'"
    )


def _header(rows: Sequence[Line]) -> tuple[int, Column, Column] | None:
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


def _told_header(rows: Sequence[Line], told: Mapping[str, tuple[str, str | None]]) -> tuple[int, Column, Column] | None:
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
            of_header = said.unit if said else ""
            made[kind] = Column(kind, of_header if unit is None else _unit(unit), place, row[place].strip())
        else:
            if numbers and not all(_is_number(row[column.place]) for column in made.values()):
                continue
            deformation = next(made[kind] for kind in DEFORMATIONS if kind in made)
            load = next(made[kind] for kind in LOADS if kind in made)
            if not numbers:
                return i + 1, deformation, load
            above = [_cell(rows[i - 1][1], column) if i else "" for column in (deformation, load)]
            return (i - 1 if _row_of_units((deformation, load), above) else i), deformation, load
    return None


def _numbers(sheet: Sheet, after: int, deformation: Column, load: Column, sure: Collection[str]) -> Table:
    """The numbers below a header; of the kinds in ``sure`` the units are known, whatever the file says."""
    x: list[float] = []
    y: list[float] = []
    lines: list[int] = []
    columns = (deformation, load)
    units: tuple[str, str] | None = None
    for number, row in sheet.rows[after:]:
        cells = [_cell(row, column) for column in columns]
        if not x and not all(map(_is_number, cells)):
            if units is None and (units := _row_of_units(columns, cells)):
                deformation, load = columns = _with_units(columns, units, sure, sheet.place(number))
                continue
            if not any(cell.startswith("=") or _is_number(cell) for cell in cells):
                continue  # more words between the header and the numbers
        values = []
        for cell, column in zip(cells, columns, strict=True):
            if not _is_number(cell):
                raise TensileError(
                    f"{sheet.place(number)}: {cell!r} in the column {column.header!r} {not_a_number(cell)}"
                )
            values.append(_value(cell, column, sheet))
        if not all(map(math.isfinite, values)):
            raise TensileError(f"{sheet.place(number)} holds a value that is not finite ({', '.join(cells)})")
        x.append(values[0])
        y.append(values[1])
        lines.append(number)
    if not x:
        raise TensileError(f"there are no numbers below the header ({deformation.header!r}, {load.header!r})")
    return Table(deformation, load, np.array(x), np.array(y), tuple(lines))


def _cell(row: Sequence[str], column: Column) -> str:
    return row[column.place].strip() if column.place < len(row) else ""


def _row_of_units(columns: Sequence[Column], cells: Sequence[str]) -> tuple[str, str] | None:
    """Both columns' units if a row is one of units: in brackets, or one of them known for what its column holds."""
    bare = [re.sub(r"^[\[(](.*)[\])]$", r"\1", cell) for cell in cells]
    if not any(one != cell or _is_unit(one, column) for one, cell, column in zip(bare, cells, columns, strict=True)):
        return None
    first, second = (
        "" if _unit(one) == NONE and KINDS[c.kind] else _unit(one) for one, c in zip(bare, columns, strict=True)
    )
    return first, second


def _is_unit(text: str, column: Column) -> bool:
    unit = _unit(text)
    return bool(unit) and not _is_number(text) and text != "-" and _size(unit, column) is not None


def _size(unit: str, column: Column) -> float | None:
    """Of a unit in that of what a column holds; None if it is unknown or of another kind."""
    try:
        return quantity(f"1 {unit}", KINDS[column.kind])
    except UnitError:
        return None


def _with_units(
    columns: Sequence[Column], units: Sequence[str], sure: Collection[str], where: str
) -> tuple[Column, Column]:
    """Columns with the units below their headers, but for the kinds in ``sure``.

    Raises:
        TensileError: A header has another unit.
    """
    made = []
    for column, unit in zip(columns, units, strict=True):
        if column.kind in sure or not unit:
            made.append(column)
            continue
        sizes = [_size(one, column) for one in (column.unit, unit)]
        if column.unit and unit != column.unit and not (sizes[0] and sizes[1] and math.isclose(*sizes, rel_tol=1e-6)):
            raise TensileError(
                f"the unit of the column {column.header!r} is {column.unit} in its header and {unit} in {where}; correct "
                f"one of them, or give --columns {column.kind}={column.place + 1}[{column.unit}],..."
            )
        made.append(dataclasses.replace(column, unit=column.unit or unit))
    return made[0], made[1]


def _value(cell: str, column: Column, sheet: Sheet) -> float:
    """A cell's number in the unit of its column; percents may have their sign."""
    text = cell.replace(",", ".") if sheet.separator != "," else cell
    number = float(text.removesuffix("%"))
    if not text.endswith("%") or column.unit == "percent":
        return number
    if KINDS[column.kind] or column.unit not in ("", NONE):
        raise TensileError(f"{cell!r} in the column {column.header!r} is a percentage; give it in {KINDS[column.kind]}")
    return number / 100


def _is_number(text: str) -> bool:
    try:
        float(text.strip().removesuffix("%").replace(",", "."))
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
