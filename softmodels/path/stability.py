"""Points of a path and their stability: the signature of the tangent, its lowest eigenvalues, and their modes.

A state is stable under a given pressure if the tangent K is positive definite on the displacements, and under a given
volume if it is so on those that keep the volume. Both follow from the inertia of the factorised K (Sylvester's law):

* Mixed form: each of the n_p unknowns of p adds one negative pivot to a stable K, since eliminating them from the bottom
  leaves the displacements' own stiffness (Haynsworth 1968, doi 10.1016/0024-3795(68)90050-5). The excess over n_p is
  the number of K's negative eigenvalues: the directions in which the energy falls.
* Holding the volume removes one of them if the compliance dV/dP = q.K^-1 q is negative.
* Volumes held independently of the control are accounted for in both (`Bordered.negative_eigenvalues`).

Eigenvalues are of K x = lambda M x with the displacement's mass matrix M (of unit density): they do not depend on the mesh's
cells, and lambda / density is the square of a natural frequency. M has no entries for p, which is then slaved to u. With
`Inertia` M also has what other regions and plates weigh.
"""

from __future__ import annotations

import abc
import contextlib
import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.common.lazy import PETSc, fem, scipy
from softmodels.mechanics import assembly, component, controls, newton
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State


class Stability:
    """Signatures of a device's states, with its masses, or of unit density as along a path. One per `Solver`; see `of`."""

    def __init__(self, solver: Solver, inertia: assembly.Inertia | None = None):
        self.solver = solver
        eq = solver.system
        self.mass = assembly.mass_matrix(eq, inertia)
        self.M = eq.unknowns.projected(self.mass)
        self.unknowns = eq.K.getSize()[0]
        self.spectrum = spectrum_of(solver, self.M)
        self.start()

    @classmethod
    def of(cls, solver: Solver) -> Stability:
        """Return the instance of a solver, created at the first call."""
        stability = getattr(solver, "_stability", None)
        if stability is None:
            stability = cls(solver)
            solver._stability = stability  # type: ignore[attr-defined]
        return stability

    def start(self) -> None:
        """Drop the known modes and start from a shape with a part of every mode, the same on any number of ranks.

        Every search for modes begins with it, so that the result depends only on the state, not on the history.
        """
        eq = self.solver.system
        shape, d = fem.Function(eq.space), eq.body.mesh.geometry.dim
        seeds = [self.M.createVecRight() for _ in range(d)]

        def rough(x: Array) -> Array:
            waves = np.array([[1.7, 2.3, 2.9], [3.1, 1.3, 2.1], [2.7, 3.3, 1.9]])
            return np.sin(waves[:d] @ x + 0.5) + 0.3 * np.sin(3.7 * waves[:d] @ x)

        for turn, seed in enumerate(seeds):
            (shape.sub(0) if eq.mixed else shape).interpolate(lambda x, turn=turn: np.roll(rough(x), turn, axis=0))
            for bc in eq.bcs:
                bc.set(shape.x.array, alpha=0.0)
            seed.array_w[:] = eq.unknowns.project(shape.x.array)
        self.spectrum.seeds = seeds
        self.sense = self.M.createVecLeft()  # fixes the sign of a mode
        self.M.mult(seeds[0], self.sense)
        self.reference = self.largest = self._guess = 0.0
        self.modes: Sequence[PETSc.Vec] = []

    # -- along a path -------------------------------------------------------------------------------------------------

    def wants(self, state: State) -> bool:
        """Return whether the signature at this state needs a factorisation of its own.

        It does where faces are pressed on: a kept K has other places in contact, and corrections by its inverse creep.
        """
        system = self.solver.system
        turns = system.unknowns.turns
        if self.unknowns <= SMALL_SYSTEM or not self.modes or turns or system.assembled.touches(state.w):
            return True
        try:
            self._guess = self.spectrum.corrected(state, self.modes)
        except newton.NoConvergence:
            return True
        return self._guess < NEAR_CRITICAL_RATIO * self.reference

    def signature(self, exact: bool, known: int = 0) -> Signature:
        """Return the signature of the state passed to `wants`: of K if factorised there, else with the last
        known number."""
        if not exact:
            return Signature(known, self._guess, exact=False)
        value = self.lowest()
        return Signature(self.negative_eigenvalues(), value)

    def lowest(self) -> float:
        """Return the lowest eigenvalue of the factorised K; nan if it did not converge."""
        self.solver.system.unknowns.projected(self.mass, self.M)
        try:
            value, self.modes = self.spectrum.lowest(self.modes)
        except newton.NoConvergence:
            self.modes = []
            return math.nan
        self.reference = abs(value)
        self.largest = max(self.largest, self.reference)
        return value

    def critical_lowest(self, state: State, negative: int) -> float:
        """Return the lowest eigenvalue where K is singular in one mode more than ``negative`` ones; K may be factorised there.

        Zero where none is negative; else that of K with its singular mode, which leaves the others as they are.
        """
        if not negative:
            return 0.0
        self.solver.factorise(state)
        reference, largest = self.reference, self.largest
        value = self.lowest()
        self.reference, self.largest = reference, largest
        return 0.0 if abs(value) < SINGULAR_TOLERANCE * largest else value

    def negative_eigenvalues(self) -> int:
        """Return the negative eigenvalues of the factorised K beyond those of a stable one."""
        return self.spectrum.negative_eigenvalues

    # -- at one state -------------------------------------------------------------------------------------------------

    def eigenpairs(self, state: State, count: int = 4, springs: Springs | None = None) -> list[tuple[float, Array]]:
        """Return at least so many eigenvalues (dimensionless) nearest zero and their modes (shape as `State.w`, largest entry
        1 or -1), rising, by shift and invert through K factorised at the state. Springs are added to K; see
        `Spectrum.pairs`."""
        self.solver.factorise(state)
        self.solver.system.unknowns.projected(self.mass, self.M)
        pairs = [(value, self._mode(vector)) for value, vector in self.spectrum.pairs(count, springs)]
        return sorted(pairs, key=lambda pair: pair[0])

    def with_responses(
        self, shapes: Sequence[Array], stiffnesses: Sequence[PETSc.Mat], springs: Springs
    ) -> tuple[Array, list[Array]]:
        """Return K and further stiffnesses of the dofs over a space of n modes, each of length 1 in the norm of M and before
        all others, and of the static responses to the further stiffnesses' forces on them, shapes (m, m).

        K is factorised at the modes' state. What these stiffnesses hold back low modes alone would not show: a beam whose
        sides are held bends as one that is stiffer.
        """
        unknowns = self.solver.system.unknowns
        pencil, _ = springs.added_to(self.spectrum.pencil())
        space, force = Space(pencil), self.M.createVecLeft()
        for shape in shapes:
            mode = self.M.createVecRight()
            mode.array_w[:] = unknowns.project(shape)
            space.add(mode)
        matrices = [unknowns.projected(matrix) for matrix in stiffnesses]
        for matrix in matrices:
            for mode in space.x[: len(shapes)]:
                matrix.mult(mode, force)
                response = self.M.createVecRight()
                pencil.solve(force, response, EIGENVALUE_SOLVE_TOLERANCE)
                space.add(response)
        products = []
        for matrix in matrices:
            rows = np.empty((len(space.x), len(space.x)))
            for row, x in zip(rows, space.x, strict=True):
                matrix.mult(x, force)
                row[:] = force.mDot(space.x)
            products.append(rows)
        return space.K, products

    def _mode(self, vector: PETSc.Vec) -> Array:
        function = fem.Function(self.solver.system.space)
        self.solver.system.unknowns.to_dofs(vector.array_r, function.x.array)
        function.x.scatter_forward()
        # The largest entry alone would make the sign of an antisymmetric mode depend on rounding.
        largest = max(vector.max()[1], -vector.min()[1])
        scaled = function.x.array / math.copysign(largest, vector.dot(self.sense))
        return np.concatenate([scaled, np.zeros(len(self.solver.system.coupling.constraints))])

    def critical(self, state: State, index: int) -> tuple[float, Array]:
        """Return the eigenvalue that is number ``index`` (from 0) in rising order, and its mode; K is factorised at the
        state."""
        pairs = self.eigenpairs(state)
        negative = self.negative_eigenvalues()
        rank = negative - sum(value < 0 for value, _ in pairs)  # negative ones farther from zero than those found
        chosen = min(max(index - rank, 0), len(pairs) - 1)
        return pairs[chosen]

    def like(self, state: State, shape: Array) -> tuple[float, Array]:
        """Return the eigenvalue whose mode is closest to that of a neighbouring state (local dofs), and its mode, to track it
        past crossings with others; K is factorised at the state. `NoConvergence` if no mode is like it."""
        measure = Mode(self.mass, shape)
        pairs = [(abs(measure.share(mode)) / measure.size(mode), value, mode) for value, mode in self.eigenpairs(state, 8)]
        likeness, value, mode = max(pairs, key=lambda pair: pair[0])
        if likeness < MIN_MODE_COSINE:
            raise newton.NoConvergence("its mode could not be tracked between two states")
        return value, mode


