"""Which figures of a state a run has to show, and its load in words: messages, pictures and reports take them from here.

A device without a cavity has neither a pressure nor a volume. Where weights and forces alone load one with a cavity, its
pressure stays zero and is not shown; the volume that its cavity gains is.
"""

from __future__ import annotations

import dataclasses
import re

from softmodels.case.case import Case
from softmodels.results.columns import cavity_columns, load_columns, loads_words
from softmodels.results.row import Row

PRESSURE_AND_VOLUME = ("pressure_Pa", "added_volume_ml")
OF_PRESSURE = re.compile(r"pressure(_\d+|_95|_at_\w+_95)*_(cm|Pa)")
OF_VOLUME = re.compile(r"added_volume(_\d+|_95)*_ml")


OVERLAP_MARK = "WALLS OVERLAP"


def overlap_text(row: Row) -> str:
    """That walls pass through each other in a state, for its line, its title and its picture; empty where they do not."""
    return f"{OVERLAP_MARK} by {-row['least_gap_mm']:.3g} mm, not a real state" if row.get("walls_touch") else ""


@dataclasses.dataclass(frozen=True)
class StateWords:
    """What a run shows of its states.

    Attributes:
        gauge: The probe whose rise stands for the device's motion.
        pressure: Whether air presses in it.
        volume: Whether it has a cavity.
        driver: What drives the air, in a word.
        along: Columns of what the path raises and of what that works on, which place a state on it.
    """

    gauge: str
    pressure: bool = True
    volume: bool = True
    driver: str = "supply"
    along: tuple[str, str] = PRESSURE_AND_VOLUME

    def under(self, row: Row, pressure: str) -> str:
        """What a state is under: the words of its pressure where air presses, then its weights, forces and moments."""
        return ", ".join([*([pressure] if self.pressure else []), *loads_words(row)]) or "no load"

    def place(self, row: Row) -> str:
        """What a state is under, short: ``"34.81 cm"``, ``"12 cm, force tip 2 N"``."""
        return self.under(row, f"{row['pressure_cm']:.4g} cm" if self.pressure else "")

    def loaded(self, row: Row) -> bool:
        """Whether anything acts on a state."""
        return any(row.get(column) for column in (*self.along, *PRESSURE_AND_VOLUME, *load_columns(row)))

    def pressures(self, row: Row) -> list[str]:
        """The columns with pressures that are shown: one for each cavity, or none."""
        return cavity_columns(row, "pressure", "cm") if self.pressure else []

    def volumes(self, row: Row) -> list[str]:
        """The columns with added volumes that are shown: one for each cavity, or none."""
        return cavity_columns(row, "added_volume", "ml") if self.volume else []

    def hides(self, column: str) -> bool:
        """Whether a column of ``path.csv`` tells of air that is not there."""
        no_pressure, no_volume = (
            not self.pressure and OF_PRESSURE.fullmatch(column),
            not self.volume and OF_VOLUME.fullmatch(column),
        )
        return bool(no_pressure or no_volume)

    @property
    def kept(self) -> tuple[str, str]:
        """What a state is stable or unstable under: a given load, and a given measure of what it moves."""
        raised = self.pressure and self.along == PRESSURE_AND_VOLUME
        return ("pressure", "volume") if raised else ("load", "travel")


def state_words(case: Case) -> StateWords:
    """What the states of a case have to show."""
    words = StateWords(case.actuator.gauge, case.load.has_pressure, bool(case.actuator.ratios), case.load.driver)
    if case.driven is None:
        return words
    load = case.driven.of(case.parts)
    return dataclasses.replace(words, along=(load.column, load.moved_column))
