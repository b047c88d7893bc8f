"""Side views: tip, angle and centre line of bars that bend, from rendered photographs."""

from __future__ import annotations

import csv
import dataclasses
import re

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib import colors
from scipy.spatial import cKDTree

from geometries import PneuNet
from measurement.camera import Camera
from measurement.cli.setup import setup as setup_command
from measurement.cli.views import size_of, view as view_command
from measurement.outline import silhouette
from measurement.screen.setup import Setup, SetupError, plane_of_scale
from measurement.series import drawing, views
from measurement.series.photo_list import Photograph
from measurement.series.witness import Refusal
from softmodels.common.errors import GeometryError
from softmodels.design import targets
from tests.support import side_views
from tests.support.campaigns import sampled

TURNS = (0.0, 2.2)


@pytest.fixture(scope="module")
def bars(tmp_path_factory):
    """Photographs of a bar, straight and bent, with their truths."""
    folder = tmp_path_factory.mktemp("bars")
    truths = []
    for number, turn in enumerate(TURNS):
        surface, *truth = side_views.bent_bar(turn)
        side_views.photograph(folder / f"bar{number}.jpg", surface, seed=number)
        truths.append(truth)
    return [Photograph(folder / f"bar{k}.jpg", 5e3 * k, 50.0) for k in range(len(TURNS))], truths


def scene(**changes):
    camera = Camera.ideal(*side_views.SIZE)
    known = Setup(camera, plane_of_scale(camera, 1.0 / side_views.PIXEL, 1.0))
    made = views.Scene(
        known, (side_views.FAR, 2e-3), (side_views.DEPTH,) * 2, (0.0, 2e-4), side_views.BASE, (side_views.LENGTH, 1e-4)
    )
    return dataclasses.replace(made, **changes)


@pytest.fixture(scope="module")
def seen(bars, tmp_path_factory):
    return views.views(bars[0], scene(), tmp_path_factory.mktemp("edges"))


def misses(made, truths):
    """Errors of tip (n, 2) in m, angle (n,) in rad, and the centre lines' rms (n,) in m."""
    tips, angles, lines = [], [], []
    for view, (tip, angle, line) in zip(made.outcomes, truths, strict=True):
        tips.append(view.shape.tip - made.origin - tip)
        angles.append(np.angle(np.exp(1j * (view.shape.angle - angle))))
        dense = np.column_stack([np.interp(np.linspace(0, 1, 20000), np.linspace(0, 1, len(line)), axis) for axis in line.T])
        lines.append(np.sqrt(np.mean(cKDTree(dense).query(view.shape.line - made.origin)[0] ** 2)))
    return np.array(tips), np.array(angles), np.array(lines)


def test_a_device_is_seen_whose_clamp_covers_half_of_a_side(tmp_path):
    """It leaves a small picture by 56 % of its left side, in light that falls off to one corner."""
    width, height = 480, 360
    light = np.linspace(0.9, 0.7, width) * np.linspace(1.0, 0.9, height)[:, None]
    light[30:232, :360] = 0.1
    image = np.rint(255 * (1.055 * np.repeat(light[..., None], 3, axis=2) ** (1 / 2.4) - 0.055)).astype(np.uint8)
    camera = Camera.ideal(width, height)
    known = Setup(camera, plane_of_scale(camera, 1e4, 1.0))
    seen = silhouette.find_silhouette(image, known, np.array([[120.0, 29.5], [120.0, 231.5]]))
    assert np.abs(seen.edge.px[seen.edge.px[:, 0] < 340, 1] - 130.5).max() == pytest.approx(101.0, abs=0.6)
    assert seen.edge.px[:, 0].max() == pytest.approx(359.5, abs=0.6)


