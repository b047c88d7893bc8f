"""The end of a run: results gathered, pictures drawn, and one sentence for the user."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

from geometries import Actuator
from geometries.apart import interpreter
from measurement.own_folder import OwnFolderError
from softmodels.case.case import Case
from softmodels.materials.silicones import stretch_at_break
from softmodels.path.schedule import step_text
from softmodels.results.columns import cavity_columns
from softmodels.results.glossary import split, term
from softmodels.results.lost_path import advice
from softmodels.results.notes import notes_of
from softmodels.results.outcomes import BAD_INPUT, DONE, FAILED, NO_EQUILIBRIUM
from softmodels.results.stability_report import events, stability_text
from softmodels.results.store import Results, write_text


def explain(case: Case, end: Any, fields: Any, path: Any, petsc: bool = False) -> str:
    """Why the path ended, where, and what can be done about it; ``petsc`` is whether PETSc had options of its own."""
    asked = f"{case.values[-1]:g} {case.unit}"
    device, last = case.actuator, fields.figures(path.last.state)
    if end.limit is None:
        return (
            f"{asked} was not reached: {end}. The last state is at {last.pressure / case.cm:.4g} cm "
            f"({last.pressure:.4g} Pa), {device.gauge} rise {last.rises[device.gauge] * 1e3:+.4g} mm, largest stretch "
            f"{last.max_stretch:.3g}. Steps down to a thousandth of the first were tried. "
            + advice(case, {"max_stretch": last.max_stretch, "J_min": last.J_min, **last.device}, petsc)
        )
    at = fields.figures(end.limit.state)
    if path.supply is not None:
        stroke = path.value(end.limit.state) * fields.equilibrium.volume_unit * 1e6
        return (
            f"a stroke of {asked} was not reached: {end}. The stroke has a limit point at {stroke:.4g} ml "
            f"({at.pressure / case.cm:.4g} cm), where {_risen(device, at.rises)} and the cavity has taken "
            f"{at.added_volume * 1e6:.4g} ml; beyond it the gas in syringe and tubes expands by itself and the device jumps. "
            "Stay below, or take a smaller --dead-volume or --gas liquid"
        )
    return (
        f"no equilibrium at {asked} on this path: the pressure has a limit point at {at.pressure / case.cm:.4g} cm "
        f"({at.pressure:.5g} Pa), where {_risen(device, at.rises)} and the cavity has taken "
        f"{at.added_volume * 1e6:.4g} ml; beyond it the device balloons. Stay below (with 25 % margin: "
        f"{0.8 * at.pressure / case.cm:.4g} cm), take {device.stiffer} or a stiffer silicone, or drive it by volume past "
        "the limit (--volume-ml, or --control volume)"
    )


def explain_step(case: Case, end: Any, rows: Sequence[Mapping[str, Any]], come: float, petsc: bool = False) -> str:
    """The same of a program's step."""
    number = math.floor(come) + 1
    at = next((row for row in reversed(rows) if row["limit"]), rows[-1]) if end.limit else rows[-1]
    pressures, volumes = cavity_columns(at, "pressure", "cm"), cavity_columns(at, "added_volume", "ml")
    names = [f"cavity{i} at " for i in range(1, len(pressures) + 1)] if len(pressures) > 1 else [""]
    place = ", ".join(
        f"{name}{at[pressure]:.4g} cm with {at[volume]:.4g} ml added"
        for name, pressure, volume in zip(names, pressures, volumes, strict=True)
    )
    asked = f"step {number} of the program ({step_text(case.program, number)})"
    gauge = case.actuator.gauge
    moved = f"the {gauge} has moved {at[f'{gauge}_mm']:+.4g} mm"
    if end.limit is None:
        return (
            f"{asked} was not reached: {end}. The last state has {place}, and {moved}. Steps down to a thousandth of the first "
            f"were tried. {advice(case, at, petsc)}"
        )
    return (
        f"no equilibrium at {asked} on this path: its loads have a limit point with {place}, where {moved}; beyond it a "
        f"cavity balloons. Stay below, take {case.actuator.stiffer} or a stiffer silicone, or give that cavity's added volume "
        "(volume_ml) in place of its pressure"
    )


def _risen(device: Actuator, rises: dict[str, float]) -> str:
    """How far the device has moved: its gauge, and the other probes in brackets."""
    others = ", ".join(f"{name} {rise * 1e3:.4g} mm" for name, rise in rises.items() if name != device.gauge)
    return f"the {device.gauge} has risen {rises[device.gauge] * 1e3:.4g} mm" + (f" ({others})" if others else "")


