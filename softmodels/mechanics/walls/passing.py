"""Does a point go through a wall on its way from one shape to another?"""

from __future__ import annotations

import itertools
import math

import numpy as np

from softmodels.mechanics.walls.pairs import Pairs
from softmodels.mechanics.walls.surface import Array

DEEPEST = 0.3
"""Depth in radii of the kernel at which a state is refused: a wall is seen up to a radius behind it, and then no more."""
OWN = 0.4
"""Distance aside from a sample, in edges of its facet, that is its own part of the wall; samples are as far apart."""
STRIDE = 2.0
"""Radii that points and walls move against each other between two looks."""
MOST_LOOKS = 60


def passes(pairs: Pairs, before: Array, after: Array) -> bool:
    """Whether a point gets deeper than `DEEPEST` behind a wall on straight ways between two shapes.

    A point that has jumped over a wall is nowhere near it any more and would feel nothing.

    Args:
        pairs: The walls and their search.
        before, after: Places of the nodes, shape (n, d).
    """
    surface = pairs.surface
    start, end = surface.places(before), surface.places(after)
    motion = end - start
    relative = 2 * float(np.linalg.norm(motion - motion.mean(axis=0), axis=1).max())
    stride = STRIDE * float(pairs.radius.min())
    looks = min(max(math.ceil(relative / stride), 1), MOST_LOOKS)
    times = np.linspace(0.0, 1.0, looks + 1)
    for low, high in itertools.pairwise(times):
        shapes = [before + t * (after - before) for t in (low, high)]
        if _deeper(pairs, shapes, relative / looks / 2):
            return True
    return False


def _deeper(pairs: Pairs, shapes: list[Array], slack: float) -> bool:
    """Whether a point crosses the surface at `DEEPEST` behind a sample's own part of a wall between two near shapes."""
    surface, count = pairs.surface, len(pairs.surface.owner)
    (a, b), (m, n) = ([surface.places(x) for x in shapes], [pairs.of_all(surface.areas(x)) for x in shapes])
    i, j = pairs.within((a + b) / 2, slack + (DEEPEST + OWN) * float(pairs.radius.max()))
    start, end = a[i] - pairs.of_all(a)[j], b[i] - pairs.of_all(b)[j]
    limit = -DEEPEST * pairs.radius[j % count]
    above = [np.einsum("pi,pi->p", r, v[j]) / np.linalg.norm(v[j], axis=1) for r, v in ((start, m), (end, n))]
    crossed = (above[0] > limit) & (above[1] <= limit)
    i, j, start, end, limit = i[crossed], j[crossed], start[crossed], end[crossed], limit[crossed]
    high, low = above[0][crossed], above[1][crossed]
    t = ((high - limit) / (high - low))[:, None]
    place = start + t * (end - start)
    aside = np.sqrt(np.maximum(np.einsum("pi,pi->p", place, place) - limit**2, 0.0))
    own = aside < OWN * surface.edges[j % count]
    return bool(own.any())
