"""Pictures that need no rendering: curves, profiles, flat sections, and the page around a rendered image.

Figures are made without pyplot, so that nothing global is touched and no display is asked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from geometries import Actuator

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = npt.NDArray[np.float64]
Row = Mapping[str, Any]

DPI = 160
WIDTH = 10.0
"""Width of every page in inches: 1600 pixels."""

COLOURS = "Spectral_r"
LINES = "viridis"
SOLID = "#d9e2ec"
STYLE: Any = {
    "font.size": 12,
    "axes.titlesize": 13,
    "legend.fontsize": 11,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "lines.linewidth": 2.0,
}
INK, EDGE, FAINT = "#102a43", "#334e68", "#829ab1"
CURVE, WARNING = "#2f6f9f", "#c0392b"
FEW = 2
"""Up to this many requested values, the profile shows steps in between as well."""
LEGEND_LINES = 12

EDGES = np.array([(0, 1, 3), (1, 2, 4), (2, 0, 5)])
"""Edges of a six-node triangle: both ends and the node between them."""

FACES = {
    "Triangle_6": ((0, 1, 2, 3, 4, 5),),
    "Tetrahedron_10": ((0, 1, 3, 4, 8, 7), (1, 2, 3, 5, 9, 8), (2, 0, 3, 6, 7, 9), (0, 2, 1, 6, 5, 4)),
}
"""Faces of a cell, in VTK's order of nodes, as triangles of six nodes."""


def number(value: float) -> str:
    """A value for a label: at most one decimal, none if it is round."""
    return f"{value:.1f}".removesuffix(".0")


def headline(row: Row) -> str:
    """What a state is, in words and units."""
    pressure = f"{number(row['pressure_cm'])} cm of water ({row['pressure_Pa'] / 1e3:.3g} kPa)"
    return f"{pressure}, apex rise {row['apex_mm']:.2f} mm"


# -- second-order cells -----------------------------------------------------------------------------------------------


def outer_faces(cells: npt.NDArray[np.int64], cell_name: str) -> npt.NDArray[np.int64]:
    """Faces that belong to one cell alone, shape (f, 6); of a flat mesh, all its triangles."""
    faces = cells[:, np.array(FACES[cell_name])].reshape(-1, 6)
    _, first, count = np.unique(np.sort(faces[:, :3], axis=1), axis=0, return_index=True, return_counts=True)
    return faces[np.sort(first[count == 1])]


def edge_curves(points: Array, faces: npt.NDArray[np.int64], parts: int = 8) -> Array:
    """Curves along the edges of six-node triangles, each once.

    Args:
        points: Shape (n, d).
        faces: Shape (f, 6).
        parts: Straight pieces per edge.

    Returns:
        Shape (edges, parts + 1, d).
    """
    edges = faces[:, EDGES].reshape(-1, 3)
    edges = edges[np.unique(edges[:, 2], return_index=True)[1]]
    return _along(points[edges], parts)


def _along(nodes: Array, parts: int) -> Array:
    """Parabolas through (begin, end, middle) nodes, shape (n, 3, d) to (n, parts + 1, d)."""
    s = np.linspace(0.0, 1.0, parts + 1)
    weights = np.column_stack([(1 - s) * (1 - 2 * s), s * (2 * s - 1), 4 * s * (1 - s)])
    return np.einsum("sk,nkd->nsd", weights, nodes)


def fine_triangles(values: Array, faces: npt.NDArray[np.int64], parts: int = 4) -> tuple[Array, npt.NDArray[np.int64]]:
    """Six-node triangles as small flat ones.

    Args:
        values: Nodal values such as points, shape (n, k).
        faces: Shape (f, 6).
        parts: Pieces per edge.

    Returns:
        Values at the corners of the small triangles, shape (m, k), and the triangles, shape (f parts^2, 3).
    """
    places = [(i, j) for j in range(parts + 1) for i in range(parts + 1 - j)]
    number_of = {place: n for n, place in enumerate(places)}
    r, s = np.array(places).T / parts
    t = 1 - r - s
    weights = np.column_stack([t * (2 * t - 1), r * (2 * r - 1), s * (2 * s - 1), 4 * t * r, 4 * r * s, 4 * s * t])
    small = [[number_of[i, j], number_of[i + 1, j], number_of[i, j + 1]] for i, j in places if i + j < parts]
    small += [[number_of[i, j], number_of[i - 1, j], number_of[i, j - 1]] for i, j in places if i > 0 and j > 0]
    fine = np.einsum("pk,fkd->fpd", weights, values[faces]).reshape(-1, values.shape[1])
    triangles = (np.arange(len(faces))[:, None, None] * len(places) + np.array(small)).reshape(-1, 3)
    return fine, triangles


