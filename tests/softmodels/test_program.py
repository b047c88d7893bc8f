"""One program: groups of commands, --set for case files, completion, the same manners everywhere."""

from __future__ import annotations

import shutil
import subprocess
import sys

import click
import pytest
from click.testing import CliRunner

import softmodels as sm
from geometries.__main__ import main as geometries
from measurement.__main__ import main as measurement
from softmodels import disk, seminar
from softmodels.__main__ import softmodels
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.cli import completion
from softmodels.common import commands

CASE = '[geometry]\ndevice = "HollowDisk"\nsection = "axisymmetric"\n[load]\npressure_cm = "0:20"\nrate = "1 cm/s"\n'


@pytest.fixture
def file(tmp_path):
    (tmp_path / "case.toml").write_text(CASE)
    return tmp_path / "case.toml"


def command_named(name, group=softmodels):
    return group.get_command(click.Context(group), name)


# -- Groups ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("group", [softmodels, measurement], ids=["softmodels", "measure"])
def test_help_has_a_whole_line_for_each_command(group, monkeypatch):
    """The first sentence of its own help, under the heading of its group."""
    monkeypatch.setenv("COLUMNS", "80")
    lines = CliRunner().invoke(group, ["--help"]).output.splitlines()
    assert all(f"{heading}:" in lines for heading in group.places)
    for entries in group.places.values():
        for name, (_, text) in entries.items():
            assert command_named(name, group).get_short_help_str(1000) == text and text.endswith(".")
            assert any(line.split() == [name, *text.split()] and len(line) <= 80 for line in lines), name


def test_measurement_is_a_group_and_a_program_of_its_own():
    assert command_named("measure") is measurement
    asked = CliRunner().invoke(softmodels, ["measure", "photos", "--help"]).output
    assert asked.startswith("Usage: softmodels measure photos") and "--setup" in asked


# -- Fields of a case file ------------------------------------------------------------------------------------------------


def test_every_command_that_reads_a_case_file_can_change_its_fields():
    for name in ("run", "limit", "modes", "grasp", "fit", "score", "design", "study", "mould", "export"):
        assert any("--set" in param.opts for param in command_named(name).params), name


@pytest.mark.parametrize(
    ("changes", "same"),
    [
        (["load.pressure_cm=0:30"], CASE.replace("0:20", "0:30")),
        (["load.pressure=0:3 kPa"], CASE.replace('pressure_cm = "0:20"', 'pressure = "0:3 kPa"')),
        (["load.volume_ml=[10, 20]", "load.rate=1 ml/s"],
         CASE.replace('pressure_cm = "0:20"', "volume_ml = [10, 20]").replace("cm/s", "ml/s")),
        (["geometry.membrane = 2mm"], CASE.replace("[load]", 'membrane = "2mm"\n[load]')),
        (["gravity.direction=-z", "name=hung"], f'name = "hung"\n{CASE}[gravity]\ndirection = "-z"\n'),
        (["material.law=yeoh", "material.c1=9kPa"], f'{CASE}[material]\nlaw = "yeoh"\nc1 = "9kPa"\n'),
        (["contact.ball.shape=plane", "contact.ball.faces=top", 'contact.ball.at=["0 mm", "0 mm", "50 mm"]',
          "contact.ball.along=[0, 0, -1]"],
         f'{CASE}[contact.ball]\nshape = "plane"\nfaces = "top"\nat = ["0 mm", "0 mm", "50 mm"]\nalong = [0, 0, -1]\n'),
    ],
)  # fmt: skip
def test_a_changed_field_is_as_if_it_was_written(changes, same, file):
    assert Case.from_file(file, changes=changes) == Case.from_toml(same)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("load.pressur=0:5 kPa", "did you mean pressure"),
        ("geometry.membran=2mm", "did you mean membrane"),
        ("geomtry.membrane=2mm", "did you mean geometry"),
        ("material.law=yeho", "did you mean yeoh"),
        ("gravity.dirction=-z", "did you mean direction"),
        ("load.pressure=abc", "unknown unit"),
        ("load.pressure", "write a field and its value"),
        ("load..pressure=1 kPa", "write a field and its value"),
        (f"load.pressure={'[' * 100_000}", "characters"),
        ("load.rate.x=1", "rate is a value, not a table"),
    ],
)
def test_a_wrong_change_is_a_sentence(change, words, file):
    with pytest.raises(CaseError, match=words):
        Case.from_file(file, changes=[change])


