"""Heights against pressures as a witness that needs no law: which single photographs contradict the others.

What pressure a device takes for a height is, up to one factor, a matter of its shape: the reading, less what dead loads take
of it, over the simulated pressure at the same height is an apparent shear modulus. Over the heights it follows a smooth curve
whatever the silicone is, and before and past limit points alike. A wrong pressure, a wrong photograph or two that have changed
places leave it.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

SMOOTH = (0.30, 0.04, 0.01, 0.01)
"""Relative errors of a course with one to four terms: what a silicone's own curve may leave of it."""
TERMS = {3: 1, 4: 2, 5: 2, 6: 2, 7: 3, 8: 3}
"""Terms of the course by the number of rows; 4 for more of them. Fewer than three rows have none."""
OUTSIDE = 5.0
"""Rows further than this many errors from the others' course contradict it."""
MOST_SUBSETS = 3000
GROSS = 1.15
"""At its ends a course is not sure: there only factors beyond this are told from a silicone's own curve."""


MEETS = 0.15
"""Relative distance within which an exchanged row says what the others lead to for the other one."""
CLEARLY = 2.0
"""One exchange of two rows must leave this many times less scatter than any other."""


@dataclasses.dataclass(frozen=True, eq=False)
class Row:
    """One photograph in the series.

    Attributes:
        source: Its name.
        height: Height of the top in m.
        pressure: Reading in Pa.
        pressure_error: Its standard error in Pa.
        height_error: Standard error of the height in m.
        unit: Simulated pressure in Pa at this height for a shear modulus of 1 Pa, that of dead loads left out.
        borne: Pressure in Pa that the dead loads take at this height.
        silent: Whether that is so much that the reading tells nothing of the silicone.
    """

    source: str
    height: float
    pressure: float
    pressure_error: float
    height_error: float
    unit: float
    borne: float = 0.0
    silent: bool = False

    @property
    def elastic(self) -> float:
        """What the silicone takes of the reading, in Pa."""
        return self.pressure - self.borne

    def reading(self, modulus: float) -> float:
        """The pressure in Pa that an apparent shear modulus in Pa leads to."""
        return modulus * self.unit + self.borne


@dataclasses.dataclass(frozen=True)
class WrongReading:
    """A row that the others contradict: its name, reading in Pa, and the pressure in Pa that they lead to."""

    source: str
    pressure: float
    expected: float

    @property
    def factor(self) -> float:
        return self.pressure / self.expected


def wrong_readings(rows: Sequence[Row]) -> list[WrongReading]:
    """The rows that the smooth course of the others contradicts; none if fewer than three rows make a course."""
    rows = _telling(rows)
    if len(rows) < min(TERMS):
        return []
    inside = _inside(rows)
    if inside is None:
        return []
    found = []
    x = np.array([row.height for row in rows])
    ends = x[inside].min(), x[inside].max()
    for i in np.flatnonzero(~inside).tolist():
        row, expected = rows[i], rows[i].reading(expected_modulus(rows, inside, rows[i].height))
        factor = row.pressure / expected
        if ends[0] <= row.height <= ends[1] or not 1 / GROSS < factor < GROSS:
            found.append(WrongReading(row.source, row.pressure, expected))
    return found


def expected_without(rows: Sequence[Row], names: Sequence[str], row: Row) -> float:
    """Pressure in Pa at a row's height that all rows but those of these names lead to; its own if none of them tells any."""
    rows = _telling(rows)
    inside = np.array([one.source not in names and one.elastic > 0.0 for one in rows])
    if not inside.any():
        return row.pressure
    return row.reading(expected_modulus(rows, inside, row.height))


def exchanged(rows: Sequence[Row]) -> tuple[WrongReading, WrongReading] | None:
    """Two rows whose pressures, exchanged, leave none that contradicts the others; None if there are no such, or several."""
    rows, found = _telling(rows), []
    for a, b in itertools.combinations(range(len(rows)), 2):
        swapped = list(rows)
        swapped[a] = dataclasses.replace(rows[a], pressure=rows[b].pressure)
        swapped[b] = dataclasses.replace(rows[b], pressure=rows[a].pressure)
        inside = _inside(swapped)
        if inside is not None and inside.all():
            found.append((_spread(swapped), a, b))
    found.sort()
    if not found or (len(found) > 1 and found[1][0] < CLEARLY * found[0][0]):
        return None
    pair = [rows[k] for k in found[0][1:]]
    names = [row.source for row in pair]
    one, two = (WrongReading(row.source, row.pressure, expected_without(rows, names, row)) for row in pair)
    meet = abs(one.pressure / two.expected - 1.0) < MEETS and abs(two.pressure / one.expected - 1.0) < MEETS
    return (one, two) if meet else None


