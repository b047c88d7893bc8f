"""Exit statuses of a run, and the error that carries one."""

from __future__ import annotations

from softmodels.common.errors import Spoken
from softmodels.mechanics.mpi import TooLargeError

DONE, FAILED, BAD_INPUT, NO_EQUILIBRIUM, STOPPED = 0, 1, 2, 3, 130

NO_MEMORY = "out of memory; use a larger --cell-size, or a smaller slice of the device"


def no_memory(error: MemoryError) -> str:
    """Return the message for a memory that is or would be full."""
    return str(error) if isinstance(error, TooLargeError) else NO_MEMORY


class RunError(Spoken, RuntimeError):
    """A run failed; ``status`` is the exit status, the message is for the user."""

    def __init__(self, message: str, status: int = FAILED):
        super().__init__(message)
        self.status = status