def test_tip_angle_and_centre_line_are_those_of_the_bar(bars, seen):
    assert [view.trust for view in seen.outcomes] == ["yes"] * len(TURNS)
    tips, angles, lines = misses(seen, bars[1])
    assert np.linalg.norm(tips, axis=1).max() < 2e-5
    assert np.degrees(np.abs(angles)).max() < 0.1
    assert lines.max() < 1.5e-5
    assert (np.abs(tips) < 3.0 * np.array([view.tip_error for view in seen.views])).all()
    assert (np.abs(angles) < 3.0 * np.array([view.angle_error for view in seen.views])).all()


@pytest.fixture(scope="module")
def combs(tmp_path_factory):
    """What photographs show of a floor with chambers and a thin plate at its end, whose gaps open as it bends; its truths."""
    folder, photographs, truths = tmp_path_factory.mktemp("combs"), [], []
    for number, turn in enumerate((0.0, 0.9)):
        parts, *truth, base = side_views.bent_comb(turn)
        side_views.photograph(folder / f"comb{number}.jpg", *parts, seed=number)
        photographs.append(Photograph(folder / f"comb{number}.jpg", 5e3 * number, 50.0))
        truths.append(truth)
    return views.views(photographs, scene(base=base, length=None)), truths


def test_folds_are_passed_by(combs):
    assert [getattr(view, "trust", view) for view in combs[0].outcomes] == ["yes", "yes"]
    tips, angles, lines = misses(*combs)
    assert np.linalg.norm(tips, axis=1).max() < 5e-5
    assert np.degrees(np.abs(angles)).max() < 0.2
    assert lines.max() < 1e-4


def test_edges_of_other_depth_are_told_apart(combs):
    """By the chambers, which are at the upper edge: with gaps of 15 mm there, and none at the lower one."""
    middle = (np.arange(120) + 0.5) / 120 * 0.06
    wide = (0.06 - side_views.PLATE) / side_views.CHAMBERS
    upper = np.where((middle % wide < wide - side_views.GAP) | (middle > 0.057), 0.009, -0.006)
    known = scene(depth=(0.0, 0.015), sides=np.column_stack([upper, np.full(120, 0.009)]))
    view = combs[0].views[0]
    assert known.told_apart(view.shape, view.outline).depth == (0.0, 0.015)
    assert known.told_apart(view.shape, view.outline[::-1]).depth == (0.015, 0.0)


def test_curvature_is_the_arcs(seen):
    for view, turn in zip(seen.views, TURNS, strict=True):
        inner = view.shape.curvature[15:-15]
        assert np.median(inner) == pytest.approx(-turn / side_views.LENGTH, abs=0.3)


def test_length_stays_where_the_bar_only_bends(seen):
    assert [view.shape.length for view in seen.views] == pytest.approx([side_views.LENGTH] * len(TURNS), abs=5e-5)


@pytest.mark.campaign
def test_without_its_depth_the_bar_is_too_long(bars):
    flat = views.views(bars[0][:1], scene(depth=(0.0, 0.0)))
    assert flat.views[0].shape.length - side_views.LENGTH > 2e-4


def test_table_is_a_tip_path(seen, bars, tmp_path):
    seen.write(tmp_path)
    rows, of = targets.read_tip_path(tmp_path / "views.csv", "")
    assert of == "tip"
    truth = [(tip[0], tip[1]) for tip, *_ in bars[1][1:]]
    assert np.array(rows)[:, [1, 3]] == pytest.approx(np.array(truth), abs=6e-5)
    with (tmp_path / "bar1.csv").open() as file:
        curves = list(csv.DictReader(file))
    assert {row["curve"] for row in curves} == {"outline", "centre_line"}
    last = [row for row in curves if row["curve"] == "centre_line"][-1]
    assert float(last["arc_length_m"]) == pytest.approx(side_views.LENGTH, abs=6e-5)


def doubts(bars, tmp_path, picture, **changes):
    """What is said of a photograph beside the straight bar's."""
    picture(tmp_path / "odd.jpg")
    made = views.views([bars[0][0], Photograph(tmp_path / "odd.jpg", 5e3, 50.0)], scene(**changes))
    outcome = made.outcomes[1]
    return outcome.reason if isinstance(outcome, Refusal) else "; ".join(outcome.reasons)


