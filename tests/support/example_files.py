"""The examples that come with the package, computed and rendered anew into ``softmodels/cli/files/made`` in some minutes:

python -m tests.support.example_files
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from geometries import meshing
from measurement import photographer
from softmodels.cli.examples import MADE, TRUTH, DemoTruth, inflated, scene_of, take_photographs
from softmodels.common import processes, units
from softmodels.common.arrays import Array
from softmodels.common.lazy import gmsh
from softmodels.fitting import problem
from softmodels.fitting.curves import residuals
from softmodels.fitting.outlines import creeping as creep, shapes
from softmodels.fitting.outlines.device import MeasuredDevice
from softmodels.materials import laws, specimens
from softmodels.materials.laws import Material
from softmodels.mechanics import mpi

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


def arm(path: Path) -> None:
    """Write a cylinder of 60 mm and 24 mm in diameter with three round chambers along its axis as a STEP file."""

    def draw(occ: gmsh.model.occ) -> None:
        places = [(8 * math.cos(2 * math.pi * k / 3), 8 * math.sin(2 * math.pi * k / 3)) for k in range(3)]
        chambers = [(3, occ.addCylinder(x, y, 4, 0, 0, 52, 2.5)) for x, y in places]
        occ.cut([(3, occ.addCylinder(0, 0, 0, 0, 0, 60, 12))], chambers)

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
    for name, draw in (
        ("mypart", finger),
        ("twopart", two_cavities),
        ("armpart", arm),
        ("accordion", accordion),
        ("press", press),
    ):
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
    choice = problem.LawChoice.from_text(TRUTH.law)
    model = MeasuredDevice.of(TRUTH.actuator).model(choice, mpi.start(), residuals.spectrum([], HOLDS))
    corners, histories = [(0.0, 0.0)], []
    for level in LEVELS:
        reached, pressure = corners[-1][0] + RISE, level * units.COLUMN.pascal
        corners.append((reached, pressure))
        for hold in HOLDS:
            corners.append((reached + hold, pressure))
            histories.append(tuple(corners))
    timetable = creep.Timetable.of(histories)
    values = TRUTH.values | HELD | {name: histories[i][-1][1] for name, i in timetable.levels.items()}
    states = creep.Creep(model, timetable).photographs(values, ())
    halves = [shapes.half_outline(model.curve(states[i][0]), 2e-5, 0.0)[0] for i in range(len(histories))]
    truth = dataclasses.replace(TRUTH, pressures=tuple(history[-1][1] for history in histories))
    return truth, halves, [f",{hold:g} s,{RISE:g} s" for _ in LEVELS for hold in HOLDS]


if __name__ == "__main__":
    make_files(MADE, processes.say)
