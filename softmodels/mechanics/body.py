"""A meshed actuator for the mechanics: dimensionless coordinates, roles and pieces of them, slip planes, volume.

Lengths inside are multiples of the actuator's ``size`` so that tolerances are pure numbers.

Slip on cut planes that are not aligned with the axes is exact: the unknown is not u but w = B u, with the planes' normals as
the first rows of the constant matrix B. Then w_i = 0 on plane i is an ordinary condition on a component, and
grad u = B^-1 grad w.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from geometries import Actuator, Hold, meshing
from geometries.actuator import EDGE, Opening, Vector, cavity_roles, find_openings
from softmodels.common import errors, units
from softmodels.common.arrays import Array
from softmodels.common.errors import ComponentError
from softmodels.common.lazy import MPI, Expr, fem, gmsh, la, meshes, ufl
from softmodels.mechanics import compiling, mpi


@dataclasses.dataclass(frozen=True, eq=False)
class Body:
    """Mesh and roles of an actuator on a communicator.

    Attributes:
        actuator: The geometry.
        mesh: DOLFINx mesh in units of ``actuator.size``; 3-D, or the (r, z) half section of an axisymmetric device.
        cavity: Facet tags on the cavities' walls: `CAVITY_TAG` on the first one's, numbers after `SHEET_TAG` on others'.
        entities: Local mesh entities by role: name to (dimension, indices). A text such as ``"tip within z > 14 mm"`` is found
            there too, see `softmodels.mechanics.body`.
        skew: B, shape (d, d) with d the mesh's dimension: rows are directions in which a role may hold the body.
        regions: Local cells by the name of their physical group, ghosts too.
        holds: What is held beside the cut planes: the device's own holds, unless clamps hold it (`mechanics.regions`).
        openings: Where its cavities' walls end.
        seal: What closes its first cavity, where that is a plane on which its rim is free.
        straight: Number of the mesh's edges on curved faces that are straight.
    """

    actuator: Actuator
    mesh: meshes.Mesh
    cavity: meshes.MeshTags
    entities: Roles
    skew: npt.NDArray[np.float64]
    regions: dict[str, npt.NDArray[np.int32]] = dataclasses.field(default_factory=dict)
    holds: tuple[Hold, ...] = ()
    openings: tuple[Opening, ...] = ()
    seal: Seal | None = None
    straight: int = 0

    def __post_init__(self) -> None:
        # Made with the body, because the order in which constants are made is part of a form's signature.
        self._constant_inverse()

    @classmethod
    def from_file(cls, actuator: Actuator, path: Path, comm: MPI.Comm) -> Body:
        """Read the Gmsh file that ``actuator.write`` made (rank 0 reads, all receive).

        Raises:
            FileNotFoundError: No such file.
            MeshFileError: Not a mesh as ``actuator.write`` makes them.
            BodyError: A mesh of another device.
            CompilingError: DOLFINx cannot compile what a mesh needs.
        """
        from dolfinx.io import gmsh as gmshio

        with meshing.private_model() if mpi.is_root(comm) else contextlib.nullcontext():
            # An invalid file raises on all ranks; it must not hang.
            groups = mpi.on_root(comm, lambda: meshing.load_mesh(path, actuator.dimension))
            openings, straight = mpi.on_root(comm, lambda: (find_openings(actuator), meshing.straight_edges()))
            with compiling.compiling():
                data = gmshio.model_to_mesh(gmsh.model, comm, 0, gdim=actuator.dimension)
        data.mesh.geometry.x[:] /= actuator.size
        tdim = data.mesh.topology.dim
        by_dimension = {tdim - 1: data.facet_tags, tdim - 2: data.ridge_tags, tdim - 3: data.peak_tags}
        entities, regions = dict[str, Entities](), dict[str, npt.NDArray[np.int32]]()
        none = np.empty(0, dtype=np.int32)
        for dimension, tag, name in groups:  # what several groups of the mesh share belongs to each of their names
            if dimension == tdim:
                regions[name] = np.union1d(regions.get(name, none), data.cell_tags.find(tag))
            else:
                known = entities.get(name, (dimension, none))[1]
                entities[name] = (dimension, np.union1d(known, by_dimension[dimension].find(tag)))
        names = cavity_roles(actuator)
        if missing := [name for name in names if name not in entities]:
            raise BodyError(f"the mesh of {type(actuator).__name__} has no facets named {missing[0]!r} for the pressure")
        walls = [entities[name][1] for name in names]
        tags = np.repeat(_cavity_tags(len(names)), [len(wall) for wall in walls])
        facets = np.concatenate([*walls, np.empty(0, dtype=np.int32)])  # a beam has no cavity
        order = np.argsort(facets)
        cavity = meshes.meshtags(data.mesh, tdim - 1, facets[order], tags[order])
        holds = tuple(actuator.holds)
        roles = Roles(entities, functools.partial(selected, data.mesh, actuator))
        return cls(actuator, data.mesh, cavity, roles, _skew(actuator, holds), regions, holds, openings, straight=straight)

    def held_by(self, holds: Sequence[Hold]) -> Body:
        """Return the same body with other supports."""
        return dataclasses.replace(self, skew=_skew(self.actuator, holds), holds=tuple(holds))

    def sealed_by(self, roles: Sequence[str], point: npt.ArrayLike, normal: npt.ArrayLike) -> Body:
        """Return the same body, its first cavity closed by faces that press on a plane, in device coordinates and sizes of the
        device."""
        d, fdim = self.actuator.dimension, self.mesh.topology.dim - 1
        lips = np.unique(np.concatenate([self.entities[role][1] for role in roles]))
        facets = np.concatenate([self.cavity.indices, lips])
        tags = np.concatenate([self.cavity.values, np.full(len(lips), SHEET_TAG, dtype=np.int32)])
        order = np.argsort(facets)
        share = fem.Function(fem.functionspace(self.mesh, ("P", 2)))
        seal = Seal(tuple(roles), in_section(point, d), in_section(normal, d), share)
        return dataclasses.replace(self, cavity=meshes.meshtags(self.mesh, fdim, facets[order], tags[order]), seal=seal)

    def group(self, role: str) -> tuple[int, npt.NDArray[np.int32]]:
        """Return the dimension and local entities of a role or a region; `BodyError` if there is none."""
        if role in self.entities:
            return self.entities[role]
        if role not in self.regions:
            raise BodyError(f"the mesh has no entities named {role!r} for the supports")
        return self.mesh.topology.dim, self.regions[role]

    @property
    def axisymmetric(self) -> bool:
        return self.actuator.dimension == 2

    @property
    def skew_inverse(self) -> npt.NDArray[np.float64]:
        return np.linalg.inv(self.skew)

    def measures(self) -> tuple[ufl.Measure, ufl.Measure]:
        """Return the UFL measures over the reference body and its (first) cavity's wall, for the slice in 3-D, for the device
        in 2-D."""
        dx = ufl.Measure("dx", self.mesh, metadata={"quadrature_degree": QUADRATURE_DEGREE})
        return dx, self._on_facets(self.cavity)(CAVITY_TAG)

    @property
    def normal(self) -> Expr:
        """Undeformed normal of facets, out of the solid, with three components."""
        N = ufl.FacetNormal(self.mesh)
        return ufl.as_vector([N[0], 0, N[1]]) if self.axisymmetric else N

    @property
    def faces(self) -> list[str]:
        """Roles of its faces, without those that symmetry cuts."""
        cut = {plane.name for plane in self.actuator.cut_planes} | {"axis"}
        return [name for name, (of, _) in self.entities.items() if of == self.mesh.topology.dim - 1 and name not in cut]

    @property
    def outer_facets(self) -> npt.NDArray[np.int32]:
        """This rank's facets that bound the silicone, without those on planes of symmetry and on a section's axis."""
        topology, d = self.mesh.topology, self.mesh.topology.dim
        topology.create_connectivity(d - 1, d)
        planes = {plane.name for plane in self.actuator.cut_planes}
        cut = [facets for role, (_, facets) in self.entities.items() if role in planes]
        outer = np.setdiff1d(meshes.exterior_facet_indices(topology), np.concatenate([np.empty(0, dtype=np.int32), *cut]))
        if d == 2:
            outer = outer[meshes.compute_midpoints(self.mesh, 1, outer)[:, 0] > LENGTH_TOLERANCE]
        return outer

    def surface_of(self, region: str) -> npt.NDArray[np.int32]:
        """Return this rank's facets of a region's outside: not those on planes of symmetry, nor between it and others."""
        return self.facets_of(self.outer_facets, [region])

    def facets_of(self, facets: npt.NDArray[np.int32], regions: Sequence[str]) -> npt.NDArray[np.int32]:
        """Return those of some local facets that bound cells of regions."""
        topology, d = self.mesh.topology, self.mesh.topology.dim
        topology.create_connectivity(d - 1, d)
        to_cell, inside = topology.connectivity(d - 1, d), np.concatenate([self.regions[name] for name in regions])
        cells = np.array([to_cell.links(facet)[0] for facet in facets], dtype=np.int32)
        return np.asarray(facets[np.isin(cells, inside)])

    def sheet_face(self, role: str) -> tuple[ufl.Measure, Expr]:
        """Return the UFL measure over the facets of a role, and their `normal`; `BodyError` if it has none."""
        return self._on_facets(self._tags(role, self.mesh.topology.dim - 1))(SHEET_TAG), self.normal

    def measure(self, role: str) -> ufl.Measure:
        """Return the UFL measure over the facets or the edges of a role; `BodyError` if it has neither."""
        if not self.is_edge(role):
            return self.sheet_face(role)[0]
        tags, degree = self._tags(role, self.mesh.topology.dim - 2), {"quadrature_degree": SURFACE_DEGREE}
        return ufl.Measure("dr", self.mesh, subdomain_data=tags, metadata=degree)(SHEET_TAG)

    def is_edge(self, role: str) -> bool:
        """Return whether a role is of edges, in a section of their points."""
        return self.entities.get(role, (-1,))[0] == self.mesh.topology.dim - 2

    def _on_facets(self, tags: meshes.MeshTags) -> ufl.Measure:
        return ufl.Measure("ds", self.mesh, subdomain_data=tags, metadata={"quadrature_degree": SURFACE_DEGREE})

    def _tags(self, role: str, wanted: int) -> meshes.MeshTags:
        """Return `SHEET_TAG` on the entities of a role, which have a dimension."""
        dimension, entities = self.entities.get(role, (-1, np.empty(0, dtype=np.int32)))
        if dimension != wanted:
            faces = ", ".join(name for name, (of, _) in self.entities.items() if of == self.mesh.topology.dim - 1)
            if self.is_edge(role):
                raise ComponentError(f"{role!r} is an edge, which has no area; name a face: {faces}")
            raise BodyError(f"the mesh has no face named {role!r}; it has {faces}")
        entities = np.sort(entities)
        return meshes.meshtags(self.mesh, wanted, entities, np.full(len(entities), SHEET_TAG, dtype=np.int32))

    @property
    def hoop(self) -> Expr | float:
        """Factor of the measures: 2 pi R in an axisymmetric section, else 1."""
        return 2 * np.pi * ufl.SpatialCoordinate(self.mesh)[0] if self.axisymmetric else 1.0

    def displacement(self, w: Expr) -> Expr:
        """Return u of the skew components w; shape (d,)."""
        return ufl.dot(self._constant_inverse(), w)

    def deformation_gradient(self, w: Expr, at_axis: bool = False) -> Expr:
        """Return F as a 3 x 3 UFL tensor; in an axisymmetric section the order of directions is r, hoop, z.

        ``at_axis`` allows evaluation at R = 0, where u_r/R is the slope of u_r; integration points never lie there.
        """
        gradient = ufl.dot(self._constant_inverse(), ufl.grad(w))
        if not self.axisymmetric:
            return ufl.Identity(3) + gradient
        radius = ufl.SpatialCoordinate(self.mesh)[0]
        hoop = 1 + self.displacement(w)[0] / radius
        if at_axis:
            hoop = ufl.conditional(ufl.gt(radius, 1e-9), hoop, 1 + gradient[0, 0])
        return ufl.as_tensor(
            [
                [1 + gradient[0, 0], 0, gradient[0, 1]],
                [0, hoop, 0],
                [gradient[1, 0], 0, 1 + gradient[1, 1]],
            ]
        )

    def volume_integrand(self, w: Expr) -> Expr:
        """Return the integrand over the cavity wall whose integral is the deformed cavity's volume (divergence theorem).

        V = -1/3 int (X + u) . cof(F) N ds, N out of the solid. Cut planes add nothing because they hold the origin, nor does
        a plate elsewhere, from which X is counted. Above a plane that seals it is the sum of columns on the plane, so that no
        part of it depends on a rim that lifts. Within walls that end on planes that travel it is the flux of the places across
        their direction e, (x - x . e e) / 2, to which these planes add nothing wherever they are.
        """
        F = self.deformation_gradient(w)
        X = ufl.SpatialCoordinate(self.mesh)
        x = X + self.displacement(w)
        if self.seal:
            normal, point = (ufl.as_vector(list(map(float, v))) for v in (self.seal.normal, self.seal.point))
            return -ufl.dot(x - point, normal) * self.flow(w, normal) * self.hoop
        if self.axisymmetric:
            x = ufl.as_vector([x[0], 0, x[1]])
        if any(self.actuator.plate):
            x -= ufl.as_vector([float(value) / self.actuator.size for value in self.actuator.plate])
        flux = x / 3
        for hold in self.holds:
            if hold.together and any(opening.closed_by([hold]) for opening in self.openings):
                e = ufl.as_vector(hold.direction)
                flux = (x - ufl.dot(x, e) * e) / 2
        return -ufl.dot(flux, ufl.dot(ufl.cofac(F), self.normal)) * self.hoop

    def flow(self, w: Expr, direction: Expr) -> Expr:
        """Return the deformed area per undeformed area of a wall, projected along a direction of the mesh, out of the solid."""
        if self.axisymmetric:
            direction = ufl.as_vector([direction[0], 0, direction[1]])
        return ufl.dot(direction, ufl.dot(ufl.cofac(self.deformation_gradient(w)), self.normal))

    def on_walls(self, integrand: Expr, number: int) -> ufl.Form:
        """Return an integral over a cavity's walls, and its share over the faces that seal the first one."""
        ds = self._on_facets(self.cavity)
        walls = integrand * ds(int(_cavity_tags(number + 1)[-1]))
        return walls + self.seal.share * integrand * ds(SHEET_TAG) if self.seal and not number else walls

    def volumes(self, w: Expr) -> list[ufl.Form]:
        """Return UFL forms of the deformed cavities' volumes, one for each, of the skew components w."""
        integrand = self.volume_integrand(w)
        return [self.on_walls(integrand, number) for number in range(len(self.actuator.ratios))]

    def pressing(self, w: Expr, test: Expr) -> list[ufl.Form]:
        """Return the UFL forms of the work of a unit pressure on the cavities' walls on a test displacement's skew components,
        one for each.

        On dofs that are free they are the derivatives of `volumes`. These are others at the rim of an opening, where a support
        holds it: a rim that moved would tilt what closes the cavity there, which is no force of the air on the rim.
        """
        work = -self.flow(w, self.displacement(test)) * self.hoop
        return [self.on_walls(work, number) for number in range(len(self.actuator.ratios))]

    @property
    def chambers(self) -> npt.NDArray[np.float64]:
        """Volumes enclosed by rigid parts besides the cavities' walls, shape (k,); dimensionless, of the slice."""
        actuator = self.actuator
        volumes = np.zeros(len(actuator.ratios))
        volumes[:1] = actuator.chamber_volume / (actuator.size**3 * actuator.copies)
        return volumes

    def _constant_inverse(self) -> fem.Constant:
        # A Constant, so that another angle does not recompile the form.
        if not hasattr(self, "_inverse"):
            object.__setattr__(self, "_inverse", fem.Constant(self.mesh, self.skew_inverse))
        return self._inverse  # type: ignore[attr-defined]

    def held(self, space: fem.FunctionSpace) -> list[tuple[int, npt.NDArray[np.int32]]]:
        """Return the components of w and the dofs at which they vanish, in the numbering of ``space`` (vector-valued)."""
        topology = self.mesh.topology
        conditions = []
        for role, components in self._held_components():
            dimension, entities = self.group(role)
            topology.create_connectivity(dimension, topology.dim)
            for component in components:
                dofs = fem.locate_dofs_topological(space.sub(component), dimension, entities)
                conditions.append((component, dofs))
        return conditions

    def _held_components(self) -> list[tuple[str, list[int]]]:
        wanted: list[tuple[str, Vector | None]] = [(plane.name, plane.normal) for plane in self.actuator.cut_planes]
        wanted += [(hold.role, hold.direction) for hold in self.holds if not hold.together]
        every = list(range(self.actuator.dimension))
        return [(role, every if direction is None else [self.along(role, direction)[0]]) for role, direction in wanted]

    def along(self, role: str, direction: Vector) -> tuple[int, float]:
        """Return the component of w along a direction that a role is held in, and the displacement there for a unit of it."""
        weights = in_section(direction, self.actuator.dimension) @ self.skew_inverse
        largest = int(np.argmax(np.abs(weights)))
        if np.abs(np.delete(weights, largest)).max() > 1e-12 * abs(weights[largest]):
            raise BodyError(
                f"role {role!r} is held along {direction}, which is neither parallel nor perpendicular to the "
                f"directions of other roles"
            )
        return largest, float(weights[largest])


