"""How a deck's nodes may move: held, tied to others, or with a rigid part.

A rigid part's nodes are held by the part alone, whatever else they lie on: its motions are those that cut planes and supports
leave it (`softmodels.mechanics.rigid`), and other programs refuse a dof that two conditions hold. A part that does not turn is
written as linear equations between its nodes; one that turns has two nodes of its own, for its place and for its rotation.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping

import numpy as np
import numpy.typing as npt

from geometries.mesh_arrays import MeshArrays
from geometries.tetrahedra import Ints
from softmodels.case.case import Case
from softmodels.mechanics.holds import held_with
from softmodels.mechanics.rigid import Rigid
from softmodels.mechanics.rigid_motion import Freedom

Array = npt.NDArray[np.float64]
Terms = dict[tuple[int, int], float]


@dataclasses.dataclass(frozen=True)
class Tie:
    """A displacement that is a sum of others.

    Attributes:
        node, component: Which it is.
        terms: Factors by node and component of the others.
    """

    node: int
    component: int
    terms: Terms


@dataclasses.dataclass(frozen=True)
class Rigged:
    """A rigid part of a deck that moves.

    Attributes:
        name: Its label.
        nodes: The mesh's nodes that follow it.
        place: The node whose displacement is that of its centre, or of all its nodes where it does not turn.
        turn: The node whose displacement is its rotation vector in rad; None where it does not turn.
    """

    name: str
    nodes: Ints
    place: int
    turn: int | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Supports:
    """What holds a deck's nodes.

    Attributes:
        held: Held displacements: component (0 to 2) and nodes at which it vanishes, no node twice for a component.
        tied: Displacements that depend on others.
        rigged: Rigid parts that move.
        added: Places in m of nodes that are not the mesh's, numbered behind it, shape (k, 3).
    """

    held: dict[int, Ints]
    tied: tuple[Tie, ...]
    rigged: tuple[Rigged, ...]
    added: Array


def supports_of(case: Case, mesh: MeshArrays, freedoms: Mapping[str, Freedom]) -> Supports:
    """What holds the nodes of a case's mesh.

    Args:
        case: The case.
        mesh: Its device's mesh.
        freedoms: The motions left to each rigid part, by its label, its centre in m.
    """
    rows, ties = _held_directions(case, mesh), list[Tie]()
    rigged, added = [], np.empty((0, 3))
    for part in case.parts:
        if not isinstance(part, Rigid):
            continue
        nodes = mesh.nodes[part.face] if part.face else _within(mesh, part.region)
        freedom = freedoms[part.label]
        rows[nodes] = 0.0
        if not freedom.count:
            rows[nodes, :3] = np.eye(3)
        elif len(freedom.axes):
            place = len(mesh.points) + len(added)
            added = np.vstack([added, freedom.centre, freedom.centre])
            rigged.append(Rigged(part.label, nodes, place, place + 1))
            ties += [*_left(place, freedom.directions), *_left(place + 1, freedom.axes)]
        else:
            place = int(nodes[np.linalg.norm(mesh.points[nodes] - freedom.centre, axis=1).argmin()])
            rigged.append(Rigged(part.label, nodes, place))
            ties += _as_one(nodes, place, freedom.directions)
    ties += [tie for node in np.flatnonzero(np.abs(rows).any(axis=(1, 2))) for tie in _solved_at(int(node), rows[node])]
    held = {c: np.array([tie.node for tie in ties if tie.component == c and not tie.terms]) for c in range(3)}
    return Supports(
        {component: nodes for component, nodes in held.items() if len(nodes)},
        tuple(tie for tie in ties if tie.terms),
        tuple(rigged),
        added,
    )


def _within(mesh: MeshArrays, region: str) -> Ints:
    """Nodes of a region's cells."""
    return np.unique(mesh.cells[mesh.regions[region]])


def _held_directions(case: Case, mesh: MeshArrays) -> Array:
    """Directions that cut planes, the device's own supports and clamps hold at each node, shape (n, k, 3), k at least 3."""
    device, rows = case.actuator, np.zeros((len(mesh.points), 3, 3))
    for role, direction in [
        *((plane.name, plane.normal) for plane in device.cut_planes),
        *((hold.role, hold.direction) for hold in held_with(device.holds, device, case.parts)),
    ]:
        added = np.zeros((len(mesh.points), 3, 3))
        nodes = mesh.nodes[role] if role in mesh.nodes else _within(mesh, role)
        added[nodes] = np.eye(3) if direction is None else [direction, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]
        rows = np.concatenate([rows, added], axis=1)
    return rows


def _left(node: int, ways: Array) -> list[Tie]:
    """What leaves a node the displacements along orthonormal ways alone, shape (k, 3); one without terms vanishes."""
    return _solved_at(node, np.eye(3) - ways.T @ ways)


def _as_one(nodes: Ints, place: int, ways: Array) -> Iterator[Tie]:
    """What lets nodes move as one of them does, along orthonormal ways alone, shape (k, 3)."""
    found = {tie.component: tie.terms for tie in _left(place, ways)}
    terms = [found.get(i, {(place, i): 1.0}) for i in range(3)]
    for node in nodes:
        own = found if node == place else range(3)
        yield from (Tie(int(node), i, terms[i]) for i in own)


def _solved_at(node: int, rows: Array) -> list[Tie]:
    return [
        Tie(node, component, {(node, i): factor for i, factor in factors.items()})
        for component, factors in solved(rows)
    ]


def solved(rows: Array) -> list[tuple[int, dict[int, float]]]:
    """Components that vanish, or depend on others, where some directions are held: the reduced row echelon form.

    Args:
        rows: Held directions, shape (k, 3).

    Returns:
        Components with the factors of those that they are the sum of; none for one that vanishes.
    """
    matrix, found = rows.copy(), []
    pivots: list[tuple[int, int]] = []
    for _ in range(3):
        free = np.abs(matrix).copy()
        for row, column in pivots:
            free[row], free[:, column] = 0.0, 0.0
        row, column = divmod(int(free.argmax()), 3)
        if free[row, column] < 1e-9:
            break
        matrix[row] /= matrix[row, column]
        for other in range(len(matrix)):
            if other != row:
                matrix[other] -= matrix[other, column] * matrix[row]
        pivots.append((row, column))
    for row, column in sorted(pivots, key=lambda pivot: pivot[1]):
        factors = {i: -float(matrix[row, i]) for i in range(3) if i != column and abs(matrix[row, i]) > 1e-9}
        found.append((column, factors))
    return found
