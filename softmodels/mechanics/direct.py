"""Factorise K by MUMPS, in single precision where that is accurate enough.

Most back-substitutions precondition GMRES, which works in double precision and recovers the lost digits: they read
half the memory and take half to two thirds of the time. Solutions with K^-1 itself are refined on K
(`softmodels.mechanics.newton`). After each factorisation, inverse iteration estimates its error in the softest motions:
if that is too large, near a critical point or in a very slender device, K is factorised in double precision, so that the
inertia is right. With much stiffer regions this estimate is unreliable, and double precision is used from the start.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING

from softmodels.mechanics.assembly import length
from softmodels.mechanics.newton import Preconditioner

if TYPE_CHECKING:
    from petsc4py import PETSc


OUT_OF_MEMORY = (-5, -7, -8, -9, -11, -12, -13, -14, -15, -17, -18, -19, -20)
"""MUMPS' INFOG(1) if it could not allocate, or if its workspace was too small (its guide, section 8)."""


MEGA = 1e6
TRIPLET = 16
"""Bytes of an entry and its index."""
SENT = 3
"""Copies of K while MUMPS distributes entries over ranks: PETSc's, and the send and receive buffers."""
DOUBLE = 1.95
"""Memory of double precision relative to single precision: 1.91 on wedges and slabs of 17,502 to 88,570 unknowns."""
SMALL = 6000
"""Number of unknowns up to which the factors fit into the processor's cache and single precision gains nothing."""
MOST_SPREAD = 300.0
"""Maximum stiffness ratio of regions for single precision: with stiffer ones the unknowns p hide its error, and signs of
eigenvalues were wrong with sheets of 50 MPa and 1 GPa in a finger."""
SOFTEST = 3
"""Steps of inverse iteration towards the softest motions."""
TRUSTED = 3e-2
"""Maximum relative error in them for single precision. From 1 on the sign of an eigenvalue is wrong."""
PREFIX = "body_"
PRECISION = "pc_precision"
"""PETSc's option, ignored if MUMPS has no single precision."""


class Factorisation(Preconditioner):
    """LDL^T of K.

    Args:
        K: The matrix; its values may change, its pattern may grow.
        spread: How many times stiffer its stiffest material is than its softest.
    """

    exact = True
    most_of_a_solve = 25
    most_in_all = 60
    most_newton = 15
    restart = most_iterations = 60

    def __init__(self, K: PETSc.Mat, spread: float = 1.0):
        self.K, self.spread = K, spread
        self._make(_roundable(K, spread))

    def _make(self, rounded: bool) -> None:
        """Create the factorisation of K, with its current pattern, in single or double precision."""
        self.rounded, self._entries = rounded, entries_in_all(self.K)
        with _precision(rounded):
            self._direct = _mumps(self.K)

    def _factorise(self, rounded: bool) -> None:
        """Factorise the current K.

        Raises:
            MemoryError: On all ranks, if one has not enough.
        """
        # Contact may have added couplings, but PETSc would keep the analysis of the old pattern.
        if self.rounded != rounded or entries_in_all(self.K) != self._entries:
            self._direct.destroy()
            self._make(rounded)
        with _precision(rounded):
            self._direct.setReusePreconditioner(False)
            self._direct.setUp()
        if int(self._direct.getFactorMatrix().getMumpsInfog(1)) in OUT_OF_MEMORY:
            raise MemoryError  # PETSc itself would continue with an invalid preconditioner
        self._direct.setReusePreconditioner(True)

    @staticmethod
    def memory(K: PETSc.Mat, spread: float = 1.0) -> tuple[float, float]:
        """Return the bytes that a factorisation of K would take on this rank: as predicted by MUMPS' analysis, plus PETSc's
        copy of K.

        The first number is of the precision that is tried, the second of double, which a K near a critical point takes.

        Measured on wedges of 37,120, 70,113 and 181,940 unknowns, with the mass matrix and vectors, in single precision: 202,
        388 and 1,241 MB taken, 189, 372 and 1,235 MB predicted; of the last two on two ranks 570 and 1,673, and 523 and 1,621.

        Args:
            K: An assembled matrix.
            spread: As of the factorisation.
        """
        rounded = _roundable(K, spread)
        with _precision(rounded):
            direct = _mumps(K)
            factor = direct.getFactorMatrix()
            # One megabyte is never enough: MUMPS stops after its analysis, before it allocates.
            factor.setMumpsIcntl(23, 1)
            direct.setUp()
        copies = 1 if K.comm.size == 1 else SENT
        factors, copy = factor.getMumpsInfo(15) * MEGA, copies * entries_here(K) / 2 * TRIPLET
        direct.destroy()
        return factors + copy, (DOUBLE if rounded else 1.0) * factors + copy

    def set_up(self) -> None:
        # Decided for every K from K only, so that a resumed path decides the same.
        rounded = _roundable(self.K, self.spread)
        self._factorise(rounded)
        if rounded and not self._error() < TRUSTED:
            self._factorise(rounded=False)

    def _error(self) -> float:
        """Return the relative error of the factorisation in the softest motions."""
        b, x, r = (self.K.createVecRight() for _ in range(3))
        x.set(1.0)
        for _ in range(SOFTEST):
            x.copy(b)
            b.normalize()
            self.apply(b, x)
        self.K.mult(x, r)
        r.aypx(-1.0, b)
        size = length(x)
        self.apply(r, x)
        found = length(x) / size
        for vector in (b, x, r):
            vector.destroy()
        return found

    def apply(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        self._direct.apply(b, x)

    def negative_pivots(self) -> int:
        return int(self._direct.getFactorMatrix().getMumpsInfog(12))

    def release(self) -> None:
        self._direct.destroy()


def entries_here(K: PETSc.Mat) -> float:
    """Return the entries of a matrix on this rank."""
    return float(K.getInfo(K.InfoType.LOCAL)["nz_used"])  # type: ignore[arg-type]


def entries_in_all(K: PETSc.Mat) -> float:
    """Return the entries of a matrix on all ranks."""
    return float(K.getInfo()["nz_used"])


def _roundable(K: PETSc.Mat, spread: float) -> bool:
    """Return whether single precision is tried."""
    return K.getSize()[0] > SMALL and spread < MOST_SPREAD


@contextlib.contextmanager
def _precision(rounded: bool) -> Iterator[None]:
    """Make PETSc factorise in single precision, unless its options set the precision."""
    from petsc4py import PETSc

    options = PETSc.Options(PREFIX)
    if not rounded or options.hasName(PRECISION):
        yield
        return
    options.setValue(PRECISION, "single")
    try:
        yield
    finally:
        options.delValue(PRECISION)


def _mumps(K: PETSc.Mat) -> PETSc.PC:
    """Return PETSc's LDL^T by MUMPS, not yet set up."""
    from petsc4py import PETSc

    direct = PETSc.PC().create(K.comm)
    direct.setOptionsPrefix(PREFIX)
    direct.setOperators(K, K)
    direct.setType("cholesky")
    direct.setFactorSolverType("mumps")
    direct.setFactorSetUpSolverType()
    factor = direct.getFactorMatrix()
    factor.setOptionsPrefix(PREFIX)  # PETSc itself does so only when it factorises, after it has read the precision
    factor.setMumpsIcntl(13, 1)  # the last front too counts its negative pivots, on all ranks
    direct.setFromOptions()
    return direct