# ----------------------------------------------------------------------------------------------------------------------
# Buckling modes as measures of other shapes.


class Mode:
    """A buckling mode (local dofs, shape as `State.w`), as a measure of other shapes by the mass matrix M.

    ``image`` is M times the shape over shape.M.shape, a PETSc vector: its product with dofs is what they have of the shape.
    """

    def __init__(self, M: PETSc.Mat, shape: Array):
        self._M = M
        self._vector, self.image = self._M.createVecRight(), self._M.createVecLeft()
        self._size = self._length(shape)
        self._M.mult(self._vector, self.image)
        self.image.scale(1 / self._size**2)

    @property
    def length(self) -> float:
        """Length of the shape in the norm of M."""
        return self._size

    def share(self, w: Array) -> float:
        """Return the amplitude of the mode in dofs (shape as `State.w`)."""
        self._vector.array_w[:] = w[: self._vector.getLocalSize()]
        return float(self.image.dot(self._vector))

    def size(self, w: Array) -> float:
        """Return the size of dofs in units of the mode."""
        return self._length(w) / self._size

    def _length(self, w: Array) -> float:
        self._vector.array_w[:] = w[: self._vector.getLocalSize()]
        pushed = self._M.createVecLeft()
        self._M.mult(self._vector, pushed)
        return float(self._vector.dot(pushed) ** 0.5)


# ----------------------------------------------------------------------------------------------------------------------
# Davidson's method: eigenvalues of K x = lambda M x nearest zero and all negative ones, with an exact or approximate K^-1.
#
# K is symmetric and may be indefinite, M symmetric and positive except for a null space (the pressures of a mixed form).
# Rayleigh's quotient is made stationary over a growing space. Each new direction is a residual times K^-1, so that the space
# grows as that of inverse iteration does, and with the exact K^-1 as Lanczos' method. It starts from modes known at
# a nearby state, or from any shape in the range of K^-1 M. Davidson 1975, doi 10.1016/0021-9991(75)90065-0; Morgan and
# Scott 1986, doi 10.1137/0907054. Over a space the quotient has no more negative values than K (Cauchy's interlacing), so
# that none is missed once it has as many.


MAX_DIRECTIONS, DIRECTIONS_PER_MODE = 32, 4
"""Size of the space at which it restarts with the best modes; for many modes so many times as many."""
MAX_SOLVES, SOLVES_PER_MODE = 150, 18
"""Default maximum number of solves, after which an eigenvalue counts as not converged; that for each of many modes."""
LOOSE_SOLVE_TOLERANCE, TIGHT_SOLVE_TOLERANCE = 1e-2, 1e-3
"""Tolerances of the solves: looser ones leave inconsistent p, tighter ones do not help."""
ADDED_STIFFNESS_TOLERANCE = 1e-9
"""Tolerance of the solves for added stiffnesses."""
MAX_LAST_CORRECTION = 1e-2
"""Maximum relative change of an eigenvalue by its last correction, whose p may be inconsistent with its displacement."""
MIN_NEW_DIRECTION = 1e-8
"""Minimum remainder of a new direction after orthogonalisation."""


