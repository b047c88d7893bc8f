"""Result of a fit: values, error bars, identifiability and misfit."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping

import numpy as np
from scipy.special import ndtri, stdtrit

from softmodels.common.arrays import Array
from softmodels.common.names import keep_arrays, read_only
from softmodels.fitting.problem import GroupSummary, Parameter, Problem, Rows, autocorrelation_time
from softmodels.materials.laws import MaterialError

LEVEL = 0.95
BLIND = 1e-8
"""Relative singular value of the scaled Jacobian below which a direction is undetermined."""
LEAST_FREEDOM = 0.2
"""Minimum freedom of a residual, 1 - leverage."""
EXACT = 1e-6
"""Residuals below this fraction of the model count as rounding."""


@dataclasses.dataclass(frozen=True)
class StartResult:
    """Result of one start: parameters, deviance (infinite if it failed), and an error, if any."""

    values: Mapping[str, float]
    deviance: float
    trouble: str


@dataclasses.dataclass(frozen=True, eq=False)
class LeastSquaresFit:
    """A fit and its statistics.

    Error bars rest on the sandwich formula of robust regression (Huber & Ronchetti 2009, Robust Statistics, section 7.6),
    widened where neighbouring residuals are correlated: a law that misses a densely measured curve leaves long runs of one
    sign, and a hundred points of one run are worth about one.

    Attributes:
        label: What was fitted.
        parameters: All parameters, the fixed ones too.
        values: Their values by name.
        residuals: Standardised residuals, the priors' last, shape (n,).
        jacobian: Their derivatives by the free parameters, shape (n, m).
        rows: What the residuals are.
        deviance: Sum of the loss over the squared residuals: chi squared, for a linear loss.
        loss: See `softmodels.fitting.least_squares.fit_parameters`.
        errors: See `softmodels.fitting.least_squares.fit_parameters`.
        evaluations: Evaluations of the sources so far.
        starts: Where each start ended.
        problem: What `softmodels.fitting.least_squares.profile` solves again.
        troubles: Sentences on what speaks against the fit; none if it ended well.
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
    shared: Array | None = None

    def __post_init__(self) -> None:
        keep_arrays(self)

    @property
    def free(self) -> list[Parameter]:
        return [p for p in self.parameters if not p.fixed]

    @property
    def converged(self) -> bool:
        return not any("do not use its values" in trouble for trouble in self.troubles)

    @property
    def count(self) -> int:
        """Measured residuals, without the priors'."""
        return len(self.rows.groups)

    @functools.cached_property
    def at_bounds(self) -> dict[str, float]:
        """Free parameters that ended at a bound, and which bound."""
        found = {}
        for p in self.free:
            x = p.inward(self.values[p.name])
            for end in (p.lower, p.upper):
                if math.isfinite(end) and abs(x - p.inward(end)) <= 1e-6 * max(1.0, abs(x)):
                    found[p.name] = end
        return found

    # -- scatter ------------------------------------------------------------------------------------------------------

    @functools.cached_property
    def influence(self) -> tuple[Array, float]:
        """Influence psi of each measured residual, and the mean of its slope."""
        r = self.residuals[: self.count]
        if self.loss == "linear":
            return r, 1.0
        return read_only(r / np.sqrt(1 + r**2)), float(np.mean((1 + r**2) ** -1.5))

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
        """Covariance of the free parameters in their units, shape (m, m).

        Infinite where the data see nothing, and nan for parameters at a bound, whose neighbours' are as if it were fixed.
        """
        inside = [i for i, p in enumerate(self.free) if p.name not in self.at_bounds]
        full = np.full((len(self.free), len(self.free)), np.nan)
        if inside:
            full[np.ix_(inside, inside)] = self._sandwich(self.jacobian[:, inside])
        return read_only(full + self.considered)

    @functools.cached_property
    def considered(self) -> Array:
        """The part of the covariance due to `shared` errors, shape (m, m)."""
        if self.shared is None:
            return read_only(np.zeros((len(self.free), len(self.free))))
        inside = [p.name not in self.at_bounds for p in self.free]
        J = self.jacobian[: self.count] * inside
        moved = np.linalg.pinv(J, rcond=BLIND) @ self.shared
        return read_only(np.asarray(moved @ moved.T))

    def _sandwich(self, J: Array) -> Array:
        size = np.linalg.norm(J, axis=0)
        size[size == 0.0] = 1.0
        bread, meat = self.information(J / size)
        eigenvalues, vectors = np.linalg.eigh(bread)
        seen = eigenvalues > BLIND**2 * max(eigenvalues[-1], 1e-300)
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
            inverse = np.linalg.pinv(bread, rcond=BLIND**2, hermitian=True)
            leverage = slope * np.einsum("ij,jk,ik->i", data, inverse, data)
            spread = spread * (psi / np.maximum(1 - leverage, LEAST_FREEDOM)) ** 2
        else:
            spread = spread * self.dispersion * slope**2
        return bread, (data.T * spread) @ data + known

    @functools.cached_property
    def newton_step(self) -> float:
        """Length of one more Gauss-Newton step, in standard errors; 0 at a minimum."""
        inside = [i for i, p in enumerate(self.free) if p.name not in self.at_bounds]
        if not inside:
            return 0.0
        J = self.jacobian[:, inside]
        size = np.linalg.norm(J, axis=0)
        J = J / np.where(size == 0.0, 1.0, size)
        psi, _ = self.influence
        gradient = J.T @ np.concatenate([psi, self.residuals[self.count :]])
        bread, _ = self.information(J)
        step = np.linalg.pinv(bread, rcond=BLIND, hermitian=True) @ gradient
        # Data matched to rounding have no meaningful standard error.
        model = self.jacobian[: self.count] @ np.array([self.values[p.name] for p in self.free])
        rounding = EXACT**2 * float(np.mean(model**2))
        return math.sqrt(max(float(gradient @ step), 0.0) / max(self.dispersion, rounding, 1e-300))

    @property
    def quantile(self) -> float:
        """Half a 95 % interval in standard errors: Student's if the errors are estimated from the scatter."""
        if self.errors == "stated" and self.dispersion == 1.0:
            return float(ndtri((1 + LEVEL) / 2))
        return float(stdtrit(max(self.independent - len(self.free), 1.0), (1 + LEVEL) / 2))

    def error(self, name: str) -> float:
        """Return the standard error of a parameter in its unit; 0 if it is fixed, nan at a bound."""
        names = [p.name for p in self.free]
        if name not in names:
            return 0.0
        variance = self.covariance[names.index(name)][names.index(name)]
        return math.inf if variance < 0.0 else math.sqrt(variance)  # negative: only rounding is left

    def interval(self, name: str) -> tuple[float, float]:
        """Return the 95 % interval of a parameter from the covariance; nan at a bound (see
        `softmodels.fitting.least_squares`)."""
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
        return math.sqrt(self.quantile**2 * own + ndtri((1 + LEVEL) / 2) ** 2 * considered)

    @functools.cached_property
    def correlations(self) -> Array:
        """Correlations of the free parameters' estimates, shape (m, m); nan where there is no variance."""
        with np.errstate(invalid="ignore"):
            sizes = np.sqrt(np.diag(self.covariance))
            return read_only(np.asarray(self.covariance / np.outer(sizes, sizes)))

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


