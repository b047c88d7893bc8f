"""The type of the option that names a folder for results."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click


class FolderType(click.Path):
    """A folder's name; an empty one, such as an unset variable leaves behind, is refused."""

    name = "folder"

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if not str(value).strip():
            self.fail("the name of the folder is empty", param, ctx)
        return super().convert(value, param, ctx)
