"""Decks with rigid parts, clamps, contact and several cavities: what is written of them holds the device as they do."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest

import softmodels as sm
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.components.contact import ONSET, distances
from tests.support.campaigns import sampled

LAW = sm.Yeoh(14e3, 60.0, 0.0, 0.49)
FINGER = Case("finger", sm.PneuNet(chambers=2, cell_size=0.008), LAW, steps=steps_of(pressure_cm=(4.0, 8.0)))
"""Half a finger, cut at y = 0."""
PLATE = sm.Rigid("tip", name="plate", mass=5e-3)
WEIGHT = sm.Gravity("0.6, 0, -0.8", 1100.0)
DISK = Case("disk", sm.HollowDisk(fillet=0.0, cell_size=0.006), LAW, steps=steps_of(pressure_cm=(40.0,)))


def export(case, file, **changes):
    return sm.export(dataclasses.replace(case, **changes), file)


def admissible(deck, seed=1):
    """Random displacements of all nodes that fulfil what is held and tied, shape (n, 3)."""
    u = np.random.default_rng(seed).normal(size=deck.points.shape)
    for component, nodes in deck.held.items():
        u[nodes, component] = 0.0
    known = {(tie.node, tie.component) for tie in deck.supports.tied}
    for tie in deck.tied:  # the mesh's own come first; integration points depend on these
        if tie.node < len(deck.mesh.points):
            assert not known & set(tie.terms)
        u[tie.node, tie.component] = sum(factor * u[at] for at, factor in tie.terms.items())
    return u


def test_no_dof_is_held_twice(tmp_path):
    """A plate that is guided askew, on a cut plane and beside a clamp that slips."""
    plate = sm.Rigid("tip", kind="guided", direction=(0.6, 0.0, -0.8), name="plate")
    deck = export(FINGER, tmp_path / "x.inp", components=(plate, sm.Clamp("bottom", along="y")))
    held = [(int(node), component) for component, nodes in deck.held.items() for node in nodes]
    tied = [(tie.node, tie.component) for tie in deck.tied]
    assert len(set(held + tied)) == len(held) + len(tied)


def test_a_guided_plate_moves_as_one_along_its_guide(tmp_path):
    plate = sm.Rigid("tip", kind="guided", direction=(0.6, 0.0, -0.8), name="plate")
    deck = export(FINGER, tmp_path / "finger.inp", components=(plate,))
    moved = admissible(deck)[deck.mesh.nodes["tip"]]
    assert np.ptp(moved, axis=0).max() < 1e-12 and abs(moved[0, 2]) > 1e-3
    assert moved[0] == pytest.approx(moved[0, 2] / -0.8 * np.array([0.6, 0.0, -0.8]), abs=1e-12)


def test_a_held_plate_and_a_rigid_region_stand_still_or_rise(tmp_path):
    ringed = sm.Membrane(
        radius=0.02,
        thickness=0.003,
        rings=(0.008, 0.012),
        ring_thickness=0.002,
        section="wedge",
        angle=60.0,
        cell_size=0.008,
    )
    case = Case(
        "membrane", ringed, LAW, steps=steps_of(pressure_cm=(5.0,)), components=(sm.Rigid(region="ring1", name="ring"),)
    )
    deck = sm.export(case, tmp_path / "x.inp")
    moved = admissible(deck)[np.unique(deck.mesh.cells[deck.mesh.regions["ring1"]])]
    assert not moved[:, :2].any() and np.ptp(moved[:, 2]) < 1e-12 and abs(moved[0, 2]) > 1e-3
    deck = export(case, tmp_path / "y.inp", components=(sm.Rigid("ring1", kind="held", name="ring"),))
    assert not admissible(deck)[deck.mesh.nodes["ring1"]].any()


def test_a_plate_that_turns_is_a_rigid_body(tmp_path):
    """Its nodes are the rigid body's alone; the centre stays in the cut plane, and it turns about that plane's normal."""
    deck = export(FINGER, tmp_path / "finger.inp", components=(PLATE, WEIGHT))
    (one,) = deck.supports.rigged
    assert set(one.nodes) == set(deck.mesh.nodes["tip"])
    assert not {tie.node for tie in deck.tied} & set(one.nodes)
    assert {c for c, nodes in deck.held.items() if one.place in nodes} == {1}
    assert {c for c, nodes in deck.held.items() if one.turn in nodes} == {0, 2}
    assert not any(set(nodes) & set(one.nodes) for nodes in deck.held.values())
    tip = deck.mesh.points[one.nodes]
    assert deck.points[one.place] == pytest.approx([tip[:, 0].max(), 0.0, (tip[:, 2].min() + tip[:, 2].max()) / 2])
    text = (tmp_path / "finger.inp").read_text()
    assert f"*RIGID BODY, NSET=RIGID_PLATE, REF NODE={one.place + 1}, ROT NODE={one.turn + 1}" in text
    wanted = 9.81 * (5e-3 / 2) * np.array([0.6, 0.0, -0.8])
    bare = export(FINGER, tmp_path / "bare.inp", components=(dataclasses.replace(PLATE, mass=0.0), WEIGHT))
    assert (deck.forces - bare.forces).sum(axis=0) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.campaign
def test_a_plate_in_a_half_that_is_cut_askew(tmp_path):
    """Its centre stays in the cut plane and its rotation vector is along that plane's normal."""
    device = sm.HollowDisk(fillet=0.0, cavity_radius=0.02, cell_size=0.02, angle=180.0, azimuth=30.0, support="base")
    plate = sm.Rigid("top", name="plate")
    deck = export(DISK, tmp_path / "disk.inp", actuator=device, components=(plate,))
    (one,) = deck.supports.rigged
    u, normal = admissible(deck), np.array(device.cut_planes[0].normal)
    assert abs(u[one.place] @ normal) < 1e-12 and np.linalg.norm(np.cross(u[one.turn], normal)) < 1e-12
    assert np.abs(u[one.place]).min() > 1e-3 and np.abs(u[one.turn]).max() > 1e-3


