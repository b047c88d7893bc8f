"""The coarser level below quadratic displacements: linear ones, on the same mesh, by PETSc's multigrid GAMG.

A node on an edge moves half as far as both of the edge's corners together; corners move as they are. The level's matrix is
P^T K P with this P, an eighth of K's rows and a fifteenth of its entries. GAMG makes still coarser levels of it by smoothed
aggregation and is told of the rigid motions: without that iterations triple.
"""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.assembled import mark_symmetric
from softmodels.mechanics.c_library import library

if TYPE_CHECKING:
    from dolfinx import fem

    from softmodels.mechanics.quadratic_level import QuadraticLevel

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]
Longs = npt.NDArray[np.int64]

PREFIX = "body_"
OPTIONS = {
    "pc_gamg_threshold": "0.01",
    "pc_gamg_reuse_interpolation": "true",  # its set-up for another state is its products alone
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_pc_type": "sor",
}
"""PETSc's options of the coarser levels; those that the user gives under the same prefix stand."""


def corners_of(space: fem.FunctionSpace) -> tuple[Ints, Longs]:
    """The owned nodes of quadratic displacements that are corners of cells, and the two corners each owned node lies between.

    Args:
        space: The space of the displacements alone.

    Returns:
        Their local numbers, rising; and numbers of corners over all ranks, shape (owned nodes, 2).
    """
    import basix
    from dolfinx import la

    of, layout, index_map = np.array(space.dofmap.list), space.dofmap.dof_layout, space.dofmap.index_map
    cell = space.mesh.basix_cell()
    vertices = [of[:, layout.entity_dofs(0, k)[0]] for k in range(len(basix.topology(cell)[0]))]
    corners = np.unique(vertices)
    own = corners[corners < index_map.size_local].astype(np.int32)
    numbers = la.vector(index_map, 1)  # a double has room for any of them
    numbers.array[own] = np.arange(len(own)) + (space.mesh.comm.exscan(len(own)) or 0)
    numbers.scatter_forward()
    between = np.zeros((len(numbers.array), 2), dtype=np.int64)
    between[corners] = numbers.array[corners, None]
    for k, ends in enumerate(basix.topology(cell)[1]):
        between[of[:, layout.entity_dofs(1, k)[0]]] = np.column_stack([numbers.array[vertices[end]] for end in ends])
    return own, between[: index_map.size_local]


