"""The residual and the tangent of a device's equations, assembled in the state that its functions hold."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    import ufl
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
    form: Callable[[ufl.Form], fem.Form]

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
        loads = zip(self._loads, -self.pressures, strict=True)
        return [*((form, 1.0) for form in self._internal), *((form, factor) for load, factor in loads for form in load)]

    @functools.cached_property
    def _pressing(self) -> list[fem.Form]:
        return [self.form(walls) for walls in self.potential.pressing()]

    def surplus(self) -> Array:
        """Forces on each owned dof that holders balance, with the sign of `residual`, and equal to it on free dofs.

        On held dofs, and on rigid parts' as a whole, that is what holds them. The air pushes on its walls alone, see
        `Body.pressing`, and all dead loads count.
        """
        found = self.residual()
        for pressure, (load,), walls in zip(self.pressures, self._loads, self._pressing, strict=False):
            found += pressure * self.assemble([load], held=True)
            found -= pressure * self.assemble([walls], held=True)
        return found

    def residual(self) -> Array:
        """Derivative of the potential by each owned dof, held ones and rigid parts' too."""
        found = np.zeros(self.n)
        for form, factor in self.forces_and_loads():
            found += factor * self.assemble([form], held=True)
        return self.assembled.add_forces(self.w.x.array, found, held=True)
