"""`Run`: the states of a run as arrays in SI units, and where and why its path ends."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import io
import itertools
import operator
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.case import case, entries, materials
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.common import cards, commands, errors, files, schema, units
from softmodels.common.arrays import Array
from softmodels.common.lazy import MPI, pyvista
from softmodels.common.names import checked, keep_arrays, one_of, place, read_only, several
from softmodels.common.processes import one_at_a_time
from softmodels.materials import laws, silicones
from softmodels.mechanics import mpi, newton
from softmodels.path.continuation import Continuation
from softmodels.path.steps import STROKE, one_step
from softmodels.runs import analyses, columns, formats, labels, notes, outcomes, recording, states, store
from softmodels.runs.analyses import Limit
from softmodels.runs.budget import Budget
from softmodels.runs.fields import OUTPUTS, OutputField, requestable
from softmodels.runs.simulation import MemoryStates, Simulation
from softmodels.runs.states import Line, StoredStates
from softmodels.runs.table import PathTable, Row

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

    from softmodels.api import views
    from softmodels.decks.reduction import ReducedModel
    from softmodels.path import stability


class Run(cards.ResultCard):
    """The states of an inflated device. Made by `softmodels.inflate`, `softmodels.run` and `softmodels.load`.

    Beside the properties below, each variable of the table is an array in SI over the states by its name: ``run.time``,
    ``run.stored_energy``, the rise of each of the device's probes (``run.apex`` of a disk, ``run.tip`` of a seminar slab).

    Attributes:
        case: What was run.
        branch: The branch that leaves the path at its first bifurcation, where that was asked for and there is one; else None.
    """

    def __init__(self, source: StoredStates, ended: outcomes.Ended, comm: MPI.Comm | None = None, branch: Run | None = None):
        self.case, self.branch = source.case, branch
        self._source, self._ended, self._comm = source, ended, comm
        self._solved: dict[tuple[str, float], SolvedState] = {}

    def _line(self) -> str:
        states = "1 state" if len(self) == 1 else f"{len(self)} states"
        ended = ""
        if self.limit is not None:
            marked = self.table["limit"].any() or self.table.get("stroke_limit").any()
            known = f"; ended at a {analyses.END_TEXTS[self.limit.kind]}" if marked else "; no equilibrium beyond"
            ended = known if self.limit.exists else "; lost"
        return f"of {self.case.name}: {states} to {headline(self.case, self.table[-1])}{ended}"

    def _figures(self) -> cards.Table:
        return [*ingredients(self.case), ("states", f"{len(self)}"), *state_figures(self.case, self.table[-1])]

    def _remarks(self) -> list[str]:
        return [*([self.limit.why] if self.limit else []), *self.notes]

    # -- the path as arrays -------------------------------------------------------------------------------------------

    @property
    def table(self) -> PathTable:
        """All variables in SI: ``run.table["apex"]`` is an array over the states, ``run.table[-1]`` a state."""
        return self._source.rows

    @property
    def rows(self) -> list[dict[str, float]]:
        """Rows of ``path.csv``, one for each state, with its columns and units; NaN where a number is not known."""
        return [row.written for row in self.table]

    @property
    def path(self) -> dict[str, npt.NDArray[np.generic]]:
        """The table ``path.csv`` by column, with its names and units: ``pandas.DataFrame(run.path)`` takes it. A new copy
        at each call, so it may be changed."""
        return {name: np.array([row.cell(name) for row in self.table]) for name in self.table.columns}

    @property
    def pressure(self) -> Array:
        """Pressure in Pa of each state; of a program the highest of the cavities'."""
        return self._array("pressure")

    @property
    def added_volume(self) -> Array:
        """Volume in m3 that the cavity has taken in each state."""
        return self._array("added_volume")

    @property
    def rise(self) -> Array:
        """Rise in m of the device's gauge, such as the disk's apex, in each state."""
        return self._array(self.case.actuator.gauge)

    @property
    def largest_stretch(self) -> Array:
        """Largest principal stretch in each state."""
        return self._array("max_stretch")

    def __getattr__(self, name: str) -> Array:
        if not name.startswith("_") and name in self.table:
            return self._array(name)
        raise AttributeError(f"a run has no {name!r}")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.table.names]

    def _array(self, name: str) -> Array:
        values = self.table[name]
        return values if values.dtype.kind == "U" else values.astype(float)

    # -- how it ended -------------------------------------------------------------------------------------------------

    @functools.cached_property
    def limit(self) -> Limit | None:
        """Place and cause of the path's end before the last requested value; None if it reaches it.

        Of kind ``"limit"`` (no equilibrium beyond: a limit point, a cavity pressed empty), ``"lost"`` or ``"stopped"``;
        ``why`` is the sentence of the command line, with arguments instead of its options.
        """
        status = self._ended.status
        if status == commands.EXIT_DONE:
            return None
        marks = self.table.where("stroke_limit")[-1:] if self.case.supply else ()
        marks = marks or self.table.where("limit")
        row = marks[0] if status == commands.EXIT_NO_EQUILIBRIUM and marks else self.table[-1]
        kind = {commands.EXIT_NO_EQUILIBRIUM: "limit", commands.EXIT_STOPPED: "stopped"}.get(status, "lost")
        return Limit(
            kind, row["pressure"], row["added_volume"], {name: row[name] for name in self.case.actuator.probes},
            row["max_stretch"], (row["max_stretch_x"], row["max_stretch_y"], row["max_stretch_z"]),
            errors.spoken(self._ended.message), path=tuple(zip(self.added_volume.tolist(), self.pressure.tolist(),
            strict=True)),
        )  # fmt: skip

    @functools.cached_property
    def sources(self) -> dict[str, list[dict[str, float]]]:
        """Rows of ``path.csv`` under each source of the silicone by name, from the softest to the stiffest, this run's own
        among them; empty unless the case's ``band`` is a silicone's."""
        return {name: [row.written for row in table] for name, table in self._source.sources.items()}

    @functools.cached_property
    def mesh_errors(self) -> dict[str, float]:
        """Half widths of the 95 % intervals due to the mesh, in SI by variable (such as ``"apex"``), of the last requested
        state that the path with smaller cells reaches too; empty unless the case has ``mesh_error``."""
        return self.budget.mesh.last[1]

    @property
    def budget(self) -> Budget:
        """What is known of the errors of the run's numbers, by their causes: ``run.budget.lines()`` says it."""
        return self._source.budget

    @property
    def notes(self) -> list[str]:
        """Warnings on the run's validity, as sentences; empty if there are none."""
        texts = [*self._source.mesh_notes, *notes.notes_of(self.budget)]
        return [errors.spoken(note) for note in texts]

    # -- its states ---------------------------------------------------------------------------------------------------

    def __len__(self) -> int:
        return len(self.table)

    @one_at_a_time
    def __getitem__(self, step: int) -> SolvedState:
        count = len(self)
        try:
            number = range(count)[operator.index(step)]
        except (TypeError, IndexError):
            wanted = f"a whole number from 0 to {count - 1}, or from the end, -1 to -{count}"
            # IndexError ends a loop over the states of a sequence.
            raise StateIndexError(f"the run has no state number {units.brief(step)}; it must be {wanted}") from None
        return state_of(self._source, number)

    def __iter__(self) -> Iterator[SolvedState]:
        return (self[step] for step in range(len(self)))

    @property
    def last(self) -> SolvedState:
        return self[-1]

    @checked
    @one_at_a_time
    def at(self, value: str | float) -> SolvedState:
        """Return the state at a value; of several, as under loading and unloading, the first requested one.

        A value in between is solved for, starting from the states beside it (by all ranks, where there are several).

        Args:
            value: A pressure (``"70 cm"``, ``"7 kPa"``) or an added volume (``"40 ml"``, of a syringe its stroke); or a
                number in SI units of what was requested.

        Raises:
            CaseError: No such value.
            RunError: The path does not go there.
        """
        quantity, wanted = self._asked(value)
        there = self._array(VARIABLES.get(quantity, self.case.variable))
        near = np.flatnonzero(np.abs(there - wanted) <= SAME_VALUE_TOLERANCE * np.abs(there).max(initial=abs(wanted))).tolist()
        if near:
            asked = [k for k in near if self.table[k]["requested"]]
            return self[asked[0] if asked else near[0]]
        if not there.min() < wanted < there.max() or quantity == "step":
            raise outcomes.RunError(self._not_there(value, quantity, there))
        if (quantity, wanted) not in self._solved:
            self._solved[quantity, wanted] = solve_between(self._source, quantity, wanted, there)
        return dataclasses.replace(self._solved[quantity, wanted])  # with a grid of its own

    @checked
    @one_at_a_time
    def where(self, column: str, value: float) -> SolvedState:
        """Return the first state at which a column of the path has a value, such as a plate's height; solved for as by `at`.

        Args:
            column: Its column of ``path.csv``, such as ``"plate_z_mm"``, in whose unit the value is.
            value: The value.

        Raises:
            CaseError: No such column.
            RunError: The path has no such value.
        """
        figures = [name for name, value in self.rows[0].items() if isinstance(value, float)]
        if column not in figures:
            raise CaseError(f"the path has no column {units.brief(column)}; {errors.known_are(column, figures)}")
        there, wanted = self.path[column].astype(float), _number(value, f"{column} of a state")
        if near := np.flatnonzero(np.abs(there - wanted) <= SAME_VALUE_TOLERANCE * np.abs(there).max()).tolist():
            return self[near[0]]
        if self.case.program:
            raise outcomes.RunError("states of a program are not interpolated; request one by its step number")
        if not (low := np.nanmin(there)) < wanted < (high := np.nanmax(there)):
            why = f"; {self.limit.why}" if self.limit else ""
            raise outcomes.RunError(f"the run has no state with {column} {wanted:g}: it goes from {low:.4g} to {high:.4g}{why}")
        if (column, wanted) not in self._solved:
            self._solved[column, wanted] = solve_between(self._source, column, wanted, there)
        return dataclasses.replace(self._solved[column, wanted])

    def _asked(self, value: str | float) -> tuple[str, float]:
        """Return the requested quantity and its value in SI units."""
        own = self.case.quantity
        if not isinstance(value, str):
            return own, _number(value, "the value of a state", ", or a text such as '70 cm' or '40 ml'")
        if own == "step":
            raise CaseError("states of a program are requested by step number, such as run.at(2)")
        if own not in VARIABLES:
            raise CaseError(f"the states of a run to {self.case.load.requested.words} are requested by a number in SI units")
        quantity, wanted = case.one_value(value, self.case.column.pascal)
        return ("stroke" if quantity == "volume" and own == "stroke" else quantity), wanted

    def _not_there(self, value: str | float, quantity: str, there: Array) -> str:
        if quantity == self.case.quantity:
            low, high = self.case.load.told(there.min()), self.case.load.told(there.max())
        else:
            told = self.case.column.text if quantity == "pressure" else lambda end: f"{end * 1e6:.4g} ml"
            low, high = told(there.min()), told(there.max())
        why = f"; {self.limit.why}" if self.limit is not None else ""
        return f"the run has no state at {value}: its {quantity}s go from {low} to {high}{why}"

    # -- tables of other libraries ------------------------------------------------------------------------------------

    def to_dataframe(self) -> pandas.DataFrame:
        """Return the table ``path.csv`` as a pandas DataFrame, with its columns and units.

        ``frame.attrs["units"]`` has the unit of each column, ``frame.attrs["long_name"]`` its name in words.

        Raises:
            ImportError: pandas is not installed.
        """
        frame: pandas.DataFrame = errors.required("pandas", "notebook").DataFrame(self.path)
        texts = {column: self._texts(column) for column in frame.columns}
        frame.attrs = {name: {column: text[name] for column, text in texts.items()} for name in ("units", "long_name")}
        return frame

    def _texts(self, column: str) -> dict[str, str]:
        """Return the unit and the name in words of a column of ``path.csv``."""
        known = columns.term(column, self.case.actuator, labels.state_labels(self.case).driver)
        return {"units": known.unit, "long_name": known.name}

    @checked
    def to_xarray(self, fields: str | Sequence[str] = ()) -> xarray.Dataset:
        """Return the path as an xarray Dataset over the states, with ``units`` and ``long_name`` of each variable.

        Coordinates are the step, the pressure and, with fields, the undeformed places of the nodes.

        Args:
            fields: Nodal fields to read too, such as ``"displacement"`` or ``["displacement", "von_mises"]``, over
                (step, node) or (step, node, component). A mode is nan in states without one.

        Raises:
            ImportError: xarray is not installed.
            CaseError: No such field.
            ResultsError: The states of a folder can no longer be read.
        """
        library = errors.required("xarray", "notebook")
        wanted = several("fields", fields, str, "the name of a nodal field")
        bifurcations = np.flatnonzero(self.table.get("bifurcation")).tolist()
        known = {name for step in (0, *bifurcations) for name in self._source.fields(step)} if wanted else set()
        for name in wanted:
            if name not in known:
                more = f", and those that a run is asked for, as by fields=[{name!r}]" if name in requestable() else ""
                raise CaseError(f"the run has no field {units.brief(name)}; {errors.known_are(name, sorted(known), more)}")
        columns = {name: ("step", values, self._texts(name)) for name, values in self.path.items()}
        places: dict[str, object] = {"step": columns.pop("step"), "pressure": columns.pop("pressure_Pa")}
        nodal = {}
        for name in wanted:
            output = OUTPUTS.get(name)
            told, axes = {"long_name": name}, tuple[str, ...](("component",))
            if isinstance(output, OutputField):
                told, axes = {"units": output.unit, "long_name": output.title}, output.axes
            values = self._over_steps(name)
            nodal[name] = (("step", "node", *axes)[: values.ndim], values, told)
        places |= self._axes if wanted else {}
        dataset: xarray.Dataset = library.Dataset({**columns, **nodal}, coords=places, attrs={"case": self.case.name})
        return dataset

    @property
    def _axes(self) -> dict[str, object]:
        """Coordinates of nodal fields in datasets."""
        section = " of a section: x radial, y hoop" if self.case.actuator.dimension == 2 else ""
        direction = {"long_name": f"direction in device coordinates{section}"}
        principal = {"long_name": "number of the principal value, the largest first"}
        return {
            **{axis: ("node", self._source.points[:, k], {"units": "m", "long_name": f"{axis}, place of the node, undeformed"})
               for k, axis in enumerate("xyz")},
            **{axis: (axis, np.array([*"xyz"]), direction) for axis in ("component", "component2")},
            "principal": ("principal", np.arange(1, 4), principal),
        }  # fmt: skip

    def _over_steps(self, name: str) -> Array:
        """Return a nodal field of all states, shape (states, n, ...); nan in states without it."""
        kept = {}
        for step in range(len(self)):
            with contextlib.suppress(KeyError):
                kept[step] = self._source.field(step, name)
        stacked = np.full((len(self), *next(iter(kept.values())).shape), np.nan)
        for step, values in kept.items():
            stacked[step] = values
        return stacked

    # -- pictures and files -------------------------------------------------------------------------------------------

    @property
    def _states(self) -> StoredStates:
        """The states as pictures take them."""
        self._source.branch = PathTable() if self.branch is None else self.branch.table
        return self._source

    @checked
    @one_at_a_time
    def show(self, state: SolvedState | int | str | None = None, field: str = "von_mises") -> object:
        """Show the deformed device in space, coloured by a field: in a notebook, in a window, or as a picture.

        A notebook shows it by PyVista's own backend: to be turned and zoomed where trame is installed, else as a picture. A
        section is shown revolved, a slice as the whole device, both without a quarter.

        Args:
            state: The state, its number, or a value that `at` takes, such as ``"70 cm"``; None for the last one.
            field: ``"von_mises"`` or ``"largest_stretch"``, or an own field with colours.

        Returns:
            What a notebook shows, or the file of the picture where there is neither a notebook nor a display. Else None.

        Raises:
            CaseError: No such state or field.
            RunError: The path does not go there, or this machine cannot render.
        """
        if state is None:
            chosen = self.last
        elif isinstance(state, SolvedState):
            chosen = state
        else:
            chosen = self.at(state) if isinstance(state, str) else self[state]
        return chosen.show(field)

    @checked
    @one_at_a_time
    def animate(self, path: str | Path | None = None) -> views.Animation:
        """Return the film of the run: the deformed device from the first state to the last, coloured by von Mises stress.

        Args:
            path: File to write it to, ``.gif``, ``.webp`` or ``.mp4``; an earlier one is replaced. None for no file.

        Returns:
            The film, which a notebook plays; ``film.save("disk.gif")`` writes it.

        Raises:
            CaseError: Another ending.
            ImportError: MP4 without imageio-ffmpeg.
            RunError: This machine cannot render.
        """
        from softmodels.api.views import animate

        film = animate(self._states)
        if path is not None:
            film.save(path)
        return film

    @one_at_a_time
    def plot(self) -> Figure:
        """Return the rise of the device's gauge over the pressure, or over the steps of a program, as a matplotlib figure."""
        import matplotlib

        from softmodels.pictures import curves, style

        words = labels.state_labels(self.case)
        with matplotlib.rc_context(style.STYLE):
            figure = (
                curves.steps(self.table, words)
                if self.case.program
                else curves.rise(self.table, words, self.case.column, None, curves.over_of(self.case), self._source.sources)
            )

        def png() -> bytes:
            data = io.BytesIO()
            with matplotlib.rc_context(style.STYLE):
                figure.savefig(data, format="png")
            return data.getvalue()

        figure._repr_png_ = png  # type: ignore[attr-defined]  # shown by notebooks
        return figure

    @checked
    @one_at_a_time
    def save(self, folder: str | Path) -> Path:
        """Write the same folder as the command line: ``softmodels draw`` makes its pictures, `softmodels.load` reads it.

        Args:
            folder: Empty, not there, or an earlier run's, whose files are replaced.

        Returns:
            The folder.

        Raises:
            OwnFolderError, InUseError: The folder is somebody else's.
            RunError: It cannot be written.
        """
        output = place("folder", folder, "a folder")
        if isinstance(self._source, states.FolderStates) and files.is_same(self._source.folder, output):
            return output
        if self._comm is None:
            self._save(output)
        else:
            mpi.on_root(self._comm, lambda: self._save(output))
        return output

    @checked
    @one_at_a_time
    def reduce(
        self,
        file: str | Path | None = None,
        *,
        kind: str = "",
        face: str = "",
        fingers: int = 1,
        radius: float | str | None = None,
    ) -> ReducedModel:
        """Reduce the device to its tip: pose, volume, compliance and their derivatives over the pressure.

        Every state of the first rising piece of the path, or of the grid of pressures that a program of several cavities has
        visited (see `grid`), is solved again with exact linear responses, on one process.

        Args:
            file: File to write it to: ``.csv``, ``.json``, ``.xml`` (MuJoCo), ``.fmu``; None for no file.
            kind: What the file is, if its ending does not tell: ``"csv"``, ``"json"``, ``"mjcf"``, ``"fmu"``.
            face: The face that is the tip; the device's own if empty.
            fingers: How many such devices stand on a wrist, with pressures of their own, in a model for MuJoCo; 1 for the
                device alone.
            radius: Of the circle on which several stand, m or a text such as ``"30 mm"``.

        Raises:
            CaseError: A run over something else than pressures at rest, no such face, kind or ending, or fingers that would
                stand in each other.
            RunError: Too few states, or no such model.
        """
        from softmodels.decks import chains, hand, reduction

        path = None if file is None else place("file", file, "a file")
        one_of("kind", kind, str, "a text such as 'mjcf'")
        one_of("face", face, str, "the name of a face")
        one_of("fingers", fingers, int, "a whole number")
        several = None if fingers == 1 and radius is None else hand.Hand(fingers, radius or 0.0)  # type: ignore[arg-type]
        if several is not None:
            hand.check(path, kind)
        if path is not None:
            chains.kind_of(path, kind)
        made = reduction.table_of(self._source, face)
        if path is not None:
            several.write(made, path) if several is not None else chains.write(made, path, kind)
        return made

    @checked
    @one_at_a_time
    def grid(self, count: int = 5) -> Case:
        """Return the case with a program over a grid of each cavity's pressure, from 0 to this run's; its run is reduced to a
        model over all of them: ``model = sm.run(run.grid()).reduce()``, ``model(5e3, 0, 2e3)``.

        Args:
            count: Pressures of each cavity, at least three.

        Raises:
            CaseError: A run in time or of other loads, a device of one cavity, or a cavity that the run leaves at 0.
        """
        from softmodels.decks import reduction

        return reduction.grid_case(self._source, one_of("count", count, int, "a whole number"))

    def _save(self, folder: Path) -> None:
        results, _ = recording.begin(self.case, recording.ResultsPlace(folder))
        try:
            mesh = results.folder / f"{self.case.name}.msh"
            mesh.write_bytes(self._source.mesh())
            results.record(mesh=files.file_digest(mesh), mesh_notes=list(self._source.mesh_notes))
            write_states(self._source, results)
            if self.branch is not None:
                self.branch._save_branch(results)
            results.write_beside(self._source.others, self._source.meshes)
            recording.gather(self.case, results, self._ended)
            results.own.forget_unwritten()
        finally:
            results.own.leave()

    def _save_branch(self, home: store.Results) -> None:
        """Write this branch into the folder of its run."""
        aside = recording.begin_branch(home, self.case)
        write_states(self._source, aside)
        recording.gather(self.case, aside, outcomes.Ended())


