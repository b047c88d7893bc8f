"""What a user has is never overwritten: photographs, lists and setups; names of files are names, whatever letters they hold."""

from __future__ import annotations

import csv
import shutil
import types
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure

from measurement import photographer
from measurement.__main__ import main
from measurement.outline.outline import Outline
from measurement.photographer import Scene, photograph, save
from measurement.series.drawing import draw_edge
from measurement.series.witness import Refusal
from softmodels.common.folders import OwnFolder
from softmodels.common.processes import plain
from tests.support.photographs.scenes import COARSE


def run(*words):
    done = CliRunner().invoke(main, [str(word) for word in words])
    assert not isinstance(done.exception, Exception), done.exception
    return done


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """The grid, a photograph at rest, one of a dome called heights.jpg, their list and the setup."""
    folder = tmp_path_factory.mktemp("bench")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(photographer, "HEIGHTS", np.array([0.0, 4e-3]))
        patch.setattr(photographer, "SCENE", COARSE)
        photographer.make_photographs(folder)
    (folder / "IMG_0102.JPG").rename(folder / "heights.jpg")
    listing = folder / "photos.csv"
    listing.write_text(listing.read_text().replace("IMG_0102.JPG", "heights.jpg"))
    assert run("setup", folder / "IMG_0100.JPG", "--lens", "none", "-o", folder / "setup.toml").exit_code == 0
    return folder


@pytest.mark.campaign
def test_a_photograph_called_like_a_table_leaves_the_table(bench, tmp_path):
    words = ("photos", bench / "photos.csv", "--setup", bench / "setup.toml", "--jobs", "1", "--no-pictures")
    done = run(*words, "-o", tmp_path / "outlines")
    assert done.exit_code == 0 and "heights.jpg: its outline is heights_.csv" in done.output
    rows = list(csv.DictReader((tmp_path / "outlines" / "heights.csv").read_text().splitlines()))
    assert [row["file"] for row in rows] == ["IMG_0101.JPG", "heights.jpg"]
    assert Outline.from_csv(tmp_path / "outlines" / "heights_.csv").height == pytest.approx(4e-3, abs=15e-6)
    # Repeated, it replaces its own; a folder of somebody else's is refused and stays.
    (tmp_path / "outlines" / "notes.csv").write_text("mine")
    assert run(*words, "-o", tmp_path / "outlines").exit_code == 0
    assert (tmp_path / "outlines" / "notes.csv").read_text() == "mine"
    (tmp_path / "outlines" / ".softmodels.json").unlink()
    before = contents(tmp_path)
    done = run(*words, "-o", tmp_path / "outlines")
    assert done.exit_code == 2 and "'heights.csv'" in done.output and contents(tmp_path) == before


@pytest.mark.parametrize("output", [".", "", "photos.csv"])
def test_outlines_do_not_go_among_the_photographs(output, bench, tmp_path, monkeypatch):
    shutil.copytree(bench, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    before = contents(tmp_path)
    done = run("photos", "photos.csv", "-o", output, "--no-pictures", "--quiet")
    assert done.exit_code == 2 and contents(tmp_path) == before
    # Without -o each list has a folder of its own: the next number where that is taken.
    (tmp_path / "outlines").mkdir()
    (tmp_path / "outlines" / "mine.txt").write_text("mine")


@pytest.mark.campaign
def test_without_an_output_each_list_has_a_folder_of_its_own(bench, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "outlines").mkdir()
    (tmp_path / "outlines" / "mine.txt").write_text("mine")
    for _ in range(2):
        done = run("photos", bench / "photos.csv", "--setup", bench / "setup.toml", "--jobs", "1", "--no-pictures")
        assert done.exit_code == 0 and "written to outlines-2" in done.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["outlines", "outlines-2"]
    assert sorted(path.name for path in (tmp_path / "outlines").iterdir()) == ["mine.txt"]


@pytest.fixture(scope="module")
def grid():
    return photograph(Scene(), None)[0]


@pytest.mark.parametrize(
    ("name", "words", "made"),
    [
        ("setup.png", (), "setup-overlay.png"),
        pytest.param("grid.png", ("-o", "grid.toml"), "grid-overlay.png", marks=pytest.mark.campaign),
        ("grid.png", ("--overlay", "grid.png"), None),
        ("grid.png", ("-o", "grid.png"), None),
        ("grid.png", ("-o", "notes.toml"), None),
        ("grid.png", ("--overlay", "photo.png"), None),
    ],
)
def test_a_setup_never_overwrites_a_photograph(name, words, made, grid, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save(tmp_path / name, grid)
    save(tmp_path / "photo.png", grid[:50])
    (tmp_path / "notes.toml").write_text("[mine]\n")
    before = contents(tmp_path)
    for _ in range(2):  # its own it replaces
        done = run("setup", name, "--lens", "none", *words)
        after = contents(tmp_path)
        assert done.exit_code == (0 if made else 2), done.output
        assert {file: after[file] for file in before} == before
        if made is None:
            assert after == before
        else:
            assert made in done.output and Path(made) in after


def test_calibrate_never_overwrites_a_photograph_or_a_setup(grid, bench, tmp_path):
    photo, setup = tmp_path / "a.jpg", tmp_path / "setup.toml"
    save(photo, grid)
    shutil.copy(bench / "setup.toml", setup)
    before = contents(tmp_path)
    for output in (photo, setup):
        done = run("calibrate", photo, "-o", output)
        assert done.exit_code == 2 and "-o" in done.output and contents(tmp_path) == before


NAMES = [
    "5$_{$.jpg",
    "$$$.jpg",
    "a\\b$c$.jpg",
    "two\nlines.jpg",
    "-o.jpg",
    "%s{}.jpg",
    "_hidden.jpg",
    "back\\$lash$.jpg",
]


@pytest.mark.parametrize("name", NAMES)
def test_names_are_drawn_as_they_are(name, tmp_path):
    image = np.full((40, 60, 3), 200, dtype=np.uint8)
    refusal = Refusal(f"it is the same picture as {name}", Path(name))
    draw_edge(tmp_path / "edge.png", image, types.SimpleNamespace(roi=None), None, refusal, 100.0)
    assert (tmp_path / "edge.png").stat().st_size > 1000
    figure = Figure()
    axes = figure.subplots()
    axes.plot([0, 1], label=plain(name))
    (shown,) = axes.legend().get_texts()
    text, is_math = shown._preprocess_math(shown.get_text())
    assert not is_math and text.strip() == name.replace("\n", " ")


def test_a_users_file_inside_a_folder_of_results_stays(tmp_path):
    own = OwnFolder(tmp_path / "outlines", "outlines")
    for kept in ("a.png", "b.png"):
        own.take()
        edges = own.prepare() / "edges"
        edges.mkdir()
        (edges / kept).write_text("drawn")
        own.bring_in({})
        own.leave()
        (tmp_path / "outlines" / "edges" / "mine.png").write_text("mine")
    assert sorted(path.name for path in (tmp_path / "outlines" / "edges").iterdir()) == ["b.png", "mine.png"]
