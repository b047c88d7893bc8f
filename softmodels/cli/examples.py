"""``softmodels demo`` and ``softmodels examples``: the whole workflow on a known silicone, and files to try commands with.

The demonstration simulates, photographs, measures, fits, and compares with the truth. The examples are a small version of it,
with a tensile curve, boards for the camera's lens, a part from a STEP file and a case of each kind. Existing files are kept.

The examples come with the package, in the folder ``files``; `tests.support.example_files` makes those of its folder ``made``.
"""

from __future__ import annotations

import dataclasses
import json
import math
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from geometries import HollowDisk
from measurement import photographer
from softmodels.case import load, materials
from softmodels.case.case import Case
from softmodels.cli import ending, options
from softmodels.common import commands, files, processes, units
from softmodels.common.arrays import Array
from softmodels.common.lazy import MPI
from softmodels.fitting import problem
from softmodels.fitting.outlines import shapes
from softmodels.fitting.outlines.device import DeviceModel
from softmodels.fitting.outlines.residuals import readings_of
from softmodels.mechanics import mpi

WRITTEN = ("case.toml", "photographs/", "setup.toml", "setup.png", "outlines/", "fit/", "compared.json")
"""Files that the demonstration writes into its folder."""
AXIS_POSITION = 1.3e-3
"""Position of the device's axis along the screen in m, unknown to the fit."""
LEAK_SHARE = 0.01
"""Share of the largest pressure that the hose leaks."""
HALF_WIDTH = 0.2
"""Half width in m of the support, which ends outside of the picture."""


@dataclasses.dataclass(frozen=True)
class DemoTruth:
    """The true parameters, unknown to the fit: the device as a section, its law and numbers by name, and pressures in Pa,
    rising. Poisson's ratio is the default, which the fit takes as given."""

    actuator: HollowDisk
    law: str
    values: dict[str, float]
    pressures: tuple[float, ...]


TRUTH = DemoTruth(
    HollowDisk(section="axisymmetric"), "yeoh", {"c1": 14e3, "c2": 900.0, "c3": 0.0},
    tuple(cm * units.COLUMN.pascal for cm in np.linspace(20.0, 177.0, 9)),
)  # fmt: skip


def scene_of(megapixels: float) -> photographer.Scene:
    """Return the demo bench with a sensor of another size in megapixels; 18 is the thesis' camera."""
    factor = (megapixels * 1e6 / (photographer.SCENE.width * photographer.SCENE.height)) ** 0.5
    return dataclasses.replace(
        photographer.SCENE, width=round(photographer.SCENE.width * factor), height=round(photographer.SCENE.height * factor),
        focal_px=photographer.SCENE.focal_px * factor, pixel_size=photographer.SCENE.pixel_size / factor,
        blur=photographer.SCENE.blur * factor**0.5,
    )  # fmt: skip


def inflated(truth: DemoTruth, comm: MPI.Comm) -> tuple[DeviceModel, list[Array]]:
    """Simulate the device with its true material; return the right half of its outline in m at each pressure."""
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System

    choice = problem.LawChoice.from_text(truth.law)
    with tempfile.TemporaryDirectory() as folder:
        body = Body.from_file(truth.actuator, truth.actuator.write(Path(folder) / "disk.msh"), comm)
    device = DeviceModel(Solver(System(body, choice.material(truth.values))), choice)
    states = device.states(truth.values, truth.pressures, "pressure")
    device.set_parameters(truth.values)
    return device, [shapes.half_outline(device.curve(state), 2e-5, 0.0)[0] for state in states]


def polygon(half: Array) -> Array:
    """Return the shadow (k, 2) in m of a device that stands level with its support."""
    places = np.vstack([half[:0:-1] * [-1.0, 1.0], half])
    places[:, 1] = np.maximum(places[:, 1], 0.0)
    sides = [[HALF_WIDTH, 0.0], [HALF_WIDTH, -HALF_WIDTH], [-HALF_WIDTH, -HALF_WIDTH], [-HALF_WIDTH, 0.0]]
    return np.vstack([places, sides]) + np.array([AXIS_POSITION, photographer.SURFACE_HEIGHT])


