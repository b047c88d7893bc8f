"""States of a design at its loads: solved along a path once, then carried from design to design."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import scipy.spatial

from softmodels.common.arrays import Array
from softmodels.design.loads import PRESSURE, VOLUME, JudgedLoad
from softmodels.design.trials import DesignFailure
from softmodels.mechanics.controls import pressure_control, volume_control
from softmodels.mechanics.mpi import on_root
from softmodels.mechanics.newton import NoConvergence
from softmodels.path.continuation import (
    QUICK,
    SLOW,
    Continuation,
    predict,
    trace,
)
from softmodels.path.points import AddedVolume, PathEnd
from softmodels.runs.grid import Grid, displacement_maps

if TYPE_CHECKING:
    from softmodels.design.body import DesignedBody
    from softmodels.design.gradients import Bifurcation, Bifurcations
    from softmodels.mechanics.controls import Tangent
    from softmodels.mechanics.system import State


# ----------------------------------------------------------------------------------------------------------------------
# Locate points in a mesh of curved cells, and interpolate there.


Numbers = npt.NDArray[np.int64]

EDGES = {2: ((0, 1), (1, 2), (0, 2)), 3: ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))}
"""Corners of each mid-edge node, in VTK's order, by dimension."""
NEAREST = 24
"""Number of nearest cells in which a point is searched."""
ITERATIONS = 6
"""Iterations of Newton's method for the position in a curved cell."""
OUTSIDE = 0.1
"""Maximum distance of a point outside its cell, in barycentric coordinates, because meshes of a curved wall differ."""


class Places:
    """Points in the cells of a mesh of order two.

    Args:
        nodes: Places of its nodes, shape (n, d).
        cells: Node numbers in VTK's order, shape (c, 6 or 10).
        points: Shape (m, d).

    Attributes:
        cell: The cell of each point, shape (m,).
        share: Its barycentric coordinates there, shape (m, d + 1).
    """

    def __init__(self, nodes: Array, cells: Numbers, points: Array):
        self.cells, d = cells, nodes.shape[1]
        self.edges = EDGES[d]
        corners = nodes[cells[:, : d + 1]]
        count = min(NEAREST, len(cells))
        _, near = scipy.spatial.cKDTree(corners.mean(axis=1)).query(points, count)
        near = near.reshape(len(points), count)
        frames = np.linalg.inv(np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2))
        inner = np.einsum("mkij,mkj->mki", frames[near], points[:, None] - corners[near, 0])
        shares = np.concatenate([1.0 - inner.sum(axis=2, keepdims=True), inner], axis=2)
        # Straight cells select the candidates for the curved cells' Newton steps.
        best = np.argsort(-shares.min(axis=2), axis=1)[:, :3]
        self.cell, self.share = near[:, 0], np.full((len(points), d + 1), -np.inf)
        for k in range(best.shape[1]):
            chosen = np.take_along_axis(near, best[:, k : k + 1], 1)[:, 0]
            straight = np.take_along_axis(shares, best[:, k, None, None], 1)[:, 0]
            share = self._curved(nodes[cells[chosen]], points, straight)
            better = share.min(axis=1) > self.share.min(axis=1)
            self.cell, self.share = np.where(better, chosen, self.cell), np.where(better[:, None], share, self.share)
        inside = np.maximum(self.share, -OUTSIDE)
        self.share = inside / inside.sum(axis=1, keepdims=True)

    def _curved(self, nodes: Array, points: Array, share: Array) -> Array:
        """Return the barycentric coordinates in curved cells, from those in straight ones; the straight ones if Newton's
        method diverges."""
        found = np.clip(share, -0.5, 1.5)
        found = found / found.sum(axis=1, keepdims=True)
        start = found
        for _ in range(ITERATIONS):
            gap = points - np.einsum("mn,mni->mi", self._shapes(found), nodes)
            slopes = np.einsum("mnk,mni->mik", self._slopes(found), nodes)  # by each coordinate as if independent
            jacobian = slopes[:, :, 1:] - slopes[:, :, :1]
            regular = np.abs(np.linalg.det(jacobian)) > 1e-12 * np.abs(jacobian).max(axis=(1, 2)) ** jacobian.shape[1]
            jacobian[~regular] = np.eye(jacobian.shape[1])
            step = np.clip(np.linalg.solve(jacobian, gap[..., None])[..., 0], -0.5, 0.5)
            found = found + np.concatenate([-step.sum(axis=1, keepdims=True), step], axis=1)
        astray = ~(np.abs(found - start).max(axis=1) < 1.0)
        return np.where(astray[:, None], start, found)

    def _shapes(self, share: Array) -> Array:
        """Return the nodes' shape functions, shape (m, nodes)."""
        edges = np.array(self.edges)
        return np.concatenate(
            [share * (2.0 * share - 1.0), 4.0 * share[:, edges[:, 0]] * share[:, edges[:, 1]]], axis=1
        )

    def _slopes(self, share: Array) -> Array:
        """Return their slopes by the barycentric coordinates, shape (m, nodes, d + 1)."""
        corners = share.shape[1]
        found = np.zeros((len(share), corners + len(self.edges), corners))
        for k in range(corners):
            found[:, k, k] = 4.0 * share[:, k] - 1.0
        for number, (one, other) in zip(itertools.count(corners), self.edges, strict=False):
            found[:, number, one], found[:, number, other] = 4.0 * share[:, other], 4.0 * share[:, one]
        return found

    def interpolated(self, values: Array, linear: bool = False) -> Array:
        """Return the values at the points, shape (m, k), of those at the nodes, shape (n, k); ``linear`` takes the corners'
        alone."""
        weights = self.share if linear else self._shapes(self.share)
        return np.einsum("mn,mnk->mk", weights, values[self.cells[self.cell][:, : weights.shape[1]]])


