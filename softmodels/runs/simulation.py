"""Solve a device: mesh it, compile its equations, find single equilibria, or follow the path of a case state by state."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import itertools
import math
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import NoneType
from typing import ClassVar

import numpy as np

from geometries import Actuator, GeometryError, MeshingError, MeshingStopped, meshing
from softmodels.case import load, materials
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.common import cards, commands, errors, names, units
from softmodels.common.arrays import Array
from softmodels.common.lazy import MPI, PETSc, fem
from softmodels.common.processes import one_at_a_time
from softmodels.components import loads
from softmodels.materials import specimens
from softmodels.materials.laws import Material
from softmodels.materials.memory import Memory
from softmodels.mechanics import assembly, compiling, controls, memory, mpi, newton, regions
from softmodels.mechanics.body import Body, BodyError
from softmodels.mechanics.component import Component
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State, System
from softmodels.path import continuation, schedule, stability, steps, supply
from softmodels.path.continuation import Continuation, LoadedState
from softmodels.runs import budget, columns, formats, mesh_error, notes, outcomes, table
from softmodels.runs.fields import Fields, Figures, check_requested
from softmodels.runs.outcomes import RunError
from softmodels.runs.states import StoredStates


@dataclasses.dataclass(frozen=True, eq=False)
class RunStart:
    """Stored data from which a run is resumed.

    Attributes:
        rows: The states that there are; none for a run from the beginning.
        left: Which of the case's requested values are still to come.
        points: The points to go on from; see `Continuation.resume`.
        stop: The same of a program: the end of its last complete step.
        replay: Restores the histories at those states; called where the path has begun.
    """

    rows: table.PathTable = dataclasses.field(default_factory=table.PathTable)
    left: Sequence[bool] = ()
    points: Sequence[stability.Point] = ()
    stop: LoadedState | None = None
    replay: Callable[[], None] = lambda: None


FROM_REST = RunStart()

SECONDS_PER_STATE = 4.0
"""Seconds for a state of a solid of 30,000 unknowns on one core, within a factor of two or three; time grows as their 1.3rd
power, and two cores take two thirds of it."""
MIN_STEPS = 12
"""Minimum number of steps to the last requested value, for smooth curves."""
MIN_COMPANION_STEPS = 3
"""The same of a path of which only the requested values and limit points count."""


class Simulation:
    """A case's device on a communicator, and its path.

    In order: `write_mesh` (or a mesh file from before), `prepare`, `steps`, perhaps `branch`, `release`. Every call is made by
    all ranks. The listener receives progress reports; ``stopped`` is asked between states, and while a mesh is made, and once
    true on a rank ends the run. Model, body, solver and fields are there once it is prepared.
    """

    body: Body
    solver: Solver
    fields: Fields
    model: Model

    def __init__(
        self, case: Case, comm: MPI.Comm, listener: outcomes.Listener | None = None, stopped: Callable[[], bool] = bool
    ):
        self.case, self.comm, self.stopped = case, comm, stopped
        self.listener, self.min_steps = listener or outcomes.Listener(), MIN_STEPS
        self._path: Continuation | None = None
        self._bifurcations: list[stability.Point] = []

    def write_mesh(self, file: Path) -> None:
        """Mesh the device into a Gmsh file, on rank 0; `CaseError` for a field that there is not, `RunError` if it was stopped,
        else see `Actuator.write`."""
        check_requested(self.case.fields)
        device = self.case.actuator
        self.listener.say(meshing.mesh_label(device))
        try:
            mpi.on_root(self.comm, lambda: device.write(file, self.stopped))
        except MeshingStopped:
            raise RunError("stopped by the user during meshing; nothing was solved", commands.EXIT_STOPPED) from None

    def prepare(self, file: Path) -> None:
        """Read the mesh and set up the equations, compiling them on the first run; `RunError` or `MeshFileError` as
        `body_of`."""
        case, say = self.case, self.listener.say
        say("compiling kernels (first run only, about 10 s; then cached)")
        self._stop_if_asked()
        with compiling.report_waits(say, self._stop_here):
            self.body = body_of(case.actuator, file, self.comm)
            self.model = Model.of(case, self.body)
            self.solver, self.fields = self.model.solver, self.model.fields
            with compiling.compiling():
                self._band = self._make_band()

    def prepare_on(self, mesh: Callable[[], bytes]) -> None:
        """Prepare on a stored mesh, whose file is read on rank 0; errors as `prepare`, or `RunError` if the disk is full."""
        with notes.sentences(), temporary_folder(self.comm) as folder:
            file = folder / f"{self.case.name}.msh"
            mpi.on_root(self.comm, lambda: file.write_bytes(mesh()))
            self.prepare(file)

    def _make_band(self) -> budget.Band | None:
        case = self.case
        known = isinstance(case.band, materials.MaterialErrors) or case.deviations
        return budget.Band(self.fields, case) if known else None

    def describe(self) -> None:
        """Report the size of the model, the tracked points, and the stable range of the law."""
        say, ranks = self.listener.say, self.comm.size
        for text in self.fields.followed:
            say(text)
        space, topology = self.solver.system.space, self.body.mesh.topology
        unknowns = space.dofmap.index_map.size_global * space.dofmap.index_map_bs
        cells = topology.index_map(topology.dim).size_global
        seconds = SECONDS_PER_STATE * (unknowns / 30_000) ** 1.3 / ranks**0.6
        long = (
            f", some {float(f'{seconds:.1g}'):g} s a state"
            if seconds > SECONDS_PER_STATE and self.case.actuator.dimension == 3
            else ""
        )
        say(f"{cells} cells, {unknowns} unknowns, {ranks} rank{'s' if ranks > 1 else ''}{long}")
        if told := self.solver.method.description:
            say(told)
        for note in self.model.notes:
            say(f"warning: {note}")
        if weak := specimens.weakness(self.case.material):
            say(f"warning: {weak}; results at larger stretches are invalid")

    def steps(self, begun: RunStart = FROM_REST) -> Iterator[formats.StateRecord]:
        """Solve state by state, through all requested values that are not ``begun``.

        Raises:
            outcomes.PathEnded: The path ends before the last requested value, with where, why, and what can be done.
            RunError: It was stopped between two states, or no state was found where no step can be shortened.
        """
        yield from self._reported(self._program(begun) if self.case.program else self._load_path(begun))

    def _reported(self, steps: Iterator[formats.StateRecord]) -> Iterator[formats.StateRecord]:
        """Yield the same steps; notify the listener of each, and stop between steps if asked to."""
        for step in steps:
            yield step
            if mpi.is_root(self.comm):
                self.listener.step(step.row, step.row[self.case.variable] / self.case.values[-1])
            self._stop_if_asked()

    def _load_path(self, begun: RunStart) -> Iterator[formats.StateRecord]:
        case, count = self.case, len(begun.rows)
        last = begun.rows[-1] if begun.rows else None
        goals = self._goals()
        self._path = path = self._continuation(goals[-1])
        self._check_volumes(path.start)
        if begun.rows and not case.load_unload:
            goals = [goal for goal, wanted in zip(goals, begun.left, strict=True) if wanted]
        following = continuation.trace(path, goals, begun.points, begun.replay)
        points = schedule.cycle(path, goals) if case.load_unload else following
        try:
            for number, point in enumerate(points):
                if case.load_unload and number < count:
                    continue  # the curve is computed anew; stored states stay
                step = self.step_of(point, number if case.load_unload else count + number)
                last = step.row
                self._bifurcations += [point] if point.bifurcation else []
                yield step
        except stability.PathEnd as end:
            text = notes.explain(case, end, self.fields, path, _own_words())
            raise outcomes.PathEnded(text, commands.EXIT_NO_EQUILIBRIUM if end.physical else commands.EXIT_FAILED) from end
        except newton.NoConvergence as failure:
            raise RunError(notes.explain_failure(case, failure, last, _own_words())) from failure

    def _check_volumes(self, start: State | None) -> None:
        """Raise `RunError` for requested volumes below the one that the cavity has under the preload, where the path begins,
        the drivers coupled for it; None for the undeformed state."""
        volumes = self.case.load.of(steps.VOLUME)
        if start is None or not volumes:
            return
        system = self.solver.system
        taken = (start.V - system.rest().V) * system.volume_unit
        system.load(start)
        if passed := [value for value in volumes if 0.0 < value < taken]:
            raise RunError(
                f"{units.written(passed[0])} are not on this path: the preload has already added "
                f"{taken * 1e6:.4g} ml to the undeformed cavity; request more than that, or 0 for the preloaded state",
                commands.EXIT_NO_EQUILIBRIUM,
            )

    def _goals(self) -> list[float]:
        """Return the requested values, dimensionless, each with its text."""
        scale = self.model.unit_of(self.case.quantity)
        return [
            units.Amount(goal / scale, goal.number, goal.unit) if isinstance(goal, units.Amount) else goal / scale
            for goal in self.case.values
        ]

    def quantity(self, name: str) -> stability.PathQuantity:
        """Return a requested quantity by its name; the stroke is that of the case's supply."""
        eq, supply = self.solver.system, self.case.supply
        if supply is None or name in stability.QUANTITIES:
            return stability.QUANTITIES[name]
        return supply.control(eq.rest().V * eq.volume_unit, eq.stress_unit, eq.volume_unit)

    def _continuation(self, last: float) -> Continuation:
        case, say = self.case, self.listener.say
        quantity = self.quantity(case.quantity)
        return Continuation(
            self.solver, quantity, case.control, last / self.min_steps, start=self.model.path_start(say),
            report=lambda text: say(f"  {text}"), release=True,
        )  # fmt: skip

    def _program(self, begun: RunStart) -> Iterator[formats.StateRecord]:
        """Follow the device's program."""
        case, rows = self.case, table.PathTable(begun.rows)
        reached = float(begun.stop.number) if begun.stop else 0.0
        try:
            say = self.listener.say
            preload = self.model.preload(say)
            self.model.set_in_motion()
            begun.replay()
            settings = schedule.Settings(case.control, say, case.time_tolerance)
            gas = self.quantity(supply.Gas.name) if case.supply else None
            if isinstance(gas, supply.Gas):
                points = schedule.supply(self.solver, case.steps, gas, settings, begun.stop, preload)
            else:
                points = schedule.follow(self.solver, case.steps, settings, begun.stop, preload)
            # Where derivatives are carried along, all is computed anew; stored states stay.
            for reached, point in itertools.islice(points, 0 if begun.stop else len(rows), None):
                step = self.step_of(point, len(rows), reached)
                rows.append(step.row)
                yield step
        except stability.PathEnd as end:
            text = notes.explain_step(case, end, rows, reached, _own_words())
            raise outcomes.PathEnded(text, commands.EXIT_NO_EQUILIBRIUM if end.physical else commands.EXIT_FAILED) from end
        except newton.NoConvergence as failure:
            raise RunError(notes.explain_failure(case, failure, rows[-1] if rows else None, _own_words())) from failure

    @property
    def bifurcates(self) -> bool:
        """Whether `steps` has passed a bifurcation, from which `branch` can start."""
        return bool(self._bifurcations)

    def branch(self) -> Iterator[formats.StateRecord]:
        """Follow the branch at the first bifurcation, after `steps`, as far as it
        converges; report its end to the listener."""
        yield from self._reported(self._branch())

    def _branch(self) -> Iterator[formats.StateRecord]:
        assert self._path is not None
        start = self._bifurcations[0]
        value = self._path.value(start.state) * self.model.unit_of(self.case.quantity)
        self.listener.say(f"following the branch from {self.case.load.told(value)}")
        try:
            for number, point in enumerate(continuation.follow(self._path, start, farthest=max(self._goals()))):
                yield self.step_of(point, number)
        except (stability.PathEnd, newton.NoConvergence) as end:
            self.listener.say(f"the branch ends here: {end}")

    def release(self) -> None:
        """Release the PETSc and MPI objects of the device; see `Solver.release`."""
        if (band := getattr(self, "_band", None)) is not None:
            band.release()
        if hasattr(self, "solver"):
            self.solver.release()

    def _stop_if_asked(self) -> None:
        if mpi.any_rank(self.comm, self.stopped()):
            raise RunError(outcomes.INTERRUPTED, commands.EXIT_STOPPED)

    def _stop_here(self) -> None:
        """As `_stop_if_asked`, on this rank only."""
        if self.stopped():
            raise RunError(outcomes.INTERRUPTED, commands.EXIT_STOPPED)

    def step_of(self, point: stability.Point, number: int, reached: float = 0.0) -> formats.StateRecord:
        """Return a point of the path in SI units; ``reached`` is the number of program steps taken."""
        band = self._band.cells(point) if self._band else {}
        return columns.record_of(self.case, self.fields, point, number, reached, band)


