"""Dead loads: gravity, hanging masses, forces and moments on faces; see `softmodels.mechanics.controls`."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from geometries.actuator import Vector
from softmodels.common import schema
from softmodels.common.arrays import Array
from softmodels.common.lazy import fem, ufl
from softmodels.materials import silicones
from softmodels.materials.laws import Material
from softmodels.mechanics import body, component, controls, regions
from softmodels.mechanics.component import Component, ComponentError, direction

STANDARD_GRAVITY = 9.81


class DirectedLoad(controls.LoadPart):
    """A load with a fixed direction: `softmodels.mechanics.component.direction` reads the field named ``direction_field``."""

    direction_field: ClassVar[str] = "direction"

    @property
    def vector(self) -> Vector:
        """Unit vector of the direction, in device coordinates."""
        return direction(getattr(self, self.direction_field), self.where)

    def check(self) -> None:
        direction(getattr(self, self.direction_field), self.where)

    def check_on(self, actuator: Actuator) -> None:
        component.check_direction(self.vector, actuator, self.where)


@component.register_component
@dataclasses.dataclass(frozen=True)
class Gravity(DirectedLoad):
    """The weight of the device and of all masses on it; a region may have a density of its own."""

    direction: str = schema.field_of(schema.Words(), "direction of gravity, such as -z or 0.6, 0, -0.8")
    density: float | None = schema.field_of(
        schema.Open(schema.Quantity("kg/m^3")),
        "density of the silicone; default: from its data sheet, or 1070 kg/m^3",
        None,
    )
    magnitude: float = schema.field_of(schema.Quantity("m/s^2"), "acceleration of gravity", STANDARD_GRAVITY)

    table: ClassVar[str] = "gravity"
    differentiable: ClassVar[bool] = True
    optional: ClassVar[bool] = True
    needs: ClassVar[str] = 'gravity needs its direction (direction = "-z", or --gravity -z)'
    figure_texts: ClassVar[Mapping[str, tuple[str, str]]] = {
        "weight_N": ("weight", "of the whole device and its masses, times the applied share of gravity"),
        "sag_mm": ("sag", "mass-weighted mean displacement along gravity, from the undeformed state"),
        "sag_travel_mm": ("sag on the path", "the same from the start of the path"),
        "weight_share": ("share of the weight", "applied share of gravity"),
        controls.LOADS_ENERGY: (
            "energy of the loads",
            "potential energy of weights and forces: minus their work from the undeformed state at the current magnitude",
        ),
    }
    columns: ClassVar = ("weight_N", "sag_mm", "sag_travel_mm")
    asked: ClassVar[Mapping[str, controls.RequestedValue]] = {
        "share": controls.RequestedValue(
            "of the weight", words="shares", help="shares of the weight (--gravity), instead of pressures: 0:1"
        )
    }
    share_column: ClassVar[str] = "weight_share"

    def check(self) -> None:
        super().check()
        if self.name:
            raise self.error("a device has only one gravity, without a name; write it as [gravity]")
        controls.check_finite(self.magnitude, self.where, "magnitude")
        if self.density is not None:
            check_density(self.density, self.where)

    @property
    def acceleration(self) -> npt.NDArray[np.float64]:
        """Acceleration in m/s2, shape (3,), in device coordinates."""
        return self.magnitude * np.asarray(self.vector)

    @property
    def variable(self) -> Mapping[str, str]:
        return {"magnitude": "m/s^2"}

    def magnitude_of(self, masses: complex) -> complex:
        return masses * self.magnitude

    def idle(self, components: Sequence[Component]) -> bool:
        weighing = [part for part in components if part.weighs]
        if self.density != 0.0 or any(part.own_density for part in components if isinstance(part, regions.RegionPart)):
            return False
        return bool(weighing) and all(part.lifted for part in weighing)

    def spread(self, on: controls.DistributedLoad, components: Sequence[Component]) -> controls.Weighed:
        along = body.in_section(self.vector, on.body.actuator.dimension)
        masses = [
            controls.Weighed([on.mean(along, matter)], density * on.volume(matter))
            for matter, density in zip(on.system.matter, densities(on.system, components), strict=True)
            if density
        ]
        masses += [m for part in components if isinstance(part, controls.HeavyPart) for m in part.masses(on, along)]
        whole = sum(mass.amount for mass in masses)
        if not whole > 0.0:
            raise self.error("gravity acts on no mass; give the silicone's density, or add a mass to a face")
        shares = tuple((on.constant(mass.amount / whole), mass) for mass in masses)
        forms = [share * form for share, mass in shares for form in mass.forms]
        return controls.Weighed(forms, whole * self.magnitude, shares=shares)


MAX_DENSITY = 25e3
"""Density in kg/m3 above which a wrong unit is assumed: no metal is denser."""


class FaceLoad(DirectedLoad):
    """A load on a face; a kind is a dataclass of it with the fields below and one for its direction.

    Attributes:
        face: Role of the facets.
        amount: Its size on the whole device in SI units; 0 where a request or a program sets it.
    """

    face: str
    amount: float

    @property
    def kept(self) -> bool:
        return self.amount != 0.0

    def undesigned(self, actuator: Actuator) -> str:
        if getattr(self, "traction", 0.0) or getattr(self, "line_load", 0.0):
            return "which is given per area or length; give its amount instead"
        return _off_faces(self.face) if self.kept else "which has no amount"

    @property
    def variable(self) -> Mapping[str, str]:
        return {"amount": "N" if self.arm == 2 else "N*m"}

    def magnitude_of(self, masses: complex) -> complex:
        return self.amount

    def check(self) -> None:
        super().check()
        if self.amount:
            controls.check_finite(self.amount, self.where, "amount")

    def check_on(self, actuator: Actuator) -> None:
        super().check_on(actuator)
        component.check_on_mesh(self.where, actuator, [self.face])


@component.register_component
@dataclasses.dataclass(frozen=True)
class Mass(controls.HeavyPart):
    """A mass on a face or an edge, spread evenly over it, undeformed."""

    face: str = schema.field_of(schema.Words(), "face or edge that carries the mass, such as tip or 'edge of tip and top'")
    amount: float = schema.field_of(schema.Quantity("kg"), "mass on the face, of the whole device", usual=20.0)

    table: ClassVar[str] = "mass"
    optional: ClassVar[bool] = True
    needs: ClassVar[str] = 'a mass needs a face and an amount (face = "tip", amount = "20 g")'

    def check(self) -> None:
        controls.check_finite(self.amount, self.where, "amount")

    def check_on(self, actuator: Actuator) -> None:
        component.check_on_mesh(self.where, actuator, [self.face])

    @property
    def weighs(self) -> float:
        return self.amount

    def masses(self, on: controls.DistributedLoad, along: npt.NDArray[np.float64]) -> list[controls.Weighed]:
        with _on_face(self):
            return [controls.Weighed([on.mean(along, self.face)], self.amount, self.key)]

    def undesigned(self, actuator: Actuator) -> str:
        return _off_faces(self.face)

    @property
    def variable(self) -> Mapping[str, str]:
        return {"amount": "kg"}


@component.register_component
@dataclasses.dataclass(frozen=True)
class Force(FaceLoad):
    """A force of fixed direction, spread evenly over an undeformed face."""

    face: str = schema.field_of(
        schema.Words(), "loaded face, piece of one or edge, such as tip, 'tip within z > 4 mm', 'edge of tip and top'"
    )
    direction: str = schema.field_of(schema.Words(), "direction of the force, such as -z or 0.6, 0, -0.8")
    amount: float = schema.field_of(schema.Quantity("N"), "constant force on the whole device; 0 if requested", 0.0, usual=1e3)
    traction: float = schema.field_of(
        schema.Quantity("Pa"), "instead, constant force per undeformed area of the face, such as 2kPa", 0.0
    )
    line_load: float = schema.field_of(
        schema.Quantity("N/m"), "instead, constant force per undeformed length of an edge, such as 2N/m", 0.0
    )

    table: ClassVar[str] = "force"
    optional: ClassVar[bool] = True
    needs: ClassVar[str] = 'a force needs its face and its direction (face = "tip", direction = "-z")'
    columns: ClassVar = ("force_N", "moved_mm", "travel_mm")
    asked: ClassVar[Mapping[str, controls.RequestedValue]] = {
        "force_N": controls.RequestedValue(
            "N", words="forces", help="forces in N on a face (--force), instead of pressures: 0:10 or 0,2,5"
        ),
        "travel_mm": controls.RequestedValue(
            "mm", True, 1e-3, "travels", "travel of the face along the force in mm, instead of forces"
        ),
    }
    figure_texts: ClassVar[Mapping[str, tuple[str, str]]] = component.column_texts(
        ("force_N", "force", "on the whole device, spread over its undeformed face"),
        (
            "moved_mm",
            "displacement along the force",
            "mean of the loaded face along the force, from the undeformed state",
        ),
        ("travel_mm", "travel along the force", "displacement of the loaded face from the start of the path"),
    )

    @property
    def kept(self) -> bool:
        return bool(self.amount or self.traction or self.line_load)

    def check(self) -> None:
        super().check()
        if sum(map(bool, (self.amount, self.traction, self.line_load))) > 1:
            raise ComponentError(f"{self.where} has more than one of amount, traction and line_load; give one of them")
        for name in ("traction", "line_load"):
            if getattr(self, name):
                controls.check_finite(getattr(self, name), self.where, name)

    def spread(self, on: controls.DistributedLoad, components: Sequence[Component]) -> controls.Weighed:
        with _on_face(self):
            edge = on.body.is_edge(self.face)
            if (self.traction and edge) or (self.line_load and not edge):
                given, wanted = ("traction", "a face") if self.traction else ("line_load", "an edge ('edge of tip and top')")
                raise self.error(f"{given} needs {wanted}, but face = {self.face!r} is none")
            size = (
                on.integral(on.constant(1.0), self.face) * on.body.actuator.size ** (1 if edge else 2) * on.body.actuator.copies
            )
            amount = self.amount or (self.traction or self.line_load) * size
            return controls.Weighed([on.mean(body.in_section(self.vector, on.body.actuator.dimension), self.face)], amount)


@component.register_component
@dataclasses.dataclass(frozen=True)
class Moment(FaceLoad):
    """A moment of dead forces on a face: they rise linearly with the distance from its centre and have no resultant.

    On the undeformed face the force per area at X is M n x (X - c) / I, with c the centre and I the integral of
    |n x (X - c)|^2. The forces keep their directions and sizes, which is what makes them conservative: on a face that has
    turned by an angle t about n, what is left of the moment is M cos t. They work on the rotation to first order.
    """

    face: str = schema.field_of(schema.Words(), "loaded face, such as tip")
    axis: str = schema.field_of(schema.Words(), "axis of the moment through the face's centre, such as y, right-handed")
    amount: float = schema.field_of(schema.Quantity("N*m"), "constant moment on the whole device; 0 if requested", 0.0)

    table: ClassVar[str] = "moment"
    optional: ClassVar[bool] = True
    arm: ClassVar[int] = 3
    direction_field: ClassVar[str] = "axis"
    needs: ClassVar[str] = 'a moment needs its face and its axis (face = "tip", axis = "y")'
    columns: ClassVar = ("moment_Nmm", "rotation_deg", "turn_deg")
    asked: ClassVar[Mapping[str, controls.RequestedValue]] = {
        "moment_Nmm": controls.RequestedValue(
            "Nmm", False, 1e-3, "moments", "moments in N mm on a face (--moment), instead of pressures"
        ),
        "turn_deg": controls.RequestedValue(
            "deg", True, math.pi / 180, "turns", "rotation of the face of the moment in degrees, instead of moments"
        ),
    }
    figure_texts: ClassVar[Mapping[str, tuple[str, str]]] = component.column_texts(
        ("moment_Nmm", "moment", "of dead forces on the whole device that rise linearly over its undeformed face"),
        (
            "rotation_deg",
            "rotation by the moment",
            "mean of the face's displacements about the axis, weighted by their distance",
        ),
        ("turn_deg", "turn by the moment", "the rotation from the start of the path"),
    )
    column_unit: ClassVar[float] = 1e-3
    moved_column_unit: ClassVar[float] = math.pi / 180

    def check_on(self, actuator: Actuator) -> None:
        component.check_on_mesh(self.where, actuator, [self.face])
        if actuator.dimension == 2:
            raise self.error(f"an axisymmetric section cannot take a moment; use {actuator.fuller}")
        for plane in actuator.cut_planes:
            if 1 - abs(float(np.dot(self.vector, plane.normal))) > component.IN_PLANE_TOLERANCE:
                across = ", ".join(f"{x:g}" for x in plane.normal)
                raise self.error(
                    f"its forces are not symmetric about the symmetry plane normal to ({across}); "
                    f"use an axis normal to that plane, or {actuator.fuller}"
                )

    def spread(self, on: controls.DistributedLoad, components: Sequence[Component]) -> controls.Weighed:
        with _on_face(self):
            axis = np.asarray(self.vector)
            centre = controls.mean_place(on, self.face)
            # Beyond a cut plane lies the mirror image: the whole face's centre lies in the plane, square to the axis.
            middle = on.constant(centre)
            arm = ufl.cross(on.constant(axis), on.places - middle)
            size = on.constant(1 / on.integral(ufl.dot(arm, arm), self.face))
            form = ufl.dot(size * arm, on.test) * on.body.hoop * on.measure(self.face)
            self._measure(on, middle, size, axis)
            return controls.Weighed([form], self.amount)

    def _measure(self, on: controls.DistributedLoad, centre: fem.Constant, size: fem.Constant, axis: Array) -> None:
        """Let the centre and the sum of squares follow a mesh that moves."""
        far = ufl.cross(on.constant(axis), on.places)
        integrands = [on.constant(1.0), *(on.places[i] for i in range(3)), ufl.dot(far, far)]
        integrals = [integrand * on.body.hoop * on.measure(self.face) for integrand in integrands]

        def inverse(sums: Array) -> Array:
            moved = np.cross(axis, sums[1:4])
            return np.asarray(1.0 / (sums[4] - moved @ moved / sums[0]))

        on.measured.append(controls.MeasuredConstant(centre, integrals, lambda sums: sums[1:4] / sums[0]))
        on.measured.append(controls.MeasuredConstant(size, integrals, inverse))


def _off_faces(face: str) -> str:
    """Return why designs reject a load on a face's piece or edge, a clause; empty for a face."""
    return "on a piece or an edge of a face, and design meshes cannot move their borders" if " " in face.strip() else ""


