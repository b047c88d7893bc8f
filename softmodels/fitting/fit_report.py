"""All laws that were fitted to the same measurements, and which of them to take."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from softmodels.fitting.comparison import Comparison
from softmodels.fitting.curves.contradiction import SeparateFits
from softmodels.fitting.curves.curve import TensileCurve
from softmodels.fitting.fitted_law import FittedLaw
from softmodels.materials.material import Material

if TYPE_CHECKING:
    from softmodels.fitting.outlines.outline_residuals import MatchedPhotograph


@dataclasses.dataclass(frozen=True, eq=False)
class FitReport:
    """All that was fitted, best law first, to which curves, and how.

    Attributes:
        laws: Fitted laws, by the comparison's order.
        comparison: What the criterion says.
        curves: Measured curves within the fit's range.
        how: The weighting in words.
        apart: Curves that contradict each other, with a fit of each alone; None where they go together.
        devices: Each device in words; empty for curves alone.
        notes: What was left out, and why.
        photographs: By law: each photograph with its fitted state; empty but for outlines.
    """

    laws: tuple[FittedLaw, ...]
    comparison: Comparison
    curves: tuple[TensileCurve, ...]
    how: str
    separate: SeparateFits | None = None
    devices: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    photographs: Mapping[str, Sequence[MatchedPhotograph]] = dataclasses.field(default_factory=dict)

    @property
    def chosen(self) -> FittedLaw:
        """The preferred law; if that is not sound, the best that is; if none is, the preferred all the same."""
        preferred = next(one for one in self.laws if one.fit is self.comparison.preferred)
        return next((one for one in (preferred, *self.laws) if one.sound), preferred)

    @property
    def material(self) -> Material:
        """The material of the chosen law."""
        return self.chosen.material

    @property
    def ranges(self) -> list[str]:
        """The devices and what was left out of its measurements; which part of each curve was fitted, and what was left out."""
        curves = [
            f"{c.name} ({c.mode}): stretch {c.stretch[0]:.4g} to {c.stretch[-1]:.4g}, {len(c.stretch)} points"
            + "".join(f"; {remark}" for remark in c.remarks)
            for c in self.curves
        ]
        return [*self.devices, *self.notes, *curves]

    @property
    def verdict(self) -> str:
        """Which law was taken, and why."""
        preferred = self.comparison.preferred
        if self.chosen.fit is preferred:
            return self.comparison.sentence
        one = next(one for one in self.laws if one.fit is preferred)
        reason = "is not stable within the range" if one.verdict.flags else "is not sound"
        reason = reason if preferred.converged else "did not converge"
        ratio = {one.fit.label: one.ratio for one in self.comparison.ranked}
        times = ratio[self.chosen.fit.label] / ratio[preferred.label]
        return (
            f"{self.comparison.sentence}; but {preferred.label} {reason}, so {self.chosen.choice.name} is taken, whose misfit "
            f"is {times:.3g} times as large"
        )
