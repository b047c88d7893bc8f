"""The potential of a pressurised body and its derivatives in UFL, and their products with a change of the unknowns.

Pi(u, p; P) = int shape(F) + p (J - 1) - p^2 / (2 bulk) dX - P V(u)

Regions in other materials (`mechanics.regions`) have integrals of their own, and p jumps between them (`mechanics.assembly`).
Sheets, contact and other components (`mechanics.component`) are further terms. With several cavities V is
a sum of theirs, and other pressures work on their own volumes (`mechanics.controls`). Residual and tangent are its
derivatives, which include the follower pressure's stiffness and are symmetric. Lengths are in sizes of the device and stresses
in shear moduli.
"""

from __future__ import annotations

import math
import types
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType, ModuleType

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.common.lazy import Expr, PETSc, basix, fem, meshes, ufl
from softmodels.materials import laws
from softmodels.materials.laws import Material
from softmodels.mechanics import assembly, compiling, component, controls, memory
from softmodels.mechanics.body import Body
from softmodels.mechanics.component import Component
from softmodels.mechanics.regions import Regions, constants


class Potential:
    """Pi of a body, with its functions and constants, whose values can change without recompiling.

    Args:
        body: Mesh and roles.
        material: Law and parameters of all but its regions in other materials.
        mixed: Whether p is an unknown, or only displacements.
        components: What else is added to it.

    Attributes:
        space: Function space of the unknowns w.
        displacement: Skew components of the displacement in w.
        P: Cavity pressure.
        parameters: The law's parameters by name, those that are stresses in shear moduli.
        per_pascal: One pascal in shear moduli.
        bulk: Bulk modulus; its inverse if mixed: that may vanish, the bulk may not be infinite.
        regions: Where it is, then the regions in other materials; `stored` begins with an integral for each.
        pressure_dofs: If mixed, the unknown p at the corners of each local cell, one for each region, shape
            (cells, corners, regions), -1 where a region does not reach.
        volumes, loads: Each cavity's volume, and its derivative by w.
        pressures: Each cavity's pressure.
        cavity_volume: What P works on.
        energies: Terms of the stored energy.
        free_energies: What is stored, where that differs: silicone with a memory loses some on the way.
        histories: Of the regions whose silicone has a memory.
        step, before: With any, length in s of the step in time, and the dofs where it begins.
        internal: Their derivatives by w; ``forces`` has the pressures' too.
        terms: Those of further parts, by their labels.
        last_step: With any history, length in s of the last step; 0 where the device changed at once, infinite at the start.
        motion: Inertia; None where the device is followed through equilibria.
    """

    motion: memory.Motion | None = None
    last_step = math.inf

    def __init__(
        self,
        body: Body,
        material: Material,
        mixed: bool,
        components: Sequence[Component] = (),
    ):
        # The order in which functions and constants are made is part of a form's name in the kernel cache.
        self.body, self.mixed = body, mixed
        regions = Regions(body, material, components)
        mesh, cell = body.mesh, body.mesh.basix_cell()
        vector = basix.ufl.element("P", cell, 2, shape=(mesh.geometry.dim,))
        element = basix.ufl.mixed_element([vector, basix.ufl.element("P", cell, 1)]) if mixed else vector
        self.space = fem.functionspace(mesh, element)
        if mixed and regions.numbers is not None:
            self.space, self.pressure_dofs = assembly.jumping(self.space, 1, regions.numbers)
        elif mixed:
            self.pressure_dofs = np.array(self.space.sub(1).dofmap.list)[:, :, None]
        self.w = fem.Function(self.space)
        self._test = ufl.TestFunction(self.space)
        self.displacement = self._vector_part(self.w)
        self.P = fem.Constant(mesh, 0.0)
        self.parameters = constants(mesh, material)
        self.bulk = fem.Constant(mesh, 0.0)
        self.volumes = body.volumes(self.displacement)
        self.loads = [ufl.derivative(volume, self.w, self._test) for volume in self.volumes]
        pressures = self._pressures()
        self.direction = fem.Function(self.space)
        self.regions = (regions.main(self.parameters, self.bulk), *regions.others())
        self.histories = self._histories()
        remembered = {history.region.name: history for history in self.histories}
        densities, curved, free = (
            [
                self.density(
                    region.material, region.parameters, region.bulk, getattr(remembered.get(region.name), what, None)
                )
                for region in self.regions
            ]
            for what in ("density", "curved", "free")
        )
        self.energies = self.stored(curved)
        self.per_pascal = fem.Constant(mesh, 1.0)
        setting = component.FormContext(
            body, self.w, self.displacement, self.per_pascal, component.gravity_of(components)
        )
        self.terms = {
            part.label: part.term(setting) for part in components if isinstance(part, component.EnergyComponent)
        }
        added = [energy for term in self.terms.values() for energy in term.energies]
        self.energies += added
        self.free_energies = [*self.stored(free), *added] if self.histories else self.energies
        sloped = [*self.stored(densities), *added] if self.histories else self.energies
        self.internal = [self.unfreeze_history(ufl.derivative(energy, self.w, self._test)) for energy in sloped]
        self.forces = [*self.internal, *([-pressures] if self.volumes else [])]
        # The stress of sheets and fibres predicted from another state, only in Newton's matrix; see `predict_stress`.
        self._known, self._move = (fem.Function(self.space) for _ in range(2))

    def _vector_part(self, w: Expr) -> Expr:
        return ufl.split(w)[0] if self.mixed else w

    def _pressures(self) -> ufl.Form:
        """Return the work of the pressures on a test function; set the conjugate of P."""
        self._cavity_loads: list[tuple[fem.Constant, fem.Constant]] = []  # share of P, and the rest
        if self.body.actuator.ratios == (1.0,):
            self.cavity_volume, self.pressures = self.volumes[0], [self.P]
            return self.P * self.loads[0]
        mesh = self.body.mesh
        self._cavity_loads = [(fem.Constant(mesh, 0.0), fem.Constant(mesh, 0.0)) for _ in self.volumes]
        self.cavity_volume = sum(share * own for (share, _), own in zip(self._cavity_loads, self.volumes, strict=True))
        self.pressures = [share * self.P + rest for share, rest in self._cavity_loads]
        return sum(pressure * load for pressure, load in zip(self.pressures, self.loads, strict=True))

    def pressing(self) -> list[ufl.Form]:
        """Return the forces of a unit pressure on each cavity's walls, see `Body.pressing`."""
        return self.body.pressing(self.displacement, self._vector_part(self._test)) if self.volumes else []

    def _histories(self) -> list[memory.History]:
        """Return the histories of the regions whose silicone has a memory; make what a step begins with."""
        found = [region for region in self.regions if region.material.memory is not None]
        if not found:
            return []
        self.step, self.before = fem.Constant(self.body.mesh, 0.0), fem.Function(self.space)
        self._fixed = fem.Function(self.space, self.w.x)
        self._looked_at: npt.NDArray[np.float64] | None = (
            None  # the state that `memory_error` has last looked at in this step
        )
        before, fixed = (self._vector_part(w) for w in (self.before, self._fixed))
        return [memory.History(self.body, region, self.displacement, before, fixed, self.step) for region in found]

    def density(self, law: Material, parameters: types.SimpleNamespace, bulk: Expr, shape: Expr | None = None) -> Expr:
        """Return a law's energy per reference volume, of anything that carries its parameters by name; or with another energy
        of the change of shape."""
        strain = laws.Strain(self.body.deformation_gradient(self.displacement))
        shape = law.shape(strain, parameters) if shape is None else shape
        if not self.mixed:
            return shape + bulk / 2 * (strain.J - 1) ** 2
        p = ufl.split(self.w)[1]
        return shape + p * (strain.J - 1) - bulk / 2 * p**2

    def stored(self, densities: Sequence[Expr]) -> list[ufl.Form]:
        """Return the integrals of energy densities over the body's regions."""
        regions = zip(densities, self.regions, strict=True)
        return [density * self.body.hoop * region.dx for density, region in regions]

    def tangent(self, trial: Expr) -> list[ufl.Form]:
        """Return the derivatives of the forces along a trial function, one for each; of sheets and fibres with
        predicted stress."""
        forces = self.forces
        if self.histories:
            curved = [ufl.derivative(energy, self.w, self._test) for energy in self.energies]
            forces = [*curved, *forces[len(curved) :]]
        found = [self.unfreeze_history(ufl.derivative(force, self.w, trial)) for force in forces]
        for number, predicted in self.predicted_tangents(trial).items():
            found[number] = predicted
        return found

    def unfreeze_history[T: (ufl.Form, Expr)](self, of: T) -> T:
        """Return a form or expression with w in place of what its derivatives took for a constant: kernels compute it once
        then."""
        from ufl.algorithms import expand_derivatives, replace

        return replace(expand_derivatives(of), {self._fixed: self.w}) if self.histories else of

    def predicted_tangents(self, trial: Expr) -> dict[int, ufl.Form]:
        """Return those of `tangent` that are not second derivatives of their energies, by index."""
        found: dict[int, ufl.Form] = {}
        y = self._vector_part(self._known)
        at, mixed_points = len(self.regions), component.MixedPointStress(self._known, y, self._move, self._test, trial)
        for term in self.terms.values():
            if (seconds := term.tangent(mixed_points)) is not None:
                found |= dict(enumerate(seconds, at))
            at += len(term.energies)
        return found

    def is_admissible(self, before: npt.NDArray[np.float64], after: npt.NDArray[np.float64]) -> bool:
        """Return whether a step from one state's w to another's is admissible: no wall passes through an
        obstacle."""
        return all(term.is_admissible(before, after) for term in self.terms.values())

    def update_lagged(self, w: npt.NDArray[np.float64]) -> bool:
        """Adjust to a state's w what solves take as given; return whether that has changed by as much as matters."""
        changed = [term.update_lagged(w) for term in self.terms.values()]
        return any(changed)

    def commit(self, w: npt.NDArray[np.float64], reset: bool = False) -> None:
        """Accept a converged state's w; see `softmodels.mechanics.component.EnergyTerm.commit`."""
        for term in self.terms.values():
            term.commit(w, reset)
        if self.motion:
            self.motion.commit(w, reset)
        if self.histories:
            self._remember(w, reset)

    @property
    def remembers(self) -> bool:
        """Whether its forces depend on earlier states."""
        return bool(self.histories) or self.motion is not None or any(term.remembers for term in self.terms.values())

    def pass_time(self, step: float) -> None:
        """Begin a step of this length in s from the last accepted state; 0 where nothing remembers."""
        if self.motion:
            self.motion.begin(step)
        if not self.histories:
            return
        self.step.value, self._looked_at = step, None
        for history in self.histories:
            history.prepare()

    def memory_error(self, w: npt.NDArray[np.float64]) -> tuple[float, float]:
        """Return the error of the stress by the length of a step that ends in w, and the largest stress, in shear moduli."""
        if not self.histories:
            return 0.0, 0.0
        self.w.x.array[:], self._looked_at = w[: len(self.w.x.array)], w
        found = [history.trial() for history in self.histories]
        return max(error for error, _ in found), max(size for _, size in found)

    def _remember(self, w: npt.NDArray[np.float64], reset: bool) -> None:
        """Let the silicone remember an accepted state; from here on no time passes until `pass_time`."""
        here = self.w.x.array.copy()
        self.w.x.array[: len(w)] = w[: len(here)]
        self.last_step = math.inf if reset else float(self.step.value)
        if not reset and w is not self._looked_at:  # by identity, which is the same on all ranks
            self.memory_error(w)
        for history in self.histories:
            if reset:
                history.begin()
            else:
                history.advance()
        self.before.x.array[:] = self.w.x.array
        self.pass_time(0.0)
        self.w.x.array[:] = here

    def checkpoint(self) -> component.Checkpoint:
        """Save all that depends on earlier states: friction, motion, what the silicone remembers."""
        parts: list[component.HistoryDependent] = [
            term for term in self.terms.values() if isinstance(term, assembly.HistoryTerm)
        ]
        parts += [self.motion] if self.motion else []
        parts += [self, *self.histories] if self.histories else []
        return component.Checkpoint(parts)

    def save(self) -> tuple[npt.NDArray[np.float64], float]:
        """Return where the step begins, and the length of the step that led there."""
        return self.before.x.array.copy(), self.last_step

    def restore(self, saved: tuple[npt.NDArray[np.float64], float]) -> None:
        self.before.x.array[:], self.last_step = saved
        self.step.value, self._looked_at = 0.0, None

    @property
    def relaxation(self) -> float:
        """The shortest relaxation time in s; infinite without any."""
        memories = [history.region.material.memory for history in self.histories]
        return min((memory.shortest for memory in memories if memory), default=math.inf)

    @property
    def kinetic(self) -> float:
        """Kinetic energy, dimensionless."""
        return self.motion.kinetic if self.motion else 0.0

    @property
    def dissipated(self) -> float:
        """Energy that the silicone has dissipated, dimensionless."""
        return sum(history.dissipated for history in self.histories)

    # -- values -------------------------------------------------------------------------------------------------------

    def set_material(self, material: Material, others: Mapping[str, Material] = MappingProxyType({})) -> None:
        """Set other parameters of the same law, and of those of regions by their names."""
        mu = material.shear_modulus_0
        for region in self.regions:
            region.take(others.get(region.name, region.material) if region.name else material, mu, self.mixed)
        for history in self.histories:
            history.take(history.region.material, mu)
        self.per_pascal.value = 1 / mu

    def set_pressures(self, P: float, coupling: controls.Coupling, pressures: npt.NDArray[np.float64]) -> None:
        """Set the pressure P, and the coupled pressures of the cavities."""
        # A single cavity's own pressure may be constant while P is a dead load's.
        self.P.value = P if self._cavity_loads or not self.volumes else pressures[0]
        for i, (share, rest) in enumerate(self._cavity_loads):
            share.value = coupling.shares[i]
            rest.value = pressures[i] - P * coupling.shares[i]

    @property
    def predicted_stiffness(self) -> float:
        """Largest stiffness, in shear moduli, of the terms with predicted stress in Newton's matrix; 0 if none."""
        per_pascal = float(self.per_pascal.value)
        return max([0.0, *(term.stiffness * per_pascal for term in self.terms.values())])

    def predict_stress(self, known: npt.NDArray[np.float64], ahead: bool = True) -> None:
        """Predict the stress of sheets and fibres in the current state to first order from another state's dofs ``known``.

        A stiff sheet that is rotated slightly too far is stretched by the square of that, which at once exceeds all other
        stresses. With this stress in its matrix Newton's method would need ever smaller steps. The stress predicted by the
        equations linearised at the previous iterate does not contain it; at a converged state both are the same. This is
        the mixed integration point method: Leonetti, Magisano, Madeo, Garcea, Kiendl, Reali 2019, A simplified
        Kirchhoff-Love large deformation model for elastic shells, Comput. Methods Appl. Mech. Eng.

        Args:
            known: Local dofs of that state; what follows them is not read.
            ahead: Whether the stress is predicted from there to the current state, or is that state's own.
        """
        if self.predicted_stiffness:
            here = self.w.x.array
            self._known.x.array[:] = known[: len(here)]
            self._move.x.array[:] = here - known[: len(here)] if ahead else 0.0


