"""``python -m softmodels.pictures.draw_design results/design``: pictures and report of a design.

A separate program, because VTK and DOLFINx each bring an HDF5. It reads ``design.json`` and the runs ``before`` and ``after``.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
import matplotlib
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from softmodels.common import commands, files, pages, units
from softmodels.common.arrays import Array
from softmodels.common.pages import Page
from softmodels.design import result
from softmodels.materials import silicones
from softmodels.pictures import curves, offscreen, solid, style
from softmodels.pictures.draw import reported
from softmodels.runs import grid, labels, table
from softmodels.runs.states import FolderStates, StoredStates
from softmodels.runs.store import ResultsError

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# ----------------------------------------------------------------------------------------------------------------------
# Plots of a design: both paths, the history of the search, the parameters before and after. No rendering needed.


SHOWN_LIMITS = 7
"""Maximum number of limits plotted in the history: the closest ones."""
GIVEN_COLOUR, DESIGN_COLOUR = style.BRANCH, style.CURVE
NEAR_LIMIT = -0.3
"""Relative distance to a limit within which it is plotted."""
MIN_VIOLATION_SHOWN = -0.6
"""Lower end of the plotted violations."""


def paths(before: table.PathTable, after: table.PathTable, gauge: str, column: units.Column) -> Figure:
    """Plot the gauge's rise over the pressure, of the given and the optimised device."""
    figure, axes = style.chart(6.2)
    for rows, colour, words in ((before, GIVEN_COLOUR, "as given"), (after, DESIGN_COLOUR, "design")):
        places = np.column_stack([rows.shown("pressure"), rows.shown(gauge)])
        asked = places[rows["requested"] != 0]
        end = f": {asked[-1, 1]:.4g} mm at {asked[-1, 0]:.4g} cm" if len(asked) else ""
        axes.plot(*curves.smooth(places).T, color=colour, label=f"{words}{end}")
        axes.plot(*places.T, "o", color=colour, markersize=3.5)
        axes.plot(*asked.T, "o", color=colour, mfc="white", markersize=8, markeredgewidth=2)
        for row in curves.limits(rows):
            label = f"limit point, {words}: {row.told('pressure')}"
            axes.plot(row.shown("pressure"), row.shown(gauge), "D", color=style.WARNING, markersize=9, label=label)
    axes.set(xlabel=f"pressure in {column.unit}", ylabel=f"rise of the {gauge} in mm")
    axes.margins(0.06)
    curves.kilopascals(axes, column)
    axes.legend(loc="best")
    return figure


def history(told: result.DesignRecord) -> Figure:
    """Plot objective and limits over the designs in the order of their evaluation; ``told`` is ``design.json``."""
    figure = Figure((style.WIDTH_INCHES, 8.4), dpi=style.DPI, layout="constrained")
    top, below = figure.subplots(2, sharex=True)
    trials, objective = told["trials"], told["objective"]
    numbers = np.array([trial["number"] for trial in trials])
    values = _numbers(objective["values"])
    worst = np.where(np.isfinite(values), -1.0, np.nan)
    for limit in told["limits"]:
        worst = np.maximum(worst, _numbers(limit["passed"]))
    kept = worst <= 1e-9
    starts = np.array([trial["start"] for trial in trials])
    for start in dict.fromkeys(starts):
        mine = starts == start
        top.plot(numbers[mine], values[mine], "-", color=style.FAINT, linewidth=1.2)
    top.plot(numbers[kept], values[kept], "o", color=style.CURVE, markersize=7, label="all limits satisfied")
    passed, label = ~kept & np.isfinite(values), "a limit violated"
    if passed.any():
        top.plot(numbers[passed], values[passed], "o", color=style.WARNING, mfc="white", markersize=7, label=label)
    best = numbers == told["best"]
    top.plot(numbers[best], values[best], "o", color=style.CURVE, mfc="none", markersize=14, label="the design")
    _failures(top, below, trials)
    _limit_curves(below, told, numbers, starts)
    unit = f" in {objective['unit']}" if objective["unit"] else ""
    top.set_ylabel(style.wrapped(f"{objective['words']}{unit}", 3.6, 12))
    top.legend(loc="best")
    below.set(xlabel="design", ylabel="relative violation of a limit")
    below.xaxis.get_major_locator().set_params(integer=True)
    return figure