def _cavity_tags(count: int) -> npt.NDArray[np.int32]:
    return np.array([CAVITY_TAG, *range(SHEET_TAG + 1, SHEET_TAG + count)][:count], dtype=np.int32)


def _skew(actuator: Actuator, holds: Sequence[Hold]) -> npt.NDArray[np.float64]:
    """Return B: the unit directions of all supports, completed to a basis."""
    d = actuator.dimension
    wanted = [plane.normal for plane in actuator.cut_planes]
    wanted += [hold.direction for hold in holds if hold.direction is not None]
    rows: list[npt.NDArray[np.float64]] = []
    for direction in [*(in_section(v, d) for v in wanted), *np.eye(d)[::-1]]:
        candidate = [*rows, direction / np.linalg.norm(direction)]
        if len(candidate) <= d and np.linalg.svd(np.array(candidate), compute_uv=False)[-1] > 1e-6:
            rows = candidate
    return np.array(rows)


class BodyError(errors.OptionMessage, RuntimeError):
    """An unsuitable actuator or mesh; the message is for the user."""


@dataclasses.dataclass(frozen=True, eq=False)
class Seal:
    """A plane, in mesh coordinates and sizes of the device, shape (d,), on which faces close the first cavity where they press
    on it. ``share`` of the cavity's pressure acts on the faces: 1 inside the seal, 0 outside."""

    roles: tuple[str, ...]
    point: Array
    normal: Array
    share: fem.Function


