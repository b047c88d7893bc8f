"""Distances from curves of quadratic pieces: against circles, brute force and moved nodes."""

from __future__ import annotations

import numpy as np
import pytest

from softmodels.runs.grid import QuadraticCurve


def arc(pieces, radius=1.0):
    """A quarter circle from the top to the right."""
    angle = np.linspace(0.0, np.pi / 2, 2 * pieces + 1)
    places = radius * np.column_stack([np.sin(angle), np.cos(angle)])
    return QuadraticCurve(np.stack([places[:-2:2], places[2::2], places[1::2]], axis=1))


def wavy(pieces=12, seed=3):
    """A curve with uneven pieces, joints that are not smooth and middle nodes off the middle."""
    rng = np.random.default_rng(seed)
    x = np.sort(np.r_[0.0, rng.uniform(0.02, 2.98, 2 * pieces - 1), 3.0])
    places = np.column_stack([x, np.sin(2 * x) + 0.01 * rng.standard_normal(len(x))])
    ends, middles = places[::2], (places[:-2:2] + places[2::2]) / 2
    middles = middles + 0.02 * rng.standard_normal(middles.shape)
    return QuadraticCurve(np.stack([ends[:-1], ends[1:], middles], axis=1))


def test_distance_from_a_circle_converges():
    """The largest error of a quadratic through an arc falls with the fourth power of its length."""
    rng = np.random.default_rng(1)
    angle, radius = rng.uniform(0.05, 1.5, 400), rng.uniform(0.7, 1.3, 400)
    points = radius[:, None] * np.column_stack([np.sin(angle), np.cos(angle)])
    errors = [np.abs(arc(n).closest(points).distance - (radius - 1.0)).max() for n in (2, 4, 8, 16)]
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(4.0, abs=0.3)
    assert errors[-1] < 1e-6


def test_distance_is_the_least_of_all_places():
    curve = wavy()
    points = np.random.default_rng(2).uniform([-0.3, -1.5], [3.3, 1.5], (500, 2))
    found = curve.closest(points)
    s = np.linspace(-1, 1, 4001)
    places = np.concatenate([curve.at(np.full(len(s), i), s)[0] for i in range(len(curve.nodes))])
    least = np.array([np.sqrt(((places - point) ** 2).sum(-1).min()) for point in points])
    assert np.abs(found.distance) == pytest.approx(least, abs=2e-6)
    assert (np.abs(found.distance) < least + 1e-12).all()


def test_points_above_are_on_the_left():
    curve = wavy()
    x = np.linspace(0.2, 2.8, 50)
    low, high = (curve.closest(np.column_stack([x, np.sin(2 * x) + step])).distance for step in (-0.3, 0.3))
    assert (low < 0.0).all() and (high > 0.0).all()


def test_distance_follows_nodes_and_points():
    """Central differences of the distance, away from joints, against the envelope theorem."""
    curve, rng = wavy(), np.random.default_rng(4)
    points = np.column_stack([np.linspace(0.1, 2.9, 200), np.sin(2 * np.linspace(0.1, 2.9, 200))])
    points += 0.05 * rng.standard_normal(points.shape)
    rate, shift = rng.standard_normal(curve.nodes.shape), rng.standard_normal(points.shape)
    found = curve.closest(points)
    h = 1e-6

    def both(step):
        return QuadraticCurve(curve.nodes + step * rate).closest(points + step * shift)

    ahead, behind = both(h), both(-h)
    smooth = (ahead.piece == found.piece) & (behind.piece == found.piece)
    assert smooth.mean() > 0.9
    slope = (ahead.distance - behind.distance)[smooth] / (2 * h)
    expected = (found.moved(rate) + (found.normal * shift).sum(-1))[smooth]
    assert slope == pytest.approx(expected, abs=1e-5 * np.abs(expected).max())


def test_a_point_beyond_the_end_is_as_far_as_the_end():
    curve = arc(4)
    assert abs(curve.closest(np.array([[1.3, -0.4]])).distance[0]) == pytest.approx(0.5, abs=1e-12)
