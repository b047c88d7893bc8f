"""A part meshed elsewhere: a mesh of Gmsh's or Abaqus', or the surfaces of an STL file."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import io
import math
import re
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from geometries.actuator import Recipe, Vector, check_slice, joined
from geometries.imported import (
    AXES,
    FORMATS,
    TILT,
    UNITS,
    ImportedPart,
    Reading,
    cavity_role,
    faces,
    listed,
    only_inner_shell,
    point,
    region_name,
)
from geometries.mesh_arrays import TO_GMSH, Ints, Tetrahedra
from geometries.meshing import apart, private_model
from geometries.registry import register_device
from softmodels.common.errors import GeometryError, MeshingError
from softmodels.common.files import GEOMETRY, check_file, read_file
from softmodels.common.names import lazy_module
from softmodels.common.schema import choice_field, length_field

gmsh = lazy_module("gmsh")

# ----------------------------------------------------------------------------------------------------------------------
# Read meshes of other programs into arrays, with their names of faces and regions.
#
# Gmsh's ``.msh`` and Abaqus' ``.inp`` are read by meshio, which runs nothing that a file holds. An ``.stl`` has surfaces
# only; the solid between them is meshed by Gmsh, in a separate process.


FARTHEST = 1e3
"""Distance in m of a corner of a surface from the origin, above which its file is damaged or in another unit."""
FLAT = 1e-9
"""Six times the volume of a surface, in cubes of its extent, that is no more than rounding."""
SAME = 1e-6
"""Corners of an STL file's triangles this near to each other, over its extent, are one."""
FEATURE = math.radians(40.0)
"""Angle between triangles of an STL file from which their edge is one of the part."""
OTHER_CELLS = ("hexahedron", "wedge", "pyramid", "voxel")


def read_mesh(file: str, unit: float, cell_size: float) -> Tetrahedra:
    """Read a mesh, in m.

    Args:
        file: Its path.
        unit: Metres in one of its lengths.
        cell_size: Longest edge in m of the cells that an STL file is filled with.

    Raises:
        GeometryError: No such file, not a mesh, or none of tetrahedra.
    """
    kind = Path(file).suffix.lower()
    if kind not in FORMATS:
        raise GeometryError(f"file is {file!r}; meshes are read from {', '.join(FORMATS)}, drawings from STEP")
    found = _by_meshio(file, FORMATS[kind])
    if kind == ".stl":
        return _filled(file, found, unit, cell_size)
    cells, groups = _tetrahedra(file, found)
    faces = _face_names(found)
    regions = _region_names(found, groups)
    return Tetrahedra.made(unit * np.asarray(found.points, dtype=float)[:, :3], cells, faces, regions)


def _by_meshio(file: str, format_name: str) -> Any:
    import meshio

    try:
        check_file(file)
        deck = read_file(file, GEOMETRY).decode("utf-8", errors="replace") if format_name == "abaqus" else ""
    except OSError as error:
        raise GeometryError(f"file {file} cannot be read ({error.strerror})") from None
    _check_deck(file, deck)
    try:
        with (
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(io.StringIO()),
            warnings.catch_warnings(action="ignore"),
        ):
            found = meshio.read(file, format_name)
    except OSError as error:
        raise GeometryError(f"file {file} cannot be read ({error.strerror})") from None
    except SystemExit:  # meshio's way with some files
        raise GeometryError(f"file {file} is not a mesh of the format of its extension") from None
    except Exception as error:  # meshio raises what its readers happen to meet
        words = " ".join(str(error).split())[:200] or "no reason given"
        raise GeometryError(f"file {file} is not a mesh of the format of its extension ({words})") from None
    if len(found.points) > Path(file).stat().st_size:  # a count in its header that no numbers follow
        raise GeometryError(
            f"file {file} is not a mesh of the format of its extension (it announces more nodes than it has bytes)"
        )
    if not len(found.points) or not np.isfinite(found.points).all() or np.shape(found.points)[1] != 3:
        raise GeometryError(f"file {file} has no nodes in three dimensions")
    return found


