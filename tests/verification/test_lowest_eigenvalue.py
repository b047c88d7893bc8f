"""The lowest eigenvalue of every state against dense eigenvalues, past one and two limit points and a bifurcation."""

from __future__ import annotations

import math
import types

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse

from geometries import HollowDisk, PneuNet, SeminarActuator
from softmodels.components.contact import Walls
from softmodels.materials.laws import NeoHookean, Yeoh
from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path import stability
from softmodels.path.stability import Pencil, nearest
from tests.support import bodies

DENSE = "lowest eigenvalue by LAPACK, dense matrices"
COARSE = {"cell_size": 0.01, "refinement": 1.0, "fillet": 0.0, "base_fillet": 0.0}
DISK = HollowDisk.variant("shadow", section="axisymmetric", **COARSE)
SLAB = SeminarActuator(channels=1, spread=20.0, around=6.0, cell_size=0.006)
TWIN = HollowDisk.variant("shadow", section="axisymmetric", base=0.002, wall=0.015, **COARSE)
HARDENING = Yeoh(10e3, 20.0, 3.0, 0.495)
SOFT = NeoHookean(30e3, 0.49)


def dense(matrix):
    rows, columns, values = matrix.getValuesCSR()
    return scipy.sparse.csr_matrix((values, columns, rows)).toarray()


def known_lowest(equations, state):
    """The lowest eigenvalue of displacements alone, p eliminated, by LAPACK."""
    equations.factorise(state)
    K, M = dense(equations.system.K), dense(stability.Stability.of(equations).M)
    p = np.ravel(equations.system.space.sub(1).collapse()[1])
    free = np.setdiff1d(np.arange(len(K)), np.concatenate([p, *(bc.dof_indices()[0] for bc in equations.system.bcs)]))
    coupling = K[np.ix_(p, free)]
    A = K[np.ix_(free, free)] - coupling.T @ np.linalg.solve(K[np.ix_(p, p)], coupling)
    return scipy.linalg.eigh(A, M[np.ix_(free, free)], eigvals_only=True, subset_by_index=[0, 0])[0]


def checked(equations, points):
    """Lowest eigenvalues of a path's points beside the known ones."""
    found = [point.signature.lowest for point in points]
    return np.array(found), np.array([known_lowest(equations, point.state) for point in points])


@pytest.fixture(scope="module")
def ballooned(equilibrium, solved):
    """A balloon of a silicone that hardens late, past both its limit points, with its equations."""
    equations = equilibrium(bodies.Sphere(inner=0.01, outer=0.011, through=1, along=6), Yeoh(10e3, 60.0, 3.0, 0.495))
    _, points, _ = solved(equations, [60 * equations.system.rest().V], quantity="volume")
    return equations, points


def test_past_two_limit_points(ballooned, figure):
    equations, points = ballooned
    assert [point.limit for point in points].count(True) == 2
    assert {point.signature.negative_eigenvalues for point in points} == {0, 1}
    found, wanted = checked(equations, [point for point in points if not point.limit])
    figure(DENSE, "a balloon past two limit points", (found - wanted) / np.maximum(np.abs(wanted), 1.0), 5e-8)
    assert all(point.signature.lowest == 0.0 for point in points if point.limit)


def test_past_a_limit_point_of_a_disk(equilibrium, solved, figure):
    """There eigenvalues of both signs are alike in size, between which inverse iterations cannot choose in time."""
    equations = equilibrium(DISK, SOFT)
    goals = [volume * 1e-6 / equations.system.volume_unit for volume in (35.0, 40.0, 45.0)]
    _, points, _ = solved(equations, goals, quantity="volume")
    found, wanted = checked(equations, [point for point in points if point.requested])
    assert (wanted < 0.0).all()
    figure(DENSE, "a disk past its limit point", found / wanted - 1, 8e-9)


@pytest.mark.campaign
def test_at_a_bifurcation_past_a_limit_point(equilibrium, solved, figure):
    """There the lowest eigenvalue is negative already, and another one is zero."""
    equations = equilibrium(TWIN, HARDENING)
    _, points, _ = solved(equations, [90e-6 / equations.system.volume_unit], quantity="volume")
    found, wanted = checked(equations, [point for point in points if point.bifurcation] + points[-1:])
    assert len(found) >= 2 and (found < -0.1).all()
    figure(DENSE, "a disk at a bifurcation past its limit point", found / wanted - 1, 7e-8)


