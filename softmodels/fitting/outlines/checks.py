"""Check outlines against the device before fitting: its shape at a measured height hardly depends on the law."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import numpy.typing as npt

from softmodels.common import units
from softmodels.common.arrays import Array
from softmodels.fitting import comparison, least_squares, problem
from softmodels.fitting.outlines import device, inflations, residuals
from softmodels.fitting.outlines.shapes import Shape, half_outline, shadow_of
from softmodels.runs import grid

# ----------------------------------------------------------------------------------------------------------------------
# Detect single photographs that contradict the others from heights and pressures, without a law.
#
# The pressure of a device at a height depends, up to a factor, on its shape: the reading, minus the share of dead loads, over
# the simulated pressure at the same height is an apparent shear modulus. It is a smooth function of the height for any
# silicone, before and past limit points. A wrong pressure, a wrong photograph or two exchanged ones deviate from it.


SMOOTH_CURVE_ERRORS = (0.30, 0.04, 0.01, 0.01)
"""Relative errors of a smooth curve with one to four terms, for the nonlinearity of silicones."""
TERMS = {3: 1, 4: 2, 5: 2, 6: 2, 7: 3, 8: 3}
"""Number of terms by the number of rows; 4 for more rows. None for fewer than three rows."""
MAX_CURVE_ERRORS = 5.0
"""Distance from the others' curve, in errors, above which a row contradicts it."""
MOST_SUBSETS = 3000
MIN_GROSS_FACTOR = 1.15
"""At its ends the curve is uncertain: only factors above this count there."""

EXCHANGE_TOLERANCE = 0.15
"""Relative tolerance for detecting exchanged rows."""
MIN_EXCHANGE_RATIO = 2.0
"""Minimum ratio of the scatter of any other exchange to that of the best one."""


@dataclasses.dataclass(frozen=True, eq=False)
class HeightRow:
    """One photograph in the series: height of the top in m and reading in Pa, with standard errors.

    Attributes:
        unit: Simulated pressure in Pa at this height for a shear modulus of 1 Pa, that of dead loads left out.
        borne: Pressure in Pa that the dead loads take at this height.
        silent: Whether that share is so large that the reading is uninformative about the silicone.
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
        """Share of the reading carried by the silicone, in Pa."""
        return self.pressure - self.borne

    def reading(self, modulus: float) -> float:
        """Return the pressure in Pa for an apparent shear modulus in Pa."""
        return modulus * self.unit + self.borne


@dataclasses.dataclass(frozen=True)
class WrongReading:
    """A row contradicted by the others: its name, reading and expected pressure in Pa."""

    source: str
    pressure: float
    expected: float

    @property
    def factor(self) -> float:
        return self.pressure / self.expected

    @property
    def gross(self) -> bool:
        return not 1 / MIN_GROSS_FACTOR < self.factor < MIN_GROSS_FACTOR


def wrong_readings(rows: Sequence[HeightRow]) -> list[WrongReading]:
    """Return the rows contradicted by the smooth curve of the others; empty for fewer than three rows."""
    rows = _telling_rows(rows)
    if len(rows) < min(TERMS):
        return []
    inside = _rows_on_curve(rows)
    if inside is None:
        return []
    wrong_readings = []
    x = np.array([row.height for row in rows])
    ends = x[inside].min(), x[inside].max()
    for i in np.flatnonzero(~inside).tolist():
        row, expected = rows[i], rows[i].reading(expected_modulus(rows, inside, rows[i].height))
        wrong_reading = WrongReading(row.source, row.pressure, expected)
        if ends[0] <= row.height <= ends[1] or wrong_reading.gross:
            wrong_readings.append(wrong_reading)
    return wrong_readings


def expected_without(rows: Sequence[HeightRow], names: Sequence[str], row: HeightRow) -> float:
    """Return the pressure in Pa at a row's height predicted without the named rows; its own if none is usable."""
    rows = _telling_rows(rows)
    inside = np.array([other_row.source not in names and other_row.elastic > 0.0 for other_row in rows])
    if not inside.any():
        return row.pressure
    return row.reading(expected_modulus(rows, inside, row.height))


