"""Reports: pages of one style, each a single file that needs no network.

A page has the answer first, then warnings, sections, and where its numbers come from. What is put into it is escaped, but for
what is marked as HTML. It fits a phone's width, a dark screen and paper; pressures change their unit on the page, which a
small program in it does. Without that program all stands there in the unit it was written in.
"""

from __future__ import annotations

import base64
import dataclasses
import json
import re
from collections.abc import Mapping, Sequence
from typing import ClassVar

from softmodels.common import commands, files, units

type Section = tuple[str, Sequence[Part | None]]
"""A heading and what stands below it; None and parts without content are left out, and so is a section of only those."""


@dataclasses.dataclass(frozen=True)
class Page:
    """A report.

    Attributes:
        answer, facts: The answer in a sentence or two, and its figures.
        warnings: What a reader must know before using them.
        sources: Publications of the laws and data used.
        downloads: Tables to download from the page: text by the name of the file.
        column: Whose heights its pressures are in.
        unit: Unit of pressure that its texts and tables are written in: ``"cm"`` or one of `UNITS`.
    """

    title: str
    answer: str
    sections: Sequence[Section]
    provenance: commands.Provenance
    facts: Sequence[Fact] = ()
    warnings: Sequence[str] = ()
    sources: Sequence[str] = ()
    downloads: Mapping[str, str] = dataclasses.field(default_factory=dict)
    column: units.Column = units.COLUMN
    unit: str = "cm"

    def html(self) -> str:
        """Return the page."""
        sections = [(heading, [part for part in parts if _shows_anything(part)]) for heading, parts in self.sections]
        links = [
            (name, f"data:text/csv;base64,{base64.b64encode(text.encode()).decode('ascii')}")
            for name, text in self.downloads.items()
        ]
        factors = json.dumps({HEIGHT: self.column.pascal, **{unit: pascal(unit) for unit in UNITS}})
        return files.render(
            "page.html", "softmodels.common", page=self, links=links, factors=factors,
            column=self.column.unit,
            sections=[(heading, parts) for heading, parts in sections if parts],
        )  # fmt: skip


def pascal(unit: str) -> float:
    """Return how many Pa one of a unit of pressure has."""
    return units.FACTORS["Pa"].get(unit) or units.quantity(f"1 {unit}", "Pa")


def _shows_anything(part: Part | None) -> bool:
    """Return whether a part shows anything."""
    return part is not None and any(getattr(part, field.name) for field in dataclasses.fields(part)[:1])


INKS = {
    "#000000": "currentColor",
    "#102a43": "currentColor",
    "#ffffff": "var(--paper, #ffffff)",
    "#2f6f9f": "var(--accent, #2f6f9f)",
}
"""Colours of drawings, and those of a page, which change on a dark screen."""


def inline_svg(text: str) -> str:
    """Return a drawing of matplotlib, marked as HTML, for a page, in whose colours it is.

    Groups whose identifier is ``pu-`` and a unit of pressure are shown while the page has that unit.
    """
    from markupsafe import Markup

    text = text[text.index("<svg") :]
    for colour, own in INKS.items():
        text = text.replace(colour, own)
    return Markup(re.sub(r'id="(pu-\w+)"', r'class="pu \1"', text))


UNITS = {"kPa": "kPa", "mbar": "mbar", "psi": "psi"}
"""Units of pressure beside the heights of a column, by their names in `softmodels.common.units`."""
HEIGHT = "cm"
"""Unit of the heights of a column."""


# ----------------------------------------------------------------------------------------------------------------------
# What a page consists of. Each part is written by the macro of ``parts.html`` that its ``kind`` names.


@dataclasses.dataclass(frozen=True)
class Fact:
    """A figure of the answer with its unit, what to hold it against, and whether it is a warning."""

    label: str
    value: str
    note: str = ""
    alarm: bool = False


@dataclasses.dataclass(frozen=True)
class Cell:
    """A cell of a table.

    Attributes:
        title: The exact value.
        pascal: The pressure in Pa that is shown in the unit which its table's row or column names; None for all else.
        unit: The unit of pressure that its text, a heading, has in brackets; empty for none.
    """

    text: str
    title: str = ""
    pascal: float | None = None
    unit: str = ""


@dataclasses.dataclass(frozen=True)
class Table:
    """A table, which scrolls by itself where the screen is narrower.

    Attributes:
        rows, head: Cells, or their texts, the first one of a row naming it; names of the columns, empty for none.
        numbers: Whether the cells are numbers, which stand at the right.
        marks: What the rows are: ``"refused"``, ``"weak"`` or ``""``; empty if none is anything.
    """

    kind: ClassVar[str] = "table"
    rows: Sequence[Sequence[str | Cell]]
    head: Sequence[str | Cell] = ()
    numbers: bool = True
    marks: Sequence[str] = ()
    caption: str = ""


@dataclasses.dataclass(frozen=True)
class Text:
    """A paragraph; ``alarm`` is whether it is a warning."""

    kind: ClassVar[str] = "text"
    text: str
    alarm: bool = False


@dataclasses.dataclass(frozen=True)
class Bullets:
    """A list of sentences; ``alarm`` is whether they are warnings, ``ordered`` whether they are steps."""

    kind: ClassVar[str] = "bullets"
    texts: Sequence[str]
    alarm: bool = False
    ordered: bool = False


@dataclasses.dataclass(frozen=True)
class Picture:
    """A picture: its source as `softmodels.common.files.data_uri` makes it, its caption, and for a film its last frame, which
    is printed."""

    kind: ClassVar[str] = "picture"
    source: str
    caption: str
    still: str = ""


@dataclasses.dataclass(frozen=True)
class Charts:
    """Captioned drawings beside each other, or below on a narrow screen: name of the file to download, and SVG marked as
    HTML."""

    kind: ClassVar[str] = "charts"
    drawings: Sequence[tuple[str, str]]
    caption: str = ""


@dataclasses.dataclass(frozen=True)
class Gallery:
    """Small pictures beside each other."""

    kind: ClassVar[str] = "gallery"
    pictures: Sequence[Picture]


@dataclasses.dataclass(frozen=True)
class Terms:
    """Terms with their key and meaning."""

    kind: ClassVar[str] = "terms"
    terms: Sequence[tuple[str, str, str]]


@dataclasses.dataclass(frozen=True)
class Listing:
    """A file's text."""

    kind: ClassVar[str] = "listing"
    text: str


@dataclasses.dataclass(frozen=True)
class Folded:
    """Parts behind a line that opens them."""

    kind: ClassVar[str] = "folded"
    title: str
    parts: Sequence[Part]


@dataclasses.dataclass(frozen=True)
class Program:
    """Something interactive, as HTML marked as such."""

    kind: ClassVar[str] = "program"
    html: str


type Part = Table | Text | Bullets | Picture | Charts | Gallery | Terms | Listing | Folded | Program
