"""Points along a computed outline, and the readings of a pressure column with the bench's errors."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from softmodels.common.arrays import Array
from softmodels.runs.grid import QuadraticCurve


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


def readings_of(pressures: Array, bench: Mapping[str, float]) -> Array:
    """Return the column's readings at true pressures, with the bench's offset, scale and leak; see `outlines.fit`."""
    offset, scale, leak = (bench.get(name, 0.0) for name in ("pressure_offset", "pressure_scale", "leak"))
    most = (pressures.max() + offset) / (1 - scale - leak)
    if leak == 0.0:
        return (pressures + offset) / (1 - scale)
    a, b, c = leak / most, -(1 - scale), pressures + offset
    return (-b - np.sqrt(b * b - 4 * a * c)) / (2 * a)
