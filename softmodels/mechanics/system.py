"""The discrete equations of a pressurised body: what its potential's forms are assembled to, and functions of a state.

Inside, lengths are in sizes of the device and stresses in shear moduli.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from geometries.openings import check_closed
from softmodels.materials.laws import Material
from softmodels.materials.strain import Strain
from softmodels.mechanics.assembled import AssembledTerms
from softmodels.mechanics.assembly import Assembly
from softmodels.mechanics.body import QUADRATURE_DEGREE, Body, BodyError
from softmodels.mechanics.compiling import JIT
from softmodels.mechanics.contact import Obstacle
from softmodels.mechanics.coupling import Coupling
from softmodels.mechanics.dead_loads import DeadLoads
from softmodels.mechanics.holds import clamped, conditions
from softmodels.mechanics.mpi import largest, total
from softmodels.mechanics.parts import Part
from softmodels.mechanics.potential import Potential
from softmodels.mechanics.products import Products
from softmodels.mechanics.region_space import matrix_of
from softmodels.mechanics.regions import MaterialRegion, check_compressible
from softmodels.mechanics.rigid_nodes import still_pressures, unknowns_of
from softmodels.mechanics.sheet import Sheet

if TYPE_CHECKING:
    from dolfinx import fem
    from petsc4py import PETSc

Array = npt.NDArray[np.float64]

FORMULATIONS = ("mixed", "displacement")
VOLUME_TOLERANCE = 0.1
"""Of the cavity's volume by its mesh against its closed form: straight edges cost a few percent, and so do three curved ones
around a channel; six of them a part in a thousand."""


@dataclasses.dataclass(frozen=True, eq=False)
class State:
    """A state of equilibrium, dimensionless.

    Attributes:
        w: Local dof values with ghosts, shape (n,): skew displacement components and, if mixed, p; behind them, where
            volumes are held, those cavities' pressures.
        P: Cavity pressure.
        V: Volume of the cavity, of the slice in 3-D; with several cavities what P works on.
        iterations: Newton iterations that led here.
    """

    w: Array
    P: float
    V: float
    iterations: int = 0


class System(Assembly):
    """The discrete equations of a body.

    Args:
        body: Mesh and roles.
        material: Law and parameters; regions among ``parts`` have their own.
        formulation: ``"mixed"`` (P2 displacement, P1 pressure) or ``"displacement"`` (P2).
        sheet: A thin sheet bonded to one of the body's faces.
        obstacle: A rigid plane that stops some of the faces.
        parts: What else is added to it; see `softmodels.mechanics.parts`.

    Attributes:
        potential: What all of it is derived from.
        w: The current state's unknowns; P and ``pressures`` go with it.
        K: Matrix with the pattern of the tangent.
        n: Number of owned dofs; ``dofs`` counts ghosts too.
        still_pressures: Number of p that are held, in rigid regions.
        unknowns: What Newton's method solves for in place of w: vectors of K's size are of these.
        coupling: How the drivers are coupled: the cavities' pressures and volumes, then the dead loads and what they move.
        dead: The dead loads.
        volume_error: Of the cavity's volume by its mesh, against the closed form; nan where there is none.

    Raises:
        BodyError: A cavity whose wall encloses another volume than the device's.
        GeometryError: A cavity that is open.
        MaterialError: An incompressible material in the displacement formulation.
        ObstacleError: A plane that these faces cannot come to rest on.
        PartError: A part that cannot be on this mesh.
    """

    potential_class: type[Potential] = Potential  # one's own may have further terms

    def __init__(
        self,
        body: Body,
        material: Material,
        formulation: str = "mixed",
        sheet: Sheet | None = None,
        obstacle: Obstacle | None = None,
        parts: Sequence[Part] = (),
    ):
        from dolfinx import fem

        if formulation not in FORMULATIONS:
            raise ValueError(f"formulation {formulation!r} is not one of {', '.join(FORMULATIONS)}")
        check_compressible(material, parts, formulation == "mixed")
        self.body, self.formulation, self.sheet, self.comm = clamped(body, parts), formulation, sheet, body.mesh.comm
        if type(body).volume_integrand is Body.volume_integrand:  # one's own integral may close them in its own way
            check_closed(body.actuator, body.openings, self.body.holds)
        self.mixed = formulation == "mixed"
        self.potential = self.potential_class(self.body, material, self.mixed, sheet, obstacle, parts)
        self.space, self.w, self.contact = self.potential.space, self.potential.w, self.potential.contact
        self.set_material(material)
        self.form = functools.partial(fem.form, jit_options=JIT)
        self._compile()
        still = still_pressures(self.body, self.space, parts)
        self.still_pressures = round(total(self.comm, sum(bc.dof_indices()[1] for bc in still)))
        self.bcs = [*conditions(self.body, self.vectors), *still]
        self.assembled = AssembledTerms(self.potential.terms.values(), self.bcs)
        self._whole: PETSc.Mat = matrix_of(self.space, self._products.pattern)
        self.unknowns = unknowns_of(body, self.space, self.bcs, parts)
        self.K: PETSc.Mat = self.unknowns.matrix(self._whole, self._assemble_whole)
        self._vector = fem.Function(self.space)
        self.cells = np.arange(body.mesh.topology.index_map(body.mesh.topology.dim).size_local, dtype=np.int32)
        self.n, self.dofs = self.K.getLocalSize()[0], len(self.w.x.array)
        self.dead = DeadLoads(self, parts)
        self._loads += self.dead.forms
        self.coupling = Coupling.proportional(body.actuator.ratios, np.zeros(len(self.dead.forms)))
        self._set_pressures(0.0, np.empty(0))
        self.dead.check()
        self._check_volume()

    def _compile(self) -> None:
        """Compile the forms. Every term of the potential has its own, added up when assembled: bodies share the law's."""
        import basix
        from dolfinx import fem

        potential, form = self.potential, self.form
        self._volumes = [form(own) for own in potential.volumes]
        self._loads = [[form(load)] for load in potential.loads]
        self._contact_forces = [form(force) for force in potential.contact.forces] if potential.contact else []
        for term in potential.terms.values():
            term.compile(self)
        self._stored = [form(energy) for energy in potential.energies]
        self._internal = [form(force) for force in potential.internal]
        self._products = Products(potential, self._internal, [load for (load,) in self._loads], form)
        self.points, self._weights = basix.make_quadrature(self.body.mesh.basix_cell(), QUADRATURE_DEGREE)
        strain = Strain(self.body.deformation_gradient(potential.displacement))
        self._J = fem.Expression(strain.J, self.points, jit_options=JIT)
        self._densities: fem.Expression | None = None

    def _check_volume(self) -> None:
        """Refuse a cavity whose opening is not closed by planes through the origin: its volume would be another."""
        found, known = self.rest().V * self.volume_unit, self.body.actuator.cavity_volume
        self.volume_error = found / known - 1 if self._volumes else 0.0
        if abs(self.volume_error) > VOLUME_TOLERANCE:
            raise BodyError(
                f"the cavity's wall encloses {found * 1e6:.4g} ml where {known * 1e6:.4g} ml were expected: every face around "
                "the air has to be among its walls, and planes that cut the cavity open have to pass through the origin; a "
                "coarse mesh that cuts curves short needs smaller cells (--cell-size)"
            )

    @property
    def matter(self) -> Sequence[MaterialRegion]:
        """Its materials and where they are."""
        return self.potential.regions

    @property
    def vectors(self) -> fem.FunctionSpace:
        """The displacement's part of the function space."""
        return self.space.sub(0) if self.mixed else self.space

    def set_material(self, material: Material) -> None:
        """Take other values of the same law; nothing is compiled again."""
        self.potential.set_material(material, self.length_unit)
        self.material = material

    @property
    def stress_unit(self) -> float:
        """Pa in one dimensionless stress."""
        return self.material.shear_modulus_0

    @property
    def length_unit(self) -> float:
        """Metres in one dimensionless length."""
        return self.body.actuator.size

    @property
    def volume_unit(self) -> float:
        """m3 of the whole device in one dimensionless volume of the slice."""
        return self.length_unit**3 * self.body.actuator.copies

    # -- the current state --------------------------------------------------------------------------------------------

    def load(self, state: State) -> None:
        """Make ``state`` the current state of the functions."""
        self.w.x.array[:] = state.w[: self.dofs]
        self.unknowns.take(self.w.x.array)
        self.potential.foresee(state.w)
        self._set_pressures(state.P, state.w[self.dofs :])

    def set_iterate(self, owned: Array, scalars: Array) -> None:
        """Make unknowns, P and the held cavities' pressures the current state of the functions."""
        self.unknowns.place(owned, self.w.x.array)
        self.w.x.scatter_forward()
        self._set_pressures(float(scalars[0]), scalars[1:])

    def _set_pressures(self, P: float, multipliers: Array) -> None:
        self.pressures = self.coupling.pressures(P, multipliers)
        self.potential.set_pressures(P, self.coupling, self.pressures)

    def rest(self) -> State:
        """The undeformed state at no pressure."""
        state = State(np.zeros(self.dofs + len(self.coupling.constraints)), 0.0, 0.0)
        self.load(state)
        return dataclasses.replace(state, V=self.volume())

    def drives_at(self, state: State) -> Array:
        """Pressure of each cavity and magnitude of each dead load at a state, shape (k,)."""
        return self.coupling.pressures(state.P, state.w[self.dofs :])

    def pressures_at(self, state: State) -> Array:
        """Pressure of each cavity at a state."""
        return self.drives_at(state)[: len(self._volumes)]

    def volume(self) -> float:
        """What P works on in the current state: a volume, or what a dead load moves."""
        return float(self.coupling.shares @ self.driven())

    def scales(self) -> Array:
        """Scales of what the drivers work on, shape (k,): the cavities' volumes in the current state, and 1 of dead loads."""
        return np.concatenate([self.volumes(), np.ones(len(self.dead.forms))])

    @property
    def drives_cavities(self) -> bool:
        """Whether P is a pressure, and not a dead load's magnitude alone."""
        return bool(self.coupling.shares[: len(self._volumes)].any())

    def driven(self) -> Array:
        """What each driver works on in the current state: the cavities' volumes, then what dead loads move, shape (k,)."""
        return np.concatenate([self.volumes(), self.dead.moved()])

    def volumes(self) -> Array:
        """Volume of each cavity in the current state."""
        return np.array([self.integral(volume) for volume in self._volumes]) + self.body.chambers

    def stored_energy(self) -> float:
        """Energy stored in the body in the current state."""
        return sum(self.integral(form) for form in self._stored) + self.assembled.energy(self.w.x.array)

    def contact_force(self) -> float:
        """Force of the current state on the obstacle, of the slice, dimensionless; 0 without one."""
        return sum((self.integral(form) for form in self._contact_forces), 0.0)

    def smallest_J(self) -> float:
        """Smallest volume ratio at the integration points of the current state."""
        values = self._J.eval(self.body.mesh, self.cells)
        return -largest(self.comm, -float(values.min()) if values.size else -math.inf)

    def point_volumes(self) -> Array:
        """Dimensionless undeformed volumes of the integration points of the owned cells, shape (cells, points)."""
        if self._densities is None:
            import ufl
            from dolfinx import fem

            density = self.body.hoop * abs(ufl.JacobianDeterminant(self.body.mesh))
            self._densities = fem.Expression(density, self.points, jit_options=JIT)
        return self._densities.eval(self.body.mesh, self.cells).reshape(len(self.cells), -1) * self._weights

    def integral(self, form: fem.Form) -> float:
        """Value of a compiled form without arguments, over all ranks."""
        from dolfinx import fem

        return total(self.comm, fem.assemble_scalar(form))
