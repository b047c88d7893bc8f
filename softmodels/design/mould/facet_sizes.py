"""How long the edges of a body's triangles may be, so that they stray from its surface by no more than a chord error."""

from __future__ import annotations

import math

import numpy as np

PLANAR, DELAUNAY = 3, 6
"""Gmsh's algorithms: a plane needs no nodes inside."""


def set_sizes(solid: int, shares: dict[int, float], chord: float) -> None:
    """Edges as long as the curvature allows, times a share for each face, on the face and on the curves around it."""
    import gmsh

    low, high = np.reshape(gmsh.model.getBoundingBox(3, solid), (2, 3))
    largest = 0.25 * float(np.linalg.norm(high - low))
    sizes: dict[tuple[int, int], float] = {}
    for surface, share in shares.items():
        plane = gmsh.model.getType(2, surface) == "Plane"
        gmsh.model.mesh.setAlgorithm(2, surface, PLANAR if plane else DELAUNAY)
        size = largest if plane else min(largest, share * 2.0 * math.sqrt(2.0 * chord / _curvature(surface)))
        sizes[2, surface] = size
        for _, curve in gmsh.model.getBoundary([(2, surface)], combined=False, oriented=False):
            bent = _bend(curve)
            along = min(size, share * 2.0 * math.sqrt(2.0 * chord / bent)) if bent > 0.0 else size
            sizes[1, curve] = min(along, sizes.get((1, curve), largest))
    gmsh.option.setNumber("Mesh.MeshSizeMax", largest)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: sizes.get((dim, tag), largest))


def _curvature(surface: int) -> float:
    """Largest principal curvature at some points of a face, 1/mm."""
    import gmsh

    low, high = (np.array(bound) for bound in gmsh.model.getParametrizationBounds(2, surface))
    grid = np.array(
        [low + (high - low) * (a, b) for a in np.linspace(0.05, 0.95, 7) for b in np.linspace(0.05, 0.95, 7)]
    )
    most, least, _, _ = gmsh.model.getPrincipalCurvatures(surface, grid.ravel())
    values = np.abs(np.concatenate([most, least]))
    return max(float(values[np.isfinite(values)].max(initial=0.0)), 1e-6)


def _bend(curve: int) -> float:
    """Largest curvature of a curve, 1/mm."""
    import gmsh

    low, high = (bound[0] for bound in gmsh.model.getParametrizationBounds(1, curve))
    values = np.abs(gmsh.model.getCurvature(1, curve, np.linspace(low, high, 9)[1:-1]))
    return float(values[np.isfinite(values)].max(initial=0.0))
