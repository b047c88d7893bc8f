"""Regions of a device with other materials, perfectly bonded to the rest; rigid parts; and what holds the device.

A region is a physical group of cells: of a device's class, such as the ``base`` of a `PneuNet`, or a named solid of a STEP
file. The case's material fills all cells outside regions.
"""

from __future__ import annotations

import abc
import copy
import dataclasses
import itertools
import math
import re
import types
from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar, Self

import numpy as np
import numpy.typing as npt

from geometries import Actuator, Hold
from softmodels.common.arrays import Array
from softmodels.common.lazy import MPI, Expr, fem, meshes, scipy, ufl
from softmodels.materials import laws, silicones
from softmodels.materials.laws import Material, MaterialError
from softmodels.materials.specimens import nudged
from softmodels.mechanics import assembly, component, mpi
from softmodels.mechanics.body import Body, cell_measure, in_section, pieces_in
from softmodels.mechanics.component import Component, ComponentError


class Regions:
    """The materials of a body and where they are. ``numbers`` has the number of each local cell's region, 0 for the main one;
    None where that is the whole body.

    Raises:
        ComponentError: A region that the mesh does not have, regions with cells in common, or that leave nothing to the main
            material.
    """

    def __init__(self, body: Body, material: Material, components: Sequence[Component]):
        self._body, self._material = body, material
        self._parts = [part for part in components if isinstance(part, RegionPart)]
        named = {part.name for part in self._parts}
        # It has its own p and no strain, whatever its material: see `still_pressures`.
        rigid = [part for part in components if isinstance(part, RigidPart) and part.region and part.region not in named]
        self._parts += [RigidRegion(material, name=part.region) for part in rigid]
        self.numbers: npt.NDArray[np.int32] | None = None
        if not self._parts:
            return
        cells = [part.cells(body) for part in self._parts]
        self._check_apart(cells)
        self.numbers = assembly.numbered(body.mesh, cells)
        counts = body.mesh.comm.allreduce(np.bincount(self.numbers[: self._owned()], minlength=1 + len(self._parts)))
        if not counts[0]:
            raise ComponentError(
                f"{self._parts[0].where}: the regions cover the whole device; leave one of them to the main material"
            )

    def _check_apart(self, cells: Sequence[npt.NDArray[np.int32]]) -> None:
        """Reject regions that share cells: which material those have would depend on the order of the tables."""
        own = [group[group < self._owned()] for group in cells]
        for (i, part), (j, other) in itertools.combinations(enumerate(self._parts), 2):
            sizes = [len(np.intersect1d(own[i], own[j])), len(own[i]), len(own[j])]
            common, first, second = self._body.mesh.comm.allreduce(np.array(sizes)).tolist()
            if common:
                raise shared_cells(part, other, common, first, second)

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
            yield MaterialRegion(part.name, part.material, *self._cells(number), parameters, fem.Constant(self._body.mesh, 0.0))

    def _cells(self, number: int) -> tuple[npt.NDArray[np.int32], ufl.Measure]:
        assert self.numbers is not None
        cells = np.flatnonzero(self.numbers == number).astype(np.int32)
        return cells[cells < self._owned()], cell_measure(self._body, cells)


def shared_cells(part: Component, other: Component, common: int, first: int, second: int) -> ComponentError:
    """Return the error of two regions with so many cells in common, of which the first and the second have so many."""
    return other.error(
        f"{common} of its {second} cells are also among the {first} of {part.where}, and a cell has one material: "
        "change the conditions (within), or the regions of the mesh, so that they exclude each other"
    )


def constants(mesh: meshes.Mesh, material: Material) -> types.SimpleNamespace:
    """Return UFL constants under the material's parameter names."""
    return types.SimpleNamespace(
        **{
            field.name: fem.Constant(mesh, np.asarray(getattr(material, field.name), dtype=float))
            for field in laws.parameter_fields(material)
        }
    )


# ----------------------------------------------------------------------------------------------------------------------
# How rigid parts move: rotations, a part's few unknowns and the dofs that follow them, and the forces on it.


