"""The zero plane: known lines with noise, dust and sides, and surfaces that are none."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from measurement.camera import Camera
from measurement.outline.zero import Bow, Sides, ZeroLine, sharpest_turn
from measurement.pictures import Unmeasurable
from measurement.screen.setup import Plane, Setup
from measurement.series import measuring as series
from measurement.series.checks import MIN_CREASE_TURN, level
from measurement.series.photo_list import Photograph

SLOPE = np.radians(7.0)
WAY, UP = np.array([np.cos(SLOPE), np.sin(SLOPE)]), np.array([-np.sin(SLOPE), np.cos(SLOPE)])
ALONG = np.linspace(-0.02, 0.02, 400)


def surface(height=0.0, noise=2e-6, seed=0):
    """Points, normals and errors of an upper side 3 mm above the origin."""
    off = height + noise * np.random.default_rng(seed).normal(size=len(ALONG))
    return ALONG[:, None] * WAY + (0.003 + off)[:, None] * UP, np.tile(UP, (len(ALONG), 1)), np.full(len(ALONG), 2e-6)


def test_a_known_line_with_dust_and_sides():
    points, normals, errors = surface()
    points[100:110] += 3e-4 * UP
    normals[:40] = -WAY  # the body's side
    points[:40] -= np.linspace(5e-3, 0.0, 40)[:, None] * UP
    line = ZeroLine.fit(points, normals, errors)
    assert np.degrees(np.arctan2(*line.direction[::-1])) == pytest.approx(7.0, abs=2e-3)
    placed = line.place(np.array([0.004 * UP + 0.01 * WAY]))[0]
    assert placed == pytest.approx([0.01, 0.001], abs=1e-6)
    assert line.extent == pytest.approx((ALONG[40], ALONG[-1]), abs=1e-6)


def test_stated_errors_are_true():
    misses = []
    for seed in range(60):
        points, normals, errors = surface(seed=seed)
        # Stations that lie side by side err together, as dust and the skin make them.
        points += np.repeat(3e-6 * np.random.default_rng(900 + seed).normal(size=40), 10)[:, None] * UP
        line = ZeroLine.fit(points, normals, errors)
        places = ALONG[::80]
        off = line.place(places[:, None] * WAY + 0.003 * UP)[:, 1]
        misses.append(off / line.error_at(places))
    assert 0.4 < np.mean(np.square(misses)) < 1.4


def test_through_two_points_in_any_order():
    ends = np.array([0.01 * WAY + 0.003 * UP, -0.01 * WAY + 0.003 * UP])
    for points in (ends, ends[::-1]):
        line = ZeroLine.through(points)
        assert line.direction == pytest.approx(WAY)
        assert line.place(np.array([0.005 * UP])) == pytest.approx(np.array([[0.0, 0.002]]))
        assert np.all(line.error_at(ALONG) == 0.0)
    with pytest.raises(ValueError, match="one and the same"):
        ZeroLine.through(ends[[0, 0]])


def test_surfaces_that_are_no_zero():
    with pytest.raises(Unmeasurable, match="not straight"):
        ZeroLine.fit(*surface(0.002 * np.clip(1.0 - (ALONG / 0.015) ** 2, 0.0, None)))
    with pytest.raises(Unmeasurable, match="no level upper side"):
        points, normals, errors = surface()
        ZeroLine.fit(points, -normals, errors)
    with pytest.raises(Unmeasurable, match="not straight"):
        ZeroLine.fit(*surface(noise=1e-4))


def on_table(depth, top_share, seed=0):
    """Points, normals and errors of a body's top, its sides and the table on which it stands, in order along the edge."""
    rng = np.random.default_rng(seed)
    half = 20e-3 * top_share
    pieces = [
        (np.linspace(-20e-3, -half, 200), np.full(200, -depth), (0.0, 1.0)),
        (np.full(80, -half), np.linspace(-depth, 0.0, 80), (-1.0, 0.0)),
        (np.linspace(-half, half, 300), np.zeros(300), (0.0, 1.0)),
        (np.full(80, half), np.linspace(0.0, -depth, 80), (1.0, 0.0)),
        (np.linspace(half, 20e-3, 200), np.full(200, -depth), (0.0, 1.0)),
    ]
    points = np.vstack([np.column_stack([x, z]) for x, z, _ in pieces]) + 2e-6 * rng.normal(size=(860, 2))
    normals = np.vstack([np.tile(normal, (len(x), 1)) for x, _, normal in pieces])
    return points, normals, np.full(860, 2e-6)


@pytest.mark.parametrize("top_share", [0.4, 0.6, 0.9])
def test_a_body_on_a_table_counts_from_its_own_top(top_share):
    line = ZeroLine.fit(*on_table(8e-3, top_share))
    assert line.place(np.array([[0.0, 0.0]]))[0, 1] == pytest.approx(0.0, abs=1e-6)
    assert line.extent[1] == pytest.approx(20e-3 * top_share, abs=1e-4)


