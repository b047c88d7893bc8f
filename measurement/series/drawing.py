"""Pictures of a measurement: one photograph with its edge, its four steps (the thesis' Fig. 2); all profiles of a run (Fig. 3),
height over pressure, an animation, and the overview page.

Figures are made without pyplot, so that nothing global is touched and no display is asked for.
"""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from PIL import Image

from measurement import pictures
from measurement.outline import edge
from measurement.outline.outline import Outline
from measurement.screen.setup import Setup
from measurement.series import witness
from measurement.series.witness import Refusal, Result
from softmodels.common import commands, files, pages, processes, units
from softmodels.common.arrays import Array, Mask
from softmodels.common.lazy import cm, colors, figures, matplotlib
from softmodels.common.pages import Page

if TYPE_CHECKING:
    from matplotlib.axes import Axes


SHOWN_SIDE_PX = 1200
"""Longer side in px of a photograph in a picture."""

HEAD_INCHES = 0.62
"""Room in inches for up to three lines above a photograph."""

EDGE_COLOUR, BRIDGE_COLOUR, REFUSED = "#ff2e63", "#ffd60a", "#c0392b"


def draw_edge(
    path: Path, image: pictures.Pixels, setup: Setup, traced: edge.Traced | None, outcome: Outline | Refusal, pressure: float
) -> None:
    """Write a photograph (h, w, 3) with its edge, None if it has none, and with the reason if it was rejected; the
    pressure in Pa is for the headline."""
    small, factor = _reduced_photograph(image)
    height, width = small.shape[:2]
    figure = figures.Figure(figsize=(8.0, 8.0 * height / width + HEAD_INCHES), dpi=110)
    axes = figure.add_axes((0.0, 0.0, 1.0, (8.0 * height / width) / (8.0 * height / width + HEAD_INCHES)))
    _show(axes, small, factor)
    if traced is not None:
        _draw_line(axes, traced, 1.6)
    if setup.roi is not None:
        x0, y0, x1, y1 = setup.roi
        axes.plot([x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], color="white", linewidth=1.0, linestyle="--")
    axes.set_axis_off()
    if isinstance(outcome, Refusal):
        title, colour = f"refused: {outcome.reason}", REFUSED
    else:
        title = f"{pressure:z.0f} Pa: height {units.with_error(outcome.height * 1e3, outcome.height_error * 1e3, 'mm', '±')}"
        title, colour = title + ("" if outcome.trusted else " (not trusted)"), "#102a43"
    name = outcome.file.name if isinstance(outcome, Refusal) else outcome.source
    figure.text(
        0.01, 1.0 - 0.08 / figure.get_figheight(), _wrapped_text(f"{name}   {title}"), color=colour, fontsize=10, va="top"
    )
    figure.savefig(path)


def draw_view(path: Path, image: pictures.Pixels, lines: Sequence[Array], title: str, refused: bool) -> None:
    """Write a photograph (h, w, 3) with lines (n, 2) in px over it: the outline, then the centre line, then markers."""
    small, factor = _reduced_photograph(image)
    height, width = small.shape[:2]
    figure = figures.Figure(figsize=(8.0, 8.0 * height / width + HEAD_INCHES), dpi=110)
    axes = figure.add_axes((0.0, 0.0, 1.0, (8.0 * height / width) / (8.0 * height / width + HEAD_INCHES)))
    _show(axes, small, factor)
    for line, colour in zip(lines, itertools.chain((EDGE_COLOUR,), itertools.repeat(BRIDGE_COLOUR)), strict=False):
        axes.plot(*line.T, color=colour, linewidth=1.4)
    axes.set_axis_off()
    colour = REFUSED if refused else "#102a43"
    figure.text(0.01, 1.0 - 0.08 / figure.get_figheight(), _wrapped_text(title), color=colour, fontsize=10, va="top")
    figure.savefig(path)


