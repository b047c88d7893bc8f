"""The Python calls for notebooks: `inflate`, `run`, `load`, `compare`, `limit` and `modes`. They print nothing."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from geometries import Actuator
from softmodels.api.run import Run
from softmodels.case import materials
from softmodels.case.case import Case, ErrorOptions, RequestOptions, SolveOptions, case_of, listed_options
from softmodels.case.entries import CaseError
from softmodels.case.load import Values, prescribed
from softmodels.common import commands, errors, files, names, units
from softmodels.common.lazy import MPI
from softmodels.common.names import checked
from softmodels.common.processes import one_at_a_time
from softmodels.decks.deck import WRITTEN_BY, Deck, calculix, check, deck_of, needs_equations
from softmodels.materials.laws import Material
from softmodels.mechanics import compiling, mpi
from softmodels.mechanics.body import Body
from softmodels.mechanics.system import System
from softmodels.path import steps
from softmodels.runs import analyses, labels, notes, outcomes, recording, states
from softmodels.runs.analyses import Limit, NaturalFrequencies
from softmodels.runs.outcomes import RunError
from softmodels.runs.simulation import AtRest, MemoryStates, Simulation, accurate, solve_meshes, solve_sources, temporary_folder

if TYPE_CHECKING:
    from softmodels.pictures.comparison import Comparison


type Progress = bool | Callable[[dict[str, float]], object] | None
"""Progress reports of each state: none, a bar (True), or a function that gets its row of ``path.csv``."""


@checked
@listed_options(RequestOptions)
def inflate(
    device: Actuator,
    material: Material | str,
    pressures: Values | None = None,
    volumes: Values | None = None,
    *,
    times: Values | None = None,
    strokes: Values | None = None,
    valve: Values | None = None,
    progress: Progress = None,
    folder: str | Path | None = None,
    resume: bool = False,
    branch: bool = False,
    **options: Unpack[RequestOptions],
) -> Run:
    """Inflate a device, and return its load path.

    Args:
        device: The device.
        material: Its silicone, or the name of one, such as ``"ecoflex-00-30"``.
        pressures: Pressures to stop at, rising: ``"0:177 cm"`` (from, to, in steps chosen by the solver), ``"0:17:1 kPa"``,
            ``"0,70,130 cm"``, ``["7 kPa", "14 kPa"]``, or numbers in Pa.
        volumes: The same for added volumes of the cavity: ``"0:60 ml"``, or numbers in m3.
        times: When these values are reached, in s or as texts, for a silicone with a memory: the values may fall then, and one
            that repeats is a hold.
        strokes: The same for strokes of the supply: ``"0:20 ml"``, or numbers in m3.
        valve: Opening of the supply's valve at the times, from 0 (closed) to 1; open if None.
        progress: See `run`.
        folder: See `run`.
        resume: See `run`.
        branch: See `run`.
        options: Fields of a `Case` by their names, and ``rate``, ``hold`` and ``cycles`` of its load.

    Returns:
        The run. A path that ends before the last requested value comes back with its end in `Run.limit`.

    Raises:
        ArgumentError, CaseError, MaterialError, GeometryError: Invalid input, before anything is solved.
        RunError: No state under load was found; with a folder, also that it cannot be written.
        MeshingError, MeshFileError: The device cannot be meshed.
        OwnFolderError, InUseError, ResultsError: The folder holds other files, is in use, or is of another run.
        StartError: MPI or PETSc cannot be started.
    """
    asked = case_of(device, material, pressures, volumes, times, strokes, valve, **options)
    return run(asked, progress=progress, folder=folder, resume=resume, branch=branch)


@checked
@one_at_a_time
def run(
    case: Case | str | Path,
    *,
    progress: Progress = None,
    folder: str | Path | None = None,
    resume: bool = False,
    branch: bool = False,
) -> Run:
    """Run a case, or a case file.

    Args:
        case: The case, or its file.
        progress: True for a bar, on the terminal or in the notebook; or a function that is called with the row of each state.
        folder: Write every state there as soon as it is solved: a folder that is empty, not there, or an earlier run's, whose
            files are replaced once the first state is stored. A killed run leaves its states readable. None
            keeps them in memory.
        resume: Resume an interrupted run of the same case in the folder; start from rest if there is none.
        branch: Also follow the branch at the first bifurcation, into `Run.branch`.

    Returns:
        The run; see `inflate`, also for what is raised.
    """
    inputs: tuple[Path, ...] = ()
    if not isinstance(case, Case):
        inputs = (names.place("case", case, "a case file, or a Case"),)
        case = Case.from_file(inputs[0])
    names.callback("progress", progress, or_flag=True)
    output = None if folder is None else names.place("folder", folder, "a folder")
    if names.flag("branch", branch):
        case.load.check_branch()
    if names.flag("resume", resume) and output is None:
        raise CaseError("resuming needs the run's folder; give it (folder=...), or leave out --resume")
    comm = mpi.start()
    with contextlib.ExitStack() as stack:
        listener = outcomes.Listener(progress if callable(progress) else None)
        if progress is True:
            words, goal = labels.state_labels(case), case.load.told(case.values[-1])
            listener = stack.enter_context(outcomes.Progress(words, not mpi.is_root(comm), case.variable, goal))
        case = accurate(case, comm, listener)
        if output is None:
            return solve_in_memory(Simulation(case, comm, listener), branch)
        return solve_in_folder(recording.ResultsPlace(output, resume, inputs), case, comm, listener, branch)


@checked
@one_at_a_time
def load(folder: str | Path) -> Run:
    """Load a run from a folder of results; DOLFINx is needed only to solve for states that are not stored.

    Raises:
        ResultsError: No results, or none that can be read.
        CaseError: No case file, or a wrong one.
    """
    where = names.place("folder", folder, "a folder of results")
    try:
        summary = files.read_json(where / "summary.json")
        ended = outcomes.Ended(int(summary["status"]), str(summary["message"]))
    except (OSError, ArithmeticError, ValueError, KeyError, TypeError):
        ended = outcomes.Ended()  # a run that is still going, or was interrupted
    return run_of(where, ended)


@checked
@one_at_a_time
def compare(first: Run | str | Path, second: Run | str | Path, *more: Run | str | Path) -> Comparison:
    """Compare runs: what differs in their cases, and their main figures side by side.

    Args:
        first: A run, or a folder of results, that the others are compared with.
        second: Another one.
        more: Further ones.

    Returns:
        The comparison: ``print`` shows it, `Comparison.plot` overlays the paths, `Comparison.save` writes a report.

    Raises:
        ComparisonError: They are over loads that cannot be compared.
        ResultsError, CaseError: A folder holds no results, or none that can be read.
    """
    from softmodels.pictures import comparison

    def of(number: int, run: Run | str | Path) -> comparison.ComparedResult:
        if not isinstance(run, Run):
            name = ("first", "second")[number] if number < 2 else "more"
            return comparison.ComparedResult.from_folder(names.place(name, run, "a run, or a folder of results"))
        rest = run[0]
        return comparison.ComparedResult(f"{run.case.name} ({number + 1})", run.budget, rest.points, len(rest.cells),
                        lambda step: run[step].displacement)  # fmt: skip

    return comparison.compared([of(number, run) for number, run in enumerate((first, second, *more))])


@checked
@one_at_a_time
@listed_options(ErrorOptions)
def limit(
    device: Actuator,
    material: Material | str,
    *,
    hold: float | str = 0.0,
    vacuum: bool = False,
    **options: Unpack[ErrorOptions],
) -> Limit:
    """Find how far a device can be inflated: its first limit point or bifurcation, and the place of the largest stretch there.

    Args:
        device: The device.
        material: Its silicone, or the name of one.
        hold: How long a device of silicone with memory must survive at constant pressure: s, or ``"5 min"``; 0: unlimited.
        vacuum: Whether the pressure falls from ambient instead of rising.
        options: Fields of a `Case` by their names.

    Raises:
        CaseError: Invalid input.
        RunError: The equations cannot be made or solved.
        MeshingError, MeshFileError: The device cannot be meshed.
    """
    # A case with a dummy load, so that the input is checked as for any case.
    case = Case("limit", device, material, steps.one_step(steps.PRESSURE, [-100.0 if vacuum else 100.0]), **options)  # type: ignore[arg-type]
    seconds = analyses.check_hold(hold, [case.material])
    if seconds and vacuum:
        raise CaseError("a hold and a vacuum cannot be combined; leave out one of them")
    comm = mpi.start()
    with notes.sentences():
        return analyses.find_limit(case, [case.material], comm, seconds)[0]


@checked
@one_at_a_time
@listed_options(SolveOptions)
def modes(
    device: Actuator,
    material: Material | str,
    pressures: Values | None = None,
    *,
    count: int = 4,
    sealed: bool = False,
    **options: Unpack[SolveOptions],
) -> NaturalFrequencies:
    """Find the natural frequencies of a device at rest and while it is inflated, and their modes.

    They are those about relaxed states, stiffened and damped by the branches of a memory, see `Model.modes`. Masses and plates
    bonded to the device swing with it; they need a `Gravity`, which also sets the density. `Model.modes` finds those of states
    by their volume.

    Args:
        device: The device. One without a cavity is at rest, or hangs under its weight.
        material: Its silicone, or the name of one.
        pressures: Pressures to stop at, see `inflate`; None or 0 for the state at rest.
        count: Number of modes, 1 to 20.
        sealed: Each cavity is closed, with air that keeps its temperature; else they keep their pressures.
        options: Fields of a `Case` by their names.

    Raises:
        CaseError: Invalid input.
        RunError: No state was found, or not its modes.
        MeshingError, MeshFileError: The device cannot be meshed.
    """
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= analyses.MAX_MODES:
        raise CaseError(f"count is {count!r}; it must be a whole number of modes from 1 to {analyses.MAX_MODES}")
    closed = names.flag("sealed", sealed)
    if pressures is None or not any(prescribed(steps.PRESSURE, pressures, units.COLUMN.pascal).values):
        case: Case = AtRest("modes", device, material, **options)  # type: ignore[arg-type]
    else:
        case = case_of(device, material, pressures, **options)
    comm = mpi.start()
    with notes.sentences():
        return analyses.find_frequencies(analyses.case_for_modes(case), count, closed, comm)


# ----------------------------------------------------------------------------------------------------------------------
# Solve a case into a `Run`, with its states in memory or in a results folder.


def solve_in_memory(simulation: Simulation, branch: bool) -> Run:
    """Solve a case that is not prepared yet, perhaps with the first branch, and keep its states; all ranks call it. `RunError`
    if no state under load was found."""
    case, comm, ended = simulation.case, simulation.comm, outcomes.Ended()
    states: MemoryStates | None = None
    aside: MemoryStates | None = None
    try:
        with notes.sentences(), temporary_folder(comm) as folder:
            mesh = folder / f"{case.name}.msh"
            simulation.write_mesh(mesh)
            simulation.prepare(mesh)
            states = MemoryStates(simulation, mesh.read_bytes)
            try:
                for step in simulation.steps():
                    states.add(step)
            except outcomes.PathEnded as end:
                ended = outcomes.Ended.by(end)
                if case.program:
                    raise
            aside = _branch(simulation, states) if branch else None
            states.others, states.meshes = solve_sources(simulation, mesh), solve_meshes(simulation)
    except RunError as error:
        ended = outcomes.Ended.by(error)
        if states is None:
            raise
    finally:
        simulation.release()
    if ended.error is not None and not recording.is_loaded(states.rows):
        raise ended.error
    return Run(states, ended, comm, None if aside is None else Run(aside, outcomes.Ended(), comm))


def _branch(simulation: Simulation, states: MemoryStates) -> MemoryStates | None:
    """Return the states of the branch at the first bifurcation; None if there is none to be found."""
    if not simulation.bifurcates:
        simulation.listener.say(notes.no_branch(simulation.case, states.rows))
        return None
    aside = MemoryStates(simulation, states.mesh)
    for step in simulation.branch():
        aside.add(step)
    return aside if aside.rows else None


def solve_in_folder(
    place: recording.ResultsPlace, case: Case, comm: MPI.Comm, listener: outcomes.Listener, branch: bool
) -> Run:
    """Solve a case into a folder, which is given; see `solved_into`. `RunError` if no state under load was found or stored,
    other errors for what is in the folder."""
    folder, loaded, ended = recording.solved_into(place, case, comm, listener, branch=branch)
    if ended.error is not None:
        # The end of a path is no error where there are states up to it.
        end = isinstance(ended.error, RunError) and not isinstance(ended.error, outcomes.UnwrittenError)
        if not end or not loaded or ended.status == commands.EXIT_BAD_INPUT:
            raise ended.error
    assert folder is not None
    return run_of(folder, ended, comm)


def run_of(folder: Path, ended: outcomes.Ended, comm: MPI.Comm | None = None) -> Run:
    """Return the run in a folder, with the branch that leaves it; `ResultsError` or `CaseError` if it cannot be read."""
    source = states.FolderStates(folder)
    aside = source.branch_states()
    return Run(source, ended, comm, None if aside is None else Run(aside, outcomes.Ended(), comm))


errors.call("output", "folder")


for _option in ("resume", "branch", "sealed"):
    errors.call(_option, f"{_option}=True")


# ----------------------------------------------------------------------------------------------------------------------
# The Python call that writes a case for CalculiX.


@checked
@one_at_a_time
def export(case: Case | str | Path, file: str | Path) -> Deck:
    """Write a case for CalculiX: the same mesh, silicones, supports, rigid parts, contact, dead loads and pressures.

    Args:
        case: The case, or its file.
        file: Where to, ``.inp``. An earlier deck is replaced, any other file is not.

    Returns:
        What was written.

    Raises:
        CaseError: A case that decks have no words for, another ending, or a file that is no deck.
        MeshingError: The device cannot be meshed.
        ComponentError, BodyError, CompilingError: What is added to the device cannot be on its mesh, or its
            equations cannot be made.
        OSError: The file cannot be written.
    """
    whole = case if isinstance(case, Case) else Case.from_file(names.place("case", case, "a case file, or a Case"))
    path = names.place("file", file, "a file")
    if path.suffix.lower() != ".inp":
        raise CaseError(f"{path} ends in {path.suffix or 'nothing'}; a deck for CalculiX ends in .inp")
    if path.exists() and WRITTEN_BY.encode() not in files.read_file(path, files.MAX_GEOMETRY_BYTES)[:500]:
        raise CaseError(f"{path} exists and is not a deck written by this program; give another name")
    check(whole)
    with tempfile.TemporaryDirectory() as folder:
        mesh = whole.actuator.write(Path(folder) / "device.msh")
        deck = deck_of(whole, mesh, _system(whole, mesh))
    text = calculix(deck)
    partial = path.with_name(f".{path.name}.part")
    partial.write_text(text, encoding="utf-8")
    partial.replace(path)
    return deck


def _system(case: Case, mesh: Path) -> System | None:
    """Return the equations of a device in displacements only, None if its deck needs none; an error of parts, body or
    compiling if they cannot be made."""
    if not needs_equations(case):
        return None
    mpi.start()
    with compiling.compiling():
        body = Body.from_file(case.actuator, mesh, MPI.COMM_SELF)
        return System(body, case.material, "displacement", components=materials.without_walls(case.components))
