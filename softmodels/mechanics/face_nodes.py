"""Facets of named faces with their nodes, whole on every rank: faces are small, and what presses on them may be anywhere."""

from __future__ import annotations

import copy
import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.body import Body
from softmodels.mechanics.mpi import everywhere, summed
from softmodels.mechanics.parts import PartError

if TYPE_CHECKING:
    from dolfinx import fem

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]


def check_mesh_faces(body: Body, roles: Sequence[str], where: str) -> None:
    """Raise `PartError` for a face that the mesh lacks."""
    facets = body.mesh.topology.dim - 1
    for role in roles:
        if body.entities.get(role, (-1,))[0] != facets:
            known = ", ".join(name for name, (dimension, _) in body.entities.items() if dimension == facets)
            raise PartError(f"{where}: the mesh of {type(body.actuator).__name__} has no face {role!r}; it has {known}")


class FaceNodes:
    """Quadratic facets of faces and where their nodes' displacements are; the same on every rank.

    Args:
        body: The mesh.
        space: That of the unknowns w.
        roles: The faces.

    Attributes:
        places: Of the nodes at rest, shape (n, d), in sizes of the device.
        facets: Nodes of each facet, shape (f, 3 or 6): corners, then middles, of triangles each opposite to its corner.
        faces: Number of the role that each facet belongs to, shape (f,).
        inside: Middle of the cell behind each facet, shape (f, d).
        dofs: Global numbers of the skew components of each node's displacement, shape (n, d).
    """

    def __init__(self, body: Body, space: fem.FunctionSpace, roles: Sequence[str]):
        import basix
        from dolfinx import fem

        self.comm, self.skew = body.mesh.comm, body.skew_inverse
        mesh = body.mesh
        topology, d = mesh.topology, mesh.topology.dim
        nodes = fem.functionspace(mesh, ("P", 2))
        vectors = space if space.dofmap.index_map_bs == d else space.sub(0)  # mixed dofs are not in blocks
        components = [vectors.sub(c).dofmap for c in range(d)]
        of_facet = _nodes_of_facets(basix.topology(mesh.basix_cell()), d)
        topology.create_connectivity(d - 1, d)
        topology.create_connectivity(d, d - 1)
        to_cell, to_facet = topology.connectivity(d - 1, d), topology.connectivity(d, d - 1)
        at = nodes.tabulate_dof_coordinates()[:, :d]
        block = space.dofmap.index_map_bs
        owned = topology.index_map(d).size_local
        found: list[tuple[Numbers, Array, Numbers, int, Array]] = []
        for number, role in enumerate(roles):
            for facet in body.entities[role][1]:
                cell = to_cell.links(facet)[0]
                if cell >= owned:
                    continue
                chosen = of_facet[int(np.flatnonzero(to_facet.links(cell) == facet)[0])]
                here = nodes.dofmap.cell_dofs(cell)
                local = np.column_stack([dofmap.cell_dofs(cell)[chosen] for dofmap in components])
                numbers = space.dofmap.index_map.local_to_global((local // block).ravel().astype(np.int32))
                dofs = numbers.reshape(local.shape) * block + local % block
                ids = nodes.dofmap.index_map.local_to_global(here[chosen].astype(np.int32))
                found.append((ids, at[here[chosen]], dofs, number, at[here[: d + 1]].mean(axis=0)))
        k = 3 if d == 2 else 6
        ids, places, dofs, faces, inside = (
            everywhere(self.comm, np.array([entry[i] for entry in found], dtype=kind).reshape(-1, *shape))
            for i, (kind, shape) in enumerate(
                [(np.int64, (k,)), (np.float64, (k, d)), (np.int64, (k, d)), (np.int64, ()), (np.float64, (d,))]
            )
        )
        _, first, facets = np.unique(ids, return_index=True, return_inverse=True)
        self.facets: Numbers = facets.reshape(ids.shape)
        self.places: Array = np.asarray(places.reshape(-1, d)[first], dtype=float)
        self.dofs: Numbers = np.asarray(dofs.reshape(-1, d)[first], dtype=np.int64)
        self.faces: Numbers = np.asarray(faces, dtype=np.int64)
        self.inside: Array = np.asarray(inside, dtype=float)
        self.total_dofs = space.dofmap.index_map.size_global * block
        start, end = (int(bound) * block for bound in space.dofmap.index_map.local_range)
        self.owned = start, end

    def only(self, facets: npt.NDArray[np.bool_]) -> FaceNodes:
        """The same with some of the facets alone, a mask of shape (f,)."""
        chosen = copy.copy(self)
        used, numbers = np.unique(self.facets[facets], return_inverse=True)
        chosen.facets = numbers.reshape(-1, self.facets.shape[1])
        chosen.places, chosen.dofs = self.places[used], self.dofs[used]
        chosen.faces, chosen.inside = self.faces[facets], self.inside[facets]
        for name in ("mine", "local"):
            chosen.__dict__.pop(name, None)
        return chosen

    @functools.cached_property
    def mine(self) -> npt.NDArray[np.bool_]:
        """Whether this rank owns the dofs, shape (n, d)."""
        return (self.dofs >= self.owned[0]) & (self.dofs < self.owned[1])

    @functools.cached_property
    def local(self) -> Numbers:
        """Indices of the dofs that this rank owns among its own."""
        return np.asarray(self.dofs[self.mine] - self.owned[0])

    def values(self, w: Array) -> Array:
        """Entries of all nodes, shape (n, d), of a vector whose first ones are this rank's owned entries."""
        values = np.zeros(self.dofs.shape)
        values[self.mine] = w[self.local]
        return summed(self.comm, values)

    def moved(self, w: Array) -> Array:
        """Deformed places of the nodes, shape (n, d), of unknowns that begin with this rank's owned ones."""
        return np.asarray(self.places + self.values(w) @ self.skew.T)


def _nodes_of_facets(topology: Sequence[Sequence[Sequence[int]]], d: int) -> list[Numbers]:
    """Nodes of each facet of a cell, numbered in the cell, as `FaceNodes.facets` orders them."""
    middles = {frozenset(edge): d + 1 + i for i, edge in enumerate(topology[1])}
    found = []
    for corners in topology[d - 1]:
        if d == 2:
            found.append(np.array([*corners, middles[frozenset(corners)]]))
        else:
            a, b, c = corners
            found.append(np.array([a, b, c, *(middles[frozenset(edge)] for edge in ((b, c), (c, a), (a, b)))]))
    return found