# ----------------------------------------------------------------------------------------------------------------------
# Pieces of faces and edges between faces, by short texts that stand wherever a component names a face.
#
#     "tip"                                   a face of the device
#     "top, tip"                              several faces
#     "tip within z > 14 mm"                  the facets of a face whose middle lies there
#     "top within 5 mm < r < 9 mm and x > 0 mm"
#     "edge of tip and top"                   the edges that two faces share; also with within
#
# Coordinates are those of the undeformed device: x, y, z, the distance r from the z axis, and |x|, |y|, |z|. Only comparisons
# with lengths are read, joined by ``and``.


Entities = tuple[int, npt.NDArray[np.int32]]
"""Dimension and local indices of mesh entities."""
WITHIN = " within "
COORDINATE = r"\|[xyz]\||[xyzr]"
COMPARISON = re.compile(rf"(?:(.+?)(<=?)\s*)?({COORDINATE})\s*(?:(<=?|>=?)(.+))?")
EXAMPLE = "'tip within z > 14 mm', 'top within 5 mm < r < 9 mm and x > 0 mm' or 'edge of tip and top'"


@dataclasses.dataclass(frozen=True)
class Piece:
    """A face or an edge, or a part of it.

    Attributes:
        faces: The face, or the two faces whose edge it is.
        bounds: Coordinates with their lowest and highest values in m.
        text: As written.
    """

    faces: tuple[str, ...]
    bounds: tuple[tuple[str, float, float], ...]
    text: str

    def holds(self, places: Array) -> npt.NDArray[np.bool_]:
        """Return which places in device coordinates, m, shape (n, 3), lie within the bounds."""
        inside = np.ones(len(places), dtype=bool)
        for name, low, high in self.bounds:
            values = np.hypot(places[:, 0], places[:, 1]) if name == "r" else places[:, "xyz".index(name.strip("|"))]
            values = np.abs(values) if name.startswith("|") else values
            inside &= (values >= low) & (values <= high)
        return inside


