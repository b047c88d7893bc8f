"""Fit laws to tensile curves, compare them, and check their plausibility: from curves to a report."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from scipy.optimize import nnls

from measurement import robust
from softmodels.common import names
from softmodels.common.arrays import Array
from softmodels.common.names import checked
from softmodels.common.processes import one_at_a_time
from softmodels.fitting import least_squares, problem
from softmodels.fitting.comparison import (
    Comparison,
    Expected,
    FitReport,
    FittedLaw,
    SeparateFits,
    compare,
    contradictions,
    expected,
    form_objections,
    hold_against,
    stretch_of,
    with_rubber,
)
from softmodels.fitting.curves import oscillation, residuals, sample
from softmodels.fitting.curves.curve import (
    TensileCurve,
    TensileError,
    loop,
    read_curves,
    segments,
    small_modulus,
    taut,
    without_jumps,
)
from softmodels.fitting.curves.residuals import spectrum
from softmodels.fitting.problem import FitError, FitOptions
from softmodels.materials import specimens
from softmodels.materials.laws import FORM, Material, MaterialError

# ----------------------------------------------------------------------------------------------------------------------
# The fit of one law to tensile curves, from starts in closed form.


@dataclasses.dataclass(frozen=True, eq=False)
class _Task:
    """Curves, laws, and how to fit them."""

    curves: Sequence[TensileCurve]
    choices: Sequence[problem.LawChoice]
    options: FitOptions
    progress: Callable[[str], None]
    oscillations: Sequence[oscillation.FrequencyTest] = ()

    @property
    def error(self) -> residuals.StressError:
        return residuals.StressError.from_text(self.options.stress_error)

    @property
    def errors(self) -> str:
        return "stated" if self.error.stated else "unknown"

    def report(self) -> FitReport:
        known = expected(self.options.silicone)
        fits, scale = self._fit_all(), None
        if self.options.robust:
            # The closest law determines the outliers for all laws.
            scale = min(map(spread, fits))
            fits = self._fit_all("soft_l1", scale)
        judged = [residuals.on_yardstick(fit, fit.problem.sources) for fit in fits] if len(fits) > 1 else None  # type: ignore[arg-type]
        comparison = compare(fits, judged)
        laws = self._laws(fits, comparison, known)
        report = FitReport(
            laws, comparison, tuple(self.curves), _fit_options(self.options, self.is_sample), notes=tuple(self._notes(laws)),
            oscillations=tuple(self.oscillations),
        )  # fmt: skip
        report = self._compared(report, scale)
        return dataclasses.replace(report, curves=tuple(residuals.counted_from(self.curves, report.chosen.fit.values)))

    @functools.cached_property
    def is_sample(self) -> bool:
        """Whether the curves are specimens whose scatter shows; else, or where such a factor is set, each has one of the usual
        size."""
        return sample.is_sample(self.curves) and not any(name.startswith("gauge") for name in self.options.changes)

    def _notes(self, laws: Sequence[FittedLaw]) -> list[str]:
        return sample.sentences(laws[0].fit, self.curves) if isinstance(laws[0].fit, sample.SampleFit) else []

    def _compared(self, report: FitReport, scale: float | None) -> FitReport:
        """Return the report with separate fits of curves that contradict each other."""
        if self.is_sample or not (pairs := contradictions(self.curves, self.options.gauge_error)):
            return report
        own = tuple(self._alone(report.chosen.choice, curve, scale) for curve in self.curves)
        return dataclasses.replace(report, separate=SeparateFits(tuple(pairs), tuple(self.curves), own))

    def _fit_all(self, loss: str = "linear", scale: float | None = None) -> list[least_squares.LeastSquaresFit]:
        fits = []
        for i, choice in enumerate(self.choices, 1):
            if len(self.choices) > 1:
                self.progress(f"fitting {choice.name}, law {i} of {len(self.choices)}")
            gauge = 0.0 if self.is_sample else self.options.gauge_error
            sources, extra = residuals.residuals_of(self.curves, choice, self.error, gauge, level=True)
            names = (*choice.names, *(p.name for p in extra.parameters))
            changes = self.options.changes_of(names)
            fit = fit_law_to_curves(choice, sources, extra, changes=changes, errors=self.errors, loss=loss, scale=scale)
            if self.is_sample:
                again = sample.weighted_alike(fit)
                scaled = None if loss == "linear" else 1.0  # the errors of the first fit's sources are
                fit = fit_law_to_curves(choice, again, extra, changes=changes, errors=self.errors, loss=loss, scale=scaled)
                fit = sample.SampleFit.of(fit, min(self.options.gauge_error, problem.LOAD_CELL_ERROR))
            fits.append(fit)
        return fits

    def _laws(
        self, fits: Sequence[least_squares.LeastSquaresFit], comparison: Comparison, known: Expected
    ) -> tuple[FittedLaw, ...]:
        strain, laws = residuals.largest_strain(self.curves), []
        for ranked in comparison.ranked:
            choice = self.choices[fits.index(ranked.fit)]
            if self.options.profiles and not self.is_sample and len(ranked.fit.free) > 2:
                self.progress(f"intervals of {choice.name}")
            profiles = {
                p.name: least_squares.profile(ranked.fit, p.name) for p in ranked.fit.free if self._profiled(ranked.fit, p.name)
            }
            material = self._material(choice, ranked.fit)
            judgement = least_squares.Judgement(
                (*self._objections(material, ranked.fit), *form_objections(material, self.curves)),
                tuple(self._cautions(ranked.fit)),
            )
            judgement = with_rubber(choice, ranked.fit, judgement)
            if self.options.silicone:
                judgement = hold_against(material, stretch_of(strain), known, judgement)
            form_slopes = ranked.fit.problem.form_slopes(ranked.fit.values, FORM)
            verdict = specimens.judge(material, strain)
            laws.append(FittedLaw(choice, ranked.fit, material, verdict, profiles, judgement, form_slopes=form_slopes))
        return tuple(laws)

    def _profiled(self, fit: least_squares.LeastSquaresFit, name: str) -> bool:
        return self.options.profiles and not self.is_sample

    def _material(self, choice: problem.LawChoice, fit: least_squares.LeastSquaresFit) -> Material:
        return choice.material(fit.values, residuals.stretches_of(self.curves))

    def _objections(self, material: Material, fit: least_squares.LeastSquaresFit) -> list[str]:
        return []

    def _cautions(self, fit: least_squares.LeastSquaresFit) -> list[str]:
        """Return warnings on curves that are stiffer than any silicone, and on those whose unloading no law without a memory
        can follow."""
        return [curve.stiff for curve in self.curves if curve.stiff] + [
            f"{curve.name} unloads below its loading: the loop is {100 * curve.loop:.2g} % of the work, which a law without a "
            "memory does not lose; --memory fits it"
            for curve in self.curves
            if curve.loop >= SMALLEST_LOOP
        ]

    def _alone(self, choice: problem.LawChoice, curve: TensileCurve, scale: float | None) -> FittedLaw:
        sources, extra = residuals.residuals_of([curve], choice, self.error, self.options.gauge_error)
        changes = self.options.changes_of(choice.names)
        loss = "linear" if scale is None else "soft_l1"
        fit = fit_law_to_curves(choice, sources, extra, changes=changes, errors=self.errors, loss=loss, scale=scale)
        material = choice.material(fit.values, residuals.stretches_of([curve]))
        verdict = specimens.judge(material, residuals.largest_strain([curve]))
        return FittedLaw(choice, fit, material, verdict, {}, form_slopes=fit.problem.form_slopes(fit.values, FORM))


class _MemoryTask(_Task):
    """Laws with a memory, and the histories to fit them to."""

    is_sample = False

    @functools.cached_property
    def spectrum(self) -> residuals.Spectrum:
        frequencies = [float(value) for test in self.oscillations for value in test.frequency]
        return spectrum(self.curves, frequencies=frequencies, count=self.options.branches)

    @functools.cached_property
    def softens(self) -> tuple[str, ...]:
        """Names of the softening's parameters that the data can show, if it softens."""
        return (
            specimens.SOFTENING[: 3 if residuals.several_amplitudes(self.curves) else 2]
            if residuals.may_soften(self.curves)
            else ()
        )

    @functools.cached_property
    def stiffer(self) -> dict[str, float]:
        """By law: how many times its misfit is as large without softening, where it softens."""
        return {}

    def _fit_all(self, loss: str = "linear", scale: float | None = None) -> list[least_squares.LeastSquaresFit]:
        """Fit every law; where the errors are usual ones again, with those of the moving and the holding parts as they scatter
        about the closest law."""
        fits = self._fits([np.ones(len(curve.stretch)) for curve in self.curves], loss, scale)
        if self.options.stress_error != "auto" or not any(
            len({held for *_, held in segments(curve.time, curve.stretch)}) > 1
            for curve in self.curves
            if curve.time is not None
        ):
            return fits
        closest = min(fits, key=lambda fit: fit.deviance)
        ends = np.cumsum([len(curve.stretch) for curve in self.curves])
        parts = np.split(closest.residuals[: ends[-1]], ends[:-1])
        sources: list[residuals.TensileResiduals] = list(closest.problem.sources[: len(ends)])  # type: ignore[arg-type]
        return self._fits([source.part_scales(r) for source, r in zip(sources, parts, strict=True)], loss, scale)

    def _fits(self, scales: Sequence[Array], loss: str, scale: float | None) -> list[least_squares.LeastSquaresFit]:
        """Fit every law with the points' errors scaled."""
        fits: list[least_squares.LeastSquaresFit] = []
        self.stiffer.clear()
        for choice in self.choices:
            self.progress(f"fitting {choice.name} and its memory")
            sources, extra = residuals.residuals_of(
                self.curves, choice, self.error, self.options.gauge_error, level=True, spectrum=self.spectrum
            )
            sources = [dataclasses.replace(s, errors=s.errors * by) for s, by in zip(sources, scales, strict=True)]
            more = oscillation.residuals_of(
                self.oscillations, choice, self.error, self.options.gauge_error, self.spectrum, len(sources) + 1
            )
            extra = problem.Extra(more.sources, (*extra.parameters, *more.parameters))

            def fitted(
                changes: problem.Changes, *further: str, choice: problem.LawChoice = choice,
                sources: Sequence[residuals.TensileResiduals] = sources,
                extra: problem.Extra = extra,
            ) -> least_squares.LeastSquaresFit:  # fmt: skip
                own = [dataclasses.replace(source, further=further) for source in sources]
                return fit_law_to_curves(choice, own, extra, changes=changes, loss=loss, errors=self.errors, scale=scale)

            asked = [name for name in specimens.SOFTENING if name in self.options.changes]
            if asked and not self.softens:
                why = "no test has a second loading, or a hold after an unloading, that would show it"
                raise FitError(f"{asked[0]} cannot be set: {why}")
            flow = specimens.FLOW if any(name in self.options.changes for name in specimens.FLOW) else ()
            fit = fitted({k: v for k, v in self.options.changes.items() if k not in specimens.SOFTENING}, *flow)
            if self.softens:
                softer = fitted(self.options.changes, *self.softens, *flow)
                lead = next(rank.aicc for rank in compare([fit, softer]).ranked if rank.fit is fit)
                if asked or (softer.converged and lead > DECISIVE_AICC and softer.interval(specimens.SOFTENING[0])[0] > 0.0):
                    self.stiffer[choice.name] = math.sqrt(fit.deviance / softer.deviance)
                    fit = softer
            fits.append(fit)
        return fits

    def _material(self, choice: problem.LawChoice, fit: least_squares.LeastSquaresFit) -> Material:
        return residuals.remembering(super()._material(choice, fit), self.spectrum, fit.values)

    def _profiled(self, fit: least_squares.LeastSquaresFit, name: str) -> bool:
        """A weight that ended at zero has no other interval."""
        return self.options.profiles or fit.at_bounds.get(name) == 0.0

    def _objections(self, material: Material, fit: least_squares.LeastSquaresFit) -> list[str]:
        return loop_objections(residuals.counted_from(self.curves, fit.values), material)

    def _cautions(self, fit: least_squares.LeastSquaresFit) -> list[str]:
        """Return warnings on factors of tests that their errors do not explain: they bend what other tests would show."""
        tests: list[TensileCurve | oscillation.FrequencyTest] = [*self.curves, *self.oscillations]
        said = [curve.stiff for curve in self.curves if curve.stiff] + [
            f"{p.name} ({curve.name}) is {fit.values[p.name]:.3g}, beyond {FAR_GAUGE:g} standard errors of such a factor: the "
            "law does not follow the tests together; compare laws (--material all), or fit no factors (--gauge-error none)"
            for p, curve in zip([p for p in fit.parameters if p.name.startswith("gauge")], tests, strict=False)
            if p.prior and abs(fit.values[p.name] - p.prior.mean) > FAR_GAUGE * p.prior.error
        ]
        if not self.oscillations and not residuals.separates(self.curves):
            said.append(
                "pulls at one rate hardly tell relaxation from the law: add a test that unloads, holds, or has another rate"
            )
        return said

    def _compared(self, report: FitReport, scale: float | None) -> FitReport:
        """Return the report as it is: tests at several rates may differ."""
        return report

    def _notes(self, laws: Sequence[FittedLaw]) -> list[str]:
        said = [self.spectrum.sentence]
        if not self.softens and self.curves:
            said.append("no softening is fitted: only a second loading, or a hold after an unloading, tells it from relaxation")
        elif not self.stiffer:
            said.append("no softening: relaxation follows the later loadings as well")
        said += [
            f"{name} softens (softening: Ogden & Roxburgh's 1/r, m, beta); without it the misfit is {times:.3g} times as large"
            for name, times in self.stiffer.items()
        ]
        return said + loop_notes(residuals.counted_from(self.curves, laws[0].fit.values), laws[0].material)


