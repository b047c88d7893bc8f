"""Fit problems: parameters, priors, and sources of residuals as one vector function."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Protocol, TypedDict

import numpy as np
import numpy.typing as npt
from scipy.optimize import OptimizeResult, least_squares, nnls

from softmodels.common import errors, names, schema, units
from softmodels.common.arrays import Array
from softmodels.common.names import checked
from softmodels.materials import laws
from softmodels.materials.laws import Material, MaterialError

# ----------------------------------------------------------------------------------------------------------------------
# Groups of residuals, such as those of one curve or photograph, and their correlation length.


MIN_GROUP_SIZE = 8
"""Minimum number of residuals of a group to estimate their correlation."""


@dataclasses.dataclass(frozen=True)
class Rows:
    """Group of each measured residual, the size and unit of a residual of 1, and the standard error that such a measurement
    usually has, in that unit; nan where its source does not tell."""

    groups: list[str]
    sizes: list[float]
    units: list[str]
    usual: list[float]


@dataclasses.dataclass(frozen=True)
class GroupSummary:
    """Residuals of one group, in ``unit``: their number, root mean square, mean and largest (with its sign), and their
    correlation length in points, 1 for independent scatter."""

    unit: str
    count: int
    rms: float
    mean: float
    largest: float
    run: float


def autocorrelation_time(r: Array) -> float:
    """Return the sum of the autocorrelation over all lags of values (n,) in their order, at least 1: the number of
    neighbours per independent value. It ends at the first lag whose correlation could be chance (2 / sqrt(n))."""
    n = len(r)
    power = float(np.sum(r**2))
    if n < MIN_GROUP_SIZE or power == 0.0:
        return 1.0
    total = 1.0
    for lag in range(1, n // 2):
        correlation = float(np.sum(r[lag:] * r[:-lag])) / power
        if correlation < 2 / math.sqrt(n):
            break
        total += 2 * correlation
    return min(total, n / 2)


Labels = Sequence[str] | npt.NDArray[np.str_]


class FitError(errors.OptionMessage, ValueError):
    """A fit is impossible; the message is for the user."""


class UnsoundError(FitError):
    """The measurements contradict each other, so that no fit is usable; the message is for the user."""


class CannotEvaluate(RuntimeError):
    """Raised by a source that cannot be evaluated at the parameter values, such as a simulation without equilibrium."""


@dataclasses.dataclass(frozen=True)
class Prior:
    """Prior knowledge: an additional residual (value - mean) / error, in the parameter's unit."""

    mean: float
    error: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.mean) and math.isfinite(self.error) and self.error > 0.0):
            raise FitError(f"a prior of {self.mean:g} +- {self.error:g} needs finite numbers and an error above zero")


class Change(TypedDict, total=False):
    """A user's changes to a `Parameter`: the fields to replace."""

    start: float
    lower: float
    upper: float
    prior: Prior | None
    fixed: bool


@dataclasses.dataclass(frozen=True)
class Parameter:
    """A parameter of a fit. Where the bounds keep the sign and span two decades, the fit works on the logarithm.

    Attributes:
        name: How the sources call it.
        unit: Unit of its values, ``""`` for a pure number.
        prior: What is known in advance.
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
            raise FitError(
                f"{self.name}: the bounds {self.lower:g} and {self.upper:g} must have the lower one below the upper one"
            )
        if not self.fixed and not self.lower <= self.start <= self.upper:
            raise FitError(f"{self.name} starts at {self.start:g}, outside its bounds {self.lower:g} to {self.upper:g}")

    @property
    def words(self) -> str:
        """The parameter's name in reports."""
        return self.title or self.name

    @property
    def own_name(self) -> str:
        """Its name without that of its device."""
        return self.name.removeprefix(f"{self.device}.") if self.device else self.name

    @property
    def logarithmic(self) -> bool:
        return (self.lower > 0.0 and self.upper >= 100 * self.lower) or (self.upper < 0.0 and self.lower <= 100 * self.upper)

    @property
    def scale(self) -> float:
        """The scale of the parameter in a fit."""
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
        """Return the fit's own coordinate of a value."""
        with np.errstate(divide="ignore"):
            return float(np.log(abs(value))) if self.logarithmic else value / self.scale

    def outward(self, x: float) -> float:
        """Return the value at a coordinate, within the bounds."""
        value = math.copysign(float(np.exp(x)), self.start) if self.logarithmic else x * self.scale
        return min(max(value, self.lower), self.upper)

    def rate(self, value: float) -> float:
        """Return d(value) / d(coordinate)."""
        return value if self.logarithmic else self.scale


