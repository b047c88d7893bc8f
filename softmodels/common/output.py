"""What a command writes: a folder of results that is replaced whole at its end, and single files.

Earlier results are replaced whole or stay. No file is written over one that is read, nor over one that somebody else made.
"""

from __future__ import annotations

import contextlib
import hashlib
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from softmodels.common.errors import reason
from softmodels.common.files import check_file, file_digest, is_same, read_text
from softmodels.common.folders import InUseError, OwnFolder, OwnFolderError, take_default

if TYPE_CHECKING:
    pass


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
        """Provide a folder to write all results into, which take the place of the earlier ones at the end of the block.

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
    """Return SHA-256 of a file, or of a folder's CSV files and their names; ``"missing"`` where there is none."""
    try:
        if path.is_dir():
            parts = [f"{file.name} {fingerprint(file)}" for file in sorted(path.glob("*.csv"))]
            return hashlib.sha256("\n".join(parts).encode()).hexdigest()
        return file_digest(path)
    except OSError:
        return "missing"


# ----------------------------------------------------------------------------------------------------------------------
# Single files that a command writes: never one that it reads, and never one that somebody else made.


MARK = "softmodels"
"""What the header of a drawn PNG names as its software."""


def check_output_file(
    path: Path, inputs: Iterable[Path], is_own: Callable[[Path], bool], what: str, option: str
) -> None:
    """Reject to write a file in the place of an input, or of a file that is not an earlier one of its kind.

    Args:
        path: Where it is to go.
        inputs: Files that are read.
        is_own: Whether a file is one of its kind.
        what: Its kind in words, such as ``"a setup"``.
        option: The option that names it.

    Raises:
        OwnFolderError: It would replace something else, with what to do.
    """
    for file in inputs:
        if is_same(path, file):
            raise OwnFolderError(f"{path} is an input and would be overwritten by {what}; give another name ({option})")
    if path.is_dir():
        raise OwnFolderError(f"{path} is a folder; name a file for {what} ({option})")
    if path.exists() and not is_own(path):
        raise OwnFolderError(
            f"{path} exists and is not {what} of this program, so it is not replaced; give another name ({option}), or "
            "move it away"
        )


def has_table(name: str) -> Callable[[Path], bool]:
    """Return a test whether a file is TOML with a table of some name."""

    def test(path: Path) -> bool:
        try:
            return name in tomllib.loads(read_text(path))
        except (OSError, ValueError, RecursionError):
            return False

    return test


def is_drawn(path: Path) -> bool:
    """Return whether a picture was drawn by this program."""
    from PIL import Image

    try:
        check_file(path)
        with Image.open(path) as image:
            return str(image.info.get("Software", "")).startswith(MARK)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return False