START_MODULUS = 30e3
"""Starting shear modulus in Pa without curves."""

DECISIVE_AICC = 10.0
"""Lead in AICc from which on a memory softens: no support for the other (Burnham & Anderson 2002, section 2.6)."""
MEMORY_STARTS = 3
"""Number of a law's starts that are tried with branches."""


def starts_for(choice: problem.LawChoice, sources: Sequence[residuals.TensileResiduals]) -> list[dict[str, float]]:
    """Return the starting values of a law from the curves, best first; with branches those of what branches of any weight
    leave of the stresses (Frisch & Waugh 1933)."""
    curves = [source.curve for source in sources]
    target = np.concatenate([s.curve.stress / s.errors for s in sources])
    # Standardised stresses of all branches over their G, shape (n, k).
    relaxing = [
        residuals.branch_stresses(s.curve, s.spectrum.times) / s.errors[:, None] for s in sources if s.spectrum is not None
    ]
    branches = np.vstack(relaxing) if relaxing else None
    Q = None if branches is None else np.linalg.qr(branches)[0]

    def left(A: Array) -> Array:
        return A if Q is None else np.asarray(A - Q @ (Q.T @ A))

    def design(material: Material, names: Sequence[str]) -> Array:
        responses = [specimens.respond(material, s.curve.stretch, s.curve.mode, names) for s in sources]
        return left(np.vstack([response.slopes / s.errors[:, None] for response, s in zip(responses, sources, strict=True)]))

    modulus, strain = _modulus(curves), residuals.largest_strain(curves)
    starts = problem.closed_starts(choice, design, left(target), modulus, strain)
    if branches is None:
        return starts
    weighed = sorted(_weighted_starts(choice, sources, starts, target, branches), key=lambda response: response[0])
    spectrum = sources[0].spectrum
    plain = {**choice.from_modulus(0.7 * modulus, strain), **dict.fromkeys(spectrum.names if spectrum else (), 0.1)}
    return [start for _, start in weighed[:MEMORY_STARTS]] or [plain]


