"""Residuals of simulated against measured outlines at all pressures.

Errors in variables: each photograph has a hidden added volume. Its state is solved at that volume, which passes limit
points; the state's outline is compared with all points of the photograph, and its pressure once with the reading, so
that the reading's error is common to all points. Systematic errors of the bench are parameters with priors:

    pressure   = reading (1 - pressure_scale) - pressure_offset - leak reading^2 / largest reading
    x measured = centre + (1 + scale) x,    z measured = zero + (1 + scale) z

A leak (flow through the hose between column and device) makes readings too high, more so at high pressure.
"""

from __future__ import annotations

import collections
import dataclasses
import itertools
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
from scipy.interpolate import PchipInterpolator

from measurement.series import photo_list
from softmodels.common import tables, units
from softmodels.common.arrays import Array
from softmodels.common.errors import known_are, reason
from softmodels.common.names import keep_arrays
from softmodels.fitting import least_squares, problem
from softmodels.fitting.outlines.device import DeviceModel
from softmodels.fitting.outlines.shapes import MAX_OUTLINE_HEIGHT, MIN_HEIGHT, OutlineFitError, Shape, kept, shadow_of
from softmodels.fitting.problem import FitError
from softmodels.mechanics import newton
from softmodels.mechanics.system import State
from softmodels.path import continuation, stability
from softmodels.runs import grid

IGNORED_ERROR_FACTOR = 1e6

READINGS = "pressures"
"""Label of the group of pressure residuals."""


