"""Quantities that are distances from a target: an outline, the path of a tip, or the pose of a face."""

from __future__ import annotations

import abc
import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from geometries import actuator
from softmodels.common import errors, tables, units
from softmodels.common.arrays import Array
from softmodels.common.lazy import fem, la
from softmodels.design import quantities, trials
from softmodels.fitting.outlines import shapes
from softmodels.mechanics import body, mpi

if TYPE_CHECKING:
    from softmodels.mechanics.system import State
    from softmodels.runs import grid


# ----------------------------------------------------------------------------------------------------------------------
# Distance of a device's outline from a target outline, measured or drawn.
#
# The outline of a device whose mesh follows its design.


class MovedSilhouette(shapes.Silhouette):
    """The outer curve of a device under design, with the transpose of its derivative. It is ``round`` where the device is a
    body of revolution, of which both sides are seen alike. BodyError if the mesh has no such curve."""

    def __init__(self, design: quantities.DesignedBody):
        super().__init__(design.system)
        self.design, actuator = design, design.system.body.actuator
        self.round = actuator.dimension == 2 or len(actuator.cut_planes) > 1
        axes = np.array([self._along, actuator.lift])
        self._axes = axes if actuator.dimension == 3 else axes[:, [0, 2]]
        """From the mesh's components to those of the outline's plane, shape (2, d)."""

    def transposed(self, covector: Array) -> tuple[Array, Array]:
        """Return the transpose of `moved`: from a covector on the curve's nodes, shape (n, 3, 2), the same on all ranks, to
        the owned unknowns, zero at held ones, and to the mesh's nodes, flat over `MeshMotion.space`."""
        system, motion = self.system, self.design.motion
        on_places = covector.copy()
        on_places[0, 0] -= covector.sum(axis=(0, 1))  # heights and distances count from the undeformed top
        axes = system.length_unit * self._axes
        by_w = _summed_at_dofs(system.space, self._dofs, self._of_edges(covector) @ axes @ system.body.skew_inverse)
        at_nodes = np.einsum("sk,msd->mkd", self._mix, self._of_edges(on_places) @ axes)
        components = motion.dimension * self._blocks[..., None] + np.arange(motion.dimension)
        return system.by_unknowns(by_w[: system.n]).copy(), _summed_at_dofs(motion.space, components, at_nodes)

    def _of_edges(self, values: Array) -> Array:
        """Return the transpose of gathering and arranging: values on the chain to this rank's edges, (m, 3, 2)."""
        back = values.copy()
        back[self._turned] = back[self._turned][:, [1, 0, 2]]
        comm, count = self.system.comm, len(self._dofs)
        forces = np.zeros((len(mpi.everywhere(comm, np.zeros(count))), 3, 2))
        forces[self._order] = back
        return mpi.scattered(comm, forces if mpi.is_root(comm) else None, count)


def _summed_at_dofs(space: object, dofs: npt.NDArray[np.integer], values: Array) -> Array:
    """Return the values added up at dofs, shape (local dofs,), complete on their owners."""
    b = fem.Function(space).x
    np.add.at(b.array, dofs, values)
    b.scatter_reverse(la.InsertMode.add)
    return np.array(b.array)


MIN_TARGET_ROWS = 3
ONE_SIDED = 0.1
"""Fraction of its width within which the top of a one-sided outline lies, from the axis outwards."""


