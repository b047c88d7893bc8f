"""What the processes beside the server answer, which both sides import: sections, states, edges in photographs."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from softmodels.common.arrays import Array
from softmodels.runs import grid, table

PREVIEW_SIDE_PX = 1600
SMALL_SIDE_PX = 96
"""Longest side of a photograph's preview in px."""
PIECES_PER_EDGE = 3
"""Pieces per edge of a cell that have one colour each."""


@dataclasses.dataclass(frozen=True)
class Section:
    """An axisymmetric device in one state; lengths in mm: corners of small triangles, deformed, shape (t, 3, 2), a field's
    values in them, shape (t,), and its outline, deformed and at rest, shape (e, k, 2)."""

    corners: Array
    values: Array
    edges: Array
    rest: Array

    @classmethod
    def of(cls, points: Array, displacement: Array, cells: grid.Cells, values: Array) -> Section:
        """Return the section of nodes in m, shape (n, 3) with y = 0, and a nodal field."""
        before, after = points[:, ::2] * 1e3, (points + displacement)[:, ::2] * 1e3
        fine, triangles = grid.fine_triangles(np.column_stack([after, values]), cells, PIECES_PER_EDGE)
        corners = fine[triangles]
        return cls(
            corners[..., :2],
            corners[..., 2].mean(axis=1),
            _visible_curves(grid.outline(after, cells)),
            _visible_curves(grid.outline(before, cells)),
        )

    def between(self, other: Section, share: float) -> Section:
        """Return the section a share of the way to another state of the same mesh."""
        names = ("corners", "values", "edges")
        mixed = {name: (1 - share) * getattr(self, name) + share * getattr(other, name) for name in names}
        return dataclasses.replace(self, **mixed)


def _visible_curves(curves: Array) -> Array:
    """Return the curves without those on the axis, which is inside of the device."""
    return curves[np.abs(curves[..., 0]).max(axis=1) > 1e-9 * np.abs(curves).max()]


@dataclasses.dataclass(frozen=True)
class StateAnswer:
    """A state: its row of the table and its section, coloured by von Mises stress in kPa."""

    row: table.Row
    section: Section


@dataclasses.dataclass(frozen=True)
class PathAnswer:
    """A path, as ``sm.run(case)`` finds it: its states from rest to its end, and why it ends before the last requested value,
    empty if it does not; warnings; the colours of the sections, from the lowest value up; the least stretch at break of the
    silicone, None if unknown, and all of them with their sources, in words."""

    states: list[StateAnswer]
    end: str
    notes: list[str]
    colours: list[str]
    breaks_at: float | None
    breaks: str


@dataclasses.dataclass(frozen=True)
class LinearAnswer:
    """A solved state at a pressure in Pa with its exact derivatives, for what is near: the rise of each probe in mm and the
    added volume in ml by column, and their derivatives per Pa and per m of each length."""

    case: str
    pressure: float
    values: dict[str, float]
    by_pressure: dict[str, float]
    by_length: dict[str, dict[str, float]]

    def at(self, pressure: float, changes: Mapping[str, float]) -> dict[str, float]:
        """Return the values at a pressure in Pa and for lengths changed by so many m, to first order."""
        step = pressure - self.pressure
        return {
            name: value + step * self.by_pressure[name] + sum(d * self.by_length[k][name] for k, d in changes.items())
            for name, value in self.values.items()
        }


@dataclasses.dataclass
class Handles:
    """What can be dragged on a photograph, in px: two points on the undeformed surface, the region of interest as x0, y0, x1,
    y1, and masks, in which no edge is looked for."""

    zero: list[list[float]] | None = None
    roi: list[float] | None = None
    masks: list[list[float]] = dataclasses.field(default_factory=list)

    @property
    def corners(self) -> dict[tuple[str, int, int], tuple[float, float]]:
        """The points that can be dragged: by what they belong to, its number, and theirs."""
        corners = {("zero", 0, k): (x, y) for k, (x, y) in enumerate(self.zero or [])}
        for name, number, box in (("roi", 0, self.roi), *(("mask", n, mask) for n, mask in enumerate(self.masks))):
            if box is not None:
                corners |= {(name, number, 0): (box[0], box[1]), (name, number, 1): (box[2], box[3])}
        return corners

    def drag(self, corner: tuple[str, int, int], x: float, y: float) -> None:
        """Put a point elsewhere."""
        name, number, k = corner
        if name == "zero":
            assert self.zero is not None
            self.zero[k] = [x, y]
        else:
            box = self.roi if name == "roi" else self.masks[number]
            assert box is not None
            box[2 * k : 2 * k + 2] = [x, y]

    def settle(self) -> None:
        """Put the corners of boxes in order, as after one was dragged past the other."""
        for box in (self.roi, *self.masks):
            if box is not None:
                box[:] = [*map(min, box[:2], box[2:]), *map(max, box[:2], box[2:])]


@dataclasses.dataclass(frozen=True)
class Preview:
    """A photograph as the page shows it: a JPEG, a small one for the list, and the photograph's own size in px."""

    jpeg: bytes
    small: bytes
    width: int
    height: int


@dataclasses.dataclass(frozen=True)
class Plane:
    """The screen that was found: the setup's text, and the crossings of its grid in px."""

    setup: str
    crossings: Array
    residual: float


@dataclasses.dataclass(frozen=True)
class Traced:
    """An edge in a photograph, px, shape (n, 2); both ends of each point's standard error, shape (2, n, 2), ``enlarged`` to
    be seen; doubts, one sentence each; the zero line, shape (2, 2), if the photograph or the setup shows one; the height
    above it and its error in m, if the setup has one."""

    edge: Array
    band: Array
    enlarged: int
    doubts: tuple[str, ...]
    zero: Array | None
    height: float | None
    height_error: float | None


@dataclasses.dataclass(frozen=True)
class Overlay:
    """A simulated outline over a photograph in px, shape (k, 2), and measured minus simulated height, rms in m, where the
    simulated outline is not below the undeformed surface; its axis is where that is least."""

    curve: Array
    difference: float
