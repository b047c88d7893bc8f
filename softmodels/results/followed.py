"""The places of the surface that named points are followed at, and the faces whose rotation is, on any number of ranks."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from geometries.actuator import Vector
from geometries.symmetry import reflected
from softmodels.case.gauges import GaugeError, Gauges
from softmodels.mechanics.mpi import largest, summed, total
from softmodels.mechanics.system import System
from softmodels.results.grid import Grid

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]

SAME = 1e-9
"""Lengths below this share of the device's size are none."""


@dataclasses.dataclass(frozen=True, eq=False)
class Followed:
    """A place of the surface, in a facet.

    Attributes:
        nodes: Local nodes of the facet, ghosts too, shape (k,); empty on ranks that do not have it.
        weights: What their values count there, shape (k,), so that the sum over all ranks is the value.
        place: Undeformed, in device coordinates, m.
        away: Distance in m from the point that was named.
    """

    nodes: Nodes
    weights: Array
    place: Vector
    away: float


def followed_points(system: System, grid: Grid, gauges: Gauges) -> dict[str, Followed]:
    """The places of the surface, the cavities' walls too, that are nearest to the named points.

    Raises:
        GaugeError: One is farther from the surface than a cell is large.
    """
    if not gauges.points:
        return {}
    facets = _surface(system, grid)
    here = grid.space.tabulate_dof_coordinates()[facets.ravel()] * system.length_unit
    places = system.body.actuator.device_points(here) if len(here) else np.empty((0, 3))
    corners = places.reshape(*facets.shape, 3)
    return {name: _nearest(system, name, np.asarray(wanted), facets, corners) for name, wanted in gauges.places.items()}


class TurningFace:
    """A face whose mean rotation is followed: the rotation that fits its motion best, facets weighed by their area.

    Args:
        system: The device.
        nodes: Local nodes of the corners of the face's facets on this rank, shape (m, 3).
        places: Their undeformed places in device coordinates, m, shape (m, 3, 3).
        middle: Middle of the device's whole surface, from which the face's normal points away.
    """

    def __init__(self, system: System, nodes: Nodes, places: Array, middle: Array):
        self.nodes, self._comm = nodes, system.comm
        self._images = [
            np.asarray(image) for image in reflected([plane.normal for plane in system.body.actuator.cut_planes])
        ]
        sides = places[:, 1:] - places[:, :1]
        areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
        self._areas, self._places = np.repeat(areas, 3), places.reshape(-1, 3)
        self._area, self._centre, second = self._moments(self._places)
        self.normal: Array = np.linalg.eigh(second)[1][:, 0]
        if self.normal @ (self._centre - middle) < 0.0:
            self.normal = -self.normal

    def _moments(self, now: Array) -> tuple[float, Array, Array]:
        """Area of the face and its images, its centre at places ``now``, and the moments of these with the undeformed ones."""
        weighed = self._areas[:, None] * self._places
        sums = summed(
            self._comm,
            np.concatenate([[self._areas.sum()], weighed.sum(axis=0), self._areas @ now, (weighed.T @ now).ravel()]),
        )
        count = len(self._images)
        area, rest, there, both = count * sums[0], sums[1:4], sums[4:7], sums[7:].reshape(3, 3)
        rest, there = (np.sum([image @ side for image in self._images], axis=0) for side in (rest, there))
        both = np.sum([image @ both @ image.T for image in self._images], axis=0)
        return float(area), there / area, both / area - np.outer(rest, there) / area**2

    def turned(self, moved: Array) -> Array:
        """The normal turned by the mean rotation, from displacements of the corners in device coordinates, shape (m, 3, 3).

        The rotation is that of Kabsch 1976 (doi 10.1107/S0567739476001873).
        """
        _, _, both = self._moments(self._places + moved.reshape(-1, 3))
        U, _, Vt = np.linalg.svd(both)
        U[:, 2] *= np.linalg.det(U)
        Vt[2] *= np.linalg.det(Vt)
        return np.asarray(Vt.T @ (U.T @ self.normal))


def turning_faces(system: System, grid: Grid, gauges: Gauges) -> dict[str, TurningFace]:
    """The faces whose mean rotation is an angle.

    Raises:
        GaugeError: The device has no such face.
    """
    if not gauges.faces:
        return {}
    facets = _surface(system, grid)[:, :3]
    here = grid.space.tabulate_dof_coordinates()[facets.ravel()] * system.length_unit
    places = system.body.actuator.device_points(here).reshape(-1, 3, 3) if len(here) else np.empty((0, 3, 3))
    sums = summed(system.comm, np.append(places.reshape(-1, 3).sum(axis=0), 3.0 * len(places)))
    near = 1e-5 * system.length_unit
    found = {}
    for name, face in gauges.turning.items():
        if face.normal is not None:
            chosen = (np.abs(places @ np.asarray(face.normal) - face.at) < near).all(axis=1)
        else:
            low, high = (np.asarray(end) for end in face.box or ((), ()))
            chosen = ((places > low - near) & (places < high + near)).all(axis=(1, 2))
        if not total(system.comm, float(chosen.sum())):
            raise GaugeError(f"angle {name}: the device has no face 'face {face.text}'")
        found[name] = TurningFace(system, facets[chosen], places[chosen], sums[:3] / sums[3])
    return found


