"""The whole workflow on a device of known silicone: simulate, photograph, measure, fit, compare with the truth."""

from __future__ import annotations

import dataclasses
import json
import tempfile
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from geometries import HollowDisk
from geometries.apart import interpreter
from measurement.synthetic.photographer import FLOOR, SCENE, Scene, photograph, save
from softmodels.case.case import Case
from softmodels.case.materials import DEFAULT
from softmodels.common.arrays import Array
from softmodels.common.commands import FolderType, open_folder, open_place, status_of
from softmodels.common.folders import OwnFolderError
from softmodels.common.units import pascal_per_cm
from softmodels.fitting.outlines.device import DeviceModel
from softmodels.fitting.outlines.simulated import half_outline, readings_of
from softmodels.fitting.problem import LawChoice
from softmodels.runs.outcomes import DONE, FAILED

if TYPE_CHECKING:
    from mpi4py import MPI


WRITTEN = ("case.toml", "photographs/", "setup.toml", "setup.png", "outlines/", "fit/", "compared.json")
"""Files that the demonstration writes into its folder."""
CENTRE = 1.3e-3
"""Position of the device's axis along the screen in m, unknown to the fit."""
LEAK = 0.01
"""Share of the largest pressure that the hose leaks."""
HALF_WIDTH = 0.2
"""Half width in m of the support, which ends outside of the picture."""


@dataclasses.dataclass(frozen=True)
class DemoTruth:
    """The true parameters, unknown to the fit.

    Attributes:
        actuator: The device, as a section.
        law: Its law.
        values: The law's numbers by name.
        poisson: Poisson's ratio, which the fit takes as given.
        pressures: True pressures in Pa, rising.
    """

    actuator: HollowDisk
    law: str
    values: dict[str, float]
    poisson: float
    pressures: tuple[float, ...]


TRUTH = DemoTruth(
    HollowDisk(section="axisymmetric"), "yeoh", {"c1": 14e3, "c2": 900.0, "c3": 0.0}, 0.49,
    tuple(cm * pascal_per_cm() for cm in np.linspace(20.0, 177.0, 9)),
)  # fmt: skip


def scene_of(megapixels: float) -> Scene:
    """Return the demo bench with a sensor of another size in megapixels; 18 is the thesis' camera."""
    factor = (megapixels * 1e6 / (SCENE.width * SCENE.height)) ** 0.5
    return dataclasses.replace(
        SCENE, width=round(SCENE.width * factor), height=round(SCENE.height * factor),
        focal_px=SCENE.focal_px * factor, pixel_size=SCENE.pixel_size / factor, blur=SCENE.blur * factor**0.5,
    )  # fmt: skip


def inflated(truth: DemoTruth, comm: MPI.Comm) -> tuple[DeviceModel, list[Array]]:
    """Simulate the device with its true material; return the right half of its outline in m at each pressure."""
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System

    choice = LawChoice.from_text(truth.law, truth.poisson)
    with tempfile.TemporaryDirectory() as folder:
        body = Body.from_file(truth.actuator, truth.actuator.write(Path(folder) / "disk.msh"), comm)
    device = DeviceModel(Solver(System(body, choice.material(truth.values))), choice)
    states = device.states(truth.values, truth.pressures, "pressure")
    device.set_parameters(truth.values)
    return device, [half_outline(device.curve(state), 2e-5, 0.0)[0] for state in states]


def polygon(half: Array) -> Array:
    """Return the shadow (k, 2) in m of a device that stands level with its support."""
    places = np.vstack([half[:0:-1] * [-1.0, 1.0], half])
    places[:, 1] = np.maximum(places[:, 1], 0.0)
    sides = [[HALF_WIDTH, 0.0], [HALF_WIDTH, -HALF_WIDTH], [-HALF_WIDTH, -HALF_WIDTH], [-HALF_WIDTH, 0.0]]
    return np.vstack([places, sides]) + np.array([CENTRE, FLOOR])


