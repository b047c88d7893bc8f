"""Which photographs contradict the others, where a fit of all of them is beyond chance: named, with what they should say.

Two witnesses. The course of pressures over heights needs no law and finds gross mistakes (`pressure_course`). The
fit finds fine ones: its exact derivatives tell how well it would follow the others without each of them, and a fit without
those that it names confirms it. A law that cannot follow a silicone fails smoothly, most at the ends of the series: there a
small misfit names no photograph.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from measurement.units import pascal_per_cm
from softmodels.fitting.outlines.pressure_course import (
    GROSS,
    Row,
    WrongReading,
    exchanged,
    expected_without,
    wrong_readings,
)
from softmodels.fitting.result import LeastSquaresFit

Array = npt.NDArray[np.float64]

FEWEST = 4
"""Photographs from which one can be told to contradict the others."""
FACTORS = (
    (10.0, "ten times as much: a decimal place, or millimetres for centimetres"),
    (0.1, "a tenth of it: a decimal place, or centimetres for millimetres"),
    (2.0, "twice as much"),
    (0.5, "half of it: the level of one tube alone"),
)
NEAR = 0.08
"""Factors closer than this, relative, are taken for a known one."""
ALIKE = 0.015
"""Shares by which a row's reading may differ from the pressure of its outline while the outline is what is wrong."""
DECISIVE = 10.0
"""Rises of the deviance beyond which one explanation is worse than another."""


@dataclasses.dataclass(frozen=True)
class WrongRows:
    """Photographs that contradict the others.

    Attributes:
        names: Their names; empty if none can be named.
        sentence: What is wrong with them.
        gross: Whether one of their pressures is off by more than any law or bench explains.
    """

    names: tuple[str, ...]
    sentence: str
    gross: bool = False

    @property
    def advice(self) -> str:
        """What to do."""
        without = " ".join(f"--without {name}" for name in self.names)
        return f"correct the list of photographs, or fit without: {without}"

    @property
    def whole(self) -> str:
        """What is wrong, and what to do."""
        return f"{self.sentence}; {self.advice}"


def by_course(rows: Sequence[Row]) -> WrongRows | None:
    """The rows that the course of the others contradicts; None if there are none."""
    found = wrong_readings(rows)
    if not found:
        return None
    pair = exchanged(rows)
    if pair is not None:
        return WrongRows((pair[0].source, pair[1].source), _exchange(*pair), any(map(_gross, pair)))
    return WrongRows(tuple(one.source for one in found), "; ".join(map(_sentence, found)), any(map(_gross, found)))


def _gross(one: WrongReading) -> bool:
    return not 1 / GROSS < one.factor < GROSS


def by_fit(
    fit: LeastSquaresFit, names: Sequence[str], rows: Sequence[Row], good: Callable[[Sequence[str]], bool]
) -> WrongRows | None:
    """The photographs without which the fit is as good as its errors, by leaving them out in turn.

    Args:
        fit: The fit to all of them.
        names: Name of the photograph of each measured residual, shape (count,); other sources have names of their own.
        rows: The series, by rising pressure.
        good: Whether a fit without photographs of these names is within chance.
    """
    if len(rows) < FEWEST:
        return None
    ranked = left_out(fit, names, [row.source for row in rows])
    for deviance, chosen in ranked[:3]:
        rivals = [
            one for other, one in ranked if other < deviance + DECISIVE and len(one) <= len(chosen) and one != chosen
        ]
        if not good(chosen):
            continue
        if rivals and any(good(rival) for rival in rivals[:2]):
            all_named = tuple(dict.fromkeys(name for one in (chosen, *rivals) for name in one))
            return WrongRows(
                all_named, f"{' or '.join(all_named)} contradicts the others, and nothing tells which of them"
            )
        sentences = [_fine(name, rows) for name in chosen]
        return WrongRows(chosen, "; ".join(filter(None, sentences))) if all(sentences) else None
    return None


def left_out(
    fit: LeastSquaresFit, names: Sequence[str], photographs: Sequence[str]
) -> list[tuple[float, tuple[str, ...]]]:
    """Deviance of the others without one or two photographs, by the fit's derivatives; the lowest first, one before two."""
    labels, found = np.array([*names, *[""] * (len(fit.residuals) - fit.count)]), []
    size = np.linalg.norm(fit.jacobian, axis=0)
    J, r = fit.jacobian / np.where(size == 0.0, 1.0, size), fit.residuals
    for count in (1, 2):
        part = []
        for chosen in itertools.combinations(photographs, count):
            kept = ~np.isin(labels, chosen)
            step, *_ = np.linalg.lstsq(J[kept], -r[kept], rcond=1e-12)
            part.append((float(np.sum((r[kept] + J[kept] @ step) ** 2)), chosen))
        found += sorted(part)[:3]
    return found


def _fine(name: str, rows: Sequence[Row]) -> str:
    """What is wrong with a photograph that a fit names; empty if a law that fails may be as much the reason."""
    i = next(k for k, row in enumerate(rows) if row.source == name)
    one = WrongReading(name, rows[i].pressure, expected_without(rows, [name], rows[i]))
    order = sorted(range(len(rows)), key=lambda k: rows[k].height)
    end = i in (order[0], order[-1])
    if end and 1 / GROSS < one.factor < GROSS:
        return ""
    if abs(one.factor - 1.0) > ALIKE:
        return _sentence(one)
    return (
        f"{name}: the others lead neither to its outline nor to its reading, {reading(one.pressure)}, though their heights "
        "agree within a few percent: the part or the camera was moved for it, or its pressure is slightly off"
    )


def _sentence(one: WrongReading) -> str:
    known = next((words for factor, words in FACTORS if abs(one.factor / factor - 1.0) < NEAR), "")
    if one.factor < 0.0:
        known = "its sign is wrong" if abs(one.factor + 1.0) < NEAR else "it is below zero"
    share = known or f"{one.factor:.3g} times as much"
    return (
        f"{one.source} contradicts the others: they lead to {reading(one.expected)} at its height, its row says "
        f"{reading(one.pressure)}, {share}"
    )


def _exchange(one: WrongReading, two: WrongReading) -> str:
    return (
        f"{one.source} and {two.source} look exchanged: the others lead to {reading(one.expected)} for the first and "
        f"{reading(two.expected)} for the second, and their rows say {reading(one.pressure)} and {reading(two.pressure)}"
    )


def reading(pressure: float) -> str:
    """A pressure as the bench reads it."""
    return f"{pressure / pascal_per_cm():.4g} cm of water ({pressure / 1e3:.4g} kPa)"
