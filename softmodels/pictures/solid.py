"""Devices drawn: in a half section by matplotlib, in space by rendering, as a film."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import importlib.util
import io
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation
from PIL import Image as Picture, ImageDraw, ImageFont

from geometries import Actuator
from softmodels.case.entries import CaseError
from softmodels.common import files
from softmodels.common.arrays import Array
from softmodels.common.lazy import pyvista
from softmodels.pictures import offscreen, style
from softmodels.runs import grid, labels, states
from softmodels.runs.states import StoredStates
from softmodels.runs.store import ResultsError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pyvista import PolyData


# ----------------------------------------------------------------------------------------------------------------------
# Pictures of an axisymmetric section in millimetres; no rendering needed.


def section_mesh(look: offscreen.Look) -> Figure:
    """Draw the undeformed half section with the edges of its cells."""
    flat, cells = look.states.points[:, ::2] * 1e3, look.states.cells
    figure, axes = _section_axes(flat, 0.0, f"Undeformed half section, {len(cells)} cells", look.caption(0).subject)
    around = grid.parabolas(flat[cells[:, grid.EDGES]].reshape(-1, 3, 2), 8).reshape(len(cells), -1, 2)
    axes.add_collection(PolyCollection(list(around), facecolors=style.SOLID, edgecolors=style.EDGE, linewidths=0.9, zorder=2))
    return figure


def section_stress(look: offscreen.Look, step: float, plate: float | None = None) -> Figure:
    """Draw the deformed half section coloured by stress, over the undeformed outline, with a rigid plane at a height in m
    that stops it."""
    states, scale, caption = look.states, look.scales["von_mises"], look.caption(step)
    title = caption.title + ("" if plate is None else "; the rigid plane dashed")
    figure, axes = _section_axes(_section_points(states, step), style.FOOT_INCHES, title, caption.subject)
    _coloured_section(axes, states, step, scale)
    if plate is not None:
        axes.axhline(plate * 1e3, color=style.WARNING, linewidth=1.5, linestyle="--")
    scale.bar(figure, look.largest(scale, step))
    return figure


def _section_points(states: StoredStates, step: float) -> Array:
    """Return the nodes of a half section in mm, at rest and at a step."""
    return np.concatenate([states.points, states.moved(step)])[:, ::2] * 1e3


def _coloured_section(axes: Axes, states: StoredStates, step: float, scale: style.Scale) -> None:
    """Draw a deformed half section in the colours of a field, over the undeformed outline."""
    after, values = states.moved(step)[:, ::2] * 1e3, scale.factor * states.field(step, scale.field)
    fine, triangles = grid.fine_triangles(np.column_stack([after, values]), states.cells)
    flat = Triangulation(fine[:, 0], fine[:, 1], triangles)
    axes.tripcolor(flat, fine[:, 2], shading="gouraud", cmap=scale.colours, norm=scale.norm)
    for shown, colour in ((after, style.INK), (states.points[:, ::2] * 1e3, style.FAINT)):  # thin, as walls may be
        axes.add_collection(LineCollection(list(grid.outline(shown, states.cells)), colors=colour, linewidths=0.6))


def section_sheet(look: offscreen.Look) -> Figure:
    """Draw the half sections of the shown states side by side over one colour bar."""
    states, steps, scale = look.states, look.states.shown(), look.scales["von_mises"]
    flat = np.concatenate([states.points, *(states.moved(step) for step in steps)])[:, ::2] * 1e3
    low, (wide, tall) = flat.min(axis=0), np.ptp(flat, axis=0)
    columns = COLUMNS[len(steps)] if tall < 1.2 * wide else len(steps)
    titles = [style.wrapped(labels.load(states.row(step), states.words), style.WIDTH_INCHES / columns, 11) for step in steps]
    inner = style.WIDTH_INCHES / columns - 0.4
    head = max(0.55, 0.15 + 1.25 * 11 / 72 * max(1 + title.count("\n") for title in titles))
    height = min(inner * tall / wide, 5.0)
    used, rows = height * wide / tall, -(-len(steps) // columns)
    whole = rows * (height + head) + 0.35 + style.FOOT_INCHES
    figure = Figure((style.WIDTH_INCHES, whole), dpi=style.DPI)
    for k, (step, title) in enumerate(zip(steps, titles, strict=True)):
        left, down = (k % columns + 0.5) * style.WIDTH_INCHES / columns - used / 2, 0.3 + (height + head) * (k // columns + 1)
        axes = figure.add_axes((left / style.WIDTH_INCHES, 1 - down / whole, used / style.WIDTH_INCHES, height / whole))
        _coloured_section(axes, states, step, scale)
        axes.set(xlim=(low[0], low[0] + wide), ylim=(low[1], low[1] + tall))
        axes.set_axis_off()
        axes.set_title(title, fontsize=11, color=style.title_colour(title))
    name = look.caption(states.main).subject
    figure.text(0.5, 1 - 0.08 / whole, name, ha="center", va="top", fontsize=11, color=style.EDGE)
    scale.bar(figure, look.largest(scale, *steps))
    style.rulers(figure, 1e-3 * tall / (height * style.DPI), np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]]))
    return figure


def section_hot(look: offscreen.Look) -> Figure:
    """Draw the deformed half section coloured by stretch, with a ring around the largest one."""
    states, step, scale = look.states, look.states.main, look.scales["largest_stretch"]
    hot, points = offscreen.hot_spot(states, step), _section_points(states, step)
    figure, axes = _section_axes(points, style.FOOT_INCHES + 0.3, hot_title(hot), look.caption(step).subject)
    _coloured_section(axes, states, step, scale)
    x, _, z = 1e3 * hot.place
    for colour, wide in (("white", 5.0), ("black", 2.0)):
        axes.plot(x, z, "o", mfc="none", color=colour, markersize=16, markeredgewidth=wide)
    figure.text(0.5, 1.2 / figure.get_figheight(), hot.note, ha="center", color=style.WARNING, fontsize=11)
    scale.bar(figure, look.largest(scale, step))
    return figure


def hot_title(hot: offscreen.HotSpot) -> str:
    """Return the title of the picture."""
    return f"Largest stretch {hot.value:.4g}, {hot.wall}"


def section_mode(look: offscreen.Look, step: int, amount: float = 0.15) -> Figure:
    """Draw the half section at a bifurcation and the two branches; the mode's largest displacement is an amount of widths of
    the undeformed section."""
    states, cells = look.states, look.states.cells
    before, after = states.points[:, ::2] * 1e3, states.moved(step)[:, ::2] * 1e3
    mode = amount * np.ptp(before[:, 0]) * states.field(step, "mode")[:, ::2]
    shapes = [(before, style.FAINT), (after, style.INK), (after + mode, style.WARNING), (after - mode, style.CURVE)]
    caption = look.caption(step)
    title = style.wrapped(
        f"Bifurcation at {caption.title}: the mode in both directions (arbitrary amplitude)", style.WIDTH_INCHES, 13
    )
    everything = np.concatenate([shape for shape, colour in shapes if colour != style.INK])
    figure, axes = _section_axes(everything, 0.0, title, caption.subject)
    for shown, colour in shapes:
        axes.add_collection(LineCollection(list(grid.outline(shown, cells)), colors=colour, linewidths=1.4))
    return figure


def _section_axes(points: Array, foot: float, title: str, subject: str) -> tuple[Figure, Axes]:
    """Return the axes in mm with equal scales around flat points, shape (n, 2), with ``foot`` inches free below them, under a
    title and what is drawn."""
    (left, low), (right, high) = points.min(axis=0), points.max(axis=0)
    margin = 0.04 * (right - left)
    wide, tall = right - left + 2 * margin, high - low + 2 * margin
    height = min(8.6 * tall / wide, 6.4)
    head, below = 0.55, foot + 0.75
    whole = head + height + below
    figure = Figure((style.WIDTH_INCHES, whole), dpi=style.DPI)
    used = height * wide / tall / style.WIDTH_INCHES
    axes = figure.add_axes(((1.0 - used) / 2 + 0.02, below / whole, used, height / whole))
    axes.set(xlim=(left - margin, right + margin), ylim=(low - margin, high + margin))
    axes.set(xlabel="radius in mm", ylabel="height in mm")
    axes.axvline(0.0, color=style.FAINT, linestyle=(0, (8, 3, 1, 3)), linewidth=1.0)
    axes.grid(False)
    axes.set_title(title, pad=22, color=style.title_colour(title))
    figure.text(0.5, (below + height + 0.06) / whole, subject, ha="center", va="bottom", fontsize=11, color=style.EDGE)
    return figure, axes


# ----------------------------------------------------------------------------------------------------------------------
# The pictures of the solid: undeformed, von Mises stress at some pressures, a cut through the channels, hot spots.
#
# A plane cut through the undeformed device that shows most of its channels, and the remaining part.
#
# The cut is made in the material, so it deforms into a curved surface.


QUADRATIC_TETRA = 24
CUT_OFFSET = 1e-4
"""Offset of a cut from vertices, relative to the device's size: invisible, but above rounding."""
Plane = tuple[Array, Array]
"""A unit normal and a point in m."""


