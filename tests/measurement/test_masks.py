"""Masks: where a label or a hose covers the edge, nothing is measured, and all else is as without it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from measurement.camera import Camera
from measurement.photographer import lens_of, photograph, truth_of
from measurement.pictures import Unmeasurable
from measurement.screen.grid import find_grid
from measurement.screen.setup import Setup, SetupError
from measurement.series.measuring import outline_of, trace_image, zero_of
from tests.support.campaigns import sampled
from tests.support.photographs.bench import Bench

BENCH, HEIGHT = Bench.random(4), 4e-3
FLANK, SCREEN = (720.0, 500.0, 800.0, 640.0), (80.0, 120.0, 310.0, 380.0)
"""Places of labels in px: over the flank of the bulge, and on the lit screen."""


@pytest.fixture(scope="module")
def setup():
    scene = BENCH.scene
    camera = Camera(truth_of(scene).matrix, lens_of(scene.distortion), scene.width, scene.height, "known", 0.0)
    plane = find_grid(photograph(scene, None, 1)[0], camera, scene.grid_pitch).plane(camera)
    return Setup(camera, plane, grid_pitch=scene.grid_pitch)


@pytest.fixture(scope="module")
def zero(setup):
    return zero_of(trace_image(photograph(BENCH.scene, BENCH.polygon(0.0), 3)[0], setup))


@pytest.fixture(scope="module")
def clean():
    return photograph(BENCH.scene, BENCH.polygon(HEIGHT), 2)[0]


def labelled(picture, place):
    """The photograph with a dark label on it."""
    found = picture.copy()
    x0, y0, x1, y1 = (int(value) for value in place)
    found[y0 + 10 : y1 - 10, x0 + 10 : x1 - 10] = 40
    return found


def measured(picture, setup, zero):
    return outline_of(trace_image(picture, setup), zero, 1000.0, 10.0, "one.jpg")


@pytest.mark.campaign
@pytest.mark.parametrize("place", sampled([SCREEN, FLANK], whole=True), ids=["on the screen", "over the edge"])
def test_a_label_is_cured_by_a_mask(setup, zero, clean, place):
    whole = measured(clean, setup, zero)
    try:
        spoilt = measured(labelled(clean, place), setup, zero)
        assert not spoilt.trusted
    except Unmeasurable:
        pass
    masked = measured(labelled(clean, place), dataclasses.replace(setup, masks=(place,)), zero)
    assert masked.trusted, masked.reasons
    px = setup.to_pixels(zero.origin + masked.x[:, None] * zero.direction + masked.z[:, None] * zero.normal)
    inside = ((px > place[:2]) & (px < place[2:])).all(axis=1)
    assert inside.any() == (place == FLANK) and masked.bridged[inside].all()
    seen = ~masked.bridged
    error = np.hypot(masked.error[seen], np.interp(masked.x[seen], whole.x, whole.error))
    apart = (masked.z[seen] - np.interp(masked.x[seen], whole.x, whole.z)) / error
    assert np.sqrt(np.mean(apart**2)) < 1.0
    assert masked.height == pytest.approx(whole.height, abs=3e-6)


def test_masks_are_kept_in_the_file(setup):
    made = dataclasses.replace(setup, masks=(FLANK, (0.0, 0.0, 10.0, 10.0)))
    assert Setup.from_toml(made.to_toml()).masks == made.masks


@pytest.mark.parametrize("mask", [(10.0, 10.0, 5.0, 20.0), (-1.0, 0.0, 5.0, 5.0), (0.0, 0.0, 1e5, 5.0)])
def test_masks_outside_of_the_picture_are_refused(setup, mask):
    with pytest.raises(SetupError, match=r"the mask .* is not x0,y0,x1,y1 inside of the picture"):
        dataclasses.replace(setup, masks=(mask,))


def test_a_mask_over_everything_is_told(setup, zero, clean):
    everything = (0.0, 0.0, float(BENCH.scene.width), float(BENCH.scene.height))
    with pytest.raises(Unmeasurable, match="the masks cover everything"):
        measured(clean, dataclasses.replace(setup, masks=(everything,)), zero)


def test_a_setups_mask_needs_four_numbers(setup):
    text = setup.to_toml().replace("version = 1", "version = 1\nmasks = [[1, 2, 3]]")
    with pytest.raises(SetupError, match="so does each of its masks"):
        Setup.from_toml(text)
