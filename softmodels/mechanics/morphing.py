"""Another length of the device on the same mesh: its nodes move on the straight lines the actuator names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.body import Body

if TYPE_CHECKING:
    from dolfinx import fem

Array = npt.NDArray[np.float64]


class Reshaping:
    """Moves a body's mesh to other lengths of its actuator, and back.

    The cells keep their neighbours: a change of a few percent is meant, not another device.

    Args:
        body: The device, its mesh as it was read.
        names: Lengths among its `Actuator.variable`.

    Attributes:
        nominal: The actuator's own lengths in m, by name.
        velocities: Motion of the mesh with each length, per unit of it, as functions on the mesh's own nodes.

    Raises:
        GeometryError: A length whose motion the actuator does not know.
    """

    def __init__(self, body: Body, names: Sequence[str]):
        from dolfinx import fem

        self.body = body
        self.nominal = {name: float(getattr(body.actuator, name)) for name in names}
        self._places = body.mesh.geometry.x.copy()
        self._moves = {name: self._motion(name, self._places) for name in names}
        self.velocities: dict[str, fem.Function] = {}
        if names:
            space = fem.functionspace(body.mesh, body.mesh.ufl_domain().ufl_coordinate_element())
            self.velocities = {name: fem.Function(space) for name in names}
        for name, function in self.velocities.items():
            function.interpolate(lambda X, name=name: self._motion(name, X.T).T)

    def _motion(self, name: str, points: Array) -> Array:
        """Motion of points in mesh coordinates, shape (n, d)."""
        actuator = self.body.actuator
        moved = actuator.velocity(name, actuator.device_points(points * actuator.size))
        return moved if self.body.mesh.geometry.dim == 3 else moved[:, [0, 2]]

    def move(self, lengths: Mapping[str, float]) -> None:
        """Move the mesh to lengths in m; those left out are nominal."""
        x = self._places.copy()
        for name, value in lengths.items():
            share = (value - self.nominal[name]) / self.body.actuator.size
            x[:, : self.body.mesh.geometry.dim] += share * self._moves[name]
        self.body.mesh.geometry.x[:] = x
