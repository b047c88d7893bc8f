"""Forces with which a device pushes on what holds it."""

from __future__ import annotations

from softmodels.mechanics.mpi import total
from softmodels.mechanics.system import System


def held_force(system: System, role: str, component: int) -> float:
    """Force of the current state on whatever holds a role along a component of w, of the slice, dimensionless.

    It is what of the forces on the role's dofs nothing else balances, see `softmodels.mechanics.assembly.Assembly.surplus`.
    """
    from dolfinx import fem

    dimension, found = system.body.entities[role]
    dofs = fem.locate_dofs_topological(system.vectors.sub(component), dimension, found)
    return total(system.comm, -float(system.surplus()[dofs[dofs < system.n]].sum()))
