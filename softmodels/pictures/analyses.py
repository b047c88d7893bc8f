"""Pictures of what a device is asked beside its path: grasps, the scatter of its limit pressure, natural modes, studies."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
import matplotlib
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from geometries import Actuator
from softmodels.common import commands, files, pages, processes
from softmodels.common.arrays import Array
from softmodels.common.errors import MissingPackageError
from softmodels.materials import silicones
from softmodels.pictures import curves, offscreen, solid, style
from softmodels.runs import analyses, grasp, grid, state_values, table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from softmodels.design.study import Indices, Input, Study


SHOWN_UNITS = {"m": (1e3, ", mm"), "degree": (1.0, ", degrees"), "": (1.0, "")}
"""Factor and text of each unit on an axis."""


@matplotlib.rc_context(style.STYLE)
def grasp_figure(made: grasp.Grasp, held_states: Sequence[grasp.Held], outlines: Sequence[Sequence[Array]]) -> Figure:
    """Draw fingers and object in their plane, the load downwards: the last state without load, and the last one, each with
    the corners of the fingers' facets, see `Grasp.outlines`."""
    free = max((number for number, held in enumerate(held_states) if not held.load), default=0)
    shown = list(dict.fromkeys([free, len(held_states) - 1]))
    largest = max(float(np.hypot(*held_states[number].forces.T).max()) for number in shown) or 1.0
    radius = made.shape.radius * 1e3

    def plane(vectors: Array) -> Array:
        """Return vectors along and across the load as across and up."""
        return np.stack([vectors[..., 1], -vectors[..., 0]], axis=-1)

    figure = Figure((style.WIDTH_INCHES, style.WIDTH_INCHES / len(shown) + 0.6), dpi=style.DPI, layout="constrained")
    for axes, number in zip(np.atleast_1d(figure.subplots(1, len(shown))), shown, strict=True):
        held = held_states[number]
        for corners in outlines[number]:
            axes.add_collection(
                PolyCollection(list(plane(corners) * 1e3), facecolors=style.FAINT, edgecolors=style.FAINT, linewidths=0.3)
            )
        centre = plane(held.moved) * 1e3
        axes.add_patch(Circle((float(centre[0]), float(centre[1])), radius, facecolor="none", edgecolor=style.INK))
        arrows = [
            *zip(held.forces, [style.CURVE] * len(held.forces), strict=True),
            (np.array([held.load, 0.0]), style.WARNING),
        ]
        for force, colour in arrows:
            if not force.any():
                continue
            way = plane(force) / largest * 2.5 * radius
            start = centre if colour == style.WARNING else centre - way
            axes.annotate("", start + way, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.6})
        axes.set_aspect("equal")
        axes.autoscale_view()
        axes.set(xlabel="across the load, mm", ylabel="against the load, mm")
        pressure = made.case.column.full(held.pressure)
        press = ", ".join(f"{force * 1e3:.3g}" for force in held.press)
        figure.supxlabel("arrows: force of each finger on the object, and its load (downwards)", fontsize="small")
        axes.set_title(f"{pressure}, load {held.load * 1e3:.3g} mN\nfingers press with {press} mN", fontsize="medium")
    return figure


@matplotlib.rc_context(style.STYLE)
def scatter_figure(
    limits: Sequence[tuple[Mapping[str, float], float]],
    tolerances: Sequence[analyses.Tolerance],
    what: str,
    nominal: float,
    working: float | None,
    unit: str,
) -> Figure:
    """Plot the distribution of the limit, and the limit over each parameter: ``limits`` are parameters (SI) and limit
    pressure (height of the column) of each device, ``nominal`` that of the device as drawn, like the working pressure.
    ``what`` the pressure is stands at the axes, such as ``"limit pressure"``, with the ``unit`` of the column."""
    label = f"{what}, {unit}"
    pressures = np.sort([pressure for _, pressure in limits])
    figure = Figure((style.WIDTH_INCHES, 4.8 if len(tolerances) < 3 else 4.4), dpi=style.DPI, layout="constrained")
    axes = figure.subplots(1, 1 + len(tolerances))
    share = (np.arange(len(pressures)) + 0.5) / len(pressures) * 100
    axes[0].step(pressures, share, where="mid", color=style.CURVE)
    for percent in (5, 50, 95):
        axes[0].plot(np.percentile(pressures, percent), percent, "o", color=style.INK, markersize=5)
    axes[0].axvline(nominal, color=style.FAINT, linestyle="--", label=f"nominal: {nominal:.3g} cm")
    if working is not None:
        axes[0].axvline(working, color=style.WARNING, label=f"working: {working:.3g} cm")
    axes[0].set(xlabel=label, ylabel="devices below it, %", ylim=(0, 100))
    axes[0].legend(loc="best", fontsize=9)
    for place, tolerance in zip(axes[1:], tolerances, strict=True):
        factor, unit = SHOWN_UNITS[tolerance.unit]
        values = [changes[tolerance.name] * factor for changes, _ in limits]
        place.plot(values, [pressure for _, pressure in limits], "o", color=style.CURVE, markersize=4)
        place.set(xlabel=f"{tolerance.name.replace('_', ' ')}{unit}", ylabel=label)
    return figure


