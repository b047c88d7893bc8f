"""Quantities of the device alone, without a state: what the workshop can make."""

from __future__ import annotations

import abc
import contextlib
import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from geometries import Actuator, GeometryError
from geometries.parameters import changed, is_length, parameter
from softmodels.design.quantities.base import Measure, Quantity, quantity

if TYPE_CHECKING:
    from softmodels.design.designed_body import DesignedBody

Array = npt.NDArray[np.float64]

STEP = 1e-6
"""Of the central differences, in shares of the device's size, or of 1."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DeviceQuantity(Quantity):
    """What the device's parameters alone tell."""

    of_state: ClassVar = False

    @abc.abstractmethod
    def values(self, device: Actuator) -> dict[str, float]:
        """Values by key, the same keys for every design."""

    def derivatives(self, device: Actuator, names: Sequence[str]) -> dict[str, Array]:
        """Derivatives of the values by parameters, by key: central differences, one-sided at the edge of what is a device."""
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
        raise TypeError("a quantity of the device alone needs no mesh")


@quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class Clearances(DeviceQuantity):
    """Every wall and every channel that has a least width."""

    name: ClassVar = "clearances"
    unit: ClassVar = "m"
    help: ClassVar = "every wall and every channel that has a least width, one value each"

    def values(self, device: Actuator) -> dict[str, float]:
        return {f"clearance: {name}": value for name, value in device.clearances.items()}
