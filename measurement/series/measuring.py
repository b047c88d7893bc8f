"""All photographs of a list: the zero plane first, then every one of them, in processes of their own."""

from __future__ import annotations

import concurrent.futures
import contextlib
import csv
import dataclasses
import functools
import multiprocessing
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypedDict, Unpack

import cv2
import numpy as np
import numpy.typing as npt

from measurement.camera.pictures import Pixels, Unmeasurable, read_photograph
from measurement.edge.tracing import AUTO, trace, trace_image
from measurement.outline import checks
from measurement.outline.checks import with_known_body
from measurement.outline.outline import Outline
from measurement.outline.zero import ZeroLine
from measurement.robust import deviation
from measurement.screen.setup import Setup
from measurement.series import witness
from measurement.series.photo import Refusal, find_zero, outline_of
from measurement.series.photo_list import Column, Photograph, read_photos
from softmodels.common.files import file_digest

# ----------------------------------------------------------------------------------------------------------------------
# Detect copies of photographs (saved again, brightened or resized) by their noise.
#
# Two exposures have each its own noise, however alike what they show; a copy has its original's, weakened by compression but
# not gone. What all photographs of a run share (the grid, the screen's grain, the sensor's own pattern) is no sign of a copy:
# it is taken away by regression on other photographs of the run. For each of the two on others, so that the noise of those
# cannot make the two alike, and with half of those as instruments for the other half, so that their noise does not weaken
# the regression (O. Reiersol, Econometrica 9 (1941) 1, doi 10.2307/1907171). What is left is not correlated between honest
# exposures, to some thousandths in half a million pixels.


GreyPixels = npt.NDArray[np.uint8]
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