def best_plane(skin: grid.Surface, points: Array, up: Array, axial: bool, motion: Array | None = None) -> Plane:
    """Return the plane normal to a coordinate axis (only along ``up`` if ``axial``) that cuts the most cavities, and of these
    the most air; undeformed nodes in m, shape (n, 3). A device that bends by its displacements ``motion``, shape (n, 3), is
    cut in the plane of the bend."""
    vertices = skin.device(skin.points(points))
    count = max(skin.cavities, 1)
    cavities = [vertices[skin.device_triangles(skin.part == k)] for k in range(1, count + 1)]
    corners = np.concatenate(cavities) if skin.cavities else vertices[skin.device_triangles(skin.part == grid.OUTSIDE_LABEL)]
    places = [_centre(corners), *(_centre(walls) for walls in cavities if len(walls))]
    best, most = (np.eye(3)[1], places[0]), (-1, -1.0)
    bend = None if motion is None else _normal_to_bend(points, motion)
    for axis, normal in enumerate(np.eye(3)):
        if (axial and abs(normal @ up) > 0.5) or bend not in (None, axis):
            continue
        for place in places:
            areas = [_section_area(walls, normal, place) for walls in cavities]
            met = (sum(area > 0 for area in areas), sum(areas))
            if met[0] > most[0] or (met[0] == most[0] and met[1] > 1.01 * most[1]):
                best, most = (normal, place), met
    return best


