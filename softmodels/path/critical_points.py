"""Where a path loses or regains stability: every change of the tangent's signature between two points, located.

Two things change the number of negative eigenvalues along a path. At a limit point the pressure turns and K's singular mode
is the path's own direction. At a bifurcation K is singular in a mode that leaves the volume as it is (q . mode = 0), the
path goes straight on, and another branch crosses it. A turn of the volume leaves K regular.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable

from softmodels.mechanics.newton import NoConvergence
from softmodels.path.corrector import Corrector
from softmodels.path.points import Point
from softmodels.path.quantities import Quantity
from softmodels.path.stability import Signature

Known = tuple[float, Point]
"""An eigenvalue and the state it belongs to."""

DEEPEST = 10
"""Halvings of an interval that holds several events; those closer together are told as one."""
SPREADS = (0.5, 0.2, 0.08)
"""Where the eigenvalue is asked for around its expected root, in shares of the way to the interval's farther end.

Not closer: a mesh without the device's symmetry bends the path towards the branch where K is nearly singular, and a state
near by would have a part of the mode and show the imperfect mesh's eigenvalue instead of the device's. The eigenvalue is a
smooth function of the volume, so what is left is interpolated."""
TOO_NEAR = 3e-3
"""Eigenvalue, in shares of the largest on the path at hand, below which a state is not used for the interpolation."""
SAMPLES = 4
"""States whose eigenvalues the interpolation uses."""


def unexplained(before: Point, after: Point) -> int:
    """Negative eigenvalues gained between two points beyond what turns of the pressure account for."""
    gained = after.signature.negative_eigenvalues - before.signature.negative_eigenvalues
    turned_P, turned_V = before.tangent.P * after.tangent.P < 0, before.tangent.V * after.tangent.V < 0
    if turned_P and turned_V:
        return 0 if abs(gained) == 1 else gained
    if turned_P:
        return gained - (int(after.tangent.compliance < 0) - int(before.tangent.compliance < 0))
    return gained


def events(
    corrector: Corrector, requested: Quantity, before: Point, after: Point, report: Callable[[str], None]
) -> list[Point]:
    """Limit points, of the pressure and of what is requested, and bifurcations between two neighbouring points, in order.

    The kept factorisation is that of ``after`` then: none of the states solved for in between leaves a trace in what
    follows, which a run that is gone on with could not follow.

    Args:
        corrector: Of the path, whose last point is ``before``.
        requested: What is requested of the path.
        before, after: The points.
        report: Takes a sentence on a bifurcation that cannot be located.
    """
    solver, stability = corrector.solver, corrector.stability
    kept = solver.kept.base, stability.modes
    found = changes(corrector, before, after, report)
    if turn := own_limit(corrector, requested, before, after):
        found = sorted([*turn, *found], key=lambda point: abs(point.state.V - before.state.V))
    if solver.kept.base is not kept[0] or stability.modes is not kept[1]:
        solver.factorise(after.state)
        stability.lowest()
    return found


def own_limit(corrector: Corrector, requested: Quantity, before: Point, after: Point) -> list[Point]:
    """The limit point of what is requested between two points, if it has one: of a stroke, where the gas goes on to push."""
    if not requested.has_limits or requested.slope(before) <= 0.0 or requested.slope(after) >= 0.0:
        return []
    return [dataclasses.replace(corrector.point(corrector.root(before, after, requested.slope)), turn=True)]


def limit(corrector: Corrector, before: Point, after: Point) -> Point:
    """The limit point of the pressure between two points, to about 1e-10 of the pressure."""
    state = corrector.root(before, after, lambda point: point.tangent.P / point.tangent.V)
    return corrector.point(state, limit=True)


def changes(
    corrector: Corrector, before: Point, after: Point, report: Callable[[str], None], depth: int = 0
) -> list[Point]:
    """Changes of the signature between two neighbouring points: limit points of the pressure and bifurcations, in order."""
    turned = before.tangent.P * after.tangent.P < 0
    gained = unexplained(before, after)
    if gained == 0:
        return [limit(corrector, before, after)] if turned else []
    if (turned or abs(gained) > 1) and depth < DEEPEST:
        try:
            middle = corrector.middle(before, after)
        except NoConvergence as failure:
            report(f"several changes of stability between two points could not be told apart ({failure})")
            return [limit(corrector, before, after)] if turned else []
        return [
            *changes(corrector, before, middle, report, depth + 1),
            *changes(corrector, middle, after, report, depth + 1),
        ]
    try:
        return [bifurcation(corrector, before, after)]
    except NoConvergence as failure:
        # The signature says that there is one; the next points' signatures go on saying so.
        report(f"a bifurcation between two points could not be located ({failure})")
        corrector.solver.factorise(after.state)
        return []


def bifurcation(corrector: Corrector, before: Point, after: Point) -> Point:
    """The bifurcation between two points: the root of the eigenvalue that changes its sign there.

    Raises:
        NoConvergence: No state in between could be solved for.
    """
    stability = corrector.stability
    # The negative eigenvalue nearest to zero is the one that has just changed its sign, or is about to.
    fewer, more = sorted((before, after), key=lambda point: point.signature.negative_eigenvalues)
    _, mode = stability.critical(more.state, fewer.signature.negative_eigenvalues)
    f_low, f_high = (stability.like(point.state, mode)[0] for point in (before, after))
    if f_low * f_high > 0:
        raise NoConvergence("the eigenvalue that changes its sign was not found")
    known = [(f_low, before), (f_high, after)]
    scale = max(stability.largest, abs(f_low), abs(f_high))
    start, width = before.state.V, after.state.V - before.state.V
    for spread in SPREADS:
        root = _root(known, scale)
        reach = max(abs(root - start), abs(root - after.state.V))
        for V in (root - spread * reach, root + spread * reach):
            corrector.solver.factorise(before.state)
            try:
                point = corrector.on_the_way(before, after, min(max((V - start) / width, -1.0), 2.0))
                known.append((stability.like(point.state, mode)[0], point))
            except NoConvergence:  # too near: K is singular there in every control
                continue
    low, high = _around(_far(known, scale))
    root = _root(known, scale)
    point = corrector.interpolated(low[1], high[1], (root - low[1].state.V) / (high[1].state.V - low[1].state.V))
    _, mode = stability.like(point.state, mode)
    lowest = stability.critical_lowest(
        point.state, min(before.signature.negative_eigenvalues, after.signature.negative_eigenvalues)
    )
    corrector.solver.factorise(after.state)  # the singular K just factorised is no preconditioner to go on with
    signature = Signature(before.signature.negative_eigenvalues, lowest)
    return dataclasses.replace(point, mode=mode, limit=False, requested=False, signature=signature, factorised=False)


def _root(known: list[Known], scale: float) -> float:
    """Volume at which the eigenvalue is zero, by the polynomial through the states around it that are far enough from it."""
    import scipy

    far = _far(known, scale)
    (_, low), (_, high) = _around(far)
    middle = (low.state.V + high.state.V) / 2
    used = sorted(far, key=lambda entry: abs(entry[1].state.V - middle))[:SAMPLES]
    through = scipy.interpolate.BarycentricInterpolator(
        [point.state.V for _, point in used], [value for value, _ in used]
    )
    return float(scipy.optimize.brentq(through, low.state.V, high.state.V, xtol=1e-13 * abs(middle)))


def _around(known: list[Known]) -> tuple[Known, Known]:
    """The neighbours between which the eigenvalue changes its sign."""
    return next((a, b) for a, b in itertools.pairwise(known) if a[0] * b[0] <= 0)


def _far(known: list[Known], scale: float) -> list[Known]:
    """Those states, by rising volume, that are far enough from the singular one; all, where they leave it on one side."""
    every = sorted(
        {point.state.V: (value, point) for value, point in known}.values(), key=lambda entry: entry[1].state.V
    )
    far = [entry for entry in every if abs(entry[0]) > TOO_NEAR * scale]
    return far if len({value > 0 for value, _ in far}) == 2 else every
