"""Where compressed fibres kink the silicone that bears them, in a state that is loaded."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.materials.material import Material
from softmodels.mechanics.causes import Cause
from softmodels.mechanics.compiling import JIT
from softmodels.mechanics.ellipticity import Reinforced, least_resistance

if TYPE_CHECKING:
    from ufl.core.expr import Expr

    from softmodels.mechanics.parts import Equations

Array = npt.NDArray[np.float64]

MOST_POINTS = 300
"""Points that are looked at, those whose fibres are compressed most."""

Kink = tuple[float, float, tuple[float, float, float]]
"""Least resistance to a wave, in shear moduli, the change of squared length of the fibres there, and the place in m."""


def worst_kink(
    equations: Equations,
    cells: npt.NDArray[np.int32],
    material: Material,
    F: Expr,
    lines: Sequence[Expr],
    change: Expr,
    stress: tuple[Expr, Expr],
) -> Kink | None:
    """Where the silicone with its fibres resists some wave least; None where no fibre is compressed.

    Args:
        equations: The state is loaded.
        cells: Owned local cells in which the fibres are in this silicone.
        material: The silicone.
        F: The deformation gradient.
        lines: Their directions, one of each family.
        change: Their changes of squared length, a vector.
        stress: Derivative of their energy by that, and the second.

    Returns:
        The same on all ranks.
    """
    import ufl
    from dolfinx import fem

    body, families = equations.body, len(lines)
    parts = [F[i, j] for i in range(3) for j in range(3)]
    parts += [line[i] for line in lines for i in range(3)]
    parts += [change[k] for k in range(families)] + [stress[0][k] for k in range(families)]
    parts += [stress[1][k, k] for k in range(families)]
    place = ufl.SpatialCoordinate(body.mesh)
    parts += [place[i] for i in range(len(place))]
    table = fem.Expression(ufl.as_vector(parts), equations.points, jit_options=JIT)
    values = np.asarray(table.eval(body.mesh, cells)).reshape(-1, len(parts))  # no cells of this rank: no rows
    ends = np.cumsum([9, 3 * families, families, families, families])
    gradients, directions, changes, stresses, slopes, places = np.split(values, ends, axis=1)
    low = stresses.min(axis=1, initial=0.0)
    chosen = [i for i in np.argsort(low)[:MOST_POINTS] if low[i] < 0.0]
    found = (math.inf, 0.0, (0.0, 0.0, 0.0))
    if chosen:
        lines_there = directions[chosen].reshape(-1, families, 3)
        state = Reinforced(gradients[chosen].reshape(-1, 3, 3), lines_there, stresses[chosen], slopes[chosen])
        resistance = least_resistance(material, equations.stress_unit, state, body.axisymmetric)
        i = int(np.argmin(resistance))
        flat = np.zeros((1, 3))
        flat[0, : places.shape[1]] = places[chosen[i]] * equations.length_unit
        x, y, z = (float(value) for value in body.actuator.device_points(flat)[0])
        found = (float(resistance[i]), float(changes[chosen[i]].min()), (x, y, z))
    worst: Kink = min(equations.comm.allgather(found))
    return worst if math.isfinite(worst[0]) else None


def kinked(where: str, kink: Kink) -> Cause:
    """Words for it, of the fibres of a part."""
    place = ", ".join(f"{1e3 * x:.3g}" for x in kink[2])
    shortened = 1.0 - math.sqrt(1.0 + kink[1])
    return Cause(
        f"the fibres of {where} kink: near {place} mm they are shortened by {shortened:.1%}, and the silicone there no longer "
        "keeps them straight (it has lost its ellipticity), so that they fold in bands as thin as the mesh allows",
        "Let them go slack as threads do (slack = true), take softer fibres or a stiffer silicone, or stay below",
    )
