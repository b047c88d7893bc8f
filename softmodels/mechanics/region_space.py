"""A function space whose pressure-like unknown p is continuous in each region of a body and may jump between them.

Where two materials meet, the displacement is one and p is not: a softer material has less of it. So a vertex on such an
interface carries one p for each region around it. The element, and with it every compiled form, stays what it is in a body of
one material; only the numbering of the unknowns knows of the regions: copies stand behind a rank's own unknowns, and the cells
of all regions but a vertex' first one count them in place of the vertex' own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.assembled import mark_symmetric
from softmodels.mechanics.mpi import largest, total
from softmodels.mechanics.petsc_matrices import create_matrix

if TYPE_CHECKING:
    from dolfinx import fem, mesh
    from dolfinx.common import IndexMap

Ints = npt.NDArray[np.int32]
TAG = 1709
"""Of the messages in which ranks tell each other which of their unknowns the others see."""


def numbered(mesh: mesh.Mesh, regions: list[Ints]) -> Ints:
    """Number of the region that each local cell belongs to, ghosts too.

    Args:
        mesh: The mesh.
        regions: Local cells of each region but the first, which has all the rest.
    """
    from dolfinx import la

    index_map = mesh.topology.index_map(mesh.topology.dim)
    owner = la.vector(index_map, 1)
    owner.array[:] = 0.0
    for number, cells in enumerate(regions, 1):
        owner.array[cells[cells < index_map.size_local]] = number
    owner.scatter_forward()
    return owner.array.astype(np.int32)


def jumping(space: fem.FunctionSpace, sub: int, region: Ints) -> tuple[fem.FunctionSpace, Ints]:
    """The same space with one part's unknowns not shared between regions.

    Args:
        space: A mixed space with one unknown per number.
        sub: The part that may jump, a linear one.
        region: Number of each local cell's region, see `numbered`.

    Returns:
        The space; and the part's unknowns at the corners of each local cell, one for each region, shape
        (cells, corners, regions), -1 where a region does not reach.
    """
    from dolfinx import cpp, fem

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


def _numbering(space: fem.FunctionSpace, part: Ints, region: Ints) -> tuple[IndexMap, Ints]:
    """Number the copies: a rank's own ones behind its own unknowns, others' ones behind its ghosts.

    Args:
        space: The space without jumps.
        part: Its unknowns that may jump, by cell.
        region: Number of each local cell's region.

    Returns:
        The new map; and for each region the new number of each old local unknown, -1 where the region does not reach.
    """
    from dolfinx import common, la

    comm, old = space.mesh.comm, space.dofmap.index_map
    n, count = old.size_local, 1 + int(largest(space.mesh.comm, float(region.max(initial=0))))
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
    return common.IndexMap(comm, n + extra, behind, np.concatenate(owners), TAG), new


def known_to_all(space: fem.FunctionSpace, dofs: Ints) -> Ints:
    """Local dofs that any rank names, in order: the owner of a vertex need not have the cells that name it.

    Args:
        space: A space whose unknowns are numbered one by one.
        dofs: Local dofs that this rank names.
    """
    from dolfinx import la

    named = la.vector(space.dofmap.index_map, 1)
    named.array[:] = 0.0
    named.array[dofs] = 1.0
    named.scatter_reverse(la.InsertMode.add)
    named.scatter_forward()
    return np.flatnonzero(named.array).astype(np.int32)


def entries_of(space: fem.FunctionSpace, sub: int) -> int:
    """Number of unknowns of one part of a mixed space, over all ranks."""
    from dolfinx import la

    n = space.dofmap.index_map.size_local
    used = la.vector(space.dofmap.index_map, 1)
    used.array[:] = 0.0
    used.array[np.array(space.sub(sub).dofmap.list).ravel()] = 1.0
    used.scatter_reverse(la.InsertMode.add)
    return round(total(space.mesh.comm, float(np.count_nonzero(used.array[:n]))))


def matrix_of(space: fem.FunctionSpace, forms: list[fem.Form]) -> Any:
    """Symmetric PETSc matrix with the pattern of bilinear forms that are added up in it, such as those of regions.

    Facets couple no other unknowns than their cells do.
    """
    from dolfinx import cpp

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