# ----------------------------------------------------------------------------------------------------------------------
# Products of a change of the unknowns with the second derivative of a potential, in the state that its functions hold.
#
# Kept: CPU time of whole runs with products by compiled forms, and by MatMult of a tangent assembled at each iterate, over
# that with stored second derivatives (AMD EPYC family 26, AVX-512, one rank): default wedge of the disk 1.12 and 1.63, default
# half of the seminar slab 1.14 and 1.50; iterative solver at 37,120 and 181,940 unknowns by forms 1.4 and 1.41.
class NoModuliError(ValueError):
    """The C code does not support the second derivative of this energy."""


def only_integral(energy: ufl.Form) -> ufl.Integral:
    """Return the integral of an energy that has one, over cells or outer faces, by a rule of a stated degree; else raise
    `NoModuliError`."""
    integrals = energy.integrals()
    integral = integrals[0]
    kinds, known = ("cell", "exterior_facet"), {"quadrature_degree"}
    stated = set(integral.metadata()) == known and isinstance(integral.subdomain_id(), int | str)
    if len(integrals) != 1 or integral.integral_type() not in kinds or not stated:
        raise NoModuliError("several integrals, or an unusual one")
    return integral


def second_derivatives(density: Expr, w: fem.Function, on_faces: bool, mixed: bool) -> Expr:
    """Return the second derivative of an energy density over cells or faces by displacement (``on_faces``), its gradient and p
    (if ``mixed``, the last component of w): a vector, the upper triangle by rows; behind it on faces the position.

    Raises:
        NoModuliError: The density has something else of the unknowns.
    """
    from ufl.algorithms import expand_derivatives, replace
    from ufl.classes import Label, Variable

    gradient = ufl.grad(w)
    H, W = (Variable(of, Label(compiling.LABEL + k)) for k, of in enumerate((gradient, w)))
    density = replace(expand_derivatives(density), {gradient: H, w: W})
    _let_go()
    allowed = {0, 1, 2} if on_faces else {3} if mixed else set()
    if not (_components(density, W) <= allowed and _components(density, H) <= {0, 1, 2}):
        raise NoModuliError("unsupported components")
    at = [(0, (i, j)) for i in range(3) for j in range(3)] + [(1, (i,)) for i in sorted(allowed)]
    variables = (H, W)
    once = [ufl.diff(density, variable) for variable in variables]
    twice = [[ufl.diff(first, variable) for variable in variables] for first in once]
    second = [twice[a][b][(*i, *j)] for k, (a, i) in enumerate(at) for b, j in at[k:]]
    places = ufl.SpatialCoordinate(w.function_space.mesh)
    return ufl.as_vector([*second, *([places[i] for i in range(3)] if on_faces else [])])