@dataclasses.dataclass(frozen=True, eq=False)
class Pencil:
    """K and M as maps of PETSc vectors: ``product(x, y)`` puts K x into y, M is positive but for a null space, and ``solve(b,
    x, tolerance)`` puts K^-1 b into x, to a relative tolerance."""

    product: Callable[[PETSc.Vec, PETSc.Vec], None]
    M: PETSc.Mat
    solve: Callable[[PETSc.Vec, PETSc.Vec, float], object]


class Space:
    """Directions x, orthonormal in M, with K x and M x."""

    def __init__(self, pencil: Pencil):
        self.pencil = pencil
        self.x: list[PETSc.Vec] = []
        self.Kx: list[PETSc.Vec] = []
        self.Mx: list[PETSc.Vec] = []
        self.K = np.empty((0, 0))

    def add(self, x: PETSc.Vec) -> bool:
        """Add a direction, which is overwritten; return whether it extends the space."""
        M, Mx, Kx = self.pencil.M, self.pencil.M.createVecLeft(), self.pencil.M.createVecLeft()
        M.mult(x, Mx)
        size = x.dot(Mx)
        if not math.isfinite(size) or size <= 0.0:
            return False
        for _ in range(2 if self.x else 0):
            x.maxpy([-share for share in x.mDot(self.Mx)], self.x)
        M.mult(x, Mx)
        left = x.dot(Mx)
        if not left > MIN_NEW_DIRECTION**2 * size:
            return False
        x.scale(left**-0.5)
        Mx.scale(left**-0.5)
        self.pencil.product(x, Kx)
        self.x, self.Kx, self.Mx = [*self.x, x], [*self.Kx, Kx], [*self.Mx, Mx]
        column = np.asarray(Kx.mDot(self.x))
        self.K = np.block([[self.K, column[:-1, None]], [column[None, :-1], column[-1:, None]]])
        return True

    def combined(self, shares: Array, vectors: Sequence[PETSc.Vec]) -> PETSc.Vec:
        made = self.pencil.M.createVecRight()
        made.maxpy([float(share) for share in shares], list(vectors))
        return made

    def cut(self, shares: Array) -> None:
        """Reduce the space to these combinations, columns of an orthogonal matrix."""
        for name in ("x", "Kx", "Mx"):
            setattr(self, name, [self.combined(column, getattr(self, name)) for column in shares.T])
        self.K = shares.T @ self.K @ shares


@dataclasses.dataclass(frozen=True, eq=False)
class Modes:
    """Eigenvalues in rising order, all negative ones among them, and their vectors, of length 1 in the norm of M."""

    values: Array
    vectors: list[PETSc.Vec]

    @property
    def negative(self) -> int:
        return int(np.count_nonzero(self.values < 0.0))


def nearest(
    pencil: Pencil,
    start: Sequence[PETSc.Vec],
    tolerances: Sequence[float],
    most: int = MAX_SOLVES,
    negatives: int | None = None,
) -> Modes:
    """Return the eigenvalues nearest zero, and all negative ones.

    Args:
        pencil: K and M.
        start: Vectors near the modes, or one with a part of each, in the range of K^-1 M.
        tolerances: Of the residual K^-1 (K x - lambda M x), length in the norm of M, for the lowest eigenvalue, the next,
            and so on; as many are looked for. An eigenvalue's error is about the residual's square. Infinite for one that
            is taken as the space has it where the others are found.
        most: Solves after which an eigenvalue counts as not found.
        negatives: How many eigenvalues are negative, where that is known: then K^-1 is the exact one.

    Raises:
        NoConvergence: A residual did not fall below its tolerance, or more eigenvalues are negative.
    """
    space, count = Space(pencil), len(tolerances)
    widest = max(MAX_DIRECTIONS, DIRECTIONS_PER_MODE * count)
    for x in start:
        space.add(x.copy())
    first, lowest, polished = len(space.x), list[float](), dict[int, float]()
    for _ in range(most):
        values, shares = np.linalg.eigh(space.K)
        below = int(np.count_nonzero(values < 0.0))
        if negatives is not None and below > negatives:
            break
        chosen = _chosen(values, shares[:first] if negatives is None else shares, count)
        whole = len(chosen) >= count and negatives in (None, below)
        if len(space.x) > widest:
            first = len(chosen)
            near = [k for k in np.argsort(np.abs(values)) if k not in chosen]
            space.cut(shares[:, [*chosen, *near[:count]]])
            continue
        here = values[chosen]
        slack = max(filter(math.isfinite, tolerances)) ** 2 * np.abs(here).max()
        while lowest and abs(lowest[-1] - here[len(lowest) - 1]) > slack:  # a lower one has appeared since
            lowest.pop()
            polished.pop(len(lowest), None)
        while len(lowest) < len(chosen) and whole and math.isinf(tolerances[min(len(lowest), count - 1)]):
            lowest.append(here[len(lowest)])
        if len(lowest) == len(chosen) and whole:
            best = np.array([polished.get(k, value) for k, value in enumerate(here)])
            return Modes(best, [space.combined(column, space.x) for column in shares[:, chosen].T])
        place = min(len(lowest), len(chosen) - 1)
        tolerance = tolerances[min(place, count - 1)]
        solved = min(LOOSE_SOLVE_TOLERANCE, max(TIGHT_SOLVE_TOLERANCE, tolerance))
        size, new = _correction(space, here[place], shares[:, chosen[place]], solved, negatives is not None)
        if size <= tolerance and len(lowest) < len(chosen):
            lowest.append(here[place])
            polished[place] = _polished(space, here[place], new)
        elif not (math.isfinite(size) and space.add(new)):
            break
    raise newton.NoConvergence("the lowest modes did not converge")


def _polished(space: Space, value: float, new: PETSc.Vec) -> float:
    """Return an eigenvalue over the space with its last correction too, which is not kept: small ones may be only rounding."""
    kept = space.x, space.Kx, space.Mx, space.K
    if not space.add(new):
        return value
    values = np.linalg.eigvalsh(space.K)
    space.x, space.Kx, space.Mx, space.K = kept
    best = float(values[np.argmin(np.abs(values - value))])
    return best if abs(best - value) <= MAX_LAST_CORRECTION * abs(value) else value


