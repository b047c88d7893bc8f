"""The pressure at a bifurcation and its derivatives, on a disk with two equal membranes of which one balloons in the end."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from geometries import HollowDisk
from geometries.actuator import changed
from softmodels.design.quantities import DesignedBody
from softmodels.design.states import Adjoint, Bifurcations, Cubic
from softmodels.materials.laws import Yeoh
from softmodels.mechanics.body import Body
from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path.continuation import Continuation, trace
from softmodels.path.stability import AddedVolume
from tests.support.campaigns import sampled

TWIN = HollowDisk.variant("shadow", section="axisymmetric", base=0.002, wall=0.015, cell_size=0.003)
LAW = Yeoh(10e3, 20.0, 3.0, 0.495)
DIFFERENCES = "differences of bifurcations that were located anew"


@pytest.fixture(scope="module")
def twin(comm, tmp_path_factory):
    """The device, what finds its bifurcation, the one a path located, and the one found from it."""
    file = TWIN.write(tmp_path_factory.mktemp("twin") / "twin.msh")
    design = DesignedBody(Solver(System(Body.from_file(TWIN, file, comm), LAW)))
    finder = Bifurcations(design, Adjoint(design))
    path = Continuation(design.solver, AddedVolume(), largest_step=2.0)
    located = next(point for point in trace(path, [12.0]) if point.bifurcation)
    found = finder.near(located.state, located.state.V, located.mode, design.volume_at_rest())
    yield design, finder, located, found
    design.release()


def again(twin):
    """Pressure in Pa of the bifurcation where the device and its silicone are now."""
    design, finder, _, found = twin
    rest = design.volume_at_rest()
    V = found.V - twin_rest(design) + rest
    return finder.near(found.states[0], V, found.mode, rest).P * design.system.stress_unit


def twin_rest(design):
    """Volume of the cavity of the device as it was meshed."""
    now = design.motion.device
    design.motion.move(TWIN)
    volume = design.volume_at_rest()
    design.motion.move(now)
    return volume


def test_it_is_where_the_path_has_it(twin, figure):
    _, _, located, found = twin
    figure("a path's own search", "pressure at a bifurcation", found.P / located.state.P - 1, 1e-5)
    assert found.eigenvalues[0] > 0 > found.eigenvalues[-1]


@pytest.mark.parametrize("names", sampled([("cavity_radius",), ("membrane", "base")], whole=True), ids="+".join)
def test_lengths_that_keep_the_symmetry(twin, figure, names):
    """Membrane and base together: with one of them alone the two membranes differ, and nothing bifurcates."""
    design, finder, _, found = twin
    rates, _ = finder.gradient(found, design.motion.boundary_velocities(names))
    step, ends = 2e-4 * getattr(TWIN, names[0]), []
    for sign in (1, -1):
        design.motion.move(changed(TWIN, {name: getattr(TWIN, name) + sign * step for name in names}))
        ends.append(again(twin))
    design.motion.move(TWIN)
    rate = sum(rates[name] for name in names)
    figure(DIFFERENCES, "derivative of a bifurcation's pressure", (ends[0] - ends[1]) / (2 * step * rate) - 1, 1e-6)


def test_the_material(twin, figure):
    design, finder, _, found = twin
    _, rates = finder.gradient(found, {}, ("c1",))
    ends = []
    for sign in (1, -1):
        design.system.set_material(dataclasses.replace(LAW, c1=LAW.c1 + 5.0 * sign))
        ends.append(again(twin))
    design.system.set_material(LAW)
    figure(DIFFERENCES, "derivative of a bifurcation's pressure", (ends[0] - ends[1]) / (10.0 * rates["c1"]) - 1, 1e-6)


def test_polynomials_through_four_values():
    cubic = Cubic([1.0, 2.0, 4.0, 5.0])
    values = np.array([(x - 3.0) * (x * x + 1.0) for x in (1.0, 2.0, 4.0, 5.0)])
    value, slope = (weights @ values for weights in cubic.weights(2.5))
    assert value == pytest.approx(-0.5 * 7.25) and slope == pytest.approx(7.25 - 0.5 * 5.0)
    assert cubic.root(values, 3.2) == pytest.approx(3.0)
    with pytest.raises(NoConvergence, match="does not change sign"):
        cubic.root(np.ones(4), 3.0)
