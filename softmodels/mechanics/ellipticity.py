"""Strong ellipticity: whether a reinforced silicone resists every change of shape by waves, however short.

Along a change m n^T of the deformation gradient, m any direction and n the wave's normal in the undeformed body, the energy has
the second derivative m . Q(n) m, Q being the acoustic tensor. Waves that keep the volume (m square to F^-T n) feel neither
the bulk modulus nor p, as J is linear along m n^T. Where one of these second derivatives is negative, a state is no minimum of
the energy in any neighbourhood (Hadamard): the body falls into bands as thin as anything lets them be, the cells of a mesh.
Compressed fibres do that, which then kink: Merodio & Ogden 2002, Material instabilities in fiber-reinforced nonlinearly
elastic solids under plane deformation, Arch. Mech. 54; El Hamdaoui, Merodio & Ogden 2018, J. Eng. Math. 109.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from softmodels.materials.material import Material
from softmodels.materials.strain import HomogeneousStrain

Array = npt.NDArray[np.float64]

NORMALS = 300
"""Of waves in the solid, evenly over the half sphere; the energy's second derivative is smooth in them."""
NORMALS_OF_SECTION = 36
"""The same in the plane of a section, whose waves stay in it."""
STEP = 1e-3
"""Of the second difference: its error is about the square, and rounding a part in 1e10."""


@dataclasses.dataclass(frozen=True, eq=False)
class Reinforced:
    """States of a silicone with fibres, at n points with k families.

    Attributes:
        gradients: Deformation gradients, shape (n, 3, 3).
        lines: Directions of the fibres, undeformed, unit vectors, shape (n, k, 3).
        stresses: Derivatives of the fibres' energy by their change of squared length, over a stress unit, shape (n, k).
        slopes: The same of these, shape (n, k).
    """

    gradients: Array
    lines: Array
    stresses: Array
    slopes: Array


def least_resistance(material: Material, unit: float, state: Reinforced, section: bool) -> Array:
    """The least second derivative of the energy along any wave that keeps the volume, with m and n of unit length.

    Args:
        material: The silicone's law; it may be a millionfold stiffer in bulk than in shear.
        unit: Pa in one stress.
        state: What it is in.
        section: Whether waves stay in an axisymmetric section, whose second direction is the hoop.

    Returns:
        Shape (n,): one shear modulus of the undeformed silicone, below 0 where ellipticity is lost.
    """
    least = np.full(len(state.gradients), math.inf)
    for normal in _normals(section):
        kept = np.linalg.solve(state.gradients.transpose(0, 2, 1), np.broadcast_to(normal, (len(least), 3))[..., None])[
            ..., 0
        ]
        kept /= np.linalg.norm(kept, axis=1)[:, None]
        if section:
            resistance = _along(material, unit, state, normal, np.cross(kept, (0.0, 1.0, 0.0)))
        else:
            resistance = _least_across(material, unit, state, normal, kept)
        least = np.fmin(least, resistance)
    return least


def _normals(section: bool) -> Array:
    if section:
        angle = np.linspace(0.0, math.pi, NORMALS_OF_SECTION, endpoint=False)
        return np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], axis=1)
    number = np.arange(NORMALS)
    height, turn = (number + 0.5) / NORMALS, number * math.pi * (1 + math.sqrt(5))
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1)


def _least_across(material: Material, unit: float, state: Reinforced, normal: Array, kept: Array) -> Array:
    """The least over all m square to ``kept``: the lower eigenvalue of the acoustic tensor in that plane."""
    other = np.where(np.abs(kept[:, :1]) < 0.7, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    first = np.cross(kept, other)
    first /= np.linalg.norm(first, axis=1)[:, None]
    second = np.cross(kept, first)
    a, b, both = (_along(material, unit, state, normal, m) for m in (first, second, first + second))
    mixed = (both - a - b) / 2
    lower: Array = (a + b) / 2 - np.hypot((a - b) / 2, mixed)
    return lower


def _along(material: Material, unit: float, state: Reinforced, normal: Array, m: Array) -> Array:
    """Second derivative of the energy along m normal^T; nan where the law has no energy (its chains are taut)."""
    F = state.gradients
    wave = STEP * m[:, :, None] * normal[None, None, :]
    with np.errstate(invalid="ignore", divide="ignore"):
        energies = [_energy(material, F + sign * wave) for sign in (-1, 0, 1)]
    silicone = (energies[0] - 2 * energies[1] + energies[2]) / STEP**2 / unit
    crossed = (state.lines @ normal) ** 2
    moved = np.einsum("pij,pkj->pki", F, state.lines)
    stretched = np.einsum("pki,pi->pk", moved, m) ** 2
    turned = (m**2).sum(axis=1)[:, None]
    fibres: Array = (crossed * (4 * state.slopes * stretched + 2 * state.stresses * turned)).sum(axis=1)
    return np.asarray(silicone) + fibres


def _energy(material: Material, F: Array) -> Array:
    a, b, c = np.linalg.svd(F, compute_uv=False).T
    return np.asarray(material.shape(HomogeneousStrain((a, b, c)), material))
