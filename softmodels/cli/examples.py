"""``softmodels examples``: write small files to try every command with, generated from fixed seeds.

A device whose silicone is known is simulated and photographed as in `softmodels.cli.demo`, but small; its tensile curve, boards
for the camera's lens, a part from a STEP file and a case of each kind stand beside it. Existing files are kept.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from measurement.synthetic.photographer import Scene, chessboard, save
from softmodels.cli.demo import TRUTH, inflated, scene_of, take_photographs
from softmodels.cli.example_cases import BENCH, CASES, PROBLEMS
from softmodels.common.terminal import say
from softmodels.fitting.problem import LawChoice
from softmodels.materials.laws import Material
from softmodels.materials.specimens import nominal_stress, stress_in_time

MEGAPIXELS = 3.8
LENS = (-0.06, 0.02)
"""The camera's k1 and k2: straight lines of the grid are bent by some pixels."""
POSES = [(0, 0), (20, 0), (-20, 12), (8, 25), (12, -25), (-12, -18), (0, 30), (25, 8), (-25, -8), (15, 15)]
"""Tilt and pan in degrees of the board relative to the camera."""
SIDE = 0.025
"""Side of the board's squares in m."""
NOISE = 150.0
"""Standard deviation of the tensile curve's stress in Pa."""
MEMORY_NOISE, SAMPLING = 50.0, 0.25
"""The same of the tests with times, and their sampling interval in s."""
BRANCHES = ((0.15, 1.0), (0.1, 10.0), (0.08, 100.0))
SOFTENED = (2.5, 4e3, 0.2)
CYCLES = ((0, 1), (10, 2), (20, 1), (30, 2), (40, 1), (60, 3), (80, 1), (100, 3), (120, 1))
HOLD = ((0, 1), (1, 2), (300, 2))
FAST = ((0, 1), (3, 2.5), (6, 1))
"""Corners of three tests: times in s and stretches."""

README = """Made by `softmodels examples` from fixed seeds: nothing here was measured.

boards/*.jpg       a chessboard of 10 x 7 squares of 25 mm (9 x 6 inner corners), through the bench's lens
photographs/       grid.jpg: only the screen's grid of 9 mm; 4 to 13: a disk at rest and at nine pressures; photos.csv: the
                   levels of the water column's two tubes, which loses 1 % of its largest pressure by a leak
disk.toml          the disk of the photographs, silicone unknown
pull.csv           a tensile test of its silicone
cycles.csv         two cycles each to stretch 2 and 3 of a silicone with a memory; hold.csv: it is pulled and held for 5 min;
                   fast.csv: a pull and return at 0.5 /s
truth.txt          the true materials
mypart.step        a finger with one cavity that bends, mypart.toml the case of it
twopart.step       a block with two cavities, program.toml a series for each of them
*.toml             cases: volume, syringe, cycle, contact, ball, sheet (seminar), balloon
lifted, height     a membrane with a plate and a weight; the force on the plate at a height
finger, bent       a finger of two silicones with paper, under its weight; a wound finger with a sheet
rod, muscle, cell  a spheroid with a rod; a McKibben muscle with a load; a bellows on a load cell
sagging            a strip under its weight

Try them as the README of softmodels shows, for example

    uv run softmodels run examples/volume.toml
    uv run softmodels fit --tensile examples/pull.csv --material yeoh
"""


class Folder:
    """The folder for the examples; never overwrites a file.

    Attributes:
        written: What was written.
        kept: What was there already.
    """

    def __init__(self, path: Path):
        self.path = path
        self.written: list[Path] = []
        self.kept: list[Path] = []

    def add(self, name: str, make: Callable[[Path], object]) -> None:
        """Make a file by a function that takes its path, unless it exists."""
        path = self.path / name
        if path.exists() or path.is_symlink():
            self.kept.append(path)
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        make(path)
        self.written.append(path)


def bench() -> Scene:
    """Return the demo's camera with a smaller sensor and a distorting lens."""
    return dataclasses.replace(scene_of(MEGAPIXELS), distortion=LENS)


