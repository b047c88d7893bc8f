"""Forces with which a device pushes on what holds it."""

from __future__ import annotations

import numpy as np

from softmodels.mechanics.mpi import total
from softmodels.mechanics.system import System


def held_force(system: System, role: str, component: int) -> float:
    """Force of the current state on whatever holds a role along a component of w, of the slice, dimensionless.

    It is what the potential would lose per displacement there: -d(stored - P V)/dw summed over the role's dofs.
    """
    from dolfinx import fem

    dimension, found = system.body.entities[role]
    dofs = fem.locate_dofs_topological(system.vectors.sub(component), dimension, found)
    owned = dofs[dofs < system.n]
    force = sum(
        -factor * float(system.assemble([form], held=True)[owned].sum()) for form, factor in system.forces_and_loads()
    )
    pressed = system.assembled.add_forces(system.w.x.array, np.zeros(system.n), held=True)
    return total(system.comm, float(force - pressed[owned].sum()))
