"""``softmodels examples``, and that every command of the README can be pasted: it parses, and the files it names are there."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.util
import itertools
import re
import shlex
import shutil
from pathlib import Path

import click
import numpy as np
import pytest
from PIL import Image

import softmodels as sm
from geometries import HollowDisk
from geometries.__main__ import main as geometries
from measurement import outlines
from measurement.__main__ import main as measurement
from measurement.cli import photos as measurement_demo
from measurement.photographer import chessboard, photograph
from softmodels import disk, seminar
from softmodels.__main__ import softmodels
from softmodels.case.case import Case
from softmodels.cli import examples
from softmodels.common.folders import OwnFolderError
from softmodels.fitting.problem import FitOptions, LawChoice
from softmodels.materials.specimens import nominal_stress
from softmodels.mechanics.mpi import start
from tests.support import example_files, pages
from tests.support.tables import read_curve

TOP = Path(__file__).parents[2]
PAGES = [TOP / "README.md", *sorted((TOP / "docs" / "pages").rglob("*.md"))]
FILE = re.compile(r"\.(toml|csv|jpg|step|msh)$|/")


def commands_of(page):
    """Words of every command in a page's sh blocks, in order."""
    return [shlex.split(line, comments=True) for line in pages.pasted(page)]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The examples, as the command writes them."""
    return examples.write_examples(tmp_path_factory.mktemp("fresh") / "examples")


def test_every_command_on_pages_parses_and_finds_its_files(written, monkeypatch):
    monkeypatch.chdir(written.path.parent)
    count = 0
    for page in PAGES:
        made: set[str] = set()  # each page stands by itself
        for words in commands_of(page):
            assert words[:2] == ["uv", "run"], words
            rest = words[4:] if words[2] in ("--extra", "--group") else words[2:]
            if rest[0] == "mpirun":
                rest = rest[3:]
            rest = rest[: rest.index(">")] if ">" in rest else rest
            if rest == ["softmodels", "examples"] or rest[0] in ("pytest", "--with"):
                continue
            if rest[:2] == ["python", "-m"] and rest[2].startswith("tests."):  # the checkout's own, with argparse
                assert importlib.util.find_spec(rest[2]), words
                continue
            _check_files(rest, written.path.parent, made)
            _parse(rest, words)
            made |= _outputs(rest)
            count += 1
    assert count > 35


def _outputs(words):
    given = {after for word, after in itertools.pairwise(words) if word in ("-o", "--output")}
    made = {"results/fit"} if words[:2] == ["softmodels", "fit"] else set()
    return given or (made | ({"results/disk"} if "softmodels.disk" in words else set()))


def _check_files(words, folder, made):
    """Every file that a command reads is an example or was made by a command before."""
    before = ""
    for word in words[1:]:
        named = FILE.search(word) and not word.startswith("-") and "+-" not in word and before not in ("-o", "--output")
        none = re.search(r"\d(N/m|\w+/s)$", word) or (before == "--material" and not word.endswith(".toml"))
        if named and not none:
            known = any(word.rstrip("/") == place or word.startswith(f"{place}/") for place in made)
            if not known:
                assert list(folder.glob(word)), f"{' '.join(words)}: there is no {word}"
        before = word


def _parse(words, line):
    """Let click read the options, without running anything."""
    words = [str(path) for word in words for path in (sorted(Path().glob(word)) if "*" in word else [word])]
    tree = {"softmodels": softmodels, "measurement": measurement, "geometries": geometries}
    if words[0] == "softmodels":
        command, words = softmodels, words[1:]
    else:
        assert words[:2] == ["python", "-m"], line
        modules = {"softmodels.disk": disk.command, "softmodels.seminar": seminar.command, **tree}
        command, words = modules[words[2]], words[3:]
    while isinstance(command, click.Group):
        command, words = command.get_command(click.Context(command), words[0]), words[1:]
        assert command is not None, line
    if "--help" not in words:
        command.make_context("readme", words)


def test_a_command_that_names_a_missing_file_is_noticed(written, tmp_path):
    with pytest.raises(AssertionError, match="mypart"):
        _check_files(["softmodels", "run", "mypart.toml"], tmp_path, set())
    with pytest.raises(click.ClickException):
        _parse(["softmodels", "fit", "--no-such-option"], "")


def test_the_two_demonstrations_take_folders_of_their_own(monkeypatch, capsys):
    taken = []

    def refuse(output, default, *_):
        taken.append(default)
        raise OwnFolderError("noted")

    monkeypatch.setattr(examples.commands, "open_place", refuse)
    for module in (examples, measurement_demo):
        with contextlib.suppress(SystemExit, click.ClickException):
            module.demo.main([], standalone_mode=False)
    assert len(taken) == len(set(taken)) == 2
    text = "".join(page.read_text() for page in PAGES)
    assert f"{taken[0]}/" in text and f"{taken[1]}/outlines" in text


def test_the_cases_are_cases_and_the_part_has_its_cavities(written):
    cases = {path.stem: Case.from_file(path) for path in written.path.glob("*.toml")}
    kinds = {case.quantity for case in cases.values()}
    assert kinds == {"pressure", "volume", "stroke", "step", "force", "travel"} and cases["cycle"].load_unload
    assert [part.where for name in ("contact", "sheet") for part in cases[name].components] == ["[contact]", "[sheet]"]
    assert cases["disk"].actuator == HollowDisk(section="axisymmetric")
    volumes = cases["program"].actuator.cavity_volume
    assert volumes == pytest.approx(2 * 10e-3 * 6e-3 * 2e-3, rel=1e-6)
    finger = cases["mypart"].actuator
    assert not finger.cavities and finger.cavity_volume == pytest.approx(72e-3 * 9e-3 * 6e-3, rel=0.1)  # rounded


@pytest.mark.campaign
def test_the_imported_part_bends(written):
    """Its gauge is where it moves: on a coarse mesh its tip rises by a tenth of its length."""
    case = Case.from_file(written.path / "mypart.toml")
    coarse = dataclasses.replace(case.actuator, cell_size=0.008, curvature=4.0)
    run = sm.inflate(coarse, case.material, pressures=f"0,20,{case.values[-1].number} cm")
    assert run.tip[-1] > 0.008


def test_the_tensile_curve_is_of_the_silicone_in_the_photographs(written):
    curve = read_curve(written.path / "pull.csv")
    law = LawChoice.from_text(examples.TRUTH.law).material(examples.TRUTH.values)
    off = curve.stress - nominal_stress(law, curve.stretch)
    assert np.sqrt(np.mean(off**2)) == pytest.approx(example_files.STRESS_NOISE, rel=0.15)
    assert "computed, not measured" in (written.path / "pull.csv").read_text()


def test_a_fit_takes_the_silicone_of_the_photographs_for_as_incompressible_as_it_is(written):
    """So that no command on the pages needs ``--poisson`` for the examples."""
    told = (written.path / "truth.txt").read_text()
    assert told.startswith(example_files.told_truth())
    assert float(re.search(r"Poisson's ratio ([\d.]+)", told)[1]) == FitOptions().poisson
    lines = [line for page in PAGES for line in page.read_text().splitlines() if "fit examples/disk.toml" in line]
    assert len(lines) >= 4 and not [line for line in lines if "--poisson" in line]


def test_no_file_of_the_user_is_touched(written, tmp_path):
    folder = Path(shutil.copytree(written.path, tmp_path / "examples"))
    mine = folder / "pull.csv"
    mine.write_text("mine")
    (folder / "volume.toml").unlink()
    again = examples.write_examples(folder)
    assert mine.read_text() == "mine" and mine in again.kept
    assert [path.name for path in again.written] == ["volume.toml"]


@pytest.mark.parametrize("count", [1, 30, 50, 67])
def test_what_an_interrupted_command_left_out_is_written_by_the_next(count, written, tmp_path, monkeypatch):
    """Also in the middle of a file: none is there in part."""
    counter, replace = itertools.count(), Path.replace

    def cut_off(self, other):
        if next(counter) == count:
            raise KeyboardInterrupt
        return replace(self, other)

    folder = tmp_path / "examples"
    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", cut_off)
        with pytest.raises(KeyboardInterrupt):
            examples.write_examples(folder)
    assert len(files_in(folder)) == count
    examples.write_examples(folder)
    assert files_in(folder) == files_in(written.path)


def files_in(folder):
    """The bytes of all files by their names."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_what_comes_with_the_package_is_small_and_whole(written):
    """And is in no folder that version control or a wheel leave out."""
    assert sum(len(data) for data in files_in(examples.MADE).values()) <= 3_000_000
    assert {path.suffix for path in examples.MADE.rglob("*") if path.is_file()} == {
        ".JPG", ".csv", ".jpg", ".step", ".txt"
    }  # fmt: skip


