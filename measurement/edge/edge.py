"""The edge of the shadow between the pixels of the raw photograph.

Across the edge the light follows an error function: lit screen, penumbra, shadow. At many stations along a coarse contour
a profile across it, averaged over the station's length, gets such a curve by least squares: middle, width, both levels and
the fall of the lit screen's light. The middle is where half of the lamp is seen. Levels that belong to each profile make
uneven light harmless, and the light is divided by what the grid's ink lets through before.

Photographs are not warped or resampled for this; only the profiles' few samples lie between pixels.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_propagation
from scipy.special import erf
from skimage.measure import find_contours

from measurement.camera.pixels import LIGHT, Pixels, Unmeasurable, sample_light
from measurement.edge.ink import Drawn, Transmission
from measurement.edge.shadow import ShadowColour

Array = npt.NDArray[np.float64]

HALF = 30
"""Samples of a profile on each side of its middle."""

MOST_STATIONS = 1200
"""Stations along an edge; at 10 um per pixel they lie some 50 um apart."""

INK_TRUST = 0.05
"""Share by which the correction for the grid's ink may be wrong; samples on ink weigh less accordingly."""

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
        shape_misfit: Root mean square distance of the profiles' common shape from the curve, over the curve's rise.
        on_ink: Whether one side of the edge lies mostly on the grid's lines, which blurs that shape.
    """

    px: Array
    normal: Array
    error: Array
    width: Array
    contrast: Array
    shape_misfit: float
    on_ink: bool = False

    def __getitem__(self, chosen: npt.NDArray[np.bool_]) -> Edge:
        return Edge(
            self.px[chosen],
            self.normal[chosen],
            self.error[chosen],
            self.width[chosen],
            self.contrast[chosen],
            self.shape_misfit,
            self.on_ink,
        )


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
        raise Unmeasurable("there is no shadow on the screen")
    longest = max(contours, key=lambda points: float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()))
    return (longest[:, ::-1] + 0.5) * factor - 0.5 + np.array(origin)


def refine_edge(
    image: Pixels,
    contour: Array,
    colour: ShadowColour,
    through: Transmission | None,
    factor: float,
    light: npt.NDArray[np.float32] = LIGHT,
    drawn: Drawn | None = None,
) -> Edge:
    """Find the edge near a coarse contour.

    Args:
        image: The photograph, shape (h, w, 3).
        contour: Points along the edge (n, 2) in px, good to about ``factor``.
        colour: Colours of the shadow and the screen.
        through: What the grid's ink lets through; None where there is no grid.
        factor: Error of the contour in px.
        light: Light of every stored number.
        drawn: What the ink leaves in the profiles because it is blurred together with the edge; None leaves that out.

    Raises:
        Unmeasurable: The edge fades over more than the profiles can reach, or is nowhere clear.
    """
    length = float(np.linalg.norm(np.diff(contour, axis=0), axis=1).sum())
    contour = _light_to_the_right(image, contour, colour, 2.0 * factor, light)
    reach, edge = 4.0 * factor + 4.0, None
    for _ in range(4):
        edge = _fit(image, contour, colour, through, max(2.0 * factor, length / 400.0), reach, light)
        width = float(np.median(edge.width)) if len(edge.px) > 10 else np.inf
        if 3.5 * width + factor <= reach:
            break
        reach = 2.0 * reach
    assert edge is not None
    if len(edge.px) < 10:
        raise Unmeasurable("its edge is nowhere clear enough to be found")
    # The second look follows the first one's edge, so that its profiles need no room for the contour's error.
    spacing = max(3.0, float(np.linalg.norm(np.diff(edge.px, axis=0), axis=1).sum()) / MOST_STATIONS)
    return _fit(image, edge.px, colour, through, spacing, float(np.clip(4.5 * width + 2.0, 5.0, 250.0)), light, drawn)


def _light_to_the_right(
    image: Pixels, path: Array, colour: ShadowColour, reach: float, light: npt.NDArray[np.float32]
) -> Array:
    """The path in the direction whose normals, as `_stations` draws them, point to the light."""
    place, normal = _stations(path, reach)
    with_normal, against = (
        colour.share(sample_light(image, place + sign * reach * normal, light)) for sign in (1.0, -1.0)
    )
    return path if np.nanmedian(with_normal - against) > 0.0 else path[::-1]


def _fit(
    image: Pixels,
    path: Array,
    colour: ShadowColour,
    through: Transmission | None,
    spacing: float,
    reach: float,
    light: npt.NDArray[np.float32],
    drawn: Drawn | None = None,
) -> Edge:
    place, normal = _stations(path, spacing)
    offsets = np.linspace(-reach, reach, 2 * HALF + 1)
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    wide = np.arange(max(1, round(min(spacing, 8.0)))) - (max(1, round(min(spacing, 8.0))) - 1) / 2.0
    points = (
        place[:, None, None, :]
        + wide[None, :, None, None] * tangent[:, None, None, :]
        + offsets[None, None, :, None] * normal[:, None, None, :]
    )
    value = sample_light(image, points, light) @ colour.direction
    weight = np.isfinite(value).astype(float)
    if through is not None:
        ink = through(points)
        value = value / ink
        weight *= 1.0 / (1.0 + ((1.0 - ink) * INK_TRUST / 0.01) ** 2)
    value = np.where(weight > 0.0, value, 0.0)
    total = weight.sum(axis=1)
    profile = (weight * value).sum(axis=1) / np.maximum(total, 1e-9)
    rest = None
    if drawn is not None:
        some = points[:, :: max(1, (len(wide) - 1) // 2)]

        def rest(z: Array, width: Array) -> Array:
            return np.mean([drawn(some[:, number], z, width) for number in range(some.shape[1])], axis=0)

    return _erf_fit(place, normal, profile, total / len(wide), offsets, rest)


def _stations(path: Array, spacing: float) -> tuple[Array, Array]:
    """Places (n, 2) at equal distances along a path, and its unit normals (n, 2) towards the light."""
    step = np.linalg.norm(np.diff(path, axis=0), axis=1)
    keep = np.r_[True, step > 1e-9]
    path, arc = path[keep], np.r_[0.0, np.cumsum(step[step > 1e-9])]
    if len(path) < 5 or arc[-1] < 5.0 * spacing:
        raise Unmeasurable("the shadow is too small to be measured")
    s = np.arange(0.5 * spacing, arc[-1], spacing)
    # Directions come from a chord of several stations: a single step of a coarse contour turns with every pixel.
    chord = 3.0 * spacing
    place = np.column_stack([np.interp(s, arc, path[:, axis]) for axis in (0, 1)])
    ahead = np.column_stack([np.interp(np.minimum(s + chord, arc[-1]), arc, path[:, axis]) for axis in (0, 1)])
    behind = np.column_stack([np.interp(np.maximum(s - chord, 0.0), arc, path[:, axis]) for axis in (0, 1)])
    tangent = ahead - behind
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1), 1e-9)[:, None]
    return place, np.column_stack([tangent[:, 1], -tangent[:, 0]])


def _erf_fit(
    place: Array, normal: Array, profile: Array, weight: Array, offsets: Array,
    drawn: Callable[[Array, Array], Array] | None = None,
) -> Edge:  # fmt: skip
    """Gauss-Newton on all profiles (n, k) at once: y = a + (b + m u) Phi((u - c) / w)."""
    u = offsets[None, :]
    reach = offsets[-1]
    side = len(offsets) // 5
    low, high = profile[:, :side].mean(axis=1), profile[:, -side:].mean(axis=1)
    half = 0.5 * (low + high)
    above = (profile > half[:, None]).astype(float)
    centre = reach - above.sum(axis=1) * (offsets[1] - offsets[0])  # a step that keeps the area
    width = np.full(len(place), 0.25 * reach)
    slope = np.zeros(len(place))
    rise = high - low
    robust = np.ones_like(profile)
    scatter = np.ones(len(place))
    normal_matrix = np.zeros((len(place), 5, 5))
    for turn in range(14):
        z = (u - centre[:, None]) / width[:, None]
        phi = 0.5 * (1.0 + erf(z / np.sqrt(2.0)))
        bell = np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)
        top = rise[:, None] + slope[:, None] * u
        residual = profile - low[:, None] - top * phi
        terms = np.stack([np.ones_like(phi), phi, u * phi, -top * bell / width[:, None], -top * bell * z], axis=-1)
        if turn in (5, 9):
            scatter = np.maximum(1.4826 * np.median(np.abs(residual), axis=1), 1e-4)
            robust = np.minimum(1.0, 2.5 * scatter[:, None] / np.maximum(np.abs(residual), 1e-12))
        w = weight * robust
        weighted = terms * w[..., None]
        normal_matrix = np.einsum("nki,nkj->nij", weighted, terms)
        damping = 1e-9 * np.trace(normal_matrix, axis1=1, axis2=2)[:, None, None] * np.eye(5)
        step = np.linalg.solve(normal_matrix + damping, np.einsum("nki,nk->ni", weighted, residual)[..., None])[..., 0]
        step = np.where(np.isfinite(step), step, 0.0)
        low, rise, slope = low + step[:, 0], rise + step[:, 1], slope + step[:, 2]
        centre = np.clip(centre + np.clip(step[:, 3], -0.3 * reach, 0.3 * reach), -reach, reach)
        width = np.clip(width * np.exp(np.clip(step[:, 4], -0.5, 0.5)), 0.15, reach)
    freedom = np.maximum(w.sum(axis=1) - 5.0, 1.0)
    own = (w * residual**2).sum(axis=1) / freedom
    variance = np.maximum(own, np.median(own))
    # Samples closer than a pixel repeat each other's noise.
    repeat = BETWEEN * max(1.0, 1.0 / (offsets[1] - offsets[0]))
    inverse = np.linalg.inv(normal_matrix + damping)
    error = np.sqrt(np.maximum(inverse[:, 3, 3], 0.0) * variance * repeat)
    if drawn is not None:  # what blurred ink adds to a profile moves the fit's middle, to first order by one more step
        added = np.einsum("nki,nk->ni", weighted, top * drawn(z, width))
        shift = np.linalg.solve(normal_matrix + damping, added[..., None])[:, 3, 0]
        centre, error = centre - shift, np.hypot(error, DRAWN_ERROR * shift)
    lit = low + rise + slope * centre
    with np.errstate(divide="ignore", invalid="ignore"):
        contrast = rise / lit
    good = (
        np.isfinite(error) & (rise > 0.0) & (np.abs(centre) < 0.8 * reach) & (weight.min(axis=1) > 0.0)
        & (width < 0.7 * reach) & (error < 0.3 * reach) & (contrast > 0.2)
    )  # fmt: skip
    # Dust on the edge spoils the curve's shape before it moves its middle much.
    usual = np.median(own[good]) if good.any() else np.inf
    spoilt = (own > LARGEST_RESIDUAL_RATIO**2 * usual) | (np.abs(np.log(width / _local_median(width))) > 0.35)
    # It reaches into the stations beside those in which it is plain.
    spoilt = binary_propagation(spoilt, mask=spoilt | (own > NEIGHBOUR_RATIO**2 * usual))
    if good.any() and (spoilt & good).sum() < 0.2 * good.sum():
        good &= ~spoilt
    shape_misfit, on_ink = _shape_misfit(
        z[good], (residual / np.maximum(rise, 1e-12)[:, None])[good], weight[good] > 0.9
    )
    px = place + centre[:, None] * normal
    return Edge(px[good], normal[good], error[good], width[good], contrast[good], shape_misfit, on_ink)


def _local_median(value: Array, window: int = 31) -> Array:
    if len(value) < window:
        return np.full_like(value, np.median(value))
    padded = np.pad(value, window // 2, mode="reflect")
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, window), axis=1)


def _shape_misfit(z: Array, residual: Array, clean: npt.NDArray[np.bool_]) -> tuple[float, bool]:
    """How far the median of all profiles lies from the curve: noise goes, what they have in common stays."""
    bins = np.floor((z + 3.0) * 4.0).astype(np.int64)
    # An edge that runs along a grid line, or just beside it, has hardly a sample off the ink on one side; what the ink takes
    # is known well enough then.
    sides = (np.abs(z + 1.5) < 1.0, np.abs(z - 1.5) < 1.0)
    on_ink = any(clean[side].mean() < 0.5 for side in sides if side.any())
    for counted in (clean, np.ones_like(clean)):
        chosen = [residual[counted & (bins == number)] for number in range(24)]
        medians = [np.median(values) for values in chosen if len(values) >= 20]
        if len(medians) >= 12:
            return float(np.sqrt(np.mean(np.square(medians)))), on_ink
    return np.nan, True