class OutlineMeasure(quantities.TargetMeasure):
    """Distances of points from the outline of a state, in its plane in m, shape (k, 2): distance from the axis (or clamped
    base) and height above the undeformed apex, measured ones from a flat surface. ValueError if the device has no outline, or
    its top is curved and a measured outline counts from a flat one."""

    def __init__(self, design: quantities.DesignedBody, points: Array, measured: bool):
        try:
            self.silhouette = MovedSilhouette(design)
        except body.BodyError as error:
            raise ValueError(f"no target outline: {error}") from None
        if measured and not self.silhouette.flat:
            raise ValueError(
                f"the undeformed top of the device is {self.silhouette.unevenness * 1e3:.3g} mm from flat, but heights "
                "of measured outlines count from a flat surface; give points with heights above its undeformed apex"
            )
        self.points = points
        if self.silhouette.round:
            away = points[:, 0] - (_middle(points) if measured else 0.0)
            self.points = np.column_stack([np.abs(away), points[:, 1]])

    def _closest(self, state: State) -> tuple[grid.Closest, npt.NDArray[np.int64], Array]:
        """Return the closest points, and for each the piece of the curve that it is on with the weights of that piece's
        nodes."""
        curve: grid.QuadraticCurve = self.silhouette.curve(state)
        if not self.silhouette.round:
            closest = curve.closest(self.points)
            return closest, closest.piece, closest.weights
        shadow = shapes.shadow_of(curve)
        closest = shadow.curve.closest(self.points)
        return (closest, shadow.source[closest.piece], np.einsum("ka,kab->kb", closest.weights, shadow.weights[closest.piece]))

    def slopes(self, state: State | None) -> quantities.Slopes:
        assert state is not None
        distances, piece, weights = self._closest(state)
        left = distances.distance
        value = float(np.sqrt(left @ left / len(left)))
        rates = left / (len(left) * value) if value else np.zeros(len(left))
        covector = np.zeros((*self.silhouette.points.shape[:2], 2))
        np.add.at(covector, piece, -rates[:, None, None] * weights[..., None] * distances.normal[:, None, :])
        by_w, by_X = self.silhouette.transposed(covector)
        return quantities.Slopes(value, by_w, 0.0, by_X, self._note())

    def _note(self) -> str:
        if self.silhouette.flat:
            return ""
        uneven = self.silhouette.unevenness * 1e3
        return f"the undeformed top is {uneven:.3g} mm from flat, and heights are counted from its apex"

    def residuals(self, state: State) -> Array:
        return self._closest(state)[0].distance

    def moved(self, state: State, w: Array, X: Array) -> Array:
        distances, piece, weights = self._closest(state)
        return -np.einsum("kb,kbi,ki->k", weights, self.silhouette.moved(w, X)[piece], distances.normal)


class Outline(quantities.DesignQuantity, name="outline", unit="m"):
    """Root mean square distance between points and the deformed outline: of a disk its shadow; of a half slab its top's edge
    in the mirror plane, from the clamped base to the tip.

    The points that rise are those of a file that ``measurement photos`` has written (a disk's axis is at its middle, or at 0
    if it begins at its top), or given in m: distance from the axis (of a slab from the clamped base) and height above the
    undeformed apex. ``sigma`` is a point's standard error across the outline in m, or a text with a unit, 0 to estimate it
    from what is left; ``run`` the correlation length of the errors, in points.
    """

    file: str = ""
    points: tuple[tuple[float, float], ...] = ()
    sigma: float = 0.0
    run: float = dataclasses.field(default=1.0, init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.file) == (len(self.points) > 0):
            raise ValueError("an outline needs either a file of points or the points themselves")
        object.__setattr__(self, "sigma", quantities.length("sigma", self.sigma))
        if self.file:
            points, run = _outline_points(Path(self.file))
            object.__setattr__(self, "run", run)
        else:
            try:
                points = np.array(units.plain(self.points), dtype=float).reshape(len(self.points), 2)
            except (TypeError, ValueError) as error:
                if isinstance(error, units.UnitError):
                    raise
                raise ValueError("the points of an outline are pairs: distance from the axis and height, in m") from None
        if len(points) < MIN_TARGET_ROWS or not np.isfinite(points).all():
            raise ValueError(f"an outline needs at least {MIN_TARGET_ROWS} points, all finite")
        object.__setattr__(self, "points", tuple(map(tuple, points.tolist())))

    @property
    def title(self) -> str:
        return f"distance from the outline {Path(self.file).stem}" if self.file else "distance from the outline"

    def measure(self, design: quantities.DesignedBody) -> OutlineMeasure:
        made = OutlineMeasure(design, np.array(self.points), bool(self.file))
        made.run, made.sigma = self.run, self.sigma
        return made


def _outline_points(file: Path) -> tuple[Array, float]:
    """Return the risen points of a measured outline, and the correlation length of their residuals in points. ValueError if
    there is no outline, it is not trusted, or nothing rises."""
    (outline,) = shapes.read_outlines([file])
    outline = outline.measured()
    part = shapes.rising(outline)
    if part is None:
        raise ValueError(f"{file}: no point of this outline rises, so it is not usable as a target")
    return np.column_stack([outline.x[part], outline.z[part]]), shapes.correlation([outline])


def _middle(points: Array) -> float:
    """Return the axis position of a measured outline: the centroid under it, or 0 if it shows only one side."""
    x, z = points[:, 0], np.maximum(points[:, 1], 0.0)
    if x[np.argmax(z)] - x[0] < ONE_SIDED * np.ptp(x):
        return 0.0
    return float(np.trapezoid(x * z, x) / np.trapezoid(z, x))


# ----------------------------------------------------------------------------------------------------------------------
# Quantities composed of others, also at several states: the distance from a target path, or from a pose.


