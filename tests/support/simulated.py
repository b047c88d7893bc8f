"""Simulate measured outlines of a device of known material."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from measurement.outline.outline import Outline
from softmodels.common.arrays import Array
from softmodels.fitting.outlines.device import DeviceModel
from softmodels.fitting.outlines.silhouette import shadow_of
from softmodels.fitting.outlines.simulated import half_outline, readings_of


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
