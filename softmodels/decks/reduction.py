"""A run reduced to its tip: pose, volume, stiffness and their derivatives over the pressure, from exact linear responses.

The pose of a face is the mean of its displacement and the rotation that fits it best (Kabsch 1976, doi
10.1107/S0567739476001873): R maximises tr(R^T A), A = mean of x (X - c)^T over the undeformed face. Both depend on twelve means
that are linear in the displacement, so their derivatives by loads and pressures are exact: one solve with the factorised
tangent each. Force and moment on the tip are those that do work on position and rotation, so the compliance is symmetric.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.spatial.transform import Rotation

from geometries import Actuator, Hold, actuator
from softmodels.case import materials
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.common import cards, errors, units
from softmodels.common.arrays import Array
from softmodels.common.lazy import Expr
from softmodels.components import loads
from softmodels.components.contact import Walls
from softmodels.materials import silicones
from softmodels.mechanics import controls, mpi, newton, regions
from softmodels.mechanics.body import Body
from softmodels.mechanics.component import ComponentError
from softmodels.mechanics.sensitivity import Sensitivity
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State, System
from softmodels.runs import notes, recording, table
from softmodels.runs.outcomes import RunError
from softmodels.runs.simulation import Equilibrium, Model, Simulation
from softmodels.runs.states import StoredStates

__all__ = ["Curves", "ReducedModel", "TipPose", "TipState", "table_of"]


class ReducedModel(cards.ResultCard):
    """A device reduced to its tip, over one pressure; ``model(5e3)`` is its state at 5 kPa.

    Position, rotation and volume are cubic in between, with the exact derivatives at the table's states; compliance is a cubic
    spline.

    Attributes:
        case: What was run.
        face: The tip.
        states: The table.
        base: Centre of the support, m.
        end: Why the table ends: a limit point, a bifurcation; empty at the last requested value.
        contact: Pressure in Pa from which surfaces are in contact; None if they never are.
        mass: Of the whole device with what is on it, kg.
        first_mode: In the middle of the table; None where it is not known.
        points: Of the whole device at rest, m, shape (n, 3).
        errors: Largest errors in between: position over length, angle in degrees, volume and compliance relative.
    """

    def __init__(self, case: Case, face: str, states: tuple[TipState, ...], base: Array, end: str, mass: float | None = None):
        self.case, self.face, self.states, self.base, self.end = case, face, states, base, end
        self.contact: float | None = None
        self.first_mode: FirstMode | None = None
        self.points: Array = np.empty((0, 3))
        self.mass = case.actuator.solid_volume * silicones.density_of(case.material) if mass is None else mass
        self._curves = Curves(states)
        self.errors = self._errors()

    def _line(self) -> str:
        low, high = self.span
        return f"of {self.case.name}: {len(self.states)} states from {low / 1e3:.4g} to {high / 1e3:.4g} kPa"

    def _figures(self) -> cards.Table:
        last, errors = self(self.states[-1].pressure), self.errors
        angle = math.degrees(float(np.linalg.norm(self.turns[-1])))
        place = ", ".join(f"{1e3 * x:.4g}" for x in last.position)
        return [
            ("tip at the last state", f"{place} mm"),
            ("angle there", f"{angle:.4g} deg"),
            ("added volume there", f"{last.volume * 1e6:.4g} ml"),
            ("error of the position between states", f"{100 * errors['position']:.2g} % of the length"),
            ("error of the angle", f"{errors['angle_deg']:.2g} deg"),
            ("error of the compliance", f"{100 * errors['compliance']:.2g} %"),
        ]

    def _remarks(self) -> list[str]:
        return self.notes

    @property
    def notes(self) -> list[str]:
        """Where the table ends, and what to know before it is used."""
        notes = []
        high = self.states[-1].pressure / 1e3
        if self.end:
            notes.append(f"the table ends at {high:.4g} kPa, before a {self.end}")
        stretch = max(state.stretch for state in self.states)
        if text := silicones.extrapolated(self.case.material, stretch):
            notes.append(text)
        if np.isnan(self.states[0].compliance).any():
            notes.append(
                f"loads against the symmetry of the slice are not known (nan in the compliance); use "
                f"{self.case.actuator.fuller} for all six"
            )
        return notes + self.contact_notes

    @property
    def contact_notes(self) -> list[str]:
        """What contact does to the compliance, a sentence; none if no surfaces touch."""
        if self.contact is None:
            return []
        return [
            f"surfaces are in contact from {self.contact / 1e3:.4g} kPa on: there a load that presses them together moves the "
            f"device less than its compliance predicts, a PneuNet up to seven times less; their friction is not included"
        ]

    @property
    def span(self) -> tuple[float, float]:
        """First and last pressure in Pa."""
        ends = sorted((self.states[0].pressure, self.states[-1].pressure))
        return ends[0], ends[1]

    @property
    def pressures(self) -> Array:
        """Pressures of the table in Pa."""
        return np.array([state.pressure for state in self.states])

    @property
    def turns(self) -> Array:
        """Rotation vectors of the table, continued past half a turn, shape (states, 3)."""
        return self._curves.turns

    @property
    def length(self) -> float:
        """Distance in m of the tip from the support at the first state."""
        return float(np.linalg.norm(self.states[0].position - self.base)) or self.case.actuator.size

    def __call__(self, pressure: float) -> TipPose:
        """Return the state at a pressure in Pa.

        Raises:
            RunError: Outside the table.
        """
        low, high = self.span
        slack = 1e-9 * (high - low)
        if not low - slack <= pressure <= high + slack:
            raise RunError(
                f"{pressure / 1e3:.4g} kPa is outside the reduced model; it goes from {low / 1e3:.4g} to {high / 1e3:.4g} kPa"
            )
        return self._curves.at(float(np.clip(pressure, low, high)))

    def knots(self) -> dict[str, list[object]]:
        """Return ``pressures`` (Pa, rising) and there ``values`` and ``slopes`` of position, rotation vector, volume, rate and
        compliance, 49 each, SI units; cubic Hermite curves through them are the model. 0 where a compliance is not known."""
        places = np.sort(self.pressures)
        values, slopes = (np.array([self._curves.row(x, nu) for x in places]) for nu in (0, 1))
        return {"pressures": places.tolist(), "values": values.tolist(), "slopes": slopes.tolist()}

    def _errors(self) -> dict[str, float]:
        """Return the largest errors at every second state of curves through the others: a bound of those of all states."""
        odd = self.states[1:-1:2]
        kept = [state for k, state in enumerate(self.states) if k % 2 == 0 or k == len(self.states) - 1]
        curves, errors = Curves(kept), dict.fromkeys(("position", "angle_deg", "volume", "compliance"), 0.0)
        volume = max(abs(state.volume) for state in self.states) or 1.0
        for odd_state in odd:
            at = curves.at(odd_state.pressure)
            turned = float(np.linalg.norm(Rotation.from_matrix(at.rotation.T @ odd_state.rotation).as_rotvec()))
            miss = {
                "position": float(np.linalg.norm(at.position - odd_state.position)) / self.length,
                "angle_deg": math.degrees(turned),
                "volume": abs(at.volume - odd_state.volume) / volume,
                "compliance": relative(at.compliance, odd_state.compliance),
            }
            errors = {name: max(errors[name], value) for name, value in miss.items()}
        return errors

    # -- derived figures ----------------------------------------------------------------------------------------------

    def blocked(self, state: TipState) -> Array:
        """Return force (N) and moment (N m) per Pa of a held tip on what holds it, shape (6,); nan if unknown."""
        known = ~np.isnan(np.diag(state.compliance))
        loads = np.full(6, np.nan)
        loads[known] = np.linalg.solve(state.compliance[np.ix_(known, known)], state.rate[known])
        return loads

    def effective_area(self, state: TipState) -> float:
        """Return the blocked force along the line from the support to the tip per pressure, m2, all other motions free."""
        along = (self.states[0].position - self.base) / self.length
        C = np.nan_to_num(state.compliance[:3, :3])
        return float(along @ state.rate[:3] / (along @ C @ along))

    def constant_curvature(self, state: TipState) -> tuple[float, float, float]:
        """Return curvature (1/m), arc length (m) and direction of bending (rad, about the axis at rest) of the arc from the
        support that has the tip's angle and distance."""
        turn = self.turns[[solved is state for solved in self.states].index(True)]
        angle = float(np.linalg.norm(turn))
        chord = float(np.linalg.norm(state.position - self.base))
        if angle < 1e-9:
            return 0.0, chord, 0.0
        arc = chord * (angle / 2) / math.sin(angle / 2)
        first, second = across(self.states[0].position - self.base)
        towards = np.cross(turn / angle, self.states[0].position - self.base)
        return angle / arc, arc, math.atan2(float(towards @ second), float(towards @ first))


