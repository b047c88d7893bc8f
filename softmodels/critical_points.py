"""Where a path loses or regains stability: every change of the tangent's signature between two points, located.

Two things change the number of falling directions along a path. At a limit point the pressure turns and K's singular mode
is the path's own direction. At a bifurcation K is singular in a mode that leaves the volume as it is (q . mode = 0), the
path goes straight on, and another branch crosses it. A turn of the volume leaves K regular.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from softmodels.equilibrium import NoConvergence
from softmodels.stability import Signature

if TYPE_CHECKING:
    from softmodels.loading import Path, Point

DEEPEST = 10
"""Halvings of an interval that holds several events; those closer together are told as one."""
NEAR_ZERO = 1e-7
"""Eigenvalue at a located bifurcation, in shares of those at the interval's ends."""


def unexplained(before: Point, after: Point) -> int:
    """Falling directions gained between two points beyond what turns of the pressure account for."""
    gained = after.signature.excess - before.signature.excess
    turned_P, turned_V = before.tangent.P * after.tangent.P < 0, before.tangent.V * after.tangent.V < 0
    if turned_P and turned_V:
        return 0 if abs(gained) == 1 else gained
    if turned_P:
        return gained - (int(after.tangent.compliance < 0) - int(before.tangent.compliance < 0))
    return gained


def events(path: Path, before: Point, after: Point, depth: int = 0) -> list[Point]:
    """Limit points and bifurcations between two neighbouring points of a path, in order."""
    turned = before.tangent.P * after.tangent.P < 0
    gained = unexplained(before, after)
    if gained == 0:
        return [path.limit(before, after)] if turned else []
    if (turned or abs(gained) > 1) and depth < DEEPEST:
        middle = path.middle(before, after)
        return [*events(path, before, middle, depth + 1), *events(path, middle, after, depth + 1)]
    return [bifurcation(path, before, after)]


def bifurcation(path: Path, before: Point, after: Point) -> Point:
    """The bifurcation between two points: the root of the eigenvalue that changes its sign there.

    Raises:
        NoConvergence: No state in between could be solved for.
    """
    stability = path.stability
    index = min(before.signature.excess, after.signature.excess)
    f_low, mode = stability.critical(before.state, index)
    f_high, _ = stability.critical(after.state, index)
    low, high, scale = before, after, max(abs(f_low), abs(f_high))
    if f_low * f_high > 0:
        raise NoConvergence("the eigenvalue that changes its sign was not found")
    best, value, side = before, f_low, 0
    for _ in range(25):
        share = f_low / (f_low - f_high)
        share = min(max(share, 0.02), 0.98)  # Illinois' variant of the secant, kept off the ends
        best = path.on_the_way(low, high, share)
        value, mode = stability.critical(best.state, index)
        if abs(value) <= NEAR_ZERO * scale or abs(high.state.V - low.state.V) <= 1e-10 * path.V0:
            break
        if (value > 0) == (f_high > 0):
            high, f_high = best, value
            f_low /= 2 if side == 1 else 1
            side = 1
        else:
            low, f_low = best, value
            f_high /= 2 if side == -1 else 1
            side = -1
    path.equilibrium.factorise(after.state)  # the singular K just factorised is no preconditioner to go on with
    signature = Signature(before.signature.excess, value)
    return dataclasses.replace(best, mode=mode, limit=False, requested=False, signature=signature, factorised=False)
