"""What pictures show is to be seen: colours spread over a part, smooth borders, a film without bands, no seams in cuts."""

from __future__ import annotations

import io
import itertools
from types import SimpleNamespace

import matplotlib
import numpy as np
import pytest
from PIL import Image

from geometries import SeminarActuator
from softmodels.pictures import film, offscreen, solid
from softmodels.pictures.offscreen import look
from softmodels.pictures.solid import cut_open
from softmodels.pictures.style import Scale, load, page
from softmodels.runs.columns import StateLabels
from softmodels.runs.grid import CUT
from softmodels.runs.store import States


def corners(states):
    """A field like a slab's: small nearly everywhere, twenty times as large in a few nodes, a tenth at the first pressure."""
    field = 1e3 * (1 + np.hypot(*states.points[:, :2].T) / 0.07)
    field[:: max(len(field) // 60, 2)] *= 20.0
    return np.array([0.1 * field, field])


def test_little_of_a_picture_is_of_the_darkest_colour(half_slab):
    """By the square root, the colours tell states apart of which one has a tenth of the other's stress."""
    states = States(half_slab, "slab")
    assert isinstance(states.actuator, SeminarActuator)
    values = corners(states)
    scale = Scale(values)
    darkest = 0.05  # of the colours' length: to the eye the one colour of rest
    linear = np.clip(values * scale.factor / scale.top, 0, 1)
    assert (linear[0] < darkest).mean() > 0.9  # as it was
    assert (scale.share(values)[0] < darkest).mean() < 0.05


def test_the_bar_and_the_surface_have_the_same_colours():
    scale = Scale(np.linspace(0.0, 40e3, 1000))
    kilopascals = np.array([0.0, 0.7, 5.0, 20.0, scale.top, 2 * scale.top])
    assert scale.share(1e3 * kilopascals) == pytest.approx(np.asarray(scale.norm(kilopascals)))
    ticks = scale.ticks()
    assert ticks[0] == 0.0 and len(ticks) >= 4 and np.all(np.diff([float(scale.norm(t)) for t in ticks]) >= 0.08)


def test_only_what_is_seen_sets_the_colours_of_a_whole_device(half_slab):
    shown = look(States(half_slab, "slab"))
    facing = shown._facing(5)
    assert 0.2 < facing.mean() < 0.9


def test_hot_spots_are_bounded_by_an_isoline_and_cover_their_share(wedge):
    states = States(wedge, "disk")
    step = states.main
    limit = offscreen.hot_limit(states, step)
    scale = Scale(states.field(step, "largest_stretch"), "largest_stretch")
    stretch = states.field(step, "largest_stretch")[states.skin.nodes]
    triangles = states.skin.triangles[states.skin.part != CUT]
    a, b, c = states.skin.points(states.points)[triangles].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assert area[stretch[triangles].mean(axis=1) > limit].sum() / area.sum() == pytest.approx(0.01, abs=0.01)
    layers = offscreen.hot_layers(states, step, limit, scale)
    lines = [data for data, style in layers if style.get("color") == "black"]
    patches = [data for data, style in layers if "color" not in style]
    assert lines and all(data.point_data["stretch"] == pytest.approx(limit, rel=1e-6) for data in lines)
    # Outside, nothing below the limit is coloured: no cell sticks out of the line.
    assert patches[-1].point_data["stretch"].min() == pytest.approx(limit, rel=1e-6)


def test_a_films_gradients_are_not_banded():
    """A ramp over all colours with shading: dithered, the mean over a few pixels keeps the colour."""
    ramp = matplotlib.colormaps["Spectral_r"](np.linspace(0, 1, film.WIDE))[:, :3]
    shade = np.linspace(0.6, 1.0, 120)[:, None, None]
    frames = [np.uint8(255 * np.clip(shade * ramp * k, 0, 1)) for k in (0.9, 0.95, 1.0)]
    with Image.open(io.BytesIO(film.gif(frames))) as made:
        made.seek(2)
        shown = np.asarray(made.convert("RGB"), dtype=float)
    error = (shown - frames[2]).reshape(15, 8, film.WIDE // 8, 8, 3).mean(axis=(1, 3))
    assert np.sqrt((error**2).mean()) < 4.0  # bands of 160 colours of three frames: 7
    with Image.open(io.BytesIO(film.webp(frames))) as made:
        assert made.size == (film.WIDE, 120) and made.n_frames == 3


def test_a_cut_has_no_seam_where_images_of_the_slice_meet(half_slab):
    """The shell behind the cut is one surface: points on the mirror plane are there once."""
    states = States(half_slab, "slab")
    plane = (np.array([0.0, 0.0, 1.0]), np.zeros(3))
    shell = cut_open(states, 0, plane, plane[0], Scale(states.field(1, "von_mises")))[0][0]
    middle = shell.points[np.abs(shell.points[:, 1]) < 1e-7]
    assert len(middle) > 10
    apart = np.linalg.norm(middle[:, None] - middle[None], axis=2) + np.eye(len(middle))
    assert apart.min() > 1e-7


def test_titles_of_three_cavities_stay_within_their_pictures():
    """A program of three cavities names three pressures: title, note and the titles of a sheet go on in further lines."""
    row = {
        "load_step": 2.25,
        "pressure_1_cm": 139.5,
        "pressure_2_cm": 140.2,
        "pressure_3_cm": 117.3,
        "max_stretch": 2.345,
    }
    row |= {f"max_stretch_{axis}_mm": -10.21 for axis in "xyz"}
    states = SimpleNamespace(rows=[row, row, row], words=StateLabels("apex"))
    note = offscreen.peak_text(states, 0)
    image = np.zeros((400, 533, 3), dtype=np.uint8)
    scale = SimpleNamespace(bar=lambda figure: None)
    sheet = solid.sheet([(step, image) for step in range(3)], states.rows, states.words, scale)
    for figure, columns in (
        (page(image, f"{load(row, states.words)} at the bifurcation, the mode; {note}", None, note), 1),
        (sheet, 3),
    ):
        figure.draw_without_rendering()
        wide, tall = figure.bbox.width, figure.bbox.height
        top = max(image.get_window_extent().y1 for image in [*figure.axes, *figure.artists])
        boxes = [text.get_window_extent() for text in figure.texts]
        assert all(box.width < 0.99 * wide / columns and box.y1 <= tall and box.y0 >= top for box in boxes)
        assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))


def test_a_gif_that_is_too_large_has_fewer_frames_in_the_same_colours(monkeypatch):
    across = np.linspace(0, 255, 64).astype(np.uint8)
    frames = [np.dstack(np.broadcast_arrays(across[:, None], across, np.uint8(8 * k))) for k in range(30)]

    def opened(data):
        with Image.open(io.BytesIO(data)) as made:
            return made.n_frames, made.getpalette()

    whole = film.gif(frames)
    monkeypatch.setattr(film, "LARGEST", round(0.9 * len(whole)))
    less = film.gif(frames)
    assert len(less) <= film.LARGEST
    assert opened(whole) == (30, opened(less)[1]) and opened(less)[0] == 25


def test_what_changes_slowly_does_not_lag_in_the_film():
    """Two shades of grey from one frame to the next beside a spot that moves: differences alone would leave the grey out."""
    across = np.linspace(40.0, 120.0, 240)[None, :, None] * np.ones((160, 1, 3))
    frames = [(across + 2 * k).astype(np.uint8) for k in range(30)]
    for k, frame in enumerate(frames):
        frame[60:90, 6 * k : 6 * k + 30] = 255
    with Image.open(io.BytesIO(film.webp(frames))) as made:
        assert made.n_frames == len(frames)
        for k, frame in enumerate(frames):
            made.seek(k)
            assert np.abs(np.asarray(made.convert("RGB")).astype(float) - frame).mean() < 2.0, k
