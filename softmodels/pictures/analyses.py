"""Pictures of what a device is asked beside its path: the scatter of its limit pressure, natural modes."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import click
import matplotlib
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from geometries import Actuator
from softmodels.common.arrays import Array
from softmodels.common.files import write_bytes
from softmodels.common.processes import say
from softmodels.pictures.offscreen import (
    SOLID_STYLE,
    ViewCamera,
    across_cut,
    can_render,
    direction,
    lines,
    studio,
    surface,
)
from softmodels.pictures.solid import tiled
from softmodels.pictures.style import CURVE, DPI, FAINT, INK, SOLID, STYLE, WARNING, WIDTH, png
from softmodels.runs.analyses import Tolerance
from softmodels.runs.grasp import Grasp, Held
from softmodels.runs.grid import Cells, outline, surface_of
from softmodels.runs.state_values import FacingWalls

SHOWN = {"m": (1e3, ", mm"), "degree": (1.0, ", degrees"), "": (1.0, "")}
"""Factor and text of each unit on an axis."""


def grasp_figure(made: Grasp, found: Sequence[Held], outlines: Sequence[Sequence[Array]]) -> Figure:
    """Draw fingers and object in their plane, the load downwards: the last state without load, and the last one.

    Args:
        made: The grasp.
        found: Its states.
        outlines: Corners of the fingers' facets in each, see `Grasp.outlines`.
    """
    free = max((number for number, held in enumerate(found) if not held.load), default=0)
    shown = list(dict.fromkeys([free, len(found) - 1]))
    largest = max(float(np.hypot(*found[number].forces.T).max()) for number in shown) or 1.0
    radius = made.shape.radius * 1e3

    def plane(vectors: Array) -> Array:
        """Return vectors along and across the load as across and up."""
        return np.stack([vectors[..., 1], -vectors[..., 0]], axis=-1)

    with matplotlib.rc_context(STYLE):
        figure = Figure((WIDTH, WIDTH / len(shown) + 0.6), dpi=DPI, layout="constrained")
        for axes, number in zip(np.atleast_1d(figure.subplots(1, len(shown))), shown, strict=True):
            held = found[number]
            for corners in outlines[number]:
                axes.add_collection(
                    PolyCollection(list(plane(corners) * 1e3), facecolors=FAINT, edgecolors=FAINT, linewidths=0.3)
                )
            centre = plane(held.moved) * 1e3
            axes.add_patch(Circle((float(centre[0]), float(centre[1])), radius, facecolor="none", edgecolor=INK))
            arrows = [*zip(held.forces, ["C0"] * len(held.forces), strict=True), (np.array([held.load, 0.0]), WARNING)]
            for force, colour in arrows:
                if not force.any():
                    continue
                way = plane(force) / largest * 2.5 * radius
                start = centre if colour == WARNING else centre - way
                axes.annotate("", start + way, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.6})
            axes.set_aspect("equal")
            axes.autoscale_view()
            axes.set(xlabel="across the load, mm", ylabel="against the load, mm")
            pressure = f"{held.pressure / made.case.cm:.4g} cm of water"
            press = ", ".join(f"{force * 1e3:.3g}" for force in held.press)
            figure.supxlabel("arrows: force of each finger on the object, and its load (downwards)", fontsize="small")
            axes.set_title(
                f"{pressure}, load {held.load * 1e3:.3g} mN\nfingers press with {press} mN", fontsize="medium"
            )
    return figure


def scatter_figure(
    limits: Sequence[tuple[Mapping[str, float], float]],
    tolerances: Sequence[Tolerance],
    what: str,
    nominal: float,
    working: float | None,
) -> Figure:
    """Plot the distribution of the limit, and the limit over each parameter.

    Args:
        limits: Parameters (SI) and limit pressure (cm of water) of each device.
        tolerances: The parameters, in the order of their panels.
        what: What the pressure is, such as ``"limit pressure"``; for the axes.
        nominal: Limit of the device as drawn, in cm.
        working: Working pressure in cm, or None.
    """
    label = f"{what}, cm of water"
    pressures = np.sort([pressure for _, pressure in limits])
    with matplotlib.rc_context(STYLE):
        figure = Figure((WIDTH, 4.8 if len(tolerances) < 3 else 4.4), dpi=DPI, layout="constrained")
        axes = figure.subplots(1, 1 + len(tolerances))
        share = (np.arange(len(pressures)) + 0.5) / len(pressures) * 100
        axes[0].step(pressures, share, where="mid", color=CURVE)
        for percent in (5, 50, 95):
            axes[0].plot(np.percentile(pressures, percent), percent, "o", color=INK, markersize=5)
        axes[0].axvline(nominal, color=FAINT, linestyle="--", label=f"nominal: {nominal:.3g} cm")
        if working is not None:
            axes[0].axvline(working, color=WARNING, label=f"working: {working:.3g} cm")
        axes[0].set(xlabel=label, ylabel="devices below it, %", ylim=(0, 100))
        axes[0].legend(loc="best", fontsize=9)
        for place, tolerance in zip(axes[1:], tolerances, strict=True):
            factor, unit = SHOWN[tolerance.unit]
            values = [changes[tolerance.name] * factor for changes, _ in limits]
            place.plot(values, [pressure for _, pressure in limits], "o", color=CURVE, markersize=4)
            place.set(xlabel=f"{tolerance.name.replace('_', ' ')}{unit}", ylabel=label)
    return figure


# ----------------------------------------------------------------------------------------------------------------------
# Pictures of ``softmodels modes``: natural frequencies over the pressure, and the shapes of the first modes.
#
# Solids are rendered in a separate process, because VTK and DOLFINx each bring their own HDF5.


AMOUNT = 0.15
"""Largest displacement of a mode as drawn, in sizes of the slice, unless walls meet before."""
SMALLER = 0.6 ** np.arange(7)
"""Shares of it that are tried until no walls of a solid pass through each other."""
DRAWN = 4
"""Maximum number of modes drawn."""


@dataclasses.dataclass(frozen=True, eq=False)
class SolidShapes:
    """What is rendered of a slice, by surface vertices.

    Attributes:
        before: The state, m, shape (v, 3).
        bent, normals: The state with each mode added, and its normals, shape (modes, v, 3).
        triangles, edges: Vertices, shape (t, 3) and (e, 2).
        up, towards: Up in the picture, and from the slice to the viewer.
    """

    before: Array
    bent: Array
    normals: Array
    triangles: Cells
    edges: Cells
    up: Array
    towards: Array


def frequency_figure(pressures: Array, frequencies: Array, sealed: bool) -> Figure:
    """Plot the frequencies in Hz, shape (states, modes), over the pressures in cm; of a single state as bars."""
    with matplotlib.rc_context(STYLE):
        figure = Figure((WIDTH, 5.0), dpi=DPI, layout="constrained")
        axes = figure.subplots()
        numbers = range(1, frequencies.shape[1] + 1)
        if len(pressures) == 1:
            axes.bar(numbers, frequencies[0], width=0.5)
            axes.set(xlabel="mode", xticks=list(numbers))
        else:
            # In order of size on both sides of a crossing, where modes change places.
            for number, column in zip(numbers, frequencies.T, strict=True):
                axes.plot(pressures, column, marker="o", markersize=4, label=f"f{number}")
            axes.legend(loc="best")
            axes.set(xlabel="pressure, cm of water")
        axes.set(ylabel=f"natural frequency{', cavities sealed' if sealed else ''}, Hz", ylim=(0.0, None))
    return figure


def section_shapes(moved: Array, shapes: Sequence[Array], cells: Cells, titles: Sequence[str]) -> Figure:
    """Draw an axisymmetric section in its first modes, over its outline without them.

    Args:
        moved: Nodes of the state in m, shape (n, 3) with y = 0.
        shapes: The modes, largest entry 1, shape (n, 3) each.
        cells: Shape (c, 6).
        titles: Of each mode.
    """
    flat = moved[:, ::2] * 1e3
    size = AMOUNT * np.ptp(flat[:, 0])
    bent = [flat + size * shape[:, ::2] for shape in shapes]
    low, high = np.min([flat, *bent], axis=(0, 1)), np.max([flat, *bent], axis=(0, 1))
    shape_of_panel = (high - low)[1] / (high - low)[0]
    columns = 2 if shape_of_panel < 0.8 else DRAWN
    rows = -(-len(shapes) // columns)
    with matplotlib.rc_context({**STYLE, "font.size": 10, "axes.titlesize": 10}):
        tall = rows * (min(WIDTH / columns * shape_of_panel, WIDTH) + 0.6)
        figure = Figure((WIDTH, tall), dpi=DPI, layout="constrained")
        for place, shape, title in zip(figure.subplots(rows, columns, squeeze=False).flat, bent, titles, strict=False):
            for shown, colour in ((flat, FAINT), (shape, INK)):
                place.add_collection(LineCollection(list(outline(shown, cells)), colors=colour, linewidths=1.4))
            place.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", title=title)
        for place in list(figure.axes)[len(shapes) :]:
            place.remove()
        figure.supxlabel("radius in mm")
        figure.supylabel("height in mm")
    return figure


def solid_shapes(
    points: Array, cells: Cells, cell_name: str, actuator: Actuator, moved: Array, shapes: Sequence[Array]
) -> SolidShapes:
    """Return what `main` renders of a slice.

    Args:
        points: Undeformed nodes in m, shape (n, 3).
        cells: Shape (c, 10).
        cell_name: XDMF's name of the cells.
        actuator: The device.
        moved: Nodes of the state in m.
        shapes: The modes.
    """
    skin, up = surface_of(points, cells, cell_name, actuator), np.asarray(actuator.lift)
    size = AMOUNT * np.ptp(points, axis=0).max()
    walls = FacingWalls(points, cells, cell_name, [plane.normal for plane in actuator.cut_planes])
    bent = np.array([skin.points(moved + _apart(walls, moved - points, size * shape)) for shape in shapes])
    whole = direction(*((-45.0, 32.0) if actuator.axial else (-58.0, 24.0)), up)
    return SolidShapes(
        before=skin.points(moved),
        bent=bent,
        normals=np.array([skin.normals(one) for one in bent]),
        triangles=skin.triangles,
        edges=np.concatenate([skin.edges, skin.rims]),
        up=up,
        towards=across_cut(skin, up) if len(skin.planes) else whole,
    )


def _apart(walls: FacingWalls, displacement: Array, shape: Array) -> Array:
    """Return a mode as large, and of that sign, as makes no walls pass through each other."""
    for share in SMALLER:
        for sign in (1.0, -1.0):
            if not walls.cross(displacement + sign * share * shape):
                return sign * share * shape
    return SMALLER[-1] * shape


def draw_solids(told: SolidShapes, titles: Sequence[str]) -> Figure:
    """Render what `solid_shapes` has made."""
    camera, edges = ViewCamera.around([told.before, *told.bent], told.towards, told.up), told.edges
    with studio(camera) as shoot:
        images = [
            shoot(
                [
                    (surface(bent, told.triangles, normals), {**SOLID_STYLE, "color": SOLID}),
                    (lines(bent, edges), {"color": INK, "line_width": 2.0}),
                    (lines(told.before, edges), {"color": FAINT, "line_width": 1.5}),
                ]
            )
            for bent, normals in zip(told.bent, told.normals, strict=True)
        ]
    return tiled(list(zip(titles, images, strict=True)))


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("shapes", type=click.Path(path_type=Path))
@click.argument("picture", type=click.Path(path_type=Path))
@click.argument("titles", nargs=-1)
def main(shapes: Path, picture: Path, titles: tuple[str, ...]) -> None:
    """Render the SHAPES, a file of numpy, into a PICTURE; each has one of the TITLES."""
    if not can_render():
        say("this machine cannot render (no OpenGL)", err=True)
        sys.exit(1)
    with np.load(shapes) as told:
        write_bytes(picture, png(draw_solids(SolidShapes(**told), titles)))


if __name__ == "__main__":
    main()
