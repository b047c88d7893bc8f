"""The device's outline at each pressure, from the side or where a plane cuts it. They need no rendering."""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from geometries import Actuator
from softmodels.pictures.style import DPI, EDGE, LINES, WARNING, WIDTH, Array, number
from softmodels.results.row import Row
from softmodels.results.stability_report import jumped_over
from softmodels.results.state_words import StateWords
from softmodels.results.triangles import parabolas

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.typing import ColorType

FEW = 2
"""Up to this many requested values, the profile shows steps in between as well."""
LEGEND_LINES = 12


def profile(points: Array, displacement: Array, actuator: Actuator) -> Array:
    """The outline that a camera sees from the side, from the axis or the clamped base outwards.

    Args:
        points: Undeformed nodes in device coordinates, m, shape (n, 3).
        displacement: In m, shape (n, 3).
        actuator: The device; tells which nodes lie on the outline.

    Returns:
        Distance from the axis and height, both deformed and in m, shape (k, 2), in order along the undeformed outline.
    """
    here = actuator.on_profile(points)
    start, moved = points[here], displacement[here]
    radius = np.hypot(start[:, 0], start[:, 1])
    order = np.argsort(actuator.along_profile(start))
    along = start[radius.argmax(), :2] / radius.max()
    return np.column_stack([radius + moved[:, :2] @ along, start[:, 2] + moved[:, 2]])[order]


def profile_steps(rows: Sequence[Row], words: StateWords) -> list[int]:
    """Which steps the profile shows beside the undeformed line: the requested ones, limit points and the last.

    If few were requested, up to eight steps stand evenly in the gauge's rise as well.
    """
    loaded = [k for k, row in enumerate(rows) if words.loaded(row)]
    if not loaded:
        return []
    shown = {k for k in loaded if rows[k]["requested"] or rows[k]["limit"]} | {loaded[-1]}
    if sum(bool(rows[k]["requested"]) for k in loaded) <= FEW:
        risen = np.array([rows[k][f"{words.gauge}_mm"] for k in loaded])
        wanted = np.linspace(0.0, risen[np.abs(risen).argmax()], 9)[1:]
        shown |= {loaded[int(np.argmin(np.abs(risen - value)))] for value in wanted}
    return sorted(shown)


