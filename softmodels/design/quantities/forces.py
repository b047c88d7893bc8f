"""Forces and stiffnesses of the whole device."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from softmodels.common.arrays import Array
from softmodels.design.quantities.base import DesignQuantity, FormMeasure, Measure, Slopes, register_quantity, scaled
from softmodels.mechanics.body import in_section

if TYPE_CHECKING:
    from dolfinx import fem

    from softmodels.design.body import DesignedBody
    from softmodels.mechanics.system import State


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class BlockedForce(DesignQuantity):
    """Blocked force along the lift at the device's held tip."""

    name: ClassVar = "blocked_force"
    unit: ClassVar = "N"
    help: ClassVar = "blocked force of the whole device along its lift at its held tip"

    def measure(self, design: DesignedBody) -> Measure:
        import ufl

        system = design.system
        actuator, potential = system.body.actuator, system.potential
        if actuator.blocked is None:
            raise ValueError("the device's tip is free, so it has no blocked force; hold it (a slab's tip = 'held')")
        along = _moved_role(design, actuator.blocked)
        # The virtual work of a unit motion of the support equals the residual there.
        forms = [-ufl.action(force, along) for force in potential.forces]
        unit = system.length_unit**2 * actuator.copies
        pressures = [ufl.action(load, along) for load in potential.loads]
        return FormMeasure(design, forms, scaled(unit), counted_in_stress=True, by_pressure=pressures)


def _moved_role(design: DesignedBody, role: str) -> fem.Function:
    """Return the dofs of a unit motion of a role along the lift, zero elsewhere."""
    from dolfinx import fem

    system = design.system
    component = int(np.argmax(system.body.skew @ in_section(system.body.actuator.lift, system.body.actuator.dimension)))
    dimension, found = system.body.entities[role]
    along = fem.Function(system.space)
    along.x.array[fem.locate_dofs_topological(system.vectors.sub(component), dimension, found)] = 1.0
    return along


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class Stiffness(DesignQuantity):
    """Force along the lift, spread over the loaded face, per rise of it at a given pressure."""

    name: ClassVar = "stiffness"
    unit: ClassVar = "N/m"
    help: ClassVar = "force along the lift on the loaded face (a slab's tip), per rise of it, at constant pressure"

    def measure(self, design: DesignedBody) -> Measure:
        if design.system.body.actuator.pushed is None:
            raise ValueError("the device defines no loaded face, so it has no stiffness")
        return _StiffnessMeasure(design)


class _StiffnessMeasure(Measure):
    """One over the compliance c = 2 l.z - z.K z of a load l, whose answer is z = K^-1 l.

    To first order c does not change with z, so only the changes of l and of K count, those by the state among them.
    """

    def __init__(self, design: DesignedBody):
        import ufl
        from dolfinx import fem

        self.design, self.system = design, design.system
        system, body, potential = design.system, design.system.body, design.system.potential
        role = body.actuator.pushed
        assert role is not None
        self._role = role
        self._z = fem.Function(system.space)
        on_face, _ = body.sheet_face(role)
        along = fem.Constant(body.mesh, in_section(body.actuator.lift, body.actuator.dimension))
        moved = ufl.split(self._z)[0] if system.mixed else self._z
        forms = [
            ufl.dot(along, body.displacement(moved)) * body.hoop * on_face,
            fem.Constant(body.mesh, 1.0) * body.hoop * on_face,
            *(ufl.action(ufl.derivative(force, system.w, self._z), self._z) for force in potential.forces),
        ]
        turned = [-ufl.action(ufl.derivative(load, system.w, self._z), self._z) for load in potential.loads]
        self._measure = FormMeasure(design, forms, self._stiffness, counted_in_stress=True, by_pressure=turned)

    def _stiffness(self, values: Array) -> tuple[float, Array]:
        work, area, energy = values[0], values[1], float(values[2:].sum())
        compliance = 2 * work / area - energy
        value = self.system.length_unit * self.system.body.actuator.copies / compliance
        slopes = np.concatenate([[2 / area, -2 * work / area**2], np.full(len(values) - 2, -1.0)])
        return value, -value / compliance * slopes

    def slopes(self, state: State | None) -> Slopes:
        system = self.system
        load = self.design.face_load(self._role)
        system.unknowns.push(self.design.answer(load), self._z.x.array)
        self._z.x.scatter_forward()
        return self._measure.slopes(state)