def _modulus(curves: Sequence[TensileCurve]) -> float:
    """Return the median small-strain shear modulus in Pa."""
    return float(np.median([small_modulus(curve) for curve in curves]))


def _weighted_starts(
    choice: problem.LawChoice,
    sources: Sequence[residuals.TensileResiduals],
    starts: Sequence[Mapping[str, float]],
    target: Array,
    branches: Array,
) -> Iterator[tuple[float, dict[str, float]]]:
    """Yield each start of the law with the weights that fit best with its shape, by non-negative least squares, and the
    misfit."""
    for start in starts:
        try:
            material = choice.material(start)
        except MaterialError:
            continue
        law = np.concatenate([specimens.respond(material, s.curve.stretch, s.curve.mode).stress / s.errors for s in sources])
        A = np.column_stack([law, material.shear_modulus_0 * branches])
        if not np.isfinite(A).all():
            continue
        size = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
        fitted_weights, misfit = nnls(A / size, target)
        factor, *shares = fitted_weights / size
        if factor > 0.0 and (spectrum := sources[0].spectrum) is not None:
            scaled = {name: v * (factor if choice.unit(name) == "Pa" else 1.0) for name, v in start.items()}
            weights = {n: max(v / factor, 0.01) for n, v in zip(spectrum.names, shares, strict=True)}
            yield misfit, {**scaled, **weights}


