"""The outline of a device whose mesh follows its design: its nodes are those of the mesh, wherever it has moved to."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.fitting.outlines.silhouette import Silhouette, edge_nodes, outer_edges
from softmodels.mechanics.mpi import everywhere, is_root, scattered

if TYPE_CHECKING:
    from softmodels.design.designed_body import DesignedBody

Array = npt.NDArray[np.float64]

STRAIGHT = np.array([[1.0, 0.0], [0.0, 1.0], [0.5, 0.5]])
"""An edge's two ends and middle from its two nodes, where the mesh has straight edges."""


class MovedSilhouette(Silhouette):
    """The outer curve of a device that is being designed, see `Silhouette`: heights count from its own undeformed apex.

    Of a half slab it is the edge of its top in the mirror plane, from the clamped base to the tip.

    Args:
        design: The device, its mesh as it was made.

    Raises:
        BodyError: The mesh has no such curve.

    Attributes:
        round: Whether the device is a body of revolution, of which both sides are seen alike.
    """

    def __init__(self, design: DesignedBody):
        super().__init__(design.system)
        self.design, actuator = design, design.system.body.actuator
        self.round = actuator.dimension == 2 or len(actuator.cut_planes) > 1
        self._blocks = edge_nodes(self.system, design.motion.space, outer_edges(self.system.body))
        self._mix = np.eye(3) if self._blocks.shape[1] == 3 else STRAIGHT
        axes = np.array([self._along, actuator.lift])
        self._axes = axes if actuator.dimension == 3 else axes[:, [0, 2]]
        """From the mesh's components to those of the outline's plane, shape (2, d)."""

    def follow(self) -> None:
        """Take the nodes from where the mesh is now."""
        self.points = self._on_chain(self.design.motion.now(self._blocks))
        self.top = self.points[0, 0]

    def _on_chain(self, x: Array) -> Array:
        """Dimensionless vectors of the mesh at the edges' own nodes, (m, 2 or 3, d), as device vectors of the chain, in m."""
        local = np.einsum("sk,mkd->msd", self._mix, x) * self.system.length_unit
        if local.shape[-1] == 2:
            local = np.stack([local[..., 0], np.zeros(local.shape[:-1]), local[..., 1]], axis=-1)
        return self._arranged(everywhere(self.system.comm, local))

    def moved(self, w: Array, X: Array) -> Array:
        """Derivative of the curve's nodes in m, shape (n, 3, 2).

        Args:
            w: Derivative of the state's dof values, with ghosts.
            X: That of the mesh's dimensionless nodes, shape (nodes of `MeshMotion.space`, d), with ghosts.
        """
        rest = self._on_chain(X[self._blocks])
        return self._in_plane(self._displacement(w) + rest - rest[0, 0])

    def transposed(self, covector: Array) -> tuple[Array, Array]:
        """The transpose of `moved`: from a covector on the curve's nodes, shape (n, 3, 2), the same on all ranks.

        Returns:
            By the owned unknowns, zero at held ones, and by the mesh's nodes, flat over `MeshMotion.space`.
        """
        system, motion = self.system, self.design.motion
        on_places = covector.copy()
        on_places[0, 0] -= covector.sum(axis=(0, 1))  # heights and distances count from the undeformed top
        axes = system.length_unit * self._axes
        by_w = _added(system.space, self._dofs, self._of_edges(covector) @ axes @ system.body.skew_inverse)
        at_nodes = np.einsum("sk,msd->mkd", self._mix, self._of_edges(on_places) @ axes)
        components = motion.dimension * self._blocks[..., None] + np.arange(motion.dimension)
        return system.by_unknowns(by_w[: system.n]).copy(), _added(motion.space, components, at_nodes)

    def _of_edges(self, values: Array) -> Array:
        """The transpose of gathering and arranging: values on the chain to this rank's edges, (m, 3, 2)."""
        back = values.copy()
        back[self._turned] = back[self._turned][:, [1, 0, 2]]
        comm, count = self.system.comm, len(self._dofs)
        found = np.zeros((len(everywhere(comm, np.zeros(count))), 3, 2))
        found[self._order] = back
        return scattered(comm, found if is_root(comm) else None, count)


def _added(space: object, dofs: npt.NDArray[np.integer], values: Array) -> Array:
    """Values added up at dofs, shape (local dofs,), complete on their owners."""
    from dolfinx import fem, la

    b = fem.Function(space).x
    np.add.at(b.array, dofs, values)
    b.scatter_reverse(la.InsertMode.add)
    return np.array(b.array)
