"""The folder of an optimisation: stores every trial at once, and the best design so far."""

from __future__ import annotations

import contextlib
import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

from geometries import GeometryError
from softmodels.common.errors import reason
from softmodels.common.files import read_text, replace_text, replaced_whole
from softmodels.common.folders import InUseError, OwnFolder, OwnFolderError, take_default
from softmodels.design.formulation import KEPT, Formulation
from softmodels.design.loads import DesignError, factor, shown_unit
from softmodels.design.problem import DesignProblem, in_words, label, shown, shown_factor
from softmodels.design.result import case_of, case_text
from softmodels.design.trials import Trial

KIND, ITERATES = "design", "iterates"
TABLE, DESIGN, START = "iterates.csv", "design.toml", "start.toml"


def identity(problem: DesignProblem) -> dict[str, str]:
    """Return all input that the values of a problem's designs depend on, by display name."""
    case = problem.case
    keeps = [(keep.quantity.key, keep.at_least, keep.at_most) for keep in problem.limits]
    errors = problem.errors
    return {
        "the case": case.to_toml(),
        "the free parameters": repr([(one.name, one.low, one.high) for one in problem.free]),
        "the objective and limits": repr(
            (problem.objective, [(term.quantity.key, term.weight) for term in problem.terms])
        ),
        "the limits": repr(keeps),
        "the tolerances": repr(sorted(problem.spreads.items())),
        "the material's errors": repr(None if errors is None else (errors.names, errors.matrix.tolist())),
    }


class DesignFolder:
    """The folder of one optimisation, locked; only rank 0 has one.

    Args:
        problem: What is optimised.
        output: The folder; None for ``results/NAME``, or the next number where that holds something else.
        resume: Take up the trials that an earlier run left.
        inputs: Files that are read: they are never written.

    Attributes:
        trials: The earlier trials.

    Raises:
        DesignError: The folder cannot be used, in a sentence.
    """

    def __init__(self, problem: DesignProblem, output: Path | None, resume: bool, inputs: Sequence[Path] = ()):
        self.problem, self._identity = problem, identity(problem)
        self.trials: list[Trial] = []
        self._best = 0
        try:
            default = Path("results") / problem.name
            self.own = take_default(default, KIND, self._identity) if output is None else OwnFolder(output, KIND)
            self.own.take()
        except (InUseError, OwnFolderError) as error:
            raise DesignError(str(error)) from None
        except OSError as error:
            raise DesignError(f"the folder {output or default} cannot be written ({reason(error)})") from None
        self._iterates = OwnFolder(self.path / ITERATES, ITERATES)
        try:
            self._new = not (resume and self._take_up())
            self.own.check_inputs(inputs)
        except OwnFolderError as error:
            self.leave()
            raise DesignError(str(error)) from None
        except BaseException:
            self.leave()
            raise

    @property
    def path(self) -> Path:
        return self.own.path

    def _take_up(self) -> bool:
        """Read the earlier trials; return whether there are any."""
        before = self.own.about.get("inputs")
        if before is None:
            return False
        for name, value in self._identity.items():
            if before.get(name) != value:
                raise DesignError(
                    f"{self.path} holds designs of another problem: {name} changed; run without --resume, "
                    f"or use another folder (--output)"
                )
        for number in range(1, 100000):
            file = self.path / ITERATES / f"{number:04d}.json"
            if not file.is_file():
                break
            try:
                self.trials.append(Trial.from_json(read_text(file)))
            except (OSError, ValueError):
                raise DesignError(f"{file} cannot be read as a design; run without --resume") from None
        return bool(self.trials)

    # -- writing --------------------------------------------------------------------------------------------------------

    def add(self, trials: Sequence[Trial], form: Formulation | None) -> None:
        """Write the last of some trials, the table of all, and the best design so far.

        Raises:
            OwnFolderError, OSError: It cannot be written.
        """
        if self._new:
            self.own.remove(self.own.files)
            self.own.claim([TABLE, DESIGN, START, f"{ITERATES}/"], {"inputs": self._identity})
            replace_text(self.path / START, case_text(self.problem, self.problem.case))
            self._new = False
        (self.path / ITERATES).mkdir(exist_ok=True)
        trial = trials[-1]
        names = [f"{trial.number:04d}.json", f"{trial.number:04d}.toml"]
        self._iterates.claim(names)
        with contextlib.suppress(GeometryError):  # an invalid device has no case
            replace_text(self.path / ITERATES / names[1], case_text(self.problem, case_of(self.problem, trial)))
        replace_text(self.path / ITERATES / names[0], trial.to_json())
        replace_text(self.path / TABLE, table(self.problem, trials, form))
        # Compare only values of one mesh: those of the previous one may satisfy limits that are violated on a fresh one.
        if form is None:
            return
        best = form.best([one for one in trials if one.mesh == trial.mesh])
        if best is not None and (trial.start == 1 or best is form.best(trials)):
            self._write_best(best)

    def settle(self, best: Trial, trials: Sequence[Trial]) -> Path:
        """Write the final design of an optimisation; return its folder."""
        if trials and not self._new:
            self._write_best(best)
        return self.path

    def _write_best(self, best: Trial) -> None:
        if best.number != self._best:
            replace_text(self.path / DESIGN, case_text(self.problem, case_of(self.problem, best)))
            self._best = best.number

    def write(self, files: Mapping[str, str | bytes]) -> None:
        """Write further files, such as the summary and the pictures."""
        self.own.claim(list(files))
        for name, content in files.items():
            if isinstance(content, str):
                replace_text(self.path / name, content)
            else:
                with replaced_whole(self.path / name, self.path / f"{name}.part") as aside:
                    aside.write_bytes(content)

    def leave(self) -> None:
        """Release the folder."""
        self.own.leave()