def exchanged(rows: Sequence[HeightRow]) -> tuple[WrongReading, WrongReading] | None:
    """Return the two rows whose exchange removes all contradictions; None if there is no unique pair."""
    rows, exchanges = _telling_rows(rows), []
    for a, b in itertools.combinations(range(len(rows)), 2):
        swapped = list(rows)
        swapped[a] = dataclasses.replace(rows[a], pressure=rows[b].pressure)
        swapped[b] = dataclasses.replace(rows[b], pressure=rows[a].pressure)
        inside = _rows_on_curve(swapped)
        if inside is not None and inside.all():
            exchanges.append((_spread(swapped), a, b))
    exchanges.sort()
    if not exchanges or (len(exchanges) > 1 and exchanges[1][0] < MIN_EXCHANGE_RATIO * exchanges[0][0]):
        return None
    pair = [rows[k] for k in exchanges[0][1:]]
    names = [row.source for row in pair]
    first, two = (WrongReading(row.source, row.pressure, expected_without(rows, names, row)) for row in pair)
    meet = (
        abs(first.pressure / two.expected - 1.0) < EXCHANGE_TOLERANCE
        and abs(two.pressure / first.expected - 1.0) < EXCHANGE_TOLERANCE
    )
    return (first, two) if meet else None


def _telling_rows(rows: Sequence[HeightRow]) -> list[HeightRow]:
    return [row for row in rows if not row.silent]


def _spread(rows: Sequence[HeightRow]) -> float:
    """Return the rms distance of all rows from their curve, in errors."""
    A, y, error = _system(rows, max(row.height for row in rows), _terms(len(rows)))
    return float(np.sqrt(np.mean(((y - A @ _course(A, y, error)) / error) ** 2)))


def _system(rows: Sequence[HeightRow], width: float, terms: int) -> tuple[Array, Array, Array]:
    """Return basis (n, terms), logarithms of the apparent moduli, inf where there is none, and their errors (n,)."""
    A = _basis(np.array([row.height for row in rows]), width, terms)
    y = np.array([math.log(row.elastic / row.unit) if row.elastic > 0.0 else math.inf for row in rows])
    return A, y, np.array([_error(row, terms) for row in rows])


def _course(A: Array, y: Array, error: Array) -> Array:
    return np.asarray(np.linalg.lstsq(A / error[:, None], y / error, rcond=None)[0])


def expected_modulus(rows: Sequence[HeightRow], inside: npt.NDArray[np.bool_], height: float) -> float:
    """Return the apparent shear modulus in Pa predicted by the rows ``inside`` at a height in m."""
    kept = [row for row, sure in zip(rows, inside, strict=True) if sure and row.elastic > 0.0]
    terms = min(_terms(len(rows)), max(len(kept) - 1, 1))
    width = max(row.height for row in rows)
    low, high = (pick(row.height for row in kept) for pick in (min, max))
    if not low <= height <= high:  # no further than linear extrapolation
        terms = min(terms, 2)
    course = _course(*_system(kept, width, terms))
    return math.exp(float((_basis(np.array([height]), width, terms) @ course)[0]))


def _terms(count: int) -> int:
    return TERMS.get(count, 4)


def _basis(heights: Array, width: float, terms: int) -> Array:
    return np.vander((heights / width) ** 2, terms, increasing=True)


def _error(row: HeightRow, terms: int) -> float:
    """Return the relative standard error of a row's apparent modulus, from its reading, its height and the curve."""
    reading = 2.0 * row.pressure_error / max(abs(row.elastic), row.pressure_error)
    return math.sqrt(reading**2 + (2.0 * row.height_error / row.height) ** 2 + SMOOTH_CURVE_ERRORS[terms - 1] ** 2)


