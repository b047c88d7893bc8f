"""Compile kernels at run time into a cache shared by all runs of a user, and handle its errors.

FFCx marks a module being compiled by a ``.c`` file without ``.c.cached``. A run killed at that moment leaves the
mark behind; the next one would wait for it in vain and fail.
"""

from __future__ import annotations

import contextlib
import os
import platform
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from softmodels.common.errors import Spoken
from softmodels.mechanics.mpi import on_root

if TYPE_CHECKING:
    from mpi4py import MPI


# ----------------------------------------------------------------------------------------------------------------------
# Flags of the C compiler for the kernels.
#
# Products with the tangent, its assembly and the forces are two fifths of a solid's path. On a slab of 88,570 unknowns the
# instructions of this processor and sums in any order take a product from 42 to 29 ms and an assembly from 620 to 445 ms.


PLAIN = ["-O2", "-g0"]
"""As for Python's modules, but without debug information, which takes longer than all else."""
ARITHMETIC = ["-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros", "-fassociative-math"]
"""Allow reordering of sums, but keep NaN and infinity, which Newton's method checks for."""
PROCESSOR = Path("/proc/cpuinfo")
"""Linux' description of the processors, of which the first is read."""
FEATURES = (b"flags", b"Features")
"""The line with its instruction set, on x86 and on ARM."""
READ = 1 << 14


def compiler_flags(processor: Path = PROCESSOR) -> list[str]:
    """Return the flags for GCC or Clang.

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
    """Return the line of a processor's instruction set; empty if unknown."""
    try:
        with processor.open("rb") as file:
            start = file.read(READ)
    except OSError:
        return b""
    return next((line for line in start.splitlines() if line.startswith(FEATURES)), b"")


JIT = {"cffi_extra_compile_args": compiler_flags()}
"""Compiler flags in DOLFINx's options."""
LABEL = 1_000_000
"""Number of the first label of a UFL variable that is compiled, above all that UFL gives out: they count up, and are part of a
kernel's name in the cache."""

LONGEST = 180.0
"""Seconds after which the compilation of a module counts as abandoned: a solid slice takes half a minute on a slow machine."""

LONG = (
    "another run is compiling the same kernels, or was killed while doing so; run again "
    f"after {LONGEST / 60:g} minutes, when its leftovers are removed"
)
"""Message if DOLFINx has waited in vain for another run."""


class CompilingError(Spoken, RuntimeError):
    """The kernels could not be compiled; the message is for the user."""


def wait_for_cache(folder: Path, tell: Callable[[str], None], stopped: Callable[[], bool]) -> None:
    """Wait until no module of the cache is being compiled; remove marks older than `LONGEST`.

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
                f"waiting for another run to compile its kernels (or, if it was killed, {LONGEST - min(ages):.0f} s longer)"
            )
            told = True
        time.sleep(0.2)


def mend_cache(comm: MPI.Comm) -> None:
    """Remove half-compiled leftovers of killed runs, and wait for compiling runs; all ranks call it."""
    on_root(comm, lambda: wait_for_cache(cache(), lambda text: None, bool))


def _unfinished(folder: Path) -> list[Path]:
    """Return the sources whose modules are not marked as ready, without reading files."""
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
    """Return the seconds since a module's compilation started; None if it is ready or was abandoned."""
    try:
        if source.with_suffix(".c.cached").exists():
            return None
        age = time.time() - source.stat().st_mtime
        if age < LONGEST:
            return age
        source.unlink()
    except OSError:  # finished, removed by another run, or owned by another user
        pass
    return None


def cache() -> Path:
    """Return the folder DOLFINx compiles into."""
    from dolfinx import jit

    return Path(jit.get_options()["cache_dir"])


def keep_loaded() -> None:
    """Let FFCx take kernels that this process has loaded already from memory.

    It lists the whole folder of its cache for each form otherwise: of 6,000 files that is a third of a section's set-up.
    """
    from ffcx.codegeneration import jit

    look_up = jit.get_cached_module
    if look_up.__module__ == __name__:
        return
    loaded: dict[tuple[object, ...], tuple[object, object]] = {}

    def kept(name: str, objects: Sequence[str], folder: Path, timeout: int) -> tuple[object, object]:
        key = name, *objects, str(folder)
        if (found := loaded.get(key)) is None:
            found = look_up(name, objects, folder, timeout)
            if found[0] is not None:
                loaded[key] = found
        return found

    jit.get_cached_module = kept


@contextlib.contextmanager
def compiling() -> Iterator[None]:
    """Turn errors of the compiler and its cache into a `CompilingError`."""
    keep_loaded()
    try:
        yield
    except TimeoutError as error:
        raise CompilingError(LONG) from error
    except OSError as error:
        folder = cache()
        raise CompilingError(
            f"the kernel cache {folder} cannot be used ({error.strerror or error}); free disk space and "
            f"check its permissions, or set another place by the environment variable XDG_CACHE_HOME"
        ) from error
    except Exception as error:
        # cffi's error on one rank; on several, DOLFINx passes on its text.
        if type(error).__name__ != "VerificationError" and "JIT" not in str(error):
            raise
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise CompilingError(
            f"the kernels cannot be compiled ({reason}); a C compiler is needed, and softmodels doctor lists what is missing"
        ) from error
