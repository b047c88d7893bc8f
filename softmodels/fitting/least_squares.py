"""Bounded robust least squares over any sources of standardised residuals: the fit, its error bars, what the data determine,
what speaks against it, and profile likelihoods.

A source turns parameter values into residuals (model - measured) / error with exact derivatives. It may be a tensile curve or a
simulated outline. All decisions depend only on numbers from the sources, so processes that share a source stay synchronised.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.optimize import OptimizeResult
from scipy.special import ndtri, stdtrit

from softmodels.common import names, units
from softmodels.common.arrays import Array
from softmodels.fitting.problem import (
    CannotEvaluate,
    FitError,
    GroupSummary,
    Parameter,
    Problem,
    Residuals,
    Rows,
    autocorrelation_time,
    loss_of,
)
from softmodels.materials.laws import MaterialError


@dataclasses.dataclass(frozen=True, eq=False)
class LeastSquaresFit:
    """A fit and its statistics.

    Error bars rest on the sandwich formula of robust regression (Huber & Ronchetti 2009, Robust Statistics, section 7.6),
    widened where neighbouring residuals are correlated: a law that misses a densely measured curve leaves long runs of one
    sign, and a hundred points of one run are worth about one.

    Attributes:
        parameters, values: All parameters, the fixed ones too, and their values by name.
        residuals: Standardised residuals, the priors' last, shape (n,).
        jacobian: Their derivatives by the free parameters, shape (n, m).
        rows: What the residuals are.
        deviance: Sum of the loss over the squared residuals: chi squared, for a linear loss.
        loss, errors: See `fit_parameters`.
        evaluations: Evaluations of the sources so far.
        starts: Where each start ended.
        problem: What `profile` solves again.
        troubles: Sentences on what speaks against the fit; none if it ended well.
        converged: Whether it ended at a minimum; else its values are not to be used.
        shared: Change of each measured residual by one standard error of each thing that all of them have in common and that
            no parameter stands for, shape (count, k); None for none.
    """

    label: str
    parameters: tuple[Parameter, ...]
    values: Mapping[str, float]
    residuals: Array
    jacobian: Array
    rows: Rows
    deviance: float
    loss: str
    errors: str
    evaluations: int
    starts: tuple[StartResult, ...]
    problem: Problem
    troubles: tuple[str, ...]
    converged: bool = True
    shared: Array | None = None

    def __post_init__(self) -> None:
        names.keep_arrays(self)

    @property
    def free(self) -> list[Parameter]:
        return [p for p in self.parameters if not p.fixed]

    @property
    def count(self) -> int:
        """Measured residuals, without the priors'."""
        return len(self.rows.groups)

    @property
    def inside(self) -> list[int]:
        """Places of the free parameters that did not end at a bound."""
        return [i for i, p in enumerate(self.free) if p.name not in self.at_bounds]

    @functools.cached_property
    def at_bounds(self) -> dict[str, float]:
        """Free parameters that ended at a bound, and which bound."""
        at_bounds = {}
        for p in self.free:
            x = p.inward(self.values[p.name])
            for end in (p.lower, p.upper):
                if math.isfinite(end) and abs(x - p.inward(end)) <= 1e-6 * max(1.0, abs(x)):
                    at_bounds[p.name] = end
        return at_bounds

    # -- scatter ------------------------------------------------------------------------------------------------------

    @functools.cached_property
    def influence(self) -> tuple[Array, float]:
        """Influence psi of each measured residual, and the mean of its slope."""
        r = self.residuals[: self.count]
        if self.loss == "linear":
            return r, 1.0
        return names.read_only(r / np.sqrt(1 + r**2)), float(np.mean((1 + r**2) ** -1.5))

    @functools.cached_property
    def scatter(self) -> float:
        """Standard deviation of the residuals in units of their stated errors, weighted by the loss."""
        psi, slope = self.influence
        freedom = max(len(self.residuals) - len(self.free), 1)
        return math.sqrt(len(self.residuals) / freedom * float(np.mean(psi**2))) / slope

    @property
    def dispersion(self) -> float:
        """Variance of a residual for the error bars: at least the stated one, if errors are stated."""
        return self.scatter**2 if self.errors == "unknown" else max(1.0, self.scatter**2)

    @functools.cached_property
    def runs(self) -> dict[str, float]:
        """Correlation length of the residuals by group, in points (integrated autocorrelation, at least 1)."""
        psi, _ = self.influence
        labels = np.array(self.rows.groups)
        return {str(name): autocorrelation_time(psi[labels == name]) for name in dict.fromkeys(self.rows.groups)}

    @functools.cached_property
    def independent(self) -> float:
        """Effective number of independent residuals."""
        return sum(self.rows.groups.count(name) / run for name, run in self.runs.items())

    # -- error bars ---------------------------------------------------------------------------------------------------

    @functools.cached_property
    def covariance(self) -> Array:
        """Covariance of the free parameters in their units, shape (m, m). Infinite where the data see nothing, and nan for
        parameters at a bound, whose neighbours' are as if it were fixed."""
        inside = self.inside
        full = np.full((len(self.free), len(self.free)), np.nan)
        if inside:
            full[np.ix_(inside, inside)] = self._sandwich(self.jacobian[:, inside])
        return names.read_only(full + self.considered)

    @property
    def band_covariance(self) -> Array:
        """The covariance of what a band is to hold, to count with the normal quantile: the same, but for samples."""
        return self.covariance

    @functools.cached_property
    def considered(self) -> Array:
        """The part of the covariance due to `shared` errors, shape (m, m)."""
        if self.shared is None:
            return names.read_only(np.zeros((len(self.free), len(self.free))))
        inside = [p.name not in self.at_bounds for p in self.free]
        J = self.jacobian[: self.count] * inside
        moved = np.linalg.pinv(J, rcond=MIN_SINGULAR_VALUE) @ self.shared
        return names.read_only(np.asarray(moved @ moved.T))

    def covariance_with(self, slopes: Array, error: float) -> Array:
        """Return `band_covariance` with a factor as last row that the fit takes as 0, shape (m + 1, m + 1): ``error`` is what
        it is known to without the measured residuals, ``slopes`` their derivatives by it, shape (count,).

        Where they would move it, the factor left at 0 is an error too (GUM, JCGM 100:2008, F.2.4.5), by one Gauss-Newton step.
        """
        size, inside, rows = len(self.free), self.inside, len(self.residuals)
        J = np.zeros((rows + 1, len(inside) + 1))
        J[:rows, :-1], J[: self.count, -1], J[rows, -1] = self.jacobian[:, inside], slopes, 1.0 / error
        lengths = column_lengths(J)
        step = np.linalg.lstsq(J / lengths, -np.append(self.residuals, 0.0), rcond=MIN_SINGULAR_VALUE)[0] / lengths
        joint = self._sandwich(J) + np.outer(step, step)
        whole = np.full((size + 1, size + 1), np.nan)
        whole[:size, :size] = self.band_covariance
        if inside:
            joint[:-1, :-1] += self.band_covariance[np.ix_(inside, inside)] - self._sandwich(J[:rows, :-1])
        whole[np.ix_([*inside, size], [*inside, size])] = joint
        return whole

    def _sandwich(self, J: Array) -> Array:
        size = column_lengths(J)
        bread, meat = self.information(J / size)
        eigenvalues, vectors = np.linalg.eigh(bread)
        seen = eigenvalues > MIN_SINGULAR_VALUE**2 * max(eigenvalues[-1], 1e-300)
        inverse = (vectors[:, seen] / eigenvalues[seen]) @ vectors[:, seen].T
        covariance = inverse @ meat @ inverse
        blind = (np.abs(vectors[:, ~seen]) > 1e-6).any(axis=1)
        covariance[blind, :] = covariance[:, blind] = np.nan
        covariance[blind, blind] = np.inf
        result: Array = covariance / np.outer(size, size)
        return result

    def information(self, J: Array) -> tuple[Array, Array]:
        """Return the expected curvature of half the deviance, and the variance of its slope.

        Stated errors say how the variance is spread over the residuals. Unknown ones do not: there each residual speaks
        for itself, made larger by its leverage (HC3: MacKinnon & White 1985, doi 10.1016/0304-4076(85)90158-7), so that a
        mistaken weighting costs width and not truth.
        """
        psi, slope = self.influence
        data, priors = J[: self.count], J[self.count :]
        known = priors.T @ priors
        bread = slope * data.T @ data + known
        spread = np.array([self.runs[name] for name in self.rows.groups])
        if self.errors == "unknown":
            inverse = np.linalg.pinv(bread, rcond=MIN_SINGULAR_VALUE**2, hermitian=True)
            leverage = slope * np.einsum("ij,jk,ik->i", data, inverse, data)
            spread = spread * (psi / np.maximum(1 - leverage, LEAST_FREEDOM)) ** 2
        else:
            spread = spread * self.dispersion * slope**2
        return bread, (data.T * spread) @ data + known

    @functools.cached_property
    def newton_step(self) -> float:
        """Length of one more Gauss-Newton step, in standard errors; 0 at a minimum."""
        inside = self.inside
        if not inside:
            return 0.0
        J = self.jacobian[:, inside]
        size = np.linalg.norm(J, axis=0)
        J = J / np.where(size == 0.0, 1.0, size)
        psi, _ = self.influence
        gradient = J.T @ np.concatenate([psi, self.residuals[self.count :]])
        bread, _ = self.information(J)
        step = np.linalg.pinv(bread, rcond=MIN_SINGULAR_VALUE, hermitian=True) @ gradient
        # Data matched to rounding have no meaningful standard error.
        model = self.jacobian[: self.count] @ np.array([self.values[p.name] for p in self.free])
        rounding = ROUNDING_TOLERANCE**2 * float(np.mean(model**2))
        return math.sqrt(max(float(gradient @ step), 0.0) / max(self.dispersion, rounding, 1e-300))

    @property
    def quantile(self) -> float:
        """Half a 95 % interval in standard errors: Student's if the errors are estimated from the scatter."""
        if self.errors == "stated" and self.dispersion == 1.0:
            return float(ndtri((1 + CONFIDENCE_LEVEL) / 2))
        return float(stdtrit(max(self.independent - len(self.free), 1.0), (1 + CONFIDENCE_LEVEL) / 2))

    def error(self, name: str) -> float:
        """Return the standard error of a parameter in its unit; 0 if it is fixed, nan at a bound."""
        names = [p.name for p in self.free]
        if name not in names:
            return 0.0
        variance = self.covariance[names.index(name)][names.index(name)]
        return math.inf if variance < 0.0 else math.sqrt(variance)  # negative: only rounding is left

    def interval(self, name: str) -> tuple[float, float]:
        """Return the 95 % interval of a parameter from the covariance, nan at a bound; `profile` gives one that bends with
        the model."""
        reach = self.reach(name)
        return self.values[name] - reach, self.values[name] + reach

    def reach(self, name: str) -> float:
        """Return half of a parameter's 95 % interval: Student's quantile for the scatter, the normal one for
        considered errors."""
        names = [p.name for p in self.free]
        if name not in names:
            return 0.0
        considered = float(self.considered[names.index(name)][names.index(name)])
        own = max(self.error(name) ** 2 - considered, 0.0) if math.isfinite(self.error(name)) else self.error(name)
        return math.sqrt(self.quantile**2 * own + ndtri((1 + CONFIDENCE_LEVEL) / 2) ** 2 * considered)

    @functools.cached_property
    def correlations(self) -> Array:
        """Correlations of the free parameters' estimates, shape (m, m); nan where there is no variance."""
        with np.errstate(invalid="ignore"):
            sizes = np.sqrt(np.diag(self.covariance))
            return names.read_only(np.asarray(self.covariance / np.outer(sizes, sizes)))

    # -- how well it fits ---------------------------------------------------------------------------------------------

    @functools.cached_property
    def summaries(self) -> dict[str, GroupSummary]:
        """Residuals of each group in their own unit."""
        labels, units = np.array(self.rows.groups), self.rows.units
        own = self.residuals[: self.count] * np.array(self.rows.sizes)
        made = {}
        for name, run in self.runs.items():
            here = np.flatnonzero(labels == name)
            part = own[here]
            largest = float(part[np.argmax(np.abs(part))])
            rms = math.sqrt(float(np.mean(part**2)))
            made[name] = GroupSummary(units[here[0]], len(part), rms, float(part.mean()), largest, run)
        return made

    @property
    def unexplained(self) -> Array:
        """Residuals of the measurements that the model should follow, in errors, shape (count,)."""
        return self.residuals[: self.count]

    @functools.cached_property
    def excess(self) -> dict[str, float]:
        """Groups whose root mean square residual exceeds `MAX_RMS_RESIDUAL` errors of the measurement, and by what factor:
        the stated error, or the usual one of its source. Groups without either are left out."""
        sizes, usual = np.array(self.rows.sizes), np.array(self.rows.usual)
        if self.errors == "stated":
            usual = np.where(np.isnan(usual), sizes, usual)
        squares = (self.unexplained * sizes / usual) ** 2
        losses, labels = loss_of(self.loss, squares, 0)[0], np.array(self.rows.groups)
        times = {name: math.sqrt(float(losses[labels == name].mean())) for name in self.runs}
        return {name: value for name, value in times.items() if value > MAX_RMS_RESIDUAL}

    @property
    def misfits(self) -> list[str]:
        """Sentences on the groups of `excess`."""
        known = "stated" if self.errors == "stated" else "usual"
        return [
            f"the model does not follow {name}: the residual is {times:.3g} times the {known} error (root mean square)"
            for name, times in self.excess.items()
        ]

    @property
    def aicc(self) -> float:
        """Akaike's criterion with its correction for few data (Hurvich & Tsai 1989, doi 10.1093/biomet/76.2.297)."""
        m = len(self.free) + (self.errors == "unknown")
        return self._misfit + 2 * m + 2 * m * (m + 1) / max(self.count - m - 1, 1)

    @property
    def bic(self) -> float:
        """Schwarz's criterion (1978, doi 10.1214/aos/1176344136)."""
        return self._misfit + (len(self.free) + (self.errors == "unknown")) * math.log(self.count)

    @property
    def _misfit(self) -> float:
        if self.errors == "stated":
            return self.deviance
        return self.count * math.log(max(self.deviance, 1e-300) / self.count)


