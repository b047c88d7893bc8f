"""Whole outlines of a simulated device against measured ones, at all pressures, as a source of residuals.

Errors in variables: each photograph has a hidden added volume. Its state is solved at that volume, which passes limit
points; the state's outline is held against all points of the photograph, and its pressure against the reading, once, so
that the reading's error is common to all points. What the bench may have got wrong is a parameter with a prior:

    pressure   = reading (1 - pressure_scale) - pressure_offset - leak reading^2 / largest reading
    x measured = centre + (1 + scale) x,    z measured = zero + (1 + scale) z

A leak (flow through the hose between column and device) makes readings too high, more so at high pressure.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from measurement.series.column import DENSITY_ERROR
from measurement.units import WATER_DENSITY
from softmodels.fitting.least_squares import fit_parameters
from softmodels.fitting.options import BENCH
from softmodels.fitting.outlines.data import OutlineFitError, Shape
from softmodels.fitting.outlines.device_model import DeviceModel
from softmodels.fitting.outlines.shadow import shadow_of
from softmodels.fitting.outlines.start import starts
from softmodels.fitting.problem import NOTHING_ELSE, CannotEvaluate, Changes, Extra, FitError, Parameter, Prior
from softmodels.fitting.result import LeastSquaresFit
from softmodels.mechanics.system import State
from softmodels.results.quadratic_curve import QuadraticCurve

Array = npt.NDArray[np.float64]

LEAK_ERROR = 0.02
"""Prior of the leak: share of the largest pressure lost there."""
SCALE_ERROR = 0.005
"""Prior of the unit of length: a board's pitch, a magnification."""
ZERO_ERROR = 20e-6
"""Prior of the zero plane's height in m."""
PRESSURE_SCALE_ERROR = DENSITY_ERROR / WATER_DENSITY
"""Prior of the unit of pressure: a column's density is one number for all readings."""
LENGTH_ERROR = 0.02
"""Prior of a length of the device, relative, where it is freed."""
UNHEARD = 1e6
"""Factor on the error of a pressure that does not count."""
READINGS = "pressures"
"""Label of the group of residuals that hold the pressures."""
POISSON_BOUNDS = (0.3, 0.5)


@dataclasses.dataclass(frozen=True)
class Bench:
    """Which uncertainties of device and bench are fitted; the others keep their nominal value.

    By default those that any bench has. Free ones have priors (`nuisances`), but for the centre, which outlines show by
    themselves.

    Attributes:
        free: Names among ``pressure_offset``, ``pressure_scale``, ``leak``, ``scale``, ``zero``, ``centre``, ``poisson`` and
            the device's own variable lengths, such as ``membrane``.
    """

    free: tuple[str, ...] = BENCH


