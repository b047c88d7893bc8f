"""Steps of one shape through light profiles, by weighted least squares on all profiles at once."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from measurement.edge.edge_shape import EdgeShape, gaussian
from measurement.robust import deviations

Array = npt.NDArray[np.float64]

ROUNDS, REWEIGHTED = 14, (5, 9)
"""Gauss-Newton steps, and those before which samples far off their curve are given less weight."""


@dataclasses.dataclass(frozen=True, eq=False)
class ProfileFit:
    """Curves low + (rise + slope u) S((u - centre) / width) over the offset u, one for each of n profiles of k samples.

    Attributes:
        low: Light in the shadow, shape (n,).
        rise: Light that the lit screen has more at u = 0, shape (n,).
        slope: How that grows with u, per px, shape (n,).
        centre: Middle of the edge in px, shape (n,).
        width: Standard deviation of penumbra and blur in px, shape (n,).
        z: Distance of the samples from the middle in widths, shape (n, k).
        top: Rise at each sample, shape (n, k).
        residual: What the curves leave of the profiles, shape (n, k).
        weight: Weights of the samples, shape (n, k).
        terms: Derivatives of the curves by the five parameters (the width's logarithm), times the weights, shape (n, k, 5).
        matrix: Normal matrices, shape (n, 5, 5).
    """

    low: Array
    rise: Array
    slope: Array
    centre: Array
    width: Array
    z: Array
    top: Array
    residual: Array
    weight: Array
    terms: Array
    matrix: Array

    @property
    def variance(self) -> Array:
        """Variance of each profile's samples about its curve, shape (n,)."""
        freedom = np.maximum(self.weight.sum(axis=1) - 5.0, 1.0)
        return (self.weight * self.residual**2).sum(axis=1) / freedom

    def centre_error(self, variance: Array) -> Array:
        """Standard errors (n,) of the middles in px for samples of these variances (n,)."""
        return np.sqrt(np.maximum(np.linalg.inv(self.matrix)[:, 3, 3], 0.0) * variance)

    def centre_shift(self, added: Array) -> Array:
        """How far in px light (n, k) that is added to the profiles moves their middles, to first order, shape (n,)."""
        pull = np.einsum("nki,nk->ni", self.terms, added)
        return np.linalg.solve(self.matrix, pull[..., None])[:, 3, 0]


def fit_profiles(offsets: Array, profile: Array, weight: Array, shape: EdgeShape | None = None) -> ProfileFit:
    """Fit a step to each profile, by Gauss-Newton steps.

    Args:
        offsets: Places of the samples in px, rising and symmetric about 0, shape (k,).
        profile: Light there, shape (n, k).
        weight: Weights of the samples, shape (n, k).
        shape: The step's shape; None for an error function.
    """
    shape = gaussian() if shape is None else shape
    u, reach = offsets[None, :], offsets[-1]
    parameters = _first_guess(offsets, profile)
    robust = np.ones_like(profile)
    for turn in range(ROUNDS):
        low, rise, slope, centre, width = parameters
        z = (u - centre[:, None]) / width[:, None]
        phi = shape(z)
        bell = shape.slope(z)
        top = rise[:, None] + slope[:, None] * u
        residual = profile - low[:, None] - top * phi
        terms = np.stack([np.ones_like(phi), phi, u * phi, -top * bell / width[:, None], -top * bell * z], axis=-1)
        if turn in REWEIGHTED:
            scatter = np.maximum(deviations(residual, 1), 1e-4)
            robust = np.minimum(1.0, 2.5 * scatter[:, None] / np.maximum(np.abs(residual), 1e-12))
        weighted = terms * (weight * robust)[..., None]
        matrix = np.einsum("nki,nkj->nij", weighted, terms)
        matrix = matrix + 1e-9 * np.trace(matrix, axis1=1, axis2=2)[:, None, None] * np.eye(5)
        step = np.linalg.solve(matrix, np.einsum("nki,nk->ni", weighted, residual)[..., None])[..., 0]
        parameters = _stepped(parameters, np.where(np.isfinite(step), step, 0.0), reach)
    low, rise, slope, centre, width = parameters
    return ProfileFit(low, rise, slope, centre, width, z, top, residual, weight * robust, weighted, matrix)


def _first_guess(offsets: Array, profile: Array) -> tuple[Array, ...]:
    """Low, rise, slope, centre and width (n,) each: the levels at both ends, and the step between them of the same area."""
    side, reach = len(offsets) // 5, offsets[-1]
    low, high = profile[:, :side].mean(axis=1), profile[:, -side:].mean(axis=1)
    above = (profile > 0.5 * (low + high)[:, None]).astype(float)
    centre = reach - above.sum(axis=1) * (offsets[1] - offsets[0])
    return low, high - low, np.zeros(len(profile)), centre, np.full(len(profile), 0.25 * reach)


def _stepped(parameters: tuple[Array, ...], step: Array, reach: float) -> tuple[Array, ...]:
    """The parameters after a step (n, 5), which is cut where it would leave the profile."""
    low, rise, slope, centre, width = parameters
    return (
        low + step[:, 0],
        rise + step[:, 1],
        slope + step[:, 2],
        np.clip(centre + np.clip(step[:, 3], -0.3 * reach, 0.3 * reach), -reach, reach),
        np.clip(width * np.exp(np.clip(step[:, 4], -0.5, 0.5)), 0.15, reach),
    )
