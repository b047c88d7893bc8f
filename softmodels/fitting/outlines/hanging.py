"""Where a measured device hangs under its dead loads at zero pressure, and the height that its outlines count from.

Gravity, masses and forces keep their newtons, so that in shear moduli they change with the material: where the device hangs,
and with it every state of its path, is another one for every modulus. A photograph at zero pressure shows the device as it
hangs, and its upper edge is the measurement's zero. So simulated heights count from that edge too, and it moves with the
parameters.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from measurement.outline.zero import STRAIGHT
from softmodels.fitting.outlines.near_states import near
from softmodels.fitting.outlines.reading import OutlineFitError
from softmodels.fitting.outlines.shadow import crest, edge_heights
from softmodels.fitting.problem import CannotEvaluate
from softmodels.materials.casting import SILICONE_DENSITY
from softmodels.mechanics.controls import pressure_control
from softmodels.mechanics.coupling import Coupling
from softmodels.mechanics.loads import STANDARD_GRAVITY
from softmodels.mechanics.newton import NoConvergence
from softmodels.path.stages import HangingEnd, hang, inflate_from
from softmodels.results.quadratic_curve import QuadraticCurve, shapes

if TYPE_CHECKING:
    from softmodels.fitting.outlines.silhouette import Silhouette
    from softmodels.mechanics.sensitivity import Rate, Sensitivity
    from softmodels.mechanics.system import State

Array = npt.NDArray[np.float64]

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
        heights_from: One of `softmodels.fitting.options.HEIGHTS_FROM`; empty for the shadow, or for the apex where the
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
