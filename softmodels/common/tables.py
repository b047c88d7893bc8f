"""TOML files and tables of users: read with limits, so that a broken or giant one is a sentence, never a hang or a crash."""

from __future__ import annotations

import codecs
import csv
import functools
import io
import itertools
import re
import tomllib
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from softmodels.common import errors, files, units

MAX_TOML_BYTES = 2_000_000
"""Bytes: a setup with a thousand crossings of its grid has a hundred thousand."""
MAX_TOML_DEPTH = 20
"""Tables and lists in each other; a case has three."""
LONGEST_LINE = 20_000
"""Characters in a line: a key of so many parts takes the parser minutes."""
MOST_PARTS = 100
"""Dots in a key, and so in what stands between commas and equals signs."""


class TomlError(ValueError):
    """An unusable file; the message continues the file's name: "is not valid TOML (...)"."""


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file; a byte order mark is left out. `TomlError` if it is no text or TOML, cannot be read, or is larger than
    any file of ours."""
    try:
        text = files.read_text(path, MAX_TOML_BYTES)
    except UnicodeDecodeError:
        raise TomlError("cannot be read (it is not UTF-8 text; save it in that encoding)") from None
    except (OSError, ValueError) as error:  # a name with a zero byte in it is a ValueError
        raise TomlError(f"cannot be read ({errors.reason(error)})") from None
    return parse_toml(text)


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML; whole numbers must fit into 64 bits, as TOML has it. `TomlError` as `read_toml`."""
    for place, line in enumerate(text.splitlines(), 1):
        if len(line) > LONGEST_LINE:
            raise TomlError(f"is rejected: its line {place} has {len(line)} characters, but at most {LONGEST_LINE} are allowed")
        if max(part.count(".") for part in re.split("[=,]", line)) > MOST_PARTS:
            raise TomlError(f"is rejected: a key in its line {place} has more than {MOST_PARTS} parts")
    try:
        tables = tomllib.loads(text.removeprefix("\ufeff"))
    except RecursionError:
        raise TomlError(f"is rejected: it nests more than {MAX_TOML_DEPTH} lists or tables") from None
    except ValueError as error:  # TOMLDecodeError is one, and so is a whole number of 5,000 digits
        raise TomlError(f"is not valid TOML ({_first(error)})") from None
    _check(tables)
    return tables


def _first(error: ValueError) -> str:
    # Only whole numbers beyond Python's limit of digits raise something else than the parser's own error.
    return str(error)[:300] if isinstance(error, tomllib.TOMLDecodeError) else "a whole number of thousands of digits"


def _check(tables: dict[str, Any]) -> None:
    """Look through all values, without recursion."""
    level: list[Any] = [tables]
    for _ in range(MAX_TOML_DEPTH):
        level = [
            value
            for group in level
            for value in (group.values() if isinstance(group, dict) else group)
            if _plain(value) is None
        ]
        if not level:
            return
    raise TomlError(f"is rejected: it nests more than {MAX_TOML_DEPTH} lists or tables")


def _plain(value: Any) -> Any:
    """Return a plain value; None for a list or a table."""
    if isinstance(value, dict | list):
        return None
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise TomlError(f"is not valid TOML (the whole number {units.brief(value)} does not fit into 64 bits)")
    return value


def numbers(value: Any) -> npt.NDArray[np.float64]:
    """Return a list of numbers, or of lists of them, as an array; `UnitError` for an entry that is none, such as a text or
    true, `ValueError` for lists of unlike lengths."""
    if not isinstance(value, list):
        raise ValueError(f"{units.brief(value)} is not a list of numbers")
    if value and all(isinstance(part, list) for part in value):
        return np.array([numbers(part) for part in value], dtype=np.float64)
    for part in value:
        if isinstance(part, str):
            raise units.UnitError(f"{units.brief(part)} is a text; it must be a number")
    return np.array([units.number(part) for part in value], dtype=np.float64)


