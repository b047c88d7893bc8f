"""A second thing in the light, photographed by an independent renderer: it is named as such, and the remedies help."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from measurement.outline.outline import Outline
from measurement.pictures import Unmeasurable
from measurement.series.measuring import Refusal, Result, judged, outline_of, trace_image, zero_of
from measurement.series.photo_list import Photograph
from measurement.series.witness import Run
from tests.support.campaigns import sampled
from tests.support.photographs import traced_runs as runs

MOVED = ("the actuator has moved", "the camera has moved", "moved along the light", "widen setup --roi")


class Photographs:
    """A small bench whose pictures show the body's sides, and its photographs of grid, undeformed and raised body."""

    def __init__(self, looks_at: float = 0.0, **body: float) -> None:
        case = runs.beside_case(0, (640, 420), 36e-6)
        bench = dataclasses.replace(case.bench, looks_at=(looks_at, 0.0))
        self.case = case = dataclasses.replace(case, bench=bench, body=dataclasses.replace(case.body, **body))
        self.setup = runs.setup_of(case, runs.rays.photograph(bench, case.sensor, None, 1))
        self.zero = zero_of(trace_image(self.picture(height=0.0), self.setup))

    def picture(self, *things: runs.rays.Thing, **body: float) -> np.ndarray:
        """A photograph of the body with second things in the light."""
        changed = dataclasses.replace(self.case.body, **body)
        return runs.rays.photograph(self.case.bench, self.case.sensor, changed, 2, things)

    def thing(self, kind: str, seed: int = 0) -> runs.rays.Thing:
        """A second thing beside the body."""
        return runs.thing_beside(self.case, kind, seed)

    def outline(self, picture: np.ndarray, anyway: bool = False, masks=()) -> Outline:
        """What is measured of it."""
        setup = dataclasses.replace(self.setup, masks=masks)
        traced = trace_image(picture, setup, likely=self.zero.tone, anyway=anyway)
        return outline_of(traced, self.zero, 1000.0, 5.0, "")

    def off(self, outline: Outline, height: float = 2.5e-3) -> np.ndarray:
        """Distances of its points from the truth."""
        return runs.across(self.case, self.setup, outline, height)


@pytest.fixture(scope="module")
def bench():
    return Photographs()


@pytest.mark.parametrize("kind", sampled(runs.THINGS, ("ruler",)))
def test_a_second_thing_beside_the_body_is_named(bench, kind):
    with pytest.raises(Unmeasurable, match=r"second thing|several shadows") as raised:
        bench.outline(bench.picture(bench.thing(kind)))
    assert not any(words in str(raised.value) for words in MOVED), raised.value
    assert "setup --mask" in str(raised.value)


@pytest.mark.parametrize("kind", sampled(["ruler", "hand"]))
def test_a_mask_over_a_second_thing_helps(bench, kind):
    thing = bench.thing(kind)
    side, nearest = np.sign(thing.path[0][0]), min(abs(x) for x, _ in thing.path) - thing.radius
    edge = bench.case.bench.pixels(np.array([[side * (nearest - 0.5e-3), 0.0]]))[0, 0]
    width, height = bench.case.bench.size
    mask = (0.0, 0.0, edge, height) if side < 0.0 else (edge, 0.0, width, height)
    outline = bench.outline(bench.picture(thing), masks=(mask,))
    assert outline.trusted, outline.reasons
    assert (np.abs(bench.off(outline)) < np.maximum(25e-6, 3.0 * outline.error)).all()


def test_a_second_thing_that_is_taken_away_leaves_a_trusted_outline(bench):
    outline = bench.outline(bench.picture())
    assert outline.trusted, outline.reasons
    assert (np.abs(bench.off(outline)) < np.maximum(25e-6, 3.0 * outline.error)).all()


@pytest.mark.campaign
def test_a_cable_along_a_grid_line_is_named_and_a_mask_over_it_helps(bench):
    case = bench.case.bench
    on_screen = case.pitch + 0.2e-3
    along = on_screen / case.magnification
    picture = bench.picture(runs.rays.Thing("cable", ((-30e-3, along), (30e-3, along)), 0.15e-3))
    with pytest.raises(Unmeasurable, match=r"number 1 above its origin .* second thing .* setup --mask"):
        bench.outline(picture)
    corners = [[x, on_screen + z] for x in (-13e-3, 13e-3) for z in (-0.6e-3, 0.6e-3)]
    rows = case.pixels(np.array(corners))[:, 1]
    outline = bench.outline(picture, masks=((0.0, rows.min(), case.size[0], rows.max()),))
    assert outline.trusted, outline.reasons
    assert (np.abs(bench.off(outline)) < np.maximum(25e-6, 3.0 * outline.error)).all()


