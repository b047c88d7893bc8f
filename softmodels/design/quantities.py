"""Quantities of designs: a name, a unit, and the evaluation on a meshed device; `QUANTITIES` lists them by name.

A subclass of `DesignQuantity` with a name is a quantity that problem files may name, also in other modules.
"""

from __future__ import annotations

import abc
import contextlib
import dataclasses
import functools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, ClassVar, dataclass_transform

import numpy as np
import numpy.typing as npt

from geometries import Actuator, GeometryError, actuator
from softmodels.common import names, units
from softmodels.common.arrays import Array
from softmodels.common.lazy import Expr, PETSc, fem, ufl
from softmodels.components import contact
from softmodels.design import trials
from softmodels.materials import laws
from softmodels.mechanics import assembly, compiling, mpi, sensitivity
from softmodels.mechanics.body import BodyError, in_section, in_space
from softmodels.mechanics.component import ComponentError, direction
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import face_load
from softmodels.runs import fields, state_values

if TYPE_CHECKING:
    from collections.abc import Mapping

    from softmodels.mechanics.component import Component
    from softmodels.mechanics.system import State


@dataclasses.dataclass(frozen=True, eq=False)
class Slopes:
    """A quantity at a state in SI units, and its partial derivatives: w by the owned unknowns of the state, shape (n,), or
    None; P by the dimensionless pressure; X by the dimensionless places of the mesh's nodes at fixed unknowns, flat over
    `MeshMotion.space`, or None. The note says how far the value can be trusted."""

    value: float
    w: Array | None = None
    P: float = 0.0
    X: Array | None = None
    note: str = ""


class Measure(abc.ABC):
    """A quantity prepared on a meshed device, with its compiled forms."""

    @abc.abstractmethod
    def slopes(self, state: State | None) -> Slopes:
        """Return value and derivatives; the state is loaded into the equations. None if it needs no state."""

    def value(self, state: State | None) -> float:
        """Return only the value, after `slopes` on this mesh."""
        return self.slopes(state).value

    def by_history(self, histories: Sequence[sensitivity.HistoryDirection]) -> float:
        """Return the derivative at the loaded state along directions in which what is remembered changes; see
        `Sensitivity.histories`. Most quantities are of the state alone."""
        return 0.0


class TargetMeasure(Measure):
    """Distances from a target, whose errors have a correlation length in points (``run``) and a standard error in SI units
    (``sigma``, 0 where it is not known)."""

    run: float = 1.0
    sigma: float = 0.0

    @abc.abstractmethod
    def residuals(self, state: State) -> Array:
        """Return the distances in SI units, shape (k,)."""

    @abc.abstractmethod
    def moved(self, state: State, w: Array, X: Array) -> Array:
        """Return the derivative of the distances, shape (k,), at the loaded state from those of its dof values and of the
        mesh's dimensionless nodes, shape (nodes of `MeshMotion.space`, d), both with ghosts."""


PROBE = "probe or figure"
"""What a quantity's ``of`` names unless it says otherwise."""


@dataclass_transform(frozen_default=True, kw_only_default=True)
@dataclasses.dataclass(frozen=True, kw_only=True)
class DesignQuantity(abc.ABC):
    """A quantity of a design, at the state of a `Load` or a pressure in Pa.

    Every subclass is a dataclass of this kind; ``class Rise(DesignQuantity, name="rise", unit="m")`` registers it by its name.
    """

    name: ClassVar[str]
    unit: ClassVar[str]
    """SI unit of its values; "1" for a pure number."""
    of_state: ClassVar[bool] = True
    """Whether it belongs to a state, so that ``at`` is required."""

    def __init_subclass__(cls, *, name: str = "", unit: str = "") -> None:
        super().__init_subclass__()
        dataclasses.dataclass(frozen=True, kw_only=True)(cls)
        if unit:
            cls.unit = unit
        if name:
            cls.name = name
            QUANTITIES.register(cls)

    at: trials.EvaluatedLoad | float | None = None

    def __post_init__(self) -> None:
        if self.at is not None:
            object.__setattr__(self, "at", trials.EvaluatedLoad.of(self.at))

    @property
    def load(self) -> trials.EvaluatedLoad | None:
        """The state at which it is evaluated."""
        return None if self.at is None else trials.EvaluatedLoad.of(self.at)

    @property
    def title(self) -> str:
        """Its title without its load, as in ``rise of tip``."""
        return self.name.replace("_", " ")

    @property
    def key(self) -> str:
        """Unique text, as in ``rise of tip at 16.84 kPa``."""
        return self.title if self.at is None else f"{self.title} at {self.load}"

    @staticmethod
    def named(device: Actuator, components: Sequence[Component]) -> tuple[str, list[str]]:
        """Return what its ``of`` may name, in words, and the names that a device with its parts has."""
        return PROBE, [*device.probes, *device.figure_columns.values()]

    @abc.abstractmethod
    def measure(self, design: DesignedBody) -> Measure:
        """Prepare it on a meshed device; raise ValueError with a message if the device does not have it."""