@pytest.mark.parametrize(("angle", "seen"), [(0.0, 1.0), (0.3, 1.0), (0.6, 0.8), (-0.3, 0.95)])
def test_the_bow_of_a_round_body_shows_that_it_is_not_level(angle, seen):
    """The shadow of a disk's rim is half an ellipse, as high as the radius times the angle between surface and light."""
    radius = 15e-3
    x = np.linspace(-seen * radius, seen * radius, 400)
    true = radius * abs(np.tan(np.radians(angle)))
    z = true * np.sqrt(1.0 - np.clip(x / radius, -0.9999, 0.9999) ** 2) + 1e-6 * np.random.default_rng(0).normal(size=400)
    sides = Sides(-2e-3, 2.0 * radius, 0.0, 1e-6) if seen == 1.0 else None
    line = ZeroLine.fit(np.column_stack([x, z]), np.tile([0.0, 1.0], (400, 1)), np.full(400, 1e-6))
    line = dataclasses.replace(line, sides=sides)
    bow = Bow.of(line, line.place(np.column_stack([x, z])), np.ones(400))
    doubt = next(level(SimpleNamespace(bow=bow, traced=SimpleNamespace(lift=0.0))), None)
    if angle == 0.0:
        assert doubt is None
        assert bow.level_error < 3e-6
    else:
        assert "level the body" in doubt.remedy
        # Not wrong and trusted by three stated errors, where the body's ends are not seen either.
        assert bow.level_error > true / 2.5
        if sides is not None:
            assert bow.level_error == pytest.approx(true, rel=0.05)


def test_sides_narrower_than_the_surface_leave_its_level_unchecked():
    """Something else was taken for the body's sides: a bow cannot be told, and no exception ends the run."""
    x = np.linspace(-15e-3, 15e-3, 400)
    points = np.column_stack([x, 1e-6 * np.random.default_rng(0).normal(size=400)])
    line = ZeroLine.fit(points, np.tile([0.0, 1.0], (400, 1)), np.full(400, 1e-6))
    line = dataclasses.replace(line, sides=Sides(-2e-3, 10e-6, 0.0, 1e-6))
    doubt = next(level(SimpleNamespace(bow=Bow.of(line, line.place(points), np.ones(400)))), None)
    assert "level cannot be checked" in doubt.verdict


def test_another_photograph_at_zero_stands_in_for_a_doubtful_one(monkeypatch):
    good, bad = (ZeroLine.through(np.array([[0.0, 0.0], [0.01, 0.0]])) for _ in range(2))
    bad = dataclasses.replace(bad, doubts=("a hair",))
    monkeypatch.setattr(series, "find_zero", lambda file, *_: bad if file.name == "a.jpg" else good)
    corners = np.array([[0.0, 0.0], [699.0, 0.0], [699.0, 466.0], [0.0, 466.0]])
    setup = Setup(Camera.ideal(700, 467), Plane.fit(corners, corners * 4e-5, 0.1))
    photos = [Photograph(Path(name), 0.0, 1.0) for name in ("a.jpg", "b.jpg")]
    assert series.zero_line(photos, setup, "srgb") is good
    assert series.zero_line(photos[:1], setup, "srgb") is bad


def test_an_unforeseen_failure_is_one_sentence(monkeypatch):
    """Words of other programs come in several lines."""

    def fails(*_):
        raise ValueError("Overload resolution failed:\n> - integer won't fit\n)\n")

    monkeypatch.setattr(series, "find_zero", fails)
    corners = np.array([[0.0, 0.0], [699.0, 0.0], [699.0, 466.0], [0.0, 466.0]])
    setup = Setup(Camera.ideal(700, 467), Plane.fit(corners, corners * 1e-4, 0.01))
    with pytest.raises(series.NoZero) as raised:
        series.zero_line([Photograph(Path("rest.jpg"), 0.0, 1.0)], setup)
    assert "rest.jpg" in str(raised.value) and "integer won't fit" in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(("height", "radius", "power"), [(4.0, 5.0, 2.2), (6.1, 6.76, 2.48), (5.5, 6.3, 3.0)])
@pytest.mark.parametrize("spacing", [30e-6, 118e-6])
def test_a_steep_top_is_no_crease_and_a_creased_one_is(height, radius, power, spacing):
    """Before: over six stations of a small picture a dome of 4 mm on a radius of 5 mm turns by 12 degrees."""
    x = np.linspace(-9.0, 9.0, 20001)
    z = height * np.clip(1.0 - (x / radius) ** 2, 0.0, 1.0) ** power
    for crease, creased in ((0.0, False), (12.0, True)):
        line = 1e-3 * np.column_stack([x, z - np.tan(np.radians(crease / 2.0)) * np.abs(x + 0.3)])
        arc = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))]
        at = np.arange(0.0, arc[-1], spacing)
        edge = np.column_stack([np.interp(at, arc, line[:, axis]) for axis in (0, 1)])
        edge += np.random.default_rng(1).normal(0.0, 1.5e-6, edge.shape)
        assert (sharpest_turn(edge)[1] > MIN_CREASE_TURN) == creased
