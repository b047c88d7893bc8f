"""Outlines held against the device before any law is fitted: its shape at the measured heights hardly depends on the law."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from softmodels.fitting.outlines.device_model import DeviceModel
from softmodels.fitting.outlines.pressure_course import Row
from softmodels.fitting.outlines.shadow import shadow_of
from softmodels.fitting.outlines.shapes import Shape
from softmodels.fitting.outlines.simulated import half_outline
from softmodels.fitting.outlines.start import plain_path
from softmodels.fitting.problem import UnsoundError
from softmodels.results.quadratic_curve import QuadraticCurve

Array = npt.NDArray[np.float64]

NARROWEST, WIDEST = 0.82, 1.22
"""Measured over simulated width at half the height, beyond which no unit of length a bench has explains it."""
SPACING = 2e-5
"""Distance in m of places on a simulated outline."""


def series_of(
    model: DeviceModel,
    sources: Sequence[str],
    heights: Array,
    pressures: Array,
    pressure_errors: Array,
    errors: Array,
) -> tuple[list[Row], list[QuadraticCurve]]:
    """The series with the pressure that the device takes for each height, and its curve there.

    Args:
        model: The device and any law.
        sources: Names of the photographs.
        heights: Heights of the top in m, shape (n,).
        pressures: Readings in Pa, shape (n,).
        pressure_errors: Their standard errors in Pa, shape (n,).
        errors: Standard errors of the heights in m, shape (n,).

    Raises:
        OutlineFitError: The device cannot rise as high as was measured.
    """
    plain = plain_path(model, heights, pressures)
    lengths = model.set_parameters(plain.values)
    rows = [
        Row(
            source=source,
            height=float(heights[i]),
            pressure=float(pressures[i]),
            pressure_error=float(pressure_errors[i]),
            height_error=float(errors[i]),
            unit=float(plain.elastic[i]) / model.modulus,
            borne=float(plain.borne[i]),
            silent=bool(plain.silent[i]),
        )
        for i, source in enumerate(sources)
    ]
    return rows, [model.curve(state, lengths) for state in plain.states]


def series_of_shapes(model: DeviceModel, shapes: Sequence[Shape]) -> list[Row]:
    """The series of outlines, whose shapes must be the device's.

    Raises:
        UnsoundError: They are of another device.
    """
    columns = [(shape.height, shape.pressure, shape.pressure_error, float(np.median(shape.error))) for shape in shapes]
    rows, curves = series_of(model, [shape.source for shape in shapes], *np.array(columns).T)
    _check_widths(shapes, curves, type(model.system.body.actuator).__name__)
    return rows


def _check_widths(shapes: Sequence[Shape], curves: Sequence[QuadraticCurve], device: str) -> None:
    measured = np.array([_width(shape.points, shape.height / 2) for shape in shapes])
    simulated = np.array(
        [_simulated_width(curve, shape.height / 2) for shape, curve in zip(shapes, curves, strict=True)]
    )
    share = measured / simulated
    if NARROWEST <= float(np.median(share)) <= WIDEST:
        return
    i = int(np.argmin(np.abs(share - np.median(share))))
    extent = f"between {share.min():.2f} and {share.max():.2f} times as wide" if len(share) > 1 else "so"
    raise UnsoundError(
        f"these outlines are of another device: {shapes[i].source} rises {shapes[i].height * 1e3:.4g} mm and is "
        f"{measured[i] * 1e3:.4g} mm wide at half its height, where the case's {device} is {simulated[i] * 1e3:.4g} mm wide "
        f"(all outlines: {extent}); give the case of the part in the photographs, or check the unit of their grid"
    )


def _width(points: Array, level: float) -> float:
    """Distance in m of the outermost points (n, 2) above a level."""
    up = np.flatnonzero(points[:, 1] > level)
    return float(points[up[-1], 0] - points[up[0], 0]) if len(up) else 0.0


def _simulated_width(curve: QuadraticCurve, level: float) -> float:
    places = half_outline(shadow_of(curve).curve, SPACING)[0]
    return 2.0 * float(places[places[:, 1] > level, 0].max())
