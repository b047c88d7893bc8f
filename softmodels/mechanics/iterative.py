"""Multigrid as preconditioner of K, for models too large to factorise.

A cycle is one on the displacements plus the pressures' mass: an approximate K^-1 at linear cost.

        [ K_uu  K_up ]      [ M  K_up ]^-1    M: K_uu on quadratic displacements, then on linear ones, then PETSc's GAMG;
        [ K_pu  -C   ]  ~   [ 0   -S  ]       S: (1/shear modulus + 1/bulk modulus) times the diagonal of p's mass

The right side is the upper factor of K's block elimination, with the Schur complement C + K_pu K_uu^-1 K_up near p's mass
(Elman, Silvester, Wathen 2014, Finite Elements and Fast Iterative Solvers, chapter 4). The unknowns are skew components
w = B u, so GAMG's rigid motions are rotated by B too.

Own levels in C are kept: a whole run takes 1.5 and 1.42 times the CPU time at 37,120 and 181,940 unknowns (thin disk's
wedge, one rank, AMD EPYC family 26, AVX-512) with PETSc's PCMG on the same two levels, four steps of its Chebyshev iteration
of the fourth kind with pbjacobi on a BAIJ matrix, GAMG below. Three and two steps, or AIJ, take longer.
"""

from __future__ import annotations

import ctypes
import itertools
import math
from types import ModuleType

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.common.lazy import PETSc, basix, fem, la, ufl
from softmodels.mechanics import assembly, compiling, newton
from softmodels.mechanics.system import System

NONE = np.empty(0, dtype=np.int32)
AGEING_TOLERANCE = 1e-4
"""Tolerance below which a solve shows the age of a cycle."""
BASE_BYTES, PER_ENTRY, PER_UNKNOWN = 15e6, 15, 80
"""Memory of a rank: bytes whatever the model, bytes per entry of K (blocks in single precision, those to p, the linear level),
and vectors (of the levels, of GMRES, and of the tracked modes). Measured along the paths of wedges of 17,300, 37,120,
70,113 and 181,940 unknowns, mass matrix included: 54, 107, 188 and 486 MB taken, 57, 107, 189 and 476 MB predicted."""
PER_SHARED_ENTRY = 19
"""The same per entry on several ranks, whose matrices PETSc keeps in two parts. Paths past a limit point, 70,113 and 181,940
unknowns on two ranks: 0.23 and 0.56 GB taken on both, 0.23 and 0.56 GB predicted."""


