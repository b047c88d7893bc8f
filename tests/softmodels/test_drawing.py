"""The process that draws a run: ready before there is something to draw, and no loss to the results if it fails."""

from __future__ import annotations

import io
import json
import os
import shutil
import subprocess
import sys
from concurrent.futures import BrokenExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image as Picture

from softmodels.case.case import Case
from softmodels.cli import run as module
from softmodels.cli.run import DrawingProcess
from softmodels.common.commands import DrawingOptions, RunOptions
from softmodels.pictures import draw, offscreen, solid
from softmodels.pictures.offscreen import can_render, look
from softmodels.pictures.solid import AtRest
from softmodels.pictures.style import PictureFolder, png
from softmodels.runs.states import FolderStates
from tests.support import made_up as drawings, runs
from tests.support.campaigns import sampled


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


@pytest.fixture
def started(section, monkeypatch):
    """Return a function that gives what draws a run on so many ranks of a launcher, on two cores."""
    made = []

    def drawing(ranks):
        monkeypatch.setattr(module.processes, "cores", lambda: 2)
        monkeypatch.setattr(module.mpi, "launched", lambda: ranks)
        made.append(DrawingProcess.of(Case.from_file(section.folder / "case.toml"), RunOptions()))
        return made[-1]

    yield drawing
    for process in made:
        process.leave()


@pytest.mark.campaign
def test_a_process_that_was_ready_draws(section, started, capsys):
    drawing = started(ranks=None)
    begun = drawing._process
    drawing.begin(section)
    assert drawing.draw(section) > 0 and drawing._process is begun
    assert (section.folder / "report.html").exists() and (section.folder / "slice.png").exists()
    assert "could not" not in capsys.readouterr().err


@pytest.mark.campaign
def test_few_pictures_are_the_curves_the_stress_and_the_report(section):
    """And those that were drawn before and are not among them are taken away."""
    assert runs.run("-m", "softmodels", "draw", section.folder, "--colormap", "gray").status == 0
    assert {"mesh.png", "hot-spots.png"} <= {file.name for file in section.folder.iterdir()}
    with Picture.open(section.folder / "slice.png") as slice_:
        assert np.ptp(np.asarray(slice_)[500], axis=1).max() < 60  # greys, and the blue-grey outline
    done = runs.run("-m", "softmodels", "draw", section.folder, "--pictures", "few")
    names = {"apex.png", "profile.png", "slice.png", "stress.png", "report.html"}
    assert done.status == 0 and {Path(line).name for line in done.out.split()} == names
    assert {file.name for file in section.folder.iterdir() if file.suffix in (".png", ".gif", ".webp", ".html")} == names


@pytest.mark.parametrize("words", [("--pictures", "none"), ("--no-pictures",)])
def test_none_are_drawn_if_none_are_wanted(words, tmp_path):
    disk = ("-m", "softmodels.disk", "--section=axisymmetric", "--pressure-cm=0,5", "--output", tmp_path / "disk")
    done = runs.run(*disk, *words)
    assert done.status == 0 and not list((tmp_path / "disk").glob("*.png"))


@pytest.mark.parametrize("command", [("softmodels.disk", "--pressure-cm=5"), ("softmodels", "draw", "nothing")])
def test_an_unknown_colour_map_is_refused_at_once(command):
    done = runs.run("-m", *command, "--colormap", "virids")
    assert done.status == 2 and "no colour map 'virids'; did you mean viridis" in done.err and done.err.count("\n") == 1


def test_a_run_tells_what_was_drawn_and_how_to_get_the_film(drawing):
    assert (
        DrawingProcess(drawing.case, DrawingOptions(film=True)).made(Path("a"))
        == "pictures (*.png), film.gif, film.webp and report.html"
    )
    assert "softmodels draw 'results/my disk' --film" in drawing.made(Path("results/my disk"))


def test_no_core_is_taken_from_the_solver(started):
    assert started(ranks=2)._process is None and started(ranks=1)._process is not None


def test_a_process_that_died_meanwhile_costs_no_results(section, drawing, capsys):
    drawing._process = drawing._started()
    drawing._process.kill()
    drawing._process.wait()
    drawing.begin(section)  # does no harm
    assert drawing.draw(section) is None
    said = capsys.readouterr().err
    assert said == "softmodels: the pictures could not be drawn (exit status -9); the results are complete\n"


