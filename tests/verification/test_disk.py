"""The hollow disk: wedges against each other and against the axisymmetric section, which knows nothing of cut planes.

Where meshes are compared the tolerances state the meshes' own error, well below what a measurement resolves (0.1 mm of
3.9 mm): 0.1 to 0.2 % at the default cell size.
"""

from __future__ import annotations

import types

import numpy as np
import pytest

from geometries import HollowDisk
from softmodels.common.units import COLUMN
from softmodels.fitting.outlines.shapes import Silhouette
from softmodels.materials.laws import NeoHookean
from softmodels.pictures.curves import profile as seen_from_the_side
from softmodels.runs.fields import Fields
from tests.support.campaigns import sampled

COLUMNS = (70.0, 130.0, 177.0)
CM = COLUMN.pascal
SILICONE = NeoHookean(30e3, 0.49)


@pytest.fixture(scope="module")
def inflated(equilibrium, solved):
    """Return a function that inflates a disk to heights of a column in cm and gives apex rises and added volumes."""
    known = {}

    def inflate(disk, columns=COLUMNS, law=SILICONE, formulation="mixed", **options):
        key = (disk, columns, law, formulation, *options.items())
        if key not in known:
            equations = equilibrium(disk, law, formulation)
            goals = [column * CM / equations.system.stress_unit for column in columns]
            _, points, end = solved(equations, goals, **options)
            assert end is None
            fields, states = Fields(equations), [point.state for point in points if point.requested]
            figures = [fields.figures(state) for state in states]
            known[key] = types.SimpleNamespace(
                apex=np.array([f.rises["apex"] for f in figures]),
                volume=np.array([f.added_volume for f in figures]),
                nodal=fields.nodal(states[-1]),
                grid=fields.grid,
                count=len(points),
            )
        return known[key]

    return inflate


@pytest.fixture(scope="module")
def section(inflated):
    return inflated(HollowDisk(section="axisymmetric"))


@pytest.fixture(scope="module")
def fine(inflated):
    """A section with cells of 0.4 mm, its own error below 0.01 %."""
    return inflated(HollowDisk(section="axisymmetric", cell_size=0.0004))


@pytest.fixture(scope="module")
def wedge(inflated):
    return inflated(HollowDisk())


@pytest.mark.campaign
def test_wedge_matches_the_section(wedge, section, figure):
    against = "axisymmetric section, default cells, 70, 130 and 177 cm"
    figure(against, "wedge's apex", wedge.apex / section.apex - 1, 2.5e-3)
    figure(against, "wedge's added volume", wedge.volume / section.volume - 1, 2e-3)


@pytest.mark.campaign
def test_default_cells_are_fine_enough(wedge, section, fine, figure):
    against = "a section with cells of 0.4 mm"
    for name, coarse in (("wedge", wedge), ("section", section)):
        figure(against, f"default {name}'s apex at 177 cm", coarse.apex[-1] / fine.apex[-1] - 1, 1.8e-3)
        figure(against, f"default {name}'s added volume", coarse.volume / fine.volume - 1, 2e-3)


def test_section_converges(section, fine, inflated):
    """The added volume at given pressures grows towards its limit as the cells shrink: the coarse ones are too stiff."""
    finer = inflated(HollowDisk(section="axisymmetric", cell_size=0.00075))
    assert (section.volume < finer.volume).all() and (finer.volume < fine.volume).all()
    assert (fine.volume - finer.volume < 0.5 * (fine.volume - section.volume)).all()


@pytest.mark.campaign
def test_wedge_converges_to_the_section(inflated):
    """A narrow wedge with a round root, so that the cell size and not the fillet sets the mesh."""
    shape = {"fillet": 0.002, "cavity_height": 0.0045}
    exact = inflated(HollowDisk(section="axisymmetric", cell_size=0.0005, **shape), (177.0,))
    coarse, finer = (inflated(HollowDisk(angle=15.0, cell_size=size, **shape), (177.0,)) for size in (0.006, 0.0015))
    for quantity in ("apex", "volume"):
        errors = [abs(getattr(mesh, quantity)[0] / getattr(exact, quantity)[0] - 1) for mesh in (coarse, finer)]
        assert errors[1] < 0.7 * errors[0], (quantity, errors)
        assert errors[0] < 3e-3


@pytest.mark.parametrize(("angle", "azimuth"), sampled([(30.0, 0.0), (45.0, 20.0), (90.0, 0.0)]))
def test_every_wedge_is_the_same_disk(angle, azimuth, inflated, section, figure):
    """Other angles and azimuths are other tetrahedra: 0.2 % in the apex, 0.1 % in the volume."""
    other = inflated(HollowDisk(angle=angle, azimuth=azimuth), (70.0,))
    against = "axisymmetric section at 70 cm"
    figure(against, "apex of wedges of 30, 45 (turned by 20) and 90 degrees", other.apex / section.apex[:1] - 1, 2e-3)
    figure(against, "added volume of the same wedges", other.volume / section.volume[:1] - 1, 1e-3)


