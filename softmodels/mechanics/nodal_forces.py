"""The dead loads of a device as forces on its nodes, for other programs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from softmodels.mechanics.system import System

Array = npt.NDArray[np.float64]


def nodal_forces(system: System) -> tuple[Array, Array]:
    """All dead loads at their own magnitudes, on the modelled slice.

    Args:
        system: The equations of a solid with displacements alone, on one rank.

    Returns:
        Undeformed places of the nodes in m and forces on them in N, shape (n, 3) each, in device coordinates.
    """
    body, dead = system.body, system.dead
    drives = dead.amounts / dead.units
    held = [drive * system.assemble(forms, held=True) for drive, forms in zip(drives, dead.forms, strict=True)]
    entries = np.sum(held, axis=0).reshape(-1, 3)
    # Entries work on displacements along the rows of the skew basis.
    forces = entries @ body.skew * system.stress_unit * system.length_unit**2
    places = system.space.tabulate_dof_coordinates()[: len(forces)] * system.length_unit
    return body.actuator.device_points(places), forces
