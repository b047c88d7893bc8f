"""What a deck is written from: a case that another program can solve, and its mesh."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from geometries.mesh_arrays import MeshArrays, read_arrays
from geometries.openings import cavity_roles
from geometries.tetrahedra import Ints
from softmodels.case.case import Case, CaseError
from softmodels.case.decks.pressing import SHAPES, pressing
from softmodels.case.decks.silicone import Silicone, silicones_of
from softmodels.case.decks.springs import Springs
from softmodels.case.decks.supports import Supports, Tie, supports_of
from softmodels.case.decks.threads import threaded, threads
from softmodels.case.region import Region
from softmodels.mechanics.dead_loads import LoadPart
from softmodels.mechanics.fabric import Fabric
from softmodels.mechanics.fibres import Fibres
from softmodels.mechanics.holds import Clamp
from softmodels.mechanics.loads import FaceLoad, Mass
from softmodels.mechanics.nodal_forces import nodal_forces
from softmodels.mechanics.rigid import Rigid
from softmodels.mechanics.rigid_motion import Freedom
from softmodels.mechanics.rigid_shapes import RigidShape
from softmodels.mechanics.system import System
from softmodels.mechanics.walls.part import Walls
from softmodels.path.program import begins_at_rest

Array = npt.NDArray[np.float64]

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
        pressures: Of each cavity in Pa, step by step, shape (steps, cavities).
        supports: How its nodes may move.
        silicones: Its materials, the main one first.
        forces: Of all dead loads, on the slice, in N, shape (n, 3); None where there are none.
        springs: Its contact, fibres and fabrics.
    """

    case: Case
    mesh: MeshArrays
    pressures: Array
    supports: Supports
    silicones: tuple[Silicone, ...]
    forces: Array | None = None
    springs: tuple[Springs, ...] = ()

    @property
    def walls(self) -> list[str]:
        """Role of each cavity's walls."""
        return cavity_roles(self.case.actuator)

    @functools.cached_property
    def points(self) -> Array:
        """Places in m of all nodes: the mesh's, those of rigid parts, then those of springs."""
        return np.concatenate([self.mesh.points, self.supports.added, *(one.places for one in self.springs)])

    @property
    def grounds(self) -> Iterator[tuple[Springs, int]]:
        """Each part's springs, and the number of the first of their nodes."""
        number = len(self.mesh.points) + len(self.supports.added)
        for one in self.springs:
            yield one, number
            number += len(one.places)

    @functools.cached_property
    def tied(self) -> list[Tie]:
        """Displacements that depend on others."""
        return [*self.supports.tied, *(tie for tie in self._of_springs if tie.terms)]

    @functools.cached_property
    def held(self) -> dict[int, Ints]:
        """Held displacements: component (0 to 2) and nodes at which it vanishes, no node twice for a component."""
        found = {}
        for component in range(3):
            still = [tie.node for tie in self._of_springs if tie.component == component and not tie.terms]
            if nodes := [*self.supports.held.get(component, ()), *still]:
                found[component] = np.array(nodes, dtype=np.int64)
        return found

    @functools.cached_property
    def _of_springs(self) -> list[Tie]:
        """What moves the springs' nodes."""
        return [tie for one, first in self.grounds for tie in one.ties(first)]

    @property
    def watched(self) -> dict[str, int]:
        """Nodes by what they are: the device's probes, and what rigid parts follow."""
        found = {
            name: int(np.linalg.norm(self.mesh.points - place, axis=1).argmin())
            for name, place in self.case.actuator.probes.items()
        }
        for one in self.supports.rigged:
            found[f"centre of {one.name}"] = one.place
            if one.turn is not None:
                found[f"rotation vector of {one.name} in rad"] = one.turn
        return found

    @property
    def overlapping(self) -> str:
        """That walls of the device pass through each other in the deck, a sentence; empty where none meet."""
        if not any(isinstance(part, Walls) and not part.off for part in self.case.parts):
            return ""
        return "walls that meet press on each other in a run and pass through each other here: it has no such contact"

    @property
    def remarks(self) -> list[str]:
        """What a reader has to know of the deck, sentences."""
        case, names = self.case, ", ".join(self.mesh.faces)
        found = [
            f"{case.name}, {type(case.actuator).__name__}, one of {case.actuator.copies} equal slices",
            f"faces by role: {names}",
            "nodes: " + ", ".join(f"{number + 1} {name}" for name, number in self.watched.items()),
        ]
        if self.forces is not None:
            found.append(f"a first step applies {', '.join(acting(case))}, as forces on the nodes of this slice")
        found += [f"{one.label}, {one.what}, from node {ground + 1}" for one, ground in self.grounds]
        found += [self.overlapping] if self.overlapping else []
        return [*found, *(remark for silicone in self.silicones for remark in silicone.remarks)]