def fit_law_to_curves(
    choice: problem.LawChoice,
    sources: Sequence[residuals.TensileResiduals],
    extra: problem.Extra = problem.NOTHING_ELSE,
    *,
    changes: problem.Changes = MappingProxyType({}),
    loss: str = "linear",
    errors: str = "unknown",
    scale: float | None = None,
) -> least_squares.LeastSquaresFit:
    """Fit a law, with the memory of the sources if they have one, to curves from starts in closed form.

    Args:
        sources: From `residuals_of`, for this law.
        extra: Parameters beside the law's, such as the curves' own factors, and further sources.
        changes: Fields of parameters to replace; `FitError` if one names no parameter.
        loss, errors: See `softmodels.fitting.least_squares.fit_parameters`, also for its errors.
        scale: Size of the errors, in those of the sources, that a robust loss needs where they are unknown: one for all laws
            that are to be compared. None takes `spread` of a first fit without it.
    """
    oscillating = [source for source in extra.sources if isinstance(source, oscillation.FrequencyResiduals)]
    spectrum = sources[0].spectrum if sources else oscillating[0].spectrum if oscillating else None
    further = sources[0].further if sources else ()
    known = [*choice.names, *(spectrum.all_names if spectrum else ()), *further, *(p.name for p in extra.parameters)]
    for name in changes:
        if name not in known:
            whole = f"{choice.name} with its memory" if spectrum else choice.name
            raise FitError(f"{whole} has no parameter {name!r}; it has {', '.join(known)}")
    if loss != "linear" and errors == "unknown":
        if scale is None:
            scale = spread(fit_law_to_curves(choice, sources, extra, changes=changes, errors=errors))
        sources = [dataclasses.replace(s, errors=s.errors * scale) for s in sources]
        extra = dataclasses.replace(extra, sources=[source.scaled(scale) for source in oscillating])
    curves = [source.curve for source in sources]
    more = residuals.further_parameters(_modulus(curves), residuals.largest_strain(curves)) if further else []
    fits = []
    guesses = starts_for(choice, sources) if sources else [_plain_start(choice, oscillating)]
    for starts in problem.by_bounds(choice, guesses):
        weights = spectrum.parameters(starts[0]) if spectrum else []
        own = (*choice.parameters(starts[0]), *weights, *(p for p in more if p.name in further), *extra.parameters)
        parameters = [p.changed(changes.get(p.name, {})) for p in own]
        fitted = [*sources, *extra.sources]
        try:
            fits.append(
                least_squares.fit_parameters(fitted, parameters, loss=loss, starts=starts, errors=errors, label=choice.name)
            )
        except FitError as error:
            trouble = error
    if not fits:
        raise FitError(f"{choice.name}: {trouble}")
    best = min(fits, key=lambda fit: (not fit.converged, fit.deviance))
    return least_squares.settled(best) if spectrum else best