@pytest.mark.campaign
def test_device_that_leaves_its_plane_is_doubted(bars, tmp_path):
    surface = side_views.bent_bar(1.2, twist=0.9)[0]
    assert "left its plane" in doubts(bars, tmp_path, lambda path: side_views.photograph(path, surface))


@pytest.mark.campaign
def test_camera_that_moved_is_doubted(bars, tmp_path):
    surface = side_views.bent_bar(0.6)[0]
    said = doubts(bars, tmp_path, lambda path: side_views.photograph(path, surface, shift_px=(3.0, 9.0)))
    assert "the base moved" in said or "the background moved" in said


@pytest.mark.campaign
def test_second_thing_is_doubted(bars, tmp_path):
    surface, ball = side_views.bent_bar(0.6)[0], side_views.pv.Sphere(radius=0.012, center=(0.07, 0.0, -0.06))
    said = doubts(bars, tmp_path, lambda path: side_views.photograph(path, surface, ball))
    place = re.search(r"a second thing in the picture, about the pixel (\d+),(\d+),", said)
    assert np.allclose([int(number) for number in place.groups()], [998, 800], atol=3)


def behind(draw):
    """A wall behind the bar, as a surface with a texture that ``draw`` paints on its light grey picture (1000, 1400)."""
    width, height = 0.18, 0.18 * side_views.SIZE[1] / side_views.SIZE[0]
    (x, z), image = side_views.CENTRE, np.full((*side_views.SIZE[::-1], 3), 225, dtype=np.uint8)
    wall = side_views.pv.PolyData(
        np.array([(x + a * width / 2, 0.05, z + b * height / 2) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]),
        np.array([4, 0, 1, 2, 3]),
    )
    wall.active_texture_coordinates = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    return wall, side_views.pv.Texture(draw(image))


def doubts_before_walls(tmp_path, draws, turns):
    """What is said of two photographs of a bar, each before a wall that is painted."""
    pictures = []
    for number, (draw, turn) in enumerate(zip(draws, turns, strict=True)):
        side_views.photograph(tmp_path / f"{number}.jpg", side_views.bent_bar(turn)[0], behind(draw), seed=number)
        pictures.append(Photograph(tmp_path / f"{number}.jpg", 5e3 * number, 50.0, anyway=number == 0))
    outcomes = views.views(pictures, scene()).outcomes
    return [outcome.reason if isinstance(outcome, Refusal) else "; ".join(outcome.reasons) for outcome in outcomes]


@pytest.mark.parametrize(
    ("along", "across", "radius"), sampled([(-1, 0, 3), (1, -1, 2), (1.5, 2, 2), (0, 0, 1.5), (0, 0, 1)], {(1, -1, 2)})
)
def test_bead_on_the_tip_is_in_its_errors(along, across, radius, tmp_path):
    """A pin at a corner moves the tip by up to 2 mm; the photograph may be used anyway."""
    surface, tip, angle, _ = side_views.bent_bar(0.3)
    x, _, z = surface.points[801]  # the lower corner
    bead = side_views.pv.Sphere(radius=1e-3 * radius, center=(x + 1e-3 * along, 0.0, z + 1e-3 * across))
    side_views.photograph(tmp_path / "bead.jpg", surface, bead)
    (view,) = views.views([Photograph(tmp_path / "bead.jpg", 0.0, 0.0, anyway=True)], scene()).outcomes
    assert view.trust == "anyway" and "something sticks out there" in " ".join(view.reasons)
    assert (np.abs(view.shape.tip - view.shape.base - tip) < 2.0 * view.tip_error).all()
    assert abs(view.shape.angle - angle) < 2.0 * view.angle_error


