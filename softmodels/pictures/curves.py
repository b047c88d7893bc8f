"""Plots over the path: rise, added volume and forces. No rendering needed."""

from __future__ import annotations

import io
import itertools
import math
import textwrap
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from geometries import Actuator
from softmodels.common import pages, units
from softmodels.common.arrays import Array
from softmodels.materials import silicones
from softmodels.pictures import style
from softmodels.runs import budget, columns, grid, labels, mesh_error, notes, states, table
from softmodels.runs.states import Line, StoredStates

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import XAxis, YAxis
    from matplotlib.backend_bases import RendererBase
    from matplotlib.typing import ColorType

    from softmodels.case.case import Case


PRESSURE = "pressure"
"""Default abscissa of the plots."""


def curves(
    rows: table.PathTable,
    words: labels.StateLabels,
    branch: table.PathTable | None = None,
    over: tuple[str, str] = (PRESSURE, f"pressure in {units.COLUMN.unit}"),
    sources: columns.SourceTables = MappingProxyType({}),
) -> list[Figure]:
    """Plot the gauge's rise, the added volume and the blocked force, if any, over the pressure.

    Of weights and forces also what they move. With a supply also the pressure over its stroke, first. ``words`` is what the run
    shows, the other arguments are as of `rise`. One figure each, so that a narrow page puts them below each other.
    """
    wanted = [
        (over, (words.gauge, f"rise of the {words.gauge} in mm")),
        *([(over, ("added_volume", "added volume in ml"))] if words.volume else []),
    ]
    wanted += [(over, (name, f"{columns.term(rows[0].column(name)).name} in N")) for name in FORCES if name in rows]
    wanted += [(over, (name, str(columns.term(rows[0].column(name))))) for name in words.moved]
    if "stroke" in rows:
        wanted.insert(0, (("stroke", f"stroke of the {words.driver} in ml"), _pressure(words)))
    figures = []
    for (place, below), (variable, label) in wanted:
        figure, axes = style.chart(4.2, style.WIDTH_INCHES / 2)
        _sources(axes, sources, rows, variable, place)
        _path(axes, rows, variable, branch, place, words.fitted)
        for name, colour, marker, events in _events(rows):
            axes.plot(events.shown(place), events.shown(variable), marker, color=colour, markersize=8, label=name)
        axes.set(xlabel=below, ylabel=label)
        axes.legend(loc="best")
        figures.append(figure)
    return figures


FORCES = ("contact_force", "blocked_force")
"""Variables plotted separately if the device is in contact."""
DASHES = ("--", ":", "-.", (0, (10, 3)), (0, (1, 4)))
"""Line styles of the sources."""
MOST_CYCLES = 6
"""Number of cycles up to which each is in the legend; of more only the first and the last."""


def _pressure(words: labels.StateLabels) -> tuple[str, str]:
    """Return the default abscissa: the variable and its label."""
    return PRESSURE, f"pressure in {words.unit}"


def over_of(case: Case) -> tuple[str, str]:
    """Return the abscissa of a case's plots: the variable and its label; the pressure unless a dead load is requested."""
    if case.load.driven is None:
        return _pressure(labels.state_labels(case))
    load = case.load.driven_part
    column = next(name for name in (*load.named_columns, load.share_column) if table.parsed(name)[0] == case.variable)
    return case.variable, str(columns.term(column))


def rise_of(states: StoredStates) -> Figure:
    """Plot the rise of the gauge of stored states over their load; see `rise`."""
    return rise(states.rows, states.words, states.case.column, states.branch, over_of(states.case), states.sources)


