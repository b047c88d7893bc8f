"""A body that faces press on and that gives way along a line: on a spring, or with a weight that lies on a stand.

Its place s on the line is that of least energy, so it is no unknown of its own. With the energy phi of the faces against the
body where it stands, and that of its stand,

    Phi(x) = min over s of phi(x - s a) + e(s),     Phi' = phi',     Phi'' = phi'' - v v^T / k,

where v = phi'' A, A moves all nodes along a, and k = e'' + A.v. Directions in which Phi is unstable are those of the whole
system (Haynsworth's inertia theorem, doi 10.1016/0024-3795(68)90050-5), as k is above zero where s is stable.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from softmodels.mechanics.walls.samples import PressedSamples
from softmodels.mechanics.walls.surface import Array

if TYPE_CHECKING:
    import scipy

MOST = 80
"""Steps in which a place is found: Newton's, or halves of what is left."""
CLOSE = 1e-14
"""Step in sizes of the device at which it is found."""
LONGEST = 0.02
"""Longest step, in sizes: a body that is far from the faces feels nothing of them."""


@dataclasses.dataclass(frozen=True)
class Stand:
    """What holds a body: a spring, and a stand that its weight presses it on.

    The weight is taken off the stand over a short way, so that stiffnesses have no jump: the stand's force is
    ``weight * tanh(s / onset)`` above it, and grows as steeply below it.

    Attributes:
        spring: Force per way.
        weight: Force with which it lies on its stand; below zero where it is pulled off and only the spring holds it.
        onset: The short way.
    """

    spring: float
    weight: float
    onset: float

    def energy(self, s: float) -> float:
        if self.weight <= 0.0:
            return self.spring * s**2 / 2 + self.weight * s
        t = s / self.onset
        above = abs(t) + math.log1p(math.exp(-2 * abs(t))) - math.log(2)
        return self.spring * s**2 / 2 + self.weight * self.onset * (above if t > 0 else t**2 / 2)

    def force(self, s: float) -> float:
        """With which it is pushed back."""
        if self.weight <= 0.0:
            return self.spring * s + self.weight
        t = s / self.onset
        return self.spring * s + self.weight * (math.tanh(t) if t > 0 else t)

    def stiffness(self, s: float) -> float:
        if self.weight <= 0.0:
            return self.spring
        t = s / self.onset
        return self.spring + self.weight / self.onset * ((1 - math.tanh(t) ** 2) if t > 0 else 1.0)


class GivingWay:
    """Faces in one shape, pressed on by such a body.

    Args:
        pressed: Of the nodes' places, the faces pressed on by the body in its first place.
        stand: What holds it.
        along: The line's direction, shape (d,).
        nodes: Places of the nodes, shape (n, d).
        start: Place on the line to look from.

    Attributes:
        s: Its place.
        here: The faces, moved to the body.
        v: How the forces change as the faces go along the line as a whole, shape (n d,).
        k: Second derivative of the energy by s.
    """

    def __init__(
        self, pressed: Callable[[Array], PressedSamples], stand: Stand, along: Array, nodes: Array, start: float
    ):
        self.stand, self.along = stand, along
        low, high, s, all_along = -math.inf, math.inf, start, np.tile(along, len(nodes))
        for _ in range(MOST):
            self.here, self.s = pressed(nodes - s * along), s
            self.v = np.asarray(self.here.stiffness @ all_along)
            self.k = k = stand.stiffness(s) + float(all_along @ self.v)
            surplus = stand.force(s) - self.push
            low, high = (low, s) if surplus > 0.0 else (s, high)
            step = -surplus / k if k > 0.0 else -math.copysign(LONGEST, surplus)
            after = s + float(np.clip(step, -LONGEST, LONGEST))
            if not low < after < high:
                after = (low + high) / 2 if math.isfinite(high - low) else s
            if surplus == 0.0 or abs(after - s) < CLOSE:
                return
            s = after

    @property
    def push(self) -> float:
        """Force of the faces on the body along its line."""
        return float(self.here.forces.sum(axis=0) @ self.along)

    @property
    def energy(self) -> float:
        return self.here.energy + self.stand.energy(self.s)

    @property
    def forces(self) -> Array:
        return self.here.forces

    @property
    def stiffness(self) -> scipy.sparse.csr_array:
        import scipy

        v = self.v
        at = np.flatnonzero(v)
        rows, columns = (part.ravel() for part in np.meshgrid(at, at, indexing="ij"))
        less = scipy.sparse.coo_array(
            (np.outer(v[at], v[at]).ravel() / self.k, (rows, columns)), shape=(len(v), len(v))
        )
        return scipy.sparse.csr_array(self.here.stiffness - less)

    def harder(self) -> Array:
        """Derivative of the forces as spring and weight grow in proportion, by their share, shape (n, d)."""
        return np.asarray(self.v * self.stand.force(self.s) / self.k).reshape(self.here.nodes.shape)

    def coupled(self, share: float) -> scipy.sparse.csr_array:
        """All nodes near the body are, as it gives way to each of them, true for each two, shape (n, n)."""
        import scipy

        near, n = np.unique(self.here.near_facets(share)), len(self.here.nodes)
        rows, columns = (part.ravel() for part in np.meshgrid(near, near, indexing="ij"))
        ones = np.ones(len(rows), dtype=np.bool_)
        return scipy.sparse.csr_array(scipy.sparse.coo_array((ones, (rows, columns)), shape=(n, n)))
