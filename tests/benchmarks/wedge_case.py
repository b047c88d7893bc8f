"""The hollow disk's wedge as the other finite element programs see it: mesh file, command line and result.

`felupe_wedge.py` and `calculix_wedge.py` share this module so that both solve the same problem and report it alike.

The mesh is a Gmsh file in metres with the axis of the disk along z and these physical names: the volume "solid" and the
surfaces "cavity" (loaded), "plane0" (the cut at y = 0), "plane1" (the other cut) and "support" (the bottom), such as
``python -m geometries HollowDisk --support base -o disk.msh`` makes. A mesh of linear tetrahedra is raised to
straight-sided quadratic ones.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from pathlib import Path
from typing import Any

import gmsh  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

GRAVITY = 9.80665
"""Standard gravity in m/s2, which turns a height of fluid into a pressure."""

FACES = np.array([(0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)])
"""Corners of a tetrahedron's faces, in the order in which Abaqus and CalculiX number the faces 1 to 4."""

VTK_FROM_GMSH = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]
"""Gmsh has the middles of edges 2-3 and 1-3 the other way round than VTK (FElupe) and Abaqus (CalculiX)."""

TETRAHEDRA = {4: 4, 11: 10}
"""Gmsh's element types that are accepted as cells, with their number of nodes."""

TRIANGLE6, TETRAHEDRON10 = 9, 11


@dataclasses.dataclass(frozen=True)
class Wedge:
    """A wedge's quadratic mesh; nodes count from 0, those at corners of tetrahedra come first.

    Attributes:
        points: Node positions in m, (nodes, 3).
        cells: Tetrahedra in VTK's node order, (cells, 10).
        cavity: Triangles of the loaded surface, normals pointing out of the solid, (faces, 6).
        owners: Tetrahedron behind each triangle of the cavity.
        sides: Which of that tetrahedron's `FACES` the triangle is.
        held: Nodes of "plane0", "plane1" and "support".
        normal: Unit normal (x, y) of the second cut.
        apex: Node on the axis at the top.
        ceiling: Node on the axis at the cavity's ceiling.
    """

    points: NDArray[np.float64]
    cells: NDArray[np.int64]
    cavity: NDArray[np.int64]
    owners: NDArray[np.int64]
    sides: NDArray[np.int64]
    held: dict[str, NDArray[np.int64]]
    normal: NDArray[np.float64]
    apex: int
    ceiling: int

    @property
    def axis(self) -> NDArray[np.int64]:
        """Nodes in both cuts, which can move along z only."""
        return np.intersect1d(self.held["plane0"], self.held["plane1"])


def read_wedge(path: Path) -> Wedge:
    """Read a mesh file; ValueError when a physical name is missing or the wedge is not where it should be."""
    if not path.is_file():
        raise FileNotFoundError(f"{path} is not a file")
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(path))
        if set(gmsh.model.mesh.getElementTypes(3)) - set(TETRAHEDRA):
            raise ValueError(f"{path} has cells other than tetrahedra of first or second order")
        if TETRAHEDRON10 not in gmsh.model.mesh.getElementTypes(3):
            gmsh.option.setNumber("Mesh.SecondOrderLinear", 1)
            gmsh.model.mesh.setOrder(2)
        tags, xyz, _ = gmsh.model.mesh.getNodes()
        raw_cells = elements("solid", 3, TETRAHEDRON10)[:, VTK_FROM_GMSH]
        raw_faces = {name: elements(name, 2, TRIANGLE6) for name in ("cavity", "plane0", "plane1", "support")}
    finally:
        gmsh.finalize()

    # FElupe sizes a pressure field by the largest corner number, so corners have to come first.
    corners = np.unique(raw_cells[:, :4])
    order = np.concatenate([corners, np.setdiff1d(raw_cells, corners)])
    index = np.full(int(tags.max()) + 1, -1)
    index[order] = np.arange(order.size)
    position = np.empty((int(tags.max()) + 1, 3))
    position[tags.astype(np.int64)] = xyz.reshape(-1, 3)
    points, cells = position[order], index[raw_cells]
    held = {name: np.unique(index[raw_faces[name]]) for name in ("plane0", "plane1", "support")}
    cavity, owners, sides = orient(index[raw_faces["cavity"]], points, cells)

    size = np.ptp(points, axis=0).max()
    if np.abs(points[held["plane0"], 1]).max() > 1e-9 * size:
        raise ValueError(f"plane0 of {path} is not at y = 0")
    farthest = points[held["plane1"][np.argmax(np.hypot(*points[held["plane1"], :2].T))], :2]
    normal = np.array([farthest[1], -farthest[0]]) / np.linalg.norm(farthest)
    if np.abs(points[held["plane1"], :2] @ normal).max() > 1e-9 * size:
        raise ValueError(f"plane1 of {path} is not a plane through the z axis")
    axis = np.intersect1d(held["plane0"], held["plane1"])
    in_cavity = np.intersect1d(axis, cavity)
    if in_cavity.size == 0:
        raise ValueError(f"the cavity of {path} does not reach the axis")
    apex, ceiling = (int(nodes[np.argmax(points[nodes, 2])]) for nodes in (axis, in_cavity))
    return Wedge(points, cells, cavity, owners, sides, held, normal, apex, ceiling)


