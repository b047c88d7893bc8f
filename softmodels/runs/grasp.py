"""A rigid object, free in a plane, between equal fingers at equal angles around it: poses, forces, and the load that it bears.

One finger is meshed. Finger i is its copy, turned by the angle a_i about the object's axis through its first place; it has a
state of its own. With the object's displacement d and rotation t in the plane, finger i sees the object displaced by R(-a_i) d
and rotated by t, and presses on it with the force f_i and the moment m_i in its own frame. Equilibrium of the object are three
equations for d and t,

    sum R(a_i) f_i + load = 0,     sum m_i = 0,

solved by Newton's method with Broyden's updates around the equilibria of the fingers. Friction is that of the contact, with
the history in the object's frame, so that it is carried along.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence

import numpy as np

from softmodels.case.case import Case
from softmodels.common import commands, errors, units
from softmodels.common.arrays import Array
from softmodels.common.lazy import scipy
from softmodels.components import contact, shapes
from softmodels.components.pressing import FrictionHistory, Rubbed
from softmodels.mechanics import assembly, component, controls, mpi, newton
from softmodels.mechanics.system import State
from softmodels.path.steps import PRESSURE
from softmodels.runs import simulation
from softmodels.runs.outcomes import RunError

DEFAULT_STEPS, MIN_STEP = 10, 1 / 64
"""Steps to a pressure or to the load, and the shortest one in theirs."""


class Grasp:
    """Equal fingers around an object: the case of one with its pressures and the label of a rigid cylinder that it presses on,
    the direction of the load on that in the plane, and the steps to a pressure or to the load; friction depends on these to
    first order."""

    def __init__(self, case: Case, label: str, fingers: int, direction: Array, steps: int = DEFAULT_STEPS):
        chosen = check_grasp(case, label, fingers, direction)
        self.shape = HeldShape(**{field.name: getattr(chosen, field.name) for field in dataclasses.fields(chosen)})
        parts: tuple[component.Component, ...] = tuple(self.shape if part is chosen else part for part in case.components)
        self.model = simulation.Model.of(case, simulation.meshed(case.actuator, mpi.start()), components=parts)
        self.solver, self.system = self.model.solver, self.model.system
        term = self.system.potential.terms[self.shape.label]
        assert isinstance(term, HeldTerm)
        self.case, self.term, self.steps = case, term, steps
        self.axis = self.shape.form.numbers(1.0)[1]
        self.angles = 2 * math.pi * np.arange(fingers) / fingers
        first = direction - (direction @ self.axis) * self.axis
        self.along = first / np.linalg.norm(first)
        self.plane = np.array([self.along, np.cross(self.axis, self.along)])
        size, stress = self.system.length_unit, self.system.stress_unit
        self.force_unit, self.moment_unit = stress * size**2, stress * size**3
        (cut,) = [p.name for p in case.actuator.cut_planes if abs(np.asarray(p.normal) @ self.axis) > 1 - 1e-9][:1]
        self.section = assembly.FaceNodes(self.model.body, self.system.space, [cut])

    def rest(self) -> Held:
        """Return the fingers without pressure."""
        none, n, away = np.zeros(len(self.angles)), len(self.angles), np.zeros((0, 2))
        states, grips = [self.system.rest()] * n, [self.term.history] * n
        return Held(0.0, 0.0, np.zeros(2), 0.0, np.zeros((n, 2)), none, none, none, away, away, states, grips)

    def _put(self, pose: Array, finger: int, grip: FrictionHistory) -> None:
        away = pose[:2] @ self.plane
        back = turning(self.axis, -self.angles[finger])
        self.term.place(back @ away, turning(self.axis, pose[2]), grip)

    def at(self, pose: Array, P: float, load: float, before: Held) -> Held:
        """Return the fingers' equilibria around the object in a pose: two displacements in sizes, a rotation."""
        states, pushes = [], []
        for finger in range(len(self.angles)):
            self._put(pose, finger, before.grips[finger])
            states.append(self.solver.solve(controls.pressure_control(P), before.states[finger].w, P))
            pushes.append(self.term.pushes(states[-1].w))
        size, turns = self.system.length_unit, [self.plane @ turning(self.axis, angle) for angle in self.angles]
        sides = list(zip(turns, pushes, strict=True))
        press = [np.linalg.norm(push.pressing, axis=1).sum() for push in pushes]
        return Held(
            P * self.system.stress_unit, load, pose[:2] * size, float(pose[2]),
            self.force_unit * np.array([turn @ push.force for turn, push in sides]),
            self.moment_unit * np.array([self.axis @ push.moment for push in pushes]),
            self.force_unit * np.array(press), np.array([push.sliding for push in pushes]),
            size * np.concatenate([push.arms @ turn.T for turn, push in sides]),
            self.force_unit * np.concatenate([push.pressing @ turn.T for turn, push in sides]), states, before.grips,
        )  # fmt: skip

    def _pose(self, held: Held) -> Array:
        return np.array([*held.moved / self.system.length_unit, held.turned])

    def imbalance(self, held: Held) -> Array:
        """Return force in N in the plane's two directions, and moment in N times size, on the object."""
        along, across = held.forces.sum(axis=0)
        return np.array([along + held.load, across, held.moments.sum() / self.system.length_unit])

    def balanced(self, P: float, load: float, before: Held) -> Held:
        """Return the equilibrium at a pressure and a load, friction remembering ``before``; `NoConvergence` if there is none
        near."""
        held = self.at(self._pose(before), P, load, before)
        wrong, J = self.imbalance(held), None
        for _ in range(MAX_UPDATES):
            if np.abs(wrong).max() <= BALANCE_TOLERANCE * max(held.press.sum(), abs(load), 1e-6):
                return self._kept(held)
            if J is None:
                columns = []
                for k in range(3):
                    pose, begun = self._pose(held) + PROBE_STEP * np.eye(3)[k], before.grips
                    nudged = self.at(pose, P, load, dataclasses.replace(held, grips=begun))
                    columns.append((self.imbalance(nudged) - wrong) / PROBE_STEP)
                J = np.array(columns).T
            step = -np.linalg.lstsq(J, wrong, rcond=1e-6)[0]
            if not 0.0 < np.abs(step).max() < 0.2:  # 0 where no finger resists
                raise newton.NoConvergence("the object leaves the fingers")
            after = self.at(self._pose(held) + step, P, load, held)
            imbalance = self.imbalance(after)
            J = J + np.outer(imbalance - wrong - J @ step, step) / (step @ step)
            held, wrong = after, imbalance
        raise newton.NoConvergence("the object's equilibrium was not found")

    def _kept(self, held: Held) -> Held:
        grips = []
        for finger, state in enumerate(held.states):
            self._put(self._pose(held), finger, held.grips[finger])
            self.term.commit(state.w)
            grips.append(self.term.history)
        return dataclasses.replace(held, grips=grips)

    def follow(self, start: Held, P: float, load: float) -> Iterator[Held]:
        """Yield the equilibria on the way from one to a pressure (in shear moduli) and a load (in N), as far as it goes."""
        P0 = start.states[0].P
        done, step, here = 0.0, 1 / self.steps, start
        while done < 1.0:
            share = min(step, 1.0 - done)
            try:
                at = done + share
                here = self.balanced(P0 + at * (P - P0), start.load + at * (load - start.load), here)
            except newton.NoConvergence:
                step = share / 2
                if step < MIN_STEP / self.steps:
                    return
                continue
            done, step = done + share, min(2 * share, 1 / self.steps)
            yield here

    def outlines(self, held: Held) -> list[Array]:
        """Return the corners of the fingers' facets in the plane, in m from the object's first centre, shape (f, 3, 2) each."""
        outlines = []
        for angle, state in zip(self.angles, held.states, strict=True):
            places = self.section.moved(state.w) - self.term.centre
            turned = places @ (self.plane @ turning(self.axis, angle)).T
            outlines.append(turned[self.section.facets[:, :3]] * self.system.length_unit)
        return outlines


