"""Bodies of revolution seen from the side: outlines that may overhang, as of balloons, bellows and drops.

A photograph shows the silhouette of such a body in the plane through its axis that is square to the line of sight, but for
perspective: the line of sight touches the body before that plane. The axis is the line about which one half of the outline is
the other one's mirror image; x counts from it and z along it, from the top that the photograph without pressure shows, or from
the base where there is none.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import cKDTree

from measurement import pictures
from measurement.outline import edge, silhouette
from measurement.outline.outline import Outline
from measurement.series import checks, measuring, views
from measurement.series.photo_list import Photograph
from measurement.series.views import SHARED_PX, Scene
from measurement.series.witness import Refusal, Result
from softmodels.common import units
from softmodels.common.arrays import Array, Mask

BASE_PX = 0.5
"""Standard error in px of where the base is along the axis: its pixels are chosen by eye."""

CORNER_STATIONS, CORNER_TURN = 2, math.radians(45.0)
"""Points before and behind a corner between which the edge turns by this angle in rad at least."""

TOP_SHARE = 0.15
"""Distance from the axis, as a share of the largest, within which a polynomial shows the top."""

POINTS_BETWEEN = 8
"""Points of an outline between two measured ones, to which distances are measured."""

FLAT_RADII = 3.0
"""Second radius of curvature over the body's radius from which an end of it is flat."""

LEAST_COSINE = 0.2
"""Cosine of the angle between outline and axis from which the body's second radius of curvature is known."""

LONGEST_BRIDGE_SHARE = 0.05
"""Longest gap in an outline that is bridged, as a share of it."""


@dataclasses.dataclass(frozen=True, eq=False)
class Meridian:
    """A body of revolution in one photograph.

    Attributes:
        points: Its outline from one end of the base to the other: distance from the axis, negative to the left of it, and place
            along it from the base in m, shape (n, 2).
        px: The same in px.
        error: Standard error (n,) of each across the outline in m.
        bridged: Which points bridge a gap, lie on a flat end or beside a corner, which smoothing rounds, shape (n,).
        unlike: Root mean square distance in m of one half from the other one's mirror image.
        pixel: Size of a pixel in m.
    """

    points: Array
    px: Array
    error: Array
    bridged: Mask
    unlike: float
    pixel: float

    @classmethod
    def of(cls, seen: silhouette.Silhouette, scene: Scene) -> Meridian:
        """Return that of a silhouette; `Unmeasurable` for one without two halves."""
        length = float(np.linalg.norm(np.diff(seen.edge.px, axis=0), axis=1).sum())
        line = edge.smoothed(seen.edge, LONGEST_BRIDGE_SHARE * length)
        outline, base = scene.to_metres(line.px), scene.to_metres(seen.base)
        pixel = float(np.sqrt(abs(np.linalg.det(scene.setup.jacobian(line.px.mean(axis=0)[None])[0]))))
        error = scene.setup.exact_scale.error(line.px, np.hypot(line.error, SHARED_PX))
        own = float(np.median(error))
        start, way = base.mean(axis=0), outline.mean(axis=0) - base.mean(axis=0)
        width = float(np.ptp(outline @ [way[1], -way[0]]) / np.linalg.norm(way))

        def placed(places: Array, p: Array) -> Array:
            angle = math.atan2(way[1], way[0]) + p[1] / width
            along = np.array([math.cos(angle), math.sin(angle)])
            return np.asarray((places - start) @ np.column_stack([[along[1], -along[0]], along]) - [p[0], 0.0])

        fit = least_squares(
            lambda p: _unlike(placed(outline, p)), np.zeros(2), loss="soft_l1", f_scale=3.0 * own, x_scale=0.01 * width
        )
        points, foot = placed(outline, fit.x), placed(scene.foot[None], fit.x)[0]
        order = np.arange(len(points))[:: 1 if points[0, 0] < points[-1, 0] else -1]
        unlike = float(np.sqrt(np.mean(_unlike(points) ** 2)))
        points, rim = _without_perspective(points[order], foot, scene.camera_distance[0])
        unseen = (line.bridged | _beside_corners(line.px, seen.edge.px))[order] | (rim > 0.0)
        return cls(points, line.px[order], np.hypot(error[order], rim), unseen, unlike, pixel)

    @property
    def top(self) -> float:
        """Place of the outline's far end along the axis in m from the base."""
        x, z = self.points.T
        near = (np.abs(x) < TOP_SHARE * np.abs(x).max()) & (z > 0.5 * z.max())
        return float(np.polynomial.Polynomial.fit(x[near], z[near], 4)(0.0))


