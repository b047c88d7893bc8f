"""How a problem is optimised: the options of a call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypedDict

from softmodels.design.problem import DesignProblem

EVALUATIONS = 40
"""Most evaluations of one start."""


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
    model: Callable[[DesignProblem, Any], Any] | None
