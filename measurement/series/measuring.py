"""Measure all photographs of a list: the zero plane first, then every one, in processes of their own; pictures of the run."""

from __future__ import annotations

import concurrent.futures
import contextlib
import csv
import dataclasses
import multiprocessing
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypedDict, Unpack

import cv2
import numpy as np

from measurement.outline.edge import Traced
from measurement.outline.outline import Outline
from measurement.outline.zero import ZeroLine, with_known_body
from measurement.pictures import Pixels, Unmeasurable, read_photograph
from measurement.screen.setup import Setup
from measurement.series.checks import CHECKS, COURSE, LIST, RUN, Check, Evidence, answers
from measurement.series.photo import AUTO, Refusal, draw_edge, find_zero, outline_of, trace, trace_image
from measurement.series.photo_list import Column, Photograph, cut_out, read_photos
from measurement.series.witness import Run, course_of
from softmodels.common.files import image_uri, read_text
from softmodels.common.pages import Cell, Fact, Gallery, Page, Picture, Provenance, Table
from softmodels.common.processes import plain
from softmodels.common.units import pascal_per_cm

MOST_ASKED = 4
"""Raised photographs that are asked for what the camera does to an edge."""


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
            reasons.append(f"{photo.file.name}: {_unforeseen(error)}")
    if doubted:
        return doubted[0]
    raise NoZero(f"no photograph at zero pressure shows the undeformed surface; {'; '.join(reasons)}")


def clear_edge(photographs: Sequence[Photograph], setup: Setup, tone: str = AUTO) -> Traced | None:
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
    listed = Run(rows=photographs)
    same = {
        photo.file: str(doubt)
        for k, photo in enumerate(photographs)
        for doubt in answers(LIST, Evidence(run=listed, number=k))
    }
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
        known = {stage: checks.loaded for stage, checks in CHECKS.items()}
        with concurrent.futures.ProcessPoolExecutor(min(jobs, len(work)), context, _alone, (known,)) as pool:
            for future in concurrent.futures.as_completed([pool.submit(_measure_one, *task) for task in work]):
                result = future.result()
                results[result.name] = result
                done(result)
    before = [results[name] for name in names]
    after = judged(before)
    for k, result in enumerate(after):
        if pictures is not None and result is not before[k]:
            _draw_again(result, setup, zero, tone, pictures)
    return after


def judged(results: Sequence[Result]) -> list[Result]:
    """Reject or distrust what looks good by itself and is contradicted by the run's other photographs."""
    outcomes = [result.outcome for result in results]
    samples = {k: result.sample for k, result in enumerate(results) if result.sample is not None}
    for stage in (RUN, COURSE):
        for check in CHECKS[stage].values():
            # Each check sees what the ones before it have left: who is rejected or not trusted is no witness.
            run = Run(_outlines(outcomes), samples)
            for k, outline in run.outlines.items():
                if doubt := next(check(Evidence(run=run, number=k)), None):
                    rejected = Refusal(str(doubt), results[k].photograph.file)
                    reasons = (*outline.reasons, str(doubt))
                    doubted = dataclasses.replace(outline, trusted=False, reasons=reasons)
                    outcomes[k] = rejected if doubt.rejects and not outline.anyway else doubted
        if stage == RUN:
            run = Run(_outlines(outcomes))
            for k, off in run.unknown.items():
                outcomes[k] = dataclasses.replace(run.outlines[k], error=np.hypot(run.outlines[k].error, off))
    return [
        result if outcome is result.outcome else dataclasses.replace(result, outcome=outcome)
        for result, outcome in zip(results, outcomes, strict=True)
    ]


def _outlines(outcomes: Sequence[Outline | Refusal]) -> dict[int, Outline]:
    return {k: outcome for k, outcome in enumerate(outcomes) if isinstance(outcome, Outline)}


def _draw_again(result: Result, setup: Setup, zero: ZeroLine, tone: str, pictures: Path) -> None:
    with contextlib.suppress(Unmeasurable):  # it could be read a moment ago; what is drawn already stays
        image = read_photograph(result.photograph.file, (setup.camera.width, setup.camera.height))
        traced = trace_image(image, setup, tone, zero.tone, result.photograph.anyway)
        draw_edge(pictures / f"{result.name}.png", image, setup, traced, result.outcome, result.photograph.pressure)


def _unforeseen(error: Exception) -> str:
    words = " ".join(str(error).split())  # OpenCV's own have several lines
    return f"it led to an unforeseen failure ({type(error).__name__}: {words})"


def _alone(known: dict[str, dict[str, Check]]) -> None:
    cv2.setNumThreads(1)  # the processes share the cores already
    for stage, checks in known.items():
        CHECKS[stage].update(checks)  # also those that a user's program has registered


