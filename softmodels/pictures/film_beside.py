"""The film, made by a process beside the one that draws the stills, on two cores.

The process is forked before anything is rendered, since a window to render in does not survive that.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType

from measurement.cores import cores
from softmodels.case.case import CaseError
from softmodels.pictures import film
from softmodels.pictures.viewpoint import Look, look
from softmodels.results.store import ResultsError
from softmodels.results.stored import States
from softmodels.results.writing import write_bytes

Place = tuple[Path, str]
"""A folder of results, and their name."""
Made = tuple[list[Path], list[str]]
"""The files written, and sentences on what was left out."""


class Film:
    """What makes the film of a run; as a context it ends with its process.

    Args:
        beside: Make it in a process of its own, forked at once; else when it is asked for. Only in a program that has not
            rendered.
    """

    def __init__(self, beside: bool):
        self._process = None
        self._place: Place | None = None
        if beside and sys.platform == "linux":
            # What renders without a graphics card takes all cores for each picture, and the two processes would wait for
            # each other's threads.
            os.environ.setdefault("LP_NUM_THREADS", str(max(cores() // 2 - 1, 0)))
            context = multiprocessing.get_context("fork")
            self._pipe, other = context.Pipe()
            self._process = context.Process(target=_answer_to, args=(other, self._pipe), daemon=True)
            self._process.start()
            other.close()  # else its end would not be noticed here

    def __enter__(self) -> Film:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process is not None and self._process.is_alive():
            self._process.terminate()
            self._process.join()

    def rehearse(self, folder: Path, name: str) -> None:
        """Have its process open its window and take a picture of the first states, of which nothing is kept."""
        self._tell((folder, name), True)

    def begin(self, folder: Path, name: str) -> None:
        """Begin to make it, from results into their folder."""
        self._place = (folder, name)
        self._tell(self._place, False)

    def _tell(self, place: Place, rehearsal: bool) -> None:
        if self._process is not None:
            with contextlib.suppress(BrokenPipeError):  # its end is reported when it is waited for
                self._pipe.send((place, rehearsal))

    def made(self) -> Made:
        """Wait for it.

        Raises:
            OSError: It could not be written.
        """
        assert self._place is not None
        if self._process is None:
            return make(look(States(*self._place)), self._place[0])
        try:
            outcome: Made | OSError = self._pipe.recv()
        except (EOFError, ConnectionResetError):
            self._process.join()
            return [], [f"the film could not be made (its process ended with status {self._process.exitcode})"]
        self._pipe.close()  # which ends the process
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


def _answer_to(pipe: Connection, others: Connection) -> None:
    """Rehearse and make films as told, until nobody tells any more."""
    others.close()  # open here too, it would keep the pipe open when the process that holds it ends
    asked_by = os.getppid()
    while True:
        try:
            place, rehearsal = pipe.recv()
        except EOFError:
            return
        if rehearsal:
            with contextlib.suppress(ResultsError, CaseError, OSError):  # reported when the film is made
                film.frames(look(States(*place)), 1)
            continue
        try:
            # A folder whose drawing was broken off may be another run's by now.
            pipe.send(make(look(States(*place)), place[0], lambda: os.getppid() == asked_by))
        except OSError as error:
            pipe.send(error)
        except (ResultsError, CaseError) as error:
            pipe.send(([], [f"the film could not be made ({error})"]))