def rise(
    rows: table.PathTable,
    words: labels.StateLabels,
    column: units.Column,
    branch: table.PathTable | None = None,
    over: tuple[str, str] = (PRESSURE, f"pressure in {units.COLUMN.unit}"),
    sources: columns.SourceTables = MappingProxyType({}),
) -> Figure:
    """Plot the rise of the device's `Actuator.gauge`, such as the disk's apex, over the pressure or else (see `over_of`), of
    all states, of the branch that was followed, if one was, and of each source of the silicone where they were
    solved."""
    gauge = words.gauge
    figure, axes = style.chart(6.4)

    def place(row: table.Row) -> str:
        kilopascals = f" ({row['pressure'] / 1e3:.4g} kPa)" if over[0] == PRESSURE else ""
        return f"{row.told(over[0])}{kilopascals}, {row.told(gauge)}"

    _sources(axes, sources, rows, gauge, over[0])
    _path(axes, rows, gauge, branch, over[0], words.fitted)
    for name, colour, marker, events in _events(rows):
        for row in events:
            label = f"{name}: {place(row)}"
            axes.plot(row.shown(over[0]), row.shown(gauge), marker, color=colour, markersize=9, label=label)
    axes.set(xlabel=over[1], ylabel=f"rise of the {gauge} in mm")
    axes.margins(0.04)
    if over[0] == PRESSURE:
        kilopascals(axes, column)
    axes.legend(loc="best")
    return figure


def kilopascals(axes: Axes, column: units.Column) -> None:
    """Add a second scale in kPa above heights of a column."""
    k = column.pascal / 1e3
    functions = (lambda height: np.asarray(height) * k, lambda kPa: np.asarray(kPa) / k)
    axes.secondary_xaxis("top", functions=functions).set_xlabel("pressure in kPa", labelpad=8)


def contributions(row: table.Row, name: str, told: Sequence[budget.Contribution]) -> Figure:
    """Plot the contributions to half the 95 % interval of a variable as bars, the largest on top."""
    shown = told[::-1]
    figure, axes = style.chart(1.0 + 0.35 * len(shown))
    halves = [mesh_error.in_unit(row, name, part.half) for part in shown]
    bars = axes.barh([part.text for part in shown], halves, color=style.CURVE)
    axes.bar_label(bars, [f"{half:.2g}" for half in halves], padding=3)
    axes.set_xlabel(f"half of the 95 % interval in {row.unit(name)}")
    axes.margins(x=0.12)
    return figure


def drawing(figure: Figure, column: units.Column) -> str:
    """Return a figure for a page, marked as HTML, with axes for each unit of pressure that the page can have; those of the
    figure are heights of the column, as their labels say."""
    stream = io.StringIO()
    with matplotlib.rc_context({**style.STYLE, "svg.hashsalt": "softmodels"}):
        for axes in figure.axes:
            for axis in (axes.xaxis, axes.yaxis):
                if column.unit in axis.label.get_text():
                    axis.set_gid(f"pu-{pages.HEIGHT}")
                    axes.add_artist(_OtherUnits(axis, column))
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    return pages.inline_svg(stream.getvalue())


class _OtherUnits(Artist):
    """An axis of pressure drawn again for each other unit, one over the other; the page shows one of them."""

    def __init__(self, axis: XAxis | YAxis, column: units.Column):
        super().__init__()
        self._axis, self._column = axis, column
        self.set_zorder(axis.get_zorder())
        self.set_in_layout(False)

    def draw(self, renderer: RendererBase) -> None:
        axis, label, (low, high) = self._axis, self._axis.label.get_text(), self._axis.get_view_interval()
        shares = {unit: self._column.pascal / pages.pascal(unit) for unit in pages.UNITS}
        for unit, share in {**shares, pages.HEIGHT: 1.0}.items():
            axis.set_view_interval(share * low, share * high, ignore=True)
            axis.set_label_text(label.replace(self._column.unit, unit) if unit in pages.UNITS else label)
            axis.set_gid(f"pu-{unit}")
            if unit in pages.UNITS:  # the figure draws its own
                axis.draw(renderer)


