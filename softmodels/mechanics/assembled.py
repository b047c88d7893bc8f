"""Terms of the potential that no form of UFL has: energy, forces and stiffness are assembled by themselves.

Pairs of places far apart on the mesh press on each other in contact, and which pairs changes with the shape; a form only knows
what shares a cell.
"""

from __future__ import annotations

import abc
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.face_nodes import FaceNodes
from softmodels.mechanics.parts import Term
from softmodels.mechanics.petsc_matrices import held_dofs

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import scipy
    from dolfinx import fem
    from petsc4py import PETSc

Array = npt.NDArray[np.float64]

CONTACT_SLACK = 3


def mark_symmetric(K: PETSc.Mat) -> None:
    """Let a matrix know that it is symmetric, whatever its values."""
    K.setOption(K.Option.SYMMETRIC, True)  # type: ignore[arg-type]
    K.setOption(K.Option.SYMMETRY_ETERNAL, True)  # type: ignore[arg-type]


class AssembledTerm(Term):
    """Energy of the places of some faces' nodes. Every rank computes all of it: faces are small.

    Args:
        nodes: The faces' nodes.

    Attributes:
        bcs: Conditions of the unknowns; set by the `System`.
    """

    def __init__(self, nodes: FaceNodes):
        import scipy

        super().__init__([])
        self.nodes = nodes
        self.bcs: Sequence[fem.DirichletBC] = ()
        self._known = scipy.sparse.csr_array((len(nodes.places), len(nodes.places)), dtype=np.bool_)
        self._in_matrix = 0
        self._state = np.full(nodes.dofs.shape, np.nan)

    # -- what a kind of term computes ----------------------------------------------------------------------------------

    @abc.abstractmethod
    def move(self, places: Array) -> None:
        """Take other places of the nodes, shape (n, d): what follows is asked of them."""

    @abc.abstractmethod
    def energy_here(self) -> float:
        """Energy, dimensionless, of the slice."""

    @abc.abstractmethod
    def forces_here(self) -> Array:
        """Derivative of the energy by the nodes' places, shape (n, d)."""

    @abc.abstractmethod
    def stiffness_here(self) -> scipy.sparse.csr_array:
        """Second derivative of the energy, shape (n d, n d)."""

    def whole_stiffness_here(self) -> scipy.sparse.csr_array | None:
        """Derivative of the forces where it is not `stiffness_here`, and not symmetric; None where it is."""
        return None

    @abc.abstractmethod
    def coupled(self) -> scipy.sparse.csr_array:
        """Nodes that are coupled, or soon may be: true where they are, shape (n, n), symmetric."""

    def harder_here(self) -> Array | None:
        """Derivative of the forces as all that is in newtons grows in proportion, by its share, shape (n, d); None for none."""
        return None

    # -- what the system calls -----------------------------------------------------------------------------------------

    def _take(self, w: Array) -> None:

        values = self.nodes.values(w)
        if not np.array_equal(values, self._state):
            self._state = values
            self._matrices: dict[bool, scipy.sparse.csr_array] = {}
            self.move(np.asarray(self.nodes.places + values @ self.nodes.skew.T))

    @property
    def _free(self) -> npt.NDArray[np.bool_]:
        """Whether a dof of the nodes is not held, shape (n, d)."""
        if not hasattr(self, "_not_held"):
            held = np.zeros(self.nodes.owned[1] - self.nodes.owned[0])
            held[held_dofs(self.bcs)] = 1.0
            self._not_held = self.nodes.values(held) == 0.0
        return self._not_held

    def energy(self, w: Array) -> float:
        """Energy of a state, on all ranks."""
        self._take(w)
        return self.energy_here()

    def add_forces(self, w: Array, b: Array, held: bool = False) -> None:
        """Add the derivative of the energy by w to owned entries ``b``, those of held dofs only if asked for."""
        self._take(w)
        forces = self.forces_here() @ self.nodes.skew
        if not held:
            forces = forces * self._free
        b[self.nodes.local] += forces[self.nodes.mine]

    def add_harder(self, w: Array, b: Array) -> None:
        """Add `harder_here` of a state to owned entries ``b``."""
        self._take(w)
        rates = self.harder_here()
        if rates is not None:
            b[self.nodes.local] += (rates @ self.nodes.skew * self._free)[self.nodes.mine]

    def matrix(self, w: Array, whole: bool = False) -> scipy.sparse.csr_array:
        """Second derivative of the energy by the nodes' components of w, zero where they are held, shape (n d, n d).

        Args:
            w: The state.
            whole: Whether it is the derivative of the forces, where that is another one.
        """
        import scipy

        self._take(w)
        if whole not in self._matrices:
            turn = scipy.sparse.kron(scipy.sparse.eye_array(len(self.nodes.places)), self.nodes.skew, format="csr")
            free = scipy.sparse.diags_array(self._free.ravel().astype(float))
            stiffness = self.whole_stiffness_here() if whole else None
            stiffness = self.stiffness_here() if stiffness is None else stiffness
            self._matrices[whole] = scipy.sparse.csr_array(free @ (turn.T @ stiffness @ turn) @ free)
        return self._matrices[whole]

    def add_product(self, w: Array, x: Array, y: Array, whole: bool = False) -> None:
        """Add the second derivative at w, or with ``whole`` that of the forces, times owned entries ``x`` to ``y``."""
        product = (self.matrix(w, whole) @ self.nodes.values(x).ravel()).reshape(self.nodes.dofs.shape)
        y[self.nodes.local] += product[self.nodes.mine]

    def add_to(self, K: PETSc.Mat, w: Array) -> None:
        """Add the second derivative at w to a matrix. Its pattern grows where nodes meet for the first time."""
        import scipy
        from petsc4py import PETSc

        values = self.matrix(w)
        pattern = self._pattern()
        if not pattern.nnz:
            return
        coo, of = values.tocoo(), pattern.tocoo()
        rows, columns = np.concatenate([coo.row, of.row]), np.concatenate([coo.col, of.col])
        entries = np.concatenate([coo.data, np.zeros(of.nnz)])
        mine = self.nodes.mine.ravel()[rows]
        dofs = self.nodes.dofs.ravel()
        n, start = K.getLocalSize()[0], self.nodes.owned[0]
        shape = (n, self.nodes.total_dofs)
        at = (dofs[rows[mine]] - start, dofs[columns[mine]])
        added = scipy.sparse.csr_array(scipy.sparse.coo_array((entries[mine], at), shape=shape))
        added.sort_indices()
        size = ((n, PETSc.DETERMINE), (n, PETSc.DETERMINE))
        csr = (added.indptr.astype(PETSc.IntType), added.indices.astype(PETSc.IntType), added.data)
        A = PETSc.Mat().createAIJ(size, csr=csr, comm=K.comm)
        same = self._in_matrix == pattern.nnz
        structure = PETSc.Mat.Structure.SUBSET if same else PETSc.Mat.Structure.DIFFERENT
        K.axpy(1.0, A, structure)  # type: ignore[arg-type]
        mark_symmetric(K)  # another pattern is another matrix under its name
        self._in_matrix = pattern.nnz
        A.destroy()

    def _pattern(self) -> scipy.sparse.csr_array:
        """Entries that have ever been coupled, shape (n d, n d)."""
        import scipy

        new = self.coupled()
        if (new > self._known).nnz:
            self._known = scipy.sparse.csr_array(self._known + new)
        d = self.nodes.dofs.shape[1]
        return scipy.sparse.kron(self._known, np.ones((d, d), dtype=np.bool_), format="csr")


