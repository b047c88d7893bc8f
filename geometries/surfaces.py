"""Surfaces as files have them, made closed ones: common corners, doubled and inverted facets, seams, bodies that overlap, air
in a file of its own. What is done is said."""

from __future__ import annotations

import math

import numpy as np

from geometries import actuator, mesh_arrays
from softmodels.common.arrays import Array
from softmodels.common.errors import GeometryError
from softmodels.common.lazy import pyvista, scipy

Surface = tuple[Array, mesh_arrays.Ints]
"""Corners (n, 3) in m and triangles (t, 3) of a closed surface, turned away from the solid."""

CORNER_TOLERANCE = 1e-6
"""Corners of an STL file's triangles this near to each other, over its extent, are one."""
SEAM_TOLERANCES = (1e-5, 1e-4, 1e-3)
"""Widths of open seams that are closed, over the extent, in the order tried."""
MAX_HOLE_SHARE = 0.01
"""Radius over the extent up to which a hole of missing facets is filled."""
ZERO_VOLUME_TOLERANCE = 1e-9
"""Six times the volume of a surface, in cubes of its extent, that is no more than rounding."""
SAME_VOLUME_TOLERANCE = 1e-6
"""Share of a body's volume that is no more than rounding."""
SAME_ANGLE = 1e-6
"""Angle between faces that lie on each other."""
SIMPLIFIED_VOLUME_TOLERANCE = 5e-4
"""Share of the solid's and of the air's volume that leaving out corners may change."""
MIN_AIR_SHARE = 0.01
"""Share of the air's volume within the body's solid below which the body was drawn hollow, and outside of it below which the
body was drawn full."""


def repaired(file: str, places: Array, triangles: mesh_arrays.Ints) -> tuple[Surface, list[str]]:
    """Return the closed surface of a file's triangles, places in m (n, 3) and three of them each (t, 3), and what was done to
    it, in words. GeometryError for a surface that stays open or encloses nothing."""
    remarks = []
    extent = float(np.linalg.norm(np.ptp(places, axis=0)))
    points, triangles = _merged(places, triangles, np.arange(len(places)), CORNER_TOLERANCE * extent)
    first = np.sort(np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)[1])
    once = triangles[first]
    readings = [(points, once)]
    if len(_open_edges(once)):  # facets that lie on each other may be those of bodies that touch
        readings += [_parted(points, once), _parted(points, triangles)]
    doubled = len(triangles)
    points, triangles = min(readings, key=lambda surface: len(_open_edges(surface[1])))
    if doubled := doubled - len(triangles):
        remarks.append(f"{doubled} doubled facets of {file} are left out")
    for gap in SEAM_TOLERANCES:
        if not (gaps := _open_edges(triangles)).size:
            break
        welded = _merged(points, triangles, np.unique(gaps), gap * extent)
        if len(_open_edges(welded[1])) < len(gaps):
            points, triangles = welded
            remarks.append(f"{len(gaps)} open edges of {file} along seams narrower than {1e3 * gap * extent:.2g} mm are joined")
    if (gaps := _open_edges(triangles)).size:
        surface = pyvista.PolyData.from_regular_faces(points / extent, triangles).fill_holes(MAX_HOLE_SHARE)
        if added := surface.n_cells - len(triangles):
            points, triangles = extent * np.asarray(surface.points), np.asarray(surface.regular_faces, dtype=np.int64)
            remarks.append(f"holes of {file} are filled by {added} facets")
    if (gaps := _open_edges(triangles)).size:
        x, y, z = 1e3 * points[gaps[0]].mean(axis=0)
        raise GeometryError(
            f"file {file} is not watertight: {len(gaps)} edges do not belong to exactly two triangles, the first near "
            f"{x:.4g}, {y:.4g}, {z:.4g} mm; repair it in the program that wrote it"
        )
    return _turned(file, points, triangles, remarks), remarks


