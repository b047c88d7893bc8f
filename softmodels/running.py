"""From a case to a folder of results: the one way in which every command runs a device.

Exit status: 0 all requested values reached; 1 the run failed; 2 bad input, found before anything was solved; 3 a requested
value is not on the path (a limit point); 130 stopped by the user. Whatever happened, all steps up to it are in the folder.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from geometries import MeshingError
from softmodels.case import Case, CaseError
from softmodels.compiling import CompilingError, cache, compiling, wait_for_cache
from softmodels.materials import MaterialError
from softmodels.parallel import abort_on_error, any_rank, is_root, on_root, petsc_reason, start
from softmodels.progress import Progress
from softmodels.results import Results, ResultsError, replace

DONE, FAILED, BAD_INPUT, NO_EQUILIBRIUM, STOPPED = 0, 1, 2, 3, 130
VOLUME_CHANGE = 0.1
"""Change of a cell's volume above which the user is told."""
FEWEST_STEPS = 12
"""At least this many steps to the last requested value, for curves worth drawing."""
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
STOPS = (signal.SIGINT, signal.SIGTERM)
MESH_END = b"$EndElements"


class RunError(RuntimeError):
    """A run that cannot go on; ``status`` is the exit status, the message a sentence for the user."""

    def __init__(self, message: str, status: int = FAILED):
        super().__init__(message)
        self.status = status


def run(
    case: Case, folder: Path, *, resume: bool = False, quiet: bool = False, petsc: Sequence[str] = (), draw: bool = True
) -> int:
    """Run a case and return the exit status; all messages go to standard error, the summary to standard output.

    Args:
        case: What to run.
        folder: Where the results go.
        resume: Go on from what an interrupted run of the same case left there.
        quiet: Only errors are said.
        petsc: Words for PETSc's option database.
        draw: Make the pictures at the end.

    Raises:
        StartError: PETSc cannot take the words.
    """
    comm = start(petsc)
    abort_on_error(comm)
    from petsc4py import PETSc

    results = Results(folder, case.name)
    unit = "cm" if case.pressures_cm else "ml"
    progress = Progress((case.pressures_cm or case.volumes_ml)[-1], unit, quiet or not is_root(comm))
    status, message = DONE, ""
    try:
        with progress, _interruptible() as stopped:
            kept = on_root(comm, lambda: _prepare(case, results, resume))
            message = _follow(case, results, comm, progress, stopped, kept)
    except RunError as error:
        status, message = error.status, str(error)
    except (MeshingError, CaseError, MaterialError, ResultsError) as error:
        status, message = FAILED if isinstance(error, MeshingError) else BAD_INPUT, str(error)
    except PETSc.Error as error:
        # What PETSc refuses before anything is solved are the words it was given.
        words = bool(petsc) and not on_root(comm, lambda: results.stored)
        advice = (
            "check the words after --"
            if words
            else "rerun with -- -snes_monitor -ksp_error_if_not_converged to see more"
        )
        status, message = BAD_INPUT if words else FAILED, f"PETSc stopped ({petsc_reason(error)}); {advice}"
    except OSError as error:
        reason = error.strerror or error
        status, message = (
            FAILED,
            f"the results cannot be written ({reason}); make room for them and go on with --resume",
        )
    except MemoryError:
        status, message = FAILED, "the machine's memory is full; use a larger --cell-size or --section axisymmetric"
    return on_root(comm, lambda: _close(case, results, status, message, quiet, draw))


@contextlib.contextmanager
def _interruptible() -> Iterator[list[int]]:
    """Collect Ctrl-C and SIGTERM in a list, to be looked at between steps; a second Ctrl-C ends the process at once."""
    received: list[int] = []

    def note(number: int, frame: Any) -> None:
        if received:
            os._exit(STOPPED)
        received.append(number)

    before = {number: signal.signal(number, note) for number in STOPS}
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _renew_handlers() -> None:
    """Put the handlers back in place: Gmsh, when it starts, takes some away behind Python's back."""
    for number in (*STOPS, signal.SIGPIPE):
        signal.signal(number, signal.getsignal(number))


