"""``softmodels run --device NAME``: any registered device by its options, on one rank and on two."""

from __future__ import annotations

import pytest

from geometries import ACTUATORS
from softmodels.__main__ import softmodels
from softmodels.case.case import Case
from tests.support import runs
from tests.support.ranks import mpirun

MEMBRANE = ("-m", "softmodels", "run", "--device", "membrane", "--thickness", "2mm", "--cell-size", "2mm",
            "--pressure-cm", "0,10", "--quiet", "--no-pictures")  # fmt: skip


def test_it_runs_on_one_rank_and_on_two(tmp_path):
    """The name may be written in small letters; the folder's case names the device, and repeats the run."""
    folders = [tmp_path / "one", tmp_path / "two"]
    ended = [
        runs.run(*MEMBRANE, "--output", folder, launcher=words)
        for folder, words in zip(folders, ((), (mpirun(), "-n", "2")), strict=True)
    ]
    assert [done.status for done in ended] == [0, 0], [done.err for done in ended]
    one, two = map(runs.rows, folders)
    runs.same(two, one, 1e-6)
    assert one[-1]["pressure_cm"] == 10.0 and one[-1]["apex_mm"] > 1.0
    case = Case.from_file(folders[0] / "case.toml")
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