def test_clamps_hold_what_they_say(tmp_path):
    """A tip that slips along x alone, and a root whose own hold a clamp replaces."""
    components = (sm.Clamp("tip", slip="x", name="rail"), sm.Clamp("support", slip="z", name="root"))
    deck = export(FINGER, tmp_path / "finger.inp", components=components)
    moved = admissible(deck)
    tip, root = moved[deck.mesh.nodes["tip"]], moved[deck.mesh.nodes["support"]]
    assert not tip[:, 1:].any() and np.ptp(tip[:, 0]) > 0.1
    assert not root[:, :2].any() and np.ptp(root[:, 2]) > 0.1


def test_contact_with_a_plane_is_springs_of_the_same_force(tmp_path):
    """The top, moved as one by a depth into the plane, pushes with the penalty's pressure on its area."""
    apex = DISK.actuator.probes["apex"][2]
    deck = export(DISK, tmp_path / "disk.inp", components=[sm.Obstacle("top", f"z = {1e3 * apex + 0.5} mm")])
    (springs,) = deck.springs
    size, k = DISK.actuator.size, 300.0
    area = math.pi * (DISK.actuator.cavity_radius + DISK.actuator.wall) ** 2 / DISK.actuator.copies
    for depth in (-1e-3, 0.4 * ONSET, 3 * ONSET, 0.05):
        ends = springs.ends + np.array([0.0, 0.0, 0.5e-3 + depth * size])
        stretched = np.linalg.norm(ends - springs.ground, axis=1) - np.linalg.norm(
            springs.ends - springs.ground, axis=1
        )
        forces = [np.interp(x, *table) for x, *table in zip(stretched, springs.stretches, springs.forces, strict=True)]
        pressure = (
            k * (depth**2 / 2 / ONSET if depth < ONSET else depth - ONSET / 2) * (depth > 0) * LAW.shear_modulus_0
        )
        assert -sum(forces) == pytest.approx(pressure * area, rel=2e-3, abs=1e-12)
    text = (tmp_path / "disk.inp").read_text()
    assert text.count("*SPRING, ") == text.count("TYPE=SPRINGA") == len(springs.ends) == 6 * len(deck.mesh.faces["top"])
    numbers = [int(line.split(",")[0]) for line in re.findall(r"TYPE=SPRINGA.*\n(.+)", text)]
    assert numbers == list(range(len(deck.mesh.cells) + 1, len(deck.mesh.cells) + len(numbers) + 1))


