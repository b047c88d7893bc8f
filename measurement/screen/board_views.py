"""Which of several photographs show a chessboard that a camera can be calibrated from."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from measurement.camera.camera import Points
from measurement.camera.picture_file import PictureError, read_pixels
from measurement.screen.boards import find_chessboard
from measurement.screen.grid_error import GridError


@dataclasses.dataclass(frozen=True, eq=False)
class BoardView:
    """A photograph of a board.

    Attributes:
        path: Its file.
        gray: Its gray values, shape (h, w).
        corners: The board's inner corners in px, shape (n, 2).
    """

    path: str
    gray: NDArray[np.uint8]
    corners: Points

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in px."""
        return self.gray.shape[1], self.gray.shape[0]


def seen_boards(paths: Iterable[str], pattern: tuple[int, int]) -> tuple[list[BoardView], dict[str, str]]:
    """The photographs that show the board, all of one size, and why the others do not count, by path.

    Args:
        paths: The photographs.
        pattern: Inner corners of the board in a row and in a column.
    """
    views: list[BoardView] = []
    refused: dict[str, str] = {}
    first: dict[bytes, str] = {}
    for path in paths:
        try:
            gray = cv2.cvtColor(read_pixels(Path(path)), cv2.COLOR_RGB2GRAY)
        except PictureError as error:
            refused[path] = str(error)
            continue
        # One view that counts twice looks like a camera that is known better.
        same = first.setdefault(hashlib.sha256(gray.tobytes()).digest(), path)
        if same != path or any(view.path == path for view in views):
            refused[path] = f"it is the same picture as {same}, and counts once"
            continue
        if views and gray.shape != views[0].gray.shape:
            width, height = views[0].size
            refused[path] = f"it has {gray.shape[1]} x {gray.shape[0]} pixels, the others {width} x {height}"
            continue
        try:
            views.append(BoardView(path, gray, find_chessboard(gray, pattern).px))
        except GridError as error:
            refused[path] = str(error)
    return views, refused