def _let_go() -> None:
    """Clear functools' cache of UFL's traversers (Python 3.13 and later), which would keep expression and mesh alive."""
    from ufl.corealg.dag_traverser import DAGTraverser

    kinds: list[type] = [DAGTraverser]
    for kind in kinds:  # grows by those that are derived from each
        kinds += kind.__subclasses__()
        kept = getattr(vars(kind).get("process"), "_method_cache", None)
        if kept is not None:
            kept.clear()


def _components(density: Expr, variable: Expr) -> set[int]:
    """Return which of the unknowns' components a density has of the unknowns' or their gradients' variable."""
    from ufl.classes import FixedIndex, Grad, Indexed
    from ufl.corealg.traversal import unique_pre_traversal

    found: set[int] = set()
    for node in unique_pre_traversal(density):
        if variable not in node.ufl_operands:
            continue
        if isinstance(node, Grad):
            raise NoModuliError("second gradients")
        first = node.ufl_operands[1][0] if isinstance(node, Indexed) else None
        found |= {int(first)} if isinstance(first, FixedIndex) else set(range(variable.ufl_shape[0]))
    return found


# ----------------------------------------------------------------------------------------------------------------------
# Products with the tangent of a solid, by second derivatives of its energy densities stored at integration points.
#
# A form's product recomputes the law's second derivatives each time. They are the same for all products at a state,
# and GMRES needs about six: here they are computed once, by an expression compiled from the potential, and C code
# (``moduli.c``) multiplies with them, several cells or faces side by side.


