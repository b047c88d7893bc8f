"""Regions of a device with other materials, perfectly bonded to the rest; and what holds it.

A region is a physical group of cells: of a device's class, such as the ``base`` of a `PneuNet`, or a named solid of a STEP
file. The case's material fills all cells outside regions.
"""

from __future__ import annotations

import abc
import copy
import dataclasses
import math
import types
from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar, Self

import numpy as np
import numpy.typing as npt

from geometries import Actuator, Hold
from softmodels.common.lazy import fem, meshes, ufl
from softmodels.materials.laws import Material, MaterialError, parameter_fields
from softmodels.materials.silicones import material_of
from softmodels.materials.specimens import nudged
from softmodels.mechanics.assembly import numbered
from softmodels.mechanics.body import Body, cell_measure, in_section
from softmodels.mechanics.component import Component, ComponentError, Sealing, check_regions
from softmodels.mechanics.rigid import RigidPart


@dataclasses.dataclass(frozen=True)
class RegionPart(Component):
    """A region with its own law; its name is the region's."""

    material: Material

    def __post_init__(self) -> None:
        object.__setattr__(self, "material", material_of(f"{self.where} material", self.material))
        super().__post_init__()

    def check_on(self, actuator: Actuator) -> None:
        """Raise `ComponentError` if a device has no such region."""
        check_regions(self.where, actuator, [self.name])

    def cells(self, body: Body) -> npt.NDArray[np.int32]:
        """Return its local cells, ghosts too; `ComponentError` if the mesh has none."""
        if self.name not in body.regions:
            raise self.error(f"the mesh has no cells of this name; it has {', '.join(body.regions) or 'none'}")
        return body.regions[self.name]

    @property
    def own_density(self) -> float | None:
        """Density in kg/m3; None for that of `softmodels.components.loads.Gravity`."""
        return None

    def undesigned(self, actuator: Actuator) -> str:
        return ""

    def inside(self, actuator: Actuator) -> tuple[str, ...]:
        return (self.name,)

    @property
    def variable(self) -> Mapping[str, str]:
        return variable_numbers(self.material)

    def number(self, name: str) -> float:
        return number_of(self.material, name)

    def varied(self, name: str, value: float) -> Self:
        return dataclasses.replace(self, material=with_number(self.material, name, value))

    def nudged(self, name: str, by: complex) -> Self:
        made = copy.copy(self)
        object.__setattr__(made, "material", nudged(self.material, name, by))
        return made


class RigidRegion(RegionPart):
    """A region that is rigid."""

    table: ClassVar[str] = "rigid"


def variable_numbers(material: Material) -> dict[str, str]:
    """Return the units of a law's numbers that a design may vary, by name."""
    return {name: "Pa" if material.parameter_unit(name) == "Pa" else "" for name in material.parameters}


RATIO = "ratio"
"""Beginning of the names of the ratios of the cavities' pressures."""


def number_of(material: Material, name: str) -> float:
    """Return a law's number by the name that `variable_numbers` has."""
    return float(material.poisson if name == "poisson" else material.parameters[name])


def with_number(material: Material, name: str, value: float) -> Material:
    """Return a material with another number, checked."""
    moved = nudged(material, name, value - number_of(material, name))
    return dataclasses.replace(
        material, **{field.name: getattr(moved, field.name) for field in parameter_fields(material)}
    )


def check_compressible(main: Material, components: Sequence[Component], mixed: bool) -> None:
    """Raise `MaterialError` for an incompressible material without p as an unknown."""
    materials = [main, *(part.material for part in components if isinstance(part, RegionPart))]
    if not mixed and any(math.isinf(one.bulk) for one in materials):
        raise MaterialError("poisson = 0.5 needs the mixed formulation; a pure displacement formulation would lock")


def relaxed(material: Material, components: Sequence[Component]) -> tuple[Material, tuple[Component, ...]]:
    """Return a material and components with every silicone as it is after a long time, without its memory."""
    return material.relaxed, tuple(
        dataclasses.replace(part, material=part.material.relaxed) if isinstance(part, RegionPart) else part
        for part in components
    )


