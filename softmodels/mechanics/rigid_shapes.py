"""Rigid shapes that faces of the device come to rest on: a sphere, a cylinder, a capsule, from outside or from within.

One from an STL file is in `softmodels.mechanics.stl_shapes`. The others are the places nearer than a radius to a part of a
line: a point, an endless line, a piece of one. With the signed distance g of a deformed place x to the shape, the energy per
undeformed area is that of a plane's contact, phi(max(-g, 0)); see `softmodels.mechanics.contact`. It is without friction.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from geometries.fields import choice_field, field_of, length_field, list_field
from geometries.imported_mesh import UNITS
from geometries.kinds import Flag, Length, Quantity, Several, Words
from softmodels.mechanics.contact import NEAR, ONSET_PRESSURE, STIFFNESS, penalty
from softmodels.mechanics.contact_part import ContactPart, force_of_all
from softmodels.mechanics.face_nodes import FaceNodes, check_mesh_faces
from softmodels.mechanics.named_places import check_on_mesh
from softmodels.mechanics.parts import Equations, PartError, Setting, Term, register_part
from softmodels.mechanics.stl_shapes import FileShapeTerm, check_file_on

if TYPE_CHECKING:
    from dolfinx import fem

Array = npt.NDArray[np.float64]

SHAPES = ("sphere", "cylinder", "capsule", "stl")
ENDLESS = 1e3
"""Half length of a cylinder in sizes of the device."""
SPECK = 1e-20
"""Added to squared distances, in squared sizes: the distance from a line has no slope on the line itself."""
DEEPEST = 0.05
"""Depth in sizes of the device at which a state is refused: the device would have passed over the shape."""
WAY = 8
"""Places on the straight way of a node from state to state at which its depth is looked at."""
AXES = "xyz"
HARDENS = 0.25
"""Share of the depth at which a state is refused from which the shape grows harder. The energy is of the undeformed area, which
a wrapped membrane stretches to ten or twenty times itself, so that it would sink in ten or twenty times as deep."""
HARDER = 16.0
"""How steeply: at the refused depth the contact is 1 + HARDER (1 - HARDENS)^2 / (2 HARDENS), some 19, times as hard."""


@register_part
@dataclasses.dataclass(frozen=True)
class RigidShape(ContactPart):
    """A rigid shape without friction, and the faces that it stops.

    Attributes:
        shape: One of `SHAPES`.
        faces: Roles of the facets that it stops, such as ``"outer"`` or ``"top, outer"``; others pass through it.
        at: A point in m: the middle of a sphere or capsule, a point on a cylinder's axis, where the origin of an STL file goes.
        radius: Radius in m.
        along: Direction of a cylinder's or capsule's axis.
        length: Distance in m between the middles of a capsule's two ends.
        hollow: Whether the device lies within the shape, as in a tube.
        file, unit: An STL file, and the unit of its lengths.
        rounding: Length in m over which an STL file's edges are rounded; 0 for 0.4 of a stopped facet's.
        stiffness: Contact pressure per penetration, in shear moduli over `Actuator.size`.
    """

    shape: str = choice_field(
        "sphere", SHAPES, "a sphere, a cylinder without ends, a capsule (a cylinder with round ends), or an STL file"
    )
    faces: str = field_of(Words(), "faces that it stops, such as outer or 'top, outer'", "")
    at: tuple[float, ...] = field_of(
        Several(Length(zero=True, signed=True)),
        "middle of a sphere or capsule, a point on a cylinder's axis, or where an STL file's origin goes",
        (),
    )
    radius: float = length_field(0.0, "radius of the shape", zero=True)
    along: tuple[float, ...] = list_field((0.0, 1.0, 0.0), "direction of a cylinder's or capsule's axis", numbers=True)
    length: float = length_field(0.0, "distance between the middles of a capsule's round ends", zero=True)
    hollow: bool = field_of(Flag(), "the device lies within the shape, as in a tube", False)
    file: str = field_of(Words(), "STL file of the shape's closed surface", "")
    unit: str = choice_field("mm", tuple(UNITS), "unit of the STL file's lengths, which such files do not tell")
    rounding: float = length_field(
        0.0, "length over which an STL file's edges are rounded; 0 for 0.4 of a facet's edge", zero=True
    )
    stiffness: float = field_of(
        Quantity(), "shear moduli of contact pressure per sinking in by one size of the device", STIFFNESS
    )

    table: ClassVar[str] = "contact"
    always_named: ClassVar[bool] = True
    figure_texts: ClassVar = {
        r"(\w+)_force_([xyz])_N": ("force on {0}", "of the device on that rigid shape, along the named axis"),
        r"(\w+)_depth_mm": ("depth in {0}", "how deep the stopped faces have sunk into it"),
    }

    def check(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", self.shape)
        if not self.roles:
            raise PartError(f"{self.where} needs the faces that are stopped (faces = 'outer')")
        if len(self.at) != 3:
            raise PartError(f"{self.where}: a place has three coordinates (at = ['0 mm', '0 mm', '30 mm'])")
        self.check_stiffness()
        if self.shape == "stl":
            self._check_file()
            return
        if self.file or self.rounding:
            raise PartError(f"{self.where}: a {self.shape} has no file and no rounding; shape = 'stl' has")
        if self.radius <= 0.0:
            raise PartError(f"{self.where}: a {self.shape} needs a radius above zero (radius = '5 mm')")
        if len(self.along) != 3 or not any(self.along):
            raise PartError(
                f"{self.where}: along = {list(self.along)} is no direction; write three numbers, such as [0, 1, 0]"
            )
        if (self.length > 0.0) != (self.shape == "capsule"):
            raise PartError(f"{self.where}: a capsule has a length above zero, and no other shape has one")

    def _check_file(self) -> None:
        if not self.file:
            raise PartError(f"{self.where}: a shape from an STL file needs that file (file = 'hand.stl')")
        if self.radius or self.length:
            raise PartError(
                f"{self.where}: the size of an STL file's shape is that of the file; leave out radius and length"
            )

    @property
    def files(self) -> Mapping[str, str]:
        return {"file": self.file} if self.file else {}

    @property
    def direction(self) -> Array:
        return np.asarray(self.along) / np.linalg.norm(self.along)

    @property
    def in_model(self) -> str:
        kind = f"shape of {self.file}," if self.file else self.shape
        return f"; the rigid {kind} {self.name} stops {self.faces} alone, without friction"

    def half(self, size: float) -> float:
        """Half the length of the line in its middle, in sizes of the device."""
        return {"sphere": 0.0, "cylinder": ENDLESS, "capsule": self.length / 2 / size}[self.shape]

    def deepest(self, size: float) -> float:
        """Depth in sizes of the device at which a state is refused."""
        return DEEPEST if self.hollow else min(DEEPEST, 0.5 * self.radius / size)

    def check_on(self, actuator: Actuator) -> None:
        check_on_mesh(self.where, actuator, self.roles)
        if self.file:
            check_file_on(self, actuator)
            return
        at, along = np.asarray(self.at), self.direction
        if actuator.dimension == 2:
            if np.abs(at[:2]).max() > 0.0 or (self.shape != "sphere" and abs(along[2]) < 1 - 1e-12):
                raise PartError(
                    f"{self.where}: beside an axisymmetric section a shape is one of revolution: at = ['0 mm', '0 mm', ...] "
                    "and along = [0, 0, 1]"
                )
            return
        for plane in actuator.cut_planes:
            normal = np.asarray(plane.normal)
            beyond, lean = float(at @ normal), abs(float(along @ normal))
            reach = self.radius + (0.0 if self.shape == "sphere" else self.half(1.0) * lean)
            askew = self.shape != "sphere" and 1e-9 < lean < 1 - 1e-9
            if -beyond < reach * (1 - 1e-9) and (abs(beyond) > 1e-9 * reach or askew):
                if self.shape == "cylinder" and lean > 1 - 1e-9:
                    continue
                raise PartError(
                    f"{self.where}: the {self.shape} crosses the cut plane {plane.name} and is not its own mirror image there; "
                    f"put its middle on that plane, or model the whole device"
                )

    @staticmethod
    def distance(x: Sequence[Array], numbers: tuple[Array, Array, float, float, float]) -> Array:
        """Signed distance of a place in sizes, from components of NumPy or of UFL alike; below zero where it is stopped.

        Args:
            x: Three components in sizes.
            numbers: As `numbers` gives them, or UFL constants in their place.
        """
        at, along, radius, half, sign = numbers
        v = [x[i] - at[i] for i in range(3)]
        t = v[0] * along[0] + v[1] * along[1] + v[2] * along[2]
        t = (abs(t + half) - abs(t - half)) / 2  # no further than its ends
        v = [v[i] - t * along[i] for i in range(3)]
        return sign * ((v[0] ** 2 + v[1] ** 2 + v[2] ** 2 + SPECK) ** 0.5 - radius)

    def numbers(self, size: float) -> tuple[Array, Array, float, float, float]:
        """Place, direction, radius, half length and side, in sizes of the device."""
        return (
            np.asarray(self.at) / size,
            self.direction,
            self.radius / size,
            self.half(size),
            -1.0 if self.hollow else 1.0,
        )

    def hindrance(self, actuator: Actuator, figure: Callable[[str], float]) -> str:
        depth = figure(f"{self.label}_depth_mm")
        return self.try_other(f"faces press on {self.where} and have sunk {depth:.3g} mm into it") if depth else ""

    def term(self, setting: Setting) -> Term:
        check_mesh_faces(setting.body, self.roles, self.where)
        if self.file:
            return FileShapeTerm(self, setting)
        term = ShapeTerm(self, setting)
        term.check_rest()
        return term


class ShapeTerm(Term):
    """The energy of a rigid shape's contact, with the force on it.

    Args:
        shape: The shape.
        setting: The potential.
    """

    def __init__(self, shape: RigidShape, setting: Setting):
        super().__init__([])
        import ufl
        from dolfinx import fem

        self.shape, self.body = shape, setting.body
        body, mesh, size = self.body, self.body.mesh, self.body.actuator.size
        self.numbers = shape.numbers(size)
        self._constants = constants = tuple(fem.Constant(mesh, value) for value in self.numbers)
        onset, soft = ONSET_PRESSURE / shape.stiffness, HARDENS * shape.deepest(size)
        stiffness, onset, soft = (fem.Constant(mesh, float(value)) for value in (shape.stiffness, onset, soft))
        place = ufl.variable(ufl.SpatialCoordinate(mesh) + body.displacement(setting.displacement))
        components = [place[0], place[1], place[2]] if mesh.topology.dim == 3 else [place[0], 0.0, place[1]]
        depth = ufl.max_value(-shape.distance(components, constants), 0.0)
        energy = stiffness * (penalty(depth, onset) + HARDER / (6 * soft) * ufl.max_value(depth - soft, 0.0) ** 3)
        push = -ufl.diff(energy, place)  # on the device; the shape takes the opposite
        self.energies, self._forces = [], []
        for role in shape.roles:
            area = body.sheet_face(role)[0]
            self.energies.append(energy * body.hoop * area)
            self._forces.append([-push[c] * body.hoop * area for c in range(mesh.topology.dim)])
        self.nodes = FaceNodes(body, setting.w.function_space, shape.roles)

    def _distances(self, places: Array) -> Array:
        x, y = places[:, 0], places[:, -1]
        components = [x, np.zeros_like(x), y] if places.shape[1] == 2 else list(places.T)
        return np.asarray(self.shape.distance(components, self.numbers))

    def move_to(self, at: npt.ArrayLike) -> None:
        """Put the shape somewhere else, in m: an indenter that comes down from state to state."""
        place = np.asarray(at, dtype=float) / self.body.actuator.size
        self.numbers = (place, *self.numbers[1:])
        self._constants[0].value = place

    def check_rest(self) -> None:
        """Refuse a shape that lies in the device at rest.

        Raises:
            PartError: It does.
        """
        from softmodels.mechanics.mpi import largest

        points = self.body.mesh.geometry.x[:, : self.body.mesh.topology.dim]
        deepest = -float(self._distances(points).min()) if len(points) else -math.inf
        deepest = largest(self.body.mesh.comm, deepest)
        if deepest > NEAR:
            shape, depth = self.shape, deepest * self.body.actuator.size * 1e3
            side = "outside of the hollow" if shape.hollow else "in the"
            raise PartError(
                f"{shape.where}: at rest the device lies {depth:.4g} mm deep {side} {shape.shape}; move it away, or give it "
                "another radius"
            )

    def compile(self, equations: Equations) -> None:
        self._compiled: list[list[fem.Form]] = [[equations.form(force) for force in forces] for forces in self._forces]

    def figures(self, equations: Equations) -> dict[str, float]:
        actuator = self.body.actuator
        unit = equations.stress_unit * equations.length_unit**2
        axes = "xyz" if actuator.dimension == 3 else "xz"
        force = dict.fromkeys(AXES, 0.0)
        for forces in self._compiled:
            for axis, form in zip(axes, forces, strict=True):
                force[axis] += unit * equations.integral(form)
        total = self._of_all_copies(np.array(list(force.values())))
        depth = -float(self._distances(self.nodes.moved(equations.w.x.array)).min())
        label, shown = self.shape.label, AXES if actuator.dimension == 3 else "z"
        found = {f"{label}_force_{axis}_N": float(total[AXES.index(axis)]) for axis in shown}
        return found | {f"{label}_depth_mm": max(depth, 0.0) * equations.length_unit * 1e3}

    def _of_all_copies(self, force: Array) -> Array:
        actuator, shape = self.body.actuator, self.shape
        normals = [np.asarray(plane.normal) for plane in actuator.cut_planes]
        return force_of_all(actuator, [n for n in normals if abs(np.asarray(shape.at) @ n) < shape.radius], force)

    def admits(self, before: Array, after: Array) -> bool:
        start, end = self.nodes.moved(before), self.nodes.moved(after)
        limit = self.shape.deepest(self.body.actuator.size)
        way = [start + t * (end - start) for t in np.linspace(0.0, 1.0, WAY + 1)[1:]]
        return all(float(self._distances(places).min()) > -limit for places in way)
