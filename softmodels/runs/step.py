"""What passes between a simulation and who uses it: its states, how it is told of, and where it goes on from."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

from softmodels.results.outcomes import RunError
from softmodels.results.restart import Restart
from softmodels.results.row import Row

if TYPE_CHECKING:
    from softmodels.path.points import Point
    from softmodels.path.stages import Stop

Array = npt.NDArray[np.float64]


class Listener(Protocol):
    """Who is told how a run goes on: nobody, a program's log, a notebook."""

    def say(self, text: str) -> None:
        """One sentence about what is going on."""

    def step(self, row: Row, value: float) -> None:
        """A state was solved: its row of ``path.csv``, and how far it is towards the last requested value."""


class Silent:
    """A listener that does nothing."""

    def say(self, text: str) -> None:
        pass

    def step(self, row: Row, value: float) -> None:
        pass


class PathEnded(RunError):
    """A requested value is not on the path, or the path was lost; the states up to there are good."""


@dataclasses.dataclass(frozen=True, eq=False)
class Step:
    """One state of a run.

    Attributes:
        row: Its row of ``path.csv``, on all ranks.
        fields: Nodal fields by name, SI units, shape (n,) or (n, 3), as `Fields.nodal` gives them, and what a restart needs
            to the last bit; on rank 0, None elsewhere.
        restart: Numbers that a restart needs beside the fields.
    """

    row: Row
    fields: dict[str, Array] | None
    restart: Restart


@dataclasses.dataclass(frozen=True, eq=False)
class Begun:
    """What is known of a run that is gone on with.

    Attributes:
        rows: Rows of ``path.csv`` of the states that there are; none for a run from the beginning.
        left: Which of the case's requested values are still to come.
        points: The points to go on from; see `Continuation.resume`.
        stop: The same of a program: the end of its last complete step.
        recall: Lets parts remember what they do after those states; called where the path has begun.
    """

    rows: Sequence[Row] = ()
    left: Sequence[bool] = ()
    points: Sequence[Point] = ()
    stop: Stop | None = None
    recall: Callable[[], None] = lambda: None


FROM_REST = Begun()