def _check_deck(file: str, text: str) -> None:
    """Reject a deck that has meshio open other files, or count to numbers that no deck has; it runs nothing else."""
    ranges = False
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("**"):
            continue
        # Meshio's own way to find a keyword, which needs no asterisk.
        keyword = line.partition(",")[0].strip().replace("*", "").upper()
        named = line.startswith("*") and re.search(r",\s*INPUT\s*=", line, re.IGNORECASE)
        if keyword == "INCLUDE" or named:
            raise GeometryError(
                f"file {file} includes another file (line {number}: {line.strip()[:80]!r}), "
                f"which is not supported; put all nodes and elements into one file"
            )
        if line.startswith("*"):
            ranges = "GENERATE" in line.upper()
        elif ranges and keyword:
            first, last, *_ = [*re.findall(r"-?\d+", line), "0", "0"]
            if len(last) > 18 or int(last) - int(first) > len(text):
                raise GeometryError(
                    f"file {file} is not a mesh of the format of its extension (line {number} has a set of "
                    f"{line.strip()[:80]!r}, more than the file has characters)"
                )


def _tetrahedra(file: str, found: Any) -> tuple[Ints, list[int]]:
    """Return all tetrahedra of one order, and the cell blocks that they come from."""
    kinds = [block.type for block in found.cells]
    if other := sorted({kind for kind in kinds if kind.startswith(OTHER_CELLS)}):
        raise GeometryError(f"file {file} has {', '.join(other)} cells; only tetrahedra of 4 or 10 nodes are supported")
    blocks = [i for i, kind in enumerate(kinds) if kind in ("tetra", "tetra4", "tetra10")]
    if not blocks:
        raise GeometryError(f"file {file} has no tetrahedra; it has {', '.join(sorted(set(kinds))) or 'no cells'}")
    if len({np.shape(found.cells[i].data)[1] for i in blocks}) > 1:
        raise GeometryError(f"file {file} mixes tetrahedra of 4 and of 10 nodes; mesh it with one kind")
    cells = np.concatenate([np.asarray(found.cells[i].data, dtype=np.int64) for i in blocks])
    if cells.min() < 0 or cells.max() >= len(found.points):
        raise GeometryError(f"file {file} has cells with undefined nodes")
    return cells, blocks


def _face_names(found: Any) -> dict[str, Ints]:
    """Return the nodes by name: of node sets, of sets of triangles, of physical surfaces."""
    names = {name: np.asarray(nodes, dtype=np.int64) for name, nodes in found.point_sets.items()}
    for name, parts in _cell_sets(found):
        chosen = [
            np.asarray(block.data)[np.asarray(part, dtype=np.int64), :3].ravel()
            for block, part in zip(found.cells, parts, strict=False)
            if block.type.startswith("triangle") and part is not None and len(part)
        ]
        if chosen:
            names[name] = np.unique(np.concatenate(chosen))
    for name, number in _physical(found, 2).items():
        chosen = [
            np.asarray(block.data)[marks == number][:, :3].ravel()
            for block, marks in zip(found.cells, found.cell_data["gmsh:physical"], strict=True)
            if block.type.startswith("triangle")
        ]
        names[name] = np.unique(np.concatenate(chosen)) if chosen else np.empty(0, dtype=np.int64)
    return names


def _region_names(found: Any, blocks: list[int]) -> dict[str, Ints]:
    """Return the cells by name, counted among the tetrahedra."""
    starts = dict(zip(blocks, np.cumsum([0] + [len(found.cells[i].data) for i in blocks]).tolist(), strict=False))
    names: dict[str, Ints] = {}
    for name, parts in _cell_sets(found):
        chosen = [np.asarray(parts[i], dtype=np.int64) + start for i, start in starts.items() if i < len(parts)
                  and parts[i] is not None and len(parts[i])]  # fmt: skip
        if chosen:
            names[name] = np.concatenate(chosen)
    for name, number in _physical(found, 3).items():
        marks = found.cell_data["gmsh:physical"]
        names[name] = np.concatenate([np.flatnonzero(marks[i] == number) + start for i, start in starts.items()])
    return names


def _cell_sets(found: Any) -> list[tuple[str, Any]]:
    """Return the sets of cells by name; those of Gmsh's own (``gmsh:``) hold no cells."""
    return [(name, parts) for name, parts in found.cell_sets.items() if not name.startswith("gmsh:")]


