"""The paths of a device under every source of its silicone: their file ``sources.csv``, and what they span in words."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from softmodels.case.case import Case
from softmodels.case.material_errors import SourceBand
from softmodels.materials.silicones import named, silicone_called
from softmodels.materials.spread import source_names
from softmodels.results.row import Cell, Row
from softmodels.results.state_words import state_words
from softmodels.results.writing import replace

type SourceRows = Mapping[str, Sequence[Row]]
"""Rows of ``path.csv`` of each source by its name, from the softest to the stiffest."""

FILE = "sources.csv"
WORDS = ("following",)
"""Columns of words."""


def write_sources(folder: Path, sources: SourceRows) -> None:
    """Write the table: the source, then the columns of ``path.csv`` without those of an error's band."""
    rows = [(name, row) for name, many in sources.items() for row in many]
    columns = list(dict.fromkeys(column for _, row in rows for column in row))
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, ["source", *columns], lineterminator="\n")
    writer.writeheader()
    writer.writerows({"source": name, **row.cells} for name, row in rows)
    replace(folder / FILE, lambda path: path.write_text(text.getvalue(), encoding="utf-8"))


def read_sources(folder: Path) -> dict[str, list[Row]]:
    """The table's rows by source; empty where there is none, or none that can be read."""
    found: dict[str, list[Row]] = {}
    try:
        with (folder / FILE).open(newline="", encoding="utf-8") as file:
            for cells in csv.DictReader(file):
                found.setdefault(cells.pop("source"), []).append(Row({k: _cell(k, v) for k, v in cells.items()}))
    except (OSError, ValueError, KeyError):
        return {}
    return found


def _cell(column: str, text: str) -> Cell:
    return text if column in WORDS else float(text) if text else None


def in_order(case: Case, rows: Sequence[Row], others: SourceRows) -> dict[str, Sequence[Row]]:
    """All sources from the softest to the stiffest, the run's own path among them; empty where there are no others."""
    own = named(case.material)
    if own is None or not others:
        return {}
    every = {own: rows, **others}
    return {name: every[name] for name in source_names(own) if name in every}


def span_sentence(case: Case, sources: SourceRows) -> str:
    """Between which figures the sources of a silicone lie at the last value that all of them reach, and at their limits."""
    words, own = state_words(case), named(case.material)
    common = _common(case, sources)
    parts = []
    if common:
        rows = {name: many[common[name]] for name, many in sources.items()}
        gauge = f"{words.gauge}_mm"
        here = rows[own or ""]
        place = words.place(here) if case.column == "pressure_cm" else f"{here[case.column]:.4g} {case.unit}"
        parts.append(f"at {place} the {words.gauge} rises {_ends(rows, gauge, 'mm')}")
        if words.volume and case.column != "added_volume_ml":
            parts.append(f"the cavity takes {_ends(rows, 'added_volume_ml', 'ml')}")
        if words.pressure and case.column != "pressure_cm":
            parts.append(f"the pressure is {_ends(rows, 'pressure_cm', 'cm')}")
    limits = {name: row for name, many in sources.items() if (row := next((r for r in many if r["limit"]), None))}
    if limits:
        none = [key_of(name) for name in sources if name not in limits]
        met = f" (none met with {', '.join(none)})" if none else ""
        parts.append(f"the limit point lies at {_ends(limits, 'pressure_cm', 'cm')}{met}")
    band = case.band.product if isinstance(case.band, SourceBand) else own
    return f"over the {len(sources)} sources of {band}, {'; '.join(parts)}" if parts else ""


def _common(case: Case, sources: SourceRows) -> dict[str, int]:
    """The row of each source at the last requested value that all of them reach; empty if they share none under load."""
    for value in sorted(case.values, key=abs, reverse=True):
        found: dict[str, int] = {}
        for name, rows in sources.items():
            there = [k for k, row in enumerate(rows) if math.isclose(row[case.column], value, rel_tol=1e-6)]
            if there:
                found[name] = there[0]
        if value and len(found) == len(sources):
            return found
    return {}


def _ends(rows: Mapping[str, Row], column: str, unit: str) -> str:
    ordered = sorted(rows, key=lambda name: rows[name][column])
    low, high = (f"{rows[name][column]:.4g} {unit} ({key_of(name)})" for name in (ordered[0], ordered[-1]))
    return low if len(rows) == 1 else f"{low} to {high}"


def key_of(name: str) -> str:
    """The short name of a source, of a product's plain name too."""
    found = silicone_called(name)
    return found.origin.key if found else name
