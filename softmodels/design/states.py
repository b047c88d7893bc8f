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
from softmodels.path.continuation import Continuation, trace
from softmodels.path.points import AddedVolume, PathEnd, Point
from softmodels.runs.grid import Grid, displacement_maps

if TYPE_CHECKING:
    from softmodels.design.body import DesignedBody
    from softmodels.design.gradients import Bifurcation, Bifurcations
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
class Known:
    """States of one design, as guesses for the next: values, never modified.

    Attributes:
        rest: Volume of its undeformed cavity.
        states: By load.
        limit: Its limit point, if there is one; no guess, because a bulge may grow elsewhere on the next design.
        bifurcation: Its first bifurcation, if there is one.
    """

    rest: float
    states: dict[JudgedLoad, State]
    limit: Point | None
    bifurcation: Bifurcation | None

    def ahead(self, before: Known, share: float) -> Known:
        """Extrapolate linearly from an earlier design's states through these, by a share of
        their distance."""

        def state(here: State, there: State) -> State:
            w = here.w + share * (here.w - there.w)
            P, V = here.P + share * (here.P - there.P), here.V + share * (here.V - there.V)
            return dataclasses.replace(here, w=w, P=P, V=V)

        states = {load: state(here, before.states[load]) for load, here in self.states.items()}
        return Known(self.rest + share * (self.rest - before.rest), states, None, self.bifurcation)

    def transferred(self, transfer: Transfer) -> Known:
        """Return the same on another mesh of the same device."""

        def state(known: State) -> State:
            return dataclasses.replace(known, w=transfer.dofs(known.w), V=transfer.volume(known.V, self.rest))

        fork = self.bifurcation
        if fork is not None:
            modes = tuple(transfer.dofs(mode) for mode in fork.modes)
            V = transfer.volume(fork.V, self.rest)
            fork = dataclasses.replace(fork, V=V, states=tuple(map(state, fork.states)), modes=modes)
        return Known(transfer.rest, {load: state(known) for load, known in self.states.items()}, None, fork)


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
        self.limit: Point | None = None
        self.bifurcation: Bifurcation | None = None
        self._bifurcations = bifurcations
        self.newton = 0
        self.carried = False
        self._rest_volume = 0.0

    # -- along the path -------------------------------------------------------------------------------------------------

    def trace(self) -> None:
        """Solve all states along paths from the undeformed state.

        Raises:
            DesignFailure: A load is not met.
        """
        self.states, self.limit, self.bifurcation = {}, None, None
        self._rest_volume, self.carried = self.design.volume_at_rest(), False
        by_pressure = sorted(load for load in self.loads if load.kind == PRESSURE)
        self._trace_pressures(by_pressure)
        by_volume = sorted(load for load in self.loads if load.kind == VOLUME)
        if by_volume:
            self._trace_volumes(by_volume)

    def _trace_pressures(self, loads: Sequence[JudgedLoad]) -> None:
        wanted = [load.value / self.system.stress_unit for load in loads]
        wanted += self._top(wanted)
        if not wanted:
            return
        met, self.limit, forked, end = self._climb(wanted)
        self.states |= dict(zip(loads, met, strict=False))
        if len(met) < len(loads):
            load = loads[len(met)]
            if self.limit is None:
                raise DesignFailure(f"the path ends before {load}: {end}")
            limit = self.limit.state.P * self.system.stress_unit
            raise DesignFailure(f"the pressure has a limit point at {limit / 1e3:.4g} kPa, before {load}", limit)
        if end is not None and self.limit is None and forked is None:
            raise DesignFailure(f"the path ends before {self.highest / 1e3:.4g} kPa: {end}")
        if forked is not None and forked.mode is not None and self._bifurcations is not None:
            state = forked.state
            try:
                self.bifurcation = self._bifurcations.near(state, state.V, forked.mode, self._rest_volume)
            except NoConvergence as failure:
                raise DesignFailure(f"the bifurcation was passed but not located: {failure}") from failure

    def _top(self, pressures: Sequence[float]) -> list[float]:
        """Return the dimensionless pressure up to which a limit point is looked for, if it is above these."""
        top = self.highest / self.system.stress_unit
        return [top] if top > max(pressures, default=0.0) else []

    def _climb(
        self, goals: Sequence[float], start: State | None = None
    ) -> tuple[list[State], Point | None, Point | None, PathEnd | None]:
        """Follow the path through pressures, up to its first limit point, and from rest up to its first bifurcation if wanted.

        Returns:
            The states met, the limit point, the bifurcation, and what ended the path before the last goal.
        """
        met: list[State] = []
        limit = forked = end = None
        # Near the limit point steps of the volume converge, where several steps of the pressure may fail.
        control = "auto" if start is None else AddedVolume.name
        try:
            for point in trace(Continuation(self.solver, control=control, start=start), goals):
                self.newton += point.state.iterations
                limit = point if point.limit and limit is None else limit
                forked = point if point.bifurcation and forked is None else forked
                if point.requested:
                    met.append(point.state)
                if limit is not None and (forked is not None or self._bifurcations is None or start is not None):
                    break  # the path beyond is not needed, and would be most of the work
        except PathEnd as failure:
            end = failure
        return met, limit, forked, end

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
        return Known(self._rest_volume, self.states, self.limit, self.bifurcation)

    @known.setter
    def known(self, known: Known) -> None:
        self._rest_volume, self.states = known.rest, known.states
        self.limit, self.bifurcation = known.limit, known.bifurcation

    def carry(self, guess: Known | None = None) -> None:
        """Solve all states for the device of the current mesh.

        Args:
            guess: Where to begin; those of the last design if None.

        Raises:
            NoConvergence: One of them was not found from there. Nothing has changed then.
        """
        guess, rest = guess or self.known, self.design.volume_at_rest()
        found = {load: self._solve(load, state, rest) for load, state in guess.states.items()}
        by_pressure = [found[load] for load in sorted(found) if load.kind == PRESSURE]
        limit = None
        if top := self._top([state.P for state in by_pressure]):
            _, limit, _, end = self._climb(top, by_pressure[-1] if by_pressure else None)
            if end is not None and limit is None:
                raise NoConvergence(str(end))
        forked = guess.bifurcation
        if forked is not None and self._bifurcations is not None:
            forked = self._bifurcations.near(forked.states[0], forked.V - guess.rest + rest, forked.mode, rest)
        self.known, self.carried = Known(rest, found, limit, forked), True

    def _solve(self, load: JudgedLoad, guess: State, rest: float) -> State:
        system = self.system
        if load.kind == PRESSURE:
            state = self.solver.solve(pressure_control(load.value / system.stress_unit), guess.w, guess.P)
        else:
            state = self.solver.solve(volume_control(rest + load.value / system.volume_unit), guess.w, guess.P)
        self.newton += state.iterations
        return state
