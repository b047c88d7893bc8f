"""The end of a run: results gathered, pictures drawn, and one sentence for the user."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any

from softmodels.case import Case
from softmodels.outcomes import BAD_INPUT, DONE, FAILED, NO_EQUILIBRIUM
from softmodels.results import Results, write_text
from softmodels.stability_report import events, stability_text

VOLUME_CHANGE = 0.1
"""Change of a cell's volume above which the user is told."""


def explain(case: Case, end: Any, fields: Any, path: Any) -> str:
    """Why the path ended, where, and what can be done about it."""
    asked = f"{case.values[-1]:g} {case.unit}"
    last = fields.figures(path.last.state)
    if end.limit is None:
        return (
            f"{asked} was not reached: {end}. The last state is at {last.pressure / case.cm:.4g} cm "
            f"({last.pressure:.4g} Pa), apex {last.rises['apex'] * 1e3:+.4g} mm, largest stretch {last.max_stretch:.3g}. "
            "Steps down to a thousandth of the first were tried. If the curve was flattening, use --control auto or "
            "arc-length, which pass limit points; otherwise refine the mesh (--cell-size), or look at the last state for "
            "cells that fold"
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


def close(case: Case, results: Results, status: int, message: str, quiet: bool, draw: bool) -> int:
    """Gather the results, draw them, say how it ended."""
    stored = results.stored
    if stored and status != BAD_INPUT:
        try:
            results.finish()
            text: dict[str, Any] = {
                "status": status,
                "message": message,
                "steps": len(stored),
                "last": results.rows[-1],
            }
            text["events"] = events(results.rows)
            write_text(results.folder / "summary.json", json.dumps(text, indent=2) + "\n")
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
        if told := stability_text(results.rows, case.actuator):
            print(told)
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
