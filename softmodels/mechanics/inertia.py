"""Mass, and the motion of a device: inertia as one more term of a step's potential.

Generalised-alpha (Chung and Hulbert 1993, doi 10.1115/1.2900803) in the form of Arnold and Brüls (2007, doi
10.1007/s11044-007-9084-0). With the potential Pi of a step, which holds the memory's increment, and the air's pressure P where
the step ends, the equation of motion holds there, for the acceleration w'':

    M w''_1 + dPi/dw(w_1, P_1) = 0
    (1 - am) a_1 + am a_0 = (1 - af) w''_1 + af w''_0
    w_1 = w_0 + dt v_0 + dt^2 ((1/2 - beta) a_0 + beta a_1),      v_1 = v_0 + dt ((1 - gamma) a_0 + gamma a_1)

The first two lines are Chung and Hulbert's balance of mean inertia and mean forces, (1 - af) f_1 + af f_0: elastic forces,
follower pressure, memory and contact are all means of those at both ends. Without a_1,

    w''_1 = c (w_1 - w*),    c = (1 - am) / ((1 - af) beta dt^2),
    w* = w_0 + dt v_0 + dt^2 (1/2 - beta) a_0 + dt^2 beta (af w''_0 - am a_0) / (1 - am)

so that w_1 makes Pi + c/2 |w - w*|^2 stationary, in the norm of M: the step is an equilibrium with one more term, of known M,
w* and c. A rigid part's nodes have their mass like others, and Pi's constraints stay what they are.

By the spectral radius rho at infinite frequency: am = (2 rho - 1)/(rho + 1), af = rho/(rho + 1), gamma = 1/2 - am + af,
beta = (1 - am + af)^2/4. All are of second order; rho = 1 is the trapezoidal rule.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from softmodels.common.arrays import Array
from softmodels.common.lazy import PETSc, fem, ufl
from softmodels.mechanics.assembly import sparse_matrix
from softmodels.mechanics.compiling import JIT
from softmodels.mechanics.component import Equations
from softmodels.mechanics.mpi import total


@dataclasses.dataclass(frozen=True)
class Inertia:
    """What a device weighs, in densities of its main material and sizes of the device: densities of its materials, as in
    `System.matter`, and masses of the slice spread evenly over faces."""

    densities: tuple[float, ...]
    faces: tuple[tuple[str, float], ...] = ()

    @property
    def plain(self) -> bool:
        """Whether it is that of unit density."""
        return not self.faces and set(self.densities) == {1.0}


def mass_matrix(
    system: Equations, inertia: Inertia | None = None, held: Sequence[fem.DirichletBC] | None = None
) -> PETSc.Mat:
    """Return the displacement's mass matrix by all dofs, of unit density without masses; rows and columns of held dofs (by
    default all that the system holds) are empty."""
    bcs = system.bcs if held is None else held
    test, trial = ufl.TestFunction(system.space), ufl.TrialFunction(system.space)
    u, v = (system.body.displacement(ufl.split(f)[0] if system.mixed else f) for f in (trial, test))
    work, mesh = ufl.inner(u, v) * system.body.hoop, system.body.mesh
    form = work * ufl.Measure("dx", mesh, metadata={"quadrature_degree": 4})
    if inertia is not None and set(inertia.densities) != {1.0}:
        density = fem.Function(fem.functionspace(mesh, ("DG", 0)))
        for region, value in zip(system.matter, inertia.densities, strict=True):
            density.x.array[region.cells] = value
        density.x.scatter_forward()
        form = density * work * ufl.Measure("dx", mesh, metadata={"quadrature_degree": 4})
    matrix = sparse_matrix(fem.form(form, jit_options=JIT), bcs, 0.0)
    for face, mass in inertia.faces if inertia else ():
        measure, one = system.body.sheet_face(face)[0], fem.Constant(mesh, 1.0)
        area = system.integral(fem.form(one * system.body.hoop * measure, jit_options=JIT))
        spread = fem.form(fem.Constant(mesh, mass / area) * work * measure, jit_options=JIT)
        plate = sparse_matrix(spread, bcs, 0.0)
        matrix.axpy(1.0, plate, matrix.Structure.DIFFERENT)  # type: ignore[arg-type]
        plate.destroy()
    return matrix


RADIUS = 0.9
"""Default of the spectral radius: what one step leaves of a vibration that it is far too long for."""
LARGEST_RADIUS = 0.99
"""Largest one of a run: at 1 the pressure-like unknown of incompressible silicone keeps every error for ever, and after some
tens of periods the steps become short."""
FRESH, FIRST = 1e-2, 1e-3
"""First step after a jump of a pressure or force, over the last one; and the first of all, over the stage and over the time in
which a shear wave crosses the device."""
SMALL = 1e-2
"""Displacement (rms), in sizes of the device, below which errors do not count over the displacement itself."""
FADING = 0.95
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

    def __init__(self, system: Equations, inertia: Inertia, density: float, radius: float = RADIUS):
        self.comm, self.n = system.comm, system.n
        self.radius = radius
        self._am, self._af = (2 * radius - 1) / (radius + 1), radius / (radius + 1)
        self._gamma, self._beta = 0.5 - self._am + self._af, (1 - self._am + self._af) ** 2 / 4
        self.unit = density * system.length_unit**2 / system.stress_unit
        self._M = mass_matrix(system, inertia, ())  # with the rows of held dofs: their supports bear inertia too
        self._of_free = mass_matrix(system, inertia)
        self._x, self._Mx = self._M.createVecRight(), self._M.createVecLeft()
        if system.mixed:
            dofs = np.asarray(system.space.sub(0).collapse()[1])
            self._of_p = np.setdiff1d(np.arange(self.n), dofs)
        else:
            self._of_p = np.empty(0, dtype=np.int64)
        one = fem.Constant(system.body.mesh, 1.0) * system.body.hoop
        volumes = [system.integral(system.form(one * region.dx)) for region in system.matter]
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
        found: Array = w[: self.n].copy()
        found[self._of_p] = 0.0
        return found

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
        found = w.copy()
        moved = self._w + (self._acceleration - self._far) / self._c
        moved[self._of_p] = w[self._of_p]
        found[: self.n] = moved
        return found

    def add_forces(self, w: Array, b: Array) -> None:
        """Add the forces of inertia to owned entries ``b``."""
        of_places = np.finfo(float).eps * self._c * self.unit * self._times(self._displacement(w))
        self.rounding = math.sqrt(total(self.comm, float(of_places @ of_places)))
        forces = self.unit * self._times(self.accelerated(w))
        self.force = max(math.sqrt(total(self.comm, float(forces @ forces))), self._strong)
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
        return math.sqrt(max(total(self.comm, float(x @ self._times(x))), 0.0) / self._mass)

    # -- from step to step --------------------------------------------------------------------------------------------

    def error(self, w: Array) -> float:
        """Return the error of the displacement by the length of a step that ends in w, over the largest displacement.

        It is that of Newmark's rule against a linear acceleration: dt^2 (beta - 1/6) (a_1 - a_0) (Zienkiewicz and Xie 1991,
        doi 10.1002/eqe.4290200907), rms over the mass; and not less than what is left of the last steps' errors.
        """
        off = self._step**2 * abs(self._beta - 1 / 6) * self._rms(self._mean_at_end(self.accelerated(w)) - self._a)
        error = off / max(self.size, self._rms(self._displacement(w)), SMALL)
        longer = (self._step / self.last) ** 3 if self.last else 0.0
        # Rounded, so that the steps do not depend on the rounding errors of a state.
        return float(f"{max(error, FADING * self._recent * min(longer, 1.0)):.2g}")

    def _mean_at_end(self, acceleration: Array) -> Array:
        """Return a where the step ends."""
        am, af = self._am, self._af
        return ((1 - af) * acceleration + af * self._acceleration - am * self._a) / (1 - am)

    def keep(self, w: Array, anew: bool = False) -> None:
        """Accept a state: the end of the step, or, without one, a place where the device is put with its velocities."""
        if anew:
            self._reset(w)
        elif not self._step:
            self._w = self._displacement(w)
        else:
            self._recent = self.error(w)
            acceleration, step = self.accelerated(w), self._step
            forces = self.unit * self._times(acceleration)
            self._strong = FADING * max(math.sqrt(total(self.comm, float(forces @ forces))), self._strong)
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
        step = (self.last or FIRST * duration) * (FRESH if self.fresh else 1.0)
        return max(step, FIRST * math.sqrt(self.unit))

    @property
    def kinetic(self) -> float:
        """Kinetic energy, dimensionless."""
        return self.unit / 2 * total(self.comm, float(self._v @ self._times(self._v)))

    def copied(self) -> dict[str, object]:
        """Return all that is known of the last state, for `restore`: arrays are replaced, never changed."""
        return dict(self.__dict__)

    def restore(self, kept: dict[str, object]) -> None:
        self.__dict__.update(kept)
        self.begin(0.0)
