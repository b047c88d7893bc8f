"""The edge of a shadow where the surface dips behind its rim."""

from __future__ import annotations

import numpy as np
import pytest

from softmodels.fitting.outlines.silhouette import shadow_of
from softmodels.runs.grid import QuadraticCurve


def surface(rim, pieces=40):
    """Dome to 10 mm, a trough, and a rim of this height in m at 15 mm; then down."""
    x = np.linspace(0.0, 0.018, 2 * pieces + 1)
    z = 4e-3 * np.exp(-((x / 5e-3) ** 2)) - 3e-4 + (rim + 3e-4) * np.exp(-(((x - 0.015) / 1.5e-3) ** 2))
    places = np.column_stack([x, z])
    return QuadraticCurve(np.stack([places[:-2:2], places[2::2], places[1::2]], axis=1))


def test_nothing_is_hidden_where_nothing_dips():
    curve = surface(-3e-4)
    shadow = shadow_of(curve)
    assert shadow.curve.nodes == pytest.approx(curve.nodes, abs=1e-15)
    rate = np.random.default_rng(0).standard_normal(curve.nodes.shape)
    assert shadow.rate(rate) == pytest.approx(rate, abs=1e-12)


def test_a_trough_behind_the_rim_is_level():
    """Heights of the edge are the largest from there outwards, taken from a fine sampling of the curve itself."""
    curve = surface(2e-4)
    s = np.linspace(-1, 1, 200)
    dense = np.concatenate([curve.at(np.full(len(s), k), s)[0] for k in range(len(curve.nodes))])
    envelope = np.maximum.accumulate(dense[::-1, 1])[::-1]
    assert (envelope - dense[:, 1]).max() > 3e-4
    points = np.column_stack([dense[:, 0], envelope])[::7]
    assert np.abs(shadow_of(curve).curve.closest(points).distance).max() < 3e-6
    assert np.abs(curve.closest(points).distance).max() > 1e-4


def test_the_edge_runs_on_from_piece_to_piece():
    """Where a trough is bridged too, to the distance of the places at which heights are compared."""
    nodes = shadow_of(surface(2e-4)).curve.nodes
    ends = np.linalg.norm(nodes[1:, 0] - nodes[:-1, 1], axis=1)
    assert ends.max() < 5e-6 and nodes[0, 0] == pytest.approx([0.0, 3.7e-3])
    assert (nodes[1:, 0, 0] > nodes[:-1, 0, 0]).all()


def test_the_level_part_moves_with_the_rim():
    curve, higher = surface(2e-4), surface(2.01e-4)
    rate = (higher.nodes - curve.nodes) / 1e-6
    points = np.array([[0.011, 2.2e-4], [0.012, 1.9e-4], [0.013, 2.5e-4]])
    shadow = shadow_of(curve)
    closest = shadow.curve.closest(points)
    moved = shadow_of(higher).curve.closest(points).distance - closest.distance
    top = 2e-4 + 4e-3 * np.exp(-9.0)  # the dome still adds a little at the rim
    assert closest.distance == pytest.approx(points[:, 1] - top, abs=1e-7)  # the elements are not the function
    assert closest.moved(shadow.rate(rate)) * 1e-6 == pytest.approx(moved, rel=1e-3)
    assert moved == pytest.approx(-1e-6, rel=0.01)