def elements(name: str, dimension: int, kind: int) -> NDArray[np.int64]:
    """Node tags of a physical group's elements, one element a row."""
    groups = {gmsh.model.getPhysicalName(*group): group for group in gmsh.model.getPhysicalGroups(dimension)}
    if name not in groups:
        raise ValueError(f"the mesh has no physical group {name!r} of dimension {dimension}, only {sorted(groups)}")
    entities = gmsh.model.getEntitiesForPhysicalGroup(*groups[name])
    parts = [gmsh.model.mesh.getElementsByType(kind, tag)[1] for tag in entities]
    return np.concatenate(parts).astype(np.int64).reshape(-1, {TRIANGLE6: 6, TETRAHEDRON10: 10}[kind])


def orient(
    faces: NDArray[np.int64], points: NDArray[np.float64], cells: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Find the tetrahedron behind each triangle and turn the triangles' normals out of the solid.

    Gmsh orients a triangle like the CAD surface it is on, which says nothing about the side the solid is on.
    """
    weights = np.array([len(points) ** 2, len(points), 1])
    keys = np.sort(cells[:, FACES], axis=2) @ weights
    flat = np.argsort(keys, axis=None)
    wanted = np.sort(faces[:, :3], axis=1) @ weights
    place = np.minimum(np.searchsorted(keys.ravel()[flat], wanted), flat.size - 1)
    owners, sides = np.divmod(flat[place], 4)
    if not np.array_equal(keys[owners, sides], wanted):
        raise ValueError("the cavity has triangles that are not faces of the solid's tetrahedra")
    a, b, c = (points[faces[:, k]] for k in range(3))
    inside = points[cells[owners, :4]].mean(axis=1)
    inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), inside - a) > 0
    faces[inward] = faces[inward][:, [0, 2, 1, 5, 4, 3]]
    return faces, owners, sides


def parser(description: str) -> argparse.ArgumentParser:
    """Make the command line of the problem; each program adds its own options."""
    made = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("--mesh", type=Path, required=True, help="Gmsh file of the wedge, in m")
    made.add_argument(
        "--pressures-cm",
        type=lambda text: [float(part) for part in text.split(",")],
        default=[0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 14.0, 18.0, 24.0, 30.0],
        help="heights of the fluid column in cm, ascending, separated by commas",
    )
    made.add_argument("--shear-modulus", type=float, default=20e3, help="Pa")
    made.add_argument("--poisson", type=float, default=0.49)
    made.add_argument("--density", type=float, default=970.0, help="density of the column's fluid in kg/m3")
    made.add_argument("--support", choices=("slip", "glued"), default="slip", help="bottom held along z, or altogether")
    made.add_argument("--json", type=Path, help="write the result to this file too")
    return made


def read_arguments(made: argparse.ArgumentParser) -> argparse.Namespace:
    """Parse the command line and add `pascals` (the pressures), `lame` (Lame's first constant) and `bulk` in Pa."""
    args = made.parse_args()
    heights = np.array(args.pressures_cm)
    if heights.min() < 0 or np.any(np.diff(heights) <= 0):
        made.error("the pressures have to ascend from 0 or above")
    if not 0 < args.poisson < 0.5:
        made.error("Poisson's ratio has to be between 0 and 0.5")
    args.pascals = 0.01 * args.density * GRAVITY * heights
    args.lame = 2 * args.shear_modulus * args.poisson / (1 - 2 * args.poisson)
    args.bulk = args.lame + 2 * args.shear_modulus / 3
    return args


def report(result: dict[str, Any], path: Path | None) -> None:
    """Print the result as one JSON object and, with a path, write it there."""
    text = json.dumps(result)
    print(text)
    if path is not None:
        path.write_text(text + "\n")
