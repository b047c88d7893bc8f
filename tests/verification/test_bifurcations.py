"""Bifurcations of thick tubes against the exact small motions of `incremental`: loads, shapes, and what follows."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from softmodels.materials.laws import MooneyRivlin, NeoHookean
from softmodels.mechanics.newton import NoConvergence
from softmodels.path.continuation import Continuation, follow
from softmodels.runs.fields import Fields
from tests.support import bodies
from tests.support.cavities import OutsideBody, TubeBody
from tests.support.incremental import critical_pressure

TUBE = "exact incremental theory of a thick tube of a length held, inflated"
RUBBER = MooneyRivlin(45e3, 5e3, 0.5)
SOFT = NeoHookean(100e3, 0.5)


def bifurcations(points):
    return [point for point in points if point.bifurcation]


@pytest.fixture(scope="module")
def tube(equilibrium):
    """Half a wave of a tube that keeps its length."""
    return equilibrium(bodies.Tube(height=0.05, through=3, along=16), RUBBER, kind=TubeBody)


@pytest.fixture(scope="module")
def exact(tube):
    shape = tube.system.body.actuator
    return critical_pressure(RUBBER, shape.inner, shape.outer, 0.02, 0.03, along=math.pi / shape.height)


@pytest.fixture(scope="module")
def bulged(tube, solved):
    return solved(tube, [1.05 * 9 * tube.system.rest().V], "volume", "volume")


def test_bulging_tube(tube, exact, bulged, figure):
    """The pressure hardly rises there, so that the volume is the sharper figure."""
    pressure, radius = exact
    _, points, end = bulged
    assert end is None
    first = bifurcations(points)[0]
    figure(TUBE, "pressure at which it bulges", first.state.P * tube.system.stress_unit / pressure - 1, 4e-6)
    wanted = (radius / tube.system.body.actuator.inner) ** 2
    figure(TUBE, "volume at which it bulges", first.state.V / tube.system.rest().V / wanted - 1, 2.6e-5)
    at = points.index(first)
    assert all(point.stable_under_pressure and point.stable_under_volume for point in points[:at])
    beyond = points[at + 1 :]
    assert not any(point.stable_under_pressure for point in beyond)
    assert not any(point.stable_under_volume for point in beyond)


def test_bulging_mode_is_a_half_wave(tube, bulged, figure):
    _, points, _ = bulged
    first = bifurcations(points)[0]
    fields = Fields(tube)
    u = fields.shape(first.mode)
    X, height = fields.grid.points, tube.system.body.actuator.height
    inner = np.abs(X[:, 0] - tube.system.body.actuator.inner) < 1e-9
    wave = np.cos(np.pi * X[inner, 2] / height)
    share = u[inner, 0] @ wave / np.linalg.norm(u[inner, 0]) / np.linalg.norm(wave)
    figure(TUBE, "1 less the cosine of mode and half wave", abs(share) - 1, 4e-8)


@pytest.mark.parametrize("longest", [0.3, 1.5])
def test_step_sizes_do_not_move_a_bifurcation(tube, bulged, solved, longest, figure):
    first = bifurcations(bulged[1])[0]
    _, points, _ = solved(tube, [6 * tube.system.rest().V], "volume", "volume", largest_step=longest * tube.system.rest().V)
    (again,) = bifurcations(points)
    against = "the bulge met by other steps"
    figure(against, "volume", again.state.V / first.state.V - 1, 4e-6)
    figure(against, "pressure", again.state.P / first.state.P - 1, 4e-7)


def test_a_bifurcation_comes_once_where_a_value_behind_it_is_not_located(tube, bulged, solved, monkeypatch):
    """Its step is halved, and it is met again."""
    (first,), rest, failed = bifurcations(bulged[1]), tube.system.rest().V, []
    located = Continuation.between

    def once(path, before, after, value):
        if before.bifurcation and not failed:
            failed.append(value)
            raise NoConvergence("as if a part had snapped")
        return located(path, before, after, value)

    monkeypatch.setattr(Continuation, "between", once)
    wanted = first.state.V - rest + 1e-3 * first.state.V
    path, points, end = solved(tube, [wanted, 6 * rest], "arc-length", "volume")
    assert end is None and failed
    assert len(bifurcations(points)) == len(path.history.modes) == 1
    assert (np.diff([point.state.V for point in points]) > 0).all()
    assert [point.state.V - rest for point in points if point.requested] == pytest.approx([wanted, 6 * rest])


def test_bulge_grows_at_a_falling_pressure(tube, bulged, figure):
    """The mode bulges one end and narrows the other: turned round it is the same, and so are the two ways to follow it."""
    path, points, _ = bulged
    first = bifurcations(points)[0]
    curves = []
    for sign in (1, -1):
        branch = list(itertools.takewhile(lambda point: point.state.V < 1.3 * first.state.V, follow(path, first, sign)))
        V, P = np.array([(point.state.V, point.state.P) for point in branch]).T
        assert (np.diff(V) > 0).all() and (np.diff(P) < 0).all() and V[0] > first.state.V > 0 and P[0] < first.state.P
        assert not any(point.stable_under_pressure for point in branch)
        assert branch[-1].stable_under_volume  # a syringe holds the bulge that a pressure would blow up
        curves.append(CubicSpline(V, P))
    V = np.linspace(1.01 * first.state.V, 1.1 * first.state.V, 5)
    figure("the bulge's branch turned round", "pressure", curves[0](V) / curves[1](V) - 1, 1e-5)


@pytest.mark.campaign
def test_ring_under_pressure_from_outside(equilibrium, solved, figure):
    """Two waves around a ring in three dimensions; the error falls with the cells."""
    shape = bodies.Tube(section="quarter", outer=0.012, through=1.5, height=0.001, pressed="outside")
    ring = equilibrium(shape, SOFT, kind=OutsideBody)
    pressure, _ = critical_pressure(SOFT, shape.inner, shape.outer, 0.0098, 0.009999, outside=True, around=2)
    _, points, _ = solved(ring, [2 * pressure / ring.system.stress_unit])
    first = bifurcations(points)[0]
    against = "exact incremental theory of a ring under pressure from outside"
    figure(against, "buckling pressure", first.state.P * ring.system.stress_unit / pressure - 1, 1.2e-3)
    assert first.stable_under_pressure and not points[-1].stable_under_volume
