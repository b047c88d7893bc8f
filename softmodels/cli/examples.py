"""``softmodels demo`` and ``softmodels examples``: the whole workflow on a known silicone, and files to try commands with.

The demonstration simulates, photographs, measures, fits, and compares with the truth. The examples are a small version of it,
with a tensile curve, boards for the camera's lens, a part from a STEP file and a case of each kind. Existing files are kept.

The examples come with the package, in the folder ``files``. What is computed or rendered of them, in its folder ``made``, is
made again in some minutes, by ``python -m softmodels.cli.examples``.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import json
import math
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from geometries import HollowDisk, meshing
from measurement import photographer
from softmodels.case import load, materials
from softmodels.case.case import Case
from softmodels.cli import ending, options
from softmodels.common import commands, files, processes, units
from softmodels.common.arrays import Array
from softmodels.common.lazy import MPI, gmsh
from softmodels.fitting import problem
from softmodels.fitting.curves import residuals
from softmodels.fitting.outlines import shapes
from softmodels.fitting.outlines.device import DeviceModel, MeasuredDevice
from softmodels.fitting.outlines.residuals import readings_of
from softmodels.materials import laws, specimens
from softmodels.materials.laws import Material
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
# The command ``examples``: small files to try every command with, generated from fixed seeds.


PHOTOGRAPH_MEGAPIXELS = 3.8
LENS_COEFFICIENTS = (-0.06, 0.02)
"""The camera's k1 and k2: straight lines of the grid are bent by some pixels."""
POSES = [(0, 0), (20, 0), (-20, 12), (8, 25), (12, -25), (-12, -18), (0, 30), (25, 8), (-25, -8), (15, 15)]
"""Tilt and pan in degrees of the board relative to the camera."""
SQUARE_SIDE = 0.025
"""Side of the board's squares in m."""
STRESS_NOISE = 150.0
"""Standard deviation of the tensile curve's stress in Pa."""
MEMORY_NOISE, SAMPLING_INTERVAL = 50.0, 0.25
"""The same of the tests with times, and their sampling interval in s."""
BRANCHES = ((0.15, 1.0), (0.1, 10.0), (0.08, 100.0))
SOFTENING_NUMBERS = (2.5, 4e3, 0.2)
CYCLES = ((0, 1), (10, 2), (20, 1), (30, 2), (40, 1), (60, 3), (80, 1), (100, 3), (120, 1))
HOLD = ((0, 1), (1, 2), (300, 2))
FAST = ((0, 1), (3, 2.5), (6, 1))
"""Corners of three tests: times in s and stretches."""
HELD = {"share_10s": 0.15, "share_100s": 0.1}
"""Branches of the disk whose pressures are held."""
LEVELS, RISE, HOLDS = (80.0, 170.0), 3.0, (5.0, 60.0, 600.0)
"""These pressures in cm of the column; time in s that each takes to reach, and when it is photographed."""

shipped = functools.partial(photographer.save, quality=65, subsampling=2)
"""Writes a photograph that comes with the package: with all of them smaller than 3 MB, as most phones compress theirs."""

FILES = Path(__file__).parent / "files"
MADE = FILES / "made"
"""What `make_files` writes."""


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


def bench() -> photographer.Scene:
    """Return the demo's camera with a smaller sensor and a distorting lens."""
    return dataclasses.replace(scene_of(PHOTOGRAPH_MEGAPIXELS), distortion=LENS_COEFFICIENTS)


def board_scenes() -> Iterator[photographer.Scene]:
    """Place the same camera in front of a board, close enough that the poses together fill the picture."""
    scene = bench()
    for tilt, pan in POSES:
        yield dataclasses.replace(
            scene, tilt=float(tilt), pan=float(pan), roll=0.0, pixel_size=1.35 * 10 * SQUARE_SIDE / scene.width
        )


def tensile_curve() -> str:
    """Return a noisy tensile test of the device's silicone up to stretch 3, as a machine's table."""
    law = problem.LawChoice.from_text(TRUTH.law).material(TRUTH.values)
    stretch = np.linspace(1.0, 3.0, 201)[1:]
    noisy = specimens.nominal_stress(law, stretch) + STRESS_NOISE * np.random.default_rng(30).standard_normal(len(stretch))
    lines = [f"{100 * (x - 1):.1f},{y / 1e3:.4f}" for x, y in zip(stretch, noisy, strict=True)]
    about = f"# computed, not measured: {told_truth()}; noise of {STRESS_NOISE:g} Pa, seed 30"
    return "\n".join([about, "strain (%),stress (kPa)", *lines]) + "\n"


