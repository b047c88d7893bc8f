"""Rigid parts bonded to a device: plates and rings that move but keep their shape.

The constraint is exact: the dofs on a part follow its own few unknowns (`mechanics.unknowns`), and nothing is penalised. Which
motions there are is a matter of the device's symmetry: six in a whole solid, three in a half, the axial translation in a wedge
or an axisymmetric section.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from softmodels.common.arrays import Array
from softmodels.common.schema import (
    Choice,
    Quantity,
    Several,
    Words,
    field_of,
)
from softmodels.mechanics.body import in_section, in_space
from softmodels.mechanics.component import (
    INSIDE,
    ComponentError,
    check_regions,
    register_component,
)
from softmodels.mechanics.dead_loads import (
    DistributedLoad,
    HeavyPart,
    Weighed,
    check_finite,
)

if TYPE_CHECKING:
    from mpi4py import MPI


# ----------------------------------------------------------------------------------------------------------------------
# Rotations by Cayley's parameters: rational in them, so that derivatives of any order are exact and short.
#
# A vector v stands for the turn about v by the angle 2 atan(|v|/2), which for small ones is |v|:
#
#     R(v) = 1 + (V + V V / 2) / D,    D = 1 + v.v / 4,    V x = v cross x
#
# Only a half turn has none. (Bauchau & Trainelli 2003, The vectorial parameterization of rotation, doi
# 10.1023/A:1024265401576.)


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


# ----------------------------------------------------------------------------------------------------------------------
# How one rigid part moves: its few unknowns, the dofs that follow them, and what forces on these amount to.
#
# A point X of the part moves by u = t + (R - 1)(X - c), with its centre c, a translation t in the directions that are left to
# it, and a rotation R about the axes left to it. R = R(v) R0: only the turn v from a state at hand is an unknown, so that no
# amount of turning meets a singular parameter.


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


KINDS = ("free", "guided", "held")
STILL = 1e-9
"""Motion of a held dof per motion of a part, in sizes of the device, up to which the part does not move it."""


@register_component
@dataclasses.dataclass(frozen=True)
class Rigid(HeavyPart):
    """A rigid part bonded to a face, or a region that is rigid.

    Attributes:
        face: Role of the facets that it is bonded to, such as ``"top"``; empty for a region.
        region: Physical group of cells that is rigid; empty for a face.
        kind: ``"free"`` in all motions that the device's symmetry allows, ``"guided"`` along a direction, or ``"held"``.
        direction: That direction in device coordinates; the device's lift if empty.
        mass: Of the part, of the whole device; it weighs where the case has gravity, in the middle of the undeformed face.
    """

    face: str = field_of(Words(), "face of the device that the rigid part is bonded to, such as top", "")
    kind: str = field_of(Choice(KINDS), "whether it is free, guided along a direction, or held", "free")
    direction: tuple[float, ...] = field_of(
        Several(Quantity()), "direction along which it is guided, such as [0, 0, 1]; the device's lift if left out", ()
    )

    mass: float = field_of(Quantity("kg"), "mass of the rigid part, which gravity pulls at", 0.0)
    region: str = field_of(Words(), "region of the device that is rigid, in place of a face", "")

    table: ClassVar[str] = "rigid"
    needs: ClassVar[str] = (
        "a rigid part needs the face it is bonded to, such as face = 'top' in [rigid.plate], or a region"
    )

    figure_texts: ClassVar[Mapping[str, tuple[str, str]]] = {
        r"(\w+)_turn_([xyz])_deg": (
            "turn of {0} about {1}",
            "rotation of that rigid part: component of axis times angle",
        ),
        r"(\w+)_force_N": (
            "force on {0}",
            "with which the device, its weight included, and its air push on that rigid part, along its guide or the device's "
            "lift; at rest it is what holds the part, or its own weight and the forces on its face",
        ),
        r"(\w+)_force_([xyz])_N": ("force on {0} along {1}", "the same along that direction"),
        r"(\w+)_moment_([xyz])_Nmm": (
            "moment on {0} about {1}",
            "with which the device and its air turn it about its centre",
        ),
    }

    def check(self) -> None:
        if bool(self.face) == bool(self.region):
            raise ComponentError(f"{self.where}: {self.needs}, and not both")
        if self.region and self.mass:
            raise ComponentError(f"{self.where}: a region weighs what its density says; leave its mass out")
        if self.direction and self.kind != "guided":
            raise ComponentError(f"{self.where}: a direction belongs to a guided part, and this one is {self.kind}")
        if self.direction and (len(self.direction) != 3 or not np.linalg.norm(self.direction) > 0):
            raise ComponentError(
                f"{self.where}: direction is {list(self.direction)}; it has three numbers, such as [0, 0, 1]"
            )

        if self.mass:
            check_finite(self.mass, self.where, "mass")

    @property
    def weighs(self) -> float:
        return self.mass

    def masses(self, on: DistributedLoad, along: Array) -> list[Weighed]:
        return [Weighed([on.mean(along, self.face)], self.mass)] if self.mass else []

    def check_on(self, actuator: Actuator) -> None:
        if self.region:
            check_regions(self.where, actuator, [self.region])
        elif self.face not in actuator.faces:
            raise ComponentError(
                f"{self.where}: {type(actuator).__name__} has no face {self.face!r} that a rigid part can be bonded to; it has "
                f"{', '.join(actuator.faces) or 'none'}"
            )
        if any(hold.role == self.face for hold in actuator.holds) and self.kind != "held":
            raise ComponentError(
                f"{self.where}: the face {self.face!r} is the device's support, which is held, so a rigid part on it cannot "
                "move; use another face, or kind = 'held'"
            )
        self.freedom(actuator, np.zeros(actuator.dimension))

    def undesigned(self, actuator: Actuator) -> str:
        if self.region:
            return INSIDE
        turns = len(self.freedom(actuator, np.zeros(actuator.dimension)).axes) > 0
        return "which can turn about a point that its design moves; guide it (kind = 'guided')" if turns else ""

    def freedom(self, actuator: Actuator, centre: Array) -> Freedom:
        """The motions left to it.

        Args:
            actuator: The device.
            centre: The point that it turns about.

        Raises:
            ComponentError: The symmetry forbids what it is guided along, or leaves no motion.
        """
        d = actuator.dimension
        if self.kind == "held":
            return Freedom(centre, np.empty((0, d)), np.empty((0, 3)))
        directions, axes = symmetric_motions(actuator)
        if self.kind == "guided":
            wanted = np.asarray(self.direction or actuator.lift, dtype=float)
            wanted /= np.linalg.norm(wanted)
            inside = in_section(wanted, d)
            if (
                np.linalg.norm(inside @ directions.T @ directions - inside) > STILL
                or np.linalg.norm(inside) < 1 - STILL
            ):
                raise ComponentError(
                    f"{self.where}: guided along {_shown(wanted)} it would leave the symmetry of the device's model, which "
                    f"allows {_allowed(directions)}; use another direction, or {actuator.fuller}"
                )
            return Freedom(centre, inside[None, :], np.empty((0, 3)))
        if not len(directions) + len(axes):
            raise ComponentError(
                f"{self.where}: the symmetry of the device's model leaves a rigid part no motion; use {actuator.fuller}, or "
                "kind = 'held'"
            )
        return Freedom(centre, directions, axes)


def symmetric_motions(actuator: Actuator) -> tuple[Array, Array]:
    """Rigid motions that keep the device's cut planes where they are.

    Returns:
        Orthonormal directions of translations in the mesh's coordinates, shape (k, d), and axes of rotations, shape (m, 3).
    """
    d = actuator.dimension
    normals = [in_section(plane.normal, d) for plane in actuator.cut_planes]
    if d == 2:
        normals.append(np.array([1.0, 0.0]))  # off the axis
    directions: list[Array] = []
    for axis in np.eye(d)[::-1]:
        left = axis.copy()
        for _ in range(3):  # oblique normals are not square to each other: once is not enough
            for known in (*_basis(normals), *directions):
                left -= (left @ known) * known
        if np.linalg.norm(left) > 1e-6:
            directions.append(left / np.linalg.norm(left))
    directions.reverse()
    planes = _basis(normals)
    axes = np.empty((0, 3)) if d == 2 or len(planes) > 1 else np.array(planes) if planes else np.eye(3)
    return np.array(directions).reshape(-1, d), axes


def _basis(vectors: Sequence[Array]) -> list[Array]:
    """Orthonormal vectors that span the same."""
    found: list[Array] = []
    for vector in vectors:
        left = np.array(vector, dtype=float)
        for known in found:
            left -= (left @ known) * known
        if np.linalg.norm(left) > 1e-6 * np.linalg.norm(vector):
            found.append(left / np.linalg.norm(left))
    return found


def _shown(direction: Array) -> str:
    return "(" + ", ".join(f"{x:.3g}" for x in direction) + ")"


def _allowed(directions: Array) -> str:
    if not len(directions):
        return "no translation"
    return "translations along " + " and ".join(_shown(v) for v in in_space(directions))
