"""Measure photographs: one, its edge and the outline above the zero plane, or why it is rejected (`checks`); all of a list, the
zero plane first, then every one, in processes of their own."""

from __future__ import annotations

import contextlib
import csv
import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypedDict, Unpack

import cv2
import numpy as np

from measurement.outline import edge, profiles
from measurement.outline.outline import Outline, OutlineError
from measurement.outline.zero import ZeroLine, sides_of, with_known_body
from measurement.pictures import TONES, Pixels, Unmeasurable, read_pixels
from measurement.screen.setup import Setup
from measurement.series import checks, drawing, photo_list, witness
from measurement.series.photo_list import Column, Photograph
from measurement.series.witness import Refusal, Result
from softmodels.common import processes

AUTO = "auto"
LARGEST_TONE = 0.2
"""Departure e of the light from the tone curve beyond which it is no camera's."""

CLEARLY_WORSE = 0.5
"""Share of the other tone's chi-square, as estimated from the mean profile by the first, that must speak against it; less is
decided by a trace with that tone."""

TONE_SHIFT, TONE_HARM = 0.4, 5e-6
"""Shift of the edge by a wrong tone in widths of the edge, and the shift in m that would do no harm."""


def trace(file: Path, setup: Setup, tone: str = AUTO, likely: str = "", anyway: bool = False) -> edge.Traced:
    """Return `trace_image` of a file."""
    return trace_image(read_pixels(file, setup.camera.size), setup, tone, likely, anyway)


def trace_image(image: Pixels, setup: Setup, tone: str = AUTO, likely: str = "", anyway: bool = False) -> edge.Traced:
    """Find the edge of the shadow in a photograph (h, w, 3); `Unmeasurable` if it must not be measured.

    A penumbra is symmetric in light, and no longer so in numbers of another scale: half of the light lies elsewhere then, by up
    to half of the penumbra's width. A shape with a free departure from the tone curve follows even a wrong one to some extent,
    so with the tone ``"auto"`` all are tried, and the one with the least chi-square is taken if it is decisively less.
    ``likely`` is that of the run's other photographs, for an edge that lies on the grid's ink and does not tell its own.
    """
    if tone != AUTO:
        return _traced_edges(image, setup, tone, anyway)
    names = sorted(TONES, key=lambda name: name != (likely or "srgb"))
    first = _traced_edges(image, setup, names[0], anyway)
    # Where a shape fits this well, no other tone can be decisively better.
    fits = first.edge.shape.chi_square < profiles.DECISIVE_CHI_SQUARE
    if (likely and fits) or _is_clear(first.edge.shape, CLEARLY_WORSE * first.edge.shape.chi_square_by(TONES[names[1]])):
        return first
    traces = [first]
    with contextlib.suppress(Unmeasurable):  # where only one tone shows an edge, the other is wrong
        traces.append(_traced_edges(image, setup, names[1], anyway))
    best, *others = sorted(traces, key=lambda traced: traced.edge.shape.chi_square)
    if not others and fits:
        return first
    other = others[0].edge.shape.chi_square if others else np.inf
    moved = float(np.median(best.edge.width)) * best.scale * TONE_SHIFT
    if moved <= TONE_HARM or _is_clear(best.edge.shape, other):
        return best
    # Without evidence against it, not even a shape, a photograph has the tone of its series.
    if (
        likely
        and not (first is not best and _is_decisive(best.edge.shape, other))
        and not first.edge.shape.misfit >= profiles.LARGEST_MISFIT
    ):
        return first
    best.tone_error = moved
    best.doubts += checks.doubts(checks.ToneEvidence(best))
    return best


def _is_clear(shape: profiles.EdgeShape, other: float) -> bool:
    """Return whether a shape is a camera's and fits so well that its tone is right, the other having this chi-square."""
    return shape.misfit < profiles.LARGEST_MISFIT and abs(shape.tone) < LARGEST_TONE and _is_decisive(shape, other)


