"""Thin curved walls on coarse cells against the integral through the wall and against fine meshes; the campaign is
``tests/benchmarks/thin_walls.py``.
"""

from __future__ import annotations

import pytest

import softmodels as sm
from tests.benchmarks.thin_walls import RADIUS, RUBBER, devices, sphere_limit
from tests.support.campaigns import sampled


@pytest.mark.campaign
@pytest.mark.parametrize(("wall", "cell"), sampled([(0.05, 4.0), (0.1, 1.0), (0.2, 2.0), (0.5, 4.0)], 2))
def test_the_limit_pressure_of_a_thin_balloon(wall, cell):
    ((_, balloon),) = devices(sm.Balloon, wall, [cell], radius=RADIUS, neck_radius=0.0)
    assert sm.limit(balloon, RUBBER).pressure == pytest.approx(sphere_limit(wall), rel=2e-4)


def test_a_thin_balloon_on_a_neck():
    """4.7 Pa above it with polygons for a wall."""
    (_, fine), (_, coarse) = devices(sm.Balloon, 0.1, [0.5, 1.0], radius=RADIUS, neck_radius=0.004)
    assert sm.limit(coarse, RUBBER).pressure == pytest.approx(sm.limit(fine, RUBBER).pressure, rel=2e-4)


@pytest.mark.campaign
def test_a_thin_bellows():
    (_, fine), (_, coarse) = devices(sm.Bellows, 0.2, [0.4, 2.0])
    pressures = [sm.Model(device, RUBBER).solve(volume="1 ml").pressure for device in (fine, coarse)]
    assert pressures[1] == pytest.approx(pressures[0], rel=2e-3)


def test_coarse_cells_of_a_thin_wall_are_shortened():
    """Before: refused as needles."""
    ((_, balloon),) = devices(sm.Balloon, 0.05, [4.0])
    ((_, fine),) = devices(sm.Balloon, 0.05, [0.5])
    assert balloon.expected_cells == fine.expected_cells and not fine.remarks
    assert "at most 0.5 mm long instead of 4 mm" in balloon.remarks[0]