Changes = Mapping[str, Change]
"""Fields of `Parameter` to replace, by name of the parameter: ``{"c3": {"start": 0.0, "fixed": True}}``."""


class Residuals(Protocol):
    """A source of residuals. It may also carry ``unit`` (str) and ``errors`` (scalar or one per residual, in that unit):
    what a residual of 1 stands for. A fit then reports its residuals in that unit. Where only the ratios of ``errors`` are
    known, or they are weights too, it may carry ``usual_errors``, by which a fit tells whether its model follows the data.
    Sources of a law have ``form_slopes(values, name)``, the derivatives by a factor of `laws.FORM_ENERGIES`, shape (n,)."""

    @property
    def label(self) -> str:
        """A short description."""
        ...

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters it depends on: the columns of its Jacobian."""
        ...

    def evaluate(self, values: Mapping[str, float], derivatives: bool) -> tuple[Array, Array | None, Labels]:
        """Return the standardised residuals (n,) at parameter values, at least `parameters`, if asked for their exact
        derivatives (n, len(parameters)), else None, and the label of each residual's group (a photograph, a test). Raises
        `CannotEvaluate` if there is no answer.

        Residuals of one group stand in their order along the curve: their correlation is judged along it. The fit asks
        without derivatives first and then, if it keeps the values, with them; a costly source remembers its last answer.
        """
        ...


@dataclasses.dataclass(frozen=True)
class Extra:
    """Additional data of a fit, such as tensile curves with outlines: sources that depend on the law's parameters by the
    same names, and parameters of theirs only."""

    sources: Sequence[Residuals] = ()
    parameters: Sequence[Parameter] = ()


# ----------------------------------------------------------------------------------------------------------------------
# Sources and parameters as one vector function of the free parameters' coordinates.


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
        """Return all residuals, the priors' last; nan where a source cannot be evaluated."""
        values = self.values(x)
        self.evaluations += 1
        try:
            parts = [source.evaluate(values, False)[0] for source in self.sources]
        except CannotEvaluate:
            if not self.count:
                raise
            return np.full(self.count, np.nan)
        priors = [(values[p.name] - p.prior.mean) / p.prior.error for p in self.free if p.prior]
        rows = np.concatenate([*parts, priors])
        self.count = len(rows)
        return rows

    def jacobian(self, x: Array) -> Array:
        values = self.values(x)
        return self.slopes(values)[0] * np.array([p.rate(values[p.name]) for p in self.free])

    def slopes(self, values: Mapping[str, float]) -> tuple[Array, Rows]:
        """Return the derivatives by the free parameters' values, shape (n, free), and what each row is, the priors' left
        out."""
        column = {p.name: i for i, p in enumerate(self.free)}
        blocks: list[Array] = []
        rows = Rows([], [], [], [])
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
            usual = getattr(source, "usual_errors", None)
            rows.usual.extend(np.broadcast_to(math.nan if usual is None else usual, (len(J),)).tolist())
        priors = [p for p in self.free if p.prior]
        block = np.zeros((len(priors), len(self.free)))
        for row, p in enumerate(priors):
            assert p.prior
            block[row, column[p.name]] = 1 / p.prior.error
        return np.vstack([*blocks, block]), rows

    def form_slopes(self, values: Mapping[str, float], name: str) -> Array | None:
        """Return the derivatives of the residuals of a law's sources by a factor of `laws.FORM_ENERGIES`, shape (n,); None if
        there are none."""
        try:
            slopes = [source.form_slopes(values, name) for source in self.sources]  # type: ignore[attr-defined]
            return names.read_only(np.concatenate(slopes))
        except CannotEvaluate:
            return None

    def solve(self, x: Array, tolerance: float, most: int) -> OptimizeResult:
        """Run scipy's trust-region method from ``x``, whose residuals must be numbers."""
        priors = sum(p.prior is not None for p in self.free)
        bounds = np.sort([[p.inward(p.lower), p.inward(p.upper)] for p in self.free]).T
        inside = np.clip(x, *bounds)
        return least_squares(
            self.residuals, inside, jac=self.jacobian, bounds=bounds, x_scale="jac", max_nfev=most,
            loss=lambda z: loss_of(self.loss, z, priors), ftol=tolerance, xtol=tolerance, gtol=tolerance,
        )  # fmt: skip


