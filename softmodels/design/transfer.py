"""States carried from one mesh of a device to another one: interpolated on rank 0, as guesses for Newton's method."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.design.mesh_places import Places
from softmodels.mechanics.mpi import on_root
from softmodels.results.grid import Grid, displacement_maps

if TYPE_CHECKING:
    from softmodels.design.designed_body import DesignedBody

Array = npt.NDArray[np.float64]


class Transfer:
    """Interpolates unknowns between two meshes that show the same device.

    Args:
        old: Where unknowns are known.
        new: Where they are wanted.

    Attributes:
        rest: Dimensionless volume of the undeformed cavity on the new mesh.
    """

    def __init__(self, old: DesignedBody, new: DesignedBody):
        from dolfinx import fem

        self.old, self.new = old.system, new.system
        self.rest = new.volume_at_rest()
        self._scale = self.old.length_unit / self.new.length_unit  # displacements are counted in it, pressures are not
        self._from, self._to = Grid(self.old), Grid(self.new)
        self._known, self._wanted = (
            displacement_maps(*pair) for pair in ((self.old, self._from), (self.new, self._to))
        )
        self._w = fem.Function(self.new.space)
        self._places: list[Places] = []  # on rank 0
        on_root(self.new.comm, self._locate)

    def _locate(self) -> None:
        dimension = self._from.dimension
        kept = [0, 2] if dimension == 2 else [0, 1, 2]
        self._places.append(Places(self._from.points[:, kept], self._from.cells, self._to.points[:, kept]))

    def dofs(self, w: Array) -> Array:
        """Unknowns on the new mesh, with ghosts, of those on the old one; behind both come multipliers (`State.w`)."""
        x = self._w.x
        x.array[:] = 0.0
        columns, own = self._known[0][: self._from.owned], self._wanted[0][: self._to.owned]
        x.array[own] = self._scale * self._carried(w[columns], linear=False)
        known, wanted = self._known[1], self._wanted[1]
        if known is not None and wanted is not None:
            known, wanted = known[: self._from.owned], wanted[: self._to.owned]
            at_vertices = self._carried(np.where(known >= 0, w[known], 0.0), linear=True)
            x.array[wanted[wanted >= 0]] = at_vertices[wanted >= 0]
        x.scatter_forward()
        return np.concatenate([x.array, w[self.old.dofs :]])

    def _carried(self, values: Array, linear: bool) -> Array:
        """Values of owned nodes of the new mesh of those of the old one, shapes (owned, k)."""
        everywhere = self._from.collect(values)
        found = None if everywhere is None else self._places[0].interpolated(everywhere, linear)
        return self._to.distribute(found)

    def volume(self, V: float, rest: float) -> float:
        """A dimensionless volume on the new mesh, of one on the old mesh whose volume at rest is ``rest``."""
        return self.rest + (V - rest) * self._scale**3
