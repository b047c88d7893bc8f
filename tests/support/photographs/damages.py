"""Every kind of damage to a photograph, a run or a setup, of random size and place.

A damage changes the light on its way, the body's place, the camera or the stored picture, never what the outline truly is.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from measurement.photographer import lens_of
from tests.support.photographs.faults import (
    Change,
    Target,
    band,
    flare,
    glint,
    place,
    screen_bulge,
    second_lamp,
    shaken,
    shimmer,
    smear,
    water_drop,
)

ONE, RAISED, SERIES, SETUP = "one", "raised", "series", "setup"
"""What a damage falls on: one photograph, all but the zero, all of them, or the setup by which they are measured."""

Damage = Callable[[Target, np.random.Generator], Change]


def fibre_across(target: Target, rng: np.random.Generator) -> Change:
    """Return a straight fibre that crosses the top of the outline."""
    where, length, thick = target.spot(rng, 0.8), rng.uniform(1e-3, 10e-3), rng.uniform(20e-6, 150e-6)
    angle, aside = rng.uniform(-90.0, 90.0), rng.uniform(-0.5, 0.5) * length
    way = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    middle = target.surface[where] + aside * way + rng.uniform(-0.5, 0.5) * thick * np.array([-way[1], way[0]])
    across = 0.5 * thick * np.array([-way[1], way[0]])
    ends = middle + 0.5 * length * way, middle - 0.5 * length * way
    line = np.array([ends[0] + across, ends[1] + across, ends[1] - across, ends[0] - across])
    what = f"{length * 1e3:.1f} mm long, {thick * 1e6:.0f} um thick, {angle:.0f} degrees, {place(target, where)}"
    return Change(what, things=(line,))


def fibre_along(target: Target, rng: np.random.Generator) -> Change:
    """Return a fibre that lies along the outline, on it or a little above."""
    where, length, thick = target.spot(rng, 0.8), rng.uniform(2e-3, 10e-3), rng.uniform(20e-6, 250e-6)
    above = rng.uniform(-0.5 * thick, 0.2e-3)
    line = band(target.surface, where, length, above, above + thick)
    what = f"{length * 1e3:.1f} mm long, {thick * 1e6:.0f} um thick, {above * 1e6:.0f} um above, {place(target, where)}"
    return Change(what, things=(line,))


def speck(target: Target, rng: np.random.Generator) -> Change:
    """Return the grains on the membrane."""
    grains = []
    for _ in range(int(rng.integers(1, 6))):
        where, radius = target.spot(rng), rng.uniform(20e-6, 400e-6)
        turn = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
        middle = target.surface[where] + [0.0, rng.uniform(-0.5, 0.8) * radius]
        grains.append(middle + radius * np.column_stack([np.cos(turn), np.sin(turn)]))
    return Change(f"{len(grains)} grains", things=tuple(grains))


def dust(target: Target, rng: np.random.Generator) -> Change:
    """Much dust on screen and lens."""
    count = int(rng.integers(20, 300))
    return Change(f"{count} specks", scene={"dust": count})


def scaled(target: Target, rng: np.random.Generator) -> Change:
    """Return the body moved along the light: its shadow is larger or smaller about the foot of the lamp's perpendicular."""
    share = float(rng.choice([-1.0, 1.0])) * rng.uniform(0.003, 0.02)
    foot = target.surface[0] * [0.0, 1.0] + [rng.uniform(-5e-3, 5e-3), rng.uniform(-3e-3, 8e-3)]
    return Change(f"{share:+.2%}", shape=lambda polygon: foot + (polygon - foot) * (1.0 + share))


def moved(target: Target, rng: np.random.Generator) -> Change:
    """Return the body moved across the light."""
    by = rng.uniform(15e-6, 300e-6) * np.array([rng.normal(), float(rng.choice([-1.0, 1.0]))])
    return Change(f"{by[0] * 1e6:.0f} um sideways, {by[1] * 1e6:.0f} um upwards", shape=lambda polygon: polygon + by)


def tilted(target: Target, rng: np.random.Generator) -> Change:
    """Return the body turned in the screen's plane."""
    angle = float(rng.choice([-1.0, 1.0])) * np.radians(rng.uniform(0.05, 1.0))
    about = target.surface[0] * [0.0, 1.0] + [rng.uniform(-8e-3, 8e-3), 0.0]
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return Change(f"{np.degrees(angle):+.2f} degrees", shape=lambda polygon: about + (polygon - about) @ turn)