NOTHING_ELSE = Extra()


def loss_of(loss: str, z: Array, priors: int) -> Array:
    """Return rho(z), rho'(z), rho''(z) of squared residuals z, shape (3, n); the last ``priors`` of them without the loss."""
    plain = np.array([z, np.ones_like(z), np.zeros_like(z)])
    if loss == "linear":
        return plain
    root = np.sqrt(1 + z)
    robust = np.array([2 * (root - 1), 1 / root, -0.5 / root**3])
    robust[:, len(z) - priors :] = plain[:, len(z) - priors :]
    return robust


# ----------------------------------------------------------------------------------------------------------------------
# `FitOptions`: options of a fit, from the command line or a library call.


for _option, _argument in (("fix", "FitOptions.changes of"), ("untrusted", "FitOptions(untrusted=True)"),
                          ("memory", "FitOptions(memory=True)")):  # fmt: skip
    errors.call(_option, _argument)


errors.call("gauge-error", "FitOptions.gauge_error")


BENCH = ("pressure_offset", "pressure_scale", "leak", "scale", "zero", "centre")
"""Parameters of the bench."""
TILT = "tilt"
"""Parameter of side views: the device's turn in the picture, in degrees."""
LENGTHS = "lengths"
"""Stands for all lengths of a device that a fit may vary (`geometries.Actuator.variable`), whatever they are called."""
FREE = (*BENCH, TILT, LENGTHS)
"""What is fitted of bench and device by default: a cast part differs from its drawing."""

SECTION_ERROR, LOAD_CELL_ERROR = 0.03, 0.01
"""Default relative standard errors of a test's stress as a whole. The cross-section: ISO 37 lets
the thickness of one dumb-bell vary by 2 % and measures its width to 0.05 mm, 1 % of it; cast strips are similar. The load
cell: class 1 of ISO 7500-1."""
USUAL_GAUGE_ERROR = math.hypot(SECTION_ERROR, LOAD_CELL_ERROR)
"""Their combination."""

HEIGHTS_FROM = ("shadow", "apex", "undeformed")
"""Zero of the heights of a device with dead loads: the upper edge of its shadow at zero pressure, its apex
there, or its undeformed top."""


