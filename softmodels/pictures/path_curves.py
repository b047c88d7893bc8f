"""Curves over the path: rise, added volume and forces. They need no rendering."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from softmodels.materials.spread import product_of
from softmodels.pictures.style import BRANCH, CURVE, DPI, FAINT, SPAN, WARNING, WIDTH, Array
from softmodels.results.columns import term
from softmodels.results.row import Row
from softmodels.results.sources import SourceRows, key_of
from softmodels.results.stability_report import jumped_over
from softmodels.results.state_words import StateWords
from softmodels.results.terms import at_rise, split

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from softmodels.case.case import Case

FORCES = ("contact_force_N", "blocked_force_N")
"""Columns that get a curve of their own where a device presses on something."""
DASHES = ("--", ":", "-.", (0, (10, 3)), (0, (1, 4)))
"""Of the sources' lines."""
PRESSURE = ("pressure_cm", "pressure in cm of water")
"""What curves are drawn over unless a case asks for something else: the column, and its words."""


def over_of(case: Case) -> tuple[str, str]:
    """What a case's curves are drawn over: the column, and its words; the pressure unless a dead load is asked for."""
    if case.driven is None:
        return PRESSURE
    return case.column, str(term(case.column))


def rise(
    rows: Sequence[Row],
    gauge: str,
    pascal_per_cm: float,
    branch: Sequence[Row] = (),
    over: tuple[str, str] = PRESSURE,
    sources: SourceRows = MappingProxyType({}),
) -> Figure:
    """Rise of the device's gauge, such as the disk's apex, over the pressure.

    Args:
        rows: All rows of ``path.csv``.
        gauge: The device's `Actuator.gauge`.
        pascal_per_cm: Pa in one cm of the column.
        branch: Rows of the branch that was followed, if one was.
        over: What it is drawn over; see `over_of`.
        sources: Rows under each source of the silicone, the run's own among them, where they were solved.
    """
    figure = Figure((WIDTH, 6.4), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    column = f"{gauge}_mm"
    _sources(axes, sources, rows, column, over[0])
    _path(axes, rows, column, branch, over[0])
    for name, colour, marker, events in _events(rows):
        for row in events:
            at = f"{row['pressure_cm']:.4g} cm ({row['pressure_Pa'] / 1e3:.4g} kPa)"
            at = at if over == PRESSURE else f"{row[over[0]]:.4g} {split(over[0])[1]}"
            label = f"{name}: {at}, {row[column]:.4g} mm"
            axes.plot(row[over[0]], row[column], marker, color=colour, markersize=9, label=label)
    axes.set(xlabel=over[1], ylabel=f"rise of the {gauge} in mm")
    axes.margins(0.04)
    if over == PRESSURE:
        kilopascals(axes, pascal_per_cm)
    axes.legend(loc="best")
    return figure


def kilopascals(axes: Axes, pascal_per_cm: float) -> None:
    """A second scale above a pressure in cm of water; ``pascal_per_cm`` is Pa in one of them."""
    k = pascal_per_cm / 1e3

    def in_kPa(column: npt.ArrayLike) -> Array:
        return np.asarray(column) * k

    def in_cm(pressure: npt.ArrayLike) -> Array:
        return np.asarray(pressure) / k

    axes.secondary_xaxis("top", functions=(in_kPa, in_cm)).set_xlabel("pressure in kPa", labelpad=8)


def curves(
    rows: Sequence[Row],
    words: StateWords,
    branch: Sequence[Row] = (),
    over: tuple[str, str] = PRESSURE,
    sources: SourceRows = MappingProxyType({}),
) -> list[Figure]:
    """The gauge's rise, the added volume and a force on what holds the device, if there is one, over the pressure.

    Of weights and forces also what they move. With a supply also the pressure over its stroke, first. ``words`` is what the run
    shows, the other arguments are as of `rise`. One figure each, so that a narrow page puts them below each other.
    """
    wanted = [
        (over, (f"{words.gauge}_mm", f"rise of the {words.gauge} in mm")),
        *([(over, ("added_volume_ml", "added volume in ml"))] if words.volume else []),
    ]
    wanted += [(over, (name, f"{term(name).name} in N")) for name in FORCES if name in rows[0]]
    loads = [name for name in rows[0] if re.fullmatch(r"(moved|turned)(_\w+)?_(mm|deg)|sag_mm", name)]
    wanted += [(over, (name, str(term(name)))) for name in loads]
    if "stroke_ml" in rows[0]:
        wanted.insert(0, (("stroke_ml", f"stroke of the {words.driver} in ml"), PRESSURE))
    figures = []
    for (place, below), (column, label) in wanted:
        figure = Figure((WIDTH / 2, 4.2), dpi=DPI, layout="constrained")
        axes = figure.subplots()
        _sources(axes, sources, rows, column, place)
        _path(axes, rows, column, branch, place)
        for name, colour, marker, events in _events(rows):
            places = [[row[key] for row in events] for key in (place, column)]
            axes.plot(*places, marker, color=colour, markersize=8, label=name)
        axes.set(xlabel=below, ylabel=label)
        axes.legend(loc="best")
        figures.append(figure)
    return figures


def _events(rows: Sequence[Row]) -> list[tuple[str, str, str, list[Row]]]:
    """What happens on a path: its name, colour and marker, and the rows where it does; only what there is."""
    kinds = (
        ("limit point", WARNING, "D", limits(rows)),
        ("bifurcation", BRANCH, "s", [row for row in rows if row.get("bifurcation")]),
    )
    return [kind for kind in kinds if kind[3]]


def _path(axes: Axes, rows: Sequence[Row], column: str, branch: Sequence[Row], over: str = "pressure_cm") -> None:
    """Curve, steps, requested values and jumps of a path over the column ``over``, and the branch that leaves it."""
    places = np.array([[row[over], row[column]] for row in rows])
    jumps = [k for k, row in enumerate(rows) if row.get("jump")]
    held = np.ones(len(rows), dtype=bool)
    held[jumped_over(rows)] = False
    # Of a supply's jump the states that are jumped over are on the path too.
    parts = np.split(places, [k for k in jumps if held[k - 1]])
    for k, part in enumerate(parts):
        axes.plot(*smooth(part).T, color=CURVE, label="" if k else "simulated path")
    axes.plot(*places[held].T, "o", color=CURVE, markersize=3.5, label="steps")
    if not held.all():
        axes.plot(*places[~held].T, "x", color=WARNING, markersize=6, label="steps the device jumps over")
    _band(axes, rows, column, over)
    asked = places[[bool(row["requested"]) for row in rows]]
    if len(asked):
        axes.plot(*asked.T, "o", color=CURVE, mfc="white", markersize=8, markeredgewidth=2, label="requested")
    for k in jumps:
        start, end = places[:k][held[:k]][-1], places[k]
        axes.plot(*np.array([start, end]).T, ":", color=WARNING, label="" if k > jumps[0] else "jump")
        way = {"arrowstyle": "-|>", "color": WARNING, "mutation_scale": 16}
        axes.annotate("", 0.45 * start + 0.55 * end, 0.55 * start + 0.45 * end, arrowprops=way)
    if branch and over in branch[0]:
        leaving = next(row for row in rows if row.get("bifurcation"))
        aside = np.array([[row[over], row[column]] for row in (leaving, *branch)])
        axes.plot(*smooth(aside).T, "--", color=BRANCH, label="branch")


def _sources(axes: Axes, sources: SourceRows, rows: Sequence[Row], column: str, over: str) -> None:
    """The paths under the other sources of a silicone, and what all of them span: the areas between neighbours, each as far as
    both go."""
    if not sources:
        return
    lines = {
        name: smooth(np.array([[row[over], row[column]] for row in many]))
        for name, many in sources.items()
        if len(many) > 1
    }
    for k, pair in enumerate(itertools.pairwise(lines.values())):
        farthest = min(line[:, 0].max() for line in pair)
        soft, stiff = (line[line[:, 0] <= farthest] for line in pair)
        label = "" if k else f"band of the {len(lines)} sources of {product_of(next(iter(lines)))}"
        axes.fill(*np.vstack([soft, stiff[::-1]]).T, color=SPAN, linewidth=0, zorder=0.5, label=label)
    others = [name for name in lines if list(sources[name]) != list(rows)]
    for name, dashes in zip(others, itertools.cycle(DASHES), strict=False):
        axes.plot(*lines[name].T, linestyle=dashes, color=FAINT, linewidth=1.2, label=key_of(name), zorder=1.5)


def _band(axes: Axes, rows: Sequence[Row], column: str, over: str) -> None:
    """The 95 % band that the material's errors make in the pressure at the same value of the column, which is regular at limit
    points: at the same rise, or at the same added volume."""
    half = "pressure_95_cm" if column == "added_volume_ml" else at_rise(split(column)[0])
    if over != "pressure_cm" or half not in rows[0]:
        return
    found = np.array([[row[over], row[column], row[half]] for row in rows])
    found = found[~np.isnan(found[:, 2])]
    if len(found) < 2:
        return
    x, y = smooth(found[:, :2]).T
    width = np.interp(y, *smooth(found[:, 1:]).T) if (np.diff(found[:, 1]) > 0).all() else None
    x, y, width = (x, y, width) if width is not None else found.T
    label = f"95 % band of the pressure at equal {'volume' if column == 'added_volume_ml' else 'rise'}"
    axes.fill_betweenx(y, x - width, x + width, color=CURVE, alpha=0.18, linewidth=0, label=label)


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
