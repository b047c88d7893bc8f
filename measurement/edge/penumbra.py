"""Is the edge one lamp's penumbra? Not if it is wide, if the screen beside it is white, or if the light falls in steps."""

from __future__ import annotations

import numpy as np

from measurement.camera.pixels import Unmeasurable
from measurement.edge.edge import Edge
from measurement.edge.shadow import ShadowColour
from measurement.screen.view import View

WIDEST_EDGE = 300e-6
"""Greatest standard deviation in m of penumbra and blur together; beyond, half of the light is no longer a place."""

BLANK, MOST_BLANK = 0.985, 0.1
"""Light of a channel from which it is taken as saturated, and share of the edge that may lie beside such light."""

PART, MOST_PARTS = 0.7, 0.05
"""Share of the shadow's depth by which light must fall over its edge, and share of the edge where it may fall less."""

UNEVEN, PIECES, FEWEST = 0.08, 12, 20
"""Change of the shadow's depth along its edge that one lamp does not make, over means of so many pieces of the edge, each of
so many points at least."""


def check_light(edge: Edge, view: View) -> None:
    """Refuse an edge that is blurred, or beside which the screen is white.

    Raises:
        Unmeasurable: With the reason.
    """
    slope = view.setup.jacobian(edge.px)
    width = edge.width * np.linalg.norm(slope @ edge.normal[..., None], axis=(1, 2))
    wide = float(np.percentile(width, 90))
    if wide > WIDEST_EDGE:
        raise Unmeasurable(
            f"the edge is blurred over {wide * 1e6:.0f} um (standard deviation), more than {WIDEST_EDGE * 1e6:.0f} um; "
            "focus on the screen, take a smaller lamp, or move it away and the body nearer to the screen"
        )
    beside = view.sample(edge.px + 3.0 * edge.width[:, None] * edge.normal)
    blank = float(np.mean((beside > BLANK).any(axis=1)))
    if blank > MOST_BLANK:
        raise Unmeasurable(
            f"it is overexposed: beside {blank:.0%} of the edge the screen is saturated, which moves the edge; expose "
            "it for less time"
        )


def check_steps(edge: Edge, colour: ShadowColour) -> tuple[str, ...]:
    """Doubts about an edge over which the light does not fall all the way from the screen's to the shadow's.

    Raises:
        Unmeasurable: The shadow has several edges.
    """
    whole = 1.0 / float(colour.direction @ colour.lit)
    part = edge.contrast / whole
    if np.median(part) < PART:
        raise Unmeasurable(
            f"the light falls in steps, by {np.median(part):.0%} of the shadow's depth at this edge: the shadow has several "
            "edges, from a second lamp, a reflection or a double exposure; leave one lamp on, cover what reflects, and "
            "photograph it again"
        )
    count = max(FEWEST, len(part) // PIECES)
    level = np.convolve(part, np.ones(count) / count, "valid")
    if len(part) >= 2 * count and np.ptp(level) > UNEVEN:
        return (
            f"the shadow's depth changes by {np.ptp(level):.0%} along its edge: a second lamp, a reflection or stray light "
            "reaches a part of it",
        )
    share = float(np.mean(part < PART))
    if share > MOST_PARTS:
        return (f"along {share:.0%} of the edge the light falls only part of the way: a second shadow or a reflection",)
    return ()
