"""Terms of the potential outside UFL, with their own assembly of energy, forces and stiffness; sparse matrices; mass.

In contact, distant parts of the mesh interact, and the pairs change with the shape; a UFL form couples only what
shares a cell.
"""

from __future__ import annotations

import abc
import copy
import dataclasses
import functools
from collections.abc import Callable, Iterable, Sequence
from typing import Any, ClassVar, Protocol

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.common.lazy import PETSc, basix, common, cpp, fem, la, meshes, scipy, ufl
from softmodels.mechanics import compiling, component, mpi
from softmodels.mechanics.body import Body
from softmodels.mechanics.component import ComponentError


class AssembledTerm[P: Pressing](component.EnergyTerm):
    """Energy as a function of the node positions of some faces. Every rank computes all of it, because faces are small. The
    `System` sets ``bcs``, the conditions of the unknowns."""

    _pressed: P

    def __init__(self, nodes: FaceNodes):
        super().__init__([])
        self.nodes = nodes
        self.bcs: Sequence[fem.DirichletBC] = ()
        self._known = scipy.sparse.csr_array((len(nodes.places), len(nodes.places)), dtype=np.bool_)
        self._in_matrix = 0
        self._state = np.full(nodes.dofs.shape, np.nan)

    # -- computed by each kind of term ---------------------------------------------------------------------------------

    @abc.abstractmethod
    def pressed(self, places: Array) -> P:
        """Return the faces with their nodes at places, shape (n, d)."""

    def move(self, places: Array) -> None:
        self._pressed = self.pressed(places)

    def forces_here(self) -> Array:
        """Return the derivative of the energy by the nodes' places, shape (n, d)."""
        return self._pressed.forces

    def stiffness_here(self) -> scipy.sparse.csr_array:
        """Return the second derivative of the energy, shape (n d, n d)."""
        return self._pressed.stiffness

    def whole_stiffness_here(self) -> scipy.sparse.csr_array | None:
        """Return the derivative of the forces if it differs from `stiffness_here` and is not symmetric; else None."""
        return None

    def coupled(self) -> scipy.sparse.csr_array:
        """Return which nodes are or soon may be coupled: booleans, shape (n, n), symmetric."""
        return self._pressed.coupled(NEAR_GAP_RATIO)

    def harder_here(self) -> Array | None:
        """Return the derivative of the forces by a common factor on all spring constants and weights, (n, d); or None."""
        return None

    # -- called by the system ------------------------------------------------------------------------------------------

    def forget_state(self) -> None:
        """Compute anew in the next call: what faces press on has changed."""
        self._state = np.full(self.nodes.dofs.shape, np.nan)

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
        """Return the energy of a state, on all ranks."""
        self._take(w)
        return self._pressed.energy

    def add_forces(self, w: Array, b: Array, held: bool = False) -> None:
        """Add the derivative of the energy by w to owned entries ``b``, those of held dofs only on request."""
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

    def follow_mesh(self) -> None:
        """Follow a mesh that has moved: the contact is of the deformed places; areas and kernels stay those of the mesh as
        it was made."""
        self.nodes.follow_mesh()
        self.forget_state()

    def by_places(self, w: Array, x: Array) -> Array:
        """Return the derivative of the forces' work on owned entries ``x`` by the undeformed places, shape (n, d): they count
        as the displacements do."""
        self._take(w)
        moved = self.nodes.values(x) @ self.nodes.skew.T
        return np.asarray(self._force_rates().T @ moved.ravel()).reshape(moved.shape)

    def _force_rates(self) -> scipy.sparse.csr_array:
        """Return the derivative of the forces, shape (n d, n d)."""
        whole = self.whole_stiffness_here()
        return self.stiffness_here() if whole is None else whole

    def force(self, w: Array) -> Array:
        """Return the sum of the forces on what faces press on, of the slice in the mesh's coordinates, shape (d,)."""
        self._take(w)
        return np.asarray(self.forces_here().sum(axis=0))

    def along_product(self, w: Array, along: Array) -> Array:
        """Return the derivative of `force` along a vector by the nodes' deformed places, shape (n, d)."""
        self._take(w)
        motion = np.tile(along, len(self.nodes.places))
        return np.asarray(self._force_rates().T @ motion).reshape(self.nodes.places.shape)

    def at_places(self, w: Array) -> Array:
        """Return the derivative of the energy by the nodes' undeformed places, shape (n, d): as by the deformed ones."""
        self._take(w)
        return self.forces_here()

    def add_rates(self, rates: Array, b: Array) -> None:
        """Add derivatives by the nodes' deformed places, shape (n, d), to those by owned entries."""
        b[self.nodes.local] += (rates @ self.nodes.skew * self._free)[self.nodes.mine]

    def add_moved(self, w: Array, motion: Array, b: Array) -> None:
        """Add the derivative of the forces by a motion of the mesh's own local nodes, shape (nodes, d), to owned entries."""
        self._take(w)
        self._add_moved(self.nodes.motion(motion), b)

    def add_relocated(self, w: Array, motion: Array, b: Array) -> Array:
        """Add the same by a motion in sizes of what the faces press on, shape (d,): as of all nodes against it."""
        self._take(w)
        self._add_moved(np.tile(-motion, (len(self.nodes.places), 1)), b)
        return b

    def _add_moved(self, motion: Array, b: Array) -> None:
        self.add_rates((self._force_rates() @ motion.ravel()).reshape(motion.shape), b)

    def matrix(self, w: Array, whole: bool = False) -> scipy.sparse.csr_array:
        """Return the second derivative of the energy by the nodes' components of w, zero where they are held, shape (n d, n
        d); or with ``whole`` the derivative of the forces, where that is another one."""
        self._take(w)
        if whole not in self._matrices:
            stiffness = self._force_rates() if whole else self.stiffness_here()
            if stiffness.nnz:
                turn = scipy.sparse.kron(scipy.sparse.eye_array(len(self.nodes.places)), self.nodes.skew, format="csr")
                free = scipy.sparse.diags_array(self._free.ravel().astype(float))
                stiffness = scipy.sparse.csr_array(free @ (turn.T @ stiffness @ turn) @ free)
            self._matrices[whole] = stiffness
        return self._matrices[whole]

    def add_product(self, w: Array, x: Array, y: Array, whole: bool = False) -> None:
        """Add the second derivative at w, or with ``whole`` that of the forces, times owned entries ``x`` to ``y``."""
        product = (self.matrix(w, whole) @ self.nodes.values(x).ravel()).reshape(self.nodes.dofs.shape)
        y[self.nodes.local] += product[self.nodes.mine]

    def add_to(self, K: PETSc.Mat, w: Array) -> None:
        """Add the second derivative at w to a matrix. Its pattern grows when nodes first meet."""
        values, coupled = self.matrix(w), self._coupled()
        if not coupled.nnz:
            return
        coo, same = values.tocoo(), self._in_matrix == coupled.nnz
        rows, columns, entries = coo.row, coo.col, coo.data
        if not same:
            d = self.nodes.dofs.shape[1]
            of = scipy.sparse.kron(coupled, np.ones((d, d), dtype=np.bool_), format="coo")
            rows, columns = np.concatenate([rows, of.row]), np.concatenate([columns, of.col])
            entries = np.concatenate([entries, np.zeros(of.nnz)])
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
        structure = PETSc.Mat.Structure.SUBSET if same else PETSc.Mat.Structure.DIFFERENT
        K.axpy(1.0, A, structure)  # type: ignore[arg-type]
        mark_symmetric(K)  # a new pattern needs a new matrix
        self._in_matrix = coupled.nnz
        A.destroy()

    def _coupled(self) -> scipy.sparse.csr_array:
        """Return which nodes have ever been coupled, shape (n, n)."""
        new = self.coupled()
        if (new > self._known).nnz:
            self._known = scipy.sparse.csr_array(self._known + new)
        return self._known


