"""The hollow disk's half profile: a closed outline of lines, arcs and the membrane's top, and where its points go on another.

A point of the outline is known by its edge and by how far along the edge it is: a share of the length, of the angle on arcs, of
the radius on a curved top. The point with the same share of the same edge of another disk is linear in the lengths.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geometries.carrying import carried_along
from geometries.errors import GeometryError
from geometries.fields import shown
from geometries.membrane_profile import MembraneTop

if TYPE_CHECKING:
    from geometries.disk import HollowDisk

Array = NDArray[np.float64]
Place = tuple[float, float]

CHOICES = ("section", "angle", "azimuth", "support")
"""Fields in which two disks must agree for points to be carried from one to the other."""


class Edge(NamedTuple):
    """An edge of the half profile from ``start`` to ``end`` in (radius, height).

    It is straight, or an arc of less than a half circle round ``centre``, or a piece of a curved top: the cubic Bezier curve
    of the control points ``start``, ``inner`` and ``end``, whose radii are equally spaced.
    """

    role: str
    start: Place
    end: Place
    centre: Place | None = None
    inner: tuple[Place, Place] | None = None

    def places(self, shares: Array) -> Array:
        """Points (n, 2) in m at shares (n,) of the edge."""
        start, end = np.array(self.start), np.array(self.end)
        if self.inner is not None:
            t = shares[:, None]
            first, second = np.array(self.inner)
            return (1 - t) ** 3 * start + 3 * (1 - t) ** 2 * t * first + 3 * (1 - t) * t**2 * second + t**3 * end
        if self.centre is None:
            return start + shares[:, None] * (end - start)
        angles = self._begin + shares * self._turn
        radius = np.linalg.norm(start - self.centre)
        return np.array(self.centre) + radius * np.column_stack([np.cos(angles), np.sin(angles)])

    def shares(self, points: Array) -> Array:
        """Shares (n,) of the edge at which points (n, 2) on it are, those of points beyond an end being 0 or 1."""
        start, end = np.array(self.start), np.array(self.end)
        if self.inner is not None:
            found = (points[:, 0] - start[0]) / (end[0] - start[0])
        elif self.centre is None:
            found = (points - start) @ (end - start) / ((end - start) @ (end - start))
        else:
            x, y = (points - self.centre).T
            found = _wrapped(np.arctan2(y, x) - self._begin) / self._turn
        return np.clip(found, 0.0, 1.0)

    @property
    def _begin(self) -> float:
        """Angle of an arc's start."""
        assert self.centre is not None
        return float(np.arctan2(self.start[1] - self.centre[1], self.start[0] - self.centre[0]))

    @property
    def _turn(self) -> float:
        """Angle of an arc."""
        assert self.centre is not None
        end = np.arctan2(self.end[1] - self.centre[1], self.end[0] - self.centre[0])
        return float(_wrapped(end - self._begin))


def _wrapped(angles: Array) -> Array:
    """Angles between -pi and pi."""
    return (angles + np.pi) % (2.0 * np.pi) - np.pi


def outline(disk: HollowDisk) -> list[Edge]:
    """Return the closed half profile in m, counted against the clock from the bottom centre."""
    inner, outer, fillet, lower = disk.cavity_radius, disk.outer_radius, disk.fillet, disk.base_fillet
    floor, ceiling, top, apex = disk.base, disk.ceiling, disk.height, disk.probes["apex"][2]
    arc = [Edge("cavity", (inner - fillet, ceiling), (inner, ceiling - fillet), (inner - fillet, ceiling - fillet))]
    foot = [Edge("cavity", (inner, floor + lower), (inner - lower, floor), (inner - lower, floor + lower))]
    flat = [Edge("top", (outer, top), (0.0, top))]
    arch = [Edge("top", (outer, top), (inner, top)), *_curved(disk.membrane_top)] if disk.profile else []
    return [
        Edge("support" if disk.support == "base" else "outer", (0.0, 0.0), (outer, 0.0)),
        Edge("outer", (outer, 0.0), (outer, top)),
        *(arch or flat),
        Edge("axis", (0.0, apex), (0.0, ceiling)),
        Edge("cavity", (0.0, ceiling), (inner - fillet, ceiling)),
        *(arc if fillet > 0.0 else []),
        Edge("cavity", (inner, ceiling - fillet), (inner, floor + lower)),
        *(foot if lower > 0.0 else []),
        Edge("cavity", (inner - lower, floor), (0.0, floor)),
        Edge("axis", (0.0, floor), (0.0, 0.0)),
    ]


def _curved(top: MembraneTop) -> list[Edge]:
    """The membrane's top from the cavity's edge to the axis."""
    found = []
    for points in top.pieces():
        start, first, second, end = ((float(r), float(z)) for r, z in points)
        found.append(Edge("top", start, end, inner=(first, second)))
    return found


def carried(disk: HollowDisk, other: HollowDisk, points: Array) -> Array:
    """Where points on a disk's boundary lie on another disk; see `geometries.Actuator.carried`."""
    _check_alike(disk, other)
    return carried_along(outline(disk), outline(other), points, disk.outer_radius)


def _check_alike(disk: HollowDisk, other: HollowDisk) -> None:
    if type(other) is not type(disk):
        raise GeometryError(f"points of {type(disk).__name__} cannot be carried to {type(other).__name__}")
    for name in CHOICES[:1] + CHOICES[3:] if disk.dimension == 2 else CHOICES:
        if getattr(disk, name) != getattr(other, name):
            raise GeometryError(
                f"{name} is {getattr(disk, name)} and {getattr(other, name)}; points are carried between disks of the same"
            )
    for name in ("fillet", "base_fillet"):
        if (getattr(disk, name) > 0.0) != (getattr(other, name) > 0.0):
            raise GeometryError(
                f"{name} is {shown(getattr(disk, name), 'm')} and {shown(getattr(other, name), 'm')}; points of a rounded "
                "corner have no place on a sharp one"
            )
    if len(disk.profile) != len(other.profile):
        raise GeometryError(
            f"profile has {len(disk.profile)} and {len(other.profile)} entries; points are carried between equal numbers"
        )