# ----------------------------------------------------------------------------------------------------------------------
# Transfer states between meshes of a device: interpolated on rank 0, as guesses for Newton's method.


class Transfer:
    """Interpolates unknowns between two meshes of the same device.

    Args:
        old: Where unknowns are known.
        new: Where they are wanted.

    Attributes:
        rest: Dimensionless volume of the undeformed cavity on the new mesh.
    """

    def __init__(self, old: DesignedBody, new: DesignedBody):
        from dolfinx import fem

        self.old, self.new = old.system, new.system
        self.rest = new.volume_at_rest()
        self._scale = self.old.length_unit / self.new.length_unit  # displacements are scaled by it, pressures are not
        self._from, self._to = Grid(self.old), Grid(self.new)
        self._known, self._wanted = (
            displacement_maps(*pair) for pair in ((self.old, self._from), (self.new, self._to))
        )
        self._w = fem.Function(self.new.space)
        self._places: list[Places] = []  # on rank 0
        on_root(self.new.comm, self._locate)

    def _locate(self) -> None:
        dimension = self._from.dimension
        kept = [0, 2] if dimension == 2 else [0, 1, 2]
        self._places.append(Places(self._from.points[:, kept], self._from.cells, self._to.points[:, kept]))

    def dofs(self, w: Array) -> Array:
        """Return the unknowns on the new mesh, with ghosts, of those on the old one; behind both come multipliers
        (`State.w`)."""
        x = self._w.x
        x.array[:] = 0.0
        columns, own = self._known[0][: self._from.owned], self._wanted[0][: self._to.owned]
        x.array[own] = self._scale * self._carried(w[columns], linear=False)
        known, wanted = self._known[1], self._wanted[1]
        if known is not None and wanted is not None:
            known, wanted = known[: self._from.owned], wanted[: self._to.owned]
            at_vertices = self._carried(np.where(known >= 0, w[known], 0.0), linear=True)
            x.array[wanted[wanted >= 0]] = at_vertices[wanted >= 0]
        x.scatter_forward()
        return np.concatenate([x.array, w[self.old.dofs :]])

    def _carried(self, values: Array, linear: bool) -> Array:
        """Return the values of owned nodes of the new mesh of those of the old one, shapes (owned, k)."""
        everywhere = self._from.collect(values)
        found = None if everywhere is None else self._places[0].interpolated(everywhere, linear)
        return self._to.distribute(found)

    def volume(self, V: float, rest: float) -> float:
        """Return a dimensionless volume on the new mesh, of one on the old mesh whose volume at rest is ``rest``."""
        return self.rest + (V - rest) * self._scale**3


# ----------------------------------------------------------------------------------------------------------------------
# States of one design as guesses for the next one, or for another mesh.


@dataclasses.dataclass(frozen=True, eq=False)
class LimitPoint:
    """A limit point of the pressure: the state, and the path's direction there, which is K's null vector."""

    state: State
    tangent: Tangent