def _turned(file: str, points: Array, triangles: mesh_arrays.Ints, remarks: list[str]) -> Surface:
    """Return a closed surface with each triangle turned away from the solid, and the solid of all shells joined; see
    `repaired`."""
    size = float(np.ptp(points, axis=0).max())
    outwards = turned_outwards(points, triangles)
    same = (outwards == triangles).all(axis=1)
    same |= (outwards == triangles[:, [1, 2, 0]]).all(axis=1) | (outwards == triangles[:, [2, 0, 1]]).all(axis=1)
    shell = mesh_arrays.shells(triangles, len(points))
    _, shell = np.unique(shell, return_inverse=True)
    turned_around = np.bincount(shell, ~same)
    if inverted := int(np.minimum(turned_around, np.bincount(shell) - turned_around).sum()):
        remarks.append(f"{inverted} inverted facets of {file} are turned")
    volumes = _volumes(points, outwards, shell)
    if not volumes.max() > ZERO_VOLUME_TOLERANCE * size**3:
        raise GeometryError(f"file {file} encloses no volume; repair it in the program that wrote it")
    outwards[volumes[shell] < 0.0] = outwards[volumes[shell] < 0.0][:, ::-1]
    spans = np.array([np.linalg.norm(np.ptp(points[outwards[shell == i]].reshape(-1, 3), axis=0)) for i in range(len(volumes))])
    outside = int(spans.argmax())
    if len(volumes) > 1 and (bodies := _bodies(points / size, outwards, shell, outside)):
        joined, count, left = bodies
        if left < count:
            remarks.append(f"{count} bodies of {file} become {left}, because those that touch or overlap are joined")
        return size * joined[0], joined[1]
    outwards[shell != outside] = outwards[shell != outside][:, ::-1]
    return points, outwards


def turned_outwards(points: Array, triangles: mesh_arrays.Ints) -> mesh_arrays.Ints:
    """Return the triangles of closed shells, each turned away from what its own shell encloses."""
    shells = pyvista.PolyData.from_regular_faces(points / np.ptp(points, axis=0).max(), triangles)
    turned = shells.compute_normals(
        point_normals=False, auto_orient_normals=True, consistent_normals=True, split_vertices=False
    )
    return np.asarray(turned.regular_faces, dtype=np.int64)


def _bodies(
    points: Array, outwards: mesh_arrays.Ints, shell: mesh_arrays.Ints, outside: int
) -> tuple[Surface, int, int] | None:
    """Return the joined surface of shells that are not all cavities of the outside one, how many bodies they are, and how many
    where those that touch or overlap are one; None if all are cavities."""
    shells = [mesh_arrays.manifold(points, outwards[shell == i]) for i in range(shell.max() + 1)]
    solid, others = shells[outside], [part for i, part in enumerate(shells) if i != outside]
    if any(part.is_empty() for part in shells):
        return None
    beside: list[mesh_arrays.Manifold] = []
    inside: list[mesh_arrays.Manifold] = []
    for part in others:
        within = (solid ^ part).volume()
        (inside if within > (1.0 - SAME_VOLUME_TOLERANCE) * part.volume() else beside).append(part)
    if not beside:
        return None
    for part in beside:
        solid += part
    left = sum(part.volume() > 0.0 for part in solid.decompose())
    for part in inside:
        solid -= part
    return mesh_arrays.surface_of(solid), len(beside) + 1, left