def _own_words() -> bool:
    """Return whether the user gave PETSc options."""
    return bool(PETSc.Options().getAll())


class MemoryStates(StoredStates):
    """States of a prepared simulation in memory, identical on all ranks; its mesh's file is read on rank 0."""

    def __init__(self, simulation: Simulation, mesh: Callable[[], bytes]):
        self._comm, grid = simulation.comm, simulation.fields.grid
        # Only rank 0 has the whole grid.
        points, cells, self._mesh = mpi.on_root(self._comm, lambda: (grid.points, grid.cells, mesh()))
        records: list[formats.StateRecord] = []
        grid_of_all = points, cells, grid.cell_name
        super().__init__(simulation.case, (), grid_of_all, lambda step, name: records[step].fields[name])
        self.mesh_notes, self._records = simulation.model.notes, records

    def add(self, record: formats.StateRecord) -> None:
        """Store a state."""
        self.rows.append(record.row)
        fields = mpi.on_root(self._comm, lambda: record.fields)
        self._records.append(dataclasses.replace(record, fields=fields))

    def fields(self, step: int, names: Sequence[str] | None = None) -> Mapping[str, Array]:
        there = self._records[step].fields
        return there if names is None else {name: there[name] for name in names}

    def restart(self, step: int) -> formats.Restart:
        return self._records[step].restart

    def mesh(self) -> bytes:
        return self._mesh


