"""The discrete equations of a pressurised body: assembled forms of its potential, and functions of a state.

Inside, lengths are in sizes of the device and stresses in shear moduli.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from geometries import actuator, meshing
from softmodels.common.arrays import Array
from softmodels.common.lazy import MPI, PETSc, basix, fem, la, meshes, ufl
from softmodels.materials import laws
from softmodels.materials.laws import Material
from softmodels.mechanics import assembly, compiling, controls, mpi, regions
from softmodels.mechanics.body import QUADRATURE_DEGREE, Body, BodyError, cell_measure, in_section
from softmodels.mechanics.compiling import begin
from softmodels.mechanics.component import Component, ComponentError
from softmodels.mechanics.potential import Potential
from softmodels.mechanics.tangent import TangentOperator, known_cells


class System:
    """The discrete equations of a body.

    Vectors of all dofs are entries by w. Those of the unknowns are what Newton's method has: zero at held dofs, and with rigid
    parts by the parts' own unknowns instead of the dofs that follow them.

    Args:
        body: Mesh and roles.
        material: Law and parameters; regions among ``components`` have their own.
        formulation: ``"mixed"`` (P2 displacement, P1 pressure) or ``"displacement"`` (P2).
        components: What else is added to it; see `softmodels.mechanics.component`.
        creeping: Whether silicone with a memory creeps and softens; else it is what it is after a long time.

    Attributes:
        potential: What all of it is derived from.
        w: The current state's unknowns; P and ``pressures`` go with it.
        K: Matrix with the pattern of the tangent.
        n: Number of owned dofs; ``dofs`` counts ghosts too.
        still_pressures: Number of p that are held, in regions that are rigid or held.
        unknowns: What Newton's method solves for instead of w: vectors of K's size are of these.
        direction: 1, or -1 if a path with proportional pressures goes to vacuum: P and V, which rise along it, are then
            minus the pressure and minus the volume.
        coupling: How the drivers are coupled: the cavities' pressures and volumes, then the dead loads and what they move.
        dead: The dead loads.
        volume_error: Of the cavity's volume by its mesh, against the closed form; nan where there is none.

    Raises:
        BodyError: A cavity whose wall encloses another volume than the device's.
        GeometryError: A cavity that is open.
        MaterialError: An incompressible material in the displacement formulation.
        ComponentError: A part that cannot be on this mesh.
    """

    potential_class: type[Potential] = Potential  # a user's potential may have further terms

    def __init__(
        self,
        body: Body,
        material: Material,
        formulation: str = "mixed",
        components: Sequence[Component] = (),
        creeping: bool = False,
    ):
        if formulation not in FORMULATIONS:
            raise ValueError(f"formulation {formulation!r} is not one of {', '.join(FORMULATIONS)}")
        if not creeping:
            material, components = regions.relaxed(material, components)
        regions.check_compressible(material, components, formulation == "mixed")
        self.body, self.formulation, self.comm = regions.clamped(body, components), formulation, body.mesh.comm
        self.components, self.ratios = tuple(components), tuple(body.actuator.ratios)
        if type(body).volume_integrand is Body.volume_integrand:  # a user's volume integral may close them differently
            closing = [actuator.Hold(role, seal.normal) for seal in regions.seals(components) for role in seal.roles]
            actuator.check_closed(body.actuator, body.openings, [*self.body.holds, *closing])
        self.mixed = formulation == "mixed"
        self.potential = self.potential_class(self.body, material, self.mixed, components)
        self.space, self.w = self.potential.space, self.potential.w
        self.set_material(material)
        self.form = functools.partial(fem.form, jit_options=compiling.JIT)
        self._compile()
        still = still_pressures(self.body, self.space, components)
        self.still_pressures = round(mpi.total(self.comm, sum(bc.dof_indices()[1] for bc in still)))
        self.bcs = [*regions.conditions(self.body, self.vectors), *still]
        self.assembled = assembly.AssembledTerms(self.potential.terms.values(), self.bcs)
        self._whole: PETSc.Mat = assembly.matrix_of(self.space, self._products.matrices[: len(self.matter)])
        self.unknowns = unknowns_of(self.body, self.space, self.bcs, components)
        self.K: PETSc.Mat = self.unknowns.matrix(self._whole, self._assemble_whole)
        self._vector = fem.Function(self.space)
        self.cells = np.arange(body.mesh.topology.index_map(body.mesh.topology.dim).size_local, dtype=np.int32)
        self.n, self.dofs = self.K.getLocalSize()[0], len(self.w.x.array)
        self.dead = controls.DeadLoads(self, components)
        self._loads += self.dead.forms
        self.direction = 1
        self.coupling = self.inflating(np.zeros(len(self.dead.forms)))
        self._set_pressures(0.0, np.empty(0))
        self.dead.check()
        self._check_volume()

    def _compile(self) -> None:
        """Compile the forms. Every term of the potential has its own, added up when assembled: bodies share the law's."""
        potential, form = self.potential, self.form
        tangent = potential.tangent(ufl.TrialFunction(self.space))
        first = [*tangent, *potential.internal, *potential.loads, *potential.volumes, *potential.free_energies]
        if known_cells(self.space):
            begin(self.comm, "moduli")
        compiling.compile_ahead(self.comm, first)
        self._volumes = [form(own) for own in potential.volumes]
        self._loads = [[form(load)] for load in potential.loads]
        for term in potential.terms.values():
            term.compile(self)
        self._stored = [form(energy) for energy in potential.free_energies]
        self._internal = [form(force) for force in potential.internal]
        loads = [load for (load,) in self._loads]
        self._products: TangentOperator = TangentOperator(potential, self._internal, loads, tangent, form)
        self.points, self._weights = basix.make_quadrature(self.body.mesh.basix_cell(), QUADRATURE_DEGREE)
        strain = laws.Strain(self.body.deformation_gradient(potential.displacement))
        self._J = fem.Expression(strain.J, self.points, jit_options=compiling.JIT)
        self._densities: fem.Expression | None = None

    def _check_volume(self) -> None:
        """Reject a cavity whose openings are not in planes through the origin, because its volume would be wrong."""
        enclosed, known = self.rest().V * self.volume_unit, self.body.actuator.cavity_volume
        self.volume_error = enclosed / known - 1 if self._volumes else 0.0
        if abs(self.volume_error) > VOLUME_TOLERANCE:
            raise BodyError(
                f"the cavity's wall encloses {enclosed * 1e6:.4g} ml instead of {known * 1e6:.4g} ml: include "
                f"every face around the air in its walls, let planes that cut the cavity pass through the "
                f"origin, or use smaller cells if the mesh is coarse (--cell-size)"
            )

    @property
    def mesh_notes(self) -> list[str]:
        """Warnings about the mesh, which belong to every result that is computed on it."""
        notes = [*self.body.actuator.remarks]
        if self.body.straight:
            notes.append(meshing.straight_text(self.body.straight))
        if abs(error := self.volume_error) > VOLUME_WARNING:
            kind, amount = "less" if error < 0.0 else "more", f"{abs(error):.1%}"
            notes.append(
                f"the cavity of the mesh has {amount} {kind} volume than the device's: use smaller cells, or check that "
                "all faces around the air are among its walls"
            )
        return notes

    @property
    def matter(self) -> Sequence[regions.MaterialRegion]:
        """Its materials and where they are."""
        return self.potential.regions

    @property
    def vectors(self) -> fem.FunctionSpace:
        """The displacement's part of the function space."""
        return self.space.sub(0) if self.mixed else self.space

    def set_material(self, material: Material) -> None:
        """Set other parameters of the same law, without recompiling."""
        self.potential.set_material(material)
        self.material = material

    def take(self, material: Material, components: Sequence[Component], ratios: Sequence[float]) -> None:
        """Set the numbers of a law and of parts like those that it was made of, in the same order and unchecked, and the
        cavities' pressures over P, without recompiling; the dead loads keep their own magnitudes."""
        P = self.common_pressure()
        self.components, self.ratios, self.material = tuple(components), tuple(ratios), material
        own = {part.name: part.material for part in components if isinstance(part, regions.RegionPart)}
        self.potential.set_material(material, own)
        for part in components:
            if (term := self.potential.terms.get(part.label)) is not None:
                term.take(part)
        self.dead.take(components)
        self.coupling = self.inflating(self.dead.amounts / self.dead.units)
        self._set_pressures(P, np.empty(0))

    def common_pressure(self) -> float:
        """Return P of the current state where it is the cavities' common pressure."""
        shares = self.coupling.shares
        cavity = int(np.argmax(np.abs(shares)))
        return float((self.pressures[cavity] - self.coupling.fixed_pressures[cavity]) / shares[cavity])

    def follow_mesh(self) -> None:
        """Follow a mesh that has moved, in all that is not a form."""
        self.dead.remeasure()
        for term in self.potential.terms.values():
            term.follow_mesh()

    @property
    def stress_unit(self) -> float:
        """Pa in one dimensionless stress."""
        return self.material.shear_modulus_0

    @property
    def length_unit(self) -> float:
        """Metres in one dimensionless length."""
        return self.body.actuator.size

    @property
    def volume_unit(self) -> float:
        """m3 of the whole device in one dimensionless volume of the slice."""
        return self.length_unit**3 * self.body.actuator.copies

    # -- assembly -------------------------------------------------------------------------------------------------------

    def assemble(self, forms: list[fem.Form], held: bool = False) -> Array:
        """Return the sum of assembled linear forms, owned entries: by the unknowns and zero at held dofs, or by all dofs if
        ``held``. It is a view that the next call overwrites."""
        b = assembly.assembled_vector(self._vector.x, forms)
        return b[: self.n] if held else self._by_unknowns()

    def by_unknowns(self, entries: Array) -> Array:
        """Return the entries of owned dofs by the unknowns; a view that the next assembly overwrites."""
        self._vector.x.array[: self.n] = entries
        return self._by_unknowns()

    def _by_unknowns(self) -> Array:
        b = self._vector.x.array
        for bc in self.bcs:
            bc.set(b, alpha=0.0)
        self.unknowns.restrict(b)
        return b[: self.n]

    def internal_forces(self) -> Array:
        """Return the derivative of the stored energy, owned entries; a view that the next assembly overwrites."""
        self._add_own_forces(self.assemble(self._internal, held=True))
        return self._by_unknowns()

    def _add_own_forces(self, b: Array, held: bool = False) -> Array:
        """Add the forces of terms that are no forms; return ``b``."""
        self.assembled.add_forces(self.w.x.array, b, held)
        if self.potential.motion:
            self.potential.motion.add_forces(self.w.x.array, b)
        return b

    def pressure_loads(self) -> Array:
        """Return each driver's load of a unit magnitude, shape (k, n): of the cavities' pressures, then of the dead loads."""
        return np.array([self.assemble(load).copy() for load in self._loads])

    def assemble_tangent(self) -> None:
        """Put the current state's tangent into K."""
        self._assemble_whole()
        self.unknowns.reduce(self._whole, self.residual)

    def _assemble_whole(self) -> None:
        self._whole.zeroEntries()
        self._products.add_to(self._whole, self.bcs)
        self._whole.assemble()
        self.assembled.add_to(self._whole, self.w.x.array)
        if self.potential.motion:
            self.potential.motion.add_to(self._whole)

    def tangent_product(self, x: Array, y: Array) -> None:
        """Put the current state's tangent times x into y, without assembling the matrix."""
        d = self.potential.direction.x
        self.unknowns.to_dofs(x, d.array)
        for bc in self.bcs:
            bc.set(d.array, alpha=0.0)
        d.scatter_forward()
        b = self._vector.x
        b.array[:] = 0.0
        self._products.add(d.array, b.array)
        b.scatter_reverse(la.InsertMode.add)
        self.assembled.add_product(self.w.x.array, d.array, b.array[: self.n])
        if self.potential.motion:
            self.potential.motion.add_product(d.array, b.array)
        y[:] = self._by_unknowns()
        self.unknowns.add_geometric_stiffness(x, y, self.residual)
        for bc in self.bcs:  # held dofs: the identity, as in the assembled matrix
            dofs, owned = bc.dof_indices()
            y[dofs[:owned]] = x[dofs[:owned]]
        y[self.unknowns.idle] = x[self.unknowns.idle]

    def forces_and_loads(self) -> list[tuple[fem.Form, float]]:
        """Return the potential's derivative by w in the current state: compiled forms with their factors."""
        loads = zip(self._loads, -self.pressures, strict=True)
        return [*((form, 1.0) for form in self._internal), *((form, factor) for load, factor in loads for form in load)]

    @functools.cached_property
    def _pressing(self) -> list[fem.Form]:
        return [self.form(walls) for walls in self.potential.pressing()]

    def surplus(self) -> Array:
        """Return the reaction forces on each owned dof, with the sign of `residual`, and equal to it on free dofs.

        On held dofs, and on rigid parts' as a whole, that is what holds them. The air pushes only on its walls, see
        `Body.pressing`, and all dead loads count.
        """
        surplus = self.residual()
        for pressure, (load,), walls in zip(self.pressures, self._loads, self._pressing, strict=False):
            surplus += pressure * self.assemble([load], held=True)
            surplus -= pressure * self.assemble([walls], held=True)
        return surplus

    def residual(self) -> Array:
        """Return the derivative of the potential by each owned dof, held ones and rigid parts' too."""
        residual = np.zeros(self.n)
        for form, factor in self.forces_and_loads():
            residual += factor * self.assemble([form], held=True)
        return self._add_own_forces(residual, held=True)

    # -- the current state --------------------------------------------------------------------------------------------

    def load(self, state: State) -> None:
        """Make ``state`` the current state of the functions."""
        self.w.x.array[:] = state.w[: self.dofs]
        self.unknowns.set_dofs(self.w.x.array)
        self.potential.update_lagged(state.w)
        self.potential.predict_stress(state.w)
        self._set_pressures(state.P, state.w[self.dofs :])

    def set_iterate(self, owned: Array, scalars: Array) -> None:
        """Make unknowns, P and the held cavities' pressures the current state of the functions."""
        self.unknowns.set_reduced(owned, self.w.x.array)
        self.w.x.scatter_forward()
        self._set_pressures(float(scalars[0]), scalars[1:])

    def _set_pressures(self, P: float, multipliers: Array) -> None:
        self.pressures = self.coupling.pressures(P, multipliers)
        self.potential.set_pressures(P, self.coupling, self.pressures)

    def rest(self) -> State:
        """Return the undeformed state at no pressure."""
        state = State(np.zeros(self.dofs + len(self.coupling.constraints)), 0.0, 0.0)
        self.load(state)
        return dataclasses.replace(state, V=self.volume())

    def drives_at(self, state: State) -> Array:
        """Return the pressure of each cavity and magnitude of each dead load at a state, shape (k,)."""
        return self.coupling.pressures(state.P, state.w[self.dofs :])

    def inflating(self, dead: Array) -> controls.Coupling:
        """Return the coupling in which P is the cavities' common pressure, or their vacuum if the `direction` is -1, beside
        constant magnitudes of the dead loads, shape (k - cavities,)."""
        return controls.Coupling.proportional([self.direction * ratio for ratio in self.ratios], dead)

    def pressures_at(self, state: State) -> Array:
        """Return the pressure of each cavity at a state."""
        return self.drives_at(state)[: len(self._volumes)]

    def volume(self) -> float:
        """Return the conjugate of P in the current state: a volume, or a dead load's travel."""
        return float(self.coupling.shares @ self.driven())

    def scales(self) -> Array:
        """Return the scales of the drivers' conjugates, shape (k,): the cavities' volumes in the current state, and 1 of dead
        loads."""
        return np.concatenate([self.volumes(), np.ones(len(self.dead.forms))])

    @property
    def drives_cavities(self) -> bool:
        """Whether P is a pressure, not only a dead load's magnitude."""
        return bool(self.coupling.shares[: len(self._volumes)].any())

    def driven(self) -> Array:
        """Return each driver's conjugate in the current state: the cavities' volumes, then the dead loads' travels,
        shape (k,)."""
        return np.concatenate([self.volumes(), self.dead.moved()])

    def volumes(self) -> Array:
        """Return the volume of each cavity in the current state."""
        return np.array([self.integral(volume) for volume in self._volumes]) + self.body.chambers

    def stored_energy(self) -> float:
        """Return the energy stored in the body in the current state."""
        return sum(self.integral(form) for form in self._stored) + self.assembled.energy(self.w.x.array)

    def smallest_J(self) -> float:
        """Return the smallest volume ratio at the integration points of the current state."""
        values = self._J.eval(self.body.mesh, self.cells)
        return -mpi.largest(self.comm, -float(values.min()) if values.size else -math.inf)

    def point_volumes(self) -> Array:
        """Return the dimensionless undeformed volumes of the integration points of the owned cells, shape (cells, points)."""
        if self._densities is None:
            density = self.body.hoop * abs(ufl.JacobianDeterminant(self.body.mesh))
            self._densities = fem.Expression(density, self.points, jit_options=compiling.JIT)
        return self._densities.eval(self.body.mesh, self.cells).reshape(len(self.cells), -1) * self._weights

    def integral(self, form: fem.Form) -> float:
        """Return the value of a compiled form without arguments, over all ranks."""
        return mpi.total(self.comm, fem.assemble_scalar(form))


