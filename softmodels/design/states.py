"""States of a design at its loads, carried from design to design, and adjoint gradients of quantities there."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import scipy.spatial

from softmodels.common.arrays import Array
from softmodels.common.lazy import fem, ufl
from softmodels.design import quantities, trials
from softmodels.mechanics import assembly, component, controls, mpi, newton, sensitivity
from softmodels.path import continuation, schedule, stability
from softmodels.path.continuation import Continuation, trace
from softmodels.runs import state_values

if TYPE_CHECKING:
    from softmodels.mechanics.system import State


class WorkingStates:
    """States of a device at given loads, and if wanted its limit point and first bifurcation up to a ``highest`` pressure in
    Pa, of the device that the mesh shows. ``newton`` counts iterations since it was last set to zero; states are ``carried``
    where they follow from those of another design, and not along the path from the undeformed state."""

    def __init__(
        self,
        design: quantities.DesignedBody,
        loads: Sequence[trials.EvaluatedLoad],
        highest: float = 0.0,
        bifurcations: Bifurcations | None = None,
    ):
        self.design, self.system, self.solver = design, design.system, design.solver
        self.loads, self.highest = tuple(loads), highest
        self.states: dict[trials.EvaluatedLoad, State] = {}
        self.limit: stability.Point | None = None
        self.bifurcation: Bifurcation | None = None
        self._bifurcations = bifurcations
        self.newton = 0
        self.carried = False
        self._rest_volume = 0.0
        self.followed: dict[trials.EvaluatedLoad, PathDependence] = {}
        """Of states that depend on their path."""
        self._steps = PRESSURE_STEPS
        self.depend_on_path = any(isinstance(term, assembly.HistoryTerm) for term in self.system.potential.terms.values())

    # -- along the path -------------------------------------------------------------------------------------------------

    def trace(self, rates: sensitivity.Sensitivity, names: Sequence[str]) -> None:
        """Solve all states along paths from the undeformed state; DesignFailure if a load is not met. Where they depend on
        that path, their rates come from it, by lengths and parameters of `Sensitivity.force`."""
        self.states, self.limit, self.bifurcation = {}, None, None
        start = self._preloaded()
        self._rest_volume, self.carried = self.design.volume_at_rest(), False
        if self.depend_on_path:
            self._follow(rates, names)
            return
        by_pressure = _in_order(self.loads, trials.PRESSURE)
        self._trace_pressures(by_pressure, start)
        by_volume = _in_order(self.loads, trials.VOLUME)
        if by_volume:
            self._trace_volumes(by_volume, start)

    def _follow(self, rates: sensitivity.Sensitivity, names: Sequence[str]) -> None:
        """Solve the states in fixed steps of the pressure, with their rates."""
        while True:
            try:
                self._in_steps(sensitivity.InTime(rates, names))
                return
            except newton.NoConvergence as failure:
                if self._steps >= MOST_STEPS:
                    load = _in_order(self.loads, trials.PRESSURE)[len(self.states)]
                    raise trials.DesignFailure(f"the path ends before {load}: {failure}") from failure
                self._steps *= 2

    def _in_steps(self, rates: sensitivity.InTime) -> None:
        potential, here, before = self.system.potential, self.system.rest(), None
        potential.commit(here.w, reset=True)
        self.states, self.followed = {}, {}
        loads = _in_order(self.loads, trials.PRESSURE)
        pressures = [self.design.direction * load.value / self.system.stress_unit for load in loads]
        for load, start, end in zip(loads, [0.0, *pressures], pressures, strict=False):
            for P in np.linspace(start, end, 1 + math.ceil(self._steps * (end - start) / pressures[-1] - 1e-9))[1:]:
                control, guess = controls.pressure_control(float(P)), here.w
                if before is not None:
                    guess = here.w + (P - here.P) / (here.P - before.P) * (here.w - before.w)
                before, here = here, self.solver.solve(control, guess, float(P))
                self.newton += here.iterations
                checkpoint, (histories, *_) = potential.checkpoint(), rates.save()
                rates_of_memory = rates.step(here, control)[1] if rates.names else {}
                potential.commit(here.w)
            self.states[load], self.followed[load] = here, PathDependence(checkpoint, rates_of_memory, histories)

    def restore_friction(self, load: trials.EvaluatedLoad) -> None:
        """Restore friction to what it was where the step to a load began."""
        if self.depend_on_path:
            self.followed[load].checkpoint.restore()

    def _preloaded(self) -> State | None:
        """Return the state under the dead loads, from which the path begins; None without any."""
        dead = self.system.dead
        if not dead.loads:
            self.system.coupling = self.system.inflating(np.empty(0))
            return None
        magnitudes = np.concatenate([np.zeros(len(self.system.ratios)), dead.amounts / dead.units])
        try:
            return schedule.inflate_from(self.solver, schedule.apply_preload(self.solver, [("its dead loads", magnitudes)]))
        except schedule.PreloadFailure as end:
            raise trials.DesignFailure(end.sentence) from end

    def _trace_pressures(self, loads: Sequence[trials.EvaluatedLoad], start: State | None) -> None:
        wanted = [self.design.direction * load.value / self.system.stress_unit for load in loads]
        wanted += self._top(wanted)
        if not wanted:
            return
        met, self.limit, forked, end = self._climb(wanted, start)
        self.states |= dict(zip(loads, met, strict=False))
        if len(met) < len(loads):
            load = loads[len(met)]
            if self.limit is None:
                raise trials.DesignFailure(f"the path ends before {load}: {end}")
            limit = self.limit.state.P * self.system.stress_unit
            raise trials.DesignFailure(f"the pressure has a limit point at {limit / 1e3:.4g} kPa, before {load}", limit)
        if end is not None and self.limit is None and forked is None:
            raise trials.DesignFailure(f"the path ends before {self.highest / 1e3:.4g} kPa: {end}")
        if forked is not None and forked.mode is not None and self._bifurcations is not None:
            state = forked.state
            try:
                self.bifurcation = self._bifurcations.near(state, state.V, forked.mode, self._rest_volume)
            except newton.NoConvergence as failure:
                raise trials.DesignFailure(f"the bifurcation was passed but not located: {failure}") from failure

    def _top(self, pressures: Sequence[float]) -> list[float]:
        """Return the dimensionless pressure up to which a limit point is looked for, if it is above these."""
        top = self.design.direction * self.highest / self.system.stress_unit
        return [top] if top > max(pressures, default=0.0) else []

    def _climb(
        self, goals: Sequence[float], start: State | None = None, carried: bool = False
    ) -> tuple[list[State], stability.Point | None, stability.Point | None, stability.PathEnd | None]:
        """Follow the path through dimensionless pressures, up to its first limit point, and from rest up to its first
        bifurcation if wanted; ``start`` may be a state ``carried`` along the path. Return the states met, the limit point,
        the bifurcation, and what ended the path before the last goal."""
        met: list[State] = []
        limit = forked = end = None
        # A step of the pressure up to a limit point may end behind it, on the other branch; one of the volume does not.
        try:
            path = Continuation(
                self.solver, control=stability.AddedVolume.name, start=start, largest_growth=continuation.FREE_GROWTH
            )
            for point in trace(path, goals):
                self.newton += point.state.iterations
                limit = point if point.limit and limit is None else limit
                forked = point if point.bifurcation and forked is None else forked
                if point.requested:
                    met.append(point.state)
                if limit is not None and (forked is not None or self._bifurcations is None or carried):
                    break  # the path beyond is not needed, and would be most of the work
        except stability.PathEnd as failure:
            end = failure
        return met, limit, forked, end

    def _trace_volumes(self, loads: Sequence[trials.EvaluatedLoad], start: State | None) -> None:
        wanted = [self.design.direction * load.value / self.system.volume_unit for load in loads]
        met: list[State] = []
        try:
            for point in trace(Continuation(self.solver, stability.AddedVolume(), start=start), wanted):
                self.newton += point.state.iterations
                if point.requested:
                    met.append(point.state)
        except stability.PathEnd as end:
            raise trials.DesignFailure(f"the path ends before {loads[len(met)]}: {end}") from end
        self.states |= dict(zip(loads, met, strict=True))

    # -- from one design to the next ------------------------------------------------------------------------------------

    def save(self) -> DesignStates:
        """Return the current states, to be restored or used as guesses."""
        return DesignStates(self._rest_volume, self.states, self.limit, self.bifurcation)

    def restore(self, saved: DesignStates) -> None:
        self._rest_volume, self.states = saved.rest, saved.states
        self.limit, self.bifurcation = saved.limit, saved.bifurcation

    def carry(self, guess: DesignStates | None = None) -> None:
        """Solve all states for the device of the current mesh, from those of the last design or a guess. NoConvergence, with
        nothing changed, if one was not found from there, or may lie behind a limit point."""
        guess, rest = guess or self.save(), self.design.volume_at_rest()
        states = {load: self._solve(load, state, rest) for load, state in guess.states.items()}
        for load, state in states.items():
            grown, before = state.V - rest, guess.states[load].V - guess.rest
            if before > MIN_VOLUME_SHARE * abs(rest) and grown > LARGEST_JUMP * before:
                raise newton.NoConvergence("the cavity has grown as if the device had snapped through")
        by_pressure = [states[load] for load in _in_order(states, trials.PRESSURE)]
        limit = None
        if top := self._top([state.P for state in by_pressure]):
            _, limit, _, end = self._climb(top, by_pressure[-1] if by_pressure else self._preloaded(), bool(by_pressure))
            if end is not None and limit is None:
                raise newton.NoConvergence(str(end))
        forked = guess.bifurcation
        if forked is not None and self._bifurcations is not None:
            forked = self._bifurcations.near(forked.states[0], forked.V - guess.rest + rest, forked.mode, rest)
        self.restore(DesignStates(rest, states, limit, forked))
        self.carried = True

    def _solve(self, load: trials.EvaluatedLoad, guess: State, rest: float) -> State:
        system, value = self.system, self.design.direction * load.value
        if load.kind == trials.PRESSURE:
            state = self.solver.solve(controls.pressure_control(value / system.stress_unit), guess.w, guess.P)
        else:
            state = self.solver.solve(controls.volume_control(rest + value / system.volume_unit), guess.w, guess.P)
        self.newton += state.iterations
        return state


# ----------------------------------------------------------------------------------------------------------------------
# Locate points in a mesh of curved cells, and interpolate there.


Numbers = npt.NDArray[np.int64]

NEAREST_CELLS = 24
MAX_NEWTON_STEPS = 6
"""Iterations of Newton's method for the position in a curved cell."""
MIN_SHARES = 0.1
"""Smallest sum of clipped barycentric coordinates by which they are divided: far outside a cell it may be 0."""
MAX_OUTSIDE_DISTANCE = 0.1
"""Maximum distance of a point outside its cell, in barycentric coordinates, because meshes of a curved wall differ."""


