"""The curves of a program: what each cavity was under, and what the device did, over the program's steps."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from softmodels.pictures.path_curves import limits
from softmodels.pictures.style import CURVE, DPI, LINES, WARNING, WIDTH
from softmodels.results.columns import load_columns, term
from softmodels.results.row import Row
from softmodels.results.state_words import StateWords


def steps(rows: Sequence[Row], words: StateWords) -> Figure:
    """The gauge's rise, the cavities' pressures, their added volumes and the loads over the steps, below each other.

    Args:
        rows: All rows of ``path.csv``.
        words: What its run shows.
    """
    panels = [
        ([f"{words.gauge}_mm"], f"{words.gauge} rise in mm"),
        (words.pressures(rows[0]), "pressure in\ncm of water"),
        (words.volumes(rows[0]), "added volume\nin ml"),
        *(([name], str(term(name))) for name in load_columns(rows[0])),
    ]
    panels = [panel for panel in panels if panel[0]]
    figure = Figure((WIDTH, 7.6 + 1.8 * (len(panels) - 3)), dpi=DPI, layout="constrained")
    places = figure.subplots(len(panels), 1, sharex=True, height_ratios=(1.4, *(1.0 for _ in panels[1:])))
    come = np.array([row["load_step"] for row in rows])
    asked = np.array([bool(row["requested"]) for row in rows])
    for axes, (columns, label) in zip(places, panels, strict=True):
        shades = matplotlib.colormaps[LINES](np.linspace(0.1, 0.8, len(columns))) if len(columns) > 1 else [CURVE]
        for k, (name, colour) in enumerate(zip(columns, shades, strict=True), 1):
            values = np.array([row[name] for row in rows])
            axes.plot(
                come, values, "o-", color=colour, markersize=3.5, label=f"cavity{k}" if len(columns) > 1 else None
            )
            axes.plot(come[asked], values[asked], "o", color=colour, mfc="white", markersize=8, markeredgewidth=2)
            for row in limits(rows):
                axes.plot(row["load_step"], row[name], "D", color=WARNING, markersize=8)
        axes.set(ylabel=label)
        axes.margins(0.03, 0.08)
        if len(columns) > 1:
            axes.legend(loc="best")
    places[-1].set(xlabel="step of the program (circles are requested; a diamond is a limit point)")
    places[-1].xaxis.get_major_locator().set_params(integer=True)
    return figure
