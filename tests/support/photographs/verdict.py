"""Compare trusted outlines of synthetic photographs with the truth."""

from __future__ import annotations

import dataclasses

import numpy as np

from measurement.outline.outline import Outline
from measurement.photographer import Truth
from measurement.screen.setup import Setup
from softmodels.common.arrays import Array
from tests.support.photographs.bench import Bench

WRONG, TIMES = 25e-6, 3.0
"""Error in m, and in stated errors, beyond which a trusted outline is wrong."""

SHARE = 0.02
"""Share of an outline's points that may lie farther off."""

HIDDEN = 1e-3
"""Length in m of outline that may be missing without a word."""


@dataclasses.dataclass(frozen=True, eq=False)
class Verdict:
    """Result of one photograph.

    Attributes:
        kind: Kind of damage; "none" for a good photograph.
        what: Its size and place.
        seed: The bench.
        height: True height in m.
        outcome: ``right``, ``refused``, ``untrusted`` or ``wrong``: trusted, and off by too much.
        why: The reason, or how far off it is.
        harmless: Whether the outline is right, trusted or not.
    """

    kind: str
    what: str
    seed: int
    height: float
    outcome: str
    why: str
    harmless: bool


def faults_of(outline: Outline, bench: Bench, truth: Truth, setup: Setup, height: float) -> str:
    """Return how an outline is wrong by more than its errors tell; empty where it is not.

    Args:
        outline: The outline.
        bench: What was photographed.
        truth: The truth about the photograph.
        setup: Camera and screen that it was measured with.
        height: The body's true height in m.
    """
    found = []
    apex = float(np.max(bench.surface(np.linspace(-bench.radius, bench.radius, 4001), height)))
    off = outline.height - apex
    error = float(np.linalg.norm([outline.height_error, outline.scale_error * outline.height, outline.level_error]))
    if abs(off) > max(WRONG, TIMES * error):
        found.append(f"apex {off * 1e6:+.0f} +- {error * 1e6:.1f} um")
    rest = across(bench, truth, setup, outline, height)
    stated = np.sqrt(outline.error**2 + (outline.scale_error * outline.z) ** 2 + outline.level_error**2)
    far = np.abs(rest) > np.maximum(WRONG, TIMES * stated)
    if far.mean() > SHARE:
        worst = int(np.argmax(np.abs(rest)))
        found.append(f"{far.mean():.0%} of the outline, up to {rest[worst] * 1e6:+.0f} um")
    ends = 0.8 * bench.radius
    missing = float(np.diff(np.clip(np.r_[-np.inf, outline.x, np.inf], -ends, ends)).max())
    if missing > HIDDEN:
        found.append(f"{missing * 1e3:.1f} mm missing")
    return ", ".join(found)


def across(bench: Bench, truth: Truth, setup: Setup, outline: Outline, height: float) -> Array:
    """Return the distances (n,) in m of an outline's points from the true one, square to it, wherever the body stands along
    x."""
    origin = truth.to_metres(setup.to_pixels([[0.0, 0.0]]))[0, 0]
    x = outline.x + np.rint(origin / bench.scene.grid_pitch) * bench.scene.grid_pitch
    aside, rest = 0.0, np.zeros(len(x))
    for _ in range(6):
        here = x - aside
        slope = (bench.surface(here + 5e-6, height) - bench.surface(here - 5e-6, height)) / 10e-6
        lever = slope / np.sqrt(1.0 + slope**2)
        rest = (outline.z - bench.surface(here, height)) / np.sqrt(1.0 + slope**2)
        # Where along x a body stands does not affect a fit, which has its own axis.
        weight = np.minimum(1.0, 10e-6 / np.maximum(np.abs(rest), 1e-12))
        spread = float(np.sum(weight * lever**2))
        if spread < 1e-3 * len(x):
            break
        aside -= float(np.clip(np.sum(weight * lever * rest) / spread, -2e-4, 2e-4))
    return np.asarray(rest)