def _surface(system: System, grid: Grid) -> Nodes:
    """Local nodes of the facets that bound the silicone but for cut planes, shape (m, 6), or (m, 3) of a section.

    The corners come first, then the middles of the edges, each opposite to its corner.
    """
    from dolfinx.mesh import compute_midpoints, exterior_facet_indices

    body = system.body
    topology = body.mesh.topology
    dim = topology.dim
    topology.create_connectivity(dim - 1, dim)
    topology.create_connectivity(dim, dim - 1)
    planes = {plane.name for plane in body.actuator.cut_planes}
    cut = [facets for role, (_, facets) in body.entities.items() if role in planes]
    outer = np.setdiff1d(exterior_facet_indices(topology), np.concatenate(cut) if cut else np.empty(0, dtype=np.int32))
    if dim == 2:  # a section's axis is no surface
        outer = outer[compute_midpoints(body.mesh, 1, outer.astype(np.int32))[:, 0] > SAME]
    cells_of, facets_of = topology.connectivity(dim - 1, dim), topology.connectivity(dim, dim - 1)
    layout = grid.space.dofmap.dof_layout
    found = np.empty((len(outer), 3 * (dim - 1)), dtype=np.int64)
    for row, facet in enumerate(outer):
        cell = cells_of.links(facet)[0]
        number = int(np.flatnonzero(facets_of.links(cell) == facet)[0])
        found[row] = grid.space.dofmap.cell_dofs(cell)[sorted(layout.entity_closure_dofs(dim - 1, number))]
    return found


def _nearest(system: System, name: str, wanted: Array, facets: Nodes, places: Array) -> Followed:
    """The nearest place of facets whose nodes are at places (m, k, 3)."""
    comm, unit = system.comm, system.length_unit
    share = _weights(_barycentric(places, wanted)) if len(places) else np.empty((0, 1))
    found = np.einsum("mk,mki->mi", share, places)
    distance = np.linalg.norm(found - wanted, axis=1)
    away = -largest(comm, -float(distance.min()) if len(distance) else -math.inf)
    # Of equally near ones the first in order of x, y, z: no rank decides.
    near = np.flatnonzero(distance <= away + SAME * unit)
    place = []
    for axis in range(3):
        least = -largest(comm, -float(found[near, axis].min()) if len(near) else -math.inf)
        near = near[found[near, axis] <= least + SAME * unit]
        place.append(least if abs(least) > SAME * unit else 0.0)
    holders = total(comm, float(bool(len(near))))  # a place on an edge between ranks is known to several
    edge = places[near, 0] - places[near, 1] if len(near) else np.zeros((0, 3))
    size = largest(comm, float(np.linalg.norm(edge, axis=1).max()) if len(near) else -math.inf)
    if away > size:
        told = ", ".join(f"{1e3 * value:.5g}" for value in place)
        raise GaugeError(
            f"point {name} lies {away * 1e3:.4g} mm off the surface, whose nearest place is {told} mm, and cells are "
            f"{size * 1e3:.3g} mm large there; name a place on the surface of the part as it is modelled"
        )
    first = near[:1]
    return Followed(facets[first].ravel(), share[first].ravel() / holders, (place[0], place[1], place[2]), away)


def _weights(barycentric: Array) -> Array:
    """Second-order shape functions at barycentric coordinates (m, c): corners, then the edges opposite to them."""
    corners = barycentric * (2 * barycentric - 1)
    if barycentric.shape[1] == 2:
        return np.column_stack([corners, 4 * barycentric.prod(axis=1)])
    a, b, c = barycentric.T
    return np.column_stack([corners, 4 * b * c, 4 * a * c, 4 * a * b])


def _barycentric(places: Array, wanted: Array) -> Array:
    """Barycentric coordinates (m, c) of the places in straight facets that are nearest to a point.

    Args:
        places: Nodes of the facets, corners first, shape (m, 6, 3) or (m, 3, 3).
        wanted: The point, shape (3,).
    """
    if places.shape[1] == 3:
        return _on_edge(places[:, 0], places[:, 1], wanted)
    a, b, c = (places[:, i] for i in range(3))
    E = np.stack([b - a, c - a], axis=2)
    inner = np.einsum("mij,mi->mj", np.linalg.pinv(E).transpose(0, 2, 1), wanted - a)
    found = np.column_stack([1 - inner.sum(axis=1), inner])
    for i, (j, k) in enumerate(((1, 2), (0, 2), (0, 1))):
        outside = found[:, i] < 0.0
        if outside.any():  # the nearest edge of all three is the nearest place
            edge = np.zeros((int(outside.sum()), 3))
            edge[:, [j, k]] = _on_edge(places[outside, j], places[outside, k], wanted)
            found[outside] = np.where(
                _closer(places[outside], edge, found[outside], wanted)[:, None], edge, found[outside]
            )
    return found


def _closer(places: Array, one: Array, two: Array, wanted: Array) -> npt.NDArray[np.bool_]:
    """Whether the first barycentric coordinates are inside and nearer than the second, or those are outside."""
    away = [np.linalg.norm(np.einsum("mi,mij->mj", at, places[:, :3]) - wanted, axis=1) for at in (one, two)]
    return (two.min(axis=1) < 0.0) | (away[0] < away[1])


def _on_edge(a: Array, b: Array, wanted: Array) -> Array:
    """Barycentric coordinates (m, 2) of the places on straight edges that are nearest to a point."""
    along = b - a
    t = np.clip(((wanted - a) * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
    return np.column_stack([1 - t, t])
