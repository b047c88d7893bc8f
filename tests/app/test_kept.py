"""Devices and results that a project keeps under names: opened, renamed, duplicated, deleted, and undone where that is said."""

from __future__ import annotations

import asyncio
import dataclasses
import json
import shutil

import pytest

pytest.importorskip("nicegui")

import softmodels as sm
from softmodels.app.bench import CASE, SAMPLES, Bench, Project
from softmodels.app.jobs import DONE, Job
from softmodels.case.case import Case
from softmodels.common.errors import FieldError
from tests.app.conftest import served, tab


@pytest.fixture
def bench(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return Bench(Project(tmp_path / "project"))


def names(project):
    return sorted(file.stem for file in project.devices)


def test_a_kept_device_is_opened_renamed_duplicated_and_deleted(bench):
    project = bench.project
    project.change(actuator=project.case.actuator.replaced(membrane="5 mm"))
    project.keep_device("thin, 5 mm")
    kept = project.case
    project.change(actuator=sm.Balloon())
    assert names(project) == ["thin_5_mm"]
    project.duplicate_device(project.devices[0])
    project.rename_device(project / "devices" / "thin_5_mm-2.toml", "../other")
    assert names(project) == ["other", "thin_5_mm"]
    project.rename_device(project.devices[0], "other")
    project.remove(project.devices[1])
    assert names(project) == ["other"]
    project.open_device(project.devices[0])
    assert project.case == kept and Case.from_file(project / CASE) == kept
    for expected in (["other"], ["other", "thin_5_mm"], ["thin_5_mm", "thin_5_mm-2"], ["thin_5_mm"]):
        assert not asyncio.run(bench.step(-1))
        assert names(project) == expected
    assert type(project.case.actuator) is sm.Balloon
    with pytest.raises(FieldError):
        project.keep_device("")


def test_a_kept_part_is_found_from_its_own_folder(bench, tmp_path):
    project = bench.project
    shutil.copy(SAMPLES / "made" / "mypart.step", project / "parts")
    part = sm.ImportedActuator(file=str(project / "parts" / "mypart.step"), support="x = 0 mm")
    project.change(actuator=part)
    project.keep_device("part")
    digest = part.digest()
    moved = Project(project.folder.rename(tmp_path / "moved"))
    moved.change(actuator=sm.Balloon())
    moved.open_device(moved.devices[0])
    assert moved.case.actuator.digest() == digest and "parts/mypart.step" in (moved / CASE).read_text()
    assert ".." not in (moved / CASE).read_text()


def test_a_kept_file_of_another_kind_says_so_and_changes_nothing(bench):
    project = bench.project
    before = project.case
    (project / "devices" / "bad.toml").write_text("[geometry]\ndevice = 3\n")
    with pytest.raises(ValueError):
        project.open_device(project.devices[0])
    assert project.case == before


def test_results_are_copied_renamed_and_deleted_on_the_page(browser, tmp_path):
    """What was deleted is no longer shown as done; its copy stays."""
    project = Project(tmp_path / "project")
    results = project / "results" / "mould"
    results.mkdir()
    (results / "sheet.html").write_text("<p>sheet</p>")
    (project / "jobs").mkdir()
    record = Job(1, ["softmodels", "mould", "mould-case.toml", "-o", "results/mould"], "results/mould", state=DONE)
    (project / "jobs" / "1.json").write_text(json.dumps(dataclasses.asdict(record)))
    with served(project.folder) as (_, address), tab(browser, address, "Mould") as page:
        state = page.locator('[data-name="state-results/mould"]')
        assert state.text_content() == DONE
        page.wait_for_timeout(1000)  # the sheet's frame loads, and would take the first click
        for verb, whose, answer, name in (
            ("keep a copy of", "these results", "Keep", "first"), ("rename", "first", "Rename", "second try"),
        ):  # fmt: skip
            page.get_by_role("button", name=f"{verb} {whose}").click()
            page.locator('input[data-name="asked"]').fill(name)
            page.get_by_role("button", name=answer, exact=True).click()
            page.get_by_role("button", name=f"delete {name.replace(' ', '_')}").wait_for()
        page.get_by_role("button", name="delete these results").click()
        page.get_by_role("button", name="Cancel").click()
        assert results.is_dir()
        page.get_by_role("button", name="delete these results").click()
        page.get_by_role("button", name="Delete", exact=True).click()
        page.wait_for_function("document.querySelector('[data-name=\"state-results/mould\"]').textContent == ''")
        assert not results.exists() and page.get_by_text("Here come the bodies to print").is_visible()
        assert [copy.name for copy in project.copies("results/mould")] == ["mould-second_try"]
        page.get_by_role("link", name="report").wait_for()
