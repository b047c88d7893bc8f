"""Weights and forces from the command line and from case files: runs, tables, words, and what cannot be meant."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import softmodels as sm
from geometries import Beam, HollowDisk, Membrane
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.case.materials import Region
from softmodels.components.contact import Obstacle, RigidShape, Walls
from softmodels.components.loads import Force, Gravity, Mass
from softmodels.components.rigid import Rigid
from softmodels.materials.laws import NeoHookean
from softmodels.materials.silicones import silicone
from softmodels.mechanics.component import ComponentError
from tests.support import runs

DISK = HollowDisk(section="axisymmetric", cell_size=0.003)
LAW = NeoHookean(30e3)
OPTIONS = ("--cell-size", "3mm", "--shear-modulus", "30kPa", "--gravity=-z", "--mass", "top", "--mass-amount", "50g",
           "--force", "top", "--force-direction=-z", "--at-pressure-cm", "40", "--quiet")  # fmt: skip
WEIGHT = 9.81 * (0.05 + 1070 * DISK.solid_volume)


@pytest.fixture(scope="module")
def pushed(tmp_path_factory):
    """An inflated disk with a weight on it, pushed in by a force."""
    folder = tmp_path_factory.mktemp("pushed") / "disk"
    done = runs.disk(folder, *OPTIONS, "--force-N", "0:1:0.5")
    assert done.status == 0, done.err
    return folder


def test_a_force_on_an_inflated_disk(pushed):
    rows = runs.rows(pushed)
    assert [row["force_N"] for row in rows if row["requested"]] == pytest.approx([0.0, 0.5, 1.0])
    assert {round(row["pressure_cm"], 9) for row in rows} == {40.0}
    assert [row["weight_N"] for row in rows] == pytest.approx([WEIGHT] * len(rows), rel=1e-4)
    travel = np.array([row["travel_mm"] for row in rows])
    assert travel[0] == 0.0 and (np.diff(travel) > 0).all() and rows[0]["moved_mm"] > 0.05
    # Of all that acts the work is what is stored: pressure and weight are kept, the force by trapezia.
    stored, volume, sag = (np.array([row[name] for row in rows]) for name in ("stored_energy_mJ", "added_volume_ml", "sag_mm"))
    force = np.array([row["force_N"] for row in rows])
    work = np.sum((force[1:] + force[:-1]) / 2 * np.diff(travel))
    work += rows[0]["pressure_Pa"] * 1e-3 * (volume[-1] - volume[0]) + WEIGHT * (sag[-1] - sag[0])
    assert work == pytest.approx(stored[-1] - stored[0], rel=3e-3)


def test_it_goes_on_to_the_same(pushed, tmp_path):
    """A resumed run hangs first, too, and comes to the states of one that was not interrupted."""
    case = Case.from_file(pushed / "case.toml")
    short = dataclasses.replace(case, steps=steps_of(force_N=(0.0, 0.5), at_pressure_cm=40.0))
    sm.run(short, folder=tmp_path / "short")
    last, wanted = sm.run(case, folder=tmp_path / "short", resume=True).rows[-1], runs.rows(pushed)[-1]
    for name in ("force_N", "travel_mm", "apex_mm", "stored_energy_mJ", "added_volume_ml"):
        assert last[name] == pytest.approx(wanted[name], rel=1e-8), name
    heavier = dataclasses.replace(case, components=(*case.components[:1], Mass(face="top", amount=0.06), *case.components[2:]))
    with pytest.raises(sm.RunError, match="holds a run with another mass"):
        sm.run(heavier, folder=tmp_path / "short", resume=True)


def test_the_case_is_repeated_exactly(pushed):
    case = Case.from_file(pushed / "case.toml")
    assert case.steps == steps_of(force_N=(0.0, 0.5, 1.0), at_pressure_cm=40.0)
    assert case.components == (
        Gravity(direction="-z"), Mass(face="top", amount=0.05), Force(face="top", direction="-z"),
    )  # fmt: skip
    assert Case.from_toml(case.to_toml()) == case and case.variable == "force" and case.quantity == "force"


PARTS = (
    Gravity(direction="-z"),
    Mass(face="top", amount=0.05, name="plate"),
    Force(face="top", direction="-z", name="push"),
)


@pytest.fixture(scope="module")
def programmed():
    """Weight first, then pressure and a force together, then a volume is let in."""
    push = {"push": {"force_N": (0.0, 0.5, 1.0)}}
    steps = steps_of(cavity1={"pressure_cm": (0.0, 40.0, 40.0)}, gravity=(1.0, 1.0, 0.5), force=push)
    return sm.inflate(DISK, LAW, steps=steps, components=PARTS)


def test_a_program_changes_every_kind_of_load(programmed, pushed):
    asked = [row for row in programmed.rows if row["requested"]]
    assert [row["load_step"] for row in asked] == [1, 2, 3]
    assert [row["weight_share"] for row in asked] == pytest.approx([1.0, 1.0, 0.5])
    assert [row["force_push_N"] for row in asked] == pytest.approx([0.0, 0.5, 1.0], abs=1e-12)
    other = next(row for row in runs.rows(pushed) if row["force_N"] == 0.5)
    for name in ("apex_mm", "added_volume_ml", "stored_energy_mJ", "sag_mm"):  # the same loads in another order
        assert asked[1][name] == pytest.approx(other[name], rel=1e-7), name
    text = programmed.case.to_toml()
    assert "[load.force.push]" in text and Case.from_toml(text) == programmed.case


def test_a_travel_leads_to_the_force(pushed):
    """By how far the face moves, in place of the force; and a state between two of them."""
    wanted = runs.rows(pushed)[-1]
    request = steps_of(travel_mm=(wanted["travel_mm"],), at_pressure_cm=40.0)
    run = sm.inflate(DISK, LAW, steps=request, components=Case.from_file(pushed / "case.toml").components)
    assert run.rows[-1]["force_N"] == pytest.approx(1.0, rel=1e-7)
    assert run.at(wanted["travel_mm"] * 1e-3).row["apex_mm"] == pytest.approx(wanted["apex_mm"], rel=1e-6)
    half = next(row for row in runs.rows(pushed) if row["force_N"] == 0.5)
    assert run.at(half["travel_mm"] * 1e-3).row["force_N"] == pytest.approx(0.5, rel=1e-6)


@pytest.mark.campaign
def test_the_limit_of_a_loaded_disk():
    """A weight bears the membrane down, so the disk takes more pressure: what the limit says is what the path finds."""
    soft = NeoHookean(20e3, 0.495)
    disk = HollowDisk.variant("shadow", section="axisymmetric", support="base", cell_size=0.003)
    components = (Gravity(direction="-z"), Mass(face="top", amount=0.1))
    plain, loaded = sm.limit(disk, soft), sm.limit(disk, soft, components=components)
    assert plain.kind == loaded.kind == "limit" and loaded.pressure > 1.005 * plain.pressure
    run = sm.inflate(disk, soft, pressures=(1.05 * loaded.pressure,), components=components)
    assert run.limit.kind == "limit" and run.limit.pressure == pytest.approx(loaded.pressure, rel=1e-6)


HEAD = '[geometry]\ndevice = "HollowDisk"\nsection = "axisymmetric"\n'
FORCE = '[force.tip]\nface = "top"\ndirection = "-z"\n'


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ('[gravity]\ndensity = "1 g/ml"\n[load]\npressure_cm = 1\n', "gravity needs its direction"),
        ('[gravity]\ndirection = "x"\n[load]\npressure_cm = 1\n', "takes loads along its axis"),
        (
            '[mass.a]\nface = "top"\namount = "5 g"\n[load]\npressure_cm = 1\n',
            "has a mass, but gravity has no direction; add it",
        ),
        (
            '[gravity.down]\ndirection = "-z"\n[load]\npressure_cm = 1\n',
            "a device has only one gravity, without a name",
        ),
        (FORCE + "[load]\nmoment_Nmm = 1\n", r"the device has no \[moment\]"),
        (FORCE + "[load]\nforce_N = 1\ntravel_mm = 1\n", "request one of force_N and travel_mm"),
        (FORCE + "[load]\nat_pressure_cm = 3\n", "at_pressure_cm needs requested forces"),
        (FORCE + "[load]\nforce_N = 1\nat_pressure_cm = -2000\n", "below absolute vacuum"),
        (FORCE + 'amount = "2 N"\n[load]\nforce_N = 1\n', "has a constant amount"),
        (FORCE + FORCE.replace("tip", "end") + "[load]\nforce_N = 1\n", "the case has tip, end; choose one"),
        (FORCE + "[load]\nforce_N = [2, 1]\n", "falls from 2 to 1"),
        (FORCE + "[load]\nforce_N = 1\npressure_cm = 2\n", "one of these"),
        (FORCE + "[load]\nforce.end.force_N = [1, 2]\n", "has a series for force.end, but the case has no"),
        (FORCE + "[load]\nforce.tip.newtons = [1, 2]\n", "force.tip needs one of force_N or travel_mm"),
        (FORCE + "[load]\nforce.tip.force_N = [1]\ncavity1.volume_ml = [1]\n", "pressures and volumes at once"),
        (FORCE + "[load]\nforce_N = 1\nload_unload = true\ncontrol = 'volume'\n", "chooses the control itself"),
    ],
)
def test_loads_that_cannot_be_meant(tables, message):
    with pytest.raises(CaseError, match=message):
        Case.from_toml(HEAD + tables)


def test_two_figures_of_one_column():
    """A rigid part `tip` would have its place where the beam has its own."""
    beam = Beam(length=0.01, width=0.01, thickness=0.01, cell_size=0.01, part="quarter", clamp="slip")
    components = (Rigid(face="tip", name="tip"), Gravity(direction="x"))
    with pytest.raises(ComponentError, match=r"share the column tip_x_mm of path.csv; rename the part"):
        sm.run(Case("beam", beam, LAW, components=components, steps=SHARE))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Case("beam", Beam(), LAW, steps=steps_of(pressure_cm=(1.0,))), "Beam has no cavity for a pressure"),
        (lambda: Case("beam", Beam(), LAW, components=(Gravity(direction="y"),), steps=SHARE), "or part="),
        (
            lambda: Case("beam", Beam(), LAW, components=(Gravity(direction="-z"),), steps=AT),
            "no cavity for a pressure",
        ),
    ],
)
def test_beams_that_cannot_be_meant(make, message):
    with pytest.raises(CaseError, match=message):
        make()


SHARE = steps_of(share=(1.0,))
AT = steps_of(share=(1.0,), at_pressure_cm=1.0)


def test_a_weight_that_is_not_borne():
    """A silicone that softens gives way under a force kept: a sentence, and the status of a limit point."""
    from softmodels.materials.laws import Yeoh

    weight = Force(face="tip", direction="x", amount=3.0)
    beam = Beam(length=0.01, width=0.01, thickness=0.01, cell_size=0.01, part="quarter", clamp="slip")
    case = Case(
        "beam",
        beam,
        Yeoh(10e3, -1100.0, 60.0, 0.495),
        components=(weight, Gravity(direction="x")),
        steps=steps_of(share=(1.0,)),
    )
    with pytest.raises(sm.RunError, match=r"no equilibrium under its dead loads.*limit point at 0") as end:
        sm.run(case)
    assert end.value.status == 3


def test_a_force_that_is_not_borne():
    """A device without a cavity ends at a limit point as one with a cavity does: the run comes back, with its end."""
    from softmodels.materials.laws import Yeoh

    beam = Beam(length=0.01, width=0.01, thickness=0.01, cell_size=0.01, part="quarter", clamp="slip")
    pull, asked = Force(face="tip", direction="x"), steps_of(force_N=(6.0,))
    run = sm.run(Case("beam", beam, Yeoh(10e3, -1100.0, 60.0, 0.495), components=(pull,), steps=asked))
    assert run.limit.kind == "limit" and "the force has a limit point" in run.limit.why and len(run) > 3


def test_a_program_of_a_device_without_a_cavity():
    beam = Beam(length=0.01, width=0.01, thickness=0.01, cell_size=0.01, part="quarter", clamp="slip")
    steps = steps_of(force={"force_N": (0.5, 0.2)})
    run = sm.run(Case("beam", beam, LAW, components=(Force(face="tip", direction="x"),), steps=steps))
    assert run.limit is None and run.path["force_N"][-1] == pytest.approx(0.2) and not run.path["pressure_Pa"].any()


def test_a_cavity_that_is_pressed_empty():
    """A membrane pushed through the floor of its chamber: an end of the device's own, with what lets it rest there."""
    membrane = sm.Membrane(chamber_depth=0.001, cell_size=0.002)
    push = Force(face="top", direction="-z")
    case = Case("push", membrane, NeoHookean(30e3), components=(push,), steps=steps_of(travel_mm=(4.0,)))
    limit = sm.run(case).limit
    assert limit.kind == "limit" and "a cavity collapses to zero volume" in limit.why and "cavity has taken" not in limit.why
    chamber = np.pi * membrane.radius**2 * membrane.chamber_depth
    assert -chamber < limit.added_volume < -0.9 * chamber


