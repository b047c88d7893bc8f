"""Options that mean nothing beside others are refused with status 2, and places that cannot be written before the work."""

from __future__ import annotations

import io
import sys

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

import softmodels.cli.run
from geometries.__main__ import main as geometries, main as geometries_main
from measurement.__main__ import main as measure, main as measurement_main
from softmodels.__main__ import softmodels as whole
from softmodels.case.case import Case
from softmodels.case.entries import CaseError, SeriesError, of_text, series, split_text
from softmodels.case.load import load_table, steps_of
from softmodels.cli.ending import main
from softmodels.common import processes
from softmodels.common.units import COLUMN
from softmodels.disk import command as disk
from softmodels.path.steps import StepError, courses

CASE = '[geometry]\ndevice = "HollowDisk"\nsection = "axisymmetric"\n[load]\n'
SECTION = ["--pressure-cm=0:10", "--section=axisymmetric"]
CYCLE = ["--pressure-cm=0:10", "--load-unload", "--branch"]
GRID = ["setup", "grid.png", "--lens=none"]
MEANINGLESS = [
    (disk, ["--pressure-cm=0:10", "--contact-stiffness=300"], "needs faces"),
    (disk, [*SECTION, "--angle=90deg"], "--angle has no effect with --section axisymmetric"),
    (disk, [*SECTION, "--azimuth=10deg"], "--azimuth has no effect with --section axisymmetric"),
    (disk, [*SECTION, "--contact=top"], "needs faces"),
    (disk, [*SECTION, "--film", "--no-pictures"], "--film has no effect"),
    (disk, CYCLE, "--branch"),
    (whole, ["run", "program.toml", "--branch"], "--branch is not available with a series for each cavity"),
    (whole, ["limit", "--variant=shadow", "--samples=8"], "give one with --vary"),
    (whole, ["limit", "--variant=shadow", "--normal"], "give one with --vary"),
    (whole, ["limit", "--variant=shadow", "--angle=90deg"], "--angle has no effect"),
    (whole, ["limit", "case.toml", "--angle=90deg"], "--angle has no effect"),
    (whole, ["fit", "case.toml", "heights.csv", "--stretch=1:2"], "--stretch applies to curves only"),
    (whole, ["fit", "case.toml", "heights.csv", "--gauge-length=33mm"], "--gauge-length applies to curves only"),
    (whole, ["fit", "case.toml", "heights.csv", "--stress-error=2%+1kPa"], "--stress-error applies to curves only"),
    (whole, ["fit", "--tensile=pull.csv", "--material=yeoh,gent", "--fix=c33=0Pa"], "no parameter 'c33'"),
    (whole, ["curve", "--material=ecoflex-00-30", "--cross-section=18mm^2"], "--cross-section applies to curves only"),
    (geometries, ["HollowDisk", "--section=axisymmetric", "--angle=90deg", "-o", "a.msh"], "--angle has no effect"),
    (measure, [*GRID, "--pattern=9x6"], "--pattern has no effect with --target grid"),
    (measure, [*GRID, "--marker-share=0.5"], "--marker-share has no effect with --target grid"),
    (measure, [*GRID, "--target=chessboard", "--dictionary=DICT_4X4_50"], "--dictionary has no effect with --target"),
    (measure, [*GRID, "--focal=35mm"], "--focal has no effect with --lens none"),
    (measure, [*GRID, "--camera=Canon"], "--camera has no effect with --lens none"),
    (measure, [*GRID, "--scale=75px/mm", "--grid-pitch=9mm"], "--grid-pitch has no effect with --scale"),
    (measure, [*GRID, "--point=1,2=3mm,4mm", "--origin=1,1"], "--origin has no effect with --point"),
]
UNWRITABLE = [
    (whole, ["limit", "--variant=shadow", "-o", "taken/limit"]),
    (whole, ["fit", "--tensile=pull.csv", "-o", "taken/fit"]),
    (whole, ["curve", "--material=ecoflex-00-30", "-o", "taken/curve"]),
    (whole, ["demo", "-o", "taken/demo"]),
    (measure, ["setup", "grid.png", "--lens=none", "--scale=75px/mm", "-o", "taken/setup.toml"]),
    (measure, ["calibrate", "grid.png", "-o", "taken/camera.toml"]),
    (measure, ["photos", "photos.csv", "--setup=setup.toml", "-o", "taken/outlines"]),
    (measure, ["demo", "-o", "taken/demo"]),
    (geometries, ["HollowDisk", "-o", "taken/a.msh"]),
]
MISSING = [
    (whole, ["run", "none.toml"]),
    (whole, ["limit", "none.toml"]),
    (whole, ["fit", "none.toml", "a.csv"]),
    (whole, ["fit", "case.toml", "none.csv"]),
    (whole, ["fit", "case.toml", "--heights=none.csv"]),
    (whole, ["fit", "--tensile=none.csv"]),
    (whole, ["curve", "--material=none.toml"]),
    (whole, ["draw", "none"]),
    (disk, ["--pressure-cm=0:10", "--material=none.toml"]),
    (measure, ["setup", "none.png", "--lens=none"]),
    (measure, ["setup", "grid.png", "--lens=none.toml"]),
    (measure, ["photos", "none.csv"]),
    (measure, ["photos", "photos.csv", "--setup=none.toml"]),
]