@pytest.mark.campaign
def test_the_photographs_are_those_that_the_code_renders(tmp_path):
    """One of the board and the one of the grid, the bytes of which depend on the version of the JPEG library only."""
    scene = list(example_files.board_scenes())[2]
    rendered = {
        "boards/board03.jpg": chessboard(scene, side=example_files.SQUARE_SIDE, seed=3),
        "photographs/grid.jpg": photograph(example_files.bench(), None, seed=100)[0],
    }
    for name, image in rendered.items():
        file = example_files.shipped(tmp_path / "again.jpg", image)
        again, kept = (np.asarray(Image.open(path), dtype=float) for path in (file, examples.MADE / name))
        assert again.shape == kept.shape and np.abs(again - kept).mean() < 0.05


def test_the_tables_are_those_that_the_code_computes():
    made = {
        "pull.csv": example_files.tensile_curve(),
        **{f"{name}.csv": example_files.memory_curve(getattr(example_files, name.upper()), seed)
           for seed, name in enumerate(("cycles", "hold", "fast"), 31)},
    }  # fmt: skip
    for name, text in made.items():
        kept, again = ((examples.MADE / name).read_text(), text)
        numbers = [[float(x) for line in one.splitlines()[2:] for x in line.split(",")] for one in (kept, again)]
        assert numbers[0] == pytest.approx(numbers[1], abs=1.1e-4), name


