"""Photographs and setups that must not be measured as good, each with its reason; and good ones that must stay good.

All photographs of one bench are measured by one command, as a user would have them: what is refused must not take the
others with it.
"""

from __future__ import annotations

import csv
import dataclasses
import itertools
import re

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from scipy.special import ndtr

from measurement import photographer
from measurement.__main__ import main
from measurement.outline.outline import Outline
from measurement.photographer import Scene, dome, photograph, save
from softmodels.fitting.outlines.residuals import read_heights
from softmodels.fitting.outlines.shapes import read_outlines
from tests.support.campaigns import sampled
from tests.support.photographs.scenes import COARSE

SCENE = dataclasses.replace(COARSE, dust=3)
HEIGHT, FLOOR = 4e-3, photographer.SURFACE_HEIGHT
DOME = dome(HEIGHT, photographer.DISK_RADIUS, floor=FLOOR)


def run(*words):
    done = CliRunner().invoke(main, [str(word) for word in words])
    assert not isinstance(done.exception, Exception), done.exception
    return done


def box(x0, x1, z0, z1):
    return np.array([[x0, z0], [x1, z0], [x1, z1], [x0, z1]]) * 1e-3 + [0.0, FLOOR]


def disk(x, z, radius):
    turn = np.linspace(0.0, 2.0 * np.pi, 80, endpoint=False)
    return np.column_stack([x + radius * np.cos(turn), z + radius * np.sin(turn)]) * 1e-3 + [0.0, FLOOR]


def turned(shape, degrees):
    a = np.radians(degrees)
    return (shape - [0.0, FLOOR]) @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]) + [0.0, FLOOR]


SEEDS = itertools.count(8)
"""Every exposure has noise of its own: photographs with one and the same are copies."""


def pixels(outline=DOME, things=(), fault=None, seed=None, **changes):
    seed = next(SEEDS) if seed is None else seed
    return photograph(dataclasses.replace(SCENE, **changes), outline, seed, things, fault)[0]


def glint(light, truth):
    """A bright reflection that eats a round piece of 2 mm out of the dome's top."""
    x, y = truth.to_pixels([[0.0, FLOOR + HEIGHT - 0.3e-3]])[0]
    rows, columns = np.indices(light.shape)
    return np.maximum(light, 0.95 * ndtr(25.0 - np.hypot(columns - x, rows - y)))


def finger(light, truth):
    """Something dark and out of focus before the lens, at the right of the picture."""
    return light * (1.0 - 0.95 * ndtr((np.arange(light.shape[1]) - 800.0) / 20.0))


def shaken(light, truth):
    return cv2.filter2D(light, -1, np.ones((41, 1), np.float32) / 41.0)


def veil(light, truth):
    return 0.35 * light + 0.65


def double(picture, other):
    """Two exposures in one: the mean of their light."""
    both = sum((part / 255.0) ** 2.2 for part in (picture, other)) / 2.0
    return np.uint8(np.rint(255.0 * both ** (1 / 2.2)))