def take_photographs(
    folder: Path,
    truth: DemoTruth,
    halves: Sequence[Array],
    scene: photographer.Scene,
    tell: Callable[[str], None] = lambda text: None,
    times: Sequence[str] = (),
    keep: Callable[[Path, NDArray[np.uint8]], Path] = photographer.save,
) -> None:
    """Write the grid's photograph (number 100, or 200 with times), one at rest, one per pressure, and ``photos.csv`` with the
    column's levels and the columns hold and rise of ``times``; ``halves`` are the right halves of the outline in m; ``keep``
    writes a photograph.

    Levels are read to a millimetre with the error the measurement takes them to have; the leak makes them too high. One that
    stays the same is read once.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rng, first = np.random.default_rng(2013), 200 if times else 100
    keep(folder / f"IMG_{first:04d}.JPG", photographer.photograph(scene, None, seed=first)[0])
    rest = np.array([[0.0, 0.0], [truth.actuator.outer_radius, 0.0]])
    readings = [0.0, *readings_of(np.array(truth.pressures), {"leak": LEAK_SHARE})]
    rows, before, levels = ["file,left,right" + (",hold,rise" if times else "")], math.nan, ""
    columns = ["", *times] if times else [""] * len(readings)
    for number, (half, reading, column) in enumerate(zip([rest, *halves], readings, columns, strict=True), first + 1):
        tell(f"photograph {number - first} of {len(readings)}")
        keep(folder / f"IMG_{number:04d}.JPG", photographer.photograph(scene, polygon(half), seed=number)[0])
        half_column = reading / units.COLUMN.pascal / 2.0
        if reading != before:
            left, right = (100.0 + sign * half_column + 0.05 * rng.standard_normal() for sign in (1.0, -1.0))
            before, levels = reading, f"{left:.2f} cm,{right:.2f} cm"
        rows.append(f"IMG_{number:04d}.JPG,{levels}{column or (',,' if times else '')}")
    (folder / "photos.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")


def demo_commands(folder: Path, truth: DemoTruth) -> list[tuple[str, list[str]]]:
    """Return what a user types: module or program, and its arguments."""
    setup, outlines = folder / "setup.toml", folder / "outlines"
    photographs = folder / "photographs"
    held = [word for name, value in truth.values.items() if value == 0.0 for word in ("--fix", f"{name}=0Pa")]
    return [
        ("measurement", ["setup", str(photographs / "IMG_0100.JPG"), "--lens", "none", "-o", str(setup)]),
        ("measurement", ["photos", str(photographs / "photos.csv"), "--setup", str(setup), "-o", str(outlines)]),
        ("softmodels", ["fit", str(folder / "case.toml"), str(outlines), "--material", truth.law,
                        *held, "-o", str(folder / "fit")]),
    ]  # fmt: skip


def write_case(folder: Path, truth: DemoTruth) -> None:
    """Write the case a user would have: device and pressures, with a silicone other than the true one."""
    heights = tuple(p / units.COLUMN.pascal for p in truth.pressures)
    text = Case("disk", truth.actuator, materials.DEFAULT, load.steps_of(pressure_cm=heights)).to_toml()
    (folder / "case.toml").write_text(text, encoding="utf-8")


def compared(folder: Path, truth: DemoTruth) -> tuple[list[str], bool]:
    """Return a line per parameter, truth against fit, and whether every 95 % interval contains the truth."""
    about = tomllib.loads((folder / "fit" / "fitted.toml").read_text())["fit"]
    known = {**{name: value for name, value in truth.values.items() if value}, "leak": LEAK_SHARE}
    lines, good = [], True
    for name, value in known.items():
        low, high = about["intervals_95"][name]
        inside = low <= value <= high
        good = good and inside
        verdict = "holds it" if inside else "MISSES it"
        fitted = about["values"][name]
        lines.append(f"  {name:6s} true {value:8.5g}  fitted {fitted:8.5g}  95 %: {low:.5g} to {high:.5g} {verdict}")
    return lines, good


@options.command("demo")
@click.option("-o", "--output", type=commands.FolderType(), help="Folder for all files.  [default: loop; loop-2 and "
              "so on if that exists]")  # fmt: skip
@click.option("--megapixels", type=click.FloatRange(1.0, 50.0), default=18.0, show_default=True,
              help="Size of the photographs; 18 is the thesis' camera.")  # fmt: skip
def demo(output: Path | None, megapixels: float) -> None:
    """Run the whole workflow with a known silicone.

    It is simulated and photographed, the photographs are measured, and a law is fitted and compared.

    Takes a few minutes with 18 megapixels. Exit status: 0 if every 95 % interval contains the truth, else 1.
    """
    comm = mpi.start()
    if comm.size > 1:
        ending.fail("the demonstration runs on one process only; start it without mpirun")
    with ending.unwritable("the demonstration"):
        place = commands.open_place(output, Path("loop"), "demonstration of the whole workflow", WRITTEN)
        write_case(place, TRUTH)
        click.echo("simulating the true device")
        _, halves = inflated(TRUTH, comm)
        photographs = commands.open_folder(place / "photographs", place, "photographs", {})
        with photographs.writing() as folder:
            take_photographs(folder, TRUTH, halves, scene_of(megapixels), click.echo)
        photographs.leave()
    for module, words in demo_commands(place, TRUTH):
        click.echo(f"$ python -m {module} {' '.join(words)}")
        line, environment = processes.python(module, *words)
        status = subprocess.run(line, env=environment, check=False).returncode
        if status != commands.EXIT_DONE:
            ending.fail(
                f"{module} {words[0]} ended with exit status {status}; the files so far are in {place}", commands.EXIT_FAILED
            )
    lines, good = compared(place, TRUTH)
    click.echo("\n".join(["compared with the truth:", *lines]))
    report = {"good": good, "lines": lines}
    (place / "compared.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    sys.exit(commands.EXIT_DONE if good else commands.EXIT_FAILED)


# ----------------------------------------------------------------------------------------------------------------------
# The command ``examples``: small files to try every command with.


FILES = Path(__file__).parent / "files"
MADE = FILES / "made"
"""What `tests.support.example_files` computes and renders."""


def _texts(group: str) -> dict[str, str]:
    files = sorted((FILES / group).rglob("*.toml"))
    return {file.relative_to(FILES / group).as_posix(): file.read_text(encoding="utf-8") for file in files}


CASES, BENCH, PROBLEMS = map(_texts, ("cases", "bench", "designs"))
"""Case files, one of each kind, each of which runs in seconds; those of experiments on a bench; design problems and studies."""


class Folder:
    """The folder for the examples, what was written, and what was there already; never overwrites a file."""

    def __init__(self, path: Path):
        self.path = path
        self.written: list[Path] = []
        self.kept: list[Path] = []

    def add(self, name: str, source: Path) -> None:
        """Copy a file, whole or not at all, unless it exists."""
        path = self.path / name
        if path.exists() or path.is_symlink():
            self.kept.append(path)
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        files.write_bytes(path, source.read_bytes())
        self.written.append(path)


def write_examples(path: Path) -> Folder:
    """Write all examples into a folder, made if missing."""
    folder = Folder(path)
    folder.add("README.txt", FILES / "README.txt")
    for group in (FILES / "cases", FILES / "bench", FILES / "designs", MADE):
        for file in sorted(file for file in group.rglob("*") if file.is_file()):
            folder.add(file.relative_to(group).as_posix(), file)
    return folder


@options.command("examples")
@click.option("-o", "--output", default=Path("examples"), show_default=True, type=click.Path(path_type=Path))
def examples(output: Path) -> None:
    """Write small files to try every command with.

    They are photographs, boards, a tensile curve, a STEP part, and cases.

    Existing files are kept.
    Exit status: 0 written, 1 failed, 2 the folder cannot be written.
    """
    if why := commands.trouble(output):
        ending.fail(f"the folder {output} cannot be written ({why})")
    with ending.unwritable("the examples"):
        folder = write_examples(output)
    for path in folder.kept:
        processes.say(f"{path} exists and is kept")
    count = len(folder.written) + len(folder.kept)
    processes.say(f"wrote {len(folder.written)} of {count} examples; {output}/README.txt describes them")