@dataclasses.dataclass(frozen=True, eq=False)
class Known:
    """States of one design, as guesses for the next: values, never modified.

    Attributes:
        rest: Volume of its undeformed cavity.
        states: By load.
        limit: Its limit point, if there is one.
        witness: The state at the highest pressure, where there is none up to it.
        bifurcation: Its first bifurcation, if there is one.
    """

    rest: float
    states: dict[JudgedLoad, State]
    limit: LimitPoint | None
    witness: State | None
    bifurcation: Bifurcation | None

    def ahead(self, before: Known, share: float) -> Known:
        """Extrapolate linearly from an earlier design's states through these, by a share of
        their distance."""

        def state(here: State, there: State) -> State:
            w = here.w + share * (here.w - there.w)
            P, V = here.P + share * (here.P - there.P), here.V + share * (here.V - there.V)
            return dataclasses.replace(here, w=w, P=P, V=V)

        limit, witness = self.limit, self.witness
        if limit is not None and before.limit is not None:
            limit = LimitPoint(state(limit.state, before.limit.state), limit.tangent)
        if witness is not None and before.witness is not None:
            witness = state(witness, before.witness)
        states = {load: state(here, before.states[load]) for load, here in self.states.items()}
        return Known(self.rest + share * (self.rest - before.rest), states, limit, witness, self.bifurcation)

    def transferred(self, transfer: Transfer) -> Known:
        """Return the same on another mesh of the same device."""

        def state(known: State) -> State:
            return dataclasses.replace(known, w=transfer.dofs(known.w), V=transfer.volume(known.V, self.rest))

        limit, witness, fork = self.limit, self.witness, self.bifurcation
        if fork is not None:
            modes = tuple(transfer.dofs(mode) for mode in fork.modes)
            V = transfer.volume(fork.V, self.rest)
            fork = dataclasses.replace(fork, V=V, states=tuple(map(state, fork.states)), modes=modes)
        return Known(
            transfer.rest, {load: state(known) for load, known in self.states.items()},
            None if limit is None else LimitPoint(state(limit.state), limit.tangent),
            None if witness is None else state(witness), fork,
        )  # fmt: skip


MOST_SECANTS = 12
"""Maximum secant iterations to find the limit point on the next design."""
CLOSE = 1e-6
"""Relative tolerance of the volume at the limit point; its pressure is exact to the square."""
FIRST_STEP = 1e-3
"""First step of the secant, relative to the added volume."""
TIGHT = 1e-10
"""Tolerance of the linear solver for the path's tangent, the null vector used for derivatives."""
FIRST_SHARE, LARGEST_SHARE = 0.15, 0.5
"""First and largest step towards the limit point from a state below it, relative to the added volume."""
GROWTH = 1.4
"""Growth factor of the step if Newton's method converges quickly; it shrinks otherwise."""
REFUSED = 1 / 3
"""Reduction factor of a failed step. The following steps grow from there: near the sudden growth
of a bulge, one step that is too long costs as much as four good ones."""
MOST_NEWTON = 9
"""Newton iterations above which a shorter step is cheaper."""
MOST_STEPS = 80
"""Maximum number of steps from that state to the limit point."""
FARTHEST = 0.5
"""Maximum motion of the limit point between designs, relative to the added volume; otherwise it is searched
along the whole path."""


