"""Motion of a body's mesh to other devices of its class: boundary nodes by the device's own map, inner nodes as in a solid."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from geometries.actuator import changed, is_length, parameter
from softmodels.common.arrays import Array
from softmodels.common.errors import GeometryError
from softmodels.mechanics.assembly import assembled_matrix, held_dofs, numbered
from softmodels.mechanics.body import Body
from softmodels.mechanics.compiling import JIT
from softmodels.mechanics.mpi import largest, total

if TYPE_CHECKING:
    import ufl
    from dolfinx import fem, mesh


# ----------------------------------------------------------------------------------------------------------------------
# Linear extension of boundary motion to inner mesh nodes by an elastic solid, and its transpose.


POISSON = 0.3
"""Poisson's ratio of the solid."""
AXIS = "axis"
"""Role of a section's axis, on which nodes slide as on a cut plane."""


class Extension:
    """The linear operator E from positions of boundary nodes to those of all nodes, and its transpose.

    Args:
        body: The device, its mesh as it was made.
        space: Vector functions on the mesh's own nodes.

    Attributes:
        boundary: Blocks of local dofs (with ghosts) on the true boundary.
    """

    def __init__(self, body: Body, space: fem.FunctionSpace):
        import ufl
        from dolfinx import fem, mesh as meshes
        from petsc4py import PETSc

        self.body, self.space = body, space
        mesh, tdim = body.mesh, body.mesh.topology.dim
        self.dimension = mesh.geometry.dim
        free = [plane.name for plane in body.actuator.cut_planes] + ([AXIS] if AXIS in body.entities else [])
        mesh.topology.create_connectivity(tdim - 1, tdim)
        outside = meshes.exterior_facet_indices(mesh.topology)
        cut = [body.entities[name][1] for name in free]
        true = np.setdiff1d(outside, np.concatenate(cut)) if cut else outside
        if body.actuator.carries_interfaces:
            true = np.union1d(true, _interfaces(body))
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
        # Both are stored, because a new assembly would use the moved mesh.
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
        """Return the component of z = B u that vanishes on each plane of symmetry."""
        return [
            (component, role)
            for role, components in self.body._held_components()
            if role in roles
            for component in components
        ]

    def extend(self, shift: Array) -> Array:
        """Return the displacement of all nodes (n, d) from that of the boundary's, shape (k, d)."""
        z = self._held.x
        z.array[:] = 0.0
        z.array.reshape(-1, self.dimension)[self.boundary] = shift @ self.body.skew.T
        inner = self._solve(-self._product(z.array[: self.owned]))
        z.array[: self.owned] += inner
        z.scatter_forward()
        return z.array.reshape(-1, self.dimension) @ self.body.skew_inverse.T

    def transposed(self, covector: Array) -> Array:
        """Apply the transpose of `extend`: map a covector on all nodes (flat, owners complete) to the boundary's,
        shape (k, d).

        Rows of ghosts are zero: their owners have them.
        """
        c = (covector.reshape(-1, self.dimension) @ self.body.skew_inverse).ravel()
        c[: self.owned] -= self._product(self._solve(c[: self.owned]))
        c[self.owned :] = 0.0
        return c.reshape(-1, self.dimension)[self.boundary] @ self.body.skew

    def _product(self, z: Array) -> Array:
        """Return the stiffness without conditions times a vector; owned entries of both."""
        self._x.array_w[:] = z
        self._free.mult(self._x, self._b)
        return np.array(self._b.array_r)

    def _solve(self, force: Array) -> Array:
        """Return the inner nodes' response to a force, zero at conditions; owned entries."""
        force = force.copy()
        force[held_dofs(self.bcs)] = 0.0
        self._b.array_w[:] = force
        self._pc.apply(self._b, self._x)
        return np.array(self._x.array_r)

    def release(self) -> None:
        for thing in (self._pc, self._matrix, self._free, self._x, self._b):
            thing.destroy()


def _interfaces(body: Body) -> npt.NDArray[np.int32]:
    """Return the local facets between cells of different regions."""
    topology, d = body.mesh.topology, body.mesh.topology.dim
    regions = numbered(body.mesh, list(body.regions.values()))
    topology.create_connectivity(d - 1, d)
    cells = topology.connectivity(d - 1, d)
    first, count = cells.offsets[:-1], np.diff(cells.offsets)
    inner = np.flatnonzero(count == 2)
    one, other = cells.array[first[inner]], cells.array[first[inner] + 1]
    return inner[regions[one] != regions[other]].astype(np.int32)


