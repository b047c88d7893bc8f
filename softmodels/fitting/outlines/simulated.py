"""Simulate measured outlines of a device of known material, for tests, studies and demonstrations."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from measurement.outline.outline import Outline
from softmodels.common.arrays import Array
from softmodels.fitting.outlines.device import DeviceModel
from softmodels.fitting.outlines.silhouette import shadow_of
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
    scale, zero, centre = (camera.bench.get(name, 0.0) for name in ("scale", "zero", "centre"))
    outlines = []
    for number, (state, reading) in enumerate(zip(states, readings, strict=True), 1):
        places, normals = half_outline(shadow_of(model.curve(state)).curve, camera.spacing)
        places, normals = (np.vstack([half[:0:-1] * [-1.0, 1.0], half]) for half in (places, normals))
        if rng is not None:
            noise = camera.error * correlated(len(places), camera.run, rng)
            places = places + noise[:, None] * normals
            reading += camera.pressure_error * float(rng.standard_normal())
        x, z = (1 + scale) * places[:, 0] + centre, (1 + scale) * places[:, 1] + zero
        order = np.argsort(x, kind="stable")
        error = np.full(len(x), camera.error)
        outlines.append(
            Outline(x[order], z[order], error, float(reading), camera.pressure_error, f"simulated {number}")
        )
    return outlines


def half_outline(curve: QuadraticCurve, spacing: float, lowest: float = -5e-5) -> tuple[Array, Array]:
    """Return the places (n, 2) on a curve from the axis on, evenly far apart, as far as it is above ``lowest``, and unit
    normals."""
    s = np.linspace(-1.0, 1.0, 41)
    piece, at = np.repeat(np.arange(len(curve.nodes)), len(s)), np.tile(s, len(curve.nodes))
    dense = curve.at(piece, at)[0]
    length = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(dense, axis=0), axis=1))]
    low = np.flatnonzero(dense[:, 1] < lowest)
    end = length[low[0]] if len(low) else length[-1]
    wanted = np.arange(0.0, end, spacing)
    index = np.clip(np.searchsorted(length, wanted, side="right") - 1, 0, len(length) - 2)
    share = (wanted - length[index]) / np.maximum(length[index + 1] - length[index], 1e-300)
    step = np.where(piece[index + 1] == piece[index], at[index + 1] - at[index], 0.0)
    places, slopes, _ = curve.at(piece[index], at[index] + share * step)
    slopes = slopes / np.linalg.norm(slopes, axis=1)[:, None]
    return places, np.column_stack([-slopes[:, 1], slopes[:, 0]])


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


def readings_of(pressures: Array, bench: Mapping[str, float]) -> Array:
    """Return the column's readings at true pressures, with the bench's offset, scale and leak; see `outlines.fit`."""
    offset, scale, leak = (bench.get(name, 0.0) for name in ("pressure_offset", "pressure_scale", "leak"))
    most = (pressures.max() + offset) / (1 - scale - leak)
    if leak == 0.0:
        return (pressures + offset) / (1 - scale)
    a, b, c = leak / most, -(1 - scale), pressures + offset
    return (-b - np.sqrt(b * b - 4 * a * c)) / (2 * a)