def _beside_corners(px: Array, raw: Array) -> Mask:
    """Return which points (n, 2) of a smoothed edge lie so near to a corner of the raw one (k, 2) that smoothing moved them."""
    place = np.arange(len(raw))
    behind, ahead = (raw[np.clip(place + step, 0, len(raw) - 1)] for step in (-CORNER_STATIONS, CORNER_STATIONS))
    before, after = raw - behind, ahead - raw
    turn = np.abs(np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], np.sum(before * after, axis=1)))
    turn[:CORNER_STATIONS] = turn[-CORNER_STATIONS:] = 0.0
    corners = raw[turn > CORNER_TURN]
    if not len(corners):
        return np.zeros(len(px), dtype=bool)
    usual = float(np.median(np.linalg.norm(np.diff(raw, axis=0), axis=1)))
    return np.asarray(cKDTree(corners).query(px)[0] < 0.5 * edge.SMOOTHING_POINTS * usual)


def _unlike(points: Array) -> Array:
    """Return how far in m the points (n, 2) of each half of an outline lie off the other half's mirror image."""
    mirror = points * [-1.0, 1.0]
    at = np.linspace(0.0, len(points) - 1.0, POINTS_BETWEEN * len(points))
    dense = np.column_stack([np.interp(at, np.arange(len(points)), along) for along in mirror.T])
    _, near = cKDTree(dense).query(points)
    way = np.gradient(dense, axis=0)[near]
    off = points - dense[near]
    return np.asarray((way[:, 0] * off[:, 1] - way[:, 1] * off[:, 0]) / np.maximum(np.linalg.norm(way, axis=1), 1e-12))


