"""The potential of a pressurised body and its derivatives in UFL.

Pi(u, p; P) = int shape(F) + p (J - 1) - p^2 / (2 bulk) dX - P V(u)

A bonded sheet, a plane that stops faces and further parts (`mechanics.parts`) are further terms. With several cavities V is
a sum of theirs, and others' pressures work on their own volumes (`mechanics.coupling`). Residual and tangent are its
derivatives, so the follower pressure's stiffness and the symmetry come along. Lengths are in sizes of the device and stresses
in shear moduli.
"""

from __future__ import annotations

import dataclasses
import types
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.materials.laws import Material
from softmodels.materials.strain import Strain
from softmodels.mechanics.body import Body
from softmodels.mechanics.contact import Contact, Obstacle
from softmodels.mechanics.coupling import Coupling
from softmodels.mechanics.parts import EnergyPart, Part, Setting
from softmodels.mechanics.sheet import Sheet, membrane_energy, membrane_stress, membrane_tangent, surface_metric

if TYPE_CHECKING:
    import ufl
    from dolfinx import fem, mesh
    from ufl.core.expr import Expr


class Potential:
    """Pi of a body of one material, with the functions and constants in it: other values of these compile nothing.

    Args:
        body: Mesh and roles.
        material: Law and parameters.
        mixed: Whether p is an unknown, or displacements alone.
        sheet: A thin sheet bonded to one of the body's faces.
        obstacle: A rigid plane that stops some of the faces.
        parts: What else is added to it.

    Attributes:
        space: Function space of the unknowns w.
        displacement: Skew components of the displacement in w.
        P: Cavity pressure.
        parameters: The law's parameters by name, those that are stresses in shear moduli.
        per_pascal: One pascal in shear moduli.
        bulk: Bulk modulus; its inverse if mixed: that may vanish, the bulk may not be infinite.
        volumes, loads: Each cavity's volume, and its derivative by w.
        cavity_volume: What P works on.
        energies: Terms of the stored energy.
        internal: Their derivatives by w; ``forces`` has the pressures' too.
        contact: The plane's terms, if there is one.
        terms: Those of further parts, by their labels.
    """

    def __init__(
        self,
        body: Body,
        material: Material,
        mixed: bool,
        sheet: Sheet | None,
        obstacle: Obstacle | None,
        parts: Sequence[Part] = (),
    ):
        import basix.ufl
        import ufl
        from dolfinx import fem

        # The order in which functions and constants are made is part of a form's name in the cache of compiled ones.
        self.body, self.mixed, self.sheet, self._law = body, mixed, sheet, material
        mesh, cell = body.mesh, body.mesh.basix_cell()
        vector = basix.ufl.element("P", cell, 2, shape=(mesh.geometry.dim,))
        element = basix.ufl.mixed_element([vector, basix.ufl.element("P", cell, 1)]) if mixed else vector
        self.space = fem.functionspace(mesh, element)
        self.w = fem.Function(self.space)
        self._test = ufl.TestFunction(self.space)
        self.displacement = self._vector_part(self.w)
        self.P = fem.Constant(mesh, 0.0)
        self.parameters = _constants(mesh, material)
        self.sheet_stiffness = fem.Constant(mesh, 0.0)
        self.bulk = fem.Constant(mesh, 0.0)
        self.volumes = body.volumes(self.displacement)
        self.loads = [ufl.derivative(volume, self.w, self._test) for volume in self.volumes]
        pressures = self._pressures()
        self.direction = fem.Function(self.space)
        self.energies = self.stored(self.density(self.parameters, self.bulk), self.sheet_stiffness)
        self.contact = None if obstacle is None else Contact(obstacle, body, self.displacement)
        if self.contact is not None:
            self.energies += self.contact.energies
        self.per_pascal = fem.Constant(mesh, 1.0)
        setting = Setting(body, self.w, self.displacement, self.per_pascal)
        self.terms = {part.label: part.term(setting) for part in parts if isinstance(part, EnergyPart)}
        self.energies += [energy for term in self.terms.values() for energy in term.energies]
        self.internal = [ufl.derivative(energy, self.w, self._test) for energy in self.energies]
        self.forces = [*self.internal, *([-pressures] if self.volumes else [])]
        # The stress of a sheet as it is foreseen from another state, in Newton's matrix alone; see `foresee`.
        self._known, self._move = (fem.Function(self.space) for _ in range(2))

    def _vector_part(self, w: Expr) -> Expr:
        import ufl

        return ufl.split(w)[0] if self.mixed else w

    def _pressures(self) -> ufl.Form:
        """Work of the pressures on a test function; sets what P works on."""
        from dolfinx import fem

        self._cavity_loads: list[tuple[fem.Constant, fem.Constant]] = []  # share of P, and the rest
        if self.body.actuator.ratios == (1.0,):
            self.cavity_volume = self.volumes[0]
            return self.P * self.loads[0]
        mesh = self.body.mesh
        self._cavity_loads = [(fem.Constant(mesh, 0.0), fem.Constant(mesh, 0.0)) for _ in self.volumes]
        self.cavity_volume = sum(share * own for (share, _), own in zip(self._cavity_loads, self.volumes, strict=True))
        return sum(
            (share * self.P + rest) * load for (share, rest), load in zip(self._cavity_loads, self.loads, strict=True)
        )

    def density(self, parameters: types.SimpleNamespace, bulk: Expr) -> Expr:
        """Energy per reference volume, of anything that carries the law's parameters by name."""
        import ufl

        strain = Strain(self.body.deformation_gradient(self.displacement))
        shape = self._law.shape(strain, parameters)
        if not self.mixed:
            return shape + bulk / 2 * (strain.J - 1) ** 2
        p = ufl.split(self.w)[1]
        return shape + p * (strain.J - 1) - bulk / 2 * p**2

    def stored(self, density: Expr, stiffness: Expr) -> list[ufl.Form]:
        """Integrals of an energy density over the body and, if one is bonded, of a sheet of this stiffness."""
        inside = density * self.body.hoop * self.body.measures()[0]
        if self.sheet is None:
            return [inside]
        on_face, normal = self.body.sheet_face(self.sheet.face)
        membrane = membrane_energy(self.body.deformation_gradient(self.displacement), normal)
        return [inside, stiffness * membrane * self.body.hoop * on_face]

    def tangent(self, trial: Expr) -> list[ufl.Form]:
        """Derivatives of the forces along a trial function, one for each; that of a sheet with its stress foreseen."""
        import ufl

        found = [ufl.derivative(force, self.w, trial) for force in self.forces]
        if self.sheet is not None:
            on_face, normal = self.body.sheet_face(self.sheet.face)
            y = self._vector_part(self._known)
            C, known = (surface_metric(self.body.deformation_gradient(u), normal) for u in (self.displacement, y))
            stress = membrane_stress(known)
            foreseen = stress + ufl.derivative(stress, self._known, self._move)
            density = membrane_tangent(C, self.w, foreseen, self._test, trial)
            found[1] = self.sheet_stiffness * density * self.body.hoop * on_face
        return found

    def admits(self, before: npt.NDArray[np.float64], after: npt.NDArray[np.float64]) -> bool:
        """Whether the device may go from one state's w to another's in one step: no wall passes through what stops it."""
        return all(term.admits(before, after) for term in self.terms.values())

    # -- values -------------------------------------------------------------------------------------------------------

    def set_material(self, material: Material, length_unit: float) -> None:
        """Take other values of the same law."""
        mu = material.shear_modulus_0
        for field in dataclasses.fields(material):
            value = np.asarray(getattr(material, field.name), dtype=float)
            getattr(self.parameters, field.name).value = value / mu if field.metadata["unit"] == "Pa" else value
        if self.sheet is not None:
            self.sheet_stiffness.value = self.sheet.stiffness / (mu * length_unit)
        self.per_pascal.value = 1 / mu
        self.bulk.value = mu / material.bulk if self.mixed else material.bulk / mu

    def set_pressures(self, P: float, coupling: Coupling, pressures: npt.NDArray[np.float64]) -> None:
        """Take the pressure P, and those of the cavities that a coupling makes of it."""
        # Of one cavity its own pressure: it may be kept while P is a dead load's.
        self.P.value = P if self._cavity_loads or not self.volumes else pressures[0]
        for i, (share, rest) in enumerate(self._cavity_loads):
            share.value = coupling.shares[i]
            rest.value = pressures[i] - P * coupling.shares[i]

    def foresee(self, known: npt.NDArray[np.float64], ahead: bool = True) -> None:
        """Foresee a sheet's stress in the current state to first order from another state's dofs ``known``.

        A stiff sheet that is turned a little too far is stretched by the square of that, and so has at once more stress than
        all the rest bears. With this stress in its matrix Newton's method would need ever smaller steps. The stress that the
        equations linearised at the iterate before foretold has nothing of it; at a solved state both are the same. This is
        the mixed integration point method: Leonetti, Magisano, Madeo, Garcea, Kiendl, Reali 2019, A simplified
        Kirchhoff-Love large deformation model for elastic shells, Comput. Methods Appl. Mech. Eng.

        Args:
            known: Local dofs of that state; what follows them is not read.
            ahead: Whether the stress is foreseen from there to the current state, or is that state's own.
        """
        if self.sheet is not None:
            here = self.w.x.array
            self._known.x.array[:] = known[: len(here)]
            self._move.x.array[:] = here - known[: len(here)] if ahead else 0.0


def _constants(mesh: mesh.Mesh, material: Material) -> types.SimpleNamespace:
    """UFL constants under the material's parameter names."""
    from dolfinx import fem

    return types.SimpleNamespace(
        **{
            field.name: fem.Constant(mesh, np.asarray(getattr(material, field.name), dtype=float))
            for field in dataclasses.fields(material)
        }
    )
