"""Functions written in C for what is computed most often, compiled at the first run into the cache of the equations.

By the compiler and with the words for it that the equations' own code is compiled with; see `softmodels.mechanics.compiling`.
Where a core is free, that goes on in a process of its own while the mesh is made: ``python -m`` this module, and its place.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import hashlib
import importlib.util
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from measurement.cores import cores
from softmodels.mechanics.compiler_flags import compiler_flags
from softmodels.mechanics.compiling import cache
from softmodels.mechanics.mpi import on_root

if TYPE_CHECKING:
    from mpi4py import MPI
    from petsc4py import PETSc

SOURCE = Path(__file__).with_name("moduli.c")
_TABLES = f"int64_t, int64_t, int64_t, const int32_t *{', const double *' * 5}"
_ROWS = "typedef struct { void *matrix, *set; const int32_t *starts, *columns; double *values; } rows;"
DECLARED = f"{_ROWS} void moduli_take(int64_t, int64_t, int64_t, const double *, const double *, double *);" + "".join(
    f"void moduli_{of}({_TABLES}, const double *, double *);"
    f"int matrix_{of}({_TABLES}, int64_t, const int8_t *, const rows *);"
    for of in ("of_gradients", "with_pressure", "with_values")
)
FAST = "-O3"
"""These few functions may take longer to compile than equations."""


_aside: list[subprocess.Popen[bytes]] = []
"""The process that compiles, once `begin` has started one."""


def begin() -> None:
    """Start to compile in a process of its own, where that has not been done and a core is free; `library` waits for it."""
    place = _place(_words())
    if not (_aside or place.exists() or cores() < 2):
        command = [sys.executable, "-m", __name__, str(place)]
        nothing = subprocess.DEVNULL
        with contextlib.suppress(OSError):
            _aside.append(subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing))


def library(comm: MPI.Comm) -> ModuleType:
    """The compiled functions, and cffi's way to pass arrays to them: a module with ``lib`` and ``ffi``.

    Args:
        comm: One of its ranks compiles, where that has not been done.

    Raises:
        OSError: The cache cannot be used.
        cffi.VerificationError: The compiler failed.
    """
    words = _words()
    place = _place(words)
    on_root(comm, lambda: _see_to(words, place))
    return _loaded(_name(place), place)


def _see_to(words: list[str], place: Path) -> None:
    """Have the module in its place."""
    for process in _aside:
        process.wait()
    if not place.exists():  # whatever went wrong there goes wrong again, and is reported
        _compile(words, place)


class Rows:
    """What the C code adds cells' matrices to.

    Args:
        matrix: A matrix of PETSc with a place for each entry.

    Attributes:
        c: The C code's own description of it.
    """

    def __init__(self, matrix: PETSc.Mat):
        from petsc4py import PETSc

        self._ffi = library(matrix.comm.tompi4py()).ffi
        petsc, self._matrix = ctypes.CDLL(PETSc.__file__), matrix
        self.c = self._ffi.new("rows *")
        self.c.matrix = self._ffi.cast("void *", matrix.handle)
        if matrix.comm.size > 1 or not matrix.assembled:
            function = ctypes.cast(petsc.MatSetValuesLocal, ctypes.c_void_p).value
            self.c.set = self._ffi.cast("void *", function)
            return
        # PETSc would look for the place of every entry by itself, which takes most of an assembly.
        self._places = [np.asarray(part, dtype=np.int32) for part in matrix.getRowIJ()]
        values = ctypes.c_void_p()
        self.check(petsc.MatSeqAIJGetArray(ctypes.c_void_p(matrix.handle), ctypes.byref(values)))
        self.c.starts, self.c.columns = (self._ffi.from_buffer("int32_t[]", part) for part in self._places)
        self.c.values = self._ffi.cast("double *", values.value)

    def check(self, error: int) -> None:
        """Raise what an error of the C code or PETSc stands for; 0 is none."""
        from petsc4py import PETSc

        if error:
            raise PETSc.Error(error)


def _words() -> list[str]:
    return [*compiler_flags(), FAST]


def _name(place: Path) -> str:
    return place.name.partition(".")[0]


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


def _compile(words: list[str], place: Path) -> None:
    """Compile aside and put the module in its place at once: another run may do the same, and either may be killed."""
    import cffi  # type: ignore[import-untyped]

    place.parent.mkdir(parents=True, exist_ok=True)
    made = cffi.FFI()
    made.cdef(DECLARED)
    made.set_source(_name(place), SOURCE.read_text(), extra_compile_args=words)
    with tempfile.TemporaryDirectory(dir=place.parent) as folder:
        Path(made.compile(tmpdir=folder)).replace(place)


if __name__ == "__main__":
    _compile(_words(), Path(sys.argv[1]))
