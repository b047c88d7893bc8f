"""Stresses and stretches of deformation gradients.

Stresses of an isotropic law need only the principal stretches and the law's own energy in numpy, differentiated by a
complex step (exact to rounding); nothing is written twice.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from softmodels.materials.laws import Material
from softmodels.materials.strain import HomogeneousStrain


def principal_stretches(F: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Principal stretches of deformation gradients, shape (..., 3, 3) to (..., 3), rising."""
    return np.sqrt(np.maximum(np.linalg.eigvalsh(np.swapaxes(F, -1, -2) @ F), 0.0))


def shape_stresses(material: Material, stretches: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Principal Cauchy stresses in Pa of the law's shape part, lambda_i dW/dlambda_i / J; shapes (..., 3)."""
    h = 1e-30
    J = stretches.prod(axis=-1)
    result = np.empty_like(stretches)
    for i in range(3):
        moved = [stretches[..., k] + (1j * h if k == i else 0.0) for k in range(3)]
        slope = np.imag(material.shape(HomogeneousStrain((moved[0], moved[1], moved[2])), material)) / h
        result[..., i] = stretches[..., i] * slope / J
    return result


def von_mises(stresses: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Von Mises stress of principal stresses, shape (..., 3); a hydrostatic part changes nothing."""
    a, b, c = np.moveaxis(stresses, -1, 0)
    return np.sqrt(((a - b) ** 2 + (b - c) ** 2 + (c - a) ** 2) / 2)
