"""Tables of test machines: find the columns of a curve by their headers and units, tell specimens apart, read the numbers.

Headers are compared with one table of words, `WORDS`, and units with `UNITS`. A module that ``SOFTMODELS_MODULES`` names adds
to them by a line: ``columns.register_words("force", "kuvvet")``, ``columns.UNITS["kp"] = "kgf"``.
"""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import datetime
import functools
import itertools
import math
import re
import unicodedata
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from softmodels.common import errors, files, tables
from softmodels.common.arrays import Array
from softmodels.common.units import FORMULA, UnitError, quantity

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
    "time": "s",
    "frequency": "Hz",
    "angular-frequency": "1/s",
    "storage-modulus": "Pa",
    "loss-modulus": "Pa",
    "tan-delta": "",
    "temperature": "K",
    "acceleration": "m/s^2",
    "added-volume": "m^3",
    "volume": "m^3",
    "diameter": "m",
    "rise": "m",
}
"""Kinds of columns, and the unit of each. Strain and stress without ``true`` are the engineering ones."""

DEFORMATIONS = ("stretch", "strain", "true-strain", "extension", "radius")  # the first one in a file is used
LOADS = ("stress", "true-stress", "force", "pressure")


@dataclasses.dataclass(frozen=True)
class Layout:
    """What a table holds: kinds of columns along which it is read and kinds of what is read, of each of which the first one in
    a file is used, further kinds, both in words, and as headers and as columns."""

    along: tuple[str, ...]
    read: tuple[str, ...]
    further: tuple[str, ...]
    words: tuple[str, str]
    headers: str
    columns: str

    @property
    def kinds(self) -> tuple[str, ...]:
        return (*self.along, *self.read, *self.further)


CURVE = Layout(
    DEFORMATIONS, LOADS, ("time",), ("deformation", "load"), "'strain (%)' and 'stress (MPa)'", "strain=1[%],stress=2[MPa]"
)
OSCILLATION = Layout(
    ("angular-frequency", "frequency"), ("storage-modulus", "loss-modulus", "tan-delta", "temperature"), (),
    ("frequency", "modulus or tan delta"), "'frequency (Hz)' and 'storage modulus (MPa)'",
    "frequency=1[Hz],storage-modulus=2[MPa]",
)  # fmt: skip
VIBRATION = Layout(
    ("time",), ("extension", "acceleration"), (), ("time", "displacement or acceleration"),
    "'time (s)' and 'displacement (mm)'", "time=1[s],extension=2[mm]",
)  # fmt: skip

INFLATION = Layout(
    ("added-volume", "volume", "radius", "diameter", "rise"), ("pressure",), (), ("volume, radius or rise", "pressure"),
    "'volume (ml)' and 'pressure (kPa)'", "volume=1[ml],pressure=2[kPa]",
)  # fmt: skip
LOG = Layout(("time",), ("pressure",), (), ("time", "pressure"), "'time (s)' and 'pressure (kPa)'", "time=1[s],pressure=2[kPa]")

WORDS = {
    "time": ["time", "elapsed", "*zeit", "temps", "tiempo", "tempo", "zaman", "时间", "時間"],
    "stretch": ["stretch*", "lambda", "extension ratio", "streckgrad", "etirement"],
    "strain": ["strain", "elongation", "*dehnung", "allongement", "deformation", "deformacion", "deformazione",
               "verformung", "*stauchung", "*ひすみ",
               "alargamiento", "allungamento", "birim uzama", "epsilon", "*应变"],
    "radius": ["radius", "rayon"],
    "extension": ["extension", "extensometer", "verlangerung", "*langenanderung", "extensometre", "uzama", "伸长",
                  # the machine's way, which a column of the specimen's own is preferred to
                  "displacement", "crosshead", "stroke", "travel", "position", "distance", "traverse", "*weg", "course",
                  "deplacement", "desplazamiento", "spostamento", "corsa",
                  "位移", "変位"],
    "stress": ["stress", "*spannung", "contrainte", "esfuerzo", "sforzo", "gerilme", "sigma", "*应力", "*応力"],
    "force": ["force", "load", "*kraft", "charge", "fuerza", "carga", "forza", "carico", "kuvvet", "last",
              "载荷", "荷重", "試験力"],
    "pressure": ["pressure", "druck", "uberdruck", "innendruck", "pression", "presion"],
    "angular-frequency": ["angular frequency", "ang frequency", "kreisfrequenz", "pulsation", "frecuencia angular", "omega"],
    "frequency": ["frequency", "freq", "*frequenz", "frequence", "frecuencia", "频率", "周波数"],
    "storage-modulus": ["storage modulus", "storage", "*speichermodul", "module de conservation", "module de stockage",
                        "modulo de almacenamiento", "modulo di accumulo", "储能模量", "貯蔵弾性率"],
    "loss-modulus": ["loss modulus", "*verlustmodul", "module de perte", "modulo de perdida", "modulo di perdita", "损耗模量",
                     "損失弾性率"],
    "tan-delta": ["tan delta", "tandelta", "loss factor", "damping factor", "*verlustfaktor", "facteur de perte"],
    "added-volume": ["added volume", "injected", "infused", "volume added", "volume injected", "volume change", "delta v",
                     "zugefuhrtes volumen", "volume ajoute", "volumen anadido"],
    "volume": ["volume", "vol", "*volumen", "体积", "体積"],
    "diameter": ["diameter", "*durchmesser", "diametre", "diametro"],
    "rise": ["rise", "height", "apex", "deflection", "displacement", "*hohe", "*auslenkung", "*weg", "fleche", "hauteur",
             "deplacement", "altura", "altezza", "desplazamiento", "spostamento"],
    "acceleration": ["acceleration", "accelerometer", "accel", "*beschleunigung", "aceleracion", "accelerazione"],
    "temperature": ["temperature", "temp", "temperatur", "temperatura", "温度"],
}  # fmt: skip
"""Words of headers by kind, the first kind with a word of the header being its own; without accents, in small letters. A star
stands for any letters: German joins words."""
LETTERS = {"p": "pressure", "v": "volume", "r": "radius", "d": "diameter"}
"""Symbols that stand for a whole header of an inflation or a log."""
MACHINE = "displacement|crosshead|stroke|travel|position|distance|traverse|\\w*weg|course|deplacement|desplazamiento"
SPECIMENS = "specimen|specimen no|sample|sample no|probe|proben?nr|probe nr|eprouvette|probeta|provino|numune"
"""Headers of a column that names the specimen of each row."""
OTHER_QUANTITIES = (
    r"\b(rate|energy|error|sd|std|width|thickness|modulus|module|maximum|max|peak|break|yield|at|bei|bruch\w*|rupture|speed|"
    r"velocity|vitesse|\w*geschwindigkeit|ultimate|strength|\w*arbeit|work|fmax|cycle|anzahl|count)\b"
)
"""What a header with one of these words holds is no reading of a curve."""
TRUE = r"\b(true|log|logarithmic|hencky|cauchy|wahre|vraie|verdadera)\b"