def without_air(file: str, body: Surface, air_file: str, air: Surface) -> tuple[Surface, list[str]]:
    """Return a body without its air, which is that within a second surface, unchanged if it was drawn hollow; and, of a body
    that was drawn hollow in part only, what is cut out of it, in words. GeometryError for air outside the body."""
    size = float(np.ptp(body[0], axis=0).max())
    solid, space = (mesh_arrays.manifold(points / size, triangles) for points, triangles in (body, air))
    if solid.is_empty() or space.is_empty():
        wrong = file if solid.is_empty() else air_file
        raise GeometryError(f"the surface of {wrong} crosses itself; repair it where it was made")
    common = (solid ^ space).volume() / space.volume()
    filled = (solid.hull() ^ space).volume() / space.volume()
    if filled < 1.0 - MIN_AIR_SHARE:
        raise GeometryError(
            f"the air of {air_file} does not lie in the part of {file} ({filled:.0%} of it does); give both the same unit "
            "and place"
        )
    if common < MIN_AIR_SHARE:
        return body, []
    remarks = []
    if common < 1.0 - MIN_AIR_SHARE:
        points, triangles = mesh_arrays.surface_of(solid ^ space)
        shares = np.linalg.det(points[triangles]) / 6.0  # of the volume, which flat skins have not
        x, y, z = 1e3 * size * shares @ points[triangles].mean(axis=1) * 0.75 / shares.sum()
        remarks.append(
            f"{common:.0%} of the air of {air_file}, {1e6 * size**3 * common * space.volume():.3g} ml around {x:.4g}, {y:.4g}, "
            f"{z:.4g} mm, lies in the walls of {file}, which is hollow elsewhere, and is cut out of them; if they are right, "
            "leave --air out"
        )
    points, triangles = mesh_arrays.surface_of(solid - space)
    return (size * points, triangles), remarks


def air_points(air: Surface) -> list[Array]:
    """Return a point (m) in each body that a closed surface bounds: halfway through it from the middle of its largest face."""
    points, triangles = air
    shell = mesh_arrays.shells(triangles, len(points))
    places = []
    for number in np.unique(shell):
        own = triangles[shell == number]
        a, b, c = np.moveaxis(points[own], 1, 0)
        normal = np.cross(b - a, c - a)
        if np.einsum("ij,ij->", a - a[0], normal) < 0.0:
            continue  # an island in the air
        largest = int((normal**2).sum(axis=1).argmax())
        start, extent = (a + b + c)[largest] / 3.0, float(np.linalg.norm(np.ptp(a, axis=0)))
        way = -extent * normal[largest] / np.linalg.norm(normal[largest])
        hits, _ = pyvista.PolyData.from_regular_faces(points / extent, own).ray_trace(
            (start + 1e-6 * way) / extent, (start + 2.0 * way) / extent
        )
        places.append(0.5 * (start + extent * min(hits, key=lambda hit: float(hit @ way))))
    return places


def simplified(surface: Surface, tolerance: float) -> Surface:
    """Return a closed surface with fewer triangles, by quadrics (Garland and Heckbert, doi:10.1145/258734.258849): 0.7 times as
    many as long as no corner is farther from it than a distance (m), and the solid and its air keep their volumes. A surface
    that crosses itself stays as it is."""
    size = float(np.ptp(surface[0], axis=0).max())

    def volumes(points: Array, triangles: mesh_arrays.Ints) -> Array:
        return np.array([mesh_arrays.manifold(points, triangles).volume(), mesh_arrays.enclosed_air(points, triangles).sum()])

    corners, fewer = surface[0] / size, surface
    whole = volumes(corners, surface[1])
    left = pyvista.PolyData.from_regular_faces(corners, surface[1])
    while whole[0] > 0.0:
        left = left.decimate(0.3)
        points, triangles = np.asarray(left.points, dtype=float), np.asarray(left.regular_faces, dtype=np.int64)
        away = pyvista.PolyData(corners).compute_implicit_distance(left)["implicit_distance"]
        if len(triangles) == len(fewer[1]) or not (
            np.abs(away).max() <= tolerance / size
            and (np.abs(volumes(points, triangles) - whole) <= SIMPLIFIED_VOLUME_TOLERANCE * whole).all()
        ):
            break
        fewer = size * points, triangles
    return fewer


def split(surface: Surface, length: float) -> Surface:
    """Return a closed surface whose triangles are split where their edges are longer than a length (m). A surface that crosses
    itself stays as it is."""
    points, triangles = surface
    size = float(np.ptp(points, axis=0).max())
    solid = mesh_arrays.manifold(points / size, triangles)
    if solid.is_empty():
        return surface
    places, corners = mesh_arrays.surface_of(solid.refine_to_length(length / size))
    return size * places, corners