class CompositeQuantity(quantities.DesignQuantity):
    """A function of other quantities."""

    of_state: ClassVar = False

    @property
    @abc.abstractmethod
    def parts(self) -> tuple[quantities.DesignQuantity, ...]:
        """The component quantities."""

    @abc.abstractmethod
    def combined(self, values: Array) -> tuple[float, Array]:
        """Return the value of the function of the parts' values, and its slopes by them."""

    def squares(self, values: Array, slopes: Array) -> trials.Squares | None:
        """Return the residuals of a target, from the parts' values (k,) and their gradients (k, m)."""
        return None

    def note(self, values: Array) -> str:
        """Return what a user reads beside the value, from the parts' values (k,), or ""."""
        return ""

    def measure(self, design: quantities.DesignedBody) -> quantities.Measure:
        raise TypeError("a composite quantity is evaluated from its parts")


class TipPath(CompositeQuantity, name="tip_path", unit="m"):
    """Root mean square distance of a probe (the device's first one if empty) from a target path: rows of pressure in Pa and
    coordinates in m, nan where one is not asked for, or a file that `read_tip_path` reads. ``sigma`` is a coordinate's
    standard error in m, or a text with a unit, 0 to estimate it from what is left; ``cm`` Pa of one centimetre of the case's
    column, for pressures in cm."""

    of: str = ""
    target: tuple[tuple[float, float, float, float], ...] = ()
    file: str = ""
    sigma: float = 0.0
    cm: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.file) == (len(self.target) > 0):
            raise ValueError("a tip path needs either a file or a target, rows of pressure and place")
        object.__setattr__(self, "sigma", quantities.length("sigma", self.sigma))
        if self.file:
            rows, of = read_tip_path(Path(self.file), self.of, self.cm)
            object.__setattr__(self, "of", of)
        else:
            try:
                rows = tuple((float(p), float(x), float(y), float(z)) for p, x, y, z in self.target)
            except (TypeError, ValueError):
                raise ValueError("the target of a tip path has rows of pressure in Pa and x, y, z in m") from None
        object.__setattr__(self, "target", rows)

    @property
    def title(self) -> str:
        return f"distance of {self.of or 'the tip'} from its path"

    @property
    def _wanted(self) -> list[tuple[quantities.Place, float]]:
        return [
            (quantities.Place(at=trials.EvaluatedLoad.of(row[0]), of=self.of, axis=axis), row[1 + i])
            for row in self.target
            for i, axis in enumerate(actuator.AXES)
            if not np.isnan(row[1 + i])
        ]

    @property
    def parts(self) -> tuple[quantities.DesignQuantity, ...]:
        return tuple(place for place, _ in self._wanted)

    def residuals(self, values: Array) -> Array:
        """Return the distances of the coordinates from the path's, m."""
        return values - np.array([there for _, there in self._wanted])

    def combined(self, values: Array) -> tuple[float, Array]:
        left = self.residuals(values)
        value = float(np.sqrt(left @ left / len(self.target)))
        return value, left / (len(self.target) * value) if value else np.zeros_like(left)

    def squares(self, values: Array, slopes: Array) -> trials.Squares:
        return trials.Squares.of(self.residuals(values), slopes, 1.0, self.sigma)


