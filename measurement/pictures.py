"""Photographs as light: reading the file, undoing its gamma curve, and taking values between pixels.

A shadow's edge lies where half of the lamp is visible, which is half of the light and not half of the stored number: in a
JPEG the two differ by a good part of the penumbra's width. So the stored numbers go through sRGB's curve first
(IEC 61966-2-1), at the pixels that are looked at only.
"""

from __future__ import annotations

import contextlib
import functools
import io
import os
import re
import warnings
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageCms, UnidentifiedImageError

from softmodels.common import errors, files
from softmodels.common.arrays import Array

# ----------------------------------------------------------------------------------------------------------------------
# Recognise files that are not photographs by their first bytes, and say how to fix it.
#
# Pillow opens many raw files as TIFF and then reads the small preview in them: their kind has to be known before.


READABLE_FORMATS = "JPEG, PNG, TIFF, HEIC, WebP, AVIF, JPEG 2000, MPO or BMP"

RAW_ENDINGS = frozenset(
    {f".{name}" for name in re.findall(r"\w+", """
    3fr arw cr2 cr3 crw dcr dng erf fff iiq k25 kdc mef mos mrw nef nrw orf pef raf raw rw2 rwl sr2 srf srw x3f
    """)}
)  # fmt: skip
"""Endings of cameras' raw files; most of them are TIFF inside, so that their first bytes do not identify them."""

RAW_HINT = "it is a camera's raw file; develop it to a 16-bit TIFF, without lens correction, cropping or turning, and list that"

VIDEO_HINT = (
    "it is a video; save single pictures of it as PNG, at the measured pressures, and list those, or give a film from the side "
    "to softmodels measure view"
)

_SIGNATURES: dict[str, tuple[tuple[int, bytes], ...]] = {
    "it is a PDF document; save the photograph in it as a picture (pdfimages does), and list that": ((0, b"%PDF"),),
    "it is a PostScript document, not a photograph": ((0, b"%!PS"),),
    RAW_HINT: (
        (0, b"FUJIFILMCCD-RAW"), (0, b"IIRO"), (0, b"IIRS"), (0, b"MMOR"), (0, b"IIU\0"), (0, b"FOVb"), (0, b"\0MRM"),
        (8, b"CR\x02"), (6, b"HEAPCCDR"), (4, b"ftypcrx"),
    ),
    VIDEO_HINT: (
        (0, b"\x1a\x45\xdf\xa3"), (0, b"FLV"), (0, b"\0\0\1\xba"), (0, b"\0\0\1\xb3"), (0, b"\x30\x26\xb2\x75"), (8, b"AVI "),
    ),
    "it is a ZIP archive or an office document; take the photograph out of it, and list that": ((0, b"PK\3\4"),),
    "it is a JPEG XL picture, which cannot be read; save it as PNG or TIFF": ((0, b"\xff\x0a"), (4, b"JXL ")),
    "it is a Git LFS pointer instead of the picture; fetch it with git lfs pull": ((0, b"version https://git-lfs"),),
}  # fmt: skip
"""What a file is, as the reason for its refusal, and the bytes at an offset that tell it."""

_STILLS = frozenset(b"heic heix heim heis hevc hevx mif1 msf1 miaf avif avis jp2".split())
"""Brands of ISO base media files that are pictures; every other brand is a video or sound."""


def foreign_kind(path: Path) -> str | None:
    """Return why a file is no photograph that can be read, as far as its first bytes and its ending tell; None if they do
    not."""
    with path.open("rb") as file:
        head = file.read(512)
    if not head:
        return f"the file is empty; use {READABLE_FORMATS}"
    if path.suffix.lower() in RAW_ENDINGS:
        return RAW_HINT
    for what, marks in _SIGNATURES.items():
        if any(head[offset:].startswith(mark) for offset, mark in marks):
            return what
    if head[4:8] == b"ftyp" and head[8:12].strip() not in _STILLS:
        return VIDEO_HINT
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    if text.startswith((b"<!doctype html", b"<html")):
        return "it is a web page instead of a picture; download the picture again"
    if text.startswith((b"<svg", b"<?xml")):
        return f"it is a drawing or another XML file, not a photograph; use {READABLE_FORMATS}"
    return None


