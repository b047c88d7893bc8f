"""All MPI-specific code: start-up, which rank prints, errors raised on all ranks together, and on one of them only."""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import importlib
import importlib.metadata
import importlib.util
import os
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from softmodels.common import errors, processes
from softmodels.common.lazy import MPI

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt


SHARED_MEMORY = Path("/dev/shm")
"""Folder of MPICH's shared memory, needed even for one rank; without it MPICH ends the process."""
LAUNCHERS = {"PMI_RANK": "PMI_SIZE", "PMIX_RANK": "", "OMPI_COMM_WORLD_RANK": "OMPI_COMM_WORLD_SIZE",
             "SLURM_PROCID": "SLURM_STEP_NUM_TASKS"}  # fmt: skip
"""Environment variables of MPI launchers: rank, and number of ranks."""
OPTION_FILES = (".petscrc", "petscrc", "dolfinx_jit_options.json", "ffcx_options.json")
"""Option files that PETSc, DOLFINx and FFCx read in the working directory."""
_started: list[bool] = []
"""Non-empty once PETSc, DOLFINx and FFCx have read their options, which each does once per process."""
LEAST_SHARED = 1 << 20
"""Bytes needed at start-up, with a margin."""

FEW_LOOKS, MANY_LOOKS = 64, 16384
"""Number of polls of a waiting rank before it yields, with shared and with separate cores."""

ONE_MACHINE = {
    # UCX, which the wheel's MPICH sends by: shared memory only. It watches all changes of memory for network cards; to begin
    # that takes longer than MPI's start itself.
    "UCX_TLS": "self,sm", "UCX_MEM_MMAP_HOOK_MODE": "none",
    # libfabric, as of MPICH from conda-forge, has to listen somewhere; this machine's own ranks use shared memory all the same.
    "FI_PROVIDER": "tcp", "FI_TCP_IFACE": "lo0" if sys.platform == "darwin" else "lo",
    "OMPI_MCA_btl": "^tcp",  # Open MPI: all ways but this one
}  # fmt: skip
"""Environment variables of MPI's libraries that keep it off the network."""
WHEEL = "dolfinx_solver"
MPICH = "mpich"
"""Package of the MPI the wheel was built with."""
LIBRARY = re.compile(r"libmpi(ch)?\.so[.0-9]*")
"""Names of the library of any MPI; not those of its Fortran and C++ parts."""
STACKS = re.compile(r"(petsc|petsc4py|slepc|slepc4py|dolfinx[-_.]+solver[-_.]+(real|complex))[-.]", re.IGNORECASE)
"""Metadata folders of packages that include PETSc or SLEPc."""


class StartError(RuntimeError):
    """MPI or PETSc could not be started; ``status`` is the exit status, the message is for the user."""

    def __init__(self, message: str, status: int = 2):
        super().__init__(message)
        self.status = status


def start(petsc_options: Sequence[str] = ()) -> MPI.Intracomm:
    """Import MPI, PETSc and DOLFINx in the order they need and return the world communicator.

    Args:
        petsc_options: Words for PETSc's option database, read once, at the first call in a process.

    Raises:
        StartError: PETSc cannot take the words, or there is no shared memory for MPI.
    """
    # More BLAS threads than cores slow MUMPS several times; a user's setting takes precedence.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    # MPICH's ranks busy-wait; with more ranks than cores that is ten times slower.
    os.environ.setdefault("MPIR_CVAR_CH4_PROGRESS_THROTTLE", "1")
    os.environ.setdefault("MPIR_CVAR_CH4_PROGRESS_THROTTLE_NO_PROGRESS_COUNT", str(_looks()))
    if _started:
        return _world()
    with _no_network():
        _import_mpi()
        _start_petsc(petsc_options)
    _started.append(True)
    if _world().size > 1:
        atexit.register(_end)
    return _world()


def _start_petsc(options: Sequence[str]) -> None:
    """Start PETSc, and have DOLFINx and FFCx read their options; errors as of `start`."""
    import petsc4py

    try:
        # PETSc's signal handlers would end the program when the reader of its log has gone.
        with _nobodys_folder(), processes.handlers_kept():
            petsc4py.init(["softmodels", *options])  # the -c of python -c would be read as an option
            _read_compilers_options()
    except RuntimeError as error:  # petsc4py.PETSc.Error, which cannot be imported before PETSc has started
        words = " ".join(options)
        raise StartError(
            f"PETSc does not start with the options {words!r} ({petsc_reason(error)}); check the options after --"
        ) from None


