"""Lines sorted into two pencils and counted: which line of the grid is which."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from measurement.camera.camera import Camera, Points
from measurement.screen.grid_error import GridError
from measurement.screen.grid_lines import Line
from measurement.screen.plane import Plane, PlaneError

AIM = np.sin(np.radians(1.5))
"""Sine of the largest angle by which a line of a pencil may miss their common vanishing point."""

OFF_BEAT = 0.15
"""Largest distance of a line from its whole number, as a share of the pitch."""


def count_lines(lines: list[Line], camera: Camera) -> Plane:
    """The lattice that the lines form, as a plane whose metres are whole numbers of lines.

    Raises:
        GridError: No two pencils of lines that cross, or lines that are not equally spaced.
    """
    centre = np.array([camera.width - 1, camera.height - 1]) / 2
    scale = float(np.hypot(*centre))
    rows = np.array([[*line.normal, (line.normal @ centre - line.offset) / scale] for line in lines])
    middles = np.array([(line.middle - centre) / scale for line in lines])
    weights = np.array([float(line.support) for line in lines])
    free = np.ones(len(lines), dtype=bool)
    first, one = _pencil(rows, middles, weights, free)
    crossing = free & ~first & (np.abs(rows[:, :2] @ _along(rows[first], weights[first])) > np.sin(np.radians(20.0)))
    second, other = _pencil(rows, middles, weights, crossing)
    if min(first.sum(), second.sum()) < 2 or first.sum() + second.sum() < 5:
        raise GridError(
            f"no grid was found: {int(first.sum())} and {int(second.sum())} lines cross, but 3 and 2 are the fewest"
        )
    places, numbers = [], []
    for members, across in ((first, other), (second, one)):
        # With both vanishing points taken to infinity and the picture's centre to the origin, a line of the grid lies at
        # one number, and the numbers of a family are equally spaced.
        at = -rows[members, 2] / (rows[members] @ across)
        counted, kept = _count(at, weights[members])
        places.append(rows[members][kept])
        numbers.append(counted)
    crossings, indices = [], []
    for (row, i), (column, j) in itertools.product(
        zip(places[0], numbers[0], strict=True), zip(places[1], numbers[1], strict=True)
    ):
        point = np.cross(row, column)
        crossings.append(point[:2] / point[2] * scale + centre)
        indices.append((j, i))
    try:
        return Plane.fit(np.array(crossings), np.array(indices, dtype=float))
    except PlaneError:
        raise GridError("the lines found cross in too few places to form a grid; show more of the grid") from None


def _along(rows: Points, weights: Points) -> Points:
    """The mean direction of lines, whose normals may point either way."""
    _, _, axes = np.linalg.svd(rows[:, :2] * weights[:, None])
    return np.array([-axes[0, 1], axes[0, 0]])


def _pencil(
    rows: Points, middles: Points, weights: Points, free: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], Points]:
    """The heaviest set of free lines with a common vanishing point, and that point (homogeneous, norm 1)."""
    best, chosen = 0.0, np.zeros(len(rows), dtype=bool)
    candidates = np.flatnonzero(free)[:40]
    for i, j in itertools.combinations(candidates, 2):
        # Lines of one family stay within this angle of each other in any usable photograph.
        if abs(rows[i, :2] @ rows[j, :2]) < np.cos(np.radians(35.0)):
            continue
        members = free & _aimed(rows, middles, np.cross(rows[i], rows[j]))
        # Nearly one line seen twice makes a pencil with everything that crosses it there.
        if weights[members].sum() > best:
            best, chosen = float(weights[members].sum()), members
    point = np.zeros(3)
    for _ in range(3):
        if chosen.sum() < 2:
            return np.zeros(len(rows), dtype=bool), point
        _, _, axes = np.linalg.svd(rows[chosen] * weights[chosen, None])
        point = axes[2]
        chosen = free & _aimed(rows, middles, point)
    return chosen, point


def _aimed(rows: Points, middles: Points, point: Points) -> NDArray[np.bool_]:
    towards = point[:2] - middles * point[2]
    length = np.linalg.norm(towards, axis=1)
    # A vanishing point inside the picture is no vanishing point.
    outside = abs(point[2]) * 1.2 < np.linalg.norm(point[:2])
    return outside & (np.abs(np.sum(rows[:, :2] * towards, axis=1)) < AIM * np.maximum(length, 1e-12))


def _count(at: Points, weights: Points) -> tuple[NDArray[np.int64], NDArray[np.intp]]:
    """Whole numbers for lines at equally spaced places, and which of the lines they belong to."""
    order = np.argsort(at)
    place, weight = at[order], weights[order]
    span = place[-1] - place[0]
    best, chosen = -np.inf, (1.0, 0.0)
    gaps = [(place[j] - place[i]) / (j - i) for i, j in itertools.combinations(range(len(place)), 2) if j - i <= 4]
    steps = sorted({float(f"{gap / part:.3g}") for gap in gaps for part in (1, 2, 3) if gap / part > span / 300})
    typical = float(np.median(weight))
    for step in steps:
        for start in place[np.argsort(-weight)[:4]]:
            score = _score(place, weight, step, start, typical)
            if score > best:
                best, chosen = score, (step, start)
    if not np.isfinite(best):
        raise GridError("the lines found are not equally spaced; no regular grid can be seen")
    numbers, near = _numbers(place, *chosen)
    # Of several lines with one number the longest counts.
    kept = [
        int(max(np.flatnonzero(near & (numbers == number)), key=lambda index: weight[index]))
        for number in np.unique(numbers[near])
    ]
    if len(kept) < 2 or weight[kept].sum() < 0.5 * weight.sum():
        raise GridError("the lines found are not equally spaced; no regular grid can be seen")
    return numbers[kept], order[kept]


def _numbers(place: Points, step: float, start: float) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    numbers = np.round((place - start) / step).astype(int)
    # The first fit of the vanishing points is rough, so step and start are fitted before lines are judged.
    near = np.abs(place - start - numbers * step) < 2 * OFF_BEAT * step
    if len(np.unique(numbers[near])) >= 2:
        slope, base = np.polyfit(numbers[near], place[near], 1)
        near = np.abs(place - base - numbers * slope) < OFF_BEAT * abs(slope)
    return numbers, near


def _score(place: Points, weight: Points, step: float, start: float, typical: float) -> float:
    """Weight of the lines on the beat, less half a line for every beat without one."""
    numbers, near = _numbers(place, step, start)
    beats = np.unique(numbers[near])
    if len(beats) < 2:
        return -np.inf
    longest = np.zeros(np.ptp(beats) + 1)
    np.maximum.at(longest, numbers[near] - beats[0], weight[near])
    return float(longest.sum()) - 0.5 * typical * float(np.ptp(beats) + 1 - len(beats))
