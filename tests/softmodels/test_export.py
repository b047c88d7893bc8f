"""Decks for CalculiX: read back, they hold the case's mesh, supports, silicone and pressures."""

from __future__ import annotations

import dataclasses
import re
import subprocess
import sys

import numpy as np
import pytest

import softmodels as sm
from geometries import ImportedMesh
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.decks.deck import silicones_of, solved
from softmodels.materials.laws import HomogeneousStrain
from tests.support.ranks import mpirun

DISK = sm.HollowDisk(fillet=0.0, cell_size=0.006, support="base")
LAW = sm.Yeoh(14e3, 60.0, 0.5, 0.49)
CASE = Case("disk", DISK, LAW, steps=steps_of(pressure_cm=(0.0, 40.0, 80.0)))


@pytest.fixture(scope="module")
def decks(tmp_path_factory):
    folder = tmp_path_factory.mktemp("decks")
    return folder, sm.export(CASE, folder / "disk.inp")


def test_the_mesh_comes_back(decks):
    """Read as a foreign mesh by its names, the deck encloses the same air and has the same cut planes."""
    folder, deck = decks
    back = ImportedMesh(
        file=str(folder / "disk.inp"), cavities=("named ON_CAVITY",), support="named ON_SUPPORT",
        planes=("named ON_PLANE0", "named ON_PLANE1"),
    )  # fmt: skip
    assert len(back.mesh.cells) == len(deck.mesh.cells)
    assert back.copies == DISK.copies == 8
    # Edges of the cells' curved sides lie in the plane in both; the volumes differ from the closed form by the mesh.
    assert back.cavity_volume == pytest.approx(DISK.cavity_volume, rel=0.02)
    assert [plane.normal for plane in back.cut_planes] == [pytest.approx(plane.normal, abs=1e-6) for plane in DISK.cut_planes]


def test_pressures_and_silicone(decks):
    folder, _ = decks
    inp = (folder / "disk.inp").read_text()
    pressures = [float(value) for value in re.findall(r"CAVITY, P, (\S+)", inp)]
    assert pressures == pytest.approx(CASE.values[1:], rel=1e-12)
    c1, c2, c3, d1, d2, d3 = map(float, re.search(r"YEOH\n(.+)", inp)[1].split(","))
    assert (c1, c2, c3) == pytest.approx((14e3, 60.0, 0.5), rel=1e-12) and d2 == d3 == 1e10
    assert 2 / d1 == pytest.approx(LAW.bulk, rel=1e-12)


