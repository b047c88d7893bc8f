"""The equations are compiled at run time, once, into a cache that all of a user's runs share: what can go wrong there.

FFCx marks a module in the making by a ``.c`` file with no ``.c.cached`` beside it. A run that is killed just then leaves
the mark behind; the next one would wait for it in vain and fail.
"""

from __future__ import annotations

import contextlib
import os
import platform
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from softmodels.common.errors import Spoken
from softmodels.mechanics.mpi import on_root

if TYPE_CHECKING:
    from mpi4py import MPI


# ----------------------------------------------------------------------------------------------------------------------
# What the C compiler is asked for when it compiles equations.
#
# Products with the tangent, its assembly and the forces are two fifths of a solid's path. On a slab of 88,570 unknowns the
# instructions of this processor and sums in any order take a product from 42 to 29 ms and an assembly from 620 to 445 ms.


PLAIN = ["-O2", "-g0"]
"""As Python's modules are compiled, but not for debuggers, which takes longer than all else."""
ARITHMETIC = ["-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros", "-fassociative-math"]
"""Sums in any order. What is no number or infinite stays so: Newton's method is held against it."""
PROCESSOR = Path("/proc/cpuinfo")
"""What Linux knows of the processors, one after the other; the first one's part is read."""
FEATURES = (b"flags", b"Features")
"""The line there that lists its instructions, on x86 and on ARM."""
READ = 1 << 14


def compiler_flags(processor: Path = PROCESSOR) -> list[str]:
    """Words for GCC or Clang.

    Modules for one processor may not run on another, and a home folder may be shared by several machines. DOLFINx names a
    module after what the compiler was asked for, so that a word that differs with the instructions keeps them apart.

    Args:
        processor: A file like Linux' ``/proc/cpuinfo``; where there is none, the code is for any processor of the kind.
    """
    instructions = _instructions(processor)
    if not instructions or platform.machine() not in ("x86_64", "aarch64"):
        return [*PLAIN, *ARITHMETIC]
    return [*PLAIN, *ARITHMETIC, "-march=native", f"-DPROCESSOR=0x{zlib.crc32(instructions):08x}"]


def _instructions(processor: Path) -> bytes:
    """The line of a processor's instructions; empty if it is not known."""
    try:
        with processor.open("rb") as file:
            start = file.read(READ)
    except OSError:
        return b""
    return next((line for line in start.splitlines() if line.startswith(FEATURES)), b"")


JIT = {"cffi_extra_compile_args": compiler_flags()}
"""How DOLFINx has the C compiler called."""

LONGEST = 180.0
"""Seconds after which nobody can still be compiling one module: a solid slice takes half a minute on a slow one."""

LONG = (
    "another run has been compiling the same equations for long, or was killed meanwhile; run again after "
    f"{LONGEST / 60:g} minutes, when what a killed one has left is taken away"
)
"""What is said where DOLFINx has waited in vain for another run."""


class CompilingError(Spoken, RuntimeError):
    """The equations could not be compiled; the message is a sentence for the user."""


def wait_for_cache(folder: Path, tell: Callable[[str], None], stopped: Callable[[], bool]) -> None:
    """Return once no module of the cache is in the making; marks older than `LONGEST` are taken away.

    Args:
        folder: The cache.
        tell: Gets a sentence if there is anything to wait for.
        stopped: Asked between looks; if true, the wait is over.
    """
    told = False
    while not stopped():
        ages = [age for age in map(_age, _unfinished(folder)) if age is not None]
        if not ages:
            return
        if not told:
            tell(
                f"waiting for another run that is compiling (or was killed so; then {LONGEST - min(ages):.0f} s longer)"
            )
            told = True
        time.sleep(0.2)


def mend_cache(comm: MPI.Comm) -> None:
    """Take away what a killed run has left half compiled, and wait for runs that compile; all ranks call it."""
    on_root(comm, lambda: wait_for_cache(cache(), lambda text: None, bool))


def _unfinished(folder: Path) -> list[Path]:
    """Sources whose modules are not marked as ready; of a cache with thousands of them no file is looked at."""
    try:
        names = {entry.name for entry in os.scandir(folder)}
    except OSError:
        return []
    return [
        folder / name
        for name in sorted(names)
        if name.startswith("libffcx_") and name.endswith(".c") and f"{name}.cached" not in names
    ]


def _age(source: Path) -> float | None:
    """Seconds for which a module has been in the making; None if it is ready, or was given up long ago."""
    try:
        if source.with_suffix(".c.cached").exists():
            return None
        age = time.time() - source.stat().st_mtime
        if age < LONGEST:
            return age
        source.unlink()
    except OSError:  # finished, taken away by another run, or not ours to take away
        pass
    return None


def cache() -> Path:
    """The folder DOLFINx compiles into."""
    from dolfinx import jit

    return Path(jit.get_options()["cache_dir"])


@contextlib.contextmanager
def compiling() -> Iterator[None]:
    """Turn what the compiler and its cache raise into a `CompilingError`."""
    try:
        yield
    except TimeoutError as error:
        raise CompilingError(LONG) from error
    except OSError as error:
        folder = cache()
        raise CompilingError(
            f"the cache of compiled equations, {folder}, cannot be used ({error.strerror or error}); make room in it and see "
            "that it can be written, or name another place with the environment variable XDG_CACHE_HOME"
        ) from error
    except Exception as error:
        # cffi's error on one rank; on several, DOLFINx passes on its text.
        if type(error).__name__ != "VerificationError" and "JIT" not in str(error):
            raise
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise CompilingError(
            f"the equations cannot be compiled ({reason}); a C compiler is needed, and softmodels doctor tells what is missing"
        ) from error