# ----------------------------------------------------------------------------------------------------------------------
# Pictures of ``softmodels modes``: natural frequencies over the pressure, and the shapes of the first modes.
#
# Solids are rendered in a separate process, because VTK and DOLFINx each bring their own HDF5.


MAX_MODE_AMPLITUDE = 0.15
"""Largest displacement of a mode as drawn, in sizes of the slice, unless walls meet before."""
AMPLITUDE_FACTORS = 0.6 ** np.arange(7)
"""Shares of it that are tried until no walls of a solid pass through each other."""
MAX_MODES_DRAWN = 4


@dataclasses.dataclass(frozen=True, eq=False)
class SolidShapes:
    """What is rendered of a slice, by surface vertices in m: the state before, shape (v, 3); the state with each mode added,
    and its normals, shape (modes, v, 3); triangles and edges, shape (t, 3) and (e, 2); up in the picture, and from the slice
    to the viewer."""

    before: Array
    bent: Array
    normals: Array
    triangles: grid.Cells
    edges: grid.Cells
    up: Array
    towards: Array


@matplotlib.rc_context(style.STYLE)
def frequency_figure(pressures: Array, frequencies: Array, sealed: bool, unit: str) -> Figure:
    """Plot the frequencies in Hz, shape (states, modes), over the pressures in a ``unit``; of a single state as bars."""
    figure, axes = style.chart(5.0)
    numbers = range(1, frequencies.shape[1] + 1)
    if len(pressures) == 1:
        axes.bar(numbers, frequencies[0], width=0.5)
        axes.set(xlabel="mode", xticks=list(numbers))
    else:
        # In order of size on both sides of a crossing, where modes change places.
        for number, column in zip(numbers, frequencies.T, strict=True):
            axes.plot(pressures, column, marker="o", markersize=4, label=f"f{number}")
        axes.legend(loc="best")
        axes.set(xlabel=f"pressure, {unit}")
    axes.set(ylabel=f"natural frequency{', cavities sealed' if sealed else ''}, Hz", ylim=(0.0, None))
    return figure