@checked
@dataclasses.dataclass(frozen=True)
class FitOptions:
    """Options of the fit of laws.

    Attributes:
        poisson: Poisson's ratio of the fitted material, given and not fitted (but see ``free``).
        changes: Bounds, priors, starts and fixed values by parameter, see `Changes`; in SI units.
        robust: Whether outliers count by their size, not by its square.
        profiles: Whether the intervals come from profile likelihoods; else from the covariance.
        silicone: Name of the silicone, whose known moduli show pressures in a wrong unit; ``"any"`` if it is in no list.
        stress_error: Standard error of stresses, see `softmodels.fitting.curves.residuals.StressError.from_text`.
        gauge_error: Standard error of a factor on each test (cross-section, load cell), a share; 0 for none. A curve does not
            show such a factor, so the intervals are too narrow without it.
        free: With a device: what is fitted of bench and device beside the law, see
            `softmodels.fitting.outlines.residuals.nuisances`; by default the bench and all lengths that a fit may vary.
        exclude: With a device: names of photographs to exclude.
        untrusted: With a device: whether measurements are taken that the measurement does not trust.
        height_datum: With a device that hangs under loads or whose top is not flat: what its heights count from, one of
            `HEIGHTS_FROM`; empty for the shadow, or the apex where the undeformed top is not flat. Outlines of
            such a top (balloon, bellows) have to state it.
        memory: Whether relaxing branches are fitted too, to outlines and curves with times, and to curves softening; the law
            is then that of equilibrium.
        branches: How many, with their relaxation times fitted too; 0 for one per decade that the data show, of fixed times.
    """

    poisson: float = laws.DEFAULT_POISSON_RATIO
    changes: Changes = dataclasses.field(default_factory=lambda: MappingProxyType({}))
    robust: bool = False
    profiles: bool = True
    silicone: str | None = None
    stress_error: str = "auto"
    gauge_error: float = USUAL_GAUGE_ERROR
    free: tuple[str, ...] = FREE
    exclude: tuple[str, ...] = ()
    untrusted: bool = False
    height_datum: str = ""
    memory: bool = False
    branches: int = 0

    def __post_init__(self) -> None:
        texts = schema.Several(schema.Words())
        kinds: dict[str, schema.Kind] = {
            "poisson": schema.Quantity(), "gauge_error": schema.Quantity(), "robust": schema.Flag(),
            "profiles": schema.Flag(), "untrusted": schema.Flag(),
            "memory": schema.Flag(),
            "stress_error": schema.Words(), "height_datum": schema.Words(), "free": texts, "exclude": texts,
        }  # fmt: skip
        for name, kind in kinds.items():
            value = getattr(self, name)
            try:
                settled = kind.settled(name, (value,) if kind is texts and isinstance(value, str) else value)
            except errors.FieldError as error:
                raise FitError(str(error)) from None
            object.__setattr__(self, name, settled)
        if not isinstance(self.silicone, str | None):
            raise FitError(f"silicone is {units.brief(self.silicone)}; it must be the name of one, such as 'ecoflex-00-30'")
        if not isinstance(self.changes, Mapping) or not all(isinstance(change, Mapping) for change in self.changes.values()):
            raise FitError(
                f"changes is {units.brief(self.changes)}; it must be a table by parameter, such as {{'c1': {{'value': 14e3}}}}"
            )
        if self.height_datum not in ("", *HEIGHTS_FROM):
            known = f"{', '.join(HEIGHTS_FROM)}{errors.meant(self.height_datum, HEIGHTS_FROM)}"
            raise FitError(f"height_datum is {self.height_datum!r}; it must be one of {known}")
        object.__setattr__(self, "branches", names.whole("branches", self.branches, 0))
        if not 0.0 <= self.gauge_error < 1.0:
            raise FitError(f"a gauge error of {self.gauge_error:g} must be between 0 and 100 %")

    @property
    def gauge_words(self) -> str:
        """The factor on each test, a clause starting with a comma."""
        if not self.gauge_error:
            return ", no factor on the tests (--gauge-error): intervals without errors of cross-section and load cell"
        usual = ""
        if self.gauge_error == USUAL_GAUGE_ERROR:
            usual = (
                f" (cross-section {100 * SECTION_ERROR:g} % and load cell {100 * LOAD_CELL_ERROR:g} %, the default; "
                "change it with --gauge-error)"
            )
        return f", a factor of 1 +- {100 * self.gauge_error:.3g} % on each test{usual}"

    @property
    def loss(self) -> str:
        """Loss function, see `softmodels.fitting.least_squares.fit_parameters`."""
        return "soft_l1" if self.robust else "linear"

    def changes_of(self, names: tuple[str, ...]) -> Changes:
        """Return the changes of these parameters."""
        return {name: change for name, change in self.changes.items() if name in names}


DEFAULT_OPTIONS = FitOptions()


# ----------------------------------------------------------------------------------------------------------------------
# Laws for fits: parameter names, bounds and starting values.
#
# A law that is a sum of terms, such as ``ogden``, with a number behind its name has that many of them. Poisson's ratio is not
# fitted, because tension hardly depends on it.


Design = Callable[[Material, Sequence[str]], Array]
"""Slopes of all standardised stresses by the named parameters of a material, shape (n, m)."""

MAX_STARTS = 6
"""Number of starts of a law of several terms, out of all combinations of its grid."""


