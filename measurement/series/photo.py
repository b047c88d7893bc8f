"""Measure one photograph: an outline, or the reason for rejecting it.

A wrong answer that is called good is the worst that can happen here, so everything that would make an edge mean something
else than the actuator's surface ends in a `Refusal`, and what merely weakens it makes the outline untrusted.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import numpy.typing as npt

from measurement.camera.pictures import Unmeasurable
from measurement.edge.edge import SPAN
from measurement.edge.tracing import (
    AUTO,
    FEWEST_POINTS,
    Traced,
    trace,
)
from measurement.outline.checks import (
    ON_SURFACE,
    check_clear,
    check_corners,
    check_ripples,
    check_top,
    check_width,
    displacement,
    unsure,
)
from measurement.outline.outline import Outline, OutlineError
from measurement.outline.zero import (
    SIDE_BAND,
    ZeroLine,
    checked_level,
    sides_of,
)
from measurement.screen.setup import Setup
from softmodels.common.arrays import Array

BELOW = 4.0
"""Standard errors that a point may lie below the surface and still be on it."""

RIM = 150e-6
"""Height in m up to which the shadow may meet the frame: a flat surface runs out of the picture, an actuator must not."""

READING = 0.1
"""Movement in px that the grid's lines can tell from none."""

SIDE = 0.5
"""Cosine of the angle to the surface from which an edge is the body's side."""

MOST_OVERHANG = 0.01
"""Share of the outline's points that may lie behind the one before."""

GAP, LARGEST_GAP = 1e-3, 4e-3
"""Missing length of edge in m that makes an outline untrusted, and that makes it none."""

TOP_GAP = 0.5e-3
"""Missing length of edge in m that makes an outline untrusted where its highest place may lie in it."""


@dataclasses.dataclass(frozen=True)
class Refusal:
    """A photograph that was not measured.

    Attributes:
        reason: Why, as a sentence for the user.
        file: The photograph.
    """

    reason: str
    file: Path


def find_zero(file: Path, setup: Setup, tone: str = AUTO) -> ZeroLine:
    """Return the undeformed surface from the photograph at zero pressure.

    Raises:
        Unmeasurable: The photograph cannot be measured, or shows no straight surface.
    """
    return zero_of(trace(file, setup, tone), setup)


def zero_of(traced: Traced, setup: Setup) -> ZeroLine:
    """Return `find_zero` of an edge that has been traced already."""
    errors = np.hypot(setup.exact_scale.error(traced.px, traced.error_px, traced.normals), traced.screen_error)
    seen = ~traced.bridged
    line = ZeroLine.fit(traced.points[seen], traced.normals[seen], errors[seen])
    placed, upwards = line.place(traced.points[seen]), traced.normals[seen] @ line.normal
    error = float(np.hypot(line.error, traced.shift_error))
    line = dataclasses.replace(
        line,
        error=error,
        model_error=traced.model_error,
        tone=traced.tone,
        doubts=traced.doubts,
        sides=sides_of(placed, upwards, errors[seen]),
    )
    return checked_level(line, placed, upwards)