@dataclasses.dataclass(eq=False)
class MaterialRegion:
    """Cells of one material, with the constants that carry its parameters in the forms.

    Attributes:
        name: The region's; empty for the main one.
        material: Law and parameters; those of the main region may change.
        cells: Owned local cells.
        dx: Measure over them.
        parameters: The law's parameters by name, those that are stresses in shear moduli of the main material.
        bulk: Bulk modulus; its inverse in the mixed form: that may vanish, the bulk may not be infinite.
    """

    name: str
    material: Material
    cells: npt.NDArray[np.int32]
    dx: ufl.Measure
    parameters: types.SimpleNamespace
    bulk: fem.Constant

    def take(self, material: Material, mu: float, mixed: bool) -> None:
        """Set a material's parameters, in units of a shear modulus in Pa."""
        self.material = material
        for field in parameter_fields(material):
            value = np.asarray(getattr(material, field.name), dtype=float)
            getattr(self.parameters, field.name).value = value / mu if field.metadata["unit"] == "Pa" else value
        self.bulk.value = mu / material.bulk if mixed else material.bulk / mu


class Regions:
    """The materials of a body and where they are. ``numbers`` has the number of each local cell's region, 0 for the main one;
    None where that is the whole body.

    Raises:
        ComponentError: A region that the mesh does not have, or regions that leave nothing to the main material.
    """

    def __init__(self, body: Body, material: Material, components: Sequence[Component]):
        self._body, self._material = body, material
        self._parts = [part for part in components if isinstance(part, RegionPart)]
        named = {part.name for part in self._parts}
        # It has its own p and no strain, whatever its material: see `still_pressures`.
        rigid = [
            part for part in components if isinstance(part, RigidPart) and part.region and part.region not in named
        ]
        self._parts += [RigidRegion(material, name=part.region) for part in rigid]
        self.numbers: npt.NDArray[np.int32] | None = None
        if not self._parts:
            return
        self.numbers = numbered(body.mesh, [part.cells(body) for part in self._parts])
        counts = body.mesh.comm.allreduce(np.bincount(self.numbers[: self._owned()], minlength=1 + len(self._parts)))
        if not counts[0]:
            raise ComponentError(
                f"{self._parts[0].where}: the regions cover the whole device; leave one of them to the main material"
            )

    def _owned(self) -> int:
        topology = self._body.mesh.topology
        return int(topology.index_map(topology.dim).size_local)

    def main(self, parameters: types.SimpleNamespace, bulk: fem.Constant) -> MaterialRegion:
        """Return the region of the main material, by the constants of its law and of its bulk modulus."""
        if self.numbers is None:
            cells, dx = np.arange(self._owned(), dtype=np.int32), self._body.measures()[0]
        else:
            cells, dx = self._cells(0)
        return MaterialRegion("", self._material, cells, dx, parameters, bulk)

    def others(self) -> Iterator[MaterialRegion]:
        """Yield the other regions; their constants are made here."""
        for number, part in enumerate(self._parts, 1):
            parameters = constants(self._body.mesh, part.material)
            yield MaterialRegion(
                part.name, part.material, *self._cells(number), parameters, fem.Constant(self._body.mesh, 0.0)
            )

    def _cells(self, number: int) -> tuple[npt.NDArray[np.int32], ufl.Measure]:
        assert self.numbers is not None
        cells = np.flatnonzero(self.numbers == number).astype(np.int32)
        return cells[cells < self._owned()], cell_measure(self._body, cells)


def constants(mesh: meshes.Mesh, material: Material) -> types.SimpleNamespace:
    """Return UFL constants under the material's parameter names."""
    return types.SimpleNamespace(
        **{
            field.name: fem.Constant(mesh, np.asarray(getattr(material, field.name), dtype=float))
            for field in parameter_fields(material)
        }
    )