class Places:
    """Points, shape (m, d), in the cells (node numbers in VTK's order, shape (c, 6 or 10)) of a mesh of order two: the cell
    of each, shape (m,), and its barycentric coordinates there, shape (m, d + 1)."""

    def __init__(self, nodes: Array, cells: Numbers, points: Array):
        self.cells, d = cells, nodes.shape[1]
        corners = nodes[cells[:, : d + 1]]
        count = min(NEAREST_CELLS, len(cells))
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
        inside = np.maximum(self.share, -MAX_OUTSIDE_DISTANCE)
        self.share = inside / inside.sum(axis=1, keepdims=True)

    def _curved(self, nodes: Array, points: Array, share: Array) -> Array:
        """Return the barycentric coordinates in curved cells, from those in straight ones; the straight ones if Newton's
        method diverges."""
        coordinates = np.clip(share, -0.5, 1.5)
        coordinates = coordinates / np.maximum(coordinates.sum(axis=1, keepdims=True), MIN_SHARES)
        start = coordinates
        for _ in range(MAX_NEWTON_STEPS):
            shapes, by_coordinate = state_values.quadratic(coordinates)
            gap = points - np.einsum("mn,mni->mi", shapes, nodes)
            slopes = np.einsum("mnk,mni->mik", by_coordinate, nodes)
            jacobian = slopes[:, :, 1:] - slopes[:, :, :1]
            regular = np.abs(np.linalg.det(jacobian)) > 1e-12 * np.abs(jacobian).max(axis=(1, 2)) ** jacobian.shape[1]
            jacobian[~regular] = np.eye(jacobian.shape[1])
            step = np.clip(np.linalg.solve(jacobian, gap[..., None])[..., 0], -0.5, 0.5)
            coordinates = coordinates + np.concatenate([-step.sum(axis=1, keepdims=True), step], axis=1)
        astray = ~(np.abs(coordinates - start).max(axis=1) < 1.0)
        return np.where(astray[:, None], start, coordinates)

    def interpolated(self, values: Array, linear: bool = False) -> Array:
        """Return the values at the points, shape (m, k), of those at the nodes, shape (n, k); ``linear`` takes the corners'
        alone."""
        weights = self.share if linear else state_values.quadratic(self.share)[0]
        return np.einsum("mn,mnk->mk", weights, values[self.cells[self.cell][:, : weights.shape[1]]])


