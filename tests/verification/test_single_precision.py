"""Factorisations in single precision against double: same states and eigenvalues, and double where single is not enough."""

from __future__ import annotations

import numpy as np
import pytest

from geometries import Beam, HollowDisk
from softmodels.materials.laws import NeoHookean
from softmodels.mechanics import iterative as direct
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path.continuation import Continuation, trace
from softmodels.path.stability import Stability

LAW = NeoHookean(30e3, 0.49)
WEDGE = HollowDisk(angle=22.5, cell_size=0.006, fillet=0.0, base_fillet=0.0)
SLENDER = Beam(length=0.2, width=0.004, thickness=0.002, cell_size=0.002)
DOUBLE = "double precision"


@pytest.fixture
def solver_of(body_of, monkeypatch):
    """Return a function that gives a device's solver in a precision, whatever the device's size."""

    def made(device, rounded):
        monkeypatch.setattr(direct, "SMALL", 0 if rounded else 10**9)
        return Solver(System(body_of(device), LAW), "direct")

    return made


def test_the_path_and_its_eigenvalues_are_those_of_double_precision(solver_of, figure):
    found = []
    for rounded in (True, False):
        solver = solver_of(WEDGE, rounded)
        points = [point for point in trace(Continuation(solver), [0.1, 0.3]) if point.requested]
        solver.factorise(points[-1].state)
        assert solver.bordered.inverse.rounded is rounded
        found.append((points, Stability.of(solver).lowest()))
    (single, mode), (double, expected) = found
    apart = [np.abs(a.state.w - b.state.w).max() / np.abs(b.state.w).max() for a, b in zip(single, double, strict=True)]
    figure(DOUBLE, "displacements and pressures of a wedge, factors in single precision", apart, 1e-8)
    figure(DOUBLE, "lowest eigenvalue of a wedge, factors in single precision", mode / expected - 1, 1e-8)


def test_answers_of_the_inverse_are_refined(solver_of, figure):
    solver = solver_of(WEDGE, rounded=True)
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