VARIABLES = {"pressure": "pressure", "volume": "added_volume", "stroke": "stroke", "step": "load_step"}
"""Variable of the table of each requestable quantity."""
SAME_VALUE_TOLERANCE = 1e-6
"""Relative distance below which two values are the same."""


class StateIndexError(errors.OptionMessage, IndexError):
    """No state of a run has this number; the message is for the user."""


def _number(value: object, what: str, more: str = "") -> float:
    """Return a finite number; else `CaseError`."""
    try:
        return units.number(value)
    except units.UnitError as error:
        raise CaseError(f"{what}: {error}; give a finite number{more}") from None


def headline(case: Case, row: Row) -> str:
    """Return the load of a state, and its main figures, in a line."""
    words = labels.state_labels(case)
    volume = f", added volume {row.told('added_volume')}" if words.volume else ""
    return (
        f"{words.under(row, _pressure(row, words))}: {words.gauge} rise {row.told(words.gauge)}{volume}, "
        f"largest stretch {row['max_stretch']:.4g}"
    )


def ingredients(case: Case) -> cards.Table:
    """Return the device with the lengths that are not its usual ones, the silicone with its parameters, and the components."""
    device, texts = case.actuator, schema.to_table(case.actuator, units.readable)
    changed = [
        f"{field.name} {texts[field.name]}"
        for field in dataclasses.fields(device)
        if field.name in texts and getattr(device, field.name) != field.default
    ]
    table = materials.to_table(case.material, units.readable)
    law = [f"{field.name} {table[field.name]}" for field in laws.parameter_fields(case.material)]
    law += [] if case.material.memory is None else ["with a memory"]
    components = [type(component).__name__ for component in case.components]
    return [
        ("device", ": ".join(filter(None, [type(device).__name__, ", ".join(changed)]))),
        ("silicone", silicones.named(case.material) or ", ".join([case.material.name, *law])),
        *([("components", ", ".join(components))] if components else []),
    ]