def _stiffness(body: Body) -> fem.Function:
    """Return the inverse of each cell's volume, relative to the mean, so that small cells keep their shape."""
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


# ----------------------------------------------------------------------------------------------------------------------
# Mesh motion: boundary nodes map to another device of the class, inner nodes follow like a solid.
#
# Boundary nodes are mapped by the device itself (`Actuator.carried`), from the device b0 that the mesh was made
# of to b(theta). The inner ones follow by one fixed linear operator E, an elastic solid on the initial mesh whose small
# cells are stiffer (Tezduyar, Behr, Mittal, Johnson 1992, New methods in transient analysis, AMD-246):
#
#     x(theta) = x0 + E (b(theta) - b0)
#
# Nodes on a cut plane slide in it. Because E is constant, results on these meshes are smooth functions of theta, and a
# gradient by all parameters costs one transposed E: a boundary covector, and its products with db/dtheta.


STEP = 1e-6
"""Step of the central differences of boundary positions, relative to the device's size (or to 1 for numbers and angles)."""


def coordinates(domain: mesh.Mesh) -> tuple[fem.FunctionSpace, npt.NDArray[np.int64]]:
    """Return the vector functions on a mesh's own nodes, and the node of the geometry that each block of dofs belongs to."""
    from dolfinx import fem

    space = fem.functionspace(domain, domain.ufl_domain().ufl_coordinate_element())
    found = np.empty(len(space.tabulate_dof_coordinates()), dtype=np.int64)
    found[space.dofmap.list.ravel()] = domain.geometry.dofmaps[0].ravel()
    return space, found