# -- the page around a picture ----------------------------------------------------------------------------------------


def page(image: npt.NDArray[np.uint8], title: str, stress: Stress | None = None) -> Figure:
    """A rendered image under its title, with the colour bar below if it shows a stress."""
    head, foot = 0.55, 0.0 if stress is None else 0.95
    height = image.shape[0] / DPI
    figure = Figure((WIDTH, head + height + foot), dpi=DPI)
    whole = head + height + foot
    axes = figure.add_axes((0.0, foot / whole, 1.0, height / whole))
    axes.imshow(image)
    axes.set_axis_off()
    figure.text(0.5, 1 - 0.5 * head / whole, title, ha="center", va="center", fontsize=13)
    if stress is not None:
        stress.bar(figure, figure.add_axes((0.2, 0.62 / whole, 0.6, 0.18 / whole)))
    return figure


class Stress:
    """The colours of a von Mises stress.

    Corners make a few nodes stand far out, and a scale up to them would leave the body one colour. The scale therefore
    ends where a hundredth of the nodes lies above it, and the bar tells the largest value.

    Args:
        values: Nodal values in Pa, shape (n,).
    """

    def __init__(self, values: Array):
        self.largest = float(values.max()) / 1e3
        self.top = float(np.percentile(values, 99)) / 1e3 or max(self.largest, 1.0)
        self.colours = matplotlib.colormaps[COLOURS]

    def bar(self, figure: Figure, axes: Axes) -> None:
        scale = ScalarMappable(Normalize(0.0, self.top), self.colours)
        figure.colorbar(
            scale,
            cax=axes,
            orientation="horizontal",
            extend="max" if self.largest > self.top else "neither",
            label=f"von Mises stress in kPa (largest at a node: {self.largest:.3g} kPa)",
        )


# -- flat sections ----------------------------------------------------------------------------------------------------


def section_mesh(points: Array, cells: npt.NDArray[np.int64]) -> Figure:
    """The half section with the edges of its cells; points in m, shape (n, 3) with y = 0."""
    flat = points[:, ::2] * 1e3
    figure, axes = _section(flat, 0.0)
    fine, triangles = fine_triangles(flat, cells)
    axes.tripcolor(Triangulation(fine[:, 0], fine[:, 1], triangles), np.zeros(len(fine)), cmap=ListedColormap([SOLID]))
    axes.add_collection(LineCollection(list(edge_curves(flat, cells)), colors=EDGE, linewidths=0.9))
    axes.set_title(f"Undeformed half section, {len(cells)} cells")
    return figure


def section_stress(points: Array, moved: Array, cells: npt.NDArray[np.int64], values: Array, row: Row) -> Figure:
    """The deformed half section coloured by stress, over the outline of the undeformed one.

    Args:
        points: Undeformed, in m, shape (n, 3) with y = 0.
        moved: Deformed, likewise.
        cells: Shape (c, 6).
        values: Von Mises stress in Pa, shape (n,).
        row: The state's row of ``path.csv``.
    """
    before, after, stress = points[:, ::2] * 1e3, moved[:, ::2] * 1e3, Stress(values)
    figure, axes = _section(np.concatenate([before, after]), 0.95)
    fine, triangles = fine_triangles(np.column_stack([after, values / 1e3]), cells)
    flat = Triangulation(fine[:, 0], fine[:, 1], triangles)
    axes.tripcolor(flat, fine[:, 2], shading="gouraud", cmap=COLOURS, vmin=0.0, vmax=stress.top)
    for shown, colour in ((after, INK), (before, FAINT)):
        axes.add_collection(LineCollection(list(outline(shown, cells)), colors=colour, linewidths=1.0))
    axes.set_title(headline(row))
    height = figure.get_figheight()
    stress.bar(figure, figure.add_axes((0.2, 0.62 / height, 0.6, 0.18 / height)))
    return figure


