"""The lowest eigenvalues of a device's tangent, by its factorisation where there is one and else by iterations."""

from __future__ import annotations

import abc
import contextlib
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.region_space import entries_of
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State
from softmodels.path.davidson import Modes, Pencil, nearest
from softmodels.path.lanczos import generalised, grown, lowest
from softmodels.path.modes import ShiftInvert

if TYPE_CHECKING:
    from petsc4py import PETSc

BLOCK = 4
"""Modes of the last factorised point from which the lowest eigenvalue of a point without factorisation is found."""
MOST_CORRECTIONS, CLOSE = 6, 1e-3
"""Corrections of that mode, and the share of the eigenvalue that the last one may move it by, as expected and as found:
its own error is about a tenth of that then. Where K has changed so much that its kept inverse expects less than comes, or where
a mode does not get there in as many corrections, the point is factorised."""
EIGENVALUE = 1e-10
"""What back-substitutions are refined to where a factorisation is in single precision, in shares of the answer, for the lowest
eigenvalue where K was factorised. Corrections of its mode elsewhere are not refined: they are directions to search in."""
ROUGH, REFINED = 1e-3, 3e-5
"""Residuals to which it is looked for in single precision alone, and then refined by corrections of its mode: the eigenvalue's
own error is about the square of the second."""
MOST_REFINEMENTS = 30
"""Such corrections; where they are not enough, Lanczos' method is with refined back-substitutions from the start."""
LOWEST, OTHERS, LOCATED = 3e-4, 5e-2, 1e-5
"""Residuals of modes that are found in this way: of the lowest along a path, of those kept to begin the next search with, and
of all where a bifurcation is located."""


class Spectrum(abc.ABC):
    """Lowest eigenvalues of a solver's K x = lambda M x.

    Args:
        solver: The device.
        M: Mass matrix by its unknowns; its values may change.

    Attributes:
        seed: A vector with a part of every mode, with which a search begins.
    """

    seed: PETSc.Vec

    def __init__(self, solver: Solver, M: PETSc.Mat):
        self.solver, self.M = solver, M

    @property
    @abc.abstractmethod
    def negative_eigenvalues(self) -> int:
        """Negative eigenvalues of the K that was factorised, or looked at, last."""

    @abc.abstractmethod
    def lowest(self, modes: Sequence[PETSc.Vec]) -> tuple[float, list[PETSc.Vec]]:
        """The lowest eigenvalue at the state that K was factorised at, its mode, and approximations of the next ones.

        Args:
            modes: Those of a state near by; may be none.

        Raises:
            NoConvergence: It was not found.
        """

    @abc.abstractmethod
    def corrected(self, state: State, modes: Sequence[PETSc.Vec]) -> float:
        """Lowest eigenvalue of another state, from modes of the last one, without a factorisation of its own.

        Raises:
            NoConvergence: The mode changes too much between the two states.
        """

    @abc.abstractmethod
    def pairs(self, count: int) -> list[tuple[float, PETSc.Vec]]:
        """At least so many eigenvalues nearest zero with their vectors, at the state that K was factorised at.

        Raises:
            NoConvergence: They were not found.
        """


def spectrum_of(solver: Solver, M: PETSc.Mat) -> Spectrum:
    """The eigenvalues of a device, found as its linear systems are solved."""
    return (Factorised if solver.bordered.inverse.exact else Iterated)(solver, M)


