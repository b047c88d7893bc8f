"""The list of photographs, ``photos.csv``: which file was taken at which pressure.

Columns: ``file``; ``pressure`` with its unit, or ``left`` and ``right``, the levels of the two tubes; optionally ``error``.
A file is named relative to the list, or by the number its camera gave it: 5965 finds IMG_5965.JPG.
"""

from __future__ import annotations

import csv
import dataclasses
import re
from pathlib import Path

from measurement.column import Column, ColumnError
from measurement.reasons import reason

KNOWN = ("file", "pressure", "left", "right", "error")
PICTURES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp")


class PhotoListError(ValueError):
    """A list of photographs that cannot be used; the message is a sentence for the user naming the row."""


@dataclasses.dataclass(frozen=True)
class Photograph:
    """One row of the list.

    Attributes:
        file: The photograph; it need not exist, that is found out when it is measured.
        pressure: Pressure in Pa.
        pressure_error: Its standard error in Pa.
    """

    file: Path
    pressure: float
    pressure_error: float

    @property
    def is_zero(self) -> bool:
        """Whether its pressure does not differ from zero by more than twice its error."""
        return abs(self.pressure) <= 2.0 * self.pressure_error


def read_photos(path: Path, column: Column | None = None) -> list[Photograph]:
    """Read a list of photographs.

    Args:
        path: The CSV file; ``;`` may stand for ``,``.
        column: The water column that its lengths were read from.

    Returns:
        One entry per row, in the file's order.

    Raises:
        PhotoListError: No such file, no or unknown columns, no rows, or a row that cannot be read, with its number.
    """
    path, column = Path(path), column or Column()
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise PhotoListError(f"the list of photographs {path} cannot be read: {reason(error)}") from None
    lines = [
        (number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip() and line.strip()[0] != "#"
    ]
    if not lines:
        raise PhotoListError(
            f"the list of photographs {path} is empty; its first line must be file,pressure or the like"
        )
    separator = ";" if ";" in lines[0][1] else ","
    header = [word.strip().lower() for word in next(csv.reader([lines[0][1]], delimiter=separator))]
    _check_header(path, header)
    photographs = []
    for number, line in lines[1:]:
        words = [word.strip() for word in next(csv.reader([line], delimiter=separator))]
        try:
            photographs.append(_photograph(path.parent, header, words, column))
        except (ColumnError, PhotoListError) as error:
            raise PhotoListError(f"{path}, line {number}: {error}") from None
        if photographs[-1].file in [earlier.file for earlier in photographs[:-1]]:
            raise PhotoListError(f"{path}, line {number}: {photographs[-1].file.name} stands in the list twice")
    if not photographs:
        raise PhotoListError(f"the list of photographs {path} has no rows under its header")
    return photographs


def _check_header(path: Path, header: list[str]) -> None:
    for name in header:
        if name not in KNOWN:
            raise PhotoListError(f"{path}: column {name!r} is not known; the columns are {', '.join(KNOWN)}")
        if header.count(name) > 1:
            raise PhotoListError(f"{path}: column {name!r} stands in the header twice")
    if "file" not in header:
        raise PhotoListError(f"{path} has no column 'file' in its first line")
    if ("pressure" in header) == ("left" in header or "right" in header):
        raise PhotoListError(f"{path} needs either a column 'pressure' or the two columns 'left' and 'right'")
    if ("left" in header) != ("right" in header):
        raise PhotoListError(f"{path} has the level of one tube only; it needs both columns 'left' and 'right'")


def _photograph(folder: Path, header: list[str], words: list[str], column: Column) -> Photograph:
    if len(words) != len(header):
        more = "; a comma parts columns here, and decimals have a point" if len(words) > len(header) else ""
        raise PhotoListError(f"{len(words)} values in the row, {len(header)} columns in the header{more}")
    row = dict(zip(header, words, strict=True))
    if not row["file"]:
        raise PhotoListError("the row names no file")
    error = row.get("error", "")
    if "pressure" in row:
        pressure, pressure_error = column.read(row["pressure"], error)
    else:
        pressure, pressure_error = column.read_tubes(row["left"], row["right"], error)
    return Photograph(_find(folder, row["file"]), pressure, pressure_error)


def _find(folder: Path, name: str) -> Path:
    """The file of this name, of this name in other letters (cameras shout), or of this number."""
    path = folder / name
    if path.exists() or not path.parent.is_dir():
        return path
    files = sorted(file for file in path.parent.iterdir() if file.suffix.lower() in PICTURES)
    same = [file for file in files if file.name.lower() == path.name.lower()]
    if not same and re.fullmatch(r"\d+", name):
        same = [file for file in files if (found := re.search(r"(\d+)$", file.stem)) and int(found[1]) == int(name)]
    if len(same) > 1:
        raise PhotoListError(f"{name} fits several files: {', '.join(file.name for file in same)}")
    return same[0] if same else path