@dataclasses.dataclass(frozen=True)
class LawChoice:
    """A law by the name asked for, such as ``"ogden2"``, with its number of terms, 0 for a law that is no sum, and
    Poisson's ratio of the fitted material."""

    name: str
    law: type[Material]
    terms: int
    poisson: float

    @classmethod
    def from_text(cls, text: str, poisson: float = laws.DEFAULT_POISSON_RATIO) -> LawChoice:
        """Read ``"yeoh"`` or ``"ogden2"``; `FitError` for no such law, or too many terms."""
        name, _, numbers = text.partition(":")
        known_law = laws.law_called(name)
        if known_law is None:
            raise FitError(
                f"law {text!r} is unknown; known are {known_laws()} and all{errors.meant(text, [*laws.LAWS, 'all'])}"
            )
        if numbers:
            raise FitError(f"law {text!r}: a fit finds its numbers; name only the law, {name}, and fix one by --fix")
        law, terms = known_law
        if not terms:
            return cls.from_law(law, poisson)
        if terms > law.most_terms:
            raise FitError(f"law {text!r}: at most {law.most_terms} terms of {law.title or law.name} can be distinguished")
        return cls(f"{law.name}{terms}", law, terms, poisson)

    @classmethod
    def from_law(cls, law: type[Material], poisson: float = laws.DEFAULT_POISSON_RATIO) -> LawChoice:
        """Return a law's class, with as many terms as are usual."""
        name = f"{law.name}{law.usual_terms}" if law.usual_terms else law.name
        return cls(name, law, law.usual_terms, poisson)

    @classmethod
    def of(cls, material: Material) -> LawChoice:
        """Return the law of a material, with its number of terms and its Poisson's ratio."""
        name = f"{material.name}{material.terms}" if material.terms else material.name
        return cls(name, type(material), material.terms, material.poisson)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the fitted parameters, without Poisson's ratio."""
        return self.law.parameter_names(self.terms)

    def unit(self, name: str) -> str:
        """Return the unit of one of `names`."""
        return self.law.parameter_unit(name)

    def material(self, values: Mapping[str, float], stretches: tuple[float, float] | None = None) -> Material:
        """Return the material with these parameters, fitted over a range of stretch; `MaterialError` if the law cannot
        take them."""
        made = self.law.from_parameters(values, self.terms, self.poisson)
        return made if stretches is None else dataclasses.replace(made, fitted_stretch=stretches)

    def parameters(self, start: Mapping[str, float]) -> tuple[Parameter, ...]:
        """Return the parameters with the law's own bounds about a start."""
        return tuple(
            Parameter(name, self.unit(name), start[name], *self.law.parameter_bounds(name, start)) for name in self.names
        )

    def from_modulus(self, modulus: float, most: float = 10.0) -> dict[str, float]:
        """Return a start from only the small-strain shear modulus in Pa; ``most`` is the largest I1 - 3 expected."""
        return self.law.starting_values(modulus, most, self.terms)


Laws = str | type[Material] | Sequence[str | type[Material]]
"""One law or several: names with their numbers of terms, with commas between, or classes; ``"all"`` for all."""


def law_choices(laws: Laws, poisson: float = laws.DEFAULT_POISSON_RATIO) -> list[LawChoice]:
    """Read ``"yeoh,ogden2"``, ``"all"``, or classes of laws; `FitError` for no such law, or one named twice."""
    if not -1.0 < poisson <= 0.5:
        raise FitError(f"poisson = {poisson:g} is outside -1 to 0.5")
    if isinstance(laws, str):
        laws = all_laws() if laws.strip() == "all" else [part.strip() for part in laws.split(",")]
    chosen: list[str | type[Material]] = list(laws) if isinstance(laws, list | tuple) else [laws]  # type: ignore[list-item]
    for law in chosen:
        if not isinstance(law, str) and not (isinstance(law, type) and issubclass(law, Material) and law is not Material):
            hint = "; give its class, without its numbers" if isinstance(law, Material) else ""
            raise FitError(
                f"law {units.brief(law)} is invalid; it must be a name such as 'yeoh', or a class such as sm.Yeoh{hint}"
            )
    if not chosen:
        raise FitError(f"no law is given; known are {known_laws()} and all")
    choices = [
        LawChoice.from_text(law, poisson) if isinstance(law, str) else LawChoice.from_law(law, poisson) for law in chosen
    ]
    names = [choice.name for choice in choices]
    if len(set(names)) < len(names):
        raise FitError(f"a law is named twice in {','.join(names)!r}")
    return choices