MAX_FINGERS = 12
BALANCE_TOLERANCE = 1e-7
"""Residual of the object's equilibrium, relative to the sum of the fingers' forces."""
PROBE_STEP = 1e-5
"""Displacement in sizes, and rotation, by which the fingers' stiffness is measured."""
MAX_UPDATES = 12


class GraspError(errors.OptionMessage, ValueError):
    """No grasp can be computed; the message is for the user."""


class HeldTerm(contact.RubbingShapeTerm):
    """The contact with a shape that has been moved in the plane, in sizes in device coordinates, and turned, shape (3, 3)."""

    def __init__(self, shape: contact.RigidShape, standing: contact.StandingTerm, setting: component.FormContext):
        self.moved, self.turn = np.zeros(3), np.eye(3)
        self.centre = np.asarray(shape.at) / setting.body.actuator.size
        super().__init__(shape, standing, setting)

    def place(self, moved: Array, turn: Array, grip: FrictionHistory) -> None:
        """Set where the shape is, and the friction's history."""
        self.moved, self.turn, self.history = moved, turn, grip
        self.forget_state()

    def _back(self, places: Array) -> Array:
        """Return places as the shape in its first place sees them."""
        return np.asarray((places - self.centre - self.moved) @ self.turn + self.centre)

    def pressed(self, places: Array) -> Rubbed:
        return super().pressed(self._back(places))

    def forces_here(self) -> Array:
        return np.asarray(super().forces_here() @ self.turn.T)

    def stiffness_here(self) -> scipy.sparse.csr_array:
        return self._turned(super().stiffness_here())

    def whole_stiffness_here(self) -> scipy.sparse.csr_array:
        return self._turned(super().whole_stiffness_here())

    def _turned(self, matrix: scipy.sparse.csr_array) -> scipy.sparse.csr_array:
        T = scipy.sparse.kron(scipy.sparse.eye_array(len(self.nodes.places)), self.turn, format="csr")
        return scipy.sparse.csr_array(T @ matrix @ T.T)

    def is_admissible(self, before: Array, after: Array) -> bool:
        return self.standing.clear(self._back(self.nodes.moved(before)), self._back(self.nodes.moved(after)))

    def pushes(self, w: Array) -> Pushes:
        """Return what the finger does to the shape in a state, of all its slices."""
        self._take(w)
        copies, pressed = contact.copies_around(self.actuator, self.standing.crossed), self._pressed
        forces, on = self.forces_here(), pressed.touching
        arms = self.nodes.moved(w) - self.centre - self.moved
        places = pressed.surface.places(pressed.nodes)[on] - self.centre
        return Pushes(
            copies * forces.sum(axis=0), copies * np.cross(arms, forces).sum(axis=0), places @ self.turn.T,
            copies * pressed.pressed.slopes()[on] @ self.turn.T, pressed.sliding,
        )  # fmt: skip


