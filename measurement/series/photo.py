"""Measure one photograph: its edge, the zero plane, an outline above it, or the reason for rejecting it (`checks`)."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from measurement.camera.pictures import TONES, Pixels, Unmeasurable, read_photograph
from measurement.edge.profiles import DECISIVE
from measurement.edge.tracing import Traced
from measurement.outline.outline import Outline, OutlineError
from measurement.outline.zero import ZeroLine, sides_of
from measurement.screen.setup import Setup
from measurement.series.checks import EDGE, OUTLINE, TONE, ZERO, Evidence, doubts

AUTO = "auto"
WRONG = 3.5
"""Misfit of the edge's shape (`edge.profiles`) from which no tone is known to be right."""

LARGEST_TONE = 0.2
"""Departure e of the light from the tone curve beyond which it is no camera's."""

TONE_SHIFT, TONE_HARM = 0.4, 5e-6
"""Shift of the edge by a wrong tone in widths of the edge, and the shift in m that would do no harm."""


@dataclasses.dataclass(frozen=True)
class Refusal:
    """A photograph that was not measured.

    Attributes:
        reason: Why, as a sentence for the user.
        file: The photograph.
    """

    reason: str
    file: Path


def trace(file: Path, setup: Setup, tone: str = AUTO, likely: str = "") -> Traced:
    """Find the edge of the shadow in a photograph.

    Args:
        file: The photograph.
        setup: Camera and screen.
        tone: How the file stores light, one of `pixels.TONES`, or ``"auto"``.
        likely: The tone of other photographs of the run, for an edge that lies on the grid's ink and does not tell its own.

    Raises:
        Unmeasurable: The photograph must not be measured; the message is the reason.
    """
    return trace_image(read_photograph(file, (setup.camera.width, setup.camera.height)), setup, tone, likely)


def trace_image(image: Pixels, setup: Setup, tone: str = AUTO, likely: str = "") -> Traced:
    """Return `trace` of a picture (h, w, 3) that has been read already; ``likely`` is the tone of the run's other photographs.

    A penumbra is symmetric in light, and no longer so in numbers of another scale: half of the light lies elsewhere then,
    by up to half of the penumbra's width. A shape with a free departure from the tone curve follows even a wrong one to some
    extent, so all tones are tried, and the one with the least chi-square is taken if it is decisively less.
    """
    if tone != AUTO:
        return _traced(image, setup, tone)
    names = sorted(TONES, key=lambda name: name != (likely or "srgb"))
    first = _traced(image, setup, names[0])
    # Where a shape fits this well, no other tone can be decisively better.
    fits = first.edge.shape.chi_square < DECISIVE
    if likely and fits:
        return first
    try:
        second = _traced(image, setup, names[1])
    except Unmeasurable:
        if fits:
            return first
        raise
    best, other = sorted((first, second), key=lambda traced: traced.edge.shape.chi_square)
    shape = best.edge.shape
    clear = shape.misfit < WRONG and abs(shape.tone) < LARGEST_TONE
    # A model that misses the profile by more than its error is no better evidence for missing another by as much more.
    evidence = (other.edge.shape.chi_square - shape.chi_square) / max(1.0, shape.misfit**2)
    moved = float(np.median(best.edge.width)) * best.scale * TONE_SHIFT
    if moved <= TONE_HARM or (clear and evidence >= DECISIVE):
        return best
    # Without evidence against it, not even a shape, a photograph has the tone of its series.
    if likely and not (first is other and evidence >= DECISIVE) and not first.edge.shape.misfit >= WRONG:
        return first
    best.tone_error = moved
    best.doubts += doubts(TONE, Evidence(best))
    return best


def _traced(image: Pixels, setup: Setup, tone: str) -> Traced:
    traced = Traced(image, setup, tone)
    traced.doubts = doubts(EDGE, Evidence(traced))
    return traced


def find_zero(file: Path, setup: Setup, tone: str = AUTO, raised: Traced | None = None) -> ZeroLine:
    """Return the undeformed surface from the photograph at zero pressure.

    Args:
        file: The photograph.
        setup: Camera and screen.
        tone: As of `trace`.
        raised: A photograph of the raised body without doubts, which shows what the camera does to an edge.

    Raises:
        Unmeasurable: The photograph cannot be measured, or shows no straight surface.
    """
    return zero_of(trace(file, setup, tone), raised)


def zero_of(traced: Traced, raised: Traced | None = None) -> ZeroLine:
    """Return `find_zero` of an edge that has been traced already."""
    hidden = 0.0
    if raised is not None:
        again = traced.of_level(raised)
        if again.lift and again.edge.shape.chi_square <= traced.edge.shape.chi_square - DECISIVE:
            again.tone_error, again.doubts = 0.0, doubts(EDGE, Evidence(again))
            traced = again
        elif raised.tone == traced.tone:
            hidden = again.edge.shape.hidden * again.width_px * again.scale
    errors = traced.own_error
    seen = ~traced.line.bridged
    line = ZeroLine.fit(traced.points[seen], traced.normals[seen], errors[seen])
    # The body's sides are not deep along the light: their edge is at their half light.
    placed, upwards = line.place(traced.points + traced.lift * traced.normals)[seen], traced.normals[seen] @ line.normal
    line = dataclasses.replace(
        line,
        error=float(np.hypot(line.error, traced.shift_error)),
        model_error=traced.model_error,
        tone=traced.tone,
        sides=sides_of(placed, upwards, errors[seen]),
    )
    evidence = Evidence(traced, line)
    level = float(np.hypot(hidden, 0.0 if evidence.bow is None else evidence.bow.level_error))
    found = (*traced.doubts, *doubts(ZERO, evidence))
    return dataclasses.replace(line, doubts=found, level_error=level, lift=traced.lift)


def outline_of(traced: Traced, zero: ZeroLine, pressure: float, pressure_error: float, source: str) -> Outline:
    """Return the outline above the surface.

    Raises:
        Unmeasurable: The visible outline is not that of an actuator on this surface.
    """
    e = Evidence(traced, zero)
    reasons = (*traced.doubts, *doubts(OUTLINE, e))
    assert e.displaced is not None  # a check rejects that
    order = e.kept[np.argsort(e.placed[e.kept, 0], kind="stable")]
    x, z = e.placed[order].T
    try:
        return Outline(
            x,
            z,
            e.error[order],
            pressure,
            pressure_error,
            source,
            not reasons,
            reasons,
            e.displaced.sunk,
            e.scale,
            traced.line.bridged[order],
            traced.setup.scale_error,
            zero.level_error,
        )
    except OutlineError as problem:
        raise Unmeasurable(str(problem)) from None
