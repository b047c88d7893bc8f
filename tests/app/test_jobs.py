"""Jobs of a project's folder: resumed where this machine recorded them, and nothing of a foreign folder is run."""

from __future__ import annotations

import asyncio
import json
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("nicegui")

from softmodels.app import jobs
from softmodels.app.bench import Project
from softmodels.app.jobs import DONE, FAILED, RECORDED_ELSEWHERE, RUNNING, STOPPED, Job, Jobs, check_command
from softmodels.common.errors import FieldError
from softmodels.common.processes import Worker, python

HARMLESS = ["softmodels", "run", "case.toml", "-o", "results/device"]
RECORD = {"number": 1, "words": HARMLESS, "output": "results/device", "resumable": True, "state": RUNNING}


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch):
    """A user's own folder for the key."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state"


@pytest.fixture
def project(tmp_path):
    (tmp_path / "project" / "jobs").mkdir(parents=True)
    return tmp_path / "project"


def begun(project):
    """Start a server's jobs, wait until all have ended, and return them."""

    async def work():
        found = Jobs(project)
        found.begin()
        while found._tasks:
            await asyncio.sleep(0.01)
        return found

    return asyncio.run(work())


def written(project, table, name="1.json"):
    (project / "jobs" / name).write_text(json.dumps(table))


@pytest.fixture
def started(monkeypatch):
    """Commands that were started; each ends at once."""
    found = []
    real = asyncio.create_subprocess_exec

    async def start(*words, **how):
        found.append((words, how))
        return await real(sys.executable, "-c", "", **how)

    monkeypatch.setattr(jobs.asyncio, "create_subprocess_exec", start)
    return found


def test_a_foreign_record_is_shown_and_not_run(project, tmp_path):
    """Such as this one, which ran as ``python -m timeit`` when its folder was opened."""
    hit = tmp_path / "hit"
    words = ["timeit", "-n1", "-r1", "-s", f"open({str(hit)!r}, 'w').close()"]
    written(project, {**RECORD, "words": words, "resumable": False})
    found = begun(project)
    assert not hit.exists()
    assert [(job.words, job.state, job.active) for job in found.all] == [(words, RECORDED_ELSEWHERE, False)]
    assert "timeit" in found.latest("results/device").command


@pytest.mark.parametrize("seal", [{}, {"seal": ""}, {"seal": "0" * 64}, {"seal": None}, {"seal": "é"}])
def test_a_known_command_that_another_machine_recorded_is_not_run(project, started, seal):
    written(project, {**RECORD, **seal})
    assert [job.state for job in begun(project).all] == [RECORDED_ELSEWHERE] and not started


def test_a_record_of_this_machine_is_resumed_and_a_changed_one_is_not(project, started, state):
    async def interrupted():
        found = Jobs(project)
        found._set(Job(**RECORD), RUNNING)

    asyncio.run(interrupted())
    record = json.loads((project / "jobs" / "1.json").read_text())
    assert [job.state for job in begun(project).all] == [DONE]
    assert [words[3:] for words, _ in started] == [(*HARMLESS, "--resume")]
    assert (state / "softmodels" / "key").stat().st_mode & 0o077 == 0
    written(project, {**record, "words": [*HARMLESS[:-1], "results/other"]})
    assert [job.state for job in begun(project).all] == [RECORDED_ELSEWHERE]
    (state / "softmodels" / "key").unlink()  # as on another machine
    written(project, record)
    assert [job.state for job in begun(project).all] == [RECORDED_ELSEWHERE] and len(started) == 1


DEAF = """import signal, subprocess, sys, time
[signal.signal(number, signal.SIG_IGN) for number in (2, 15)]
rank = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"], start_new_session=True)
print(rank.pid, flush=True)
time.sleep(60)"""
POLITE = "import signal, time; signal.signal(2, lambda *_: exit(130)); print(0, flush=True); time.sleep(60)"


@pytest.mark.parametrize("program", [DEAF, POLITE], ids=["compiled code", "between steps"])
def test_stop_stops_within_a_second_and_the_next_job_begins(program, project, monkeypatch):
    """Compiled code hears neither the first nor the second signal; its ranks end with it."""
    real, programs = asyncio.create_subprocess_exec, [program, "print('next')"]

    async def start(*words, **how):
        return await real(sys.executable, "-c", programs.pop(0), **how)

    monkeypatch.setattr(jobs.asyncio, "create_subprocess_exec", start)

    async def stopped():
        found = Jobs(project)
        job, following = found.start(HARMLESS, "results/device"), found.start(HARMLESS, "results/fit")
        while not found.log(job):
            await asyncio.sleep(0.01)
        assert found.state_words(following) == "waiting until device has ended"
        begun = time.monotonic()
        found.stop(job)
        assert found.is_stopping(job) and found.state_words(job) == "stopping"
        while job.active:
            await asyncio.sleep(0.01)
        took = time.monotonic() - begun
        while following.active:
            await asyncio.sleep(0.01)
        return took, job.state, following.state, Path("/proc", found.log(job).strip(), "stat")

    took, state, following, rank = asyncio.run(stopped())
    assert not rank.exists() or " Z " in rank.read_text()
    assert took < 1.0 and (state, following) == (STOPPED, DONE)