SIZES = {
    "thickness": ["thickness", "*dicke", "epaisseur", "espesor", "spessore"],
    "width": ["width", "*breite", "largeur", "ancho", "anchura", "larghezza"],
    "diameter": WORDS["diameter"],
    "cross_section": ["area", "cross section", "cross sectional area", "*querschnitt", "*querschnittsflache", "section"],
    "gauge_length": ["gauge length", "gage length", "tensile strain gauge length", "compressive strain gauge length",
                      "*messlange", "longueur de reference", "longitud calibrada"],
    "length": ["length", "grip separation", "*einspannlange", "*lange", "longueur", "longitud", "lunghezza"],
}  # fmt: skip
"""Sizes of the specimen above or beside a curve, by their names; a gauge length goes before a length."""

NONE, PER_RADIAN = "dimensionless", "s^-1"
"""Units of a column without one, and of an angular frequency."""
UNITS = {
    "%": "percent", "percent": "percent", "pct": "percent", "prozent": "percent", "-": NONE, "1": NONE, "mm/mm": NONE,
    "m/m": NONE, "in/in": NONE, "kp": "kgf", "lbs": "lbf", "kn": "kN", "mpa": "MPa", "kpa": "kPa", "gpa": "GPa", "pa": "Pa",
    "hpa": "hPa", "cmh2o": "cmH2O", "mmhg": "mmHg", "ml": "ml", "ccm": "ml",
    "hz": "Hz", "1/s": PER_RADIAN, "1/sec": PER_RADIAN, "°c": "degC", "c": "degC", "deg c": "degC",
    "sec": "s", "secs": "s", "sek": "s", "seconds": "s", "second": "s", "sekunden": "s", "inch": "in", "inches": "in",
}  # fmt: skip
"""Units in small letters and without a last point, and what they are in Pint's spelling."""
WEIGHTS = {"g": "gf", "kg": "kgf", "lb": "lbf", "oz": "ozf"}
"""Units of mass that a force or a stress is written in."""
OTHER_KINDS = {"strain": ("strain", "extension"), "extension": ("extension", "strain"), "force": ("force", "stress")}
"""Kinds of which the unit decides between the second and the first."""


def register_words(kind: str, *words: str) -> None:
    """Add words of headers to one of `KINDS`, or names of sizes to one of `SIZES`; they are tried before the known ones."""
    known = WORDS if kind in WORDS else SIZES
    known[kind][:0] = [_plain(word) for word in words]
    _pattern.cache_clear()


_COMPRESSION = re.compile(
    r"[ck]ompr[eéi]s|(?<![a-z])comp(?![a-z])|squeez|stauch|druc?k|schiacci|[eé]cras|apla[st]|сжат|压缩|圧縮|압축", re.IGNORECASE
)
_TENSION = re.compile(r"\btens(ile|ion)|\bzug|拉伸|\btra[ck]tion|\btracci[oó]n|\btrazione", re.IGNORECASE)
"""What says in a header that positive numbers are compression, or tension; in the languages of test machines."""
COMPRESSION_TEST = re.compile(r"(?<!de)[ck]ompres+[iã][oóv]|stauch|druckversuch|压缩|圧縮", re.IGNORECASE)
BENDING_TEST = re.compile(r"\bflex(ur\w*|ion\w*|ão)?\b|\bbend(ing)?\b|biege|弯曲|曲げ", re.IGNORECASE)
"""What says in a line above the columns, in a header or in a file's name that the test is one."""
_CLOCK = re.compile(r"(?:(\d{4}-\d\d-\d\d)[ T])?(?:(\d+):)?(\d+):(\d+(?:[.,]\d+)?)")
_TAIL = re.compile(
    r"[ _](%|percent|g?pa|kpa|mpa|hpa|psi|ksi|bar|mbar|cmh2o|mmhg|mn|kn|n|lbf|ml|cc|mm3|cm3|m3|mm|cm|m|um|"
    r"s|secs?|seconds?|ms|min|minutes?|hours?|h|hz|rad/s)$",
    re.IGNORECASE,
)
_SYMBOLS = (
    (re.compile(r"\btan\s*[(\[]?\s*(?:delta|δ)\s*[)\]]?", re.IGNORECASE), "tan delta "),
    (re.compile(r"\b([EG]\s?)(?:''|\"|\u2033|\u2019\u2019|\u2032\u2032)"), r"\1 loss modulus "),
    (re.compile(r"\b([EG]\s?)['\u2032\u2019]"), r"\1 storage modulus "),
)
"""Symbols of an oscillation, and the words that they stand for."""
_BRACKET = re.compile(r"[(\[<]([^)\]>]*)[)\]>]")


