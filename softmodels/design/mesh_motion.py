"""A mesh that follows a design: its boundary is carried to another device of the class, its inner nodes follow like a solid.

The nodes on the true boundary go where the device itself says (`Actuator.carried`), from the device b0 that the mesh was made
of to b(theta). The inner ones follow by one fixed linear operator E, an elastic solid on the mesh as it was made whose small
cells are the stiff ones (Tezduyar, Behr, Mittal, Johnson 1992, New methods in transient analysis, AMD-246):

    x(theta) = x0 + E (b(theta) - b0)

Nodes on a cut plane slide in it. Since E does not change, what is computed on these meshes is a smooth function of theta, and
its gradient by all parameters costs one transposed E: a boundary covector, and its products with db/dtheta.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from geometries.errors import GeometryError
from geometries.parameters import changed, is_length, parameter
from softmodels.design.extension import Extension
from softmodels.mechanics.body import Body
from softmodels.mechanics.compiling import JIT
from softmodels.mechanics.mpi import largest, total

if TYPE_CHECKING:
    import ufl
    from dolfinx import fem

Array = npt.NDArray[np.float64]

STEP = 1e-6
"""Of the central differences of the boundary's places, in shares of the device's size (or of 1 for numbers and angles)."""


class MeshMotion:
    """Moves a body's mesh to other devices of its class.

    Args:
        body: The device, its mesh as it was read.

    Attributes:
        device: The device that the mesh shows now.
        space: Vector functions on the mesh's own nodes.
    """

    def __init__(self, body: Body):
        from dolfinx import fem

        mesh = body.mesh
        self.body, self.base, self.device, self.comm = body, body.actuator, body.actuator, mesh.comm
        self.dimension = mesh.geometry.dim
        self._places = mesh.geometry.x.copy()
        self.space = fem.functionspace(mesh, mesh.ufl_domain().ufl_coordinate_element())
        self._nodes = self._node_of_each_dof()
        self._extension = Extension(body, self.space)
        self._boundary = self._extension.boundary
        points = self._places[self._nodes[self._boundary]] * body.actuator.size
        self._boundary_points = body.actuator.device_points(points)
        self._volumes = self._cell_volumes()

    def _node_of_each_dof(self) -> npt.NDArray[np.int64]:
        """The mesh's node that each block of dofs of the coordinate space belongs to."""
        found = np.empty(len(self.space.tabulate_dof_coordinates()), dtype=np.int64)
        found[self.space.dofmap.list.ravel()] = self.body.mesh.geometry.dofmaps[0].ravel()
        return found

    @property
    def entries(self) -> int:
        """Number of local places' components, with ghosts."""
        return len(self._nodes) * self.dimension

    @property
    def owned_entries(self) -> int:
        """How many of them, the first ones, this rank owns."""
        return int(self.space.dofmap.index_map.size_local) * self.dimension

    def rest_places(self) -> Array:
        """Dimensionless places of the owned nodes on the mesh as it was made, shape (n, 3)."""
        return self._places[self._nodes[: self.space.dofmap.index_map.size_local]]

    def now(self, node: int | npt.NDArray[np.int64]) -> Array:
        """Dimensionless places of nodes of `space` on the mesh as it is now, shape (..., d)."""
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

    def quality(self) -> float:
        """Least ratio of a cell's Jacobian to its own on the mesh as it was made, over all ranks; 1 where nothing moved."""
        now = self._cell_volumes()
        ratio = float((now / self._volumes).min()) if now.size else np.inf
        return -largest(self.comm, -ratio)

    def _cell_volumes(self) -> Array:
        """Signed Jacobians of the owned cells at some points, shape (cells, points)."""
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
        """Device coordinates (n, 3) as the mesh has them, (n, d)."""
        return points if self.dimension == 3 else points[:, [0, 2]]

    def _carried(self, device: Actuator) -> Array:
        return self._in_mesh(self.base.carried(device, self._boundary_points))

    # -- derivatives ----------------------------------------------------------------------------------------------------

    def boundary_velocities(self, names: Sequence[str]) -> dict[str, Array]:
        """How the boundary's nodes move with each parameter at the present device, in m per SI unit, shape (n, d).

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
        """Derivatives of a quantity by the parameters, per their SI unit.

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

    def nodes_rate(self, velocity: Array) -> Array:
        """Motion of all dimensionless nodes with one of `boundary_velocities`, shape (nodes of `space`, d)."""
        return self._extension.extend(velocity / self.base.size)

    def compiled(self, form: ufl.Form) -> fem.Form:
        """The compiled derivative of a form without arguments by the places of the nodes."""
        import ufl
        from dolfinx import fem

        X = ufl.SpatialCoordinate(self.body.mesh)
        return fem.form(ufl.derivative(form, X, ufl.TestFunction(self.space)), jit_options=JIT)

    def assembled(self, form: fem.Form) -> Array:
        """A form's vector over the dofs of `space`, complete on their owners."""
        from dolfinx import fem, la

        b = fem.Function(self.space).x
        fem.assemble_vector(b.array, form)
        b.scatter_reverse(la.InsertMode.add)
        return b.array

    def release(self) -> None:
        """Give back what PETSc holds."""
        self._extension.release()


def scale_of(device: Actuator, name: str) -> float:
    """What a change of a parameter is large or small beside: the device's size for lengths, 1 for numbers and angles."""
    return device.size if is_length(device, name) else 1.0
