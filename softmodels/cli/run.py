"""From a case to a folder of results: the one way in which every command runs a device.

Exit status: 0 all requested values reached; 1 the run failed; 2 bad input, found before anything was solved; 3 a requested
value is not on the path (a limit point); 130 stopped by the user. Whatever happened, all steps up to it are in the folder.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from geometries import GeometryError, MeshFileError, MeshingError, MeshingStopped
from measurement.ending import bounded
from measurement.folder_lock import InUseError
from measurement.output_place import FULL
from measurement.own_folder import OwnFolderError
from softmodels.case.case import Case, CaseError
from softmodels.case.gauges import GaugeError
from softmodels.case.identity import digest
from softmodels.cli.closing import close, explain, explain_step, gather
from softmodels.cli.progress import Progress
from softmodels.cli.start import begin, mesh_is_known
from softmodels.materials.laws import MaterialError
from softmodels.materials.stability import weakness
from softmodels.mechanics.compiling import CompilingError, cache, compiling, wait_for_cache
from softmodels.mechanics.contact import ObstacleError
from softmodels.mechanics.mpi import abort_on_error, any_rank, is_root, on_root, petsc_reason, start
from softmodels.results.columns import restart_of, row_of
from softmodels.results.lost_path import advice
from softmodels.results.notes import notes_of
from softmodels.results.outcomes import BAD_INPUT, DONE, FAILED, NO_EQUILIBRIUM, NO_MEMORY, STOPPED, RunError
from softmodels.results.resume import last_stop, stopped_at, stored_points
from softmodels.results.stability_report import unlocated, unseen
from softmodels.results.store import BRANCH, Results, ResultsError, write_text

FEWEST_STEPS = 12
"""At least this many steps to the last requested value, for curves worth drawing."""


def _nobody() -> contextlib.AbstractContextManager[Callable[[], bool]]:
    """Nobody asks to stop, but for exceptions."""
    return contextlib.nullcontext(bool)


def run(
    case: Case,
    folder: Path | None,
    *,
    resume: bool = False,
    quiet: bool = False,
    petsc: Sequence[str] = (),
    draw: bool = True,
    branch: bool = False,
    inputs: Sequence[Path] = (),
    interrupts: Callable[[], contextlib.AbstractContextManager[Callable[[], bool]]] = _nobody,
) -> int:
    """Run a case and return the exit status; all messages go to standard error, the summary to standard output.

    Args:
        case: What to run.
        folder: Where the results go; None for the first of ``results/NAME``, ``results/NAME-2`` ... that is free or holds
            a run of this very case.
        resume: Go on from what an interrupted run of the same case left there.
        quiet: Only errors are said.
        petsc: Words for PETSc's option database.
        draw: Make the pictures at the end.
        branch: Follow the branch that leaves the path at its first bifurcation too, into the folder ``branch``.
        inputs: Files that the user has given: they are never written.
        interrupts: Entered while states are solved; gives whether to stop, asked between them. No signal is handled unless
            here, as a command does by `asked_to_stop`; may be called in any thread.

    Raises:
        StartError: PETSc cannot take the words.
    """
    comm = start(petsc)
    abort_on_error(comm)
    from petsc4py import PETSc

    results: Results | None = None
    progress = Progress(case.values[-1], case.unit, case.actuator.gauge, quiet or not is_root(comm))
    status, message = DONE, ""
    try:
        with progress, interrupts() as stopped:
            results, resumed = _begin(case, folder, resume, draw, inputs, comm)
            progress.say(f"results go to {results.own.path}")
            message = _follow(case, results, comm, progress, stopped, resumed, branch)
    except RunError as error:
        status, message = error.status, str(error)
    except (
        GaugeError, GeometryError, MeshFileError, MeshingError, CaseError, MaterialError, ObstacleError, ResultsError,
        OwnFolderError, InUseError,
    ) as error:  # fmt: skip
        status, message = FAILED if isinstance(error, MeshingError) else BAD_INPUT, str(error)
    except PETSc.Error as error:
        # What PETSc refuses before anything is solved are the words it was given.
        words = bool(petsc) and not on_root(comm, lambda: results and results.stored)
        advice = (
            "check the words after --"
            if words
            else "rerun with -- -snes_monitor -ksp_error_if_not_converged to see more"
        )
        status, message = BAD_INPUT if words else FAILED, f"PETSc stopped ({petsc_reason(error)}); {advice}"
    except OSError as error:
        advice = "make room for them" if error.errno in FULL else "see that they can"
        status, message = FAILED, f"{_unwritten(error)}; {advice} and go on with --resume"
    except MemoryError:
        status, message = FAILED, NO_MEMORY
    except BaseException:  # a caller's Ctrl-C among them
        if results is not None and is_root(comm):
            results.own.leave()
        raise
    return on_root(comm, lambda: _end(case, results, status, message, quiet, draw))


def _begin(
    case: Case, folder: Path | None, resume: bool, draw: bool, inputs: Sequence[Path], comm: Any
) -> tuple[Results, bool]:
    """The results on every rank (rank 0 alone writes them), and whether there are states to go on from."""
    begun: list[Results] = []

    def on_rank_0() -> tuple[Path, Path, bool]:
        results, resumed = begin(case, folder, resume, draw, inputs)
        begun.append(results)
        return results.own.path, results.folder, resumed

    home, at, resumed = on_root(comm, on_rank_0)
    results = begun[0] if begun else Results(home, case.name, case.actuator.gauge)
    results.folder = at
    return results, resumed


def _end(case: Case, results: Results | None, status: int, message: str, quiet: bool, draw: bool) -> int:
    """Close the run and let go of its folder."""
    if results is None:
        print(f"softmodels: {bounded(message)}", file=sys.stderr)
        return status
    try:
        return close(case, results, status, message, quiet, draw)
    finally:
        results.own.leave()


def _unwritten(error: OSError) -> str:
    place = f" into {Path(error.filename).parent}" if isinstance(error.filename, str) else ""
    return f"the results cannot be written{place} ({error.strerror or error})"


def _follow(
    case: Case,
    results: Results,
    comm: Any,
    progress: Progress,
    stopped: Callable[[], bool],
    resumed: bool,
    branch: bool,
) -> str:
    """Solve, and write every step; returns the closing sentence."""
    from softmodels.mechanics.body import Body, BodyError
    from softmodels.mechanics.solver import Equilibrium, NoConvergence
    from softmodels.path.continuation import Path as LoadPath
    from softmodels.path.continuation import trace
    from softmodels.path.points import PathEnd
    from softmodels.path.pressure_cycle import cycle
    from softmodels.results.fields import Fields

    mesh = results.folder / f"{case.name}.msh"
    if not (resumed and on_root(comm, lambda: mesh_is_known(results, mesh))):
        kind = "solid" if case.actuator.dimension == 3 else "axisymmetric section"
        progress.say(f"meshing {type(case.actuator).__name__} ({kind}, 1/{case.actuator.copies})")
        try:
            on_root(comm, lambda: case.actuator.write(mesh, stopped))
        except MeshingStopped:
            raise RunError("stopped by the user while the mesh was made; nothing is solved yet", STOPPED) from None
        on_root(comm, lambda: results.record(mesh=digest(mesh)))
    progress.say("preparing the equations (compiled the first time, half a minute; then from the cache)")
    on_root(comm, lambda: wait_for_cache(cache(), progress.say, stopped))
    _stop_if_asked(comm, stopped)
    try:
        body = Body.from_file(case.actuator, mesh, comm)
        with compiling():
            equilibrium = Equilibrium(body, case.material, case.formulation, case.sheet, case.obstacle)
            fields = Fields(equilibrium, case.gauges)
    except (BodyError, CompilingError) as error:
        raise RunError(str(error)) from error
    dofs = equilibrium.space.dofmap.index_map.size_global * equilibrium.space.dofmap.index_map_bs
    cells = body.mesh.topology.index_map(body.mesh.topology.dim).size_global
    if resumed:
        on_root(comm, lambda: results.check_grid(fields.grid.points))
    for text in fields.followed:
        progress.say(text)
    progress.say(f"{cells} cells, {dofs} unknowns, {comm.size} rank{'s' if comm.size > 1 else ''}")

    if weak := weakness(case.material):
        progress.say(f"warning: {weak}; states stretched further are not the silicone's")
    if case.program:
        return _follow_program(case, results, fields, comm, progress, stopped, resumed)
    scale = equilibrium.stress_unit if case.pressures_cm else equilibrium.volume_unit
    goals = [goal / scale for goal in case.goals]
    supply = None
    if case.supply is not None:
        cavity = equilibrium.rest().V * equilibrium.volume_unit
        supply = case.supply.control(cavity, equilibrium.stress_unit, equilibrium.volume_unit)
    path = LoadPath(equilibrium, case.control, case.quantity, goals[-1] / FEWEST_STEPS, supply)
    path.report = lambda text: progress.say(f"  {text}")
    known: list[Any] = []
    if resumed and not case.cycle:
        left = on_root(comm, lambda: [not stopped_at(results, case.column, value) for value in case.values])
        goals = [goal for goal, wanted in zip(goals, left, strict=True) if wanted]
        known = stored_points(results, fields, comm)
        progress.say(f"going on from step {on_root(comm, lambda: len(results.stored) - 1)}")
    elif not resumed:
        on_root(comm, lambda: results.begin(fields.grid.points, fields.grid.cells, fields.grid.cell_name))
    bifurcations, lost = [], None
    stored = on_root(comm, lambda: len(results.stored))
    try:
        for number, point in enumerate(cycle(path, goals) if case.cycle else trace(path, goals, known)):
            if case.cycle and number < stored:
                continue  # a cycle is read off one curve, which is followed anew; what was stored of it stays
            _keep(case, results, fields, comm, progress, point)
            bifurcations += [point] if point.bifurcation else []
            _stop_if_asked(comm, stopped)
    except PathEnd as end:
        lost = RunError(explain(case, end, fields, path, _own_words()), NO_EQUILIBRIUM if end.limit else FAILED)
    except NoConvergence as failure:
        raise _lost(case, results, comm, failure) from failure
    if branch:
        _follow_branch(case, results, fields, comm, progress, stopped, path, bifurcations)
    if lost is not None:
        raise lost
    return ""


def _own_words() -> bool:
    """Whether PETSc was given options beside those of this program."""
    from petsc4py import PETSc

    return bool(PETSc.Options().getAll())


def _lost(case: Case, results: Results, comm: Any, failure: Exception) -> RunError:
    """At the first state or a limit point, where there is no step to shorten."""
    row = on_root(comm, lambda: results.rows[-1] if results.rows else None)
    words = "leave out PETSc's options (what follows --), " if _own_words() else ""
    told = f"{words}refine the mesh (--cell-size), or use another --control"
    return RunError(
        f"the path could not be followed ({failure})" + (f"; {told}" if row is None else f". {advice(case, row)}")
    )


def _follow_program(
    case: Case, results: Results, fields: Any, comm: Any, progress: Progress, stopped: Callable[[], bool], resumed: bool
) -> str:
    """Take the device through its program, and write every state."""
    from softmodels.mechanics.solver import NoConvergence
    from softmodels.path.points import PathEnd
    from softmodels.path.schedule import follow

    begin, come = None, 0.0
    if resumed:
        begin = last_stop(case, results, fields, comm)
        come = float(begin.number)
        progress.say(f"going on from step {begin.number} of the program")
    else:
        on_root(comm, lambda: results.begin(fields.grid.points, fields.grid.cells, fields.grid.cell_name))
    try:
        for come, point in follow(fields.equilibrium, case.program, case.cm, case.control, progress.say, begin):
            _keep(case, results, fields, comm, progress, point, come)
            _stop_if_asked(comm, stopped)
    except PathEnd as end:
        rows = on_root(comm, lambda: results.rows)
        raise RunError(
            explain_step(case, end, rows, come, _own_words()), NO_EQUILIBRIUM if end.limit else FAILED
        ) from end
    except NoConvergence as failure:
        raise _lost(case, results, comm, failure) from failure
    return ""


def _follow_branch(
    case: Case, results: Results, fields: Any, comm: Any, progress: Progress, stopped: Callable[[], bool], path: Any,
    bifurcations: list[Any],
) -> None:  # fmt: skip
    """Follow the branch at the first bifurcation into a folder of its own."""
    from softmodels.mechanics.solver import NoConvergence
    from softmodels.path.branching import follow
    from softmodels.path.points import PathEnd

    if not bifurcations:
        hidden = unseen(case.actuator)
        text = f"no bifurcation on this path, so there is no branch to follow{f'; {hidden}' if hidden else ''}"
        text = on_root(comm, lambda: unlocated(results.rows)) or text
        if on_root(comm, lambda: any(row.get("bifurcation") for row in results.rows)):
            text = (
                "the bifurcation was met before the run was gone on with; run it without --resume to follow the branch"
            )
        progress.say(text)
        return
    aside = results.branch()
    on_root(comm, lambda: results.own.claim([BRANCH]))
    on_root(comm, aside.clear)
    on_root(comm, lambda: write_text(aside.folder / "case.toml", case.to_toml()))
    on_root(comm, lambda: aside.begin(fields.grid.points, fields.grid.cells, fields.grid.cell_name))
    progress.say(f"following the branch from {bifurcations[0].state.P * path.equilibrium.stress_unit / case.cm:.4g} cm")
    farthest = max(case.goals) / (path.equilibrium.stress_unit if case.pressures_cm else path.equilibrium.volume_unit)
    try:
        for point in follow(path, bifurcations[0], farthest=farthest):
            _keep(case, aside, fields, comm, progress, point)
            _stop_if_asked(comm, stopped)
    except (PathEnd, NoConvergence) as end:
        progress.say(f"the branch was followed no further: {end}")
    on_root(comm, lambda: gather(case, aside, DONE, "", notes_of(case, aside.rows)) if aside.stored else None)


def _stop_if_asked(comm: Any, stopped: Callable[[], bool]) -> None:
    if any_rank(comm, stopped()):
        raise RunError("stopped by the user; go on with --resume", STOPPED)


def _keep(
    case: Case, results: Results, fields: Any, comm: Any, progress: Progress, point: Any, come: float = 0.0
) -> None:
    """Write one point of the path; ``come`` is how many steps a program has come."""
    figures = fields.figures(point.state)
    nodal: Any = fields.nodal(point.state)  # on rank 0 alone
    if point.bifurcation:
        mode = fields.shape(point.mode)
        nodal = None if nodal is None else {**nodal, "mode": mode / np.abs(mode).max()}
    else:
        raw = fields.raw(point.state, point.tangent)
        nodal = None if nodal is None or raw is None else {**nodal, **raw}

    def write() -> None:
        row = row_of(case, fields, point, figures, nodal, len(results.stored), come)
        results.add(row, nodal, restart_of(point))
        progress.step(row, row[case.column])

    on_root(comm, write)