@dataclasses.dataclass(frozen=True, eq=False)
class State:
    """An equilibrium state, dimensionless.

    Attributes:
        w: Local dof values with ghosts, shape (n,): skew displacement components and, if mixed, p; behind them, where
            volumes are held, those cavities' pressures.
        P: Cavity pressure.
        V: Volume of the cavity, of the slice in 3-D; with several cavities what P works on.
        iterations: Newton iterations that led here.
    """

    w: Array
    P: float
    V: float
    iterations: int = 0


def still_pressures(body: Body, space: fem.FunctionSpace, components: Sequence[Component]) -> list[fem.DirichletBC]:
    """Return conditions that fix p where nothing strains: in rigid regions, which have their own p (see `mechanics.assembly`),
    and in regions that are held, except where cells beside them have a part in it."""
    names = [part.region for part in components if isinstance(part, regions.RigidPart) and part.region]
    names += [hold.role for hold in body.holds if hold.direction is None and body.group(hold.role)[0] == body.mesh.topology.dim]
    if not names or space.dofmap.index_map_bs != 1:
        return []
    rows = np.array(space.sub(1).dofmap.list)
    still = np.zeros(len(rows), dtype=bool)
    still[np.concatenate([body.regions[name] for name in names])] = True
    inside, strained = (assembly.known_to_all(space, np.unique(rows[cells])) for cells in (still, ~still))
    return [fem.dirichletbc(np.array(0.0), np.setdiff1d(inside, strained), space.sub(1))]


