"""Rigid shapes in pictures: their surfaces, and where they have moved to."""

from __future__ import annotations

import types

import numpy as np
import pytest

import softmodels as sm
from softmodels.components.contact import RigidShape
from softmodels.pictures.offscreen import look, shape_layers, shape_surface, shapes_of, way
from softmodels.runs.store import StoredStates

BALL = RigidShape("sphere", "top", (0.0, 0.001, 0.03), 0.01, guide="0.6, 0, 0.8", spring=50.0, name="ball")
ROD = RigidShape("cylinder", "top", (0.0, 0.0, 0.03), 0.01, name="rod")


@pytest.fixture
def states():
    rows = [{"ball_travel_mm": 0.0}, {"ball_travel_mm": 2.0}, {"ball_travel_mm": 5.0}]
    return types.SimpleNamespace(case=types.SimpleNamespace(components=(BALL, ROD)), rows=rows)


def test_a_shape_is_drawn_where_it_has_given_way(states):
    assert shapes_of(states) == [BALL, ROD]
    np.testing.assert_allclose(way(states, BALL, 2), [0.003, 0.0, 0.004], atol=1e-15)
    np.testing.assert_allclose(way(states, BALL, 1.5), 3.5e-3 * np.array([0.6, 0.0, 0.8]), atol=1e-15)
    np.testing.assert_array_equal(way(states, ROD, 2), np.zeros(3))


def test_surfaces_lie_on_their_shapes():
    ball = shape_surface(BALL, 1.0)
    np.testing.assert_allclose(np.linalg.norm(ball.points - BALL.at, axis=1), 0.01, rtol=1e-6)
    assert ball.is_all_triangles and ball.n_cells > 2000
    points = shape_surface(ROD, 0.05).points
    np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 2] - 0.03), 0.01, rtol=1e-6)
    assert np.abs(points[:, 1]).max() == pytest.approx(0.05)


def test_a_ball_that_is_lifted_stays_in_the_picture(tmp_path):
    ball = sm.RigidShape("sphere", "top", (0.0, 0.0, 0.0265), 0.01, guide="z", spring=20.0, name="ball")
    disk = sm.HollowDisk.variant("shadow", section="axisymmetric", cell_size=0.004)
    sm.inflate(disk, sm.NeoHookean(30e3), "0,40 cm", components=[ball], folder=tmp_path / "disk")
    shown = look(StoredStates(tmp_path / "disk", "disk"))
    steps = [0, shown.states.main]
    camera = shown.camera(steps)
    direction, up = np.array(camera.direction), np.array(camera.up)
    right = np.cross(up, direction) / np.linalg.norm(np.cross(up, direction))
    axes = np.array([right, np.cross(direction, right)])
    half = camera.scale * np.array([camera.size[0] / camera.size[1], 1.0])
    for step in steps:
        (layer,) = shape_layers(shown.states, step)
        placed = (np.asarray(layer[0].points) - camera.focus) @ axes.T
        assert (np.abs(placed) <= half).all()
    assert way(shown.states, ball, steps[-1])[2] > 0.002