def _chosen(values: Array, of_first: Array, count: int) -> npt.NDArray[np.intp]:
    """Return the indices of the values nearest zero, and of the negative ones among the first directions, by rising value.

    Other negative ones far from zero are of directions whose p does not belong to their displacements.
    """
    near = np.argsort(np.abs(values), kind="stable")[:count]
    known = (of_first**2).sum(axis=0) > 0.5
    return np.union1d(near, np.flatnonzero(known & (values < 0.0)))  # values are in rising order


def _correction(space: Space, value: float, shares: Array, tolerance: float, exact: bool) -> tuple[float, PETSc.Vec]:
    """Return K^-1 times the residual of a mode of the space, to a tolerance and without the mode's own part, and its length.

    With the exact K^-1 what lies in the space is rounding, which near a critical point is large: it is left out.
    """
    pencil = space.pencil
    residual, new = pencil.M.createVecLeft(), pencil.M.createVecRight()
    residual.maxpy([float(share) for share in shares], space.Kx)
    residual.maxpy([float(-value * share) for share in shares], space.Mx)
    pencil.solve(residual, new, tolerance)
    inside = np.asarray(new.mDot(space.Mx))
    new.maxpy([float(-share) for share in (inside if exact else inside @ shares * shares)], space.x)
    pencil.M.mult(new, residual)
    return max(new.dot(residual), 0.0) ** 0.5, new


# ----------------------------------------------------------------------------------------------------------------------
# The lowest eigenvalues of a device's tangent, by its factorisation or, without one, by iterations.


TRACKED_MODES = 4
"""Modes of the last factorised point, used to find the lowest eigenvalue of an unfactorised one."""
CORRECTION_TOLERANCE, MAX_CORRECTIONS = 1e-3, 6
"""Residual tolerance of that eigenvalue, and the maximum corrections of its mode by the lagged inverse. If they do not
suffice, the point is factorised."""
EIGENVALUE_SOLVE_TOLERANCE = 1e-10
"""Relative tolerance of back-substitutions that are refined with a single-precision factorisation. Others are not, because
they are only search directions."""
REFINED_MODE_TOLERANCE = 3e-5
"""Residual tolerance of the lowest eigenvalue where K was factorised; the eigenvalue's error is about the square."""
LOWEST_MODE_TOLERANCE, OTHER_MODES_TOLERANCE, BIFURCATION_MODE_TOLERANCE = 3e-4, 5e-2, 1e-5
"""Residual tolerances of modes: the lowest along a path, those kept to start the next search,
and all at a bifurcation."""
NATURAL_MODE_TOLERANCE, HIGH_MODE_TOLERANCE = [1e-4] * 8, 1e-3
"""The same of natural modes, the first ones and those above: of high ones smaller corrections are noise of p."""


def natural(count: int) -> list[float]:
    """Return the tolerances of so many natural modes."""
    return [*NATURAL_MODE_TOLERANCE[:count], *[HIGH_MODE_TOLERANCE] * (count - len(NATURAL_MODE_TOLERANCE))]


@dataclasses.dataclass(frozen=True, eq=False)
class Springs:
    """Stiffnesses k q q^T added to K: the q by K's unknowns, shape (springs, n), and the k above 0; none leave K as it is."""

    columns: Array
    stiffnesses: Array

    def added_to(self, pencil: Pencil) -> tuple[Pencil, int]:
        """Return K + sum k q q^T with M, and how many negative eigenvalues that takes away. Its inverse is Woodbury's; the
        inertia of [[K, q], [q^T, -1/k]] counts them (Haynsworth 1968)."""
        if not len(self.columns):
            return pencil, 0
        columns = [pencil.M.createVecLeft() for _ in self.columns]
        lifted = [pencil.M.createVecRight() for _ in columns]
        for column, entries, x in zip(columns, self.columns, lifted, strict=True):
            column.array_w[:] = entries
            pencil.solve(column, x, ADDED_STIFFNESS_TOLERANCE)
        inner = np.diag(1 / self.stiffnesses) + np.array([[column.dot(x) for x in lifted] for column in columns])

        def product(x: PETSc.Vec, y: PETSc.Vec) -> None:
            pencil.product(x, y)
            for column, k in zip(columns, self.stiffnesses, strict=True):
                y.axpy(float(k) * column.dot(x), column)

        def solve(b: PETSc.Vec, x: PETSc.Vec, tolerance: float) -> None:
            pencil.solve(b, x, tolerance)
            shares = np.linalg.solve(inner, [column.dot(x) for column in columns])
            x.maxpy([-float(share) for share in shares], lifted)

        return Pencil(product, pencil.M, solve), int(np.count_nonzero(np.linalg.eigvalsh(inner) < 0.0))


class Spectrum(abc.ABC):
    """Lowest eigenvalues of a solver's K x = lambda M x; the values of M, by its unknowns, may change.

    ``seeds`` are vectors with a part of every mode. A search begins with the first one; where modes of equal eigenvalues are
    to be told apart, with all.
    """

    seeds: Sequence[PETSc.Vec]

    def __init__(self, solver: Solver, M: PETSc.Mat):
        self.solver, self.M = solver, M

    def _lifted(self, pencil: Pencil, seed: PETSc.Vec) -> PETSc.Vec:
        """Return K^-1 M times a seed."""
        image, lifted = self.M.createVecLeft(), self.M.createVecRight()
        self.M.mult(seed, image)
        pencil.solve(image, lifted, OTHER_MODES_TOLERANCE)
        return lifted

    @abc.abstractmethod
    def pencil(self, refined: bool = True) -> Pencil:
        """Return K and M at the state where K was factorised, with solves that are refined or not."""

    @property
    @abc.abstractmethod
    def negative_eigenvalues(self) -> int:
        """Number of negative eigenvalues of the last factorised or examined K."""

    @abc.abstractmethod
    def lowest(self, modes: Sequence[PETSc.Vec]) -> tuple[float, list[PETSc.Vec]]:
        """Return the lowest eigenvalue at the state where K was factorised, its mode, and approximations of the next ones,
        from those of a state near by, if there are any; `NoConvergence` if it was not found."""

    @abc.abstractmethod
    def corrected(self, state: State, modes: Sequence[PETSc.Vec]) -> float:
        """Return the lowest eigenvalue of another state from modes of the last one, without a new factorisation;
        `NoConvergence` if the mode changes too much between the two."""

    @abc.abstractmethod
    def pairs(self, count: int, springs: Springs | None = None) -> list[tuple[float, PETSc.Vec]]:
        """Return at least so many eigenvalues nearest zero with their vectors, at the state where K was factorised; with
        springs, which are added to K, modes of equal eigenvalues are separated. `NoConvergence` if they were not found."""


