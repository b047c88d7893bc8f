"""Rigid parts bonded to a device: plates and rings; faces that are held; bodies on springs.

The constraint is exact, without penalty: the dofs on a part follow its few unknowns (`softmodels.mechanics.system`). The
symmetry of the model determines the free motions: six in a whole solid, three in a half, the axial translation in a wedge
or an axisymmetric section.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from geometries import Actuator, Hold
from geometries.actuator import Vector
from softmodels.common import errors, schema
from softmodels.common.arrays import Array
from softmodels.common.lazy import fem, ufl
from softmodels.mechanics import body, component, controls, mpi, regions
from softmodels.mechanics.component import ComponentError, direction

KINDS = ("free", "guided", "held")


@component.register_component
@dataclasses.dataclass(frozen=True)
class Rigid(regions.RigidPart, controls.HeavyPart):
    """A rigid part bonded to a face, in whose undeformed middle its mass is, or a region that is rigid."""

    face: str = schema.field_of(schema.Words(), "face of the device that the rigid part is bonded to, such as top", "")
    kind: str = schema.field_of(schema.Choice(KINDS), "whether it is free, guided along a direction, or held", "free")
    direction: tuple[float, ...] = schema.field_of(
        schema.Several(schema.Quantity()), "direction of the guide, such as [0, 0, 1]; default: the device's lift", ()
    )

    mass: float = schema.field_of(schema.Quantity("kg"), "mass of the rigid part, on which gravity acts", 0.0)
    region: str = schema.field_of(schema.Words(), "rigid region of the device, instead of a face", "")

    table: ClassVar[str] = "rigid"
    needs: ClassVar[str] = "a rigid part needs a face, such as face = 'top' in [rigid.plate], or a region"

    figure_texts: ClassVar[Mapping[str, tuple[str, str]]] = {
        r"(\w+)_turn_([xyz])_deg": (
            "rotation of {0} about {1}",
            "rotation of that rigid part: component of axis times angle",
        ),
        r"(\w+)_force_N": (
            "force on {0}",
            "of the device (with its weight) and its air on that rigid part, along its guide or the "
            "device's lift; it balances the support of the part, or its own weight and loads",
        ),
        r"(\w+)_force_([xyz])_N": ("force on {0} along {1}", "the same along that direction"),
        r"(\w+)_moment_([xyz])_Nmm": (
            "moment on {0} about {1}",
            "of the device and its air on it, about its centre",
        ),
    }

    def check(self) -> None:
        if bool(self.face) == bool(self.region):
            raise self.error(f"{self.needs}, and not both")
        if self.region and self.mass:
            raise self.error("a region's weight follows from its density; leave out the mass")
        if self.direction and self.kind != "guided":
            raise self.error(f"a direction needs kind = 'guided', but this part is {self.kind}")
        if self.direction and (len(self.direction) != 3 or not np.linalg.norm(self.direction) > 0):
            raise self.error(f"direction is {list(self.direction)}; it needs three numbers, such as [0, 0, 1]")

        if self.mass:
            controls.check_finite(self.mass, self.where, "mass")

    @property
    def weighs(self) -> float:
        return self.mass

    @property
    def steadies(self) -> tuple[str, ...]:
        return (self.face or self.region,) if self.kind != "free" else ()

    def masses(self, on: controls.DistributedLoad, along: Array) -> list[controls.Weighed]:
        return [controls.Weighed([on.mean(along, self.face)], self.mass, self.key)] if self.mass else []

    def check_on(self, actuator: Actuator) -> None:
        if self.region:
            component.check_regions(self.where, actuator, [self.region])
        faces = component.bases(self.where, [self.face], actuator)
        if other := next((face for face in faces if face not in component.faces_of(actuator)), ""):
            raise self.error(
                f"{type(actuator).__name__} has no face {other!r} for a rigid part; it has "
                f"{', '.join(component.faces_of(actuator)) or 'none'}"
            )
        if any(hold.role in faces for hold in actuator.holds) and self.kind != "held":
            raise self.error(
                f"the face {self.face!r} is the device's fixed support, so a rigid part on it "
                "cannot move; use another face, or kind = 'held'"
            )
        self.freedom(actuator, np.zeros(actuator.dimension))

    def inside(self, actuator: Actuator) -> tuple[str, ...]:
        return (self.region,) if self.region else ()

    @property
    def variable(self) -> Mapping[str, str]:
        return {"mass": "kg"} if self.mass else {}

    def undesigned(self, actuator: Actuator) -> str:
        turns = len(self.freedom(actuator, np.zeros(actuator.dimension)).axes) > 0
        return "which can rotate about a point that the design moves; guide it (kind = 'guided')" if turns else ""

    def freedom(self, actuator: Actuator, centre: Array) -> regions.Freedom:
        """Return the motions left to it about a point; `ComponentError` if the symmetry forbids what it is guided along, or
        leaves no motion."""
        d = actuator.dimension
        if self.kind == "held":
            return regions.Freedom(centre, np.empty((0, d)), np.empty((0, 3)))
        directions, axes = symmetric_motions(actuator)
        if self.kind == "guided":
            wanted = np.asarray(self.direction or actuator.lift, dtype=float)
            wanted /= np.linalg.norm(wanted)
            inside = body.in_section(wanted, d)
            if (
                np.linalg.norm(inside @ directions.T @ directions - inside) > regions.HELD_TOLERANCE
                or np.linalg.norm(inside) < 1 - regions.HELD_TOLERANCE
            ):
                raise self.error(
                    f"a guide along {_shown(wanted)} breaks the symmetry of the device's model, "
                    f"which allows {_allowed(directions)}; use another direction, or {actuator.fuller}"
                )
            return regions.Freedom(centre, inside[None, :], np.empty((0, 3)))
        if not len(directions) + len(axes):
            raise self.error(
                f"the symmetry of the device's model leaves the rigid part no free motion; use "
                f"{actuator.fuller}, or kind = 'held'"
            )
        return regions.Freedom(centre, directions, axes)


def symmetric_motions(actuator: Actuator) -> tuple[Array, Array]:
    """Return the rigid motions that keep the device's cut planes where they are: orthonormal directions of translations in the
    mesh's coordinates, shape (k, d), and axes of rotations, shape (m, 3)."""
    d = actuator.dimension
    normals = [body.in_section(plane.normal, d) for plane in actuator.cut_planes]
    if d == 2:
        normals.append(np.array([1.0, 0.0]))  # off the axis
    directions: list[Array] = []
    for axis in np.eye(d)[::-1]:
        left = axis.copy()
        for _ in range(3):  # oblique normals are not orthogonal: once is not enough
            for known in (*_basis(normals), *directions):
                left -= (left @ known) * known
        if np.linalg.norm(left) > 1e-6:
            directions.append(left / np.linalg.norm(left))
    directions.reverse()
    planes = _basis(normals)
    axes = np.empty((0, 3)) if d == 2 or len(planes) > 1 else np.array(planes) if planes else np.eye(3)
    return np.array(directions).reshape(-1, d), axes


