"""Write a simulation into a results folder while it runs, and resume an interrupted run."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import itertools
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from time import monotonic, process_time
from typing import TypedDict

import numpy as np

from softmodels.case.case import Case, difference, identity
from softmodels.common import commands, errors, files, folders
from softmodels.common.lazy import MPI
from softmodels.materials.silicones import stretch_at_break
from softmodels.mechanics import controls, mpi
from softmodels.mechanics.system import State
from softmodels.path import stability, steps
from softmodels.path.continuation import LoadedState
from softmodels.runs import columns, formats, labels, notes, outcomes, store, table
from softmodels.runs.fields import Fields
from softmodels.runs.notes import events
from softmodels.runs.outcomes import RunError
from softmodels.runs.simulation import FROM_REST, RunStart, Simulation, solve_meshes, solve_sources
from softmodels.runs.states import StoredStates

# ----------------------------------------------------------------------------------------------------------------------
# Resume an interrupted run: check that the case matches the stored results, and load the states to continue from.


def check_same(case: Case, old: Case, known: Mapping[str, str], wanted: Mapping[str, str], folder: Path) -> None:
    """Raise `RunError`, with the first difference, where a run differs from this case in more than the requested values.

    ``old`` is the case of the folder's case file, ``known`` and ``wanted`` are the `identity` of its states and of this case.
    """
    if (name := difference(known, wanted)) is not None:
        what = name.removeprefix("components.").split(".")[0]
        there, here = (table.get(name, "not given") for table in (known, wanted))
        other = f"another {what} ({name} is {there} there, {here} here); resume with its options"
    elif case.load_unload and case.values != old.values:
        other = "a --load-unload through other pressures; resume with the same pressures"
    elif case.program != old.program or (case.program and not steps.goes_on(case.steps, old.steps)):
        other = "other steps; resume with the same steps (further ones may follow)"
    elif old.quantity != case.quantity:
        other = f"requested {old.quantity}s; resume with the same"
    else:
        return
    raise RunError(f"{folder} holds a run with {other}, or run without --resume", commands.EXIT_BAD_INPUT)


def set_back(case: Case, results: store.Results) -> None:
    """Go back to the last state that is not found between two steps, or within a step of a program, but for its beginning. The
    others are found again, and stay until then."""
    while len(results.stored) > 1:
        row = results.rows[-1]
        between = any(row.get(name) for name in ("limit", "bifurcation", "stroke_limit", "jump")) or (
            row["requested"] and row["step"] and row.cells["control"] != case.quantity
        )
        if not (not row["requested"] if case.program else between):
            return
        last = results.stored.pop()
        results.later = {len(results.stored): last} | results.later


def check_values(case: Case, results: store.Results) -> None:
    """Reject requested values that the stored states have passed without stopping."""
    reached = max((row[case.variable] for row in results.rows), default=0.0)
    for value in case.values:
        if 0.0 < value < reached * (1 - 1e-9) and not stopped_at(case, results, value):
            text = f"{results.folder} holds a run that passed {case.load.told(value, 'g')} without stopping there"
            raise RunError(f"{text}; resume with the run's own values, or run without --resume", commands.EXIT_BAD_INPUT)


def last_stop(case: Case, results: store.Results, fields: Fields, comm: MPI.Comm) -> LoadedState:
    """Return the end of a program's step that the stored states end with."""
    last, row, record = mpi.on_root(comm, lambda: (len(results.stored) - 1, results.rows[-1], results.stored[-1].restart))
    state = stored_state(results, fields, comm, last, record["P"], record["V"])
    system = fields.system
    pressures = [row[name] / system.stress_unit for name in columns.of_cavities(row, "pressure")]
    dead = [row[load.variables[0]] for load in system.dead.loads] / system.dead.units
    system.load(state)
    drives = np.concatenate([pressures[: len(system.body.actuator.ratios)], dead])
    return LoadedState(state, drives, system.driven(), number=round(row["load_step"]))


def stopped_at(case: Case, results: store.Results, value: float) -> bool:
    """Return whether a requested value is among the stored states."""
    return any(row["requested"] and columns.stands_at(row, case, value) for row in results.rows)


