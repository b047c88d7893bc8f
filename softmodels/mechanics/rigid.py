"""How rigid parts move: rotations, a part's few unknowns and the dofs that follow them, and the forces on it."""

from __future__ import annotations

import abc
import dataclasses

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from softmodels.common.arrays import Array
from softmodels.common.lazy import MPI, scipy
from softmodels.mechanics.component import Component

STILL = 1e-9
"""Motion of a held dof per motion of a part, in sizes of the device, up to which the part does not move it."""


# ----------------------------------------------------------------------------------------------------------------------
# Rotations by Cayley's parameters: rational in them, so that derivatives of any order are exact and short.
#
# A vector v represents the rotation about v by the angle 2 atan(|v|/2), which for small ones is |v|:
#
#     R(v) = 1 + (V + V V / 2) / D,    D = 1 + v.v / 4,    V x = v cross x
#
# Only a rotation by 180 degrees has none. (Bauchau & Trainelli 2003, The vectorial parameterization of rotation, doi
# 10.1023/A:1024265401576.)


def cross(v: Array) -> Array:
    """Return the matrix of v's cross product, shape (3, 3); of several, shape (..., 3, 3)."""
    v = np.asarray(v, dtype=float)
    zero = np.zeros(v.shape[:-1])
    rows = [[zero, -v[..., 2], v[..., 1]], [v[..., 2], zero, -v[..., 0]], [-v[..., 1], v[..., 0], zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


class Turn:
    """R(v), ``matrix`` of shape (3, 3), where v is a sum of amounts, shape (m,), of unit axes, shape (m, 3), and its
    derivatives by these amounts."""

    def __init__(self, amounts: Array, axes: Array):
        self._v, self._axes = amounts @ axes, axes
        self._V, self._A = cross(self._v), cross(axes)
        self._D = 1 + self._v @ self._v / 4
        self._N = self._V + self._V @ self._V / 2
        self._slopes_D = axes @ self._v / 2
        self._slopes_N = self._A + (self._A @ self._V + self._V @ self._A) / 2
        self.matrix = np.eye(3) + self._N / self._D

    def slopes(self) -> Array:
        """Return dR by each amount, shape (m, 3, 3)."""
        return self._slopes_N / self._D - self._N * (self._slopes_D / self._D**2)[:, None, None]

    def curvatures(self) -> Array:
        """Return the second derivatives of R, shape (m, m, 3, 3)."""
        A, N, D, first = self._A, self._N, self._D, self._slopes_D
        products = np.einsum("iab,jbc->ijac", A, A)
        second_N = (products + products.swapaxes(0, 1)) / 2
        second_D = self._axes @ self._axes.T / 2
        mixed = np.einsum("iab,j->ijab", self._slopes_N, first)
        mixed = mixed + mixed.swapaxes(0, 1)
        factor = 2 * np.outer(first, first) / D**3 - second_D / D**2
        return np.asarray(second_N / D - mixed / D**2 + np.einsum("ab,ij->ijab", N, factor))


def amounts(R: Array, axes: Array) -> Array:
    """Return the amounts of axes whose `Turn` a rotation is, shape (m,); the reverse of it."""
    skew = (R - R.T) / 2
    v = np.array([skew[2, 1], skew[0, 2], skew[1, 0]]) * 4 / (1 + np.trace(R))
    return np.asarray(axes @ v)


def nearest(moments: Array, axes: Array) -> Array:
    """Return the rotation, shape (3, 3), about no axis, one, or all three (unit vectors, shape (m, 3)) that takes arms r
    nearest to arms r', by the sum of r' r^T over points, shape (3, 3).

    Kabsch 1976, doi 10.1107/S0567739476001873; about one axis in closed form.
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
    """Return the axis times angle in rad (0 to pi) of a rotation, shape (3,)."""
    return np.asarray(scipy.spatial.transform.Rotation.from_matrix(R).as_rotvec())


# ----------------------------------------------------------------------------------------------------------------------
# Motion of a rigid part: its few unknowns, the dofs that follow them, and the resultants of forces on these.
#
# A point X of the part moves by u = t + (R - 1)(X - c), with its centre c, a translation t in its free directions, and a
# rotation R about its free axes. R = R(v) R0: only the rotation v from the current state is an unknown, so
# that large rotations meet no singularity.


Ints = npt.NDArray[np.int32]


@dataclasses.dataclass(frozen=True, eq=False)
class Freedom:
    """The free motions of a part about its centre c, shape (d,), in sizes of the device: orthonormal directions of
    translations, shape (k, d), and unit axes of rotations, shape (m, 3): none, one, or three."""

    centre: Array
    directions: Array
    axes: Array

    @property
    def count(self) -> int:
        return len(self.directions) + len(self.axes)


class RigidMotion:
    """The motion of one rigid part of a mesh, with w = B u by the body's skew B.

    Args:
        comm: Communicator.
        freedom: The motions left to it.
        skew: B.
        dofs: Local indices of the dofs that follow it, by node and component of w, shape (nodes, d), this rank's ghosts too.
        places: The nodes' undeformed places, shape (nodes, d).
        owned: Which of the nodes are this rank's own, shape (nodes,).

    Attributes:
        values: The unknowns: amounts of the directions and, from the base rotation on, of the axes.
    """

    def __init__(
        self, comm: MPI.Comm, freedom: Freedom, skew: Array, dofs: Ints, places: Array, owned: npt.NDArray[np.bool_]
    ):
        self.comm, self.freedom, self.skew, self.dofs, self.owned = comm, freedom, skew, dofs, owned
        self.places = places
        self._unskewed = np.linalg.inv(skew)
        self.arms = places - freedom.centre
        self.values = np.zeros(freedom.count)
        self._base = np.eye(3)
        self._turn = self._turned(self.values)
        self._steady = self._rates_of_directions()
        self._count = self.sum(float(np.count_nonzero(owned)))
        self._mean_arm = self.sum(self.arms[owned].sum(axis=0)) / self._count

    @property
    def turns(self) -> bool:
        return len(self.freedom.axes) > 0

    def sum[T: (float, Array)](self, value: T) -> T:
        """Over all ranks."""
        return value if self.comm.size == 1 else self.comm.allreduce(value)

    # -- the state ----------------------------------------------------------------------------------------------------

    def take(self, w: Array) -> None:
        """Set the motion nearest to that of local dofs; its rotation becomes the base."""
        if self.turns:
            self._base = self._fitted(w)
        self.set(self.at(w))

    def set(self, values: Array) -> None:
        """Set other values of the unknowns."""
        self.values = np.array(values)
        if self.turns:
            self._turn = self._turned(self.values)

    def at(self, w: Array) -> Array:
        """Return the unknowns' values of the motion nearest to that of local dofs, from the present base on."""
        mean = self.sum((w[self.dofs[self.owned]] @ self._unskewed.T).sum(axis=0)) / self._count
        if not self.turns:
            return self.freedom.directions @ mean
        R = self._fitted(w)
        moved = mean - (R - np.eye(3)) @ self._mean_arm
        return np.concatenate([self.freedom.directions @ moved, amounts(R @ self._base.T, self.freedom.axes)])

    def _fitted(self, w: Array) -> Array:
        """Return the rotation nearest to that of local dofs, shape (3, 3)."""
        arms = self.arms[self.owned]
        reached = arms + w[self.dofs[self.owned]] @ self._unskewed.T
        total = self.sum(np.concatenate([reached.sum(axis=0), (reached.T @ arms).ravel()]))
        moments = total[3:].reshape(3, 3) - np.outer(total[:3], self._mean_arm)
        return nearest(moments, self.freedom.axes)

    def _turned(self, values: Array) -> Turn:
        return Turn(values[len(self.freedom.directions) :], self.freedom.axes)

    @property
    def translation(self) -> Array:
        """Displacement of the centre, shape (d,)."""
        return self.values[: len(self.freedom.directions)] @ self.freedom.directions

    @property
    def rotation(self) -> Array:
        """Rotation R, shape (3, 3)."""
        return self._turn.matrix @ self._base

    def displacements(self) -> Array:
        """Return the values of w at the part's nodes, shape as ``dofs``."""
        u = np.broadcast_to(self.translation, self.arms.shape)
        if self.turns:
            u = u + self.arms @ (self.rotation - np.eye(3)).T
        return np.asarray(u @ self.skew.T)

    # -- linear -------------------------------------------------------------------------------------------------------

    def _rates_of_directions(self) -> Array:
        along = self.freedom.directions @ self.skew.T
        return np.broadcast_to(along.T, (len(self.dofs), *along.T.shape))

    def rates(self) -> Array:
        """Return the derivatives of w at the part's nodes by the unknowns, shape (nodes, d, count)."""
        if not self.turns:
            return self._steady
        slopes = self._turn.slopes() @ self._base
        turning = np.einsum("ab,mbc,nc->nam", self.skew, slopes, self.arms)
        return np.concatenate([self._steady, turning], axis=2)

    def nearest_rate(self, w: Array) -> Array:
        """Return the rate of the unknowns whose dofs are nearest to local dofs, shape (count,)."""
        rates = self.rates()[self.owned]
        square = self.sum(np.einsum("nam,nak->mk", rates, rates))
        return np.linalg.solve(square, self.work(w))

    def work(self, b: Array) -> Array:
        """Return the forces conjugate to the unknowns, of owned entries b conjugate to w: over all ranks, shape (count,)."""
        return self.sum(np.einsum("nam,na->m", self.rates()[self.owned], b[self.dofs[self.owned]]))

    def curvature(self, b: Array) -> Array:
        """Return the second derivatives by the unknowns of the work of entries b conjugate to w: over all ranks, shape (count,
        count)."""
        found = np.zeros((self.freedom.count, self.freedom.count))
        if self.turns:
            k = len(self.freedom.directions)
            moments = (b[self.dofs[self.owned]] @ self.skew).T @ self.arms[self.owned]
            found[k:, k:] = np.einsum("ijab,ab->ij", self._turn.curvatures() @ self._base, self.sum(moments))
        return found

    def wrench(self, b: Array) -> tuple[Array, Array]:
        """Force, shape (d,), and moment about the centre where it is now, shape (3,), of owned entries conjugate to w."""
        forces = b[self.dofs[self.owned]] @ self.skew
        if forces.shape[1] == 2:
            return self.sum(forces.sum(axis=0)), np.zeros(3)
        arms = self.arms[self.owned] @ self.rotation.T
        both = self.sum(np.concatenate([forces.sum(axis=0), np.cross(arms, forces).sum(axis=0)]))
        return both[:3], both[3:]


class RigidPart(Component):
    """A part that moves but keeps its shape; a kind is a dataclass of it with the fields below.

    Attributes:
        face: Role of the facets that it is bonded to; empty for a region.
        region: Physical group of cells that is rigid; empty for a face.
    """

    face: str
    region: str

    @abc.abstractmethod
    def freedom(self, actuator: Actuator, centre: Array) -> Freedom:
        """The motions left to it about the point that it turns about; `ComponentError` if the symmetry of the model leaves it
        none."""
