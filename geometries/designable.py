"""What a design needs of a device: which of its parameters a mesh can follow, where its boundary goes, what is thinnest.

A mesh that was made of one device is moved to another of the same kind: its nodes on the boundary go where `carried` says,
those inside follow. So a quantity is a smooth function of the parameters, free of the noise of new meshes.
`geometries.parameters` has the parameters by name.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Self

import numpy as np
from numpy.typing import NDArray

from geometries.errors import GeometryError


class Designable:
    """The part of `geometries.Actuator` that a design asks for; a device that says nothing of it cannot be designed."""

    @property
    def movable(self) -> tuple[str, ...]:
        """Names of the parameters that `carried` can follow, among those of `geometries.parameters.parameter_names`."""
        return ()

    def carried(self, other: Self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where points on the boundary of this device lie on another one.

        Corners go to corners, edges to edges, faces to faces and probes to probes; points on a cut plane stay on it. The
        places are smooth functions of the other's parameters, and the same points again if it is this device.

        Args:
            other: A device of the same class whose choices and numbers of parts are this one's.
            points: Points on the undeformed boundary in device coordinates, m, shape (n, 3); none from inside the solid.

        Returns:
            Shape (n, 3): on the other's boundary, to rounding wherever a face is given in closed form.

        Raises:
            GeometryError: This kind of device does not know it, or not between these two.
        """
        raise GeometryError(
            f"the mesh of {type(self).__name__} cannot follow its parameters: it knows no motion of its faces"
        )

    @property
    def clearances(self) -> Mapping[str, float]:
        """Every dimension in m that has a least value, for geometry or for the workshop, by what it is in plain words.

        Each is a smooth function of the parameters; walls that could each be the thinnest are entries of their own. Empty if
        the device names none.
        """
        return {}
