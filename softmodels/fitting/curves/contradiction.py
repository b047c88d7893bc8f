"""Curves of one test that cannot be one material's: other batches, rates or laboratories, told apart before they are mixed."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np

from softmodels.fitting.curves.curve import TensileCurve
from softmodels.fitting.curves.curve_residuals import largest_strain, stretches_of
from softmodels.fitting.fitted_law import FittedLaw
from softmodels.fitting.law_parameters import LawChoice
from softmodels.fitting.result import LeastSquaresFit
from softmodels.materials.quantities import with_prefix
from softmodels.materials.specimens import respond
from softmodels.materials.stability import judge

TEST_ERROR = 0.02
"""Share of the stress that two tests of one cast differ by, each: cross-section, load cell, crosshead strain."""
BEYOND = 3.0
"""Curves that differ by this many standard errors contradict each other."""
TOE = 0.05
"""Stretches this near to rest are left out: there the grips' slack decides."""
SAMPLES = 50


@dataclasses.dataclass(frozen=True)
class CurveContradiction:
    """Two curves of the same kind of test that differ by more than tests of one material do.

    Attributes:
        softer: Place of the softer curve in the list of curves.
        stiffer: Place of the stiffer.
        names: Their names, the softer first.
        ratio: Stress of the stiffer over that of the softer: the factor that brings them closest.
        difference: Root mean square difference as a share of their mean stress.
        allowed: The share that tests of one material may differ by.
        stretches: Where they were compared.
    """

    softer: int
    stiffer: int
    names: tuple[str, str]
    ratio: float
    difference: float
    allowed: float
    stretches: tuple[float, float]

    @property
    def sentence(self) -> str:
        low, high = self.stretches
        return (
            f"{self.names[0]} and {self.names[1]} contradict each other: from stretch {low:.3g} to {high:.3g} the stress of "
            f"the second is {self.ratio:.3g} times that of the first (they differ by {100 * self.difference:.2g} %, and tests "
            f"of one material by less than {100 * self.allowed:.2g} %); batch, rate, conditioning or laboratory may differ"
        )


def contradictions(curves: Sequence[TensileCurve], gauge_error: float = 0.0) -> list[CurveContradiction]:
    """All pairs of curves of the same test that contradict each other, by their stresses at the same stretches.

    No law is needed for that, so a law that follows neither cannot hide it, nor one that follows both poorly feign it.

    Args:
        curves: Measured curves.
        gauge_error: Standard error of a factor on each test, a share, as the fit takes it.
    """
    found = []
    allowed = BEYOND * math.sqrt(2) * max(TEST_ERROR, gauge_error)
    for (i, a), (j, b) in itertools.combinations(enumerate(curves), 2):
        if a.mode != b.mode:
            continue
        low, high = max(a.stretch[0], b.stretch[0]), min(a.stretch[-1], b.stretch[-1])
        stretch = np.linspace(low, high, SAMPLES)
        stretch = stretch[np.abs(stretch - 1) > TOE]
        if high <= low or len(stretch) < SAMPLES // 4:
            continue
        one, other = (np.interp(stretch, c.stretch, c.stress) for c in (a, b))
        mean = (one + other) / 2
        difference = float(np.sqrt(np.mean((one - other) ** 2) / np.mean(mean**2)))
        if difference <= allowed:
            continue
        ratio = float(one @ other / (one @ one))
        pair = (i, j) if ratio >= 1.0 else (j, i)
        names = (curves[pair[0]].name, curves[pair[1]].name)
        ratio = float(one @ other / ((one @ one) if ratio >= 1.0 else (other @ other)))
        found.append(
            CurveContradiction(*pair, names, ratio, difference, allowed, (float(stretch[0]), float(stretch[-1])))
        )
    return found


@dataclasses.dataclass(frozen=True, eq=False)
class SeparateFits:
    """Curves that contradict each other, each with a fit of its own.

    Attributes:
        pairs: What contradicts what.
        curves: The measured curves.
        own: The chosen law fitted to each of them alone.
    """

    pairs: tuple[CurveContradiction, ...]
    curves: tuple[TensileCurve, ...]
    own: tuple[FittedLaw, ...]

    @property
    def sentences(self) -> list[str]:
        """What contradicts what, each curve's own material, and the spread between them."""
        lines = [pair.sentence for pair in self.pairs]
        for curve, one in zip(self.curves, self.own, strict=True):
            values = ", ".join(
                f"{p.name} {' '.join(with_prefix(one.fit.values[p.name], p.unit))}" for p in one.fit.parameters
            )
            rms = next(iter(one.fit.summaries.values())).rms / 1e3
            modulus = " ".join(with_prefix(one.material.shear_modulus_0, "Pa"))
            lines.append(
                f"{curve.name} alone: {one.choice.name} with {values}, shear modulus {modulus}, rms {rms:.3g} kPa: "
                f"{separate_file(self, curve)}"
            )
        return [*lines, self.spread]

    @property
    def spread(self) -> str:
        """The small-strain shear modulus and the stress at the largest common stretch, lowest and highest."""
        top = min(pair.stretches[1] for pair in self.pairs)
        involved = {place for pair in self.pairs for place in (pair.softer, pair.stiffer)}
        moduli = [self.own[i].material.shear_modulus_0 for i in involved]
        stresses = [
            float(respond(self.own[i].material, np.array([top]), self.curves[i].mode).stress[0]) for i in involved
        ]
        ends = [
            " ".join(with_prefix(value, "Pa")) for value in (min(moduli), max(moduli), min(stresses), max(stresses))
        ]
        return (
            f"spread: shear modulus {ends[0]} to {ends[1]}, nominal stress at stretch {top:.3g} {ends[2]} to {ends[3]}; the "
            "joint fit lies between the curves and follows none of them, so simulate with both ends"
        )


def separate_file(separate: SeparateFits, curve: TensileCurve) -> str:
    """Name of the material file of a curve's own fit."""
    number = next(i for i, other in enumerate(separate.curves, 1) if other is curve)
    return f"fitted-curve{number}.toml"


def fit_separately(
    curves: Sequence[TensileCurve], gauge_error: float, fit_one: Callable[[TensileCurve], FittedLaw]
) -> SeparateFits | None:
    """Curves that contradict each other, fitted one by one; None where they go together.

    Args:
        curves: Measured curves.
        gauge_error: See `contradictions`.
        fit_one: Fits the chosen law to one curve.
    """
    pairs = tuple(contradictions(curves, gauge_error))
    return SeparateFits(pairs, tuple(curves), tuple(map(fit_one, curves))) if pairs else None


def fitted_alone(choice: LawChoice, fit: LeastSquaresFit, curve: TensileCurve) -> FittedLaw:
    """A curve's own fit as a material with its stability."""
    material = choice.material(fit.values, stretches_of([curve]))
    return FittedLaw(choice, fit, material, judge(material, largest_strain([curve])), {})
