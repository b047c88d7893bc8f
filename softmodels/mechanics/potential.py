"""The potential of a pressurised body and its derivatives in UFL.

Pi(u, p; P) = int shape(F) + p (J - 1) - p^2 / (2 bulk) dX - P V(u)

Regions in other materials (`mechanics.regions`) have integrals of their own, and p jumps between them (`mechanics.assembly`).
Sheets, contact and other components (`mechanics.component`) are further terms. With several cavities V is
a sum of theirs, and other pressures work on their own volumes (`mechanics.controls`). Residual and tangent are its
derivatives, which include the follower pressure's stiffness and are symmetric. Lengths are in sizes of the device and stresses
in shear moduli.
"""

from __future__ import annotations

import math
import types
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from softmodels.common.lazy import Expr, basix, fem, ufl
from softmodels.materials import laws
from softmodels.materials.laws import Material
from softmodels.mechanics import assembly, component, controls, memory
from softmodels.mechanics.body import Body
from softmodels.mechanics.regions import Regions, constants


class Potential:
    """Pi of a body, with its functions and constants, whose values can change without recompiling.

    Args:
        body: Mesh and roles.
        material: Law and parameters of all but its regions in other materials.
        mixed: Whether p is an unknown, or only displacements.
        components: What else is added to it.

    Attributes:
        space: Function space of the unknowns w.
        displacement: Skew components of the displacement in w.
        P: Cavity pressure.
        parameters: The law's parameters by name, those that are stresses in shear moduli.
        per_pascal: One pascal in shear moduli.
        bulk: Bulk modulus; its inverse if mixed: that may vanish, the bulk may not be infinite.
        regions: Where it is, then the regions in other materials; `stored` begins with an integral for each.
        pressure_dofs: If mixed, the unknown p at the corners of each local cell, one for each region, shape
            (cells, corners, regions), -1 where a region does not reach.
        volumes, loads: Each cavity's volume, and its derivative by w.
        pressures: Each cavity's pressure.
        cavity_volume: What P works on.
        energies: Terms of the stored energy.
        free_energies: What is stored, where that differs: silicone with a memory loses some on the way.
        histories: Of the regions whose silicone has a memory.
        step, before: With any, length in s of the step in time, and the dofs where it begins.
        internal: Their derivatives by w; ``forces`` has the pressures' too.
        terms: Those of further parts, by their labels.
        last_step: With any history, length in s of the last step; 0 where the device changed at once, infinite at the start.
        motion: Inertia; None where the device is followed through equilibria.
    """

    motion: memory.Motion | None = None
    last_step = math.inf

    def __init__(
        self,
        body: Body,
        material: Material,
        mixed: bool,
        components: Sequence[component.Component] = (),
    ):
        # The order in which functions and constants are made is part of a form's name in the kernel cache.
        self.body, self.mixed = body, mixed
        regions = Regions(body, material, components)
        mesh, cell = body.mesh, body.mesh.basix_cell()
        vector = basix.ufl.element("P", cell, 2, shape=(mesh.geometry.dim,))
        element = basix.ufl.mixed_element([vector, basix.ufl.element("P", cell, 1)]) if mixed else vector
        self.space = fem.functionspace(mesh, element)
        if mixed and regions.numbers is not None:
            self.space, self.pressure_dofs = assembly.jumping(self.space, 1, regions.numbers)
        elif mixed:
            self.pressure_dofs = np.array(self.space.sub(1).dofmap.list)[:, :, None]
        self.w = fem.Function(self.space)
        self._test = ufl.TestFunction(self.space)
        self.displacement = self._vector_part(self.w)
        self.P = fem.Constant(mesh, 0.0)
        self.parameters = constants(mesh, material)
        self.bulk = fem.Constant(mesh, 0.0)
        self.volumes = body.volumes(self.displacement)
        self.loads = [ufl.derivative(volume, self.w, self._test) for volume in self.volumes]
        pressures = self._pressures()
        self.direction = fem.Function(self.space)
        self.regions = (regions.main(self.parameters, self.bulk), *regions.others())
        self.histories = self._histories()
        remembered = {history.region.name: history for history in self.histories}
        densities, curved, free = (
            [
                self.density(region.material, region.parameters, region.bulk, getattr(remembered.get(region.name), what, None))
                for region in self.regions
            ]
            for what in ("density", "curved", "free")
        )
        self.energies = self.stored(curved)
        self.per_pascal = fem.Constant(mesh, 1.0)
        setting = component.FormContext(body, self.w, self.displacement, self.per_pascal, component.gravity_of(components))
        self.terms = {part.label: part.term(setting) for part in components if isinstance(part, component.EnergyComponent)}
        added = [energy for term in self.terms.values() for energy in term.energies]
        self.energies += added
        self.free_energies = [*self.stored(free), *added] if self.histories else self.energies
        sloped = [*self.stored(densities), *added] if self.histories else self.energies
        self.internal = [self.unfreeze_history(ufl.derivative(energy, self.w, self._test)) for energy in sloped]
        self.forces = [*self.internal, *([-pressures] if self.volumes else [])]
        # The stress of sheets and fibres predicted from another state, only in Newton's matrix; see `predict_stress`.
        self._known, self._move = (fem.Function(self.space) for _ in range(2))

    def _vector_part(self, w: Expr) -> Expr:
        return ufl.split(w)[0] if self.mixed else w

    def _pressures(self) -> ufl.Form:
        """Return the work of the pressures on a test function; set the conjugate of P."""
        self._cavity_loads: list[tuple[fem.Constant, fem.Constant]] = []  # share of P, and the rest
        if self.body.actuator.ratios == (1.0,):
            self.cavity_volume, self.pressures = self.volumes[0], [self.P]
            return self.P * self.loads[0]
        mesh = self.body.mesh
        self._cavity_loads = [(fem.Constant(mesh, 0.0), fem.Constant(mesh, 0.0)) for _ in self.volumes]
        self.cavity_volume = sum(share * own for (share, _), own in zip(self._cavity_loads, self.volumes, strict=True))
        self.pressures = [share * self.P + rest for share, rest in self._cavity_loads]
        return sum(pressure * load for pressure, load in zip(self.pressures, self.loads, strict=True))

    def pressing(self) -> list[ufl.Form]:
        """Return the forces of a unit pressure on each cavity's walls, see `Body.pressing`."""
        return self.body.pressing(self.displacement, self._vector_part(self._test)) if self.volumes else []

    def _histories(self) -> list[memory.History]:
        """Return the histories of the regions whose silicone has a memory; make what a step begins with."""
        regions = [region for region in self.regions if region.material.memory is not None]
        if not regions:
            return []
        self.step, self.before = fem.Constant(self.body.mesh, 0.0), fem.Function(self.space)
        self._fixed = fem.Function(self.space, self.w.x)
        self._looked_at: npt.NDArray[np.float64] | None = None  # the state that `memory_error` has last looked at in this step
        before, fixed = (self._vector_part(w) for w in (self.before, self._fixed))
        return [memory.History(self.body, region, self.displacement, before, fixed, self.step) for region in regions]

    def density(
        self, law: Material, parameters: types.SimpleNamespace, bulk: Expr, shape: Expr | None = None,
        strain: laws.Strain | None = None,
    ) -> Expr:  # fmt: skip
        """Return a law's energy per reference volume, of anything that carries its parameters by name; or with another energy
        of the change of shape; of a given strain if it is to be derived by that."""
        strain = strain or laws.Strain(self.body.deformation_gradient(self.displacement))
        shape = law.shape(strain, parameters) if shape is None else shape
        if not self.mixed:
            return shape + bulk / 2 * (strain.J - 1) ** 2
        p = ufl.split(self.w)[1]
        return shape + p * (strain.J - 1) - bulk / 2 * p**2

    def stored(self, densities: Sequence[Expr]) -> list[ufl.Form]:
        """Return the integrals of energy densities over the body's regions."""
        regions = zip(densities, self.regions, strict=True)
        return [density * self.body.hoop * region.dx for density, region in regions]

    def tangent(self, trial: Expr) -> list[ufl.Form]:
        """Return the derivatives of the forces along a trial function, one for each; of sheets and fibres with
        predicted stress."""
        forces = self.forces
        if self.histories:
            curved = [ufl.derivative(energy, self.w, self._test) for energy in self.energies]
            forces = [*curved, *forces[len(curved) :]]
        tangents = [self.unfreeze_history(ufl.derivative(force, self.w, trial)) for force in forces]
        for number, predicted in self.predicted_tangents(trial).items():
            tangents[number] = predicted
        return tangents

    def unfreeze_history[T: (ufl.Form, Expr)](self, of: T) -> T:
        """Return a form or expression with w in place of what its derivatives took for a constant: kernels compute it once
        then."""
        from ufl.algorithms import expand_derivatives, replace

        return replace(expand_derivatives(of), {self._fixed: self.w}) if self.histories else of

    def predicted_tangents(self, trial: Expr) -> dict[int, ufl.Form]:
        """Return those of `tangent` that are not second derivatives of their energies, by index."""
        tangents: dict[int, ufl.Form] = {}
        y = self._vector_part(self._known)
        at, mixed_points = len(self.regions), component.MixedPointStress(self._known, y, self._move, self._test, trial)
        for term in self.terms.values():
            if (seconds := term.tangent(mixed_points)) is not None:
                tangents |= dict(enumerate(seconds, at))
            at += len(term.energies)
        return tangents

    def is_admissible(self, before: npt.NDArray[np.float64], after: npt.NDArray[np.float64]) -> bool:
        """Return whether a step from one state's w to another's is admissible: no wall passes through an
        obstacle."""
        return all(term.is_admissible(before, after) for term in self.terms.values())

    def update_lagged(self, w: npt.NDArray[np.float64]) -> bool:
        """Adjust to a state's w what solves take as given; return whether that has changed by as much as matters."""
        changed = [term.update_lagged(w) for term in self.terms.values()]
        return any(changed)

    def commit(self, w: npt.NDArray[np.float64], reset: bool = False) -> None:
        """Accept a converged state's w; see `softmodels.mechanics.component.EnergyTerm.commit`."""
        for term in self.terms.values():
            term.commit(w, reset)
        if self.motion:
            self.motion.commit(w, reset)
        if self.histories:
            self._remember(w, reset)

    @property
    def remembers(self) -> bool:
        """Whether its forces depend on earlier states."""
        return bool(self.histories) or self.motion is not None or any(term.remembers for term in self.terms.values())

    def pass_time(self, step: float) -> None:
        """Begin a step of this length in s from the last accepted state; 0 where nothing remembers."""
        if self.motion:
            self.motion.begin(step)
        if not self.histories:
            return
        self.step.value, self._looked_at = step, None
        for history in self.histories:
            history.prepare()

    def memory_error(self, w: npt.NDArray[np.float64]) -> tuple[float, float]:
        """Return the error of the stress by the length of a step that ends in w, and the largest stress, in shear moduli."""
        if not self.histories:
            return 0.0, 0.0
        self.w.x.array[:], self._looked_at = w[: len(self.w.x.array)], w
        trials = [history.trial() for history in self.histories]
        return max(error for error, _ in trials), max(size for _, size in trials)

    def _remember(self, w: npt.NDArray[np.float64], reset: bool) -> None:
        """Let the silicone remember an accepted state; from here on no time passes until `pass_time`."""
        here = self.w.x.array.copy()
        self.w.x.array[: len(w)] = w[: len(here)]
        self.last_step = math.inf if reset else float(self.step.value)
        if not reset and w is not self._looked_at:  # by identity, which is the same on all ranks
            self.memory_error(w)
        for history in self.histories:
            if reset:
                history.begin()
            else:
                history.advance()
        self.before.x.array[:] = self.w.x.array
        self.pass_time(0.0)
        self.w.x.array[:] = here

    def checkpoint(self, *more: component.HistoryDependent) -> component.Checkpoint:
        """Save all that depends on earlier states: friction, motion, what the silicone remembers, and more of that."""
        parts: list[component.HistoryDependent] = [
            term for term in self.terms.values() if isinstance(term, assembly.RememberingTerm)
        ]
        parts += [self.motion] if self.motion else []
        parts += [self, *self.histories] if self.histories else []
        return component.Checkpoint([*parts, *more])

    def save(self) -> tuple[npt.NDArray[np.float64], float]:
        """Return where the step begins, and the length of the step that led there."""
        return self.before.x.array.copy(), self.last_step

    def restore(self, saved: tuple[npt.NDArray[np.float64], float]) -> None:
        self.before.x.array[:], self.last_step = saved
        self.step.value, self._looked_at = 0.0, None

    @property
    def relaxation(self) -> float:
        """The shortest relaxation time in s; infinite without any."""
        memories = [history.region.material.memory for history in self.histories]
        return min((memory.shortest for memory in memories if memory), default=math.inf)

    @property
    def kinetic(self) -> float:
        """Kinetic energy, dimensionless."""
        return self.motion.kinetic if self.motion else 0.0

    @property
    def dissipated(self) -> float:
        """Energy that the silicone has dissipated, dimensionless."""
        return sum(history.dissipated for history in self.histories)

    # -- values -------------------------------------------------------------------------------------------------------

    def set_material(self, material: Material, others: Mapping[str, Material] = MappingProxyType({})) -> None:
        """Set other parameters of the same law, and of those of regions by their names."""
        mu = material.shear_modulus_0
        for region in self.regions:
            region.take(others.get(region.name, region.material) if region.name else material, mu, self.mixed)
        for history in self.histories:
            history.take(history.region.material, mu)
        self.per_pascal.value = 1 / mu

    def set_pressures(self, P: float, coupling: controls.Coupling, pressures: npt.NDArray[np.float64]) -> None:
        """Set the pressure P, and the coupled pressures of the cavities."""
        # A single cavity's own pressure may be constant while P is a dead load's.
        self.P.value = P if self._cavity_loads or not self.volumes else pressures[0]
        for i, (share, rest) in enumerate(self._cavity_loads):
            share.value = coupling.shares[i]
            rest.value = pressures[i] - P * coupling.shares[i]

    @property
    def predicted_stiffness(self) -> float:
        """Largest stiffness, in shear moduli, of the terms with predicted stress in Newton's matrix; 0 if none."""
        per_pascal = float(self.per_pascal.value)
        return max([0.0, *(term.stiffness * per_pascal for term in self.terms.values())])

    def predict_stress(self, known: npt.NDArray[np.float64], ahead: bool = True) -> None:
        """Predict the stress of sheets and fibres in the current state to first order from another state's dofs ``known``.

        A stiff sheet that is rotated slightly too far is stretched by the square of that, which at once exceeds all other
        stresses. With this stress in its matrix Newton's method would need ever smaller steps. The stress predicted by the
        equations linearised at the previous iterate does not contain it; at a converged state both are the same. This is
        the mixed integration point method: Leonetti, Magisano, Madeo, Garcea, Kiendl, Reali 2019, A simplified
        Kirchhoff-Love large deformation model for elastic shells, Comput. Methods Appl. Mech. Eng.

        Args:
            known: Local dofs of that state; what follows them is not read.
            ahead: Whether the stress is predicted from there to the current state, or is that state's own.
        """
        if self.predicted_stiffness:
            here = self.w.x.array
            self._known.x.array[:] = known[: len(here)]
            self._move.x.array[:] = here - known[: len(here)] if ahead else 0.0
