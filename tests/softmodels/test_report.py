"""The report and the film: complete, small, of one file, and with the numbers of path.csv."""

from __future__ import annotations

import base64
import csv
import gzip
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

from softmodels.pictures.offscreen import look
from softmodels.pictures.report import packed
from softmodels.pictures.solid import MAX_GIF_BYTES
from softmodels.runs.grid import CUT_LABEL, SECTOR_DEGREES, turn
from softmodels.runs.states import FolderStates

VOID = {"meta", "link", "img", "input", "br", "hr"}


class Page(HTMLParser):
    """What a report consists of; fails on tags that do not nest."""

    def __init__(self, text):
        super().__init__()
        self.open, self.sources, self.rows, self.cell, self.texts = [], [], [], None, {}
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.sources += [given[key] for key in ("src", "href", "xlink:href", "srcset", "data") if key in given]
        if tag not in VOID:
            self.open.append((tag, given))
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append(["", given.get("title")])

    def handle_startendtag(self, tag, attributes):
        self.sources += [value for key, value in attributes if key in ("src", "href", "xlink:href")]

    def handle_endtag(self, tag):
        assert self.open.pop()[0] == tag

    def handle_data(self, data):
        if any(tag in ("td", "th") for tag, _ in self.open):
            self.rows[-1][-1][0] += data
        if self.open and self.open[-1][0] == "script":
            self.texts[self.open[-1][1].get("id")] = data


@pytest.fixture(scope="module", params=["wedge", "half_slab"])
def report(request, drawn):
    folder, _ = drawn(request.param)
    text = (folder / "report.html").read_text()
    return folder, text, Page(text)


def test_nothing_is_fetched(report):
    _, text, page = report
    assert page.sources and all(source.startswith(("data:", "#")) for source in page.sources)
    assert not re.search(r"@import|url\(\s*['\"]?http|importScripts|fetch\(|XMLHttpRequest", text)


def test_it_is_small(report):
    _, text, _ = report
    assert len(text.encode()) < 6e6


def test_its_view_finds_every_part_of_the_page(report):
    _, text, _ = report
    asked = set(re.findall(r'find\("(\w+)"\)', text)) | set(
        re.findall(r"for \(const id of \[([^\]]+)\]", text)[0].split('"')[1::2]
    )
    assert asked >= {"canvas", "middle", "cut"} and all(f'id="viewer-{part}"' in text for part in asked)


