"""Processes that keep the solver, or the tracing of photographs, loaded and answer within a slider's move."""

from __future__ import annotations

import asyncio
from collections import Counter
from typing import Any

from softmodels.common.workers import Answer, DiedError, Worker


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
        self._worker = Worker(module)
        self._turn = asyncio.Lock()
        self._asked: Counter[str] = Counter()

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
        self._worker.start()

    def _answered(self, function: str, args: tuple[object, ...]) -> Answer:
        """Return whether there is an answer, and it; else the sentence why there is none."""
        try:
            return self._worker.call(function, *args)
        except DiedError as error:
            return False, str(error)

    def stop(self) -> None:
        """End the process."""
        self._worker.stop()
