"""A folder that pictures are written into, and what has been written there."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image as Picture
from PIL.PngImagePlugin import PngInfo

from softmodels.results.writing import write_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COMPRESSION = 5
"""Of a PNG: a level more takes half as long again and saves a fifteenth."""


class DrawnFolder:
    """Where pictures go; remembers what was written."""

    def __init__(self, path: Path):
        self.path = path
        self.written: list[Path] = []

    def save(self, name: str, figure: Figure, metadata: Mapping[str, str] | None = None) -> None:
        """Write a figure as NAME.png, with texts in its header."""
        self.add(name, png(figure, metadata))

    def add(self, name: str, picture: bytes) -> None:
        """Write a picture as NAME.png."""
        write_bytes(self.path / f"{name}.png", picture)
        self.written.append(self.path / f"{name}.png")


def png(figure: Figure, texts: Mapping[str, str] | None = None) -> bytes:
    """A figure as a PNG without transparency, which its pages do not have: in half the time, and no larger.

    Args:
        figure: The figure.
        texts: What stands in its header.
    """
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    header = PngInfo()
    for key, text in {"Software": "softmodels", **(texts or {})}.items():
        header.add_itxt(key, text)
    stream = io.BytesIO()
    page = Picture.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
    page.save(stream, "PNG", compress_level=COMPRESSION, pnginfo=header, dpi=(figure.dpi, figure.dpi))
    return stream.getvalue()
