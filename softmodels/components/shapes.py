"""Geometry of rigid shapes: a sphere, a cylinder, a capsule, a plane, or the surface of an STL file; one class for each."""

from __future__ import annotations

import abc
import dataclasses
import functools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from geometries import Actuator, GeometryError
from geometries.actuator import CutPlane
from geometries.faces import UNITS
from softmodels.common import errors
from softmodels.common.arrays import Array
from softmodels.common.lazy import scipy
from softmodels.mechanics.body import in_space

CYLINDER_LENGTH = 1e3
"""Half length of a cylinder in sizes of the device."""
MAX_SHAPE_DEPTH = 0.05
"""Penetration relative to the size at which a state is rejected: the device would pass through the shape."""
QUARTER_POINTS = 16
"""Points of a quarter circle that is drawn."""
type Numbers = tuple[Array, Array, float | None, float, float]
"""Place of its middle, direction of its line, radius, half the line's length, and 1 or, of a hollow one, -1; in sizes.

Of a plane a point, its normal, and no radius.
"""
Indices = npt.NDArray[np.int64]


@dataclasses.dataclass(frozen=True)
class Shape(abc.ABC):
    """Geometry of a rigid shape. The fields of each class are those of `softmodels.components.contact.RigidShape`.

    Attributes:
        where: Its table in messages.
        at: See `RigidShape`; so for all other fields.
    """

    where: str
    at: tuple[float, ...]

    def error(self, text: str) -> errors.ComponentError:
        """Return the error of a sentence on it."""
        return errors.ComponentError(f"{self.where}: {text}")

    @abc.abstractmethod
    def check(self) -> None:
        """Raise `ComponentError` if its fields make no shape."""

    @abc.abstractmethod
    def crosses(self, normal: Array) -> bool:
        """Return whether it crosses the cut plane of this normal."""

    @abc.abstractmethod
    def check_on(self, actuator: Actuator) -> None:
        """Raise `ComponentError` if it does not have the symmetry of a device."""

    def deepest(self, size: float) -> float:
        """Return the penetration relative to the size at which a state is rejected."""
        return MAX_SHAPE_DEPTH

    def numbers(self, size: float) -> Numbers:
        """Return what `distance` needs, in sizes of the device."""
        raise NotImplementedError


@dataclasses.dataclass(frozen=True)
class Swept(Shape):
    """A shape with an axis, whose distance is that from a point, a line, a piece of a line, or a plane."""

    along: tuple[float, ...]

    def check(self) -> None:
        if len(self.along) != 3 or not any(self.along):
            raise self.error(f"along = {list(self.along)} is not a direction; write three numbers, such as [0, 1, 0]")

    @property
    def axis(self) -> Array:
        """Unit vector along it."""
        return np.asarray(self.along) / np.linalg.norm(self.along)

    def profile(self, reach: float) -> Array:
        """Return half its outline by its axis: distance along it and radius in m, shape (n, 2). ``reach`` is half the length in
        m of which a cylinder is drawn, and the radius of a plane's disk."""
        raise NotImplementedError

    def check_on(self, actuator: Actuator) -> None:
        if actuator.dimension == 2:
            if np.abs(self.at[:2]).max() > 0.0 or not self.turns_about(2):
                raise self.error(
                    "with an axisymmetric section the shape must be axisymmetric: at = ['0 mm', '0 mm', ...] "
                    "and along = [0, 0, 1]"
                )
            return
        for plane in actuator.cut_planes:
            self.check_mirrored(plane)

    def turns_about(self, axis: int) -> bool:
        """Return whether it is symmetric about a coordinate axis through its point."""
        return abs(self.axis[axis]) >= 1 - 1e-12

    @abc.abstractmethod
    def check_mirrored(self, plane: CutPlane) -> None:
        """Raise `ComponentError` if it crosses a cut plane asymmetrically."""


@dataclasses.dataclass(frozen=True)
class Plane(Swept):
    """A plane, whose normal points to the device."""

    def crosses(self, normal: Array) -> bool:
        return True

    def check_mirrored(self, plane: CutPlane) -> None:
        if abs(float(self.axis @ np.asarray(plane.normal))) > 1e-9:
            raise self.error(
                f"the plane is not perpendicular to the cut plane {plane.name}, so it "
                f"breaks the symmetry; rotate it, or model the whole device"
            )

    def numbers(self, size: float) -> Numbers:
        return np.asarray(self.at) / size, self.axis, None, 0.0, 1.0

    def profile(self, reach: float) -> Array:
        return np.array([[0.0, 0.0], [0.0, reach]])