@dataclasses.dataclass(frozen=True, eq=False)
class Pushes:
    """Forces of a finger on the object, dimensionless: force and moment about the object's centre, shape (3,), its points of
    contact from there and their forces without friction, shape (k, 3), and the share of these at points that slide."""

    force: Array
    moment: Array
    arms: Array
    pressing: Array
    sliding: float


class HeldShape(contact.RigidShape):
    """A rigid shape that is moved in the plane; the same table as `RigidShape`."""

    def term(self, setting: component.FormContext) -> component.EnergyTerm:
        return HeldTerm(self, contact.SampledShapeTerm(self, setting), setting)


@dataclasses.dataclass(frozen=True, eq=False)
class Held:
    """An equilibrium of the object. Vectors in the plane are along the load, and across it.

    Attributes:
        pressure, load: Of the fingers in Pa, and on the object in N.
        moved, turned: Displacement of its centre in m, shape (2,), and rotation in rad.
        forces, moments: Of each finger on it in N, shape (fingers, 2), and about its centre in N m, shape (fingers,).
        press, sliding: Force with which each finger presses, in N, and the share of it that slides, shape (fingers,).
        arms: Points of contact from its centre in m, shape (k, 2).
        pressing: Forces there without friction in N, shape (k, 2).
        states, grips: Of the fingers, and the histories of their friction.
    """

    pressure: float
    load: float
    moved: Array
    turned: float
    forces: Array
    moments: Array
    press: Array
    sliding: Array
    arms: Array
    pressing: Array
    states: Sequence[State]
    grips: Sequence[FrictionHistory]

    def closed(self, friction: float) -> bool:
        """Return whether it is in force closure: the edges of the friction cones span all forces and moments in the plane.

        They do if a sum of all of them with factors above zero is zero, and three are independent.
        """
        wrenches = self._wrenches(friction)
        if not len(self.arms) or np.linalg.matrix_rank(wrenches, tol=1e-6) < 3:
            return False
        count = wrenches.shape[1]
        least = np.append(np.zeros(count), -1.0)
        equal = np.vstack([np.column_stack([wrenches, np.zeros(3)]), np.append(np.ones(count), 0.0)])
        above = np.column_stack([-np.eye(count), np.ones(count)])
        optimum = scipy.optimize.linprog(least, A_ub=above, b_ub=np.zeros(count), A_eq=equal, b_eq=[0.0, 0.0, 0.0, 1.0])
        return bool(optimum.status == 0 and -optimum.fun > 1e-9 / count)

    def bears(self, friction: float) -> float:
        """Return the largest load in N that the friction cones balance as the fingers press now; at least `load`."""
        press = np.linalg.norm(self.pressing, axis=1)
        if not len(press) or not friction:
            return self.load
        normal = self.pressing / press[:, None]
        across = np.column_stack([-normal[:, 1], normal[:, 0]])
        columns = np.column_stack([_wrench(self.arms, across * press[:, None] * friction).T, [1.0, 0.0, 0.0]])
        bounds = [*[(-1.0, 1.0)] * len(press), (None, None)]
        cost = np.append(np.zeros(len(press)), -1.0)
        optimum = scipy.optimize.linprog(cost, A_eq=columns, b_eq=-_wrench(self.arms, self.pressing).sum(axis=0), bounds=bounds)
        return max(float(-optimum.fun), self.load) if optimum.status == 0 else self.load

    def _wrenches(self, friction: float) -> Array:
        """Return the edges of the friction cones as forces and moments of unit size, shape (3, 2 k)."""
        press = np.linalg.norm(self.pressing, axis=1)
        normal = self.pressing / press[:, None]
        across = friction * np.column_stack([-normal[:, 1], normal[:, 0]])
        arms = self.arms / np.linalg.norm(self.arms, axis=1).max(initial=1e-300)
        return np.concatenate([_wrench(arms, normal + across), _wrench(arms, normal - across)]).T