# ----------------------------------------------------------------------------------------------------------------------
# Tables that a user names, as rows of texts: text with separators, or an Excel workbook (.xlsx).
#
# A workbook is an archive of XML: its unpacked size, columns and rows are bounded before anything is parsed.


type Line = tuple[int, list[str]]
"""A row's number in its file or sheet, from 1, and its cells."""

SEPARATORS = (";", "\t", ",", "  ")
"""Tried in this order: a decimal comma is taken for a separator late; the last one stands for two or more spaces."""
MAX_ROWS, MAX_COLUMNS = 1_048_576, 256
"""Of a sheet; the rows are Excel's own limit. Cells further right are not read."""
MAX_TAGS = 500_000
"""Of a row, a shared text or what else of a workbook is held in memory at once; a full row of Excel has 120,000."""
_LISTED = re.compile(r"\W*col(?:umn|\.)?\s*(\d+)\s*[:=]\s*(\S.*?)\s*$", re.IGNORECASE)
"""A line that names a column by its number, such as ``% column 2: True Strain``."""
_ENDS = re.compile(rb"</(?:\w+:)?(?:row|si)>")
ZIP, OLE = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"
"""First bytes of a workbook, and of one in the format before 2007 or with a password."""
ERRORS = ("#DIV/0!", "#N/A", "#NAME?", "#NULL!", "#NUM!", "#REF!", "#VALUE!")
"""What a spreadsheet shows instead of a value; a row that begins with one is no comment."""


class Worksheet:
    """One reading of a table: a named sheet of a workbook, or a whole text by one separator, either empty for the other."""

    def __init__(self, name: str, separator: str, rows: Callable[[], Iterator[Line]]):
        self.name, self.separator, self._read = name, separator, rows

    @functools.cached_property
    def rows(self) -> list[Line]:
        """Non-empty rows without comments; `csv.Error` if the text is no table with this separator."""
        return [(number, cells) for number, cells in self._read() if any(cell.strip() for cell in cells)]

    def place(self, number: int) -> str:
        """Return where a row is, for messages."""
        return f"row {number} of the sheet {self.name!r}" if self.name else f"line {number}"


def _is_comment(cell: str) -> bool:
    return cell.startswith("#") and not cell.strip().startswith(ERRORS)


def read_sheets(path: Path) -> list[Worksheet]:
    """Return the sheets of a workbook, hidden ones left out, or a text's readings by each separator; `OSError` with its reason
    if this is no table.

    Text is UTF-8, UTF-16, or else Windows' Latin-1, which older test machines write. Cells come as spreadsheets show
    them: a number in a cell of percents is ``"12.5 %"``. A formula that was never evaluated comes as ``"=A1*2"``.
    """
    data = files.read_file(path)
    if data.startswith(ZIP):
        return _workbook(path, data)
    if data.startswith(OLE):
        raise files.UserFileError(
            path, "it is an Excel workbook with a password or in the format before 2007; save it as .xlsx or as CSV"
        )
    lines = [pair for pair in enumerate(_text(path, data).splitlines(), 1) if pair[1].strip()]
    return [Worksheet("", separator, functools.partial(_cells, lines, separator)) for separator in SEPARATORS]


def find[Found](
    path: Path, sheets: Sequence[Worksheet], table: Callable[[Worksheet], Found | None]
) -> list[tuple[Worksheet, Found]]:
    """Return the sheets that have a table, and what ``table`` makes of each; of a text its first reading. `UserFileError` if
    the text is no table with any separator."""
    tables: list[tuple[Worksheet, Found]] = []
    trouble: csv.Error | None = None
    for sheet in sheets:
        try:
            cells = table(sheet)
        except csv.Error as error:
            trouble = error
            continue
        if cells is not None:
            tables.append((sheet, cells))
            if not sheet.name:
                break
    if not tables and trouble is not None:
        raise files.UserFileError(path, f"it is not a table ({trouble})")
    return tables