def pieces_in(text: str) -> list[Piece]:
    """Return the pieces of a text, separated by commas; `ComponentError` for a part that has none of the forms above."""
    return [_piece(part.strip()) for part in text.split(",") if part.strip()]


def is_plain(text: str) -> bool:
    """Return whether a text is the name of one face."""
    return "," not in text and WITHIN not in text and not EDGE.match(text.strip())


def _piece(text: str) -> Piece:
    face, _, condition = text.partition(WITHIN)
    if text.endswith(WITHIN.rstrip()):
        raise ComponentError(f"{units.brief(text)} has no condition; write {EXAMPLE}")
    between = EDGE.fullmatch(face.strip())
    if between and between[1] == between[2]:
        raise ComponentError(f"{units.brief(text)} names one face twice; an edge is where two faces meet")
    names = between.groups() if between else (face.strip(),)
    parts = condition.split(" and ") if condition else []
    return Piece(names, tuple(bound for part in parts for bound in _bounds(text, part.strip())), text)


def _bounds(text: str, part: str) -> list[tuple[str, float, float]]:
    match = COMPARISON.fullmatch(part)
    if not match or not (match[1] or match[5]) or (match[1] and match[4] and ">" in match[4]):
        if coordinate := re.match(r"\s*\|?([A-Za-z_]\w*)\|?\s*[<>]", part):
            raise ComponentError(
                f"{units.brief(text)} uses the coordinate {coordinate[1]!r}; x, y, z, r, |x|, |y| and |z| are known"
            )
        raise ComponentError(
            f"{units.brief(text)}: {units.brief(part)} is not a comparison of a coordinate with a length; write {EXAMPLE}"
        )
    low, high = -np.inf, np.inf
    if match[1]:
        low = _length(text, match[1])
    if match[5]:
        value = _length(text, match[5])
        low, high = (low, value) if "<" in match[4] else (value, high)
    return [(match[3], low, high)]