CONFIDENCE_LEVEL = 0.95
MIN_SINGULAR_VALUE = 1e-8
"""Relative singular value of the scaled Jacobian below which a direction is undetermined."""
LEAST_FREEDOM = 0.2
"""Minimum freedom of a residual, 1 - leverage."""
MAX_RMS_RESIDUAL = 3.0
"""Root mean square residual in errors of the measurement above which the model does not follow the data."""
ROUNDING_TOLERANCE = 1e-6
"""Residuals below this fraction of the model count as rounding."""


def column_lengths(J: Array) -> Array:
    """Return the lengths of a matrix' columns, 1 for zeros, so that columns over them do not depend on units."""
    lengths = np.linalg.norm(J, axis=0)
    lengths[lengths == 0.0] = 1.0
    return np.asarray(lengths)


@dataclasses.dataclass(frozen=True)
class StartResult:
    """Result of one start: parameters, deviance (infinite if it failed), and an error, if any."""

    values: Mapping[str, float]
    deviance: float
    trouble: str


# ----------------------------------------------------------------------------------------------------------------------
# The fit.


LOSSES = ("linear", "soft_l1")
ERRORS = ("stated", "unknown")
SAME_DEVIANCE = 1e-4
"""Starts whose deviances differ by less than this (plus the same fraction) ended in the same minimum."""
START_TOLERANCE = 1e-10
"""At which a start ends: relative, on the sum of squares, on the parameters and on the gradient."""
MAX_NEWTON_STEP = 0.1
"""Newton step in standard errors above which a fit has not converged."""


