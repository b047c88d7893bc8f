"""Cores of the machine, signal handlers of compiled code, and one thread at a time in what cannot be shared."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import os
import signal
import threading
from collections.abc import Callable, Iterator


def cores() -> int:
    """Return the cores that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


# ----------------------------------------------------------------------------------------------------------------------
# The process' signal handlers are the caller's: those that compiled code sets at its start are taken away again.


LARGEST = 512
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
    before = {number: ctypes.create_string_buffer(LARGEST) for number in numbers}
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