def memory_curve(corners: Sequence[tuple[float, float]], seed: int) -> str:
    """Return a noisy uniaxial test of `remembering` as a machine's table, straight between corners of times in s and
    stretches."""
    time = np.arange(0.0, corners[-1][0] + SAMPLING_INTERVAL / 2, SAMPLING_INTERVAL)
    stretch = np.interp(time, *np.transpose(corners))
    noise = MEMORY_NOISE * np.random.default_rng(seed).standard_normal(len(time))
    noisy = specimens.stress_in_time(remembering(), time, stretch)[0] + noise
    rows = (f"{t:.2f},{100 * (x - 1):.3f},{y / 1e3:.4f}" for t, x, y in zip(time, stretch, noisy, strict=True))
    about = f"# computed, not measured: {told_memory()}; noise of {MEMORY_NOISE:g} Pa, seed {seed}"
    return "\n".join([about, "time (s),strain (%),stress (kPa)", *rows]) + "\n"


def remembering() -> Material:
    """Return the silicone of the tests with times."""
    law = problem.LawChoice.from_text("yeoh").material({"c1": 8e3, "c2": 90.0, "c3": 0.5})
    return law.with_memory(BRANCHES, SOFTENING_NUMBERS)


def told_memory() -> str:
    """Return that silicone in words."""
    branches = ", ".join(f"{share:g} at {time:g} s" for share, time in BRANCHES)
    r, m, beta = SOFTENING_NUMBERS
    law = "yeoh, c1 = 8 kPa, c2 = 90 Pa, c3 = 0.5 Pa"
    return f"{law}, branches {branches}, softening r {r:g}, m {m / 1e3:g} kPa, beta {beta:g}"


def told_truth() -> str:
    """Return the example's silicone in words."""
    values = ", ".join(f"{name} = {value / 1e3:g} kPa" for name, value in TRUTH.values.items())
    return f"{TRUTH.law}, {values}, Poisson's ratio {laws.DEFAULT_POISSON_RATIO:g}"


def finger(path: Path) -> None:
    """Write a finger of 80 x 12 x 12 mm as a STEP file. Its rounded cavity lies below the middle, so it bends up (along z)."""

    def draw(occ: gmsh.model.occ) -> None:
        block = occ.addBox(0, -6, -6, 80, 12, 12)
        hole = occ.addBox(5, -4.5, -4.5, 72, 9, 6)
        occ.synchronize()
        edges = [abs(tag) for _, tag in occ.getEntities(1) if tag > 12]
        rounded = occ.fillet([hole], edges, [2.0])
        occ.cut([(3, block)], rounded)

    _write_step(path, draw)


def two_cavities(path: Path) -> None:
    """Write a block of 20 x 10 x 10 mm with two flat cavities above each other, 1.5 mm apart, as a STEP file."""

    def draw(occ: gmsh.model.occ) -> None:
        block = occ.addBox(0, -5, -5, 20, 10, 10)
        holes = [occ.addBox(6, -3, z, 10, 6, 2.0) for z in (0.75, -2.75)]
        occ.cut([(3, block)], [(3, hole) for hole in holes])

    _write_step(path, draw)


def press(path: Path) -> None:
    """Write half a finger of 60 x 12 x 10 mm and, 1 mm below its tip, half a block, as a STEP file of two solids."""

    def draw(occ: gmsh.model.occ) -> None:
        occ.cut([(3, occ.addBox(0, 0, 0, 60, 6, 10))], [(3, occ.addBox(4, 0, 4.5, 52, 4, 3.5))])
        occ.addBox(44, 0, -9, 18, 9, 8)

    _write_step(path, draw)


def accordion(path: Path) -> None:
    """Write a quarter of a square accordion of three folds, 30 mm high and 18 to 30 mm wide, as a STEP file."""

    def draw(occ: gmsh.model.occ) -> None:
        folds = [(3.0 + 4.0 * k, k % 2) for k in range(7)]
        outer = [(0.0, 9.0), *((z, 15.0 if crest else 9.0) for z, crest in folds), (30.0, 9.0)]
        inner = [(z, 12.76 if crest else 7.74) for z, crest in folds]
        occ.cut([(3, _square_tower(occ, outer))], [(3, _square_tower(occ, inner))])

    _write_step(path, draw)


