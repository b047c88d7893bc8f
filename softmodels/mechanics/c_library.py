"""C functions for the most frequent computations, compiled on the first run into the kernel cache.

They use the same compiler and flags as the kernels; see `softmodels.mechanics.compiling`. Both sources take 1.3 s of CPU time.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import subprocess
import sysconfig
import tempfile
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from softmodels.mechanics.compiling import cache, compiler_flags, finish_compiler, start_compiler
from softmodels.mechanics.mpi import is_root, on_root

if TYPE_CHECKING:
    from mpi4py import MPI


_TABLES = f"int64_t, int64_t, int64_t, const int32_t *{', const double *' * 5}"
_MODULI = "void moduli_take(int64_t, int64_t, int64_t, const double *, const double *, double *);" + "".join(
    f"void moduli_{of}({_TABLES}, const double *, double *);" for of in ("of_gradients", "with_pressure", "with_values")
)
_LEVEL = "int64_t, const int32_t *, const int32_t *, const float *, const double *, const double *"
_MULTIGRID = """
typedef struct { const int32_t *starts, *columns; const double *values; const int32_t *places; } part;
int64_t level_pattern(int64_t, int, const int32_t *, const int8_t *, const part *, int32_t *, int32_t *, int32_t *);
void level_take(int64_t, int, const int32_t *, const int8_t *, const part *, const int32_t *, const int32_t *, int32_t *,
    float *, double *);
void level_restrict(int64_t, int, const int32_t *, const double *, double *);
void level_prolong(int64_t, int, const int32_t *, const double *, double *);
int level_galerkin(int64_t, int, const int32_t *, const int32_t *, const int32_t *, const int8_t *, const part *,
    const int32_t *, const int32_t *, int32_t *, int32_t *, int32_t *, double *, double *, void *, void *);
""" + "".join(
    f"void level_residual_{d}({_LEVEL}, double *);"
    f"void level_step_{d}({_LEVEL}, const double *, double, double, double *);"
    for d in (2, 3)
)
DECLARED = {"moduli": _MODULI, "multigrid": _MULTIGRID}
"""Functions of each source."""
FAST = "-O3"
"""Optimisation flags: these few functions may take longer to compile than kernels."""
_started: dict[Path, tuple[subprocess.Popen[str], tempfile.TemporaryDirectory[str]]] = {}
"""The C compiler of modules that are not ready, by their places, and what it works in."""


def library(comm: MPI.Comm, source: str) -> ModuleType:
    """Return the compiled functions, and cffi's way to pass arrays to them: a module with ``lib`` and ``ffi``.

    Args:
        comm: One of its ranks compiles, where that has not been done.
        source: Which of them, one of `DECLARED`.

    Raises:
        OSError: The cache cannot be used.
        cffi.VerificationError: The compiler failed.
    """
    place = _place(source)
    on_root(comm, lambda: _compile(source, place))
    return _loaded(_name(place), place)


def _text(source: str) -> str:
    return Path(__file__).with_name(f"{source}.c").read_text()


def _words() -> list[str]:
    return [*compiler_flags(), FAST]


def _name(place: Path) -> str:
    return place.name.partition(".")[0]


def _place(source: str) -> Path:
    """Return the path of the module; its name encodes source and flags."""
    of = hashlib.sha1(repr((_text(source), DECLARED[source], _words())).encode()).hexdigest()
    return cache() / f"softmodels_{of}{sysconfig.get_config_var('EXT_SUFFIX')}"


@functools.cache
def _loaded(name: str, place: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, place)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def begin(comm: MPI.Comm, source: str) -> None:
    """Start to compile functions that `library` is asked for later, if needed; on the root.

    Raises:
        OSError: The cache cannot be used.
        cffi.VerificationError: There is no compiler.
    """
    if is_root(comm):
        _start(source, _place(source))


def _start(source: str, place: Path) -> None:
    """Start the compiler under a temporary name: another run may do the same, and either may be killed."""
    if place in _started or place.exists():
        return
    import cffi  # type: ignore[import-untyped]
    from cffi.recompiler import make_c_source  # type: ignore[import-untyped]

    place.parent.mkdir(parents=True, exist_ok=True)
    made = cffi.FFI()
    made.cdef(DECLARED[source])
    folder = tempfile.TemporaryDirectory(dir=place.parent)
    written = Path(folder.name) / f"{_name(place)}.c"
    make_c_source(made, _name(place), _text(source), str(written))
    _started[place] = start_compiler(written, written.with_suffix(".so"), *_words()), folder


def _compile(source: str, place: Path) -> None:
    _start(source, place)
    if place in _started:
        process, folder = _started.pop(place)
        with folder:
            finish_compiler(process)
            (Path(folder.name) / f"{_name(place)}.so").replace(place)
