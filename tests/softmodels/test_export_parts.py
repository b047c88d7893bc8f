"""Decks with rigid parts, clamps and several cavities: what is written of them holds the device as they do."""

from __future__ import annotations

import dataclasses
import re

import gmsh
import numpy as np
import pytest

import softmodels as sm
from geometries.meshing import private_model
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of

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
    for component, nodes in deck.supports.held.items():
        u[nodes, component] = 0.0
    known = {(tie.node, tie.component) for tie in deck.supports.tied}
    for tie in deck.supports.tied:
        assert not known & set(tie.terms)
        u[tie.node, tie.component] = sum(factor * u[at] for at, factor in tie.terms.items())
    return u


def test_no_dof_is_held_twice(tmp_path):
    """A plate that is guided askew, on a cut plane and beside a clamp that slips."""
    plate = sm.Rigid("tip", kind="guided", direction=(0.6, 0.0, -0.8), name="plate")
    deck = export(FINGER, tmp_path / "x.inp", components=(plate, sm.Clamp("bottom", along="y")))
    held = [(int(node), component) for component, nodes in deck.supports.held.items() for node in nodes]
    tied = [(tie.node, tie.component) for tie in deck.supports.tied]
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
    assert not {tie.node for tie in deck.supports.tied} & set(one.nodes)
    assert {c for c, nodes in deck.supports.held.items() if one.place in nodes} == {1}
    assert {c for c, nodes in deck.supports.held.items() if one.turn in nodes} == {0, 2}
    assert not any(set(nodes) & set(one.nodes) for nodes in deck.supports.held.values())
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


def test_each_cavity_has_its_share_of_the_pressure(tmp_path):
    case = dataclasses.replace(FINGER, actuator=sm.PneuNet(chambers=2, cell_size=0.008, sides=2, opposite=0.25))
    sm.export(case, tmp_path / "x.inp")
    found = re.findall(r"(CAVITY\d?), P, (\S+)", (tmp_path / "x.inp").read_text())
    assert [role for role, _ in found] == ["CAVITY", "CAVITY2"] * 2
    assert [float(p) for _, p in found] == pytest.approx([f * goal for goal in case.values for f in (1.0, 0.25)], rel=1e-12)


def test_a_program_of_pressures_is_written_step_by_step(tmp_path):
    device = sm.PneuNet(chambers=2, cell_size=0.008, sides=2, opposite=1.0)
    series = {"cavity1": {"pressure_cm": [0, 4, 4]}, "cavity2": {"pressure_cm": [0, 0, 6]}}
    case = Case("two", device, LAW, steps=steps_of(**series))
    sm.export(case, tmp_path / "x.inp")
    found = [float(p) for p in re.findall(r"CAVITY\d?, P, (\S+)", (tmp_path / "x.inp").read_text())]
    assert found == pytest.approx([case.column.pascal * p for p in (4, 0, 4, 6)], rel=1e-12)
    series["cavity2"] = {"volume_ml": [0, 0, 0.1]}
    with pytest.raises(CaseError, match="a deck takes pressures"):
        sm.export(dataclasses.replace(case, steps=steps_of(**series)), tmp_path / "y.inp")


@pytest.mark.parametrize(
    "part",
    [
        sm.RigidShape("sphere", "bottom", (0.012, 0.0, -0.007), 0.005, name="ball"),
        sm.Obstacle("top", "z = 30 mm"),
        sm.Fibres("bottom", stiffness=300.0),
        sm.Fabric("top", 400.0, 150.0),
    ],
    ids=lambda part: part.table,
)
def test_contact_and_fibres_are_refused(tmp_path, part):
    with pytest.raises(CaseError, match=f"{part.table}.*decks do not support.*clamps, rigid parts, dead loads"):
        export(FINGER, tmp_path / "x.inp", components=(part,))
    assert not list(tmp_path.iterdir())


def test_regions_of_a_foreign_mesh_that_share_cells_are_refused(tmp_path):
    """Whatever the order of their tables, which would decide their silicone."""
    with private_model():
        occ, model = gmsh.model.occ, gmsh.model
        slices = [(3, occ.addBox(0, 0, z, 30, 30, 10)) for z in (0, 10, 20)]
        occ.cut(slices[1:2], [(3, occ.addBox(10, 10, 10, 10, 10, 10))])
        occ.fragment(slices[:1], [solid for solid in occ.getEntities(3) if solid != slices[0]])
        occ.synchronize()
        solids = sorted((tag for _, tag in occ.getEntities(3)), key=lambda tag: occ.getCenterOfMass(3, tag)[2])
        for name, box in (("support", (-1, -1, -1, 1, 31, 31)), ("air", (9, 9, 9, 21, 21, 21))):
            model.addPhysicalGroup(2, [tag for _, tag in model.getEntitiesInBoundingBox(*box, 2)], name=name)
        for name, tags in (("rubber", solids), ("high", solids[1:]), ("low", solids[:2])):
            model.addPhysicalGroup(3, tags, name=name)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 30)
        gmsh.option.setNumber("Mesh.ElementOrder", 2)
        model.mesh.generate(3)
        gmsh.write(str(tmp_path / "part.msh"))
    part = sm.ImportedMesh(file=str(tmp_path / "part.msh"), cavities=("named air",), support="named support")
    case = Case("part", part, LAW, steps=steps_of(pressure_cm=(4.0,)))
    high, low = (sm.Region(sm.Yeoh(c1, 0.0, 0.0, 0.49), name=name) for name, c1 in (("high", 1e6), ("low", 1e5)))
    for one, two in ((high, low), (low, high)):
        with pytest.raises(sm.ComponentError, match=rf"\[region.{two.name}\]: \d+ of its \d+ cells are also among"):
            export(case, tmp_path / "x.inp", components=(one, two))
    assert len(export(case, tmp_path / "x.inp", components=(low,)).silicones) == 2
