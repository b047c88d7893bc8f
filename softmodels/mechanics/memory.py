"""Steps in time: what a region's silicone remembers, and inertia.

Histories are kept at the integration points, and give an energy over one time step; see `materials.memory`.
What a step begins with are functions: the displacement there, and at the points each branch's Cv and the largest energy Wm of
the softening. With a step of no length the energy is that of the state itself, where nothing creeps.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import types

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.common.lazy import Expr, PETSc, basix, fem, meshes, ufl
from softmodels.materials import laws, memory
from softmodels.materials.laws import Material
from softmodels.materials.memory import Memory
from softmodels.mechanics import assembly, compiling, component, mpi, regions
from softmodels.mechanics.body import QUADRATURE_DEGREE, Body


class History:
    """History of one region: of the displacement's skew components in UFL, where the step ends and begins, and ``fixed``,
    which derivatives by the displacement take for a constant; steps in s.

    ``values`` are of each integration point the branches' Cv, one after the other, and behind them Wm. ``begun`` is what the
    energy of a step has of its beginning: of each branch H and b, and of a spring of I1 its shift, and behind them Wm;
    ``prepared`` counts its changes. ``beginning`` is ``begun`` by the state and ``values`` where a step begins, ``ending``
    ``values`` at its end by the states there and where it begins, in UFL.

    ``density`` is, without the change of volume, an energy whose derivative is that of the energy at the end of the step,
    ``curved`` one whose second derivative is too, which takes longer, and ``free`` the energy stored in the state where the
    step begins and ends, at no length of it.
    """

    def __init__(
        self,
        body: Body,
        region: regions.MaterialRegion,
        displacement: Expr,
        before: Expr,
        fixed: Expr,
        step: fem.Constant,
    ):
        assert region.material.memory is not None
        self.body, self.region, self.step = body, region, step
        self.memory: Memory = region.material.memory
        mesh = body.mesh
        branches, softening = self.memory.branches, self.memory.softening
        self.size = SIX * len(branches) + (softening is not None)
        element = basix.ufl.quadrature_element(
            mesh.basix_cell(), value_shape=(self.size,), degree=QUADRATURE_DEGREE, scheme="default"
        )
        space = fem.functionspace(mesh, element)
        self.values = fem.Function(space)
        self.places = np.array(space.dofmap.list)[region.cells]
        self._starts = [0, *itertools.accumulate(SIX + 1 + bool(branch.spring) for branch in branches)]
        self.width = self._starts[-1] + (softening is not None)
        wider = basix.ufl.quadrature_element(
            mesh.basix_cell(), value_shape=(self.width,), degree=QUADRATURE_DEGREE, scheme="default"
        )
        self.begun = fem.Function(fem.functionspace(mesh, wider))
        self.times = fem.Constant(mesh, np.array([branch.time for branch in branches] or [1.0]))
        self.moduli = fem.Constant(mesh, np.zeros(max(1, len(branches))))
        self.flows = [None if branch.linear else _constants(mesh, branch) for branch in branches]
        self.softening = types.SimpleNamespace(
            **{name: fem.Constant(mesh, 1.0) for name in ("r", "m", "beta", "recovery") if softening is not None}
        )
        self.strain, self._before, self._fixed = (
            laws.Strain(body.deformation_gradient(u)) for u in (displacement, before, fixed)
        )
        self.prepared, self._next = 0, np.empty(0)
        self._make()
        self.begin()

    def _make(self) -> None:
        """Make the energies and the expressions of a step."""
        law, parameters = self.region.material, self.region.parameters
        C, C0 = (memory.six(strain.J ** (-2 / 3) * strain.C) for strain in (self.strain, self._before))
        W = law.shape(self.strain, parameters)
        density, error = W, 0.0
        spent: Expr = ufl.as_ufl(0.0)
        begin: list[Expr] = []
        after: list[Expr] = []
        for k in range(len(self.flows)):
            own = self._branch(k, C0, C)
            begin += own.begin
            after += own.after
            error, spent = error + own.error, spent + own.lost
        hurt: Expr = ufl.as_ufl(0.0)
        if self.memory.softening is not None:
            before = Wm = self.values[self.size - 1]
            if math.isfinite(self.memory.softening.recovery):
                W0 = law.shape(self._before, parameters)
                before = W0 + (Wm - W0) * ufl.exp(-self.step / self.softening.recovery)
            begin.append(before)
            at_end = self.begun[self.width - 1]
            density += memory.softened(W, at_end, self.softening, memory.InUfl) - W
            hurt = memory.softened(ufl.as_ufl(0.0), Wm, self.softening, memory.InUfl)
            after.append(memory.InUfl.below(W, at_end, at_end, W))
        stretch = [c - unit for c, unit in zip(C, memory.IDENTITY, strict=True)]
        size = (1.0 + sum(self.moduli[k] for k in range(len(self.memory.branches)))) / 2
        stress, stiffness = self._creeping()
        self.density, self.free = density + stress, self._stored(self.strain) - hurt
        self.curved = self.density + stiffness
        self._hurt = fem.form(hurt * self.body.hoop * self.region.dx, jit_options=compiling.JIT)
        spent *= self.body.hoop * abs(ufl.JacobianDeterminant(self.body.mesh))
        self.beginning, self.ending = ufl.as_vector(begin), ufl.as_vector(after)
        updated = ufl.as_vector([*after, error, size * ufl.sqrt(memory.contracted(stretch, stretch)), spent])
        self.points, self._weights = basix.make_quadrature(self.body.mesh.basix_cell(), QUADRATURE_DEGREE)
        self._updated, self._begin = (
            fem.Expression(vector, self.points, jit_options=compiling.JIT) for vector in (updated, self.beginning)
        )

    def _branch(self, k: int, C0: memory.Six, C: memory.Six) -> types.SimpleNamespace:
        """Return what the energy of a step from Cbar C0 to C takes of branch k's beginning, the branch's Cv at the end, the
        error of its stress there, and what it dissipates in the step."""
        flow = self.flows[k]
        Cv, G, x = [self.values[SIX * k + i] for i in range(SIX)], self.moduli[k], self.step / self.times[k]
        rate = memory.fluidity(C0, Cv, flow, memory.InUfl) if flow else 1.0
        H, b = memory.step_of(C0, Cv, x * rate, memory.InUfl)
        begin = [*H, b]
        if flow and flow.spring:
            begin.append(3 * memory.growth(C0, memory.crept(C0, H, b)) - memory.step_invariant(C0, H, b))
        H, b, *_ = self._begun_of(k)
        new = memory.crept(C, H, b)
        if flow:
            better = memory.crept(C, *memory.corrected_step(C0, C, Cv, x, flow, memory.InUfl, new))
        else:
            mean = (memory.growth(C0, Cv) + memory.growth(C, new)) / 2
            better = memory.crept(C, *memory.step_of(C0, Cv, x, memory.InUfl, mean))
        off = [p - q for p, q in zip(memory.cofactors(new), memory.cofactors(better), strict=True)]
        error = G / 2 * ufl.sqrt(memory.contracted(off, off)) * memory.contracted(C, memory.IDENTITY) / 3
        new = better if flow else new
        half = [(c + c0) / 2 for c, c0 in zip(C, C0, strict=True)]
        middle = memory.crept(half, *memory.step_of(C0, Cv, x * rate / 2, memory.InUfl))
        powers = [memory.dissipated(*state, flow, memory.InUfl) for state in ((C0, Cv), (half, middle), (C, new))]
        lost = G * x * (powers[0] + 4 * powers[1] + powers[2]) / 6  # Simpson's rule
        return types.SimpleNamespace(begin=begin, error=error, lost=lost, after=new)

    def _begun_of(self, k: int) -> tuple[list[Expr], Expr, list[tuple[Expr, Expr]], Expr]:
        """Return H, b, the spring's terms and their shift of a branch's step, as `memory.step_stress` takes them."""
        at, flow = self._starts[k], self.flows[k]
        H, b = [self.begun[at + i] for i in range(SIX)], self.begun[at + SIX]
        return (H, b, flow.spring, self.begun[at + SIX + 1]) if flow and flow.spring else (H, b, [], 0.0)

    def _creeping(self) -> tuple[Expr, Expr]:
        """Return what the branches add to ``density``, and to ``curved`` beside that.

        The first is linear in C, the second quadratic in its change from itself, which is zero: derivatives of C then multiply
        the sums of the branches' stresses and stiffnesses. Those of each branch's energy take five times as long.
        """
        none = ufl.as_ufl(0.0)
        scale = self._fixed.J ** (-2 / 3)
        C = memory.six(scale * self._fixed.C)
        stress, stiffness = [none] * SIX, [[none] * (p + 1) for p in range(SIX)]
        for k in range(len(self.flows)):
            G, begun = self.moduli[k], self._begun_of(k)
            stress = [s + G * d for s, d in zip(stress, memory.step_stress(C, *begun), strict=True)]
            of_branch = memory.step_stiffness(C, *begun)
            stiffness = [[s + G * d for s, d in zip(*rows, strict=True)] for rows in zip(stiffness, of_branch, strict=True)]
        stress, stiffness = memory.isochoric(C, stress, stiffness)
        turned = scale * self._fixed.F.T * (self.strain.F - self._fixed.F)
        change, quadratic = memory.six(turned + turned.T), none
        for p, row in enumerate(stiffness):
            counts = [memory.ENTRY_COUNTS[p] * memory.ENTRY_COUNTS[q] / (2 if p == q else 1) for q in range(p + 1)]
            quadratic += change[p] * sum(n * s * c for n, s, c in zip(counts, row, change, strict=False))
        return scale * memory.contracted(stress, memory.six(self.strain.C)), quadratic

    def _stored(self, strain: laws.Strain) -> Expr:
        """Return the energy of a state where a step begins and ends, above that which softening has spent."""
        energy = self.region.material.shape(strain, self.region.parameters)
        if self.memory.softening is not None:
            energy = memory.softened(energy, self.values[self.size - 1], self.softening, memory.InUfl)
        C = memory.six(strain.J ** (-2 / 3) * strain.C)
        for k, flow in enumerate(self.flows):
            spring = flow.spring if flow else ()
            energy += self.moduli[k] * memory.stored(C, [self.values[SIX * k + i] for i in range(SIX)], spring)
        return energy

    @functools.cached_property
    def _stress(self) -> fem.Expression:
        """The Cauchy stress of that state, without the pressure that keeps the volume."""
        # a fixed label, because it is part of the signature in the kernel cache
        F = ufl.classes.Variable(self.strain.F, ufl.classes.Label(compiling.FIRST_LABEL))
        strain = laws.Strain(F)
        stress = ufl.diff(self._stored(strain), F) * F.T / strain.J
        return fem.Expression(stress, self.points, jit_options=compiling.JIT)

    def take(self, material: Material, mu: float) -> None:
        """Set a material's parameters, in units of a shear modulus in Pa; the number of branches stays."""
        assert material.memory is not None
        flows = [_numbers(flow, branch) for flow, branch in zip(self.flows, material.memory.branches, strict=True) if flow]
        for constant, value in (*self.numbers(material, mu), *itertools.chain(*flows)):
            constant.value = value

    def numbers(self, material: Material, mu: complex) -> list[tuple[fem.Constant, npt.NDArray[np.inexact]]]:
        """Return the constants to differentiate by, with their values of a material, see `take`; complex for a complex one."""
        own = material.memory
        numbers: list[tuple[fem.Constant, npt.NDArray[np.inexact]]] = []
        assert own is not None
        if own.branches:
            numbers.append((self.times, np.array([branch.time for branch in own.branches])))
            shares = np.array([branch.share for branch in own.branches])
            numbers.append((self.moduli, shares * material.shear_modulus_0 / mu))
        if own.softening is not None:
            r, m, beta, recovery = dataclasses.astuple(own.softening)
            values = (r, m / mu, beta, recovery if math.isfinite(recovery) else 1.0)
            constants = (getattr(self.softening, name) for name in ("r", "m", "beta", "recovery"))
            numbers += zip(constants, map(np.asarray, values), strict=True)
        return numbers

    # -- what is remembered -------------------------------------------------------------------------------------------

    def begin(self) -> None:
        """Forget everything: at rest for ever."""
        rest = [*memory.IDENTITY * len(self.memory.branches), *([0.0] if self.memory.softening else [])]
        self.values.x.array.reshape(-1, self.size)[:] = rest
        self._creep = 0.0
        self.prepare()

    def prepare(self) -> None:
        """Compute what the energy of a step has of its beginning, once, because the step's length or beginning has changed."""
        self.prepared += 1
        begun = self.begun.x.array.reshape(-1, self.width)
        if self.step.value:
            begun[self.places] = self.at_points(self._begin, self.width)
            return
        begun[:] = self.at_once(self.values.x.array.reshape(-1, self.size))

    def at_once(self, values: Array) -> Array:
        """Return ``begun`` of a step of no length, which is ``values``, shape (points, size)."""
        begun = np.zeros((len(values), self.width))
        for k, start in enumerate(self._starts[:-1]):
            begun[:, start : start + SIX] = values[:, SIX * k : SIX * (k + 1)]
        if self.memory.softening is not None:
            begun[:, -1] = values[:, -1]
        return begun

    def at_points(self, expression: fem.Expression, width: int) -> Array:
        """Return the values of an expression, shape (cells, points, width)."""
        values, cells = np.empty((*self.places.shape, width)), self.region.cells
        for first in range(0, len(cells), MAX_CELLS_AT_ONCE):
            some = slice(first, first + MAX_CELLS_AT_ONCE)
            values[some] = expression.eval(self.body.mesh, cells[some]).reshape(-1, *values.shape[1:])
        return values

    def trial(self) -> tuple[float, float]:
        """Look at the end of the step, in the state that the functions hold; return the largest error of the branches' stress
        in the step, and the largest stress, in shear moduli, on all ranks."""
        comm, self._next = self.body.mesh.comm, np.empty(0)
        self._next = self.at_points(self._updated, self.size + 3)
        error, size = (mpi.largest(comm, float(self._next[..., i].max(initial=0.0))) for i in (-3, -2))
        return error, size

    def advance(self) -> None:
        """Make the end of the step that `trial` has looked at the beginning of the next."""
        self._creep += mpi.total(self.body.mesh.comm, float((self._next[..., -1] @ self._weights).sum()))
        self.values.x.array.reshape(-1, self.size)[self.places] = self._next[..., :-3]
        self._next = np.empty(0)

    @property
    def step_bytes(self) -> float:
        """Bytes on this rank that a step takes beside what is there already: its end, a copy of its beginning, and what DOLFINx
        gathers of ``begun`` for an assembly."""
        return 8.0 * self.places.size * ((self.size + 3) + self.size + self.width)

    @property
    def dissipated(self) -> float:
        """Energy that branches and softening have dissipated until the step began, dimensionless, on all ranks."""
        return self._creep + mpi.total(self.body.mesh.comm, fem.assemble_scalar(self._hurt))

    def stress(self) -> Array:
        """Return the Cauchy stress where the step begins, without the pressure that keeps the volume, in shear moduli, shape
        (cells, points, 3, 3)."""
        stress = self.at_points(self._stress, 9)
        return stress.reshape(*stress.shape[:2], 3, 3)

    def save(self) -> tuple[Array, float]:
        """Return a copy of all that is remembered; see `component.Checkpoint`."""
        return self.values.x.array.copy(), self._creep

    def restore(self, saved: tuple[Array, float]) -> None:
        self.values.x.array[:], self._creep = saved
        self.prepare()


