"""How a problem is optimised: the options of a call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypedDict

import numpy as np
import numpy.typing as npt

from softmodels.design.evaluation import Evaluation
from softmodels.design.problem import DesignProblem

if TYPE_CHECKING:
    from mpi4py import MPI

EVALUATIONS = 40
"""Most evaluations of one start."""


class Judge(Protocol):
    """What evaluates designs: `softmodels.design.model.DesignModel`, or what stands in for it."""

    def evaluate(self, theta: npt.NDArray[np.float64]) -> Evaluation:
        """Values and gradients; a `DesignFailure` where there are none."""

    def confirm(self, theta: npt.NDArray[np.float64], finer: float = 1.0) -> Evaluation:
        """Values on a fresh mesh."""

    def release(self) -> None:
        """Give back what it holds; the next design is meshed anew."""


class How(TypedDict, total=False):
    """How a problem is optimised; nothing of it changes a design's values.

    Attributes:
        starts: How many; the first is the device as given, the others are spread over the bounds.
        evaluations: Most of one start.
        seed: Of the further starts.
        resume: Go on from the trials in the folder.
        progress: Gets a line for each design.
        stopped: Whether to stop, asked between evaluations.
        confirm: Solve the best design's whole path on a fresh mesh at the end, which is the default.
        finer: How much finer that mesh is.
        inputs: Files that are read: they are never written.
        model: Makes what evaluates designs from a problem and a communicator; `DesignModel` unless given.
    """

    starts: int
    evaluations: int
    seed: int
    resume: bool
    progress: Callable[[str], object]
    stopped: Callable[[], bool]
    confirm: bool
    finer: float
    inputs: Sequence[Path]
    model: Callable[[DesignProblem, MPI.Comm], Judge] | None