class LinearLevel:
    """P^T K P and GAMG on it.

    Args:
        above: Displacements' level.
        space: The space of the displacements alone.
        held: Which of the displacements of this rank are held, shape (nodes, d).
        motions: The rigid motions at this rank's nodes, zero where they are held, shape (motions, nodes, d).
    """

    def __init__(self, above: QuadraticLevel, space: fem.FunctionSpace, held: npt.NDArray[np.bool_], motions: Array):
        from petsc4py import PETSc

        self._above, self._comm, d = above, space.mesh.comm, above.d
        self._c = library(self._comm, "multigrid")
        own, between = corners_of(space)
        self._number(len(own), between)
        self._children()
        self._held = np.ascontiguousarray(held, dtype=np.int8)
        begin = self._numbers[0] if len(own) else 0
        self._held_here = np.flatnonzero(held[own]).astype(np.int32)
        self._held_rows = (self._held_here + d * begin).astype(np.int32)
        size = (d * len(own), PETSc.DETERMINE)
        self._matrix = PETSc.Mat().createAIJ((size, size), bsize=d, comm=self._comm)
        self._matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)  # type: ignore[arg-type]
        mark_symmetric(self._matrix)
        self._assemble()
        self._b, self._x = self._matrix.createVecRight(), self._matrix.createVecRight()
        self._make_cycle(motions[:, own].reshape(len(motions), -1))

    def _number(self, own: int, between: Longs) -> None:
        """Number the corners around the nodes above, those of other ranks behind one's own."""
        from petsc4py import PETSc

        above, begin = self._above, self._comm.exscan(own) or 0
        above.x.reshape(-1, above.d)[: above.nodes, :2] = between
        above.share()
        between = above.x.reshape(-1, above.d)[:, :2].astype(np.int64)
        others = np.unique(between[(between < begin) | (between >= begin + own)])
        self._numbers: Ints = np.concatenate([begin + np.arange(own), others]).astype(np.int32)
        mine = (between >= begin) & (between < begin + own)
        self._between = np.where(mine, between - begin, own + np.searchsorted(others, between)).astype(np.int32)
        self._own, self._values = own * above.d, np.zeros(len(self._numbers) * above.d)
        self._shared = None
        if self._comm.size > 1:
            shared, ghosts, size = PETSc.Vec(), self._numbers[own:], (self._own, None)
            self._shared = shared.createGhostWithArray(ghosts, self._values, size, above.d, self._comm)  # type: ignore[arg-type]

    def _children(self) -> None:
        """List the nodes above that lie between each corner and another."""
        nodes = self._above.nodes
        corners = self._between[:nodes].ravel()
        self._child = (np.argsort(corners, kind="stable") // 2).astype(np.int32)
        counts = np.bincount(corners, minlength=len(self._numbers))
        self._starts: Ints = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)

    def _assemble(self) -> None:
        """Put P^T K P into the matrix; held corners' rows and columns are the identity."""
        from petsc4py import PETSc

        ffi, above, d, corners = self._c.ffi, self._above, self._above.d, len(self._numbers)
        buffers = [np.full(corners, -1, np.int32), np.empty(corners, np.int32), np.empty(corners, np.int32)]
        ints = [ffi.from_buffer("int32_t[]", a) for a in (self._starts, self._child, above.rows)]
        more = [ffi.from_buffer("int32_t[]", a) for a in (self._between, self._numbers, *buffers)]
        room = [ffi.from_buffer("double[]", np.empty(d * d * corners)) for _ in range(2)]
        function = ctypes.cast(ctypes.CDLL(PETSc.__file__).MatSetValuesBlocked, ctypes.c_void_p).value
        into = [ffi.cast("void *", function), ffi.cast("void *", self._matrix.handle)]
        held = ffi.from_buffer("int8_t[]", self._held)
        error = self._c.lib.level_galerkin(corners, d, *ints, held, above.parts, *more, *room, *into)
        if error:
            raise PETSc.Error(error)
        self._matrix.assemble()
        self._matrix.zeroRowsColumns(self._held_rows, 1.0)  # type: ignore[arg-type]

    def _make_cycle(self, motions: Array) -> None:
        """Make GAMG, with what it is told of rigid motions."""
        from petsc4py import PETSc

        vectors = [self._matrix.createVecRight() for _ in motions]
        for i, (vector, motion) in enumerate(zip(vectors, motions, strict=True)):
            vector.array_w[:] = motion
            for before in vectors[:i]:
                vector.axpy(-vector.dot(before), before)
            vector.normalize()
        self._matrix.setNearNullSpace(PETSc.NullSpace().create(vectors=vectors, comm=self._comm))
        cycle = self._cycle = PETSc.PC().create(self._comm)
        cycle.setOptionsPrefix(PREFIX)
        cycle.setOperators(self._matrix, self._matrix)
        cycle.setType("gamg")
        options = PETSc.Options(PREFIX)
        own = {name: value for name, value in OPTIONS.items() if not options.hasName(name)}
        for name, value in own.items():
            options.setValue(name, value)
        cycle.setFromOptions()
        cycle.setUp()  # which reads the options of the levels
        cycle.setReusePreconditioner(True)
        for name in own:
            options.delValue(name)

    def take(self) -> None:
        """Take K as the level above has it now."""
        self._matrix.zeroEntries()
        self._assemble()
        self._cycle.setReusePreconditioner(False)
        self._cycle.setUp()
        self._cycle.setReusePreconditioner(True)

    def correct(self, residual: Array) -> None:
        """Add to the vector above what a cycle makes of a residual there."""
        from petsc4py import PETSc

        above, buffer = self._above, self._c.ffi.from_buffer
        level = (above.nodes, above.d, buffer("int32_t[]", self._between))
        self._values[:] = 0.0
        self._c.lib.level_restrict(*level, buffer("double[]", residual), buffer("double[]", self._values))
        if self._shared is not None:
            self._shared.ghostUpdate(PETSc.InsertMode.ADD_VALUES, PETSc.ScatterMode.REVERSE)
        self._values[self._held_here] = 0.0
        self._b.array_w[:] = self._values[: self._own]
        self._cycle.apply(self._b, self._x)
        self._values[: self._own] = self._x.array_r
        self._values[self._held_here] = 0.0
        if self._shared is not None:
            self._shared.ghostUpdate()
        self._c.lib.level_prolong(*level, buffer("double[]", self._values), buffer("double[]", above.x))

    def release(self) -> None:
        """Destroy what PETSc holds."""
        for thing in (self._cycle, self._b, self._x, self._matrix, self._shared):
            if thing is not None:
                thing.destroy()
