"""A rigid plane that faces of the device come to rest on: a bench, a plate above, the mirror plane between two chambers.

Contact is an energy of the penetration d of every point of the faces, per undeformed area,

    phi(d) = k d^3 / (6 e)                       0 < d < e
    phi(d) = k (d^2/2 - e d/2 + e^2/6)           e < d

a penalty k whose onset is rounded over a depth e: its second derivative is continuous, so that Newton's method and the path's
tangents see no jump (Wriggers 2006, Computational Contact Mechanics). It is conservative and without friction.
A wall that meets its own mirror image presses on the plane of the mirror as on a rigid one, so the same term is the
contact of neighbouring chambers that are each other's mirror images.
"""

from __future__ import annotations

import dataclasses
import math
import re
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from geometries import Actuator, GeometryError
from geometries.actuator import Vector
from geometries.fields import field_of, settle
from geometries.kinds import Quantity, Words
from geometries.selections import faces as plane_faces
from measurement.arguments import checked
from measurement.wording import Spoken
from softmodels.mechanics.body import Body
from softmodels.mechanics.mpi import largest
from softmodels.mechanics.named_places import check_on_mesh, names_in
from softmodels.mechanics.parts import PartError
from softmodels.mechanics.section_axes import in_section

if TYPE_CHECKING:
    from dolfinx import fem
    from ufl.core.expr import Expr

STIFFNESS = 300.0
"""Shear moduli of pressure per penetration of one size of the device: a contact pressure of one shear modulus, more than
soft actuators take, sinks in by 0.3 % of the size. The default disk presses on a plate with 0.2 % less than on a rigid one;
1000 takes half as many iterations more."""
SOFTEST, STIFFEST = 1.0, 1e5
ONSET = 1e-3
"""Depth over which the contact sets in, in sizes of the device."""
ONSET_PRESSURE = 0.3
"""Pressure in shear moduli that a stiffness would have at the end of its onset, were that not rounded."""
NEAR = 1e-6
"""Distance in sizes up to which a point lies in the plane."""


class ObstacleError(Spoken, ValueError):
    """A plane or face that makes no contact; the message is a sentence for the user."""


@checked
@dataclasses.dataclass(frozen=True)
class Obstacle:
    """A rigid plane without friction, and the faces that it stops.

    Attributes:
        faces: Roles of the facets that it stops, such as ``"top"`` or ``"bottom, outer"``; others pass through it.
        plane: ``"z = 9 mm"``, ``"normal 0.6, 0, 0.8 at 9 mm"``, or a cut plane's name. The device keeps to the side
            on which the faces lie at rest.
        stiffness: Contact pressure per penetration, in shear moduli over `Actuator.size`; see `STIFFNESS`.

    Raises:
        ObstacleError: No such plane, or a stiffness out of `SOFTEST` to `STIFFEST`.
    """

    faces: str = field_of(
        Words(), "faces that a rigid plane without friction stops, such as top; its force is in path.csv"
    )
    plane: str = field_of(
        Words(),
        "the rigid plane: 'z = 9mm', 'normal 0.6, 0, 0.8 at 9 mm', or a cut plane's name for walls that meet their mirror "
        "image",
    )
    stiffness: float = field_of(
        Quantity(), "shear moduli of contact pressure per sinking in by one size of the device", STIFFNESS
    )

    table: ClassVar[str] = "contact"
    needs: ClassVar[str] = (
        "contact needs the faces that are stopped and a plane (--contact top --contact-plane 'z = 9mm')"
    )

    def __post_init__(self) -> None:
        if not (isinstance(self.faces, str) and self.roles and isinstance(self.plane, str) and self.plane):
            raise ObstacleError(self.needs)
        settle(self, ObstacleError)
        if not SOFTEST <= self.stiffness <= STIFFEST:
            raise ObstacleError(
                f"the contact's stiffness is {self.stiffness:g}; it is a number of shear moduli per size of the device, "
                f"{SOFTEST:g} to {STIFFEST:g}, and {STIFFNESS:g} is usual"
            )
        if not self.on_cut:
            self._written()

    def check_on(self, actuator: Actuator) -> None:
        """Raise `ObstacleError` where there is no such plane beside a device."""
        try:
            check_on_mesh("contact", actuator, self.roles)
        except PartError as error:
            raise ObstacleError(str(error)) from None
        self.place(actuator)

    @property
    def roles(self) -> list[str]:
        return names_in(self.faces)

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
        except GeometryError as error:
            if str(error).startswith("contact plane: "):  # the form is right, and a number in it is not
                raise ObstacleError(str(error)) from None
        raise ObstacleError(
            f"contact plane {self.plane!r} is no plane; write 'z = 9mm', 'normal 0.6, 0, 0.8 at 9 mm' or a cut "
            "plane's name"
        )

    def place(self, actuator: Actuator) -> tuple[Vector, Vector]:
        """Point (m) and unit normal of the plane, its side not yet chosen.

        Raises:
            ObstacleError: An unknown cut plane, or a plane that is none of revolution beside an axisymmetric section.
        """
        if self.on_cut:
            cuts = {plane.name: plane.normal for plane in actuator.cut_planes}
            if self.plane not in cuts:
                known = f"its cut planes are {', '.join(cuts)}" if cuts else "it has no cut planes"
                raise ObstacleError(f"contact plane {self.plane!r}: {known}; or write its place, such as 'z = 9mm'")
            return (0.0, 0.0, 0.0), cuts[self.plane]
        point, normal = self._written()
        if actuator.dimension == 2 and abs(normal[2]) < 1 - 1e-12:
            raise ObstacleError(f"contact plane {self.plane!r}: a section takes planes square to its axis, 'z = 9mm'")
        return point, normal


