"""Which of several photographs show a chessboard that a camera can be calibrated from."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from measurement.camera.camera import Points
from measurement.camera.picture_file import PictureError, read_pixels
from measurement.cores import cores
from measurement.screen.boards import GridPoints, find_chessboard
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


def seen_boards(
    paths: Iterable[str], pattern: tuple[int, int], each: Callable[[], object] = lambda: None
) -> tuple[list[BoardView], dict[str, str]]:
    """The photographs that show the board, all of one size, and why the others do not count, by path.

    Args:
        paths: The photographs.
        pattern: Inner corners of the board in a row and in a column.
        each: Called after each photograph.
    """
    views: list[BoardView] = []
    refused: dict[str, str] = {}
    first: dict[bytes, str] = {}
    searches: list[tuple[str, NDArray[np.uint8], Future[GridPoints]]] = []
    with ThreadPoolExecutor(cores()) as pool:  # OpenCV lets other threads run
        for path in paths:
            try:
                gray = np.asarray(cv2.cvtColor(read_pixels(Path(path)), cv2.COLOR_RGB2GRAY), dtype=np.uint8)
            except PictureError as error:
                refused[path] = str(error)
                each()
                continue
            # One view that counts twice looks like a camera that is known better.
            same = first.setdefault(hashlib.sha256(gray.tobytes()).digest(), path)
            if same != path or any(path == other for other, _, _ in searches):
                refused[path] = f"it is the same picture as {same}, and counts once"
                each()
                continue
            searches.append((path, gray, pool.submit(find_chessboard, gray, pattern)))
        for path, gray, search in searches:
            if views and gray.shape != views[0].gray.shape:
                width, height = views[0].size
                refused[path] = f"it has {gray.shape[1]} x {gray.shape[0]} pixels, the others {width} x {height}"
                search.cancel()
            else:
                try:
                    views.append(BoardView(path, gray, search.result().px))
                except GridError as error:
                    refused[path] = str(error)
            each()
    return views, refused
