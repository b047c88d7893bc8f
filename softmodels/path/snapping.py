"""What ended a path where no step succeeds: whether the device is locked, snaps, or has broken down in a part of it.

Pressure and volume may turn back both at once: a small part of the device snaps, and hardly any air goes with it. Then no line
in their plane leads on, however short the step. The states beyond are still found where it is given how far the device has
gone along its own motion, which is regular there, as near a bifurcation (`softmodels.path.branching`).
"""

from __future__ import annotations

import dataclasses

from softmodels.mechanics.causes import Cause
from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.solver import Solver, Tangent
from softmodels.mechanics.system import State
from softmodels.path.corrector import Corrector, Emptied
from softmodels.path.ends import EMPTIED, LOCKED, SNAPPED
from softmodels.path.modes import Mode
from softmodels.path.points import PathEnd, Point
from softmodels.path.quantities import AddedVolume, Followed, Plane, Quantity

MOST_STATES = 24
"""States beyond the last one that are looked at."""
GROWTH = 1.5
"""From one step to the next."""
HALVINGS = 10
"""Of a step that fails."""
ASTRAY = 2.0
"""Length of a step over what it was asked to go along the motion, above which Newton's method has found another branch."""
FALLING = 2
"""States in a row with less than the one before, from which what is requested has turned back."""


def check_yields(first: Point, plane: Plane, *followed: Followed) -> None:
    """Raise the `PathEnd` of a path that has to follow a volume, or a travel, which nothing changes.

    Args:
        first: Its first point.
        plane: Its scales.
        followed: What is requested of it and what it follows.
    """
    if first.stiffest <= plane.felt(0.0) and any(isinstance(one, AddedVolume) for one in followed):
        raise PathEnd("nothing gives way", cause=LOCKED)


def lost(corrector: Corrector, requested: Quantity, why: str, failure: NoConvergence) -> PathEnd:
    """The end of a path that could not be followed from its last point, with its cause if that is the device's own.

    Args:
        corrector: Of the path; its factorisation is not kept.
        requested: What is requested.
        why: A clause.
        failure: What the solver reported.
    """
    return PathEnd(f"{why} ({failure})", cause=_cause_of(corrector, requested, failure))


def _cause_of(corrector: Corrector, requested: Quantity, failure: NoConvergence) -> Cause | None:
    if isinstance(failure, Emptied):
        return EMPTIED
    system = corrector.solver.system
    system.load(corrector.trail.last.state)
    for term in system.potential.terms.values():
        if cause := term.breakdown(system):
            return cause
    return SNAPPED if snaps(corrector, requested) else None


def snaps(corrector: Corrector, requested: Quantity) -> bool:
    """Whether what is requested turns back just beyond a path's last point, where the device loses its stability.

    Args:
        corrector: Of the path; its factorisation is not kept.
        requested: What is requested.
    """
    last, solver = corrector.trail.last, corrector.solver
    state, rate, value = last.state, last.tangent, requested.value(last.state.V, last.state.P)
    if not requested.rate(state, rate) > 0.0:
        return False
    unstable = _unstable(requested, last)
    step, fallen = _first_step(corrector), 0
    for _ in range(MOST_STATES):
        found = _ahead(corrector, state, rate, step)
        if found is None:
            return False
        step, after = found
        now = requested.value(after.V, after.P)
        fallen = fallen + 1 if now < value else 0
        rate = Tangent((after.w - state.w) / step, (after.P - state.P) / step, (after.V - state.V) / step)
        state, value, step = after, now, GROWTH * step
        solver.factorise(state)
        if fallen == FALLING:
            # Where it only seems to turn back, as Newton's method has found another branch, nothing has become unstable.
            signature = corrector.stability.signature(exact=True)
            return (
                _unstable(requested, dataclasses.replace(last, state=state, tangent=rate, signature=signature))
                != unstable
            )
    return False


def _unstable(requested: Quantity, point: Point) -> int:
    """Directions in which a state falls to less energy while what is requested is kept; see `Point.stable_under`."""
    return point.signature.negative_eigenvalues - int(requested.rate(point.state, point.tangent) * point.tangent.P < 0)


def _first_step(corrector: Corrector) -> float:
    """About as far as the path's last step was to go, in units of its tangent."""
    points, last = corrector.trail.points, corrector.trail.last
    plane = corrector.plane.stiffened(last.stiffest)
    rate, before = (last.tangent.V, last.tangent.P), points[0].state
    move = (last.state.V - before.V, last.state.P - before.P)
    return (plane.product(move, move) / plane.product(rate, rate)) ** 0.5


def _ahead(corrector: Corrector, state: State, rate: Tangent, step: float) -> tuple[float, State] | None:
    """The state ``step`` further along a motion, or nearer, with the step that was taken; None if there is none near."""
    solver: Solver = corrector.solver
    motion = Mode(corrector.stability.mass, rate.w)
    for _ in range(HALVINGS if step else 0):  # a path's first point has come from nowhere
        try:
            found = solver.solve_along(motion.image, state.w, step, state.w + step * rate.w, state.P + step * rate.P)
            if motion.size(found.w - state.w) < ASTRAY * step and (solver.system.volumes() > 0.0).all():
                return step, found
        except NoConvergence:
            pass
        step /= 2
        solver.factorise(state)
    return None