class AssembledTerms:
    """All assembled terms among a system's terms.

    Args:
        terms: The system's terms.
        bcs: Conditions of the unknowns.

    Attributes:
        whole: Whether products are with the derivative of the forces where that is not symmetric: in Newton's method alone.
    """

    def __init__(self, terms: Iterable[Term], bcs: Sequence[fem.DirichletBC]):
        self._terms = [term for term in terms if isinstance(term, AssembledTerm)]
        self.whole = False
        for term in self._terms:
            term.bcs = bcs

    @property
    def remembers(self) -> bool:
        """Whether the forces of one of them depend on the states before."""
        return any(term.remembers for term in self._terms)

    @property
    def slack(self) -> int:
        """Newton iterations more than usual that are no reason for shorter steps: every step changes which points touch."""
        return CONTACT_SLACK if self._terms else 0

    def energy(self, w: Array) -> float:
        return sum((term.energy(w) for term in self._terms), 0.0)

    def touches(self, w: Array) -> bool:
        """Whether faces are pressed on in a state, on all ranks."""
        return any(term.energy(w) > 0.0 for term in self._terms)

    def add_forces(self, w: Array, b: Array, held: bool = False) -> Array:
        """See `AssembledTerm.add_forces`; returns ``b``."""
        for term in self._terms:
            term.add_forces(w, b, held)
        return b

    def add_harder(self, w: Array, b: Array) -> Array:
        """See `AssembledTerm.add_harder`; returns ``b``."""
        for term in self._terms:
            term.add_harder(w, b)
        return b

    def add_product(self, w: Array, x: Array, y: Array) -> Array:
        """See `AssembledTerm.add_product`; returns ``y``."""
        for term in self._terms:
            term.add_product(w, x, y, self.whole)
        return y

    def add_to(self, K: PETSc.Mat, w: Array) -> None:
        """See `AssembledTerm.add_to`."""
        for term in self._terms:
            term.add_to(K, w)
