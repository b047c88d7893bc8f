"""Single files that a command writes: never one that it reads, and never one that somebody else made."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path

from measurement.own_files import is_same
from measurement.own_folder import OwnFolderError
from measurement.user_file import check_file, read_text

MARK = "softmodels"
"""What the header of a drawn PNG names as its software."""


def check_output_file(
    path: Path, inputs: Iterable[Path], is_own: Callable[[Path], bool], what: str, option: str
) -> None:
    """Refuse to write a file in the place of an input, or of a file that is not an earlier one of its kind.

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
            raise OwnFolderError(
                f"{path} is read, and {what} would be written over it; give it another name ({option})"
            )
    if path.is_dir():
        raise OwnFolderError(f"{path} is a folder; name a file for {what} ({option})")
    if path.exists() and not is_own(path):
        raise OwnFolderError(
            f"{path} is there and is not {what} of this program, so it is not replaced; give another name ({option}), or "
            "move it away"
        )


def has_table(name: str) -> Callable[[Path], bool]:
    """A test whether a file is TOML with a table of some name."""

    def test(path: Path) -> bool:
        try:
            return name in tomllib.loads(read_text(path))
        except (OSError, ValueError, RecursionError):
            return False

    return test


def is_drawn(path: Path) -> bool:
    """Whether a picture was drawn by this program."""
    from PIL import Image

    try:
        check_file(path)
        with Image.open(path) as image:
            return str(image.info.get("Software", "")).startswith(MARK)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return False
