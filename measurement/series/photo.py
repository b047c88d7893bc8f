"""Measure one photograph: its edge, the zero plane, an outline above it, or why it is rejected (`checks`); and draw it."""

from __future__ import annotations

import dataclasses
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import numpy.typing as npt

from measurement.outline.edge import Traced
from measurement.outline.outline import Outline, OutlineError
from measurement.outline.profiles import DECISIVE
from measurement.outline.zero import ZeroLine, sides_of
from measurement.pictures import TONES, Pixels, Unmeasurable, read_photograph
from measurement.screen.setup import Setup
from measurement.series.checks import EDGE, OUTLINE, TONE, ZERO, Evidence, doubts
from softmodels.common.arrays import Array
from softmodels.common.processes import plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes


AUTO = "auto"
WRONG = 3.5
"""Misfit of the edge's shape (`outline.profiles`) from which no tone is known to be right."""

LARGEST_TONE = 0.2
"""Departure e of the light from the tone curve beyond which it is no camera's."""

TONE_SHIFT, TONE_HARM = 0.4, 5e-6
"""Shift of the edge by a wrong tone in widths of the edge, and the shift in m that would do no harm."""


@dataclasses.dataclass(frozen=True)
class Refusal:
    """A photograph that was not measured.

    Attributes:
        reason: Why, as a sentence for the user.
        file: The photograph.
    """

    reason: str
    file: Path


def trace(file: Path, setup: Setup, tone: str = AUTO, likely: str = "", anyway: bool = False) -> Traced:
    """Find the edge of the shadow in a photograph.

    Args:
        file: The photograph.
        setup: Camera and screen.
        tone: How the file stores light, one of `pixels.TONES`, or ``"auto"``.
        likely: The tone of other photographs of the run, for an edge that lies on the grid's ink and does not tell its own.
        anyway: Whether it shall be used in spite of doubts.

    Raises:
        Unmeasurable: The photograph must not be measured; the message is the reason.
    """
    return trace_image(read_photograph(file, (setup.camera.width, setup.camera.height)), setup, tone, likely, anyway)


def trace_image(image: Pixels, setup: Setup, tone: str = AUTO, likely: str = "", anyway: bool = False) -> Traced:
    """Return `trace` of a picture (h, w, 3) that has been read already.

    A penumbra is symmetric in light, and no longer so in numbers of another scale: half of the light lies elsewhere then,
    by up to half of the penumbra's width. A shape with a free departure from the tone curve follows even a wrong one to some
    extent, so all tones are tried, and the one with the least chi-square is taken if it is decisively less.
    """
    if tone != AUTO:
        return _traced(image, setup, tone, anyway)
    names = sorted(TONES, key=lambda name: name != (likely or "srgb"))
    first = _traced(image, setup, names[0], anyway)
    # Where a shape fits this well, no other tone can be decisively better.
    fits = first.edge.shape.chi_square < DECISIVE
    if likely and fits:
        return first
    try:
        second = _traced(image, setup, names[1], anyway)
    except Unmeasurable:
        if fits:
            return first
        raise
    best, other = sorted((first, second), key=lambda traced: traced.edge.shape.chi_square)
    shape = best.edge.shape
    clear = shape.misfit < WRONG and abs(shape.tone) < LARGEST_TONE
    # A model that misses the profile by more than its error is no better evidence for missing another by as much more.
    evidence = (other.edge.shape.chi_square - shape.chi_square) / max(1.0, shape.misfit**2)
    moved = float(np.median(best.edge.width)) * best.scale * TONE_SHIFT
    if moved <= TONE_HARM or (clear and evidence >= DECISIVE):
        return best
    # Without evidence against it, not even a shape, a photograph has the tone of its series.
    if likely and not (first is other and evidence >= DECISIVE) and not first.edge.shape.misfit >= WRONG:
        return first
    best.tone_error = moved
    best.doubts += doubts(TONE, Evidence(best))
    return best


def _traced(image: Pixels, setup: Setup, tone: str, anyway: bool) -> Traced:
    traced = Traced(image, setup, tone, anyway=anyway)
    traced.doubts = doubts(EDGE, Evidence(traced))
    return traced


def find_zero(
    file: Path, setup: Setup, tone: str = AUTO, raised: Traced | None = None, anyway: bool = False
) -> ZeroLine:
    """Return the undeformed surface from the photograph at zero pressure.

    Args:
        file: The photograph.
        setup: Camera and screen.
        tone: As of `trace`.
        raised: A photograph of the raised body without doubts, which shows what the camera does to an edge.
        anyway: As of `trace`.

    Raises:
        Unmeasurable: The photograph cannot be measured, or shows no straight surface.
    """
    return zero_of(trace(file, setup, tone, anyway=anyway), raised)


def zero_of(traced: Traced, raised: Traced | None = None) -> ZeroLine:
    """Return `find_zero` of an edge that has been traced already."""
    hidden = 0.0
    if raised is not None:
        again = traced.of_level(raised)
        if again.lift and again.edge.shape.chi_square <= traced.edge.shape.chi_square - DECISIVE:
            again.tone_error, again.doubts = 0.0, doubts(EDGE, Evidence(again))
            traced = again
        elif raised.tone == traced.tone:
            hidden = again.edge.shape.hidden * again.width_px * again.scale
    errors = traced.own_error
    seen = ~traced.line.bridged
    line = ZeroLine.fit(traced.points[seen], traced.normals[seen], errors[seen])
    # The body's sides are not deep along the light: their edge is at their half light.
    placed, upwards = line.place(traced.points + traced.lift * traced.normals)[seen], traced.normals[seen] @ line.normal
    line = dataclasses.replace(
        line,
        error=float(np.hypot(line.error, traced.shift_error)),
        model_error=traced.model_error,
        tone=traced.tone,
        sides=sides_of(placed, upwards, errors[seen]),
    )
    evidence = Evidence(traced, line)
    level = float(np.hypot(hidden, 0.0 if evidence.bow is None else evidence.bow.level_error))
    found = (*traced.doubts, *doubts(ZERO, evidence))
    return dataclasses.replace(line, doubts=found, level_error=level, lift=traced.lift)


