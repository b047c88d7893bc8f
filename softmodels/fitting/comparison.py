"""Fitted laws compared and judged, and their report as text, tables and files."""

from __future__ import annotations

import csv
import dataclasses
import functools
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import tomli_w

from softmodels.case import materials
from softmodels.common import cards, errors, files, names, units
from softmodels.common.arrays import Array
from softmodels.fitting import least_squares, problem
from softmodels.fitting.curves import residuals
from softmodels.fitting.curves.curve import TensileCurve
from softmodels.fitting.curves.oscillation import FrequencyTest
from softmodels.fitting.least_squares import objections
from softmodels.fitting.problem import FitError
from softmodels.materials import laws, silicones, specimens
from softmodels.materials.laws import Material, MaterialError

if TYPE_CHECKING:
    from softmodels.fitting.outlines.inflations import MatchedInflation
    from softmodels.fitting.outlines.residuals import MatchedPhotograph


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Fits of the same data, best first, with the one to take and a sentence why: the best, or the simplest of those that
    the data do not distinguish from it; of equally simple ones the first in the order of
    `softmodels.fitting.problem.all_laws`."""

    ranked: tuple[Ranked, ...]
    preferred: least_squares.LeastSquaresFit
    sentence: str


errors.call("material all", 'material="all"')


EQUIVALENT_AICC = 2.0
"""Laws whose criteria differ by less than this are equivalent (Burnham & Anderson 2002, section 2.6)."""
CURVE_VALUES = 10.0
"""Number of independent values per measured curve, for any number of points: errors of a test (cross-section, grips,
crosshead strain) are correlated over about a tenth of it."""
EQUAL_MISFIT_RATIO = 1.3
"""Misfits are equal within the error if one mean square is less than 1.7 times the other."""
MOST_RATIO = 2.5
"""A law whose rms misfit is this many times another's is not preferred, even if it is simpler."""
EQUAL_MISFIT_TOLERANCE = 1e-3
"""Misfits below this fraction of the common error are equivalent: measurements cannot distinguish them."""


@dataclasses.dataclass(frozen=True)
class Ranked:
    """A fit with Akaike's corrected criterion and Schwarz's relative to the best one's, which are 0, and its root mean
    square misfit over that of the closest law; ``near`` if it follows the data nearly as closely."""

    fit: least_squares.LeastSquaresFit
    aicc: float
    bic: float
    ratio: float = 1.0
    near: bool = True


def compare(
    fits: Sequence[least_squares.LeastSquaresFit], judged: Sequence[least_squares.LeastSquaresFit] | None = None
) -> Comparison:
    """Rank fits of the same sources with the same loss by the quasi-likelihood form of Akaike's corrected criterion;
    ``judged`` are the same laws in the same order, fitted to curves on the common yardstick.

    QAICc divides the misfit by the variance that remains in the closest fit (Burnham & Anderson 2002, Model Selection and
    Multimodel Inference, section 2.5). What the misfit is counted in decides, so measured curves are judged on one yardstick,
    whatever errors they are fitted with: `on_yardstick` fits each law again at the same stretches for every sampling, with
    what a test can tell, a share of the stress, as its error. Each curve counts as `CURVE_VALUES` values, however densely it
    is sampled. A further parameter then pays where it takes a tenth off the mean square misfit, or off what a test can tell
    where the misfit is below that. A simpler law is preferred only if its misfit is below `EQUAL_MISFIT_RATIO` times
    the closest law's.

    Which of two indistinguishable laws is ahead may change with the noise of a few readings. So it does not count: the one
    with fewer parameters is preferred, and of two with the same number the one that comes first in a fixed order.

    Other fits count as many values as they have independent residuals, their runs of like sign taken together.

    A law whose root mean square misfit is `MOST_RATIO` times another's is never preferred. The BIC is formed likewise.
    """
    _check(fits)
    even = [True] * len(fits)
    if judged:
        sums = [sum(_means(fit).values()) / len(fit.summaries) for fit in judged]
        values, closest = CURVE_VALUES * len(judged[0].summaries), min(sums)
        misfits = [values * law_sum / max(closest, 1.0) for law_sum in sums]
        even = [law_sum <= EQUAL_MISFIT_RATIO**2 * max(closest, EQUAL_MISFIT_TOLERANCE**2) for law_sum in sums]
    else:
        misfits, values = _on_residuals(fits)
    ratios = _ratios(fits)
    made = []
    for fit, misfit, ratio, equal in zip(fits, misfits, ratios, even, strict=True):
        m = len(fit.free) + 1
        aicc = misfit + 2 * m + 2 * m * (m + 1) / max(fit.count - m - 1, 1)
        made.append(Ranked(fit, aicc, misfit + m * math.log(max(values, 1.0)), ratio, equal and ratio <= MOST_RATIO))
    # A fit that did not converge, or is much worse than another, is not ranked.
    made.sort(key=lambda fitted: (not fitted.fit.converged, not fitted.near, fitted.aicc))
    least, lowest = made[0].aicc, min(fitted.bic for fitted in made)
    ranked = tuple(dataclasses.replace(fitted, aicc=fitted.aicc - least, bic=fitted.bic - lowest) for fitted in made)
    return Comparison(ranked, *_judgement(ranked))


def _check(fits: Sequence[least_squares.LeastSquaresFit]) -> None:
    first = fits[0]
    for other in fits[1:]:
        alike = (other.loss, other.errors, other.rows.groups) == (first.loss, first.errors, first.rows.groups)
        if not alike or not np.allclose(other.rows.sizes, first.rows.sizes, rtol=1e-12):
            raise ValueError("only fits of the same measurements, with the same loss and errors, can be compared")


