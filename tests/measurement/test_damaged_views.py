"""Damaged side views of random devices: none is wrong and trusted, good ones stay good, and the remedies help."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from measurement.series.witness import Refusal
from tests.support import damaged_views
from tests.support.campaigns import sampled
from tests.support.damaged_views import KINDS, MARKER_KINDS, Bench, Change, MarkedBar

DEFAULT = 3


@pytest.mark.parametrize("seed", sampled(range(9), DEFAULT))
def test_no_damaged_view_is_wrong_and_trusted(seed, tmp_path):
    """By default a third of the kinds on each of three benches; all of them on six more in campaigns."""
    kinds = list(KINDS)[seed::DEFAULT] if seed < DEFAULT else list(KINDS)
    verdicts = list(Bench(seed, tmp_path).campaign(kinds))
    assert [verdict for verdict in verdicts if verdict[2] == "wrong"] == []
    assert {outcome for kind, _, outcome, _ in verdicts if kind == "clean"} == {"right"}
    assert len({kind for kind, *_ in verdicts}) == 1 + len(kinds)


@pytest.mark.parametrize(
    ("kind", "seed"), sampled([(kind, seed) for kind in MARKER_KINDS for seed in range(4)], {("swapped", 0)})
)
def test_no_damaged_marker_is_wrong_and_trusted(kind, seed, tmp_path):
    outcomes = MarkedBar(seed, tmp_path, kind == "swapped").damaged(kind)
    assert not [outcome for outcome in outcomes if outcome[0] == "wrong"], outcomes
    if kind != "swapped":
        assert sum(outcome == "right" for outcome, _ in outcomes) >= len(outcomes) - 2, outcomes


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    return Bench(0, tmp_path_factory.mktemp("bench"))


def measured(bench, change, numbers=(0, 2)):
    """Outcomes of a bench's photographs, all of them changed."""
    return bench.measured([(k, bench.photograph(k, change, "remedy")) for k in numbers], change)


@pytest.mark.campaign
def test_ahead_is_the_remedy_for_a_scale_in_another_plane(bench):
    change = KINDS["scale in another plane"](bench, 2, np.random.default_rng(3))
    made = measured(bench, change)
    assert "the scale lies in another plane" in made.outcomes[0].reasons[0]
    assert "the photograph without pressure is not trusted" in made.outcomes[1].reasons[0]
    ahead = side_of(change)
    made = measured(bench, dataclasses.replace(change, scene=change.scene | {"ahead": (ahead, 1e-3)}))
    assert [bench.outcome(made, place, number)[0] for place, number in enumerate((0, 2))] == ["right", "right"]


def side_of(change):
    """How far the device stands before the scale, by the camera's distance from it."""
    return damaged_views.side_views.FAR - change.scene["camera_distance"][0]


@pytest.mark.campaign
def test_length_with_its_error_is_the_remedy_for_a_device_that_was_made_longer(bench):
    for length, trust in (((0.0882, 1e-4), "no"), ((0.0882, 1e-3), "yes"), ((0.0895, 1e-4), "yes")):
        made = bench.measured([(0, bench.files[0]), (2, bench.files[2])], Change("", scene={"length": length}))
        assert [view.trust for view in made.outcomes] == [trust] * 2
    errors = [np.linalg.norm(view.tip_error) for view in made.outcomes]
    assert min(errors) > 1.5e-4  # the scale may be the one that is wrong, by 0.2 mm


@pytest.mark.campaign
def test_a_mask_is_the_remedy_for_a_second_thing(bench):
    ball = damaged_views.side_views.pv.Sphere(radius=0.01, center=(0.02, 0.0, -0.06))
    change = Change("a ball", lambda parts: [*parts, ball])
    file = bench.photograph(2, change, "second")
    assert "a second thing" in bench.measured([(0, bench.files[0]), (2, file)], change).outcomes[1].reasons[0]
    setup = bench.scene(change).setup
    setup = dataclasses.replace(setup, masks=(*setup.masks, (380.0, 680.0, 620.0, 920.0)))
    made = bench.measured([(0, bench.files[0]), (2, file)], Change("", scene={"setup": setup}))
    assert [view.trust for view in made.outcomes] == ["yes", "yes"], made.outcomes


@pytest.mark.campaign
def test_all_photographs_again_are_the_remedy_for_a_camera_that_moved(bench):
    by = np.array([4.0, -6.0])
    change = Change("moved", light=lambda light: damaged_views.turned_light(light, 0.0, (0, 0), 1.0, by))
    change = dataclasses.replace(change, scene={"base": bench.device(0)[4] + by})
    assert [view.trust for view in measured(bench, change).outcomes] == ["yes", "yes"]


@pytest.mark.campaign
def test_anyway_uses_a_device_that_moves_back(bench):
    change = Change("", order=(0, 2, 1, 3))
    made = bench.measured(list(enumerate(bench.files)), change)
    assert all("moves back where the listed pressure rises" in view.reasons[0] for view in made.outcomes)
    assert not any(isinstance(outcome, Refusal) for outcome in made.outcomes)
