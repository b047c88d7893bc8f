"""A device under design, ready to be solved and differentiated: equations, mesh motion, probes."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.materials.strain import Strain
from softmodels.mechanics.compiling import JIT
from softmodels.mechanics.motion import MeshMotion
from softmodels.mechanics.mpi import largest, total
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import face_load
from softmodels.runs.grid import Grid, displacement_maps

if TYPE_CHECKING:
    import ufl
    from petsc4py import PETSc


class DesignedBody:
    """A meshed device whose mesh follows its design.

    Args:
        solver: The device, its mesh as it was read.

    Attributes:
        motion: Moves the mesh.
        probes: The device's named points.
        rest_volume: UFL form of what `System.volume` is of the undeformed device.
    """

    def __init__(self, solver: Solver):
        import ufl
        from dolfinx import fem

        self.solver, self.system = solver, solver.system
        system = self.system
        self.motion = MeshMotion(system.body)
        resting = fem.Function(system.space)
        self.rest_volume: ufl.Form = ufl.replace(system.potential.cavity_volume, {system.w: resting})
        self._rest_volume = system.form(self.rest_volume)
        self.probes = Probes(self)  # now, before the mesh moves
        self._vectors: tuple[PETSc.Vec, PETSc.Vec] | None = None

    @functools.cached_property
    def strain(self) -> Strain:
        """Strain of the current state in UFL."""
        return Strain(self.system.body.deformation_gradient(self.system.potential.displacement))

    @functools.cached_property
    def _gradients(self) -> object:
        from dolfinx import fem

        return fem.Expression(self.strain.F, self.system.points, jit_options=JIT)

    def gradients(self) -> Array:
        """Return the deformation gradients of the loaded state at the integration points, shape (cells, points, 3, 3)."""
        system = self.system
        values = self._gradients.eval(system.body.mesh, system.cells)  # type: ignore[attr-defined]
        return np.asarray(values).reshape(len(system.cells), -1, 3, 3)

    def volume_at_rest(self) -> float:
        """Return the dimensionless undeformed volume conjugate to the pressure, on the current mesh."""
        system, chambers = self.system, self.system.body.chambers
        return system.integral(self._rest_volume) + float(system.coupling.shares[: len(chambers)] @ chambers)

    def face_load(self, role: str) -> Array:
        """Return a unit load along the lift, spread evenly over a role: owned entries; see `face_load`."""
        return self.system.by_unknowns(face_load(self.system, role, self.system.body.actuator.lift)).copy()

    def answer(self, force: Array) -> Array:
        """Return K^-1 times a force with the current factorisation, refined once on the factorised K;
        owned entries."""
        bordered, K = self.solver.bordered, self.system.K
        if self._vectors is None:
            self._vectors = K.createVecRight(), K.createVecRight()
        b, x = self._vectors
        b.array_w[:] = force
        bordered.solve(b, x)
        found = np.array(x.array_r)
        if not bordered.inverse.exact:  # iterations have converged, with the state's own tangent
            return found
        K.mult(x, b)
        b.array_w[:] = force - b.array_r
        bordered.solve(b, x)
        return found + x.array_r

    def release(self) -> None:
        """Release the PETSc and MPI objects."""
        for vector in self._vectors or ():
            vector.destroy()
        self.motion.release()
        self.solver.release()


class Probes:
    """The device's named points, which are vertices of every design's mesh.

    Args:
        design: The device, its mesh as it was made.
    """

    def __init__(self, design: DesignedBody):
        self.design, self.system = design, design.system
        grid = Grid(self.system)
        skew, _ = displacement_maps(self.system, grid)
        motion, actuator = design.motion, self.system.body.actuator
        here = grid.space.tabulate_dof_coordinates()[: grid.owned]
        there = motion.rest_places()
        self._dofs: dict[str, npt.NDArray[np.int32] | None] = {}
        self._nodes: dict[str, int | None] = {}
        for name, place in actuator.probes.items():
            node = self._owner(here, np.asarray(place))
            self._dofs[name] = None if node is None else skew[node]
            self._nodes[name] = self._owner(there, np.asarray(place))

    def _owner(self, places: Array, point: Array) -> int | None:
        """Return the local index of the one of the owned ``places`` (of the mesh) at a device point, if this rank owns it."""
        system = self.system
        device = system.body.actuator.device_points(places * system.length_unit)
        distance = np.linalg.norm(device - point, axis=1)
        near = float(distance.min()) if len(distance) else np.inf
        closest = -largest(system.comm, -near)
        if closest > 1e-6 * system.length_unit:
            raise RuntimeError("a probe of the device is not a vertex of its mesh")
        return int(np.argmin(distance)) if near == closest else None

    def place(self, name: str) -> Array:
        """Return where it is undeformed, device coordinates in m, shape (3,), on all ranks."""
        node = self._nodes[name]
        x = np.zeros(self.design.motion.dimension) if node is None else self.design.motion.now(node)
        return self._everywhere(self._device(x * self.system.length_unit))

    def displacement(self, name: str) -> Array:
        """Return its displacement in the loaded state, m, shape (3,), on all ranks."""
        dofs, system = self._dofs[name], self.system
        d = self.design.motion.dimension
        w = np.zeros(d) if dofs is None else system.w.x.array[dofs]
        return self._everywhere(self._device(system.body.skew_inverse @ w * system.length_unit))

    def add(self, by_w: Array, by_X: Array, name: str, by_place: Array, by_displacement: Array) -> None:
        """Add a derivative by a probe's place and displacement (device coordinates, per m) to those by owned dofs and nodes."""
        system, motion = self.system, self.design.motion
        dofs, node = self._dofs[name], self._nodes[name]
        if dofs is not None:
            by_w[dofs] += system.length_unit * (self._mesh(by_displacement) @ system.body.skew_inverse)
        if node is not None:
            start = node * motion.dimension
            by_X[start : start + motion.dimension] += system.length_unit * self._mesh(by_place)

    def _device(self, x: Array) -> Array:
        return x if len(x) == 3 else np.array([x[0], 0.0, x[1]])

    def _mesh(self, x: Array) -> Array:
        return x if self.design.motion.dimension == 3 else x[[0, 2]]

    def _everywhere(self, x: Array) -> Array:
        return np.array([total(self.system.comm, float(value)) for value in x])
