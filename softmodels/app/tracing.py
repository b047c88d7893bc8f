"""What the warm process for photographs answers: previews, the screen's plane, edges. Imported in that process only."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path

import numpy as np
from PIL import Image

from measurement.camera.pictures import read_pixels
from measurement.cli.setup import LensOptions
from measurement.cli.shared import length, with_error
from measurement.outline.zero import ZeroLine
from measurement.screen.seen import setup_from_grid
from measurement.screen.setup import PITCH_ERROR, Setup
from measurement.series.photo import outline_of, trace_image, zero_of
from softmodels.common.arrays import Array

PREVIEW = 1600
"""Longest side of a preview in px."""


@dataclasses.dataclass(frozen=True)
class Preview:
    """A photograph as the page shows it: a JPEG, and the photograph's own size in px."""

    jpeg: bytes
    width: int
    height: int


@dataclasses.dataclass(frozen=True)
class Plane:
    """The screen that was found: the setup's text, and the crossings of its grid in px."""

    setup: str
    crossings: Array
    residual: float


@dataclasses.dataclass(frozen=True)
class Traced:
    """An edge in a photograph.

    Attributes:
        edge: Its points in px, shape (n, 2).
        error: Their standard errors in px, shape (n,).
        doubts: What speaks against trusting it, one sentence each.
        zero: The zero line in px, shape (2, 2), if the photograph or the setup shows one.
        height, height_error: Above it in m, if the setup has one.
    """

    edge: Array
    error: Array
    doubts: tuple[str, ...]
    zero: Array | None
    height: float | None
    height_error: float | None


def preview(file: str) -> Preview:
    """Return a small version of a photograph."""
    pixels = read_pixels(Path(file))
    picture = Image.fromarray(pixels)
    picture.thumbnail((PREVIEW, PREVIEW))
    data = io.BytesIO()
    picture.convert("RGB").save(data, "JPEG", quality=85)
    return Preview(data.getvalue(), pixels.shape[1], pixels.shape[0])


def plane(file: str, pitch: str, lens: str) -> Plane:
    """Find the screen's plane in a photograph of its grid."""
    pixels = read_pixels(Path(file))
    camera = LensOptions(lens, None, None).camera(Path(file), pixels.shape[1], pixels.shape[0])
    size, error = with_error(pitch, length)
    made = setup_from_grid(file, size, camera, pitch_error=error / size if error else PITCH_ERROR)
    return Plane(made.to_toml(), made.camera.distort(made.plane.points), float(made.plane.residual))


def trace(file: str, setup: str, level: bool, pressure: float) -> Traced:
    """Find the edge of the shadow in a photograph.

    Args:
        file: The photograph.
        setup: Text of the setup.
        level: Whether it shows the undeformed surface.
        pressure: In Pa.
    """
    known = Setup.from_toml(setup)
    found = trace_image(read_pixels(Path(file)), known)
    line, doubts = None, found.doubts
    height = error = None
    if level and known.zero is None:
        line = zero_of(found)
        doubts = line.doubts
    elif known.zero is not None:
        line = ZeroLine.through(known.zero)
        outline = outline_of(found, line, pressure, 0.0, Path(file).name)
        height, error, doubts = outline.height, outline.height_error, outline.reasons
    ends = None
    if line is not None:
        along = found.points @ line.direction
        ends = known.to_pixels(line.origin + np.outer([np.nanmin(along), np.nanmax(along)], line.direction))
    return Traced(found.line.px, found.line.error, doubts, ends, height, error)


def moved(setup: str, zero: list[tuple[float, float]] | None, roi: list[float] | None) -> str:
    """Return a setup's text with a zero line given by two pixels, and a region of interest in px; None where there is none."""
    known = Setup.from_toml(setup)
    line = None if zero is None else known.to_metres(zero)
    return dataclasses.replace(known, zero=line, roi=None if roi is None else tuple(roi)).to_toml()  # type: ignore[arg-type]


def handles(setup: str) -> tuple[Array | None, tuple[float, float, float, float] | None]:
    """Return a setup's zero line in px, shape (2, 2), and its region of interest in px."""
    known = Setup.from_toml(setup)
    return (None if known.zero is None else known.to_pixels(known.zero)), known.roi