class RememberingTerm[P: Pressing, H](AssembledTerm[P]):
    """A term whose forces depend on its ``history``, what it remembers of the last accepted state."""

    remembers: ClassVar[bool] = True
    history: H

    @abc.abstractmethod
    def kept(self, reset: bool) -> H:
        """Return the history once the present state is accepted; with ``reset`` as if nothing had touched before."""

    def commit(self, w: Array, reset: bool = False) -> None:
        self._take(w)
        self.restore(self.kept(reset))

    def save(self) -> H:
        """Return the history; see `component.Checkpoint`."""
        return self.history

    def restore(self, saved: H) -> None:
        """Return to what `save` has given."""
        self.history = saved
        self.forget_state()  # the following calls use this history


class HistoryTerm[P: Pressing, H](RememberingTerm[P, H]):
    """One with the derivatives of what it remembers: flat arrays, by places of the faces' nodes against what they press on."""

    @abc.abstractmethod
    def rest_rates(self, places: Array) -> Array:
        """Return how what it remembers where a path begins changes with the nodes' places, shape (n, d)."""

    @abc.abstractmethod
    def kept_rates(self, w: Array, places: Array, history: Array) -> Array:
        """Return how what it will remember of a state changes with the nodes' places and with what it remembers now."""

    @abc.abstractmethod
    def history_rates(self, w: Array, history: Array) -> Array:
        """Return how its forces in a state change with what it remembers, shape (n, d)."""


