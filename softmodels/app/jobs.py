"""Work in processes of its own: commands, which survive a closed tab and are resumed after a killed server, and answers while
sliders move."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import functools
import hashlib
import hmac
import itertools
import json
import os
import re
import secrets
import shlex
import signal
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from nicegui import Event

from softmodels.casting import settings
from softmodels.common import commands, errors, files, processes

WAITING, RUNNING, DONE, STOPPED, FAILED = "waiting", "running", "done", "stopped", "failed"


@dataclasses.dataclass
class Job:
    """A command of the project, numbered from 1: the words after ``python -m``, such as ``["softmodels", "run",
    "case.toml"]``, its folder of results, from the project's, whether it has ``--resume``, its state: one of `WAITING`,
    `RUNNING`, `DONE`, `STOPPED` and `FAILED`; and the `digest` of the files it reads when it was started."""

    number: int
    words: list[str]
    output: str
    resumable: bool = False
    state: str = WAITING
    inputs: str = ""

    @property
    def command(self) -> str:
        """As in a terminal."""
        own = self.words[0] == "softmodels"
        return shlex.join(["uv", "run", *(self.words if own else ["python", "-m", *self.words])])

    @property
    def active(self) -> bool:
        return self.state in (WAITING, RUNNING)

    @property
    def asked(self) -> list[str]:
        """The words as first given, without ``--resume``."""
        return [word for word in self.words if word != RESUME]

    def options(self, name: str) -> list[str]:
        """Return the values that an option was given."""
        return [value for word, value in itertools.pairwise(self.words) if word == name]

    @classmethod
    def from_table(cls, table: Any, number: int) -> Job:
        """Return the job of a record with a number; ValueError or TypeError if the record is not one."""
        job = cls(**table)
        texts = (job.output, job.state, job.inputs, *(job.words if isinstance(job.words, list) else [None]))
        if not job.words or not all(isinstance(text, str) for text in texts) or not isinstance(job.resumable, bool):
            raise ValueError("not a record of a job")
        if not isinstance(job.number, int) or job.number != number:
            raise ValueError("not the number of the record's file")
        return job


class Jobs:
    """The jobs of a project, one running at a time; records and logs lie in `FOLDER` of the project's.

    Each record is sealed by the `machine_key`. What is recorded elsewhere is shown, with its log, and never started.
    """

    def __init__(self, project: Path):
        self.project, self.folder = project, project / FOLDER
        self.folder.mkdir(exist_ok=True)
        self._key = machine_key()
        self.changed: Event[Job] = Event()
        self._turn = asyncio.Lock()
        self._processes: dict[int, asyncio.subprocess.Process] = {}
        self._stopped: set[int] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self.ending = False
        self.all: list[Job] = []
        self.read()

    def read(self) -> None:
        """Read the records in the project's folder that are not known yet."""
        known = {job.number for job in self.all}
        for file in sorted(self.folder.glob("*.json"), key=lambda path: path.stem.zfill(9)):
            with contextlib.suppress(OSError, ValueError, TypeError, AttributeError):
                if (job := self._read(file)).number not in known:
                    self.all.append(job)
                    self.changed.emit(job)

    def _read(self, file: Path) -> Job:
        table = files.read_json(file)
        seal = table.pop("seal", "")
        job = Job.from_table(table, int(file.stem))
        if job.active and not hmac.compare_digest(str(seal).encode(), self._seal(job).encode()):
            job.state = RECORDED_ELSEWHERE
        return job

    def _seal(self, job: Job) -> str:
        record = json.dumps(dataclasses.asdict(job), sort_keys=True)
        return hmac.new(self._key, record.encode(), hashlib.sha256).hexdigest()

    def begin(self) -> None:
        """Resume the jobs of a server that was killed."""
        for job in self.all:
            if job.active:
                if job.resumable and job.state == RUNNING and RESUME not in job.words:
                    job.words.append(RESUME)
                self._launch(job)

    def start(self, words: list[str], output: str, *, resumable: bool = False) -> Job:
        """Start a command, once those before it have ended."""
        job = Job(1 + max((started.number for started in self.all), default=0), words, output, resumable)
        job.inputs = digest(words, self.project)
        self.all.append(job)
        self._launch(job)
        return job

    def is_outdated(self, job: Job, words: Sequence[str], written: Mapping[str, str]) -> bool:
        """Return whether the results of a job that is done are not those of the words that would be given now, or, if these are
        not known, of its own, and of the files as they would be ``written`` and are; see `digest`."""
        return job.state == DONE and bool(job.inputs) and job.inputs != digest(words or job.asked, self.project, written)

    def latest(self, output: str) -> Job | None:
        """Return the newest job with a folder of results."""
        return next((job for job in reversed(self.all) if job.output == output), None)

    def shown(self, output: str) -> Job | None:
        """Return the newest job with a folder of results, unless these were deleted."""
        job = self.latest(output)
        return None if job is not None and job.state == DONE and not (self.project / output).exists() else job

    def log(self, job: Job) -> str:
        """Return what a command has printed; the last of what overwrote itself."""
        try:
            text = files.read_file(self._log(job)).decode("utf-8", "replace")
        except OSError:
            return ""
        return "\n".join(line.rpartition("\r")[2] for line in text.splitlines())

    def stop(self, job: Job) -> None:
        """Stop a job: it may end the step under way at the first signal, ends at once at the second, and is killed where
        compiled code, such as a factorisation, hears neither. What was computed stays readable."""
        self._stopped.add(job.number)
        if (process := self._processes.get(job.number)) is not None:
            _interrupt(process)
            loop = asyncio.get_running_loop()
            loop.call_later(SECOND_SIGNAL_SECONDS, _interrupt, process)
            loop.call_later(KILL_SECONDS, _kill, process)
        elif job.active:
            self._set(job, STOPPED)

    def is_stopping(self, job: Job) -> bool:
        return job.active and job.number in self._stopped

    def state_words(self, job: Job) -> str:
        """Return the state of a job, and of one that waits what it waits for."""
        if self.is_stopping(job):
            return "stopping"
        before = next((Path(other.output).stem for other in self.all if other.state == RUNNING), None)
        return f"waiting until {before} has ended" if job.state == WAITING and before else job.state

    def end(self) -> None:
        """Stop all, as the server ends; they are resumed when it starts again."""
        self.ending = True
        for process in self._processes.values():
            _interrupt(process)

    def _log(self, job: Job) -> Path:
        return self.folder / f"{job.number}.log"

    def _set(self, job: Job, state: str) -> None:
        job.state = state
        with contextlib.suppress(OSError):  # a full disk must not end the job
            record = {**dataclasses.asdict(job), "seal": self._seal(job)}
            files.write_text(self.folder / f"{job.number}.json", json.dumps(record))
        self.changed.emit(job)

    def _launch(self, job: Job) -> None:
        self._set(job, WAITING if job.state != RUNNING else RUNNING)
        task = asyncio.get_running_loop().create_task(self._run(job))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _run(self, job: Job) -> None:
        async with self._turn:
            if not job.active or self.ending:
                return
            self._set(job, RUNNING)
            try:
                check_command([*job.words, "-o", job.output], self.project)
                words, environment = processes.python(*job.words)
                if self._log(job).is_symlink():  # in a folder from elsewhere, it could lead to any file of the user's
                    self._log(job).unlink()
                with self._log(job).open("ab") as log:
                    process = await asyncio.create_subprocess_exec(
                        *words, cwd=self.project, env=environment, stdin=asyncio.subprocess.DEVNULL,
                        stdout=log, stderr=asyncio.subprocess.STDOUT, preexec_fn=processes.end_with_parent,
                    )  # fmt: skip
            except (OSError, ValueError) as error:  # a FieldError, or a text that is no path
                with contextlib.suppress(OSError):  # a full disk has no room for it either
                    self._log(job).write_text(f"the command could not be started ({errors.reason(error)})\n", encoding="utf-8")
                return self._set(job, FAILED)
            self._processes[job.number] = process
            if not job.active:  # stopped while it was started
                self.stop(job)
            status = await process.wait()
            del self._processes[job.number]
            if not self.ending:
                self._set(job, JOB_STATES.get(status, STOPPED if job.number in self._stopped else FAILED))