def _normal_to_bend(points: Array, motion: Array) -> int | None:
    """Return the axis normal to the plane in which a device bends: where it moves grows along another; None without a bend."""
    main = int(np.argmax((motion**2).sum(axis=0)))
    with np.errstate(invalid="ignore"):  # at rest
        grows = {k: abs(np.corrcoef(points[:, k], motion[:, main])[0, 1]) for k in range(3) if k != main}
    return min(grows, key=grows.__getitem__) if max(grows.values()) > 0.7 else None


def _centre(corners: Array) -> Array:
    """Return the middle of a surface; corners of its triangles, shape (t, 3, 3)."""
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return np.asarray(np.average(corners.mean(axis=1), axis=0, weights=area))


def _section_area(corners: Array, normal: Array, place: Array) -> float:
    """Return the area that a plane cuts out of a closed surface; corners of its triangles, shape (t, 3, 3)."""
    height = (corners - place) @ normal + 1e-12
    above = height > 0
    met = corners[above.any(axis=1) & ~above.all(axis=1)]
    if not len(met):
        return 0.0
    height = (met - place) @ normal + 1e-12
    begin, end = np.zeros((len(met), 3)), np.zeros((len(met), 3))
    for k in range(3):
        a, b = height[:, k, None], height[:, (k + 1) % 3, None]
        crossed = (a > 0) != (b > 0)
        at = met[:, k] + np.where(crossed, a / np.where(crossed, a - b, 1.0), 0.0) * (met[:, (k + 1) % 3] - met[:, k])
        begin, end = np.where(crossed & (a > 0), at, begin), np.where(crossed & (a <= 0), at, end)
    return float(abs((np.cross(begin - place, end - place) @ normal).sum()) / 2)


