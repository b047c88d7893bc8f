"""A deck: a case that CalculiX can solve, and its mesh, in its words."""

from __future__ import annotations

import dataclasses
import functools
import io
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TextIO

import numpy as np
import numpy.typing as npt

from geometries import actuator, mesh_arrays
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.materials import Region
from softmodels.common.arrays import Array
from softmodels.common.lazy import scipy
from softmodels.components.contact import Walls
from softmodels.components.loads import FaceLoad, Mass
from softmodels.components.rigid import Clamp, Rigid
from softmodels.materials.laws import Material
from softmodels.mechanics import body, controls, regions
from softmodels.mechanics.component import names_in
from softmodels.mechanics.system import System, nodal_forces
from softmodels.path import steps


@dataclasses.dataclass(frozen=True, eq=False)
class Deck:
    """A case to be written, with its mesh of second-order cells.

    Attributes:
        pressures: Of each cavity in Pa, step by step, shape (steps, cavities).
        silicones: Its materials, the main one first.
        forces: Of all dead loads, on the slice, in N, shape (n, 3); None where there are none.
    """

    case: Case
    mesh: mesh_arrays.MeshArrays
    pressures: Array
    supports: Supports
    silicones: tuple[DeckSilicone, ...]
    forces: Array | None = None

    @property
    def walls(self) -> list[str]:
        """Role of each cavity's walls."""
        return actuator.cavity_roles(self.case.actuator)

    @functools.cached_property
    def points(self) -> Array:
        """Places in m of all nodes: the mesh's, then those of rigid parts."""
        return np.concatenate([self.mesh.points, self.supports.added])

    @property
    def watched(self) -> dict[str, int]:
        """Output nodes by label: the device's probes, and the reference nodes of rigid parts."""
        nodes = {
            name: int(np.linalg.norm(self.mesh.points - place, axis=1).argmin())
            for name, place in self.case.actuator.probes.items()
        }
        for part in self.supports.rigged:
            nodes[f"centre of {part.name}"] = part.place
            if part.turn is not None:
                nodes[f"rotation vector of {part.name} in rad"] = part.turn
        return nodes

    @property
    def overlapping(self) -> str:
        """A sentence that walls overlap in the deck; empty if none meet."""
        if not any(isinstance(part, Walls) and not part.off for part in self.case.components):
            return ""
        return "self-contact of walls is not exported: walls that touch in a run overlap here"

    @property
    def remarks(self) -> list[str]:
        """Remarks on the deck, as sentences."""
        case, names = self.case, ", ".join(self.mesh.faces)
        sentences = [
            f"{case.name}, {type(case.actuator).__name__}, one of {case.actuator.copies} equal slices",
            f"faces by role: {names}",
            "nodes: " + ", ".join(f"{number + 1} {name}" for name, number in self.watched.items()),
        ]
        if self.forces is not None:
            sentences.append(f"a first step applies {', '.join(acting(case))}, as forces on the nodes of this slice")
        sentences += [self.overlapping] if self.overlapping else []
        return [*sentences, *(remark for silicone in self.silicones for remark in silicone.remarks)]


WRITTEN_BY = "written by softmodels"
"""Mark of a deck: files with it may be overwritten."""
LOADS = (controls.LoadPart, Mass)
"""Kinds of parts written as nodal forces."""
NODE_TOLERANCE = 1e-6
"""Distance relative to the device's size below which two places are the same node."""


