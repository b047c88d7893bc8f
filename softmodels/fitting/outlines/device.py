"""A device solved again and again with other parameters: its states at added volumes, or at pressures, with derivatives.

Added volumes count from the undeformed cavity. Dead loads keep their newtons whatever the parameters are; the path then begins
where the device hangs, and heights count from there (`softmodels.fitting.outlines.device`).
"""

from __future__ import annotations

import dataclasses
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from geometries import Actuator, GeometryError, MeshingError
from measurement.outline.zero import STRAIGHT
from softmodels.case.case import Case
from softmodels.common.arrays import Array
from softmodels.common.calls import checked, one_of
from softmodels.common.schema import about
from softmodels.components.loads import (
    STANDARD_GRAVITY,
    DirectedLoad,
    FaceLoad,
    weighed,
)
from softmodels.fitting.outlines.shapes import OutlineFitError
from softmodels.fitting.outlines.silhouette import Silhouette, crest, edge_heights
from softmodels.fitting.problem import CannotEvaluate, FitError, LawChoice
from softmodels.materials.laws import Material, MaterialError
from softmodels.materials.silicones import SILICONE_DENSITY
from softmodels.mechanics.body import Reshaping
from softmodels.mechanics.component import ALONG, Component, ComponentError
from softmodels.mechanics.controls import (
    Control,
    Coupling,
    pressure_control,
    volume_control,
)
from softmodels.mechanics.dead_loads import LoadPart
from softmodels.mechanics.mpi import on_root
from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.sensitivity import Rate, Sensitivity
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State
from softmodels.path.continuation import Continuation, trace
from softmodels.path.points import DIRECT, PathEnd
from softmodels.path.schedule import HangingEnd, hang, inflate_from
from softmodels.runs.grid import QuadraticCurve, shapes

if TYPE_CHECKING:
    from mpi4py import MPI


# ----------------------------------------------------------------------------------------------------------------------
# A state found by Newton's method from a guess, without a path: only what it finds at once counts.


AT_ONCE = 6
"""Newton iterations in which a state has to be found from a guess, or else the path is followed."""
LARGEST_CORRECTION = 0.5
"""How far from the guess such a state may lie, as a share of its change: further, it may be another branch."""


def near(solver: Solver, base: State, line: Control, w: Array, P: float) -> State | None:
    """The state on a line next to a guess; None if it is not found at once, or lies elsewhere.

    Args:
        solver: The device.
        base: The state that the guess was made from, of other parameters.
        line: What is asked for.
        w: Guess of the dofs, shape as `State.w`.
        P: Guess of the pressure, dimensionless.
    """
    try:
        if solver.stale:
            solver.factorise(base)
        found = solver.solve(line, w, P)
    except NoConvergence:
        return None
    off, change = float(np.linalg.norm(found.w - w)), float(np.linalg.norm(found.w - base.w))
    sure = off < LARGEST_CORRECTION * max(change, 1e-300) or off < 1e-3 * float(np.linalg.norm(w))
    return found if found.V > 0.0 and found.iterations <= AT_ONCE and sure else None


# ----------------------------------------------------------------------------------------------------------------------
# Where a measured device hangs under its dead loads at zero pressure, and the height that its outlines count from.
#
# Gravity, masses and forces keep their newtons, so that in shear moduli they change with the material: where the device hangs,
# and with it every state of its path, is another one for every modulus. A photograph at zero pressure shows the device as it
# hangs, and its upper edge is the measurement's zero. So simulated heights count from that edge too, and it moves with the
# parameters.


HEAVY = 0.005
"""Pressure of a device's own weight over its height, in shear moduli, from which a fit without gravity is told of it."""
MIDDLE = 0.8
"""Share of a shadow's width that has to be straight at zero pressure, as where the measurement looks for its zero."""


@dataclasses.dataclass(frozen=True, eq=False)
class _Hung:
    """The device at zero pressure: parameter values, state, outer curve; and the state's derivatives, once asked for."""

    values: dict[str, float]
    state: State
    curve: QuadraticCurve
    rates: dict[str, Rate]