@pytest.fixture
def ends(tmp_path, monkeypatch, capsys):
    """Return a function that runs a command in a folder with some files and gives its status and what it printed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(softmodels.cli.run, "mpi", None)  # a run that starts fails
    cv2.imwrite("grid.png", np.full((40, 60, 3), 200, np.uint8))
    rows = "\n".join(f"{1 + k / 20},{k * 600}" for k in range(1, 30))
    (tmp_path / "pull.csv").write_text(f"stretch,stress (Pa)\n1,0\n{rows}\n")
    (tmp_path / "case.toml").write_text(f"{CASE}pressure_cm = 20\n")
    (tmp_path / "program.toml").write_text(f"{CASE}cavity1.pressure_cm = [0, 20]\n")
    (tmp_path / "photos.csv").write_text("file,pressure\ngrid.png,0 cm\n")
    (tmp_path / "taken").write_text("a file")
    done = CliRunner().invoke(measure, ["setup", "grid.png", "--lens=none", "--scale=75px/mm", "--overlay=overlay.png"])
    assert done.exit_code == 0, done.output
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def end(asked, arguments):
        if asked in (measure, geometries):
            done = CliRunner().invoke(asked, arguments)
            assert not isinstance(done.exception, Exception), done.exception
            status, told = done.exit_code, done.stderr
        else:
            monkeypatch.setattr("sys.argv", ["softmodels", *arguments])
            with pytest.raises(SystemExit) as stop:
                main(asked)
            status, told = stop.value.code, capsys.readouterr().err
        assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
        return status, told

    return end


@pytest.mark.parametrize(("asked", "arguments", "words"), MEANINGLESS, ids=[" ".join(case[1]) for case in MEANINGLESS])
def test_options_without_a_meaning(asked, arguments, words, ends):
    status, told = ends(asked, arguments)
    assert status == 2 and words in told, told


@pytest.mark.parametrize(("asked", "arguments"), UNWRITABLE, ids=[" ".join(case[1]) for case in UNWRITABLE])
def test_places_that_cannot_be_written(asked, arguments, ends):
    status, told = ends(asked, arguments)
    assert status == 2 and "taken" in told and "cannot be written" in told and told.count("\n") == 1, told


@pytest.mark.parametrize(("asked", "arguments"), MISSING, ids=[" ".join(case[1]) for case in MISSING])
def test_files_that_are_not_there(asked, arguments, ends):
    status, told = ends(asked, arguments)
    assert status == 2 and "none" in told and told.count("\n") == 1, told


# -- Sentences that lead on: what to type next, where a command, a file, a device or a series of values cannot be ta--


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["run"], "Missing argument 'FILE'; for example: softmodels run results/disk/case.toml |"),
        (["runn"], "there is no command 'runn'; did you mean run?"),
        (["part.step"], "'part.step' is not a command; did you mean softmodels run part.step?"),
        (["run", "--device", "PneuNett"], "did you mean PneuNet?"),
        (["run", "part.step"], "part.step is a part file, not a case"),
        (["run", "part.step"], "softmodels run --device ImportedActuator --file part.step --support"),
        (["run", "part.stl"], "device = 'ImportedMesh', file = 'part.stl'"),
        (["run", "leaf.svg"], "leaf.svg is a drawing, not a case"),
        (["run", "leaf.svg"], "softmodels run --device ChannelPlate --network leaf.svg --support"),
        (["run", "csae.toml"], "No such file or directory; did you mean case.toml?"),
        (["run", "ab.toml"], "No such file or directory; softmodels examples writes some to begin with"),
        (["run", "other"], "No such file or directory; softmodels examples writes some to begin with"),
        (["run", "results"], "it is a results folder; its case file is results/case.toml"),
    ],
)
def test_commands_say_what_to_type(words, told, tmp_path, monkeypatch, capsys):
    from softmodels.__main__ import softmodels

    monkeypatch.chdir(tmp_path)
    (tmp_path / "case.toml").touch()
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "case.toml").touch()
    monkeypatch.setattr(sys, "argv", ["softmodels", *words])
    with pytest.raises(SystemExit) as ended:
        main(softmodels)
    said = capsys.readouterr().err
    assert ended.value.code == 2 and told in said and said.count("\n") == 1


@pytest.mark.parametrize(
    ("group", "word", "told"), [(measurement_main, "calibrat", "calibrate"), (geometries_main, "Balooon", "Balloon")]
)
def test_other_groups_do_too(group, word, told):
    done = CliRunner().invoke(group, [word])
    assert done.exit_code == 2 and f"there is no command '{word}'; did you mean {told}?" in done.stderr


@pytest.mark.parametrize(
    ("read", "told"),
    [
        (lambda: of_text("cm", "0:34kPa:3kPa", "pressure", 95.1), "--pressure '0:34:3 kPa'|pressures='0:34:3 kPa'"),
        (lambda: series("4 kPa", "pressure"), "pressures='4 kPa'|--pressure '4 kPa'"),
        (lambda: series("0:3kPa:1cm", "pressure"), "give all values in one unit .kPa or cm., once, at the end"),
        (
            lambda: series("0,-5,3", "pressure"),
            r"both -5 and 3; write what goes through 0 as a series in a case file, such as cavity1.pressure_cm = .0, -5, 3.",
        ),
        (lambda: series("0,-5,-3", "volume"), "volume rises from -5 to -3; give the values from high to low"),
        (lambda: series("0:-5", "stroke"), "stroke -5 is negative; give values of 0 or more"),
        (lambda: series("30 cm", "pressure"), "once, at the end of the text: (pressures=|--pressure )'30 cm'"),
        (
            lambda: series("1e9 cm", "pressure"),
            "9.*e.07 kPa is too high: silicone devices take 1 to 100 kPa, about 10 to 1000 cm .*'0:30 kPa'",
        ),
        (lambda: series("0:2 MPa", "pressure"), "2000 kPa is too high"),
        (lambda: series("a,b", "pressure"), "write 0:177, 0:177:10 or 0,70,130,177"),
    ],
)
def test_series_say_how_they_are_written(read, told):
    with pytest.raises(SeriesError, match=told):
        read()


def test_exponents_are_no_units():
    assert split_text("1e9 cm") == ("1e9", "cm") and split_text("0:2.5e-1kPa") == ("0:2.5e-1", "kPa")
    (value,) = of_text("cm", "1e1 cm", "pressure", 95.1)
    assert value == 951.0 and (value.number, value.unit) == (10.0, "cm")


def test_implausible_pressures_say_what_is_plausible():
    case = '[geometry]\ndevice = "Membrane"\n[load]\npressure = "1e9 cm"\n'
    with pytest.raises(
        CaseError,
        match=r"devices take about 320 cm \(30 kPa\), and at most 9461 cm is accepted; write pressures='320 cm'",
    ):
        Case.from_toml(case)


def test_a_cavitys_pressures_may_have_units():
    given = {"cavity1": {"pressure": ["4 kPa", "20 cm"]}}
    (steps,) = courses(steps_of(**given))
    assert steps.values == (4000.0, 20 * COLUMN.pascal) and load_table(steps_of(**given)) == given
    with pytest.raises(StepError, match=r"cavity1\.pressure 4 has no unit"):
        steps_of(cavity1={"pressure": 4})


def test_sentences_are_wrapped_on_terminals_only(monkeypatch):
    text = "softmodels: " + "a sentence with --pressure-cm and results/folder-of-mine " * 4
    for name in processes.COLUMNS.values():
        monkeypatch.delenv(name, raising=False)
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    processes.say(text, err=True)
    assert stream.getvalue().count("\n") == 1
    monkeypatch.setenv(processes.COLUMNS["stderr"], "60")
    processes.say(text, err=True)
    lines = stream.getvalue().splitlines()[1:]
    assert len(lines) > 3 and max(map(len, lines)) <= 60 and all(line.startswith("  ") for line in lines[1:])
    assert " ".join(" ".join(lines).split()) == " ".join(text.split()) and sum("--pressure-cm" in x for x in lines) > 2
