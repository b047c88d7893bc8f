"""Rigid shapes from STL files: Taylor tests, a ball of triangles against the ball itself, a box against a plane, refusals."""

from __future__ import annotations

import dataclasses
import shutil

import numpy as np
import pytest

import softmodels as sm
from softmodels.case.load import steps_of
from softmodels.common.errors import FieldError
from softmodels.components.pressing import FixedWall, Penalty, PressedOn, Surface
from softmodels.components.shapes import winding
from softmodels.materials.laws import NeoHookean
from softmodels.mechanics.component import ComponentError
from tests.support import stl_files
from tests.support.campaigns import sampled

LAW = NeoHookean(30e3, 0.45)
DISK = sm.HollowDisk(cell_size=0.006, angle=30, fillet=0.0, base_fillet=0.0)
RADIUS, AT = 0.010, (0.0, 0.0, 0.0265)


def _patch():
    """Eight facets that bulge into the top of a ball of radius 1."""
    x, y = (axis.ravel() for axis in np.meshgrid(*2 * [np.linspace(-0.2, 0.2, 5)], indexing="ij"))
    nodes, at = np.column_stack([x, y, 0.985 - 0.3 * (x**2 + y**2)]), np.arange(25).reshape(5, 5)
    facets = []
    for i in (0, 2):
        for j in (0, 2):
            a, b, c, d = at[i, j], at[i + 2, j], at[i + 2, j + 2], at[i, j + 2]
            ab, bc, cd, da, ac = at[i + 1, j], at[i + 2, j + 1], at[i + 1, j + 2], at[i, j + 1], at[i + 1, j + 1]
            facets += [[a, b, c, bc, ac, ab], [a, c, d, cd, da, ac]]
    facets = np.array(facets)
    return Surface(nodes, facets, np.zeros(len(facets), int), nodes[facets[:, :3]].mean(axis=1) + np.array([0, 0, 0.1]))


def test_forces_and_stiffness_are_derivatives():
    surface, wall, penalty = _patch(), FixedWall.of(*stl_files.ball(1.0), 0.15), Penalty(300.0, 1e-3)
    here = PressedOn(surface, wall, penalty, surface.nodes)
    assert here.touching.all()
    way = np.random.default_rng(1).normal(size=surface.nodes.shape)
    errors = []
    for h in (1e-4, 5e-5):
        after, before = (PressedOn(surface, wall, penalty, surface.nodes + sign * h * way) for sign in (1, -1))
        rate, curve = (after.energy - before.energy) / (2 * h), (after.forces - before.forces).ravel() / (2 * h)
        product = here.stiffness @ way.ravel()
        slope = float((here.forces * way).sum())
        errors.append((abs(rate / slope - 1), np.abs(curve - product).max() / np.abs(product).max()))
    assert max(errors[1]) < 1e-5
    assert (np.array(errors[0]) / errors[1]).min() > 2.5  # of second order but for where the onset ends


def test_the_gap_is_exact_on_a_flat_wall_and_known_on_a_ball():
    wall = FixedWall.of(*stl_files.box((-1, -1, -1), (1, 1, 0)), 0.3)
    places = np.array([[0.1, 0.2, 0.05], [-0.3, 0.1, -0.05]])
    np.testing.assert_allclose(wall.gaps(places), places[:, 2], atol=1e-12)
    points, triangles = stl_files.ball(1.0, 96, 48)
    wall = FixedWall.of(points, triangles, 0.15)
    inscribed = 1 - np.linalg.norm(points[triangles].mean(axis=1), axis=1).mean()
    assert wall.gaps(np.array([[0.6, 0.0, 0.8]]))[0] == pytest.approx(inscribed - 0.1 * 0.15**2, abs=5e-4)
    inside = winding(np.array([[0.0, 0.1, 0.2], [0.0, 0.0, 1.2]]), points[triangles])
    np.testing.assert_allclose(inside, [1.0, 0.0], atol=1e-12)


@pytest.mark.campaign
def test_a_ball_of_triangles_stops_the_disk_as_the_ball_does(tmp_path):
    file = stl_files.write_stl(tmp_path / "ball.stl", *stl_files.ball(RADIUS, 96, 48))
    components = [
        sm.RigidShape("sphere", "top", AT, RADIUS, name="ball"),
        sm.RigidShape("stl", "top", AT, file=str(file), rounding=0.0012, name="ball"),
    ]
    true, found = (sm.inflate(DISK, LAW, "0,40 cm", components=[part]).path for part in components)
    for column, bound in (("ball_force_z_N", 0.03), ("apex_mm", 0.03)):
        assert found[column][-1] == pytest.approx(true[column][-1], rel=bound)
    assert found["ball_depth_mm"][-1] == pytest.approx(true["ball_depth_mm"][-1], abs=0.015)
    assert found["ball_force_x_N"][-1] == pytest.approx(0.0, abs=1e-12)