def fit_parameters(
    sources: Sequence[Residuals],
    parameters: Sequence[Parameter],
    *,
    loss: str = "linear",
    starts: int | Sequence[Mapping[str, float]] = 1,
    errors: str = "stated",
    label: str = "",
    evaluations: int = 300,
) -> LeastSquaresFit:
    """Find the parameters that best fit all sources jointly; `FitError` if the task is impossible, or no start could be
    evaluated.

    Args:
        parameters: Every parameter the sources name.
        loss: ``"linear"`` (least squares) or ``"soft_l1"``, in which residuals far above 1 count by their size and not by its
            square.
        starts: How many starting points: the parameters' own, then quasi-random ones around it (always the same). Or the
            starting values themselves; what they leave out, or have outside the bounds, starts at its parameter's own start.
        errors: ``"stated"``: the sources' errors are believed unless the scatter is larger. ``"unknown"``: only their ratios
            are; their size follows from the scatter.
        evaluations: Per start at most.
    """
    _check(sources, parameters, loss, errors)
    problem = Problem(sources, parameters, loss)
    runs: list[StartResult] = []
    best: OptimizeResult | None = None
    for x in _starting_points(problem.free, starts):
        try:
            first = problem.residuals(x)
            if not np.isfinite(first).all():
                raise CannotEvaluate("the model has no finite value there")
            optimum = problem.solve(x, START_TOLERANCE, evaluations)
        except CannotEvaluate as error:
            runs.append(StartResult(problem.values(x), math.inf, str(error)))
            continue
        runs.append(
            StartResult(problem.values(optimum.x), 2 * float(optimum.cost), "" if optimum.status > 0 else optimum.message)
        )
        if best is None or optimum.cost < best.cost:
            best = optimum
    if best is None:
        raise FitError(f"the fit cannot start: {runs[0].trouble if runs else 'no starting values are given'}")
    try:
        return _with_warnings(problem, best, runs, errors, label)
    except CannotEvaluate as error:
        raise FitError(f"the fit ended where its model cannot be evaluated: {error}") from None


