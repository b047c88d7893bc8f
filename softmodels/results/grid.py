"""The nodes and cells that results are written on: the second-order grid, whole, on rank 0.

Nodes are sorted by position and cells by their number in the mesh file, so that files do not depend on the number of ranks.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.mpi import gathered
from softmodels.mechanics.system import System

if TYPE_CHECKING:
    from dolfinx import fem

Array = npt.NDArray[np.float64]

CELL_NAMES = {2: "Triangle_6", 3: "Tetrahedron_10"}


class Grid:
    """Nodes and cells of an equilibrium's displacement.

    Attributes:
        points: Device coordinates in m, shape (n, 3); on rank 0, elsewhere empty.
        cells: Node numbers in VTK's order, shape (c, 6 or 10); on rank 0, elsewhere empty.
        cell_name: XDMF's name of the cells.
    """

    def __init__(self, system: System):
        from dolfinx import fem, plot

        body = system.body
        self.comm, self.mixed = system.comm, system.mixed
        self.dimension = body.actuator.dimension
        self.cell_name = CELL_NAMES[self.dimension]
        self.space = fem.functionspace(body.mesh, ("P", 2))
        index_map = self.space.dofmap.index_map
        self.owned = index_map.size_local
        here = self.space.tabulate_dof_coordinates()[: self.owned] * system.length_unit
        everywhere = gathered(self.comm, body.actuator.device_points(here))
        local_cells = plot.vtk_mesh(self.space)[0].reshape(len(system.cells), -1)[:, 1:]
        cells = gathered(
            self.comm, index_map.local_to_global(local_cells.ravel().astype(np.int32)).reshape(local_cells.shape)
        )
        numbers = gathered(self.comm, body.mesh.topology.original_cell_index[: len(system.cells)])
        if everywhere is None or cells is None or numbers is None:
            self.points, self.cells, self.order = (
                np.empty((0, 3)),
                np.empty((0, 0), dtype=np.int64),
                np.empty(0, dtype=int),
            )
            return
        # Rounded, so that two ranks' last digits cannot swap neighbours; off the round numbers that meshes like.
        rounded = np.floor(everywhere / system.length_unit * 1e8 + 0.4142)
        self.order = np.lexsort(rounded.T[::-1])
        self.points = everywhere[self.order]
        rank_of = np.empty(len(self.order), dtype=np.int64)
        rank_of[self.order] = np.arange(len(self.order))
        self.cells = rank_of[cells][np.argsort(numbers)]

    def collect(self, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64] | None:
        """Nodal values of owned nodes, shape (owned, ...), as one array in the grid's order on rank 0; None elsewhere."""
        everywhere = gathered(self.comm, values)
        return None if everywhere is None else everywhere[self.order]

    def distribute(self, values: npt.NDArray[np.float64] | None) -> npt.NDArray[np.float64]:
        """The reverse of `collect`: owned nodes' values from the whole array on rank 0."""
        from softmodels.mechanics.mpi import scattered

        back = None
        if values is not None:
            back = np.empty_like(values)
            back[self.order] = values
        return scattered(self.comm, back, self.owned)


def displacement_maps(system: System, grid: Grid) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32] | None]:
    """Where a state's entries sit on the grid.

    Returns:
        Indices into ``State.w`` of the skew components at each local node, shape (local nodes, d); and indices of p at
        each local node, one for each region of the body, -1 where p has no dof (mid-edge nodes, and vertices that a region
        does not reach), shape (local nodes, regions), or None in the displacement formulation.
    """
    d = grid.dimension
    space = system.space
    if not system.mixed:
        nodes = _matched(grid, space)
        found = np.empty((len(nodes), d), dtype=np.int32)
        found[nodes] = d * np.arange(len(nodes))[:, None] + np.arange(d)
        return found, None
    columns = []
    for component in range(d):
        sub, blocks = space.sub(0).sub(component).collapse()
        parents = np.concatenate(blocks)
        column = np.empty(len(parents), dtype=np.int32)
        column[_matched(grid, sub)] = parents
        columns.append(column)
    corners = system.potential.pressure_dofs
    pressures = np.full((len(columns[0]), corners.shape[2]), -1, dtype=np.int32)
    pressures[np.array(grid.space.dofmap.list)[:, : corners.shape[1]]] = corners  # vertices come first in a cell
    return np.column_stack(columns), pressures


def _matched(grid: Grid, space: fem.FunctionSpace) -> npt.NDArray[np.int64]:
    """For each node of a space of the grid's degree, the local node of the grid at the same place: cells number both alike."""
    places = space.tabulate_dof_coordinates()
    nodes = np.empty(len(places), dtype=np.int64)
    nodes[np.ravel(space.dofmap.list)] = np.ravel(grid.space.dofmap.list)
    distance = np.abs(grid.space.tabulate_dof_coordinates()[nodes] - places)
    if distance.max(initial=0.0) > 1e-9:
        raise RuntimeError("the results' nodes are not where the unknowns are")
    return nodes