def close(case: Case, results: Results, status: int, message: str, quiet: bool, draw: bool) -> int:
    """Gather the results, draw them, say how it ended."""
    stored, took = results.stored, None
    notes = notes_of(case, results.rows) if stored and status != BAD_INPUT else []
    if stored and status != BAD_INPUT:
        try:
            gather(case, results, status, message, notes)
            results.own.forget_unwritten()
            if draw and status in (DONE, NO_EQUILIBRIUM):
                if not quiet:
                    print("drawing pictures, film and report (--no-pictures leaves them out)", file=sys.stderr)
                took = _draw(results)
        except (OSError, OwnFolderError) as error:
            status = status or FAILED
            message = message or (
                f"the steps could not be gathered in one file ({getattr(error, 'strerror', None) or error}); "
                "make room and run again with --resume"
            )
    if message:
        states = "1 state" if len(stored) == 1 else f"{len(stored)} states"
        where = (
            f". The results up to there ({states}) are in {results.own.path}" if stored and status != BAD_INPUT else ""
        )
        print(f"softmodels: {message}{where}", file=sys.stderr)
    for note in notes if not quiet else []:
        print(f"softmodels: note: {note}", file=sys.stderr)
    if not message and not quiet:
        row, gauge = results.rows[-1], case.actuator.gauge
        print(
            f"{_loaded(row)}: {gauge} rise {row[f'{gauge}_mm']:+.5g} mm, "
            f"added volume {row['added_volume_ml']:.5g} ml{pressed(row)}, "
            f"largest stretch {row['max_stretch']:.4g}{_bears(case)} and von Mises stress {row['max_von_mises_kPa']:.4g} kPa "
            f"(at integration points), J {row['J_min']:.4f} to {row['J_max']:.4f} (at vertices)"
        )
        if case.gauges.columns():
            print(", ".join(_gauge(name, row) for name in case.gauges.columns()))
        if told := stability_text(results.rows, case.actuator, branch_rows(results)):
            print(told)
        pictures = (
            f"; pictures (*.png), film.gif, film.webp and report.html, in {took:.1f} s" if took is not None else ""
        )
        print(f"{len(stored)} states in {results.folder}: path.csv, {results.name}.xdmf for ParaView{pictures}")
    return status


def _gauge(column: str, row: Mapping[str, Any]) -> str:
    """A named place or angle with its unit."""
    name, unit = split(column)
    return f"{name.replace('_', ' ')} {row[column]:.5g}{unit if unit == '°' else f' {unit}'}"


def _loaded(row: Mapping[str, Any]) -> str:
    cavities = cavity_columns(row, "pressure", "cm")
    if "load_step" in row and len(cavities) > 1:
        return ", ".join(f"cavity{i} {row[name]:.6g} cm" for i, name in enumerate(cavities, 1))
    return f"{row['pressure_cm']:.6g} cm ({row['pressure_Pa'] / 1e3:.5g} kPa)"


def pressed(row: Mapping[str, Any]) -> str:
    """The forces of the device on what stops it, as a part of the closing line."""
    forces = ("blocked_force_N", "contact_force_N")
    return "".join(f", {term(name).name} {row[name]:.4g} N" for name in forces if name in row)


def gather(case: Case, results: Results, status: int, message: str, notes: Sequence[str]) -> None:
    """Bring all steps into one file and write ``summary.json``, with the notes of `notes_of`.

    Raises:
        OSError: There is no room; the steps stay where they are.
    """
    results.finish()
    text = {
        "status": status, "message": message, "steps": len(results.stored), "last": results.rows[-1],
        "events": events(results.rows, case.actuator.gauge), "stretch_at_break": stretch_at_break(case.material),
        "notes": list(notes), "stability": stability_text(results.rows, case.actuator, branch_rows(results)),
    }  # fmt: skip
    results.own.claim(["summary.json"])
    write_text(results.folder / "summary.json", json.dumps(text, indent=2) + "\n")


def branch_rows(results: Results) -> list[dict[str, Any]]:
    """The rows of the branch that was followed; none if none was."""
    branch = results.branch()
    if branch.heavy.exists():
        branch.load()
    return branch.rows


def _bears(case: Case) -> str:
    breaks = stretch_at_break(case.material)
    return "" if breaks is None else f" (broke at {breaks:.4g})"


def _draw(results: Results) -> float | None:
    """Draw in a process of its own, for VTK and DOLFINx each bring an HDF5; the seconds it took, None if it failed."""
    begun = time.monotonic()
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("PMI", "HYDRA", "MPI", "OMPI", "PMIX"))}
    command = [*interpreter(), "-m", "softmodels.pictures.draw", str(results.folder), "--name", results.name]
    done = subprocess.run(command, env=inherited, capture_output=True, text=True, check=False)
    if done.returncode == 0:
        print(done.stderr, end="", file=sys.stderr)  # such as that this machine cannot render
        return time.monotonic() - begun
    reason = (done.stderr or done.stdout).strip().splitlines() or [f"exit status {done.returncode}"]
    print(f"softmodels: the pictures could not be drawn ({reason[-1]}); the results are complete", file=sys.stderr)
    return None