def length(what: str, value: float | str) -> float:
    """Return a length in m from a number or a text with a unit; ValueError unless it is one that is not negative."""
    length = units.quantity(value, "m") if isinstance(value, str) else float(value)
    if not (np.isfinite(length) and length >= 0.0):
        raise ValueError(f"{what} is {value!r}; it must be a length above zero, or 0 for none")
    return length


# ----------------------------------------------------------------------------------------------------------------------
# Quantities that are functions of integrals over the body, with values and derivatives from UFL forms.


Combine = Callable[[Array], tuple[float, Array]]
"""Value of a function of integrals, and its slopes by them."""


class FormMeasure(Measure):
    """A function of integrals, in shear moduli if ``counted_in_stress``: of UFL forms without arguments, those of the state
    functions of `System.w`. ``combine`` gives the function and its slopes; ``by_pressure`` are dimensionless derivatives of
    the last forms' sum by the pressures of the cavities."""

    def __init__(
        self, design: DesignedBody, forms: Sequence[ufl.Form], combine: Combine, *,
        counted_in_stress: bool = False, by_pressure: Sequence[ufl.Form] = (),
    ):  # fmt: skip
        self.design, self.combine, self.counted_in_stress = design, combine, counted_in_stress
        system, form = design.system, design.system.form
        self._forms = [form(integral) for integral in forms]
        test = ufl.TestFunction(system.space)
        self._slopes = [
            form(ufl.derivative(integral, system.w, test)) if system.w in integral.coefficients() else None
            for integral in forms
        ]
        self._by_pressure = [form(integral) for integral in by_pressure]
        self._covectors = [design.motion.compiled(integral) for integral in forms]

    def _combined(self) -> tuple[float, Array]:
        """Return the value in SI units and its slopes by the integrals."""
        system = self.design.system
        unit = system.stress_unit if self.counted_in_stress else 1.0
        value, rates = self.combine(np.array([system.integral(form) for form in self._forms]))
        return unit * value, unit * rates

    def value(self, state: State | None) -> float:
        return self._combined()[0]

    def slopes(self, state: State | None) -> Slopes:
        system = self.design.system
        value, rates = self._combined()
        by_w: Array | None = None
        by_X = np.zeros(self.design.motion.entries)
        for rate, slope, covector in zip(rates, self._slopes, self._covectors, strict=True):
            if slope is not None:
                part = rate * system.assemble([slope])
                by_w = part if by_w is None else by_w + part
            by_X += rate * self.design.motion.assembled(covector)
        by_P = sum(
            (share * system.integral(form) for share, form in zip(system.coupling.shares, self._by_pressure, strict=False)), 0.0
        )
        return Slopes(value, by_w, float(rates[-1] * by_P), by_X, self.note(value))

    def note(self, value: float) -> str:
        """Return a warning on the value, or ""."""
        return ""


def scaled(factor: float) -> Combine:
    """Return the sum of the integrals times a factor."""
    return lambda values: (factor * float(values.sum()), np.full(len(values), factor))


class WithContact(Measure):
    """A measure of forms plus the energy of contact that is no form; the unit of energies is SI units over shear moduli."""

    def __init__(self, design: DesignedBody, forms: FormMeasure, unit: float):
        self.design, self.forms, self.unit = design, forms, unit

    def value(self, state: State | None) -> float:
        system = self.design.system
        own = self.unit * system.stress_unit * system.assembled.energy(system.w.x.array)
        return self.forms.value(state) + own

    def slopes(self, state: State | None) -> Slopes:
        slopes, system = self.forms.slopes(state), self.design.system
        if not system.assembled.slack:
            return slopes
        unit, w, motion = self.unit * system.stress_unit, system.w.x.array, self.design.motion
        b = system.assembled.add_forces(w, np.zeros(system.n))
        by_w = unit * system.by_unknowns(b)
        by_X = unit * motion.by_nodes(system.assembled.at_places(w, len(system.body.mesh.geometry.x)))
        assert slopes.X is not None
        return dataclasses.replace(
            slopes, value=self.value(state), w=by_w if slopes.w is None else slopes.w + by_w, X=slopes.X + by_X
        )