def _plain_start(
    choice: problem.LawChoice, oscillating: Sequence[oscillation.FrequencyResiduals[oscillation.FrequencyTest]]
) -> dict[str, float]:
    """Return a start without curves: the modulus of the slowest oscillation, if one was measured, and usual weights."""
    modulus = min((source.test.start_modulus for source in oscillating), default=math.inf)
    weights = dict.fromkeys(oscillating[0].spectrum.names, 0.1) if oscillating else {}
    return {**choice.from_modulus(modulus if math.isfinite(modulus) else START_MODULUS), **weights}


def spread(fit: least_squares.LeastSquaresFit) -> float:
    """Return a robust standard deviation of a fit's residuals (median absolute deviation)."""
    return max(robust.deviation(fit.residuals[: fit.count]), 1e-9)


def loops(curves: Sequence[TensileCurve], material: Material) -> list[tuple[str, float, float]]:
    """Return by curve its name, and the loop of its first unloading, measured and of the material, over the work."""
    return [
        (curve.name, loop(curve.stretch, curve.stress), loop(curve.stretch, residuals.predicted(material, curve)))
        for curve in curves
    ]


def loop_objections(curves: Sequence[TensileCurve], material: Material) -> list[str]:
    """Return the loops that the material does not have: it loses another work than the silicone."""
    return [
        f"{name}: the fitted loop is {100 * fitted:.3g} % of the work, the measured one {100 * measured:.3g} %; "
        "compare laws (--material all), or add tests that show the softening"
        for name, measured, fitted in loops(curves, material)
        if abs(fitted - measured) > max(LOOP_TOLERANCE * measured, SMALLEST_LOOP)
    ]


