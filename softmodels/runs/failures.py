"""Failures of the libraries below, and of the disk, as the sentences that a user reads."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

from measurement.output_place import FULL
from softmodels.mechanics.compiling import LONG
from softmodels.mechanics.mpi import petsc_reason
from softmodels.results.outcomes import RunError, no_memory


def unwritten(error: OSError) -> str:
    """Why results cannot be written, and what to do."""
    place = f" into {Path(error.filename).parent}" if isinstance(error.filename, str) else ""
    advice = "make room for them" if error.errno in FULL else "see that they can"
    return f"the results cannot be written{place} ({error.strerror or error}); {advice} and go on with --resume"


def no_mesh(error: OSError) -> str:
    """Why a mesh cannot be written."""
    return f"the mesh cannot be written ({error.strerror or error})"


@contextlib.contextmanager
def sentences(of_the_disk: Callable[[OSError], str] = no_mesh) -> Iterator[None]:
    """Raise a `RunError` with a sentence for what PETSc, the memory or the disk raises in here.

    Args:
        of_the_disk: Makes the sentence of what could not be written.
    """
    from petsc4py import PETSc

    try:
        yield
    except PETSc.Error as error:
        raise RunError(f"PETSc stopped ({petsc_reason(error)})") from error
    except MemoryError as error:
        raise RunError(no_memory(error)) from error
    except TimeoutError as error:
        raise RunError(LONG) from error
    except OSError as error:
        raise RunError(of_the_disk(error)) from error