def _physical(found: Any, dimension: int) -> dict[str, int]:
    """Return Gmsh's physical groups of a dimension: number by name."""
    if "gmsh:physical" not in found.cell_data:
        return {}
    return {name: int(number) for name, (number, dim) in found.field_data.items() if dim == dimension}


def read_surfaces(file: str, unit: float) -> tuple[NDArray[np.float64], Ints]:
    """Return the closed surfaces of an STL file: corners in m, shape (n, 3), and triangles, shape (t, 3).

    Args:
        file: Its path.
        unit: Metres in one of its lengths.

    Raises:
        GeometryError: No such file, no STL, or a surface that is not closed.
    """
    if Path(file).suffix.lower() != ".stl":
        raise GeometryError(f"file is {file!r}; surfaces are read from .stl")
    return _closed(file, _by_meshio(file, "stl"), unit)


def _closed(file: str, found: Any, unit: float) -> tuple[NDArray[np.float64], Ints]:
    triangles = [np.asarray(block.data, dtype=np.int64) for block in found.cells if block.type == "triangle"]
    if not triangles:
        raise GeometryError(f"file {file} has no triangles")
    places = unit * np.asarray(found.points, dtype=float)
    extent = float(np.abs(places).max()) if np.isfinite(places).all() else math.inf
    if extent > FARTHEST:
        raise GeometryError(
            f"file {file} has a corner {extent:.4g} m from its origin, but at most {FARTHEST:g} m is allowed; check its unit, "
            f"or repair it in the program that wrote it"
        )
    points, triangles_of_all = _joined(places, np.concatenate(triangles))
    _check_closed(file, points, triangles_of_all)
    a, b, c = np.moveaxis(points[triangles_of_all], 1, 0)
    if (
        not abs(np.einsum("ij,ij->", a - points[0], np.cross(b - points[0], c - points[0])))
        > FLAT * np.ptp(points, axis=0).max() ** 3
    ):
        raise GeometryError(f"file {file} encloses no volume; repair it in the program that wrote it")
    return points, triangles_of_all


def _filled(file: str, found: Any, unit: float, cell_size: float) -> Tetrahedra:
    """Return the solid between the surfaces of an STL file, meshed."""
    points, triangles = _closed(file, found, unit)
    try:
        nodes, cells = apart(_fill, points, triangles, cell_size)
    except MeshingError as error:
        raise GeometryError(
            f"the solid between the surfaces of {file} cannot be meshed ({error}); look for surfaces that touch or cross each "
            "other, or try another cell_size"
        ) from None
    return Tetrahedra.made(nodes, cells, {}, {})


def _joined(points: NDArray[np.float64], triangles: Ints) -> tuple[NDArray[np.float64], Ints]:
    """Return an STL file's triangles with common corners: it lists each corner with each triangle anew."""
    from scipy.spatial import cKDTree

    near = SAME * float(np.linalg.norm(np.ptp(points, axis=0)))
    pairs = cKDTree(points).query_pairs(near, output_type="ndarray")
    group = joined(pairs, len(points))
    _, first = np.unique(group, return_index=True)
    triangles = group[triangles]
    ends = np.sort(triangles, axis=1)
    return points[first], triangles[(ends[:, 0] != ends[:, 1]) & (ends[:, 1] != ends[:, 2])]


def _check_closed(file: str, points: NDArray[np.float64], triangles: Ints) -> None:
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    known, count = np.unique(edges, axis=0, return_counts=True)
    open_edges = known[count != 2]
    if len(open_edges):
        x, y, z = 1e3 * points[open_edges[0]].mean(axis=0)
        raise GeometryError(
            f"file {file} is not watertight: {len(open_edges)} edges do not belong to exactly two triangles, the first near "
            f"{x:.4g}, {y:.4g}, {z:.4g} mm; repair it in the program that wrote it"
        )


def _fill(points: NDArray[np.float64], triangles: Ints, cell_size: float) -> tuple[NDArray[np.float64], Ints]:
    """Mesh the solid between closed surfaces: nodes in m, and tetrahedra. The largest surface is the outside."""
    try:
        return _meshed(points, triangles, cell_size, True)
    except Exception:  # bare: Gmsh finds no parameters of some surfaces; then their own triangles have to do
        return _meshed(points, triangles, cell_size, False)