# ----------------------------------------------------------------------------------------------------------------------
# Acceptance of a fit: general objections, for any law and data.


NORMAL = 1.96
"""Half a 95 % interval in standard errors."""


@dataclasses.dataclass(frozen=True)
class Judgement:
    """Objections to a fit from the device, the bench and the silicone.

    Attributes:
        objections: Sentences that forbid its use.
        warnings: Sentences that do not.
        notes: What was corrected.
    """

    objections: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


NOTHING = Judgement()


def objections(fit: LeastSquaresFit, modulus: Callable[[Mapping[str, float]], float]) -> tuple[str, ...]:
    """Return the objections to a fit, as sentences; empty if accepted.

    Args:
        fit: The fit.
        modulus: The law's small-strain shear modulus in Pa at parameter values.
    """
    found = [
        f"{p.words} ended at its bound {with_unit(bound, p)}, so its value and interval are meaningless"
        for p in fit.free
        if (bound := fit.at_bounds.get(p.name)) is not None and bound not in p.answers
    ]
    found += [f"the data do not determine {p.words}: {why}" for p in fit.free if (why := _undetermined(fit, p))]
    value, error = modulus(fit.values), _modulus_error(fit, modulus)
    if not found and not NORMAL * error < abs(value):
        found.append(
            f"the data do not determine the shear modulus: {value / 1e3:.4g} kPa with a standard error of {error / 1e3:.3g} kPa"
        )
    return tuple(found)


def with_unit(value: float, p: Parameter) -> str:
    """Return a parameter's value with its unit."""
    return f"{value:.4g} {p.unit}".rstrip()


def _undetermined(fit: LeastSquaresFit, p: Parameter) -> str:
    """Return why a parameter is not determined, empty if it is; one with a prior always is."""
    if p.prior or p.hidden or p.name in fit.at_bounds:
        return ""
    if not math.isfinite(fit.error(p.name)):
        return "another parameter compensates any change of it"
    low, high = (fit.values[p.name] + sign * NORMAL * fit.error(p.name) for sign in (-1.0, 1.0))
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


TOGETHER = 0.98
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
        room, against = _allowed(p, fit.values[p.name])
        if not fit.quantile * _data_error(fit, p) < room:
            rests = f"{p.words} depends on its prior: without it, its interval would be wider"
            said.append(
                rests if p.prior else f"the data do not determine {p.words}: its interval is wider than {against}"
            )
    R = fit.correlations
    for i, a in enumerate(fit.free):
        for j in range(i):
            if abs(R[i, j]) > TOGETHER and not (a.hidden or fit.free[j].hidden):
                both = f"{fit.free[j].name} and {a.name}"
                said.append(f"the data determine {both} only jointly (correlation {R[i, j]:.3f})")
    values, vectors = singular_values(fit)
    if np.isinf(np.diag(fit.covariance)).any() and values[-1] <= BLIND * max(values[0], 1e-300):
        mixed = [p.words for p, share in zip(fit.free, vectors[-1], strict=True) if abs(share) > 0.1]
        said.append(f"the data do not determine one combination of {', '.join(mixed)}")
    return tuple(said)


def _data_error(fit: LeastSquaresFit, p: Parameter) -> float:
    """Return the standard error of a parameter without its prior."""
    if not p.prior:
        return fit.error(p.name)
    own = fit.count + [q.name for q in fit.free if q.prior].index(p.name)
    without = dataclasses.replace(
        fit, residuals=np.delete(fit.residuals, own), jacobian=np.delete(fit.jacobian, own, axis=0)
    )
    return without.error(p.name)


def _allowed(p: Parameter, value: float) -> tuple[float, str]:
    """Return the maximum half width of an interval for a determined parameter, and its reference."""
    if p.prior:
        return 1.96 * p.prior.error, "its prior"
    if p.logarithmic or not math.isfinite(p.upper - p.lower):
        return (abs(value) or p.scale) * (1.0 if p.lower >= 0.0 else 10.0), "its own size"
    return (p.upper - p.lower) / 2, "its bounds"