# ----------------------------------------------------------------------------------------------------------------------
# The reduced unknowns of Newton's method: w = T(q).
#
# All other code uses the full dofs w. Without rigid parts q is the owned part of w, at no cost. With
# them q has the same length and layout: a part's few unknowns (`RigidMotion`) occupy the slots of some of the dofs that
# follow it, and the others' rows are the identity, as at held dofs. The residual is T^T r, the tangent T^T K T and, if a part
# can rotate, r times T's second derivative.


Ints = npt.NDArray[np.int32]


class Unknowns:
    """The owned dofs, n of them, but for those that rigid parts move: motions by the parts' names, which share no dof. Parts do
    not move local dofs that are ``held``.

    Attributes:
        idle: Owned entries of q that stand for nothing.
        turns: Whether T is other than linear.
        moving: The motions of rigid parts by their names.
        slots: For each of them the rank that has its unknowns, and the entries of q that they are there (none elsewhere).

    Raises:
        ValueError: The mesh has too few dofs on a part for its unknowns.
    """

    def __init__(self, comm: MPI.Comm, n: int, motions: Mapping[str, regions.RigidMotion], held: Ints):
        self.comm, self.n, self.moving, self.motions = comm, n, motions, tuple(motions.values())
        self.turns = any(motion.turns for motion in self.motions)
        self.slots = [_slots(comm, motion, held, name) for name, motion in motions.items()]
        none = np.empty(0, int)
        followers = np.concatenate([none, *(motion.dofs[motion.owned].ravel() for motion in self.motions)])
        mine = [slots for rank, slots in self.slots if rank == comm.rank]
        self.idle = np.setdiff1d(followers, np.concatenate([none, *mine])).astype(np.int32)
        self._curvatures: list[Array] | None = None

    def _reduced_of(self, w: Array, values: Sequence[Array]) -> Array:
        """Return q, shape (n,), of local dofs w and the parts' unknowns."""
        q = w[: self.n].copy()
        q[self.idle] = 0.0
        for own, (rank, slots) in zip(values, self.slots, strict=True):
            if rank == self.comm.rank:
                q[slots] = own
        return q

    def _values(self, q: Array) -> list[Array]:
        own = [q[slots] if rank == self.comm.rank else None for rank, slots in self.slots]
        if self.comm.size == 1:
            return [values for values in own if values is not None]
        return [self.comm.bcast(values, root=rank) for values, (rank, _) in zip(own, self.slots, strict=True)]

    def to_reduced(self, w: Array) -> Array:
        """Set the state of local dofs w as the base of rotations; return its q, shape (n,)."""
        self.set_dofs(w)
        return self._reduced_of(w, [motion.values for motion in self.motions])

    def set_dofs(self, w: Array) -> None:
        """Set the state of local dofs w."""
        self._curvatures = None
        for motion in self.motions:
            motion.take(w)

    def set_reduced(self, q: Array, w: Array) -> None:
        """Set the state q, and put its dofs into w."""
        self._curvatures = None
        w[: self.n] = q
        for motion, values in zip(self.motions, self._values(q), strict=True):
            motion.set(values)
            w[motion.dofs] = motion.displacements()

    def to_dofs(self, q: Array, w: Array) -> None:
        """Put into w the change of the dofs for a change q of the unknowns."""
        w[: self.n] = q
        for motion, values in zip(self.motions, self._values(q), strict=True):
            w[motion.dofs] = motion.rates() @ values

    def project(self, w: Array) -> Array:
        """Return the change of the unknowns whose change of the dofs is closest to w, shape (n,)."""
        return self._reduced_of(w, [motion.nearest_rate(w) for motion in self.motions])

    def restrict(self, b: Array) -> None:
        """Convert owned entries conjugate to w into those conjugate to q."""
        for motion, (rank, slots) in zip(self.motions, self.slots, strict=True):
            work = motion.work(b)
            b[motion.dofs[motion.owned]] = 0.0
            if rank == self.comm.rank:
                b[slots] = work

    # -- matrices -----------------------------------------------------------------------------------------------------

    def matrix(self, whole: PETSc.Mat, fill: Callable[[], None]) -> PETSc.Mat:
        """Return a matrix with the pattern of the reduced one; ``fill`` assembles the ``whole`` K."""
        if not self.motions:
            return whole
        fill()  # an empty matrix would lose its pattern
        self._T = PETSc.Mat().createAIJ(whole.getSizes(), csr=self._rows(whole), comm=whole.comm)
        self._product: PETSc.Mat = whole.ptap(self._T)
        self._entries = whole.getInfo()["nz_used"]
        self._ones = whole.createVecLeft()
        self._ones.array_w[self.idle] = 1.0
        diagonal = PETSc.Mat().createDiagonal(self._ones).convert("aij")
        self._reduced: PETSc.Mat = self._product.copy()
        self._reduced.axpy(1.0, diagonal, PETSc.Mat.Structure.DIFFERENT)  # type: ignore[arg-type]
        diagonal.destroy()
        assembly.mark_symmetric(self._reduced)
        return self._reduced

    def _rows(self, whole: PETSc.Mat) -> tuple[Ints, Ints, Array]:
        """Return T in compressed rows: the identity, and each part's rates."""
        start = whole.getOwnershipRange()[0]
        counts = np.ones(self.n, dtype=np.int32)
        for motion in self.motions:
            counts[motion.dofs[motion.owned]] = motion.freedom.count
        pointers = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        columns = np.repeat(np.arange(start, start + self.n, dtype=np.int32), counts)
        values = np.ones(pointers[-1])
        for motion, (rank, slots) in zip(self.motions, self.slots, strict=True):
            at = self.comm.bcast(start + slots if rank == self.comm.rank else None, root=rank)
            entries = pointers[motion.dofs[motion.owned]][..., None] + np.arange(motion.freedom.count)
            columns[entries] = at
            values[entries] = motion.rates()[motion.owned]
        return pointers, columns, values

    def reduce(self, whole: PETSc.Mat, forces: Callable[[], Array]) -> None:
        """Put T^T K T and the second derivatives' part into what `matrix` made; ``forces`` gives the residual conjugate to w,
        owned entries."""
        if not self.motions:
            return
        self._take_rates(whole)
        same = whole.getInfo()["nz_used"] == self._entries  # contact adds couplings over time
        self._product = whole.ptap(self._T, self._product if same else None)
        self._entries = whole.getInfo()["nz_used"]
        self._reduced.zeroEntries()
        structure = PETSc.Mat.Structure.SUBSET if same else PETSc.Mat.Structure.DIFFERENT
        self._reduced.axpy(1.0, self._product, structure)  # type: ignore[arg-type]
        assembly.mark_symmetric(self._reduced)
        self._reduced.setDiagonal(self._ones, PETSc.InsertMode.ADD)
        start = whole.getOwnershipRange()[0]
        for second, (rank, slots) in zip(self._second(forces), self.slots, strict=False):
            if rank == self.comm.rank:
                at = (start + slots).astype(np.int32)
                self._reduced.setValues(at, at, second, PETSc.InsertMode.ADD)  # type: ignore[arg-type]
        self._reduced.assemble()

    def projected(self, whole: PETSc.Mat, into: PETSc.Mat | None = None) -> PETSc.Mat:
        """Return T^T M T of another matrix; an earlier result is updated if a part has rotated."""
        if not self.motions:
            return whole
        if into is not None and not self.turns:
            return into
        self._take_rates(whole)
        return whole.ptap(self._T, into)

    def _take_rates(self, whole: PETSc.Mat) -> None:
        if self.turns:
            self._T.setValuesCSR(*self._rows(whole))  # type: ignore[arg-type]
            self._T.assemble()

    def _second(self, forces: Callable[[], Array]) -> list[Array]:
        """Return each part's second-derivative terms of the tangent; empty if none can rotate."""
        if not self.turns:
            return []
        if self._curvatures is None:
            b = forces()
            self._curvatures = [motion.curvature(b) for motion in self.motions]
        return self._curvatures

    def add_geometric_stiffness(self, q: Array, y: Array, forces: Callable[[], Array]) -> None:
        """Add the second derivatives' part of the tangent times q to y; see `reduce`."""
        for second, (rank, slots) in zip(self._second(forces), self.slots, strict=False):
            if rank == self.comm.rank:
                y[slots] += second @ q[slots]


