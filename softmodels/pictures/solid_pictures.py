"""The pictures of the solid: undeformed, von Mises stress at some pressures, a cut through the channels, hot spots."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from PIL import Image as Picture

from geometries import Actuator
from softmodels.pictures.colour_scale import FOOT, Pixels, Scale, page
from softmodels.pictures.cut_open import best_plane, cut_open
from softmodels.pictures.hot_spots import hot_layers, hot_limit, hot_title, peak_place, peak_text
from softmodels.pictures.offscreen import Camera, Image, Style, lines, ring, studio, surface
from softmodels.pictures.style import DPI, EDGE, FAINT, INK, SOLID, WIDTH, headline, load, number, title_colour, wrapped
from softmodels.pictures.viewpoint import SOLID_STYLE, Look, towards_slice
from softmodels.results.row import Row
from softmodels.results.state_words import StateWords
from softmodels.results.triangles import Array, edge_curves, outer_faces

AIR = "#2f6f9f"
COLUMNS = {1: 1, 2: 2, 3: 3, 4: 2}
"""Columns of the sheet for each number of pictures."""


def undeformed(look: Look) -> Figure:
    """The device at rest, translucent, with the walls of its cavities inside (thesis, Fig. 8)."""
    states = look.states
    whole = states.skin.device(states.skin.points(states.points))
    camera = Camera.around([whole], look.direction, look.up)
    with studio(camera) as shoot:
        image = shoot(look.translucent(0, 0.35, {"color": AIR}))
    count = states.skin.cavities
    what = {0: "", 1: ", its cavity inside"}.get(count, f", its {count} cavities inside")
    return page(image, f"Undeformed device{what}: {_size(whole)}")


def _size(points: Array) -> str:
    return " x ".join(number(length * 1e3) for length in np.ptp(points, axis=0)) + " mm"


def mesh(look: Look) -> Figure:
    """The undeformed slice with the edges of its cells."""
    states = look.states
    skin, points = states.skin, states.skin.points(states.points)
    faces = outer_faces(states.cells, states.cell_name)
    curves = edge_curves(states.points, faces, 2)
    pairs = np.arange(curves.shape[0] * 3).reshape(-1, 3)[:, [[0, 1], [1, 2]]].reshape(-1, 2)
    camera = Camera.around([points], towards_slice(states), look.up)
    with studio(camera) as shoot:
        solid = surface(points, skin.triangles, skin.normals(points))
        edges = lines(curves.reshape(-1, 3), pairs)
        image = shoot([(solid, {**SOLID_STYLE, "color": SOLID}), (edges, {"color": EDGE, "line_width": 1.5})])
    return page(image, f"Undeformed {_slice_name(states.actuator)}, {len(states.cells)} cells")


def _slice_name(actuator: Actuator) -> str:
    if actuator.copies == 1:
        return "device"
    return f"{360 / actuator.copies:g}° slice" if actuator.axial else {2: "half"}.get(actuator.copies, "slice")


def slice_stress(look: Look) -> Figure:
    """The deformed slice seen on its cut, coloured by stress, with the edges of the undeformed one."""
    states, step = look.states, look.states.main
    skin = states.skin
    scale = Scale(states.field(step, "von_mises"), rows=[states.rows[step]])
    rest, moved = skin.points(states.points), skin.points(states.moved(step))
    values = scale.share(states.field(step, scale.field))[skin.nodes]
    edges = np.concatenate([skin.edges, skin.rims])
    style: Style = {**SOLID_STYLE, "scalars": "values", "cmap": scale.colours, "clim": (0.0, 1.0)}
    camera = Camera.around([rest, moved], towards_slice(states), look.up)
    with studio(camera) as shoot:
        image = shoot(
            [
                (surface(moved, skin.triangles, skin.normals(moved), values), style),
                (lines(moved, edges), {"color": INK, "line_width": 2.0}),
                (lines(rest, edges), {"color": FAINT, "line_width": 1.5}),
                *look.plate_layers(step),
            ]
        )
    return page(image, headline(states.rows[step], states.words), scale)


def mode(look: Look, step: int, amount: float = 0.15) -> Figure:
    """The slice at a bifurcation with some of its mode added, over the edges of the slice without it.

    Args:
        look: The device.
        step: The state at the bifurcation.
        amount: Largest displacement of the mode as drawn, in sizes of the slice.
    """
    states, skin = look.states, look.states.skin
    size = amount * np.ptp(states.points, axis=0).max()
    before, moved = (
        skin.points(states.moved(step) + share * size * states.field(step, "mode")) for share in (0.0, 1.0)
    )
    edges = np.concatenate([skin.edges, skin.rims])
    camera = Camera.around([before, moved], towards_slice(states), look.up)
    with studio(camera) as shoot:
        image = shoot(
            [
                (surface(moved, skin.triangles, skin.normals(moved)), {**SOLID_STYLE, "color": SOLID}),
                (lines(moved, edges), {"color": INK, "line_width": 2.0}),
                (lines(before, edges), {"color": FAINT, "line_width": 1.5}),
            ]
        )
    return page(image, f"Bifurcation at {headline(states.rows[step], states.words)}: the mode (size at will)")


def stress(look: Look) -> tuple[list[tuple[int, Image]], Camera, Scale]:
    """Von Mises stress on the deformed device at the shown states, seen by one camera in one colour scale.

    Returns:
        Steps and images; the camera and the scale of them all.
    """
    states = look.states
    steps = states.shown()
    scale = look.scale(steps)
    camera = look.camera([0, *steps])
    with studio(camera) as shoot:
        return [(step, shoot(look.coloured(step, scale))) for step in steps], camera, scale


def sheet(images: list[tuple[int, Image]], rows: Sequence[Row], words: StateWords, scale: Scale) -> Figure:
    """The images of `stress` side by side over one colour bar."""
    columns = COLUMNS[len(images)]
    rows_ = -(-len(images) // columns)
    wide = WIDTH / columns
    tall = wide * images[0][1].shape[0] / images[0][1].shape[1]
    titles = [wrapped(load(rows[step], words), wide, 12) for step, _ in images]
    head, foot = 0.4 + 0.2 * max(title.count("\n") for title in titles), FOOT
    whole = rows_ * (tall + head) + foot
    figure = Figure((WIDTH, whole), dpi=DPI)
    for k, (_, image) in enumerate(images):
        left, top = k % columns * wide, whole - k // columns * (tall + head)
        small = Picture.fromarray(image).resize((round(wide * DPI), round(tall * DPI)), Picture.Resampling.BOX)
        figure.add_artist(Pixels(np.asarray(small), round((top - head - tall) * DPI), round(left * DPI)))
        place = (left + wide / 2) / WIDTH, (top - 0.6 * head) / whole
        figure.text(*place, titles[k], ha="center", va="center", color=title_colour(titles[k]))
    scale.bar(figure)
    return figure


def cut(look: Look) -> Figure:
    """The device cut open through its channels, with the von Mises stress on the cut."""
    states, step = look.states, look.states.main
    scale = Scale(states.field(step, "von_mises"), rows=[states.rows[step]])
    if look.opened:
        layers, direction, where = look.coloured(step, scale), look.direction, ""
    else:
        plane = best_plane(states.skin, states.points, look.up, states.actuator.axial)
        towards = plane[0] if plane[0] @ look.direction > 0 else -plane[0]
        direction = 0.8 * towards + 0.6 * look.direction
        layers = cut_open(states, step, plane, towards, scale)
        axis = int(np.argmax(np.abs(plane[0])))
        where = f"; cut at {'xyz'[axis]} = {number(plane[1][axis] * 1e3)} mm"
        layers += look.plate_layers(step)
    clouds = [np.asarray(data.points) for data, _ in layers]
    camera = Camera.around(clouds, direction, look.up if abs(direction @ look.up) < 0.99 else np.eye(3)[0])
    with studio(camera) as shoot:
        image = shoot(layers)
    return page(image, headline(states.rows[step], states.words) + where, scale)


def hot_spots(look: Look) -> Figure:
    """What is stretched most, inside the translucent deformed device, and where the peak is."""
    states, step = look.states, look.states.main
    skin = states.skin
    limit = hot_limit(states, step)
    scale = Scale(states.field(step, "largest_stretch"), "largest_stretch", rows=[states.rows[step]])
    layers = [*hot_layers(states, step, limit, scale), *look.translucent(step, 0.22, None)]
    whole = [skin.device(skin.points(states.moved(step)))]
    camera = Camera.around(whole, look.direction, look.up)
    if (peak := peak_place(states, step)) is not None:
        before = peak + 3 * camera.scale * look.direction  # nothing hides it, and in parallel projection nothing shifts
        circle = ring(before, look.direction, 0.05 * camera.scale)
        layers += [(circle, {"color": colour, "line_width": wide}) for colour, wide in (("white", 7.0), ("black", 3.0))]
    with studio(camera) as shoot:
        image = shoot(layers)
    return page(image, hot_title(limit), scale, peak_text(states, step))