# ----------------------------------------------------------------------------------------------------------------------
# A device whose equations are made: its equilibria, its path, its natural frequencies and modes, without files.


@contextlib.contextmanager
def temporary_folder(comm: MPI.Comm) -> Iterator[Path]:
    """Provide a temporary folder, the same on all ranks."""
    path = mpi.on_root(comm, lambda: Path(tempfile.mkdtemp(prefix="softmodels-")))
    try:
        yield path
    finally:
        if mpi.is_root(comm):
            shutil.rmtree(path, ignore_errors=True)


def meshed(device: Actuator, comm: MPI.Comm) -> Body:
    """Mesh a device and read its mesh; all ranks call it. `MeshingError` or `MeshFileError` if that fails, `RunError` if
    nothing can be compiled."""
    with temporary_folder(comm) as folder:
        path = folder / "device.msh"
        mpi.on_root(comm, lambda: device.write(path))
        return body_of(device, path, comm)


def body_of(device: Actuator, mesh: Path, comm: MPI.Comm) -> Body:
    """Read a device's mesh; all ranks call it. `MeshFileError` if it is none of `Actuator.write`, `RunError` if it is of
    another device, or nothing can be compiled."""
    try:
        return Body.from_file(device, mesh, comm)
    except (BodyError, compiling.CompilingError) as error:
        raise RunError(str(error)) from error


SMALL_PRESSURE = steps.one_step(steps.PRESSURE, [100.0])
"""Load of a case whose requested values do not matter."""


class AtRest(Case):
    """A case of which nothing may be requested but how the device hangs under its dead loads: a file needs no [load]."""

    needed_tables: ClassVar = ("geometry",)

    def _check_load(self) -> None:
        if any(self.load.values):
            super()._check_load()


