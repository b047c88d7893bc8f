"""Tolerances of fabrication, and what they and the material's errors do to a value: first-order propagation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from softmodels.case.material_errors import MaterialErrors
from softmodels.design.errors import DesignError
from softmodels.design.free import expanded, unit_of
from softmodels.design.trials import Trial
from softmodels.design.units import read

SURE = 1.645
"""Standard deviations below which a normal value stays with 95 %, on one side."""


def tolerances_of(device: Actuator, table: Mapping[str, object], bare: bool) -> dict[str, float]:
    """Standard deviations in SI units by parameter.

    Raises:
        DesignError: An unknown parameter, or no deviation.
    """
    found: dict[str, float] = {}
    for name, value in table.items():
        for one in expanded(device, name):
            spread = read(f"tolerance of {one}", value, unit_of(device, one), bare)
            if spread <= 0.0:
                raise DesignError(f"tolerance of {one} is {value}; a standard deviation is above zero")
            if one.partition("[")[0] not in device.movable and one not in device.movable:
                raise DesignError(f"tolerance of {one}: the mesh of this {type(device).__name__} cannot follow it")
            found[one] = spread
    return found


class Spread:
    """Standard deviations of the quantities of a design.

    Args:
        names: The parameters that gradients are by.
        tolerances: Standard deviations by parameter, SI units.
        errors: Of the material; None where they are not given.
    """

    def __init__(self, names: Sequence[str], tolerances: Mapping[str, float], errors: MaterialErrors | None):
        self.errors = errors
        self.spreads = np.array([tolerances.get(name, 0.0) for name in names])

    @property
    def any(self) -> bool:
        return bool(self.spreads.any()) or self.errors is not None

    def sigma(self, trial: Trial, key: str) -> float:
        """Standard deviation of a value in its SI unit, to first order; 0 where nothing scatters."""
        variance = 0.0
        if key in trial.gradients:
            variance += float(np.sum((np.asarray(trial.gradients[key]) * self.spreads) ** 2))
        errors = self.errors
        if errors is not None and key in trial.material_gradients:
            slope: npt.NDArray[np.float64] = np.array(
                [trial.material_gradients[key].get(name, 0.0) for name in errors.names]
            )
            variance += float(slope @ errors.matrix @ slope)
        return float(np.sqrt(max(variance, 0.0)))
