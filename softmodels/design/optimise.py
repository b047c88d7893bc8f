"""Optimisation of a design: from a problem to the best device, every trial kept."""

from __future__ import annotations

import contextlib
import itertools
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
import numpy.typing as npt

from geometries import GeometryError, MeshingError
from measurement.own_folder import OwnFolderError
from softmodels.design.errors import DesignError, DesignStopped
from softmodels.design.evaluation import DesignFailure
from softmodels.design.evaluator import evaluator
from softmodels.design.folder import DesignFolder, line
from softmodels.design.formulation import Formulation, Scaled
from softmodels.design.how import EVALUATIONS, How
from softmodels.design.multipliers import holding
from softmodels.design.problem import DesignProblem
from softmodels.design.result import DesignResult, StartEnd
from softmodels.design.search import search
from softmodels.design.starts import further_starts
from softmodels.design.trials import Trial, Trials
from softmodels.mechanics.mpi import is_root, on_root, start
from softmodels.results.outcomes import NO_EQUILIBRIUM, RunError

if TYPE_CHECKING:
    from mpi4py import MPI


Array = npt.NDArray[np.float64]
USUAL = 18
"""Evaluations that a start usually takes, for the time that is left."""
PASSES = 4
"""Of a robust search: standard deviations are fixed while it goes on, and taken anew where it ended."""
CORRECTIONS, KEPT = 3, 1e-3
"""Times that the search goes on where a limit is passed on the fresh mesh, by more than this share of it."""
SETTLED = 0.02
"""Change of what they take, in shares of it, from which on a robust search has ended."""


def optimise(problem: DesignProblem | str | Path, folder: str | Path | None = None, **how: Unpack[How]) -> DesignResult:
    """Optimise a design.

    The method, and why, is in `softmodels.design.search`. A start ends where a step gains less than 1e-4 of the objective, at
    an optimum, or after ``evaluations`` designs. No design is evaluated twice.

    Args:
        problem: The problem, or its file.
        folder: Where every trial is kept as soon as it is known; None for nowhere.
        how: See `How`.

    Returns:
        The best design within all limits; where there is none the one with the least violation, and what holds it back.

    Raises:
        DesignError: What cannot be meant.
        RunError: The device as given has no state at a pressure it is asked at.
    """
    whole = problem if isinstance(problem, DesignProblem) else DesignProblem.from_file(Path(problem))
    comm = start()
    kept = None if folder is None else open_folder(whole, Path(folder), comm, how)
    try:
        return run_in(whole, kept, comm, **how)
    finally:
        if kept is not None:
            kept.leave()