def board_scenes() -> Iterator[Scene]:
    """Place the same camera in front of a board, close enough that the poses together fill the picture."""
    scene = bench()
    for tilt, pan in POSES:
        yield dataclasses.replace(
            scene, tilt=float(tilt), pan=float(pan), roll=0.0, pixel_size=1.35 * 10 * SIDE / scene.width
        )


def tensile_curve() -> str:
    """Return a noisy tensile test of the device's silicone up to stretch 3, as a machine's table."""
    law = LawChoice.from_text(TRUTH.law, TRUTH.poisson).material(TRUTH.values)
    stretch = np.linspace(1.0, 3.0, 201)[1:]
    noisy = nominal_stress(law, stretch) + NOISE * np.random.default_rng(30).standard_normal(len(stretch))
    lines = [f"{100 * (x - 1):.1f},{y / 1e3:.4f}" for x, y in zip(stretch, noisy, strict=True)]
    about = f"# computed, not measured: {told_truth()}; noise of {NOISE:g} Pa, seed 30"
    return "\n".join([about, "strain (%),stress (kPa)", *lines]) + "\n"


def memory_curve(corners: Sequence[tuple[float, float]], seed: int) -> str:
    """Return a noisy uniaxial test of `remembering` as a machine's table.

    Args:
        corners: Times in s and stretches, straight between them.
        seed: Of the noise.
    """
    time = np.arange(0.0, corners[-1][0] + SAMPLING / 2, SAMPLING)
    stretch = np.interp(time, *np.transpose(corners))
    noise = MEMORY_NOISE * np.random.default_rng(seed).standard_normal(len(time))
    noisy = stress_in_time(remembering(), time, stretch)[0] + noise
    rows = (f"{t:.2f},{100 * (x - 1):.3f},{y / 1e3:.4f}" for t, x, y in zip(time, stretch, noisy, strict=True))
    about = f"# computed, not measured: {told_memory()}; noise of {MEMORY_NOISE:g} Pa, seed {seed}"
    return "\n".join([about, "time (s),strain (%),stress (kPa)", *rows]) + "\n"


def remembering() -> Material:
    """Return the silicone of the tests with times."""
    law = LawChoice.from_text("yeoh").material({"c1": 8e3, "c2": 90.0, "c3": 0.5})
    return law.with_memory(BRANCHES, SOFTENED)


def told_memory() -> str:
    """Return that silicone in words."""
    branches = ", ".join(f"{share:g} at {time:g} s" for share, time in BRANCHES)
    r, m, beta = SOFTENED
    law = "yeoh, c1 = 8 kPa, c2 = 90 Pa, c3 = 0.5 Pa"
    return f"{law}, branches {branches}, softening r {r:g}, m {m / 1e3:g} kPa, beta {beta:g}"


def told_truth() -> str:
    """Return the example's silicone in words."""
    values = ", ".join(f"{name} = {value / 1e3:g} kPa" for name, value in TRUTH.values.items())
    return f"{TRUTH.law}, {values}, Poisson's ratio {TRUTH.poisson:g}"


def finger(path: Path) -> None:
    """Write a finger of 80 x 12 x 12 mm as a STEP file. Its rounded cavity lies below the middle, so it bends up (along z)."""

    def draw(occ: Any) -> None:
        block = occ.addBox(0, -6, -6, 80, 12, 12)
        hole = occ.addBox(5, -4.5, -4.5, 72, 9, 6)
        occ.synchronize()
        edges = [abs(tag) for _, tag in occ.getEntities(1) if tag > 12]
        rounded = occ.fillet([hole], edges, [2.0])
        occ.cut([(3, block)], rounded)

    _write_step(path, draw)


def two_cavities(path: Path) -> None:
    """Write a block of 20 x 10 x 10 mm with two flat cavities above each other, 1.5 mm apart, as a STEP file."""

    def draw(occ: Any) -> None:
        block = occ.addBox(0, -5, -5, 20, 10, 10)
        holes = [occ.addBox(6, -3, z, 10, 6, 2.0) for z in (0.75, -2.75)]
        occ.cut([(3, block)], [(3, hole) for hole in holes])

    _write_step(path, draw)


