"""A circular membrane that is inflated, by shooting: no bending, no cells, large strains, incompressible.

The membrane is flat, of radius b and thickness H, held at its edge. With R the undeformed radius, r(R) and z(R) the deformed
place, phi the meridian's slope downwards, l1 and l2 = r/R the stretches along the meridian and the hoop, and w(l1, l2) the
energy per undeformed volume::

    r' = l1 cos(phi)          (R H w1)' = H w2 cos(phi)                  along the meridian
    z' = -l1 sin(phi)         R H w1 phi' = P r l1 - H w2 sin(phi)       across it

where w1 and w2 are the derivatives of w, so that H w1 is the force per undeformed length. In the middle is either a pole or a
rigid plate of radius a, on which a weight F presses: r(a) = a, and 2 pi a H w1 sin(phi) = pi a^2 P - F. Whatever the stretch
and the pressure are found with which r(b) = b and the middle is at a given height: the height rises along the whole path, past
limit points too. As a program: python membrane_shooting.py prints two paths.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

POLE = 1e-6
"""Radius over b at which the integration starts where there is no plate."""


@dataclasses.dataclass(frozen=True)
class Yeoh:
    """W = c1 (I1 - 3) + c2 (I1 - 3)^2 + c3 (I1 - 3)^3 in Pa; neo-Hookean with c1 = mu/2 alone."""

    c1: float
    c2: float = 0.0
    c3: float = 0.0

    def energy(self, l1, l2):
        k = l1**2 + l2**2 + 1 / (l1 * l2) ** 2 - 3
        return self.c1 * k + self.c2 * k**2 + self.c3 * k**3

    def derivatives(self, l1, l2):
        """w1, w2, w11 and w12 in Pa."""
        thin = 1 / (l1 * l2) ** 2
        k = l1**2 + l2**2 + thin - 3
        slope, bend = self.c1 + 2 * self.c2 * k + 3 * self.c3 * k**2, 2 * self.c2 + 6 * self.c3 * k
        i1, i2 = 2 * (l1 - thin / l1), 2 * (l2 - thin / l2)
        i11, i12 = 2 * (1 + 3 * thin / l1**2), 4 * thin / (l1 * l2)
        return slope * i1, slope * i2, slope * i11 + bend * i1**2, slope * i12 + bend * i1 * i2


@dataclasses.dataclass(frozen=True)
class MembraneState:
    """One state, in SI units.

    Attributes:
        pressure: Of the air in Pa.
        height: Of the pole, or of the plate, above the clamp in m.
        volume: Between membrane and the clamp's plane in m3.
        stretch: Along the meridian in the middle or at the plate's edge.
        radii: Undeformed radii in m, from the middle outwards.
        places: Deformed radius and height there in m, shape (n, 2).
        stretches: l1 and l2 there, shape (n, 2).
        energy: Stored in J.
    """

    pressure: float
    height: float
    volume: float
    stretch: float
    radii: np.ndarray
    places: np.ndarray
    stretches: np.ndarray
    energy: float


@dataclasses.dataclass(frozen=True)
class CircularMembrane:
    """A membrane in SI units.

    Attributes:
        radius: Of the clamp, b.
        thickness: H.
        law: Its material.
        plate: Radius a of a rigid plate in the middle; 0 for none.
        weight: Force F with which the plate presses down, in N.
    """

    radius: float
    thickness: float
    law: Yeoh
    plate: float = 0.0
    weight: float = 0.0

    def path(self, heights) -> list[MembraneState]:
        """The states in which the pole or the plate stands at some heights in m, the first of which is not 0.

        Each begins from the one before, so neighbours should not differ by more than a tenth of the radius or two.

        Raises:
            ValueError: No state was found.
        """
        steps = [(share * self.weight, heights[0]) for share in (np.linspace(0, 1, 11)[:-1] if self.weight else ())]
        steps += [(self.weight, height) for height in heights]
        found: list[MembraneState] = []
        known: list[np.ndarray] = []
        for k, (weight, height) in enumerate(steps):
            guess = known[-1] if known else self._guess(height)
            if k > 1:
                step, last = np.subtract(steps[k], steps[k - 1]), np.subtract(steps[k - 1], steps[k - 2])
                guess = known[-1] + np.linalg.norm(step) / np.linalg.norm(last) * (known[-1] - known[-2])
            one = dataclasses.replace(self, weight=weight)
            done = root(one._missed, guess, (height,), tol=1e-11)
            if not np.abs(done.fun).max() < 1e-8:
                raise ValueError(f"no state at a height of {height * 1e3:.4g} mm under {weight:.4g} N")
            known.append(done.x)
            found.append(one._state(done.x))
        return found[-len(heights) :]

    def at_height(self, height: float, largest: float = 0.1) -> MembraneState:
        """The state at a height in m, reached in steps of up to ``largest`` radii from a flat one on the same side."""
        count = max(2, math.ceil(abs(height) / (largest * self.radius)))
        return self.path(np.linspace(height / count, height, count))[-1]

    @property
    def _unit(self) -> float:
        """Pa in one dimensionless pressure."""
        return self.law.derivatives(1.0, 1.0)[2] * self.thickness / self.radius

    def _guess(self, height: float) -> np.ndarray:
        """Stretch and dimensionless pressure where the slope rises with the radius, as under an even tension."""
        a, b = self.plate, self.radius
        bend = 2 * height / (b**2 - a**2)
        stretch = 1 + bend**2 * (b**3 - a**3) / (6 * (b - a)) * (1 if a else 2)
        w1 = self.law.derivatives(stretch, 1.0 if a else stretch)[0]
        return np.array([stretch, 2 * bend * self.thickness * w1 / self._unit])

    def _missed(self, x, height: float):
        """How far the edge ends beyond the clamp and from its plane, in radii; large where it does not get there."""
        done = self._integrated(x)
        if done is None or done.status == 1:
            return np.array([10.0, 10.0])
        return (done.y[:2, -1] - (self.radius, -height)) / self.radius

    def _integrated(self, x, **more):
        stretch, pressure = float(x[0]), float(x[1]) * self._unit
        start = self._start(pressure, stretch)
        if start is None or not 0.2 < stretch < 20.0:
            return None
        return solve_ivp(
            self._slopes, (start[0], self.radius), start[1], args=(pressure,), method="DOP853", rtol=1e-10, atol=1e-14,
            events=_folded, **more,
        )  # fmt: skip

    def _start(self, pressure: float, stretch: float):
        """Radius at which the integration starts, and (r, z, l1, phi, volume, energy) there; None if it cannot."""
        if not self.plate:
            R = POLE * self.radius
            w1 = self.law.derivatives(stretch, stretch)[0]
            phi = pressure * stretch**2 * R / (2 * self.thickness * w1)
            return R, [stretch * R, 0.0, stretch, phi, 0.0, 0.0]
        a, w1 = self.plate, self.law.derivatives(stretch, 1.0)[0]
        sine = (math.pi * a**2 * pressure - self.weight) / (2 * math.pi * a * self.thickness * w1) if w1 else math.inf
        if abs(sine) > 1.0:
            return None
        return a, [a, 0.0, stretch, math.asin(sine), 0.0, 0.0]

    def _slopes(self, R, y, pressure):
        r, _, l1, phi, _, _ = y
        l2 = r / R
        w1, w2, w11, w12 = self.law.derivatives(l1, l2)
        cosine, sine = math.cos(phi), math.sin(phi)
        l1_slope = ((w2 * cosine - w1) / R - w12 * (l1 * cosine - l2) / R) / w11
        phi_slope = (pressure * r * l1 / self.thickness - w2 * sine) / (R * w1)
        stored = 2 * math.pi * R * self.thickness * self.law.energy(l1, l2)
        return [l1 * cosine, -l1 * sine, l1_slope, phi_slope, math.pi * r**2 * l1 * sine, stored]

    def _state(self, x) -> MembraneState:
        first = self.plate or POLE * self.radius
        done = self._integrated(x, t_eval=np.linspace(first, self.radius, 201))
        r, z, l1, _, volume, energy = done.y
        places, stretches = np.column_stack([r, z - z[-1]]), np.column_stack([l1, r / done.t])
        return MembraneState(x[1] * self._unit, -z[-1], volume[-1], float(x[0]), done.t, places, stretches, energy[-1])


def _folded(R, y, pressure):
    """Zero where the meridian is slack, or has turned further than any membrane's."""
    return min(y[2] - 0.2, 3.3 - abs(y[3]), y[0])


_folded.terminal = True


def limit(path: list[MembraneState]) -> tuple[float, float] | None:
    """Height in m and pressure in Pa of the first largest pressure on a path, of a parabola through three states."""
    pressures = [state.pressure for state in path]
    for k in range(1, len(path) - 1):
        if pressures[k] >= max(pressures[k - 1], pressures[k + 1]):
            heights = np.array([state.height for state in path[k - 1 : k + 2]])
            fit = np.polyfit(heights - heights[1], pressures[k - 1 : k + 2], 2)
            top = -fit[1] / (2 * fit[0])
            return heights[1] + top, float(np.polyval(fit, top))
    return None


if __name__ == "__main__":
    for membrane in (
        CircularMembrane(0.02, 1e-3, Yeoh(15e3)),
        CircularMembrane(0.02, 1e-3, Yeoh(15e3), plate=0.008, weight=0.2),
    ):
        print(membrane)
        for state in membrane.path(np.linspace(2e-3, 26e-3, 13)):
            print(
                f"height {state.height * 1e3:7.3f} mm  {state.pressure:9.2f} Pa  {state.volume * 1e6:8.3f} ml  "
                f"stretch {state.stretch:6.3f}  {state.energy * 1e3:8.4f} mJ"
            )