def draw_steps(path: Path, image: pictures.Pixels, traced: edge.Traced, outline: Outline) -> None:
    """Write the four steps: photograph, distance to the shadow's colour, edge in pixels, outline in millimetres."""
    small, factor = _reduced_photograph(image)
    figure = figures.Figure(figsize=(13.0, 7.0), dpi=110, layout="constrained")
    halves = figure.add_gridspec(2, 1, height_ratios=(3.6, 3.4))
    pictures, last = figure.add_subfigure(halves[0]), figure.add_subfigure(halves[1])
    axes = pictures.subplots(1, 3)
    _show(axes[0], small, factor)
    axes[0].set_title("1. The photograph, never warped")
    x0, y0, x1, y1 = traced.view.roi
    shown = axes[1].imshow(
        np.clip(traced.coarse.share, -0.1, 1.1), cmap="magma", extent=(x0 - 0.5, x1 - 0.5, y1 - 0.5, y0 - 0.5)
    )
    axes[1].set_title("2. Mahalanobis distance to the shadow")
    pictures.colorbar(
        shown, ax=axes[1], location="bottom", fraction=0.07, pad=0.03, label="0 in the shadow, 1 on the lit screen"
    )
    _show(axes[2], small, factor)
    _draw_line(axes[2], traced, 1.5)
    axes[2].set_title(f"3. The edge in raw pixels, ± {np.median(traced.line.error):.2f} px")
    for part in axes:
        part.set(xlabel="x in px", ylabel="y in px", anchor="N")
        part.grid(False)
    below = last.subplots()
    below.fill_between(outline.x * 1e3, 0.0, outline.z * 1e3, color="#d9e2ec")
    below.plot(outline.x * 1e3, np.where(outline.bridged, np.nan, outline.z) * 1e3, color="#2f6f9f", linewidth=2.0)
    if outline.bridged.any():
        below.plot(outline.x * 1e3, np.where(outline.bridged, outline.z, np.nan) * 1e3, ":", color="#9a6700", linewidth=2.0)
    below.axhline(0.0, color="#829ab1", linewidth=1.0)
    title = f"4. The outline, ± {np.median(outline.error) * 1e6:.1f} µm"
    below.set(aspect="equal", title=title, xlabel="along the surface in mm", ylabel="height in mm")
    below.grid(alpha=0.3)
    figure.savefig(path)


def _draw_line(axes: Axes, traced: edge.Traced, width: float) -> None:
    """The edge, dotted where it only bridges a gap."""
    if traced.line.bridged.any():
        axes.plot(
            *_points_with_gaps(traced.line.px, traced.line.bridged).T, color=BRIDGE_COLOUR, linewidth=width, linestyle=":"
        )
    axes.plot(*_points_with_gaps(traced.line.px, ~traced.line.bridged).T, color=EDGE_COLOUR, linewidth=width)


def _points_with_gaps(points: Array, shown: Mask) -> Array:
    """Return the points (n, 2) with NaN instead of those that are not shown, and do not lie beside one that is."""
    beside = shown | np.r_[False, shown[:-1]] if not shown.all() else shown
    return np.where(beside[:, None], points, np.nan)


def _reduced_photograph(image: pictures.Pixels) -> tuple[pictures.Pixels, float]:
    factor = max(1.0, max(image.shape[:2]) / SHOWN_SIDE_PX)
    size = (round(image.shape[1] / factor), round(image.shape[0] / factor))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA)), factor


def _show(axes: Axes, small: pictures.Pixels, factor: float) -> None:
    """A reduced photograph in the pixels of the whole one."""
    height, width = small.shape[:2]
    axes.imshow(small, extent=(-0.5, width * factor - 0.5, height * factor - 0.5, -0.5), interpolation="bilinear")
    axes.set_xlim(-0.5, width * factor - 0.5)
    axes.set_ylim(height * factor - 0.5, -0.5)


def _wrapped_text(text: str, width: int = 105) -> str:
    return "\n".join(processes.plain(line) for line in textwrap.wrap(text, width)[:3])


FRAME_WIDTH_PX = 640

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
    span = max(float(np.ptp(np.concatenate([outline.x for outline in outlines]))), 1e-3)
    rise = max(float(np.ptp(np.concatenate([outline.z for outline in outlines]))), 0.1 * span)
    figure = figures.Figure(figsize=(10.0, min(8.0, 1.6 + 7.6 * 1.1 * rise / span)), dpi=140, layout="constrained")
    axes = figure.subplots()
    pressures = [outline.pressure / 1e3 for outline in outlines]
    norm = colors.Normalize(min(pressures), max(pressures) if max(pressures) > min(pressures) else min(pressures) + 1.0)
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
    weak = "" if all(outline.trusted for outline in outlines) else "; dotted: untrusted"
    title = f"Outlines at {len(outlines)} pressures{weak}"
    axes.set(aspect="equal", title=title, xlabel="along the surface in mm", ylabel="above the surface in mm")
    axes.grid(alpha=0.3)
    figure.colorbar(cm.ScalarMappable(norm, colours), ax=axes, label="pressure in kPa")
    figure.savefig(path, bbox_inches="tight")  # equal scales leave the label outside otherwise


def draw_heights(path: Path, outlines: Sequence[Outline]) -> None:
    """Write the height over the pressure with both standard errors, doubled, and the course through the trusted ones.
    Untrusted photographs are named, so that the one that lies off the course is found in the table."""
    figure = figures.Figure(figsize=(7.5, 5.0), dpi=140, layout="constrained")
    axes = figure.subplots()
    course = witness.course_of(list(outlines))
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
            processes.plain(outline.source), (outline.pressure / 1e3, outline.height * 1e3), fontsize=8, va="top",
            xytext=(-6 if right else 6, -4), textcoords="offset points", ha="right" if right else "left", color="#c0392b",
        )  # fmt: skip
    title = "Height over pressure, bars and band of two standard errors"
    axes.set(xlabel="pressure in kPa", ylabel="height in mm", title=title, axisbelow=True)
    axes.grid(alpha=0.3)
    if course is not None or not all(outline.trusted for outline in outlines):
        axes.legend()
    figure.savefig(path)


