"""Contact as springs: one for each integration point of the stopped faces, with the same energy of its depth.

Contact's energy is a function of the distance of integration points to a plane, a point or a line (see
`softmodels.mechanics.contact` and `softmodels.mechanics.rigid_shapes`). That is the length of a spring from there to the point,
projected onto what is square to the plane or the line.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from geometries.mesh_arrays import MeshArrays
from geometries.tetrahedra import WEIGHTS, triangle_tables
from softmodels.case.decks.springs import Slide, Springs
from softmodels.case.decks.supports import Terms
from softmodels.mechanics import guided_shapes
from softmodels.mechanics.contact import ONSET, ONSET_PRESSURE, Contact, Obstacle
from softmodels.mechanics.contact_part import copies_around
from softmodels.mechanics.loads import gravity_of
from softmodels.mechanics.parts import Part
from softmodels.mechanics.rigid_shapes import RigidShape
from softmodels.mechanics.shape_terms import HARDENS, HARDER
from softmodels.mechanics.system import System
from softmodels.mechanics.walls.by_distance import HardeningPenalty
from softmodels.mechanics.walls.gap import Penalty
from softmodels.mechanics.walls.giving_way import Stand

Array = npt.NDArray[np.float64]

SHAPES = ("sphere", "cylinder", "plane")
"""Shapes that are as far away as a point or a straight line is, less a radius."""
ENTRIES, HARD_ENTRIES = 40, 20
"""Of a table over the depth in which contact sets in, and over that in which a shape grows harder."""
SETTLED, LIFTED = 8.0, 80
"""Ways over which a weight is lifted, in those that it is rounded over, and entries of a table over them."""
AWAY = 10.0
"""Distance in sizes of the device up to which tables go, where nothing presses."""


@dataclasses.dataclass(frozen=True, eq=False)
class Stop:
    """What stops faces, lengths in sizes of the device.

    Attributes:
        label: Its name in the deck.
        roles: The faces.
        ground: The point that springs are fixed to, shape (3,).
        onto: What integration points are projected with from there, shape (3, 3).
        radius: Length of a spring that touches.
        sign: 1 where a shorter one presses, -1 where a longer one does.
        penalty: The energy.
        depths: At which its slope is written, rising from 0.
        slide: On which it gives way, lengths in m; None where it stands still.
    """

    label: str
    roles: list[str]
    ground: Array
    onto: Array
    radius: float
    sign: float
    penalty: Penalty
    depths: Array
    slide: Slide | None = None


def pressing(obstacle: Obstacle | None, system: System, mesh: MeshArrays, parts: Sequence[Part]) -> list[Springs]:
    """The springs of a device's contact.

    Args:
        obstacle: A plane; None for none.
        system: The device's equations.
        mesh: The mesh of its slice.
        parts: What else is added to the device.
    """
    size = system.body.actuator.size
    stops = [_plane(obstacle, system.contact)] if obstacle is not None and system.contact is not None else []
    stops += [_shape(part, system.body.actuator, gravity_of(parts)) for part in parts if isinstance(part, RigidShape)]
    return [_springs(stop, mesh, size, system.stress_unit) for stop in stops]


def _plane(obstacle: Obstacle, contact: Contact) -> Stop:
    depths = np.append(np.linspace(0.0, ONSET, ENTRIES + 1), 0.5)
    normal = contact.normal
    ground = (contact.level - 1.0) * normal  # a spring that touches is one size long
    penalty = Penalty(obstacle.stiffness, ONSET)
    return Stop("the plane", contact.roles, ground, np.outer(normal, normal), 1.0, 1.0, penalty, depths)


def _shape(shape: RigidShape, actuator: Actuator, gravity: Array) -> Stop:
    size = actuator.size
    at, along, radius, _, sign = shape.numbers(size)
    onset, deepest = ONSET_PRESSURE / shape.stiffness, shape.deepest(size)
    penalty = HardeningPenalty(shape.stiffness, onset, HARDENS * deepest, HARDER)
    depths = np.union1d(np.linspace(0.0, onset, ENTRIES + 1), np.linspace(HARDENS * deepest, deepest, HARD_ENTRIES + 1))
    across = np.outer(along, along)
    onto = np.eye(3) if shape.shape == "sphere" else np.eye(3) - across
    if radius is None:  # a plane: a spring that touches is one size long
        at, onto, radius = (at @ along - 1.0) * along, across, 1.0
    slide = _slide(shape, actuator, onto, gravity) if shape.guide else None
    return Stop(shape.label, shape.roles, at, onto, radius, sign, penalty, depths, slide)


def _slide(shape: RigidShape, actuator: Actuator, onto: Array, gravity: Array) -> Slide:
    """What holds a shape that gives way, the slice's share of it."""
    share, size = copies_around(actuator, shape.crossed(actuator)), actuator.size
    stand = Stand(
        shape.spring / share, guided_shapes.weight_against(shape, gravity) / share, guided_shapes.ONSET * size
    )
    ways = np.concatenate([[-0.9 * size], np.linspace(0.0, SETTLED * stand.onset, LIFTED + 1), [0.9 * size]])
    forces = np.array([stand.force(float(way)) for way in ways])
    return Slide(shape.gives_way, onto @ shape.gives_way, size, ways, forces)


def _springs(stop: Stop, mesh: MeshArrays, size: float, stress: float) -> Springs:
    nodes = np.concatenate([mesh.triangles(role) for role in stop.roles])
    values, along, across = triangle_tables(nodes.shape[1])
    places, a, b = (np.einsum("qn,kni->kqi", table, mesh.points[nodes]) for table in (values, along, across))
    areas = (np.linalg.norm(np.cross(a, b), axis=2) * WEIGHTS / 2).ravel()
    ground = size * stop.ground
    ends = ground + (places.reshape(-1, 3) - ground) @ stop.onto.T
    lengths = np.linalg.norm(ends - ground, axis=1)
    depths = np.concatenate([[-AWAY], stop.depths])
    slopes = np.concatenate([[0.0], stop.penalty.rates(stop.depths)[1]])
    order = np.argsort(-stop.sign * depths)
    touching = np.maximum(size * (stop.radius - stop.sign * depths[order]), 1e-3 * size)
    terms = [
        (_row(stop.onto[0], own, value), _row(stop.onto[1], own, value), _row(stop.onto[2], own, value))
        for own in nodes
        for value in values
    ]
    forces = -stop.sign * stress * np.outer(areas, slopes[order])
    what = "contact: springs to the integration points of the stopped faces"
    return Springs(stop.label, what, ground, ends, terms, touching - lengths[:, None], forces, stop.slide)


def _row(onto: Array, nodes: npt.NDArray[np.int64], values: Array) -> Terms:
    """What one component of an end's displacement is the sum of."""
    components = np.flatnonzero(np.abs(onto) > 1e-12)
    return {
        (int(node), int(i)): float(onto[i] * value)
        for node, value in zip(nodes, values, strict=True)
        for i in components
    }
