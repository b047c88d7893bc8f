"""Functions written in C for what is computed most often, compiled at the first run into the cache of the equations.

By the compiler and with the words for it that the equations' own code is compiled with; see `softmodels.mechanics.compiling`.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import sysconfig
import tempfile
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from softmodels.mechanics.compiler_flags import compiler_flags
from softmodels.mechanics.compiling import cache
from softmodels.mechanics.mpi import on_root

if TYPE_CHECKING:
    from mpi4py import MPI

SOURCE = Path(__file__).with_name("moduli.c")
_TABLES = "int64_t, int64_t, int64_t, const int32_t *, const double *, const double *, const double *, const double *"
DECLARED = "void moduli_take(int64_t, int64_t, int64_t, const double *, const double *, double *);" + "".join(
    f"void {name}({_TABLES}, const double *, const double *, double *);"
    for name in ("moduli_of_gradients", "moduli_with_pressure", "moduli_with_values")
)
FAST = "-O3"
"""These few functions may take longer to compile than equations."""


def library(comm: MPI.Comm) -> ModuleType:
    """The compiled functions, and cffi's way to pass arrays to them: a module with ``lib`` and ``ffi``.

    Args:
        comm: One of its ranks compiles, where that has not been done.

    Raises:
        OSError: The cache cannot be used.
        cffi.VerificationError: The compiler failed.
    """
    words = [*compiler_flags(), FAST]
    place = _place(words)
    name = place.name.partition(".")[0]
    on_root(comm, lambda: None if place.exists() else _compile(name, words, place))
    return _loaded(name, place)


def _place(words: list[str]) -> Path:
    """Where the module is; its name tells what it was compiled from, and how."""
    of = hashlib.sha1(repr((SOURCE.read_text(), DECLARED, words)).encode()).hexdigest()
    return cache() / f"softmodels_{of}{sysconfig.get_config_var('EXT_SUFFIX')}"


@functools.cache
def _loaded(name: str, place: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, place)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _compile(name: str, words: list[str], place: Path) -> None:
    """Compile aside and put the module in its place at once: another run may do the same, and either may be killed."""
    import cffi  # type: ignore[import-untyped]

    place.parent.mkdir(parents=True, exist_ok=True)
    made = cffi.FFI()
    made.cdef(DECLARED)
    made.set_source(name, SOURCE.read_text(), extra_compile_args=words)
    with tempfile.TemporaryDirectory(dir=place.parent) as folder:
        Path(made.compile(tmpdir=folder)).replace(place)
