"""Where a path loses or regains stability: every change of the tangent's signature between two points, located.

Two things change the number of falling directions along a path. At a limit point the pressure turns and K's singular mode
is the path's own direction. At a bifurcation K is singular in a mode that leaves the volume as it is (q . mode = 0), the
path goes straight on, and another branch crosses it. A turn of the volume leaves K regular.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

from softmodels.equilibrium import NoConvergence
from softmodels.stability import Signature

if TYPE_CHECKING:
    from softmodels.loading import Path, Point

DEEPEST = 10
"""Halvings of an interval that holds several events; those closer together are told as one."""
SPREADS = (0.5, 0.2, 0.08)
"""Where the eigenvalue is asked for around its expected root, in shares of the way to the interval's farther end.

Not closer: a mesh without the device's symmetry bends the path towards the branch where K is nearly singular, and a state
near by would have a part of the mode and show the imperfect mesh's eigenvalue instead of the device's. The eigenvalue is a
smooth function of the volume, so what is left is interpolated."""
TOO_NEAR = 3e-3
"""Eigenvalue, in shares of the largest on the path at hand, below which a state is not used for the interpolation."""
OUTSIDE = 0.1
"""How far outside the interval the interpolated root may lie, in shares of the interval."""
SAMPLES = 4
"""States whose eigenvalues the interpolation uses."""


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
    try:
        return [bifurcation(path, before, after)]
    except NoConvergence as failure:
        # The signature says that there is one; the next points' signatures go on saying so.
        path.report(f"a bifurcation between two points could not be located ({failure})")
        path.equilibrium.factorise(after.state)
        return []


def bifurcation(path: Path, before: Point, after: Point) -> Point:
    """The bifurcation between two points: the root of the eigenvalue that changes its sign there.

    Raises:
        NoConvergence: No state in between could be solved for.
    """
    stability = path.stability
    index = min(before.signature.excess, after.signature.excess)
    f_low, mode = stability.critical(before.state, index)
    f_high, _ = stability.critical(after.state, index)
    if f_low * f_high > 0:
        raise NoConvergence("the eigenvalue that changes its sign was not found")
    known = [(f_low, before), (f_high, after)]
    start, width = before.state.V, after.state.V - before.state.V
    for spread in SPREADS:
        root = _root(known, stability.largest)
        reach = max(abs(root - start), abs(root - after.state.V))
        for V in (root - spread * reach, root + spread * reach):
            path.equilibrium.factorise(before.state)
            try:
                point = path.on_the_way(before, after, min(max((V - start) / width, -1.0), 2.0))
                known.append((stability.critical(point.state, index)[0], point))
            except NoConvergence:  # too near: K is singular there in every control
                continue
    root = _root(known, stability.largest)
    far = _far(known, stability.largest)
    low, high = (_nearest([p for value, p in far if value * f > 0] or [end], root)
                 for f, end in ((f_low, before), (f_high, after)))  # fmt: skip
    near, beyond = sorted((start - OUTSIDE * width, after.state.V + OUTSIDE * width))
    if not near <= root <= beyond or low.state.V == high.state.V:
        raise NoConvergence("its eigenvalue is no smooth function of the volume there")
    point = path.in_between(low, high, min(max((root - low.state.V) / (high.state.V - low.state.V), 0.0), 1.0))
    value, mode = stability.critical(point.state, index)
    path.equilibrium.factorise(after.state)  # the singular K just factorised is no preconditioner to go on with
    signature = Signature(before.signature.excess, value)
    return dataclasses.replace(point, mode=mode, limit=False, requested=False, signature=signature, factorised=False)


def _root(known: list[tuple[float, Point]], scale: float) -> float:
    """Volume at which the eigenvalue is zero: Lagrange's polynomial of the volume over it, through the nearest states."""
    used = sorted(_far(known, scale), key=lambda entry: abs(entry[0]))[:SAMPLES]
    return sum(
        point.state.V * math.prod(other / (other - value) for other, _ in used if other != value)
        for value, point in used
    )


def _far(known: list[tuple[float, Point]], scale: float) -> list[tuple[float, Point]]:
    """Those states that are far enough from the singular one; all, where hardly any is."""
    far = [entry for entry in known if abs(entry[0]) > TOO_NEAR * scale]
    return far if len(far) > 1 else known


def _nearest(points: list[Point], V: float) -> Point:
    return min(points, key=lambda point: abs(point.state.V - V))