def test_refused_photograph_shows_what_was_looked_at(bars, tmp_path):
    known = scene(base=side_views.BASE + np.array([0.0, 400.0]))
    (refused,) = views.views(bars[0][:1], known, tmp_path).outcomes
    assert "of --base" in refused.reason
    shown = cv2.imread(str(tmp_path / "bar0.png")).astype(int)
    colour = np.rint(255 * np.array(colors.to_rgb(drawing.EDGE_COLOUR))[::-1])
    assert (np.abs(shown - colour).max(axis=2) < 40).sum() > 30


@pytest.mark.campaign
def test_cast_shadow_is_doubted(tmp_path):
    """The bar's own on the wall behind it, soft and half as dark as the bar."""
    dark = np.zeros(side_views.SIZE[::-1], dtype=np.float32)
    dark[290:370, 500:1000] = 1.0  # beside the far half of the bar
    shade = 1.0 - 0.5 * cv2.GaussianBlur(dark, (0, 0), 14.0)[..., None]
    first, second = doubts_before_walls(tmp_path, (lambda image: image, lambda image: (image * shade).astype("u1")), (0.0, 0.0))
    assert not first
    assert "is not clear in one piece" in second


@pytest.mark.campaign
def test_background_that_moved_is_doubted(tmp_path):
    """A wall with fine spots, 4 texels farther right in the second photograph, and the clamp where it was."""
    spots = np.random.default_rng(2).normal(0.0, 1.0, side_views.SIZE[::-1])
    spots = 150 * cv2.GaussianBlur(spots.astype(np.float32), (0, 0), 3.0)[..., None]

    def painted(moved):
        return lambda image: np.clip(image - 20.0 + np.roll(spots, moved, 1), 0, 255).astype("u1")

    first, second = doubts_before_walls(tmp_path, (painted(0), painted(4)), (0.0, 0.6))
    assert "moved" not in first
    assert "the background moved by 4." in second


@pytest.mark.campaign
def test_other_light_and_another_shape_are_doubted(bars, tmp_path):
    surface, ball = side_views.bent_bar(0.6)[0], side_views.pv.Sphere(radius=0.014, center=(0.045, 0.0, -0.01))
    said = doubts(bars, tmp_path, lambda path: side_views.photograph(path, surface, ball, background=(0.6, 0.62, 0.65)))
    assert "times darker than in the photograph without pressure" in said
    assert "times wider than without pressure" in said


@pytest.mark.campaign
def test_device_cut_by_the_region_is_rejected(bars, tmp_path):
    known = dataclasses.replace(scene().setup, roi=(60, 50, 1000, 900))
    surface = side_views.bent_bar(0.0)[0]
    said = doubts(bars, tmp_path, lambda path: side_views.photograph(path, surface), setup=known)
    assert "cuts the device" in said


@pytest.mark.campaign
def test_one_of_two_devices_is_measured_in_its_region(tmp_path):
    """Two bars in one picture, a region for each."""
    lower, tip, *_ = side_views.bent_bar(0.3)
    upper = lower.copy()
    upper.points = upper.points - [0.0, 0.0, 0.04]
    side_views.photograph(tmp_path / "two.jpg", lower, upper)
    for moved, roi in ((0.0, (20, 20, 1390, 480)), (400.0, (20, 480, 1390, 990))):
        known = scene(base=side_views.BASE + np.array([0.0, moved]), setup=dataclasses.replace(scene().setup, roi=roi))
        (view,) = views.views([Photograph(tmp_path / "two.jpg", 0.0, 1.0)], known).outcomes
        assert getattr(view, "trust", view) == "yes"
        assert np.linalg.norm(view.shape.tip - view.shape.base - tip) < 5e-5


@pytest.mark.campaign
def test_scale_in_another_plane_is_doubted(bars):
    wrong = views.views(bars[0][:1], scene(ahead=(0.1, 1e-3)))
    assert "by --length" in wrong.views[0].reasons[0]


@pytest.mark.campaign
def test_empty_picture_is_refused(bars, tmp_path):
    assert "stands out" in doubts(bars, tmp_path, side_views.photograph)


