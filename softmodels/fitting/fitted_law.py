"""A law with its fit: what it is worth, and whether it may be used."""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING

import numpy as np

from measurement.wording import spoken
from softmodels.fitting.law_parameters import LawChoice
from softmodels.fitting.profile import Profile
from softmodels.fitting.result import LeastSquaresFit
from softmodels.fitting.soundness import NOTHING, Judgement, objections
from softmodels.materials.material import Material
from softmodels.materials.stability import Verdict

if TYPE_CHECKING:
    from softmodels.case.material_errors import MaterialErrors


@dataclasses.dataclass(frozen=True)
class DeviceMisfit:
    """How well a fit follows the outlines and readings of one device.

    Attributes:
        device: Its name.
        chi2: Sum of its squared residuals in standard errors.
        count: How many they are.
    """

    device: str
    chi2: float
    count: int


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
        devices: Its misfit of each device; empty but for outlines.
    """

    choice: LawChoice
    fit: LeastSquaresFit
    material: Material
    verdict: Verdict
    profiles: dict[str, Profile]
    judgement: Judgement = NOTHING
    devices: tuple[DeviceMisfit, ...] = ()

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
    def errors(self) -> MaterialErrors:
        """What is not known of the material: for ``sm.score(..., errors=...)`` and the band of a run.

        Raises:
            MaterialError: Nothing of the material was free, or the data do not determine it.
        """
        from softmodels.case.material_errors import MaterialErrors
        from softmodels.mechanics.sensitivity import known_parameters

        known = known_parameters(self.material)
        kept = [i for i, p in enumerate(self.fit.free) if p.name in known]
        rows = self.fit.covariance[np.ix_(kept, kept)].tolist()
        names = tuple(self.fit.free[i].name for i in kept)
        found = MaterialErrors(names, tuple(map(tuple, rows)), "covariance of the fit", self.material)
        found.check(self.material)
        return found

    @property
    def sound(self) -> bool:
        """Whether it converged, is stable within its range, and nothing forbids its use."""
        return self.fit.converged and not self.verdict.flags and not self.objections

    def interval(self, name: str) -> tuple[float, float]:
        """95 % interval: the likelihood's where there is a profile, else the covariance's."""
        return self.profiles[name].interval if name in self.profiles else self.fit.interval(name)