def _rows_on_curve(rows: Sequence[HeightRow]) -> npt.NDArray[np.bool_] | None:
    """Return which rows lie on the curve shared by most; None if less than half do."""
    count, terms = len(rows), _terms(len(rows))
    sane = [i for i, row in enumerate(rows) if row.elastic > 0.0]
    if len(sane) <= count / 2 or len(sane) < terms:
        return None
    width = max(row.height for row in rows)
    A, y, error = _system(rows, width, terms)
    best: tuple[float, npt.NDArray[np.bool_]] | None = None
    for chosen in _subsets(sane, terms):
        pick = list(chosen)
        try:
            course = np.linalg.solve(A[pick], y[pick])
        except np.linalg.LinAlgError:
            continue
        away = np.abs(y - A @ course) / error
        inside = away < MAX_CURVE_ERRORS
        # The curve with the most rows; of those the closest.
        cost = float(np.minimum(away, MAX_CURVE_ERRORS).sum())
        if best is None or cost < best[0]:
            best = cost, inside
    if best is None or best[1].sum() <= max(count / 2, terms):
        return None
    inside = best[1]
    for _ in range(3):  # from interpolation of a few points to least squares of all consistent ones
        pick = np.flatnonzero(inside).tolist()
        inside = np.abs(y - A @ _course(A[pick], y[pick], error[pick])) / error < MAX_CURVE_ERRORS
        if inside.sum() <= terms:
            return None
    return inside


def _subsets(indices: Sequence[int], size: int) -> list[tuple[int, ...]]:
    """Return all subsets, or a fixed selection of them."""
    if math.comb(len(indices), size) <= MOST_SUBSETS:
        return list(itertools.combinations(indices, size))
    rng = np.random.default_rng(0)
    return [tuple(sorted(rng.choice(indices, size, replace=False).tolist())) for _ in range(MOST_SUBSETS)]


MIN_WIDTH_RATIO, MAX_WIDTH_RATIO = 0.82, 1.22
"""Maximum ratio of measured to simulated width at half the height."""
OUTLINE_SPACING = 2e-5


def series_of(
    model: device.DeviceModel, sources: Sequence[str], heights: Array, pressures: Array, pressure_errors: Array, errors: Array
) -> tuple[list[HeightRow], list[grid.QuadraticCurve]]:
    """Return the series of photographs with the pressure of the device, under any law, at each height, and its curve there.
    Heights are in m and readings in Pa, with standard errors, shape (n,).

    Raises `OutlineFitError` where the device cannot rise as high as was measured.
    """
    plain = residuals.plain_path(model, heights, pressures)
    model.set_parameters(plain.values)
    columns = (heights, pressures, pressure_errors, errors, plain.elastic / model.modulus, plain.borne, plain.silent)
    rows = [HeightRow(*row) for row in zip(sources, *(column.tolist() for column in columns), strict=True)]
    return rows, [model.curve(state) for state in plain.states]


def series_of_shapes(model: device.DeviceModel, shapes: Sequence[Shape]) -> list[HeightRow]:
    """Return the series of outlines; `UnsoundError` if their shapes are another device's."""
    columns = [(shape.height, shape.pressure, shape.pressure_error, float(np.median(shape.error))) for shape in shapes]
    rows, curves = series_of(model, [shape.source for shape in shapes], *np.array(columns).T)
    _check_widths(shapes, curves, type(model.system.body.actuator).__name__)
    return rows