def deck_of(case: Case, mesh: Path, system: System | None = None) -> Deck:
    """Return the deck of a case that passes `check`; its equations, with displacements only and on one rank, if
    `needs_equations`. `CaseError` for cells or loads that cannot be written, `MeshFileError` for no mesh of tetrahedra."""
    arrays = mesh_arrays.read_arrays(mesh)
    if arrays.cells.shape[1] == 4:
        raise CaseError("the mesh has 4-node tetrahedra, which lock for silicone; use second-order cells")
    forces, freedoms = None, dict[str, regions.Freedom]()
    if system is not None:
        forces = _by_node(arrays, *nodal_forces(system)) if acting(case) else None
        freedoms = {
            name: dataclasses.replace(motion.freedom, centre=motion.freedom.centre * system.length_unit)
            for name, motion in system.unknowns.moving.items()
        }
    supports = supports_of(case, arrays, freedoms)
    # Other programs want each cell once: a region with a law of its own keeps all of its cells.
    own = [(part, arrays.regions[part.name]) for part in case.components if isinstance(part, Region)]
    for (part, first), (other, second) in itertools.combinations(own, 2):
        if common := len(np.intersect1d(first, second)):
            raise regions.shared_cells(part, other, common, len(first), len(second))
    arrays = arrays.parted([part.name for part, _ in own])
    silicones = silicones_of(case.material, case.components, arrays.regions)
    return Deck(case, arrays, _pressures(case), supports, silicones, forces)


def _pressures(case: Case) -> Array:
    """Return the requested pressures of each cavity in Pa, without those of the device at rest, shape (steps, cavities)."""
    if case.program:
        return np.array([course.values for course in steps.courses(case.steps)]).T[steps.begins_at_rest(case.steps) :]
    return np.outer([value for value in case.values if value], case.actuator.ratios)


def needs_equations(case: Case) -> bool:
    """Return whether a deck needs the device's equations: dead loads, supports or rigid parts."""
    return bool(acting(case)) or any(isinstance(part, Clamp | Rigid) for part in case.components)


def _by_node(mesh: mesh_arrays.MeshArrays, places: Array, forces: Array) -> Array:
    away, nodes = scipy.spatial.cKDTree(places).query(mesh.points)
    if away.max() > NODE_TOLERANCE * np.ptp(mesh.points, axis=0).max():
        raise CaseError("the mesh and the equations have different nodes: the dead loads cannot be written")
    return forces[nodes]


def acting(case: Case) -> list[str]:
    """Return the dead loads by the names of their tables, without those of requested amount."""
    idle = [part for part in case.components if isinstance(part, controls.LoadPart) and part.idle(case.components)]
    loads = [part for part in case.components if isinstance(part, LOADS) and part not in idle]
    return [load.where for load in loads if not isinstance(load, FaceLoad) or load.kept]


def check(case: Case) -> None:
    """Raise `CaseError` for what decks cannot express, with what to do."""
    device = case.actuator
    if device.dimension != 3:
        raise CaseError(
            f'the case has an axisymmetric section of {type(device).__name__}; decks need a solid one (section = "wedge")'
        )
    for hold in regions.held_with(device.holds, device, case.components):
        if hold.together:
            raise CaseError(
                f"the face {hold.role!r} stays plane and travels (together), which decks do not support; "
                + (
                    f"model a whole device in place of a {type(device).__name__}, such as a ChannelPlate"
                    if hold in device.holds
                    else "hold it in place, or leave it free"
                )
            )
    unpressed = case.timed or any(quantity.quantity != steps.PRESSURE for step in case.steps for quantity in step.prescribed)
    if unpressed or case.load_unload:
        raise CaseError(
            f"the case asks for {case.load.requested.words}; a deck takes pressures (pressure = '0:5 kPa'), and no unloading"
        )
    main, *others = silicones_of(case.material, case.components, device.regions)
    main.check("")
    for silicone in others:
        silicone.check(f"region {silicone.name}: ")
    for what in _unsupported_parts(case):
        raise CaseError(
            f"the case has {what}, which decks do not support; leave it out (decks carry silicones, regions, supports, "
            "clamps, rigid parts, dead loads and pressures)"
        )


def _unsupported_parts(case: Case) -> Iterator[str]:
    """Yield the names of unsupported parts."""
    for part in case.components:
        named = [name for field in ("face", "faces", "on") for name in names_in(getattr(part, field, ""))]
        if not isinstance(part, LOADS) and not all(map(body.is_plain, named)):
            yield f"{part.where} on a piece of a face"
        if isinstance(part, Region) and part.within:
            yield f"{part.where} with cells chosen by within"
        if isinstance(part, Walls) and (part.automatic or part.off):
            continue  # see `Deck.overlapping`
        if not isinstance(part, (Region, Clamp, Rigid, *LOADS)):
            yield part.where


