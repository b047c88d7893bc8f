"""``softmodels grasp``: an object between equal fingers, how firmly they hold it, and the load that it bears."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np

from geometries import MeshingError
from geometries.options import QuantityType
from softmodels.case.entries import INPUT_ERRORS
from softmodels.cli.options import fail, open_on_root, taken, write_into
from softmodels.cli.run_command import case_of_file
from softmodels.common.commands import FolderType
from softmodels.common.files import write_bytes, write_text
from softmodels.common.processes import say
from softmodels.mechanics.component import ComponentError, direction as unit_vector
from softmodels.mechanics.mpi import abort_on_error, is_root, start
from softmodels.runs.grasp import STEPS, Grasp, GraspError, Held, grasp
from softmodels.runs.outcomes import Ended, RunError

USED_UP = 1e-2
"""Reserve of the friction cones over the load below which the object slips."""


@dataclasses.dataclass(frozen=True)
class GraspOptions:
    """The options of `grasp_command`."""

    fingers: int
    load: float
    direction: str
    label: str
    steps: int
    output: Path | None
    quiet: bool


@click.command("grasp")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--fingers", type=int, default=3, show_default=True, help="Number of equal fingers around the object.")
@click.option("--load", type=QuantityType("N"), default=0.0, help="Force on the object, reached in steps, such as 5mN.")
@click.option(
    "--direction", default="-z", show_default=True, help="Direction of that force, as the first finger sees it."
)
@click.option(
    "--object", "label", default="", help="Name of the object's [contact.NAME], if the case has several shapes."
)
@click.option(
    "--steps",
    type=click.IntRange(1, 1000),
    default=STEPS,
    show_default=True,
    help="Steps to each pressure and to the load; with friction more of them are more accurate.",
)
@click.option(
    "-o", "--output", type=FolderType(), help="Folder for the results.  [default: results/grasp, or results/grasp-2 …]"
)
@click.option("--quiet", is_flag=True, help="Print only errors.")
def grasp_command(file: Path, **values: object) -> None:
    """Close equal fingers around an object that is free in their plane, and load it.

    FILE is the case of one finger with a rigid cylinder that it presses on ([contact.NAME]); the others are its copies, turned
    around the cylinder's axis. At each pressure, and then at each step of the load, displacement and rotation of the object
    are those of equilibrium.

    Results: grasp.csv, with pose, force of each finger, force closure (1: friction can balance any force and moment in the
    plane) and the load that friction can balance as the fingers press now (bears_N); grasp.png.

    \b
    Exit status: 0 done; 1 failed; 2 bad input; 3 no equilibrium of the object at a requested pressure or load.

    \b
    Examples:
      softmodels grasp examples/grasp.toml --load 8mN
      softmodels grasp examples/grasp.toml --fingers 4 --load 5mN --direction x
    """
    options = dict(values)
    how = taken(GraspOptions, values)
    try:
        case = case_of_file(file, None)
        way = np.array(unit_vector(how.direction, "--direction"))
    except (*INPUT_ERRORS, ComponentError) as error:
        fail(str(error))
    comm = start()
    abort_on_error(comm)
    folder = open_on_root(comm, how.output, Path("results/grasp"), "grasp", options, [file])
    try:
        made, found = grasp(case, how.fingers, how.load, way, how.label, how.steps)
    except (*INPUT_ERRORS, ComponentError, GraspError, MeshingError, RunError) as error:
        fail(str(error), Ended.by(error).status)
    outlines = [made.outlines(held) for held in found]
    lost = found[-1].load < how.load * (1 - 1e-9)
    if is_root(comm) and folder is not None:

        def write(place: Path) -> None:
            from softmodels.pictures.analyses import grasp_figure
            from softmodels.pictures.style import png

            write_text(place / "grasp.csv", table(made, found))
            write_bytes(place / "grasp.png", png(grasp_figure(made, found, outlines)))

        write_into(folder, write, "the results")
        if not how.quiet:
            for text in [*told(made, found), f"results in {folder.path}: grasp.csv, grasp.png"]:
                say(text)
    if lost:
        fail(
            f"no equilibrium of the object at a load of {how.load:.4g} N: beyond {found[-1].load:.4g} N it leaves the fingers; "
            "use a higher pressure, more friction or more fingers",
            3,
        )
    sys.exit(0)


def table(made: Grasp, found: Sequence[Held]) -> str:
    """Return ``grasp.csv``."""
    fingers = range(1, len(made.angles) + 1)
    parts = ("along_N", "across_N", "press_N", "sliding")
    head = [
        "pressure_cm",
        "pressure_Pa",
        "load_N",
        "moved_along_mm",
        "moved_across_mm",
        "turned_deg",
        "closure",
        "bears_N",
    ]
    rows = [[*head, *(f"finger{k}_{part}" for k in fingers for part in parts)]]
    for held in found:
        numbers = [held.pressure / made.case.cm, held.pressure, held.load, *held.moved * 1e3, math.degrees(held.turned),
                   float(held.closed(made.shape.friction)), held.bears(made.shape.friction)]  # fmt: skip
        for force, press, sliding in zip(held.forces, held.press, held.sliding, strict=True):
            numbers += [*force, press, sliding]
        rows.append([f"{number:.9g}" for number in numbers])
    return "".join(",".join(row) + "\n" for row in rows)


def told(made: Grasp, found: Sequence[Held]) -> list[str]:
    """Return what a user wants to know, as sentences."""
    friction, lines = made.shape.friction, []
    for held in found if not found[-1].load else [held for held in found if not held.load] + [found[-1]]:
        forces = ", ".join(f"{force:.4g}" for force in held.press)
        closed = "force closure" if held.closed(friction) else "no force closure"
        lines.append(
            f"{held.pressure / made.case.cm:.4g} cm, load {held.load:.4g} N: the fingers press with {forces} N, {closed}; the "
            f"object has moved {_zero(held.moved[0] * 1e3):.4g} mm along and {_zero(held.moved[1] * 1e3):.4g} mm across the "
            f"load and turned by {_zero(math.degrees(held.turned)):.3g} deg"
        )
    loaded = [held for held in found if held.load]
    slipped = next((held for held in loaded if held.bears(friction) < (1 + USED_UP) * held.load), None)
    if friction and loaded:
        lines.append(
            f"it slips at a load of about {slipped.load:.4g} N, where friction is used up"
            if slipped
            else f"it does not slip up to {loaded[-1].load:.4g} N"
        )
    return lines


def _zero(value: float) -> float:
    """Return a value without the rounding errors of zero."""
    return value if abs(value) > 1e-9 else 0.0
