"""What a term's stress is foreseen from in Newton's matrix; see `softmodels.mechanics.potential.Potential.foresee`."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dolfinx import fem
    from ufl.core.expr import Expr


@dataclasses.dataclass(frozen=True, eq=False)
class Foresight:
    """What a term's stress is foreseen from in Newton's matrix, and the matrix' two directions.

    Attributes:
        known: The unknowns of another state.
        displacement: Skew components of the displacement in them, in UFL.
        move: From there to the current state.
        test, trial: Directions.
    """

    known: fem.Function
    displacement: Expr
    move: fem.Function
    test: Expr
    trial: Expr