def cut_open(states: StoredStates, step: float, plane: Plane, viewer: Array, scale: style.Scale) -> list[offscreen.Layer]:
    """Return the layers of a state whose material before a plane of the undeformed device is taken away; the cut is turned to
    the viewer."""
    normal, place = plane
    normal = normal if normal @ viewer > 0 else -normal
    skin = states.skin
    place = _point_beside(skin.device(skin.points(states.points)), normal, place)
    u, values = states.field(step, "displacement"), scale.share(states.field(step, scale.field))
    shell = offscreen.surface(skin.device(skin.points(states.points)), skin.device_triangles(skin.part != grid.CUT_LABEL))
    shell.point_data["displacement"] = skin.device(skin.points(u))
    shell.point_data["values"] = np.tile(values[skin.nodes], len(skin.images))
    painted: offscreen.Style = {"scalars": "values", "cmap": scale.colours, "clim": (0.0, 1.0)}
    layers: list[offscreen.Layer] = [(shell.clip(normal=normal, origin=place).warp_by_vector("displacement"), painted)]
    rest, moved, shares, faces, count = list[Array](), list[Array](), list[Array](), list[grid.Cells](), 0
    for image in skin.images:
        piece = _section(states.points, states.cells, u, values, image.T @ normal, image.T @ place)
        if piece.n_cells:
            faces.append(piece.regular_faces + count)
            count += piece.n_points
            rest.append(piece.points @ image.T)
            moved.append((piece.points + piece.point_data["displacement"]) @ image.T)
            shares.append(piece.point_data["values"])
    if faces:
        # Images of the slice meet in their symmetry plane: one face, so that no edge is drawn there.
        corners = offscreen.joined_places(np.concatenate(rest), states.actuator.size)[np.concatenate(faces)]
        points = np.concatenate(moved)
        layers.append((offscreen.surface(points, corners, None, np.concatenate(shares)), painted))
        layers += offscreen.seen_lines(points, border_of(corners))
    return layers


def border_of(triangles: grid.Cells) -> grid.Cells:
    """Return the edges that belong to a single triangle, shape (e, 2)."""
    ends = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    ends = ends[ends[:, 0] < ends[:, 1]]
    edges, count = np.unique(ends, axis=0, return_counts=True)
    return np.asarray(edges[count == 1])


def _point_beside(vertices: Array, normal: Array, place: Array) -> Array:
    """Return a point a little deeper than a plane on which vertices lie, such as a symmetry plane of the device.

    There the plane would meet the faces of cells, some once and some twice, and the section would have cracks.
    """
    size = np.ptp(vertices, axis=0).max()
    on_plane = np.abs((vertices - place) @ normal) < 1e-6 * size
    return place - CUT_OFFSET * size * normal if on_plane.any() else place


def _section(points: Array, cells: grid.Cells, u: Array, values: Array, normal: Array, place: Array) -> PolyData:
    """Return where a plane meets the solid."""
    grid = pyvista.UnstructuredGrid({QUADRATIC_TETRA: cells}, points)
    grid.point_data["displacement"], grid.point_data["values"] = u, values
    return grid.slice(normal=normal, origin=place).extract_surface(algorithm="dataset_surface").triangulate()


AIR_COLOUR = "#2f6f9f"
COLUMNS = {1: 1, 2: 2, 3: 3, 4: 2}
"""Columns of the sheet for each number of pictures."""


def undeformed(look: offscreen.Look) -> Figure:
    """Draw the undeformed device, translucent, with its cavity walls (thesis, Fig. 8)."""
    states = look.states
    whole = states.skin.device(states.skin.points(states.points))
    camera = offscreen.ViewCamera.around([whole], look.direction, look.up)
    with offscreen.studio(camera) as shoot:
        image = shoot(look.translucent(0, {"color": AIR_COLOUR}, {"opacity": 0.35, "culling": "back"}))
    count = states.skin.cavities
    what = {0: "", 1: ", its cavity inside"}.get(count, f", its {count} cavities inside")
    return style.page(image, look.caption(0, camera, title=f"Undeformed device{what}: {_size(whole)}"))


def _size(points: Array) -> str:
    return " x ".join(labels.number(length * 1e3) for length in np.ptp(points, axis=0)) + " mm"


def mesh(look: offscreen.Look) -> Figure:
    """Draw the undeformed slice with the edges of its cells."""
    states = look.states
    skin, points = states.skin, states.skin.points(states.points)
    faces = grid.outer_faces(states.cells, states.cell_name)
    curves = grid.edge_curves(states.points, faces, 2)
    pairs = np.arange(curves.shape[0] * 3).reshape(-1, 3)[:, [[0, 1], [1, 2]]].reshape(-1, 2)
    camera = offscreen.ViewCamera.around([points], offscreen.towards_slice(states), look.up)
    with offscreen.studio(camera) as shoot:
        solid = offscreen.surface(points, skin.triangles, skin.normals(points))
        edges = offscreen.lines(curves.reshape(-1, 3), pairs)
        image = shoot(
            [(solid, {**offscreen.SOLID_STYLE, "color": style.SOLID}), (edges, {"color": style.EDGE, "line_width": 1.0})]
        )
    title = f"Undeformed {_slice_name(states.actuator)}, {len(states.cells)} cells"
    return style.page(image, look.caption(0, camera, title=title))


