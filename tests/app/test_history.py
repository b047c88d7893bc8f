"""What the page changes can be undone and redone, also after the server was started anew, and nothing is lost."""

from __future__ import annotations

import asyncio
import json
import os
import random

import pytest

pytest.importorskip("nicegui")

from softmodels.app.bench import BOARDS, CASE, CURVES, INPUT_FOLDERS, INPUT_TEXTS, PHOTOGRAPH, PHOTOS, Bench, Project
from softmodels.app.making import CURVE
from tests.app.conftest import tab


def inputs(project):
    """What results are made of, by places."""
    places = [project / name for name in INPUT_TEXTS]
    places += [file for folder in INPUT_FOLDERS for file in (project / folder).iterdir()]
    return {str(file.relative_to(project.folder)): file.read_bytes() for file in places if file.is_file()}


def change(project, choose):
    """Change something of a project as the page does."""
    kind = choose.choice(["length", "curve", "board", "text", "remove"])
    files = [file for folder in INPUT_FOLDERS for file in sorted((project / folder).iterdir())]
    if kind == "remove" and files:
        project.remove(choose.choice(files))
    elif kind == "text":
        (project / PHOTOS).write_text(f"file,pressure\na.jpg,{choose.random():.3f} cm\n")
        project.record()
    elif kind in ("curve", "board"):
        folder, what, ending = (CURVES, CURVE, "csv") if kind == "curve" else (BOARDS, PHOTOGRAPH, "jpg")
        # All of the same size and time, as copies to some memory cards are.
        file = project.keep(folder, f"{choose.choice('abc')}.{ending}", b"%03d" % choose.randrange(999), what)
        os.utime(file, (0, 0))
        project.record()
    else:
        project.change(actuator=project.case.actuator.replaced(membrane=f"{choose.uniform(4, 7):.3f} mm"))


@pytest.mark.parametrize("seed", range(6))
def test_any_sequence_of_changes_is_undone_and_redone(seed, tmp_path):
    choose = random.Random(seed)
    bench = Bench(Project(tmp_path / "project"))
    known, at = [inputs(bench.project)], 0
    for _ in range(30):
        action = choose.random()
        if action < 0.1:
            bench = Bench(Project(tmp_path / "project"))  # the server is started anew
        elif action < 0.6:
            with bench.project.history.one_step():
                change(bench.project, choose)
            now = inputs(bench.project)
            if now != known[at]:
                known, at = [*known[: at + 1], now], at + 1
        else:
            by = choose.choice([-1, 1])
            assert bool(bench.project.history.change_of(by)) == (0 <= at + by < len(known))
            assert not asyncio.run(bench.step(by))
            at = at + by if 0 <= at + by < len(known) else at
        assert inputs(bench.project) == known[at]
        assert bench.project.case.to_toml() == Project(tmp_path / "project").case.to_toml()


def test_a_change_is_named(tmp_path):
    project = Project(tmp_path / "project")
    project.keep(CURVES, "pull.csv", b"x", CURVE)
    project.record()
    assert project.history.change_of(-1) == "curve pull.csv" and not project.history.change_of(1)
    project.change(water_density=998.0)
    project.record()
    assert project.history.change_of(-1) == "device"


def test_what_another_program_took_away_is_named_and_the_rest_comes_back(tmp_path):
    bench = Bench(Project(tmp_path / "project"))
    project = bench.project
    with project.history.one_step():
        lost, kept = (project.keep(CURVES, name, b"x", CURVE) for name in ("lost.csv", "kept.csv"))
    with project.history.one_step():
        lost.unlink()
        project.remove(kept)
    assert "curves/lost.csv, which cannot come back" in asyncio.run(bench.step(-1))
    assert kept.exists() and not lost.exists()
    assert not asyncio.run(bench.step(-1)) and not kept.exists()


HOSTILE = {
    "another folder": {"../outside.txt": "0" * 64},
    "a folder of the project": {"jobs/1.json": "0" * 64},
    "a folder below": {"curves/../../outside.txt": "0" * 64},
    "a stored file elsewhere": {CASE: "../../outside.txt"},
}


@pytest.mark.parametrize("steps", HOSTILE.values(), ids=HOSTILE)
def test_a_record_that_comes_from_elsewhere_reaches_inputs_only(steps, tmp_path):
    outside = tmp_path / "outside.txt"
    outside.write_text("mine")
    Project(tmp_path / "project")
    record = {"current": 1, "steps": [steps, {}]}
    (tmp_path / "project" / "history" / "steps.json").write_text(json.dumps(record))
    (tmp_path / "project" / "history" / ("0" * 64)).write_text("theirs")
    bench = Bench(Project(tmp_path / "project"))
    assert not bench.project.history.change_of(-1)
    asyncio.run(bench.step(-1))
    assert outside.read_text() == "mine" and not (bench.project / CASE).exists()


@pytest.mark.campaign
def test_undo_on_the_page(browser, server, page):
    """By the button in one tab, and by keys in another, which shows it too."""
    undo = page.get_by_role("button", name="undo")
    with tab(browser, server) as other:
        box = page.get_by_label("wall", exact=True).first
        before = box.input_value()
        box.fill("13 mm")
        box.press("Tab")
        shown = "wanted => document.querySelector('input[data-name=\"wall\"]')?.value == wanted"
        other.wait_for_function(shown, arg="13 mm")
        undo.click()
        page.wait_for_function(shown, arg=before)
        other.wait_for_function(shown, arg=before)
        other.locator("h1").click()
        other.keyboard.press("Control+Shift+Z")
        page.wait_for_function(shown, arg="13 mm")
        other.keyboard.press("Control+Z")
        page.wait_for_function(shown, arg=before)