def stored_points(results: store.Results, fields: Fields, comm: MPI.Comm) -> list[stability.Point]:
    """The points a trace goes on from: bifurcations, the first limit point, the last turn of a stroke, and the last two."""
    records = mpi.on_root(comm, lambda: [stored.restart for stored in results.stored])
    # A bifurcation is interpolated: the path did not continue from it.
    branching = mpi.on_root(comm, lambda: np.flatnonzero(results.rows["bifurcation"]).tolist())
    solved = [i for i in range(len(records)) if i not in branching]
    limits = [i for i, record in enumerate(records) if record["limit"]][:1]
    turns = [i for i, record in enumerate(records) if record["turn"]][-1:]
    chosen = sorted({*limits, *turns, *solved[-2:], *branching})
    return [stored_point(results, fields, comm, i, records[i], i in branching) for i in chosen]


def replay(results: store.Results | StoredStates, fields: Fields, comm: MPI.Comm, steps: Mapping[int, float]) -> None:
    """Restore what friction, silicone and motion remember, by going through stored steps, whose times in s are given."""
    potential, last = fields.system.potential, 0.0
    for step, time in steps.items() if potential.remembers else ():
        potential.pass_time(time - last)
        if potential.motion and time == last:
            potential.motion.jump()
        potential.commit(stored_state(results, fields, comm, step, 0.0, 0.0).w)
        last = time


def stored_point(
    results: store.Results | StoredStates,
    fields: Fields,
    comm: MPI.Comm,
    step: int,
    restart: formats.Restart,
    branching: bool,
) -> stability.Point:
    """The point of a stored step; of its tangent the changes of P and V alone are stored."""
    state = stored_state(results, fields, comm, step, restart["P"], restart["V"])
    tangent = controls.Tangent(np.zeros_like(state.w), *restart["tangent"])
    mode = None
    if branching:
        nodal = results.fields(step, ("mode",)) if mpi.is_root(comm) else None
        shape = None if nodal is None else {"displacement": nodal["mode"], "p": np.zeros(len(nodal["mode"]))}
        mode = fields.state(shape, 0.0, 0.0).w
        mode /= mpi.largest(comm, float(np.abs(mode).max()))
    plain = {name: restart[name] for name in formats.POINT_FIELDS}
    return stability.Point(state, tangent, signature=stability.Signature(**restart["signature"]), mode=mode, **plain)


def stored_state(results: store.Results | StoredStates, fields: Fields, comm: MPI.Comm, step: int, P: float, V: float) -> State:
    """A stored step's state."""
    return fields.state(results.fields(step, ("displacement", "p")) if mpi.is_root(comm) else None, P, V)


@dataclasses.dataclass(frozen=True)
class ResultsPlace:
    """A folder to solve into.

    Attributes:
        folder: All ranks see it. None for the first of ``results/NAME``, ``results/NAME-2`` ... that `take_default` finds.
        resume: Go on from what an interrupted run of the same case has left.
        inputs: Files that the user has given: they are never written.
        draw: Whether pictures are to be drawn there too.
        budget: Whether the mesh error is estimated too, where that costs little.
    """

    folder: Path | None = None
    resume: bool = False
    inputs: Sequence[Path] = ()
    draw: bool = False
    budget: bool = False


def begin(case: Case, place: ResultsPlace) -> tuple[store.Results, bool]:
    """Take a folder for a run and prepare it; return the results, locked, and whether there are states to go on from.
    RunError, OwnFolderError, InUseError, ResultsError or CaseError if the folder, or what is in it, cannot be used."""
    try:
        wanted, output, base = identity(case), place.folder, Path("results") / case.name
        if output is None and place.resume:
            output = _folder_to_resume(base, case, wanted)
        own = folders.take_default(base, store.RUN, wanted) if output is None else folders.OwnFolder(output, store.RUN)
        results = store.Results(own.path, case.name, case.actuator.gauge, cm=case.column.pascal)
        results.own = own
        own.take()
        try:
            if place.draw:
                store.picture_folder(own.path).check_names(store.picture_files(case.actuator.gauge))
            resumed = place.resume and _go_on(case, wanted, results)
            if not resumed:
                _begin_anew(case, wanted, results, place.inputs)
        except BaseException:
            own.leave()
            raise
        return results, resumed
    except OSError as error:
        status = commands.EXIT_FAILED if error.errno in commands.DISK_FULL_ERRORS else commands.EXIT_BAD_INPUT
        raise RunError(f"the folder {place.folder or base} cannot be written ({error.strerror})", status) from None


