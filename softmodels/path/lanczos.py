"""The lowest eigenvalue of K x = lambda M x by Lanczos' method on K^-1 M, held against its residual and K's inertia.

K is symmetric and may be indefinite, M symmetric and positive but for a null space (the pressures of a mixed form). K^-1 M is
self-adjoint in the inner product of M, with eigenvalues nu = 1/lambda. Where K has no negative eigenvalue, the lowest lambda
belongs to the largest nu. Where it has k of them, it belongs to the negative nu nearest to zero: Lanczos' matrix never has
more negative eigenvalues than K (Cauchy's interlacing), so once it has k of them, none has been overlooked.
Parlett 1998, The Symmetric Eigenvalue Problem, chapters 11 to 13; the semi-inner product: Nour-Omid, Parlett, Ericsson and
Jensen 1987, doi 10.1090/S0025-5718-1987-0878698-5.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.newton import NoConvergence

if TYPE_CHECKING:
    from petsc4py import PETSc

    from softmodels.path.modes import Solve

TOLERANCE = 1e-7
"""Residual of K^-1 M x = nu x, in the norm of M and in shares of nu; the eigenvalue's error is about its square."""
ROUNDING = 1e-12
"""Share of the largest nu below which one is zero: it belongs to the null space of M."""
MOST_STEPS = 150
"""Back-substitutions after which an eigenvalue counts as not found."""


def lowest(
    solve: Solve, M: PETSc.Mat, start: PETSc.Vec, negatives: int, count: int = 1, tolerance: float = TOLERANCE
) -> tuple[float, list[PETSc.Vec]]:
    """The lowest eigenvalue, its vector, and approximations of the next ones.

    Args:
        solve: ``solve(b, x)`` puts K^-1 b into x (PETSc vectors).
        M: PETSc matrix.
        start: PETSc vector with a part of every mode.
        negatives: Number of negative eigenvalues of K where M counts.
        count: How many vectors; fewer if fewer were found.
        tolerance: Of the residual, as `TOLERANCE`.

    Returns:
        lambda, and vectors of length 1 in the norm of M, the one of lambda first.

    Raises:
        NoConvergence: The residual did not fall below the tolerance, or K's inertia says otherwise.
    """
    w, image = M.createVecRight(), M.createVecLeft()
    M.mult(start, image)
    solve(image, w)  # in the range of K^-1 M, where M is an inner product
    basis: list[PETSc.Vec] = []
    images: list[PETSc.Vec] = []
    diagonal: list[float] = []
    beside: list[float] = []
    M.mult(w, image)
    length = w.dot(image) ** 0.5
    while len(basis) < MOST_STEPS:
        if not np.isfinite(length) or length == 0.0:
            break
        basis.append(w.copy())
        images.append(image.copy())
        basis[-1].scale(1 / length)
        images[-1].scale(1 / length)
        solve(images[-1], w)
        diagonal.append(w.dot(images[-1]))
        for _ in range(2):  # against all before, twice: Lanczos' own recurrence forgets them
            w.maxpy([-share for share in w.mDot(images)], basis)
        M.mult(w, image)
        length = max(w.dot(image), 0.0) ** 0.5
        values, vectors = np.linalg.eigh(np.diag(diagonal) + np.diag(beside, -1))  # of which it reads the lower half
        below = int(np.count_nonzero(values < -ROUNDING * np.abs(values).max()))
        if below > negatives:
            break
        if below == negatives:
            chosen = negatives - 1 if negatives else len(values) - 1
            if length * abs(vectors[-1, chosen]) <= tolerance * abs(values[chosen]):
                others = [k for k in range(len(values) - 1, -1, -1) if k != chosen][: count - 1]
                found = [M.createVecRight() for _ in (chosen, *others)]
                for x, k in zip(found, (chosen, *others), strict=True):
                    x.maxpy([float(share) for share in vectors[:, k]], basis)
                return 1 / float(values[chosen]), found
        beside.append(length)
    raise NoConvergence(f"the lowest eigenvalue was not found in {len(basis)} steps")


def grown(square: npt.NDArray[np.float64], column: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """A symmetric matrix with one more column and row."""
    column = np.asarray(column)
    return np.block([[square, column[:-1, None]], [column[None, :-1], column[-1:, None]]])


def generalised(
    A: npt.NDArray[np.float64], C: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Eigenvalues, rising, and vectors as columns of A x = value C x for small symmetric matrices, x of length 1 in C.

    NumPy has no routine for two matrices, and SciPy's takes longer to load than a section's path to solve.

    Raises:
        numpy.linalg.LinAlgError: C is not positive definite.
    """
    inverse = np.linalg.inv(np.linalg.cholesky(C))
    values, vectors = np.linalg.eigh(inverse @ A @ inverse.T)
    return values, inverse.T @ vectors
