"""The process' signal handlers are the caller's: those that compiled code sets at its start are taken away again."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
from collections.abc import Iterator

LARGEST = 512
"""Bytes, more than any system's ``struct sigaction`` takes."""


@contextlib.contextmanager
def handlers_kept() -> Iterator[None]:
    """Leave the handler of every signal as it was, whatever compiled code sets in here.

    By the C library, which can be called in every thread; Python's own way works in the main thread alone.
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
