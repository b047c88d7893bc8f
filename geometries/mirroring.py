"""A mesh of half a body mirrored into a mesh of the whole: cell by cell, so that it is as symmetric as the body."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

TURNED = {
    1: [1, 0],
    8: [1, 0, 2],
    2: [1, 0, 2],
    9: [1, 0, 2, 3, 5, 4],
    4: [1, 0, 2, 3],
    11: [1, 0, 2, 3, 4, 6, 5, 9, 8, 7],
}
"""Gmsh's lines, triangles and tetrahedra of first and second order: the order of nodes with the first two corners exchanged.

An image is turned inside out; this turns it back.
"""


@dataclasses.dataclass(frozen=True)
class Mirror:
    """A coordinate plane through the origin on which a mesh of half a body is mirrored into one of the whole.

    Attributes:
        role: Physical group of the facets on the plane; the whole has none such.
        axis: 0, 1 or 2: the plane is square to x, y or z.
        renamed: Groups whose image is another one, such as ``{"top": "bottom"}``; the image of any other joins it.
    """

    role: str
    axis: int
    renamed: Mapping[str, str]


def mirror_mesh(mirror: Mirror) -> None:
    """Add the image of the current model's mesh and its physical groups; nodes on the plane are shared."""
    import gmsh  # type: ignore[import-untyped]

    tags, places, _ = gmsh.model.mesh.getNodes()
    places = places.reshape(-1, 3).copy()
    groups = {gmsh.model.getPhysicalName(*group): group for group in gmsh.model.getPhysicalGroups()}
    on_plane = gmsh.model.mesh.getNodesForPhysicalGroup(*groups[mirror.role])[0]
    image = np.zeros(int(tags.max()) + 1, dtype=np.uint64)
    image[on_plane] = on_plane
    moved = image[tags] == 0
    image[tags[moved]] = int(tags.max()) + 1 + np.arange(np.count_nonzero(moved))
    places[:, mirror.axis] *= -1.0

    made: list[tuple[int, str, list[int], int]] = []
    for name, (dimension, group) in sorted(groups.items(), key=lambda item: item[1], reverse=True):  # cells first
        if name == mirror.role:
            continue
        entities = list(gmsh.model.getEntitiesForPhysicalGroup(dimension, group))
        copy = gmsh.model.addDiscreteEntity(dimension)
        if not made:
            gmsh.model.mesh.addNodes(dimension, copy, image[tags[moved]], places[moved].ravel())
        for entity in entities:
            for kind, _, nodes in zip(*gmsh.model.mesh.getElements(dimension, entity), strict=True):
                turned = image[nodes].reshape(-1, len(TURNED[kind]))[:, TURNED[kind]]
                gmsh.model.mesh.addElementsByType(copy, kind, [], turned.ravel())
        made.append((dimension, name, entities, copy))
    gmsh.model.removePhysicalGroups()
    for name in groups:  # Gmsh keeps the names, and would not give them anew
        gmsh.model.removePhysicalName(name)
    joined: dict[tuple[int, str], list[int]] = {}
    for dimension, name, entities, copy in made:
        joined.setdefault((dimension, name), []).extend(entities)
        joined.setdefault((dimension, mirror.renamed.get(name, name)), []).append(copy)
    for (dimension, name), members in sorted(joined.items()):
        gmsh.model.addPhysicalGroup(dimension, members, name=name)
