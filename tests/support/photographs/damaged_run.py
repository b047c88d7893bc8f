"""Whole runs of synthetic photographs with a damage in them, measured as a user's would be, and judged by the truth.

A bench is a random camera, screen, lamp and body. Its run is a photograph of the grid, one of the undeformed body and several
of the raised one. Where the body's sides are in the picture its width is given, because that of a user's device is known. A
damage falls on one photograph, on all of them or on the setup; the undamaged ones stay as they are.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from measurement.camera import Camera
from measurement.outline.outline import Outline
from measurement.outline.zero import ZeroLine, with_known_body
from measurement.photographer import column, lens_of, photograph, truth_of
from measurement.pictures import Unmeasurable
from measurement.screen.grid import GridError, find_grid
from measurement.screen.setup import Setup, SetupError
from measurement.series.measuring import Refusal, Result, judged, outline_of, trace_image, zero_of
from measurement.series.photo_list import Photograph
from tests.support.photographs.bench import PA_PER_CM, Bench
from tests.support.photographs.damages import KINDS, NEEDS_SIDES, ONE, RAISED, SETUP
from tests.support.photographs.faults import Change, Target
from tests.support.photographs.verdict import Verdict, faults_of

Pixels = NDArray[np.uint8]

SHARES = (0.0, 0.1, 0.25, 0.4, 0.6, 0.8, 1.0)
"""Heights of a run's photographs over the highest."""

PRESSURE_ERROR = 5.0
"""Standard error of their pressures in Pa."""


@dataclasses.dataclass(frozen=True, eq=False)
class _Measured:
    """Photographs measured one by one, each above the same surface.

    Attributes:
        setup: The setup, with the magnification from the body's width.
        zero: The undeformed surface; None where it could not be found.
        outcomes: What became of each photograph.
    """

    setup: Setup
    zero: ZeroLine | None
    outcomes: list[Outline | Refusal]