class Pose(CompositeQuantity, name="pose", unit="tolerances"):
    """Distance of a face, such as "tip", from a target pose in tolerances: the root mean square of how far each coordinate of
    its mean place, and its turn about an axis, are from the wanted ones, each over its tolerance.

    Attributes:
        of, axis: The face, and the axis of the turn in device coordinates, as of `Turn`.
        position: Wanted coordinates of the face's mean place in m by axis, as in ``{"x": "30 mm", "z": "12 mm"}``; those left
            out are free.
        turn: The wanted angle in degrees, from -180 to 180; None where it is free.
        tolerance, turn_tolerance: What counts as one, of a coordinate in m and of the turn in degrees. Of a target that is
            followed they are the standard errors.
    """

    of_state: ClassVar = True

    of: str = ""
    axis: str = "y"
    position: Mapping[str, float | str] = dataclasses.field(default_factory=dict, hash=False)
    turn: float | str | None = None
    tolerance: float | str = 1e-3
    turn_tolerance: float | str = 1.0

    named = staticmethod(quantities.OfFace.named)

    def __post_init__(self) -> None:
        super().__post_init__()
        example = '{ x = "30 mm", z = "12 mm" }'
        if not isinstance(self.position, Mapping) or not set(self.position) <= set(actuator.AXES):
            raise ValueError(f"position of a pose gives coordinates by axis, x, y or z, such as {example}")
        if not self.position and self.turn is None:
            raise ValueError(f'a pose needs a position, such as {example}, a turn, such as "90 deg", or both')
        wanted = {axis: _in_unit(f"position {axis}", value, "m") for axis, value in self.position.items()}
        object.__setattr__(self, "position", wanted)
        for name, unit in (("tolerance", "m"), ("turn_tolerance", "degree")):
            value = _in_unit(name, getattr(self, name), unit)
            if value <= 0.0:
                raise ValueError(f"{name} of a pose is {getattr(self, name)!r}; it must be above zero")
            object.__setattr__(self, name, value)
        if self.turn is not None:
            turn = _in_unit("turn", self.turn, "degree")
            if abs(turn) > 180.0:
                raise ValueError(f"turn of a pose is {turn:g} deg; it must be from -180 to 180 deg")
            object.__setattr__(self, "turn", turn)

    @property
    def title(self) -> str:
        return f"distance of {self.of} from its pose"

    @property
    def parts(self) -> tuple[quantities.DesignQuantity, ...]:
        places = (quantities.FacePlace(at=self.at, of=self.of, axis=axis) for axis in self.position)
        return (*places, *([] if self.turn is None else [quantities.Turn(at=self.at, of=self.of, axis=self.axis)]))

    def residuals(self, values: Array) -> Array:
        """Return how far coordinates and turn are from the wanted ones, in tolerances; of the turn the shorter way round."""
        apart = values - np.array([*self.position.values(), *([] if self.turn is None else [self.turn])], dtype=float)
        if self.turn is not None:
            apart[-1] = (apart[-1] + 180.0) % 360.0 - 180.0
        return apart / self._tolerances

    @property
    def _tolerances(self) -> Array:
        of_turn = [] if self.turn is None else [self.turn_tolerance]
        return np.array([*[self.tolerance] * len(self.position), *of_turn], dtype=float)

    def combined(self, values: Array) -> tuple[float, Array]:
        left = self.residuals(values)
        value = float(np.sqrt(left @ left / len(left)))
        return value, left / (len(left) * value * self._tolerances) if value else np.zeros_like(left)

    def squares(self, values: Array, slopes: Array) -> trials.Squares:
        return trials.Squares.of(self.residuals(values), slopes / self._tolerances[:, None], 1.0, 1.0)

    def note(self, values: Array) -> str:
        told = [f"{axis} {1e3 * value:.4g} mm" for axis, value in zip(self.position, values, strict=False)]
        told += [] if self.turn is None else [f"turned by {values[-1]:.4g} deg about {self.axis}"]
        return ", ".join(told)


def _in_unit(what: str, value: float | str, unit: str) -> float:
    """Return a number, or a text with a unit, in a unit; ValueError if it is none."""
    number = units.quantity(value, unit) if isinstance(value, str) else float(value)
    if not np.isfinite(number):
        raise ValueError(f"{what} is {value!r}; it must be a finite number")
    return number


# ----------------------------------------------------------------------------------------------------------------------
# Read tip paths from tables: positions of a point over the pressure, from ``path.csv`` of a run or typed by hand.


Row = tuple[float, float, float, float]

MIN_REQUESTED_ROWS = 3
"""Minimum number of rows at requested pressures; with fewer, all rows are used."""
PRESSURE = re.compile(r"pressure[_ ]*[\[(]?([A-Za-z]+)[\])]?")
PLACE = re.compile(r"(?:(?!max_stretch)(\w+?)[_ ])?([xyz])[_ ]*[\[(]?([a-z]+)[\])]?")


def read_tip_path(file: Path, of: str, cm: float = 0.0) -> tuple[tuple[Row, ...], str]:
    """Return the rows of pressure in Pa and place in m (nan for missing columns), by rising pressure, of a table (a text or
    an Excel workbook), and the point's name; ``of`` is empty for the only one in it. ValueError if there is no such table.

    Columns are named by what they have and its unit: ``pressure_kPa``, ``x_mm`` or ``tip_x_mm``; or the units stand in a row
    below the names. Rows at rest, and those from the highest pressure on, are left out: there a pressure has more than one
    place. Of a run's table those at the pressures that it was asked at are taken. ``cm`` is Pa of one centimetre of the
    case's column; 0 if it is not known.
    """
    sheet, rows = _rows(file)
    names = list(rows[0][1])
    pressure, unit = _pressure_column(file, names, cm)
    columns, of = _place_columns(file, names, of)
    table = []
    for line, row in rows:
        try:
            at = _value(row[pressure], unit, "Pa", cm)
            place = [_value(row[columns[axis][0]], columns[axis][1], "m", cm) if axis in columns else np.nan for axis in "xyz"]
        except (units.UnitError, TypeError) as error:
            raise ValueError(f"{file}, {sheet.place(line)}: {error}") from None
        table.append([at, *place])
    kept = _rising_rows(np.array(table), _requested_rows([row for _, row in rows]))
    if not len(kept):
        raise ValueError(f"{file} has no row at a pressure above zero; a tip path needs at least one")
    return tuple((float(p), float(x), float(y), float(z)) for p, x, y, z in kept), of


