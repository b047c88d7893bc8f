"""Pictures of a whole run: all profiles (the thesis' Fig. 3), height over pressure, an animation, and the overview page.

Figures are made without pyplot, so that nothing global is touched and no display is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from PIL import Image

from measurement.outline.outline import Outline
from measurement.series.measuring import Result
from measurement.series.photo import Refusal
from measurement.series.witness import course_of
from softmodels.common.files import image_uri, render
from softmodels.common.processes import plain

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
    pictures = [(title, image_uri(folder / name)) for name, title in titles if (folder / name).is_file()]
    edges = [(result.photograph.file.name, folder / "edges" / f"{result.name}.png") for result in results]
    photos = [(name, image_uri(file)) for name, file in edges if file.is_file()]
    rows = [_row(result) for result in results]
    page = render("overview.html", title=TITLE, summary=summary, rows=rows, pictures=pictures, photos=photos)
    path.write_text(page, encoding="utf-8")


def _row(result: Result) -> dict[str, str]:
    """Return a photograph's row of the table."""
    photo, outcome = result.photograph, result.outcome
    row = {"name": photo.file.name, "pressure": f"{photo.pressure:.1f} ± {photo.pressure_error:.1f}"}
    if isinstance(outcome, Refusal):
        return {**row, "kind": "refused", "height": "", "points": "", "remark": f"refused: {outcome.reason}"}
    height = f"{outcome.height * 1e3:.4f} ± {outcome.height_error * 1e3:.4f}"
    remark = "; ".join(outcome.reasons) or "trusted"
    kind = "" if outcome.trusted else "weak"
    return {**row, "kind": kind, "height": height, "points": str(np.size(outcome.x)), "remark": remark}