def instant_stiffness(body: Body, region: regions.MaterialRegion, displacement: Expr, w: fem.Function) -> fem.Form:
    """Return the second derivative of the energy of a branch of share 1, relaxed in the state w, at its first instant: a
    bilinear form in the region's small-strain shear modulus, twice the product of the deviators of two small strains of the
    deformed body. Its stress there is none, and any spring has this stiffness."""
    F = body.deformation_gradient(displacement)

    def deviator(argument: Expr) -> Expr:
        return ufl.dev(ufl.sym(ufl.derivative(F, w, argument) * ufl.inv(F)))

    space = w.function_space
    strains = deviator(ufl.TestFunction(space)), deviator(ufl.TrialFunction(space))
    return fem.form(2 * ufl.inner(*strains) * body.hoop * region.dx, jit_options=compiling.JIT)


SIX = len(memory.IDENTITY)
MAX_CELLS_AT_ONCE = 4096
"""Number of cells whose expressions are evaluated at once: of all together what they need would take gigabytes."""

FLOW_PARAMETERS = ("onset", "exponent", "least", "growth", "growth_exponent")


def _constants(mesh: meshes.Mesh, branch: memory.Branch) -> types.SimpleNamespace:
    """Return what `memory.fluidity` takes of a branch, as constants."""
    spring = [tuple(fem.Constant(mesh, value) for value in term) for term in branch.spring]
    return types.SimpleNamespace(
        **{name: fem.Constant(mesh, float(getattr(branch, name))) for name in FLOW_PARAMETERS}, spring=spring
    )


