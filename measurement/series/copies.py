"""Detect copies of photographs (saved again, brightened or resized) by their noise.

Two exposures have each its own noise, however alike what they show; a copy has its original's, weakened by compression but
not gone. What all photographs of a run share (the grid, the screen's grain, the sensor's own pattern) is no sign of a copy:
it is taken away by regression on other photographs of the run. For each of the two on others, so that the noise of those
cannot make the two alike, and with half of those as instruments for the other half, so that their noise does not weaken
the regression (O. Reiersol, Econometrica 9 (1941) 1, doi 10.2307/1907171). What is left is not correlated between honest
exposures, to some thousandths in half a million pixels.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from measurement.camera.pictures import Pixels
from measurement.outline.outline import Outline
from measurement.robust import deviation
from measurement.series.photo_list import Photograph
from softmodels.common.files import file_digest

Float32Array = npt.NDArray[np.float32]

ROWS, COLUMNS, SIDE = 3, 4, 192
"""Patches in a column and in a row of the frame, and their side in px, that are kept of each photograph."""

FINE = 3.0
"""Standard deviation in px of the smooth part that is taken away."""

MOVING, MARGIN = 0.15, 13
"""Share of the lit screen's brightness by which photographs may differ at a place that is compared, and its surroundings
in px that are left out: the shadows' edges lie elsewhere in each."""

MOST_OTHERS = 4
"""Photographs of the same run that tell what all of them share."""

COPIED = 0.03
"""Least correlation of what is left by which one is the other's copy; honest exposures stay below 0.007."""

COPIED_BY_ONE = 0.06
"""By how much two must be more alike than each is to the only other photograph."""

NEAR = 60e-6
"""Distance in m up to which two outlines may show the same: a copy of another brightness moves the edge a little."""


@dataclasses.dataclass(frozen=True, eq=False)
class Sample:
    """Data of a photograph by which copies are recognised.

    Attributes:
        fine: What is left without the smooth part, without its outliers, shape (n,).
        smooth: The smooth part over its largest value, shape (patches, side, side).
    """

    fine: Float32Array
    smooth: Float32Array