def _prepare(case: Case, results: Results, resume: bool) -> bool:
    """Make the folder; on resume, check that it belongs to this case. Returns whether there are states to go on from."""
    folder, file = results.folder, results.folder / "case.toml"
    if resume and file.exists():
        _check_same(case, Case.from_file(file), folder)
        if results.heavy.exists():
            results.load()
            _drop_between(case, results)
            _check_values(case, results)
            _write(file, case.to_toml())
            return bool(results.stored)
    try:
        results.clear()
        _write(file, case.to_toml())
    except OSError as error:
        status = FAILED if error.errno in FULL else BAD_INPUT
        raise RunError(f"the folder {folder} cannot be written ({error.strerror})", status) from None
    return False


def _check_same(case: Case, old: Case, folder: Path) -> None:
    """Refuse to go on from a run whose numbers would not be this case's."""
    for field in ("name", "actuator", "material", "control", "formulation", "water_density"):
        if getattr(old, field) != getattr(case, field):
            raise RunError(
                f"{folder} holds a run with another {field}; resume with its options, or run without --resume",
                BAD_INPUT,
            )
    if bool(old.pressures_cm) != bool(case.pressures_cm):
        had = "pressures" if old.pressures_cm else "volumes"
        raise RunError(
            f"{folder} holds a run to requested {had}; resume with those, or run without --resume", BAD_INPUT
        )


def _drop_between(case: Case, results: Results) -> None:
    """Forget the last states if they were solved for between two steps of which the second is missing.

    They are found again, with that step. Going on from one of them would cut the path into other steps.
    """
    quantity = "pressure" if case.pressures_cm else "volume"
    while results.stored:
        row = results.stored[-1].row
        if not (row["limit"] or (row["requested"] and row["step"] and row["following"] != quantity)):
            return
        results.stored.pop()


def _check_values(case: Case, results: Results) -> None:
    """Refuse requested values that the stored states have passed without stopping there."""
    key, unit = ("pressure_cm", "cm") if case.pressures_cm else ("added_volume_ml", "ml")
    reached = max((row[key] for row in results.rows), default=0.0)
    for value in case.pressures_cm or case.volumes_ml:
        if 0.0 < value < reached * (1 - 1e-9) and not _stopped_at(results, key, value):
            raise RunError(
                f"{results.folder} holds a run that has passed {value:g} {unit} without stopping there; "
                "resume with its values, or run without --resume",
                BAD_INPUT,
            )


def _stopped_at(results: Results, key: str, value: float) -> bool:
    return any(row["requested"] and math.isclose(row[key], value, rel_tol=1e-6) for row in results.rows)


def _write(path: Path, text: str) -> None:
    replace(path, lambda aside: aside.write_text(text))


def _mesh(case: Case, path: Path) -> None:
    """Write the mesh file. Gmsh does not tell of a full disk: its file then ends early."""
    case.actuator.write(path)
    _renew_handlers()
    if MESH_END not in path.read_bytes()[-2 * len(MESH_END) :]:
        path.unlink()
        raise OSError(errno.ENOSPC, "the mesh file ended early; is the disk full?")


