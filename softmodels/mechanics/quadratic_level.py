"""Displacements as a level of multigrid: their block of K in single precision, and Chebyshev's iteration on it.

A product reads 4.5 bytes for an entry where PETSc's reads 12. The polynomials are those of the fourth kind, which need to know
no more than the largest eigenvalue of D^-1 K, D its blocks on the diagonal (Lottes 2023, Optimal polynomial smoothers for
multigrid V-cycles, doi 10.1002/nla.2518, section 3).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.c_library import library
from softmodels.mechanics.matrix_parts import MatrixParts

if TYPE_CHECKING:
    from petsc4py import PETSc

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]

DEGREE = 4
"""Steps of Chebyshev's iteration before and after the coarser level."""
POWERS, SAFE = 15, 1.1
"""Steps of the power method towards the largest eigenvalue, and what it is multiplied with."""
READ = 4
"""Entries that C code reads at once."""


class QuadraticLevel:
    """Displacements' rows of K on this rank, by blocks of a node and another.

    Args:
        K: The matrix, assembled.
        rows: Local rows of the displacements, d of each node one after the other.
        d: Components of a node.
        left: Which of the rows are left out, for which the identity stands.

    Attributes:
        x: The level's vector: nodes of this rank, then those of others in their rows.
        parts: K's rows for the C code, with the values of the last `take`.
    """

    def __init__(self, K: PETSc.Mat, rows: Ints, d: int, left: npt.NDArray[np.bool_]):
        self._comm, self.rows, self.d, self.nodes = K.comm, rows, d, len(rows) // d
        self._c = library(K.comm.tompi4py(), "multigrid")
        self._K, self._left = K, np.ascontiguousarray(left, dtype=np.int8)
        self._number(MatrixParts(K, self._c))
        buffer = self._c.ffi.from_buffer
        self._places_read()
        self.scratch = np.full(self.nodes + self.ghosts, -1, dtype=np.int32)
        self._starts = np.zeros(self.nodes + 1, dtype=np.int32)
        pattern = (self.nodes, d, buffer("int32_t[]", rows), buffer("int8_t[]", self._left), self.parts)
        starts, seen = (buffer("int32_t[]", array) for array in (self._starts, self.scratch))
        count = self._c.lib.level_pattern(*pattern, seen, starts, self._c.ffi.NULL)
        self._columns = np.empty(count, dtype=np.int32)
        self.scratch[:] = -1
        self._c.lib.level_pattern(*pattern, seen, starts, buffer("int32_t[]", self._columns))
        self._values = np.zeros(d * d * count + READ, dtype=np.float32)
        size = d * self.nodes
        self._inverse, self._change, self._r = np.empty((self.nodes, d, d)), np.empty(size), np.empty(size)

    def _number(self, parts: MatrixParts) -> None:
        """Find the place of each column among the displacements of this rank and, behind them, of others."""
        from petsc4py import PETSc

        d, size = self.d, len(self.rows)
        place = np.full(self._K.getLocalSize()[1], -1, dtype=np.int32)
        place[self.rows] = np.where(self._left, -1, np.arange(size))
        self.begin = self._comm.tompi4py().exscan(self.nodes) or 0
        known, wanted = self._K.createVecRight(), PETSc.Vec().createSeq(len(parts.others))
        known.array_w[:] = np.where(place < 0, -1, place + d * self.begin)
        columns = PETSc.IS().createGeneral(parts.others, comm=PETSc.COMM_SELF)  # type: ignore[arg-type]
        scatter = PETSc.Scatter().create(known, columns, wanted, None)  # type: ignore[arg-type]
        scatter.scatter(known, wanted, addv=PETSc.InsertMode.INSERT_VALUES)
        beyond = wanted.array_r.astype(np.int64)
        there = np.unique(beyond[beyond >= 0] // d).astype(np.int32)
        found = d * (self.nodes + np.searchsorted(there, beyond // d)) + beyond % d
        self._places = (place, np.where(beyond < 0, -1, found).astype(np.int32))
        for thing in (known, wanted, columns, scatter):
            thing.destroy()
        self.ghosts = len(there)
        self.x = np.zeros(d * (self.nodes + self.ghosts))
        self._shared = None
        if self._comm.size > 1:
            shared = PETSc.Vec()
            self._shared = shared.createGhostWithArray(there, self.x, (size, None), d, self._comm)  # type: ignore[arg-type]

    def _places_read(self) -> None:
        self._read = MatrixParts(self._K, self._c)
        self.parts = self._read.read(self._places)

    def share(self) -> None:
        """Give other ranks what they need of `x`."""
        if self._shared is not None:
            self._shared.ghostUpdate()

    def take(self) -> None:
        """Take K as it is now."""
        self._places_read()
        buffer, c = self._c.ffi.from_buffer, self._c
        ints = [buffer("int32_t[]", array) for array in (self._starts, self._columns, self.scratch)]
        diagonal, values = np.empty_like(self._inverse), buffer("float[]", self._values)
        rows = (self.nodes, self.d, buffer("int32_t[]", self.rows), buffer("int8_t[]", self._left), self.parts)
        c.lib.level_take(*rows, *ints, values, buffer("double[]", diagonal))
        self._inverse[:] = np.linalg.inv(diagonal)
        self._matrix = (self.nodes, *ints[:2], values)
        # Of the vector zero there is no product: no row has an entry.
        self._no_matrix = (self.nodes, buffer("int32_t[]", np.zeros_like(self._starts)), ints[1], values)
        self._largest = SAFE * self._largest_eigenvalue()

    def _largest_eigenvalue(self) -> float:
        """Of D^-1 K, from below."""
        comm, mine = self._comm.tompi4py(), self.x[: len(self.rows)]
        b = np.zeros(len(self.rows))
        mine[:] = np.random.default_rng(self._comm.rank).normal(size=len(mine))
        size = math.sqrt(comm.allreduce(float(mine @ mine)))
        for _ in range(POWERS):
            mine /= size
            self._step(self._matrix, b, 0.0, 1.0)
            mine[:] = self._change
            size = math.sqrt(comm.allreduce(float(mine @ mine)))
        return size

    def _step(self, matrix: tuple[object, ...], b: Array, keep: float, add: float) -> None:
        """Put keep * change + add * D^-1 (b - K x) into the change."""
        self.share()
        b_c, x, inverse, change = (
            self._c.ffi.from_buffer("double[]", array) for array in (b, self.x, self._inverse, self._change)
        )
        getattr(self._c.lib, f"level_step_{self.d}")(*matrix, b_c, x, inverse, keep, add, change)

    def smooth(self, b: Array, begin: bool) -> None:
        """Bring `x` nearer to K^-1 b where errors change from node to node.

        Args:
            b: The right side, this rank's entries.
            begin: Whether from zero, whatever `x` is.
        """
        if begin:
            self.x[:] = 0.0
        for k in range(1, DEGREE + 1):
            keep, add = ((2 * k - 3) / (2 * k + 1) if k > 1 else 0.0), (8 * k - 4) / (2 * k + 1) / self._largest
            self._step(self._no_matrix if begin and k == 1 else self._matrix, b, keep, add)
            self.x[: len(b)] += self._change

    def residual(self, b: Array) -> Array:
        """b - K x, this rank's entries; a view that the next call overwrites."""
        self.share()
        b_c, x, r = (self._c.ffi.from_buffer("double[]", array) for array in (b, self.x, self._r))
        getattr(self._c.lib, f"level_residual_{self.d}")(*self._matrix, b_c, x, r)
        return self._r

    def release(self) -> None:
        """Destroy what PETSc holds."""
        if self._shared is not None:
            self._shared.destroy()