# ----------------------------------------------------------------------------------------------------------------------
# Transfer states between meshes of a device: interpolated on rank 0, as guesses for Newton's method.


class Transfer:
    """Interpolates unknowns between an old and a new mesh of the same device, with the dimensionless volume ``rest`` of the
    undeformed cavity on the new one."""

    def __init__(self, old: quantities.DesignedBody, new: quantities.DesignedBody):
        self.old, self.new = old.system, new.system
        self.rest = new.volume_at_rest()
        self._scale = self.old.length_unit / self.new.length_unit  # displacements are scaled by it, pressures are not
        self._from, self._to = state_values.Grid(self.old), state_values.Grid(self.new)
        self._known, self._wanted = (
            state_values.displacement_maps(*pair) for pair in ((self.old, self._from), (self.new, self._to))
        )
        self._w = fem.Function(self.new.space)
        self._places: list[Places] = []  # on rank 0
        mpi.on_root(self.new.comm, self._locate)

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
        unknowns = None if everywhere is None else self._places[0].interpolated(everywhere, linear)
        return self._to.distribute(unknowns)

    def volume(self, V: float, rest: float) -> float:
        """Return a dimensionless volume on the new mesh, of one on the old mesh whose volume at rest is ``rest``."""
        return self.rest + (V - rest) * self._scale**3


