"""The casting sheet of a mould, as Markdown and as HTML with pictures; and the pictures themselves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from softmodels.casting.facets import Facets
from softmodels.casting.make import Made, MouldBody
from softmodels.casting.settings import Asked
from softmodels.casting.sheet import bench_sheet
from softmodels.common.arrays import Array
from softmodels.common.files import image_uri, render, write_text
from softmodels.pictures.offscreen import Layer, ViewCamera, can_render, direction, lines, studio, surface
from softmodels.pictures.style import DPI, EDGE, number, page
from softmodels.runs.grid import Cells

# ----------------------------------------------------------------------------------------------------------------------
# Pictures of a mould: each body from its inner side, and an exploded view with the casts.


PRINTED, SILICONE = "#b4c3d4", "#e8b796"
SHARP = np.cos(np.radians(25.0))
"""Faces that meet at more than 25 degrees have their edge drawn."""
APART = 0.22
"""Gap between bodies in the exploded picture, in widths of the mould."""
ORDER = ("lower cup", "lower half", "lower lid", "upper lid", "upper half", "upper cup")
"""From below to above."""


def body_picture(body: MouldBody) -> Figure:
    """Draw a body from its silicone side."""
    up = np.array([0.0, 0.0, -body.opens])
    towards = direction(-58.0, 38.0, np.array([0.0, 0.0, 1.0])) * (1.0, 1.0, -body.opens)
    camera = ViewCamera.around([body.facets.points], towards, up, tallest=0.8)
    with studio(camera) as shoot:
        image = shoot(_layers(body.facets, np.zeros(3), PRINTED))
    size = " x ".join(number(length) for length in np.ptp(body.facets.points, axis=0))
    return page(image, f"{body.name[0].upper()}{body.name[1:]}: {size} mm, its inner side")


def exploded_picture(made: Made) -> Figure:
    """Draw the exploded view of all bodies and casts along the pull."""
    found = {body.name: body for body in (*made.bodies, *made.casts)}
    gap = APART * float(np.ptp(found["lower cup"].facets.points[:, 0]))
    layers: list[Layer] = []
    clouds, top = [], 0.0
    for name in ORDER:
        points = found[name].facets.points
        shift = np.array([0.0, 0.0, top - points[:, 2].min()])
        layers += _layers(found[name].facets, shift, SILICONE if name.endswith("half") else PRINTED)
        clouds.append(points + shift)
        top += float(np.ptp(points[:, 2])) + gap
    up = np.array([0.0, 0.0, 1.0])
    camera = ViewCamera.around(clouds, direction(-58.0, 24.0, up), up, width=1200, tallest=1.25)
    with studio(camera) as shoot:
        image = shoot(layers)
    wide = np.full((image.shape[0], 200, 3), 255, dtype=np.uint8)
    text = "Exploded view of the mould along the pull, with the casts"
    return page(np.concatenate([wide, image, wide], axis=1), text)


def _layers(facets: Facets, shift: Array, colour: str) -> list[Layer]:
    """Return a body with its sharp edges; its shading is that of the exact surface."""
    corners = (facets.corners + shift).reshape(-1, 3)
    cells = np.arange(len(corners)).reshape(-1, 3)
    solid = surface(corners, cells, facets.normals.reshape(-1, 3))
    edge = lines(facets.points + shift, sharp_edges(facets))
    return [(solid, {"color": colour, "smooth_shading": True}), (edge, {"color": EDGE, "line_width": 1.5})]


def sharp_edges(facets: Facets) -> Cells:
    """Return the edges between faces that meet at an angle, as pairs of vertices, shape (k, 2)."""
    sides: Sequence[tuple[int, int]] = ((0, 1), (1, 2), (2, 0))
    pairs = np.concatenate([facets.triangles[:, side] for side in sides])
    normals = np.concatenate([facets.normals[:, side].mean(axis=1) for side in sides])
    face = np.tile(facets.face, 3)
    order = np.lexsort(np.sort(pairs, axis=1).T)
    one, other = order[::2], order[1::2]  # a closed surface: each edge is there twice
    cosine = np.einsum("ij,ij->i", normals[one], normals[other])
    return np.asarray(pairs[one][(face[one] != face[other]) & (cosine < SHARP)])


EXPLODED = "exploded.png"


def write_sheet(folder: Path, asked: Asked, made: Made, pictures: bool = True) -> bool:
    """Write ``sheet.md``, ``sheet.html`` and the pictures into a folder; return whether pictures were drawn.

    Args:
        folder: The folder.
        asked: What was asked for.
        made: The mould.
        pictures: Whether to draw; without a way to render nothing is drawn.

    Raises:
        OSError: There is no room.
    """
    drawn = pictures and can_render()
    files = [(EXPLODED, "Exploded view of the mould along the pull")] if drawn else []
    if drawn:
        _draw(folder, made)
        files += [(f"{body.stem}.png", f"The {body.name}") for body in made.bodies]
    sheet = bench_sheet(asked, made)
    # Markdown text is inserted unescaped.
    write_text(folder / "sheet.md", render("mould.md", "softmodels.pictures", pictures=files, sheet=sheet))
    inside = [(image_uri(folder / name), text) for name, text in files]
    write_text(
        folder / "sheet.html",
        render("mould.html", "softmodels.pictures", pictures=inside, title=sheet.title, sheet=sheet),
    )
    return drawn


def _draw(folder: Path, made: Made) -> None:

    exploded_picture(made).savefig(folder / EXPLODED, dpi=DPI)
    for body in made.bodies:
        body_picture(body).savefig(folder / f"{body.stem}.png", dpi=DPI)
