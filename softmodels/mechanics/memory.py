"""How much memory there is, and how much of it the solution of a device's linear systems takes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from measurement.wording import Spoken
from softmodels.mechanics.mpi import largest, total

if TYPE_CHECKING:
    from mpi4py import MPI

GIGA = 1e9
GROUPS = Path("/sys/fs/cgroup")
"""Where Linux has the limits of containers."""
LEFT = 0.9
"""Share of what is free that a model may take: meshes, results and pictures need some, too."""


class TooLargeError(Spoken, MemoryError):
    """A model that would not fit into memory; the message is a sentence for the user."""


def available(comm: MPI.Comm) -> float:
    """Bytes that each rank may take, the same on all: the least of any machine's, shared by its ranks."""
    from mpi4py import MPI

    beside = comm.Split_type(MPI.COMM_TYPE_SHARED)
    ranks = beside.size
    beside.Free()
    return -largest(comm, -LEFT * free() / ranks)


def needed(comm: MPI.Comm, own: float) -> tuple[float, float]:
    """The largest rank's need and that of all, of each rank's ``own``."""
    return largest(comm, own), total(comm, own)


def free() -> float:
    """Bytes that are free on this machine, in this container."""
    return min([*_limits(), _of_machine()])


def _of_machine() -> float:
    """Bytes that the machine can give without swapping."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        return 1024.0 * next(int(line.split()[1]) for line in lines if line.startswith("MemAvailable"))
    except (OSError, StopIteration, ValueError):  # not Linux: all of it
        return float(os.sysconf("SC_PAGE_SIZE")) * os.sysconf("SC_PHYS_PAGES")


def _limits() -> Iterator[float]:
    """What the containers around this process leave of their memory."""
    for most, used in (
        ("memory.max", "memory.current"),
        ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes"),
    ):
        try:
            yield float((GROUPS / most).read_text()) - float((GROUPS / used).read_text())
        except (OSError, ValueError):  # none, or "max"
            continue
