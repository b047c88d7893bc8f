"""A folder that pictures are written into, and what has been written there."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from softmodels.results.writing import replace

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class DrawnFolder:
    """Where pictures go; remembers what was written."""

    def __init__(self, path: Path):
        self.path = path
        self.written: list[Path] = []

    def save(self, name: str, figure: Figure, metadata: Mapping[str, str] | None = None) -> None:
        """Write a figure as NAME.png, with texts in its header."""
        texts = dict(metadata or {})
        replace(self.path / f"{name}.png", lambda path: figure.savefig(path, format="png", metadata=texts))
        self.written.append(self.path / f"{name}.png")
