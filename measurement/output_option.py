"""The option that names a folder for a command's results, and that folder for as long as the command runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import click

from measurement.default_folder import take_default
from measurement.folder_lock import InUseError
from measurement.own_folder import OwnFolder, OwnFolderError
from measurement.result_folder import ResultFolder


class FolderType(click.Path):
    """A folder's name; an empty one, such as an unset variable leaves behind, is refused."""

    name = "folder"

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if not str(value).strip():
            self.fail("the name of the folder is empty", param, ctx)
        return super().convert(value, param, ctx)


def open_folder(
    output: Path | None, default: Path, kind: str, options: Mapping[str, Any], files: Iterable[Path] = ()
) -> ResultFolder:
    """A `ResultFolder` that is let go of when the command ends, however it ends."""
    folder = ResultFolder(output, default, kind, options, files)
    click.get_current_context().call_on_close(folder.leave)
    return folder


def open_place(output: Path | None, default: Path, kind: str, names: Iterable[str]) -> Path:
    """A folder for what several commands write one after the other, locked until the running command ends.

    Args:
        output: Where the user wants it; None for the first of ``default``, ``default-2`` ... that is free or of this kind.
        default: Its name where nothing is in the way.
        kind: What it holds.
        names: All that is written there; folders with a slash at the end.

    Raises:
        OwnFolderError: The folder is not this program's, is in use, or holds somebody else's files of these names.
        OSError: It cannot be written.
    """
    try:
        own = take_default(default, kind, {}) if output is None else OwnFolder(output, kind)
        own.take()
    except InUseError as error:
        raise OwnFolderError(str(error)) from None
    click.get_current_context().call_on_close(own.leave)
    own.claim(names, {"inputs": {}})
    return own.path