@pytest.mark.campaign
@pytest.mark.parametrize("azimuth", sampled([0.0, 20.0]))
def test_slip_on_cut_planes_is_exact(azimuth, inflated, wedge, figure):
    """No displacement across a plane at any of its nodes, and the apex, which is on both, goes straight up."""
    disk = HollowDisk(azimuth=azimuth)
    result = wedge if azimuth == 0.0 else inflated(disk, (70.0,))
    points, u = result.grid.points, result.nodal["displacement"]
    for plane in disk.cut_planes:
        on_plane = np.abs(points @ np.array(plane.normal)) < 1e-9
        assert on_plane.sum() > 100
        figure("slip on oblique cut planes", "normal displacement over size", u[on_plane] @ plane.normal / disk.size, 1e-12)
    apex = int(np.argmin(np.linalg.norm(points - np.array(disk.probes["apex"]), axis=1)))
    assert np.abs(u[apex, :2]).max() < 1e-12 * disk.size
    assert u[apex, 2] == pytest.approx(result.apex[-1], rel=1e-12)


def test_steps_do_not_change_the_answer(inflated, section, figure):
    small = inflated(HollowDisk(section="axisymmetric"), largest_step=0.02)
    assert small.count > 2 * section.count
    against = "the default path of the disk"
    figure(against, "apex, short steps", small.apex / section.apex - 1, 2e-10)
    figure(against, "added volume, short steps", small.volume / section.volume - 1, 2e-10)


@pytest.mark.parametrize("control", ["pressure", "volume", "arc-length"])
def test_controls_do_not_change_the_answer(control, inflated, section, figure):
    other = inflated(HollowDisk(section="axisymmetric"), control=control)
    against = "the default path of the disk"
    figure(against, "apex, other controls", other.apex / section.apex - 1, 3e-10)
    figure(against, "added volume, other controls", other.volume / section.volume - 1, 6e-10)


@pytest.mark.campaign
def test_formulations_agree_where_both_may_be_used(inflated, figure):
    """At Poisson's ratio 0.3 displacements alone do not lock: the difference is the mesh's, and goes with it."""
    law, apart = NeoHookean(30e3, 0.3), []
    for size in (0.003, 0.0007):
        disk = HollowDisk(section="axisymmetric", cell_size=size)
        mixed, plain = (inflated(disk, (130.0,), law, formulation).apex[0] for formulation in ("mixed", "displacement"))
        apart.append(abs(plain / mixed - 1))
    figure("displacements and pressure as unknowns, Poisson's ratio 0.3", "apex by displacements alone", apart[0], 1.9e-4)
    assert apart[1] < 0.5 * apart[0]


# -- A disk whose membrane varies along the radius: a uniform profile is the plain disk, and wedges are the section --


THIN_COLUMNS = (70.0, 177.0)


@pytest.fixture(scope="module")
def thin_inflated(equilibrium, solved):
    """Return a function that gives a disk's rises, added volumes (a row each), equations and last state."""

    def inflate(disk, columns=THIN_COLUMNS):
        equations = equilibrium(disk, SILICONE)
        goals = [column * COLUMN.pascal / equations.system.stress_unit for column in columns]
        _, points, end = solved(equations, goals)
        assert end is None
        states = [point.state for point in points if point.requested]
        figures = [Fields(equations).figures(state) for state in states]
        return np.array([(f.rises["apex"], f.added_volume) for f in figures]).T, equations, states[-1]

    return inflate


@pytest.mark.campaign
def test_a_uniform_profile_is_the_plain_disk(thin_inflated):
    """Apart from a vertex on the top the meshes are alike: 1.3e-6 measured with cells of 1 mm."""
    fine = {"section": "axisymmetric", "cell_size": 0.001, "fillet": 0.0, "base_fillet": 0.0}
    plain, uniform = (thin_inflated(HollowDisk(profile=shares, **fine))[0] for shares in ((), (1, 1, 1)))
    assert np.abs(uniform / plain - 1).max() < 1e-5


def test_shares_of_another_thickness_are_the_same_disk(thin_inflated):
    """The same top, written in shares of 6 mm and of 4 mm, has the same mesh."""
    one, two = (
        thin_inflated(HollowDisk(section="axisymmetric", membrane=membrane, profile=shares), THIN_COLUMNS[:1])[0]
        for membrane, shares in ((0.006, (1.2, 0.8, 1.0)), (0.004, (1.8, 1.2, 1.5)))
    )
    assert one == pytest.approx(two, rel=1e-8)


@pytest.mark.campaign
def test_a_curved_wedge_matches_the_curved_section(thin_inflated):
    """The apex of a plain wedge of 30 degrees is 0.18 % off its section's."""
    section, wedge = (
        thin_inflated(HollowDisk(profile=(1.4, 0.7, 1.0), **slice_of), THIN_COLUMNS[:1])[0]
        for slice_of in ({"section": "axisymmetric"}, {"angle": 30.0})
    )
    assert wedge[0] == pytest.approx(section[0], rel=1e-2)
    assert wedge[1] == pytest.approx(section[1], rel=3e-3)


def test_outlines_begin_at_the_curved_top(thin_inflated):
    """What a camera would see of a curved top: at rest the top itself, then the deformed one, apex first."""
    disk = HollowDisk(section="axisymmetric", profile=(1.4, 0.7, 1.0))
    (rises, _), equations, state = thin_inflated(disk)
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