# ----------------------------------------------------------------------------------------------------------------------
# Materials of a deck and their regions.


MAIN = "silicone"
"""Name of the case's own material, if no region has it."""


@dataclasses.dataclass(frozen=True)
class DeckSilicone:
    """A material by the deck's name for it, and the regions of the mesh that it fills."""

    name: str
    material: Material
    regions: tuple[str, ...]

    @property
    def invariant_terms(self) -> dict[tuple[int, int], float]:
        """The law's factors in Pa of (I1_bar - 3)^i (I2_bar - 3)^j."""
        return dict(self.material.invariant_terms)

    @property
    def bulk(self) -> float:
        """Bulk modulus in Pa."""
        # Not `Material.bulk`, which is Lame's first constant if the shape part resists volume changes too.
        nu = self.material.poisson
        return 2 * self.material.shear_modulus_0 * (1 + nu) / (3 * (1 - 2 * nu))

    @property
    def remarks(self) -> list[str]:
        """Remarks on the material, as sentences."""
        remarks = [
            f"{self.name}: {self.material}",
            f"{self.name}: energy of the isochoric stretches' shape + K/2 (J - 1)^2, K = {self.bulk:.6g} Pa",
        ]
        if not self.material.isochoric:
            remarks.append(
                f"{self.material.name}: softmodels' energy uses the full stretches, this one the isochoric ones; "
                "they agree as Poisson's ratio approaches 0.5"
            )
        if self.material.memory is not None:
            remarks.append(
                f"{self.name}: the deck leaves out its memory, a model that CalculiX does not have: it is the silicone "
                "after a long time, relaxed and never softened"
            )
        return remarks

    def check(self, where: str) -> None:
        """Raise `CaseError`, which begins with ``where``, for a law that no deck supports."""
        material = self.material
        if not (material.invariant_terms or material.stretch_terms):
            raise CaseError(
                f"{where}{material.name} is a law that CalculiX does not have; use Mooney-Rivlin, Yeoh, Ogden or the polynomial"
            )
        if math.isinf(material.bulk):
            raise CaseError(
                f"{where}poisson = 0.5 is incompressible, but the decks' cells have displacements only; use "
                "poisson = 0.49 in both"
            )


def silicones_of(material: Material, components: Iterable[object], regions: Iterable[str]) -> tuple[DeckSilicone, ...]:
    """Return the materials of a device with its parts and regions; the first, its main one, fills all cells without a
    region."""
    others = [DeckSilicone(part.name, part.material, (part.name,)) for part in components if isinstance(part, Region)]
    named = {other.name for other in others}
    main = f"main_{MAIN}" if MAIN in named else MAIN
    return (DeckSilicone(main, material, tuple(name for name in regions if name not in named)), *others)


# ----------------------------------------------------------------------------------------------------------------------
# Constraints of a deck's nodes: held, tied to others, or moving with a rigid part.
#
# A rigid part's nodes are constrained by the part only, whatever else they lie on: its motions are those that cut planes and
# supports leave it (`softmodels.mechanics.regions`), and other programs reject a dof with two constraints. A part that does not
# rotate becomes linear equations between its nodes; a rotating one has two extra nodes, for position and rotation.


Terms = dict[tuple[int, int], float]


@dataclasses.dataclass(frozen=True)
class Tie:
    """A displacement, by its node and component, that is a linear combination of others: factors by their nodes and
    components."""

    node: int
    component: int
    terms: Terms


