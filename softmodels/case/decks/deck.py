"""What a deck is written from: a case that another program can solve, and its mesh."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import numpy.typing as npt

from geometries.mesh_arrays import MeshArrays, read_arrays
from geometries.tetrahedra import Ints
from softmodels.case.case import Case, CaseError
from softmodels.case.decks.silicone import Silicone, silicones_of
from softmodels.case.region import Region
from softmodels.mechanics.dead_loads import LoadPart
from softmodels.mechanics.loads import FaceLoad, Mass

Array = npt.NDArray[np.float64]
Forces = tuple[Array, Array]

WRITTEN = "written by softmodels"
"""The mark of a deck: a file that bears it may be written again."""
LOADS = (LoadPart, Mass)
"""Kinds of parts that are written as forces on nodes."""
ALIKE = 1e-6
"""Distance in sizes of the device below which two places are one node."""


@dataclasses.dataclass(frozen=True, eq=False)
class Deck:
    """A case to be written.

    Attributes:
        case: The case.
        mesh: Its mesh, cells of second order.
        pressures: Requested pressures above zero in Pa, rising.
        held: Held displacements: component (0 to 2) and nodes at which it vanishes, no node twice for a component.
        tied: Displacements that depend on others at one node: node, the component, and the factors that the others have in it.
        silicones: Its materials, the main one first.
        forces: Of all dead loads, on the slice, in N, shape (n, 3); None where there are none.
    """

    case: Case
    mesh: MeshArrays
    pressures: tuple[float, ...]
    held: dict[int, Ints]
    tied: tuple[tuple[int, int, dict[int, float]], ...]
    silicones: tuple[Silicone, ...]
    forces: Array | None = None

    @property
    def remarks(self) -> list[str]:
        """What a reader has to know of the deck, sentences."""
        case, names = self.case, ", ".join(self.mesh.faces)
        found = [
            f"{case.name}, {type(case.actuator).__name__}, one of {case.actuator.copies} equal slices",
            f"faces by role: {names}",
        ]
        if self.forces is not None:
            found.append(f"a first step applies {', '.join(acting(case))}, as forces on the nodes of this slice")
        return [*found, *(remark for silicone in self.silicones for remark in silicone.remarks)]


def deck_of(case: Case, mesh: Path, forces: Forces | None = None) -> Deck:
    """What is written of a case.

    Args:
        case: One that `check` does not refuse.
        mesh: The mesh file of its device.
        forces: Nodes' undeformed places in m and forces on them in N, shape (n, 3) each, of its dead loads.

    Raises:
        CaseError: Cells, or loads, that cannot be written.
        MeshFileError: No mesh of tetrahedra.
    """
    arrays = read_arrays(mesh)
    if arrays.cells.shape[1] == 4:
        raise CaseError("the mesh has tetrahedra of 4 nodes, which lock in silicone; take cells of second order")
    held, tied = _supports(case, arrays)
    silicones = silicones_of(case.material, case.parts, arrays.regions)
    goals = tuple(goal for goal in case.goals if goal > 0.0)
    own = None if forces is None else _by_node(arrays, *forces)
    return Deck(case, arrays, goals, held, tied, silicones, own)


def _by_node(mesh: MeshArrays, places: Array, forces: Array) -> Array:
    """Forces in the order of a mesh's nodes."""
    from scipy.spatial import cKDTree

    away, found = cKDTree(places).query(mesh.points)
    if away.max() > ALIKE * np.ptp(mesh.points, axis=0).max():
        raise CaseError("nodes of the mesh are none of the equations': the dead loads cannot be written")
    return forces[found]


def acting(case: Case) -> list[str]:
    """Dead loads by the names of their tables, without those whose amount would be a request's."""
    loads = [part for part in case.parts if isinstance(part, LOADS)]
    return [load.where for load in loads if not isinstance(load, FaceLoad) or load.kept]


def check(case: Case) -> None:
    """Refuse what the decks have no words for.

    Raises:
        CaseError: What, and what to do.
    """
    device = case.actuator
    if device.dimension != 3:
        raise CaseError(
            f'the case has an axisymmetric section of {type(device).__name__}; write a deck of a solid one (section = "wedge")'
        )
    if not case.pressures_cm or max(case.pressures_cm) == 0.0 or case.cycle:
        raise CaseError(
            f"the case asks for {case.load.requested.words}; a deck has pressures (pressure_cm), and no cycle"
        )
    if device.ratios != (1.0,):
        raise CaseError("the device has several cavities; a deck has one pressure, so give a device with one cavity")
    main, *others = silicones_of(case.material, case.parts, device.regions)
    main.check("")
    for silicone in others:
        silicone.check(f"region {silicone.name}: ")
    unknown = [part.where for part in case.parts if not isinstance(part, (Region, *LOADS))]
    for what, there in (("a sheet", case.sheet), ("contact", case.obstacle), *((where, True) for where in unknown)):
        if there:
            raise CaseError(f"the case has {what}, which is not written into decks; leave it out")


def _supports(case: Case, mesh: MeshArrays) -> tuple[dict[int, Ints], tuple[tuple[int, int, dict[int, float]], ...]]:
    """Held and tied displacements: at each node the directions that its roles hold, solved for as few components."""
    device, rows = case.actuator, np.zeros((len(mesh.points), 0, 3))
    for role, direction in [
        *((plane.name, plane.normal) for plane in device.cut_planes),
        *((hold.role, hold.direction) for hold in device.holds),
    ]:
        added = np.zeros((len(mesh.points), 3, 3))
        added[mesh.nodes[role]] = np.eye(3) if direction is None else [direction, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]
        rows = np.concatenate([rows, added], axis=1)
    held: dict[int, list[int]] = {0: [], 1: [], 2: []}
    tied = []
    for node in np.flatnonzero(np.abs(rows).any(axis=(1, 2))):
        for component, factors in _solved(rows[node]):
            if factors:
                tied.append((int(node), component, factors))
            else:
                held[component].append(int(node))
    return {component: np.array(nodes, dtype=np.int64) for component, nodes in held.items() if nodes}, tuple(tied)


def _solved(rows: Array) -> list[tuple[int, dict[int, float]]]:
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
