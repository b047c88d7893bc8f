"""How one rigid part moves: its few unknowns, the dofs that follow them, and what forces on these amount to.

A point X of the part moves by u = t + (R - 1)(X - c), with its centre c, a translation t in the directions that are left to it,
and a rotation R about the axes left to it. R = R(v) R0: only the turn v from a state at hand is an unknown, so that no
amount of turning meets a singular parameter.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.rotations import Turn, amounts, nearest

if TYPE_CHECKING:
    from mpi4py import MPI

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]


@dataclasses.dataclass(frozen=True, eq=False)
class Freedom:
    """The motions left to a part.

    Attributes:
        centre: The point c, shape (d,), in sizes of the device.
        directions: Orthonormal, of the translations, shape (k, d).
        axes: Unit vectors, of the rotations, shape (m, 3): none, one, or three.
    """

    centre: Array
    directions: Array
    axes: Array

    @property
    def count(self) -> int:
        return len(self.directions) + len(self.axes)


class RigidMotion:
    """The motion of one rigid part of a mesh.

    Args:
        comm: Communicator.
        freedom: The motions left to it.
        skew: B, as of the body: w = B u.
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
        """Take the motion nearest to that of local dofs; its rotation becomes the base."""
        if self.turns:
            self._base = self._fitted(w)
        self.set(self.at(w))

    def set(self, values: Array) -> None:
        """Take other values of the unknowns."""
        self.values = np.array(values)
        if self.turns:
            self._turn = self._turned(self.values)

    def at(self, w: Array) -> Array:
        """The unknowns' values of the motion nearest to that of local dofs, from the present base on."""
        mean = self.sum((w[self.dofs[self.owned]] @ self._unskewed.T).sum(axis=0)) / self._count
        if not self.turns:
            return self.freedom.directions @ mean
        R = self._fitted(w)
        moved = mean - (R - np.eye(3)) @ self._mean_arm
        return np.concatenate([self.freedom.directions @ moved, amounts(R @ self._base.T, self.freedom.axes)])

    def _fitted(self, w: Array) -> Array:
        """The rotation nearest to that of local dofs, shape (3, 3)."""
        arms = self.arms[self.owned]
        reached = arms + w[self.dofs[self.owned]] @ self._unskewed.T
        total = self.sum(np.concatenate([reached.sum(axis=0), (reached.T @ arms).ravel()]))
        moments = total[3:].reshape(3, 3) - np.outer(total[:3], self._mean_arm)
        return nearest(moments, self.freedom.axes)

    def _turned(self, values: Array) -> Turn:
        return Turn(values[len(self.freedom.directions) :], self.freedom.axes)

    @property
    def translation(self) -> Array:
        """Of the centre, shape (d,)."""
        return self.values[: len(self.freedom.directions)] @ self.freedom.directions

    @property
    def rotation(self) -> Array:
        """R, shape (3, 3)."""
        return self._turn.matrix @ self._base

    def displacements(self) -> Array:
        """Values of w at the part's nodes, shape as ``dofs``."""
        u = np.broadcast_to(self.translation, self.arms.shape)
        if self.turns:
            u = u + self.arms @ (self.rotation - np.eye(3)).T
        return np.asarray(u @ self.skew.T)

    # -- linear -------------------------------------------------------------------------------------------------------

    def _rates_of_directions(self) -> Array:
        along = self.freedom.directions @ self.skew.T
        return np.broadcast_to(along.T, (len(self.dofs), *along.T.shape))

    def rates(self) -> Array:
        """Derivatives of w at the part's nodes by the unknowns, shape (nodes, d, count)."""
        if not self.turns:
            return self._steady
        slopes = self._turn.slopes() @ self._base
        turning = np.einsum("ab,mbc,nc->nam", self.skew, slopes, self.arms)
        return np.concatenate([self._steady, turning], axis=2)

    def nearest_rate(self, w: Array) -> Array:
        """The rate of the unknowns whose dofs are nearest to local dofs, shape (count,)."""
        rates = self.rates()[self.owned]
        square = self.sum(np.einsum("nam,nak->mk", rates, rates))
        return np.linalg.solve(square, self.work(w))

    def work(self, b: Array) -> Array:
        """Forces conjugate to the unknowns, of owned entries b conjugate to w: over all ranks, shape (count,)."""
        return self.sum(np.einsum("nam,na->m", self.rates()[self.owned], b[self.dofs[self.owned]]))

    def curvature(self, b: Array) -> Array:
        """Second derivatives by the unknowns of what entries b conjugate to w do: over all ranks, shape (count, count)."""
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
