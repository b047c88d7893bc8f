"""What ended a path where no step succeeds: whether the device is locked, snaps, or has broken down in a part of it.

Pressure and volume may turn back both at once: a small part of the device snaps, and hardly any air goes with it. Then no line
in their plane leads on, however short the step. The states beyond are still found where it is given how far that part has
gone, which is regular there, as near a bifurcation (`softmodels.path.branching`).
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.causes import Cause
from softmodels.mechanics.mpi import largest, total
from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.system import State, System
from softmodels.mechanics.tangent import Tangent
from softmodels.path.corrector import Corrector, Emptied
from softmodels.path.ends import EMPTIED, LOCKED, SNAPPED, folded
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
FEW = (6.0, 0.1)
"""Cells that take part in a motion, and share of all, up to which it is a fold of the mesh."""
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
        part = snapping(corrector, requested)
    except NoConvergence:
        return None
    if part is None:
        return None
    fold = Concentration(system, part)
    return folded(fold.cells, *fold.place) if fold.local else SNAPPED


def snapping(corrector: Corrector, requested: Quantity) -> Array | None:
    """The motion of what snaps, local dofs, if what is requested turns back just beyond a path's last point; else None.

    It does where the device loses its stability there.

    Args:
        corrector: Of the path; its factorisation is not kept.
        requested: What is requested.

    Raises:
        NoConvergence: There are no states near beyond it.
    """
    last, points = corrector.trail.last, corrector.trail.points
    value = requested.value(last.state.V, last.state.P)
    if len(points) < 2 or not requested.rate(last.state, last.tangent) > 0.0:  # the first point has come from nowhere
        return None
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
            return ahead.part if _unstable(requested, beyond) != unstable else None
    return None


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

    @property
    def part(self) -> Array:
        """What the motion has beyond that of the whole, local dofs."""
        whole, w = self._measure(self._whole.w), self.tangent.w
        return np.asarray(w - whole.share(w) * self._whole.w)

    def _part(self) -> Mode:
        """The same as a measure of unit length."""
        beyond = self.part
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


class Concentration:
    """In how many cells a motion is, by the squares of its gradient: a fold hardly moves the rest, but carries it along.

    Args:
        system: The equations; w is overwritten.
        shape: Local dofs, shape as `State.w`.

    Attributes:
        cells: (sum e)^2 / sum e^2 of the cells' integrals e: 1 where one has all of it, all of them where all have as much.
    """

    def __init__(self, system: System, shape: Array):
        import ufl
        from dolfinx import fem

        self.system, body = system, system.body
        system.w.x.array[:] = shape[: system.dofs]
        test = ufl.TestFunction(fem.functionspace(body.mesh, ("DG", 0)))
        slope = body.deformation_gradient(system.potential.displacement) - ufl.Identity(3)
        form = system.form(ufl.inner(slope, slope) * test * body.hoop * body.measures()[0])
        self._shares = fem.assemble_vector(form).array[: len(system.cells)]
        whole, squares = (total(system.comm, float((self._shares**k).sum())) for k in (1, 2))
        self.cells = whole**2 / squares if squares else math.inf

    @property
    def local(self) -> bool:
        """Whether it is in a few cells, of many."""
        return self.cells <= min(FEW[0], FEW[1] * total(self.system.comm, float(len(self.system.cells))))

    @property
    def place(self) -> tuple[str, str]:
        """Undeformed middle of the cell with most of it, in mm, and the faces that it is at: the same on all ranks."""
        from dolfinx import mesh as meshes

        system, body = self.system, self.system.body
        mesh, comm = body.mesh, system.comm
        mine = int(self._shares.argmax()) if len(self._shares) else 0
        best = float(self._shares[mine]) if len(self._shares) else -math.inf
        found = ("", "")
        if best == largest(comm, best):
            middle = (
                meshes.compute_midpoints(mesh, mesh.topology.dim, np.array([mine], dtype=np.int32)) * system.length_unit
            )
            place = body.actuator.device_points(middle)[0] * 1e3
            corners = set(mesh.topology.connectivity(mesh.topology.dim, 0).links(mine).tolist())
            cut = {plane.name for plane in body.actuator.cut_planes} | {"axis"}
            faces = [
                role
                for role, (dimension, entities) in body.entities.items()
                if dimension == mesh.topology.dim - 1 and role not in cut and self._touches(entities, corners)
            ]
            found = (
                f"({', '.join(f'{x:.4g}' for x in place)}) mm",
                f", where it is at {' and '.join(faces)}" if faces else "",
            )
        else:
            mesh.topology.create_connectivity(mesh.topology.dim - 1, 0)
        return next(one for one in comm.allgather(found) if one[0])

    def _touches(self, entities: npt.NDArray[np.int32], corners: set[int]) -> bool:
        topology = self.system.body.mesh.topology
        topology.create_connectivity(topology.dim - 1, 0)
        links = topology.connectivity(topology.dim - 1, 0).links
        return any(not corners.isdisjoint(links(facet).tolist()) for facet in entities)
