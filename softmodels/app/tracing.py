"""What the warm process for photographs answers: previews, the screen's plane, edges. Imported in that process only."""

from __future__ import annotations

import dataclasses
import functools
import io
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.optimize import minimize_scalar

from measurement import cli, pictures
from measurement.cli import setup
from measurement.outline import zero
from measurement.outline.outline import Outline
from measurement.screen import calibration
from measurement.screen.setup import PITCH_ERROR, Setup
from measurement.series import measuring, photo_list
from measurement.series.checks import OutlineEvidence
from softmodels.app import replies
from softmodels.common.arrays import Array


def preview(file: str) -> replies.Preview:
    """Return a small version of a photograph."""
    pixels = pictures.read_pixels(Path(file))
    picture, jpegs = Image.fromarray(pixels).convert("RGB"), []
    for side in (replies.PREVIEW_SIDE_PX, replies.SMALL_SIDE_PX):
        picture.thumbnail((side, side))
        data = io.BytesIO()
        picture.save(data, "JPEG", quality=85)
        jpegs.append(data.getvalue())
    return replies.Preview(jpegs[0], jpegs[1], pixels.shape[1], pixels.shape[0])


def plane(file: str, pitch: str, lens: str) -> replies.Plane:
    """Find the screen's plane in a photograph of its grid."""
    pixels = pictures.read_pixels(Path(file))
    camera = setup.lens_camera(Path(file), pixels.shape[1::-1], lens, None, None)
    size, error = cli.with_error(pitch, cli.length)
    made = calibration.setup_from_grid(file, size, camera, pitch_error=error / size if error else PITCH_ERROR)
    return replies.Plane(made.to_toml(), made.camera.distort(made.plane.points), float(made.plane.residual))


BAND_WIDTH_PX = 7.0
"""Half width in px of a preview of a band that is seen."""
ENLARGEMENTS = (1, 2, 5, 10, 20, 50, 100, 200, 500)


def trace(file: str, setup: str, undeformed: bool, tone: str, anyway: bool) -> replies.Traced:
    """Find the edge of the shadow in a photograph, whose tone says how it stores light, or ``"auto"``. It may show the
    ``undeformed`` surface, which counts if the text of the setup does not have it. An edge may be used ``anyway``, in spite of
    doubts."""
    known = Setup.from_toml(setup)
    traced = measuring.trace_image(pictures.read_pixels(Path(file)), known, tone, anyway=anyway)
    line, doubts, errors = None, traced.doubts, traced.own_error
    height = error = None
    if undeformed and known.zero is None:
        line = measuring.zero_of(traced)
        doubts = line.doubts
    elif known.zero is not None:
        line = zero.ZeroLine.through(known.zero)
        outline = measuring.outline_of(traced, line, 0.0, 0.0, Path(file).name)
        height = outline.height
        error = outline.height_error
        doubts = outline.reasons
        errors = OutlineEvidence(traced, line).error
    seen = BAND_WIDTH_PX * max(1.0, max(known.camera.width, known.camera.height) / replies.PREVIEW_SIDE_PX) * traced.scale
    usual = float(np.median(errors[~traced.line.bridged]))
    enlarged = next((times for times in ENLARGEMENTS if times * usual >= seen), ENLARGEMENTS[-1])
    wide = enlarged * errors[:, None] * traced.normals
    band = np.stack([known.to_pixels(traced.points + wide), known.to_pixels(traced.points - wide)])
    ends = None
    if line is not None:
        along = traced.points @ line.direction
        ends = known.to_pixels(line.origin + np.outer([np.nanmin(along), np.nanmax(along)], line.direction))
    return replies.Traced(traced.line.px, band, enlarged, doubts, ends, height, error)


def moved(setup: str, handles: replies.Handles) -> str:
    """Return a setup's text with a zero line, region of interest and masks where their handles are."""
    known = Setup.from_toml(setup)
    line = None if handles.zero is None else known.to_metres(handles.zero)
    roi, *masks = (None if region is None else tuple(region) for region in (handles.roi, *handles.masks))
    return dataclasses.replace(known, zero=line, roi=roi, masks=tuple(masks)).to_toml()  # type: ignore[arg-type]


def handles(setup: str) -> replies.Handles:
    """Return where the handles of a setup are."""
    known = Setup.from_toml(setup)
    zero = None if known.zero is None else known.to_pixels(known.zero).tolist()
    return replies.Handles(zero, None if known.roi is None else list(known.roi), [list(mask) for mask in known.masks])


MIN_SURFACE_HEIGHT = -5e-5
"""Height in m above the undeformed surface below which a shadow may show what is beside the outline."""


@functools.lru_cache(maxsize=4)
def _zero(listing: str, setup: str, _stamp: float) -> tuple[Setup, zero.ZeroLine]:
    known = Setup.from_toml(setup)
    return known, measuring.zero_line(photo_list.read_photos(Path(listing)), known)


def overlay(listing: str, setup: str, outline: str, curve: Array, axial: bool = True) -> replies.Overlay:
    """Place a simulated outline, distance from the axis and height above the undeformed apex in m, shape (k, 2), on a
    photograph by its measured outline's file, the list of photographs, of which one shows the undeformed surface if the text
    of the setup does not. An ``axial`` outline goes on beyond the axis as on this side; else the curve is the whole outline,
    seen from either side."""
    known, line = _zero(listing, setup, Path(listing).stat().st_mtime)
    measured = Outline.from_csv(Path(outline))
    upper = curve[: int(np.argmax(curve[:, 0])) + 1]
    upper = upper[np.concatenate([[True], np.diff(np.maximum.accumulate(upper[:, 0])) > 0.0])]

    def difference(axis: float, side: float = 1.0) -> float:
        along = (measured.x - axis) * side
        along = np.abs(along) if axial else along
        simulated = np.interp(along, upper[:, 0], upper[:, 1], left=-np.inf, right=-np.inf)
        seen = simulated > MIN_SURFACE_HEIGHT
        return float(np.sqrt(np.mean((measured.z[seen] - simulated[seen]) ** 2))) if seen.any() else np.inf

    apex, top = float(measured.x[np.argmax(measured.z)]), float(upper[np.argmax(upper[:, 1]), 0])
    edges = []
    for side in (1.0,) if axial else (1.0, -1.0):
        middle, reach = (apex, upper[-1, 0] / 4) if axial else (apex - side * top, upper[-1, 0] / 4)
        best = minimize_scalar(difference, bounds=(middle - reach, middle + reach), args=(side,), method="bounded")
        edges.append((float(best.fun), side, float(best.x)))
    rms, side, axis = min(edges)
    both = np.concatenate([curve[::-1] * [-1.0, 1.0], curve]) if axial else curve * [side, 1.0]
    both = both + np.array([axis, 0.0])
    placed = line.origin + both[:, :1] * line.direction + both[:, 1:] * line.normal
    return replies.Overlay(known.to_pixels(placed), rms)