def _check_widths(shapes: Sequence[Shape], curves: Sequence[grid.QuadraticCurve], device: str) -> None:
    measured = np.array([_width(shape.points, shape.height / 2) for shape in shapes])
    halves = [half_outline(shadow_of(curve).curve, OUTLINE_SPACING)[0] for curve in curves]
    simulated = 2.0 * np.array([half[half[:, 1] > s.height / 2, 0].max() for half, s in zip(halves, shapes, strict=True)])
    share = measured / simulated
    if MIN_WIDTH_RATIO <= float(np.median(share)) <= MAX_WIDTH_RATIO:
        return
    i = int(np.argmin(np.abs(share - np.median(share))))
    extent = f"between {share.min():.2f} and {share.max():.2f} times as wide" if len(share) > 1 else "so"
    raise problem.UnsoundError(
        f"these outlines belong to another device: {shapes[i].source} rises {shapes[i].height * 1e3:.4g} mm and is "
        f"{measured[i] * 1e3:.4g} mm wide at half its height, where the case's {device} is {simulated[i] * 1e3:.4g} mm wide "
        f"(all outlines: {extent}); give the case of the part in the photographs, or check the unit of their grid"
    )


def _width(points: Array, level: float) -> float:
    """Return the distance in m of the outermost points (n, 2) above a level."""
    up = np.flatnonzero(points[:, 1] > level)
    return float(points[up[-1], 0] - points[up[0], 0]) if len(up) else 0.0


# ----------------------------------------------------------------------------------------------------------------------
# Bench corrections of a fit, in words: reported if large, rejected if implausible.


REPORTED_ERRORS = 1.0
"""Corrections above this many standard errors of their prior are reported."""
REPORTED_FRACTION = 0.01
"""So are fractions above this."""
MAX_PRESSURE_ERRORS = 5.0
"""Corrections of pressures above this many standard errors of their prior are rejected, because outlines do not show them."""


def _share(what: str) -> Callable[[float], str]:
    return lambda value: f"{what} too {'large' if value > 0.0 else 'small'} by {abs(value):.2%}".replace("%", " %")


def _zero(value: float) -> str:
    where = (
        "below the undeformed top, so that heights are too large" if value > 0.0 else "above the undeformed top: it has sunk"
    )
    return f"the zero plane {abs(value) * 1e3:.3g} mm {where}"


def _off_base(above: str, below: str) -> Callable[[float], str]:
    return lambda value: f"the middle of the base {abs(value) * 1e3:.3g} mm {above if value > 0.0 else below} than was measured"


def _length(name: str, nominal: float) -> Callable[[float], str]:
    return lambda value: f"{name} {value * 1e3:.4g} mm, not {nominal * 1e3:.4g} mm"


FACTOR_TEXTS: dict[str, tuple[Callable[[float], str], str]] = {
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
}


VIEW_TEXTS: dict[str, tuple[Callable[[float], str], str]] = {
    "scale": (_share("all lengths in the photographs"), "check the scale and how far the device is before it (--ahead)"),
    "zero": (_off_base("higher", "lower"), "check the pixels of --base"),
    "centre": (_off_base("farther right", "farther left"), "check the pixels of --base"),
}
"""The same for side views."""


def corrections(fit: least_squares.LeastSquaresFit) -> list[str]:
    """Return a sentence on each correction that is larger than expected."""
    return [
        f"{of}corrected: the fit assumes {says} ({abs(away):.1f} times the expected error); {advice}"
        for p, away, of, says, advice in _large_corrections(fit)
        if abs(away) > REPORTED_ERRORS or (p.unit == "" and abs(fit.values[p.name]) > REPORTED_FRACTION)
    ]


def unbelievable(fit: least_squares.LeastSquaresFit) -> list[str]:
    """Return a sentence on each implausible correction of the pressures."""
    return [
        f"{of}to fit the outlines, the fit assumes {says} {abs(away):.0f} times "
        f"the plausible value: pressures and outlines contradict each other; {advice}, or fix it (--fix {p.name})"
        for p, away, of, says, advice in _large_corrections(fit)
        if p.own_name in FACTOR_TEXTS and p.own_name not in ("scale", "zero") and abs(away) > MAX_PRESSURE_ERRORS
    ]