def animate(path: Path, pictures: Sequence[Path]) -> None:
    """Write the photographs' pictures one after the other as a GIF."""
    frames = []
    for file in pictures:
        with Image.open(file) as picture:
            size = (FRAME_WIDTH_PX, round(picture.height * FRAME_WIDTH_PX / picture.width))
            frames.append(picture.convert("RGB").resize(size, Image.Resampling.LANCZOS).quantize(128))
    if frames:
        frames[0].save(path, save_all=True, append_images=frames[1:], duration=FRAME_TIME, loop=0)


def write_film(path: Path, pictures: Sequence[Path], per_second: float) -> None:
    """Write pictures of one size one after the other as an MP4 film."""
    writer = None
    for file in pictures:
        image = cv2.imread(str(file))
        if image is None:
            continue
        size = image.shape[1] // 2 * 2, image.shape[0] // 2 * 2
        writer = writer or cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), per_second, size)
        writer.write(image[: size[1], : size[0]])
    if writer is not None:
        writer.release()


def write_overview(path: Path, results: Sequence[Result], folder: Path) -> None:
    """Write one HTML page with the table, the pictures of the run, which lie in the folder, and of every photograph, all
    inside of it."""
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
    pictures = [pages.Picture(files.image_uri(folder / name), title) for name, title in titles if (folder / name).is_file()]
    edges = [(result.photograph.file.name, folder / "edges" / f"{result.name}.png") for result in results]
    photos = [pages.Picture(files.image_uri(file), name) for name, file in edges if file.is_file()]
    rows = [_overview_row(result) for result in results]
    outlines, table = [r.outcome for r in results if isinstance(r.outcome, Outline)], folder / "heights.csv"
    pressures = [pages.Cell(f"{name} (kPa)", unit="kPa") for name in ("pressure", "its error")]
    head: tuple[str | pages.Cell, ...] = ("photograph", *pressures, "height (mm)", "points", "remarks")
    page = Page(
        TITLE, summary,
        [
            ("Heights", pictures[:2]),
            ("Photographs", [pages.Table([row for _, row in rows], head, marks=[mark for mark, _ in rows])]),
            ("Steps", pictures[2:]),
            ("The edge in every photograph", [pages.Gallery(photos)]),
        ],
        commands.Provenance.now(), _facts(outlines),
        _warnings(results), downloads={table.name: files.read_text(table)} if table.is_file() else {}, unit="kPa",
    )  # fmt: skip
    path.write_text(page.html(), encoding="utf-8")


def _warnings(results: Sequence[Result]) -> list[str]:
    """Return which photographs were refused, each with its reason, and which are not trusted."""
    refused = [f"{r.photograph.file.name}: {_remark(r.outcome)}" for r in results if isinstance(r.outcome, Refusal)]
    weak = [r.photograph.file.name for r in results if isinstance(r.outcome, Outline) and not r.outcome.trusted]
    return [*refused, *([f"untrusted, for the reasons in the table: {', '.join(weak)}"] if weak else [])]


def _facts(outlines: Sequence[Outline]) -> list[pages.Fact]:
    """Return the highest outline, in figures."""
    if not outlines:
        return []
    highest = max(outlines, key=lambda outline: outline.height)
    column = f"{highest.pressure / units.COLUMN.pascal:.4g} {units.COLUMN.unit} ({highest.pressure / 1e3:.4g} kPa)"
    at = f"at {column}, {highest.source}"
    height = units.with_error(highest.height * 1e3, highest.height_error * 1e3, "mm", "±")
    return [pages.Fact("Largest height", height, at)]


def _overview_row(result: Result) -> tuple[str, list[str | pages.Cell]]:
    """Return a photograph's row of the table, and what it is."""
    photo, outcome = result.photograph, result.outcome
    pressures = [pages.Cell(f"{value / 1e3:.4f}", f"{value} Pa", value) for value in (photo.pressure, photo.pressure_error)]
    row: list[str | pages.Cell] = [photo.file.name, *pressures]
    if isinstance(outcome, Refusal):
        return "refused", [*row, "", "", _remark(outcome)]
    height = " ± ".join(units.rounded(outcome.height * 1e3, outcome.height_error * 1e3))
    return "" if outcome.trusted else "weak", [*row, height, str(np.size(outcome.x)), _remark(outcome)]


def _remark(outcome: Outline | Refusal) -> str:
    if isinstance(outcome, Refusal):
        return f"refused: {outcome.reason}"
    return "; ".join(outcome.reasons) or "trusted"
