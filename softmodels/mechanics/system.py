"""The discrete equations of a pressurised body: forms, what they are assembled to, and the state of the functions in them.

Pi(u, p; P) = int shape(F) + p (J - 1) - p^2 / (2 bulk) dX - P V(u)

With several cavities V is a sum of theirs, and others' pressures work on their own volumes (`mechanics.coupling`). Residual
and tangent are its derivatives, so the follower pressure's stiffness and the symmetry come along. Inside, lengths are in sizes
of the device and stresses in shear moduli.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from softmodels.materials.laws import Material, MaterialError
from softmodels.materials.strain import Strain
from softmodels.mechanics.body import QUADRATURE_DEGREE, Body, BodyError, in_section
from softmodels.mechanics.contact import Contact, Obstacle
from softmodels.mechanics.coupling import Coupling
from softmodels.mechanics.mpi import largest, total
from softmodels.mechanics.sheet import Sheet, membrane_energy, membrane_stress, membrane_tangent, surface_metric

FORMULATIONS = ("mixed", "displacement")
VOLUME_TOLERANCE = 0.1  # of the cavity's volume by its mesh against its closed form; straight edges cost a few percent


@dataclasses.dataclass(frozen=True, eq=False)
class State:
    """A state of equilibrium, dimensionless.

    Attributes:
        w: Local dof values with ghosts, shape (n,): skew displacement components and, if mixed, p; behind them, where
            volumes are held, those cavities' pressures.
        P: Cavity pressure.
        V: Volume of the cavity, of the slice in 3-D; with several cavities what P works on.
        iterations: Newton iterations that led here.
    """

    w: npt.NDArray[np.float64]
    P: float
    V: float
    iterations: int = 0


class Discrete:
    """The discrete equations of a body of one material.

    Args:
        body: Mesh and roles.
        material: Law and parameters.
        formulation: ``"mixed"`` (P2 displacement, P1 pressure) or ``"displacement"`` (P2).
        sheet: A thin sheet bonded to one of the body's faces.
        obstacle: A rigid plane that stops some of the faces.

    Attributes:
        space: Function space of the unknowns.
        w: The current state's unknowns; P and ``pressures`` go with it.
        K: Matrix with the pattern of the tangent.
        n: Number of owned unknowns; ``dofs`` counts ghosts too.
        coupling: How the cavities' pressures and volumes are coupled.

    Raises:
        BodyError: A cavity whose wall encloses another volume than the device's.
        MaterialError: An incompressible material in the displacement formulation.
        ObstacleError: A plane that these faces cannot come to rest on.
    """

    def __init__(
        self,
        body: Body,
        material: Material,
        formulation: str = "mixed",
        sheet: Sheet | None = None,
        obstacle: Obstacle | None = None,
    ):
        import basix.ufl
        import ufl
        from dolfinx import fem
        from dolfinx.fem import petsc as fem_petsc

        if formulation not in FORMULATIONS:
            raise ValueError(f"formulation {formulation!r} is not one of {', '.join(FORMULATIONS)}")
        self.mixed = formulation == "mixed"
        if not self.mixed and math.isinf(material.bulk):
            raise MaterialError("poisson = 0.5 needs the mixed formulation: displacements alone would lock")
        self.body, self.material, self.formulation = body, material, formulation
        mesh, cell = body.mesh, body.mesh.basix_cell()
        self.comm = mesh.comm
        vector = basix.ufl.element("P", cell, 2, shape=(mesh.geometry.dim,))
        element = basix.ufl.mixed_element([vector, basix.ufl.element("P", cell, 1)]) if self.mixed else vector
        self.space = fem.functionspace(mesh, element)
        self.w = fem.Function(self.space)
        test, trial = ufl.TestFunction(self.space), ufl.TrialFunction(self.space)
        y = ufl.split(self.w)[0] if self.mixed else self.w

        self.P = fem.Constant(mesh, 0.0)
        self.parameters = _constants(mesh, material)
        self.sheet, self._stiffness = sheet, fem.Constant(mesh, 0.0)
        self.bulk = fem.Constant(mesh, 0.0)  # inverse bulk if mixed: it may vanish, the bulk may not be infinite
        self.set_material(material)
        self.displacement = y
        strain = Strain(body.deformation_gradient(y))
        jit = {"cffi_extra_compile_args": ["-O2"]}
        self.form = form = functools.partial(fem.form, jit_options=jit)
        self.coupling = Coupling.proportional(body.actuator.ratios)
        volumes = body.volumes(y)
        loads = [ufl.derivative(volume, self.w, test) for volume in volumes]
        self._volumes, self._loads = [form(own) for own in volumes], [form(load) for load in loads]
        volume, pressures = volumes[0], self.P * loads[0]
        self._cavity_loads: list[
            tuple[Any, Any]
        ] = []  # share of P and the rest; constants, so that others compile nothing
        if body.actuator.ratios != (1.0,):
            self._cavity_loads = [(fem.Constant(mesh, 0.0), fem.Constant(mesh, 0.0)) for _ in volumes]
            volume = sum(share * own for (share, _), own in zip(self._cavity_loads, volumes, strict=True))
            pressures = sum(
                (share * self.P + rest) * load for (share, rest), load in zip(self._cavity_loads, loads, strict=True)
            )
        self._direction = fem.Function(self.space)
        # Every term of the potential has forms of its own, added up when assembled: bodies share the law's, laws the load's.
        energies = self.energies(self.density(self.parameters, self.bulk), self._stiffness)
        self.contact = None if obstacle is None else Contact(obstacle, body, y)
        if self.contact is not None:
            energies += self.contact.energies
        self._contact_forces = [form(force) for force in self.contact.forces] if self.contact else []
        self._stored = [form(energy) for energy in energies]
        forces = [ufl.derivative(energy, self.w, test) for energy in energies]
        self._inner = [form(force) for force in forces]
        forces.append(-pressures)
        self.forces, self.cavity_volume = forces, volume
        # The stress of a sheet as it is foreseen from another state, in Newton's matrix alone; see `foresee`.
        self._known, self._move = (fem.Function(self.space) for _ in range(2))
        self._product = [form(second) for second in self._second_derivatives(forces, test, self._direction)]
        self._tangent = [form(second) for second in self._second_derivatives(forces, test, trial)]

        vectors = self.space.sub(0) if self.mixed else self.space
        zero = np.array(0.0)
        self.bcs = [fem.dirichletbc(zero, dofs, vectors.sub(component)) for component, dofs in body.held(vectors)]
        self.K = fem_petsc.create_matrix(self._tangent[0])  # facets couple no others than their cells do
        self.K.setOption(self.K.Option.SYMMETRIC, True)
        self.K.setOption(self.K.Option.SYMMETRY_ETERNAL, True)
        self._vector = fem.Function(self.space)
        self.points, _ = basix.make_quadrature(cell, QUADRATURE_DEGREE)
        self._J = fem.Expression(strain.J, self.points, jit_options=jit)
        self.cells = np.arange(mesh.topology.index_map(mesh.topology.dim).size_local, dtype=np.int32)
        self.n, self.dofs = self.K.getLocalSize()[0], len(self.w.x.array)
        self._set_pressures(0.0, np.empty(0))
        self._check_volume()

    def density(self, parameters: Any, bulk: Any) -> Any:
        """Energy per reference volume in UFL, of anything that carries the law's parameters by name."""
        import ufl

        strain = Strain(self.body.deformation_gradient(self.displacement))
        shape = self.material.shape(strain, parameters)
        if not self.mixed:
            return shape + bulk / 2 * (strain.J - 1) ** 2
        p = ufl.split(self.w)[1]
        return shape + p * (strain.J - 1) - bulk / 2 * p**2

    def energies(self, density: Any, stiffness: Any) -> list[Any]:
        """UFL integrals of an energy density over the body and, if one is bonded, of a sheet of this stiffness."""
        inside = density * self.body.hoop * self.body.measures()[0]
        if self.sheet is None:
            return [inside]
        on_face, normal = self.body.sheet_face(self.sheet.face)
        membrane = membrane_energy(self.body.deformation_gradient(self.displacement), normal)
        return [inside, stiffness * membrane * self.body.hoop * on_face]

    def _second_derivatives(self, forces: list[Any], test: Any, trial: Any) -> list[Any]:
        """UFL forms of the tangent, one for each force; that of a sheet with its stress foreseen."""
        import ufl

        found = [ufl.derivative(force, self.w, trial) for force in forces]
        if self.sheet is not None:
            on_face, normal = self.body.sheet_face(self.sheet.face)
            y = ufl.split(self._known)[0] if self.mixed else self._known
            C, known = (surface_metric(self.body.deformation_gradient(u), normal) for u in (self.displacement, y))
            stress = membrane_stress(known)
            foreseen = stress + ufl.derivative(stress, self._known, self._move)
            density = membrane_tangent(C, self.w, foreseen, test, trial)
            found[1] = self._stiffness * density * self.body.hoop * on_face
        return found

    def foresee(self, known: npt.NDArray[np.float64]) -> None:
        """Foresee a sheet's stress in the current state to first order from another state's dofs ``known``.

        A stiff sheet that is turned a little too far is stretched by the square of that, and so has at once more stress than
        all the rest bears. With this stress in its matrix Newton's method would need ever smaller steps. The stress that the
        equations linearised at the iterate before foretold has nothing of it; at a solved state both are the same. This is
        the mixed integration point method: Leonetti, Magisano, Madeo, Garcea, Kiendl, Reali 2019, A simplified
        Kirchhoff-Love large deformation model for elastic shells, Comput. Methods Appl. Mech. Eng.
        """
        if self.sheet is not None:
            self._known.x.array[:] = known[: self.dofs]
            self._move.x.array[:] = self.w.x.array - known[: self.dofs]

    def _check_volume(self) -> None:
        """Refuse a cavity whose opening is not closed by planes through the origin: its volume would be another."""
        found, known = self.rest().V * self.volume_unit, self.body.actuator.cavity_volume
        if abs(found / known - 1) > VOLUME_TOLERANCE:
            raise BodyError(
                f"the cavity's wall encloses {found * 1e6:.4g} ml where {known * 1e6:.4g} ml were expected; planes that cut "
                "the cavity open have to pass through the origin"
            )

    def set_material(self, material: Material) -> None:
        """Take other values of the same law; nothing is compiled again."""
        mu = material.shear_modulus_0
        for field in dataclasses.fields(material):
            value = np.asarray(getattr(material, field.name), dtype=float)
            getattr(self.parameters, field.name).value = value / mu if field.metadata["unit"] == "Pa" else value
        if self.sheet is not None:
            self._stiffness.value = self.sheet.stiffness / (mu * self.length_unit)
        self.bulk.value = mu / material.bulk if self.mixed else material.bulk / mu
        self.material = material

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

    def _set_pressures(self, P: float, multipliers: npt.NDArray[np.float64]) -> None:
        self.P.value = P
        self.pressures = self.coupling.pressures(P, multipliers)
        for i, (share, rest) in enumerate(self._cavity_loads):
            share.value = self.coupling.shares[i]
            rest.value = self.pressures[i] - P * self.coupling.shares[i]

    def _assemble(self, forms: list[Any]) -> npt.NDArray[np.float64]:
        """Sum of assembled linear forms, owned entries, zero at held dofs."""
        from dolfinx import fem, la

        b = self._vector.x
        b.array[:] = 0.0
        for form in forms:
            fem.assemble_vector(b.array, form)
        b.scatter_reverse(la.InsertMode.add)
        for bc in self.bcs:
            bc.set(b.array, alpha=0.0)
        return b.array[: self.n]

    def _scalar(self, form: Any) -> float:
        from dolfinx import fem

        return total(self.comm, fem.assemble_scalar(form))

    def pressures_at(self, state: State) -> npt.NDArray[np.float64]:
        """Pressure of each cavity at a state, shape (k,)."""
        return self.coupling.pressures(state.P, state.w[self.dofs :])

    def volume(self) -> float:
        """Volume that P works on, of the current state."""
        return float(self.coupling.shares @ self.volumes())

    def volumes(self) -> npt.NDArray[np.float64]:
        """Volume of each cavity in the current state, shape (k,)."""
        return np.array([self._scalar(volume) for volume in self._volumes])

    def stored_energy(self) -> float:
        """Energy stored in the body in the current state."""
        return sum(self._scalar(form) for form in self._stored)

    def force(self, role: str, component: int) -> float:
        """Force of the current state on whatever holds a role along a component of w, of the slice, dimensionless.

        It is what the potential would lose per displacement there: -d(stored - P V)/dw summed over the role's dofs.
        """
        from dolfinx import fem, la

        vectors = self.space.sub(0) if self.mixed else self.space
        dimension, found = self.body.entities[role]
        dofs = fem.locate_dofs_topological(vectors.sub(component), dimension, found)
        b = self._vector.x
        total_force = 0.0
        for form, factor in (*((form, -1.0) for form in self._inner), *zip(self._loads, self.pressures, strict=True)):
            b.array[:] = 0.0
            fem.assemble_vector(b.array, form)
            b.scatter_reverse(la.InsertMode.add)
            total_force += factor * float(b.array[dofs[dofs < self.n]].sum())
        return total(self.comm, total_force)

    def contact_force(self) -> float:
        """Force of the current state on the obstacle, of the slice, dimensionless; 0 without one."""
        return sum((self._scalar(form) for form in self._contact_forces), 0.0)

    def smallest_J(self) -> float:
        """Smallest volume ratio at the integration points of the current state."""
        values = self._J.eval(self.body.mesh, self.cells)
        return -largest(self.comm, -float(values.min()) if values.size else -math.inf)

    def _assemble_tangent(self) -> None:
        from dolfinx.fem import petsc as fem_petsc

        self.K.zeroEntries()
        for form in self._tangent:
            fem_petsc.assemble_matrix(self.K, form, bcs=self.bcs)
            self.K.assemble()  # between the forms too: held dofs' diagonal is put in, the rest is added up

    def _multiply(self, x: Any, y: Any) -> None:
        """Tangent of the current state times x. Far cheaper than assembling the matrix, and only good for products."""
        d = self._direction.x
        d.array[: self.n] = x
        for bc in self.bcs:
            bc.set(d.array, alpha=0.0)
        d.scatter_forward()
        y[:] = self._assemble(self._product)
        for bc in self.bcs:  # held dofs: the identity, as in the assembled matrix
            dofs, owned = bc.dof_indices()
            y[dofs[:owned]] = x[dofs[:owned]]

    def load(self, state: State) -> None:
        """Make ``state`` the current state of the functions."""
        self.w.x.array[:] = state.w[: self.dofs]
        self.foresee(state.w)
        self._set_pressures(state.P, state.w[self.dofs :])

    def face_load(self, role: str, direction: Any) -> npt.NDArray[np.float64]:
        """A unit load on the slice, spread evenly over a role's undeformed facets: owned entries, zero at held dofs."""
        import ufl
        from dolfinx import fem

        measure, _ = self.body.sheet_face(role)
        test = ufl.TestFunction(self.space)
        y = ufl.split(test)[0] if self.mixed else test
        along = fem.Constant(self.body.mesh, in_section(direction, self.body.actuator.dimension))
        spread = fem.form(ufl.dot(along, self.body.displacement(y)) * self.body.hoop * measure)
        one = fem.Constant(self.body.mesh, 1.0)
        return self._assemble([spread]) / self._scalar(fem.form(one * self.body.hoop * measure))

    def rest(self) -> State:
        """The undeformed state at no pressure."""
        state = State(np.zeros(self.dofs + len(self.coupling.constraints)), 0.0, 0.0)
        self.load(state)
        return dataclasses.replace(state, V=self.volume())


def _constants(mesh: Any, material: Material) -> Any:
    """UFL constants under the material's parameter names."""
    import types

    from dolfinx import fem

    return types.SimpleNamespace(
        **{
            field.name: fem.Constant(mesh, np.asarray(getattr(material, field.name), dtype=float))
            for field in dataclasses.fields(material)
        }
    )