def _means(fit: least_squares.LeastSquaresFit) -> dict[str, float]:
    """Return the mean over each curve of the loss of its squared residuals; the priors' share goes to the first. The noise
    that averaging took from a curve counts as if it were there, so that each sampling has the same misfit."""
    labels = np.array(fit.rows.groups)
    squares = fit.residuals**2
    losses = problem.loss_of(fit.loss, squares, len(squares) - fit.count)[0]
    means = {str(name): float(losses[: fit.count][labels == name].mean()) for name in dict.fromkeys(fit.rows.groups)}
    for source in fit.problem.sources:
        if np.any(hidden := np.asarray(getattr(source, "averaged_away", 0.0))):
            means[source.label] += float(np.mean((hidden / np.array(fit.rows.sizes)[labels == source.label]) ** 2))
    means[fit.rows.groups[0]] += float(losses[fit.count :].sum()) / CURVE_VALUES
    return means


def _on_residuals(fits: Sequence[least_squares.LeastSquaresFit]) -> tuple[list[float], float]:
    """Return the misfit of each law relative to the closest one's and the number of values, for stated errors."""
    closest = min(fits, key=lambda fit: fit.deviance)
    worth = max(closest.dispersion * closest.count / closest.independent, 1e-300)
    if closest.loss != "linear":
        worth *= closest.influence[1]
    return [fit.deviance / worth for fit in fits], closest.independent


def _ratios(fits: Sequence[least_squares.LeastSquaresFit]) -> list[float]:
    """Return the root mean square misfit of each law over that of the closest one, all curves or photographs weighted
    equally."""
    labels, sizes = np.array(fits[0].rows.groups), np.array(fits[0].rows.sizes)
    away = {source.label: np.asarray(getattr(source, "averaged_away", 0.0)) for source in fits[0].problem.sources}
    hidden = {label: math.sqrt(float(np.mean(values**2))) for label, values in away.items()}
    misfits = [{k: math.hypot(v.rms, hidden.get(k, 0.0)) for k, v in fit.summaries.items()} for fit in fits]
    least = {
        name: max(min(law[name] for law in misfits), EQUAL_MISFIT_TOLERANCE * float(sizes[labels == name].mean()))
        for name in fits[0].summaries
    }
    sums = [sum((law[name] / least[name]) ** 2 for name in least) for law in misfits]
    smallest = max(min(sums), len(least))
    return [math.sqrt(max(law / smallest, 1.0)) for law in sums]


def _simplicity_key(fit: least_squares.LeastSquaresFit) -> tuple[int, int, str]:
    """Return the sorting key by simplicity: free parameters, then the order of `all_laws`; independent of
    noise."""
    order = problem.all_laws()
    return len(fit.free), order.index(fit.label) if fit.label in order else len(order), fit.label


def _judgement(ranked: tuple[Ranked, ...]) -> tuple[least_squares.LeastSquaresFit, str]:
    best = ranked[0].fit
    first = best.label
    if len(ranked) == 1:
        return best, f"only {first} was fitted; use --material all to compare laws"
    rivals = [
        ranked_law
        for ranked_law in ranked[1:]
        if ranked_law.aicc < EQUIVALENT_AICC and ranked_law.fit.converged and ranked_law.near
    ]
    if rivals:
        simplest, *more = sorted((ranked[0].fit, *(rival.fit for rival in rivals)), key=_simplicity_key)
        others = ", ".join(rival.fit.label for rival in rivals)
        alike = [ranked_law.label for ranked_law in more if len(ranked_law.free) == len(simplest.free)]
        why = f", as simple as {' and '.join(alike)} and before it in the order of laws" if alike else ", the simplest"
        return simplest, f"the data do not distinguish {first} and {others}; use {simplest.label}{why}"
    second = ranked[1]
    times = f"a misfit {second.ratio / ranked[0].ratio:.3g} times as large"
    if not second.near or second.aicc < EQUIVALENT_AICC:
        return best, f"the data prefer {first}: the next, {second.fit.label}, leaves {times}"
    joint = "and leaves" if second.ratio >= ranked[0].ratio else "although it leaves"
    said = f"the next, {second.fit.label}, is {second.aicc:.3g} worse in AICc (significant above 2) {joint} {times}"
    return best, f"the data prefer {first}: {said}"


# ----------------------------------------------------------------------------------------------------------------------
# A law with its fit, its warnings and its acceptance.


