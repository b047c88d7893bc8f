"""Meshes that other programs wrote: read into arrays, with the names that they have for faces and regions.

Gmsh's ``.msh`` and Abaqus' ``.inp`` are read by meshio, which runs nothing that a file holds. An ``.stl`` has surfaces
alone; the solid between them is meshed by Gmsh, in a process of its own.
"""

from __future__ import annotations

import contextlib
import io
import math
import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometries.apart import apart
from geometries.errors import GeometryError, MeshingError
from geometries.joined import joined
from geometries.tetrahedra import TO_GMSH, Ints, Tetrahedra
from measurement.user_file import GEOMETRY, check_file, read_file

FORMATS: Mapping[str, str] = {".msh": "gmsh", ".inp": "abaqus", ".stl": "stl"}
"""Endings of the files that are read, and meshio's names for them."""
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
        raise GeometryError(f"file {file} is not a mesh as its ending says") from None
    except Exception as error:  # meshio raises what its readers happen to meet
        words = " ".join(str(error).split())[:200] or "no reason given"
        raise GeometryError(f"file {file} is not a mesh as its ending says ({words})") from None
    if len(found.points) > Path(file).stat().st_size:  # a count in its header that no numbers follow
        raise GeometryError(f"file {file} is not a mesh as its ending says (it announces more nodes than it has bytes)")
    if not len(found.points) or not np.isfinite(found.points).all() or np.shape(found.points)[1] != 3:
        raise GeometryError(f"file {file} has no nodes in three dimensions")
    return found


def _check_deck(file: str, text: str) -> None:
    """Refuse a deck that has meshio open other files, or count to numbers that no deck has; it runs nothing else."""
    ranges = False
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("**"):
            continue
        # Meshio's own way to find a keyword, which needs no asterisk.
        keyword = line.partition(",")[0].strip().replace("*", "").upper()
        named = line.startswith("*") and re.search(r",\s*INPUT\s*=", line, re.IGNORECASE)
        if keyword == "INCLUDE" or named:
            raise GeometryError(
                f"file {file} takes lines from another file (line {number}: {line.strip()[:80]!r}), and no other file is "
                "opened for a mesh; write nodes and elements into one file, or paste the other file's lines in there"
            )
        if line.startswith("*"):
            ranges = "GENERATE" in line.upper()
        elif ranges and keyword:
            first, last, *_ = [*re.findall(r"-?\d+", line), "0", "0"]
            if len(last) > 18 or int(last) - int(first) > len(text):
                raise GeometryError(
                    f"file {file} is not a mesh as its ending says (line {number} has a set of {line.strip()[:80]!r}, more "
                    "than the file has letters)"
                )


def _tetrahedra(file: str, found: Any) -> tuple[Ints, list[int]]:
    """All tetrahedra of one order, and the cell blocks that they come from."""
    kinds = [block.type for block in found.cells]
    if other := sorted({kind for kind in kinds if kind.startswith(OTHER_CELLS)}):
        raise GeometryError(
            f"file {file} has {', '.join(other)} cells; tetrahedra of 4 or 10 nodes are taken: mesh it with those"
        )
    blocks = [i for i, kind in enumerate(kinds) if kind in ("tetra", "tetra4", "tetra10")]
    if not blocks:
        raise GeometryError(f"file {file} has no tetrahedra; it has {', '.join(sorted(set(kinds))) or 'no cells'}")
    if len({np.shape(found.cells[i].data)[1] for i in blocks}) > 1:
        raise GeometryError(f"file {file} mixes tetrahedra of 4 and of 10 nodes; mesh it with one kind")
    cells = np.concatenate([np.asarray(found.cells[i].data, dtype=np.int64) for i in blocks])
    if cells.min() < 0 or cells.max() >= len(found.points):
        raise GeometryError(f"file {file} has cells with nodes that it does not have")
    return cells, blocks


def _face_names(found: Any) -> dict[str, Ints]:
    """Nodes by name: of node sets, of sets of triangles, of physical surfaces."""
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
    """Cells by name, counted among the tetrahedra."""
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
    """Sets of cells by name; those of Gmsh's own (``gmsh:``) hold no cells."""
    return [(name, parts) for name, parts in found.cell_sets.items() if not name.startswith("gmsh:")]


def _physical(found: Any, dimension: int) -> dict[str, int]:
    """Gmsh's physical groups of a dimension: number by name."""
    if "gmsh:physical" not in found.cell_data:
        return {}
    return {name: int(number) for name, (number, dim) in found.field_data.items() if dim == dimension}


def read_surfaces(file: str, unit: float) -> tuple[NDArray[np.float64], Ints]:
    """The closed surfaces of an STL file: corners in m, shape (n, 3), and triangles, shape (t, 3).

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
            f"file {file} has a corner {extent:.4g} m from its origin, and {FARTHEST:g} m are taken; check its unit, or repair "
            "it in the program that wrote it"
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
    """The solid between the surfaces of an STL file, meshed."""
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
    """An STL file's triangles with common corners: it lists each corner with each triangle anew."""
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
            f"file {file} is not watertight: {len(open_edges)} edges do not belong to two triangles, the first near {x:.4g}, "
            f"{y:.4g}, {z:.4g} mm; repair it in the program that wrote it"
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
    import gmsh  # type: ignore[import-untyped]

    from geometries.meshing import private_model

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
    """Surfaces that hang together by their curves."""
    import gmsh

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
    import gmsh

    boxes = np.array([gmsh.model.getBoundingBox(2, tag) for tag in shell])
    return float(np.linalg.norm(boxes[:, 3:].max(axis=0) - boxes[:, :3].min(axis=0)))
