"""Where a cavity's walls end, and what closes it there.

The air's volume is an integral over the walls alone. That is right where they are closed, or end on cut planes, on the axis of
a section, or in a plane through the origin along whose normal a support holds them: there the integral has nothing to add.
Walls that end anywhere else have a face missing. Every edge of a closed surface belongs to two of its facets: that is exact.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from geometries.errors import GeometryError
from geometries.joined import joined_by

if TYPE_CHECKING:
    from geometries.actuator import Actuator, Hold, Vector

NEAR = 1e-6
"""What counts as the same place, in sizes of the device, and as the same direction."""
NAMED = 6
"""Most names that a message lists."""

Ints = NDArray[np.int64]


@dataclasses.dataclass(frozen=True)
class Opening:
    """A line (a point in a section) on which a cavity's walls end.

    Attributes:
        cavity: Role of the walls.
        place: The middle of the line in m, device coordinates.
        normal: Unit normal of the plane through the origin that the line lies in; None if there is none.
        roles: Physical groups that the line's nodes belong to, beside the walls': one set for all nodes alike.
        faces: Those among them that are faces or lines, without cut planes.
    """

    cavity: str
    place: Vector
    normal: Vector | None
    roles: frozenset[frozenset[str]]
    faces: tuple[str, ...]

    def closed_by(self, holds: Iterable[Hold]) -> bool:
        """Whether its line stays in its plane, so that a plane closes it."""
        if self.normal is None:
            return False
        square = {
            hold.role
            for hold in holds
            if hold.direction is None or abs(np.dot(hold.direction, self.normal)) > 1.0 - NEAR
        }
        return all(roles & square for roles in self.roles)


def cavity_roles(actuator: Actuator) -> list[str]:
    """Roles of the walls of a device's cavities."""
    return ["cavity", *(f"cavity{i + 1}" for i in range(1, len(actuator.ratios)))][: len(actuator.ratios)]


def check_closed(actuator: Actuator, openings: Iterable[Opening], holds: Iterable[Hold]) -> None:
    """Refuse cavities that nothing closes.

    Args:
        actuator: The device.
        openings: Those of its mesh, as `find_openings` has found them.
        holds: What is held of it, beside its cut planes.

    Raises:
        GeometryError: The first opening that no plane closes, with its place and the names of the faces there.
    """
    for opening in openings:
        if opening.closed_by(holds):
            continue
        shown = ", ".join(opening.faces[:NAMED]) or "without a name"
        place = ", ".join(f"{1e3 * x:.4g}" for x in opening.place)
        walls = f"the walls {opening.cavity!r} of {type(actuator).__name__}"
        where = f"{walls} end near {place} mm, where other faces are ({shown})"
        if opening.normal is None:
            raise GeometryError(
                f"{where}, so that the cavity is open there and has no volume; name every face around the air "
                f"{opening.cavity!r}. It may be open on cut planes, and in a plane through the origin whose normal is held"
            )
        along = ", ".join(f"{x:g}" for x in opening.normal)
        raise GeometryError(
            f"{where}; the cavity is open in a plane through the origin, and its volume is known only while nothing moves out "
            f"of that plane there: hold one of these faces along {along}, or name the face that closes it {opening.cavity!r}"
        )


def find_openings(actuator: Actuator) -> tuple[Opening, ...]:
    """Where the cavities of the mesh in the current Gmsh model end, but on cut planes and on the axis of a section."""
    import gmsh  # type: ignore[import-untyped]

    d = actuator.dimension
    groups = [(*group, gmsh.model.getPhysicalName(*group)) for group in gmsh.model.getPhysicalGroups()]
    walls = {name: (dimension, tag) for dimension, tag, name in groups if dimension == d - 1}
    members: dict[str, Ints] = {}

    def nodes(name: str) -> Ints:
        if name not in members:  # a region and a face may bear one name
            found = [gmsh.model.mesh.getNodesForPhysicalGroup(*group)[0] for *group, known in groups if known == name]
            members[name] = np.unique(np.concatenate(found).astype(np.int64))
        return members[name]

    symmetric = [*(plane.name for plane in actuator.cut_planes), *(["axis"] if d == 2 else [])]
    faces = {name for dimension, _, name in groups if dimension < d and name not in symmetric}
    found = []
    for cavity in cavity_roles(actuator):
        if cavity not in walls:
            continue  # which is reported where the mesh is read
        rim = _rim(walls[cavity], d)
        for name in symmetric:
            if name in walls:
                rim = rim[~np.isin(rim, nodes(name)).all(axis=1)]
        others = dict.fromkeys(name for _, _, name in groups if name != cavity) if len(rim) else {}
        for edges in _pieces(rim):
            line = np.unique(edges)
            places = actuator.device_points(np.array([gmsh.model.mesh.getNode(int(tag))[0] for tag in line]))
            kinds = frozenset(
                frozenset(name for name, there in zip(others, row, strict=True) if there)
                for row in np.array([np.isin(line, nodes(name)) for name in others]).T
            )
            x, y, z = (float(value) for value in places.mean(axis=0))
            beside = tuple(sorted(faces & frozenset().union(*kinds)))
            found.append(Opening(cavity, (x, y, z), _plane(actuator, places), kinds, beside))
    return tuple(found)


def _rim(group: tuple[int, int], space: int) -> Ints:
    """Edges that an odd number of a group's triangles have (or ends, of its lines in a section), shape (n, space - 1)."""
    import gmsh

    sides = []
    for entity in gmsh.model.getEntitiesForPhysicalGroup(*group):
        for kind, _, nodes in zip(*gmsh.model.mesh.getElements(group[0], entity), strict=True):
            width = gmsh.model.mesh.getElementProperties(kind)[3]
            corners = nodes.astype(np.int64).reshape(-1, width)[:, :space]
            sides.append(np.concatenate([np.delete(corners, k, axis=1) for k in range(space)]))
    if not sides:
        return np.empty((0, space - 1), dtype=np.int64)
    found, count = np.unique(np.sort(np.concatenate(sides), axis=1), axis=0, return_counts=True)
    return np.asarray(found[count % 2 == 1])


def _pieces(edges: Ints) -> list[Ints]:
    """Edges that hang together by their nodes."""
    group = joined_by(edges)
    return [edges[group == k] for k in range(group.max(initial=-1) + 1)]


def _plane(actuator: Actuator, places: NDArray[np.float64]) -> Vector | None:
    """Unit normal of the plane through the origin that holds the places and their images by symmetry; None if there is none."""
    mirrors = [plane.normal for plane in actuator.cut_planes]
    if actuator.dimension == 2:
        mirrors += [(1.0, 0.0, 0.0), (np.sqrt(0.5), np.sqrt(0.5), 0.0)]  # a section's point is turned into a circle
    images = [places - 2.0 * np.outer(places @ normal, normal) for normal in mirrors]
    points = np.concatenate([places, *images])
    normal = np.linalg.svd(points)[2][2]
    if np.abs(points @ normal).max() > NEAR * actuator.size:
        return None
    x, y, z = (float(value) for value in np.round(normal, 9) + 0.0)
    return x, y, z