def test_the_command_line_ends_with_that_sentence(file):
    words = [sys.executable, "-m", "softmodels", "export", str(file), "-o", "x.inp", "--set", "load.pressur=1 kPa"]
    done = subprocess.run(words, cwd=file.parent, capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "did you mean pressure" in done.stderr


def test_designs_and_studies_change_the_fields_of_their_case(file):
    text = 'case = "case.toml"\nmaximise = "lift"\n[parameters]\nmembrane = "1:3 mm"\n[[keep]]\nquantity = "x"\n'
    (file.parent / "problem.toml").write_text(text)
    with pytest.raises(sm.DesignError, match="did you mean geometry"):
        sm.DesignProblem.from_file(file.parent / "problem.toml", ["geomtry.membrane=2mm"])
    from softmodels.design.study import StudyPlan

    (file.parent / "study.toml").write_text('case = "case.toml"\n[vary]\n"geometry.membrane" = "1.8:2.2 mm"\n')
    plan = StudyPlan.from_file(file.parent / "study.toml", ["load.pressure_cm=0:7"])
    assert plan.case == Case.from_toml(CASE.replace("0:20", "0:7"))


# -- Completion -----------------------------------------------------------------------------------------------------------

ASKED = {
    "softmodels mea": ["measure"],
    "softmodels measure ph": ["photos"],
    "softmodels measure setup --grid-p": ["--grid-pitch"],
    "softmodels run --pressure-c": ["--pressure-cm"],
    "softmodels run --device Hol": ["HollowDisk"],
    "softmodels limit --material ecoflex-00-3": ["ecoflex-00-30", "ecoflex-00-35-fast"],
    "softmodels run case.toml --set geometry.membr": ["geometry.membrane="],
    "softmodels modes case.toml --set load.pressure": ["load.pressure=", "load.pressure_cm="],
    "softmodels completion fi": ["fish"],
}
BASH = """
source {file}
COMP_WORDS=({line}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); _softmodels; printf '%s\\n' "${{COMPREPLY[@]}}"
"""


@pytest.fixture(scope="module")
def scripts(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scripts")
    for shell in completion.SHELLS:
        (folder / shell).write_text(completion.script(shell, softmodels))
    return folder


@pytest.mark.parametrize("shell", ["bash", "fish"])
def test_words_are_completed(shell, scripts, tmp_path):
    if shutil.which(shell) is None:
        pytest.skip(f"needs {shell}")
    for line, words in ASKED.items():
        text = (
            BASH.format(file=scripts / shell, line=line)
            if shell == "bash"
            else f"source {scripts / shell}; complete -C '{line}'"
        )
        done = subprocess.run([shell, "-c", text], cwd=tmp_path, capture_output=True, text=True)
        assert sorted(done.stdout.split()) == words and done.stderr == "", line


def test_zsh_takes_the_script_of_bash(scripts):
    assert (scripts / "zsh").read_text() == completion.ZSH + (scripts / "bash").read_text()
    if shutil.which("zsh"):
        text = f"source {scripts / 'zsh'}; print $_comps[softmodels]"
        done = subprocess.run(["zsh", "-f", "-c", text], capture_output=True, text=True)
        assert "_softmodels" in done.stdout and done.stderr == ""


# -- Manners --------------------------------------------------------------------------------------------------------------

PROGRAMS = {
    "softmodels": softmodels, "disk": disk.command, "seminar": seminar.command, "measure": measurement,
    "geometries": geometries,
}  # fmt: skip


@pytest.mark.parametrize("program", PROGRAMS.values(), ids=PROGRAMS)
@pytest.mark.parametrize("option", ["-v", "--version"])
def test_all_programs_tell_their_version(program, option):
    assert CliRunner().invoke(program, [option]).output == f"softmodels, version {sm.__version__}\n"


@pytest.mark.parametrize("module", ["softmodels", "softmodels.disk", "softmodels.seminar", "measurement", "geometries"])
def test_all_programs_have_one_manner_of_errors(module, tmp_path):
    words = [sys.executable, "-m", module, "--no-such-option"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == "softmodels: there is no option --no-such-option (see --help)\n"


def test_errors_are_red_only_on_a_terminal(monkeypatch, capsys):
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    commands.tell("too long")
    assert capsys.readouterr().err == "softmodels: too long\n"
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    commands.tell("too long")
    assert capsys.readouterr().err == "\x1b[31m\x1b[1msoftmodels:\x1b[0m too long\n"
    for name, value in (("NO_COLOR", "1"), ("TERM", "dumb")):
        with monkeypatch.context() as patch:
            patch.setenv(name, value)
            commands.tell("too long")
        assert capsys.readouterr().err == "softmodels: too long\n"