def _is_decisive(shape: profiles.EdgeShape, other: float) -> bool:
    """Return whether the other tone's chi-square rules it out."""
    # A model that misses the profile by more than its error is no better evidence for missing another by as much more.
    return other - shape.chi_square >= profiles.DECISIVE_CHI_SQUARE * max(1.0, shape.misfit**2)


def _traced_edges(image: Pixels, setup: Setup, tone: str, anyway: bool) -> edge.Traced:
    traced = edge.Traced(image, setup, tone, anyway=anyway)
    traced.doubts = checks.doubts(checks.EdgeEvidence(traced))
    return traced


def find_zero(file: Path, setup: Setup, tone: str = AUTO, raised: edge.Traced | None = None, anyway: bool = False) -> ZeroLine:
    """Return `zero_of` a file."""
    return zero_of(trace(file, setup, tone, anyway=anyway), raised)


def zero_of(traced: edge.Traced, raised: edge.Traced | None = None) -> ZeroLine:
    """Return the undeformed surface from the photograph at zero pressure; one of the raised body without doubts shows what
    the camera does to an edge. Raises `Unmeasurable` where it shows no straight surface."""
    hidden = 0.0
    if raised is not None:
        again = traced.of_level(raised)
        if again.lift and again.edge.shape.chi_square <= traced.edge.shape.chi_square - profiles.DECISIVE_CHI_SQUARE:
            again.tone_error, again.doubts = 0.0, checks.doubts(checks.EdgeEvidence(again))
            traced = again
        elif raised.tone == traced.tone:
            traced, hidden = again, again.edge.shape.hidden * again.width_px * again.scale
    errors = traced.own_error
    seen = ~traced.line.bridged
    line = ZeroLine.fit(traced.points[seen], traced.normals[seen], errors[seen])
    # The body's sides, deep along the light or not, are to lie where a raised body's photograph has them.
    placed, upwards = line.place(traced.points + traced.lift * traced.normals)[seen], traced.normals[seen] @ line.normal
    sides = sides_of(placed, upwards, errors[seen])
    if sides is not None and traced.lift:
        # A round body's sides are not, but a block's are: the lift is what is unknown of each.
        sides = dataclasses.replace(sides, error=float(np.hypot(sides.error, 2.0 * traced.lift)))
    line = dataclasses.replace(
        line,
        error=float(np.hypot(line.error, traced.shift_error)),
        model_error=traced.model_error,
        tone=traced.tone,
        sides=sides,
    )
    evidence = checks.ZeroEvidence(traced, line)
    bow, lift = evidence.bow, traced.lift
    left = 0.0 if bow is None else bow.level_error
    all_doubts = (*traced.doubts, *checks.doubts(evidence))
    if bow is not None and bow.by_depth(lift):
        # The lift goes with the body's chord along the light, so that the bow shows its mean too, which the shape underrates:
        # the middle between both is taken, and half of their difference as its error.
        more = 0.5 * max(0.0, bow.mean - lift)
        line = dataclasses.replace(line, origin=line.origin - more * line.normal)
        left, lift = float(np.hypot(bow.error, more)), lift + more
    return dataclasses.replace(line, doubts=all_doubts, level_error=float(np.hypot(hidden, left)), lift=lift)


def outline_of(traced: edge.Traced, zero: ZeroLine, pressure: float, pressure_error: float, source: str) -> Outline:
    """Return the outline above the surface; `Unmeasurable` if it is not that of an actuator on this surface."""
    e = checks.OutlineEvidence(traced, zero)
    reasons = (*traced.doubts, *checks.doubts(e))
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
            anyway=traced.anyway,
            edge_error=traced.shift_error,
        )
    except OutlineError as problem:
        raise Unmeasurable(str(problem)) from None


# ----------------------------------------------------------------------------------------------------------------------
# All photographs of a list.