def test_its_table_has_the_numbers_of_the_path(report):
    folder, _, page = report
    with (folder / "path.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["requested"] == "1"]
    found = [row for row in page.rows if row[0][0] == "pressure (Pa)"]
    assert len(found) == 2  # requested values, and all steps
    # The first table of the two: "All steps" comes later and has a column for each.
    table = {row[0][0]: row[1:] for row in page.rows if len(row) == 1 + len(rows) and row[1][1] is not None}
    # A column that nobody knows of yet is there like the others.
    names = {"pressure (cm)": "pressure_cm", "added volume (ml)": "added_volume_ml", "of tomorrow (N)": "of_tomorrow_N"}
    for words, column in names.items():
        assert [exact for _, exact in table[words]] == [row[column] for row in rows]
        assert [float(shown) for shown, _ in table[words]] == pytest.approx([float(r[column]) for r in rows], rel=5e-6)


def test_parameters_are_told_with_their_units(report):
    folder, _, page = report
    told = {row[0][0]: row[1][0] for row in page.rows if len(row) == 3}
    lengths = ("cavity radius", "10 mm") if "slab" not in folder.name else ("thickness", "8 mm")
    assert told[lengths[0]] == lengths[1] and told["shear modulus"] == "30 kPa"


def test_the_film_runs_over_the_path(drawn):
    folder, _ = drawn("wedge")
    assert (folder / "film.gif").stat().st_size < MAX_GIF_BYTES
    with Image.open(folder / "film.gif") as film:
        assert film.width >= 960 and 10 <= film.n_frames <= 60
        first = np.asarray(film.convert("L"), dtype=float)
        film.seek(film.n_frames - 1)
        last = np.asarray(film.convert("L"), dtype=float)
    assert np.abs(first - last).mean() > 1.0


def test_the_view_holds_the_steps(report):
    """Unpacked as the page's own program does it, against the results."""
    folder, _, page = report
    meta = json.loads(page.texts["viewer-meta"])
    data = np.frombuffer(gzip.decompress(base64.b64decode(page.texts["viewer-data"])), dtype=np.uint8)
    n, at = meta["vertices"], 0

    def column(count):
        nonlocal at
        low, high = data[at : at + 2 * count].reshape(2, count).astype(np.uint16)
        at += 2 * count
        return low | high << 8

    def numbers(count):
        low = column(count)
        return low.astype(int) | column(count).astype(int) << 16

    triangles, edges = numbers(3 * meta["triangles"]).reshape(-1, 3), numbers(2 * meta["edges"])
    states = FolderStates(folder, "slab" if "slab" in folder.name else "disk")
    skin, last = states.skin, len(states.rows) - 1
    cells = numbers(states.cells.size).reshape(states.cells.shape)
    assert (cells == states.cells).all() and meta["cells"] == len(cells) and set(edges) == set(skin.nodes[skin.edges].flat)
    place, fields = np.zeros(3 * n, dtype=np.uint16), np.zeros((2, n), dtype=np.uint16)
    for _ in meta["steps"]:
        place = place + column(3 * n)
        fields = fields + np.array([column(n), column(n)])
    assert at == len(data) and n == len(states.points)
    shown = np.array(meta["low"]) + meta["span"] * place.reshape(-1, 3) / 65535
    assert shown == pytest.approx(states.moved(last), abs=1e-5 * meta["span"])
    seen = skin.nodes[skin.triangles[skin.part != -1]]
    assert np.unique(np.sort(triangles, axis=1), axis=0).tolist() == np.unique(np.sort(seen, axis=1), axis=0).tolist()
    for name, field, parts in zip(("von_mises", "largest_stretch"), meta["fields"], fields, strict=True):
        values = states.field(last, name) * (1e-3 if name == "von_mises" else 1.0)
        found = field["low"] + (field["top"] - field["low"]) * (parts / 65535) ** (1 / field["power"])
        assert found == pytest.approx(np.minimum(values, field["top"]), rel=1e-3)


@pytest.mark.parametrize("kind", ["wedge", "half_section"])
def test_the_cells_of_the_view_fill_the_silicone(kind, request):
    """What the view cuts: the parts of each cell have its volume, and no gap is between them."""
    states = FolderStates(request.getfixturevalue(kind), "disk")
    skin, meta = states.skin, packed(look(states), [0])[0]
    cells = states.cells
    points = skin.points(states.points)
    if kind == "half_section":
        cells = np.concatenate([cells, cells + len(states.points)], axis=1)
    nodes = states.points if kind == "wedge" else np.concatenate([states.points, states.points @ turn(SECTOR_DEGREES).T])
    corners = nodes[cells[:, meta["split"]]].reshape(-1, 4, 3)
    volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])).sum() / 6
    a, b, c = points[skin.triangles].transpose(1, 0, 2)
    assert volume == pytest.approx((np.cross(a, b) * c).sum() / 6, rel=1e-9)  # inside the closed surface


def test_a_long_path_leaves_steps_out_of_the_view(wedge, monkeypatch):
    monkeypatch.setattr("softmodels.pictures.report.MAX_VIEW_VALUES", 1)
    states = FolderStates(wedge, "disk")
    from softmodels.pictures.report import view

    shown = view(look(states))
    kept = [step["step"] for step in json.loads(shown["meta"])["steps"]]
    assert kept == [0, 2, 3, 5]  # the requested ones, first and last
    assert "2 of 6 steps are omitted" in shown["left_out"]
    assert packed(look(states), [0, 5])[0]["steps"][1]["label"].startswith("110 cm")