def _large_corrections(fit: least_squares.LeastSquaresFit) -> Iterator[tuple[problem.Parameter, float, str, str, str]]:
    """Yield the corrections, with how many standard errors of their prior they are, whose they are, what they say, and the
    advice."""
    from_the_side = {p.device for p in fit.parameters if p.own_name == problem.TILT}
    for p in fit.free:
        texts = FACTOR_TEXTS | (VIEW_TEXTS if p.device in from_the_side else {})
        if (p.own_name in texts or residuals.is_length(p)) and p.prior and math.isfinite(value := fit.values[p.name]):
            says, advice = texts.get(p.own_name) or (_length(p.own_name, p.prior.mean), "measure it on the cast part")
            yield p, (value - p.prior.mean) / p.prior.error, f"{p.device}: " if p.device else "", says(value), advice


WALL_SHARES = (1, 3)
"""Change of a law's stresses in percent by 1 % of a wall's thickness: stretched like a membrane, bent like a plate."""


def exact_lengths(source: residuals.OutlineResiduals | residuals.HeightResiduals, fit: least_squares.LeastSquaresFit) -> str:
    """Return a sentence on the lengths of a device that a fit has taken as exact, and by how much the shear modulus changes
    with each, see `shifted`; or ""."""
    model, choice = source.model, source.model.choice
    whose = f"{source.device}: " if source.device else ""
    if not model.lengths:
        low, high = WALL_SHARES
        return (
            f"{whose}the lengths of the device are taken as exact: 1 % of the thickness of its walls changes the law's "
            f"stresses by {low} to {high} %, and no interval contains that; measure the walls of the cast part"
        )
    said, modulus = [], choice.material(fit.values).shear_modulus_0
    for p in residuals.length_parameters(model):
        name = p.name if p.name in fit.values else f"{source.device}.{p.name}"
        if p.name in source.considered:
            continue
        value = fit.values[name]
        off = residuals.LENGTH_ERROR * value
        moved = comparison.shifted(fit, choice, {name: value + off})
        share = 100 * abs(choice.material(moved).shear_modulus_0 / modulus - 1) if moved else math.nan
        much = f" changes the shear modulus by {share:.2g} %, and" if math.isfinite(share) else " changes the law;"
        option = f"measure it (--fix {p.name}={value * 1e3:.4g}mm)" if model.spectrum else f"--free {p.name} fits it too"
        said.append(
            f"{p.name} is taken as {value * 1e3:.4g} mm exactly: an error of {off * 1e3:.2g} mm{much} no interval contains "
            f"that; {option}"
        )
    return whose + "; ".join(said) if said else ""


# ----------------------------------------------------------------------------------------------------------------------
# Find photographs that contradict the others if a fit of all is beyond chance, with their expected values.
#
# Two methods. The smooth curve of pressures over heights needs no law and finds gross errors (above). The fit finds small ones:
# its exact derivatives predict the misfit without each photograph, and a fit without the suspects confirms it. A law that does
# not suit a silicone fails smoothly, most at the ends of the series: a small misfit there is not blamed on a photograph.


MIN_PHOTOGRAPHS = 4
"""Minimum number of photographs to identify a contradicting one."""
FACTORS = (
    (10.0, "ten times as much: a decimal place, or millimetres for centimetres"),
    (0.1, "a tenth of it: a decimal place, or centimetres for millimetres"),
    (2.0, "twice as much"),
    (0.5, "half of it: the level of only one tube"),
)
FACTOR_TOLERANCE = 0.08
"""Relative tolerance for recognising a known factor."""
READING_TOLERANCE = 0.015
"""Relative difference of a reading from its outline's pressure up to which the outline is blamed."""
DECISIVE_DEVIANCE = 10.0
"""Increase of the deviance above which one explanation is worse than another."""