class MeshMotion:
    """Moves a body's mesh to other devices of its class.

    Args:
        body: The device, its mesh as it was read.

    Attributes:
        device: The device that the mesh shows now.
        space: Vector functions on the mesh's own nodes.
        followers: Called when the mesh has moved.
    """

    def __init__(self, body: Body):
        mesh = body.mesh
        self.body, self.base, self.device, self.comm = body, body.actuator, body.actuator, mesh.comm
        self.dimension, self.followers = mesh.geometry.dim, list[Callable[[], None]]()
        self._places = mesh.geometry.x.copy()
        self.space, self._nodes = coordinates(mesh)
        self._extension = Extension(body, self.space)
        self._boundary = self._extension.boundary
        points = self._places[self._nodes[self._boundary]] * body.actuator.size
        self._boundary_points = body.actuator.device_points(points)
        self._volumes = self._cell_volumes()

    @property
    def entries(self) -> int:
        """Number of local places' components, with ghosts."""
        return len(self._nodes) * self.dimension

    @property
    def owned_entries(self) -> int:
        """Number of the first of them, owned by this rank."""
        return int(self.space.dofmap.index_map.size_local) * self.dimension

    def rest_places(self) -> Array:
        """Return the dimensionless places of the owned nodes on the mesh as it was made, shape (n, 3)."""
        return self._places[self._nodes[: self.space.dofmap.index_map.size_local]]

    def now(self, node: int | npt.NDArray[np.int64]) -> Array:
        """Return the dimensionless places of nodes of `space` on the current mesh, shape (..., d)."""
        return self.body.mesh.geometry.x[self._nodes[node], : self.dimension]

    # -- moving ---------------------------------------------------------------------------------------------------------

    def move(self, device: Actuator) -> None:
        """Move the mesh to a device.

        Raises:
            GeometryError: The device's boundary cannot be reached from the one that the mesh was made of.
        """
        shift = self._carried(device) - self._in_mesh(self._boundary_points)
        moved = self._places.copy()
        moved[self._nodes, : self.dimension] += self._extension.extend(shift / self.base.size)
        self.body.mesh.geometry.x[:] = moved
        self.device = device
        for follow in self.followers:
            follow()

    def quality(self) -> float:
        """Return the least ratio of a cell's Jacobian to its own on the initial mesh, over all ranks; 1 if
        nothing moved."""
        now = self._cell_volumes()
        ratio = float((now / self._volumes).min()) if now.size else np.inf
        return -largest(self.comm, -ratio)

    def _cell_volumes(self) -> Array:
        """Return the signed Jacobians of the owned cells at some points, shape (cells, points)."""
        import basix
        import basix.ufl

        mesh = self.body.mesh
        points, _ = basix.make_quadrature(mesh.basix_cell(), 3)
        # Of order 1 or 2, for which all variants of the element are one.
        cells = basix.ufl.element("P", mesh.basix_cell(), mesh.geometry.cmaps[0].degree)
        gradients = cells.tabulate(1, points)[1:]  # (d, points, nodes)
        owned = mesh.topology.index_map(mesh.topology.dim).size_local
        corners = mesh.geometry.x[mesh.geometry.dofmaps[0][:owned]][..., : self.dimension]
        jacobians = np.einsum("dpn,cni->cpid", gradients, corners)
        return np.linalg.det(jacobians)

    def _in_mesh(self, points: Array) -> Array:
        """Return the device coordinates (n, 3) as the mesh has them, (n, d)."""
        return points if self.dimension == 3 else points[:, [0, 2]]

    def _carried(self, device: Actuator) -> Array:
        return self._in_mesh(self.base.carried(device, self._boundary_points))

    # -- derivatives ----------------------------------------------------------------------------------------------------

    def boundary_velocities(self, names: Sequence[str]) -> dict[str, Array]:
        """Return the derivatives of the boundary nodes by each parameter at the current device, in m per SI unit, shape (n, d).

        Central differences of `Actuator.carried`; one-sided where the device does not exist on one side.

        Raises:
            GeometryError: The device exists on neither side.
        """
        return {name: self._velocity(name) for name in names}

    def _velocity(self, name: str) -> Array:
        device, value = self.device, parameter(self.device, name)
        step = STEP * max(abs(value), 0.1 * scale_of(device, name))
        ends = []
        for sign in (1.0, -1.0):
            try:
                ends.append((sign, self._carried(changed(device, {name: value + sign * step}))))
            except GeometryError as error:
                failure = error
        if not ends:
            raise failure
        if len(ends) == 1:
            ends.append((0.0, self._carried(device)))
        (a, high), (b, low) = ends
        return (high - low) / ((a - b) * step)

    def gradient(self, covector: Array, velocities: dict[str, Array]) -> dict[str, float]:
        """Return the derivatives of a quantity by the parameters, per their SI unit.

        Args:
            covector: The quantity's derivative by the dimensionless places of the nodes, owned and ghosted dofs of `space`,
                every owner's complete, ghosts not read.
            velocities: Of `boundary_velocities`.
        """
        at_boundary = self._extension.transposed(covector)
        return {
            name: total(self.comm, float(np.sum(at_boundary * velocity))) / self.base.size
            for name, velocity in velocities.items()
        }

    def velocity(self, name: str) -> Array:
        """Return the motion of all dimensionless nodes with a parameter at the current device, per its SI unit; see
        `nodes_rate`."""
        return self.nodes_rate(self._velocity(name))

    def nodes_rate(self, velocity: Array) -> Array:
        """Return the motion of all dimensionless nodes with one of `boundary_velocities`, shape (nodes of `space`, d)."""
        return self._extension.extend(velocity / self.base.size)

    def at_nodes(self, motion: Array) -> Array:
        """Return a motion of the nodes of `space`, shape (nodes, d), in the order of the mesh's geometry."""
        found = np.zeros((len(self.body.mesh.geometry.x), self.dimension))
        found[self._nodes] = motion
        return found

    def by_nodes(self, rates: Array) -> Array:
        """Return shares of a derivative by the mesh's own nodes in the order of its geometry as a covector over `space`,
        complete on the owners."""
        from dolfinx import fem, la

        b = fem.Function(self.space).x
        b.array[:] = rates[self._nodes].ravel()
        b.scatter_reverse(la.InsertMode.add)
        return np.array(b.array)

    def compiled(self, form: ufl.Form) -> fem.Form:
        """Return the compiled derivative of a form without arguments by the places of the nodes."""
        import ufl
        from dolfinx import fem

        X = ufl.SpatialCoordinate(self.body.mesh)
        return fem.form(ufl.derivative(form, X, ufl.TestFunction(self.space)), jit_options=JIT)

    def assembled(self, form: fem.Form) -> Array:
        """Return a form's vector over the dofs of `space`, complete on their owners."""
        from dolfinx import fem, la

        b = fem.Function(self.space).x
        fem.assemble_vector(b.array, form)
        b.scatter_reverse(la.InsertMode.add)
        return b.array

    def release(self) -> None:
        """Release the PETSc objects."""
        self._extension.release()


def scale_of(device: Actuator, name: str) -> float:
    """Return the scale of a parameter: the device's size for lengths, 1 for numbers and angles."""
    return device.size if is_length(device, name) else 1.0
