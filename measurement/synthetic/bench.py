"""Whole runs of synthetic photographs with a damage in them, measured as a user's would be, and judged by the truth.

A bench is a random camera, screen, lamp and body. Its run is a photograph of the grid, one of the undeformed body and several
of the raised one. Where the body's sides are in the picture its width is told, as a user's device has a known one. A damage
falls on one photograph, on all of them or on the setup; the undamaged ones stay as they are.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from measurement.camera.camera import Camera
from measurement.camera.pixels import Unmeasurable
from measurement.edge.tracing import trace_image
from measurement.outline.outline import Outline
from measurement.outline.scaling import with_known_body
from measurement.outline.zero import ZeroLine
from measurement.screen.grid import find_grid
from measurement.screen.grid_error import GridError
from measurement.screen.setup import Setup, SetupError
from measurement.series.measuring import Result, judged
from measurement.series.photo import Refusal, outline_of, zero_of
from measurement.series.photo_list import Photograph
from measurement.synthetic.damages import KINDS, NEEDS_SIDES, ONE, RAISED, SETUP
from measurement.synthetic.demo import column
from measurement.synthetic.faults import Change, Target
from measurement.synthetic.light import Array
from measurement.synthetic.photographer import Scene, Truth, dome, dome_height, photograph, truth_of

Pixels = NDArray[np.uint8]

WRONG, TIMES = 25e-6, 3.0
"""Error in m, and in stated errors, beyond which a trusted outline is wrong."""

SHARE = 0.02
"""Share of an outline's points that may lie farther off."""

HIDDEN = 1e-3
"""Length in m of outline that may be missing without a word."""

PA = 95.1
"""Pascal per cm of the demo's column."""

SHARES = (0.0, 0.1, 0.25, 0.4, 0.6, 0.8, 1.0)
"""Heights of a run's photographs over the highest."""


@dataclasses.dataclass(frozen=True)
class Bench:
    """A random bench.

    Attributes:
        seed: What it was made from.
        scene: Camera, screen and lamp.
        top: Greatest height in m.
        radius: Radius of the bulge in m.
        floor: Z of the undeformed surface in m.
        half_width: Half width of the body in m; its sides are in the picture if that is small enough.
        sinks: Share of the height by which the body's rim sinks.
    """

    seed: int
    scene: Scene
    top: float
    radius: float
    floor: float
    half_width: float
    sinks: float

    @classmethod
    def random(cls, seed: int) -> Bench:
        """The bench of a seed; every other one shows the body's sides."""
        rng = np.random.default_rng([2013, seed])
        scene = Scene(
            width=1250, height=820, focal_px=2850.0, pixel_size=28e-6, tilt=rng.uniform(-5.0, 15.0),
            pan=rng.uniform(-25.0, 25.0), roll=rng.uniform(-2.0, 2.0), distortion=(rng.uniform(-0.1, 0.05),),
            target=(rng.uniform(-1e-3, 1e-3), rng.uniform(0.0, 1.5e-3)), grid_pitch=float(rng.choice([4.5e-3, 9e-3])),
            line_width=rng.uniform(0.3e-3, 0.6e-3), line_grey=rng.uniform(0.15, 0.4), brightness=rng.uniform(150.0, 225.0),
            unevenness=rng.uniform(0.0, 0.3), ambient=rng.uniform(0.05, 0.2), penumbra=rng.uniform(35e-6, 90e-6),
            blur=rng.uniform(0.7, 1.3), noise=rng.uniform(1.0, 3.0), dust=int(rng.integers(0, 6)),
            jpeg_quality=int(rng.integers(88, 98)), srgb=True,
        )  # fmt: skip
        seen = bool(seed % 2)
        half_width = rng.uniform(12.5e-3, 14.5e-3) if seen else 0.2
        radius = rng.uniform(9e-3, 11e-3) if seen else rng.uniform(9e-3, 13e-3)
        return cls(
            seed, scene, rng.uniform(2.5e-3, 9e-3), radius, rng.uniform(-6.5e-3, -5e-3), half_width,
            float(rng.choice([0.0, rng.uniform(0.0, 0.13)])) if seen else 0.0,
        )  # fmt: skip

    @property
    def shows_sides(self) -> bool:
        """Whether the body's own width can be seen."""
        return self.half_width < 0.1

    def surface(self, x: Array, height: float) -> Array:
        """Height (n,) in m of the surface above the undeformed one."""
        rise = dome_height(x, height, self.radius)
        if not self.shows_sides:
            return np.asarray(rise)
        share = np.abs(x) / self.half_width
        return np.asarray(rise - self.sinks * max(height, 0.0) * share**2 * (3 - 2 * share))

    def polygon(self, height: float) -> Array:
        """The body (k, 2) in m."""
        if not self.shows_sides:
            return dome(height, self.radius, floor=self.floor, half_width=self.half_width)
        upper = self.upper(height, 1601)
        return np.vstack([upper, [[self.half_width, -0.2], [-self.half_width, -0.2]]])

    def upper(self, height: float, count: int = 2001) -> Array:
        """The surface (n, 2) in m as far as it can be in the picture."""
        reach = min(self.half_width, 0.018)
        x = np.linspace(-reach, reach, count)
        return np.column_stack([x, self.floor + self.surface(x, height)])


