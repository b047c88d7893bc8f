"""A dead load that is spread evenly over a face."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.section_axes import in_section
from softmodels.mechanics.system import System


def face_load(system: System, role: str, direction: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """A unit load on the slice, spread evenly over a role's undeformed facets: entries of all owned dofs.

    Args:
        system: The equations.
        role: Of facets.
        direction: Unit vector in device coordinates.

    Returns:
        Shape (n,), dimensionless; `System.by_unknowns` turns it into what Newton's method has.
    """
    import ufl
    from dolfinx import fem

    body = system.body
    measure, _ = body.sheet_face(role)
    test = ufl.TestFunction(system.space)
    y = ufl.split(test)[0] if system.mixed else test
    along = fem.Constant(body.mesh, in_section(direction, body.actuator.dimension))
    spread = fem.form(ufl.dot(along, body.displacement(y)) * body.hoop * measure)
    one = fem.Constant(body.mesh, 1.0)
    return system.assemble([spread], held=True) / system.integral(fem.form(one * body.hoop * measure))
