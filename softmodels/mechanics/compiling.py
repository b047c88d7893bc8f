"""Compile kernels, and C code beside them, at run time into a cache shared by all runs of a user; handle its errors.

FFCx marks a module being compiled by a ``.c`` file without ``.c.cached``. A run killed at that moment leaves the
mark behind; the next one would wait for it in vain and fail.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType

from softmodels.common import errors
from softmodels.common.lazy import MPI, ufl
from softmodels.mechanics import mpi


@contextlib.contextmanager
def compiling() -> Iterator[None]:
    """Turn errors of the compiler and its cache into a `CompilingError`."""
    use_cache()
    try:
        yield
    except CompilingError:
        _check_stop()
        raise
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
        _check_stop()
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise CompilingError(
            f"the kernels cannot be compiled ({reason}); a C compiler is needed (the extra 'compiler' brings one), "
            "and softmodels doctor lists what is missing"
        ) from error
    finally:
        for name in [*_running]:  # after an error
            with contextlib.suppress(Exception):
                _finish(name)


class CompilingError(errors.OptionMessage, RuntimeError):
    """The kernels could not be compiled; the message is for the user."""


@contextlib.contextmanager
def report_waits(tell: Callable[[str], None], check: Callable[[], None]) -> Iterator[None]:
    """Report waits for kernels that another run compiles.

    Args:
        tell: Gets a sentence if there is anything to wait for.
        check: Called between looks, and where the compiler has failed; it raises to end the wait.
    """
    _listening.append((tell, check))
    try:
        yield
    finally:
        _listening.pop()


def _check_stop() -> None:
    """Let the caller of `report_waits`, if there is one, end what goes on here; a moment later, for a batch queue signals all
    processes of a job, and this one perhaps after its compiler."""
    time.sleep(0.1)
    if _listening:
        _listening[-1][1]()


def _wait_for(source: Path) -> None:
    """Wait until a module is no longer being compiled by another run; remove a mark older than `MAX_COMPILE_SECONDS`."""
    tell = _listening[-1][0] if _listening else lambda text: None
    told = False
    while (age := _age(source)) is not None:
        if not told:
            tell(
                f"waiting for another run to compile its kernels (or, if it was killed, "
                f"{MAX_COMPILE_SECONDS - age:.0f} s longer)"
            )
            told = True
            for name in [*_running]:  # the other run may wait for them
                _finish(name)
        _check_stop()


def _age(source: Path) -> float | None:
    """Return the seconds since a module's compilation started; None if it is ready or was abandoned."""
    try:
        if source.with_suffix(".c.cached").exists():
            return None
        age = time.time() - source.stat().st_mtime
        if age < MAX_COMPILE_SECONDS:
            return age
        source.unlink()
    except OSError:  # finished, removed by another run, or owned by another user
        pass
    return None


def cache() -> Path:
    """Return the folder DOLFINx compiles into."""
    from dolfinx import jit

    return Path(jit.get_options()["cache_dir"])


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
BYTES_AT_ONCE = 1 << 14


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
            start = file.read(BYTES_AT_ONCE)
    except OSError:
        return b""
    return next((line for line in start.splitlines() if line.startswith(FEATURES)), b"")


JIT = {"cffi_extra_compile_args": compiler_flags()}
"""Compiler flags in DOLFINx's options."""
FIRST_LABEL = 1_000_000
"""Number of the first label of a UFL variable that is compiled, above all that UFL gives out: they count up, and are part of a
kernel's name in the cache."""

MAX_COMPILE_SECONDS = 180.0
"""Seconds after which the compilation of a module counts as abandoned: a solid slice takes half a minute on a slow machine."""

LONG = (
    "another run is compiling the same kernels, or was killed while doing so; run again "
    f"after {MAX_COMPILE_SECONDS / 60:g} minutes, when its leftovers are removed"
)
"""Message if DOLFINx has waited in vain for another run."""
_listening: list[tuple[Callable[[str], None], Callable[[], None]]] = []
"""What reports a wait for another run, and what is asked whether to stop."""


# ----------------------------------------------------------------------------------------------------------------------
# Side by side: FFCx writes the C code of one kernel while the C compiler still works on those before it.


_running: dict[str, tuple[subprocess.Popen[str], Path]] = {}
"""The C compiler of modules that are not loaded yet, by their names, and their sources."""
_ahead = False
"""Whether kernels are compiled ahead, so that nothing waits for them yet."""


def compiler() -> list[str]:
    """Return the words that call the C compiler: the one that Python was built with or ``CC`` names, or else that of the
    package ziglang, if it is installed; `cffi.VerificationError` if there is none."""
    import cffi  # type: ignore[import-untyped]

    words = shlex.split(os.environ.get("CC") or sysconfig.get_config_vars()["LDSHARED"].partition(" ")[0])
    if shutil.which(words[0]):
        return words
    if not os.environ.get("CC") and importlib.util.find_spec("ziglang"):
        return [sys.executable, "-P", "-m", "ziglang", "cc"]
    raise cffi.VerificationError(f"{words[0]}: {os.strerror(errno.ENOENT)}")


def compiler_words() -> list[str]:
    """Return the command that makes a module of a source, as setuptools would, without input and output."""
    known, own = sysconfig.get_config_vars(), os.environ
    words = [*compiler(), *shlex.split(known["LDSHARED"])[1:]]
    flags = [known["CFLAGS"], known["CCSHARED"], own.get("CFLAGS", ""), own.get("LDFLAGS", "")]
    return [*words, *(word for flag in flags for word in shlex.split(flag)), f"-I{sysconfig.get_path('include')}"]


