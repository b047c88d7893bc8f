"""The water column: centimetres to pascals with their errors, and readings that are none."""

from __future__ import annotations

import numpy as np
import pytest

from measurement.series.photo_list import Column, ColumnError

G = 9.80665


@pytest.mark.parametrize(
    ("text", "pascal"),
    [
        ("1 cm", 0.01 * 970.0 * G),
        ("177cm", 1.77 * 970.0 * G),
        ("12.5 mm", 0.0125 * 970.0 * G),
        ("0", 0.0),
        ("-3 cm", -0.03 * 970.0 * G),
        ("1.2 kPa", 1200.0),
        ("15 mbar", 1500.0),
        ("35 mmH2O", 35 * G),
        ("3.5 cm_H2O", 35 * G),
    ],
)
def test_readings(text, pascal):
    assert Column().read(text)[0] == pytest.approx(pascal, rel=1e-12)


def test_the_thesis_column():
    """0.97 g/ml: one centimetre is 95.1 Pa."""
    assert Column().read("1 cm")[0] == pytest.approx(95.1, abs=0.05)
    assert Column(density=1000.0).read("10 cm")[0] == pytest.approx(980.665)


def test_two_tubes():
    column = Column()
    assert column.read_tubes("31.2 cm", "18.7 cm") == pytest.approx(column.read("12.5 cm"))
    assert column.read_tubes("10 cm", "12 cm")[0] < 0.0
    assert column.read_tubes("5 cm", "0")[0] == pytest.approx(column.read("5 cm")[0])


def test_errors_are_those_of_two_readings_and_the_density():
    column = Column(density=970.0, density_error=5.0, reading_error=1e-3)
    rng = np.random.default_rng(0)
    levels = rng.normal([0.8, 0.3], 1e-3, (200_000, 2))
    samples = rng.normal(970.0, 5.0, 200_000) * G * (levels[:, 0] - levels[:, 1])
    pressure, error = column.read_tubes("80 cm", "30 cm")
    assert pressure == pytest.approx(samples.mean(), rel=1e-4)
    assert error == pytest.approx(samples.std(), rel=0.01)


def test_given_errors():
    column = Column(density_error=0.0)
    assert column.read("10 cm", "2 mm")[1] == pytest.approx(0.002 * 970.0 * G)
    assert column.read("10 cm", "7 Pa")[1] == 7.0
    assert column.read("2 kPa")[1] == pytest.approx(20.0)
    # A density's error stays where only the reading's was given.
    assert Column(density_error=97.0).read("10 cm", "0 mm")[1] == pytest.approx(0.1 * 0.1 * 970.0 * G)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("12.5", "has no unit"),
        ("high", "neither a column of water"),
        ("much", "neither a column of water"),
        ("cm", "neither a column of water"),
        ("", "neither a column of water"),
        ("3 kg", "neither a column of water"),
        ("nan cm", "neither a column of water"),
        ("x mmH2O", "is not a number"),
        ("inf cmH2O", "is not a finite number"),
        ("inf cm", "neither a column of water"),
    ],
)
def test_what_is_no_reading(text, reason):
    with pytest.raises(ColumnError, match=reason):
        Column().read(text)


def test_bad_errors_levels_and_columns():
    with pytest.raises(ColumnError, match="negative"):
        Column().read("3 cm", "-1 mm")
    with pytest.raises(ColumnError, match="not the level of a tube"):
        Column().read_tubes("3 kPa", "1 cm")
    for change, reason in (
        ({"density": 0.0}, "must be positive"),
        ({"density": float("nan")}, "must be positive"),
        ({"density_error": -1.0}, "density_error"),
        ({"reading_error": float("inf")}, "reading_error"),
    ):
        with pytest.raises(ColumnError, match=reason):
            Column(**change)
