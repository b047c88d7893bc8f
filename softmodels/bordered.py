"""Newton's linear system with the cavity pressure as one more unknown, by one symmetric factorisation.

        [ K      -q ] [dw]   [ r ]        K: tangent of the body, symmetric, indefinite in the mixed form
        [ a q^T   b ] [dP] = [ c ]        q: dV/dw, the load of a unit pressure;  a, b: the control's line

K alone is factorised (LDL^T), whatever the control; the border is eliminated (Keller 1977; Chan 1984,
doi 10.1137/0721019). The same factorisation serves as preconditioner of GMRES on the whole system for the Newton
iterations that follow, and GMRES also returns the digits that elimination loses where K is nearly singular: at a limit
point the whole system is regular although K is not.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from softmodels.controls import Control
from softmodels.parallel import owns_scalar, scalar_from_owner


class Bordered:
    """PETSc contexts for the bordered matrix and its preconditioner.

    Vectors of the whole system hold the body's unknowns, then on the last rank the pressure.

    Args:
        K: Tangent matrix (PETSc Mat, symmetric) to factorise; its values may change, its pattern may not.
        product: ``product(x, y)`` puts the current tangent times x into y (local owned arrays). Where K was factorised at
            an earlier state, this is what makes the solution that of the present one.
    """

    def __init__(self, K: Any, product: Callable[[Any, Any], None]):
        from petsc4py import PETSc

        self.K, self.product, self.comm = K, product, K.comm.tompi4py()
        self.n = K.getLocalSize()[0]
        self.extra = int(owns_scalar(self.comm))
        self.q, self.z = K.createVecRight(), K.createVecRight()
        self._r, self._y = K.createVecRight(), K.createVecRight()
        self.control = Control(0.0, 1.0, 0.0)
        self.row: Any = None  # a force that takes q's place in the control's equation, where that is not of the volume
        self.compliance = 0.0
        self.factorisations = 0
        self._direct = PETSc.PC().create(K.comm)
        self._direct.setOptionsPrefix("body_")
        self._direct.setOperators(K, K)
        self._direct.setType("cholesky")
        self._direct.setFactorSolverType("mumps")
        self._direct.setFactorSetUpSolverType()
        self._direct.getFactorMatrix().setMumpsIcntl(
            13, 1
        )  # the last front too counts its negative pivots, on all ranks
        self._direct.setFromOptions()
        size = (self.n + self.extra, PETSc.DETERMINE)
        self.mat = PETSc.Mat().createPython((size, size), context=self, comm=K.comm)
        self.mat.setUp()

    def release(self) -> None:
        """Destroy what PETSc holds; see `Equilibrium.release`."""
        for thing in (self._direct, self.mat, self.q, self.z, self._r, self._y):
            thing.destroy()

    def vector(self) -> Any:
        return self.mat.createVecRight()

    def join(self, x: Any, body: Any, scalar: float) -> None:
        """Fill ``x`` from the body's part (an array) and the pressure's."""
        with x as values:
            values[: self.n] = body
            if self.extra:
                values[self.n] = scalar

    def split(self, x: Any) -> tuple[Any, float]:
        """The body's part (local array, a view valid until x changes) and the pressure's (on all ranks)."""
        values = x.array_r
        return values[: self.n], scalar_from_owner(self.comm, float(values[self.n]) if self.extra else 0.0)

    def factorise(self) -> None:
        """Factorise K as it is now."""
        self._direct.setReusePreconditioner(False)
        self._direct.setUp()
        self._direct.setReusePreconditioner(True)
        self.factorisations += 1
        self.refresh()

    def solve(self, b: Any, x: Any) -> None:
        """x = K^-1 b with the factorisation at hand."""
        self._direct.apply(b, x)

    def negatives(self) -> int:
        """Negative eigenvalues of K as it was factorised: the number of negative pivots (Sylvester's law of inertia)."""
        return int(self._direct.getFactorMatrix().getMumpsInfog(12))

    def refresh(self) -> None:
        """Take up a new q: z = K^-1 q with the factorisation at hand, and the compliance dV/dP = q . z."""
        self._direct.apply(self.q, self.z)
        self.compliance = self.q.dot(self.z)

    # PETSc calls these: of the matrix, and of the preconditioner.

    def mult(self, mat: Any, x: Any, y: Any) -> None:
        body, dP = self.split(x)
        self._r.array_w[:] = body
        self.product(body, self._y.array_w)
        self._y.axpy(-dP, self.q)
        row = self.row or self.q
        self.join(y, self._y.array_r, self.control.volume * row.dot(self._r) + self.control.pressure * dP)

    def apply(self, pc: Any, x: Any, y: Any) -> None:
        body, c = self.split(x)
        self._r.array_w[:] = body
        self._direct.apply(self._r, self._y)
        a, b, row = self.control.volume, self.control.pressure, self.row or self.q
        dP = (c - a * row.dot(self._y)) / (a * (row.dot(self.z) if self.row else self.compliance) + b)
        self._y.axpy(dP, self.z)
        self.join(y, self._y.array_r, dP)
