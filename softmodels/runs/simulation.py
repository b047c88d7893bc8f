"""Solve a case: mesh its device, compile its equations, follow its path state by state."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from geometries import MeshingStopped, meshing
from softmodels.case.case import Case
from softmodels.case.materials import MaterialErrors, SourceBand
from softmodels.common.arrays import Array
from softmodels.common.lazy import MPI, PETSc
from softmodels.materials.specimens import weakness
from softmodels.mechanics.body import Body
from softmodels.mechanics.compiling import compiling, told_of_waits
from softmodels.mechanics.mpi import any_rank, is_root, on_root
from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State
from softmodels.path import schedule
from softmodels.path.continuation import Continuation, follow, trace
from softmodels.path.schedule import StageEnd, cycle
from softmodels.path.stability import DIRECT, PathEnd, PathQuantity, Point
from softmodels.path.supply import Gas
from softmodels.runs.columns import Band, Solved, row_of
from softmodels.runs.fields import Fields, Row, check_requested
from softmodels.runs.formats import Restart, restart_of
from softmodels.runs.model import Model, body_of, temporary_folder
from softmodels.runs.notes import explain, explain_failure, explain_step, sentences
from softmodels.runs.outcomes import FAILED, INTERRUPTED, NO_EQUILIBRIUM, STOPPED, RunError
from softmodels.runs.states import States

# ----------------------------------------------------------------------------------------------------------------------
# Interface between a simulation and its callers: states, listeners and restart data.


class Listener(Protocol):
    """Receives the progress of a run: nothing, a program's log, a notebook."""

    def say(self, text: str) -> None:
        """Report a sentence on the current step."""

    def step(self, row: Row, value: float) -> None:
        """Report a solved state: its row of ``path.csv``, and the progress towards the last requested value."""


class Silent:
    """A listener that does nothing."""

    def say(self, text: str) -> None:
        pass

    def step(self, row: Row, value: float) -> None:
        pass


class PathEnded(RunError):
    """A requested value is not on the path, or the continuation failed; the states so far are valid."""


@dataclasses.dataclass(frozen=True, eq=False)
class Step:
    """One state of a run: its row of ``path.csv``, on all ranks, its nodal fields by name, SI units, as `Fields.nodal` gives
    them, with the ``mode`` at a bifurcation, on rank 0, and numbers that a restart needs beside these."""

    row: Row
    fields: dict[str, Array] | None
    restart: Restart


@dataclasses.dataclass(frozen=True, eq=False)
class Begun:
    """Stored data from which a run is resumed.

    Attributes:
        rows: Rows of ``path.csv`` of the states that there are; none for a run from the beginning.
        left: Which of the case's requested values are still to come.
        points: The points to go on from; see `Continuation.resume`.
        stop: The same of a program: the end of its last complete step.
        recall: Lets parts remember what they do after those states; called where the path has begun.
    """

    rows: Sequence[Row] = ()
    left: Sequence[bool] = ()
    points: Sequence[Point] = ()
    stop: StageEnd | None = None
    recall: Callable[[], None] = lambda: None


FROM_REST = Begun()