def test_closed_outline_asks_for_the_base(bars):
    made = views.views(bars[0][:1], scene(base=None))
    assert "--base" in made.outcomes[0].reason


def test_camera_too_near_is_rejected():
    with pytest.raises(SetupError, match="--camera-distance"):
        scene(camera_distance=(0.01, 0.0))


def test_camera_that_cannot_see_the_scale_is_rejected_before_any_photograph():
    with pytest.raises(SetupError, match=r"no camera at 5e\+05 mm from the scale sees it this large; check --camera-distance"):
        scene(camera_distance=(500.0, 0.0))


def test_case_has_depth_and_length(tmp_path):
    """By the drawing: a beam's breadth, a PneuNet's, and of a bellows that is round above its base those of both."""
    case = tmp_path / "finger.toml"

    def size(device):
        case.write_text(f"[geometry]\n{device}\n")
        return size_of(case)

    def known(device):
        depths, length, _ = size(device)
        return [*depths, length]

    assert known('device = "Beam"\nlength = "60 mm"\nwidth = "11 mm"') == pytest.approx([0.011, 0.011, 0.06])
    finger = PneuNet()
    assert known('device = "PneuNet"') == pytest.approx([2.0 * finger.half_width] * 2 + [finger.length])
    assert known('device = "BendingBellows"\nfolds = 3') == pytest.approx([0.0, 0.022, 0.031], abs=1e-6)
    with pytest.raises(GeometryError, match="the section of a device; give depth and length instead"):
        size('device = "SuctionCup"')
    with pytest.raises(GeometryError, match="no face 'support'; give depth and length instead"):
        size('device = "Membrane"\nsection = "wedge"')
    assert known('device = "Cylinder"\nsection = "half"') == pytest.approx([0.0, 0.0, 0.064])
    case.write_text("[geometry")
    with pytest.raises(GeometryError, match=r"finger\.toml"):
        size_of(case)


@pytest.mark.campaign
def test_command_reads_a_tag_behind_the_device(bars, tmp_path):
    behind, rows = 0.008, ["file,pressure,error"]
    board = side_views.tag(-0.02, -0.075, 0.03, behind)
    for number, turn in enumerate((0.0, 0.6)):
        side_views.photograph(tmp_path / f"IMG_{number}.png", side_views.bent_bar(turn)[0], board, seed=number)
        rows.append(f"IMG_{number}.png,{5 * number} kPa,0.1 kPa")
    (tmp_path / "photos.csv").write_text("\n".join(rows) + "\n")
    run, setup = CliRunner(), str(tmp_path / "setup.toml")
    words = [str(tmp_path / "IMG_0.png"), "--target", "tag", "--grid-pitch", "30mm+-0.01mm", "--lens", "none", "-o", setup]
    assert run.invoke(setup_command, words).exit_code == 0
    base = "=".join(f"{x},{y}" for x, y in side_views.BASE)
    told = ["--setup", setup, "--depth", "15mm", "--ahead", "8mm+-0.2mm", "--base", base, "-o", str(tmp_path / "out")]
    result = run.invoke(view_command, [str(tmp_path / "photos.csv"), *told])
    assert (result.exit_code, "give --camera-distance" in result.output) == (2, True)
    result = run.invoke(view_command, [str(tmp_path / "photos.csv"), *told, "--camera-distance", "80cm+-2mm"])
    assert result.exit_code == 0, result.output
    with (tmp_path / "out" / "views.csv").open() as file:
        _, bent = csv.DictReader(file)
    tip = side_views.bent_bar(0.6)[1]
    for axis, true in zip("xz", tip, strict=True):
        assert abs(float(bent[f"tip_{axis}_m"]) - true) < 3.0 * float(bent[f"tip_{axis}_error_m"]) < 2.5e-3
    assert float(bent["rotation_deg"]) == pytest.approx(-np.degrees(0.6), abs=3.0 * float(bent["rotation_error_deg"]))
    assert (tmp_path / "out" / "edges" / "IMG_1.png").is_file()
