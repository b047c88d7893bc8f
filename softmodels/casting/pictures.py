"""Pictures of a mould: each body from its inner side, all of them apart, the steps of the work, and a drawing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from geometries import actuator, mesh_arrays
from softmodels.casting import bodies, make
from softmodels.casting.facets import Facets, PlacedBody, moved
from softmodels.common.arrays import Array
from softmodels.pictures import offscreen, style
from softmodels.runs import grid, labels

PRINTED_COLOUR, SILICONE_COLOUR, LOST_CORE_COLOUR = "#b4c3d4", "#e8b796", "#d8d2a8"
MAX_EDGE_COSINE = np.cos(np.radians(25.0))
"""Faces that meet at more than 25 degrees have their edge drawn."""
EXPLODED_GAP = 0.28
"""Gap between bodies in the exploded picture, in sizes of the mould."""


def body_picture(body: make.MouldBody) -> Figure:
    """Draw a body from its silicone side."""
    pull = np.array(body.pull)
    up = np.array([0.0, 0.0, -pull[2] if pull[2] else 1.0])
    side = offscreen.direction(-58.0, 38.0, np.array([0.0, 0.0, 1.0]))
    towards = side * (1.0, 1.0, up[2])
    if across := pull[:2].any():
        towards = side - 2.0 * pull * max(0.0, float(side @ pull)) - 0.4 * pull
    camera = offscreen.ViewCamera.around([body.facets.points], towards, up, tallest=0.8)
    with offscreen.studio(camera) as shoot:
        image = shoot(_layers(body.facets, PRINTED_COLOUR))
    size = " x ".join(labels.number(length) for length in np.ptp(body.facets.points, axis=0))
    inner = ", its inner side" if across or pull[2] else ""
    return style.page(image, style.Caption(f"{body.name[0].upper()}{body.name[1:]}: {size} mm{inner}"))


def exploded_picture(made: make.Mould) -> Figure:
    """Draw the exploded view of all pieces side by side, as they stand when poured, bodies apart along their pulls."""
    up, towards = np.array([0.0, 0.0, 1.0]), offscreen.direction(-58.0, 24.0, np.array([0.0, 0.0, 1.0]))
    right = np.cross(up, towards) / np.linalg.norm(np.cross(up, towards))
    layers: list[offscreen.Layer] = []
    clouds: list[Array] = []
    edge = 0.0
    for pour in made.recipe.pours:
        group = _exploded_surfaces(made, pour)
        points = np.concatenate([facets.points for facets, _ in group])
        along, gap = points @ right, 0.06 * float(np.ptp(points, axis=0).max())
        shift = (edge - along.min()) * right - 0.5 * (points[:, 2].min() + points[:, 2].max()) * up
        edge += float(np.ptp(along)) + gap
        for facets, colour in group:
            layers += _layers(moved(facets, np.eye(3), shift), colour)
            clouds.append(facets.points + shift)
    camera = offscreen.ViewCamera.around(clouds, towards, up, tallest=1.1)
    with offscreen.studio(camera) as shoot:
        image = shoot(layers)
    return style.page(image, style.Caption("Exploded view of the mould: bodies apart along their pulls, with the casts"))


def _exploded_surfaces(made: make.Mould, pour: actuator.Pour) -> list[tuple[Facets, str]]:
    """Return the surfaces and colours of one piece's mould, its bodies apart."""
    bodies, cast = made.of(pour)
    turn = standing(pour)
    places = shifts(bodies, cast)
    layers = [(cast.facets, np.zeros(3), LOST_CORE_COLOUR if pour.wax else SILICONE_COLOUR)]
    layers += [(body.facets, places[body.name], PRINTED_COLOUR if any(body.pull) else LOST_CORE_COLOUR) for body in bodies]
    return [(moved(facets, turn, turn @ shift), colour) for facets, shift, colour in layers]


def standing(pour: actuator.Pour) -> Array:
    """Return the rotation, shape (3, 3), that brings a piece's mould as it stands when it is poured."""
    return np.eye(3) if pour.gate is not None else np.diag([1.0, -1.0, -1.0])