def test_a_memory_is_left_out_with_a_sentence(decks, tmp_path):
    """The deck is that of the relaxed silicone, and says so."""
    folder, _ = decks
    creeping = dataclasses.replace(CASE, material=LAW.with_memory(branches=[(0.2, 1.0)]))
    (tmp_path / "case.toml").write_text(creeping.to_toml())
    command = [sys.executable, "-m", "softmodels", "export", "case.toml", "-o", "disk.inp"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0 and "silicone: the deck leaves out its memory" in " ".join(done.stdout.split())
    relaxed, here = (re.search(r"\*MATERIAL.*(?:\n.*){3}", (place / "disk.inp").read_text())[0] for place in (folder, tmp_path))
    assert here == relaxed and "YEOH" in here


def test_supports_hold_what_the_device_holds(decks):
    """Every node on a cut plane or support may move only as the roles allow: by the projections that they leave."""
    _, deck = decks
    planes = {plane.name: np.array(plane.normal) for plane in DISK.cut_planes}
    planes |= {hold.role: np.array(hold.direction) for hold in DISK.holds if hold.direction is not None}
    glued = [hold.role for hold in DISK.holds if hold.direction is None]
    tied = {(tie.node, tie.component): tie.terms for tie in deck.supports.tied}
    held = {(int(node), component) for component, nodes in deck.supports.held.items() for node in nodes}
    assert tied and held and not set(tied) & held
    random = np.random.default_rng(1)
    for node in np.unique(np.concatenate([deck.mesh.nodes[role] for role in (*planes, *glued)])):
        u = random.normal(size=3)
        for component in range(3):
            if (node, component) in held:
                u[component] = 0.0
        for component in range(3):
            if (node, component) in tied:
                assert {other for other, _ in tied[node, component]} == {node}
                u[component] = sum(factor * u[i] for (_, i), factor in tied[node, component].items())
        for role, normal in planes.items():
            if node in deck.mesh.nodes[role]:
                assert abs(u @ normal) < 1e-9
        for role in glued:
            if node in deck.mesh.nodes[role]:
                assert np.abs(u).max() < 1e-9


LOADED = dataclasses.replace(
    CASE,
    actuator=sm.PneuNet(cell_size=0.008),
    components=(
        sm.Region(sm.MooneyRivlin(200e3, 50e3, 0.45), 1300.0, name="base"),
        sm.Gravity("0.6, 0, -0.8", 1100.0),
        sm.Mass("tip", 3e-3),
        sm.Force("bottom", "z", 0.02),
        sm.Moment("tip", "y", 4e-4),
    ),
)
"""A finger of two silicones that hangs askew, with a weight, a force and a moment."""


@pytest.fixture(scope="module")
def loaded(tmp_path_factory):
    file = tmp_path_factory.mktemp("loaded") / "finger.inp"
    return sm.export(LOADED, file), file.read_text()


def test_dead_loads_are_forces_on_nodes(loaded):
    """The resultant of the nodes' forces, as written, is that of the loads on the slice; a moment has none."""
    deck, text = loaded
    block = re.search(r"\*CLOAD\n((?:\d+, [123], \S+\n)+)", text)[1]
    forces = np.zeros_like(deck.mesh.points)
    for line in block.splitlines():
        node, component, value = line.split(", ")
        forces[int(node) - 1, int(component) - 1] += float(value) * 1e-6
    corners = deck.mesh.points[deck.mesh.cells[:, :4]]
    volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6
    base = volumes[deck.mesh.regions["base"]].sum()
    device = deck.case.actuator
    # Cells' edges are straight but around the channel, so that their volumes are these to a part in a thousand.
    mass = 1100.0 * volumes.sum() + 200.0 * base + 3e-3 / device.copies
    wanted = 9.81 * mass * np.array([0.6, 0.0, -0.8]) + np.array([0.0, 0.0, 0.02]) / device.copies
    assert forces.sum(axis=0) == pytest.approx(wanted, rel=2e-3, abs=1e-9)


def test_one_moment_is_written_as_its_own(tmp_path):
    case = dataclasses.replace(LOADED, components=(sm.Moment("tip", "y", 4e-4),))
    deck = sm.export(case, tmp_path / "finger.inp")
    found = np.cross(deck.mesh.points, deck.forces).sum(axis=0)
    assert np.abs(deck.forces.sum(axis=0)).max() < 1e-9 * np.abs(deck.forces).sum()
    assert found[1] == pytest.approx(4e-4 / case.actuator.copies, rel=1e-9)


def test_regions_have_silicones_of_their_own(loaded):
    deck, text = loaded
    assert re.findall(r"\*SOLID SECTION, ELSET=(\w+), MATERIAL=(\w+)", text) == [
        *((region.upper(), "SILICONE") for region in deck.mesh.regions if region != "base"),
        ("BASE", "BASE"),
    ]
    values = re.search(r"NAME=BASE\n\*HYPERELASTIC, MOONEY-RIVLIN\n(.+)", text)[1]
    assert [float(value) for value in values.split(",")][:2] == [200e3, 50e3]


def test_without_dead_loads_there_is_no_step_for_them(decks, tmp_path):
    folder, deck = decks
    assert deck.forces is None and "*CLOAD" not in (folder / "disk.inp").read_text()
    idle = dataclasses.replace(LOADED, components=(sm.Force("bottom", "z"),))  # its amount would be a request's
    assert sm.export(idle, tmp_path / "idle.inp").forces is None


@pytest.mark.parametrize("seed", range(5))
def test_the_reduced_directions_span_the_held_ones(seed):
    rows = np.random.default_rng(seed).normal(size=(seed % 3 + 1, 3))
    found = solved(rows)
    assert len(found) == len(rows)
    made = np.array([[1.0 if i == c else -f.get(i, 0.0) for i in range(3)] for c, f in found])
    assert np.linalg.matrix_rank(np.vstack([rows, made]), tol=1e-9) == len(rows)


@pytest.mark.parametrize(
    "law",
    [
        sm.MooneyRivlin(10e3, 2e3, 0.49),
        LAW,
        sm.Ogden((20e3, -3e3), (1.5, -3.0), 0.49),
        sm.Polynomial(9e3, 2e3, 80.0, -20.0, 5.0, 0.49),
    ],
    ids=["mooney-rivlin", "yeoh", "ogden", "polynomial"],
)
def test_a_laws_terms_are_its_energy(law):
    strain = HomogeneousStrain((1.7, 1.1, 1 / (1.7 * 1.1)))
    energy = sum(f * (strain.I1_bar - 3) ** i * (strain.I2_bar - 3) ** j for (i, j), f in law.invariant_terms.items())
    energy += sum(mu / a * (sum(s**a for s in strain.stretches_bar) - 3) for mu, a in law.stretch_terms)
    assert energy == pytest.approx(law.shape(strain, law), rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"actuator": sm.HollowDisk(section="axisymmetric")}, "axisymmetric section"),
        ({"steps": steps_of(volume_ml=(1.0,))}, "asks for added volumes"),
        ({"steps": steps_of(pressure_cm=(0.0,))}, "add a value above 0"),
        ({"load_unload": True}, "no unloading"),
        ({"material": sm.Gent(28e3, 30.0)}, "gent is a law that CalculiX does not have"),
        ({"material": sm.Yeoh(14e3, 60.0, 0.5, 0.5)}, "incompressible"),
        ({"components": [sm.Sheet("top", 1e3)]}, r"\[sheet"),
        ({"components": (sm.Walls("cavity"),)}, r"\[walls\]"),
        (
            {"actuator": LOADED.actuator, "components": (sm.Region(sm.Gent(28e3, 30.0), name="base"),)},
            "region base: gent is a law",
        ),
    ],
)
def test_what_decks_have_no_words_for(tmp_path, changes, words):
    with pytest.raises(CaseError, match=words):
        sm.export(dataclasses.replace(CASE, **changes), tmp_path / "disk.inp")
    assert not list(tmp_path.iterdir())


