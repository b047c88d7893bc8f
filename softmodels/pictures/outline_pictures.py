"""Pictures of a fit to outlines: measured and simulated ones on top of each other, and what is left of each photograph."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from softmodels.fitting.outlines.outline_residuals import MatchedPhotograph
from softmodels.fitting.outlines.simulated import half_outline
from softmodels.pictures.style import DPI, FAINT, INK, WIDTH, Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHOWN = 400
"""Measured points drawn per photograph."""
COLUMNS = 3


def draw_outlines(matches: Sequence[MatchedPhotograph], law: str) -> Figure:
    """All outlines in the device's own place: points measured, lines simulated, a colour per pressure."""
    figure = Figure((WIDTH, 0.55 * WIDTH), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    for fitting, colour in zip(matches, _colours(len(matches)), strict=True):
        stride = max(len(fitting.points) // SHOWN, 1)
        measured = 1e3 * (fitting.points * np.column_stack([fitting.side, np.ones_like(fitting.side)]))[::stride]
        axes.plot(measured[:, 0], measured[:, 1], ".", ms=2.5, color=INK, alpha=0.5)
        half = 1e3 * half_outline(fitting.shadow.curve, 2e-5)[0]
        label = f"{fitting.shape.pressure / 1e3:.3g} kPa"
        axes.plot(
            np.r_[-half[:0:-1, 0], half[:, 0]], np.r_[half[:0:-1, 1], half[:, 1]], color=colour, lw=1.4, label=label
        )
    axes.axhline(0.0, color=FAINT, linewidth=0.8)
    reach = 1e3 * max(float(fitting.points[:, 0].max()) for fitting in matches)
    top = 1e3 * max(float(fitting.points[:, 1].max()) for fitting in matches)
    axes.set_xlim(-1.15 * reach, 1.15 * reach)
    axes.set_ylim(-0.04 * top, 1.06 * top)
    if top > reach / 2:  # flatter ones would be a thin strip
        axes.set_aspect("equal")
    axes.set_xlabel("distance from the axis (mm)")
    axes.set_ylabel("height (mm)")
    axes.set_title(f"{law}: measured (points) and simulated (lines) outlines")
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(handles[::-1], labels[::-1], loc="center left", bbox_to_anchor=(1.0, 0.5), title="read")
    return figure


def draw_photographs(matches: Sequence[MatchedPhotograph], law: str) -> Figure:
    """Simulated less measured, across the outline, one panel per photograph, and the band of two standard errors."""
    columns = min(len(matches), COLUMNS)
    rows = -(-len(matches) // columns)
    figure = Figure((WIDTH, 2.3 * rows + 0.5), dpi=DPI, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True)
    for axes, fitting in zip(grid.ravel(), matches, strict=False):
        _panel(axes, fitting)
    for axes in grid.ravel()[len(matches) :]:
        axes.set_visible(False)
    for axes in grid[-1]:
        axes.set_xlabel("distance from the axis (mm)")
    for axes in grid[:, 0]:
        axes.set_ylabel("simulated less\nmeasured (um)")
    figure.suptitle(f"{law}: what is left of each photograph; grey: two standard errors of a mean over a bin")
    return figure


def _panel(axes: Axes, fitting: MatchedPhotograph) -> None:
    shape = fitting.shape
    count = np.bincount(shape.bins)
    place = np.bincount(shape.bins, 1e3 * fitting.side * fitting.points[:, 0]) / count
    error = 1e6 * np.bincount(shape.bins, shape.error) / count / shape.weight
    axes.fill_between(place, -2 * error, 2 * error, color=FAINT, alpha=0.35, lw=0)
    axes.axhline(0.0, color=FAINT, linewidth=0.8)
    axes.plot(place, fitting.residuals * error, ".-", ms=4, lw=0.8, color=INK)
    chi2 = float((fitting.residuals**2).sum())
    axes.set_title(
        f"{shape.pressure / 1e3:.3g} kPa ({fitting.reading * shape.pressure_error:+.0f} Pa): "
        f"$\\chi^2$ {chi2:.0f} of {len(fitting.residuals)}",
        fontsize=9,
    )


def _colours(count: int) -> Array:
    import matplotlib

    return matplotlib.colormaps["viridis"](np.linspace(0.0, 0.88, count))
