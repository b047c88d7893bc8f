"""Outlines held against the device before any law is fitted: its shape at the measured heights hardly depends on the law."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.common.units import pascal_per_cm
from softmodels.fitting.outlines.device import DeviceModel
from softmodels.fitting.outlines.residuals import (
    HeightResiduals,
    OutlineResiduals,
    fits_badly,
    misfits,
    plain_path,
    residuals_by_source,
)
from softmodels.fitting.outlines.shapes import Shape
from softmodels.fitting.outlines.silhouette import shadow_of
from softmodels.fitting.outlines.simulated import half_outline
from softmodels.fitting.problem import Parameter, UnsoundError
from softmodels.fitting.result import Judgement, LeastSquaresFit
from softmodels.runs.grid import QuadraticCurve

# ----------------------------------------------------------------------------------------------------------------------
# Heights against pressures as a witness that needs no law: which single photographs contradict the others.
#
# What pressure a device takes for a height is, up to one factor, a matter of its shape: the reading, less what dead loads take
# of it, over the simulated pressure at the same height is an apparent shear modulus. Over the heights it follows a smooth curve
# whatever the silicone is, and before and past limit points alike. A wrong pressure, a wrong photograph or two that have
# changed places leave it.


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
class HeightRow:
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


def wrong_readings(rows: Sequence[HeightRow]) -> list[WrongReading]:
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


def expected_without(rows: Sequence[HeightRow], names: Sequence[str], row: HeightRow) -> float:
    """Pressure in Pa at a row's height that all rows but those of these names lead to; its own if none of them tells any."""
    rows = _telling(rows)
    inside = np.array([one.source not in names and one.elastic > 0.0 for one in rows])
    if not inside.any():
        return row.pressure
    return row.reading(expected_modulus(rows, inside, row.height))


def exchanged(rows: Sequence[HeightRow]) -> tuple[WrongReading, WrongReading] | None:
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


def _telling(rows: Sequence[HeightRow]) -> list[HeightRow]:
    return [row for row in rows if not row.silent]


def _spread(rows: Sequence[HeightRow]) -> float:
    """Root mean square of all rows' distances from their course, in errors."""
    terms = _terms(len(rows))
    A = _basis(np.array([row.height for row in rows]), max(row.height for row in rows), terms)
    error = np.array([_error(row, terms) for row in rows])
    y = np.log([row.elastic / row.unit for row in rows])
    course, *_ = np.linalg.lstsq(A / error[:, None], y / error, rcond=None)
    return float(np.sqrt(np.mean(((y - A @ course) / error) ** 2)))


def expected_modulus(rows: Sequence[HeightRow], inside: npt.NDArray[np.bool_], height: float) -> float:
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


def _error(row: HeightRow, terms: int) -> float:
    """Relative standard error of a row's apparent modulus: its reading's, its height's and the course's."""
    reading = 2.0 * row.pressure_error / max(abs(row.elastic), row.pressure_error)
    return math.sqrt(reading**2 + (2.0 * row.height_error / row.height) ** 2 + SMOOTH[terms - 1] ** 2)


def _inside(rows: Sequence[HeightRow]) -> npt.NDArray[np.bool_] | None:
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


NARROWEST, WIDEST = 0.82, 1.22
"""Measured over simulated width at half the height, beyond which no unit of length a bench has explains it."""
SPACING = 2e-5
"""Distance in m of places on a simulated outline."""


