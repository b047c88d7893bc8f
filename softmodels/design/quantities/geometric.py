"""Quantities of the undeformed device: manufacturing constraints."""

from __future__ import annotations

import abc
import contextlib
import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from geometries import Actuator, GeometryError
from geometries.actuator import changed, is_length, parameter
from softmodels.common.arrays import Array
from softmodels.design.quantities.base import DesignQuantity, FormMeasure, Measure, register_quantity, scaled

if TYPE_CHECKING:
    from softmodels.design.body import DesignedBody


STEP = 1e-6
"""Step of the central differences, relative to the device's size, or to 1."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DeviceQuantity(DesignQuantity):
    """A quantity that depends only on the device's parameters."""

    of_state: ClassVar = False

    @abc.abstractmethod
    def values(self, device: Actuator) -> dict[str, float]:
        """Return the values by key, the same keys for every design."""

    def derivatives(self, device: Actuator, names: Sequence[str]) -> dict[str, Array]:
        """Return the derivatives of the values by parameters, by key: central differences, one-sided at the limits of
        valid devices."""
        here, columns = self.values(device), []
        for name in names:
            step = STEP * (device.size if is_length(device, name) else 1.0)
            ends = []
            for shift in (step, -step):
                with contextlib.suppress(GeometryError):
                    ends.append((shift, self.values(changed(device, {name: parameter(device, name) + shift}))))
            (a, high), (b, low) = (*ends, (0.0, here), (math.inf, here))[:2]
            columns.append([(high[key] - low[key]) / (a - b) for key in here])
        return dict(zip(here, np.array(columns).T.reshape(len(here), len(names)), strict=True))

    def measure(self, design: DesignedBody) -> Measure:
        raise TypeError("a quantity of only the device needs no mesh")


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class Clearances(DeviceQuantity):
    """Width of every wall and channel with a minimum."""

    name: ClassVar = "clearances"
    unit: ClassVar = "m"
    help: ClassVar = "width of every wall and channel with a minimum, one value each"

    def values(self, device: Actuator) -> dict[str, float]:
        return {f"clearance: {name}": value for name, value in device.clearances.items()}


# ----------------------------------------------------------------------------------------------------------------------
# Volumes, energies and masses.


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class AddedVolume(DesignQuantity):
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


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class StoredEnergy(DesignQuantity):
    """Energy stored in the whole device."""

    name: ClassVar = "stored_energy"
    unit: ClassVar = "J"
    help: ClassVar = "energy stored in the whole device's silicone"

    def measure(self, design: DesignedBody) -> Measure:
        system = design.system
        return FormMeasure(design, system.potential.energies, scaled(system.volume_unit), counted_in_stress=True)


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class Mass(DesignQuantity):
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
        # A constant 1, because UFL cannot find the mesh of a form with numbers only.
        solid = fem.Constant(body.mesh, 1.0) * body.hoop * body.measures()[0]
        return FormMeasure(design, [solid], scaled(self.density * design.system.volume_unit))
