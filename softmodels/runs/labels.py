"""Labels of a run's states: which figures to show, and the load in words, for messages, pictures and reports.

A device without a cavity has neither a pressure nor a volume. If only weights and forces load a device with a cavity, the zero
pressure is hidden and the added volume shown.
"""

from __future__ import annotations

import dataclasses
import math
import re

from softmodels.case.case import Case
from softmodels.common import units
from softmodels.materials import silicones
from softmodels.mechanics import controls
from softmodels.runs import columns, table

PRESSURE_AND_VOLUME = ("pressure", "added_volume")


@dataclasses.dataclass(frozen=True)
class StateLabels:
    """Labels of a run's states.

    Attributes:
        gauge: The probe whose rise stands for the device's motion.
        pressure, volume: Whether it is pressurised, and has a cavity.
        driver: The air supply, in a word.
        along: Variables of the load and its conjugate, which locate a state on the path.
        loads, moved: Variables with weights, forces and moments, and of what each works on.
        unit: Of the heights of the column, with the density of its liquid.
        fitted: The largest stretch to which the silicone was fitted; infinite if unknown.
    """

    gauge: str
    pressure: bool = True
    volume: bool = True
    driver: str = "supply"
    along: tuple[str, str] = PRESSURE_AND_VOLUME
    loads: tuple[str, ...] = ()
    moved: tuple[str, ...] = ()
    unit: str = units.COLUMN.unit
    fitted: float = math.inf

    def loads_in(self, row: table.Row) -> list[str]:
        """Return the weights, forces and moments that a row has."""
        return [name for name in self.loads if name in row]

    def loads_words(self, row: table.Row) -> list[str]:
        """Return the weights, forces and moments of a state in words, such as ``"force tip 2 N"``."""
        return [f"{name.replace('_', ' ')} {row.told(name)}" for name in self.loads_in(row)]

    def under(self, row: table.Row, pressure: str) -> str:
        """Return the loads of a state: the given words for its pressure, then its weights, forces and moments."""
        return ", ".join([*([pressure] if self.pressure else []), *self.loads_words(row)]) or "no load"

    def place(self, row: table.Row) -> str:
        """Return the loads of a state, short: ``"34.81 cm"``, ``"12 cm, force tip 2 N"``."""
        return self.under(row, row.told("pressure") if self.pressure else "")

    def loaded(self, row: table.Row) -> bool:
        """Return whether anything acts on a state."""
        return any(row.get(name) for name in (*self.along, *PRESSURE_AND_VOLUME, *self.loads))

    def pressures(self, row: table.Row) -> list[str]:
        """Return the pressures that are shown: one for each cavity, or none."""
        return columns.of_cavities(row, "pressure") if self.pressure else []

    def volumes(self, row: table.Row) -> list[str]:
        """Return the added volumes that are shown: one for each cavity, or none."""
        return columns.of_cavities(row, "added_volume") if self.volume else []

    def hides(self, column: str) -> bool:
        """Return whether to hide a column of ``path.csv``, because the device has no air in it."""
        variable = table.parsed(column)[0]
        no_pressure = not self.pressure and OF_PRESSURE.fullmatch(variable)
        return bool(no_pressure or (not self.volume and OF_VOLUME.fullmatch(variable)))

    @property
    def kept(self) -> tuple[str, str]:
        """The two controls for which stability is reported: the load, and its conjugate."""
        raised = self.pressure and self.along == PRESSURE_AND_VOLUME
        return ("pressure", "volume") if raised else ("load", "travel")


OF_PRESSURE = re.compile(r"pressure(_\d+|_ci95(_\w+)?|_at_\w+_ci95)*")
OF_VOLUME = re.compile(r"added_volume(_\d+|_ci95(_\w+)?)*")

INVALID = "invalid state"


def overlap_text(row: table.Row) -> str:
    """Return a warning that walls overlap in a state or its surface is folded, for its line, title and picture; else ""."""
    if not row.get("walls_touch"):
        return ""
    overlap = 1e3 * overlap_of(row)
    return f"{f'WALLS OVERLAP by {overlap:.3g} mm' if overlap > 0.0 else 'SURFACE FOLDED onto itself'}: {INVALID}"


def overlap_of(row: table.Row) -> float:
    """Return by how many m walls overlap in a state; 0 where none do."""
    gap = row.get("least_gap")  # NaN where no walls are near
    return -gap if gap < 0.0 else 0.0


def state_labels(case: Case) -> StateLabels:
    """Return the labels of a case's states."""
    loads = [part for part in case.components if isinstance(part, controls.LoadPart) and not part.idle(case.components)]
    words = StateLabels(
        case.actuator.gauge, case.load.has_pressure, bool(case.actuator.ratios), case.load.driver,
        loads=tuple(load.variables[0] for load in loads),
        moved=tuple(load.variables[1] for load in loads),
        unit=case.column.unit,
        fitted=(silicones.stretches_of(case.material) or (1.0, math.inf))[1],
    )  # fmt: skip
    if case.load.driven is None:
        return words
    load = case.load.driven_part
    return dataclasses.replace(words, along=(load.variables[0], load.variables[1]))


def number(value: float) -> str:
    """Return a value for a label: at most one decimal, none if it is round."""
    return f"{round(value, 1) + 0.0:.1f}".removesuffix(".0")  # + 0.0: no minus before a zero


def load(row: table.Row, words: StateLabels, kilopascals: bool = True) -> str:
    """Return the load of a state in words and units: its pressure, or its program step and every cavity's pressure.

    Args:
        row: The state.
        words: What its run shows.
        kilopascals: Whether a pressure is shown in kPa too.
    """
    step = f"step {row['load_step']:.3g}: " if "load_step" in row else ""
    pressure = f"{' and '.join(number(row.shown(name)) for name in words.pressures(row))} {words.unit}"
    if kilopascals and words.pressure and not step:
        pressure += f" ({row['pressure'] / 1e3:.3g} kPa)"
    overlap = overlap_text(row)
    return f"{step}{words.under(row, pressure)}{f' - {overlap}' if overlap else ''}"


def headline(row: table.Row, words: StateLabels) -> str:
    """Return the title of a state."""
    return f"{load(row, words)}, {words.gauge} rise {row.told(words.gauge, '.2f')}"