def along_line(line: Line, title: str) -> Figure:
    """Plot the stresses along a line through the body over the distance from its beginning."""
    figure, axes = style.chart(6.0)
    distance = line.distance * 1e3
    axes.plot(distance, line["von_mises"] / 1e3, color=style.INK, label="von Mises stress")
    for k, (stress, stroke) in enumerate(zip(line["principal_stresses"].T, ("-", "--", ":"), strict=True), 1):
        axes.plot(distance, stress / 1e3, stroke, color=style.CURVE, label=f"principal stress {k}")
    axes.plot(distance, line.normal_stress / 1e3, "-.", color=style.WARNING, label="normal stress along the line")
    begin, end = (states.told(place) for place in line.points[[0, -1]])
    axes.set(xlabel=f"undeformed distance in mm, from {begin} to {end}", ylabel="Cauchy stress in kPa")
    axes.set_title(title, fontsize=11)
    axes.axhline(0.0, color=style.FAINT, linewidth=0.8)
    axes.legend(loc="best")
    return figure


def _events(rows: table.PathTable) -> list[tuple[str, str, str, table.PathTable]]:
    """Return the events of a path that occur: name, colour, marker and states."""
    kinds = (("limit point", style.WARNING, "D", limits(rows)), ("bifurcation", style.BRANCH, "s", rows.where("bifurcation")))
    return [kind for kind in kinds if kind[3]]


def _path(
    axes: Axes, rows: table.PathTable, variable: str, branch: table.PathTable | None, over: str, fitted: float = math.inf
) -> None:
    """Plot curve, steps, requested values and snap-throughs of a path over the variable ``over``, and its branch; dashed where
    the silicone is stretched beyond ``fitted``."""
    places = np.column_stack([rows.shown(over), rows.shown(variable)])
    jumps = np.flatnonzero(rows.get("jump")).tolist()
    held = np.ones(len(rows), dtype=bool)
    held[notes.jumped_over(rows)] = False
    # States skipped by a supply's snap-through are on the path too.
    parts = np.split(np.column_stack([places, rows.get("max_stretch")]), [k for k in jumps if held[k - 1]])
    lines = [smooth(part).T for part in parts]
    for dashes, shown, label in (
        ("-", lambda stretch: stretch <= fitted, "simulated path"),
        ("--", lambda stretch: stretch > fitted, f"beyond the fitted stretch, {fitted:.3g}"),
    ):
        for k, (x, y, stretch) in enumerate(line for line in lines if shown(line[2]).any()):
            axes.plot(x, np.where(shown(stretch), y, np.nan), dashes, color=style.CURVE, label="" if k else label)
    axes.plot(*places[held].T, "o", color=style.CURVE, markersize=3.5, label="steps")
    if not held.all():
        axes.plot(*places[~held].T, "x", color=style.WARNING, markersize=6, label="steps skipped by snap-through")
    _band(axes, rows, variable, over)
    asked = places[rows["requested"] != 0]
    if len(asked):
        axes.plot(*asked.T, "o", color=style.CURVE, mfc="white", markersize=8, markeredgewidth=2, label="requested")
    for k in jumps:
        start, end = places[:k][held[:k]][-1], places[k]
        axes.plot(*np.array([start, end]).T, ":", color=style.WARNING, label="" if k > jumps[0] else "jump")
        way = {"arrowstyle": "-|>", "color": style.WARNING, "mutation_scale": 16}
        axes.annotate("", 0.45 * start + 0.55 * end, 0.55 * start + 0.45 * end, arrowprops=way)
    if branch and over in branch:
        whole = table.PathTable([rows.where("bifurcation")[0], *branch])
        aside = np.column_stack([whole.shown(over), whole.shown(variable)])
        axes.plot(*smooth(aside).T, "--", color=style.BRANCH, label="branch")


def _sources(axes: Axes, sources: columns.SourceTables, rows: table.PathTable, variable: str, over: str) -> None:
    """Plot the paths of the other sources of a silicone, and the band they span: areas between neighbours, as far as
    both extend."""
    if not sources:
        return
    paths = {name: np.column_stack([many.shown(over), many.shown(variable)]) for name, many in sources.items()}
    lines = {name: smooth(path) for name, path in paths.items() if len(path) > 1}
    for k, pair in enumerate(itertools.pairwise(lines.values())):
        farthest = min(line[:, 0].max() for line in pair)
        soft, stiff = (line[line[:, 0] <= farthest] for line in pair)
        label = "" if k else f"band of the {len(lines)} sources of {silicones.product_of(next(iter(lines)))}"
        axes.fill(*np.vstack([soft, stiff[::-1]]).T, color=style.SPAN, linewidth=0, zorder=0.5, label=label)
    others = [name for name in lines if sources[name] != rows]
    for name, dashes in zip(others, itertools.cycle(DASHES), strict=False):
        axes.plot(*lines[name].T, linestyle=dashes, color=style.FAINT, linewidth=1.2, label=columns.key_of(name), zorder=1.5)