def _length(text: str, value: str) -> float:
    plain = value.strip()
    if re.fullmatch(r"[-+]?[\d.]+(e[-+]?\d+)?", plain):
        raise ComponentError(f"{units.brief(text)}: the length {plain} has no unit; write it like {plain} mm")
    try:
        return units.quantity(plain, "m")
    except units.UnitError as error:
        raise ComponentError(f"{units.brief(text)}: {error}") from None


class Roles(dict[str, Entities]):
    """Mesh entities by role. A text such as ``"tip within z > 14 mm"`` or ``"top, tip"`` is found when it is first asked for;
    iteration goes over the mesh's own roles.

    Args:
        own: The mesh's own.
        find: Returns the entities of a text that is not one of them.
    """

    def __init__(self, own: Mapping[str, Entities], find: Callable[[Roles, str], Entities]):
        super().__init__(own)
        self._find, self._cached = find, dict[str, Entities]()

    def __missing__(self, text: str) -> Entities:
        if text not in self:
            raise KeyError(text)
        if text not in self._cached:
            self._cached[text] = self._find(self, text)
        return self._cached[text]

    def __contains__(self, text: object) -> bool:
        if super().__contains__(text):
            return True
        if not isinstance(text, str) or is_plain(text):
            return False
        return all(super(Roles, self).__contains__(face) for piece in pieces_in(text) for face in piece.faces)

    def get[Other](self, text: str, default: Other = None) -> Entities | Other:  # type: ignore[assignment, override]
        return self[text] if text in self else default  # noqa: SIM401


