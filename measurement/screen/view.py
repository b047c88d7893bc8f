"""A region of one photograph as light, and where it lies on the screen."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from measurement.camera.pixels import LIGHT, Pixels, sample_light
from measurement.screen.setup import Setup

Array = npt.NDArray[np.float64]

NODES = 33
"""Places along each side of a region at which its reach on the screen is asked."""


@dataclasses.dataclass(frozen=True, eq=False)
class View:
    """What is looked at of a photograph.

    Attributes:
        image: The photograph, shape (h, w, 3).
        setup: Camera and screen.
        roi: Region x0, y0, x1, y1 in px.
        light: Light of every stored number.
    """

    image: Pixels
    setup: Setup
    roi: tuple[int, int, int, int]
    light: npt.NDArray[np.float32] = dataclasses.field(default_factory=lambda: LIGHT)

    @property
    def size(self) -> Array:
        """Width and height of the region in px, shape (2,)."""
        return np.subtract(self.roi[2:], self.roi[:2]).astype(np.float64)

    @property
    def pixel(self) -> float:
        """Length in m of a pixel in the middle of the region, in the object's plane."""
        middle = np.array([[0.5 * (self.roi[0] + self.roi[2]), 0.5 * (self.roi[1] + self.roi[3])]])
        return float(np.sqrt(np.abs(np.linalg.det(self.setup.jacobian(middle)[0]))))

    def sample(self, points: Array) -> Array:
        """Light (..., 3) at pixels (..., 2); NaN outside of the picture."""
        return sample_light(self.image, points, self.light)

    def extent(self) -> tuple[Array, Array]:
        """Least and greatest X and Z in m on the screen that the region shows, shapes (2,)."""
        x0, y0, x1, y1 = self.roi
        columns, rows = np.meshgrid(np.linspace(x0, x1 - 1, NODES), np.linspace(y0, y1 - 1, NODES))
        places = self.setup.to_metres(np.column_stack([columns.ravel(), rows.ravel()])) * self.setup.magnification
        places = places[np.isfinite(places).all(axis=1)]
        return places.min(axis=0), places.max(axis=0)

    def inside(self, points: Array, margin: float = 0.0) -> npt.NDArray[np.bool_]:
        """Which pixels (..., 2) lie in the region, and so far in px from its rim; shape (...)."""
        low, high = np.array(self.roi[:2]) + margin, np.array(self.roi[2:]) - 1.0 - margin
        return np.asarray(((points >= low) & (points <= high)).all(axis=-1))

    def reduced(self, points: Array, shape: tuple[int, ...]) -> Array:
        """Pixels (..., 2) of the photograph in those of the region made smaller to a picture of this shape (h, w)."""
        scale = np.array(shape[::-1]) / self.size
        return np.asarray((points - self.roi[:2] + 0.5) * scale - 0.5)

    def enlarged(self, points: Array, shape: tuple[int, ...]) -> Array:
        """The inverse of `reduced`."""
        scale = self.size / np.array(shape[::-1])
        return np.asarray((points + 0.5) * scale - 0.5 + self.roi[:2])