def begin_together(case: Case, place: ResultsPlace, comm: MPI.Comm) -> tuple[store.Results, bool]:
    """The same on all ranks, where rank 0 alone takes the folder and writes there."""
    begun = mpi.kept_on_root(comm, lambda: begin(case, place))
    home, at, resumed = comm.bcast(None if begun is None else (begun[0].own.path, begun[0].folder, begun[1]))
    results = begun[0] if begun else store.Results(home, case.name, case.actuator.gauge, cm=case.column.pascal)
    results.folder = at
    return results, resumed


def _folder_to_resume(base: Path, case: Case, wanted: Mapping[str, str]) -> Path:
    """Return the numbered folder with a run of this case, or else with the only one that it can resume."""
    fitting = []
    for path in itertools.takewhile(Path.exists, folders.numbered(base)):
        old = folders.OwnFolder(path, store.RUN).about.get("inputs")
        if isinstance(old, dict) and difference(old, wanted) is None:
            if old == dict(wanted):
                return path
            fitting.append(path)
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        several = " and ".join(map(str, fitting))
        raise RunError(f"{several} hold runs that this case can resume; choose one with --output", commands.EXIT_BAD_INPUT)
    what = f"none of the folders {base}, {base.name}-2 and so on holds a run of this case to resume"
    raise RunError(f"{what}; give its folder (--output), or run without --resume", commands.EXIT_BAD_INPUT)


def _go_on(case: Case, wanted: Mapping[str, str], results: store.Results) -> bool:
    """Load the states of an earlier run; return whether there are any."""
    folder, about = results.own.path, results.own.about
    stored = [file for file in results.own.files if file.endswith(".h5") and (folder / file).exists()]
    if not stored:
        return False
    file = folder / "case.toml"
    if not file.exists():
        text = f"{file} is missing, the case of the states in that folder; restore it, or run without --resume"
        raise RunError(f"{text}, which replaces them", commands.EXIT_BAD_INPUT)
    _check_unchanged(results)
    results.load(go_on=True)  # first: how a case is identified changes between versions too
    check_same(case, Case.from_file(file), about.get("inputs", {}), wanted, folder)
    if not case.load_unload:
        set_back(case, results)
        check_values(case, results)
    there = {file: name for file, name in results.inputs_of(case.files).items() if (folder / name).is_file()}
    text = case.to_toml(there)
    if results.stored:
        results.record(inputs=dict(wanted), case_file=_digest(text))
        files.write_text(file, text)
    return bool(results.stored)


def _begin_anew(case: Case, wanted: Mapping[str, str], results: store.Results, inputs: Sequence[Path]) -> None:
    """Prepare new results beside the earlier ones."""
    copies = results.inputs_of(case.files)
    text, own = case.to_toml(copies), results.own.path / "case.toml"
    # A case file among its own run's results may be run again: it is written unchanged.
    results.own.check_inputs(file for file in inputs if not (files.is_same(own, file) and files.read_text(file) == text))
    _check_unchanged(results)
    results.prepare({"inputs": dict(wanted), "case_file": _digest(text)})
    for source, copy in copies.items():
        (results.folder / copy).parent.mkdir(exist_ok=True)
        shutil.copyfile(source, results.folder / copy)
    files.write_text(results.folder / "case.toml", text)


def _check_unchanged(results: store.Results) -> None:
    """Raise `RunError` if the user has changed the case.toml that is to be replaced."""
    file, known = results.own.path / "case.toml", results.own.about.get("case_file")
    if known is not None and file.exists() and files.file_digest(file) != known:
        fix = "move it out of the results folder and run it from there, or use another folder (--output)"
        raise RunError(f"{file} has changed since its run wrote it; {fix}", commands.EXIT_BAD_INPUT)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def mesh_is_known(results: store.Results, mesh: Path) -> bool:
    """Return whether a mesh file is still the one that the run wrote."""
    known = results.own.about.get("mesh")
    return mesh.is_file() and known == files.file_digest(mesh)


# ----------------------------------------------------------------------------------------------------------------------
# Write a simulation into a results folder while it runs.


class Summary(TypedDict, total=False):
    """What ``summary.json`` says of a run, beside its states and how it was made."""

    status: int
    message: str
    events: object
    stretch_at_break: object
    errors: object
    notes: list[str]
    stability: str