def _pressure(row: Row, words: labels.StateLabels) -> str:
    return f"{row['pressure'] / 1e3:.4g} kPa ({row.shown('pressure'):.4g} {words.unit})"


def state_figures(case: Case, row: Row) -> cards.Table:
    """Return the main figures of a state, with their units and 95 % bands."""
    words = labels.state_labels(case)
    names = [
        *(name for name in ("time", "load_step", "stroke") if name in row), *words.volumes(row), *words.loads_in(row),
        *case.actuator.probes, "max_stretch", "max_von_mises", "stored_energy",
    ]  # fmt: skip
    table = [("pressure", _pressure(row, words))] if words.pressure else []
    for name in names:
        known = columns.term(row.column(name), case.actuator, words.driver)
        table.append((known.name, row.told_with_error(name)))
    return table


# ----------------------------------------------------------------------------------------------------------------------
# The states of a run, in memory or in a folder, and `SolvedState` as the user's view of one.


type Place = str | Sequence[float] | Array
"""A place in the undeformed device: a text with its unit, the name of a probe or point, or three numbers in m."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class SolvedState(cards.ResultCard):
    """One state of a run, SI units. Its arrays are read-only; ``state.displacement.copy()`` can be changed.

    Attributes:
        case: What was run.
        variables: The variables of the table in SI by name, such as ``state.variables["apex"]``.
        points: Undeformed nodes in device coordinates, m, shape (n, 3); of a section (r, 0, z).
        cells: Node numbers of the second-order cells in VTK's order, shape (c, 6 or 10).
        cell_name: ``"Triangle_6"`` or ``"Tetrahedron_10"``.
        fields: Nodal fields by name: ``displacement``, ``p``, ``von_mises``, ``largest_stretch``, ``J``, those that the run
            was asked for and, at a bifurcation, its ``mode``.
    """

    case: Case
    variables: Row
    points: Array
    cells: npt.NDArray[np.int64]
    cell_name: str
    fields: Mapping[str, Array]
    _mesh: Callable[[], bytes] = bytes

    def _line(self) -> str:
        return f"of {self.case.name} at {headline(self.case, self.variables)}"

    def _figures(self) -> cards.Table:
        return state_figures(self.case, self.variables)

    def _remarks(self) -> list[str]:
        return [text] if (text := labels.overlap_text(self.variables)) else []

    def __post_init__(self) -> None:
        # The arrays belong to the run: `Run.at` and `Run.save` use them.
        keep_arrays(self)
        fields = {name: read_only(values) for name, values in self.fields.items()}
        object.__setattr__(self, "fields", MappingProxyType(fields))

    @property
    def row(self) -> dict[str, float]:
        """Its row of ``path.csv``, with that file's columns and units; NaN where a number is not known."""
        return self.variables.written

    @property
    def pressure(self) -> float:
        """Pressure in Pa; of a program the highest."""
        return float(self.variables["pressure"])

    @property
    def added_volume(self) -> float:
        """Added volume in m3."""
        return float(self.variables["added_volume"])

    @property
    def displacement(self) -> Array:
        """Displacement in m, in device coordinates, shape (n, 3)."""
        return self.fields["displacement"]

    @property
    def von_mises(self) -> Array:
        """Von Mises stress in Pa, shape (n,)."""
        return self.fields["von_mises"]

    @property
    def largest_stretch(self) -> Array:
        """Largest principal stretch, shape (n,)."""
        return self.fields["largest_stretch"]

    @property
    def J(self) -> Array:
        """Ratio of the silicone's volume to that at rest, shape (n,)."""
        return self.fields["J"]

    @property
    def p(self) -> Array:
        """Pressure-like unknown in Pa, shape (n,)."""
        return self.fields["p"]

    @property
    def deformation_gradient(self) -> Array:
        """Deformation gradient F in device coordinates, shape (n, 3, 3); of a section x is radial and y the hoop."""
        return self._tensor("deformation_gradient")

    @property
    def green_lagrange_strain(self) -> Array:
        """Green-Lagrange strain (F^T F - I)/2, shape (n, 3, 3)."""
        return self._tensor("green_lagrange_strain")

    @property
    def cauchy_stress(self) -> Array:
        """Cauchy stress in Pa, shape (n, 3, 3): of the silicone, without fibres in its place."""
        return self._tensor("cauchy_stress")

    @property
    def nominal_stress(self) -> Array:
        """First Piola-Kirchhoff stress in Pa, force per undeformed area, shape (n, 3, 3)."""
        return self._tensor("nominal_stress")

    @property
    def principal_stresses(self) -> Array:
        """Principal Cauchy stresses in Pa, the largest first, shape (n, 3)."""
        return self._tensor("principal_stresses")

    @property
    def principal_stress_directions(self) -> Array:
        """Unit vectors of the principal stresses, in the rows, shape (n, 3, 3)."""
        return self._tensor("principal_stress_directions")

    @property
    def principal_stretches(self) -> Array:
        """Principal stretches, the largest first, shape (n, 3)."""
        return self._tensor("principal_stretches")

    @property
    def principal_stretch_directions(self) -> Array:
        """Unit vectors, undeformed, of the principal stretches, in the rows, shape (n, 3, 3)."""
        return self._tensor("principal_stretch_directions")

    def _tensor(self, name: str) -> Array:
        """Return a field that may have to be computed; `RunError` if it depends on the states before, and was not stored."""
        if name not in self.fields and name not in self._computed_fields:
            raise outcomes.RunError(
                f"{name} of a silicone with a memory depends on the states before and is not stored; run again with "
                f"fields=[{name!r}]"
            )
        return self.fields[name] if name in self.fields else self._computed_fields[name]

    @functools.cached_property
    def _computed_fields(self) -> Mapping[str, Array]:
        """The fields that follow from displacement and p, those that the run did not store computed."""
        past = self.case.timed and self.case.remembers
        missing = [name for name in requestable() if name not in self.fields and not (past and "stress" in name)]
        return _computed(self, missing, self._mesh) if missing else {}

    @checked
    @one_at_a_time
    def along(self, begin: Place, end: Place, points: int = states.LINE_POINTS) -> Line:
        """Return the values along a straight line of the undeformed device, which moves with it.

        Args:
            begin: Place in device coordinates: a text such as ``"0, 0, 10 mm"``, the name of a probe or a named point, or
                three numbers in m. It need not lie in the modelled slice.
            end: The line's other end.
            points: How many values.

        Raises:
            CaseError: No such places, or the line does not meet the silicone.
            RunError: The tensors of a silicone with a memory were not stored.
        """
        return self._probe.line((self._place("begin", begin), self._place("end", end)), self._everything, points)

    @checked
    @one_at_a_time
    def through(self, point: Place, points: int = states.LINE_POINTS) -> Line:
        """Return the values straight through the wall at the surface point nearest to a place, see `along`."""
        return self._probe.line(self._probe.through(self._place("point", point)), self._everything, points)

    @property
    def _everything(self) -> Mapping[str, Array]:
        return {**self._computed_fields, **self.fields, "cauchy_stress": self._tensor("cauchy_stress")}

    @functools.cached_property
    def _probe(self) -> states.Probe:
        return states.Probe(self.case.actuator, (self.points, self.cells, self.cell_name))

    def _place(self, name: str, given: Place) -> Array:
        known = {**self.case.actuator.probes, **self.case.gauges.places}
        if not isinstance(given, str):
            if not isinstance(given, list | tuple | np.ndarray):
                raise CaseError(
                    f"{name} is {units.brief(given)}; a place is a text such as '0, 0, 10 mm', a probe's name, or "
                    "three numbers in m"
                )
            place = np.array([_number(value, name) for value in given])
            if place.shape != (3,):
                raise CaseError(f"{name} has {len(place)} numbers; a place has three, x, y and z in m")
            return place
        if given in known:
            return np.asarray(known[given])
        if re.fullmatch(entries.NAME, given):
            raise CaseError(f"{name}: the device has no point {units.brief(given)}; {errors.known_are(given, known)}")
        try:
            return np.asarray(entries.place_of(name, given))
        except entries.ProbeError as error:
            raise CaseError(str(error)) from None

    @property
    def mode(self) -> Array | None:
        """Buckling mode at a bifurcation, shape (n, 3); None in any other state."""
        return self.fields.get("mode")

    @functools.cached_property
    def grid(self) -> pyvista.UnstructuredGrid:
        """The undeformed device as a `pyvista.UnstructuredGrid` with the fields; ``grid.warp_by_vector("displacement")``
        moves it."""
        # Copies, because VTK writes into its inputs and users may change a grid.
        grid = pyvista.UnstructuredGrid({formats.CELL_TYPES[self.cell_name]: self.cells.copy()}, self.points.copy())
        for name, values in self.fields.items():
            grid.point_data[name] = values.reshape(-1, formats.TENSOR_COMPONENTS).copy() if values.ndim == 3 else values.copy()
        return grid

    @checked
    @one_at_a_time
    def show(self, field: str = "von_mises") -> object:
        """Show the deformed device in space, coloured by a field; see `Run.show`."""
        from softmodels.api.views import show

        return show(self._states, field)

    @property
    def _states(self) -> StoredStates:
        """This state as pictures take it."""
        grid = self.points, self.cells, self.cell_name
        return StoredStates(self.case, [self.variables], grid, lambda step, name: self._tensor(name))