def spectrum_of(solver: Solver, M: PETSc.Mat) -> Spectrum:
    """Return the eigenvalue solver that suits a device's linear solver."""
    return (Factorised if solver.bordered.inverse.exact else Iterated)(solver, M)


class Factorised(Spectrum):
    """Eigenvalues by the factorised K and its inertia."""

    def __init__(self, solver: Solver, M: PETSc.Mat):
        super().__init__(solver, M)
        eq = solver.system
        self.constraints = assembly.entries_of(eq.space, 1) - eq.still_pressures if eq.mixed else 0

    @property
    def negative_eigenvalues(self) -> int:
        return self.solver.bordered.negative_eigenvalues() - self.constraints

    def pencil(self, refined: bool = True) -> Pencil:
        bordered = self.solver.bordered

        def solve(b: PETSc.Vec, x: PETSc.Vec, tolerance: float) -> None:
            if refined:
                bordered.solve(b, x, EIGENVALUE_SOLVE_TOLERANCE)
            else:
                bordered.solve_roughly(b, x)

        return Pencil(bordered.K.mult, self.M, solve)

    def _search(self, tolerances: Sequence[float], refined: bool, springs: Springs | None = None) -> Modes:
        """Return the modes of the factorised K, by back-substitutions that are refined or not; see `pairs`."""
        negatives, pencil, seeds, most = self.negative_eigenvalues, self.pencil(refined), self.seeds[:1], MAX_SOLVES
        if springs is not None:
            pencil, removed = springs.added_to(pencil)
            negatives, seeds, most = negatives - removed, self.seeds, max(most, SOLVES_PER_MODE * len(tolerances))
        return nearest(pencil, [self._lifted(pencil, seed) for seed in seeds], tolerances, most, negatives)

    def lowest(self, modes: Sequence[PETSc.Vec]) -> tuple[float, list[PETSc.Vec]]:
        bordered, others = self.solver.bordered, [math.inf] * (TRACKED_MODES - 1)
        lowest: Modes | None = None
        # Pressures that hold volumes are large relative to a small residual.
        if bordered.inverse.rounded and not bordered.constraint_columns:
            with contextlib.suppress(newton.NoConvergence):
                lowest = self._search([REFINED_MODE_TOLERANCE, *others], refined=False)
        lowest = lowest or self._search([REFINED_MODE_TOLERANCE, *others], refined=True)
        return float(lowest.values[0]), lowest.vectors

    def corrected(self, state: State, modes: Sequence[PETSc.Vec]) -> float:
        system, bordered = self.solver.system, self.solver.bordered
        system.load(state)

        def product(x: PETSc.Vec, y: PETSc.Vec) -> None:
            system.tangent_product(x.array_r, y.array_w)

        def solve(b: PETSc.Vec, x: PETSc.Vec, tolerance: float) -> None:
            bordered.solve_roughly(b, x)

        tolerances = [CORRECTION_TOLERANCE, *[math.inf] * (len(modes) - 1)]
        return float(nearest(Pencil(product, self.M, solve), modes, tolerances, MAX_CORRECTIONS).values[0])

    def pairs(self, count: int, springs: Springs | None = None) -> list[tuple[float, PETSc.Vec]]:
        tolerances = [BIFURCATION_MODE_TOLERANCE] * count if springs is None else natural(count)
        modes = self._search(tolerances, refined=True, springs=springs)
        return list(zip(map(float, modes.values), modes.vectors, strict=True))


class Iterated(Spectrum):
    """Eigenvalues by Davidson's method, from state to state: an eigenvalue changes sign only if it is among those nearest
    zero."""

    def __init__(self, solver: Solver, M: PETSc.Mat):
        super().__init__(solver, M)
        self._negative = self._turn = self._counted = 0
        self._modes: Sequence[PETSc.Vec] = ()
        # The lowest mode of the state before the last: the last two modes predict the next.
        self._before: list[PETSc.Vec] = []

    @property
    def negative_eigenvalues(self) -> int:
        """Those of the loaded state; if not converged, those of the state before."""
        if self._counted != self.solver.lagged.updates:
            with contextlib.suppress(newton.NoConvergence):
                self.lowest(self._modes)
        return self._negative

    def _take(self, modes: Modes) -> Modes:
        self._negative, self._counted, self._modes = modes.negative, self.solver.lagged.updates, modes.vectors
        return modes

    def pencil(self, refined: bool = True) -> Pencil:
        solver = self.solver

        def product(x: PETSc.Vec, y: PETSc.Vec) -> None:
            solver.system.tangent_product(x.array_r, y.array_w)

        def solve(b: PETSc.Vec, x: PETSc.Vec, tolerance: float) -> None:
            solver.bordered.iterate(b, x, tolerance)
            solver.bordered.keep_volumes(x)  # only to the last digits: a loose solve changes them slightly

        return Pencil(product, self.M, solve)

    def _start(self, modes: Sequence[PETSc.Vec]) -> Sequence[PETSc.Vec]:
        """Return the starting vectors of a search: the known modes, or vectors in the range of K^-1 M, with held
        volumes kept."""
        if modes:
            kept = [mode.copy() for mode in modes]
            for mode in kept:
                self.solver.bordered.keep_volumes(mode)
            return kept
        return [self._lifted(self.pencil(), self.seeds[0])]

    def lowest(self, modes: Sequence[PETSc.Vec]) -> tuple[float, list[PETSc.Vec]]:
        tolerances = [LOWEST_MODE_TOLERANCE, *[OTHER_MODES_TOLERANCE] * (TRACKED_MODES - 1)]
        if modes:  # one of the others in turn
            self._turn = self._turn % (TRACKED_MODES - 1) + 1
            tolerances = [OTHER_MODES_TOLERANCE if k == self._turn else math.inf for k in range(TRACKED_MODES)]
            tolerances[0] = LOWEST_MODE_TOLERANCE
        lowest = self._take(nearest(self.pencil(), self._start([*modes, *self._before] if modes else ()), tolerances))
        self._before = list(modes[:1])
        return float(lowest.values[0]), lowest.vectors

    def corrected(self, state: State, modes: Sequence[PETSc.Vec]) -> float:
        raise newton.NoConvergence("every state is examined separately, at the cost of a few solves")

    def pairs(self, count: int, springs: Springs | None = None) -> list[tuple[float, PETSc.Vec]]:
        if springs is None:
            modes = self._take(nearest(self.pencil(), self._start(()), [BIFURCATION_MODE_TOLERANCE] * count))
        else:
            pencil, _ = springs.added_to(self.pencil())
            most = max(MAX_SOLVES, SOLVES_PER_MODE * count)
            modes = nearest(pencil, [self._lifted(pencil, seed) for seed in self.seeds], natural(count), most)
        return list(zip(map(float, modes.values), modes.vectors, strict=True))


