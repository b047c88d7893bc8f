"""The grid's ink under the profiles across an edge: the light it takes, and how far it draws a blurred edge to itself."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from measurement.screen.grid_look import GridLook
from measurement.screen.setup import Setup

Array = npt.NDArray[np.float64]

CELLS = 64
"""Cells per side of the table of places on the screen; a photograph is straight within each to a hundredth of a pixel."""

REACH = 4.0
"""Blurs, beyond half of its width, from a line's middle up to which it draws an edge."""

Transmission = Callable[[Array], Array]
"""Share of light that the ink lets through at pixels (..., 2)."""

Drawn = Callable[[Array, Array, Array], Array]
"""What ink leaves in profiles: of pixels (n, k, 2), their distances (n, k) from the edge in its widths and these (n,) in px."""


@dataclasses.dataclass(frozen=True, eq=False)
class Ink:
    """The ink at pixels of a photograph.

    Attributes:
        look: What the photograph shows of the grid.
        roi: Region x0, y0, x1, y1 in px that was looked at.
        table: Places on the screen in m at the nodes of a lattice over the region, shape (65, 65, 2).
    """

    look: GridLook
    roi: tuple[int, int, int, int]
    table: Array

    @classmethod
    def of(cls, look: GridLook, setup: Setup, roi: tuple[int, int, int, int]) -> Ink:
        """The ink of a photograph; the map to the screen is taken straight within each cell of a table."""
        x0, y0, x1, y1 = roi
        columns, rows = np.linspace(x0, x1 - 1, CELLS + 1), np.linspace(y0, y1 - 1, CELLS + 1)
        lattice = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
        places = setup.to_metres(lattice).reshape(CELLS + 1, CELLS + 1, 2) * setup.magnification
        return cls(look, roi, np.ascontiguousarray(np.nan_to_num(places, nan=1.0), dtype=np.float64))

    def __call__(self, points: Array) -> Array:
        """Share of light (...) that the ink lets through at pixels (..., 2)."""
        return self.look.transmission(self.places(points))

    def places(self, points: Array) -> Array:
        """Places (..., 2) on the screen in m that pixels (..., 2) show."""
        x0, y0, x1, y1 = self.roi
        flat = points.reshape(-1, 2)
        return _bilinear(self.table, (flat - [x0, y0]) / [x1 - 1 - x0, y1 - 1 - y0] * float(CELLS)).reshape(
            points.shape
        )

    def drawn(self, points: Array, z: Array, width: Array) -> Array:
        """What the ink leaves in profiles across an edge after the light was divided by what it lets through.

        Args:
            points: Pixels (n, k, 2) of n profiles, from shadow to light.
            z: Their distance (n, k) from the edge in its widths.
            width: Standard deviation (n,) of penumbra and blur in px.

        Returns:
            The rest (n, k) as a share of the edge's rise.
        """
        places, rest = self.places(points), np.zeros(z.shape)
        length = np.linalg.norm(points[:, -1] - points[:, 0], axis=1)
        along = (points[:, -1] - points[:, 0]) / length[:, None]
        # Directions across the edge and along it, in m per pixel.
        ahead = (places[:, -1] - places[:, 0]) / length[:, None]
        middle = points[:, z.shape[1] // 2]
        turned = np.column_stack([-along[:, 1], along[:, 0]])
        beside = 0.5 * (self.places(middle + turned) - self.places(middle - turned))
        for axis, line in enumerate(self.look.lines):
            if line is None:
                continue
            off = self.look.off_line(places[..., axis], axis)
            near = (np.abs(off) < 0.5 * line.width + REACH * line.blur).any(axis=1)
            if not near.any():
                continue
            slope = np.hypot(ahead[near, axis], beside[near, axis])
            correlation = line.blur * ahead[near, axis] / (slope**2 * width[near])
            rest[near] += line.covariance(off[near], z[near], correlation[:, None])
        return rest / self(points)


def _bilinear(table: Array, at: Array) -> Array:
    at = np.clip(at, 0.0, float(CELLS))
    cell = np.minimum(at.astype(np.int64), CELLS - 1)
    u, v = (at - cell).T
    i, j = cell[:, 1], cell[:, 0]
    return (
        table[i, j] * ((1 - u) * (1 - v))[:, None] + table[i, j + 1] * (u * (1 - v))[:, None]
        + table[i + 1, j] * ((1 - u) * v)[:, None] + table[i + 1, j + 1] * (u * v)[:, None]
    )  # fmt: skip
