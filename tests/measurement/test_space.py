"""The tip in space of arms that leave their plane, from two views."""

from __future__ import annotations

import csv
import dataclasses

import numpy as np
import pytest
from click.testing import CliRunner

from measurement.__main__ import main
from measurement.camera import Camera
from measurement.screen.setup import Setup, plane_of_scale
from measurement.series import space, views
from measurement.series.photo_list import Photograph
from softmodels.fitting.outlines.views import OutlineFitError, read_views
from tests.support import arms, side_views


def scene(**changes):
    camera = Camera.ideal(*side_views.SIZE)
    known = Setup(camera, plane_of_scale(camera, 1.0 / side_views.PIXEL, 1.0))
    made = views.Scene(known, (side_views.FAR, 2e-3), (0.0, 0.0), (0.0, 2e-4), arms.BASE, in_space=True)
    return dataclasses.replace(made, **changes)


def measured(folder, turns, azimuth, seed=0, drawn=0.0):
    """The folders of both views' results, and the tips (n, 3); distances are wrong by their errors, times ``drawn``."""
    names, tips = arms.photographs(folder, turns, azimuth, seed)
    random, made = np.random.default_rng(seed), []
    for number, files in enumerate(names):
        made.append(folder / f"view{number}")
        made[-1].mkdir()
        listed = [Photograph(file, 4e3 * k, 40.0 if k else 1.0) for k, file in enumerate(files)]
        far, near = drawn * random.standard_normal(2) * [2e-3, 2e-4]
        known = scene(camera_distance=(side_views.FAR + far, 2e-3), ahead=(near, 2e-4))
        views.views(listed, known).write(made[-1])
    return made, tips


def tips_of(folders, side="above"):
    return [space.joined(pair, side) for pair in space.pairs(*map(space.read, folders))]


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    return measured(tmp_path_factory.mktemp("arm"), (0.0, 0.9), -0.6)


def test_tip_in_space(seen):
    folders, truth = seen
    tips = tips_of(folders)
    assert [tip.reasons for tip in tips] == [(), ()]
    off = np.array([tip.place for tip in tips]) - truth
    assert np.linalg.norm(off, axis=1).max() < 5e-5
    assert (np.abs(off) < 3.0 * np.array([tip.error for tip in tips])).all()
    # Without the other view each place is that of the plane, off by its parallax.
    assert np.abs(tips[1].views[0].place - truth[1][[0, 2]]).max() > 5e-4


@pytest.mark.campaign
def test_intervals_hold_the_tips(tmp_path):
    """40 renders: 20 arms, each bent by up to 63 degrees in another plane, from two sides."""
    random, z, off = np.random.default_rng(4), [], []
    for number in range(20):
        turn, azimuth = random.uniform(0.2, 1.1), random.uniform(-1.4, 0.1)
        (tmp_path / str(number)).mkdir()
        folders, truth = measured(tmp_path / str(number), (turn,), azimuth, 100 * number, drawn=1.0)
        for tip, place in zip(tips_of(folders), truth, strict=True):
            z.append((tip.place - place) / tip.error)
            off.append(np.linalg.norm(tip.place - place))
    assert max(off) < 5e-5
    assert np.mean(np.abs(z) < 1.96) > 0.90, np.round(z, 2)


def test_pictures_of_other_states_are_not_trusted(seen):
    """The straight arm from above with the bent one from the side: the coordinate that both see differs."""
    first, second = map(space.read, seen[0])
    tip = space.joined((first[1], second[0]), "above")
    assert tip.trust == "no" and "both views see the same coordinate" in tip.reasons[0]


CAMERAS = {
    "right": ((0.8, 0.01, -0.02), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "left": ((-0.8, 0.01, -0.02), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
    "above": ((0.03, 0.01, 0.8), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "below": ((0.03, 0.01, -0.8), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
}  # fmt: skip
"""Where a camera stands from the middle of the base in m, and what is to the right and upwards in its pictures."""


def seen_from(name, camera, place, way, radius):
    """What a camera shows of a half circle's tip, by rays through the plane of the base across its line of sight."""
    at, right, up = map(np.array, camera)

    def through_plane(point):
        depth = np.cross(right, up)
        ray = point - at
        return np.array([right, up]) @ (at - ray * (at @ depth) / (ray @ depth))

    centre = place - radius * way
    middle, ahead = through_plane(centre), through_plane(centre + 1e-6 * way)
    angle = np.arctan2(*(ahead - middle)[::-1])
    depth = np.cross(right, up)
    tip = middle + radius * (at @ depth) / ((at - centre) @ depth) * np.array([np.cos(angle), np.sin(angle)])
    slope = (tip - np.array([right, up]) @ at) / abs(at @ np.cross(right, up))
    return space.TipView(
        name, (1e3, 10.0), tip, np.full(2, 3e-5), (angle, 1e-3), slope, 1e-5, radius, True, "yes", "", ""
    )  # fmt: skip


@pytest.mark.parametrize("side", list(CAMERAS))
def test_tip_from_each_side(side):
    place, way = np.array([0.05, 0.03, -0.04]), np.array([0.5, 0.6, -0.62])
    way /= np.linalg.norm(way)
    first = seen_from("first", ((0.03, -0.8, 0.01), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), place, way, 0.005)
    tip = space.joined((first, seen_from("second", CAMERAS[side], place, way, 0.005)), side)
    assert tip.trust == "yes"
    assert tip.place == pytest.approx(place, abs=2e-5)


def test_command_joins_two_folders(seen, tmp_path):
    (side, above), truth = seen
    run = CliRunner()
    done = run.invoke(main, ["join", str(side), str(above), "--from", "above", "-o", str(tmp_path / "tips")])
    assert done.exit_code == 0, done.output
    with (tmp_path / "tips" / space.TIPS).open() as file:
        rows = list(csv.DictReader(file))
    assert [row["trusted"] for row in rows] == ["yes", "yes"]
    assert [float(rows[1][f"tip_{axis}_m"]) for axis in "xyz"] == pytest.approx(truth[1], abs=5e-5)
    with pytest.raises(OutlineFitError):
        read_views(side / views.SPACE_TABLE)  # places in one plane would be wrong
    done = run.invoke(main, ["join", str(side), str(tmp_path), "--from", "above"])
    assert (done.exit_code, "measure view --in-space" in done.output) == (2, True)
