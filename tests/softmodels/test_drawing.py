"""The process that draws a run: ready before there is something to draw, and no loss to the results if it fails."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from softmodels.case.case import Case
from softmodels.cli import drawing as module
from softmodels.cli.drawing import Drawing
from softmodels.pictures import film, film_beside
from softmodels.pictures.film_beside import Film
from softmodels.pictures.offscreen import can_render
from softmodels.pictures.viewpoint import look
from softmodels.results.stored import States


@pytest.fixture
def section(half_section, tmp_path):
    """Made-up results that are not drawn yet, as the drawing process takes them."""
    folder = shutil.copytree(half_section, tmp_path / "results")
    return SimpleNamespace(folder=folder, name="disk")


@pytest.fixture
def drawing(section):
    found = Drawing(Case.from_file(section.folder / "case.toml"))
    yield found
    found.leave()


def test_a_process_that_was_ready_draws(section, drawing, monkeypatch, capsys):
    monkeypatch.setattr(module, "cores", lambda: 2)
    drawing.get_ready(ranks=1)
    begun = drawing._process
    assert drawing.draw(section) > 0 and drawing._process is begun
    assert (section.folder / "report.html").exists() and (section.folder / "slice.png").exists()
    assert "could not" not in capsys.readouterr().err


def test_few_pictures_are_the_curves_the_stress_and_the_report(section, runs):
    """And those that were drawn before and are not among them are taken away."""
    assert runs.run("-m", "softmodels", "draw", section.folder).status == 0
    assert {"film.gif", "cut.png"} <= {file.name for file in section.folder.iterdir()} or not can_render()
    done = runs.run("-m", "softmodels", "draw", section.folder, "--pictures", "few")
    rendered = {"stress.png", "stress-1.png", "stress-2.png"} if can_render() else set()
    names = {"apex.png", "profile.png", "slice.png", "report.html", *rendered}
    assert done.status == 0 and {Path(line).name for line in done.out.split()} == names
    assert {
        file.name for file in section.folder.iterdir() if file.suffix in (".png", ".gif", ".webp", ".html")
    } == names


@pytest.mark.parametrize("words", [("--pictures", "none"), ("--no-pictures",)])
def test_none_are_drawn_if_none_are_wanted(words, runs, tmp_path):
    disk = ("-m", "softmodels.disk", "--section=axisymmetric", "--pressure-cm=0,5", "--output", tmp_path / "disk")
    done = runs.run(*disk, *words)
    assert done.status == 0 and not list((tmp_path / "disk").glob("*.png"))


def test_a_run_tells_what_was_drawn(drawing):
    assert drawing.made == "pictures (*.png), film.gif, film.webp and report.html"
    assert Drawing(drawing.case, few=True).made == "pictures (*.png) and report.html"


def test_no_core_is_taken_from_the_solver(drawing, monkeypatch):
    monkeypatch.setattr(module, "cores", lambda: 2)
    drawing.get_ready(ranks=2)
    assert drawing._process is None


def test_a_process_that_died_meanwhile_costs_no_results(section, drawing, capsys):
    drawing._process = drawing._started()
    drawing._process.kill()
    drawing._process.wait()
    assert drawing.draw(section) is None
    said = capsys.readouterr().err
    assert said == "softmodels: the pictures could not be drawn (exit status -9); the results are complete\n"


def test_a_run_that_is_not_drawn_leaves_no_process(drawing):
    drawing._process = drawing._started()
    drawing.leave()
    assert drawing._process.returncode is not None
    drawing.leave()  # twice does no harm


def test_a_run_that_was_killed_leaves_no_process(drawing):
    """The process ends as soon as nobody can ask it any more."""
    process = drawing._started()
    process.stdin.close()
    assert process.wait(timeout=60) == 0
    process.stdout.close()
    process.stderr.close()


def _frames(shown):
    """As many frames as there are states, of one colour each."""
    return [np.full((40, 60, 3), 20 * k, dtype="uint8") for k in range(len(shown.states.rows))]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_film_made_beside_is_the_same(section, tmp_path, monkeypatch):
    monkeypatch.setattr(film, "frames", _frames)
    shown = look(States(section.folder, "disk"))
    made = []
    for beside in (False, True):
        (tmp_path / str(beside)).mkdir()
        with Film(shown, tmp_path / str(beside), beside) as found:
            made.append(found.made())
    assert made[0][1] == made[1][1] == []
    assert [file.name for file in made[0][0]] == [file.name for file in made[1][0]]
    assert [file.read_bytes() for file in made[0][0]] == [file.read_bytes() for file in made[1][0]]
    assert {"film.gif", "film.webp"} <= {file.name for file in made[1][0]}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_what_fails_beside_is_reported(section, tmp_path, monkeypatch):
    shown = look(States(section.folder, "disk"))
    monkeypatch.setattr(film, "frames", lambda shown: os._exit(7))
    with Film(shown, tmp_path, True) as found:
        assert found.made() == ([], ["the film could not be made (its process ended with status 7)"])
    monkeypatch.setattr(film, "frames", _frames)
    with Film(shown, tmp_path / "missing", True) as found, pytest.raises(OSError, match="missing"):
        found.made()


def test_a_film_nobody_waits_for_is_not_written(section, tmp_path, monkeypatch):
    monkeypatch.setattr(film, "frames", _frames)
    assert film_beside.make(look(States(section.folder, "disk")), tmp_path / "gone", lambda: False) == ([], [])
    assert not (tmp_path / "gone").exists()
