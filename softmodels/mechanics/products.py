"""Products of a change of the unknowns with the second derivative of a potential, in the state that its functions hold."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.moduli import Moduli, NoModuliError, known_cells

if TYPE_CHECKING:
    import ufl
    from dolfinx import fem

    from softmodels.mechanics.potential import Potential

Array = npt.NDArray[np.float64]


class Products:
    """What multiplies with each term of a potential: kept second derivatives where they can be, else a compiled form.

    Args:
        potential: The potential.
        internal: Compiled derivatives of its energies.
        loads: Compiled derivatives of its cavities' volumes.
        compiled: Compiles a form.

    Attributes:
        kept: Second derivatives that are kept.
        by_forms: Compiled products of the rest.
    """

    def __init__(
        self,
        potential: Potential,
        internal: Sequence[fem.Form],
        loads: Sequence[fem.Form],
        compiled: Callable[[ufl.Form], fem.Form],
    ):
        self.kept: list[Moduli] = []
        self.by_forms: list[fem.Form] = []
        foreseen = potential.foreseen_tangents(potential.direction)
        seconds = potential.tangent(potential.direction)
        terms = [[(energy, force)] for energy, force in zip(potential.energies, internal, strict=True)]
        pressures = zip(potential.pressures, potential.volumes, loads, strict=True)
        terms += [[(-pressure * volume, load) for pressure, volume, load in pressures]] if potential.volumes else []
        known = known_cells(potential.space)
        for number, term in enumerate(terms):
            try:
                if not known or number in foreseen:
                    raise NoModuliError("other cells, or another tangent than the energy's")
                self.kept += [Moduli(energy, potential.w, force, potential.mixed) for energy, force in term]
            except NoModuliError:
                self.by_forms.append(compiled(seconds[number]))

    def add(self, x: Array, y: Array) -> None:
        """Add the product with ``x`` to ``y``, both local dofs with ghosts; what ghosts get is for their owners.

        Args:
            x: The change; held dofs are as they are in it. Kept in the potential's ``direction`` too.
            y: What is added to.
        """
        from dolfinx import fem

        for moduli in self.kept:
            moduli.add_product(x, y)
        for form in self.by_forms:
            fem.assemble_vector(y, form)
