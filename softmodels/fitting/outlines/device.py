"""Repeated solution of a device for changing parameters: states at added volumes or pressures, with derivatives.

Added volumes count from the undeformed cavity. Dead loads are constant in newtons; the path then starts at the
preloaded state, and heights count from there.
"""

from __future__ import annotations

import dataclasses
import math
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from geometries import Actuator, GeometryError, MeshingError, actuator
from measurement.outline import zero
from softmodels.case.case import Case
from softmodels.common import names, schema
from softmodels.common.arrays import Array
from softmodels.common.lazy import MPI
from softmodels.common.names import checked
from softmodels.components import loads
from softmodels.fitting import problem
from softmodels.fitting.curves import residuals
from softmodels.fitting.outlines import shapes
from softmodels.fitting.problem import FitError
from softmodels.materials import silicones
from softmodels.materials.laws import Material, MaterialError
from softmodels.mechanics import compiling, component, controls, mpi, newton, sensitivity
from softmodels.mechanics.body import Body, BodyError
from softmodels.mechanics.component import Component, ComponentError
from softmodels.mechanics.controls import Control
from softmodels.mechanics.sensitivity import Sensitivity
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State, System
from softmodels.path import continuation, schedule, stability
from softmodels.path.continuation import Continuation
from softmodels.path.schedule import apply_preload
from softmodels.runs import grid

SHAPE_MODULUS = 30e3
"""Shear modulus in Pa of paths used only for the shapes of a device without loads."""