def dent(target: Target, rng: np.random.Generator) -> Change:
    """Return the membrane is drawn in."""
    share = rng.uniform(0.05, 0.9)
    return Change(f"{share:.0%} of the height inwards", height=-share)


def overexposed(target: Target, rng: np.random.Generator) -> Change:
    """Too much light."""
    level = rng.uniform(235.0, 420.0)
    return Change(f"brightness {level:.0f}", scene={"brightness": level})


def camera_moved(target: Target, rng: np.random.Generator) -> Change:
    """Return the camera moved after the setup."""
    by = 10 ** rng.uniform(-5.3, -3.5)
    turn = by / 0.08 * np.degrees(1.0)
    scene = {
        "target": tuple(np.array(target.scene["target"]) + rng.normal(0.0, by, 2)),
        **{name: target.scene[name] + rng.normal(0.0, turn) for name in ("tilt", "pan", "roll")},
    }
    return Change(f"about {by * 1e6:.0f} um", scene=scene)


def defocused(target: Target, rng: np.random.Generator) -> Change:
    """Return the lens is out of focus."""
    blur = rng.uniform(1.5, 12.0)
    return Change(f"{blur:.1f} px", scene={"blur": blur})


def noisy(target: Target, rng: np.random.Generator) -> Change:
    """Return a high sensitivity, or too much compression."""
    noise, quality = rng.uniform(3.0, 30.0), int(rng.integers(10, 90))
    return Change(f"noise {noise:.0f}, JPEG {quality}", scene={"noise": noise, "jpeg_quality": quality})


def edited(target: Target, rng: np.random.Generator) -> Change:
    """Somebody edited the picture's tone curve."""
    power = float(np.exp(rng.uniform(-0.6, 0.6)))
    table = np.rint(255.0 * np.linspace(0.0, 1.0, 256) ** power).astype(np.uint8)
    return Change(f"gamma {power:.2f}", stored=lambda picture: np.asarray(table[picture]))


def wrong_lens(target: Target, rng: np.random.Generator) -> Change:
    """Return the setup has another lens' distortion."""
    true = lens_of(target.scene["distortion"])
    off = float(rng.choice([-1.0, 1.0])) * 10 ** rng.uniform(-2.5, -1.0)
    return Change(f"k1 off by {off:+.3f}", lens=(true[0] + off, *true[1:]))


def wrong_pitch(target: Target, rng: np.random.Generator) -> Change:
    """Return the setup is given another pitch than the grid has."""
    off = float(rng.choice([-1.0, 1.0])) * rng.uniform(0.005, 0.03)
    return Change(f"pitch off by {off:+.1%}", pitch=1.0 + off)


KINDS: dict[str, tuple[str, Damage]] = {
    "glint": (ONE, glint),
    "water drop on the lens": (ONE, water_drop),
    "smear on the lens": (ONE, smear),
    "stray light": (ONE, flare),
    "fibre across": (ONE, fibre_across),
    "fibre along": (ONE, fibre_along),
    "grains": (ONE, speck),
    "dust": (ONE, dust),
    "dent": (ONE, dent),
    "screen bulging": (ONE, screen_bulge),
    "heat shimmer": (ONE, shimmer),
    "shaken": (ONE, shaken),
    "overexposed": (ONE, overexposed),
    "out of focus": (ONE, defocused),
    "noise and compression": (ONE, noisy),
    "edited tones": (ONE, edited),
    "camera moved": (ONE, camera_moved),
    "body moved once": (ONE, moved),
    "body tilted once": (ONE, tilted),
    "body along the light once": (ONE, scaled),
    "second lamp once": (ONE, second_lamp),
    "body moved after the zero": (RAISED, moved),
    "body along the light after the zero": (RAISED, scaled),
    "body along the light before the zero": (SERIES, scaled),
    "second lamp": (SERIES, second_lamp),
    "screen bulging after the setup": (SERIES, screen_bulge),
    "wrong lens": (SETUP, wrong_lens),
    "wrong pitch": (SETUP, wrong_pitch),
}
"""Every kind of damage: what it falls on, and what it does."""

NEEDS_SIDES = {kind for kind, (_, damage) in KINDS.items() if damage in (scaled, wrong_pitch)}
"""Kinds detectable only from the body's width, so not if its sides are outside the picture."""