SMALL_SYSTEM = 6000
"""Number of unknowns up to which every point is factorised, which costs no more than the iterations it saves."""
NEAR_CRITICAL_RATIO = 0.4
"""Ratio of the lowest eigenvalue to that at the last factorised point below which a larger system is factorised too."""
SINGULAR_TOLERANCE = 1e-6
"""Eigenvalue relative to the largest on the path below which K counts as singular."""

MIN_MODE_COSINE = 0.6
"""Cosine of the angle between two modes (in the inner product of M) above which they are the same mode at two states."""


@dataclasses.dataclass(frozen=True)
class Signature:
    """Stability of a state.

    Attributes:
        negative_eigenvalues: Of the tangent at a given pressure: directions in which the energy falls; 0 if stable.
        lowest: Lowest eigenvalue, dimensionless (shear moduli over squared sizes), to 1e-9 of itself, or to 1e-4 where it is
            not exact; nan if it was not found.
        exact: Whether K was factorised here. Else their number is the last factorised point's, and the eigenvalue has kept
            away from zero since.
    """

    negative_eigenvalues: int = 0
    lowest: float = 0.0
    exact: bool = True


# ----------------------------------------------------------------------------------------------------------------------
# Vibrations of a damped device, from its relaxed modes and the responses to what relaxes.


MAX_ROOT_ITERATIONS = 500
"""Each at least halves the error: the branches' stiffness changes by less than a quarter of the whole per octave."""
ROOT_TOLERANCE = 1e-12


type Stiffening = Callable[[complex], npt.NDArray[np.inexact]]


def damped_roots(values: Array, relaxed: Array, creeping: Stiffening) -> list[complex]:
    """Return of each mode the root s in 1/s, with a positive imaginary part, of vibrations that go as exp(s t); of an unstable
    one the rate at which it grows.

    The equations of motion (s^2 + relaxed + creeping(s)) q = 0 are those of a space (Rayleigh and Ritz). Each root is
    iterated from the relaxed one; among the modes at its s it is the one closest to the one before.

    Args:
        values: Squares of the relaxed angular frequencies in 1/s^2, rising, negative of unstable modes, shape (n,).
        relaxed: Relaxed stiffness over mass in a space of unit mass, in 1/s^2, shape (m, m): the n modes, and what else moves.
        creeping: Stiffness that relaxes, over the mass, of motions as exp(s t), in 1/s^2, shape (m, m), symmetric.

    Raises:
        NoConvergence: A root was not found.
    """
    n, whole = len(values), relaxed.copy()
    whole[:n], whole[:, :n] = 0.0, 0.0
    whole[:n, :n] = np.diag(values)
    return [
        _ringing(value, whole, creeping, k) if value > 0.0 else _growth_rate(value, whole, creeping, k)
        for k, value in enumerate(values)
    ]


def _growth_rate(value: float, relaxed: Array, creeping: Stiffening, k: int) -> complex:
    if value == 0.0:  # a limit point
        return 0j

    def excess(s: float) -> float:
        return float(s**2 + np.linalg.eigvalsh(relaxed + creeping(s).real)[k])

    return complex(scipy.optimize.brentq(excess, 0.0, 1.001 * math.sqrt(-value), rtol=ROOT_TOLERANCE))


def _ringing(value: float, relaxed: Array, creeping: Stiffening, k: int) -> complex:
    s, shape = 1j * math.sqrt(value), np.eye(len(relaxed))[k]
    for _ in range(MAX_ROOT_ITERATIONS):
        # Of the inverse, because responses are of hardly any mass: their eigenvalues are millions of times as large.
        inverses, shapes = np.linalg.eig(np.linalg.inv(relaxed + creeping(s)))
        nearest_one = int(np.argmax(np.abs(shape.conj() @ shapes)))
        before, s, shape = s, 1j / np.sqrt(inverses[nearest_one]), shapes[:, nearest_one]
        if abs(s - before) <= ROOT_TOLERANCE * abs(s):
            return complex(s)
    raise newton.NoConvergence("the damping of a mode did not converge")


# ----------------------------------------------------------------------------------------------------------------------
# Points of a load path, and where it ends.