class Multigrid(newton.Preconditioner):
    """The block triangular map above, without owned dofs that are ``fixed`` beside those that are held."""

    exact = False
    max_solve_iterations = 150
    max_total_iterations = 12
    max_newton_iterations = 9
    restart, max_linear_iterations = 80, 200
    instead = ": multigrid may fail if one material is much stiffer than another or cells are very flat; use --solver direct"

    def __init__(self, system: System, fixed: npt.NDArray[np.int32] = NONE):
        self.system, self.K, self._fixed = system, system.K, fixed
        self._entries = self._fresh = 0.0
        self._make_fields()
        self._make_weights()
        self._levels: tuple[QuadraticLevel, LinearLevel] | None = None
        self._coupling: PETSc.Mat | None = None

    @staticmethod
    def memory(system: System) -> float:
        """Return the memory of a cycle on this rank in bytes, from the entries of the assembled K."""
        K = system.K
        entries, unknowns = newton.entries_here(K), K.getLocalSize()[0]
        return BASE_BYTES + (PER_ENTRY if K.comm.size == 1 else PER_SHARED_ENTRY) * entries + 8 * PER_UNKNOWN * unknowns

    def _make_fields(self) -> None:
        """The rows of displacements, node by node, and those of p."""
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
        self._held = np.concatenate([assembly.held_dofs(system.bcs), self._fixed])
        self._rows = [
            PETSc.IS().createGeneral(rows + start, comm=self.K.comm)  # type: ignore[arg-type]
            for rows in (self._u, self._p)
        ]

    def _make_weights(self) -> None:
        system = self.system
        if not system.mixed:
            return
        q = ufl.split(ufl.TestFunction(system.space))[1]
        self._weights = [fem.Constant(system.body.mesh, 1.0) for _ in system.potential.regions]
        regions = zip(self._weights, system.potential.regions, strict=True)
        self._lumped = [system.form(weight * q * system.body.hoop * region.dx) for weight, region in regions]

    def set_up(self) -> None:
        entries = newton.entries_in_all(self.K)
        if self._levels is not None and entries != self._entries:  # contact has added couplings
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
        """Return the rigid motions as skew components, zero where they are held, shape (motions, owned nodes, d)."""
        body = self.system.body
        d = body.mesh.geometry.dim
        x = self._places[:, :d]
        motions = [np.tile(axis, (len(x), 1)) for axis in np.eye(d)]
        for i, j in itertools.combinations(range(d), 2):
            turn = np.zeros_like(x)
            turn[:, i], turn[:, j] = -x[:, j], x[:, i]
            motions.append(turn)
        free = np.ones(self.K.getLocalSize()[0])
        free[self._held] = 0.0
        return np.array([motion @ body.skew.T * free[self._u].reshape(-1, d) for motion in motions])

    def _schur_diagonal(self) -> Array:
        """Return S of the module's docstring at owned p."""
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
        given, solution = b.array_r, x.array_w
        force = given[self._u]
        if self._coupling is not None:
            pressures = -given[self._p] / self._schur
            self._pressures.array_w[:] = pressures
            self._coupling.mult(self._pressures, self._b)
            force -= self._b.array_r
            solution[self._p] = pressures
        quadratic, linear = self._levels
        quadratic.smooth(force, begin=True)
        linear.correct(quadratic.residual(force))
        quadratic.smooth(force, begin=False)
        solution[self._u] = quadratic.x[: len(force)]
        # Coarser levels move held dofs slightly, which no residual detects: states would drift off their supports.
        solution[self._held] = given[self._held]

    def equivalent_iterations(self, iterations: int, tolerance: float) -> int:
        """Return the iterations beyond those of the first solve after a set-up, of tight solves: loose ones are not
        informative."""
        if tolerance > AGEING_TOLERANCE:
            return 0
        rate = iterations / -math.log10(tolerance)
        if not self._fresh:
            self._fresh = rate
        return max(0, round((rate - self._fresh) * -math.log10(tolerance)))

    def negative_pivots(self) -> int:
        raise NotImplementedError("a multigrid cycle does not provide K's inertia")

    def _drop(self) -> None:
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


# ----------------------------------------------------------------------------------------------------------------------
# The local rows of a PETSc matrix for C code, without copying.


Ints = npt.NDArray[np.int32]


class MatrixParts:
    """The columns of this rank in an assembled matrix with as many columns on each rank as rows, and ``others``: numbers of
    those of others, rising."""

    def __init__(self, matrix: PETSc.Mat, c: ModuleType):
        self._petsc, self._c, self._matrix = ctypes.CDLL(PETSc.__file__), c, matrix
        self.others, handles = np.empty(0, dtype=np.int32), [ctypes.c_void_p(matrix.handle)]
        if matrix.comm.size > 1:
            here, beyond, columns = ctypes.c_void_p(), ctypes.c_void_p(), ctypes.POINTER(ctypes.c_int32)()
            pointers = [ctypes.byref(output) for output in (here, beyond, columns)]
            self._call("MatMPIAIJGetSeqAIJ", handles[0], *pointers)
            handles, count = [here, beyond], ctypes.c_int32()
            self._call("MatGetLocalSize", beyond, None, ctypes.byref(count))
            self.others = np.array(columns[: count.value], dtype=np.int32)
        self._handles = handles

    def read(self, places: tuple[Ints, Ints]) -> object:
        """Return the rows with their values as they are now, for the C code. The places say what stands for each column of
        this rank, and for each of `others`; they have to outlive what is returned."""
        ffi = self._c.ffi
        parts = ffi.new("part[2]")
        for part, handle, place in zip(parts, self._handles, places, strict=False):
            count, done = ctypes.c_int32(), ctypes.c_int()
            starts, columns, values = (ctypes.c_void_p() for _ in range(3))
            rows = [ctypes.byref(output) for output in (count, starts, columns, done)]
            self._call("MatGetRowIJ", handle, 0, 0, 0, *rows)
            self._call("MatSeqAIJGetArrayRead", handle, ctypes.byref(values))
            part.starts, part.columns = (ffi.cast("int32_t *", pointer.value or 0) for pointer in (starts, columns))
            part.values = ffi.cast("double *", values.value or 0)
            part.places = ffi.from_buffer("int32_t[]", place)
        if len(self._handles) == 1:
            self._none = np.zeros(self._matrix.getLocalSize()[0] + 1, dtype=np.int32)
            parts[1].starts = ffi.from_buffer("int32_t[]", self._none)
        return parts

    def _call(self, function: str, *given: object) -> None:
        error = getattr(self._petsc, function)(*given)
        if error:
            raise PETSc.Error(error)