def _meshed(
    points: NDArray[np.float64], triangles: Ints, cell_size: float, anew: bool
) -> tuple[NDArray[np.float64], Ints]:
    """See `_fill`; ``anew`` meshes the surfaces anew with cells of their own, else the file's triangles stay."""
    with private_model():
        tag = gmsh.model.addDiscreteEntity(2)
        gmsh.model.mesh.addNodes(2, tag, np.arange(1, len(points) + 1), points.ravel())
        gmsh.model.mesh.addElementsByType(tag, 2, [], (triangles + 1).ravel())
        gmsh.model.mesh.classifySurfaces(FEATURE, True, anew, math.pi)
        if anew:
            gmsh.model.mesh.createGeometry()
        shells = _shells([tag for _, tag in gmsh.model.getEntities(2)])
        outer = max(shells, key=_extent)
        loops = [gmsh.model.geo.addSurfaceLoop(shell) for shell in [outer, *(s for s in shells if s is not outer)]]
        solid = gmsh.model.geo.addVolume(loops)
        gmsh.model.geo.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 1)
        gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: min(other, cell_size))
        try:
            gmsh.model.mesh.generate(3)
        except Exception as error:  # Gmsh raises bare Exception
            raise MeshingError(str(error).strip() or "Gmsh gives no reason") from None
        gmsh.model.mesh.optimize("Netgen")
        # Straight edges, as the file has them; of the order that the library's own meshes have, whose forms are compiled.
        gmsh.option.setNumber("Mesh.SecondOrderLinear", 1)
        gmsh.model.mesh.setOrder(2)
        known, places, _ = gmsh.model.mesh.getNodes()
        at = np.empty((int(known.max()) + 1, 3))
        at[known.astype(int)] = places.reshape(-1, 3)
        _, nodes = gmsh.model.mesh.getElementsByType(11, solid)
        if not len(nodes):
            raise MeshingError("Gmsh made no cells")
        return at, nodes.astype(np.int64).reshape(-1, 10)[:, TO_GMSH]


def _shells(surfaces: list[int]) -> list[list[int]]:
    """Return the surfaces that are connected by their curves."""
    left, shells = set(surfaces), []
    curves = {tag: {abs(curve) for _, curve in gmsh.model.getBoundary([(2, tag)], oriented=False)} for tag in surfaces}
    while left:
        shell = [left.pop()]
        for tag in shell:
            joined = {other for other in left if curves[other] & curves[tag]}
            left -= joined
            shell += joined
        shells.append(shell)
    return shells


def _extent(shell: list[int]) -> float:
    boxes = np.array([gmsh.model.getBoundingBox(2, tag) for tag in shell])
    return float(np.linalg.norm(boxes[:, 3:].max(axis=0) - boxes[:, :3].min(axis=0)))


# ----------------------------------------------------------------------------------------------------------------------
# What each boundary triangle of a foreign mesh does: cut plane, wall of a cavity, support, or just its outside.
#
# The rules are those of drawings (`geometries.imported_step`): take away the cut planes; the triangles that are connected by
# their edges are then the outside or one cavity each.


NEAR = 1e-5
"""What counts as the same place, over the part's extent: files round to seven digits."""