def gather(case: Case, results: store.Results, ended: outcomes.Ended) -> Summary:
    """Bring all steps into one file, and write and return the summary; on rank 0. `OSError` if there is no room."""
    if ended.status in (commands.EXIT_DONE, commands.EXIT_NO_EQUILIBRIUM):
        results.later.clear()  # the path has ended before them
    results.finish()
    words = labels.state_labels(case)
    summary: Summary = {
        "status": ended.status, "message": ended.message, "events": events(results.rows, words),
        "stretch_at_break": stretch_at_break(case.material),
        "errors": (known := results.budget(case)).tables(),
        "notes": [*results.mesh_notes, *notes.notes_of(known)],
        "stability": notes.stability_text(results.rows, case.actuator, words, results.branch_rows),
    }  # fmt: skip
    started = results.started
    made = commands.Provenance.now(None if started is None else monotonic() - started)
    results.write_summary(summary, made.table())
    return summary


class Observer:
    """Is told on rank 0 how a folder of results comes about."""

    def opened(self, results: store.Results) -> None:
        """The folder is taken; nothing is solved yet."""

    def begun(self, results: store.Results) -> None:
        """The folder holds the first state of this run."""

    def closed(self, results: store.Results | None, ended: outcomes.Ended, summary: Summary) -> None:
        """The run has ended and its folder is complete, and still locked; None where no folder could be taken. The summary is
        empty where there are no states, or it could not be written."""


@contextlib.contextmanager
def unstopped() -> Iterator[Callable[[], bool]]:
    """Nobody asks to stop, but for exceptions."""
    yield bool


def solved_into(
    place: ResultsPlace,
    case: Case,
    comm: MPI.Comm,
    listener: outcomes.Listener | None = None,
    *,
    branch: bool = False,
    observer: Observer | None = None,
    solving: Callable[[], contextlib.AbstractContextManager[Callable[[], bool]]] = unstopped,
) -> tuple[Path | None, bool, outcomes.Ended]:
    """Solve a case and store each state in a folder at once; all ranks call it.

    The listener gets each state, the observer the folder. ``solving`` is entered while states are solved, and gives
    whether to stop, asked between them. Return the folder, None where none could be taken; whether a state that is not at rest
    is stored; and how the run ended: `Ended.error` has the error of the input, PETSc, the memory or the disk.
    """
    results: store.Results | None = None
    ended, observer, begun = outcomes.Ended(), observer or Observer(), monotonic()
    try:
        with solving() as stopped:
            simulation = Simulation(case, comm, listener, stopped)
            try:
                with notes.sentences(notes.unwritten):
                    results, resumed = begin_together(case, place, comm)
                    if mpi.is_root(comm):
                        results.started = begun
                        observer.opened(results)
                    record(simulation, results, resumed, branch, observer.begun, place.budget)
            except Exception as error:
                if not (isinstance(error, errors.OptionMessage) and mpi.together(comm)):
                    raise
                ended = outcomes.Ended.by(error)
            finally:
                if comm.size == 1 or sys.exception() is None:  # other ranks do not know of an exception that goes on
                    simulation.release()
        failure, loaded = mpi.on_root(comm, lambda: _complete(case, results, ended, observer))
        ended = outcomes.Ended.by(outcomes.UnwrittenError(failure)) if failure else ended
        return (None if results is None else results.own.path), loaded, ended
    finally:
        if results is not None and mpi.is_root(comm):
            results.own.leave()


def _complete(case: Case, results: store.Results | None, ended: outcomes.Ended, observer: Observer) -> tuple[str, bool]:
    """Gather the states of a run that has ended, on rank 0; return why only that failed, else "", and whether it is loaded."""
    failure, summary = "", Summary()
    if results is not None and results.stored and ended.status != commands.EXIT_BAD_INPUT:
        try:
            summary = gather(case, results, ended)
            results.own.forget_unwritten()
        except (OSError, folders.OwnFolderError) as error:
            if ended.status == commands.EXIT_DONE:
                failure = f"the steps could not be gathered in one file ({errors.reason(error)})"
                ended = outcomes.Ended.by(
                    outcomes.UnwrittenError(failure := f"{failure}; make room and run again with --resume")
                )
    observer.closed(results, ended, summary)
    return failure, results is not None and is_loaded(results.rows)


def is_loaded(rows: table.PathTable) -> bool:
    """Whether there is a state that is not at rest."""
    return bool(rows) and bool(rows["pressure"].any() or rows["max_displacement"].any())


