"""How a command ends when somebody stops it or its output has nowhere to go: one sentence and a status, no traceback.

Imports nothing but the standard library, so that it stands before all that takes its time.
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

FAILED, STOPPED = 1, 130
STOPS = (signal.SIGINT, signal.SIGTERM)
LONGEST_SENTENCE = 1000
"""Characters of a sentence on standard error; a user's own text in it may be a whole file's content."""


def bounded(sentence: str) -> str:
    """A sentence of at most `LONGEST_SENTENCE` characters: of a longer one the beginning and the end, with dots between."""
    if len(sentence) <= LONGEST_SENTENCE:
        return sentence
    half = (LONGEST_SENTENCE - 5) // 2
    return f"{sentence[:half]} ... {sentence[-half:]}"


@contextlib.contextmanager
def unswept() -> Iterator[None]:
    """Keep the collector of reference cycles away from all there is by the end of this: for imports, which stay.

    Looking through them again and again, the most at the end of the process, takes a fifth of a short command's time. A
    process that goes on after the command has `gc.unfreeze` for it.
    """
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
        atexit.unregister(gc.freeze)
        atexit.register(gc.freeze)  # what a process leaves behind goes with it


@contextlib.contextmanager
def stoppable(name: str, speaks: Callable[[], bool] = lambda: True) -> Iterator[None]:
    """End the process at once on Ctrl-C in here, with a sentence: for imports, which an exception leaves half done.

    They are `unswept`.

    Args:
        name: The program's, in front of the sentence.
        speaks: Whether this process may print.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may set handlers, and only it is interrupted
        return

    def end(number: int, frame: Any) -> None:
        if speaks():
            os.write(2, f"{name}: stopped by the user\n".encode())
        os._exit(STOPPED)

    before = signal.signal(signal.SIGINT, end)
    try:
        with unswept():
            yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def asked_to_stop() -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C or SIGTERM came in here, to be asked at moments that suit; a second one ends the process at once.

    For a command, whose process it is; a library's caller has handlers of their own.
    """
    received: list[int] = []

    def note(number: int, frame: Any) -> None:
        if received:
            os._exit(STOPPED)
        received.append(number)

    before = {number: signal.signal(number, note) for number in STOPS}
    try:
        yield lambda: bool(received)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def written(tell: Callable[[str], Any]) -> Iterator[None]:
    """Exit with `FAILED` and a sentence where something cannot be written in here, standard output among it.

    A reader that has gone (a pipe to ``head``) wanted no more, and gets no sentence.

    Args:
        tell: Takes the sentence.
    """
    try:
        try:
            yield
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()  # else Python finds out after the last line of the program
    except BrokenPipeError:
        _give_up_output()
        sys.exit(FAILED)
    except OSError as error:
        _give_up_output()
        what = f"{error.filename} cannot be read or written" if error.filename else "the output cannot be written"
        with contextlib.suppress(OSError):
            tell(f"{what} ({error.strerror or error})")
        sys.exit(FAILED)


def _give_up_output() -> None:
    """What is still in the buffer goes nowhere, so that the end of the program does not stumble over it again."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        sys.stdout.flush()
    with contextlib.suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