def _write_step(path: Path, draw: Callable[[Any], None]) -> None:
    """Write what ``draw(gmsh.model.occ)`` draws in mm as a STEP file."""
    import gmsh  # type: ignore[import-untyped]

    from geometries.meshing import private_model

    with private_model():
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        draw(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
        gmsh.option.setString("Geometry.OCCTargetUnit", "")


def write_examples(path: Path, tell: Callable[[str], None] = lambda text: None) -> Folder:
    """Write all examples into a folder.

    Args:
        path: The folder; made if missing.
        tell: Gets a sentence now and then.

    Raises:
        OSError: It cannot be written.
    """
    folder = Folder(path)
    folder.add("README.txt", lambda file: file.write_text(README, encoding="utf-8"))
    for name, text in {**CASES, **BENCH, **PROBLEMS}.items():
        folder.add(name, lambda file, text=text: file.write_text(text, encoding="utf-8"))  # type: ignore[misc]
    folder.add("pull.csv", lambda file: file.write_text(tensile_curve(), encoding="utf-8"))
    folder.add("cycles.csv", lambda file: file.write_text(memory_curve(CYCLES, 31), encoding="utf-8"))
    folder.add("hold.csv", lambda file: file.write_text(memory_curve(HOLD, 32), encoding="utf-8"))
    folder.add("fast.csv", lambda file: file.write_text(memory_curve(FAST, 33), encoding="utf-8"))
    truth = f"{told_truth()}, a leak of 1 %\ncycles.csv, hold.csv, fast.csv: {told_memory()}\n"
    folder.add("truth.txt", lambda file: file.write_text(truth, encoding="utf-8"))
    from geometries.apart import apart

    folder.add("mypart.step", lambda file: apart(finger, file))
    folder.add("twopart.step", lambda file: apart(two_cavities, file))
    tell("photographing the board")
    for number, scene in enumerate(board_scenes(), 1):
        folder.add(f"boards/board{number:02d}.jpg",
                   lambda file, scene=scene, n=number: save(file, chessboard(scene, side=SIDE, seed=n)))  # type: ignore[misc]  # fmt: skip
    folder.add("photographs", lambda file: photographs(file, tell))
    return folder


def photographs(folder: Path, tell: Callable[[str], None]) -> None:
    """Make photographs of the grid and of the inflated disk, with the table of the column's levels."""
    from softmodels.mechanics.mpi import start

    tell("simulating the photographed disk (compiling kernels on the first run, about 10 s)")
    _, halves = inflated(TRUTH, start())
    take_photographs(folder, TRUTH, halves, bench(), tell)
    (folder / "IMG_0100.JPG").rename(folder / "grid.jpg")


@click.command("examples")
@click.option("-o", "--output", default=Path("examples"), show_default=True, type=click.Path(path_type=Path))
def examples(output: Path) -> None:
    """Write small files to try every command with: photographs, boards, a tensile curve, a STEP part, cases.

    Takes about a minute. Existing files are kept.
    Exit status: 0 written, 1 failed, 2 the folder cannot be written.
    """
    from softmodels.cli.options import fail
    from softmodels.common.commands import status_of, trouble

    if why := trouble(output):
        fail(f"the folder {output} cannot be written ({why})")
    try:
        folder = write_examples(output, click.echo)
    except OSError as error:
        fail(f"the examples cannot be written ({error.strerror or error})", status_of(error))
    except ImportError as error:
        fail(
            f"{error}; the photographs need FEniCSx (softmodels doctor lists what is missing); the rest is in {output}",
            1,
        )
    for path in folder.kept:
        say(f"{path} exists and is kept")
    count = len(folder.written) + len(folder.kept)
    say(f"wrote {len(folder.written)} of {count} examples; {output}/README.txt describes them")