def _square_tower(occ: gmsh.model.occ, profile: Sequence[tuple[float, float]]) -> int:
    """Draw a quarter of a tower of square rings, each a height and half a width, and return its volume."""
    rings = [[occ.addPoint(x * a, y * a, z) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))] for z, a in profile]
    lines: dict[tuple[int, int], int] = {}

    def line(begin: int, end: int) -> int:
        if (begin, end) not in lines:
            lines[begin, end] = occ.addLine(begin, end)
            lines[end, begin] = -lines[begin, end]
        return lines[begin, end]

    def face(*points: int) -> int:
        return int(occ.addPlaneSurface([occ.addCurveLoop([*map(line, points, (*points[1:], points[0]))])]))

    faces = [face(*rings[0]), face(*rings[-1])]
    for low, high in itertools.pairwise(rings):
        faces += [face(low[k], low[k + 1], high[k + 1], high[k]) for k in (1, 2)]
    axis = [ring[0] for ring in rings]
    faces += [face(*axis, *(ring[k] for ring in reversed(rings))) for k in (1, 3)]
    return int(occ.addVolume([occ.addSurfaceLoop(faces)]))


def _write_step(path: Path, draw: Callable[[gmsh.model.occ], None]) -> None:
    """Write what ``draw(gmsh.model.occ)`` draws in mm as a STEP file."""
    with meshing.private_model():
        draw(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        meshing.write_step(path)


def write_examples(path: Path) -> Folder:
    """Write all examples into a folder, made if missing."""
    folder = Folder(path)
    folder.add("README.txt", FILES / "README.txt")
    for group in (FILES / "cases", FILES / "bench", FILES / "designs", MADE):
        for file in sorted(file for file in group.rglob("*") if file.is_file()):
            folder.add(file.relative_to(group).as_posix(), file)
    return folder


def make_files(folder: Path, tell: Callable[[str], None]) -> None:
    """Compute and render the examples that come with the package into a folder; ``tell`` gets a sentence now and then."""
    (folder / "boards").mkdir(parents=True, exist_ok=True)
    branches = ", ".join(f"{name} = {value:g}" for name, value in HELD.items())
    texts = {
        "pull.csv": tensile_curve(),
        "cycles.csv": memory_curve(CYCLES, 31),
        "hold.csv": memory_curve(HOLD, 32),
        "fast.csv": memory_curve(FAST, 33),
        "truth.txt": f"{told_truth()}, a leak of 1 %; held: {branches} too\ncycles.csv, hold.csv, fast.csv: {told_memory()}\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    for name, draw in (("mypart", finger), ("twopart", two_cavities), ("accordion", accordion), ("press", press)):
        draw(folder / f"{name}.step")
    for number, scene in enumerate(board_scenes(), 1):
        tell(f"board {number}")
        shipped(folder / "boards" / f"board{number:02d}.jpg", photographer.chessboard(scene, side=SQUARE_SIDE, seed=number))
    _, halves = inflated(TRUTH, mpi.start())
    photographs = folder / "photographs"
    take_photographs(photographs, TRUTH, halves, bench(), tell, keep=shipped)
    (photographs / "IMG_0100.JPG").rename(photographs / "grid.jpg")
    truth, halves, times = creeping()
    take_photographs(folder / "held", truth, halves, bench(), tell, times, shipped)
    (folder / "held" / "IMG_0200.JPG").unlink()


def creeping() -> tuple[DemoTruth, list[Array], list[str]]:
    """Return the disk at the pressures of the photographs of `held`, half its outline in each, and their times."""
    from softmodels.fitting.outlines import creeping

    choice = problem.LawChoice.from_text(TRUTH.law)
    model = MeasuredDevice.of(TRUTH.actuator).model(choice, mpi.start(), residuals.spectrum([], HOLDS))
    corners, histories = [(0.0, 0.0)], []
    for level in LEVELS:
        reached, pressure = corners[-1][0] + RISE, level * units.COLUMN.pascal
        corners.append((reached, pressure))
        for hold in HOLDS:
            corners.append((reached + hold, pressure))
            histories.append(tuple(corners))
    timetable = creeping.Timetable.of(histories)
    values = TRUTH.values | HELD | {name: histories[i][-1][1] for name, i in timetable.levels.items()}
    states = creeping.Creep(model, timetable).photographs(values, ())
    halves = [shapes.half_outline(model.curve(states[i][0]), 2e-5, 0.0)[0] for i in range(len(histories))]
    truth = dataclasses.replace(TRUTH, pressures=tuple(history[-1][1] for history in histories))
    return truth, halves, [f",{hold:g} s,{RISE:g} s" for _ in LEVELS for hold in HOLDS]


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


if __name__ == "__main__":
    make_files(MADE, processes.say)
