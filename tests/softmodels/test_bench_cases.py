"""Experiments of a soft-robotics bench as they are written down: weights on membranes, heights, pressures in kPa."""

from __future__ import annotations

import numpy as np
import pytest

import softmodels as sm
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.case.materials import MaterialErrors
from softmodels.cli.examples import BENCH
from softmodels.runs.notes import bonded_notes
from tests.support import runs

MEMBRANE = sm.Membrane(plate_radius=0.008, cell_size=0.002, through=2)
LAW = sm.NeoHookean(30e3)
PLATE = sm.Rigid("plate", name="plate", mass=0.02)
LIFTED = """
[geometry]
device = "Membrane"
plate_radius = "8 mm"
cell_size = "2 mm"
through = 2

[rigid.plate]
face = "plate"
mass = "20 g"

[gravity]
direction = "-z"

[load]
"""


@pytest.fixture(scope="module")
def lifting():
    """A plate of 20 g on a membrane, to volumes."""
    return sm.inflate(MEMBRANE, LAW, volumes="0,2,5 ml", components=[PLATE, sm.Gravity("-z")])


def test_a_requested_volume_is_the_one_in_the_table(lifting):
    """Of a device that hangs, too: counted from the undeformed cavity, and 0 is as it hangs."""
    asked = [row["added_volume_ml"] for row in lifting.rows if row["requested"]]
    assert asked[0] < -1.0 and asked[1:] == pytest.approx([2.0, 5.0], rel=1e-9)
    assert lifting.at("3 ml").added_volume == pytest.approx(3e-6, rel=1e-9)


def test_a_program_counts_volumes_alike(lifting):
    run = sm.run(Case.from_toml(f"{LIFTED}cavity1.volume_ml = [0, 2, 5]"))
    asked = [row for row in run.rows if row["requested"]]
    wanted = [row for row in lifting.rows if row["requested"]]
    for name in ("added_volume_ml", "pressure_cm", "plate_z_mm"):
        assert [row[name] for row in asked] == pytest.approx([row[name] for row in wanted], rel=1e-6, abs=1e-9)


def test_a_volume_that_the_weight_has_passed_is_refused():
    with pytest.raises(sm.RunError, match=r"1 ml are not on this path.*already added 2\.\d+ ml") as end:
        sm.inflate(MEMBRANE, LAW, volumes="1:5 ml", components=[PLATE, sm.Gravity("z")])
    assert end.value.status == 3
    run = sm.inflate(MEMBRANE, LAW, volumes="0:5 ml", components=[PLATE, sm.Gravity("z")])
    assert run.rows[0]["requested"] and np.isclose(run.added_volume[-1], 5e-6)


DISK = '[geometry]\ndevice = "HollowDisk"\n[load]\n'


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        ('pressure = "0:4 kPa"', [0.0, 4e3]),
        ('pressure = "0:0.02 bar:0.01"', None),
        ('pressure = "0,20,40 mbar"', [0.0, 2e3, 4e3]),
        ('pressure = ["500 Pa", "1 kPa"]', [500.0, 1e3]),
        ('pressure = "0.5 psi"', [3447.378647]),
        ('pressure = "0:4 kPa"\nwater_density = "1000 kg/m^3"', [0.0, 4e3]),
        ("pressure = 4", None),
        ('pressure = "0:4"', None),
        ('pressure = "0:4 mm"', None),
        ('pressure = ["2 kPa", "1 kPa"]', None),
        ('pressure = "0:4 kPa"\npressure_cm = "0:40"', None),
        ("pressure_kPa = 4", None),
    ],
)
def test_pressures_with_their_unit(asked, expected):
    """No column's liquid stands between what a gauge shows and what is solved for."""
    if expected is None:
        with pytest.raises(CaseError, match=r"unit|range|falls|twice|pressure, volume_ml"):
            Case.from_toml(DISK + asked)
        return
    case = Case.from_toml(DISK + asked)
    assert case.values == pytest.approx(expected, rel=1e-9) and Case.from_toml(case.to_toml()) == case


def test_pressures_with_their_unit_as_an_option(tmp_path):
    options = ("--device", "Membrane", "--cell-size", "4mm", "--through", "1", "--no-pictures")
    done = runs.run("-m", "softmodels", "run", *options, "--pressure", "0,1kPa", "--water-density", "1000kg/m^3",
                    "--output", tmp_path / "run")  # fmt: skip
    assert done.status == 0 and "10.1972 cm, 1 g/ml (1 kPa)" in done.out
    done = runs.run("-m", "softmodels", "run", *options, "--pressure", "0,1kPa", "--pressure-cm", "4")
    assert done.status == 2 and "requested twice" in done.err


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """A folder with a fit of laws to a pull, and a case file beside it."""
    folder = tmp_path_factory.mktemp("fitted")
    stretch = np.linspace(1.05, 2.0, 12)
    stress = 100.0 * (stretch**1.5 - stretch**-1.75) * (1 + 0.01 * np.sin(40 * stretch))
    rows = "\n".join(f"{100 * (one - 1)},{value}" for one, value in zip(stretch, stress, strict=True))
    (folder / "pull.csv").write_text(f"strain (%),stress (kPa)\n{rows}\n")
    done = runs.run(
        "-m", "softmodels", "fit", "--tensile", folder / "pull.csv", "--material", "neo-hookean,ogden1",
        "--gauge-error", "none", "--no-pictures", "--no-profiles", "-o", folder / "fit",
    )  # fmt: skip
    assert done.status == 0, done.err
    return folder


