"""Rows of a list of photographs that are wrong: named without a law, by the fit, and never written as fitted.toml."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from softmodels.fitting.comparison import expected, objection
from softmodels.fitting.outlines.checks import HeightRow, by_course, wrong_readings
from softmodels.fitting.problem import FitError
from softmodels.materials.laws import NeoHookean, Yeoh

HEIGHTS = np.linspace(0.5e-3, 4.2e-3, 7)
UNIT = 120.0 * HEIGHTS * (1 + 2e4 * HEIGHTS**2)
"""Simulated pressures for a modulus of 1 Pa."""


def series(hardening=0.3, seed=0, heights=HEIGHTS):
    """A series whose apparent modulus grows by a share up to the highest, with the readings' scatter."""
    rng = np.random.default_rng(seed)
    unit = np.interp(heights, HEIGHTS, UNIT)
    pressures = 28e3 * (1 + hardening * (heights / heights.max()) ** 2) * unit + 10.0 * rng.standard_normal(
        len(heights)
    )
    return [
        HeightRow(f"{i}.jpg", h, p, 10.0, 8e-6, u)
        for i, (h, p, u) in enumerate(zip(heights, pressures.tolist(), unit, strict=True))
    ]


def changed(rows, i, by):
    return [dataclasses.replace(row, pressure=by(row.pressure)) if k == i else row for k, row in enumerate(rows)]


def swapped(rows, i, j):
    one, two = rows[i].pressure, rows[j].pressure
    return changed(changed(rows, i, lambda p: two), j, lambda p: one)


@pytest.mark.parametrize("hardening", (0.0, 0.3, 1.0))
def test_a_smooth_series_has_no_contradiction(hardening):
    for seed in range(20):
        assert wrong_readings(series(hardening, seed)) == []


WRONG = {
    "ten times": (lambda rows: changed(rows, 4, lambda p: 10 * p), ("4.jpg",), "ten times as much"),
    "a tenth": (lambda rows: changed(rows, 2, lambda p: p / 10), ("2.jpg",), "a tenth of it"),
    "half": (lambda rows: changed(rows, 3, lambda p: p / 2), ("3.jpg",), "only one tube"),
    "sign": (lambda rows: changed(rows, 1, lambda p: -p), ("1.jpg",), "its sign is wrong"),
    "a copy of the next": (lambda rows: changed(rows, 3, lambda p: rows[4].pressure), ("3.jpg",), "times as much"),
    "the highest": (lambda rows: changed(rows, 6, lambda p: 2 * p), ("6.jpg",), "twice as much"),
    "exchanged neighbours": (lambda rows: swapped(rows, 2, 3), ("2.jpg", "3.jpg"), "seem exchanged"),
    "exchanged": (lambda rows: swapped(rows, 1, 5), ("1.jpg", "5.jpg"), "seem exchanged"),
}


@pytest.mark.parametrize(("damage", "names", "said"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_row_is_named(damage, names, said):
    found = by_course(damage(series()))
    assert found is not None and set(found.names) == set(names)
    assert said in found.sentence and all(f"--exclude {name}" in found.advice for name in names)


def test_the_expected_pressure_is_told():
    (one,) = wrong_readings(changed(series(), 4, lambda p: 10 * p))
    assert one.expected == pytest.approx(series()[4].pressure, rel=0.01) and one.factor == pytest.approx(10.0, rel=0.01)


def test_two_rows_make_no_course():
    assert by_course(changed(series(), 4, lambda p: 10 * p)[3:5]) is None


@pytest.mark.parametrize(
    ("factor", "said"),
    ((0.1, "mm listed as cm"), (10.5, "kPa"), (0.5, "only one tube"), (1.0, ""), (1.2, "")),
)
def test_a_modulus_of_another_unit_is_none_of_its_silicone(factor, said):
    """c1 of 14 kPa, as Ecoflex 00-30 has by one of its sources, times what a wrong unit makes of it."""
    found = objection(Yeoh(factor * 13.5e3, factor * 60.0, 0.0, 0.5), 2.0, expected("ecoflex-00-30"))
    assert bool(found) == bool(said) and said in found


def test_what_is_expected_without_a_name():
    assert "case's own" in objection(NeoHookean(147e3), 2.0, expected(None, NeoHookean(30e3)))
    assert not objection(NeoHookean(60e3), 2.0, expected(None, NeoHookean(30e3)))
    assert not objection(NeoHookean(147e3), 2.0, expected("any", NeoHookean(30e3)))
    assert "casting silicones" in objection(NeoHookean(1.4e3), 2.0, expected("any"))
    with pytest.raises(FitError, match="'play-doh' is unknown"):
        expected("play-doh")
