"""The iterative solver against the direct one: same states, same limit point, same stability."""

from __future__ import annotations

import contextlib
import math

import numpy as np
import pytest

from geometries import Beam, HollowDisk, PneuNet
from softmodels.case.materials import Region
from softmodels.materials.laws import NeoHookean
from softmodels.mechanics import mpi, newton as direct, solver as solver_module
from softmodels.mechanics.controls import volume_control
from softmodels.mechanics.iterative import Multigrid, corners_of
from softmodels.mechanics.mpi import TooLargeError
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path.continuation import Continuation, trace
from softmodels.path.stability import PathEnd, Stability

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


@pytest.mark.campaign
def test_section_past_its_limit(paths, figure):
    solvers, found = paths(SECTION, NeoHookean(20e3, 0.495), [0.1, 3.0])
    one, other = (next(point.state for point in points if point.limit) for points in found)
    figure(DIRECT, "pressure at a limit point by iterations", other.P / one.P - 1, 1e-8)
    figure(DIRECT, "volume at a limit point by iterations", other.V / one.V - 1, 1e-8)
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
    monkeypatch.setattr(solver_module, "AMPLE_FACTORISATION_BYTES", math.inf)
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
    assert switched.name == "iterative" and f"a factorisation would take about {direct / 1e9:.2g} GB" in switched.description
    with pytest.raises(TooLargeError, match='or solver="iterative"'):
        solver_module.select_solver(system, "direct")


# -- The levels of displacements' multigrid against the assembled matrix, and against DOLFINx' interpolation between--


HARD_LAW = NeoHookean(30e3, 0.45)
DEVICES = {
    "skew wedge": HollowDisk(cell_size=0.008, fillet=0.0, angle=30.0, azimuth=20.0),
    "finger of two regions": PneuNet(chambers=2, cell_size=0.006),
    "section": HollowDisk.variant("shadow", section="axisymmetric", cell_size=0.006),
}
MATRIX, OTHER = "the assembled matrix", "interpolation by DOLFINx"


MOST = 70
"""Iterations of GMRES to 1e-8."""


@pytest.fixture(params=[(name, "mixed") for name in DEVICES] + [("skew wedge", "displacement")], ids="-".join)
def set_up(request, body_of):
    """Return a solver with its levels of a random state near rest, ones at free dofs, and a generator of random numbers."""
    name, formulation = request.param
    components = [Region(NeoHookean(400e3, 0.45), name="base")] if "regions" in name else []
    system = System(body_of(DEVICES[name]), HARD_LAW, formulation, components=components)
    solver, generator = Solver(system, "iterative"), np.random.default_rng(0)
    free = np.ones(system.n)
    free[np.concatenate([bc.dof_indices()[0] for bc in system.bcs])] = 0.0
    rest = system.rest()
    solver.factorise(rest)
    system.w.x.array[:] = 1e-3 * generator.standard_normal(system.n) * free
    system._set_pressures(0.1, np.empty(0))
    system.assemble_tangent()
    solver.bordered.factorise()  # the levels that were made at rest take this state's matrix
    return solver, free, generator


def test_products_of_the_quadratic_level(set_up, figure):
    solver, _, generator = set_up
    system, inverse = solver.system, solver.bordered.inverse
    quadratic, _ = inverse._levels
    u, x, y = inverse._u, system.K.createVecRight(), system.K.createVecLeft()
    moved, b = generator.standard_normal(len(u)), generator.standard_normal(len(u))
    x.array_w[u] = moved
    system.K.mult(x, y)
    quadratic.x[:] = moved
    found, known = quadratic.residual(b), b - y.array_r[u]
    figure(MATRIX, "residual of a level in single precision", (found - known) / np.abs(known).max(), 1e-7)


def test_the_linear_level_is_the_quadratic_one_on_linear_displacements(set_up, figure):
    from dolfinx import fem
    from scipy.spatial import cKDTree

    solver, free, generator = set_up
    system, inverse = solver.system, solver.bordered.inverse
    _, linear = inverse._levels
    nodes, d = inverse._nodes, system.body.mesh.geometry.dim
    corners = fem.Function(fem.functionspace(nodes.mesh, ("Lagrange", 1, (d,))))
    places = corners.function_space.tabulate_dof_coordinates()
    own, _ = corners_of(nodes)
    _, at = cKDTree(places).query(inverse._places[own])
    held = free[inverse._u].reshape(-1, d)[own] == 0
    values = np.where(held, 0.0, generator.standard_normal(held.shape))
    corners.x.array.reshape(-1, d)[at] = values
    between = fem.Function(nodes)
    between.interpolate(corners)
    x, y = system.K.createVecRight(), system.K.createVecLeft()
    x.array_w[inverse._u] = between.x.array * free[inverse._u]
    system.K.mult(x, y)
    b, c = linear._matrix.createVecRight(), linear._matrix.createVecLeft()
    b.array_w[:] = values.ravel()
    linear._matrix.mult(b, c)
    figure(OTHER, "energy of linear displacements by the linear level", b.dot(c) / x.dot(y) - 1, 1e-11)