def find_roles(part: ImportedMesh, mesh: Tetrahedra) -> dict[str, Ints]:
    """Return the boundary triangles by role; every triangle has one.

    Raises:
        GeometryError: A choice that picks nothing, or something that cannot have this role.
    """
    left = np.arange(len(mesh.triangles))
    roles: dict[str, Ints] = {}
    for i, text in enumerate(part.planes):
        roles[f"plane{i}"] = _in_cut_plane(part, mesh, text, left)
        left = np.setdiff1d(left, roles[f"plane{i}"])
    pieces = mesh.pieces(left)
    outside = max(pieces, key=lambda piece: _size(mesh, piece)) if pieces else left
    if not part.cavities:
        inner = [piece for piece in pieces if piece is not outside]
        roles[cavity_role(0)] = only_inner_shell(part.file, inner, lambda piece: _middle(mesh, piece))
        left = np.setdiff1d(left, roles[cavity_role(0)])
    for i, text in enumerate(part.cavities[: part.cavity_count]):
        by_point = re.match(r"\s*at\b", text)
        wall = _around(mesh, pieces, text) if by_point else _with_faces(part, mesh, pieces, text, left)
        if np.isin(outside, wall).any():
            raise GeometryError(
                f"cavities has {text!r}; that is outside the part, or its cavity is open to the outside"
            )
        if not np.isin(wall, left).all():
            raise GeometryError(f"cavities has {text!r}; that cavity is already selected")
        roles[cavity_role(i)] = wall
        left = np.setdiff1d(left, wall)
    patches = [(name, "surfaces", text) for name, text in part.patches.items()]
    for role, field, text in (("support", "support", part.support), *patches):
        if text:
            roles[role] = _some(part, mesh, f"{field} is {text!r}", field, text, left)
            left = np.setdiff1d(left, roles[role])
    return {name: triangles for name, triangles in {**roles, "outer": left}.items() if len(triangles)}


def _some(part: ImportedMesh, mesh: Tetrahedra, what: str, field: str, text: str, left: Ints) -> Ints:
    """Return the triangles among ``left`` that a text picks; there must be some."""
    found = _chosen(mesh, field, text, left)
    if not len(found):
        spans = ", ".join(
            f"{name} {a:.4g} to {b:.4g}"
            for name, a, b in zip(AXES, 1e3 * mesh.points.min(axis=0), 1e3 * mesh.points.max(axis=0), strict=True)
        )
        raise GeometryError(
            f"{what}; the part has no such face, or it already belongs to a cut plane or a cavity (it spans {spans} mm)"
        )
    return found


def _chosen(mesh: Tetrahedra, field: str, text: str, left: Ints) -> Ints:
    choice, near = faces(field, text), NEAR * mesh.extent
    if choice.colour is not None:
        raise GeometryError(f"{field} is {text!r}; a mesh has no colours: name faces, or pick them by their place")
    if choice.name is not None:
        if choice.name not in mesh.faces:
            raise GeometryError(f"{field} is {text!r}; {listed('name', sorted(mesh.faces))}")
        return np.intersect1d(left, mesh.named(choice.name))
    corners = mesh.corners[left]
    if choice.box is not None:
        low, high = (np.array(end) for end in choice.box)
        return left[((corners > low - near) & (corners < high + near)).all(axis=(1, 2))]
    assert choice.normal is not None
    normal = np.array(choice.normal)
    typed = 0.0 if np.abs(normal).max() == 1.0 else TILT * float(np.linalg.norm(corners, axis=2).max(initial=0.0))
    return left[(np.abs(corners @ normal - choice.at) < near + typed).all(axis=1)]


def _in_cut_plane(part: ImportedMesh, mesh: Tetrahedra, text: str, left: Ints) -> Ints:
    """Return all triangles in the plane of those that a text picks, which must go through the origin."""
    what, near = f"planes has {text!r}", NEAR * mesh.extent
    normal = _fitted_normal(mesh, _some(part, mesh, what, "planes", text, left))
    picked = mesh.corners[_some(part, mesh, what, "planes", text, left)].reshape(-1, 3) @ normal
    if np.ptp(picked) > 2 * near:
        raise GeometryError(f"{what}; these faces do not lie in one plane")
    if abs(picked.mean()) > near:
        shift = ", ".join(f"{value:.6g}" for value in -1e3 * picked.mean() * normal + 0.0)
        raise GeometryError(f"{what}; cut planes go through the origin: move the part by {shift} mm where it is meshed")
    return left[(np.abs(mesh.corners[left] @ normal) < near).all(axis=1)]


def _fitted_normal(mesh: Tetrahedra, triangles: Ints) -> np.ndarray:
    """Return the unit normal of the plane nearest to some triangles."""
    places = mesh.corners[triangles].reshape(-1, 3)
    normal: np.ndarray = np.linalg.svd(places - places.mean(axis=0), full_matrices=False)[2][2]
    return np.round(normal, 6) / np.linalg.norm(np.round(normal, 6)) + 0.0