@names.checked
class Model(cards.ResultCard):
    """A device, meshed, and the equations of its equilibrium.

    Under weights and other dead loads every path begins where the device hangs under them. Every call is made by all ranks.

    Args:
        device: The device. One without a cavity has only the state at rest, or under its dead loads.
        material: Its silicone, or the name of one.
        components: Components added to it: `Gravity`, `Rigid`, `Fibres` and others, one or several.
        formulation: ``"mixed"`` (displacement and pressure) or ``"displacement"``.
        solver: How linear equations are solved: ``"auto"``, ``"direct"`` or ``"iterative"``.

    Raises:
        ArgumentError, CaseError: Invalid input.
        RunError: The equations cannot be compiled, or do not fit into memory.
        MeshingError, MeshFileError: The device cannot be meshed.

    Attributes:
        case: The device with all around it; of its load only what is part of the preload matters.
        body, system, solver, fields: Its mesh, its equations, what solves them, and the fields of its states.
    """

    @one_at_a_time
    def __init__(
        self,
        device: Actuator,
        material: Material | str,
        components: Component | Sequence[Component] = (),
        formulation: str = "mixed",
        *,
        solver: str = "auto",
    ):
        inflated = bool(getattr(device, "ratios", True))
        case = (Case if inflated else AtRest)(
            "model", device, material, SMALL_PRESSURE if inflated else (),  # type: ignore[arg-type]
            components=components, formulation=formulation, solver=solver,  # type: ignore[arg-type]
        )  # fmt: skip
        comm = mpi.start()
        with notes.sentences():
            self._make(case, meshed(device, comm), case.material, case.components)

    @classmethod
    def of(
        cls, case: Case, body: Body, material: Material | None = None, components: Sequence[Component] | None = None
    ) -> Model:
        """The model of a case on a mesh that is read already, with another material or components where they are given;
        `RunError` if its equations cannot be set up or compiled."""
        made = cls.__new__(cls)
        made._make(case, body, material or case.material, case.components if components is None else components)
        return made

    def _make(self, case: Case, body: Body, material: Material, components: Sequence[Component]) -> None:
        self.case, self.body = case, body
        self.components = components
        try:
            with compiling.compiling():
                self.system = System(body, material, case.formulation, components, creeping=case.timed)
                self.solver = Solver(self.system, case.solver)
                self.fields = Fields(self.solver, case.gauges, case.fields)
            self.system.direction = case.load.direction
        except (BodyError, compiling.CompilingError) as error:
            raise RunError(str(error)) from error

    def _line(self) -> str:
        size = self.system.space.dofmap
        return f"of {self.case.actuator.stem}: {size.index_map.size_global * size.index_map_bs} unknowns"

    def _remarks(self) -> list[str]:
        return self.notes

    @property
    def notes(self) -> list[str]:
        """Warnings about the mesh, as sentences; empty if there are none."""
        return [errors.spoken(note) for note in self.system.mesh_notes]

    def release(self) -> None:
        """Give back what PETSc and MPI hold; the model is not used afterwards."""
        self.solver.release()

    # -- states -------------------------------------------------------------------------------------------------------

    @names.checked
    @one_at_a_time
    def solve(self, pressure: float | str | None = None, volume: float | str | None = None) -> Equilibrium:
        """The equilibrium at a pressure or an added volume; the path to there is followed.

        Args:
            pressure: In Pa, or a text such as ``"7 kPa"`` or ``"70 cm"``.
            volume: Added volume of the cavity in m3, or a text such as ``"40 ml"``; past a limit point of the pressure too.
                With neither, the state under the dead loads, which is undeformed where there are none.

        Raises:
            ArgumentError, CaseError: Invalid input.
            RunError: There is no such equilibrium on the path, or it was not found.
        """
        if pressure is None and volume is None:
            state = self.path_start() or self.system.rest()
            return Equilibrium(self, state)
        *_, last = self.path(None if pressure is None else [pressure], None if volume is None else [volume])
        return last

    @names.checked
    def path(
        self, pressures: load.Values | None = None, volumes: load.Values | None = None, *, control: str = "auto"
    ) -> Iterator[Equilibrium]:
        """Follow the device from rest, and yield every state: the requested ones, those between, limit points, bifurcations.

        Args:
            pressures: Pressures to stop at, rising: ``"0:177 cm"``, ``"0:17:1 kPa"``, or numbers in Pa.
            volumes: The same of added volumes: ``"0:60 ml"``, or numbers in m3.
            control: What the path follows: ``"auto"``, ``"pressure"``, ``"volume"`` or ``"arc-length"``.

        Raises:
            ArgumentError, CaseError: Invalid input.
            RunError: The path ends before the last requested value.
        """
        if (pressures is None) == (volumes is None):
            raise CaseError("give the pressures or the added volumes that the path goes to, one of them")
        quantity, values = (steps.PRESSURE, pressures) if volumes is None else (steps.VOLUME, volumes)
        asked = load.prescribed(quantity, values, self.case.column.pascal)  # type: ignore[arg-type]
        if not any(asked.values):
            raise CaseError(f"the only {quantity} requested is 0; add a value above 0, or take the state at rest by solve()")
        return self.followed(
            dataclasses.replace(self.case, control=control, steps=steps.one_step(quantity, asked.values)), quantity
        )

    def followed(self, case: Case, quantity: str) -> Iterator[Equilibrium]:
        """Follow the device through the pressures or added volumes of a case; see `path`."""
        self.system.direction = case.load.direction
        unit = self.unit_of(quantity)
        try:
            for point in continuation.trace(self.continuation(quantity, case.control), [goal / unit for goal in case.values]):
                yield Equilibrium(self, point.state, point)
        except stability.PathEnd as end:
            status = commands.EXIT_NO_EQUILIBRIUM if end.physical else commands.EXIT_FAILED
            raise RunError(f"the path ends before the last requested {quantity}: {end}", status) from end
        except newton.NoConvergence as failure:
            raise RunError(f"the path could not be followed ({failure})") from failure

    def continuation(
        self, quantity: str = "pressure", control: str = "auto", preload: LoadedState | None = None
    ) -> Continuation:
        """The path to pressures or added volumes, not begun yet; its values are dimensionless; see `path_start`."""
        start = self.path_start(preload=preload)
        return Continuation(self.solver, stability.QUANTITIES[quantity], control, start=start)

    # -- preload ------------------------------------------------------------------------------------------------------

    def path_start(self, report: Callable[[str], None] = lambda text: None, preload: LoadedState | None = None) -> State | None:
        """The state in which the device hangs under its preload (``preload``, where it is known), from which the path to
        requested values starts; None without dead loads, `RunError` if there is none. ``report`` takes sentences on what is
        going on."""
        preload, driven = self.preload(report) if preload is None else preload, self.case.load.driven
        if preload is None:
            self.system.coupling = self.system.inflating(np.empty(0))
            return None
        if driven is None:
            return schedule.inflate_from(self.solver, preload)
        return schedule.load_from(self.solver, preload, len(self.case.actuator.ratios) + self.driven_load)

    def preload(self, report: Callable[[str], None] = lambda text: None) -> LoadedState | None:
        """The state under all loads that act before the first requested value, its drivers not coupled, see `path_start`;
        `RunError` if there is none."""
        case, system, dead = self.case, self.system, self.system.dead
        if not dead.loads:
            return None
        changed = {driver.of for step in case.steps for driver in step.prescribed}
        changed |= {case.load.driven_part.key} if case.load.driven else set()
        kept = [0.0 if load.key in changed else amount for load, amount in zip(dead.loads, dead.amounts, strict=True)]
        ratios = np.array(case.actuator.ratios)
        magnitudes = np.concatenate([np.zeros(len(ratios)), np.array(kept) / dead.units])
        targets = [("its dead loads", magnitudes)]
        if pressure := case.load.preload:
            inflated = magnitudes.copy()
            inflated[: len(ratios)] = pressure / system.stress_unit * ratios
            targets.append((units.written(pressure), inflated))
        if words := [what for what, amounts in targets if amounts.any()]:
            report(f"applying {', then '.join(words)}")
        try:
            preload = schedule.apply_preload(self.solver, targets, report)
        except schedule.PreloadFailure as end:
            raise RunError(end.sentence, commands.EXIT_NO_EQUILIBRIUM if end.physical else commands.EXIT_FAILED) from end
        dead.origins = preload.driven
        return preload

    @property
    def driven_load(self) -> int:
        """Place among the dead loads of the one whose values are requested."""
        assert self.case.load.driven is not None
        return self.system.dead.index(self.case.load.driven_part.key)

    def unit_of(self, quantity: str) -> float:
        """SI units in one dimensionless value of a quantity, by its name; of shares of the weight the weight; below 0 for
        pressures and volumes of a path to vacuum, see `System.direction`."""
        system, driven = self.system, self.case.load.driven
        if quantity == stability.Pressure.name:
            return system.direction * system.stress_unit
        if driven is not None and quantity in (stability.DeadForce.name, stability.LoadDisplacement.name):
            place = self.driven_load
            unit = (system.dead.moved_units if driven.held else system.dead.units)[place]
            return float(unit / (system.dead.amounts[place] if driven.quantity == "share" else 1.0))
        return system.direction * system.volume_unit

    # -- modes --------------------------------------------------------------------------------------------------------

    @names.checked
    @one_at_a_time
    def modes(self, equilibrium: Equilibrium | None = None, count: int = 4, *, sealed: bool = False) -> list[Mode]:
        """The natural modes of a state, from the lowest frequency up; unstable ones first.

        They are the vibrations of small amplitude about the relaxed state. The branches of silicone with a memory stiffen and
        damp them, each at its own frequency; shapes are those of the relaxed silicone. The silicone has the density of
        `Gravity`, or of its data sheet, or 1070 kg/m3; regions have their own, and masses and plates bonded to the device swing
        with it.

        Args:
            equilibrium: A state of this model; that of `solve` without arguments if None.
            count: At least how many.
            sealed: Each cavity is closed, with air that keeps its temperature (at 101325 Pa around the device). Else the
                cavities keep their pressures.

        Raises:
            ArgumentError: Something else than an equilibrium, or than a number of modes.
            CaseError: A state of another model, a device without mass, or a sealed one without a cavity.
            RunError: There is no such state, or the modes do not converge.
        """
        names.one_of("equilibrium", equilibrium, (Equilibrium, NoneType), "a state that this model has solved, or None")
        if equilibrium is not None and equilibrium.model is not self:
            raise CaseError("equilibrium is a state of another model; solve it with this one (model.solve, model.path)")
        count, sealed = names.whole("count", count, 1), names.flag("sealed", sealed)
        density = self._densities[0]
        state = (equilibrium or self.solve()).state
        self.system.load(state)
        springs = self._springs(state, sealed)
        try:
            pairs = self._stability.eigenpairs(state, count + (EXTRA_MODES if self._creeping else 0), springs)
            least = ZERO_EIGENVALUE_TOLERANCE * max((abs(value) for value, _ in pairs), default=0.0)
            unit = self.system.stress_unit / self.system.length_unit**2
            values = np.array([value * unit if abs(value) > least else 0.0 for value, _ in pairs])
            roots = self._roots(values / density, [w for _, w in pairs], springs)
        except newton.NoConvergence as failure:
            raise RunError(f"the modes were not found ({failure}); ask for fewer, or use smaller cells") from failure
        return [
            Mode(float(value), density, self._shape(w), root) for value, root, (_, w) in zip(values, roots, pairs, strict=True)
        ]

    def _roots(self, squares: Array, shapes: Sequence[Array], springs: stability.Springs) -> list[complex]:
        """Return the modes' `Mode.root`, of the squares of their relaxed angular frequencies in 1/s2; in the loaded state."""
        if not self._creeping:
            return [complex(math.sqrt(-square)) if square < 0.0 else 1j * math.sqrt(square) for square in squares]
        relaxed, stiffnesses = self._stiffnesses(shapes, springs)
        return stability.damped_roots(
            squares, relaxed, lambda s: np.sum([K * own.stiffening(s) for K, own in stiffnesses], axis=0)
        )

    def _stiffnesses(self, shapes: Sequence[Array], springs: stability.Springs) -> tuple[Array, list[tuple[Array, Memory]]]:
        """Return the relaxed stiffness over the space of `Stability.with_responses`, and that of each silicone with branches of
        share 1 with its memory, in 1/s2."""
        unit = self.system.stress_unit / self.system.length_unit**2 / self._densities[0]
        matrices = [assembly.sparse_matrix(form, self.system.bcs) for form, *_ in self._creeping]
        relaxed, products = self._stability.with_responses(shapes, matrices, springs)
        for matrix in matrices:
            matrix.destroy()
        creeping = [(unit * modulus * K, own) for K, (_, modulus, own) in zip(products, self._creeping, strict=True)]
        return unit * relaxed, creeping

    def first_mode_stiffness(self) -> tuple[Array, Array]:
        """Return of the device at rest the relaxed stiffness over a space of unit mass whose first vector is its first mode,
        and that of branches of share 1 of its silicone, which needs a memory, in 1/s2, shapes (m, m); both are in proportion
        to its shear modulus. `RunError` as `modes`."""
        state = self.solve().state
        self.system.load(state)
        springs = self._springs(state, False)
        try:
            pairs = self._stability.eigenpairs(state, 1 + EXTRA_MODES, springs)
            relaxed, ((creeping, _),) = self._stiffnesses([w for _, w in pairs], springs)
        except newton.NoConvergence as failure:
            raise RunError(f"the first mode was not found ({failure}); use smaller cells") from failure
        return relaxed, creeping

    @functools.cached_property
    def _creeping(self) -> list[tuple[fem.Form, float, Memory]]:
        """Of each region whose silicone has branches: `memory.instant_stiffness`, its shear modulus, in stress units, and its
        memory."""
        potential, silicones = self.system.potential, {"": self.case.material}
        silicones |= {part.name: part.material for part in self.components if isinstance(part, regions.RegionPart)}
        return [
            (
                memory.instant_stiffness(self.body, region, potential.displacement, potential.w),
                region.material.shear_modulus_0 / self.system.stress_unit,
                own,
            )
            for region in potential.regions
            if region.material.memory is None  # else the tangent has the branches, all of their modulus
            and (own := silicones[region.name].memory) is not None
            and own.branches
        ]

    @functools.cached_property
    def _densities(self) -> list[float]:
        """Densities in kg/m3 of the materials; `CaseError` if the main one has none, or a mass rests on the device."""
        resting = next((part.where for part in self.components if part.lifted and part.weighs), "")
        if resting:
            raise CaseError(
                f"{resting} rests on the device, and neither frequencies nor inertia are computed with it; leave out its mass"
            )
        densities = loads.densities(self.system, self.components)
        if not densities[0] > 0.0:
            raise CaseError(
                "the silicone has a density of 0 kg/m^3, and without mass no frequency and no inertia; leave out the density"
            )
        return densities

    @functools.cached_property
    def _stability(self) -> stability.Stability:
        """Finds the modes with the device's masses."""
        return stability.Stability.of(self.solver) if self._inertia.plain else stability.Stability(self.solver, self._inertia)

    @functools.cached_property
    def _inertia(self) -> assembly.Inertia:
        """The device's masses."""
        main, unit = self._densities[0], self._densities[0] * self.system.volume_unit
        heavy = [part for part in self.components if isinstance(part, controls.HeavyPart) and part.weighs]
        return assembly.Inertia(
            tuple(density / main for density in self._densities),
            tuple((part.face, part.weighs / unit) for part in heavy),
        )

    def set_in_motion(self) -> None:
        """Let the inertia of the device's masses act from here on, at rest, if the case asks for it."""
        if not self.case.inertia:
            return
        with compiling.compiling():
            motion = memory.Motion(self.system, self._inertia, self._densities[0], self.case.spectral_radius)
        self.system.potential.motion = motion

    def _springs(self, state: State, sealed: bool) -> stability.Springs:
        """The stiffness of sealed air, of the loaded state: -dP/dV = P/V at constant temperature, with P above vacuum."""
        cavities = len(self.case.actuator.ratios) if sealed else 0
        if sealed and not cavities:
            raise CaseError(f"{type(self.case.actuator).__name__} has no cavity to be sealed; leave out --sealed")
        pressures = self.system.pressures_at(state)[:cavities] + supply.AMBIENT_PRESSURE / self.system.stress_unit
        return stability.Springs(self.system.pressure_loads()[:cavities], pressures / self.system.volumes()[:cavities])

    def _shape(self, w: Array) -> Array:
        shape = self.fields.shape(w)
        scaled: Array = mpi.on_root(self.body.mesh.comm, lambda: np.asarray(shape) / np.abs(np.asarray(shape)).max())
        return names.read_only(scaled)