def selected(mesh: meshes.Mesh, actuator: Actuator, roles: Mapping[str, Entities], text: str) -> Entities:
    """Return the local entities of a text's pieces; all ranks call it. `ComponentError` if they select nothing, or faces and
    edges at once."""
    groups, dimensions = [], set()
    for piece in pieces_in(text):
        dimension, entities = _common(mesh, roles, piece)
        entities = entities[piece.holds(_middles(mesh, actuator, dimension, entities))]
        if not mpi.any_rank(mesh.comm, bool(len(entities))):
            raise ComponentError(f"{units.brief(piece.text)} selects nothing; {_spans(mesh, actuator, roles, piece)}")
        groups.append(entities)
        dimensions.add(dimension)
    if len(dimensions) > 1:
        raise ComponentError(f"{units.brief(text)} has faces and edges; name one kind at a time")
    return dimensions.pop(), np.unique(np.concatenate(groups))


def cells_within(mesh: meshes.Mesh, actuator: Actuator, condition: str) -> npt.NDArray[np.int32]:
    """Return the local cells whose middles meet a condition such as ``"5 mm < r < 9 mm"``, ghosts too; all ranks call it.
    `ComponentError` if they are none."""
    index_map = mesh.topology.index_map(mesh.topology.dim)
    cells = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    cells = cells[condition_of(condition).holds(_middles(mesh, actuator, mesh.topology.dim, cells))]
    if not mpi.any_rank(mesh.comm, bool(len(cells))):
        raise ComponentError(f"{units.brief(condition)} selects no cells; coordinates are those of the undeformed device")
    return cells


