"""What a deck is written from: a case that another program can solve, and its mesh."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import numpy.typing as npt

from geometries.mesh_arrays import MeshArrays, read_arrays
from geometries.tetrahedra import Ints
from softmodels.case.case import Case, CaseError

Array = npt.NDArray[np.float64]

WRITTEN = "written by softmodels"
"""The mark of a deck: a file that bears it may be written again."""


@dataclasses.dataclass(frozen=True, eq=False)
class Deck:
    """A case to be written.

    Attributes:
        case: The case.
        mesh: Its mesh, cells of second order.
        pressures: Requested pressures above zero in Pa, rising.
        held: Held displacements: component (0 to 2) and nodes at which it vanishes, no node twice for a component.
        tied: Displacements that depend on others at one node: node, the component, and the factors that the others have in it.
    """

    case: Case
    mesh: MeshArrays
    pressures: tuple[float, ...]
    held: dict[int, Ints]
    tied: tuple[tuple[int, int, dict[int, float]], ...]

    @property
    def invariant_terms(self) -> dict[tuple[int, int], float]:
        """The law's factors in Pa of (I1_bar - 3)^i (I2_bar - 3)^j."""
        return dict(self.case.material.invariant_terms)

    @property
    def bulk(self) -> float:
        """Bulk modulus in Pa."""
        material = self.case.material
        nu = material.poisson  # not `Material.bulk`, which is Lame's first constant where the shape part resists it too
        return 2 * material.shear_modulus_0 * (1 + nu) / (3 * (1 - 2 * nu))

    @property
    def remarks(self) -> list[str]:
        """What a reader has to know of the deck, sentences."""
        case, names = self.case, ", ".join(self.mesh.faces)
        found = [
            f"{case.name}, {type(case.actuator).__name__}, one of {case.actuator.copies} equal slices",
            f"silicone: {case.material}",
            f"energy: shape of the isochoric stretches + K/2 (J - 1)^2, K = {self.bulk:.6g} Pa",
            f"faces by role: {names}",
        ]
        if not case.material.isochoric:
            found.append(
                f"{case.material.name}: softmodels' energy is of the whole stretches, this one of the isochoric ones; they are "
                "the same as Poisson's ratio goes to 0.5"
            )
        return found


def deck_of(case: Case, mesh: Path) -> Deck:
    """What is written of a case.

    Args:
        case: The case.
        mesh: The mesh file of its device.

    Raises:
        CaseError: Other programs cannot be told of this case.
        MeshFileError: No mesh of tetrahedra.
    """
    _check(case)
    arrays = read_arrays(mesh)
    if arrays.cells.shape[1] == 4:
        raise CaseError("the mesh has tetrahedra of 4 nodes, which lock in silicone; take cells of second order")
    held, tied = _supports(case, arrays)
    return Deck(case, arrays, tuple(goal for goal in case.goals if goal > 0.0), held, tied)


def _check(case: Case) -> None:
    """Refuse what the decks have no words for.

    Raises:
        CaseError: What, and what to do.
    """
    device, material = case.actuator, case.material
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
    if not (material.invariant_terms or material.stretch_terms):
        raise CaseError(
            f"{material.name} is a law that neither CalculiX nor FEBio has; fit or name one of Mooney-Rivlin, Yeoh or Ogden"
        )
    if math.isinf(material.bulk):
        raise CaseError(
            "poisson = 0.5 is incompressible and the decks' cells have displacements alone; take poisson = 0.49 in both"
        )
    for what, there in (
        ("a sheet", case.sheet),
        ("contact", case.obstacle),
        (case.parts[0].where if case.parts else "", case.parts),
    ):
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
