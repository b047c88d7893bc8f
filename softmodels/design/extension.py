"""The linear operator that carries a mesh's inner nodes with its boundary's, and its transpose: an elastic solid."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.body import Body
from softmodels.mechanics.compiling import JIT
from softmodels.mechanics.mpi import total
from softmodels.mechanics.petsc_matrices import assembled_matrix, held_dofs

if TYPE_CHECKING:
    import ufl
    from dolfinx import fem

Array = npt.NDArray[np.float64]

POISSON = 0.3
"""Of the solid."""
AXIS = "axis"
"""Role of the axis of a section, on which nodes slide as on a cut plane."""


class Extension:
    """The linear operator E: places of the boundary's nodes to places of all, and its transpose.

    Args:
        body: The device, its mesh as it was made.
        space: Vector functions on the mesh's own nodes.

    Attributes:
        boundary: Blocks of local dofs (with ghosts) on the true boundary.
    """

    def __init__(self, body: Body, space: fem.FunctionSpace):
        import ufl
        from dolfinx import fem
        from dolfinx import mesh as meshes
        from petsc4py import PETSc

        self.body, self.space = body, space
        mesh, tdim = body.mesh, body.mesh.topology.dim
        self.dimension = mesh.geometry.dim
        free = [plane.name for plane in body.actuator.cut_planes] + ([AXIS] if AXIS in body.entities else [])
        mesh.topology.create_connectivity(tdim - 1, tdim)
        outside = meshes.exterior_facet_indices(mesh.topology)
        cut = [body.entities[name][1] for name in free]
        true = np.setdiff1d(outside, np.concatenate(cut)) if cut else outside
        blocks = fem.locate_dofs_topological(space, tdim - 1, true.astype(np.int32))
        self.boundary = np.sort(blocks)
        self._held = fem.Function(space)
        self.bcs = [fem.dirichletbc(self._held, self.boundary)]
        zero = np.array(0.0)
        for component, name in self._sliding(free):
            dofs = fem.locate_dofs_topological(space.sub(component), tdim - 1, body.entities[name][1])
            self.bcs.insert(0, fem.dirichletbc(zero, dofs, space.sub(component)))
        trial, test = ufl.TrialFunction(space), ufl.TestFunction(space)
        weight = _stiffness(body)

        def stress(z: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
            strain = self._strain(z)
            return strain + POISSON / (1 - 2 * POISSON) * ufl.tr(strain) * ufl.Identity(self.dimension)

        a = (
            weight
            * ufl.inner(stress(trial), self._strain(test))
            * ufl.Measure("dx", mesh, metadata={"quadrature_degree": 2})
        )
        form = fem.form(a, jit_options=JIT)
        # Both are kept: assembled anew, the stiffness would be that of the mesh where it has moved to.
        self._free = assembled_matrix(form)
        self._matrix = assembled_matrix(form, self.bcs)
        self._matrix.setOption(PETSc.Mat.Option.SPD, True)  # type: ignore[arg-type]
        self._pc = PETSc.PC().create(mesh.comm)
        self._pc.setOperators(self._matrix)
        self._pc.setType("cholesky")
        self._pc.setFactorSolverType("mumps")
        self._pc.setUp()
        self._x, self._b = self._matrix.createVecRight(), self._matrix.createVecLeft()
        self.owned = self._matrix.getLocalSize()[0]

    def _strain(self, z: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        import ufl

        return ufl.sym(ufl.grad(self.body.displacement(z)))

    def _sliding(self, roles: Sequence[str]) -> list[tuple[int, str]]:
        """The component of z = B u that vanishes on each plane of symmetry."""
        return [
            (component, role)
            for role, components in self.body._held_components()
            if role in roles
            for component in components
        ]

    def extend(self, shift: Array) -> Array:
        """Displacement of all nodes (n, d) from that of the boundary's, shape (k, d)."""
        z = self._held.x
        z.array[:] = 0.0
        z.array.reshape(-1, self.dimension)[self.boundary] = shift @ self.body.skew.T
        inner = self._solve(-self._product(z.array[: self.owned]))
        z.array[: self.owned] += inner
        z.scatter_forward()
        return z.array.reshape(-1, self.dimension) @ self.body.skew_inverse.T

    def transposed(self, covector: Array) -> Array:
        """The transpose of `extend`: what a covector on all nodes (flat, owners complete) is on the boundary's, shape (k, d).

        Rows of ghosts are zero: their owners have them.
        """
        c = (covector.reshape(-1, self.dimension) @ self.body.skew_inverse).ravel()
        c[: self.owned] -= self._product(self._solve(c[: self.owned]))
        c[self.owned :] = 0.0
        return c.reshape(-1, self.dimension)[self.boundary] @ self.body.skew

    def _product(self, z: Array) -> Array:
        """The stiffness without conditions times a vector; owned entries of both."""
        self._x.array_w[:] = z
        self._free.mult(self._x, self._b)
        return np.array(self._b.array_r)

    def _solve(self, force: Array) -> Array:
        """The inner nodes' answer to a force, zero at conditions; owned entries."""
        force = force.copy()
        force[held_dofs(self.bcs)] = 0.0
        self._b.array_w[:] = force
        self._pc.apply(self._b, self._x)
        return np.array(self._x.array_r)

    def release(self) -> None:
        for thing in (self._pc, self._matrix, self._free, self._x, self._b):
            thing.destroy()


def _stiffness(body: Body) -> fem.Function:
    """One over each cell's volume (in shares of the mean): small cells keep their shape."""
    import ufl
    from dolfinx import fem

    space = fem.functionspace(body.mesh, ("DG", 0))
    found = fem.Function(space)
    volume = fem.form(ufl.TestFunction(space) * ufl.Measure("dx", body.mesh, metadata={"quadrature_degree": 2}))
    fem.assemble_vector(found.x.array, volume)
    found.x.scatter_forward()
    count = space.dofmap.index_map.size_global
    owned = found.x.array[: space.dofmap.index_map.size_local]
    mean = total(body.mesh.comm, float(owned.sum())) / count
    found.x.array[:] = mean / found.x.array
    return found