def _follow(case: Case, results: Results, comm: Any, progress: Progress, stopped: list[int], resumed: bool) -> str:
    """Solve, and write every step; returns the closing sentence."""
    from softmodels.body import Body, BodyError
    from softmodels.equilibrium import Equilibrium, NoConvergence
    from softmodels.fields import Fields
    from softmodels.loading import Path as LoadPath
    from softmodels.loading import PathEnd, trace

    mesh = results.folder / f"{case.name}.msh"
    if not (resumed and mesh.exists()):
        progress.say(f"meshing {type(case.actuator).__name__} ({case.actuator.section})")  # type: ignore[attr-defined]
        on_root(comm, lambda: _mesh(case, mesh))
    progress.say("preparing the equations (compiled the first time, half a minute; then from the cache)")
    on_root(comm, lambda: wait_for_cache(cache(), progress.say, lambda: bool(stopped)))
    _stop_if_asked(comm, stopped)
    try:
        body = Body.from_file(case.actuator, mesh, comm)
        _renew_handlers()
        with compiling():
            equilibrium = Equilibrium(body, case.material, case.formulation)
            fields = Fields(equilibrium)
    except (BodyError, CompilingError) as error:
        raise RunError(str(error)) from error
    dofs = equilibrium.space.dofmap.index_map.size_global * equilibrium.space.dofmap.index_map_bs
    cells = body.mesh.topology.index_map(body.mesh.topology.dim).size_global
    progress.say(f"{cells} cells, {dofs} unknowns, {comm.size} rank{'s' if comm.size > 1 else ''}")

    quantity = "pressure" if case.pressures_cm else "volume"
    scale = equilibrium.stress_unit if case.pressures_cm else equilibrium.volume_unit
    goals = [goal / scale for goal in case.goals]
    path = LoadPath(equilibrium, case.control, quantity, goals[-1] / FEWEST_STEPS)
    path.report = lambda text: progress.say(f"  {text}")
    begin: list[Any] = []
    if resumed:
        key = "pressure_cm" if case.pressures_cm else "added_volume_ml"
        values = case.pressures_cm or case.volumes_ml
        left = on_root(comm, lambda: [not _stopped_at(results, key, value) for value in values])
        goals = [goal for goal, wanted in zip(goals, left, strict=True) if wanted]
        begin = _stored_points(results, fields, comm)
        progress.say(f"going on from step {on_root(comm, lambda: len(results.stored) - 1)}")
    else:
        on_root(comm, lambda: results.begin(fields.grid.points, fields.grid.cells, fields.grid.cell_name))
    try:
        for point in trace(path, goals, begin):
            _keep(case, results, fields, comm, progress, point)
            _stop_if_asked(comm, stopped)
    except PathEnd as end:
        raise RunError(_explain(case, end, fields, path), NO_EQUILIBRIUM if end.limit else FAILED) from end
    except NoConvergence as failure:  # at the first state or a limit point, where there is no step to shorten
        raise RunError(
            f"the path could not be followed ({failure}); leave out PETSc's options if there are any, refine the mesh "
            "(--cell-size), or use another --control"
        ) from failure
    return ""


def _stop_if_asked(comm: Any, stopped: list[int]) -> None:
    if any_rank(comm, bool(stopped)):
        raise RunError("stopped by the user; go on with --resume", STOPPED)


def _keep(case: Case, results: Results, fields: Any, comm: Any, progress: Progress, point: Any) -> None:
    """Write one point of the path."""
    figures, nodal = fields.figures(point.state), fields.nodal(point.state)
    restart = {
        "P": point.state.P, "V": point.state.V, "requested": point.requested, "limit": point.limit, "step": point.step,
        "line": point.line, "factorised": point.factorised, "age": point.age, "stiffest": point.stiffest,
        "iterations": point.state.iterations,
    }  # fmt: skip

    def write() -> None:
        height = figures.pressure / case.cm
        if point.requested and case.pressures_cm:  # as it was typed, without the rounding of two conversions
            height = min(case.pressures_cm, key=lambda asked: abs(asked - height))
        row = {
            "step": len(results.stored),
            "pressure_cm": height,
            "pressure_Pa": figures.pressure,
            "added_volume_ml": figures.added_volume * 1e6,
            **{f"{name}_mm": rise * 1e3 for name, rise in figures.rises.items()},
            "max_displacement_mm": figures.max_displacement * 1e3,
            "max_stretch": figures.max_stretch,
            "max_von_mises_kPa": figures.max_von_mises / 1e3,
            "J_min": figures.J_min,
            "J_max": figures.J_max,
            "newton_iterations": point.state.iterations,
            "stored_energy_mJ": figures.stored_energy * 1e3,
            "requested": int(point.requested),
            "limit": int(point.limit),
            "following": point.line,
        }
        results.add(row, nodal, restart)
        progress.step(row, row["pressure_cm"] if case.pressures_cm else row["added_volume_ml"])

    on_root(comm, write)


def _stored_points(results: Results, fields: Any, comm: Any) -> list[Any]:
    """The points a trace goes on from: the first limit point, the last one factorised at, and the last two."""
    from softmodels.equilibrium import Tangent
    from softmodels.loading import Point

    records = on_root(comm, lambda: [stored.restart for stored in results.stored])
    count = len(records)
    factorised = max(i for i, record in enumerate(records) if record["factorised"])
    limits = [i for i, record in enumerate(records) if record["limit"]][:1]
    points = []
    for i in sorted({*limits, factorised, max(count - 2, 0), count - 1}):
        record = dict(records[i])
        nodal = results.fields(i, ("displacement", "p")) if is_root(comm) else None
        state = dataclasses.replace(
            fields.state(nodal, record.pop("P"), record.pop("V")), iterations=record.pop("iterations")
        )
        points.append(Point(state, Tangent(np.zeros_like(state.w), 0.0, 0.0), **record))
    return points


