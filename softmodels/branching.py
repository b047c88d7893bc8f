"""The branch that leaves a path at a bifurcation.

Where K is singular in a mode, the device can go on in two more ways, the path's shape with a little of the mode added or
taken away. The first state there is solved for with the amount of the mode given, which is regular a step away from the
bifurcation whatever pressure and volume do; from there arc lengths lead on, away from it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

from softmodels.equilibrium import NoConvergence, Tangent
from softmodels.loading import Path, PathEnd, Point

AMOUNTS = (0.05, 0.1, 0.02, 0.2, 0.01)
"""Amounts of the mode tried in turn for the first state: largest displacement in sizes of the device."""
MOST_POINTS = 60


def step_aside(path: Path, bifurcation: Point, sign: int = 1) -> Point:
    """The first state on the branch, with its tangent pointing away from the bifurcation.

    Args:
        path: The path that met it; its last points are replaced by the branch's.
        bifurcation: The point.
        sign: 1 or -1: which way along the mode. Where a symmetry of the device maps one to the other, both are the same.

    Raises:
        NoConvergence: No amount of the mode led to a state.
    """
    eq, stability = path.equilibrium, path.stability
    image, norm = stability.push(bifurcation.mode)
    image.scale(1 / norm)
    at = bifurcation.state
    for amount in AMOUNTS:
        guess = at.w + sign * amount * bifurcation.mode
        try:
            eq.factorise(dataclasses.replace(at, w=guess))
            state = eq.solve_along(image, at.w, sign * amount, guess, at.P)
        except NoConvergence as failure:
            path.report(f"no state with {amount:g} of the mode ({failure})")
            continue
        path.points = []
        path.line = "arc-length"
        eq.factorise(state)
        signature = stability.signature(exact=True)
        tangent = path.tangent(state)
        forward = sign * image.dot(_owned(eq, tangent)) > 0
        if not forward:
            tangent = Tangent(-tangent.w, -tangent.P, -tangent.V)
        point = dataclasses.replace(
            bifurcation, state=state, tangent=tangent, mode=None, line="arc-length", step=path.first_steps["arc-length"],
            factorised=True, age=eq.age, signature=signature, stiffest=abs(tangent.compliance),
        )  # fmt: skip
        return path.keep(point)
    raise NoConvergence("no state was found on the branch")


def follow(path: Path, bifurcation: Point, sign: int = 1, farthest: float = float("inf")) -> Iterator[Point]:
    """Follow the branch away from a bifurcation.

    Args:
        path: The path that met it; taken over.
        bifurcation: Where the branch begins.
        sign: Which way along the mode.
        farthest: Value of the path's quantity at which to end; so does a cavity that has grown or shrunk too far.

    Yields:
        The branch's points, limit points and further bifurcations among them; at most `MOST_POINTS`.
    """
    from softmodels.critical_points import events
    from softmodels.loading import FARTHEST

    try:
        yield step_aside(path, bifurcation, sign)
    except NoConvergence as failure:
        raise PathEnd(str(failure)) from failure
    for _ in range(MOST_POINTS):
        before = path.last
        after = path.advance(min(before.step, 0.5), float("inf"))
        for stop in [*events(path, before, after), after]:
            yield path.keep(dataclasses.replace(stop, step=after.step))
        value = path.value(after.state)
        if value >= farthest or value <= 0.0 or not 0.05 < after.state.V / path.V_scale < FARTHEST:
            return


def _owned(equilibrium, tangent: Tangent):  # type: ignore[no-untyped-def]
    vector = equilibrium.K.createVecRight()
    vector.array_w[:] = tangent.w[: equilibrium.n]
    return vector