def energy_measure(design: DesignedBody) -> Measure:
    """Return the energy stored in the whole device and its contact, in J."""
    system = design.system
    unit = system.volume_unit
    return WithContact(design, FormMeasure(design, design.energies, scaled(unit), counted_in_stress=True), unit)


QUANTITIES: names.Registry[type[DesignQuantity]] = names.Registry(
    "quantity",
    lambda quantity: quantity.name,
    {
        name: f"softmodels.design.{place}"
        for place, names in {
            "extremes": "peak_stretch max_stretch peak_von_mises von_mises least_gap top_height stress_deviation "
            "stress_unevenness von_mises_norm stretch_norm",
            "targets": "outline tip_path pose",
            "surfaces": "surface",
        }.items()
        for name in names.split()
    },
)
"""Every known quantity by its name in problem files."""


# ----------------------------------------------------------------------------------------------------------------------
# Quantities of the undeformed device: manufacturing constraints.


LENGTH_STEP = 1e-6
"""Step of the central differences, relative to the device's size, or to 1."""


class DeviceQuantity(DesignQuantity):
    """A quantity that depends only on the device's parameters."""

    of_state: ClassVar = False

    @abc.abstractmethod
    def values(self, device: Actuator) -> dict[str, float]:
        """Return the values by key, the same keys for every design."""

    def derivatives(self, device: Actuator, names: Sequence[str]) -> dict[str, Array]:
        """Return the derivatives of the values by parameters, by key: central differences, one-sided at the limits of
        valid devices."""
        here, columns = self.values(device), []
        for name in names:
            step = LENGTH_STEP * (device.size if actuator.is_length(device, name) else 1.0)
            ends = []
            for shift in (step, -step):
                with contextlib.suppress(GeometryError):
                    ends.append(
                        (shift, self.values(actuator.changed(device, {name: actuator.parameter(device, name) + shift})))
                    )
            (a, high), (b, low) = (*ends, (0.0, here), (math.inf, here))[:2]
            columns.append([(high[key] - low[key]) / (a - b) for key in here])
        return dict(zip(here, np.array(columns).T.reshape(len(here), len(names)), strict=True))

    def measure(self, design: DesignedBody) -> Measure:
        raise TypeError("a quantity of only the device needs no mesh")


class Clearances(DeviceQuantity, name="clearances", unit="m"):
    """Width of every wall and channel with a minimum."""

    def values(self, device: Actuator) -> dict[str, float]:
        return {f"clearance: {name}": value for name, value in device.clearances.items()}


# ----------------------------------------------------------------------------------------------------------------------
# Volumes, energies and masses.


class AddedVolume(DesignQuantity, name="added_volume", unit="m3"):
    """Volume that the whole device's cavity has gained."""

    def measure(self, design: DesignedBody) -> Measure:
        system = design.system
        unit = system.volume_unit * design.direction * design.sign
        return FormMeasure(
            design,
            [system.potential.cavity_volume, design.rest_volume],
            lambda values: (unit * float(values[0] - values[1]), unit * np.array([1.0, -1.0])),
        )


class StoredEnergy(DesignQuantity, name="stored_energy", unit="J"):
    """Energy stored in the whole device."""

    def measure(self, design: DesignedBody) -> Measure:
        return energy_measure(design)


class Mass(DesignQuantity, name="mass", unit="kg"):
    """Mass of the silicone of the whole device.

    Attributes:
        density: kg/m3; common silicones have 1040 to 1130.
    """

    of_state: ClassVar = False

    density: float = 1070.0

    def measure(self, design: DesignedBody) -> Measure:
        body = design.system.body
        # A constant 1, because UFL cannot find the mesh of a form with numbers only.
        solid = fem.Constant(body.mesh, 1.0) * body.hoop * body.measures()[0]
        return FormMeasure(design, [solid], scaled(self.density * design.system.volume_unit))


# ----------------------------------------------------------------------------------------------------------------------
# Positions of named points: rises, coordinates, and figures of a device derived from them.


DIFFERENCE_STEP = 1e-5
"""Step of the central differences of a device's figures by probe positions, relative to the size."""


