"""What a file is by its first bytes, so that one that is no photograph is refused by its true name and with what to do.

Pillow opens many raw files as TIFF and then reads the small preview in them: their kind has to be known before.
"""

from __future__ import annotations

import re
from pathlib import Path

READABLE = "JPEG, PNG, TIFF, HEIC, WebP, AVIF, JPEG 2000, MPO or BMP"
"""The formats named to the user."""

RAW_ENDINGS = frozenset(
    {f".{name}" for name in re.findall(r"\w+", """
    3fr arw cr2 cr3 crw dcr dng erf fff iiq k25 kdc mef mos mrw nef nrw orf pef raf raw rw2 rwl sr2 srf srw x3f
    """)}
)  # fmt: skip
"""Endings of cameras' raw files; most of them are TIFF inside, so that their first bytes do not tell them."""

RAW = "it is a camera's raw file; develop it to a 16-bit TIFF, without lens correction, cropping or turning, and list that"

VIDEO = "it is a video; save single pictures of it as PNG, at the measured pressures, and list those"

_SIGNATURES: tuple[tuple[int, bytes, str], ...] = (
    (0, b"%PDF", "it is a PDF document; save the photograph in it as a picture (pdfimages does), and list that"),
    (0, b"%!PS", "it is a PostScript document, no photograph"),
    (0, b"FUJIFILMCCD-RAW", RAW),
    (0, b"IIRO", RAW),
    (0, b"IIRS", RAW),
    (0, b"MMOR", RAW),
    (0, b"IIU\0", RAW),
    (0, b"FOVb", RAW),
    (0, b"\0MRM", RAW),
    (8, b"CR\x02", RAW),
    (6, b"HEAPCCDR", RAW),
    (4, b"ftypcrx", RAW),
    (0, b"\x1a\x45\xdf\xa3", VIDEO),
    (0, b"FLV", VIDEO),
    (0, b"\0\0\1\xba", VIDEO),
    (0, b"\0\0\1\xb3", VIDEO),
    (0, b"\x30\x26\xb2\x75", VIDEO),
    (8, b"AVI ", VIDEO),
    (0, b"PK\3\4", "it is a ZIP archive or an office document; take the photograph out of it, and list that"),
    (0, b"\xff\x0a", "it is a JPEG XL picture, which cannot be read; save it as PNG or TIFF"),
    (4, b"JXL ", "it is a JPEG XL picture, which cannot be read; save it as PNG or TIFF"),
    (0, b"version https://git-lfs", "it is Git LFS's pointer in place of the picture; fetch it with git lfs pull"),
)
"""Offset, bytes and what such a file is, as the reason for its refusal."""

_STILLS = frozenset(b"heic heix heim heis hevc hevx mif1 msf1 miaf avif avis jp2".split())
"""Brands of ISO base media files that are pictures; every other brand is a video or sound."""


def foreign_kind(path: Path) -> str | None:
    """Why a file is no photograph that can be read, as far as its first bytes and its ending tell; None if they do not.

    Raises:
        OSError: The file cannot be opened.
    """
    with path.open("rb") as file:
        head = file.read(512)
    if not head:
        return f"the file is no picture, it is empty; {READABLE} is needed"
    if path.suffix.lower() in RAW_ENDINGS:
        return RAW
    for offset, mark, what in _SIGNATURES:
        if head[offset : offset + len(mark)] == mark:
            return what
    if head[4:8] == b"ftyp" and head[8:12].strip() not in _STILLS:
        return VIDEO
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    if text.startswith((b"<!doctype html", b"<html")):
        return "it is a web page, maybe what a server answered in place of the picture; fetch the picture again"
    if text.startswith((b"<svg", b"<?xml")):
        return f"it is a drawing or another XML file, no photograph; {READABLE} is needed"
    return None
