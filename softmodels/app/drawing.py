"""Sections as SVG: the whole profile with a field in colours, over its undeformed outline."""

from __future__ import annotations

import dataclasses
import functools
from html import escape

import numpy as np

from softmodels.common.arrays import Array
from softmodels.runs.grid import Cells, fine_triangles, outline

PARTS = 3
"""Pieces per edge of a cell that have one colour each."""
STEPS = 32
"""Colours of the scale."""


@dataclasses.dataclass(frozen=True)
class Section:
    """An axisymmetric device in one state; lengths in mm.

    Attributes:
        corners: Corners (t, 3, 2) of small triangles, deformed.
        values: A field's value in each of them, shape (t,).
        edges: Its outline, deformed, shape (e, k, 2).
        rest: Its outline at rest, shape (e, k, 2).
    """

    corners: Array
    values: Array
    edges: Array
    rest: Array

    @classmethod
    def of(cls, points: Array, displacement: Array, cells: Cells, values: Array) -> Section:
        """Return the section of nodes in m, shape (n, 3) with y = 0, and a nodal field."""
        before, after = points[:, ::2] * 1e3, (points + displacement)[:, ::2] * 1e3
        fine, triangles = fine_triangles(np.column_stack([after, values]), cells, PARTS)
        corners = fine[triangles]
        return cls(
            corners[..., :2], corners[..., 2].mean(axis=1), _seen(outline(after, cells)), _seen(outline(before, cells))
        )

    def between(self, other: Section, share: float) -> Section:
        """Return the section a share of the way to another state of the same mesh."""
        names = ("corners", "values", "edges")
        mixed = {name: (1 - share) * getattr(self, name) + share * getattr(other, name) for name in names}
        return dataclasses.replace(self, **mixed)


def _seen(curves: Array) -> Array:
    """Return the curves without those on the axis, which is inside of the device."""
    return curves[np.abs(curves[..., 0]).max(axis=1) > 1e-9 * np.abs(curves).max()]


def section_svg(
    section: Section, box: tuple[float, float, float, float], top: float, colours: list[str], text: str
) -> str:
    """Return a section as SVG, mirrored to the whole profile.

    Args:
        section: What is drawn.
        box: Least radius and height, largest radius and height in mm that are shown.
        top: Value with the last colour; 0 has the first.
        colours: Of the scale, from 0 to ``top``.
        text: What the picture shows, for those who do not see it.
    """
    low, high, radius = box[1], box[3], box[2]
    margin = 0.06 * radius
    wide, tall = 2 * (radius + margin), high - low + 2 * margin
    places = np.clip((section.values / top * len(colours)).astype(int), 0, len(colours) - 1)
    half = [
        f'<path d="{_paths(section.corners[places == k], "Z")}" fill="{colours[k]}" stroke="{colours[k]}" '
        f'stroke-width="{wide / 1500:.4f}"/>'
        for k in np.unique(places)
    ]
    half += [
        f'<path d="{_paths(curves)}" class="{name}" fill="none" stroke-width="{wide / 700:.4f}"/>'
        for curves, name in ((section.rest, "rest"), (section.edges, "edge"))
    ]
    drawn = f'<g id="half-section">{"".join(half)}</g><use href="#half-section" transform="scale(-1 1)"/>'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label="{escape(text)}" class="section" '
        f'viewBox="{-wide / 2:.4f} {-(high + margin):.4f} {wide:.4f} {tall:.4f}">{drawn}'
        f"{_scale_bar(wide, -(low - margin))}</svg>"
    )


def _paths(curves: Array, end: str = "") -> str:
    """Return curves of k points each, shape (n, k, 2), as the path of an SVG, whose y points downwards."""
    one = "M" + "L".join(["%.3f %.3f"] * curves.shape[1]) + end
    return one * len(curves) % tuple((curves * (1.0, -1.0)).ravel().tolist())


def _scale_bar(wide: float, foot: float) -> str:
    """Return a bar of a round length near an eighth of the width, in the lower left corner."""
    power = 10.0 ** np.floor(np.log10(wide / 8))
    length = max(k * power for k in (1, 2, 5) if k * power <= wide / 8)
    x, y, size = -0.48 * wide, foot - 0.012 * wide, 0.018 * wide
    return (
        f'<g class="scale-bar"><path d="M{x:.3f} {y:.3f}h{length:g}" stroke-width="{wide / 400:.3f}"/>'
        f'<text x="{x:.3f}" y="{y - size / 3:.3f}" font-size="{size:.3f}">{length:g} mm</text></g>'
    )


def colour_bar(top: float, colours: list[str], what: str) -> str:
    """Return the scale from 0 to a value as HTML, with its words."""
    return (
        f'<div class="colour-bar"><span>0</span><div style="background:linear-gradient(90deg,{",".join(colours)})"></div>'
        f"<span>{top:.3g} {escape(what)}</span></div>"
    )


@functools.cache
def colours_of(name: str = "viridis", count: int = STEPS) -> list[str]:
    """Return the colours of one of Matplotlib's maps, from the lowest value up."""
    import matplotlib
    from matplotlib.colors import to_hex

    return [to_hex(colour) for colour in matplotlib.colormaps[name](np.linspace(0.0, 1.0, count))]