def condition_of(text: str) -> Piece:
    """Return a condition without a face, such as ``"5 mm < r < 9 mm"``; `ComponentError` if it is none."""
    return _piece(f"cells{WITHIN}{text}")


def _middles(mesh: meshes.Mesh, actuator: Actuator, dimension: int, entities: npt.NDArray[np.int32]) -> Array:
    """Return the middles of entities in device coordinates, m, shape (n, 3)."""
    mesh.topology.create_connectivity(dimension, mesh.topology.dim)
    middles = meshes.compute_midpoints(mesh, dimension, entities) if len(entities) else np.empty((0, 3))
    return actuator.device_points(middles * actuator.size)


def _common(mesh: meshes.Mesh, roles: Mapping[str, Entities], piece: Piece) -> Entities:
    """Return the facets of a face, or the edges that are of two faces; of an edge between ranks, one of them may know each."""
    if len(piece.faces) == 1:
        return roles[piece.faces[0]]
    topology, dimension = mesh.topology, mesh.topology.dim - 2
    topology.create_entities(dimension)
    topology.create_connectivity(dimension + 1, dimension)
    links = topology.connectivity(dimension + 1, dimension)
    of_both: npt.NDArray[np.bool_] | bool = True
    for face in piece.faces:
        if roles[face][0] != dimension + 1:
            raise ComponentError(f"{units.brief(piece.text)}: {face!r} is not a face, so it has no edges")
        marked = la.vector(topology.index_map(dimension), 1)
        for facet in roles[face][1]:
            marked.array[links.links(facet)] = 1.0
        marked.scatter_reverse(la.InsertMode.add)
        marked.scatter_forward()
        of_both = of_both & (marked.array > 0.0)
    first, second = (roles[face][1] for face in piece.faces)
    if mpi.any_rank(mesh.comm, bool(np.isin(first, second).any())):
        raise ComponentError(
            f"{units.brief(piece.text)}: the two faces overlap, so they do not meet in an edge; name two others"
        )
    return dimension, np.flatnonzero(of_both).astype(np.int32)


