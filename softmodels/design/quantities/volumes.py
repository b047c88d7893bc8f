"""Volumes, energies and masses."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from softmodels.design.quantities.base import Measure, Quantity, quantity
from softmodels.design.quantities.forms import FormMeasure, scaled

if TYPE_CHECKING:
    from softmodels.design.designed_body import DesignedBody


@quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class AddedVolume(Quantity):
    """Volume that the whole device's cavity has gained."""

    name: ClassVar = "added_volume"
    unit: ClassVar = "m3"
    help: ClassVar = "volume that the whole device's cavity has gained"

    def measure(self, design: DesignedBody) -> Measure:
        system = design.system
        unit = system.volume_unit
        return FormMeasure(
            design,
            [system.potential.cavity_volume, design.rest_volume],
            lambda values: (unit * float(values[0] - values[1]), unit * np.array([1.0, -1.0])),
        )


@quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class StoredEnergy(Quantity):
    """Energy stored in the whole device."""

    name: ClassVar = "stored_energy"
    unit: ClassVar = "J"
    help: ClassVar = "energy stored in the whole device's silicone"

    def measure(self, design: DesignedBody) -> Measure:
        system = design.system
        return FormMeasure(design, system.potential.energies, scaled(system.volume_unit), counted_in_stress=True)


@quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class Mass(Quantity):
    """Mass of the silicone of the whole device.

    Attributes:
        density: kg/m3; common silicones have 1040 to 1130.
    """

    name: ClassVar = "mass"
    unit: ClassVar = "kg"
    help: ClassVar = "mass of the whole device's silicone"
    of_state: ClassVar = False

    density: float = 1070.0

    def measure(self, design: DesignedBody) -> Measure:
        from dolfinx import fem

        body = design.system.body
        # A constant one: a form of numbers alone has no mesh for UFL to find.
        solid = fem.Constant(body.mesh, 1.0) * body.hoop * body.measures()[0]
        return FormMeasure(design, [solid], scaled(self.density * design.system.volume_unit))
