"""Programs of several cavities from the case file to the table, the words and the pictures."""

from __future__ import annotations

import shutil

import pytest

from softmodels.runs.store import Results
from tests.support import runs

CASE = """
name = "pair"
[geometry]
device = "ImportedActuator"
file = "part.step"
cavities = ["at 11, 0, 2 mm", "at 11, 0, -2 mm"]
support = "x = 0 mm"
cell_size = "6 mm"
[material]
law = "neo-hookean"
shear_modulus = "30 kPa"
poisson = 0.49
[load]
"""


@pytest.fixture
def program(two_cavities, tmp_path):
    """Return a function that runs the part under the lines of a load table."""
    shutil.copy(two_cavities, tmp_path / "part.step")

    def run(load, *options):
        (tmp_path / "pair.toml").write_text(CASE + load)
        return runs.run("-m", "softmodels", "run", tmp_path / "pair.toml", "--output", tmp_path / "out", *options)

    return run


def test_a_program_runs_and_says_what_each_cavity_has(program, tmp_path):
    load = "cavity1.pressure_cm = [0, 40, 40]\ncavity2.volume_ml = [0, 0, 0.03]\n"
    done = program(load, "--no-pictures")
    assert done.status == 0, done.err
    rows = runs.rows(tmp_path / "out")
    asked = [row for row in rows if row["requested"]]
    assert [row["load_step"] for row in asked] == [0, 1, 2]
    assert [row["pressure_1_cm"] for row in asked] == pytest.approx([0, 40, 40])
    assert [row["added_volume_2_ml"] for row in asked] == pytest.approx([0, 0, 0.03], abs=1e-9)
    come = [row["load_step"] for row in rows]
    assert come == sorted(come) and len(rows) >= 9
    last = rows[-1]
    assert last["pressure_cm"] == pytest.approx(max(last["pressure_1_cm"], last["pressure_2_cm"]))
    assert last["added_volume_ml"] == pytest.approx(last["added_volume_1_ml"] + last["added_volume_2_ml"])
    assert f"cavity1 40 cm, 0.97 g/ml, cavity2 {last['pressure_2_cm']:.6g} cm, 0.97 g/ml: tip" in done.out


@pytest.mark.campaign
@pytest.mark.parametrize("band", ["", "[band]\nparameters = ['shear_modulus']\ncovariance = [[1e6]]\n"])
def test_a_program_goes_on_from_its_last_step(program, tmp_path, band):
    """Ended after a step, or in the middle of one, it comes to the states of a program that was never interrupted; with a band,
    whose derivatives come along the whole path, all is computed anew."""
    series = (("cavity1.pressure_cm", "[40, 40, 20]"), ("cavity2.volume_ml", "[0, 0.03, 0.03]"))
    whole = "".join(f"{key} = {values}\n" for key, values in series) + band
    assert program(whole, "--no-pictures", "--quiet").status == 0
    wanted = runs.rows(tmp_path / "out")
    shutil.rmtree(tmp_path / "out")
    part = "".join(f"{key} = {values.rsplit(',', 1)[0]}]\n" for key, values in series) + band
    assert program(part, "--no-pictures", "--quiet").status == 0
    # As if it had been killed two states into the second step.
    results = Results(tmp_path / "out", "pair")
    results.load()
    results.stored = results.stored[:-2]
    results.finish()
    other = program(whole.replace("40, 40", "50, 50"), "--no-pictures", "--quiet", "--resume")
    assert other.status == 2 and "other steps" in other.err
    done = program(whole, "--no-pictures", "--resume")
    assert done.status == 0 and (band or "resuming from step 1 of the program" in done.err)
    found = runs.rows(tmp_path / "out")
    bands = ["tip_ci95_mm", "pressure_2_ci95_cm"] if band else []
    assert len(found) == len(wanted) and [row["step"] for row in found] == list(range(len(found)))
    for row, expected in zip(found, wanted, strict=True):
        for name in ("load_step", "pressure_1_cm", "pressure_2_cm", "added_volume_1_ml", "tip_mm", "stored_energy_mJ", *bands):
            assert row[name] == pytest.approx(expected[name], rel=1e-8, abs=1e-10), name


@pytest.mark.campaign
def test_a_program_that_meets_a_limit_says_which_step_and_where(program, tmp_path):
    """Neo-Hookean walls blow up at some pressure, whatever the other cavity does."""
    done = program("cavity1.volume_ml = 0.02\ncavity2.pressure_cm = [0, 2000]\n", "--no-pictures")
    assert done.status == 3, done.err
    assert "no equilibrium at step 2 of the program (cavity1 0.02 ml added, cavity2 2000 cm)" in done.err
    assert "limit point with cavity1 at" in done.err and "Traceback" not in done.err
    rows = runs.rows(tmp_path / "out")
    limit = next(row for row in rows if row["limit"])
    assert f"cavity2 at {limit['pressure_2_cm']:.4g} cm" in done.err
    assert all(row["added_volume_1_ml"] == pytest.approx(0.02) for row in rows if row["load_step"] >= 1)


@pytest.mark.campaign
def test_pictures_of_a_program(program, tmp_path):
    done = program("cavity1.pressure_cm = [20, 20]\ncavity2.pressure_cm = [0, 30]\n")
    assert done.status == 0, done.err
    assert (tmp_path / "out" / "tip.png").stat().st_size > 20_000
    page = (tmp_path / "out" / "report.html").read_text()
    assert "At step 2: 20 and 30 cm, 0.97 g/ml the tip has risen" in page and "added volume of cavity2 (ml)" in page
    assert '<th scope="row">cavity2</th><td>0 cm, 30 cm</td>' in page