def _explain(case: Case, end: Any, fields: Any, path: Any) -> str:
    """Why the path ended, where, and what can be done about it."""
    asked = f"{case.pressures_cm[-1]:g} cm" if case.pressures_cm else f"{case.volumes_ml[-1]:g} ml"
    last = fields.figures(path.last.state)
    if end.limit is None:
        return (
            f"{asked} was not reached: {end}. The last state is at {last.pressure / case.cm:.4g} cm "
            f"({last.pressure:.4g} Pa), apex {last.rises['apex'] * 1e3:+.4g} mm. Steps down to a thousandth of the first were "
            "tried. If the curve was flattening, use --control auto or arc-length, which pass limit points; otherwise "
            "refine the mesh (--cell-size), or look at the last state for cells that fold"
        )
    at = fields.figures(end.limit.state)
    return (
        f"no equilibrium at {asked} on this path: the pressure has a limit point at {at.pressure / case.cm:.4g} cm "
        f"({at.pressure:.5g} Pa), where the apex has risen {at.rises['apex'] * 1e3:.4g} mm (cavity ceiling "
        f"{at.rises['ceiling'] * 1e3:.4g} mm) and the cavity has taken {at.added_volume * 1e6:.4g} ml; beyond it the "
        f"device balloons. Stay below (with 25 % margin: {0.8 * at.pressure / case.cm:.4g} cm), take a thicker membrane "
        "(--membrane), a smaller cavity (--cavity-radius) or a stiffer silicone, or drive it by volume past the limit "
        "(--volume-ml, or --control volume)"
    )


def _close(case: Case, results: Results, status: int, message: str, quiet: bool, draw: bool) -> int:
    """Gather the results, draw them, say how it ended."""
    stored = results.stored
    if stored and status != BAD_INPUT:
        try:
            results.finish()
            text = {"status": status, "message": message, "steps": len(stored), "last": results.rows[-1]}
            _write(results.folder / "summary.json", json.dumps(text, indent=2) + "\n")
            if draw and status in (DONE, NO_EQUILIBRIUM):
                _draw(results)
        except OSError as error:
            status = status or FAILED
            message = message or (
                f"the steps could not be gathered in one file ({error.strerror or error}); "
                "make room and run again with --resume"
            )
    if message:
        states = "1 state" if len(stored) == 1 else f"{len(stored)} states"
        where = (
            f". The results up to there ({states}) are in {results.folder}" if stored and status != BAD_INPUT else ""
        )
        print(f"softmodels: {message}{where}", file=sys.stderr)
    elif not quiet:
        row = results.rows[-1]
        if row["J_min"] < 1 - VOLUME_CHANGE or row["J_max"] > 1 + VOLUME_CHANGE:
            print(
                f"softmodels: note: the silicone's own volume changed to {row['J_min']:.3f} to {row['J_max']:.3f} of what it "
                "was; rubber keeps it, so take --poisson nearer to 0.5, or a finer mesh where cells are few",
                file=sys.stderr,
            )
        print(
            f"{row['pressure_cm']:.6g} cm ({row['pressure_Pa'] / 1e3:.5g} kPa): apex {row['apex_mm']:+.5g} mm, "
            f"added volume {row['added_volume_ml']:.5g} ml, largest stretch {row['max_stretch']:.4g}, "
            f"largest von Mises stress {row['max_von_mises_kPa']:.4g} kPa, J {row['J_min']:.4f} to {row['J_max']:.4f}"
        )
        pictures = ", pictures (*.png)" if draw else ""
        print(f"{len(stored)} states in {results.folder}: path.csv, {results.name}.xdmf for ParaView{pictures}")
    return status


def _draw(results: Results) -> None:
    """Draw in a process of its own: VTK and DOLFINx each bring an HDF5."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("PMI", "HYDRA", "MPI", "OMPI", "PMIX"))}
    command = [sys.executable, "-m", "softmodels.pictures", str(results.folder), "--name", results.name]
    done = subprocess.run(command, env=inherited, capture_output=True, text=True, check=False)
    if done.returncode == 0:
        print(done.stderr, end="", file=sys.stderr)  # such as that this machine cannot render
    else:
        reason = (done.stderr or done.stdout).strip().splitlines() or [f"exit status {done.returncode}"]
        print(f"softmodels: the pictures could not be drawn ({reason[-1]}); the results are complete", file=sys.stderr)
