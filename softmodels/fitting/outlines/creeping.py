"""A measured device that creeps: its states at photographs that carry times, with exact derivatives, and their residuals.

The device is driven by the pressures of its history. The true pressure of each level is a hidden parameter, of which there is
one reading, however many photographs were taken of it. Steps in time are chosen once, for branches of a usual weight, and
stay so: then states are smooth functions of the parameters, and the derivatives through all steps
(`softmodels.mechanics.sensitivity.InTime`) are those of what is computed.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from measurement.outline import outline
from softmodels.common.arrays import Array
from softmodels.fitting import problem
from softmodels.fitting.outlines import device, residuals, views
from softmodels.fitting.outlines.shapes import OutlineFitError, Shape
from softmodels.mechanics import controls, newton, sensitivity
from softmodels.mechanics.system import State
from softmodels.path import schedule, stability
from softmodels.path.continuation import Continuation


class Creep:
    """States of a device with its law and branches through its tests."""

    def __init__(self, model: device.DeviceModel, timetable: Timetable):
        self.model, self.timetable = model, timetable
        self._steps: list[list[tuple[int, float]]] = []  # of each test: the leg and which share of it is done
        self._walks: list[_Walk] = []
        self._hung, self._hung_rates = model.system.rest(), dict[str, sensitivity.Rate]()
        self.levels: dict[str, float] = {}  # derivatives of the height in m from which heights count, by parameter

    def photographs(
        self, values: Mapping[str, float], names: Sequence[str]
    ) -> dict[int, tuple[State, dict[str, sensitivity.Rate]]]:
        """Return the state of each photograph, and its derivatives by the named parameters of the model, of whose values
        and levels it is; `CannotEvaluate` if there is none."""
        assert self.model.spectrum is not None
        weightless = dict.fromkeys(self.model.spectrum.names, 0.0)
        self.model.set_parameters({**values, **weightless})
        self._hung, self._hung_rates, self.levels = self.model.apply_preload(names)
        self._steps = self._steps or [self._chosen(test, values) for test in self.timetable.tests]
        self.model.set_parameters(values)
        before: Sequence[_Walk | None] = self._walks or [None] * len(self._steps)
        walks = [
            self._walked(test, steps, values, names, base)
            for test, steps, base in zip(self.timetable.tests, self._steps, before, strict=True)
        ]
        self._walks = walks
        photographs: dict[int, tuple[State, dict[str, sensitivity.Rate]]] = {}
        for test, steps, walk in zip(self.timetable.tests, self._steps, walks, strict=True):
            for (leg, share), state, rates in zip(steps, walk.states, walk.rates, strict=True):
                if share == 1.0:
                    photographs |= dict.fromkeys(test[leg].photographs, (state, rates))
        return photographs

    @property
    def at_rest(self) -> tuple[State, dict[str, sensitivity.Rate]]:
        """The state before the tests, and its derivatives."""
        return self._hung, self._hung_rates

    def _chosen(self, test: Sequence[Leg], values: Mapping[str, float]) -> list[tuple[int, float]]:
        """Return the steps of a test: at the end of each the number of the leg and the share of it that is done."""
        model, places_and_weights = self.model, list[tuple[int, float]]()
        assert model.spectrum is not None
        model.set_parameters({**values, **dict.fromkeys(model.spectrum.names, USUAL_SHARE)})
        unit, start = model.system.stress_unit, self._state_at_rest()
        for number, leg in enumerate(test):
            rise = (leg.pressure(1.0, values) - leg.pressure(0.0, values)) / unit
            if not leg.duration:
                places_and_weights += [(number, share) for share in np.linspace(0.0, 1.0, FEWEST_STEPS + 1)[1:].tolist()]
                start = self._jumped(start, rise)
                continue
            path = Continuation(model.solver, stability.Pressure(), start=start)
            try:
                ramp = schedule.Ramp(rise, leg.duration, FEWEST_STEPS if rise else 1)
                for share, point in schedule.march(path, ramp, STEP_TOLERANCE):
                    start = point.state
                    places_and_weights += [(number, share)] if share else []
            except (stability.PathEnd, newton.NoConvergence) as end:
                raise problem.CannotEvaluate(f"the device cannot follow the pressures of its photographs: {end}") from None
        return places_and_weights

    def _state_at_rest(self, in_time: sensitivity.InTime | None = None) -> State:
        """Return the state at rest, where the device has hung for ever, and let its silicone remember only that."""
        model, state = self.model, self._hung
        model.system.potential.commit(state.w, reset=True)
        if model.loaded:
            assert model.spectrum is not None
            model.system.potential.pass_time(RELAXED_TIME_RATIO * model.spectrum.times[-1])
            if in_time is not None:
                in_time.begin(state, self._hung_rates)
            model.system.potential.commit(state.w)
        return state

    def _jumped(self, start: State, rise: float) -> State:
        model, state = self.model, start
        try:
            for share in np.linspace(0.0, 1.0, FEWEST_STEPS + 1)[1:].tolist():
                P = start.P + share * rise
                state = model.solver.solve(controls.pressure_control(P), state.w, P)
        except newton.NoConvergence as failure:
            raise problem.CannotEvaluate(f"the device cannot follow a jump of the pressure: {failure}") from None
        model.system.potential.commit(state.w)
        return state

    def _walked(
        self,
        test: Sequence[Leg],
        steps: Sequence[tuple[int, float]],
        values: Mapping[str, float],
        names: Sequence[str],
        base: _Walk | None,
    ) -> _Walk:
        """Return a test step by step, each state guessed from that of the last values."""
        model = self.model
        potential, unit = model.system.potential, model.system.stress_unit
        levels = [level for level in self.timetable.levels if any(level in leg.levels for leg in test)]
        in_time = sensitivity.InTime(model.sensitivity, [self._own(name) for name in names], levels)
        back = {self._own(name): name for name in names}
        state, along, done, walk = self._state_at_rest(in_time), None, 0.0, _Walk(dict(values), [], [])
        leg_before = 0
        for number, (leg, share) in enumerate(steps):
            done, leg_before = (0.0, leg) if leg != leg_before else (done, leg)
            potential.pass_time((share - done) * test[leg].duration)
            line = controls.pressure_control(test[leg].pressure(share, values) / unit)
            w = state.w if along is None else state.w + (line.target - state.P) * along.w
            if base is not None:
                moves = [
                    (rate, values.get(name, 0.0) - base.values.get(name, 0.0)) for name, rate in base.rates[number].items()
                ]
                w = base.states[number].w + sum(by * rate.w for rate, by in moves)
            try:
                state = model.solver.solve(line, w, line.target)
                if not state.V > 0.0:
                    raise newton.NoConvergence("a cavity would collapse")
                along, rates = in_time.step(state, line, test[leg].rises(share))
            except newton.NoConvergence as failure:
                raise problem.CannotEvaluate(f"the device cannot follow the pressures of its photographs: {failure}") from None
            potential.commit(state.w)
            walk.states.append(state)
            walk.rates.append({back.get(name, name): rate for name, rate in rates.items()})
            done = share
        return walk

    def _own(self, name: str) -> str:
        """Return what the material calls one of the model's parameters."""
        spectrum = self.model.spectrum
        assert spectrum is not None
        return f"share{spectrum.names.index(name) + 1}" if name in spectrum.names else name


