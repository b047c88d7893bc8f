"""What hangs together, against SciPy's connected components."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from geometries.actuator import joined, joined_by


@pytest.mark.parametrize("share", [0.0, 0.2, 0.45, 0.55, 1.0, 3.0])
def test_groups_are_those_of_another_library(share):
    chance, count = np.random.default_rng(7), 400
    pairs = chance.integers(0, count, (int(share * count), 2))
    graph = scipy.sparse.coo_matrix((np.ones(len(pairs)), pairs.T), shape=(count, count))
    assert (joined(pairs, count) == scipy.sparse.csgraph.connected_components(graph, directed=False)[1]).all()


def test_a_long_chain_is_one_group():
    links = np.random.default_rng(7).permutation(np.column_stack([np.arange(999), np.arange(1, 1000)]))
    assert (joined(links, 1001) == np.r_[np.zeros(1000), 1]).all()


def test_rows_that_share_a_value_are_one_group():
    assert list(joined_by(np.array([[7, 3], [9, 1], [3, 20], [5, 5], [20, 8], [1, 2]]))) == [0, 1, 0, 2, 0, 1]
    assert len(joined_by(np.empty((0, 2), dtype=np.int64))) == 0
