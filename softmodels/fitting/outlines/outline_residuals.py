"""Whole outlines of a simulated device against measured ones, at all pressures, as a source of residuals.

Errors in variables: each photograph has a hidden added volume. Its state is solved at that volume, which passes limit
points; the state's outline is held against all points of the photograph, and its pressure against the reading, once, so
that the reading's error is common to all points. What the bench may have got wrong is a parameter with a prior:

    pressure   = reading (1 - pressure_scale) - pressure_offset - leak reading^2 / largest reading
    x measured = centre + (1 + scale) x,    z measured = zero + (1 + scale) z

A leak (flow through the hose between column and device) makes readings too high, more so at high pressure.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from measurement.read_only import keep_arrays
from softmodels.fitting.options import BENCH
from softmodels.fitting.outlines.device_model import DeviceModel
from softmodels.fitting.outlines.reading import OutlineFitError
from softmodels.fitting.outlines.shadow import shadow_of
from softmodels.fitting.outlines.shapes import Shape
from softmodels.fitting.problem import CannotEvaluate
from softmodels.mechanics.system import State
from softmodels.results.quadratic_curve import QuadraticCurve

Array = npt.NDArray[np.float64]

READINGS = "pressures"
"""Label of the group of residuals that hold the pressures."""


class OutlineResiduals:
    """Residuals of a device against outlines; see `softmodels.fitting.problem.Residuals`.

    Args:
        model: The device and its law.
        shapes: Measured outlines, prepared.
        label: What it is.
        device: What comes before the names of what is this device's own in a fit of several (`named`); empty for one alone.

    Raises:
        OutlineFitError: The device's top is not flat when undeformed, and nothing states that heights count from its apex.

    Attributes:
        fixed: Parameters whose derivatives nobody needs: their columns stay zero.
    """

    def __init__(self, model: DeviceModel, shapes: Sequence[Shape], label: str = "outlines", device: str = ""):
        _check_flat(model)
        self.model, self.shapes, self.label, self.device = model, tuple(shapes), label, device
        self._own_volumes = tuple(f"volume{i + 1}" for i in range(len(shapes)))
        self._own_names = (*model.names, *BENCH, *self._own_volumes)
        self.volumes = tuple(map(self.named, self._own_volumes))
        self.parameters = tuple(map(self.named, self._own_names))
        self.readings = f"{device}/{READINGS}" if device else READINGS
        self.most = max(shape.pressure for shape in shapes)
        labels = [shape.source for shape in shapes for _ in shape.weight]
        self.groups = np.array([*labels, *[self.readings] * len(shapes)])
        self.fixed: frozenset[str] = frozenset()
        self._known: tuple[tuple[float, ...], list[MatchedPhotograph]] | None = None

    @property
    def count(self) -> int:
        return len(self.groups)

    def named(self, name: str) -> str:
        """A parameter's name in the fit: the material's are common to all devices, the others its own."""
        return name if not self.device or name in (*self.model.choice.names, "poisson") else f"{self.device}.{name}"

    def own(self, values: Mapping[str, float]) -> dict[str, float]:
        """The fit's values by the names that they have in this device alone."""
        return {name: values[self.named(name)] for name in self._own_names}

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
            own = self.own(values)
            states = self.model.states(own, [own[name] for name in self._own_volumes])
            lengths = self.model.set_parameters(own)
            made = [
                MatchedPhotograph(
                    shape,
                    state,
                    self.model.curve(state, lengths),
                    self.model.pressure(state),
                    own,
                    self.most,
                )
                for shape, state in zip(self.shapes, states, strict=True)
            ]
            self._known = key, made
        return self._known[1]

    def _jacobian(self, values: Mapping[str, float], matches: Sequence[MatchedPhotograph]) -> Array:
        J = np.zeros((self.count, len(self.parameters)))
        column = {name: i for i, name in enumerate(self._own_names)}
        self.model.set_parameters(self.own(values))
        first, reading = 0, self.count - len(matches)
        for fitting, volume in zip(matches, self._own_volumes, strict=True):
            rows = slice(first, first + len(fitting.shape.weight))
            names = [name for name in self.model.names if self.named(name) not in self.fixed]
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


def _check_flat(model: DeviceModel) -> None:
    if not model.silhouette.flat and not model.hanging.from_apex:
        raise OutlineFitError(
            f"the undeformed top of the device is {model.silhouette.unevenness * 1e3:.3g} mm from flat, and heights of "
            "outlines count from a flat surface unless you state another: --heights-from apex if they count from the apex "
            "at zero pressure; or fit to the rises of the apex instead, as a table of heights"
        )


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
        keep_arrays(self)

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


def residuals_by_source(sources: Sequence[OutlineResiduals], residuals: Array) -> list[Array]:
    """The residuals of each source of a fit whose first sources they are."""
    return np.split(residuals, np.cumsum([source.count for source in sources]))[: len(sources)]


def misfits(source: OutlineResiduals, residuals: Array) -> dict[str, tuple[float, int]]:
    """Chi squared of each photograph's outline, and of the readings, with the number of residuals, the source's the first."""
    found = {}
    for name in dict.fromkeys(source.groups.tolist()):
        part = residuals[: source.count][source.groups == name]
        found[name] = (float((part**2).sum()), len(part))
    return found


def fits_badly(chi2: float, count: int) -> bool:
    """Whether chi squared of this many residuals is beyond chance (one in a thousand, by Wilson & Hilferty 1931)."""
    k = max(count, 1)
    return chi2 > k * (1 - 2 / (9 * k) + 3.1 * math.sqrt(2 / (9 * k))) ** 3
