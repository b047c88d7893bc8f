"""How many triangles the mesh of a STEP part's faces takes, from their areas and curvature, before any is made."""

from __future__ import annotations

import numpy as np

from geometries.disk_cells import TRIANGLE

MOST_TRIANGLES = 1_000_000

SAMPLES = 5
"""Places in each direction of a face's parameters where its curvature is looked at."""


def expected_triangles(faces: list[int], cell_size: float, curvature: float) -> float:
    """Number of triangles on faces of the current Gmsh model, or fewer: fine edges make the faces beside them finer.

    Args:
        faces: Their tags.
        cell_size: Longest edge in m.
        curvature: Cells around a full circle.
    """
    import gmsh  # type: ignore[import-untyped]

    total = 0.0
    for face in faces:
        around = 2.0 * np.pi / (curvature * np.maximum(_curvatures(face), 1e-30))
        sizes = np.minimum(cell_size, around)
        total += float(gmsh.model.occ.getMass(2, face)) * float(np.mean(sizes**-2.0))
    return total / TRIANGLE


def _curvatures(face: int) -> np.ndarray:
    """Largest curvature (1/m) at places all over a face."""
    import gmsh

    low, high = gmsh.model.getParametrizationBounds(2, face)
    share = (np.arange(SAMPLES) + 0.5) / SAMPLES
    u, v = (low[i] + share * (high[i] - low[i]) for i in range(2))
    places = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1)
    largest, smallest = gmsh.model.getPrincipalCurvatures(face, list(places))[:2]
    return np.maximum(np.abs(largest), np.abs(smallest))