PICTURES = {
    "actuator sunk deeply": (lambda: pixels(DOME - [0.0, 4.2e-3]), "below the"),
    "actuator raised": (lambda: pixels(DOME - [0.0, -0.25e-3]), "0.25 mm above the zero plane: the actuator"),
    "actuator tilted": (lambda: pixels(turned(DOME, 0.7)), "zero plane: the actuator|touches the frame"),
    "pole": (lambda: pixels(things=[box(-0.8, 0.8, 0, 8)]), "corner of .* second thing"),
    "pole at the side": (lambda: pixels(things=[box(4, 7, 0, 8)]), "corner of .* second thing"),
    "finger on top": (lambda: pixels(things=[box(-4, 4, 0, 5), disk(0, 5, 4)]), "corner of .* second thing"),
    "drop": (lambda: pixels(things=[disk(0, 4.0, 0.9)]), "corner of .* drop"),
    "glint": (lambda: pixels(fault=glint), "corner of .* hides part of it"),
    "thing reaches in from the side": (lambda: pixels(things=[box(10, 90, 0, 6)]), "touches the frame"),
    "thing hangs from above": (lambda: pixels(things=[box(-4, 4, 3, 90)]), "touches the frame"),
    "second shadow": (lambda: pixels(things=[box(-4, 4, 7, 90)]), "several shadows"),
    "finger before the lens": (lambda: pixels(fault=finger), "touches the frame"),
    "no shadow": (lambda: pixels(None), "no shadow|contrast"),
    "nothing but shadow": (lambda: pixels(dome(0.0, floor=0.1)), "no shadow|nothing but shadow|contrast"),
    "bulge taller than the picture": (lambda: pixels(dome(0.04, photographer.DISK_RADIUS, floor=FLOOR)), "touches the frame"),
    "bulge wider than the picture": (lambda: pixels(dome(9e-3, 0.06, floor=FLOOR)), "touches the frame"),
    "second lamp": (lambda: double(pixels(), pixels(DOME - [0.0, 1e-3])), "steps.* second lamp"),
    "blurred": (lambda: pixels(blur=8.0), "blurred over"),
    "half lit": (lambda: pixels(penumbra=500e-6), "blurred over"),
    "shaken": (lambda: pixels(fault=shaken), "blurred over|during the exposure|grid is not where|lines lie"),
    "flooded with light": (lambda: pixels(fault=veil), "contrast is too low"),
    "overexposed": (lambda: pixels(brightness=400.0), "overexposed"),
    "underexposed": (lambda: pixels(brightness=8.0), "underexposed"),
    "compressed": (lambda: pixels(jpeg_quality=5), "too much compressed"),
    "no grid": (lambda: pixels(line_grey=1e-3), "grid cannot be seen"),
    "another grid": (lambda: pixels(grid_pitch=0.010), "camera or the screen has moved|grid is not where"),
    "camera moved": (lambda: pixels(pan=SCENE.pan + 0.5), "camera or the screen has moved"),
    "camera turned": (lambda: pixels(roll=SCENE.roll + 0.3), "camera or the screen has moved"),
    "camera moved by a pitch": (lambda: pixels(target=(0.0, 0.010)), "below the surface|zero plane"),
    "zoomed": (lambda: pixels(pixel_size=40.8e-6), "camera or the screen has moved|grid is not where"),
    "upside down": (lambda: pixels()[::-1, ::-1], "turned or mirrored|turned, mirrored"),
    "mirrored": (lambda: pixels()[:, ::-1], "turned or mirrored|turned, mirrored"),
    "cropped and enlarged": (lambda: cv2.resize(pixels()[40:760, 60:1140], (1200, 800)), "moved|cropped"),
    "another size": (lambda: pixels()[:-1], "it has 1200 x 799 pixels, but the setup has 1200 x 800"),
    "negative": (lambda: 255 - pixels(), "grid cannot be seen|no shadow"),
    "black": (lambda: np.zeros((800, 1200, 3), np.uint8), "underexposed|blank|contrast|no shadow|grid"),
    "white": (lambda: np.full((800, 1200, 3), 255, np.uint8), "overexposed|blank|contrast|no shadow"),
}  # fmt: skip
"""Unusable pictures: how to make them, and what their reason must say."""

UNSURE = {
    "pencil": (
        lambda: pixels(things=[np.array([[-1.5, 0], [1.5, 0], [0, 9]]) * 1e-3 + [0, FLOOR]]),
        "corner of|thin dark thing|bends sharply|overhangs|not a rounded top",
    ),
    "dirty": (lambda: pixels(dust=1000, seed=7), "too dusty|bends sharply|gap|corner|touches"),
    "noisy": (lambda: pixels(noise=40.0), "too noisy|how the file stores light"),
    "hair": (lambda: pixels(things=[turned(box(-0.1, 0.1, 0, 7), 20)]), "thin dark thing"),
    "thread over the top": (lambda: pixels(things=[box(-50, 50, 3.95, 4.15)]), "thin dark thing"),
    "thread across": (lambda: pixels(things=[turned(box(-50, 50, 3.5, 4.5), 20)]), "thin dark thing|second thing"),
    "actuator sunk a little": (lambda: pixels(DOME - [0.0, 0.1e-3]), "0.10 mm below the zero plane.* moved"),
    "actuator sunk": (lambda: pixels(DOME - [0.0, 0.3e-3]), "0.30 mm below the zero plane.* moved"),
    "lamp moved": (lambda: pixels(magnification=1.05), "below the zero plane.* moved"),
    "speck on the flat surface": (lambda: pixels(dome(0.0, floor=FLOOR), [disk(0, 0, 1.0)]), r"only 1\.[5-8] mm wide"),
    "balloon": (lambda: pixels(dome(0.0, floor=FLOOR), [disk(0, 4, 8)]), "overhangs"),
    "edited curve": (lambda: np.uint8(255 * (pixels() / 255.0) ** 1.6), "store light as linear"),
}
"""Pictures that may be measured or not, but never be trusted."""

