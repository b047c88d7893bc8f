"""Simulate measured outlines of a device of known material."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from measurement.outline.outline import Outline
from softmodels.case.load import steps_of
from softmodels.common.arrays import Array
from softmodels.common.units import COLUMN
from softmodels.fitting.outlines.device import DeviceModel
from softmodels.fitting.outlines.residuals import readings_of
from softmodels.fitting.outlines.shapes import Silhouette, half_outline, shadow_of
from softmodels.mechanics.solver import Solver
from softmodels.path.schedule import Settings, apply_preload, follow
from softmodels.runs.grid import QuadraticCurve


@dataclasses.dataclass(frozen=True)
class SimulatedCamera:
    """Errors of simulated outline measurements.

    Attributes:
        spacing: Distance of neighbouring points along the outline in m.
        error: Standard error of each across the outline in m.
        run: Correlation length of the errors, in points (integrated autocorrelation).
        pressure_error: Standard error of each reading in Pa.
        bench: True values of what the bench gets wrong, by the names of `outlines.fit.BENCH`; the others are 0.
    """

    spacing: float = 50e-6
    error: float = 10e-6
    run: float = 8.0
    pressure_error: float = 10.0
    bench: Mapping[str, float] = dataclasses.field(default_factory=dict)


def simulated_outlines(
    model: DeviceModel,
    values: Mapping[str, float],
    requested: Sequence[float],
    camera: SimulatedCamera,
    quantity: str = "pressure",
    rng: np.random.Generator | None = None,
) -> list[Outline]:
    """Return the outlines of a device at true pressures in Pa, or at added volumes in m3.

    Args:
        model: The device and its law.
        values: The law's numbers.
        requested: Rising.
        camera: How it is measured.
        quantity: What is requested.
        rng: Source of the noise; None for none.

    Raises:
        CannotEvaluate: The device has no such state.
    """
    states = model.states(values, requested, quantity)
    model.set_parameters(values)
    pressures = np.array([model.pressure(state) for state in states])
    readings = readings_of(pressures, camera.bench)
    outlines = []
    for number, (state, reading) in enumerate(zip(states, readings, strict=True), 1):
        made = photographed(model.curve(state), float(reading), camera, f"simulated {number}", rng)
        if rng is not None:
            made = dataclasses.replace(made, pressure=read(float(reading), camera, rng))
        outlines.append(made)
    return outlines


def read(pressure: float, camera: SimulatedCamera, rng: np.random.Generator) -> float:
    """Return the reading of a column that stands at a pressure in Pa."""
    return pressure + camera.pressure_error * float(rng.standard_normal())


def photographed(
    curve: QuadraticCurve, reading: float, camera: SimulatedCamera, source: str, rng: np.random.Generator | None
) -> Outline:
    """Return the outline of a device with an outer curve in m, at a reading in Pa; without noise if there is no ``rng``."""
    scale, zero, centre = (camera.bench.get(name, 0.0) for name in ("scale", "zero", "centre"))
    places, normals = half_outline(shadow_of(curve).curve, camera.spacing)
    places, normals = (np.vstack([half[:0:-1] * [-1.0, 1.0], half]) for half in (places, normals))
    if rng is not None:
        noise = camera.error * correlated(len(places), camera.run, rng)
        places = places + noise[:, None] * normals
    x, z = (1 + scale) * places[:, 0] + centre, (1 + scale) * places[:, 1] + zero
    order = np.argsort(x, kind="stable")
    return Outline(x[order], z[order], np.full(len(x), camera.error), reading, camera.pressure_error, source)


DAY = 86400.0


@dataclasses.dataclass(frozen=True, eq=False)
class Creeping:
    """A device that creeps, photographed at times: each level is reached from the one before and held.

    Attributes:
        levels: True pressures in Pa.
        rise: Time in s that the change to each takes.
        holds: Hold times in s of the photographs of each level.
        curves: The device's outer curves, level by level.
    """

    levels: tuple[float, ...]
    rise: float
    holds: tuple[float, ...]
    curves: tuple[QuadraticCurve, ...]

    @classmethod
    def simulated(
        cls, solver: Solver, levels: Sequence[float], rise: float, holds: Sequence[float], tolerance: float = 2e-6
    ) -> Creeping:
        """Return the device, followed as a program with steps chosen by their error, see `march`.

        Under dead loads it first hangs for a day; heights count from its apex then.
        """
        corners, looks = _corners(levels, rise, holds)
        dead, silhouette, curves, apex, hung = solver.system.dead, Silhouette(solver.system), [], 0.0, None
        if dead.loads:
            hung = apply_preload(solver, [("its loads", np.concatenate([[0.0], dead.amounts / dead.units]))])
            corners, looks = [(0.0, 0.0), *((DAY + time, P) for time, P in corners)], [1, *(at + 1 for at in looks)]
        times, pressures = np.array(corners).T
        begin = 0 if hung else 1
        cm, times = (pressures[begin:] / COLUMN.pascal).tolist(), times[begin:].tolist()
        program = steps_of(**{"cavity1": {"pressure_cm": cm}, "time_s": times})
        for come, point in follow(solver, program, Settings(tolerance=tolerance), preload=hung):
            if point.requested and round(come) in looks:
                curves.append(silhouette.curve(point.state))
        if hung:
            apex = float(curves.pop(0).nodes[0, 0, 1])
        return cls(tuple(levels), rise, tuple(holds), tuple(QuadraticCurve(curve.nodes - [0.0, apex]) for curve in curves))

    def outlines(self, camera: SimulatedCamera, rng: np.random.Generator | None = None) -> list[Outline]:
        """Return the outlines with their histories of readings; each level is read once."""
        readings = readings_of(np.array(self.levels), camera.bench).tolist()
        if rng is not None:
            readings = [read(one, camera, rng) for one in readings]
        corners, looks = _corners(readings, self.rise, self.holds)
        found = []
        for number, (at, curve) in enumerate(zip(looks, self.curves, strict=True), 1):
            made = photographed(curve, corners[at][1], camera, f"simulated {number}", rng)
            found.append(dataclasses.replace(made, history=tuple(corners[: at + 1])))
        return found


def _corners(levels: Sequence[float], rise: float, holds: Sequence[float]) -> tuple[list[tuple[float, float]], list[int]]:
    """Return the corners of the pressure's history, and which of them are photographs."""
    corners, looks = [(0.0, 0.0)], []
    for level in levels:
        reached = corners[-1][0] + rise
        corners += [(reached, level), *((reached + hold, level) for hold in holds)]
        looks += range(len(corners) - len(holds), len(corners))
    return corners, looks


def correlated(count: int, run: float, rng: np.random.Generator) -> Array:
    """Return the noise of variance 1 whose integrated autocorrelation is ``run`` points: white noise through a local
    quadratic."""
    half = max(round(1.1 * run), 1)
    if run <= 1.0:
        return rng.standard_normal(count)
    t = np.arange(-half, half + 1) / (half + 1)
    kernel = (1 - np.abs(t) ** 3) ** 3
    # The smoother keeps quadratics, as loess does; scaled to the run that was asked for.
    moments = [float((kernel * t**k).sum()) for k in (0, 2, 4)]
    kernel = kernel * (moments[2] - moments[1] * t**2)
    white = rng.standard_normal(count + 2 * half)
    noise = np.convolve(white, kernel, mode="valid")
    return noise / math.sqrt(float((kernel**2).sum()))
