"""The film, made by a process beside the one that draws the stills: two cores, and the states and the skin are read once.

The process is forked before anything is rendered, since a window to render in does not survive that.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType

from softmodels.pictures import film
from softmodels.pictures.viewpoint import Look
from softmodels.results.writing import write_bytes

Made = tuple[list[Path], list[str]]
"""The files written, and sentences on what was left out."""


class Film:
    """The film of a run in the making; as a context it ends with the process.

    Args:
        shown: The device.
        folder: Where the film goes.
        beside: Make it in a process of its own, at once; else when it is asked for. Only in a program that has not rendered.
    """

    def __init__(self, shown: Look, folder: Path, beside: bool):
        self.shown, self.folder = shown, folder
        self._process = None
        if beside and sys.platform == "linux":
            context = multiprocessing.get_context("fork")
            self._answer, send = context.Pipe(duplex=False)
            self._process = context.Process(target=_answer_to, args=(send, shown, folder), daemon=True)
            self._process.start()
            send.close()  # else its end would not be noticed here

    def __enter__(self) -> Film:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process is not None and self._process.is_alive():
            self._process.terminate()
            self._process.join()

    def made(self) -> Made:
        """Wait for it.

        Raises:
            OSError: It could not be written.
        """
        if self._process is None:
            return make(self.shown, self.folder)
        try:
            outcome: Made | OSError = self._answer.recv()
        except EOFError:
            self._process.join()
            return [], [f"the film could not be made (its process ended with status {self._process.exitcode})"]
        self._process.join()
        if isinstance(outcome, OSError):
            raise outcome
        return outcome


def make(shown: Look, folder: Path, wanted: Callable[[], bool] = lambda: True) -> Made:
    """Render the frames and write the film in each format, as long as it is wanted."""
    frames = film.frames(shown)
    written: list[Path] = []
    left_out: list[str] = []
    encoders = {"film.gif": film.gif, "film.webp": film.webp}
    with ThreadPoolExecutor(len(encoders)) as both:  # encoders are written in C and let each other run
        encoded = {name: both.submit(encoder, frames) for name, encoder in encoders.items()}
    for name, data in encoded.items():
        if not wanted():
            return written, left_out
        write_bytes(folder / name, data.result())
        written.append(folder / name)
    if film.can_mp4() and wanted():
        try:
            film.write_mp4(folder / "film.mp4", frames)
            written.append(folder / "film.mp4")
        except RuntimeError as error:
            left_out.append(str(error))
    return written, left_out


def _answer_to(answer: Connection, shown: Look, folder: Path) -> None:
    asked_by = os.getppid()
    try:
        # A folder whose drawing was broken off may be another run's by now.
        answer.send(make(shown, folder, lambda: os.getppid() == asked_by))
    except OSError as error:
        answer.send(error)