def cut_profiles(
    lines: Mapping[int, Array], rest: Array, path: tuple[Sequence[Row], StateWords], axes_of_plane: Array, plane: str
) -> Figure:
    """The outside where a plane cuts it at rest, seen along the plane's normal.

    Args:
        lines: Pieces (k, 2, 3) in m by number of the step, as `softmodels.results.cut_lines.cut_line` gives them.
        rest: The undeformed ones.
        path: All rows of ``path.csv``, and what is shown of them.
        axes_of_plane: Unit vectors to the right and upwards, shape (2, 3).
        plane: The plane in words.
    """
    from matplotlib.collections import LineCollection

    flat = np.concatenate([rest, *lines.values()]).reshape(-1, 3) @ axes_of_plane.T
    wide, tall = np.ptp(flat, axis=0)
    figure = Figure((WIDTH, min(max(0.72 * WIDTH * tall / wide + 1.4, 3.5), WIDTH)), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    colours = matplotlib.colormaps[LINES](np.linspace(0.9, 0.0, max(len(lines), 2)))
    names = _labels(*path, _labelled(list(lines)))
    drawn: list[tuple[Array, ColorType, float, str, str | None]] = [(rest, EDGE, 1.4, ":", "undeformed")]
    drawn += [
        (line, colour, 2.0, "-", names.get(step)) for colour, (step, line) in zip(colours, lines.items(), strict=False)
    ]
    for pieces, colour, width, style, label in drawn:
        flat = 1e3 * pieces @ axes_of_plane.T
        axes.add_collection(LineCollection(list(flat), colors=[colour], linewidths=width, linestyles=style))
        axes.plot([], [], style, color=colour, linewidth=width, label=label)
    axes.autoscale()
    axes.set_aspect("equal")
    axes.margins(0.05)
    axes.set(xlabel=f"{_direction(axes_of_plane[0])} in mm", ylabel=f"{_direction(axes_of_plane[1])} in mm")
    axes.set_title(f"Outside where the plane {plane} cuts it at rest")
    _legend_beside(axes, path[1])
    return figure


def _direction(axis: Array) -> str:
    """A direction in words: x, y, z, or the vector."""
    near = int(np.argmax(np.abs(axis)))
    return "xyz"[near] if abs(axis[near]) > 1 - 1e-9 else f"along ({', '.join(f'{value:.3g}' for value in axis)})"


def profiles(
    lines: Mapping[int, Array],
    rest: Array,
    path: tuple[Sequence[Row], StateWords],
    axial: bool = True,
    plate: float | None = None,
) -> Figure:
    """The line on the outer surface that a camera sees from the side.

    Args:
        lines: Outlines from `profile` by number of the step.
        rest: The undeformed outline.
        path: All rows of ``path.csv``, and what is shown of them.
        axial: The device is one of revolution, whose outline goes on beyond its axis.
        plate: Height in m of a rigid plane that stops the device.
    """
    everything = np.concatenate([rest, *lines.values()]) * 1e3
    heights = everything[:, 1] if plate is None else np.append(everything[:, 1], 1e3 * plate)
    right, low, high = everything[:, 0].max(), heights.min(), heights.max()
    left, right = (-1.04 * right, 1.04 * right) if axial else (everything[:, 0].min() - 0.04 * right, 1.04 * right)
    tall = max(high - low, 0.25 * (right - left)) * 1.16
    bottom = low - 0.08 * tall
    # The legend stands beside the axes, never on a line.
    inner = 7.1
    height = inner * tall / (right - left)
    names = _labels(*path, _labelled(list(lines)))
    whole = max(height + 1.25, 0.24 * sum(1.3 + name.count("\n") for name in names.values()) + 1.1)
    figure = Figure((WIDTH, whole), dpi=DPI)
    axes = figure.add_axes((0.85 / WIDTH, (whole - height + 0.25) / 2 / whole, inner / WIDTH, height / whole))
    axes.set(xlim=(left, right), ylim=(bottom, bottom + (right - left) * height / inner), aspect="equal")
    axes.plot(*_outline(rest, axial).T, "--", color=EDGE, linewidth=1.4, label="undeformed")
    colours = matplotlib.colormaps[LINES](np.linspace(0.9, 0.0, max(len(lines), 2)))
    for colour, (step, line) in zip(colours, lines.items(), strict=False):
        axes.plot(*_outline(line, axial).T, color=colour, label=names.get(step))
    if plate is not None:
        axes.axhline(plate * 1e3, color=WARNING, linewidth=1.5, linestyle="--", label="rigid plane")
    axes.set(xlabel=f"distance from the {'axis' if axial else 'clamped base'} in mm", ylabel="height in mm")
    axes.set_title("Outer surface, from the side" if axial else "Outline in the middle, from the side")
    _legend_beside(axes, path[1])
    return figure


def _legend_beside(axes: Axes, words: StateWords) -> None:
    """A legend to the right of the axes, on no line."""
    axes.legend(
        title="water column" if words.pressure else "load",
        loc="center left",
        bbox_to_anchor=(1.01, 0.5),
        frameon=False,
        alignment="left",
    )


def _labels(rows: Sequence[Row], words: StateWords, steps: Collection[int]) -> dict[int, str]:
    """What the legend says of some steps: their load, and on which part of the path they lie."""
    places = branches(rows, words)
    return {
        step: (
            f"{number(rows[step]['pressure_cm'])} cm" if words.pressure else textwrap.fill(words.place(rows[step]), 19)
        )
        + ("\n" + textwrap.fill(f"({places[step]})", 19) if places[step] else "")
        for step in steps
    }


def branches(rows: Sequence[Row], words: StateWords) -> list[str]:
    """On which part of the path each state lies, in words for a legend; empty on the part that begins at rest.

    Where the device jumps, the way of the load counts too: up, and down after the highest one. A state past a limit
    point that stands under its pressure again is on another part of the path, not past the limit.
    """
    over, (raised, moved) = set(jumped_over(rows)), words.along
    landings = [k for k, row in enumerate(rows) if row.get("jump")]
    before = [row[moved] for k, row in enumerate(rows[: landings[0] if landings else 0]) if k not in over]
    largest_before = max(before, default=0.0)
    highest = max(range(len(rows)), key=lambda k: rows[k][raised])
    found, passed = [], False
    for k, row in enumerate(rows):
        part = ["up" if k <= highest else "down"] if landings and not over else []
        if k in over:
            part.append("jumped over")
        elif row["limit"]:
            part.append("limit point")
        elif landings and k >= landings[0]:
            part += ["after the jump"] if row[moved] > largest_before else []
        elif passed:
            part.append("stable again" if row.get("stable_under_pressure") else "past the limit")
        found.append(", ".join(part))
        passed = passed or bool(row["limit"])
    return found


def _labelled(steps: list[int]) -> set[int]:
    """The steps that get a line in the legend: all, or evenly chosen ones with the last among them."""
    every = -(-len(steps) // LEGEND_LINES) or 1
    return set(steps[::-1][::every])


def _outline(line: Array, axial: bool) -> Array:
    """An outline in mm, on both sides of an axis, between nodes as second-order cells have it; (k, 2) m to (m, 2) mm."""
    fine = line
    if len(line) % 2 and len(line) >= 3:  # corners and mid-edge nodes in turn
        fine = parabolas(np.stack([line[:-2:2], line[2::2], line[1:-1:2]], axis=1), 8).reshape(-1, 2)
    return (np.concatenate([fine[::-1] * (-1.0, 1.0), fine]) if axial else fine) * 1e3
