"""Contact: of faces with a rigid plane or shape, with friction, guides and seals, of walls with each other, and of two bodies.

A plane stands for a bench, a plate above, or the mirror plane between two chambers.

Contact is an energy of the penetration d of every point of the faces, per undeformed area,

    phi(d) = k d^3 / (6 e)                       0 < d < e
    phi(d) = k (d^2/2 - e d/2 + e^2/6)           e < d

a penalty k with an onset smoothed over a depth e: its second derivative is continuous, so that Newton's method and the path's
tangents meet no jump (Wriggers 2006, Computational Contact Mechanics). It is conservative and without friction.
A wall that meets its own mirror image presses on the plane of the mirror as on a rigid one, so the same term is the
contact of neighbouring chambers that are each other's mirror images.
"""

from __future__ import annotations

import abc
import copy
import dataclasses
import functools
import itertools
import math
import re
from collections.abc import Callable, Mapping, Sequence, Set
from typing import ClassVar, Self

import numpy as np
import numpy.typing as npt

from geometries import Actuator, GeometryError, actuator
from geometries.actuator import Vector
from geometries.faces import UNITS, FaceNumberError, faces as plane_faces
from softmodels.common import errors, schema
from softmodels.common.arrays import Array
from softmodels.common.lazy import Expr, fem, scipy, ufl
from softmodels.components import pressing, shapes, touching
from softmodels.mechanics import assembly, component, mpi
from softmodels.mechanics.body import Body, in_section, in_space
from softmodels.mechanics.component import Component, ComponentError, direction

CONTACT_STIFFNESS = 300.0
"""Shear moduli of pressure per penetration of one size of the device: a contact pressure of one shear modulus, more than
soft actuators take, sinks in by 0.3 % of the size. The default disk presses on a plate with 0.2 % less than on a rigid one;
1000 takes half as many iterations more."""
MIN_STIFFNESS, MAX_STIFFNESS = 1.0, 1e5
ONSET_DEPTH = 1e-3
"""Penetration over which contact sets in, relative to the device's size."""
ONSET_PRESSURE = 0.3
"""Contact pressure in shear moduli at the end of the onset, without smoothing."""
PLANE_TOLERANCE = 1e-6
"""Distance relative to the size up to which a point counts as in the plane."""


class ContactPart(component.EnergyComponent):
    """Contact of faces; each kind is a dataclass with the fields below.

    Attributes:
        faces: Roles of the facets, with commas between.
        stiffness: Contact pressure per penetration, in shear moduli over `Actuator.size`.
        softest, usual: The least stiffness that is taken, and the one that serves most devices.
    """

    faces: str
    stiffness: float
    softest: ClassVar[float] = MIN_STIFFNESS
    usual: ClassVar[float] = CONTACT_STIFFNESS

    @property
    def roles(self) -> list[str]:
        return component.names_in(self.faces)

    def try_other(self, pressed: str) -> str:
        """Return advice if contact may have ended a path; ``pressed`` describes the contact and its depth, as a clause."""
        return (
            f"{pressed}: try another stiffness than {self.stiffness:g} (larger: less penetration; smaller: "
            f"easier convergence), and smaller cells where they touch"
        )

    def check_stiffness(self) -> None:
        """Raise `ComponentError` for a stiffness out of range."""
        if not self.softest <= self.stiffness <= MAX_STIFFNESS:
            raise self.error(
                f"the stiffness is {self.stiffness:g} shear moduli per size of the device; {self.softest:g} "
                f"to {MAX_STIFFNESS:g} are accepted (default {self.usual:g})"
            )


# ----------------------------------------------------------------------------------------------------------------------
# Rigid shapes: a sphere, a cylinder, a capsule or an STL file's surface, from outside or inside; a plane.
#
# With the signed distance g of a deformed place x to the shape, the energy per undeformed area is that of a plane's contact,
# phi(max(-g, 0)). A shape is fixed, optionally with friction, or movable along a guide. The distance from a file's triangles is
# the smooth gap of `softmodels.components.pressing`, with fixed samples: exact on flat parts, rounded at edges over the
# kernel's radius, and twice differentiable everywhere. A sphere of radius r appears larger by a tenth of that squared over r.


MAX_FRICTION = 3.0
"""Largest accepted coefficient of friction: rubber on dry glass has 1 to 2."""