def _numbers(values: Sequence[float | None]) -> Array:
    return np.array([float("nan") if value is None else value for value in values])


def _failures(top: Axes, below: Axes, trials: Sequence[result.TrialRecord]) -> None:
    """Mark failed designs and the starts, as lines across both panels."""

    def across(place: float, label: str, color: str, linestyle: str, linewidth: float) -> None:
        for axes in (top, below):
            known = axes is below or label in axes.get_legend_handles_labels()[1]
            label_here = "" if known else label
            axes.axvline(place, label=label_here, color=color, linestyle=linestyle, linewidth=linewidth)

    for trial in trials:
        if trial["failure"]:
            across(trial["number"], "no state or invalid device", style.WARNING, ":", 1.4)
    for before, after in itertools.pairwise(trials):
        place = after["number"] - 0.5
        if after["start"] != before["start"]:
            across(place, "", style.INK, "-", 0.8)
            top.annotate(f"start {after['start']}", (place + 0.1, 1.0), xycoords=("data", "axes fraction"), va="top",
                         fontsize=10, color=style.INK)  # fmt: skip
        elif after["mesh"] != before["mesh"]:
            fresh = "confirmed and continued on a fresh mesh"
            across(place, fresh, style.FAINT, "--", 1.2)


def _limit_curves(axes: Axes, told: result.DesignRecord, numbers: Array, starts: Array) -> None:
    axes.axhline(0.0, color=style.INK, linewidth=1.2)
    largest = [float(np.nanmax(_numbers(limit["passed"]), initial=-np.inf)) for limit in told["limits"]]
    nearest = [told["limits"][k] for k in np.argsort([-value for value in largest], kind="stable")]
    near = nearest[: min(sum(value > NEAR_LIMIT for value in largest), SHOWN_LIMITS)]
    for limit, colour in zip(near, style.LINE_COLOURS, strict=False):
        passed = np.maximum(_numbers(limit["passed"]), MIN_VIOLATION_SHOWN)
        label = style.wrapped(limit["words"], 4.4, 10)
        for start in dict.fromkeys(starts):
            mine = starts == start
            axes.plot(numbers[mine], passed[mine], "o-", markersize=4, linewidth=1.5, color=colour, label=label)
            label = ""
    if not nearest:
        axes.annotate("no limits were set", (0.5, 0.5), xycoords="axes fraction", ha="center", color=style.FAINT)
        return
    if near:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2, fontsize=9.5, frameon=False)
    if rest := len(nearest) - len(near):
        axes.set_title(f"{rest} further limit{'s' if rest > 1 else ''}, inactive, not shown", fontsize=11)