class TensileError(errors.OptionMessage, ValueError):
    """An unusable curve; the message is for the user."""


@dataclasses.dataclass(frozen=True)
class CurveColumn:
    """One column of a table: its kind, one of `KINDS`, its unit as written, ``""`` where none is, its place from 0, what
    stands above it, and the sign of its positive numbers by that: 1 for tension, -1 for compression, 0 if it says neither."""

    kind: str
    unit: str
    place: int
    header: str
    sign: int = 0

    @property
    def sentence(self) -> str:
        """What is read from where, such as "strain from column 4 'Tensile strain (Extension)' in mm/mm"."""
        pure = "mm/mm" if self.kind in DEFORMATIONS else ""
        unit = {"percent": "%", NONE: pure, "": "" if KINDS[self.kind] else pure, PER_RADIAN: "rad/s"}.get(self.unit, self.unit)
        return f"{self.kind} from column {self.place + 1} {self.header!r}{unit and f' in {unit}'}"


@dataclasses.dataclass(frozen=True)
class CurveTable:
    """A specimen's two columns with their raw numbers x and y, shape (n,), and the line of each row; times in s since the
    first row, shape (n,), or None and a clause why they cannot be used; what reads the same rows with other loads; the
    specimen's name where there are several, and its sizes in SI units by the names of `SIZES`; what above its columns says
    that the test is a compression or bends, or empty."""

    deformation: CurveColumn
    load: CurveColumn
    x: Array
    y: Array
    lines: tuple[int, ...]
    time: Array | None = None
    untimed: str = "it has no column of times, such as 'time (s)'"
    others: Sequence[Callable[[], CurveTable]] = ()
    label: str = ""
    sizes: Mapping[str, float] = dataclasses.field(default_factory=dict)
    title: str = ""


def recognise(header: str, place: int, layout: Layout = CURVE) -> CurveColumn | None:
    """Return the kind of a header, one of a layout's; None if it is none of them.

    A unit stands in brackets, behind a comma or at the end; a bracket that is no unit belongs to the name.
    """
    text = header.strip()
    if layout is OSCILLATION:
        for symbol, name in _SYMBOLS:
            text = symbol.sub(name, text)
    text = text.strip('"').strip()
    brackets = [part.strip() for part in _BRACKET.findall(text)]
    words, unit = _BRACKET.sub(" ", text), ""
    if brackets:
        unit = next((part for part in reversed(brackets) if _is_any_unit(part)), "")
        if not unit and not _is_part_of_a_name(brackets[-1]):
            unit = brackets[-1]
    elif tail := _TAIL.search(words):
        unit, words = tail[1], words[: tail.start()]
    elif "," in words or "/" in words:
        words, unit = re.split(r"[,/]", words, maxsplit=1)
    kind = _kind_of(_plain(words), layout)
    if kind is None or (layout in (CURVE, INFLATION) and re.search(OTHER_QUANTITIES, _plain(text))):
        return None
    if kind in ("strain", "stress") and re.search(TRUE, _plain(text)):
        kind = f"true-{kind}"
    column = _settled(CurveColumn(kind, _unit(unit, kind), place, header.strip(), _sign(kind, header)))
    return None if kind == "time" and unit and _unit_factor(column.unit, kind) is None else column


def _kind_of(words: str, layout: Layout = CURVE) -> str | None:
    if words == "t" and "time" in layout.kinds:
        return "time"
    if layout in (INFLATION, LOG) and LETTERS.get(words) in layout.kinds:
        return LETTERS[words]
    share = "strain" if layout is CURVE and re.match(r"[ck]ompression\b", words) else None  # where no other word follows
    return next((kind for kind in WORDS if kind in layout.kinds and _pattern(kind).search(words)), share)


@functools.cache
def _pattern(kind: str) -> re.Pattern[str]:
    known = WORDS[kind] if kind in WORDS else SIZES[kind]
    # A word of time at an end only: an "Early time load" is a load.
    words = "|".join(re.escape(word).replace(r"\*", r"\w*") for word in known)
    return re.compile(rf"^(?:{words})\b|\b(?:{words})$" if kind == "time" else rf"\b(?:{words})(?!\w)")


def _plain(text: str) -> str:
    """Return a text in small letters without accents, its words parted by single spaces."""
    bare = "".join(c for c in unicodedata.normalize("NFKD", text.casefold()) if not unicodedata.combining(c))
    return re.sub(r"[_\s\-:.]+", " ", bare).strip()


def _is_part_of_a_name(text: str) -> bool:
    """Return whether a bracket qualifies a name: ``(Extension)``, ``(Strain 1)``, ``(true)``, ``(nominal)``."""
    words = re.sub(r"\b\d+\b", "", _plain(text)).strip()
    qualified = rf"{TRUE}|\b(eng|engineering|nominal|corrected|technisch\w*|ingenieur\w*|video|axial|machine)\b"
    return not words or _kind_of(words) is not None or bool(re.search(qualified, words))


def _is_any_unit(text: str) -> bool:
    return any(text and _unit_factor(_unit(text, kind), kind) is not None for kind in ("strain", "extension", "force", "stress",
               "time", "angular-frequency", "acceleration", "volume"))  # fmt: skip


def _settled(column: CurveColumn) -> CurveColumn:
    """Return a column with the kind that its unit decides: an elongation in mm is a length, a load in MPa a stress."""
    if column.kind == "frequency" and column.unit == PER_RADIAN:
        return dataclasses.replace(column, kind="angular-frequency")
    for kind in OTHER_KINDS.get(column.kind, ()) if column.unit else ():
        if _unit_factor(_unit(column.unit, kind), kind) is not None:
            return dataclasses.replace(column, kind=kind, unit=_unit(column.unit, kind))
    return column


