"""One state of a device in numbers."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping


@dataclasses.dataclass(frozen=True)
class Figures:
    """One state in numbers, of the whole device, SI units.

    Extremes of stretch and stress are over the integration points. Those of J are over the vertices, as `VolumeRatio` has
    it: that is where the elements keep the volume, and cells and points scatter around it by an error of the mesh.

    ``cavity_pressures`` and ``cavity_volumes`` (added ones) are of each cavity. ``added_volume`` is what a pressure common to
    all works on: their sum, or the sum of their products with the device's pressure ratios.
    ``rises`` are the probes' displacements along the lift, ``device`` is what `Actuator.device_figures` makes of their
    places, ``max_stretch_at`` the undeformed place of the largest stretch in device coordinates. ``extremes`` has the
    least and the largest value of every output field that is sampled, SI units, by name; ``peaks`` the `results.peak` of those
    that have one.
    """

    pressure: float
    added_volume: float
    cavity_pressures: tuple[float, ...]
    cavity_volumes: tuple[float, ...]
    rises: dict[str, float]
    device: dict[str, float]
    max_displacement: float
    max_stretch_at: tuple[float, float, float]
    extremes: Mapping[str, tuple[float, float]]
    peaks: Mapping[str, float]
    stored_energy: float

    @property
    def max_stretch(self) -> float:
        return self.extremes["largest_stretch"][1]

    @property
    def max_von_mises(self) -> float:
        """In Pa."""
        return self.extremes["von_mises"][1]

    @property
    def J_min(self) -> float:
        return self.extremes["J"][0]

    @property
    def J_max(self) -> float:
        return self.extremes["J"][1]