def _interrupt(process: asyncio.subprocess.Process) -> None:
    with contextlib.suppress(ProcessLookupError):  # it has ended
        process.send_signal(signal.SIGINT)


def _kill(process: asyncio.subprocess.Process) -> None:
    if process.returncode is None:
        processes.kill_all(process.pid)


@dataclasses.dataclass(frozen=True)
class Command:
    """The words of a command after ``python -m``, its folder of results, whether it has ``--resume``, and texts of files of the
    project, by their names, that are written before it is started."""

    words: list[str]
    output: str
    resumable: bool = False
    written: Mapping[str, str] = dataclasses.field(default_factory=dict)


class SupersededError(Exception):
    """A newer question of the same kind has been asked."""


class AnswerError(Exception):
    """The sentence for the user of a question that has no answer."""


class WarmWorker:
    """A process of its own that answers questions, by functions of a module that the server does not import, in the order in
    which they are asked. A question that waits is dropped when the same is asked again, as while a slider moves. A process
    that dies, as when memory runs out, is replaced at the next question."""

    def __init__(self, module: str):
        self._worker = processes.Worker(module)
        self._turn = asyncio.Lock()
        self._asked: Counter[str] = Counter()

    async def ask(self, function: str, *args: object, kind: str = "") -> Any:
        """Return what a function of the module returns; its arguments are pickled. Older questions of the same kind (of none
        if empty) are dropped. AnswerError has the function's sentence for the user, SupersededError if the same was asked
        again meanwhile."""
        self._asked[kind] += 1
        number = self._asked[kind]
        async with self._turn:
            if kind and number != self._asked[kind]:
                raise SupersededError
            done, value = await asyncio.shield(asyncio.to_thread(self._answered, function, args))
            if not done:
                raise AnswerError(value)
            return value

    def start(self) -> None:
        """Start the process, which imports its module now and not at the first question."""
        self._worker.start()

    def _answered(self, function: str, args: tuple[object, ...]) -> processes.Answer:
        """Return whether there is an answer, and it; else the sentence why there is none."""
        try:
            return self._worker.call(function, *args)
        except processes.DiedError as error:
            return False, str(error)

    def stop(self) -> None:
        """End the process."""
        self._worker.stop()