def _sign(kind: str, header: str) -> int:
    """Return the sign of a column's positive numbers, see `CurveColumn`, from what stands above it."""
    if kind in ("time", "acceleration", *INFLATION.kinds, *OSCILLATION.kinds):
        return 0
    return int(bool(_TENSION.search(header))) - int(bool(_COMPRESSION.search(header)))


def _unit(text: str, kind: str) -> str:
    """Return a unit in Pint's spelling: ``lbF`` as lbf, ``kgf/mm2`` as kgf/mm^2, and for a load ``g`` as gf."""
    bare = text.strip().rstrip(".").replace("²", "^2").replace("³", "^3")
    known = "g_0" if kind == "acceleration" and bare.lower() == "g" else UNITS.get(bare.lower())
    if known or not bare:
        return known or ""
    if re.fullmatch(r"rad(ian)?s?\s*(/\s*s(ec)?|[ ·*]?s\^?-1)", bare):
        return PER_RADIAN
    power = re.sub(r"(?<=[a-zA-Z])([23])\b", r"^\1", bare)
    parts = []
    for part in power.split("/"):
        name, sign, exponent = part.partition("^")
        small = name.lower()
        if kind in ("force", "stress", "true-stress", "pressure") and not sign:
            small = WEIGHTS.get(small, small)
        fixed = UNITS.get(small, small if small in ("lbf", "kgf", "gf", "ozf", "psi", "ksi", "mm", "cm", "in", "min") else name)
        parts.append((fixed.upper() if fixed == "n" else fixed) + sign + exponent)
    return "/".join(parts)


def columns_of_text(text: str, layout: Layout = CURVE) -> dict[str, tuple[str, str | None]]:
    """Read ``"strain=Engineering Strain[%],stress=5[MPa]"``: by kind, a header or a number from 1, and a unit or None. What is
    not named is left to the headers."""
    told: dict[str, tuple[str, str | None]] = {}
    for part in re.findall(r"[^,\[]+(?:\[[^\]]*\])?", text):
        kind, column_name, rest = part.strip().partition("=")
        if not column_name or kind not in layout.kinds:
            raise TensileError(f"columns {text!r}: {part.strip()!r} is not KIND=COLUMN[UNIT] with {', '.join(layout.kinds)}")
        name, _, unit = rest.partition("[")
        told[kind] = (name.strip(), unit.rstrip("]").strip() if "[" in rest else None)
    along, read = ([kind for kind in told if kind in kinds] for kinds in (layout.along, layout.read))
    if not told or len(along) > 1 or (layout is CURVE and len(read) > 1):
        raise TensileError(
            f"columns {text!r} must name no more than one {layout.words[0]} ({', '.join(layout.along)}) and one "
            f"{layout.words[1]} ({', '.join(layout.read)})" + (", and perhaps time" if layout.further else "")
        )
    return told


def _complete(told: Mapping[str, tuple[str, str | None]], layout: Layout) -> bool:
    """Return whether given columns need no header."""
    return all(any(kind in told for kind in kinds) for kinds in (layout.along, layout.read))


# ----------------------------------------------------------------------------------------------------------------------
# Headers in a file, and the specimens below them: below each other, side by side, named in a column, or a sheet each.


LEAST_POINTS = 4
"""Least number of points of a curve; a shorter table beside longer ones holds results."""


@dataclasses.dataclass(frozen=True)
class _Block:
    """A header with the rows below it up to the next one: their places in the sheet, the recognised columns, whether these were
    given, and of `CurveTable` what stands above."""

    start: int
    end: int
    known: tuple[CurveColumn, ...]
    told: bool
    sizes: Mapping[str, float]
    title: str
    names: Sequence[str] = ()


def read_tables(path: Path, told: Mapping[str, tuple[str, str | None]], layout: Layout = CURVE) -> list[CurveTable]:
    """Find the headers, also below other lines, and the numbers of each specimen's columns, and its times, in a text or a
    workbook (see `softmodels.common.tables.read_sheets`); a row of units may stand below a header. ``told`` is of
    `columns_of_text`, empty to go by the headers.

    Raises `TensileError` for a file that cannot be read, no header or several that say what the columns are, or no numbers
    below it.
    """
    try:
        sheets = tables.read_sheets(path)
        chosen = tables.find(path, sheets, lambda sheet: _blocks(sheet, told, layout))
        if not chosen:
            raise _no_header(sheets, told, layout)
        longest = max(_count(sheet, block) for sheet, blocks in chosen for block in blocks)
        curves = [
            (sheet, block) for sheet, blocks in chosen for block in blocks if _count(sheet, block) >= min(LEAST_POINTS, longest)
        ]
        if len({_form(block) for _, block in curves}) > 1 and len({sheet.name for sheet, _ in curves}) > 1:
            tables.only(path, [sheet for sheet, _ in chosen])
    except (OSError, files.UserFileError) as error:
        raise TensileError(f"the file cannot be read ({errors.reason(error)})") from None
    sure = {kind for kind, (_, unit) in told.items() if unit is not None}
    several_sheets = len({sheet.name for sheet, _ in curves}) > 1
    made = [
        dataclasses.replace(table, label=" ".join([*([sheet.name] if several_sheets else []), *filter(None, [table.label])]))
        for sheet, block in curves
        for table in _specimens(sheet, block, sure, layout)
    ]
    labels = [table.label for table in made]
    if len(made) > 1 and len(set(labels)) < len(made):
        made = [dataclasses.replace(table, label=f"specimen {i}") for i, table in enumerate(made, 1)]
    return made if len(made) > 1 else [dataclasses.replace(made[0], label="")]


