"""Round arms that bend out of the plane, seen by two cameras square to each other. Shares no code with the reader of
photographs; the tip is known in closed form."""

from __future__ import annotations

import numpy as np
import pyvista as pv

from tests.support import side_views

LENGTH, RADIUS = 0.08, 0.005
BASE = side_views.to_pixels([[0.0, RADIUS], [0.0, -RADIUS]])
ABOVE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""The first camera's coordinates of what the one above sees: to the right, away from it, upwards in its picture."""


def arm(turn, azimuth, length=LENGTH, radius=RADIUS):
    """An arm from x = 0 with a hemisphere at its end, bent by ``turn`` rad in a plane through the x axis that is turned by
    ``azimuth`` rad from that of x and -z towards y. Returns its surface and its tip (3,) in m."""
    s = np.linspace(0.0, length - radius, 200)
    bend = turn / length
    out = np.array([0.0, np.sin(azimuth), -np.cos(azimuth)])
    ahead, aside = s * np.sinc(bend * s / np.pi), s * np.sin(bend * s / 2) * np.sinc(bend * s / 2 / np.pi)
    line = np.outer(ahead, [1.0, 0.0, 0.0]) + np.outer(aside, out)
    way = np.outer(np.cos(bend * s), [1.0, 0.0, 0.0]) + np.outer(np.sin(bend * s), out)
    angle, rings = np.linspace(0.0, 2.0 * np.pi, 181)[:-1], []
    across = np.cross([1.0, 0.0, 0.0], out)
    wide = np.full(len(s), radius)
    cap = np.linspace(0.0, np.pi / 2, 60)[1:]  # the hemisphere, ring by ring
    line = np.vstack([[-side_views.CLAMP, 0.0, 0.0], line, line[-1] + radius * np.sin(cap)[:, None] * way[-1]])
    wide = np.r_[radius, wide, np.maximum(radius * np.cos(cap), 1e-7)]
    way = np.vstack([way[0], way, np.tile(way[-1], (len(cap), 1))])
    for place, along, half in zip(line, way, wide, strict=True):
        up = np.cross(across, along)
        rings.append(place + half * (np.cos(angle)[:, None] * up + np.sin(angle)[:, None] * across))
    count, low = len(angle), (np.arange(len(line) - 1)[:, None] * len(angle) + np.arange(len(angle))).ravel()
    right = (np.arange(len(line) - 1)[:, None] * count + (np.arange(count) + 1) % count).ravel()
    faces = np.column_stack([np.full(len(low), 4), low, right, right + count, low + count])
    return pv.PolyData(np.vstack(rings), faces.ravel()), line[-1]


def photographs(folder, turns, azimuth, seed=0, **how):
    """Write photographs of an arm at turns from the side and from above; returns the names of both, and the tips (n, 3)."""
    names, tips = ([], []), []
    for number, turn in enumerate(turns):
        surface, tip = arm(turn, azimuth, **how)
        for view, turned in enumerate((np.eye(3), ABOVE)):
            seen = surface.copy()
            seen.points = surface.points @ turned.T
            names[view].append(folder / f"{'side' if view == 0 else 'above'}-{number}.png")
            side_views.photograph(names[view][-1], seen, seed=seed + 2 * number + view)
        tips.append(tip)
    return names, np.array(tips)
