"""The calls of a notebook: a device is inflated, a run is loaded, a limit is asked for. Nothing is printed here."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path

from geometries import Actuator
from measurement import wording
from measurement.arguments import callback, checked, flag, place
from measurement.one_at_a_time import one_at_a_time
from measurement.units import WATER_DENSITY
from measurement.user_file import read_text
from softmodels.case.case import Case, CaseError
from softmodels.case.gauges import Gauges
from softmodels.case.load_request import LoadRequest
from softmodels.case.material_errors import AnyBand
from softmodels.materials.laws import Material
from softmodels.mechanics.contact import Obstacle
from softmodels.mechanics.mpi import is_root, start
from softmodels.mechanics.parts import Part
from softmodels.mechanics.sheet import Sheet
from softmodels.path.air_supply import AirSupply
from softmodels.path.program import Program
from softmodels.results.limits import Limit, find_limit
from softmodels.results.outcomes import RunError
from softmodels.results.row import Row
from softmodels.results.state_words import state_words
from softmodels.runs.failures import sentences
from softmodels.runs.keeping import Place, run_of, solve_in_memory, solve_into
from softmodels.runs.progress import Progress
from softmodels.runs.requests import Values, case_of
from softmodels.runs.run import Ended, Run
from softmodels.runs.simulation import Simulation
from softmodels.runs.step import Listener, Silent

for _option, _argument in (("output", "folder"), ("resume", "resume=True"), ("branch", "branch=True")):
    wording.call(_option, _argument)

type Told = bool | Callable[[Row], object] | None
"""Who is told of each state: nobody, the terminal (True), or a function that gets its row of ``path.csv``."""


@checked
def inflate(
    device: Actuator,
    material: Material | str,
    pressures: Values | None = None,
    volumes: Values | None = None,
    *,
    strokes: Values | None = None,
    driven: LoadRequest | None = None,
    supply: AirSupply | None = None,
    control: str = "auto",
    formulation: str = "mixed",
    solver: str = "auto",
    sheet: Sheet | None = None,
    obstacle: Obstacle | None = None,
    parts: Part | Sequence[Part] = (),
    gauges: Gauges | None = None,
    band: AnyBand | str | Path | None = None,
    cycle: bool = False,
    program: Program = (),
    water_density: float | str = WATER_DENSITY,
    name: str | None = None,
    progress: Told = None,
    folder: str | Path | None = None,
    resume: bool = False,
    branch: bool = False,
) -> Run:
    """Inflate a device, and return its load path.

    Args:
        device: The device.
        material: Its silicone, or the name of one, such as ``"ecoflex-00-30"``.
        pressures: Pressures to stop at, rising: ``"0:177 cm"`` (from, to, in steps that the solver chooses), ``"0:17:1 kPa"``,
            ``"0,70,130 cm"``, ``["7 kPa", "14 kPa"]``, or numbers in Pa.
        volumes: The same of added volumes of the cavity: ``"0:60 ml"``, or numbers in m3.
        strokes: The same of what the supply pushes: ``"0:20 ml"``, or numbers in m3.
        driven: Requested forces, travels or shares of a dead load among the parts, in place of pressures.
        supply: What drives the air by its strokes, such as a `Syringe`.
        control: What the path follows: ``"auto"``, ``"pressure"``, ``"volume"`` or ``"arc-length"``.
        formulation: ``"mixed"`` (displacement and pressure) or ``"displacement"``.
        solver: How linear equations are solved: ``"auto"``, ``"direct"`` or ``"iterative"``.
        sheet: A sheet bonded to a face.
        obstacle: A rigid plane that faces come to rest on.
        parts: What else is added to the device: `Gravity`, `Rigid`, `RigidShape`, `Fibres` and others, one or several.
        gauges: Named points and angles that every state reports.
        band: Errors of the material, whose 95 % band is computed for every state; or the name of a silicone, whose sources
            are computed, or the file of a fit.
        cycle: Whether the pressure is lowered again through the same values, with jumps at limit points.
        program: What each of several cavities goes through by itself, in place of one requested quantity.
        water_density: Density of the column's liquid: kg/m3, or a text.
        name: Stem of the result files; the device's if None.
        progress: See `run`.
        folder: See `run`.
        resume: See `run`.
        branch: See `run`.

    Returns:
        The run. A path that ends before the last requested value comes back with its end in `Run.limit`.

    Raises:
        ArgumentError, CaseError, MaterialError, GeometryError: Invalid input, before anything is solved.
        RunError: No state under load was found; with a folder, also that it cannot be written.
        MeshingError, MeshFileError: The device cannot be meshed.
        OwnFolderError, InUseError, ResultsError: The folder is somebody else's, in use, or of another run.
        StartError: MPI or PETSc cannot be started.
    """
    case = case_of(
        device, material, pressures, volumes, strokes=strokes, driven=driven, supply=supply, control=control,
        formulation=formulation, solver=solver, sheet=sheet, obstacle=obstacle, parts=parts, gauges=gauges, band=band,
        cycle=cycle, program=program, water_density=water_density, name=name,
    )  # fmt: skip
    return run(case, progress=progress, folder=folder, resume=resume, branch=branch)


@checked
@one_at_a_time
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
    file = None if isinstance(case, Case) else place("case", case, "a case file, or a Case")
    whole = case if isinstance(case, Case) else Case.from_file(place("case", case))
    callback("progress", progress, or_flag=True)
    output = None if folder is None else place("folder", folder, "a folder")
    if flag("branch", branch):
        whole.load.check_branch()
    if flag("resume", resume) and output is None:
        raise CaseError("a run is gone on with in its folder; give it, or leave out --resume")
    comm = start()
    with contextlib.ExitStack() as stack:
        listener: Listener = _Each(progress) if callable(progress) else Silent()
        if progress is True:
            bar = Progress(whole.values[-1], whole.unit, state_words(whole), not is_root(comm))
            listener = stack.enter_context(bar)
        simulation = Simulation(whole, comm, listener)
        if output is None:
            return solve_in_memory(simulation, branch)
        return solve_into(Place(output, resume, () if file is None else (file,)), simulation, branch)


class _Each(Silent):
    """Hands each row to a function."""

    def __init__(self, told: Callable[[Row], object]):
        self.told = told

    def step(self, row: Row, value: float) -> None:
        self.told(row)


@checked
@one_at_a_time
def load(folder: str | Path) -> Run:
    """A run from a folder of results; DOLFINx is needed only where a state is asked for that is not stored.

    Raises:
        ResultsError: No results, or none that can be read.
        CaseError: No case file, or a wrong one.
    """
    where = place("folder", folder, "a folder of results")
    try:
        summary = json.loads(read_text(where / "summary.json"))
        ended = Ended(int(summary["status"]), str(summary["message"]))
    except (OSError, ArithmeticError, ValueError, KeyError, TypeError, RecursionError):
        ended = Ended()  # a run that goes on, or was cut off
    return run_of(where, ended)


@checked
@one_at_a_time
def limit(
    device: Actuator,
    material: Material | str,
    *,
    sheet: Sheet | None = None,
    obstacle: Obstacle | None = None,
    formulation: str = "mixed",
    parts: Part | Sequence[Part] = (),
    solver: str = "auto",
) -> Limit:
    """How far a device can be inflated: its first limit point or bifurcation, and where it is strained most there.

    Args:
        device: The device.
        material: Its silicone, or the name of one.
        sheet, obstacle, formulation, parts, solver: As of a `Case`.

    Raises:
        CaseError: What cannot be meant.
        RunError: The equations cannot be made or solved.
        MeshingError, MeshFileError: The device cannot be meshed.
    """
    from softmodels.mechanics.body import BodyError
    from softmodels.mechanics.compiling import CompilingError

    # What no case may be, no limit is asked of; its load is not looked at.
    around = {"sheet": sheet, "obstacle": obstacle, "parts": parts}
    how = {"formulation": formulation, "solver": solver}
    case = Case("limit", device, material, pressures_cm=(1.0,), **around, **how)  # type: ignore[arg-type]
    comm = start()
    try:
        with sentences():
            return find_limit(case, [case.material], comm)[0]
    except (BodyError, CompilingError) as error:
        raise RunError(str(error)) from error
