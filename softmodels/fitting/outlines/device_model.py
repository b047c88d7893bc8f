"""A device solved again and again with other parameters: its states at added volumes, or at pressures, with derivatives.

Added volumes count from the undeformed cavity. Dead loads keep their newtons whatever the parameters are; the path then begins
where the device hangs, and heights count from there (`softmodels.fitting.outlines.hanging`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from softmodels.fitting.law_parameters import LawChoice
from softmodels.fitting.outlines.hanging import Hanging
from softmodels.fitting.outlines.near_states import near
from softmodels.fitting.outlines.silhouette import Silhouette
from softmodels.fitting.problem import CannotEvaluate
from softmodels.materials.material import Material, MaterialError
from softmodels.mechanics.controls import Control, pressure_control, volume_control
from softmodels.mechanics.morphing import Reshaping
from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.sensitivity import Rate, Sensitivity
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State
from softmodels.path.continuation import Continuation, trace
from softmodels.path.points import PathEnd
from softmodels.path.quantities import DIRECT
from softmodels.results.quadratic_curve import QuadraticCurve

Array = npt.NDArray[np.float64]

SAME = 1e-9
"""Requested values closer than this, relative to the largest, are one state."""
MODULUS = 30e3
"""Shear modulus in Pa of paths that only serve the shapes of a device without loads."""


@dataclasses.dataclass(frozen=True, eq=False)
class _Solved:
    """States found together: parameter values, what was requested (SI), and derivatives by the state's identity."""

    values: dict[str, float]
    quantity: str
    requested: Array
    states: list[State]
    answers: dict[int, tuple[Rate, dict[str, Rate], float]]


