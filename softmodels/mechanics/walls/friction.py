"""Coulomb friction of faces on a body that stands still: what samples remember, their forces and their stiffness.

A sample that touches is held where it first touched, along the body's surface, and slides once it has been drawn e from there.
With its way v from where it is held, n the surface's normal and f the force that presses it on:

    s = v - n (n . v)       t = mu |f| g(|s| / e) s / |s|       g(y) = 2 y - y^2 below 1, and 1 from there on

Where |s| > e it slides, and is held e behind itself from then on: the return mapping of plasticity (Wriggers 2006,
Computational Contact Mechanics, doi 10.1007/978-3-540-32609-0, chapter 10), with the smooth onset of Li et al. 2020,
Incremental Potential Contact, doi 10.1145/3386569.3392425. From one kept state to the next the way is a straight line, so
states depend on the steps between them to first order. The derivative of t is not symmetric, since the pressing force goes
along. Newton's method has all of it; the matrix that is factorised, and with it the path's direction and the stability, has it
with mu |f| held: then t is the derivative of a convex function, and the matrix is symmetric.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING

import numpy as np

from softmodels.mechanics.walls.samples import PressedSamples
from softmodels.mechanics.walls.surface import Array

if TYPE_CHECKING:
    import scipy

AT_LIMIT = 1e-9
"""Share of e by which a way may miss it and still be counted as sliding: so are kept states, to rounding."""
TINY = 1e-300
"""Added to what is divided by, where nothing presses and nothing moves."""


@dataclasses.dataclass(frozen=True)
class Rubbing:
    """A coefficient of friction, and over which way it sets in.

    Attributes:
        coefficient: mu.
        onset: e, in sizes.
    """

    coefficient: float
    onset: float

    def rates(self, far: Array) -> tuple[Array, Array]:
        """g of ways, shape (t,), and its derivative by the way."""
        y = np.minimum(far / self.onset, 1.0)
        return y * (2 - y), 2 * (1 - y) / self.onset

    def drawn(self, far: Array) -> Array:
        """Integral of g up to ways, shape (t,), and not beyond e."""
        y = np.minimum(far / self.onset, 1.0)
        return self.onset * (y**2 - y**3 / 3)


@dataclasses.dataclass(frozen=True, eq=False)
class Grip:
    """What samples remember of the state that was kept last, in sizes and shear moduli.

    Attributes:
        held: Where they were held; of those that did not touch, where they were, shape (s, d).
        gaps: Their distances from the body, below zero of those that touched, shape (s,).
        limits: mu times the forces that pressed on them, shape (s,).
        drawn: `Rubbing.drawn` of them, shape (s,).
        slid: How far each has slid so far, shape (s,).
        lost: Work against friction so far; what has drawn those that stick comes back.
    """

    held: Array
    gaps: Array
    limits: Array
    drawn: Array
    slid: Array
    lost: float

    @classmethod
    def of_free(cls, pressed: PressedSamples) -> Grip:
        """Of faces that nothing has held yet."""
        places = pressed.surface.places(pressed.nodes)
        limits, drawn, slid = np.zeros((3, len(places)))
        return cls(places, pressed.gaps, limits, drawn, slid, 0.0)


class Rubbed(PressedSamples):
    """A device's faces in one shape, pressed on by a body that they rub on.

    Args:
        pressed: The same without friction.
        rubbing: How they rub.
        grip: The state that was kept last.

    Attributes:
        pulls: Forces of friction on the samples that touch, as derivatives of an energy, shape (t, d).
        slides: Which of these slide.
    """

    def __init__(self, pressed: PressedSamples, rubbing: Rubbing, grip: Grip):
        super().__init__(pressed.surface, pressed.nodes)
        self.pressed, self.rubbing, self.grip = pressed, rubbing, grip
        self.gaps, self.touching = pressed.gaps, pressed.touching
        on = self.touching
        self._places = self.surface.places(self.nodes)
        push = pressed.slopes()[on]
        self._push = np.linalg.norm(push, axis=1)
        self._normal = push / (self._push + TINY)[:, None]
        self.limits = rubbing.coefficient * self._push
        self._far = (self._places - grip.held)[on]
        # What has come near since then is held where it touched: up to there it has gone by itself. A body from a file
        # does not know how far away it was, but not farther than that way.
        gone, depth = np.clip(grip.gaps[on], 0.0, np.linalg.norm(self._far, axis=1)), -self.gaps[on]
        self._share = np.where(gone > 0.0, depth / (gone + depth + TINY), 1.0)
        self._share_rate = np.where(gone > 0.0, gone / (gone + depth + TINY) ** 2, 0.0)
        self._way = self._share[:, None] * self._far
        s = self._way - self._normal * _dot(self._normal, self._way)[:, None]
        self._size = np.linalg.norm(s, axis=1)
        self._along = s / (self._size + TINY)[:, None]
        self._grip, self._grip_rate = rubbing.rates(self._size)
        self.slides = self._size > (1 - AT_LIMIT) * rubbing.onset
        self.pulls = (self.limits * self._grip)[:, None] * self._along

    @property
    def energy(self) -> float:
        """Of the contact alone: what friction takes is lost."""
        return self.pressed.energy

    def slopes(self) -> Array:
        found = np.array(self.pressed.slopes())
        found[self.touching] += self.pulls
        return found

    def curvatures(self) -> Array:
        """Second derivative by the place of each sample that touches, the limits held: symmetric, shape (t, d, d)."""
        n, a = self._normal, self._along
        flat = np.eye(n.shape[1]) - _outer(n, n)
        return np.asarray(self.pressed.curvatures() + self._share[:, None, None] * (self._drawn(a) @ flat))

    def _drawn(self, a: Array) -> Array:
        """Derivative of the pulls by s, the limits held, shape (t, d, d)."""
        eye, along = np.eye(a.shape[1]), _outer(a, a)
        across = 2 / self.rubbing.onset - self._size / self.rubbing.onset**2  # g / |s|, also where that is 0 / 0
        across = np.where(self._size < self.rubbing.onset, across, 1 / (self._size + TINY))
        drawn = across[:, None, None] * (eye - along) + self._grip_rate[:, None, None] * along
        return np.asarray(self.limits[:, None, None] * drawn)

    def whole_curvatures(self) -> Array:
        """The derivative of the forces itself, not symmetric, shape (t, d, d)."""
        n, a, way = self._normal, self._along, self._way
        eye = np.eye(n.shape[1])
        pressing = self.pressed.curvatures()
        # The normal turns as the pressing force does, and the share goes with the depth, whose slope is n.
        turn = (eye - _outer(n, n)) @ pressing / (self._push + TINY)[:, None, None]
        moved = self._share[:, None, None] * eye + (self._share_rate[:, None] * self._far)[:, :, None] * n[:, None, :]
        s = (eye - _outer(n, n)) @ moved - _dot(n, way)[:, None, None] * turn
        s -= n[:, :, None] * np.einsum("ti,tij->tj", way, turn)[:, None, :]
        harder = self.rubbing.coefficient * np.einsum("ti,tij->tj", n, pressing)
        return np.asarray(pressing + self._drawn(a) @ s + (self._grip[:, None] * a)[:, :, None] * harder[:, None, :])

    @functools.cached_property
    def whole_stiffness(self) -> scipy.sparse.csr_array:
        """The derivative of `forces` itself, not symmetric, shape (n d, n d)."""
        return self.scattered(self.whole_curvatures())

    def soon(self, share: float) -> np.ndarray:
        return self.pressed.soon(share)

    def kept(self) -> Grip:
        """What the samples remember once this state is kept."""
        on, grip = self.touching, self.grip
        held = self._places.copy()
        limits, drawn, slip = np.zeros((3, len(held)))
        reach = np.minimum(self._size, self.rubbing.onset)
        held[on] -= reach[:, None] * self._along
        limits[on], drawn[on], slip[on] = self.limits, self.rubbing.drawn(self._size), self._size - reach
        # What presses on them changes evenly along the way in between.
        lost = float(((grip.limits + limits) / 2 * (drawn - grip.drawn + slip)).sum())
        return Grip(held, self.gaps, limits, drawn, grip.slid + slip, grip.lost + lost)

    @property
    def sliding(self) -> float:
        """Share of the pressing force at samples that slide; 0 where nothing is pressed on."""
        whole = float(self._push.sum())
        return float(self._push[self.slides].sum()) / whole if whole > 0.0 else 0.0


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ti,ti->t", a, b))


def _outer(a: Array, b: Array) -> Array:
    return np.asarray(a[:, :, None] * b[:, None, :])
