"""How many processes solve a case: as many as pay, started under MPI's launcher by the command itself.

A command that wants several ranks starts itself again under ``mpirun``. That runs in a session of its own, for MPICH's ends
its processes on Ctrl-C before they can close their files; here the signal goes to the ranks, which end as one alone does.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from types import FrameType

import click

from geometries import GeometryError, MeshFileError, MeshingError, MeshingStopped, kept_meshes
from measurement.cores import cores
from measurement.ending import STOPPED, STOPS, asked_to_stop
from measurement.terminal import COLUMNS, columns, say
from softmodels.case.case import Case
from softmodels.mechanics.mpi import StartError, launched, mpich_file

AUTO = "auto"
EACH = 30_000
"""Unknowns of a rank from which on another one pays: on two cores a path of 25,000 is as quick on one of them while the other
draws, and one of 88,000 takes two thirds of the time on two."""
PR_SET_PDEATHSIG = 1
"""Of Linux' prctl."""
PER_NODE = 3.2
"""Unknowns per node of a solid mesh: three displacements, and the pressure at its corners."""


class RanksType(click.ParamType):
    """``auto`` or a number of ranks."""

    name = "auto|N"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> int | None:
        if value is None or value == AUTO:
            return None
        try:
            ranks = int(str(value))
        except ValueError:
            ranks = 0
        if ranks < 1:
            self.fail(f"{value!r} is neither {AUTO} nor a number of ranks, 1 or more", param, ctx)
        return ranks


def ranks_for(case: Case, wanted: int | None, quiet: bool = False) -> int:
    """The number of ranks that a case is solved on, where no launcher has decided it.

    Args:
        case: What is to be solved.
        wanted: As many as the user says; None for as many as pay: those of the cores that have `EACH` unknowns or more.
        quiet: Do not report what takes its time.

    Raises:
        StartError: A launcher has started another number of ranks than is wanted, or there is none to start them.
    """
    if (size := launched()) is not None:
        if wanted and size and wanted != size:
            raise StartError(
                f"--ranks {wanted} asks for other ranks than the {size} that mpirun has started; leave it out"
            )
        return 1
    if wanted is None:
        paying = _unknowns(case, quiet) // EACH if cores() > 1 and _launcher() else 1
        return max(1, min(cores(), paying))
    if wanted > 1 and not _launcher():
        raise StartError(
            f"--ranks {wanted} needs mpirun, which was not found beside {sys.executable} or on the PATH", 1
        )
    return wanted


def _unknowns(case: Case, quiet: bool) -> int:
    """About how many unknowns a case has; 0 where that does not matter, or is told in a better place.

    The mesh is made for that, and kept: the ranks find it in the cache.
    """
    device = case.actuator
    if device.dimension != 3:
        return 0
    if not quiet and not kept_meshes.known(device):
        say(kept_meshes.told(device), err=True)
    with tempfile.TemporaryDirectory() as folder, asked_to_stop() as stopped:
        file = Path(folder) / "mesh.msh"
        try:
            device.write(file, stopped)
            return int(PER_NODE * _nodes(file))
        except MeshingStopped:
            raise StartError("stopped by the user while the mesh was made; nothing is solved yet", STOPPED) from None
        except (GeometryError, MeshingError, MeshFileError, OSError):
            return 0  # found again, and reported, by the run


def _nodes(file: Path) -> int:
    """Nodes of a mesh file of Gmsh, version 4."""
    with file.open("rb") as lines:
        for line in lines:
            if line.strip() == b"$Nodes":
                return int(next(lines).split()[1])
    return 0


def _launcher() -> str | None:
    """The launcher of the MPI in use: the wheel's stands beside Python."""
    own = mpich_file("mpirun")
    beside = shutil.which("mpirun", path=str(Path(sys.executable).parent))
    return beside or (str(own) if own else None) or shutil.which("mpirun")


def start_again(ranks: int) -> int:
    """Run this very command on so many ranks, to its end.

    Returns:
        Its exit status.

    Raises:
        StartError: The launcher does not start.
    """
    environment = dict(os.environ)
    for stream, variable in COLUMNS.items():  # the ranks see pipes of the launcher's
        if (width := columns(stream)) is not None:
            environment[variable] = str(width)
    try:
        process = subprocess.Popen(
            [str(_launcher()), "-n", str(ranks), sys.executable, *sys.orig_argv[1:]],
            env=environment,
            start_new_session=True,
            preexec_fn=_end_with_parent,
        )
    except OSError as error:
        raise StartError(f"mpirun does not start ({error.strerror or error}); use --ranks 1", 1) from None

    def forward(number: int, frame: FrameType | None) -> None:
        for rank in _children(_children([process.pid])):  # of the launcher's proxies
            with contextlib.suppress(OSError):
                os.kill(rank, number)

    before = {number: signal.signal(number, forward) for number in STOPS}
    try:
        return _status(process.wait())
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _end_with_parent() -> None:
    """Have this process end when the one that has started it does, even if that is killed; on Linux."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def _status(returned: int) -> int:
    """The exit status of a launcher; that of a rank whatever the launcher adds, such as a signal's."""
    return 128 - returned if returned < 0 else returned


def _children(parents: list[int]) -> list[int]:
    """Processes that these have started."""
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError, ValueError, IndexError):
            if int(status.read_text().rpartition(")")[2].split()[1]) in parents:
                found.append(int(status.parent.name))
    return found