class PlacesMeasure(Measure):
    """A function of places and displacements of the named probes, device coordinates in m, each shape (3,)."""

    def __init__(
        self, design: DesignedBody, names: tuple[str, ...],
        function: Callable[[Mapping[str, Array], Mapping[str, Array]], float],
    ):  # fmt: skip
        self.design, self.names, self.function = design, names, function

    def slopes(self, state: State | None) -> Slopes:
        probes = self.design.probes
        rest = {name: probes.place(name) for name in self.names}
        moved = {name: probes.displacement(name) for name in self.names}
        by_w = np.zeros(self.design.system.n)
        by_X = np.zeros(self.design.motion.entries)
        step = DIFFERENCE_STEP * self.design.system.length_unit
        for name in self.names:
            by_place, by_displacement = np.zeros(3), np.zeros(3)
            for axis in range(3):
                shift = step * np.eye(3)[axis]
                by_place[axis], by_displacement[axis] = (
                    (
                        self.function(*_shifted_probe(rest, moved, which, name, shift))
                        - self.function(*_shifted_probe(rest, moved, which, name, -shift))
                    )
                    / (2 * step)
                    for which in (0, 1)
                )
            probes.add(by_w, by_X, name, by_place, by_displacement)
        return Slopes(self.function(rest, moved), self.design.system.by_unknowns(by_w).copy(), 0.0, by_X)