def _rows(file: Path) -> tuple[tables.Worksheet, list[tuple[int, dict[str, str]]]]:
    """Return the sheet, and its rows by their columns' names, with the units in a row below them if that has them."""
    try:
        sheets = tables.read_sheets(file)
        chosen = tables.pick(file, sheets, lambda sheet: _table(sheet.rows))
        if chosen is None:  # no sheet has a path: use the one with most columns for the message
            widest = max(sheets, key=lambda sheet: len(sheet.rows[0][1]) if sheet.rows else 0)
            chosen = widest, widest.rows
    except OSError as error:
        raise ValueError(f"{file} cannot be read: {errors.reason(error)}") from None
    if len(chosen[1]) < 2:
        raise ValueError(
            f"{file} has no rows; a path needs a column of pressures and columns of positions, such as pressure_kPa, x_mm"
        )
    return chosen[0], tables.records(chosen[1])


def _table(rows: Sequence[tables.Line]) -> Sequence[tables.Line] | None:
    """Return the names with their units and the rows below; None if there is no column of pressures or positions."""
    if not rows:
        return None
    ways = [rows]
    if len(rows) > 1:
        names = [f"{name} [{unit.strip(' []()')}]" for name, unit in zip(rows[0][1], rows[1][1], strict=False)]
        ways.append([(rows[0][0], names), *rows[2:]])
    for way in ways:
        names = [name.strip() for name in way[0][1]]
        if any(map(PRESSURE.fullmatch, names)) and any(map(PLACE.fullmatch, names)):
            return way
    return None


def _pressure_column(file: Path, names: Sequence[str], cm: float) -> tuple[str, str]:
    units_by_name = {match[1]: name for name in names if (match := PRESSURE.fullmatch(name))}
    for unit in ("Pa", *units_by_name):
        if unit in units_by_name and (unit != "cm" or cm):
            return units_by_name[unit], unit
    if "cm" in units_by_name:
        raise ValueError(f"{file} gives the pressure in cm of an unknown liquid; use pressure_Pa or pressure_kPa")
    raise ValueError(f"{file} has no column of pressures with its unit, such as pressure_kPa; it has {', '.join(names)}")


def _place_columns(file: Path, names: Sequence[str], of: str) -> tuple[dict[str, tuple[str, str]], str]:
    """By axis the column and its unit, and the point's name."""
    points: dict[str, dict[str, tuple[str, str]]] = {}
    for name in names:
        if match := PLACE.fullmatch(name):
            points.setdefault(match[1] or "", {})[match[2]] = (name, match[3])
    chosen = of if of in points else "" if "" in points else next(iter(points)) if len(points) == 1 and not of else None
    if chosen is None:
        known = f"it has {', '.join(names)}" if not points else f"it has positions of {', '.join(points)}; choose one (of)"
        raise ValueError(
            f"{file} has no columns of positions{' of ' + of if of else ''}, such as {of or 'tip'}_x_mm or x_mm; {known}"
        )
    return points[chosen], chosen or of


def _value(text: str, unit: str, wanted: str, cm: float) -> float:
    if wanted == "Pa" and unit == "cm":
        return units.number(text) * cm
    return units.quantity(f"{units.number(text)!r} {unit}", wanted)


def _requested_rows(rows: Sequence[Mapping[str, str]]) -> npt.NDArray[np.bool_]:
    """Return the rows at the requested pressures of a run; all rows of other tables."""
    return np.array([row.get("requested", "1") not in ("0", "0.0", "False") for row in rows])


def _rising_rows(table: Array, asked: npt.NDArray[np.bool_]) -> Array:
    """Return the rows above zero up to the highest pressure, each pressure once."""
    last = int(np.argmax(table[:, 0])) + 1
    kept = np.arange(len(table)) < last
    kept &= (table[:, 0] > 0.0) & (table[:, 0] > np.r_[0.0, np.maximum.accumulate(table[:, 0])[:-1]])
    return table[kept & asked] if (kept & asked).sum() >= MIN_REQUESTED_ROWS else table[kept]