def test_a_case_names_the_file_of_its_fitted_material(fitted):
    """From where the case lies, with its band: the numbers of the fit itself."""
    files = '[material]\nfile = "fit/fitted.toml"\n[band]\nfile = "fit/fitted.toml"\n'
    (fitted / "lifted.toml").write_text(f'{LIFTED}pressure = "0:1 kPa"\n{files}')
    case = Case.from_file(fitted / "lifted.toml")
    assert case.material.name == "ogden" and case.band.around == case.material
    assert Case.from_toml(case.to_toml()) == case
    base = '[region.base]\nfile = "fit/fitted.toml"\n'
    (fitted / "finger.toml").write_text(f'[geometry]\ndevice = "PneuNet"\n{base}[load]\npressure = "1 kPa"\n')
    assert Case.from_file(fitted / "finger.toml").components[0].material == case.material


def test_errors_of_a_sum_of_terms_are_those_of_the_fit(fitted):
    """With their correlation: as if they were independent, the band would be several times as wide."""
    errors = MaterialErrors.from_file(fitted / "fit" / "fitted.toml")
    assert errors.names == ("mu1", "alpha1", "law_form") and "covariance" in errors.how
    size = np.sqrt(np.diag(errors.matrix))
    assert errors.matrix[0, 1] / size[:2].prod() < -0.8


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ('file = "nowhere.toml"', "nowhere.toml"),
        ("file = 3", "is not a file name"),
        ('file = "fit/fitted.toml"\nlaw = "yeoh"', "already defines the law and its parameters"),
    ],
)
def test_files_that_are_no_material(fitted, table, words):
    (fitted / "wrong.toml").write_text(f'{LIFTED}pressure = "0:1 kPa"\n[material]\n{table}\n')
    with pytest.raises(CaseError, match=words):
        Case.from_file(fitted / "wrong.toml")


def test_a_case_file_is_run_with_another_material_and_its_band(fitted):
    (fitted / "plain.toml").write_text(f'{LIFTED}pressure = "0:1 kPa"\n')
    file, run = fitted / "fit" / "fitted.toml", ("-m", "softmodels", "run", fitted / "plain.toml", "--no-pictures")
    done = runs.run(*run, "--material", file, "--band", file, "--output", fitted / "run")
    assert done.status == 0 and " mm (95 %): law's form 0.0" in done.out and ", silicone 0.0" in done.out
    assert Case.from_file(fitted / "run" / "case.toml").material.name == "ogden"
    done = runs.run(*run, "--band", file)
    assert done.status == 2 and "belong to another material than the case's" in done.err


def test_a_rigid_plate_with_a_mass_needs_gravity():
    """Else its weight would be left out in silence."""
    with pytest.raises(CaseError, match=r"has a mass, but gravity has no direction; add it"):
        Case("lifted", MEMBRANE, LAW, steps=steps_of(pressure_cm=(5.0,)), components=(PLATE,))


def test_a_plate_that_is_silicone_is_told():
    """A mass on a face does not make it rigid."""
    heavy = (sm.Gravity("-z"), sm.Mass("plate", 0.02))
    soft = Case("lifted", MEMBRANE, LAW, steps=steps_of(pressure_cm=(5.0,)), components=heavy)
    assert "plate bends and stretches like the silicone in this model" in next(bonded_notes(soft))
    for part in (sm.Rigid("plate", name="plate"), sm.Clamp(face="plate", name="grip")):
        assert not list(
            bonded_notes(Case("lifted", MEMBRANE, LAW, steps=steps_of(pressure_cm=(5.0,)), components=(*heavy, part)))
        )
    ringed = sm.Membrane(rings=(0.008, 0.010), ring_thickness=0.001)
    note = next(bonded_notes(Case("ringed", ringed, LAW, steps=steps_of(pressure_cm=(5.0,)))))
    assert note.startswith("ring1 bends and stretches") and "region" in note
    held = Case("ringed", ringed, LAW, steps=steps_of(pressure_cm=(5.0,)), components=(sm.Rigid(region="ring1"),))
    assert not list(bonded_notes(held))


@pytest.mark.parametrize("name", BENCH)
def test_every_kind_of_experiment_has_an_example(name):
    case = Case.from_toml(BENCH[name])
    assert case.name == name.removesuffix(".toml") and Case.from_toml(case.to_toml()) == case


def test_the_pressure_at_a_height_and_a_weight():
    """Where the load cell that holds the plate at 8 mm shows nothing, the plate stands there by itself."""
    held = sm.run(Case.from_toml(BENCH["height.toml"]))
    weighed = held.path["load_step"] >= 2.0
    force, pressure = held.path["force_cell_N"][weighed], held.path["pressure_cm"][weighed]
    alone = float(np.interp(0.0, -force, pressure))
    text = BENCH["lifted.toml"].replace("ecoflex-00-30", "dragon-skin-10-medium")
    free = sm.run(Case.from_toml(text.replace('volume_ml = "0:30:5"', f"pressure_cm = [{alone}]")))
    assert free.path["plate_z_mm"][-1] == pytest.approx(8.0, abs=0.02)


def test_the_state_at_a_height(lifting):
    state = lifting.where("plate_z_mm", 3.0)
    assert state.row["plate_z_mm"] == pytest.approx(3.0, abs=1e-5)
    again = sm.inflate(MEMBRANE, LAW, pressures=[state.pressure], components=[PLATE, sm.Gravity("-z")])
    assert again.path["plate_z_mm"][-1] == pytest.approx(3.0, abs=1e-4)
    asked = lifting.rows[-1]
    assert lifting.where("plate_z_mm", asked["plate_z_mm"]).row == asked
    with pytest.raises(CaseError, match="no column 'height'"):
        lifting.where("height", 3.0)
    with pytest.raises(sm.RunError, match=r"no state with plate_z_mm 90: it goes from"):
        lifting.where("plate_z_mm", 90.0)