MOST_ASKED = 4
"""Raised photographs that are asked for what the camera does to an edge."""


class NoZero(ValueError):
    """No photograph gives a zero plane; the message is for the user."""


def zero_line(photographs: Sequence[Photograph], setup: Setup, tone: str = AUTO) -> ZeroLine:
    """Return the undeformed surface: the setup's two points, or else the photograph whose pressure is nearest to zero.
    Raises `NoZero`, with the reason, where neither has one."""
    if setup.zero is not None:
        return ZeroLine.through(setup.zero)
    candidates = sorted((photo for photo in photographs if photo.is_zero), key=lambda photo: abs(photo.pressure))
    if not candidates:
        raise NoZero(
            "the undeformed surface is unknown: list a photograph at zero pressure, or give two points of it to the setup "
            "(--zero)"
        )
    reasons, doubted = [], []
    raised = clear_edge(photographs, setup, tone)
    for photo in candidates:
        try:
            line = find_zero(photo.file, setup, tone, raised, photo.anyway)
            if line.doubts and raised is not None:
                # A level surface may lie along a grid line, or be deep along the light: neither shows how the camera stores it.
                line = find_zero(photo.file, setup, raised.tone, raised, photo.anyway)
            if not line.doubts:
                return line
            doubted.append(line)  # another photograph at zero may be better
        except Unmeasurable as error:
            reasons.append(f"{photo.file.name}: {error}")
        except Exception as error:  # as in `_measure_one`
            reasons.append(f"{photo.file.name}: {unexpected_error(error)}")
    if doubted:
        return doubted[0]
    raise NoZero(f"no photograph at zero pressure shows the undeformed surface; {'; '.join(reasons)}")


def clear_edge(photographs: Sequence[Photograph], setup: Setup, tone: str = AUTO) -> edge.Traced | None:
    """Return the first of the highest photographs whose edge is free of doubt; None if there is none."""
    raised = [photo for photo in photographs if not photo.is_zero]
    for photo in sorted(raised, key=lambda photo: photo.pressure, reverse=True)[:MOST_ASKED]:
        with contextlib.suppress(Exception):  # what it is comes up when it is measured itself
            traced = trace(photo.file, setup, tone)
            if not traced.doubts:
                return traced
    return None


def measure_all(
    photographs: Sequence[Photograph],
    setup: Setup,
    zero: ZeroLine,
    tone: str = AUTO,
    jobs: int = 1,
    pictures: Path | None = None,
    done: Callable[[Result], None] = lambda result: None,
) -> list[Result]:
    """Return a result per photograph, in the list's order, measured in so many processes at a time. The folder
    ``pictures`` gets one of each with its edge; ``done`` is called after each. A photograph on which two processes ended, as
    where memory runs out, is refused."""
    names, listed = file_stems(photographs), witness.Run(rows=photographs)
    results: dict[str, Result] = {}
    work = []

    def take(result: Result) -> None:
        results[result.name] = result
        done(result)

    for k, (photo, name) in enumerate(zip(photographs, names, strict=True)):
        if doubt := next(checks.answers(checks.ListEvidence(listed, k)), None):
            take(Result(photo, Refusal(str(doubt), photo.file), name))
        else:
            work.append((photo, name, setup, zero, tone, pictures))
    known = {stage: known.loaded for stage, known in checks.CHECKS.items()}
    if jobs <= 1 or len(work) <= 1 or processes.pickled(known) is None:
        for task in work:
            take(_measure_one(*task))
    else:
        tasks = {number: (known, *task) for number, task in enumerate(work)}
        for number, (returned, value) in processes.answers(__name__, measured_beside.__name__, tasks, jobs):
            photo, name, *_ = work[number]
            take(value if returned else Result(photo, Refusal(value, photo.file), name))
    before = [results[name] for name in names]
    after = judged(before)
    for k, result in enumerate(after):
        if pictures is not None and result is not before[k]:
            with contextlib.suppress(Unmeasurable):  # it could be read a moment ago; what is drawn already stays
                photo = result.photograph
                image = read_pixels(photo.file, setup.camera.size)
                traced = trace_image(image, setup, tone, zero.tone, photo.anyway)
                drawing.draw_edge(pictures / f"{result.name}.png", image, setup, traced, result.outcome, photo.pressure)
    return after


