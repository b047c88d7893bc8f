"""The measure over some of a mesh's cells, such as a region's."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.body import QUADRATURE_DEGREE, SHEET, Body

if TYPE_CHECKING:
    import ufl

CELLS = SHEET
"""Tag of the cells in the forms: one for all regions, or each would have its own compiled forms."""


def cell_measure(body: Body, cells: npt.NDArray[np.int32]) -> ufl.Measure:
    """Undeformed volume of cells; of a section their area.

    Args:
        body: The mesh.
        cells: Local cells in any order, ghosts too.
    """
    import ufl
    from dolfinx import mesh as meshes

    mesh = body.mesh
    tags = meshes.meshtags(mesh, mesh.topology.dim, np.sort(cells), np.full(len(cells), CELLS, dtype=np.int32))
    return ufl.Measure("dx", mesh, subdomain_data=tags, metadata={"quadrature_degree": QUADRATURE_DEGREE})(CELLS)