# ----------------------------------------------------------------------------------------------------------------------
# States of one design as guesses for the next one, or for another mesh.


@dataclasses.dataclass(frozen=True, eq=False)
class DesignStates:
    """States of one design by load, as guesses for the next: values, never modified. Its limit point is no guess, because a
    bulge may grow elsewhere on the next design."""

    rest: float
    states: dict[trials.EvaluatedLoad, State]
    limit: stability.Point | None
    bifurcation: Bifurcation | None

    def ahead(self, before: DesignStates, share: float) -> DesignStates:
        """Extrapolate linearly from an earlier design's states through these, by a share of their distance."""

        def state(here: State, there: State) -> State:
            w = here.w + share * (here.w - there.w)
            P, V = here.P + share * (here.P - there.P), here.V + share * (here.V - there.V)
            return dataclasses.replace(here, w=w, P=P, V=V)

        states = {load: state(here, before.states[load]) for load, here in self.states.items()}
        return DesignStates(self.rest + share * (self.rest - before.rest), states, None, self.bifurcation)

    def transferred(self, transfer: Transfer) -> DesignStates:
        """Return the same on another mesh of the same device."""

        def state(known: State) -> State:
            return dataclasses.replace(known, w=transfer.dofs(known.w), V=transfer.volume(known.V, self.rest))

        fork = self.bifurcation
        if fork is not None:
            modes = tuple(transfer.dofs(mode) for mode in fork.modes)
            V = transfer.volume(fork.V, self.rest)
            fork = dataclasses.replace(fork, V=V, states=tuple(map(state, fork.states)), modes=modes)
        return DesignStates(transfer.rest, {load: state(known) for load, known in self.states.items()}, None, fork)


LARGEST_JUMP = 3.0
"""Growth of the added volume from one design to the next above which the state may be one behind a limit point: a shorter step
is taken, and at last the whole path."""
MIN_VOLUME_SHARE = 1e-3
"""Added volume relative to the cavity's below which its growth says nothing."""


def _in_order(loads: Iterable[trials.EvaluatedLoad], kind: str) -> list[trials.EvaluatedLoad]:
    """Return the loads of a kind in the order in which a path meets them."""
    return sorted((load for load in loads if load.kind == kind), key=lambda load: abs(load.value))


PRESSURE_STEPS = 12
"""Steps of the pressure up to the highest load where states depend on the path. They are the same for every design, so that
values are smooth; where Newton's method fails there are twice as many from then on."""
MOST_STEPS = 96