def _slots(comm: MPI.Comm, motion: regions.RigidMotion, held: Ints, name: str) -> tuple[int, npt.NDArray[np.int64]]:
    """Return the rank that has a part's unknowns, and the owned dofs in whose slots they are there (empty elsewhere)."""
    free = np.setdiff1d(motion.dofs[motion.owned].ravel(), held)
    counts = comm.allgather(len(free))
    rank = int(np.argmax(counts))
    if counts[rank] < motion.freedom.count:
        raise ValueError(f"the mesh has too few nodes on the rigid part {name}; use smaller cells (--cell-size)")
    mine = free[: motion.freedom.count] if rank == comm.rank else free[:0]
    return rank, mine.astype(np.int64)


# ----------------------------------------------------------------------------------------------------------------------
# Nodes of rigid parts on a mesh, and the unknowns of Newton's method with them.


def _nodes_of(space: fem.FunctionSpace) -> tuple[fem.FunctionSpace, Ints, Array]:
    """Return the displacement's own space, local dofs of w's components at its nodes, shape (nodes, d), and the nodes'
    undeformed places in sizes of the device, shape (nodes, d)."""
    d = space.mesh.geometry.dim
    mixed = space.dofmap.index_map_bs == 1  # only a pure displacement is numbered in blocks
    vectors, parents = space.sub(0).collapse() if mixed else (space, None)
    places = vectors.tabulate_dof_coordinates()[:, :d]
    every = np.arange(len(places) * d) if parents is None else np.asarray(parents)
    return vectors, every.astype(np.int32).reshape(-1, d), places