EXTRA_MODES = 4
"""Relaxed modes beyond those asked for, of which damped ones are made up too; with their responses to what relaxes."""

ZERO_EIGENVALUE_TOLERANCE = 1e-9
"""Eigenvalue over the largest of those asked for up to which it is 0, as at a limit point: there its sign is rounding."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Mode(cards.ResultCard):
    """A mode of a device at an equilibrium.

    Attributes:
        eigenvalue: Square of its angular frequency times the density, Pa/m2; negative where the equilibrium is not stable. Of
            relaxed silicone.
        density: Of the silicone, kg/m3.
        displacement: Its shape in device coordinates, shape (n, 3), largest entry 1 or -1.
        root: It goes as exp(root t), 1/s, with the damping of a silicone with a memory; real where it is not stable.
    """

    eigenvalue: float
    density: float
    displacement: Array
    root: complex

    def _line(self) -> str:
        if not self.stable:
            return f"unstable, grows by a factor of e in {1 / self.rate:.2g} s"
        return f"at {self.frequency:.4g} Hz" + (f", damping ratio {self.damping:.3g}" if self.damping else "")

    @property
    def stable(self) -> bool:
        """Whether the device swings in it, and does not leave its state; of a limit point, where the eigenvalue is 0, too."""
        return self.eigenvalue >= 0.0

    @property
    def frequency(self) -> float:
        """Frequency in Hz at which it rings; nan of an unstable mode."""
        return self.rate / (2 * math.pi) if self.stable else math.nan

    @property
    def damping(self) -> float:
        """Damping ratio z: in a period a free vibration falls by the factor exp(-2 pi z/sqrt(1 - z^2)); 0 without a memory,
        nan of an unstable mode."""
        if not self.stable:
            return math.nan
        return -self.root.real / abs(self.root) if self.root.real else 0.0

    @property
    def rate(self) -> float:
        """Angular frequency in 1/s; of an unstable mode how fast it grows, as exp(rate t)."""
        return self.root.imag if self.stable else self.root.real


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Equilibrium(cards.ResultCard):
    """A state of a `Model`, SI units. Fields are computed when they are asked for first; arrays are read-only.

    Attributes:
        model: Whose state it is.
        state: Its unknowns, dimensionless.
        point: Its point of the path; None of a state that was not followed to.
    """

    model: Model
    state: State
    point: stability.Point | None = None

    def _line(self) -> str:
        gauge = self.model.case.actuator.gauge
        return (
            f"of {self.model.case.actuator.stem} at {self.pressure / 1e3:.4g} kPa: "
            f"{gauge} rise {self.rises[gauge] * 1e3:.4g} mm, largest stretch {self.largest_stretch:.4g}"
        )

    def _figures(self) -> cards.Table:
        return [
            ("pressure", f"{self.pressure / 1e3:.4g} kPa"),
            ("added volume", f"{self.volume * 1e6:.4g} ml"),
            *((f"rise of the {name}", f"{rise * 1e3:.4g} mm") for name, rise in self.rises.items()),
            ("largest stretch", f"{self.largest_stretch:.4g}"),
            ("elastic energy", f"{self.energy * 1e3:.4g} mJ"),
            *([] if self.stable is None else [("stable under this pressure", "yes" if self.stable else "no")]),
        ]

    @property
    def _states(self) -> StoredStates:
        """This state as pictures take it."""
        case, grid = self.model.case, self.model.fields.grid
        row = table.Row({
            "pressure_Pa": self.pressure, "pressure_cm": self.pressure / case.column.pascal,
            "added_volume_ml": self.volume * 1e6,
            **{f"{name}_mm": rise * 1e3 for name, rise in self.rises.items()}, "max_stretch": self.largest_stretch,
            "requested": 1, "limit": 0,
        }, case.column.pascal)  # fmt: skip
        nodes = self.points, grid.cells, grid.cell_name
        return StoredStates(case, [row], nodes, lambda step, name: self.fields[name])

    @functools.cached_property
    def figures(self) -> Figures:
        """All key figures, of the whole device."""
        return self.model.fields.figures(self.state)

    @functools.cached_property
    def fields(self) -> Mapping[str, Array]:
        """Nodal fields by name: ``displacement`` (n, 3), ``p``, ``von_mises``, ``largest_stretch``, ``J`` (n,)."""
        nodal = self.model.fields.nodal(self.state)
        fields = mpi.on_root(self.model.body.mesh.comm, lambda: nodal or {})
        return {name: names.read_only(values) for name, values in fields.items()}

    @property
    def pressure(self) -> float:
        """Pa."""
        return self.figures.pressure

    @property
    def volume(self) -> float:
        """Volume in m3 that the cavity has taken."""
        return self.figures.added_volume

    @property
    def energy(self) -> float:
        """Elastic energy in J of the whole device."""
        return self.figures.stored_energy

    @property
    def rises(self) -> dict[str, float]:
        """Rise of each probe in m by its name."""
        return dict(self.figures.rises)

    @property
    def largest_stretch(self) -> float:
        """Largest principal stretch at the integration points."""
        return self.figures.max_stretch

    @property
    def displacement(self) -> Array:
        """Displacement in m, in device coordinates, shape (n, 3)."""
        return self.fields["displacement"]

    @property
    def points(self) -> Array:
        """Undeformed nodes in device coordinates, m, shape (n, 3)."""
        grid = self.model.fields.grid
        return names.read_only(mpi.on_root(self.model.body.mesh.comm, lambda: grid.points))

    @property
    def requested(self) -> bool:
        """Whether it is at one of the requested values."""
        return self.point is not None and self.point.requested

    @property
    def limit(self) -> bool:
        """Whether it is a limit point of the pressure."""
        return self.point is not None and self.point.limit

    @property
    def bifurcation(self) -> bool:
        """Whether another branch leaves the path here."""
        return self.point is not None and self.point.bifurcation

    @property
    def stable(self) -> bool | None:
        """Whether it is stable at its pressure; None of a state that was not followed to."""
        return None if self.point is None else self.point.stable_under_pressure


# ----------------------------------------------------------------------------------------------------------------------
# Solve a case with every other source of its silicone, on the mesh of the run.


def solve_sources(simulation: Simulation, mesh: Path) -> dict[str, table.PathTable]:
    """Follow the path of each other source of a case's band, on its mesh's file; all ranks call it. Return rows by the
    sources' names, on all ranks; empty where the case has no such band. A path that ends early has the rows up to there.
    `RunError` if the user stopped it."""
    case, band = simulation.case, simulation.case.band
    if not isinstance(band, materials.SourceBand):
        return {}
    others, sources = band.others(case.material), {}
    for number, (name, material) in enumerate(others.items(), 1):
        simulation.listener.say(f"solving with {name}, source {number} of {len(others)} besides the run's own")
        aside = _aside(simulation, dataclasses.replace(simulation.case, material=material))
        sources[name] = _followed(simulation, aside, functools.partial(aside.prepare, mesh), f"the path of {name}")
    return {name: rows for name, rows in sources.items() if rows}


def solve_meshes(simulation: Simulation, seconds: float | None = None) -> dict[str, table.PathTable]:
    """Follow the path of a case on other meshes, for `softmodels.runs.mesh_error`; all ranks call it. Return their rows, on all
    ranks; none where the case does not ask for the mesh error. With the ``seconds`` of a core that its own path took it is
    estimated unasked too, where that costs little. `RunError` if the user stopped it."""
    case = simulation.case
    other = mesh_error.companion(case, seconds is not None)
    if other is None:
        return {}
    if seconds is not None and not case.mesh_error:
        seconds = mesh_error.expected_seconds(case, other, seconds)
        if not mpi.on_root(simulation.comm, functools.partial(mesh_error.affordable, seconds)):
            simulation.listener.say(f"the mesh error is left out, which would take about {seconds:.2g} s more (--mesh-error)")
            return {}
    simulation.listener.say(f"solving again {mesh_error.described(case)}, for the mesh error")
    meshes = {columns.FINER: _path_of(simulation, other, MIN_STEPS if case.mesh_error else MIN_COMPANION_STEPS)}
    if (larger := mesh_error.coarser_companion(case)) is not None:
        simulation.listener.say("  and with larger ones, since two meshes of a solid may agree by chance")
        meshes[columns.COARSER] = _path_of(simulation, larger)
    return {name: rows for name, rows in meshes.items() if rows}


MOST_REFINEMENTS = 6
"""Times that cells are made smaller for an accuracy."""


def accurate(case: Case, comm: MPI.Comm, listener: outcomes.Listener | None = None, stopped: Callable[[], bool] = bool) -> Case:
    """Return a case with cells small enough for its accuracy, and with the mesh error to tell; itself where it asks for none.
    All ranks call it. Paths are followed on smaller and smaller cells, until two of them are so close.

    Raises:
        RunError: The accuracy is not reached, or the user stopped it.
        MeshingError: No mesh can be made.
    """
    if not case.accuracy:
        return case
    simulation = Simulation(dataclasses.replace(case, accuracy=0.0, mesh_error=True), comm, listener, stopped)
    aims, say, times = simulation.case, simulation.listener.say, mesh_error.FINER[case.actuator.dimension]
    say(f"looking for cells that give an accuracy of {case.accuracy:.2g} of the number")
    begun, before, rows = time.monotonic(), table.PathTable(), _path_on(simulation, 1.0)
    for number in range(MOST_REFINEMENTS):
        factor, larger, before = times**number, before, rows
        try:
            rows = _path_on(simulation, factor * times)
        except GeometryError as error:
            raise RunError(f"an accuracy of {case.accuracy:.2g} is not reached: {error}; ask for less") from None
        shares = mesh_error.MeshErrors(aims, before, {columns.FINER: rows, columns.COARSER: larger}).shares()
        if not shares:
            raise RunError(
                "the mesh error is unknown: the path ends before a state under load that two meshes have; ask for a lower "
                "load, or leave out --accuracy"
            )
        what = max(shares, key=lambda name: shares[name])
        reached = f"with --finer {factor * case.actuator.finer:g} the mesh error of the {what} is {shares[what]:.2g} of it"
        say(f"  {reached}")
        if shares[what] <= case.accuracy:
            say(f"  these cells are used; found in {time.monotonic() - begun:.0f} s")
            return dataclasses.replace(aims, actuator=case.actuator.refined(factor))
    raise RunError(
        f"an accuracy of {case.accuracy:.2g} is not reached: {reached}; ask for less, or round the corners where the strain "
        "has no bound"
    )


def _path_on(simulation: Simulation, finer: float) -> table.PathTable:
    case = simulation.case
    return _path_of(simulation, dataclasses.replace(case, actuator=case.actuator.refined(finer)))


def _path_of(simulation: Simulation, case: Case, min_steps: int = MIN_STEPS) -> table.PathTable:
    aside = _aside(simulation, case)
    aside.min_steps = min_steps

    def prepare() -> None:
        with temporary_folder(simulation.comm) as folder:
            aside.write_mesh(folder / "finer.msh")
            aside.prepare(folder / "finer.msh")

    return _followed(simulation, aside, prepare, "this path")


def _aside(simulation: Simulation, case: Case) -> Simulation:
    """Return the simulation of another case beside a run's, without band, tolerances and mesh error."""
    plain = dataclasses.replace(case, band=None, tolerance=None, mesh_error=False)
    return Simulation(plain, simulation.comm, None, simulation.stopped)


def _followed(simulation: Simulation, aside: Simulation, prepare: Callable[[], None], what: str) -> table.PathTable:
    """Return the rows of another path beside a run's, as far as it goes; the listener gets the reason of an early end."""
    rows, say = table.PathTable(), simulation.listener.say
    try:
        prepare()
        for step in aside.steps():
            rows.append(step.row)
    except outcomes.PathEnded as end:
        say(f"  {end}")
    except (RunError, MeshingError) as error:
        if getattr(error, "status", None) == commands.EXIT_STOPPED:
            raise
        say(f"  {what} ends here: {error}")
    finally:
        aside.release()
    return rows