class DeviceModel:
    """Paths of one device, whose material's values do not matter, under one law.

    Args:
        height_datum: What heights count from, see `UnpressurisedShape`.
        modulus: Shear modulus in Pa near to that of the device; matters only under dead loads.
        spectrum: Relaxing branches of the silicone, whose weights are parameters; paths without times leave them relaxed.
        seen: What of it photographs show.

    Attributes:
        paths: How many paths have been followed.
        hanging: The device at zero pressure.
        common: Names of the silicone's parameters, which several devices share.
        lengths: Nominal values in m of the lengths that a fit may vary; none with self-contact.
    """

    def __init__(
        self,
        solver: Solver,
        choice: problem.LawChoice,
        height_datum: str = "",
        modulus: float = SHAPE_MODULUS,
        spectrum: residuals.Spectrum | None = None,
        seen: type[shapes.Silhouette] = shapes.Silhouette,
    ):
        self.solver, self.system, self.choice = solver, solver.system, choice
        self.silhouette = seen(solver.system)
        actuator = self.system.body.actuator
        # No derivatives by lengths exist under self-contact.
        variable = () if self.system.assembled.slack else actuator.variable
        self.lengths = {name: float(getattr(actuator, name)) for name in variable}
        self.motion = sensitivity.MeshMotion(self.system.body) if self.lengths else None
        if self.motion is not None:
            self.motion.followers.append(self.system.follow_mesh)
        self.sensitivity = Sensitivity(solver, self.motion)
        self.hanging, self.modulus = UnpressurisedShape(self.silhouette, self.sensitivity, height_datum), modulus
        self.spectrum = spectrum
        self.common = (*choice.names, *(spectrum.names if spectrum else ()), "poisson")
        self.names = (*self.common, *self.lengths)
        self.rest_volume = solver.system.rest().V
        self.paths = 0
        self._present: dict[str, float] = {}
        self._asked: _SolvedStates | None = None
        self._base: _SolvedStates | None = None

    def law(self, values: Mapping[str, float]) -> Material:
        """Return the material of parameter values at equilibrium; Poisson's ratio is the law's unless given."""
        poisson = values.get("poisson", self.choice.poisson)
        return dataclasses.replace(self.choice, poisson=poisson).material(values)

    def material(self, values: Mapping[str, float]) -> Material:
        """Return the material of parameter values, with its branches; missing weights are 0."""
        if self.spectrum is None:
            return self.law(values)
        return residuals.remembering(
            self.law(values), self.spectrum, dict.fromkeys(self.spectrum.names, 0.0) | dict(values), -math.inf
        )

    @property
    def loaded(self) -> bool:
        """Whether the device has dead loads."""
        return self.hanging.loaded

    def set_parameters(self, values: Mapping[str, float]) -> None:
        """Set the device's material and lengths; `CannotEvaluate` if there are no such."""
        try:
            material = self.material(values)
        except MaterialError as error:
            raise problem.CannotEvaluate(str(error)) from None
        self.system.set_material(material)
        self.hanging.couple()
        lengths = {name: values.get(name, nominal) for name, nominal in self.lengths.items()}
        if self.motion is not None:
            try:
                device = actuator.changed(self.motion.base, lengths)
                if device != self.motion.device:
                    self.motion.move(device)
            except GeometryError as error:
                raise problem.CannotEvaluate(f"these lengths give an invalid device: {error}") from None
        own = {"poisson": self.system.material.poisson, **{name: values[name] for name in self.choice.names}}
        self._present = {**own, **lengths}
        if self.spectrum is not None and self.loaded:  # it has hung so long that nothing is left in the branches
            self.system.set_material(self.material({**values, **dict.fromkeys(self.spectrum.names, 0.0)}))
            self.hanging.state(self._present)
            self.system.set_material(material)

    def apply_preload(self, names: Sequence[str]) -> tuple[State, dict[str, sensitivity.Rate], dict[str, float]]:
        """Return where the device of the present parameters hangs, with the derivatives of state and zero of heights by
        parameters of its law; its branches have to be without weight."""
        names = [name for name in names if self.spectrum is None or name not in self.spectrum.names]
        hanging, levels = self.hanging, self.hanging.level_rates(self._present, names)
        if not self.loaded:
            return self.system.rest(), {}, levels
        return hanging.state(self._present), hanging.rates(self._present, names), levels

    def path(self, quantity: str) -> Continuation:
        """Return the path of the current parameters from the preloaded state, not started yet."""
        start = self.hanging.state(self._present) if self.loaded else None
        self.paths += 1
        return Continuation(self.solver, stability.QUANTITIES[quantity], start=start)

    def height(self, state: State) -> float:
        """Return the height of the apex above the zero plane at a state of the current parameters, in m."""
        return float(self.curve(state).nodes[0, 0, 1])

    def told(self, values: Mapping[str, float]) -> str:
        """Return a sentence on the dead loads and the zero of heights, or on a missing weight; or ""."""
        self.set_parameters(values)
        return self.hanging.told(self._present)

    def states(self, values: Mapping[str, float], requested: Sequence[float] | Array, quantity: str = "volume") -> list[State]:
        """Return the states with added volumes in m3, or at pressures in Pa, in any order, on one path; `CannotEvaluate`
        if one of them is not on it."""
        eq = self.system
        self.set_parameters(values)
        unit = eq.volume_unit if quantity == "volume" else eq.stress_unit
        wanted = np.asarray(requested, dtype=float) / unit
        if not np.isfinite(wanted).all() or (wanted.min() <= 0.0 and not (self.loaded and quantity == "volume")):
            raise problem.CannotEvaluate(f"an added {quantity} is not above zero")
        order = np.argsort(wanted)
        goals: list[float] = []
        place = np.empty(len(wanted), dtype=int)
        for i in order:
            if not goals or wanted[i] - goals[-1] > VALUE_TOLERANCE * abs(wanted[order[-1]]):
                goals.append(float(wanted[i]))
            place[i] = len(goals) - 1
        path_states = self._nearby(values, goals, quantity, place) or self._followed(goals, quantity)
        states = [path_states[i] for i in place]
        self._asked = _SolvedStates(dict(values), quantity, np.asarray(requested, dtype=float), states, {})
        return states

    def begins(self, path: Continuation) -> float:
        """Return the added volume at the start of a path, dimensionless: that of the preloaded device."""
        return path.start.V - self.rest_volume if path.start else 0.0

    def _followed(self, goals: Sequence[float], quantity: str) -> list[State]:
        """Solve the states on one path from rest. Volume control passes limit points; pressures mean its first branch."""
        path = self.path(quantity)
        hangs = self.begins(path) if quantity == "volume" else 0.0
        if goals[0] <= hangs:
            raise problem.CannotEvaluate("an added volume is not above that of the preloaded device")
        try:
            return [point.state for point in continuation.trace(path, goals) if point.requested]
        except (stability.PathEnd, newton.NoConvergence) as end:
            raise problem.CannotEvaluate(f"no equilibrium at a measured added {quantity}: {end}") from None

    def _nearby(
        self, values: Mapping[str, float], goals: Sequence[float], quantity: str, place: npt.NDArray[np.int64]
    ) -> list[State]:
        """Solve the states one by one from the last ones with all derivatives; empty if one fails. A fit's steps are
        small: Newton's method from the linear guess needs no path. Only states that it finds at once count."""
        asked = self._asked
        if asked is not None and len(asked.answers) == len({id(state) for state in asked.states}):
            self._base = asked
        base = self._base
        if base is None or base.quantity != quantity or len(base.states) != len(place):
            return []
        eq, nearby = self.system, []
        unit = eq.volume_unit if quantity == "volume" else eq.stress_unit
        for goal, i in zip(goals, [int(np.argmax(place == k)) for k in range(len(goals))], strict=True):
            state, (along, rates, stress) = base.states[i], base.answers[id(base.states[i])]
            ahead = goal * unit - base.requested[i]
            moves = [(rate, values.get(name, 0.0) - base.values.get(name, 0.0)) for name, rate in rates.items()]
            w = state.w + ahead * along.w + sum(by * rate.w for rate, by in moves)
            P = state.P * stress + ahead * along.P + sum(by * rate.P for rate, by in moves)
            line = controls.volume_control(goal + self.rest_volume) if quantity == "volume" else controls.pressure_control(goal)
            closest = near(self.solver, state, line, w, P / eq.stress_unit)
            if closest is None:
                return []
            nearby.append(closest)
        self.paths += 1
        return nearby

    def curve(self, state: State) -> grid.QuadraticCurve:
        """Return the outer curve of a state of the present parameters above the zero plane, in m."""
        curve = self.silhouette.curve(state)
        level = self.hanging.level(self._present)
        return grid.QuadraticCurve(curve.nodes - [0.0, level]) if level else curve

    def pressure(self, state: State) -> float:
        """In Pa."""
        return state.P * self.system.stress_unit

    def slopes(self, state: State, names: Sequence[str], quantity: str = "volume") -> ModelSlopes:
        """Return the derivatives of a state of the present values (see `set_parameters`), at fixed added volume or
        pressure; `CannotEvaluate` if the linear solver failed."""
        eq = self.system
        levels = self.hanging.level_rates(self._present, names)
        control: Control = controls.volume_control(state.V) if quantity == "volume" else controls.pressure_control(state.P)
        unit = eq.volume_unit if quantity == "volume" else eq.stress_unit
        try:
            along, rates = self.sensitivity.rates(state, control, names)
        except newton.NoConvergence as failure:
            raise problem.CannotEvaluate(f"a state has no derivatives: {failure}") from None
        answers = self._asked.answers if self._asked and any(state is asked_state for asked_state in self._asked.states) else {}
        answers[id(state)] = (sensitivity.Rate(along.w / unit, along.P * eq.stress_unit / unit, along.V), rates, eq.stress_unit)
        outline = {
            name: self.silhouette.moved(rate.w, rate.X) - self.silhouette.up * levels[name] for name, rate in rates.items()
        }
        pressures = {name: rate.P for name, rate in rates.items()}
        return ModelSlopes(pressures, outline, along.P * eq.stress_unit / unit, self.silhouette.moved(along.w) / unit)