@dataclasses.dataclass(frozen=True)
class MovingRigidPart:
    """A rigid part of a deck that moves, and the mesh's nodes that follow it. The displacement of the node ``place`` is that
    of its centre, or of all its nodes where it does not turn; of ``turn``, if there is one, its rotation vector in rad."""

    name: str
    nodes: mesh_arrays.Ints
    place: int
    turn: int | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Supports:
    """Supports of a deck's nodes: held displacements (component and nodes, no node twice for a component), displacements that
    depend on others, rigid parts that move, and the places in m of nodes added behind the mesh's, shape (k, 3)."""

    held: dict[int, mesh_arrays.Ints]
    tied: tuple[Tie, ...]
    rigged: tuple[MovingRigidPart, ...]
    added: Array


def supports_of(case: Case, mesh: mesh_arrays.MeshArrays, freedoms: Mapping[str, regions.Freedom]) -> Supports:
    """Return the supports of a case's mesh; ``freedoms`` are the motions left to each rigid part by its label, its centre in
    m."""
    rows, ties = _held_directions(case, mesh), list[Tie]()
    rigged, added = [], np.empty((0, 3))
    for part in case.components:
        if not isinstance(part, Rigid):
            continue
        nodes = mesh.nodes[part.face] if part.face else _region_nodes(mesh, part.region)
        freedom = freedoms[part.label]
        rows[nodes] = 0.0
        if not freedom.count:
            rows[nodes, :3] = np.eye(3)
        elif len(freedom.axes):
            place = len(mesh.points) + len(added)
            added = np.vstack([added, freedom.centre, freedom.centre])
            rigged.append(MovingRigidPart(part.label, nodes, place, place + 1))
            ties += [*_tangent_ties(place, freedom.directions), *_tangent_ties(place + 1, freedom.axes)]
        else:
            place = int(nodes[np.linalg.norm(mesh.points[nodes] - freedom.centre, axis=1).argmin()])
            rigged.append(MovingRigidPart(part.label, nodes, place))
            ties += _as_one(nodes, place, freedom.directions)
    ties += [tie for node in np.flatnonzero(np.abs(rows).any(axis=(1, 2))) for tie in _solved_at(int(node), rows[node])]
    held = {c: np.array([tie.node for tie in ties if tie.component == c and not tie.terms]) for c in range(3)}
    return Supports(
        {component: nodes for component, nodes in held.items() if len(nodes)},
        tuple(tie for tie in ties if tie.terms),
        tuple(rigged),
        added,
    )


def _region_nodes(mesh: mesh_arrays.MeshArrays, region: str) -> mesh_arrays.Ints:
    return np.unique(mesh.cells[mesh.regions[region]])


def _held_directions(case: Case, mesh: mesh_arrays.MeshArrays) -> Array:
    """Return the directions that cut planes, the device's own supports and clamps hold at each node, shape (n, k, 3), k at
    least 3."""
    device, rows = case.actuator, np.zeros((len(mesh.points), 3, 3))
    for role, direction in [
        *((plane.name, plane.normal) for plane in device.cut_planes),
        *((hold.role, hold.direction) for hold in regions.held_with(device.holds, device, case.components)),
    ]:
        added = np.zeros((len(mesh.points), 3, 3))
        nodes = mesh.nodes[role] if role in mesh.nodes else _region_nodes(mesh, role)
        added[nodes] = np.eye(3) if direction is None else [direction, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]
        rows = np.concatenate([rows, added], axis=1)
    return rows


def _tangent_ties(node: int, ways: Array) -> list[Tie]:
    """Return the ties that leave a node only displacements along orthonormal directions, shape (k, 3); one without terms
    vanishes."""
    return _solved_at(node, np.eye(3) - ways.T @ ways)


def _as_one(nodes: mesh_arrays.Ints, place: int, ways: Array) -> Iterator[Tie]:
    """Yield the ties that make nodes move together, only along orthonormal directions, shape (k, 3)."""
    terms_by_component = {tie.component: tie.terms for tie in _tangent_ties(place, ways)}
    terms = [terms_by_component.get(i, {(place, i): 1.0}) for i in range(3)]
    for node in nodes:
        own = terms_by_component if node == place else range(3)
        yield from (Tie(int(node), i, terms[i]) for i in own)


