"""Fitting parameters to measurements: bounded robust least squares over any sources of standardised residuals.

A source turns parameter values into residuals (model - measured) / error with exact derivatives. It may be a tensile curve
or a simulated outline; this file knows neither. Every decision here rests on numbers that the sources return, so processes
that share one source in lockstep stay in lockstep.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares
from scipy.stats import qmc

from softmodels.fit_result import Fit, Rows, StartResult

Array = npt.NDArray[np.float64]
Labels = Sequence[str] | npt.NDArray[np.str_]

LOSSES = ("linear", "soft_l1")
ERRORS = ("stated", "unknown")
SAME_DEVIANCE = 1e-4
"""Starts whose deviances differ by less than this (plus the same share) ended in one and the same minimum."""
FAR = 0.1
"""A fit whose next Newton step would still move it by this many standard errors has not converged."""


class FitError(ValueError):
    """A fit that cannot be made; the message is a sentence for the user."""


class CannotEvaluate(RuntimeError):
    """Raised by a source for parameter values that have no answer, such as a simulation that finds no equilibrium."""


@dataclasses.dataclass(frozen=True)
class Prior:
    """What is known beforehand: one more residual (value - mean) / error, in the parameter's unit."""

    mean: float
    error: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.mean) and math.isfinite(self.error) and self.error > 0.0):
            raise FitError(f"a prior of {self.mean:g} +- {self.error:g} needs finite numbers and an error above zero")


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One number that a fit may change.

    Where the bounds keep the sign and span two decades, the fit works on the logarithm.

    Attributes:
        name: How the sources call it.
        unit: Unit of its values, ``""`` for a pure number.
        start: First guess.
        lower: Lower bound, perhaps ``-inf``.
        upper: Upper bound, perhaps ``inf``.
        prior: What is known beforehand.
        fixed: Keep it at ``start``.
    """

    name: str
    unit: str
    start: float
    lower: float = -math.inf
    upper: float = math.inf
    prior: Prior | None = None
    fixed: bool = False

    def __post_init__(self) -> None:
        if not math.isfinite(self.start):
            raise FitError(f"{self.name} starts at {self.start}, which is not a finite number")
        if not self.fixed and not self.lower < self.upper:
            raise FitError(f"{self.name}: the bounds {self.lower:g} and {self.upper:g} leave nothing between them")
        if not self.fixed and not self.lower <= self.start <= self.upper:
            raise FitError(f"{self.name} starts at {self.start:g}, outside its bounds {self.lower:g} to {self.upper:g}")

    @property
    def logarithmic(self) -> bool:
        return (self.lower > 0.0 and self.upper >= 100 * self.lower) or (
            self.upper < 0.0 and self.lower <= 100 * self.upper
        )

    @property
    def scale(self) -> float:
        """A size of the parameter, by which a fit divides it."""
        if self.start != 0.0:
            return abs(self.start)
        if self.prior:
            return self.prior.error
        span = self.upper - self.lower
        return span / 2 if math.isfinite(span) else 1.0

    def inward(self, value: Any) -> Any:
        """The fit's own coordinate of a value."""
        with np.errstate(divide="ignore"):
            return np.log(abs(value)) if self.logarithmic else value / self.scale

    def outward(self, x: Any) -> Any:
        """The value at a coordinate, within the bounds."""
        value = math.copysign(np.exp(x), self.start) if self.logarithmic else x * self.scale
        return min(max(value, self.lower), self.upper)

    def rate(self, value: float) -> float:
        """d(value) / d(coordinate)."""
        return value if self.logarithmic else self.scale


