"""Run a Gmsh task in a separate process, so that it can be stopped and cannot crash the caller.

Gmsh and its CAD kernel do not hear Ctrl-C while they work, may end the whole process on a damaged file, and print words of
their own. In a process of its own all three are somebody else's: it is killed when the caller is stopped, a crash becomes a
sentence, and its output is hidden.
"""

from __future__ import annotations

import pickle
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from softmodels.common.errors import MeshingError, MeshingStopped

LOOK = 0.02
"""Polling interval in seconds for the end of the task or a stop request."""

WORKER = """
import os, pickle, sys
answer = os.dup(1)
os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
sys.path[:] = pickle.load(sys.stdin.buffer)
from geometries.apart import answer_to
with os.fdopen(answer, "wb") as out:
    out.write(answer_to(sys.stdin.buffer.read()))
"""


def apart[T](task: Callable[..., T], *arguments: Any, stopped: Callable[[], bool] = bool) -> T:
    """Carry out a task in another process and return its result.

    Args:
        task: A function of a module, which the other process imports by name.
        arguments: What it is called with.
        stopped: Asked several times a second; once it is true the task is killed.

    Raises:
        MeshingStopped: ``stopped`` was true.
        MeshingError: The process died.
        Exception: What the task raised.
    """
    try:
        order = pickle.dumps((task, arguments))
    except (pickle.PicklingError, AttributeError, TypeError):
        order = b"__main__"
    if b"__main__" in order:
        return task(*arguments)  # a class of a script, a notebook or a function: defined only in this process
    with tempfile.TemporaryFile() as words, tempfile.TemporaryFile() as answer, tempfile.TemporaryFile() as errors:
        pickle.dump(sys.path, words)
        words.write(order)
        words.seek(0)
        # A session of its own: Ctrl-C at a terminal reaches all of the foreground's processes, and this one is ended by us.
        process = subprocess.Popen(
            [sys.executable, "-P", "-c", WORKER], stdin=words, stdout=answer, stderr=errors, start_new_session=True
        )
        try:
            while process.poll() is None:
                if stopped():
                    raise MeshingStopped
                time.sleep(LOOK)
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
        if process.returncode:
            errors.seek(0)
            raise MeshingError(_death(process.returncode, errors.read().decode(errors="replace")))
        answer.seek(0)
        done, value = pickle.load(answer)
    if not done:
        raise value
    return value  # type: ignore[no-any-return]


def interpreter() -> list[str]:
    """Return how to start Python for a child with this process' module search path.

    Left alone, Python would look into the folder it is started in first, which may be anybody's.
    """
    return [sys.executable] if {"", str(Path.cwd())} & set(sys.path) else [sys.executable, "-P"]


def answer_to(order: bytes) -> bytes:
    """Carry out a pickled task; return its pickled result, or what it raised."""
    task, arguments = pickle.loads(order)
    try:
        return pickle.dumps((True, task(*arguments)))
    except Exception as error:
        return pickle.dumps((False, error))


def _death(status: int, words: str) -> str:
    """Return why a process ended, as a sentence."""
    if status == -signal.SIGKILL:
        return "the mesher was killed, most likely out of memory; use larger cells (--cell-size)"
    if status < 0:
        return (
            f"the mesher crashed ({signal.Signals(-status).name}); the file it read may be damaged, or the cells too "
            "small for the memory; try another cell size"
        )
    last = words.strip().splitlines()[-1:] or [f"status {status}"]
    return f"the meshing process failed ({last[0]})"