class Factorised(Spectrum):
    """By Lanczos' method on K^-1 M, and K's inertia."""

    def __init__(self, solver: Solver, M: PETSc.Mat):
        super().__init__(solver, M)
        eq = solver.system
        self.constraints = entries_of(eq.space, 1) - eq.still_pressures if eq.mixed else 0

    @property
    def negative_eigenvalues(self) -> int:
        return self.solver.bordered.negative_eigenvalues() - self.constraints

    def lowest(self, modes: Sequence[PETSc.Vec]) -> tuple[float, list[PETSc.Vec]]:
        bordered, negatives = self.solver.bordered, self.negative_eigenvalues

        def solve(b: PETSc.Vec, x: PETSc.Vec) -> None:
            bordered.solve(b, x, EIGENVALUE)

        if bordered.inverse.rounded:
            with contextlib.suppress(NoConvergence):
                return self._refined(negatives)
        return lowest(solve, self.M, self.seed, negatives, BLOCK)

    def _refined(self, negatives: int) -> tuple[float, list[PETSc.Vec]]:
        """`lowest` from a search in single precision, whose modes are then corrected by their residuals in double precision.

        A correction takes one back-substitution, where a refined one of Lanczos' method takes two or three.
        """
        bordered = self.solver.bordered

        def solve(b: PETSc.Vec, x: PETSc.Vec, tolerance: float) -> None:
            if bordered.constraint_columns:  # pressures that hold volumes are large beside a small residual
                bordered.solve(b, x, EIGENVALUE)
            else:
                bordered.solve_roughly(b, x)

        _, start = lowest(bordered.solve_roughly, self.M, self.seed, negatives, BLOCK, ROUGH)
        tolerances = [REFINED, *[math.inf] * (len(start) - 1)]
        found = nearest(Pencil(bordered.K.mult, self.M, solve), start, tolerances, MOST_REFINEMENTS)
        if found.negative != negatives:
            raise NoConvergence("the modes in single precision are other ones")
        # The others as they were found first: what corrections of the lowest change in them is single precision's rounding.
        return float(found.values[0]), [found.vectors[0], *start[1:]]

    def corrected(self, state: State, modes: Sequence[PETSc.Vec]) -> float:
        """See `Spectrum.corrected`.

        Davidson's method: Rayleigh's quotient is made stationary over those modes and corrections of the lowest, each the
        residual times the kept K^-1. Its error is quadratic in the mode's.
        """
        eq, M = self.solver.system, self.M
        eq.load(state)
        basis: list[PETSc.Vec] = []
        products: list[PETSc.Vec] = []
        images: list[PETSc.Vec] = []
        new, before, close, value = list(modes), np.empty(0), False, math.inf
        A = C = np.empty((0, 0))
        for left in reversed(range(MOST_CORRECTIONS + 1)):
            for x in new:
                Kx, Mx = M.createVecLeft(), M.createVecLeft()
                eq.tangent_product(x.array_r, Kx.array_w)
                M.mult(x, Mx)
                basis, products, images = [*basis, x], [*products, Kx], [*images, Mx]
                A, C = grown(A, Kx.mDot(basis)), grown(C, Mx.mDot(basis))
            values, vectors = generalised(A, C)
            # The same mode as before: a subspace of a saddle point's has stationary values that are no eigenvalues.
            likeness = np.abs(before @ C[: len(before)] @ vectors) if len(before) else -values
            chosen = int(np.argmax(likeness))
            moved, value, before = abs(value - float(values[chosen])), float(values[chosen]), vectors[:, chosen]
            if close and moved <= CLOSE * abs(value):
                return value
            if not left:
                break
            shares = [float(share) for share in before]
            residual, correction = M.createVecLeft(), M.createVecRight()
            residual.maxpy(shares, products)
            residual.maxpy([-value * share for share in shares], images)
            self.solver.bordered.solve_roughly(residual, correction)
            # The work of the residual, of first order: a correction's length says little of it where its motions are stiff.
            change = correction.dot(residual)
            M.mult(correction, residual)
            size = max(correction.dot(residual), 0.0) ** 0.5
            if not math.isfinite(size) or size == 0.0:
                break
            correction.scale(1 / size)
            close = abs(change) <= CLOSE * abs(value)
            new = [correction]
        raise NoConvergence("the lowest mode changes too much without a factorisation")

    def pairs(self, count: int) -> list[tuple[float, PETSc.Vec]]:
        from petsc4py import PETSc
        from slepc4py import SLEPc

        eq = self.solver.system
        solver = SLEPc.EPS().create(eq.comm)
        # The largest eigenvalues of K^-1 M in the inner product of M. K^-1 M maps p-parts to displacements alone, so the
        # constraint's infinite eigenvalues are zeros here, far from those wanted.
        solver.setOperators(ShiftInvert.matrix(self.solver.bordered.solve, self.M))
        solver.setProblemType(SLEPc.EPS.ProblemType.NHEP)
        solver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_MAGNITUDE)
        solver.setDimensions(count, max(2 * count + 8, 16))
        solver.setTolerances(1e-10, 200)
        solver.setInitialSpace([self.seed])
        try:
            solver.solve()
        except (PETSc.Error, SystemError) as error:  # SLEPc's own errors come as either
            raise NoConvergence("the modes of the tangent were not found") from error
        found = []
        for i in range(solver.getConverged()):
            vector = eq.K.createVecRight()
            found.append((1 / solver.getEigenpair(i, vector).real, vector))
        solver.destroy()
        if not found:
            raise NoConvergence("the modes of the tangent were not found")
        return found


