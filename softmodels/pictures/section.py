"""Pictures of an axisymmetric section in millimetres; no rendering needed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from softmodels.common.arrays import Array
from softmodels.pictures.offscreen import HotSpots, hot_title
from softmodels.pictures.style import (
    COLOURS,
    CURVE,
    DPI,
    EDGE,
    FAINT,
    FOOT,
    INK,
    SOLID,
    WARNING,
    WIDTH,
    Scale,
    headline,
    title_colour,
)
from softmodels.runs.columns import StateLabels
from softmodels.runs.grid import Cells, edge_curves, fine_triangles, outline
from softmodels.runs.row import Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def section_mesh(points: Array, cells: Cells) -> Figure:
    """Draw the half section with the edges of its cells; points in m, shape (n, 3) with y = 0."""
    flat = points[:, ::2] * 1e3
    figure, axes = _section(flat, 0.0)
    fine, triangles = fine_triangles(flat, cells)
    axes.tripcolor(Triangulation(fine[:, 0], fine[:, 1], triangles), np.zeros(len(fine)), cmap=ListedColormap([SOLID]))
    axes.add_collection(LineCollection(list(edge_curves(flat, cells)), colors=EDGE, linewidths=0.9))
    axes.set_title(f"Undeformed half section, {len(cells)} cells")
    return figure


def section_stress(
    points: Array, moved: Array, cells: Cells, values: Array, row: Row, words: StateLabels, plate: float | None = None
) -> Figure:
    """Draw the deformed half section coloured by stress, over the undeformed outline.

    Args:
        points: Undeformed, in m, shape (n, 3) with y = 0.
        moved: Deformed, likewise.
        cells: Shape (c, 6).
        values: Von Mises stress in Pa, shape (n,).
        row: The state's row of ``path.csv``.
        words: What its run shows.
        plate: Height of a rigid plane that stops it, m.
    """
    before, after, stress = points[:, ::2] * 1e3, moved[:, ::2] * 1e3, Scale(values, rows=[row])
    figure, axes = _section(np.concatenate([before, after]), FOOT)
    fine, triangles = fine_triangles(np.column_stack([after, values / 1e3]), cells)
    flat = Triangulation(fine[:, 0], fine[:, 1], triangles)
    axes.tripcolor(flat, fine[:, 2], shading="gouraud", cmap=COLOURS, norm=stress.norm)
    for shown, colour in ((after, INK), (before, FAINT)):
        axes.add_collection(LineCollection(list(outline(shown, cells)), colors=colour, linewidths=1.0))
    if plate is not None:
        axes.axhline(plate * 1e3, color=WARNING, linewidth=1.5, linestyle="--")
    title = headline(row, words) + ("" if plate is None else "; the rigid plane dashed")
    axes.set_title(title, color=title_colour(title))
    stress.bar(figure)
    return figure


def section_hot(points: Array, cells: Cells, values: Array, hot: HotSpots, row: Row) -> Figure:
    """Draw the deformed half section coloured by stretch, with the isoline around the largest stretch.

    Args:
        points: Deformed, in m, shape (n, 3) with y = 0.
        cells: Shape (c, 6).
        values: Largest principal stretch, shape (n,).
        hot: What is stretched most.
        row: The state's row of ``path.csv``.
    """
    flat, scale = points[:, ::2] * 1e3, Scale(values, "largest_stretch", rows=[row])
    figure, axes = _section(flat, FOOT + 0.3)
    fine, triangles = fine_triangles(np.column_stack([flat, values]), cells)
    mesh = Triangulation(fine[:, 0], fine[:, 1], triangles)
    axes.tripcolor(mesh, fine[:, 2], shading="gouraud", cmap=COLOURS, norm=scale.norm)
    axes.add_collection(LineCollection(list(outline(flat, cells)), colors=INK, linewidths=0.7))
    if fine[:, 2].min() < hot.limit < fine[:, 2].max():
        axes.tricontour(mesh, fine[:, 2], levels=[hot.limit], colors="black", linewidths=1.6)
    if hot.peak is not None:
        for colour, wide in (("white", 5.0), ("black", 2.0)):
            axes.plot(
                1e3 * hot.peak[0], 1e3 * hot.peak[2], "o", mfc="none", color=colour, markersize=16, markeredgewidth=wide
            )
    axes.set_title(hot_title(hot.limit))
    figure.text(0.5, 1.2 / figure.get_figheight(), hot.note, ha="center", color=WARNING, fontsize=11)
    scale.bar(figure)
    return figure


def section_mode(
    points: Array, moved: Array, mode: Array, cells: Cells, row: Row, words: StateLabels, amount: float = 0.15
) -> Figure:
    """Draw the half section at a bifurcation and the two branches.

    Args:
        points: Undeformed, in m, shape (n, 3) with y = 0.
        moved: At the bifurcation, likewise.
        mode: Its mode, largest component 1, shape (n, 3).
        cells: Shape (c, 6).
        row: The state's row of ``path.csv``.
        words: What its run shows.
        amount: Largest displacement of the mode as drawn, in widths of the undeformed section.
    """
    before, after = points[:, ::2] * 1e3, moved[:, ::2] * 1e3
    size = amount * np.ptp(before[:, 0])
    shapes = [(after + sign * size * mode[:, ::2], colour) for sign, colour in ((1, WARNING), (-1, CURVE))]
    figure, axes = _section(np.concatenate([before, *(shape for shape, _ in shapes)]), 0.0)
    for shown, colour in ((before, FAINT), (after, INK), *shapes):
        axes.add_collection(LineCollection(list(outline(shown, cells)), colors=colour, linewidths=1.4))
    axes.set_title(f"Bifurcation at {headline(row, words)}: the mode in both directions (arbitrary amplitude)")
    return figure


def _section(points: Array, foot: float) -> tuple[Figure, Axes]:
    """Return the axes in mm with equal scales around flat points, shape (n, 2), with ``foot`` inches free below them."""
    (left, low), (right, high) = points.min(axis=0), points.max(axis=0)
    margin = 0.04 * (right - left)
    wide, tall = right - left + 2 * margin, high - low + 2 * margin
    inner = 8.6
    height = min(inner * tall / wide, 6.4)
    head, below = 0.55, foot + 0.75
    whole = head + height + below
    figure = Figure((WIDTH, whole), dpi=DPI)
    used = height * wide / tall / WIDTH
    axes = figure.add_axes(((1.0 - used) / 2 + 0.02, below / whole, used, height / whole))
    axes.set(xlim=(left - margin, right + margin), ylim=(low - margin, high + margin))
    axes.set(xlabel="radius in mm", ylabel="height in mm")
    axes.axvline(0.0, color=FAINT, linestyle=(0, (8, 3, 1, 3)), linewidth=1.0)
    axes.grid(False)
    return figure, axes