def _measure_one(
    photo: Photograph, name: str, setup: Setup, zero: ZeroLine, tone: str, pictures: Path | None
) -> Result:
    image, traced, sample = None, None, None
    outcome: Outline | Refusal
    try:
        image = read_photograph(photo.file, (setup.camera.width, setup.camera.height))
        sample = cut_out(image)
        traced = trace_image(image, setup, tone, zero.tone, photo.anyway)
        outcome = outline_of(traced, zero, photo.pressure, photo.pressure_error, photo.file.name)
        outcome = dataclasses.replace(outcome, history=photo.history)
    except Unmeasurable as error:
        outcome = Refusal(str(error), photo.file)
    except Exception as error:  # one odd photograph must not take the others with it
        outcome = Refusal(_unforeseen(error), photo.file)
    if pictures is not None and image is not None:
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
    return (*first, f"{outcome.height:.9g}", f"{outcome.height_error:.4g}", outcome.trust, "; ".join(outcome.reasons))


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


# ----------------------------------------------------------------------------------------------------------------------
# Pictures of a whole run: all profiles (the thesis' Fig. 3), height over pressure, an animation, and the overview page.
#
# Figures are made without pyplot, so that nothing global is touched and no display is asked for.


FRAME = 640
"""Width in px of the animation."""

COURSE_POINTS = 200
"""Heights at which the course through a run is drawn."""

MOST_NAMED = 8
"""Untrusted photographs that are named in a picture; more are in the table."""

TITLE = "Outlines from shadows"
"""Of the page."""

FRAME_TIME = 500
"""Milliseconds per picture of the animation."""


def draw_profiles(path: Path, outlines: Sequence[Outline]) -> None:
    """Write all outlines in one picture, coloured by pressure."""
    import matplotlib
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    span = max(float(np.ptp(np.concatenate([outline.x for outline in outlines]))), 1e-3)
    rise = max(float(np.ptp(np.concatenate([outline.z for outline in outlines]))), 0.1 * span)
    figure = Figure(figsize=(10.0, min(8.0, 1.6 + 7.6 * 1.1 * rise / span)), dpi=140, layout="constrained")
    axes = figure.subplots()
    pressures = [outline.pressure / 1e3 for outline in outlines]
    norm = Normalize(min(pressures), max(pressures) if max(pressures) > min(pressures) else min(pressures) + 1.0)
    colours = matplotlib.colormaps["viridis"]
    for outline in outlines:
        colour = colours(norm(outline.pressure / 1e3))
        axes.fill_between(
            outline.x * 1e3, (outline.z - 2 * outline.error) * 1e3, (outline.z + 2 * outline.error) * 1e3,
            color=colour, alpha=0.3, linewidth=0.0,
        )  # fmt: skip
        # A gap stays open; only its band shows how far the outline may lie off there.
        seen = np.where(outline.bridged, np.nan, outline.z) * 1e3
        axes.plot(outline.x * 1e3, seen, color=colour, linewidth=1.6, linestyle="-" if outline.trusted else ":")
    axes.set_aspect("equal")
    axes.set_xlabel("along the surface in mm")
    axes.set_ylabel("above the surface in mm")
    weak = "" if all(outline.trusted for outline in outlines) else "; dotted: untrusted"
    axes.set_title(f"Outlines at {len(outlines)} pressures{weak}")
    axes.grid(alpha=0.3)
    figure.colorbar(ScalarMappable(norm, colours), ax=axes, label="pressure in kPa")
    figure.savefig(path, bbox_inches="tight")  # equal scales leave the label outside otherwise


def draw_heights(path: Path, outlines: Sequence[Outline]) -> None:
    """Write the height over the pressure with both standard errors, doubled, and the course through the trusted ones.

    Photographs that are not trusted are named, so that the one that lies off the course is found in the table.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 5.0), dpi=140, layout="constrained")
    axes = figure.subplots()
    course = course_of(list(outlines))
    if course is not None:
        heights = np.linspace(min(0.0, float(course.heights.min())), float(course.heights.max()), COURSE_POINTS)
        expected, spread, _ = course.at(heights)
        band = axes.fill_betweenx(
            heights * 1e3, (expected - 2 * spread) / 1e3, (expected + 2 * spread) / 1e3, color="#d9e2ec", linewidth=0.0
        )
        band.set_label("smooth curve through the trusted ones")
    for trusted, marker, label in ((True, "o", "measured"), (False, "x", "not trusted")):
        chosen = [outline for outline in outlines if outline.trusted == trusted]
        if chosen:
            axes.errorbar(
                [outline.pressure / 1e3 for outline in chosen], [outline.height * 1e3 for outline in chosen],
                xerr=[2e-3 * outline.pressure_error for outline in chosen],
                yerr=[2e3 * outline.height_error for outline in chosen],
                fmt=marker, color="#2f6f9f" if trusted else "#c0392b", capsize=3.0, label=label,
            )  # fmt: skip
    middle = 0.5 * sum(axes.get_xlim())
    for outline in [outline for outline in outlines if not outline.trusted][:MOST_NAMED]:
        right = outline.pressure / 1e3 > middle  # there a name beside the point would leave the picture
        axes.annotate(
            plain(outline.source), (outline.pressure / 1e3, outline.height * 1e3), fontsize=8, va="top",
            xytext=(-6 if right else 6, -4), textcoords="offset points", ha="right" if right else "left", color="#c0392b",
        )  # fmt: skip
    axes.set_xlabel("pressure in kPa")
    axes.set_ylabel("height in mm")
    axes.set_title("Height over pressure, bars and band of two standard errors")
    axes.grid(alpha=0.3)
    axes.set_axisbelow(True)
    if course is not None or not all(outline.trusted for outline in outlines):
        axes.legend()
    figure.savefig(path)


def animate(path: Path, pictures: Sequence[Path]) -> None:
    """Write the photographs' pictures one after the other as a GIF."""
    from PIL import Image

    frames = []
    for file in pictures:
        with Image.open(file) as picture:
            size = (FRAME, round(picture.height * FRAME / picture.width))
            frames.append(picture.convert("RGB").resize(size, Image.Resampling.LANCZOS).quantize(128))
    if frames:
        frames[0].save(path, save_all=True, append_images=frames[1:], duration=FRAME_TIME, loop=0)