def state_of(source: StoredStates, step: int) -> SolvedState:
    """Return one of a source's states."""
    return SolvedState(
        source.case, source.rows[step], source.points, source.cells, source.cell_name, source.fields(step), source.mesh
    )


def _computed(state: SolvedState, names: Sequence[str], mesh: Callable[[], bytes]) -> Mapping[str, Array]:
    """Return fields of a state from its displacement and p, on the run's own mesh; all ranks call it."""
    comm, case = mpi.start(), state.case
    simulation = Simulation(dataclasses.replace(case, fields=tuple(names)), comm)
    try:
        simulation.prepare_on(mesh)
        with notes.sentences():
            fields = simulation.fields
            nodal = fields.nodal(fields.state(state.fields if mpi.is_root(comm) else None, 0.0, 0.0))
            computed = mpi.on_root(comm, lambda: nodal or {})
            return {name: read_only(computed[name]) for name in names}
    finally:
        simulation.release()


def write_states(source: StoredStates, results: store.Results) -> None:
    """Store all states of a source in a prepared folder."""
    results.begin(source.points, source.cells, source.cell_name)
    for step, row in enumerate(source.rows):
        results.add(formats.StateRecord(row, source.fields(step), source.restart(step)))


# ----------------------------------------------------------------------------------------------------------------------
# States between two stored states of a run, solved on the run's own mesh.


