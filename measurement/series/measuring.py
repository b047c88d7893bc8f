"""All photographs of a list: the zero plane first, then every one of them, in processes of their own."""

from __future__ import annotations

import concurrent.futures
import contextlib
import dataclasses
import hashlib
import multiprocessing
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np

from measurement.camera.pixels import Pixels, Unmeasurable, read_photograph
from measurement.edge.tracing import AUTO, trace, trace_image
from measurement.outline import scaling, settling
from measurement.outline.outline import Outline
from measurement.outline.zero import ZeroLine
from measurement.screen.setup import Setup
from measurement.series import copies, witness
from measurement.series.photo import Refusal, find_zero, outline_of
from measurement.series.photo_list import Photograph

MOST_ASKED = 4
"""Photographs that are asked for the tone where the zero plane's does not tell it."""


class NoZero(ValueError):
    """No photograph gives a zero plane; the message is a sentence for the user."""


@dataclasses.dataclass(frozen=True, eq=False)
class Result:
    """What became of one photograph.

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
    """The undeformed surface: the setup's two points, or else the photograph whose pressure is nearest to zero.

    Raises:
        NoZero: Neither the setup nor the photographs have one, with the reason.
    """
    if setup.zero is not None:
        return ZeroLine.through(setup.zero)
    candidates = sorted((photo for photo in photographs if photo.is_zero), key=lambda photo: abs(photo.pressure))
    if not candidates:
        raise NoZero(
            "nothing tells the undeformed surface: list a photograph at zero pressure, or give two points of it to the setup "
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
    """How the camera stores light by the first of the highest photographs whose edge tells it; ``"auto"`` if none does."""
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
    """`judged`, and the pictures of what has lost its trust by it."""
    compared = judged(results)
    for before, after in zip(results, compared, strict=True):
        if pictures is not None and after is not before:
            _draw_again(after, setup, zero, tone, pictures)
    return compared


def judged(results: list[Result]) -> list[Result]:
    """Refuse or distrust what looks good by itself and is contradicted by the run's other photographs."""
    compared = list(results)
    whole = [result.outcome if isinstance(result.outcome, Outline) else None for result in results]
    for k, why in copies.copies(whole, [result.sample for result in results]).items():
        compared[k] = dataclasses.replace(results[k], outcome=Refusal(why, results[k].photograph.file))
    results = list(compared)
    outlines = {k: result.outcome for k, result in enumerate(results) if isinstance(result.outcome, Outline)}
    all_of_them = list(outlines.values())
    against = [judge(all_of_them) for judge in (settling.doubts, scaling.doubts)]
    for (k, outline), off, *doubts in zip(outlines.items(), settling.unknown(all_of_them), *against, strict=True):
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
    from measurement.series.photo_pictures import draw_edge

    with contextlib.suppress(Unmeasurable):  # it could be read a moment ago; what is drawn already stays
        image = read_photograph(result.photograph.file, (setup.camera.width, setup.camera.height))
        traced = trace_image(image, setup, tone, zero.tone)
        draw_edge(pictures / f"{result.name}.png", image, setup, traced, result.outcome, result.photograph.pressure)


def _unforeseen(error: Exception) -> str:
    words = " ".join(str(error).split())  # OpenCV's own have several lines
    return f"it led to an unforeseen failure ({type(error).__name__}: {words})"


def same_pictures(photographs: Sequence[Photograph]) -> dict[Path, str]:
    """Why files of the same bytes must not be measured: at two pressures one is wrong, at one pressure they count once.

    Returns:
        A sentence for each file whose bytes another file of the list repeats; at the same pressure for all but the first.
    """
    alike: dict[str, list[Photograph]] = {}
    for photo in photographs:
        try:
            with photo.file.open("rb") as file:
                alike.setdefault(hashlib.file_digest(file, "sha256").hexdigest(), []).append(photo)
        except (OSError, ValueError):
            continue  # a file that cannot be read is refused with its own reason
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
        sample = copies.cut_out(image)
        traced = trace_image(image, setup, tone, zero.tone)
        outcome = outline_of(traced, setup, zero, photo.pressure, photo.pressure_error, photo.file.name)
    except Unmeasurable as error:
        outcome = Refusal(str(error), photo.file)
    except Exception as error:  # one odd photograph must not take the others with it
        outcome = Refusal(_unforeseen(error), photo.file)
    if pictures is not None and image is not None:
        from measurement.series.photo_pictures import draw_edge

        draw_edge(pictures / f"{name}.png", image, setup, traced, outcome, photo.pressure)
    return Result(photo, outcome, name, sample)


RESERVED = ("heights", "profiles", "steps", "animation", "overview")
"""Stems of what a run writes beside its outlines: a photograph of such a name must not take the table's place."""


def _names(photographs: Sequence[Photograph]) -> list[str]:
    """A stem per photograph; the whole file name where two would share one, also where capitals do not count."""
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
