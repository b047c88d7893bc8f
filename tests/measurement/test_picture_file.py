"""Files as cameras, phones and programs write them: the same light whatever the format, and the true reason where none is."""

from __future__ import annotations

import dataclasses
import io

import cv2
import numpy as np
import pillow_heif
import pytest
from click.testing import CliRunner
from PIL import Image, ImageCms

from measurement import photographer, pictures
from measurement.__main__ import main
from measurement.camera import read_exif
from measurement.photographer import Scene, chessboard, dome, photograph, save
from measurement.pictures import Unmeasurable, read_pixels
from measurement.screen.setup import Setup
from measurement.series.measuring import find_zero, outline_of, trace
from tests.support.campaigns import sampled
from tests.support.photographs.scenes import COARSE

SMALL = photograph(Scene(width=96, height=64, pixel_size=4e-4, noise=0.0, jpeg_quality=None), dome(8e-3), 1)[0]
SCENE = dataclasses.replace(COARSE, dust=0, jpeg_quality=None)
HEIGHT = 4e-3
QUICK = {"preset": "ultrafast"}


def deep(picture, bits, shift=0):
    """The picture with more bits, stored in 16."""
    return (np.round(picture.astype(float) * (2**bits - 1) / 255.0)).astype(np.uint16) << shift


def written(path, picture, kind):
    """The picture as a file of this kind."""
    image = Image.fromarray(picture)
    if kind in ("jpg", "cmyk.jpg"):
        (image.convert("CMYK") if kind == "cmyk.jpg" else image).save(path, quality=98, subsampling=0)
    elif kind == "heic":
        pillow_heif.from_pillow(image).save(path, quality=95, chroma=444, enc_params=QUICK)
    elif kind == "avif":
        image.save(path, quality=98, subsampling="4:4:4")
    elif kind == "webp":
        image.save(path, lossless=True)
    elif kind == "mpo":
        image.save(path, format="MPO", save_all=True, append_images=[image.resize((48, 32))], quality=98, subsampling=0)
    elif kind == "alpha.png":
        image.convert("RGBA").save(path)
    elif kind == "palette.png":
        image.quantize(256, dither=Image.Dither.NONE).save(path)
    elif kind[0] == "d":  # d12.png, d12+4.tif, dgrey16.png: colours or grey of so many bits, shifted up
        name = kind.removeprefix("d").removeprefix("grey").partition(".")[0]
        bits, _, shift = name.partition("+")
        whole = deep(picture, int(bits), int(shift or 0))
        cv2.imwrite(str(path), whole[..., 1] if "grey" in kind else whole[..., ::-1])
    else:
        image.save(path)
    return path


KINDS = {
    "png": 0.0, "tif": 0.0, "bmp": 0.0, "webp": 0.0, "alpha.png": 0.0, "palette.png": 6.0, "jpg": 6.0, "cmyk.jpg": 6.0,
    "heic": 8.0, "avif": 8.0, "mpo": 6.0, "d16.png": 0.0, "d16.tif": 0.0, "d12.png": 0.0, "d12.tif": 0.0, "d14.png": 0.0,
    "d10.tif": 0.0, "d12+4.tif": 0.0, "d12+4.png": 0.0,
}  # fmt: skip
"""Kinds of files, and by how much of 255 a pixel may differ from what was stored."""


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_file_holds_the_same_light(tmp_path, kind):
    """16 bits were cut to their upper 8, so that 12 of them were black; CMYK and HEIC were refused."""
    seen = read_pixels(written(tmp_path / f"a.{kind}", SMALL, kind), (96, 64))
    assert seen.shape == SMALL.shape and seen.dtype == np.uint8
    assert np.abs(seen.astype(int) - SMALL).max() <= KINDS[kind]


@pytest.mark.parametrize("kind", ["dgrey16.png", "dgrey12.tif", "dgrey12+4.png"])
def test_deep_grey_holds_the_same_light(tmp_path, kind):
    seen = read_pixels(written(tmp_path / f"a.{kind}", SMALL, kind))
    assert np.array_equal(seen, np.repeat(SMALL[..., 1:2], 3, axis=2))