class Residuals(Protocol):
    """A source of residuals.

    A source may also carry ``unit`` (str) and ``errors`` (scalar or one per residual, in that unit): what a residual of 1
    stands for. A fit then tells its residuals in that unit.
    """

    @property
    def label(self) -> str:
        """What it is, in a few words."""
        ...

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters it depends on: the columns of its Jacobian."""
        ...

    def evaluate(self, values: Mapping[str, float], derivatives: bool) -> tuple[Array, Array | None, Labels]:
        """Standardised residuals at parameter values.

        Residuals of one group stand in their order along the curve: their correlation is judged along it. The fit asks
        without derivatives first and then, if it keeps the values, with them; a costly source remembers its last answer.

        Args:
            values: Parameters by name, at least `parameters`.
            derivatives: Whether the Jacobian is wanted.

        Returns:
            Residuals (n,), their exact derivatives (n, len(parameters)) or None, and the label of each residual's group
            (a photograph, a test).

        Raises:
            CannotEvaluate: There is no answer at these values.
        """
        ...


class Problem:
    """Sources and parameters as one vector function of the free parameters' coordinates."""

    def __init__(self, sources: Sequence[Residuals], parameters: Sequence[Parameter], loss: str):
        self.sources, self.parameters, self.loss = tuple(sources), tuple(parameters), loss
        self.free = [p for p in self.parameters if not p.fixed]
        self.evaluations = 0
        self.count = 0  # residuals, known after the first evaluation

    def values(self, x: Any) -> dict[str, float]:
        values = {p.name: float(p.start) for p in self.parameters if p.fixed}
        values.update({p.name: float(p.outward(c)) for p, c in zip(self.free, x, strict=True)})
        return {p.name: values[p.name] for p in self.parameters}

    def residuals(self, x: Any) -> Array:
        """All residuals, the priors' last; nan where a source has no answer."""
        values = self.values(x)
        self.evaluations += 1
        try:
            parts = [source.evaluate(values, False)[0] for source in self.sources]
        except CannotEvaluate:
            if not self.count:
                raise
            return np.full(self.count, np.nan)
        rows = np.concatenate([*parts, self._prior_residuals(values)])
        self.count = len(rows)
        return rows

    def jacobian(self, x: Any) -> Array:
        values = self.values(x)
        return self.slopes(values)[0] * np.array([p.rate(values[p.name]) for p in self.free])

    def slopes(self, values: Mapping[str, float]) -> tuple[Array, Rows]:
        """Derivatives by the free parameters' values, shape (n, free), and what each row is, the priors' left out."""
        column = {p.name: i for i, p in enumerate(self.free)}
        blocks: list[Array] = []
        rows = Rows([], [], [])
        for source in self.sources:
            _, J, labels = source.evaluate(values, True)
            assert J is not None
            block = np.zeros((len(J), len(self.free)))
            for name, slope in zip(source.parameters, J.T, strict=True):
                if name in column:
                    block[:, column[name]] = slope
            blocks.append(block)
            rows.groups.extend(str(label) for label in labels)
            rows.sizes.extend(np.broadcast_to(getattr(source, "errors", 1.0), (len(J),)).tolist())
            rows.units.extend([str(getattr(source, "unit", "errors"))] * len(J))
        priors = [p for p in self.free if p.prior]
        block = np.zeros((len(priors), len(self.free)))
        for row, p in enumerate(priors):
            assert p.prior
            block[row, column[p.name]] = 1 / p.prior.error
        return np.vstack([*blocks, block]), rows

    def _prior_residuals(self, values: Mapping[str, float]) -> Array:
        return np.array([(values[p.name] - p.prior.mean) / p.prior.error for p in self.free if p.prior])

    def solve(self, x: Array, tolerance: float, most: int) -> Any:
        """Run scipy's trust-region method from ``x``, whose residuals must be numbers."""
        priors = sum(p.prior is not None for p in self.free)
        bounds = np.sort([[p.inward(p.lower), p.inward(p.upper)] for p in self.free]).T
        inside = np.clip(x, *bounds)
        return least_squares(
            self.residuals, inside, jac=self.jacobian, bounds=bounds, x_scale="jac", max_nfev=most,
            loss=lambda z: loss_of(self.loss, z, priors), ftol=tolerance, xtol=tolerance, gtol=tolerance,
        )  # fmt: skip


def loss_of(loss: str, z: Array, priors: int) -> Array:
    """rho(z), rho'(z), rho''(z) of squared residuals z, shape (3, n); the last ``priors`` of them count as they are."""
    plain = np.array([z, np.ones_like(z), np.zeros_like(z)])
    if loss == "linear":
        return plain
    root = np.sqrt(1 + z)
    robust = np.array([2 * (root - 1), 1 / root, -0.5 / root**3])
    robust[:, len(z) - priors :] = plain[:, len(z) - priors :]
    return robust


