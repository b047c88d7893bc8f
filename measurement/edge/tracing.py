"""From one photograph to the shadow's edge on the screen, with every check that needs no zero plane."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from measurement.camera.pixels import TONES, Pixels, Unmeasurable, read_photograph, sample_light
from measurement.edge.blur import check_blur
from measurement.edge.bridging import smoothed
from measurement.edge.edge import Edge, coarse_contour, refine_edge
from measurement.edge.ink import Ink
from measurement.edge.shadow import CoarseShadow, ShadowColour, check_exposure, find_shadow
from measurement.edge.threads import touched_by_thread
from measurement.screen.flatness import flatness, pieces_of
from measurement.screen.grid_look import GridLook, look_at_grid
from measurement.screen.setup import Setup

Array = npt.NDArray[np.float64]

COARSE = 640
"""Longer side in px of the small version in which the shadow is found."""

WIDEST_LINE = 0.1
"""Greatest width of a grid line in pitches that is told from shadow."""

WIDEST_EDGE = 300e-6
"""Greatest standard deviation in m of penumbra and blur together; beyond, half of the light is no longer a place."""

MOVED = 15e-6
"""Movement of the screen's picture in m since the setup from which a photograph is refused, or `MOVED_PX` if that is more."""

MOVED_PX = 0.5
GRID_SEEN = 0.4
"""Least share of the grid's expected lines that must be visible."""

GRID_REST = 60e-6
"""Greatest scatter in m of the grid's lines about where they should be, or `GRID_REST_PX` if that is more."""

GRID_REST_PX = 1.5

BLANK = 0.985
"""Light of a channel from which it is taken as saturated."""

PART, MOST_PARTS = 0.7, 0.05
"""Share of the shadow's depth by which light must fall over its edge, and share of the edge where it may fall less."""

UNEVEN, PIECES = 0.08, 12
"""Change of the shadow's depth along its edge that one lamp does not make, over means of so many pieces of the edge."""

NOISIEST = 50e-6
"""Greatest median standard error in m of the points of an edge."""

FEWEST_POINTS = 40

AUTO = "auto"
SYMMETRIC, ASYMMETRIC = 1e-3, 6e-3
"""Misfit of the edge's mean profile up to which its tone is right for sure, and from which none is known to be right."""

TELLING = 1.5
"""Ratio of the misfits from which one tone is right and the other wrong."""

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
    """`trace` of a picture (h, w, 3) that has been read already; ``likely`` is its tone if its edge lies on ink.

    A penumbra is symmetric in light, and no longer so in numbers of another scale: half of the light lies elsewhere then,
    by up to half of the penumbra's width. So the tone is found as the one in which the edge's mean profile is symmetric.
    """
    if tone != AUTO:
        return _trace(image, setup, tone)
    first = _trace(image, setup, "srgb")
    if first.edge.shape_misfit <= SYMMETRIC:
        return first
    second = _trace(image, setup, "linear")
    found = {"srgb": first, "linear": second}
    best, other = sorted((first, second), key=lambda traced: np.nan_to_num(traced.edge.shape_misfit, nan=np.inf))
    moved = float(np.median(best.edge.width)) * best.scale * TONE_SHIFT
    if moved <= TONE_HARM or (
        best.edge.shape_misfit < ASYMMETRIC and other.edge.shape_misfit >= TELLING * best.edge.shape_misfit
    ):
        return best
    if likely in found and best.edge.on_ink:
        return found[likely]
    doubt = f"the shape of the penumbra does not tell how the file stores light; edges may be {moved * 1e6:.0f} um off"
    return dataclasses.replace(best, doubts=(*best.doubts, doubt))


