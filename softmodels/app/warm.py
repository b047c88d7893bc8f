"""Processes that keep the solver, or the tracing of photographs, loaded and answer within a slider's move."""

from __future__ import annotations

import asyncio
import contextlib
import importlib
import multiprocessing
import signal
from collections import Counter
from multiprocessing.connection import Connection
from typing import Any


class SupersededError(Exception):
    """A newer question of the same kind has been asked."""


class AnswerError(Exception):
    """The sentence for the user of a question that has no answer."""


class Warm:
    """A process of its own that answers questions in the order in which they are asked.

    A question that waits is dropped when the same is asked again, as while a slider moves. A process that dies, as when
    memory runs out, is replaced at the next question.

    Args:
        module: Module whose functions answer; the server does not import it.
    """

    def __init__(self, module: str):
        self.module = module
        self._turn = asyncio.Lock()
        self._asked: Counter[str] = Counter()
        self._process: multiprocessing.process.BaseProcess | None = None
        self._line: Connection

    async def ask(self, function: str, *args: object, kind: str = "") -> Any:
        """Return what a function of the module returns.

        Args:
            function: Its name.
            args: Its arguments, which are pickled.
            kind: What is asked, for dropping older questions of the same; of none if empty.

        Raises:
            AnswerError: With the function's sentence for the user.
            SupersededError: The same was asked again meanwhile.
        """
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
        if self._process is not None and self._process.is_alive():
            return
        context = multiprocessing.get_context("spawn")
        self._line, far = context.Pipe()
        self._process = context.Process(target=_answer, args=(self.module, far), daemon=False)
        self._process.start()
        far.close()

    def _answered(self, function: str, args: tuple[object, ...]) -> tuple[bool, object]:
        """Return whether there is an answer, and it; else the sentence why there is none."""
        try:
            self.start()
            self._line.send((function, args))
            found: tuple[bool, object] = self._line.recv()
        except (EOFError, OSError):
            self.stop()
            return (
                False,
                "the process that computes ended, perhaps because memory ran out; use larger cells, and try again",
            )
        return found

    def stop(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.terminate()
            self._process.join(5.0)
            self._process = None


def _answer(module: str, line: Connection) -> None:
    """Answer questions until the line is closed; in the process."""
    from softmodels.common.errors import reason
    from softmodels.common.processes import end_with_parent

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the server's
    end_with_parent()
    functions = importlib.import_module(module)
    with contextlib.suppress(EOFError, BrokenPipeError):
        while True:
            function, args = line.recv()
            try:
                line.send((True, getattr(functions, function)(*args)))
            except Exception as error:
                line.send((False, reason(error)))
