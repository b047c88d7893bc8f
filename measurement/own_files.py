"""Files in a folder that is a program's own: which of them count, which are its own, and how they are written and removed."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

HIDDEN = ".softmodels"
"""What the names of files and folders begin with that a folder's record, lock and preparation have."""


def is_same(one: Path, other: Path) -> bool:
    """Whether two names are of one file, which may be reached in several ways."""
    try:
        return one.samefile(other)
    except OSError:
        return False


def version() -> str:
    """The installed version; of a bare checkout unknown."""
    import importlib.metadata

    try:
        return importlib.metadata.version("softmodels")
    except importlib.metadata.PackageNotFoundError:
        return "unknown"


@contextlib.contextmanager
def replaced_whole(path: Path, aside: Path | None = None) -> Iterator[Path]:
    """A file beside another to write to, which takes the other's place at the end of the block; if that fails it goes.

    Args:
        path: The file to replace.
        aside: The one beside it; a hidden name of this process with the same ending unless given.
    """
    aside = path.with_name(f".{os.getpid()}-{path.name}") if aside is None else aside
    try:
        aside.unlink(missing_ok=True)  # a link there, in a folder from elsewhere, would be written through
        yield aside
        aside.replace(path)
    finally:
        with contextlib.suppress(OSError):
            aside.unlink(missing_ok=True)


def replace_text(path: Path, text: str) -> None:
    """Write a small file whole or not at all."""
    with replaced_whole(path, path.with_name(f"{path.name}.part")) as aside:
        aside.write_text(text, encoding="utf-8")


def is_inside(name: Any) -> bool:
    """Whether a recorded name is a file's or folder's right in the folder: a record may have come from elsewhere."""
    return isinstance(name, str) and re.fullmatch(r"[^/\\\0]+/?", name) is not None and name.strip("./") != ""


def counts(file: Path) -> bool:
    """Whether a file in a folder makes it one that is in use: not what locking and preparing leave there."""
    return not file.name.startswith(HIDDEN)


def some(names: list[str]) -> str:
    return ", ".join(map(repr, names[:3])) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def is_step(name: str) -> bool:
    """Whether a file in a folder of steps is one of a run's: they come and go too often to be recorded one by one."""
    return re.fullmatch(r"\d{4,}\.h5(\.part)?", name) is not None


def remove_inside(folder: Path, names: Iterable[str] = (), keep: Iterable[str] = ()) -> None:
    gone, kept = set(names), set(keep)
    for file in folder.iterdir():
        if file.name not in kept and (file.name in gone or is_step(file.name)):
            file.unlink(missing_ok=True)


def remove_steps(folder: Path, names: Iterable[str] = ()) -> None:
    """Take away a folder inside a folder of results: steps, and files by name. Where others are in it, they stay in it."""
    if folder.is_dir() and not folder.is_symlink():
        remove_inside(folder, names)
        with contextlib.suppress(OSError):  # something of the user's is in it
            folder.rmdir()