@dataclasses.dataclass(frozen=True, eq=False)
class Point:
    """One state of a path.

    Attributes:
        state: The state (dimensionless).
        tangent: Direction of the path there.
        requested: Whether this is one of the requested values.
        limit: Whether this is a limit point of the pressure.
        step: Length of the next step in units of ``line``.
        line: The control at this point: pressure, volume or arc-length.
        stiffest: Least |dV/dP| on the path so far.
        signature: Number of negative eigenvalues and the lowest eigenvalue.
        mode: At a bifurcation the shape in which the device leaves the path: local dofs, largest entry 1 or -1; else None.
        jump: Whether the device has jumped here: from the state before, or from the last turn of a supply's stroke.
        turn: Whether this is a limit point of a supply's stroke.
    """

    state: State
    tangent: controls.Tangent
    requested: bool
    limit: bool
    step: float
    line: str
    stiffest: float
    signature: Signature = dataclasses.field(default_factory=Signature)
    mode: Array | None = None
    jump: bool = False
    turn: bool = False

    @property
    def bifurcation(self) -> bool:
        return self.mode is not None

    @property
    def stable_under_pressure(self) -> bool:
        return self.signature.negative_eigenvalues == 0

    @property
    def stable_under_volume(self) -> bool:
        """Whether the state is stable under a given cavity volume."""
        return self.stable_under(controls.volume_control(self.state.V))

    def stable_under(self, control: controls.Control) -> bool:
        """Return whether the state is stable if pressure and volume are tied by a line a V + b P = d, neither a nor b
        negative; of a gas law its tangent at this state.

        What drives the air then gives way by dP = -k dV, k = a/b, and adds k q q^T to K. That takes one of the negative
        eigenvalues away where 1 + k q.K^-1 q = 1 + k dV/dP is negative, and else changes nothing (Sylvester's law again).
        """
        t = self.tangent
        rate = control.volume_coefficient * t.V + control.pressure_coefficient * t.P
        return self.signature.negative_eigenvalues == int(rate * t.P < 0)


class PathEnd(Exception):
    """The path cannot reach the requested value: ``why`` is a clause, ``limit`` the limit point met, ``cause`` what happens
    there where that is an end of the device's own and no limit point of what drives it."""

    def __init__(self, why: str, limit: Point | None = None, cause: component.PathFailure | None = None):
        super().__init__(why)
        self.limit, self.cause = limit, cause

    @property
    def physical(self) -> bool:
        """Whether no equilibrium exists beyond it, as opposed to a failure of the method."""
        return self.limit is not None or (self.cause is not None and not self.cause.of_mesh)

    @property
    def snaps(self) -> bool:
        """Whether the device, or a part of it, may snap there to a state that no step leads to."""
        return self.limit is None and (self.cause is None or self.cause.snaps)


# ----------------------------------------------------------------------------------------------------------------------
# Requested quantities and controls of a path: functions of cavity volume and pressure with prescribed values.
#
# A path does not distinguish pressures, volumes and strokes. A `PathQuantity` provides its value at a state, the
# curve of constant value in the volume-pressure plane, its rate along a tangent and a first step. A new supply is one
# subclass of `Supply` with a name, a value and two slopes. All figures are dimensionless, as in `softmodels.mechanics`.


FIRST_STEP = 0.1
"""First step of a path, in the device's scales of volume and pressure."""
MIN_COMPLIANCE = 1e-12
"""dV/dP, in volumes per shear modulus, below which the device counts as rigid: the stiffest parts leave 1e-8, rounding
1e-18."""
MAX_VOLUME_STEP = 0.2
"""First step in volume after a switch to volume control, in cavity volumes."""


@dataclasses.dataclass(frozen=True)
class ArcLengthMetric:
    """The volume-pressure plane, with the scales of arc lengths."""

    V_scale: float
    P_scale: float

    @classmethod
    def of(cls, V_scale: float, compliance: float) -> ArcLengthMetric:
        """Return the plane scaled by the device's compliance dV/dP."""
        return cls(V_scale, V_scale / max(abs(compliance), MIN_COMPLIANCE * V_scale))

    def felt(self, compliance: float) -> float:
        """Return |dV/dP|, but at least the value below which only rounding is left."""
        return max(abs(compliance), MIN_COMPLIANCE * self.V_scale)

    def locked(self, compliance: float) -> bool:
        """Return whether a dV/dP means that nothing moves."""
        return abs(compliance) <= MIN_COMPLIANCE * self.V_scale

    def stiffened(self, compliance: float) -> ArcLengthMetric:
        """Return the plane scaled at the stiffest state, by the smallest dV/dP on the path: for a flat membrane the scale at
        rest soon becomes meaningless."""
        return dataclasses.replace(self, P_scale=max(self.P_scale, self.V_scale / compliance))

    def product(self, a: tuple[float, float], b: tuple[float, float]) -> float:
        """Return the inner product of two changes (dV, dP)."""
        return a[0] * b[0] / self.V_scale**2 + a[1] * b[1] / self.P_scale**2

    def square_to(self, tangent: controls.Tangent, state: State, step: float = 0.0) -> controls.Control:
        """Return the line perpendicular to a tangent, ``step`` away from a state."""
        a, b = tangent.V / self.V_scale, tangent.P / self.P_scale
        norm = (a * a + b * b) ** 0.5
        line = controls.Control(a / norm / self.V_scale, b / norm / self.P_scale, 0.0)
        return line.at(line.value(state.V, state.P) + step)


