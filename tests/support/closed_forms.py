"""Exact relations that only tests need, besides those of `softmodels.materials.specimens`."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.materials.laws import Material
from softmodels.materials.specimens import _wall_pressure


def tube_pressure(material: Material, inner: float, outer: float, inner_stretch: npt.ArrayLike) -> Array:
    """Return the pressure in Pa inside a thick-walled incompressible tube that keeps its length, none outside.

    P = int W'(l) / (l^2 - 1) dl, W of planar tension (Ogden 1984, section 5.3.3 at axial stretch 1); see `sphere_pressure`,
    whose arguments it takes.
    """
    return _wall_pressure(material, inner, outer, inner_stretch, "planar", 2)


def work_of_stress(fields, state):
    """Return the work of a state's Cauchy stress on a small displacement, int P : dF dX with P = J sigma F^-T, over the change
    of the stored energy, minus 1."""
    eq, values = fields.system, fields.values(state)
    F, nominal = (
        values.F,
        np.linalg.det(values.F)[..., None, None] * values.cauchy @ np.swapaxes(np.linalg.inv(values.F), -1, -2),
    )
    nodes = fields.sampling.skew[: fields.grid.owned]
    change = np.zeros(len(state.w))
    change[nodes] = np.random.default_rng(3).normal(size=nodes.shape) * 1e-7
    energies, gradients = [], []
    for sign in (1.0, -1.0):
        eq.load(dataclasses.replace(state, w=state.w + sign * change))
        energies.append(eq.stored_energy())
        gradients.append(fields.sampling.gradients())
    eq.load(state)
    work = ((nominal * (gradients[0] - gradients[1])).sum(axis=(-1, -2)) * eq.point_volumes()).sum() / eq.stress_unit
    assert np.allclose(gradients[0] + gradients[1], 2 * F, atol=1e-12)
    return work / (energies[0] - energies[1]) - 1