def fit(
    sources: Sequence[Residuals],
    parameters: Sequence[Parameter],
    *,
    loss: str = "linear",
    starts: int | Sequence[Mapping[str, float]] = 1,
    errors: str = "stated",
    label: str = "",
    tolerance: float = 1e-10,
    most: int = 300,
) -> Fit:
    """Find the parameters at which all sources together agree best with their measurements.

    Args:
        sources: What was measured.
        parameters: Every parameter the sources name.
        loss: ``"linear"`` (least squares) or ``"soft_l1"``, in which residuals far above 1 count by their size and not by
            its square.
        starts: How many starting points: the parameters' own, then quasi-random ones around it (always the same). Or the
            starting values themselves; what they leave out, or have outside the bounds, starts where its parameter says.
        errors: ``"stated"``: the sources' errors are believed unless the scatter is larger. ``"unknown"``: only their
            ratios are; their size follows from the scatter.
        label: What is fitted, for reports.
        tolerance: Relative tolerance on the sum of squares, on the parameters and on the gradient.
        most: Evaluations per start at most.

    Raises:
        FitError: The task is impossible, or no start could be evaluated.
    """
    _check(sources, parameters, loss, errors)
    problem = Problem(sources, parameters, loss)
    runs: list[StartResult] = []
    best: Any = None
    for x in _starting_points(problem.free, starts):
        try:
            first = problem.residuals(x)
            if not np.isfinite(first).all():
                raise CannotEvaluate("the model has no finite value there")
            found = problem.solve(x, tolerance, most)
        except CannotEvaluate as error:
            runs.append(StartResult(problem.values(x), math.inf, str(error)))
            continue
        runs.append(
            StartResult(problem.values(found.x), 2 * float(found.cost), "" if found.status > 0 else found.message)
        )
        if best is None or found.cost < best.cost:
            best = found
    if best is None:
        raise FitError(f"the fit cannot start: {runs[0].trouble if runs else 'no starting values are given'}")
    return _judge(problem, best, runs, errors, label)


def _judge(problem: Problem, found: Any, runs: list[StartResult], errors: str, label: str) -> Fit:
    """The result with everything that speaks against it."""
    values = problem.values(found.x)
    residuals = problem.residuals(found.x)
    J, rows = problem.slopes(values)
    if len(residuals) < len(problem.free):
        few = f"{len(residuals)} numbers cannot determine {len(problem.free)} parameters"
        raise FitError(f"{few}; fix some or measure more")
    result = Fit(
        label=label or ", ".join(source.label for source in problem.sources), parameters=problem.parameters,
        values=values, residuals=residuals, jacobian=J, rows=rows,
        deviance=2 * float(found.cost), loss=problem.loss, errors=errors, evaluations=problem.evaluations,
        starts=tuple(runs), problem=problem, troubles=(),
    )  # fmt: skip
    troubles = []
    if found.status <= 0:
        troubles.append(f"the fit did not converge within {found.nfev} evaluations; its values are not to be trusted")
    elif (step := result.newton_step) > FAR:
        troubles.append(
            f"the fit stopped where a further step would still move it by {step:.2g} standard errors; "
            "its values are not to be trusted"
        )
    troubles += [f"{name} ended at its bound {bound:.4g}" for name, bound in result.at_bounds.items()]
    troubles += _disagreement(runs, result)
    return dataclasses.replace(result, troubles=tuple(troubles))


def _disagreement(runs: list[StartResult], result: Fit) -> list[str]:
    """Starts that ended elsewhere, if that other place is nearly as good; starts that could not be run."""
    room = SAME_DEVIANCE * (1 + result.deviance)
    likely = 3.84 * result.dispersion
    said = []
    rivals = [
        run
        for run in runs
        if math.isfinite(run.deviance) and run.deviance - result.deviance <= likely and _apart(run, result)
    ]
    if rivals:
        other = ", ".join(f"{p.name} {rivals[0].values[p.name]:.4g}" for p in result.free)
        said.append(
            f"{len(rivals)} of {len(runs)} starts ended in another minimum that fits nearly as well ({other}): "
            "the data do not decide between them"
        )
    ended = [run for run in runs if math.isfinite(run.deviance)]
    if len(ended) > 1 and sum(run.deviance - result.deviance <= room for run in ended) == 1:
        said.append(f"only one of {len(ended)} starts reached this minimum; there may be a better one")
    return said


def _apart(run: StartResult, result: Fit) -> bool:
    """Whether a start ended further from the result than the result's own intervals reach.

    Terms that have changed places (Ogden's) are the same result.
    """
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
    """Coordinates: the given ones; or the parameters' own, then Halton points a factor e^1.5, or one size, around it."""
    origin = np.array([p.inward(p.start) for p in free], dtype=float)
    if not isinstance(starts, int):
        chosen = [[start.get(p.name, p.start) for p in free] for start in starts]
        held = [[v if p.lower <= v <= p.upper else p.start for p, v in zip(free, one, strict=True)] for one in chosen]
        return [np.array([p.inward(v) for p, v in zip(free, one, strict=True)], dtype=float) for one in held]
    points = [origin]
    if starts > 1:
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
        raise FitError(f"no start is given for {', '.join(sorted(missing))}")
    if idle := [p.name for p in parameters if not p.fixed and p.name not in used and p.prior is None]:
        raise FitError(f"nothing measured depends on {', '.join(idle)}; fix it")
    if all(p.fixed for p in parameters):
        raise FitError("every parameter is fixed; there is nothing to fit")