@dataclasses.dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of one state's pressure (Pa) and of its curve's nodes (m), by parameter name and by what is requested.

    Attributes:
        pressure: By name.
        nodes: By name, shape (n, 3, 2).
        along_pressure: Of the pressure by the added volume (per m3); 1 if pressures are requested.
        along_nodes: Of the nodes by the added volume, or by the pressure.
    """

    pressure: dict[str, float]
    nodes: dict[str, Array]
    along_pressure: float
    along_nodes: Array


class DeviceModel:
    """Paths of one device under one law.

    Args:
        solver: The device; its material's values do not matter.
        choice: The law.
        heights_from: What heights count from, see `Hanging`.
        modulus: Shear modulus in Pa near to that of the device; matters under loads alone.

    Attributes:
        paths: How many paths have been followed.
        hanging: The device at zero pressure.
    """

    def __init__(self, solver: Solver, choice: LawChoice, heights_from: str = "", modulus: float = MODULUS):
        self.solver, self.system, self.choice = solver, solver.system, choice
        self.silhouette = Silhouette(solver.system)
        self.reshaping = Reshaping(solver.system.body, solver.system.body.actuator.variable)
        self.lengths = self.reshaping.nominal
        self.sensitivity = Sensitivity(solver, self.reshaping)
        self.hanging, self.modulus = Hanging(self.silhouette, self.sensitivity, heights_from), modulus
        self.names = (*choice.names, "poisson", *self.lengths)
        self.rest_volume = solver.system.rest().V
        self.paths = 0
        self._present: dict[str, float] = {}
        self._asked: _Solved | None = None
        self._base: _Solved | None = None

    def material(self, values: Mapping[str, float]) -> Material:
        """The material of parameter values; Poisson's ratio is the law's unless given."""
        poisson = values.get("poisson", self.choice.poisson)
        return dataclasses.replace(self.choice, poisson=poisson).material(values)

    @property
    def loaded(self) -> bool:
        """Whether the device bears dead loads."""
        return self.hanging.loaded

    def set_parameters(self, values: Mapping[str, float]) -> dict[str, float]:
        """Make these the device's material and lengths; returns the lengths.

        Raises:
            CannotEvaluate: There is no such material or device.
        """
        try:
            self.system.set_material(self.material(values))
        except MaterialError as error:
            raise CannotEvaluate(str(error)) from None
        self.hanging.couple()
        lengths = {name: values.get(name, nominal) for name, nominal in self.lengths.items()}
        if lengths and min(lengths.values()) <= 0.0:
            raise CannotEvaluate(f"a length of {min(lengths.values()):g} m makes no device")
        self.reshaping.move(lengths)
        own = {"poisson": self.system.material.poisson, **{name: values[name] for name in self.choice.names}}
        self._present = {**own, **lengths}
        return lengths

    def path(self, quantity: str) -> Continuation:
        """The path of the present parameters, from where the device hangs, not begun yet.

        Raises:
            CannotEvaluate: The device does not bear its loads.
        """
        start = self.hanging.state(self._present, self._lengths) if self.loaded else None
        self.paths += 1
        return Continuation(self.solver, DIRECT[quantity], start=start)

    def height(self, state: State) -> float:
        """How high the apex stands above the zero plane at a state of the present parameters, in m."""
        return float(self.curve(state, self._lengths).nodes[0, 0, 1])

    def told(self, values: Mapping[str, float]) -> str:
        """The dead loads, and what heights count from; or that a weight is missing. A sentence, or empty."""
        lengths = self.set_parameters(values)
        return self.hanging.told(self._present, lengths)

    @property
    def _lengths(self) -> dict[str, float]:
        return {name: self._present[name] for name in self.lengths}

    def states(
        self, values: Mapping[str, float], requested: Sequence[float] | Array, quantity: str = "volume"
    ) -> list[State]:
        """The states with added volumes in m3, or at pressures in Pa, in any order, on one path.

        Raises:
            CannotEvaluate: One of them is not on the path.
        """
        eq = self.system
        self.set_parameters(values)
        unit = eq.volume_unit if quantity == "volume" else eq.stress_unit
        wanted = np.asarray(requested, dtype=float) / unit
        if not np.isfinite(wanted).all() or (wanted.min() <= 0.0 and not (self.loaded and quantity == "volume")):
            raise CannotEvaluate(f"an added {quantity} is not above zero")
        order = np.argsort(wanted)
        goals: list[float] = []
        place = np.empty(len(wanted), dtype=int)
        for i in order:
            if not goals or wanted[i] - goals[-1] > SAME * abs(wanted[order[-1]]):
                goals.append(float(wanted[i]))
            place[i] = len(goals) - 1
        found = self._nearby(values, goals, quantity, place) or self._followed(goals, quantity)
        states = [found[i] for i in place]
        self._asked = _Solved(dict(values), quantity, np.asarray(requested, dtype=float), states, {})
        return states

    def begins(self, path: Continuation) -> float:
        """Added volume at which a path begins, dimensionless: that of the hanging device."""
        return path.start.V - self.rest_volume if path.start else 0.0

    def _followed(self, goals: Sequence[float], quantity: str) -> list[State]:
        """The states on one path from rest. Under volume control it passes limit points; pressures mean its first branch."""
        path = self.path(quantity)
        hangs = self.begins(path) if quantity == "volume" else 0.0
        if goals[0] <= hangs:
            raise CannotEvaluate("an added volume is not above that at which the device hangs")
        try:
            return [point.state for point in trace(path, goals) if point.requested]
        except (PathEnd, NoConvergence) as end:
            raise CannotEvaluate(f"no equilibrium at an added {quantity} that was measured: {end}") from None

    def _nearby(
        self, values: Mapping[str, float], goals: Sequence[float], quantity: str, place: npt.NDArray[np.int64]
    ) -> list[State]:
        """The states one by one from those at the last values that had all derivatives; empty if one of them fails.

        A fit's steps are small: Newton's method from the linear guess needs no path. Only states that it finds at once count.
        """
        asked = self._asked
        if asked is not None and len(asked.answers) == len({id(state) for state in asked.states}):
            self._base = asked
        base = self._base
        if base is None or base.quantity != quantity or len(base.states) != len(place):
            return []
        eq, found = self.system, []
        unit = eq.volume_unit if quantity == "volume" else eq.stress_unit
        for goal, i in zip(goals, [int(np.argmax(place == k)) for k in range(len(goals))], strict=True):
            state, (along, rates, stress) = base.states[i], base.answers[id(base.states[i])]
            ahead = goal * unit - base.requested[i]
            moves = [(rate, values.get(name, 0.0) - base.values.get(name, 0.0)) for name, rate in rates.items()]
            w = state.w + ahead * along.w + sum(by * rate.w for rate, by in moves)
            P = state.P * stress + ahead * along.P + sum(by * rate.P for rate, by in moves)
            line = volume_control(goal + self.rest_volume) if quantity == "volume" else pressure_control(goal)
            closest = near(self.solver, state, line, w, P / eq.stress_unit)
            if closest is None:
                return []
            found.append(closest)
        self.paths += 1
        return found

    def curve(self, state: State, lengths: Mapping[str, float]) -> QuadraticCurve:
        """The outer curve of a state of the present parameters above the zero plane, in m."""
        curve = self.silhouette.curve(state, lengths)
        level = self.hanging.level(self._present, self._lengths)
        return QuadraticCurve(curve.nodes - [0.0, level]) if level else curve

    def pressure(self, state: State) -> float:
        """In Pa."""
        return state.P * self.system.stress_unit

    def slopes(self, state: State, names: Sequence[str], quantity: str = "volume") -> Slopes:
        """Derivatives of a state of the present values (see `set_parameters`), at fixed added volume or at fixed pressure.

        Raises:
            CannotEvaluate: The linear solver failed.
        """
        eq = self.system
        levels = self.hanging.level_rates(self._present, self._lengths, names)
        control: Control = volume_control(state.V) if quantity == "volume" else pressure_control(state.P)
        unit = eq.volume_unit if quantity == "volume" else eq.stress_unit
        try:
            along, rates = self.sensitivity.rates(state, control, names)
        except NoConvergence as failure:
            raise CannotEvaluate(f"a state has no derivatives: {failure}") from None
        answers = self._asked.answers if self._asked and any(state is one for one in self._asked.states) else {}
        answers[id(state)] = Rate(along.w / unit, along.P * eq.stress_unit / unit, along.V), rates, eq.stress_unit
        outline = {
            name: self.silhouette.rate(rate.w, name if name in self.lengths else "") - [0.0, levels[name]]
            for name, rate in rates.items()
        }
        pressures = {name: rate.P for name, rate in rates.items()}
        return Slopes(pressures, outline, along.P * eq.stress_unit / unit, self.silhouette.rate(along.w) / unit)