@pytest.mark.parametrize("turn", range(1, 9))
@pytest.mark.parametrize("kind", ["heic", "jpg"])
def test_pictures_stay_as_the_sensor_saw_them_whatever_exif_asks(tmp_path, turn, kind):
    tags = Image.Exif()
    tags[0x0112], tags[0x0110] = turn, "Telephone 5"
    image, path = Image.fromarray(SMALL), tmp_path / f"a.{kind}"
    if kind == "heic":
        pillow_heif.from_pillow(image).save(path, quality=95, chroma=444, exif=tags.tobytes())
    else:
        image.save(path, quality=98, subsampling=0, exif=tags)
    assert np.abs(read_pixels(path, (96, 64)).astype(int) - SMALL).mean() < 1.0
    assert read_exif(path).camera == "Telephone 5"


def test_inks_become_colours_by_the_files_own_profile(tmp_path):
    """A profile whose curve is far from the plain rule's must be asked."""
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    Image.fromarray(SMALL).convert("CMYK").save(tmp_path / "a.jpg", icc_profile=profile, quality=98)
    # A profile of another colour space cannot be followed: the plain rule remains.
    assert np.abs(read_pixels(tmp_path / "a.jpg").astype(int) - SMALL).max() <= 6


def _two_pages(path):
    image = Image.fromarray(SMALL)
    image.save(path, save_all=True, append_images=[image.transpose(Image.Transpose.ROTATE_180)])


def _with_hole(path):
    whole = np.dstack([SMALL, np.full((64, 96), 255, np.uint8)])
    whole[20:30, 20:30, 3] = 0
    Image.fromarray(whole).save(path)


def _deep_cut_short(path):
    written(path, SMALL, "d16.png")
    path.write_bytes(path.read_bytes()[:-400])


def _huge(path):
    """A PNG whose header promises 4 terapixels."""
    Image.fromarray(SMALL).save(path)
    data = bytearray(path.read_bytes())
    data[16:24] = (2_000_000).to_bytes(4, "big") * 2
    data[29:33] = __import__("zlib").crc32(bytes(data[12:29])).to_bytes(4, "big")
    path.write_bytes(data)