def _telling(rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if not row.silent]


def _spread(rows: Sequence[Row]) -> float:
    """Root mean square of all rows' distances from their course, in errors."""
    terms = _terms(len(rows))
    A = _basis(np.array([row.height for row in rows]), max(row.height for row in rows), terms)
    error = np.array([_error(row, terms) for row in rows])
    y = np.log([row.elastic / row.unit for row in rows])
    course, *_ = np.linalg.lstsq(A / error[:, None], y / error, rcond=None)
    return float(np.sqrt(np.mean(((y - A @ course) / error) ** 2)))


def expected_modulus(rows: Sequence[Row], inside: npt.NDArray[np.bool_], height: float) -> float:
    """Apparent shear modulus in Pa that the rows ``inside`` lead to at a height in m."""
    kept = [row for row, sure in zip(rows, inside, strict=True) if sure and row.elastic > 0.0]
    terms = min(_terms(len(rows)), max(len(kept) - 1, 1))
    width = max(row.height for row in rows)
    low, high = (pick(row.height for row in kept) for pick in (min, max))
    if not low <= height <= high:  # no further than a straight line carries
        terms = min(terms, 2)
    A = _basis(np.array([row.height for row in kept]), width, terms)
    error = np.array([_error(row, terms) for row in kept])
    y = np.log([row.elastic / row.unit for row in kept])
    found, *_ = np.linalg.lstsq(A / error[:, None], y / error, rcond=None)
    return math.exp(float((_basis(np.array([height]), width, terms) @ found)[0]))


def _terms(count: int) -> int:
    return TERMS.get(count, 4)


def _basis(heights: Array, width: float, terms: int) -> Array:
    return np.vander((heights / width) ** 2, terms, increasing=True)


def _error(row: Row, terms: int) -> float:
    """Relative standard error of a row's apparent modulus: its reading's, its height's and the course's."""
    reading = 2.0 * row.pressure_error / max(abs(row.elastic), row.pressure_error)
    return math.sqrt(reading**2 + (2.0 * row.height_error / row.height) ** 2 + SMOOTH[terms - 1] ** 2)


def _inside(rows: Sequence[Row]) -> npt.NDArray[np.bool_] | None:
    """Which rows lie on the course that most of them share; None if no half of them does."""
    count, terms = len(rows), _terms(len(rows))
    sane = [i for i, row in enumerate(rows) if row.elastic > 0.0]
    if len(sane) <= count / 2 or len(sane) < terms:
        return None
    width = max(row.height for row in rows)
    A = _basis(np.array([row.height for row in rows]), width, terms)
    error = np.array([_error(row, terms) for row in rows])
    y = np.array([math.log(row.elastic / row.unit) if row.elastic > 0.0 else math.inf for row in rows])
    best: tuple[float, npt.NDArray[np.bool_]] | None = None
    for chosen in _subsets(sane, terms):
        pick = list(chosen)
        try:
            course = np.linalg.solve(A[pick], y[pick])
        except np.linalg.LinAlgError:
            continue
        away = np.abs(y - A @ course) / error
        inside = away < OUTSIDE
        # The course that holds the most rows, of those the closest.
        cost = float(np.minimum(away, OUTSIDE).sum())
        if best is None or cost < best[0]:
            best = cost, inside
    if best is None or best[1].sum() <= max(count / 2, terms):
        return None
    inside = best[1]
    for _ in range(3):  # from exact through few points to least squares through all that agree
        pick = np.flatnonzero(inside).tolist()
        course, *_ = np.linalg.lstsq(A[pick] / error[pick][:, None], y[pick] / error[pick], rcond=None)
        inside = np.abs(y - A @ course) / error < OUTSIDE
        if inside.sum() <= terms:
            return None
    return inside


def _subsets(indices: Sequence[int], size: int) -> list[tuple[int, ...]]:
    """All subsets, or as many of them, always the same, as are worth looking at."""
    if math.comb(len(indices), size) <= MOST_SUBSETS:
        return list(itertools.combinations(indices, size))
    rng = np.random.default_rng(0)
    return [tuple(sorted(rng.choice(indices, size, replace=False).tolist())) for _ in range(MOST_SUBSETS)]
