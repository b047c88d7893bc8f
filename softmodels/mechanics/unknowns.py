"""What Newton's method solves for, where that is not every dof: w = T(q).

A state's dofs w stay whole everywhere else. Without rigid parts q is the owned part of w, and nothing here costs anything. With
them q has the same length and the same layout: a part's few unknowns (`RigidMotion`) sit in the slots of some of the dofs that
follow it, and the others' rows are the identity, as at held dofs. The residual is T^T r, the tangent T^T K T and, where a part
can turn, r times T's second derivative.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.assembled import mark_symmetric
from softmodels.mechanics.rigid_motion import RigidMotion

if TYPE_CHECKING:
    from mpi4py import MPI
    from petsc4py import PETSc

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]


class Unknowns:
    """The owned dofs themselves.

    Args:
        n: How many there are.

    Attributes:
        idle: Owned entries of q that stand for nothing.
        turns: Whether T is other than linear.
        moving: The motions of rigid parts by their names.
        slots: For each of them the rank that has its unknowns, and the entries of q that they are there (none elsewhere).
    """

    idle: Ints = np.empty(0, dtype=np.int32)
    turns = False
    moving: Mapping[str, RigidMotion] = {}
    slots: Sequence[tuple[int, npt.NDArray[np.int64]]] = ()

    def __init__(self, n: int):
        self.n = n

    def begin(self, w: Array) -> Array:
        """Take the state of local dofs w, from which unknowns count where a part can turn; its q, shape (n,)."""
        return w[: self.n]

    def take(self, w: Array) -> None:
        """Take the state of local dofs w."""

    def place(self, q: Array, w: Array) -> None:
        """Take the state q, and put its dofs into w."""
        w[: self.n] = q

    def push(self, q: Array, w: Array) -> None:
        """Put into w how the dofs change as the unknowns change by q."""
        w[: self.n] = q

    def nearest(self, w: Array) -> Array:
        """The change of the unknowns by which the dofs change most nearly by w, shape (n,)."""
        return w[: self.n]

    def pull(self, b: Array) -> None:
        """Turn owned entries conjugate to w into those conjugate to q."""

    def matrix(self, whole: PETSc.Mat, fill: Callable[[], None]) -> PETSc.Mat:
        """A matrix with the pattern of the reduced one.

        Args:
            whole: K, not yet assembled.
            fill: Assembles it.
        """
        return whole

    def reduce(self, whole: PETSc.Mat, forces: Callable[[], Array]) -> None:
        """Put T^T K T, for the assembled K, and the second derivatives' part into what `matrix` made.

        Args:
            whole: K.
            forces: Gives the residual conjugate to w, owned entries.
        """

    def projected(self, whole: PETSc.Mat, into: PETSc.Mat | None = None) -> PETSc.Mat:
        """T^T M T of another matrix; what was made before is made anew where a part has turned."""
        return whole

    def stiffen(self, q: Array, y: Array, forces: Callable[[], Array]) -> None:
        """Add the second derivatives' part of the tangent times q to y; see `reduce`."""