def _solved_at(node: int, rows: Array) -> list[Tie]:
    return [Tie(node, component, {(node, i): factor for i, factor in factors.items()}) for component, factors in solved(rows)]


def solved(rows: Array) -> list[tuple[int, dict[int, float]]]:
    """Return, by row echelon form, the components that vanish or depend on others if some directions are held, shape (k, 3):
    each with the factors of those that it is the sum of; none for one that vanishes."""
    matrix, solved_ties = rows.copy(), []
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
        solved_ties.append((column, factors))
    return solved_ties


# ----------------------------------------------------------------------------------------------------------------------
# Write a deck for CalculiX, which Abaqus also reads except for solver keywords. Lengths in mm, pressures in Pa, forces in uN.
#
# In metres the nodal forces are so small that CalculiX treats a residual as zero. C3D10 has displacements only: compare with
# ``formulation = "displacement"``.


NO_TERM = 1e10
"""D of a volumetric term without effect: for 0 CalculiX uses its own default."""
TIME_CONTROLS = "*CONTROLS, PARAMETERS=TIME INCREMENTATION\n30, 40, 9, 60, 10, 4, , 10\n"
FIELD_CONTROLS = "*CONTROLS, PARAMETERS=FIELD\n1e-5, 1e-3, , , 1e-5, 1e-5, 1e-8, 1e-8\n"
"""Tolerances of residual and correction, instead of the default 0.5 % and 1 %."""

ZERO_FORCE_TOLERANCE = 1e-12
"""Fraction of the largest nodal force below which a force is rounding error."""


def calculix(deck: Deck) -> str:
    """Return the deck's text: a step for the dead loads, if there are any, and one for each requested pressure."""
    out = io.StringIO()
    for text in (WRITTEN_BY, *deck.remarks):
        out.write(f"** {text}\n")
    _write_mesh(deck, out)
    for tie in deck.supports.tied:
        terms = [(tie.node, tie.component, -1.0), *((*at, factor) for at, factor in tie.terms.items())]
        entries = [f"{node + 1}, {i + 1}, {factor:.12e}" for node, i, factor in terms]
        lines = [", ".join(entries[at : at + 4]) for at in range(0, len(entries), 4)]
        out.write(f"*EQUATION\n{len(terms)}\n" + "\n".join(lines) + "\n")
    for part in deck.supports.rigged:
        if part.turn is not None:
            name = f"RIGID_{part.name}".upper()
            out.write(_cards(f"*NSET, NSET={name}", part.nodes))
            out.write(f"*RIGID BODY, NSET={name}, REF NODE={part.place + 1}, ROT NODE={part.turn + 1}\n")
    for component, nodes in deck.supports.held.items():
        out.write(_cards(f"*NSET, NSET=HELD{component + 1}", nodes))
    out.write("*BOUNDARY\n")
    for component in deck.supports.held:
        out.write(f"HELD{component + 1}, {component + 1}, {component + 1}\n")
    for silicone in deck.silicones:
        out.write(f"*MATERIAL, NAME={silicone.name.upper()}\n{_calculix_law(silicone)}")
        sets = ["SOLID"] if len(deck.silicones) == 1 else [region.upper() for region in silicone.regions]
        out.writelines(f"*SOLID SECTION, ELSET={name}, MATERIAL={silicone.name.upper()}\n" for name in sets)
    if deck.forces is not None:
        _write_step(out, "*CLOAD\n" + _forces(deck.forces))
    for pressures in deck.pressures:
        loads = [f"{role.upper()}, P, {p:.12e}\n" for role, p in zip(deck.walls, pressures, strict=True)]
        _write_step(out, "*DSLOAD\n" + "".join(loads))
    return out.getvalue()


