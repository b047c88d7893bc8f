"""What a region much stiffer than the silicone does to rounding errors: of its forces, and of a factorisation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dolfinx import mesh as meshes

    from softmodels.mechanics.regions import MaterialRegion
    from softmodels.mechanics.system import System


def spread(regions: Sequence[MaterialRegion]) -> float:
    """The stiffest region's shear modulus over the softest one's, at small strain."""
    moduli = [region.material.shear_modulus_0 for region in regions]
    return max(moduli) / min(moduli)


def rounding_of_stress(system: System) -> float:
    """What rounding leaves of the stiffest region's stress, in shear moduli of the main material; 0 where there is one region.

    A place of about the device's size is known to a share of 2e-16, and the strain of a thin cell is the difference of two of
    them over its thickness: of a sheet of 1 GPa and 0.2 mm in a silicone finger 1e-9 shear moduli are measured, and foretold.
    """
    if len(system.matter) == 1:
        return 0.0
    stiffest = max(region.material.shear_modulus_0 for region in system.matter) / system.stress_unit
    return float(np.finfo(float).eps) * stiffest / _thinnest(system.body.mesh)


def _thinnest(mesh: meshes.Mesh) -> float:
    """Least height of a cell in the mesh's units, on all ranks."""
    from mpi4py import MPI

    dimension = mesh.topology.dim
    corners = np.asarray(mesh.geometry.x)[mesh.geometry.dofmaps[0][:, : dimension + 1], :]
    sides = corners[:, 1:] - corners[:, :1]
    gram = np.linalg.det(sides @ sides.transpose(0, 2, 1))
    faces = np.stack([np.delete(corners, k, axis=1) for k in range(dimension + 1)])
    edges = faces[:, :, 1:] - faces[:, :, :1]
    areas = np.linalg.det(edges @ edges.transpose(0, 1, 3, 2)).max(axis=0)
    heights = np.sqrt(gram / areas)
    return float(mesh.comm.allreduce(heights.min(initial=np.inf), op=MPI.MIN))
