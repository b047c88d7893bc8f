"""Rigid shapes that faces of the device come to rest on: a sphere, a cylinder, a capsule, from outside or from within; a plane.

One from an STL file is in `softmodels.mechanics.stl_shapes`, the distance from others in `softmodels.mechanics.round_shapes`.
With the signed distance g of a deformed place x to the shape, the energy per undeformed area is that of a plane's contact,
phi(max(-g, 0)); see `softmodels.mechanics.contact`. A shape stands still, and faces may rub on it, or gives way along a line.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from geometries.fields import choice_field, field_of, length_field, list_field
from geometries.imported_mesh import UNITS
from geometries.kinds import Flag, Length, Quantity, Several, Words
from softmodels.mechanics.contact import STIFFNESS
from softmodels.mechanics.contact_part import ContactPart
from softmodels.mechanics.face_nodes import check_mesh_faces
from softmodels.mechanics.guided_shapes import GuidedShapeTerm, check_guide, check_guide_on, check_weight
from softmodels.mechanics.load_directions import direction
from softmodels.mechanics.named_places import check_on_mesh
from softmodels.mechanics.parts import PartError, Setting, Term, register_part
from softmodels.mechanics.round_shapes import Numbers
from softmodels.mechanics.rubbing_shapes import RubbingShapeTerm, check_friction
from softmodels.mechanics.shape_terms import SampledShapeTerm, ShapeTerm
from softmodels.mechanics.stl_shapes import FileShapeTerm, check_file_on, crossed_by_file

Array = npt.NDArray[np.float64]

SHAPES = ("sphere", "cylinder", "capsule", "plane", "stl")
ENDLESS = 1e3
"""Half length of a cylinder in sizes of the device."""
DEEPEST = 0.05
"""Depth in sizes of the device at which a state is refused: the device would have passed over the shape."""


@register_part
@dataclasses.dataclass(frozen=True)
class RigidShape(ContactPart):
    """A rigid shape, and the faces that it stops.

    Attributes:
        shape: One of `SHAPES`.
        faces: Roles of the facets that it stops, such as ``"outer"`` or ``"top, outer"``; others pass through it.
        at: A point in m: the middle of a sphere or capsule, a point on a cylinder's axis or in a plane, where the origin of an
            STL file goes.
        radius: Radius in m; a plane has none.
        along: Direction of a cylinder's or capsule's axis, or of a plane's normal, which points to the device.
        length: Distance in m between the middles of a capsule's two ends.
        hollow: Whether the device lies within the shape, as in a tube.
        file, unit: An STL file, and the unit of its lengths.
        rounding: Length in m over which an STL file's edges are rounded; 0 for 0.4 of a stopped facet's.
        stiffness: Contact pressure per penetration, in shear moduli over `Actuator.size`.
        guide: Direction along which it gives way, as `softmodels.mechanics.load_directions.direction` reads it; empty for none.
        spring: Stiffness in N/m of a spring that holds it there.
        mass: In kg; where gravity pulls it against the guide, a stand holds it where it is until it is lifted, and where it
            pulls the other way the spring does.
        friction: Coefficient of Coulomb friction of the faces on a shape that stands still.
        slip: Way in m over which friction sets in; 0 for a thousandth of `Actuator.size`.
    """

    shape: str = choice_field(
        "sphere",
        SHAPES,
        "a sphere, a cylinder without ends, a capsule (a cylinder with round ends), a plane, or an STL file",
    )
    faces: str = field_of(Words(), "faces that it stops, such as outer or 'top, outer'", "")
    at: tuple[float, ...] = field_of(
        Several(Length(zero=True, signed=True)),
        "middle of a sphere or capsule, a point on a cylinder's axis or in a plane, or where an STL file's origin goes",
        (),
    )
    radius: float = length_field(0.0, "radius of the shape", zero=True)
    along: tuple[float, ...] = list_field(
        (0.0, 1.0, 0.0),
        "direction of a cylinder's or capsule's axis, or of a plane's normal to the device's side",
        numbers=True,
    )
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
    guide: str = field_of(
        Words(), "direction along which the shape gives way, such as z; it stands still if left out", ""
    )
    spring: float = field_of(Quantity("N/m"), "spring that holds a shape with a guide", 0.0)
    mass: float = field_of(
        Quantity("kg"),
        "mass of a shape with a guide, which gravity pulls at: it lies on a stand until it is lifted",
        0.0,
    )
    friction: float = field_of(
        Quantity(), "coefficient of Coulomb friction of the faces on a shape that stands still", 0.0
    )

    slip: float = length_field(
        0.0, "way over which friction sets in, without sliding; 0 for a thousandth of the device's size", zero=True
    )

    table: ClassVar[str] = "contact"
    always_named: ClassVar[bool] = True
    figure_texts: ClassVar = {
        r"(\w+)_force_([xyz])_N": ("force on {0}", "of the device on that rigid shape, along the named axis"),
        r"(\w+)_depth_mm": ("depth in {0}", "how deep the stopped faces have sunk into it"),
        r"(\w+)_way_mm": ("way of {0}", "how far that rigid shape has given way along its guide"),
        r"(\w+)_sliding": ("share that slides on {0}", "of the force that presses the faces on it; the rest sticks"),
        r"(\w+)_slip_mm": ("largest slip on {0}", "how far a point of the faces has slid on it"),
        r"(\w+)_friction_mJ": ("friction on {0}", "work that sliding on that rigid shape has taken so far"),
    }

    def check(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", self.shape)
        if not self.roles:
            raise PartError(f"{self.where} needs the faces that are stopped (faces = 'outer')")
        if len(self.at) != 3:
            raise PartError(f"{self.where}: a place has three coordinates (at = ['0 mm', '0 mm', '30 mm'])")
        self.check_stiffness()
        check_guide(self)
        check_friction(self)
        if self.shape == "stl":
            self._check_file()
            return
        if self.file or self.rounding:
            raise PartError(f"{self.where}: a {self.shape} has no file and no rounding; shape = 'stl' has")
        if self.shape == "plane":
            if self.radius or self.length or self.hollow:
                raise PartError(
                    f"{self.where}: a plane has a point (at) and a normal to the device's side (along), and no radius, length "
                    "or hollow"
                )
        elif self.radius <= 0.0:
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
    def weighs(self) -> float:
        return self.mass

    @property
    def lifted(self) -> bool:
        return True

    def check_under(self, gravity: Array) -> None:
        if self.mass:
            check_weight(self, gravity)

    @property
    def gives_way(self) -> Array:
        """Unit vector of its guide."""
        return np.asarray(direction(self.guide, self.where))

    @property
    def in_model(self) -> str:
        kind = f"shape of {self.file}," if self.file else self.shape
        gives = f" and gives way along {self.guide} alone, without turning" if self.guide else ""
        rubs = f"with a coefficient of friction of {self.friction:g}" if self.friction else "without friction"
        return f"; the rigid {kind} {self.name} stops {self.faces} alone, {rubs}{gives}"

    @property
    def remembers(self) -> bool:
        return self.friction > 0.0

    def half(self, size: float) -> float:
        """Half the length of the line in its middle, in sizes of the device."""
        return {"cylinder": ENDLESS, "capsule": self.length / 2 / size}.get(self.shape, 0.0)

    def deepest(self, size: float) -> float:
        """Depth in sizes of the device at which a state is refused."""
        return DEEPEST if self.hollow or self.shape == "plane" else min(DEEPEST, 0.5 * self.radius / size)

    def crossed(self, actuator: Actuator) -> list[Array]:
        """Normals of the cut planes that it crosses."""
        if self.file:
            return crossed_by_file(self, actuator)
        normals = [np.asarray(plane.normal, dtype=float) for plane in actuator.cut_planes]
        if self.shape == "plane":
            return normals
        return [normal for normal in normals if abs(np.asarray(self.at) @ normal) < self.radius]

    def check_on(self, actuator: Actuator) -> None:
        check_on_mesh(self.where, actuator, self.roles)
        if self.file:
            check_file_on(self, actuator)
        else:
            self._check_round_on(actuator)
        if self.guide:
            check_guide_on(self, actuator, self.crossed(actuator))

    def _check_round_on(self, actuator: Actuator) -> None:
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
            if self.shape == "plane":
                if abs(float(along @ normal)) > 1e-9:
                    raise PartError(
                        f"{self.where}: the plane is not square to the cut plane {plane.name}, and so not its own mirror image "
                        "there; turn it, or model the whole device"
                    )
                continue
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

    def numbers(self, size: float) -> Numbers:
        """Place, direction, radius, half length and side, in sizes of the device."""
        return (
            np.asarray(self.at) / size,
            self.direction,
            None if self.shape == "plane" else self.radius / size,
            self.half(size),
            -1.0 if self.hollow else 1.0,
        )

    def hindrance(self, actuator: Actuator, figure: Callable[[str], float]) -> str:
        depth = figure(f"{self.label}_depth_mm")
        return self.try_other(f"faces press on {self.where} and have sunk {depth:.3g} mm into it") if depth else ""

    def term(self, setting: Setting) -> Term:
        check_mesh_faces(setting.body, self.roles, self.where)
        if self.guide or self.friction:
            standing = FileShapeTerm(self, setting) if self.file else SampledShapeTerm(self, setting)
            return (GuidedShapeTerm if self.guide else RubbingShapeTerm)(self, standing, setting)
        return FileShapeTerm(self, setting) if self.file else ShapeTerm(self, setting)