def shifts(bodies: Sequence[make.MouldBody], cast: make.MouldBody) -> dict[str, Array]:
    """Return by how much each body of a piece is moved along its pull, in mm, to stand clear of the others."""
    size = float(np.linalg.norm(np.ptp(cast.facets.points, axis=0)))
    shifts, stacked = {}, [cast.facets.points]
    lost = [body for body in bodies if not any(body.pull)]
    for body in [*lost, *reversed([body for body in bodies if any(body.pull)])]:
        pull = np.array(body.pull) if any(body.pull) else np.array([0.0, 0.0, -1.0])
        before = np.concatenate(stacked)
        needed = float((before @ pull).max() - (body.facets.points @ pull).min())
        shifts[body.name] = (max(0.0, needed) + EXPLODED_GAP * size) * pull
        stacked.append(body.facets.points + shifts[body.name])
    return shifts


def _layers(facets: Facets, colour: str, opacity: float = 1.0) -> list[offscreen.Layer]:
    """Return a body with its sharp edges; its shading is that of the exact surface."""
    corners = facets.corners.reshape(-1, 3)
    cells = np.arange(len(corners)).reshape(-1, 3)
    solid = offscreen.surface(corners, cells, facets.normals.reshape(-1, 3))
    edge = offscreen.lines(facets.points, sharp_edges(facets))
    return [
        (solid, {"color": colour, "smooth_shading": True, "opacity": opacity}),
        (edge, {"color": style.EDGE, "line_width": 1.5}),
    ]


def sharp_edges(facets: Facets, view: Array | None = None) -> grid.Cells:
    """Return the edges between faces that meet at an angle, as pairs of vertices, shape (k, 2); with a direction of view also
    the outline of curved faces."""
    pairs, start, other = _neighbours(facets)
    normals = np.concatenate([facets.normals[:, side].mean(axis=1) for side in TRIANGLE_SIDES])
    face = np.tile(facets.face, 3)
    cosine = np.einsum("ij,ij->i", normals[start], normals[other])
    drawn = (face[start] != face[other]) & (cosine < MAX_EDGE_COSINE)
    if view is not None:
        a, b, c = np.moveaxis(facets.corners, 1, 0)
        towards = np.tile(np.cross(b - a, c - a) @ view, 3)
        drawn |= (towards[start] > 0.0) != (towards[other] > 0.0)
    return np.asarray(pairs[start][drawn])


TRIANGLE_SIDES: tuple[tuple[int, int], ...] = ((0, 1), (1, 2), (2, 0))


def _neighbours(facets: Facets) -> tuple[grid.Cells, grid.Cells, grid.Cells]:
    """Return the edges of all triangles, shape (3 m, 2), and where among them the two of each edge are, shape (k,) each."""
    pairs = np.concatenate([facets.triangles[:, side] for side in TRIANGLE_SIDES])
    order = np.lexsort(np.sort(pairs, axis=1).T)
    return pairs, order[::2], order[1::2]  # a closed surface: each edge is there twice


# ----------------------------------------------------------------------------------------------------------------------
# The steps of the work in pictures: each piece's mould closed, filled and opened; then the bond.


UP = np.array([0.0, 0.0, 1.0])
VIEW = offscreen.direction(-58.0, 24.0, UP)
BELOW_RIM = 2e-3
"""Distance of the silicone's level from the rim in mm: in one plane, rounding would leave films on the rim."""
GHOST_OPACITY = 0.25
"""Opacity of a mould's bodies around what is poured."""


