"""Options that mean nothing beside others are refused with status 2, and places that cannot be written before the work."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

import softmodels.cli.run
from geometries.__main__ import main as geometries
from measurement.__main__ import main as measure
from softmodels.__main__ import softmodels as whole
from softmodels.cli.options import main
from softmodels.disk import command as disk

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
    monkeypatch.setattr(softmodels.cli.run, "start", lambda *_: pytest.fail("MPI was started"))
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
