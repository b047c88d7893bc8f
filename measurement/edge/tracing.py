"""From one photograph to the shadow's edge on the screen, with every check that needs no zero plane."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from measurement.camera.pictures import (
    TONES,
    Pixels,
    Unmeasurable,
    read_photograph,
)
from measurement.edge.edge import (
    BridgedLine,
    Edge,
    check_blur,
    check_light,
    check_steps,
    coarse_contour,
    refine_edge,
    smoothed,
)
from measurement.edge.profiles import Ink, Shading
from measurement.edge.shadow import (
    CoarseShadow,
    check_exposure,
    find_shadow,
    touched_by_thread,
)
from measurement.screen.look import (
    View,
    check_movement,
    flatness,
    look_at_grid,
    pieces_of,
)
from measurement.screen.setup import Setup
from softmodels.common.arrays import Array

COARSE = 640
"""Longer side in px of the small version in which the shadow is found."""

WIDEST_LINE = 0.1
"""Greatest width of a grid line in pitches that is distinguished from a shadow."""

NOISIEST = 50e-6
"""Greatest median standard error in m of the points of an edge."""

FEWEST_POINTS = 40

AUTO = "auto"
DECISIVE = 12.0
"""Difference of the tones' chi-squares from which the edge's shape shows which is right; a chance of 1 in 400 that it errs."""

WRONG = 3.5
"""Misfit of the edge's shape (`edge.profiles`) from which no tone is known to be right."""

LARGEST_TONE = 0.2
"""Departure e of the light from the tone curve beyond which it is no camera's."""

TONE_SHIFT, TONE_HARM = 0.4, 5e-6
"""Shift of the edge by a wrong tone in widths of the edge, and the shift in m that would do no harm."""

LONGEST_BRIDGE = 10e-3
"""Length in m of the longest gap in an edge that is bridged, so that it can be shown; its points are no measured ones."""


@dataclasses.dataclass(frozen=True, eq=False)
class Traced:
    """The edge of a shadow on the screen.

    Attributes:
        edge: The edge as it was found, in px.
        px: The smoothed edge in px, shape (n, 2).
        error_px: Standard error of the smoothed edge in px, shape (n,).
        points: The smoothed edge in m, shape (n, 2).
        normals: Unit vectors across it on the screen, from shadow to light, shape (n, 2).
        screen_error: Standard error of the points by the screen's own shape in m, shape (n,).
        bridged: Which points lie in a gap of the edge, where nothing was measured, shape (n,).
        rim: Places in m where the shadow meets the frame or the region of interest, shape (m, 2).
        moved: Movement in m of the screen's picture since the setup; NaN where there is no grid.
        scale: Length in m of a pixel in the middle.
        coarse: The shadow in the small version.
        roi: Region x0, y0, x1, y1 in px that was looked at.
        tone: How the file stores light.
        shift_error: Standard error in m of the half light's place, which all points share; part of ``error_px`` too.
        model_error: The same by the model of the edge's shape, which all photographs of a run share; no part of ``error_px``.
        doubts: What speaks against trusting it, one sentence each.
    """

    edge: Edge
    px: Array
    error_px: Array
    points: Array
    normals: Array
    screen_error: Array
    bridged: npt.NDArray[np.bool_]
    rim: Array
    moved: float
    scale: float
    coarse: CoarseShadow
    roi: tuple[int, int, int, int]
    tone: str
    shift_error: float = 0.0
    model_error: float = 0.0
    doubts: tuple[str, ...] = ()


def trace(file: Path, setup: Setup, tone: str = AUTO, likely: str = "") -> Traced:
    """Find the edge of the shadow in a photograph.

    Args:
        file: The photograph.
        setup: Camera and screen.
        tone: How the file stores light, one of `pixels.TONES`, or ``"auto"``.
        likely: The tone of other photographs of the run, for an edge that lies on the grid's ink and does not tell its own.

    Raises:
        Unmeasurable: The photograph must not be measured; the message is the reason.
    """
    return trace_image(read_photograph(file, (setup.camera.width, setup.camera.height)), setup, tone, likely)


def trace_image(image: Pixels, setup: Setup, tone: str = AUTO, likely: str = "") -> Traced:
    """Return `trace` of a picture (h, w, 3) that has been read already; ``likely`` is the tone of the run's other photographs.

    A penumbra is symmetric in light, and no longer so in numbers of another scale: half of the light lies elsewhere then,
    by up to half of the penumbra's width. A shape with a free departure from the tone curve follows even a wrong one to some
    extent, so all tones are tried, and the one with the least chi-square is taken if it is decisively less.
    """
    if tone != AUTO:
        return _trace(image, setup, tone)
    names = sorted(TONES, key=lambda name: name != (likely or "srgb"))
    first = _trace(image, setup, names[0])
    # Where a shape fits this well, no other tone can be decisively better.
    fits = first.edge.shape.chi_square < DECISIVE
    if likely and fits:
        return first
    try:
        second = _trace(image, setup, names[1])
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
    doubt = (
        f"the shape of the penumbra does not show how the file stores light; edges may be {moved * 1e6:.0f} um off: give "
        "--tone srgb for a camera's JPEG, --tone linear for numbers in proportion to the light"
    )
    return dataclasses.replace(best, doubts=(*best.doubts, doubt))


