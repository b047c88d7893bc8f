"""What a run's photographs tell of each other, by the hundred: wrong rows, copies, and lists that are no lists.

Run it with ``uv run python tests/benchmarks/photo_series.py [ROWS [COPIES [LISTS]]]``: runs per kind of course (default 30),
benches whose photographs are copied (30), and damaged lists (2000); some minutes each. ``tests/measurement`` runs a few of
each. Before these checks all wrong rows were trusted, copies were found only byte for byte, and of lists a photograph whose
name begins with # was dropped without a word.
"""

from __future__ import annotations

import io
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from measurement import photographer
from measurement.photographer import Scene, dome, photograph
from measurement.series.photo_list import Column, PhotoListError, cut_out, is_copy, likeness, prepared, read_photos
from measurement.series.witness import Run
from tests.support.photographs.courses import COURSES, DAMAGES, damaged, run


def rows(count: int) -> None:
    """Good runs and damaged ones, all kinds of courses, 4 to 30 rows."""
    print(f"{'good runs':34s} rows not trusted   runs with one")
    for number, course in enumerate(COURSES):
        flagged = total = runs = 0
        for seed in range(count):
            rng = np.random.default_rng([seed, number])
            good = run(course, rng, _length(rng, seed))
            found = len(Run(dict(enumerate(good.outlines()))).contradictions)
            flagged, total, runs = flagged + found, total + len(good.heights), runs + bool(found)
        print(f"  {course:32s} {flagged:4d} of {total:5d}      {runs:3d} of {count}")
    print(f"\n{'one wrong row, or two':34s} caught        named   others blamed")
    for kind in DAMAGES:
        caught = named = blamed = 0
        for number, course in enumerate(COURSES):
            for seed in range(count):
                rng = np.random.default_rng([seed, number, 77])
                bad = damaged(kind, run(course, rng, _length(rng, seed)), rng)
                doubts = Run(dict(enumerate(bad.outlines()))).contradictions
                hit = [doubts[k] for k in bad.at if k in doubts]
                caught += bool(hit)
                named += any(word in why for why in hit for word in ("swapped", "ten times", "a tenth", "at zero pressure"))
                blamed += len(doubts.keys() - set(bad.at))
        total = count * len(COURSES)
        print(f"  {kind:32s} {caught:4d} of {total:4d}  {named:4d}    {blamed:4d}")


def _length(rng: np.random.Generator, seed: int) -> int:
    return int(rng.integers(4, 31 if seed % 2 else 11))


def copies(count: int) -> None:
    """Copies and honest repeats on random benches: camera, grain, compression, a camera that is nudged."""
    missed = made = taken = honest = 0
    weakest, strongest = 1.0, -1.0
    for seed in range(count):
        rng = np.random.default_rng([seed, 1234])
        take = _photographer(rng)
        heights = rng.uniform(2.0, 6.0, 4)
        others = [prepared(cut_out(take(height))) for height in heights]
        original = take(5.0)
        sample = prepared(cut_out(original))
        for _ in range(3):
            copy = prepared(cut_out(changed(original, rng)))
            weakest, made = min(weakest, likeness(sample, copy, others)), made + 1
            missed += not is_copy(sample, copy, others)
        for near in (5.0, 5.0, 5.02):
            again = prepared(cut_out(take(near)))
            strongest, honest = max(strongest, likeness(sample, again, others)), honest + 1
            taken += is_copy(sample, again, others)
    print(f"\ncopies: {missed} of {made} missed, weakest correlation {weakest:.3f}")
    print(f"honest repeats: {taken} of {honest} taken for copies, strongest correlation {strongest:.4f}")


def _photographer(rng: np.random.Generator):
    scene = Scene(
        width=1000, height=640, focal_px=1750.0, pixel_size=48e-6, tilt=rng.uniform(0.0, 15.0), pan=rng.uniform(-28.0, 28.0),
        target=(0.0, 0.001), ambient=0.12, penumbra=70e-6, dust=int(rng.integers(0, 6)), noise=rng.uniform(0.8, 4.0),
        jpeg_quality=int(rng.integers(85, 98)), brightness=rng.uniform(150.0, 225.0), srgb=True,
    )  # fmt: skip
    grain, nudge = rng.choice([0.0, rng.uniform(0.0, 0.03)]), rng.choice([0.0, 0.15])
    texture = cv2.GaussianBlur(rng.standard_normal((640, 1000)).astype(np.float32), (0, 0), 1.0)
    texture *= grain / texture.std()

    def take(height: float):
        moved = np.float32([[1, 0, nudge * rng.standard_normal()], [0, 1, nudge * rng.standard_normal()]])
        seen = cv2.warpAffine(texture, moved, (1000, 640), borderMode=cv2.BORDER_REFLECT)
        body = dome(height * 1e-3, photographer.DISK_RADIUS, floor=photographer.SURFACE_HEIGHT)
        return photograph(scene, body, int(rng.integers(2**31)), fault=lambda light, truth: light * (1.0 + seen))[0]

    return take