# ----------------------------------------------------------------------------------------------------------------------
# Pixels of a picture file, whatever its format and depth: unturned, and on one scale from 0 to 255.
#
# The lens and the screen were measured in the sensor's own pixels, so nothing turns a picture here: the orientation that EXIF
# asks viewers for is kept, and the turn that HEIC's decoder makes by itself is taken back.


Pixels = npt.NDArray[np.uint8]

BIT_DEPTHS = (8, 10, 12, 14, 16)
"""Bits that cameras count light in; files keep more than 8 of them in 16."""

MEMORY_PER_PIXEL, MEMORY_PER_DEEP_PIXEL = 14, 25
"""Bytes per pixel that decoding takes at its peak, measured: with 8 bits per channel, and with more."""

MOST_MEMORY = 0.8
"""Share of the memory now free that one picture may take."""

WITH_PAGES = {"TIFF", "GIF", "WEBP", "PNG"}
"""Formats whose further pictures are pages or an animation; in MPO and HEIC they belong to the one photograph."""

DEEP_FORMATS = {"PNG", "TIFF"}
"""Formats of which Pillow reads 16-bit colour as 8 bits, without a word."""

FORMATS = ("JPEG", "PNG", "TIFF", "HEIF", "WEBP", "AVIF", "JPEG2000", "BMP", "GIF", "PPM")
"""Formats that are read (MPO as JPEG). Pillow knows more, and lets other programs run some of them, such as PostScript."""

_UNUSABLE = {
    "1": "black or white only, without the grey levels of an edge",
    "F": "decimal numbers, whose scale is not known",
    "LAB": "in the colours of CIELAB",
    "HSV": "in the colours of HSV",
}
"""Modes of Pillow whose pixels are no light that could be measured."""

_UNTURNED = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_90,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_270,
}
"""What takes back the turn that EXIF's orientation asks for."""


class Unmeasurable(ValueError):
    """A photograph that cannot or must not be measured; the message is the reason, for the user."""


@contextlib.contextmanager
def opened(path: Path) -> Iterator[Image.Image]:
    """Provide a picture file, opened but not decoded; no size is too large here, `read_pixels` looks at the memory. Raises
    `Unmeasurable` for no file, no picture, or one of a kind that cannot be read."""
    try:
        files.check_file(path)
        foreign = foreign_kind(path)
    except FileNotFoundError:
        raise Unmeasurable("there is no such file; check its name and folder") from None
    except OSError as error:
        raise Unmeasurable(
            f"the file cannot be read ({errors.reason(error)}); check its permissions, or copy it again"
        ) from None
    if foreign is not None:
        raise Unmeasurable(foreign)
    _know_heic()
    most = Image.MAX_IMAGE_PIXELS
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # odd tags are no reason; what cannot be decoded raises
        # Pillow's own limit of 179 megapixels would name a good photograph a bomb.
        Image.MAX_IMAGE_PIXELS = None
        try:
            with Image.open(path, formats=FORMATS) as picture:
                yield picture
        except UnidentifiedImageError:
            raise Unmeasurable(f"the file is not a readable picture; use {READABLE_FORMATS}") from None
        finally:
            Image.MAX_IMAGE_PIXELS = most