def judged(results: Sequence[Result]) -> list[Result]:
    """Reject or distrust what looks good by itself and is contradicted by the run's other photographs."""
    outcomes = [result.outcome for result in results]
    samples = {k: result.sample for k, result in enumerate(results) if result.sample is not None}
    for stage in (checks.RunEvidence, checks.CourseEvidence):
        for check in checks.CHECKS[stage].values():
            # Each check sees what the ones before it have left: who is rejected or not trusted is no witness.
            run = witness.Run(_outlines(outcomes), samples)
            for k, outline in run.outlines.items():
                if doubt := next(check(stage(run, k)), None):
                    rejected = Refusal(str(doubt), results[k].photograph.file)
                    reasons = (*outline.reasons, str(doubt))
                    doubted = dataclasses.replace(outline, trusted=False, reasons=reasons)
                    outcomes[k] = rejected if doubt.rejects and not outline.anyway else doubted
        if stage is checks.RunEvidence:
            run = witness.Run(_outlines(outcomes))
            for k, off in run.unknown.items():
                outcomes[k] = dataclasses.replace(run.outlines[k], error=np.hypot(run.outlines[k].error, off))
    return [
        result if outcome is result.outcome else dataclasses.replace(result, outcome=outcome)
        for result, outcome in zip(results, outcomes, strict=True)
    ]


def _outlines(outcomes: Sequence[Outline | Refusal]) -> dict[int, Outline]:
    return {k: outcome for k, outcome in enumerate(outcomes) if isinstance(outcome, Outline)}


def unexpected_error(error: Exception) -> str:
    """Return the reason of a refusal after an error that no check expects."""
    words = " ".join(str(error).split())  # OpenCV's own have several lines
    return f"it led to an unforeseen failure ({type(error).__name__}: {words})"


def measured_beside(task: tuple[Any, ...]) -> Result:
    """Return a photograph's result in one of several processes; the task is every check by stage and name, also those that a
    user's program has registered, and what `_measure_one` takes."""
    cv2.setNumThreads(1)  # the processes share the cores already
    known, *arguments = task
    for stage, registered in known.items():
        checks.CHECKS[stage].update(registered)
    return _measure_one(*arguments)


def _measure_one(photo: Photograph, name: str, setup: Setup, zero: ZeroLine, tone: str, pictures: Path | None) -> Result:
    image, traced, sample = None, None, None
    outcome: Outline | Refusal
    try:
        image = read_pixels(photo.file, setup.camera.size)
        sample = photo_list.cut_out(image)
        traced = trace_image(image, setup, tone, zero.tone, photo.anyway)
        outcome = outline_of(traced, zero, photo.pressure, photo.pressure_error, photo.file.name)
        outcome = dataclasses.replace(outcome, history=photo.history)
    except Unmeasurable as error:
        outcome = Refusal(str(error), photo.file)
    except Exception as error:  # one odd photograph must not take the others with it
        outcome = Refusal(unexpected_error(error), photo.file)
    if pictures is not None and image is not None:
        drawing.draw_edge(pictures / f"{name}.png", image, setup, traced, outcome, photo.pressure)
    return Result(photo, outcome, name, sample)


RESERVED_NAMES = ("heights", "profiles", "steps", "animation", "overview")
"""Stems of what a run writes beside its outlines: a photograph of such a name must not take the table's place."""


