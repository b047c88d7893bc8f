"""Compare branches and softening with FElupe's at a material point, on one homogeneous history; nothing is solved.

    uv run --with felupe --with tensortrax python tests/benchmarks/memory_peers.py

FElupe steps a branch by implicit Euler, which is H = Cv and b = dt/tau here: the internal variable is the same to rounding.
Its stress is the derivative of the stored energy through the update of the internal variable, which counts in the step what
the dashpot has taken; that of a potential for the step is G/2 Cv^-1. Both agree as the step goes to 0.
"""

from __future__ import annotations

import felupe as fem  # type: ignore[import-untyped]
import numpy as np
from felupe.constitution.tensortrax import Hyperelastic  # type: ignore[import-untyped]
from felupe.constitution.tensortrax.models.hyperelastic import finite_strain_viscoelastic  # type: ignore[import-untyped]

from softmodels.materials import memory
from softmodels.materials.memory import InNumpy, Softening

G, TAU, SOFT = 1.0, 2.0, Softening(1.6, 0.4, 0.1)


def stretched(t: float) -> np.ndarray:
    """A deformation gradient: shear and tension up and down, with a change of volume."""
    a, b = 1.0 + 0.8 * np.sin(0.9 * t) ** 2, 0.5 * np.sin(0.6 * t)
    return np.array([[a, b, 0.0], [0.0, 1.1 / a**0.5, 0.1 * b], [0.0, 0.0, 1.0 / a**0.5]])


def branch(count: int) -> tuple[float, float]:
    """Largest differences of Cv and stress over a history of 6 s in so many steps."""
    dt, theirs, ours = 6.0 / count, np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0]), list(memory.IDENTITY)
    off = np.zeros(2)
    for k in range(1, count + 1):
        F = stretched(k * dt)
        law = Hyperelastic(finite_strain_viscoelastic, mu=G, eta=G * TAU, dtime=dt, nstatevars=6)
        x = [F[:, :, None, None], theirs[:, None, None]]
        P, after = law.gradient(x)
        theirs = after[:, 0, 0]
        J, C = np.linalg.det(F), F.T @ F
        Cbar = [J ** (-2 / 3) * C[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        ours = memory.crept(Cbar, ours, dt / TAU)
        inverse = np.linalg.inv([[ours[0], ours[3], ours[4]], [ours[3], ours[1], ours[5]], [ours[4], ours[5], ours[2]]])
        S = G * J ** (-2 / 3) * (inverse - np.sum(inverse * C) / 3 * np.linalg.inv(C))
        mine = np.array([ours[0], ours[3], ours[4], ours[1], ours[5], ours[2]])
        off = np.maximum(off, [np.abs(mine - theirs).max(), np.abs(F @ S - P[:, :, 0, 0]).max()])
    return off[0], off[1]


def _slope(W: float, Wm: float) -> float:
    """The share of the stress that softening leaves: derivative of the softened energy, to about h^4."""
    h = min(1e-4, (Wm - W) / 3)
    psi = [float(memory.softened(W + k * h, Wm, SOFT, InNumpy)) for k in (-2, -1, 1, 2)]
    return (psi[0] - 8 * psi[1] + 8 * psi[2] - psi[3]) / (12 * h)


def softening() -> float:
    """Largest difference of the stress of a neo-Hookean silicone that softens."""
    law = fem.OgdenRoxburgh(fem.NeoHooke(mu=G), r=SOFT.r, m=SOFT.m, beta=SOFT.beta)
    state, Wm, off = np.zeros((1, 1, 1)), 0.0, 0.0
    for t in np.linspace(0.0, 6.0, 121)[1:]:
        F = stretched(t)
        P, state = law.gradient([F[:, :, None, None], state])
        J = np.linalg.det(F)
        W = G / 2 * (J ** (-2 / 3) * np.sum(F * F) - 3)
        share = _slope(W, Wm) if Wm > W else 1.0
        Wm = max(W, Wm)
        mine = share * G * J ** (-2 / 3) * (F - np.sum(F * F) / 3 * np.linalg.inv(F).T)
        off = max(off, float(np.abs(mine - P[:, :, 0, 0]).max()))
    return off


if __name__ == "__main__":
    for count in (50, 100, 200, 400):
        Cv, stress = branch(count)
        print(f"{count} steps: Cv {Cv:.1e}, stress {stress:.1e} of G")
    print(f"softening: stress {softening():.1e} of G")
