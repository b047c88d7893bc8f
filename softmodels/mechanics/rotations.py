"""Rotations by Cayley's parameters: rational in them, so that derivatives of any order are exact and short.

A vector v stands for the turn about v by the angle 2 atan(|v|/2), which for small ones is |v|:

    R(v) = 1 + (V + V V / 2) / D,    D = 1 + v.v / 4,    V x = v cross x

Only a half turn has none. (Bauchau & Trainelli 2003, The vectorial parameterization of rotation, doi 10.1023/A:1024265401576.)
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def cross(v: Array) -> Array:
    """The matrix of v's cross product, shape (3, 3); of several, shape (..., 3, 3)."""
    v = np.asarray(v, dtype=float)
    zero = np.zeros(v.shape[:-1])
    rows = [[zero, -v[..., 2], v[..., 1]], [v[..., 2], zero, -v[..., 0]], [-v[..., 1], v[..., 0], zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


class Turn:
    """R(v) where v is a sum of axes, and its derivatives by the amounts of these.

    Args:
        amounts: Of each axis, shape (m,).
        axes: Unit vectors, shape (m, 3).

    Attributes:
        matrix: R, shape (3, 3).
    """

    def __init__(self, amounts: Array, axes: Array):
        self._v, self._axes = amounts @ axes, axes
        self._V, self._A = cross(self._v), cross(axes)
        self._D = 1 + self._v @ self._v / 4
        self._N = self._V + self._V @ self._V / 2
        self._slopes_D = axes @ self._v / 2
        self._slopes_N = self._A + (self._A @ self._V + self._V @ self._A) / 2
        self.matrix = np.eye(3) + self._N / self._D

    def slopes(self) -> Array:
        """dR by each amount, shape (m, 3, 3)."""
        return self._slopes_N / self._D - self._N * (self._slopes_D / self._D**2)[:, None, None]

    def curvatures(self) -> Array:
        """Second derivatives of R, shape (m, m, 3, 3)."""
        A, N, D, first = self._A, self._N, self._D, self._slopes_D
        products = np.einsum("iab,jbc->ijac", A, A)
        second_N = (products + products.swapaxes(0, 1)) / 2
        second_D = self._axes @ self._axes.T / 2
        mixed = np.einsum("iab,j->ijab", self._slopes_N, first)
        mixed = mixed + mixed.swapaxes(0, 1)
        factor = 2 * np.outer(first, first) / D**3 - second_D / D**2
        return np.asarray(second_N / D - mixed / D**2 + np.einsum("ab,ij->ijab", N, factor))


def amounts(R: Array, axes: Array) -> Array:
    """The amounts of axes whose `Turn` a rotation is, shape (m,); the reverse of it."""
    skew = (R - R.T) / 2
    v = np.array([skew[2, 1], skew[0, 2], skew[1, 0]]) * 4 / (1 + np.trace(R))
    return np.asarray(axes @ v)


def nearest(moments: Array, axes: Array) -> Array:
    """The rotation about the given axes that takes arms r nearest to arms r'.

    Args:
        moments: Sum of r' r^T over points, shape (3, 3).
        axes: Unit vectors, shape (m, 3): none, one, or three.

    Returns:
        Shape (3, 3). Kabsch 1976, doi 10.1107/S0567739476001873; about one axis in closed form.
    """
    if len(axes) == 0:
        return np.eye(3)
    if len(axes) == 1:
        a = axes[0]
        flat = np.eye(3) - np.outer(a, a)
        # Sums of r.r' and of a.(r cross r') square to the axis.
        angle = np.arctan2(np.sum(cross(a) * moments), np.sum(flat * moments))
        return np.asarray(np.eye(3) + np.sin(angle) * cross(a) + (1 - np.cos(angle)) * cross(a) @ cross(a))
    left, _, right = np.linalg.svd(moments)
    proper = np.diag([1.0, 1.0, np.linalg.det(left @ right)])
    return np.asarray(left @ proper @ right)


def rotation_vector(R: Array) -> Array:
    """Axis times angle in rad (0 to pi) of a rotation, shape (3,)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(R).as_rotvec())