class Hanging:
    """A device at zero pressure.

    Args:
        silhouette: Its outer curve.
        sensitivity: Its derivatives.
        heights_from: One of `softmodels.fitting.problem.HEIGHTS_FROM`; empty for the shadow, or for the apex where the
            undeformed top is not flat.

    Raises:
        OutlineFitError: ``heights_from`` for a device without loads whose top is flat: it makes no difference.

    Attributes:
        loaded: Whether it has dead loads; without any it is undeformed, and all heights count from there.
        from_apex: Whether the user has stated that heights count from the apex, so that the top need not be flat.
    """

    def __init__(self, silhouette: Silhouette, sensitivity: Sensitivity, heights_from: str = ""):
        self.silhouette, self.sensitivity = silhouette, sensitivity
        self.solver, self.system = sensitivity.solver, silhouette.system
        self.loaded = bool(self.system.dead.loads)
        if heights_from and not self.loaded and silhouette.flat:
            raise OutlineFitError(
                "what heights count from (--heights-from) matters where the device hangs under loads or its undeformed top is "
                "not flat; this one is flat and the case has none, so leave it out, or add [gravity]"
            )
        self.from_apex = heights_from in ("apex", "undeformed")
        self.heights_from = heights_from or ("shadow" if silhouette.flat else "apex")
        self._now: _Hung | None = None

    def couple(self) -> None:
        """Give the loads the size that they have in the system's present shear modulus."""
        if self.loaded:
            dead = self.system.dead
            self.system.coupling = Coupling.proportional(self.system.body.actuator.ratios, dead.amounts / dead.units)

    def state(self, values: Mapping[str, float], lengths: Mapping[str, float]) -> State:
        """The state at zero pressure; the system has these parameters and lengths.

        Raises:
            CannotEvaluate: The device does not bear its loads.
        """
        return self._found(values, lengths).state

    def level(self, values: Mapping[str, float], lengths: Mapping[str, float]) -> float:
        """Height in m above the undeformed apex that heights count from; see `state`."""
        if not self.loaded or self.heights_from == "undeformed":
            return 0.0
        curve = self._found(values, lengths).curve
        piece, weights = self._place(curve)
        return float(weights @ curve.nodes[piece, :, 1])

    def level_rates(
        self, values: Mapping[str, float], lengths: Mapping[str, float], names: Sequence[str]
    ) -> dict[str, float]:
        """Derivatives of the level by parameters; see `state`.

        Raises:
            CannotEvaluate: The linear solver failed.
        """
        if not self.loaded:
            return dict.fromkeys(names, 0.0)
        hung = self._found(values, lengths)
        if left := [name for name in names if name not in hung.rates]:
            try:
                hung.rates.update(self.sensitivity.rates(hung.state, pressure_control(0.0), left)[1])
            except NoConvergence as failure:
                raise CannotEvaluate(f"the state at zero pressure has no derivatives: {failure}") from None
        if self.heights_from == "undeformed":
            return dict.fromkeys(names, 0.0)
        # A highest place moves along the curve without changing its height.
        piece, weights = self._place(hung.curve)
        moved = {name: self.silhouette.rate(hung.rates[name].w, name if name in lengths else "") for name in names}
        return {name: float(weights @ rate[piece, :, 1]) for name, rate in moved.items()}

    def check(self, values: Mapping[str, float], lengths: Mapping[str, float]) -> None:
        """Refuse heights from a shadow that is not straight at zero pressure: no photograph there has given the zero plane.

        Raises:
            OutlineFitError: It is not.
            CannotEvaluate: See `state`.
        """
        if not self.loaded or self.heights_from != "shadow":
            return
        places, edge = edge_heights(self._found(values, lengths).curve)
        bend = float(np.ptp(edge[places[:, 0] < MIDDLE * self.silhouette.width]))
        if bend > STRAIGHT:
            raise OutlineFitError(
                f"as the device hangs under its loads its top is {bend * 1e3:.2g} mm from straight at zero pressure, so that "
                "no photograph there shows the zero plane; say what heights count from: --heights-from undeformed if the "
                "zero plane is that of the undeformed top, --heights-from apex if heights are rises of the apex"
            )

    def told(self, values: Mapping[str, float], lengths: Mapping[str, float]) -> str:
        """The loads, and what heights count from, as a sentence; without loads whether the weight matters; see `state`."""
        if not self.loaded:
            apex = "" if self.silhouette.flat else "the undeformed top is not flat; heights count from its apex"
            return "; ".join(filter(None, (apex, self._weightless())))
        dead, level = self.system.dead, self.level(values, lengths)
        loads = ", ".join(f"{one.where} ({n:.3g} N)" for one, n in zip(dead.loads, dead.amounts, strict=True))
        side = "below" if level < 0.0 else "above"
        away = f"{abs(level) * 1e3:.3g} mm {side} the undeformed top" if level else "as high as the undeformed top"
        zero = {
            "shadow": f"the upper edge of its shadow at zero pressure, {away}",
            "apex": f"its apex at zero pressure, {away}",
            "undeformed": "the undeformed top",
        }
        return f"the device hangs under {loads}, given and not fitted; heights count from {zero[self.heights_from]}"

    def _weightless(self) -> str:
        """A sentence where a device without gravity is so soft that its own weight shows, else empty."""
        tall = float(np.ptp(self.silhouette.points @ np.asarray(self.system.body.actuator.lift)))
        weight = SILICONE_DENSITY * STANDARD_GRAVITY * tall
        share = weight / self.system.stress_unit
        if share < HEAVY:
            return ""
        much = f"{weight:.3g} Pa, {100 * share:.1f} % of the shear modulus"
        return (
            "the case has no [gravity], so the silicone's own weight is left out: its pressure over the part's height is "
            f"{much}, and the fit may be off by that order"
        )

    def _place(self, curve: QuadraticCurve) -> tuple[int, Array]:
        piece, s = crest(curve) if self.heights_from == "shadow" else (0, -1.0)
        return piece, shapes(s)

    def _found(self, values: Mapping[str, float], lengths: Mapping[str, float]) -> _Hung:
        if self._now is None or self._now.values != dict(values):
            state = self._nearby(values) or self._followed()
            self._now = _Hung(dict(values), state, self.silhouette.curve(state, lengths), {})
        return self._now

    def _nearby(self, values: Mapping[str, float]) -> State | None:
        """The state next to that of the last values, if there is one to be found at once."""
        base = self._now
        if base is None or not base.rates:
            return None
        w = base.state.w + sum((values[name] - base.values[name]) * rate.w for name, rate in base.rates.items())
        return near(self.solver, base.state, pressure_control(0.0), w, 0.0)

    def _followed(self) -> State:
        """The state at the end of a path on which the loads grow."""
        system = self.system
        amounts = np.concatenate([np.zeros(len(system.body.actuator.ratios)), system.dead.amounts / system.dead.units])
        try:
            return inflate_from(self.solver, hang(self.solver, [("its loads", amounts)]))
        except HangingEnd as end:
            self.couple()
            raise CannotEvaluate(f"the device does not bear {end.what} beyond {end.share:.3g} of them: {end}") from None


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
class ModelSlopes:
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

    def slopes(self, state: State, names: Sequence[str], quantity: str = "volume") -> ModelSlopes:
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
        return ModelSlopes(pressures, outline, along.P * eq.stress_unit / unit, self.silhouette.rate(along.w) / unit)