def parameters(told: Sequence[result.ParameterRecord]) -> Figure:
    """Plot each free parameter between its bounds, before and after."""
    figure, axes = style.chart(1.5 + 0.62 * len(told))
    for k, record in enumerate(told):
        low, high, unit = record["low"], record["high"], record["unit"]
        before, after = ((record[name] - low) / (high - low) for name in ("before", "after"))
        axes.plot([0, 1], [k, k], "|-", color=style.FAINT, linewidth=1.2, markersize=14)
        arrow = {"arrowstyle": "-|>", "color": DESIGN_COLOUR, "mutation_scale": 15}
        axes.annotate("", (after, k), (before, k), arrowprops=arrow)
        label = "" if k else "as given"
        axes.plot(before, k, "o", color=GIVEN_COLOUR, mfc="white", markersize=9, markeredgewidth=2, label=label)
        axes.plot(after, k, "o", color=DESIGN_COLOUR, markersize=8, label="" if k else "design")
        axes.text(-0.02, k, f"{low:.4g}", ha="right", va="center", fontsize=10, color=style.FAINT)
        axes.text(1.02, k, f"{high:.4g} {unit}", ha="left", va="center", fontsize=10, color=style.FAINT)
        text = f"{record['before']:.4g} to {record['after']:.4g} {unit}"
        axes.text(0.5, k - 0.3, text, ha="center", va="center", fontsize=10, color=style.INK)
    axes.set_yticks(range(len(told)), [record["name"] for record in told])
    axes.set(xlim=(-0.16, 1.2), ylim=(len(told) - 0.4, -0.75), xticks=[])
    axes.grid(False)
    axes.tick_params(axis="y", length=0)
    axes.spines[:].set_visible(False)
    axes.legend(loc="upper right", ncols=2, bbox_to_anchor=(1.0, 1.12 if len(told) < 4 else 1.04), frameon=False)
    return figure


# ----------------------------------------------------------------------------------------------------------------------
# The given and the optimised device side by side, deformed: same camera, same colour scale.


NAMES = ("as given", "design")