def _band(axes: Axes, rows: table.PathTable, variable: str, over: str) -> None:
    """Plot the 95 % band of the pressure from the material's errors at equal values of the variable, regular at limit
    points: at the same rise, or at the same added volume."""
    half = table.band_of(PRESSURE) if variable == "added_volume" else table.at_rise(variable)
    if over != PRESSURE or half not in rows:
        return
    band = np.column_stack([rows.shown(over), rows.shown(variable), rows.shown(half)])
    band = band[~np.isnan(band[:, 2])]
    if len(band) < 2:
        return
    x, y = smooth(band[:, :2]).T
    width = np.interp(y, *smooth(band[:, 1:]).T) if (np.diff(band[:, 1]) > 0).all() else None
    x, y, width = (x, y, width) if width is not None else band.T
    label = f"95 % band of the pressure at equal {'volume' if variable == 'added_volume' else 'rise'}"
    axes.fill_betweenx(y, x - width, x + width, color=style.CURVE, alpha=0.18, linewidth=0, label=label)


def limits(rows: table.PathTable) -> table.PathTable:
    """Return the states that are limit points of the pressure."""
    return rows.where("limit")


def smooth(path: Array, count: int = 400) -> Array:
    """Return a smooth curve through points of a plane that preserves their extrema, shape (n, 2) to (count, 2).

    Cubic pieces, monotone between neighbours in both directions (Fritsch and Butland), so that the curve neither
    overshoots nor shows a limit that is not there. SciPy's `PchipInterpolator` takes longer to import than to draw a run.
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


# ----------------------------------------------------------------------------------------------------------------------
# Plots of a program: loads of each cavity and response of the device, over the program's steps.


SUPPLY_LABELS = {"source_pressure": "source pressure\nin {}", "flow": "flow in\nml/min"}
"""Variables of a supply in time, with their labels."""


def steps(rows: table.PathTable, words: labels.StateLabels) -> Figure:
    """Plot the gauge's rise, the cavities' pressures, their added volumes and the loads over the steps, in panels."""
    panels = [
        ([words.gauge], f"{words.gauge} rise in mm"),
        (words.pressures(rows[0]), f"pressure in\n{words.unit}"),
        (words.volumes(rows[0]), "added volume\nin ml"),
        *(
            ([name], label.format(words.unit))
            for name, label in SUPPLY_LABELS.items()
            if not np.isnan(rows[0].get(name, np.nan))
        ),
        *(([name], str(columns.term(rows[0].column(name)))) for name in words.loads),
        *([(["kinetic_energy"], "kinetic energy\nin mJ")] if "kinetic_energy" in rows else []),
    ]
    panels = [panel for panel in panels if panel[0]]
    figure = Figure((style.WIDTH_INCHES, 7.6 + 1.8 * (len(panels) - 3)), dpi=style.DPI, layout="constrained")
    places = figure.subplots(len(panels), 1, sharex=True, height_ratios=(1.4, *(1.0 for _ in panels[1:])))
    timed = "time" in rows
    along = "time" if timed else "load_step"
    passed_rows, asked = rows[along], rows["requested"] != 0
    for axes, (variables, label) in zip(places, panels, strict=True):
        count = len(variables)
        for k, (name, colour) in enumerate(zip(variables, itertools.cycle(style.LINE_COLOURS), strict=False), 1):
            values = rows.shown(name)
            cavity = f"cavity{k}" if count > 1 else None
            axes.plot(passed_rows, values, _line_style(rows), color=colour, markersize=3.5, label=cavity)
            axes.plot(passed_rows[asked], values[asked], "o", color=colour, mfc="white", markersize=8, markeredgewidth=2)
            if table.band_of(name) in rows:
                half = rows.shown(table.band_of(name))
                axes.fill_between(passed_rows, values - half, values + half, color=colour, alpha=0.18, linewidth=0)
            for row in limits(rows):
                axes.plot(row[along], row.shown(name), "D", color=style.WARNING, markersize=8)
        axes.set(ylabel=label)
        axes.margins(0.03, 0.08)
        if count > 1:
            axes.legend(loc="best")
    what = "time in s" if timed else "step of the program"
    areas = "; areas are the 95 % band of the material" if table.band_of(words.gauge) in rows else ""
    places[-1].set(xlabel=f"{what} (circles are requested; a diamond is a limit point{areas})")
    if not timed:
        places[-1].xaxis.get_major_locator().set_params(integer=True)
    return figure


MOST_MARKED = 150
"""Number of states up to which each has a marker."""


def _line_style(rows: table.PathTable) -> str:
    return "o-" if len(rows) <= MOST_MARKED else "-"


def loop(rows: table.PathTable, words: labels.StateLabels) -> Figure:
    """Plot the pressure over the added volume and over the gauge's rise in each cycle of a load with times, with the areas of
    the loops."""
    loops = notes.cycles(rows)
    figure = Figure((style.WIDTH_INCHES, 5.4), dpi=style.DPI, layout="constrained")
    places = figure.subplots(1, 2, sharey=True)
    for count, (cycle, colour) in enumerate(zip(loops, style.shades(len(loops)), strict=True), 1):
        label = f"cycle {count}: loses {cycle.loss}" if cycle.closed else f"cycle {count}, not closed"
        marker, wide = {1: ("o", 2.0), len(loops): ("s", 2.0)}.get(count, ("", 0.9))
        shown = label if marker or len(loops) <= MOST_CYCLES else None
        for axes, name in zip(places, ("added_volume", words.gauge), strict=True):
            x, y = (cycle.rows.shown(variable) for variable in (name, PRESSURE))
            axes.plot(x, y, "-", marker=marker, color=colour, linewidth=wide, markersize=4.0, label=shown)
    places[0].set(xlabel="added volume in ml", ylabel=_pressure(words)[1])
    places[1].set(xlabel=f"rise of the {words.gauge} in mm")
    figure.legend(*places[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


# ----------------------------------------------------------------------------------------------------------------------
# Plots of the device's outline at each pressure, from the side or in a section. No rendering needed.


MAX_FEW_VALUES = 2
"""Number of requested values up to which the profile also shows steps in between."""
LEGEND_LINES = 12


def profile(points: Array, displacement: Array, actuator: Actuator) -> Array:
    """Return the outline from the side, from the axis or the clamped base outwards: distance from the axis and height, both
    deformed and in m, shape (k, 2), in order along the undeformed outline. Undeformed nodes in device coordinates and their
    displacement are in m, shape (n, 3)."""
    here = actuator.on_profile(points)
    start, moved = points[here], displacement[here]
    radius = np.hypot(start[:, 0], start[:, 1])
    order = np.argsort(actuator.along_profile(start))
    along = start[radius.argmax(), :2] / radius.max()
    return np.column_stack([radius + moved[:, :2] @ along, start[:, 2] + moved[:, 2]])[order]


def profile_steps(rows: table.PathTable, words: labels.StateLabels) -> list[float]:
    """Return the steps of the profile besides the undeformed line: the requested ones, limit points and the last.

    If few were requested, up to eight round pressures as well (see `round_steps`), or steps evenly in the gauge's rise.
    """
    loaded = [k for k, row in enumerate(rows) if words.loaded(row)]
    if not loaded:
        return []
    shown: set[float] = {k for k in loaded if rows[k]["requested"] or rows[k]["limit"]} | {loaded[-1]}
    if sum(bool(rows[k]["requested"]) for k in loaded) > MAX_FEW_VALUES:
        return sorted(shown)
    if even := states.round_steps(rows, PRESSURE, 8) if words.pressure and "load_step" not in rows else []:
        shown |= set(even)
    else:
        risen = rows[words.gauge][loaded]
        wanted = np.linspace(0.0, risen[np.abs(risen).argmax()], 9)[1:]
        shown |= {loaded[int(np.argmin(np.abs(risen - value)))] for value in wanted}
    return sorted(shown)


def cut_profiles(
    lines: Mapping[float, Array],
    rest: Array,
    path: tuple[table.PathTable, labels.StateLabels],
    axes_of_plane: Array,
    plane: str,
) -> Figure:
    """Plot the section of the outer surface by a plane at rest, seen along its normal: pieces (k, 2, 3) in m by number of the
    step, as `softmodels.runs.states.cut_line` gives them, and the undeformed ones, along unit vectors to the right and
    upwards, shape (2, 3)."""
    flat = np.concatenate([rest, *lines.values()]).reshape(-1, 3) @ axes_of_plane.T
    wide, tall = np.ptp(flat, axis=0)
    figure, axes = style.chart(min(max(0.72 * style.WIDTH_INCHES * tall / wide + 1.4, 3.5), style.WIDTH_INCHES))
    names = _labels(*path, _labelled_steps(list(lines)))
    drawn: list[tuple[Array, ColorType, float, str, str | None]] = [(rest, style.EDGE, 1.4, ":", "undeformed")]
    coloured = zip(style.shades(len(lines)), lines.items(), strict=True)
    drawn += [(line, colour, 2.0, "-", names.get(step)) for colour, (step, line) in coloured]
    for pieces, colour, width, stroke, label in drawn:
        flat = 1e3 * pieces @ axes_of_plane.T
        axes.add_collection(LineCollection(list(flat), colors=[colour], linewidths=width, linestyles=stroke))
        axes.plot([], [], stroke, color=colour, linewidth=width, label=label)
    axes.autoscale()
    axes.set_aspect("equal")
    axes.margins(0.05)
    axes.set(xlabel=f"{_direction(axes_of_plane[0])} in mm", ylabel=f"{_direction(axes_of_plane[1])} in mm")
    axes.set_title(f"Section of the outer surface by the plane {plane} (undeformed)")
    _legend_beside(axes, path[1])
    return figure


def _direction(axis: Array) -> str:
    """Return a direction in words: x, y, z, or the vector."""
    near = int(np.argmax(np.abs(axis)))
    return "xyz"[near] if abs(axis[near]) > 1 - 1e-9 else f"along ({', '.join(f'{value:.3g}' for value in axis)})"


MAX_AXES_INCHES = 8.0
"""Largest height of a profile's axes in inches."""


