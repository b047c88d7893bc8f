"""The list of photographs, ``photos.csv``: which file was taken at which pressure.

Columns: ``file``; ``pressure`` with its unit, or ``left`` and ``right``, the levels of the two tubes; optionally ``error``;
optionally ``time``, when it was taken; optionally ``hold`` and ``rise``, how long the pressure was held before and how long the
change to it took; optionally ``use``, which is ``anyway`` where a photograph shall be used in spite of doubts. A file is named
relative to the list, or by the number its camera gave it: 5965 finds IMG_5965.JPG.
"""

from __future__ import annotations

import codecs
import csv
import dataclasses
import functools
import math
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from measurement import pictures, robust
from measurement.outline import outline
from measurement.outline.outline import Outline
from softmodels.common import errors, files, units

READING_ERROR = 0.5e-3
"""Standard error in m of reading one level against a millimetre scale."""

DENSITY_ERROR = 10.0 / math.sqrt(12.0)
"""Standard error in kg/m3 of a density given as 0.97 g/ml: even chances over the last digit."""


@dataclasses.dataclass(frozen=True)
class Column:
    """A water column.

    Attributes:
        density: Density of its liquid in kg/m3.
        density_error: Its standard error in kg/m3.
        reading_error: Standard error of reading one level in m.
    """

    density: float = units.WATER_DENSITY
    density_error: float = DENSITY_ERROR
    reading_error: float = READING_ERROR

    def __post_init__(self) -> None:
        if not (math.isfinite(self.density) and self.density > 0.0):
            raise ColumnError(f"the density of the water column is {self.density:g} kg/m3; it must be positive")
        for name in ("density_error", "reading_error"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ColumnError(f"{name} of the water column is {value:g}; it must not be negative")

    def pressure(self, difference: float) -> tuple[float, float]:
        """Return the pressure and standard error in Pa of a difference of two levels in m; each level was read once."""
        levels = self.density * units.STANDARD_GRAVITY * self.reading_error * math.sqrt(2.0)
        share = units.STANDARD_GRAVITY * difference * self.density_error
        return self.density * units.STANDARD_GRAVITY * difference, math.hypot(levels, share)

    def read(self, text: str, error: str = "") -> tuple[float, float]:
        """Read a pressure written as a person does.

        Args:
            text: A difference of levels such as ``"12.5 cm"`` (at this column's density), or a pressure such as
                ``"1.2 kPa"`` or ``"35 mmH2O"``.
            error: Its standard error with a unit, a length or a pressure; empty for the default: two readings of the
                column, or 1 % of a pressure.

        Returns:
            Pressure and standard error in Pa.

        Raises:
            ColumnError: Not a number with such a unit, or a negative error.
        """
        value, is_length = _length_or_pressure(text)
        pressure, default = self.pressure(value) if is_length else (value, GAUGE_ERROR * abs(value))
        if not error.strip():
            return pressure, default
        given, is_length = _length_or_pressure(error)
        if given < 0.0:
            raise ColumnError(f"the error {error!r} is negative")
        if is_length:
            given = math.hypot(self.density * units.STANDARD_GRAVITY * given, self.density_error / self.density * pressure)
        return pressure, given

    def read_tubes(self, left: str, right: str, error: str = "") -> tuple[float, float]:
        """Read the levels of both tubes, such as ``"31.2 cm"`` and ``"18.7 cm"``; the higher one is the open tube.

        Returns:
            Pressure and standard error in Pa; the pressure is left minus right.

        Raises:
            ColumnError: A level that is not a length.
        """
        levels = []
        for text in (left, right):
            value, is_length = _length_or_pressure(text)
            if not is_length and value != 0.0:
                raise ColumnError(f"{text!r} is not the level of a tube; write it like 31.2 cm")
            levels.append(value)
        return self.read(f"{levels[0] - levels[1]!r} m", error)


def _length_or_pressure(text: str) -> tuple[float, bool]:
    """Return the value in m or Pa, and whether it is a length; a plain 0 is a length."""
    if not any(letter.isdigit() for letter in text):
        raise ColumnError(f"{units.brief(text.strip())} is neither a column of water nor a pressure; {FORMS}")
    try:
        value, unit = units.number_and_unit(text)
    except units.UnitError as error:
        raise ColumnError(f"{error}; {FORMS}") from None
    pascal = WATER_UNITS.get(unit.lower().replace(" ", "").replace("_", ""))
    if pascal is not None:
        return value * pascal, False
    if not unit and value != 0.0:
        raise ColumnError(f"{units.brief(text.strip())} has no unit; {FORMS}")
    try:
        return units.quantity(text, "m"), True
    except units.UnitError:
        try:
            return units.quantity(text, "Pa"), False
        except units.UnitError:
            raise ColumnError(f"{units.brief(text.strip())} is neither a column of water nor a pressure; {FORMS}") from None


KNOWN_COLUMNS = ("file", "pressure", "left", "right", "error", "time", "hold", "rise", "use")
TIMES = ("hold", "rise")
ANYWAY = "anyway"
"""In the column ``use`` of a photograph that shall be used in spite of doubts."""
PICTURES = (
    *(".jpg", ".jpeg", ".mpo", ".png", ".tif", ".tiff", ".heic", ".heif", ".hif"),
    *(".avif", ".webp", ".jp2", ".bmp", ".ppm", ".pgm", ".gif"),
)


class PhotoListError(ValueError):
    """An unusable list of photographs; the message names the row."""


@dataclasses.dataclass(frozen=True)
class Photograph:
    """One row of the list.

    Attributes:
        file: The photograph; it need not exist, that is found out when it is measured.
        pressure: Pressure in Pa.
        pressure_error: Its standard error in Pa.
        history: Pressures up to the photograph; empty if the list has no times.
        row: Its row as it is written, by column; empty if it is in no list.
        anyway: Whether it shall be used in spite of doubts.
        time: When it was taken, in s; None if the list does not say.
    """

    file: Path
    pressure: float
    pressure_error: float
    history: outline.History = ()
    row: Mapping[str, str] = dataclasses.field(default_factory=dict, compare=False)
    anyway: bool = False
    time: float | None = None

    @property
    def by_length(self) -> bool:
        """Whether its pressure was read as a height of the column above 0, so that it depends on the liquid's density."""
        if self.row.get("left"):
            return True
        try:
            height, is_length = _length_or_pressure(self.row.get("pressure", ""))
        except ColumnError:
            return False
        return is_length and height != 0.0

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
    lines = [(number, line) for number, line in enumerate(_text(path).splitlines(), 1) if line.strip(" \t;,")]
    plain = [(number, line) for number, line in lines if not line.lstrip().startswith("#")]
    if not plain:
        raise PhotoListError(f"the list of photographs {path} is empty; its first line must be file,pressure or the like")
    separator = next((mark for mark in ";\t" if mark in plain[0][1]), ",")
    _check_comments(path, [row for row in lines if row not in plain], separator)
    try:
        header = [word.lower() for word in _words(plain[0][1], separator)]
    except PhotoListError as error:
        raise PhotoListError(f"{path}, line {plain[0][0]}: {error}") from None
    while header and not header[-1]:  # spreadsheets keep the empty columns they once showed
        header.pop()
    _check_header(path, header)
    photographs: list[Photograph] = []
    known: dict[str, str] = {}
    clock = _Clock() if "hold" in header else None
    for number, line in plain[1:]:
        try:
            row = _row(header, _words(line, separator))
            photo = _photograph(path.parent, row, column)
            if clock is not None:
                photo = dataclasses.replace(photo, history=clock.moved(photo, row["hold"], row["rise"]))
        except (ColumnError, PhotoListError) as error:
            raise PhotoListError(f"{path}, line {number}: {error}") from None
        same = known.setdefault(os.path.realpath(photo.file), photo.file.name)
        if same != photo.file.name or photo.file in [earlier.file for earlier in photographs]:
            also = "" if same == photo.file.name else f", also as {same}"
            raise PhotoListError(f"{path}, line {number}: {photo.file.name} is in the list twice{also}")
        photographs.append(photo)
    if not photographs:
        raise PhotoListError(f"the list of photographs {path} has no rows under its header")
    return photographs


def _text(path: Path) -> str:
    """Return the list's text: UTF-8, or the UTF-16 that spreadsheets call Unicode text."""
    try:
        data = files.read_file(path)
    except OSError as error:
        raise PhotoListError(f"the list of photographs {path} cannot be read: {errors.reason(error)}") from None
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise PhotoListError(
            f"the list of photographs {path} cannot be read: line {line} is not UTF-8 text; save it as CSV UTF-8"
        ) from None
    if "\0" in text:
        raise PhotoListError(f"the list of photographs {path} cannot be read: it holds NUL bytes, so it is not text")
    return text


def _words(line: str, separator: str) -> list[str]:
    try:
        return [word.strip() for word in next(csv.reader([line], delimiter=separator))]
    except csv.Error as error:
        raise PhotoListError(f"it is not a row of a CSV file ({error})") from None


def _check_comments(path: Path, comments: list[tuple[int, str]], separator: str) -> None:
    """Reject a line that may be meant as a comment or as the row of a photograph whose name begins with #."""
    for number, line in comments:
        name = line.strip().partition(separator)[0].strip()
        if len(name) > 1 and _exists(path.parent / name):
            raise PhotoListError(
                f"{path}, line {number}: # begins a comment, but there is a photograph {name}; write ./{name} to "
                "list it, or a space after the # to leave it out"
            )


def _exists(file: Path) -> bool:
    """Return whether there is such a file or folder; a name that no system takes is none."""
    try:
        return file.exists()
    except (OSError, ValueError):
        return False


def _pictures(folder: Path) -> list[Path]:
    """Return the pictures in a folder by name; none where there is no such folder or nobody may look into it."""
    try:
        return sorted(file for file in folder.iterdir() if file.suffix.lower() in PICTURES)
    except (OSError, ValueError):
        return []


def _check_header(path: Path, header: list[str]) -> None:
    for name in header:
        if name not in KNOWN_COLUMNS:
            raise PhotoListError(f"{path}: column {name!r} is unknown; the columns are {', '.join(KNOWN_COLUMNS)}")
        if header.count(name) > 1:
            raise PhotoListError(f"{path}: column {name!r} is in the header twice")
    if "file" not in header:
        raise PhotoListError(f"{path} has no column 'file' in its first line")
    if ("pressure" in header) == ("left" in header or "right" in header):
        raise PhotoListError(f"{path} needs either a column 'pressure' or the two columns 'left' and 'right'")
    if ("hold" in header) != ("rise" in header):
        given, other = TIMES if "hold" in header else TIMES[::-1]
        raise PhotoListError(
            f"{path} has a column {given!r} but none {other!r}; give both: how long the pressure was held before the "
            "photograph, and how long the change to it took, such as 10 s and 2 s"
        )
    if ("left" in header) != ("right" in header):
        raise PhotoListError(f"{path} has the level of one tube only; it needs both columns 'left' and 'right'")


def _row(header: list[str], words: list[str]) -> dict[str, str]:
    if len(words) < len(header) or any(words[len(header) :]):
        more = "; commas separate columns here, so write decimals with a point" if len(words) > len(header) else ""
        raise PhotoListError(f"{len(words)} values in the row, {len(header)} columns in the header{more}")
    row = dict(zip(header, words, strict=False))
    if not row["file"]:
        raise PhotoListError("the row has no file name")
    return row


def _photograph(folder: Path, row: dict[str, str], column: Column) -> Photograph:
    error = row.get("error", "")
    if "pressure" in row:
        pressure, pressure_error = column.read(row["pressure"], error)
    else:
        pressure, pressure_error = column.read_tubes(row["left"], row["right"], error)
    if (use := row.get("use", "")).lower() not in ("", ANYWAY):
        raise PhotoListError(
            f"use is {units.brief(use)}; write {ANYWAY} to use the photograph in spite of doubts, or leave it empty"
        )
    time = _seconds("time", row["time"]) if row.get("time") else None
    return Photograph(_find(folder, row["file"]), pressure, pressure_error, row=row, anyway=bool(use), time=time)


class _Clock:
    """The history of the pressure, row by row in the order in which the photographs were taken. A row of the same pressure
    as the one before belongs to the same hold."""

    def __init__(self) -> None:
        self.corners: list[tuple[float, float]] = [(0.0, 0.0)]
        self.reached, self.hold = 0.0, 0.0
        self.origin: float | None = None  # the first rise's beginning, by the list's times

    def moved(self, photo: Photograph, hold: str, rise: str) -> outline.History:
        """Return the history up to the photograph of the next row; one at zero pressure before any rise is at rest. A pressure
        lasts until the next change, whose beginning a time of its photograph tells, and else until its last photograph. Raises
        `PhotoListError` for a time that is missing, negative, or not after that of the row before."""
        (time, before), pressure = self.corners[-1], photo.pressure
        if len(self.corners) == 1 and photo.is_zero:
            return tuple(self.corners)
        new = pressure != before
        if not hold or (new and not rise):
            what = ("rise", "2 s") if hold else ("hold", "10 s")
            raise PhotoListError(
                f"the row has no time of {what[0]}; give one in every row, such as {what[1]}, or leave both columns out"
            )
        held = _seconds("hold", hold)
        if new:
            took, taken = _seconds("rise", rise), photo.time
            begin = time if self.origin is None or taken is None else max(time, taken - self.origin - held - took)
            self.corners += [(begin, before)] if begin > time else []
            self.reached = begin + took
            self.origin = taken - self.reached - held if self.origin is None and taken is not None else self.origin
            self.corners.append((self.reached, pressure))
        elif not held > self.hold:
            raise PhotoListError(
                f"a hold of {held:g} s is not longer than the {self.hold:g} s of the row before, at the same pressure; "
                "list the photographs in the order in which they were taken"
            )
        if held > 0.0:
            self.corners.append((self.reached + held, pressure))
        self.hold = held
        return tuple(self.corners)


def _seconds(name: str, text: str) -> float:
    try:
        value = units.quantity(text, "s")
    except units.UnitError as error:
        raise PhotoListError(f"{name}: {error}") from None
    if value < 0.0:
        raise PhotoListError(f"a {name} of {value:g} s is negative")
    return value


def _find(folder: Path, name: str) -> Path:
    """Return the file of this name, of this name in other letters (cameras shout), or of this number."""
    path = folder / name
    if _exists(path):
        return path
    files = _pictures(path.parent)
    same = [file for file in files if file.name.lower() == path.name.lower()]
    if not same and re.fullmatch(r"[0-9]+", name):
        same = [file for file in files if re.search(rf"(?<![0-9])0*{name.lstrip('0')}$", file.stem)]
    if len(same) > 1:
        raise PhotoListError(f"{name} matches several files: {', '.join(file.name for file in same)}")
    return same[0] if same else path


# ----------------------------------------------------------------------------------------------------------------------
# The water column: readings in cm become pressures in Pa with a standard error.
#
# Two upright tubes, joined below, hold water of a known density; one is open, the other joined to the actuator. The gauge
# pressure inside is density x gravity x difference of the two levels.


WATER_UNITS = {"mmh2o": 9.80665, "cmh2o": 98.0665, "mmws": 9.80665, "cmws": 98.0665}
"""Conventional columns of water in Pa (1000 kg/m3, standard gravity): a gauge's unit, not a length read off a tube."""

FORMS = "write a column like 12.5 cm or a pressure like 1.2 kPa"

GAUGE_ERROR = 0.01
"""Relative standard error assumed of a pressure given in Pa without one, as of a simple gauge."""


class ColumnError(ValueError):
    """A reading is not a pressure; the message is for the user."""


# ----------------------------------------------------------------------------------------------------------------------
# Detect copies of photographs (saved again, brightened or resized) by their noise.
#
# Two exposures have each its own noise, however alike what they show; a copy has its original's, weakened by compression but
# not gone. What all photographs of a run share (the grid, the screen's grain, the sensor's own pattern) is no sign of a copy:
# it is taken away by regression on other photographs of the run. For each of the two on others, so that the noise of those
# cannot make the two alike, and with half of those as instruments for the other half, so that their noise does not weaken
# the regression (O. Reiersol, Econometrica 9 (1941) 1, doi 10.2307/1907171). What is left is not correlated between honest
# exposures, to some thousandths in half a million pixels.


Float32Array = npt.NDArray[np.float32]

FINGERPRINT_ROWS, FINGERPRINT_COLUMNS, FINGERPRINT_SIDE_PX = 3, 4, 192
"""Patches in a column and in a row of the frame, and their side in px, that are kept of each photograph."""

SMOOTHING_PX = 3.0
"""Standard deviation in px of the smooth part that is taken away."""

MAX_LIGHT_DIFFERENCE, EDGE_MARGIN_PX = 0.15, 13
"""Share of the lit screen's brightness by which photographs may differ at a place that is compared, and its surroundings
in px that are left out: the shadows' edges lie elsewhere in each."""

MOST_OTHERS = 4
"""Photographs of the same run that tell what all of them share."""

MIN_COPY_CORRELATION = 0.03
"""Least correlation of what is left by which one is the other's copy; honest exposures stay below 0.007."""

COPIED_BY_ONE = 0.06
"""By how much two must be more alike than each is to the only other photograph."""

SAME_OUTLINE_TOLERANCE = 60e-6
"""Distance in m up to which two outlines may show the same: a copy of another brightness moves the edge a little."""


@dataclasses.dataclass(frozen=True, eq=False)
class Sample:
    """Data of a photograph by which copies are recognised: what is left without the smooth part and without outliers,
    shape (n,), and the smooth part over its largest value, shape (patches, side, side)."""

    fine: Float32Array
    smooth: Float32Array


def cut_out(image: pictures.Pixels) -> pictures.Pixels:
    """Return the patches (patches, side, side) of a picture (h, w, 3) in grey, spread over its frame."""
    height, width = image.shape[:2]
    side = min(FINGERPRINT_SIDE_PX, height // FINGERPRINT_ROWS, width // FINGERPRINT_COLUMNS)
    tops = np.linspace(0, height - side, FINGERPRINT_ROWS).astype(int)
    lefts = np.linspace(0, width - side, FINGERPRINT_COLUMNS).astype(int)
    patches = [cv2.cvtColor(image[y : y + side, x : x + side], cv2.COLOR_RGB2GRAY) for y in tops for x in lefts]
    return np.stack(patches)


def prepared(patches: pictures.Pixels) -> Sample:
    """Return the patches of `cut_out`, parted into what is smooth and what is fine."""
    light = patches.astype(np.float32)
    smooth = np.stack([cv2.GaussianBlur(patch, (0, 0), SMOOTHING_PX) for patch in light])
    fine = (light - smooth).ravel()
    scatter = max(robust.deviation(fine), 0.3)
    level = max(float(smooth.max()), 1.0)
    return Sample(np.clip(fine, -5.0 * scatter, 5.0 * scatter).astype(np.float32), (smooth / level).astype(np.float32))


def likeness(first: Sample, second: Sample, others: Sequence[Sample]) -> float:
    """Return the correlation of what two photographs do not share with other, different ones of the run; NaN where it is
    unknown. With fewer than two others the bar is another, see `is_copy`."""
    if not others or any(other.fine.shape != first.fine.shape for other in (second, *others)):
        return np.nan
    still = _unchanged_places([first, second, *others])
    if still.sum() < 1000:
        return np.nan
    light, two, *rest = (sample.fine[still].astype(np.float64) for sample in (first, second, *others))
    if len(rest) == 1:
        return _correlation(light, two) - max(_correlation(light, rest[0]), _correlation(two, rest[0]))
    half = len(rest) // 2
    left, right = np.mean(rest[:half], axis=0), np.mean(rest[half:], axis=0)
    grids = []
    for pattern, instrument in ((left, right), (right, left)):
        shared = float(pattern @ instrument)
        if not shared > 0.0:
            grids.append(_correlation(light, two))
            continue
        rest_one = light - float(light @ instrument) / shared * pattern
        rest_two = two - float(two @ pattern) / shared * instrument
        grids.append(_correlation(rest_one, rest_two))
    return float(np.mean(grids))


def is_copy(first: Sample, second: Sample, others: Sequence[Sample]) -> bool:
    """Return whether one of two photographs is the other's copy, judged by up to `MOST_OTHERS` others of the run."""
    others = list(others)[:MOST_OTHERS]
    alike = likeness(first, second, others)
    if len(others) < 2:
        return bool(alike > COPIED_BY_ONE)
    if not alike > MIN_COPY_CORRELATION:
        return False
    # A camera that was nudged between photographs makes those before it alike, and those after it.
    usual = [
        likeness(sample, other, [rest for rest in others if rest is not other])
        for sample in (first, second)
        for other in others
        if len(others) > 2
    ]
    return bool(alike > 2.0 * max([0.0, *(value for value in usual if np.isfinite(value))]))


def copies(outlines: Mapping[int, Outline], samples: Mapping[int, pictures.Pixels]) -> dict[int, str]:
    """Return a sentence for each photograph that is a copy by its noise and must not be used, by the numbers of the
    outlines and of the patches from `cut_out`: both of two at different pressures, of which one at least is wrong, and the
    later one of two at the same pressure, which would count twice."""
    usable = [k for k in outlines if k in samples]
    kept = functools.cache(lambda k: prepared(samples[k]))
    near = {(i, j) for i in usable for j in usable if i != j and _same_outline(outlines[i], outlines[j])}
    copies: dict[int, str] = {}
    for i, j in sorted(near):
        if i > j:
            continue
        # Those that show something else are surely no further copies, and the nearest in time share the most.
        rest = sorted((k for k in usable if k not in (i, j)), key=lambda k: ((i, k) in near or (j, k) in near, abs(k - i)))
        if is_copy(kept(i), kept(j), [kept(k) for k in rest[:MOST_OTHERS]]):
            first, second = outlines[i], outlines[j]
            if first.pressure != second.pressure:
                copies.setdefault(i, _two_pressures(second.source))
                copies.setdefault(j, _two_pressures(first.source))
            else:
                copies.setdefault(j, f"it is a copy of {first.source}, saved again: {SAME_NOISE}, so it counts once")
    return copies


SAME_NOISE = "it has the same noise, which two exposures never have"


def _two_pressures(other: str) -> str:
    return f"it and {other} are copies of one photograph: {SAME_NOISE}; one of their different pressures is wrong"


def _same_outline(outline: Outline, two: Outline) -> bool:
    if abs(outline.height - two.height) > SAME_OUTLINE_TOLERANCE:
        return False
    left, right = max(outline.x[0], two.x[0]), min(outline.x[-1], two.x[-1])
    inside = (outline.x >= left) & (outline.x <= right)
    if inside.sum() < 10:
        return False
    return float(np.median(np.abs(outline.z[inside] - np.interp(outline.x[inside], two.x, two.z)))) <= SAME_OUTLINE_TOLERANCE


def _unchanged_places(samples: Sequence[Sample]) -> npt.NDArray[np.bool_]:
    """Return the places (n,) that look alike in all: no shadow's edge passes over them."""
    middle = np.median([sample.smooth for sample in samples[2:]], axis=0)
    thin = middle.ravel()[::37]
    moving = np.zeros(middle.shape, dtype=bool)
    for sample in samples:
        # A copy may be brighter, or of another gamma: a line through the brightnesses is near enough.
        scale, offset = np.polyfit(sample.smooth.ravel()[::37], thin, 1)
        moving |= np.abs(scale * sample.smooth + offset - middle) > MAX_LIGHT_DIFFERENCE
    kernel = np.ones((EDGE_MARGIN_PX, EDGE_MARGIN_PX), np.uint8)
    return np.stack([cv2.dilate(patch.astype(np.uint8), kernel) == 0 for patch in moving]).ravel()


def _correlation(light: npt.NDArray[np.float64], two: npt.NDArray[np.float64]) -> float:
    size = float(light @ light) * float(two @ two)
    return float(light @ two) / float(np.sqrt(size)) if size > 0.0 else 0.0


def same_pictures(photographs: Sequence[Photograph]) -> dict[Path, str]:
    """Return a sentence for each file whose bytes another file of the list repeats: at two pressures one is wrong, at one
    pressure they count once, so that all but the first are reported."""
    alike: dict[str, list[Photograph]] = {}
    for photo in photographs:
        try:
            alike.setdefault(files.file_digest(photo.file), []).append(photo)
        except (OSError, ValueError):
            continue  # a file that cannot be read is rejected with its own reason
    same_pictures: dict[Path, str] = {}
    for group in alike.values():
        one_pressure = len({photo.pressure for photo in group}) == 1
        for photo in group[1:] if one_pressure else group:
            others = group[:1] if one_pressure else [other for other in group if other is not photo]
            names = " and ".join(other.file.name for other in others)
            wrong = "and counts once" if one_pressure else "listed at another pressure: one of the two is wrong"
            same_pictures[photo.file] = f"it is the same picture as {names}, {wrong}"
    return same_pictures