def _basis(vectors: Sequence[Array]) -> list[Array]:
    basis: list[Array] = []
    for vector in vectors:
        left = np.array(vector, dtype=float)
        for known in basis:
            left -= (left @ known) * known
        if np.linalg.norm(left) > 1e-6 * np.linalg.norm(vector):
            basis.append(left / np.linalg.norm(left))
    return basis


def _shown(direction: Array) -> str:
    return "(" + ", ".join(f"{x:.3g}" for x in direction) + ")"


def _allowed(directions: Array) -> str:
    if not len(directions):
        return "no translation"
    return "translations along " + " and ".join(_shown(v) for v in body.in_space(directions))


# ----------------------------------------------------------------------------------------------------------------------
# Clamps: faces, edges or regions that are held, or held so that they slip in one direction.
#
# They are added to the device's own supports. A clamp on one of the device's own supports replaces it:
# ``[hold.bench]`` with ``face = "support"`` and ``along = "z"`` lets a glued disk slide on its bench.


@component.register_component
@dataclasses.dataclass(frozen=True)
class Clamp(regions.HoldingPart):
    """A support of faces, edges, points or regions, with commas between: ``"clamp, clamp_top"``."""

    face: str = schema.field_of(schema.Words(), "faces, edges or regions that are held, such as top")
    along: str = schema.field_of(schema.Words(), "direction along which they are held, such as z: they slip across it", "")
    slip: str = schema.field_of(schema.Words(), "direction in which they slip, such as x: they are held across it", "")
    together: bool = schema.field_of(
        schema.Flag(), "held along that direction only together: the plane face stays plane, and travels", False
    )

    table: ClassVar[str] = "hold"
    differentiable: ClassVar[bool] = True
    needs: ClassVar[str] = "[hold] needs a face, such as face = 'top'"

    def check(self) -> None:
        if not self.roles:
            raise ComponentError(self.needs)
        if self.along and self.slip:
            raise ComponentError(f"{self.where} has both along and slip; give either the held or the free direction")
        if self.together and not self.along:
            raise self.error("together needs the direction along which the face travels, such as along = 'x'")
        for text in filter(None, (self.along, self.slip)):
            direction(text, self.where)

    @property
    def roles(self) -> list[str]:
        return component.names_in(self.face)

    def check_on(self, actuator: Actuator) -> None:
        """Raise `ComponentError` if a device has no such face, or its mesh no such direction."""
        known = list(dict.fromkeys([*component.faces_of(actuator), *actuator.regions, *(hold.role for hold in actuator.holds)]))
        for role in component.bases(self.where, self.roles, actuator):
            if role not in known:
                raise self.error(f"{type(actuator).__name__} has no {role!r}; {errors.known_are(role, known)}")
        self.holds(actuator)

    def inside(self, actuator: Actuator) -> tuple[str, ...]:
        return tuple(role for role in self.roles if role in actuator.regions)

    def holds(self, actuator: Actuator) -> list[Hold]:
        """Return what it holds on a device; `ComponentError` for a direction that an axisymmetric section does not have."""
        points = {hold.role for hold in actuator.holds if hold.point}
        return [Hold(role, way, role in points, self.together) for role in self.roles for way in self._ways(actuator)]

    def _ways(self, actuator: Actuator) -> list[Vector | None]:
        text = self.along or self.slip
        if not text:
            return [None]
        way = direction(text, self.where)
        if actuator.dimension == 2 and max(abs(way[0]), abs(way[2])) < 1 - 1e-12:
            raise self.error(f"a section has only the directions x (away from its axis) and z, not {text!r}")
        if self.along:
            return [way]
        return _across(way, actuator)

    @property
    def label(self) -> str:
        """Label with its kind, because a region or a load may have the same name."""
        return f"hold_{self.name}" if self.name else self.table