def record(
    simulation: Simulation,
    results: store.Results,
    resumed: bool,
    branch: bool,
    begun: Callable[[store.Results], None],
    budget: bool = False,
) -> None:
    """Solve a case and store every state at once, after those of a ``resumed`` run; all ranks call it, rank 0 writes, and
    calls ``begun`` as soon as the folder holds a state of this run. ``budget``: see `ResultsPlace`.

    Raises:
        outcomes.PathEnded, RunError, ResultsError: The path ended, or it was stopped, or the states there are of another mesh.
    """
    case, comm = simulation.case, simulation.comm
    mesh = results.folder / f"{case.name}.msh"
    if not (resumed and mpi.on_root(comm, lambda: mesh_is_known(results, mesh))):
        simulation.write_mesh(mesh)
        mpi.on_root(comm, lambda: results.record(mesh=files.file_digest(mesh)))
    simulation.prepare(mesh)
    mpi.on_root(comm, lambda: results.record(mesh_notes=simulation.model.notes))
    if resumed:
        mpi.on_root(comm, lambda: results.check_grid(simulation.fields.grid.points))
    simulation.describe()
    start = _resumed_start(simulation, results) if resumed else FROM_REST
    if not resumed:
        _begin(simulation, results)
    ended: outcomes.PathEnded | None = None
    started = process_time()
    try:
        _store(simulation.steps(start), results, comm, begun)
    except outcomes.PathEnded as end:
        if case.program:
            raise
        ended = end
    seconds = mpi.on_root(comm, lambda: process_time() - started) if budget else None
    if branch:
        _record_branch(simulation, results)
    sources = solve_sources(simulation, results.own.path / mesh.name)  # stored since the first state
    meshes = solve_meshes(simulation, seconds)
    mpi.on_root(comm, lambda: results.write_beside(sources, meshes))
    if ended is not None:
        raise ended


def _begin(simulation: Simulation, results: store.Results) -> None:
    grid = simulation.fields.grid
    mpi.on_root(simulation.comm, lambda: results.begin(grid.points, grid.cells, grid.cell_name))


def _store(
    steps: Iterable[formats.StateRecord],
    results: store.Results,
    comm: MPI.Comm,
    begun: Callable[[store.Results], None] = lambda results: None,
) -> None:
    for number, step in enumerate(steps):
        mpi.on_root(comm, functools.partial(results.add, step))
        if number == 0:
            mpi.on_root(comm, lambda: begun(results))


def _resumed_start(simulation: Simulation, results: store.Results) -> RunStart:
    """Return the state from which a resumed run continues."""
    case, fields, comm = simulation.case, simulation.fields, simulation.comm
    rows = mpi.on_root(comm, lambda: results.rows)
    if case.load_unload or simulation.solver.carried:
        return RunStart(rows)
    solved = mpi.on_root(comm, lambda: {i: row.get("time") for i, row in enumerate(results.rows) if not row["bifurcation"]})
    again = functools.partial(replay, results, fields, comm, solved)
    if case.program:
        stop = last_stop(case, results, fields, comm)
        simulation.listener.say(f"resuming from step {stop.number} of the program")
        return RunStart(rows, stop=stop, replay=again)
    left = mpi.on_root(comm, lambda: [not stopped_at(case, results, value) for value in case.values])
    points = stored_points(results, fields, comm)
    simulation.listener.say(f"resuming from step {len(rows) - 1}")
    return RunStart(rows, left, points, replay=again)


def _record_branch(simulation: Simulation, results: store.Results) -> None:
    """Follow the branch at the first bifurcation, into its own folder."""
    case, comm = simulation.case, simulation.comm
    if not simulation.bifurcates:
        simulation.listener.say(mpi.on_root(comm, lambda: notes.no_branch(case, results.rows)))
        return
    mpi.on_root(comm, lambda: begin_branch(results, case))
    aside = results.branch()
    _begin(simulation, aside)
    _store(simulation.branch(), aside, comm)
    mpi.on_root(comm, lambda: gather(case, aside, outcomes.Ended()) if aside.stored else None)


def begin_branch(results: store.Results, case: Case) -> store.Results:
    """Create the folder of a branch beside its path, and remove an earlier branch; on rank 0."""
    aside = results.branch()
    results.own.claim([store.BRANCH])
    aside.clear()
    copies = {file: f"../{name}" for file, name in results.inputs_of(case.files).items()}
    there = {file: name for file, name in copies.items() if (aside.folder / name).is_file()}
    files.write_text(aside.folder / "case.toml", case.to_toml(there))
    return aside
