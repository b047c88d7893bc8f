"""The command line: bad input is one sentence and status 2 before anything is solved, on one rank."""

from __future__ import annotations

import os
import sys

import pytest

import softmodels.cli.run
from softmodels.__main__ import softmodels as whole_command
from softmodels.disk import command
from tests.support import runs
from tests.support.ranks import mpirun

FILES = {
    "words.toml": "material yeoh",
    "law.toml": '[material]\nlaw = "rubber"\n',
    "list.toml": '[material]\nlaw = ["yeoh"]\n',
    "flat.toml": 'material = "yeoh"\n',
    "case.toml": '[geometry]\ndevice = "HollowDisk"\n[load]\npressure_cm = "0:30"\n',
    "extra.toml": '[geometry]\ndevice = "HollowDisk"\n[load]\npressure_cm = "0:30"\nspeed = 3\n',
}
PRESSURES = {
    "177:0": ["pressure", "177", "0", "low to high"],
    "0,70,70": ["pressure", "70", "twice"],
    "much": ["pressure", "'much'"],
    "0:177cm": ["pressure", "0:177cm"],
    "": ["pressure", "''"],
    "nan": ["pressure", "nan", "finite"],
    "0:inf": ["pressure", "0:inf", "finite"],
    "-5:10": ["pressure", "-5", "through 0"],
    "0:-2000": ["-2000 cm", "below absolute vacuum"],
    "0:177:0": ["pressure", "0:177:0", "step"],
    "0:177:-1": ["pressure", "0:177:-1", "step"],
    "0:177:1e-9": ["pressure", "0:177:1e-9", "larger step"],
    "1:2:3:4": ["pressure", "1:2:3:4", "from:to"],
    "0": ["pressure", "0", "add a value above 0"],
    "177e3": ["177000 cm", "30 kPa", "correct the modulus"],
}
DEVICES = {
    "--membrane=-3mm": ["membrane", "-3 mm"],
    "--cavity-radius 0mm": ["cavity_radius", "0 mm"],
    "--membrane 3": ["--membrane", "'3'", "no unit"],
    "--membrane 3mn": ["--membrane", "'3mn'", "unknown unit"],
    "--membrane 3kPa": ["--membrane", "'3kPa'", "20mm"],
    "--membrane thick": ["--membrane", "'thick'"],
    "--membrane 1e999mm": ["--membrane", "'1e999mm'", "finite"],
    "--membrane 20m": ["membrane", "20 m"],
    "--fillet 5mm": ["fillet", "5 mm", "4 mm"],
    "--cell-size 50mm": ["cell_size", "50 mm", "10 mm"],
    "--cell-size 0.02mm": ["cell_size", "0.02 mm", "cells"],
    "--angle 50deg": ["angle", "50 deg", "360"],
    "--refinement 0.5": ["refinement", "0.5"],
    "--support roof": ["--support", "'roof'", "rim"],
    "--variant moon": ["--variant", "'moon'", "shadow"],
    "--water-density 970": ["--water-density", "'970'", "kg/m^3"],
    "--water-density 1kg/m^3": ["density", "1 kg/m^3"],
}
MATERIALS = {
    "--material rubber": ["rubber", "ecoflex-00-30"],
    "--material=": ["material ''"],
    "--material none.toml": ["none.toml", "No such file"],
    "--material words.toml": ["words.toml", "TOML"],
    "--material law.toml": ["law.toml", "law 'rubber'"],
    "--material list.toml": ["list.toml", "law ['yeoh']"],
    "--material flat.toml": ["flat.toml", "[material]"],
    "--material yeoh": ["yeoh", "c1", "--c1"],
    "--material yeoh --c1 8kPa --mu 3kPa": ["yeoh", "'mu'"],
    "--material ogden --mu 3kPa,4kPa --alpha 2": ["ogden", "2 values of mu", "1 of alpha"],
    "--material gent --shear-modulus 30kPa --limit 0": ["gent", "limit", "0"],
    "--young 30kPa --shear-modulus 10kPa": ["young", "shear_modulus"],
    "--young 30kPa --poisson=-1": ["poisson", "-1"],
    "--poisson 0.6": ["poisson", "0.6"],
    "--poisson 0.5 --formulation displacement": ["poisson", "0.5", "mixed"],
    "--shear-modulus=-30kPa": ["shear modulus", "-30000 Pa"],
    "--shear-modulus 30": ["shear_modulus", "'30'", "no unit"],
    "--shear-modulus 30Pa": ["shear modulus", "30 Pa", "units"],
    "--shear-modulus 30GPa": ["shear modulus", "3e+10 Pa", "units"],
    "--material yeoh --c1 7859MPa": ["shear modulus", "1.572e+10 Pa", "units"],
    "--material ecoflex-00-30 --c1 8kPa": ["--c1 would mix", "leave out --c1"],
}
OTHERS = {
    "--supply syringe --stroke-ml 0:10": ["--stroke-ml", "one of these"],
    "--supply syringe": ["--supply syringe", "--stroke-ml"],
    "--gas adiabatic": ["--gas", "--supply syringe"],
    "--load-unload --control volume": ["--load-unload", "--control"],
    "--volume-ml 0:3": ["--pressure-cm", "--volume-ml", "one of these"],
    "--inflate": ["--inflate"],
    "--membrane": ["--membrane", "argument"],
    "--control speed": ["--control", "'speed'", "volume"],
    "--formulation stress": ["--formulation", "'stress'", "mixed"],
    "--solver stress": ["--solver", "'stress'", "iterative"],
    "177": ["'177'", "argument"],
    "-- -options_file none.petsc": ["-options_file", "none.petsc"],
}
VOLUMES = {
    "": ["--pressure-cm", "--volume-ml"],
    "--volume-ml 0:3 --control pressure": ["volume", "pressure", "--control"],
    "--volume-ml 0:3e6": ["3e+06 ml", "cavity"],
    "--volume-ml 3:0": ["volume", "3", "0"],
}
CASES = {
    "run": ["FILE"],
    "run none.toml": ["none.toml", "No such file"],
    "run .": ["folder"],
    "run words.toml": ["words.toml", "TOML"],
    "run extra.toml": ["extra.toml", "'speed'", "[load]"],
    "run case.toml more": ["'more'"],
    "run case.toml --pressure-cm 0:3": ["--pressure-cm"],
    "inflate": ["inflate"],
}
ALL = [
    *((command, [f"--pressure-cm={text}"], words) for text, words in PRESSURES.items()),
    *((command, ["--pressure-cm=0:177", *text.split()], words) for text, words in DEVICES.items()),
    *((command, ["--pressure-cm=0:177", *text.split()], words) for text, words in MATERIALS.items()),
    *((command, ["--pressure-cm=0:177", *text.split()], words) for text, words in OTHERS.items()),
    *((command, text.split(), words) for text, words in VOLUMES.items()),
    *((whole_command, text.split(), words) for text, words in CASES.items()),
]