def _on_face(vectors: fem.FunctionSpace, body: Body, face: str) -> Ints:
    """Return the local nodes on a face."""
    dimension, entities = body.entities[face]
    body.mesh.topology.create_connectivity(dimension, body.mesh.topology.dim)
    return np.asarray(fem.locate_dofs_topological(vectors, dimension, entities))


def _on_part(vectors: fem.FunctionSpace, body: Body, part: regions.RigidPart) -> Ints:
    """Return the local nodes on a part's face, or of its region; `ComponentError` if the mesh has no such face."""
    if part.region:
        return np.asarray(fem.locate_dofs_topological(vectors, body.mesh.topology.dim, body.regions[part.region]))
    if part.face not in body.entities:
        raise part.error(f"the mesh has no face {part.face!r}; it has {', '.join(body.entities)}")
    return _on_face(vectors, body, part.face)


def _motions(
    body: Body, space: fem.FunctionSpace, components: Sequence[Component]
) -> Iterator[tuple[str, str, regions.RigidMotion]]:
    """Yield the label of each rigid part and its name in messages with its motion, and those of faces that travel: of these
    only the component along the way is common."""
    parts = [part for part in components if isinstance(part, regions.RigidPart)]
    travelling = [(hold.role, hold.direction) for hold in body.holds if hold.together and hold.direction is not None]
    if not parts and not travelling:
        return
    comm, (vectors, dofs, places) = body.mesh.comm, _nodes_of(space)
    n = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
    for role, direction in travelling:
        nodes, (component, unit) = _on_face(vectors, body, role), body.along(role, direction)
        along, freedom = dofs[nodes][:, [component]], regions.Freedom(np.zeros(1), np.ones((1, 1)), np.empty((0, 3)))
        where = f"the face {role}, which travels,"
        skew, own = np.array([[1.0 / unit]]), along[:, 0] < n
        yield f"face {role}", where, regions.RigidMotion(comm, freedom, skew, along, np.zeros((len(nodes), 1)), own)
    for part in parts:
        nodes, freedom = _on_part(vectors, body, part), part.freedom(body.actuator, _centre(body, part))
        own = dofs[nodes, 0] < n
        yield part.label, part.where, regions.RigidMotion(comm, freedom, body.skew, dofs[nodes], places[nodes], own)