def settled(fit: LeastSquaresFit) -> LeastSquaresFit:
    """Return a fit whose parameters that ended at zero are zero, not a rounding away from it."""
    ends = {name: bound for name, bound in fit.at_bounds.items() if bound == 0.0}
    return dataclasses.replace(fit, values={**fit.values, **ends}) if ends else fit


def _with_warnings(
    problem: Problem, optimum: OptimizeResult, runs: list[StartResult], errors: str, label: str
) -> LeastSquaresFit:
    """Return the result with all warnings."""
    values = problem.values(optimum.x)
    residuals = problem.residuals(optimum.x)
    J, rows = problem.slopes(values)
    if len(residuals) < len(problem.free):
        few = f"{len(residuals)} numbers cannot determine {len(problem.free)} parameters"
        raise FitError(f"{few}; fix some parameters or add measurements")
    result = LeastSquaresFit(
        label=label or ", ".join(source.label for source in problem.sources), parameters=problem.parameters,
        values=values, residuals=residuals, jacobian=J, rows=rows,
        deviance=2 * float(optimum.cost), loss=problem.loss, errors=errors, evaluations=problem.evaluations,
        starts=tuple(runs), problem=problem, troubles=(),
    )  # fmt: skip
    troubles, step = [], result.newton_step
    if optimum.status <= 0:
        troubles.append(f"the fit did not converge within {optimum.nfev} evaluations; do not use its values")
    elif step > MAX_NEWTON_STEP:
        troubles.append(
            f"the fit stopped where a further step would still move it by {step:.2g} standard errors; do not use its values"
        )
    converged = not troubles
    ends = [(p, result.at_bounds[p.name]) for p in result.free if p.name in result.at_bounds]
    troubles += [f"{p.words} ended at its bound {bound:.4g} {p.unit}".rstrip() for p, bound in ends]
    troubles += _disagreement(runs, result)
    return dataclasses.replace(result, troubles=(*troubles, *result.misfits), converged=converged)