def _spans(mesh: meshes.Mesh, actuator: Actuator, roles: Mapping[str, Entities], piece: Piece) -> str:
    """Return where the entities lie from which a piece was to be selected, as a clause."""
    dimension, entities = _common(mesh, roles, piece)
    if not mpi.any_rank(mesh.comm, bool(len(entities))):
        return f"the faces {' and '.join(piece.faces)} share no edge in the modelled part"
    places = _middles(mesh, actuator, dimension, entities) * 1e3
    low, high = (
        [mpi.largest(mesh.comm, float((s * places[:, k]).max(initial=-np.inf))) for k in range(3)] for s in (-1.0, 1.0)
    )
    spans = ", ".join(f"{axis} {0.0 - a:.4g} to {b:.4g} mm" for axis, a, b in zip("xyz", low, high, strict=True))
    return f"the middles of the {'facets' if len(piece.faces) == 1 else 'edges'} of {' and '.join(piece.faces)} lie in {spans}"


# ----------------------------------------------------------------------------------------------------------------------
# Convert vectors between mesh and device coordinates: an axisymmetric section has only radius and height.


def in_section(direction: npt.ArrayLike, dimension: int) -> Array:
    """Return a direction of device coordinates in those of the mesh."""
    d = np.asarray(direction, dtype=float)
    return d if dimension == 3 else d[[0, 2]]


def in_space(vectors: Array) -> Array:
    """Return the vectors of the mesh, shape (..., d), in device coordinates, shape (..., 3)."""
    if vectors.shape[-1] == 3:
        return vectors
    return np.stack([vectors[..., 0], np.zeros(vectors.shape[:-1]), vectors[..., 1]], axis=-1)


QUADRATURE_DEGREE = 2
"""Quadrature degree: exact for products of linear gradients, as second-order elements need for their full rate."""

SURFACE_DEGREE = 4
LENGTH_TOLERANCE = 1e-9
"""Lengths below this fraction of the device's size count as zero."""
CAVITY_TAG, SHEET_TAG = 1, 2
"""Tags of the cavity's and a sheet's facets in the forms, the same for every mesh to avoid recompiling."""


# ----------------------------------------------------------------------------------------------------------------------
# The measure over some of a mesh's cells, such as a region's.


CELLS = SHEET_TAG
"""Tag of the cells in the forms, the same for all regions so that they share compiled forms."""


def cell_measure(body: Body, cells: npt.NDArray[np.int32]) -> ufl.Measure:
    """Return the undeformed volume of local cells in any order, ghosts too; of a section their area."""
    mesh = body.mesh
    tags = meshes.meshtags(mesh, mesh.topology.dim, np.sort(cells), np.full(len(cells), CELLS, dtype=np.int32))
    return ufl.Measure("dx", mesh, subdomain_data=tags, metadata={"quadrature_degree": QUADRATURE_DEGREE})(CELLS)
