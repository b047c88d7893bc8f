"""A folder that pictures are written into, and what has been written there."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image as Picture
from PIL.PngImagePlugin import PngInfo

from softmodels.results.writing import write_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COMPRESSION = 3
"""Of a PNG: 5 takes a third longer and saves a sixth."""


class DrawnFolder:
    """Where pictures go; remembers what was written. As a context it ends with all of it on disk.

    Pictures are encoded beside what draws the next one: encoders are written in C and let Python run on.

    Args:
        path: The folder.
        shrink: Makes of a picture what a page holds of it, if there is to be a page.
        each: Gets each file as it is drawn.
    """

    def __init__(
        self,
        path: Path,
        shrink: Callable[[Picture.Image], str] | None = None,
        each: Callable[[Path], object] = lambda path: None,
    ):
        self._each = each
        self.path = path
        self.written: list[Path] = []
        self._shrink = shrink
        self._beside = ThreadPoolExecutor(1)
        self._pages: dict[str, Future[str]] = {}

    def __enter__(self) -> DrawnFolder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._beside.shutdown()  # what was drawn before an error is written too
        if error is None:
            self.pages()

    def save(self, name: str, figure: Figure, metadata: Mapping[str, str] | None = None) -> None:
        """Write a figure as NAME.png, with texts in its header."""
        image, dpi = drawn(figure), figure.dpi
        self._write(name, lambda: (image, encoded(image, dpi, metadata)))

    def add(self, name: str, picture: bytes) -> None:
        """Write a picture as NAME.png."""
        self._write(name, lambda: (Picture.open(io.BytesIO(picture)), picture))

    def _write(self, name: str, make: Callable[[], tuple[Picture.Image, bytes]]) -> None:
        path = self.path / f"{name}.png"

        def write() -> str:
            image, data = make()
            write_bytes(path, data)
            return self._shrink(image) if self._shrink else ""

        self._pages[path.name] = self._beside.submit(write)
        self.drew(path)

    def drew(self, path: Path) -> None:
        """Count a file to what has been drawn."""
        self.written.append(path)
        self._each(path)

    def pages(self) -> dict[str, str]:
        """Wait for what is being written; what a page holds of each picture, by the names of their files.

        Raises:
            OSError: One could not be written.
        """
        return {name: page.result() for name, page in self._pages.items()}


def drawn(figure: Figure) -> Picture.Image:
    """A figure's pixels, without transparency, which its pages do not have: it would double the time, and save nothing."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return Picture.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])


def encoded(image: Picture.Image, dpi: float, texts: Mapping[str, str] | None = None) -> bytes:
    """A PNG.

    Args:
        image: The picture.
        dpi: Its pixels per inch.
        texts: What stands in its header.
    """
    header = PngInfo()
    for key, text in {"Software": "softmodels", **(texts or {})}.items():
        header.add_itxt(key, text)
    stream = io.BytesIO()
    image.save(stream, "PNG", compress_level=COMPRESSION, pnginfo=header, dpi=(dpi, dpi))
    return stream.getvalue()


def png(figure: Figure, texts: Mapping[str, str] | None = None) -> bytes:
    """A figure as a PNG; ``texts`` stand in its header."""
    return encoded(drawn(figure), figure.dpi, texts)