def test_a_job_that_is_stopped_while_it_starts_does_not_run_on(project, monkeypatch):
    real = asyncio.create_subprocess_exec

    async def stopped():
        found = Jobs(project)

        async def start(*words, **how):
            found.stop(job)
            return await real(sys.executable, "-c", DEAF, **how)

        monkeypatch.setattr(jobs.asyncio, "create_subprocess_exec", start)
        job = found.start(HARMLESS, "results/device")
        await asyncio.wait_for(asyncio.gather(*found._tasks), 10.0)
        return job.state

    assert asyncio.run(stopped()) == STOPPED


WRONG = (
    ["timeit"], ["softmodels"], ["softmodels", "app"], ["pip", "install", "x"], ["softmodels", "fit", "--petsc", "x"],
    ["softmodels", "run", "../case.toml"], ["softmodels", "run", "/etc/passwd"], ["softmodels", "run", "away/case.toml"],
    ["softmodels", "fit", "--tensile", "away/curve.csv:uniaxial"], ["softmodels", "mould", "case.toml", "-o", "away"],
    ["softmodels", "fit", "--fix=c3=0"], ["measurement", "photos", "photos.csv", "--setup", "../setup.toml"],
    ["softmodels", "run", "a\0b"],
)  # fmt: skip


@pytest.mark.parametrize("words", WRONG, ids=" ".join)
def test_a_command_stays_among_those_of_the_page_and_in_the_folder(words, project, tmp_path, started):
    """Also one that this machine recorded: the key may have become known."""
    (project / "away").symlink_to(tmp_path)
    with pytest.raises(ValueError):
        check_command(words, project)

    async def started_by_the_page():
        found = Jobs(project)
        job = found.start(words, "results/device")
        while found._tasks:
            await asyncio.sleep(0.01)
        return job.state, found.log(job)

    state, log = asyncio.run(started_by_the_page())
    assert state == FAILED and "could not be started" in log and not started


NO_RECORDS = (
    [], 3, None, "x", {}, {**RECORD, "number": 2}, {**RECORD, "number": "../../x"}, {**RECORD, "words": []},
    {**RECORD, "words": [1]}, {**RECORD, "words": "softmodels"}, {**RECORD, "output": 1}, {**RECORD, "more": 1},
)  # fmt: skip


@pytest.mark.parametrize("table", NO_RECORDS, ids=range(len(NO_RECORDS)))
def test_what_is_no_record_is_left_out(table, project):
    written(project, table)
    assert Jobs(project).all == []


def test_a_log_that_leads_elsewhere_is_not_written_through(project, tmp_path, started):
    """Nor is a named pipe waited for."""
    other = tmp_path / "other.txt"
    other.write_text("mine")
    (project / "jobs" / "1.log").symlink_to(other)

    async def run():
        found = Jobs(project)
        found.start(HARMLESS, "results/device")
        while found._tasks:
            await asyncio.sleep(0.01)

    asyncio.run(run())
    assert len(started) == 1 and other.read_text() == "mine"
    assert not (project / "jobs" / "1.log").is_symlink()


def test_the_pages_commands_are_all_known_and_their_options_are_those_of_the_commands():
    """Each option is one of the command, so that its value is no word of its own."""
    import click

    from measurement.__main__ import main as measurement
    from softmodels.__main__ import softmodels

    groups = {"softmodels": softmodels, "measurement": measurement}
    for name, allowed in jobs.COMMANDS.items():
        module, command = name.split()
        found = groups[module].get_command(click.Context(groups[module]), command)
        known = {flag: option for option in found.params if isinstance(option, click.Option) for flag in option.opts}
        assert all(not known[flag].is_flag and known[flag].nargs == 1 for flag in allowed), name
        assert all(known[flag].is_flag for flag in jobs.FLAGS.get(name, ())), name


def test_a_modules_name_in_a_foreign_folder_is_not_imported(tmp_path, monkeypatch):
    """Neither by a job, which runs there, nor by a process that answers, if the server was started there."""
    hit = tmp_path / "hit"
    for name in ("softmodels.py", "numpy.py", "json.py", "click.py"):
        (tmp_path / name).write_text(f"open({str(hit)!r}, 'w').close()\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry not in ("", str(tmp_path))])
    worker = Worker("softmodels.common.units")
    try:
        assert worker.call("example", "m")[0]
    finally:
        worker.stop()
    words, environment = python("softmodels", "--help")

    async def help_text():
        process = await asyncio.create_subprocess_exec(*words, cwd=tmp_path, env=environment, stdout=asyncio.subprocess.PIPE)
        return (await process.communicate())[0]

    assert b"Usage" in asyncio.run(help_text()) and not hit.exists()


def test_the_page_says_what_is_not_run(project):
    with pytest.raises(FieldError, match="'timeit -n1' is not a command of the page; it starts softmodels run"):
        check_command(["timeit", "-n1"], project)
    with pytest.raises(FieldError, match="is not an option of the page's command softmodels mould"):
        check_command(["softmodels", "mould", "--resume"], project)
    Project(project)
    check_command(["softmodels", "fit", "case.toml", "outlines/", "--tensile", "curves/a b.csv:planar"], Path(project))
