"""Pressures and heights of whole runs as benches read them, and what goes wrong with single rows.

No photographs: what `witness` is held against by the thousand. The courses are those of soft parts: softening, hardening,
straight, with a limit point passed by volume or jumped over by pressure, and let down again with a lag.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from measurement.outline.outline import Outline
from measurement.photographer import dome_height
from softmodels.common.arrays import Array
from tests.support.photographs.bench import PA_PER_CM

Course = Callable[[Array], Array]

READING, DENSITY = 0.07 * PA_PER_CM, 0.003
"""Standard errors of a pressure: of reading both tubes in Pa, and of the water's density as a share."""


@dataclasses.dataclass(frozen=True, eq=False)
class Rows:
    """A run's rows.

    Attributes:
        heights: Measured heights in m, shape (n,), the first at zero.
        pressures: Pressures as listed in Pa, shape (n,).
        height_errors: Their stated standard errors in m, shape (n,).
        pressure_errors: Theirs in Pa, shape (n,).
        at: Rows that are damaged.
    """

    heights: Array
    pressures: Array
    height_errors: Array
    pressure_errors: Array
    at: tuple[int, ...] = ()

    def outlines(self) -> list[Outline]:
        """Return the rows as outlines of domes."""
        x = np.linspace(-0.012, 0.012, 61)
        columns = zip(self.heights, self.pressures, self.height_errors, self.pressure_errors, strict=True)
        return [
            Outline(x, dome_height(x, h), np.full(61, max(e, 1e-9)), float(p), float(q), f"{k}.jpg")
            for k, (h, p, e, q) in enumerate(columns)
        ]


def _softening(rng: np.random.Generator) -> Course:
    width, rest = rng.uniform(0.3, 1.5), rng.uniform(0.02, 0.5)
    return lambda u: 1.0 - np.exp(-u / width) + rest * u


def _hardening(rng: np.random.Generator) -> Course:
    share = rng.uniform(0.2, 3.0)
    return lambda u: u + share * u**3


def _limit(rng: np.random.Generator) -> Course:
    place = rng.uniform(0.6, 1.3)
    return lambda u: u / (1.0 + (u / place) ** 2)


def _snap(rng: np.random.Generator) -> Course:
    place, rest = rng.uniform(0.25, 0.4), rng.uniform(0.05, 0.4)
    return lambda u: u / (1.0 + (u / place) ** 2) + rest * u**2


COURSES: dict[str, tuple[Callable[[np.random.Generator], Course], str]] = {
    "straight": (lambda rng: lambda u: u, "volume"),
    "softening": (_softening, "volume"),
    "hardening": (_hardening, "volume"),
    "limit point by volume": (_limit, "volume"),
    "limit and hardening by volume": (_snap, "volume"),
    "up to the limit point": (_limit, "pressure"),
    "snap by pressure": (_snap, "pressure"),
    "let down with a lag": (_softening, "back"),
}
"""Kinds of runs: the course of pressure over height, and what is driven."""


def run(kind: str, rng: np.random.Generator, count: int) -> Rows:
    """Return a good run of so many rows, one of them at zero."""
    make, driven = COURSES[kind]
    top, most = rng.uniform(2e-3, 15e-3), rng.uniform(5.0, 60.0) * PA_PER_CM
    course = make(rng)
    fine = np.linspace(0.0, 1.0, 4001)
    greatest = float(course(fine).max())
    even = bool(rng.random() < 0.5)
    steps = np.linspace(0.0, 1.0, count) if even else np.sort(np.r_[0.0, rng.uniform(0.05, 1.0, count - 1)])
    lag = np.zeros(count)
    if driven == "pressure":
        # Under pressure the bulge goes to the first height in equilibrium with it: over the limit point it jumps.
        reached = np.maximum.accumulate(course(fine))
        u = fine[np.argmax(reached >= (steps * rng.uniform(0.9, 0.999) * greatest)[:, None], axis=1)]
    elif driven == "back":
        upwards = max(3, int(count * rng.uniform(0.5, 0.8)))
        u = np.r_[np.linspace(0.0, 1.0, upwards), np.linspace(1.0, 0.0, count - upwards + 1)[1:]]
        lag[upwards:] = rng.uniform(0.02, 0.2) * np.sqrt(4.0 * u * (1.0 - u))[upwards:]
    else:
        u = steps
    creep = rng.choice([0.0, 0.002, 0.006])
    height_error = rng.uniform(1e-6, 8e-6)
    heights = u * top * (1.0 + creep * rng.standard_normal(count)) + height_error * rng.standard_normal(count)
    true = course(u) / greatest * most * (1.0 - lag)
    pressures = true * (1.0 + DENSITY * rng.standard_normal()) + READING * rng.standard_normal(count)
    pressures[0], heights[0] = 0.0, height_error * rng.standard_normal()
    return Rows(heights, pressures, np.full(count, height_error), np.hypot(READING, DENSITY * np.abs(pressures)))


