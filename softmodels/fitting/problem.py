"""What a fit is asked: parameters, what is known of them, and sources of residuals as one vector function."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Protocol, TypedDict

import numpy as np
import numpy.typing as npt
from scipy.optimize import OptimizeResult, least_squares

from measurement.wording import Spoken
from softmodels.fitting.residual_groups import Rows

Array = npt.NDArray[np.float64]
Labels = Sequence[str] | npt.NDArray[np.str_]


class FitError(Spoken, ValueError):
    """A fit that cannot be made; the message is a sentence for the user."""


class UnsoundError(FitError):
    """Measurements that contradict each other so that no fit of them is of use; the message is a sentence for the user."""


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


class Change(TypedDict, total=False):
    """What a user wants of a `Parameter`: its fields to replace."""

    start: float
    lower: float
    upper: float
    prior: Prior | None
    fixed: bool


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
        hidden: No one asks for its value: reports leave it out.
        title: What reports call it; its name if empty.
        answers: Bounds at which it may end, because the user or nature has set them.
        device: The device whose own it is in a fit of several, with a dot the beginning of its name; else empty.
    """

    name: str
    unit: str
    start: float
    lower: float = -math.inf
    upper: float = math.inf
    prior: Prior | None = None
    fixed: bool = False
    hidden: bool = False
    title: str = ""
    answers: tuple[float, ...] = ()
    device: str = ""

    def __post_init__(self) -> None:
        if not math.isfinite(self.start):
            raise FitError(f"{self.name} starts at {self.start}, which is not a finite number")
        if not self.fixed and not self.lower < self.upper:
            raise FitError(f"{self.name}: the bounds {self.lower:g} and {self.upper:g} leave nothing between them")
        if not self.fixed and not self.lower <= self.start <= self.upper:
            raise FitError(f"{self.name} starts at {self.start:g}, outside its bounds {self.lower:g} to {self.upper:g}")

    @property
    def words(self) -> str:
        """What reports call it."""
        return self.title or self.name

    @property
    def own_name(self) -> str:
        """Its name without that of its device."""
        return self.name.removeprefix(f"{self.device}.") if self.device else self.name

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

    def changed(self, change: Change) -> Parameter:
        """With a user's bounds, prior or fixed value; a start outside new bounds moves between them."""
        start, fixed = change.get("start", self.start), change.get("fixed", self.fixed)
        lower, upper = change.get("lower", self.lower), change.get("upper", self.upper)
        if not fixed and not lower <= start <= upper:
            start = min(max(start, lower), upper)
        ends = [value for end, value in (("lower", lower), ("upper", upper)) if end in change]
        return dataclasses.replace(
            self, start=start, fixed=fixed, lower=lower, upper=upper, prior=change.get("prior", self.prior),
            answers=(*self.answers, *ends),
        )  # fmt: skip

    def inward(self, value: float) -> float:
        """The fit's own coordinate of a value."""
        with np.errstate(divide="ignore"):
            return float(np.log(abs(value))) if self.logarithmic else value / self.scale

    def outward(self, x: float) -> float:
        """The value at a coordinate, within the bounds."""
        value = math.copysign(float(np.exp(x)), self.start) if self.logarithmic else x * self.scale
        return min(max(value, self.lower), self.upper)

    def rate(self, value: float) -> float:
        """d(value) / d(coordinate)."""
        return value if self.logarithmic else self.scale


Changes = Mapping[str, Change]
"""Fields of `Parameter` to replace, by name of the parameter: ``{"c3": {"start": 0.0, "fixed": True}}``."""


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


@dataclasses.dataclass(frozen=True)
class Extra:
    """What a fit takes beside its own measurements, such as tensile curves beside outlines.

    Attributes:
        sources: They depend on the law's parameters by the same names.
        parameters: Of theirs alone.
    """

    sources: Sequence[Residuals] = ()
    parameters: Sequence[Parameter] = ()


NOTHING_ELSE = Extra()


class Problem:
    """Sources and parameters as one vector function of the free parameters' coordinates."""

    def __init__(self, sources: Sequence[Residuals], parameters: Sequence[Parameter], loss: str):
        self.sources, self.parameters, self.loss = tuple(sources), tuple(parameters), loss
        self.free = [p for p in self.parameters if not p.fixed]
        self.evaluations = 0
        self.count = 0  # residuals, known after the first evaluation

    def values(self, x: Array) -> dict[str, float]:
        values = {p.name: float(p.start) for p in self.parameters if p.fixed}
        values.update({p.name: float(p.outward(c)) for p, c in zip(self.free, x, strict=True)})
        return {p.name: values[p.name] for p in self.parameters}

    def residuals(self, x: Array) -> Array:
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

    def jacobian(self, x: Array) -> Array:
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

    def solve(self, x: Array, tolerance: float, most: int) -> OptimizeResult:
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
