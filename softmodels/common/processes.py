"""This process: its cores, signal handlers of compiled code, one thread at a time in what cannot be shared, its terminal."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import os
import shutil
import signal
import sys
import textwrap
import threading
from collections.abc import Callable, Iterator
from typing import TextIO


def cores() -> int:
    """Return the cores that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


PR_SET_PDEATHSIG = 1
"""PR_SET_PDEATHSIG of Linux' prctl."""


def end_with_parent() -> None:
    """Make this process end when its parent ends or is killed (Linux)."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


LAUNCHERS = ("PMI", "HYDRA", "MPI", "OMPI", "PMIX")
"""How the environment variables of MPI launchers begin."""


def environment_alone() -> dict[str, str]:
    """Return this process' environment for one that is no rank of its MPI."""
    return {name: value for name, value in os.environ.items() if not name.startswith(LAUNCHERS)}


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


# ----------------------------------------------------------------------------------------------------------------------
# One thread at a time in what cannot be shared: Gmsh, PETSc, MPI and the compiled kernels support only one caller.


LOCK = threading.RLock()
"""Held by the thread whose turn it is, which may take it again."""


def one_at_a_time[**P, R](function: Callable[P, R]) -> Callable[P, R]:
    """Let a function wait until no other thread is in one of these; a decorator."""

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        with LOCK:
            return function(*args, **kwargs)

    return call


# ----------------------------------------------------------------------------------------------------------------------
# Where output goes. Sentences on a terminal are wrapped between words at its width; in a file or a pipe each stays one line.


COLUMNS = {"stdout": "SOFTMODELS_TERMINAL_OUT", "stderr": "SOFTMODELS_TERMINAL"}
"""Environment variables: columns of the terminal that a command has which has started the ranks, by their streams."""
NARROWEST = 20


def columns(name: str) -> int | None:
    """Return the columns of the terminal that a stream (``"stdout"`` or ``"stderr"``) writes to; None if it is no terminal."""
    if (given := os.environ.get(COLUMNS[name], "")).isdigit():
        return max(int(given), NARROWEST)
    stream: TextIO | None = getattr(sys, name)
    if stream is None or not stream.isatty():
        return None
    try:
        width = os.get_terminal_size(stream.fileno()).columns
    except (OSError, ValueError):
        width = shutil.get_terminal_size().columns
    return max(width or shutil.get_terminal_size().columns, NARROWEST)


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