class AssembledTerms:
    """All assembled terms among a system's terms. With ``whole`` products are with the derivative of the forces if that is not
    symmetric: only in Newton's method."""

    def __init__(self, terms: Iterable[component.EnergyTerm], bcs: Sequence[fem.DirichletBC]):
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
        """`CONTACT_SLACK`, if there are any."""
        return CONTACT_SLACK if self._terms else 0

    def energy(self, w: Array) -> float:
        return sum((term.energy(w) for term in self._terms), 0.0)

    def touches(self, w: Array) -> bool:
        """Return whether faces are in contact in a state, on all ranks."""
        return any(term.energy(w) > 0.0 for term in self._terms)

    def by_places(self, w: Array, x: Array, nodes: int) -> Array:
        """Return this rank's share of `AssembledTerm.by_places` by the mesh's own local nodes, shape (nodes, d)."""
        return self._by_mesh(nodes, lambda term: term.by_places(w, x))

    def at_places(self, w: Array, nodes: int) -> Array:
        """Return the same of `AssembledTerm.at_places`."""
        return self._by_mesh(nodes, lambda term: term.at_places(w))

    def _by_mesh(self, nodes: int, rates: Callable[[AssembledTerm], Array]) -> Array:
        d = self._terms[0].nodes.places.shape[1] if self._terms else 1
        return sum((term.nodes.by_mesh(rates(term)) for term in self._terms), np.zeros((nodes, d)))

    # The same methods of all terms; they return what has been added to.

    def add_moved(self, w: Array, motion: Array, b: Array) -> Array:
        for term in self._terms:
            term.add_moved(w, motion, b)
        return b

    def add_forces(self, w: Array, b: Array, held: bool = False) -> Array:
        for term in self._terms:
            term.add_forces(w, b, held)
        return b

    def add_harder(self, w: Array, b: Array) -> Array:
        for term in self._terms:
            term.add_harder(w, b)
        return b

    def add_product(self, w: Array, x: Array, y: Array) -> Array:
        for term in self._terms:
            term.add_product(w, x, y, self.whole)
        return y

    def add_to(self, K: PETSc.Mat, w: Array) -> None:
        for term in self._terms:
            term.add_to(K, w)


# ----------------------------------------------------------------------------------------------------------------------
# PETSc matrices of compiled bilinear forms.
#
# They use the compiled functions behind ``dolfinx.fem.petsc``. That module prepares PETSc's functions
# for Numba on import with a C parser, which takes 2 % of a short command's time.


def held_dofs(bcs: Sequence[fem.DirichletBC]) -> npt.NDArray[np.int32]:
    """Return the owned dofs that conditions hold, local numbers."""
    own = [dofs[:owned] for dofs, owned in (bc.dof_indices() for bc in bcs)]
    return np.concatenate([np.empty(0, dtype=np.int32), *own])


def create_matrix(form: fem.Form) -> PETSc.Mat:
    """Return an empty matrix with a form's pattern."""
    return cpp.fem.petsc.create_matrix(form._cpp_object, None)  # type: ignore[no-any-return]


