"""Words that a library below prints by itself, kept off the terminal."""

from __future__ import annotations

import contextlib
import ctypes
import os
import tempfile
from collections.abc import Iterator

STREAMS = (1, 2)
"""Standard output and errors."""


@contextlib.contextmanager
def hushed(words: bytes) -> Iterator[None]:
    """Leave lines with these words out of what is written to standard output and errors; all other lines come afterwards.

    It is for short calls: what other threads write meanwhile comes late too.
    """
    library = ctypes.CDLL(None)
    with contextlib.ExitStack() as stack:
        for stream in STREAMS:
            with contextlib.suppress(OSError):  # closed, as in a service: nothing is seen there
                stack.enter_context(_filtered(stream, words))
        try:
            yield
        finally:
            library.fflush(None)  # what C has not written yet


@contextlib.contextmanager
def _filtered(stream: int, words: bytes) -> Iterator[None]:
    before = os.dup(stream)
    with tempfile.TemporaryFile() as heard:
        os.dup2(heard.fileno(), stream)
        try:
            yield
        finally:
            os.dup2(before, stream)
            heard.seek(0)
            if kept := b"".join(line for line in heard if words not in line):
                os.write(before, kept)
            os.close(before)