@dataclasses.dataclass(frozen=True)
class DeviceMisfit:
    """Sum of squared residuals in standard errors, and their number, of the outlines and readings of one device."""

    device: str
    chi2: float
    count: int


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class FittedLaw(cards.ResultCard):
    """A law with its fit and its warnings.

    Attributes:
        material: With the fitted values.
        verdict: Its stability within the fitted range.
        profiles: By parameter; empty if none were asked for.
        judgement: What speaks against it by what is known of the device and the bench.
        devices: Its misfit of each device; empty but for outlines.
        form_slopes: `Problem.form_slopes`, which all ranks have to ask for.
        form: Which of `laws.FORM_ENERGIES` they are by: `laws.SHARE` where no pull was fitted.
    """

    choice: problem.LawChoice
    fit: least_squares.LeastSquaresFit
    material: Material
    verdict: specimens.Verdict
    profiles: dict[str, least_squares.Profile]
    judgement: least_squares.Judgement = least_squares.NO_JUDGEMENT
    devices: tuple[DeviceMisfit, ...] = ()
    form_slopes: Array | None = None
    form: str = laws.FORM

    def _line(self) -> str:
        law = (row for row in parameter_rows(self) if row[0] in self.choice.names)
        values = ", ".join(f"{name} {value} {unit}".strip() for name, value, unit, _ in law)
        return f"of {self.choice.name}: {values}{'' if self.sound else '; rejected'}"

    def _figures(self) -> cards.Table:
        rows = [
            (name, f"{value} {unit} ({'' if interval == 'fixed' else '95 %: '}{interval})".replace("  ", " "))
            for name, value, unit, interval in parameter_rows(self)
        ]
        modulus = " ".join(units.with_prefix(self.material.shear_modulus_0, "Pa"))
        return [*rows, ("shear modulus", modulus), ("Poisson's ratio", f"{self.material.poisson:g}")]

    def _remarks(self) -> tuple[str, ...]:
        return (*self.warnings, *self.judgement.notes)

    @property
    def warnings(self) -> tuple[str, ...]:
        """All warnings on the fit."""
        profiles = (p.trouble for p in self.profiles.values() if p.trouble)
        sentences = (*self.objections, *self.fit.troubles, *self.verdict.flags, *self.judgement.warnings, *profiles)
        return tuple(dict.fromkeys(map(errors.spoken, sentences)))

    @functools.cached_property
    def objections(self) -> tuple[str, ...]:
        """Reasons for its rejection, apart from convergence and stability."""
        own = objections(self.fit, lambda values: self.choice.material(values).shear_modulus_0)
        return (*self.judgement.objections, *own)

    @property
    def errors(self) -> materials.MaterialErrors:
        """Errors of the material: for ``sm.score(..., errors=...)`` and the band of a run. Raises `MaterialError` where no
        parameter of it was free, or the data do not determine it."""
        how = "covariance of the fit"
        errors = materials.MaterialErrors.of_fit(self.material, *self.covariance, self.fit.values, how)
        if errors is None:
            raise materials.MaterialError("no parameter of the material was free, or the data do not determine it")
        errors.check(self.material)
        return errors

    @functools.cached_property
    def covariance(self) -> tuple[list[str], Array]:
        """Names of the free parameters, and `form`, with their covariance for bands.

        Pulls do not depend on that factor, so it is uncertain as it is without them (`laws.FORM_RANGE`); other tests and the
        states of devices narrow it. What the law misses in its own curves is an error of all its moduli, and so is how far
        it moves the factors of tests beyond their 95 % intervals.
        """
        fit = self.fit
        free, labels = [p.name for p in fit.free], np.array(fit.rows.groups)
        if self.form_slopes is None or not self.form_error:
            return free, fit.band_covariance
        beyond = {
            p.name: max((fit.values[p.name] - p.prior.mean) ** 2 - (units.HALF_WIDTH_95 * p.prior.error) ** 2, 0.0)
            for p in fit.free
            if p.prior
        }
        curves = self._curves
        misfits = [s.misfit(fit.unexplained[labels == s.label]) + beyond.get(s.gauge, 0.0) for s in curves]
        misfit = np.mean(misfits) if misfits else 0.0
        moduli = np.array([fit.values[p.name] * (p.unit == "Pa" and p.name in self.choice.names) for p in fit.free] + [0.0])
        covariance = fit.covariance_with(self.form_slopes, self.form_error) + misfit * np.outer(moduli, moduli)
        return [*free, self.form], names.read_only(covariance)

    @functools.cached_property
    def form_error(self) -> float:
        """Standard error of the factor of `laws.form_energy` before the data: half of how far it may lie away, see
        `laws.FORM_RANGE`."""
        shares = self._form_shares[2]
        if not np.isfinite(shares).any():
            return 0.0
        low, high = laws.FORM_RANGE
        return float(max(np.nanmax(shares) - low, high - np.nanmin(shares))) / units.HALF_WIDTH_95

    @property
    def _curves(self) -> list[residuals.TensileResiduals]:
        return [source for source in self.fit.problem.sources if isinstance(source, residuals.TensileResiduals)]

    @functools.cached_property
    def _form_shares(self) -> tuple[Array, Array, Array]:
        """`specimens.form_shares` up to the largest strain of the curves, or of the device that the law was fitted to."""
        strain = residuals.largest_strain([source.curve for source in self._curves])
        if self.material.fitted_stretch and not self._curves:
            strain = float(specimens.strain_of("equibiaxial", np.array(self.material.fitted_stretch)).max())
        return specimens.form_shares(self.material, strain)

    @property
    def form_note(self) -> str:
        """How much the law's form adds to the band in equibiaxial tension, after a fit to a device in uniaxial tension, as a
        sentence; "" where it is not in the band, or both kinds of data were fitted together."""
        try:
            errors = self.errors
        except materials.MaterialError:
            return ""
        if self.form not in errors.names or 0 < len(self._curves) < len(self.fit.problem.sources):
            return ""
        mode, narrows = ("equibiaxial", "only an equibiaxial or planar test") if self._curves else ("uniaxial", "a pull")
        stretch = self._form_shares[0]
        response = specimens.respond(self.material, stretch[-1:], mode, errors.names)
        halves = [
            units.HALF_WIDTH_95 * float(np.linalg.norm(response.slopes @ roots)) / float(response.stress[0])
            for roots in (errors.by_cause[materials.MATERIAL], errors.roots)
        ]
        return (
            f"95 % band in {mode} tension at stretch {stretch[-1]:.3g}: +-{100 * halves[1]:.2g} % of the stress, "
            f"+-{100 * halves[0]:.2g} % without the law's form, which {narrows} narrows"
        )

    @property
    def sound(self) -> bool:
        """Whether it converged, is stable within its range, and has no objections."""
        return self.fit.converged and not self.verdict.flags and not self.objections

    def interval(self, name: str) -> tuple[float, float]:
        """Return the 95 % interval: from the profile likelihood if available, else from the covariance."""
        return self.profiles[name].interval if name in self.profiles else self.fit.interval(name)


