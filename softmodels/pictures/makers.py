"""What makes the pictures of a run and can begin before the run ends: the film's process, and the pictures at rest."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

from measurement.ending import unswept
from softmodels.case.own_modules import OwnModuleError, import_own_modules
from softmodels.pictures.at_rest import AtRest
from softmodels.pictures.film_beside import Film
from softmodels.pictures.offscreen import can_render


class Makers:
    """Makers of pictures, ready to begin; as a context they end with the film's process.

    Args:
        beside: Make the film in a process of its own, in a program that has not rendered.
        rendered: Whether this machine can render.
    """

    def __init__(self, beside: bool, rendered: bool):
        self.film, self.rest = Film(beside and rendered), AtRest(rendered)

    def __enter__(self) -> Makers:
        self.film.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.film.__exit__(kind, error, trace)

    def draw_early(self, folder: Path, name: str) -> None:
        """Do what can be done as soon as a run has stored its first state.

        Args:
            folder: Results with their ``case.toml``.
            name: Stem of the result files.
        """
        if self.rest.rendered:
            self.film.rehearse(folder, name)
        self.rest.draw_early(folder, name)


def orders() -> Iterator[list[Any]]:
    """Orders from standard input, each a list in JSON on a line: of those that have come meanwhile the last."""
    left = b""
    while data := os.read(0, 1 << 16):
        *whole, left = (left + data).split(b"\n")
        if whole:
            yield json.loads(whole[-1])


def get_ready(beside: bool) -> Makers:
    """Load what renders and see whether this machine can, before there is anything to draw; ``beside`` as of `Makers`."""
    with unswept():  # taking VTK apart at the end would be a tenth of all drawing
        import pyvista.plotting  # noqa: F401

        with contextlib.suppress(OwnModuleError):  # reported when something is drawn
            import_own_modules()
    return Makers(beside, can_render())
