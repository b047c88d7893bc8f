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
from softmodels.pictures import offscreen, solid
from softmodels.pictures.offscreen import look
from softmodels.pictures.solid import cut_open
from softmodels.pictures.style import DPI, FOOT_INCHES, STYLE, Caption, Pixels, Scale, drawn, page
from softmodels.runs.grid import fine_triangles, outline
from softmodels.runs.labels import StateLabels, load
from softmodels.runs.states import FolderStates
from softmodels.runs.table import PathTable, Row


def corners(states):
    """A field like a slab's: small nearly everywhere, twenty times as large in a few nodes, a tenth at the first pressure."""
    field = 1e3 * (1 + np.hypot(*states.points[:, :2].T) / 0.07)
    field[:: max(len(field) // 60, 2)] *= 20.0
    return np.array([0.1 * field, field])


def test_little_of_a_picture_is_of_the_darkest_colour(half_slab):
    """By the square root, the colours tell states apart of which one has a tenth of the other's stress."""
    states = FolderStates(half_slab, "slab")
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
    assert (ticks[0], ticks[-1], scale.top) == (0.0, 40.0, 40.0) and len(ticks) >= 4
    assert np.all(np.diff([float(scale.norm(tick)) for tick in ticks]) >= 0.08)


def read_off(picture, places, scale):
    """Values of places of a picture, by its own colour bar: pixels to the right and downwards, shape (n, 2)."""
    left, low, right, high = scale.foot[0].bbox.extents  # without the arrow at its end
    columns = np.arange(round(left) + 2, round(right) - 1)
    row = picture[round(picture.shape[0] - (low + high) / 2), columns].astype(int)
    found = []
    for across, down in places:
        around = picture[int(down) - 1 : int(down) + 2, int(across) - 1 : int(across) + 2].reshape(9, 1, 3)
        difference = np.abs(row - around).sum(axis=2)
        assert difference.min(axis=1).max() <= 6, "colours of the bar"
        same = [columns[one == one.min()].mean() for one in difference]
        share = (np.median(same) + 0.5 - left) / (right - left)
        found.append(scale.low + (scale.top - scale.low) * share ** (1 / scale.power))
    return np.array(found)


def compare(values, expected, scale):
    """Of the 256 colours they have the same or the next one."""
    read, there = (np.floor(256 * scale.share(np.asarray(v) / scale.factor)) for v in (values, expected))
    assert len(read) == 10 and np.ptp(there) > 40
    assert np.abs(read - there).max() <= 1


def centred(places):
    """Which places (n, 2) in a picture lie in the middle of a pixel."""
    return np.abs(places % 1 - 0.5).max(axis=1) < 0.2


def test_ten_values_are_read_off_a_section(half_section):
    """Places inside the section, off its lines."""
    shown = look(FolderStates(half_section, "disk"))
    states, scale = shown.states, shown.scales["von_mises"]
    with matplotlib.rc_context(STYLE):
        figure = solid.section_stress(shown, states.main)
        picture = np.asarray(drawn(figure))
    (axes,) = figure.axes
    moved, values = states.moved(states.main)[:, ::2], states.field(states.main, "von_mises")
    fine, _ = fine_triangles(np.column_stack([moved, values]), states.cells)
    lines = np.concatenate([outline(at, states.cells).reshape(-1, 2) for at in (moved, states.points[:, ::2])])
    places = axes.transData.transform(1e3 * fine[:, :2])
    clear = np.linalg.norm(fine[:, None, :2] - lines, axis=2).min(axis=1) > 0.4e-3
    chosen = np.flatnonzero(clear & centred(places))
    chosen = chosen[np.argsort(fine[chosen, 2])][np.linspace(0, len(chosen) - 1, 10).astype(int)]
    pixels = places[chosen] * (1, -1) + (0, picture.shape[0])
    compare(read_off(picture, pixels, scale), fine[chosen, 2] * scale.factor, scale)


@pytest.mark.skipif(not offscreen.can_render(), reason="this machine cannot render")
@pytest.mark.parametrize(("kind", "name"), [("wedge", "disk"), ("half_slab", "slab")])
def test_ten_values_are_read_off_a_solid(kind, name, request):
    """Places on its surface, in all directions to the viewer, and on its cut: no light on them, or none would fit."""
    shown = look(FolderStates(request.getfixturevalue(kind), name))
    states, scale = shown.states, shown.scales["von_mises"]
    step = states.main
    camera = shown.camera([0, step])
    with offscreen.studio(camera) as shoot, matplotlib.rc_context(STYLE):
        (data, style), *_ = layers = shown.coloured(step, scale)
        assert style["scalars"] == "values"
        figure = page(shoot(layers), shown.caption(step, camera, scale), scale)
    picture = np.asarray(drawn(figure))
    # Vertices before which nothing lies, off the lines.
    points, corners = np.asarray(data.points), data.regular_faces
    frame = np.column_stack([camera.axes, camera.direction])
    flat = (points - camera.focus) @ frame / camera.metres
    edges = flat[shown.states.skin.device_lines(np.concatenate([states.skin.edges, states.skin.rims]), shown.kept).ravel(), :2]
    a, b, c = flat[corners].transpose(1, 0, 2)
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    middle = np.array(camera.size) / 2
    found = np.unique(corners[area > 20])
    candidates = np.random.default_rng(3).permutation(found[centred(flat[found, :2] + middle)])
    places = []
    for vertex in candidates:
        at = flat[vertex]
        s = ((at - a)[:, 0] * (c - a)[:, 1] - (at - a)[:, 1] * (c - a)[:, 0]) / area
        t = ((b - a)[:, 0] * (at - a)[:, 1] - (b - a)[:, 1] * (at - a)[:, 0]) / area
        depth = a[:, 2] + s * (b - a)[:, 2] + t * (c - a)[:, 2]
        hit = (area > 0) & (s > -0.01) & (t > -0.01) & (s + t < 1.01)
        if depth[hit].max() < at[2] + 2 and np.linalg.norm(edges - at[:2], axis=1).min() > 8:
            places.append(vertex)
        if len(places) == 10:
            break
    pixels = (flat[places, :2] + middle) * (1, -1) + (0, picture.shape[0] - round(FOOT_INCHES * DPI))
    found = read_off(picture, pixels, scale)
    nodes = np.tile(states.skin.nodes, len(shown.kept))[places]
    compare(found, states.field(step, "von_mises")[nodes] * scale.factor, scale)


def test_a_hot_spot_is_marked_on_the_wall_that_has_it(wedge):
    """At the node with the largest stretch, or where ``path.csv`` has it; a place away from all walls is inside."""
    states = FolderStates(wedge, "disk")
    step, disk = states.main, states.actuator
    found = offscreen.hot_spot(states, step)
    node = int(np.argmax(states.field(step, "largest_stretch")))
    assert found.wall == "on the outer face" and np.linalg.norm(found.place - states.moved(step)[node]) < disk.cell_size
    for place, wall in (
        ((0.0, 0.0, disk.base), "on the cavity's wall"),
        ((0.0, 0.0, disk.height), "on the outer face"),
    ):
        row = {f"max_stretch_{axis}_mm": 1e3 * x for axis, x in zip("xyz", place, strict=True)}
        states.rows = PathTable([Row({**one.cells, "max_stretch": 1.5, **row}) for one in states.rows])
        found = offscreen.hot_spot(states, step)
        assert (found.value, found.wall) == (1.5, wall)
        assert np.linalg.norm(found.place - np.array(place)) < 3e-3


def test_a_films_gradients_are_not_banded():
    """A ramp over all colours with shading: dithered, the mean over a few pixels keeps the colour."""
    ramp = matplotlib.colormaps["viridis"](np.linspace(0, 1, solid.FRAME_WIDTH_PX))[:, :3]
    shade = np.linspace(0.6, 1.0, 120)[:, None, None]
    frames = [np.uint8(255 * np.clip(shade * ramp * k, 0, 1)) for k in (0.9, 0.95, 1.0)]
    with Image.open(io.BytesIO(solid.gif(frames))) as made:
        made.seek(2)
        shown = np.asarray(made.convert("RGB"), dtype=float)
    error = (shown - frames[2]).reshape(15, 8, solid.FRAME_WIDTH_PX // 8, 8, 3).mean(axis=(1, 3))
    assert np.sqrt((error**2).mean()) < 4.0  # bands of 160 colours of three frames: 7
    with Image.open(io.BytesIO(solid.webp(frames))) as made:
        assert made.size == (solid.FRAME_WIDTH_PX, 120) and made.n_frames == 3


def test_a_cut_has_no_seam_where_images_of_the_slice_meet(half_slab):
    """No line is drawn there: the halves of the cut are one face."""
    states = FolderStates(half_slab, "slab")
    plane = (np.array([0.0, 0.0, 1.0]), np.zeros(3))
    rim = cut_open(states, 0, plane, plane[0], Scale(states.field(1, "von_mises")))[2][0]
    ends = np.abs(rim.points[rim.lines.reshape(-1, 3)[:, 1:], 1])
    assert len(ends) > 20 and not (ends < 1e-7).all(axis=1).any()


def test_titles_of_three_cavities_stay_within_their_pictures():
    """A program of three cavities names three pressures: title, note and the titles of a sheet go on in further lines."""
    row = {
        "load_step": 2.25,
        "pressure_1_cm": 139.5,
        "pressure_2_cm": 140.2,
        "pressure_3_cm": 117.3,
    }
    states = SimpleNamespace(words=StateLabels("apex"))
    title = load(Row(row), states.words)
    note = f"largest stretch 2.345 at {title}; at the ring, undeformed position x = -10.21, y = -10.21, z = -10.21 mm"
    image = np.zeros((400, 533, 3), dtype=np.uint8)
    caption = Caption(f"{title} at the bifurcation, the mode; {note}", "HollowDisk, neo-hookean", note)
    for figure, columns in ((page(image, caption), 1), (solid.tiled([(title, image)] * 3, 1.0, "HollowDisk"), 3)):
        figure.draw_without_rendering()
        wide, tall = figure.bbox.width, figure.bbox.height
        top = max(image.get_window_extent().y1 for image in figure.artists if isinstance(image, Pixels))
        boxes = [text.get_window_extent() for text in figure.texts]
        boxes = [box for box in boxes if box.width > 1]
        assert all(box.width < 0.99 * wide / columns and box.y1 <= tall and box.y0 >= top for box in boxes)
        assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))


def test_a_gif_that_is_too_large_has_fewer_frames_in_the_same_colours(monkeypatch):
    across = np.linspace(0, 255, 64).astype(np.uint8)
    frames = [np.dstack(np.broadcast_arrays(across[:, None], across, np.uint8(8 * k))) for k in range(30)]

    def opened(data):
        with Image.open(io.BytesIO(data)) as made:
            return made.n_frames, made.getpalette()

    whole = solid.gif(frames)
    monkeypatch.setattr(solid, "MAX_GIF_BYTES", round(0.9 * len(whole)))
    less = solid.gif(frames)
    assert len(less) <= solid.MAX_GIF_BYTES
    assert opened(whole) == (30, opened(less)[1]) and opened(less)[0] == 25


def test_what_changes_slowly_does_not_lag_in_the_film():
    """Two shades of grey from one frame to the next beside a spot that moves: differences alone would leave the grey out."""
    across = np.linspace(40.0, 120.0, 240)[None, :, None] * np.ones((160, 1, 3))
    frames = [(across + 2 * k).astype(np.uint8) for k in range(30)]
    for k, frame in enumerate(frames):
        frame[60:90, 6 * k : 6 * k + 30] = 255
    with Image.open(io.BytesIO(solid.webp(frames))) as made:
        assert made.n_frames == len(frames)
        for k, frame in enumerate(frames):
            made.seek(k)
            assert np.abs(np.asarray(made.convert("RGB")).astype(float) - frame).mean() < 2.0, k
