"""Eigenvalues of K x = lambda M x nearest zero, and all negative ones, from rough answers of K^-1: Davidson's method.

Rayleigh's quotient is made stationary over a growing space. Each new direction is a residual times K^-1, by loose iterations
or a factorisation in single precision, so that the space grows as that of inverse iteration does. A mode that is known from a
state near by is where it begins. Davidson 1975, doi 10.1016/0021-9991(75)90065-0; Morgan and Scott 1986, doi 10.1137/0907054.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.newton import NoConvergence
from softmodels.path.lanczos import grown

if TYPE_CHECKING:
    from petsc4py import PETSc

Array = npt.NDArray[np.float64]

MOST_DIRECTIONS = 32
"""Size of the space at which it is cut back to the best modes."""
MOST_SOLVES = 150
"""Solves after which an eigenvalue counts as not found, if no other number is given."""
LOOSE, TIGHT = 1e-2, 1e-3
"""Tolerances of the solves: looser ones leave p that do not belong to their displacements, tighter ones gain nothing."""
POLISH = 1e-2
"""Share of an eigenvalue that its last correction may move it by, whose part of p need not belong to its displacement."""
DEPENDENT = 1e-8
"""Share of a new direction that has to be left beside the space."""


@dataclasses.dataclass(frozen=True, eq=False)
class Pencil:
    """K and M as maps of PETSc vectors.

    Attributes:
        product: ``product(x, y)`` puts K x into y.
        M: The mass matrix, positive but for a null space.
        solve: ``solve(b, x, tolerance)`` puts K^-1 b into x, to a relative tolerance.
    """

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
        """Add a direction, which is overwritten; whether there was anything new in it."""
        M, Mx, Kx = self.pencil.M, self.pencil.M.createVecLeft(), self.pencil.M.createVecLeft()
        M.mult(x, Mx)
        size = x.dot(Mx)
        if not math.isfinite(size) or size <= 0.0:
            return False
        for _ in range(2 if self.x else 0):
            x.maxpy([-share for share in x.mDot(self.Mx)], self.x)
        M.mult(x, Mx)
        left = x.dot(Mx)
        if not left > DEPENDENT**2 * size:
            return False
        x.scale(left**-0.5)
        Mx.scale(left**-0.5)
        self.pencil.product(x, Kx)
        self.x, self.Kx, self.Mx = [*self.x, x], [*self.Kx, Kx], [*self.Mx, Mx]
        self.K = grown(self.K, Kx.mDot(self.x))
        return True

    def combined(self, shares: Array, vectors: Sequence[PETSc.Vec]) -> PETSc.Vec:
        made = self.pencil.M.createVecRight()
        made.maxpy([float(share) for share in shares], list(vectors))
        return made

    def cut(self, shares: Array) -> None:
        """Keep only these combinations, columns of an orthogonal matrix."""
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


def nearest(pencil: Pencil, start: Sequence[PETSc.Vec], tolerances: Sequence[float], most: int = MOST_SOLVES) -> Modes:
    """Eigenvalues nearest zero, and all negative ones.

    Args:
        pencil: K and M.
        start: Vectors near the modes, or one with a part of each, in the range of K^-1 M.
        tolerances: Of the residual K^-1 (K x - lambda M x), length in the norm of M, for the lowest eigenvalue, the next,
            and so on; as many are looked for. An eigenvalue's error is about the residual's square. Infinite for one that
            is taken as the start's vectors have it.
        most: Solves after which an eigenvalue counts as not found.

    Raises:
        NoConvergence: A residual did not fall below its tolerance.
    """
    space, count = Space(pencil), len(tolerances)
    for x in start:
        space.add(x.copy())
    first, found, polished = len(space.x), list[float](), dict[int, float]()
    for _ in range(most):
        values, shares = np.linalg.eigh(space.K)
        chosen = _chosen(values, shares[:first], count)
        if len(space.x) > MOST_DIRECTIONS:
            first = len(chosen)
            near = [k for k in np.argsort(np.abs(values)) if k not in chosen]
            space.cut(shares[:, [*chosen, *near[:count]]])
            continue
        here = values[chosen]
        slack = max(filter(math.isfinite, tolerances)) ** 2 * np.abs(here).max()
        while found and abs(found[-1] - here[len(found) - 1]) > slack:  # a lower one has come up since
            found.pop()
            polished.pop(len(found), None)
        while len(found) < len(chosen) >= count and math.isinf(tolerances[min(len(found), count - 1)]):
            found.append(here[len(found)])
        if len(found) == len(chosen) >= count:
            best = np.array([polished.get(k, value) for k, value in enumerate(here)])
            return Modes(best, [space.combined(column, space.x) for column in shares[:, chosen].T])
        place = min(len(found), len(chosen) - 1)
        tolerance = tolerances[min(place, count - 1)]
        size, new = _correction(space, here[place], shares[:, chosen[place]], min(LOOSE, max(TIGHT, tolerance)))
        if size <= tolerance and len(found) < len(chosen):
            found.append(here[place])
            polished[place] = _polished(space, here[place], new)
        elif not (math.isfinite(size) and space.add(new)):
            break
    raise NoConvergence("the lowest modes were not found")


def _polished(space: Space, value: float, new: PETSc.Vec) -> float:
    """An eigenvalue over the space with its last correction too, which is not kept: small ones may be rounding alone."""
    kept = space.x, space.Kx, space.Mx, space.K
    if not space.add(new):
        return value
    values = np.linalg.eigvalsh(space.K)
    space.x, space.Kx, space.Mx, space.K = kept
    best = float(values[np.argmin(np.abs(values - value))])
    return best if abs(best - value) <= POLISH * abs(value) else value


def _chosen(values: Array, of_first: Array, count: int) -> npt.NDArray[np.intp]:
    """Indices of the values nearest zero, and of the negative ones that the first directions had, by rising value.

    Other negative ones far from zero are of directions whose p does not belong to their displacements.
    """
    near = np.argsort(np.abs(values), kind="stable")[:count]
    known = (of_first**2).sum(axis=0) > 0.5
    return np.union1d(near, np.flatnonzero(known & (values < 0.0)))  # values are in rising order


def _correction(space: Space, value: float, shares: Array, tolerance: float) -> tuple[float, PETSc.Vec]:
    """K^-1 times the residual of a mode of the space, to a tolerance and without the mode's own part, and its length."""
    pencil = space.pencil
    residual, new = pencil.M.createVecLeft(), pencil.M.createVecRight()
    residual.maxpy([float(share) for share in shares], space.Kx)
    residual.maxpy([float(-value * share) for share in shares], space.Mx)
    pencil.solve(residual, new, tolerance)
    x, image = space.combined(shares, space.x), space.combined(shares, space.Mx)
    new.axpy(-new.dot(image), x)
    pencil.M.mult(new, residual)
    return max(new.dot(residual), 0.0) ** 0.5, new