def read_pixels(path: Path, size: tuple[int, int] | None = None) -> Pixels:
    """Return a photograph (h, w, 3) as it left the sensor, unturned: the lens and the screen were measured in its own pixels.
    A grey picture has three equal channels.

    More than 8 bits are brought to 8: counted from the greatest number that the depth allows, which is the least of 8, 10,
    12, 14 and 16 bits that holds the picture's greatest value. Rounding to 1/255 of the light moves an edge by some
    hundredths of a pixel at most.

    Raises `Unmeasurable` for no pixels, another size (width, height) than given, or too large for this machine's memory.
    """
    path = Path(path)
    try:
        with opened(path) as picture:
            # What a reader has turned already; HEIC's does.
            orientation = int(picture.info.get("original_orientation") or 1) if picture.format == "HEIF" else 1
            wide, high = picture.size if orientation not in (5, 6, 7, 8) else picture.size[::-1]
            if size is not None and (wide, high) != size:
                raise Unmeasurable(
                    f"it has {wide} x {high} pixels, but the setup has {size[0]} x {size[1]}; give the pictures as the camera "
                    f"took them, neither cropped nor made smaller"
                )
            _check_memory(wide, high, MEMORY_PER_DEEP_PIXEL if _is_deep(picture) else MEMORY_PER_PIXEL)
            _check_pages(picture)
            pixels = _decoded_picture(path, picture)
    except Unmeasurable:
        raise
    except Exception as error:  # the decoders raise whatever a damaged file leads them into
        why = errors.reason(error) or type(error).__name__
        raise Unmeasurable(f"the file is damaged ({why}); copy it from the camera again") from None
    if orientation in _UNTURNED:
        pixels = np.asarray(Image.fromarray(pixels).transpose(_UNTURNED[orientation]))
    return np.ascontiguousarray(pixels)


