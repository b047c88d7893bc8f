"""A run reduced to its tip: pose, volume, stiffness and their derivatives over the pressure, from exact linear responses.

The pose of a face is the mean of its displacement and the rotation that fits it best (Kabsch 1976, doi
10.1107/S0567739476001873): R maximises tr(R^T A), A = mean of x (X - c)^T over the undeformed face. Both depend on twelve means
that are linear in the displacement, so their derivatives by loads and pressures are exact: one solve with the factorised
tangent each. Force and moment on the tip are those that do work on position and rotation, so the compliance is symmetric.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import operator
import re
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
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
from softmodels.path.steps import PRESSURE, Prescribed, Step, begins_at_rest, courses, timed
from softmodels.runs import columns, notes, recording, table
from softmodels.runs.outcomes import RunError
from softmodels.runs.simulation import Equilibrium, Model, Simulation
from softmodels.runs.states import StoredStates

type PerPressure = float | Array
"""A number; over several pressures an array with one for each."""

__all__ = ["Curves", "ReducedModel", "TipPose", "TipState", "table_of"]


class ReducedModel(cards.ResultCard):
    """A device reduced to its tip, over one pressure or over that of each cavity: ``model(5e3)``, ``model(5e3, 0, 2e3)``.

    Position, rotation and volume are cubic in between, with the exact derivatives at the table's states; compliance is a cubic
    spline.

    Attributes:
        case: What was run.
        face: The tip.
        states: The table; over several pressures a grid of them, the last pressure changing fastest.
        base: Centre of the support, m.
        end: Why the table ends: a limit point, a bifurcation; empty at the last requested value.
        not_reached: Pressures in Pa that were requested beside the table and not reached, shape (n, cavities).
        contact: Pressure in Pa of the first state in which surfaces are in contact; None if they never are.
        mass: Of the whole device with what is on it, kg.
        first_mode: In the middle of the table; None where it is not known.
        points: Of the whole device at rest, m, shape (n, 3).
        errors: Largest errors in between: position over length, angle in degrees, volume and compliance relative.
    """

    def __init__(self, case: Case, face: str, states: tuple[TipState, ...], base: Array, end: str, mass: float | None = None):
        self.case, self.face, self.states, self.base, self.end = case, face, states, base, end
        self.not_reached: Array = np.empty((0, 1))
        self.contact: PerPressure | None = None
        self.first_mode: FirstMode | None = None
        self.points: Array = np.empty((0, 3))
        self.mass = case.actuator.solid_volume * silicones.density_of(case.material) if mass is None else mass
        self.curves = Curves(states)
        self.errors = self._errors()

    def _line(self) -> str:
        low, high = self.span
        return f"of {self.case.name}: {len(self.states)} states from {in_kPa(low)} to {in_kPa(high)} kPa"

    def _figures(self) -> cards.Table:
        last, errors = self.states[-1], self.errors
        angle = math.degrees(float(np.linalg.norm(self.turns[-1])))
        place = ", ".join(f"{1e3 * x:.4g}" for x in last.position)
        return [
            ("tip at the last state", f"{place} mm"),
            ("angle there", f"{angle:.4g} deg"),
            ("added volume there", f"{', '.join(f'{volume * 1e6:.4g}' for volume in np.atleast_1d(last.volume))} ml"),
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
        if self.end:
            notes.append(f"the table ends at {in_kPa(self.states[-1].pressure)} kPa, before a {self.end}")
        if len(self.not_reached):
            places = [in_kPa(pressures) for pressures in self.not_reached[:MAX_PLACES_TOLD]]
            more = f" and {len(self.not_reached) - len(places)} more" if len(self.not_reached) > len(places) else ""
            notes.append(f"the run did not reach {'; '.join(places)}{more} kPa, and the table ends below them")
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
            f"surfaces are in contact from {in_kPa(self.contact)} kPa on: there a load that presses them together moves the "
            f"device less than its compliance predicts, a PneuNet up to seven times less; their friction is not included"
        ]

    @property
    def span(self) -> tuple[PerPressure, PerPressure]:
        """Lowest and highest pressure in Pa, of each cavity over several."""
        return plain(np.array([x[0] for x in self.curves.axes])), plain(np.array([x[-1] for x in self.curves.axes]))

    @property
    def pressures(self) -> Array:
        """Pressures of the table in Pa, shape (states,), or (states, cavities) over several."""
        return np.array([state.pressure for state in self.states])

    @property
    def names(self) -> list[str]:
        """The pressures' names: ``"pressure"``, or ``"pressure_cavity1"`` and so on over several."""
        count = len(self.curves.axes)
        return ["pressure"] if count == 1 else [f"pressure_cavity{k + 1}" for k in range(count)]

    @property
    def turns(self) -> Array:
        """Rotation vectors of the table, continued past half a turn, shape (states, 3)."""
        return self.curves.turns

    @property
    def length(self) -> float:
        """Distance in m of the tip from the support at the first state."""
        return float(np.linalg.norm(self.states[0].position - self.base)) or self.case.actuator.size

    def __call__(self, *pressures: float) -> TipPose:
        """Return the state at a pressure in Pa; over several at that of each cavity, in their order.

        Raises:
            RunError: Outside the table.
            CaseError: Another number of pressures.
        """
        axes = self.curves.axes
        if len(pressures) != len(axes):
            wanted = "one pressure" if len(axes) == 1 else f"{len(axes)} pressures, one of each cavity"
            raise CaseError(f"the reduced model takes {wanted}; it got {len(pressures)}")
        low, high = (np.atleast_1d(end) for end in self.span)
        slack = 1e-9 * (high - low)
        if not ((low - slack <= pressures) & (pressures <= high + slack)).all():
            raise RunError(
                f"{in_kPa(np.array(pressures))} kPa is outside the reduced model; it goes from {in_kPa(low)} to "
                f"{in_kPa(high)} kPa"
            )
        return self.curves.at(np.clip(pressures, low, high))

    def _errors(self) -> dict[str, float]:
        """Return the largest errors, at the states left out, of curves through every second one of each pressure: a bound of
        those of all states."""
        kept = [x[sorted({*range(0, len(x), 2), len(x) - 1})] for x in self.curves.axes]
        stays = [all(map(operator.contains, kept, np.atleast_1d(state.pressure))) for state in self.states]
        curves = Curves(list(itertools.compress(self.states, stays)))
        errors = dict.fromkeys(("position", "angle_deg", "volume", "compliance"), 0.0)
        volume = max(float(np.abs(state.volume).max()) for state in self.states) or 1.0
        for odd_state in itertools.compress(self.states, map(operator.not_, stays)):
            at = curves.at(np.atleast_1d(odd_state.pressure))
            turned = float(np.linalg.norm(Rotation.from_matrix(at.rotation.T @ odd_state.rotation).as_rotvec()))
            miss = {
                "position": float(np.linalg.norm(at.position - odd_state.position)) / self.length,
                "angle_deg": math.degrees(turned),
                "volume": float(np.abs(at.volume - odd_state.volume).max()) / volume,
                "compliance": relative(at.compliance, odd_state.compliance),
            }
            errors = {name: max(errors[name], value) for name, value in miss.items()}
        return errors

    # -- derived figures ----------------------------------------------------------------------------------------------

    def blocked(self, state: TipState) -> Array:
        """Return force (N) and moment (N m) per Pa of a held tip on what holds it, of the shape of its rate; nan if unknown."""
        known = ~np.isnan(np.diag(state.compliance))
        loads = np.full(state.rate.shape, np.nan)
        loads[known] = np.linalg.solve(state.compliance[np.ix_(known, known)], state.rate[known])
        return loads

    def effective_area(self, state: TipState) -> PerPressure:
        """Return the blocked force along the line from the support to the tip per pressure, m2, all other motions free."""
        along = (self.states[0].position - self.base) / self.length
        C = np.nan_to_num(state.compliance[:3, :3])
        return along @ state.rate[:3] / (along @ C @ along)

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
    """Smooth functions through states on a grid of pressures: within its cells cubic in each pressure. Derivatives at the nodes
    are exact where they are known; the others, and those by several pressures, are of cubic splines along the grid.

    Attributes:
        axes: Pressures of the grid in Pa, rising, one array for each pressure.
        turns: Rotation vectors of the states, continued past half a turn, shape (states, 3).
        knots: At the nodes position, rotation vector, volumes, rates and compliance, and their derivatives; an array of shape
            (*grid, 2, ..., 2, 6 + m + 6 m + 36), in which index 1 beside the grid is the derivative by that pressure.
    """

    def __init__(self, states: Sequence[TipState]):
        p = np.array([np.atleast_1d(state.pressure) for state in states])
        count, m = p.shape
        self.axes = [np.unique(column) for column in p.T]
        grid, order = [len(x) for x in self.axes], np.lexsort(p.T[::-1])
        self.turns = continued([state.rotation for state in states], grid)
        rates = np.array([np.reshape(state.rate, (6, m)) for state in states])
        turning = np.array([inverse_left_jacobian(t) @ rate[3:] for t, rate in zip(self.turns, rates, strict=True)])
        volumes = np.array([np.atleast_1d(state.volume) for state in states])
        volume_rates = np.array([np.reshape(state.volume_rate, (m, m)) for state in states])
        exact = np.concatenate([rates[:, :3], turning, volume_rates], axis=1)[order].reshape(*grid, -1, m)
        positions, compliances = (np.array([getattr(s, name) for s in states]) for name in ("position", "compliance"))
        parts = [positions, self.turns, volumes, rates.reshape(count, -1), compliances.reshape(count, -1)]
        values = np.hstack(parts)[order].reshape(*grid, -1)
        knots = np.empty((*grid, 2**m, values.shape[-1]))
        knots[..., 0, :] = values
        for by in range(1, 2**m):  # a bit for each pressure
            ways = [(axis, 1 << (m - 1 - axis)) for axis in range(m) if by & 1 << (m - 1 - axis)]
            slopes = [spline_slopes(self.axes[axis], knots[..., by ^ bit, :], axis) for axis, bit in ways]
            knots[..., by, :] = np.mean(np.array(slopes), axis=0)
            if len(ways) == 1:
                knots[..., by, : 6 + m] = exact[..., ways[0][0]]
        self.knots: Array = knots.reshape(*grid, *[2] * m, -1)

    def row(self, pressures: Array, by: int | None = None) -> Array:
        """Return the values at pressures in Pa, or their derivatives by one of these; nan where they are not known."""
        values, m = self.knots, len(self.axes)
        for axis, (x, pressure) in enumerate(zip(self.axes, pressures, strict=True)):
            k = min(max(int(np.searchsorted(x, pressure)), 1), len(x) - 1)
            weights = hermite(pressure, x[k - 1], x[k], derivative=axis == by)
            values = np.tensordot(weights, values[k - 1 : k + 1], ((0, 1), (0, m - axis)))
        return values

    def at(self, pressures: Array) -> TipPose:
        """Return the state at pressures in Pa."""
        m, row = len(self.axes), self.row(pressures)
        rates = np.column_stack([self.row(pressures, axis) for axis in range(m)])
        omega = np.linalg.solve(inverse_left_jacobian(row[3:6]), rates[3:6])
        return TipPose(
            plain(np.array(pressures)), row[:3], Rotation.from_rotvec(row[3:6]).as_matrix(), plain(row[6 : 6 + m]),
            row[-36:].reshape(6, 6), np.concatenate([rates[:3], omega]).squeeze(), plain(rates[6 : 6 + m]),
        )  # fmt: skip


