"""The iterative solver against the direct one: same states, same limit point, same stability."""

from __future__ import annotations

import contextlib
import math

import numpy as np
import pytest

from geometries import HollowDisk
from softmodels.materials.laws import NeoHookean
from softmodels.mechanics import mpi, solver as solver_module
from softmodels.mechanics.controls import volume_control
from softmodels.mechanics.iterative import Multigrid
from softmodels.mechanics.mpi import TooLargeError
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path.continuation import Continuation, trace
from softmodels.path.points import PathEnd
from softmodels.path.stability import Stability

DIRECT = "the direct solver"
LAW = NeoHookean(30e3, 0.49)
WEDGE = HollowDisk(angle=15.0, cell_size=0.008, fillet=0.0, base_fillet=0.0)
SECTION = HollowDisk.variant("shadow", section="axisymmetric", cell_size=0.004)
PRESSURES = [0.05, 0.2]


def followed(solver, goals):
    """All points of a path, up to its end."""
    points = []
    with contextlib.suppress(PathEnd):
        points.extend(trace(Continuation(solver), goals))
    return points


@pytest.fixture(scope="module")
def paths(body_of):
    """Return a function that follows a device by both solvers."""

    def both(device, law, goals):
        made = [Solver(System(body_of(device), law), method) for method in ("direct", "iterative")]
        return made, [followed(solver, goals) for solver in made]

    return both


def test_wedge_through_its_pressures(paths, figure):
    solvers, found = paths(WEDGE, LAW, PRESSURES)
    assert [solver.method.name for solver in solvers] == ["direct", "iterative"]
    assert solvers[1].bordered.factorisations < len(found[1]), "a set-up serves several states"
    one, other = ([point.state for point in points if point.requested] for points in found)
    assert [state.P for state in one] == [state.P for state in other] == PRESSURES
    figure(DIRECT, "volumes of a wedge by iterations", [b.V / a.V - 1 for a, b in zip(one, other, strict=True)], 1e-9)
    apart = [np.abs(b.w - a.w).max() / np.abs(a.w).max() for a, b in zip(one, other, strict=True)]
    figure(DIRECT, "displacements and pressures of a wedge by iterations", apart, 1e-8)


def test_a_cycle_leaves_held_dofs_alone(body_of):
    """No residual knows of a held dof that has moved: its displacement would stay, and grow from guess to guess."""
    system = System(body_of(WEDGE), LAW)
    solver = Solver(system, "iterative")
    solver.factorise(system.rest())
    held = np.unique(np.concatenate([bc.dof_indices()[0] for bc in system.bcs]))
    b, x = system.K.createVecRight(), system.K.createVecRight()
    b.array_w[:] = np.random.default_rng(0).normal(size=system.n)
    solver.bordered.inverse.apply(b, x)
    np.testing.assert_array_equal(x.array_r[held], b.array_r[held])
    state = solver.solve(volume_control(1.1 * system.rest().V), system.rest().w, 0.0)
    assert not state.w[held].any()


def test_section_past_its_limit(paths, figure):
    solvers, found = paths(SECTION, NeoHookean(20e3, 0.495), [0.1, 3.0])
    one, other = (next(point.state for point in points if point.limit) for points in found)
    figure(DIRECT, "pressure at a limit point by iterations", other.P / one.P - 1, 1e-8)
    one, other = (next(point for point in points if point.requested) for points in found)
    figure(DIRECT, "volume of a section by iterations", other.state.V / one.state.V - 1, 1e-8)
    apart = other.signature.lowest / one.signature.lowest - 1
    figure(DIRECT, "lowest eigenvalue by iterations", apart, 5e-6)
    for points in found:
        limit = next(number for number, point in enumerate(points) if point.limit)
        counts = [point.signature.negative_eigenvalues for point in points]
        assert counts == [0] * (limit + 1) + [1] * (len(points) - limit - 1) and len(points) > limit + 1
    # Back at a stable state it is that one's eigenvalues that are counted.
    solvers[1].factorise(other.state)
    assert Stability.of(solvers[1]).negative_eigenvalues() == 0


def test_model_that_does_not_fit(body_of, monkeypatch):
    """It is given to the iterative solver where that one fits, and refused with the estimate before anything is solved."""
    monkeypatch.setattr(solver_module, "AMPLE", math.inf)
    system = System(body_of(WEDGE), LAW)
    both = [solver_module.select_solver(system, method) for method in ("auto", "direct", "iterative")]
    assert [method.name for method in both] == ["direct", "direct", "iterative"]
    direct, iterative = both[0].memory, both[2].memory
    monkeypatch.setattr(mpi, "free", lambda: 0.5 * min(direct, iterative))
    for method, taken in (("auto", direct), ("direct", direct), ("iterative", iterative)):
        with pytest.raises(TooLargeError, match=f"{taken / 1e9:.2g} GB of memory, where .* GB are free"):
            solver_module.select_solver(system, method)
    monkeypatch.setattr(Multigrid, "memory", lambda system: 0.1 * min(direct, iterative))
    switched = solver_module.select_solver(system, "auto")
    assert switched.name == "iterative" and f"a factorisation would take about {direct / 1e9:.2g} GB" in switched.told
    with pytest.raises(TooLargeError, match='or solver="iterative"'):
        solver_module.select_solver(system, "direct")
