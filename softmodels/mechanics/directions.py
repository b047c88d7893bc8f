"""Directions in which a device is reinforced: along a line, around it, or in helices about it.

A direction is given by an axis through the origin and an angle from it: 0 runs along the axis, 90 degrees around it (the hoop
of a tube), what lies between winds a helix. Both are constants of the forms. On a face the direction is laid into the face.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from geometries.fields import shown
from softmodels.mechanics.parts import PartError

if TYPE_CHECKING:
    from dolfinx import fem, mesh
    from ufl.core.expr import Expr

    from softmodels.mechanics.body import Body

Array = npt.NDArray[np.float64]

TINY = 1e-20
"""Square of a length in sizes of the device below which nothing has a direction: on the axis itself there is no hoop."""
SQUARE = 1e-9
"""Largest product of unit vectors that are taken as square to each other."""


class Helix:
    """A field of directions, in UFL.

    Args:
        mesh: Where its constants live.
        axis: Of the helix, three numbers of any length; it passes through the origin.
        angle: From the axis, degrees.
    """

    def __init__(self, mesh: mesh.Mesh, axis: Sequence[float], angle: float):
        from dolfinx import fem

        self._axis: fem.Constant = fem.Constant(mesh, np.zeros(3))
        self._slopes: fem.Constant = fem.Constant(mesh, np.zeros(2))
        self.take(axis, angle)

    def take(self, axis: Sequence[float], angle: float) -> None:
        """Take another axis and angle; nothing is compiled again."""
        unit = np.asarray(axis, dtype=float)
        self._axis.value[:] = unit / np.linalg.norm(unit)
        self._slopes.value[:] = math.cos(math.radians(angle)), math.sin(math.radians(angle))

    def field(self, body: Body, normal: Expr | None, hand: float = 1.0) -> Expr:
        """The direction at every undeformed point, three components; not of unit length where a face cuts through it.

        Args:
            body: Mesh.
            normal: Unit normal of the face into which it is laid; None inside the solid.
            hand: 1, or -1 for the helix that winds the other way.
        """
        import ufl

        X = ufl.SpatialCoordinate(body.mesh)
        place = ufl.as_vector([X[0], 0, X[1]]) if body.axisymmetric else X
        axis, (cosine, sine) = self._axis, (self._slopes[0], self._slopes[1])
        arm = ufl.cross(axis, place)
        direction = cosine * axis + hand * sine * arm / ufl.sqrt(ufl.dot(arm, arm) + TINY)
        if normal is None:
            return direction
        return direction - ufl.dot(direction, normal) * normal


def helix_at(places: Array, axis: Sequence[float], angle: float, hand: float = 1.0) -> Array:
    """The direction of a `Helix` inside a solid, at places of shape (n, 3) in any unit: shape (n, 3)."""
    unit = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    arm = np.cross(unit, places)
    around = arm / np.maximum(np.linalg.norm(arm, axis=1), TINY**0.5)[:, None]
    return np.asarray(math.cos(math.radians(angle)) * unit + hand * math.sin(math.radians(angle)) * around)


def check_axis(where: str, axis: Sequence[float], angle: float) -> None:
    """Refuse, with `PartError`, an axis that is no direction, and an angle that another one stands for."""
    if len(axis) != 3 or not np.linalg.norm(axis) > 0.0:
        raise PartError(f"{where}: axis is {', '.join(f'{a:g}' for a in axis)}; it is a direction of three numbers")
    if abs(angle) > 90.0:
        raise PartError(f"{where}: angle is {shown(angle, 'degree')}; it lies between -90 and 90 deg")


def check_helix(where: str, actuator: Actuator, axis: Sequence[float], angle: float, mirrored: bool) -> None:
    """Refuse a direction whose images by the device's symmetry are others than itself.

    Args:
        where: What is laid along it, for messages.
        actuator: The device.
        axis, angle: As of `Helix`.
        mirrored: Whether what is laid there is its own mirror image, as two families at both angles are.

    Raises:
        PartError: Which plane or section does not allow it.
    """
    unit = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    crooked = min(abs(math.sin(math.radians(angle))), abs(math.cos(math.radians(angle)))) > SQUARE
    if actuator.dimension == 2:
        if np.hypot(unit[0], unit[1]) > SQUARE:
            raise PartError(
                f"{where}: in an axisymmetric section the axis is 0, 0, 1; take a solid section for another"
            )
        if crooked and not mirrored:
            raise PartError(
                f"{where}: one helix at {shown(angle, 'degree')} twists the device, and an axisymmetric section cannot "
                "twist; take a whole solid section, or both helices"
            )
    for plane in actuator.cut_planes:
        across = abs(float(unit @ np.asarray(plane.normal)))
        if actuator.dimension == 3 and SQUARE < across < 1.0 - SQUARE:
            raise PartError(f"{where}: the axis neither lies in the plane of symmetry {plane.name} nor is square to it")
        if actuator.dimension == 3 and crooked and not mirrored:
            raise PartError(
                f"{where}: one helix at {shown(angle, 'degree')} is not its own image in the plane of symmetry "
                f"{plane.name}; take a model of the whole device, or both helices"
            )
