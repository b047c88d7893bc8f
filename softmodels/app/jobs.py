"""Commands in processes of their own: they survive a closed tab, can be stopped, and are resumed after a killed server."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import json
import shlex
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from softmodels.app.forms import page_words
from softmodels.case.entries import INPUT_ERRORS
from softmodels.common.errors import reason
from softmodels.common.files import replace_text
from softmodels.runs import outcomes

if TYPE_CHECKING:
    from softmodels.app.project import Project

FOLDER = "jobs"
WAITING, RUNNING, DONE, STOPPED, FAILED = "waiting", "running", "done", "stopped", "failed"
ENDED = {outcomes.DONE: DONE, outcomes.NO_EQUILIBRIUM: DONE, outcomes.STOPPED: STOPPED}
"""States by exit status; some photographs refused has that of a limit point. All others are `FAILED`."""


@dataclasses.dataclass
class Job:
    """A command of the project.

    Attributes:
        number: It counts from 1.
        words: The command after ``python -m``, such as ``["softmodels", "run", "case.toml"]``.
        output: Its folder of results, from the project's.
        resumable: Whether it has ``--resume``.
        state: One of `WAITING`, `RUNNING`, `DONE`, `STOPPED` and `FAILED`.
    """

    number: int
    words: list[str]
    output: str
    resumable: bool = False
    state: str = WAITING

    @property
    def command(self) -> str:
        """As in a terminal."""
        first = self.words[1:] if self.words[0] == "softmodels" else ["-m", *self.words]
        return shlex.join(["uv", "run", "softmodels" if self.words[0] == "softmodels" else "python", *first])

    @property
    def active(self) -> bool:
        return self.state in (WAITING, RUNNING)


class Jobs:
    """The jobs of a project, one running at a time.

    Args:
        project: The project; records and logs lie in its folder `FOLDER`.
    """

    def __init__(self, project: Project):
        from nicegui import Event

        self.project, self.folder = project, project / FOLDER
        self.folder.mkdir(exist_ok=True)
        self.changed: Event[Job] = Event()
        self._turn = asyncio.Lock()
        self._processes: dict[int, asyncio.subprocess.Process] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self.ending = False
        self.all: list[Job] = []
        for file in sorted(self.folder.glob("*.json"), key=lambda path: path.stem.zfill(9)):
            with contextlib.suppress(OSError, ValueError, TypeError):
                self.all.append(Job(**json.loads(file.read_text(encoding="utf-8"))))

    def begin(self) -> None:
        """Resume the jobs of a server that was killed."""
        for job in self.all:
            if job.active:
                if job.resumable and job.state == RUNNING and "--resume" not in job.words:
                    job.words.append("--resume")
                self._launch(job)

    def start(self, words: list[str], output: str, *, resumable: bool = False) -> Job:
        """Start a command, once those before it have ended."""
        job = Job(1 + max((one.number for one in self.all), default=0), words, output, resumable)
        self.all.append(job)
        self._launch(job)
        return job

    def latest(self, output: str) -> Job | None:
        """Return the newest job with a folder of results."""
        return next((job for job in reversed(self.all) if job.output == output), None)

    def log(self, job: Job) -> str:
        """Return what a command has printed; the last of what overwrote itself."""
        try:
            text = self._log(job).read_text(encoding="utf-8", errors="replace")
        except OSError:
            return ""
        return "\n".join(line.rpartition("\r")[2] for line in text.splitlines())

    def stop(self, job: Job) -> None:
        """Stop a job: what was computed stays readable."""
        if (process := self._processes.get(job.number)) is not None:
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGINT)
        elif job.active:
            self._set(job, STOPPED)

    def end(self) -> None:
        """Stop all, as the server ends; they are resumed when it starts again."""
        self.ending = True
        for process in self._processes.values():
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGINT)

    def _log(self, job: Job) -> Path:
        return self.folder / f"{job.number}.log"

    def _set(self, job: Job, state: str) -> None:
        job.state = state
        with contextlib.suppress(OSError):  # a full disk must not end the job
            replace_text(self.folder / f"{job.number}.json", json.dumps(dataclasses.asdict(job)))
        self.changed.emit(job)

    def _launch(self, job: Job) -> None:
        self._set(job, WAITING if job.state != RUNNING else RUNNING)
        task = asyncio.get_running_loop().create_task(self._run(job))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _run(self, job: Job) -> None:
        from softmodels.common.processes import end_with_parent

        async with self._turn:
            if not job.active or self.ending:
                return
            self._set(job, RUNNING)
            try:
                with self._log(job).open("ab") as log:
                    process = await asyncio.create_subprocess_exec(
                        sys.executable, "-m", *job.words, cwd=self.project.folder, stdin=asyncio.subprocess.DEVNULL,
                        stdout=log, stderr=asyncio.subprocess.STDOUT, preexec_fn=end_with_parent,
                    )  # fmt: skip
            except OSError as error:
                with contextlib.suppress(OSError):  # a full disk has no room for it either
                    self._log(job).write_text(f"the command could not be started ({reason(error)})\n", encoding="utf-8")
                return self._set(job, FAILED)
            self._processes[job.number] = process
            status = await process.wait()
            del self._processes[job.number]
            if not self.ending:
                self._set(job, ENDED.get(status, FAILED))


Command = tuple[list[str], str, bool] | str
"""The words of a command, its folder of results and whether it has ``--resume``; or the sentence why it cannot be given."""


ALLOWED = "allow-scripts allow-popups allow-downloads allow-modals"
"""What a report may do inside the page: its 3-D view, and saving and printing what it shows."""


def _made(command: Callable[[], Command]) -> Command:
    """Return the command, or the sentence why it cannot be given, also where its input cannot be written."""
    try:
        return command()
    except (*INPUT_ERRORS, OSError) as error:
        return page_words(reason(error))


def job_panel(jobs: Jobs, output: str, title: str, command: Callable[[], Command], report: str = "") -> None:
    """Add a button that starts a command in the current place of a page, with what it prints, and its report.

    Args:
        jobs: The project's jobs.
        output: The command's folder of results.
        title: Of the button.
        command: Is called when the button is pressed.
        report: Page of its results, from the project's folder; empty for none.
    """
    from nicegui import ui

    def start() -> None:
        made = _made(command)
        if isinstance(made, str):
            sentence.set_text(made)
            return
        sentence.set_text("")
        jobs.start(made[0], made[1], resumable=made[2])

    def stop() -> None:
        if (job := jobs.latest(output)) is not None:
            jobs.stop(job)

    with ui.card().classes("w-full"):
        with ui.row().classes("items-center gap-3"):
            start_button = ui.button(title, on_click=start).props(f'data-name="start-{output}"')
            stop_button = ui.button("Stop", on_click=stop).props("outline").props(f'data-name="stop-{output}"')
            spinner = ui.spinner()
            state = ui.label().props(f'data-name="state-{output}"')
        sentence = ui.label().classes("text-negative").props(f'data-name="why-{output}"')
        line = (
            ui.label().classes("text-sm font-mono whitespace-pre-wrap break-words").props(f'data-name="line-{output}"')
        )
        log = ui.expansion("All it printed").classes("w-full").props("dense")
        with log:
            whole = ui.code("", language="text").classes("w-full")
        frame = ui.html("", sanitize=False).classes("w-full")

    def show() -> None:
        job = jobs.latest(output)
        active = job is not None and job.active
        start_button.set_enabled(not active)
        stop_button.set_visibility(active)
        spinner.set_visibility(active)
        log.set_visibility(job is not None)
        if job is None:
            return
        text = jobs.log(job)
        lines = [one for one in text.splitlines() if one.strip()]
        state.set_text(job.state)
        line.set_text(page_words(lines[-1]) if lines else "")
        whole.set_content(f"$ {job.command}\n{text}")
        if report and not active and (jobs.project / report).is_file():
            address = f"/files/{quote(report)}?{int((jobs.project / report).stat().st_mtime)}"
            frame.set_content(f'<iframe src="{address}" title="{title}" sandbox="{ALLOWED}"></iframe>')

    jobs.changed.subscribe(lambda job: show() if job.output == output else None)
    ui.timer(1.0, lambda: show() if (job := jobs.latest(output)) is not None and job.active else None)
    show()