def _disagreement(runs: list[StartResult], result: LeastSquaresFit) -> list[str]:
    """Return warnings on starts that ended in a different, nearly as good minimum, and on failed starts."""
    room = SAME_DEVIANCE * (1 + result.deviance)
    likely = 3.84 * result.dispersion
    said = []
    rivals = [
        run
        for run in runs
        if math.isfinite(run.deviance) and run.deviance - result.deviance <= likely and _is_other_minimum(run, result)
    ]
    if rivals:
        other = ", ".join(f"{p.name} {rivals[0].values[p.name]:.4g}" for p in result.free if not p.hidden)
        said.append(
            f"{len(rivals)} of {len(runs)} starts ended in another minimum that fits nearly as well ({other}): "
            "the data do not distinguish them"
        )
    ended = [run for run in runs if math.isfinite(run.deviance)]
    if len(ended) > 1 and sum(run.deviance - result.deviance <= room for run in ended) == 1:
        said.append(f"only one of {len(ended)} starts reached this minimum; there may be a better one")
    return said


def _is_other_minimum(run: StartResult, result: LeastSquaresFit) -> bool:
    """Return whether a start ended further from the result than the result's own intervals reach. Terms that have changed
    places (Ogden's) are the same result."""
    here, there = (sorted(values[p.name] for p in result.free) for values in (result.values, run.values))
    if np.allclose(here, there, rtol=1e-3):
        return False
    for p in result.free:
        low, high = result.interval(p.name)
        reach = 1e-6 * abs(result.values[p.name])
        if p.name not in result.at_bounds and not low - reach <= run.values[p.name] <= high + reach:
            return True
    return False


def _starting_points(free: Sequence[Parameter], starts: int | Sequence[Mapping[str, float]]) -> list[Array]:
    """Return the starting coordinates: the given ones; or the parameters' own, then Halton points within a factor e^1.5, or one
    size, around them."""
    origin = np.array([p.inward(p.start) for p in free], dtype=float)
    if not isinstance(starts, int):
        chosen = [[start.get(p.name, p.start) for p in free] for start in starts]
        held = [
            [v if p.lower <= v <= p.upper else p.start for p, v in zip(free, chosen_start, strict=True)]
            for chosen_start in chosen
        ]
        return [np.array([p.inward(v) for p, v in zip(free, name, strict=True)], dtype=float) for name in held]
    points = [origin]
    if starts > 1:
        from scipy.stats import qmc  # takes a second to load, and most fits do not need it

        spread = np.array([1.5 if p.logarithmic else 1.0 for p in free])
        bounds = np.sort([[p.inward(p.lower), p.inward(p.upper)] for p in free])
        for unit in qmc.Halton(len(free), scramble=False).random(starts)[1:]:
            points.append(np.clip(origin + spread * (2 * unit - 1), bounds[:, 0], bounds[:, 1]))
    return points


def _check(sources: Sequence[Residuals], parameters: Sequence[Parameter], loss: str, errors: str) -> None:
    names = [p.name for p in parameters]
    used = {name for source in sources for name in source.parameters}
    if not sources:
        raise FitError("there is nothing to fit to; give a tensile curve or outlines")
    if loss not in LOSSES:
        raise FitError(f"loss {loss!r} is not one of {', '.join(LOSSES)}")
    if errors not in ERRORS:
        raise FitError(f"errors {errors!r} is not one of {', '.join(ERRORS)}")
    if len(set(names)) < len(names):
        raise FitError(f"a parameter is given twice among {', '.join(names)}")
    if missing := used - set(names):
        raise FitError(f"no starting value for {', '.join(sorted(missing))}")
    if idle := [p.name for p in parameters if not p.fixed and p.name not in used and p.prior is None]:
        raise FitError(f"nothing measured depends on {', '.join(idle)}; fix it")
    if all(p.fixed for p in parameters):
        raise FitError("every parameter is fixed; free at least one")


