"""How a command begins and ends: one sentence and a status, on one rank. It imports little, so that help is quick."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NoReturn

import click

from softmodels.common import commands, errors
from softmodels.mechanics import mpi


def main(command: click.Command) -> None:
    """Run a click command; usage errors print one sentence on one rank; exit status 2."""
    if not mpi.speaks():
        sys.stdout = open(os.devnull, "w")  # noqa: PTH123, SIM115  (help is printed once too, and the stream stays open)
    with mpi.exits_together(), commands.ending(_tell):
        try:
            if os.environ.get(errors.OWN_MODULES):
                _import_own_modules()
            command.main(standalone_mode=False)
        finally:
            gc.unfreeze()  # for callers whose process continues


def _import_own_modules() -> None:
    from softmodels.case import materials

    try:
        materials.import_own_modules()
    except materials.OwnModuleError as error:
        fail(str(error))


def fail(message: str, status: int = 2) -> NoReturn:
    """Print an error message on one rank, whichever has it, and exit."""
    _tell(message, only_here=not mpi.ends_with_others())
    sys.exit(status)


@contextlib.contextmanager
def unwritable(what: str | Path, does: str = "cannot be written") -> Iterator[None]:
    """Exit with a sentence where a file cannot be opened or written in here."""
    try:
        yield
    except OSError as error:
        fail(f"{what} {does} ({errors.reason(error)})", commands.status_of(error))


def write_into(folder: commands.ResultFolder, write: Callable[[Path], None], what: str) -> None:
    """Write all results (``what``, such as "the tables") into a folder at once; exit with a sentence if that fails."""
    with unwritable(what, f"cannot be written into {folder.path}"), folder.writing() as place:
        write(place)


def _tell(message: str, only_here: bool = False) -> None:
    if only_here or mpi.speaks():
        with contextlib.suppress(OSError):  # stderr is closed
            commands.tell(message)
