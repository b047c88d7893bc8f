"""What has a least width in a seminar actuator: names, values against the plan, and that the checks ask for nothing else."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geometries import GeometryError, SeminarActuator
from geometries.actuator import changed, parameter
from geometries.seminar import check_seminar, half_fan

SLABS = {
    "common": SeminarActuator(),
    "even": SeminarActuator(channels=4, spread=90.0, fillet=0.0, offset=0.0012),
    "own": SeminarActuator(
        channels=3,
        bores=(0.0007, 0.0006),
        middle_bores=(0.0011, 0.0008),
        end_bores=(0.0006, 0.0012),
        angles=(0.0, 35.0),
        reaches=(0.040, 0.028),
    ),
}


def test_walls_are_those_of_the_plan():
    found = SLABS["common"].clearances
    assert found["solid between the manifold and the bottom"] == pytest.approx(0.0021)
    assert found["solid between the channels at the end and the top"] == pytest.approx(0.0040)
    assert found["solid between the channels' ends and the side"] == 0.004
    assert found["width of the channels at the manifold"] == pytest.approx(0.0014)
    gap = 2 * 0.0129 * math.sin(math.radians(12.5)) - sum(k.radius(0.0129) for k in half_fan(SLABS["common"])[:2])
    assert found["solid between channels 1 and 2 at the manifold"] == pytest.approx(gap)
    assert found["least_wall and room for the channels in the manifold's bore"] == pytest.approx(0.0005 + 0.00011)
    own = SLABS["own"].clearances
    assert own["solid between channel 1 half way and the bottom"] == pytest.approx(0.0019)
    assert own["width of channel 2 at the end"] == pytest.approx(0.0024)
    assert "solid between channels 1 and 1 at the manifold" in SLABS["even"].clearances
    assert min(own.values()) >= 0.0005 and min(found.values()) >= 0.0005


@pytest.mark.parametrize("name", SLABS)
def test_the_check_passes_where_clearances_are_kept(name, monkeypatch):
    """Hundreds of devices, sound and not, with sizes of all kinds: what has its clearances is never refused."""
    slab, random = SLABS[name], np.random.default_rng(3)
    monkeypatch.setattr(SeminarActuator, "check", lambda self: None)
    kept = refused = 0
    for _ in range(600):
        by = random.choice([0.1, 0.3, 0.6])
        values = {key: parameter(slab, key) * math.exp(by * random.normal()) for key in slab.movable}
        try:
            other = changed(slab, values)
            good = None not in half_fan(other) and min(other.clearances.values()) >= other.least_wall
        except (GeometryError, ValueError):  # a fan wider than the base, a tip wider than the slab
            continue
        if good:
            check_seminar(other)
            kept += 1
        else:
            try:
                check_seminar(other)
            except GeometryError:
                refused += 1
    assert kept > 15 and refused > 50


@pytest.mark.parametrize("name", SLABS)
def test_clearances_are_smooth(name):
    slab = SLABS[name]
    for key in slab.movable:
        wide, less, fine = (_slopes(slab, key, step) for step in (4e-3, 2e-3, 1e-6))
        size = np.abs(fine).max() + 1e-12
        assert np.abs(less - fine).max() < 0.3 * np.abs(wide - fine).max() + 1e-6 * size, key


def _slopes(slab, key, step):
    value = parameter(slab, key)
    one, other = (changed(slab, {key: value * (1 + sign * step)}).clearances for sign in (1, -1))
    assert one.keys() == slab.clearances.keys()
    return (np.array([*one.values()]) - [*other.values()]) / (2 * step)