def open_folder(problem: DesignProblem, output: Path | None, comm: MPI.Comm, how: How) -> DesignFolder | None:
    """The folder of an optimisation, on rank 0; None elsewhere.

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


def run_in(problem: DesignProblem, folder: DesignFolder | None, comm: MPI.Comm, **how: Unpack[How]) -> DesignResult:
    """The same into a folder that was taken already, which stays taken; see `open_folder`."""
    model = evaluator(problem, comm, how)
    try:
        return _Run(problem, model, folder, comm, how).result()
    finally:
        release = getattr(model, "release", None)
        if release is not None:
            release()


class _EnoughError(Exception):
    """A start has used up its evaluations."""


class _Run:
    """One optimisation under way, the same on all ranks."""

    def __init__(self, problem: DesignProblem, model: Any, folder: DesignFolder | None, comm: MPI.Comm, how: How):
        self.problem, self.model, self.folder, self.comm, self.how = problem, model, folder, comm, how
        self.trials = Trials()
        self.form: Formulation | None = None
        self.start = 1
        self.visited: set[int] = set()
        self.seconds: list[float] = []
        for trial in on_root(comm, lambda: [] if folder is None else folder.trials):
            self.trials.add(trial)

    # -- evaluating ---------------------------------------------------------------------------------------------------

    def trial(self, theta: Array) -> Trial:
        """A design's values: known already, or evaluated and kept.

        Raises:
            DesignStopped: The user asked to stop.
        """
        theta = on_root(self.comm, lambda: theta)
        found = self.trials.find(theta)
        if found is None:
            if on_root(self.comm, self.how.get("stopped", bool)):
                raise DesignStopped
            if len(self.visited) >= self.how.get("evaluations", EVALUATIONS):
                raise _EnoughError
            found = self._evaluated(theta)
            self.trials.add(found)
            if self.form is None and not found.failed:
                self.form = Formulation(self.problem, found)
            on_root(self.comm, self._keep)
        elif self.form is None and not found.failed:
            self.form = Formulation(self.problem, found)
        self.visited.add(found.number)
        return found

    def _evaluated(self, theta: Array) -> Trial:
        begun, number = time.monotonic(), len(self.trials.all) + 1
        try:
            evaluated = self.model.evaluate(theta)
            made = Trial.of(number, self.start, theta, evaluated, time.monotonic() - begun)
        except (DesignFailure, GeometryError, MeshingError) as error:
            made = Trial(
                number, self.start, tuple(map(float, theta)), seconds=time.monotonic() - begun, failure=str(error)
            )
        except ValueError as error:  # a quantity that this device does not have
            if self.trials.all:
                raise
            raise DesignError(str(error)) from None
        made = on_root(self.comm, lambda: made)
        self.seconds.append(made.seconds)
        return made

    def _keep(self) -> None:
        if self.folder is not None:
            try:
                self.folder.add(self.trials.all, self.form)
            except (OwnFolderError, OSError) as error:
                why = getattr(error, "strerror", None) or error
                raise RunError(f"the designs cannot be written into {self.folder.path} ({why})") from None
        self._tell(line(self.problem, self.trials.all[-1], self.form, self._left()))

    def _tell(self, text: str) -> None:
        tell = self.how.get("progress")
        if tell is not None and is_root(self.comm):
            tell(text)

    def _left(self) -> float | None:
        if len(self.seconds) < 2:
            return None
        starts = self.how.get("starts", 1) - self.start
        per_start = min(USUAL, self.how.get("evaluations", EVALUATIONS))
        return float(np.mean(self.seconds[1:])) * (max(per_start - len(self.visited), 1) + starts * per_start)

    # -- searching ----------------------------------------------------------------------------------------------------

    def result(self) -> DesignResult:
        """Search from every start, judge and confirm the best design."""
        ends, stopped = list[StartEnd](), False
        try:
            for number, x in self._starts():
                self.start, self.visited = number, set()
                ends.append(self._followed(x))
        except DesignStopped:
            stopped = True
            mine = [trial for trial in self.trials.all if trial.start == self.start]
            ends.append(
                StartEnd(self.start, None if self.form is None else self.form.best(mine), "stopped by the user")
            )
        best = None if self.form is None else self.form.best(self.trials.all)
        if best is None or self.form is None:
            raise RunError("stopped by the user before any design could be judged", 130)
        confirmed, trouble = dict[str, float](), ""
        if not stopped and self.how.get("confirm", True):
            try:
                best, confirmed, trouble = self._settled(best)
            except DesignStopped:
                stopped, best = True, self.form.best(self.trials.all) or best
        where = on_root(self.comm, lambda: None if self.folder is None else self.folder.path)
        return DesignResult(
            self.problem, self.form, tuple(self.trials.all), tuple(ends), best, holding(self.form, best), confirmed,
            self.how.get("finer", 1.0), stopped, trouble, where,
        )  # fmt: skip

    def _starts(self) -> Iterator[tuple[int, Array]]:
        """Numbers and scaled parameters of the starts; those after the first are tried until one has a state."""
        first = np.array([one.start for one in self.problem.free])
        low = np.array([one.low for one in self.problem.free])
        width = np.array([one.width for one in self.problem.free])
        yield 1, (first - low) / width
        assert self.form is not None  # the first start has a state
        points = further_starts(self.problem, self.how.get("seed", 1))
        for number in range(2, self.how.get("starts", 1) + 1):
            self.start, self.visited = number, set()
            for x in itertools.islice(points, 8):
                if not self.trial(self.form.theta(x)).failed:
                    yield number, x
                    break

    def _followed(self, x: Array) -> StartEnd:
        """One search."""
        if self.form is None:
            self._first()
        assert self.form is not None
        form, seen = self.form, list[Trial]()
        if self.start == 1:
            x = form.x(np.array(self.trials.all[0].theta))
        why = ""
        try:
            begin = self.trial(np.array(self.trials.all[0].theta) if self.start == 1 else form.theta(x))
            seen.append(begin)
            self._passes(self._judged(seen, begin), x)
        except _EnoughError:
            why = f"after {len(self.visited)} evaluations"
        return StartEnd(self.start, form.best(seen), why)

    def _judged(self, seen: list[Trial], begin: Trial) -> Callable[[Array], Trial]:
        """Trials by scaled parameters, noted in a list; the first is hit to the last bit, or it would be evaluated twice."""
        assert self.form is not None
        form = self.form
        x = form.x(np.array(begin.theta))

        def judged(point: Array) -> Trial:
            theta = np.array(begin.theta) if np.array_equal(point, x) else form.theta(point)
            seen.append(self.trial(theta))
            return seen[-1]

        return judged

    def _first(self) -> None:
        """Judge the device as given.

        Raises:
            RunError: It has no state where it is asked.
        """
        theta = [*(one.start for one in self.problem.free)]
        rest = self.problem.names[len(theta) :]
        from geometries.parameters import parameter

        trial = self.trial(np.array([*theta, *(parameter(self.problem.case.actuator, name) for name in rest)]))
        if trial.failed:
            raise RunError(
                f"the device as given cannot be judged: {trial.failure}; start from one that bears the working "
                "pressure, such as with thicker walls",
                NO_EQUILIBRIUM,
            )

    def _passes(self, judged: Callable[[Array], Trial], x: Array) -> None:
        """The search, again with new standard deviations as long as those change."""
        assert self.form is not None
        form, end = self.form, x
        for _ in range(PASSES if form.spread.any else 1):
            allowances = form.allowances(judged(end))

            def evaluate(point: Array, allowances: Array = allowances) -> Scaled | None:
                before = set(self.visited)
                trial = judged(point)
                fresh = trial.remeshed and trial.number not in before
                return None if trial.failed else form.scaled(trial, allowances, fresh)

            end = search(evaluate, end)
            after = form.allowances(judged(end))
            scales = np.array([row.scale for row in form.rows])
            if not len(after) or float(np.max(np.abs(after - allowances) / scales)) <= SETTLED * 0.05:
                return

    def _settled(self, best: Trial) -> tuple[Trial, dict[str, float], str]:
        """The best design that keeps its limits on a fresh mesh too, its values there, and why there are none."""
        assert self.form is not None
        confirmed, trouble = self._confirmed(best)
        for _ in range(CORRECTIONS):
            form = self.form
            if trouble or not form.rows or not form.feasible(best):
                break
            if form.passed(confirmed, form.allowances(best)).max() <= KEPT:
                break
            self._tell(
                "on the fresh mesh a limit is passed: the search goes on with the differences between the meshes"
            )
            self.form = form.corrected(best, confirmed)
            self.start, self.visited = best.start, set()
            seen = [best]
            with contextlib.suppress(_EnoughError):
                self._passes(self._judged(seen, best), self.form.x(np.array(best.theta)))
            found = self.form.best(self.trials.all) or best
            if found is best:
                break
            best = found
            confirmed, trouble = self._confirmed(best)
        return best, confirmed, trouble

    def _confirmed(self, best: Trial) -> tuple[dict[str, float], str]:
        """Values on a fresh mesh, and why there are none."""
        try:
            found = self.model.confirm(np.array(best.theta), self.how.get("finer", 1.0))
        except (DesignFailure, GeometryError, MeshingError) as error:
            return {}, f"on a fresh mesh the design could not be confirmed: {error}"
        return {key: float(value) for key, value in found.values.items()}, ""