def outline_of(
    traced: Traced, setup: Setup, zero: ZeroLine, pressure: float, pressure_error: float, source: str
) -> Outline:
    """Return the outline above the surface.

    Raises:
        Unmeasurable: The visible outline is not that of an actuator on this surface.
    """
    placed, upwards = zero.place(traced.points), traced.normals @ zero.normal
    error = _placing_error(traced, setup, zero, placed, upwards)
    _check_rim(traced, zero)
    above = placed[:, 1] > -np.maximum(BELOW * error, ON_SURFACE)
    if above.sum() < FEWEST_POINTS:
        raise Unmeasurable(
            "the shadow is below the surface at zero pressure: the actuator has moved, or the zero is wrong; photograph it "
            "at zero pressure again and list that"
        )
    check_top(placed, above, upwards, error)
    sunk, moved, displaced = displacement(placed, upwards, error, zero)
    error = np.hypot(error, moved)
    scale, spread = _scale(placed, upwards, error, traced.bridged, zero)
    error = np.hypot(error, spread * np.abs(placed[:, 1]))
    raw = zero.place(setup.to_metres(traced.edge.px))
    error = np.hypot(error, unsure(raw))
    doubts = [
        displaced,
        check_corners(raw),
        check_ripples(raw),
        check_width(placed, error, zero),
        check_clear(placed[above], error[above]),
    ]
    sunken = ~above & ~traced.bridged
    above &= ~_rounded(placed, upwards)
    if above.sum() < FEWEST_POINTS:
        raise Unmeasurable(
            "too little of the surface between the body's sides is visible; move the camera closer, or photograph it "
            "again with all of its surface in the light"
        )
    kept = np.flatnonzero(above)
    inner = slice(kept[0], kept[-1] + 1)
    # A surface that has sunk as a whole, or beside the bulge, is no dent.
    _check_dents(placed[inner], sunken[inner] & (placed[inner, 1] < -ON_SURFACE - 2.0 * max(sunk, 0.0)))
    gaps = _gaps(placed[inner], error[inner], above[inner], traced.bridged[inner], traced.doubts)
    own = [doubt for doubt in doubts if doubt is not None]
    overhang = _overhanging(placed[kept], error[kept])
    reasons = (*traced.doubts, *own, *_doubts_of_zero(traced, zero), *gaps, *overhang, *_doubts_of_setup(setup))
    order = kept[np.argsort(placed[kept, 0], kind="stable")]
    x, z = placed[order].T
    try:
        return Outline(
            x,
            z,
            error[order],
            pressure,
            pressure_error,
            source,
            not reasons,
            reasons,
            sunk,
            scale,
            traced.bridged[order],
            setup.scale_error,
            zero.level_error,
        )
    except OutlineError as problem:
        raise Unmeasurable(str(problem)) from None


def _placing_error(traced: Traced, setup: Setup, zero: ZeroLine, placed: Array, upwards: Array) -> Array:
    """Return the standard errors (n,) in m of an edge above the surface: edge, screen, surface and a camera that has moved.

    What all lengths and heights of a run share, the scale's error and the level's, is the outline's own.
    """
    error = np.hypot(setup.exact_scale.error(traced.px, traced.error_px, traced.normals), traced.screen_error)
    error = np.hypot(error, zero.error_at(placed[:, 0]) * np.abs(upwards))
    # The model of the edge's shape moves outline and surface alike: the more, the wider the edge, each across itself.
    error = np.hypot(error, traced.model_error - zero.model_error * upwards)
    if np.isfinite(traced.moved):
        # What the grid's own reading leaves uncertain is in the plane's error already; only more than that has moved.
        error = np.hypot(error, np.sqrt(max(0.0, traced.moved**2 - (READING * traced.scale) ** 2)))
    return error


def _doubts_of_zero(traced: Traced, zero: ZeroLine) -> list[str]:
    """Return what the zero plane's photograph has against an outline above it."""
    found = [f"of the zero plane's photograph: {doubt}" for doubt in zero.doubts]
    if zero.tone and zero.tone != traced.tone:
        found.append(
            f"it seems to store light as {traced.tone} but the zero plane's photograph as {zero.tone}; "
            f"choose one with --tone"
        )
    return found


def _doubts_of_setup(setup: Setup) -> list[str]:
    return [] if setup.grid_pitch else ["without a grid in the setup, camera movements cannot be detected"]


def _check_rim(traced: Traced, zero: ZeroLine) -> None:
    if not len(traced.rim):
        return
    height = zero.place(traced.rim)[:, 1]
    # The rim is known to a pixel of the small version only.
    coarse = float(np.median(np.linalg.norm(np.diff(traced.rim, axis=0), axis=1))) if len(traced.rim) > 1 else 0.0
    if height.max() > RIM + 2.0 * coarse:
        raise Unmeasurable(
            f"the shadow touches the frame or the region of interest {height.max() * 1e3:.1f} mm above the surface; widen "
            "setup --roi, or aim the camera so that light is seen all round the bulge"
        )