@contextlib.contextmanager
def _no_network() -> Iterator[None]:
    """Keep MPI off the network while it starts in here, if all ranks are on this machine: each would listen on all interfaces
    for ranks elsewhere. The user's own settings take precedence; what is set here goes again, for programs that this one starts
    may span several machines."""
    given = {name: value for name, value in ONE_MACHINE.items() if name not in os.environ}
    if launched() not in (None, 1, _beside()):
        given = {}
    os.environ.update(given)
    try:
        yield
    finally:
        for name in given:
            os.environ.pop(name, None)


def _import_mpi() -> None:
    """Import MPI ahead of everything compiled, as the wheel from PyPI orders it; with conda or in a container nothing does.

    The wheel's own module first reads what is written about each installed package, for another PETSc among them, which is
    a fifteenth of a short command's time. The names of their folders tell whether it has to.
    """
    wheel = importlib.util.find_spec(WHEEL)
    if wheel is None or wheel.origin is None or WHEEL in sys.modules:
        return
    _load_mpich(mpich_file("libmpi.so.12"))
    _check_shared_memory()  # importing MPI starts it
    petsc, beside = importlib.util.find_spec("petsc4py"), Path(wheel.origin).parents[1]
    foreign = petsc is None or petsc.origin is None or Path(petsc.origin).resolve().parents[1] != beside.resolve()
    if foreign or len(_stacks()) != 1:
        importlib.import_module(WHEEL)  # rejects unsupported set-ups, with advice
    else:
        import mpi4py.MPI  # noqa: F401


def mpich_file(name: str) -> Path | None:
    """Return a file of the installed MPICH, such as its library or ``mpirun``; None if MPICH is not a package of this Python.

    Its own record of its files shows it: in an environment laid over another one (``uv run --with jupyter``) it lies neither in
    the folder of this Python nor on the system's path.
    """
    try:
        files = importlib.metadata.files(MPICH) or []
    except importlib.metadata.PackageNotFoundError:
        return None
    paths = (Path(str(file.locate())).resolve() for file in files if file.name == name)
    return next((path for path in paths if path.is_file()), None)


def _load_mpich(library: Path | None) -> None:
    """Load the MPI that the solver was built with, ahead of mpi4py, which takes the first one that it finds.

    Raises:
        StartError: Another MPI is loaded already, or asked for by mpi4py's variables.
    """
    if library is None:
        return
    others = [file for file in _loaded_mpis() if not (file.exists() and file.samefile(library))]
    if others:
        raise StartError(
            f"another MPI is loaded in this process ({others[0]}), but the solver needs its own ({library}); import "
            f"softmodels before other MPI packages, and remove it from LD_PRELOAD"
        )
    for variable in ("MPI4PY_LIBMPI", "MPI4PY_MPIABI"):
        asked = os.environ.get(variable, "")
        same = asked.lower() == "mpich" or (Path(asked).is_file() and Path(asked).samefile(library)) if asked else True
        if not same:
            raise StartError(
                f"the variable {variable} selects another MPI ({asked}), but the solver needs its own ({library}); unset it"
            )
    try:
        ctypes.CDLL(str(library), ctypes.RTLD_GLOBAL)
    except OSError as error:
        raise StartError(f"the MPI of the solver cannot be loaded ({error}); install the package {MPICH} again") from None


def _loaded_mpis() -> list[Path]:
    """Return the libraries of MPI that this process has loaded, on Linux."""
    try:
        lines = Path("/proc/self/maps").read_text().splitlines()
    except OSError:
        return []
    files = (line.split(maxsplit=5)[-1] for line in lines if "libmpi" in line)
    return [Path(file) for file in dict.fromkeys(files) if LIBRARY.fullmatch(Path(file).name)]


def _stacks() -> list[str]:
    """Return the names of the installed packages that include PETSc or SLEPc; normally only one."""
    stacks = []
    for folder in dict.fromkeys(sys.path):
        with contextlib.suppress(OSError):  # not a folder
            names = (entry.name for entry in os.scandir(folder or "."))
            stacks += [name for name in names if name.endswith((".dist-info", ".egg-info")) and STACKS.match(name)]
    return stacks


def _looks() -> int:
    """Return the number of polls of a waiting rank before it yields.

    Where each rank has a core nobody else is kept from running, and a wedge is solved 5 % sooner by two ranks that look often.
    MPICH's launcher passes the number of ranks on this machine; with another launcher it is unknown.
    """
    return MANY_LOOKS if 0 < _beside() <= processes.cores() else FEW_LOOKS


def _beside() -> int:
    """Return how many ranks the launcher of MPICH or Open MPI has started on this machine; -1 without one."""
    counts = (os.environ.get(name, "") for name in ("MPI_LOCALNRANKS", "OMPI_COMM_WORLD_LOCAL_SIZE"))
    return next((int(count) for count in counts if count.isdecimal()), -1)


