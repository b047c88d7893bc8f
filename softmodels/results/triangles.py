"""Second-order triangles and the faces of second-order tetrahedra, as curves and small flat triangles to draw."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Cells = npt.NDArray[np.int64]

EDGES = np.array([(0, 1, 3), (1, 2, 4), (2, 0, 5)])
"""Edges of a six-node triangle: both ends and the node between them."""

FACES = {
    "Triangle_6": ((0, 1, 2, 3, 4, 5),),
    "Tetrahedron_10": ((0, 1, 3, 4, 8, 7), (1, 2, 3, 5, 9, 8), (2, 0, 3, 6, 7, 9), (0, 2, 1, 6, 5, 4)),
}
"""Faces of a cell, in VTK's order of nodes, as triangles of six nodes."""


def outer_faces(cells: Cells, cell_name: str) -> Cells:
    """Faces that belong to one cell alone, shape (f, 6); of a flat mesh, all its triangles."""
    faces = cells[:, np.array(FACES[cell_name])].reshape(-1, 6)
    _, first, count = np.unique(np.sort(faces[:, :3], axis=1), axis=0, return_index=True, return_counts=True)
    return faces[np.sort(first[count == 1])]


def edge_curves(points: Array, faces: Cells, parts: int = 8) -> Array:
    """Curves along the edges of six-node triangles, each once.

    Args:
        points: Shape (n, d).
        faces: Shape (f, 6).
        parts: Straight pieces per edge.

    Returns:
        Shape (edges, parts + 1, d).
    """
    edges = faces[:, EDGES].reshape(-1, 3)
    edges = edges[np.unique(edges[:, 2], return_index=True)[1]]
    return parabolas(points[edges], parts)


def parabolas(nodes: Array, parts: int) -> Array:
    """Parabolas through (begin, end, middle) nodes, shape (n, 3, d) to (n, parts + 1, d)."""
    s = np.linspace(0.0, 1.0, parts + 1)
    weights = np.column_stack([(1 - s) * (1 - 2 * s), s * (2 * s - 1), 4 * s * (1 - s)])
    return np.einsum("sk,nkd->nsd", weights, nodes)


def small_triangles(parts: int) -> tuple[Array, Cells]:
    """How a six-node triangle is cut into small flat ones.

    Args:
        parts: Pieces per edge.

    Returns:
        Weights of the six nodes at the small triangles' corners, shape (m, 6), and the triangles, shape (parts^2, 3).
    """
    places = [(i, j) for j in range(parts + 1) for i in range(parts + 1 - j)]
    number_of = {place: n for n, place in enumerate(places)}
    r, s = np.array(places).T / parts
    t = 1 - r - s
    weights = np.column_stack([t * (2 * t - 1), r * (2 * r - 1), s * (2 * s - 1), 4 * t * r, 4 * r * s, 4 * s * t])
    small = [[number_of[i, j], number_of[i + 1, j], number_of[i, j + 1]] for i, j in places if i + j < parts]
    small += [[number_of[i, j], number_of[i - 1, j], number_of[i, j - 1]] for i, j in places if i > 0 and j > 0]
    return weights, np.array(small)


def fine_triangles(values: Array, faces: Cells, parts: int = 4) -> tuple[Array, Cells]:
    """Six-node triangles as small flat ones.

    Args:
        values: Nodal values such as points, shape (n, k).
        faces: Shape (f, 6).
        parts: Pieces per edge.

    Returns:
        Values at the corners of the small triangles, shape (m, k), and the triangles, shape (f parts^2, 3).
    """
    weights, small = small_triangles(parts)
    fine = np.einsum("pk,fkd->fpd", weights, values[faces]).reshape(-1, values.shape[1])
    return fine, (np.arange(len(faces))[:, None, None] * len(weights) + small).reshape(-1, 3)


def outline(points: Array, cells: Cells) -> Array:
    """Curves along the edges that belong to one triangle alone, shape (n, d) to (edges, 9, d)."""
    return parabolas(points[border(cells)], 8)


def border(cells: Cells) -> Cells:
    """Edges that belong to one triangle alone, turned as in it: begin, end and middle nodes, shape (edges, 3)."""
    edges = cells[:, EDGES].reshape(-1, 3)
    _, first, count = np.unique(edges[:, 2], return_index=True, return_counts=True)
    return edges[first[count == 1]]