@pytest.fixture(scope="module")
def bench_setup(written):
    """The setup of the README's commands: lens and screen."""
    place = written.path.parent
    with contextlib.chdir(place):
        measure("calibrate", *sorted(map(str, written.path.glob("boards/*.jpg"))), "--pattern", "9x6", "--pitch", "25mm",
                "-o", "lens.toml")  # fmt: skip
        measure("setup", "examples/photographs/grid.jpg", "--grid-pitch", "9mm", "--lens", "lens.toml", "-o", "setup.toml")
    return place / "setup.toml"


def measure(*words):
    with contextlib.suppress(SystemExit):
        measurement.main(words, standalone_mode=False)


@pytest.mark.campaign
@pytest.mark.parametrize("name", ["photographs", "held"])
def test_the_photographs_give_the_heights_of_the_disk_in_them(name, written, bench_setup):
    """Each one is measured and trusted, and its error is what it states."""
    found = outlines(written.path / name / "photos.csv", bench_setup)
    assert not found.refused and [outline.reasons for outline in found.outlines] == [()] * len(found.outlines)
    halves = examples.inflated(examples.TRUTH, start())[1] if name == "photographs" else example_files.creeping()[1]
    true = np.array([0.0, *(half[:, 1].max() for half in halves)])
    off = np.array([outline.height for outline in found.outlines]) - true
    assert np.all(np.abs(off) < 3 * np.array([outline.height_error for outline in found.outlines]) + 2e-6)


def test_boards_and_photographs_are_there(written):
    names = {path.relative_to(written.path).as_posix() for path in written.path.rglob("*") if path.is_file()}
    assert {
        "photographs/grid.jpg",
        "photographs/photos.csv",
        "mypart.step",
        "twopart.step",
        "armpart.step",
        "accordion.step",
        "press.step",
        "README.txt",
        "truth.txt",
    } <= names
    assert len([name for name in names if name.startswith("boards/")]) == len(example_files.POSES)
    listed = (written.path / "photographs" / "photos.csv").read_text().splitlines()[1:]
    assert len(listed) == 10 and all(f"photographs/{line.split(',')[0]}" in names for line in listed)