def _scale(
    placed: Array, upwards: Array, error: Array, bridged: npt.NDArray[np.bool_], zero: ZeroLine
) -> tuple[float, float]:
    """Return the body's width over that at zero pressure, NaN where it is not seen, and the heights' relative error by it."""
    seen = ~bridged
    sides = sides_of(placed[seen], upwards[seen], error[seen])
    if sides is None or zero.sides is None or abs(sides.depth - zero.sides.depth) > SIDE_BAND:
        return np.nan, 0.0
    scale = sides.width_at(zero.sides.depth) / zero.sides.width
    own = np.hypot(sides.error, zero.sides.error) / zero.sides.width
    return scale, float(np.sqrt(max(0.0, (scale - 1.0) ** 2 - (2.0 * own) ** 2)))


def _rounded(placed: Array, upwards: Array) -> npt.NDArray[np.bool_]:
    """Return the points (n,) of the surface so near to the body's side that smoothing has rounded the corner between the
    two."""
    side = (upwards < SIDE).astype(np.uint8)
    near = np.convolve(side, np.ones(SPAN + 5, dtype=np.uint8), mode="same") > 0
    return near & (np.abs(placed[:, 1]) < 3.0 * ON_SURFACE)


def _check_dents(placed: Array, sunken: npt.NDArray[np.bool_]) -> None:
    """Reject a surface that lies below the undeformed one between places where it does not."""
    ends = np.flatnonzero(np.diff(np.r_[False, sunken, False].astype(int)))
    for start, stop in ends.reshape(-1, 2):
        length = float(np.ptp(placed[start:stop, 0]))
        if length > GAP:
            raise Unmeasurable(
                f"over {length * 1e3:.1f} mm the surface lies up to {-placed[start:stop, 1].min() * 1e3:.2f} mm below the "
                "undeformed one: it is dented or drawn in; only parts above that surface are measured: raise the pressure, "
                "or photograph the zero again with the body in its present state"
            )


def _gaps(
    placed: Array, error: Array, above: npt.NDArray[np.bool_], bridged: npt.NDArray[np.bool_], doubts: tuple[str, ...]
) -> list[str]:
    """Return what speaks against an outline that was not measured everywhere.

    Args:
        placed: Edge as x along the surface and z above it in m, in order, shape (n, 2).
        error: Standard errors in m, shape (n,).
        above: Which points do not lie below the surface, shape (n,).
        bridged: Which points were not measured, shape (n,).
        doubts: What else speaks against it, which may tell why something is missing.

    Raises:
        Unmeasurable: Too much is missing.
    """
    seen = np.flatnonzero(~bridged)
    lengths = np.linalg.norm(np.diff(placed[seen], axis=0), axis=1)
    lengths[~(above[seen[1:]] | above[seen[:-1]])] = 0.0
    if lengths.max(initial=0.0) > LARGEST_GAP:
        words = f"the outline has a gap of {lengths.max() * 1e3:.1f} mm where no edge is clear"
        raise Unmeasurable("; ".join([words, *doubts, "remove the obstruction and photograph it again"]))
    top = int(np.argmax(placed[:, 1]))
    found = []
    for at in np.flatnonzero(lengths > TOP_GAP):
        first, last = seen[at], seen[at + 1]
        words = f"the outline has a gap of {lengths[at] * 1e3:.1f} mm where no edge is clear"
        reach = placed[first : last + 1, 1] + 2.0 * error[first : last + 1]
        if placed[top, 1] > 3.0 * ON_SURFACE and reach.max() > placed[top, 1]:
            found.append(f"{words}, and its highest place may lie in it")
        elif lengths[at] > GAP:
            found.append(words)
    return found


def _overhanging(placed: Array, error: Array) -> list[str]:
    """Return what speaks against an outline that runs back along the surface."""
    step = np.diff(placed[:, 0])
    forward = step if np.median(step) > 0.0 else -step
    back = (forward < -2.0 * np.minimum(error[1:], error[:-1])) & (placed[1:, 1] > ON_SURFACE)
    share = float(np.mean(back))
    return (
        [f"{share:.0%} of the outline overhangs, which heights over x cannot represent"]
        if share > MOST_OVERHANG
        else []
    )
