"""A law with its fit: what it is worth, and whether it may be used."""

from __future__ import annotations

import dataclasses
import functools

from measurement.wording import spoken
from softmodels.fitting.law_parameters import LawChoice
from softmodels.fitting.profile import Profile
from softmodels.fitting.result import LeastSquaresFit
from softmodels.fitting.soundness import NOTHING, Judgement, objections
from softmodels.materials.material import Material
from softmodels.materials.stability import Verdict


@dataclasses.dataclass(frozen=True, eq=False)
class FittedLaw:
    """A law with its fit and what it is worth.

    Attributes:
        choice: The law.
        fit: Its fit.
        material: With the fitted values.
        verdict: Its stability within the fitted range.
        profiles: By parameter; empty if none were asked for.
        judgement: What speaks against it by what is known of the device and the bench.
    """

    choice: LawChoice
    fit: LeastSquaresFit
    material: Material
    verdict: Verdict
    profiles: dict[str, Profile]
    judgement: Judgement = NOTHING

    @property
    def warnings(self) -> tuple[str, ...]:
        """Everything that speaks against it."""
        profiles = (p.trouble for p in self.profiles.values() if p.trouble)
        found = (*self.objections, *self.fit.troubles, *self.verdict.flags, *self.judgement.warnings, *profiles)
        return tuple(dict.fromkeys(map(spoken, found)))

    @functools.cached_property
    def objections(self) -> tuple[str, ...]:
        """What forbids its use, whether or not it converged and is stable."""
        own = objections(self.fit, lambda values: self.choice.material(values).shear_modulus_0)
        return (*self.judgement.objections, *own)

    @property
    def sound(self) -> bool:
        """Whether it converged, is stable within its range, and nothing forbids its use."""
        return self.fit.converged and not self.verdict.flags and not self.objections

    def interval(self, name: str) -> tuple[float, float]:
        """95 % interval: the likelihood's where there is a profile, else the covariance's."""
        return self.profiles[name].interval if name in self.profiles else self.fit.interval(name)