def unknowns_of(
    body: Body, space: fem.FunctionSpace, held: Sequence[fem.DirichletBC], components: Sequence[Component]
) -> Unknowns:
    """Return the unknowns on a mesh: its owned dofs, fewer with rigid parts and faces that travel.

    Raises:
        ComponentError: A rigid part on no face of the mesh, two that meet, or one that meets what holds the device.
    """
    comm, none = body.mesh.comm, np.empty(0, dtype=np.int32)
    still = np.concatenate([none, *(bc.dof_indices()[0] for bc in held)])
    motions, taken = dict[str, regions.RigidMotion](), none
    for label, where, motion in _motions(body, space, components):
        if mpi.any_rank(comm, bool(np.isin(motion.dofs, taken).any())):
            raise ComponentError(f"{where} touches another rigid part or a face that travels; merge them, or use another face")
        if mpi.any_rank(
            comm, bool((np.isin(motion.dofs, still)[..., None] & (np.abs(motion.rates()) > regions.HELD_TOLERANCE)).any())
        ):
            raise ComponentError(
                f"{where} touches the device's support along an edge, so it cannot move; guide it along a free "
                "direction of the support, or use kind = 'held'"
            )
        taken, motions[label] = np.concatenate([taken, motion.dofs.ravel()]), motion
    try:
        return Unknowns(comm, space.dofmap.index_map.size_local * space.dofmap.index_map_bs, motions, still)
    except ValueError as few:
        raise ComponentError(str(few)) from None