STEP_TOLERANCE = 1e-4
"""Error of the stress by one step in time, over the largest stress, for branches of `USUAL_SHARE` each."""
USUAL_SHARE = 0.2
RELAXED_TIME_RATIO = 1e6
"""Time that a device has hung before its test, over its longest relaxation time."""
FEWEST_STEPS = 4
"""Minimum number of steps between two times of a history between which the pressure changes."""
LEVEL_BOUNDS = 0.5
"""Bounds of a level's true pressure, as a share of its reading."""
PRESSURE_TOLERANCE = 1e-9
"""Pressures closer than this, relative to the larger, are one level."""


@dataclasses.dataclass(frozen=True, eq=False)
class Leg:
    """Pressures between two times of a test.

    Attributes:
        duration: In s; 0 for a jump.
        pressures: Readings in Pa where it begins and ends.
        levels: Hidden parameters that stand for these pressures; empty for the reading itself.
        photographs: Numbers of the photographs that were taken at its end.
    """

    duration: float
    pressures: tuple[float, float]
    levels: tuple[str, str]
    photographs: tuple[int, ...]

    def rises(self, share: float) -> dict[str, float]:
        """Return the derivatives of the pressure after a share of the leg by the hidden parameters."""
        rises: dict[str, float] = {}
        for level, weight in zip(self.levels, (1.0 - share, share), strict=True):
            if level and weight:
                rises[level] = rises.get(level, 0.0) + weight
        return rises

    def pressure(self, share: float, values: Mapping[str, float]) -> float:
        """Return the pressure in Pa after a share of the leg."""
        ends = [values[level] if level else p for p, level in zip(self.pressures, self.levels, strict=True)]
        return ends[0] + share * (ends[1] - ends[0])


