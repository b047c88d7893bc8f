"""Has the body moved along the light between the photographs of a run?

Its shadow is then larger or smaller as a whole: its sides, which no pressure moves, lie farther apart or nearer than at zero
pressure (`sides.py`). A soft body's sides may give way with the pressure, smoothly and in proportion; one that was moved after
the zero photograph is larger by the same share at every height, and one that was moved once is larger that once.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from measurement.outline.outline import Outline
from measurement.outline.settling import FEWEST, LEAST, course
from measurement.outline.shape import ON_SURFACE
from measurement.outline.zero import ZeroLine
from measurement.screen.setup import Setup, SetupError

BOUND = 10e-6
"""Error of the height in m that a change of scale may make unnoticed."""

OTHER_BODY = 0.5
"""Share of its width by which a body's shadow may be larger or smaller."""

CONTRADICTS = 4.0
"""Standard errors by which the body's width and the setup's own scale may differ."""

SHARE = 0.2
"""Share of a body's own widening by which an outline may lie off the common course."""


def doubts(outlines: list[Outline]) -> list[str | None]:
    """What speaks against each outline of a run by the width of the body; None where nothing does.

    Args:
        outlines: All outlines above one zero plane, in any order.
    """
    heights = np.array([outline.height for outline in outlines])
    larger = np.array([outline.scale - 1.0 for outline in outlines])
    told = (heights > LEAST * ON_SURFACE) & np.isfinite(larger)
    found: list[str | None] = [None] * len(outlines)
    if not (np.abs(larger[told]) * heights[told] > BOUND).any():
        return found
    common = course(heights[told], larger[told], 1e-4) if told.sum() >= FEWEST else None
    start = 0.0 if common is None else float(common(0.0))
    for number in np.flatnonzero(told):
        own, high = float(larger[number]), float(heights[number])
        sentence = (
            f"the body's sides lie {abs(own):.2%} {'farther apart' if own > 0.0 else 'nearer'} than at zero pressure"
        )
        if common is None:
            if abs(own) * high > BOUND:
                found[number] = f"{sentence}: it was moved along the light, or its sides give way"
            continue
        off = own - float(common(high))
        if abs(start) * float(heights.max()) > BOUND and abs(start) > 0.1 * float(np.abs(larger[told]).max()):
            found[number] = (
                f"{sentence}, and by the other photographs they would do so without any pressure: the body, the lamp or the "
                "screen was moved along the light since the zero was taken"
            )
        elif abs(off) * high > max(BOUND, SHARE * abs(own) * high):
            found[number] = (
                f"{sentence}, unlike in the other photographs: the body was moved along the light for this one"
            )
    return found


def with_known_body(setup: Setup, zero: ZeroLine, width: float, error: float = 0.0) -> Setup:
    """The setup with the magnification that gives the body at zero pressure its known width.

    Args:
        setup: Camera and screen.
        zero: The undeformed surface and the body's sides below it, as this setup has them.
        width: True width of the body in m.
        error: Its standard error in m.

    Raises:
        SetupError: The sides are not in the picture, or the width is another body's.
    """
    if zero.sides is None:
        raise SetupError(
            "the photograph at zero pressure does not show both sides of the body below its surface, so that its width tells "
            "nothing; leave --body-width out, or give the setup --lamp-distance and --screen-distance"
        )
    scale = zero.sides.width / width
    if abs(scale - 1.0) > OTHER_BODY:
        raise SetupError(
            f"the body seems {zero.sides.width * 1e3:.4g} mm wide where --body-width has {width * 1e3:.4g} mm: this is another "
            "body or another unit, or the setup's magnification is far off"
        )
    # The model of the edge's shape moves both sides outwards, or both inwards.
    spread = math.hypot(error / width, zero.sides.error / zero.sides.width, 2.0 * zero.model_error / zero.sides.width)
    if setup.magnification_error > 0.0 and abs(scale - 1.0) > CONTRADICTS * math.hypot(spread, setup.scale_error):
        raise SetupError(
            f"the body seems {zero.sides.width * 1e3:.4g} mm wide by the grid's pitch and the lamp's distance, where "
            f"--body-width has {width * 1e3:.4g} mm: they differ by {scale - 1.0:+.2%} and are known to "
            f"{math.hypot(spread, setup.scale_error):.2%}; measure the pitch over many lines, the distances and the width again"
        )
    magnified = setup.magnification * scale
    # The width is the unit of length now: a wrong pitch is in the magnification.
    return dataclasses.replace(setup, magnification=magnified, magnification_error=magnified * spread, pitch_error=0.0)