def solve_between(source: StoredStates, quantity: str, wanted: float, values: Array) -> SolvedState:
    """Solve for the first state of a run's path at a value; all ranks call it. `RunError` if it was not found.

    The two stored states beside it are what Newton's method starts from, so nothing before them is solved again. Where there
    are no such two, as under a cycle that jumps over the value, the path is followed from rest. The quantity is
    ``"pressure"``, ``"volume"`` or ``"stroke"`` in SI units, or a column of ``path.csv`` in its own; ``values`` are those of
    the stored states, shape (states,).
    """
    comm, ends = mpi.start(), _bracket(source, values, wanted)
    if ends is None and quantity in source.rows.columns:
        raise outcomes.RunError(f"no two neighbouring states on one continuous piece of the path bracket {quantity} {wanted:g}")
    case = source.case if ends else _to_one(source.case, quantity, wanted)
    simulation = Simulation(case, comm)
    try:
        simulation.prepare_on(source.mesh)
        with notes.sentences():
            states = MemoryStates(simulation, source.mesh)
            for step in [_between(simulation, source, ends, (quantity, wanted))] if ends else simulation.steps():
                states.add(step)
    finally:
        simulation.release()
    return state_of(states, len(states.rows) - 1)


def _bracket(source: StoredStates, values: Array, wanted: float) -> tuple[int, int] | None:
    """Return the first two neighbouring solved states on one continuous piece of the path that bracket a value."""
    # A bifurcation is interpolated, and snap-through leaves no path between its two ends.
    solved = np.flatnonzero(source.rows["bifurcation"] == 0).tolist()
    for before, after in itertools.pairwise(solved):
        low, high = sorted(values[[before, after]])
        if low < wanted < high and not source.rows[after]["jump"]:
            return before, after
    if not source.rows["jump"].any():  # as on a branch
        raise outcomes.RunError("no two neighbouring states of the branch bracket this value")
    return None