class OutlineResiduals:
    """Residuals of a device under a law against outlines that are prepared; see `softmodels.fitting.problem.Residuals`.
    ``device`` comes before the names of what is this device's own in a fit of several (`named`); empty for a single one.

    Raises `OutlineFitError` where the device's top is not flat when undeformed, and nothing states that heights count from
    its apex.

    Attributes:
        fixed: Parameters whose derivatives nobody needs: their columns stay zero.
        read: Numbers of the photographs whose readings count.
        bench: Names of the parameters of the bench.
        what, size_words: What photographs show, and its size, in words.
    """

    bench: tuple[str, ...] = problem.BENCH
    what, size_words = "outlines", "at a height of"

    def __init__(self, model: DeviceModel, shapes: Sequence[Shape], label: str = "outlines", device: str = ""):
        from_apex = model.hanging.from_apex or {shape.whole for shape in shapes} == {True}
        if not model.silhouette.flat and not from_apex:
            raise OutlineFitError(
                f"the undeformed top of the device is {model.silhouette.unevenness * 1e3:.3g} mm from flat, and heights "
                "of outlines count from a flat surface unless another is given: --height-datum apex if they count from the "
                "apex at zero pressure; or fit to the rises of the apex instead, as a table of heights"
            )
        self.model, self.shapes, self.label, self.device = model, tuple(shapes), label, device
        self.read, self._own_hidden = self._hidden()
        self._own_names = (*model.names, *self.bench, *self._own_hidden)
        self.parameters = tuple(map(self.named, self._own_names))
        self.readings = f"{device}/{READINGS}" if device else READINGS
        self.most = max(shape.pressure for shape in shapes)
        labels = [shape.source for shape in shapes for _ in shape.weight]
        self.groups = np.array([*labels, *[self.readings] * len(self.read)])
        self.fixed: frozenset[str] = frozenset()
        self._known: tuple[tuple[float, ...], list[MatchedPhotograph]] | None = None

    def _hidden(self) -> tuple[list[int], tuple[str, ...]]:
        """Return `read`, and the names of the hidden parameters."""
        return [*range(len(self.shapes))], tuple(f"volume{i + 1}" for i in range(len(self.shapes)))

    @property
    def _volumes(self) -> tuple[str, ...]:
        """Names of the hidden added volumes, the first ones of all that is hidden."""
        return self._own_hidden[: len(self.read)]

    def hidden_parameters(self, volumes: Sequence[float] | Array, hangs: float = 0.0) -> list[problem.Parameter]:
        """Return the hidden added volumes with a start for each, m3; ``hangs`` is that of the device at zero pressure."""
        return [
            problem.Parameter(
                self.named(name), "m^3", start, hangs + 0.05 * (start - hangs), hangs + 4.0 * (start - hangs), hidden=True,
                title=f"the added volume at {shape.name}", device=self.device,
            )
            for name, start, shape in zip(self._volumes, volumes, [self.shapes[i] for i in self.read], strict=True)
        ]  # fmt: skip

    def starts(self, held: Mapping[str, float], doubted: Collection[str]) -> tuple[list[dict[str, float]], NeoHookeanDevice]:
        """Return starting values as `starts`; the pressures of photographs with these names do not count."""
        measured = [
            (shape.height, shape.pressure, shape.pressure_error * (IGNORED_ERROR_FACTOR if shape.source in doubted else 1.0))
            for shape in self.shapes
        ]
        heights, pressures, errors = np.array(measured).T
        return starts(self.model, plain_path(self.model, heights, pressures), pressures, errors, held)

    def bench_parameters(self) -> list[problem.Parameter]:
        """Return the parameters of the bench, by their own names, with their default priors."""
        shapes, width = self.shapes, self.model.silhouette.width
        reading = min(shape.pressure_error for shape in shapes)
        centre = float(np.median([shape.centre for shape in shapes]))
        scale = max(shape.scale_error for shape in shapes) or SCALE_ERROR
        level = max(ZERO_ERROR, *(shape.level_error for shape in shapes))
        return [
            problem.Parameter("pressure_offset", "Pa", 0.0, -self.most, self.most, problem.Prior(0.0, reading)),
            problem.Parameter("pressure_scale", "", 0.0, -0.5, 0.5, problem.Prior(0.0, PRESSURE_SCALE_ERROR)),
            problem.Parameter("leak", "", 0.0, -0.5, 0.5, problem.Prior(0.0, LEAK_ERROR)),
            problem.Parameter("scale", "", 0.0, -0.2, 0.2, problem.Prior(0.0, scale)),
            problem.Parameter("zero", "m", 0.0, -width, width, problem.Prior(0.0, level)),
            problem.Parameter("centre", "m", centre, centre - width, centre + width),
        ]

    @property
    def count(self) -> int:
        return len(self.groups)

    @property
    def considered(self) -> tuple[str, ...]:
        """Lengths whose errors are in the intervals."""
        return tuple(name for name in self.model.lengths if self.named(name) not in self.fixed)

    def named(self, name: str) -> str:
        """Return a parameter's name in the fit: the material's are common to all devices, the others its own."""
        return name if not self.device or name in self.model.common else f"{self.device}.{name}"

    def own(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return the fit's values by their names in this device."""
        return {name: values[self.named(name)] for name in self._own_names}

    @property
    def in_words(self) -> str:
        """The amount of measurements, in words."""
        top = max(shape.height for shape in self.shapes)
        values = f"{self.count - len(self.read)} independent values"
        return f"{len(self.shapes)} outlines to {top * 1e3:.4g} mm at {self.most / 1e3:.4g} kPa, {values}"

    def largest_state(self, values: Mapping[str, float]) -> State:
        """Return the state of the largest volume at parameter values."""
        return max((fitting.state for fitting in self.matches(values)), key=lambda state: state.V)

    def evaluate(self, values: Mapping[str, float], derivatives: bool) -> tuple[Array, Array | None, npt.NDArray[np.str_]]:
        """See `softmodels.fitting.problem.Residuals`."""
        matches = self.matches(values)
        residuals = np.concatenate([*(f.residuals for f in matches), [matches[i].reading for i in self.read]])
        if not np.isfinite(residuals).all():
            raise problem.CannotEvaluate("a residual is not finite")
        if not derivatives:
            return residuals, None, self.groups
        names = [name for name in self.model.names if self.named(name) not in self.fixed]
        columns = self._columns(values, names)
        return residuals, np.column_stack([columns[name] for name in self._own_names]), self.groups

    def form_slopes(self, values: Mapping[str, float], name: str) -> Array:
        """Return the derivatives of the residuals by a factor of `laws.FORM_ENERGIES`, shape (n,)."""
        return self._columns(values, [name])[name]

    def matches(self, values: Mapping[str, float]) -> list[MatchedPhotograph]:
        """Return each photograph with its state at parameter values."""
        key = tuple(float(values[name]) for name in self.parameters)
        if self._known is None or self._known[0] != key:
            own = self.own(values)
            states = self._states(own)
            self.model.set_parameters(own)
            made = [self._matched(shape, state, own) for shape, state in zip(self.shapes, states, strict=True)]
            self._known = key, made
        return self._known[1]

    def _matched(self, shape: Shape, state: State, own: Mapping[str, float]) -> MatchedPhotograph:
        return MatchedPhotograph(shape, state, self.model.curve(state), self.model.pressure(state), own, self.most)

    def _states(self, own: Mapping[str, float]) -> list[State]:
        """Return the state of each photograph at values by their names in this device."""
        return self.model.states(own, [own[name] for name in self._volumes])

    def _slopes(self, number: int, state: State, names: Sequence[str]) -> tuple[dict[str, float], dict[str, Array]]:
        """Return the derivatives of a photograph's pressure (Pa) and of its curve's nodes (m), by name; hidden ones too."""
        slopes, volume = self.model.slopes(state, names), self._own_hidden[number]
        return {**slopes.pressure, volume: slopes.along_pressure}, {**slopes.nodes, volume: slopes.along_nodes}

    def _columns(self, values: Mapping[str, float], names: Sequence[str]) -> Mapping[str, Array]:
        """Return the derivatives of the residuals, shape (n,), by named parameters of the device, those of the bench and the
        hidden ones; zeros by others."""
        matches = self.matches(values)
        self.model.set_parameters(self.own(values))
        columns: Mapping[str, Array] = collections.defaultdict(lambda: np.zeros(self.count))
        first = 0
        for place, fitting in enumerate(matches):
            rows = slice(first, first + len(fitting.shape.weight))
            pressures, nodes = self._slopes(place, fitting.state, names)
            for name, rate in nodes.items():
                columns[name][rows] = fitting.moved(rate)
            for name, (on_points, _) in fitting.bench().items():
                columns[name][rows] = on_points
            if place in self.read:
                reading = self.count - len(self.read) + self.read.index(place)
                for name, slope in pressures.items():
                    columns[name][reading] = slope / fitting.shape.pressure_error
                for name, (_, on_reading) in fitting.bench().items():
                    columns[name][reading] = on_reading
            first = rows.stop
        return columns


class MatchedPhotograph:
    """A photograph compared with a state: residuals of the outline, one per bin, model minus measured, and of the pressure."""

    def __init__(
        self, shape: Shape, state: State, curve: grid.QuadraticCurve, pressure: float, values: Mapping[str, float], most: float
    ):
        self.shape, self.state, self.curve, self.pressure = shape, state, curve, pressure
        self.values, self.most = values, most
        self.factor = 1.0 + values["scale"]
        self.true_pressure = (
            shape.pressure * (1.0 - values["pressure_scale"])
            - values["pressure_offset"]
            - values["leak"] * shape.pressure**2 / most
        )
        self.reading = (pressure - self.true_pressure) / shape.pressure_error
        self._compare()
        keep_arrays(self)

    def _compare(self) -> None:
        """Compare the outline with the curve."""
        shape, values = self.shape, self.values
        away = shape.points[:, 0] - values["centre"]
        self.side = np.where(away < 0.0, -1.0, 1.0)
        self.points = np.column_stack([np.abs(away), shape.points[:, 1] - values["zero"]]) / self.factor
        self.shadow = shadow_of(self.curve, shape.whole)
        self.closest = self.shadow.curve.closest(self.points)
        self.distances = -self.factor * self.closest.distance
        self.residuals = shape.mean(self.distances)

    def moved(self, rate: Array) -> Array:
        """Return the derivative of the outline's residuals as the curve's nodes move."""
        return self.shape.mean(-self.factor * self.closest.moved(self.shadow.rate(rate)))

    def bench(self) -> dict[str, tuple[Array | float, float]]:
        """Return the derivatives of the outline's residuals and of the reading's by the systematic errors of the bench."""
        error, reading = self.shape.pressure_error, self.shape.pressure
        return {
            "pressure_offset": (0.0, 1.0 / error),
            "pressure_scale": (0.0, reading / error),
            "leak": (0.0, reading**2 / self.most / error),
            **{name: (slope, 0.0) for name, slope in self._placed().items()},
        }

    def _placed(self) -> dict[str, Array]:
        """Return the derivatives of the outline's residuals by where and how large it is in the photograph."""
        normal = self.closest.normal
        along = (normal * self.points).sum(axis=1)
        return {
            "scale": self.shape.mean(along - self.closest.distance),
            "zero": self.shape.mean(normal[:, 1]),
            "centre": self.shape.mean(normal[:, 0] * self.side),
        }


def residuals_by_source(sources: Sequence[OutlineResiduals], residuals: Array) -> list[Array]:
    """Return the residuals of each source of a fit whose first sources they are."""
    return np.split(residuals, np.cumsum([source.count for source in sources]))[: len(sources)]


def misfits(source: OutlineResiduals, residuals: Array) -> dict[str, tuple[float, int]]:
    """Return the chi squared of each photograph's outline, and of the readings, with the number of residuals, the source's the
    first."""
    misfits = {}
    for name in dict.fromkeys(source.groups.tolist()):
        part = residuals[: source.count][source.groups == name]
        misfits[name] = (float((part**2).sum()), len(part))
    return misfits


def fits_badly(chi2: float, count: int) -> bool:
    """Return whether chi squared of this many residuals is beyond chance (one in a thousand, by Wilson & Hilferty 1931)."""
    k = max(count, 1)
    return chi2 > k * (1 - 2 / (9 * k) + 3.1 * math.sqrt(2 / (9 * k))) ** 3


# ----------------------------------------------------------------------------------------------------------------------
# Systematic errors of bench and device, as parameters with priors.


LEAK_ERROR = 0.02
"""Prior of the leak: relative loss at the largest pressure."""

SCALE_ERROR = 0.01
"""Prior of the unit of length (a printed grid's pitch, a magnification) if the outlines state no error of it."""

ZERO_ERROR = 20e-6
"""Prior of the zero plane's height in m, or the outlines' error of the level if larger."""

PRESSURE_SCALE_ERROR = photo_list.DENSITY_ERROR / units.WATER_DENSITY
"""Prior of the pressure scale: a column's density is common to all readings."""

LENGTH_ERROR = 0.02
"""Relative prior of a length of the device: by how much a cast part differs from its drawing, 0.12 mm in 6 mm."""

POISSON_BOUNDS = (0.3, 0.5)


def nuisances(source: OutlineResiduals, free: Sequence[str]) -> list[problem.Parameter]:
    """Return the parameters of bench and device with their default priors; the centre, which outlines show by themselves, has
    none. Those that are not free are fixed.

    Free may be ``pressure_offset``, ``pressure_scale``, ``leak``, ``scale``, ``zero``, ``centre``, ``poisson`` and the
    device's own variable lengths, such as ``membrane``, or `LENGTHS` for all of these; `OutlineFitError` for another name.
    """
    model = source.model
    known = (*source.bench, "poisson", *model.lengths)
    for name in free:
        if name not in (*known, problem.TILT, problem.LENGTHS):
            raise OutlineFitError(f"no bench or device parameter is called {name!r}; {known_are(name, known)}")
    if problem.LENGTHS in free:
        free = (*free, *model.lengths)
    made = [
        *source.bench_parameters(),
        problem.Parameter("poisson", "", model.choice.poisson, *POISSON_BOUNDS, answers=POISSON_BOUNDS[1:]),
        *length_parameters(model),
    ]
    return [
        dataclasses.replace(
            p, name=source.named(p.name), fixed=p.name not in free,
            device="" if source.named(p.name) == p.name else source.device,
        )
        for p in made
    ]  # fmt: skip


def length_parameters(model: DeviceModel) -> list[problem.Parameter]:
    """Return the lengths of a device that a fit may vary, with their default priors."""
    return [
        problem.Parameter(name, "m", value, 0.7 * value, 1.3 * value, problem.Prior(value, LENGTH_ERROR * value))
        for name, value in model.lengths.items()
    ]


def is_length(p: problem.Parameter) -> bool:
    """Return whether a parameter of a fit is a length of a device, one of `length_parameters`."""
    return p.unit == "m" and p.own_name not in problem.BENCH


def length_words(p: problem.Parameter) -> str:
    """Return the name of a free length with its prior."""
    if p.prior is None:
        return p.name
    return f"{p.name} (prior {p.prior.mean * 1e3:.4g} +- {p.prior.error * 1e3:.2g} mm)"


def all_nuisances(sources: Sequence[OutlineResiduals], free: Sequence[str]) -> list[problem.Parameter]:
    """Return the parameters of all devices of a fit; a free one is free for every device, or by its full name for one.
    Raises `OutlineFitError` for a name that no device has."""
    nuisance_by_name: dict[str, problem.Parameter] = {}
    known = [(*source.bench, "poisson", *source.model.lengths, problem.TILT, problem.LENGTHS) for source in sources]
    for name in free:
        if not any(name in (own, source.named(own)) for source, names in zip(sources, known, strict=True) for own in names):
            nuisances(sources[0], (name,))
    for source, names in zip(sources, known, strict=True):
        for p in nuisances(source, [name for name in names if {name, source.named(name)} & set(free)]):
            nuisance_by_name.setdefault(p.name, p)
    return list(nuisance_by_name.values())


def readings_of(pressures: Array, bench: Mapping[str, float]) -> Array:
    """Return the column's readings at true pressures, with the bench's offset, scale and leak; see above."""
    offset, scale, leak = (bench.get(name, 0.0) for name in ("pressure_offset", "pressure_scale", "leak"))
    most = (pressures.max() + offset) / (1 - scale - leak)
    if leak == 0.0:
        return (pressures + offset) / (1 - scale)
    a, b, c = leak / most, -(1 - scale), pressures + offset
    return (-b - np.sqrt(b * b - 4 * a * c)) / (2 * a)


# ----------------------------------------------------------------------------------------------------------------------
# Starting values of a fit to outlines: volumes from the heights, then the law's parameters from the pressures, without a
# search.
#
# The shape of a device at a given volume hardly depends on its stiffness: one path of the law at any modulus gives the added
# volume of each measured height. At given volumes the pressure is linear in a law's stress parameters, up to the
# small change of shape (virtual work), so they follow from the readings by linear least squares.
#
# Dead loads carry a share of the pressure that does not depend on the law's parameters, to first order: at a given volume the
# pressure is homogeneous in stresses and loads together (Euler). The preloaded state does depend on the stiffness, so its path
# is repeated with the modulus from the readings until that converges.


MODULUS_TOLERANCE = 0.03
"""Relative change of the modulus at convergence of a loaded device."""
MAX_MODULUS_ROUNDS = 12
MOST_BORNE = 0.7
"""Maximum pressure share of dead loads, relative to the silicone's, for a usable reading."""
MAX_MODULUS_FACTOR = 3.0


@dataclasses.dataclass(frozen=True, eq=False)
class NeoHookeanDevice:
    """A device of neo-Hookean material with the modulus from its readings, at the measured heights.

    Attributes:
        values: The law's numbers, from only a modulus.
        volumes: Added volumes in m3, shape (n,).
        hangs: Added volume in m3 at zero pressure; 0 without loads.
        states: The states there.
        borne, elastic: Pressures in Pa that the dead loads take, whatever the modulus, and the silicone, shape (n,).
    """

    values: dict[str, float]
    volumes: Array
    hangs: float
    states: list[State]
    borne: Array
    elastic: Array

    @property
    def silent(self) -> npt.NDArray[np.bool_]:
        """Whether dead loads carry so much of the pressure that a reading is unusable, shape (n,)."""
        return np.abs(self.borne) > MOST_BORNE * self.elastic


def plain_path(
    model: DeviceModel,
    heights: Array,
    pressures: Array,
    volumes: Callable[[DeviceModel, dict[str, float], Array], tuple[Array, float]] | None = None,
) -> NeoHookeanDevice:
    """Follow the device to the measured heights in m, or to other sizes of which ``volumes`` gives the added volumes as
    `volumes_of` does; by the readings in Pa the modulus of a loaded device settles. Raises `OutlineFitError` where it cannot
    reach them, no stiffness fits its loads, or its shadow at rest is not straight, see `UnpressurisedShape.check`."""
    why = ""
    for _ in range(MAX_MODULUS_ROUNDS):
        try:
            values = model.choice.from_modulus(model.modulus)
            device_path = plain_device(model, values, *(volumes or volumes_of)(model, values, heights))
        except problem.CannotEvaluate as error:
            if not model.loaded:
                raise
            model.modulus, why = 2.0 * model.modulus, str(error)
            continue
        if not model.loaded:
            return device_path
        told = ~device_path.silent if not device_path.silent.all() else device_path.elastic == device_path.elastic.max()
        # A median, so that one wrong reading does not change the shapes.
        factor = float(np.median((pressures[told] - device_path.borne[told]) / device_path.elastic[told]))
        if not abs(factor - 1.0) > MODULUS_TOLERANCE:
            return device_path
        model.modulus *= min(max(factor, 1 / MAX_MODULUS_FACTOR), MAX_MODULUS_FACTOR)
        why = f"the modulus does not converge near {model.modulus / 1e3:.4g} kPa"
    raise OutlineFitError(
        f"no stiffness fits the case's loads and the measured pressures ({why}); check masses, density and forces, "
        f"and the direction of gravity"
    )


def plain_device(model: DeviceModel, values: dict[str, float], volumes: Array, hangs: float) -> NeoHookeanDevice:
    """Return the device of a law's numbers at added volumes in m3, and at the one where it hangs without pressure."""
    states = model.states(values, volumes)
    model.set_parameters(values)
    whole = np.array([model.pressure(state) for state in states])
    elastic = whole
    if model.loaded:
        names = [name for name in model.choice.names if model.choice.unit(name) == "Pa"]
        slopes = [model.slopes(state, names).pressure for state in states]
        elastic = np.array([sum(values[name] * slope[name] for name in names) for slope in slopes])
    return NeoHookeanDevice(values, volumes, hangs, states, whole - elastic, elastic)


def starts(
    model: DeviceModel,
    states_of_path: NeoHookeanDevice,
    pressures: Array,
    errors: Array,
    held: Mapping[str, float] = MappingProxyType({}),
) -> tuple[list[dict[str, float]], NeoHookeanDevice]:
    """Return the starting values of the law, best first, without the numbers that are held, and the path that they come from:
    readings and their standard errors in Pa, or anything in proportion to these."""
    plain = states_of_path.values
    target, simulated = (pressures - states_of_path.borne) / errors, states_of_path.elastic / errors
    factor = max(float(simulated @ target / (simulated @ simulated)), 1e-6)
    scaled = {name: value * factor if model.choice.unit(name) == "Pa" else value for name, value in plain.items()}
    scaled |= held
    names, free = model.choice.names, [name for name in model.choice.names if name not in held]
    if not (model.choice.law.linear and free) or len(pressures) < len(plain):
        return [scaled], states_of_path
    A = np.array([[model.slopes(state, names).pressure[name] for name in names] for state in states_of_path.states])
    A /= errors[:, None]
    given = A @ [held.get(name, 0.0) for name in names]
    A = A[:, [name not in held for name in names]]
    size = np.linalg.norm(A, axis=0)
    solution, *_ = np.linalg.lstsq(A / size, target - given, rcond=1e-6)
    linear = {**held, **dict(zip(free, (solution / size).tolist(), strict=True))}
    first = names[0]
    if linear[first] <= 0.1 * scaled[first]:
        return [scaled], states_of_path
    return [linear, scaled], states_of_path


def volumes_of(
    model: DeviceModel, values: dict[str, float], heights: Array, radius: Callable[[State], float] | None = None
) -> tuple[Array, float]:
    """Return the added volumes in m3 at which the device has the measured heights in m, or radii where ``radius`` is that of a
    state, and that of the preloaded state. Raises `CannotEvaluate` for no equilibrium under the dead loads, `OutlineFitError`
    if it does not rise so high."""
    eq, rest = model.system, model.rest_volume
    model.set_parameters(values)
    model.hanging.check(values)
    goals = rest * np.concatenate([np.linspace(0.05, 1.0, 12), np.geomspace(1.2, 0.95 * continuation.MAX_GROWTH, 30)])
    rises, volumes = list[float](), list[float]()
    highest = float(heights.max())
    path, why = model.path("volume"), ""
    try:
        for point in continuation.trace(path, (model.begins(path) + goals).tolist()):
            rise = radius(point.state) if radius else model.height(point.state)
            if not rises or rise > rises[-1]:
                rises.append(rise)
                volumes.append((point.state.V - rest) * eq.volume_unit)
            if rise > 1.02 * highest:
                break
    except (stability.PathEnd, newton.NoConvergence, problem.CannotEvaluate) as end:
        why = f" ({end})"
    if not rises or rises[-1] < highest:
        if radius:
            raise OutlineFitError(
                f"the case's device does not widen beyond a radius of {max(rises, default=0.0) * 1e3:.4g} mm{why}, but "
                f"{highest * 1e3:.4g} mm was measured: check the geometry and the unit"
            )
        raise OutlineFitError(
            f"the case's device does not rise above {max(rises, default=0.0) * 1e3:.4g} mm{why}, but an outline is "
            f"{highest * 1e3:.4g} mm high: check the geometry and the photographs' scale"
        )
    volumes_at_heights = np.asarray(PchipInterpolator(rises, volumes)(np.maximum(heights, 0.0)))
    if not math.isfinite(volumes_at_heights.sum()) or volumes_at_heights.min() <= volumes[0]:
        raise OutlineFitError("an outline has no height, so its volume is undetermined")
    return volumes_at_heights, volumes[0]


# ----------------------------------------------------------------------------------------------------------------------
# Fit of heights, the thesis' objective: mean square deviation of the largest deflections at the measured pressures.
#
# Heights are compared with states at the raw readings, all with the same weight. States past a limit point are
# not possible, and systematic errors of the bench (a leak, an offset, a scale, the zero plane) and of the device's lengths can
# be neither detected nor corrected: they do not show in the scatter. Their priors are propagated into the error bars to first
# order (considered parameters: Schmidt 1966; Tapley, Schutz & Born 2004, Statistical Orbit Determination, chapter 6).
# The fit to whole outlines has both.


class HeightResiduals:
    """Residuals in mm of heights, checked; see `softmodels.fitting.problem.Residuals`.

    Attributes:
        considered: Lengths whose errors are in the intervals.
    """

    unit, errors, device = "mm", 1.0, ""

    def __init__(self, model: DeviceModel, heights: Sequence[Height], label: str = "heights"):
        self.model, self.heights, self.label = model, tuple(heights), label
        self.parameters = model.names
        self.fixed: frozenset[str] = frozenset()
        self.considered: tuple[str, ...] = ()
        self.pressures = np.array([height.pressure for height in heights])
        self.measured = np.array([height.height for height in heights])
        self.height_errors = np.array([height.height_error for height in heights])

    @property
    def in_words(self) -> str:
        """The amount of measurements, in words."""
        top = float(self.measured.max())
        return f"{len(self.heights)} heights to {top * 1e3:.4g} mm at {self.pressures[-1] / 1e3:.4g} kPa"

    def own(self, values: Mapping[str, float]) -> Mapping[str, float]:
        """Return the fit's values by their names in this device, which are the same."""
        return values

    def path(self) -> NeoHookeanDevice:
        """Return the device of one modulus at the measured heights."""
        return plain_path(self.model, self.measured, self.pressures)

    def largest_state(self, values: Mapping[str, float]) -> State:
        """Return the state of the largest pressure at parameter values."""
        return self.model.states(values, self.pressures, "pressure")[-1]

    def evaluate(self, values: Mapping[str, float], derivatives: bool) -> tuple[Array, Array | None, list[str]]:
        """See `softmodels.fitting.problem.Residuals`."""
        states = self.model.states(values, self.pressures, "pressure")
        self.model.set_parameters(values)
        tops = np.array([self.model.curve(state).nodes[0, 0, 1] for state in states])
        residuals = 1e3 * (tops - self.measured)
        labels = [self.label] * len(residuals)
        if not derivatives:
            return residuals, None, labels
        J = np.zeros((len(states), len(self.parameters)))
        free = [name not in self.fixed for name in self.parameters]
        J[:, free] = self._slopes(states, [name for name in self.parameters if name not in self.fixed])
        return residuals, J, labels

    def _slopes(self, states: Sequence[State], names: Sequence[str]) -> Array:
        """Return the derivatives of the heights in mm by parameters of the device at fixed pressures, shape (n, m)."""
        slopes = [self.model.slopes(state, names, "pressure").nodes for state in states]
        return np.array([[1e3 * nodes[name][0, 0, 1] for name in names] for nodes in slopes])

    def form_slopes(self, values: Mapping[str, float], name: str) -> Array:
        """Return the derivatives of the residuals by a factor of `laws.FORM_ENERGIES`, shape (n,)."""
        states = self.model.states(values, self.pressures, "pressure")
        self.model.set_parameters(values)
        return self._slopes(states, [name])[:, 0]

    def shared(self, values: Mapping[str, float], lengths: Mapping[str, problem.Prior]) -> Array:
        """Return the change of the residuals by one standard error of each systematic bench error and of lengths, shape (n, 5 +
        their number)."""
        states = self.model.states(values, self.pressures, "pressure")
        self.model.set_parameters(values)
        slopes = [self.model.slopes(state, [*lengths], "pressure") for state in states]
        rise = 1e3 * np.array([slope.along_nodes[0, 0, 1] for slope in slopes])  # mm per Pa
        columns = (
            -rise * min(height.pressure_error for height in self.heights),
            -rise * self.pressures * PRESSURE_SCALE_ERROR,
            -rise * self.pressures**2 / self.pressures.max() * LEAK_ERROR,
            1e3 * self.measured * SCALE_ERROR,
            np.full(len(rise), 1e3 * ZERO_ERROR),
            *(
                1e3 * prior.error * np.array([slope.nodes[name][0, 0, 1] for slope in slopes])
                for name, prior in lengths.items()
            ),
        )
        return np.column_stack(columns)


START_FACTORS = (1.0, 1.1, 1.3, 2.0)
"""Factors on the starting stresses, tried until every pressure has a state."""


@dataclasses.dataclass(frozen=True)
class Height:
    """A measured height of the top: source, pressure in Pa, height in m, and their standard errors."""

    source: str
    pressure: float
    height: float
    pressure_error: float = 10.0
    height_error: float = 1e-5


def read_heights(path: Path, untrusted: bool = False, exclude: Sequence[str] = ()) -> list[Height]:
    """Read the ``heights.csv`` that ``softmodels measure photos`` writes; rejected and excluded photographs are left out.

    Raises `OutlineFitError` for no such table, a number that is none, or a height that is not trusted, unless ``untrusted``.
    """
    needed = {"pressure_Pa", "height_m"}
    try:
        chosen = tables.pick(
            path, tables.read_sheets(path), lambda sheet: sheet.rows if needed <= _header(sheet.rows) else None
        )
    except OSError as error:
        raise OutlineFitError(f"{path} cannot be read: {reason(error)}") from None
    if chosen is None or len(chosen[1]) < 2:
        raise OutlineFitError(f"{path} is not a table of heights; it needs the columns pressure_Pa and height_m")
    sheet, rows = chosen[0], tables.records(chosen[1])
    heights = []
    keep = set(kept([(row.get("file") or sheet.place(number), None) for number, row in rows], exclude))
    for place, (line, row) in enumerate(rows):
        if place not in keep:
            continue
        where = sheet.place(line)
        trusted = (row.get("trusted") or "yes").strip()
        if trusted == "refused":
            continue
        if trusted not in ("yes", "anyway") and not untrusted:
            raise OutlineFitError(
                f"{path}, {where}: this height is untrusted ({row.get('remarks') or 'no reason given'}); "
                f"exclude it, or use it with --untrusted"
            )
        try:
            pressure, height = units.number(row["pressure_Pa"]), units.number(row["height_m"])
            errors = [units.number(row[key]) if row.get(key) else 0.0 for key in ("pressure_error_Pa", "height_error_m")]
        except units.UnitError as error:
            raise OutlineFitError(f"{path}, {where}: pressure or height is not a number ({error})") from None
        known = {name: value for name, value in zip(("pressure_error", "height_error"), errors, strict=True) if value > 0.0}
        heights.append(Height(row.get("file") or where, pressure, height, **known))
    return sorted(heights, key=lambda height_row: height_row.pressure)


def _header(rows: Sequence[tables.Line]) -> set[str]:
    return {name.strip() for name in rows[0][1]} if rows else set()


def check_heights(heights: Sequence[Height], width: float) -> list[Height]:
    """Return the usable heights, without those at rest; `OutlineFitError` if none is left, two have one pressure, or the
    unit is mistaken."""
    for earlier in heights:
        if earlier.pressure < 0.0 and earlier.height > MIN_HEIGHT:
            raise OutlineFitError(
                f"{earlier.source} rises {earlier.height * 1e3:.4g} mm at a negative pressure, {earlier.pressure:.5g} Pa: is "
                f"its sign wrong, or are its tubes exchanged? Correct it, or exclude it: --exclude {earlier.source}"
            )
    risen = [height for height in heights if height.pressure > 0.0 and height.height > 0.0]
    if not risen:
        raise OutlineFitError("no height is above zero at a pressure above zero; give at least one")
    highest = max(earlier.height for earlier in risen)
    if highest > MAX_OUTLINE_HEIGHT * width or highest < 1e-4 * width:
        raise OutlineFitError(
            f"the largest height is {highest * 1e3:.4g} mm, for a device {width * 2e3:.4g} mm across: check the unit "
            "(heights are in metres)"
        )
    for earlier, two in itertools.pairwise(risen):
        if two.pressure - earlier.pressure <= 1e-6 * two.pressure:
            raise OutlineFitError(
                f"{earlier.source} and {two.source} have the same pressure, {two.pressure:.5g} Pa; give only one"
            )
    return risen


def least_squares_of_heights(
    source: HeightResiduals, *, changes: problem.Changes = MappingProxyType({}), loss: str = "linear"
) -> least_squares.LeastSquaresFit:
    """Fit a law to heights; the size of their errors follows from their scatter, and the bench's own errors are considered.
    Errors as of `softmodels.fitting.least_squares.fit_parameters`; `OutlineFitError` where the device does not rise so high."""
    model = source.model
    choice = model.choice
    path = source.path()
    begins, _ = starts(model, path, source.pressures, np.ones(len(source.measured)))
    lengths = [p.changed(changes.get(p.name, {})) for p in length_parameters(model)]
    considered = {p.name: p.prior for p in lengths if p.prior and not p.fixed}
    source.considered = tuple(considered)
    known = [problem.Parameter("poisson", "", choice.poisson, fixed=True)]
    known += [problem.Parameter(p.name, "m", p.start, fixed=True) for p in lengths]
    troubles = []
    for begin, factor in ((begin, factor) for begin in begins for factor in START_FACTORS):
        stiffer = {name: value * (factor if choice.unit(name) == "Pa" else 1.0) for name, value in begin.items()}
        parameters = [p.changed(changes.get(p.name, {})) for p in (*choice.parameters(stiffer), *known)]
        source.fixed = frozenset(p.name for p in parameters if p.fixed)
        try:
            height_fit = least_squares.fit_parameters([source], parameters, loss=loss, errors="unknown", label=choice.name)
            return dataclasses.replace(height_fit, shared=source.shared(height_fit.values, considered))
        except (FitError, problem.CannotEvaluate) as error:
            troubles.append(str(error))
    raise FitError(f"{choice.name}: {troubles[0]}")
