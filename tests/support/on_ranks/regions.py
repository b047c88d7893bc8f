"""Figures of a body of two materials; and a state taken apart over the nodes comes back to the last bit."""

from __future__ import annotations

import numpy as np

from tests.support.bodies import LayeredSphere

MESHES = {"sphere": LayeredSphere(through=3, along=12)}


def figures(comm, folder):
    """Numbers that no number of ranks may change."""
    from softmodels.case.materials import Region
    from softmodels.materials.laws import NeoHookean, Yeoh
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.mpi import largest, total
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System
    from softmodels.path.continuation import Continuation, trace
    from softmodels.path.stability import QUANTITIES
    from softmodels.runs.fields import Fields

    components = [Region(Yeoh(60e3, 2e3, 100.0, 0.49), name="shell")]
    body = Body.from_file(MESHES["sphere"], folder / "sphere.msh", comm)
    solver = Solver(System(body, NeoHookean(30e3, 0.48), components=components))
    system = solver.system
    *_, last = trace(Continuation(solver, QUANTITIES["volume"], "volume"), [0.5 * system.rest().V])
    fields = Fields(solver)
    found = fields.figures(last.state)
    again = fields.state(fields.nodal(last.state), last.state.P, last.state.V)
    moved = [fields.sampling.displacement(state.w) for state in (again, last.state)]
    away = largest(comm, float(np.abs(moved[0] - moved[1]).max(initial=0.0))) / system.length_unit
    assert away < 1e-14, away
    p = fields.values(last.state).p
    spread = [bound for pair in found.extremes.values() for bound in pair]
    squares = total(comm, float((p**2).sum()))
    return {"sphere": [found.pressure, found.stored_energy, *spread, squares, last.signature.lowest]}