def hermite(at: float, low: float, high: float, derivative: bool) -> Array:
    """Return the weights at a place of the values and slopes at the ends of an interval, shape (2, 2), or their derivatives."""
    h = high - low
    t = (at - low) / h
    if derivative:
        return np.array([[6 * t * (t - 1) / h, (1 - t) * (1 - 3 * t)], [6 * t * (1 - t) / h, t * (3 * t - 2)]])
    return np.array([[(1 + 2 * t) * (1 - t) ** 2, t * (1 - t) ** 2 * h], [t * t * (3 - 2 * t), t * t * (t - 1) * h]])


def spline_slopes(x: Array, values: Array, axis: int) -> Array:
    """Return the slopes along an axis of cubic splines through the known values; nan where they are not known."""
    lines = np.moveaxis(values, axis, 0)
    flat = lines.reshape(len(x), -1)
    slopes = np.full_like(flat, np.nan)
    for known, lines_there in alike(np.isfinite(flat)):
        slopes[np.ix_(known, lines_there)] = CubicSpline(x[known], flat[known][:, lines_there])(x[known], 1)
    return np.moveaxis(slopes.reshape(lines.shape), 0, axis)


def plain(values: Array) -> PerPressure:
    """Return values over several pressures as they are, those over a single pressure without its dimension."""
    return values if values.size > 1 else float(values.item())