def _no_header(sheets: Sequence[tables.Worksheet], told: Mapping[str, tuple[str, str | None]], layout: Layout) -> TensileError:
    if not any(sheet.rows for sheet in sheets):
        return TensileError("the file is empty")
    where = f"no row of {tables.named(sheets)}" if tables.named(sheets) else "no line"
    if _complete(told, layout):
        names = " and ".join(repr(name) for name, _ in told.values())
        return TensileError(f"{where} of the file has the columns {names}")
    if layout is CURVE and any(_blocks(sheet, {}, OSCILLATION) for sheet in sheets):
        return TensileError(
            "it has moduli or tan delta over frequency; add :oscillation (E' of tension) or :shear-oscillation (G') to its name"
        )
    along, read = layout.words
    return TensileError(
        f"{where} names a {along} and a {read}, such as {layout.headers}{_above_numbers(sheets)}; choose the columns with "
        f"--columns '{layout.columns}'"
    )


def _above_numbers(sheets: Sequence[tables.Worksheet]) -> str:
    """Return a clause with the cells above the first numbers; empty where there are none."""
    for sheet in sheets:
        with contextlib.suppress(csv.Error):
            for (_, words), (_, row) in itertools.pairwise(sheet.rows):
                if sum(map(_is_number, row)) > 1 and not any(map(_is_number, words)):
                    cells = [f"{i} {cell.strip()!r}" for i, cell in enumerate(words, 1) if cell.strip()]
                    more = f" and {len(cells) - 8} more" if len(cells) > 8 else ""
                    return f"; above its numbers are the columns {', '.join(cells[:8])}{more}" if cells else ""
    return ""


def _form(block: _Block) -> tuple[str, ...]:
    return tuple(column.header for column in block.known)


def _count(sheet: tables.Worksheet, block: _Block) -> int:
    """Return the number of rows with numbers in at least two of the block's columns."""
    return sum(_is_numeric(row, block.known) for _, row in sheet.rows[block.start : block.end])


def _blocks(sheet: tables.Worksheet, told: Mapping[str, tuple[str, str | None]], layout: Layout = CURVE) -> list[_Block] | None:
    rows = sheet.rows
    if _complete(told, layout):
        heads = _told_headers(rows, told, layout)
    else:
        heads = []
        for i, (_, row) in enumerate(rows):
            if len(row) < 2 or any(_is_number(cell) for cell in row):
                continue  # fast check for most lines of a long file
            known = [column for place, cell in enumerate(row) if (column := recognise(cell, place, layout))]
            known = _with_told(known, row, told, layout)
            if _first(known, layout.along) and _first(known, layout.read) not in (None, "temperature"):
                heads.append((i + 1, tuple(known)))
    if not heads:
        return None
    blocks: list[_Block] = []
    above, ends = 0, [start - 1 for start, _ in heads[1:]]
    for (start, columns), end in zip(heads, [*ends, len(rows)], strict=True):
        last = end
        while end in ends and last > start and not _is_numeric(rows[last - 1][1], columns):
            last -= 1  # text above the next header
        lines = [row for _, row in rows[above : start - 1]]
        sizes = sizes_of(lines) or (blocks[-1].sizes if blocks else {})
        kinds = (COMPRESSION_TEST, BENDING_TEST)
        said = next((cell.strip() for row in lines for cell in row if any(kind.search(cell) for kind in kinds)), "")
        said = said or (blocks[-1].title if blocks else "")
        names = rows[start - 2][1] if start > 1 else ()
        blocks.append(_Block(start, last, columns, bool(told), sizes, said, names))
        above = last
    return blocks


def _with_told(
    known: list[CurveColumn], row: Sequence[str], told: Mapping[str, tuple[str, str | None]], layout: Layout
) -> list[CurveColumn]:
    """Return the columns of a header with those that a user named in the place of others of their kinds; none without them."""
    cells = [cell.strip().strip('"') for cell in row]
    places = {kind: _place_of(name, cells) for kind, (name, _) in told.items()}
    if not all(0 <= place < len(row) for place in places.values()):
        return []
    groups = [group for group in (layout.along, layout.read) if any(kind in told for kind in group)]
    settled = {kind for group in groups for kind in group} | {*told}
    own = [
        _told_column(kind, told[kind][1], place, row[place], _sign(kind, row[place]), layout) for kind, place in places.items()
    ]
    return own + [column for column in known if column.kind not in settled and column.place not in places.values()]


def _is_numeric(row: Sequence[str], known: Sequence[CurveColumn]) -> bool:
    return sum(_is_number(_cell(row, column)) for column in known) > 1


def sizes_of(rows: Sequence[Sequence[str]]) -> dict[str, float]:
    """Return the sizes of a specimen in m or m2 by the names of `SIZES` from rows such as ``Width,4.0,mm``, ``Dicke [mm];2``
    and ``Length: 25 mm``, or from a row of names above (units and) values."""
    sizes: dict[str, float] = {}
    for i, row in enumerate(rows):
        for place, cell in enumerate(row):
            # "Dimension : Width" is a heading with a name, "Width: 4 mm" a name with a value.
            text = cell.strip().strip('"').rpartition(" : ")[2]
            label, _, rest = text.partition("=" if "=" in text else ":")
            bracket = _BRACKET.findall(label)
            # A symbol behind the name (a0, b0, L0) is no part of it.
            bare = re.sub(r"\b(?:specimen|sample|initiale?)\b|\b[a-z][0-9o]?$", "", _plain(_BRACKET.sub(" ", label)))
            name = next((name for name in SIZES if _pattern(name).fullmatch(bare.strip())), None)
            if name is None or name in sizes:
                continue
            after = [part.strip() for part in row[place + 1 : place + 3]]
            below = [lower[place].strip() for lower in rows[i + 1 : i + 3] if place < len(lower)]
            for texts in ([rest.strip()], [" ".join(after)], after[:1], [below[0]] if below else [], below[1:2]):
                unit = (bracket[-1:] or [""])[0] or (re.sub(r"[()\[\]]", "", below[0]) if texts == below[1:2] else "")
                value = _size(" ".join(texts), unit, "m^2" if name == "cross_section" else "m")
                if value is not None:
                    sizes[name] = value
                    break
    return sizes