class Run:
    """The photographs of a bench, taken and measured once, in which one damage after another is tried."""

    def __init__(self, bench: Bench) -> None:
        """Photograph grid, undeformed and raised body, and measure them."""
        self.bench, self.truth = bench, truth_of(bench.scene)
        self.heights = [share * bench.top for share in SHARES]
        self.grid = photograph(bench.scene, None, 1000 * bench.seed)[0]
        self.setup = self._setup(bench.scene.distortion, 1.0)
        self.pictures = [self._picture(number, Change("")) for number in range(len(SHARES))]
        self.good = self._measured(self.pictures, self.setup)

    def good_ones(self) -> Iterator[Verdict]:
        """Yield the verdicts on the undamaged photographs."""
        for number, outcome in enumerate(self._judged(self.good.outcomes)):
            yield self._verdict("none", Change(""), number, outcome, self.setup)

    def damaged(self, kind: str, seed: int) -> Iterator[Verdict]:
        """Yield the verdicts on the photographs that one damage fell on; none where no evidence of it can be in the pictures.

        Args:
            kind: One of `damages.KINDS`.
            seed: Seed of its size and place.
        """
        scope, damage = KINDS[kind]
        if kind in NEEDS_SIDES and not self.bench.shows_sides:
            return
        key = [self.bench.seed, seed, list(KINDS).index(kind)]
        chosen = int(np.random.default_rng(key).integers(2, len(SHARES)))

        def change_of(number: int) -> Change:
            """Return the damage on one photograph: what is thrown on the screen belongs to its own body."""
            rng = np.random.default_rng(key)
            rng.integers(2, len(SHARES))
            outline, surface = self.bench.polygon(self.heights[number]), self.bench.upper(self.heights[chosen])
            return damage(Target(outline, surface, dataclasses.asdict(self.bench.scene)), rng)

        change, setup = change_of(chosen), self.setup
        numbers = {ONE: [chosen], RAISED: list(range(1, len(SHARES)))}.get(scope, list(range(len(SHARES))))
        pictures = list(self.pictures)
        if scope == SETUP:
            try:
                lens = self.bench.scene.distortion if change.lens is None else change.lens
                setup = self._setup(lens, change.pitch)
            except GridError as error:
                refusal = Refusal(str(error), Path())
                yield from (self._verdict(kind, change, number, refusal, setup) for number in numbers)
                return
        else:
            for number in numbers:
                pictures[number] = self._picture(number, change_of(number))
        outcomes = self._again(pictures[chosen], chosen) if scope == ONE else self._measured(pictures, setup).outcomes
        judged_ones = self._judged(outcomes)
        for number in numbers:
            yield self._verdict(kind, change, number, judged_ones[number], setup)

    def _again(self, picture: Pixels, number: int) -> list[Outline | Refusal]:
        """Return what becomes of the photographs, one of which is another; nothing else is measured again."""
        outcomes = list(self.good.outcomes)
        if self.good.zero is not None:
            outcomes[number] = self._outcome(picture, self.good.setup, self.good.zero, number)
        return outcomes

    def _setup(self, lens: tuple[float, ...], pitch: float) -> Setup:
        scene = self.bench.scene
        camera = Camera(self.truth.matrix, lens_of(lens), scene.width, scene.height, "known", 0.0)
        length = pitch * scene.grid_pitch
        return Setup(camera, find_grid(self.grid, camera, length).plane(camera), grid_pitch=length, pitch_error=0.002)

    def _picture(self, number: int, change: Change) -> Pixels:
        polygon = self.bench.polygon(self.heights[number] * change.height)
        polygon = polygon if change.shape is None else change.shape(polygon)
        scene = dataclasses.replace(self.bench.scene, **change.scene)
        seed = 1000 * self.bench.seed + 1 + number + (100 if change.what else 0)
        picture = photograph(scene, polygon, seed, change.things, change.fault)[0]
        return picture if change.stored is None else change.stored(picture)

    def _zero(self, pictures: list[Pixels], setup: Setup) -> ZeroLine:
        # As `measuring.zero_line` does.
        top = trace_image(pictures[-1], setup)
        raised = None if top.doubts else top
        line = zero_of(trace_image(pictures[0], setup), raised)
        return zero_of(trace_image(pictures[0], setup, top.tone), raised) if line.doubts else line

    def _outcome(self, picture: Pixels, setup: Setup, zero: ZeroLine, number: int) -> Outline | Refusal:
        photo = self._photo(number)
        try:
            traced = trace_image(picture, setup, likely=zero.tone)
            return outline_of(traced, zero, photo.pressure, photo.pressure_error, photo.file.name)
        except Unmeasurable as error:
            return Refusal(str(error), photo.file)

    def _measured(self, pictures: list[Pixels], setup: Setup) -> _Measured:
        try:
            zero = self._zero(pictures, setup)
            if zero.sides is not None:
                setup = with_known_body(setup, zero, 2.0 * self.bench.half_width)
                zero = self._zero(pictures, setup)
        except (Unmeasurable, SetupError) as error:
            return _Measured(setup, None, [Refusal(str(error), Path())] * len(pictures))
        found = [self._outcome(picture, setup, zero, number) for number, picture in enumerate(pictures)]
        return _Measured(setup, zero, found)

    def _judged(self, outcomes: list[Outline | Refusal]) -> list[Outline | Refusal]:
        results = [Result(self._photo(number), outcome, f"{number}") for number, outcome in enumerate(outcomes)]
        return [result.outcome for result in judged(results)]

    def _photo(self, number: int) -> Photograph:
        return Photograph(Path(f"{number}"), PA_PER_CM * column(self.heights[number]), PRESSURE_ERROR)

    def _verdict(self, kind: str, change: Change, number: int, outcome: Outline | Refusal, setup: Setup) -> Verdict:
        height = self.heights[number] * change.height
        made = (kind, change.what, self.bench.seed, height)
        if isinstance(outcome, Refusal):
            return Verdict(*made, "refused", outcome.reason, False)
        off = faults_of(outcome, self.bench, self.truth, setup, height)
        harmless = not off
        if outcome.trusted:
            return Verdict(*made, "right" if harmless else "wrong", off, harmless)
        return Verdict(*made, "untrusted", "; ".join(outcome.reasons), harmless)
