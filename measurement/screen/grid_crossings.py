"""Crossings of the grid measured in the photograph itself, from the four arms of each.

Across an arm the line's place is its centre of darkness; a straight line through the places of both arms on either side
carries the whole arms' precision into the crossing, whose own pixels (rounded by blur) are not used.
"""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from measurement.camera.camera import Camera, Points
from measurement.screen.grid_arms import Arms, LineLight, fit_line
from measurement.screen.grid_error import FEWEST, GridError
from measurement.screen.plane import Plane, PlaneError

ARM = (0.12, 0.44)
"""Part of the way to the next crossing over which an arm is measured; its start keeps clear of the other line."""

WIDEST = 0.32
"""Largest half width of the window across a line, as a share of the pitch."""

MOST_ROWS = 48
"""Cuts across one arm, where it has so many pixels."""

ENOUGH = 400
"""Crossings beyond which more of them, picked at random, would only cost time."""


def measure_crossings(
    gray: NDArray[np.uint8], camera: Camera, lattice: Plane
) -> tuple[Points, NDArray[np.int64], Points]:
    """Measure every crossing of the lattice that lies in the picture.

    Args:
        gray: Photograph (h, w).
        camera: The camera.
        lattice: Rough plane whose metres are whole numbers of lines.

    Returns:
        Crossings (n, 2) in raw px, their whole numbers (n, 2) and standard errors (n,) in px.

    Raises:
        GridError: Too few crossings, or lines too faint or too blurred.
    """
    half, depth = _line_width(gray, camera, lattice)
    plane = lattice
    for last in (False, True):
        nodes = _nodes(camera, plane)
        ideal, indices, sigma = _measure(gray, camera, plane, nodes, half, depth)
        if len(indices) < FEWEST or any(np.ptp(indices, axis=0) < 1):
            raise GridError(f"only {len(indices)} crossings of the grid can be measured; at least {FEWEST} are needed")
        if not last:
            # Windows well centred on their lines cut off no darkness on one side.
            try:
                plane = Plane.fit(ideal, indices.astype(float))
            except PlaneError:
                raise GridError("the grid's crossings lie on one line; show more of the grid") from None
    return camera.distort(ideal), indices, sigma


def _nodes(camera: Camera, plane: Plane) -> NDArray[np.int64]:
    """Whole numbers (n, 2) of the crossings that may be seen in the picture, `ENOUGH` of them at most."""
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
    if len(seen_nodes) <= ENOUGH:
        return seen_nodes
    return seen_nodes[np.sort(np.random.default_rng(0).choice(len(seen_nodes), ENOUGH, replace=False))]


def _pitch_px(plane: Plane, node: NDArray[np.int64]) -> Points:
    """Distance in px (2,) between the lines that run along the first and the second axis, measured across them."""
    axes = np.linalg.inv(plane.jacobian(plane.to_pixels(node.astype(float)))[0])
    area = abs(np.linalg.det(axes))
    return area / np.linalg.norm(axes, axis=0)


def _line_width(gray: NDArray[np.uint8], camera: Camera, lattice: Plane) -> tuple[float, float]:
    """Half width of the window a line needs, as a share of the pitch, and the line's depth in the logarithm of light."""
    nodes = _nodes(camera, lattice)
    if len(nodes) < FEWEST:
        raise GridError(f"only {len(nodes)} crossings of the grid are in the picture; at least {FEWEST} are needed")
    shares = np.linspace(-0.6, 0.6, 241)
    along = np.concatenate([np.linspace(*ARM, 8), -np.linspace(*ARM, 8)])
    light = LineLight.of(gray, 1, camera)
    cuts: tuple[list[Points], list[Points]] = ([], [])
    for node in nodes[:: max(1, len(nodes) // 60)]:
        pitch = _pitch_px(lattice, node)
        for axis in (0, 1):
            arms = Arms.of(lattice, node, axis)
            shown = light.cuts(arms, arms.along(along), shares * pitch[axis])
            for arm in (shown[:8], shown[8:]):
                if np.isfinite(arm[:, np.abs(shares) < 0.45]).all():
                    cuts[axis].append(_centred(arm.mean(axis=0), shares))
    if min(len(cuts[0]), len(cuts[1])) < 2:
        raise GridError("too few arms of the grid's crossings are in the picture; show more of the grid")
    for axis in (0, 1):
        _check_between(_typical(cuts[axis]), shares)
    mean = _typical([*cuts[0], *cuts[1]])[np.abs(shares) < 0.45]
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
        raise GridError("the grid's lines are too wide or too blurred to be told from the screen between them")
    return float(np.clip(1.3 * width, 0.03, WIDEST)), depth


def _typical(cuts: list[Points]) -> Points:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # places that no cut reaches stay NaN
        return np.nanmedian(cuts, axis=0)


def _check_between(mean: Points, shares: Points) -> None:
    """Refuse a lattice with lines half way between its lines: every second one was missed."""
    own = np.nanmin(mean[np.abs(shares) < 0.05])
    screen = np.nanmedian(mean[(np.abs(shares) > 0.2) & (np.abs(shares) < 0.4)])
    half_way = mean[np.abs(np.abs(shares) - 0.5) < 0.06]
    between = np.min(half_way[np.isfinite(half_way)], initial=np.inf)
    if screen - between > 0.5 * (screen - own) > 0.0:
        raise GridError(
            "the lines can be counted in more than one way: there are lines between those that were counted"
        )


def _centred(cut: Points, shares: Points) -> Points:
    """The cut moved so that its darkest place within reach of the rough lattice lies in the middle."""
    smooth = np.convolve(np.where(np.isfinite(cut), cut, np.inf), np.ones(7) / 7, mode="same")
    reach = np.abs(shares) < 0.15
    moved = int(np.flatnonzero(reach)[np.argmin(smooth[reach])] - len(shares) // 2)
    return np.interp(np.arange(len(cut)) + moved, np.arange(len(cut)), cut, left=np.nan, right=np.nan) - np.nanmedian(
        cut
    )


def _measure(
    gray: NDArray[np.uint8], camera: Camera, plane: Plane, nodes: NDArray[np.int64], half: float, depth: float
) -> tuple[Points, NDArray[np.int64], Points]:
    pitches = [_pitch_px(plane, node) for node in nodes]
    spacing = float(np.median(pitches))
    # Eight pixels over the line are enough to find its centre, and their means hold all the light there is.
    factor = max(1, int(half * spacing / 8.0))
    light = LineLight.of(gray, factor, camera)
    found, numbers, errors = [], [], []
    for node, pitch in zip(nodes, pitches, strict=True):
        fits = []
        for axis in (0, 1):
            rows = int(np.clip((ARM[1] - ARM[0]) * pitch[1 - axis] / factor, 4, MOST_ROWS))
            along = np.concatenate([-np.linspace(ARM[1], ARM[0], rows), np.linspace(*ARM, rows)])
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
            found.append(point)
            numbers.append(node)
            errors.append(error)
    return np.array(found).reshape(-1, 2), np.array(numbers, dtype=int).reshape(-1, 2), np.array(errors)


def _cross(fits: list[tuple[Arms, float, float, float]]) -> tuple[Points, float]:
    """Where the two fitted lines of a crossing meet (ideal px), and its standard error per axis."""
    rows = np.array([arms.normal - arms.unit * slope for arms, _, slope, _ in fits])
    right = [row @ arms.centre + offset for row, (arms, offset, _, _) in zip(rows, fits, strict=True)]
    back = np.linalg.inv(rows)
    return back @ np.array(right), float(np.sqrt(np.sum((back * [error for *_, error in fits]) ** 2) / 2.0))