def changed(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A copy as programs make it: maybe brighter, of another gamma or resized, always compressed anew."""
    kind = rng.integers(4)
    if kind == 1:
        picture = np.uint8(np.clip(np.rint(picture * (1.0 + rng.choice([-1, 1]) * rng.uniform(0.02, 0.1))), 0, 255))
    elif kind == 2:
        picture = np.uint8(np.rint(255.0 * (picture / 255.0) ** rng.uniform(0.87, 1.15)))
    elif kind == 3:
        height, width = picture.shape[:2]
        share = rng.uniform(0.5, 0.95)
        small = cv2.resize(picture, (round(width * share), round(height * share)), interpolation=cv2.INTER_AREA)
        picture = cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC)
    data = io.BytesIO()
    Image.fromarray(picture).save(data, "JPEG", quality=int(rng.integers(70, 96)), subsampling=int(rng.choice([0, 2])))
    return np.asarray(Image.open(data).convert("RGB"))


WORDS = (
    *("a.jpg", "IMG_0004.JPG", "4", "#4.jpg", "", "./a.jpg", "..", "/dev/zero", "=1+1", '=HYPERLINK("x")', "a\tb.jpg"),
    *(
        "x" * 5000,
        "9" * 5000,
        "\u0664",
        "0 cm",
        "3 cm",
        "-3 cm",
        "3",
        "3,5 cm",
        "nan cm",
        "inf Pa",
        "1e400 kPa",
        "5 furlong",
    ),
    *(
        "1 kPa",
        "12 mmH2O",
        '"',
        '"a.jpg',
        "\x00",
        "\x1b[31m",
        "\u2028",
        "\ufeff",
        "pressure",
        "file",
        "-0 cm",
        "1e-320 m",
    ),
)
"""What may stand in a cell."""

ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "latin-1", "utf-32")


def broken_list(rng: np.random.Generator) -> bytes:
    """A list of photographs, more or less."""
    separator = str(rng.choice([",", ";", "\t", "|"], p=[0.6, 0.2, 0.15, 0.05]))
    header = list(rng.choice(["file", "pressure", "left", "right", "error", "note", ""], int(rng.integers(1, 5))))
    header = ["file", "pressure"] if rng.random() < 0.6 else header
    lines = [separator.join(header)]
    for _ in range(int(rng.integers(0, 6))):
        good = [f"{rng.integers(1, 9)}.jpg", f"{rng.integers(0, 30)} cm"]
        cells = [str(rng.choice(WORDS)) if rng.random() < 0.3 else cell for cell in good]
        if rng.random() < 0.1:
            cells.append(str(rng.choice(WORDS)))
        lines.append(separator.join(cells))
    text = str(rng.choice(["\n", "\r\n", "\r"])).join(lines)
    data = text.encode(str(rng.choice(ENCODINGS, p=[0.6, 0.1, 0.1, 0.05, 0.1, 0.05])), errors="replace")
    if rng.random() < 0.1 and data:
        at = int(rng.integers(len(data)))
        data = data[:at] + bytes(rng.integers(0, 256, 3, dtype=np.uint8)) + data[at:]
    return data


def read_broken(folder: Path, seed: int) -> str:
    """What became of a broken list: "read", or the sentence.

    Raises:
        AssertionError: The sentence is none.
    """
    path = folder / "photos.csv"
    path.write_bytes(broken_list(np.random.default_rng([seed, 99])))
    try:
        photos = read_photos(path, Column())
    except PhotoListError as error:
        sentence = str(error)
        assert sentence and "\n" not in sentence and "Errno" not in sentence and "codec" not in sentence, sentence
        return sentence
    assert photos and all(np.isfinite([photo.pressure, photo.pressure_error]).all() for photo in photos)
    return "read"


def lists(count: int) -> None:
    """Broken lists: each one read, or refused by a sentence."""
    with tempfile.TemporaryDirectory() as name:
        for file in ("1.jpg", "2.jpg", "IMG_0004.JPG", "#4.jpg"):
            (Path(name) / file).touch()
        outcomes = [read_broken(Path(name), seed) for seed in range(count)]
    print(f"\nlists: {outcomes.count('read')} of {count} read, the others refused by a sentence")


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:4]]
    rows_count, copies_count, lists_count = [*given, *(30, 30, 2000)[len(given) :]]
    if rows_count:
        rows(rows_count)
    if copies_count:
        copies(copies_count)
    if lists_count:
        lists(lists_count)