CEILING = 0.0168
EIGHTH = sm.HollowDisk(cell_size=0.006, angle=45, fillet=0.0, base_fillet=0.0)


@pytest.fixture(scope="module")
def plane():
    """The disk under a plane."""
    return sm.inflate(EIGHTH, LAW, "0,40 cm", components=[sm.Obstacle("top", f"z = {CEILING * 1e3} mm")])


@pytest.mark.campaign
@pytest.mark.parametrize("hollow", sampled([False, True]))
def test_a_side_of_a_box_is_a_plane(hollow, plane, tmp_path):
    low, high = ((-0.06, -0.06, CEILING), (0.06, 0.06, 0.03)) if not hollow else ((-0.06, -0.06, -0.03), (0.06, 0.06, CEILING))
    file = stl_files.write_stl(tmp_path / "box.stl", *stl_files.box(low, high))
    lid = sm.RigidShape("stl", "top", (0.0, 0.0, 0.0), file=str(file), hollow=hollow, rounding=0.002, name="lid")
    run = sm.inflate(EIGHTH, LAW, "0,40 cm", components=[lid])
    assert run.added_volume[-1] == pytest.approx(plane.added_volume[-1], rel=3e-3)
    pushed = run.path["lid_force_z_N"][-1]
    assert pushed > 0.0 and pushed == pytest.approx(plane.path["contact_force_N"][-1], rel=0.02)


def test_what_cannot_be_meant_is_refused(tmp_path):
    file = str(stl_files.write_stl(tmp_path / "ball.stl", *stl_files.ball(RADIUS)))
    points, triangles = stl_files.ball(RADIUS)
    broken = str(stl_files.write_stl(tmp_path / "open.stl", points, triangles[1:]))

    def refused(match, device=DISK, **fields):
        with pytest.raises((ComponentError, FieldError, sm.CaseError), match=match):
            sm.inflate(device, LAW, "0,5 cm", components=[sm.RigidShape("stl", "top", **{"at": AT, "file": file, **fields})])

    refused("needs its file", file="")
    refused("leave out radius", radius=0.01)
    refused("cannot be read", file=str(tmp_path / "none.stl"))
    refused("not watertight", file=broken)
    refused("not mirror-symmetric", at=(0.001, 0.0, 0.0265))
    refused("needs an axisymmetric shape", device=sm.HollowDisk(section="axisymmetric"))
    refused("the undeformed device is in the shape", at=(0.0, 0.0, 0.012))
    refused("larger rounding", rounding=1e-5)
    with pytest.raises(ComponentError, match="no file"):
        sm.RigidShape("sphere", "top", AT, RADIUS, file=file)


def test_a_turned_triangle_is_turned_back(tmp_path):
    points, triangles = stl_files.ball(RADIUS)
    turned = np.concatenate([triangles[:1, ::-1], triangles[1:]])
    files = stl_files.write_stl(tmp_path / "a.stl", points, triangles), stl_files.write_stl(tmp_path / "b.stl", points, turned)
    runs = [
        sm.inflate(DISK, LAW, "0,5 cm", components=[sm.RigidShape("stl", "top", AT, file=str(file))]).added_volume[-1]
        for file in files
    ]
    assert runs[1] == pytest.approx(runs[0], rel=1e-9)


def test_the_file_counts_by_its_content(tmp_path):
    from softmodels.case.case import identity

    file = stl_files.write_stl(tmp_path / "ball.stl", *stl_files.ball(RADIUS))
    case = sm.Case(
        "disk",
        DISK,
        LAW,
        steps=steps_of(pressure_cm=(5.0,)),
        components=(sm.RigidShape("stl", "top", AT, file=str(file), name="ball"),),
    )
    before = identity(case)
    elsewhere = dataclasses.replace(case.components[0], file=str(shutil.copy(file, tmp_path / "other.stl")))
    assert identity(dataclasses.replace(case, components=(elsewhere,))) == before
    stl_files.write_stl(file, *stl_files.ball(0.9 * RADIUS))
    assert identity(case) != before