def table(problem: DesignProblem, trials: Sequence[Trial], form: Formulation | None) -> str:
    """Return ``iterates.csv``: one row per trial, units in the heads of the columns."""
    keys: dict[str, tuple[str, float]] = {}
    for trial in trials:
        for asked in problem.quantities:
            for key in trial.values:
                if key == asked.key or key.startswith(f"{asked.key.removesuffix('s')}:"):
                    words = label(asked, problem.case.cm) if key == asked.key else key
                    unit = "" if shown(asked) == "1" else f" ({shown(asked)})"
                    keys[key] = words + unit, shown_factor(asked)
    units = [(one, shown_unit(one.unit) or "1") for one in problem.free]
    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow([
        "number", "start", *(one.name + ("" if unit == "1" else f" ({unit})") for one, unit in units),
        *(words for words, _ in keys.values()), "limits kept", "worst limit (share passed)", "newton_iterations", "seconds",
        "mesh_quality", "remeshed", "failure",
    ])  # fmt: skip
    for trial in trials:
        kept = form is not None and not trial.failed
        worst = f"{form.worst(trial)[0]:.6g}" if kept and form is not None else ""
        rows.writerow([
            trial.number, trial.start,
            *(f"{value / factor(unit, one.unit or '1'):.9g}" for (one, unit), value in zip(units, trial.theta, strict=False)),
            *(f"{trial.values[key] / per:.9g}" if key in trial.values else "" for key, (_, per) in keys.items()),
            int(form.feasible(trial)) if form is not None and kept else "", worst, trial.newton, f"{trial.seconds:.3f}",
            f"{trial.quality:.4g}", int(trial.remeshed), trial.failure,
        ])  # fmt: skip
    return out.getvalue()


def line(problem: DesignProblem, trial: Trial, form: Formulation | None, left: float | None) -> str:
    """Return a trial in one line, for the terminal."""
    head = f"design {trial.number:3d} (start {trial.start})"
    if trial.failed or form is None:
        more = "" if trial.number == 1 else "; retrying with a shorter step"
        return f"{head}  {trial.failure or 'evaluated'}{more}  {trial.seconds:.1f} s"
    asked = problem.terms[0].quantity
    worst, row = form.worst(trial)
    limits = "no limits"
    if row is not None:
        limits = f"{'VIOLATED' if worst > KEPT else 'satisfied'}: {row.compared(trial.values[row.key], worst)}"
    rest = "" if left is None else f", about {max(left, 0.0):.0f} s left"
    return (
        f"{head}  {label(asked, problem.case.cm)} {in_words(asked, form.objective(trial), 5)}  "
        f"{limits}  {trial.newton} iterations  {trial.seconds:.1f} s{rest}"
    )