def section_mode(
    points: Array, moved: Array, mode: Array, cells: npt.NDArray[np.int64], row: Row, amount: float = 0.15
) -> Figure:
    """The half section at a bifurcation and the two shapes it can go on to.

    Args:
        points: Undeformed, in m, shape (n, 3) with y = 0.
        moved: At the bifurcation, likewise.
        mode: Its mode, largest component 1, shape (n, 3).
        cells: Shape (c, 6).
        row: The state's row of ``path.csv``.
        amount: Largest displacement of the mode as drawn, in widths of the undeformed section.
    """
    before, after = points[:, ::2] * 1e3, moved[:, ::2] * 1e3
    size = amount * np.ptp(before[:, 0])
    shapes = [(after + sign * size * mode[:, ::2], colour) for sign, colour in ((1, WARNING), (-1, CURVE))]
    figure, axes = _section(np.concatenate([before, *(shape for shape, _ in shapes)]), 0.0)
    for shown, colour in ((before, FAINT), (after, INK), *shapes):
        axes.add_collection(LineCollection(list(outline(shown, cells)), colors=colour, linewidths=1.4))
    axes.set_title(f"Bifurcation at {headline(row)}: the mode, either way (size at will)")
    return figure


def outline(points: Array, cells: npt.NDArray[np.int64]) -> Array:
    """Curves along the edges that belong to one triangle alone, shape (n, d) to (edges, 9, d)."""
    edges = cells[:, EDGES].reshape(-1, 3)
    _, first, count = np.unique(edges[:, 2], return_index=True, return_counts=True)
    return _along(points[edges[first[count == 1]]], 8)


def _section(points: Array, foot: float) -> tuple[Figure, Axes]:
    """Axes in mm with equal scales around flat points, shape (n, 2), with ``foot`` inches free below them."""
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


# -- curves -----------------------------------------------------------------------------------------------------------


