"""Tables of a device's pressure over its volume, radius or rise: read, and as residuals of a fit.

Each pressure is compared at its measured size, with the volume as control, so that readings past a limit point count as well.
A radius or a rise is reached by Newton's method on the volume; derivatives at a fixed size s follow from those at a fixed
volume V as dP/dp - dP/dV (ds/dp) / (ds/dV).
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeGuard

import numpy as np

from softmodels.common import columns as machine
from softmodels.common.arrays import Array
from softmodels.common.columns import TensileError, in_si
from softmodels.common.names import keep_arrays
from softmodels.fitting import least_squares, problem
from softmodels.fitting.outlines import residuals, shapes
from softmodels.fitting.outlines.device import DeviceModel, ModelSlopes
from softmodels.fitting.outlines.shapes import OutlineFitError
from softmodels.mechanics.system import State
from softmodels.path import continuation
from softmodels.runs import grid


@dataclasses.dataclass(frozen=True, eq=False)
class Inflation:
    """Pressures in Pa, shape (n,), of a device at sizes, shape (n,): by ``kind`` ``volume`` or ``added-volume`` in m3,
    ``radius`` (the largest outside) or ``rise`` (of the apex) in m, in the order of the test; ``source`` says where they were
    read."""

    name: str
    kind: str
    size: Array
    pressure: Array
    source: str = ""

    def __post_init__(self) -> None:
        keep_arrays(self)


@dataclasses.dataclass(frozen=True, eq=False)
class MatchedInflation:
    """An inflation that was fitted: what its sizes (n,) are, with their unit, in which they are here; pressures in Pa, shape
    (n,), measured and by law."""

    name: str
    axis: str
    size: Array
    pressure: Array
    fitted: Mapping[str, Array]


MARKS = (b"x_m,z_m", b"x_m;z_m", b"pressure_Pa =", b"parallax_x", b"tip_x_m")
"""What files of outlines, side views and markers have in their headers."""
MIN_READINGS = 3
UNLOADED_SHARE = 0.02
"""How far a size may fall below the largest so far, as a share of the whole change, before the reading is an unloading one."""
DEFLATION = re.compile(
    r"vacu|under.?pressure|negative|suction|suck|withdr|remov|extract|deflat|unterdruck|d[eé]pression|sous.pression|aspir|真空|负压",
    re.IGNORECASE,
)
"""What says in a header that positive numbers are of air drawn out of the device."""
ABSOLUTE_PRESSURE = 80e3
"""Pressure in Pa above which all readings suggest that the room's is in them."""


def is_table(file: object) -> TypeGuard[Inflation | Path | str]:
    """Return whether a file is a table that the user has made; not a folder, nor what ``measure`` writes of photographs."""
    if not isinstance(file, Path | str):
        return isinstance(file, Inflation)
    try:
        with Path(file).open("rb") as lines:
            head = lines.read(20_000)
    except OSError:
        return False
    return not any(mark in head for mark in MARKS)


def read(path: Path, columns: str = "", exclude: Sequence[str] = ()) -> Inflation:
    """Read a table; ``columns`` is such as ``"volume=1[ml],pressure=2[kPa]"``, empty to go by the headers, and ``exclude`` has
    readings such as ``"line 7"``. `OutlineFitError` for one that cannot be used."""
    if b"trusted" in path.read_bytes()[:2000]:
        raise OutlineFitError(f"{path} has heights of photographs; fit them with --heights {path}")
    try:
        told = machine.columns_of_text(columns, machine.INFLATION) if columns else {}
        several = machine.read_tables(path, told, machine.INFLATION)
        if len(several) > 1:
            names = ", ".join(part.label for part in several)
            raise TensileError(f"it has {len(several)} tests ({names}); give one of them, in a file of its own")
        table = several[0]
        for column in (table.deformation, table.load):
            if DEFLATION.search(column.header):
                raise TensileError(
                    f"the column {column.header!r} says that air is drawn out; the table of an inflation has volumes added to "
                    "the device and pressures above the room's, and a test under vacuum cannot be fitted"
                )
        size, pressure = in_si(table.x, table.deformation), in_si(table.y, table.load)
    except TensileError as error:
        raise OutlineFitError(f"{path}: {error}") from None
    keep = shapes.kept([(f"line {line}", None) for line in table.lines], exclude)
    size, pressure = size[keep], pressure[keep]
    kind = table.deformation.kind
    if kind == "diameter":
        kind, size = "radius", 0.5 * size
    if pressure.min() > ABSOLUTE_PRESSURE and pressure.max() < 2.0 * pressure.min():
        raise OutlineFitError(
            f"{path}: all pressures are between {pressure.min() / 1e3:.4g} and {pressure.max() / 1e3:.4g} kPa, as if the "
            "room's were in them; give those above the room's"
        )
    return Inflation(path.name, kind, size, pressure, f"{table.deformation.sentence}, {table.load.sentence}")