def outward(part: ImportedMesh, mesh: Tetrahedra, roles: Mapping[str, Ints]) -> tuple[Vector, ...]:
    """Return the unit normals of the cut planes, away from the solid.

    Raises:
        GeometryError: A plane that does not bound the part, or planes between which its images do not fill the whole.
    """
    normals = []
    for i, text in enumerate(part.planes):
        normal = _fitted_normal(mesh, roles[f"plane{i}"])
        normal = np.where(mesh.normals[roles[f"plane{i}"][0]] @ normal < 0, -normal, normal) + 0.0
        if (mesh.points @ normal).max() > NEAR * mesh.extent:
            raise GeometryError(f"planes has {text!r}; the part extends to both sides of it, so it is not cut there")
        x, y, z = (float(value) for value in normal)
        normals.append((x, y, z))
    check_slice(normals, part.planes)
    return tuple(normals)


def put_on_planes(mesh: Tetrahedra, roles: Mapping[str, Ints], normals: Sequence[Vector]) -> Tetrahedra:
    """Return the mesh with the nodes on its cut planes exactly there: files round."""
    points = mesh.points.copy()
    for _ in range(3):  # a node on two planes comes nearer to both
        for i, normal in enumerate(normals):
            nodes = np.unique(mesh.triangles[roles[f"plane{i}"]])
            points[nodes] -= np.outer(points[nodes] @ normal, normal)
    return dataclasses.replace(mesh, points=points)


def cavity_volumes(part: ImportedMesh, mesh: Tetrahedra, roles: Mapping[str, Ints]) -> tuple[float, ...]:
    """Return the volume in m3 of each cavity of the part as meshed.

    Raises:
        GeometryError: A wall that encloses nothing.
    """
    volumes = tuple(mesh.enclosed(roles[cavity_role(i)]) for i in range(part.cavity_count))
    for i, volume in enumerate(volumes):
        if not volume > 0.0:
            what = f"cavities has {part.cavities[i]!r}" if part.cavities else "the part has one closed inner shell"
            raise GeometryError(f"{what}; its wall encloses no air, so the mesh is no solid around it")
    return volumes


def gauge(part: ImportedMesh, mesh: Tetrahedra, roles: Mapping[str, Ints]) -> Vector:
    """Return the corner of the boundary nearest to the wanted point, or the one farthest from the held faces, or from the
    origin."""
    nodes = np.unique(mesh.triangles[:, :3])
    places = mesh.points[nodes]
    if part.gauge_point:
        at = places[np.linalg.norm(places - point("gauge_point", part.gauge_point), axis=1).argmin()]
    else:
        held = mesh.corners[roles["support"]].reshape(-1, 3).mean(axis=0) if "support" in roles else np.zeros(3)
        at = places[np.linalg.norm(places - held, axis=1).argmax()]
    return float(at[0]), float(at[1]), float(at[2])


def _around(mesh: Tetrahedra, pieces: list[Ints], text: str) -> Ints:
    """Return the piece of wall nearest to a point in the air."""
    place = point("cavities", text)
    if mesh.holds(place):
        raise GeometryError(f"cavities has {text!r}; that point lies in the solid, not in a cavity's air")
    away = mesh.distances(place)
    return min(pieces, key=lambda piece: float(away[piece].min()))


def _with_faces(part: ImportedMesh, mesh: Tetrahedra, pieces: list[Ints], text: str, left: Ints) -> Ints:
    """Return the piece of wall that the picked triangles belong to, or several if they do."""
    picked = _some(part, mesh, f"cavities has {text!r}", "cavities", text, left)
    return np.concatenate([piece for piece in pieces if np.isin(piece, picked).any()])


def _middle(mesh: Tetrahedra, piece: Ints) -> np.ndarray:
    places = mesh.corners[piece].reshape(-1, 3)
    middle: np.ndarray = (places.min(axis=0) + places.max(axis=0)) / 2
    return middle


def _size(mesh: Tetrahedra, piece: Ints) -> float:
    return float(np.linalg.norm(np.ptp(mesh.corners[piece].reshape(-1, 3), axis=0)))


