"""Solids in layers that are bonded to each other, in Gmsh: common faces where they touch, names for regions and faces.

The model is in mm and the mesh is written in m: the CAD kernel's fixed tolerances suit mm.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from geometries.errors import MeshingError

Entity = tuple[int, int]
Vector = tuple[float, float, float]

MM = 1e3
"""Model lengths in one metre."""


def add_block(low: Vector, high: Vector) -> Entity:
    """Add a block with sides along the axes, its corners in m."""
    import gmsh  # type: ignore[import-untyped]

    return (3, int(gmsh.model.occ.addBox(*(MM * np.array(low)), *(MM * np.subtract(high, low)))))


def one_solid(solids: Sequence[Entity]) -> Entity:
    """The only one of them; MeshingError if the CAD kernel has made more or none."""
    if [dimension for dimension, _ in solids] != [3]:
        raise MeshingError(
            f"the CAD kernel made {len(solids)} solids of one body; please report this with the parameters"
        )
    return solids[0]


def bond(layers: Mapping[str, Sequence[Entity]], role_of: Callable[[int], str]) -> None:
    """Make the faces between layers common, and name the regions and the faces on the boundary.

    Args:
        layers: Solids by the region that they are of.
        role_of: Gives the role of a face by its tag.
    """
    import gmsh

    every = [(solid, name) for name, solids in layers.items() for solid in solids]
    _, parts = gmsh.model.occ.fragment([every[0][0]], [solid for solid, _ in every[1:]])
    gmsh.model.occ.synchronize()
    regions: dict[str, list[int]] = defaultdict(list)
    for (_, name), found in zip(every, parts, strict=True):
        regions[name] += [tag for _, tag in found]
    for name, tags in regions.items():
        gmsh.model.addPhysicalGroup(3, tags, name=name)
    solids = [(3, tag) for tags in regions.values() for tag in tags]
    roles: dict[str, list[int]] = defaultdict(list)
    for _, tag in gmsh.model.getBoundary(solids, combined=True, oriented=False):
        roles[role_of(tag)].append(tag)
    for role, tags in roles.items():
        gmsh.model.addPhysicalGroup(2, tags, name=role)


def set_sizes(size: Callable[[float, float, float], float]) -> None:
    """Let cells have a size in m that is a function of the place in m; the mesh is written in m."""
    import gmsh

    gmsh.option.setNumber("Mesh.ScalingFactor", 1.0 / MM)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: MM * size(x / MM, y / MM, z / MM))


def corners_of(tag: int) -> NDArray[np.float64]:
    """Corners of a face in m, shape (n, 3)."""
    import gmsh

    corners = gmsh.model.getBoundary([(2, tag)], combined=False, oriented=False, recursive=True)
    return np.array([gmsh.model.getValue(0, corner, []) for _, corner in corners]) / MM


def face_block(tag: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Corners in m of the block around a face, which is larger by up to 1e-10 m."""
    import gmsh

    low, high = np.array(gmsh.model.occ.getBoundingBox(2, tag)).reshape(2, 3) / MM
    return low, high