FOLDER = "jobs"
JOB_STATES = {commands.EXIT_DONE: DONE, commands.EXIT_NO_EQUILIBRIUM: DONE, commands.EXIT_STOPPED: STOPPED}
"""States by exit status; some photographs refused has that of a limit point. All others are `FAILED`."""
SECOND_SIGNAL_SECONDS, KILL_SECONDS = 0.2, 0.45
"""Seconds after the first signal to a job that shall stop."""
RECORDED_ELSEWHERE = "recorded elsewhere, not run"
"""State of a job that another machine, or anyone without this one's `machine_key`, recorded as waiting or running."""


# ----------------------------------------------------------------------------------------------------------------------
# Commands that the page starts. A project's folder may come from somebody else, and its records name programs to start again.


COMMANDS = {
    "softmodels run": ("-o",),
    "softmodels fit": ("-o", "--exclude", "--tensile", "--material", "--poisson", "--silicone", "--fix"),
    "softmodels mould": (
        "-o", "--silicone", *(f"--{field.name.replace('_', '-')}" for field in dataclasses.fields(settings.Workshop)),
    ),
    "softmodels design": ("-o",),
    "measurement calibrate": ("-o", "--pattern", "--pitch"),
    "measurement photos": ("-o", "--setup", "--tone", "--water-density"),
}  # fmt: skip
"""Options with a value that the page's commands have, by module and command."""
RESUME = "--resume"
FLAGS = {"softmodels run": (RESUME,), "softmodels design": (RESUME,)}
"""The same without a value."""


def check_command(words: list[str], project: Path) -> None:
    """Raise FieldError unless the words after ``python -m`` are a command of `COMMANDS` with its options, whose values and
    files lie in the project's folder, also where links lead."""
    name = " ".join(words[:2])
    if name not in COMMANDS:
        raise errors.FieldError(f"{name!r} is not a command of the page; it starts {', '.join(COMMANDS)}")
    rest = iter(words[2:])
    for word in rest:
        value = word
        if word.startswith("-"):
            if word in FLAGS.get(name, ()):
                continue
            if word not in COMMANDS[name]:
                raise errors.FieldError(f"{word} is not an option of the page's command {name}")
            value = next(rest, "")
        for file in (value, value.rpartition(":")[0]):  # a curve has its test behind a colon
            if not (project / file).resolve().is_relative_to(project.resolve()):
                raise errors.FieldError(f"{value} lies outside of the project's folder, which the page's commands do not leave")


CLOCK_STEP = 1.0
"""Seconds within which a file may change twice and keep its time."""
MAX_LISTED_BYTES = 1 << 20
"""Size of the largest table or list that is searched for the names of further files."""


def digest(words: Sequence[str], project: Path, written: Mapping[str, str] = MappingProxyType({})) -> str:
    """Return SHA-256 of the words after ``python -m`` and of the files of a project that they name, but for the results; and of
    the files that these tables and lists name, such as photographs. Files may have texts other than those that they hold."""
    named = [word for before, word in itertools.pairwise(["", *words[2:]]) if before != "-o"]
    seen: dict[str, str] = {}
    while named:
        word = named.pop()
        for name in (word, word.rpartition(":")[0]):
            file, text = project / name, written.get(name)
            if name in seen or not name or (text is None and not file.exists()):
                continue
            if text is None:
                since = file.stat().st_mtime
                seen[name] = _fingerprint(file, since if time.time() - since > CLOCK_STEP else time.time())
                if file.suffix in (".csv", ".toml") and file.is_file() and file.stat().st_size < MAX_LISTED_BYTES:
                    text = files.read_file(file).decode("utf-8", "replace")
            else:
                seen[name] = hashlib.sha256(text.encode()).hexdigest()
            named += [part for part in re.split(r"[\s\"',]+", text or "") if "." in part[1:]]
    return hashlib.sha256("\n".join([*words, *(f"{name} {seen[name]}" for name in sorted(seen))]).encode()).hexdigest()


@functools.lru_cache(maxsize=4096)
def _fingerprint(file: Path, stamp: float) -> str:
    """Return the fingerprint of a file or folder that was last written at a time."""
    return files.fingerprint(file)


KEY_BYTES = 32


def machine_key() -> bytes:
    """Return the key of this user on this machine, by which the page recognises its own records; it is made at the first call.
    Where it cannot be stored, it is another one in each process, and no job is resumed."""
    home = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    file, key = Path(home) / "softmodels" / "key", b""
    with contextlib.suppress(OSError):
        key = files.read_file(file, KEY_BYTES)
    if len(key) != KEY_BYTES:
        key = secrets.token_bytes(KEY_BYTES)
        with contextlib.suppress(OSError):
            file.parent.mkdir(parents=True, exist_ok=True)
            with files.replaced_whole(file) as aside:
                aside.touch(0o600)
                aside.write_bytes(key)
    return key
