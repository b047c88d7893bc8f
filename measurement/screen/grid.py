"""The screen's grid of lines, found in a photograph without a click.

Long dark lines are sought in a reduced picture (`find_lines`), sorted into two pencils with counted lines
(`count_lines`), and their crossings measured in the photograph itself (below). The pitch only scales the
result: a grid with another pitch looks the same from another distance, so a wrong pitch cannot be noticed here.
"""

from __future__ import annotations

import dataclasses
import itertools
import warnings

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import maximum_filter, median_filter

from measurement import robust
from measurement.camera import Camera, Points
from measurement.screen import setup


@dataclasses.dataclass(frozen=True, eq=False)
class GridPoints:
    """Crossings of a regular grid in a photograph.

    Attributes:
        px: Crossings (n, 2) in px of the photograph itself, lens distortion and all.
        indices: Whole numbers (n, 2): lines counted to the right and upwards from the origin's crossing.
        sigma_px: Standard error (n,) of each crossing per axis in px.
        residual_px: Root mean square distance in px of the crossings from the grid that fits them best.
        pitch: Distance of the lines in m; None where it was not given.
    """

    px: Points
    indices: NDArray[np.int64]
    sigma_px: Points
    residual_px: float
    pitch: float | None = None

    def plane(self, camera: Camera, pitch: float | None = None) -> setup.Plane:
        """Return the screen's plane through these points, its error taken from what the fit leaves; the pitch is in m, if
        the points do not know it."""
        size = pitch if pitch is not None else self.pitch
        if size is None or not size > 0.0:
            raise GridError("the pitch of the grid must be a positive length")
        return weighted_plane(camera.undistort(self.px), np.asarray(self.indices * size, dtype=np.float64), self.sigma_px)


WORST_SHARE = 0.005
"""Largest residual as a share of the pitch (45 um of 9 mm); below `WORST_PX` a residual is always small enough."""

WORST_PX = 0.3

MIN_CROSSING_ERROR = 0.02
"""Smallest standard error in px that a crossing is given when crossings are weighed against each other."""

MAX_SPACING_RATIO = 1.7
"""Largest ratio of the spacings of both families of lines on the screen, as the camera's matrix tells it."""


def weighted_plane(ideal: Points, targets: Points, sigma: Points) -> setup.Plane:
    """Fit a plane in which sharp crossings weigh more than faint ones and the errors are those that the fit shows: points
    (n, 2) in ideal px and on the screen, their own errors (n,) in px right up to a common factor and a floor."""
    # What all crossings share (the print, the lens, the sensor) keeps one of them from ruling the fit.
    relative = np.hypot(sigma, max(float(np.median(sigma)), MIN_CROSSING_ERROR))
    trial = setup.Plane.fit(ideal, targets, relative)
    missed = (trial.to_pixels(targets) - ideal) / relative[:, None]
    factor = float(np.sqrt(np.sum(missed**2) / max(1, 2 * len(ideal) - 8)))
    return setup.Plane.fit(ideal, targets, relative * max(factor, 1e-6))


def find_grid(
    image: ArrayLike, camera: Camera | None = None, pitch: float = 0.009, origin: tuple[float, float] | None = None
) -> GridPoints:
    """Find a regular grid of dark lines on a lighter screen in a photograph (h, w) or (h, w, 3); the pitch is in m, and the
    crossing near the pixel ``origin``, the middle of the picture unless given, becomes the origin.

    Raises `GridError` for no grid, too few crossings, a residual too large, or more than one way to read the lines.
    """
    if not pitch > 0.0:
        raise GridError("the pitch of the grid must be a positive length")
    gray = gray_bytes(image)
    height, width = gray.shape
    seen_by = Camera.ideal(width, height) if camera is None else camera
    if (seen_by.width, seen_by.height) != (width, height):
        raise GridError(
            f"the picture has {width} x {height} pixels but the camera {seen_by.width} x {seen_by.height}; "
            "photograph both with the same settings and do not crop"
        )
    if np.ptp(np.percentile(gray, (0.5, 99.5))) < 4.0:
        raise GridError("the picture is blank; it shows no grid")
    lattice = count_lines(find_lines(gray, seen_by), seen_by)
    px, indices, sigma = measure_crossings(gray, seen_by, lattice)
    px, indices, sigma, plane = _without_outliers(px, indices, sigma, seen_by)
    grid_points = checked(px, indices, sigma, plane)
    _check_square(plane, seen_by)
    return counted_from(grid_points, seen_by, pitch, origin)


def counted_from(points: GridPoints, camera: Camera, pitch: float, origin: tuple[float, float] | None = None) -> GridPoints:
    """Return the same points counted from the crossing nearest to a pixel, the picture's middle unless given."""
    middle = ((camera.width - 1) / 2, (camera.height - 1) / 2) if origin is None else origin
    # The origin need not be measured itself: dust on it must not move it to its neighbour.
    first = np.rint(points.plane(camera, 1.0).to_metres(camera.undistort(middle))[0]).astype(int)
    return dataclasses.replace(points, indices=points.indices - first, pitch=pitch)


