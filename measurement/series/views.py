"""Side views: tip, angle, centre line and outline of a device of any kind in every photograph of a list.

Lengths hold in the device's middle plane, in which it moves. The scale may lie in another plane, parallel to it: from the
camera's place every plane is a scaled copy of every other one, about the camera's foot. A device that is as deep as it is wide
shows the edge of its front face where its outline looks away from that foot, and the edge of its rear face elsewhere; both are
brought to the middle plane. Errors come from repeats of the whole evaluation with everything that is not known exactly varied.
"""

from __future__ import annotations

import csv
import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from scipy.optimize import brentq

from measurement import pictures
from measurement.outline import dots, silhouette
from measurement.outline.outline import Outline, OutlineError, history_text
from measurement.screen.setup import Setup, SetupError
from measurement.series import checks, drawing, markers, measuring
from measurement.series.photo_list import Photograph
from measurement.series.witness import Refusal
from softmodels.common import units
from softmodels.common.arrays import Array


@dataclasses.dataclass(frozen=True, eq=False)
class Scene:
    """What stays the same in all photographs of a device from the side.

    Attributes:
        setup: Camera and plane of the scale, its magnification 1.
        camera_distance: From the camera to the device's middle plane, and its standard error, in m.
        depth: Size of the device along the line of sight in m at its edge from the base's first end to the tip, and at that
            from the tip to the second one; 0 for a round one, of which the widest part is seen.
        ahead: How far the device's middle plane lies before the scale's, towards the camera, and its standard error, in m.
        base: Two pixels (2, 2) at the ends of the face at which the device begins; None where the frame cuts it there.
        length: Length of the device's centre line without pressure in m, and its standard error; None where it is not known.
        sides: Distances (k, 2) in m of both edges, at equal steps along the device without pressure, from the straight line
            that leaves the base's middle across it; the photograph without pressure tells which one begins at the base's first
            end. None where that is known.
        in_space: Whether the device may leave the plane, since a second view shows how far.
    """

    setup: Setup
    camera_distance: tuple[float, float]
    depth: tuple[float, float] = (0.0, 0.0)
    ahead: tuple[float, float] = (0.0, 0.0)
    base: Array | None = None
    length: tuple[float, float] | None = None
    sides: Array | None = None
    in_space: bool = False

    def __post_init__(self) -> None:
        far, near = self.camera_distance[0], abs(self.ahead[0]) + 0.5 * max(self.depth)
        if (
            not (math.isfinite(far) and far > 2.0 * near)
            or min(self.depth) < 0.0
            or min(self.camera_distance[1], self.ahead[1]) < 0.0
        ):
            raise SetupError(
                f"a camera at {far * 1e3:g} mm (--camera-distance) cannot see a device {max(self.depth) * 1e3:g} mm deep "
                f"(--depth) at {self.ahead[0] * 1e3:g} mm before the scale (--ahead); give positive lengths, the camera "
                "farthest away"
            )
        if self.setup.magnification != 1.0:
            raise SetupError(
                "the setup has the magnification of a shadow; for side views make it without --lamp-distance and "
                "--screen-distance, and give --camera-distance and --ahead"
            )

        object.__setattr__(self, "setup", _upright(self.setup))
        _ = self.foot  # which no camera has at some distances

    @functools.cached_property
    def foot(self) -> Array:
        """Where the camera stands above the scale's plane, shape (2,), m."""
        setup, far = self.setup, self.camera_distance[0] + self.ahead[0]

        def above(focal: float) -> Array:
            matrix = setup.camera.matrix.copy()
            matrix[0, 0] = matrix[1, 1] = focal
            seen = np.linalg.inv(matrix) @ np.linalg.inv(setup.plane.homography)
            seen = seen / np.mean(np.linalg.norm(seen[:, :2], axis=0))
            first, second = seen[:, 0], seen[:, 1]
            turn = np.column_stack([first, second, np.cross(first, second)])
            return np.asarray(-np.linalg.solve(turn, seen[:, 2]))

        longest = max(setup.camera.size)
        low, high = 0.05 * longest, 200.0 * longest
        missed = [abs(above(focal)[2]) - far for focal in (low, high)]
        if missed[0] * missed[1] > 0.0:
            raise SetupError(
                f"no camera at {far * 1e3:.4g} mm from the scale sees it this large; check --camera-distance and the scale"
            )
        return above(brentq(lambda focal: abs(above(focal)[2]) - far, low, high))[:2]

    def to_metres(self, px: Array, normal: Array | None = None, side: Array | float = 0.5) -> Array:
        """Return places (n, 2) in m in the device's middle plane of pixels (n, 2), of points of its outline where the unit
        vectors (n, 2) away from the device in the picture and their sides (n,) are given."""
        far = self.camera_distance[0]
        share = np.full(len(px), 0.5) if self.sides is not None else np.broadcast_to(side, len(px))
        half = 0.5 * np.interp(share, [0.0, 1.0], self.depth)
        seen = self.setup.to_metres(px)
        offset = (seen - self.foot) * far / (far + self.ahead[0])
        if normal is not None and max(self.depth) > 0.0:
            outwards = self.setup.to_metres(px + normal) - seen
            front = np.einsum("ni,ni->n", outwards, offset) > 0.0
            offset = offset * np.where(front, (far - half) / far, (far + half) / far)[:, None]
        return self.foot + offset

    def on_front(self, px: Array) -> tuple[Array, Array]:
        """Return places (n, 2) in m of pixels (n, 2) on the device's face towards the camera, and by how much in m these appear
        to move if they move towards the camera, per m."""
        far, half = self.camera_distance[0], 0.5 * max(self.depth)
        offset = (self.setup.to_metres(px) - self.foot) * (far - half) / (far + self.ahead[0])
        return self.foot + offset, offset / (far - half)

    def to_pixels(self, metres: Array) -> Array:
        """Return pixels (n, 2) of places (n, 2) in m in the device's middle plane."""
        far = self.camera_distance[0]
        return self.setup.to_pixels(self.foot + (metres - self.foot) * (far + self.ahead[0]) / far)

    def strip(self, place: Array) -> float:
        """Return the width in m at which a face along the line of sight is seen, at a place (2,)."""
        return max(self.depth) * float(np.linalg.norm(place - self.foot)) / self.camera_distance[0]

    def told_apart(self, shape: silhouette.Shape, outline: Array) -> Scene:
        """Return the scene with both edges told apart by the shape and the outline (n, 2) in m without pressure."""
        if self.sides is None:
            return self
        way = np.array([math.cos(shape.direction), math.sin(shape.direction)])
        offset = outline - shape.base
        across = offset @ [-way[1], way[0]]
        across = across * math.copysign(1.0, across[0])  # the first end is on the positive side
        slice_of = np.clip(offset @ way / shape.length * len(self.sides), 0, len(self.sides) - 1).astype(int)
        seen = np.zeros_like(self.sides)
        for column, sign in enumerate((1.0, -1.0)):
            np.maximum.at(seen[:, column], slice_of, sign * across)
        missed = [float(np.abs(seen - sides).sum()) for sides in (self.sides, self.sides[:, ::-1])]
        return dataclasses.replace(self, sides=None, depth=self.depth if missed[0] <= missed[1] else self.depth[::-1])

    def scaled_by(self, view: View) -> Scene:
        """Return the scene with a scale whose error tells the device's length without pressure, and its stated one, apart."""
        if self.length is None:
            return self
        length, error = self.length
        off = abs(view.shape.length - length) - 2.0 * math.hypot(error, view.length_error)
        share = math.hypot(self.setup.pitch_error, max(0.0, off / length))
        return dataclasses.replace(self, setup=dataclasses.replace(self.setup, pitch_error=share))

    def varied(self, random: np.random.Generator) -> Scene:
        """Return the scene with its uncertain numbers drawn anew."""
        plane = self.setup.plane
        drawn = random.multivariate_normal(np.zeros(9), plane.covariance, method="svd").reshape(3, 3)
        plane = dataclasses.replace(plane, homography=plane.homography + drawn)
        scale = 1.0 + self.setup.pitch_error * random.standard_normal()
        plane = dataclasses.replace(plane, homography=np.diag([scale, scale, 1.0]) @ plane.homography)
        near, far = (value + error * random.standard_normal() for value, error in (self.ahead, self.camera_distance))
        setup = dataclasses.replace(self.setup, plane=plane)
        return dataclasses.replace(
            self, setup=setup, ahead=(near, 0.0), camera_distance=(max(far, 0.2 * self.camera_distance[0]), 0.0)
        )