def test_where_the_tangent_is_not_factorised(equilibrium, solved, monkeypatch, figure):
    """The modes of the last factorisation lead there."""
    monkeypatch.setattr(stability, "SMALL_SYSTEM", 0)
    equations = equilibrium(DISK, SOFT)
    _, points, _ = solved(equations, [25e-6 / equations.system.volume_unit], quantity="volume", largest_step=0.2)
    aside = [point for point in points if not point.signature.exact]
    assert len(aside) > len(points) / 2
    found, wanted = checked(equations, aside[::4])
    figure(DENSE, "where the tangent is not factorised", found / wanted - 1, 1e-5)


@pytest.mark.campaign
def test_thin_walls_whose_tangent_is_not_factorised(equilibrium, solved, monkeypatch, figure):
    """A correction that is short may work much there."""
    monkeypatch.setattr(stability, "SMALL_SYSTEM", 0)
    equations = equilibrium(SLAB, SOFT)
    _, points, _ = solved(equations, [0.4], largest_step=0.08)
    watched = stability.Stability.of(equations)
    aside = [point for point in points if not point.signature.exact]
    assert len(aside) > len(points) / 2
    errors = []
    for point in aside:
        equations.factorise(point.state)
        errors.append(point.signature.lowest / watched.lowest() - 1)
    figure("lowest eigenvalue where the tangent is factorised", "of a slab where it is not", errors, 3e-5)


@pytest.mark.campaign
def test_where_walls_press_on_each_other_it_is_exact(body_of, solved, monkeypatch, figure):
    """Which places press changes from state to state, so that a kept factorisation is of another device."""
    monkeypatch.setattr(stability, "SMALL_SYSTEM", 0)
    finger = PneuNet(chambers=2, cell_size=0.006)
    equations = Solver(System(body_of(finger), NeoHookean(16e3, 0.49), components=[Walls()]))
    _, points, _ = solved(equations, [0.0125, 0.025, 0.0625])
    pressed = [point for point in points if equations.system.assembled.touches(point.state.w)]
    assert len(pressed) >= 3
    watched, errors = stability.Stability.of(equations), []
    for point in pressed:
        equations.factorise(point.state)
        errors.append(point.signature.lowest / watched.lowest() - 1)
    figure("lowest eigenvalue where the tangent is factorised", "of a finger whose walls press", errors, 1e-9)


def test_it_does_not_depend_on_the_way_there(ballooned):
    """A state asked of by itself, without those before it, has the same eigenvalue."""
    equations, points = ballooned
    watched = stability.Stability.of(equations)
    watched.start()
    for point in (points[-1], points[3]):
        equations.factorise(point.state)
        assert watched.lowest() == pytest.approx(point.signature.lowest, rel=1e-12)


@pytest.mark.campaign
def test_a_section_and_a_wedge_agree_far_past_the_limit_point(equilibrium, solved, figure):
    """On coarse cells; 2.5 times in between, before the residual was looked at."""
    values = []
    for options in ({"section": "axisymmetric"}, {"angle": 20.0}):
        equations = equilibrium(HollowDisk.variant("shadow", **COARSE, **options), SOFT)
        _, points, _ = solved(equations, [45e-6 / equations.system.volume_unit], quantity="volume")
        values.append(points[-1].signature.lowest * equations.system.stress_unit)
    assert values[0] < 0
    figure("a section's lowest eigenvalue far past the limit", "the wedge's, coarse cells", values[1] / values[0] - 1, 6e-3)


def test_what_is_not_found_is_not_a_number(ballooned, monkeypatch):
    equations, points = ballooned
    watched = stability.Stability.of(equations)
    equations.factorise(points[-1].state)
    monkeypatch.setattr("softmodels.path.stability.MAX_SOLVES", 3)
    assert math.isnan(watched.lowest())
    # Nor is one taken where the matrix has fewer negative eigenvalues than it is said to have, or more.
    monkeypatch.undo()
    start = [equations.system.K.createVecRight()]
    equations.bordered.solve(watched.sense, start[0])
    for negatives in (1, 3):
        with pytest.raises(NoConvergence):
            nearest(Pencil(equations.bordered.K.mult, watched.M, equations.bordered.solve), start, [1e-7], 50, negatives)


def test_a_nan_has_the_next_point_factorised(ballooned, monkeypatch):
    equations, points = ballooned
    watched = stability.Stability.of(equations)
    monkeypatch.setattr(stability, "SMALL_SYSTEM", 0)
    monkeypatch.setattr("softmodels.path.stability.nearest", lambda *words: (_ for _ in ()).throw(NoConvergence("")))
    equations.factorise(points[-1].state)
    assert math.isnan(watched.signature(exact=True).lowest)
    assert watched.wants(types.SimpleNamespace(w=points[-1].state.w, P=points[-1].state.P))
