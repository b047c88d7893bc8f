"""Thin dark things that touch the shadow: hairs, threads, tubes.

The coarse shadow is closed over the grid's lines, and over everything else that is as thin. Such a thing bends the edge it
touches, or hides it, so it must not go unnoticed.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from measurement.edge.shadow import CoarseShadow, closing_size

DARK_INK = 0.6
"""Share of light through the grid's ink below which a dark place may be ink as well as a thing in the light."""

THING, FEWEST_PX = 0.45e-3, 5.0
"""Length in m, and in px of the small version, that a thing must stand out of the shadow to be told from dust."""

SQUARE = np.ones((3, 3), np.uint8)


def touched_by_thread(
    light: npt.NDArray[np.float32], coarse: CoarseShadow, ink: npt.NDArray[np.float64], line_px: float, scale: float
) -> bool:
    """Whether something thin and dark stands out of the shadow.

    Args:
        light: Light of the small version, shape (h, w, 3).
        coarse: The shadow found in it.
        ink: Share of light that the grid's ink lets through there, shape (h, w).
        line_px: Greatest width of a grid line in these pixels, as `find_shadow` had it.
        scale: Length in m of one of these pixels.
    """
    plain = cv2.medianBlur(light, 3) / np.maximum(ink, 0.1)[..., None] / coarse.even[..., None]
    dark = (coarse.colour.share(plain.astype(np.float64)) < 0.5) & (ink > DARK_INK)
    # Along the frame the closing shaves the shadow's own wedge off; what stays thick beyond the frame is no thread.
    size = closing_size(line_px)
    padded = np.pad(dark | coarse.mask, size, mode="edge").astype(np.uint8)
    thick = cv2.morphologyEx(padded, cv2.MORPH_OPEN, np.ones((size, size), np.uint8))[size:-size, size:-size]
    body = cv2.dilate(thick | coarse.mask.astype(np.uint8), SQUARE)
    things = dark.astype(np.uint8) & ~body & 1
    far = cv2.distanceTransform(1 - (body & 1), cv2.DIST_L2, 5)
    labels = cv2.connectedComponents(things)[1]
    reach = max(THING / scale, FEWEST_PX)
    touching, long = (np.unique(labels[(things > 0) & chosen]) for chosen in (far < 3.0, far > reach))
    return bool(np.intersect1d(touching, long).size)