def gray_bytes(image: ArrayLike) -> NDArray[np.uint8]:
    """Return a photograph (h, w) or (h, w, 3) as 8-bit gray values (h, w); `GridError` if it is no picture."""
    picture = np.asarray(image)
    if picture.ndim == 3 and picture.shape[2] == 3 and picture.dtype == np.uint8:
        return cv2.cvtColor(np.ascontiguousarray(picture), cv2.COLOR_RGB2GRAY)
    if picture.ndim != 2 or min(picture.shape) < 32:
        raise GridError("a picture of at least 32 x 32 gray or 8-bit colour pixels is needed to find a grid")
    if picture.dtype == np.uint8:
        return np.ascontiguousarray(picture)
    low, high = float(np.min(picture)), float(np.max(picture))
    if not np.isfinite([low, high]).all():
        raise GridError("the picture holds values that are not finite numbers")
    return np.clip((picture - low) * (255.0 / max(high - low, 1e-12)), 0.0, 255.0).astype(np.uint8)


def checked(px: Points, indices: NDArray[np.int64], sigma: Points, plane: setup.Plane) -> GridPoints:
    """Return points (n, 2) in raw px with errors (n,), whole numbers (n, 2) in any orientation and the plane fitted to both,
    turned so that the first index counts to the right and the second upwards.

    Raises `GridError` for too few points, a residual too large, or a grid turned by about 45 degrees.
    """
    _check_count(indices)
    missed = plane.to_pixels(indices.astype(float)) - plane.points
    residual = float(np.sqrt(np.mean(np.sum(missed**2, axis=1))))
    axes = np.linalg.inv(plane.jacobian(plane.points.mean(axis=0))[0])  # px per index; columns are the grid's axes
    spacing = float(np.sqrt(abs(np.linalg.det(axes))))
    if residual > max(WORST_PX, WORST_SHARE * spacing):
        raise GridError(
            f"the residual of the crossings to a regular grid is {residual:.2g} px ({residual / spacing:.2%} of the pitch); "
            "correct the lens, or flatten the screen"
        )
    units = axes / np.linalg.norm(axes, axis=0)
    level = np.abs(units[0])
    if abs(level[0] - level[1]) < 0.15:
        raise GridError("the grid is turned by about 45 degrees; turn the camera so that its lines lie level or upright")
    right, up = (0, 1) if level[0] > level[1] else (1, 0)
    signs = (int(np.sign(units[0, right])), -int(np.sign(units[1, up])))  # y counts downwards in a picture
    turned = np.column_stack([indices[:, right] * signs[0], indices[:, up] * signs[1]])
    return GridPoints(px, turned, sigma, residual)


def _without_outliers(
    px: Points, indices: NDArray[np.int64], sigma: Points, camera: Camera
) -> tuple[Points, NDArray[np.int64], Points, setup.Plane]:
    ideal = camera.undistort(px)
    keep = np.isfinite(ideal).all(axis=1)
    total = len(px)
    while True:
        _check_count(indices[keep])
        try:
            plane = weighted_plane(ideal[keep], indices[keep].astype(float), sigma[keep])
        except setup.PlaneError as error:
            raise GridError(f"the grid's crossings do not determine a plane: {error}") from None
        missed = np.linalg.norm(plane.to_pixels(indices.astype(float)) - ideal, axis=1)
        # Judged by its own error; but less than a tenth of a pixel is never an outlier.
        relative = np.hypot(sigma, MIN_CROSSING_ERROR)
        limit = 5.0 * float(np.median((missed / relative)[keep])) * relative
        wanted = keep & (missed < np.maximum(limit, 0.1))
        if np.array_equal(wanted, keep):
            break
        keep = wanted
    if keep.sum() < 0.7 * total:
        raise GridError(f"{total - int(keep.sum())} of {total} crossings do not fit one regular grid; check the lens")
    return px[keep], indices[keep], sigma[keep], plane


def _check_square(plane: setup.Plane, camera: Camera) -> None:
    """Both families must be equally spaced, or one of them was miscounted. The focal length need not be exact for that."""
    pose = np.linalg.inv(camera.matrix) @ np.linalg.inv(plane.homography)
    across, up = np.linalg.norm(pose[:, :2], axis=0)
    ratio = max(across / up, up / across)
    if ratio > MAX_SPACING_RATIO:
        raise GridError(
            f"the lines are {ratio:.1f} times as far apart in one direction as in the other, so that they can be counted in "
            "more than one way; show more of the grid"
        )


# ----------------------------------------------------------------------------------------------------------------------
# What makes a grid, and the error of a picture that shows none.


MIN_LINES = 6
"""Crossings that make a grid: the thesis' six points, two more than a homography needs."""


class GridError(ValueError):
    """A picture in which no grid or board can be trusted; the message is for the user."""


# ----------------------------------------------------------------------------------------------------------------------
# Long dark lines in a photograph: valleys of brightness that lie in a row.


LONGER_SIDE = 1000
"""Pixels of the reduced picture's longer side: enough to tell lines, few enough to be quick."""

