"""A balloon of Yeoh's rubber under a column raised and lowered: two limit points, two jumps, by thin-shell theory."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.optimize import brentq

from softmodels.materials.laws import NeoHookean, Yeoh
from softmodels.materials.specimens import balloon_pressure
from softmodels.mechanics.controls import pressure_control
from softmodels.path import continuation
from softmodels.path.continuation import MIN_RELEASE, Continuation, creep
from softmodels.path.schedule import NUDGE_DISPLACEMENT, Cycle, CyclePart, _state, cycle
from softmodels.path.stability import PathEnd
from tests.support import bodies
from tests.support.campaigns import sampled

THIN = 0.01
SHELL = "thin-shell theory of a Yeoh balloon under a dead pressure, up and down"
RUBBER = Yeoh(50e3, 150.0, 12.0, 0.5)
RADIUS = 0.010


def pressure(stretch):
    return float(balloon_pressure(RUBBER, stretch, THIN))


def slope(stretch, h=1e-4):
    return (pressure(stretch + h) - pressure(stretch - h)) / (2 * h)


@pytest.fixture(scope="module")
def balloon(equilibrium):
    shape = bodies.Sphere(inner=RADIUS * (1 - THIN / 2), outer=RADIUS * (1 + THIN / 2), through=1, along=24)
    return equilibrium(shape, RUBBER)


@pytest.fixture(scope="module")
def theory():
    """Stretches of both limit points, and where each jump lands."""
    upper, lower = brentq(slope, 1.2, 1.8), brentq(slope, 1.8, 5.0)
    return {
        "up": (upper, brentq(lambda s: pressure(s) - pressure(upper), lower, 9.0)),
        "down": (lower, brentq(lambda s: pressure(s) - pressure(lower), 1.0, upper)),
    }


@pytest.fixture(scope="module")
def ridden(balloon, theory):
    top = 1.2 * pressure(theory["up"][0]) / balloon.system.stress_unit
    return list(cycle(Continuation(balloon), [0.5 * top, top])), top


def stretch(balloon, point):
    """Of the middle of the wall; see `test_limit_points`."""
    inner = (point.state.V / balloon.system.rest().V) ** (1 / 3)
    middle = (1 + THIN / 2 / (1 - THIN / 2)) ** 3
    return ((inner**3 - 1 + middle) / middle) ** (1 / 3)


@pytest.mark.parametrize("way", sampled(["up", "down"]))
def test_limit_points_and_jumps(balloon, ridden, theory, way, figure):
    points, _ = ridden
    jumps = [k for k, point in enumerate(points) if point.jump]
    assert len(jumps) == 2
    at = jumps[0 if way == "up" else 1]
    before, after = points[at - 1], points[at]
    assert before.limit and after.stable_under_pressure
    limit, landing = theory[way]
    figure(SHELL, "limit pressures", before.state.P * balloon.system.stress_unit / pressure(limit) - 1, 6e-5)
    figure(SHELL, "pressure before and after a jump", after.state.P / before.state.P - 1, 1e-12)
    figure(SHELL, "stretch at the limit points", stretch(balloon, before) / limit - 1, 6e-5)
    figure(SHELL, "stretch where it lands", stretch(balloon, after) / landing - 1, 1e-4)


@pytest.mark.parametrize("way", ["up", "down"])
def test_a_balloon_let_go_at_its_limit_point_rests_where_the_curve_leads(balloon, ridden, theory, way, figure):
    """A second route to the same state, for devices whose curve cannot be followed that far."""
    points, _ = ridden
    limit = [k for k, point in enumerate(points) if point.jump][0 if way == "up" else 1] - 1
    path = Continuation(balloon)
    path.begin()
    edge = points[limit]
    pushed = edge.state.w + (1 if way == "up" else -1) * NUDGE_DISPLACEMENT / np.abs(edge.tangent.w).max() * edge.tangent.w
    state = creep(path, pressure_control(edge.state.P), dataclasses.replace(edge.state, w=pushed))
    assert balloon.system.potential.motion is None
    figure(SHELL, "volume where it comes to rest", state.V / points[limit + 1].state.V - 1, 1e-8)


def lose_curves(monkeypatch, again):
    """Cut off all behind the first limit point of a cycle, and what is followed from the first places of rest, ``again`` of
    them. Return the numbers of points that were cut off or found."""
    whole, found = Cycle._curve, []

    def lost(self, path, goal):
        points = whole(self, path, goal)
        first = next(k for k, point in enumerate(points) if point.limit) if not found else 0
        found.append(len(points) - first)
        return points[: first + 2] if len(found) == 1 else points[:1] if len(found) <= 1 + again else points

    monkeypatch.setattr(Cycle, "_curve", lost)
    return found


@pytest.mark.campaign
@pytest.mark.parametrize("again", [0, 2], ids=["once", "and where it rests too"])
def test_a_cycle_whose_curve_is_lost_is_the_same(balloon, ridden, monkeypatch, again):
    """With all behind the first limit point cut off, the device is let go there, and its curve followed from where it rests.
    Where that is lost at once, the device is let go again, each time ten times as far on."""
    points, top = ridden
    cut, path = lose_curves(monkeypatch, again), Continuation(balloon)
    found = list(cycle(path, [0.5 * top, top]))
    assert cut[0] > 10 and path.history.snaps >= 1 + again
    landed = [point for point in found if point.jump][: 1 + again]
    first = MIN_RELEASE * path.requested.first_step(path.plane, path.history.V0)
    at = [point.state.P for point in landed]
    further = [min(on * first, top - P) for on, P in zip((1.0, 10.0), at, strict=False)][:again]  # not beyond the top
    assert np.diff(at) == pytest.approx(further, rel=1e-6)
    others = [point for point in found if point not in landed[1:]]
    for wanted, other in zip(*([p for p in some if p.requested or p.jump] for some in (points, others)), strict=True):
        assert pytest.approx(wanted.state.P, rel=1e-9, abs=1e-12) == other.state.P
        assert pytest.approx(wanted.state.V, rel=1e-6) == other.state.V and other.jump == wanted.jump


def test_a_device_that_snaps_too_often_is_said_to_crumple(balloon, ridden, monkeypatch):
    lose_curves(monkeypatch, 5)
    monkeypatch.setattr(continuation, "MAX_SNAPS", 1)
    points, path = [], Continuation(balloon)
    with pytest.raises(PathEnd) as end:
        points.extend(cycle(path, [ridden[1]]))
    assert end.value.cause is continuation.DEVICE_CRUMPLES and not end.value.physical
    assert path.history.snaps == 1 and points[-1].jump and points[-1].stable_under_pressure


def test_a_pressure_beyond_a_part_by_rounding_is_that_of_its_end(ridden):
    rising = tuple(point for point in ridden[0][:8] if not point.limit and not point.requested)
    part = CyclePart(rising, Continuation(None), buckles=False)
    for end, away in ((rising[0], -1e-15), (rising[-1], 1e-15)):
        assert _state(part, end.state.P + away).state is end.state


def test_the_way_back_is_another(balloon, ridden):
    """At half the top pressure the balloon is small on the way up and large on the way down; it comes home in the end."""
    points, top = ridden
    asked = [point for point in points if point.requested]
    P = [point.state.P for point in asked]
    assert pytest.approx([0.5 * top, top, top, 0.5 * top, 0.0], abs=1e-12) == P
    assert all(point.stable_under_pressure for point in points if not point.limit)
    up = [point for point in asked if pytest.approx(0.5 * top) == point.state.P]
    assert len(up) == 2
    assert pytest.approx(balloon.system.rest().V, rel=1e-9) == points[-1].state.V
    rising = np.diff([point.state.V for point in points])
    turn = int(np.argmax([point.state.P for point in points]))
    assert (rising[:turn] > -1e-9).all() and (rising[turn:] < 1e-9).all()


@pytest.mark.campaign
def test_a_balloon_with_no_second_stable_part_says_so(equilibrium):
    shape = bodies.Sphere(inner=RADIUS * (1 - THIN / 2), outer=RADIUS * (1 + THIN / 2), through=1, along=12)
    equations = equilibrium(shape, NeoHookean(100e3, 0.5))
    path, points = Continuation(equations), []
    with pytest.raises(PathEnd) as end:
        points.extend(cycle(path, [1.0]))
    assert end.value.limit is not None and "no stable state" in str(end.value)
