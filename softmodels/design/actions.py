"""Quantities of what a device does to its surroundings: forces on rigid shapes, the air's work, and how a face turns."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from geometries import Actuator
from geometries.actuator import cavity_roles
from softmodels.common.arrays import Array
from softmodels.components.contact import FileShapeTerm, GuidedShapeTerm, Obstacle, RigidShape, ShapeTerm, force_of_all
from softmodels.design.quantities import DesignQuantity, FormMeasure, Measure, Slopes, energy_measure, register_quantity
from softmodels.mechanics.assembly import AssembledTerm
from softmodels.mechanics.body import BodyError, in_space
from softmodels.mechanics.component import ComponentError, direction

if TYPE_CHECKING:
    import ufl
    from ufl.core.expr import Expr

    from softmodels.design.quantities import DesignedBody
    from softmodels.mechanics.component import Component
    from softmodels.mechanics.system import State


# ----------------------------------------------------------------------------------------------------------------------
# Forces on rigid shapes.


class PressedMeasure(Measure):
    """Force of the device on a shape whose contact is a sum over samples.

    Args:
        design: The meshed device.
        term: The contact.
        along: Weights of the force's components in the mesh's coordinates, SI units over dimensionless ones and shear moduli.
    """

    def __init__(self, design: DesignedBody, term: AssembledTerm, along: Array):
        self.design, self.term, self.along = design, term, along

    def value(self, state: State | None) -> float:
        force = self.term.force(self.design.system.w.x.array)
        return self.design.system.stress_unit * float(force @ self.along)

    def slopes(self, state: State | None) -> Slopes:
        system, motion = self.design.system, self.design.motion
        unit, w = system.stress_unit, system.w.x.array
        rates = unit * self.term.along_product(w, self.along)  # by the nodes' deformed places
        by_w = np.zeros(system.n)
        self.term.add_rates(rates, by_w)
        by_X = motion.by_nodes(self.term.nodes.by_mesh(rates))
        return Slopes(self.value(state), system.by_unknowns(by_w).copy(), 0.0, by_X)


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class ForceOn(DesignQuantity):
    """Force of the whole device on a rigid shape or plane.

    Attributes:
        of: Name of the shape, as in ``[contact.ball]``; "contact" for the plane of ``[contact]``.
        along: Direction in device coordinates, such as "z" or "0.6, 0, 0.8"; the device's lift if empty.
    """

    name: ClassVar = "force_on"
    unit: ClassVar = "N"
    help: ClassVar = "force of the whole device on a rigid shape (of) along a direction"

    of: str = ""
    along: str = ""

    @property
    def title(self) -> str:
        return f"force on {self.of}" + (f" along {self.along}" if self.along else "")

    @staticmethod
    def named(device: Actuator, components: Sequence[Component]) -> tuple[str, list[str]]:
        return "rigid shape", [part.label for part in components if isinstance(part, RigidShape | Obstacle)]

    def measure(self, design: DesignedBody) -> Measure:
        system, terms = design.system, design.system.potential.terms
        shapes = {
            label: term
            for label, term in terms.items()
            if isinstance(term, ShapeTerm | FileShapeTerm | GuidedShapeTerm)
        }
        if self.of not in shapes:
            raise ValueError(f"the case has no rigid shape {self.of!r}; it has {', '.join(shapes) or 'none'}")
        term, actuator = shapes[self.of], system.body.actuator
        try:
            way = np.asarray(direction(self.along, "force_on: along") if self.along else actuator.lift)
        except ComponentError as error:
            raise ValueError(str(error)) from None
        assert isinstance(term.shape, RigidShape)
        crossed, axes = term.shape.crossed(actuator), np.eye(actuator.dimension)
        shares = [float(force_of_all(actuator, crossed, in_space(axis)) @ way) for axis in axes]
        weights = system.length_unit**2 * np.array(shares)
        if isinstance(term, AssembledTerm):
            return PressedMeasure(design, term, weights)
        forms = [
            weight * form for forces in term.pushes for weight, form in zip(weights, forces, strict=True) if weight
        ]
        if not forms:
            raise ValueError(f"{self.title} vanishes by symmetry; use another direction (along)")
        return FormMeasure(
            design, forms, lambda values: (float(values.sum()), np.ones(len(values))), counted_in_stress=True
        )


# ----------------------------------------------------------------------------------------------------------------------
# The air's work: by the conservation of energy what is stored, as nothing is lost on the way.


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class InflationWork(DesignQuantity):
    """Work of the air on the device from no pressure up to a state, the integral of p dV.

    Per cycle it is what the supply has to give each time; the same is what an ideal engine would get back.
    """

    name: ClassVar = "inflation_work"
    unit: ClassVar = "J"
    help: ClassVar = "work of the air up to the state, the integral of p dV: what one cycle takes"

    def measure(self, design: DesignedBody) -> Measure:
        if design.system.dead.loads:
            where = design.system.dead.loads[0].where
            raise ValueError(f"{self.name} is not available with loads ({where}), which work too; use added_volume")
        return energy_measure(design)


# ----------------------------------------------------------------------------------------------------------------------
# Pose of a face: its mean place and how it has turned about an axis.
#
# The turn is that of the rotation about the axis that brings the face's undeformed places X nearest to the deformed ones x,
# both counted from their means: tan t = (int a . (X x x) dA) / (int X . x - (a . X) (a . x) dA).


class OfFace(DesignQuantity):
    """A quantity of a face, named by ``of``."""

    @staticmethod
    def named(device: Actuator, components: Sequence[Component]) -> tuple[str, list[str]]:
        return "face", list(
            dict.fromkeys([*device.faces, *cavity_roles(device), *(hold.role for hold in device.holds)])
        )


def _on_face(design: DesignedBody, face: str) -> ufl.Measure:
    try:
        return design.system.body.sheet_face(face)[0]
    except BodyError as error:
        raise ValueError(str(error)) from None


def _places(design: DesignedBody) -> tuple[Expr, Expr]:
    """Return undeformed and deformed places in UFL, three components each; of a section in its plane."""
    import ufl

    system = design.system
    X = ufl.SpatialCoordinate(system.body.mesh)
    x = X + system.body.displacement(system.potential.displacement)
    if system.body.axisymmetric:
        return ufl.as_vector([X[0], 0, X[1]]), ufl.as_vector([x[0], 0, x[1]])
    return X, x


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class FacePlace(OfFace):
    """Mean place of a face in a direction.

    Attributes:
        of: The face, such as "tip".
        axis: Direction in device coordinates, such as "z" or "0.6, 0, 0.8".
    """

    name: ClassVar = "face_place"
    unit: ClassVar = "m"
    help: ClassVar = "mean place of a face (of) along a direction (axis), deformed"

    of: str = ""
    axis: str = "z"

    @property
    def title(self) -> str:
        return f"place {self.axis} of {self.of}"

    def measure(self, design: DesignedBody) -> Measure:
        import ufl
        from dolfinx import fem

        way, body, area = _direction(design, self.axis, self.name), design.system.body, _on_face(design, self.of)
        across = [plane for plane in body.actuator.cut_planes if abs(float(np.dot(way, plane.normal))) > SQUARE]
        if across or (body.axisymmetric and abs(way[2]) < 1 - SQUARE):
            raise ValueError(f"{self.name}: by symmetry a place along {self.axis} does not move; use another axis")
        along, one = fem.Constant(body.mesh, way), fem.Constant(body.mesh, 1.0)
        forms = [value * body.hoop * area for value in (ufl.dot(along, _places(design)[1]), one)]
        unit = design.system.length_unit

        def mean(values: Array) -> tuple[float, Array]:
            place = unit * values[0] / values[1]
            return float(place), np.array([unit, -place]) / values[1]

        return FormMeasure(design, forms, mean)


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class Turn(OfFace):
    """Angle by which a face has turned about an axis, from -180 to 180 degrees, right-handed.

    Attributes:
        of: The face, such as "tip".
        axis: In device coordinates, such as "y" or "0.6, 0, 0.8".
    """

    name: ClassVar = "turn"
    unit: ClassVar = "deg"
    help: ClassVar = "angle by which a face (of) has turned about an axis, right-handed"

    of: str = ""
    axis: str = "y"

    @property
    def title(self) -> str:
        return f"turn of {self.of} about {self.axis}"

    def measure(self, design: DesignedBody) -> Measure:
        import ufl
        from dolfinx import fem

        way, body, area = _direction(design, self.axis, self.name), design.system.body, _on_face(design, self.of)
        across = [plane for plane in body.actuator.cut_planes if abs(float(np.dot(way, plane.normal))) < 1 - SQUARE]
        if across or body.axisymmetric:
            raise ValueError(f"{self.name}: by symmetry nothing turns about {self.axis}; use {body.actuator.fuller}")
        axis, one = fem.Constant(body.mesh, way), fem.Constant(body.mesh, 1.0)
        X, x = _places(design)
        square = ufl.dot(X, x) - ufl.dot(axis, X) * ufl.dot(axis, x)
        integrands = [ufl.dot(axis, ufl.cross(X, x)), square, one, *(X[i] for i in range(3)), *(x[i] for i in range(3))]
        return FormMeasure(
            design, [value * body.hoop * area for value in integrands], lambda values: _turn(way, values)
        )


SQUARE = 1e-9
"""Largest scalar product of unit vectors that count as perpendicular."""


def _turn(axis: Array, values: Array) -> tuple[float, Array]:
    """Return the angle in degrees and its slopes, from the integrals of `Turn`."""
    (crossed, square, area), X, x = values[:3], values[3:6], values[6:]
    sine = crossed - float(axis @ np.cross(X, x)) / area
    flat, moved = X - axis * (axis @ X), x - axis * (axis @ x)
    cosine = square - float(flat @ moved) / area
    by_sine = np.concatenate([
        [1.0, 0.0, float(axis @ np.cross(X, x)) / area**2], -np.cross(x, axis) / area, -np.cross(axis, X) / area,
    ])  # fmt: skip
    by_cosine = np.concatenate([[0.0, 1.0, float(flat @ moved) / area**2], -moved / area, -flat / area])
    size = sine**2 + cosine**2
    return math.degrees(math.atan2(sine, cosine)), np.degrees((cosine * by_sine - sine * by_cosine) / size)


def _direction(design: DesignedBody, text: str, where: str) -> Array:
    try:
        return np.asarray(direction(text, f"{where}: axis"))
    except ComponentError as error:
        raise ValueError(str(error)) from None
