"""A cycle of algebraic multigrid on the displacements, and the pressures' mass: near K^-1 at a cost that grows as K does.

        [ K_uu  K_up ]      [ M  K_up ]^-1    M: PETSc's GAMG on K_uu, smoothed aggregation that knows the rigid motions;
        [ K_pu  -C   ]  ~   [ 0   -S  ]       S: (1/shear modulus + 1/bulk modulus) times the diagonal of p's mass

The right side is the upper factor of K's block elimination, with the Schur complement C + K_pu K_uu^-1 K_up near p's mass
(Elman, Silvester, Wathen 2014, Finite Elements and Fast Iterative Solvers, chapter 4). The unknowns are skew components
w = B u, so the rigid motions are turned by B too: without that iterations triple.
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.factorisation import entries_here, entries_in_all
from softmodels.mechanics.inverse import Inverse
from softmodels.mechanics.petsc_matrices import held_dofs

if TYPE_CHECKING:
    from petsc4py import PETSc

    from softmodels.mechanics.system import System

Array = npt.NDArray[np.float64]

PREFIX = "body_"
NONE = np.empty(0, dtype=np.int32)
OPTIONS = {
    "pc_gamg_threshold": "0.01",
    "pc_gamg_reuse_interpolation": "true",  # its set-up for another state is its products alone
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_pc_type": "sor",
}
"""PETSc's options of the cycle; those that the user gives under the same prefix stand."""


TIGHT = 1e-4
"""Tolerance from which on a solve shows how much a cycle has aged."""
FIXED, PER_ENTRY, PER_UNKNOWN = 15e6, 18, 80
"""Memory of a rank: bytes whatever the model, bytes per entry of K (its blocks, and their products on coarser levels), and
vectors (of the cycle's levels, of GMRES, and of the modes that are followed). Measured on wedges of 9,804, 17,092, 20,542 and
48,563 unknowns, mass matrix included: 45, 72, 83 and 167 MB taken, 45, 71, 80 and 171 MB foretold."""
PER_SHARED_ENTRY = 100
"""The same per entry on several ranks: what PETSc keeps and needs for a while to multiply matrices whose rows are spread. Paths
past a limit point, 70,113 and 1,054,962 unknowns on two ranks: 0.67 and 10.3 GB taken on both, 0.69 and 9.9 GB foretold."""


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
        self._blocks: tuple[PETSc.Mat, PETSc.Mat | None] | None = None

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
        self._places = nodes.tabulate_dof_coordinates()[:count]
        self._held = np.concatenate([held_dofs(system.bcs), self._fixed])
        self._rows = [
            PETSc.IS().createGeneral(rows + start, comm=self.K.comm)  # type: ignore[arg-type]
            for rows in (self._u, self._p)
        ]
        self._rows[0].setBlockSize(d)

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
        u, p = self._rows
        entries = entries_in_all(self.K)
        if self._blocks is not None and entries != self._entries:  # contact has coupled more
            self._drop()
        if self._blocks is None:
            self._entries = entries
            self._blocks = (self.K.createSubMatrix(u, u), self.K.createSubMatrix(u, p) if self.system.mixed else None)
            self._fix(*self._blocks)
            self._make_cycle(self._blocks[0])
        else:
            self.K.createSubMatrix(u, u, self._blocks[0])
            if self._blocks[1] is not None:
                self.K.createSubMatrix(u, p, self._blocks[1])
            self._fix(*self._blocks)
        self._schur = self._schur_diagonal()
        self._cycle.setReusePreconditioner(False)
        self._cycle.setUp()
        self._cycle.setReusePreconditioner(True)
        self._fresh = 0.0

    def _fix(self, K_uu: PETSc.Mat, K_up: PETSc.Mat | None) -> None:
        """Put the identity into the rows and columns of what is left out and has others in K."""

    def _make_cycle(self, K_uu: PETSc.Mat) -> None:
        """Make multigrid for the displacements' block, with what it is told of rigid motions."""
        from petsc4py import PETSc

        K_uu.setBlockSize(self.system.body.mesh.geometry.dim)
        vectors = [K_uu.createVecRight() for _ in range(self._motions().shape[0])]
        for vector, motion in zip(vectors, self._motions(), strict=True):
            vector.array_w[:] = motion
        for i, vector in enumerate(vectors):
            for before in vectors[:i]:
                vector.axpy(-vector.dot(before), before)
            vector.normalize()
        K_uu.setNearNullSpace(PETSc.NullSpace().create(vectors=vectors, comm=K_uu.comm))
        cycle = self._cycle = PETSc.PC().create(K_uu.comm)
        cycle.setOptionsPrefix(PREFIX)
        cycle.setOperators(K_uu, K_uu)
        cycle.setType("gamg")
        options = PETSc.Options(PREFIX)
        own = {name: value for name, value in OPTIONS.items() if not options.hasName(name)}
        for name, value in own.items():
            options.setValue(name, value)
        cycle.setFromOptions()
        cycle.setUp()  # which reads the options of the levels
        for name in own:
            options.delValue(name)
        self._b, self._x = K_uu.createVecRight(), K_uu.createVecRight()
        self._pressures = None if self._blocks is None or self._blocks[1] is None else self._blocks[1].createVecRight()

    def _motions(self) -> Array:
        """The rigid motions as skew components, zero where they are held, shape (motions, owned displacements)."""
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
        return np.array([(motion @ body.skew.T).ravel() * free[self._u] for motion in found])

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
        assert self._blocks is not None
        given, K_up = b.array_r, self._blocks[1]
        self._b.array_w[:] = given[self._u]
        found = x.array_w
        if K_up is not None and self._pressures is not None:
            pressures = -given[self._p] / self._schur
            self._pressures.array_w[:] = -pressures
            K_up.multAdd(self._pressures, self._b, self._b)
            found[self._p] = pressures
        self._cycle.apply(self._b, self._x)
        found[self._u] = self._x.array_r
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
        """Destroy the cycle and its blocks."""
        if self._blocks is not None:
            for thing in (self._cycle, self._b, self._x, self._pressures, *self._blocks):
                if thing is not None:
                    thing.destroy()
            self._blocks = None

    def release(self) -> None:
        self._drop()
        for rows in self._rows:
            rows.destroy()