COARSE = 0.01
"""Relative error of the meshed cavity's volume above which the user is warned."""
FEWEST_STEPS = 12
"""Minimum number of steps to the last requested value, for smooth curves."""


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
        self, case: Case, comm: MPI.Comm, listener: Listener | None = None, stopped: Callable[[], bool] = bool
    ):
        self.case, self.comm, self.stopped = case, comm, stopped
        self.listener: Listener = listener or Silent()
        self._path: Continuation | None = None
        self._bifurcations: list[Point] = []

    def write_mesh(self, file: Path) -> None:
        """Mesh the device into a Gmsh file, on rank 0; `CaseError` for a field that there is not, `RunError` if it was
        stopped, else see `Actuator.write`."""
        check_requested(self.case.fields)
        device = self.case.actuator
        self.listener.say(meshing.mesh_label(device))
        try:
            on_root(self.comm, lambda: device.write(file, self.stopped))
        except MeshingStopped:
            raise RunError("stopped by the user during meshing; nothing was solved", STOPPED) from None

    def prepare(self, file: Path) -> None:
        """Read the mesh and set up the equations, compiling them on the first run; `RunError` or `MeshFileError` as
        `body_of`."""
        case, say = self.case, self.listener.say
        say("compiling kernels (first run only, about 10 s; then cached)")
        self._stop_if_asked()
        with told_of_waits(say, self._stop_here):
            self.body = body_of(case.actuator, file, self.comm)
            self.model = Model.of(case, self.body)
            self.solver, self.fields = self.model.solver, self.model.fields
            with compiling():
                self._band = self._make_band()

    def prepare_on(self, mesh: Callable[[], bytes]) -> None:
        """Prepare on a stored mesh, whose file is read on rank 0; errors as `prepare`, or `RunError` if the disk is full."""
        with sentences(), temporary_folder(self.comm) as folder:
            file = folder / f"{self.case.name}.msh"
            on_root(self.comm, lambda: file.write_bytes(mesh()))
            self.prepare(file)

    def _make_band(self) -> Band | None:
        case = self.case
        return Band(self.fields, case.band, case.cm, case.quantity) if isinstance(case.band, MaterialErrors) else None

    def describe(self) -> None:
        """Report the size of the model, the tracked points, and the stable range of the law."""
        say, ranks = self.listener.say, self.comm.size
        for text in self.fields.followed:
            say(text)
        space, topology = self.solver.system.space, self.body.mesh.topology
        unknowns = space.dofmap.index_map.size_global * space.dofmap.index_map_bs
        cells = topology.index_map(topology.dim).size_global
        say(f"{cells} cells, {unknowns} unknowns, {ranks} rank{'s' if ranks > 1 else ''}")
        if told := self.solver.method.told:
            say(told)
        if abs(error := self.solver.system.volume_error) > COARSE:
            kind, amount = "less" if error < 0.0 else "more", f"{abs(error):.1%}"
            say(
                f"warning: the cavity of the mesh has {amount} {kind} volume than the device's: use smaller cells, or "
                "check that all faces around the air are among its walls"
            )
        if weak := weakness(self.case.material):
            say(f"warning: {weak}; results at larger stretches are invalid")

    def steps(self, begun: Begun = FROM_REST) -> Iterator[Step]:
        """Solve state by state, through all requested values that are not ``begun``.

        Raises:
            PathEnded: The path ends before the last requested value, with where, why, and what can be done.
            RunError: It was stopped between two states, or no state was found where no step can be shortened.
        """
        yield from self._reported(self._program(begun) if self.case.program else self._load_path(begun))

    def _reported(self, steps: Iterator[Step]) -> Iterator[Step]:
        """Yield the same steps; notify the listener of each, and stop between steps if asked to."""
        for step in steps:
            yield step
            if is_root(self.comm):
                self.listener.step(step.row, step.row[self.case.column])
            self._stop_if_asked()

    def _load_path(self, begun: Begun) -> Iterator[Step]:
        case, count = self.case, len(begun.rows)
        last = begun.rows[-1] if begun.rows else None
        goals = self._goals()
        self._path = path = self._continuation(goals[-1])
        path.start, path.recall = self.model.hanging(self.listener.say), begun.recall
        self._check_volumes(path.start)
        if begun.rows and not case.load_unload:
            goals = [goal for goal, wanted in zip(goals, begun.left, strict=True) if wanted]
        points = cycle(path, goals) if case.load_unload else trace(path, goals, begun.points)
        try:
            for number, point in enumerate(points):
                if case.load_unload and number < count:
                    continue  # the curve is computed anew; stored states stay
                step = self.step_of(point, number if case.load_unload else count + number)
                last = step.row
                self._bifurcations += [point] if point.bifurcation else []
                yield step
        except PathEnd as end:
            text = explain(case, end, self.fields, path, _own_words())
            raise PathEnded(text, NO_EQUILIBRIUM if end.physical else FAILED) from end
        except NoConvergence as failure:
            raise RunError(explain_failure(case, failure, last, _own_words())) from failure

    def _check_volumes(self, start: State | None) -> None:
        """Raise `RunError` for requested volumes below the one that the cavity has under the preload, where the path begins,
        the drivers coupled for it; None for the undeformed state."""
        if start is None or not self.case.volumes_ml:
            return
        system = self.solver.system
        taken = (start.V - system.rest().V) * system.volume_unit * 1e6
        system.load(start)
        if passed := [value for value in self.case.volumes_ml if 0.0 < value < taken]:
            raise RunError(
                f"{passed[0]:g} ml are not on this path: the preload has already added "
                f"{taken:.4g} ml to the undeformed cavity; request more than that, or 0 for the preloaded state",
                NO_EQUILIBRIUM,
            )

    def _goals(self) -> list[float]:
        """Return the requested values, dimensionless."""
        scale = self.model.unit_of(self.case.quantity)
        return [goal / scale for goal in self.case.goals]

    def quantity(self, name: str) -> PathQuantity:
        """Return a requested quantity by its name; the stroke is that of the case's supply."""
        eq, supply = self.solver.system, self.case.supply
        if supply is None or name in DIRECT:
            return DIRECT[name]
        return supply.control(eq.rest().V * eq.volume_unit, eq.stress_unit, eq.volume_unit)

    def _continuation(self, last: float) -> Continuation:
        case = self.case
        path = Continuation(self.solver, self.quantity(case.quantity), case.control, last / FEWEST_STEPS)
        path.report = lambda text: self.listener.say(f"  {text}")
        return path

    def _program(self, begun: Begun) -> Iterator[Step]:
        """Follow the device's program."""
        case, rows = self.case, list(begun.rows)
        come = float(begun.stop.number) if begun.stop else 0.0
        try:
            say = self.listener.say
            hung = self.model.preload(say)
            self.model.set_in_motion()
            begun.recall()
            settings = schedule.Settings(case.cm, case.control, say, case.time_tolerance)
            gas = self.quantity(Gas.name) if case.supply else None
            if isinstance(gas, Gas):
                points = schedule.supply(self.solver, case.program, gas, settings, begun.stop, hung)
            else:
                points = schedule.follow(self.solver, case.program, settings, begun.stop, hung)
            for come, point in points:
                step = self.step_of(point, len(rows), come)
                rows.append(step.row)
                yield step
        except PathEnd as end:
            text = explain_step(case, end, rows, come, _own_words())
            raise PathEnded(text, NO_EQUILIBRIUM if end.physical else FAILED) from end
        except NoConvergence as failure:
            raise RunError(explain_failure(case, failure, rows[-1] if rows else None, _own_words())) from failure

    @property
    def bifurcates(self) -> bool:
        """Whether `steps` has passed a bifurcation, from which `branch` can start."""
        return bool(self._bifurcations)

    def branch(self) -> Iterator[Step]:
        """Follow the branch at the first bifurcation, after `steps`, as far as it
        converges; report its end to the listener."""
        yield from self._reported(self._branch())

    def _branch(self) -> Iterator[Step]:
        assert self._path is not None
        start = self._bifurcations[0]
        value = self._path.value(start.state) * self.model.unit_of(self.case.quantity) / self.case.load.scale
        self.listener.say(f"following the branch from {value:.4g} {self.case.unit}")
        try:
            for number, point in enumerate(follow(self._path, start, farthest=max(self._goals()))):
                yield self.step_of(point, number)
        except (PathEnd, NoConvergence) as end:
            self.listener.say(f"the branch ends here: {end}")

    def release(self) -> None:
        """Release the PETSc and MPI objects of the device; see `Solver.release`."""
        if hasattr(self, "solver"):
            self.solver.release()

    def _stop_if_asked(self) -> None:
        if any_rank(self.comm, self.stopped()):
            raise RunError(INTERRUPTED, STOPPED)

    def _stop_here(self) -> None:
        """As `_stop_if_asked`, on this rank only."""
        if self.stopped():
            raise RunError(INTERRUPTED, STOPPED)

    def step_of(self, point: Point, number: int, come: float = 0.0) -> Step:
        """Return a point of the path in SI units; ``come`` is the number of program steps taken."""
        case, fields = self.case, self.fields
        figures = fields.figures(point.state)
        nodal = fields.nodal(point.state)  # on rank 0 only
        mode = None if point.mode is None else fields.shape(point.mode)
        if nodal is not None and mode is not None:
            nodal["mode"] = mode / np.abs(mode).max()
        band = self._band.cells(point) if self._band else {}
        row = on_root(self.comm, lambda: row_of(Solved(case, fields, point, figures, nodal or {}, number, come, band)))
        return Step(row, nodal, restart_of(point))


