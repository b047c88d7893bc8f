"""From one photograph to the shadow's edge on the screen; whether it can be trusted is asked by `series.checks`."""

from __future__ import annotations

import dataclasses
import functools

import cv2
import numpy as np
import numpy.typing as npt

from measurement.camera.pictures import TONES, Pixels, Unmeasurable
from measurement.edge.edge import BridgedLine, Edge, coarse_contour, refine_edge, smoothed
from measurement.edge.profiles import EdgeShape, Ink, Shading
from measurement.edge.shadow import CoarseShadow, find_shadow, touched_by_thread
from measurement.screen.look import Flatness, GridLook, View, flatness, look_at_grid, movement, pieces_of
from measurement.screen.setup import Setup
from softmodels.common.arrays import Array

COARSE = 640
"""Longer side in px of the small version in which the shadow is found."""

WIDEST_LINE = 0.1
"""Greatest width of a grid line in pitches that is distinguished from a shadow."""

LONGEST_BRIDGE = 10e-3
"""Length in m of the longest gap in an edge that is bridged, so that it can be shown; its points are no measured ones."""


@dataclasses.dataclass(eq=False)
class Traced:
    """A photograph, and the edge of its shadow on the screen; each step is computed when it is first asked for.

    Attributes:
        image: The photograph, shape (h, w, 3).
        setup: Camera and screen.
        tone: How the file stores light, one of `pictures.TONES`.
        tone_error: Distance in m by which the edge may be off because another tone fits as well.
        doubts: What speaks against trusting it, one sentence each.
        camera: Shape of a raised body's edge by the same camera, if this may be the edge of a level surface.
    """

    image: Pixels
    setup: Setup
    tone: str
    tone_error: float = 0.0
    doubts: tuple[str, ...] = ()
    camera: EdgeShape | None = None

    def of_level(self, raised: Traced) -> Traced:
        """Return this photograph of a level surface, traced again with what a raised body's shows of the camera."""
        again = dataclasses.replace(self, tone=raised.tone, camera=raised.edge.shape)
        if self.tone == raised.tone:
            kept = ("view", "small", "coarse", "look", "ink")
            vars(again).update({name: vars(self)[name] for name in kept if name in vars(self)})
        return again

    @functools.cached_property
    def view(self) -> View:
        """The region of the photograph that is evaluated."""
        return View(self.image, self.setup, _region(self.image, self.setup), TONES[self.tone])

    @property
    def scale(self) -> float:
        """Length in m of a pixel in the middle."""
        return self.view.pixel

    @functools.cached_property
    def factor(self) -> float:
        """Pixels of the photograph per pixel of the small version."""
        return max(1.0, self.view.size.max() / COARSE)

    @functools.cached_property
    def small(self) -> npt.NDArray[np.float32]:
        """Light of the small version, shape (h, w, 3)."""
        x0, y0, x1, y1 = self.view.roi
        size = (max(8, round((x1 - x0) / self.factor)), max(8, round((y1 - y0) / self.factor)))
        reduced = cv2.resize(self.image[y0:y1, x0:x1], size, interpolation=cv2.INTER_AREA)
        return np.asarray(self.view.light[reduced])

    @functools.cached_property
    def line_px(self) -> float:
        """Greatest width of a grid line in px of the small version; 0 without a grid."""
        if self.setup.grid_pitch is None:
            return 0.0
        return WIDEST_LINE * (self.setup.grid_pitch / self.setup.magnification / self.scale / self.factor)

    @functools.cached_property
    def coarse(self) -> CoarseShadow:
        """The shadow in the small version."""
        colour = self.setup.shadow_colour
        known = None if colour is None else self.view.light[np.rint(np.array(colour)).astype(int)]
        return find_shadow(self.small, self.line_px, known)

    @functools.cached_property
    def look(self) -> GridLook | None:
        """The screen's grid in the light; None without a grid."""
        pitch = self.setup.grid_pitch
        return None if pitch is None else look_at_grid(self.view, pitch, _well_inside(~self.coarse.dark))

    @functools.cached_property
    def movement(self) -> tuple[float, float]:
        """Movement of the screen's picture since the setup, and what of the grid's shifts it leaves, both in m in the object's
        plane; NaN without a grid, infinite where too little of it is seen."""
        if self.look is None:
            return np.nan, np.nan
        moved, rest = movement(self.look)
        return moved / self.setup.magnification, rest / self.setup.magnification

    @functools.cached_property
    def ink(self) -> Ink | None:
        """Light through the grid's ink; None without a grid."""
        return None if self.look is None else Ink.of(self.look, self.setup, self.view.roi)

    @functools.cached_property
    def edge(self) -> Edge:
        """The edge as it was found, in px."""
        ink, coarse = self.ink, self.coarse
        shading = Shading(self.image, coarse.colour, ink, None if ink is None else ink.drawn, self.view.light)
        contour = coarse_contour(coarse.mask, coarse.share, self.factor, self.view.roi[:2])
        edge = refine_edge(shading, contour, self.factor, self.camera)
        return edge[self.view.inside(edge.px)]

    @property
    def touched(self) -> bool:
        """Whether something thin and dark stands out of the shadow."""
        mask, ink = self.coarse.mask, self.ink
        pixels = np.moveaxis(np.indices(mask.shape)[::-1], 0, -1)
        through = np.ones(mask.shape) if ink is None else ink((pixels + 0.5) * self.factor - 0.5 + self.view.roi[:2])
        return touched_by_thread(self.small, self.coarse, through, self.line_px, self.scale * self.factor)

    @functools.cached_property
    def width_px(self) -> float:
        """Usual width of the edge in px."""
        return float(np.median(self.edge.width))

    @property
    def lift(self) -> float:
        """Distance in m by which the half light lies above a surface that is deep along the light; see `EdgeShape`."""
        return self.edge.shape.lift * self.width_px * self.scale

    @property
    def shift_error(self) -> float:
        """Standard error in m of the half light's place, which all points share; part of the line's error too."""
        return self.edge.shape.shift_error * self.width_px * self.scale

    @property
    def model_error(self) -> float:
        """The same by the model of the edge's shape, which all photographs of a run share; no part of the line's error."""
        return self.edge.shape.model_error * self.width_px * self.scale

    @functools.cached_property
    def line(self) -> BridgedLine:
        """The smoothed edge."""
        line = smoothed(self.edge, LONGEST_BRIDGE / self.scale)
        # Where the half light lies in the edge's shape is not known any better than this, along all of the edge.
        return dataclasses.replace(line, error=np.hypot(line.error, self.edge.shape.shift_error * self.width_px))

    @functools.cached_property
    def points(self) -> Array:
        """The smoothed edge on the screen in m, shape (n, 2); NaN where the lens is not known."""
        return self.setup.to_metres(self.line.px)

    @functools.cached_property
    def normals(self) -> Array:
        """Unit vectors across it on the screen, from shadow to light, shape (n, 2)."""
        slope = self.setup.jacobian(self.line.px)
        normals = np.linalg.solve(np.swapaxes(slope, 1, 2), self.line.normal[..., None])[..., 0]
        return np.asarray(normals / np.linalg.norm(normals, axis=1)[:, None])

    @functools.cached_property
    def flatness(self) -> Flatness:
        """What the screen's own shape makes uncertain of the edge."""
        look, coarse = self.look, self.coarse
        if look is None:
            return Flatness(np.zeros(len(self.points)))
        parts = (~coarse.dark, coarse.mask)
        looks = [look_at_grid(self.view, look.pitch, _well_inside(part), look.line_reach) for part in parts]
        return flatness(pieces_of(looks), self.points * self.setup.magnification)

    @property
    def own_error(self) -> Array:
        """Standard errors (n,) in m of the smoothed edge by itself: the edge's and the screen's."""
        edge = self.setup.exact_scale.error(self.line.px, self.line.error, self.normals)
        return np.hypot(edge, self.flatness.error / self.setup.magnification)

    @property
    def rim(self) -> Array:
        """Places in m where the shadow meets the frame or the region of interest, shape (m, 2)."""
        mask = self.coarse.mask
        rim = np.zeros_like(mask)
        rim[[0, -1], :] = mask[[0, -1], :]
        rim[:, [0, -1]] = mask[:, [0, -1]]
        rows, columns = np.nonzero(rim)
        places = self.setup.to_metres(self.view.enlarged(np.column_stack([columns, rows]), mask.shape))
        return places[np.isfinite(places).all(axis=1)]


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