def _centre(body: Body, part: regions.RigidPart) -> Array:
    """Return the centre of a part's whole undeformed face or region, in sizes of the device, mirror images included."""
    d = body.actuator.dimension
    if d == 2:
        return np.zeros(d)
    area = body.sheet_face(part.face)[0] if part.face else cell_measure(body, body.regions[part.region])
    X = ufl.SpatialCoordinate(body.mesh)
    constant = fem.Constant(body.mesh, 1.0)
    size, *moments = (mpi.total(body.mesh.comm, fem.assemble_scalar(fem.form(f * area))) for f in (constant, *X))
    centre = np.array(moments) / size
    normals = np.array([plane.normal for plane in body.actuator.cut_planes]).reshape(-1, d)
    return np.asarray(centre - np.linalg.pinv(normals) @ normals @ centre)


FORMULATIONS = ("mixed", "displacement")
VOLUME_TOLERANCE = 0.1
"""Tolerance of the meshed cavity's volume against the exact one: straight edges, or three curved ones around a channel,
give a few percent error; six a part in a thousand."""
VOLUME_WARNING = 0.01
"""Relative error of the meshed cavity's volume above which the user is warned."""


# ----------------------------------------------------------------------------------------------------------------------
# Effect of a very stiff region on rounding errors, of its forces and of a factorisation.


