"""Closed surfaces as STL files: balls with meridians, and boxes."""

from __future__ import annotations

import numpy as np


def write_stl(path, points, triangles):
    """Write triangles as an STL file of text, in millimetres; points (n, 3) in m."""
    lines = ["solid shape"]
    for corners in 1e3 * np.asarray(points)[np.asarray(triangles)]:
        lines += ["facet normal 0 0 0", "outer loop", *(f"vertex {x:.9g} {y:.9g} {z:.9g}" for x, y, z in corners)]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid shape"]))
    return path


def ball(radius, around=48, along=24):
    """Points and triangles of a ball around the origin, its own mirror image in every plane through a meridian."""
    polar, turn = np.linspace(0.0, np.pi, along + 1)[1:-1], 2 * np.pi * np.arange(around) / around
    rings = [[np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)] for t in polar for p in turn]
    points = radius * np.array([[0.0, 0.0, 1.0], *rings, [0.0, 0.0, -1.0]])
    here, side = np.arange(around), np.roll(np.arange(around), -1)
    last = 1 + (along - 2) * around
    triangles = [np.column_stack([0 * here, 1 + here, 1 + side])]
    for start in range(1, last, around):
        a, b = start + here, start + side
        triangles += [np.column_stack([a, a + around, b]), np.column_stack([b, a + around, b + around])]
    triangles.append(np.column_stack([last + here, 0 * here + len(points) - 1, last + side]))
    return points, np.concatenate(triangles)


def box(low, high):
    """Points and triangles of a box."""
    points = np.array([[x, y, z] for z in (low[2], high[2]) for y in (low[1], high[1]) for x in (low[0], high[0])])
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return points, np.array([half for a, b, c, d in quads for half in ((a, b, c), (a, c, d))])
