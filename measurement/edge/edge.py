"""The edge of the shadow between the pixels of the raw photograph.

Across the edge the light falls from the lit screen's through the penumbra to the shadow's. At many stations along a coarse
contour a profile across it, averaged over the station's length, gets a step by least squares: middle, width, both levels and
the fall of the lit screen's light. The step is an error function first, and then has the shape that all profiles of the
photograph have in common (`edge_shape`). Its middle is where half of the lamp is seen. Levels that belong to each profile make
uneven light harmless, and the light is divided by what the grid's ink lets through before.

Photographs are not warped or resampled for this; only the profiles' few samples lie between pixels.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_propagation
from skimage.measure import find_contours

from measurement.camera.pixels import Unmeasurable
from measurement.edge.edge_shape import EdgeShape, Stored, common_shape, gaussian
from measurement.edge.profile_fit import ProfileFit, fit_profiles
from measurement.edge.profiles import Profiles, Shading, stations

Array = npt.NDArray[np.float64]

MOST_STATIONS = 1200
"""Stations along an edge; at 10 um per pixel they lie some 50 um apart."""

BETWEEN = 1.5
"""Values between pixels scatter less than the pixels: bilinear weights leave 2/3 of the variance on average."""

LARGEST_RESIDUAL_RATIO = 4.0
"""Residual of a profile over the usual one from which something lies on the edge."""

NEIGHBOUR_RATIO = 2.0
"""The same beside such a profile: one in a hundred exceeds it by noise."""

DRAWN_ERROR = 0.35
"""Share of the shift by ink that blurs with the edge by which its correction may be wrong."""


@dataclasses.dataclass(frozen=True, eq=False)
class Edge:
    """An edge in pixels.

    Attributes:
        px: Points of the edge (x, y), in order along it, shape (n, 2).
        normal: Unit vectors across it, from shadow to light, shape (n, 2).
        error: Standard error of each point along its normal in px, shape (n,).
        width: Standard deviation of the penumbra and blur in px, shape (n,).
        contrast: Share of the local light that the shadow takes away, shape (n,).
        shape: What the profiles across it have in common.
    """

    px: Array
    normal: Array
    error: Array
    width: Array
    contrast: Array
    shape: EdgeShape = dataclasses.field(default_factory=gaussian)

    def __getitem__(self, chosen: npt.NDArray[np.bool_]) -> Edge:
        names = ("px", "normal", "error", "width", "contrast")
        return dataclasses.replace(self, **{name: getattr(self, name)[chosen] for name in names})


def coarse_contour(mask: npt.NDArray[np.bool_], share: Array, factor: float, origin: tuple[int, int]) -> Array:
    """The longest contour at half light of a shadow in a small photograph, in px of the large one.

    Args:
        mask: The one shadow, shape (h, w).
        share: 0 in the shadow to 1 on the screen, shape (h, w).
        factor: Pixels of the photograph per pixel of the mask.
        origin: Pixel of the photograph at which the mask begins.

    Returns:
        Points (n, 2); open where the shadow leaves the picture.
    """
    near = np.where(mask, np.minimum(share, 0.49), np.maximum(share, 0.51))
    contours = find_contours(np.clip(near, 0.0, 1.0), 0.5)
    if not contours:
        raise Unmeasurable("there is no shadow on the screen; switch the lamp on, and photograph the body in its light")
    longest = max(contours, key=lambda points: float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()))
    return (longest[:, ::-1] + 0.5) * factor - 0.5 + np.array(origin)


def refine_edge(shading: Shading, contour: Array, factor: float) -> Edge:
    """Find the edge near a coarse contour.

    Args:
        shading: The photograph as light.
        contour: Points along the edge (n, 2) in px, good to about ``factor``.
        factor: Error of the contour in px.

    Raises:
        Unmeasurable: The edge fades over more than the profiles can reach, or is nowhere clear.
    """
    length = float(np.linalg.norm(np.diff(contour, axis=0), axis=1).sum())
    contour = _light_beside(shading, contour, 2.0 * factor)
    spacing, reach = max(2.0 * factor, length / 400.0), 4.0 * factor + 4.0
    for _ in range(4):
        edge = _edge_in(Profiles.across(shading, contour, spacing, reach))
        width = float(np.median(edge.width)) if len(edge.px) > 10 else np.inf
        if 3.5 * width + factor <= reach:
            break
        reach = 2.0 * reach
    if len(edge.px) < 10:
        raise Unmeasurable(
            "its edge is nowhere clear enough to be found; photograph it again in focus, with more light and contrast"
        )
    # The second look follows the first one's edge, so that its profiles need no room for the contour's error.
    spacing = max(3.0, float(np.linalg.norm(np.diff(edge.px, axis=0), axis=1).sum()) / MOST_STATIONS)
    reach = float(np.clip(4.5 * width + 2.0, 5.0, 250.0))
    return _edge_in(Profiles.across(shading, edge.px, spacing, reach), shading)


def _light_beside(shading: Shading, path: Array, reach: float) -> Array:
    """The path in the direction whose normals, as `stations` draws them, point to the light."""
    place, normal = stations(path, reach)
    ahead, behind = (shading.level(place + sign * reach * normal) for sign in (1.0, -1.0))
    return path if np.nanmedian(ahead - behind) > 0.0 else path[::-1]


def _edge_in(profiles: Profiles, shading: Shading | None = None) -> Edge:
    """The edge that profiles show, without the stations where it is not clear or something lies on it.

    Args:
        profiles: Light across the edge.
        shading: The photograph, for the shape of its edge and for what ink draws; None for an error function alone.
    """
    shape, value = gaussian(), profiles.value
    fit, drawn = fit_profiles(profiles.offsets, value, profiles.weight), np.zeros(len(value))
    if shading is not None and shading.drawn is not None:
        # What ink draws is taken out before the shape is looked for, which would take it for the lamp's or the camera's.
        ink = fit.top * profiles.drawn(shading.drawn, fit.z, fit.width)
        value, drawn = value - ink, fit.centre_shift(ink)
        fit = fit_profiles(profiles.offsets, value, profiles.weight)
    if shading is not None:
        good = _clear(profiles, fit, fit.centre_error(fit.variance))
        if good.sum() >= 10:
            residual = fit.residual / np.maximum(fit.rise, 1e-12)[:, None]
            shape = common_shape(fit.z[good], residual[good], profiles.weight[good] > 0.9, _stored(shading, fit, good))
            fit = fit_profiles(profiles.offsets, value, profiles.weight, shape)
    # Samples closer than a pixel repeat each other's noise.
    repeat = BETWEEN * max(1.0, 1.0 / (profiles.offsets[1] - profiles.offsets[0]))
    own, centre = fit.variance, fit.centre
    error = np.hypot(fit.centre_error(np.maximum(own, np.median(own)) * repeat), DRAWN_ERROR * drawn)
    good = _clear(profiles, fit, error)
    spoilt = _spoilt(own, fit.width, good)
    if (spoilt & good).sum() < 0.2 * good.sum():
        good &= ~spoilt
    px = profiles.place + centre[:, None] * profiles.normal
    return Edge(px[good], profiles.normal[good], error[good], fit.width[good], _contrast(fit)[good], shape)


def _contrast(fit: ProfileFit) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(fit.rise / (fit.low + fit.rise + fit.slope * fit.centre))


def _clear(profiles: Profiles, fit: ProfileFit, error: Array) -> npt.NDArray[np.bool_]:
    """Stations (n,) at which the edge is clear, by the standard errors (n,) of their middles."""
    reach = profiles.offsets[-1]
    return np.asarray(
        np.isfinite(error) & (fit.rise > 0.0) & (np.abs(fit.centre) < 0.8 * reach) & (profiles.weight.min(axis=1) > 0.0)
        & (fit.width < 0.7 * reach) & (error < 0.3 * reach) & (_contrast(fit) > 0.2)
    )  # fmt: skip


def _stored(shading: Shading, fit: ProfileFit, good: npt.NDArray[np.bool_]) -> Stored:
    colour = shading.colour
    low, high = float(colour.shadow.mean()), float(colour.lit.mean())
    return Stored(shading.light.astype(np.float64), low, high, float(np.median(fit.width[good])))


def _spoilt(variance: Array, width: Array, good: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Stations (n,) at which something lies on the edge: dust spoils the curve's shape before it moves its middle much."""
    usual = np.median(variance[good]) if good.any() else np.inf
    found = (variance > LARGEST_RESIDUAL_RATIO**2 * usual) | (np.abs(np.log(width / _local_median(width))) > 0.35)
    # It reaches into the stations beside those in which it is plain.
    return np.asarray(binary_propagation(found, mask=found | (variance > NEIGHBOUR_RATIO**2 * usual)))


def _local_median(value: Array, window: int = 31) -> Array:
    if len(value) < window:
        return np.full_like(value, np.median(value))
    padded = np.pad(value, window // 2, mode="reflect")
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, window), axis=1)
