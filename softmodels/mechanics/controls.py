"""What drives a device: curves in the plane of cavity pressure and volume, most often lines, and dead loads.

The pressure P is an unknown of every solve. Its equation is ``a V + b P = target``: pressure control,
volume control and arc length are three pairs of numbers, and pass limit points with the same solver. A gas law
(`softmodels.path.supply`) is a function of V and P instead, of which Newton's method takes the tangent.
All figures are dimensionless (P in shear moduli, V in cubed sizes of the device).
"""

from __future__ import annotations

import abc
import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, Protocol

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.common.lazy import Expr, fem, ufl
from softmodels.mechanics import assembly, component, mpi


@dataclasses.dataclass(frozen=True)
class Control:
    """The line ``a V + b P = target``."""

    volume_coefficient: float
    pressure_coefficient: float
    target: float

    def value(self, V: float, P: float) -> float:
        """Left side of the line's equation at a state."""
        return self.volume_coefficient * V + self.pressure_coefficient * P

    @property
    def weight(self) -> float:
        """Factor of the equation's error in Newton's method."""
        return 1.0

    @property
    def needs_volume(self) -> bool:
        return self.volume_coefficient != 0.0

    def slopes(self, V: float, P: float) -> tuple[float, float]:
        """Return the slopes of the left side to V and P, the same everywhere."""
        return self.volume_coefficient, self.pressure_coefficient

    def line(self, V: float, P: float) -> Control:
        """Return the tangent: the line itself."""
        return self

    def at(self, target: float) -> Control:
        """Return the parallel line with another target."""
        return dataclasses.replace(self, target=target)


class Curve(Protocol):
    """Interface of a control: its left side, slopes, and tangent line."""

    @property
    def target(self) -> float: ...
    @property
    def needs_volume(self) -> bool: ...
    @property
    def weight(self) -> float: ...
    def value(self, V: float, P: float) -> float: ...
    def slopes(self, V: float, P: float) -> tuple[float, float]: ...
    def line(self, V: float, P: float) -> Control: ...
    def at(self, target: float) -> Curve: ...


def pressure_control(P: float) -> Control:
    return Control(0.0, 1.0, P)


def volume_control(V: float) -> Control:
    return Control(1.0, 0.0, V)


# ----------------------------------------------------------------------------------------------------------------------
# Coupling of several cavities' pressures and volumes to a single pair (P, V).
#
# Dead loads (`mechanics.dead_loads`) are drivers like cavities and follow them in the order: pressure and volume
# also mean a load's magnitude and its travel here.
#
# With cavity volumes V_i, the potential's load is
#
#     P s.V + p0.V + m.(C V - d)
#
# so each cavity's pressure is ``p = p0 + P s + C^T m``. P drives the cavities with shares s; its conjugate is V
# = s.V_i, so (P, V) is a work-conjugate pair as in a device of one cavity: same controls, same limit points. Pressures
# p0 are constant. A volume that is held, or tied to another, is a constraint: a row of C, with a Lagrange multiplier m that
# is an unknown of every solve.


