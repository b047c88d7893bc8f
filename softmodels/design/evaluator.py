"""What evaluates the designs of a problem: finite elements, unless a caller gives something else."""

from __future__ import annotations

from typing import TYPE_CHECKING

from softmodels.design.how import How, Judge
from softmodels.design.problem import DesignProblem
from softmodels.mechanics.mpi import is_root

if TYPE_CHECKING:
    from collections.abc import Callable

    from mpi4py import MPI


def evaluator(problem: DesignProblem, comm: MPI.Comm, how: How) -> Judge:
    """What has `evaluate` and `confirm` as `softmodels.design.model.DesignModel` has.

    Raises:
        GeometryError: A parameter that the device's mesh cannot follow.
    """
    make = how.get("model")
    return make(problem, comm) if make is not None else _model(problem, comm, _report(comm, how))


def _report(comm: MPI.Comm, how: How) -> Callable[[str], None]:
    """Takes sentences of the model: rank 0 alone tells them."""

    def report(text: str) -> None:
        if is_root(comm) and (tell := how.get("progress")) is not None:
            tell(text)

    return report


def _model(problem: DesignProblem, comm: MPI.Comm, report: Callable[[str], None]) -> Judge:
    from softmodels.design.model import DesignModel

    errors = problem.errors
    return DesignModel(
        problem.case, problem.names, problem.quantities, comm, highest=problem.highest,
        materials=() if errors is None else errors.names, report=report,
    )  # fmt: skip
