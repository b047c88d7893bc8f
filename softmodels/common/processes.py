"""This process: its cores, signal handlers of compiled code, one thread at a time in what cannot be shared, its terminal; and
processes that answer calls."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import importlib
import os
import pickle
import queue
import shutil
import signal
import socket
import subprocess
import sys
import textwrap
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TextIO

from softmodels.common import errors


def cores() -> int:
    """Return the cores that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


PR_SET_PDEATHSIG = 1


def end_with_parent() -> None:
    """Make this process end when its parent ends or is killed (Linux)."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def children(parents: list[int]) -> list[int]:
    """Return the processes that others have started (Linux)."""
    started = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError, ValueError, IndexError):
            if int(status.read_text().rpartition(")")[2].split()[1]) in parents:
                started.append(int(status.parent.name))
    return started


def kill_all(process: int) -> None:
    """Kill a process with all that it has started, such as a launcher and its ranks."""
    generation = [process]
    while generation:
        started = children(generation)
        for number in generation:
            with contextlib.suppress(ProcessLookupError):
                os.kill(number, signal.SIGKILL)
        generation = started


LAUNCHERS = ("PMI", "HYDRA", "MPI", "OMPI", "PMIX")
"""How the environment variables of MPI launchers begin."""


def python(module: str, *words: str) -> tuple[list[str], dict[str, str]]:
    """Return a command and its environment that run a module in another process, which is no rank of this one's MPI and finds
    modules where this one does.

    Left alone, ``python -m`` would look into the folder it is started in first, which may be anybody's.
    """
    environment = {name: value for name, value in os.environ.items() if not name.startswith(LAUNCHERS)}
    path = os.pathsep.join(entry or os.getcwd() for entry in sys.path)  # noqa: PTH109
    return [sys.executable, "-P", "-m", module, *words], {**environment, "PYTHONPATH": path}


def pickled(value: object) -> bytes | None:
    """Return a value as another process reads it; None if it cannot, as with what a script, a notebook or a function defines,
    which exists only in this process."""
    try:
        data = pickle.dumps(value)
    except (pickle.PicklingError, AttributeError, TypeError):
        return None
    return None if b"__main__" in data else data


# ----------------------------------------------------------------------------------------------------------------------
# The process' signal handlers are the caller's: those that compiled code sets at its start are taken away again.


LARGEST_ACTION = 512
"""Bytes, more than any system's ``struct sigaction`` takes."""


@contextlib.contextmanager
def handlers_kept() -> Iterator[None]:
    """Leave the handler of every signal as it was, whatever compiled code sets in here.

    By the C library, which can be called in every thread; Python's own way works only in the main thread.
    """
    if os.name != "posix":
        yield
        return
    library = ctypes.CDLL(None)
    numbers = [int(number) for number in signal.valid_signals() - {signal.SIGKILL, signal.SIGSTOP}]  # never handled
    before = {number: ctypes.create_string_buffer(LARGEST_ACTION) for number in numbers}
    for number, kept in before.items():
        library.sigaction(number, None, kept)
    try:
        yield
    finally:
        for number, kept in before.items():
            library.sigaction(number, kept, None)


GRACE_SECONDS = 30
"""Seconds that a rank has to end itself after a signal, such as the step under way needs."""
_GUARD = """trap '' INT TERM
[ -n "$(head -c 1)" ] || exit
for second in $(seq "$2"); do sleep 1 >&- 2>&-; kill -0 "$1" 2>&- || exit; done
[ -z "$3" ] || echo "$3" >&2
kill -KILL "$1"
"""
"""Waits for a signal's number, then `GRACE_SECONDS`; it leaves where the process $1 has ended meanwhile."""


@contextlib.contextmanager
def ended_after_signal(sentence: str) -> Iterator[None]:
    """Kill this process `GRACE_SECONDS` s after a signal that Python handles, if it is still in here, with a sentence or none.

    Python's handlers do not run in compiled code, and MPI's calls may wait for other processes for ever. Python's own C code
    still writes the signal's number to a pipe, and another process reads it. For the main thread, as all handlers.
    """
    words = ["sh", "-c", _GUARD, "sh", str(os.getpid()), str(GRACE_SECONDS), sentence]
    guard = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, start_new_session=True)
    assert guard.stdin is not None
    os.set_blocking(guard.stdin.fileno(), False)
    before = signal.set_wakeup_fd(guard.stdin.fileno())
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        guard.kill()
        guard.stdin.close()
        guard.wait()


# ----------------------------------------------------------------------------------------------------------------------
# One thread at a time in what cannot be shared: Gmsh, PETSc, MPI and the compiled kernels support only one caller.


WORKER_LOCK = threading.RLock()
"""Held by the thread whose turn it is, which may take it again."""


def one_at_a_time[**P, R](function: Callable[P, R]) -> Callable[P, R]:
    """Let a function wait until no other thread is in one of these; a decorator."""

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        with WORKER_LOCK:
            return function(*args, **kwargs)

    return call


# ----------------------------------------------------------------------------------------------------------------------
# Where output goes. Sentences on a terminal are wrapped between words at its width; in a file or a pipe each stays one line.


COLUMNS = {"stdout": "SOFTMODELS_TERMINAL_OUT", "stderr": "SOFTMODELS_TERMINAL"}
"""Environment variables: columns of the terminal that a command has which has started the ranks, by their streams."""
MIN_TERMINAL_WIDTH = 20


def columns(name: str) -> int | None:
    """Return the columns of the terminal that a stream (``"stdout"`` or ``"stderr"``) writes to; None if it is no terminal."""
    if (given := os.environ.get(COLUMNS[name], "")).isdigit():
        return max(int(given), MIN_TERMINAL_WIDTH)
    stream: TextIO | None = getattr(sys, name)
    if stream is None or not stream.isatty():
        return None
    try:
        width = os.get_terminal_size(stream.fileno()).columns
    except (OSError, ValueError):
        width = shutil.get_terminal_size().columns
    return max(width or shutil.get_terminal_size().columns, MIN_TERMINAL_WIDTH)


