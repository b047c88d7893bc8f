"""Equilibrium of a pressurised body: one potential, one solver for every control.

Pi(u, p; P) = int shape(F) + p (J - 1) - p^2 / (2 bulk) dX - P V(u)

With several cavities V is a sum of theirs, and others' pressures work on their own volumes (`softmodels.drive`). Residual
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

from softmodels.body import QUADRATURE_DEGREE, Body, BodyError, in_section
from softmodels.bordered import Bordered
from softmodels.controls import Control, Curve, pressure_control
from softmodels.drive import Drive
from softmodels.materials import Material, MaterialError
from softmodels.obstacle import Contact, Obstacle
from softmodels.parallel import largest, total
from softmodels.sheet import Sheet, membrane_energy
from softmodels.strain import Strain

FORMULATIONS = ("mixed", "displacement")
TOLERANCE = 1e-9  # residual against the load of the cavity pressure
FLOOR = 1e-3  # pressures below this many shear moduli do not make the tolerance any finer
ROUNDING = 1000.0  # tolerances at which a residual that falls no further is taken for rounding
MOST_ITERATIONS = 15
LOOSEST = 1e-2  # of the linear solves: Newton's first steps are no better than that anyway
TANGENT_TOLERANCE = 1e-5
WORN = 25  # GMRES iterations in one solve after which the kept factorisation is replaced at once
VOLUME_TOLERANCE = 0.1  # of the cavity's volume by its mesh against its closed form; straight edges cost a few percent
STALE = 60  # GMRES iterations in all after which the next state gets a factorisation of its own


class NoConvergence(RuntimeError):
    """Newton's method found no state; the message says how it ended."""


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


@dataclasses.dataclass(frozen=True, eq=False)
class Tangent:
    """Direction of the path at a state: changes of w (shape as `State.w`), P and V; P rises where V does and dP > 0.

    The compliance dV/dP is infinite at a limit point and negative past it.
    """

    w: npt.NDArray[np.float64]
    P: float
    V: float

    @property
    def compliance(self) -> float:
        return self.V / self.P if self.P else math.inf