def shapes(pair: tuple[StoredStates, StoredStates], colormap: str = commands.COLORMAP) -> Figure:
    """Return both devices at their last requested state, coloured by von Mises stress."""
    looks = [offscreen.look(states, colormap) for states in pair]
    scales = [look.scales["von_mises"] for look in looks]
    scale = max(scales, key=lambda other: other.top)
    clouds = [look.points(step) for look in looks for step in (0, look.states.main)]
    camera = offscreen.ViewCamera.around(clouds, looks[0].direction, looks[0].up, offscreen.WIDTH_PX // 2, 1.1)
    images = []
    for look, name in zip(looks, NAMES, strict=True):
        states = look.states
        with offscreen.studio(camera) as shoot:
            shot = shoot(look.coloured(states.main, scale))
        images.append((f"{name}: {labels.headline(states.rows[states.main], states.words)}", shot))
    figure = solid.tiled(images, style.FOOT_INCHES)
    shown = [(look.states, look.states.main) for look in looks]
    values = np.concatenate([states.field(step, scale.field) for states, step in shown])
    scale.bar(figure, scale.largest([states.rows[step] for states, step in shown], values))
    style.rulers(figure, camera.metres, camera.axes)
    return figure


def sections(pair: tuple[StoredStates, StoredStates]) -> Figure:
    """Return the outlines of both half sections, at rest and deformed; of axisymmetric devices."""
    figure = Figure((style.WIDTH_INCHES, 5.6), dpi=style.DPI, layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, states, name in zip(panels, pair, NAMES, strict=True):
        title = f"{name}: {labels.headline(states.rows[states.main], states.words)}"
        for points, colour in ((states.points, style.FAINT), (states.moved(states.main), style.INK)):
            flat = list(grid.outline(points[:, ::2] * 1e3, states.cells))
            axes.add_collection(LineCollection(flat, colors=colour, linewidths=1.4))
        axes.autoscale_view()
        axes.set_aspect("equal")
        axes.set_title(style.wrapped(title, style.WIDTH_INCHES / 2, 12), fontsize=12)
        axes.set_xlabel("radius in mm")
    panels[0].set_ylabel("height in mm")
    return figure


def draw(folder: Path, colormap: str = commands.COLORMAP) -> list[Path]:
    """Draw the pictures and the report of a folder of ``softmodels design``, fields in the colours of a map; return the
    files. ResultsError or CaseError if it holds no design that can be read, OSError if it cannot be written."""
    try:
        told = files.read_json(folder / "design.json")
        if not result.DesignRecord.__required_keys__ <= set(told):
            raise ValueError
    except (OSError, ValueError, TypeError):
        raise ResultsError(f"{folder} holds no design (design.json)") from None
    before, after = (FolderStates(folder / name) for name in ("before", "after"))
    actuator = before.actuator
    with style.PictureFolder(folder) as out, matplotlib.rc_context(style.STYLE):
        charts = {
            "paths": paths(before.rows, after.rows, actuator.gauge, before.case.column),
            "history": history(told),
            "parameters": parameters(told["parameters"]),
        }
        if actuator.dimension == 2:
            charts["sections"] = sections((before, after))
        for name, figure in charts.items():
            out.save(name, figure)
        if offscreen.can_render():
            out.save("shapes", shapes((before, after), colormap))
    shown: dict[str, pages.Part] = {
        (file := f"{name}.png"): pages.Charts(
            [(f"{name}.svg", curves.drawing(figure, before.case.column))], result.CAPTIONS[file]
        )
        for name, figure in charts.items()
    }
    for path in out.written:
        shown.setdefault(path.name, pages.Picture(files.image_uri(path), result.CAPTIONS[path.name]))
    files.write_text(
        folder / result.REPORT, page(folder, told, [shown[name] for name in result.CAPTIONS if name in shown], (before, after))
    )
    return [*out.written, folder / result.REPORT]


def page(folder: Path, told: result.DesignRecord, drawn: Sequence[pages.Part], pair: tuple[StoredStates, StoredStates]) -> str:
    """Return the report of a design: ``told`` is its ``design.json``, ``drawn`` are its pictures."""
    rows = [
        (record["name"], *(f"{record[name]:.5g} {record['unit']}".strip() for name in ("low", "before", "after", "high")))  # type: ignore[literal-required]
        for record in told["parameters"]
    ]
    finer = f", refined {told['finer']} times" if told["finer"] != 1.0 else ""
    downloads = {name: files.read_text(folder / name) for name in ("iterates.csv",) if (folder / name).is_file()}
    given, best = (states.rows[states.main] for states in pair)
    gauge, limit = pair[0].actuator.gauge, next(iter(curves.limits(pair[1].rows)), None)
    return Page(
        told["name"], f"{told['headline']}.",
        [
            ("Pictures", drawn),
            ("Limits on the design", [
                pages.Bullets(told["reasons"]), pages.Text(f"{told['agreement']}." if told["agreement"] else ""),
                pages.Table(rows, ("parameter", "from", "as given", "design", "to")),
            ]),
            (f"Check on a new mesh{finer}", [pages.Bullets(told["confirmation"])]),
            ("Sensitivity of the target to the parameters", [pages.Bullets(told["recovered"])]),
            ("Tolerances and material errors", [pages.Bullets(told["margins"])]),
            ("Notes", [pages.Bullets(told["notes"])]),
            ("The case of the design", [pages.Folded("design.toml", [pages.Listing(files.read_text(folder / "design.toml"))])]),
        ],
        commands.Provenance.from_table(told.get("made")),
        [
            pages.Fact("Limits of the design", "all kept" if told["feasible"] else "violated",
                 "" if told["feasible"] else "see the warnings and reasons below", not told["feasible"]),
            *(pages.Fact(f"Rise of the {gauge}, {name}", row.told(gauge), labels.load(row, states.words))
              for name, row, states in (("as given", given, pair[0]), ("design", best, pair[1]))),
            *([pages.Fact("Limit point of the design",
            f"{limit.shown('pressure'):.4g} {pair[1].words.unit}")] if limit else []),
        ],
        [*([f"{told['trouble']}."] if told["trouble"] else []), *told["missed"]],
        silicones.publications(pair[1].case.material), downloads, pair[1].case.column,
    ).html()  # fmt: skip


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--colormap", **commands.COLORMAP_OPTION)
def main(folder: Path, colormap: str) -> None:
    """Draw the pictures and the report of the design in FOLDER."""
    with reported(folder):
        for path in draw(folder, colormap):
            print(path)


if __name__ == "__main__":
    main()