def profiles(
    lines: Mapping[float, Array],
    rest: Array,
    path: tuple[table.PathTable, labels.StateLabels],
    axial: bool = True,
    plate: float | None = None,
) -> Figure:
    """Plot the line on the outer surface that a camera sees from the side: outlines from `profile` by number of the step, and
    the undeformed one. Of an ``axial`` device the outline goes on beyond the axis. ``plate`` is the height in m of a rigid
    plane that stops the device."""
    everything = np.concatenate([rest, *lines.values()]) * 1e3
    heights = everything[:, 1] if plate is None else np.append(everything[:, 1], 1e3 * plate)
    right, low, high = everything[:, 0].max(), heights.min(), heights.max()
    left, right = (-1.04 * right, 1.04 * right) if axial else (everything[:, 0].min() - 0.04 * right, 1.04 * right)
    tall = max(high - low, 0.25 * (right - left)) * 1.16
    bottom = low - 0.08 * tall
    # The legend is beside the axes, so that it hides no line.
    inner = min(7.1, MAX_AXES_INCHES * (right - left) / tall)
    height = inner * tall / (right - left)
    names = _labels(*path, _labelled_steps(list(lines)))
    whole = max(height + 1.25, 0.24 * sum(1.3 + name.count("\n") for name in names.values()) + 1.1)
    figure = Figure((style.WIDTH_INCHES, whole), dpi=style.DPI)
    axes = figure.add_axes(
        (0.85 / style.WIDTH_INCHES, (whole - height + 0.25) / 2 / whole, inner / style.WIDTH_INCHES, height / whole)
    )
    axes.set(xlim=(left, right), ylim=(bottom, bottom + (right - left) * height / inner), aspect="equal")
    axes.plot(*_outline(rest, axial).T, "--", color=style.EDGE, linewidth=1.4, label="undeformed")
    for colour, (step, line) in zip(style.shades(len(lines)), lines.items(), strict=True):
        axes.plot(*_outline(line, axial).T, color=colour, label=names.get(step))
    if plate is not None:
        axes.axhline(plate * 1e3, color=style.WARNING, linewidth=1.5, linestyle="--", label="rigid plane")
    axes.set(xlabel=f"distance from the {'axis' if axial else 'clamped base'} in mm", ylabel="height in mm")
    axes.set_title("Outer surface, from the side" if axial else "Outline in the middle, from the side")
    _legend_beside(axes, path[1])
    return figure