def in_notebook() -> bool:
    """Return whether this process is a notebook's kernel, whose output is HTML."""
    ipython = sys.modules.get("IPython")
    return hasattr(ipython and ipython.get_ipython(), "kernel")


def wrapped(text: str, width: int | None) -> str:
    """Return a text whose lines are broken between words, their further lines indented by two more than the first; whole for
    None."""
    if width is None:
        return text
    lines = []
    for line in text.split("\n"):
        indent = " " * (len(line) - len(line.lstrip()))
        lines += textwrap.wrap(
            line, width, subsequent_indent=f"{indent}  ", break_long_words=False, break_on_hyphens=False,
            replace_whitespace=False, drop_whitespace=True,
        ) or [""]  # fmt: skip
    return "\n".join(lines)


def time_left(seconds: float | None) -> str:
    """Return the end of a line of progress: about how long the work still takes, nothing where that is not known."""
    return "" if seconds is None else f", about {max(0.0, seconds):.0f} s left"


def say(text: str, err: bool = False) -> None:
    """Print a sentence to standard output, or to standard error."""
    name = "stderr" if err else "stdout"
    print(wrapped(text, columns(name)), file=getattr(sys, name), flush=True)


# ----------------------------------------------------------------------------------------------------------------------
# Names of files in pictures, as they are: matplotlib takes dollars for formulas and leaves some labels out of legends.


def plain(text: str) -> str:
    """Return a text that matplotlib shows letter by letter; what cannot be shown, such as a line's end, is a space."""
    shown = "".join(letter if letter.isprintable() else " " for letter in text).replace("$", r"\$")
    return f" {shown}" if shown.startswith("_") else shown


# ----------------------------------------------------------------------------------------------------------------------
# Processes that answer calls: kept loaded, so that one question costs only its own time, and replaced when they die.


PROCESS_ENDED_TEXT = (
    "the process that computes ended, perhaps because memory ran out; reduce the problem (larger cells, a smaller photograph, "
    "fewer processes at a time), and try again"
)

type Answer = tuple[bool, Any]
"""Whether a function returned, and its value; else the sentence of its error."""


class DiedError(Exception):
    """The process ended before it answered."""


class Worker:
    """A process that calls functions of one module, which this one need not import, one call at a time; started at the first
    call, and after it died. It is a program of its own, no copy of this one: neither scripts without a guard nor notebooks are
    run again."""

    def __init__(self, module: str):
        self.module = module
        self._process: subprocess.Popen[bytes] | None = None
        self._line: Connection

    def start(self) -> None:
        """Start the process, which imports its module now and not at the first call."""
        if self._process is not None and self._process.poll() is None:
            return
        self.stop()
        here, there = socket.socketpair()
        words, environment = python(__name__, self.module, str(there.fileno()))
        self._process = subprocess.Popen(words, pass_fds=[there.fileno()], env=environment, stdin=subprocess.DEVNULL)
        there.close()
        self._line = Connection(here.detach())

    def call(self, function: str, *args: object) -> Answer:
        """Return the answer of a function of the module; `DiedError` if the process ended meanwhile."""
        try:
            order = pickle.dumps((function, args))
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            return (
                False,
                f"this cannot be sent to another process ({errors.reason(error)}); define its classes in a module",
            )
        try:
            self.start()
            self._line.send_bytes(order)
            answer: Answer = self._line.recv()
        except (EOFError, OSError):
            self.stop()
            raise DiedError(PROCESS_ENDED_TEXT) from None
        return answer

    def answer(self, function: str, task: object, closed: Callable[[], bool] = bool) -> Answer:
        """Return the answer to a task, which is given to a new process once more if the first one dies before all is closed."""
        try:
            with contextlib.suppress(DiedError):
                return self.call(function, task)
            return (False, PROCESS_ENDED_TEXT) if closed() else self.call(function, task)
        except DiedError as error:
            return False, str(error)

    def stop(self) -> None:
        """End the process."""
        if self._process is None:
            return
        self._process.terminate()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._line.close()
        self._process = None


def answers(module: str, function: str, tasks: Mapping[int, object], count: int) -> Iterator[tuple[int, Answer]]:
    """Yield the number of each task and its `Worker.answer`, as soon as it is known; several processes share the tasks."""
    workers = [Worker(module) for _ in range(min(count, len(tasks)))]
    free: queue.SimpleQueue[Worker] = queue.SimpleQueue()
    for worker in workers:
        worker.start()  # by this thread: a process ends with the thread that started it
        free.put(worker)

    closed = threading.Event()

    def answer(task: object) -> Answer:
        worker = free.get()
        try:
            return worker.answer(function, task, closed.is_set)
        finally:
            free.put(worker)

    with ThreadPoolExecutor(max(len(workers), 1)) as pool:
        try:
            numbers = {pool.submit(answer, task): number for number, task in tasks.items()}
            for future in as_completed(numbers):
                yield numbers[future], future.result()
        finally:
            closed.set()
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in workers:
                worker.stop()


def serve(module: str, line: Connection) -> None:
    """Answer calls until the line is closed; in the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's
    end_with_parent()
    functions = importlib.import_module(module)
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            order = line.recv_bytes()
            try:
                function, args = pickle.loads(order)
                line.send((True, getattr(functions, function)(*args)))
            except Exception as error:
                line.send((False, errors.reason(error)))


if __name__ == "__main__":
    serve(sys.argv[1], Connection(int(sys.argv[2])))
