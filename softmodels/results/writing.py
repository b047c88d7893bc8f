"""Files that are written whole or not at all, so that no reader ever sees a part of one."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from measurement.own_files import replaced_whole

if TYPE_CHECKING:
    import h5py


def replace(path: Path, fill: Callable[[Path], object]) -> None:
    """Write a file aside and rename it into place, so that no reader ever sees a part of it."""
    with replaced_whole(path, path.with_name(f"{path.name}.part")) as aside:
        fill(aside)


def replace_hdf5(path: Path, fill: Callable[[h5py.File], object]) -> None:
    """Make an HDF5 file in memory and write its bytes.

    Writing by itself, HDF5 finds a full disk only when it closes the file, and then may crash at the program's end.
    """
    import h5py

    with h5py.File(path.name, "w", driver="core", backing_store=False) as file:
        fill(file)
        file.flush()
        image = file.id.get_file_image()
    replace(path, lambda aside: aside.write_bytes(image))


def hdf5_reason(error: BaseException) -> str:
    """The operating system's word in one of HDF5's long messages, or the message's first line."""
    found = re.search(r"error message = '([^']+)'", str(error))
    return found[1] if found else str(error).strip().splitlines()[0]


def write_text(path: Path, text: str) -> None:
    """Write a small file whole or not at all."""
    replace(path, lambda aside: aside.write_text(text))


def write_bytes(path: Path, data: bytes) -> None:
    """The same of bytes."""
    replace(path, lambda aside: aside.write_bytes(data))
