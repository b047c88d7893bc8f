"""Buckling of incompressible thick tubes by the exact small motions on a large one: an oracle without a mesh.

A tube keeps its length and is deformed to r^2 = R^2 + a^2 - A^2. On it a small motion grows that varies as cos(k z) along
the tube, or as cos(n theta) around it. The second variation of the energy less the pressure's work (Haughton & Ogden 1979,
doi 10.1016/0022-5096(79)90001-2; Ogden 1984, section 6.1) is a quadratic form of one function U(r), since div u = 0 gives
the other component; on polynomials in r it is a small matrix, and the tube buckles where its lowest eigenvalue is zero.
Nothing here is shared with the library but the law's energy.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import brentq

from softmodels.materials.laws import HomogeneousStrain

ORDER, POINTS = 10, 40


def derivatives(material, stretches):
    """First and second derivatives of W to the stretches in order (r, theta, z), by complex and central differences."""
    h, first, second = 1e-4, np.empty(3), np.empty((3, 3))

    def slope(values, i):
        moved = [value + (1e-30j if k == i else 0.0) for k, value in enumerate(values)]
        return np.imag(material.shape(HomogeneousStrain(tuple(moved)), material)) / 1e-30

    for i in range(3):
        first[i] = slope(stretches, i)
        for j in range(3):
            up, down = ([x + s * h * (k == j) for k, x in enumerate(stretches)] for s in (1, -1))
            second[i, j] = (slope(up, i) - slope(down, i)) / (2 * h)
    return first, second


class InflatedTube:
    """A tube with undeformed radii A < B, deformed inner radius a, pressure inside (or outside, if ``outside``)."""

    def __init__(self, material, A, B, a, outside=False):
        self.a, self.b, self.outside = a, np.sqrt(B**2 + a**2 - A**2), outside
        x, weights = np.polynomial.legendre.leggauss(POINTS)
        self.r = (self.a + self.b) / 2 + x * (self.b - self.a) / 2
        self.weights = weights * (self.b - self.a) / 2
        R = np.sqrt(self.r**2 - a**2 + A**2)
        self.stretches = np.column_stack([R / self.r, self.r / R, np.ones_like(R)])
        self.W1, self.W2 = zip(*(derivatives(material, s) for s in self.stretches), strict=True)
        W1 = np.array(self.W1)
        growth = (self.stretches[:, 1] * W1[:, 1] - self.stretches[:, 0] * W1[:, 0]) / self.r
        rise = np.polynomial.Legendre.fit(self.r, growth, 20).integ(lbnd=self.a)
        total = rise(self.b)
        self.pressure = -total if outside else total
        radial = rise(self.r) - (0.0 if outside else total)  # no stress on the other face
        self.p = radial - self.stretches[:, 0] * W1[:, 0]

    def lowest(self, along=None, around=None):
        """Lowest eigenvalue of the second variation for a wave number along the tube or a number of waves around it."""
        basis = [np.polynomial.Legendre.basis(i, [self.a, self.b]) for i in range(ORDER)]
        U, dU, ddU = (np.array([f.deriv(d)(self.r) if d else f(self.r) for f in basis]) for d in (0, 1, 2))
        r, zero = self.r, np.zeros_like(U)
        eta = {(i, j): zero for i in range(3) for j in range(3)}
        face = self.b if self.outside else self.a
        at, slope = (np.array([g(face) for g in (basis if not d else [f.deriv() for f in basis])]) for d in (0, 1))
        if along is not None:
            k = along
            W, dW = -(dU + U / r) / k, -(ddU + dU / r - U / r**2) / k
            eta |= {(0, 0): dU, (1, 1): U / r, (2, 2): k * W, (0, 2): -k * U, (2, 0): dW}
            other = -(slope + at / face) / k
            load = _square(at, at) + face * k * (_square(at, other) + _square(other, at))
        else:
            n = around
            V, dV = -(r * dU + U) / n, -(r * ddU + 2 * dU) / n
            eta |= {(0, 0): dU, (1, 1): (U + n * V) / r, (0, 1): -(n * U + V) / r, (1, 0): dV}
            other = -(face * slope + at) / n
            load = _square(at, at) + n * (_square(at, other) + _square(other, at)) + _square(other, other)
        form = self._form(eta) - (-1.0 if self.outside else 1.0) * self.pressure * load
        mass = (U * self.weights * r) @ U.T
        return eigh(form, mass, eigvals_only=True)[0]

    def _form(self, eta):
        form = 0.0
        for i in range(3):
            for j in range(3):
                L, W = self.stretches, np.array(self.W1)
                p = self.p
                if i == j:
                    for m in range(3):
                        form = form + self._product(L[:, i] * L[:, m] * np.array([s[i, m] for s in self.W2]),
                                                    eta[i, i], eta[m, m])  # fmt: skip
                    form = form - self._product(p, eta[i, i], eta[i, i])
                    continue
                close = np.abs(L[:, i] - L[:, j]) < 1e-9
                gap = np.where(close, 1.0, L[:, i] ** 2 - L[:, j] ** 2)
                shear = (L[:, i] * W[:, i] - L[:, j] * W[:, j]) * L[:, i] ** 2 / gap
                form = form + self._product(shear, eta[j, i], eta[j, i])
                form = form + self._product(shear - L[:, i] * W[:, i] - p, eta[i, j], eta[j, i])
        return form

    def _product(self, weight, f, g):
        return (f * (weight * self.weights * self.r)) @ g.T


def _square(a, b):
    return np.outer(a, b)


def critical_pressure(material, A, B, low, high, outside=False, **wave):
    """Pressure and deformed inner radius between the radii ``low`` and ``high`` at which the tube buckles."""
    a = brentq(lambda a: InflatedTube(material, A, B, a, outside).lowest(**wave), low, high, xtol=1e-12 * A)
    return InflatedTube(material, A, B, a, outside).pressure, a
