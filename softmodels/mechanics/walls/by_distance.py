"""Faces that are pressed on by a body whose signed distance is known in closed form, with the energy of rigid shapes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from softmodels.mechanics.walls.gap import Penalty
from softmodels.mechanics.walls.samples import PressedSamples
from softmodels.mechanics.walls.surface import Array, Surface

type Slopes = Callable[[Array], tuple[Array, Array, Array]]
"""Of places, shape (s, d): their distances, the distances' gradients (s, d), and their second derivatives (s, d, d)."""


@dataclasses.dataclass(frozen=True)
class HardeningPenalty(Penalty):
    """The same penalty, which grows harder with the depth.

    Attributes:
        soft: Depth from which it does.
        harder: phi gets ``harder / (6 soft) (d - soft)^3`` more, times the stiffness.
    """

    soft: float
    harder: float

    def rates(self, d: Array) -> tuple[Array, Array, Array]:
        value, first, second = super().rates(d)
        k, over = self.stiffness * self.harder / self.soft, np.maximum(d - self.soft, 0.0)
        return value + k * over**3 / 6, first + k * over**2 / 2, second + k * over


class PressedByDistance(PressedSamples):
    """A device's faces in one shape, pressed on by such a body.

    Args:
        surface: The faces.
        slopes: The distance with its derivatives.
        penalty: phi.
        near: Distance that counts as near.
        nodes: Places of the faces' nodes, shape (n, d).
    """

    def __init__(self, surface: Surface, slopes: Slopes, penalty: Penalty, near: float, nodes: Array):
        super().__init__(surface, nodes)
        self._near = near
        self.gaps, gradients, seconds = slopes(surface.places(nodes))
        self.touching = self.gaps < 0.0
        phi, self._first, self._second = (surface.measure * rate for rate in penalty.rates(-self.gaps))
        self._energy = float(phi[self.touching].sum())
        self._gradients, self._seconds = gradients, seconds

    @property
    def energy(self) -> float:
        return self._energy

    def slopes(self) -> Array:
        return np.asarray(-np.where(self.touching, self._first, 0.0)[:, None] * self._gradients)

    def curvatures(self) -> Array:
        on = self.touching
        g = self._gradients[on]
        along = self._second[on, None, None] * g[:, :, None] * g[:, None, :]
        return np.asarray(along - self._first[on, None, None] * self._seconds[on])

    def soon(self, share: float) -> np.ndarray:
        return np.asarray(self.gaps < share * self._near)
