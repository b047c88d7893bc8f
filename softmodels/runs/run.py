"""A run as a value: its states as arrays in SI units, and where and why its path ends."""

from __future__ import annotations

import dataclasses
import functools
import io
import operator
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from measurement.arguments import checked, place
from measurement.units import UnitError, brief, number
from measurement.user_file import file_digest
from measurement.wording import Spoken, known_are, spoken, written
from softmodels.case.case import CaseError
from softmodels.mechanics.mpi import on_root
from softmodels.results.limits import Limit
from softmodels.results.notes import notes_of
from softmodels.results.outcomes import DONE, NO_EQUILIBRIUM, STOPPED, RunError
from softmodels.results.row import Row
from softmodels.results.sources import in_order
from softmodels.results.state_words import state_words
from softmodels.results.store import Results
from softmodels.runs.between import solve_between
from softmodels.runs.folder import begin
from softmodels.runs.gathering import gather
from softmodels.runs.recording import begin_branch
from softmodels.runs.requests import one_value
from softmodels.runs.states import InFolder, SolvedState, Source, state_of, write_states

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpi4py import MPI

Array = npt.NDArray[np.float64]

COLUMNS = {"pressure": ("pressure_Pa", 1.0), "volume": ("added_volume_ml", 1e-6), "stroke": ("stroke_ml", 1e-6),
           "step": ("load_step", 1.0)}  # fmt: skip
"""Where what can be requested stands in ``path.csv``, and the SI units in one of that column's."""
SAME = 1e-6
"""Values closer than this, relative, are one."""


@dataclasses.dataclass(frozen=True)
class Ended:
    """How a run ended: its exit status on a command line, and the sentence there; none if all was reached."""

    status: int = DONE
    message: str = ""
    error: RunError | None = dataclasses.field(default=None, compare=False)

    @classmethod
    def by(cls, error: RunError) -> Ended:
        return cls(error.status, written(error), error)


class StateIndexError(Spoken, IndexError):
    """A number that no state of a run has; the message is a sentence for the user."""


def _number(value: object, what: str, more: str = "") -> float:
    """A finite number, of numpy's too.

    Raises:
        CaseError: It is none.
    """
    try:
        return number(value.item() if isinstance(value, np.generic) else value)
    except UnitError as error:
        raise CaseError(f"{what}: {error}; give a finite number{more}") from None