def parameter_rows(law: FittedLaw) -> list[tuple[str, str, str, str]]:
    """Return the parameter, value, unit and 95 % interval, as texts."""
    rows = []
    for p in law.fit.parameters:
        if p.hidden:
            continue
        value = law.fit.values[p.name]
        text, unit = units.with_prefix(value, p.unit, law.fit.error(p.name))
        if p.fixed:
            rows.append((p.name, text, unit, "fixed"))
            continue
        factor = {"MPa": 1e-6, "kPa": 1e-3, "mm": 1e3}.get(unit, 1.0)
        low, high = (_plain(end * factor, law.fit.error(p.name) * factor) for end in law.interval(p.name))
        ends = [f"{t} (its bound)" if e in (p.lower, p.upper) else t
                for t, e in zip((low, high), law.interval(p.name), strict=True)]  # fmt: skip
        rows.append((p.name, text, unit, " to ".join(ends) if "nan" not in (low, high) else "at a bound"))
    return rows


def _plain(value: float, error: float) -> str:
    if not math.isfinite(value):
        return "nan" if math.isnan(value) else "-infinity" if value < 0 else "infinity"
    if not (math.isfinite(error) and error > 0.0):
        return f"{value:.4g}"
    digits = max(math.ceil(math.log10(max(abs(value), error) / error)) + 2, 2)
    return f"{value:.{min(digits, 9)}g}"


# ----------------------------------------------------------------------------------------------------------------------
# Detect curves of the same test that contradict each other (other batches, rates or laboratories), before a joint fit.


TEST_ERROR = 0.02
"""Relative error of the stress in a test of one cast: cross-section, load cell, crosshead strain."""
CONTRADICTION_ERRORS = 3.0
"""Curves that differ by this many standard errors contradict each other."""
CURVE_SAMPLES = 50


@dataclasses.dataclass(frozen=True)
class CurveContradiction:
    """Two curves of the same test that differ by more than tests of one material.

    Attributes:
        softer, stiffer: Places in the list of curves.
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
            f"the second is {self.ratio:.3g} times that of the first (a difference of {100 * self.difference:.2g} %; "
            f"expected for one material: below {100 * self.allowed:.2g} %); batch, rate, conditioning or laboratory may differ"
        )


def contradictions(curves: Sequence[TensileCurve], gauge_error: float = 0.0) -> list[CurveContradiction]:
    """Return all pairs of curves of the same test that contradict each other, by their stresses at the same stretches;
    ``gauge_error`` is the standard error of a factor on each test, a share.

    No law is needed for that, so a law that follows neither cannot hide it, nor one that follows both poorly feign it.
    """
    contradictions = []
    allowed = CONTRADICTION_ERRORS * math.sqrt(2) * max(TEST_ERROR, gauge_error)
    for (i, a), (j, b) in itertools.combinations(enumerate(curves), 2):
        if a.mode != b.mode:
            continue
        low, high = max(a.stretch[0], b.stretch[0]), min(a.stretch[-1], b.stretch[-1])
        stretch = np.linspace(low, high, CURVE_SAMPLES)
        stretch = stretch[np.abs(stretch - 1) > residuals.TOE_STRETCH]
        if high <= low or len(stretch) < CURVE_SAMPLES // 4:
            continue
        stress, other = (np.interp(stretch, c.stretch, c.stress) for c in (a, b))
        mean = (stress + other) / 2
        difference = float(np.sqrt(np.mean((stress - other) ** 2) / np.mean(mean**2)))
        if difference <= allowed:
            continue
        ratio = float(stress @ other / (stress @ stress))
        pair = (i, j) if ratio >= 1.0 else (j, i)
        names = (curves[pair[0]].name, curves[pair[1]].name)
        ratio = float(stress @ other / ((stress @ stress) if ratio >= 1.0 else (other @ other)))
        contradictions.append(
            CurveContradiction(*pair, names, ratio, difference, allowed, (float(stretch[0]), float(stretch[-1])))
        )
    return contradictions


@dataclasses.dataclass(frozen=True, eq=False)
class SeparateFits:
    """Curves that contradict each other, and the chosen law fitted to each of the measured curves separately."""

    pairs: tuple[CurveContradiction, ...]
    curves: tuple[TensileCurve, ...]
    own: tuple[FittedLaw, ...]

    @property
    def sentences(self) -> list[str]:
        """Report the contradictions, the separate material of each curve, and their spread."""
        lines = [pair.sentence for pair in self.pairs]
        for curve, ranking in zip(self.curves, self.own, strict=True):
            values = ", ".join(
                f"{p.name} {' '.join(units.with_prefix(ranking.fit.values[p.name], p.unit))}" for p in ranking.fit.parameters
            )
            rms = next(iter(ranking.fit.summaries.values())).rms / 1e3
            modulus = " ".join(units.with_prefix(ranking.material.shear_modulus_0, "Pa"))
            lines.append(
                f"only {curve.name}: {ranking.choice.name} with {values}, shear modulus {modulus}, rms {rms:.3g} kPa: "
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
            float(specimens.respond(self.own[i].material, np.array([top]), self.curves[i].mode).stress[0]) for i in involved
        ]
        ends = [" ".join(units.with_prefix(value, "Pa")) for value in (min(moduli), max(moduli), min(stresses), max(stresses))]
        return (
            f"spread: shear modulus {ends[0]} to {ends[1]}, nominal stress at stretch {top:.3g} {ends[2]} to {ends[3]}; the "
            "joint fit lies between the curves and matches none of them, so simulate with both extremes"
        )


def separate_file(separate: SeparateFits, curve: TensileCurve) -> str:
    """Return the name of the material file of a curve's separate fit."""
    number = next(i for i, other in enumerate(separate.curves, 1) if other is curve)
    return f"fitted-curve{number}.toml"


