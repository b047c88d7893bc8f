"""Evaluation of designs, the same on all ranks: none twice on one mesh, each kept and reported as soon as it is known."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from geometries import GeometryError, MeshingError
from measurement.own_folder import OwnFolderError
from softmodels.design.errors import DesignError, DesignStopped
from softmodels.design.evaluation import DesignFailure
from softmodels.design.folder import DesignFolder, line
from softmodels.design.formulation import Formulation
from softmodels.design.how import EVALUATIONS, How, Judge
from softmodels.design.problem import DesignProblem
from softmodels.design.trials import Trial, Trials
from softmodels.mechanics.mpi import is_root, on_root
from softmodels.results.outcomes import RunError

if TYPE_CHECKING:
    from mpi4py import MPI

Array = npt.NDArray[np.float64]
USUAL = 18
"""Evaluations that a start usually takes, for the time that is left."""


class EnoughError(Exception):
    """A search has used up its evaluations."""


class Evaluating:
    """Evaluates the designs of one optimisation.

    Args:
        problem: What is optimised.
        model: What evaluates.
        folder: Where trials are kept, on rank 0; None for nowhere.
        comm: MPI communicator.
        how: Options of the call.

    Attributes:
        trials: All trials.
        form: The problem in scaled numbers; None until a design could be judged.
        start: The start under way.
        mesh: The mesh under way, counted from 1: `fresh_mesh` begins another.
        visited: Numbers of the trials of this search.
    """

    def __init__(self, problem: DesignProblem, model: Judge, folder: DesignFolder | None, comm: MPI.Comm, how: How):
        self.problem, self.model, self.folder, self.comm, self.how = problem, model, folder, comm, how
        self.trials = Trials()
        self.form: Formulation | None = None
        self.start, self.mesh = 1, 1
        self.visited: set[int] = set()
        self._seconds: list[float] = []
        for trial in on_root(comm, lambda: [] if folder is None else folder.trials):
            self.trials.add(trial)

    def trial(self, theta: Array) -> Trial:
        """A design's values: known already, or evaluated and kept.

        Raises:
            DesignStopped: The user asked to stop.
            EnoughError: This search has used up its evaluations.
        """
        theta = on_root(self.comm, lambda: theta)
        found = self.trials.find(theta, self.mesh)
        new = found is None
        if found is None:
            if on_root(self.comm, self.how.get("stopped", bool)):
                raise DesignStopped
            if len(self.visited) >= self.how.get("evaluations", EVALUATIONS):
                raise EnoughError
            found = self._evaluated(theta)
            self.trials.add(found)
        if self.form is None and not found.failed:
            self.form = Formulation(self.problem, found)
        if new:
            on_root(self.comm, self._keep)
        self.visited.add(found.number)
        return found

    def fresh_mesh(self) -> None:
        """The next design is meshed anew, and none is taken from those before."""
        self.mesh += 1
        self.visited = set()
        self.release()

    def release(self) -> None:
        """Give back what the model holds."""
        self.model.release()

    def confirmed(self, best: Trial) -> tuple[dict[str, float], str]:
        """Values on a fresh mesh along the whole path, and why there are none."""
        try:
            found = self.model.confirm(np.array(best.theta), self.how.get("finer", 1.0))
        except (DesignFailure, GeometryError, MeshingError) as error:
            return {}, f"on a fresh mesh the design could not be confirmed: {error}"
        return on_root(self.comm, lambda: {key: float(value) for key, value in found.values.items()}), ""

    def tell(self, text: str) -> None:
        """A line to whoever listens, from rank 0."""
        listener = self.how.get("progress")
        if listener is not None and is_root(self.comm):
            listener(text)

    def _evaluated(self, theta: Array) -> Trial:
        begun, number = time.monotonic(), len(self.trials.all) + 1
        place = (number, self.start, tuple(map(float, theta)), self.mesh)
        try:
            made = Trial.of(place, self.model.evaluate(theta), time.monotonic() - begun)
        except (DesignFailure, GeometryError, MeshingError) as error:
            limit = getattr(error, "limit", None)
            more = "" if limit is None else f" (its limit is at {limit / self.problem.case.cm:.4g} cm)"
            made = Trial(*place, seconds=time.monotonic() - begun, failure=f"{error}{more}")
        except ValueError as error:  # a quantity that this device does not have
            if self.trials.all:
                raise
            raise DesignError(str(error)) from None
        made = on_root(self.comm, lambda: made)
        self._seconds.append(made.seconds)
        return made

    def _keep(self) -> None:
        if self.folder is not None:
            try:
                self.folder.add(self.trials.all, self.form)
            except (OwnFolderError, OSError) as error:
                why = getattr(error, "strerror", None) or error
                raise RunError(f"the designs cannot be written into {self.folder.path} ({why})") from None
        self.tell(line(self.problem, self.trials.all[-1], self.form, self._left()))

    def _left(self) -> float | None:
        """Seconds to the end, roughly; None where nothing is known of it."""
        if len(self._seconds) < 2:
            return None
        starts = self.how.get("starts", 1) - self.start
        per_start = min(USUAL, self.how.get("evaluations", EVALUATIONS))
        return float(np.mean(self._seconds[1:])) * (max(per_start - len(self.visited), 1) + starts * per_start)
