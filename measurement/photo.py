"""One photograph in, one outline or one reason out.

A wrong answer that is called good is the worst that can happen here, so everything that would make an edge mean something
else than the actuator's surface ends in a `Refusal`, and what merely weakens it makes the outline untrusted.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import numpy.typing as npt

from measurement.outline import Outline, OutlineError
from measurement.pixels import Unmeasurable
from measurement.setup import Setup
from measurement.shape import ON_SURFACE, check_clear, check_corners, check_top, check_width, displacement
from measurement.tracing import AUTO, FEWEST_POINTS, Traced, trace
from measurement.zero import ZeroLine

Array = npt.NDArray[np.float64]

BELOW = 4.0
"""Standard errors that a point may lie below the surface and still be on it."""

RIM = 150e-6
"""Height in m up to which the shadow may meet the frame: a flat surface runs out of the picture, an actuator must not."""

READING = 0.1
"""Movement in px that the grid's lines can tell from none."""

GAP, LARGEST_GAP = 1e-3, 4e-3
"""Missing length of edge in m that makes an outline untrusted, and that makes it none."""


@dataclasses.dataclass(frozen=True)
class Refusal:
    """A photograph that was not measured.

    Attributes:
        reason: Why, as a sentence for the user.
        file: The photograph.
    """

    reason: str
    file: Path


def measure(
    file: Path, setup: Setup, zero: ZeroLine, pressure: float, pressure_error: float, tone: str = AUTO
) -> Outline | Refusal:
    """Measure the outline of the shadow in one photograph.

    Args:
        file: The photograph.
        setup: Camera and screen.
        zero: The undeformed surface.
        pressure: Pressure in Pa.
        pressure_error: Its standard error in Pa.
        tone: How the file stores light, one of `pixels.TONES`, or ``"auto"``.
    """
    try:
        traced = trace(file, setup, tone, zero.tone)
        return outline_of(traced, setup, zero, pressure, pressure_error, Path(file).name)
    except Unmeasurable as error:
        return Refusal(str(error), Path(file))


def find_zero(file: Path, setup: Setup, tone: str = AUTO) -> ZeroLine:
    """The undeformed surface from the photograph at zero pressure.

    Raises:
        Unmeasurable: The photograph cannot be measured, or shows no straight surface.
    """
    return zero_of(trace(file, setup, tone), setup)


def zero_of(traced: Traced, setup: Setup) -> ZeroLine:
    """`find_zero` of an edge that has been traced already."""
    errors = setup.error(traced.px, traced.error_px, traced.normals)
    line = ZeroLine.fit(traced.points, traced.normals, errors)
    return dataclasses.replace(line, tone=traced.tone, doubts=traced.doubts)


def outline_of(
    traced: Traced, setup: Setup, zero: ZeroLine, pressure: float, pressure_error: float, source: str
) -> Outline:
    """The outline above the surface.

    Raises:
        Unmeasurable: What is seen is no outline of an actuator on this surface.
    """
    placed = zero.place(traced.points)
    error = setup.error(traced.px, traced.error_px, traced.normals)
    error = np.hypot(error, zero.error_at(placed[:, 0]) * np.abs(traced.normals @ zero.normal))
    if np.isfinite(traced.moved):
        # What the grid's own reading leaves uncertain is in the plane's error already; only more than that has moved.
        error = np.hypot(error, np.sqrt(max(0.0, traced.moved**2 - (READING * traced.scale) ** 2)))
    _check_rim(traced, zero)
    above = placed[:, 1] > -np.maximum(BELOW * error, ON_SURFACE)
    if above.sum() < FEWEST_POINTS:
        raise Unmeasurable(
            "the shadow lies below the surface at zero pressure: the actuator has moved, or the zero is wrong"
        )
    upwards = traced.normals @ zero.normal
    check_top(placed, above, upwards, error)
    reasons = list(traced.doubts)
    sunk, moved, doubt = displacement(placed, upwards, error, zero)
    error = np.hypot(error, moved)
    doubts = [doubt, check_corners(zero.place(setup.to_metres(traced.edge.px))), check_width(placed, error, zero)]
    doubts.append(check_clear(placed[above], error[above]))
    reasons += [doubt for doubt in doubts if doubt is not None]
    kept = np.nonzero(above)[0]
    first, last = kept[0], kept[-1]
    reasons += [f"of the zero plane's photograph: {doubt}" for doubt in zero.doubts]
    if zero.tone and zero.tone != traced.tone:
        reasons.append(
            f"it seems to store light as {traced.tone} where the zero plane's photograph has {zero.tone}; tell which it is "
            "with --tone"
        )
    inner = placed[first : last + 1]
    missing = _largest_gap(inner, above[first : last + 1])
    if missing > LARGEST_GAP:
        raise Unmeasurable(f"the outline has a gap of {missing * 1e3:.1f} mm where no edge is clear")
    if missing > GAP:
        reasons.append(f"the outline has a gap of {missing * 1e3:.1f} mm where no edge is clear")
    overhang = _overhang(placed[kept], error[kept])
    if overhang > 0.01:
        reasons.append(f"{overhang:.0%} of the outline overhangs, which heights over x cannot show")
    if setup.grid_pitch is None:
        reasons.append("without a grid in the setup nothing tells whether the camera has moved")
    order = kept[np.argsort(placed[kept, 0], kind="stable")]
    try:
        return Outline(
            placed[order, 0],
            placed[order, 1],
            error[order],
            pressure,
            pressure_error,
            source,
            not reasons,
            tuple(reasons),
            sunk,
        )
    except OutlineError as problem:
        raise Unmeasurable(str(problem)) from None


def _check_rim(traced: Traced, zero: ZeroLine) -> None:
    if not len(traced.rim):
        return
    height = zero.place(traced.rim)[:, 1]
    # The rim is known to a pixel of the small version only.
    coarse = float(np.median(np.linalg.norm(np.diff(traced.rim, axis=0), axis=1))) if len(traced.rim) > 1 else 0.0
    if height.max() > RIM + 2.0 * coarse:
        raise Unmeasurable(
            f"the shadow touches the frame or the region of interest {height.max() * 1e3:.1f} mm above the surface"
        )


def _largest_gap(placed: Array, above: npt.NDArray[np.bool_]) -> float:
    """Longest missing length in m between neighbouring points of which one at least lies above the surface."""
    step = np.linalg.norm(np.diff(placed, axis=0), axis=1)
    matters = above[1:] | above[:-1]
    return float(step[matters].max(initial=0.0))


def _overhang(placed: Array, error: Array) -> float:
    """Share of the points from which the outline runs back."""
    step = np.diff(placed[:, 0])
    forward = step if np.median(step) > 0.0 else -step
    return float(np.mean((forward < -2.0 * np.minimum(error[1:], error[:-1])) & (placed[1:, 1] > ON_SURFACE)))