@dataclasses.dataclass(frozen=True, eq=False)
class PathDependence:
    """What a state that depends on its path needs beside itself: friction where its step began, and of each parameter the
    state's rate and how that changes."""

    checkpoint: component.Checkpoint
    rates: dict[str, sensitivity.Rate]
    histories: dict[str, list[Array]]


# ----------------------------------------------------------------------------------------------------------------------
# Adjoint gradients of quantities at equilibrium states: one back-substitution each, for any number of parameters.
#
# A state (w, P) satisfies R(w, P; theta) = 0 and the line a V + b P = d of its load. With
#
#         [ K    a q ] [ lambda ]   [ dj/dw ]
#         [ -q^T  b  ] [ eta    ] = [ dj/dP ]
#
# the whole derivative is dj/dtheta - lambda . dR/dtheta - eta d(aV + bP - d)/dtheta (Michaleris, Tortorelli & Vidal 1994, doi
# 10.1002/nme.1620371408). For shapes theta is the places X of the mesh's nodes: lambda . dR/dX is a covector from one
# assembly, whose product with each parameter's mesh motion is the derivative. At a limit point of the pressure K v = 0,
# and dP/dtheta = (v . dR/dtheta) / (v . q).


DIFFERENCE_STEP = 1e-5
"""Relative step of the differences by material parameters at fixed unknowns."""
CENTRAL = {1.0: 0.5, -1.0: -0.5}
BACKWARD = {0.0: 1.5, -1.0: -2.0, -2.0: 0.5}
_NONE: Mapping[str, float] = {}