# ----------------------------------------------------------------------------------------------------------------------
# Acceptance of a fit: general objections, for any law and data.


@dataclasses.dataclass(frozen=True)
class Judgement:
    """Sentences on a fit from the device, the bench and the silicone: those that forbid its use, warnings that do not, and
    notes on what was corrected."""

    objections: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


NO_JUDGEMENT = Judgement()


def objections(fit: LeastSquaresFit, modulus: Callable[[Mapping[str, float]], float]) -> tuple[str, ...]:
    """Return the objections to a fit, as sentences; empty if accepted. ``modulus`` gives the law's small-strain shear
    modulus in Pa at parameter values."""
    objections = [
        f"{p.words} ended at its bound {f'{bound:.4g} {p.unit}'.rstrip()}, so its value and interval are meaningless"
        for p in fit.free
        if (bound := fit.at_bounds.get(p.name)) is not None and bound not in p.answers
    ]
    objections += [f"the data do not determine {p.words}: {why}" for p in fit.free if (why := _undetermined(fit, p))]
    value, error = modulus(fit.values), _modulus_error(fit, modulus)
    if not objections and not units.HALF_WIDTH_95 * error < abs(value):
        objections.append(
            f"the data do not determine the shear modulus: {value / 1e3:.4g} kPa with a standard error of {error / 1e3:.3g} kPa"
        )
    return tuple(objections)


def _undetermined(fit: LeastSquaresFit, p: Parameter) -> str:
    """Return why a parameter is not determined, empty if it is; one with a prior always is."""
    if p.prior or p.hidden or p.name in fit.at_bounds:
        return ""
    if not math.isfinite(fit.error(p.name)):
        return "another parameter compensates any change of it"
    low, high = (fit.values[p.name] + sign * units.HALF_WIDTH_95 * fit.error(p.name) for sign in (-1.0, 1.0))
    whole = math.isfinite(p.upper - p.lower) and low <= p.lower and high >= p.upper
    return "its interval is as wide as its bounds" if whole and not p.answers else ""


def _modulus_error(fit: LeastSquaresFit, modulus: Callable[[Mapping[str, float]], float]) -> float:
    """Return the standard error of the shear modulus in Pa, by its derivatives; 0 if it depends on no free parameter."""
    slope = np.zeros(len(fit.free))
    for i, p in enumerate(fit.free):
        if p.name in fit.at_bounds or p.hidden or p.name == "poisson":
            continue
        step = 1e-6 * (abs(fit.values[p.name]) or p.scale)
        try:
            ends = [modulus({**fit.values, p.name: fit.values[p.name] + sign * step}) for sign in (-1.0, 1.0)]
        except MaterialError:  # a degenerate law, whose modulus is only rounding
            return math.inf
        slope[i] = (ends[1] - ends[0]) / (2 * step)
    seen = slope != 0.0
    if not seen.any():
        return 0.0
    variance = float(slope[seen] @ fit.covariance[np.ix_(seen, seen)] @ slope[seen])
    return math.sqrt(variance) if variance >= 0.0 else math.inf


# ----------------------------------------------------------------------------------------------------------------------
# Identifiability of a fit's parameters.


MAX_CORRELATION = 0.98
"""Correlation above which two parameters are identifiable only jointly."""


def singular_values(fit: LeastSquaresFit) -> tuple[Array, Array]:
    """Return the singular values (m,) of the data's Jacobian and its right vectors (m, m), in rows.

    The columns are scaled by what is a large change of each parameter: its prior's error, half the span of its bounds,
    or its own size. A value far below 1 is a combination that the data cannot tell from no change.
    """
    J = fit.jacobian[: fit.count] * np.array([_reach(fit, p) for p in fit.free]) / math.sqrt(fit.dispersion)
    _, values, vectors = np.linalg.svd(J, full_matrices=len(J) < J.shape[1])
    return np.pad(values, (0, len(fit.free) - len(values))), vectors


def _reach(fit: LeastSquaresFit, p: Parameter) -> float:
    if p.prior:
        return p.prior.error
    if math.isfinite(p.upper - p.lower) and not p.logarithmic:
        return (p.upper - p.lower) / 2
    return abs(fit.values[p.name]) or p.scale


