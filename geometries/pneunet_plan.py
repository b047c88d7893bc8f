"""Where the walls of a PneuNet are: all stand square to the axes, so that a list of places along each says everything."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from geometries.errors import GeometryError

if TYPE_CHECKING:
    from geometries.pneunet import PneuNet

Vector = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class Box:
    """A block with sides along the axes, in m.

    Attributes:
        low: Corner with the smallest coordinates.
        high: Corner with the largest.
    """

    low: Vector
    high: Vector

    @property
    def volume(self) -> float:
        return float(np.prod(np.subtract(self.high, self.low)))

    @property
    def area(self) -> float:
        x, y, z = np.subtract(self.high, self.low)
        return float(2.0 * (x * y + y * z + z * x))

    def holds(self, low: NDArray[np.float64], high: NDArray[np.float64], near: float) -> bool:
        """Whether another block, given by its corners, lies in this one, to ``near`` (m)."""
        return bool(np.all(low > np.subtract(self.low, near)) and np.all(high < np.add(self.high, near)))


def pitch(finger: PneuNet) -> float:
    """From a chamber to the next one, in m."""
    return finger.chamber_length + (2.0 * finger.wall + finger.gap if finger.gap else finger.wall)


def length(finger: PneuNet) -> float:
    """From the clamp to the tip, in m."""
    return finger.root + (finger.chambers - 1) * pitch(finger) + finger.chamber_length + finger.cap


def half_width(finger: PneuNet) -> float:
    """From the mirror plane to the side, in m."""
    return 0.5 * finger.chamber_width + finger.side_wall


def ceiling(finger: PneuNet) -> float:
    """Height of the chambers' ceiling above the middle of the base, in m."""
    return 0.5 * finger.base + finger.chamber_height


def top(finger: PneuNet) -> float:
    """Height of the chambers' outside, in m."""
    return ceiling(finger) + finger.top_wall


def gap_floor(finger: PneuNet) -> float:
    """Height at which a gap ends, in m."""
    return 0.5 * finger.base + finger.channel_height + finger.bridge


def starts(finger: PneuNet) -> list[float]:
    """Where the air of each chamber begins along x, in m."""
    return [finger.root + k * pitch(finger) for k in range(finger.chambers)]


def air(finger: PneuNet) -> list[Box]:
    """The air above the base, half of it (y > 0): the chambers, then the pieces of the channel between them."""
    floor, half, duct = 0.5 * finger.base, 0.5 * finger.chamber_width, 0.5 * finger.channel_width
    chambers = [Box((x, 0.0, floor), (x + finger.chamber_length, half, ceiling(finger))) for x in starts(finger)]
    pieces = [
        Box((x - pitch(finger) + finger.chamber_length, 0.0, floor), (x, duct, floor + finger.channel_height))
        for x in starts(finger)[1:]
    ]
    return chambers + pieces


def gaps(finger: PneuNet) -> list[Box]:
    """The gaps between the chambers above the base, half of each; none between ribs."""
    if not finger.gap:
        return []
    begins = [x + finger.chamber_length + finger.wall for x in starts(finger)[:-1]]
    return [Box((x, 0.0, gap_floor(finger)), (x + finger.gap, half_width(finger), top(finger))) for x in begins]


def upper(finger: PneuNet) -> Box:
    """What lies above the base, half of it, without gaps and air."""
    return Box((0.0, 0.0, 0.5 * finger.base), (length(finger), half_width(finger), top(finger)))


def cavity_volume(finger: PneuNet) -> float:
    """Volume in m3 of the air on one side of the base."""
    return 2.0 * sum(box.volume for box in air(finger))


def solid_volume(finger: PneuNet) -> float:
    """Volume in m3 of the whole solid."""
    above = upper(finger).volume - sum(box.volume for box in air(finger) + gaps(finger))
    return 2.0 * (finger.sides * above + length(finger) * half_width(finger) * finger.base)


def expected_cells(finger: PneuNet) -> float:
    """Rough number of cells, within a factor of 1.5 as counted: thin walls have cells by their area, thick ones by volume."""
    boxes = [upper(finger), *air(finger), *gaps(finger)]
    by_area = 6.5 * finger.sides * sum(box.area for box in boxes) / finger.cell_size**2
    by_volume = 8.0 * 0.5 * solid_volume(finger) / finger.cell_size**3
    return max(by_area, by_volume) * 2.0 / finger.copies


def places(finger: PneuNet) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Where walls stand along x, y (from the mirror plane) and z (from the middle of the base), rising, in m."""
    ends = [0.0, length(finger)]
    for x in starts(finger):
        ends += [x, x + finger.chamber_length]
    for box in gaps(finger):
        ends += [box.low[0], box.high[0]]
    across = [0.0, 0.5 * finger.channel_width, 0.5 * finger.chamber_width, half_width(finger)]
    up = [0.0, 0.5 * finger.paper, 0.5 * finger.base, ceiling(finger), top(finger)]
    up += [0.5 * finger.base + finger.channel_height] if finger.chambers > 1 else []
    up += [gap_floor(finger)] if gaps(finger) else []
    return np.sort(ends), np.array(across), np.array(up)


def carried(finger: PneuNet, other: PneuNet, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where points on the boundary lie on another finger with as many walls: linear between walls; see `Actuator.carried`."""
    points = np.array(points, dtype=float)
    for axis, (mine, theirs) in enumerate(zip(places(finger), places(other), strict=True)):
        order = np.argsort(mine, kind="stable")
        if len(mine) != len(theirs) or np.any(np.diff(theirs[order]) < 0.0) or finger.sides != other.sides:
            raise GeometryError("the mesh of this PneuNet cannot follow: the other one has its walls in another order")
        mine, theirs = mine[order], theirs[order]
        points[:, axis] = np.sign(points[:, axis]) * np.interp(np.abs(points[:, axis]), mine, theirs)
    return points
