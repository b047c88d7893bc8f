"""Contact of two bodies: derivatives, the patch test, Hertz' spheres, balance of forces and work, Coulomb's ratio, ranks."""

from __future__ import annotations

import math

import numpy as np
import pytest

import softmodels as sm
from geometries import meshing
from softmodels.case.load import steps_of
from softmodels.common.lazy import gmsh
from softmodels.components import pressing, touching
from tests.support import bodies, runs
from tests.support.on_ranks import touching as on_touching
from tests.support.ranks import figures_on


def sheet(height, count, up, bend=0.0, shift=0.0):
    """A square of triangles of second order, bent, whose solid is below (``up``) or above it."""
    step = 1 / (2 * count)
    grid = np.array([[i * step + shift, j * step, 0.0] for i in range(2 * count + 1) for j in range(2 * count + 1)])
    at = np.arange(len(grid)).reshape(2 * count + 1, -1)
    grid[:, 2] = height + bend * ((grid[:, 0] - 0.5) ** 2 + grid[:, 1] ** 2 / 2)
    facets = []
    for i in range(0, 2 * count, 2):
        for j in range(0, 2 * count, 2):
            a, b, c, d = at[i, j], at[i + 2, j], at[i, j + 2], at[i + 2, j + 2]
            middle = at[i + 1, j + 1]
            facets += [[a, b, c, middle, at[i, j + 1], at[i + 1, j]], [d, b, c, middle, at[i + 1, j + 2], at[i + 2, j + 1]]]
    facets = np.array(facets)
    inside = grid[facets[:, :3]].mean(axis=1) - [0, 0, 0.1 if up else -0.1]
    return grid, facets, inside


def two_sheets(gap, counts=(2, 3), bend=0.3, shift=0.0):
    below, above = sheet(0.0, counts[0], True, bend), sheet(gap, counts[1], False, bend / 2, shift)
    nodes = np.concatenate([below[0], above[0]])
    facets = np.concatenate([below[1], above[1] + len(below[0])])
    walls = np.repeat([0, 1], [len(below[1]), len(above[1])])
    return touching.TwoSurfaces.of(pressing.Surface(nodes, facets, walls, np.concatenate([below[2], above[2]])))


PENALTY = pressing.Penalty(100.0, 0.003)


def test_energy_forces_and_stiffness_are_derivatives(figure):
    surfaces, rng = two_sheets(0.03), np.random.default_rng(1)
    nodes = surfaces.surface.nodes + 0.002 * rng.normal(size=surfaces.surface.nodes.shape)
    top = np.unique(surfaces.surface.facets[surfaces.surface.walls == 1])
    nodes[top, 2] -= 0.04
    rest = np.zeros(len(surfaces.owner))

    def at(places):
        return touching.Touching(surfaces, PENALTY, rest, places)

    here, along = at(nodes), rng.normal(size=nodes.shape)
    assert here.touching.sum() > 20
    h = 1e-6
    after, before = at(nodes + h * along), at(nodes - h * along)
    work, rate = (after.energy - before.energy) / (2 * h), float((here.forces * along).sum())
    force, product = (after.forces - before.forces).ravel() / (2 * h), here.stiffness @ along.ravel()
    error = max(abs(work / rate - 1), np.abs(force - product).max() / np.abs(force).max())
    figure("differences", "contact of bodies: forces and stiffness", error, 1e-7)
    turned = np.cross(nodes, here.forces).sum(axis=0)
    assert np.abs(here.forces.sum(axis=0)).max() < 1e-12 * np.abs(here.forces).sum()
    assert np.abs(turned).max() < 1e-9 * np.abs(here.forces).sum()


@pytest.mark.parametrize("way", [0.001, 0.03])
def test_friction_has_its_derivative_and_keeps_coulombs_ratio(way):
    surfaces, rng = two_sheets(0.0, bend=0.0), np.random.default_rng(2)
    rest, rubbing, start = np.zeros(len(surfaces.owner)), pressing.Rubbing(0.4, 0.004), surfaces.surface.nodes
    top = np.unique(surfaces.surface.facets[surfaces.surface.walls == 1])

    def at(places):
        return touching.Touching(surfaces, PENALTY, rest, places)

    pressed = start.copy()
    pressed[top, 2] -= 0.01
    grip = touching.RubbedTouching(at(pressed), rubbing, touching.Anchors.of_free(at(start))).kept()
    places = pressed + 1e-4 * rng.normal(size=start.shape)
    places[top] += [0.6 * way, 0.8 * way, -0.002]

    def rubbed(nodes):
        return touching.RubbedTouching(at(nodes), rubbing, grip)

    here, along, h = rubbed(places), rng.normal(size=start.shape), 1e-7
    assert here.slides.any() == (way > 0.01)
    number = (rubbed(places + h * along).forces - rubbed(places - h * along).forces).ravel() / (2 * h)
    assert np.abs(number - here.whole_stiffness @ along.ravel()).max() < 1e-5 * np.abs(number).max()
    assert abs(here.stiffness - here.stiffness.T).max() < 1e-12 * abs(here.stiffness).max()
    assert np.abs(here.forces.sum(axis=0)).max() < 1e-12 * np.abs(here.forces).sum()
    if way > 0.01:
        assert np.linalg.norm(here.force[:2]) == pytest.approx(0.4 * abs(here.force[2]), rel=0.02)


