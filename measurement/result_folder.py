"""The folder that a command writes all its results into at its end: earlier results are replaced whole or stay."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from measurement.default_folder import take_default
from measurement.folder_lock import InUseError
from measurement.own_folder import OwnFolder, OwnFolderError
from measurement.reasons import reason
from measurement.user_file import file_digest

NO_INPUT = ("output", "quiet", "no_pictures", "jobs")
"""Options that change nothing in a command's numbers."""


class ResultFolder:
    """A command's folder of results, locked from its beginning to its end.

    Args:
        output: Where the user wants it; None for the first of ``default``, ``default-2`` ... that is free or holds results of
            the very same inputs.
        default: Its name where nothing is in the way.
        kind: What it holds.
        options: The command's options, by name.
        files: Files that are read, or folders of CSV files. They are never replaced.

    Raises:
        OwnFolderError: The folder is not this program's, is in use, or cannot be written; the message is a sentence.
    """

    def __init__(
        self, output: Path | None, default: Path, kind: str, options: Mapping[str, Any], files: Iterable[Path] = ()
    ):
        files = list(files)
        self._inputs = {
            "options": {name: repr(value) for name, value in sorted(options.items()) if name not in NO_INPUT},
            "files": {str(file): fingerprint(file) for file in files},
        }
        try:
            if output is None:
                self._own = take_default(default, kind, self._inputs)
            else:
                self._own = OwnFolder(output, kind)
                self._own.take()
            try:
                self._own.check_inputs(files)
            except OwnFolderError:
                self._own.leave()
                raise
        except InUseError as error:
            raise OwnFolderError(str(error)) from None
        except OSError as error:
            raise OwnFolderError(f"the folder {output or default} cannot be written ({reason(error)})") from None

    @property
    def path(self) -> Path:
        return self._own.path

    @contextlib.contextmanager
    def writing(self) -> Iterator[Path]:
        """A folder to write all results into, which take the place of the earlier ones at the end of the block.

        Raises:
            OwnFolderError: Somebody else's file has the name of a result.
            OSError: There is no room; the earlier results stay.
        """
        yield self._own.prepare()
        self._own.bring_in({"inputs": self._inputs})

    def leave(self) -> None:
        """Let go of it; nothing is left where nothing was written."""
        self._own.leave()


def fingerprint(path: Path) -> str:
    """SHA-256 of a file, or of a folder's CSV files and their names; ``"missing"`` where there is none."""
    try:
        if path.is_dir():
            parts = [f"{file.name} {fingerprint(file)}" for file in sorted(path.glob("*.csv"))]
            return hashlib.sha256("\n".join(parts).encode()).hexdigest()
        return file_digest(path)
    except OSError:
        return "missing"