def _shifted_probe(
    rest: dict[str, Array], moved: dict[str, Array], which: int, name: str, shift: Array
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return the places and displacements with one probe's place (0) or displacement (1) shifted."""
    sides = [dict(rest), dict(moved)]
    sides[which][name] = sides[which][name] + shift
    return sides[0], sides[1]


def _probe(design: DesignedBody, name: str) -> str:
    """Return the probe's name; the device's own first one if empty."""
    known = design.system.body.actuator.probes
    if not name:
        return design.system.body.actuator.gauge
    if name not in known:
        raise ValueError(f"the device has no probe {name!r}; it has {', '.join(known)}")
    return name


class OfProbe(DesignQuantity, unit="m"):
    """A coordinate of a probe (the device's first one if empty), or of its displacement."""

    from_rest: ClassVar = False
    """Whether only the displacement counts."""

    of: str = ""

    @property
    def title(self) -> str:
        return f"{self.name} of {self.of}" if self.of else self.name

    def along(self, device: Actuator) -> Array:
        """Return the direction of the coordinate, shape (3,)."""
        return np.asarray(device.lift)

    def measure(self, design: DesignedBody) -> Measure:
        name, way = _probe(design, self.of), self.along(design.system.body.actuator)
        share = 0.0 if self.from_rest else 1.0
        return PlacesMeasure(design, (name,), lambda rest, moved: float((share * rest[name] + moved[name]) @ way))


class Rise(OfProbe, name="rise"):
    """Displacement of a probe along the lift."""

    from_rest: ClassVar = True


class Height(OfProbe, name="height"):
    """Height of a probe under pressure: undeformed height plus rise.

    A design changes both, so the device whose top is highest is not the one whose top rises most.
    """


class Place(OfProbe, name="place"):
    """Coordinate of a probe along an axis, "x", "y" or "z" of the device."""

    axis: str = "z"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.axis not in actuator.AXES:
            raise ValueError(f"axis is {self.axis!r}; it is one of {', '.join(actuator.AXES)}")

    @property
    def title(self) -> str:
        return f"place {self.axis} of {self.of}" if self.of else f"place {self.axis}"

    def along(self, device: Actuator) -> Array:
        return np.eye(3)[actuator.AXES.index(self.axis)]


class DeviceFigure(DesignQuantity, name="figure", unit="1"):
    """A figure of this kind of device derived from its probes, such as a slab's lift angle, by its column with its unit, such
    as ``lift_angle_deg``."""

    of: str = ""

    @property
    def title(self) -> str:
        return self.of

    def measure(self, design: DesignedBody) -> Measure:
        actuator = design.system.body.actuator
        places = {name: np.asarray(place) for name, place in actuator.probes.items()}
        known = actuator.figure_columns.values()
        if self.of not in known:
            raise ValueError(
                f"figure {self.of!r} is not defined for this device; "
                + (f"it has {', '.join(known)}" if known else "it has none")
            )

        def value(rest: Mapping[str, Array], moved: Mapping[str, Array]) -> float:
            now = {name: rest[name] + moved[name] for name in rest}
            return fields.device_columns(actuator, {name: (p[0], p[1], p[2]) for name, p in now.items()})[self.of]

        return PlacesMeasure(design, tuple(places), value)


# ----------------------------------------------------------------------------------------------------------------------
# Forces and stiffnesses of the whole device.


class BlockedForce(DesignQuantity, name="blocked_force", unit="N"):
    """Blocked force along the lift at the device's held tip."""

    def measure(self, design: DesignedBody) -> Measure:
        system = design.system
        actuator, potential = system.body.actuator, system.potential
        if actuator.blocked is None:
            raise ValueError("the device's tip is free, so it has no blocked force; hold it (a slab's tip = 'held')")
        if system.dead.loads:
            where = system.dead.loads[0].where
            raise ValueError(f"{self.name} is not available with loads ({where}), which act on the held tip too")
        along = _moved_role(design, actuator.blocked)
        # The virtual work of a unit motion of the support equals the residual there.
        forms = [-ufl.action(force, along) for force in design.forces]
        unit = system.length_unit**2 * actuator.copies
        pressures = [ufl.action(load, along) for load in potential.loads]
        return FormMeasure(design, forms, scaled(unit), counted_in_stress=True, by_pressure=pressures)


def _moved_role(design: DesignedBody, role: str) -> fem.Function:
    """Return the dofs of a unit motion of a role along the lift, zero elsewhere."""
    system = design.system
    component = int(np.argmax(system.body.skew @ in_section(system.body.actuator.lift, system.body.actuator.dimension)))
    dimension, facets = system.body.entities[role]
    along = fem.Function(system.space)
    along.x.array[fem.locate_dofs_topological(system.vectors.sub(component), dimension, facets)] = 1.0
    return along


class Stiffness(DesignQuantity, name="stiffness", unit="N/m"):
    """Force along the lift, spread over the loaded face, per rise of it at a given pressure."""

    def measure(self, design: DesignedBody) -> Measure:
        if design.system.body.actuator.pushed is None:
            raise ValueError("the device defines no loaded face, so it has no stiffness")
        return _StiffnessMeasure(design)


class _StiffnessMeasure(Measure):
    """One over the compliance c = 2 l.z - z.K z of a load l, whose answer is z = K^-1 l.

    To first order c does not change with z, so only the changes of l and of K count, those by the state among them.
    """

    def __init__(self, design: DesignedBody):
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
            *(ufl.action(ufl.derivative(force, system.w, self._z), self._z) for force in design.forces),
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
        check_apart(self.design, "stiffness")
        load = self.design.face_load(self._role)
        system.unknowns.to_dofs(self.design.answer(load), self._z.x.array)
        self._z.x.scatter_forward()
        return self._measure.slopes(state)


def check_apart(design: DesignedBody, what: str) -> None:
    """Raise `DesignFailure` where walls or a file's shape are in contact: the third derivatives of that energy are missing."""
    system = design.system
    if system.assembled.touches(system.w.x.array):
        raise trials.DesignFailure(f"the {what} has no gradient where faces press on each other or on a shape that gives way")


# ----------------------------------------------------------------------------------------------------------------------
# Limit and bifurcation pressures, and their margins to the working pressure.


class OfLimit(DesignQuantity):
    """A quantity of the limit point."""

    of_state: ClassVar = False
    margin: ClassVar = False
    """Whether it is relative to the highest working pressure."""

    def factor(self, working: float) -> float:
        """By which the limit pressure in Pa is multiplied; ``working`` is the highest working pressure."""
        return 1.0 / working if self.margin else 1.0

    def measure(self, design: DesignedBody) -> Measure:
        raise TypeError("a quantity of the limit point needs only that point")


class OfBifurcation(OfLimit):
    """A quantity of the first bifurcation."""


class BifurcationPressure(OfBifurcation, name="bifurcation_pressure", unit="Pa"):
    """Pressure at the first bifurcation."""


class BifurcationMargin(OfBifurcation, name="bifurcation_margin", unit="1"):
    """Bifurcation pressure over the highest working pressure."""

    margin: ClassVar = True


class LimitPressure(OfLimit, name="limit_pressure", unit="Pa"):
    """Pressure at the first limit point."""


class LimitMargin(OfLimit, name="limit_margin", unit="1"):
    """Limit pressure over the highest working pressure."""

    margin: ClassVar = True


# ----------------------------------------------------------------------------------------------------------------------
# Forces on rigid shapes.


class PressedMeasure(Measure):
    """Force of the device on a shape whose contact is a sum over samples, by weights of its components along the mesh's
    coordinates, SI units over dimensionless ones and shear moduli."""

    def __init__(self, design: DesignedBody, term: assembly.AssembledTerm, along: Array):
        self.design, self.term, self.along = design, term, along

    def value(self, state: State | None) -> float:
        force = self.term.force(self.design.system.w.x.array)
        return self.design.system.stress_unit * float(force @ self.along)

    def slopes(self, state: State | None) -> Slopes:
        system, motion = self.design.system, self.design.motion
        unit, w = system.stress_unit, system.w.x.array
        rates = unit * self.term.along_product(w, self.along)  # by the nodes' deformed places
        by_w = np.zeros(system.n)
        self.term.add_rates(rates, by_w)
        by_X = motion.by_nodes(self.term.nodes.by_mesh(rates))
        return Slopes(self.value(state), system.by_unknowns(by_w).copy(), 0.0, by_X)

    def by_history(self, histories: Sequence[sensitivity.HistoryDirection]) -> float:
        directions = (history for history in histories if isinstance(history, sensitivity.FrictionDirection))
        own = next((direction for direction in directions if direction.term is self.term), None)
        return 0.0 if own is None else self.design.system.stress_unit * float(own.at_nodes().sum(axis=0) @ self.along)


class ForceOn(DesignQuantity, name="force_on", unit="N"):
    """Force of the whole device on a rigid shape, as in ``[contact.ball]``, or "contact", the plane of ``[contact]``, along a
    direction in device coordinates, such as "z" or "0.6, 0, 0.8"; the device's lift if empty."""

    of: str = ""
    along: str = ""

    @property
    def title(self) -> str:
        return f"force on {self.of}" + (f" along {self.along}" if self.along else "")

    @staticmethod
    def named(device: Actuator, components: Sequence[Component]) -> tuple[str, list[str]]:
        return "rigid shape", [part.label for part in components if isinstance(part, contact.RigidShape | contact.Obstacle)]

    def measure(self, design: DesignedBody) -> Measure:
        system, terms = design.system, design.system.potential.terms
        kinds = contact.ShapeTerm | contact.FileShapeTerm | contact.GuidedShapeTerm | contact.RubbingShapeTerm
        shapes = {label: term for label, term in terms.items() if isinstance(term, kinds)}
        if self.of not in shapes:
            raise ValueError(f"the case has no rigid shape {self.of!r}; it has {', '.join(shapes) or 'none'}")
        term, actuator = shapes[self.of], system.body.actuator
        way = _direction(self.along, "force_on: along") if self.along else np.asarray(actuator.lift)
        assert isinstance(term.shape, contact.RigidShape)
        crossed, axes = term.shape.crossed(actuator), np.eye(actuator.dimension)
        shares = [float(contact.force_of_all(actuator, crossed, in_space(axis)) @ way) for axis in axes]
        weights = system.length_unit**2 * np.array(shares)
        if isinstance(term, assembly.AssembledTerm):
            return PressedMeasure(design, term, weights)
        forms = [weight * form for forces in term.pushes for weight, form in zip(weights, forces, strict=True) if weight]
        if not forms:
            raise ValueError(f"{self.title} vanishes by symmetry; use another direction (along)")
        return FormMeasure(design, forms, scaled(1.0), counted_in_stress=True)


# ----------------------------------------------------------------------------------------------------------------------
# The air's work: by the conservation of energy what is stored, as nothing is lost on the way.


class InflationWork(DesignQuantity, name="inflation_work", unit="J"):
    """Work of the air on the device from no pressure up to a state, the integral of p dV.

    Per cycle it is what the supply has to give each time; the same is what an ideal engine would get back.
    """

    def measure(self, design: DesignedBody) -> Measure:
        if design.system.dead.loads:
            where = design.system.dead.loads[0].where
            raise ValueError(f"{self.name} is not available with loads ({where}), which work too; use added_volume")
        return energy_measure(design)


# ----------------------------------------------------------------------------------------------------------------------
# Pose of a face: its mean place and how it has turned about an axis.
#
# The turn is that of the rotation about the axis that brings the face's undeformed places X nearest to the deformed ones x,
# both counted from their means: tan t = (int a . (X x x) dA) / (int X . x - (a . X) (a . x) dA).


class OfFace(DesignQuantity):
    """A quantity of a face, such as "tip", along an axis in device coordinates, such as "z" or "0.6, 0, 0.8"."""

    of: str = ""
    axis: str = "z"

    @staticmethod
    def named(device: Actuator, components: Sequence[Component]) -> tuple[str, list[str]]:
        held = (hold.role for hold in device.holds)
        return "face", list(dict.fromkeys([*device.faces, *actuator.cavity_roles(device), *held]))

    def integrated(self, design: DesignedBody, way: Array, combine: Combine) -> FormMeasure:
        """Return a function of integrals over the face; see `integrands`."""
        body = design.system.body
        try:
            area = body.sheet_face(self.of)[0]
        except BodyError as error:
            raise ValueError(str(error)) from None
        values = self.integrands(fem.Constant(body.mesh, way), fem.Constant(body.mesh, 1.0), *_places(design))
        return FormMeasure(design, [value * body.hoop * area for value in values], combine)

    @abc.abstractmethod
    def integrands(self, along: Expr, unit: Expr, X: Expr, x: Expr) -> list[Expr]:
        """Return what is integrated: of the axis, 1, and the undeformed and deformed places."""


def _places(design: DesignedBody) -> tuple[Expr, Expr]:
    """Return undeformed and deformed places in UFL, three components each; of a section in its plane."""
    system = design.system
    X = ufl.SpatialCoordinate(system.body.mesh)
    x = X + system.body.displacement(system.potential.displacement)
    if system.body.axisymmetric:
        return ufl.as_vector([X[0], 0, X[1]]), ufl.as_vector([x[0], 0, x[1]])
    return X, x


class FacePlace(OfFace, name="face_place", unit="m"):
    """Mean place of a face in a direction, deformed."""

    @property
    def title(self) -> str:
        return f"place {self.axis} of {self.of}"

    def measure(self, design: DesignedBody) -> Measure:
        way, body, unit = _direction(self.axis, f"{self.name}: axis"), design.system.body, design.system.length_unit
        across = [
            plane for plane in body.actuator.cut_planes if abs(float(np.dot(way, plane.normal))) > PERPENDICULAR_TOLERANCE
        ]
        if across or (body.axisymmetric and abs(way[2]) < 1 - PERPENDICULAR_TOLERANCE):
            raise ValueError(f"{self.title}: by symmetry it does not move along {self.axis}; use another axis")

        def mean(values: Array) -> tuple[float, Array]:
            place = unit * values[0] / values[1]
            return float(place), np.array([unit, -place]) / values[1]

        return self.integrated(design, way, mean)

    def integrands(self, along: Expr, unit: Expr, X: Expr, x: Expr) -> list[Expr]:
        return [ufl.dot(along, x), unit]


class Turn(OfFace, name="turn", unit="deg"):
    """Angle by which a face has turned about an axis, from -180 to 180 degrees, right-handed."""

    axis: str = "y"

    @property
    def title(self) -> str:
        return f"turn of {self.of} about {self.axis}"

    def measure(self, design: DesignedBody) -> Measure:
        way, body = _direction(self.axis, f"{self.name}: axis"), design.system.body
        across = [
            plane for plane in body.actuator.cut_planes if abs(float(np.dot(way, plane.normal))) < 1 - PERPENDICULAR_TOLERANCE
        ]
        if across or body.axisymmetric:
            raise ValueError(f"{self.name}: by symmetry nothing turns about {self.axis}; use {body.actuator.fuller}")
        return self.integrated(design, way, lambda values: _turn(way, values))

    def integrands(self, along: Expr, unit: Expr, X: Expr, x: Expr) -> list[Expr]:
        square = ufl.dot(X, x) - ufl.dot(along, X) * ufl.dot(along, x)
        return [ufl.dot(along, ufl.cross(X, x)), square, unit, *(X[i] for i in range(3)), *(x[i] for i in range(3))]


PERPENDICULAR_TOLERANCE = 1e-9
"""Largest scalar product of unit vectors that count as perpendicular."""


def _turn(axis: Array, values: Array) -> tuple[float, Array]:
    """Return the angle in degrees and its slopes, from the integrals of `Turn`."""
    (crossed, square, area), X, x = values[:3], values[3:6], values[6:]
    sine = crossed - float(axis @ np.cross(X, x)) / area
    flat, moved = X - axis * (axis @ X), x - axis * (axis @ x)
    cosine = square - float(flat @ moved) / area
    by_sine = np.concatenate(
        [[1.0, 0.0, float(axis @ np.cross(X, x)) / area**2], -np.cross(x, axis) / area, -np.cross(axis, X) / area]
    )
    by_cosine = np.concatenate([[0.0, 1.0, float(flat @ moved) / area**2], -moved / area, -flat / area])
    size = sine**2 + cosine**2
    return math.degrees(math.atan2(sine, cosine)), np.degrees((cosine * by_sine - sine * by_cosine) / size)


def _direction(text: str, where: str) -> Array:
    try:
        return np.asarray(direction(text, where))
    except ComponentError as error:
        raise ValueError(str(error)) from None


# ----------------------------------------------------------------------------------------------------------------------
# A device under design, ready to be solved and differentiated: equations, mesh motion, probes.


class DesignedBody:
    """A meshed device, its mesh as it was read at first, which the motion moves as its design, with its probes and the UFL
    form of what `System.volume` is of the undeformed device.

    ``energies`` and ``forces`` are those of the potential; with those of `laws.FORM_ENERGIES` by which derivatives are wanted.
    """

    def __init__(self, solver: Solver, forms: Iterable[str] = ()):
        self.solver, self.system = solver, solver.system
        system = self.system
        main, test = system.potential.regions[0], ufl.TestFunction(system.space)
        main.forms = {name: fem.Constant(system.body.mesh, 0.0) for name in forms}
        added = [factor * laws.FORM_ENERGIES[name](self.strain) for name, factor in main.forms.items()]
        own = [density * system.body.hoop * main.dx for density in added]
        self.energies: list[ufl.Form] = [*system.potential.energies, *own]
        self.forces = [*system.potential.forces, *(ufl.derivative(energy, system.w, test) for energy in own)]
        self.motion = sensitivity.MeshMotion(system.body)
        self.motion.followers.append(system.follow_mesh)
        resting = fem.Function(system.space)
        self.rest_volume: ufl.Form = ufl.replace(system.potential.cavity_volume, {system.w: resting})
        self._rest_volume = system.form(self.rest_volume)
        self.probes = Probes(self)  # now, before the mesh moves
        self._vectors: tuple[PETSc.Vec, PETSc.Vec] | None = None

    @property
    def direction(self) -> int:
        """1, or -1 if P and V rise towards a vacuum; see `System.direction`."""
        return self.system.direction

    @property
    def sign(self) -> int:
        """Sign with which the cavity's volume counts in V, where its form has none."""
        return self.direction if len(self.system.ratios) == 1 else 1

    @functools.cached_property
    def strain(self) -> laws.Strain:
        """Strain of the current state in UFL."""
        return laws.Strain(self.system.body.deformation_gradient(self.system.potential.displacement))

    @functools.cached_property
    def _gradients(self) -> object:
        return fem.Expression(self.strain.F, self.system.points, jit_options=compiling.JIT)

    def gradients(self) -> Array:
        """Return the deformation gradients of the loaded state at the integration points, shape (cells, points, 3, 3)."""
        system = self.system
        values = self._gradients.eval(system.body.mesh, system.cells)  # type: ignore[attr-defined]
        return np.asarray(values).reshape(len(system.cells), -1, 3, 3)

    def volume_at_rest(self) -> float:
        """Return the dimensionless undeformed volume conjugate to the pressure, on the current mesh."""
        system, chambers = self.system, self.system.body.chambers
        return self.sign * system.integral(self._rest_volume) + float(system.coupling.shares[: len(chambers)] @ chambers)

    def face_load(self, role: str) -> Array:
        """Return a unit load along the lift, spread evenly over a role: owned entries; see `face_load`."""
        return self.system.by_unknowns(face_load(self.system, role, self.system.body.actuator.lift)).copy()

    def answer(self, force: Array) -> Array:
        """Return K^-1 times a force with the current factorisation, refined once on the factorised K; owned entries."""
        bordered, K = self.solver.bordered, self.system.K
        if self._vectors is None:
            self._vectors = K.createVecRight(), K.createVecRight()
        b, x = self._vectors
        b.array_w[:] = force
        bordered.solve(b, x)
        solution = np.array(x.array_r)
        if not bordered.inverse.exact:  # iterations have converged, with the state's own tangent
            return solution
        K.mult(x, b)
        b.array_w[:] = force - b.array_r
        bordered.solve(b, x)
        return solution + x.array_r

    def release(self) -> None:
        """Release the PETSc and MPI objects."""
        for vector in self._vectors or ():
            vector.destroy()
        self.motion.release()
        self.solver.release()


class Probes:
    """The device's named points, which are vertices of every design's mesh."""

    def __init__(self, design: DesignedBody):
        self.design, self.system = design, design.system
        grid = state_values.Grid(self.system)
        skew, _ = state_values.displacement_maps(self.system, grid)
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
        closest = -mpi.largest(system.comm, -near)
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
        return np.array([mpi.total(self.system.comm, float(value)) for value in x])