def take_photographs(
    folder: Path,
    truth: DemoTruth,
    halves: Sequence[Array],
    scene: Scene,
    tell: Callable[[str], None] = lambda text: None,
) -> None:
    """Write the grid's photograph, one at rest, one per pressure, and ``photos.csv`` with the column's levels.

    Levels are read to a millimetre with the error the measurement takes them to have; the leak makes them too high.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(2013)
    save(folder / "IMG_0100.JPG", photograph(scene, None, seed=100)[0])
    rest = np.array([[0.0, 0.0], [truth.actuator.outer_radius, 0.0]])
    readings = [0.0, *readings_of(np.array(truth.pressures), {"leak": LEAK})]
    rows = ["file,left,right"]
    for number, (half, reading) in enumerate(zip([rest, *halves], readings, strict=True), 101):
        tell(f"photograph {number - 100} of {len(readings)}")
        save(folder / f"IMG_{number:04d}.JPG", photograph(scene, polygon(half), seed=number)[0])
        half_column = reading / pascal_per_cm() / 2.0
        left, right = (100.0 + sign * half_column + 0.05 * rng.standard_normal() for sign in (1.0, -1.0))
        rows.append(f"IMG_{number:04d}.JPG,{left:.2f} cm,{right:.2f} cm")
    (folder / "photos.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")


def commands(folder: Path, truth: DemoTruth) -> list[tuple[str, list[str]]]:
    """Return what a user types: module or program, and its arguments."""
    setup, outlines = folder / "setup.toml", folder / "outlines"
    photographs = folder / "photographs"
    held = [word for name, value in truth.values.items() if value == 0.0 for word in ("--fix", f"{name}=0Pa")]
    return [
        ("measurement", ["setup", str(photographs / "IMG_0100.JPG"), "--lens", "none", "-o", str(setup)]),
        ("measurement", ["photos", str(photographs / "photos.csv"), "--setup", str(setup), "-o", str(outlines)]),
        ("softmodels", ["fit", str(folder / "case.toml"), str(outlines), "--material", truth.law,
                        "--poisson", f"{truth.poisson:g}", *held, "-o", str(folder / "fit")]),
    ]  # fmt: skip


def write_case(folder: Path, truth: DemoTruth) -> None:
    """Write the case a user would have: device and pressures, with a silicone other than the true one."""
    heights = tuple(p / pascal_per_cm() for p in truth.pressures)
    text = Case("disk", truth.actuator, DEFAULT, pressures_cm=heights).to_toml()
    (folder / "case.toml").write_text(text, encoding="utf-8")


def compared(folder: Path, truth: DemoTruth) -> tuple[list[str], bool]:
    """Return a line per parameter, truth against fit, and whether every 95 % interval contains the truth."""
    about = tomllib.loads((folder / "fit" / "fitted.toml").read_text())["fit"]
    known = {**{name: value for name, value in truth.values.items() if value}, "leak": LEAK}
    lines, good = [], True
    for name, value in known.items():
        low, high = about["intervals_95"][name]
        inside = low <= value <= high
        good = good and inside
        verdict = "holds it" if inside else "MISSES it"
        found = about["values"][name]
        lines.append(f"  {name:6s} true {value:8.5g}  fitted {found:8.5g}  95 %: {low:.5g} to {high:.5g} {verdict}")
    return lines, good


@click.command()
@click.option("-o", "--output", type=FolderType(), help="Folder for all files.  [default: loop; loop-2 and "
              "so on if that exists]")  # fmt: skip
@click.option("--megapixels", type=click.FloatRange(1.0, 50.0), default=18.0, show_default=True,
              help="Size of the photographs; 18 is the thesis' camera.")  # fmt: skip
def demo(output: Path | None, megapixels: float) -> None:
    """Run the whole workflow: simulate a known silicone, photograph it, measure the photographs, fit, and compare.

    Takes a few minutes with 18 megapixels. Exit status: 0 if every 95 % interval contains the truth, else 1.
    """
    import subprocess
    import sys

    from softmodels.cli.options import fail
    from softmodels.mechanics.mpi import start

    comm = start()
    if comm.size > 1:
        fail("the demonstration runs on one process only; start it without mpirun")
    try:
        place = open_place(output, Path("loop"), "demonstration of the whole workflow", WRITTEN)
        write_case(place, TRUTH)
        click.echo("simulating the true device")
        _, halves = inflated(TRUTH, comm)
        photographs = open_folder(place / "photographs", place, "photographs", {})
        with photographs.writing() as folder:
            take_photographs(folder, TRUTH, halves, scene_of(megapixels), click.echo)
        photographs.leave()
    except OwnFolderError as error:
        fail(str(error))
    except OSError as error:
        fail(f"the demonstration cannot be written ({error.strerror or error})", status_of(error))
    for module, words in commands(place, TRUTH):
        click.echo(f"$ python -m {module} {' '.join(words)}")
        status = subprocess.run([*interpreter(), "-m", module, *words], check=False).returncode
        if status != DONE:
            fail(f"{module} {words[0]} ended with exit status {status}; the files so far are in {place}", FAILED)
    lines, good = compared(place, TRUTH)
    click.echo("\n".join(["compared with the truth:", *lines]))
    report = {"good": good, "lines": lines}
    (place / "compared.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    sys.exit(DONE if good else FAILED)