def _numbers(flow: types.SimpleNamespace, branch: memory.Branch) -> list[tuple[fem.Constant, npt.NDArray[np.inexact]]]:
    """Return these constants with their values of a branch."""
    numbers = [(getattr(flow, name), np.asarray(getattr(branch, name))) for name in FLOW_PARAMETERS]
    for constants, term in zip(flow.spring, branch.spring, strict=True):
        numbers += zip(constants, map(np.asarray, term), strict=True)
    return numbers


# ----------------------------------------------------------------------------------------------------------------------
# Mass, and the motion of a device: inertia as one more term of a step's potential.
#
# Generalised-alpha (Chung and Hulbert 1993, doi 10.1115/1.2900803) in the form of Arnold and Brüls (2007, doi
# 10.1007/s11044-007-9084-0). With the potential Pi of a step, which holds the memory's increment, and the air's pressure P
# where the step ends, the equation of motion holds there, for the acceleration w'':
#
#     M w''_1 + dPi/dw(w_1, P_1) = 0
#     (1 - am) a_1 + am a_0 = (1 - af) w''_1 + af w''_0
#     w_1 = w_0 + dt v_0 + dt^2 ((1/2 - beta) a_0 + beta a_1),      v_1 = v_0 + dt ((1 - gamma) a_0 + gamma a_1)
#
# The first two lines are Chung and Hulbert's balance of mean inertia and mean forces, (1 - af) f_1 + af f_0: elastic forces,
# follower pressure, memory and contact are all means of those at both ends. Without a_1,
#
#     w''_1 = c (w_1 - w*),    c = (1 - am) / ((1 - af) beta dt^2),
#     w* = w_0 + dt v_0 + dt^2 (1/2 - beta) a_0 + dt^2 beta (af w''_0 - am a_0) / (1 - am)
#
# so that w_1 makes Pi + c/2 |w - w*|^2 stationary, in the norm of M: the step is an equilibrium with one more term, of known M,
# w* and c. A rigid part's nodes have their mass like others, and Pi's constraints stay what they are.
#
# By the spectral radius rho at infinite frequency: am = (2 rho - 1)/(rho + 1), af = rho/(rho + 1), gamma = 1/2 - am + af,
# beta = (1 - am + af)^2/4. All are of second order; rho = 1 is the trapezoidal rule.


