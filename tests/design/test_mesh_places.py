"""Interpolation in meshes of curved cells, by which states are carried to a mesh made anew."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import scipy.spatial

from softmodels.design.states import Places
from softmodels.runs.state_values import EDGES


def mesh(d, bend):
    """Cells of order two of random points in the unit cube, bent smoothly."""
    corners = np.vstack([np.array(list(itertools.product([0.0, 1.0], repeat=d))), np.random.default_rng(d).random((40, d))])
    straight = scipy.spatial.Delaunay(corners).simplices
    nodes, numbers, cells = list(corners), {}, []
    for cell in straight:
        pairs = [tuple(sorted((cell[a], cell[b]))) for a, b in EDGES[d]]
        for pair in pairs:
            if pair not in numbers:
                numbers[pair] = len(nodes)
                nodes.append(0.5 * (corners[pair[0]] + corners[pair[1]]))
        cells.append([*cell, *(numbers[pair] for pair in pairs)])
    return bend(np.array(nodes)), np.array(cells)


def bent(x):
    return x + 0.1 * x[:, ::-1] ** 2


@pytest.mark.parametrize("d", [2, 3])
def test_polynomials_are_met(d):
    """On straight cells a quadratic is interpolated exactly; on curved ones the places themselves are."""
    inside = 0.05 + 0.9 * np.random.default_rng(7).random((200, d))
    nodes, cells = mesh(d, lambda x: x)
    places = Places(nodes, cells, inside)
    assert places.interpolated(nodes**2) == pytest.approx(inside**2, abs=1e-12)
    assert places.interpolated(nodes, linear=True) == pytest.approx(inside, abs=1e-12)
    nodes, cells = mesh(d, bent)
    assert Places(nodes, cells, bent(inside)).interpolated(nodes) == pytest.approx(bent(inside), abs=1e-9)


def test_points_outside_take_the_nearest_cell_s_value():
    nodes, cells = mesh(2, lambda x: x)
    found = Places(nodes, cells, np.array([[0.5, -0.001]])).interpolated(nodes)
    assert found == pytest.approx(np.array([[0.5, 0.0]]), abs=5e-3)