def _changed(rows: Rows, at: tuple[int, ...], heights: Array | None = None, pressures: Array | None = None) -> Rows:
    pressures = rows.pressures if pressures is None else pressures
    errors = np.hypot(READING, DENSITY * np.abs(pressures))
    return Rows(rows.heights if heights is None else heights, pressures, rows.height_errors, errors, at)


def _raised(rows: Rows, rng: np.random.Generator, least: int = 1) -> int:
    return int(rng.integers(least, len(rows.heights)))


def _times(factor: float) -> Callable[[Rows, np.random.Generator], Rows]:
    def damage(rows: Rows, rng: np.random.Generator) -> Rows:
        k = _raised(rows, rng)
        pressures = rows.pressures.copy()
        pressures[k] *= factor
        return _changed(rows, (k,), pressures=pressures)

    return damage


def _swapped(rows: Rows, rng: np.random.Generator) -> Rows:
    first, second = sorted(rng.choice(np.arange(1, len(rows.heights)), 2, replace=False).tolist())
    pressures = rows.pressures.copy()
    pressures[[first, second]] = pressures[[second, first]]
    return _changed(rows, (first, second), pressures=pressures)


def _off(low: float, high: float) -> Callable[[Rows, np.random.Generator], Rows]:
    def damage(rows: Rows, rng: np.random.Generator) -> Rows:
        k = _raised(rows, rng)
        heights = rows.heights.copy()
        heights[k] += rng.choice([-1.0, 1.0]) * rng.uniform(low, high)
        return _changed(rows, (k,), heights=heights)

    return damage


def _neighbours(rows: Rows, rng: np.random.Generator) -> Rows:
    """Return the next photograph's height: a copy of it that kept no noise."""
    k = _raised(rows, rng, 2)
    heights = rows.heights.copy()
    heights[k] = heights[k - 1] + rows.height_errors[k] * rng.standard_normal()
    return _changed(rows, (k,), heights=heights)


def _second_zero(rows: Rows, rng: np.random.Generator) -> Rows:
    height = rng.uniform(0.3e-3, 1.5e-3)
    return Rows(
        np.append(rows.heights, height), np.append(rows.pressures, 0.0), np.append(rows.height_errors, rows.height_errors[0]),
        np.append(rows.pressure_errors, READING), (len(rows.heights),),
    )  # fmt: skip


def _misread(rows: Rows, rng: np.random.Generator) -> Rows:
    k = _raised(rows, rng)
    pressures = rows.pressures.copy()
    pressures[k] += rng.choice([-1.0, 1.0]) * rng.choice([1.0, 2.0, 5.0, 10.0]) * PA_PER_CM
    return _changed(rows, (k,), pressures=pressures)


DAMAGES: dict[str, Callable[[Rows, np.random.Generator], Rows]] = {
    "ten times": _times(10.0),
    "a tenth": _times(0.1),
    "wrong sign": _times(-1.0),
    "two rows swapped": _swapped,
    "height 25 to 100 um off": _off(25e-6, 100e-6),
    "height 100 to 400 um off": _off(100e-6, 400e-6),
    "height 0.4 to 2 mm off": _off(0.4e-3, 2e-3),
    "its neighbour's height": _neighbours,
    "a second zero 0.3 to 1.5 mm high": _second_zero,
    "misread by 1, 2, 5 or 10 cm": _misread,
}
"""What goes wrong with one row, or two."""


def damaged(kind: str, rows: Rows, rng: np.random.Generator) -> Rows:
    """Return a run with a damage of this kind in it."""
    return DAMAGES[kind](rows, rng)