@dataclasses.dataclass(frozen=True)
class Round(Swept):
    """A shape at a radius from its line."""

    radius: float
    hollow: bool

    def check(self) -> None:
        if self.radius <= 0.0:
            raise self.error(f"a {type(self).__name__.lower()} needs a radius above zero (radius = '5 mm')")
        super().check()

    def deepest(self, size: float) -> float:
        return MAX_SHAPE_DEPTH if self.hollow else min(MAX_SHAPE_DEPTH, 0.5 * self.radius / size)

    def crosses(self, normal: Array) -> bool:
        return bool(abs(np.asarray(self.at) @ normal) < self.radius)

    def half(self, size: float) -> float:
        """Return half the length of the line in its middle, in sizes of the device."""
        return 0.0

    def numbers(self, size: float) -> Numbers:
        return np.asarray(self.at) / size, self.axis, self.radius / size, self.half(size), -1.0 if self.hollow else 1.0

    def check_mirrored(self, plane: CutPlane) -> None:
        normal = np.asarray(plane.normal)
        beyond, lean = float(np.asarray(self.at) @ normal), self.lean(normal)
        reach, askew = self.radius + self.half(1.0) * lean, 1e-9 < lean < 1 - 1e-9
        if -beyond < reach * (1 - 1e-9) and (abs(beyond) > 1e-9 * reach or askew):
            raise self.error(
                f"the {type(self).__name__.lower()} crosses the cut plane {plane.name} asymmetrically; "
                f"put its centre on that plane, or model the whole device"
            )

    def lean(self, normal: Array) -> float:
        """Return the cosine of its line's angle with a plane's normal."""
        return abs(float(self.axis @ normal))

    def profile(self, reach: float) -> Array:
        angle = np.linspace(0.0, np.pi / 2, QUARTER_POINTS)
        end = self.radius * np.column_stack([np.sin(angle), np.cos(angle)])
        shift = np.array([self.half(1.0), 0.0])
        return np.concatenate([end[::-1] * (-1, 1) - shift, end + shift])


class Sphere(Round):
    """A sphere."""

    def turns_about(self, axis: int) -> bool:
        return True

    def lean(self, normal: Array) -> float:
        return 0.0


class Cylinder(Round):
    """A cylinder without ends."""

    def half(self, size: float) -> float:
        return CYLINDER_LENGTH

    def check_mirrored(self, plane: CutPlane) -> None:
        if self.lean(np.asarray(plane.normal)) <= 1 - 1e-9:
            super().check_mirrored(plane)

    def profile(self, reach: float) -> Array:
        return np.array([[-reach, self.radius], [reach, self.radius]])


@dataclasses.dataclass(frozen=True)
class Capsule(Round):
    """A cylinder with round ends, whose middles are ``length`` apart."""

    length: float

    def check(self) -> None:
        super().check()
        if self.length <= 0.0:
            raise self.error("a capsule needs a length above zero (length = '20 mm')")

    def half(self, size: float) -> float:
        return self.length / 2 / size


MIRROR_TOLERANCE = 1e-6
"""Tolerance relative to an STL shape's extent for mirror images of its corners."""


@dataclasses.dataclass(frozen=True)
class Stl(Shape):
    """The closed surface of an STL file."""

    file: str
    unit: str
    rounding: float
    hollow: bool

    def check(self) -> None:
        if not self.file:
            raise self.error("an STL shape needs its file (file = 'hand.stl')")

    @property
    def surface(self) -> tuple[Array, Indices]:
        """The corners in m where they stand, shape (n, 3), and triangles, counter-clockwise from outside. `ComponentError` if
        the file cannot be read, is not closed, or its triangles turn different ways."""
        try:
            points, triangles = _read(self.file, UNITS[self.unit], Path(self.file).stat().st_mtime_ns)
        except OSError as error:
            raise self.error(f"file {self.file} cannot be read ({errors.reason(error)})") from None
        except GeometryError as error:
            raise self.error(f"{error}") from None
        return points + np.asarray(self.at), triangles

    def crosses(self, normal: Array) -> bool:
        points = self.surface[0]
        near = _same(points)
        return bool((points @ normal).min() < -near and (points @ normal).max() > near)

    def check_on(self, actuator: Actuator) -> None:
        points, _ = self.surface
        if actuator.dimension == 2:
            raise self.error("an axisymmetric section needs an axisymmetric shape; use the solid (section = 'solid')")
        near = _same(points)
        for plane in actuator.cut_planes:
            n = np.asarray(plane.normal, dtype=float)
            if (points @ n).max() <= near:
                continue
            image = points - 2 * np.outer(points @ n, n)
            if scipy.spatial.cKDTree(points).query(image)[0].max() > near:
                raise self.error(
                    f"{self.file} crosses the cut plane {plane.name} and its vertices are "
                    f"not mirror-symmetric; model the whole device"
                )


