"""The residual and the tangent of a device's equations, assembled in the state that its functions hold."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from dolfinx import fem
    from petsc4py import PETSc

    from softmodels.mechanics.assembled import AssembledTerms
    from softmodels.mechanics.dead_loads import DeadLoads
    from softmodels.mechanics.potential import Potential
    from softmodels.mechanics.products import Products
    from softmodels.mechanics.unknowns import Unknowns

Array = npt.NDArray[np.float64]


class Assembly:
    """What the `System` assembles; its attributes are set there.

    Vectors of all dofs are entries by w. Those of the unknowns are what Newton's method has: zero at held dofs, and with rigid
    parts by the parts' own unknowns in place of the dofs that follow them.
    """

    potential: Potential
    w: fem.Function
    n: int
    bcs: list[fem.DirichletBC]
    unknowns: Unknowns
    assembled: AssembledTerms
    dead: DeadLoads
    pressures: Array
    _whole: PETSc.Mat
    _vector: fem.Function
    _internal: list[fem.Form]
    _loads: list[list[fem.Form]]
    _products: Products

    def assemble(self, forms: list[fem.Form], held: bool = False) -> Array:
        """Sum of assembled linear forms, owned entries: by the unknowns and zero at held dofs, or by all dofs if ``held``.

        It is a view that the next call overwrites.
        """
        from dolfinx import fem, la

        b = self._vector.x
        b.array[:] = 0.0
        for form in forms:
            fem.assemble_vector(b.array, form)
        b.scatter_reverse(la.InsertMode.add)
        return b.array[: self.n] if held else self._by_unknowns()

    def by_unknowns(self, entries: Array) -> Array:
        """Entries of owned dofs by the unknowns; a view that the next assembly overwrites."""
        self._vector.x.array[: self.n] = entries
        return self._by_unknowns()

    def _by_unknowns(self) -> Array:
        """What has been assembled by all dofs, by the unknowns."""
        b = self._vector.x.array
        for bc in self.bcs:
            bc.set(b, alpha=0.0)
        self.unknowns.pull(b)
        return b[: self.n]

    def internal_forces(self) -> Array:
        """Derivative of the stored energy, owned entries; a view that the next assembly overwrites."""
        self.assembled.add_forces(self.w.x.array, self.assemble(self._internal, held=True))
        return self._by_unknowns()

    def pressure_loads(self) -> Array:
        """Each driver's load of a unit magnitude, shape (k, n): of the cavities' pressures, then of the dead loads."""
        return np.array([self.assemble(load).copy() for load in self._loads])

    def assemble_tangent(self) -> None:
        """Put the current state's tangent into K."""
        self._assemble_whole()
        self.unknowns.reduce(self._whole, self.residual)

    def _assemble_whole(self) -> None:
        """Assemble the tangent by all dofs."""
        self._whole.zeroEntries()
        self._products.add_to(self._whole, self.bcs)
        self._whole.assemble()
        self.assembled.add_to(self._whole, self.w.x.array)

    def tangent_product(self, x: Array, y: Array) -> None:
        """Put the current state's tangent times x into y. Cheaper than assembling the matrix, and only good for products."""
        from dolfinx import la

        d = self.potential.direction.x
        self.unknowns.push(x, d.array)
        for bc in self.bcs:
            bc.set(d.array, alpha=0.0)
        d.scatter_forward()
        b = self._vector.x
        b.array[:] = 0.0
        self._products.add(d.array, b.array)
        b.scatter_reverse(la.InsertMode.add)
        self.assembled.add_product(self.w.x.array, d.array, b.array[: self.n])
        y[:] = self._by_unknowns()
        self.unknowns.stiffen(x, y, self.residual)
        for bc in self.bcs:  # held dofs: the identity, as in the assembled matrix
            dofs, owned = bc.dof_indices()
            y[dofs[:owned]] = x[dofs[:owned]]
        y[self.unknowns.idle] = x[self.unknowns.idle]

    def forces_and_loads(self) -> list[tuple[fem.Form, float]]:
        """The potential's derivative by w in the current state: compiled forms with their factors."""
        return self._terms(len(self._loads))

    def _terms(self, drivers: int) -> list[tuple[fem.Form, float]]:
        """The same with the loads of the first drivers alone."""
        loads = zip(self._loads[:drivers], -self.pressures[:drivers], strict=True)
        return [*((form, 1.0) for form in self._internal), *((form, factor) for load, factor in loads for form in load)]

    def residual(self, dead: bool = True) -> Array:
        """Derivative of the potential by each owned dof, held ones and rigid parts' too; dead loads count if ``dead``."""
        found, drivers = np.zeros(self.n), len(self._loads)
        for form, factor in self._terms(drivers if dead else drivers - len(self.dead.forms)):
            found += factor * self.assemble([form], held=True)
        return self.assembled.add_forces(self.w.x.array, found, held=True)