@dataclasses.dataclass(frozen=True, eq=False)
class Timetable:
    """The legs of each test of a device, each from rest on, and by name of each hidden parameter of their pressures the
    number of the first photograph of that level."""

    tests: tuple[tuple[Leg, ...], ...]
    levels: Mapping[str, int]

    @classmethod
    def of(cls, histories: Sequence[outline.History]) -> Timetable:
        """Return the timetable of photographs; one whose history is the beginning of another's is of the same test. Raises
        `OutlineFitError` for a pressure that is not above zero."""
        order = sorted(range(len(histories)), key=lambda i: (-len(histories[i]), histories[i]))
        tests: list[tuple[outline.History, dict[int, list[int]]]] = []
        for i in order:
            own = histories[i]
            test = next((test_outlines for test_outlines in tests if test_outlines[0][: len(own)] == own), None)
            if test is None:
                tests.append(test := (own, {}))
            test[1].setdefault(len(own) - 1, []).append(i)
        levels: dict[str, int] = {}
        made = []
        for corners, looks in tests:
            names = _levels(corners, looks, levels)
            legs = [
                Leg(b[0] - a[0], (a[1], b[1]), (names[k], names[k + 1]), tuple(looks.get(k + 1, ())))
                for k, (a, b) in enumerate(itertools.pairwise(corners))
            ]
            made.append(tuple(legs))
        return cls(tuple(made), levels)


def _levels(corners: outline.History, looks: Mapping[int, Sequence[int]], levels: dict[str, int]) -> list[str]:
    """Return the hidden parameter of each corner's pressure, or "", and add the new ones to ``levels``."""
    names = [""] * len(corners)
    begin = 0
    for k in range(1, len(corners) + 1):
        if k < len(corners) and abs(corners[k][1] - corners[begin][1]) <= PRESSURE_TOLERANCE * abs(corners[begin][1]):
            continue
        seen = [i for at in range(begin, k) for i in looks.get(at, ())]
        if seen:
            name = f"pressure{len(levels) + 1}"
            levels[name] = min(seen)
            names[begin:k] = [name] * (k - begin)
        begin = k
    return names


@dataclasses.dataclass(frozen=True, eq=False)
class _Walk:
    """The states of one test at parameter values, with all derivatives, step by step."""

    values: dict[str, float]
    states: list[State]
    rates: list[dict[str, sensitivity.Rate]]