REFUSED = {"pencil", "noisy", "thread over the top", "thread across"}
"""Those of the doubtful ones that have no outline at all."""

GOOD = {
    "plain": (lambda: pixels(), HEIGHT),
    "flat": (lambda: pixels(dome(0.0, floor=FLOOR)), 0.0),
    "low": (lambda: pixels(dome(0.3e-3, photographer.DISK_RADIUS, floor=FLOOR)), 0.3e-3),
    "high": (lambda: pixels(dome(9e-3, photographer.DISK_RADIUS, floor=FLOOR)), 9e-3),
    "beside the middle": (lambda: pixels(dome(HEIGHT, photographer.DISK_RADIUS, 2e-3, FLOOR)), HEIGHT),
    "small": (lambda: pixels(dome(3e-3, 7e-3, floor=FLOOR)), 3e-3),
    "on a grid line": (lambda: pixels(dome(-FLOOR, photographer.DISK_RADIUS, floor=FLOOR)), -FLOOR),
    "dusty": (lambda: pixels(dust=25), HEIGHT),
    "vignetted": (lambda: pixels(unevenness=0.6), HEIGHT),
    "grey": (lambda: np.repeat(cv2.cvtColor(pixels(), cv2.COLOR_RGB2GRAY)[..., None], 3, axis=2), HEIGHT),
    "coloured": (lambda: np.uint8(pixels() * np.array([1.0, 0.4, 0.2])), HEIGHT),
    "noise 5": (lambda: pixels(noise=5.0), HEIGHT),
    "JPEG 85": (lambda: pixels(jpeg_quality=85), HEIGHT),
    "wide penumbra": (lambda: pixels(penumbra=150e-6), HEIGHT),
    "dark": (lambda: pixels(brightness=120.0), HEIGHT),
    "lamp beside": (lambda: pixels(DOME - [1e-3, 0.0]), HEIGHT),
}
"""Good pictures and the heights they show."""


ANYWAY = {
    ("unsure", "hair"): "anyway", ("bad", "overexposed"): "anyway", ("bad", "camera turned"): "anyway",
    ("bad", "no shadow"): "refused", ("bad", "camera moved by a pitch"): "refused",
}  # fmt: skip
"""What becomes of photographs that shall be used anyway: an outline with its doubts, or none where nothing can be measured."""

BY_DEFAULT = ("glint", "black", "pencil", "hair", "overexposed", "no shadow")
"""Unusable and doubtful ones that are photographed by default; campaigns photograph all."""