def _across(way: Vector, actuator: Actuator) -> list[Vector | None]:
    """Return the unit vectors perpendicular to a direction and to each other, those of the device's own planes and holds
    first."""
    known = [plane.normal for plane in actuator.cut_planes]
    known += [hold.direction for hold in actuator.holds if hold.direction is not None]
    axes = np.eye(3)[[0, 2]] if actuator.dimension == 2 else np.eye(3)
    across: list[npt.NDArray[np.float64]] = []
    for candidate in [*np.array(known).reshape(-1, 3), *axes]:
        if abs(candidate @ np.array(way)) < 1e-9 and all(abs(candidate @ other) < 1e-9 for other in across):
            across.append(candidate / np.linalg.norm(candidate))
    if actuator.dimension == 3 and len(across) < 2:
        first = across[0] if across else np.linalg.svd(np.array([way]))[2][1]
        across = [first, np.cross(way, first)]
    return [(float(x), float(y), float(z)) for x, y, z in across]


# ----------------------------------------------------------------------------------------------------------------------
# Springs: soft supports of bodies and faces, such as of a body that only contact holds.


@component.register_component
@dataclasses.dataclass(frozen=True)
class Spring(component.EnergyComponent):
    """A region or a face on springs, evenly spread, which pull each of its points back to where it was."""

    on: str = schema.field_of(schema.Words(), "region, or faces, on evenly spread springs, such as ball")
    stiffness: float = schema.field_of(schema.Quantity("N/m"), "force per displacement of all springs together")

    table: ClassVar[str] = "spring"
    needs: ClassVar[str] = "[spring.name] needs a region or a face and a stiffness (on = 'ball', stiffness = '0.1 N/m')"
    figure_texts: ClassVar[Mapping[str, tuple[str, str]]] = {
        r"(\w+)_spring_([xyz])_N": ("spring {0} along {1}", "force of the springs on the device, along the named axis"),
        r"(\w+)_spring_mJ": ("energy of spring {0}", "energy stored in those springs"),
    }

    def check(self) -> None:
        if not component.names_in(self.on):
            raise ComponentError(self.needs)
        if not 0.0 < self.stiffness < np.inf:
            raise self.error(f"the stiffness is {self.stiffness:g} N/m; it must be above zero")

    def check_on(self, actuator: Actuator) -> None:
        if self.on not in actuator.regions:
            component.check_on_mesh(self.where, actuator, component.names_in(self.on))

    def undesigned(self, actuator: Actuator) -> str:
        return "" if self.on not in actuator.regions else "on a region, whose volume a design may change"

    @property
    def in_model(self) -> str:
        return f"; springs of {self.stiffness:g} N/m hold {self.on} (numerical, or real ones)"

    @property
    def steadies(self) -> tuple[str, ...]:
        return tuple(component.names_in(self.on))

    def term(self, setting: component.FormContext) -> component.EnergyTerm:
        return SpringTerm(self, setting)


