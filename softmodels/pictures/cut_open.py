"""A flat cut through the undeformed device that shows the most of its channels, and what is left behind it.

The cut is made in the material: it moves along with the deformation, and is a curved surface then.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from softmodels.pictures.colour_scale import Scale
from softmodels.pictures.offscreen import Layer, Style, surface
from softmodels.pictures.style import INK
from softmodels.results.skin import CUT, OUTSIDE, SHARP, Skin
from softmodels.results.stored import States
from softmodels.results.triangles import Array, Cells

if TYPE_CHECKING:
    from pyvista import PolyData

SUBTETS = np.array(
    [(0, 4, 6, 7), (4, 1, 5, 8), (6, 5, 2, 9), (7, 8, 9, 3), (4, 5, 6, 8), (4, 6, 7, 8), (5, 9, 6, 8), (6, 9, 7, 8)]
)
"""A second-order tetrahedron as eight flat ones, in VTK's order of nodes."""
TETRA = 10
ASIDE = 1e-4
"""How far a cut moves off vertices, over the device's size: not to be seen, and more than their rounding."""
Plane = tuple[Array, Array]
"""A unit normal and a point in m."""


def best_plane(skin: Skin, points: Array, up: Array, axial: bool) -> Plane:
    """The plane across a coordinate axis that meets the most cavities, and of such ones the most air.

    Args:
        skin: The surface.
        points: Undeformed nodes in m, shape (n, 3).
        up: The device's lift.
        axial: Only planes along ``up``.
    """
    vertices = skin.device(skin.points(points))
    count = max(skin.cavities, 1)
    cavities = [vertices[skin.device_triangles(skin.part == k)] for k in range(1, count + 1)]
    corners = np.concatenate(cavities) if skin.cavities else vertices[skin.device_triangles(skin.part == OUTSIDE)]
    places = [_centre(corners), *(_centre(walls) for walls in cavities if len(walls))]
    best, most = (np.eye(3)[1], places[0]), (-1, -1.0)
    for normal in np.eye(3):
        if axial and abs(normal @ up) > 0.5:
            continue
        for place in places:
            areas = [_section_area(walls, normal, place) for walls in cavities]
            met = (sum(area > 0 for area in areas), sum(areas))
            if met[0] > most[0] or (met[0] == most[0] and met[1] > 1.01 * most[1]):
                best, most = (normal, place), met
    return best


def _centre(corners: Array) -> Array:
    """Middle of a surface; corners of its triangles, shape (t, 3, 3)."""
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return np.asarray(np.average(corners.mean(axis=1), axis=0, weights=area))


def _section_area(corners: Array, normal: Array, place: Array) -> float:
    """Area that a plane cuts out of a closed surface; corners of its triangles, shape (t, 3, 3)."""
    height = (corners - place) @ normal + 1e-12
    above = height > 0
    met = corners[above.any(axis=1) & ~above.all(axis=1)]
    if not len(met):
        return 0.0
    height = (met - place) @ normal + 1e-12
    begin, end = np.zeros((len(met), 3)), np.zeros((len(met), 3))
    for k in range(3):
        a, b = height[:, k, None], height[:, (k + 1) % 3, None]
        crossed = (a > 0) != (b > 0)
        at = met[:, k] + np.where(crossed, a / np.where(crossed, a - b, 1.0), 0.0) * (met[:, (k + 1) % 3] - met[:, k])
        begin, end = np.where(crossed & (a > 0), at, begin), np.where(crossed & (a <= 0), at, end)
    return float(abs((np.cross(begin - place, end - place) @ normal).sum()) / 2)


def cut_open(states: States, step: int, plane: Plane, viewer: Array, scale: Scale) -> list[Layer]:
    """Layers of a state whose material before a plane of the undeformed device is taken away.

    Args:
        states: The states.
        step: Which one.
        plane: Of the undeformed device.
        viewer: Direction towards the viewer, to whom the cut is turned.
        scale: The colours.
    """
    normal, place = plane
    normal = normal if normal @ viewer > 0 else -normal
    skin = states.skin
    place = _aside(skin.device(skin.points(states.points)), normal, place)
    u, values = states.field(step, "displacement"), scale.share(states.field(step, scale.field))
    shell = surface(skin.device(skin.points(states.points)), skin.device_triangles(skin.part != CUT))
    shell.point_data["displacement"] = skin.device(skin.points(u))
    shell.point_data["values"] = np.tile(values[skin.nodes], len(skin.images))
    # Images of the slice meet in their symmetry plane: one surface, so that no seam is shaded there.
    behind = shell.clean(tolerance=1e-7).clip(normal=normal, origin=place)
    style: Style = {"scalars": "values", "cmap": scale.colours, "clim": (0.0, 1.0), "smooth_shading": True}
    found: list[Layer] = [(_warped(behind), {**style, "split_sharp_edges": True, "feature_angle": SHARP})]
    pieces = []
    for image in skin.images:
        piece = _section(states.points, states.cells, u, values, image.T @ normal, image.T @ place)
        if piece.n_cells:
            piece.point_data["displacement"] = piece.point_data["displacement"] @ image.T
            piece.points = piece.points @ image.T
            pieces.append(piece)
    if pieces:
        together = pieces[0].append_polydata(*pieces[1:]) if len(pieces) > 1 else pieces[0]
        face = _warped(together.clean(tolerance=1e-7, polys_to_lines=False, lines_to_points=False))
        found.append((face, {**style, "split_sharp_edges": False}))
        rim = face.extract_feature_edges(feature_edges=False, manifold_edges=False, non_manifold_edges=False)
        if rim.n_cells:
            found.append((rim, {"color": INK, "line_width": 1.5}))
    return found


def _aside(vertices: Array, normal: Array, place: Array) -> Array:
    """A point a little deeper than a plane on which vertices lie, such as a symmetry plane of the device.

    There the plane would meet the faces of cells, some once and some twice, and the section would have cracks.
    """
    size = np.ptp(vertices, axis=0).max()
    on_plane = np.abs((vertices - place) @ normal) < 1e-6 * size
    return place - ASIDE * size * normal if on_plane.any() else place


def _warped(data: PolyData) -> PolyData:
    data = data.copy()
    data.points = data.points + data.point_data["displacement"]
    return data


def _section(points: Array, cells: Cells, u: Array, values: Array, normal: Array, place: Array) -> PolyData:
    """Where a plane meets the solid."""
    import pyvista

    height = (points - place) @ normal
    near = cells[(height[cells].min(axis=1) <= 0) & (height[cells].max(axis=1) >= 0)]
    small = near[:, SUBTETS].reshape(-1, 4)
    grid = pyvista.UnstructuredGrid({TETRA: small}, points)
    grid.point_data["displacement"], grid.point_data["values"] = u, values
    return grid.slice(normal=normal, origin=place).extract_surface(algorithm="dataset_surface").clean()
