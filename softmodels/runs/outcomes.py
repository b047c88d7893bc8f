"""Exit statuses of a run, and the error that carries one."""

from __future__ import annotations

import dataclasses

from softmodels.common.errors import MeshingError, Spoken, written
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


class UnwrittenError(RunError):
    """States, or a mesh, that could not be written."""


@dataclasses.dataclass(frozen=True)
class Ended:
    """How a run ended: its exit status on a command line, and the sentence there; none if all was reached.

    The sentence has options as the command line has them; see `softmodels.common.errors.spoken`.
    """

    status: int = DONE
    message: str = ""
    error: Exception | None = dataclasses.field(default=None, compare=False)

    @classmethod
    def by(cls, error: Exception) -> Ended:
        """The end by an error whose message is a sentence for the user; all but runs and meshers were given bad input."""
        status = (
            error.status if isinstance(error, RunError) else FAILED if isinstance(error, MeshingError) else BAD_INPUT
        )
        return cls(status, written(error), error)