def loop_notes(curves: Sequence[TensileCurve], material: Material) -> list[str]:
    """Return the measured and the fitted loops."""
    return [
        f"{name}: loop of the first unloading {100 * measured:.3g} % of the work, fitted {100 * fitted:.3g} %"
        for name, measured, fitted in loops(curves, material)
        if measured >= SMALLEST_LOOP
    ]


type Curves = TensileCurve | Path | str | Sequence[TensileCurve | Path | str]
"""One or several measured curves, or files with uniaxial ones."""
type Tests = Curves | oscillation.FrequencyTest | Sequence[TensileCurve | oscillation.FrequencyTest | Path | str]
"""The same, and tests at frequencies."""

SMALLEST_LOOP = 0.005
"""Smallest area of a loop, as a share of the work, that is reported."""
LOOP_TOLERANCE = 0.2
"""Largest difference of a fitted loop from the measured one, as a share of it, at which the fit is accepted."""
FAR_GAUGE = 3.0
"""Largest factor on a test that its errors explain, in standard errors from 1."""
LARGEST_RATIO = 100.0
"""Maximum ratio of the initial moduli of curves of one material; above it a wrong unit is assumed."""


def prepared(curves: Curves, stretch: tuple[float, float] | None = None, history: bool = False) -> list[TensileCurve]:
    """Return the curves of one material, or files with uniaxial ones (see `read_curves` for other tests), checked, within a
    range of stretch; dense ones averaged (see `thinned`), averaged ones kept. With ``history`` curves with times are whole
    tests, else their loading ramps.

    Raises `TensileError` where one cannot be used, they cannot be one material's, or too few points are left.
    """
    given = [curves] if isinstance(curves, TensileCurve | Path | str) else curves
    read: list[TensileCurve] = []
    for curve in given:
        if not isinstance(curve, TensileCurve):
            read += read_curves(Path(curve), history=history)
        else:  # a file's jumps were left out among all its readings: those of its ramp only are no neighbours in time
            read.append(without_jumps(curve) if curve.raw is None else curve)
    read = [taut((given_curve if history else given_curve.ramp()).check()) for given_curve in read]
    if not read:
        return []
    moduli = [small_modulus(curve) for curve in read]
    if max(moduli) > LARGEST_RATIO * min(moduli):
        low, high = (read[moduli.index(pick)].name for pick in (min(moduli), max(moduli)))
        raise TensileError(
            f"{low} starts with a shear modulus of {min(moduli) / 1e3:.3g} kPa and {high} with {max(moduli) / 1e3:.3g} "
            f"kPa; these cannot be one material, so check their units"
        )
    within = [curve if stretch is None else curve.within(*stretch) for curve in read]
    return [residuals.thinned(curve) if curve.noise is None else curve for curve in within]


