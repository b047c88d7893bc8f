"""A cycle of multigrid on the displacements, and the pressures' mass: near K^-1 at a cost that grows as K does.

        [ K_uu  K_up ]      [ M  K_up ]^-1    M: K_uu on quadratic displacements, then on linear ones, then PETSc's GAMG;
        [ K_pu  -C   ]  ~   [ 0   -S  ]       S: (1/shear modulus + 1/bulk modulus) times the diagonal of p's mass

The right side is the upper factor of K's block elimination, with the Schur complement C + K_pu K_uu^-1 K_up near p's mass
(Elman, Silvester, Wathen 2014, Finite Elements and Fast Iterative Solvers, chapter 4). The unknowns are skew components
w = B u, so the rigid motions that GAMG is told of are turned by B too.
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.factorisation import entries_here, entries_in_all
from softmodels.mechanics.inverse import Inverse
from softmodels.mechanics.linear_level import LinearLevel
from softmodels.mechanics.petsc_matrices import held_dofs
from softmodels.mechanics.quadratic_level import QuadraticLevel

if TYPE_CHECKING:
    from petsc4py import PETSc

    from softmodels.mechanics.system import System

Array = npt.NDArray[np.float64]

NONE = np.empty(0, dtype=np.int32)
TIGHT = 1e-4
"""Tolerance from which on a solve shows how much a cycle has aged."""
FIXED, PER_ENTRY, PER_UNKNOWN = 15e6, 15, 80
"""Memory of a rank: bytes whatever the model, bytes per entry of K (blocks in single precision, those to p, the linear level),
and vectors (of the levels, of GMRES, and of the modes that are followed). Measured along the paths of wedges of 17,300, 37,120,
70,113 and 181,940 unknowns, mass matrix included: 54, 107, 188 and 486 MB taken, 57, 107, 189 and 476 MB foretold."""
PER_SHARED_ENTRY = 19
"""The same per entry on several ranks, whose matrices PETSc keeps in two parts. Paths past a limit point, 70,113 and 181,940
unknowns on two ranks: 0.23 and 0.56 GB taken on both, 0.23 and 0.56 GB foretold."""


class Multigrid(Inverse):
    """The block triangular map above.

    Args:
        system: Whose K it is for.
        fixed: Owned dofs of the displacement that it leaves out, beside those that are held.
    """

    exact = False
    most_of_a_solve = 150
    most_in_all = 12
    most_newton = 9
    restart, most_iterations = 80, 200
    instead = (
        ": iterations with multigrid may fail where one material is far stiffer than another or cells are very flat; use "
        "--solver direct"
    )

    def __init__(self, system: System, fixed: npt.NDArray[np.int32] = NONE):
        self.system, self.K, self._fixed = system, system.K, fixed
        self._entries = self._fresh = 0.0
        self._make_fields()
        self._make_weights()
        self._levels: tuple[QuadraticLevel, LinearLevel] | None = None
        self._coupling: PETSc.Mat | None = None

    @staticmethod
    def memory(system: System) -> float:
        """Bytes that a cycle would take on this rank, from the entries of the assembled K."""
        K = system.K
        entries, unknowns = entries_here(K), K.getLocalSize()[0]
        return FIXED + (PER_ENTRY if K.comm.size == 1 else PER_SHARED_ENTRY) * entries + 8 * PER_UNKNOWN * unknowns

    def _make_fields(self) -> None:
        """The rows of displacements, node by node, and those of p."""
        from petsc4py import PETSc

        system, d = self.system, self.system.body.mesh.geometry.dim
        start, end = self.K.getOwnershipRange()
        if system.mixed:
            nodes, parents = system.space.sub(0).collapse()
            count = nodes.dofmap.index_map.size_local
            self._u = np.ravel(parents)[: count * d].astype(np.int32)
        else:
            nodes, count = system.space, system.space.dofmap.index_map.size_local
            self._u = np.arange(count * d, dtype=np.int32)
        self._p = np.setdiff1d(np.arange(end - start, dtype=np.int32), self._u).astype(np.int32)
        self._nodes, self._places = nodes, nodes.tabulate_dof_coordinates()[:count]
        self._held = np.concatenate([held_dofs(system.bcs), self._fixed])
        self._rows = [
            PETSc.IS().createGeneral(rows + start, comm=self.K.comm)  # type: ignore[arg-type]
            for rows in (self._u, self._p)
        ]

    def _make_weights(self) -> None:
        """The forms of the lumped mass of p, one for each region."""
        import ufl
        from dolfinx import fem

        system = self.system
        if not system.mixed:
            return
        q = ufl.split(ufl.TestFunction(system.space))[1]
        self._weights = [fem.Constant(system.body.mesh, 1.0) for _ in system.potential.regions]
        regions = zip(self._weights, system.potential.regions, strict=True)
        self._lumped = [system.form(weight * q * system.body.hoop * region.dx) for weight, region in regions]

    def set_up(self) -> None:
        entries = entries_in_all(self.K)
        if self._levels is not None and entries != self._entries:  # contact has coupled more
            self._drop()
        if self._levels is None:
            self._entries = entries
            self._make_levels()
        else:
            for level in self._levels:
                level.take()
            if self._coupling is not None:
                self.K.createSubMatrix(self._rows[0], self._rows[1], self._coupling)
        self._schur = self._schur_diagonal()
        self._fresh = 0.0

    def _make_levels(self) -> None:
        """Make the levels of displacements, and their coupling to p."""
        d = self.system.body.mesh.geometry.dim
        held = np.zeros(self.K.getLocalSize()[0], dtype=np.bool_)
        held[self._held] = True
        quadratic = QuadraticLevel(self.K, self._u, d, np.isin(self._u, self._fixed))
        quadratic.take()
        shape = (len(self._places), d)
        self._levels = (quadratic, LinearLevel(quadratic, self._nodes, held[self._u].reshape(shape), self._motions()))
        if self.system.mixed:
            self._coupling = self.K.createSubMatrix(self._rows[0], self._rows[1])
            self._pressures, self._b = self._coupling.createVecRight(), self._coupling.createVecLeft()

    def _motions(self) -> Array:
        """The rigid motions as skew components, zero where they are held, shape (motions, owned nodes, d)."""
        body = self.system.body
        d = body.mesh.geometry.dim
        x = self._places[:, :d]
        found = [np.tile(axis, (len(x), 1)) for axis in np.eye(d)]
        for i, j in itertools.combinations(range(d), 2):
            turn = np.zeros_like(x)
            turn[:, i], turn[:, j] = -x[:, j], x[:, i]
            found.append(turn)
        free = np.ones(self.K.getLocalSize()[0])
        free[self._held] = 0.0
        return np.array([motion @ body.skew.T * free[self._u].reshape(-1, d) for motion in found])

    def _schur_diagonal(self) -> Array:
        """S of the module's docstring at owned p."""
        system = self.system
        if not system.mixed:
            return np.empty(0)
        for weight, region in zip(self._weights, system.potential.regions, strict=True):
            weight.value = system.stress_unit / region.material.shear_modulus_0 + float(region.bulk.value)
        # A linear function's square has this share of its integral, in the mean of a simplex' corners.
        share = 2 / (system.body.mesh.topology.dim + 2)
        return share * system.assemble(self._lumped, held=True)[self._p]

    def apply(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        assert self._levels is not None
        given, found = b.array_r, x.array_w
        force = given[self._u]
        if self._coupling is not None:
            pressures = -given[self._p] / self._schur
            self._pressures.array_w[:] = pressures
            self._coupling.mult(self._pressures, self._b)
            force -= self._b.array_r
            found[self._p] = pressures
        quadratic, linear = self._levels
        quadratic.smooth(force, begin=True)
        linear.correct(quadratic.residual(force))
        quadratic.smooth(force, begin=False)
        found[self._u] = quadratic.x[: len(force)]
        # Coarser levels move held dofs a little, which no residual knows of: states would drift away from their supports.
        found[self._held] = given[self._held]

    def wear(self, iterations: int, tolerance: float) -> int:
        """Iterations beyond those of the first solve after a set-up, of tight solves: loose ones tell little."""
        if tolerance > TIGHT:
            return 0
        rate = iterations / -math.log10(tolerance)
        if not self._fresh:
            self._fresh = rate
        return max(0, round((rate - self._fresh) * -math.log10(tolerance)))

    def negative_pivots(self) -> int:
        raise NotImplementedError("a cycle of multigrid does not know K's inertia")

    def _drop(self) -> None:
        """Destroy the levels and the coupling."""
        for level in self._levels or ():
            level.release()
        if self._coupling is not None:
            for thing in (self._coupling, self._pressures, self._b):
                thing.destroy()
        self._levels = self._coupling = None

    def release(self) -> None:
        self._drop()
        for rows in self._rows:
            rows.destroy()