def assemble_into(matrix: PETSc.Mat, form: fem.Form, bcs: Sequence[fem.DirichletBC] = (), diagonal: float = 1.0) -> None:
    """Assemble a form of one space into a matrix of its pattern, without finalising it; rows and columns of conditions' dofs
    stay empty but for their ``diagonal``."""
    held = [bc._cpp_object for bc in bcs]
    constants, coefficients = fem.pack_constants(form), fem.pack_coefficients(form)
    cpp.fem.petsc.assemble_matrix(matrix, form._cpp_object, constants, coefficients, held)
    matrix.assemble(matrix.AssemblyType.FLUSH)
    cpp.fem.petsc.insert_diagonal(matrix, form.function_spaces[0], held, diagonal)


def assembled_matrix(form: fem.Form, bcs: Sequence[fem.DirichletBC] = ()) -> PETSc.Mat:
    """Return a form's matrix; see `assemble_into`."""
    matrix = create_matrix(form)
    assemble_into(matrix, form, bcs)
    matrix.assemble()
    return matrix


def sparse_matrix(form: fem.Form, bcs: Sequence[fem.DirichletBC] = ()) -> PETSc.Mat:
    """Return a form's matrix without stored zeros, which would take several times the memory; nothing is on the diagonal of
    conditions' dofs."""
    dofmap, comm = form.function_spaces[0].dofmap, form.mesh.comm
    numbers, block = dofmap.index_map, dofmap.index_map_bs
    size = (numbers.size_local * block, PETSc.DETERMINE)
    made = PETSc.Mat().createAIJ((size, size), bsize=block, comm=comm)
    places = numbers.local_to_global(np.arange(numbers.size_local + numbers.num_ghosts, dtype=np.int32))
    local = PETSc.LGMap().create(places.astype(np.int32), block, comm)  # type: ignore[arg-type]
    made.setLGMap(local, local)
    made.setOption(PETSc.Mat.Option.IGNORE_ZERO_ENTRIES, True)  # type: ignore[arg-type]
    assemble_into(made, form, bcs, 0.0)
    made.assemble()
    local.destroy()
    return made


def assembled_vector(b: la.Vector, forms: Sequence[fem.Form]) -> Array:
    """Assemble the sum of linear forms into a vector; return its local entries, which are complete on their owners."""
    b.array[:] = 0.0
    for form in forms:
        fem.assemble_vector(b.array, form)
    b.scatter_reverse(la.InsertMode.add)
    return b.array


def length(x: PETSc.Vec) -> float:
    """Return the Euclidean length of a vector."""
    return float(x.dot(x)) ** 0.5


# ----------------------------------------------------------------------------------------------------------------------
# Facets of named faces with their nodes, complete on every rank, because faces are small and contact may occur anywhere.


Numbers = npt.NDArray[np.int64]


def check_mesh_faces(body: Body, roles: Sequence[str], where: str) -> None:
    """Raise `ComponentError` for a face missing in the mesh."""
    facets = body.mesh.topology.dim - 1
    for role in roles:
        if body.entities.get(role, (-1,))[0] != facets:
            known = ", ".join(name for name, (dimension, _) in body.entities.items() if dimension == facets)
            raise ComponentError(f"{where}: the mesh of {type(body.actuator).__name__} has no face {role!r}; it has {known}")