def test_uniform_pressure_is_the_same_work_on_both_sides_of_any_mesh(figure):
    """Nodal forces of a uniform gap are those of a uniform traction on either mesh."""
    surfaces = two_sheets(0.0, (2, 5), bend=0.0)
    nodes = surfaces.surface.nodes.copy()
    top = np.unique(surfaces.surface.facets[surfaces.surface.walls == 1])
    nodes[top, 2] -= 0.01
    here = touching.Touching(surfaces, PENALTY, np.zeros(len(surfaces.owner)), nodes)
    pressure = float(PENALTY.rates(np.array([0.01]))[1][0])
    rule = surfaces.surface.rule[0]
    wanted = np.zeros(len(nodes))
    areas = np.linalg.norm(surfaces.surface.rest[1], axis=1).reshape(len(surfaces.surface.facets), -1)
    np.add.at(wanted, surfaces.surface.facets, pressure * np.einsum("fq,qa->fa", areas, rule))
    error = np.abs(np.abs(here.forces[:, 2]) - wanted).max() / wanted.max()
    figure("patch test", "contact of bodies: nodal forces across meshes that do not match", error, 1e-10)


LAW = sm.NeoHookean(30e3, 0.3)
WEAK = sm.Spring("upper", 1e-4, name="weak")


def pressed(device, *components, **load):
    parts = (sm.Force("lid", "-z"), WEAK, *components)
    return sm.run(sm.Case("bodies", device, LAW, components=parts, steps=steps_of(**load)))


@pytest.mark.parametrize("section", ["axisymmetric", pytest.param("quarter", marks=pytest.mark.campaign)])
def test_the_patch_test_across_meshes_that_do_not_match(section, figure):
    """Two blocks under a uniform load deform like one, whatever their cells; and the force goes through the contact."""
    device = bodies.TwoBlocks(section=section)
    force = 2.0 if section == "axisymmetric" else 0.5
    run = pressed(device, sm.BodyContact(("lower", "upper"), name="joint"), force_N=[force])
    last, row = run[-1], run.rows[-1]
    x, u = np.asarray(last.points), np.asarray(last.displacement)
    worst = 0.0
    for part in (x[:, 2] < -1e-6, x[:, 2] > 1e-6):
        basis = np.column_stack([np.ones(part.sum()), x[part]])
        fit = basis @ np.linalg.lstsq(basis, u[part], rcond=None)[0]
        worst = max(worst, np.abs(fit - u[part]).max() / np.abs(u).max())
    figure("patch test", f"contact of bodies, {section}: displacement against a linear one", worst, 1e-6)
    missing = (row["joint_on_z_N"] + force - row["weak_spring_z_N"]) / force
    figure("load", f"contact of bodies, {section}: force through the contact and the weak spring", missing, 1e-6)


@pytest.mark.campaign
def test_hertz(figure):
    """Two equal balls: F = 4/3 E* sqrt(R/2) d^1.5 and a^3 = 3 F R / (8 E*), E* = E / (2 (1 - nu^2))."""
    device, law = bodies.TwoBalls(fine=20e-6), LAW
    joint, plate = sm.BodyContact(("lower", "upper"), stiffness=1e5, name="joint"), sm.Rigid("lid", kind="guided", name="plate")
    row = pressed(device, joint, plate, travel_mm=[0.008]).rows[-1]
    young = 2 * 30e3 * (1 + law.poisson) / (2 * (1 - law.poisson**2))
    radius, way = device.radius / 2, row["travel_mm"] * 1e-3
    force = 4 / 3 * young * math.sqrt(radius) * way**1.5
    figure("force of Hertz", "two balls", row["force_N"] / force - 1, 0.02)
    contact = (3 * row["force_N"] * radius / (4 * young)) ** (1 / 3)
    figure("radius of Hertz' contact", "two balls", math.sqrt(row["joint_touching_mm2"] * 1e-6 / math.pi) / contact - 1, 0.02)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"between": ("lower",)}, "names two bodies or faces"),
        ({"between": ("lower", "lower")}, "names two bodies or faces"),
        ({"friction": 5.0}, "out of range"),
        ({"slip": 1e-4}, "needs a coefficient of friction"),
        ({"stiffness": 0.5}, "shear moduli"),
        ({"name": ""}, "needs a name"),
    ],
)
def test_what_makes_no_contact_of_bodies_is_a_sentence(given, told):
    with pytest.raises(sm.ComponentError, match=told):
        sm.BodyContact(**{"between": ("lower", "upper"), "name": "joint"} | given)