@pytest.mark.parametrize(
    "shape",
    sampled(
        [
            sm.RigidShape("sphere", "bottom", (0.012, 0.0, -0.007), 0.005, name="ball"),
            sm.RigidShape("sphere", "bottom", (0.012, 0.0, 0.004), 0.040, hollow=True, name="bowl"),
            sm.RigidShape("cylinder", "bottom", (0.012, 0.0, -0.007), 0.005, along=(0.0, 1.0, 0.0), name="rod"),
        ]
    ),
    ids=lambda shape: shape.name,
)
def test_springs_are_as_long_as_shapes_are_away(tmp_path, shape):
    """Wherever nodes move to: the distance of integration points, and the push of the penalty at some depth."""
    deck = export(FINGER, tmp_path / "finger.inp", components=(shape,))
    (springs,) = deck.springs
    ((_, ground),) = deck.grounds
    size, sign = FINGER.actuator.size, -1.0 if shape.hollow else 1.0
    u = 1e-3 * admissible(deck)
    ends = springs.ends + u[ground + 1 : ground + 1 + len(springs.ends)]
    lengths = np.linalg.norm(ends - springs.ground, axis=1)
    nodes = np.concatenate([deck.mesh.triangles("bottom")])
    values = np.array([[terms[2][node, 2] for node in nodes[k // 6]] for k, terms in enumerate(springs.terms)])
    places = np.einsum(
        "kn,kni->ki", values, (deck.mesh.points + u[: len(deck.mesh.points)])[np.repeat(nodes, 6, axis=0)]
    )
    away = size * distances(places / size, shape.numbers(size))
    assert sign * (lengths - shape.radius) == pytest.approx(away, abs=1e-9)
    depth = 4e-3 * size  # before the shape grows harder
    at = shape.radius - sign * depth - np.linalg.norm(springs.ends - springs.ground, axis=1)
    forces = [np.interp(x, *table) for x, *table in zip(at, springs.stretches, springs.forces, strict=True)]
    area = np.linalg.norm(
        np.cross(*(deck.mesh.points[nodes[:, i]] - deck.mesh.points[nodes[:, 0]] for i in (1, 2))), axis=1
    )
    pressure = LAW.shear_modulus_0 * 300.0 * (depth / size - ONSET / 2)
    assert -sign * np.sum(forces) == pytest.approx(pressure * area.sum() / 2, rel=1e-9)


def test_a_shape_that_gives_way_begins_on_its_line(tmp_path):
    """Half of a spring and of a weight, which the half's mirror image shares, hold a cylinder that crosses the cut."""
    rod = sm.RigidShape(
        "cylinder", "bottom", (0.012, 0.0, -0.007), 0.005, along=(0.0, 1.0, 0.0), guide="0.6, 0, -0.8", spring=20.0,
        mass=2e-3, name="rod",
    )  # fmt: skip
    deck = export(FINGER, tmp_path / "finger.inp", components=(rod, sm.Gravity("-0.6, 0, 0.8", density=0.0)))
    (springs,), ((_, first),) = deck.springs, deck.grounds
    u = admissible(deck)
    moving = first + len(springs.ends) + 1
    assert not u[moving + 1].any() and u[first] == pytest.approx(u[moving], abs=1e-12)
    assert u[moving] == pytest.approx(u[moving, 2] / -0.8 * np.array([0.6, 0.0, -0.8]), abs=1e-12) and u[moving].any()
    *_, (begin, end, ways, forces) = springs.elements
    assert (first + begin, first + end) == (moving + 1, moving)
    assert deck.points[moving] - deck.points[moving + 1] == pytest.approx(
        FINGER.actuator.size * np.array([0.6, 0.0, -0.8])
    )
    lifted = 2e-3
    assert np.interp(lifted, ways, forces) == pytest.approx((20.0 * lifted + 9.81 * 2e-3) / 2, rel=1e-6)
    assert (tmp_path / "finger.inp").read_text().count("*SPRING, ") == len(springs.ends) + 1


@pytest.mark.campaign
@pytest.mark.parametrize(
    "part",
    sampled(
        [
            sm.Fibres("outer", angle=35.0, helices=2, stiffness=300.0, name="thread"),
            sm.Fibres(
                "outer, strip",
                angle=80.0,
                helices=2,
                stiffness=300.0,
                law="exponential",
                exponent=2.0,
                slack=True,
                name="thread",
            ),
            sm.Fibres("base", angle=60.0, helices=2, modulus=20e3, name="thread"),
            sm.Fabric("outer", 400.0, 150.0, angle=0.0, name="thread"),
        ]
    ),
    ids=["winding", "slack", "region", "fabric"],
)
def test_threads_are_springs_of_the_same_work(tmp_path, comm, part):
    """Along a displacement that stretches and turns: the springs' forces times their lengthening, and the energy's change."""
    from dolfinx import fem

    from softmodels.mechanics.body import Body
    from softmodels.mechanics.system import System

    tube = sm.Cylinder(section="half", length=0.02, cell_size=0.006, strip=90.0)
    device = FINGER.actuator if part.table == "fibres" and part.on == "base" else tube
    deck = sm.export(
        Case("tube", device, LAW, steps=steps_of(pressure_cm=(5.0,)), components=(part,)), tmp_path / "tube.inp"
    )
    system = System(
        Body.from_file(device, device.write(tmp_path / "x.msh"), comm), LAW, "displacement", components=[part]
    )
    term, size = system.potential.terms["thread"], device.size

    def moved(x, share):
        """Of places in m, shape (n, 3): a quadratic field."""
        a = np.array([[0.2, 0.3, -0.1], [-0.2, 0.1, 0.3], [0.1, -0.3, 0.15]])
        return share * (x @ a.T + 8.0 * x[:, [1, 2, 0]] * x[:, [0, 1, 1]])

    def energy(share):
        system.w.interpolate(lambda x: system.body.skew @ (moved(size * x.T, share) / size).T)
        return sum(system.integral(fem.form(one)) for one in term.energies) * system.stress_unit * size**3

    def lengths(share):
        u = moved(deck.points, share)
        found = []
        for springs, ground in deck.grounds:
            for tie in springs.ties(ground):
                u[tie.node, tie.component] = sum(factor * u[at] for at, factor in tie.terms.items())
            ends = springs.ends + u[ground + 1 : ground + 1 + len(springs.ends)]
            found.append(np.linalg.norm(ends - springs.ground, axis=1))
        return found

    h, work = 1e-4, 0.0
    for springs, low, mean, high in zip(deck.springs, *map(lengths, (0.4 - h, 0.4, 0.4 + h)), strict=True):
        stretched = mean - np.linalg.norm(springs.ends - springs.ground, axis=1)
        forces = [np.interp(x, *table) for x, *table in zip(stretched, springs.stretches, springs.forces, strict=True)]
        work += float(np.dot(forces, high - low))
    assert work == pytest.approx(energy(0.4 + h) - energy(0.4 - h), rel=2e-3) and abs(work) > 0.0


def test_each_cavity_has_its_share_of_the_pressure(tmp_path):
    case = dataclasses.replace(FINGER, actuator=sm.PneuNet(chambers=2, cell_size=0.008, sides=2, opposite=0.25))
    sm.export(case, tmp_path / "x.inp")
    found = re.findall(r"(CAVITY\d?), P, (\S+)", (tmp_path / "x.inp").read_text())
    assert [role for role, _ in found] == ["CAVITY", "CAVITY2"] * 2
    assert [float(p) for _, p in found] == pytest.approx(
        [f * goal for goal in case.goals for f in (1.0, 0.25)], rel=1e-12
    )


def test_a_program_of_pressures_is_written_step_by_step(tmp_path):
    device = sm.PneuNet(chambers=2, cell_size=0.008, sides=2, opposite=1.0)
    series = {"cavity1": {"pressure_cm": [0, 4, 4]}, "cavity2": {"pressure_cm": [0, 0, 6]}}
    case = Case("two", device, LAW, steps=steps_of(**series))
    sm.export(case, tmp_path / "x.inp")
    found = [float(p) for p in re.findall(r"CAVITY\d?, P, (\S+)", (tmp_path / "x.inp").read_text())]
    assert found == pytest.approx([case.cm * p for p in (4, 0, 4, 6)], rel=1e-12)
    series["cavity2"] = {"volume_ml": [0, 0, 0.1]}
    with pytest.raises(CaseError, match="a deck takes pressures"):
        sm.export(dataclasses.replace(case, steps=steps_of(**series)), tmp_path / "y.inp")


BALL = sm.RigidShape("sphere", "bottom", (0.012, 0.0, -0.007), 0.005, name="ball")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"components": (dataclasses.replace(BALL, shape="capsule", length=0.01),)},
            "'capsule' \\(springs support sphere, cylinder, plane",
        ),
        ({"components": (PLATE, WEIGHT, BALL)}, "ball acts on nodes of the rotating rigid part plate"),
    ],
)
def test_what_decks_cannot_say_of_parts(tmp_path, changes, words):
    with pytest.raises(CaseError, match=words):
        export(FINGER, tmp_path / "x.inp", **changes)
    assert not list(tmp_path.iterdir())
