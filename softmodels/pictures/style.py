"""What all pictures have in common: size, style and colours of lines, and a state's title in words and units.

Figures are made without pyplot, so that nothing global is touched and no display is asked for.
"""

from __future__ import annotations

import textwrap
from typing import Any

import numpy as np
import numpy.typing as npt

from softmodels.results.row import Row
from softmodels.results.state_words import OVERLAP_MARK, StateWords, overlap_text

Array = npt.NDArray[np.float64]

DPI = 160
WIDTH = 10.0
"""Width of every page in inches: 1600 pixels."""

CHARACTER = 0.62
"""Width of a character, in sizes of the font: a little more than the mean of the fonts' letters and digits."""

LINES = "viridis"
SPAN = "#e4e7eb"
"""Of what several laws span behind a curve."""
SOLID = "#d9e2ec"
STYLE: Any = {  # versions of matplotlib differ in the type of their parameters' names
    "font.size": 12,
    "axes.titlesize": 13,
    "legend.fontsize": 11,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "lines.linewidth": 2.0,
}
INK, EDGE, FAINT = "#102a43", "#334e68", "#829ab1"
CURVE, WARNING, BRANCH = "#2f6f9f", "#c0392b", "#b7791f"


def number(value: float) -> str:
    """A value for a label: at most one decimal, none if it is round."""
    return f"{round(value, 1) + 0.0:.1f}".removesuffix(".0")  # + 0.0: no minus before a zero


def load(row: Row, words: StateWords, kilopascals: bool = True) -> str:
    """What a state is under, in words and units: its pressure, or where it is in a program and every cavity's pressure.

    Args:
        row: The state's row of ``path.csv``.
        words: What its run shows.
        kilopascals: Whether a pressure is shown in kPa too.
    """
    step = f"step {row['load_step']:.3g}: " if "load_step" in row else ""
    pressure = f"{' and '.join(number(row[name]) for name in words.pressures(row))} cm of water"
    if kilopascals and words.pressure and not step:
        pressure += f" ({row['pressure_Pa'] / 1e3:.3g} kPa)"
    overlap = overlap_text(row)
    return f"{step}{words.under(row, pressure)}{f' - {overlap}' if overlap else ''}"


def title_colour(title: str) -> str:
    """Colour of a state's title: that of warnings where it says that walls overlap."""
    return WARNING if OVERLAP_MARK in title else "black"


def headline(row: Row, words: StateWords) -> str:
    """What a state is, in words and units."""
    return f"{load(row, words)}, {words.gauge} rise {row[f'{words.gauge}_mm']:.2f} mm"


def wrapped(text: str, width: float, size: float) -> str:
    """A text of a size in points as lines that fit a width in inches."""
    return textwrap.fill(text, max(int(width * 72 / (CHARACTER * size)), 12), break_long_words=False)
