"""The process that draws a run: ready before there is something to draw, and no loss to the results if it fails."""

from __future__ import annotations

import io
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image as Picture

from softmodels.case.case import Case
from softmodels.cli import run as module
from softmodels.cli.run import DrawingProcess
from softmodels.pictures import film, offscreen
from softmodels.pictures.film import Film
from softmodels.pictures.offscreen import can_render, look
from softmodels.pictures.solid import AtRest
from softmodels.runs.store import States
from tests.support import made_up as drawings, runs


@pytest.fixture
def section(half_section, tmp_path):
    """Made-up results that are not drawn yet, as the drawing process takes them."""
    folder = shutil.copytree(half_section, tmp_path / "results")
    return SimpleNamespace(folder=folder, name="disk")


@pytest.fixture
def drawing(section):
    found = DrawingProcess(Case.from_file(section.folder / "case.toml"))
    yield found
    found.leave()


def test_a_process_that_was_ready_draws(section, drawing, monkeypatch, capsys):
    monkeypatch.setattr(module, "cores", lambda: 2)
    drawing.get_ready(ranks=1)
    begun = drawing._process
    drawing.begin(section)
    assert drawing.draw(section) > 0 and drawing._process is begun
    assert (section.folder / "report.html").exists() and (section.folder / "slice.png").exists()
    assert "could not" not in capsys.readouterr().err


def test_few_pictures_are_the_curves_the_stress_and_the_report(section):
    """And those that were drawn before and are not among them are taken away."""
    assert runs.run("-m", "softmodels", "draw", section.folder).status == 0
    rendered = {"film.gif", "cut.png"} if can_render() else set()
    assert rendered <= {file.name for file in section.folder.iterdir()}
    done = runs.run("-m", "softmodels", "draw", section.folder, "--pictures", "few")
    rendered = {"stress.png", "stress-1.png", "stress-2.png"} if can_render() else set()
    names = {"apex.png", "profile.png", "slice.png", "report.html", *rendered}
    assert done.status == 0 and {Path(line).name for line in done.out.split()} == names
    assert {
        file.name for file in section.folder.iterdir() if file.suffix in (".png", ".gif", ".webp", ".html")
    } == names


@pytest.mark.parametrize("words", [("--pictures", "none"), ("--no-pictures",)])
def test_none_are_drawn_if_none_are_wanted(words, tmp_path):
    disk = ("-m", "softmodels.disk", "--section=axisymmetric", "--pressure-cm=0,5", "--output", tmp_path / "disk")
    done = runs.run(*disk, *words)
    assert done.status == 0 and not list((tmp_path / "disk").glob("*.png"))


def test_a_run_tells_what_was_drawn(drawing):
    assert drawing.made == "pictures (*.png), film.gif, film.webp and report.html"
    assert DrawingProcess(drawing.case, few=True).made == "pictures (*.png) and report.html"


def test_no_core_is_taken_from_the_solver(drawing, monkeypatch):
    monkeypatch.setattr(module, "cores", lambda: 2)
    drawing.get_ready(ranks=2)
    assert drawing._process is None


def test_a_process_that_died_meanwhile_costs_no_results(section, drawing, capsys):
    drawing._process = drawing._started()
    drawing._process.kill()
    drawing._process.wait()
    drawing.begin(section)  # does no harm
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


def _film(folder, beside):
    with Film(beside) as found:
        found.begin(folder, "disk")
        return found.made()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_film_made_beside_is_the_same(section, monkeypatch):
    monkeypatch.setattr(film, "render_frames", _frames)
    made = []
    for beside in (False, True):
        files, left_out = _film(section.folder, beside)
        assert left_out == [] and {"film.gif", "film.webp"} <= {file.name for file in files}
        made.append({file.name: file.read_bytes() for file in files})
    assert made[0] == made[1]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_film_that_was_rehearsed_is_the_same(section, tmp_path, monkeypatch):
    """Also if there was nothing to rehearse with."""
    monkeypatch.setattr(film, "render_frames", lambda shown, count=9: _frames(shown)[:count])
    files, _ = _film(section.folder, True)
    plain = [file.read_bytes() for file in files]
    with Film(True) as found:
        found.rehearse(tmp_path / "nothing", "disk")
        found.rehearse(section.folder, "disk")
        found.begin(section.folder, "disk")
        assert [file.read_bytes() for file in found.made()[0]] == plain


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_what_fails_beside_is_reported(section, tmp_path, monkeypatch):
    monkeypatch.setattr(film, "render_frames", lambda shown: os._exit(7))
    assert _film(section.folder, True) == ([], ["the film could not be made (its process ended with status 7)"])
    monkeypatch.setattr(film, "render_frames", _frames)
    assert "holds no disk.h5" in _film(tmp_path, True)[1][0]

    def full(path, data):
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr(film, "write_bytes", full)
    with pytest.raises(OSError, match="No space left"):
        _film(section.folder, True)


