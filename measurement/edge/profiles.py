"""Light profiles across an edge, at stations along a path near it."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from measurement.camera.pixels import LIGHT, Pixels, Unmeasurable, sample_light
from measurement.edge.ink import Drawn, Transmission
from measurement.edge.shadow import ShadowColour

Array = npt.NDArray[np.float64]

HALF = 30
"""Samples of a profile on each side of its middle."""

LONGEST_STATION = 8.0
"""Length in px along the edge over which a profile is averaged at most."""

INK_TRUST = 0.05
"""Share by which the correction for the grid's ink may be wrong; samples on ink weigh less accordingly."""


@dataclasses.dataclass(frozen=True, eq=False)
class Shading:
    """How much of the lamp each place of a photograph sees, the grid's ink taken out.

    Attributes:
        image: The photograph, shape (h, w, 3).
        colour: Colours of the shadow and the screen.
        through: What the grid's ink lets through; None where there is no grid.
        drawn: What the ink leaves in the profiles because it is blurred together with the edge; None leaves that out.
        light: Light of every stored number.
    """

    image: Pixels
    colour: ShadowColour
    through: Transmission | None = None
    drawn: Drawn | None = None
    light: npt.NDArray[np.float32] = dataclasses.field(default_factory=lambda: LIGHT)

    def level(self, points: Array) -> Array:
        """Light (...) at pixels (..., 2), its channels mixed as the shadow's colour asks for; NaN outside of the picture."""
        return sample_light(self.image, points, self.light) @ self.colour.direction


@dataclasses.dataclass(frozen=True, eq=False)
class Profiles:
    """Light across an edge at n stations along it, k samples each.

    Attributes:
        place: The stations in px, shape (n, 2).
        normal: Unit vectors from shadow to light, along which the samples lie, shape (n, 2).
        offsets: Distances of the samples from the stations in px, shape (k,).
        value: Light, averaged along the edge, shape (n, k).
        weight: Weights of the samples, 1 where all of them are clear of ink and inside of the picture, shape (n, k).
        points: Pixels that stand for the station's length, shape (n, m, k, 2).
    """

    place: Array
    normal: Array
    offsets: Array
    value: Array
    weight: Array
    points: Array

    @classmethod
    def across(cls, shading: Shading, path: Array, spacing: float, reach: float) -> Profiles:
        """Profiles from ``reach`` px in the shadow to ``reach`` px in the light, every ``spacing`` px of a path (m, 2)."""
        place, normal = stations(path, spacing)
        offsets = np.linspace(-reach, reach, 2 * HALF + 1)
        tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
        count = max(1, round(min(spacing, LONGEST_STATION)))
        beside = np.arange(count) - (count - 1) / 2.0
        points = (
            place[:, None, None, :]
            + beside[None, :, None, None] * tangent[:, None, None, :]
            + offsets[None, None, :, None] * normal[:, None, None, :]
        )
        value = shading.level(points)
        weight = np.isfinite(value).astype(float)
        if shading.through is not None:
            ink = shading.through(points)
            value = value / ink
            weight *= 1.0 / (1.0 + ((1.0 - ink) * INK_TRUST / 0.01) ** 2)
        value = np.where(weight > 0.0, value, 0.0)
        total = weight.sum(axis=1)
        mean = (weight * value).sum(axis=1) / np.maximum(total, 1e-9)
        return cls(place, normal, offsets, mean, total / count, points[:, :: max(1, (count - 1) // 2)])

    def drawn(self, drawn: Drawn, z: Array, width: Array) -> Array:
        """What ink leaves in the profiles (n, k), averaged over the stations' lengths; see `Drawn`."""
        parts = range(self.points.shape[1])
        return np.asarray(np.mean([drawn(self.points[:, part], z, width) for part in parts], axis=0))


def stations(path: Array, spacing: float) -> tuple[Array, Array]:
    """Places (n, 2) at equal distances along a path, and its unit normals (n, 2): to the left of the way along it.

    Raises:
        Unmeasurable: The path is too short.
    """
    step = np.linalg.norm(np.diff(path, axis=0), axis=1)
    keep = np.r_[True, step > 1e-9]
    path, arc = path[keep], np.r_[0.0, np.cumsum(step[step > 1e-9])]
    if len(path) < 5 or arc[-1] < 5.0 * spacing:
        raise Unmeasurable("the shadow is too small to be measured; bring the camera nearer")
    s = np.arange(0.5 * spacing, arc[-1], spacing)

    def at(along: Array) -> Array:
        return np.column_stack([np.interp(along, arc, path[:, axis]) for axis in (0, 1)])

    # Directions come from a chord of several stations: a single step of a coarse contour turns with every pixel.
    chord = 3.0 * spacing
    tangent = at(np.minimum(s + chord, arc[-1])) - at(np.maximum(s - chord, 0.0))
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1), 1e-9)[:, None]
    return at(s), np.column_stack([tangent[:, 1], -tangent[:, 0]])