def series_of(
    model: DeviceModel,
    sources: Sequence[str],
    heights: Array,
    pressures: Array,
    pressure_errors: Array,
    errors: Array,
) -> tuple[list[HeightRow], list[QuadraticCurve]]:
    """The series with the pressure that the device takes for each height, and its curve there.

    Args:
        model: The device and any law.
        sources: Names of the photographs.
        heights: Heights of the top in m, shape (n,).
        pressures: Readings in Pa, shape (n,).
        pressure_errors: Their standard errors in Pa, shape (n,).
        errors: Standard errors of the heights in m, shape (n,).

    Raises:
        OutlineFitError: The device cannot rise as high as was measured.
    """
    plain = plain_path(model, heights, pressures)
    lengths = model.set_parameters(plain.values)
    rows = [
        HeightRow(
            source=source,
            height=float(heights[i]),
            pressure=float(pressures[i]),
            pressure_error=float(pressure_errors[i]),
            height_error=float(errors[i]),
            unit=float(plain.elastic[i]) / model.modulus,
            borne=float(plain.borne[i]),
            silent=bool(plain.silent[i]),
        )
        for i, source in enumerate(sources)
    ]
    return rows, [model.curve(state, lengths) for state in plain.states]


def series_of_shapes(model: DeviceModel, shapes: Sequence[Shape]) -> list[HeightRow]:
    """The series of outlines, whose shapes must be the device's.

    Raises:
        UnsoundError: They are of another device.
    """
    columns = [(shape.height, shape.pressure, shape.pressure_error, float(np.median(shape.error))) for shape in shapes]
    rows, curves = series_of(model, [shape.source for shape in shapes], *np.array(columns).T)
    _check_widths(shapes, curves, type(model.system.body.actuator).__name__)
    return rows


def _check_widths(shapes: Sequence[Shape], curves: Sequence[QuadraticCurve], device: str) -> None:
    measured = np.array([_width(shape.points, shape.height / 2) for shape in shapes])
    simulated = np.array(
        [_simulated_width(curve, shape.height / 2) for shape, curve in zip(shapes, curves, strict=True)]
    )
    share = measured / simulated
    if NARROWEST <= float(np.median(share)) <= WIDEST:
        return
    i = int(np.argmin(np.abs(share - np.median(share))))
    extent = f"between {share.min():.2f} and {share.max():.2f} times as wide" if len(share) > 1 else "so"
    raise UnsoundError(
        f"these outlines are of another device: {shapes[i].source} rises {shapes[i].height * 1e3:.4g} mm and is "
        f"{measured[i] * 1e3:.4g} mm wide at half its height, where the case's {device} is {simulated[i] * 1e3:.4g} mm wide "
        f"(all outlines: {extent}); give the case of the part in the photographs, or check the unit of their grid"
    )


def _width(points: Array, level: float) -> float:
    """Distance in m of the outermost points (n, 2) above a level."""
    up = np.flatnonzero(points[:, 1] > level)
    return float(points[up[-1], 0] - points[up[0], 0]) if len(up) else 0.0


def _simulated_width(curve: QuadraticCurve, level: float) -> float:
    places = half_outline(shadow_of(curve).curve, SPACING)[0]
    return 2.0 * float(places[places[:, 1] > level, 0].max())


# ----------------------------------------------------------------------------------------------------------------------
# What a fit had to correct on the bench, in words: reported where it is much, refused where no bench is so.


REPORTED = 1.0
"""Corrections beyond this many standard errors of their prior are reported."""
PLAIN = 0.01
"""So are shares beyond this."""
BELIEVED = 5.0
"""Corrections of pressures beyond this many standard errors of their prior are refused: outlines do not show them."""


def _share(what: str) -> Callable[[float], str]:
    return lambda value: f"{what} too {'large' if value > 0.0 else 'small'} by {abs(value):.2%}".replace("%", " %")


def _zero(value: float) -> str:
    where = (
        "below the undeformed top, so that heights are too large"
        if value > 0.0
        else "above the undeformed top: it has sunk"
    )
    return f"the zero plane {abs(value) * 1e3:.3g} mm {where}"