class Run:
    """A device that was inflated. Made by `softmodels.inflate`, `softmodels.run` and `softmodels.load`.

    Beside the properties below, the rise in m of each of the device's probes has its name: ``run.apex`` of a disk,
    ``run.tip`` of a seminar slab, shape (states,).

    Attributes:
        case: What was run.
        branch: The branch that leaves the path at its first bifurcation, where that was asked for and there is one; else None.
    """

    def __init__(self, source: Source, ended: Ended, comm: MPI.Comm | None = None, branch: Run | None = None):
        self.case, self.branch = source.case, branch
        self._source, self._ended, self._comm = source, ended, comm
        self._solved: dict[tuple[str, float], SolvedState] = {}

    def __repr__(self) -> str:
        last = state_words(self.case).under(self.rows[-1], f"{self.rows[-1]['pressure_Pa']:.5g} Pa")
        states = "1 state" if len(self) == 1 else f"{len(self)} states"
        ended = "" if self.limit is None else f", ended at a {self.limit.kind}" if self.limit.found else ", lost"
        return f"<Run of {self.case.name}: {states} to {last}{ended}>"

    # -- the path as arrays -------------------------------------------------------------------------------------------

    @property
    def rows(self) -> list[Row]:
        """Rows of ``path.csv``, one for each state, with that file's units."""
        return list(self._source.rows)

    @property
    def path(self) -> dict[str, npt.NDArray[np.generic]]:
        """The table ``path.csv`` by column, with its names and units: ``pandas.DataFrame(run.path)`` takes it. Made anew each
        time it is asked for, so that it can be changed."""
        rows = self.rows
        return {name: np.array([row[name] for row in rows]) for name in rows[0]}

    @property
    def pressure(self) -> Array:
        """Pressure in Pa of each state; of a program the highest of the cavities'."""
        return self._column("pressure_Pa", 1.0)

    @property
    def added_volume(self) -> Array:
        """Volume in m3 that the cavity has taken in each state."""
        return self._column("added_volume_ml", 1e-6)

    @property
    def rise(self) -> Array:
        """Rise in m of the device's gauge, such as the disk's apex, in each state."""
        return self._column(f"{self.case.actuator.gauge}_mm", 1e-3)

    @property
    def largest_stretch(self) -> Array:
        """Largest principal stretch in each state."""
        return self._column("max_stretch", 1.0)

    def __getattr__(self, name: str) -> Array:
        if not name.startswith("_") and name in self.case.actuator.probes:
            return self._column(f"{name}_mm", 1e-3)
        raise AttributeError(f"a run has no {name!r}")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.case.actuator.probes]

    def _column(self, name: str, unit: float) -> Array:
        return np.array([float(row[name]) * unit for row in self.rows])

    # -- how it ended -------------------------------------------------------------------------------------------------

    @functools.cached_property
    def limit(self) -> Limit | None:
        """Where and why the path ends before the last requested value; None if it reaches it.

        Of kind ``"limit"`` (no equilibrium beyond: a limit point, a cavity pressed empty), ``"lost"`` or ``"stopped"``;
        ``why`` is the sentence of the command line, with arguments in place of its options.
        """
        status = self._ended.status
        if status == DONE:
            return None
        marks = [row for row in self.rows if row.get("stroke_limit")][-1:] if self.case.supply else []
        marks = marks or [row for row in self.rows if row["limit"]]
        row = marks[0] if status == NO_EQUILIBRIUM and marks else self.rows[-1]
        kind = {NO_EQUILIBRIUM: "limit", STOPPED: "stopped"}.get(status, "lost")
        return Limit(
            kind, row["pressure_Pa"], row["added_volume_ml"] * 1e-6,
            {name: row[f"{name}_mm"] * 1e-3 for name in self.case.actuator.probes}, row["max_stretch"],
            (row["max_stretch_x_mm"] * 1e-3, row["max_stretch_y_mm"] * 1e-3, row["max_stretch_z_mm"] * 1e-3),
            spoken(self._ended.message),
        )  # fmt: skip

    @functools.cached_property
    def sources(self) -> dict[str, Sequence[Row]]:
        """Rows of ``path.csv`` under each source of the silicone by name, from the softest to the stiffest, this run's own
        among them; empty unless the case's ``band`` is a silicone's."""
        return in_order(self.case, self.rows, self._source.others)

    @property
    def notes(self) -> list[str]:
        """What one must know before trusting the numbers: sentences, none if all is well."""
        return [spoken(note) for note in notes_of(self.case, self.rows, self.sources)]

    # -- its states ---------------------------------------------------------------------------------------------------

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, step: int) -> SolvedState:
        count = len(self)
        try:
            number = range(count)[operator.index(step)]
        except (TypeError, IndexError):
            wanted = f"a whole number from 0 to {count - 1}, or from the end, -1 to -{count}"
            # IndexError ends a loop over the states of a sequence.
            raise StateIndexError(f"the run has no state number {brief(step)}; it must be {wanted}") from None
        return state_of(self._source, number)

    def __iter__(self) -> Iterator[SolvedState]:
        return (self[step] for step in range(len(self)))

    @property
    def last(self) -> SolvedState:
        return self[-1]

    @checked
    def at(self, value: str | float) -> SolvedState:
        """The state at a value; of several, as on a cycle, the first of the requested ones.

        A value in between is solved for, starting from the states beside it (by all ranks, where there are several).

        Args:
            value: A pressure (``"70 cm"``, ``"7 kPa"``) or an added volume (``"40 ml"``, of a syringe its stroke); or a
                number in SI units of what was requested.

        Raises:
            CaseError: No such value.
            RunError: The path does not go there.
        """
        quantity, wanted = self._asked(value)
        column, unit = COLUMNS.get(quantity, (self.case.column, self.case.load.scale))
        there = self._column(column, unit)
        near = np.flatnonzero(np.abs(there - wanted) <= SAME * np.abs(there).max(initial=abs(wanted))).tolist()
        if near:
            asked = [k for k in near if self.rows[k]["requested"]]
            return self[asked[0] if asked else near[0]]
        if not there.min() < wanted < there.max() or quantity == "step":
            raise RunError(self._not_there(value, quantity, there))
        if (quantity, wanted) not in self._solved:
            self._solved[quantity, wanted] = solve_between(self._source, quantity, wanted, there)
        return dataclasses.replace(self._solved[quantity, wanted])  # with a grid of its own

    @checked
    def where(self, column: str, value: float) -> SolvedState:
        """The first state at which a figure of the path has a value, such as a plate its height; solved for, as by `at`.

        Args:
            column: Its column of ``path.csv``, such as ``"plate_z_mm"``, in whose unit the value is.
            value: The value.

        Raises:
            CaseError: No such column.
            RunError: The path has no such value.
        """
        first = self.rows[0]
        figures = [name for name in first if isinstance(first[name], float)]
        if column not in figures:
            raise CaseError(f"the path has no figure {brief(column)}; {known_are(column, figures)}")
        there, wanted = self._column(column, 1.0), _number(value, f"{column} of a state")
        if near := np.flatnonzero(np.abs(there - wanted) <= SAME * np.abs(there).max()).tolist():
            return self[near[0]]
        if self.case.program:
            raise RunError("the states of a program are not interpolated; ask for one by the number of its step")
        if not (low := np.nanmin(there)) < wanted < (high := np.nanmax(there)):
            why = f"; {self.limit.why}" if self.limit else ""
            raise RunError(f"the run has no state with {column} {wanted:g}: it goes from {low:.4g} to {high:.4g}{why}")
        if (column, wanted) not in self._solved:
            self._solved[column, wanted] = solve_between(self._source, column, wanted, there)
        return dataclasses.replace(self._solved[column, wanted])

    def _asked(self, value: str | float) -> tuple[str, float]:
        """What is asked for, and the value in SI units."""
        own = self.case.quantity
        if not isinstance(value, str):
            return own, _number(value, "the value of a state", ", or a text such as '70 cm' or '40 ml'")
        if own == "step":
            raise CaseError("a program's states are asked for by the number of the step, such as run.at(2)")
        if own not in COLUMNS:
            raise CaseError(
                f"the states of a run to {self.case.load.requested.words} are asked for by a number in SI units"
            )
        quantity, wanted = one_value(value, self.case.cm)
        return ("stroke" if quantity == "volume" and own == "stroke" else quantity), wanted

    def _not_there(self, value: str | float, quantity: str, there: Array) -> str:
        units = {"pressure": (self.case.cm, "cm"), "step": (1.0, "")}
        if quantity not in COLUMNS:
            units[quantity] = (self.case.load.scale, self.case.unit)
        scale, unit = units.get(quantity, (1e-6, "ml"))
        low, high = (f"{end / scale:.4g} {unit}".strip() for end in (there.min(), there.max()))
        why = f"; {self.limit.why}" if self.limit is not None else ""
        return f"the run has no state at {value}: its {quantity}s go from {low} to {high}{why}"

    # -- pictures and files -------------------------------------------------------------------------------------------

    def plot(self) -> Figure:
        """The rise of the device's gauge over the pressure, or over the steps of a program, as a matplotlib figure."""
        import matplotlib

        from softmodels.pictures import path_curves, program_curves
        from softmodels.pictures.style import STYLE

        words = state_words(self.case)
        with matplotlib.rc_context(STYLE):
            figure = (
                program_curves.steps(self.rows, words)
                if self.case.program
                else path_curves.rise(
                    self.rows, words.gauge, self.case.cm, (), path_curves.over_of(self.case), self.sources
                )
            )

        def png() -> bytes:
            data = io.BytesIO()
            with matplotlib.rc_context(STYLE):
                figure.savefig(data, format="png")
            return data.getvalue()

        figure._repr_png_ = png  # type: ignore[attr-defined]  # what a notebook shows
        return figure

    @checked
    def save(self, folder: str | Path) -> Path:
        """Write the folder that the command line writes: ``softmodels draw`` makes its pictures, `softmodels.load` reads it.

        Args:
            folder: Empty, not there, or an earlier run's, whose files are replaced.

        Returns:
            The folder.

        Raises:
            OwnFolderError, InUseError: The folder is somebody else's.
            RunError: It cannot be written.
        """
        output = place("folder", folder, "a folder")
        if isinstance(self._source, InFolder) and self._source.is_in(output):
            return output
        if self._comm is None:
            self._save(output)
        else:
            on_root(self._comm, lambda: self._save(output))
        return output

    def _save(self, folder: Path) -> None:
        results, _ = begin(self.case, folder, resume=False, draw=False)
        try:
            mesh = results.folder / f"{self.case.name}.msh"
            mesh.write_bytes(self._source.mesh())
            results.record(mesh=file_digest(mesh))
            write_states(self._source, results)
            if self.branch is not None:
                self.branch._save_branch(results)
            results.write_sources(self._source.others)
            notes = notes_of(self.case, self.rows, self.sources)
            gather(self.case, results, self._ended.status, self._ended.message, notes)
            results.own.forget_unwritten()
        finally:
            results.own.leave()

    def _save_branch(self, home: Results) -> None:
        """Write this branch into the folder of its run."""
        aside = begin_branch(home, self.case)
        write_states(self._source, aside)
        gather(self.case, aside, DONE, "", notes_of(self.case, self.rows))
