"""The screen's plane as the options of the setup command ask for it: by the grid, a board, known points or a scale."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from measurement.camera.camera import Camera
from measurement.cli import option_texts as texts
from measurement.screen.boards import find_charuco, find_chessboard
from measurement.screen.grid import counted_from, find_grid
from measurement.screen.known_points import plane_of_points, plane_of_scale
from measurement.screen.plane import Plane
from measurement.screen.setup import PITCH_ERROR, SetupError
from measurement.units import number

LARGEST = 0.5
"""Largest pitch in m of a printed grid or board; beyond it somebody wrote m for mm."""


@dataclasses.dataclass(frozen=True)
class PlaneOptions:
    """The options' texts.

    Attributes:
        target: What lies in the plane: ``grid``, ``chessboard`` or ``charuco``.
        grid_pitch: Distance of the grid's lines, or side of a board's square.
        pattern: Inner corners of the board.
        dictionary: OpenCV's name of the ChArUco markers.
        marker_share: Side of such a marker over that of a square.
        points: Known points in place of a target.
        scale: Pixels per length in place of a target; None without.
        origin: Pixel near the origin; None for the middle.
    """

    target: str
    grid_pitch: str
    pattern: str
    dictionary: str
    marker_share: str
    points: tuple[str, ...]
    scale: str | None
    origin: str | None

    @property
    def shows_grid(self) -> bool:
        """Whether the photograph shows the printed grid."""
        return self.target == "grid" and self.scale is None and not self.points

    @property
    def known(self) -> str | None:
        """What the plane is fitted to, in the plural; None for a scale, which fits nothing."""
        if self.scale is not None:
            return None
        return "known points" if self.points else "crossings" if self.target == "grid" else "corners"

    def pitch(self) -> float:
        """The pitch in m.

        Raises:
            SetupError, UnitError: It is none.
        """
        return self._pitch()[0]

    def pitch_error(self) -> float:
        """Standard error of the pitch as a share of it: as given, else `PITCH_ERROR`; 0 where no pitch is used.

        Raises:
            SetupError, UnitError: It is none.
        """
        if self.points or self.scale is not None:
            return 0.0
        pitch, error = self._pitch()
        return error / pitch if "+-" in self.grid_pitch.replace("±", "+-") else PITCH_ERROR

    def _pitch(self) -> tuple[float, float]:
        pitch, error = texts.with_error(self.grid_pitch, texts.length)
        if not pitch > 0.0:
            raise SetupError(f"--grid-pitch must be a positive length, not {self.grid_pitch}")
        if pitch > LARGEST:
            raise SetupError(f"--grid-pitch {self.grid_pitch} is no grid of this kind; write mm for millimetres")
        if not 0.0 <= error < pitch:
            raise SetupError(f"the error in --grid-pitch {self.grid_pitch} must not be negative, and below the pitch")
        return pitch, error

    def plane(self, picture: NDArray[np.uint8], camera: Camera) -> Plane:
        """The plane in a photograph (h, w, 3).

        Raises:
            GridError, PlaneError, SetupError, UnitError: It is not to be found, or not asked for as it can be.
        """
        pitch = self.pitch()
        place = None if self.origin is None else texts.numbers(self.origin, 2, "--origin")
        origin = (place[0], place[1]) if place else None
        if self.scale is not None:
            if self.points:
                raise SetupError("give --point or --scale, not both")
            return plane_of_scale(camera, *texts.with_error(self.scale, texts.per_metre), origin)
        if self.points:
            px, metres = zip(*map(texts.known_point, self.points), strict=True)
            return plane_of_points(camera, np.array(px), np.array(metres))
        if self.target == "grid":
            return find_grid(picture, camera, pitch, origin).plane(camera)
        columns, rows = texts.pattern(self.pattern)
        if self.target == "chessboard":
            board = find_chessboard(picture, (columns, rows), camera)
        else:
            squares = (columns + 1, rows + 1)
            board = find_charuco(picture, squares, number(self.marker_share), self.dictionary, camera)
        return counted_from(board, camera, pitch, origin).plane(camera)
