"""The calls of a notebook: a device is inflated, a run is loaded, a limit is asked for. Nothing is printed here."""

from __future__ import annotations

import contextlib
import json
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from geometries import Actuator
from softmodels.case.case import Case
from softmodels.materials.laws import Material
from softmodels.mechanics.contact import Obstacle
from softmodels.mechanics.mpi import is_root, on_root, petsc_reason, start
from softmodels.mechanics.sheet import Sheet
from softmodels.results.limits import Limit, find_limit
from softmodels.results.outcomes import NO_MEMORY, RunError
from softmodels.results.row import Row
from softmodels.runs.progress import Progress
from softmodels.runs.requests import Options, Values, case_of
from softmodels.runs.run import Ended, Run
from softmodels.runs.simulation import Simulation
from softmodels.runs.states import InFolder, InMemory
from softmodels.runs.step import Listener, Silent

if TYPE_CHECKING:
    from mpi4py import MPI

type Told = bool | Callable[[Row], object] | None
"""Who is told of each state: nobody, the terminal (True), or a function that gets its row of ``path.csv``."""


def inflate(
    device: Actuator,
    material: Material,
    pressures: Values | None = None,
    volumes: Values | None = None,
    progress: Told = None,
    **options: Unpack[Options],
) -> Run:
    """Inflate a device, and return its load path.

    Args:
        device: The device.
        material: Its silicone.
        pressures: Pressures to stop at, rising: ``"0:177 cm"`` (from, to, in steps that the solver chooses), ``"0:17:1 kPa"``,
            ``"0,70,130 cm"``, or numbers in Pa.
        volumes: The same of added volumes of the cavity: ``"0:60 ml"``, or numbers in m3.
        progress: True for a bar on the terminal; or a function that is called with the row of each state.
        options: ``strokes`` (``"0:20 ml"`` or m3) with ``supply``, a `Syringe`; and of a `Case` ``control``,
            ``formulation``, ``sheet``, ``obstacle``, ``cycle``, ``program``, ``gauges``, ``water_density``, ``name``.

    Returns:
        The run. A path that ends before the last requested value comes back with its end in `Run.limit`.

    Raises:
        CaseError, MaterialError, GeometryError: What cannot be meant.
        RunError: No state under load was found.
        MeshingError, MeshFileError: The device cannot be meshed.
        StartError: MPI or PETSc cannot be started.
    """
    return run(case_of(device, material, pressures, volumes, **options), progress=progress)


def run(case: Case | str | Path, *, progress: Told = None) -> Run:
    """Run a case, or a case file; see `inflate`."""
    whole = case if isinstance(case, Case) else Case.from_file(Path(case))
    comm = start()
    if progress is True:
        with Progress(whole.values[-1], whole.unit, whole.actuator.gauge, not is_root(comm)) as bar:
            return _solve(whole, comm, bar)
    return _solve(whole, comm, _Each(progress) if callable(progress) else Silent())


class _Each(Silent):
    """Hands each row to a function."""

    def __init__(self, told: Callable[[Row], object]):
        self.told = told

    def step(self, row: Row, value: float) -> None:
        self.told(row)


def _solve(case: Case, comm: MPI.Comm, listener: Listener) -> Run:
    simulation, ended = Simulation(case, comm, listener), Ended()
    states: InMemory | None = None
    try:
        with _sentences(), _folder(comm) as folder:
            mesh = folder / f"{case.name}.msh"
            simulation.write_mesh(mesh)
            simulation.prepare(mesh)
            states = InMemory(simulation, mesh)
            for step in simulation.steps():
                states.add(step)
    except RunError as error:
        if states is None or not any(row["pressure_Pa"] or row["added_volume_ml"] for row in states.rows):
            raise
        ended = Ended(error.status, str(error))
    finally:
        simulation.release()
    return Run(states, ended, comm, run)


@contextlib.contextmanager
def _sentences() -> Iterator[None]:
    """Failures of the libraries below as the sentence that the command line prints."""
    from petsc4py import PETSc

    try:
        yield
    except PETSc.Error as error:
        raise RunError(f"PETSc stopped ({petsc_reason(error)})") from error
    except MemoryError as error:
        raise RunError(NO_MEMORY) from error
    except OSError as error:
        raise RunError(f"the mesh cannot be written ({error.strerror or error})") from error


@contextlib.contextmanager
def _folder(comm: MPI.Comm) -> Iterator[Path]:
    """A folder for a while, the same on all ranks."""
    path = on_root(comm, lambda: Path(tempfile.mkdtemp(prefix="softmodels-")))
    try:
        yield path
    finally:
        if is_root(comm):
            shutil.rmtree(path, ignore_errors=True)


def load(folder: str | Path) -> Run:
    """A run from a folder of results; DOLFINx is needed only where a state is asked for that is not stored.

    Raises:
        ResultsError: No results, or none that can be read.
        CaseError: No case file, or a wrong one.
    """
    source = InFolder(Path(folder))
    try:
        summary = json.loads((Path(folder) / "summary.json").read_text())
        ended = Ended(int(summary["status"]), str(summary["message"]))
    except (OSError, ValueError, KeyError, TypeError):
        ended = Ended()  # a run that goes on, or was cut off
    return Run(source, ended, solve=run)


def limit(
    device: Actuator,
    material: Material,
    *,
    sheet: Sheet | None = None,
    obstacle: Obstacle | None = None,
    formulation: str = "mixed",
) -> Limit:
    """How far a device can be inflated: its first limit point or bifurcation, and where it is strained most there.

    Args:
        device: The device.
        material: Its silicone.
        sheet, obstacle, formulation: As of a `Case`.

    Raises:
        CaseError: What cannot be meant.
        RunError: The equations cannot be made or solved.
        MeshingError, MeshFileError: The device cannot be meshed.
    """
    from softmodels.mechanics.body import BodyError
    from softmodels.mechanics.compiling import CompilingError

    # What no case may be, no limit is asked of; its load is not looked at.
    Case("limit", device, material, pressures_cm=(1.0,), formulation=formulation, sheet=sheet, obstacle=obstacle)
    comm = start()
    try:
        with _sentences():
            return find_limit(device, [material], comm, sheet, obstacle, formulation)[0]
    except (BodyError, CompilingError) as error:
        raise RunError(str(error)) from error
