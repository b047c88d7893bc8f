"""One thread at a time in what cannot be shared: Gmsh, PETSc, MPI and the compiled equations know of one caller alone."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable

LOCK = threading.RLock()
"""Held by the thread whose turn it is, which may take it again."""


def one_at_a_time[**P, R](function: Callable[P, R]) -> Callable[P, R]:
    """Let a function wait until no other thread is in one of these; a decorator."""

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        with LOCK:
            return function(*args, **kwargs)

    return call
