"""The energy of faces that a sphere, a cylinder or a capsule stops: as a form, and as sums over samples for one that moves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from softmodels.mechanics import round_shapes
from softmodels.mechanics.body import Body
from softmodels.mechanics.contact import NEAR, ONSET_PRESSURE, penalty
from softmodels.mechanics.contact_part import StoppingShape, shape_figures
from softmodels.mechanics.face_nodes import FaceNodes
from softmodels.mechanics.mpi import largest
from softmodels.mechanics.parts import Equations, PartError, Setting, Term
from softmodels.mechanics.round_shapes import Numbers, distance, distances
from softmodels.mechanics.walls.by_distance import HardeningPenalty, PressedByDistance
from softmodels.mechanics.walls.pressing import PressingTerm
from softmodels.mechanics.walls.surface import Surface

if TYPE_CHECKING:
    from dolfinx import fem

Array = npt.NDArray[np.float64]

WAY = 8
"""Places on the straight way of a node from state to state at which its depth is looked at."""
HARDENS = 0.25
"""Share of the depth at which a state is refused from which the shape grows harder. The energy is of the undeformed area, which
a wrapped membrane stretches to ten or twenty times itself, so that it would sink in ten or twenty times as deep."""
HARDER = 16.0
"""How steeply: at the refused depth the contact is 1 + HARDER (1 - HARDENS)^2 / (2 HARDENS), some 19, times as hard."""
SOON = 0.1
"""Distance in sizes of the device that counts as near."""


class RoundShape(StoppingShape, Protocol):
    """A shape with a radius."""

    @property
    def shape(self) -> str: ...
    def numbers(self, size: float) -> Numbers: ...
    def deepest(self, size: float) -> float: ...
    def crossed(self, actuator: Actuator) -> Sequence[Array]: ...


def clear(numbers: Numbers, deepest: float, start: Array, end: Array) -> bool:
    """Whether nodes may go from places to places, shape (n, d) each, without getting deeper than ``deepest`` into a shape."""
    way = (start + t * (end - start) for t in np.linspace(0.0, 1.0, WAY + 1)[1:])
    return all(float(distances(places, numbers).min(initial=math.inf)) > -deepest for places in way)


def check_rest(shape: RoundShape, body: Body) -> None:
    """Refuse a shape that lies in the device at rest.

    Raises:
        PartError: It does.
    """
    size = body.actuator.size
    points = body.mesh.geometry.x[:, : body.mesh.topology.dim]
    deepest = largest(body.mesh.comm, -float(distances(points, shape.numbers(size)).min(initial=math.inf)))
    if deepest > NEAR:
        side = "outside of the hollow" if shape.hollow else "in the"
        raise PartError(
            f"{shape.where}: at rest the device lies {deepest * size * 1e3:.4g} mm deep {side} {shape.shape}; move it away"
            + ("" if shape.shape == "plane" else ", or give it another radius")
        )


class ShapeTerm(Term):
    """A shape that stands still, with the force on it.

    Args:
        shape: The shape.
        setting: The potential.

    Raises:
        PartError: The device lies in it.
    """

    def __init__(self, shape: RoundShape, setting: Setting):
        super().__init__([])
        import ufl
        from dolfinx import fem

        self.shape, self.body = shape, setting.body
        body, mesh, size = self.body, self.body.mesh, self.body.actuator.size
        check_rest(shape, body)
        self.numbers = shape.numbers(size)
        self._place = fem.Constant(mesh, self.numbers[0])
        others = (None if value is None else fem.Constant(mesh, value) for value in self.numbers[1:])
        constants = (self._place, *others)
        onset, soft = ONSET_PRESSURE / shape.stiffness, HARDENS * shape.deepest(size)
        stiffness, onset, soft = (fem.Constant(mesh, float(value)) for value in (shape.stiffness, onset, soft))
        place = ufl.variable(ufl.SpatialCoordinate(mesh) + body.displacement(setting.displacement))
        components = [place[0], place[1], place[2]] if mesh.topology.dim == 3 else [place[0], 0.0, place[1]]
        depth = ufl.max_value(-distance(components, constants), 0.0)
        energy = stiffness * (penalty(depth, onset) + HARDER / (6 * soft) * ufl.max_value(depth - soft, 0.0) ** 3)
        push = ufl.diff(energy, place)  # on the shape; the device takes the opposite
        self.energies, self._forces = [], []
        for role in shape.roles:
            area = body.sheet_face(role)[0]
            self.energies.append(energy * body.hoop * area)
            self._forces.append([push[c] * body.hoop * area for c in range(mesh.topology.dim)])
        self.nodes = FaceNodes(body, setting.w.function_space, shape.roles)

    def move_to(self, at: npt.ArrayLike) -> None:
        """Put the shape somewhere else, in m: an indenter that comes down from state to state."""
        place = np.asarray(at, dtype=float) / self.body.actuator.size
        self.numbers = (place, *self.numbers[1:])
        self._place.value = place

    def compile(self, equations: Equations) -> None:
        self._compiled: list[list[fem.Form]] = [[equations.form(force) for force in forces] for forces in self._forces]

    def figures(self, equations: Equations) -> dict[str, float]:
        by_role = [[equations.integral(form) for form in forces] for forces in self._compiled]
        force = equations.stress_unit * equations.length_unit**2 * np.sum(by_role, axis=0)
        depth = -float(distances(self.nodes.moved(equations.w.x.array), self.numbers).min()) * equations.length_unit
        actuator = self.body.actuator
        return shape_figures(self.shape.label, actuator, self.shape.crossed(actuator), force, depth)

    def admits(self, before: Array, after: Array) -> bool:
        size = self.body.actuator.size
        return clear(self.numbers, self.shape.deepest(size), self.nodes.moved(before), self.nodes.moved(after))


class SampledShapeTerm(PressingTerm[PressedByDistance]):
    """The same energy as sums over samples, for a shape that gives way (`softmodels.mechanics.guided_shapes`).

    Args:
        shape: The shape.
        setting: The potential.

    Raises:
        PartError: The device lies in it.
    """

    def __init__(self, shape: RoundShape, setting: Setting):
        body = setting.body
        check_rest(shape, body)
        nodes = FaceNodes(body, setting.w.function_space, shape.roles)
        super().__init__(nodes)
        size = body.actuator.size
        self.surface = Surface(nodes.places, nodes.facets, nodes.faces, nodes.inside, body.axisymmetric)
        self.numbers, self.deepest, self.crossed = (
            shape.numbers(size),
            shape.deepest(size),
            shape.crossed(body.actuator),
        )
        onset, soft = ONSET_PRESSURE / shape.stiffness, HARDENS * self.deepest
        self.penalty = HardeningPenalty(shape.stiffness, onset, soft, HARDER)
        self.move(nodes.places)

    def pressed(self, places: Array) -> PressedByDistance:
        return PressedByDistance(self.surface, self._slopes, self.penalty, SOON, places)

    def _slopes(self, places: Array) -> tuple[Array, Array, Array]:
        return round_shapes.slopes(places, self.numbers)

    def clear(self, start: Array, end: Array) -> bool:
        """Whether nodes may go from places to places, shape (n, d) each, without passing through the shape."""
        return clear(self.numbers, self.deepest, start, end)