# ----------------------------------------------------------------------------------------------------------------------
# Dead loads of a measured device: constants of the bench, which act in every photograph, that at zero pressure too.


def measured_parts(
    components: Sequence[Component], actuator: Actuator, material: Material | None
) -> tuple[Component, ...]:
    """A case's parts as a fit takes them: the weight that of the case's silicone, whatever the fitted law is called.

    Args:
        components: Of the case.
        actuator: The device as it is fitted.
        material: The case's; None if nothing is known of it.

    Raises:
        FitError: A load that tilts the outline, or one of which nobody says how large it was.
    """
    for load in (part for part in components if isinstance(part, LoadPart)):
        _check(load, actuator)
    return tuple(components) if material is None else weighed(components, material)


def _check(load: LoadPart, actuator: Actuator) -> None:
    if not (
        isinstance(load, DirectedLoad)
        and load.arm == 2
        and abs(float(np.asarray(load.vector) @ np.asarray(actuator.lift))) > 1 - ALONG
    ):
        raise FitError(
            f"the case has a {load.where} that does not act along the device's axis; a fit takes outlines to be the same on "
            "both sides of it, so photograph the device upright, or leave the load out if it is small"
        )
    if isinstance(load, FaceLoad) and not load.kept:
        raise FitError(
            f"the case has a {load.where} whose size is requested; a fit takes loads that stay the same in all photographs, so "
            'give it an amount (amount = "0.2 N"), or leave it out'
        )
    try:
        load.check_on(actuator)
    except ComponentError as error:
        raise FitError(str(error)) from None