SHAPES: dict[str, type[Shape]] = {
    "sphere": Sphere, "cylinder": Cylinder, "capsule": Capsule, "plane": Plane, "stl": Stl,
}  # fmt: skip


@functools.lru_cache(maxsize=8)
def _read(file: str, unit: float, changed: int) -> tuple[Array, Indices]:
    from geometries import imported  # reads many formats, which a run without such a shape has no use for

    (points, triangles), _ = imported.read_surfaces(file, unit)
    corners = points[triangles]
    volume = float(np.einsum("ti,ti->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))) / 6
    return points, triangles if volume > 0.0 else triangles[:, ::-1]


def _same(points: Array) -> float:
    """Return the distance in m below which places on a shape are the same."""
    return MIRROR_TOLERANCE * float(np.linalg.norm(np.ptp(points, axis=0)))


MIN_SQUARED_DISTANCE = 1e-20
"""Added to squared distances, in squared sizes: the distance from a line has no slope on the line itself."""


def distance(x: Sequence[Array], numbers: Numbers) -> Array:
    """Return the signed distance of a place, three components in sizes, below zero where it is stopped, from components and
    numbers of NumPy or of UFL alike."""
    at, along, radius, half, sign = numbers
    v = [x[i] - at[i] for i in range(3)]
    t = v[0] * along[0] + v[1] * along[1] + v[2] * along[2]
    if radius is None:
        return sign * t
    t = (abs(t + half) - abs(t - half)) / 2  # no further than its ends
    v = [v[i] - t * along[i] for i in range(3)]
    return sign * ((v[0] ** 2 + v[1] ** 2 + v[2] ** 2 + MIN_SQUARED_DISTANCE) ** 0.5 - radius)


def distances(places: Array, numbers: Numbers) -> Array:
    """Return `distance` of places in sizes, shape (n, d)."""
    return np.asarray(distance(list(in_space(places).T), numbers))


def slopes(places: Array, numbers: Numbers) -> tuple[Array, Array, Array]:
    """Return the distances of places in sizes, shape (n, d), their gradients (n, d), and their second derivatives (n, d, d)."""
    at, along, radius, half, sign = numbers
    v = in_space(places) - at
    t = v @ along
    shown = [0, 1, 2] if places.shape[1] == 3 else [0, 2]
    if radius is None:
        count, d = places.shape
        return sign * t, np.tile(sign * along[shown], (count, 1)), np.zeros((count, d, d))
    beside = np.abs(t) < half
    v = v - np.clip(t, -half, half)[:, None] * along
    far = np.sqrt((v**2).sum(axis=1) + MIN_SQUARED_DISTANCE)
    way = v / far[:, None]
    square = np.eye(3) - np.where(beside[:, None, None], np.outer(along, along), 0.0)
    second = (square - way[:, :, None] * way[:, None, :]) / far[:, None, None]
    return sign * (far - radius), sign * way[:, shown], sign * second[:, shown][:, :, shown]


def winding(places: Array, corners: Array) -> Array:
    """Return how often a closed surface goes around places, shape (n,): the solid angle of its triangles, shape (t, 3, 3), over
    4 pi.

    Van Oosterom and Strackee 1983, doi 10.1109/TBME.1983.325207.
    """
    around = np.empty(len(places))
    for number, place in enumerate(places):
        a, b, c = np.moveaxis(corners - place, 1, 0)
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        over = np.einsum("ti,ti->t", a, np.cross(b, c))
        under = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        around[number] = 2 * np.arctan2(over, under).sum() / (4 * np.pi)
    return around