class FaceNodes:
    """Quadratic facets of faces and where their nodes' displacements are; the same on every rank.

    Args:
        body: The mesh.
        space: That of the unknowns w.
        roles: The faces, by role or by their local facets.

    Attributes:
        places: Of the nodes at rest, shape (n, d), in sizes of the device.
        facets: Nodes of each facet, shape (f, 3 or 6): corners, then middles, of triangles each opposite to its corner.
        faces: Number of the role that each facet belongs to, shape (f,).
        inside: Middle of the cell behind each facet, shape (f, d).
        dofs: Global numbers of the skew components of each node's displacement, shape (n, d).
    """

    def __init__(self, body: Body, space: fem.FunctionSpace, roles: Sequence[str | npt.NDArray[np.int32]]):
        self.comm, self.skew = body.mesh.comm, body.skew_inverse
        self._mesh = mesh = body.mesh
        topology, d = mesh.topology, mesh.topology.dim
        nodes = fem.functionspace(mesh, ("P", 2))
        vectors = space if space.dofmap.index_map_bs == d else space.sub(0)  # mixed dofs are not blocked
        components = [vectors.sub(c).dofmap for c in range(d)]
        of_facet = _nodes_of_facets(basix.topology(mesh.basix_cell()), d)
        topology.create_connectivity(d - 1, d)
        topology.create_connectivity(d, d - 1)
        to_cell, to_facet = topology.connectivity(d - 1, d), topology.connectivity(d, d - 1)
        at = nodes.tabulate_dof_coordinates()[:, :d]
        block = space.dofmap.index_map_bs
        owned = topology.index_map(d).size_local
        rows: list[tuple[Numbers, Array, Numbers, int, Array]] = []
        own: list[tuple[int, Numbers]] = []
        for number, role in enumerate(roles):
            for facet in body.entities[role][1] if isinstance(role, str) else role:
                cell = to_cell.links(facet)[0]
                if cell >= owned:
                    continue
                chosen = of_facet[int(np.flatnonzero(to_facet.links(cell) == facet)[0])]
                here = nodes.dofmap.cell_dofs(cell)
                local = np.column_stack([dofmap.cell_dofs(cell)[chosen] for dofmap in components])
                numbers = space.dofmap.index_map.local_to_global((local // block).ravel().astype(np.int32))
                dofs = numbers.reshape(local.shape) * block + local % block
                ids = nodes.dofmap.index_map.local_to_global(here[chosen].astype(np.int32))
                own.append((cell, chosen))
                rows.append((ids, at[here[chosen]], dofs, number, at[here[: d + 1]].mean(axis=0)))
        k = 3 if d == 2 else 6
        ids, places, dofs, faces, inside = (
            mpi.everywhere(self.comm, np.array([row[i] for row in rows], dtype=kind).reshape(-1, *shape))
            for i, (kind, shape) in enumerate(
                [(np.int64, (k,)), (np.float64, (k, d)), (np.int64, (k, d)), (np.int64, ()), (np.float64, (d,))]
            )
        )
        self._own, self._before = own, sum(self.comm.allgather(len(own))[: self.comm.rank])
        _, first, facets = np.unique(ids, return_index=True, return_inverse=True)
        self.facets: Numbers = facets.reshape(ids.shape)
        self._first: Numbers = np.asarray(first, dtype=np.int64)
        self.places: Array = np.asarray(places.reshape(-1, d)[first], dtype=float)
        self.dofs: Numbers = np.asarray(dofs.reshape(-1, d)[first], dtype=np.int64)
        self.faces: Numbers = np.asarray(faces, dtype=np.int64)
        self.inside: Array = np.asarray(inside, dtype=float)
        self.total_dofs = space.dofmap.index_map.size_global * block
        start, end = (int(bound) * block for bound in space.dofmap.index_map.local_range)
        self.owned = start, end

    def only(self, facets: npt.NDArray[np.bool_]) -> FaceNodes:
        """Return a copy with only some of the facets, a mask of shape (f,)."""
        chosen = copy.copy(self)
        used, numbers = np.unique(self.facets[facets], return_inverse=True)
        chosen.facets = numbers.reshape(-1, self.facets.shape[1])
        chosen.places, chosen.dofs, chosen._first = self.places[used], self.dofs[used], self._first[used]
        chosen.faces, chosen.inside = self.faces[facets], self.inside[facets]
        for name in ("mine", "local", "_interpolation"):
            chosen.__dict__.pop(name, None)
        return chosen

    @functools.cached_property
    def _interpolation(self) -> scipy.sparse.csr_array:
        """The nodes' places by those of the mesh's own local nodes, shape (n, nodes); each row on one rank."""
        cell, geometry, k = self._mesh.basix_cell(), self._mesh.geometry, self.facets.shape[1]
        points = basix.ufl.element("P", cell, 2).basix_element.points
        shapes = basix.ufl.element("P", cell, geometry.cmaps[0].degree).tabulate(0, points)[0]
        rows = np.flatnonzero((self._first >= k * self._before) & (self._first < k * (self._before + len(self._own))))
        entry, column = np.divmod(self._first[rows] - k * self._before, k)
        cells = np.array([self._own[i][0] for i in entry], dtype=np.int64)
        local = np.array([self._own[i][1][j] for i, j in zip(entry, column, strict=True)], dtype=np.int64)
        columns, weights = np.asarray(geometry.dofmaps[0])[cells], shapes[local]
        at = (np.repeat(rows, weights.shape[1]), columns.ravel())
        return scipy.sparse.csr_array((weights.ravel(), at), shape=(len(self.places), len(geometry.x)))

    def follow_mesh(self) -> None:
        """Take the nodes' undeformed places from a mesh that has moved."""
        self.places = self.motion(self._mesh.geometry.x[:, : self.places.shape[1]])

    def motion(self, nodes: Array) -> Array:
        """Return a motion of the nodes, shape (n, d), of one of the mesh's own local nodes, shape (nodes, d)."""
        return mpi.summed(self.comm, np.asarray(self._interpolation @ nodes))

    def by_mesh(self, rates: Array) -> Array:
        """Return derivatives by the nodes' places, shape (n, d), as this rank's share of those by the mesh's local nodes."""
        return np.asarray(self._interpolation.T @ rates)

    @functools.cached_property
    def mine(self) -> npt.NDArray[np.bool_]:
        """Whether this rank owns the dofs, shape (n, d)."""
        return (self.dofs >= self.owned[0]) & (self.dofs < self.owned[1])

    @functools.cached_property
    def local(self) -> Numbers:
        """Indices of the dofs that this rank owns among its own."""
        return np.asarray(self.dofs[self.mine] - self.owned[0])

    def values(self, w: Array) -> Array:
        """Return the entries of all nodes, shape (n, d), of a vector whose first ones are this rank's owned entries."""
        values = np.zeros(self.dofs.shape)
        values[self.mine] = w[self.local]
        return mpi.summed(self.comm, values)

    def moved(self, w: Array) -> Array:
        """Return the deformed places of the nodes, shape (n, d), of unknowns that begin with this rank's owned ones."""
        return np.asarray(self.places + self.values(w) @ self.skew.T)


def _nodes_of_facets(topology: Sequence[Sequence[Sequence[int]]], d: int) -> list[Numbers]:
    """Return the nodes of each facet of a cell, numbered in the cell, as `FaceNodes.facets` orders them."""
    middles = {frozenset(edge): d + 1 + i for i, edge in enumerate(topology[1])}
    nodes = []
    for corners in topology[d - 1]:
        if d == 2:
            nodes.append(np.array([*corners, middles[frozenset(corners)]]))
        else:
            a, b, c = corners
            nodes.append(np.array([a, b, c, *(middles[frozenset(edge)] for edge in ((b, c), (c, a), (a, b)))]))
    return nodes


CONTACT_SLACK = 3
"""Extra Newton iterations that do not shorten the steps, because every step changes the contact points."""
NEAR_GAP_RATIO = 0.2
"""Gap below which nodes are coupled in the matrix pattern before they touch, relative to a contact's near distance."""


def mark_symmetric(K: PETSc.Mat) -> None:
    """Mark a matrix as symmetric for any values."""
    K.setOption(K.Option.SYMMETRIC, True)  # type: ignore[arg-type]
    K.setOption(K.Option.SYMMETRY_ETERNAL, True)  # type: ignore[arg-type]


class Pressing(Protocol):
    """Contact of faces in a deformed shape, dimensionless, of the slice: energy, its derivatives by node positions, and which
    nodes are or soon may be coupled (``soon`` in radii of the kernel for walls)."""

    @property
    def energy(self) -> float: ...
    @property
    def forces(self) -> Array: ...
    @property
    def stiffness(self) -> scipy.sparse.csr_array: ...
    def coupled(self, soon: float) -> scipy.sparse.csr_array: ...


# ----------------------------------------------------------------------------------------------------------------------
# A function space whose pressure-like unknown p is continuous in each region of a body and may jump between them.
#
# At an interface of two materials the displacement is continuous but p jumps. So a vertex on
# it carries one p per adjacent region. The element, and with it every compiled form, stays what it is in a body of
# one material; only the numbering of the unknowns depends on the regions: copies follow a rank's own unknowns, and the cells of
# all regions except a vertex' first one use them instead of the vertex' own.


Ints = npt.NDArray[np.int32]
MESSAGE_TAG = 1709
"""Tag of the messages by which ranks exchange their shared unknowns."""


def numbered(mesh: meshes.Mesh, regions: list[Ints]) -> Ints:
    """Return the number of the region that each local cell belongs to, ghosts too; ``regions`` has the local cells of each but
    the first, which has all the rest."""
    index_map = mesh.topology.index_map(mesh.topology.dim)
    owner = la.vector(index_map, 1)
    owner.array[:] = 0.0
    for number, cells in enumerate(regions, 1):
        owner.array[cells[cells < index_map.size_local]] = number
    owner.scatter_forward()
    return owner.array.astype(np.int32)


def jumping(space: fem.FunctionSpace, sub: int, region: Ints) -> tuple[fem.FunctionSpace, Ints]:
    """Return the same space with one part's unknowns not shared between regions.

    Args:
        space: A mixed space with one unknown per number.
        sub: The part that may jump, a linear one.
        region: Number of each local cell's region, see `numbered`.

    Returns:
        The space; and the part's unknowns at the corners of each local cell, one for each region, shape
        (cells, corners, regions), -1 where a region does not reach.
    """
    old = space.dofmap
    cells, part = np.array(old.list), np.array(space.sub(sub).dofmap.list)
    index_map, of_region = _numbering(space, part, region)
    n, ghost = old.index_map.size_local, index_map.size_local - old.index_map.size_local
    renumbered = np.where(cells >= n, cells + ghost, cells)
    corners = of_region[:, part].transpose(1, 2, 0)
    for column, values in enumerate(part.T):
        place = np.flatnonzero((cells == values[:, None]).all(axis=0))[0] if len(cells) else 0
        renumbered[:, place] = corners[np.arange(len(cells)), column, region]
    graph = cpp.graph.AdjacencyList_int32(np.ascontiguousarray(renumbered, dtype=np.int32))
    dofmap = cpp.fem.DofMap(old.dof_layout, index_map, 1, graph, 1)
    made = cpp.fem.FunctionSpace_float64(space.mesh._cpp_object, space._cpp_object.element, dofmap)
    return fem.FunctionSpace(space.mesh, space.ufl_element(), made), corners


def _numbering(space: fem.FunctionSpace, part: Ints, region: Ints) -> tuple[common.IndexMap, Ints]:
    """Number the copies: a rank's own ones after its unknowns, others' ones after its ghosts.

    Returns the new map; and for each region the new number of each old local unknown, -1 where the region does not reach.
    ``part`` has the unknowns that may jump, by cell.
    """
    comm, old = space.mesh.comm, space.dofmap.index_map
    n, count = old.size_local, 1 + int(mpi.largest(space.mesh.comm, float(region.max(initial=0))))
    vector = la.vector(old, 1)
    owned_cells = space.mesh.topology.index_map(space.mesh.topology.dim).size_local
    present = np.zeros((count, len(vector.array)), dtype=bool)
    for number in range(count):
        vector.array[:] = 0.0
        vector.array[part[:owned_cells][region[:owned_cells] == number]] = 1.0
        vector.scatter_reverse(la.InsertMode.add)
        vector.scatter_forward()
        present[number] = vector.array > 0.0
    first = present.argmax(axis=0)  # the region that keeps the unknown itself
    copied = present & (np.arange(count)[:, None] != first)
    numbers, places = np.nonzero(copied)
    own = places < n
    extra = int(own.sum())
    new = np.full(copied.shape, -1, dtype=np.int32)
    everyone = np.arange(len(vector.array), dtype=np.int32)
    new[first, everyone] = np.where(everyone < n, everyone, everyone + extra)
    new[numbers[own], places[own]] = n + np.arange(extra)
    new[numbers[~own], places[~own]] = len(everyone) + extra + np.arange(int((~own).sum()))

    offset = int(comm.exscan(n + extra) or 0)
    vector.array[:n] = offset + everyone[:n]
    vector.scatter_forward()
    ghosts, owners = [vector.array[n:].copy()], [old.owners]
    for number in range(count):
        vector.array[:n] = offset + new[number, :n]
        vector.scatter_forward()
        away = np.flatnonzero(copied[number, n:])
        ghosts.append(vector.array[n + away])
        owners.append(old.owners[away])
    behind = np.concatenate(ghosts).astype(np.int64)
    return common.IndexMap(comm, n + extra, behind, np.concatenate(owners), MESSAGE_TAG), new


def known_to_all(space: fem.FunctionSpace, dofs: Ints) -> Ints:
    """Return the local dofs that any rank names, in order, of a space numbered one by one: the owner of a vertex need not have
    the cells that name it."""
    named = la.vector(space.dofmap.index_map, 1)
    named.array[:] = 0.0
    named.array[dofs] = 1.0
    named.scatter_reverse(la.InsertMode.add)
    named.scatter_forward()
    return np.flatnonzero(named.array).astype(np.int32)


def entries_of(space: fem.FunctionSpace, sub: int) -> int:
    """Return the number of unknowns of one part of a mixed space, over all ranks."""
    n = space.dofmap.index_map.size_local
    used = la.vector(space.dofmap.index_map, 1)
    used.array[:] = 0.0
    used.array[np.array(space.sub(sub).dofmap.list).ravel()] = 1.0
    used.scatter_reverse(la.InsertMode.add)
    return round(mpi.total(space.mesh.comm, float(np.count_nonzero(used.array[:n]))))


def matrix_of(space: fem.FunctionSpace, forms: list[fem.Form]) -> Any:
    """Return the symmetric PETSc matrix with the pattern of bilinear forms to be assembled in it, such as those of regions.
    Facets couple no other unknowns than their cells do."""
    if len(forms) == 1:
        made = create_matrix(forms[0])
    else:
        index_map, size = space.dofmap.index_map, space.dofmap.index_map_bs
        pattern = cpp.la.SparsityPattern(space.mesh.comm, [index_map, index_map], [size, size])
        for form in forms:
            cpp.fem.build_sparsity_pattern(pattern, form._cpp_object)
        pattern.finalize()
        made = cpp.la.petsc.create_matrix(space.mesh.comm, pattern)
    mark_symmetric(made)
    return made


# ----------------------------------------------------------------------------------------------------------------------
# Mass.


@dataclasses.dataclass(frozen=True)
class Inertia:
    """What a device weighs, in densities of its main material and sizes of the device: densities of its materials, as in
    `System.matter`, and masses of the slice spread evenly over faces."""

    densities: tuple[float, ...]
    faces: tuple[tuple[str, float], ...] = ()

    @property
    def plain(self) -> bool:
        """Whether it is that of unit density."""
        return not self.faces and set(self.densities) == {1.0}


def mass_matrix(
    system: component.Equations, inertia: Inertia | None = None, held: Sequence[fem.DirichletBC] | None = None
) -> PETSc.Mat:
    """Return the displacement's mass matrix by all dofs, of unit density without masses; rows and columns of held dofs (by
    default all that the system holds) are empty."""
    bcs = system.bcs if held is None else held
    test, trial = ufl.TestFunction(system.space), ufl.TrialFunction(system.space)
    u, v = (system.body.displacement(ufl.split(f)[0] if system.mixed else f) for f in (trial, test))
    work, mesh = ufl.inner(u, v) * system.body.hoop, system.body.mesh
    form = work * ufl.Measure("dx", mesh, metadata={"quadrature_degree": 4})
    if inertia is not None and set(inertia.densities) != {1.0}:
        density = fem.Function(fem.functionspace(mesh, ("DG", 0)))
        for region, value in zip(system.matter, inertia.densities, strict=True):
            density.x.array[region.cells] = value
        density.x.scatter_forward()
        form = density * work * ufl.Measure("dx", mesh, metadata={"quadrature_degree": 4})
    matrix = sparse_matrix(fem.form(form, jit_options=compiling.JIT), bcs)
    for face, mass in inertia.faces if inertia else ():
        measure, constant = system.body.measure(face), fem.Constant(mesh, 1.0)
        area = system.integral(fem.form(constant * system.body.hoop * measure, jit_options=compiling.JIT))
        spread = fem.form(fem.Constant(mesh, mass / area) * work * measure, jit_options=compiling.JIT)
        plate = sparse_matrix(spread, bcs)
        matrix.axpy(1.0, plate, matrix.Structure.DIFFERENT)  # type: ignore[arg-type]
        plate.destroy()
    return matrix
