"""A geometrically exact beam under its weight and a force on its tip."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_bvp

from geometries import Beam
from softmodels.materials.laws import NeoHookean

BEAM = Beam(length=0.060, width=0.006, thickness=0.003, cell_size=0.003, clamp="slip")
STIFF = NeoHookean(60e3, 0.49)


def elastica(weight, force):
    """Place (x, z) of the tip of a geometrically exact beam, clamped level, under dead loads along -z.

    Reissner's beam with the stretch of its axis and shear: its sections' forces are those of what lies beyond them.
    """
    young, area = 2 * STIFF.shear_modulus_0 * (1 + STIFF.poisson), BEAM.width * BEAM.thickness
    inertia, sheared = area * BEAM.thickness**2 / 12, 5 / 6 * STIFF.shear_modulus_0 * area

    def bent(share):
        def rates(s, y):
            hangs = -share * (force + weight * (1 - s / BEAM.length))
            stretched, slid = hangs * np.sin(y[2]) / (young * area), hangs * np.cos(y[2]) / sheared
            dx = (1 + stretched) * np.cos(y[2]) - slid * np.sin(y[2])
            dz = (1 + stretched) * np.sin(y[2]) + slid * np.cos(y[2])
            return np.vstack([dx, dz, y[3] / (young * inertia), -hangs * dx])

        return rates

    places = np.linspace(0.0, BEAM.length, 61)
    found = np.vstack([places, np.zeros((3, 61))])
    for share in (0.1, 0.3, 0.6, 1.0):
        solution = solve_bvp(
            bent(share), lambda a, b: np.array([a[0], a[1], a[2], b[3]]), places, found, tol=1e-8, max_nodes=20000
        )
        assert solution.success
        places, found = solution.x, solution.y
    return found[:2, -1]