class Adjoint:
    """Total derivatives of quantities on a meshed device."""

    def __init__(self, design: quantities.DesignedBody):
        self.design, self.system, self.solver = design, design.system, design.solver
        system, potential, compiled = self.system, self.system.potential, design.motion.compiled
        self.multiplier = fem.Function(system.space)
        self._forces = [compiled(ufl.action(force, self.multiplier)) for force in potential.forces]
        self._loads = [[compiled(ufl.action(form, self.multiplier)) for form in forms] for forms in system.dead.integrals]
        self._volume = compiled(potential.cavity_volume - design.rest_volume)
        self.sensitivity = sensitivity.Sensitivity(self.solver, design.motion)

    def prepare(self, state: State) -> None:
        """Factorise the tangent at a state, for the following gradients."""
        self.solver.factorise(state)
        self._state = state
        self._tangent_load = np.array(self.solver.bordered.q.array_r)
        self._lifted: Array | None = None

    @property
    def _opened(self) -> Array:
        """The prepared state's response to a unit pressure, needed only at constant volume."""
        if self._lifted is None:
            self._lifted = self.design.answer(self._tangent_load)
        return self._lifted

    def multipliers(self, slopes: quantities.Slopes, kind: str) -> tuple[Array, float]:
        """Return lambda (owned entries) and eta of a quantity at the prepared state, for a load of a kind."""
        if slopes.w is None and not slopes.P:
            return np.zeros(self.system.n), 0.0
        q, comm = self._tangent_load, self.system.comm
        by_w = np.zeros(self.system.n) if slopes.w is None else slopes.w
        lam = self.design.answer(by_w) if slopes.w is not None else by_w
        if kind == trials.VOLUME:
            compliance = mpi.total(comm, float(q @ self._opened))
            eta = (mpi.total(comm, float(q @ lam)) + slopes.P) / compliance
            return lam - eta * self._opened, eta
        return lam, slopes.P + mpi.total(comm, float(q @ lam))

    def covector(self, lam: Array) -> Array:
        """Return lambda . dR/dX over the mesh's nodes at the loaded state."""
        self.set_multiplier(lam)
        system, motion = self.system, self.design.motion
        covector = sum((motion.assembled(form) for form in self._forces), np.zeros(motion.entries))
        drives = system.pressures[len(system.pressures) - len(self._loads) :]
        for drive, forms, own in zip(drives, self._loads, self.sensitivity.measured, strict=True):
            for form in forms:
                covector -= drive * motion.assembled(form)
            for part in own:
                covector -= drive * part.covector(self._works)
        if system.assembled.slack:
            nodes = len(system.body.mesh.geometry.x)
            covector += motion.by_nodes(system.assembled.by_places(system.w.x.array, self.multiplier.x.array, nodes))
        return covector

    def _works(self, forms: list[ufl.Form]) -> list[fem.Form]:
        """Return the compiled work of linear forms on lambda."""
        return [self.system.form(ufl.action(form, self.multiplier)) for form in forms]

    def set_multiplier(self, lam: Array) -> None:
        """Set the function `multiplier` to owned entries."""
        x = self.multiplier.x
        self.system.unknowns.to_dofs(lam, x.array)
        x.scatter_forward()

    def gradient(
        self, slopes: quantities.Slopes, kind: str, velocities: Mapping[str, Array], materials: Mapping[str, float] = _NONE
    ) -> tuple[dict[str, float], dict[str, float]]:
        """Return the whole derivatives of a quantity at the prepared state by the lengths and by the other parameters, per
        their SI units. Kept is the load's "pressure" (in Pa) or "volume" (added). ``velocities`` are the boundary's with each
        length, of `MeshMotion.boundary_velocities`; ``materials`` partial derivatives at fixed unknowns, of `by_material`, by
        parameters that are no lengths, see `Sensitivity.force`."""
        motion = self.design.motion
        by_X = np.zeros(motion.entries) if slopes.X is None else slopes.X.copy()
        lam, eta = self.multipliers(slopes, kind)
        if slopes.w is not None or eta:
            by_X -= self.covector(lam)
        if kind == trials.VOLUME:
            by_X -= eta * self.design.sign * motion.assembled(self._volume)
        by_material = {}
        for name, direct in materials.items():
            own = self.sensitivity.force(name)
            kept = own.opened if kind == trials.VOLUME else self._state.P * own.stress / self.system.stress_unit
            inner = mpi.total(self.system.comm, float(lam @ own.residual))
            by_material[name] = direct - inner - eta * kept
        return motion.gradient(by_X, dict(velocities)), by_material

    def rates(self, kind: str, along: Array | str) -> tuple[Array, Array]:
        """Return the derivative of the prepared state by a parameter: its unknowns, with ghosts, and the mesh's nodes, shape
        (nodes, d). ``along`` is the boundary's motion with it, of `MeshMotion.boundary_velocities`, or the name of one that
        is no length. One back-substitution, for quantities with more values than there are parameters."""
        comm, q, motion = self.system.comm, self._tangent_load, self.design.motion
        if isinstance(along, str):
            nodes = np.zeros((motion.entries // motion.dimension, motion.dimension))
            own = self.sensitivity.force(along)
            force, opened = own.residual, own.opened
            if kind != trials.VOLUME:  # constant in Pa, so P falls as the shear modulus rises
                force = force + self._state.P * own.stress / self.system.stress_unit * q
        else:
            nodes = motion.nodes_rate(along)
            force = self.sensitivity.motion_force(nodes)[0]
            owned = slice(0, motion.owned_entries)
            there = float(motion.assembled(self._volume)[owned] @ nodes.ravel()[owned])
            opened = self.design.sign * mpi.total(comm, there)
        w = -self.design.answer(force)
        if kind == trials.VOLUME:
            short = opened + mpi.total(comm, float(q @ w))
            w = w - short / mpi.total(comm, float(q @ self._opened)) * self._opened
        self.set_multiplier(w)
        return self.multiplier.x.array.copy(), nodes

    def along_path(self, measure: quantities.Measure, slopes: quantities.Slopes, followed: PathDependence, name: str) -> float:
        """Return the whole derivative of a quantity at the prepared state by a parameter, without the partial one at fixed
        unknowns, from the state's rate and that of what friction remembered where its step began."""
        system, motion, rate = self.system, self.design.motion, followed.rates[name]
        along_path = 0.0
        if slopes.w is not None:
            along_path += mpi.total(system.comm, float(slopes.w @ system.unknowns.project(rate.w)))
        if slopes.P:
            stress = 0.0 if rate.X is not None else self.sensitivity.force(name).stress
            along_path += slopes.P * (rate.P - self._state.P * stress) / system.stress_unit
        if slopes.X is not None and rate.X is not None:
            owned = slice(0, motion.owned_entries)
            along_path += mpi.total(system.comm, float(slopes.X[owned] @ rate.X.ravel()[owned]))
        for history, values in zip(self.sensitivity.histories, followed.histories[name], strict=True):
            history.begin(rate.w, values)
        along_path += measure.by_history(self.sensitivity.histories)
        for history in self.sensitivity.histories:
            history.rest()
        return along_path

    def by_material(self, measure: quantities.Measure, names: Sequence[str]) -> dict[str, float]:
        """Return the partial derivatives of a quantity by parameters that are no lengths at the loaded unknowns, by
        central differences."""
        by_material = dict.fromkeys(names, 0.0)
        for name in names:
            own, step = name.rpartition(".")[2], DIFFERENCE_STEP * self.sensitivity.scale(name)
            weights = BACKWARD if own == "poisson" else CENTRAL  # which must not exceed 0.5
            for shift, weight in weights.items():
                with self.sensitivity.shifted(name, shift * step):
                    by_material[name] += weight / step * measure.value(self._state)
        return by_material

    def stress_by(self, name: str) -> float:
        """Return the derivative of the shear modulus by a parameter that is no length."""
        return self.sensitivity.force(name).stress

    def limit_gradient(
        self, state: State, tangent: controls.Tangent, velocities: Mapping[str, Array], materials: Sequence[str] = ()
    ) -> tuple[dict[str, float], dict[str, float]]:
        """Return the derivatives in Pa of the pressure at a limit point, whose null vector is the path's own direction
        there."""
        system = self.system
        system.load(state)
        v = system.unknowns.project(tangent.w) / tangent.V  # v . q = 1
        by_X = self.covector(v)
        unit = self.design.direction * system.stress_unit
        lengths = self.design.motion.gradient(unit * by_X, dict(velocities))
        by_material = {}
        for name in materials:
            own = self.sensitivity.force(name)
            rate = mpi.total(system.comm, float(v @ own.residual))
            by_material[name] = unit * rate + self.design.direction * state.P * own.stress
        return lengths, by_material


# ----------------------------------------------------------------------------------------------------------------------
# The bifurcation pressure of a device, tracked from design to design, and its exact derivative.
#
# At a bifurcation an eigenvalue of the tangent is zero whose mode does not change the volume. K is singular there under every
# control, so neither the state nor an adjoint is computed there; instead, four states at given volumes on both sides, and the
# eigenvalue of the same mode at each. The reported values are the volume at which the cubic through the eigenvalues is zero,
# and the cubic's pressure there; both are differentiated exactly. An eigenvalue's derivative does not need that of its mode,
# because it is stationary.


BIFURCATION_OFFSETS = np.array([-0.06, -0.025, 0.025, 0.06])
"""Positions of the states around the expected bifurcation, relative to the volume added up to it. Nearer ones would show an
imperfect mesh's eigenvalue (see `softmodels.path.continuation.EIGENVALUE_SAMPLE_POSITIONS`)."""
BIFURCATION_TOLERANCE = 0.01
"""Maximum relative distance of the bifurcation from the expected place; otherwise the states are recomputed around it."""
MOST_TRIES = 6


@dataclasses.dataclass(frozen=True, eq=False)
class Bifurcation:
    """A bifurcation at a dimensionless volume V and pressure P, by the states around it in order of their volumes, their
    eigenvalues and modes: local dofs, each of length 1 in the norm of `Stability.mass`."""

    V: float
    P: float
    states: tuple[State, ...]
    modes: tuple[Array, ...]
    eigenvalues: Array

    @property
    def mode(self) -> Array:
        """Mode of the state closest to it."""
        return self.modes[int(np.argmin(np.abs(self.eigenvalues)))]


class Bifurcations:
    """Finds a device's bifurcation near an expected volume."""

    def __init__(self, design: quantities.DesignedBody, adjoint: Adjoint):
        self.design, self.adjoint, self.solver = design, adjoint, design.solver
        system, potential = design.system, design.system.potential
        self._mode = fem.Function(system.space)
        forms = [ufl.action(ufl.derivative(force, system.w, self._mode), self._mode) for force in design.forces]
        turned = [-ufl.action(ufl.derivative(load, system.w, self._mode), self._mode) for load in potential.loads]
        self._eigenvalue = quantities.FormMeasure(
            design, forms, lambda values: (float(values.sum()), np.ones(len(values))), by_pressure=turned
        )

    def near(self, state: State, V: float, mode: Array, rest: float) -> Bifurcation:
        """Return the bifurcation near an expected volume V and a state, the first guess, with a mode in local dofs and a volume
        of the undeformed cavity. NoConvergence if a state around it was not found, or the eigenvalue has no zero near."""
        for _ in range(MOST_TRIES):
            added = V - rest
            states, modes, values = [], [], []
            for spread in BIFURCATION_OFFSETS:
                fork_state = self.solver.solve(controls.volume_control(V + spread * added), state.w, state.P)
                quantities.check_apart(self.design, "bifurcation")
                state = fork_state
                value, shape = stability.Stability.of(self.solver).like(fork_state, mode)
                states.append(fork_state)
                modes.append(shape / stability.Mode(stability.Stability.of(self.solver).mass, shape).length)
                values.append(value)
            cubic = Cubic([fork_state.V for fork_state in states])
            root = cubic.root(np.array(values), V)
            if abs(root - V) < BIFURCATION_TOLERANCE * added:
                P = float(cubic.weights(root)[0] @ np.array([fork_state.P for fork_state in states]))
                return Bifurcation(root, P, tuple(states), tuple(modes), np.array(values))
            V = root
        raise newton.NoConvergence("the bifurcation is not near that of the last design")

    def gradient(
        self, bifurcation: Bifurcation, velocities: Mapping[str, Array], materials: Sequence[str] = ()
    ) -> tuple[dict[str, float], dict[str, float]]:
        """Return the derivatives in Pa of its pressure, by the lengths and by the material parameters; see
        `Adjoint.gradient`."""
        unit = self.design.direction * self.design.system.stress_unit
        cubic = Cubic([state.V for state in bifurcation.states])
        weights, slopes = cubic.weights(bifurcation.V)
        steepness = float(slopes @ bifurcation.eigenvalues)
        rise = float(slopes @ np.array([state.P for state in bifurcation.states]))
        lengths = dict.fromkeys(velocities, 0.0)
        numbers = dict.fromkeys(materials, 0.0)
        for state, mode, weight in zip(bifurcation.states, bifurcation.modes, weights, strict=True):
            self.adjoint.prepare(state)
            self._mode.x.array[:] = mode[: len(self._mode.x.array)]
            direct = self.adjoint.by_material(self._eigenvalue, materials)
            by_eigenvalue = self.adjoint.gradient(self._eigenvalue.slopes(state), trials.VOLUME, velocities, direct)
            pressure = quantities.Slopes(state.P * unit, P=unit)
            by_pressure = self.adjoint.gradient(pressure, trials.VOLUME, velocities, self._pressure_by(state, materials))
            for sums, of_value, of_pressure in zip((lengths, numbers), by_eigenvalue, by_pressure, strict=True):
                for name in sums:
                    sums[name] += weight * (of_pressure[name] - unit * rise / steepness * of_value[name])
        return lengths, numbers

    def _pressure_by(self, state: State, materials: Sequence[str]) -> dict[str, float]:
        """Return the partial derivatives of a pressure in Pa by the material parameters at the same dimensionless pressure."""
        sign = self.design.direction
        return {name: sign * state.P * self.adjoint.stress_by(name) for name in materials}


class Cubic:
    """Polynomials through values at four places."""

    def __init__(self, places: Sequence[float]):
        self._middle, self._reach = float(np.mean(places)), float(np.ptp(places)) / 2
        x = (np.array(places) - self._middle) / self._reach
        self._inverse = np.linalg.inv(np.vander(x))

    def weights(self, place: float) -> tuple[Array, Array]:
        """Return the weights of the values in the polynomial's value at a place, and in its slope there."""
        x = (place - self._middle) / self._reach
        powers = np.vander([x], len(self._inverse))[0]
        n = len(self._inverse)
        slopes = np.array([(n - 1 - i) * x ** (n - 2 - i) if i < n - 1 else 0.0 for i in range(n)])
        return powers @ self._inverse, slopes @ self._inverse / self._reach

    def root(self, values: Array, near: float) -> float:
        """Return the zero nearest to a place, not farther from the middle than twice the reach; NoConvergence if there is
        none."""
        roots = np.roots(self._inverse @ values)
        real = roots[np.abs(roots.imag) < 1e-9].real
        real = real[np.abs(real) < 2.0]
        if not len(real):
            raise newton.NoConvergence("the eigenvalue does not change sign near that of the last design")
        return float(self._middle + self._reach * real[np.argmin(np.abs(real - (near - self._middle) / self._reach))])