# ----------------------------------------------------------------------------------------------------------------------
# A device that was measured, ready to be solved with the parameters of a law.


@checked
@dataclasses.dataclass(frozen=True)
class MeasuredDevice:
    """What was inflated.

    Attributes:
        actuator: Its geometry.
        name: What reports call it.
        material: What it is known to be made of, whose modulus a fit is held against; None if that is not known.
        formulation: See `softmodels.case.case.Case`.
        components: What else is added to it.
        solver: See `softmodels.case.case.Case`.
        heights_from: What heights count from where it hangs under loads or its top is not flat, see
            `softmodels.fitting.outlines.device.Hanging`.
    """

    actuator: Actuator
    name: str = "device"
    material: Material | None = None
    formulation: str = "mixed"
    components: tuple[Component, ...] = ()
    solver: str = "auto"
    heights_from: str = ""

    @classmethod
    def of(cls, device: Actuator | Case | MeasuredDevice) -> MeasuredDevice:
        """A device, alone or of a case; one that turns about its axis as its section.

        Raises:
            FitError: A case with loads that a fit does not take.
        """
        if isinstance(device, MeasuredDevice):
            section = as_section(device.actuator)
            components = measured_parts(device.components, section, device.material)
            return dataclasses.replace(device, actuator=section, components=components)
        if isinstance(device, Case):
            if rubbing := [part.where for part in device.components if part.remembers]:
                raise FitError(
                    f"{rubbing[0]} has friction, whose derivatives by the material a fit does not know; leave it out "
                    "(friction = 0)"
                )
            case, section = device, as_section(device.actuator)
            components = measured_parts(case.components, section, case.material)
            around = (components, case.solver)
            return cls(section, case.name, case.material, case.formulation, *around)
        one_of("device", device, Actuator, "a device, such as sm.HollowDisk(), or a Case")
        return cls(as_section(device), device.name)

    def counting_from(self, heights_from: str) -> MeasuredDevice:
        """The same device with heights that count from there; see `heights_from`, empty to leave it."""
        return dataclasses.replace(self, heights_from=heights_from or self.heights_from)

    def model(self, choice: LawChoice, comm: MPI.Comm) -> DeviceModel:
        """The device under a law, meshed and compiled.

        Raises:
            FitError: It cannot be meshed or compiled; or ``heights_from`` makes no difference to it.
        """
        from softmodels.mechanics.body import Body, BodyError
        from softmodels.mechanics.compiling import CompilingError, compiling
        from softmodels.mechanics.solver import Solver
        from softmodels.mechanics.system import System

        folder = on_root(comm, lambda: Path(tempfile.mkdtemp(prefix="softmodels-")))
        mesh = folder / f"{self.name}.msh"
        try:
            on_root(comm, lambda: self.actuator.write(mesh))
            with compiling():
                body = Body.from_file(self.actuator, mesh, comm)
                material = choice.material(choice.from_modulus(30e3))
                around = (self.components,)
                system = System(body, material, self.formulation, *around)
                modulus = self.material.shear_modulus_0 if self.material and system.dead.loads else MODULUS
                return DeviceModel(Solver(system, self.solver), choice, self.heights_from, modulus)
        except (BodyError, CompilingError, ComponentError, MeshingError, GeometryError, OSError) as error:
            raise FitError(str(error)) from error
        finally:
            on_root(comm, lambda: shutil.rmtree(folder, ignore_errors=True))


def as_section(actuator: Actuator) -> Actuator:
    """A device that turns about its axis as its section, which gives the same outline in a hundredth of the time."""
    section = about(actuator).get("section")
    turns = section is not None and "axisymmetric" in getattr(section.kind, "choices", ())
    return dataclasses.replace(actuator, section="axisymmetric") if turns else actuator  # type: ignore[call-arg]