def test_a_named_silicone_weighs_what_its_sheet_says():
    """Of the device and of a region, each by its own sheet; a density that is given goes before; a note tells the source."""
    membrane = Membrane(cell_size=0.004, through=1.0, plate_radius=0.008, plate_thickness=0.002)
    plate = Region(silicone("dragon-skin-20"), name="plate")
    volumes = np.array([membrane.solid_volume, np.pi * 0.008**2 * 0.002])
    volumes[0] -= volumes[1]
    soft, share = silicone("ecoflex-00-10"), steps_of(share=(1.0,))

    def weighed(gravity, *components, law=soft):
        run = sm.inflate(membrane, dataclasses.replace(law, poisson=0.49), steps=share, components=(gravity, *components))
        return run.rows[-1]["weight_N"] / 9.81, " ".join(run.notes), run.case.to_toml()

    mass, notes, text = weighed(Gravity(direction="-z"), plate)
    assert mass == pytest.approx(volumes @ [1040.0, 1080.0], rel=1e-6)
    assert "the silicone weighs 1040 kg/m^3, by the Smooth-On technical bulletin, Ecoflex Series" in notes
    assert "\ndensity" not in text and Case.from_toml(text).to_toml() == text
    mass, notes, text = weighed(Gravity(direction="-z", density=2000.0))
    assert mass == pytest.approx(2000.0 * volumes.sum(), rel=1e-6) and "weighs" not in notes and "2000 kg/m^3" in text
    mass, notes, _ = weighed(Gravity(direction="-z"), law=LAW)
    assert mass == pytest.approx(1070.0 * volumes.sum(), rel=1e-6) and "as for most silicones" in notes


@pytest.mark.parametrize(
    "part",
    [
        Walls(faces="cavity, lid"), RigidShape(faces="lid", at=(0.0, 0.0, 0.03), radius=0.005), Force("lid", "z", 1.0),
        Mass("lid", 0.01),
    ],
)  # fmt: skip
def test_faces_that_no_mesh_will_have_are_refused_before_one_is_made(part, monkeypatch):
    monkeypatch.setattr(HollowDisk, "build", None)
    with pytest.raises(CaseError, match=r"HollowDisk has no face 'lid'; it has top, cavity, .*outer"):
        Case("disk", DISK, LAW, steps_of(pressure_cm=(10.0,)), components=(part, Gravity(direction="-z")))
    with pytest.raises(CaseError, match="HollowDisk has no face 'lid'"):
        Case("disk", DISK, LAW, steps_of(pressure_cm=(10.0,)), components=[Obstacle("lid", "z = 30 mm")])