BLUR_WIDTHS = (1.0, 1.7, 3.0, 5.0, 8.0, 13.0)
"""Standard deviations in reduced px of the blur under which a line may show best."""

NOISE_BLOCK_PX = 32
"""Side in reduced px of the squares in which the noise is judged."""

HOUGH_ANGLES = 720
"""Steps of half a turn in the Hough transform."""

VOTING_STEPS = 12
"""Steps to either side of its own direction for which a valley's point votes: 3 degrees."""


@dataclasses.dataclass(frozen=True, eq=False)
class Line:
    """A straight line in ideal px, normal . (x, y) = offset, by its unit normal and the middle of its seen part, shape (2,);
    the number of valley points on it, about its length in reduced px, and the sum of their depths in the logarithm of light."""

    normal: Points
    offset: float
    middle: Points
    support: int
    strength: float


def find_lines(gray: NDArray[np.uint8], camera: Camera) -> list[Line]:
    """Return the long dark lines of a photograph (h, w), the longest first, straight once the camera's lens is taken out;
    `GridError` for nothing that looks like one."""
    factor = max(1, round(max(gray.shape) / LONGER_SIDE))
    # A shadow multiplies light: in the logarithm lines are as deep in it as beside it.
    light = np.log(reduced(gray, factor) + 4.0)
    middle = np.array([camera.width - 1, camera.height - 1]) / 2
    tries = []
    for width in BLUR_WIDTHS:
        seen, normals, depth = _valleys(light, width)
        ideal = camera.undistort((seen + 0.5) * factor - 0.5)
        known = np.isfinite(ideal).all(axis=1)
        tries.append(_straight_lines((ideal[known] - middle) / factor, normals[known], depth[known], max(light.shape)))
    # A narrow blur does not reach across a wide line, and a wide one washes thin lines out: the narrowest that shows
    # nearly as much as any is taken.
    shown = [sum(line.strength for line in lines_of_try) for lines_of_try in tries]
    lines = next(lines_of_try for lines_of_try, strength in zip(tries, shown, strict=True) if strength >= 0.8 * max(shown))
    if not lines:
        raise GridError("no grid was found: the picture shows no long dark lines (too blurred, too faint or not there)")
    return [
        dataclasses.replace(
            line, offset=line.offset * factor + float(line.normal @ middle), middle=line.middle * factor + middle
        )
        for line in lines
    ]


