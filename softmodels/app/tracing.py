"""What the warm process for photographs answers: previews, the screen's plane, edges. Imported in that process only."""

from __future__ import annotations

import dataclasses
import functools
import io
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.optimize import minimize_scalar

from measurement.cli.setup import LensOptions
from measurement.cli.shared import length, with_error
from measurement.outline.outline import Outline
from measurement.outline.zero import ZeroLine
from measurement.pictures import read_pixels
from measurement.screen.calibration import setup_from_grid
from measurement.screen.setup import PITCH_ERROR, Setup
from measurement.series.measuring import zero_line
from measurement.series.photo import outline_of, trace_image, zero_of
from measurement.series.photo_list import read_photos
from softmodels.app.project import PREVIEW, Handles
from softmodels.common.arrays import Array


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
        doubts: What speaks against trusting it, one sentence each.
        zero: The zero line in px, shape (2, 2), if the photograph or the setup shows one.
        height, height_error: Above it in m, if the setup has one.
    """

    edge: Array
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
    return Traced(found.line.px, doubts, ends, height, error)


def moved(setup: str, handles: Handles) -> str:
    """Return a setup's text with a zero line, region of interest and masks where their handles are."""
    known = Setup.from_toml(setup)
    line = None if handles.zero is None else known.to_metres(handles.zero)
    roi, *masks = (None if one is None else tuple(one) for one in (handles.roi, *handles.masks))
    return dataclasses.replace(known, zero=line, roi=roi, masks=tuple(masks)).to_toml()  # type: ignore[arg-type]


def handles(setup: str) -> Handles:
    """Return where the handles of a setup are."""
    known = Setup.from_toml(setup)
    zero = None if known.zero is None else known.to_pixels(known.zero).tolist()
    return Handles(zero, None if known.roi is None else list(known.roi), [list(mask) for mask in known.masks])


SUNK = -5e-5
"""Height in m above the undeformed surface below which a shadow may show what is beside the outline."""


@dataclasses.dataclass(frozen=True)
class Overlay:
    """A simulated outline over a photograph.

    Attributes:
        curve: In px of the photograph, shape (k, 2).
        difference: Measured minus simulated height, rms in m, where the simulated outline is not below the undeformed surface;
            its axis is where that is least.
    """

    curve: Array
    difference: float


@functools.lru_cache(maxsize=4)
def _zero(listing: str, setup: str, _stamp: float) -> tuple[Setup, ZeroLine]:
    known = Setup.from_toml(setup)
    return known, zero_line(read_photos(Path(listing)), known)


def overlay(listing: str, setup: str, outline: str, curve: Array) -> Overlay:
    """Place a simulated outline on a photograph.

    Args:
        listing: The list of photographs, of which one shows the undeformed surface if the setup does not.
        setup: Text of the setup.
        outline: File of the photograph's measured outline.
        curve: Simulated distance from the axis and height above the undeformed apex in m, from the axis on, shape (k, 2).
    """
    known, line = _zero(listing, setup, Path(listing).stat().st_mtime)
    measured = Outline.from_csv(Path(outline))
    upper = curve[: int(np.argmax(curve[:, 0])) + 1]
    upper = upper[np.concatenate([[True], np.diff(np.maximum.accumulate(upper[:, 0])) > 0.0])]

    def difference(axis: float) -> float:
        simulated = np.interp(np.abs(measured.x - axis), upper[:, 0], upper[:, 1], right=-np.inf)
        seen = simulated > SUNK
        return float(np.sqrt(np.mean((measured.z[seen] - simulated[seen]) ** 2))) if seen.any() else np.inf

    apex = float(measured.x[np.argmax(measured.z)])
    axis = float(
        minimize_scalar(difference, bounds=(apex - upper[-1, 0] / 4, apex + upper[-1, 0] / 4), method="bounded").x
    )
    both = np.concatenate([curve[::-1] * [-1.0, 1.0], curve]) + np.array([axis, 0.0])
    placed = line.origin + both[:, :1] * line.direction + both[:, 1:] * line.normal
    return Overlay(known.to_pixels(placed), difference(axis))
