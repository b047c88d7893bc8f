"""A second lamp beside the first: one flank of the shadow is less deep than the other, which one lamp does not make."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from measurement.outline.edge import Edge
from measurement.outline.profiles import ShadowColour
from measurement.series.checks import one_lamp

COLOUR = ShadowColour(np.full(3, 0.1), np.full(3, 0.8), np.eye(3) * 1e-4)
WHOLE = 1.0 / float(COLOUR.direction @ COLOUR.lit)


def edge(part, seed=0):
    noise = np.random.default_rng(seed).normal(0.0, 0.01, len(part))
    one = np.ones(len(part))
    edge = Edge(np.zeros((len(part), 2)), np.zeros((len(part), 2)), one, one, WHOLE * (part + noise), 0.0)
    return SimpleNamespace(traced=SimpleNamespace(edge=edge, coarse=SimpleNamespace(colour=COLOUR)))


def test_one_lamp_and_some_dust_are_no_second_lamp():
    part = np.ones(400)
    part[100:104] = 0.6
    assert next(one_lamp(edge(part)), None) is None
    assert next(one_lamp(edge(np.linspace(0.98, 1.02, 400))), None) is None


@pytest.mark.parametrize("share", [0.15, 0.3])
def test_a_flank_that_a_second_lamp_reaches_is_doubted(share):
    part = np.where(np.arange(400) < 150, 1.0 - share, 1.0)
    assert "a second lamp" in next(one_lamp(edge(part)), None).verdict


def test_an_edge_of_half_a_lamp_is_refused():
    doubt = next(one_lamp(edge(np.full(400, 0.5))), None)
    assert doubt.rejects and "second lamp" in doubt.verdict
