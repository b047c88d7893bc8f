"""The model without files: equilibria, paths and modes of a balloon, against the closed integral of a thick sphere."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize_scalar

import softmodels as sm
from softmodels.materials.specimens import sphere_pressure

LAW = sm.NeoHookean(30e3, 0.5)
BALLOON = sm.Balloon(neck_radius=0.0)
SPHERE = "closed integral of a thick incompressible sphere, wall over radius 1/15"


def exact(stretch):
    """Pressure in Pa where the inner stretch, of a sphere of the cavity's volume, is this."""
    return float(sphere_pressure(LAW, BALLOON.radius, BALLOON.radius + BALLOON.wall, np.array([stretch]))[0])


def taken(stretch):
    """Volume in m3 that the cavity has taken then."""
    return 4 / 3 * math.pi * BALLOON.radius**3 * (stretch**3 - 1)


def _middle(points):
    return np.array([0.0, 0.0, 0.5 * (points[:, 2].min() + points[:, 2].max())])


@pytest.fixture(scope="module")
def model():
    return sm.Model(BALLOON, LAW)


def test_pressure_volume_and_energy_of_a_sphere(model, figure):
    by_pressure, by_volume = model.solve(pressure=exact(1.2)), model.solve(volume=taken(1.6))
    figure(SPHERE, "volume at a pressure, of a model", by_pressure.volume / taken(1.2) - 1, 1e-4)
    figure(SPHERE, "pressure at a volume, of a model", by_volume.pressure / exact(1.6) - 1, 5e-6)
    work = quad(lambda stretch: exact(stretch) * 4 * math.pi * BALLOON.radius**3 * stretch**2, 1.0, 1.6)[0]
    figure("work on a thick incompressible sphere", "energy of a model", by_volume.energy / work - 1, 1e-4)
    assert by_volume.displacement.shape == by_volume.points.shape
    # Points of the inner surface stay on a sphere, whose radius has grown by the stretch.
    rest, moved = by_volume.points, by_volume.points + by_volume.displacement
    inner = np.isclose(np.linalg.norm(rest - _middle(rest), axis=1), BALLOON.radius, rtol=1e-3)
    now = np.linalg.norm(moved[inner] - _middle(moved[inner]), axis=1)
    assert inner.sum() > 10
    figure(SPHERE, "inner radius at a volume, of a model", now / (1.6 * BALLOON.radius) - 1, 1e-4)
    assert by_volume.largest_stretch == pytest.approx(1.6, rel=0.02)
    assert repr(by_pressure).startswith("<Equilibrium of balloon at ")


def test_a_path_has_its_limit_point(model, figure):
    found = list(model.path(volumes=[taken(2.0)]))
    assert found[0].pressure == 0.0 and found[-1].requested and not found[-1].stable
    (limit,) = (state for state in found if state.limit)
    best = minimize_scalar(lambda stretch: -exact(stretch), bounds=(1.1, 2.0), method="bounded")
    figure(SPHERE, "limit pressure, of a model", limit.pressure / -best.fun - 1, 1e-5)
    with pytest.raises(sm.RunError, match="the path ends before the last requested pressure: the pressure has a limit"):
        model.solve(pressure=-1.1 * best.fun)


def test_modes_tell_stability(model):
    rest, beyond = model.modes(), model.modes(model.solve(volume=taken(2.0)), 3)
    assert all(mode.eigenvalue > 0.0 for mode in rest) and beyond[0].eigenvalue < 0.0 < beyond[1].eigenvalue
    assert np.abs(beyond[0].displacement).max() == 1.0
    assert beyond[0].displacement.shape == model.solve().points.shape
    assert [mode.eigenvalue for mode in rest] == sorted(mode.eigenvalue for mode in rest)


def test_modes_are_of_the_models_own_states(model):
    """The state of another device has as many unknowns by chance at most: it is refused before anything is computed."""
    other = sm.Model(sm.Balloon(neck_radius=0.0, wall=2e-3), LAW)
    with pytest.raises(sm.CaseError, match="equilibrium is a state of another model; solve it with this one"):
        model.modes(other.solve())
    with pytest.raises(sm.ArgumentError, match="equilibrium is 3; it must be a state that this model has solved"):
        model.modes(3)
    with pytest.raises(sm.ArgumentError, match="count is 0; it must be a whole number from 1 up"):
        model.modes(count=0)


def test_a_heavy_device_begins_where_it_hangs():
    disk = sm.HollowDisk(section="axisymmetric", cell_size=6e-3, refinement=1.0)
    light, heavy = (sm.Model(disk, "ecoflex-00-10", components) for components in ((), sm.Gravity("-z")))
    assert light.solve().rises["apex"] == 0.0 > heavy.solve().rises["apex"]
    assert heavy.solve(pressure="20 cm").rises["apex"] < light.solve(pressure="20 cm").rises["apex"]


@pytest.mark.parametrize("asked", [{}, {"pressures": "0:1 kPa", "volumes": "0:1 ml"}])
def test_one_quantity_is_asked_for(model, asked):
    with pytest.raises(sm.CaseError, match="one of them"):
        model.path(**asked)