def _size(text: str, unit: str, wanted: str) -> float | None:
    value, own = re.match(r"^([-+\d.,eE]*)\s*[(\[]?([^)\]]*)", text.replace("²", "^2"), re.DOTALL).groups()  # type: ignore[union-attr]
    if not _is_number(value) or not (unit := _unit(own.strip() or unit, "extension")):
        return None
    try:
        size = float(value.replace(",", ".")) * quantity(f"1 {unit}", wanted)
    except (ValueError, UnitError):
        return None
    return size if size > 0.0 else None


def _first(known: Sequence[CurveColumn], kinds: Sequence[str]) -> str | None:
    present = {column.kind for column in known}
    return next((kind for kind in kinds if kind in present), None)


def _told_headers(
    rows: Sequence[tables.Line], told: Mapping[str, tuple[str, str | None]], layout: Layout
) -> list[tuple[int, tuple[CurveColumn, ...]]]:
    """Find the headers of given columns: by name lines with these, by number the first line of numbers."""
    numbers = all(name.isdigit() for name, _ in told.values())
    heads = []
    for i, (_, row) in enumerate(rows):
        made = {}
        cells = [cell.strip().strip('"') for cell in row]
        for kind, (name, unit) in told.items():
            place = _place_of(name, cells)
            if not 0 <= place < len(row):
                break
            told_over = [line[place] for _, line in rows[:i] if place < len(line)] if name.isdigit() else [row[place]]
            made[kind] = _told_column(kind, unit, place, row[place], _sign(kind, " ".join(told_over)), layout)
        else:
            if numbers and not all(_is_number(row[column.place]) for kind, column in made.items() if kind != "time"):
                continue
            columns = tuple(made[kind] for kind in layout.kinds if kind in made)
            if not numbers:
                heads.append((i + 1, columns))
                continue
            above = [_cell(rows[i - 1][1], column) if i else "" for column in columns]
            start = i - 1 if _row_of_units(columns, above) else i
            names = rows[start - 1][1] if start else []
            headed = [
                _told_column(column.kind, told[column.kind][1], column.place, header, column.sign, layout)
                if (header := _cell(names, column)) and not _is_number(header)
                else column
                for column in columns
            ]
            return [(start, tuple(headed))]
    return heads


def _place_of(name: str, cells: Sequence[str]) -> int:
    """Return the place of a column that a user named by its number from 1 or its header, with its unit or without; -1 if the
    cells of a row do not have it."""
    if name.isdigit():
        return int(name) - 1
    bare = cells if name in cells else [re.sub(r"\s*[(\[].*", "", cell) for cell in cells]
    return bare.index(name) if name in bare else -1


def _told_column(kind: str, unit: str | None, place: int, header: str, sign: int, layout: Layout) -> CurveColumn:
    """Return a column that a user named, with the given unit or that of its header."""
    if unit is None:
        said = recognise(header, place, layout)
        unit = said.unit if said else next(filter(_is_any_unit, map(str.strip, _BRACKET.findall(header))), "")
    return CurveColumn(kind, _unit(unit, kind), place, header.strip(), sign)


def _specimens(sheet: tables.Worksheet, block: _Block, sure: Collection[str], layout: Layout) -> list[CurveTable]:
    """Return the curves of a block: one for each repetition of its columns, and for each name in a column of specimens."""
    known, start = _with_units(sheet, block, sure)
    groups = [known] if block.told else _repeated(known, layout)
    made = []
    for group in groups:
        columns, further = _chosen(group, layout)
        lines = list(sheet.rows[start : block.end])
        if len(groups) > 1:  # a specimen that ended earlier leaves its cells empty
            lines = [(number, row) for number, row in lines if any(_cell(row, column) for column in columns)]
        label = ""
        if len(groups) > 1:
            places = range(min(c.place for c in group), max(c.place for c in group) + 1)
            label = next((block.names[p].strip() for p in places if p < len(block.names) and block.names[p].strip()), "")
        for name, rows in _named_rows(sheet, block, lines):
            table = _numbers(sheet, rows, columns)
            more = [functools.partial(_numbers, sheet, rows, (columns[0], other)) for other in further]
            table = dataclasses.replace(table, label=name or label, sizes=block.sizes, title=block.title)
            made.append(dataclasses.replace(table, others=more))
    return made


def _named_rows(sheet: tables.Worksheet, block: _Block, lines: list[tables.Line]) -> Iterator[tuple[str, list[tables.Line]]]:
    """Yield the rows of each specimen that a column names, or all of them."""
    head = sheet.rows[block.start - 1][1] if block.start else []
    place = next((i for i, cell in enumerate(head) if re.fullmatch(SPECIMENS, _plain(cell))), None)
    if place is not None and not block.told:
        by_name: dict[str, list[tables.Line]] = {}
        for number, row in lines:
            by_name.setdefault(row[place].strip() if place < len(row) else "", []).append((number, row))
        if len(by_name) > 1 and all(len(rows) >= LEAST_POINTS for rows in by_name.values()):
            yield from by_name.items()
            return
    yield "", lines