# ----------------------------------------------------------------------------------------------------------------------
# Solve a state directly by Newton's method from a guess, without a path.


AT_ONCE = 6
"""Maximum Newton iterations from a guess; otherwise the path is followed."""
LARGEST_CORRECTION = 0.5
"""Maximum distance of such a state from the guess, relative to its change; beyond, it may be on another branch."""


def near(solver: Solver, base: State, line: Control, w: Array, P: float) -> State | None:
    """Return the state on a line next to a guess of the dofs, shape as `State.w`, and of the dimensionless pressure, made
    from a state of other parameters; None if it does not converge directly, or is elsewhere."""
    try:
        if solver.lagged.needs_update:
            solver.factorise(base)
        nearby_state = solver.solve(line, w, P)
    except newton.NoConvergence:
        return None
    off, change = float(np.linalg.norm(nearby_state.w - w)), float(np.linalg.norm(nearby_state.w - base.w))
    sure = off < LARGEST_CORRECTION * max(change, 1e-300) or off < 1e-3 * float(np.linalg.norm(w))
    return nearby_state if nearby_state.V > 0.0 and nearby_state.iterations <= AT_ONCE and sure else None


# ----------------------------------------------------------------------------------------------------------------------
# The preloaded state of a measured device at zero pressure, and the zero of its outlines' heights.
#
# Gravity, masses and forces are constant in newtons, so in shear moduli they change with the material: the preloaded state, and
# every state of the path, depends on the modulus. A photograph at zero pressure shows the preloaded device, whose upper edge is
# the measurement's zero. So simulated heights count from that edge too, which moves with the parameters.