def deck_of(case: Case, mesh: Path, system: System | None = None) -> Deck:
    """What is written of a case.

    Args:
        case: One that `check` does not refuse.
        mesh: The mesh file of its device.
        system: The device's equations with displacements alone, on one rank; None where it needs none (`needs_equations`).

    Raises:
        CaseError: Cells, or loads, that cannot be written.
        MeshFileError: No mesh of tetrahedra.
    """
    arrays = read_arrays(mesh)
    if arrays.cells.shape[1] == 4:
        raise CaseError("the mesh has tetrahedra of 4 nodes, which lock in silicone; take cells of second order")
    forces, springs, freedoms = None, tuple[Springs, ...](), dict[str, Freedom]()
    if system is not None:
        forces = _by_node(arrays, *nodal_forces(system)) if acting(case) else None
        pressed = pressing(case.obstacle, system, arrays, case.parts)
        springs = (*pressed, *threads(arrays, case.parts, system.length_unit))
        freedoms = {
            name: dataclasses.replace(motion.freedom, centre=motion.freedom.centre * system.length_unit)
            for name, motion in system.unknowns.moving.items()
        }
    supports = supports_of(case, arrays, freedoms)
    _check_apart(supports, springs)
    silicones = silicones_of(case.material, case.parts, arrays.regions)
    return Deck(case, arrays, _pressures(case), supports, silicones, forces, springs)


def _pressures(case: Case) -> Array:
    """Requested pressures of each cavity in Pa, but those of the device at rest, shape (steps, cavities)."""
    if case.program:
        return case.cm * np.array([series.values for series in case.program]).T[begins_at_rest(case.program) :]
    return np.outer([goal for goal in case.goals if goal > 0.0], case.actuator.ratios)


def _check_apart(supports: Supports, springs: tuple[Springs, ...]) -> None:
    """Refuse springs of nodes that turn with a rigid part: CalculiX 2.20 loses a part of their motion in equations."""
    for part in supports.rigged:
        for one in springs:
            if part.turn is not None and not one.nodes.isdisjoint(part.nodes.tolist()):
                raise CaseError(
                    f"{one.label} acts on nodes of the rigid part {part.name}, which turns, and CalculiX gets that wrong: "
                    "guide the part (kind = 'guided'), or name other faces"
                )


def needs_equations(case: Case) -> bool:
    """Whether a deck says what the device's equations know: dead loads, what is held or rigid, or what presses."""
    kinds = (Clamp, Rigid, RigidShape, Fibres, Fabric)
    return bool(acting(case)) or case.obstacle is not None or any(isinstance(part, kinds) for part in case.parts)


def _by_node(mesh: MeshArrays, places: Array, forces: Array) -> Array:
    """Forces in the order of a mesh's nodes."""
    from scipy.spatial import cKDTree

    away, found = cKDTree(places).query(mesh.points)
    if away.max() > ALIKE * np.ptp(mesh.points, axis=0).max():
        raise CaseError("nodes of the mesh are none of the equations': the dead loads cannot be written")
    return forces[found]


def acting(case: Case) -> list[str]:
    """Dead loads by the names of their tables, without those whose amount would be a request's."""
    idle = [part for part in case.parts if isinstance(part, LoadPart) and part.idle(case.parts)]
    loads = [part for part in case.parts if isinstance(part, LOADS) and part not in idle]
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
    pressed = case.program and all(series.key == "pressure_cm" for series in case.program)
    if not (pressed or max(case.pressures_cm, default=0.0) > 0.0) or case.cycle:
        raise CaseError(
            f"the case asks for {case.load.requested.words}; a deck has pressures (pressure_cm), and no cycle"
        )
    main, *others = silicones_of(case.material, case.parts, device.regions)
    main.check("")
    for silicone in others:
        silicone.check(f"region {silicone.name}: ")
    for what in _unknown(case):
        raise CaseError(f"the case has {what}, which is not written into decks; leave it out")


def _unknown(case: Case) -> Iterator[str]:
    """What decks have no words for, by its name."""
    if case.sheet:
        yield "a sheet"
    for part in case.parts:
        if isinstance(part, RigidShape):
            if part.shape not in SHAPES:
                yield f"{part.where} with a shape {part.shape!r}, where springs know {', '.join(SHAPES)}"
            if part.friction:
                yield f"{part.where} with friction"
        elif isinstance(part, Fabric) and not threaded(part):
            yield f"{part.where} whose yarns contract each other or resist shear"
        elif isinstance(part, Walls) and (part.automatic or part.off):
            continue  # see `Deck.overlapping`
        elif not isinstance(part, (Region, Clamp, Rigid, Fibres, Fabric, *LOADS)):
            yield part.where
