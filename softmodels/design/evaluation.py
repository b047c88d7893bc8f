"""What a design is worth: values and gradients of all quantities at one set of parameters."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from softmodels.design.squares import Squares

Array = npt.NDArray[np.float64]


class DesignFailure(RuntimeError):
    """A design that cannot be judged: it is no device, or has no state at a load; the message is a sentence.

    Attributes:
        limit: Pressure in Pa at which its path ends, if that is why.
    """

    def __init__(self, message: str, limit: float | None = None):
        super().__init__(message)
        self.limit = limit


@dataclasses.dataclass(frozen=True, eq=False)
class Evaluation:
    """A design, judged.

    Attributes:
        theta: Its parameters in SI units.
        device: The device.
        values: Of the quantities by key, in their SI units.
        gradients: Their derivatives by the parameters, each of the shape of theta; empty if none were asked for.
        material_gradients: Their derivatives by the material's numbers, by key and name.
        quality: Least Jacobian of a cell over its own where the mesh was made; 1 on a fresh mesh.
        newton: Newton iterations that all states took.
        remeshed: Whether a fresh mesh was made.
        notes: Sentences on how far the values can be trusted.
        squares: Of the quantities that are distances from a target, by key.
    """

    theta: Array
    device: Actuator
    values: dict[str, float]
    gradients: dict[str, Array]
    material_gradients: dict[str, dict[str, float]] = dataclasses.field(default_factory=dict)
    quality: float = 1.0
    newton: int = 0
    remeshed: bool = False
    notes: tuple[str, ...] = ()
    squares: dict[str, Squares] = dataclasses.field(default_factory=dict)