class Equilibrium:
    """The discrete equations of a body of one material.

    Args:
        body: Mesh and roles.
        material: Law and parameters.
        formulation: ``"mixed"`` (P2 displacement, P1 pressure) or ``"displacement"`` (P2).
        sheet: A thin sheet bonded to one of the body's faces.
        obstacle: A rigid plane that stops some of the faces.

    Raises:
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
        self.drive = Drive.proportional(body.actuator.ratios)
        volumes = body.volumes(y)
        loads = [ufl.derivative(volume, self.w, test) for volume in volumes]
        volume, pressures = volumes[0], self.P * loads[0]
        self._shares: list[tuple[Any, Any]] = []  # of P, and apart from it; constants, so that others compile nothing
        self._volumes, self._loads = [form(volume)], [form(loads[0])]
        if body.actuator.ratios != (1.0,):
            self._shares = [(fem.Constant(mesh, 0.0), fem.Constant(mesh, 0.0)) for _ in volumes]
            volume = sum(along * own for (along, _), own in zip(self._shares, volumes, strict=True))
            pressures = sum(
                (along * self.P + apart) * load for (along, apart), load in zip(self._shares, loads, strict=True)
            )
            self._volumes, self._loads = [form(own) for own in volumes], [form(load) for load in loads]
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
        self._product = [form(ufl.derivative(force, self.w, self._direction)) for force in forces]
        self._tangent = [form(ufl.derivative(force, self.w, trial)) for force in forces]

        vectors = self.space.sub(0) if self.mixed else self.space
        zero = np.array(0.0)
        self.bcs = [fem.dirichletbc(zero, dofs, vectors.sub(component)) for component, dofs in body.held(vectors)]
        self.K = fem_petsc.create_matrix(self._tangent[0])  # facets couple no others than their cells do
        self.K.setOption(self.K.Option.SYMMETRIC, True)
        self.K.setOption(self.K.Option.SYMMETRY_ETERNAL, True)
        self.system = Bordered(self.K, self._multiply)
        self._set_pressures(0.0, np.empty(0))
        self._vector = fem.Function(self.space)
        self.points, _ = basix.make_quadrature(cell, QUADRATURE_DEGREE)
        self._J = fem.Expression(strain.J, self.points, jit_options=jit)
        self.snes: Any = None
        self.anchor: Any = None
        self.cells = np.arange(mesh.topology.index_map(mesh.topology.dim).size_local, dtype=np.int32)
        self.n, self.dofs = self.system.n, len(self.w.x.array)
        self._make_solver()
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

    # -- scales -------------------------------------------------------------------------------------------------------

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

    # -- assembly -----------------------------------------------------------------------------------------------------

    def _take(self, x: Any) -> float:
        body, scalars = self.system.split(x)
        self.w.x.array[: self.n] = body
        self.w.x.scatter_forward()
        self._set_pressures(float(scalars[0]), scalars[1:])
        return float(scalars[0])

    def _set_pressures(self, P: float, multipliers: npt.NDArray[np.float64]) -> None:
        self.P.value = P
        self.pressures = self.drive.pressures(P, multipliers)
        for i, (along, apart) in enumerate(self._shares):
            along.value = self.drive.along[i]
            apart.value = self.pressures[i] - P * self.drive.along[i]

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

    def take_over(self, drive: Drive, state: State) -> State:
        """Drive the cavities another way from a state on.

        Returns:
            The same state as the new drive counts it, with P = 0.
        """
        self.load(state)
        pressures, held = self.pressures, len(self.drive.held)
        self.drive = drive
        if len(drive.held) != held:
            self._drop_solver()
            self.system = Bordered(self.K, self._multiply, len(drive.held))
            self._make_solver()
        start = State(np.concatenate([state.w[: self.dofs], drive.multipliers(pressures)]), 0.0, 0.0)
        self.load(start)
        return dataclasses.replace(start, V=self.volume())

    def pressures_at(self, state: State) -> npt.NDArray[np.float64]:
        """Pressure of each cavity at a state, shape (k,)."""
        return self.drive.pressures(state.P, state.w[self.dofs :])

    def volume(self) -> float:
        """Volume that P works on, of the current state."""
        return float(self.drive.along @ self.volumes())

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

    def _residual(self, snes: Any, x: Any, f: Any) -> None:
        P = self._take(x)
        loads, drive, control = self._set_columns(), self.drive, self.control
        inner = self._assemble(self._inner)
        volumes = self.volumes() if control.needs_volume or len(drive.held) else np.zeros(len(loads))
        measured = float(drive.along @ volumes) if self.anchor is None else self._along()
        gap = control.weight * (control.value(measured, P) - control.target)
        self.system.control = control.line(measured, P)  # Newton's matrix at this iterate has the control's tangent
        self.system.join(f, inner - self.pressures @ loads, [gap, *(drive.held @ volumes - drive.kept)])
        self._load_size = float(np.abs(self.pressures) @ self._norms(loads))

    def _set_columns(self) -> npt.NDArray[np.float64]:
        """Put the current state's loads in the system's border; each cavity's load of a unit pressure, shape (k, n)."""
        loads = np.array([self._assemble([load]).copy() for load in self._loads])
        rows = [self.drive.along, *self.drive.held]
        for column, row in zip(self.system.columns, rows, strict=True):
            column.array_w[:] = row @ loads
        return loads

    def _norms(self, loads: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return np.sqrt([total(self.comm, float(load @ load)) for load in loads])

    def _along(self) -> float:
        """How far the current state has gone from the anchor along its force."""
        self._y.array_w[:] = self.w.x.array[: self.n] - self.anchor[: self.n]
        return float(self.system.row.dot(self._y))

    def solve_along(
        self, force: Any, anchor: npt.NDArray[np.float64], amount: float, w: npt.NDArray[np.float64], P: float
    ) -> State:
        """Find the state with ``force . (w - anchor) = amount`` at whatever pressure, starting from the guess (w, P).

        Args:
            force: PETSc vector of the body's unknowns.
            anchor: Dofs from which the amount is counted, shape as `State.w`.
            amount: What the equation asks for; takes the volume's place in a control.

        Raises:
            NoConvergence: Newton's method did not get there.
        """
        self.system.row, self.anchor = force, anchor
        try:
            return self.solve(Control(1.0, 0.0, amount), w, P)
        finally:
            self.system.row = self.anchor = None

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

    def _jacobian(self, snes: Any, x: Any, J: Any, P: Any) -> None:
        self._take(x)
        if self.system.factorisations == 0 or self.snes.getKSP().getIterationNumber() > WORN:
            self._assemble_tangent()
            self.system.factorise()
            self.age, self._adrift = 0, True
        else:
            self.system.refresh()
        J.assemble()

    # -- Newton's method ----------------------------------------------------------------------------------------------

    def _make_solver(self) -> None:
        from petsc4py import PETSc

        self.age, self._adrift = 0, False
        self._first = self._before = math.inf
        self._x, self._f, self._y = self.system.vector(), self.system.vector(), self.K.createVecRight()
        snes = self.snes = PETSc.SNES().create(self.comm)
        snes.setType("newtonls")
        snes.setFunction(self._residual, self._f)
        snes.setJacobian(self._jacobian, self.system.mat)
        snes.getLineSearch().setType("basic")
        snes.setLineSearchPreCheck(self._guard)
        snes.setConvergenceTest(self._converged)
        snes.setMaxLinearSolveFailures(3)
        # Questions aside of the path have a solver of their own: its iterations do not count as the path's.
        self._side = PETSc.KSP().create(self.comm)
        solvers: list[tuple[Any, float]] = [(snes.getKSP(), LOOSEST), (self._side, TANGENT_TOLERANCE)]
        for ksp, tolerance in solvers:
            ksp.setType("gmres")
            ksp.setGMRESRestart(60)
            ksp.setPCSide(PETSc.PC.Side.RIGHT)
            ksp.setTolerances(rtol=tolerance, atol=0.0, max_it=60)
            pc = ksp.getPC()
            pc.setType("python")
            pc.setPythonContext(self.system)
        snes.setFromOptions()

    def _guard(self, x: Any, y: Any) -> bool:
        """Shorten Newton's step y (the next iterate is x - y) until no integration point turns inside out."""
        self.age += self.snes.getKSP().getIterationNumber()
        self._take(x)
        least = 0.1 * self.smallest_J()
        trial, factor = x.duplicate(), 1.0
        for _ in range(8):
            x.copy(trial)
            trial.axpy(-factor, y)
            self._take(trial)
            if self.smallest_J() > least:
                break
            factor /= 2
        y.scale(factor)
        return factor < 1.0

    def _converged(self, snes: Any, iteration: int, norms: tuple[float, float, float]) -> Any:
        from petsc4py import PETSc

        reasons: Any = PETSc.SNES.ConvergedReason
        _, _, residual = norms
        if not math.isfinite(residual):
            return reasons.DIVERGED_FNORM_NAN
        if iteration == 0:
            self._first = residual
        tolerance = TOLERANCE * max(self._load_size, FLOOR * self.system.q.norm())
        # Forces in a thin wall cancel to a part in 1e9 of themselves; what rounding leaves of them Newton cannot mend.
        settled = iteration >= 2 and residual > 0.5 * self._before and residual <= ROUNDING * tolerance
        if residual <= tolerance or settled:
            return reasons.CONVERGED_FNORM_ABS
        if iteration >= MOST_ITERATIONS:
            return reasons.DIVERGED_MAX_IT
        if iteration >= 3 and residual > 1e3 * self._first:
            return reasons.DIVERGED_DTOL
        # Eisenstat & Walker 1996 (doi 10.1137/0917003), choice 2: solve as well as Newton's next step can make use of.
        forcing = LOOSEST if iteration == 0 else min(LOOSEST, (residual / self._before) ** 2)
        snes.getKSP().setTolerances(rtol=min(max(forcing, 0.3 * tolerance / residual), LOOSEST))
        self._before = residual
        return reasons.ITERATING

    def solve(self, control: Curve, w: npt.NDArray[np.float64], P: float) -> State:
        """Find the state on the control's curve, starting from the guess (w, P).

        Raises:
            NoConvergence: Newton's method did not get there. The functions hold its last iterate.
        """
        self.control = control
        self.system.join(self._x, w[: self.n], [P, *w[self.dofs :]])
        self.snes.solve(None, self._x)
        reason = self.snes.getConvergedReason()
        if reason <= 0:
            self.age = STALE + 1  # what led here is no preconditioner to go on with
            raise NoConvergence(_REASONS.get(reason, f"PETSc's reason {reason}"))
        P = self._take(self._x)
        return State(self._unknowns(self._x), P, self.volume(), self.snes.getIterationNumber())

    def _unknowns(self, x: Any) -> npt.NDArray[np.float64]:
        """What `State.w` holds of a vector of the whole system; the functions have been given it."""
        return np.concatenate([self.w.x.array, self.system.split(x)[1][1:]])

    def load(self, state: State) -> None:
        """Make ``state`` the current state of the functions."""
        self.w.x.array[:] = state.w[: self.dofs]
        self._set_pressures(state.P, state.w[self.dofs :])

    def factorise(self, state: State) -> None:
        """Factorise the tangent at ``state``, to be kept for the solves that follow."""
        self.load(state)
        self._set_columns()
        self._assemble_tangent()
        self.system.factorise()
        self.age, self._adrift = 0, False

    @property
    def stale(self) -> bool:
        """Whether a new factorisation is due: the kept one has aged, or was made at an iterate and not at a state."""
        return self.system.factorisations == 0 or self.age > STALE or self._adrift

    def tangent(self, state: State, control: Control, tolerance: float = TANGENT_TOLERANCE) -> Tangent:
        """Direction of the path at a state, scaled to one unit of the control's line, to a relative tolerance.

        Raises:
            NoConvergence: The linear solver did not get there (the line runs along the path, say).
        """
        self._border(state, control)
        return self.respond(0.0, 1.0, tolerance)

    def _border(self, state: State, control: Control) -> None:
        """Set the system's border for linear answers at a state, the control's line held."""
        self.load(state)
        self._set_columns()
        self.system.control = control
        self.system.refresh()

    def respond(self, force: Any, gap: float, tolerance: float) -> Tangent:
        """Answer of the current state, linearised, to a ``force`` on the body and a ``gap`` of the control's line.

        `tangent` has to have been called at this state: it sets the border of the system.

        Args:
            force: Owned entries, shape (n,), zero at held dofs; or 0.
            gap: Change of the line's left side.
            tolerance: Of the linear solver, relative.

        Raises:
            NoConvergence: The linear solver did not get there.
        """
        system, ksp = self.system, self.snes.getKSP()
        rhs, x = self._f, self._x
        system.join(rhs, force, [gap, *np.zeros(len(system.held))])
        system.mat.assemble()
        ksp.setOperators(system.mat)
        ksp.setTolerances(rtol=tolerance)
        ksp.solve(rhs, x)
        self.age += ksp.getIterationNumber()
        if ksp.getConvergedReason() <= 0:
            raise NoConvergence("the linear solver failed on the state's linear response")
        body, pressures = system.split(x)
        direction = self._direction.x
        direction.array[: self.n] = body
        direction.scatter_forward()
        self._y.array_w[:] = body
        w = np.concatenate([direction.array, pressures[1:]])
        return Tangent(w, float(pressures[0]), system.q.dot(self._y))

    def compliance(self, state: State, load: npt.NDArray[np.float64]) -> float:
        """Work of a dead load (owned entries, shape (n,)) on the motion it causes at a state, the cavity pressure kept.

        One more back-substitution with the factorisation at hand and a few iterations; infinite where the tangent has no
        solution.
        """
        self.load(state)
        system, rhs, x = self.system, self._f, self._x
        ksp: Any = self._side
        system.control = pressure_control(0.0)
        system.join(rhs, load, np.zeros(system.scalars))
        system.mat.assemble()
        ksp.setOperators(system.mat)
        ksp.solve(rhs, x)
        if ksp.getConvergedReason() <= 0:
            return math.inf
        return total(self.comm, float(load @ system.split(x)[0]))

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

    def response(self, state: State, force: npt.NDArray[np.float64], tolerance: float) -> npt.NDArray[np.float64]:
        """K^-1 ``force`` at a state and a given pressure (local owned arrays), to a relative tolerance.

        Raises:
            NoConvergence: The linear solver did not get there.
        """
        self._border(state, pressure_control(state.P))
        return self.respond(force, 0.0, tolerance).w[: self.n]

    def release(self) -> None:
        """Give back what PETSc and MPI hold for this device; it cannot be solved any more.

        PETSc's solvers refer to this object and it to them, a cycle that Python cannot see. Whoever solves many devices in
        one process would run out of MPI's communicators.
        """
        self._drop_solver()
        self.K.destroy()

    def _drop_solver(self) -> None:
        self.snes.destroy()
        self._side.destroy()
        self.system.release()
        for thing in (self._x, self._f, self._y):
            thing.destroy()

    def rest(self) -> State:
        """The undeformed state at no pressure."""
        state = State(np.zeros(self.dofs + len(self.drive.held)), 0.0, 0.0)
        self.load(state)
        return dataclasses.replace(state, V=self.volume())


_REASONS = {
    -3: "the linear solver failed",
    -4: "the residual is not a number",
    -5: f"no convergence in {MOST_ITERATIONS} iterations",
    -9: "the residual grew a thousandfold",
}


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
