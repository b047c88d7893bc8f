"""A disk whose membrane varies along the radius: a uniform profile is the plain disk, and wedges are the section.

Where meshes are compared the tolerances state the meshes' own error, three times what was measured or more.
"""

from __future__ import annotations

import numpy as np
import pytest

from geometries import HollowDisk
from softmodels.common.units import pascal_per_cm
from softmodels.fitting.outlines.silhouette import Silhouette
from softmodels.materials.laws import NeoHookean
from softmodels.pictures.curves import profile as seen_from_the_side
from softmodels.runs.fields import Fields

SILICONE = NeoHookean(30e3, 0.49)
COLUMNS = (70.0, 177.0)


@pytest.fixture(scope="module")
def inflated(equilibrium, solved):
    """Return a function that gives a disk's rises, added volumes (a row each), equations and last state."""

    def inflate(disk, columns=COLUMNS):
        equations = equilibrium(disk, SILICONE)
        goals = [column * pascal_per_cm() / equations.system.stress_unit for column in columns]
        _, points, end = solved(equations, goals)
        assert end is None
        states = [point.state for point in points if point.requested]
        figures = [Fields(equations).figures(state) for state in states]
        return np.array([(f.rises["apex"], f.added_volume) for f in figures]).T, equations, states[-1]

    return inflate


def test_a_uniform_profile_is_the_plain_disk(inflated):
    """Apart from a vertex on the top the meshes are alike: 1.3e-6 measured with cells of 1 mm."""
    fine = {"section": "axisymmetric", "cell_size": 0.001, "fillet": 0.0, "base_fillet": 0.0}
    plain, uniform = (inflated(HollowDisk(profile=shares, **fine))[0] for shares in ((), (1, 1, 1)))
    assert np.abs(uniform / plain - 1).max() < 1e-5


def test_shares_of_another_thickness_are_the_same_disk(inflated):
    """The same top, written in shares of 6 mm and of 4 mm, has the same mesh."""
    one, two = (
        inflated(HollowDisk(section="axisymmetric", membrane=membrane, profile=shares), COLUMNS[:1])[0]
        for membrane, shares in ((0.006, (1.2, 0.8, 1.0)), (0.004, (1.8, 1.2, 1.5)))
    )
    assert one == pytest.approx(two, rel=1e-8)


def test_a_curved_wedge_matches_the_curved_section(inflated):
    """The apex of a plain wedge of 30 degrees is 0.18 % off its section's."""
    section, wedge = (
        inflated(HollowDisk(profile=(1.4, 0.7, 1.0), **slice_of), COLUMNS[:1])[0]
        for slice_of in ({"section": "axisymmetric"}, {"angle": 30.0})
    )
    assert wedge[0] == pytest.approx(section[0], rel=1e-2)
    assert wedge[1] == pytest.approx(section[1], rel=3e-3)


def test_outlines_begin_at_the_curved_top(inflated):
    """What a camera would see of a curved top: at rest the top itself, then the deformed one, apex first."""
    disk = HollowDisk(section="axisymmetric", profile=(1.4, 0.7, 1.0))
    (rises, _), equations, state = inflated(disk)
    grid = Fields(equations).grid
    u = Fields(equations).nodal(state)["displacement"]
    rest = seen_from_the_side(grid.points, 0.0 * u, disk)
    assert rest[:, 1] == pytest.approx(disk.membrane_top.height(rest[:, 0]), rel=1e-12)
    assert rest[0, 0] == pytest.approx(0.0, abs=1e-12) and rest[-1, 0] == pytest.approx(disk.outer_radius)
    assert len(rest) % 2 == 1
    line = seen_from_the_side(grid.points, u, disk)
    assert line[0, 1] == pytest.approx(disk.probes["apex"][2] + rises[-1], rel=1e-12)
    silhouette = Silhouette(equations.system)
    assert silhouette.top == pytest.approx(disk.probes["apex"], abs=1e-12)
    assert silhouette.curve(state).nodes[0, 0] == pytest.approx([0.0, rises[-1]], abs=1e-12)
