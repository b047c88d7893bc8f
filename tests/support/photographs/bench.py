"""Random benches for synthetic photographs: a camera, a screen, a lamp and a body each."""

from __future__ import annotations

import dataclasses

import numpy as np

from measurement.photographer import Scene, dome, dome_height
from softmodels.common.arrays import Array

PA_PER_CM = 95.1
"""Pressure in Pa of a centimetre of the column's water."""


@dataclasses.dataclass(frozen=True)
class Bench:
    """A random bench.

    Attributes:
        seed: What it was made from.
        scene: Camera, screen and lamp.
        top: Greatest height in m.
        radius: Radius of the bulge in m.
        floor: Z of the undeformed surface in m.
        half_width: Half width of the body in m; its sides are in the picture if that is small enough.
        sinks: Share of the height by which the body's rim sinks.
    """

    seed: int
    scene: Scene
    top: float
    radius: float
    floor: float
    half_width: float
    sinks: float

    @classmethod
    def random(cls, seed: int, mixed: bool = False) -> Bench:
        """Return the bench of a seed; every other one shows the body's sides.

        Args:
            seed: Its seed.
            mixed: Whether lamps are frosted bulbs, discs and squares in turn, and cameras plain ones, ones with an S curve
                and phones that sharpen too; plain cameras and frosted bulbs else.
        """
        rng = np.random.default_rng([2013, seed])
        scene = Scene(
            width=1250, height=820, focal_px=2850.0, pixel_size=28e-6, tilt=rng.uniform(-5.0, 15.0),
            pan=rng.uniform(-25.0, 25.0), roll=rng.uniform(-2.0, 2.0), distortion=(rng.uniform(-0.1, 0.05),),
            target=(rng.uniform(-1e-3, 1e-3), rng.uniform(0.0, 1.5e-3)), grid_pitch=float(rng.choice([4.5e-3, 9e-3])),
            line_width=rng.uniform(0.3e-3, 0.6e-3), line_grey=rng.uniform(0.15, 0.4), brightness=rng.uniform(150.0, 225.0),
            unevenness=rng.uniform(0.0, 0.3), ambient=rng.uniform(0.05, 0.2), penumbra=rng.uniform(35e-6, 90e-6),
            blur=rng.uniform(0.7, 1.3), noise=rng.uniform(1.0, 3.0), dust=int(rng.integers(0, 6)),
            jpeg_quality=int(rng.integers(88, 98)), srgb=True,
        )  # fmt: skip
        if mixed:
            curve, sharpening = ((0.0, 0.0), (0.2, 0.0), (0.15, 0.8))[seed // 3 % 3]
            lamp = ("gaussian", "disc", "square")[seed % 3]
            scene = dataclasses.replace(scene, lamp=lamp, s_curve=curve, sharpening=sharpening)
        seen = bool(seed % 2)
        half_width = rng.uniform(12.5e-3, 14.5e-3) if seen else 0.2
        radius = rng.uniform(9e-3, 11e-3) if seen else rng.uniform(9e-3, 13e-3)
        return cls(
            seed, scene, rng.uniform(2.5e-3, 9e-3), radius, rng.uniform(-6.5e-3, -5e-3), half_width,
            float(rng.choice([0.0, rng.uniform(0.0, 0.13)])) if seen else 0.0,
        )  # fmt: skip

    @property
    def shows_sides(self) -> bool:
        """Whether the body's own width can be seen."""
        return self.half_width < 0.1

    def surface(self, x: Array, height: float) -> Array:
        """Height (n,) in m of the surface above the undeformed one."""
        rise = dome_height(x, height, self.radius)
        if not self.shows_sides:
            return np.asarray(rise)
        share = np.abs(x) / self.half_width
        return np.asarray(rise - self.sinks * max(height, 0.0) * share**2 * (3 - 2 * share))

    def polygon(self, height: float) -> Array:
        """Return the body (k, 2) in m."""
        if not self.shows_sides:
            return dome(height, self.radius, floor=self.floor, half_width=self.half_width)
        upper = self.upper(height, 1601)
        return np.vstack([upper, [[self.half_width, -0.2], [-self.half_width, -0.2]]])

    def upper(self, height: float, count: int = 2001) -> Array:
        """Return the surface (n, 2) in m as far as it can be in the picture."""
        reach = min(self.half_width, 0.018)
        x = np.linspace(-reach, reach, count)
        return np.column_stack([x, self.floor + self.surface(x, height)])