def written_files(folder):
    """Files that are no photographs, and the reasons they must get."""
    whole = (folder / "good 0.jpg").read_bytes()
    (folder / "short.jpg").write_bytes(whole[: len(whole) // 2])
    (folder / "text.jpg").write_text("this is no JPEG")
    (folder / "empty.jpg").write_bytes(b"")
    save(folder / "copy one.jpg", pixels(dome(5e-3, photographer.DISK_RADIUS, floor=FLOOR)))
    (folder / "copy two.jpg").write_bytes((folder / "copy one.jpg").read_bytes())
    return {
        "short.jpg": "file is damaged",
        "text.jpg": "file is not a readable picture",
        "empty.jpg": "file is empty",
        "missing.jpg": "there is no such file",
        "copy one.jpg": "same picture as copy two.jpg, listed at another pressure",
        "copy two.jpg": "same picture as copy one.jpg, listed at another pressure",
    }


@pytest.fixture(scope="module")
def bench(tmp_path_factory, request):
    """The folder, the command's outcome, heights.csv by file, and the reasons that files must get; of the pictures that this
    run's tests look at."""
    items = [item for item in request.session.items if item.path == request.path]
    anyway = [name for item in items if "anyway" in item.name for _, name in ANYWAY]
    asked = {item.callspec.params["kind"] for item in items if hasattr(item, "callspec")} | {
        "plain",
        *BY_DEFAULT,
        *anyway,
    }
    folder = tmp_path_factory.mktemp("refused")
    save(folder / "grid.jpg", photograph(SCENE, None, seed=1)[0])
    save(folder / "zero.jpg", photograph(SCENE, dome(0.0, floor=FLOOR), seed=2)[0])
    done = run("setup", folder / "grid.jpg", "--lens", "none", "-o", folder / "setup.toml")
    assert done.exit_code == 0, done.output
    names = {}
    for kind, table in (("bad", PICTURES), ("unsure", UNSURE), ("good", GOOD)):
        for number, (name, (make, _)) in enumerate(table.items()):
            if name in asked:
                names[kind, name] = save(folder / f"{kind} {number}.jpg", np.ascontiguousarray(make())).name
    files = written_files(folder)
    # Good photographs stand at the pressures of one smooth course; where the others stand does not matter.
    heights = {name: GOOD[kind][1] for (table, kind), name in names.items() if table == "good"}
    pressures = {name: f"{photographer.column(height):.2f}" for name, height in heights.items()}
    rows = [f"{name},{pressures.get(name, number + 1)} cm" for number, name in enumerate([*names.values(), *files])]
    (folder / "photos.csv").write_text("\n".join(["file,pressure", "zero.jpg,0 cm", *rows]) + "\n")
    done = measured(folder, folder / "photos.csv")
    table = csv.DictReader((folder / "out" / "heights.csv").read_text().splitlines())
    return folder, done, {row["file"]: row for row in table}, names, files


def measured(folder, listing, *words, setup=None):
    return run("photos", listing, "--setup", setup or folder / "setup.toml", "-o", listing.parent / "out",
               "--jobs", "1", "--no-pictures", *words)  # fmt: skip


def test_the_exit_status_says_that_some_were_refused(bench):
    folder, done, rows, names, files = bench
    assert done.exit_code == 3
    assert len(rows) == 1 + len(names) + len(files)
    weak = sum(row["trusted"] == "no" for row in rows.values())
    assert weak and f", {weak} of them untrusted; written to" in done.output
    for name, row in rows.items():
        if row["trusted"] == "refused":
            assert f"{name}: refused, {row['remarks']}" in done.stderr
            assert not (folder / "out" / name.replace(".jpg", ".csv")).exists()


@pytest.mark.parametrize("kind", sampled(PICTURES, BY_DEFAULT))
def test_unusable_photographs_are_refused_with_their_reason(bench, kind):
    _, _, rows, names, _ = bench
    row = rows[names["bad", kind]]
    assert row["trusted"] == "refused", row
    assert not row["height_m"]
    assert_reason(row, PICTURES[kind][1])


def test_unusable_files_are_refused_with_their_reason(bench):
    _, _, rows, _, files = bench
    for name, reason in files.items():
        assert rows[name]["trusted"] == "refused", name
        assert_reason(rows[name], reason)


@pytest.mark.parametrize("kind", sampled(UNSURE, BY_DEFAULT))
def test_doubtful_photographs_are_not_trusted(bench, kind):
    _, _, rows, names, _ = bench
    row = rows[names["unsure", kind]]
    assert row["trusted"] == ("refused" if kind in REFUSED else "no"), row
    assert_reason(row, UNSURE[kind][1])


@pytest.mark.parametrize("kind", sampled(GOOD, 2))
def test_good_neighbours_stay_good(bench, kind):
    _, _, rows, names, _ = bench
    row = rows[names["good", kind]]
    assert row["trusted"] == "yes", row
    assert float(row["height_m"]) == pytest.approx(GOOD[kind][1], abs=15e-6)
    assert float(row["height_error_m"]) < 15e-6


@pytest.mark.campaign
def test_a_photograph_is_used_anyway_with_its_doubts(bench, tmp_path):
    folder, _, _, names, _ = bench
    files = {key: names[key] for key in ANYWAY}
    lines = [f"{folder / name},{number} cm,anyway" for number, name in enumerate(files.values(), 2)]
    listing = tmp_path / "photos.csv"
    listing.write_text("\n".join(["file,pressure,use", f"{folder / 'zero.jpg'},0 cm,", *lines]))
    done = measured(folder, listing)
    found = {row["file"]: row for row in csv.DictReader((tmp_path / "out" / "heights.csv").read_text().splitlines())}
    for key, name in files.items():
        row = found[name]
        assert row["trusted"] == ANYWAY[key], (key, row)
        if ANYWAY[key] == "anyway":
            assert_reason(row, (PICTURES | UNSURE)[key[1]][1])
            file = tmp_path / "out" / name.replace(".jpg", ".csv")
            assert read_outlines([file])[0].reasons == Outline.from_csv(file).reasons != ()
            assert read_heights(tmp_path / "out" / "heights.csv")
    assert "3 to be used anyway" in done.output
    listing.write_text(listing.read_text().replace("anyway", "always", 1))
    done = measured(folder, listing)
    assert done.exit_code == 2 and "use is 'always'; write anyway" in done.stderr


def assert_reason(row, reason):
    assert re.search(reason, row["remarks"]), row["remarks"]


def listing(folder, tmp_path, picture, name="zero.jpg"):
    """A list whose zero photograph is this picture, beside a good photograph."""
    if picture is not None:
        save(tmp_path / name, np.ascontiguousarray(picture))
    path = tmp_path / "photos.csv"
    path.write_text(f"file,pressure\n{tmp_path / 'zero.jpg'},0 cm\n{folder / 'good 0.jpg'},5 cm\n")
    return path


ZEROS = {
    "inflated": (lambda: pixels(), "not straight"),
    "turned": (lambda: pixels(turned(dome(0.0, floor=FLOOR), 25.0)), "no level upper side|inclined"),
    "without shadow": (lambda: pixels(None), "no shadow|contrast"),
    "missing": (lambda: None, "no such file"),
}


@pytest.mark.campaign
@pytest.mark.parametrize("kind", sampled(ZEROS))
def test_a_series_without_a_usable_zero_is_not_measured(bench, tmp_path, kind):
    done = measured(bench[0], listing(bench[0], tmp_path, ZEROS[kind][0]()))
    assert done.exit_code == 1
    assert_reason({"remarks": done.stderr}, "no photograph at zero pressure shows the undeformed surface")
    assert_reason({"remarks": done.stderr}, ZEROS[kind][1])
    assert not (tmp_path / "out").exists()


def test_a_list_without_a_zero_is_bad_input(bench, tmp_path):
    (tmp_path / "photos.csv").write_text(f"file,pressure\n{bench[0] / 'good 0.jpg'},5 cm\n")
    done = measured(bench[0], tmp_path / "photos.csv")
    assert done.exit_code == 2
    assert "the undeformed surface is unknown" in done.stderr


@pytest.mark.campaign
def test_the_region_of_interest_must_not_cut_the_shadow(bench, tmp_path):
    folder = bench[0]
    for roi, reason in (
        ("300,100,560,700", "touches the frame or the region"),
        ("0,520,1200,800", "touches the frame|grid|highest|no shadow"),
    ):
        words = ("--roi", roi, "--zero", "10,650=1190,640", "--lens", "none", "-o", tmp_path / "cut.toml")
        assert run("setup", folder / "grid.jpg", *words).exit_code == 0
        done = measured(folder, listing(folder, tmp_path, None), setup=tmp_path / "cut.toml")
        assert done.exit_code == 1
        assert_reason({"remarks": done.stderr}, reason)


SETUPS = {
    "no grid": (lambda: pixels(None, line_grey=1e-3), (), "no grid was found"),
    "blurred grid": (lambda: pixels(None, blur=40.0), (), "no grid was found"),
    "blank": (lambda: np.full((800, 1200, 3), 200, np.uint8), (), "picture is blank"),
    "black": (lambda: np.zeros((800, 1200, 3), np.uint8), (), "picture is blank"),
    "nothing but shadow": (lambda: pixels(dome(0.0, floor=0.1), line_grey=1e-3), (), "no grid was found"),
    "noise": (lambda: np.random.default_rng(0).integers(0, 255, (800, 1200, 3), dtype=np.uint8), (), "no grid was found"),
    "grid turned by 45 degrees": (lambda: pixels(None, roll=45.0, pan=0.0, tilt=0.0), (), "turned by about 45 degrees"),
    "no unit": (lambda: pixels(None), ("--grid-pitch", "9"), "has no unit"),
    "negative pitch": (lambda: pixels(None), ("--grid-pitch", "-9mm"), "must be a positive length"),
    "region outside": (lambda: pixels(None), ("--roi", "0,0,1300,800"), "region of interest"),
    "zero of one point": (lambda: pixels(None), ("--zero", "10,600=10,600"), "zero line needs two different"),
    "lamp without screen": (lambda: pixels(None), ("--lamp-distance", "2m"), "give both"),
}  # fmt: skip


@pytest.mark.parametrize("kind", sampled(SETUPS, 4))
def test_unusable_setups_are_refused_with_their_reason(tmp_path, kind):
    make, options, reason = SETUPS[kind]
    path = save(tmp_path / "grid.jpg", make())
    done = run("setup", path, "--lens", "none", *options, "-o", tmp_path / "setup.toml")
    assert done.exit_code == 2, done.output
    assert_reason({"remarks": done.stderr}, reason)
    assert not (tmp_path / "setup.toml").exists()


def test_a_scene_needs_polygons_for_its_things():
    from measurement.photographer import SceneError

    with pytest.raises(SceneError, match="polygon"):
        photograph(Scene(), DOME, things=[[[0.0, 0.0], [1.0, 1.0]]])