@dataclasses.dataclass(frozen=True)
class WrongRows:
    """Photographs that contradict the others, by name unless none can be named, and a sentence on what is wrong with them;
    ``gross`` if a pressure is off by more than any law or bench explains."""

    names: tuple[str, ...]
    sentence: str
    gross: bool = False

    @property
    def advice(self) -> str:
        """The fix."""
        without = " ".join(f"--exclude {name}" for name in self.names)
        return f"correct the list of photographs, or exclude them: {without}"

    @property
    def whole(self) -> str:
        """The error and the fix."""
        return f"{self.sentence}; {self.advice}"


def by_course(rows: Sequence[HeightRow]) -> WrongRows | None:
    """Return the rows contradicted by the curve of the others; None if there are none."""
    contradicting = wrong_readings(rows)
    if not contradicting:
        return None
    pair = exchanged(rows)
    if pair is not None:
        first, two = pair
        said = (
            f"{first.source} and {two.source} seem exchanged: expected {reading(first.expected)} for the first and "
            f"{reading(two.expected)} for the second, but their rows have {reading(first.pressure)} and {reading(two.pressure)}"
        )
        return WrongRows((first.source, two.source), said, first.gross or two.gross)
    gross = any(contradicting_reading.gross for contradicting_reading in contradicting)
    return WrongRows(
        tuple(contradicting_reading.source for contradicting_reading in contradicting),
        "; ".join(map(_sentence, contradicting)),
        gross,
    )


def by_fit(
    fit: least_squares.LeastSquaresFit, names: Sequence[str], rows: Sequence[HeightRow], good: Callable[[Sequence[str]], bool]
) -> WrongRows | None:
    """Return the photographs without which the fit matches its errors, by excluding them in turn; ``good`` says whether a fit
    without photographs of these names is within chance.

    ``names`` has the photograph of each measured residual, shape (count,), other sources names of their own; the series is by
    rising pressure.
    """
    if len(rows) < MIN_PHOTOGRAPHS:
        return None
    ranked = left_out(fit, names, [row.source for row in rows])
    for deviance, chosen in ranked[:3]:
        rivals = [
            rank
            for other, rank in ranked
            if other < deviance + DECISIVE_DEVIANCE and len(rank) <= len(chosen) and rank != chosen
        ]
        if not good(chosen):
            continue
        if rivals and any(good(rival) for rival in rivals[:2]):
            all_named = tuple(dict.fromkeys(name for law in (chosen, *rivals) for name in law))
            return WrongRows(all_named, f"{' or '.join(all_named)} contradicts the others; the data do not show which")
        sentences = [_photograph_error(name, rows) for name in chosen]
        return WrongRows(chosen, "; ".join(filter(None, sentences))) if all(sentences) else None
    return None


def left_out(
    fit: least_squares.LeastSquaresFit, names: Sequence[str], photographs: Sequence[str]
) -> list[tuple[float, tuple[str, ...]]]:
    """Return the deviance of the others without one or two photographs, by the fit's derivatives; the lowest first, one before
    two."""
    labels, left_out = np.array([*names, *[""] * (len(fit.residuals) - fit.count)]), []
    size = np.linalg.norm(fit.jacobian, axis=0)
    J, r = fit.jacobian / np.where(size == 0.0, 1.0, size), fit.residuals
    for count in (1, 2):
        part = []
        for chosen in itertools.combinations(photographs, count):
            kept = ~np.isin(labels, chosen)
            step, *_ = np.linalg.lstsq(J[kept], -r[kept], rcond=1e-12)
            part.append((float(np.sum((r[kept] + J[kept] @ step) ** 2)), chosen))
        left_out += sorted(part)[:3]
    return left_out


