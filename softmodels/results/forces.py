"""Forces and stiffness of the whole device: figures that all ranks compute together, with the columns they fill.

One more is a `Measure` in `MEASURES`, also from outside.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np

from softmodels.mechanics.mpi import largest
from softmodels.mechanics.reaction import held_force
from softmodels.mechanics.section_axes import in_section
from softmodels.mechanics.system import State, System
from softmodels.results.rigid_figures import rigid_parts
from softmodels.results.state_values import Sampling


@dataclasses.dataclass(frozen=True)
class Measure:
    """A figure of a state that needs all ranks.

    Attributes:
        compute: Columns of ``path.csv`` and their values, on all ranks, while the state is loaded; none where it says nothing
            of a device.
        texts: Short name and meaning by column; a pattern of `re` may stand for several columns, whose group ``{0}`` is then.
    """

    compute: Callable[[Sampling, State], dict[str, float]]
    texts: Mapping[str, tuple[str, str]]


def _force_unit(eq: System) -> float:
    """N of the whole device for a dimensionless force on the modelled slice."""
    return eq.stress_unit * eq.length_unit**2 * eq.body.actuator.copies


def blocked_force(sampling: Sampling, state: State) -> dict[str, float]:
    """Force in N of the whole device on what blocks it, if something does."""
    eq = sampling.system
    role = eq.body.actuator.blocked
    if role is None:
        return {}
    # Held along the lift, so one row of the skew basis is the lift.
    along = in_section(eq.body.actuator.lift, eq.body.actuator.dimension)
    component = int(np.argmax(eq.body.skew @ along))
    return {"blocked_force_N": held_force(eq, role, component) * _force_unit(eq)}


def contact_force(sampling: Sampling, state: State) -> dict[str, float]:
    """Force in N of the whole device on the plane that stops it, and how deep it has sunk in; nothing without one.

    Planes that a cut-out slice's copies bring along count with theirs.
    """
    from dolfinx import fem

    eq, grid = sampling.system, sampling.grid
    contact = eq.contact
    if contact is None:
        return {}
    nodes = fem.locate_dofs_topological(grid.space, eq.body.mesh.topology.dim - 1, contact.facets)
    nodes = nodes[nodes < grid.owned]
    places = grid.space.tabulate_dof_coordinates()[nodes, : grid.dimension]
    gaps = contact.gaps(places + state.w[sampling.skew[nodes]] @ eq.body.skew_inverse.T)
    deepest = largest(eq.comm, float(-gaps.min()) if gaps.size else -np.inf)
    return {
        "contact_force_N": eq.contact_force() * _force_unit(eq),
        "contact_depth_mm": max(deepest, 0.0) * eq.length_unit * 1e3,
    }


def part_figures(sampling: Sampling, state: State) -> dict[str, float]:
    """What the parts added to the device tell of a state."""
    eq = sampling.system
    return {name: value for term in eq.potential.terms.values() for name, value in term.figures(eq).items()}


def dead_loads(sampling: Sampling, state: State) -> dict[str, float]:
    """Weights, forces and moments on the device, and what they move."""
    eq = sampling.system
    return eq.dead.figures(eq.drives_at(state)[len(eq.body.actuator.ratios) :])


def stiffness(sampling: Sampling, state: State) -> dict[str, float]:
    """Stiffness in N/m of the whole device along the lift at a state, if it tells of one: a tangent, no difference.

    The load is spread over the `Actuator.pushed` face, and the motion is that face's mean; the pressure is kept.
    """
    eq = sampling.system
    actuator = eq.body.actuator
    if actuator.pushed is None:
        return {}
    compliance = sampling.solver.dead_load_compliance(state, sampling.push)  # of a unit load on each slice
    unit = eq.stress_unit * eq.length_unit * actuator.copies
    return {f"{actuator.pushed}_stiffness_N_per_m": unit / compliance if compliance else np.inf}  # held


MEASURES: list[Measure] = [
    Measure(part_figures, {}),  # their texts stand on the kinds of parts
    Measure(dead_loads, {}),
    Measure(rigid_parts, {}),
    Measure(
        blocked_force,
        {"blocked_force_N": ("blocked force", "with which the whole device pushes along its lift on what holds its tip")},
    ),
    Measure(
        contact_force,
        {
            "contact_force_N": ("contact force", "of the whole device on the rigid plane, along the plane's normal"),
            "contact_depth_mm": ("contact depth", "how deep the stopped faces have sunk into the rigid plane"),
        },
    ),
    Measure(
        stiffness,
        {
            r"(\w+)_stiffness_N_per_m": (
                "{0} stiffness", "force along the lift, spread over the {0}, per rise of it at this pressure",
            ),
        },
    ),
]  # fmt: skip
"""In the order of their columns."""
