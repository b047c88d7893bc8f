"""A patch of an edge that is more blurred than the rest."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from measurement.outline.edge import Edge
from measurement.series.checks import drop

SCALE = 30e-6


def edge(width, count=600):
    """A half circle of 15 mm with this width in px over the angle."""
    turn = np.linspace(np.pi, 0.0, count)
    normal = np.column_stack([np.cos(turn), -np.sin(turn)])
    noise = np.exp(0.03 * np.random.default_rng(1).standard_normal(count))
    edge = Edge(500.0 * normal, normal, np.full(count, 0.02), width(turn) * noise, np.full(count, 0.8), 0.0)
    return SimpleNamespace(traced=SimpleNamespace(edge=edge, scale=SCALE))


@pytest.mark.parametrize(
    "width",
    [
        lambda turn: np.full(len(turn), 3.0),
        lambda turn: 3.0 * (1.0 + 0.3 * np.cos(turn)),  # one side is out of focus
        lambda turn: np.hypot(3.0, 1.5 * np.cos(turn)),  # an oblong lamp
    ],
)
def test_a_width_that_changes_slowly_is_trusted(width):
    assert next(drop(edge(width)), None) is None


@pytest.mark.parametrize("at", [0.5, 1.0, 1.6])
def test_a_drop_before_a_part_of_the_edge_is_not(at):
    doubt = next(drop(edge(lambda turn: np.where(np.abs(turn - at) < 0.12, 4.0, 3.0))), None)
    assert doubt is not None and "more blurred" in doubt.verdict