def _legend_beside(axes: Axes, words: labels.StateLabels) -> None:
    """A legend to the right of the axes, on no line."""
    title = f"column of\n{words.unit.partition(', ')[2]}" if words.pressure else "load"
    axes.legend(title=title, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, alignment="left")


def _labels(rows: table.PathTable, words: labels.StateLabels, steps: Collection[float]) -> dict[float, str]:
    """Return the legend entries of some steps: load, and part of the path."""
    places, texts = branches(rows, words), dict[float, str]()
    for step in steps:
        row, part = states.row_at(rows, step), places[math.ceil(step)]
        name = f"{labels.number(row.shown(PRESSURE))} cm" if words.pressure else textwrap.fill(words.place(row), 19)
        texts[step] = name + ("\n" + textwrap.fill(f"({part})", 19) if part else "")
    return texts


def branches(rows: table.PathTable, words: labels.StateLabels) -> list[str]:
    """Return the part of the path of each state, in words for a legend; empty for the first part.

    Where the device jumps, the way of the load counts too: up, and down after the highest one. A state past a limit
    point that stands under its pressure again is on another part of the path, not past the limit.
    """
    over, (raised, moved) = set(notes.jumped_over(rows)), words.along
    landings = np.flatnonzero(rows.get("jump")).tolist()
    before = [row[moved] for k, row in enumerate(rows[: landings[0] if landings else 0]) if k not in over]
    largest_before = max(before, default=0.0)
    highest = int(rows[raised].argmax())
    branches, passed = [], False
    for k, row in enumerate(rows):
        part = ["up" if k <= highest else "down"] if landings and not over else []
        if k in over:
            part.append("jumped over")
        elif row["limit"]:
            part.append("limit point")
        elif landings and k >= landings[0]:
            part += ["after snap-through"] if row[moved] > largest_before else []
        elif passed:
            part.append("stable again" if row.get("stable_under_pressure") else "past the limit point")
        branches.append(", ".join(part))
        passed = passed or bool(row["limit"])
    return branches


def _labelled_steps(steps: list[float]) -> set[float]:
    """Return the steps that get a line in the legend: all, or evenly chosen ones with the last among them."""
    every = -(-len(steps) // LEGEND_LINES) or 1
    return set(steps[::-1][::every])


def _outline(line: Array, axial: bool) -> Array:
    """Return an outline in mm, on both sides of an axis, between nodes as second-order cells have it; (k, 2) m to (m, 2) mm."""
    fine = line
    if len(line) % 2 and len(line) >= 3:  # corners and mid-edge nodes in turn
        fine = grid.parabolas(np.stack([line[:-2:2], line[2::2], line[1:-1:2]], axis=1), 8).reshape(-1, 2)
    return (np.concatenate([fine[::-1] * (-1.0, 1.0), fine]) if axial else fine) * 1e3