def _upright(setup: Setup) -> Setup:
    """Return the setup with the plane's axes exchanged or turned round so that x runs to the right in the picture and z up: a
    board counts its squares from whatever corner it finds first."""
    middle = (np.array([setup.camera.size]) - 1.0) / 2.0
    seen = setup.jacobian(middle)[0] * [1.0, -1.0]
    axes = [np.array([[a, 0.0], [0.0, b]])[list(order)] for a in (1.0, -1.0) for b in (1.0, -1.0) for order in ((0, 1), (1, 0))]
    turn = np.eye(3)
    turn[:2, :2] = max(axes, key=lambda axis: float(np.trace(axis @ seen)))
    plane = setup.plane
    big = np.kron(turn, np.eye(3))
    plane = dataclasses.replace(
        plane, homography=turn @ plane.homography, covariance=big @ plane.covariance @ big.T,
        targets=plane.targets @ turn[:2, :2].T,
    )  # fmt: skip
    return dataclasses.replace(setup, plane=plane)


@dataclasses.dataclass(frozen=True, eq=False)
class View:
    """A device at one pressure, seen from the side: places in m in its plane of motion, x to the right and z up in the
    scale's plane.

    Attributes:
        shape: Centre line, tip and angle.
        outline: Points (n, 2) of the outline in m from one end of the base around the tip to the other.
        outline_error: Standard error (n,) of each in m.
        tip_error: Standard errors (2,) in m of the tip's place from the base's middle.
        angle_error: Standard error of the tip's angle in rad.
        length_error: Standard error of the centre line's length in m.
        line_error: Standard error (k,) in m of the centre line's points across it.
        pressure, pressure_error: Pressure and its standard error in Pa.
        source: Name of the photograph's file.
        reasons: What speaks against it, one sentence each; empty if it is trusted.
        anyway: Whether it shall be used in spite of them.
        markers: What the photograph shows of markers on the device.
        parallax: By how much in m the tip (2,) appears to move if it moves towards the camera, per m.
        parallax_error: Its standard error on each axis.
    """

    shape: silhouette.Shape
    outline: Array
    outline_error: Array
    tip_error: Array
    angle_error: float
    length_error: float
    line_error: Array
    pressure: float
    pressure_error: float
    source: str
    reasons: tuple[str, ...] = ()
    anyway: bool = False
    markers: tuple[markers.Marker, ...] = ()
    parallax: Array = dataclasses.field(default_factory=lambda: np.zeros(2))
    parallax_error: float = 0.0

    @property
    def radius(self) -> float:
        """Half the device's width in m before its tip."""
        return 0.5 * float(np.median(self.shape.width[-len(self.shape.width) // 5 : -len(self.shape.width) // 12]))

    @property
    def trust(self) -> str:
        """``"yes"``, ``"no"``, or ``"anyway"`` where it shall be used in spite of what speaks against it."""
        return "yes" if not self.reasons else "anyway" if self.anyway else "no"

    def to_csv(self, path: Path, origin: Array) -> None:
        """Write the outline and the centre line from an origin (2,) in m as curves by arc length."""
        with path.open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(CURVE_COLUMNS)
            turned = self.shape.curvature
            for name, points, error, bend in (
                ("outline", self.outline, self.outline_error, None), ("centre_line", self.shape.line, self.line_error, turned),
            ):  # fmt: skip
                arc = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
                for k, (x, z) in enumerate(points - origin):
                    curvature = "" if bend is None else f"{bend[k]:.5g}"
                    rows.writerow((name, f"{arc[k]:.9g}", f"{x:.9g}", f"{z:.9g}", f"{error[k]:.4g}", curvature))


CURVE_COLUMNS = ("curve", "arc_length_m", "x_m", "z_m", "error_m", "curvature_1/m")

REPEAT_COUNT = 24
"""Repeats from whose scatter the errors come."""

SHARED_PX = 0.07
"""Standard error in px by which the whole edge may lie too far out: tone curve, sharpening, colours that JPEG files blur."""

MODEL_PX = 0.1
"""Standard error in px of the tip and of the centre line that smoothing and corners leave."""

ASLANT_SHARE = 0.05
"""Standard error of the tip and of the outline as a share of the strip that is seen aslant of a face along the line of sight:
where it is hardly darker or brighter than the front face, the edge is drawn towards its inner side."""

FOLDED_SHARE = 0.01
"""Standard error of the centre line of a device with folds, as a share of its width: between chambers an edge is a guess."""

BULGING_SHARE = 0.2
"""The same where the tip's face bulges: the picture shows its corners somewhere between the front face and the middle plane."""


def view_of(
    image: pictures.Pixels, seen: silhouette.Silhouette, scene: Scene, photo: Photograph, reference: Reference | None = None
) -> View:
    """Return what a photograph (h, w, 3) and the silhouette in it show; ``reference`` is the photograph without pressure.
    Raises `Unmeasurable` for no device, or one that the checks reject."""
    out = _outwards(seen)
    shape, outline = _evaluated(seen, seen.edge.px, out, scene)
    shape = dataclasses.replace(shape, uneven=max(shape.uneven, 2.0 * seen.notched))
    random = np.random.default_rng(52)
    lens = scene.setup.camera.error(seen.edge.px)
    shapes, outlines, slopes = [], [], []
    for _ in range(REPEAT_COUNT):
        moved = seen.edge.error * random.standard_normal(len(lens)) + SHARED_PX * random.standard_normal()
        px = seen.edge.px + moved[:, None] * out + lens[:, None] * _field(seen.edge.px, scene, random)
        varied = scene.varied(random)
        try:
            repeat, points = _evaluated(seen, px, out, varied, shape.line)
        except pictures.Unmeasurable:
            continue
        shapes.append(repeat)
        outlines.append(points - repeat.base)
        slopes.append((repeat.tip - varied.foot) / varied.camera_distance[0])
    if len(shapes) < REPEAT_COUNT // 2:
        raise pictures.Unmeasurable(
            "the outline is too noisy for a centre line; photograph it again with more light and contrast"
        )
    pixel = float(np.sqrt(abs(np.linalg.det(scene.setup.jacobian(seen.edge.px.mean(axis=0)[None])[0]))))
    tips = np.array([shape.tip - shape.base for shape in shapes])
    turned = np.angle(np.exp(1j * np.array([repeat.angle - shape.angle for repeat in shapes])))
    lines = np.array([repeat.line - repeat.base for repeat in shapes])
    normal = silhouette.normals(shape.line)
    across = np.einsum("rki,ki->rk", lines - lines.mean(axis=0), normal)
    strip = scene.strip(shape.tip)
    model, place = MODEL_PX * pixel, math.hypot(MODEL_PX * pixel, (BULGING_SHARE if shape.bulges else ASLANT_SHARE) * strip)
    across_face, width = place if shape.bulges else model, float(np.median(shape.width))
    tip_error = np.hypot(np.std(tips, axis=0, ddof=1), math.hypot(place, 0.5 * width * shape.uneven))
    passed = model + (FOLDED_SHARE * width if seen.folded.any() else 0.0)
    view = View(
        shape, outline, np.hypot(_spread(np.array(outlines)), place), tip_error,
        math.hypot(float(np.std(turned, ddof=1)), across_face / width, shape.uneven),
        math.hypot(float(np.std([repeat.length for repeat in shapes], ddof=1)), model),
        np.hypot(np.std(across, axis=0, ddof=1), passed), photo.pressure, photo.pressure_error, photo.file.name,
        anyway=photo.anyway, parallax=(shape.tip - scene.foot) / scene.camera_distance[0],
        parallax_error=float(np.std(slopes, axis=0, ddof=1).max()),
    )  # fmt: skip
    before, seen_before = (None, None) if reference is None else (reference.view.shape, reference.seen)
    changed = since(None if reference is None else (reference.image, reference.seen), image, seen)
    evidence = checks.ViewEvidence(
        seen, *changed, photo.anyway, shape, before, seen_before, pixel, view.length_error, view.angle_error,
        scene.length, photo.is_zero,
        max(scene.depth) > 0.0, scene.in_space,
    )  # fmt: skip
    return dataclasses.replace(view, reasons=checks.doubts(evidence))


def sightings(
    image: pictures.Pixels, seen: silhouette.Silhouette, scene: Scene, shape: silhouette.Shape, kind: str
) -> list[markers.Sighting]:
    """Return the markers of a kind that a photograph (h, w, 3) shows on a device with a silhouette and a shape."""
    marks, random = dots.find_marks(image, seen, kind), np.random.default_rng(53)
    scenes = [scene.varied(random) for _ in range(REPEAT_COUNT)]
    bases = [varied.to_metres(seen.base).mean(axis=0) for varied in scenes]
    base_error, made = ASLANT_SHARE * scene.strip(shape.base), list[markers.Sighting]()
    for mark in marks:
        lens = float(scene.setup.camera.error(mark.middle[None])[0])
        around, slopes = scene.on_front(mark.boundary)
        place, area, first = area_of(around)
        parallax = slopes.mean(axis=0)
        pixel = math.sqrt(area / area_of(mark.boundary)[1])
        own = pixel * math.hypot(mark.error, lens)
        repeats = np.array([area_of(varied.on_front(mark.boundary)[0])[0] for varied in scenes]) - np.array(bases)
        repeats = repeats + own * random.standard_normal(repeats.shape)
        unknown = 0.25 * abs(scene.depth[0] - scene.depth[1]) * np.abs(parallax)  # how far before the middle plane it is
        error = np.hypot(np.hypot(np.std(repeats, axis=0, ddof=1), unknown), base_error)
        across = around[1] - around[0] if mark.name else np.zeros(2)
        made.append(markers.Sighting(
            markers.Marker(mark.name, place, error, own, parallax, mark.boundary, reasons=(mark.doubt,) * bool(mark.doubt)),
            repeats, np.zeros(2), math.atan2(across[1], across[0]), first, mark.width, mark.name,
        ))  # fmt: skip
    return made


def area_of(around: Array) -> tuple[Array, float, float]:
    """Return the middle (2,) of the area in a polygon (k, 2), its area, and the root of that over pi."""
    inner = around - around.mean(axis=0)
    following = np.roll(inner, -1, axis=0)
    twice = inner[:, 0] * following[:, 1] - inner[:, 1] * following[:, 0]
    middle = ((inner + following) * twice[:, None]).sum(axis=0) / (3.0 * twice.sum())
    area = abs(float(twice.sum())) / 2.0
    return around.mean(axis=0) + middle, area, math.sqrt(area / math.pi)


def _outwards(seen: silhouette.Silhouette) -> Array:
    """Return unit vectors (n, 2) in px away from the device: an edge's own point to the brighter side."""
    px = seen.edge.px
    area = 0.5 * float(np.sum(px[:, 0] * np.roll(px[:, 1], -1) - np.roll(px[:, 0], -1) * px[:, 1]))
    way = np.gradient(px, axis=0)
    right = np.column_stack([way[:, 1], -way[:, 0]]) * np.sign(area)
    return seen.edge.normal * np.sign(np.sum(right * seen.edge.normal))


def _evaluated(
    seen: silhouette.Silhouette, px: Array, out: Array, scene: Scene, near: Array | None = None
) -> tuple[silhouette.Shape, Array]:
    """Return the shape and the outline (n, 2) in m of an edge at pixels (n, 2); with a centre line that is near, quicker."""
    outline = scene.to_metres(px, out, seen.side)
    smooth, base = outline[~seen.folded], scene.to_metres(seen.base)
    # A pixel of the base was chosen along the edge, and lies on it only across the base.
    across = (base[1] - base[0]) / np.linalg.norm(base[1] - base[0])
    base += ((scene.to_metres(seen.base, out[[0, -1]], np.array([0.0, 1.0])) - base) @ across)[:, None] * across
    guide = scene.to_metres(seen.guide) if near is None else near - near[0] + base.mean(axis=0)
    rounds = silhouette.MAX_ROUNDS if near is None else 2
    return silhouette.shape_of(smooth, base, guide, seen.corners, scene.strip(guide[-1]), rounds), outline


def _field(px: Array, scene: Scene, random: np.random.Generator) -> Array:
    """Return a smooth random field (n, 2) of variance about 1 over the picture: a lens' error changes slowly along it."""
    x, y = (2.0 * px / np.array(scene.setup.camera.size) - 1.0).T
    terms = np.column_stack([np.ones(len(px)), x, y, x * y, x * x - 0.5, y * y - 0.5])
    return np.asarray(terms @ random.standard_normal((6, 2)) / math.sqrt(2.5))


def _spread(repeats: Array) -> Array:
    """Return the standard deviations (n,) of repeated points (r, n, 2), the root mean square over both axes."""
    return np.asarray(np.sqrt(np.mean(np.var(repeats, axis=0, ddof=1), axis=1)))


def since(
    before: tuple[pictures.Pixels, silhouette.Silhouette] | None, image: pictures.Pixels, seen: silhouette.Silhouette
) -> tuple[float | None, float | None, float | None]:
    """Return by how many px the background moved since a photograph (h, w, 3) with its silhouette, how many times brighter it
    is and how many times softer the edge; None where it is not known."""
    if before is None:
        return None, None, None
    both = before[0], image, [before[1], seen]
    return background_shift(*both), light_ratio(*both), seen.softness / before[1].softness


def zero_first(photographs: Sequence[Photograph]) -> list[int]:
    """Return the numbers of photographs in the order in which they are measured."""
    return sorted(range(len(photographs)), key=lambda k: (not photographs[k].is_zero, abs(photographs[k].pressure), k))


@dataclasses.dataclass(frozen=True, eq=False)
class Reference:
    """The photograph without pressure: its pixels, silhouette and measured view."""

    image: pictures.Pixels
    seen: silhouette.Silhouette
    view: View


def background_shift(first: pictures.Pixels, second: pictures.Pixels, seen: Sequence[silhouette.Silhouette]) -> float | None:
    """Return how far in px the background moved between two photographs (h, w, 3) in which the devices are covered; None
    where it has no details that show it."""
    small, free, factor = _backgrounds(first, second, seen)
    detail = [
        cv2.GaussianBlur(image, (0, 0), 1.0).astype(np.float32) - cv2.GaussianBlur(image, (0, 0), 12.0) for image in small
    ]
    if (free > 0).sum() < 1000 or min(float(np.percentile(np.abs(part[free > 0]), 99.5)) for part in detail) < MIN_DETAIL:
        return None
    begin = np.eye(2, 3, dtype=np.float32)  # fine details lead no farther than their own size
    begin[:, 2] = cv2.phaseCorrelate(*(np.where(free > 0, part, 0.0).astype(np.float32) for part in detail))[0]
    try:
        match, moved = cv2.findTransformECC(
            detail[0], detail[1], begin, cv2.MOTION_TRANSLATION,
            (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 60, 1e-5), free, 5,
        )  # fmt: skip
    except cv2.error:
        return None
    # Details that all run one way, as a clamp's edges, do not show a movement along it.
    steps = np.array(np.gradient(detail[0]))[::-1][:, free > 0]
    sizes, ways = np.linalg.eigh(steps @ steps.T)
    shown = ways[:, sizes > ONE_WAY_SHARE**2 * sizes[1]].T @ moved[:, 2]
    return float(np.linalg.norm(shown)) * factor if match > MIN_MATCH else None


def _backgrounds(
    first: pictures.Pixels, second: pictures.Pixels, seen: Sequence[silhouette.Silhouette]
) -> tuple[list[pictures.Pixels], pictures.Pixels, float]:
    """Return two photographs (h, w, 3) reduced and grey, where neither shows a device (255, else 0), and the reduction."""
    factor = max(1.0, max(first.shape[:2]) / silhouette.LARGEST_SMALL_PX)
    size = round(first.shape[1] / factor), round(first.shape[0] / factor)
    small = [
        cv2.cvtColor(cv2.resize(image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY) for image in (first, second)
    ]
    free = np.full(size[::-1], 255, dtype=np.uint8)
    for device in seen:
        cv2.fillPoly(free, [np.rint(device.edge.px / factor).astype(np.int32)], 0)
    return small, cv2.erode(free, np.ones((41, 41), np.uint8)), factor  # type: ignore[return-value]


def light_ratio(first: pictures.Pixels, second: pictures.Pixels, seen: Sequence[silhouette.Silhouette]) -> float | None:
    """Return how many times brighter the background of the second photograph (h, w, 3) is where neither shows a device; None
    where it is nowhere seen."""
    small, free, _ = _backgrounds(first, second, seen)
    if not (free > 0).any():
        return None
    light = [float(np.median(pictures.LIGHT_OF_SRGB[image[free > 0]])) for image in small]
    return light[1] / max(light[0], 1e-4)


MIN_DETAIL, MIN_MATCH, ONE_WAY_SHARE = 6.0, 0.6, 0.4
"""Stored numbers by which the background's details differ from their surroundings, and correlation of both photographs there,
from which a movement of the background is measured; slope of the details in one direction over that in the other up to which
they run one way."""


# ----------------------------------------------------------------------------------------------------------------------
# All photographs of a list.


VIEW_COLUMNS = (
    "file", "pressure_Pa", "pressure_error_Pa", "tip_x_m", "tip_x_error_m", "tip_z_m", "tip_z_error_m", "angle_deg",
    "angle_error_deg", "rotation_deg", "rotation_error_deg", "length_m", "length_error_m", "trusted", "remarks", "time_s",
    "history_s_Pa", "parallax_x", "parallax_z", "parallax_error", "tip_radius_m", "tip_shape",
)  # fmt: skip

TABLE, SPACE_TABLE = "views.csv", "view-of-two.csv"
"""Table of the views of a device that moves in its plane, and of one that leaves it, whose places need a second view."""
SPACE_COLUMNS = tuple(name.replace("tip_x", "seen_x").replace("tip_z", "seen_z") for name in VIEW_COLUMNS)
"""Columns of the latter, so that nobody takes it for the former."""


@dataclasses.dataclass(frozen=True, eq=False)
class Views:
    """What a list of photographs shows of a device from the side.

    Attributes:
        photographs: The list.
        outcomes: A view, or the reason why there is none, of each.
        names: Stems of their files.
        reference: What the photograph without pressure shows; None where there is none.
        in_space: Whether the device may leave its plane.
    """

    photographs: tuple[Photograph, ...]
    outcomes: tuple[View | Refusal, ...]
    names: tuple[str, ...]
    reference: View | None
    in_space: bool = False

    @property
    def views(self) -> list[View]:
        """The views, in the list's order; those that are not trusted too."""
        return [outcome for outcome in self.outcomes if isinstance(outcome, View)]

    @property
    def origin(self) -> Array:
        """Middle of the base (2,) in m, from which places count: without pressure, else the median of all photographs."""
        known = [self.reference] if self.reference is not None else self.views
        return np.median([view.shape.base for view in known], axis=0)

    def rotation(self, view: View) -> tuple[float, float]:
        """Return by how much in rad the tip turned since the photograph without pressure, from -pi to pi, positive from x to
        z, and its standard error; NaN without such a photograph."""
        if self.reference is None:
            return math.nan, math.nan
        turned = float(np.angle(np.exp(1j * (view.shape.angle - self.reference.shape.angle))))
        return turned, math.hypot(view.angle_error, self.reference.angle_error)

    def write(self, folder: Path) -> None:
        """Write the table of the views, and the curves of each in its plane, into a folder; `OSError` where that fails."""
        with (folder / (SPACE_TABLE if self.in_space else TABLE)).open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(SPACE_COLUMNS if self.in_space else VIEW_COLUMNS)
            for photo, outcome in zip(self.photographs, self.outcomes, strict=True):
                first = (photo.file.name, repr(photo.pressure), repr(photo.pressure_error))
                time = "" if photo.time is None else f"{photo.time:.9g}", history_text(photo.history)
                if isinstance(outcome, Refusal):
                    rows.writerow((*first, *[""] * 10, "refused", outcome.reason, *time))
                    continue
                (x, z), (x_error, z_error) = outcome.shape.tip - self.origin, outcome.tip_error
                angles = (math.degrees(a) for a in (outcome.shape.angle, outcome.angle_error, *self.rotation(outcome)))
                values = (x, x_error, z, z_error, *angles, outcome.shape.length, outcome.length_error)
                rows.writerow(
                    (
                        *first,
                        *(f"{v:.7g}" for v in values),
                        outcome.trust,
                        "; ".join(outcome.reasons),
                        *time,
                        *(f"{v:.5g}" for v in (*outcome.parallax, outcome.parallax_error, outcome.radius)),
                        "round" if outcome.shape.is_round else "flat",
                    )
                )
        for name, outcome in zip(self.names, self.outcomes, strict=True):
            if isinstance(outcome, View) and not self.in_space:
                outcome.to_csv(folder / f"{name}.csv", self.origin)
        if any(view.markers for view in self.views):
            seen = zip(self.photographs, self.outcomes, strict=True)
            markers.write(
                folder / markers.TABLE,
                ((photo, view.trust, view.reasons, view.markers) for photo, view in seen if isinstance(view, View)),
                self.origin,
            )


def views(
    photographs: Sequence[Photograph],
    scene: Scene,
    pictures_folder: Path | None = None,
    done: Callable[[], None] = lambda: None,
    kind: str = "",
) -> Views:
    """Return what photographs show of a device from the side.

    Args:
        photographs: The list, as `measurement.read_photos` reads it.
        scene: Camera, scale and device.
        pictures_folder: Folder for a picture of each photograph with its outline; none without it.
        done: Called after each photograph.
        kind: Colour of the dots, or family of the tags, that are on its face towards the camera, half the scene's depth
            before the middle plane; empty for none.
    """
    reference, tracker = None, markers.Tracker()

    def measured(photo: Photograph, image: pictures.Pixels, seen: silhouette.Silhouette) -> View:
        nonlocal scene, reference
        view = view_of(image, seen, scene, photo, reference)
        if photo.is_zero and scene.sides is not None:
            scene = scene.told_apart(view.shape, view.outline)
            view = view_of(image, seen, scene, photo)
        if reference is None and photo.is_zero and view.trust != "no":
            scene = scene.scaled_by(view)
            view = view_of(image, seen, scene, photo)
        if kind:
            length = view.shape.length if reference is None else reference.view.shape.length
            view = dataclasses.replace(
                view, markers=tracker.track(sightings(image, seen, scene, view.shape, kind), view.shape, length)
            )
        if reference is None and photo.is_zero and view.trust != "no":
            reference = Reference(image, seen, view)
        return view

    def shown(seen: silhouette.Silhouette | None, outcome: View | Refusal) -> tuple[list[Array], str]:
        edges = [seen.edge.px] if seen is not None else []
        if isinstance(outcome, Refusal):
            return [*edges, *([scene.base] if scene.base is not None else [])], ""
        angle = f"angle {units.with_error(math.degrees(outcome.shape.angle), math.degrees(outcome.angle_error), 'deg', '±')}"
        length = f"length {units.with_error(outcome.shape.length * 1e3, outcome.length_error * 1e3, 'mm', '±')}"
        marked = [np.vstack([marker.boundary, marker.boundary[:1]]) for marker in outcome.markers if len(marker.boundary)]
        return [*edges, scene.to_pixels(outcome.shape.line), *marked], f"{angle}, {length}"

    every = each_photograph(photographs, scene, measured, shown, pictures_folder, done, judged)
    names = tuple(measuring.file_stems(photographs))
    return Views(tuple(photographs), every, names, None if reference is None else reference.view, scene.in_space)


def judged(photographs: Sequence[Photograph], outcomes: Sequence[View | Refusal]) -> list[View | Refusal]:
    """Distrust what looks good by itself and is contradicted by the other photographs of its list."""
    zeros = [outcome for photo, outcome in zip(photographs, outcomes, strict=True) if photo.is_zero]
    lost = bool(zeros) and not any(isinstance(zero, View) and zero.trust != "no" for zero in zeros)
    known = [view for view in outcomes if isinstance(view, View) and view.trust == "yes"]
    if not known:
        return list(outcomes)
    length = float(np.median([view.shape.length for view in known]))
    turned = np.unwrap([view.shape.angle for view in known])
    course = np.column_stack([np.array([view.shape.tip - view.shape.base for view in known]), length * turned])
    errors = [math.hypot(*view.tip_error, length * view.angle_error) for view in known]
    pressures = np.array([(view.pressure, view.pressure_error) for view in known])
    is_timed = any(photo.time is not None for photo in photographs)
    made = {}
    for number, view in enumerate(known):
        evidence = checks.SeriesEvidence(pressures[:, 0], pressures[:, 1], course, np.array(errors), number, lost, is_timed)
        if reasons := tuple(map(str, checks.answers(evidence))):
            made[id(view)] = dataclasses.replace(view, reasons=reasons)
    return [made.get(id(outcome), outcome) for outcome in outcomes]


def each_photograph[Shown: (View, Outline)](
    photographs: Sequence[Photograph],
    scene: Scene,
    measured: Callable[[Photograph, pictures.Pixels, silhouette.Silhouette], Shown],
    shown: Callable[[silhouette.Silhouette | None, Shown | Refusal], tuple[list[Array], str]],
    pictures_folder: Path | None,
    done: Callable[[], None],
    judged: Callable[[Sequence[Photograph], Sequence[Shown | Refusal]], Sequence[Shown | Refusal]] = lambda _, made: made,
) -> tuple[Shown | Refusal, ...]:
    """Return what is ``measured`` in each photograph, or the reason why there is nothing; those without pressure come first.
    ``shown`` gives the lines in px over its picture, and its result in words; ``judged`` what becomes of each beside the
    others; see `views`."""
    names, outcomes = measuring.file_stems(photographs), dict[int, Shown | Refusal]()
    over = dict[int, tuple[list[Array], str]]()

    def draw(k: int, image: pictures.Pixels, outcome: Shown | Refusal) -> None:
        photo, (lines, words) = photographs[k], over[k]
        if isinstance(outcome, Refusal):
            title = f"{photo.file.name}   refused: {outcome.reason}"
        else:
            weak = "" if outcome.trust == "yes" else " (not trusted)"
            title = f"{photo.file.name}   {photo.pressure:.0f} Pa: {words}{weak}"
        assert pictures_folder is not None
        drawing.draw_view(pictures_folder / f"{names[k]}.png", image, lines, title, isinstance(outcome, Refusal))

    for k in zero_first(photographs):
        photo, image, seen = photographs[k], None, None
        try:
            image = pictures.read_pixels(photo.file, scene.setup.camera.size)
            seen = silhouette.find_silhouette(image, scene.setup, scene.base)
            outcomes[k] = measured(photo, image, seen)
        except pictures.Unmeasurable as error:
            outcomes[k] = Refusal(str(error), photo.file)
        except OutlineError as error:
            why = str(error).removeprefix(f"{photo.file.name}: ")
            outcomes[k] = Refusal(
                f"{why}; its picture shows what was taken for the device: check --base and setup --roi", photo.file
            )
        except Exception as error:  # one odd photograph must not take the others with it
            outcomes[k] = Refusal(measuring.unexpected_error(error), photo.file)
        if image is not None and pictures_folder is not None:
            over[k] = shown(seen, outcomes[k])
            draw(k, image, outcomes[k])
        done()
    before = tuple(outcomes[k] for k in range(len(photographs)))
    after = tuple(judged(photographs, before))
    for k, outcome in enumerate(after):
        if pictures_folder is not None and outcome is not before[k]:
            draw(k, pictures.read_pixels(photographs[k].file, scene.setup.camera.size), outcome)
    return after