WORDS: dict[str, tuple[Callable[[float], str], str]] = {
    "scale": (
        _share("all lengths in the photographs"),
        "check the pitch of the grid or board and the distances of lamp and screen",
    ),
    "zero": (_zero, "check that the part did not move after the photograph at rest"),
    "pressure_offset": (
        lambda value: f"all pressures too {'high' if value > 0.0 else 'low'} by {abs(value):.3g} Pa",
        "check the column's level at rest",
    ),
    "pressure_scale": (_share("all pressures"), "check the density of the column's liquid"),
    "leak": (
        lambda value: f"{_share('the highest pressure')(value)}, as by a leak,",
        "check the hose for leaks, and the highest readings",
    ),
}  # fmt: skip


def corrections(fit: LeastSquaresFit) -> list[str]:
    """A sentence on each correction that is larger than expected."""
    said = []
    for p, away in _away(fit):
        value = fit.values[p.name]
        if abs(away) > REPORTED or (p.unit == "" and abs(value) > PLAIN):
            says, advice = WORDS[p.own_name]
            of = f"{p.device}: " if p.device else ""
            said.append(
                f"{of}corrected: the fit takes {says(value)} ({abs(away):.1f} times what is expected of a bench); {advice}"
            )
    return said


def unbelievable(fit: LeastSquaresFit) -> list[str]:
    """A sentence on each correction of the pressures that no bench needs."""
    said = []
    for p, away in _away(fit):
        if p.own_name not in ("scale", "zero") and abs(away) > BELIEVED:
            says, advice = WORDS[p.own_name]
            of = f"{p.device}: " if p.device else ""
            said.append(
                f"{of}to follow the outlines the fit takes {says(fit.values[p.name])} {abs(away):.0f} times what is "
                f"believable: pressures and outlines contradict each other; {advice}, or fix it (--fix {p.name})"
            )
    return said


def _away(fit: LeastSquaresFit) -> list[tuple[Parameter, float]]:
    """Corrections with how many standard errors of their prior they are."""
    return [
        (p, (fit.values[p.name] - p.prior.mean) / p.prior.error)
        for p in fit.free
        if p.own_name in WORDS and p.prior and math.isfinite(fit.values[p.name])
    ]


# ----------------------------------------------------------------------------------------------------------------------
# Which photographs contradict the others, where a fit of all of them is beyond chance: named, with what they should say.
#
# Two witnesses. The course of pressures over heights needs no law and finds gross mistakes (`pressure_course`). The
# fit finds fine ones: its exact derivatives tell how well it would follow the others without each of them, and a fit without
# those that it names confirms it. A law that cannot follow a silicone fails smoothly, most at the ends of the series: there a
# small misfit names no photograph.


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


def by_course(rows: Sequence[HeightRow]) -> WrongRows | None:
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
    fit: LeastSquaresFit, names: Sequence[str], rows: Sequence[HeightRow], good: Callable[[Sequence[str]], bool]
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


def _fine(name: str, rows: Sequence[HeightRow]) -> str:
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


# ----------------------------------------------------------------------------------------------------------------------
# Whether a fit to outlines or heights may be used: chi squared, what the device and the bench can be, and wrong rows.


MODEL_SHAPE = 0.03
"""Root mean square distance from an outline, over its height, that a law and a mesh may leave."""
MODEL_PRESSURE = 0.05
"""The same of a reading."""
ERRORS = 5.0
"""Misfits below this many standard errors are none, however small the height."""


def judge_outlines(
    sources: Sequence[OutlineResiduals],
    fit: LeastSquaresFit,
    rows: Sequence[Sequence[HeightRow]],
    good: Callable[[Sequence[str]], bool],
) -> Judgement:
    """Hold a fit to outlines against chance, and against what a device and a bench can be.

    Args:
        sources: The outlines of each device.
        fit: Their fit.
        rows: Of each device the series of its pressures over its heights.
        good: Whether a fit without photographs of these names is within chance.
    """
    bad: list[int] = []
    warnings: list[str] = []
    for k, (source, residuals) in enumerate(zip(sources, residuals_by_source(sources, fit.residuals), strict=True)):
        found = {name: pair for name, pair in misfits(source, residuals).items() if fits_badly(*pair)}
        bad += [k] if found else []
        of = f" of {source.device}" if source.device else ""
        warnings += [
            f"{f'the pressures{of}' if name == source.readings else name}: the law cannot follow "
            f"{'them' if name == source.readings else 'it'} (chi squared {chi2:.0f} of {count} values)"
            for name, (chi2, count) in found.items()
        ]
    for k in bad:
        wrong = by_course(rows[k]) or by_fit(fit, _photographs(sources, k, fit), rows[k], good)
        if wrong:  # what the fit has bent to follow it means nothing
            return Judgement((wrong.whole,), tuple(warnings))
    objections = (*(text for k in bad for text in _beyond(sources[k], fit)), *unbelievable(fit))
    return Judgement(objections, tuple(warnings), () if objections else tuple(corrections(fit)))