class PathQuantity(abc.ABC):
    """A function of volume and pressure whose values can be requested of a path.

    Attributes:
        name: As in the column ``control`` of ``path.csv``.
        ends_at_pressure_limit: Whether there is no state with a higher value beyond a limit point of the pressure.
        has_limits: Whether it can have limit points of its own beside the pressure's.
    """

    name: ClassVar[str]
    ends_at_pressure_limit: ClassVar[bool] = False
    has_limits: ClassVar[bool] = False

    @abc.abstractmethod
    def value(self, V: float, P: float) -> float:
        """Return its value."""

    @abc.abstractmethod
    def slopes(self, V: float, P: float) -> tuple[float, float]:
        """Return its derivatives by volume and by pressure."""

    @abc.abstractmethod
    def curve(self, value: float) -> controls.Curve:
        """Return the curve on which it has a value."""

    def counted(self, start: float, undeformed: float) -> PathQuantity:
        """Return the same for a path that starts at the volume ``start`` instead of the undeformed one."""
        return self

    def starts_forward(self, state: State, tangent: controls.Tangent) -> bool:
        """Return whether a tangent at a path's first state leads to higher values."""
        return not self.rate(state, tangent) < 0.0

    def exactly(self, state: State, value: float) -> State:
        """Return a state solved at a value, with exactly that value if it is part of
        the state."""
        return state

    def limit_met(self, of_pressure: Point | None, own: Point | None) -> Point | None:
        """Return the limit point that prevented a value from being reached."""
        return None

    def ahead(self, state: State, tangent: controls.Tangent, step: float) -> controls.Curve:
        """Return the curve ``step`` ahead of a state."""
        return self.curve(self.value(state.V, state.P) + step)

    def rate(self, state: State, tangent: controls.Tangent) -> float:
        """Return the change along a tangent."""
        a, b = self.slopes(state.V, state.P)
        return a * tangent.V + b * tangent.P

    def slope(self, point: Point) -> float:
        """Return the derivative by the volume along the path."""
        a, b = self.slopes(point.state.V, point.state.P)
        return a + b * point.tangent.P / point.tangent.V

    def first_step(self, plane: ArcLengthMetric, V0: float) -> float:
        """Return the length of a path's first step from the volume V0."""
        a, b = self.slopes(V0, 0.0)
        return FIRST_STEP * (a * plane.V_scale + b * plane.P_scale)

    def largest_step(self, state: State, plane: ArcLengthMetric) -> float:
        """Return the longest first step after a switch to this control."""
        return math.inf


class Pressure(PathQuantity):
    """The cavity's pressure."""

    name = "pressure"
    ends_at_pressure_limit = True

    def value(self, V: float, P: float) -> float:
        return P

    def slopes(self, V: float, P: float) -> tuple[float, float]:
        return 0.0, 1.0

    def curve(self, value: float) -> controls.Control:
        return controls.pressure_control(value)

    def exactly(self, state: State, value: float) -> State:
        return dataclasses.replace(state, P=value)

    def limit_met(self, of_pressure: Point | None, own: Point | None) -> Point | None:
        return of_pressure


@dataclasses.dataclass(frozen=True)
class AddedVolume(PathQuantity):
    """The cavity's volume minus that of the undeformed device, ``V0``; a path puts in its own."""

    V0: float = 0.0
    name: ClassVar[str] = "volume"

    def counted(self, start: float, undeformed: float) -> AddedVolume:
        return dataclasses.replace(self, V0=undeformed)

    def value(self, V: float, P: float) -> float:
        return V - self.V0

    def slopes(self, V: float, P: float) -> tuple[float, float]:
        return 1.0, 0.0

    def curve(self, value: float) -> controls.Control:
        return controls.volume_control(value + self.V0)

    def ahead(self, state: State, tangent: controls.Tangent, step: float) -> controls.Control:
        return controls.volume_control(state.V + step)

    def largest_step(self, state: State, plane: ArcLengthMetric) -> float:
        return MAX_VOLUME_STEP * max(state.V, plane.V_scale)


@dataclasses.dataclass(frozen=True)
class VolumeGain(AddedVolume):
    """The cavity's volume minus that at the path's first state."""

    def counted(self, start: float, undeformed: float) -> VolumeGain:
        return dataclasses.replace(self, V0=start)


class DeadForce(Pressure):
    """A dead load's magnitude, if that is P."""

    name = "force"


@dataclasses.dataclass(frozen=True)
class LoadDisplacement(VolumeGain):
    """Travel of a dead load since the path's first state, if that is V."""

    name: ClassVar[str] = "travel"


QUANTITIES: dict[str, PathQuantity] = {
    quantity.name: quantity for quantity in (Pressure(), AddedVolume(), DeadForce(), LoadDisplacement())
}
"""Quantities without a supply, by name."""


class Supply(PathQuantity):
    """An air supply driven by a prescribed value, such as a stroke, instead of a pressure or volume.

    With its value kept, the supply's pressure falls as the cavity takes volume, so that it holds some states past the
    pressure's limit point. Where its value has a limit point of its own along the path, the device jumps. ``weight`` brings an
    error of the value to the size of a pressure's or volume's, for Newton's method.
    """

    has_limits = True

    @property
    def weight(self) -> float:
        return 1.0

    def curve(self, value: float) -> SupplyCurve:
        return SupplyCurve(self, value)

    def line(self, V: float, P: float) -> controls.Control:
        """Return the tangent of the curve through (V, P), as a direction, in units of `weight`."""
        a, b = self.slopes(V, P)
        return controls.Control(self.weight * a, self.weight * b, 0.0)

    def limit_met(self, of_pressure: Point | None, own: Point | None) -> Point | None:
        return own


@dataclasses.dataclass(frozen=True)
class SupplyCurve:
    """The curve of constant value of a supply: a `controls.Curve`."""

    supply: Supply
    target: float
    needs_volume: ClassVar[bool] = True

    @property
    def weight(self) -> float:
        return self.supply.weight

    def value(self, V: float, P: float) -> float:
        return self.supply.value(V, P)

    def slopes(self, V: float, P: float) -> tuple[float, float]:
        return self.supply.slopes(V, P)

    def line(self, V: float, P: float) -> controls.Control:
        return self.supply.line(V, P)

    def at(self, target: float) -> SupplyCurve:
        return SupplyCurve(self.supply, target)


@dataclasses.dataclass(frozen=True)
class ArcLength:
    """The arc length in the volume-pressure plane: a control where neither pressure nor volume rise, never requested."""

    plane: ArcLengthMetric
    name: ClassVar[str] = "arc-length"

    def ahead(self, state: State, tangent: controls.Tangent, step: float) -> controls.Control:
        return self.plane.square_to(tangent, state, step)

    def rate(self, state: State, tangent: controls.Tangent) -> float:
        along = (tangent.V, tangent.P)
        return self.plane.product(along, along) ** 0.5

    def first_step(self, plane: ArcLengthMetric, V0: float) -> float:
        return FIRST_STEP

    def largest_step(self, state: State, plane: ArcLengthMetric) -> float:
        return math.inf


type ContinuationParameter = PathQuantity | ArcLength
"""A control of a path."""