@pytest.mark.campaign
def test_a_second_thing_may_be_used_anyway(bench):
    outline = bench.outline(bench.picture(bench.thing("ball")), anyway=True)
    assert not outline.trusted and any("second thing" in reason for reason in outline.reasons)


@pytest.mark.parametrize("height", sampled([4e-3, 2.6e-3]), ids=["steep top", "grid line along the top"])
def test_a_grid_line_along_the_top_and_a_steep_top_are_trusted_and_right(bench, height):
    """Before: the steep one bends sharply by 11 degrees."""
    outline = bench.outline(bench.picture(height=height))
    assert outline.trusted, outline.reasons
    assert np.abs(bench.off(outline, height)).max() < 25e-6
    assert abs(outline.height - height) < max(3.0 * outline.height_error, 3e-6)


@pytest.mark.campaign
def test_a_sheet_of_which_one_end_is_in_the_picture_is_trusted_and_right():
    sheet = Photographs(looks_at=4e-3, width=9e-3)
    assert sheet.zero.sides is None and not sheet.zero.doubts
    outline = sheet.outline(sheet.picture())
    assert outline.trusted, outline.reasons
    assert np.abs(sheet.off(outline)).max() < 25e-6
    assert abs(outline.height - 2.5e-3) < max(3.0 * outline.height_error, 3e-6)


def test_sides_that_bulge_are_no_body_moved_along_the_light(bench):
    heights = (1.2e-3, 2.5e-3)
    pictures = [bench.picture(height=z, gives=0.1 * z, gives_at=2.2e-3, gives_over=1.4e-3) for z in heights]
    results = [
        Result(Photograph(Path(f"{k}"), 1000.0 * k, 5.0), bench.outline(picture), f"{k}")
        for k, picture in enumerate(pictures, 1)
    ]
    for height, result in zip(heights, judged(results), strict=True):
        outline = result.outcome
        assert not isinstance(outline, Refusal) and outline.trusted, outline
        assert np.abs(bench.off(outline, height)).max() < 15e-6


def domes(blob: float, number: int = 3, count: int = 6) -> dict[int, Outline]:
    """Outlines of a run; one has a smooth blob of so many m on its top."""
    found, x = {}, np.linspace(-9e-3, 9e-3, 400)
    rng = np.random.default_rng(1)
    for k, height in enumerate(np.linspace(1e-3, 5e-3, count)):
        # The bulge becomes a little fuller as it rises, as membranes do.
        z = height * np.maximum(1.0 - (x / 10e-3) ** 2, 0.0) ** (2.2 - 60.0 * height)
        z += blob * (k == number) * np.exp(-0.5 * (x / 1e-3) ** 2) + rng.normal(0.0, 1e-6, len(x))
        found[k] = Outline(x, z, np.full(len(x), 3e-6), 1e3 * (k + 1), 5.0, f"{k}")
    return found


@pytest.mark.parametrize("number", [1, 3, 5])
def test_a_smooth_blob_on_the_top_is_noticed_by_the_run(number):
    results = [
        Result(Photograph(Path(f"{k}"), outline.pressure, 5.0), outline, f"{k}") for k, outline in domes(60e-6, number).items()
    ]
    doubted = [k for k, result in enumerate(judged(results)) if "curved than expected" in str(result.outcome.reasons)]
    assert doubted == [number]


def test_a_top_that_is_wiped_off_is_trusted():
    wiped = {**domes(60e-6), 3: domes(0.0)[3]}
    results = [Result(Photograph(Path(f"{k}"), one.pressure, 5.0), one, f"{k}") for k, one in wiped.items()]
    assert all(result.outcome.trusted for result in judged(results))


def test_a_run_of_smooth_domes_has_no_odd_top():
    odd = Run(domes(0.0)).odd_crown
    assert odd is not None and abs(odd.off) < max(0.05, 3.0 * odd.error)
    assert all(result.trusted for result in domes(0.0).values())