class OutlineResiduals:
    """Residuals of a device against outlines; see `softmodels.fitting.problem.Residuals`.

    Args:
        model: The device and its law.
        shapes: Measured outlines, prepared.
        label: What it is.

    Attributes:
        fixed: Parameters whose derivatives nobody needs: their columns stay zero.
    """

    def __init__(self, model: DeviceModel, shapes: Sequence[Shape], label: str = "outlines"):
        self.model, self.shapes, self.label = model, tuple(shapes), label
        self.volumes = tuple(f"volume{i + 1}" for i in range(len(shapes)))
        self.parameters = (*model.names, *BENCH, *self.volumes)
        self.most = max(shape.pressure for shape in shapes)
        labels = [shape.source for shape in shapes for _ in shape.weight]
        self.groups = np.array([*labels, *[READINGS] * len(shapes)])
        self.fixed: frozenset[str] = frozenset()
        self._known: tuple[tuple[float, ...], list[MatchedPhotograph]] | None = None

    @property
    def count(self) -> int:
        return len(self.groups)

    @property
    def in_words(self) -> str:
        """How much was measured."""
        top = max(shape.height for shape in self.shapes)
        values = f"{self.count - len(self.shapes)} independent values"
        return f"{len(self.shapes)} outlines to {top * 1e3:.4g} mm at {self.most / 1e3:.4g} kPa, {values}"

    def largest_state(self, values: Mapping[str, float]) -> State:
        """The state of the largest volume at parameter values."""
        return max((fitting.state for fitting in self.matches(values)), key=lambda state: state.V)

    def evaluate(
        self, values: Mapping[str, float], derivatives: bool
    ) -> tuple[Array, Array | None, npt.NDArray[np.str_]]:
        """See `softmodels.fitting.problem.Residuals`.

        Raises:
            CannotEvaluate: There is no state at one of the volumes.
        """
        matches = self.matches(values)
        residuals = np.concatenate([*(f.residuals for f in matches), [f.reading for f in matches]])
        if not np.isfinite(residuals).all():
            raise CannotEvaluate("a residual is not finite")
        return residuals, self._jacobian(values, matches) if derivatives else None, self.groups

    def matches(self, values: Mapping[str, float]) -> list[MatchedPhotograph]:
        """Each photograph with its state at parameter values."""
        key = tuple(float(values[name]) for name in self.parameters)
        if self._known is None or self._known[0] != key:
            states = self.model.states(values, [values[name] for name in self.volumes])
            lengths = self.model.set_parameters(values)
            made = [
                MatchedPhotograph(
                    shape,
                    state,
                    self.model.curve(state, lengths),
                    self.model.pressure(state),
                    values,
                    self.most,
                )
                for shape, state in zip(self.shapes, states, strict=True)
            ]
            self._known = key, made
        return self._known[1]

    def _jacobian(self, values: Mapping[str, float], matches: Sequence[MatchedPhotograph]) -> Array:
        J = np.zeros((self.count, len(self.parameters)))
        column = {name: i for i, name in enumerate(self.parameters)}
        self.model.set_parameters(values)
        first, reading = 0, self.count - len(matches)
        for fitting, volume in zip(matches, self.volumes, strict=True):
            rows = slice(first, first + len(fitting.shape.weight))
            names = [name for name in self.model.names if name not in self.fixed]
            slopes = self.model.slopes(fitting.state, names)
            for name in names:
                J[rows, column[name]] = fitting.moved(slopes.nodes[name])
                J[reading, column[name]] = slopes.pressure[name] / fitting.shape.pressure_error
            J[rows, column[volume]] = fitting.moved(slopes.along_nodes)
            J[reading, column[volume]] = slopes.along_pressure / fitting.shape.pressure_error
            for name, (on_points, on_reading) in fitting.bench().items():
                J[rows, column[name]] = on_points
                J[reading, column[name]] = on_reading
            first, reading = rows.stop, reading + 1
        return J


class MatchedPhotograph:
    """One photograph held against one state.

    Attributes:
        residuals: Of the outline, one per bin: model less measured, across the outline.
        reading: Residual of the pressure.
    """

    def __init__(
        self,
        shape: Shape,
        state: State,
        curve: QuadraticCurve,
        pressure: float,
        values: Mapping[str, float],
        most: float,
    ):
        self.shape, self.state, self.curve, self.pressure = shape, state, curve, pressure
        self.values, self.most = values, most
        self.factor = 1.0 + values["scale"]
        away = shape.points[:, 0] - values["centre"]
        self.side = np.where(away < 0.0, -1.0, 1.0)
        self.points = np.column_stack([np.abs(away), shape.points[:, 1] - values["zero"]]) / self.factor
        self.shadow = shadow_of(curve)
        self.closest = self.shadow.curve.closest(self.points)
        self.distances = -self.factor * self.closest.distance
        self.residuals = shape.mean(self.distances)
        self.true_pressure = (
            shape.pressure * (1.0 - values["pressure_scale"])
            - values["pressure_offset"]
            - values["leak"] * shape.pressure**2 / most
        )
        self.reading = (pressure - self.true_pressure) / shape.pressure_error

    def moved(self, rate: Array) -> Array:
        """Derivative of the outline's residuals as the curve's nodes move."""
        return self.shape.mean(-self.factor * self.closest.moved(self.shadow.rate(rate)))

    def bench(self) -> dict[str, tuple[Array | float, float]]:
        """Derivatives of the outline's residuals and of the reading's by what the bench may have got wrong."""
        error, reading = self.shape.pressure_error, self.shape.pressure
        normal = self.closest.normal
        along = (normal * self.points).sum(axis=1)
        return {
            "pressure_offset": (0.0, 1.0 / error),
            "pressure_scale": (0.0, reading / error),
            "leak": (0.0, reading**2 / self.most / error),
            "scale": (self.shape.mean(along - self.closest.distance), 0.0),
            "zero": (self.shape.mean(normal[:, 1]), 0.0),
            "centre": (self.shape.mean(normal[:, 0] * self.side), 0.0),
        }


