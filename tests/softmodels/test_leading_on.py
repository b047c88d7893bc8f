"""Sentences that lead on: what to type next, where a command, a file, a device or a series of values cannot be taken."""

from __future__ import annotations

import io
import sys

import pytest
from click.testing import CliRunner

from geometries.__main__ import main as geometries_main
from measurement.__main__ import main as measurement_main
from softmodels.case.case import Case
from softmodels.case.entries import CaseError, SeriesError, of_text, series, split_text
from softmodels.cli.options import main
from softmodels.common import processes
from softmodels.path.program import ProgramError, _series


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["run"], "Missing argument 'FILE'; for example: softmodels run results/disk/case.toml |"),
        (["runn"], "there is no command 'runn'; did you mean run?"),
        (["part.step"], "'part.step' is not a command; did you mean softmodels run part.step?"),
        (["run", "--device", "PneuNett"], "did you mean PneuNet?"),
        (["run", "part.step"], "part.step is a part file, not a case"),
        (["run", "part.step"], "softmodels run --device ImportedActuator --file part.step --cavities"),
        (["run", "part.stl"], "device = 'ImportedMesh', file = 'part.stl'"),
        (["run", "csae.toml"], "No such file or directory); did you mean case.toml?"),
        (["run", "other"], "No such file or directory); softmodels examples writes some to begin with"),
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
    assert of_text("cm", "1e1 cm", "pressure", 95.1) == (10.0,)


def test_implausible_pressures_say_what_is_plausible():
    case = '[geometry]\ndevice = "Membrane"\n[load]\npressure = "1e9 cm"\n'
    with pytest.raises(
        CaseError,
        match=r"devices take about 320 cm \(30 kPa\), and at most 9461 cm is accepted; write pressures='320 cm'",
    ):
        Case.from_toml(case)


def test_a_cavitys_pressure_with_a_unit_is_told_in_cm():
    with pytest.raises(ProgramError, match=r"4 kPa are 42\.05 cm of the usual column: cavity1\.pressure_cm = 42\.05"):
        _series("cavity1", {"pressure": "4 kPa"}, {"pressure_cm": None, "volume_ml": None})


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