def apex(rows: Sequence[Row], pascal_per_cm: float) -> Figure:
    """Rise of the apex over the pressure.

    Args:
        rows: All rows of ``path.csv``.
        pascal_per_cm: Pa in one cm of the column.
    """
    path = np.array([[row["pressure_cm"], row["apex_mm"]] for row in rows])
    figure = Figure((WIDTH, 6.4), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    axes.plot(*smooth(path).T, color=CURVE, label="simulated path")
    axes.plot(*path.T, "o", color=CURVE, markersize=3.5, label="steps")
    asked = np.array([[row["pressure_cm"], row["apex_mm"]] for row in rows if row["requested"]]).reshape(-1, 2)
    if len(asked):
        axes.plot(*asked.T, "o", color=CURVE, mfc="white", markersize=9, markeredgewidth=2, label="requested")
    for row in limits(rows):
        pressure = f"{row['pressure_cm']:.4g} cm ({row['pressure_Pa'] / 1e3:.4g} kPa)"
        label = f"limit point: {pressure}, {row['apex_mm']:.4g} mm"
        axes.plot(row["pressure_cm"], row["apex_mm"], "D", color=WARNING, markersize=9, label=label)
    axes.set(xlabel="pressure in cm of water", ylabel="apex rise in mm")
    axes.margins(0.04)
    k = pascal_per_cm / 1e3
    convert: Any = (lambda column: column * k, lambda pressure: pressure / k)
    axes.secondary_xaxis("top", functions=convert).set_xlabel("pressure in kPa", labelpad=8)
    axes.legend(loc="lower right")
    return figure


def limits(rows: Sequence[Row]) -> list[Row]:
    """The rows that are limit points of the pressure."""
    return [row for row in rows if row["limit"]]


def smooth(path: Array, count: int = 400) -> Array:
    """A curve through points of a plane that keeps their turning points, shape (n, 2) to (count, 2).

    Cubic pieces, monotone between neighbours in both directions (Fritsch and Butland), so that the curve neither
    overshoots nor shows a limit that is not there.
    """
    scale = np.ptp(path, axis=0)
    lengths = np.linalg.norm(np.diff(path, axis=0) / np.where(scale > 0, scale, 1.0), axis=1)
    if np.count_nonzero(lengths) < 2:
        return path
    path = path[np.concatenate([[True], lengths > 0])]
    h = lengths[lengths > 0][:, None]
    secants = np.diff(path, axis=0) / h
    before, after = secants[:-1], secants[1:]
    apart = (before * after <= 0) | (before == 0)
    near, far = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
    inner = np.where(apart, 0.0, (near + far) * before * after / np.where(apart, 1.0, near * after + far * before))
    slopes = np.concatenate([secants[:1], inner, secants[-1:]])
    along = np.concatenate([[0.0], np.cumsum(h)])
    places = np.linspace(0.0, along[-1], count)
    k = np.clip(np.searchsorted(along, places) - 1, 0, len(h) - 1)
    t = ((places - along[k]) / h[k, 0])[:, None]
    ends = path[k] * (1 + 2 * t) * (1 - t) ** 2 + path[k + 1] * t**2 * (3 - 2 * t)
    return ends + h[k] * (slopes[k] * t * (1 - t) ** 2 + slopes[k + 1] * t**2 * (t - 1))


# -- profiles ---------------------------------------------------------------------------------------------------------


def profile(points: Array, displacement: Array, actuator: Actuator) -> Array:
    """The outline that a camera sees from the side, from the axis outwards.

    Args:
        points: Undeformed nodes in device coordinates, m, shape (n, 3).
        displacement: In m, shape (n, 3).
        actuator: The device; tells which nodes lie on the outline.

    Returns:
        Distance from the axis and height, both deformed and in m, shape (k, 2), sorted by the undeformed distance.
    """
    here = actuator.on_profile(points)
    start, moved = points[here], displacement[here]
    radius = np.hypot(start[:, 0], start[:, 1])
    order = np.argsort(radius)
    along = start[order[-1], :2] / radius[order[-1]]
    return np.column_stack([radius + moved[:, :2] @ along, start[:, 2] + moved[:, 2]])[order]


def profile_steps(rows: Sequence[Row]) -> list[int]:
    """Which steps the profile shows beside the undeformed line: the requested ones, limit points and the last.

    If few were requested, up to eight steps stand evenly in the rise of the apex as well.
    """
    loaded = [k for k, row in enumerate(rows) if row["pressure_Pa"] or row["added_volume_ml"]]
    if not loaded:
        return []
    shown = {k for k in loaded if rows[k]["requested"] or rows[k]["limit"]} | {loaded[-1]}
    if sum(bool(rows[k]["requested"]) for k in loaded) <= FEW:
        rise = np.array([rows[k]["apex_mm"] for k in loaded])
        wanted = np.linspace(0.0, rise.max(), 9)[1:]
        shown |= {loaded[int(np.argmin(np.abs(rise - value)))] for value in wanted}
    return sorted(shown)


def profiles(lines: Mapping[int, Array], rest: Array, rows: Sequence[Row]) -> Figure:
    """The membrane's outer surface, seen from the side.

    Args:
        lines: Outlines from `profile` by number of the step.
        rest: The undeformed outline.
        rows: All rows of ``path.csv``.
    """
    everything = np.concatenate([rest, *lines.values()]) * 1e3
    reach, low, high = everything[:, 0].max() * 1.04, everything[:, 1].min(), everything[:, 1].max()
    tall = max(high - low, 0.5 * reach) * 1.16
    bottom = low - 0.08 * tall
    # The legend stands beside the axes, never on a line.
    inner = 7.1
    height = inner * tall / (2 * reach)
    names = _labelled(list(lines))
    whole = max(height + 1.25, 0.27 * (len(names) + 2) + 0.6)
    figure = Figure((WIDTH, whole), dpi=DPI)
    axes = figure.add_axes((0.85 / WIDTH, (whole - height + 0.25) / 2 / whole, inner / WIDTH, height / whole))
    axes.set(xlim=(-reach, reach), ylim=(bottom, bottom + 2 * reach * height / inner), aspect="equal")
    axes.plot(*_both_sides(rest).T, "--", color=EDGE, linewidth=1.4, label="undeformed")
    colours = matplotlib.colormaps[LINES](np.linspace(0.9, 0.0, max(len(lines), 2)))
    turned = min((k for k, row in enumerate(rows) if row["limit"]), default=len(rows))
    for colour, (step, line) in zip(colours, lines.items(), strict=False):
        place = "\n(limit point)" if step == turned else "\n(past the limit)" if step > turned else ""
        label = f"{number(rows[step]['pressure_cm'])} cm{place}" if step in names else None
        axes.plot(*_both_sides(line).T, color=colour, label=label)
    axes.set(xlabel="distance from the axis in mm", ylabel="height in mm")
    axes.set_title("Outer surface of the membrane")
    axes.legend(title="water column", loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, alignment="left")
    return figure


def _labelled(steps: list[int]) -> set[int]:
    """The steps that get a line in the legend: all, or evenly chosen ones with the last among them."""
    every = -(-len(steps) // LEGEND_LINES) or 1
    return set(steps[::-1][::every])


def _both_sides(line: Array) -> Array:
    """An outline in mm over both sides, between its nodes as the second-order cells have it; (k, 2) m to (m, 2) mm."""
    fine = line
    if len(line) % 2 and len(line) >= 3:  # corners and mid-edge nodes in turn
        fine = _along(np.stack([line[:-2:2], line[2::2], line[1:-1:2]], axis=1), 8).reshape(-1, 2)
    return np.concatenate([fine[::-1] * (-1.0, 1.0), fine]) * 1e3