def outline_of(traced: Traced, zero: ZeroLine, pressure: float, pressure_error: float, source: str) -> Outline:
    """Return the outline above the surface.

    Raises:
        Unmeasurable: The visible outline is not that of an actuator on this surface.
    """
    e = Evidence(traced, zero)
    reasons = (*traced.doubts, *doubts(OUTLINE, e))
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
        )
    except OutlineError as problem:
        raise Unmeasurable(str(problem)) from None


# ----------------------------------------------------------------------------------------------------------------------
# Pictures of one photograph: its edge drawn over it, and the four steps from pixels to metres (the thesis' Fig. 2).


SHOWN = 1200
"""Longer side in px of a photograph in a picture."""

HEAD = 0.62
"""Room in inches for up to three lines above a photograph."""

EDGE_COLOUR, BRIDGE_COLOUR, REFUSED = "#ff2e63", "#ffd60a", "#c0392b"


def draw_edge(
    path: Path, image: Pixels, setup: Setup, traced: Traced | None, outcome: Outline | Refusal, pressure: float
) -> None:
    """Write a photograph with its edge, and with the reason if it was rejected.

    Args:
        path: PNG file to write.
        image: The photograph, shape (h, w, 3).
        setup: Camera and screen, for the region of interest.
        traced: Its edge; None if it has none.
        outcome: What became of it.
        pressure: Pressure in Pa, for the headline.
    """
    from matplotlib.figure import Figure

    small, factor = _reduced(image)
    height, width = small.shape[:2]
    figure = Figure(figsize=(8.0, 8.0 * height / width + HEAD), dpi=110)
    axes = figure.add_axes((0.0, 0.0, 1.0, (8.0 * height / width) / (8.0 * height / width + HEAD)))
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
        title = f"{pressure:.0f} Pa: height {outcome.height * 1e3:.3f} mm ± {outcome.height_error * 1e6:.1f} µm"
        title, colour = title + ("" if outcome.trusted else " (not trusted)"), "#102a43"
    name = outcome.file.name if isinstance(outcome, Refusal) else outcome.source
    figure.text(
        0.01, 1.0 - 0.08 / figure.get_figheight(), _wrapped(f"{name}   {title}"), color=colour, fontsize=10, va="top"
    )
    figure.savefig(path)


def draw_steps(path: Path, image: Pixels, setup: Setup, traced: Traced, outline: Outline) -> None:
    """Write the four steps: photograph, distance to the shadow's colour, edge in pixels, outline in millimetres."""
    from matplotlib.figure import Figure

    small, factor = _reduced(image)
    figure = Figure(figsize=(13.0, 7.0), dpi=110, layout="constrained")
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
        part.set_xlabel("x in px")
        part.set_ylabel("y in px")
        part.set_anchor("N")
        part.grid(False)
    below = last.subplots()
    below.fill_between(outline.x * 1e3, 0.0, outline.z * 1e3, color="#d9e2ec")
    below.plot(outline.x * 1e3, np.where(outline.bridged, np.nan, outline.z) * 1e3, color="#2f6f9f", linewidth=2.0)
    if outline.bridged.any():
        below.plot(
            outline.x * 1e3, np.where(outline.bridged, outline.z, np.nan) * 1e3, ":", color="#9a6700", linewidth=2.0
        )
    below.axhline(0.0, color="#829ab1", linewidth=1.0)
    below.set_aspect("equal")
    below.set_title(f"4. The outline, ± {np.median(outline.error) * 1e6:.1f} µm")
    below.set_xlabel("along the surface in mm")
    below.set_ylabel("height in mm")
    below.grid(alpha=0.3)
    figure.savefig(path)


def _draw_line(axes: Axes, traced: Traced, width: float) -> None:
    """The edge, dotted where it only bridges a gap."""
    if traced.line.bridged.any():
        axes.plot(*_parted(traced.line.px, traced.line.bridged).T, color=BRIDGE_COLOUR, linewidth=width, linestyle=":")
    axes.plot(*_parted(traced.line.px, ~traced.line.bridged).T, color=EDGE_COLOUR, linewidth=width)


def _parted(points: Array, shown: npt.NDArray[np.bool_]) -> Array:
    """Return the points (n, 2) with NaN instead of those that are not shown, and do not lie beside one that is."""
    beside = shown | np.r_[False, shown[:-1]] if not shown.all() else shown
    return np.where(beside[:, None], points, np.nan)


def _reduced(image: Pixels) -> tuple[Pixels, float]:
    factor = max(1.0, max(image.shape[:2]) / SHOWN)
    size = (round(image.shape[1] / factor), round(image.shape[0] / factor))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA)), factor


def _show(axes: Axes, small: Pixels, factor: float) -> None:
    """A reduced photograph in the pixels of the whole one."""
    height, width = small.shape[:2]
    axes.imshow(small, extent=(-0.5, width * factor - 0.5, height * factor - 0.5, -0.5), interpolation="bilinear")
    axes.set_xlim(-0.5, width * factor - 0.5)
    axes.set_ylim(height * factor - 0.5, -0.5)


def _wrapped(text: str, width: int = 105) -> str:
    return "\n".join(plain(line) for line in textwrap.wrap(text, width)[:3])
