"""Quantities: a number and a unit, nothing else; what people type otherwise is refused by name, never read as another value."""

from __future__ import annotations

import random
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from measurement.cli import photos
from measurement.series.photo_list import Column, ColumnError
from softmodels.common import units
from softmodels.common.units import FACTORS, UnitError, exact_text, number, quantity

READ = [
    ("20 mm", "m", 0.02),
    ("20mm", "m", 0.02),
    ("-1.5e-1 cm", "m", -0.0015),
    ("+.5 mm", "m", 0.0005),
    ("5.mm", "m", 0.005),
    ("2 µm", "m", 2e-6),
    ("1 in", "m", 0.0254),
    ("0", "m", 0.0),
    (0, "Pa", 0.0),
    ("30 kPa", "Pa", 30e3),
    ("5 N/mm^2", "Pa", 5e6),
    ("5 N mm^-2", "Pa", 5e6),
    ("5 kg/(m s^2)", "Pa", 5.0),
    ("100 cmH2O", "Pa", 9806.65),
    ("0.97 g/ml", "kg/m^3", 970.0),
    ("970 kg/m³", "kg/m^3", 970.0),
    ("18 mm**2", "m^2", 18e-6),
    ("50kN/m", "N/m", 50e3),
    ("45deg", "degree", 45.0),
    ("1 turn", "degree", 360.0),
    ("0.49", "", 0.49),
    ("5 %", "", 0.05),
    (0.49, "", 0.49),
    ("1 mm/cm", "", 0.1),
]


@pytest.mark.parametrize(("text", "unit", "value"), READ)
def test_a_number_and_a_unit(text, unit, value):
    assert quantity(text, unit) == pytest.approx(value, rel=1e-14, abs=0.0)


REFUSED = [
    ("1,5mm", "m", "'1,5mm' has a decimal comma; write 1.5mm"),
    ("12,5 mm", "m", "write 12.5 mm"),
    ("20,5kPa", "Pa", "write 20.5kPa"),
    ("998,2 kg/m^3", "kg/m^3", "write 998.2 kg/m^3"),
    ("0,49", "", "write 0.49"),
    (",5 mm", "m", "decimal comma"),
    ("1,000 mm", "m", "1.000 mm (or 1000 mm, if it separates thousands)"),
    ("1,000.5 mm", "m", "commas between its digits"),
    ("1.000,5 mm", "m", "commas between its digits"),
    ("10 0mm", "m", "space or the like between its digits"),
    ("5 647 Pa", "Pa", "such as 5647 Pa"),
    ("5\u202f647 Pa", "Pa", "such as 5647 Pa"),
    ("5'647 Pa", "Pa", "such as 5647 Pa"),
    ("5_647 Pa", "Pa", "such as 5647 Pa"),
    ("--2mm", "m", "write it like 20mm"),
    ("mm", "m", "write it like 20mm"),
    ("", "m", "write it like 20mm"),
    ("9**9**9 mm", "m", "write it like 20mm"),
    ("9 mm^9^9^9", "m", "write it like 20mm"),
    ("9 mm^999999999", "m", "write it like 20mm"),
    ("2*3mm", "m", "write it like 20mm"),
    ("2 mm 3", "m", "write it like 20mm"),
    ("2 mm; 3 mm", "m", "write it like 20mm"),
    ("(2)mm", "m", "write it like 20mm"),
    ("0x10 mm", "m", "write it like 20mm"),
    ("٣ mm", "m", "write it like 20mm"),
    ("20", "m", "has no unit"),
    (20, "N/m", "has no unit; write it like 50kN/m"),
    ("20 mn", "m", "unknown unit"),
    ("20 kPa", "m", "cannot be read in m"),
    ("45", "degree", "has no unit"),
    ("50 %", "degree", "cannot be read in degree"),
    ("3 deg", "", "cannot be read in pure numbers"),
    ("nan mm", "m", "finite"),
    ("1e400 mm", "m", "finite"),
    (float("inf"), "", "finite"),
    (10**400, "", "finite"),
    (16**5000, "m", "finite"),
    ("9" * 400 + " mm", "m", "(403 characters)"),
    ("9" * 5000, "", "(5000 characters)"),
    ("1 " + "m" * 5000, "m", "characters)"),
    ("1 " + "(" * 90 + "m", "m", "mm"),
    (True, "", "True is not a number"),
    ([1], "m", "[1] is not a number"),
    ({"a": 1}, "m", "a table is not a number"),
    (None, "", "None is not a number"),
]


@pytest.mark.parametrize(("text", "unit", "words"), REFUSED, ids=range(len(REFUSED)))
def test_all_else_is_refused(text, unit, words):
    with pytest.raises(UnitError) as refused:
        quantity(text, unit)
    assert words in str(refused.value)
    assert len(str(refused.value)) < 250


def test_numbers_alone():
    assert [number(value) for value in ("1", " -2.5e3 ", 3, 0.1)] == [1.0, -2500.0, 3.0, 0.1]
    for value in ("1_0", "1,5", "1 0", "inf", "1 mm", "", "1e", True, [1], None):
        with pytest.raises(UnitError):
            number(value)


def test_texts_of_values_are_read_back_exactly():
    rng = random.Random(5)
    for unit in ("m", "Pa", "degree", "kg/m^3", "N/m", "m^3", ""):
        for _ in range(100):
            value = rng.uniform(-1, 1) * 10 ** rng.uniform(-12, 9)
            assert quantity(exact_text(value, unit), unit) == value


@pytest.mark.parametrize("unit", FACTORS)
def test_common_units_are_pints(unit, monkeypatch):
    own = {text: quantity(f"0.7 {text}", unit) for text in FACTORS[unit]}
    monkeypatch.setattr(units, "FACTORS", {})
    assert {text: quantity(f"0.7 {text}", unit) for text in own} == pytest.approx(own, rel=1e-15, abs=0.0)


# -- The water column: centimetres to pascals with their errors, and readings that are none --------------------------


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


def test_the_page_of_units_is_complete():
    """It lists every unit that is read without Pint, in its kind's row, and each unit it names is read in that kind."""
    text = (Path(__file__).parents[2] / "docs" / "pages" / "howto" / "units.md").read_text(encoding="utf-8")
    rows = [set(re.findall(r"`([^`]+)`", row)) for row in re.findall(r"^\| [^|]+ \|([^|]+)\| [^|`]+ \|$", text, re.MULTILINE)]
    for unit, factors in units.FACTORS.items():
        (row,) = [row for row in rows if set(factors) <= row]
        for name in row - {"0.05"}:
            assert units.quantity(f"1 {name}", unit) > 0.0
    water = units.Column(1e3)
    assert water.pascal == pytest.approx(98.0665) and water.text(196.133) == "2 cm"
    assert water.full(-49.03325, ".2f") == "-0.50 cm, 1 g/ml"
    assert f"{units.COLUMN.pascal:.1f} Pa" in text and units.DENSITY_NOTE.split(" water")[0] in text


def test_a_height_and_its_error_are_printed_in_one_unit():
    outcome = SimpleNamespace(height=-1e-8, height_error=2.2e-6, trusted=True)
    photograph = SimpleNamespace(file=Path("a.jpg"), pressure=0.0)
    line = photos._line(SimpleNamespace(outcome=outcome, photograph=photograph))
    assert line.split("  ")[-1].strip() == "0.0000 +- 0.0022 mm"
