"""Pictures of the undeformed device, which can be drawn while its path is still being solved."""

from __future__ import annotations

import contextlib
from pathlib import Path

import matplotlib
import numpy as np

from softmodels.case.case import CaseError
from softmodels.pictures import section_pictures, solid_pictures
from softmodels.pictures.drawn_folder import png
from softmodels.pictures.style import STYLE
from softmodels.pictures.viewpoint import Look, look
from softmodels.results.store import ResultsError
from softmodels.results.stored import States


class AtRest:
    """Pictures of a device at rest, drawn once.

    Args:
        rendered: Whether this machine can render.
    """

    def __init__(self, rendered: bool):
        self.rendered = rendered
        self._of: Look | None = None
        self._drawn: dict[str, bytes] = {}

    def draw_early(self, folder: Path, name: str) -> None:
        """Draw them from the first states of results; what fails is reported when all is drawn.

        Args:
            folder: Results with their ``case.toml``.
            name: Stem of the result files.
        """
        with contextlib.suppress(ResultsError, CaseError, OSError):
            self.pictures(look(States(folder, name)))

    def pictures(self, shown: Look) -> dict[str, bytes]:
        """PNG files by their stems; drawn now, unless they have been drawn of this very device."""
        if self._of is None or not _same(self._of, shown):
            with matplotlib.rc_context(STYLE):
                self._drawn = self._all(shown)
            self._of = shown
        return self._drawn

    def _all(self, shown: Look) -> dict[str, bytes]:
        states, figures = shown.states, {}
        if states.actuator.dimension == 2:
            figures["mesh"] = section_pictures.section_mesh(states.points, states.cells)
        if self.rendered:
            figures["undeformed"] = solid_pictures.undeformed(shown)
            if states.actuator.dimension == 3:
                figures["mesh"] = solid_pictures.mesh(shown)
        return {stem: png(figure) for stem, figure in figures.items()}


def _same(one: Look, other: Look) -> bool:
    """Whether two looks show the same mesh in the same way."""
    return (
        one.states.actuator == other.states.actuator
        and np.array_equal(one.states.points, other.states.points)
        and np.array_equal(one.states.cells, other.states.cells)
        and np.array_equal(one.kept, other.kept)
        and np.array_equal(one.direction, other.direction)
    )