def _repeated(known: Sequence[CurveColumn], layout: Layout) -> list[list[CurveColumn]]:
    """Return the columns of each specimen where headers repeat, alike or with another number; what stands once is all's."""
    stems = [re.sub(r"[\s_.]*\d+(?=\s*(?:[(\[]|$))", "", column.header).casefold() for column in known]
    times = {stem: stems.count(stem) for stem in stems}
    count = max(times[stem] for stem, column in zip(stems, known, strict=True) if column.kind in layout.read)
    alike = {column.kind in layout.read for stem, column in zip(stems, known, strict=True) if times[stem] == count}
    if count < 2 or True not in alike or any(n not in (1, count) for n in times.values()):
        return [list(known)]
    seen: dict[str, int] = {}
    groups: list[list[CurveColumn]] = [[] for _ in range(count)]
    for stem, column in zip(stems, known, strict=True):
        places = range(count) if times[stem] == 1 else [seen.get(stem, 0)]
        seen[stem] = seen.get(stem, 0) + 1
        for place in places:
            groups[place].append(column)
    return groups


def _chosen(known: Sequence[CurveColumn], layout: Layout) -> tuple[tuple[CurveColumn, ...], list[CurveColumn]]:
    """Return deformation, load and perhaps time, and further loads; `TensileError` where two columns mean the same."""
    chosen = []
    for group in (layout.along, layout.read):
        alike = [column for column in known if column.kind == _first(known, group)]
        own = [column for column in alike if not re.search(rf"\b({MACHINE})\b|[(\[]extension", _plain_name(column.header))]
        alike = own if len(own) == 1 else alike
        suited = [column for column in alike if column.unit and _unit_factor(column.unit, column.kind) is not None]
        alike = suited if len(suited) == 1 else alike
        if len(alike) > 1:
            names = " and ".join(repr(column.header) for column in alike)
            raise TensileError(f"the columns {names} mean the same; choose with --columns")
        chosen.append(alike[0])
    times = [column for column in known if column.kind == "time"]
    times.sort(key=lambda column: "total" not in column.header.lower())  # beside the time of each cycle
    return (*chosen, *times[:1]), [column for column in known if column.kind in layout.read and column.kind != chosen[1].kind]


def _plain_name(header: str) -> str:
    return _plain(header).replace("( ", "(")


# ----------------------------------------------------------------------------------------------------------------------
# Units below a header, and the numbers.


def _with_units(sheet: tables.Worksheet, block: _Block, sure: Collection[str]) -> tuple[list[CurveColumn], int]:
    """Return the columns with the units of a row below the header, and the place of the first row of numbers."""
    columns, start, below = list(block.known), block.start, False
    for place in range(block.start, block.end):
        number, row = sheet.rows[place]
        cells = [_cell(row, column) for column in columns]
        if any(_is_number(cell) or cell.startswith("=") for cell in cells):
            break
        start = place + 1
        if not below and (units := _row_of_units(columns, cells)):
            columns, below = _beside(columns, units, sure, sheet.place(number)), True
    return columns, start


def _numbers(sheet: tables.Worksheet, rows: Sequence[tables.Line], columns: tuple[CurveColumn, ...]) -> CurveTable:
    """Return the numbers of rows."""
    x: list[float] = []
    y: list[float] = []
    lines: list[int] = []
    times: list[str] = []
    marks = [numerals([_cell(row, column) for _, row in rows]) for column in columns]
    if "," in marks:
        marks = [","] * len(marks)
    for number, row in rows:
        cells = [_cell(row, column) for column in columns]
        values: list[float] = []
        for cell, column, mark in zip(cells[:2], columns[:2], marks, strict=False):
            value = (
                _seconds(cell, column, mark)
                if column.kind == "time"
                else _value(cell, column, mark)
                if _is_number(cell)
                else None
            )
            if value is None:
                why = FORMULA if cell.startswith("=") else "is not a number"
                raise TensileError(f"{sheet.place(number)}: {cell!r} in the column {column.header!r} {why}")
            values.append(value)
        if not all(map(math.isfinite, values)):
            raise TensileError(f"{sheet.place(number)} has a value that is not finite ({', '.join(cells[:2])})")
        x.append(values[0])
        y.append(values[1])
        lines.append(number)
        times.extend(cells[2:])
    if not x:
        raise TensileError(
            f"there are no numbers below the header ({columns[0].header!r}, {columns[1].header!r}); write plain numbers in the "
            "rows, and the unit in the header"
        )
    made = CurveTable(columns[0], columns[1], np.array(x), np.array(y), tuple(lines))
    return dataclasses.replace(made, **_times(times, columns[2], marks[2], sheet, lines)) if times else made  # type: ignore[arg-type]


def _times(
    cells: Sequence[str], column: CurveColumn, mark: str, sheet: tables.Worksheet, lines: Sequence[int]
) -> dict[str, object]:
    """Return the times of `CurveTable`, or why they cannot be used: curves without a memory do not need them."""
    values: list[float] = []
    for cell, number in zip(cells, lines, strict=True):
        value = _seconds(cell, column, mark)
        if value is None:
            return {"untimed": f"{sheet.place(number)}: {cell!r} in the column {column.header!r} is no time"}
        if values and value < values[-1]:
            return {"untimed": f"{sheet.place(number)}: the time falls to {cell} in the column {column.header!r}"}
        values.append(value)
    since = np.array(values) - values[0]
    if not column.unit or any(map(_CLOCK.fullmatch, cells)):
        return {"time": since}
    try:
        return {"time": in_si(since, column)}
    except TensileError as error:
        return {"untimed": str(error)}