def nuisances(source: OutlineResiduals, bench: Bench) -> list[Parameter]:
    """Parameters of bench and device with their default priors; those that are not free are fixed.

    Raises:
        OutlineFitError: A name that is none of them.
    """
    model, shapes = source.model, source.shapes
    known = (*BENCH, "poisson", *model.lengths)
    for name in bench.free:
        if name not in known:
            raise OutlineFitError(
                f"nothing of the bench or the device is called {name!r}; known are {', '.join(known)}"
            )
    reading = min(shape.pressure_error for shape in shapes)
    width = model.silhouette.width
    centre = float(np.median([shape.centre for shape in shapes]))
    tops = source.most
    made = {
        "pressure_offset": Parameter("pressure_offset", "Pa", 0.0, -tops, tops, Prior(0.0, reading)),
        "pressure_scale": Parameter("pressure_scale", "", 0.0, -0.5, 0.5, Prior(0.0, PRESSURE_SCALE_ERROR)),
        "leak": Parameter("leak", "", 0.0, -0.5, 0.5, Prior(0.0, LEAK_ERROR)),
        "scale": Parameter("scale", "", 0.0, -0.2, 0.2, Prior(0.0, SCALE_ERROR)),
        "zero": Parameter("zero", "m", 0.0, -width, width, Prior(0.0, ZERO_ERROR)),
        "centre": Parameter("centre", "m", centre, centre - width, centre + width),
        "poisson": Parameter("poisson", "", model.choice.poisson, *POISSON_BOUNDS, answers=POISSON_BOUNDS[1:]),
        **{
            name: Parameter(name, "m", value, 0.7 * value, 1.3 * value, Prior(value, LENGTH_ERROR * value))
            for name, value in model.lengths.items()
        },
    }
    return [p if p.name in bench.free else dataclasses.replace(p, fixed=True) for p in made.values()]


def volume_parameters(source: OutlineResiduals, volumes: Sequence[float] | Array) -> list[Parameter]:
    """The hidden added volumes with a start for each, m3."""
    return [
        Parameter(name, "m^3", start, 0.05 * start, 4.0 * start, hidden=True, title=f"the added volume at {shape.name}")
        for name, start, shape in zip(source.volumes, volumes, source.shapes, strict=True)
    ]


def misfits(source: OutlineResiduals, residuals: Array) -> dict[str, tuple[float, int]]:
    """Chi squared of each photograph's outline, and of the readings, with the number of residuals."""
    found = {}
    for name in dict.fromkeys(source.groups.tolist()):
        part = residuals[: source.count][source.groups == name]
        found[name] = (float((part**2).sum()), len(part))
    return found


def fits_badly(chi2: float, count: int) -> bool:
    """Whether chi squared of this many residuals is beyond chance (one in a thousand, by Wilson & Hilferty 1931)."""
    k = max(count, 1)
    return chi2 > k * (1 - 2 / (9 * k) + 3.1 * math.sqrt(2 / (9 * k))) ** 3


def fit_law_to_outlines(
    source: OutlineResiduals,
    bench: Bench = Bench(),
    *,
    extra: Extra = NOTHING_ELSE,
    changes: Changes = MappingProxyType({}),
    loss: str = "linear",
    doubted: Collection[str] = (),
) -> LeastSquaresFit:
    """Fit a law to outlines from starts in closed form.

    Args:
        source: The device and its outlines.
        bench: What is free beside the law.
        extra: Further sources that depend on the law's parameters, such as tensile curves.
        changes: Fields of parameters to replace.
        loss: See `softmodels.fitting.least_squares.fit_parameters`.
        doubted: Names of photographs whose pressures do not count where the fit starts.

    Raises:
        FitError: See `softmodels.fitting.least_squares.fit_parameters`; or a change names no parameter.
        OutlineFitError: The device cannot be the one in the photographs.
    """
    choice = source.model.choice
    known = nuisances(source, bench)
    names = {*choice.names, *(p.name for p in (*known, *extra.parameters))}
    for name in changes:
        if name not in names:
            raise FitError(f"there is no parameter {name!r}; known are {', '.join(sorted(names))}")
    measured = [
        (shape.height, shape.pressure, shape.pressure_error * (UNHEARD if shape.source in doubted else 1.0))
        for shape in source.shapes
    ]
    begins, volumes = starts(source.model, *np.array(measured).T)
    troubles = []
    for begin in begins:
        parameters = [
            p.changed(changes.get(p.name, {})) for p in (*choice.parameters(begin), *known, *extra.parameters)
        ] + volume_parameters(source, volumes)
        source.fixed = frozenset(p.name for p in parameters if p.fixed)
        try:
            return fit_parameters([source, *extra.sources], parameters, loss=loss, label=choice.name)
        except FitError as error:
            troubles.append(str(error))
    raise FitError(f"{choice.name}: {troubles[0]}")
