"""Where a case's path begins: the state in which the device hangs under the loads that act before anything is requested."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.case.case import Case
from softmodels.path.quantities import DeadForce, Pressure, Travel
from softmodels.results.outcomes import FAILED, NO_EQUILIBRIUM, RunError

if TYPE_CHECKING:
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import State
    from softmodels.path.stages import HangingEnd, Stop

Array = npt.NDArray[np.float64]


class Beginning:
    """Where the path of a case begins.

    Args:
        case: The case.
        solver: Its device, at rest; the coupling of its drivers is changed.
        report: Takes sentences on what is going on.
    """

    def __init__(self, case: Case, solver: Solver, report: Callable[[str], None]):
        self.case, self.solver, self.report = case, solver, report
        self._hung: Stop | None = None

    def hung(self) -> Stop | None:
        """The state under what acts before anything is requested, found once; None where the device has no dead loads.

        Raises:
            RunError: There is no such state on the way.
        """
        if self._hung is None and self.solver.system.dead.loads:
            self._hung = self._found()
        return self._hung

    def state(self) -> State | None:
        """The state that a path to the requested values begins with, the drivers coupled for it; None for the undeformed one.

        Raises:
            RunError: There is no such state on the way.
        """
        from softmodels.path.stages import inflate_from, load_from

        hung, driven, system = self.hung(), self.case.driven, self.solver.system
        if hung is None:
            return None
        if driven is None:
            return inflate_from(self.solver, hung)
        place = len(system.body.actuator.ratios) + system.dead.index(driven.of(self.case.parts).key)
        return load_from(self.solver, hung, place)

    def check_volumes(self, start: State | None) -> None:
        """Refuse requested volumes that the cavity has passed already where the device hangs.

        Args:
            start: Where the path begins, the drivers coupled for it; None for the undeformed state.

        Raises:
            RunError: There is one.
        """
        if start is None or not self.case.volumes_ml:
            return
        system = self.solver.system
        taken = (start.V - system.rest().V) * system.volume_unit * 1e6
        system.load(start)
        if passed := [value for value in self.case.volumes_ml if 0.0 < value < taken]:
            raise RunError(
                f"{passed[0]:g} ml are not on this path: where the device hangs under its loads its cavity has taken "
                f"{taken:.4g} ml already, counted from the undeformed device; request more, or 0 for where it hangs",
                NO_EQUILIBRIUM,
            )

    def unit_of(self, quantity: str) -> float:
        """SI units in one dimensionless value of a quantity, by its name; of shares of the weight the weight."""
        system, driven = self.solver.system, self.case.driven
        if quantity == Pressure.name:
            return system.stress_unit
        if driven is not None and quantity in (DeadForce.name, Travel.name):
            place = system.dead.index(driven.of(self.case.parts).key)
            unit = (system.dead.moved_units if driven.held else system.dead.units)[place]
            return float(unit / (system.dead.amounts[place] if driven.key == "share" else 1.0))
        return system.volume_unit

    def _found(self) -> Stop:
        from softmodels.path.stages import HangingEnd, hang

        case, system = self.case, self.solver.system
        kept = self._kept()
        targets = [("its dead loads", kept)]
        if case.driven is not None and case.driven.at_pressure_cm:
            inflated = kept.copy()
            ratios = np.array(system.body.actuator.ratios)
            inflated[: len(ratios)] = case.driven.at_pressure_cm * case.cm / system.stress_unit * ratios
            targets.append((f"{case.driven.at_pressure_cm:g} cm", inflated))
        if words := [what for what, magnitudes in targets if magnitudes.any()]:
            self.report(f"applying {', then '.join(words)}")
        try:
            found = hang(self.solver, targets, self.report)
        except HangingEnd as end:
            raise RunError(_explained(end), NO_EQUILIBRIUM if end.physical else FAILED) from end
        system.dead.origins = found.driven
        return found

    def _kept(self) -> Array:
        """Magnitudes of all drivers that act before anything is requested, dimensionless, shape (k,): of the dead loads those
        that neither the request nor a program changes."""
        case, dead = self.case, self.solver.system.dead
        changed = {series.target for series in case.program}
        changed |= {case.driven.of(case.parts).key} if case.driven else set()
        kept = [0.0 if load.key in changed else amount for load, amount in zip(dead.loads, dead.amounts, strict=True)]
        return np.concatenate([np.zeros(len(self.solver.system.body.actuator.ratios)), np.array(kept) / dead.units])


def _explained(end: HangingEnd) -> str:
    """Why a device does not hang: a sentence."""
    if end.limit is not None:
        return (
            f"the device does not bear {end.what}, which act before anything is requested: they have a limit point at "
            f"{end.share:.3g} of themselves or a little below; take less of them, a stiffer silicone or thicker walls"
        )
    if end.cause:
        return (
            f"the device does not bear {end.what}, which act before anything is requested: at {end.share:.3g} of them "
            f"{end.cause.clause}. {end.cause.advice}"
        )
    return (
        f"{end.what[0].upper()}{end.what[1:]} could be applied to {end.share:.3g} of themselves alone ({end}); take less of "
        "them, or refine the mesh (--cell-size)"
    )