def _own_words() -> bool:
    """Return whether the user gave PETSc options."""
    return bool(PETSc.Options().getAll())


class InMemory(States):
    """States of a prepared simulation in memory, identical on all ranks; its mesh's file is read on rank 0."""

    def __init__(self, simulation: Simulation, mesh: Callable[[], bytes]):
        self._comm, grid = simulation.comm, simulation.fields.grid
        # Only rank 0 has the whole grid.
        points, cells, self._mesh = on_root(self._comm, lambda: (grid.points, grid.cells, mesh()))
        kept: list[dict[str, Array]] = []
        super().__init__(simulation.case, (), (points, cells, grid.cell_name), lambda step, name: kept[step][name])
        self._fields = kept
        self._restarts: list[Restart] = []

    def add(self, step: Step) -> None:
        """Keep a state."""
        self.rows.append(step.row)
        self._fields.append(on_root(self._comm, lambda: step.fields or {}))
        self._restarts.append(step.restart)

    def fields(self, step: int, names: Sequence[str] | None = None) -> Mapping[str, Array]:
        there = self._fields[step]
        return there if names is None else {name: there[name] for name in names}

    def restart(self, step: int) -> Restart:
        return self._restarts[step]

    def mesh(self) -> bytes:
        return self._mesh


# ----------------------------------------------------------------------------------------------------------------------
# Solve a case with every other source of its silicone, on the mesh of the run.


def solve_sources(simulation: Simulation, mesh: Path) -> dict[str, list[Row]]:
    """Follow the path of each other source of a case's band, on its mesh's file; all ranks call it. Return rows by the
    sources' names, on all ranks; empty where the case has no such band. A path that ends early has the rows up to there.
    `RunError` if the user stopped it."""
    case, band = simulation.case, simulation.case.band
    if not isinstance(band, SourceBand):
        return {}
    found: dict[str, list[Row]] = {}
    others = band.others(case.material)
    for number, (name, material) in enumerate(others.items(), 1):
        simulation.listener.say(f"solving with {name}, source {number} of {len(others)} besides the run's own")
        aside = Simulation(
            dataclasses.replace(case, material=material, band=None), simulation.comm, None, simulation.stopped
        )
        rows = found[name] = []
        try:
            aside.prepare(mesh)
            for step in aside.steps():
                rows.append(step.row)
        except PathEnded as end:
            simulation.listener.say(f"  {end}")
        except RunError as error:
            if error.status == STOPPED:
                raise
            simulation.listener.say(f"  the path of {name} ends here: {error}")
        finally:
            aside.release()
    return {name: rows for name, rows in found.items() if rows}