def all_laws() -> tuple[str, ...]:
    """Return the names of the laws compared by ``all``, with numbers of terms; the order decides between equally
    simple ones."""
    return tuple(f"{name}{terms or ''}" for name, law in laws.LAWS.items() for terms in law.compared_terms)


def known_laws() -> str:
    """Return the names accepted by `LawChoice.from_text`."""
    several = [f"{name}1 to {name}{law.most_terms}" for name, law in laws.LAWS.items() if law.most_terms]
    return ", ".join([*laws.LAWS, *several])


def all_parameters() -> dict[str, str]:
    """Return the units of all parameters of all laws, however many terms these have, by name."""
    return {name: law.parameter_unit(name) for law in laws.LAWS.values() for name in law.parameter_names(law.most_terms)}


def closed_starts(choice: LawChoice, design: Design, target: Array, modulus: float, most: float) -> list[dict[str, float]]:
    """Return the starts, best first, by linear least squares over a grid of the nonlinear parameters: from the slopes that
    ``design`` gives of all standardised stresses, these (n,), and the small-strain shear modulus in Pa and largest I1 - 3
    of the data."""
    plain = choice.from_modulus(modulus, most)
    if choice.terms:
        return [*_term_starts(choice, design, target, modulus), plain]
    if not choice.law.linear:
        return choice.law.starting_grid(modulus, most)
    A = design(choice.material(plain), choice.names)
    size = np.linalg.norm(A, axis=0)
    weights, *_ = np.linalg.lstsq(A / size, target, rcond=None)
    start = dict(zip(choice.names, (weights / size).tolist(), strict=True))
    for name, value in plain.items():
        low, high = choice.law.parameter_bounds(name, start)
        if not low < start[name] < high:
            start[name] = 0.1 * modulus if choice.unit(name) == "Pa" else value
    return [start, plain]


def _term_starts(choice: LawChoice, design: Design, target: Array, modulus: float) -> list[dict[str, float]]:
    """Return the non-negative least squares for the terms' factors over combinations of their shape parameters' grid; the
    best few. Each factor has the sign that gives its term a shear modulus above zero (Ogden's mu_i alpha_i)."""
    fields = {field.name: field.metadata for field in laws.parameter_fields(choice.law) if field.metadata["many"]}
    factor = next(name for name, about in fields.items() if about["unit"] == "Pa")
    shape = next(name for name, about in fields.items() if about["grid"])
    grid = fields[shape]["grid"]
    signs, columns, moduli = {}, {}, {}
    for value in grid:
        for sign in (1.0, -1.0):
            try:
                term = choice.law.from_parameters({f"{factor}1": sign * modulus, f"{shape}1": value}, 1)
            except MaterialError:
                continue
            signs[value], moduli[value] = sign, term.shear_modulus_0 / modulus
            columns[value] = sign * design(term, (f"{factor}1",))[:, 0]
    tried = []
    for shapes in itertools.combinations(columns, choice.terms):
        A = np.column_stack([columns[value] for value in shapes])
        size = np.linalg.norm(A, axis=0)
        weights, misfit = nnls(A / size, target)
        # A term not in the grid starts small, not at its bound.
        sizes = np.maximum(weights / size, 5e-4 * modulus / np.array([moduli[value] for value in shapes]))
        tried.append((misfit, shapes, np.array([signs[value] for value in shapes]) * sizes))
    tried.sort(key=lambda start: start[0])
    return [
        {key: value for i, pair in enumerate(zip(factors.tolist(), shapes, strict=True), 1)
         for key, value in zip((f"{factor}{i}", f"{shape}{i}"), pair, strict=True)}
        for _, shapes, factors in tried[:MAX_STARTS]
    ]  # fmt: skip


def by_bounds(choice: LawChoice, starts: Sequence[Mapping[str, float]]) -> list[list[Mapping[str, float]]]:
    """Return the starts grouped by bounds: the signs of Ogden's exponents are fixed by the
    start."""
    grouped: dict[tuple[tuple[float, float], ...], list[Mapping[str, float]]] = {}
    for start in starts:
        bounds = tuple(choice.law.parameter_bounds(name, start) for name in choice.names)
        grouped.setdefault(bounds, []).append(start)
    return list(grouped.values())
