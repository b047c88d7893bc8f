"""Where the pour opening and the vents go: on the face that is bonded later, clear of every core."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from geometries.fields import shown
from softmodels.design.mould.settings import MouldError, Workshop
from softmodels.design.mould.solids import MM, Array, Solid

GRID = 120
"""Places looked at along the longer side."""
ALONG = 60
"""Points on each curve of the face's edge."""


def hole_places(cast: list[Solid], level: float, workshop: Workshop) -> tuple[Array, Array]:
    """Places (x, y) in mm of the pour opening, shape (2,), and of the vents, shape (n, 2).

    The pour opening is where most room is; the vents are as far from it and from each other as can be.

    Args:
        cast: The half that is cast, in the current Gmsh model.
        level: Height of the parting plane, mm.
        workshop: Sizes of the holes.

    Raises:
        MouldError: There is no room.
    """
    segments = _edge(cast, level)
    places, room = _places(segments)
    needed = 0.5 * MM * workshop.pour + MM * workshop.least_gap
    best = float(room.max(initial=0.0))
    if best < needed:
        raise MouldError(
            f"pour is {shown(workshop.pour, 'm')}; the face that is bonded leaves room for "
            f"{shown(round(max(2.0 * (best / MM - workshop.least_gap), 0.0), 6), 'm')} beside the cores"
        )
    pour = places[room.argmax()]
    free = places[room >= 0.5 * MM * workshop.vent + MM * workshop.least_gap]
    apart = 0.5 * MM * (workshop.pour + workshop.vent) + MM * workshop.least_wall
    vents: list[Array] = []
    for _ in range(workshop.vents):
        taken = np.array([pour, *vents])
        distance, _ = cKDTree(taken).query(free)
        if not len(free) or distance.max() < apart:
            raise MouldError(
                f"vents is {workshop.vents}; the face that is bonded has room for {len(vents)} beside the cores"
            )
        vents.append(free[distance.argmax()])
    return pour, np.array(vents)


def _edge(cast: list[Solid], level: float) -> Array:
    """Straight pieces (x, y) of the edge of the faces that lie in the parting plane, shape (n, 2, 2)."""
    import gmsh  # type: ignore[import-untyped]

    near, pieces = 1e-4, []
    for _, face in gmsh.model.getBoundary(cast, combined=True, oriented=False):
        box = gmsh.model.occ.getBoundingBox(2, face)
        if max(abs(box[2] - level), abs(box[5] - level)) > near:
            continue
        for _, curve in gmsh.model.getBoundary([(2, face)], combined=False, oriented=False):
            low, high = (bound[0] for bound in gmsh.model.getParametrizationBounds(1, curve))
            at = np.reshape(gmsh.model.getValue(1, curve, np.linspace(low, high, ALONG + 1)), (-1, 3))[:, :2]
            pieces.append(np.stack([at[:-1], at[1:]], axis=1))
    if not pieces:
        raise MouldError("the parting plane leaves no face to bond; choose another (--split)")
    return np.concatenate(pieces)


def _places(segments: Array) -> tuple[Array, Array]:
    """Places inside of an edge, shape (n, 2), and how far each is from it."""
    low, high = segments.min(axis=(0, 1)), segments.max(axis=(0, 1))
    step = float((high - low).max()) / GRID
    x, y = np.meshgrid(*(np.arange(a + 0.5 * step, b, step) for a, b in zip(low, high, strict=True)), indexing="ij")
    places = np.column_stack([x.ravel(), y.ravel()])
    (xa, ya), (xb, yb) = segments[:, 0].T, segments[:, 1].T
    inside = np.zeros(len(places), dtype=bool)
    for k, (px, py) in enumerate(places):  # a ray along x crosses the edge an odd number of times
        crossed = (ya > py) != (yb > py)
        inside[k] = (
            np.count_nonzero(xa[crossed] + (py - ya[crossed]) / (yb - ya)[crossed] * (xb - xa)[crossed] > px) % 2
        )
    places = places[inside]
    fine = np.concatenate(
        [segments[:, 0] + share * (segments[:, 1] - segments[:, 0]) for share in np.linspace(0, 1, 9)]
    )
    return places, cKDTree(fine).query(places)[0] if len(places) else np.zeros(0)