# ----------------------------------------------------------------------------------------------------------------------
# Displacements as a level of multigrid: their block of K in single precision, and Chebyshev's iteration on it.
#
# A product reads 4.5 bytes for an entry where PETSc's reads 12. The polynomials are those of the fourth kind, which need to
# know no more than the largest eigenvalue of D^-1 K, D its blocks on the diagonal (Lottes 2023, Optimal polynomial smoothers
# for multigrid V-cycles, doi 10.1002/nla.2518, section 3).


CHEBYSHEV_STEPS = 4
"""Steps of Chebyshev's iteration before and after the coarser level."""
POWER_ITERATIONS, EIGENVALUE_SAFETY_FACTOR = 15, 1.1
"""Steps of the power method towards the largest eigenvalue, and what it is multiplied with."""
ENTRIES_AT_ONCE = 4
"""Entries that C code reads at once."""


class QuadraticLevel:
    """Displacements' rows of an assembled K on this rank, by blocks of a node and another. For rows that are ``left`` out the
    identity stands.

    ``x`` is the level's vector: nodes of this rank, then those of others in their rows; ``parts`` are K's rows for the C code,
    with the values of the last `take`.
    """

    def __init__(self, K: PETSc.Mat, rows: Ints, d: int, left: npt.NDArray[np.bool_]):
        self._comm, self.rows, self.d, self.nodes = K.comm, rows, d, len(rows) // d
        self._c = compiling.library(K.comm.tompi4py(), "multigrid")
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
        self._values = np.zeros(d * d * count + ENTRIES_AT_ONCE, dtype=np.float32)
        size = d * self.nodes
        self._inverse, self._change, self._r = np.empty((self.nodes, d, d)), np.empty(size), np.empty(size)

    def _number(self, parts: MatrixParts) -> None:
        """Find the place of each column among the displacements of this rank and, behind them, of others."""
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
        dofs = d * (self.nodes + np.searchsorted(there, beyond // d)) + beyond % d
        self._places = (place, np.where(beyond < 0, -1, dofs).astype(np.int32))
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
        """Send other ranks their entries of `x`."""
        if self._shared is not None:
            self._shared.ghostUpdate()

    def take(self) -> None:
        """Update from the current K."""
        self._places_read()
        buffer, c = self._c.ffi.from_buffer, self._c
        ints = [buffer("int32_t[]", array) for array in (self._starts, self._columns, self.scratch)]
        diagonal, values = np.empty_like(self._inverse), buffer("float[]", self._values)
        rows = (self.nodes, self.d, buffer("int32_t[]", self.rows), buffer("int8_t[]", self._left), self.parts)
        c.lib.level_take(*rows, *ints, values, buffer("double[]", diagonal))
        self._inverse[:] = np.linalg.inv(diagonal)
        self._matrix = (self.nodes, *ints[:2], values)
        # no rows with entries: the product is empty
        self._no_matrix = (self.nodes, buffer("int32_t[]", np.zeros_like(self._starts)), ints[1], values)
        self._largest = EIGENVALUE_SAFETY_FACTOR * self._largest_eigenvalue()

    def _largest_eigenvalue(self) -> float:
        """Of D^-1 K, from below."""
        comm, mine = self._comm.tompi4py(), self.x[: len(self.rows)]
        b = np.zeros(len(self.rows))
        mine[:] = np.random.default_rng(self._comm.rank).normal(size=len(mine))
        size = math.sqrt(comm.allreduce(float(mine @ mine)))
        for _ in range(POWER_ITERATIONS):
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
        """Smooth the error of `x` in K x = b, of this rank's entries; ``begin`` from zero, whatever `x` is."""
        if begin:
            self.x[:] = 0.0
        for k in range(1, CHEBYSHEV_STEPS + 1):
            keep, add = ((2 * k - 3) / (2 * k + 1) if k > 1 else 0.0), (8 * k - 4) / (2 * k + 1) / self._largest
            self._step(self._no_matrix if begin and k == 1 else self._matrix, b, keep, add)
            self.x[: len(b)] += self._change

    def residual(self, b: Array) -> Array:
        """Return b - K x, this rank's entries; a view that the next call overwrites."""
        self.share()
        b_c, x, r = (self._c.ffi.from_buffer("double[]", array) for array in (b, self.x, self._r))
        getattr(self._c.lib, f"level_residual_{self.d}")(*self._matrix, b_c, x, r)
        return self._r

    def release(self) -> None:
        """Destroy the PETSc objects."""
        if self._shared is not None:
            self._shared.destroy()


# ----------------------------------------------------------------------------------------------------------------------
# The coarser level below quadratic displacements: linear ones, on the same mesh, by PETSc's multigrid GAMG.
#
# An edge node moves by the mean of the edge's corners; corners map to themselves. The level's matrix is
# P^T K P with this P, an eighth of K's rows and a fifteenth of its entries. GAMG builds coarser levels by smoothed aggregation
# with the rigid motions as near-nullspace: without them iterations triple.


Longs = npt.NDArray[np.int64]

OPTIONS = {
    "pc_gamg_threshold": "0.01",
    "pc_gamg_reuse_interpolation": "true",  # setting up for another state needs only its products
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_pc_type": "sor",
}
"""PETSc's options of the coarser levels; user options under the same prefix take precedence."""


def corners_of(space: fem.FunctionSpace) -> tuple[Ints, Longs]:
    """Return the owned nodes of a space of quadratic displacements that are corners of cells (local numbers, rising), and the
    two corners between which each owned node lies (numbers over all ranks, shape (owned nodes, 2))."""
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
    """P^T K P and GAMG on it, below displacements' level; ``held``, shape (nodes, d), are the displacements of this rank that
    are held, ``motions`` the rigid motions, zero there, shape (motions, nodes, d)."""

    def __init__(self, above: QuadraticLevel, space: fem.FunctionSpace, held: npt.NDArray[np.bool_], motions: Array):
        self._above, self._comm, d = above, space.mesh.comm, above.d
        self._c = compiling.library(self._comm, "multigrid")
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
        assembly.mark_symmetric(self._matrix)
        self._assemble()
        self._b, self._x = self._matrix.createVecRight(), self._matrix.createVecRight()
        self._make_cycle(motions[:, own].reshape(len(motions), -1))

    def _number(self, own: int, between: Longs) -> None:
        """Number the corners around the nodes above, the own ones before those of other ranks."""
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
        vectors = [self._matrix.createVecRight() for _ in motions]
        for i, (vector, motion) in enumerate(zip(vectors, motions, strict=True)):
            vector.array_w[:] = motion
            for before in vectors[:i]:
                vector.axpy(-vector.dot(before), before)
            vector.normalize()
        self._matrix.setNearNullSpace(PETSc.NullSpace().create(vectors=vectors, comm=self._comm))
        cycle = self._cycle = PETSc.PC().create(self._comm)
        cycle.setOptionsPrefix(newton.OPTIONS_PREFIX)
        cycle.setOperators(self._matrix, self._matrix)
        cycle.setType("gamg")
        options = PETSc.Options(newton.OPTIONS_PREFIX)
        own = {name: value for name, value in OPTIONS.items() if not options.hasName(name)}
        for name, value in own.items():
            options.setValue(name, value)
        cycle.setFromOptions()
        cycle.setUp()  # which reads the options of the levels
        cycle.setReusePreconditioner(True)
        for name in own:
            options.delValue(name)

    def take(self) -> None:
        """Update from the K of the level above."""
        self._matrix.zeroEntries()
        self._assemble()
        self._cycle.setReusePreconditioner(False)
        self._cycle.setUp()
        self._cycle.setReusePreconditioner(True)

    def correct(self, residual: Array) -> None:
        """Add the coarse-grid correction of a residual to the vector above."""
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
        """Destroy the PETSc objects."""
        for thing in (self._cycle, self._b, self._x, self._matrix, self._shared):
            if thing is not None:
                thing.destroy()


# ----------------------------------------------------------------------------------------------------------------------
# The multigrid cycle with moving rigid parts: a cycle for the free dofs, and the parts' few unknowns.
#
#         [ K_ff  K_fs ]^-1     [ M  0 ]                            f: what follows no part,  s: the parts' unknowns;
#         [ K_sf  K_ss ]     ~  [ 0  0 ] + L (L^T K L)^-1 L^T       L = [ -Y ; 1 ],  Y near K_ff^-1 K_fs
#
# With M = K_ff^-1 and Y = K_ff^-1 K_fs this is the inverse of K by blocks. M treats the parts as held: it is the cycle of
# the device clamped at the parts. L is the response of the device to a change of a single unknown of a part, by a few
# iterations with M. L^T K L is then K's Schur complement up to the square of L's error, for any stiffness of the device.


FOLLOWER_SOLVE_TOLERANCE = 1e-2
"""Relative tolerance of the iterations for L: six for each unknown of a finger's tip."""


class RigidCycle(Multigrid):
    """The map above, of a system with rigid parts."""

    def __init__(self, system: System):
        unknowns, comm = system.unknowns, system.comm
        mine = [slots for rank, slots in unknowns.slots if rank == comm.rank]
        self._own = np.concatenate([*mine, unknowns.idle[:0]]).astype(np.int32)
        super().__init__(system, np.concatenate([self._own, unknowns.idle]))
        counts = comm.allgather(len(self._own))
        self._before = sum(counts[: comm.rank])  # unknowns of the ranks before this one
        self._following = [self.K.createVecRight() for _ in range(sum(counts))]
        self._stiffness = np.empty((0, 0))
        self._one, self._force = self.K.createVecRight(), self.K.createVecRight()
        self._shell = newton.Shell(self._free_product, self._free_cycle)
        self._make_solver()

    def _make_solver(self) -> None:
        """Make the iterations for L: on K with the parts held, by the cycle."""
        self._free = PETSc.Mat().createPython(self.K.getSizes(), context=self._shell, comm=self.K.comm)
        self._free.setUp()
        self._solver = PETSc.KSP().create(self.K.comm)
        self.on_the_right(self._solver, self._shell, FOLLOWER_SOLVE_TOLERANCE, self.restart)
        self._solver.setOperators(self._free)

    @staticmethod
    def memory(system: System) -> float:
        """See `Multigrid.memory`; a vector for each unknown of a part more."""
        vectors = sum(motion.freedom.count for motion in system.unknowns.moving.values())
        return Multigrid.memory(system) + 8.0 * vectors * system.K.getLocalSize()[0]

    def set_up(self) -> None:
        super().set_up()
        for number, following in enumerate(self._following):
            self._follow(number - self._before, following)
        products = []
        for following in self._following:
            self.K.mult(following, self._force)
            products.append(self._force.mDot(self._following))
        self._stiffness = np.array(products)

    def _follow(self, number: int, following: PETSc.Vec) -> None:
        """Put into ``following`` how the device follows one of this rank's unknowns, by number, or of another rank's."""
        unknown = self._own[number : number + 1] if 0 <= number < len(self._own) else self._own[:0]
        self._one.set(0.0)
        self._one.array_w[unknown] = -1.0
        self.K.mult(self._one, self._force)
        self._force.array_w[self._own] = 0.0
        self._solver.solve(self._force, following)  # a solve short of the tolerance costs iterations later, not accuracy
        following.array_w[self._own] = 0.0
        following.array_w[unknown] = 1.0

    def apply(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        super().apply(b, x)
        if self._following:
            x.array_w[self._own] = 0.0
            amounts = np.linalg.solve(self._stiffness, b.mDot(self._following))
            x.maxpy(amounts.tolist(), self._following)

    def release(self) -> None:
        super().release()
        for thing in (self._solver, self._free, self._one, self._force, *self._following):
            thing.destroy()

    # PETSc calls these, of K with the parts held and of its preconditioner.

    def _free_product(self, mat: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        x.copy(self._one)
        self._one.array_w[self._own] = 0.0
        self.K.mult(self._one, y)
        y.array_w[self._own] = x.array_r[self._own]

    def _free_cycle(self, pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        super().apply(x, y)
