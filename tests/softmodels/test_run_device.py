"""``softmodels run --device NAME``: any registered device by its options."""

from __future__ import annotations

import pytest

from geometries import ACTUATORS
from softmodels.__main__ import softmodels
from softmodels.case.case import Case
from tests.support import runs

MEMBRANE = ("-m", "softmodels", "run", "--device", "membrane", "--thickness", "2mm", "--cell-size", "2mm",
            "--pressure-cm", "0,10", "--quiet", "--no-pictures")  # fmt: skip


def test_it_runs(tmp_path):
    """The name may be written in small letters; the folder's case names the device, and repeats the run."""
    done = runs.run(*MEMBRANE, "--output", tmp_path / "one")
    assert done.status == 0, done.err
    last = runs.rows(tmp_path / "one")[-1]
    assert last["pressure_cm"] == 10.0 and last["apex_mm"] > 1.0
    case = Case.from_file(tmp_path / "one" / "case.toml")
    assert type(case.actuator).__name__ == "Membrane" and case.actuator.thickness == 0.002


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("run", "--device", "Balloons", "--pressure-cm", "1"), "--device is 'Balloons'; it must be one of"),
        (("run", "--device"), "--device is ''"),
        (("run", "--device", "Membrane"), "request either pressures"),
        (("run", "--device=Membrane", "--pressure-cm", "1", "--thickness", "1m"), "thickness is 1 m"),
        (("run", "--device", "Membrane", "--wall", "1mm"), "No such option"),
        (("run", "case.toml", "--device", "Membrane", "--pressure-cm", "1"), "unexpected argument 'case.toml'"),
        (("run",), "Missing argument 'FILE'"),
        (("run", "none.toml", "--", "--device"), "none.toml"),
    ],
)
def test_what_cannot_be_meant_is_one_sentence(ended, words, told):
    status, out, err = ended(softmodels, *words)
    assert status == 2 and told in err and err.count("\n") == 1 and not out


@pytest.mark.parametrize("name", ACTUATORS)
def test_every_device_has_its_help(ended, name):
    status, out, _ = ended(softmodels, "run", "--device", name, "--help")
    assert status == 0 and f"run --device {name} --pressure-cm {ACTUATORS[name].pressures}" in out