class RigidUnknowns(Unknowns):
    """Unknowns of a body with rigid parts.

    Args:
        comm: Communicator.
        n: Number of owned dofs.
        motions: The parts' motions by their names; no dof follows two of them.
        held: Local dofs that are held, where parts do not move either.

    Raises:
        ValueError: The mesh has too few dofs on a part for its unknowns.
    """

    def __init__(self, comm: MPI.Comm, n: int, motions: Mapping[str, RigidMotion], held: Ints):
        super().__init__(n)
        self.comm, self.moving, self.motions = comm, motions, tuple(motions.values())
        self.turns = any(motion.turns for motion in self.motions)
        self.slots = [_slots(comm, n, motion, held, name) for name, motion in motions.items()]
        followers = np.concatenate([motion.dofs[motion.owned].ravel() for motion in self.motions])
        mine = [slots for rank, slots in self.slots if rank == comm.rank]
        self.idle = np.setdiff1d(followers, np.concatenate([*mine, np.empty(0, int)])).astype(np.int32)
        self._curvatures: list[Array] | None = None

    def begin(self, w: Array) -> Array:
        self.take(w)
        q = w[: self.n].copy()
        q[self.idle] = 0.0
        for motion, (rank, slots) in zip(self.motions, self.slots, strict=True):
            if rank == self.comm.rank:
                q[slots] = motion.values
        return q

    def take(self, w: Array) -> None:
        self._curvatures = None
        for motion in self.motions:
            motion.take(w)

    def _values(self, q: Array) -> list[Array]:
        """Each part's own values in q."""
        own = [q[slots] if rank == self.comm.rank else None for rank, slots in self.slots]
        if self.comm.size == 1:
            return [values for values in own if values is not None]
        return [self.comm.bcast(values, root=rank) for values, (rank, _) in zip(own, self.slots, strict=True)]

    def place(self, q: Array, w: Array) -> None:
        self._curvatures = None
        w[: self.n] = q
        for motion, values in zip(self.motions, self._values(q), strict=True):
            motion.set(values)
            w[motion.dofs] = motion.displacements()

    def push(self, q: Array, w: Array) -> None:
        w[: self.n] = q
        for motion, values in zip(self.motions, self._values(q), strict=True):
            w[motion.dofs] = motion.rates() @ values

    def nearest(self, w: Array) -> Array:
        q = w[: self.n].copy()
        q[self.idle] = 0.0
        for motion, (rank, slots) in zip(self.motions, self.slots, strict=True):
            values = motion.nearest_rate(w)
            if rank == self.comm.rank:
                q[slots] = values
        return q

    def pull(self, b: Array) -> None:
        for motion, (rank, slots) in zip(self.motions, self.slots, strict=True):
            work = motion.work(b)
            b[motion.dofs[motion.owned]] = 0.0
            if rank == self.comm.rank:
                b[slots] = work

    # -- matrices -----------------------------------------------------------------------------------------------------

    def matrix(self, whole: PETSc.Mat, fill: Callable[[], None]) -> PETSc.Mat:
        from petsc4py import PETSc

        fill()  # an empty matrix would lose its pattern
        self._T = PETSc.Mat().createAIJ(whole.getSizes(), csr=self._rows(whole), comm=whole.comm)
        self._product: PETSc.Mat = whole.ptap(self._T)
        self._entries = whole.getInfo()["nz_used"]
        self._ones = whole.createVecLeft()
        self._ones.array_w[self.idle] = 1.0
        diagonal = PETSc.Mat().createDiagonal(self._ones).convert("aij")
        self._reduced: PETSc.Mat = self._product.copy()
        self._reduced.axpy(1.0, diagonal, PETSc.Mat.Structure.DIFFERENT)  # type: ignore[arg-type]
        diagonal.destroy()
        mark_symmetric(self._reduced)
        return self._reduced

    def _rows(self, whole: PETSc.Mat) -> tuple[Ints, Ints, Array]:
        """T, compressed by rows: the identity, and each part's rates."""
        start = whole.getOwnershipRange()[0]
        counts = np.ones(self.n, dtype=np.int32)
        for motion in self.motions:
            counts[motion.dofs[motion.owned]] = motion.freedom.count
        pointers = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        columns = np.repeat(np.arange(start, start + self.n, dtype=np.int32), counts)
        values = np.ones(pointers[-1])
        for motion, (rank, slots) in zip(self.motions, self.slots, strict=True):
            at = self.comm.bcast(start + slots if rank == self.comm.rank else None, root=rank)
            entries = pointers[motion.dofs[motion.owned]][..., None] + np.arange(motion.freedom.count)
            columns[entries] = at
            values[entries] = motion.rates()[motion.owned]
        return pointers, columns, values

    def reduce(self, whole: PETSc.Mat, forces: Callable[[], Array]) -> None:
        from petsc4py import PETSc

        self._take_rates(whole)
        same = whole.getInfo()["nz_used"] == self._entries  # contact couples more and more of them
        self._product = whole.ptap(self._T, self._product if same else None)
        self._entries = whole.getInfo()["nz_used"]
        self._reduced.zeroEntries()
        structure = PETSc.Mat.Structure.SUBSET if same else PETSc.Mat.Structure.DIFFERENT
        self._reduced.axpy(1.0, self._product, structure)  # type: ignore[arg-type]
        mark_symmetric(self._reduced)
        self._reduced.setDiagonal(self._ones, PETSc.InsertMode.ADD)
        start = whole.getOwnershipRange()[0]
        for second, (rank, slots) in zip(self._second(forces), self.slots, strict=False):
            if rank == self.comm.rank:
                at = (start + slots).astype(np.int32)
                self._reduced.setValues(at, at, second, PETSc.InsertMode.ADD)  # type: ignore[arg-type]
        self._reduced.assemble()

    def projected(self, whole: PETSc.Mat, into: PETSc.Mat | None = None) -> PETSc.Mat:
        if into is not None and not self.turns:
            return into
        self._take_rates(whole)
        return whole.ptap(self._T, into)

    def _take_rates(self, whole: PETSc.Mat) -> None:
        """Take the present rates into T."""
        if self.turns:
            self._T.setValuesCSR(*self._rows(whole))  # type: ignore[arg-type]
            self._T.assemble()

    def _second(self, forces: Callable[[], Array]) -> list[Array]:
        """Each part's second derivatives' part of the tangent; nothing where none can turn."""
        if not self.turns:
            return []
        if self._curvatures is None:
            b = forces()
            self._curvatures = [motion.curvature(b) for motion in self.motions]
        return self._curvatures

    def stiffen(self, q: Array, y: Array, forces: Callable[[], Array]) -> None:
        for second, (rank, slots) in zip(self._second(forces), self.slots, strict=False):
            if rank == self.comm.rank:
                y[slots] += second @ q[slots]


def _slots(comm: MPI.Comm, n: int, motion: RigidMotion, held: Ints, name: str) -> tuple[int, npt.NDArray[np.int64]]:
    """The rank that has a part's unknowns, and the owned dofs in whose slots they are there (empty elsewhere)."""
    free = np.setdiff1d(motion.dofs[motion.owned].ravel(), held)
    counts = comm.allgather(len(free))
    rank = int(np.argmax(counts))
    if counts[rank] < motion.freedom.count:
        raise ValueError(f"the mesh has too few nodes on the rigid part {name}; use smaller cells (--cell-size)")
    mine = free[: motion.freedom.count] if rank == comm.rank else free[:0]
    return rank, mine.astype(np.int64)