Ints = npt.NDArray[np.int32]

LANES = 8
"""Number of cells or faces that the C code processes in parallel lanes."""
AT_ONCE = 512
"""Number of cells or faces whose second derivatives are computed at once, so that they stay in the processor's cache."""
FACES = np.array([(1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2)])
"""Corners of a reference tetrahedron's faces."""


def known_cells(space: fem.FunctionSpace) -> bool:
    """Return whether the C code supports the cells of a potential's space: tetrahedra, straight or with a node on each edge."""
    of = space.mesh
    return of.topology.cell_type == meshes.CellType.tetrahedron and of.geometry.cmaps[0].degree <= 2


def cell_dofs(space: fem.FunctionSpace, mixed: bool) -> Ints:
    """Return the unknowns of the cells: three of each node's displacement and, if mixed, p of each corner, shape (cells, 30 or
    34)."""
    vectors = space.sub(0) if mixed else space
    parts = [np.array(vectors.sub(k).dofmap.list) for k in range(3)]
    dofs = np.stack(parts, axis=2).reshape(len(parts[0]), 30)
    return np.hstack([dofs, np.array(space.sub(1).dofmap.list)]) if mixed else dofs


class QuadratureTangent:
    """Second derivative of an energy of a solid on `known_cells`, whose form has one integral; ``force`` is its compiled
    derivative, ``dofs`` are `cell_dofs`.

    Raises:
        NoModuliError: The C code has no such integral.
    """

    def __init__(self, potential: Potential, energy: ufl.Form, force: fem.Form, dofs: Ints):
        from ufl.algorithms import extract_coefficients
        from ufl.algorithms.analysis import extract_constants

        integral, w, mixed = only_integral(energy), potential.w, potential.mixed
        on_faces = integral.integral_type() == "exterior_facet"
        second = potential.unfreeze_history(second_derivatives(integral.integrand(), w, on_faces, mixed))
        cell = basix.CellType.triangle if on_faces else basix.CellType.tetrahedron
        points, weights = basix.make_quadrature(cell, integral.metadata()["quadrature_degree"])
        self._expression = fem.Expression(second, points, jit_options=compiling.JIT)
        # What histories begin with is large, and known to change only when they say so.
        begun = [history.begun for history in potential.histories]
        used = [c for c in extract_coefficients(second) if c not in begun]
        self._fields = list({id(field.x): field.x for field in (w, *used)}.values())
        self._histories, self._constants = potential.histories, extract_constants(second)
        self._mesh, self._known = w.function_space.mesh, list[Array]()
        compiled = force._cpp_object
        entities = np.array(compiled.domains(next(iter(compiled.integral_types)), 0), dtype=np.int32)
        c, rule = compiling.library(self._mesh.comm, "moduli"), (points, weights)
        if on_faces:
            pairs = entities.reshape(-1, 2)
            self._blocks = [
                _Block(c, self._mesh, dofs, pairs, int(side), rule, False) for side in np.unique(pairs[:, 1])
            ]
        elif entities.size:
            self._blocks = [_Block(c, self._mesh, dofs, entities.ravel(), None, rule, mixed)]
        else:
            self._blocks = []  # of a region that other ranks have

    def add_product(self, x: Array, y: Array) -> None:
        """Add its product at the current state to ``y``, both local dofs with ghosts; those of ghosts are for their owners."""
        self._take()
        for block in self._blocks:
            block.add_product(x, y)

    def _take(self) -> None:
        here = [self._mesh.geometry.x, *(field.array for field in self._fields)]
        here += [np.asarray(constant.value) for constant in self._constants]
        here.append(np.array([history.prepared for history in self._histories]))
        if not (self._known and all(map(np.array_equal, here, self._known))):
            for block in self._blocks:
                block.take(self._expression)
            self._known = [values.copy() for values in here]


