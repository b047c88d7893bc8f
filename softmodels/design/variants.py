"""Whole numbers in a design, such as the number of chambers: every value is searched by itself, and the best is reported."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from softmodels.common.files import replace_text
from softmodels.common.folders import OwnFolderError
from softmodels.design.model import DESIGN, START, TABLE, DesignFolder, table
from softmodels.design.problem import DesignProblem, SearchOptions, in_words, label
from softmodels.design.result import DesignResult, case_text
from softmodels.design.trials import DesignError
from softmodels.mechanics.mpi import on_root
from softmodels.runs.outcomes import RunError

if TYPE_CHECKING:
    from mpi4py import MPI

VARIANTS = "variants.csv"

type Run = Callable[..., DesignResult]
"""`softmodels.design.optimise.run_in`."""


@dataclasses.dataclass(frozen=True, eq=False)
class Variant:
    """One choice of the whole numbers.

    Attributes:
        words: Their values, as in ``chambers 4``.
        problem: The problem with these values, of which only continuous parameters are free.
        result: What was found; None where the device has no state.
        trouble: Why there is none.
    """

    words: str
    problem: DesignProblem
    result: DesignResult | None
    trouble: str = ""

    @property
    def order(self) -> tuple[float, ...]:
        """Sorts the best first."""
        if self.result is None:
            return True, True, 0.0
        end = self.result.end
        return (False, *end.order()) if end.best is not None else (True, True, 0.0)

    @property
    def sentence(self) -> str:
        """What was found, in a sentence."""
        if self.result is None:
            return f"{self.words}: {self.trouble}"
        asked = self.problem.terms[0].quantity
        limits = "" if self.result.feasible else " (limits violated)"
        value = in_words(asked, self.result.end.objective, 5)
        return f"{self.words}: {label(asked, self.problem.case.cm)} {value}{limits}, {len(self.result.trials)} designs"


def run_variants(
    problem: DesignProblem, folder: DesignFolder | None, comm: MPI.Comm, run: Run, **how: Unpack[SearchOptions]
) -> DesignResult:
    """Optimise for each choice of the whole numbers; return the result of the best, with all in its `DesignResult.variants`.

    Args:
        problem: The problem.
        folder: Of all; each choice has a folder of its own in it.
        comm: MPI communicator.
        run: Optimises one of them.
        how: Options of the call.

    Raises:
        RunError: None of them has a state where it is asked.
    """
    tell, found = how.get("progress"), list[Variant]()
    on_root(comm, lambda: _begin(problem, folder, how))
    for words, one in problem.variants():
        if tell is not None:
            on_root(comm, lambda words=words: tell(f"{words}:"))  # type: ignore[misc]
        own = _opened(one, words, folder, comm, how)
        try:
            found.append(Variant(words, one, run(one, own[0] if own else None, comm, **how)))
        except RunError as error:
            if "stopped" in str(error):
                raise
            found.append(Variant(words, one, None, str(error)))
        finally:
            for taken in own:
                taken.leave()
        result = found[-1].result
        if result is not None and result.stopped:
            break
    best = min(found, key=lambda variant: variant.order)
    if best.result is None:
        raise RunError(f"no choice of {', '.join(problem.counts)} can be evaluated: {found[0].sentence}")
    made = dataclasses.replace(best.result, variants=tuple(one.sentence for one in found))
    where = on_root(comm, lambda: None if folder is None else _settle(folder, best, found))
    return dataclasses.replace(made, folder=where)


def _name(words: str) -> str:
    return words.replace(", ", "-").replace(" ", "-")


def _begin(problem: DesignProblem, folder: DesignFolder | None, how: SearchOptions) -> None:
    """Claim the folder's files, once those of an earlier run are gone."""
    if folder is None:
        return
    if not how.get("resume", False):
        folder.own.remove(folder.own.files)
    names = [f"{_name(words)}/" for words, _ in problem.variants()]
    folder.own.claim([TABLE, DESIGN, START, VARIANTS, *names], {"inputs": folder.identity})


def _opened(
    problem: DesignProblem, words: str, folder: DesignFolder | None, comm: MPI.Comm, how: SearchOptions
) -> list[DesignFolder]:
    """Return the folder of one choice, on rank 0; none elsewhere."""
    taken: list[DesignFolder] = []

    def take() -> None:
        if folder is not None:
            try:
                taken.append(DesignFolder(problem, folder.path / _name(words), how.get("resume", False)))
            except OwnFolderError as error:
                raise DesignError(str(error)) from None

    on_root(comm, take)
    return taken


def _settle(folder: DesignFolder, best: Variant, found: list[Variant]) -> Path:
    """Write the best design, the table of all choices, and that of all designs; return the folder."""
    assert best.result is not None
    replace_text(folder.path / START, case_text(best.problem, best.result.given))
    replace_text(folder.path / DESIGN, case_text(best.problem, best.result.case))
    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    asked = best.problem.terms[0].quantity
    rows.writerow(["variant", label(asked, best.problem.case.cm), "limits kept", "designs", "failure"])
    for one in found:
        told = ["", "", 0] if one.result is None else [
            in_words(asked, one.result.end.objective, 7), int(one.result.feasible), len(one.result.trials),
        ]  # fmt: skip
        rows.writerow([one.words, *told, one.trouble])
    replace_text(folder.path / VARIANTS, out.getvalue())
    replace_text(folder.path / TABLE, "".join(_all_designs(found)))
    return folder.path


def _all_designs(found: list[Variant]) -> Iterator[str]:
    """Yield the lines of the table of all designs, each with its choice in front."""
    for number, one in enumerate(one for one in found if one.result is not None):
        assert one.result is not None
        head, *lines = table(one.problem, one.result.trials, one.result.form).splitlines(keepends=True)
        if not number:
            yield f"variant,{head}"
        yield from (f'"{one.words}",{text}' for text in lines)