def file_stems(photographs: Sequence[Photograph]) -> list[str]:
    """Return a stem per photograph; the whole file name where two would share one, also where capitals do not count."""
    stems = [photo.file.stem.casefold() for photo in photographs]
    names: list[str] = []
    for photo, stem in zip(photographs, stems, strict=True):
        name = photo.file.stem if stems.count(stem) == 1 else photo.file.name.replace(".", "_")
        if not name.strip("."):
            name = f"_{name}"
        while name.casefold() in (*RESERVED_NAMES, *(other.casefold() for other in names)):
            name += "_"
        names.append(name)
    return names


# ----------------------------------------------------------------------------------------------------------------------
# Outlines from a list of photographs, as one call: the zero plane, the shadow's size, every photograph, and their tables.


HEIGHT_COLUMNS = ("file", "pressure_Pa", "pressure_error_Pa", "height_m", "height_error_m", "trusted", "remarks")


class MeasuringOptions(TypedDict, total=False):
    """Settings of a measurement.

    Attributes:
        tone: How the files store light: ``"auto"``, ``"srgb"`` as a camera's JPEG, or ``"linear"``.
        width: True width of the body in m and its standard error, where the photographs show its sides: it gives the
            shadow's magnification.
        jobs: Processes at a time; only one where a check of the script itself is registered, which the others cannot import.
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
            result.photograph.file.name: result.outcome.reason for result in self.results if isinstance(result.outcome, Refusal)
        }

    def write(self, folder: Path) -> None:
        """Write ``heights.csv`` and a table of each outline into a folder.

        Raises:
            OSError: They cannot be written.
        """
        write_results(self.results, folder)


def write_results(results: Sequence[Result], folder: Path) -> None:
    """Write ``heights.csv`` and a table of each outline into a folder; `OSError` where they cannot be written."""
    with (folder / "heights.csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(HEIGHT_COLUMNS)
        for result in results:
            rows.writerow(_row(result))
    for result in results:
        if isinstance(result.outcome, Outline):
            result.outcome.to_csv(folder / f"{result.name}.csv")


NO_RISE = "without a photograph at zero pressure its height counts from the base, and is no rise"


def _row(result: Result) -> tuple[str, ...]:
    photo, outcome = result.photograph, result.outcome
    first = (photo.file.name, repr(photo.pressure), repr(photo.pressure_error))
    if isinstance(outcome, Refusal):
        return (*first, "", "", "refused", outcome.reason)
    if outcome.whole == "base":  # such a height would be taken for a rise
        return (*first, "", "", outcome.trust, "; ".join((*outcome.reasons, NO_RISE)))
    return (*first, f"{outcome.height:.9g}", f"{outcome.height_error:.4g}", outcome.trust, "; ".join(outcome.reasons))


def with_zero(
    photographs: Sequence[Photograph], setup: Setup, tone: str, width: tuple[float, float] | None
) -> tuple[Setup, ZeroLine]:
    """Return the setup, with the magnification from a body's width, and the undeformed surface. Errors as of `outlines`."""
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
        setup: Camera and screen, or the file ``setup.toml`` that ``softmodels measure setup`` writes.
        column: The water column that the list's lengths were read from.
        how: See `MeasuringOptions`.

    Returns:
        The outlines, and the reasons for rejected photographs.

    Raises:
        PhotoListError: The list cannot be read.
        SetupError: The setup cannot be used, or the body's width does not go with what the photographs show.
        NoZero: No photograph, and nothing in the setup, shows the undeformed surface.
    """
    listed = photo_list.read_photos(Path(photos), column) if isinstance(photos, str | Path) else photos
    known = Setup.from_file(setup) if isinstance(setup, str | Path) else setup
    tone, jobs, edges = how.get("tone", AUTO), how.get("jobs", 1), how.get("edges")
    known, zero = with_zero(listed, known, tone, how.get("width"))
    results = measure_all(listed, known, zero, tone, jobs, edges, how.get("done", lambda result: None))
    return Measurement(tuple(results), known, zero)