@matplotlib.rc_context({**style.STYLE, "font.size": 10, "axes.titlesize": 10})
def section_shapes(moved: Array, shapes: Sequence[Array], cells: grid.Cells, titles: Sequence[str]) -> Figure:
    """Draw an axisymmetric section of cells, shape (c, 6), in its first modes (largest entry 1, shape (n, 3) each) with their
    titles, over its outline without them; nodes of the state in m, shape (n, 3) with y = 0."""
    flat = moved[:, ::2] * 1e3
    size = MAX_MODE_AMPLITUDE * np.ptp(flat[:, 0])
    bent = [flat + size * shape[:, ::2] for shape in shapes]
    low, high = np.min([flat, *bent], axis=(0, 1)), np.max([flat, *bent], axis=(0, 1))
    shape_of_panel = (high - low)[1] / (high - low)[0]
    columns = 2 if shape_of_panel < 0.8 else MAX_MODES_DRAWN
    rows = -(-len(shapes) // columns)
    tall = rows * (min(style.WIDTH_INCHES / columns * shape_of_panel, style.WIDTH_INCHES) + 0.6)
    figure = Figure((style.WIDTH_INCHES, tall), dpi=style.DPI, layout="constrained")
    for place, shape, title in zip(figure.subplots(rows, columns, squeeze=False).flat, bent, titles, strict=False):
        for shown, colour in ((flat, style.FAINT), (shape, style.INK)):
            place.add_collection(LineCollection(list(grid.outline(shown, cells)), colors=colour, linewidths=1.4))
        place.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", title=title)
    for place in list(figure.axes)[len(shapes) :]:
        place.remove()
    figure.supxlabel("radius in mm")
    figure.supylabel("height in mm")
    return figure


def solid_shapes(
    points: Array, cells: grid.Cells, cell_name: str, actuator: Actuator, moved: Array, shapes: Sequence[Array]
) -> SolidShapes:
    """Return what `main` renders of a slice: undeformed nodes in m, shape (n, 3), cells, shape (c, 10), with XDMF's name of
    them, nodes of the state in m, and the modes."""
    skin, up = grid.surface_of(points, cells, cell_name, actuator), np.asarray(actuator.lift)
    size = MAX_MODE_AMPLITUDE * np.ptp(points, axis=0).max()
    walls = state_values.FacingWalls(points, cells, cell_name, [plane.normal for plane in actuator.cut_planes])
    bent = np.array([skin.points(moved + _scaled_mode(walls, moved - points, size * shape)) for shape in shapes])
    whole = offscreen.direction(*((-45.0, 32.0) if actuator.axial else (-58.0, 24.0)), up)
    return SolidShapes(
        before=skin.points(moved),
        bent=bent,
        normals=np.array([skin.normals(mode) for mode in bent]),
        triangles=skin.triangles,
        edges=np.concatenate([skin.edges, skin.rims]),
        up=up,
        towards=offscreen.across_cut(skin, up) if len(skin.planes) else whole,
    )


def _scaled_mode(walls: state_values.FacingWalls, displacement: Array, shape: Array) -> Array:
    """Return a mode as large, and of that sign, as makes no walls pass through each other."""
    for share in AMPLITUDE_FACTORS:
        for sign in (1.0, -1.0):
            if not walls.cross(displacement + sign * share * shape):
                return sign * share * shape
    return AMPLITUDE_FACTORS[-1] * shape


def draw_solids(told: SolidShapes, titles: Sequence[str]) -> Figure:
    """Render what `solid_shapes` has made."""
    camera, edges = offscreen.ViewCamera.around([told.before, *told.bent], told.towards, told.up), told.edges
    with offscreen.studio(camera) as shoot:
        images = [
            shoot([
                (offscreen.surface(bent, told.triangles, normals), {**offscreen.SOLID_STYLE, "color": style.SOLID}),
                (offscreen.lines(bent, edges), {"color": style.INK, "line_width": 2.0}),
                (offscreen.lines(told.before, edges), {"color": style.FAINT, "line_width": 1.5}),
            ])
            for bent, normals in zip(told.bent, told.normals, strict=True)
        ]  # fmt: skip
    return solid.tiled(list(zip(titles, images, strict=True)))


# ----------------------------------------------------------------------------------------------------------------------
# Pictures and report of a study: parallel coordinates, response surfaces, shares of the variance, and a page with all.


SURFACE_POINTS = 41
"""Points of a response surface along each input."""
PERCENTILES = (5, 50, 95)


def _label(variable: Input | str) -> str:
    """Return an input's or a column's name with its unit."""
    name, unit = table.split(variable) if isinstance(variable, str) else (variable.key.rpartition(".")[2], variable.unit)
    words = name.replace("_", " ")
    return f"{words}, {unit}" if unit else words


@matplotlib.rc_context({**style.STYLE, "axes.grid": False})
def parallel(study: Study) -> Figure:
    """Return the samples as lines over the inputs and responses, coloured by the first response."""
    inputs, responses = study.plan.inputs, study.responses
    points, values = study.plan.points, [study.values(name) for name in responses]
    columns = [*points.T, *values]
    places: list[Input | str] = [*inputs, *responses]
    figure, axes = style.chart(4.4)
    shares = []
    for place, column in zip(places, columns, strict=True):
        low, high = float(np.nanmin(column)), float(np.nanmax(column))
        if not isinstance(place, str) and place.values:
            low, high = 0.0, max(len(place.values) - 1.0, 1.0)
        width = high - low or 1.0
        shares.append((column - low) / width)
        _axis_texts(axes, len(shares) - 1, place, (low, low + width))
    lines = np.stack([np.broadcast_to(np.arange(len(shares)), (len(points), len(shares))), np.transpose(shares)], axis=-1)
    whole = np.isfinite(lines[..., 1]).all(axis=1)
    order = np.argsort(values[0][whole])
    bundle = LineCollection(
        list(lines[whole][order]), array=values[0][whole][order], cmap=style.LINES_CMAP, linewidths=1.0, alpha=0.7
    )
    axes.add_collection(bundle)
    figure.colorbar(bundle, ax=axes, label=_label(responses[0]), pad=0.02)
    axes.set(xlim=(-0.15, len(shares) - 0.85), ylim=(-0.05, 1.05), yticks=[])
    axes.set_xticks(range(len(shares)), [_label(place).replace(", ", "\n") for place in places])
    for side in ("left", "right", "top", "bottom"):
        axes.spines[side].set_visible(False)
    axes.tick_params(length=0)
    return figure


def _axis_texts(axes: Axes, place: int, variable: Input | str, ends: tuple[float, float]) -> None:
    """Draw the axis of an input or a response, with the values at its ends or of its texts."""
    axes.axvline(place, color=style.FAINT, linewidth=1.0, zorder=0)
    low, high = ends
    marks = [(0.0, low), (0.5, (low + high) / 2), (1.0, high)]
    texts = [(share, f"{value:.4g}") for share, value in marks]
    if not isinstance(variable, str) and variable.values:
        listed = variable.values[:: max(len(variable.values) // 6, 1)]
        texts = [((variable.values.index(value) - low) / (high - low), f"{value}") for value in listed]
    for share, text in texts:
        axes.annotate(text, (place, share), xytext=(4, 0), textcoords="offset points", fontsize=9, va="center", zorder=3,
                      bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.7})  # fmt: skip


@matplotlib.rc_context({**style.STYLE, "axes.grid": False})
def surface_figure(study: Study, response: str, strongest: tuple[int, int]) -> Figure:
    """Return a response over the two strongest inputs, the others in their middle: its surrogate, and the samples."""
    inputs, model = study.plan.inputs, study.surrogate(response)
    shares = (np.arange(SURFACE_POINTS) + 0.5) / SURFACE_POINTS
    across, up = (_input_values(inputs[k], shares) for k in strongest)
    middle = np.array([float(variable.ppf(np.array([0.5]))[0]) for variable in inputs])
    points = np.tile(middle, (len(across) * len(up), 1))
    points[:, strongest[0]] = np.repeat(across, len(up))
    points[:, strongest[1]] = np.tile(up, len(across))
    values = model(points).reshape(len(across), len(up)).T
    first, second = (inputs[k] for k in strongest)
    figure, axes = style.chart(4.8, 0.72 * style.WIDTH_INCHES)
    x, y = _on_axis(first, across), _on_axis(second, up)
    low, high = float(values.min()), float(values.max())
    levels = np.linspace(low, high if high > low else low + 1.0, 15)
    filled = axes.contourf(x, y, values, levels=levels, cmap=style.LINES_CMAP)
    own = study.values(response)
    known = np.isfinite(own)
    at = study.plan.points
    axes.scatter(
        _on_axis(first, at[known, strongest[0]]), _on_axis(second, at[known, strongest[1]]), c=own[known],
        cmap=style.LINES_CMAP, vmin=levels[0], vmax=levels[-1], edgecolors="white", s=36, label="samples",
    )  # fmt: skip
    if not known.all():
        gone = ~known
        axes.plot(_on_axis(first, at[gone, strongest[0]]), _on_axis(second, at[gone, strongest[1]]), "x", color=style.WARNING,
                  label="no result")  # fmt: skip
        axes.legend(loc="best", fontsize=9)
    figure.colorbar(filled, ax=axes, label=_label(response), format="%.4g")
    axes.set(xlabel=_label(first), ylabel=_label(second))
    for variable, ticks in ((first, axes.set_xticks), (second, axes.set_yticks)):
        if variable.named:
            ticks(range(len(variable.values)), [str(value) for value in variable.values])  # type: ignore[operator]
    return figure


def _input_values(variable: Input, shares: Array) -> Array:
    """Return values of an input over its range; of a normal distribution up to its 95 % interval."""
    if variable.values:
        return np.arange(len(variable.values), dtype=float)
    return variable.low + (variable.high - variable.low) * shares if variable.normal else variable.ppf(shares)


def _on_axis(variable: Input, points: Array) -> Array:
    """Return values as they stand on an axis; of texts their places."""
    if variable.named or not variable.values:
        return points
    return np.array(variable.values, dtype=float)[points.astype(int)]


@matplotlib.rc_context(style.STYLE)
def shares_figure(indices: dict[str, Indices]) -> Figure:
    """Return the Sobol indices of each response as bars with their 95 % intervals."""
    names = next(iter(indices.values())).inputs
    figure = Figure((style.WIDTH_INCHES, 1.3 + 0.45 * len(names)), dpi=style.DPI, layout="constrained")
    for axes, (response, sobol) in zip(np.ravel(figure.subplots(1, len(indices), sharey=True)), indices.items(), strict=True):
        places = np.arange(len(names))
        axes.barh(
            places - 0.2, sobol.first, 0.38, xerr=sobol.first_half, color=style.CURVE, ecolor=style.FAINT, label="first order"
        )
        axes.barh(places + 0.2, sobol.total, 0.38, xerr=sobol.total_half, color=style.FAINT, ecolor=style.CURVE, label="total")
        axes.set(xlim=(0, None), xlabel="share of the variance", title=_label(response))
        axes.set_yticks(places, [name.rpartition(".")[2].replace("_", " ") for name in names])
        axes.grid(axis="y", visible=False)
    axes.invert_yaxis()
    axes.legend(loc="best", fontsize=9)
    return figure


# ----------------------------------------------------------------------------------------------------------------------
# The table and the page.


def study_table(study: Study) -> str:
    """Return ``study.csv``: a row for each sample, units in the heads of the columns."""
    out = io.StringIO(newline="")
    rows = csv.writer(out, lineterminator="\n")
    inputs, responses = study.plan.inputs, study.responses
    heads = [f"{variable.key} ({variable.unit})" if variable.unit else variable.key for variable in inputs]
    rows.writerow(["sample", *heads, *responses, "failure"])
    for k, point in enumerate(study.plan.points):
        values = [study.values(name)[k] for name in responses]
        own = [variable.value(float(x)) for variable, x in zip(inputs, point, strict=True)]
        rows.writerow([k, *own, *(f"{x:.9g}" if math.isfinite(x) else "" for x in values), study.failures.get(k, "")])
    return out.getvalue()


def study_page(study: Study, seconds: float) -> tuple[str, dict[str, Figure]]:
    """Return the report, and its figures by their names."""
    plan, column = study.plan, study.plan.case.column
    figures = {"parallel": parallel(study)}
    indices, errors, notes = _surrogate_indices(study, figures)
    failures = study.failures
    spread = [[name, *(f"{x:.5g}" for x in _figures(study.values(name)))] for name in study.responses]
    rows = [
        [f"{name}: {key}", f"{a:.3f} ± {c:.2g}", f"{b:.3f} ± {d:.2g}"]
        for name, index in indices.items()
        for key, a, b, c, d in zip(index.inputs, index.first, index.total, index.first_half, index.total_half, strict=True)
    ]
    facts = [pages.Fact("samples", str(len(plan.points)), f"{plan.sampling}, seed {plan.seed}")]
    facts += [pages.Fact("without a result", str(len(failures)), "see below", True)] if failures else []
    for name in study.responses:
        note = f"surrogate's error {errors[name]}" if name in errors else ""
        facts.append(pages.Fact(_label(name), f"{np.nanmedian(study.values(name)):.4g} {table.split(name)[1]}".strip(), note))

    def charts(start: str) -> pages.Charts:
        return pages.Charts(
            [(f"{name}.svg", curves.drawing(figure, column)) for name, figure in figures.items() if name.startswith(start)]
        )

    answer = f"{len(plan.points) - len(failures)} of {len(plan.points)} samples of {plan.case.name} have a result."
    report = pages.Page(
        f"Study {plan.name}", answer,
        [
            ("Samples", [charts("parallel")]),
            ("Responses", [pages.Table(spread, ["response", "mean", "standard deviation", *(f"{p} %" for p in PERCENTILES)])]),
            ("Response surfaces", [
                pages.Text("The surrogate over the two strongest inputs, the others in their middle. Points: the samples."),
                charts("surface"),
                pages.Bullets([f"{name}: cross-validated error {text} (rms)" for name, text in errors.items()]),
            ]),
            ("Sobol indices", [
                pages.Text("Shares of the variance by each input: by itself (first order), with all interactions (total); "
                     + _of_what(indices)) if indices else None,
                charts("indices"), pages.Table(rows, ["input", "first order", "total"]) if rows else None,
            ]),
            ("Samples without a result", [pages.Bullets([f"sample {k}: {text}" for k, text in failures.items()])]),
            ("Inputs", [pages.Table([[variable.key, _range(variable)] for variable in plan.inputs], numbers=False)]),
            ("The case", [pages.Folded("case.toml", [pages.Listing(plan.case.to_toml())])]),
        ],
        commands.Provenance.now(seconds), facts, notes, silicones.publications(plan.case.material),
        {"study.csv": study_table(study)}, column,
    )  # fmt: skip
    return report.html(), figures


def _surrogate_indices(study: Study, figures: dict[str, Figure]) -> tuple[dict[str, Indices], dict[str, str], list[str]]:
    """Return indices and errors of the surrogates by response, and why others have none; add their figures."""
    from softmodels.design.study import StudyError  # other pages do without designs

    indices: dict[str, Indices] = {}
    errors: dict[str, str] = {}
    notes: list[str] = []
    for name in study.responses:
        try:
            sobol, made = study.indices(name), study.surrogate(name)
        except (StudyError, MissingPackageError) as error:
            notes.append(f"{name}: {error}")
            continue
        indices[name] = sobol
        notes += [f"{name}: {sobol.doubt}"] if sobol.doubt else []
        share = made.error / made.spread if made.spread else 0.0
        size = f"{made.error:.3g} {table.split(name)[1]}".strip()
        errors[name] = f"{size}, {100 * share:.2g} % of the standard deviation"
        order = np.argsort(sobol.total)[::-1]
        if len(order) > 1:
            figures[f"surface-{name}"] = surface_figure(study, name, (int(order[0]), int(order[1])))
    if indices and len(study.plan.inputs) > 1:
        figures["indices"] = shares_figure(indices)
    return indices, errors, notes


def _of_what(indices: dict[str, Indices]) -> str:
    worst = max(index.surrogate_error for index in indices.values())
    return "of the samples themselves." if worst == 0.0 else "of the surrogate, whose error adds to the intervals."


def _figures(values: Array) -> list[float]:
    return [float(np.nanmean(values)), float(np.nanstd(values)), *map(float, np.nanpercentile(values, PERCENTILES))]


def _range(v: Input) -> str:
    if v.values:
        return ", ".join(f"{value}" for value in v.values) + (f" {v.unit}" if v.unit else "")
    if v.normal:
        return f"{(v.low + v.high) / 2:.6g} ± {(v.high - v.low) / 2:.6g} {v.unit} (normal, 95 %)"
    return f"{v.low:.6g} to {v.high:.6g} {v.unit} (uniform)"


# ----------------------------------------------------------------------------------------------------------------------
# The process that renders modes.


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("shapes", type=click.Path(path_type=Path))
@click.argument("picture", type=click.Path(path_type=Path))
@click.argument("titles", nargs=-1)
def main(shapes: Path, picture: Path, titles: tuple[str, ...]) -> None:
    """Render the SHAPES, a file of numpy, into a PICTURE; each has one of the TITLES."""
    if not offscreen.can_render():
        processes.say("this machine cannot render (no OpenGL)", err=True)
        sys.exit(1)
    with np.load(shapes) as told:
        files.write_bytes(picture, style.png(draw_solids(SolidShapes(**told), titles)))


if __name__ == "__main__":
    main()