HELD_TOLERANCE = 1e-9
"""Motion of a held dof per motion of a part, in sizes of the device, up to which the part does not move it."""


# ----------------------------------------------------------------------------------------------------------------------
# Rotations by Cayley's parameters: rational in them, so that derivatives of any order are exact and short.
#
# A vector v represents the rotation about v by the angle 2 atan(|v|/2), which for small ones is |v|:
#
#     R(v) = 1 + (V + V V / 2) / D,    D = 1 + v.v / 4,    V x = v cross x
#
# Only a rotation by 180 degrees has none. (Bauchau & Trainelli 2003, The vectorial parameterization of rotation, doi
# 10.1023/A:1024265401576.)


def cross(v: Array) -> Array:
    """Return the matrix of v's cross product, shape (3, 3); of several, shape (..., 3, 3)."""
    v = np.asarray(v, dtype=float)
    zero = np.zeros(v.shape[:-1])
    rows = [[zero, -v[..., 2], v[..., 1]], [v[..., 2], zero, -v[..., 0]], [-v[..., 1], v[..., 0], zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


class Turn:
    """R(v), ``matrix`` of shape (3, 3), where v is a sum of amounts, shape (m,), of unit axes, shape (m, 3), and its
    derivatives by these amounts."""

    def __init__(self, amounts: Array, axes: Array):
        self._v, self._axes = amounts @ axes, axes
        self._V, self._A = cross(self._v), cross(axes)
        self._D = 1 + self._v @ self._v / 4
        self._N = self._V + self._V @ self._V / 2
        self._slopes_D = axes @ self._v / 2
        self._slopes_N = self._A + (self._A @ self._V + self._V @ self._A) / 2
        self.matrix = np.eye(3) + self._N / self._D

    def slopes(self) -> Array:
        """Return dR by each amount, shape (m, 3, 3)."""
        return self._slopes_N / self._D - self._N * (self._slopes_D / self._D**2)[:, None, None]

    def curvatures(self) -> Array:
        """Return the second derivatives of R, shape (m, m, 3, 3)."""
        A, N, D, first = self._A, self._N, self._D, self._slopes_D
        products = np.einsum("iab,jbc->ijac", A, A)
        second_N = (products + products.swapaxes(0, 1)) / 2
        second_D = self._axes @ self._axes.T / 2
        mixed = np.einsum("iab,j->ijab", self._slopes_N, first)
        mixed = mixed + mixed.swapaxes(0, 1)
        factor = 2 * np.outer(first, first) / D**3 - second_D / D**2
        return np.asarray(second_N / D - mixed / D**2 + np.einsum("ab,ij->ijab", N, factor))


def amounts(R: Array, axes: Array) -> Array:
    """Return the amounts of axes whose `Turn` a rotation is, shape (m,); the reverse of it."""
    skew = (R - R.T) / 2
    v = np.array([skew[2, 1], skew[0, 2], skew[1, 0]]) * 4 / (1 + np.trace(R))
    return np.asarray(axes @ v)


def nearest(moments: Array, axes: Array) -> Array:
    """Return the rotation, shape (3, 3), about no axis, one, or all three (unit vectors, shape (m, 3)) that takes arms r
    nearest to arms r', by the sum of r' r^T over points, shape (3, 3).

    Kabsch 1976, doi 10.1107/S0567739476001873; about one axis in closed form.
    """
    if len(axes) == 0:
        return np.eye(3)
    if len(axes) == 1:
        a = axes[0]
        flat = np.eye(3) - np.outer(a, a)
        # Sums of r.r' and of a.(r cross r') square to the axis.
        angle = np.arctan2(np.sum(cross(a) * moments), np.sum(flat * moments))
        return np.asarray(np.eye(3) + np.sin(angle) * cross(a) + (1 - np.cos(angle)) * cross(a) @ cross(a))
    left, _, right = np.linalg.svd(moments)
    proper = np.diag([1.0, 1.0, np.linalg.det(left @ right)])
    return np.asarray(left @ proper @ right)


def rotation_vector(R: Array) -> Array:
    """Return the axis times angle in rad (0 to pi) of a rotation, shape (3,)."""
    return np.asarray(scipy.spatial.transform.Rotation.from_matrix(R).as_rotvec())


# ----------------------------------------------------------------------------------------------------------------------
# Motion of a rigid part: its few unknowns, the dofs that follow them, and the resultants of forces on these.
#
# A point X of the part moves by u = t + (R - 1)(X - c), with its centre c, a translation t in its free directions, and a
# rotation R about its free axes. R = R(v) R0: only the rotation v from the current state is an unknown, so
# that large rotations meet no singularity.


Ints = npt.NDArray[np.int32]


@dataclasses.dataclass(frozen=True, eq=False)
class Freedom:
    """The free motions of a part about its centre c, shape (d,), in sizes of the device: orthonormal directions of
    translations, shape (k, d), and unit axes of rotations, shape (m, 3): none, one, or three."""

    centre: Array
    directions: Array
    axes: Array

    @property
    def count(self) -> int:
        return len(self.directions) + len(self.axes)


class RigidMotion:
    """The motion of one rigid part of a mesh, with w = B u by the body's skew B.

    Args:
        comm: Communicator.
        freedom: The motions left to it.
        skew: B.
        dofs: Local indices of the dofs that follow it, by node and component of w, shape (nodes, d), this rank's ghosts too.
        places: The nodes' undeformed places, shape (nodes, d).
        owned: Which of the nodes are this rank's own, shape (nodes,).

    Attributes:
        values: The unknowns: amounts of the directions and, from the base rotation on, of the axes.
    """

    def __init__(self, comm: MPI.Comm, freedom: Freedom, skew: Array, dofs: Ints, places: Array, owned: npt.NDArray[np.bool_]):
        self.comm, self.freedom, self.skew, self.dofs, self.owned = comm, freedom, skew, dofs, owned
        self.places = places
        self._unskewed = np.linalg.inv(skew)
        self.arms = places - freedom.centre
        self.values = np.zeros(freedom.count)
        self._base = np.eye(3)
        self._turn = self._turned(self.values)
        self._steady = self._rates_of_directions()
        self._count = self.sum(float(np.count_nonzero(owned)))
        self._mean_arm = self.sum(self.arms[owned].sum(axis=0)) / self._count

    @property
    def turns(self) -> bool:
        return len(self.freedom.axes) > 0

    def sum[T: (float, Array)](self, value: T) -> T:
        """Over all ranks."""
        return value if self.comm.size == 1 else self.comm.allreduce(value)

    # -- the state ----------------------------------------------------------------------------------------------------

    def take(self, w: Array) -> None:
        """Set the motion nearest to that of local dofs; its rotation becomes the base."""
        if self.turns:
            self._base = self._fitted(w)
        self.set(self.at(w))

    def set(self, values: Array) -> None:
        """Set other values of the unknowns."""
        self.values = np.array(values)
        if self.turns:
            self._turn = self._turned(self.values)

    def at(self, w: Array) -> Array:
        """Return the unknowns' values of the motion nearest to that of local dofs, from the present base on."""
        mean = self.sum((w[self.dofs[self.owned]] @ self._unskewed.T).sum(axis=0)) / self._count
        if not self.turns:
            return self.freedom.directions @ mean
        R = self._fitted(w)
        moved = mean - (R - np.eye(3)) @ self._mean_arm
        return np.concatenate([self.freedom.directions @ moved, amounts(R @ self._base.T, self.freedom.axes)])

    def _fitted(self, w: Array) -> Array:
        """Return the rotation nearest to that of local dofs, shape (3, 3)."""
        arms = self.arms[self.owned]
        reached = arms + w[self.dofs[self.owned]] @ self._unskewed.T
        total = self.sum(np.concatenate([reached.sum(axis=0), (reached.T @ arms).ravel()]))
        moments = total[3:].reshape(3, 3) - np.outer(total[:3], self._mean_arm)
        return nearest(moments, self.freedom.axes)

    def _turned(self, values: Array) -> Turn:
        return Turn(values[len(self.freedom.directions) :], self.freedom.axes)

    @property
    def translation(self) -> Array:
        """Displacement of the centre, shape (d,)."""
        return self.values[: len(self.freedom.directions)] @ self.freedom.directions

    @property
    def rotation(self) -> Array:
        """Rotation R, shape (3, 3)."""
        return self._turn.matrix @ self._base

    def displacements(self) -> Array:
        """Return the values of w at the part's nodes, shape as ``dofs``."""
        u = np.broadcast_to(self.translation, self.arms.shape)
        if self.turns:
            u = u + self.arms @ (self.rotation - np.eye(3)).T
        return np.asarray(u @ self.skew.T)

    # -- linear -------------------------------------------------------------------------------------------------------

    def _rates_of_directions(self) -> Array:
        along = self.freedom.directions @ self.skew.T
        return np.broadcast_to(along.T, (len(self.dofs), *along.T.shape))

    def rates(self) -> Array:
        """Return the derivatives of w at the part's nodes by the unknowns, shape (nodes, d, count)."""
        if not self.turns:
            return self._steady
        slopes = self._turn.slopes() @ self._base
        turning = np.einsum("ab,mbc,nc->nam", self.skew, slopes, self.arms)
        return np.concatenate([self._steady, turning], axis=2)

    def nearest_rate(self, w: Array) -> Array:
        """Return the rate of the unknowns whose dofs are nearest to local dofs, shape (count,)."""
        rates = self.rates()[self.owned]
        square = self.sum(np.einsum("nam,nak->mk", rates, rates))
        return np.linalg.solve(square, self.work(w))

    def work(self, b: Array) -> Array:
        """Return the forces conjugate to the unknowns, of owned entries b conjugate to w: over all ranks, shape (count,)."""
        return self.sum(np.einsum("nam,na->m", self.rates()[self.owned], b[self.dofs[self.owned]]))

    def curvature(self, b: Array) -> Array:
        """Return the second derivatives by the unknowns of the work of entries b conjugate to w: over all ranks, shape (count,
        count)."""
        curvature = np.zeros((self.freedom.count, self.freedom.count))
        if self.turns:
            k = len(self.freedom.directions)
            moments = (b[self.dofs[self.owned]] @ self.skew).T @ self.arms[self.owned]
            curvature[k:, k:] = np.einsum("ijab,ab->ij", self._turn.curvatures() @ self._base, self.sum(moments))
        return curvature

    def wrench(self, b: Array) -> tuple[Array, Array]:
        """Force, shape (d,), and moment about the centre where it is now, shape (3,), of owned entries conjugate to w."""
        forces = b[self.dofs[self.owned]] @ self.skew
        if forces.shape[1] < 3:
            return self.sum(forces.sum(axis=0)), np.zeros(3)
        arms = self.arms[self.owned] @ self.rotation.T
        both = self.sum(np.concatenate([forces.sum(axis=0), np.cross(arms, forces).sum(axis=0)]))
        return both[:3], both[3:]


class RigidPart(Component):
    """A part that moves but keeps its shape; a kind is a dataclass of it with the fields below.

    Attributes:
        face: Role of the facets that it is bonded to; empty for a region.
        region: Physical group of cells that is rigid; empty for a face.
    """

    face: str
    region: str

    @abc.abstractmethod
    def freedom(self, actuator: Actuator, centre: Array) -> Freedom:
        """The motions left to it about the point that it turns about; `ComponentError` if the symmetry of the model leaves it
        none."""


# ----------------------------------------------------------------------------------------------------------------------
# Regions, and what holds them.


@dataclasses.dataclass(frozen=True)
class RegionPart(Component):
    """A region with its own law; its name is the region's."""

    material: Material
    differentiable: ClassVar[bool] = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "material", silicones.material_of(f"{self.where} material", self.material))
        super().__post_init__()

    def check_on(self, actuator: Actuator) -> None:
        """Raise `ComponentError` if a device has no such region."""
        component.check_regions(self.where, actuator, [self.name])

    def cells(self, body: Body) -> npt.NDArray[np.int32]:
        """Return its local cells, ghosts too; `ComponentError` if the mesh has none."""
        if self.name not in body.regions:
            raise self.error(f"the mesh has no cells of this name; it has {', '.join(body.regions) or 'none'}")
        return body.regions[self.name]

    @property
    def own_density(self) -> float | None:
        """Density in kg/m3; None for that of `softmodels.components.loads.Gravity`."""
        return None

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


RATIO_PREFIX = "ratio"
"""Beginning of the names of the ratios of the cavities' pressures."""


def number_of(material: Material, name: str) -> float:
    """Return a law's number by the name that `variable_numbers` has."""
    if name in laws.FORM_ENERGIES:
        return float(np.real(material.forms.get(name, 0.0)))
    return float(material.poisson if name == "poisson" else material.parameters[name])


def with_number(material: Material, name: str, value: float) -> Material:
    """Return a material with another number, checked."""
    moved = nudged(material, name, value - number_of(material, name))
    return dataclasses.replace(
        material, **{field.name: getattr(moved, field.name) for field in laws.parameter_fields(material)}
    )


def check_compressible(main: Material, components: Sequence[Component], mixed: bool) -> None:
    """Raise `MaterialError` for an incompressible material without p as an unknown."""
    materials = [main, *(part.material for part in components if isinstance(part, RegionPart))]
    if not mixed and any(math.isinf(material.bulk) for material in materials):
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
        forms: Factors of `laws.FORM_ENERGIES`, which are 0 but for derivatives by them; no part of the potential.
    """

    name: str
    material: Material
    cells: npt.NDArray[np.int32]
    dx: ufl.Measure
    parameters: types.SimpleNamespace
    bulk: fem.Constant
    forms: dict[str, fem.Constant] = dataclasses.field(default_factory=dict)

    def shape(self, strain: laws.Strain) -> Expr:
        """Return the energy of the change of shape in shear moduli of the main material, with those of its forms."""
        energy = self.material.shape(strain, self.parameters)
        return energy + sum(factor * laws.FORM_ENERGIES[name](strain) for name, factor in self.forms.items())

    def take(self, material: Material, mu: float, mixed: bool) -> None:
        """Set a material's parameters, in units of a shear modulus in Pa."""
        self.material = material
        for field in laws.parameter_fields(material):
            value = np.asarray(getattr(material, field.name), dtype=float)
            getattr(self.parameters, field.name).value = value / mu if field.metadata["unit"] == "Pa" else value
        self.bulk.value = mu / material.bulk if mixed else material.bulk / mu
        for name, factor in self.forms.items():
            factor.value = material.forms.get(name, 0.0)


# ----------------------------------------------------------------------------------------------------------------------
# What holds a device: its own holds and those of clamps, as conditions on its displacement.


MIN_SINGULAR_VALUE = 1e-6
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
    roles = released(components) | {role for seal in seals(components) for role in seal.roles}
    kept = [hold for hold in own if hold.role not in roles]
    return [*kept, *(hold for clamp in clamps for hold in clamp.holds(actuator))]


def released(components: Sequence[Component]) -> set[str]:
    """Return the roles whose own supports clamps replace: those that they hold, and faces whose edges they hold as hinges."""
    roles = [role for part in components if isinstance(part, HoldingPart) for role in part.roles]
    edges = [piece.faces for role in roles for piece in pieces_in(role) if len(piece.faces) > 1]
    return {*roles, *itertools.chain(*edges)}


def seals(components: Sequence[Component]) -> list[component.Sealing]:
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
        _check_bodies(body, components)
        return body
    for clamp in clamps:
        for role in clamp.roles:
            if role not in body.entities and role not in body.regions:
                known = ", ".join([*body.entities, *body.regions])
                raise clamp.error(f"the mesh has no {role!r}; it has {known}")
    held = body.held_by(held_with(body.holds, body.actuator, components))
    for seal in sealing:
        held = held.sealed_by(seal.roles, np.asarray(seal.point) / body.actuator.size, seal.normal)
    replaced = {hold.role for hold in body.holds} & released(components)
    if replaced and not any(part.steadies for part in components):
        _check_place(held, clamps[0].where)
    _check_bodies(held, components)
    return held


def _check_bodies(body: Body, components: Sequence[Component]) -> None:
    """Raise `ComponentError` for one of several bodies that nothing connects with the others, or that only contact holds."""

    def on(names: Sequence[str], regions: Sequence[str]) -> bool:
        faces = [body.entities[name][1] for name in names if name not in body.regions and name in body.entities]
        here = any(name in regions for name in names) or any(len(body.facets_of(own, regions)) for own in faces)
        return mpi.any_rank(body.mesh.comm, here)

    for regions in body.actuator.bodies:
        if not regions:
            raise ComponentError("a body of the part has no name for its cells; give it one where it is meshed")
        others = ", ".join(" with ".join(names) for names in body.actuator.bodies)
        if not any(on(part.connects, regions) for part in components if part.connects):
            raise ComponentError(
                f"the part has bodies that share no face ({others}), and nothing acts between {regions[0]} and the others; "
                f"name what touches ([contact.joint] between = ['{regions[0]}', ...]), or join them where they are drawn"
            )
        cells = np.concatenate([body.regions[name] for name in regions])
        held = np.sqrt(max(_held_modes(body, cells)[0], 0.0)) >= MIN_SINGULAR_VALUE
        if not held and not any(on(part.steadies, regions) for part in components if part.steadies):
            name = re.sub(r"\W", "_", regions[0])
            raise ComponentError(
                f"only contact would hold the body {regions[0]}, so it can move freely until it is pressed; hold a face, an "
                f"edge or a direction of it ([hold.name]), or add a weak spring ([spring.{name}_spring] on = '{regions[0]}', "
                "stiffness = '0.1 N/m'), whose force is in path.csv"
            )


def _check_place(body: Body, where: str) -> None:
    if np.sqrt(max(_held_modes(body)[0], 0.0)) < MIN_SINGULAR_VALUE:
        raise ComponentError(
            f"{where}: with these supports the device can move as a rigid body; hold it in all directions, or hold another "
            f"point"
        )


def _held_modes(body: Body, cells: npt.NDArray[np.int32] | None = None) -> Array:
    """Return the eigenvalues of what the supports do to rigid motions, of all or of a body by its cells, the least first."""
    mesh, d = body.mesh, body.actuator.dimension
    modes = np.zeros((6, 6) if d == 3 else (1, 1))
    own = None if cells is None else np.unique(mesh.geometry.dofmaps[0][cells])
    wanted = [(plane.name, plane.normal) for plane in body.actuator.cut_planes]
    for role, way in [*wanted, *((hold.role, hold.direction) for hold in body.holds if not hold.together)]:
        dimension, entities = body.group(role)
        mesh.topology.create_connectivity(dimension, mesh.topology.dim)
        nodes = np.unique(meshes.entities_to_geometry(mesh, dimension, entities))
        places = mesh.geometry.x[nodes if own is None else np.intersect1d(nodes, own)]
        for e in np.eye(d) if way is None else in_section(way, d)[None]:
            turns = np.cross(places, np.broadcast_to(e, places.shape)) if d == 3 else np.empty((len(places), 0))
            moves = np.broadcast_to(e if d == 3 else e[1:], (len(places), d if d == 3 else 1))
            rows = np.hstack([moves, turns])
            modes += rows.T @ rows
    return np.asarray(np.linalg.eigvalsh(mesh.comm.allreduce(modes)))


def conditions(body: Body, vectors: fem.FunctionSpace) -> list[fem.DirichletBC]:
    """Return the components of a body's displacement that are held at zero."""
    return [fem.dirichletbc(np.array(0.0), dofs, vectors.sub(i)) for i, dofs in body.held(vectors)]
