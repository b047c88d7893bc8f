"""Rigid shapes from an STL file, that faces of the device come to rest on, from outside or from within.

The distance from the file's triangles is the smooth gap of `softmodels.mechanics.walls.gap`, with samples that stand still:
exact on flat parts, rounded at edges over the kernel's radius, and twice differentiable everywhere. A sphere of radius r
appears larger by a tenth of the kernel's radius squared over r.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from geometries import Actuator, GeometryError
from geometries.foreign_meshes import read_surfaces
from geometries.imported_mesh import UNITS
from softmodels.mechanics.contact import NEAR, ONSET_PRESSURE
from softmodels.mechanics.contact_part import StoppingShape, shape_figures
from softmodels.mechanics.face_nodes import FaceNodes
from softmodels.mechanics.parts import Equations, PartError, Setting
from softmodels.mechanics.walls.fixed import FixedWall, PressedOn, TooFineError
from softmodels.mechanics.walls.gap import Penalty
from softmodels.mechanics.walls.pressing import PressingTerm
from softmodels.mechanics.walls.surface import Surface

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]

ROUNDING = 0.4
"""Radius of the kernel in edges of the stopped facets, where the user gives none."""
DEEPEST = 0.3
"""Depth in radii of the kernel at which a state is refused: the wall is seen up to a radius behind it, and then no more."""
STRIDE = 0.5
"""Radii that a node moves between two looks at its depth."""
MOST_LOOKS = 60
SAME = 1e-6
"""Share of the shape's extent by which its corners may miss their mirror images."""
PROBED = 50
"""Nodes whose place within the shape is looked for by its winding number: touching surfaces are found by the gap."""