# ----------------------------------------------------------------------------------------------------------------------
# Report of all laws fitted to the same measurements, and the chosen one.


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class FitReport(cards.ResultCard):
    """All fitted laws, best first, with curves and options.

    Attributes:
        curves: Measured curves within the fit's range.
        how: The weighting in words.
        separate: Curves that contradict each other, with a separate fit of each; None if there are none.
        devices: Each device in words; empty for only curves.
        notes: What was left out, and why.
        photographs: By law: each photograph with its fitted state; empty but for outlines.
        oscillations: Fitted moduli, tan delta or vibrations at frequencies.
        inflation: A fitted table of a device's pressures.
    """

    laws: tuple[FittedLaw, ...]
    comparison: Comparison
    curves: tuple[TensileCurve, ...]
    how: str
    separate: SeparateFits | None = None
    devices: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    photographs: Mapping[str, Sequence[MatchedPhotograph]] = dataclasses.field(default_factory=dict)
    oscillations: tuple[FrequencyTest, ...] = ()
    inflation: MatchedInflation | None = None

    def _line(self) -> str:
        return self.chosen._line()

    def _figures(self) -> cards.Table:
        return self.chosen._figures()

    def _remarks(self) -> list[str]:
        return [self.verdict, *self.chosen._remarks(), *(self.separate.sentences if self.separate else [])]

    @property
    def chosen(self) -> FittedLaw:
        """The preferred law; if rejected, the best accepted one; if all are rejected, the preferred one."""
        preferred = next(law for law in self.laws if law.fit is self.comparison.preferred)
        return next((candidate for candidate in (preferred, *self.laws) if candidate.sound), preferred)

    @property
    def material(self) -> Material:
        """The material of the chosen law."""
        return self.chosen.material

    @property
    def ranges(self) -> list[str]:
        """The measurements: devices, the fitted part of each curve, and what was left out."""
        curves = [
            f"{c.name} ({c.mode}): stretch {c.stretch.min():.4g} to {c.stretch.max():.4g}, {len(c.stretch)} points"
            + (f" in {np.ptp(c.time):.3g} s" if c.time is not None else "")
            + "".join(f"; {remark}" for remark in (*filter(None, [c.source]), *c.remarks))
            for c in self.curves
        ]
        return [*self.devices, *self.notes, *curves, *(test.sentence for test in self.oscillations)]

    @property
    def verdict(self) -> str:
        """The chosen law, and why."""
        preferred = self.comparison.preferred
        if self.chosen.fit is preferred:
            return self.comparison.sentence
        fitted = next(law for law in self.laws if law.fit is preferred)
        reason = "is not stable within the range" if fitted.verdict.flags else "was rejected"
        reason = reason if preferred.converged else "did not converge"
        ratio = {rank.fit.label: rank.ratio for rank in self.comparison.ranked}
        times = ratio[self.chosen.fit.label] / ratio[preferred.label]
        return (
            f"{self.comparison.sentence}; but {preferred.label} {reason}, so {self.chosen.choice.name} is used, with "
            f"a misfit {times:.3g} times as large"
        )


# ----------------------------------------------------------------------------------------------------------------------
# Plausibility of a fitted law: compare it with published values, because a scale error common to all pressures shows nowhere
# else.


