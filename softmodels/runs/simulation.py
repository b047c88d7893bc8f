"""A case, solved: its device meshed and made ready, and its path followed state by state."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from geometries import MeshingStopped, kept_meshes
from softmodels.case.case import Case
from softmodels.case.material_errors import MaterialErrors
from softmodels.materials.stability import weakness
from softmodels.mechanics import c_library
from softmodels.mechanics.compiling import CompilingError, cache, compiling, wait_for_cache
from softmodels.mechanics.mpi import any_rank, is_root, on_root
from softmodels.results.column import Solved
from softmodels.results.columns import row_of
from softmodels.results.outcomes import FAILED, NO_EQUILIBRIUM, STOPPED, RunError
from softmodels.results.restart import restart_of
from softmodels.runs.beginning import Beginning
from softmodels.runs.explanation import explain, explain_failure, explain_step
from softmodels.runs.step import FROM_REST, Begun, Listener, PathEnded, Silent, Step

if TYPE_CHECKING:
    from mpi4py import MPI

    from softmodels.mechanics.body import Body
    from softmodels.mechanics.solver import Solver
    from softmodels.path.continuation import Continuation
    from softmodels.path.points import Point
    from softmodels.path.quantities import Quantity
    from softmodels.results.band import Band
    from softmodels.results.fields import Fields

Array = npt.NDArray[np.float64]

COARSE = 0.01
"""Error of the cavity's volume by its mesh from which it is warned of."""
FEWEST_STEPS = 12
"""At least this many steps to the last requested value, for curves worth drawing."""