def _photograph_error(name: str, rows: Sequence[HeightRow]) -> str:
    """Return the error of a photograph found by a fit; empty if an unsuitable law may be the reason."""
    i = next(k for k, row in enumerate(rows) if row.source == name)
    wrong_reading = WrongReading(name, rows[i].pressure, expected_without(rows, [name], rows[i]))
    order = sorted(range(len(rows)), key=lambda k: rows[k].height)
    if i in (order[0], order[-1]) and not wrong_reading.gross:
        return ""
    if abs(wrong_reading.factor - 1.0) > READING_TOLERANCE:
        return _sentence(wrong_reading)
    return (
        f"{name}: the others predict neither its outline nor its reading, {reading(wrong_reading.pressure)}, though their "
        "heights agree within a few percent: the part or the camera was moved for it, or its pressure is slightly off"
    )


def _sentence(wrong_reading: WrongReading) -> str:
    known = next((words for factor, words in FACTORS if abs(wrong_reading.factor / factor - 1.0) < FACTOR_TOLERANCE), "")
    if wrong_reading.factor < 0.0:
        known = "its sign is wrong" if abs(wrong_reading.factor + 1.0) < FACTOR_TOLERANCE else "it is negative"
    share = known or f"{wrong_reading.factor:.3g} times as much"
    return (
        f"{wrong_reading.source} contradicts the others: expected {reading(wrong_reading.expected)} at its height, its "
        f"row has {reading(wrong_reading.pressure)}, {share}"
    )


def reading(pressure: float) -> str:
    """Return a pressure in the bench's units, as text."""
    return f"{units.COLUMN.full(pressure)} ({pressure / 1e3:.4g} kPa)"


# ----------------------------------------------------------------------------------------------------------------------
# Acceptance of a fit to outlines or heights: chi squared, plausible device and bench, and wrong rows.


MODEL_SHAPE = 0.03
"""Maximum rms distance from an outline relative to its height, for law and mesh errors."""
MODEL_PRESSURE = 0.05
"""The same for a reading."""
MIN_MISFIT_ERRORS = 5.0
"""Misfits below this many standard errors are ignored, for any height."""


def judge_outlines(
    sources: Sequence[residuals.OutlineResiduals],
    fit: least_squares.LeastSquaresFit,
    rows: Sequence[Sequence[HeightRow]],
    good: Callable[[Sequence[str]], bool],
) -> least_squares.Judgement:
    """Check a fit to the outlines of each device, with the series of its pressures over its heights, against chance, and
    for a plausible device and bench; ``good`` is as of `by_fit`."""
    bad: list[int] = []
    warnings: list[str] = []
    for k, (source, remaining) in enumerate(zip(sources, residuals.residuals_by_source(sources, fit.residuals), strict=True)):
        bad_misfits = {name: pair for name, pair in residuals.misfits(source, remaining).items() if residuals.fits_badly(*pair)}
        bad += [k] if bad_misfits else []
        of = f" of {source.device}" if source.device else ""
        warnings += [
            f"{f'the pressures{of}' if name == source.readings else name}: the law cannot follow "
            f"{'them' if name == source.readings else 'it'} (chi squared {chi2:.0f} of {count} values)"
            for name, (chi2, count) in bad_misfits.items()
            if name not in fit.excess
        ]
    for k in bad:
        wrong = by_course(rows[k]) or by_fit(fit, _photographs(sources, k, fit), rows[k], good)
        if wrong:  # the parameters of such a fit are meaningless
            return least_squares.Judgement((wrong.whole,), tuple(warnings))
    objections = (*(text for k in bad for text in _large_misfits(sources[k], fit)), *unbelievable(fit))
    return least_squares.Judgement(objections, tuple(warnings), () if objections else tuple(corrections(fit)))


def judge_heights(source: residuals.HeightResiduals, fit: least_squares.LeastSquaresFit) -> least_squares.Judgement:
    """Check a fit to heights against law and mesh errors."""
    left = np.abs(fit.residuals[: fit.count]) / 1e3
    i = int(np.argmax(left / source.measured))
    if left[i] > MODEL_PRESSURE * source.measured[i] + MIN_MISFIT_ERRORS * source.height_errors[i]:
        height = source.heights[i]
        return least_squares.Judgement(
            (
                f"the law does not follow the heights: {height.source} is {height.height * 1e3:.4g} mm high, with a "
                f"residual of {left[i] * 1e3:.3g} mm at {reading(height.pressure)}; check the pressures, the geometry of the "
                f"case and whether it is the part in the photographs, or try another law",
            )
        )
    return least_squares.Judgement()