def seen_from(meta, triangles, values, places, size):
    """Numbers along the colours that a viewer sees at places of the canvas, those in front of all else; NaN beside the device.

    Args:
        meta: The view's description.
        triangles: Corners of all its triangles, shape (t, 3, 3).
        values: There, shape (t, 3).
        places: From the lower left corner in px, shape (n, 2).
        size: Of the canvas in px.
    """
    flat = projected(meta, triangles, size)
    depth = triangles @ np.array(meta["direction"])
    found = []
    for place in places:
        (ax, ay), (bx, by), (cx, cy) = np.moveaxis(flat - place, 0, -1)
        shares = np.stack([bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx], axis=1)
        with np.errstate(invalid="ignore"):
            shares /= shares.sum(axis=1, keepdims=True)
        hit = np.flatnonzero((shares >= 0).all(axis=1) & np.isfinite(shares).all(axis=1))
        front = hit[np.argmax((shares[hit] * depth[hit]).sum(axis=1))] if len(hit) else None
        found.append(np.nan if front is None else shares[front] @ values[front])
    return np.array(found)


def projected(meta, points, size):
    """Where points in m, shape (..., 3), are on the canvas as the view begins, in px from its lower left corner."""
    towards, (wide, tall) = np.array(meta["direction"]), size
    right = np.cross(meta["up"], towards) / np.linalg.norm(np.cross(meta["up"], towards))
    axes = np.stack([right, np.cross(towards, right)])
    half = meta["scale"] * max(1.0, meta["aspect"] * tall / wide)
    return (points - np.array(meta["focus"])) @ axes.T * tall / half / 2 + np.array(size) / 2


@pytest.mark.campaign
def test_its_view_shows_the_field_in_a_browser(browser, report):
    """Ten places of the 3-D view, as WebGL has drawn them, have the colour of the field there, within one of the 256 steps
    of the bar and half of one within the pixel."""
    folder, _, page = report
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    tab = context.new_page()
    tab.goto((folder / "report.html").as_uri())
    tab.wait_for_selector('#viewer[data-drawn="yes"]', state="attached")
    tab.select_option("#viewer-axis", "-1")
    meta = json.loads(page.texts["viewer-meta"])
    states = FolderStates(folder, "disk" if "disk" in folder.name else next(folder.glob("*.h5")).stem)
    shown, skin, step = look(states), states.skin, states.main
    size = tab.evaluate("(({width, height}) => [width, height])(document.getElementById('viewer-canvas'))")
    moved, rest = (skin.device(skin.points(points)) for points in (states.moved(step), states.points))
    triangles, lines = skin.device_triangles(skin.part != CUT_LABEL), skin.device_lines(skin.edges)
    along = np.linspace(0.0, 1.0, 200)[:, None, None]
    ends = np.concatenate([moved[lines], rest[lines]])
    edges = projected(meta, (1 - along) * ends[:, 0] + along * ends[:, 1], size)
    dice = np.random.default_rng(1)
    places = dice.integers((0, 0), size, (400, 2)) + 0.5  # the middles of pixels
    places = places[[np.linalg.norm(edges - place, axis=-1).min() > 6 for place in places]]
    ramp = np.array(meta["colours"])
    for number, (name, scale) in enumerate(shown.scales.items()):
        tab.select_option("#viewer-field", str(number))
        tab.wait_for_function("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))")
        values = np.tile(scale.share(states.field(step, name))[skin.nodes], len(skin.images))
        wanted = seen_from(meta, moved[triangles], values[triangles], places, size)
        on = np.flatnonzero(np.isfinite(wanted))[:10]
        assert len(on) == 10
        read = np.array(tab.evaluate(READ, [[int(x), int(y)] for x, y in places[on]]))
        colours = np.argmin(np.linalg.norm(read[:, None, :3] - ramp, axis=2), axis=1)
        assert np.abs(read[:, :3] - ramp[colours]).max() <= 2
        assert colours / 255 == pytest.approx(wanted[on], abs=1.5 / 255) and np.ptp(wanted[on]) > 0.05
    context.close()


READ = """places => {
  const gl = document.getElementById("viewer-canvas").getContext("webgl2"), pixel = new Uint8Array(4);
  return places.map(([x, y]) => { gl.readPixels(x, y, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel); return [...pixel]; });
}"""