def pick[Found](
    path: Path, sheets: Sequence[Worksheet], table: Callable[[Worksheet], Found | None]
) -> tuple[Worksheet, Found] | None:
    """Return the only sheet that has a table, see `find`; None if there is none, `UserFileError` if several have one."""
    tables = find(path, sheets, table)
    only(path, [sheet for sheet, _ in tables])
    return tables[0] if tables else None


def only(path: Path, sheets: Sequence[Worksheet]) -> None:
    """Raise `UserFileError` if there are several sheets."""
    if len(sheets) > 1:
        raise files.UserFileError(
            path,
            f"there is a table on each of {named(sheets)}; save the right sheet as CSV, or as a separate workbook",
        )


def named(sheets: Sequence[Worksheet]) -> str:
    """Return the sheets of a workbook in a sentence; empty for a text."""
    names = [repr(sheet.name) for sheet in sheets if sheet.name]
    if len(names) > 10:
        names = [*names[:10], "others"]
    *first, last = names or [""]
    return last and (f"the sheets {', '.join(first)} and {last}" if first else f"the sheet {last}")


def records(rows: Sequence[Line]) -> list[tuple[int, dict[str, str]]]:
    """Return the rows below the first by its names; cells that a short row does not have are empty."""
    if not rows:
        return []
    names = [name.strip() for name in rows[0][1]]
    return [
        (number, {name: cell.strip() for name, cell in itertools.zip_longest(names, cells[: len(names)], fillvalue="")})
        for number, cells in rows[1:]
    ]