def judge_pressures(source: inflations.InflationResiduals, fit: least_squares.LeastSquaresFit) -> least_squares.Judgement:
    """Check a fit to a table of pressures against law and mesh errors."""
    left = fit.residuals[: fit.count] * source.errors
    if (share := float(np.sqrt(np.mean(left**2))) / float(np.abs(source.pressures).max())) <= MODEL_PRESSURE:
        return least_squares.Judgement()
    i = int(np.argmax(np.abs(left)))
    return least_squares.Judgement(
        (
            f"the law does not follow {source.label}: its residuals are {100 * share:.3g} % of the largest pressure (root mean "
            f"square), most at {source.size_of.text(float(source.measured[i]))}, where it has "
            f"{reading(float(source.pressures[i] + left[i]))} for {reading(float(source.pressures[i]))}; check units and the "
            "geometry of the case, or try another law",
        )
    )


def within_chance(sources: Sequence[residuals.OutlineResiduals], fit: least_squares.LeastSquaresFit) -> bool:
    """Return whether a fit matches every photograph and the readings within their errors, with a plausible bench."""
    parts = zip(sources, residuals.residuals_by_source(sources, fit.residuals), strict=True)
    return not any(
        residuals.fits_badly(*pair) for part in parts for pair in residuals.misfits(*part).values()
    ) and not unbelievable(fit)


def _photographs(sources: Sequence[residuals.OutlineResiduals], k: int, fit: least_squares.LeastSquaresFit) -> list[str]:
    """Return the name of the photograph of each measured residual of the k-th source; that of a reading is its photograph's."""
    source, before = sources[k], sum(earlier.count for earlier in sources[:k])
    outlines = source.groups.tolist()[: source.count - len(source.read)]
    names = [*[""] * before, *outlines, *(source.shapes[i].source for i in source.read)]
    return [*names, *[""] * (fit.count - len(names))]


def _large_misfits(source: residuals.OutlineResiduals, fit: least_squares.LeastSquaresFit) -> list[str]:
    """Return the misfits beyond any law's and mesh's error."""
    matches = source.matches(fit.values)
    away = [float(np.sqrt(np.mean(match.distances**2))) for match in matches]
    limits = [MODEL_SHAPE * match.shape.height + MIN_MISFIT_ERRORS * float(np.median(match.shape.error)) for match in matches]
    shapes = [i for i in range(len(matches)) if away[i] > limits[i]]
    if shapes:
        i = max(shapes, key=lambda k: away[k] / limits[k])
        return [
            f"{len(shapes)} of {len(matches)} {source.what} do not have the shape of the case's device: "
            f"{matches[i].shape.source} is {away[i] * 1e3:.3g} mm (root mean square) off the closest state, "
            f"{source.size_words} {matches[i].shape.height * 1e3:.4g} mm; are they of another device, or is "
            "the geometry of the case wrong?"
        ]
    off = [match.pressure - match.true_pressure for match in matches]
    share = [
        abs(by) / (MODEL_PRESSURE * abs(match.shape.pressure) + MIN_MISFIT_ERRORS * match.shape.pressure_error)
        for by, match in zip(off, matches, strict=True)
    ]
    i = int(np.argmax(share))
    if share[i] <= 1.0:
        return []
    shape = matches[i].shape
    return [
        f"the pressures do not match the {source.what}: {shape.source} needs {reading(shape.pressure + off[i])}, its "
        f"row has {reading(shape.pressure)}, and no single row explains it; check the list of photographs, or try another law"
    ]