def _without_perspective(points: Array, foot: Array, far: float) -> tuple[Array, Array]:
    """Return the meridian of an outline (n, 2) in order that a camera sees from a distance in m above a foot (2,), and the
    standard error (n,) that this leaves.

    The line of sight touches the body where its normal is square to it, at y = R N / D before the plane through the axis: N is
    the place's distance from the foot along the normal, R the second radius of curvature (that about the axis) and D the
    camera's distance. Nearer to the camera the place looks larger by N y / D, and it lies y^2 / 2R nearer to the axis: together
    the outline lies R N^2 / 2 D^2 too far out. Of a flat end square to the axis the rim is seen, up to its radius before the
    plane: how far is left in the error.
    """
    smooth = edge.local_polynomial(points, min(2 * edge.SMOOTHING_POINTS + 1, (len(points) - 1) // 2 * 2 + 1), 2)
    way = np.gradient(smooth, axis=0)
    out = np.column_stack([-way[:, 1], way[:, 0]]) / np.maximum(np.linalg.norm(way, axis=1), 1e-12)[:, None]
    known = out[:, 0] * points[:, 0] > LEAST_COSINE * np.abs(points[:, 0])
    place = np.arange(len(points))
    radius = np.interp(place, place[known], points[known, 0] / out[known, 0]) if known.any() else np.zeros(len(points))
    away = np.einsum("ni,ni->n", points - foot, out)
    largest = np.abs(points[:, 0]).max()
    flat = np.abs(points[:, 0]) > FLAT_RADII * largest * np.abs(out[:, 0])
    return points - (radius * away**2 / (2.0 * far**2))[:, None] * out, np.where(flat, np.abs(away) * largest / far, 0.0)


# ----------------------------------------------------------------------------------------------------------------------
# All photographs of a list.


@dataclasses.dataclass(frozen=True, eq=False)
class Outlines:
    """What a list of photographs shows of a body of revolution: a result for each, in the list's order."""

    results: tuple[Result, ...]

    @property
    def photographs(self) -> list[Photograph]:
        """The list."""
        return [result.photograph for result in self.results]

    @property
    def outcomes(self) -> list[Outline | Refusal]:
        """An outline, or the reason why there is none, of each."""
        return [result.outcome for result in self.results]

    def write(self, folder: Path) -> None:
        """Write ``heights.csv`` and a table of each outline into a folder; `OSError` where they cannot be written."""
        measuring.write_results(self.results, folder)


def outlines(
    photographs: Sequence[Photograph],
    scene: Scene,
    pictures_folder: Path | None = None,
    done: Callable[[], None] = lambda: None,
) -> Outlines:
    """Return the outlines of a body of revolution; arguments are as of `views.views`."""
    before, datum = None, 0.0

    def measured(photo: Photograph, image: pictures.Pixels, seen: silhouette.Silhouette) -> Outline:
        nonlocal before, datum
        meridian = Meridian.of(seen, scene)
        outline = _outline(image, seen, meridian, scene, photo, before, datum)
        if before is None and photo.is_zero and outline.trust != "no":
            before, datum = (image, seen), meridian.top
            return dataclasses.replace(outline, z=outline.z - datum, level_error=0.0, whole="top")
        return outline

    def shown(seen: silhouette.Silhouette | None, outcome: Outline | Refusal) -> tuple[list[Array], str]:
        return [] if seen is None else [seen.edge.px], "" if isinstance(outcome, Refusal) else in_words(outcome)

    every = views.each_photograph(photographs, scene, measured, shown, pictures_folder, done)
    return Outlines(tuple(map(Result, photographs, every, measuring.file_stems(photographs))))


def _outline(
    image: pictures.Pixels, seen: silhouette.Silhouette, meridian: Meridian, scene: Scene, photo: Photograph,
    before: tuple[pictures.Pixels, silhouette.Silhouette] | None, datum: float,
) -> Outline:  # fmt: skip
    """Return the outline, z counted from a datum in m above the base; ``before`` are picture and silhouette without
    pressure."""
    own = float(np.median(meridian.error))
    evidence = checks.RevolvedEvidence(seen, *views.since(before, image, seen), photo.anyway, meridian.unlike, own)
    reasons = checks.doubts(evidence)
    far, (ahead, ahead_error) = scene.camera_distance, scene.ahead
    scale = math.hypot(scene.setup.scale_error, ahead_error / far[0], ahead * far[1] / far[0] ** 2)
    # What both halves differ by beyond their noise is nobody's own, and half of it is in each.
    error = np.hypot(meridian.error, 0.5 * math.sqrt(max(0.0, meridian.unlike**2 - 2.0 * own**2)))
    return Outline(
        meridian.points[:, 0], meridian.points[:, 1] - datum, error, photo.pressure, photo.pressure_error, photo.file.name,
        not reasons, reasons, bridged=meridian.bridged, scale_error=scale,
        level_error=0.0 if before is not None else BASE_PX * meridian.pixel, history=photo.history, anyway=photo.anyway,
        edge_error=SHARED_PX * meridian.pixel, whole="base" if before is None else "top",
    )  # fmt: skip


def in_words(outline: Outline) -> str:
    """Return how wide an outline is and how far its top has moved, in words."""
    wide, error = float(np.ptp(outline.x)), math.sqrt(2.0) * float(np.median(outline.error))
    width = units.with_error(wide * 1e3, math.hypot(error, outline.scale_error * wide) * 1e3, "mm")
    top = units.with_error(outline.height * 1e3, outline.height_error * 1e3, "mm")
    return f"{width} wide, top at {top}{' above the base' * (outline.whole == 'base')}"