class FileShape(StoppingShape, Protocol):
    """A shape with a file."""

    @property
    def at(self) -> tuple[float, ...]: ...
    @property
    def file(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def rounding(self) -> float: ...


def surface_of(shape: FileShape) -> tuple[Array, Numbers]:
    """Corners in m where they stand, shape (n, 3), and triangles of a shape's file, counter-clockwise from outside.

    Raises:
        PartError: It cannot be read, is not closed, or its triangles turn different ways.
    """
    try:
        points, triangles = _read(shape.file, UNITS[shape.unit], Path(shape.file).stat().st_mtime_ns)
    except OSError as error:
        raise PartError(f"{shape.where}: file {shape.file} cannot be read ({error.strerror})") from None
    except GeometryError as error:
        raise PartError(f"{shape.where}: {error}") from None
    return points + np.asarray(shape.at), triangles


@functools.lru_cache(maxsize=8)
def _read(file: str, unit: float, changed: int) -> tuple[Array, Numbers]:
    points, triangles = read_surfaces(file, unit)
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    if len(np.unique(edges, axis=0)) < len(edges):
        raise GeometryError(f"the triangles of {file} turn different ways; repair it in the program that wrote it")
    corners = points[triangles]
    volume = float(np.einsum("ti,ti->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))) / 6
    return points, triangles if volume > 0.0 else triangles[:, ::-1]


def _same(points: Array) -> float:
    """Distance in m below which places on a shape are the same."""
    return SAME * float(np.linalg.norm(np.ptp(points, axis=0)))


def crossed_by_file(shape: FileShape, actuator: Actuator) -> list[Array]:
    """Normals of the cut planes that a shape crosses; `PartError` as for `surface_of`."""
    points, _ = surface_of(shape)
    near, normals = _same(points), [np.asarray(plane.normal, dtype=float) for plane in actuator.cut_planes]
    return [n for n in normals if (points @ n).min() < -near and (points @ n).max() > near]


def check_file_on(shape: FileShape, actuator: Actuator) -> None:
    """Raise `PartError` for a file that cannot be read, or a shape that cannot stand beside this device."""
    points, _ = surface_of(shape)
    if actuator.dimension == 2:
        raise PartError(
            f"{shape.where}: beside an axisymmetric section a shape is one of revolution; take the solid (section = 'solid')"
        )
    from scipy.spatial import cKDTree

    near = _same(points)
    for plane in actuator.cut_planes:
        n = np.asarray(plane.normal, dtype=float)
        if (points @ n).max() <= near:
            continue
        image = points - 2 * np.outer(points @ n, n)
        if cKDTree(points).query(image)[0].max() > near:
            raise PartError(
                f"{shape.where}: {shape.file} crosses the cut plane {plane.name} and is not its own mirror image there, "
                "corner by corner; model the whole device"
            )


class FileShapeTerm(PressingTerm[PressedOn]):
    """The energy of contact with an STL file's shape, with the force on it.

    Args:
        shape: The shape.
        setting: The potential.
    """

    def __init__(self, shape: FileShape, setting: Setting):
        body = setting.body
        nodes = FaceNodes(body, setting.w.function_space, shape.roles)
        super().__init__(nodes)
        self.shape, self.actuator = shape, body.actuator
        size = self.actuator.size
        points, triangles = surface_of(shape)
        self.crossed = crossed_by_file(shape, self.actuator)
        self.surface = Surface(nodes.places, nodes.facets, nodes.faces, nodes.inside)
        edges, measure = self.surface.edges, self.surface.measure
        radius = shape.rounding / size or ROUNDING * float(edges @ measure / measure.sum())
        try:
            self.wall = FixedWall.of(points / size, triangles[:, ::-1] if shape.hollow else triangles, radius)
        except TooFineError:
            raise PartError(
                f"{shape.where}: {shape.file} is large against a rounding of {radius * size * 1e3:.3g} mm; take a larger "
                "rounding, or cut off what the device does not come near"
            ) from None
        self.penalty = Penalty(shape.stiffness, ONSET_PRESSURE / shape.stiffness)
        self.move(nodes.places)
        self._check_rest(points / size, triangles)

    def _check_rest(self, points: Array, triangles: Numbers) -> None:
        chosen = self.nodes.places[:: max(1, len(self.nodes.places) // PROBED)]
        inside = np.abs(_winding(chosen, points[triangles])) > 0.5
        if self._pressed.depth > NEAR or bool((inside != self.shape.hollow).any()):
            side = "outside of the hollow" if self.shape.hollow else "in the"
            raise PartError(
                f"{self.shape.where}: at rest the device lies {side} shape of {self.shape.file}, or touches it; "
                "move it away (at)"
            )

    def pressed(self, places: Array) -> PressedOn:
        return PressedOn(self.surface, self.wall, self.penalty, places)

    def admits(self, before: Array, after: Array) -> bool:
        return self.clear(self.nodes.moved(before), self.nodes.moved(after))

    def clear(self, start: Array, end: Array) -> bool:
        """Whether nodes may go from places to places, shape (n, 3) each, without passing through the shape."""
        farthest, limit = float(np.linalg.norm(end - start, axis=1).max(initial=0.0)), DEEPEST * self.wall.radius
        looks = int(np.clip(np.ceil(farthest / (STRIDE * self.wall.radius)), 1, MOST_LOOKS))
        way = (self.surface.places(start + t * (end - start)) for t in np.linspace(0.0, 1.0, looks + 1)[1:])
        return all(float(self.wall.gaps(places).min(initial=np.inf)) > -limit for places in way)

    def figures(self, equations: Equations) -> dict[str, float]:
        self._take(equations.w.x.array)
        force = equations.stress_unit * equations.length_unit**2 * self._pressed.forces.sum(axis=0)
        depth = self._pressed.depth * equations.length_unit
        return shape_figures(self.shape.label, self.actuator, self.crossed, force, depth)


def _winding(places: Array, corners: Array) -> Array:
    """How often a closed surface goes around places, shape (n,): the solid angle of its triangles, shape (t, 3, 3), over 4 pi.

    Van Oosterom and Strackee 1983, doi 10.1109/TBME.1983.325207.
    """
    found = np.empty(len(places))
    for number, place in enumerate(places):
        a, b, c = np.moveaxis(corners - place, 1, 0)
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        over = np.einsum("ti,ti->t", a, np.cross(b, c))
        under = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        found[number] = 2 * np.arctan2(over, under).sum() / (4 * np.pi)
    return found
