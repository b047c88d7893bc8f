"""``softmodels design`` in processes of its own: stopped, killed, resumed, on two ranks; its pictures and its page."""

from __future__ import annotations

import csv
import json
import os
import signal
import time
from pathlib import Path

import pytest

from softmodels.__main__ import softmodels as whole_command
from softmodels.case.case import Case
from softmodels.pictures.offscreen import can_render
from tests.support import fake_design as fake, runs


@pytest.fixture
def place(tmp_path):
    (tmp_path / "problem.toml").write_text(fake.PROBLEM)
    return tmp_path


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """An undisturbed run from two starts: its folder, and what it said."""
    place = tmp_path_factory.mktemp("reference")
    (place / "problem.toml").write_text(fake.PROBLEM)
    return place / "out", design(place, "--no-pictures", "--starts", "2")


def environment(seconds=0.0):
    return {**os.environ, "SOFTMODELS_MODULES": fake.__file__, "FAKE_DESIGN": "1", "FAKE_SECONDS": str(seconds)}


def design(place, *words, seconds=0.0, **options):
    arguments = ("-m", "softmodels", "design", "problem.toml", "--output", "out", *words)
    return runs.run(*arguments, cwd=place, env=environment(seconds), **options)


def table(folder):
    with (folder / "iterates.csv").open() as file:
        rows = list(csv.DictReader(file))
    return [{key: value for key, value in row.items() if key != "seconds"} for row in rows]


def begun(place, count, seconds=0.3):
    """A process that has evaluated some designs, or for none of them has taken its folder."""
    process = runs.start("-m", "softmodels", "design", "problem.toml", "--output", "out", "--no-pictures", cwd=place,
                         env=environment(seconds))  # fmt: skip
    until, sign = (
        time.monotonic() + 60.0,
        place / "out" / (f"iterates/{count:04d}.json" if count else ".softmodels.lock"),
    )
    while time.monotonic() < until and not sign.exists():
        time.sleep(0.05)
    return process


@pytest.mark.campaign
def test_ctrl_c_leaves_the_best_design_so_far(place):
    process = begun(place, 3)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130 and "Traceback" not in err and "stopped by the user; so far" in out
    assert json.loads((place / "out" / "design.json").read_text())["stopped"]
    assert Case.from_file(place / "out" / "design.toml") != Case.from_file(place / "out" / "start.toml")


@pytest.mark.campaign
def test_a_killed_run_leaves_its_best_design_and_goes_on_to_the_same_end(place, reference):
    process = begun(place, 3)
    process.kill()
    process.communicate()
    stopped = Case.from_file(place / "out" / "design.toml").actuator
    assert 3 <= len(table(place / "out")) < 6 and stopped != Case.from_file(place / "out" / "start.toml").actuator
    done = design(place, "--resume", "--no-pictures", "--quiet", "--starts", "2")
    assert done.status == 0 and done.out == done.err == ""
    assert table(place / "out") == table(reference[0])  # the same designs to the last digit, none twice
    assert Case.from_file(place / "out" / "design.toml") == Case.from_file(reference[0] / "design.toml")


@pytest.mark.campaign
def test_another_program_is_kept_out(place):
    process = begun(place, 0, 60.0)
    other = design(place, "--no-pictures")
    process.kill()
    process.communicate()
    assert other.status == 2 and "out" in other.err and other.err.count("\n") == 1


@pytest.mark.campaign
def test_two_ranks_find_the_same_design_and_one_speaks(place, reference):
    folder, alone = reference
    both = design(place, "--no-pictures", "--starts", "2", launcher=("mpirun", "-n", "2"))
    assert alone.status == both.status == 0, both.err
    assert alone.out == both.out and both.err.count("design   1 ") == 1
    assert table(folder) == table(place / "out")


def test_what_cannot_be_met_ends_with_status_3(ended, place, monkeypatch):
    fake.install(monkeypatch.setattr)
    monkeypatch.chdir(place)
    Path("high.toml").write_text(fake.PROBLEM + '[[keep]]\nquantity = "rise"\nat = "177 cm"\nat_least = "12 mm"\n')
    status, out, err = ended(whole_command, "design", "high.toml", "--no-pictures", "--output", "high")
    assert status == 3 and "softmodels: the problem is infeasible, and this is the closest design" in err
    assert "rise at 177 cm at least 12 mm" in err and "are incompatible" in err and "must be at least 12 mm" in out
    Path("thin.toml").write_text(fake.PROBLEM.replace('section = "axi', 'membrane = "2.5 mm"\nsection = "axi'))
    status, out, err = ended(whole_command, "design", "thin.toml", "--no-pictures", "--output", "thin")
    assert status == 3 and "given device cannot be evaluated: the device jumps at" in err and out == ""
    assert not Path("thin/design.toml").exists()


@pytest.mark.campaign
def test_pictures_and_page(place):
    done = design(place)
    assert done.status == 0, done.err
    out = place / "out"
    drawn = {file.name for file in out.glob("*.png")}
    assert drawn >= {"paths.png", "history.png", "parameters.png", "sections.png"}
    assert ("shapes.png" in drawn) == can_render()
    page = (out / "report.html").read_text()
    assert page.count("<img") + page.count("<figure data-name") == len(drawn)
    assert "relaxing this limit by 0.05 gains" in page and "http" not in page.replace("http://www.w3.org/", "")
    runs_ = [Case.from_file(out / name / "case.toml") for name in ("before", "after")]
    assert runs_[1] == Case.from_file(out / "design.toml")
    assert runs_[0].actuator == Case.from_file(out / "start.toml").actuator
    # A further run into the folder replaces them all.
    assert design(place, "--no-pictures", "--quiet").status == 0
    assert not list(out.glob("*.png")) and not (out / "after").exists()