class CreepingResiduals(residuals.OutlineResiduals):
    """Residuals of a device that creeps against outlines that carry times, `OutlineFitError` for one without; the hidden
    parameters are the levels' pressures."""

    def __init__(self, model: device.DeviceModel, shapes: Sequence[Shape], label: str = "outlines", device: str = ""):
        if without := [shape.source for shape in shapes if not shape.history]:
            raise OutlineFitError(
                f"{without[0]} has no times, which a fit of the memory needs: measure again with the columns hold and rise in "
                "the list of photographs, or leave it out"
            )
        super().__init__(model, shapes, label, device)

    def _hidden(self) -> tuple[list[int], tuple[str, ...]]:
        timetable = Timetable.of([shape.history for shape in self.shapes])
        self.creep = Creep(self.model, timetable)
        self._found: dict[int, tuple[State, dict[str, sensitivity.Rate]]] = {}
        return [*timetable.levels.values()], tuple(timetable.levels)

    def hidden_parameters(self, volumes: Sequence[float] | Array, hangs: float = 0.0) -> list[problem.Parameter]:
        """Return the hidden pressures of the levels in Pa, starting at their readings."""
        return [
            problem.Parameter(
                self.named(name), "Pa", shape.pressure, (1 - LEVEL_BOUNDS) * shape.pressure,
                (1 + LEVEL_BOUNDS) * shape.pressure, hidden=True,
                title=f"the pressure of {shape.name}", device=self.device,
            )
            for name, shape in zip(self._volumes, [self.shapes[i] for i in self.read], strict=True)
        ]  # fmt: skip

    def _states(self, own: Mapping[str, float]) -> list[State]:
        names = [name for name in self.model.common if self.named(name) not in self.fixed]
        self._found = self._photographs(own, names)
        return [self._found[i][0] for i in range(len(self.shapes))]

    def _photographs(
        self, own: Mapping[str, float], names: Sequence[str]
    ) -> dict[int, tuple[State, dict[str, sensitivity.Rate]]]:
        return self.creep.photographs(own, names)

    def form_slopes(self, values: Mapping[str, float], name: str) -> Array:
        """Return the derivatives of the residuals by a factor of `laws.FORM_ENERGIES`, shape (n,): the tests walked anew."""
        self.matches(values)
        known = self._found, self.creep.levels
        try:
            self._found = self._photographs(self.own(values), [name])
            return super().form_slopes(values, name)
        finally:
            self._found, self.creep.levels = known

    def _slopes(self, number: int, state: State, names: Sequence[str]) -> tuple[dict[str, float], dict[str, Array]]:
        rates = self._found[number][1]
        levels, moved = self.creep.levels, self.model.silhouette.moved
        nodes = {name: moved(rate.w) for name, rate in rates.items()}
        if self.model.silhouette.counts_heights:
            nodes = {name: rate - [0.0, levels.get(name, 0.0)] for name, rate in nodes.items()}
        return {name: rate.P for name, rate in rates.items()}, nodes


class CreepingViews(views.ViewResiduals, CreepingResiduals):
    """Residuals of a device that creeps against side views that carry times; those without pressure show it before its test."""

    def _hidden(self) -> tuple[list[int], tuple[str, ...]]:
        pressed, hidden = super()._hidden()
        timetable = Timetable.of([self.shapes[i].history for i in pressed])
        self.creep = Creep(self.model, timetable)
        return [pressed[i] for i in timetable.levels.values()], (*timetable.levels, *hidden[len(pressed) :])

    _states, _slopes = CreepingResiduals._states, CreepingResiduals._slopes

    def _photographs(
        self, own: Mapping[str, float], names: Sequence[str]
    ) -> dict[int, tuple[State, dict[str, sensitivity.Rate]]]:
        pressed = [i for i, shape in enumerate(self.shapes) if not shape.resting]
        in_time = super()._photographs(own, names)
        return dict.fromkeys(range(len(self.shapes)), self.creep.at_rest) | {pressed[i]: known for i, known in in_time.items()}
