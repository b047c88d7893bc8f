"""A project as one ZIP file opens elsewhere as it was, and a hostile one reaches nothing but a project's own files."""

from __future__ import annotations

import io
import os
import shutil
import stat
import zipfile

import pytest

pytest.importorskip("nicegui")

from softmodels.app import jobs, packing
from softmodels.app.bench import CURVES, RESULTS, Bench, Project
from softmodels.app.making import CURVE
from softmodels.app.server import zipped
from softmodels.common.errors import FieldError
from tests.app.conftest import served, tab, value
from tests.app.test_history import inputs


@pytest.fixture
def filled(tmp_path):
    """A project with a device, a curve, results, a job, and what does not belong into a file to send."""
    project = Project(tmp_path / "mine")
    project.change(actuator=project.case.actuator.replaced(membrane="5 mm"))
    project.keep(CURVES, "pull.csv", b"strain,stress\n0,0\n", CURVE)
    project.record()
    (project / RESULTS / "device").mkdir()
    (project / RESULTS / "device" / "path.csv").write_text("step\n0\n")
    (project / RESULTS / "device" / "secret").symlink_to("/etc/passwd")
    (project / jobs.FOLDER).mkdir()
    return project


def test_a_project_that_is_sent_opens_as_it_was(filled, tmp_path):
    made = packing.pack(filled.folder)
    other = Project(tmp_path / "theirs")
    assert packing.unpack(io.BytesIO(made.read_bytes()), other) == 0
    other.read_again()
    assert inputs(other) == inputs(filled) and other.case == filled.case
    assert (other / RESULTS / "device" / "path.csv").read_text() == "step\n0\n"
    assert not (other / RESULTS / "device" / "secret").exists()
    assert not any(name.split("/")[1] == "history" for name in zipfile.ZipFile(made).namelist())
    with pytest.raises(FieldError, match="not empty"):
        packing.unpack(io.BytesIO(made.read_bytes()), other)


def test_files_without_a_time_are_sent(filled):
    os.utime(filled / CURVES / "pull.csv", (0, 0))
    assert f"{filled.folder.name}/{CURVES}/pull.csv" in zipfile.ZipFile(packing.pack(filled.folder)).namelist()


def test_nothing_is_left_of_a_file_that_could_not_be_written(filled, tmp_path, monkeypatch):
    (tmp_path / "aside").mkdir()
    monkeypatch.setattr(packing.tempfile, "tempdir", str(tmp_path / "aside"))
    monkeypatch.setattr(zipfile.ZipFile, "write", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    assert zipped(filled.folder, "").status_code == 404 and not any((tmp_path / "aside").iterdir())


def test_a_folder_of_results_is_sent_alone(filled):
    made = packing.pack(filled.folder, f"{RESULTS}/device")
    assert zipfile.ZipFile(made).namelist() == ["device/path.csv"]


@pytest.mark.parametrize("place", ["..", "results/../..", "/etc", "history", "results/none", "jobs", "results/\0"])
def test_nothing_else_is_sent(filled, place):
    answer = zipped(filled.folder, place)
    assert answer.status_code == 404 and b"\n" not in answer.body


def sent(**members):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return file


HOSTILE = {
    "p/../../outside.txt": "out", "/etc/cron.d/job": "out", "p/history/steps.json": "{}", "p/curves/.hidden.csv": "x",
    ".": "x", "p\\..\\..\\outside.csv": "x", "C:/p/curves/a.csv": "x", "p/notes.txt": "x", "p/curves/../../outside.csv": "x",
}  # fmt: skip


def test_members_from_elsewhere_are_left_out(tmp_path):
    project = Project(tmp_path / "project")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(FieldError, match="no project"):
        packing.unpack(sent(**HOSTILE), project)
    assert sorted(tmp_path.rglob("*")) == before
    assert packing.unpack(sent(**HOSTILE, **{"p/curves/mine.csv": "a,b"}), project) == len(HOSTILE)
    assert sorted(set(tmp_path.rglob("*")) - set(before)) == [project / CURVES / "mine.csv"]


def test_a_link_is_left_out(tmp_path):
    link = zipfile.ZipInfo("p/curves/a.csv")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    file = sent(**{"p/curves/b.csv": "x"})
    with zipfile.ZipFile(file, "a") as archive:
        archive.writestr(link, "/etc/passwd")
    project = Project(tmp_path / "project")
    assert packing.unpack(file, project) == 1 and not (project / CURVES / "a.csv").exists()


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04", b"no archive" * 100])
def test_what_is_no_archive_is_told(data, tmp_path):
    with pytest.raises(FieldError, match="cannot be read as a ZIP file"):
        packing.unpack(io.BytesIO(data), Project(tmp_path / "project"))


def test_a_damaged_one_is_told(filled, tmp_path):
    made = packing.pack(filled.folder).read_bytes()
    place = made.index(b"strain") if b"strain" in made else len(made) // 3
    project = Project(tmp_path / "theirs")
    before = sorted(project.folder.rglob("*"))
    with pytest.raises(FieldError, match="cannot be read"):
        packing.unpack(io.BytesIO(made[:place] + b"????" + made[place + 4 :]), project)
    assert sorted(project.folder.rglob("*")) == before


def test_one_that_would_fill_the_disk_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(packing, "MAX_BYTES", 1000)
    with pytest.raises(FieldError, match="larger than"):
        packing.unpack(sent(**{"p/curves/a.csv": "0" * 2000}), Project(tmp_path / "project"))


def test_jobs_of_a_sent_project_are_shown_and_not_run(filled, tmp_path):
    record = '{"number": 7, "words": ["softmodels", "run", "case.toml"], "output": "results/device", "state": "running"}'
    (filled / jobs.FOLDER / "7.json").write_text(record)
    bench = Bench(Project(tmp_path / "theirs"))
    packing.unpack(io.BytesIO(packing.pack(filled.folder).read_bytes()), bench.project)
    told = []
    bench.jobs.changed.subscribe(told.append)
    bench.jobs.read()
    assert [job.state for job in told] == [jobs.RECORDED_ELSEWHERE] and bench.jobs.latest("results/device").number == 7


@pytest.mark.campaign
def test_a_project_goes_from_one_page_to_another(browser, tmp_path):
    mine = Project(tmp_path / "mine")
    mine.change(actuator=mine.case.actuator.replaced(membrane="5 mm"))
    with served(mine.folder) as (_, address), tab(browser, address, "Start") as page:
        page.get_by_text("A project as one file").click()
        with page.expect_download() as download:
            page.get_by_text("Download the whole project").click()
        assert download.value.suggested_filename == "mine.zip"
        shutil.copy(download.value.path(), tmp_path / "mine.zip")
    with served(tmp_path / "theirs") as (_, address), tab(browser, address, "Start") as page:
        page.get_by_text("A project as one file").click()
        page.locator('[data-name="project"] input[type=file]').set_input_files(tmp_path / "mine.zip")
        assert value(page, "start-told") == "mine.zip is open"
        page.get_by_role("tab", name="Device").click()
        assert page.get_by_label("membrane", exact=True).first.input_value() == "5 mm"