class Iterated(Spectrum):
    """By Davidson's method, from state to state: an eigenvalue changes its sign only where it is among those nearest zero."""

    def __init__(self, solver: Solver, M: PETSc.Mat):
        super().__init__(solver, M)
        self._negative = self._turn = self._counted = 0
        self._modes: Sequence[PETSc.Vec] = ()
        # The lowest mode of the state before the last: with its own the two foretell.
        self._before: list[PETSc.Vec] = []

    @property
    def negative_eigenvalues(self) -> int:
        """Those of the state that is loaded; where they are not found, those of the state before."""
        if self._counted != self.solver.kept.made:
            with contextlib.suppress(NoConvergence):
                self.lowest(self._modes)
        return self._negative

    def _take(self, found: Modes) -> Modes:
        """Remember what was found at the state that is loaded."""
        self._negative, self._counted, self._modes = found.negative, self.solver.kept.made, found.vectors
        return found

    def _pencil(self) -> Pencil:
        solver = self.solver

        def product(x: PETSc.Vec, y: PETSc.Vec) -> None:
            solver.system.tangent_product(x.array_r, y.array_w)

        def solve(b: PETSc.Vec, x: PETSc.Vec, tolerance: float) -> None:
            solver.bordered.iterate(b, x, tolerance)
            solver.bordered.keep_volumes(x)  # to the last digits: a loose solve changes them a little

        return Pencil(product, self.M, solve)

    def _start(self, modes: Sequence[PETSc.Vec]) -> Sequence[PETSc.Vec]:
        """Where a search begins: with the modes known, or in the range of K^-1 M; with motions that keep the held volumes."""
        if modes:
            kept = [mode.copy() for mode in modes]
            for mode in kept:
                self.solver.bordered.keep_volumes(mode)
            return kept
        image, lifted = self.M.createVecLeft(), self.M.createVecRight()
        self.M.mult(self.seed, image)
        self.solver.bordered.iterate(image, lifted, OTHERS)
        return [lifted]

    def lowest(self, modes: Sequence[PETSc.Vec]) -> tuple[float, list[PETSc.Vec]]:
        tolerances = [LOWEST, *[OTHERS] * (BLOCK - 1)]
        if modes:  # one of the others in turn
            self._turn = self._turn % (BLOCK - 1) + 1
            tolerances = [OTHERS if k == self._turn else math.inf for k in range(BLOCK)]
            tolerances[0] = LOWEST
        found = self._take(nearest(self._pencil(), self._start([*modes, *self._before] if modes else ()), tolerances))
        self._before = list(modes[:1])
        return float(found.values[0]), found.vectors

    def corrected(self, state: State, modes: Sequence[PETSc.Vec]) -> float:
        raise NoConvergence("every state is looked at for itself: that costs a few solves")

    def pairs(self, count: int) -> list[tuple[float, PETSc.Vec]]:
        found = self._take(nearest(self._pencil(), self._start(()), [LOCATED] * count))
        return list(zip(map(float, found.values), found.vectors, strict=True))