MIN_WEIGHT_RATIO = 0.005
"""Pressure of a device's own weight over its height, in shear moduli, above which a fit without gravity gives a warning."""
STRAIGHT_SHARE = 0.8
"""Fraction of a shadow's width that has to be straight at zero pressure, as in the measurement's zero."""


@dataclasses.dataclass(frozen=True, eq=False)
class _UnpressurisedState:
    """The device at zero pressure: parameter values, state, outer curve; and the state's derivatives once computed."""

    values: dict[str, float]
    state: State
    curve: grid.QuadraticCurve
    rates: dict[str, sensitivity.Rate]


class UnpressurisedShape:
    """A device at zero pressure, by its silhouette and sensitivity. ``height_datum`` is one of
    `softmodels.fitting.problem.HEIGHTS_FROM`, or empty for the shadow, or for the apex where the undeformed top is not flat.

    Raises `OutlineFitError` for one of a device without loads whose top is flat: it makes no difference.

    Attributes:
        loaded: Whether it has dead loads; without any it is undeformed, and all heights count from there.
        from_apex: Whether the user has stated that heights count from the apex, so that the top need not be flat.
    """

    def __init__(self, silhouette: shapes.Silhouette, sensitivity: Sensitivity, height_datum: str = ""):
        self.silhouette, self.sensitivity = silhouette, sensitivity
        self.solver, self.system = sensitivity.solver, silhouette.system
        self.loaded = bool(self.system.dead.loads)
        if not silhouette.counts_heights:
            height_datum = "undeformed"
        if height_datum and not self.loaded and silhouette.flat:
            raise shapes.OutlineFitError(
                "--height-datum matters only with dead loads or an undeformed top that is not flat; "
                "this top is flat and the case has none, so leave it out, or add [gravity]"
            )
        self.from_apex = height_datum in ("apex", "undeformed")
        self.height_datum = height_datum or ("shadow" if silhouette.flat else "apex")
        self._now: _UnpressurisedState | None = None

    def couple(self) -> None:
        """Scale the loads to the system's current shear modulus."""
        if self.loaded:
            dead = self.system.dead
            self.system.coupling = controls.Coupling.proportional(self.system.body.actuator.ratios, dead.amounts / dead.units)

    def state(self, values: Mapping[str, float]) -> State:
        """Return the state at zero pressure of these parameters, which the system has; `CannotEvaluate` for no equilibrium
        under the dead loads."""
        return self._found(values).state

    def level(self, values: Mapping[str, float]) -> float:
        """Return the height in m above the undeformed apex that heights count from; see `state`."""
        if not self.loaded or self.height_datum == "undeformed":
            return 0.0
        curve = self._found(values).curve
        piece, weights = self._place(curve)
        return float(weights @ curve.nodes[piece, :, 1])

    def level_rates(self, values: Mapping[str, float], names: Sequence[str]) -> dict[str, float]:
        """Return the derivatives of the level by parameters; see `state`."""
        if not self.loaded:
            return dict.fromkeys(names, 0.0)
        rates, unpressurised = self.rates(values, names), self._found(values)
        if self.height_datum == "undeformed":
            return dict.fromkeys(names, 0.0)
        # The highest place moves along the curve without a first-order change of height.
        piece, weights = self._place(unpressurised.curve)
        moved = {name: self.silhouette.moved(rates[name].w, rates[name].X) for name in names}
        return {name: float(weights @ rate[piece, :, 1]) for name, rate in moved.items()}

    def rates(self, values: Mapping[str, float], names: Sequence[str]) -> dict[str, sensitivity.Rate]:
        """Return the derivatives of the state by parameters, at least these; see `state`."""
        unpressurised = self._found(values)
        if left := [name for name in names if name not in unpressurised.rates]:
            try:
                unpressurised.rates.update(self.sensitivity.rates(unpressurised.state, controls.pressure_control(0.0), left)[1])
            except newton.NoConvergence as failure:
                raise problem.CannotEvaluate(f"the state at zero pressure has no derivatives: {failure}") from None
        return unpressurised.rates

    def check(self, values: Mapping[str, float]) -> None:
        """Raise `OutlineFitError` for heights from a shadow that is not straight at zero pressure: the zero plane is then
        undefined."""
        if not self.loaded or self.height_datum != "shadow":
            return
        places, edge = shapes.edge_heights(self._found(values).curve)
        bend = float(np.ptp(edge[places[:, 0] < STRAIGHT_SHARE * self.silhouette.width]))
        if bend > zero.STRAIGHT_TOLERANCE:
            raise shapes.OutlineFitError(
                f"the top of the preloaded device is {bend * 1e3:.2g} mm from straight at zero pressure, "
                f"so no photograph shows the zero plane; choose the zero of heights: --height-datum undeformed if the "
                "zero plane is that of the undeformed top, --height-datum apex if heights are rises of the apex"
            )

    def told(self, values: Mapping[str, float]) -> str:
        """Return a sentence on the loads and the zero of heights; without loads on a missing weight; see `state`."""
        if not self.loaded:
            is_level = self.silhouette.flat or not self.silhouette.counts_heights
            apex = "" if is_level else "the undeformed top is not flat; heights count from its apex"
            return "; ".join(filter(None, (apex, self._weightless())))
        dead, level = self.system.dead, self.level(values)
        loads = ", ".join(f"{load.where} ({n:.3g} N)" for load, n in zip(dead.loads, dead.amounts, strict=True))
        side = "below" if level < 0.0 else "above"
        away = f"{abs(level) * 1e3:.3g} mm {side} the undeformed top" if level else "level with the undeformed top"
        zero = {
            "shadow": f"the upper edge of its shadow at zero pressure, {away}",
            "apex": f"its apex at zero pressure, {away}",
            "undeformed": "the undeformed top",
        }
        counted = f"; heights count from {zero[self.height_datum]}" if self.silhouette.counts_heights else ""
        return f"dead loads {loads}, given and not fitted{counted}"

    def _weightless(self) -> str:
        """Return a warning if a device without gravity is so soft that its weight matters; else ""."""
        weight = silicones.SILICONE_DENSITY * loads.STANDARD_GRAVITY * self.silhouette.tall
        share = weight / self.system.stress_unit
        if share < MIN_WEIGHT_RATIO:
            return ""
        much = f"{weight:.3g} Pa, {100 * share:.1f} % of the shear modulus"
        return (
            "the case has no [gravity], so the silicone's own weight is neglected: its pressure over the part's height "
            f"is {much}, and the error of the fit may be of that order"
        )

    def _place(self, curve: grid.QuadraticCurve) -> tuple[int, Array]:
        piece, s = shapes.crest(curve) if self.height_datum == "shadow" else (0, -1.0)
        return piece, grid.shapes(s)

    def _found(self, values: Mapping[str, float]) -> _UnpressurisedState:
        if self._now is None or self._now.values != dict(values):
            state = self._nearby(values) or self._followed()
            self._now = _UnpressurisedState(dict(values), state, self.silhouette.curve(state), {})
        return self._now

    def _nearby(self, values: Mapping[str, float]) -> State | None:
        """Return the state near that of the last values, if Newton's method finds it directly."""
        base = self._now
        # Paths for first shapes know the law's parameters only, not the lengths that a fit varies.
        if base is None or not base.rates or not base.rates.keys() <= values.keys() & base.values.keys():
            return None
        w = base.state.w + sum((values[name] - base.values[name]) * rate.w for name, rate in base.rates.items())
        return near(self.solver, base.state, controls.pressure_control(0.0), w, 0.0)

    def _followed(self) -> State:
        """Solve the state at the end of a path on which the loads grow."""
        system = self.system
        amounts = np.concatenate([np.zeros(len(system.body.actuator.ratios)), system.dead.amounts / system.dead.units])
        try:
            return schedule.inflate_from(self.solver, apply_preload(self.solver, [("its loads", amounts)]))
        except schedule.PreloadFailure as end:
            self.couple()
            raise problem.CannotEvaluate(end.sentence) from None