@dataclasses.dataclass(frozen=True, eq=False)
class Verdict:
    """What became of one photograph.

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


class Run:
    """The photographs of a bench, taken and measured once, in which one damage after another is tried."""

    def __init__(self, bench: Bench) -> None:
        """Photograph grid, undeformed and raised body, and measure them."""
        self.bench, self.truth = bench, truth_of(bench.scene)
        self.heights = [share * bench.top for share in SHARES]
        grid = photograph(bench.scene, None, 1000 * bench.seed)[0]
        self.setup = self._setup(grid, bench.scene.distortion)
        self.grid = grid
        self.pictures = [self._picture(number, Change("")) for number in range(len(SHARES))]
        self.alone: list[Outline | Refusal] = []
        self.known, self.zero = self.setup, ZeroLine.through(np.array([[0.0, 0.0], [1.0, 0.0]]))
        self.good = self._measured(self.pictures, self.setup)

    def good_ones(self) -> Iterator[Verdict]:
        """Verdicts on the undamaged photographs."""
        for number, result in enumerate(self.good):
            yield self._verdict("none", Change(""), number, result, self.setup)

    def damaged(self, kind: str, seed: int) -> Iterator[Verdict]:
        """Verdicts on the photographs that one damage fell on; none where no evidence of it can be in the pictures.

        Args:
            kind: One of `synthetic_damages.KINDS`.
            seed: Seed of its size and place.
        """
        scope, damage = KINDS[kind]
        if kind in NEEDS_SIDES and not self.bench.shows_sides:
            return
        rng = np.random.default_rng([self.bench.seed, seed, list(KINDS).index(kind)])
        chosen = int(rng.integers(2, len(SHARES)))
        at = self.bench.polygon(self.heights[chosen]), self.bench.upper(self.heights[chosen])
        change = damage(Target(*at, dataclasses.asdict(self.bench.scene)), rng)
        numbers = {ONE: [chosen], RAISED: list(range(1, len(SHARES)))}.get(scope, list(range(len(SHARES))))
        setup = self.setup
        if scope == SETUP:
            try:
                setup = self._setup(self.grid, change.lens or ())
            except GridError as error:
                yield from (
                    self._verdict(kind, change, number, Refusal(str(error), Path()), setup) for number in numbers
                )
                return
        pictures = list(self.pictures)
        if scope != SETUP:
            for number in numbers:
                # What is thrown on the screen belongs to each photograph's own body.
                own = Target(self.bench.polygon(self.heights[number]), at[1], dataclasses.asdict(self.bench.scene))
                again = np.random.default_rng([self.bench.seed, seed, list(KINDS).index(kind)])
                again.integers(2, len(SHARES))
                pictures[number] = self._picture(number, damage(own, again))
        if scope == ONE:
            outcomes = list(self.alone)
            outcomes[chosen] = self._outcome(pictures[chosen], self.known, self.zero, chosen)
            results = self._judged(outcomes)
        else:
            results = self._measured(pictures, setup)
        for number in numbers:
            yield self._verdict(kind, change, number, results[number], setup)

    def _setup(self, grid: Pixels, lens: tuple[float, ...]) -> Setup:
        scene = self.bench.scene
        camera = Camera(self.truth.matrix, np.array(lens_of(lens)), scene.width, scene.height, "known", 0.0)
        return Setup(camera, find_grid(grid, camera, scene.grid_pitch).plane(camera), grid_pitch=scene.grid_pitch)

    def _picture(self, number: int, change: Change) -> Pixels:
        polygon = self.bench.polygon(self.heights[number] * change.height)
        polygon = polygon if change.shape is None else change.shape(polygon)
        scene = dataclasses.replace(self.bench.scene, **change.scene)
        seed = 1000 * self.bench.seed + 1 + number + (100 if change.what else 0)
        picture = photograph(scene, polygon, seed, change.things, change.fault)[0]
        return picture if change.stored is None else change.stored(picture)

    def _zero(self, pictures: list[Pixels], setup: Setup) -> ZeroLine:
        line = zero_of(trace_image(pictures[0], setup), setup)
        if not line.doubts:
            return line
        # As `series.zero_line` does: a surface along a grid line does not tell how the camera stores light.
        tone = trace_image(pictures[-1], setup).tone
        return zero_of(trace_image(pictures[0], setup, tone), setup)

    def _outcome(self, picture: Pixels, setup: Setup, zero: ZeroLine, number: int) -> Outline | Refusal:
        pressure = PA * column(self.heights[number])
        try:
            traced = trace_image(picture, setup, likely=zero.tone)
            return outline_of(traced, setup, zero, pressure, 5.0, f"{number}")
        except Unmeasurable as error:
            return Refusal(str(error), Path(f"{number}"))

    def _measured(self, pictures: list[Pixels], setup: Setup) -> list[Outline | Refusal]:
        try:
            zero = self._zero(pictures, setup)
            if zero.sides is not None:
                setup = with_known_body(setup, zero, 2.0 * self.bench.half_width)
                zero = self._zero(pictures, setup)
        except (Unmeasurable, SetupError) as error:
            return [Refusal(str(error), Path())] * len(pictures)
        outcomes = [self._outcome(picture, setup, zero, number) for number, picture in enumerate(pictures)]
        if pictures is self.pictures:
            self.alone, self.known, self.zero = outcomes, setup, zero
        return self._judged(outcomes)

    def _judged(self, outcomes: list[Outline | Refusal]) -> list[Outline | Refusal]:
        results = [Result(self._photo(number), outcome, f"{number}") for number, outcome in enumerate(outcomes)]
        return [result.outcome for result in judged(results)]

    def _photo(self, number: int) -> Photograph:
        return Photograph(Path(f"{number}"), PA * column(self.heights[number]), 5.0)

    def _verdict(self, kind: str, change: Change, number: int, outcome: Outline | Refusal, setup: Setup) -> Verdict:
        height = self.heights[number] * change.height
        made = (kind, change.what, self.bench.seed, height)
        if isinstance(outcome, Refusal):
            return Verdict(*made, "refused", outcome.reason, False)
        off = self._off(outcome, height, setup)
        harmless = not off
        if outcome.trusted:
            return Verdict(*made, "right" if harmless else "wrong", off, harmless)
        return Verdict(*made, "untrusted", "; ".join(outcome.reasons), harmless)

    def _off(self, outline: Outline, height: float, setup: Setup) -> str:
        """How an outline is wrong by more than it says; empty where it is not."""
        found = []
        apex = float(np.max(self.bench.surface(np.linspace(-self.bench.radius, self.bench.radius, 4001), height)))
        off = outline.height - apex
        if abs(off) > max(WRONG, TIMES * outline.height_error):
            found.append(f"apex {off * 1e6:+.0f} +- {outline.height_error * 1e6:.1f} um")
        rest = across(self.bench, self.truth, setup, outline, height)
        far = np.abs(rest) > np.maximum(WRONG, TIMES * outline.error)
        if far.mean() > SHARE:
            worst = int(np.argmax(np.abs(rest)))
            found.append(f"{far.mean():.0%} of the outline, up to {rest[worst] * 1e6:+.0f} um")
        ends = 0.8 * self.bench.radius
        missing = float(np.diff(np.clip(np.r_[-np.inf, outline.x, np.inf], -ends, ends)).max())
        if missing > HIDDEN:
            found.append(f"{missing * 1e3:.1f} mm missing")
        return ", ".join(found)


def lens_of(given: tuple[float, ...]) -> list[float]:
    """Five coefficients of OpenCV's lens model, those that are not given 0."""
    return [*given, *[0.0] * (5 - len(given))]


def across(bench: Bench, truth: Truth, setup: Setup, outline: Outline, height: float) -> Array:
    """Distances (n,) in m of an outline's points from the true one, square to it, wherever the body stands along x."""
    origin = truth.to_metres(setup.to_pixels([[0.0, 0.0]]))[0, 0]
    x = outline.x + np.rint(origin / bench.scene.grid_pitch) * bench.scene.grid_pitch
    aside, rest = 0.0, np.zeros(len(x))
    for _ in range(6):
        here = x - aside
        slope = (bench.surface(here + 5e-6, height) - bench.surface(here - 5e-6, height)) / 10e-6
        lever = slope / np.sqrt(1.0 + slope**2)
        rest = (outline.z - bench.surface(here, height)) / np.sqrt(1.0 + slope**2)
        # Where along x a body stands means nothing to a fit, which has its own axis.
        weight = np.minimum(1.0, 10e-6 / np.maximum(np.abs(rest), 1e-12))
        spread = float(np.sum(weight * lever**2))
        if spread < 1e-3 * len(x):
            break
        aside -= float(np.clip(np.sum(weight * lever * rest) / spread, -2e-4, 2e-4))
    return np.asarray(rest)