# ----------------------------------------------------------------------------------------------------------------------
# What holds a device: its own holds and those of clamps, as conditions on its displacement.


FREE = 1e-6
"""Smallest singular value of the held rigid motions, relative to the size, below which one of them is free."""


class HoldingPart(Component):
    """Something that holds faces, edges or regions of a device."""

    @property
    @abc.abstractmethod
    def roles(self) -> list[str]:
        """Names of what it holds."""

    @abc.abstractmethod
    def holds(self, actuator: Actuator) -> list[Hold]:
        """What it holds on a device, and in which directions."""


def held_with(own: Sequence[Hold], actuator: Actuator, components: Sequence[Component]) -> list[Hold]:
    """Return the supports of a device: its own, except those replaced by clamps and by seals, and the clamps."""
    clamps = [part for part in components if isinstance(part, HoldingPart)]
    roles = {role for clamp in clamps for role in clamp.roles} | {
        role for seal in seals(components) for role in seal.roles
    }
    kept = [hold for hold in own if hold.role not in roles]
    return [*kept, *(hold for clamp in clamps for hold in clamp.holds(actuator))]


def seals(components: Sequence[Component]) -> list[Sealing]:
    """Return what closes the first cavity among the components."""
    return [part.sealing for part in components if part.sealing]


def clamped(body: Body, components: Sequence[Component]) -> Body:
    """Return a body with the clamps' supports and its seal, on the same mesh; the body itself if there are none.

    Raises:
        ComponentError: A role that the mesh does not have, or a device that nothing keeps in its place any more.
    """
    clamps = [part for part in components if isinstance(part, HoldingPart)]
    sealing = seals(components)
    if not clamps and not sealing:
        return body
    for clamp in clamps:
        for role in clamp.roles:
            if role not in body.entities and role not in body.regions:
                known = ", ".join([*body.entities, *body.regions])
                raise clamp.error(f"the mesh has no {role!r}; it has {known}")
    held = body.held_by(held_with(body.holds, body.actuator, components))
    for seal in sealing:
        held = held.sealed_by(seal.roles, np.asarray(seal.point) / body.actuator.size, seal.normal)
    replaced = {hold.role for hold in body.holds} & {role for clamp in clamps for role in clamp.roles}
    if replaced and all(
        isinstance(part, HoldingPart | RegionPart) for part in components
    ):  # other parts may refer to it
        _check_place(held, clamps[0].where)
    return held


def _check_place(body: Body, where: str) -> None:
    mesh, d = body.mesh, body.actuator.dimension
    modes = np.zeros((6, 6) if d == 3 else (1, 1))
    wanted = [(plane.name, plane.normal) for plane in body.actuator.cut_planes]
    for role, way in [*wanted, *((hold.role, hold.direction) for hold in body.holds)]:
        dimension, found = body.group(role)
        mesh.topology.create_connectivity(dimension, mesh.topology.dim)
        places = mesh.geometry.x[np.unique(meshes.entities_to_geometry(mesh, dimension, found))]
        for e in np.eye(d) if way is None else in_section(way, d)[None]:
            turns = np.cross(places, np.broadcast_to(e, places.shape)) if d == 3 else np.empty((len(places), 0))
            moves = np.broadcast_to(e if d == 3 else e[1:], (len(places), d if d == 3 else 1))
            rows = np.hstack([moves, turns])
            modes += rows.T @ rows
    modes = mesh.comm.allreduce(modes)
    if np.sqrt(max(np.linalg.eigvalsh(modes)[0], 0.0)) < FREE:
        raise ComponentError(
            f"{where}: with these supports the device can move as a rigid body; hold it in all directions, or hold another "
            f"point"
        )


def conditions(body: Body, vectors: fem.FunctionSpace) -> list[fem.DirichletBC]:
    """Return the components of a body's displacement that are held at zero."""
    return [fem.dirichletbc(np.array(0.0), dofs, vectors.sub(i)) for i, dofs in body.held(vectors)]