def unseen(fit: LeastSquaresFit) -> tuple[str, ...]:
    """Return the sentences on parameters, or combinations of them, that the data do not determine."""
    said = []
    for p in fit.free:
        if p.name in fit.at_bounds:
            continue
        room, against = _max_half_width(p, fit.values[p.name])
        if not fit.quantile * _data_error(fit, p) < room:
            rests = f"{p.words} depends on its prior: without it, its interval would be wider"
            said.append(rests if p.prior else f"the data do not determine {p.words}: its interval is wider than {against}")
    R = fit.correlations
    for i, a in enumerate(fit.free):
        for j in range(i):
            if abs(R[i, j]) > MAX_CORRELATION and not (a.hidden or fit.free[j].hidden):
                both = f"{fit.free[j].name} and {a.name}"
                said.append(f"the data determine {both} only jointly (correlation {R[i, j]:.3f})")
    values, vectors = singular_values(fit)
    if np.isinf(np.diag(fit.covariance)).any() and values[-1] <= MIN_SINGULAR_VALUE * max(values[0], 1e-300):
        mixed = [p.words for p, share in zip(fit.free, vectors[-1], strict=True) if abs(share) > 0.1]
        said.append(f"the data do not determine one combination of {', '.join(mixed)}")
    return tuple(said)


def _data_error(fit: LeastSquaresFit, p: Parameter) -> float:
    """Return the standard error of a parameter without its prior."""
    if not p.prior:
        return fit.error(p.name)
    own = fit.count + [q.name for q in fit.free if q.prior].index(p.name)
    without = dataclasses.replace(fit, residuals=np.delete(fit.residuals, own), jacobian=np.delete(fit.jacobian, own, axis=0))
    return without.error(p.name)


def _max_half_width(p: Parameter, value: float) -> tuple[float, str]:
    """Return the maximum half width of an interval for a determined parameter, and its reference."""
    if p.prior:
        return units.HALF_WIDTH_95 * p.prior.error, "its prior"
    if p.logarithmic or not math.isfinite(p.upper - p.lower):
        return (abs(value) or p.scale) * (1.0 if p.lower >= 0.0 else 10.0), "its own size"
    return (p.upper - p.lower) / 2, "its bounds"


# ----------------------------------------------------------------------------------------------------------------------
# Profile likelihoods: the rise of the deviance with one parameter fixed away from its best value.


INITIAL_PROFILE_RANGE = 1.6
"""Initial range of a profile, in half widths of the expected interval."""
MAX_DOUBLINGS = 6
MAX_REFINEMENTS, MIN_STEEP_RISE = 8, 1.5
"""Maximum refinements of the interval's end, and the relative rise above which they are needed."""
RESTART_TOLERANCE = 1e-9


@dataclasses.dataclass(frozen=True, eq=False)
class Profile:
    """A profile likelihood of a parameter.

    Attributes:
        values: Where it was held, rising, in its unit.
        rises: Rise of the deviance over the best one there, divided by what one independent residual is worth.
        limit: The rise at the ends of the 95 % interval.
        interval: Ends of the 95 % interval; infinite where the rise never reaches the limit, or the parameter's bound.
        trouble: A sentence if the profile found a better fit than the fit itself, else empty.
    """

    name: str
    unit: str
    values: Array
    rises: Array
    limit: float
    interval: tuple[float, float]
    trouble: str

    def __post_init__(self) -> None:
        names.keep_arrays(self)