# ----------------------------------------------------------------------------------------------------------------------
# The size of a simulated device.


RISE, RADIUS, ADDED = "rise", "radius", "added-volume"


@dataclasses.dataclass(frozen=True)
class Size:
    """What is measured of a model: ``kind`` is one of `RISE`, `RADIUS` and `ADDED`."""

    model: DeviceModel
    kind: str

    def at(self, state: State) -> tuple[float, int, Array]:
        """Return a length of a state in m, and where it is seen: the piece of the outer curve, and the weights (3,) of its
        nodes."""
        curve = self.model.curve(state)
        if self.kind == RISE:
            return float(curve.nodes[0, 0, 1]), 0, np.array([1.0, 0.0, 0.0])
        # The widest place is the highest one of the curve on its side; it moves along it without a first-order change.
        piece, s = shapes.crest(grid.QuadraticCurve(curve.nodes[:, :, ::-1]))
        weights = grid.shapes(s)
        return float(weights @ curve.nodes[piece, :, 0]), piece, weights

    def rate(self, place: tuple[float, int, Array], nodes: Array) -> float:
        """Return the derivative of the length from that of the curve's nodes, shape (n, 3, 2)."""
        _, piece, weights = place
        return float(weights @ nodes[piece, :, 1 if self.kind == RISE else 0])

    def text(self, size: float) -> str:
        return f"{size * 1e6:.4g} ml" if self.kind == ADDED else f"{size * 1e3:.4g} mm"


# ----------------------------------------------------------------------------------------------------------------------
# Residuals of pressures, at sizes that count as exact. Their errors follow from the scatter; those of the bench are considered,
# as of heights.


MAX_GROUPS = 40
"""Readings beyond so many are averaged in groups."""
LEAST_SHARE = 1e-3
"""Change of a size, as a share of the largest, below which a reading shows the device at rest."""
PRESSURE_ERROR = 10.0
"""Prior of an offset of all pressures in Pa."""
VOLUME_SCALE_ERROR = 0.02
"""Prior of the scale of volumes: half of the tolerance of a syringe, 4 % of the volume (ISO 7886-1)."""
USUAL_ERROR = 0.02
"""Usual standard error of a pressure, as a share of the largest one."""
CLOSE_VOLUME = 1e-4
"""Relative correction of a volume from which on the pressure is corrected to first order."""
MAX_ROUNDS = 12