def _slice_name(actuator: Actuator) -> str:
    if actuator.copies == 1:
        return "device"
    return f"{360 / actuator.copies:g}° slice" if actuator.axial else {2: "half"}.get(actuator.copies, "slice")


def slice_stress(look: offscreen.Look) -> Figure:
    """Draw the deformed slice seen on its cut, coloured by stress, with the undeformed edges."""
    states, step, scale = look.states, look.states.main, look.scales["von_mises"]
    skin = states.skin
    rest, moved = skin.points(states.points), skin.points(states.moved(step))
    values = scale.share(states.field(step, scale.field))[skin.nodes]
    edges = np.concatenate([skin.edges, skin.rims])
    painted: offscreen.Style = {"culling": "back", "scalars": "values", "cmap": scale.colours, "clim": (0.0, 1.0)}
    camera = offscreen.ViewCamera.around([rest, moved], offscreen.towards_slice(states), look.up)
    with offscreen.studio(camera) as shoot:
        image = shoot(
            [
                (offscreen.surface(moved, skin.triangles, None, values), painted),
                *offscreen.seen_lines(moved, edges),
                (offscreen.lines(rest, edges), {"color": style.FAINT, "line_width": 2.0}),
                *look.plate_layers(step),
            ]
        )
    return style.page(image, look.caption(step, camera, scale), scale)


def mode(look: offscreen.Look, step: int, amount: float = 0.15) -> Figure:
    """Draw the slice at a bifurcation with its mode added, largest an amount of sizes of the slice, over the edges of the
    slice without it."""
    states, skin = look.states, look.states.skin
    size = amount * np.ptp(states.points, axis=0).max()
    before, moved = (skin.points(states.moved(step) + share * size * states.field(step, "mode")) for share in (0.0, 1.0))
    edges = np.concatenate([skin.edges, skin.rims])
    camera = offscreen.ViewCamera.around([before, moved], offscreen.towards_slice(states), look.up)
    with offscreen.studio(camera) as shoot:
        image = shoot(
            [
                (
                    offscreen.surface(moved, skin.triangles, skin.normals(moved)),
                    {**offscreen.SOLID_STYLE, "color": style.SOLID},
                ),
                (offscreen.lines(moved, edges), {"color": style.INK, "line_width": 2.0}),
                (offscreen.lines(before, edges), {"color": style.FAINT, "line_width": 2.0}),
            ]
        )
    title = f"Bifurcation at {labels.headline(states.rows[step], states.words)}: the mode (arbitrary amplitude)"
    return style.page(image, look.caption(step, camera, title=title))


def stress(look: offscreen.Look) -> tuple[list[tuple[float, offscreen.Image]], offscreen.ViewCamera]:
    """Draw the von Mises stress on the deformed device at the shown states, with the same camera and colour scale; return
    steps and images, with the undeformed outline, and the camera."""
    steps, scale = look.states.shown(), look.scales["von_mises"]
    camera = look.camera([0, *steps])
    with offscreen.studio(camera) as shoot:
        rest = look.at_rest(shoot, look.kept)
        images = offscreen.outlined([shoot(look.coloured(step, scale)) for step in steps], rest)
    return list(zip(steps, images, strict=True)), camera


def sheet(images: list[tuple[float, offscreen.Image]], look: offscreen.Look, camera: offscreen.ViewCamera) -> Figure:
    """Return the images of `stress` side by side over one colour bar."""
    states = look.states
    named = [(labels.load(states.row(step), states.words), image) for step, image in images]
    figure = tiled(named, style.FOOT_INCHES, look.caption(states.main).subject)
    scale = look.scales["von_mises"]
    scale.bar(figure, look.largest(scale, *(step for step, _ in images)))
    style.rulers(figure, COLUMNS[len(images)] * camera.metres, camera.axes)
    return figure