@dataclasses.dataclass(frozen=True, eq=False)
class Coupling:
    """One coupling of k cavities, dimensionless.

    Attributes:
        shares: Share s of P in each cavity's pressure, shape (k,).
        fixed_pressures: Pressures p0 that do not change, shape (k,).
        constraints: Rows C of volumes' combinations that are held, shape (m, k).
        constrained_volumes: Their values d, shape (m,).
        multiplier_cavities: The cavities whose pressures the multipliers are, m of them.
    """

    shares: Array
    fixed_pressures: Array
    constraints: Array
    constrained_volumes: Array
    multiplier_cavities: tuple[int, ...] = ()

    @classmethod
    def proportional(cls, ratios: Sequence[float], dead: Array | Sequence[float] = ()) -> Coupling:
        """Couple every pressure as a multiple of P, followed by constant dead loads."""
        count = len(ratios) + len(dead)
        shares, fixed = (np.zeros(count) for _ in range(2))
        shares[: len(ratios)], fixed[len(ratios) :] = ratios, dead
        return cls(shares, fixed, np.zeros((0, count)), np.zeros(0))

    @classmethod
    def by_pressure(cls, pressures: Array, changes: Array, held: Sequence[int], volumes: Array) -> Coupling:
        """Couple the pressures so that P rises from 0 and they change from ``pressures`` in proportion to ``changes``, the
        largest by P; all of shape (k,). The cavities ``held`` stay at their ``volumes``, whatever their change."""
        count = len(pressures)
        free = np.ones(count)
        free[list(held)] = 0.0
        shares = np.asarray(changes) * free
        rows = np.eye(count)[list(held)].reshape(-1, count)
        return cls(shares / np.abs(shares).max(), pressures * free, rows, rows @ volumes, tuple(held))

    @classmethod
    def by_volume(cls, pressures: Array, changes: Array, held: Sequence[int], volumes: Array) -> Coupling:
        """Couple the volumes so that V is that of the cavity that changes most, and the other ``held`` ones change in
        proportion.

        Pressures, changes (0 for volumes that stay) and volumes are those at the start, shape (k,); cavities that are not held
        keep their pressures.
        """
        count = len(pressures)
        lead = max(held, key=lambda cavity: abs(changes[cavity]))
        shares = np.sign(changes[lead]) * np.eye(count)[lead]
        others = [cavity for cavity in held if cavity != lead]
        rows = np.array([np.eye(count)[c] - changes[c] / changes[lead] * np.eye(count)[lead] for c in others])
        rows = rows.reshape(-1, count)
        # P counts from 0: the lead's pressure at the start is a fixed one, and the multipliers are the others' own pressures.
        free = np.array(pressures, dtype=float)
        free[others] = 0.0
        free[lead] -= float((rows.T @ pressures[others])[lead])
        return cls(shares, free, rows, rows @ volumes, tuple(others))

    def pressures(self, P: float, m: Array) -> Array:
        """Return the cavities' pressures, shape (k,)."""
        return np.asarray(self.fixed_pressures + P * self.shares + self.constraints.T @ m)

    def multipliers(self, pressures: Array) -> Array:
        """Return the multipliers m that belong to pressures, shape (m,)."""
        return np.array([pressures[cavity] for cavity in self.multiplier_cavities])


# ----------------------------------------------------------------------------------------------------------------------
# The direction of a path at a state.


@dataclasses.dataclass(frozen=True, eq=False)
class Tangent:
    """Direction of the path at a state: changes of w (shape as `State.w`), P and V; P rises where V does and dP > 0.

    The compliance dV/dP is infinite at a limit point and negative past it.
    """

    w: Array
    P: float
    V: float

    @property
    def compliance(self) -> float:
        return self.V / self.P if self.P else math.inf

    def __neg__(self) -> Tangent:
        return Tangent(-self.w, -self.P, -self.V)


# ----------------------------------------------------------------------------------------------------------------------
# Dead loads as drivers besides the cavities: a magnitude and its work-conjugate.
#
# A dead load keeps its direction and its point of application on the undeformed body, so that its work is f L(u), with L linear
# in the displacement. So (f, L) is a pair like a cavity's pressure and volume: `mechanics.controls` can control, fix or hold
# either of them, with limit points and arc lengths. The loads come behind the cavities, in the order of the device's parts.


LOADS_ENERGY = "loads_energy_mJ"
"""Column with the potential energy of all dead loads."""


@dataclasses.dataclass(frozen=True)
class RequestedValue:
    """A quantity that a load or a series may request.

    Attributes:
        unit: Of its values in case files and messages.
        held: Whether it is what a driver works on, a volume or a travel, and not its magnitude.
        scale: SI units in one of ``unit``.
        words: Several of it.
        help: Of its option.
    """

    unit: str
    held: bool = False
    scale: float = 1.0
    words: str = ""
    help: str = ""


