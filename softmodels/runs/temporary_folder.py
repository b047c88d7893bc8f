"""A folder for a while, the same on all ranks."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from softmodels.mechanics.mpi import is_root, on_root

if TYPE_CHECKING:
    from mpi4py import MPI


@contextlib.contextmanager
def temporary_folder(comm: MPI.Comm) -> Iterator[Path]:
    """A folder for a while, the same on all ranks."""
    path = on_root(comm, lambda: Path(tempfile.mkdtemp(prefix="softmodels-")))
    try:
        yield path
    finally:
        if is_root(comm):
            shutil.rmtree(path, ignore_errors=True)
