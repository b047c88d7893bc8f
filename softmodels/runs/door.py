"""The calls of a notebook: a device is inflated, a run is loaded, a limit is asked for. Nothing is printed here."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypedDict, Unpack

from geometries import Actuator
from measurement import wording
from measurement.user_file import read_text
from softmodels.case.case import Case, CaseError
from softmodels.materials.laws import Material
from softmodels.mechanics.contact import Obstacle
from softmodels.mechanics.mpi import is_root, start
from softmodels.mechanics.parts import Part
from softmodels.mechanics.sheet import Sheet
from softmodels.results.limits import Limit, find_limit
from softmodels.results.outcomes import RunError
from softmodels.results.row import Row
from softmodels.results.state_words import state_words
from softmodels.runs.failures import sentences
from softmodels.runs.keeping import Place, run_of, solve_in_memory, solve_into
from softmodels.runs.progress import Progress
from softmodels.runs.requests import Options, Values, case_of
from softmodels.runs.run import Ended, Run
from softmodels.runs.simulation import Simulation
from softmodels.runs.step import Listener, Silent

for _option, _argument in (("output", "folder"), ("resume", "resume=True"), ("branch", "branch=True")):
    wording.call(_option, _argument)

type Told = bool | Callable[[Row], object] | None
"""Who is told of each state: nobody, the terminal (True), or a function that gets its row of ``path.csv``."""


class How(TypedDict, total=False):
    """How a case is run; nothing of it changes a number.

    Attributes:
        progress: True for a bar on the terminal; or a function that is called with the row of each state.
        folder: Write every state there as soon as it is solved, as the command line does; without it they stay in memory.
        resume: Go on from what an interrupted run of the same case has left in the folder.
        branch: Follow the branch that leaves the path at its first bifurcation too, into `Run.branch`.
    """

    progress: Told
    folder: str | Path | None
    resume: bool
    branch: bool


class InflateOptions(Options, How, total=False):
    """What `inflate` takes beside device, material and load."""


def inflate(
    device: Actuator,
    material: Material,
    pressures: Values | None = None,
    volumes: Values | None = None,
    **options: Unpack[InflateOptions],
) -> Run:
    """Inflate a device, and return its load path.

    Args:
        device: The device.
        material: Its silicone.
        pressures: Pressures to stop at, rising: ``"0:177 cm"`` (from, to, in steps that the solver chooses), ``"0:17:1 kPa"``,
            ``"0,70,130 cm"``, or numbers in Pa.
        volumes: The same of added volumes of the cavity: ``"0:60 ml"``, or numbers in m3.
        options: ``strokes`` (``"0:20 ml"`` or m3) with ``supply``, such as a `Syringe`; of a `Case` ``control``,
            ``formulation``, ``solver``, ``sheet``, ``obstacle``, ``parts``, ``cycle``, ``program``, ``gauges``,
            ``water_density``, ``name``; and ``progress``, ``folder``, ``resume``, ``branch`` as of `run`.

    Returns:
        The run. A path that ends before the last requested value comes back with its end in `Run.limit`.

    Raises:
        CaseError, MaterialError, GeometryError: What cannot be meant.
        RunError: No state under load was found; with a folder, also that it cannot be written.
        MeshingError, MeshFileError: The device cannot be meshed.
        OwnFolderError, InUseError, ResultsError: The folder is somebody else's, in use, or of another run.
        StartError: MPI or PETSc cannot be started.
    """
    how: How = {key: options.pop(key) for key in How.__annotations__ if key in options}  # type: ignore[misc, assignment]
    return run(case_of(device, material, pressures, volumes, **options), **how)  # type: ignore[misc]


def run(
    case: Case | str | Path,
    *,
    progress: Told = None,
    folder: str | Path | None = None,
    resume: bool = False,
    branch: bool = False,
) -> Run:
    """Run a case, or a case file.

    Args:
        case: The case, or its file.
        progress: True for a bar on the terminal; or a function that is called with the row of each state.
        folder: Write every state there as soon as it is solved: a folder that is empty, not there, or an earlier run's, whose
            files are replaced once the first state is there. A run that is killed leaves its states readable. None keeps
            them in memory.
        resume: Go on from what an interrupted run of the same case has left in the folder; from rest if there is nothing.
        branch: Follow the branch that leaves the path at its first bifurcation too, into `Run.branch`.

    Returns:
        The run; see `inflate`, also for what is raised.
    """
    file = None if isinstance(case, Case) else Path(case)
    whole = case if isinstance(case, Case) else Case.from_file(Path(case))
    if branch:
        whole.load.check_branch()
    if resume and folder is None:
        raise CaseError("a run is gone on with in its folder; give it, or leave out --resume")
    comm = start()
    with contextlib.ExitStack() as stack:
        listener: Listener = _Each(progress) if callable(progress) else Silent()
        if progress is True:
            bar = Progress(whole.values[-1], whole.unit, state_words(whole), not is_root(comm))
            listener = stack.enter_context(bar)
        simulation = Simulation(whole, comm, listener)
        if folder is None:
            return solve_in_memory(simulation, branch)
        return solve_into(Place(Path(folder), resume, () if file is None else (file,)), simulation, branch)


class _Each(Silent):
    """Hands each row to a function."""

    def __init__(self, told: Callable[[Row], object]):
        self.told = told

    def step(self, row: Row, value: float) -> None:
        self.told(row)


def load(folder: str | Path) -> Run:
    """A run from a folder of results; DOLFINx is needed only where a state is asked for that is not stored.

    Raises:
        ResultsError: No results, or none that can be read.
        CaseError: No case file, or a wrong one.
    """
    try:
        summary = json.loads(read_text(Path(folder) / "summary.json"))
        ended = Ended(int(summary["status"]), str(summary["message"]))
    except (OSError, ValueError, KeyError, TypeError):
        ended = Ended()  # a run that goes on, or was cut off
    return run_of(Path(folder), ended)


def limit(
    device: Actuator,
    material: Material,
    *,
    sheet: Sheet | None = None,
    obstacle: Obstacle | None = None,
    formulation: str = "mixed",
    parts: Sequence[Part] = (),
    solver: str = "auto",
) -> Limit:
    """How far a device can be inflated: its first limit point or bifurcation, and where it is strained most there.

    Args:
        device: The device.
        material: Its silicone.
        sheet, obstacle, formulation, parts, solver: As of a `Case`.

    Raises:
        CaseError: What cannot be meant.
        RunError: The equations cannot be made or solved.
        MeshingError, MeshFileError: The device cannot be meshed.
    """
    from softmodels.mechanics.body import BodyError
    from softmodels.mechanics.compiling import CompilingError

    # What no case may be, no limit is asked of; its load is not looked at.
    around = {"sheet": sheet, "obstacle": obstacle, "parts": tuple(parts)}
    how = {"formulation": formulation, "solver": solver}
    case = Case("limit", device, material, pressures_cm=(1.0,), **around, **how)  # type: ignore[arg-type]
    comm = start()
    try:
        with sentences():
            return find_limit(case, [material], comm)[0]
    except (BodyError, CompilingError) as error:
        raise RunError(str(error)) from error