class LoadPart(component.Component):
    """A dead load.

    Attributes:
        asked: What ``[load]`` and its options may request of it, by key.
        arm: Power of the device's size that makes its magnitude from shear moduli: 2 of a force in N, 3 of a moment in N m.
            What it works on has the power 3 - ``arm``: m, or rad.
        columns: Columns of ``path.csv``: its magnitude; what it works on, from the undeformed state; the same from where the
            path begins. A load's own name stands before the unit, which its variables in SI are without.
        column_unit, moved_column_unit: SI units in one of the first column's units, and in one of the others'.
        share_column: Column with the applied share of its magnitude; none if empty.
    """

    asked: ClassVar[Mapping[str, RequestedValue]] = {}
    arm: ClassVar[int] = 2
    column_unit: ClassVar[float] = 1.0
    moved_column_unit: ClassVar[float] = 1e-3

    columns: ClassVar[tuple[str, str, str]]
    share_column: ClassVar[str] = ""

    @property
    def named_columns(self) -> tuple[str, ...]:
        """Its ``columns`` with the load's own name, if it has one."""
        parts = (column.rpartition("_") for column in self.columns)
        return tuple(f"{what}_{self.name}_{unit}" if self.name else f"{what}_{unit}" for what, _, unit in parts)

    @property
    def variables(self) -> tuple[str, ...]:
        """The same without their units: variables in SI."""
        return tuple(column.rpartition("_")[0] for column in self.named_columns)

    @property
    def kept(self) -> bool:
        """Whether the part has a constant magnitude, so that none can be requested."""
        return False

    def idle(self, components: Sequence[component.Component]) -> bool:
        """Return whether it acts only on masses that the device lifts, not on the device."""
        return False

    def magnitude_of(self, masses: complex) -> complex:
        """Return its magnitude in SI units, for designs; ``masses`` in kg are those it acts on, if it is a weight."""
        raise NotImplementedError(f"{self.where} says no magnitude")

    @abc.abstractmethod
    def spread(self, on: DistributedLoad, components: Sequence[component.Component]) -> Weighed:
        """Return its distribution over the body; what else is added to the device may have weight too. `ComponentError` if it
        cannot be on this mesh."""


class HeavyPart(component.Component):
    """A part with its own mass, on which gravity acts, spread evenly over the facets of ``face``."""

    face: str

    @abc.abstractmethod
    def masses(self, on: DistributedLoad, along: Array) -> list[Weighed]:
        """Return its masses along a unit vector of gravity in the directions of the mesh: of each its mean displacement along
        gravity as a form (`DistributedLoad.mean`), and the mass in kg, of the whole device."""


@dataclasses.dataclass(frozen=True, eq=False)
class Weighed:
    """A load's distribution.

    Attributes:
        forms: UFL integrals over the slice, linear in the test displacement, whose sum is of a unit magnitude on the slice.
            They are compiled one by one: DOLFINx takes the faces of one form from one set of tags. What acts on one face or in
            one region is a form of its own, so that the load on a rigid part can be computed, see `DeadLoads.borne`.
        amount: Its magnitude, of the whole device, in SI units.
    """

    forms: list[ufl.Form]
    amount: float
    key: str = ""
    """Of the part whose mass it is; empty for others."""
    shares: tuple[tuple[fem.Constant, Weighed], ...] = ()
    """Of a weight the masses it consists of, each with the constant that has its share."""


@dataclasses.dataclass(frozen=True, eq=False)
class MeasuredConstant:
    """A constant of a load that follows from UFL integrals over the undeformed body, such as the area that a force is spread
    over; ``value`` makes it of the integrals' values, which may be complex."""

    constant: fem.Constant
    integrals: list[ufl.Form]
    value: Callable[[Array], Array]


