"""What ended a path where no step succeeds: whether the device is locked, snaps, or has broken down in a part of it.

Pressure and volume may turn back both at once: a small part of the device snaps, and hardly any air goes with it. Then no line
in their plane leads on, however short the step. The states beyond are still found where it is given how far that part has
gone, which is regular there, as near a bifurcation (`softmodels.path.branching`).
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.causes import Cause
from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.system import State
from softmodels.mechanics.tangent import Tangent
from softmodels.path.corrector import Corrector, Emptied
from softmodels.path.ends import EMPTIED, LOCKED, SNAPPED
from softmodels.path.modes import Mode
from softmodels.path.points import PathEnd, Point
from softmodels.path.quantities import AddedVolume, Followed, Plane, Quantity

Array = npt.NDArray[np.float64]

MOST_STATES = 24
"""States beyond the last one that are looked at."""
GROWTH = 1.5
"""From one step to the next."""
HALVINGS = 10
"""Of a step that fails."""
ASTRAY = 2.0
"""Length of a step over the foretold one, above which Newton's method has found another branch."""
TOLERANCE = 1e-10
"""Of the directions, relative: what they have beyond the whole's motion may be a thousandth of it."""
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
    try:
        return SNAPPED if snaps(corrector, requested) else None
    except NoConvergence:
        return None


def snaps(corrector: Corrector, requested: Quantity) -> bool:
    """Whether what is requested turns back just beyond a path's last point, where the device loses its stability.

    Args:
        corrector: Of the path; its factorisation is not kept.
        requested: What is requested.

    Raises:
        NoConvergence: There are no states near beyond it.
    """
    last, points = corrector.trail.last, corrector.trail.points
    value = requested.value(last.state.V, last.state.P)
    if len(points) < 2 or not requested.rate(last.state, last.tangent) > 0.0:  # the first point has come from nowhere
        return False
    ahead, fallen, unstable = Ahead(corrector), 0, _unstable(requested, last)
    for _ in range(MOST_STATES):
        ahead.step()
        now = requested.value(ahead.state.V, ahead.state.P)
        fallen = fallen + 1 if now < value else 0
        value = now
        if fallen == FALLING:
            # Where it only seems to turn back, as Newton's method has found another branch, nothing has become unstable.
            corrector.solver.factorise(ahead.state)
            signature = corrector.stability.signature(exact=True)
            beyond = dataclasses.replace(last, state=ahead.state, tangent=ahead.tangent, signature=signature)
            return _unstable(requested, beyond) != unstable
    return False


def _unstable(requested: Quantity, point: Point) -> int:
    """Directions in which a state falls to less energy while what is requested is kept; see `Point.stable_under`."""
    return point.signature.negative_eigenvalues - int(requested.rate(point.state, point.tangent) * point.tangent.P < 0)


class Ahead:
    """States beyond a path's last point, by how far the part that snaps has gone.

    The whole device moves on as it did before, and turns back with pressure and volume. What the motion has beyond that is
    the part's: it grows without bound as the path nears the state where it snaps, and leads on through it. It may be so little
    beside the whole that no measure of the whole shows it.

    Args:
        corrector: Of the path, with its last two points.

    Attributes:
        state: The last state found.
        tangent: Direction of the path there, its dofs of unit length.

    Raises:
        NoConvergence: The path has no direction there.
    """

    def __init__(self, corrector: Corrector):
        self.solver, self._mass = corrector.solver, corrector.stability.mass
        before, last = corrector.trail.points
        self._whole = self._direction(before.state, self._measure(before.tangent.w))
        self.state, self.tangent = last.state, self._direction(last.state, self._measure(last.tangent.w))
        self._amount = abs(self._part().share(last.state.w - before.state.w))

    def step(self) -> None:
        """Go on to the next state.

        Raises:
            NoConvergence: There is none near.
        """
        state, rate, part = self.state, self.tangent, self._part()
        for _ in range(HALVINGS):
            far = self._amount / part.share(rate.w)
            try:
                found = self.solver.solve_along(
                    part.image, state.w, self._amount, state.w + far * rate.w, state.P + far * rate.P
                )
                if (
                    self._measure(found.w - state.w).length < ASTRAY * far
                    and (self.solver.system.volumes() > 0.0).all()
                ):
                    self.state, self.tangent = found, self._direction(found, part)
                    self._amount *= GROWTH
                    return
            except NoConvergence:
                pass
            self._amount /= 2
            self.solver.factorise(state)
        raise NoConvergence("no state near beyond the last one")

    def _part(self) -> Mode:
        """What the motion has beyond that of the whole, as a measure of unit length."""
        whole, w = self._measure(self._whole.w), self.tangent.w
        beyond = w - whole.share(w) * self._whole.w
        length = self._measure(beyond).length
        if not length:
            raise NoConvergence("the whole device moves on as before")
        return self._measure(beyond / length)

    def _measure(self, w: Array) -> Mode:
        return Mode(self._mass, w)

    def _direction(self, state: State, along: Mode) -> Tangent:
        """The path's direction at a state, towards more of a measure, its dofs of unit length."""
        self.solver.factorise(state)
        rate = self.solver.tangent_along(state, along.image, TOLERANCE)
        length = self._measure(rate.w).length
        return Tangent(rate.w / length, rate.P / length, rate.V / length)