@register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class ImportedMesh(ImportedPart):
    """A part from a mesh: ``.msh`` of Gmsh, ``.inp`` of Abaqus and CalculiX, or an ``.stl`` of its surfaces, air's included.

    Cells are tetrahedra, of 4 or of 10 nodes, and are taken as they are. An STL file is filled with cells of ``cell_size``.
    Faces are picked as of a drawing, "named x" by a node set, a set of triangles or a physical surface; cells with a name are
    a region.
    """

    unit: str = choice_field("mm", tuple(UNITS), "unit of the file's lengths, which such files do not store")
    cell_size: float = length_field(0.003, "longest edge of the cells, only for an STL file", shape=False)

    meshed: ClassVar[bool] = True
    kind: ClassVar[str] = "mesh (--file part.msh, part.inp or part.stl)"

    def check_cells(self) -> None:
        """Return nothing to model, as a mesh is used unchanged."""

    @property
    def mesh(self) -> Tetrahedra:
        """The mesh in m; read once."""
        return _read(self, self.digest())[0]

    @property
    def reading(self) -> Reading:
        return _read(self, self.digest())[1]

    def cast_along(self, pull: Vector | None, level: float | None) -> Recipe:
        raise GeometryError(
            f"file {self.file} holds a mesh, without the exact faces that a mould is cut along; use the part's STEP file"
        )

    @property
    def regions(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names that the file has for some of the cells."""
        return tuple(self._named)

    @property
    def _named(self) -> dict[str, str]:
        """The file's names by those of the regions."""
        every = len(self.mesh.cells)
        return {region_name(name): name for name, cells in self.mesh.regions.items() if 0 < len(cells) < every}

    @property
    def mesh_order(self) -> int:
        return 1 if self.mesh.cells.shape[1] == 4 else 2

    @property
    def expected_cells(self) -> float:
        return float(len(self.mesh.cells))

    def build(self) -> None:
        """Put the mesh into the current Gmsh model, every role a group of its boundary, every region of its cells."""
        mesh = self.mesh
        second = mesh.cells.shape[1] == 10
        solid = gmsh.model.addDiscreteEntity(3)
        gmsh.model.mesh.addNodes(3, solid, np.arange(1, len(mesh.points) + 1), mesh.points.ravel())
        left = np.ones(len(mesh.cells), dtype=bool)
        parts = []
        for name, given in self._named.items():
            cells = mesh.regions[given]
            inside = cells[left[cells]]
            left[inside] = False
            parts.append((name, inside, gmsh.model.addDiscreteEntity(3)))
        parts.append(("solid", np.flatnonzero(left), solid))
        for name, cells, tag in parts:
            if not len(cells):
                continue
            nodes = mesh.cells[cells][:, TO_GMSH] if second else mesh.cells[cells]
            gmsh.model.mesh.addElementsByType(tag, 11 if second else 4, [], (nodes + 1).ravel())
            gmsh.model.addPhysicalGroup(3, [tag], name=name)
        for role, triangles in find_roles(self, mesh).items():
            tag = gmsh.model.addDiscreteEntity(2)
            gmsh.model.mesh.addElementsByType(tag, 9 if second else 2, [], (mesh.triangles[triangles] + 1).ravel())
            gmsh.model.addPhysicalGroup(2, [tag], name=role)


@functools.lru_cache(maxsize=8)
def _read(part: ImportedMesh, digest: str) -> tuple[Tetrahedra, Reading]:
    """Read the file and check every choice against it.

    Args:
        part: The part.
        digest: Hash of the file's bytes: another content is another reading.
    """
    mesh = read_mesh(part.file, UNITS[part.unit], part.cell_size)
    if not 1e-5 < mesh.extent < 10.0:
        raise GeometryError(
            f"file {part.file} spans {1e3 * mesh.extent:.4g} mm with unit {part.unit!r}; give the unit of its lengths"
        )
    roles = find_roles(part, mesh)
    normals = outward(part, mesh, roles)
    mesh = put_on_planes(mesh, roles, normals)
    volumes = cavity_volumes(part, mesh, roles)
    return mesh, Reading(normals, gauge(part, mesh, roles), mesh.volume, volumes)


__all__ = ["ImportedMesh"]