def test_a_cycle_is_linear_and_near_the_inverse(set_up, figure):
    """GMRES needs the first to the last digits, and few iterations the second."""
    solver, free, generator = set_up
    system, inverse = solver.system, solver.bordered.inverse
    one, other, both, x, y, z = (system.K.createVecRight() for _ in range(6))
    for vector in (one, other):
        vector.array_w[:] = generator.standard_normal(system.n) * free
    both.array_w[:] = 3.0 * one.array_r - 1e4 * other.array_r
    for b, into in ((one, x), (other, y), (both, z)):
        inverse.apply(b, into)
    apart = z.array_r - (3.0 * x.array_r - 1e4 * y.array_r)
    figure("theory", "a cycle of a sum less the cycles' sum", apart / np.abs(z.array_r).max(), 1e-11)
    solver.lagged.set_columns()
    assert solver.bordered.iterate(one, x, 1e-8) <= MOST


# -- Factorisations in single precision against double: same states and eigenvalues, and double where single is not --


LARGE_WEDGE = HollowDisk(angle=22.5, cell_size=0.006, fillet=0.0, base_fillet=0.0)
SLENDER = Beam(length=0.2, width=0.004, thickness=0.002, cell_size=0.002)
DOUBLE = "double precision"


@pytest.fixture
def solver_of(body_of, monkeypatch):
    """Return a function that gives a device's solver in a precision, whatever the device's size."""

    def made(device, rounded):
        monkeypatch.setattr(direct, "MAX_CACHED_UNKNOWNS", 0 if rounded else 10**9)
        return Solver(System(body_of(device), LAW), "direct")

    return made


@pytest.mark.campaign
def test_the_path_and_its_eigenvalues_are_those_of_double_precision(solver_of, figure):
    found = []
    for rounded in (True, False):
        solver = solver_of(LARGE_WEDGE, rounded)
        points = [point for point in trace(Continuation(solver), [0.1, 0.3]) if point.requested]
        solver.factorise(points[-1].state)
        assert solver.bordered.inverse.rounded is rounded
        found.append((points, Stability.of(solver).lowest()))
    (single, mode), (double, expected) = found
    apart = [np.abs(a.state.w - b.state.w).max() / np.abs(b.state.w).max() for a, b in zip(single, double, strict=True)]
    figure(DOUBLE, "displacements and pressures of a wedge, factors in single precision", apart, 1e-8)
    figure(DOUBLE, "lowest eigenvalue of a wedge, factors in single precision", mode / expected - 1, 1e-8)


def test_answers_of_the_inverse_are_refined(solver_of, figure):
    solver = solver_of(LARGE_WEDGE, rounded=True)
    solver.factorise(solver.system.rest())
    K = solver.system.K
    b, x, left = (K.createVecRight() for _ in range(3))
    b.array_w[:] = np.random.default_rng(0).normal(size=solver.system.n)
    for name, solve, bounds in (
        ("rough", solver.bordered.solve_roughly, (1e-9, 1e-2)),
        ("refined", solver.bordered.solve, (0.0, 1e-11)),
    ):
        solve(b, x)
        K.mult(x, left)
        left.aypx(-1.0, b)
        assert bounds[0] <= left.norm() / b.norm() <= bounds[1], name


def test_a_slender_beam_is_factorised_in_double_precision(solver_of):
    """A hundred times as long as thick: single precision has an eigenvalue of its own to offer."""
    solver = solver_of(SLENDER, rounded=True)
    solver.factorise(solver.system.rest())
    assert not solver.bordered.inverse.rounded
    assert Stability.of(solver).negative_eigenvalues() == 0
    solver.factorise(solver.system.rest())  # single precision is tried again, for every K
    assert not solver.bordered.inverse.rounded