@checked
@one_at_a_time
def fit_curves(
    curves: Tests,
    material: problem.Laws = "yeoh",
    options: FitOptions = problem.DEFAULT_OPTIONS,
    *,
    stretch: tuple[float, float] | None = None,
    progress: Callable[[str], None] | None = None,
) -> FitReport:
    """Fit every law to all curves together, and to each separately if they contradict each other.

    Args:
        curves: Measured curves, or files with uniaxial ones (see `read_curves` for other tests); for a memory also oscillations
            (see `oscillation.read`).
        material: A law's name or class, or several of them; ``"all"`` compares all.
        options: How.
        stretch: Range of stretch to fit over; None for the whole curves.
        progress: Is called with the name of the next fit.

    Returns:
        The laws with their error bars, best first; ``report.material`` is the one to simulate with.

    Raises:
        FitError: The task is impossible.
        TensileError: A curve cannot be used.
    """
    names.callback("progress", progress)
    names.one_of("options", options, FitOptions, "how to fit, such as sm.FitOptions(poisson=0.49)")
    given = names.several("curves", curves, (TensileCurve, oscillation.FrequencyTest, Path, str), "a curve or its file")
    oscillations = [test for test in given if isinstance(test, oscillation.FrequencyTest)]
    if oscillations and not options.memory:
        raise FitError("moduli over frequency and vibrations show a memory; fit it too (--memory), or leave them out")
    if options.branches and not options.memory:
        raise FitError("branches are those of a memory; fit it too (--memory), or leave --branches out")
    ready = prepared(
        [test for test in given if not isinstance(test, oscillation.FrequencyTest)],
        names.span("stretch", stretch),
        options.memory,
    )
    if not ready and not oscillations:
        raise FitError("there are no measurements; give a tensile curve or outlines")
    task = (_MemoryTask if options.memory else _Task)(
        ready, problem.law_choices(material, options.poisson), options, progress or (lambda name: None), oscillations
    )
    return task.report()


def _fit_options(options: FitOptions, sample: bool) -> str:
    size = {
        "auto": "weighted by 2 % of the stress and the curve's noise, scaled by the scatter",
        "constant": "unweighted least squares on the nominal stress, its error from the scatter",
    }.get(options.stress_error, f"stress error {options.stress_error}")
    robust = ", outliers counted by their size" if options.robust else ""
    gauge = (
        f", a load cell's factor of 1 +- {100 * problem.LOAD_CELL_ERROR:g} % common to all tests" if options.gauge_error else ""
    )
    return f"{size}{robust}{gauge if sample else options.gauge_words}; Poisson's ratio {options.poisson:g} is given, not fitted"