REFUSED = {
    "a.pdf": (lambda path: path.write_bytes(b"%PDF-1.7\n..."), "PDF document"),
    "named.jpg": (lambda path: path.write_bytes(b"%PDF-1.7\n..."), "PDF document"),
    "a.mp4": (lambda path: path.write_bytes(b"\0\0\0\x18ftypmp42" + bytes(40)), "it is a video"),
    "a.mov": (lambda path: path.write_bytes(b"\0\0\0\x14ftypqt  " + bytes(40)), "it is a video"),
    "a.avi": (lambda path: path.write_bytes(b"RIFF\0\0\0\0AVI LIST" + bytes(40)), "it is a video"),
    "a.nef": (lambda path: Image.fromarray(SMALL).save(path, format="TIFF"), "raw file; develop it to a 16-bit TIFF"),
    "named raw.tif": (lambda path: path.write_bytes(b"II*\0\x10\0\0\0CR\x02\0" + bytes(40)), "raw file"),
    "a.cr3": (lambda path: path.write_bytes(b"\0\0\0\x18ftypcrx " + bytes(40)), "raw file"),
    "page.jpg": (lambda path: path.write_bytes(b"<!DOCTYPE html><html>404</html>"), "web page"),
    "drawing.png": (lambda path: path.write_bytes(b"<svg xmlns='http://www.w3.org/2000/svg'/>"), "it is a drawing"),
    "book.jpg": (lambda path: path.write_bytes(b"PK\3\4" + bytes(40)), "ZIP archive"),
    "script.eps": (lambda path: path.write_bytes(b"\xc5\xd0\xd3\xc6" + bytes(400)), "file is not a readable picture"),
    "script.jpg": (lambda path: path.write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n"), "PostScript"),
    "empty.jpg": (lambda path: path.write_bytes(b""), "file is empty"),
    "folder.jpg": (lambda path: path.mkdir(), "it is a folder, not a regular file"),
    "pages.tif": (_two_pages, "it holds 2 pictures"),
    "moving.gif": (_two_pages, "it holds 2 pictures"),
    "moving.png": (_two_pages, "it holds 2 pictures"),
    "moving.webp": (_two_pages, "it holds 2 pictures"),
    "hole.png": (_with_hole, "parts of it are transparent"),
    "short.png": (_deep_cut_short, "file is damaged"),
    "huge.png": (_huge, "2000000 x 2000000 pixels; reading it takes about 56000.0 GB"),
    "bits.png": (lambda path: Image.fromarray(SMALL).convert("1").save(path), "black or white only"),
    "float.tif": (lambda path: Image.fromarray(SMALL[..., 1] / np.float32(255)).save(path), "decimal numbers"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_photograph_is_refused_with_the_true_reason(tmp_path, name):
    make, reason = REFUSED[name]
    make(tmp_path / name)
    with pytest.raises(Unmeasurable, match=reason):
        read_pixels(tmp_path / name)
    done = CliRunner().invoke(main, ["setup", str(tmp_path / name), "-o", str(tmp_path / "setup.toml")])
    why = "has no frames that can be read" if reason == "it is a video" else reason  # a setup takes the first frame of a film
    assert done.exit_code == 2 and why in done.stderr and "Traceback" not in done.output


def test_a_thumbnail_beside_the_picture_is_no_second_page(tmp_path):
    image = Image.fromarray(SMALL)
    image.save(tmp_path / "a.tif", save_all=True, append_images=[image.resize((24, 16))])
    assert np.array_equal(read_pixels(tmp_path / "a.tif"), SMALL)


def test_a_large_picture_is_read_and_one_beyond_the_memory_named(tmp_path, monkeypatch):
    """Pillow's own limit called everything above 179 megapixels a bomb; what limits is this machine's memory."""
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 1000)
    Image.fromarray(SMALL).save(tmp_path / "a.png")
    assert np.array_equal(read_pixels(tmp_path / "a.png"), SMALL)
    assert Image.MAX_IMAGE_PIXELS == 1000
    monkeypatch.setattr(pictures, "free_memory", lambda: 50e3)
    with pytest.raises(Unmeasurable, match=r"96 x 64 pixels; reading it takes about 0.0 GB of memory, but 0.0 GB are free"):
        read_pixels(tmp_path / "a.png")


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    save(folder / "grid.png", photograph(SCENE, None, seed=1)[0])
    save(folder / "zero.png", photograph(SCENE, dome(0.0, floor=photographer.SURFACE_HEIGHT), seed=2)[0])
    words = ["setup", folder / "grid.png", "--lens", "none", "-o", folder / "setup.toml"]
    assert CliRunner().invoke(main, list(map(str, words))).exit_code == 0
    setup = Setup.from_file(folder / "setup.toml")
    return (
        setup,
        find_zero(folder / "zero.png", setup),
        photograph(SCENE, dome(HEIGHT, photographer.DISK_RADIUS, floor=photographer.SURFACE_HEIGHT), 3)[0],
    )


@pytest.mark.parametrize("kind", sampled(["dgrey16.png", "cmyk.jpg", "heic", "d12.tif"]))
def test_outlines_do_not_depend_on_the_kind_of_file(bench, tmp_path, kind):
    setup, zero, picture = bench
    traced = trace(written(tmp_path / f"a.{kind}", picture, kind), setup, likely=zero.tone)
    found = outline_of(traced, zero, 1000.0, 10.0, kind)
    assert found.trusted, found.reasons
    assert found.height == pytest.approx(HEIGHT, abs=15e-6)


@pytest.mark.campaign
def test_calibration_reads_the_same_files(tmp_path):
    scene = Scene(width=480, height=320, focal_px=600.0, pixel_size=25e-5)
    views = [dataclasses.replace(scene, tilt=tilt, pan=pan) for tilt, pan in ((20, 5), (-15, 20), (5, -25), (-20, -10))]
    names = []
    for number, view in enumerate(views):
        data = io.BytesIO()
        pillow_heif.from_pillow(Image.fromarray(chessboard(view))).save(data, quality=95, chroma=444, enc_params=QUICK)
        (tmp_path / f"{number}.heic").write_bytes(data.getvalue())
        names.append(str(tmp_path / f"{number}.heic"))
    done = CliRunner().invoke(main, ["calibrate", *names, "--pitch", "8mm", "-o", str(tmp_path / "camera.toml")])
    assert done.exit_code == 0, done.output
    assert "4 photographs used" in done.output
    # One view named twice ended in a traceback, and counted twice under another name.
    (tmp_path / "again.heic").write_bytes((tmp_path / "1.heic").read_bytes())
    words = ["--pitch", "8mm", "-o", str(tmp_path / "twice.toml")]
    twice = CliRunner().invoke(main, ["calibrate", *names, names[0], str(tmp_path / "again.heic"), *words])
    assert twice.exit_code == 3 and isinstance(twice.exception, SystemExit), twice.output
    assert "4 photographs used" in twice.output
    assert f"{names[0]}: refused, it is the same picture as {names[0]}, so it counts once" in twice.output
    assert f"again.heic: refused, it is the same picture as {names[1]}" in twice.output