def penalty(d: Expr, onset: fem.Constant) -> Expr:
    """phi(d) / k in UFL, of a d that is not below zero."""
    import ufl

    return ufl.conditional(ufl.lt(d, onset), d**3 / (6 * onset), d**2 / 2 - onset * d / 2 + onset**2 / 6)


class Contact:
    """An obstacle's terms in the equations of a body; dimensionless inside.

    Args:
        obstacle: The plane.
        body: The mesh.
        y: The unknown skew displacement in UFL.

    Attributes:
        energies: UFL integrals, one per face.
        forces: UFL integrals, one per face: the slice's force on the plane, along the normal.

    Raises:
        ObstacleError: A face that the mesh lacks, or that lies on both sides of the plane.
    """

    def __init__(self, obstacle: Obstacle, body: Body, y: Expr):
        import ufl
        from dolfinx import fem

        actuator, mesh = body.actuator, body.mesh
        point, normal = obstacle.place(actuator)
        self.body, self.roles = body, obstacle.roles
        facets = mesh.topology.dim - 1
        for role in self.roles:
            if body.entities.get(role, (-1,))[0] != facets:
                known = ", ".join(name for name, (dimension, _) in body.entities.items() if dimension == facets)
                raise ObstacleError(
                    f"contact: the mesh of {type(actuator).__name__} has no face {role!r}; it has {known}"
                )
        self.normal = in_section(normal, actuator.dimension)
        self.level = float(np.dot(point, normal)) / actuator.size
        self.normal, self.level = self._towards_the_device()
        along, level = fem.Constant(mesh, self.normal), fem.Constant(mesh, self.level)
        stiffness, onset = fem.Constant(mesh, float(obstacle.stiffness)), fem.Constant(mesh, ONSET)
        d = ufl.max_value(level - ufl.dot(along, ufl.SpatialCoordinate(mesh) + body.displacement(y)), 0.0)
        energy = penalty(d, onset)
        pressure = ufl.conditional(ufl.lt(d, onset), d**2 / (2 * onset), d - onset / 2)
        areas = [body.sheet_face(role)[0] for role in self.roles]
        self.energies = [stiffness * energy * body.hoop * dA for dA in areas]
        self.forces = [stiffness * pressure * body.hoop * dA for dA in areas]

    def _towards_the_device(self) -> tuple[npt.NDArray[np.float64], float]:
        """Normal and place along it, turned to the side of the faces at rest; of the body, if they lie in the plane."""
        x, comm = self.body.mesh.geometry.x[:, : len(self.normal)], self.body.mesh.comm

        def span(nodes: npt.NDArray[np.int32] | slice) -> list[float]:
            gaps = self.gaps(x[nodes])
            return [largest(comm, float(values.max()) if values.size else -math.inf) for values in (gaps, -gaps)]

        above, below = span(self._nodes())
        if min(above, below) > NEAR:
            size = self.body.actuator.size * 1e3
            raise ObstacleError(
                f"contact: at rest the faces {', '.join(self.roles)} lie on both sides of the plane, {below * size:.4g} mm on "
                f"the one and {above * size:.4g} mm on the other; move the plane, or name only the faces that it stops"
            )
        if max(above, below) <= NEAR:
            above, below = span(slice(None))
        sign = 1.0 if above > below else -1.0
        return sign * self.normal, sign * self.level

    def gaps(self, places: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Distances to the plane of places of the mesh, shape (n, d) to (n,); below zero where they have sunk in."""
        return places @ self.normal - self.level

    @property
    def facets(self) -> npt.NDArray[np.int32]:
        """Local facets that the plane stops."""
        return np.unique(np.concatenate([self.body.entities[role][1] for role in self.roles])).astype(np.int32)

    def _nodes(self) -> npt.NDArray[np.int32]:
        from dolfinx import mesh as meshes

        mesh = self.body.mesh
        mesh.topology.create_connectivity(mesh.topology.dim - 1, mesh.topology.dim)
        return np.unique(meshes.entities_to_geometry(mesh, mesh.topology.dim - 1, self.facets))