def _wrench(arms: Array, forces: Array) -> Array:
    """Return forces and their moments, shape (k, 3)."""
    return np.column_stack([forces, arms[:, 0] * forces[:, 1] - arms[:, 1] * forces[:, 0]])


def turning(axis: Array, angle: float) -> Array:
    """Return the rotation about a unit vector, shape (3, 3)."""
    return np.asarray(scipy.spatial.transform.Rotation.from_rotvec(angle * axis).as_matrix())


def check_grasp(case: Case, label: str, fingers: int, direction: Array) -> contact.RigidShape:
    """Return the object among a case's components; `GraspError` if there is none, or it or the finger is unfit for this."""
    objects = [part for part in case.components if isinstance(part, contact.RigidShape) and label in ("", part.label)]
    if len(objects) != 1:
        known = ", ".join(part.label for part in case.components if isinstance(part, contact.RigidShape)) or "none"
        raise GraspError(
            f"a grasp needs one object, a [contact.name] with shape = 'cylinder'; the case has {known}: name it (--object)"
        )
    shape = objects[0]
    form = shape.form
    if not isinstance(form, shapes.Cylinder) or form.hollow or shape.guide:
        raise GraspError(f"{shape.where}: the object of a grasp is a fixed cylinder around which the fingers stand")
    if not 2 <= fingers <= MAX_FINGERS:
        raise GraspError(f"{fingers} fingers: a grasp has 2 to {MAX_FINGERS} (--fingers)")
    if case.actuator.dimension == 2 or not any(
        abs(np.asarray(plane.normal) @ form.axis) > 1 - 1e-9 for plane in case.actuator.cut_planes
    ):
        raise GraspError(
            f"{shape.where}: the fingers move in one plane; use a finger that a cut plane halves, and the cylinder's axis "
            "normal to it (along)"
        )
    if any(part.acceleration is not None for part in case.components):
        raise GraspError("the fingers of a grasp are turned around the object and have no weight; leave out [gravity]")
    if max(case.load.of(PRESSURE), default=0.0) <= 0.0:
        raise GraspError("a grasp needs pressures above 0 that close the fingers (pressure = '0.5,1 kPa')")
    if np.linalg.norm(np.cross(direction, form.axis)) < 1e-9 * np.linalg.norm(direction):
        raise GraspError("the load must lie in the plane of the fingers, not along the object's axis (--direction)")
    return shape


def grasp(
    case: Case, fingers: int, load: float, direction: Array, label: str = "", steps: int = DEFAULT_STEPS
) -> tuple[Grasp, list[Held]]:
    """Return the grasp, and its states: one at each requested pressure, then those on the way to the load in N, as far as it
    goes. The object is the only shape if ``label`` is empty; see `Grasp`.

    Raises:
        GraspError: Invalid input.
        RunError: The fingers do not close to the first pressure.
    """
    made = Grasp(case, label, fingers, direction, steps)
    here, states = made.rest(), []
    for pressure in [value for value in case.load.of(PRESSURE) if value > 0.0]:
        P = pressure / made.system.stress_unit
        here = [here, *made.follow(here, P, 0.0)][-1]
        if abs(here.states[0].P / P - 1) > 1e-9:
            raise RunError(
                f"the fingers do not close to {units.written(pressure)}: the object is no longer in equilibrium beyond "
                f"{case.column.full(here.pressure)}; lower the pressure, or use more fingers or friction",
                commands.EXIT_NO_EQUILIBRIUM,
            )
        states.append(here)
    if load:
        states += made.follow(here, here.states[0].P, load)
    return made, states