def test_a_film_nobody_waits_for_is_not_written(section, tmp_path, monkeypatch):
    monkeypatch.setattr(film, "render_frames", _frames)
    assert film.make(look(States(section.folder, "disk")), tmp_path / "gone", lambda: False) == ([], [])
    assert not (tmp_path / "gone").exists()


@pytest.mark.skipif(not can_render(), reason="this machine cannot render")
def test_pictures_at_rest_are_drawn_once_and_only_of_this_device(wedge, half_section, monkeypatch):
    rest = AtRest(rendered=True)
    rest.draw_early(wedge / "nothing", "disk")
    assert rest._drawn == {}
    rest.draw_early(wedge, "disk")
    early = rest._drawn
    assert set(early) == {"undeformed", "mesh"}
    assert rest.pictures(look(States(wedge, "disk"))) is early
    other = rest.pictures(look(States(half_section, "disk")))
    assert set(other) == {"undeformed", "mesh"} and other["mesh"] != early["mesh"]


@pytest.mark.skipif(not can_render(), reason="this machine cannot render")
def test_what_is_drawn_while_a_run_goes_on_is_what_is_drawn_after_it(wedge, tmp_path):
    """The same pictures, to the byte, from orders in two steps and from the folder at once."""
    early, late = (shutil.copytree(wedge, tmp_path / name) for name in ("early", "late"))
    process = subprocess.Popen(
        [sys.executable, "-m", "softmodels.pictures.draw"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    process.stdin.write(json.dumps([str(early), "disk", False]) + "\n")
    process.stdin.flush()
    out, _ = process.communicate(json.dumps([str(early), "disk", True]) + "\n", timeout=240)
    assert process.returncode == 0 and "undeformed.png" in out
    assert drawings.command(late).returncode == 0
    stills = sorted(file.name for file in late.glob("*.png"))
    assert stills == sorted(file.name for file in early.glob("*.png"))
    assert all((early / name).read_bytes() == (late / name).read_bytes() for name in stills)


@pytest.mark.skipif(not can_render(), reason="this machine cannot render")
@pytest.mark.parametrize("draft", [False, True])
def test_lights_without_gloss_are_those_of_vtk(wedge, monkeypatch, draft):
    """And of a closed surface, what faces away changes nothing."""
    shown = look(States(wedge, "disk"))
    step = shown.states.main
    layers = shown.coloured(step, shown.scale([step]))
    camera = shown.camera([step], 480)
    with offscreen.studio(camera, draft) as shoot:
        own = shoot(layers).astype(int)
    monkeypatch.setattr(offscreen, "shade", lambda actor: None)
    (data, style), *others = layers
    assert style["culling"] == "back"
    both_sides = {key: value for key, value in style.items() if key != "culling"}
    with offscreen.studio(camera, draft) as shoot:
        glossy = shoot([(data, both_sides), *others]).astype(int)
    assert np.ptp(own) > 150, "a picture"
    different = np.abs(own - glossy).max(axis=2)
    assert (different > 1).mean() < 5e-3, "but for single pixels at edges"


def test_a_large_film_has_fewer_frames_in_its_gif(monkeypatch):
    noise = np.random.default_rng(1).integers(0, 255, (40, 60, 80, 3), dtype=np.uint8)
    monkeypatch.setattr(film, "LARGEST", 20 * 60 * 80)
    data = film.gif(list(noise))
    with Picture.open(io.BytesIO(data)) as found:
        assert 10 <= found.n_frames < 40 and len(data) <= film.LARGEST