@pytest.mark.parametrize(
    ("parts", "told"),
    [
        ((WEAK,), "nothing acts between lower and the others"),
        ((sm.BodyContact(("lower", "upper"), name="joint"),), "only contact would hold the body upper"),
        ((sm.BodyContact(("lower", "inner"), name="joint"), WEAK), "nothing acts between upper"),
    ],
)
def test_bodies_that_nothing_connects_or_holds_are_refused(parts, told):
    case = sm.Case("bodies", bodies.TwoBlocks(), LAW, components=(sm.Force("lid", "-z"), *parts), steps=steps_of(force_N=[1.0]))
    with pytest.raises((sm.ComponentError, sm.RunError), match=told):
        sm.run(case)


def test_a_case_keeps_its_contact_of_bodies_beside_shapes():
    text = """
[geometry]
device = "Beam"
[material]
silicone = "ecoflex-00-30"
[contact.table]
shape = "plane"
faces = "bottom"
at = ["0 mm", "0 mm", "-20 mm"]
along = [0, 0, 1]
[contact.joint]
between = ["tip", "bottom"]
friction = 0.3
[spring.weak]
on = "tip"
stiffness = "0.1 N/m"
[gravity]
direction = "-z"
[load]
share = "0:1"
"""
    case = sm.Case.from_toml(text)
    kinds = [type(part) for part in case.components]
    assert {sm.RigidShape, sm.BodyContact, sm.Spring} <= set(kinds) and sm.Case.from_toml(case.to_toml()) == case


@pytest.mark.campaign
def test_ranks_agree(comm, tmp_path, figure):
    """Three; two have the same contact in `test_pieces_on_ranks`."""
    for name, device in on_touching.MESHES.items():
        device.write(tmp_path / f"{name}.msh")
    alone = np.array(on_touching.figures(comm, tmp_path))
    several = np.array(figures_on(3, tmp_path, "touching")["touching"])
    assert alone[-1] > 0.0  # work of friction
    figure("one rank", "contact of bodies on 3 ranks", np.abs(several - alone).max() / np.abs(alone).max(), 1e-8)


def boxes(file, *sizes):
    """Write a STEP file of boxes, by their corners and edges in mm."""
    with meshing.private_model():
        for size in sizes:
            gmsh.model.occ.addBox(*size)
        gmsh.model.occ.synchronize()
        gmsh.write(str(file))


def test_loose_solids_of_a_drawing_are_bodies(tmp_path):
    """Solids that touch are glued unless they are loose; those that do not touch are bodies of their own."""
    boxes(tmp_path / "two.step", (-10, -10, -8, 20, 20, 8), (-5, -5, 0, 10, 10, 6))
    given = {"file": str(tmp_path / "two.step"), "cavities": ("none",), "support": "z = -8 mm", "cell_size": 0.006}
    assert sm.ImportedActuator(**given).bodies == ()
    loose = sm.ImportedActuator(**given, loose=("solid_2",))
    assert loose.bodies == (("solid_1",), ("solid_2",)) and loose.solid_volume == pytest.approx(3.8e-6)
    with pytest.raises(sm.GeometryError, match=r"loose has 'lid'; the solids of the file are solid_1, solid_2"):
        _ = sm.ImportedActuator(**given, loose=("lid",)).bodies
    boxes(tmp_path / "apart.step", (-10, -10, -8, 20, 20, 8), (-5, -5, 1, 10, 10, 6))
    apart = sm.ImportedActuator(**given | {"file": str(tmp_path / "apart.step")})
    assert apart.bodies == (("solid_1",), ("solid_2",))


@pytest.mark.campaign
def test_a_block_pressed_on_a_pad_from_a_case_file(tmp_path, figure):
    boxes(tmp_path / "two.step", (-10, -10, -8, 20, 20, 8), (-5, -5, 0.2, 10, 10, 6))
    (tmp_path / "case.toml").write_text("""
[geometry]
device = "ImportedActuator"
file = "two.step"
cavities = ["none"]
support = "z = -8 mm"
surfaces = ["lid = z = 6.2 mm"]
cell_size = "8 mm"
[material]
law = "neo-hookean"
shear_modulus = "30 kPa"
poisson = 0.45
[contact.joint]
between = ["solid_1", "solid_2"]
friction = 0.5
[spring.weak]
on = "solid_2"
stiffness = "1 N/m"
[force]
face = "lid"
direction = "-z"
[load]
force_N = [0.1]
""")
    done = runs.run("-m", "softmodels", "run", "case.toml", "-o", "made", "--pictures", "none", cwd=tmp_path)
    assert done.status == 0, done.err
    row = runs.rows(tmp_path / "made")[-1]
    assert row["joint_contact_N"] > 0.09 and row["joint_touching_mm2"] == pytest.approx(100.0, rel=0.2)
    missing = row["joint_on_z_N"] + 0.1 - row["weak_spring_z_N"]
    figure("load", "a block on a pad: force through the contact and the weak spring", missing / 0.1, 1e-6)