@pytest.mark.parametrize("already", sampled([True, False]), ids=["before its turn", "in its turn"])
def test_a_second_process_that_is_killed_costs_no_picture(already, section, monkeypatch):
    monkeypatch.setattr(draw.processes, "cores", lambda: 2)
    with draw.second_process() as beside:
        killed = beside.submit(os._exit, 9)
        if already:
            assert isinstance(killed.exception(), BrokenExecutor)
        draw.draw_folder(section.folder, "disk", DrawingOptions(pictures="few"), beside=beside)
    assert {"apex.png", "report.html"} <= {file.name for file in section.folder.iterdir()}


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


def test_a_film_is_made_if_it_is_asked_for(section, monkeypatch):
    """And an encoder that fails costs only its own format."""
    frames = [np.full((40, 60, 3), 20 * k, dtype="uint8") for k in range(6)]
    monkeypatch.setattr(solid, "render_frames", lambda shown: frames)
    monkeypatch.setattr(solid, "can_mp4", lambda: True)

    def broken(path, images):
        raise RuntimeError("the film could not be encoded (broken)")

    monkeypatch.setattr(solid, "write_mp4", broken)
    files, left_out = solid.make_film(look(FolderStates(section.folder, "disk")), section.folder)
    assert [file.name for file in files] == ["film.gif", "film.webp"] and "could not be encoded" in left_out
    for file in files:
        with Picture.open(file) as found:
            assert found.n_frames == len(frames)


@pytest.mark.skipif(not can_render(), reason="this machine cannot render")
def test_pictures_at_rest_are_drawn_once_and_only_of_this_device(wedge, half_section, monkeypatch):
    rest = AtRest()
    rest.draw_early(wedge / "nothing", "disk")
    assert rest._drawn == {}
    rest.draw_early(wedge, "disk")
    early = rest._drawn
    assert set(early) == {"undeformed", "mesh"}
    assert rest.pictures(look(FolderStates(wedge, "disk"))) is early
    other = rest.pictures(look(FolderStates(half_section, "disk")))
    assert set(other) == {"mesh"} and other["mesh"] != early["mesh"]


@pytest.mark.campaign
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
def test_lights_without_gloss_are_those_of_vtk(wedge, monkeypatch):
    shown = look(FolderStates(wedge, "disk"))
    layers = shown.translucent(0, {"color": "#2f6f9f"}, {"opacity": 0.35, "culling": "back"})
    with offscreen.studio(shown.camera([0], 480)) as shoot:
        own = shoot(layers).astype(int)
        monkeypatch.setattr(offscreen, "shade", lambda actor: None)
        glossy = shoot(layers).astype(int)
    assert np.ptp(own) > 150, "a picture"
    different = np.abs(own - glossy).max(axis=2)
    assert (different > 1).mean() < 5e-3, "but for single pixels at edges"


def test_a_large_film_has_fewer_frames_in_its_gif(monkeypatch):
    noise = np.random.default_rng(1).integers(0, 255, (40, 60, 80, 3), dtype=np.uint8)
    monkeypatch.setattr(solid, "MAX_GIF_BYTES", 20 * 60 * 80)
    data = solid.gif(list(noise))
    with Picture.open(io.BytesIO(data)) as found:
        assert 10 <= found.n_frames < 40 and len(data) <= solid.MAX_GIF_BYTES


# -- Pictures that are encoded beside what draws the next one: all on disk at the end, and no failure lost -----------


def some(k):
    figure = Figure((2.0, 1.0), dpi=50)
    figure.text(0.1, 0.5, f"picture {k}")
    return figure


def test_all_are_on_disk_at_the_end(tmp_path):
    with PictureFolder(tmp_path) as out:
        for k in range(8):
            out.save(f"p{k}", some(k), {"Title": f"number {k}"})
        out.add("made", png(some(9)))
    assert [path.name for path in out.written] == [*(f"p{k}.png" for k in range(8)), "made.png"]
    for k in range(8):
        with Picture.open(tmp_path / f"p{k}.png") as image, Picture.open(tmp_path / "made.png") as other:
            assert image.text["Title"] == f"number {k}" and image.mode == "RGB"
            assert image.info["dpi"] == pytest.approx((50, 50), abs=0.1)
            assert not np.array_equal(np.asarray(image), np.asarray(other))


def test_a_picture_that_cannot_be_written_is_no_picture(tmp_path):
    out = PictureFolder(tmp_path / "missing")
    with pytest.raises(FileNotFoundError), out:
        out.save("p", some(0))


def test_what_else_went_wrong_is_what_is_reported(tmp_path):
    with pytest.raises(ZeroDivisionError), PictureFolder(tmp_path / "missing") as out:
        out.save("p", some(0))
        _ = 1 / 0