class DistributedLoad:
    """A body's test displacement, and means over the body and its faces; dimensionless.

    Args:
        system: The equations.

    Attributes:
        measured: Constants of the loads that follow a mesh that moves.
    """

    def __init__(self, system: component.Equations):
        self.system, self.body = system, system.body
        self.measured: list[MeasuredConstant] = []
        test = ufl.TestFunction(system.space)
        self.test = self.body.displacement(ufl.split(test)[0] if system.mixed else test)

    @property
    def places(self) -> Expr:
        return ufl.SpatialCoordinate(self.body.mesh)

    def constant(self, value: npt.ArrayLike | float) -> fem.Constant:
        return fem.Constant(self.body.mesh, np.asarray(value, dtype=float))

    def measure(self, over: str | component.MaterialCells) -> Expr:
        """Return the measure of the undeformed facets or edges of a role, or of one of the body's materials; of the full circle
        in a section."""
        return self.body.measure(over) if isinstance(over, str) else over.dx

    def integral(self, density: Expr, over: str | component.MaterialCells) -> float:
        """Integrate a density over the undeformed facets of a role, or over one of the body's materials."""
        return self.system.integral(fem.form(density * self.body.hoop * self.measure(over)))

    def volume(self, matter: component.MaterialCells) -> float:
        """Return the undeformed volume in m3 of one of the body's materials, of the whole device."""
        actuator = self.body.actuator
        return self.integral(self.constant(1.0), matter) * actuator.size**3 * actuator.copies

    def mean(self, along: npt.ArrayLike, over: str | component.MaterialCells) -> ufl.Form:
        """Return the mean test displacement along a vector of the mesh over a face, or over one of the body's materials."""
        size = self.integral(self.constant(1.0), over)
        if not size > 0.0:
            raise component.ComponentError(f"the face {over!r} has no facets on this mesh")
        way = np.asarray(along, dtype=float)
        vector = self.constant(way / size)
        if isinstance(over, str):  # a force on a face stays the same where the face grows, the weight of a region does not
            area = self.constant(1.0) * self.body.hoop * self.measure(over)
            self.measured.append(MeasuredConstant(vector, [area], lambda areas: way / areas[0]))
        return ufl.dot(vector, self.test) * self.body.hoop * self.measure(over)