def _trace(image: Pixels, setup: Setup, tone: str) -> Traced:
    view = View(image, setup, _region(image, setup), TONES[tone])
    x0, y0, x1, y1 = view.roi
    factor = max(1.0, view.size.max() / COARSE)
    size = (max(8, round((x1 - x0) / factor)), max(8, round((y1 - y0) / factor)))
    small = view.light[cv2.resize(image[y0:y1, x0:x1], size, interpolation=cv2.INTER_AREA)]
    pixel = view.pixel
    line_px = 0.0
    if setup.grid_pitch is not None:
        line_px = WIDEST_LINE * (setup.grid_pitch / setup.magnification / pixel / factor)
    known = None if setup.shadow_colour is None else view.light[np.rint(np.array(setup.shadow_colour)).astype(int)]
    check_exposure(small)
    coarse = find_shadow(small, line_px, known)
    moved, look, ink = np.nan, None, None
    if setup.grid_pitch is not None:
        look = look_at_grid(view, setup.grid_pitch, _well_inside(~coarse.dark))
        moved = check_movement(look, setup.magnification, pixel)
        ink = Ink.of(look, setup, view.roi)
    shading = Shading(image, coarse.colour, ink, None if ink is None else ink.drawn, view.light)
    edge = refine_edge(shading, coarse_contour(coarse.mask, coarse.share, factor, (x0, y0)), factor)
    edge = edge[view.inside(edge.px)]
    if len(edge.px) < FEWEST_POINTS:
        raise Unmeasurable(
            f"only {len(edge.px)} points of the edge are clear enough; at least {FEWEST_POINTS} are needed: photograph "
            "it again with more light and contrast, and with no grid line along the surface"
        )
    check_light(edge, view)
    doubts = [*check_steps(edge, coarse.colour), check_blur(edge, pixel)]
    pixels = np.moveaxis(np.indices(coarse.mask.shape)[::-1], 0, -1)
    through = np.ones(coarse.mask.shape) if ink is None else ink((pixels + 0.5) * factor - 0.5 + [x0, y0])
    if touched_by_thread(small, coarse, through, line_px, pixel * factor):
        doubts.append("a thin dark thing (hair, thread, tube, a speck) touches the shadow")
    line = smoothed(edge, LONGEST_BRIDGE / pixel)
    # Where the half light lies in the edge's shape is not known any better than this, along all of the edge.
    width = float(np.median(edge.width))
    shift = edge.shape.shift_error * width
    line = dataclasses.replace(line, error=np.hypot(line.error, shift))
    points, normals = _on_screen(line, setup)
    screen_error = np.zeros(len(points))
    if look is not None:
        looks = [
            look_at_grid(view, look.pitch, _well_inside(part), look.line_reach) for part in (~coarse.dark, coarse.mask)
        ]
        error, doubt = flatness(pieces_of(looks), points * setup.magnification)
        screen_error = error / setup.magnification
        doubts.append(doubt)
    return Traced(
        edge,
        line.px,
        line.error,
        points,
        normals,
        screen_error,
        line.bridged,
        _rim(coarse.mask, view),
        moved,
        pixel,
        coarse,
        view.roi,
        tone,
        shift * pixel,
        edge.shape.model_error * width * pixel,
        tuple(doubt for doubt in doubts if doubt is not None),
    )


def _region(image: Pixels, setup: Setup) -> tuple[int, int, int, int]:
    height, width = image.shape[:2]
    if (width, height) != (setup.camera.width, setup.camera.height):
        raise Unmeasurable(
            f"it has {width} x {height} pixels where the setup has {setup.camera.width} x {setup.camera.height}; "
            "photograph both with the same settings, uncropped"
        )
    x0, y0, x1, y1 = (0, 0, width, height) if setup.roi is None else (round(value) for value in setup.roi)
    if min(x1 - x0, y1 - y0) < 64:
        raise Unmeasurable("the region of interest is smaller than 64 pixels; give setup --roi a larger one")
    return x0, y0, x1, y1


def _well_inside(part: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Return a part (h, w) of the small version without its rim."""
    return np.asarray(cv2.erode(part.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0)


def _on_screen(line: BridgedLine, setup: Setup) -> tuple[Array, Array]:
    """Return the points (n, 2) of a smoothed edge in m, and unit vectors (n, 2) across it on the screen.

    Raises:
        Unmeasurable: It lies where the lens is not known, or is too noisy.
    """
    points = setup.to_metres(line.px)
    if not np.isfinite(points).all():
        raise Unmeasurable(
            "the shadow lies where the lens correction is not defined; calibrate with boards up to the picture's "
            "corners, or aim the camera at the shadow"
        )
    slope = setup.jacobian(line.px)
    normals = np.linalg.solve(np.swapaxes(slope, 1, 2), line.normal[..., None])[..., 0]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    typical = float(np.median(setup.error(line.px, line.error, normals)[~line.bridged]))
    if typical > NOISIEST:
        raise Unmeasurable(
            f"the edge is too noisy: its points have a standard error of {typical * 1e6:.0f} um; photograph it again "
            "with more light, a lower sensitivity (ISO) or less compression"
        )
    return points, normals


def _rim(mask: npt.NDArray[np.bool_], view: View) -> Array:
    """Return the places in m of the region's rim that lie in the shadow."""
    rim = np.zeros_like(mask)
    rim[[0, -1], :] = mask[[0, -1], :]
    rim[:, [0, -1]] = mask[:, [0, -1]]
    rows, columns = np.nonzero(rim)
    places = view.setup.to_metres(view.enlarged(np.column_stack([columns, rows]), mask.shape))
    return places[np.isfinite(places).all(axis=1)]