def tiled(images: Sequence[tuple[str, offscreen.Image]], foot: float = 0.0, name: str = "") -> Figure:
    """Return up to four images side by side under their titles and a name, with ``foot`` inches free below them."""
    columns = COLUMNS[len(images)]
    rows_ = -(-len(images) // columns)
    wide = style.WIDTH_INCHES / columns
    tall = wide * images[0][1].shape[0] / images[0][1].shape[1]
    titles = [style.wrapped(title, wide, 12) for title, _ in images]
    head = 0.4 + 0.2 * max(title.count("\n") for title in titles)
    above = 0.3 if name else 0.0
    whole = rows_ * (tall + head) + above + foot
    figure = Figure((style.WIDTH_INCHES, whole), dpi=style.DPI)
    figure.text(0.5, 1 - 0.1 / whole, name, ha="center", va="top", fontsize=11, color=style.EDGE)
    for k, (_, image) in enumerate(images):
        left, top = k % columns * wide, whole - above - k // columns * (tall + head)
        small = Picture.fromarray(image).resize((round(wide * style.DPI), round(tall * style.DPI)), Picture.Resampling.BOX)
        figure.add_artist(style.Pixels(np.asarray(small), round(left * style.DPI), round((top - head - tall) * style.DPI)))
        place = (left + wide / 2) / style.WIDTH_INCHES, (top - 0.6 * head) / whole
        figure.text(*place, titles[k], ha="center", va="center", color=style.title_colour(titles[k]))
    return figure


def cut(look: offscreen.Look) -> Figure:
    """Draw the device cut open through its channels, with the von Mises stress on the cut."""
    states, step, scale = look.states, look.states.main, look.scales["von_mises"]
    u = states.field(step, "displacement")
    plane = best_plane(states.skin, states.points, look.up, states.actuator.axial, u)
    towards = plane[0] if plane[0] @ look.direction > 0 else -plane[0]
    direction = 0.8 * towards + 0.6 * look.direction
    layers = cut_open(states, step, plane, towards, scale) + look.plate_layers(step)
    axis = int(np.argmax(np.abs(plane[0])))
    where = f"; cut at {'xyz'[axis]} = {labels.number(plane[1][axis] * 1e3)} mm"
    clouds = [np.asarray(data.points) for data, _ in layers]
    camera = offscreen.ViewCamera.around(clouds, direction, look.up if abs(direction @ look.up) < 0.99 else np.eye(3)[0])
    with offscreen.studio(camera) as shoot:
        image = shoot(layers)
    caption = look.caption(step, camera, scale)
    return style.page(image, dataclasses.replace(caption, title=caption.title + where), scale)


def hot_spots(look: offscreen.Look) -> Figure:
    """Draw the wall with the largest stretch, coloured by stretch, and a ring around its place.

    Of a cavity the device is drawn translucent around its coloured walls, otherwise its outside is coloured.
    """
    states, step, scale = look.states, look.states.main, look.scales["largest_stretch"]
    skin, hot, everything = states.skin, offscreen.hot_spot(states, step), np.arange(len(states.skin.images))
    outside = hot.part == grid.OUTSIDE_LABEL or not skin.cavities
    points = skin.device(skin.points(states.moved(step)))
    values = np.tile(scale.share(states.field(step, scale.field))[skin.nodes], len(skin.images))
    walls = skin.device_triangles(skin.part == grid.OUTSIDE_LABEL if outside else skin.part > grid.OUTSIDE_LABEL)
    painted: offscreen.Style = {"scalars": "values", "cmap": scale.colours, "clim": (0.0, 1.0)}
    layers = [(offscreen.surface(points, walls, None, values), painted)]
    # Of the translucent outside only what is behind the walls, whose colours are those of the bar.
    layers += look.translucent(step, None, {"opacity": 0.0 if outside else 0.3, "culling": "front"})
    camera = offscreen.ViewCamera.around([points, look.rest(everything)], look.direction, look.up)
    places = skin.images @ hot.place  # of the equal places in the images of the slice, the one nearest to the viewer
    nearest = places[np.argmax(places @ look.direction)] + 3 * camera.scale * look.direction
    circle = offscreen.ring(nearest, look.direction, 0.05 * camera.scale)  # in front of everything
    layers += [(circle, {"color": colour, "line_width": wide}) for colour, wide in (("white", 7.0), ("black", 3.0))]
    with offscreen.studio(camera) as shoot:
        (image,) = offscreen.outlined([shoot(layers)], look.at_rest(shoot, everything))
    return style.page(image, look.caption(step, camera, scale, title=hot_title(hot), note=hot.note), scale)


# ----------------------------------------------------------------------------------------------------------------------
# Pictures of the undeformed device, drawn while its path is still being solved.


class AtRest:
    """Pictures of a device at rest, drawn once."""

    def __init__(self) -> None:
        self._of: offscreen.Look | None = None
        self._drawn: dict[str, bytes] = {}

    def draw_early(self, folder: Path, name: str) -> None:
        """Draw them from the first states of results with their ``case.toml``; errors are reported when all is drawn."""
        with contextlib.suppress(ResultsError, CaseError, OSError):
            self.pictures(offscreen.look(states.FolderStates(folder, name)))

    def pictures(self, shown: offscreen.Look) -> dict[str, bytes]:
        """Return PNG files by their stems, drawn now unless already drawn of this device."""
        if self._of is None or not _same_view(self._of, shown):
            figures = {}
            with matplotlib.rc_context(style.STYLE):
                if shown.states.actuator.dimension == 2:
                    figures["mesh"] = section_mesh(shown)
                elif offscreen.can_render():
                    figures = {"undeformed": undeformed(shown), "mesh": mesh(shown)}
                self._of, self._drawn = shown, {stem: style.png(figure) for stem, figure in figures.items()}
        return self._drawn


def _same_view(first: offscreen.Look, other: offscreen.Look) -> bool:
    pairs = [(look.states.points, look.states.cells, look.kept, look.direction) for look in (first, other)]
    return first.states.actuator == other.states.actuator and all(map(np.array_equal, *pairs))


# ----------------------------------------------------------------------------------------------------------------------
# The film of a run: the device over its whole path, with fixed camera and colour scale, and the pressure as caption.
#
# A GIF with 256 colours, which plays everywhere; a smaller animated WebP in full colour, which browsers play and the report
# shows. An MP4 too if the package imageio-ffmpeg is installed.


MAX_FRAMES = 40
FRAME_COUNTS = (40, 32, 25, 19, 14, 10)
"""Numbers of frames tried until the GIF is small enough: fewer frames are better than colour banding."""
FRAME_WIDTH_PX = 960
SIZE_SAMPLE_FRAMES = 4
"""Number of frames to estimate the size of one in a GIF."""
MAX_GIF_BYTES = 6_000_000
WEBP_QUALITY = 80
"""Quality of the WebP: below, shading shows blocks."""
MOTION_SECONDS = 4.0
"""Seconds from the first to the last frame, and the duration of the last."""
LAST_FRAME_SECONDS = 1.2
FILM_HEAD, FILM_FOOT = 48, 64
"""Pixels above and below the device, for the pressure and the colours."""


def render_frames(look: offscreen.Look, count: int = MAX_FRAMES) -> list[offscreen.Image]:
    """Return pictures of states evenly spaced along the path (see `States.along`), interpolated linearly between steps."""
    states, scale = look.states, look.scales["von_mises"]
    last = len(states.rows) - 1
    camera = look.camera(sorted({0, *states.shown(8), states.main, last}), FRAME_WIDTH_PX, tallest=0.75)
    count = count if states.loaded and last else 1
    frames = []
    with offscreen.studio(camera) as shoot:
        for place in np.linspace(0.0, 1.0, count):
            step = float(np.interp(place, states.along, range(last + 1))) if count > 1 else float(last)
            row, words = states.row(step), states.words
            text = f"{labels.load(row, words, kilopascals=False)}   {words.gauge} rise {row.told(words.gauge, '+.2f')}"
            frames.append(_captioned_frame(shoot(look.coloured(step, scale)), text, scale))
    return frames


def _captioned_frame(image: offscreen.Image, text: str, scale: style.Scale) -> offscreen.Image:
    """Return a frame with its caption above and its colour bar below."""
    height, width, _ = image.shape
    framed = Picture.new("RGB", (width, 2 * ((height + FILM_HEAD + FILM_FOOT) // 2)), "white")
    framed.paste(Picture.fromarray(image), (0, FILM_HEAD))
    pen, font = ImageDraw.Draw(framed), ImageFont.load_default(28)
    pen.text((width / 2, FILM_HEAD / 2), text, fill="#102a43", font=font, anchor="mm")
    colours = (scale.colours(np.linspace(0, 1, width // 3))[:, :3] * 255).astype(np.uint8)
    top = framed.height - FILM_FOOT + 26
    left = (width - len(colours)) // 2
    framed.paste(Picture.fromarray(np.repeat(colours[None], 18, axis=0)), (left, top))
    middle, small = top + 9, ImageFont.load_default(22)
    pen.text((left - 12, middle), f"{scale.low:g}", fill="#102a43", font=small, anchor="rm")
    end = f"{scale.top:.3g} {scale.unit} and more".replace("  ", " ")
    pen.text((left + len(colours) + 12, middle), end, fill="#102a43", font=small, anchor="lm")
    return np.asarray(framed)


def gif(images: list[offscreen.Image]) -> bytes:
    """Return the frames as a GIF of at most `MAX_GIF_BYTES` bytes, dropping frames if necessary."""
    # One common palette avoids flickering colours.
    sample = np.concatenate([image[::4, ::4] for image in [*images[:: max(len(images) // 10, 1)], images[-1]]])
    palette = Picture.fromarray(sample).quantize(256, Picture.Quantize.MAXCOVERAGE)

    @functools.cache
    def in_palette(k: int) -> Picture.Image:
        return Picture.fromarray(images[k]).quantize(palette=palette, dither=Picture.Dither.FLOYDSTEINBERG)

    def encoded(places: Sequence[int]) -> bytes:
        return _animation([in_palette(k) for k in places], "GIF", optimize=False)

    # A few sample frames estimate the size, to avoid encoding all of them repeatedly.
    some = sorted({int((k + 0.5) / SIZE_SAMPLE_FRAMES * len(images)) for k in range(SIZE_SAMPLE_FRAMES)})
    each = len(encoded(some)) / len(some)
    begin = next(
        (k for k, count in enumerate(FRAME_COUNTS) if each * min(count, len(images)) <= MAX_GIF_BYTES), len(FRAME_COUNTS) - 1
    )
    for count in FRAME_COUNTS[begin:]:
        places = np.unique(np.linspace(0, len(images) - 1, min(count, len(images))).round().astype(int))
        if len(data := encoded(places.tolist())) <= MAX_GIF_BYTES:
            break
    return data


def webp(images: list[offscreen.Image]) -> bytes:
    """Return the frames as an animated WebP, in all their colours."""
    # Method 2 takes 50 % longer and saves a fifth. Each frame is encoded by itself: skipped small differences show as blocks.
    return _animation([*map(Picture.fromarray, images)], "WEBP", quality=WEBP_QUALITY, method=0, kmin=0, kmax=1)


def _animation(frames: Sequence[Picture.Image], kind: str, **how: object) -> bytes:
    times = [round(1000 * MOTION_SECONDS / len(frames))] * (len(frames) - 1) + [round(1000 * LAST_FRAME_SECONDS)]
    stream = io.BytesIO()
    frames[0].save(stream, kind, save_all=True, append_images=frames[1:], duration=times, loop=0, **how)
    return stream.getvalue()


def can_mp4() -> bool:
    """Return whether an encoder is installed."""
    return importlib.util.find_spec("imageio_ffmpeg") is not None


def write_mp4(path: Path, images: list[offscreen.Image]) -> None:
    """Write frames as an H.264 film that every browser plays; RuntimeError if the encoder failed."""
    import imageio_ffmpeg

    height, width, _ = images[0].shape

    def fill(aside: Path) -> None:
        rate = max(len(images) / MOTION_SECONDS, 1.0)
        writer = imageio_ffmpeg.write_frames(
            str(aside), (width, height), fps=rate, codec="libx264", quality=7, macro_block_size=2,
            output_params=["-f", "mp4", "-movflags", "+faststart"],
        )  # fmt: skip
        writer.send(None)
        for image in [*images, *[images[-1]] * round(rate * LAST_FRAME_SECONDS)]:
            writer.send(np.ascontiguousarray(image))
        writer.close()

    try:
        files.replace(path, fill)
    except (OSError, StopIteration) as error:
        raise RuntimeError(f"the film could not be encoded ({error})") from error


def make_film(shown: offscreen.Look, folder: Path) -> tuple[list[Path], str]:
    """Render the frames and write the film in each format into a folder; return the files, and a sentence if a format was
    left out."""
    frames = render_frames(shown)
    encoders = {"film.gif": gif, "film.webp": webp}
    with ThreadPoolExecutor(len(encoders)) as both:  # encoders are written in C and let each other run
        encoded = {name: both.submit(encoder, frames) for name, encoder in encoders.items()}
    for name, data in encoded.items():
        files.write_bytes(folder / name, data.result())
    written = [folder / name for name in encoders]
    if can_mp4():
        try:
            write_mp4(folder / "film.mp4", frames)
        except RuntimeError as error:
            return written, str(error)
        written.append(folder / "film.mp4")
    return written, ""