class _Block:
    """Cells, or faces (pairs of a local cell and its side) on the same ``side`` of their cells, with the data for the C code.
    ``rule`` has points and weights on the reference cell or triangle; ``pressure`` says whether p counts."""

    def __init__(
        self,
        c: ModuleType,
        mesh: meshes.Mesh,
        dofs: Ints,
        entities: Ints,
        side: int | None,
        rule: tuple[Array, Array],
        pressure: bool,
    ):
        self._mesh = mesh
        self._entities = entities if side is None else entities[entities[:, 1] == side]
        self._cells = self._entities if side is None else self._entities[:, 0]
        self._side, (points, self._rule) = side, rule
        if side is not None:
            reference = basix.geometry(basix.CellType.tetrahedron)[FACES[side]]
            points = reference[0] + points @ (reference[1:] - reference[0])
        self._points = points
        self._dofs = _side_by_side(dofs[self._cells, : 34 if pressure else 30])
        quadratic, linear = (_tabulated(degree, points) for degree in (2, 1))
        self._shapes, self._linear = np.ascontiguousarray(quadratic[0]), np.ascontiguousarray(linear[0])
        self._slopes = np.ascontiguousarray(quadratic[1:].transpose(1, 2, 0))
        strains = 12 if side is not None else 10 if pressure else 9
        self._moduli = np.empty((len(self._dofs), len(points), strains * (strains + 1) // 2, LANES))
        self._c = c
        name = {9: "of_gradients", 10: "with_pressure", 12: "with_values"}[strains]
        self._product = getattr(c.lib, f"moduli_{name}")
        self._nodes = np.empty(0)

    def _measure(self) -> None:
        """Update the node positions, which a design moves."""
        geometry = self._mesh.geometry
        if np.array_equal(self._nodes, geometry.x):
            return
        self._nodes = geometry.x.copy()
        nodes = self._nodes[geometry.dofmaps[0][self._cells]]
        shapes = _tabulated(geometry.cmaps[0].degree, self._points)
        slopes = np.einsum("jqa,nax->nqxj", shapes[1:], nodes)  # of the place by the reference's coordinates
        if self._side is None:
            size = np.abs(np.linalg.det(slopes))
        else:
            a, b, c = basix.geometry(basix.CellType.tetrahedron)[FACES[self._side]]
            size = np.linalg.norm(np.cross(slopes @ (b - a), slopes @ (c - a)), axis=2)
            self._places = np.einsum("qa,nax->nqx", shapes[0], nodes)
        self._weights = np.ascontiguousarray(size * self._rule)
        curved = geometry.cmaps[0].degree > 1
        inverse = np.linalg.inv(slopes if curved else slopes[:, :1])
        self._inverse = _side_by_side(inverse.reshape(len(nodes), -1))
        tables = (self._inverse, self._shapes, self._slopes, self._linear, self._moduli)
        self._tables = [len(self._dofs), len(self._points), curved, self._c.ffi.from_buffer("int32_t[]", self._dofs)]
        self._tables += [self._c.ffi.from_buffer("double[]", table) for table in tables]

    def take(self, expression: fem.Expression) -> None:
        """Compute the second derivatives at the current state."""
        self._measure()
        buffer = self._c.ffi.from_buffer
        points, entries = self._moduli.shape[1:3]
        for first in range(0, len(self._entities), AT_ONCE):
            some = self._entities[first : first + AT_ONCE]
            values = expression.eval(self._mesh, some)
            if self._side is not None:
                values = self._in_order(values, self._places[first : first + AT_ONCE])
            into, weights = self._moduli[first // LANES :], self._weights[first:]
            arrays = [buffer("double[]", array) for array in (values, weights, into)]
            self._c.lib.moduli_take(len(some), points, entries, *arrays)

    @staticmethod
    def _in_order(values: Array, places: Array) -> Array:
        """Return the values at faces' points, shape (faces, points, entries and 3), the points' places behind the entries, in
        the order of the rule's ``places`` instead of the face's own orientation."""
        far = np.abs(values[:, None, :, -3:] - places[:, :, None]).sum(axis=3)
        return np.ascontiguousarray(np.take_along_axis(values[..., :-3], far.argmin(axis=2)[..., None], axis=1))

    def add_product(self, x: Array, y: Array) -> None:
        """Add the product with ``x`` to ``y``."""
        buffer = self._c.ffi.from_buffer
        self._product(*self._tables, buffer("double[]", x), buffer("double[]", y))


def _tabulated(degree: int, points: Array) -> Array:
    """Return the shape functions of a reference tetrahedron and their derivatives at points, shape (1 + 3, points, nodes)."""
    element = basix.create_element(basix.ElementFamily.P, basix.CellType.tetrahedron, degree)
    return np.asarray(element.tabulate(1, points)[..., 0])


def _side_by_side[T: np.generic](rows: npt.NDArray[T]) -> npt.NDArray[T]:
    """Return the rows of entities, shape (n, k), with `LANES` of them as the last index: shape (n / LANES, k, LANES), filled
    up."""
    count = -(-len(rows) // LANES)
    filled = np.concatenate([rows, np.repeat(rows[-1:], count * LANES - len(rows), axis=0)])
    return np.ascontiguousarray(filled.reshape(count, LANES, rows.shape[1]).transpose(0, 2, 1))


class TangentOperator:
    """Products with each term of a potential: by stored second derivatives (``kept``) if possible, else by a compiled form
    (``by_forms``).

    ``internal`` are compiled derivatives of its energies, ``loads`` of its cavities' volumes, ``tangent`` is
    `Potential.tangent`; ``matrices`` are compiled tangents of all terms, first those of the regions.
    """

    def __init__(
        self,
        potential: Potential,
        internal: Sequence[fem.Form],
        loads: Sequence[fem.Form],
        tangent: Sequence[ufl.Form],
        compiled: Callable[[ufl.Form], fem.Form],
    ):
        self.kept: list[QuadratureTangent] = []
        others: list[int] = []
        self.matrices = [compiled(form) for form in tangent]
        predicted = potential.predicted_tangents(potential.direction)
        terms = [[(energy, force)] for energy, force in zip(potential.energies, internal, strict=True)]
        pressures = zip(potential.pressures, potential.volumes, loads, strict=True)
        terms += [[(-pressure * volume, load) for pressure, volume, load in pressures]] if potential.volumes else []
        known = known_cells(potential.space)
        dofs = cell_dofs(potential.space, potential.mixed) if known else np.empty((0, 0), dtype=np.int32)
        for number, term in enumerate(terms):
            try:
                if not known or number in predicted:
                    raise NoModuliError("unsupported cells, or a tangent other than the energy's")
                self.kept += [QuadratureTangent(potential, energy, force, dofs) for energy, force in term]
            except NoModuliError:
                others.append(number)
        along = potential.tangent(potential.direction) if others else []
        self.by_forms = [compiled(along[number]) for number in others]

    def add(self, x: Array, y: Array) -> None:
        """Add the product with ``x`` to ``y``, both local dofs with ghosts; ghost values belong to their owners. Held dofs are
        as they are in x, which the potential's ``direction`` has too."""
        for moduli in self.kept:
            moduli.add_product(x, y)
        for form in self.by_forms:
            fem.assemble_vector(y, form)

    def add_to(self, matrix: PETSc.Mat, bcs: Sequence[fem.DirichletBC]) -> None:
        """Add the second derivative to a matrix, without finalising it.

        Args:
            matrix: With the pattern of the cells' dofs.
            bcs: Rows and columns of their dofs stay empty, but for ones on the diagonal.
        """
        for form in self.matrices:
            assembly.assemble_into(matrix, form, bcs)
            matrix.assemble(matrix.AssemblyType.FLUSH)  # held dofs' diagonal is put in, the rest is added up