def _decoded_picture(path: Path, picture: Image.Image) -> Pixels:
    deep = _is_deep(picture)
    picture.load()  # tells a damaged file, also before OpenCV takes what there is of it
    if deep:
        # Of 16-bit colour Pillow keeps only the upper 8 bits; OpenCV gives what the file holds.
        whole = cv2.imdecode(np.fromfile(path, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
        if whole is not None and whole.dtype == np.uint16 and whole.shape[1::-1] == picture.size:
            return _colours(whole)
    if picture.mode.startswith("I"):
        values = np.asarray(picture)
        if values.min() < 0 or values.max() > 65535:
            raise Unmeasurable("its pixels are numbers of more than 16 bits; save it with 8 or 16 bits per channel")
        return _colours(values.astype(np.uint16))
    if picture.mode == "CMYK":
        return np.asarray(_from_ink(picture))
    if picture.mode in _UNUSABLE:
        raise Unmeasurable(f"its pixels are {_UNUSABLE[picture.mode]}; save it as grey or RGB with 8 or 16 bits per channel")
    if picture.has_transparency_data:
        if (whole := np.asarray(picture.convert("RGBA")))[..., 3].min() < 255:
            raise Unmeasurable(_CUT_OUT)
        return whole[..., :3]
    return np.asarray(picture if picture.mode == "RGB" else picture.convert("RGB"))


def _is_deep(picture: Image.Image) -> bool:
    """Return whether a PNG or TIFF, not yet decoded, holds 16 bits per channel: its first tile names the numbers it is made
    of."""
    tiles = getattr(picture, "tile", None)
    if picture.format not in DEEP_FORMATS or not tiles:
        return False
    kind = tiles[0][3]
    return "16" in str(kind if isinstance(kind, str) else next(iter(kind or ()), ""))


def _colours(deep: npt.NDArray[np.uint16]) -> Pixels:
    """Return the numbers of more than 8 bits, grey (h, w) or blue, green, red and maybe opacity (h, w, 3 or 4), as 8-bit
    colours."""
    if deep.ndim == 3 and deep.shape[2] == 4 and deep[..., 3].min() < deep[..., 3].max():
        raise Unmeasurable(_CUT_OUT)
    light = deep if deep.ndim == 2 else deep[..., 2::-1]
    most = int(light.max())
    bits = next(depth for depth in BIT_DEPTHS if most < 2**depth)
    table = np.rint(np.arange(2**bits) * (255.0 / (2**bits - 1))).astype(np.uint8)
    small = table[light]
    return np.repeat(small[..., None], 3, axis=2) if small.ndim == 2 else small


def _from_ink(picture: Image.Image) -> Image.Image:
    """Return Printers' inks as colours: by the file's own profile, or by the plain rule where it has none."""
    profile = picture.info.get("icc_profile")
    if profile:
        with contextlib.suppress(ImageCms.PyCMSError, OSError):
            source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
            made = ImageCms.profileToProfile(picture, source, ImageCms.createProfile("sRGB"), outputMode="RGB")
            if made is not None:
                return made
    return picture.convert("RGB")


_CUT_OUT = "parts of it are transparent, so it was edited; list the original photograph"


def _check_pages(picture: Image.Image) -> None:
    """Reject several pictures in one file; a reduced copy beside the picture, as some programs write it, is none."""
    count = getattr(picture, "n_frames", 1)
    if count < 2 or picture.format not in WITH_PAGES:
        return
    size, pages = picture.size, 0
    for number in range(min(count, 50)):
        picture.seek(number)
        pages += picture.size == size
    picture.seek(0)
    if pages > 1:
        raise Unmeasurable(f"it holds {count} pictures (pages or an animation); save the right one as a separate file")


def _check_memory(width: int, height: int, per_pixel: int) -> None:
    if width < 1 or height < 1:
        raise Unmeasurable(f"it has {width} x {height} pixels; use a larger picture")
    need, free = per_pixel * width * height, free_memory()
    if free is not None and need > MOST_MEMORY * free:
        raise Unmeasurable(
            f"it has {width} x {height} pixels; reading it takes about {need / 1e9:.1f} GB of memory, but {free / 1e9:.1f} GB "
            "are free: measure fewer at a time (--jobs 1), or make all photographs and the setup's smaller by the same factor"
        )


def free_memory() -> float | None:
    """Return the bytes that can be had without swapping; None where the system does not tell."""
    with contextlib.suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return float(line.split()[1]) * 1024.0
    with contextlib.suppress(OSError, ValueError, AttributeError):
        return float(os.sysconf("SC_PHYS_PAGES")) * float(os.sysconf("SC_PAGE_SIZE"))
    return None


@functools.cache
def _know_heic() -> None:
    with contextlib.suppress(ImportError):  # without it such a file is refused as one that cannot be read
        import pi_heif

        pi_heif.register_heif_opener()


_STORED = np.arange(256) / 255.0
LIGHT_OF_SRGB: npt.NDArray[np.float32] = np.where(
    _STORED <= 0.04045, _STORED / 12.92, ((_STORED + 0.055) / 1.055) ** 2.4
).astype(np.float32)
"""Light from 0 to 1 of every stored number by sRGB's curve, shape (256,)."""

TONES: dict[str, npt.NDArray[np.float32]] = {"srgb": LIGHT_OF_SRGB, "linear": _STORED.astype(np.float32)}
"""Known tone curves: a camera's JPEG, and numbers proportional to light (a developed raw file)."""


def sample_light(
    image: Pixels, points: Array, light: npt.NDArray[np.float32] = LIGHT_OF_SRGB, mix: Array | None = None
) -> Array:
    """Return the light (..., 3) of stored numbers (h, w, 3) between pixels (..., 2), bilinear; NaN outside of the frame. With
    weights (3,) of the channels their sum, shape (...)."""
    height, width = image.shape[:2]
    flat = points.reshape(-1, 2)
    x, y = flat[:, 0], flat[:, 1]
    with np.errstate(invalid="ignore"):
        inside = (x >= 0.0) & (y >= 0.0) & (x <= width - 1.0) & (y <= height - 1.0)
    x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
    left, top = np.minimum(x.astype(np.int64), width - 2), np.minimum(y.astype(np.int64), height - 2)
    first, channels = top * width + left, () if mix is not None else (3,)
    if not len(flat):  # which OpenCV does not take
        return np.zeros((*points.shape[:-1], *channels))

    def corner(offset: int) -> Array:
        own = cv2.LUT(image.reshape(-1, 3).take(first + offset, axis=0)[:, None], light)
        own = own if mix is None else cv2.transform(own, mix[None].astype(np.float32))
        return own.reshape(-1, *channels).T

    right_share, low_share = x - left, y - top
    upper, lower = (
        own + right_share * (beside - own) for own, beside in ((corner(0), corner(1)), (corner(width), corner(width + 1)))
    )
    value = upper + low_share * (lower - upper)
    value[..., ~inside] = np.nan
    return np.asarray(value.T.reshape(*points.shape[:-1], *channels))
