"""What a column of ``path.csv`` is in words: unit, short name and meaning."""

from __future__ import annotations

import dataclasses

UNITS = {
    "N_per_m": "N/m", "Pa_per_mm2": "Pa/mm²", "per_m": "1/m", "cm": "cm", "mm": "mm", "ml": "ml", "Pa": "Pa", "kPa": "kPa",
    "mJ": "mJ", "Nmm": "N mm", "N": "N", "deg": "°",
}  # fmt: skip
"""How a column's name ends, the longer before the shorter, and the unit."""


@dataclasses.dataclass(frozen=True)
class Term:
    """A column: its short name, its unit ("" for a number) and what it is, a sentence without its stop."""

    name: str
    unit: str
    text: str

    def told_of(self, supply: str) -> Term:
        """The same with what drives the air in place of ``{supply}``."""
        return Term(self.name.replace("{supply}", supply), self.unit, self.text.replace("{supply}", supply))

    def __str__(self) -> str:
        return f"{self.name} ({self.unit})" if self.unit else self.name


AT_POINTS = "over all integration points of the cells, of the whole device and not only of what a picture shows"
"""Where the largest stretch and stress are taken: the one definition that every table, picture and message uses."""


def split(column: str) -> tuple[str, str]:
    """A column's name without its unit, and the unit: ``apex_mm`` is ("apex", "mm")."""
    for ending, unit in UNITS.items():
        if column.endswith(f"_{ending}"):
            return column.removesuffix(f"_{ending}"), unit
    return column, ""


def described(column: str, texts: tuple[str, str]) -> Term:
    """The term of a column from its short name and its meaning."""
    return Term(texts[0], split(column)[1], texts[1])


def at_rise(gauge: str) -> str:
    """Column of the pressure's 95 % band at the same rise of a device's gauge."""
    return f"pressure_at_{gauge}_95_cm"