def _text(path: Path, data: bytes) -> str:
    wide = "utf-16" if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else ""
    for coding, zeros in (("utf-16-le", data[1:200:2]), ("utf-16-be", data[:200:2])):
        if not wide and len(zeros) > 10 and zeros.count(0) > 0.9 * len(zeros):  # without its mark
            wide = coding
    try:
        text = data.decode(wide or "utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("cp1252", "replace")  # the numbers are the same
    if "\0" in text:
        raise files.UserFileError(path, "this is not a text file and not an Excel workbook; save the sheet as CSV or .xlsx")
    return text


def _with_header(lines: Sequence[tuple[int, str]], separator: str) -> list[tuple[int, str]]:
    """Return the lines of a text without comments; a list of its columns, a line each, becomes one line of headers."""
    listed = [(number, match) for number, line in lines if (match := _LISTED.match(line))]
    header, count = -1, len(listed)
    if count > 1 and [int(match[1]) for _, match in listed] == list(range(1, count + 1)):
        last = listed[-1][0]
        header = last if any(number > last and line.count(separator) >= count - 1 for number, line in lines) else -1
    joined = separator.join(match[2].replace(separator, " ") for _, match in listed)
    # a quote in a comment opens no cell
    return [
        (number, joined if number == header else line) for number, line in lines if number == header or not _is_comment(line)
    ]


def _cells(lines: Sequence[tuple[int, str]], separator: str) -> Iterator[Line]:
    kept = _with_header(lines, separator)
    if separator == SEPARATORS[-1]:
        yield from ((number, re.split(r"\s{2,}", line.strip())) for number, line in kept)
        return
    reader = csv.reader((line for _, line in kept), delimiter=separator, skipinitialspace=True)
    for cells in reader:
        yield kept[reader.line_num - 1][0], cells


def _workbook(path: Path, data: bytes) -> list[Worksheet]:
    broken = files.UserFileError(
        path,
        "it is not an Excel workbook (.xlsx), or a damaged one; save it again with a spreadsheet program, or as CSV",
    )
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            size = sum(member.file_size for member in archive.infolist())
            if size > files.MAX_TEXT_BYTES:
                raise files.UserFileError(
                    path,
                    f"unpacked, its sheets have {size / 1e6:.4g} MB, but at most {files.MAX_TEXT_BYTES / 1e6:g} MB are read; "
                    "save it as CSV",
                )
            for member in archive.infolist():
                with archive.open(member) as part:
                    if _is_too_dense(part):
                        raise files.UserFileError(
                            path, f"a row of its sheets, or its styles, have over {MAX_TAGS:g} parts; save it as CSV"
                        )
    except files.UserFileError:
        raise
    except (zipfile.BadZipFile, zlib.error, EOFError, ValueError, RuntimeError, OSError):
        raise broken from None
    try:
        read = _read_workbook(data, True)
        unknown = {(name, *place) for name, (_, empty) in read.items() for place in empty}
        formulas = {name: cells for name, (cells, _) in _read_workbook(data, False).items()} if unknown else {}
    except Exception:  # openpyxl and the parser of XML raise what they come across
        raise broken from None
    if not read:
        raise broken
    for name, row, column in unknown:
        if (cell := formulas[name].get(row, {}).get(column, "")).startswith("="):
            read[name][0].setdefault(row, {})[column] = cell
    return [Worksheet(name, "", functools.partial(_in_rows, cells)) for name, (cells, _) in read.items()]


def _is_too_dense(part: IO[bytes]) -> bool:
    """Return whether a part of a workbook has so many tags and attributes in a row that its tree would fill the memory."""
    count = 0
    while chunk := part.read(files.CHUNK_BYTES):
        *rows, rest = _ENDS.split(chunk)
        for row in rows:
            if count + row.count(b"<") + row.count(b"=") > MAX_TAGS:
                return True
            count = 0
        count += rest.count(b"<") + rest.count(b"=")
        if count > MAX_TAGS:
            return True
    return False


type Cells = dict[int, dict[int, str]]


def _read_workbook(data: bytes, values: bool) -> dict[str, tuple[Cells, list[tuple[int, int]]]]:
    """By a visible sheet's name its cells by row and column, and the places of those with nothing in them but a style;
    formulas, or their values as the program that wrote them saw them."""
    import warnings

    import openpyxl
    from openpyxl.cell.read_only import EMPTY_CELL

    sheets: dict[str, tuple[Cells, list[tuple[int, int]]]] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about styles and other things that are not read
        book = openpyxl.load_workbook(io.BytesIO(data), read_only=True, data_only=values, keep_links=False)
        for sheet in book.worksheets:
            if sheet.sheet_state != "visible":
                continue
            sheet.reset_dimensions()  # machines write wrong ones
            cells: Cells = {}
            empty: list[tuple[int, int]] = []
            before: Sequence[Any] = ()
            # Without bounds, one cell at the far end of a sheet would make rows without end.
            for row in sheet.iter_rows(max_row=MAX_ROWS, max_col=MAX_COLUMNS):
                if row is before:  # rows that the file leaves out are all one
                    continue
                before = row
                for cell in row:
                    if cell is EMPTY_CELL:
                        continue
                    if cell.value is not None:
                        cells.setdefault(cell.row, {})[cell.column] = _shown_text(cell, values)
                    elif cell.data_type == "n":  # a formula with an empty text for its value is "str"
                        empty.append((cell.row, cell.column))
            sheets[sheet.title] = cells, empty
        book.close()
    return sheets


def _shown_text(cell: Any, values: bool) -> str:
    value, style = cell.value, cell.number_format or ""
    if cell.data_type == "f" and not values:
        return value if isinstance(value, str) else "={...}"
    if isinstance(value, bool):
        return str(value).upper()
    if isinstance(value, int | float) and "%" in style:
        literal = "%" not in re.sub(r'"[^"]*"|\\.', "", style)
        return f"{value if literal else 100 * value!r} %"
    return repr(value) if isinstance(value, int | float) else str(value)


def _in_rows(cells: Cells) -> Iterator[Line]:
    for place in sorted(cells):
        row = cells[place]
        if not _is_comment(row.get(1, "")):
            yield place, [row.get(column, "") for column in range(1, max(row) + 1)]