def _seconds(cell: str, column: CurveColumn, mark: str) -> float | None:
    """Return a number of the column's unit, or a clock's time in s, perhaps with its date; None if it is neither."""
    if clock := _CLOCK.fullmatch(cell):
        day, hours, minutes, seconds = clock.groups()
        try:
            days = datetime.date.fromisoformat(day).toordinal() if day else 0
        except ValueError:
            return None
        return 3600.0 * (24 * days + int(hours or 0)) + 60 * int(minutes) + float(seconds.replace(",", "."))
    if not _is_number(cell) or cell.endswith("%"):
        return None
    value = _value(cell, column, mark)
    return value if math.isfinite(value) else None


def _cell(row: Sequence[str], column: CurveColumn) -> str:
    return row[column.place].strip() if column.place < len(row) else ""


def _row_of_units(columns: Sequence[CurveColumn], cells: Sequence[str]) -> tuple[str, ...] | None:
    """Return the columns' units if a row holds units: in brackets, or one of them suiting its column."""
    bare = [re.sub(r"^[\[(](.*)[\])]$", r"\1", cell) for cell in cells]
    if not any(unit != cell or _is_unit(unit, column) for unit, cell, column in zip(bare, cells, columns, strict=True)):
        return None
    return tuple(
        "" if _unit(unit, c.kind) == NONE and KINDS[c.kind] else _unit(unit, c.kind)
        for unit, c in zip(bare, columns, strict=True)
    )


def _is_unit(text: str, column: CurveColumn) -> bool:
    kinds = OTHER_KINDS.get(column.kind, (column.kind,))
    return bool(text) and not _is_number(text) and text != "-" and any(
        _unit_factor(_unit(text, kind), kind) is not None for kind in kinds
    )  # fmt: skip


@functools.cache
def _unit_factor(unit: str, kind: str) -> float | None:
    """Return the conversion factor of a unit for a kind of column; None if unknown or of another kind."""
    try:
        return quantity(f"1 {unit}", KINDS[kind])
    except UnitError:
        return None


def _beside(columns: Sequence[CurveColumn], units: Sequence[str], sure: Collection[str], where: str) -> list[CurveColumn]:
    """Return the columns with the units below their headers, except the kinds in ``sure``; `TensileError` if a header has
    another unit."""
    made = []
    for column, unit in zip(columns, units, strict=True):
        if column.kind in sure or not unit:
            made.append(column)
            continue
        above, below = _unit_factor(column.unit, column.kind), _unit_factor(unit, column.kind)
        same = above is not None and below is not None and math.isclose(above, below, rel_tol=1e-6)
        if column.unit and unit != column.unit and not same:
            raise TensileError(
                f"the unit of the column {column.header!r} is {column.unit} in its header and {unit} in {where}; correct "
                f"one of them, or give --columns '{column.kind}={column.place + 1}[{column.unit}]'"
            )
        made.append(_settled(dataclasses.replace(column, unit=column.unit or unit)))
    return made


_GROUPED = re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?(e[-+]?\d+)?", re.IGNORECASE)
"""A number with commas between its thousands; or, with a single one, three decimals."""
_LONG = re.compile(r"[-+]?(\d{1,3}([.,'\u2019\s]\d{3})+|\d+)([.,]\d*)?(e[-+]?\d+)?", re.IGNORECASE)


def numerals(cells: Sequence[str]) -> str:
    """Return the decimal sign of a column's cells, a comma or a point; the other one parts thousands.

    A single comma before three digits may be either. It parts thousands if every comma of the column may, and if another
    cell has a point or a whole number of three digits without one.
    """
    marked = [cell for cell in cells if "," in cell or cell.count(".") > 1]
    for cell in marked:
        if "." in cell and "," in cell:
            return max(".,", key=cell.rfind)
    if any(cell.count(".") > 1 for cell in marked):
        return ","
    if not marked or not all(map(_GROUPED.fullmatch, marked)):
        return "," if marked else "."
    plain = [cell for cell in cells if "," not in cell]
    grouped = any(cell.count(",") > 1 for cell in marked) or any(
        "." in cell or re.fullmatch(r"[-+]?\d{3}", cell) for cell in plain
    )
    return "." if grouped else ","


def _value(cell: str, column: CurveColumn, mark: str) -> float:
    """Return a cell's number in the unit of its column, its decimals behind a sign (see `numerals`); percents may have their
    sign."""
    text = re.sub(r"(?<=\d)['\u2019\s](?=\d)", "", cell)
    if mark == ".":
        text = text.replace(",", "")
    else:
        text = text.replace(".", "").replace(",", ".") if "," in text or text.count(".") > 1 else text
    number = float(text.removesuffix("%"))
    if not text.endswith("%") or column.unit == "percent":
        return number
    if KINDS[column.kind] or column.unit not in ("", NONE):
        raise TensileError(f"{cell!r} in the column {column.header!r} is a percentage; give it in {KINDS[column.kind]}")
    return number / 100


def _is_number(text: str) -> bool:
    bare = text.strip().removesuffix("%").strip()
    try:
        float(bare)
    except ValueError:
        return bool(_LONG.fullmatch(bare) or re.fullmatch(r"[-+]?,\d+", bare))
    return True


def in_si(values: Array, column: CurveColumn) -> Array:
    """Return a column's numbers in the unit of its kind; `TensileError` for a unit that is missing or of another kind."""
    wanted = KINDS[column.kind]
    if not column.unit and not wanted:
        return values
    if not column.unit:
        example = {"Pa": "kPa", "m": "mm", "m^3": "ml", "1/s": "rad/s"}.get(wanted, wanted)
        raise TensileError(
            f"the column {column.header!r} has no unit; write it into the header, such as '{column.kind} ({example})', or give "
            f"it with --columns '{column.kind}={column.place + 1}[{example}]'"
        )
    try:
        return values * quantity(f"1 {column.unit}", wanted)
    except UnitError as error:
        raise TensileError(f"the column {column.header!r}: {error}") from None