def _volumes(points: Array, triangles: mesh_arrays.Ints, shell: mesh_arrays.Ints) -> Array:
    """Return the volume within each shell, in m3 of the points' unit."""
    a, b, c = np.moveaxis(points[triangles] - points[triangles[0, 0]], 1, 0)
    return np.bincount(shell, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0)


def _open_edges(triangles: mesh_arrays.Ints) -> mesh_arrays.Ints:
    """Return the edges, shape (k, 2), that do not belong to exactly two triangles."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    known, count = np.unique(edges, axis=0, return_counts=True)
    return known[count != 2]


def _parted(points: Array, triangles: mesh_arrays.Ints) -> Surface:
    """Return a surface with corners of its own for each sheet, where it touches itself or others at corners and edges."""
    corners, after = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
    side = np.arange(len(corners))
    following = side // 3 * 3 + (side + 1) % 3
    _, number, count = np.unique(np.sort([corners, after], axis=0).T, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(number, kind="stable")
    pairs = [order[count[number[order]] == 2].reshape(-1, 2)]
    for sides in np.split(order, np.cumsum(count)[:-1]) if (count > 2).any() else []:
        if len(sides) > 2:
            pairs.append(_around_an_edge(points, corners[sides], after[sides], corners[following[following[sides]]], sides))
    met = np.concatenate(pairs)
    # Two triangles with a common side have the corners at both of its ends in common.
    same = corners[met[:, 0]] == corners[met[:, 1]]
    first, second = np.where(same, met[:, 1], following[met[:, 1]]), np.where(same, following[met[:, 1]], met[:, 1])
    group = actuator.joined(
        np.concatenate([np.stack([met[:, 0], first], 1), np.stack([following[met[:, 0]], second], 1)]), len(side)
    )
    _, place, own = np.unique(group, return_index=True, return_inverse=True)
    return points[corners[place]], own.reshape(-1, 3)


def _around_an_edge(
    points: Array, begin: mesh_arrays.Ints, end: mesh_arrays.Ints, third: mesh_arrays.Ints, sides: mesh_arrays.Ints
) -> mesh_arrays.Ints:
    """Return which of the sides of triangles at an edge meet, shape (n, 2): those of two triangles with solid between them,
    the ones next to each other around the edge. None where the triangles are not turned away from solids."""
    forwards = begin < end
    if 2 * forwards.sum() != len(sides):
        return np.zeros((0, 2), dtype=np.int64)
    low, high = points[min(begin[0], end[0])], points[max(begin[0], end[0])]
    along = (high - low) / np.linalg.norm(high - low)
    arm = points[third] - low
    arm -= np.outer(arm @ along, along)
    start = int(np.flatnonzero(~forwards)[0])
    angle = np.arctan2(np.cross(arm[start], arm) @ along, arm @ arm[start]) % math.tau
    angle = np.where(angle > math.tau - SAME_ANGLE, 0.0, angle)
    angle[forwards & (angle < SAME_ANGLE)] = math.tau
    order = np.lexsort([~forwards, np.round(angle / SAME_ANGLE)])
    order = np.roll(order, -int(np.flatnonzero(order == start)[0]))
    met = order.reshape(-1, 2)
    return sides[met] if not forwards[met[:, 0]].any() and forwards[met[:, 1]].all() else np.zeros((0, 2), dtype=np.int64)


def _merged(points: Array, triangles: mesh_arrays.Ints, among: mesh_arrays.Ints, near: float) -> Surface:
    """Return triangles whose corners ``among`` some are one where they are near each other (m), without flat ones: an STL file
    lists each corner with each triangle anew."""
    pairs = among[scipy.spatial.cKDTree(points[among]).query_pairs(near, output_type="ndarray")]
    group = actuator.joined(pairs, len(points))
    _, first = np.unique(group, return_index=True)
    triangles = group[triangles]
    ends = np.sort(triangles, axis=1)
    return points[first], triangles[(ends[:, 0] != ends[:, 1]) & (ends[:, 1] != ends[:, 2])]