def reduced(gray: NDArray[np.uint8], factor: int) -> NDArray[np.float32]:
    """Return the means over squares of ``factor`` px; rows and columns that fill no square are left out."""
    height, width = (side // factor for side in gray.shape)
    whole = gray[: height * factor, : width * factor]
    if factor == 1:
        return whole.astype(np.float32)
    return cv2.resize(whole.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)


def _valleys(light: NDArray[np.float32], width: float) -> tuple[Points, Points, Points]:
    """Return the points (n, 2) on the floors of dark lines, the directions (n, 2) across them, and their depths (n,)."""
    smooth = cv2.GaussianBlur(light, (0, 0), width)
    along_x = cv2.Sobel(smooth, cv2.CV_32F, 2, 0, ksize=3) / 4
    along_y = cv2.Sobel(smooth, cv2.CV_32F, 0, 2, ksize=3) / 4
    mixed = cv2.Sobel(smooth, cv2.CV_32F, 1, 1, ksize=3) / 4
    half, mean = (along_x - along_y) / 2, (along_x + along_y) / 2
    bend = mean + np.hypot(half, mixed)
    angle = 0.5 * np.arctan2(mixed, half)  # of the largest curvature, which goes across the valley
    across = np.dstack([np.cos(angle), np.sin(angle)]).astype(np.float32)
    rows, columns = np.indices(light.shape, dtype=np.float32)

    def beside(distance: float) -> NDArray[np.float32]:
        return cv2.remap(
            smooth, columns + distance * across[..., 0], rows + distance * across[..., 1], cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip

    # Both sides must be lighter: at the edge of a shadow only one is.
    depth = np.minimum(beside(2.5 * width + 1.0), beside(-2.5 * width - 1.0)) - smooth
    lowest = (smooth <= beside(1.0)) & (smooth <= beside(-1.0)) & (bend > 0.0)
    floor = lowest & (depth > np.maximum(0.015, 2.5 * _local_noise(depth)))
    margin = int(2 * width) + 2
    floor[:margin], floor[-margin:], floor[:, :margin], floor[:, -margin:] = False, False, False, False
    y, x = np.nonzero(floor)
    return np.column_stack([x, y]).astype(float), across[y, x].astype(float), depth[y, x].astype(float)


def _local_noise(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the standard deviation of the noise around each pixel: in a shadow the logarithm makes it many times larger."""
    height, width = depth.shape
    blocks = np.abs(depth[: height // NOISE_BLOCK_PX * NOISE_BLOCK_PX, : width // NOISE_BLOCK_PX * NOISE_BLOCK_PX]).reshape(
        height // NOISE_BLOCK_PX, NOISE_BLOCK_PX, width // NOISE_BLOCK_PX, NOISE_BLOCK_PX
    )
    noise = robust.deviations(blocks, (1, 3)).astype(np.float32)
    return cv2.resize(noise, (width, height), interpolation=cv2.INTER_LINEAR)


def _straight_lines(points: Points, normals: Points, depth: Points, size: float) -> list[Line]:
    """Greedy Hough transform: take the line with the most votes, remove its points, go on."""
    shortest = 0.08 * size
    bin_width = 1.5
    steps = np.arange(-VOTING_STEPS, VOTING_STEPS + 1)
    own = np.round(np.arctan2(normals[:, 1], normals[:, 0]) * HOUGH_ANGLES / np.pi).astype(int)
    angles = (own[:, None] + steps) % HOUGH_ANGLES
    table = np.arange(HOUGH_ANGLES) * np.pi / HOUGH_ANGLES
    offsets = points[:, :1] * np.cos(table[angles]) + points[:, 1:] * np.sin(table[angles])
    reach = int(size / bin_width) + 2
    cells = angles * (2 * reach) + np.round(offsets / bin_width).astype(int) + reach
    votes = np.bincount(cells.ravel(), minlength=HOUGH_ANGLES * 2 * reach)
    left = np.ones(len(points), dtype=bool)
    lines: list[Line] = []
    for _ in range(400):
        best = int(np.argmax(votes))
        if votes[best] < 0.5 * shortest or len(lines) >= 200:
            break
        angle = table[best // (2 * reach)]
        offset = (best % (2 * reach) - reach) * bin_width
        line, on = _refined_lines(points, normals, depth, left, np.array([np.cos(angle), np.sin(angle)]), offset)
        taken = on if on.any() else left & np.any(cells == best, axis=1)
        votes -= np.bincount(cells[taken].ravel(), minlength=votes.size)
        left &= ~taken
        if line is not None and line.support >= shortest:
            lines.append(line)
    return sorted(lines, key=lambda line: -line.support)


def _refined_lines(
    points: Points, normals: Points, depth: Points, left: NDArray[np.bool_], normal: Points, offset: float
) -> tuple[Line | None, NDArray[np.bool_]]:
    on = np.zeros(len(points), dtype=bool)
    for tolerance in (3.0, 2.5, 2.5):
        on = left & (np.abs(points @ normal - offset) < tolerance) & (np.abs(normals @ normal) > 0.98)
        if on.sum() < 10:
            return None, on
        middle = points[on].mean(axis=0)
        _, _, axes = np.linalg.svd(points[on] - middle, full_matrices=False)
        normal, offset = axes[1], float(axes[1] @ middle)
    along = np.sort(points[on] @ axes[0])
    # Points strewn thinly over a long way are chance, not a line.
    dense = len(along) > 0.35 * (along[-1] - along[0])
    return (Line(normal, offset, middle, int(on.sum()), float(depth[on].sum())) if dense else None), on


# ----------------------------------------------------------------------------------------------------------------------
# The arms of a grid's crossing: cuts across them, and the straight line through each pair.


@dataclasses.dataclass(frozen=True, eq=False)
class Arms:
    """The two arms of a crossing, its centre in ideal px, along one axis of the lattice: unit vectors along and across the
    line, shape (2,), and the lengths of the cells before and behind it: in perspective one is longer."""

    centre: Points
    unit: Points
    normal: Points
    cells: tuple[float, float]

    @classmethod
    def of(cls, plane: setup.Plane, node: NDArray[np.int64], axis: int) -> Arms:
        """Return those of a crossing of the lattice."""
        half = 0.5 * np.eye(2)[axis]
        centre, ahead, behind = plane.to_pixels(np.array([node, node + half, node - half], dtype=float))
        unit = (ahead - behind) / np.linalg.norm(ahead - behind)
        cells = 2.0 * float(np.linalg.norm(ahead - centre)), 2.0 * float(np.linalg.norm(behind - centre))
        return cls(centre, unit, np.array([-unit[1], unit[0]]), cells)

    def along(self, shares: Points) -> Points:
        """Return the distances (n,) in px from the crossing for shares (n,) of the cells, negative behind it."""
        return np.where(shares > 0, *self.cells) * shares


@dataclasses.dataclass(frozen=True, eq=False)
class LineLight:
    """A photograph as the logarithm of light, shape (h, w), so many times smaller, and its camera."""

    value: NDArray[np.float32]
    factor: int
    camera: Camera

    @classmethod
    def of(cls, gray: NDArray[np.uint8], factor: int, camera: Camera) -> LineLight:
        """Return the instance for gray values (h, w)."""
        return cls(np.log(reduced(gray, factor) + 4.0), factor, camera)

    def cuts(self, arms: Arms, along: Points, across: Points) -> Points:
        """Return the light (rows, columns) at distances (rows,) along and (columns,) across arms in ideal px; NaN outside."""
        places = arms.centre + along[:, None, None] * arms.unit + across[None, :, None] * arms.normal
        raw = (self.camera.distort(places.reshape(-1, 2)).reshape(places.shape) + 0.5) / self.factor - 0.5
        height, width = self.value.shape
        inside = (raw >= 0.0).all(axis=2) & (raw[..., 0] <= width - 1) & (raw[..., 1] <= height - 1)
        x, y = np.moveaxis(raw.astype(np.float32), -1, 0)
        return np.where(inside, cv2.remap(self.value, x, y, cv2.INTER_LINEAR), np.nan)


def fit_line(shown: Points, across: Points, along: Points, depth: float) -> tuple[float, float, float] | None:
    """Return offset in px, slope, and the offset's standard error of the straight line through the darkest places of cuts (n,
    k) across it; None where too few cuts show one.

    Samples lie at ``across`` (k,), cuts at ``along`` (n,), both in px; ``depth`` is that of this grid's lines in the
    logarithm of light.
    """
    edge = max(1, len(across) // 6)
    left, right = shown[:, :edge].mean(axis=1), shown[:, -edge:].mean(axis=1)
    outer = np.abs(across[0]) - (edge - 1) / 2 * (across[1] - across[0])
    ground = (left + right)[:, None] / 2 + (right - left)[:, None] / 2 * (across / outer)
    dark = ground - shown
    dip = dark[:, np.abs(across) <= np.abs(across[0]) / 3].mean(axis=1)
    # A cut must show this grid's line, with about the same light on both of its sides: no edge of a shadow, no dust.
    good = np.isfinite(dip) & (dip > 0.35 * depth) & (dip < 1.6 * depth) & ~_shaded_cuts(left - right, depth)
    if good.sum() < max(4, 0.4 * len(along)):
        return None
    places = np.full(len(along), np.nan)
    places[good] = (dark[good] @ across) / dark[good].sum(axis=1)
    good &= np.abs(places) < 0.8 * np.abs(across[0])
    for _ in range(4):
        if good.sum() < max(4, 0.35 * len(along)):
            return None
        design = np.column_stack([np.ones(good.sum()), along[good]])
        answer = np.linalg.lstsq(design, places[good])[0]
        missed = places - answer[0] - answer[1] * along
        spread = robust.deviation(missed[good]) + 1e-3
        wanted = good & (np.abs(missed) < 3.5 * spread)
        if np.array_equal(wanted, good):
            break
        good = wanted
    design = np.column_stack([np.ones(good.sum()), along[good]])
    variance = float(np.sum(missed[good] ** 2)) / max(1, good.sum() - 2)
    error = np.sqrt(variance * np.linalg.inv(design.T @ design)[0, 0])
    return float(answer[0]), float(answer[1]), float(error)


def _shaded_cuts(difference: Points, depth: float) -> NDArray[np.bool_]:
    """Return the cuts whose sides differ in brightness because an edge of the shadow or dust is near, and the cuts beside
    them."""
    known = np.isfinite(difference)
    if not known.any():
        return ~known
    # The sides are compared over seven cuts at once, and no more strictly than noise allows.
    smooth = median_filter(np.where(known, difference, np.inf), size=7, mode="nearest")
    noise = robust.deviation(difference[known] - np.median(difference[known])) / np.sqrt(7.0)
    return maximum_filter(np.abs(smooth) > np.clip(4.0 * noise, 0.06 * depth, 0.35 * depth), size=5, mode="nearest")


# ----------------------------------------------------------------------------------------------------------------------
# Crossings of the grid measured in the photograph itself, from the four arms of each.
#
# Across an arm the line's place is its centre of darkness; a straight line through the places of both arms on either side
# carries the whole arms' precision into the crossing, whose own pixels (rounded by blur) are not used.


ARM_RANGE = (0.12, 0.44)
"""Part of the way to the next crossing over which an arm is measured; its start keeps clear of the other line."""

MAX_WINDOW_SHARE = 0.32
"""Largest half width of the window across a line, as a share of the pitch."""

MOST_ROWS = 48
"""Cuts across one arm, where it has so many pixels."""

MAX_CROSSINGS = 400
"""Crossings beyond which more of them, picked at random, would only cost time."""


def measure_crossings(
    gray: NDArray[np.uint8], camera: Camera, lattice: setup.Plane
) -> tuple[Points, NDArray[np.int64], Points]:
    """Measure every crossing in a photograph (h, w) of a rough lattice, whose metres are whole numbers of lines: places (n,
    2) in raw px, whole numbers (n, 2) and standard errors (n,) in px.

    Raises `GridError` for too few crossings, or lines too faint or too blurred.
    """
    half, depth = _line_width(gray, camera, lattice)
    plane = lattice
    for last in (False, True):
        nodes = _nodes(camera, plane)
        ideal, indices, sigma = _measure(gray, camera, plane, nodes, half, depth)
        _check_count(indices)
        if not last:
            # Windows well centred on their lines cut off no darkness on one side.
            try:
                plane = setup.Plane.fit(ideal, indices.astype(float))
            except setup.PlaneError:
                raise GridError("the grid's crossings lie on one line; show more of the grid") from None
    return camera.distort(ideal), indices, sigma


def _check_count(indices: NDArray[np.int64]) -> None:
    if len(indices) < MIN_LINES or any(np.ptp(indices, axis=0) < 1):
        raise GridError(f"only {len(indices)} crossings of the grid can be measured; at least {MIN_LINES} are needed")


def _nodes(camera: Camera, plane: setup.Plane) -> NDArray[np.int64]:
    """Return the whole numbers (n, 2) of the crossings that may be seen in the picture, `MAX_CROSSINGS` of them at most."""
    x, y = np.linspace(0, camera.width - 1, 12), np.linspace(0, camera.height - 1, 12)
    rim = np.array([*((u, v) for u in x for v in (y[0], y[-1])), *((u, v) for v in y for u in (x[0], x[-1]))])
    ideal = camera.undistort(rim)
    reach = plane.to_metres(ideal[np.isfinite(ideal).all(axis=1)])
    low, high = np.ceil(reach.min(axis=0)).astype(int), np.floor(reach.max(axis=0)).astype(int)
    if np.prod(high - low + 1.0) > 20000.0:
        raise GridError("the lines found make a grid finer than the picture can show; no regular grid can be seen")
    i, j = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
    nodes = np.column_stack([i.ravel(), j.ravel()])
    seen = camera.distort(plane.to_pixels(nodes.astype(float)))
    inside = np.all((seen > 2.0) & (seen < np.array([camera.width - 3.0, camera.height - 3.0])), axis=1)
    seen_nodes = nodes[inside]
    if len(seen_nodes) <= MAX_CROSSINGS:
        return seen_nodes
    return seen_nodes[np.sort(np.random.default_rng(0).choice(len(seen_nodes), MAX_CROSSINGS, replace=False))]


def _pitch_px(plane: setup.Plane, node: NDArray[np.int64]) -> Points:
    """Return the distance in px (2,) between the lines that run along the first and the second axis, measured across them."""
    axes = np.linalg.inv(plane.jacobian(plane.to_pixels(node.astype(float)))[0])
    area = abs(np.linalg.det(axes))
    return area / np.linalg.norm(axes, axis=0)


def _line_width(gray: NDArray[np.uint8], camera: Camera, lattice: setup.Plane) -> tuple[float, float]:
    """Return half width of the window a line needs, as a share of the pitch, and the line's depth in the logarithm of light."""
    nodes = _nodes(camera, lattice)
    if len(nodes) < MIN_LINES:
        raise GridError(f"only {len(nodes)} crossings of the grid are in the picture; at least {MIN_LINES} are needed")
    shares = np.linspace(-0.6, 0.6, 241)
    along = np.concatenate([np.linspace(*ARM_RANGE, 8), -np.linspace(*ARM_RANGE, 8)])
    light = LineLight.of(gray, 1, camera)
    cuts: tuple[list[Points], list[Points]] = ([], [])
    for node in nodes[:: max(1, len(nodes) // 60)]:
        pitch = _pitch_px(lattice, node)
        for axis in (0, 1):
            arms = Arms.of(lattice, node, axis)
            shown = light.cuts(arms, arms.along(along), shares * pitch[axis])
            for arm in (shown[:8], shown[8:]):
                if np.isfinite(arm[:, np.abs(shares) < 0.45]).all():
                    cuts[axis].append(_centred_cut(arm.mean(axis=0), shares))
    if min(len(cuts[0]), len(cuts[1])) < 2:
        raise GridError("too few arms of the grid's crossings are in the picture; show more of the grid")
    for axis in (0, 1):
        _check_between(_typical_spacing(cuts[axis]), shares)
    mean = _typical_spacing([*cuts[0], *cuts[1]])[np.abs(shares) < 0.45]
    shares = shares[np.abs(shares) < 0.45]
    middle_of = len(shares) // 2
    level = float(np.nanpercentile(mean, 75))
    middle = np.abs(shares) < 0.03
    depth = level - float(np.nanmin(mean[middle]))
    if not depth > 0.02:
        raise GridError("the grid's lines are too faint or too blurred to be measured")
    dark = np.flatnonzero(~(mean < level - 0.5 * depth))
    width = (
        shares[dark[dark > middle_of].min()] - shares[dark[dark < middle_of].max()]
        if (dark > middle_of).any() and (dark < middle_of).any()
        else 1.0
    )
    if width > 0.3:
        raise GridError("the grid's lines are too wide or too blurred to be distinguished from the screen between them")
    return float(np.clip(1.3 * width, 0.03, MAX_WINDOW_SHARE)), depth


def _typical_spacing(cuts: list[Points]) -> Points:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # places that no cut reaches stay NaN
        return np.nanmedian(cuts, axis=0)


def _check_between(mean: Points, shares: Points) -> None:
    """Reject a lattice with lines half way between its lines: every second one was missed."""
    own = np.nanmin(mean[np.abs(shares) < 0.05])
    screen = np.nanmedian(mean[(np.abs(shares) > 0.2) & (np.abs(shares) < 0.4)])
    half_way = mean[np.abs(np.abs(shares) - 0.5) < 0.06]
    between = np.min(half_way[np.isfinite(half_way)], initial=np.inf)
    if screen - between > 0.5 * (screen - own) > 0.0:
        raise GridError("the lines can be counted in more than one way: there are lines between those that were counted")


def _centred_cut(cut: Points, shares: Points) -> Points:
    """Return the cut moved so that its darkest place within reach of the rough lattice lies in the middle."""
    smooth = np.convolve(np.where(np.isfinite(cut), cut, np.inf), np.ones(7) / 7, mode="same")
    reach = np.abs(shares) < 0.15
    moved = int(np.flatnonzero(reach)[np.argmin(smooth[reach])] - len(shares) // 2)
    return np.interp(np.arange(len(cut)) + moved, np.arange(len(cut)), cut, left=np.nan, right=np.nan) - np.nanmedian(cut)


def _measure(
    gray: NDArray[np.uint8], camera: Camera, plane: setup.Plane, nodes: NDArray[np.int64], half: float, depth: float
) -> tuple[Points, NDArray[np.int64], Points]:
    pitches = [_pitch_px(plane, node) for node in nodes]
    spacing = float(np.median(pitches))
    # Eight pixels over the line are enough to find its centre, and their means hold all the light there is.
    factor = max(1, int(half * spacing / 8.0))
    light = LineLight.of(gray, factor, camera)
    places, numbers, errors = [], [], []
    for node, pitch in zip(nodes, pitches, strict=True):
        fits = []
        for axis in (0, 1):
            rows = int(np.clip((ARM_RANGE[1] - ARM_RANGE[0]) * pitch[1 - axis] / factor, 4, MOST_ROWS))
            along = np.concatenate([-np.linspace(ARM_RANGE[1], ARM_RANGE[0], rows), np.linspace(*ARM_RANGE, rows)])
            reach = max(half * pitch[axis], 2.5)
            # Three samples a pixel: with one, a sharp line's centre of darkness depends on where the samples fall.
            columns = 2 * int(np.clip(3.0 * reach / factor, 8, 60)) + 1
            across = np.linspace(-reach, reach, columns)
            arms = Arms.of(plane, node, axis)
            distance = arms.along(along)
            fitted = fit_line(light.cuts(arms, distance, across), across, distance, depth)
            if fitted is not None:
                fits.append((arms, *fitted))
        if len(fits) < 2:
            continue
        point, error = _cross(fits)
        if np.isfinite(point).all() and error < 0.02 * spacing:
            places.append(point)
            numbers.append(node)
            errors.append(error)
    return np.array(places).reshape(-1, 2), np.array(numbers, dtype=int).reshape(-1, 2), np.array(errors)


def _cross(fits: list[tuple[Arms, float, float, float]]) -> tuple[Points, float]:
    """Return where the two fitted lines of a crossing meet (ideal px), and its standard error per axis."""
    rows = np.array([arms.normal - arms.unit * slope for arms, _, slope, _ in fits])
    right = [row @ arms.centre + offset for row, (arms, offset, _, _) in zip(rows, fits, strict=True)]
    back = np.linalg.inv(rows)
    return back @ np.array(right), float(np.sqrt(np.sum((back * [error for *_, error in fits]) ** 2) / 2.0))


# ----------------------------------------------------------------------------------------------------------------------
# Lines sorted into two pencils and counted: which line of the grid is which.


PENCIL_TOLERANCE = np.sin(np.radians(1.5))
"""Sine of the largest angle by which a line of a pencil may miss their common vanishing point."""

OFF_BEAT = 0.15
"""Largest distance of a line from its whole number, as a share of the pitch."""


def count_lines(lines: list[Line], camera: Camera) -> setup.Plane:
    """Return the lattice that the lines form, as a plane whose metres are whole numbers of lines; `GridError` for no two
    pencils of lines that cross, or lines that are not equally spaced."""
    centre = np.array([camera.width - 1, camera.height - 1]) / 2
    scale = float(np.hypot(*centre))
    rows = np.array([[*line.normal, (line.normal @ centre - line.offset) / scale] for line in lines])
    middles = np.array([(line.middle - centre) / scale for line in lines])
    weights = np.array([float(line.support) for line in lines])
    free = np.ones(len(lines), dtype=bool)
    first, weight = _pencil(rows, middles, weights, free)
    crossing = free & ~first & (np.abs(rows[:, :2] @ _mean_direction(rows[first], weights[first])) > np.sin(np.radians(20.0)))
    second, other = _pencil(rows, middles, weights, crossing)
    if min(first.sum(), second.sum()) < 2 or first.sum() + second.sum() < 5:
        raise GridError(
            f"no grid was found: {int(first.sum())} and {int(second.sum())} lines cross, but 3 and 2 are the fewest"
        )
    places, numbers = [], []
    for members, across in ((first, other), (second, weight)):
        # With both vanishing points taken to infinity and the picture's centre to the origin, a line of the grid lies at
        # one number, and the numbers of a family are equally spaced.
        at = -rows[members, 2] / (rows[members] @ across)
        counted, kept = _whole_numbers(at, weights[members])
        places.append(rows[members][kept])
        numbers.append(counted)
    crossings, indices = [], []
    for (row, i), (column, j) in itertools.product(
        zip(places[0], numbers[0], strict=True), zip(places[1], numbers[1], strict=True)
    ):
        point = np.cross(row, column)
        crossings.append(point[:2] / point[2] * scale + centre)
        indices.append((j, i))
    try:
        return setup.Plane.fit(np.array(crossings), np.array(indices, dtype=float))
    except setup.PlaneError:
        raise GridError("the lines found cross in too few places to form a grid; show more of the grid") from None


def _mean_direction(rows: Points, weights: Points) -> Points:
    """Return the mean direction of lines, whose normals may point either way."""
    _, _, axes = np.linalg.svd(rows[:, :2] * weights[:, None])
    return np.array([-axes[0, 1], axes[0, 0]])


def _pencil(rows: Points, middles: Points, weights: Points, free: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], Points]:
    """Return the heaviest set of free lines with a common vanishing point, and that point (homogeneous, norm 1)."""
    best, chosen = 0.0, np.zeros(len(rows), dtype=bool)
    candidates = np.flatnonzero(free)[:40]
    for i, j in itertools.combinations(candidates, 2):
        # Lines of one family stay within this angle of each other in any usable photograph.
        if abs(rows[i, :2] @ rows[j, :2]) < np.cos(np.radians(35.0)):
            continue
        members = free & _lines_of_pencil(rows, middles, np.cross(rows[i], rows[j]))
        # Nearly one line seen twice makes a pencil with everything that crosses it there.
        if weights[members].sum() > best:
            best, chosen = float(weights[members].sum()), members
    point = np.zeros(3)
    for _ in range(3):
        if chosen.sum() < 2:
            return np.zeros(len(rows), dtype=bool), point
        _, _, axes = np.linalg.svd(rows[chosen] * weights[chosen, None])
        point = axes[2]
        chosen = free & _lines_of_pencil(rows, middles, point)
    return chosen, point


def _lines_of_pencil(rows: Points, middles: Points, point: Points) -> NDArray[np.bool_]:
    towards = point[:2] - middles * point[2]
    length = np.linalg.norm(towards, axis=1)
    # A vanishing point inside the picture is no vanishing point.
    outside = abs(point[2]) * 1.2 < np.linalg.norm(point[:2])
    return outside & (np.abs(np.sum(rows[:, :2] * towards, axis=1)) < PENCIL_TOLERANCE * np.maximum(length, 1e-12))


def _whole_numbers(at: Points, weights: Points) -> tuple[NDArray[np.int64], NDArray[np.intp]]:
    """Return the whole numbers for lines at equally spaced places, and which of the lines they belong to."""
    order = np.argsort(at)
    place, weight = at[order], weights[order]
    span = place[-1] - place[0]
    best, chosen = -np.inf, (1.0, 0.0)
    gaps = [(place[j] - place[i]) / (j - i) for i, j in itertools.combinations(range(len(place)), 2) if j - i <= 4]
    steps = sorted({float(f"{gap / part:.3g}") for gap in gaps for part in (1, 2, 3) if gap / part > span / 300})
    typical = float(np.median(weight))
    for step in steps:
        for start in place[np.argsort(-weight)[:4]]:
            score = _score(place, weight, step, start, typical)
            if score > best:
                best, chosen = score, (step, start)
    if not np.isfinite(best):
        raise GridError("the lines found are not equally spaced; no regular grid can be seen")
    numbers, near = _numbers(place, *chosen)
    # Of several lines with one number the longest counts.
    kept = [
        int(max(np.flatnonzero(near & (numbers == number)), key=lambda index: weight[index]))
        for number in np.unique(numbers[near])
    ]
    if len(kept) < 2 or weight[kept].sum() < 0.5 * weight.sum():
        raise GridError("the lines found are not equally spaced; no regular grid can be seen")
    return numbers[kept], order[kept]


def _numbers(place: Points, step: float, start: float) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    numbers = np.round((place - start) / step).astype(int)
    # The first fit of the vanishing points is rough, so step and start are fitted before lines are judged.
    near = np.abs(place - start - numbers * step) < 2 * OFF_BEAT * step
    if len(np.unique(numbers[near])) >= 2:
        slope, base = np.polyfit(numbers[near], place[near], 1)
        near = np.abs(place - base - numbers * slope) < OFF_BEAT * abs(slope)
    return numbers, near


def _score(place: Points, weight: Points, step: float, start: float, typical: float) -> float:
    """Return the weight of the lines on the beat, less half a line for every beat without one."""
    numbers, near = _numbers(place, step, start)
    beats = np.unique(numbers[near])
    if len(beats) < 2:
        return -np.inf
    longest = np.zeros(np.ptp(beats) + 1)
    np.maximum.at(longest, numbers[near] - beats[0], weight[near])
    return float(longest.sum()) - 0.5 * typical * float(np.ptp(beats) + 1 - len(beats))
