"""Optimise a design: from a problem to the best device, storing every trial."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Unpack, cast

import numpy as np

from geometries.actuator import parameter
from softmodels.common.arrays import Array
from softmodels.common.names import callback, checked, flag, place, several, whole as whole_number, wrong
from softmodels.common.processes import one_at_a_time
from softmodels.design.folder import DesignFolder
from softmodels.design.loads import DesignStopped
from softmodels.design.model import Evaluating, evaluator
from softmodels.design.problem import EVALUATIONS, DesignProblem, Judge, SearchOptions
from softmodels.design.result import DesignResult, StartEnd, holding
from softmodels.design.search import follow, further_starts
from softmodels.mechanics.mpi import on_root, start
from softmodels.runs.outcomes import NO_EQUILIBRIUM, STOPPED, RunError

if TYPE_CHECKING:
    from mpi4py import MPI


TRIED = 8
"""Maximum number of points tried for a further start until one has a state."""


@checked
@one_at_a_time
def optimise(
    problem: DesignProblem | str | Path,
    folder: str | Path | None = None,
    *,
    starts: int = 1,
    evaluations: int = EVALUATIONS,
    seed: int = 1,
    resume: bool = False,
    progress: Callable[[str], object] | None = None,
    stopped: Callable[[], bool] | None = None,
    confirm: bool = True,
    finer: float = 1.0,
    inputs: Sequence[Path] = (),
    model: Callable[[DesignProblem, MPI.Comm], Judge] | None = None,
) -> DesignResult:
    """Optimise a design.

    The method, and why, is in `softmodels.design.search`. A start ends where a step gains less than 1e-4 of the objective, at
    an optimum, or after ``evaluations`` designs. Then its end is confirmed on a fresh mesh; where limits are passed otherwise
    there, the search goes on from it on that mesh. No design is evaluated twice on one mesh.

    Args:
        problem: The problem, or its file.
        folder: Where every trial is kept as soon as it is known; None for nowhere.
        starts: How many; the first is the device as given, the others are spread over the bounds.
        evaluations: Most of one start.
        seed: Of the further starts.
        resume: Go on from the trials in the folder.
        progress: Gets a line for each design.
        stopped: Whether to stop, asked between evaluations.
        confirm: Solve the best design's whole path on a fresh mesh at the end.
        finer: How much finer that mesh is.
        inputs: Files that are read: they are never written.
        model: Makes what evaluates designs from a problem and a communicator; finite elements if None.

    Returns:
        The best design within all limits; where there is none the one with the least violation, and what holds it back.

    Raises:
        DesignError: Invalid input.
        RunError: The given device has no state at a requested pressure.
    """
    output = None if folder is None else place("folder", folder, "a folder")
    read = several("inputs", inputs, Path, "a file's Path")
    functions = {"progress": progress, "stopped": stopped, "model": model}
    how = _how(starts, evaluations, seed, finer, {"resume": resume, "confirm": confirm}, functions, read)
    whole = problem
    if not isinstance(whole, DesignProblem):
        whole = DesignProblem.from_file(place("problem", whole, "a problem file"))
    comm = start()
    kept = None if output is None else open_folder(whole, output, comm, how)
    try:
        return run_in(whole, kept, comm, **how)
    finally:
        if kept is not None:
            kept.leave()


def _how(
    starts: object,
    evaluations: object,
    seed: object,
    finer: object,
    flags: Mapping[str, object],
    functions: Mapping[str, object],
    inputs: Sequence[Path],
) -> SearchOptions:
    """Return the options of a call, checked, without those that are None.

    Raises:
        ArgumentError: One of them is something else.
    """
    for name, function in functions.items():
        callback(name, function)
    given = {name: function for name, function in functions.items() if function is not None}
    how = {
        "starts": whole_number("starts", starts, 1), "evaluations": whole_number("evaluations", evaluations, 1),
        "seed": whole_number("seed", seed, 0), "finer": _finer(finer), "inputs": inputs,
        **{name: flag(name, value) for name, value in flags.items()}, **given,
    }  # fmt: skip
    return cast("SearchOptions", how)


def _finer(value: object) -> float:
    """Return the refinement of the fresh mesh; raise `ArgumentError` if it is below 1."""
    plain = value.item() if isinstance(value, np.generic) else value
    if isinstance(plain, bool) or not isinstance(plain, int | float) or not 1.0 <= plain <= 10.0:
        raise wrong("finer", value, "a number from 1 to 10")
    return float(plain)


def open_folder(problem: DesignProblem, output: Path | None, comm: MPI.Comm, how: SearchOptions) -> DesignFolder | None:
    """Return the folder of an optimisation, on rank 0; None elsewhere.

    Args:
        problem: The problem.
        output: The folder; None for the default.
        comm: MPI communicator.
        how: Whether to go on, and files that are read.

    Raises:
        DesignError: It cannot be used; on all ranks.
    """
    taken: list[DesignFolder] = []

    def take() -> None:
        taken.append(DesignFolder(problem, output, how.get("resume", False), how.get("inputs", ())))

    on_root(comm, take)
    return taken[0] if taken else None


def run_in(
    problem: DesignProblem, folder: DesignFolder | None, comm: MPI.Comm, **how: Unpack[SearchOptions]
) -> DesignResult:
    """Optimise into a folder that is already open, and stays open; see `open_folder`."""
    under_way = Evaluating(problem, evaluator(problem, comm, how), folder, comm, how)
    try:
        return _run(under_way)
    finally:
        under_way.release()


def _run(under_way: Evaluating) -> DesignResult:
    """Search from every start, and return the best result."""
    problem, ends = under_way.problem, list[StartEnd]()
    try:
        for theta in _starts(under_way):
            ends.append(follow(under_way, theta))
            if ends[-1].stopped:
                break
        stopped = ends[-1].stopped
    except DesignStopped:  # before the first design, or while searching for a start
        stopped = True
    judged = [end for end in ends if end.best is not None]
    if not judged:
        raise RunError("stopped by the user before any design was evaluated", STOPPED)
    end = min(judged, key=StartEnd.order)
    best, folder = end.best, under_way.folder
    assert best is not None
    where = on_root(under_way.comm, lambda: None if folder is None else folder.settle(best, under_way.trials.all))
    return DesignResult(
        problem, end, tuple(under_way.trials.all), tuple(ends), holding(end.form, best),
        under_way.how.get("finer", 1.0), stopped, where,
    )  # fmt: skip


def _starts(under_way: Evaluating) -> Iterator[Array]:
    """Yield the starting points of searches, each on its own mesh; after the first, those that have a state.

    Raises:
        RunError: The device as given has no state where it is asked.
    """
    problem = under_way.problem
    theta = np.array([parameter(problem.case.actuator, name) for name in problem.names])
    trial = under_way.trial(theta)
    if trial.failed:
        raise RunError(
            f"the given device cannot be evaluated: {trial.failure}; start from one that reaches the requested "
            f"pressures, such as with thicker walls",
            NO_EQUILIBRIUM,
        )
    yield theta
    assert under_way.form is not None
    points = further_starts(problem, under_way.how.get("seed", 1))
    for number in range(2, under_way.how.get("starts", 1) + 1):
        under_way.start = number
        for x in itertools.islice(points, TRIED):
            under_way.fresh_mesh()
            if not under_way.trial(under_way.form.theta(x)).failed:
                yield under_way.form.theta(x)
                break