def _write_step(out: TextIO, load: str) -> None:
    """Write a step that applies a load; loads of earlier steps stay."""
    out.write("*STEP, NLGEOM, INC=400\n*STATIC\n0.1, 1., 1e-4, 0.2\n" + TIME_CONTROLS + FIELD_CONTROLS)
    out.write(f"{load}*NODE FILE\nU\n")
    out.write("*NODE PRINT, NSET=PROBES, FREQUENCY=10000\nU\n*END STEP\n")


def _forces(forces: npt.NDArray[np.float64]) -> str:
    """Return the lines with the forces on nodes, from N."""
    lines = []
    for node, component in np.argwhere(np.abs(forces) > ZERO_FORCE_TOLERANCE * np.abs(forces).max()):
        lines.append(f"{node + 1}, {component + 1}, {1e6 * forces[node, component]:.12e}\n")
    return "".join(lines)


def _write_mesh(deck: Deck, out: TextIO) -> None:
    mesh = deck.mesh
    out.write("*NODE, NSET=ALL\n")
    for number, (x, y, z) in enumerate(1e3 * deck.points, 1):
        out.write(f"{number}, {x:.12e}, {y:.12e}, {z:.12e}\n")
    for name, cells in mesh.regions.items():
        out.write(f"*ELEMENT, TYPE=C3D10, ELSET={name.upper()}\n")
        for cell in cells:
            out.write(f"{cell + 1}, " + ", ".join(str(node + 1) for node in mesh.cells[cell]) + "\n")
    if list(mesh.regions) != ["solid"]:
        others = [name.upper() for name in mesh.regions if name != "solid"]
        out.write("*ELSET, ELSET=SOLID\n" + "\n".join(others) + "\n")
    for role, faces in mesh.faces.items():
        out.write(f"*SURFACE, NAME={role.upper()}, TYPE=ELEMENT\n")
        out.writelines(f"{cell + 1}, S{side + 1}\n" for cell, side in faces)
    for role, nodes in mesh.nodes.items():
        out.write(_cards(f"*NSET, NSET=ON_{role.upper()}", nodes))
    out.write(_cards("*NSET, NSET=PROBES", deck.watched.values()))


def _calculix_law(silicone: DeckSilicone) -> str:
    """Return CalculiX's material cards of the silicone, with volumetric energy (1/D) (J - 1)^2."""
    terms, d1 = silicone.invariant_terms, 2 / silicone.bulk
    if stretches := silicone.material.stretch_terms:
        factors = [value for mu, alpha in stretches for value in (mu * alpha / 2, alpha)]
        values = [*factors, d1, *([NO_TERM] * (len(stretches) - 1))]
        return f"*HYPERELASTIC, OGDEN, N={len(stretches)}\n" + _lines(values)
    if set(terms) <= {(1, 0), (0, 1)}:
        return "*HYPERELASTIC, MOONEY-RIVLIN\n" + _lines([terms.get((1, 0), 0.0), terms.get((0, 1), 0.0), d1])
    if set(terms) <= {(1, 0), (2, 0), (3, 0)}:
        return "*HYPERELASTIC, YEOH\n" + _lines([*(terms.get((i, 0), 0.0) for i in (1, 2, 3)), d1, NO_TERM, NO_TERM])
    second = [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]
    if set(terms) <= set(second):
        return "*HYPERELASTIC, POLYNOMIAL, N=2\n" + _lines([*(terms.get(powers, 0.0) for powers in second), d1, NO_TERM])
    raise CaseError(f"{silicone.material.name} has terms without a CalculiX law; use Mooney-Rivlin, Yeoh or Ogden")


def _lines(values: list[float]) -> str:
    """At most eight numbers in a line."""
    return "".join(", ".join(f"{value:.12e}" for value in values[at : at + 8]) + "\n" for at in range(0, len(values), 8))


def _cards(keyword: str, nodes: Iterable[int]) -> str:
    """Return a set of nodes that count from 0; a line may hold at most 16."""
    values = [str(int(node) + 1) for node in nodes]
    return f"{keyword}\n" + "".join(", ".join(values[at : at + 12]) + "\n" for at in range(0, len(values), 12))