def across(along: Array) -> tuple[Array, Array]:
    """Return two unit vectors square to one and to each other; the first is closest to z, or to x for a vector along z."""
    e = along / np.linalg.norm(along)
    near = np.array([0.0, 0.0, 1.0]) if abs(e[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    first = near - (near @ e) * e
    first /= np.linalg.norm(first)
    return first, np.cross(e, first)


def relative(values: Array, other: Array) -> float:
    """Return the largest difference of the known entries of two compliances, over the size of translation, rotation or both."""
    sizes = np.sqrt(np.abs(np.nan_to_num(np.diag(other))))
    parts = np.array([sizes[:3].max()] * 3 + [sizes[3:].max()] * 3)
    whole = np.outer(parts, parts)
    known = ~np.isnan(values - other) & (whole > 0.0)
    return float((np.abs(values - other)[known] / whole[known]).max(initial=0.0))


class Curves:
    """Smooth functions through the states of a table; ``turns`` are their rotation vectors, continued past half a turn."""

    def __init__(self, states: Sequence[TipState]):
        p = np.array([state.pressure for state in states])
        order = np.argsort(p)
        self.turns = continued([state.rotation for state in states])
        rates = np.array([inverse_left_jacobian(t) @ state.rate[3:] for t, state in zip(self.turns, states, strict=True)])
        places, slopes = np.array([state.position for state in states]), np.array([state.rate[:3] for state in states])
        volumes = np.array([state.volume for state in states])
        volume_rates = np.array([state.volume_rate for state in states])
        x = p[order]
        self._place = CubicHermiteSpline(x, places[order], slopes[order])
        self._turn = CubicHermiteSpline(x, self.turns[order], rates[order])
        self._volume = CubicHermiteSpline(x, volumes[order], volume_rates[order])
        compliances = np.array([state.compliance for state in states])[order].reshape(len(x), 36)
        # Loads against the symmetry are known up to where walls touch.
        groups = alike(np.isfinite(compliances))
        self._compliances = [(entries, CubicSpline(x[known], compliances[known][:, entries])) for known, entries in groups]
        self._rate = CubicSpline(x, np.array([state.rate for state in states])[order])

    def _compliance(self, pressure: float, nu: int = 0) -> Array:
        """Return the compliance, or its derivative, shape (36,); nan where it is not known."""
        C = np.full(36, np.nan)
        for entries, spline in self._compliances:
            if spline.x[0] <= pressure <= spline.x[-1]:
                C[entries] = spline(pressure, nu)
        return C

    def row(self, pressure: float, nu: int) -> Array:
        """Return position, rotation vector, volume, rate and compliance, or their derivatives, shape (49,); 0 where unknown."""
        curves = (self._place, self._turn, self._volume, self._rate)
        values = [np.atleast_1d(curve(pressure, nu)) for curve in curves]
        return np.nan_to_num(np.concatenate([*values, self._compliance(pressure, nu)]))

    def at(self, pressure: float) -> TipPose:
        """Return the state at a pressure in Pa."""
        turn = self._turn(pressure)
        omega = np.linalg.solve(inverse_left_jacobian(turn), self._turn(pressure, 1))
        C = self._compliance(pressure)
        R = Rotation.from_rotvec(turn).as_matrix()
        return TipPose(
            pressure, self._place(pressure), R, float(self._volume(pressure)), C.reshape(6, 6),
            np.concatenate([self._place(pressure, 1), omega]), float(self._volume(pressure, 1)),
        )  # fmt: skip


def alike(known: npt.NDArray[np.bool_]) -> list[tuple[npt.NDArray[np.bool_], npt.NDArray[np.int64]]]:
    """Return the columns that are known in the same rows, with these rows, where there are enough for a curve."""
    patterns = np.unique(known.T, axis=0)
    return [(row, np.flatnonzero((row == known.T).all(axis=1))) for row in patterns if row.sum() > 1]


def continued(rotations: Sequence[npt.NDArray[np.float64]]) -> Array:
    """Return the rotation vectors of a sequence of matrices, each the closest to the one before."""
    vectors = [Rotation.from_matrix(rotations[0]).as_rotvec()]
    for R in rotations[1:]:
        plain = Rotation.from_matrix(R).as_rotvec()
        angle = float(np.linalg.norm(plain))
        axis = plain / angle if angle > 1e-12 else _axis(vectors[-1])
        ways = [(angle + 2 * math.pi * k) * axis for k in (-2, -1, 0, 1, 2)]
        vectors.append(min(ways, key=lambda way: float(np.linalg.norm(way - vectors[-1]))))
    return np.array(vectors)


def _axis(turn: Array) -> Array:
    size = float(np.linalg.norm(turn))
    return turn / size if size else np.array([1.0, 0.0, 0.0])


def inverse_left_jacobian(turn: Array) -> Array:
    """Return the matrix that turns an angular rate in space into the rate of the rotation vector."""
    angle, K = float(np.linalg.norm(turn)), regions.cross(turn)
    c = 1 / 12 + angle**2 / 720 if angle < 1e-3 else (1 - angle / 2 / math.tan(angle / 2)) / angle**2
    return np.eye(3) - K / 2 + c * K @ K


RESPONSE_TOLERANCE = 1e-11
RATE_STEP = 1e-3
"""Displacement of the tip in sizes by which the rate of the compliance is measured."""
MIN_TABLE_STATES = 4
ZERO_LOAD_TOLERANCE = 1e-9
"""Relative size below which a load by symmetry does nothing."""


# ----------------------------------------------------------------------------------------------------------------------
# The pose of a face, and its derivatives.


def axial(W: Array) -> Array:
    """Return the vector whose cross product is the skew part of a matrix, times two."""
    return np.array([W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1]])


def fitted_rotation(A: Array) -> tuple[Array, Array]:
    """Return the rotation R that maximises tr(R^T A), and the matrix from axial(R^T dA) to its angular rate in space."""
    U, s, Vt = np.linalg.svd(A)
    s[2] *= np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    R = U @ np.diag([1.0, 1.0, np.sign(s[2]) or 1.0]) @ Vt
    if np.linalg.det(R) < 0.0:  # a plane face: the third direction has no part in A
        R = U @ np.diag([1.0, 1.0, -1.0]) @ Vt
    P = Vt.T @ np.diag(s) @ Vt
    return R, R @ np.linalg.inv(np.trace(P) * np.eye(3) - P)


class TipFace:
    """The pose of a face of a device as linear means of its displacement; ``of`` is the device whose slice this is, for
    motions against its symmetry.

    Attributes:
        centre: Of the undeformed face of the whole device, m.
        at_rest: Mean of (X - c)(X - c)^T over it, in sizes squared.
        vectors: Entries by all owned dofs whose product with w is the mean of u_i (3) and of u_i (X - c)_j (9), dimensionless.
    """

    def __init__(self, system: System, role: str, of: Actuator | None = None):
        self.system, on = system, controls.DistributedLoad(system)
        device, d = of or system.body.actuator, system.body.actuator.dimension
        self._odd = of is not None
        area = on.integral(on.constant(1.0), role)
        hoop, measure = system.body.hoop, on.measure(role)
        places = [on.places[j] for j in range(d)]
        planes = [plane.normal for plane in device.cut_planes]
        images = actuator.reflected(planes, max(device.copies, 2 ** len(planes)))
        means = np.array([on.integral(x, role) for x in places]) / area
        squares = np.array([[on.integral(x * y, role) for y in places] for x in places]) / area
        # An axisymmetric section stands for all its turns: means over the circle.
        self._turned = d == 2
        self._images = images
        self.centre_in_sizes = self._whole(self._in_space(means))
        XX = self._whole(self._in_space(squares)) - np.outer(self.centre_in_sizes, self.centre_in_sizes)
        self.at_rest = XX
        weights = [on.constant(1 / area) * x for x in (1.0, *places)]
        parts = [[weight * on.test[i] * hoop * measure for weight in weights] for i in range(d)]
        forms = [*(row[0] for row in parts), *(form for row in parts for form in row[1:])]
        raw = np.array([system.assemble([system.form(form)], held=True).copy() for form in forms])
        self.vectors = self._combined(raw, d)
        self.loads = np.array([system.by_unknowns(row).copy() for row in self.vectors])
        self.centre = self.centre_in_sizes * device.size

    def _in_space(self, of_mesh: Array) -> Array:
        """Return a vector or matrix of the mesh in space: that of a section is averaged over the circle."""
        if not self._turned:
            return of_mesh
        if of_mesh.ndim == 1:
            return np.array([0.0, 0.0, of_mesh[1]])
        return np.diag([of_mesh[0, 0] / 2, of_mesh[0, 0] / 2, of_mesh[1, 1]])

    def _whole(self, of_slice: Array, odd: bool = False) -> Array:
        """Return the mean of a vector or matrix over the images that make the whole device; of a motion against the symmetry
        with the sign of each image."""
        signs = [np.linalg.det(Q) if odd else 1.0 for Q in self._images]
        if of_slice.ndim == 1:
            return np.mean([sign * Q @ of_slice for sign, Q in zip(signs, self._images, strict=True)], axis=0)
        return np.mean([sign * Q @ of_slice @ Q.T for sign, Q in zip(signs, self._images, strict=True)], axis=0)

    def _combined(self, raw: Array, d: int) -> Array:
        """Return the twelve vectors of the whole device from those of the mesh's components."""
        basis, n = np.eye(len(raw)), raw.shape[1]
        means = np.array([self._whole(self._in_space(e[:d]), self._odd) for e in basis])
        products = np.array([self._whole(self._in_space(e[d:].reshape(d, d)), self._odd) for e in basis])
        products -= means[:, :, None] * self.centre_in_sizes
        return (np.hstack([means, products.reshape(len(raw), 9)]).T @ raw).reshape(12, n)

    def pose(self, state: State) -> tuple[Array, Array, Array]:
        """Return position (m), rotation matrix, and the map from the twelve means to position (m) and turn, shape (6, 12)."""
        device = self.system.body.actuator
        pose = self.vectors @ state.w[: self.system.n]
        A = self.at_rest + pose[3:].reshape(3, 3)
        R, turn = fitted_rotation(A)
        rates = np.zeros((6, 12))
        rates[:3, :3] = np.eye(3) * device.size
        for k in range(9):
            dA = np.zeros(9)
            dA[k] = 1.0
            rates[3:, 3 + k] = turn @ axial(R.T @ dA.reshape(3, 3))
        return self.centre + pose[:3] * device.size, R, rates


# ----------------------------------------------------------------------------------------------------------------------
# Loads against the symmetry of half a device.
#
# At a symmetric state the tangent does not couple motions with and against the symmetry. Those against it are found on the same
# half: on the cut plane they have no displacement within the plane, and are free across it.


def odd_body(body: Body) -> Body | None:
    """Return half a device whose cut plane may warp, but not move within itself; None if it is not half a device."""
    device = body.actuator
    if len(device.cut_planes) != 1 or device.dimension != 3:
        return None
    (plane,) = device.cut_planes
    within = [e for e in np.eye(3) if abs(e @ plane.normal) < ZERO_LOAD_TOLERANCE]
    if len(within) != 2 or any(hold.role == plane.name for hold in body.holds):
        return None

    class Warping(Body):
        """A body whose cavity is closed by its mirror image."""

        def volume_integrand(self, w: Expr) -> Expr:
            return super().volume_integrand(w)

    kind = type(type(device).__name__, (type(device),), {"cut_planes": ()})
    uncut: Actuator = object.__new__(kind)
    for name, value in vars(device).items():
        object.__setattr__(uncut, name, value)
    holds = (*body.holds, *(Hold(plane.name, (float(e[0]), float(e[1]), float(e[2]))) for e in within))
    own = {field.name: getattr(body, field.name) for field in dataclasses.fields(body)}
    return Warping(**{**own, "actuator": uncut, "holds": holds})


# ----------------------------------------------------------------------------------------------------------------------
# The table: the solved states of a path, and linear responses at each.


class Responses:
    """Linear responses of a prepared device, of the pose of a face, at its states."""

    def __init__(self, simulation: Simulation, role: str):
        self.solver, self.fields, self.case = simulation.solver, simulation.fields, simulation.case
        self.system, self.tip = self.solver.system, TipFace(self.solver.system, role)
        self._sides = [(self.solver, self.tip), *self._against(role)]
        self._sensitivity = None
        if isinstance(self.case.band, materials.MaterialErrors):
            self._sensitivity = Sensitivity(self.solver)

    def _against(self, role: str) -> list[tuple[Solver, TipFace]]:
        """Return what solves for motions against the symmetry of half a device; nothing for others."""
        body, parts = odd_body(self.system.body), materials.without_walls(self.case.components)
        if body is None or not all(isinstance(part, regions.RegionPart | Walls) for part in parts):
            return []
        system = System(body, self.case.material, self.case.formulation, parts)
        system.direction = self.system.direction
        return [(Solver(system, self.case.solver), TipFace(system, role, self.system.body.actuator))]

    @property
    def _per_load(self) -> float:
        """Dimensionless load on the slice by one N or N m on the whole device."""
        # Forces on the slice are those on the whole device over its copies; in shear moduli times the size squared or cubed.
        device = self.system.body.actuator
        return 1.0 / (self.system.stress_unit * device.size**3 * device.copies)

    def release(self) -> None:
        """Release what the simulation does not."""
        for solver, _ in self._sides[1:]:
            solver.release()

    def base(self) -> Array:
        """Return the centre of the device's first support, m."""
        device = self.system.body.actuator
        role = next((hold.role for hold in device.holds if hold.role in self.system.body.entities), "")
        if not role:
            return np.zeros(3)
        try:
            return TipFace(self.system, role).centre
        except ComponentError:
            return np.zeros(3)

    def mass(self) -> float:
        """Return what the whole device weighs with the masses on it, kg."""
        system, parts, on = self.system, self.case.components, controls.DistributedLoad(self.system)
        amounts = zip(system.matter, loads.densities(system, parts), strict=True)
        return sum(density * on.volume(matter) for matter, density in amounts) + sum(part.weighs for part in parts)

    def at(self, state: State, row: table.Row, rate: bool = False) -> TipState:
        """Return a state of the table, from a guess of it, with or without the rate of its compliance."""
        solver, system = self.solver, self.system
        control = controls.pressure_control(state.P)
        state = solver.solve(control, state.w, state.P)
        solver.factorise(state)
        along = solver.tangent(state, control, RESPONSE_TOLERANCE)
        device = system.body.actuator
        position, R, rates = self.tip.pose(state)
        stress, n = system.stress_unit, system.n
        compliance = self._compliance(state, rates, touches(row))
        pushes = [push.copy() for push in system.pressure_loads()[: len(device.ratios)]]
        jacobian = [self.tip.vectors @ solver.linear_response(push, 0.0, RESPONSE_TOLERANCE).w[:n] for push in pushes]
        return TipState(
            state.P * stress, row["added_volume"], position, R,
            along.V * system.volume_unit / stress, rates @ (self.tip.vectors @ along.w[:n]) / stress,
            rates @ np.transpose(jacobian) / stress, compliance, self._spread(state, rates), row["max_stretch"],
            self._compliance_rate(state, rates) if rate and not touches(row) else None,
        )  # fmt: skip

    def _compliance_rate(self, state: State, rates: Array) -> Array:
        """Return the derivative of the compliance by a dead force on the tip, from the tangents beside a state at which that of
        the slice is factorised.

        A state that is off by the linear response to a force has the tangent of that under the force to first order. Where
        walls touch, there is none: the compliance jumps wherever further facets meet.
        """
        size, rate = self.system.body.actuator.size, np.full((6, 6, 3), np.nan)
        loads = rates[:3] @ self.tip.loads
        sizes = np.linalg.norm(loads, axis=1)
        moved = {
            k: self.solver.linear_response(loads[k], 0.0, RESPONSE_TOLERANCE).w
            for k in np.flatnonzero(sizes > ZERO_LOAD_TOLERANCE * sizes.max())
        }
        for k, direction in moved.items():
            step = RATE_STEP * size / float(rates[k] @ (self.tip.vectors @ direction[: self.system.n]))
            low, high = (dataclasses.replace(state, w=state.w + way * direction) for way in (-step, step))
            change = self._compliance_at(high) - self._compliance_at(low)
            rate[:, :, k] = change * self._per_load / (2.0 * step)
        return rate

    def _compliance_at(self, state: State) -> Array:
        """Return the compliance at a state without contact at which nothing is factorised."""
        self.solver.factorise(state)
        self.solver.tangent(state, controls.pressure_control(state.P), RESPONSE_TOLERANCE)
        return self._compliance(state, self.tip.pose(state)[2], touching=False)

    def _compliance(self, state: State, rates: Array, touching: bool) -> Array:
        """Return the compliance at a state at which the tangent of the slice is factorised.

        Where surfaces press on each other, only that of the slice is known.
        """
        compliance = np.full((6, 6), np.nan)
        for solver, tip in self._sides[:1] if touching else self._sides[::-1]:
            loads = rates @ tip.loads
            size = np.linalg.norm(loads, axis=1)
            acting = [k for k in range(6) if size[k] > ZERO_LOAD_TOLERANCE * max(size[3 * (k // 3) : 3 * (k // 3) + 3])]
            if solver is not self.solver:
                solver.factorise(state)
                solver.tangent(state, controls.pressure_control(state.P), RESPONSE_TOLERANCE)
            moved = np.transpose(
                [tip.vectors @ solver.linear_response(loads[k], 0.0, RESPONSE_TOLERANCE).w[: len(loads[k])] for k in acting]
            )
            compliance[np.ix_(acting, acting)] = (rates @ moved)[acting] * self._per_load
            for k in acting:
                others = [j for j in range(6) if j not in acting and np.isfinite(compliance[j, j])]
                compliance[k, others] = compliance[others, k] = 0.0
        return compliance

    def _spread(self, state: State, rates: Array) -> Array:
        """Return the half widths of the 95 % intervals of position, rotation and volume at a fixed pressure."""
        errors, known, system = self.case.band, self._sensitivity, self.system
        if known is None or not isinstance(errors, materials.MaterialErrors):
            return np.full(7, np.nan)
        moves = []
        for root in errors.roots.T:
            force, dmu = np.zeros(system.n), 0.0
            for name, change in zip(errors.names, root, strict=True):
                own, slope = known.material_force(name)
                force, dmu = force + change * own, dmu + change * slope
            response = self.solver.linear_response(-force, -state.P * dmu / system.stress_unit, RESPONSE_TOLERANCE)
            pose = rates @ (self.tip.vectors @ response.w[: system.n])
            moves.append(np.append(pose, response.V * system.volume_unit))
        return units.HALF_WIDTH_95 * np.linalg.norm(moves, axis=0)


@dataclasses.dataclass(frozen=True, eq=False)
class TipState:
    """A state of the table, SI units, device coordinates.

    Attributes:
        pressure: Pa.
        volume: Added volume, m3.
        position: Of the tip's centre, m.
        rotation: Of the tip, a matrix.
        volume_rate: By the pressure, m3/Pa.
        rate: Of position and rotation by the pressure: m/Pa and rad/Pa, shape (6,).
        jacobian: The same by the pressure of each cavity, shape (6, cavities).
        compliance: Of position and rotation by force and moment on the tip at constant pressure, shape (6, 6); nan for loads
            against the symmetry of the slice.
        spread: Half widths of the 95 % intervals of position, rotation and volume, shape (7,); nan without errors of the
            material.
        stretch: Largest stretch.
        compliance_rate: Derivative of the compliance by a dead force on the tip, shape (6, 6, 3), nan where it is not known;
            only in the middle of the table, and without contact, else None.
    """

    pressure: float
    volume: float
    position: Array
    rotation: Array
    volume_rate: float
    rate: Array
    jacobian: Array
    compliance: Array
    spread: Array
    stretch: float
    compliance_rate: Array | None = None


@dataclasses.dataclass(frozen=True)
class FirstMode:
    """The first mode of a device at a pressure, with the symmetry of its slice.

    Attributes:
        pressure: Pa.
        frequency: Hz.
        damping: Its damping ratio by the branches of the silicone; 0 where they are not known.
    """

    pressure: float
    frequency: float
    damping: float


def first_mode(model: Model, state: State) -> FirstMode | None:
    """Return the first mode of a device at a state; None if it has no mass, or the mode is unstable or not found."""
    try:
        mode = model.modes(Equilibrium(model, state), 1)[0]
    except (CaseError, RunError):
        return None
    return FirstMode(state.P * model.system.stress_unit, mode.frequency, mode.damping) if mode.frequency > 0.0 else None


def whole_points(device: Actuator, points: Array) -> Array:
    """Return points of a slice with their images in the whole device, m, shape (n, 3)."""
    if device.dimension == 2:
        turns = 2 * math.pi * np.arange(SECTION_TURNS) / SECTION_TURNS
        return np.concatenate([points @ Rotation.from_rotvec([0.0, 0.0, turn]).as_matrix().T for turn in turns])
    planes = [plane.normal for plane in device.cut_planes]
    images = actuator.reflected(planes, max(device.copies, 2 ** len(planes)))
    return np.concatenate([points @ image.T for image in images])


SECTION_TURNS = 24
"""Places about its axis at which an axisymmetric section stands for the whole device."""


def usable(rows: table.PathTable) -> tuple[list[int], str]:
    """Return the steps of the first rising piece of a path, and why it ends, if not by the last requested value."""
    chosen, top = list[int](), -math.inf
    way = -1.0 if rows[-1]["pressure"] < 0.0 else 1.0
    for step, row in enumerate(rows):
        if row["bifurcation"]:
            return chosen, "bifurcation"
        if row.get("jump"):
            return chosen, "jump"
        if row["limit"]:
            return chosen, "limit point"
        pressure = way * row["pressure"]
        if pressure < top:
            return chosen, "limit point"
        if pressure > top:
            chosen.append(step)
            top = pressure
    return chosen, ""


def tip_of(case: Case, face: str, roles: Sequence[str]) -> str:
    """Return the face that is the tip; `CaseError` if the device has none, or it is not named."""
    device = case.actuator
    chosen = face or device.pushed or ("tip" if "tip" in roles else "")
    if not chosen:
        raise CaseError(f"{type(device).__name__} has no tip; name the face (face=..., --face): {', '.join(sorted(roles))}")
    if chosen not in roles:
        raise CaseError(f"the device has no face {chosen!r}; {errors.known_are(chosen, sorted(roles))}")
    return chosen


def table_of(source: StoredStates, face: str = "") -> ReducedModel:
    """Return the reduced model of a run's first rising piece, of the given tip face or the device's own.

    Raises:
        CaseError: A run of a program or in time, or no such face.
        RunError: Too few states, or one cannot be solved again.
    """
    case, rows = source.case, source.rows
    if case.program or case.load.driven is not None or case.supply is not None:
        raise CaseError("a reduced model needs a path over one pressure; run the case with pressures or added volumes")
    steps, end = usable(rows)
    if len(steps) < MIN_TABLE_STATES:
        raise RunError(
            f"the run has {len(steps)} states with rising pressure{f' before its {end}' if end else ''}; a reduced model needs "
            f"{MIN_TABLE_STATES}, so request more pressures{' below that' if end else ''}"
        )
    comm = mpi.start()
    if comm.size > 1:
        raise RunError("a reduced model is made on one process only; start it without mpirun")
    simulation = Simulation(case, comm)
    try:
        simulation.prepare_on(source.mesh)
        with notes.sentences():
            simulation.model.path_start()
            role = tip_of(case, face, [*simulation.body.entities])
            responses = Responses(simulation, role)
            states = []
            for step in steps:
                restart = source.restart(step)
                state = recording.stored_state(source, simulation.fields, comm, step, restart["P"], restart["V"])
                half_way = step == steps[len(steps) // 2]
                states.append(responses.at(state, rows[step], rate=half_way))
                if half_way:
                    middle = state
            base, mass, mode = responses.base(), responses.mass(), first_mode(simulation.model, middle)
            points = whole_points(simulation.body.actuator, simulation.fields.grid.points)
            responses.release()
    except newton.NoConvergence as failure:
        raise RunError(f"a stored state could not be solved again ({failure}); run the case again") from failure
    finally:
        simulation.release()
    model = ReducedModel(case, role, tuple(states), base, end, mass)
    model.first_mode, model.points = mode, points
    touching = (rows[step]["pressure"] for step in steps if touches(rows[step]))
    model.contact = next(touching, None)
    return model


def touches(row: table.Row) -> bool:
    """Return whether surfaces press on each other, or overlap, in a state."""
    forces = [name for name in row if re.search(r"contact", name) and row.unit(name) == "N"]
    return bool(row.get("walls_touch")) or any(abs(row[name]) > 0.0 for name in forces)


# ----------------------------------------------------------------------------------------------------------------------
# The model: the table as smooth functions of the pressure.


@dataclasses.dataclass(frozen=True, eq=False)
class TipPose:
    """What a reduced model gives for a pressure; SI units.

    Attributes:
        pressure: Pa.
        position: Of the tip, m.
        rotation: Matrix of the tip's rotation from rest.
        volume: Added volume, m3.
        compliance: See `TipState`.
        rate: Of position and rotation (in space) by the pressure, shape (6,).
        volume_rate: m3/Pa.
    """

    pressure: float
    position: Array
    rotation: Array
    volume: float
    compliance: Array
    rate: Array
    volume_rate: float

    @property
    def quaternion(self) -> Array:
        """Of the rotation; see `quaternion`."""
        return quaternion(self.rotation)


def quaternion(R: Array) -> Array:
    """Return w, x, y, z of a rotation, with w at least 0."""
    return np.asarray(Rotation.from_matrix(R).as_quat(canonical=True, scalar_first=True))