def test_files_that_are_no_decks_stay(tmp_path):
    (tmp_path / "mine.inp").write_text("*NODE\n")
    for name, words in (("mine.inp", "is not a deck"), ("disk.txt", r"ends in \.txt"), ("disk.feb", r"ends in \.feb")):
        with pytest.raises(CaseError, match=words):
            sm.export(CASE, tmp_path / name)
    assert (tmp_path / "mine.inp").read_text() == "*NODE\n"


def test_a_region_may_be_called_silicone():
    main, own = silicones_of(LAW, (sm.Region(sm.MooneyRivlin(200e3, 50e3, 0.45), name="silicone"),), ("solid", "silicone"))
    assert own.name == "silicone" and own.regions == ("silicone",)
    assert main.name != own.name and main.regions == ("solid",)


@pytest.mark.campaign
def test_two_ranks_write_dead_loads_as_one_does(loaded, tmp_path):
    """They start MPI, which waits for both."""
    (tmp_path / "case.toml").write_text(LOADED.to_toml())
    command = [mpirun(), "-n", "2", sys.executable, "-m", "softmodels", "export", "case.toml", "-o", "finger.inp"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and not done.stderr
    first, note = done.stdout.splitlines()  # once, not by each rank
    assert first.startswith("finger.inp: ") and "overlap here" in note
    assert (tmp_path / "finger.inp").read_text() == loaded[1]


def test_the_command(tmp_path):
    (tmp_path / "case.toml").write_text(CASE.to_toml())

    def export(*arguments):
        command = [sys.executable, "-m", "softmodels", "export", *arguments]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)

    done = export("case.toml", "-o", "disk.inp")
    assert done.returncode == 0 and re.search(r"disk\.inp: \d+ cells, \d+ nodes, 2 pressures", done.stdout)
    assert export("case.toml", "-o", "disk.inp", "--quiet").stdout == ""
    wrong = export("case.toml", "-o", "nowhere/disk.inp")
    assert wrong.returncode == 2 and "cannot be written" in wrong.stderr and "Traceback" not in wrong.stderr
    assert export("none.toml", "-o", "x.inp").returncode == 2
