"""States carried from one mesh of a device to another one: interpolated, as guesses for Newton's method."""

from __future__ import annotations

from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from dolfinx import fem

    from softmodels.design.designed_body import DesignedBody
    from softmodels.mechanics.system import System

Array = npt.NDArray[np.float64]

PADDING = 0.02
"""Of the cells' boxes, in sizes of the device: two meshes of a curved wall leave slivers between them."""


class Transfer:
    """Interpolates unknowns between two meshes that show the same device; to be used in a `with` statement.

    Inside it the old mesh has the new one's unit of length.

    Args:
        old: Where unknowns are known.
        new: Where they are wanted.

    Attributes:
        rest: Dimensionless volume of the undeformed cavity on the new mesh.
    """

    def __init__(self, old: DesignedBody, new: DesignedBody):
        self.old, self.new = old.system, new.system
        self.rest = new.volume_at_rest()
        self._scale = self.old.length_unit / self.new.length_unit
        self._geometry = old.motion.body.mesh.geometry
        self._places = self._geometry.x.copy()

    def __enter__(self) -> Transfer:
        from dolfinx import fem

        self._geometry.x[:] *= self._scale
        topology = self.new.body.mesh.topology
        self._cells = np.arange(topology.index_map(topology.dim).size_local, dtype=np.int32)
        self._fields = []
        for source, target in zip(_fields(self.old), _fields(self.new), strict=True):
            data = fem.create_interpolation_data(target[0], source[0], self._cells, padding=PADDING)
            self._fields.append((fem.Function(source[0]), source[1], fem.Function(target[0]), target[1], data))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, failure: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._geometry.x[:] = self._places

    def dofs(self, w: Array) -> Array:
        """Unknowns on the new mesh, with ghosts, of those on the old one; behind both come multipliers (`State.w`)."""
        found = np.zeros(self.new.dofs)
        for number, (source, its, target, own, data) in enumerate(self._fields):
            source.x.array[:] = w[its]
            target.interpolate_nonmatching(source, self._cells, data)
            target.x.scatter_forward()
            # Displacements are counted in the unit of length, pressures are not.
            found[own] = target.x.array * (1.0 if number else self._scale)
        return np.concatenate([found, w[self.old.dofs :]])

    def volume(self, V: float, rest: float) -> float:
        """A dimensionless volume on the new mesh, of one on the old mesh whose volume at rest is ``rest``."""
        return self.rest + (V - rest) * self._scale**3


def _fields(system: System) -> list[tuple[fem.FunctionSpace, npt.NDArray[np.int32] | slice]]:
    """The spaces of displacement and pressure, and where their dofs are in the unknowns."""
    if not system.mixed:
        return [(system.space, slice(0, system.dofs))]
    found: list[tuple[fem.FunctionSpace, npt.NDArray[np.int32] | slice]] = []
    for number in range(2):
        space, parents = system.space.sub(number).collapse()
        found.append((space, np.asarray(parents, dtype=np.int32)))
    return found