VALUE_TOLERANCE = 1e-9
"""Requested values closer than this, relative to the largest, share a state."""


@dataclasses.dataclass(frozen=True, eq=False)
class _SolvedStates:
    """States solved together: parameter values, requested values (SI), and derivatives by the state's identity."""

    values: dict[str, float]
    quantity: str
    requested: Array
    states: list[State]
    answers: dict[int, tuple[sensitivity.Rate, dict[str, sensitivity.Rate], float]]


@dataclasses.dataclass(frozen=True, eq=False)
class ModelSlopes:
    """Derivatives of one state's pressure (Pa) and of its curve's nodes (m, shape (n, 3, 2)), by parameter name and by
    what is requested: the added volume in m3, or the pressure, whose own is 1."""

    pressure: dict[str, float]
    nodes: dict[str, Array]
    along_pressure: float
    along_nodes: Array


# ----------------------------------------------------------------------------------------------------------------------
# Dead loads of a measured device: constant in every photograph, that at zero pressure included.


def measured_parts(
    components: Sequence[Component], actuator: Actuator, material: Material | None, upright: bool = True
) -> tuple[Component, ...]:
    """Return a case's parts for a fit, with the density of the case's silicone, if that is known, for any fitted law;
    `FitError` for a load that tilts the outline where it has to be upright, or one without a given size."""
    for load in (part for part in components if isinstance(part, controls.LoadPart)):
        _check(load, actuator, upright)
    return tuple(components) if material is None else loads.weighed(components, material)