def in_kPa(pressures: PerPressure) -> str:
    """Return one or several pressures in kPa, without their unit."""
    return ", ".join(f"{pressure / 1e3:.4g}" for pressure in np.atleast_1d(pressures))


def alike(known: npt.NDArray[np.bool_]) -> list[tuple[npt.NDArray[np.bool_], npt.NDArray[np.int64]]]:
    """Return the columns that are known in the same rows, with these rows, where there are enough for a curve."""
    patterns = np.unique(known.T, axis=0)
    return [(row, np.flatnonzero((row == known.T).all(axis=1))) for row in patterns if row.sum() > 1]


def continued(rotations: Sequence[npt.NDArray[np.float64]], grid: Sequence[int] = ()) -> Array:
    """Return the rotation vectors of a sequence of matrices, each the closest to the one before; on a grid of several
    dimensions, of which the last changes fastest, to that of the node before in one of them."""
    vectors = [Rotation.from_matrix(rotations[0]).as_rotvec()]
    for k, R in enumerate(rotations[1:], 1):
        last = int(np.flatnonzero(np.unravel_index(k, grid or (len(rotations),)))[-1])
        before = vectors[k - int(np.prod(grid[last + 1 :]))]
        plain = Rotation.from_matrix(R).as_rotvec()
        angle = float(np.linalg.norm(plain))
        axis = plain / angle if angle > 1e-12 else _axis(before)
        ways = [(angle + 2 * math.pi * turns) * axis for turns in (-2, -1, 0, 1, 2)]
        vectors.append(min(ways, key=lambda way: float(np.linalg.norm(way - before))))
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
MIN_TABLE_STATES, MIN_GRID = 4, 3
"""Fewest states of a path, and of each pressure on a grid."""
MAX_PLACES_TOLD = 4
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

    def at(self, state: State, row: table.Row, pressures: Array | None = None, rate: bool = False) -> TipState:
        """Return a state of the table over one pressure, or over ``pressures`` in Pa of all cavities, from a guess of it, with
        or without the rate of its compliance."""
        solver, system = self.solver, self.system
        ratios = np.array(system.body.actuator.ratios)
        axes = ratios[:, None] if pressures is None else np.eye(len(ratios))  # the cavities' pressures by the table's
        if pressures is None:
            pressures = np.array([system.direction * state.P * system.stress_unit + 0.0])  # no -0
        control = controls.pressure_control(state.P)
        state = solver.solve(control, state.w, state.P)
        solver.factorise(state)
        solver.tangent(state, control, RESPONSE_TOLERANCE)
        position, R, rates = self.tip.pose(state)
        stress, n = system.stress_unit, system.n
        compliance = self._compliance(state, rates, touches(row))
        pushes = np.array([push.copy() for push in system.pressure_loads()[: len(axes)]])
        moved = np.transpose([solver.linear_response(push, 0.0, RESPONSE_TOLERANCE).w[:n] for push in pushes])
        jacobian = rates @ (self.tip.vectors @ moved) / stress
        added = [row[name] for name in columns.of_cavities(row, "added_volume")]
        volume = axes.T @ added if len(added) == len(axes) else added
        volume_rate = axes.T @ (pushes @ moved) @ axes * system.volume_unit / stress
        return TipState(
            plain(pressures), plain(np.array(volume)), position, R, plain(volume_rate), (jacobian @ axes).squeeze(), jacobian,
            compliance, self._spread(state, rates, axes.T @ pushes), row["max_stretch"],
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

    def _spread(self, state: State, rates: Array, swellings: Array) -> Array:
        """Return the half widths of the 95 % intervals of position, rotation and volumes at fixed pressures; ``swellings`` are
        the volumes' derivatives by the displacement, shape (m, n)."""
        errors, known, system = self.case.band, self._sensitivity, self.system
        if known is None or not isinstance(errors, materials.MaterialErrors):
            return np.full(6 + len(swellings), np.nan)
        moves = []
        for root in errors.roots.T:
            force, dmu = np.zeros(system.n), 0.0
            for name, change in zip(errors.names, root, strict=True):
                own, slope = known.material_force(name)
                force, dmu = force + change * own, dmu + change * slope
            response = self.solver.linear_response(-force, -state.P * dmu / system.stress_unit, RESPONSE_TOLERANCE)
            moved = response.w[: system.n]
            moves.append(np.append(rates @ (self.tip.vectors @ moved), swellings @ moved * system.volume_unit))
        return units.HALF_WIDTH_95 * np.linalg.norm(moves, axis=0)


@dataclasses.dataclass(frozen=True, eq=False)
class TipState:
    """A state of the table, SI units, device coordinates. Over several pressures, there is a number for each where over one
    there is a single one.

    Attributes:
        pressure: Pa; over several shape (m,).
        volume: Added volume, m3; over several of each cavity, shape (m,).
        position: Of the tip's centre, m.
        rotation: Of the tip, a matrix.
        volume_rate: By the pressure, m3/Pa; shape (m, m).
        rate: Of position and rotation by the pressure: m/Pa and rad/Pa, shape (6,), or (6, m).
        jacobian: The same by the pressure of each cavity, shape (6, cavities).
        compliance: Of position and rotation by force and moment on the tip at constant pressure, shape (6, 6); nan for loads
            against the symmetry of the slice.
        spread: Half widths of the 95 % intervals of position, rotation and volume, shape (6 + m,); nan without errors of the
            material.
        stretch: Largest stretch.
        compliance_rate: Derivative of the compliance by a dead force on the tip, shape (6, 6, 3), nan where it is not known;
            only in the middle of the table, and without contact, else None.
    """

    pressure: PerPressure
    volume: PerPressure
    position: Array
    rotation: Array
    volume_rate: PerPressure
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
        pressure: Pa; over several pressures that of each, shape (m,).
        frequency: Hz.
        damping: Its damping ratio by the branches of the silicone; 0 where they are not known.
    """

    pressure: PerPressure
    frequency: float
    damping: float


def first_mode(model: Model, state: State, pressure: PerPressure) -> FirstMode | None:
    """Return the first mode of a device at a state with one or several pressures in Pa; None if it has no mass, or the mode is
    unstable or not found."""
    try:
        mode = model.modes(Equilibrium(model, state), 1)[0]
    except (CaseError, RunError):
        return None
    return FirstMode(pressure, mode.frequency, mode.damping) if mode.frequency > 0.0 else None


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


# ----------------------------------------------------------------------------------------------------------------------
# Over the pressure of each cavity: a program that visits a grid of them.


def grid_case(source: StoredStates, count: int) -> Case:
    """Return a run's case with a program over a grid of each cavity's pressure, from 0 to the run's highest, ``count`` of each.

    Boxes that grow from rest are visited one after the other, so a run that ends has reached all smaller pressures.
    """
    case, rows = source.case, source.rows
    if case.name.endswith(GRID_SUFFIX) and case.program:
        raise CaseError("the run has gone over a grid already; leave out the grid, or take another one of the run before it")
    if case.supply is not None or timed(case.steps) or case.load.driven is not None:
        raise CaseError("a grid of pressures needs a run over pressures at rest; run the case with pressures of its cavities")
    check_unique(case)
    if count < MIN_GRID:
        raise CaseError(f"grid is {count}; it must be {MIN_GRID} or more pressures of each cavity")
    if (number := len(case.actuator.ratios)) < 2:
        raise CaseError(f"the device has {number} cavit{'y' if number == 1 else 'ies'}; leave out the grid")
    stable = rows if case.program else [rows[step] for step in usable(rows)[0]]
    known = np.array([[row[name] for name in columns.of_cavities(row, "pressure")] for row in stable])
    reached = known if known.shape[1] == number else known * np.array(case.actuator.ratios)
    ends = reached[np.abs(reached).argmax(axis=0), range(number)]
    if not ends.all():
        raise CaseError(f"the run leaves cavity{int(np.argmin(np.abs(ends))) + 1} at 0; a grid needs its highest pressure")
    places = sorted(itertools.product(range(count), repeat=number), key=lambda place: (max(place), place))
    steps = [
        Step(tuple(Prescribed(PRESSURE, (share * end / (count - 1),), f"cavity{k + 1}")
                   for k, (share, end) in enumerate(zip(place, ends.tolist(), strict=True))))
        for place in places
    ]  # fmt: skip
    return dataclasses.replace(case, steps=tuple(steps), name=f"{case.name}{GRID_SUFFIX}")


GRID_SUFFIX = "-grid"


def check_unique(case: Case) -> None:
    """Raise `CaseError` for friction, with which a state depends on the pressures before it."""
    if rubs := next((part.where for part in case.components if part.remembers), ""):
        raise CaseError(
            f"with the friction of {rubs} the states depend on the order of the pressures, so no grid of them is reduced; "
            "leave the friction out, or reduce a path over one pressure"
        )


def grid_of(source: StoredStates) -> tuple[dict[int, Array], Array]:
    """Return the states on the largest grid of pressures that a program has reached, by their steps, with the pressures in Pa;
    and the pressures of the program that it has not reached, shape (n, cavities)."""
    case, count = source.case, len(source.case.actuator.ratios)
    check_unique(case)
    drivers = {driver.of: driver for driver in courses(case.steps)}
    if timed(case.steps) or {*drivers} != {f"cavity{k + 1}" for k in range(count)} or any(
        driver.quantity != PRESSURE for driver in drivers.values()
    ):  # fmt: skip
        raise CaseError("a reduced model needs a path over one pressure, or a program of the pressures of all cavities at rest")
    program = [(0.0,) * count, *zip(*(drivers[f"cavity{k + 1}"].values for k in range(count)), strict=True)]
    first, reached = int(begins_at_rest(case.steps)), dict[tuple[float, ...], int]()
    for step, row in enumerate(source.rows):
        number = round(row["load_step"])
        if number == row["load_step"] and not (row["limit"] or row["bifurcation"] or row.get("jump")):
            reached.setdefault(program[number + first if number else 0], step)
    axes = [sorted({place[k] for place in reached}) for k in range(count)]
    while missing := [place for place in itertools.product(*axes) if place not in reached]:
        ends = [(k, end) for k, x in enumerate(axes) for end in {x[0], x[-1]} if end]
        k, end = max(ends, key=lambda at: len(axes[at[0]]) * sum(place[at[0]] == at[1] for place in missing))
        axes[k].remove(end)
    sizes = [len(x) for x in axes]
    if min(sizes) < (MIN_GRID if count > 1 else MIN_TABLE_STATES):
        raise RunError(
            f"the run has reached a grid of {' x '.join(map(str, sizes))} pressures of its cavities; a reduced model needs at "
            f"least {MIN_GRID} of each, so make the grid finer (--grid), or its highest pressures lower"
        )
    left = [place for place in dict.fromkeys(program) if place not in reached]
    return {reached[place]: np.array(place) for place in itertools.product(*axes)}, np.reshape(left, (len(left), count))


# ----------------------------------------------------------------------------------------------------------------------
# From the states of a run to its reduced model.


def table_of(source: StoredStates, face: str = "") -> ReducedModel:
    """Return the reduced model of a run's first rising piece, or of the grid that its program has visited, of the given tip
    face or the device's own.

    Raises:
        CaseError: A run of another program or in time, or no such face.
        RunError: Too few states, or one cannot be solved again.
    """
    case, rows = source.case, source.rows
    if case.load.driven is not None or case.supply is not None:
        raise CaseError("a reduced model needs a path over one pressure; run the case with pressures or added volumes")
    if case.program:
        (grid, not_reached), end = grid_of(source), ""
        steps = list(grid)
    else:
        grid, not_reached = {}, np.empty((0, 1))
        steps, end = usable(rows)
    if len(steps) < MIN_TABLE_STATES:
        raise RunError(
            f"the run has {len(steps)} states with rising pressure{f' before its {end}' if end else ''}; a reduced model needs "
            f"{MIN_TABLE_STATES}, so request more pressures{' below that' if end else ''}"
        )
    comm = mpi.start()
    if comm.size > 1:
        raise RunError("a reduced model is made on one process only; start it without mpirun")
    simulation, mode = Simulation(case, comm), None
    try:
        simulation.prepare_on(source.mesh)
        with notes.sentences():
            simulation.model.path_start()
            role = tip_of(case, face, [*simulation.body.entities])
            responses = Responses(simulation, role)
            states, middle = [], steps[len(steps) // 2]
            if grid:  # the node in the middle of each pressure
                sizes = [len(np.unique(column)) for column in np.transpose([*grid.values()])]
                middle = steps[int(np.ravel_multi_index([size // 2 for size in sizes], sizes))]
            for step in steps:
                state, pressures = restored(simulation, source, step, grid.get(step)), grid.get(step)
                states.append(responses.at(state, rows[step], pressures, rate=step == middle))
                if step == middle:
                    mode = first_mode(simulation.model, state, states[-1].pressure)
            base, mass = responses.base(), responses.mass()
            points = whole_points(simulation.body.actuator, simulation.fields.grid.points)
            responses.release()
    except newton.NoConvergence as failure:
        raise RunError(f"a stored state could not be solved again ({failure}); run the case again") from failure
    finally:
        simulation.release()
    model = ReducedModel(case, role, tuple(states), base, end, mass)
    model.first_mode, model.points, model.not_reached = mode, points, not_reached
    touching = (state.pressure for state, step in zip(states, steps, strict=True) if touches(rows[step]))
    model.contact = next(touching, None)
    return model


def restored(simulation: Simulation, source: StoredStates, step: int, pressures: Array | None) -> State:
    """Return a stored state, its P that of a path, or of cavities that are coupled in the ratio of pressures in Pa."""
    P = source.restart(step)["P"]
    if pressures is not None:
        system, top = simulation.solver.system, float(np.abs(pressures).max())
        dead = system.coupling.fixed_pressures[len(pressures) :]
        system.coupling = controls.Coupling.proportional(list(pressures / top if top else system.ratios), dead)
        P = top / system.stress_unit
    return recording.stored_state(source, simulation.fields, simulation.comm, step, P, 0.0)


def touches(row: table.Row) -> bool:
    """Return whether surfaces press on each other, or overlap, in a state."""
    forces = [name for name in row if re.search(r"contact", name) and row.unit(name) == "N"]
    return bool(row.get("walls_touch")) or any(abs(row[name]) > 0.0 for name in forces)


# ----------------------------------------------------------------------------------------------------------------------
# The model: the table as smooth functions of the pressure.


@dataclasses.dataclass(frozen=True, eq=False)
class TipPose:
    """What a reduced model gives for a pressure, or for several; SI units, shapes as in `TipState`.

    Attributes:
        pressure: Pa.
        position: Of the tip, m.
        rotation: Matrix of the tip's rotation from rest.
        volume: Added volume, m3.
        compliance: See `TipState`.
        rate: Of position and rotation (in space) by the pressure.
        volume_rate: m3/Pa.
    """

    pressure: PerPressure
    position: Array
    rotation: Array
    volume: PerPressure
    compliance: Array
    rate: Array
    volume_rate: PerPressure

    @property
    def quaternion(self) -> Array:
        """Of the rotation; see `quaternion`."""
        return quaternion(self.rotation)


def quaternion(R: Array) -> Array:
    """Return w, x, y, z of a rotation, with w at least 0."""
    return np.asarray(Rotation.from_matrix(R).as_quat(canonical=True, scalar_first=True))