def spread(regions: Sequence[regions.MaterialRegion]) -> float:
    """Return the stiffest region's shear modulus over the softest one's, at small strain."""
    moduli = [region.material.shear_modulus_0 for region in regions]
    return max(moduli) / min(moduli)


def rounding_of_stress(system: System) -> float:
    """Return the rounding error of the stiffest region's stress, in shear moduli of the main material; 0 for a single
    region.

    A place of about the device's size is known to a share of 2e-16, and the strain of a thin cell is the difference of two of
    them over its thickness: of a sheet of 1 GPa and 0.2 mm in a silicone finger 1e-9 shear moduli are measured, and predicted.
    """
    if len(system.matter) == 1:
        return 0.0
    stiffest = max(region.material.shear_modulus_0 for region in system.matter) / system.stress_unit
    return float(np.finfo(float).eps) * stiffest / _thinnest(system.body.mesh)


def _thinnest(mesh: meshes.Mesh) -> float:
    """Return the least height of a cell in the mesh's units, on all ranks."""
    dimension = mesh.topology.dim
    corners = np.asarray(mesh.geometry.x)[mesh.geometry.dofmaps[0][:, : dimension + 1], :]
    sides = corners[:, 1:] - corners[:, :1]
    gram = np.linalg.det(sides @ sides.transpose(0, 2, 1))
    faces = np.stack([np.delete(corners, k, axis=1) for k in range(dimension + 1)])
    edges = faces[:, :, 1:] - faces[:, :, :1]
    areas = np.linalg.det(edges @ edges.transpose(0, 1, 3, 2)).max(axis=0)
    heights = np.sqrt(gram / areas)
    return float(mesh.comm.allreduce(heights.min(initial=np.inf), op=MPI.MIN))


# ----------------------------------------------------------------------------------------------------------------------
# Forces of supports and of dead loads.


def held_force(system: System, role: str, component: int) -> float:
    """Return the current force on the support of a role along a component of w, of the slice, dimensionless: what of the
    forces on the role's dofs nothing else balances, see `System.surplus`."""
    dimension, entities = system.body.entities[role]
    dofs = fem.locate_dofs_topological(system.vectors.sub(component), dimension, entities)
    return mpi.total(system.comm, -float(system.surplus()[dofs[dofs < system.n]].sum()))


def face_load(system: System, role: str, direction: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return a unit load on the slice along a unit vector of device coordinates, spread evenly over a role's undeformed
    facets: entries of all owned dofs, shape (n,), dimensionless; `System.by_unknowns` turns it into what Newton's method
    has."""
    body = system.body
    measure, _ = body.sheet_face(role)
    test = ufl.TestFunction(system.space)
    y = ufl.split(test)[0] if system.mixed else test
    along = fem.Constant(body.mesh, in_section(direction, body.actuator.dimension))
    spread = fem.form(ufl.dot(along, body.displacement(y)) * body.hoop * measure)
    constant = fem.Constant(body.mesh, 1.0)
    return system.assemble([spread], held=True) / system.integral(fem.form(constant * body.hoop * measure))


def nodal_forces(system: System) -> tuple[Array, Array]:
    """Return all dead loads at their own magnitudes on the slice, of a solid with only displacements on one rank: undeformed
    places of the nodes in m and forces on them in N, shape (n, 3) each, in device coordinates."""
    body, dead = system.body, system.dead
    drives = dead.amounts / dead.units
    held = [drive * system.assemble(forms, held=True) for drive, forms in zip(drives, dead.forms, strict=True)]
    entries = np.sum(held, axis=0).reshape(-1, 3)
    # Entries work on displacements along the rows of the skew basis.
    forces = entries @ body.skew * system.stress_unit * system.length_unit**2
    places = system.space.tabulate_dof_coordinates()[: len(forces)] * system.length_unit
    return body.actuator.device_points(places), forces