def _check(load: controls.LoadPart, actuator: Actuator, upright: bool) -> None:
    if not isinstance(load, loads.DirectedLoad) or load.arm != 2:
        raise FitError(
            f"the case has a {load.where} that does not act along a direction; a fit takes gravity and forces, so leave it "
            "out if it is small"
        )
    if upright and not abs(float(np.asarray(load.vector) @ np.asarray(actuator.lift))) > 1 - component.IN_PLANE_TOLERANCE:
        raise FitError(
            f"the case has a {load.where} that does not act along the device's axis; fits assume symmetric "
            "outlines, so photograph the device upright, or leave out the load if it is small"
        )
    if isinstance(load, loads.FaceLoad) and not load.kept:
        raise FitError(
            f"the case has a {load.where} whose size is requested; a fit takes loads that stay the same in all photographs, so "
            'give it an amount (amount = "0.2 N"), or leave it out'
        )
    try:
        load.check_on(actuator)
    except ComponentError as error:
        raise FitError(str(error)) from None


# ----------------------------------------------------------------------------------------------------------------------
# A measured device, ready to be solved with the parameters of a law.


@checked
@dataclasses.dataclass(frozen=True)
class MeasuredDevice:
    """A measured device.

    Attributes:
        name: What reports call it.
        material: What it is known to be made of, whose modulus a fit is held against; None if that is not known.
        formulation, solver: See `softmodels.case.case.Case`.
        components: What else is added to it.
        height_datum: What heights count from where it hangs under loads or its top is not flat, see `UnpressurisedShape`.
        seen: What of it photographs show.
    """

    actuator: Actuator
    name: str = "device"
    material: Material | None = None
    formulation: str = "mixed"
    components: tuple[Component, ...] = ()
    solver: str = "auto"
    height_datum: str = ""
    seen: type[shapes.Silhouette] = shapes.Silhouette

    @classmethod
    def of(cls, device: Actuator | Case | MeasuredDevice, seen: type[shapes.Silhouette] | None = None) -> MeasuredDevice:
        """Return a device, or that of a case; an axisymmetric one whose outlines are seen as its section. Raises `FitError` for
        loads that a fit does not take."""
        seen = seen or (device.seen if isinstance(device, MeasuredDevice) else shapes.Silhouette)
        as_seen = as_section if seen.counts_heights else lambda actuator: actuator
        if isinstance(device, MeasuredDevice):
            section = as_seen(device.actuator)
            components = measured_parts(device.components, section, device.material, seen.counts_heights)
            return dataclasses.replace(device, actuator=section, components=components, seen=seen)
        if isinstance(device, Case):
            if rubbing := [part.where for part in device.components if part.remembers]:
                raise FitError(
                    f"{rubbing[0]} has friction, whose derivatives by the material are not available; leave it out "
                    "(friction = 0)"
                )
            section = as_seen(device.actuator)
            components = measured_parts(device.components, section, device.material, seen.counts_heights)
            return cls(section, device.name, device.material, device.formulation, components, device.solver, seen=seen)
        names.one_of("device", device, Actuator, "a device, such as sm.HollowDisk(), or a Case")
        return cls(as_seen(device), device.name, seen=seen)

    def counting_from(self, height_datum: str) -> MeasuredDevice:
        """Return the device with another zero of heights; see `height_datum`; empty to keep it."""
        return dataclasses.replace(self, height_datum=height_datum or self.height_datum)

    def model(self, choice: problem.LawChoice, comm: MPI.Comm, spectrum: residuals.Spectrum | None = None) -> DeviceModel:
        """Return the device under a law, perhaps with relaxing branches, meshed and compiled; `FitError` if it cannot be,
        or ``height_datum`` makes no difference to it."""
        folder = mpi.on_root(comm, lambda: Path(tempfile.mkdtemp(prefix="softmodels-")))
        mesh = folder / f"{self.name}.msh"
        try:
            mpi.on_root(comm, lambda: self.actuator.write(mesh))
            with compiling.compiling():
                body = Body.from_file(self.actuator, mesh, comm)
                material = choice.material(choice.from_modulus(30e3))
                if spectrum is not None:
                    material = residuals.remembering(material, spectrum, dict.fromkeys(spectrum.names, 0.0), -math.inf)
                system = System(body, material, self.formulation, self.components, spectrum is not None)
                modulus = self.material.shear_modulus_0 if self.material and system.dead.loads else SHAPE_MODULUS
                return DeviceModel(Solver(system, self.solver), choice, self.height_datum, modulus, spectrum, self.seen)
        except (BodyError, compiling.CompilingError, ComponentError, MeshingError, GeometryError, OSError) as error:
            raise FitError(str(error)) from error
        finally:
            mpi.on_root(comm, lambda: shutil.rmtree(folder, ignore_errors=True))


def as_section(actuator: Actuator) -> Actuator:
    """Return an axisymmetric device as its section, which gives the same outline in 1 % of the time."""
    section = schema.about(actuator).get("section")
    turns = section is not None and "axisymmetric" in getattr(section.kind, "choices", ())
    return dataclasses.replace(actuator, section="axisymmetric") if turns else actuator  # type: ignore[call-arg]