class DeadLoads:
    """The dead loads among a device's parts.

    Args:
        system: The equations.
        components: What is added to the device.

    Attributes:
        loads: The loads.
        amounts: Their magnitudes where nothing else is asked for: of the whole device, SI units.
        integrals: Some for each, in UFL: their sum is the load of a unit magnitude on the slice.
        forms: The same, compiled.
        origins: What all drivers worked on where the path began, dimensionless; None before that.

    Raises:
        ComponentError: A load that moves nothing, or not on this mesh.
    """

    def __init__(self, system: component.Equations, components: Sequence[component.Component]):
        self.system = system
        self.loads = [part for part in components if isinstance(part, LoadPart) and not part.idle(components)]
        on = [DistributedLoad(system) for _ in self.loads]
        spread = [part.spread(distributed, components) for part, distributed in zip(self.loads, on, strict=True)]
        self.measured = [distributed.measured for distributed in on]
        self.shares = [load.shares for load in spread]
        self.amounts = np.array([load.amount for load in spread], dtype=float)
        self.integrals = [load.forms for load in spread]
        self.forms = [[system.form(form) for form in forms] for forms in self.integrals]
        self.origins: Array | None = None
        self._vector = fem.Function(system.space) if self.forms else system.w

    def magnitudes(self, components: Sequence[component.Component]) -> list[tuple[complex, Sequence[complex]]]:
        """Return for each load its magnitude in SI units and the shares of its masses, of parts like those it was made of,
        whose numbers may be complex."""
        known = {part.key: part for part in components}
        magnitudes: list[tuple[complex, Sequence[complex]]] = []
        for load, shares in zip(self.loads, self.shares, strict=True):
            masses = [known[mass.key].weighs if mass.key else mass.amount for _, mass in shares]
            part = known[load.key]
            assert isinstance(part, LoadPart)
            whole = sum(masses)
            magnitudes.append((part.magnitude_of(whole), [mass / whole for mass in masses]))
        return magnitudes

    def take(self, components: Sequence[component.Component]) -> None:
        """Set the numbers of other parts like those it was made of; what drives the device has to be coupled again."""
        for i, (amount, shares) in enumerate(self.magnitudes(components)):
            self.amounts[i] = amount.real
            for (constant, _), share in zip(self.shares[i], shares, strict=True):
                constant.value = share.real

    @functools.cached_property
    def _integrals(self) -> list[list[list[fem.Form]]]:
        return [[[self.system.form(form) for form in measured.integrals] for measured in own] for own in self.measured]

    def remeasure(self) -> None:
        """Follow a mesh that has moved."""
        for own, compiled in zip(self.measured, self._integrals, strict=True):
            for measured, forms in zip(own, compiled, strict=True):
                measured.constant.value = measured.value(np.array([self.system.integral(form) for form in forms]))

    def check(self) -> None:
        """Reject a load that acts only on held dofs."""
        for load, forms in zip(self.loads, self.forms, strict=True):
            force = self.system.assemble(forms)
            if not mpi.total(self.system.comm, float(force @ force)) > 0.0:
                raise component.ComponentError(f"{load.where} acts only on held dofs; use another face or direction")

    def moved(self) -> Array:
        """Return the work-conjugate of each load in the current state, shape (loads,); linear in w, moved held dofs
        included."""
        system, displacements = self.system, []
        w = system.w.x.array[: system.n]
        for forms in self.forms:
            b = assembly.assembled_vector(self._vector.x, forms)  # a separate function, because the system's may be in use
            displacements.append(mpi.total(system.comm, float(b[: system.n] @ w)))
        return np.array(displacements)

    def borne(self, dofs: npt.NDArray[np.int32], drives: Array) -> Array:
        """Return the loads of these dimensionless magnitudes, shape (loads,), that act only on some local dofs, such as the
        weight of a plate on the plate's, by owned dof."""
        others, force = np.ones(self.system.n, dtype=bool), np.zeros(self.system.n)
        others[dofs[dofs < self.system.n]] = False
        for drive, forms in zip(drives, self.forms, strict=True):
            for form in forms:
                entries = self.system.assemble([form], held=True)
                if not mpi.any_rank(self.system.comm, bool(entries[others].any())):
                    force += drive * entries
        return force

    @property
    def units(self) -> Array:
        """Magnitude of the whole device in SI units of one dimensionless one, shape (loads,)."""
        body = self.system.body
        return np.array([self.system.stress_unit * body.actuator.size**load.arm * body.actuator.copies for load in self.loads])

    @property
    def moved_units(self) -> Array:
        """Metres (or radians) per dimensionless unit of their work-conjugates, shape (loads,)."""
        return np.array([self.system.body.actuator.size ** (3 - load.arm) for load in self.loads])

    def figures(self, drives: Array) -> dict[str, float]:
        """Return the columns of ``path.csv`` in the current state, of the whole device, on all ranks, for dimensionless
        magnitudes of the loads, shape (loads,)."""
        magnitudes, moved, figures = drives * self.units, self.moved() * self.moved_units, dict[str, float]()
        for place, (load, magnitude, way) in enumerate(zip(self.loads, magnitudes, moved, strict=True)):
            column, moved_column, travel_column = load.named_columns
            figures[column] = float(magnitude) / load.column_unit
            figures[moved_column] = float(way) / load.moved_column_unit
            if self.origins is not None:
                way -= self.origins[len(self.system.body.actuator.ratios) + place] * self.moved_units[place]
                figures[travel_column] = float(way) / load.moved_column_unit
            if load.share_column:
                figures[load.share_column] = float(magnitude) / self.amounts[place]
        return {**figures, LOADS_ENERGY: -float(magnitudes @ moved) * 1e3} if figures else figures

    def index(self, key: str) -> int:
        """Return the place of a load among these; KeyError for one that is not there."""
        for i, load in enumerate(self.loads):
            if load.key == key:
                return i
        raise KeyError(key)


def requestable() -> dict[str, Mapping[str, RequestedValue]]:
    """Return what may be requested of dead loads, by table."""
    kinds = (kind for kind in component.COMPONENTS.values() if issubclass(kind, LoadPart))
    return {kind.table: kind.asked for kind in kinds if kind.asked}


def mean_place(on: DistributedLoad, role: str) -> Array:
    """Return the centre of a face of the slice, in mesh coordinates, dimensionless."""
    size = on.integral(on.constant(1.0), role)
    return np.array([on.integral(on.places[i], role) / size for i in range(on.body.mesh.geometry.dim)])


def check_finite(value: float, where: str, what: str) -> None:
    """Reject an amount that is not above zero."""
    if not (value > 0.0 and math.isfinite(value)):
        raise component.ComponentError(f"{where}: {what} is {value:g}; it must be above zero; use the direction for the sign")