def judge_heights(source: HeightResiduals, fit: LeastSquaresFit) -> Judgement:
    """Hold a fit to heights against what a law and a mesh may leave."""
    left = np.abs(fit.residuals[: fit.count]) / 1e3
    i = int(np.argmax(left / source.measured))
    if left[i] > MODEL_PRESSURE * source.measured[i] + ERRORS * source.height_errors[i]:
        one = source.heights[i]
        return Judgement(
            (
                f"the law does not follow the heights: {one.source} is {one.height * 1e3:.4g} mm high and would be "
                f"{left[i] * 1e3:.3g} mm off at {reading(one.pressure)}; check the pressures, the geometry of the case and "
                "whether it is the part in the photographs, or try another law",
            )
        )
    return Judgement()


def within_chance(sources: Sequence[OutlineResiduals], fit: LeastSquaresFit) -> bool:
    """Whether a fit follows every photograph and the readings within their errors, with a bench that can be."""
    parts = zip(sources, residuals_by_source(sources, fit.residuals), strict=True)
    return not any(fits_badly(*pair) for one in parts for pair in misfits(*one).values()) and not unbelievable(fit)


def _photographs(sources: Sequence[OutlineResiduals], k: int, fit: LeastSquaresFit) -> list[str]:
    """Name of the photograph of each measured residual of the k-th source; that of a reading is its photograph's."""
    source, before = sources[k], sum(one.count for one in sources[:k])
    outlines = source.groups.tolist()[: source.count - len(source.shapes)]
    names = [*[""] * before, *outlines, *(shape.source for shape in source.shapes)]
    return [*names, *[""] * (fit.count - len(names))]


def _beyond(source: OutlineResiduals, fit: LeastSquaresFit) -> list[str]:
    """What is beyond any law's and any mesh's error."""
    matches = source.matches(fit.values)
    away = [float(np.sqrt(np.mean(one.distances**2))) for one in matches]
    limits = [MODEL_SHAPE * one.shape.height + ERRORS * float(np.median(one.shape.error)) for one in matches]
    shapes = [i for i in range(len(matches)) if away[i] > limits[i]]
    if shapes:
        i = max(shapes, key=lambda k: away[k] / limits[k])
        return [
            f"{len(shapes)} of {len(matches)} outlines do not have the shape that the case's device takes: "
            f"{matches[i].shape.source} lies {away[i] * 1e3:.3g} mm (root mean square) off the closest state, at a height of "
            f"{matches[i].shape.height * 1e3:.4g} mm; are they of another device, or is the geometry of the case wrong?"
        ]
    off = [one.pressure - one.true_pressure for one in matches]
    share = [
        abs(by) / (MODEL_PRESSURE * abs(one.shape.pressure) + ERRORS * one.shape.pressure_error)
        for by, one in zip(off, matches, strict=True)
    ]
    i = int(np.argmax(share))
    if share[i] <= 1.0:
        return []
    shape = matches[i].shape
    return [
        f"the pressures do not go with the outlines: {shape.source} would take {reading(shape.pressure + off[i])}, its row "
        f"says {reading(shape.pressure)}, and no single row explains it; check the list of photographs, or try another law"
    ]