@pytest.fixture
def says(tmp_path, monkeypatch, ended):
    """Return a function that runs a command in an empty folder and gives its exit status and what it said."""
    monkeypatch.chdir(tmp_path)
    return lambda asked, arguments: ended(asked, *arguments)


@pytest.mark.parametrize(("asked", "arguments", "words"), ALL, ids=[" ".join(arguments) for _, arguments, _ in ALL])
def test_bad_input_is_one_sentence_before_anything_is_run(asked, arguments, words, says, monkeypatch, tmp_path):
    monkeypatch.setattr(softmodels.cli.run, "run", lambda *_, **__: pytest.fail("the run was started"))
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    status, out, err = says(asked, arguments)
    assert status == 2 and out == ""
    assert err.startswith("softmodels: ") and err.count("\n") == 1 and "Traceback" not in err
    assert all(word in err for word in words), err
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(FILES)


@pytest.mark.parametrize("folder", ["taken", "taken/inside", "/proc/none", "/dev/null"])
def test_a_folder_that_cannot_be_written_is_refused(folder, says, tmp_path):
    (tmp_path / "taken").write_text("a file")
    status, out, err = says(command, ["--pressure-cm=0:177", "--ranks=1", "--output", folder])
    assert status == 2 and out == "" and err.count("\n") == 1
    assert folder in err and "cannot be written" in err
    assert (tmp_path / "taken").read_text() == "a file" and len(list(tmp_path.iterdir())) == 1


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission_is_refused(says, tmp_path):
    (tmp_path / "locked").mkdir(mode=0o500)
    status, _, err = says(command, ["--pressure-cm=0:177", "--output", "locked/disk"])
    assert status == 2 and "locked/disk" in err and "Permission denied" in err


OTHER_RUNS = {
    "--membrane 5mm": "another actuator",
    "--material ecoflex-00-30": "another material",
    "--control volume": "another control",
    "--water-density 1g/ml": "another water_density",
    "--formulation displacement --poisson 0.49": "another ",
}


@pytest.mark.parametrize(("options", "words"), OTHER_RUNS.items(), ids=OTHER_RUNS)
def test_no_run_goes_on_from_another_one(options, words, says, whole_copy):
    before = {path: path.read_bytes() for path in whole_copy.iterdir()}
    basic = ["--pressure-cm=0:177:5", "--section=axisymmetric", "--output", whole_copy, "--resume"]
    status, out, err = says(command, [*basic, *options.split()])
    assert status == 2 and out == "" and err.count("\n") == 1
    assert words in err and str(whole_copy) in err
    assert {path: path.read_bytes() for path in whole_copy.iterdir()} == before


@pytest.mark.parametrize(("load", "words"), [("--pressure-cm=0:177:3", "3 cm"), ("--volume-ml=0:3", "pressures")])
def test_no_run_goes_on_to_values_it_has_passed(load, words, says, whole_copy):
    basic = [load, "--section=axisymmetric", "--output", whole_copy, "--resume"]
    status, _, err = says(command, basic)
    assert status == 2 and err.count("\n") == 1 and words in err and "--resume" in err


def test_help_shows_what_can_be_asked(says):
    status, out, err = says(command, ["--help"])
    assert status == 0 and err == ""
    assert all(word in out for word in ("--pressure-cm", "0:177:10", "--membrane", "--c10", "mpirun", "-snes_monitor", "130"))
    status, out, err = says(whole_command, [])
    assert status == 2 and err == "" and out.startswith("Usage:") and "run" in out


def test_only_the_first_rank_speaks(says, monkeypatch):
    monkeypatch.setenv("PMI_RANK", "1")
    monkeypatch.setattr(sys, "stdout", sys.stdout)  # the command puts another in its place
    assert says(command, ["--pressure-cm=177:0"]) == (2, "", "")
    assert says(command, ["--help"]) == (0, "", "")


def test_bad_input_in_a_process_of_its_own(tmp_path):
    done = runs.disk(tmp_path / "disk", "--pressure-cm", "0:177", "--membrane", "3")
    assert done.status == 2 and done.out == "" and done.err.count("\n") == 1 and "'3' has no unit" in done.err
    assert not (tmp_path / "disk").exists()


def test_bad_input_on_two_ranks_is_said_once(tmp_path):
    done = runs.disk(tmp_path / "disk", "--pressure-cm", "177:0", launcher=[mpirun(), "-n", "2"])
    assert done.status == 2 and done.out == "" and done.err.count("\n") == 1 and "falls from 177 to 0" in done.err
