"""Tables of what the tests measured, in ``tests/verification/README.md``.

Between the lines ``<!-- figures: test_one.py test_two.py -->`` and ``<!-- end of figures -->`` stands one table, with a row for
each figure that the named files of tests assert (fixture `figure`). The lines are placed by hand; what is between them is
written here.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

README = Path(__file__).parents[1] / "verification" / "README.md"
_TABLE = re.compile(r"(<!-- figures: ([^>]*?) -->\n)(.*?)(<!-- end of figures -->)", re.DOTALL)
_HEAD = "| against | what | measured | asserted | test |\n|---|---|---|---|---|\n"


class Figure(NamedTuple):
    """One figure that a test has measured and asserted."""

    file: str
    """Name of the test's file."""
    against: str
    """What it is held against."""
    name: str
    """What is held against it."""
    value: float
    bound: float
    least: bool = False
    """Whether the bound is from below, as a rate's is."""
    unit: str = ""

    @property
    def loose(self) -> bool:
        """Whether the bound lies farther from the value than three times, and not because the value is rounding."""
        return not self.least and self.bound > 1e-7 and self.bound > 3.0 * abs(self.value)

    def cells(self) -> tuple[str, str, str, str, str]:
        """The five cells of the figure's row."""
        unit = f" {self.unit}" if self.unit and self.unit != "%" else self.unit
        bound = f"{'≥' if self.least else '≤'} {self.bound:g}{unit}"
        value = f"{self.value:.2g}" if abs(self.value) < 100.0 else f"{self.value:.0f}"
        return self.against, self.name, f"{value}{unit}", bound, f"`{self.file}`"


def worst(figures: Iterable[Figure]) -> list[Figure]:
    """One figure for all that share file and names, as the cases of one parametrised test do: the one nearest its bound."""
    kept: dict[tuple[str, str, str], Figure] = {}
    for figure in figures:
        key = figure[:3]
        before = kept.get(key)
        if before is None or (figure.value < before.value if figure.least else figure.value > before.value):
            kept[key] = figure
    return list(kept.values())


def unlisted(text: str, figures: Iterable[Figure]) -> list[str]:
    """Files of tests that have figures and stand in no table of the page."""
    listed = {file for _, names, _, _ in _TABLE.findall(text) for file in names.split()}
    return sorted({figure.file for figure in figures} - listed)


def rewritten(text: str, figures: Iterable[Figure], whole: Mapping[str, bool]) -> str:
    """The page with the rows of these figures in place of the old ones.

    Args:
        text: The page as it is.
        figures: What was measured.
        whole: Files of tests that ran, and whether all of their tests ran and passed: rows that such a file no longer measures
            are dropped; the others' stay.
    """
    rows: dict[str, list[Figure]] = {}
    for figure in worst(figures):
        rows.setdefault(figure.file, []).append(figure)

    def table(match: re.Match[str]) -> str:
        lines = []
        for file in match[2].split():
            new = {figure.cells()[:2]: figure.cells() for figure in rows.get(file, [])}
            old = {cells[:2]: cells for cells in _cells(match[3]) if cells[4] == f"`{file}`"}
            for cells in (new if whole.get(file, False) else {**old, **new}).values():
                lines.append(f"| {' | '.join(cells)} |\n")
        return f"{match[1]}{_HEAD}{''.join(lines)}{match[4]}"

    return _TABLE.sub(table, text)


def _cells(table: str) -> list[tuple[str, ...]]:
    lines = table.splitlines()[2:]
    return [tuple(cell.strip() for cell in line.strip("|").split(" | ")) for line in lines]