def _between(
    simulation: Simulation, source: StoredStates, ends: tuple[int, int], asked: tuple[str, float]
) -> formats.StateRecord:
    """Return the state at a value between two steps of a run."""
    fields, comm, (quantity, wanted) = simulation.fields, simulation.comm, asked
    passed = np.flatnonzero(source.rows["bifurcation"][: ends[0]]).tolist()
    *points, after = (
        recording.stored_point(source, fields, comm, step, source.restart(step), step in passed) for step in (*passed, *ends)
    )
    followed = source.case.quantity if quantity in source.rows.columns else quantity
    path = Continuation(simulation.solver, simulation.quantity(followed), start=simulation.model.path_start())
    solved = dict.fromkeys((step for step in range(ends[0] + 1) if step not in passed), 0.0)
    replay = functools.partial(recording.replay, source, fields, comm, solved)
    try:
        path.resume(points, replay)
        tangent = path.corrector.tangent(after.state)
        before, after = path.last, dataclasses.replace(after, tangent=tangent)
        if quantity in source.rows.columns:
            state = path.corrector.root(before, after, lambda point: _figure(simulation, point, quantity) - wanted)
            reached = path.corrector.point(state, requested=True)
        else:
            reached = path.between(before, after, wanted / simulation.model.unit_of(quantity))
        path.commit(reached)
    except newton.NoConvergence as failure:
        raise outcomes.RunError(f"no converged state between steps {ends[0]} and {ends[1]} ({failure})") from failure
    return simulation.step_of(reached, ends[0])


def _figure(simulation: Simulation, point: stability.Point, column: str) -> float:
    """Return the value of a column of ``path.csv`` at a point, on all ranks."""
    return simulation.step_of(point, 0).row.cell(column)


def _to_one(case: Case, quantity: str, wanted: float) -> Case:
    """Return a case that ends at one value."""
    if case.load.driven is not None:
        last = dataclasses.replace(case.load.driven, values=(wanted,))
        steps = (*case.steps[:-1], dataclasses.replace(case.steps[-1], prescribed=(last,)))
    else:
        steps = one_step(quantity, [wanted])
    supply = case.supply if quantity == STROKE else None
    return dataclasses.replace(case, steps=steps, load_unload=False, control="auto", supply=supply)