class Simulation:
    """A case's device on a communicator, and its path.

    In order: `write_mesh` (or a mesh file from before), `prepare`, `steps`, perhaps `branch`, `release`. Every call is
    made by all ranks.

    Args:
        case: What to run.
        comm: The communicator.
        listener: Is told how it goes on.
        stopped: Asked between states, and while a mesh is made; once it is true on a rank, the run ends.

    Attributes:
        body, solver, fields: The device, once it is prepared.
        beginning: Where its path begins, likewise.
    """

    body: Body
    solver: Solver
    fields: Fields
    beginning: Beginning

    def __init__(
        self, case: Case, comm: MPI.Comm, listener: Listener | None = None, stopped: Callable[[], bool] = bool
    ):
        self.case, self.comm, self.stopped = case, comm, stopped
        self.listener: Listener = listener or Silent()
        self._path: Continuation | None = None
        self._bifurcations: list[Point] = []

    def write_mesh(self, file: Path) -> None:
        """Mesh the device into a Gmsh file, on rank 0.

        Raises:
            RunError: It was stopped meanwhile.
            GeometryError, MeshingError, OSError: See `Actuator.write`.
        """
        device = self.case.actuator
        self.listener.say(kept_meshes.told(device))
        if device.dimension == 3 and is_root(self.comm):
            c_library.begin("moduli")
        try:
            on_root(self.comm, lambda: device.write(file, self.stopped))
        except MeshingStopped:
            raise RunError("stopped by the user while the mesh was made; nothing is solved yet", STOPPED) from None

    def prepare(self, file: Path) -> None:
        """Read the mesh and make the equations, which are compiled the first time.

        Raises:
            RunError: The mesh is of another device, or nothing can be compiled.
            MeshFileError: No mesh as `write_mesh` makes them.
        """
        from softmodels.mechanics.body import Body, BodyError
        from softmodels.mechanics.solver import Solver
        from softmodels.mechanics.system import System
        from softmodels.results.fields import Fields

        case, say = self.case, self.listener.say
        say("preparing the equations (compiled the first time, some ten seconds; then from the cache)")
        on_root(self.comm, lambda: wait_for_cache(cache(), say, self.stopped))
        self._stop_if_asked()
        try:
            self.body = Body.from_file(case.actuator, file, self.comm)
            with compiling():
                system = System(self.body, case.material, case.formulation, case.sheet, case.obstacle, case.parts)
                self.solver = Solver(system, case.solver)
                self.fields = Fields(self.solver, case.gauges)
                self._band = self._make_band()
            self.beginning = Beginning(case, self.solver, say)
        except (BodyError, CompilingError) as error:
            raise RunError(str(error)) from error

    def _make_band(self) -> Band | None:
        from softmodels.results.band import Band

        case = self.case
        return Band(self.fields, case.band, case.cm, case.quantity) if isinstance(case.band, MaterialErrors) else None

    def describe(self) -> None:
        """Report what is solved: followed points, sizes, and how far the law can be trusted."""
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
                f"warning: the cavity of the mesh has {amount} {kind} volume than the device's: its curves need smaller cells, "
                "or a face around the air is not among its walls"
            )
        if weak := weakness(self.case.material):
            say(f"warning: {weak}; states stretched further are not the silicone's")

    def steps(self, begun: Begun = FROM_REST) -> Iterator[Step]:
        """Solve state by state, through all requested values.

        Args:
            begun: What is known already and not given again.

        Raises:
            PathEnded: The path ends before the last requested value, with where, why, and what can be done.
            RunError: It was stopped between two states, or no state was found where no step can be shortened.
        """
        yield from self._reported(self._program(begun) if self.case.program else self._load_path(begun))

    def _reported(self, steps: Iterator[Step]) -> Iterator[Step]:
        """The same steps; the listener is told of each once it was taken, and between them the run may be stopped."""
        for step in steps:
            yield step
            if is_root(self.comm):
                self.listener.step(step.row, step.row[self.case.column])
            self._stop_if_asked()

    def _load_path(self, begun: Begun) -> Iterator[Step]:
        from softmodels.mechanics.newton import NoConvergence
        from softmodels.path.continuation import trace
        from softmodels.path.points import PathEnd
        from softmodels.path.pressure_cycle import cycle

        case, count = self.case, len(begun.rows)
        last = begun.rows[-1] if begun.rows else None
        goals = self._goals()
        self._path = path = self._continuation(goals[-1])
        path.start, path.recall = self.beginning.state(), begun.recall
        self.beginning.check_volumes(path.start)
        if begun.rows and not case.cycle:
            goals = [goal for goal, wanted in zip(goals, begun.left, strict=True) if wanted]
        try:
            for number, point in enumerate(cycle(path, goals) if case.cycle else trace(path, goals, begun.points)):
                if case.cycle and number < count:
                    continue  # a cycle is read off one curve, which is followed anew; what was stored of it stays
                step = self.step_of(point, number if case.cycle else count + number)
                last = step.row
                self._bifurcations += [point] if point.bifurcation else []
                yield step
        except PathEnd as end:
            text = explain(case, end, self.fields, path, _own_words())
            raise PathEnded(text, NO_EQUILIBRIUM if end.physical else FAILED) from end
        except NoConvergence as failure:
            raise RunError(explain_failure(case, failure, last, _own_words())) from failure

    def _goals(self) -> list[float]:
        """The requested values, dimensionless."""
        scale = self.beginning.unit_of(self.case.quantity)
        return [goal / scale for goal in self.case.goals]

    def quantity(self, name: str) -> Quantity:
        """What a path is asked for, by its name; the stroke is that of the case's supply."""
        from softmodels.path.quantities import DIRECT

        eq, supply = self.solver.system, self.case.supply
        if supply is None or name in DIRECT:
            return DIRECT[name]
        return supply.control(eq.rest().V * eq.volume_unit, eq.stress_unit, eq.volume_unit)

    def _continuation(self, last: float) -> Continuation:
        from softmodels.path.continuation import Continuation

        case = self.case
        path = Continuation(self.solver, self.quantity(case.quantity), case.control, last / FEWEST_STEPS)
        path.report = lambda text: self.listener.say(f"  {text}")
        return path

    def _program(self, begun: Begun) -> Iterator[Step]:
        """Take the device through its program."""
        from softmodels.mechanics.newton import NoConvergence
        from softmodels.path.points import PathEnd
        from softmodels.path.schedule import follow

        case, rows = self.case, list(begun.rows)
        come = float(begun.stop.number) if begun.stop else 0.0
        try:
            hung, say = self.beginning.hung(), self.listener.say
            begun.recall()
            for come, point in follow(self.solver, case.program, case.cm, case.control, say, begun.stop, hung):
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
        """Whether `steps` has met a bifurcation, from which `branch` can go on."""
        return bool(self._bifurcations)

    def branch(self) -> Iterator[Step]:
        """Follow the branch that leaves the path at its first bifurcation, after `steps`; it ends where it can be followed
        no further, which is reported to the listener."""
        yield from self._reported(self._branch())

    def _branch(self) -> Iterator[Step]:
        from softmodels.mechanics.newton import NoConvergence
        from softmodels.path.branching import follow
        from softmodels.path.points import PathEnd

        assert self._path is not None
        start = self._bifurcations[0]
        value = self._path.value(start.state) * self.beginning.unit_of(self.case.quantity) / self.case.load.scale
        self.listener.say(f"following the branch from {value:.4g} {self.case.unit}")
        try:
            for number, point in enumerate(follow(self._path, start, farthest=max(self._goals()))):
                yield self.step_of(point, number)
        except (PathEnd, NoConvergence) as end:
            self.listener.say(f"the branch was followed no further: {end}")

    def release(self) -> None:
        """Give back what PETSc and MPI hold for the device; see `Solver.release`."""
        if hasattr(self, "solver"):
            self.solver.release()

    def _stop_if_asked(self) -> None:
        if any_rank(self.comm, self.stopped()):
            raise RunError("stopped by the user; go on with --resume", STOPPED)

    def step_of(self, point: Point, number: int, come: float = 0.0) -> Step:
        """A point of the path in SI units; ``come`` is how many steps a program has come."""
        case, fields = self.case, self.fields
        figures = fields.figures(point.state)
        nodal = fields.nodal(point.state)  # on rank 0 alone
        if point.mode is not None:
            mode = fields.shape(point.mode)
            more = None if mode is None else {"mode": mode / np.abs(mode).max()}
        else:
            more = fields.raw(point.state, point.tangent)
        whole = None if nodal is None or more is None else {**nodal, **more}
        band = self._band.cells(point) if self._band else {}
        row = on_root(self.comm, lambda: row_of(Solved(case, fields, point, figures, whole or {}, number, come, band)))
        return Step(row, whole, restart_of(point))


def _own_words() -> bool:
    """Whether PETSc was given options beside those of this program."""
    from petsc4py import PETSc

    return bool(PETSc.Options().getAll())