def steps_picture(made: make.Mould) -> Figure:
    """Draw the steps of the work in numbered panels: those of each piece, and the bond."""
    panels = [panel for pour in made.recipe.pours for panel in _piece_steps(made, pour)]
    if len(made.casts) > 1:
        panels.append(("Bond the pieces", _rendered(_casts_apart(made))))
    columns = min((3, 4), key=lambda count: (-len(panels) % count, count)) if len(panels) > 2 else 2
    rows = -(-len(panels) // columns)
    figure = Figure((8.0, 0.2 + 7.6 / columns * rows), dpi=style.DPI, layout="constrained")
    for k, axes in enumerate(figure.subplots(rows, columns, squeeze=False).ravel()):
        axes.set_axis_off()
        if k < len(panels):
            text, image = panels[k]
            axes.imshow(image)
            axes.set_title(f"{k + 1}. {text}", fontsize=9)
    return figure


def _piece_steps(made: make.Mould, pour: actuator.Pour) -> list[tuple[str, offscreen.Image]]:
    """Return the panels of one piece, which show what the sheet says: put together, poured, opened."""
    bodies, cast = made.of(pour)
    turn = standing(pour)
    apart, still = shifts(bodies, cast), dict.fromkeys((body.name for body in bodies), np.zeros(3))
    filled = [(moved(cast.facets, turn, np.zeros(3)), LOST_CORE_COLOUR if pour.wax else SILICONE_COLOUR, 1.0)]

    def placed(places: dict[str, Array], share: float, opacity: float) -> list[tuple[Facets, str, float]]:
        return [
            (
                moved(body.facets, turn, share * turn @ places[body.name]),
                PRINTED_COLOUR if any(body.pull) else LOST_CORE_COLOUR,
                opacity,
            )
            for body in bodies
        ]

    if pour.wax:
        return [(f"Pour the {pour.name} of wax", _rendered([*filled, *placed(still, 1.0, GHOST_OPACITY)])),
                (f"Take the {pour.name} out", _rendered([*filled, *placed(apart, 1.0, 1.0)]))]  # fmt: skip
    if not pour.lid:
        return [(f"Fill the {pour.name}, scrape it flat", _rendered([*filled, *placed(still, 1.0, 1.0)])),
                (f"Take the {pour.name} out", _rendered([*filled, *placed(apart, 1.0, 1.0)]))]  # fmt: skip
    lost = [body.name for body in bodies if not any(body.pull)]  # comes out within the piece
    out = {name: np.zeros(3) if name in lost else places for name, places in apart.items()}
    closed = _rendered([*filled, *placed(still, 1.0, GHOST_OPACITY)])
    opened = _rendered([*filled, *placed(out, 1.0, 1.0)])
    opening = f"Open, {'melt the wax out' if made.waxes else 'dissolve the core'}" if lost else "Open"
    if not pour.filled_open:
        closing = _rendered(placed(apart, 0.6, 1.0))
        return [(f"Close the {pour.name} mould", closing), ("Pour and cure", closed), (opening, opened)]
    lid = next(places for name, places in apart.items() if pour.part(name) == " lid")
    stays = {body.name: any(word in pour.part(body.name) for word in ("cup", "pin")) for body in bodies}
    lifted = {name: np.zeros(3) if stay else lid for name, stay in stays.items()}
    brim = (moved(_filled_cup(bodies, cast, stays), turn, np.zeros(3)), SILICONE_COLOUR, 1.0)
    return [
        (f"Fill the {pour.name} cup", _rendered([brim, *placed(lifted, 0.6, 1.0)])),
        ("Lower the lid, cure", closed),
        (opening, opened),
    ]


def _filled_cup(bodies: Sequence[make.MouldBody], cast: make.MouldBody, stays: Mapping[str, bool]) -> Facets:
    """Return the silicone in a piece's cup up to the rim: what of the cast's box is in no body that stays."""
    from manifold3d import Manifold

    low, high = cast.facets.points.min(axis=0), cast.facets.points.max(axis=0)
    low[2] += BELOW_RIM
    solid = Manifold.cube(tuple(high - low)).translate(tuple(low))
    for body in bodies:
        if stays[body.name]:
            solid -= make.manifold_of(body.facets)
    points, triangles = mesh_arrays.surface_of(max(solid.decompose(), key=lambda piece: piece.volume()))
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    across = np.cross(b - a, c - a)
    across /= np.maximum(np.linalg.norm(across, axis=1), 1e-30)[:, None]
    faces, normals = np.arange(len(triangles)), np.repeat(across[:, None], 3, axis=1)
    return Facets(points, triangles, faces, normals, cast.facets.chord, cast.facets.volume, cast.facets.centre)


def _casts_apart(made: make.Mould) -> list[tuple[Facets, str, float]]:
    """Return the pieces in the device's own place, apart across their bonds."""
    casts_apart = []
    for pour in (pour for pour in made.recipe.pours if not pour.wax):
        _, cast = made.of(pour)
        turn, up = bodies.rotation_up(pour.up).T, np.array(pour.up)
        size = float(np.linalg.norm(np.ptp(cast.facets.points, axis=0)))
        casts_apart.append((moved(cast.facets, turn, 0.12 * size * up), SILICONE_COLOUR, 1.0))
    return casts_apart


def _rendered(group: Sequence[tuple[Facets, str, float]]) -> offscreen.Image:
    """Draw surfaces, each with a colour and an opacity."""
    layers = [layer for facets, colour, opacity in group for layer in _layers(facets, colour, opacity)]
    camera = offscreen.ViewCamera.around([facets.points for facets, _, _ in group], VIEW, UP, width=560, tallest=1.0)
    with offscreen.studio(camera) as shoot:
        return shoot(layers)


# ----------------------------------------------------------------------------------------------------------------------
# A drawing with dimensions: each body from above and from the front.


def drawing(made: make.Mould) -> Figure:
    """Draw each body to print from above and from the front, with its outer dimensions in mm."""
    bodies = [*made.printed, *made.extras]
    figure = Figure((8.0, 2.9 * len(bodies)), layout="constrained")
    for row, body in zip(figure.subplots(len(bodies), 2, squeeze=False), bodies, strict=True):
        for axes, (a, b), text in zip(row, ((0, 1), (0, 2)), ("from above", "from the front"), strict=True):
            edges = body.facets.points[sharp_edges(body.facets, np.eye(3)[3 - a - b])]
            _view(axes, edges[:, :, [a, b]], body.facets.points[:, [a, b]])
            axes.set_title(f"{body.name}, {text}", fontsize=9)
    return figure


def _view(axes: Axes, edges: Array, points: Array) -> None:
    """Draw edges and the two outer dimensions of one view."""
    axes.add_collection(LineCollection(list(edges), colors=style.EDGE, linewidths=0.5))
    (x, y), (X, Y) = points.min(axis=0), points.max(axis=0)
    off = 0.07 * max(X - x, Y - y)
    arrow = {"arrowstyle": "<->", "linewidth": 0.6, "shrinkA": 0.0, "shrinkB": 0.0}
    axes.annotate("", (x, y - off), (X, y - off), arrowprops=arrow)
    axes.text(0.5 * (x + X), y - 1.25 * off, f"{X - x:.2f} mm", ha="center", va="top", fontsize=8)
    axes.annotate("", (X + off, y), (X + off, Y), arrowprops=arrow)
    axes.text(X + 1.25 * off, 0.5 * (y + Y), f"{Y - y:.2f} mm", ha="left", va="center", rotation=90, fontsize=8)
    axes.set(xlim=(x - off, X + 4.0 * off), ylim=(y - 4.0 * off, Y + off), aspect="equal")
    axes.set_axis_off()


def plates_picture(placed: Sequence[PlacedBody], size: tuple[float, float]) -> Figure:
    """Draw the plates from above, each body as the outline of its edges with its name; a plate's width and depth are in mm."""
    count = max(body.plate for body in placed)
    figure = Figure((8.0, 8.0 * size[1] / size[0] * count), layout="constrained")
    rows = figure.subplots(count, 1, squeeze=False)[:, 0]
    for k, axes in enumerate(rows, 1):
        axes.add_patch(Rectangle((0, 0), *size, fill=False, edgecolor=style.EDGE))
        for body in placed:
            if body.plate == k:
                axes.add_collection(LineCollection(list(body.facets.points[sharp_edges(body.facets)][:, :, :2]),
                colors=style.EDGE,
                                                   linewidths=0.4))  # fmt: skip
                (x, y, _), (X, Y, _) = body.facets.points.min(axis=0), body.facets.points.max(axis=0)
                if X - x < 1.2 * len(body.name):
                    axes.text(0.5 * (x + X), Y + 1.0, body.name, fontsize=6, rotation=90, ha="center")
                else:
                    axes.text(x, y - 0.5, body.name, fontsize=6, va="top")
        axes.set(xlim=(-2, size[0] + 2), ylim=(-2, size[1] + 2), aspect="equal")
        axes.set_axis_off()
    return figure


EXPLODED, STEPS, DRAWING, PLATES = "exploded.png", "steps.png", "drawing.svg", "plates.svg"


def draw_all(folder: Path, made: make.Mould) -> list[tuple[str, str]]:
    """Write the rendered pictures; return their names and descriptions, the exploded view first."""
    exploded_picture(made).savefig(folder / EXPLODED, dpi=style.DPI)
    steps_picture(made).savefig(folder / STEPS, dpi=style.DPI)
    pictures = [(EXPLODED, "Exploded view of the mould along the pull"), (STEPS, "The steps of the work")]
    for body in made.bodies:
        body_picture(body).savefig(folder / f"{body.stem}.png", dpi=style.DPI)
        pictures.append((f"{body.stem}.png", f"The {body.name}"))
    return pictures
