"""Products of a change of the unknowns with the second derivative of a potential, in the state that its functions hold."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.c_library import Rows
from softmodels.mechanics.moduli import Moduli, cell_dofs, known_cells
from softmodels.mechanics.petsc_matrices import assemble_into, put_diagonal
from softmodels.mechanics.second_derivatives import NoModuliError

if TYPE_CHECKING:
    import ufl
    from dolfinx import fem
    from petsc4py import PETSc

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
        by_forms, matrices: Compiled products and tangents of the rest.
        pattern: A compiled bilinear form of each region, for the matrix' pattern.
    """

    def __init__(
        self,
        potential: Potential,
        internal: Sequence[fem.Form],
        loads: Sequence[fem.Form],
        compiled: Callable[[ufl.Form], fem.Form],
    ):
        import ufl

        self._potential = potential
        self.kept: list[Moduli] = []
        self.by_forms: list[fem.Form] = []
        self.matrices: list[fem.Form] = []
        foreseen = potential.foreseen_tangents(potential.direction)
        terms = [[(energy, force)] for energy, force in zip(potential.energies, internal, strict=True)]
        pressures = zip(potential.pressures, potential.volumes, loads, strict=True)
        terms += [[(-pressure * volume, load) for pressure, volume, load in pressures]] if potential.volumes else []
        known = known_cells(potential.space)
        dofs = cell_dofs(potential.space, potential.mixed) if known else np.empty((0, 0), dtype=np.int32)
        for number, term in enumerate(terms):
            try:
                if not known or number in foreseen:
                    raise NoModuliError("other cells, or another tangent than the energy's")
                self.kept += [Moduli(energy, potential.w, force, dofs, potential.mixed) for energy, force in term]
            except NoModuliError:
                self.by_forms.append(compiled(potential.tangent(potential.direction)[number]))
                self.matrices.append(compiled(potential.tangent(ufl.TrialFunction(potential.space))[number]))
        regions, whole = len(potential.regions), len(self.matrices) == len(terms)
        self.pattern = self.matrices[:regions] if whole else [compiled(form) for form in self._any()]

    def _any(self) -> list[ufl.Form]:
        """Bilinear forms of the regions: which does not matter to a pattern, and these are soon compiled."""
        import ufl

        space = self._potential.space
        trial, test = ufl.TrialFunction(space), ufl.TestFunction(space)
        return [ufl.inner(trial, test) * region.dx for region in self._potential.regions]

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

    def add_to(self, matrix: PETSc.Mat, bcs: Sequence[fem.DirichletBC]) -> None:
        """Add the second derivative itself to a matrix, which is not brought to its end.

        Args:
            matrix: With the pattern of the cells' dofs.
            bcs: Rows and columns of their dofs stay empty, but for ones on the diagonal.
        """
        space = self._potential.space
        held = np.zeros(len(self._potential.w.x.array), dtype=np.int8)
        for bc in bcs:
            held[bc.dof_indices()[0]] = 1
        if self.kept:
            rows = Rows(matrix)
            for moduli in self.kept:
                moduli.add_to(rows, held)
        matrix.assemble(matrix.AssemblyType.FLUSH)  # held dofs' diagonal is put in, the rest is added up
        for form in self.matrices:
            assemble_into(matrix, form, bcs)
            matrix.assemble(matrix.AssemblyType.FLUSH)
        put_diagonal(matrix, space, bcs)