def write_overview(path: Path, results: Sequence[Result], folder: Path) -> None:
    """Write one page with the table, the pictures of the run and of every photograph, all inside of it.

    Args:
        path: HTML file to write.
        results: What became of every photograph.
        folder: Where the run's pictures lie.
    """
    good = sum(isinstance(result.outcome, Outline) for result in results)
    weak = sum(isinstance(result.outcome, Outline) and not result.outcome.trusted for result in results)
    parts = [f"{good} of {len(results)} photographs measured"]
    parts += [f"{weak} of them untrusted"] if weak else []
    parts += [f"{len(results) - good} refused"] if good < len(results) else []
    summary = ", ".join(parts) + "."
    titles = (
        ("profiles.png", "All outlines"),
        ("heights.png", "Height over pressure"),
        ("steps.png", "The steps of one photograph"),
        ("animation.gif", "Animation"),
    )
    pictures = [Picture(image_uri(folder / name), title) for name, title in titles if (folder / name).is_file()]
    edges = [(result.photograph.file.name, folder / "edges" / f"{result.name}.png") for result in results]
    photos = [Picture(image_uri(file), name) for name, file in edges if file.is_file()]
    rows = [_overview_row(result) for result in results]
    outlines, table = [r.outcome for r in results if isinstance(r.outcome, Outline)], folder / "heights.csv"
    pressures = [Cell(f"{name} (kPa)", unit="kPa") for name in ("pressure", "its error")]
    head: tuple[str | Cell, ...] = ("photograph", *pressures, "height (mm)", "points", "remarks")
    page = Page(
        TITLE, summary,
        [
            ("Heights", pictures[:2]),
            ("Photographs", [Table([row for _, row in rows], head, marks=[mark for mark, _ in rows])]),
            ("Steps", pictures[2:]),
            ("The edge in every photograph", [Gallery(photos)]),
        ],
        Provenance.now(), _facts(outlines),
        _warnings(results), downloads={table.name: read_text(table)} if table.is_file() else {}, unit="kPa",
    )  # fmt: skip
    path.write_text(page.html(), encoding="utf-8")


def _warnings(results: Sequence[Result]) -> list[str]:
    """Return which photographs were refused, each with its reason, and which are not trusted."""
    refused = [f"{r.photograph.file.name}: {_remark(r.outcome)}" for r in results if isinstance(r.outcome, Refusal)]
    weak = [r.photograph.file.name for r in results if isinstance(r.outcome, Outline) and not r.outcome.trusted]
    return [*refused, *([f"untrusted, for the reasons in the table: {', '.join(weak)}"] if weak else [])]


def _facts(outlines: Sequence[Outline]) -> list[Fact]:
    """Return the highest outline, in figures."""
    if not outlines:
        return []
    highest = max(outlines, key=lambda outline: outline.height)
    height, error = highest.height * 1e3, highest.height_error * 1e3
    column = f"{highest.pressure / pascal_per_cm():.4g} cm of water ({highest.pressure / 1e3:.4g} kPa)"
    at = f"at {column}, {highest.source}"
    return [Fact("Largest height", f"{height:.4f} ± {error:.4f} mm", at)]


def _overview_row(result: Result) -> tuple[str, list[str | Cell]]:
    """Return a photograph's row of the table, and what it is."""
    photo, outcome = result.photograph, result.outcome
    pressures = [Cell(f"{value / 1e3:.4f}", f"{value} Pa", value) for value in (photo.pressure, photo.pressure_error)]
    row: list[str | Cell] = [photo.file.name, *pressures]
    if isinstance(outcome, Refusal):
        return "refused", [*row, "", "", _remark(outcome)]
    height = f"{outcome.height * 1e3:.4f} ± {outcome.height_error * 1e3:.4f}"
    return "" if outcome.trusted else "weak", [*row, height, str(np.size(outcome.x)), _remark(outcome)]


def _remark(outcome: Outline | Refusal) -> str:
    """Return what is said of a photograph."""
    if isinstance(outcome, Refusal):
        return f"refused: {outcome.reason}"
    return "; ".join(outcome.reasons) or "trusted"