def profile(result: LeastSquaresFit, name: str, n: int = 15) -> Profile:
    """Fix a free parameter at about ``n`` values on both sides of its best one, more where the interval's end is far, and
    refit the others.

    The interval is where the deviance rises by less than the square of Student's (or the normal) quantile times the
    residuals' dispersion and run: it bends with the model where the covariance's interval cannot (Venzon & Moolgavkar 1988,
    doi 10.2307/2347496).
    """
    p = next(q for q in result.free if q.name == name)
    worth = _unit_rise(result, name)
    limit = result.quantile**2
    best = result.values[name]
    points = [(best, 0.0)]
    for sign in (-1.0, 1.0):
        points += _side(result, p, sign, max(n // 2, 3), worth, limit)
    points.sort()
    values, rises = np.array(points).T
    ends = tuple(_crossing(values, rises, best, limit, sign) for sign in (-1.0, 1.0))
    interval = (ends[0] if ends[0] is not None else p.lower, ends[1] if ends[1] is not None else p.upper)
    better = float(rises.min())
    trouble = f"fixing {name} at {values[rises.argmin()]:.4g} gave a better fit than the original one" if better < -0.05 else ""
    return Profile(name, p.unit, values, rises, limit, interval, trouble)


def _unit_rise(result: LeastSquaresFit, name: str) -> float:
    """Return the rise of the deviance equivalent to 1: its curvature along the profile times the parameter's variance."""
    names = [p.name for p in result.free]
    slope = result.influence[1]
    error = result.reach(name) / result.quantile
    if not (math.isfinite(error) and error > 0.0):
        return result.dispersion * slope * result.count / result.independent
    inside = result.inside
    J = result.jacobian[:, inside]
    size = np.linalg.norm(J, axis=0)
    bread, _ = result.information(J / size)
    place = inside.index(names.index(name))
    return error**2 * size[place] ** 2 / float(np.linalg.pinv(bread, rcond=1e-16, hermitian=True)[place, place])


def _side(
    result: LeastSquaresFit, p: Parameter, sign: float, count: int, worth: float, limit: float
) -> list[tuple[float, float]]:
    """Return the values and rises outward from the best value, until the limit is passed or a bound is reached."""
    best = result.values[p.name]
    bound = p.upper if sign > 0 else p.lower
    if best == bound:
        return []
    whole = result.reach(p.name)
    reach = INITIAL_PROFILE_RANGE * whole if math.isfinite(whole) and whole > 0.0 else 0.5 * (abs(best) or p.scale)
    warm = dict(result.values)
    points: list[tuple[float, float]] = []
    held, step = best, reach / count
    for i in range(count + 3 * MAX_DOUBLINGS):
        if i >= count:
            step *= 1.5
        held = best + sign * step if not points else held + sign * step
        ended = (held - bound) * sign >= 0.0
        held = bound if ended else held
        solved = _deviance_at(result, p.name, held, warm)
        if solved is None:  # the model cannot be evaluated there: the profile ends
            points.append((held, math.inf))
            break
        rise = (solved[0] - result.deviance) / worth
        warm = solved[1]
        points.append((held, rise))
        if ended or (rise > limit and (i + 1 >= count or rise > 4 * limit)):
            break
    return points + _refined_crossing(result, p.name, [(best, 0.0), *points], worth, limit)


def _refined_crossing(
    result: LeastSquaresFit, name: str, outward: list[tuple[float, float]], worth: float, limit: float
) -> list[tuple[float, float]]:
    """Add points near the crossing of the limit if the steps are too large for linear interpolation."""
    more: list[tuple[float, float]] = []
    crossing = next((i for i in range(1, len(outward)) if outward[i][1] >= limit), None)
    if crossing is None:
        return more
    inner, outer = outward[crossing - 1], outward[crossing]
    for _ in range(MAX_REFINEMENTS):
        if outer[1] < MIN_STEEP_RISE * limit:
            break
        middle = (inner[0] + outer[0]) / 2
        solved = _deviance_at(result, name, middle, dict(result.values))
        point = (middle, (solved[0] - result.deviance) / worth if solved else math.inf)
        more.append(point)
        inner, outer = (inner, point) if point[1] >= limit else (point, outer)
    return more


def _deviance_at(
    result: LeastSquaresFit, name: str, value: float, warm: dict[str, float]
) -> tuple[float, dict[str, float]] | None:
    """Return the deviance and values with one parameter fixed; None if not available."""
    parameters = [
        dataclasses.replace(p, start=value, fixed=True)
        if p.name == name
        else p
        if p.fixed
        else dataclasses.replace(p, start=min(max(warm[p.name], p.lower), p.upper))
        for p in result.parameters
    ]
    problem = Problem(result.problem.sources, parameters, result.loss)
    prior = next((p.prior for p in result.parameters if p.name == name), None)
    extra = ((value - prior.mean) / prior.error) ** 2 if prior else 0.0
    try:
        x = np.array([p.inward(p.start) for p in problem.free], dtype=float)
        rows = problem.residuals(x)
        if not np.isfinite(rows).all():
            return None
        if not problem.free:
            return float(loss_of(result.loss, rows**2, 0)[0].sum()) + extra, problem.values(x)
        optimum = problem.solve(x, RESTART_TOLERANCE, 100)
    except CannotEvaluate:
        return None
    return 2 * float(optimum.cost) + extra, problem.values(optimum.x)


def _crossing(values: Array, rises: Array, best: float, limit: float, sign: float) -> float | None:
    """Return where the signed root of the rise, nearly straight in the parameter, crosses the limit."""
    outward = [(v, r) for v, r in zip(values, rises, strict=True) if (v - best) * sign >= 0.0]
    outward.sort(key=lambda point: abs(point[0] - best))
    for (v0, r0), (v1, r1) in itertools.pairwise(outward):
        if r1 >= limit > r0:
            a, b, goal = math.sqrt(max(r0, 0.0)), math.sqrt(r1), math.sqrt(limit)
            return float(v0 + (v1 - v0) * (goal - a) / (b - a))
    return None