class SpringTerm(component.EnergyTerm):
    """The energy of such springs, and their force."""

    def __init__(self, part: Spring, setting: component.FormContext):
        self.part, self.body, mesh = part, setting.body, setting.body.mesh
        regional = part.on in self.body.regions
        over = body.cell_measure(self.body, self.body.regions[part.on]) if regional else self.body.measure(part.on)
        u, size, copies = self.body.displacement(setting.displacement), self.body.actuator.size, self.body.actuator.copies
        unit_density = fem.Constant(mesh, 1.0)
        self._whole = fem.form(unit_density * self.body.hoop * over)
        amount = mpi.total(mesh.comm, fem.assemble_scalar(self._whole))
        if not amount > 0.0:
            raise part.error(f"{part.on} has no cells or facets on this mesh")
        self._stiffness = fem.Constant(mesh, part.stiffness / size / amount / copies)
        super().__init__([setting.per_pascal * self._stiffness / 2 * ufl.dot(u, u) * self.body.hoop * over])
        self._means = [u[i] / fem.Constant(mesh, amount) * self.body.hoop * over for i in range(len(u))]

    def compile(self, equations: component.Equations) -> None:
        self._compiled = [equations.form(mean) for mean in self._means]
        self._energy = equations.form(self.energies[0])

    def figures(self, equations: component.Equations) -> dict[str, float]:
        d, unit = self.body.actuator.dimension, equations.length_unit
        moved = [equations.integral(form) * unit for form in self._compiled]
        normals = [body.in_section(plane.normal, d) for plane in self.body.actuator.cut_planes] + [np.eye(2)[0]] * (d == 2)
        free = np.eye(d) - sum((np.outer(n, n) for n in _basis(normals)), np.zeros((d, d)))
        force = body.in_space(-self.part.stiffness * free @ np.array(moved))
        label, copies = self.part.label, self.body.actuator.copies
        stored = equations.integral(self._energy) * equations.stress_unit * unit**3 * copies
        forces = {f"{label}_spring_{axis}_N": float(value) for axis, value in zip("xyz", force, strict=True)}
        return (forces if d == 3 else {f"{label}_spring_z_N": float(force[2])}) | {f"{label}_spring_mJ": stored * 1e3}