def _trace(image: Pixels, setup: Setup, tone: str) -> Traced:
    light = TONES[tone]
    roi = _region(image, setup)
    x0, y0, x1, y1 = roi
    factor = max(1.0, max(x1 - x0, y1 - y0) / COARSE)
    size = (max(8, round((x1 - x0) / factor)), max(8, round((y1 - y0) / factor)))
    small = cv2.resize(image[y0:y1, x0:x1], size, interpolation=cv2.INTER_AREA)
    scale = _scale(setup, roi)
    pitch_px = 0.0 if setup.grid_pitch is None else setup.grid_pitch / setup.magnification / scale / factor
    known = None if setup.shadow_colour is None else light[np.rint(np.array(setup.shadow_colour)).astype(int)]
    check_exposure(light[small])
    coarse = find_shadow(light[small], WIDEST_LINE * pitch_px, known)
    lit = cv2.erode((~coarse.dark).astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    moved, look = np.nan, None
    if setup.grid_pitch is not None:
        look = look_at_grid(image, setup, setup.grid_pitch, roi, lit, light)
        moved = _check_grid(look, setup, scale)
    contour = coarse_contour(coarse.mask, coarse.share, factor, (x0, y0))
    through = None if look is None or not look.shift.size else Ink.of(look, setup, roi)
    drawn = None if through is None else through.drawn
    edge = refine_edge(image, contour, coarse.colour, through, factor, light, drawn)
    edge = edge[_inside(edge.px, roi)]
    if len(edge.px) < FEWEST_POINTS:
        raise Unmeasurable(
            f"only {len(edge.px)} points of the edge are clear enough; at least {FEWEST_POINTS} are needed"
        )
    _check_edge(image, edge, setup, light)
    doubts = _check_steps(edge, coarse.colour)
    blurred = check_blur(edge, scale)
    doubts += () if blurred is None else (blurred,)
    rows, columns = np.indices(coarse.mask.shape)
    places = (np.stack([columns, rows], axis=-1) + 0.5) * factor - 0.5 + np.array([x0, y0])
    ink = np.ones(coarse.mask.shape) if through is None else through(places)
    if touched_by_thread(light[small], coarse, ink, WIDEST_LINE * pitch_px, scale * factor):
        doubts += ("a thin dark thing (hair, thread, tube, a speck) touches the shadow",)
    line = smoothed(edge, LONGEST_BRIDGE / scale)
    px, error_px = line.px, line.error
    points = setup.to_metres(px)
    if not np.isfinite(points).all():
        raise Unmeasurable("the shadow lies where the lens correction is not defined")
    slope = setup.jacobian(px)
    normals = np.linalg.solve(np.swapaxes(slope, 1, 2), line.normal[..., None])[..., 0]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    typical = float(np.median(setup.error(px, error_px, normals)[~line.bridged]))
    if typical > NOISIEST:
        raise Unmeasurable(f"the edge is too noisy: its points have a standard error of {typical * 1e6:.0f} um")
    rim = _rim(coarse.mask, roi, setup)
    screen_error = np.zeros(len(points))
    if look is not None:
        screen_error, doubt = _flatness(image, setup, look, coarse, lit, points, light)
        doubts += () if doubt is None else (doubt,)
    return Traced(
        edge, px, error_px, points, normals, screen_error, line.bridged, rim, moved, scale, coarse, roi, tone, doubts
    )


def _region(image: Pixels, setup: Setup) -> tuple[int, int, int, int]:
    height, width = image.shape[:2]
    if (width, height) != (setup.camera.width, setup.camera.height):
        raise Unmeasurable(
            f"it has {width} x {height} pixels where the setup has {setup.camera.width} x {setup.camera.height}"
        )
    x0, y0, x1, y1 = (0, 0, width, height) if setup.roi is None else (round(value) for value in setup.roi)
    if min(x1 - x0, y1 - y0) < 64:
        raise Unmeasurable("the region of interest is smaller than 64 pixels")
    return x0, y0, x1, y1


def _scale(setup: Setup, roi: tuple[int, int, int, int]) -> float:
    """Length in m of a pixel in the middle of the region, in the object's plane."""
    middle = np.array([[0.5 * (roi[0] + roi[2]), 0.5 * (roi[1] + roi[3])]])
    return float(np.sqrt(np.abs(np.linalg.det(setup.jacobian(middle)[0]))))


def _check_grid(look: GridLook, setup: Setup, scale: float) -> float:
    if look.seen < GRID_SEEN or len(look.shift) < 24:
        raise Unmeasurable(
            f"the grid is not where the setup has it ({look.seen:.0%} of its lines are seen): the camera or the screen has "
            "moved, the picture is turned or mirrored, or the grid cannot be seen"
        )
    moved, rest = (value / setup.magnification for value in look.movement())
    if not moved <= max(MOVED, MOVED_PX * scale):
        raise Unmeasurable(
            f"the camera or the screen has moved by {moved * 1e6:.0f} um since the setup or during the exposure, or the "
            "picture is turned, mirrored, cropped or too noisy"
        )
    if not rest <= max(GRID_REST, GRID_REST_PX * scale):
        raise Unmeasurable(
            f"the grid's lines lie {rest * 1e6:.0f} um off: the picture is too noisy, too much compressed or too dusty to "
            "see them, the screen has bent, or this is another setup"
        )
    return moved


def _flatness(
    image: Pixels, setup: Setup, look: GridLook, coarse: CoarseShadow, lit: npt.NDArray[np.bool_], points: Array,
    light: npt.NDArray[np.float32],
) -> tuple[Array, str | None]:  # fmt: skip
    """`flatness` by the lines beside the shadow and, where some light reaches it, in the shadow."""
    roi = _region(image, setup)
    dark = cv2.erode(coarse.mask.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    looks = [look_at_grid(image, setup, look.pitch, roi, part, light, look.line_reach) for part in (lit, dark)]
    error, doubt = flatness(pieces_of(looks), points * setup.magnification)
    return error / setup.magnification, doubt


def _inside(px: Array, roi: tuple[int, int, int, int]) -> npt.NDArray[np.bool_]:
    return ((px >= roi[:2]) & (px <= np.array(roi[2:]) - 1)).all(axis=1)


def _check_edge(image: Pixels, edge: Edge, setup: Setup, light: npt.NDArray[np.float32]) -> None:
    slope = setup.jacobian(edge.px)
    width = edge.width * np.linalg.norm(slope @ edge.normal[..., None], axis=(1, 2))
    wide = float(np.percentile(width, 90))
    if wide > WIDEST_EDGE:
        raise Unmeasurable(
            f"the edge is blurred over {wide * 1e6:.0f} um (standard deviation), more than {WIDEST_EDGE * 1e6:.0f} um"
        )
    beside = sample_light(image, edge.px + 3.0 * edge.width[:, None] * edge.normal, light)
    blank = float(np.mean(np.nanmax(beside, axis=1) > BLANK))
    if blank > 0.1:
        raise Unmeasurable(
            f"it is overexposed: beside {blank:.0%} of the edge the screen is saturated, which moves the edge"
        )


def _check_steps(edge: Edge, colour: ShadowColour) -> tuple[str, ...]:
    """Doubts about an edge over which the light does not fall all the way from the screen's to the shadow's."""
    whole = 1.0 / float(colour.direction @ colour.lit)
    part = edge.contrast / whole
    if np.median(part) < PART:
        raise Unmeasurable(
            f"the light falls in steps, by {np.median(part):.0%} of the shadow's depth at this edge: the shadow has several "
            "edges, from a second lamp, a reflection or a double exposure"
        )
    count = max(FEWEST_POINTS // 2, len(part) // PIECES)
    level = np.convolve(part, np.ones(count) / count, "valid")
    if len(part) >= 2 * count and np.ptp(level) > UNEVEN:
        return (
            f"the shadow's depth changes by {np.ptp(level):.0%} along its edge: a second lamp, a reflection or stray light "
            "reaches a part of it",
        )
    share = float(np.mean(part < PART))
    if share > MOST_PARTS:
        return (f"along {share:.0%} of the edge the light falls only part of the way: a second shadow or a reflection",)
    return ()


def _rim(mask: npt.NDArray[np.bool_], roi: tuple[int, int, int, int], setup: Setup) -> Array:
    """Places in m of the region's rim that lie in the shadow."""
    rim = np.zeros_like(mask)
    rim[[0, -1], :] = mask[[0, -1], :]
    rim[:, [0, -1]] = mask[:, [0, -1]]
    rows, columns = np.nonzero(rim)
    scale = (np.array(roi[2:]) - roi[:2]) / np.array(mask.shape[::-1])
    places = setup.to_metres((np.column_stack([columns, rows]) + 0.5) * scale - 0.5 + roi[:2])
    return places[np.isfinite(places).all(axis=1)]