def cut_out(image: GreyPixels) -> GreyPixels:
    """Return the patches (patches, side, side) of a picture (h, w, 3) in grey, spread over its frame."""
    height, width = image.shape[:2]
    side = min(SIDE, height // ROWS, width // COLUMNS)
    tops = np.linspace(0, height - side, ROWS).astype(int)
    lefts = np.linspace(0, width - side, COLUMNS).astype(int)
    patches = [cv2.cvtColor(image[y : y + side, x : x + side], cv2.COLOR_RGB2GRAY) for y in tops for x in lefts]
    return np.stack(patches)


def prepared(patches: GreyPixels) -> Sample:
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


def copies(outlines: Sequence[Outline | None], samples: Sequence[GreyPixels | None]) -> dict[int, str]:
    """Return which photographs of a run are copies of each other, by their noise.

    Args:
        outlines: Their outlines in the list's order; None where there is none.
        samples: Their patches from `cut_out`; None where there are none.

    Returns:
        A sentence for each number of a photograph that must not be used: both of two copies at different pressures, of
        which one at least is wrong, and the later one of two at the same pressure, which would count twice.
    """
    usable = [
        k for k, (outline, sample) in enumerate(zip(outlines, samples, strict=True)) if outline and sample is not None
    ]
    kept = functools.cache(lambda k: prepared(samples[k]))  # type: ignore[arg-type]
    near = {(i, j) for i in usable for j in usable if i != j and _same_outline(outlines[i], outlines[j])}  # type: ignore[arg-type]
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
            assert first is not None and second is not None
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


MOST_ASKED = 4
"""Photographs that are asked for the tone where the zero plane's does not tell it."""


class NoZero(ValueError):
    """No photograph gives a zero plane; the message is for the user."""


@dataclasses.dataclass(frozen=True, eq=False)
class Result:
    """Result of one photograph.

    Attributes:
        photograph: Its row of the list.
        outcome: Its outline, or why there is none.
        name: Stem of its files in the output folder.
        sample: Patches of its picture, by which copies are found; None where it could not be read.
    """

    photograph: Photograph
    outcome: Outline | Refusal
    name: str
    sample: Pixels | None = None


def zero_line(photographs: Sequence[Photograph], setup: Setup, tone: str = AUTO) -> ZeroLine:
    """Return the undeformed surface: the setup's two points, or else the photograph whose pressure is nearest to zero.

    Raises:
        NoZero: Neither the setup nor the photographs have one, with the reason.
    """
    if setup.zero is not None:
        return ZeroLine.through(setup.zero)
    candidates = sorted((photo for photo in photographs if photo.is_zero), key=lambda photo: abs(photo.pressure))
    if not candidates:
        raise NoZero(
            "the undeformed surface is unknown: list a photograph at zero pressure, or give two points of it to the setup "
            "(--zero)"
        )
    reasons, doubted = [], []
    for photo in candidates:
        try:
            line = find_zero(photo.file, setup, tone)
            if line.doubts:
                # A surface that lies along a grid line does not show how the camera stores light; a bent one does.
                line = find_zero(photo.file, setup, clear_tone(photographs, setup) if tone == AUTO else tone)
            if not line.doubts:
                return line
            doubted.append(line)  # another photograph at zero may be better
        except Unmeasurable as error:
            reasons.append(f"{photo.file.name}: {error}")
        except Exception as error:  # as in `_measure_one`
            reasons.append(f"{photo.file.name}: {_unforeseen(error)}")
    if doubted:
        return doubted[0]
    raise NoZero(f"no photograph at zero pressure shows the undeformed surface; {'; '.join(reasons)}")


def clear_tone(photographs: Sequence[Photograph], setup: Setup) -> str:
    """Return how the camera stores light by the first of the highest photographs whose edge shows it; ``"auto"`` if none
    does."""
    for photo in sorted(photographs, key=lambda photo: photo.pressure, reverse=True)[:MOST_ASKED]:
        with contextlib.suppress(Unmeasurable):
            traced = trace(photo.file, setup)
            if not traced.doubts:
                return traced.tone
    return AUTO


def measure_all(
    photographs: Sequence[Photograph],
    setup: Setup,
    zero: ZeroLine,
    tone: str = AUTO,
    jobs: int = 1,
    pictures: Path | None = None,
    done: Callable[[Result], None] = lambda result: None,
) -> list[Result]:
    """Measure every photograph.

    Args:
        photographs: The list.
        setup: Camera and screen.
        zero: The undeformed surface.
        tone: How the files store light.
        jobs: Processes at a time.
        pictures: Folder for a picture of each photograph with its edge; None for none.
        done: Called after each photograph.

    Returns:
        One result per photograph, in the list's order.
    """
    names = _names(photographs)
    same = same_pictures(photographs)
    work = [
        (photo, name, setup, zero, tone, pictures)
        for photo, name in zip(photographs, names, strict=True)
        if photo.file not in same
    ]
    results: dict[str, Result] = {}
    for photo, name in zip(photographs, names, strict=True):
        if photo.file in same:
            results[name] = Result(photo, Refusal(same[photo.file], photo.file), name)
            done(results[name])
    if jobs <= 1 or len(work) <= 1:
        for task in work:
            result = _measure_one(*task)
            results[result.name] = result
            done(result)
    else:
        # Fresh processes: a fork would copy the threads' locks of OpenCV and of the terminal's progress bar.
        context = multiprocessing.get_context("spawn")
        with concurrent.futures.ProcessPoolExecutor(min(jobs, len(work)), context, initializer=_alone) as pool:
            for future in concurrent.futures.as_completed([pool.submit(_measure_one, *task) for task in work]):
                result = future.result()
                results[result.name] = result
                done(result)
    return _compared([results[name] for name in names], setup, zero, tone, pictures)


def _compared(results: list[Result], setup: Setup, zero: ZeroLine, tone: str, pictures: Path | None) -> list[Result]:
    """Return `judged`, and the pictures of what has lost its trust by it."""
    compared = judged(results)
    for before, after in zip(results, compared, strict=True):
        if pictures is not None and after is not before:
            _draw_again(after, setup, zero, tone, pictures)
    return compared


def judged(results: list[Result]) -> list[Result]:
    """Reject or distrust what looks good by itself and is contradicted by the run's other photographs."""
    compared = list(results)
    whole = [result.outcome if isinstance(result.outcome, Outline) else None for result in results]
    for k, why in copies(whole, [result.sample for result in results]).items():
        compared[k] = dataclasses.replace(results[k], outcome=Refusal(why, results[k].photograph.file))
    results = list(compared)
    outlines = {k: result.outcome for k, result in enumerate(results) if isinstance(result.outcome, Outline)}
    all_of_them = list(outlines.values())
    against = [judge(all_of_them) for judge in (checks.settling_doubts, checks.scaling_doubts)]
    for (k, outline), off, *doubts in zip(outlines.items(), checks.unknown(all_of_them), *against, strict=True):
        outlines[k] = dataclasses.replace(outline, error=np.hypot(outline.error, off)) if off else outline
        outlines[k] = _doubted(outlines[k], *doubts)
    # Heights against pressures last: what is not trusted already is no witness.
    for (k, outline), doubt in zip(outlines.items(), witness.doubts(list(outlines.values())), strict=True):
        outlines[k] = _doubted(outline, doubt)
    for k, outline in outlines.items():
        if outline is not results[k].outcome:
            compared[k] = dataclasses.replace(results[k], outcome=outline)
    return compared


def _doubted(outline: Outline, *doubts: str | None) -> Outline:
    reasons = tuple(doubt for doubt in doubts if doubt is not None)
    return dataclasses.replace(outline, trusted=False, reasons=(*outline.reasons, *reasons)) if reasons else outline


def _draw_again(result: Result, setup: Setup, zero: ZeroLine, tone: str, pictures: Path) -> None:
    from measurement.series.pictures import draw_edge

    with contextlib.suppress(Unmeasurable):  # it could be read a moment ago; what is drawn already stays
        image = read_photograph(result.photograph.file, (setup.camera.width, setup.camera.height))
        traced = trace_image(image, setup, tone, zero.tone)
        draw_edge(pictures / f"{result.name}.png", image, setup, traced, result.outcome, result.photograph.pressure)


def _unforeseen(error: Exception) -> str:
    words = " ".join(str(error).split())  # OpenCV's own have several lines
    return f"it led to an unforeseen failure ({type(error).__name__}: {words})"


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


def _alone() -> None:
    cv2.setNumThreads(1)  # the processes share the cores already


def _measure_one(
    photo: Photograph, name: str, setup: Setup, zero: ZeroLine, tone: str, pictures: Path | None
) -> Result:
    image, traced, sample = None, None, None
    outcome: Outline | Refusal
    try:
        image = read_photograph(photo.file, (setup.camera.width, setup.camera.height))
        sample = cut_out(image)
        traced = trace_image(image, setup, tone, zero.tone)
        outcome = outline_of(traced, setup, zero, photo.pressure, photo.pressure_error, photo.file.name)
    except Unmeasurable as error:
        outcome = Refusal(str(error), photo.file)
    except Exception as error:  # one odd photograph must not take the others with it
        outcome = Refusal(_unforeseen(error), photo.file)
    if pictures is not None and image is not None:
        from measurement.series.pictures import draw_edge

        draw_edge(pictures / f"{name}.png", image, setup, traced, outcome, photo.pressure)
    return Result(photo, outcome, name, sample)


RESERVED = ("heights", "profiles", "steps", "animation", "overview")
"""Stems of what a run writes beside its outlines: a photograph of such a name must not take the table's place."""


def _names(photographs: Sequence[Photograph]) -> list[str]:
    """Return a stem per photograph; the whole file name where two would share one, also where capitals do not count."""
    stems = [photo.file.stem.casefold() for photo in photographs]
    names: list[str] = []
    for photo, stem in zip(photographs, stems, strict=True):
        name = photo.file.stem if stems.count(stem) == 1 else photo.file.name.replace(".", "_")
        if not name.strip("."):
            name = f"_{name}"
        while name.casefold() in (*RESERVED, *(other.casefold() for other in names)):
            name += "_"
        names.append(name)
    return names


# ----------------------------------------------------------------------------------------------------------------------
# Outlines from a list of photographs, as one call: the zero plane, the shadow's size, every photograph, and their tables.


HEIGHTS = ("file", "pressure_Pa", "pressure_error_Pa", "height_m", "height_error_m", "trusted", "remarks")


class MeasuringOptions(TypedDict, total=False):
    """Settings of a measurement.

    Attributes:
        tone: How the files store light: ``"auto"``, ``"srgb"`` as a camera's JPEG, or ``"linear"``.
        width: True width of the body in m and its standard error, where the photographs show its sides: it gives the
            shadow's magnification.
        jobs: Processes at a time; more than one start Python anew, so a script needs its ``if __name__ == "__main__":``.
        edges: Folder for a picture of each photograph with its edge; none without it.
        done: Called with the `Result` of each photograph.
    """

    tone: str
    width: tuple[float, float] | None
    jobs: int
    edges: Path | None
    done: Callable[[Result], None]


@dataclasses.dataclass(frozen=True, eq=False)
class Measurement:
    """Results of a list of photographs.

    Attributes:
        results: One for each photograph, in the list's order.
        setup: The setup as used: with the magnification from the body's width.
        zero: The undeformed surface.
    """

    results: tuple[Result, ...]
    setup: Setup
    zero: ZeroLine

    @property
    def outlines(self) -> list[Outline]:
        """The outlines, in the list's order; those that are not `Outline.trusted` too."""
        return [result.outcome for result in self.results if isinstance(result.outcome, Outline)]

    @property
    def refused(self) -> dict[str, str]:
        """Photographs without an outline, and the reasons."""
        return {
            result.photograph.file.name: result.outcome.reason
            for result in self.results
            if isinstance(result.outcome, Refusal)
        }

    def write(self, folder: Path) -> None:
        """Write ``heights.csv`` and a table of each outline into a folder.

        Raises:
            OSError: They cannot be written.
        """
        with (folder / "heights.csv").open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(HEIGHTS)
            for result in self.results:
                rows.writerow(_row(result))
        for result in self.results:
            if isinstance(result.outcome, Outline):
                result.outcome.to_csv(folder / f"{result.name}.csv")


def _row(result: Result) -> tuple[str, ...]:
    """Return a photograph's line of ``heights.csv``."""
    photo, outcome = result.photograph, result.outcome
    first = (photo.file.name, repr(photo.pressure), repr(photo.pressure_error))
    if isinstance(outcome, Refusal):
        return (*first, "", "", "refused", outcome.reason)
    trusted = "yes" if outcome.trusted else "no"
    return (*first, f"{outcome.height:.9g}", f"{outcome.height_error:.4g}", trusted, "; ".join(outcome.reasons))


def measure(photographs: Sequence[Photograph], setup: Setup, **how: Unpack[MeasuringOptions]) -> Measurement:
    """Measure every photograph of a list.

    Args:
        photographs: The list.
        setup: Camera and screen.
        how: See `MeasuringOptions`.

    Raises:
        NoZero: No photograph, and nothing in the setup, shows the undeformed surface.
        SetupError: The body's width does not go with what the photographs show.
    """
    tone, jobs, edges = how.get("tone", AUTO), how.get("jobs", 1), how.get("edges")
    setup, zero = with_zero(photographs, setup, tone, how.get("width"))
    results = measure_all(photographs, setup, zero, tone, jobs, edges, how.get("done", lambda result: None))
    return Measurement(tuple(results), setup, zero)


def with_zero(
    photographs: Sequence[Photograph], setup: Setup, tone: str, width: tuple[float, float] | None
) -> tuple[Setup, ZeroLine]:
    """Return the setup, with the magnification from a body's width, and the undeformed surface. Errors as of
    `measure`."""
    zero = zero_line(photographs, setup, tone)
    if width is None:
        return setup, zero
    setup = with_known_body(setup, zero, *width)
    return setup, zero_line(photographs, setup, tone)


def outlines(
    photos: str | Path | Sequence[Photograph],
    setup: str | Path | Setup,
    column: Column | None = None,
    **how: Unpack[MeasuringOptions],
) -> Measurement:
    """Return the outlines of a body's shadow in a list of photographs.

    Args:
        photos: The list, ``photos.csv``, or its rows.
        setup: Camera and screen, or the file ``setup.toml`` that ``python -m measurement setup`` writes.
        column: The water column that the list's lengths were read from.
        how: See `MeasuringOptions`.

    Returns:
        The outlines, and the reasons for rejected photographs.

    Raises:
        PhotoListError: The list cannot be read.
        SetupError: The setup cannot be used.
        NoZero: Nothing shows the undeformed surface.
    """
    listed = read_photos(Path(photos), column) if isinstance(photos, str | Path) else photos
    known = Setup.from_file(setup) if isinstance(setup, str | Path) else setup
    return measure(listed, known, **how)