CASTABLE_MODULI = (5e3, 1.5e6)
"""Range of secant shear moduli in Pa of casting silicones, from Ecoflex 00-10 (7 kPa) to hard PDMS (1 MPa)."""
ANY = "any"
"""Instead of a silicone's name: any casting silicone."""
REFERENCE_STRETCH = 1.5
"""Uniaxial stretch at which moduli are compared, or the largest fitted one."""
SEVERAL_SOURCES = (1.05, 1.25)
"""Accepted factors below and above the published values of a product measured by several laboratories; parts stiffen with
age."""
ONE_SOURCE = (1.7, 1.7)
"""The same for a product with one published curve: laboratories differ by up to a factor two."""
OWN_LAW = (4.0, 4.0)
"""The same for a case's own law that is not a named silicone."""
FACTORS = (
    (0.1, "a tenth of the expected: were mm listed as cm, cm of water as mm, or kPa as cm of water?"),
    (10.0, "ten times the expected: were mm listed as cm, or cm of water or mbar as kPa?"),
    (0.5, "half of the expected: was the level of only one tube listed?"),
    (2.0, "twice the expected: was the difference of the two tubes doubled?"),
    (0.01, "a hundredth of the expected: were hPa or mbar listed as Pa?"),
    (100.0, "a hundred times the expected: were Pa listed as hPa or mbar?"),
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Expected:
    """Published moduli of a silicone, named in words: the laws published for it, or the one that the case has, with
    factors of room below and above; ``known`` if the silicone is named."""

    label: str
    curves: tuple[Material, ...]
    room: tuple[float, float]
    known: bool

    def range(self, stretch: float) -> tuple[float, float]:
        """Return the lowest and highest plausible secant shear modulus in Pa at a stretch."""
        if not self.curves:
            return CASTABLE_MODULI
        moduli = [specimens.secant_modulus(curve, stretch) for curve in self.curves]
        return min(moduli) / self.room[0], max(moduli) * self.room[1]


def expected(silicone: str | None, material: Material | None = None) -> Expected:
    """Return the expected moduli of a silicone by its name, or `ANY`, or else of a case's own material; `FitError` for an
    unknown name."""
    name = silicone or (silicones.named(material) if material is not None else None)
    if name == ANY or (name is None and material is None):
        return Expected("casting silicones", (), (1.0, 1.0), silicone == ANY)
    if name is None:
        assert material is not None
        return Expected("the case's own material", (material,), OWN_LAW, False)
    curves = published(name)
    if not curves:
        raise FitError(f"silicone {units.brief(name)} is unknown; {errors.known_are(name, silicones.PRODUCTS, ', and any')}")
    return Expected(f"published curves of {name}", curves, SEVERAL_SOURCES if len(curves) > 1 else ONE_SOURCE, True)


def published(name: str) -> tuple[Material, ...]:
    """Return the laws of all tension sources of the product of a name, for any source in the name."""
    sources = silicones.PRODUCTS.get(silicones.product_of(name), ()) if silicones.silicone_called(name) else ()
    return tuple(source.material for source in sources if source.pulled)


def objection(material: Material, largest: float, known: Expected) -> str:
    """Return a sentence if a law fitted up to a largest stretch is implausible for its silicone; else ""."""
    stretch = min(REFERENCE_STRETCH, max(largest, 1.05))
    modulus, (low, high) = specimens.secant_modulus(material, stretch), known.range(stretch)
    if low <= modulus <= high:
        return ""
    side = f"{low / modulus:.3g} times below" if modulus < low else f"{modulus / high:.3g} times above"
    hints = [words for factor, words in FACTORS if modulus > 0.0 and low <= modulus / factor <= high]
    hint = f"; the pressures would then be {hints[0]}" if hints else ""
    kind = "have" if known.known or not known.curves else "leads to"
    return (
        f"its shear modulus at stretch {stretch:.3g} is {modulus / 1e3:.3g} kPa, {side} what {known.label} {kind} "
        f"({low / 1e3:.3g} to {high / 1e3:.3g} kPa){hint}. Check the unit of the pressures, or name the silicone (--silicone "
        "NAME, or --silicone any if it is not listed)"
    ).replace("?.", "?")


def hold_against(law: Material, largest: float, known: Expected, judgement: least_squares.Judgement) -> least_squares.Judgement:
    """Return a judgement that includes the silicone's modulus, unless something else is already wrong."""
    said = "" if judgement.objections else objection(law, largest, known)
    return dataclasses.replace(judgement, objections=(said,)) if said else judgement


def shifted(fit: least_squares.LeastSquaresFit, choice: problem.LawChoice, given: Mapping[str, float]) -> dict[str, float]:
    """Return a fit's values with other ones of parameters that it takes as given, Poisson's ratio among them, to first order;
    none where the sources cannot be evaluated there. For all ranks together."""
    values, moved = {**fit.values, **given}, []
    other = dataclasses.replace(choice, poisson=given.get("poisson", choice.poisson))
    try:
        for source in fit.problem.sources:
            own = dataclasses.replace(source, choice=other) if isinstance(source, residuals.TensileResiduals) else source
            moved.append(own.evaluate(values, False)[0])
    except (problem.CannotEvaluate, MaterialError):
        return {}
    change = np.zeros(len(fit.residuals))
    change[: fit.count] = np.concatenate(moved) - fit.residuals[: fit.count]
    size = least_squares.column_lengths(fit.jacobian)
    steps = np.linalg.lstsq(fit.jacobian / size, -change, rcond=least_squares.MIN_SINGULAR_VALUE)[0] / size
    return values | {p.name: fit.values[p.name] + step for p, step in zip(fit.free, steps.tolist(), strict=True)}


def with_rubber(
    choice: problem.LawChoice, fit: least_squares.LeastSquaresFit, judgement: least_squares.Judgement
) -> least_squares.Judgement:
    """Return a judgement with a note on every parameter of the law that would change by more than its standard error with the
    Poisson's ratio of rubber, see `shifted`."""
    if choice.poisson == laws.DEFAULT_POISSON_RATIO or any(p.name == "poisson" for p in fit.free):
        return judgement
    values, said = shifted(fit, choice, {"poisson": laws.DEFAULT_POISSON_RATIO}), []
    for p in fit.free:
        if p.name in choice.names and p.name in values:
            error, now, then = fit.error(p.name), fit.values[p.name], values[p.name]
            if abs(then - now) > error:
                texts = [" ".join(units.with_prefix(value, p.unit, error)) for value in (then, now)]
                said.append(f"{p.name} about {texts[0]} instead of {texts[1]}")
    if not said:
        return judgement
    note = (
        f"the answer depends on Poisson's ratio, given as {choice.poisson:g}: with {laws.DEFAULT_POISSON_RATIO:g}, as of "
        f"rubber (--poisson {laws.DEFAULT_POISSON_RATIO:g}), {', '.join(said)}"
    )
    return dataclasses.replace(judgement, notes=(*judgement.notes, note))


def form_objections(material: Material, curves: Sequence[TensileCurve]) -> list[str]:
    """Return a sentence if a law fitted to pulls alone predicts other tests as no rubber behaves; see `laws.FORM_RANGE`."""
    if any(curve.mode != "uniaxial" for curve in curves) or not curves:
        return []
    stretch, ratios, shares = specimens.form_shares(material, residuals.largest_strain(curves))
    low, high = laws.FORM_RANGE
    beyond = np.abs(shares - (low + high) / 2) > 1.5 * (high - low)
    if not beyond.any():
        return []
    k = int(np.flatnonzero(beyond)[-1])
    return [
        f"in equibiaxial tension at stretch {stretch[k]:.3g} its stress would be {ratios[k]:.3g} times that of a law of I1 "
        "with the same curve in uniaxial tension, as of no rubber; pulls do not determine that: add an equibiaxial or planar "
        "test, or take such a law (--material yeoh)"
    ]


def stretch_of(strain: float) -> float:
    """Return the uniaxial stretch in tension with this I1 - 3."""
    return float(max(np.roots([1.0, 0.0, -(strain + 3.0), 2.0]).real))


def caution(known: Expected) -> str:
    """Return a warning if the silicone is unknown; else ""."""
    if known.known:
        return ""
    return (
        "the silicone is not given, so a scale error common to all pressures (such as the level of only "
        "one tube) cannot be detected; name it with --silicone"
    )


# ----------------------------------------------------------------------------------------------------------------------
# Text, tables and files of a fit: for the terminal, the report, and simulations.


def correlation_rows(law: FittedLaw) -> list[list[str]]:
    """Return the correlations of the free parameters below the diagonal, as texts; empty for one parameter, and where a
    parameter at its bound has none."""
    names, R = [p.name for p in law.fit.free if not p.hidden], law.fit.correlations
    texts = np.where(np.isfinite(R), np.char.mod("%+.3f", R), "")
    return [[names[i], *texts[i, :i].tolist()] for i in range(1, len(names))]


def residual_rows(law: FittedLaw) -> list[tuple[str, str, str, str, str]]:
    """Return the group, rms, mean, largest residual and correlation length, as texts."""
    rows = []
    for name, group in law.fit.summaries.items():
        factor, unit = (1e-3, "kPa") if group.unit == "Pa" else (1.0, group.unit)
        numbers = [f"{value * factor:.3g} {unit}" for value in (group.rms, group.mean, group.largest)]
        rows.append((name, *numbers, f"{group.run:.0f} of {group.count}"))
    return rows  # type: ignore[return-value]


def as_text(report: FitReport) -> str:
    """Return the report for a terminal."""
    lines = [*report.ranges, report.how, ""]
    for law in report.laws:
        modulus, unit = units.with_prefix(law.material.shear_modulus_0, "Pa")
        lines.append(f"{law.choice.name}: shear modulus {modulus} {unit}, Poisson's ratio {law.material.poisson:g} (given)")
        lines += [
            f"  {name:14s} {value:>12s} {unit:4s} 95 %: {interval}" for name, value, unit, interval in parameter_rows(law)
        ]
        for name, *others in correlation_rows(law):
            pairs = ", ".join(f"{p.name} {text}" for p, text in zip(law.fit.free, others, strict=False) if text)
            lines += [f"  correlation of {name}: {pairs}"] if pairs else []
        for name, rms, mean, largest, run in residual_rows(law):
            lines.append(f"  {name}: rms {rms}, mean {mean}, largest {largest}; residual correlation length: {run}")
        lines += [
            f"  {fit.device}: chi squared {fit.chi2:.1f} of {fit.count} values ({fit.chi2 / fit.count:.3g} per value)"
            for fit in law.devices
        ]
        lines += [f"  {text}" for text in (law.material.remark,) if text]
        lines += [f"  {'rejected' if text in law.objections else 'warning'}: {text}" for text in law.warnings]
        lines += [f"  {text}" for text in (*least_squares.unseen(law.fit), *law.verdict.notes, law.form_note) if text]
        lines.append("")
    if len(report.laws) > 1:
        lines += [f"  {law.fit.label:14s} AICc +{law.aicc:.4g}, BIC {law.bic:+.4g}" for law in report.comparison.ranked]
    lines.append(report.verdict)
    if report.separate:
        lines += ["", *report.separate.sentences]
    return "\n".join(lines)


def material_toml(law: FittedLaw, report: FitReport) -> str:
    """Return a material file for ``--material``, with the basis of the fit."""
    fit = law.fit
    intervals = {p.name: [float(end) for end in law.interval(p.name)] for p in fit.free if not p.hidden}
    if law.form_error:
        intervals[law.form] = [sign * units.HALF_WIDTH_95 * law.form_error for sign in (-1.0, 1.0)]
    hidden = {p.name for p in fit.parameters if p.hidden}
    about: dict[str, object] = {
        "range": report.ranges,
        "how": report.how,
        "sound": law.sound,
        "values": {name: float(value) for name, value in fit.values.items() if name not in hidden},
        "intervals_95": intervals,
        "warnings": [*law.warnings],
        "corrections": [*law.judgement.notes],
        "unseen": [*least_squares.unseen(fit)],
        "stability": [*law.verdict.notes],
    }
    if report.separate:
        about["apart"] = report.separate.sentences
    return tomli_w.dumps({"material": materials.to_table(law.material), "fit": about})


def as_json(report: FitReport) -> str:
    """Return every number of the report, in Pa and pure numbers."""
    return json.dumps(
        {
            "range": report.ranges,
            "how": report.how,
            "chosen": report.chosen.choice.name,
            "preferred": report.comparison.preferred.label,
            "verdict": report.verdict,
            "apart": report.separate.sentences if report.separate else [],
            "laws": [_law_json(law, report) for law in report.laws],
        },
        indent=1,
    )


def _law_json(law: FittedLaw, report: FitReport) -> dict[str, object]:
    fit = law.fit
    shown = [i for i, p in enumerate(fit.free) if not p.hidden]
    free, covariance = law.covariance
    known = [*shown, *range(len(fit.free), len(free))]
    ranked = next(r for r in report.comparison.ranked if r.fit is fit)
    return {
        "law": law.choice.name,
        "material": materials.to_table(law.material),
        "parameters": [
            {
                "name": p.name, "unit": p.unit, "value": fit.values[p.name], "fixed": p.fixed,
                "standard_error": files.json_number(fit.error(p.name)),
                "interval_95": [files.json_number(end) for end in law.interval(p.name)],
                "start": p.start, "bounds": [files.json_number(p.lower), files.json_number(p.upper)],
                "prior": dataclasses.asdict(p.prior) if p.prior else None,
            }
            for p in fit.parameters if not p.hidden
        ],
        "hidden": [
            {
                "name": p.words, "unit": p.unit, "value": fit.values[p.name],
                "standard_error": files.json_number(fit.error(p.name)),
            }
            for p in fit.parameters if p.hidden
        ],
        "free": [free[i] for i in known],
        "covariance": [[files.json_number(v) for v in row] for row in covariance[np.ix_(known, known)]],
        "correlations": [[files.json_number(v) for v in row] for row in fit.correlations[np.ix_(shown, shown)]],
        "devices": [{"name": device.device, "chi2": device.chi2, "values": device.count} for device in law.devices],
        "singular_values": least_squares.singular_values(fit)[0].tolist(),
        "residuals": {name: dataclasses.asdict(group) for name, group in fit.summaries.items()},
        "profiles": {
            name: {"values": p.values.tolist(), "rises": [*map(files.json_number, p.rises)], "limit": p.limit}
            for name, p in law.profiles.items()
        },
        "deviance": fit.deviance, "scatter": fit.scatter, "independent": fit.independent, "loss": fit.loss,
        "errors": fit.errors, "evaluations": fit.evaluations, "aicc": fit.aicc, "bic": fit.bic,
        "aicc_behind": ranked.aicc, "bic_behind": ranked.bic, "misfit_ratio": ranked.ratio,
        "sound": law.sound, "objections": list(law.objections), "corrections": list(law.judgement.notes),
        "converged": fit.converged, "warnings": list(law.warnings), "unseen": list(least_squares.unseen(fit)),
        "stability": list(law.verdict.notes),
    }  # fmt: skip


def write_curves(path: Path, laws: Sequence[FittedLaw], curves: Sequence[TensileCurve]) -> None:
    """Write measured and fitted nominal stresses in Pa, one row per point; times of curves without them are empty."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        timed = any(curve.time is not None for curve in curves)
        names = [*(["time_s"] if timed else []), "stretch", "measured_Pa", *(f"{law.choice.name}_Pa" for law in laws)]
        rows.writerow(["curve", "test", *names])
        for curve in curves:
            columns = [curve.stretch, curve.stress, *(residuals.predicted(law.material, curve) for law in laws)]
            if timed:
                columns.insert(0, np.full_like(curve.stretch, np.nan) if curve.time is None else curve.time)
            for row in np.column_stack(columns):
                rows.writerow([curve.name, curve.mode, *("" if np.isnan(v) else f"{v:.9g}" for v in row)])


def write_oscillations(path: Path, report: FitReport) -> None:
    """Write measured and fitted moduli in Pa, and tan delta, one row per frequency."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["test", "quantity", "frequency_Hz", "measured", *(law.choice.name for law in report.laws)])
        for test in report.oscillations:
            fitted = [test.predicted(law.material) for law in report.laws]
            for kind, measured in test.measured.items():
                for row in np.column_stack([test.frequency, measured, *(values[kind] for values in fitted)]):
                    rows.writerow([test.name, kind, *(f"{value:.9g}" for value in row)])


# ----------------------------------------------------------------------------------------------------------------------
# Material files of a fit, with different names for accepted and rejected ones.


SOUND, UNSOUND, EARLIER = "fitted", "unsound", "earlier-"


def write_materials(report: FitReport, folder: Path, more: Mapping[str, str] = MappingProxyType({})) -> None:
    """Write each law's material file, as ``fitted.toml`` only if the chosen law is accepted, and the texts of further files.

    An earlier fit's ``fitted*.toml`` that this one does not replace is renamed to ``earlier-fitted*.toml``: nobody shall take
    it for this one's. An earlier ``unsound*.toml`` is removed.
    """
    texts = {name_of(report.chosen): material_toml(report.chosen, report)}
    if len(report.laws) > 1:
        texts |= {name_of(fitted, fitted.choice.name): material_toml(fitted, report) for fitted in report.laws}
    texts |= more
    retire(folder, set(texts))
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")


def name_of(fitted: FittedLaw, law: str = "") -> str:
    """Return the file name of a law's material; without a law, the chosen one's."""
    return f"{SOUND if fitted.sound else UNSOUND}{'-' + law if law else ''}.toml"


def retire(folder: Path, replaced: set[str] = frozenset()) -> None:  # type: ignore[assignment]
    """Rename an earlier fit's material files, except those in ``replaced``."""
    for stem in (SOUND, UNSOUND):
        for path in sorted({*folder.glob(f"{stem}.toml"), *folder.glob(f"{stem}-*.toml")}):
            if path.name in replaced or not _of_a_fit(path):
                continue
            if stem == UNSOUND:
                path.unlink()
            else:
                path.replace(path.with_name(f"{EARLIER}{path.name}"))


def _of_a_fit(path: Path) -> bool:
    """Return whether `write_materials` has written a file; a user's file stays."""
    return files.has_table("material")(path) and files.has_table("fit")(path)