class WorkingStates:
    """States of a device at given loads, and its limit point if requested.

    Args:
        design: The meshed device.
        loads: Where it is judged.
        highest: Pressure in Pa up to which a limit point or a bifurcation is looked for; 0 for none.
        bifurcations: Finds the first bifurcation, if that is wanted.

    Attributes:
        states: By load, of the device that the mesh shows.
        limit: The limit point; None if there is none up to ``highest``, or none is looked for.
        bifurcation: The first bifurcation, likewise.
        newton: Newton iterations since it was last set to zero.
        carried: Whether the states follow from those of another design, and not along the path from the undeformed state.
    """

    def __init__(
        self,
        design: DesignedBody,
        loads: Sequence[JudgedLoad],
        highest: float = 0.0,
        bifurcations: Bifurcations | None = None,
    ):
        self.design, self.system, self.solver = design, design.system, design.solver
        self.loads, self.highest = tuple(loads), highest
        self.states: dict[JudgedLoad, State] = {}
        self.limit: LimitPoint | None = None
        self.bifurcation: Bifurcation | None = None
        self._bifurcations = bifurcations
        self._witness: State | None = None
        self.newton = 0
        self.carried = False
        self._rest_volume = 0.0

    # -- along the path -------------------------------------------------------------------------------------------------

    def trace(self) -> None:
        """Solve all states along paths from the undeformed state.

        Raises:
            DesignFailure: A load is not met.
        """
        self.states, self.limit, self.bifurcation, self._witness = {}, None, None, None
        self._rest_volume, self.carried = self.design.volume_at_rest(), False
        by_pressure = sorted(load for load in self.loads if load.kind == PRESSURE)
        self._trace_pressures(by_pressure)
        by_volume = sorted(load for load in self.loads if load.kind == VOLUME)
        if by_volume:
            self._trace_volumes(by_volume)

    def _trace_pressures(self, loads: Sequence[JudgedLoad]) -> None:
        unit = self.system.stress_unit
        wanted = [load.value / unit for load in loads]
        top, upwards = self.highest / unit, bool(loads) and self._bifurcations is None
        if top > 0.0 and not upwards and (not wanted or top > wanted[-1]):
            wanted.append(top)
        if not wanted:
            return
        met: list[State] = []
        limit = forked = None
        try:
            for point in trace(Continuation(self.solver), wanted):
                self.newton += point.state.iterations
                if point.limit and limit is None:
                    limit = point
                if point.bifurcation and forked is None:
                    forked = point
                if point.requested:
                    met.append(point.state)
                if limit is not None and (forked is not None or self._bifurcations is None):
                    break  # the path beyond is not needed, and would be most of the work
        except PathEnd as end:
            limit = limit or end.limit
            if len(met) < len(loads):
                raise self._failure(loads[len(met)], end) from end
        if limit is not None and len(met) < len(loads):
            raise self._limit_below(limit.state, loads[len(met)])
        self.states |= dict(zip(loads, met, strict=False))
        # If the path passes the highest pressure without a limit point, the state there is the start for later designs.
        self._witness = met[-1] if limit is None and len(met) > len(loads) else None
        try:
            if limit is not None and self.highest:
                self.limit = self._limit_near(limit.state, self._rest_volume)
            elif upwards and self.highest:
                self.limit, self._witness = self._upwards(met[-1], self._rest_volume)
            if forked is not None and forked.mode is not None and self._bifurcations is not None:
                state = forked.state
                self.bifurcation = self._bifurcations.near(state, state.V, forked.mode, self._rest_volume)
        except NoConvergence as failure:
            raise DesignFailure(f"the loss of stability was passed but not located: {failure}") from failure

    def _failure(self, load: JudgedLoad, end: PathEnd) -> DesignFailure:
        if end.limit is None:
            return DesignFailure(f"the path ends before {load}: {end}")
        return self._limit_below(end.limit.state, load)

    def _limit_below(self, limit: State, load: JudgedLoad) -> DesignFailure:
        pressure = limit.P * self.system.stress_unit
        return DesignFailure(f"the pressure has a limit point at {pressure / 1e3:.4g} kPa, before {load}", pressure)

    def _trace_volumes(self, loads: Sequence[JudgedLoad]) -> None:
        wanted = [load.value / self.system.volume_unit for load in loads]
        met: list[State] = []
        try:
            for point in trace(Continuation(self.solver, AddedVolume()), wanted):
                self.newton += point.state.iterations
                if point.requested:
                    met.append(point.state)
        except PathEnd as end:
            raise DesignFailure(f"the path ends before {loads[len(met)]}: {end}") from end
        self.states |= dict(zip(loads, met, strict=True))

    # -- from one design to the next ------------------------------------------------------------------------------------

    @property
    def known(self) -> Known:
        """The current states, to be restored or used as guesses."""
        return Known(self._rest_volume, self.states, self.limit, self._witness, self.bifurcation)

    @known.setter
    def known(self, known: Known) -> None:
        self._rest_volume, self.states, self.limit = known.rest, known.states, known.limit
        self._witness, self.bifurcation = known.witness, known.bifurcation

    def carry(self, guess: Known | None = None) -> None:
        """Solve all states for the device of the current mesh.

        Args:
            guess: Where to begin; those of the last design if None.

        Raises:
            NoConvergence: One of them was not found from there. Nothing has changed then.
            DesignFailure: The limit point lies below one of the loads now. Nothing has changed then.
        """
        guess, rest = guess or self.known, self.design.volume_at_rest()
        limit, witness = guess.limit, guess.witness
        highest = max((load for load in guess.states if load.kind == PRESSURE), default=None)
        upwards = highest is not None and self._bifurcations is None and (limit or witness) is not None
        if not upwards:  # the limit point first: above it no state exists
            limit = self._carried_limit(guess, rest)
        found = {load: self._solve(load, state, rest) for load, state in guess.states.items()}
        if upwards and highest is not None:
            limit, witness = self._upwards(found[highest], rest)
        elif witness is not None:
            witness = self._solve(JudgedLoad(PRESSURE, self.highest), witness, rest)
        forked = guess.bifurcation
        if forked is not None and self._bifurcations is not None:
            forked = self._bifurcations.near(forked.states[0], forked.V - guess.rest + rest, forked.mode, rest)
        self.known, self.carried = Known(rest, found, limit, witness, forked), True

    def _upwards(self, state: State, rest: float) -> tuple[LimitPoint | None, State | None]:
        """Find the limit point along the path from a state below it, or the state at the highest pressure.

        The last design's limit point is no guess to rely on: a bulge that grows all at once there grows elsewhere on the next.
        By secants from below, with their steps bounded, hardly a state behind the limit point has to be solved for.

        Raises:
            NoConvergence: The path could not be followed.
        """
        points, share = [self._on_path(state, state.V)], FIRST_SHARE
        step = share * (state.V - rest)
        for _ in range(MOST_STEPS):
            here = points[-1]
            try:
                there = self._on_path(here.state, here.state.V + step, points)
            except NoConvergence:
                step *= REFUSED
                share = abs(step) / (here.state.V - rest)
                continue
            if there.state.P * self.system.stress_unit >= self.highest:
                return None, self._solve(JudgedLoad(PRESSURE, self.highest), there.state, rest)
            rise, added = (there.tangent.P - here.tangent.P) / step, there.state.V - rest
            step = -there.tangent.P / rise if rise < 0.0 else np.inf
            if abs(step) < CLOSE * added:
                return there, None
            points = [here, there]
            count = there.state.iterations
            share = min(share * (GROWTH if count <= QUICK else 1.0 if count < SLOW else 0.6), LARGEST_SHARE)
            step = float(np.clip(step, -share * added, share * added))
        raise NoConvergence("the limit point was not located along the path")

    def _carried_limit(self, guess: Known, rest: float) -> LimitPoint | None:
        """Return the limit point of the current design, whose volume at rest is ``rest``; see `carry`."""
        if guess.limit is None:
            return None
        state = guess.limit.state
        limit = self._limit_near(dataclasses.replace(state, V=state.V - guess.rest + rest), rest)
        for load in sorted(guess.states):
            if load.kind == PRESSURE and load.value >= limit.state.P * self.system.stress_unit:
                raise self._limit_below(limit.state, load)
        return limit

    def _solve(self, load: JudgedLoad, guess: State, rest: float) -> State:
        system = self.system
        if load.kind == PRESSURE:
            state = self.solver.solve(pressure_control(load.value / system.stress_unit), guess.w, guess.P)
        else:
            state = self.solver.solve(volume_control(rest + load.value / system.volume_unit), guess.w, guess.P)
        self.newton += state.iterations
        return state

    def _limit_near(self, guess: State, rest: float) -> LimitPoint:
        """Return the limit point near a state, by the secant method on the slope of the pressure over the volume.

        Args:
            guess: The state.
            rest: Volume of the undeformed cavity.

        Raises:
            NoConvergence: It is not near.
        """
        added = guess.V - rest
        here = self._on_path(guess, guess.V)
        step = -FIRST_STEP * added  # backwards first: just beyond a limit point a bulge may grow suddenly
        for _ in range(MOST_SECANTS):
            try:
                there = self._on_path(here.state, here.state.V + step, [here])
            except NoConvergence:
                step /= 4
                continue
            rise = (there.tangent.P - here.tangent.P) / (there.state.V - here.state.V)
            if not rise:
                break
            here, step = there, -there.tangent.P / rise
            if abs(here.state.V + step - guess.V) > FARTHEST * added:
                break
            if abs(step) < CLOSE * added:
                if rise > 0.0:
                    break  # a minimum of the pressure
                return here
        raise NoConvergence("the limit point is not near that of the last design")

    def _on_path(self, guess: State, V: float, known: Sequence[LimitPoint] = ()) -> LimitPoint:
        """Return the state at a volume, and the path's direction there, for one unit of volume.

        Args:
            guess: Where Newton's method begins if nothing is known of the path.
            V: The volume.
            known: One or two points near by, from which the state is predicted.
        """
        line = volume_control(V)
        w, P = predict(known, line) if known else (guess.w, guess.P)
        state = self.solver.solve(line, w, P, most=MOST_NEWTON if known else None)
        self.newton += state.iterations
        try:
            return LimitPoint(state, self.solver.tangent(state, line, TIGHT))
        except NoConvergence:  # the lagged factorisation belongs to a state too far away
            self.solver.factorise(state)
            return LimitPoint(state, self.solver.tangent(state, line, TIGHT))