def _world() -> MPI.Intracomm:
    return MPI.COMM_WORLD


@contextlib.contextmanager
def _nobodys_folder() -> Iterator[None]:
    """Change to the root folder temporarily, if the current one has option files.

    PETSc, DOLFINx and FFCx read options from files in the folder they start in (.petscrc, dolfinx_jit_options.json), and
    those options can load and run code. That folder may be somebody else's results; the user's own options in the home
    folder and in PETSC_OPTIONS count all the same.
    """
    if not any(os.path.lexists(name) for name in OPTION_FILES):
        yield
        return
    here = os.open(".", os.O_RDONLY)  # a handle back even to a deleted folder
    try:
        os.chdir("/")
        yield
    finally:
        os.fchdir(here)
        os.close(here)


def _read_compilers_options() -> None:
    """Make DOLFINx and FFCx read their option files, which each does once."""
    import dolfinx.jit
    import ffcx.options

    dolfinx.jit.get_options()
    ffcx.options.get_options()


def _check_shared_memory() -> None:
    """Check shared memory before the wheel's MPICH uses it."""
    try:
        with tempfile.TemporaryFile(dir=SHARED_MEMORY) as file:
            os.posix_fallocate(file.fileno(), 0, LEAST_SHARED)
    except OSError as error:
        raise StartError(
            f"MPI cannot start: it needs shared memory, and {SHARED_MEMORY} cannot be written ({error.strerror}); mount it "
            "with write access (in a container: --shm-size=256m, and not --read-only without --tmpfs /dev/shm)",
            1,
        ) from None


def petsc_reason(error: BaseException) -> str:
    """Return what an error of PETSc was about: the last line of its trace."""
    return str(error).strip().splitlines()[-1].removeprefix("[0] ")


def is_root(comm: MPI.Comm) -> bool:
    return bool(comm.rank == 0)


def owns_scalars(comm: MPI.Comm) -> bool:
    """Return whether this rank holds the global unknowns, the cavities' pressures: the last one."""
    return bool(comm.rank == comm.size - 1)