def start_compiler(source: Path, module: Path, *words: str) -> subprocess.Popen[str]:
    """Start the C compiler; `cffi.VerificationError` if there is none."""
    import cffi

    command = [*compiler_words(), *words, str(source), "-o", str(module), "-lm"]
    try:
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    except OSError as error:
        raise cffi.VerificationError(f"{command[0]}: {error.strerror}") from error


def finish_compiler(process: subprocess.Popen[str]) -> None:
    """Wait for the C compiler; `cffi.VerificationError` if it failed, `CompilingError` if a signal has ended it."""
    import cffi

    _, errors = process.communicate()
    if process.returncode < 0:
        name = signal.Signals(-process.returncode).name
        raise CompilingError(f"{name} ended the C compiler before it was done, perhaps for want of memory; run again")
    if process.returncode:
        said = [line for line in errors.splitlines() if "error" in line] or errors.splitlines()
        raise cffi.VerificationError(said[0] if said else f"the C compiler ended with status {process.returncode}")


def compile_ahead(comm: MPI.Comm, forms: Sequence[ufl.Form]) -> None:
    """Start the compilation of forms that are made next, on the root; errors on all ranks. Those that the cache has are
    loaded."""
    mpi.on_root(comm, lambda: _start_all(forms))


def _start_all(forms: Sequence[ufl.Form]) -> None:
    global _ahead
    from dolfinx import default_scalar_type, jit

    use_cache()
    _ahead = True
    try:
        for form in forms:
            if not form.empty():
                jit.ffcx_jit.__wrapped__(form, {"scalar_type": default_scalar_type}, JIT)
    finally:
        _ahead = False


def _generate(declared, objects, names, module, *rest, **more):  # type: ignore[no-untyped-def]
    """Write the C code of a module and start its compiler, in the place of FFCx's own function."""
    import cffi
    from cffi.recompiler import make_c_source  # type: ignore[import-untyped]
    from ffcx import codegeneration, compiler

    options, folder, flags = rest[:3]
    code, _ = compiler.compile_ufl_objects(objects, namespace=module, options=options)
    ffi = cffi.FFI()
    ffi.cdef(declared)
    source = folder / f"{module}.c"
    make_c_source(ffi, module, code[1], str(source))
    made, include = folder / f"{module}{sysconfig.get_config_var('EXT_SUFFIX')}", codegeneration.get_include_path()
    _running[module] = start_compiler(source, made, f"-I{include}", "-std=c17", *flags), source
    return code[1]


def _finish(name: str) -> None:
    """Wait for a module that is being compiled here, and mark it as ready."""
    if name not in _running:
        return
    process, source = _running.pop(name)
    try:
        finish_compiler(process)
    except BaseException:
        source.replace(source.with_suffix(".c.failed"))
        raise
    source.with_suffix(".c.cached").touch()


def use_cache() -> None:
    """Let FFCx take loaded kernels from memory, compile others side by side, and wait for those that another run compiles.

    It lists the whole folder of its cache for each form otherwise: of 6,000 files that is a third of a section's set-up. Its
    own wait ends after ten seconds, and never where a run was killed.
    """
    from ffcx.codegeneration import jit

    look_up, load = jit.get_cached_module, jit._load_objects
    if look_up.__module__ == __name__:
        return
    loaded: dict[tuple[object, ...], tuple[object, object]] = {}

    def kept(name: str, objects: Sequence[str], folder: Path, timeout: int) -> tuple[object, object]:
        key = name, *objects, str(folder)
        if (compiled := loaded.get(key)) is None:
            if _ahead and name in _running:
                return [None], None
            _finish(name)
            _wait_for(Path(folder) / f"{name}.c")
            compiled = look_up(name, objects, folder, timeout)
            if compiled[0] is not None:
                loaded[key] = compiled
        return compiled

    def when_ready(folder: Path, name: str, objects: Sequence[str]) -> tuple[object, object]:
        if _ahead:
            return [None], None
        _finish(name)
        return load(folder, name, objects)

    jit.get_cached_module = kept
    if sys.platform != "win32":
        jit._compile_objects, jit._load_objects = _generate, when_ready  # type: ignore[assignment]


# ----------------------------------------------------------------------------------------------------------------------
# C functions for the most frequent computations, compiled on the first run into the kernel cache.
#
# They use the same compiler and flags as the kernels. Both sources take 1.3 s of CPU time.


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
    f"void level_residual_{d}({_LEVEL}, double *);void level_step_{d}({_LEVEL}, const double *, double, double, double *);"
    for d in (2, 3)
)
DECLARED = {"moduli": _MODULI, "multigrid": _MULTIGRID}
"""Functions of each source."""
FAST = "-O3"
"""Optimisation flags: these few functions may take longer to compile than kernels."""
_started: dict[Path, tuple[subprocess.Popen[str], tempfile.TemporaryDirectory[str]]] = {}
"""The C compiler of modules that are not ready, by their places, and what it works in."""


def library(comm: MPI.Comm, source: str) -> ModuleType:
    """Return the compiled functions of a source of `DECLARED`, and cffi's way to pass arrays to them: a module with ``lib``
    and ``ffi``. One rank compiles, where that has not been done.

    Raises:
        OSError: The cache cannot be used.
        cffi.VerificationError: The compiler failed.
    """
    place = _place(source)
    mpi.on_root(comm, lambda: _compile(source, place))
    return _loaded(_name(place), place)


def _text(source: str) -> str:
    return Path(__file__).with_name(f"{source}.c").read_text()


def _words() -> list[str]:
    return [*JIT["cffi_extra_compile_args"], FAST]


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
    """Start to compile functions that `library` is asked for later, if needed, on the root; on all ranks `OSError` if the
    cache cannot be used, `cffi.VerificationError` if there is no compiler."""
    mpi.on_root(comm, lambda: _start(source, _place(source)))


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