SPECTRAL_RADIUS = 0.9
"""Default of the spectral radius: what one step leaves of a vibration that it is far too long for."""
MAX_SPECTRAL_RADIUS = 0.99
"""Largest one of a run: at 1 the pressure-like unknown of incompressible silicone keeps every error for ever, and after some
tens of periods the steps become short."""
STEP_RATIO_AFTER_JUMP, FIRST_STEP_RATIO = 1e-2, 1e-3
"""First step after a jump of a pressure or force, over the last one; and the first of all, over the stage and over the time in
which a shear wave crosses the device."""
MIN_DISPLACEMENT_SCALE = 1e-2
"""Displacement (rms), in sizes of the device, below which errors do not count over the displacement itself."""
SCALE_DECAY = 0.95
"""What is left of the scale of errors and forces from one step to the next: within a vibration both pass zero, and neither the
step nor the accuracy of Newton's method should follow."""


class Motion:
    """Displacements, velocities and accelerations from step to step, by owned dofs; times in s, the density in kg/m3, the
    spectral radius at infinite frequency 0 to 1.

    ``size`` is the largest rms displacement so far, in sizes of the device; ``unit`` the square of the unit of time, a
    density times squared sizes over the shear modulus; ``last`` the length of the last step, 0 before the first. ``force``
    and ``rounding`` are the size of the forces of inertia in the state that was looked at last, and not less than what is
    left of those before, and of their rounding errors: in short steps they come from small differences of places.
    """

    def __init__(self, system: component.Equations, inertia: assembly.Inertia, density: float, radius: float = SPECTRAL_RADIUS):
        self.comm, self.n = system.comm, system.n
        self.radius = radius
        self._am, self._af = (2 * radius - 1) / (radius + 1), radius / (radius + 1)
        self._gamma, self._beta = 0.5 - self._am + self._af, (1 - self._am + self._af) ** 2 / 4
        self.unit = density * system.length_unit**2 / system.stress_unit
        self._M = assembly.mass_matrix(system, inertia, ())  # with the rows of held dofs: their supports bear inertia too
        self._of_free = assembly.mass_matrix(system, inertia)
        self._x, self._Mx = self._M.createVecRight(), self._M.createVecLeft()
        if system.mixed:
            dofs = np.asarray(system.space.sub(0).collapse()[1])
            self._of_p = np.setdiff1d(np.arange(self.n), dofs)
        else:
            self._of_p = np.empty(0, dtype=np.int64)
        integrand = fem.Constant(system.body.mesh, 1.0) * system.body.hoop
        volumes = [system.integral(system.form(integrand * region.dx)) for region in system.matter]
        self._mass = sum(density * volume for density, volume in zip(inertia.densities, volumes, strict=True))
        self._mass += sum(mass for _, mass in inertia.faces)
        self.force = self.rounding = 0.0
        self._reset(np.zeros(self.n))

    def _reset(self, w: Array) -> None:
        """Be at rest in a state."""
        self._w = self._displacement(w)
        self._v, self._a, self._acceleration = (np.zeros(self.n) for _ in range(3))
        self.size = self.last = self._recent = self._step = self._c = self._strong = 0.0
        self._far, self.fresh = self._acceleration, True

    def _displacement(self, w: Array) -> Array:
        displacement: Array = w[: self.n].copy()
        displacement[self._of_p] = 0.0
        return displacement

    # -- the term of the potential ------------------------------------------------------------------------------------

    def begin(self, step: float) -> None:
        """Begin a step of a length; with none the forces of inertia are those of the last state, wherever the device is."""
        self._step = step
        if not step:
            self._c, self._far = 0.0, self._acceleration
            return
        am, af, beta = self._am, self._af, self._beta
        self._c = (1 - am) / ((1 - af) * beta * step**2)
        mean = (0.5 - beta) * self._a + beta / (1 - am) * (af * self._acceleration - am * self._a)
        self._far = -self._c * (step * self._v + step**2 * mean)  # c (w_0 - w*)

    def accelerated(self, w: Array) -> Array:
        """Return the acceleration in a state at the end of the step."""
        return self._c * (self._displacement(w) - self._w) + self._far

    def predicted(self, w: Array) -> Array:
        """Return local dofs with the displacement that the last acceleration leads to."""
        if not self._c:
            return w
        predicted = w.copy()
        moved = self._w + (self._acceleration - self._far) / self._c
        moved[self._of_p] = w[self._of_p]
        predicted[: self.n] = moved
        return predicted

    def add_forces(self, w: Array, b: Array) -> None:
        """Add the forces of inertia to owned entries ``b``."""
        of_places = np.finfo(float).eps * self._c * self.unit * self._times(self._displacement(w))
        self.rounding = math.sqrt(mpi.total(self.comm, float(of_places @ of_places)))
        forces = self.unit * self._times(self.accelerated(w))
        self.force = max(math.sqrt(mpi.total(self.comm, float(forces @ forces))), self._strong)
        b[: self.n] += forces

    def add_product(self, x: Array, y: Array) -> None:
        """Add the second derivative times owned entries ``x`` to ``y``."""
        if self._c:
            y[: self.n] += self.unit * self._c * self._times(x[: self.n])

    def add_to(self, K: PETSc.Mat) -> None:
        """Add the second derivative to a tangent with the pattern of the cells' dofs."""
        if self._c:
            K.axpy(self.unit * self._c, self._of_free, K.Structure.SUBSET)  # type: ignore[arg-type]

    def _times(self, x: Array) -> Array:
        """Return M x; a view that the next call overwrites."""
        self._x.array_w[:] = x
        self._M.mult(self._x, self._Mx)
        return self._Mx.array_r

    def _rms(self, x: Array) -> float:
        return math.sqrt(max(mpi.total(self.comm, float(x @ self._times(x))), 0.0) / self._mass)

    # -- from step to step --------------------------------------------------------------------------------------------

    def error(self, w: Array) -> float:
        """Return the error of the displacement by the length of a step that ends in w, over the largest displacement.

        It is that of Newmark's rule against a linear acceleration: dt^2 (beta - 1/6) (a_1 - a_0) (Zienkiewicz and Xie 1991,
        doi 10.1002/eqe.4290200907), rms over the mass; and not less than what is left of the last steps' errors.
        """
        off = self._step**2 * abs(self._beta - 1 / 6) * self._rms(self._mean_at_end(self.accelerated(w)) - self._a)
        error = off / max(self.size, self._rms(self._displacement(w)), MIN_DISPLACEMENT_SCALE)
        longer = (self._step / self.last) ** 3 if self.last else 0.0
        # Rounded, so that the steps do not depend on the rounding errors of a state.
        return float(f"{max(error, SCALE_DECAY * self._recent * min(longer, 1.0)):.2g}")

    def _mean_at_end(self, acceleration: Array) -> Array:
        """Return a where the step ends."""
        am, af = self._am, self._af
        return ((1 - af) * acceleration + af * self._acceleration - am * self._a) / (1 - am)

    def commit(self, w: Array, reset: bool = False) -> None:
        """Accept a state: the end of the step, or, without one, a place where the device is put with its velocities."""
        if reset:
            self._reset(w)
        elif not self._step:
            self._w = self._displacement(w)
        else:
            self._recent = self.error(w)
            acceleration, step = self.accelerated(w), self._step
            forces = self.unit * self._times(acceleration)
            self._strong = SCALE_DECAY * max(math.sqrt(mpi.total(self.comm, float(forces @ forces))), self._strong)
            a = self._mean_at_end(acceleration)
            self._v = self._v + step * ((1 - self._gamma) * self._a + self._gamma * a)
            self._a = acceleration if self.fresh else a
            self._w, self._acceleration, self.last, self.fresh = self._displacement(w), acceleration, step, False
        self.size = max(self.size, self._rms(self._w))
        self.begin(0.0)

    def jump(self) -> None:
        """A force jumps: the acceleration after it is that where a first, very short step ends."""
        self.fresh = True

    def first_step(self, duration: float) -> float:
        """Return the length in s of the first step of a stage."""
        step = (self.last or FIRST_STEP_RATIO * duration) * (STEP_RATIO_AFTER_JUMP if self.fresh else 1.0)
        return max(step, FIRST_STEP_RATIO * math.sqrt(self.unit))

    @property
    def kinetic(self) -> float:
        """Kinetic energy, dimensionless."""
        return self.unit / 2 * mpi.total(self.comm, float(self._v @ self._times(self._v)))

    def save(self) -> dict[str, object]:
        """Return all that is known of the last state (arrays are replaced, never changed); see `component.Checkpoint`."""
        return dict(self.__dict__)

    def restore(self, saved: dict[str, object]) -> None:
        self.__dict__.update(saved)
        self.begin(0.0)