def weighed(components: Sequence[Component], material: Material) -> tuple[Component, ...]:
    """Return the parts with the density of gravity set: that of this material, if left out."""
    return tuple(
        dataclasses.replace(part, density=silicones.density_of(material))
        if isinstance(part, Gravity) and part.density is None
        else part
        for part in components
    )


def densities(system: component.Equations, components: Sequence[Component]) -> list[float]:
    """Return the density in kg/m3 of each of a body's materials, as in ``system.matter``: a region's own, else that of gravity,
    else that of the silicone's data sheet."""
    gravity = next((part.density for part in components if isinstance(part, Gravity)), None)
    main = silicones.density_of(system.material) if gravity is None else gravity
    own = {part.name: part.own_density for part in components if isinstance(part, regions.RegionPart)}
    return [main if (known := own.get(matter.name)) is None else known for matter in system.matter]


def check_density(density: float, where: str) -> None:
    """Raise `ComponentError` for a density in kg/m3 out of range."""
    if not 0.0 <= density <= MAX_DENSITY:
        raise ComponentError(f"{where}: a density of {density:g} kg/m^3 is out of range; silicones have 1030 to 1130")


@contextlib.contextmanager
def _on_face(part: Component) -> Iterator[None]:
    try:
        yield
    except body.BodyError as error:
        raise part.error(f"{error}") from None