def scalars_from_owner(comm: MPI.Comm, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the owner's array, on all ranks."""
    return values if comm.size == 1 else comm.bcast(values, root=comm.size - 1)


def on_root[T](comm: MPI.Comm, task: Callable[[], T]) -> T:
    """Run ``task`` on rank 0 and return its result on all; if it raises, every rank raises the same exception."""
    outcome: tuple[bool, Any] = (True, None)
    if is_root(comm):
        try:
            outcome = (True, task())
        except Exception as error:
            outcome = (False, error)
    if comm.size > 1:
        outcome = comm.bcast(outcome, root=0)
    done, value = outcome
    if not done:
        raise value
    return value  # type: ignore[no-any-return]


def kept_on_root[T](comm: MPI.Comm, task: Callable[[], T]) -> T | None:
    """As `on_root` with a result that stays there, such as an open folder; return None on the other ranks."""
    kept: list[T] = []
    on_root(comm, lambda: kept.append(task()))
    return kept[0] if kept else None


def total(comm: MPI.Comm, value: float) -> float:
    return float(comm.allreduce(value, op=MPI.SUM))


def largest(comm: MPI.Comm, value: float) -> float:
    return float(comm.allreduce(value, op=MPI.MAX))


def summed(comm: MPI.Comm, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the sum of all ranks' arrays of one shape, on every rank."""
    return values if comm.size == 1 else comm.allreduce(values, op=MPI.SUM)


ALONE_AFTER = 10.0
"""Seconds after which an error that the other ranks do not report is one of this rank only."""
_ending: list[bool] = []
"""Once this rank ends: whether the others end too."""


def together(comm: MPI.Comm) -> bool:
    """Return whether all ranks call this within `ALONE_AFTER`, such as for an error that has come up on each of them.

    Those that do not go on without the error, to a collective call in which they wait for ever: where it is false, this rank
    has to leave all such calls alone, and let the process end.
    """
    if comm.size == 1:
        return True
    until, arrived = time.monotonic() + ALONE_AFTER, comm.Ibarrier()
    while not arrived.Test():
        if time.monotonic() > until:
            _ending[:] = [False]
            return False
        time.sleep(0.01)
    return True


def ends_with_others() -> bool:
    """Return whether the other ranks end too; true for one, and where MPI has not been started here. Where it is false, the end
    of this rank ends all."""
    if not _started or _world().size == 1:
        return True
    if not _ending:
        _ending.append(together(_world()))
    return _ending[0]


@contextlib.contextmanager
def exits_together() -> Iterator[None]:
    """End all ranks where this one exits with an error in here and others do not."""
    try:
        yield
    except SystemExit as end:
        if end.code and not ends_with_others():
            _abort(end.code if isinstance(end.code, int) else 1)
        raise


FORWARDING_TIME = 0.3
"""Seconds in which the launcher forwards what has been printed, which the end of all would overtake."""


def _abort(status: int) -> NoReturn:
    """End all ranks at once, with this exit status."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):
            stream.flush()
    time.sleep(FORWARDING_TIME)
    _world().Abort(status)
    os._exit(status)


def _end() -> None:
    """Wait for the other ranks at the end of this one's program; where that was an exception (Python notes one that it has
    printed) for `ALONE_AFTER`."""
    if MPI.Is_finalized():
        return
    if hasattr(sys, "last_exc"):
        if not ends_with_others():
            _abort(1)
    elif not _ending:
        arrived = _world().Ibarrier()
        while not arrived.Test():
            time.sleep(0.01)


def gathered[T: np.generic](comm: MPI.Comm, values: npt.NDArray[T]) -> npt.NDArray[T] | None:
    """Return the rows of all ranks' arrays, one below the other in the order of ranks, on rank 0; None elsewhere."""
    import numpy as np

    parts = comm.gather(np.ascontiguousarray(values), root=0)
    return None if parts is None else np.concatenate(parts)


def everywhere[T: np.generic](comm: MPI.Comm, values: npt.NDArray[T]) -> npt.NDArray[T]:
    """Return the rows of all ranks' arrays, one below the other in the order of ranks, on every rank."""
    import numpy as np

    return np.concatenate(comm.allgather(np.ascontiguousarray(values)))


def scattered[T: np.generic](comm: MPI.Comm, values: npt.NDArray[T] | None, count: int) -> npt.NDArray[T]:
    """Return the reverse of `gathered`: ``count`` rows of rank 0's array for each rank."""
    import numpy as np

    counts = comm.gather(count, root=0)
    parts = None if values is None or counts is None else np.split(values, np.cumsum(counts)[:-1])
    return comm.scatter(parts, root=0)


def any_rank(comm: MPI.Comm, value: bool) -> bool:
    """Return whether ``value`` is true on any rank."""
    return largest(comm, float(value)) > 0.0


def speaks() -> bool:
    """Return whether this process may print, before MPI is started: rank 0 by what the launchers set, or no launcher."""
    ranks = (os.environ.get(name) for name in LAUNCHERS)
    return next((rank for rank in ranks if rank is not None), "0") == "0"


def launched() -> int | None:
    """Return the number of ranks of a launcher, before MPI is started: None without one, 0 if unknown."""
    sizes = (size for rank, size in LAUNCHERS.items() if rank in os.environ)
    size = next(sizes, None)
    return None if size is None else int(os.environ.get(size, "0"))


# ----------------------------------------------------------------------------------------------------------------------
# Available memory, and the need of a device's linear solver.


GIGA_BYTE = 1e9
GROUPS = Path("/sys/fs/cgroup")
"""Files with Linux' container limits."""
USABLE_MEMORY_SHARE = 0.9
"""Fraction of the free memory that a model may use; meshes, results and pictures need some too."""


class TooLargeError(errors.OptionMessage, MemoryError):
    """The model does not fit into memory; the message is for the user."""


def available(comm: MPI.Comm) -> float:
    """Return the bytes available per rank, the same on all: the minimum over the machines, shared by their ranks."""
    beside = comm.Split_type(MPI.COMM_TYPE_SHARED)
    ranks = beside.size
    beside.Free()
    return -largest(comm, -USABLE_MEMORY_SHARE * free() / ranks)


def needed(comm: MPI.Comm, own: float) -> tuple[float, float]:
    """Return the maximum and the sum of each rank's need ``own``."""
    return largest(comm, own), total(comm, own)


def free() -> float:
    """Return the bytes that are free on this machine, in this container."""
    return min([*_limits(), _of_machine()])


def _of_machine() -> float:
    """Return the bytes that the machine can give without swapping."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        return 1024.0 * next(int(line.split()[1]) for line in lines if line.startswith("MemAvailable"))
    except (OSError, StopIteration, ValueError):  # not Linux: all of it
        return float(os.sysconf("SC_PAGE_SIZE")) * os.sysconf("SC_PHYS_PAGES")


def _limits() -> Iterator[float]:
    """Yield the free memory of the containers around this process."""
    for most, used in (
        ("memory.max", "memory.current"),
        ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes"),
    ):
        try:
            yield float((GROUPS / most).read_text()) - float((GROUPS / used).read_text())
        except (OSError, ValueError):  # none, or "max"
            continue