@component.register_component
@dataclasses.dataclass(frozen=True)
class RigidShape(ContactPart):
    """A rigid shape, and the faces in contact with it; others pass through it.

    A guide is read by `softmodels.mechanics.component.direction`. A mass rests on a stand until it is lifted where gravity
    pulls it against the guide; where it pulls the other way the spring holds it. For a seal see `SealingTerm`.
    """

    shape: str = schema.choice_field(
        "sphere",
        tuple(shapes.SHAPES),
        "a sphere, a cylinder without ends, a capsule (a cylinder with round ends), a plane, or an STL file",
    )
    faces: str = schema.field_of(schema.Words(), "faces in contact with it, such as outer or 'top, outer'", "")
    at: tuple[float, ...] = schema.field_of(
        schema.Several(schema.Length(zero=True, signed=True)),
        "centre of a sphere or capsule, a point on a cylinder's axis or in a plane, or the position of an STL file's origin",
        (),
    )
    radius: float = schema.length_field(0.0, "radius of the shape", zero=True)
    along: tuple[float, ...] = schema.list_field(
        (0.0, 1.0, 0.0),
        "direction of a cylinder's or capsule's axis, or of a plane's normal to the device's side",
        numbers=True,
    )
    length: float = schema.length_field(0.0, "distance between the centres of a capsule's round ends", zero=True)
    hollow: bool = schema.field_of(schema.Flag(), "the device is inside the shape, as in a tube", False)
    file: str = schema.field_of(schema.Words(), "STL file of the shape's closed surface", "")
    unit: str = schema.choice_field("mm", tuple(UNITS), "unit of the STL file's lengths, which such files do not store")
    rounding: float = schema.length_field(
        0.0, "length over which an STL file's edges are rounded; 0 for 0.4 of a facet's edge", zero=True
    )
    stiffness: float = schema.field_of(
        schema.Quantity(),
        "shear moduli of contact pressure per sinking in by one size of the device",
        CONTACT_STIFFNESS,
    )
    guide: str = schema.field_of(schema.Words(), "direction along which the shape can move, such as z; default: fixed", "")
    spring: float = schema.field_of(schema.Quantity("N/m"), "spring that holds a shape with a guide", 0.0)
    mass: float = schema.field_of(
        schema.Quantity("kg"),
        "mass of a shape with a guide, on which gravity acts: it rests on a stand until it is lifted",
        0.0,
    )
    friction: float = schema.field_of(schema.Quantity(), "coefficient of Coulomb friction of the faces on a fixed shape", 0.0)

    slip: float = schema.length_field(
        0.0, "elastic slip over which friction sets in; 0 for a thousandth of the device's size", zero=True
    )
    seal: bool = schema.field_of(
        schema.Flag(), "the cavity ends where the faces press on this plane, as under a suction cup's lip", False
    )

    table: ClassVar[str] = "contact"
    always_named: ClassVar[bool] = True
    figure_texts: ClassVar = {
        r"(\w+)_force_([xyz])_N": ("force on {0}", "of the device on that rigid shape, along the named axis"),
        r"(\w+)_depth_mm": ("penetration of {0}", "of the faces into it"),
        r"(\w+)_travel_mm": ("travel of {0}", "displacement of that rigid shape along its guide"),
        r"(\w+)_sliding": ("share that slides at {0}", "of the normal force; the rest sticks"),
        r"(\w+)_slip_mm": ("largest slip on {0}", "largest distance a point of the faces has slid on it"),
        r"(\w+)_friction_mJ": ("friction on {0}", "work dissipated by sliding there so far"),
        r"(\w+)_contact_mm2": ("contact area on {0}", "undeformed area of the faces that press on that sealing plane"),
        r"(\w+)_sealed_mm2": ("sealed area on {0}", "area of that plane on which the cavity's pressure acts"),
        r"(\w+)_hold_N": ("holding force on {0}", "vacuum times sealed area: the pull at which the seal would open"),
        r"(\w+)_shear_N": ("shear held by {0}", "lateral force at which the faces slide: friction times contact force"),
    }

    def check(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", self.shape)
        if not self.roles:
            raise ComponentError(f"{self.where} needs faces in contact (faces = 'outer')")
        if len(self.at) != 3:
            raise self.error("at needs three coordinates (at = ['0 mm', '0 mm', '30 mm'])")
        self.check_stiffness()
        self._check_guide()
        self._check_friction()
        if self.file:
            object.__setattr__(self, "file", errors.whole_path(self.file))
        form = self.form
        given = [name for name in ("radius", "length", "hollow", "file", "rounding") if getattr(self, name)]
        if foreign := [name for name in given if not hasattr(form, name)]:
            raise self.error(f"shape = {self.shape!r} has no {' and no '.join(foreign)}; leave out {', '.join(foreign)}")
        form.check()
        if self.seal and (not isinstance(form, shapes.Plane) or self.guide):
            raise self.error("a cavity seals only on a fixed plane (shape = 'plane', without guide)")

    @property
    def form(self) -> shapes.Shape:
        """Its geometry."""
        kind = shapes.SHAPES[self.shape]
        return kind(**{field.name: getattr(self, field.name) for field in dataclasses.fields(kind)})

    def _check_guide(self) -> None:
        if not self.guide:
            if self.spring or self.mass:
                raise self.error("a spring or a mass needs a guide (guide = 'z')")
            return
        direction(self.guide, self.where)
        if not (self.spring > 0.0 or self.mass > 0.0) or min(self.spring, self.mass) < 0.0:
            raise self.error(
                f"the guide along {self.guide} needs a spring or a mass above zero (spring = '50 N/m', or mass = '20 g')"
            )

    def _check_friction(self) -> None:
        check_friction(self)
        if self.friction and self.guide:
            raise self.error(
                f"friction needs a fixed shape, but this one moves along {self.guide}; leave out the guide or the friction"
            )

    @property
    def files(self) -> Mapping[str, str]:
        return {"file": self.file} if self.file else {}

    @property
    def variable(self) -> Mapping[str, str]:
        return dict.fromkeys(actuator.AXES, "m")

    def number(self, name: str) -> float:
        return self.at[actuator.AXES.index(name)]

    def varied(self, name: str, value: float) -> Self:
        return dataclasses.replace(self, at=self.nudged(name, value - self.number(name)).at)

    def nudged(self, name: str, by: complex) -> Self:
        made = copy.copy(self)
        at = [place + by * (axis == name) for axis, place in zip(actuator.AXES, self.at, strict=True)]
        object.__setattr__(made, "at", tuple(at))
        return made

    @property
    def weighs(self) -> float:
        return self.mass

    @property
    def lifted(self) -> bool:
        return True

    def check_under(self, gravity: Array) -> None:
        if (
            self.mass
            and not self.spring
            and self.weight_against(gravity) <= component.IN_PLANE_TOLERANCE * self.mass * float(np.linalg.norm(gravity))
        ):
            raise self.error(
                f"gravity along ({', '.join(f'{x:.3g}' for x in gravity)}) m/s^2 does not press the mass "
                f"against its stand along the guide {self.guide}; reverse the guide or gravity, or add a spring "
                "(spring = '50 N/m')"
            )

    def weight_against(self, gravity: Array) -> float:
        """Return the component of its weight against its guide, in N; negative if along it. Gravity in m/s2, shape (3,)."""
        return -self.mass * float(gravity @ self.gives_way)

    @property
    def gives_way(self) -> Array:
        """Unit vector of its guide."""
        return np.asarray(direction(self.guide, self.where))

    @property
    def in_model(self) -> str:
        kind = f"shape of {self.file}," if self.file else self.shape
        gives = f" and moves only along {self.guide}, without rotation" if self.guide else ""
        rubs = f"with a coefficient of friction of {self.friction:g}" if self.friction else "without friction"
        return f"; the rigid {kind} {self.name} stops only {self.faces}, {rubs}{gives}"

    @property
    def remembers(self) -> bool:
        return self.friction > 0.0

    def undesigned(self, actuator: Actuator) -> str:
        return "which seals a cavity, and gradients do not know where it seals" if self.seal else ""

    @property
    def onset(self) -> float:
        """Depth over which the contact sets in, in sizes of the device."""
        return ONSET_PRESSURE / self.stiffness

    @property
    def sealing(self) -> component.Sealing | None:
        if not self.seal:
            return None
        x, y, z = self.at
        i, j, k = map(float, self.form.numbers(1.0)[1])
        return component.Sealing(tuple(self.roles), (x, y, z), (i, j, k))

    def deepest(self, size: float) -> float:
        """Return the penetration relative to the size at which a state is rejected."""
        return self.form.deepest(size)

    def crossed(self, actuator: Actuator) -> list[Array]:
        """Return the normals of the cut planes that it crosses."""
        normals = [np.asarray(plane.normal, dtype=float) for plane in actuator.cut_planes]
        return [normal for normal in normals if self.form.crosses(normal)]

    def check_on(self, actuator: Actuator) -> None:
        component.check_on_mesh(self.where, actuator, self.roles)
        self.form.check_on(actuator)
        if self.guide:
            self._check_guide_on(actuator)

    def _check_guide_on(self, actuator: Actuator) -> None:
        guide = self.gives_way
        if actuator.dimension == 2 and abs(guide[2]) < 1 - component.IN_PLANE_TOLERANCE:
            raise self.error("with an axisymmetric section the guide must be z or -z")
        if any(abs(float(normal @ guide)) > component.IN_PLANE_TOLERANCE for normal in self.crossed(actuator)):
            raise self.error(
                f"along {self.guide} the shape would leave its cut plane; use a guide in that plane, or {actuator.fuller}"
            )

    def hindrance(self, actuator: Actuator, figure: Callable[[str], float]) -> str:
        depth = 1e3 * figure(f"{self.label}_depth")
        return self.try_other(f"faces press on {self.where} with a penetration of {depth:.3g} mm") if depth else ""

    def term(self, setting: component.FormContext) -> component.EnergyTerm:
        assembly.check_mesh_faces(setting.body, self.roles, self.where)
        if self.seal:
            return SealingTerm(self, SampledShapeTerm(self, setting), setting)
        if self.guide or self.friction:
            standing = FileShapeTerm(self, setting) if self.file else SampledShapeTerm(self, setting)
            return (GuidedShapeTerm if self.guide else RubbingShapeTerm)(self, standing, setting)
        return FileShapeTerm(self, setting) if self.file else ShapeTerm(self, setting)


# ----------------------------------------------------------------------------------------------------------------------
# A plane given by its place, without friction.


@component.register_component
@dataclasses.dataclass(frozen=True)
class Obstacle(ContactPart):
    """A rigid plane without friction, and the faces that it stops: ``[contact]``, without a name. The device keeps to the side
    on which these faces lie at rest; others pass through it.

    Raises:
        ComponentError: No such plane, or a stiffness out of `MIN_STIFFNESS` to `MAX_STIFFNESS`.
    """

    faces: str = schema.field_of(
        schema.Words(), "faces that a rigid plane without friction stops, such as top; its force is in path.csv"
    )
    plane: str = schema.field_of(
        schema.Words(),
        "the rigid plane: 'z = 9mm', 'normal 0.6, 0, 0.8 at 9 mm', or a cut plane's name for walls that meet their mirror "
        "image",
    )
    stiffness: float = schema.field_of(
        schema.Quantity(),
        "shear moduli of contact pressure per sinking in by one size of the device",
        CONTACT_STIFFNESS,
    )

    table: ClassVar[str] = "contact"
    differentiable: ClassVar[bool] = True
    optional: ClassVar[bool] = True
    needs: ClassVar[str] = "contact needs faces and a plane (--contact top --contact-plane 'z = 9mm')"
    figure_texts: ClassVar[Mapping[str, tuple[str, str]]] = {
        "contact_force_N": ("contact force", "of the whole device on the rigid plane, along the plane's normal"),
        "contact_depth_mm": ("contact depth", "how deep the stopped faces have sunk into the rigid plane"),
    }

    def check(self) -> None:
        if not (self.roles and self.plane):
            raise ComponentError(self.needs)
        if self.name:
            raise self.error("a plane given by its place is written as [contact], without a name")
        self.check_stiffness()
        if not self.on_cut:
            self._written()

    def check_on(self, actuator: Actuator) -> None:
        component.check_on_mesh("contact", actuator, self.roles)
        self.place(actuator)

    @property
    def in_model(self) -> str:
        return f"; the rigid plane {self.plane} stops only {self.faces}"

    def hindrance(self, actuator: Actuator, figure: Callable[[str], float]) -> str:
        if not figure("contact_force"):
            return ""
        return (
            f"faces press on the contact's plane: try a --contact-stiffness below {self.stiffness:g}, and smaller cells where "
            "they touch"
        )

    @property
    def on_cut(self) -> bool:
        """Whether the plane is one of the device's cut planes, named, on which walls meet their mirror image."""
        return re.fullmatch(r"\w+", self.plane) is not None

    def _written(self) -> tuple[Vector, Vector]:
        """Point (m) and unit normal of a plane given by its place."""
        try:
            chosen = plane_faces("contact plane", self.plane)
            if chosen.normal is not None:
                x, y, z = chosen.normal
                return (x * chosen.at, y * chosen.at, z * chosen.at), chosen.normal
        except FaceNumberError as error:  # the form is right, and a number in it is not
            raise ComponentError(str(error)) from None
        except GeometryError:
            pass
        raise ComponentError(
            f"contact plane {self.plane!r} is not a plane; write 'z = 9mm', 'normal 0.6, 0, 0.8 at 9 mm' or a cut plane's name"
        )

    def place(self, actuator: Actuator) -> tuple[Vector, Vector]:
        """Point (m) and unit normal of the plane, its side not yet chosen; `ComponentError` for an unknown cut plane, or a
        plane that is none of revolution beside an axisymmetric section."""
        if self.on_cut:
            cuts = {plane.name: plane.normal for plane in actuator.cut_planes}
            if self.plane not in cuts:
                known = f"its cut planes are {', '.join(cuts)}" if cuts else "it has no cut planes"
                raise ComponentError(f"contact plane {self.plane!r}: {known}; or write its place, such as 'z = 9mm'")
            return (0.0, 0.0, 0.0), cuts[self.plane]
        point, normal = self._written()
        if actuator.dimension == 2 and abs(normal[2]) < 1 - 1e-12:
            raise ComponentError(
                f"contact plane {self.plane!r}: an axisymmetric section allows only planes perpendicular to its axis, "
                "such as 'z = 9mm'"
            )
        return point, normal

    def term(self, setting: component.FormContext) -> PlaneTerm:
        return PlaneTerm(self, setting)


def obstacle_of(components: Sequence[Component]) -> Obstacle | None:
    """Return the plane among the components of a device; None without one."""
    return next((part for part in components if isinstance(part, Obstacle)), None)


# ----------------------------------------------------------------------------------------------------------------------
# Self-contact of a device's walls: chambers of a bellows, a cavity's own walls.


AUTO, NONE = "auto", "none"
MIN_GAP = 1e-4
"""Minimum undeformed gap, relative to the size, of walls named by the device."""
WALL_GAP = 1e-3
"""Gap relative to the size at which contact sets in, at most half of the undeformed gap: walls of a coarse mesh
are that rough between the contact points."""
WALL_STIFFNESS = 2000.0
"""Shear moduli of pressure per overlap of one size of the device; seven times that of a rigid plane, because walls are thin."""
FOREIGN_WALL_STIFFNESS = 200.0
"""The same of a part from a file, whose cells are coarse: with stiffer walls Newton's method takes many short steps."""


@component.register_component
@dataclasses.dataclass(frozen=True)
class Walls(ContactPart):
    """Frictionless self-contact of walls. ``"auto"`` are those that the device itself names (`geometries.Actuator.meeting`), of
    a part from a file all of its outside that faces itself; names beside it are one more group."""

    faces: str = schema.field_of(
        schema.Words(),
        "faces in frictionless contact with each other and themselves: auto (chosen by the "
        "device; under vacuum 'auto, cavity'), none, or names separated by commas",
        AUTO,
    )
    stiffness: float = schema.field_of(
        schema.Quantity(),
        "penalty stiffness: contact pressure in shear moduli per overlap of one size of the device; 0: "
        f"{WALL_STIFFNESS:g}, of a part from a file {FOREIGN_WALL_STIFFNESS:g}",
        0.0,
    )

    table: ClassVar[str] = "walls"
    differentiable: ClassVar[bool] = True
    softest: ClassVar[float] = 10.0
    usual: ClassVar[float] = WALL_STIFFNESS
    optional: ClassVar[bool] = True
    figure_texts: ClassVar = {
        r"(\w+)_contact_N": (
            "contact of {0}",
            "sum of the magnitudes of the contact forces between those walls",
        ),
        r"(\w+)_overlap_mm": ("overlap of {0}", "largest overlap of those walls"),
        r"(\w+)_gap_mm": ("gap between {0}", "smallest distance between those walls, if they are near each other"),
    }

    def check(self) -> None:
        if not self.roles:
            raise ComponentError(f"{self.where} names no faces; give {AUTO!r}, {NONE!r} or face names (faces = 'cavity')")
        if len(set(self.roles)) < len(self.roles):
            raise self.error(f"faces = {self.faces!r} names a face twice")
        if NONE in self.roles and len(self.roles) > 1:
            raise self.error(f"faces = {self.faces!r}; {NONE!r} cannot be combined with other names")
        if self.stiffness:
            self.check_stiffness()

    def stiffness_on(self, actuator: Actuator) -> float:
        """Return its stiffness on a device, as given or chosen."""
        return self.stiffness or (FOREIGN_WALL_STIFFNESS if actuator.meeting is None else WALL_STIFFNESS)

    @property
    def automatic(self) -> bool:
        """Whether the device chooses walls in contact."""
        return AUTO in self.roles

    @property
    def off(self) -> bool:
        """Whether self-contact is off."""
        return self.faces.strip() == NONE

    @property
    def words(self) -> str:
        """Its faces, for a sentence."""
        return "the walls chosen by the device" if self.automatic else f"the walls of {self.where} ({self.faces})"

    def groups(self, actuator: Actuator) -> tuple[list[str], ...] | None:
        """Return the faces that may touch each other and themselves, by group; None if only the mesh shows them."""
        if self.off:
            return ()
        if not self.automatic:
            return (self.roles,)
        if actuator.meeting is None:
            return None
        chosen = [component.names_in(group) for group in actuator.meeting]
        return (*chosen, *self._beside({role for group in chosen for role in group}))

    def _beside(self, chosen: Set[str]) -> list[list[str]]:
        """Return the faces named beside automatic ones, as a group; none if there are none."""
        named = [role for role in self.roles if role != AUTO and role not in chosen]
        return [named] if named else []

    def check_on(self, actuator: Actuator) -> None:
        for group in self.groups(actuator) or ():
            component.check_on_mesh(self.where, actuator, group)

    def hindrance(self, actuator: Actuator, figure: Callable[[str], float]) -> str:
        depth, force = (figure(f"{self.label}_{what}") for what in ("overlap", "contact"))
        pressed = f"{self.words} are in contact{f' and overlap by {1e3 * depth:.3g} mm' if depth else ''}"
        own = dataclasses.replace(self, stiffness=self.stiffness_on(actuator))
        return own.try_other(pressed) if depth or force else ""

    def term(self, setting: component.FormContext) -> component.EnergyTerm:
        body = setting.body
        groups = self.groups(body.actuator)
        facets: list[str | npt.NDArray[np.int32]] = []
        if groups is None:
            outside = _outside(body)
            if body.actuator.bodies:  # between bodies acts only what is named
                every = np.unique(np.concatenate([body.entities[role][1] for role in outside]))
                groups = tuple([", ".join(names)] for names in body.actuator.bodies)
                facets = [body.facets_of(every, names) for names in body.actuator.bodies]
            else:
                groups, facets = (outside,), [*outside]
            groups = (*groups, *self._beside(set(outside)))
        else:
            assembly.check_mesh_faces(body, [role for group in groups for role in group], self.where)
        if not any(groups):
            return component.EnergyTerm([])
        facets += [role for group in groups for role in group][len(facets) :]
        nodes = assembly.FaceNodes(body, setting.w.function_space, facets)
        if self.automatic:
            nodes = _clear(nodes, body, groups, whole=body.actuator.meeting is None)
        return WallTerm(self, body, nodes, groups) if len(nodes.facets) else component.EnergyTerm([])


def _outside(body: Body) -> list[str]:
    """Return all faces of a mesh around the device, except cut or held ones."""
    device, facets = body.actuator, body.mesh.topology.dim - 1
    others = {
        *actuator.cavity_roles(device),
        *(plane.name for plane in device.cut_planes),
        *(hold.role for hold in body.holds),
    }
    return [role for role, (dimension, _) in body.entities.items() if dimension == facets and role not in others]


def _images(body: Body) -> Array:
    """Mirror images of the walls, which are there too, shape (g, d, d)."""
    d = body.actuator.dimension
    mirrors = [in_section(plane.normal, d) for plane in body.actuator.cut_planes]
    mirrors += [np.array([1.0, 0.0])] if body.axisymmetric else []  # a section meets its other half at the axis
    return actuator.reflected(mirrors, pressing.MAX_IMAGES, d)


def _surface(nodes: assembly.FaceNodes, body: Body) -> pressing.Surface:
    return pressing.Surface(nodes.places, nodes.facets, nodes.faces, nodes.inside, body.axisymmetric)


def _meets(groups: Sequence[Sequence[str]]) -> npt.NDArray[np.bool_]:
    """Return whether one face may touch another, shape (roles, roles)."""
    number = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
    return np.asarray(number[:, None] == number)


def _clear(nodes: assembly.FaceNodes, body: Body, groups: Sequence[Sequence[str]], whole: bool) -> assembly.FaceNodes:
    """Return those automatically chosen facets, by group, that face others and are apart when undeformed; ``whole`` if they
    are the whole outside of the device. The smooth distance of a wall that is curved more sharply than its cells resolve
    may be below zero at rest."""
    images = _images(body)
    if whole:
        nodes = nodes.only(pressing.facing(_surface(nodes, body), images, 1.0))
    while len(nodes.facets):
        surface = _surface(nodes, body)
        gaps = pressing.Near.of(pressing.Pairs(surface, _meets(groups), images), *surface.rest).gaps(len(surface.owner))
        apart = (gaps.reshape(len(nodes.facets), -1) > MIN_GAP).all(axis=1)
        if apart.all():
            break
        nodes = nodes.only(apart)
    return nodes


class WallTerm(assembly.AssembledTerm[pressing.Pressed]):
    """Contact of deformable walls, their faces by group; see `softmodels.components.pressing`."""

    def __init__(self, part: Walls, body: Body, nodes: assembly.FaceNodes, groups: Sequence[Sequence[str]]):
        super().__init__(nodes)
        self.part = part
        self.pairs = pressing.Pairs(_surface(nodes, body), _meets(groups), _images(body))
        surface, self.copies = self.pairs.surface, body.actuator.copies
        apart = float(pressing.Near.of(self.pairs, *surface.rest).gaps(len(surface.owner)).min(initial=math.inf))
        if apart < -1e-6:
            raise part.error(
                f"the undeformed walls {part.faces} overlap by "
                f"{-apart * body.actuator.size * 1e3:.3g} mm; leave room between them, or name others"
            )
        ahead = min(WALL_GAP, max(apart / 2, 0.0))  # no contact when undeformed
        stiffness = part.stiffness_on(body.actuator)
        self.penalty = pressing.Penalty(stiffness, ONSET_PRESSURE / stiffness, ahead=ahead)

    def pressed(self, places: Array) -> pressing.Pressed:
        return pressing.Pressed(self.pairs, self.penalty, places)

    def is_admissible(self, before: Array, after: Array) -> bool:
        return not passes(self.pairs, self.nodes.moved(before), self.nodes.moved(after))

    def figures(self, equations: component.Equations) -> dict[str, float]:
        self._take(equations.w.x.array)
        pressed, label, mm = self._pressed, self.part.label, equations.length_unit * 1e3
        force = pressed.pressed_force * equations.stress_unit * equations.length_unit**2 * self.copies
        gap = float(pressed.gaps.min(initial=math.inf))
        return {
            f"{label}_contact_N": force,
            f"{label}_overlap_mm": max(-gap, 0.0) * mm,
            f"{label}_gap_mm": max(gap, 0.0) * mm if math.isfinite(gap) else math.nan,
        }


# ----------------------------------------------------------------------------------------------------------------------
# Contact of two bodies, with friction.


@component.register_component
@dataclasses.dataclass(frozen=True)
class BodyContact(ContactPart):
    """Contact of two bodies, or of two faces that are not of one wall."""

    between: tuple[str, ...] = schema.list_field((), "the two bodies (regions) or faces that touch, such as inner, outer")
    stiffness: float = schema.field_of(
        schema.Quantity(), "contact pressure in shear moduli per overlap of one size of the device", CONTACT_STIFFNESS
    )
    friction: float = schema.field_of(schema.Quantity(), "coefficient of Coulomb friction between them", 0.0)
    slip: float = schema.length_field(
        0.0, "elastic slip over which friction sets in; 0 for a thousandth of the device's size", zero=True
    )

    table: ClassVar[str] = "contact"
    always_named: ClassVar[bool] = True
    distinct: ClassVar[str] = "between"
    figure_texts: ClassVar = {
        r"(\w+)_on_([xyz])_N": ("force of {0}", "of the second body on the first, along the named axis, friction included"),
        r"(\w+)_touching_mm2": ("area of {0}", "undeformed area of the first body that touches the second"),
    }

    def check(self) -> None:
        if not self.name:
            raise self.error("contact of two bodies needs a name ([contact.name])")
        if len(self.between) != 2 or len(set(self.between)) < 2:
            raise self.error(f"between is {list(self.between)}; it names two bodies or faces, such as ['inner', 'outer']")
        self.check_stiffness()
        check_friction(self)

    @property
    def connects(self) -> tuple[str, ...]:
        return self.between

    def check_on(self, actuator: Actuator) -> None:
        component.check_on_mesh(self.where, actuator, [name for name in self.between if name not in actuator.regions])

    @property
    def remembers(self) -> bool:
        return self.friction > 0.0

    @property
    def in_model(self) -> str:
        first, second = self.between
        rubs = f"with a coefficient of friction of {self.friction:g}" if self.friction else "without friction"
        return f"; {first} and {second} touch {rubs}"

    def hindrance(self, actuator: Actuator, figure: Callable[[str], float]) -> str:
        depth, (first, second) = 1e3 * figure(f"{self.label}_overlap"), self.between
        return self.try_other(f"{first} and {second} are in contact and overlap by {depth:.3g} mm") if depth else ""

    def term(self, setting: component.FormContext) -> component.EnergyTerm:
        body = setting.body
        named = [name for name in self.between if name not in body.regions]
        assembly.check_mesh_faces(body, named, self.where)
        sides = [body.surface_of(name) if name in body.regions else body.entities[name][1] for name in self.between]
        if mpi.any_rank(body.mesh.comm, bool(np.isin(sides[0], sides[1]).any())):
            raise self.error(f"{' and '.join(self.between)} have faces in common; name two bodies, or two other faces")
        nodes = assembly.FaceNodes(body, setting.w.function_space, sides)
        return (RubbingBodyTerm if self.friction else BodyContactTerm)(self, body, nodes)


def check_friction(part: RigidShape | BodyContact) -> None:
    """Raise `ComponentError` for a coefficient out of range, or a slip without one."""
    if not 0.0 <= part.friction <= MAX_FRICTION:
        raise part.error(
            f"a coefficient of friction of {part.friction:g} is out of range; give 0 to "
            f"{MAX_FRICTION:g} (silicone on smooth plastic: 0.3 to 1)"
        )
    if part.slip and not part.friction:
        raise part.error("a slip needs a coefficient of friction (friction = 0.5); give both or neither")


BODY_ONSET_PRESSURE = 0.1
"""Contact pressure of bodies in shear moduli at the end of the onset: less than that of shapes, as they lie on each other."""
MAX_REST_OVERLAP = 0.05
"""Overlap at rest, in facet edges, above which bodies do not lie on each other but in each other."""


class _BodyTerm[P: touching.Touching | touching.RubbedTouching](assembly.AssembledTerm[P]):
    """The energy of contact of two bodies; see `softmodels.components.touching`."""

    def __init__(self, part: BodyContact, body: Body, nodes: assembly.FaceNodes):
        super().__init__(nodes)
        self.part, self.actuator = part, body.actuator
        self.surfaces = touching.TwoSurfaces.of(_surface(nodes, body))
        near = self.surfaces.nearest(nodes.places, self.surfaces.places(nodes.places))
        over = -near.gap / self.surfaces.edges[near.facet]
        if over.max(initial=0.0) > MAX_REST_OVERLAP:
            at = int(over.argmax())
            x, y, z = body.actuator.device_points(in_space(self.surfaces.places(nodes.places)[at]) * body.actuator.size)
            raise part.error(
                f"{' and '.join(part.between)} overlap at rest by {-near.gap[at] * body.actuator.size * 1e3:.3g} mm near "
                f"({1e3 * x:.4g}, {1e3 * y:.4g}, {1e3 * z:.4g}) mm; draw them apart, or glue them"
            )
        self.rest = np.minimum(near.gap, 0.0)
        self.penalty = pressing.Penalty(part.stiffness, BODY_ONSET_PRESSURE / part.stiffness)

    def plain(self, places: Array) -> touching.Touching:
        return touching.Touching(self.surfaces, self.penalty, self.rest, places)

    @abc.abstractmethod
    def plain_here(self) -> touching.Touching:
        """Return the bodies in the current shape, without friction."""

    def stiffness_here(self) -> scipy.sparse.csr_array:
        stiffness, plain = super().stiffness_here(), self.plain_here()
        if not -RESTING_DEPTH < plain.gaps.min(initial=math.inf) < RESTING_DEPTH:
            return stiffness
        return scipy.sparse.csr_array(stiffness + plain.resting(RESTING_DEPTH, RESTING_STIFFNESS * self.part.stiffness))

    def whole_stiffness_here(self) -> scipy.sparse.csr_array | None:
        return super().stiffness_here()

    def is_admissible(self, before: Array, after: Array) -> bool:
        return self.surfaces.clear(self.nodes.moved(before), self.nodes.moved(after), self.rest)

    def body_figures(self, equations: component.Equations, plain: touching.Touching, force: Array) -> dict[str, float]:
        """Return the columns of ``path.csv`` without those of friction."""
        label, size, actuator = self.part.label, equations.length_unit, self.actuator
        unit, gap = equations.stress_unit * size**2, float(plain.gaps.min(initial=math.inf))
        normals = [np.asarray(plane.normal, dtype=float) for plane in actuator.cut_planes]
        total = force_of_all(actuator, normals, in_space(force) * unit)
        figures = {f"{label}_on_{axis}_N": float(value) for axis, value in zip("xyz", total, strict=True)}
        if actuator.dimension == 2:
            figures = {name: value for name, value in figures.items() if "_z_" in name}
        first = self.surfaces.side[plain.on] == 0
        return figures | {
            f"{label}_contact_N": float(plain.phi1.sum()) * unit * actuator.copies,
            f"{label}_overlap_mm": max(-gap, 0.0) * size * 1e3,
            f"{label}_gap_mm": max(gap, 0.0) * size * 1e3 if math.isfinite(gap) else math.nan,
            f"{label}_touching_mm2": 2 * float(plain.area[first].sum()) * size**2 * actuator.copies * 1e6,
        }


class BodyContactTerm(_BodyTerm[touching.Touching]):
    """The energy without friction."""

    def pressed(self, places: Array) -> touching.Touching:
        return self.plain(places)

    def plain_here(self) -> touching.Touching:
        return self._pressed

    def figures(self, equations: component.Equations) -> dict[str, float]:
        self._take(equations.w.x.array)
        return self.body_figures(equations, self._pressed, self._pressed.force)


class RubbingBodyTerm(_BodyTerm[touching.RubbedTouching], assembly.RememberingTerm[touching.RubbedTouching, touching.Anchors]):
    """The energy and its friction."""

    def __init__(self, part: BodyContact, body: Body, nodes: assembly.FaceNodes):
        super().__init__(part, body, nodes)
        self.rubbing = pressing.Rubbing(part.friction, part.slip / body.actuator.size or ONSET_DEPTH)
        self.history = touching.Anchors.of_free(self.plain(nodes.places))
        self._balanced = np.empty(0), np.empty(0)  # values of the nodes, and the force that was in balance there

    def pressed(self, places: Array) -> touching.RubbedTouching:
        return touching.RubbedTouching(self.plain(places), self.rubbing, self.history)

    def plain_here(self) -> touching.Touching:
        return self._pressed.plain

    def whole_stiffness_here(self) -> scipy.sparse.csr_array:
        return self._pressed.whole_stiffness

    def kept(self, reset: bool) -> touching.Anchors:
        self._balanced = self._state, self._pressed.force  # with the new anchors, in turned tangent planes, it differs a little
        return touching.Anchors.of_free(self._pressed.plain) if reset else self._pressed.kept()

    def figures(self, equations: component.Equations) -> dict[str, float]:
        self._take(equations.w.x.array)
        pressed, size, label = self._pressed, equations.length_unit, self.part.label
        values, balanced = self._balanced
        force = balanced if np.array_equal(self._state, values) else pressed.force
        lost = self.history.lost * equations.stress_unit * size**3 * self.actuator.copies
        return self.body_figures(equations, pressed.plain, force) | {
            f"{label}_sliding": pressed.sliding,
            f"{label}_slip_mm": float(self.history.slid.max(initial=0.0)) * size * 1e3,
            f"{label}_friction_mJ": lost * 1e3,
        }


# ----------------------------------------------------------------------------------------------------------------------
# Check whether a point passes through a wall between two shapes.


MAX_OVERLAP = 0.3
"""Penetration in kernel radii at which a state is rejected: a wall is detected only up to one radius behind it."""
OWN_DISTANCE = 0.4
"""Lateral distance from a sample, in facet edges, within which a wall belongs to it; the spacing of samples."""
WALL_STRIDE = 2.0
"""Relative motion of points and walls, in kernel radii, between two checks."""
MAX_LOOKS = 60


def passes(pairs: pressing.Pairs, before: Array, after: Array) -> bool:
    """Return whether a point gets deeper than `MAX_OVERLAP` behind a wall on straight ways between two shapes, places of nodes
    of shape (n, d). A point that has jumped over a wall is nowhere near it any more and would feel nothing."""
    surface = pairs.surface
    start, end = surface.places(before), surface.places(after)
    motion = end - start
    relative = 2 * float(np.linalg.norm(motion - motion.mean(axis=0), axis=1).max())
    # A mirror image does not move along with the walls.
    largest = relative if len(pairs.images) == 1 else 2 * float(np.linalg.norm(motion, axis=1).max())
    stride = WALL_STRIDE * float(pairs.radius.min())
    looks = min(max(math.ceil(relative / stride), 1), MAX_LOOKS)
    times = np.linspace(0.0, 1.0, looks + 1)
    for low, high in itertools.pairwise(times):
        shapes = [before + t * (after - before) for t in (low, high)]
        if _deeper(pairs, shapes, largest / looks / 2):
            return True
    return False


def _deeper(pairs: pressing.Pairs, shapes: list[Array], slack: float) -> bool:
    """Return whether a point crosses the surface at `MAX_OVERLAP` behind a sample's own part of a wall between near shapes."""
    surface, count, share = pairs.surface, len(pairs.surface.owner), MAX_OVERLAP + OWN_DISTANCE
    places, areas = [surface.places(x) for x in shapes], [surface.areas(x) for x in shapes]
    middle = (places[0] + places[1]) / 2

    def at_ends(i: pressing.Numbers, j: pressing.Numbers) -> tuple[list[Array], list[Array]]:
        """Return the ways to points from samples in both shapes, shape (p, d), and the heights above the walls, shape (p,)."""
        ways = [np.take(x, i, axis=0) - np.take(pairs.of_all(x), j, axis=0) for x in places]
        normals = [np.take(pairs.of_all(x / np.linalg.norm(x, axis=1)[:, None]), j, axis=0) for x in areas]
        return ways, [np.einsum("pi,pi->p", way, normal) for way, normal in zip(ways, normals, strict=True)]

    i, j, _ = pairs.within(middle, share, slack)
    (start, end), above = at_ends(i, j)
    limit = -MAX_OVERLAP * pairs.radius[j % count]
    for k in np.flatnonzero((above[0] > limit) & (above[1] <= limit)):
        t = (above[0][k] - limit[k]) / (above[0][k] - above[1][k])
        place = start[k] + t * (end[k] - start[k])
        if place @ place - limit[k] ** 2 > (OWN_DISTANCE * surface.edges[j[k] % count]) ** 2:
            continue
        # Beside a sharp edge of the wall a point is behind one of its faces and in front of the other, nearer one.
        others, walls, _ = pairs.within(middle, 0.0, slack + share * float(pairs.radius.max()))
        same = slice(*np.searchsorted(others, [i[k], i[k] + 1]))
        ways, heights = ((1 - t) * np.array(x[0]) + t * np.array(x[1]) for x in at_ends(others[same], walls[same]))
        height = heights[int(pressing.squares(ways).argmin())]
        if height < limit[k] / 2:
            return True
    return False


# ----------------------------------------------------------------------------------------------------------------------
# Forces on a shape, and the distance from it: the places nearer than a radius to a point, a line, a piece of one.


def copies_around(actuator: Actuator, crossed: Sequence[Array]) -> int:
    """Return the number of slices that share a shape that crosses cut planes of these normals; where it crosses none, each
    copy has a shape of its own."""
    if actuator.dimension == 2 or not crossed:
        return 1
    return actuator.copies if len(crossed) == len(actuator.cut_planes) else 2


def force_of_all(actuator: Actuator, crossed: Sequence[Array], force: Array) -> Array:
    """Return the total force on a shape of all slices that share it, from that of the slice, shape (3,), by the normals of the
    cut planes that it crosses; components normal to one of them cancel."""
    if actuator.dimension == 2:
        return force * [0.0, 0.0, 1.0]
    if not crossed:
        return force
    along = np.linalg.svd(np.array(crossed))[2][np.linalg.matrix_rank(np.array(crossed)) :]
    return np.asarray(copies_around(actuator, crossed) * along.T @ (along @ force))


def shape_figures(label: str, actuator: Actuator, crossed: Sequence[Array], force: Array, depth: float) -> dict[str, float]:
    """Return the columns of ``path.csv`` of a rigid shape, by the force of the slice on it in N, in the mesh's coordinates,
    shape (d,), and how deep faces have sunk into it in m, below zero where none has; see `force_of_all`."""
    total = force_of_all(actuator, crossed, in_space(force))
    figures = {f"{label}_force_{axis}_N": float(value) for axis, value in zip("xyz", total, strict=True)}
    if actuator.dimension == 2:
        figures = {name: value for name, value in figures.items() if "_z_" in name}
    return figures | {f"{label}_depth_mm": max(depth, 0.0) * 1e3}


# ----------------------------------------------------------------------------------------------------------------------
# Terms of a fixed shape: as a form, and as sums over samples where a shape moves, rubs, or comes from a file.


PATH_POINTS = 8
"""Number of points on a node's straight path between states at which its penetration is checked."""
HARDENING_START = 0.25
"""Fraction of the rejected penetration above which the shape stiffens. The energy is of the undeformed area, which
a wrapped membrane stretches to ten or twenty times itself, so that it would penetrate ten or twenty times as deep."""
HARDENING_RATE = 16.0
"""Rate of stiffening: at the rejected penetration the contact is some 19 times as
hard."""
NEAR_GAP = 0.1
"""Distance in sizes of the device that counts as near."""


def penalty(d: Expr, onset: fem.Constant) -> Expr:
    """Return phi(d) / k in UFL, of a d that is not below zero."""
    return ufl.conditional(ufl.lt(d, onset), d**3 / (6 * onset), d**2 / 2 - onset * d / 2 + onset**2 / 6)


def clear(numbers: shapes.Numbers, deepest: float, start: Array, end: Array) -> bool:
    """Return whether nodes can move between positions, shape (n, d) each, and sink no deeper than ``deepest`` into a shape."""
    way = (start + t * (end - start) for t in np.linspace(0.0, 1.0, PATH_POINTS + 1)[1:])
    return all(float(shapes.distances(places, numbers).min(initial=math.inf)) > -deepest for places in way)


def check_rest(shape: RigidShape, body: Body) -> None:
    """Raise `ComponentError` for a shape that penetrates the undeformed device."""
    size = body.actuator.size
    points = body.mesh.geometry.x[:, : body.mesh.topology.dim]
    deepest = mpi.largest(body.mesh.comm, -float(shapes.distances(points, shape.form.numbers(size)).min(initial=math.inf)))
    if deepest > PLANE_TOLERANCE:
        side = "outside of the hollow" if shape.hollow else "in the"
        raise shape.error(
            f"the undeformed device is {deepest * size * 1e3:.4g} mm deep {side} {shape.shape}; move it away"
            + ("" if shape.shape == "plane" else ", or give it another radius")
        )


class ShapeTerm(component.EnergyTerm):
    """A fixed shape, with the force on it; `ComponentError` if the device lies in it."""

    def __init__(self, shape: RigidShape, setting: component.FormContext):
        super().__init__([])
        self.shape, self.body = shape, setting.body
        body, mesh, size = self.body, self.body.mesh, self.body.actuator.size
        self._check_rest(body)
        self.numbers = shape.form.numbers(size)
        self._place = fem.Constant(mesh, self.numbers[0])
        others = (None if value is None else fem.Constant(mesh, value) for value in self.numbers[1:])
        constants = (self._place, *others)
        onset, soft = shape.onset, HARDENING_START * shape.deepest(size)
        stiffness, onset, soft = (fem.Constant(mesh, float(value)) for value in (shape.stiffness, onset, soft))
        place = ufl.variable(ufl.SpatialCoordinate(mesh) + body.displacement(setting.displacement))
        components = [place[0], place[1], place[2]] if mesh.topology.dim == 3 else [place[0], 0.0, place[1]]
        depth = ufl.max_value(-shapes.distance(components, constants), 0.0)
        energy = stiffness * (penalty(depth, onset) + HARDENING_RATE / (6 * soft) * ufl.max_value(depth - soft, 0.0) ** 3)
        push = ufl.diff(energy, place)  # on the shape; the device gets the opposite force
        self.energies, self.pushes = [], []
        for role in shape.roles:
            area = body.sheet_face(role)[0]
            self.energies.append(energy * body.hoop * area)
            self.pushes.append([push[c] * body.hoop * area for c in range(mesh.topology.dim)])
        self.nodes = assembly.FaceNodes(body, setting.w.function_space, shape.roles)

    def _check_rest(self, body: Body) -> None:
        check_rest(self.shape, body)

    def constants_of(self, part: Component) -> list[tuple[fem.Constant, Array]]:
        at = getattr(part, "at", None)  # not of a plane given by its place
        return [] if at is None else [(self._place, np.asarray(at) / self.body.actuator.size)]

    def take(self, part: Component) -> None:
        super().take(part)
        self.numbers = (self._place.value.copy(), *self.numbers[1:])

    def follow_mesh(self) -> None:
        self.nodes.follow_mesh()

    def compile(self, equations: component.Equations) -> None:
        self._compiled: list[list[fem.Form]] = [[equations.form(force) for force in forces] for forces in self.pushes]

    def figures(self, equations: component.Equations) -> dict[str, float]:
        actuator, depth = self.body.actuator, self.depth(equations) * equations.length_unit
        return shape_figures(self.shape.label, actuator, self.shape.crossed(actuator), self.force(equations), depth)

    def force(self, equations: component.Equations) -> Array:
        """Return the force of the slice on the shape in N, in the mesh's coordinates, shape (d,)."""
        by_role = [[equations.integral(form) for form in forces] for forces in self._compiled]
        return np.asarray(equations.stress_unit * equations.length_unit**2 * np.sum(by_role, axis=0))

    def depth(self, equations: component.Equations) -> float:
        """Return the penetration of the faces, in sizes of the device; negative where none touches."""
        return -float(shapes.distances(self.nodes.moved(equations.w.x.array), self.numbers).min())

    def is_admissible(self, before: Array, after: Array) -> bool:
        size = self.body.actuator.size
        return clear(self.numbers, self.shape.deepest(size), self.nodes.moved(before), self.nodes.moved(after))


class _StandingPlane(RigidShape):
    """An obstacle beside a device, turned to the side of its faces; its contact grows no harder with depth."""

    @property
    def onset(self) -> float:
        return ONSET_DEPTH

    def deepest(self, size: float) -> float:
        return shapes.CYLINDER_LENGTH


class PlaneTerm(ShapeTerm):
    """An obstacle's contact; only the faces it stops keep to their side of it. `ComponentError` for a face that the mesh
    lacks, or faces on both sides of the plane."""

    def __init__(self, obstacle: Obstacle, setting: component.FormContext):
        body = setting.body
        assembly.check_mesh_faces(body, obstacle.roles, "contact")
        point, normal = (np.asarray(vector, dtype=float) for vector in obstacle.place(body.actuator))
        nodes = assembly.FaceNodes(body, setting.w.function_space, obstacle.roles)
        along = _side(obstacle, body, nodes.places, point, normal) * normal
        plane = _StandingPlane(
            "plane", obstacle.faces, tuple(point), along=tuple(along), stiffness=obstacle.stiffness, name=obstacle.table
        )
        super().__init__(plane, setting)

    def _check_rest(self, body: Body) -> None:
        """Other parts of the device may lie beyond the plane."""

    def figures(self, equations: component.Equations) -> dict[str, float]:
        d, size = self.body.actuator.dimension, self.body.actuator.size
        along = in_section(self.numbers[1], d)
        force = -float(self.force(equations) @ along) * self.body.actuator.copies
        return {"contact_force_N": force, "contact_depth_mm": max(self.depth(equations), 0.0) * size * 1e3}


def _side(obstacle: Obstacle, body: Body, places: Array, point: Array, normal: Array) -> float:
    """Return the side of a plane in m on which undeformed faces lie, 1 or -1; that of the body, if they lie in the plane.
    ``places`` are those of the faces' nodes, shape (n, d), the same on all ranks."""
    size, d = body.actuator.size, body.actuator.dimension

    def span(x: Array) -> list[float]:
        gaps = in_space(x) @ normal - point @ normal / size
        return [mpi.largest(body.mesh.comm, float(values.max(initial=-math.inf))) for values in (gaps, -gaps)]

    above, below = span(places)
    if min(above, below) > PLANE_TOLERANCE:
        size *= 1e3
        raise ComponentError(
            f"contact: at rest the faces {', '.join(obstacle.roles)} lie on both sides of the plane, {below * size:.4g} mm on "
            f"the one and {above * size:.4g} mm on the other; move the plane, or name only the faces that it stops"
        )
    if max(above, below) <= PLANE_TOLERANCE:
        above, below = span(body.mesh.geometry.x[:, :d])
    return 1.0 if above > below else -1.0


class StandingTerm[P: pressing.PressedSamples](assembly.AssembledTerm[P]):
    """A shape in its first place, by sums over samples of the faces: ``surface``; ``crossed`` are normals of the cut planes
    that it crosses. `ComponentError` if the device lies in it."""

    penalty: pressing.Penalty

    def __init__(self, shape: RigidShape, setting: component.FormContext):
        body = setting.body
        super().__init__(assembly.FaceNodes(body, setting.w.function_space, shape.roles))
        self.shape, self.actuator, self.crossed = shape, body.actuator, shape.crossed(body.actuator)
        self.surface = _surface(self.nodes, body)

    @abc.abstractmethod
    def clear(self, start: Array, end: Array) -> bool:
        """Return whether nodes can move between positions, shape (n, d) each, without passing through the shape."""

    @abc.abstractmethod
    def put(self, at: Array) -> None:
        """Put the shape to a place in sizes, shape (3,)."""

    def take(self, part: Component) -> None:
        assert isinstance(part, RigidShape)
        self.put(np.asarray(part.at) / self.actuator.size)
        self.forget_state()

    def is_admissible(self, before: Array, after: Array) -> bool:
        return self.clear(self.nodes.moved(before), self.nodes.moved(after))

    def figures(self, equations: component.Equations) -> dict[str, float]:
        self._take(equations.w.x.array)
        return self.figures_of(equations, self._pressed)

    def figures_of(self, equations: component.Equations, pressed: pressing.PressedSamples) -> dict[str, float]:
        """Return force and depth of pressed nodes, in the columns' units."""
        size = equations.length_unit
        force = equations.stress_unit * size**2 * pressed.forces.sum(axis=0)
        return shape_figures(self.shape.label, self.actuator, self.crossed, force, pressed.depth * size)


class SampledShapeTerm(StandingTerm[pressing.PressedByDistance]):
    """The energy of `ShapeTerm`."""

    def __init__(self, shape: RigidShape, setting: component.FormContext):
        check_rest(shape, setting.body)
        super().__init__(shape, setting)
        size = self.actuator.size
        self.numbers, self.deepest = shape.form.numbers(size), shape.deepest(size)
        self.penalty = pressing.HardeningPenalty(shape.stiffness, shape.onset, HARDENING_START * self.deepest, HARDENING_RATE)
        self.move(self.nodes.places)

    def put(self, at: Array) -> None:
        self.numbers = (at, *self.numbers[1:])

    def pressed(self, places: Array) -> pressing.PressedByDistance:
        return pressing.PressedByDistance(
            self.surface, lambda x: shapes.slopes(x, self.numbers), self.penalty, NEAR_GAP, places
        )

    def clear(self, start: Array, end: Array) -> bool:
        return clear(self.numbers, self.deepest, start, end)


KERNEL_RADIUS = 0.4
"""Default radius of the kernel in edges of the contact facets."""
MAX_SURFACE_DEPTH = 0.3
"""Penetration in kernel radii at which a state is rejected: the wall is detected only up to one radius behind it."""
CHECK_STRIDE = 0.5
"""Motion of a node in kernel radii between two checks of its penetration."""
MAX_PROBED = 50
"""Number of nodes checked by the winding number; touching surfaces are found by the gap."""


class FileShapeTerm(StandingTerm[pressing.PressedOn]):
    """The energy of contact with an STL file's shape."""

    def __init__(self, shape: RigidShape, setting: component.FormContext):
        super().__init__(shape, setting)
        size, form = self.actuator.size, shape.form
        assert isinstance(form, shapes.Stl)
        points, triangles = form.surface
        self._at = np.asarray(shape.at) / size
        edges, measure = self.surface.edges, self.surface.measure
        radius = shape.rounding / size or KERNEL_RADIUS * float(edges @ measure / measure.sum())
        try:
            self.wall = pressing.FixedWall.of(points / size, triangles[:, ::-1] if shape.hollow else triangles, radius)
        except pressing.TooFineError:
            raise shape.error(
                f"{shape.file} is large against a rounding of {radius * size * 1e3:.3g} mm; use a "
                "larger rounding, or cut off the parts far from the device"
            ) from None
        self.penalty = pressing.Penalty(shape.stiffness, ONSET_PRESSURE / shape.stiffness)
        self.move(self.nodes.places)
        self._check_rest(points / size, triangles)

    def _check_rest(self, points: Array, triangles: shapes.Indices) -> None:
        chosen = self.nodes.places[:: max(1, len(self.nodes.places) // MAX_PROBED)]
        inside = np.abs(shapes.winding(chosen, points[triangles])) > 0.5
        if self._pressed.depth > PLANE_TOLERANCE or bool((inside != self.shape.hollow).any()):
            side = "outside of the hollow" if self.shape.hollow else "in the"
            raise self.shape.error(
                f"the undeformed device is {side} shape of {self.shape.file}, or touches it; move the shape away (at)"
            )

    def put(self, at: Array) -> None:
        self.wall, self._at = dataclasses.replace(self.wall, places=self.wall.places + at - self._at), at

    def pressed(self, places: Array) -> pressing.PressedOn:
        return pressing.PressedOn(self.surface, self.wall, self.penalty, places)

    def clear(self, start: Array, end: Array) -> bool:
        farthest = float(np.linalg.norm(end - start, axis=1).max(initial=0.0))
        limit = MAX_SURFACE_DEPTH * self.wall.radius
        looks = int(np.clip(np.ceil(farthest / (CHECK_STRIDE * self.wall.radius)), 1, MAX_LOOKS))
        way = (self.surface.places(start + t * (end - start)) for t in np.linspace(0.0, 1.0, looks + 1)[1:])
        return all(float(self.wall.gaps(places).min(initial=np.inf)) > -limit for places in way)


# ----------------------------------------------------------------------------------------------------------------------
# Shapes that give way along a guide, on a spring or with a mass that is lifted, and shapes with friction.
#
# The position on the line minimises the energy, see `softmodels.components.pressing`, also for the law of friction. The shape
# does not rotate.


class GuidedShapeTerm(assembly.AssembledTerm[pressing.GivingWay]):
    """The energy of contact with such a shape and of its spring or weight; ``standing`` is its term in its first place."""

    def __init__(self, shape: RigidShape, standing: StandingTerm, setting: component.FormContext):
        super().__init__(standing.nodes)
        self.shape, self.standing, self.setting, self.actuator = shape, standing, setting, setting.body.actuator
        self.along = in_section(shape.gives_way, self.actuator.dimension)
        self._per_pascal, self._s = 0.0, 0.0

    def _stand(self) -> pressing.Support:
        """Return its spring or weight for the modelled slice, with forces in shear moduli times squared sizes."""
        size, share = self.actuator.size, copies_around(self.actuator, self.standing.crossed)
        unit = float(self.setting.per_pascal.value) / size / share
        return pressing.Support(
            self.shape.spring * unit, self.shape.weight_against(self.setting.gravity) * unit / size, ONSET_DEPTH
        )

    def pressed(self, places: Array) -> pressing.GivingWay:
        pressed = pressing.GivingWay(self.standing.pressed, self._stand(), self.along, places, self._s)
        self._s = pressed.s
        return pressed

    def take(self, part: Component) -> None:
        self.standing.take(part)
        self.forget_state()

    def _take(self, w: Array) -> None:
        if self._per_pascal != float(self.setting.per_pascal.value):  # spring and weight are constant in newtons
            self._per_pascal = float(self.setting.per_pascal.value)
            self.forget_state()
        super()._take(w)

    def harder_here(self) -> Array:
        return self._pressed.harder()

    def is_admissible(self, before: Array, after: Array) -> bool:
        start, end = self.nodes.moved(before), self.nodes.moved(after)
        moved = [places - self.pressed(places).s * self.along for places in (start, end)]
        return self.standing.clear(*moved)

    def figures(self, equations: component.Equations) -> dict[str, float]:
        self._take(equations.w.x.array)
        travel = self._pressed.s * equations.length_unit * 1e3
        return self.standing.figures_of(equations, self._pressed.here) | {f"{self.shape.label}_travel_mm": travel}


class RubbingShapeTerm(assembly.HistoryTerm[pressing.Rubbed, pressing.FrictionHistory]):
    """The energy of contact with such a shape, and its friction; ``standing`` is its term without."""

    def __init__(self, shape: RigidShape, standing: StandingTerm, setting: component.FormContext):
        super().__init__(standing.nodes)
        self.shape, self.standing, self.actuator = shape, standing, setting.body.actuator
        self.rubbing = pressing.Rubbing(shape.friction, shape.slip / self.actuator.size or ONSET_DEPTH)
        self.history = pressing.FrictionHistory.of_free(standing.pressed(standing.nodes.places))

    def take(self, part: Component) -> None:
        """Where the shape moves, what sticks to it moves with it."""
        assert isinstance(part, RigidShape)
        moved = in_section(np.asarray(part.at) - np.asarray(self.shape.at), self.actuator.dimension) / self.actuator.size
        self.shape, self.history = part, dataclasses.replace(self.history, held=self.history.held + moved)
        self.standing.take(part)
        self.forget_state()

    def pressed(self, places: Array) -> pressing.Rubbed:
        return pressing.Rubbed(self.standing.pressed(places), self.rubbing, self.history)

    def whole_stiffness_here(self) -> scipy.sparse.csr_array:
        return self._pressed.whole_stiffness

    def kept(self, reset: bool) -> pressing.FrictionHistory:
        return pressing.FrictionHistory.of_free(self._pressed.pressed) if reset else self._pressed.kept()

    def rest_rates(self, places: Array) -> Array:
        samples = self.standing.surface.places(places)
        gaps = self.standing.pressed(self.nodes.places).gap_rates(samples)
        return np.column_stack([samples, gaps])

    def kept_rates(self, w: Array, places: Array, history: Array) -> Array:
        self._take(w)
        samples = self.standing.surface.places(places)
        return np.column_stack(self._pressed.kept_rates(samples, history[:, :-1], history[:, -1]))

    def history_rates(self, w: Array, history: Array) -> Array:
        self._take(w)
        on, surface, rates = self._pressed.touching, self.standing.surface, np.zeros_like(self.nodes.places)
        still = np.zeros((int(on.sum()), rates.shape[1]))
        pulls = self._pressed.pull_rates(still, history[on, :-1], history[on, -1])
        np.add.at(rates, surface.facets[surface.owner[on]], np.einsum("sa,si->sai", surface.shapes[on], pulls))
        return rates

    def is_admissible(self, before: Array, after: Array) -> bool:
        return self.standing.is_admissible(before, after)

    def figures(self, equations: component.Equations) -> dict[str, float]:
        self._take(equations.w.x.array)
        pressed, size, label = self._pressed, equations.length_unit, self.shape.label
        lost = pressed.grip.lost * equations.stress_unit * size**3 * self.actuator.copies
        return self.standing.figures_of(equations, pressed) | {
            f"{label}_sliding": pressed.sliding,
            f"{label}_slip_mm": float(pressed.grip.slid.max(initial=0.0)) * size * 1e3,
            f"{label}_friction_mJ": lost * 1e3,
        }


# ----------------------------------------------------------------------------------------------------------------------
# Faces that seal a cavity where they press on a plane, as the lip of a suction cup does.
#
# The cavity's pressure acts inside the seal, none outside. In between it falls from edge to edge of the faces in proportion to
# the contact pressure that it passes, as gas that seeps through the ring would have it: the share s of it solves
#
#     div (grad s / (q + SEEPS max q)) = 0,     s = 1 at the cavity's edge, s = 0 at all others
#
# with the contact pressure q. Where nothing presses s does not change, so the gas of either side goes up to the contact. In it
# the walls' gap is closed, and where exactly s falls is of no consequence but for the penetration of the penalty. (Persson's
# theory has a conductance that falls as fast as exponentially, doi 10.1039/C9SM01679A.)


MIN_SEAL_PRESSURE = 1e-6
"""Contact pressure in that of the facet that is pressed most, below which gas passes freely."""
OPENING_DEPTH = 1e-6
"""Depth in sizes of the last contact at which a seal opens."""
SHARE_TOLERANCE = 1e-9
"""Change of the share of the pressure below which it is that of the state."""
RESTING_DEPTH, RESTING_STIFFNESS = 1e-5, 0.1
"""Depth in sizes up to which faces hardly press, and their stiffness in a factorisation then, in that of the contact: nothing
else holds the device."""


class SealingTerm(RubbingShapeTerm):
    """The energy of contact with such a plane, and the share of the cavity's pressure on the faces. `ComponentError` for faces
    beside the plane, or without an edge of the cavity."""

    standing: SampledShapeTerm

    def __init__(self, shape: RigidShape, standing: SampledShapeTerm, setting: component.FormContext):
        super().__init__(shape, standing, setting)
        body, nodes = setting.body, standing.nodes
        assert body.seal is not None
        self.body, self.share, self._displacement = body, body.seal.share, setting.displacement
        self._edges = _seal_edges(shape, body, setting.w.function_space, nodes)
        off = float(np.abs(shapes.distances(nodes.places, standing.numbers)).max())
        if off > PLANE_TOLERANCE:
            size = self.actuator.size * 1e3
            raise shape.error(
                f"{shape.faces} must lie in the plane at rest to seal on it, and is up to {off * size:.4g} mm "
                "off; move the plane (at)"
            )
        self._ring = _Ring.of(standing.surface)
        self._dofs, self._of_dofs = _share_dofs(body, self.share, nodes.places)
        self._settled = np.full(len(nodes.places), np.nan)
        self.update_lagged_at(nodes.places)

    def stiffness_here(self) -> scipy.sparse.csr_array:
        stiffness = super().stiffness_here()
        return stiffness if self._pressed.depth > RESTING_DEPTH else stiffness + self._resting

    @functools.cached_property
    def _resting(self) -> scipy.sparse.csr_array:
        surface, d = self.standing.surface, self.nodes.places.shape[1]
        held = RESTING_STIFFNESS * self.shape.stiffness * surface.measure
        dofs = pressing.components_of(surface.facets[surface.owner], d)
        blocks = np.einsum("sa,sb,s,ij->saibj", surface.shapes, surface.shapes, held, np.eye(d))
        size = d * len(self.nodes.places)
        return pressing.scattered(blocks.reshape(len(held), dofs.shape[1], -1), dofs, dofs, size, size)

    def coupled(self) -> scipy.sparse.csr_array:
        facets = self.standing.surface.facets
        return pressing.together(np.arange(len(facets)), facets, (len(facets), len(self.nodes.places)))

    # -- the share of the pressure -------------------------------------------------------------------------------------

    def update_lagged(self, w: Array) -> bool:
        return self.update_lagged_at(self.nodes.moved(w))

    def update_lagged_at(self, places: Array) -> bool:
        """Set the share of the pressure with the nodes at places, shape (n, d); return whether it has changed."""
        n, (inside, outside), depth = len(places), self._edges, self._depths(places)
        if depth.max() <= 0.0 and self._settled[0] >= 0.0:
            return False  # just lifted off: the share stays what it was
        pressure = self.standing.penalty.rates(depth)[1][self._ring.pieces].mean(axis=1)
        blocks = self._ring.conductances / (pressure + MIN_SEAL_PRESSURE * (pressure.max() or 1.0))[:, None, None]
        K = pressing.scattered(blocks, self._ring.pieces, self._ring.pieces, n, n).tocsr()
        share = np.zeros(n)
        share[inside] = 1.0
        free = np.setdiff1d(np.arange(n), np.concatenate([inside, outside]))
        if len(free):
            share[free] = scipy.sparse.linalg.spsolve(K[free][:, free].tocsc(), -(K @ share)[free])
        changed = not np.abs(share - self._settled).max() <= SHARE_TOLERANCE
        if changed:
            self._settled = share
            self.share.x.array[self._dofs] = share[self._of_dofs]
        return changed

    def _depths(self, places: Array) -> Array:
        """Return the depths of nodes at places, shape (n, d): below zero of those that do not touch."""
        return -shapes.distances(places, self.standing.numbers)

    # -- what a user reads -----------------------------------------------------------------------------------------------

    def compile(self, equations: component.Equations) -> None:
        seal, body = self.body.seal, self.body
        assert seal is not None
        flow = body.flow(self._displacement, ufl.as_vector(list(map(float, seal.normal))))
        self._sealed = equations.form(body.on_walls(-flow * body.hoop, 0))

    def figures(self, equations: component.Equations) -> dict[str, float]:
        label, size, copies = self.shape.label, equations.length_unit, self.actuator.copies
        figures = super().figures(equations)
        if not self.shape.friction:
            figures = {name: value for name, value in figures.items() if name.startswith((f"{label}_force", f"{label}_depth"))}
        area = equations.integral(self._sealed) * size**2 * copies
        pressed = self.standing.surface.measure[self._pressed.touching].sum() * size**2 * copies
        figures |= {f"{label}_contact_mm2": float(pressed) * 1e6, f"{label}_sealed_mm2": area * 1e6}
        figures[f"{label}_hold_N"] = -float(equations.pressures[0]) * equations.stress_unit * area
        if self.shape.friction:
            normal = float(np.linalg.norm(self.standing.pressed(self._pressed.nodes).slopes(), axis=1).sum())
            figures[f"{label}_shear_N"] = self.shape.friction * normal * equations.stress_unit * size**2 * copies
        return figures

    def margin(self, equations: component.Equations) -> float:
        """Return the depth that gas has to pass on its easiest way through the contact, in sizes, less `OPENING_DEPTH`."""
        self._take(equations.w.x.array)
        n, (inside, outside) = len(self.nodes.places), self._edges
        pieces, d = self._ring.pieces, self.standing.surface.dimension
        depth = self._depths(self._pressed.nodes)[pieces].max(axis=1)
        pairs = np.concatenate([pieces[:, [i, j]] for i in range(d) for j in range(i)])
        pairs, order = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
        lowest = np.full(len(pairs), np.inf)
        np.minimum.at(lowest, order.ravel(), np.tile(depth, d * (d - 1) // 2))
        # Weights above zero, in the same order; two more nodes for either side. A minimum spanning tree has the way of least
        # depth between any two nodes.
        rank = np.argsort(np.argsort(lowest)) + 1.0
        starts = np.concatenate([pairs[:, 0], np.full(len(inside), n), np.full(len(outside), n + 1)])
        ends = np.concatenate([pairs[:, 1], inside, outside])
        weights = np.concatenate([rank, np.full(len(inside) + len(outside), 0.5)])
        graph = scipy.sparse.coo_array((weights, (starts, ends)), shape=(n + 2, n + 2)).tocsr()
        tree = scipy.sparse.csgraph.minimum_spanning_tree(graph)
        _, before = scipy.sparse.csgraph.breadth_first_order(tree, n, directed=False)
        tree, here, most = tree + tree.T, n + 1, 0.0
        while here != n:
            most, here = max(most, float(tree[here, before[here]])), int(before[here])
        return min(float(np.sort(lowest)[round(most) - 1]), self._pressed.depth) - OPENING_DEPTH

    def opened(self, equations: component.Equations) -> component.PathFailure:
        figures, label = self.figures(equations), self.shape.label
        last = self._pressed.nodes[[int(self._depths(self._pressed.nodes).argmax())]] * self.actuator.size
        x, y, _ = self.actuator.device_points(in_space(last))[0] * 1e3
        pressure = equations.pressures[0] * equations.stress_unit / 1e3
        return component.PathFailure(
            f"the seal of {self.shape.where} opens at {pressure:.4g} kPa over {figures[f'{label}_sealed_mm2']:.4g} mm2, a "
            f"holding force of {figures[f'{label}_hold_N']:.4g} N: leak ({self.shape.faces} touches last at a radius of "
            f"{math.hypot(x, y):.4g} mm)",
            "For more force use a deeper vacuum or a wider cup (--radius)",
        )


def _seal_edges(
    shape: RigidShape, body: Body, space: fem.FunctionSpace, nodes: assembly.FaceNodes
) -> tuple[shapes.Indices, shapes.Indices]:
    """Return the numbers of the nodes of faces on the cavity's edge, and on all other edges."""
    tree = scipy.spatial.cKDTree(nodes.places)

    def shared(roles: Sequence[str]) -> shapes.Indices:
        places = assembly.FaceNodes(body, space, roles).places if roles else np.empty((0, nodes.places.shape[1]))
        far, nearest = tree.query(places, distance_upper_bound=PLANE_TOLERANCE)
        return np.asarray(np.unique(nearest[np.isfinite(far)]), dtype=np.int64)

    others = [name for name in body.faces if name not in shape.roles]
    walls = actuator.cavity_roles(body.actuator)
    inside, outside = shared(walls[:1]), shared([name for name in others if name != walls[0]])
    if not len(inside):
        raise shape.error(
            f"{shape.faces} shares no edge with the cavity, so it is no rim on which the cavity could "
            "seal; name the face around its opening (lip, of a SuctionCup)"
        )
    return inside, np.setdiff1d(outside, inside)


@dataclasses.dataclass(frozen=True, eq=False)
class _Ring:
    """Sealing faces at rest in pieces, halves of lines or quarters of triangles: nodes of each, shape (p, d), and matrices of
    int grad . grad between these, shape (p, d, d)."""

    pieces: shapes.Indices
    conductances: Array

    @classmethod
    def of(cls, surface: pressing.Surface) -> _Ring:
        d = surface.dimension
        parts = [[0, 2], [2, 1]] if d == 2 else [[0, 5, 4], [5, 1, 3], [4, 3, 2], [3, 4, 5]]
        pieces = surface.facets[:, parts].reshape(-1, d)
        X = surface.nodes[pieces]
        if d == 2:
            lengths = np.linalg.norm(X[:, 1] - X[:, 0], axis=1)
            rings = 2 * math.pi * X[:, :, 0].mean(axis=1) if surface.axisymmetric else np.ones(len(X))
            return cls(pieces, (rings / lengths)[:, None, None] * np.array([[1.0, -1.0], [-1.0, 1.0]]))
        edges = np.roll(X, 1, axis=1) - np.roll(X, -1, axis=1)  # opposite to each corner
        area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
        return cls(pieces, np.einsum("fai,fbi->fab", edges, edges) / (4 * area)[:, None, None])


def _share_dofs(body: Body, share: fem.Function, places: Array) -> tuple[shapes.Indices, shapes.Indices]:
    """Return the local dofs of the share on the sealing faces, and the node that each is."""
    assert body.seal is not None
    space, fdim = share.function_space, body.mesh.topology.dim - 1
    groups = [fem.locate_dofs_topological(space, fdim, body.entities[role][1]) for role in body.seal.roles]
    dofs = np.unique(np.concatenate(groups)).astype(np.int64)
    at = space.tabulate_dof_coordinates()[dofs, : places.shape[1]]
    return dofs, np.asarray(scipy.spatial.cKDTree(places).query(at)[1], dtype=np.int64).reshape(len(dofs))