def cut_out(image: Pixels) -> Pixels:
    """Return the patches (patches, side, side) of a picture (h, w, 3) in grey, spread over its frame."""
    height, width = image.shape[:2]
    side = min(SIDE, height // ROWS, width // COLUMNS)
    tops = np.linspace(0, height - side, ROWS).astype(int)
    lefts = np.linspace(0, width - side, COLUMNS).astype(int)
    patches = [cv2.cvtColor(image[y : y + side, x : x + side], cv2.COLOR_RGB2GRAY) for y in tops for x in lefts]
    return np.stack(patches)


def prepared(patches: Pixels) -> Sample:
    """Return the patches of `cut_out`, parted into what is smooth and what is fine."""
    light = patches.astype(np.float32)
    smooth = np.stack([cv2.GaussianBlur(patch, (0, 0), FINE) for patch in light])
    fine = (light - smooth).ravel()
    scatter = max(deviation(fine), 0.3)
    level = max(float(smooth.max()), 1.0)
    return Sample(np.clip(fine, -5.0 * scatter, 5.0 * scatter).astype(np.float32), (smooth / level).astype(np.float32))


def likeness(first: Sample, second: Sample, others: Sequence[Sample]) -> float:
    """Return the correlation of what two photographs do not share with others; NaN where it is unknown.

    Args:
        first: One of the two.
        second: The other.
        others: Different photographs of the same run; with fewer than two the bar is another, see `is_copy`.
    """
    if not others or any(other.fine.shape != first.fine.shape for other in (second, *others)):
        return np.nan
    still = _still([first, second, *others])
    if still.sum() < 1000:
        return np.nan
    one, two, *rest = (sample.fine[still].astype(np.float64) for sample in (first, second, *others))
    if len(rest) == 1:
        return _correlation(one, two) - max(_correlation(one, rest[0]), _correlation(two, rest[0]))
    half = len(rest) // 2
    left, right = np.mean(rest[:half], axis=0), np.mean(rest[half:], axis=0)
    found = []
    for pattern, instrument in ((left, right), (right, left)):
        shared = float(pattern @ instrument)
        if not shared > 0.0:
            found.append(_correlation(one, two))
            continue
        rest_one = one - float(one @ instrument) / shared * pattern
        rest_two = two - float(two @ pattern) / shared * instrument
        found.append(_correlation(rest_one, rest_two))
    return float(np.mean(found))


def is_copy(first: Sample, second: Sample, others: Sequence[Sample]) -> bool:
    """Return whether one of two photographs is the other's copy, judged by up to `MOST_OTHERS` others of the run."""
    others = list(others)[:MOST_OTHERS]
    alike = likeness(first, second, others)
    if len(others) < 2:
        return bool(alike > COPIED_BY_ONE)
    if not alike > COPIED:
        return False
    # A camera that was nudged between photographs makes those before it alike, and those after it.
    usual = [
        likeness(one, other, [rest for rest in others if rest is not other])
        for one in (first, second)
        for other in others
        if len(others) > 2
    ]
    return bool(alike > 2.0 * max([0.0, *(value for value in usual if np.isfinite(value))]))


def copies(outlines: Mapping[int, Outline], samples: Mapping[int, Pixels]) -> dict[int, str]:
    """Return which photographs of a run are copies of each other, by their noise.

    Args:
        outlines: Their outlines by their numbers in the list.
        samples: Their patches from `cut_out`, by the same numbers.

    Returns:
        A sentence for each number of a photograph that must not be used: both of two copies at different pressures, of
        which one at least is wrong, and the later one of two at the same pressure, which would count twice.
    """
    usable = [k for k in outlines if k in samples]
    kept = functools.cache(lambda k: prepared(samples[k]))
    near = {(i, j) for i in usable for j in usable if i != j and _same_outline(outlines[i], outlines[j])}
    found: dict[int, str] = {}
    for i, j in sorted(near):
        if i > j:
            continue
        # Those that show something else are surely no further copies, and the nearest in time share the most.
        rest = sorted(
            (k for k in usable if k not in (i, j)), key=lambda k: ((i, k) in near or (j, k) in near, abs(k - i))
        )
        if is_copy(kept(i), kept(j), [kept(k) for k in rest[:MOST_OTHERS]]):
            first, second = outlines[i], outlines[j]
            if first.pressure != second.pressure:
                found.setdefault(i, _two_pressures(second.source))
                found.setdefault(j, _two_pressures(first.source))
            else:
                found.setdefault(j, f"it is a copy of {first.source}, saved again: {SAME_NOISE}, so it counts once")
    return found


SAME_NOISE = "it has the same noise, which two exposures never have"


def _two_pressures(other: str) -> str:
    return f"it and {other} are copies of one photograph: {SAME_NOISE}; one of their different pressures is wrong"


def _same_outline(one: Outline, two: Outline) -> bool:
    if abs(one.height - two.height) > NEAR:
        return False
    left, right = max(one.x[0], two.x[0]), min(one.x[-1], two.x[-1])
    inside = (one.x >= left) & (one.x <= right)
    if inside.sum() < 10:
        return False
    return float(np.median(np.abs(one.z[inside] - np.interp(one.x[inside], two.x, two.z)))) <= NEAR


def _still(samples: Sequence[Sample]) -> npt.NDArray[np.bool_]:
    """Return the places (n,) that look alike in all: no shadow's edge passes over them."""
    middle = np.median([sample.smooth for sample in samples[2:]], axis=0)
    thin = middle.ravel()[::37]
    moving = np.zeros(middle.shape, dtype=bool)
    for sample in samples:
        # A copy may be brighter, or of another gamma: a line through the brightnesses is near enough.
        scale, offset = np.polyfit(sample.smooth.ravel()[::37], thin, 1)
        moving |= np.abs(scale * sample.smooth + offset - middle) > MOVING
    kernel = np.ones((MARGIN, MARGIN), np.uint8)
    return np.stack([cv2.dilate(patch.astype(np.uint8), kernel) == 0 for patch in moving]).ravel()


def _correlation(one: npt.NDArray[np.float64], two: npt.NDArray[np.float64]) -> float:
    size = float(one @ one) * float(two @ two)
    return float(one @ two) / float(np.sqrt(size)) if size > 0.0 else 0.0


def same_pictures(photographs: Sequence[Photograph]) -> dict[Path, str]:
    """Return why files of the same bytes must not be measured: at two pressures one is wrong, at one pressure they count once.

    Returns:
        A sentence for each file whose bytes another file of the list repeats; at the same pressure for all but the first.
    """
    alike: dict[str, list[Photograph]] = {}
    for photo in photographs:
        try:
            alike.setdefault(file_digest(photo.file), []).append(photo)
        except (OSError, ValueError):
            continue  # a file that cannot be read is rejected with its own reason
    found: dict[Path, str] = {}
    for group in alike.values():
        one_pressure = len({photo.pressure for photo in group}) == 1
        for photo in group[1:] if one_pressure else group:
            others = group[:1] if one_pressure else [other for other in group if other is not photo]
            names = " and ".join(other.file.name for other in others)
            wrong = "and counts once" if one_pressure else "listed at another pressure: one of the two is wrong"
            found[photo.file] = f"it is the same picture as {names}, {wrong}"
    return found