class InflationResiduals(residuals.HeightResiduals):
    """Residuals of pressures, in shares of `USUAL_ERROR`; see `softmodels.fitting.problem.Residuals`. `OutlineFitError` for a
    table that the device cannot have.

    Attributes:
        notes: Sentences on what was understood and left out.
    """

    unit = "Pa"

    def __init__(self, model: DeviceModel, inflation: Inflation):
        self.model, self.label = model, inflation.name
        self.parameters = model.names
        self.fixed: frozenset[str] = frozenset()
        self.considered: tuple[str, ...] = ()
        self.notes = [f"{inflation.name}: {inflation.source}"] if inflation.source else []
        model.set_parameters(model.choice.from_modulus(model.modulus))
        kind, size, rest = inflation.kind, inflation.size, 0.0
        if kind == "volume":
            kind, size = ADDED, self._added(size)
        self.size_of = Size(model, kind)
        if kind == RADIUS:
            rest = self.size_of.at(model.system.rest())[0]
        self.measured, self.pressures = self._chosen(size, inflation.pressure, rest)
        self.errors = USUAL_ERROR * float(np.abs(self.pressures).max())
        self.usual_errors = self.errors
        self._volumes: Array | None = None
        self._known: tuple[dict[str, float], list[State], Array, Array] | None = None

    def _added(self, volume: Array) -> Array:
        """Return added volumes: a column called volume may have the cavity's own in it."""
        cavity = self.model.rest_volume * self.model.system.volume_unit
        whole = float(volume.min()) > 0.95 * cavity
        taken = "that of the whole cavity" if whole else "what was added"
        self.notes.append(
            f"{self.label}: the volume is taken as {taken}, since the undeformed cavity has {cavity * 1e6:.4g} ml; call the "
            "column added volume if it counts from there"
        )
        return volume - cavity if whole else volume

    def _chosen(self, size: Array, pressure: Array, rest: float) -> tuple[Array, Array]:
        """Return sizes and pressures of the first loading, beyond the size at rest, by rising size."""
        highest = np.maximum.accumulate(size)
        loading = size >= highest - UNLOADED_SHARE * (highest[-1] - rest)
        moved = size - rest > LEAST_SHARE * (highest[-1] - rest)
        if unloading := int((moved & ~loading).sum()):
            self.notes.append(f"{self.label}: {unloading} readings below an earlier size are left out, as unloading")
        size, pressure = size[loading & moved], pressure[loading & moved]
        text = self.size_of.text
        if len(size) < MIN_READINGS:
            raise OutlineFitError(
                f"{self.label} has {len(size)} readings at which the device is larger than at rest, {text(rest)}; give at "
                f"least {MIN_READINGS}, and check the unit"
            )
        cavity = self.model.rest_volume * self.model.system.volume_unit
        if self.size_of.kind == ADDED and size.max() > continuation.MAX_GROWTH * cavity:
            raise OutlineFitError(
                f"{self.label}: {text(size.max())} are more than {continuation.MAX_GROWTH:g} times the undeformed cavity, "
                f"{text(cavity)}; check the unit, and the geometry of the case"
            )
        if pressure.max() <= 0.0:
            raise OutlineFitError(f"{self.label}: no pressure is above zero; is its sign wrong, or are its tubes exchanged?")
        order = np.argsort(size, kind="stable")
        size, pressure = size[order], pressure[order]
        if len(size) <= MAX_GROUPS:
            return size, pressure
        self.notes.append(f"{self.label}: {len(size)} readings are averaged in {MAX_GROUPS} groups along the curve")
        return _grouped(size, pressure)

    @property
    def in_words(self) -> str:
        """The amount of measurements, in words."""
        kind = {ADDED: "added volumes", RADIUS: "radii", RISE: "rises"}[self.size_of.kind]
        most = self.size_of.text(float(self.measured[-1]))
        return f"{len(self.measured)} pressures to {self.pressures.max() / 1e3:.4g} kPa, at {kind} to {most}"

    def matched(self, fitted: Mapping[str, least_squares.LeastSquaresFit]) -> MatchedInflation:
        """Return the table with the pressures of fits, by law."""
        is_volume = self.size_of.kind == ADDED
        pressures = {law: self.pressures + self.errors * fit.residuals[: fit.count] for law, fit in fitted.items()}
        axis = "added volume (ml)" if is_volume else f"{self.size_of.kind} (mm)"
        return MatchedInflation(self.label, axis, (1e6 if is_volume else 1e3) * self.measured, self.pressures, pressures)

    def path(self) -> residuals.NeoHookeanDevice:
        """Return the device of one modulus at the measured sizes."""
        path = residuals.plain_path(self.model, self.measured, self.pressures, self._first_volumes)
        self._volumes = path.volumes
        return path

    def _first_volumes(self, model: DeviceModel, values: dict[str, float], sizes: Array) -> tuple[Array, float]:
        if self.size_of.kind == ADDED:
            return sizes, 0.0
        return residuals.volumes_of(model, values, sizes, None if self.size_of.kind == RISE else self._radius)

    def _radius(self, state: State) -> float:
        return self.size_of.at(state)[0]

    def largest_state(self, values: Mapping[str, float]) -> State:
        """Return the state of the largest size at parameter values."""
        return self._solved(values)[0][-1]

    def _solved(self, values: Mapping[str, float]) -> tuple[list[State], Array, Array]:
        """Return the states at the measured sizes, their pressures in Pa, shape (n,), and the derivatives of these by the
        parameters at fixed sizes, (n, m)."""
        own = {name: values[name] for name in self.parameters if name in values}
        if self._known is not None and self._known[0] == own:
            return self._known[1:]
        names = [name for name in self.parameters if name not in self.fixed]
        is_volume = self.size_of.kind == ADDED
        volumes = self.measured if is_volume or self._volumes is None else self._volumes
        if not is_volume and self._volumes is None:
            volumes = self._first_volumes(self.model, dict(own), self.measured)[0]
        for _ in range(MAX_ROUNDS):
            states = self.model.states(values, volumes)
            self.model.set_parameters(values)
            pressures = np.array([self.model.pressure(state) for state in states])
            slopes = [self.model.slopes(state, names) for state in states]
            places = [] if is_volume else [self.size_of.at(state) for state in states]
            J = np.zeros((len(states), len(self.parameters)))
            J[:, [self.parameters.index(name) for name in names]] = self._at_sizes(places, slopes, names)
            if is_volume:
                break
            by_volume = np.array([slope.along_pressure for slope in slopes])
            along = np.array([self.size_of.rate(place, s.along_nodes) for place, s in zip(places, slopes, strict=True)])
            step = (self.measured - np.array([place[0] for place in places])) / along
            if np.abs(step / volumes).max() < CLOSE_VOLUME:
                pressures = pressures + by_volume * step
                break
            volumes = np.clip(volumes + step, 0.5 * volumes, 2.0 * volumes)
        else:
            raise problem.CannotEvaluate(f"the device does not reach a measured {self.size_of.kind}")
        self._volumes = volumes
        self._known = own, states, pressures, J
        return states, pressures, J

    def _at_sizes(
        self, places: Sequence[tuple[float, int, Array]], slopes: Sequence[ModelSlopes], names: Sequence[str]
    ) -> Array:
        """Return the derivatives of the pressures in Pa by parameters of the device at fixed sizes, shape (n, m); places as of
        `Size.at`, none for volumes."""
        by = np.array([[slope.pressure[name] for name in names] for slope in slopes])
        for row, place, slope in zip(by, places, slopes, strict=False):
            moved = np.array([self.size_of.rate(place, slope.nodes[name]) for name in names])
            row -= slope.along_pressure * moved / self.size_of.rate(place, slope.along_nodes)
        return by

    def form_slopes(self, values: Mapping[str, float], name: str) -> Array:
        """Return the derivatives of the residuals by a factor of `laws.FORM_ENERGIES`, shape (n,)."""
        states = self._solved(values)[0]
        self.model.set_parameters(values)
        slopes = [self.model.slopes(state, [name]) for state in states]
        places = [] if self.size_of.kind == ADDED else [self.size_of.at(state) for state in states]
        return self._at_sizes(places, slopes, [name])[:, 0] / self.errors

    def evaluate(self, values: Mapping[str, float], derivatives: bool) -> tuple[Array, Array | None, list[str]]:
        """See `softmodels.fitting.problem.Residuals`."""
        _, pressures, J = self._solved(values)
        return (pressures - self.pressures) / self.errors, J / self.errors if derivatives else None, [self.label] * len(J)

    def shared(self, values: Mapping[str, float], lengths: Mapping[str, problem.Prior]) -> Array:
        """Return the change of the residuals by one standard error of each systematic error; see `HeightResiduals`."""
        _, _, J = self._solved(values)
        sizes, read = self.measured, self.pressures
        by_size = np.gradient(read, sizes) if len(sizes) > 2 else np.zeros(len(sizes))
        scale = VOLUME_SCALE_ERROR if self.size_of.kind == ADDED else residuals.SCALE_ERROR
        level = residuals.ZERO_ERROR if self.size_of.kind == RISE else 0.0
        columns = (
            np.full(len(read), PRESSURE_ERROR),
            read * residuals.PRESSURE_SCALE_ERROR,
            read**2 / read.max() * residuals.LEAK_ERROR,
            -by_size * sizes * scale,
            -by_size * level,
            *(prior.error * J[:, self.parameters.index(name)] for name, prior in lengths.items()),
        )
        return np.column_stack(columns) / self.errors


def _grouped(size: Array, pressure: Array) -> tuple[Array, Array]:
    """Return the means of neighbours, in groups of equal length along the curve, so that a steep beginning keeps its shape."""
    rough = [np.array([part.mean() for part in np.array_split(values, 2 * MAX_GROUPS)]) for values in (size, pressure)]
    steps = [np.abs(np.diff(values)) / np.ptp(values) for values in rough]
    way = np.r_[0.0, np.cumsum(np.add(*steps))]
    group = np.minimum((np.interp(size, rough[0], way) / way[-1] * MAX_GROUPS).astype(int), MAX_GROUPS - 1)
    _, group, count = np.unique(group, return_inverse=True, return_counts=True)
    return np.bincount(group, size) / count, np.bincount(group, pressure) / count
