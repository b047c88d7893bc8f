"""Side views of random devices, damaged in random ways: the same for the same seed. A damage changes the light on its way, what
stands in it, the camera or the stored picture; what the tip is stays known.

A bench is a bar or a comb of random bends with a tag beside it, photographed without pressure and at three pressures.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from measurement.camera import Camera
from measurement.screen.setup import Setup, plane_of_scale
from measurement.series import views
from measurement.series.photo_list import Photograph
from measurement.series.witness import Refusal
from tests.support import side_views

NEAR, NEAR_ANGLE, TIMES = 1e-4, np.radians(0.4), 1.5
"""Error of a tip in m and of its angle in rad up to which a view is right, or so many of its 95 % intervals."""

SHARES = (0.0, 0.35, 0.7, 1.0)
"""Pressures of a bench's photographs over the highest."""

SKIN, HOSE, TAG_SIDE = (0.55, 0.32, 0.22), (0.03, 0.03, 0.035), 0.018


@dataclasses.dataclass(frozen=True, eq=False)
class Change:
    """What a damage changes: its size in words, the surfaces (of a list of them), the light (h, w, 3), how the light is
    rendered and stored, the scene, and whether it falls on the photograph without pressure too."""

    what: str
    shape: Callable[[list[Any]], list[Any]] = list
    light: Callable[[np.ndarray], np.ndarray] = np.asarray
    camera: dict[str, Any] = dataclasses.field(default_factory=dict)
    quality: int = 93
    scene: dict[str, Any] = dataclasses.field(default_factory=dict)
    region: tuple[float, float, float, float] | None = None
    order: tuple[int, ...] = (0, 1, 2, 3)
    every: bool = False


class Bench:
    """A device of a seed and its undamaged photographs in a folder."""

    def __init__(self, seed: int, folder: Path) -> None:
        rng = np.random.default_rng([seed, 7])
        self.seed, self.folder = seed, folder
        self.comb, self.turn = bool(seed % 3 == 2), rng.uniform(0.6, 1.6)
        self.background = tuple(rng.uniform(0.75, 0.95) + rng.uniform(-0.04, 0.04, 3))
        self.noise, self.blur = rng.uniform(0.5, 2.5), rng.uniform(0.6, 1.1)
        self.files = [self.photograph(k, Change("")) for k in range(len(SHARES))]

    def device(self, number: int) -> tuple[list[Any], np.ndarray, float, np.ndarray, Any]:
        """Its surfaces at a pressure, its tip (2,) in m, angle, centre line (k, 2) in m, and the pixels of its base."""
        turn = self.turn * SHARES[number]
        if self.comb:
            return side_views.bent_comb(turn)
        surface, *truth = side_views.bent_bar(turn)
        return [surface], *truth, side_views.BASE

    @property
    def length(self) -> float:
        """Length of its centre line in m."""
        return 0.06 if self.comb else side_views.LENGTH

    @functools.cached_property
    def clean(self) -> views.Views:
        """What the undamaged photographs show."""
        return self.measured(list(enumerate(self.files)), Change(""))

    def scene(self, change: Change) -> views.Scene:
        """The scene as a user states it, with a mask on the tag."""
        low, high = side_views.to_pixels([[-0.029, -0.056], [-0.005, -0.079]])
        camera = Camera.ideal(*side_views.SIZE)
        setup = Setup(camera, plane_of_scale(camera, 1.0 / side_views.PIXEL, 1.0), masks=((0, low[1], high[0], high[1]),))
        given = {
            "setup": dataclasses.replace(setup, roi=change.region), "camera_distance": (side_views.FAR, 2e-3),
            "depth": (side_views.DEPTH,) * 2, "ahead": (0.0, 2e-4), "base": self.device(0)[4], "length": (self.length, 1e-4),
        }  # fmt: skip
        return views.Scene(**(given | change.scene))

    def photograph(self, number: int, change: Change, name: str = "clean") -> Path:
        """Write the photograph at a pressure with a change."""
        path = self.folder / f"{self.seed}-{name.replace(' ', '-')}-{number}.jpg"
        parts = change.shape(self.device(number)[0])
        light = self._light(number, parts, change)
        seed = 1000 * self.seed + number + (100 if change.what else 0)
        side_views.store(path, change.light(light), seed, self.noise, change.quality)
        return path

    def _light(self, number: int, parts: list[Any], change: Change) -> np.ndarray:
        if change.what and change.shape is list and not change.camera:
            return np.array(self._kept[number])
        how = {"background": self.background, "blur": self.blur} | change.camera
        tag = side_views.tag(-0.027, -0.077, TAG_SIDE, 0.0)
        light = side_views.rendered(*parts, tag, **how).astype(np.float32)
        if not change.what:
            self._kept[number] = light
        return light

    @functools.cached_property
    def _kept(self) -> dict[int, np.ndarray]:
        return {}

    def measured(self, files: list[tuple[int, Path]], change: Change, apart: bool = False) -> views.Views:
        """What photographs at pressures of these numbers show; ``apart`` with times, so that no order is expected."""
        listed = [
            Photograph(file, 4e3 * SHARES[change.order[k]], 40.0, time=float(place) if apart else None)
            for place, (k, file) in enumerate(files)
        ]
        return views.views(listed, self.scene(change))

    def campaign(self, kinds: Sequence[str]) -> Iterator[tuple[str, str, str, str]]:
        """Yield kind, size, outcome and its reason of each photograph, undamaged or with a damage of these kinds."""
        whole, single = [("clean", Change(""))], []
        for kind in kinds:
            rng = np.random.default_rng([self.seed, list(KINDS).index(kind)])
            number = int(rng.integers(1, len(SHARES)))
            change = KINDS[kind](self, number, rng)
            if change.every or change.order != Change("").order:
                whole.append((kind, change))
            else:
                single.append((kind, change, number))
        for kind, change in whole:
            files = [(k, self.photograph(k, change, kind) if change.every else file) for k, file in enumerate(self.files)]
            made = self.clean if kind == "clean" else self.measured(files, change)
            yield from ((kind, change.what, *self.outcome(made, k, change.order[k])) for k in range(len(files)))
        files = [(number, self.photograph(number, change, kind)) for kind, change, number in single]
        made = self.measured([(0, self.files[0]), *files], Change(""), apart=True)
        for place, (kind, change, number) in enumerate(single):
            yield kind, change.what, *self.outcome(made, place + 1, number)

    def outcome(self, made: views.Views, number: int, true: int) -> tuple[str, str]:
        """Whether a view is right, refused, untrusted, or wrong (trusted and off by too much) at the pressure stated for it;
        and why."""
        view = made.outcomes[number]
        if isinstance(view, Refusal):
            return "refused", view.reason
        _, tip, angle, *_ = self.device(true)
        off = np.abs(view.shape.tip - made.origin - tip)
        turned = abs(float(np.angle(np.exp(1j * (view.shape.angle - angle)))))
        is_off = (off > np.maximum(NEAR, TIMES * 1.96 * view.tip_error)).any()
        is_off |= turned > max(NEAR_ANGLE, TIMES * 1.96 * view.angle_error)
        (x, z), (x_error, z_error) = off * 1e3, view.tip_error * 1e3
        why = f"tip off by {x:.2f} +- {x_error:.2f}, {z:.2f} +- {z_error:.2f} mm, angle by {np.degrees(turned):.2f} degrees"
        if view.trust != "yes":
            return "untrusted", f"{'; '.join(view.reasons)} ({'wrong' if is_off else 'right'}: {why})"
        return "wrong" if is_off else "right", why

    def along(self, number: int, share: float) -> tuple[np.ndarray, np.ndarray]:
        """A pixel (2,) of the centre line at a share of its length, and a unit vector across it, up at the base."""
        line = side_views.to_pixels(self.device(number)[3])
        k = int(np.clip(share * len(line), 1, len(line) - 2))
        way = (line[k + 1] - line[k - 1]) / np.linalg.norm(line[k + 1] - line[k - 1])
        return line[k], np.array([way[1], -way[0]])

    @property
    def thick(self) -> float:
        """Its thickness in px."""
        return float(np.linalg.norm(np.diff(self.device(0)[4], axis=0)))


# ----------------------------------------------------------------------------------------------------------------------
# What is painted on the light of a photograph.


def painted(polygon, colour, soft=0.9):
    """A change of light: an opaque polygon (n, 2) in px, or a light that a map (h, w) lets through."""

    def change(light):
        mask = np.zeros(light.shape[:2], np.float32)
        cv2.fillPoly(mask, [np.rint(np.asarray(polygon) * 16).astype(np.int32)], 1.0, cv2.LINE_AA, 4)
        mask = cv2.GaussianBlur(mask, (0, 0), soft)[..., None]
        return light * (1 - mask) + mask * np.array(colour) ** 2.2

    return change


def tube(first, second, width):
    """A polygon (n, 2) around the way between two pixels, with a round end."""
    way = (second - first) / np.linalg.norm(second - first)
    across = np.array([-way[1], way[0]]) * width / 2
    turn = np.linspace(-np.pi / 2, np.pi / 2, 24)[:, None]
    return np.vstack([first - across, second + width / 2 * (np.cos(turn) * way) + np.sin(turn) * across, first + across])


def turned_light(light, angle, about, zoom=1.0, shift=(0.0, 0.0)):
    """A light (h, w, 3) turned about a pixel by an angle in degrees, larger and shifted."""
    matrix = cv2.getRotationMatrix2D(tuple(map(float, about)), angle, zoom)
    matrix[:, 2] += shift
    return cv2.warpAffine(light, matrix, light.shape[1::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


# ----------------------------------------------------------------------------------------------------------------------
# Damages.


def turned_in_its_clamp(bench, number, rng):
    """The whole device about the axis of its base."""
    angle = rng.uniform(15.0, 40.0) * rng.choice([-1, 1])
    return Change(f"{angle:.0f} degrees", lambda parts: [part.rotate_x(angle) for part in parts])


def leaning(bench, number, rng):
    """Out of its plane from its base on, which stays."""
    angle = np.radians(rng.uniform(15.0, 40.0) * rng.choice([-1, 1]))

    def leaned(part):
        part = part.copy()
        x, y, z = part.points.T
        by = angle * np.clip((np.hypot(x, z) - 0.01) / 0.01, 0.0, 1.0) * (x > 0.0)
        part.points = np.column_stack([x, y * np.cos(by) - z * np.sin(by), y * np.sin(by) + z * np.cos(by)])
        return part

    return Change(f"{np.degrees(angle):.0f} degrees", lambda parts: [leaned(part) for part in parts])


def camera_moved(bench, number, rng):
    """Camera moved sideways."""
    by = 10 ** rng.uniform(0.0, 1.2) * (lambda a: np.array([np.cos(a), np.sin(a)]))(rng.uniform(0.0, 2 * np.pi))
    return Change(f"by {by[0]:.1f}, {by[1]:.1f} px", light=lambda light: turned_light(light, 0.0, (0, 0), 1.0, by))


def camera_zoomed(bench, number, rng):
    """Camera moved nearer or away, or the lens zoomed."""
    zoom = 1.0 + rng.uniform(0.003, 0.03) * rng.choice([-1, 1])
    return Change(f"{zoom:.3f} times", light=lambda light: turned_light(light, 0.0, (700, 500), zoom))


def camera_turned(bench, number, rng):
    """Camera turned about its axis."""
    angle = rng.uniform(0.15, 3.0) * rng.choice([-1, 1])
    return Change(f"{angle:.2f} degrees", light=lambda light: turned_light(light, angle, (700, 500)))


def cut(bench, number, rng):
    """The region of interest cuts the device at its highest pressures."""
    share = rng.uniform(0.4, 0.97)
    low = float(side_views.to_pixels(bench.device(3)[1][None])[0, 1])
    bottom = 500 - 300 + share * (low - 200)
    return Change(f"at {share:.0%} of its tip", region=(0.0, 0.0, 1400.0, bottom), every=True)


def cast_shadow(bench, number, rng):
    """The device's own on the background."""
    by, soft, dark = rng.uniform(-60, 60, 2), 10 ** rng.uniform(0.5, 1.4), rng.uniform(0.1, 0.6)

    def shaded(light):
        away = np.abs(light - np.median(light, axis=(0, 1))).max(axis=2)
        device = (away > 0.15).astype(np.float32)
        device[680:, :300] = 0.0  # the tag
        shade = turned_light(cv2.GaussianBlur(device, (0, 0), soft), 0.0, (0, 0), 1.0, by)
        free = 1.0 - cv2.GaussianBlur(cv2.dilate(device, np.ones((3, 3))), (0, 0), 1.0)
        return light * (1.0 - dark * shade * free)[..., None]

    return Change(f"{by[0]:.0f}, {by[1]:.0f} px, {soft:.0f} px soft, {dark:.0%} dark", light=shaded)


def hose_across(bench, number, rng):
    """A black hose over the device, or up to it."""
    share, width, angle = rng.uniform(0.1, 0.95), rng.uniform(20.0, 60.0), rng.uniform(-0.9, 0.9)
    at, up = bench.along(number, share)
    way = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ (up * rng.choice([-1, 1]))
    end = at - way * rng.choice([0.2 * bench.thick, 2000.0])
    return Change(f"{width:.0f} px at {share:.0%}", light=painted(tube(at + 2000 * way, end, width), HOSE))


def hand(bench, number, rng):
    """A finger of a hand touches the device."""
    share, width, angle = rng.uniform(0.1, 1.0), rng.uniform(100.0, 220.0), rng.uniform(-0.9, 0.9)
    at, up = bench.along(number, share)
    way = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ (up * rng.choice([-1, 1]))
    end = at + way * (rng.uniform(0.0, 0.5) * bench.thick + 0.5 * width)
    return Change(f"{width:.0f} px at {share:.0%}", light=painted(tube(end + 2000 * way, end, width), SKIN))


def reflection(bench, number, rng):
    """A glint as bright as the background, at the edge."""
    share, size, bright = rng.uniform(0.05, 1.0), rng.uniform(10.0, 90.0), rng.uniform(0.8, 1.0)
    at, up = bench.along(number, share)
    middle = at + up * rng.choice([-1, 1]) * bench.thick * rng.uniform(0.25, 0.5)
    turn = np.linspace(0.0, 2 * np.pi, 40)[:-1, None]
    along = np.array([up[1], -up[0]])
    ring = middle + size * np.cos(turn) * along + 0.35 * min(size, bench.thick) * np.sin(turn) * up
    colour = bright * np.array(bench.background)

    def shining(light):
        away = np.abs(light - np.median(light, axis=(0, 1))).max(axis=2) > 0.1
        inside = cv2.GaussianBlur(away.astype(np.float32), (0, 0), 0.8)[..., None]
        return light + (painted(ring, colour, 2.0)(light) - light) * inside

    return Change(f"{size:.0f} px at {share:.0%}", light=shining)


def moving(bench, number, rng):
    """The device swings while the shutter is open."""
    angle = 10 ** rng.uniform(-0.7, 0.5)
    about = side_views.to_pixels([[0.0, 0.0]])[0]
    steps = np.linspace(-0.5, 0.5, 9) * angle

    def blurred(light):
        made = np.mean([turned_light(light, step, about) for step in steps], axis=0)
        free = np.clip((np.hypot(*(np.indices(light.shape[:2])[::-1] - about[:, None, None])) - 80) / 60, 0.0, 1.0)
        free[680:, :300] = 0.0
        free[:, : int(about[0])] = 0.0
        return light + (made - light) * free[..., None]

    return Change(f"{angle:.2f} degrees", light=blurred)


def shaken(bench, number, rng):
    """The camera moves while the shutter is open."""
    length, angle = rng.uniform(3.0, 30.0), rng.uniform(0.0, np.pi)
    steps = np.linspace(-0.5, 0.5, 15)[:, None] * length * [np.cos(angle), np.sin(angle)]
    return Change(
        f"{length:.0f} px",
        light=lambda light: np.mean([turned_light(light, 0.0, (0, 0), 1.0, step) for step in steps], axis=0),
    )


def defocused(bench, number, rng):
    """Out of focus."""
    blur = rng.uniform(1.5, 12.0)
    return Change(f"{blur:.1f} px", light=lambda light: cv2.GaussianBlur(light, (0, 0), blur))


def exposed(bench, number, rng):
    """Other exposure and white balance."""
    gain = np.exp(rng.uniform(-1.0, 1.0)) * np.exp(rng.uniform(-0.1, 0.1, 3))
    return Change(f"{gain.mean():.2f} times", light=lambda light: light * gain)


def other_plane(bench, number, rng):
    """The device stands before or behind the scale's plane, which nobody states."""
    ahead = rng.uniform(0.008, 0.06) * rng.choice([-1, 1])
    times = side_views.FAR / (side_views.FAR - ahead)
    middle = (np.array(side_views.SIZE) - 1.0) / 2.0
    given = {
        "base": middle + (bench.device(0)[4] - middle) * times, "ahead": (0.0, 1e-3),
        "camera_distance": (side_views.FAR - ahead, 2e-3),
    }  # fmt: skip
    return Change(
        f"{ahead * 1e3:.0f} mm ahead", lambda parts: [part.translate((0.0, -ahead, 0.0)) for part in parts], scene=given,
        every=True,
    )  # fmt: skip


def compressed(bench, number, rng):
    """A small file."""
    quality = int(rng.integers(20, 45))
    return Change(f"JPEG {quality}", quality=quality)


def second_device(bench, number, rng):
    """Another bar before the same background, free or touching."""
    length, turn = rng.uniform(0.02, 0.07), rng.uniform(0.0, 1.2)
    at = rng.uniform([0.02, -0.07], [0.08, -0.02])
    other = (
        side_views.bent_bar(turn, length)[0].scale(rng.uniform(0.4, 1.0)).translate((at[0], rng.uniform(-0.02, 0.02), at[1]))
    )
    return Change(f"{length * 1e3:.0f} mm at {at[0] * 1e3:.0f}, {at[1] * 1e3:.0f} mm", lambda parts: [*parts, other])


def base_hidden(bench, number, rng):
    """A hand or a cloth over the base."""
    ends = bench.device(0)[4]
    (x, top), bottom = ends[0], ends[1][1]
    left, right = rng.uniform(20.0, 150.0), rng.uniform(5.0, 120.0)
    above, below = rng.uniform(-0.4, 0.8, 2) * bench.thick
    corners = [(x - left, top - above), (x + right, top - above), (x + right, bottom + below), (x - left, bottom + below)]
    colour = SKIN if rng.random() < 0.5 else (0.3, 0.35, 0.5)
    return Change(f"{right:.0f} px beyond it, {above:.0f} px above, {below:.0f} below", light=painted(corners, colour))


def swapped(bench, number, rng):
    """Two pressures of the list are exchanged."""
    first, second = sorted(rng.choice(4, 2, replace=False).tolist())
    order = list(range(4))
    order[first], order[second] = second, first
    return Change(f"{first} and {second}", order=tuple(order))


KINDS = {
    "turned in its clamp": turned_in_its_clamp,
    "leaning out of its plane": leaning,
    "camera moved": camera_moved,
    "camera zoomed": camera_zoomed,
    "camera turned": camera_turned,
    "cut": cut,
    "cast shadow": cast_shadow,
    "hose": hose_across,
    "hand": hand,
    "reflection": reflection,
    "moving": moving,
    "shaken": shaken,
    "out of focus": defocused,
    "exposure": exposed,
    "scale in another plane": other_plane,
    "compression": compressed,
    "second device": second_device,
    "base hidden": base_hidden,
    "pressures swapped": swapped,
}
"""Every kind of damage."""


# ----------------------------------------------------------------------------------------------------------------------
# Damaged markers.


class MarkedBar:
    """A bar of a seed with five red dots or three tags, without pressure and bent."""

    def __init__(self, seed: int, folder: Path, tags: bool) -> None:
        self.rng = np.random.default_rng([seed, 11])
        self.seed, self.folder, self.turn, self.tags = seed, folder, self.rng.uniform(0.5, 1.6), tags
        along = (0.02, 0.045, 0.07) if tags else (0.014, 0.03, 0.046, 0.062, 0.078)
        self.places = [(at + self.rng.uniform(-1e-3, 1e-3), self.rng.uniform(-1.5e-3, 1.5e-3)) for at in along]

    def stickers(self, turn: float, places: Sequence[tuple[float, float]], order: Sequence[int]) -> list[Any]:
        """Dots, or tags of numbers in an order, at places along a bar and across it."""
        made, middles = side_views.dots(turn, places)
        if not self.tags:
            return made
        tags = []
        for (along, _), (x, z), number in zip(places, middles, order, strict=True):
            board, texture = side_views.tag(x - 0.003, z - 0.003, 0.006, -side_views.DEPTH / 2 - 2e-5, number)
            tags.append((board.rotate_y(np.degrees(turn * along / side_views.LENGTH), point=(x, 0.0, z)), texture))
        return tags

    def damaged(self, kind: str) -> list[tuple[str, str]]:
        """Outcome and reason of each marker that a damage of a kind leaves in the bent bar's photograph."""
        rng, true = self.rng, side_views.dots(self.turn, self.places)[1]
        places, order, light = list(self.places), list(range(len(self.places))), None
        k = int(rng.integers(len(places)))
        front = side_views.FAR / (side_views.FAR - side_views.DEPTH / 2)
        at = side_views.to_pixels(side_views.CENTRE + (true[k] - side_views.CENTRE) * front)
        ring = np.column_stack([f(np.linspace(0.0, 2 * np.pi, 40)[:-1]) for f in (np.cos, np.sin)])
        if kind in ("covered", "glint"):
            colour = (1.0, 1.0, 1.0) if kind == "glint" else (0.75, 0.35, 0.3)
            light = painted(at + rng.uniform(-15, 15, 2) + rng.uniform(6, 16) * ring, colour)
        elif kind == "doubled":
            places.append((places[k][0] + rng.uniform(3.2e-3, 6e-3) * rng.choice([-1, 1]), rng.uniform(-2e-3, 2e-3)))
        elif kind == "came off":
            places[k] = (places[k][0] + rng.uniform(2e-3, 8e-3) * rng.choice([-1, 1]), rng.uniform(-3e-3, 3e-3))
        elif kind == "swapped":
            order[k], order[k - 1] = order[k - 1], order[k]
        photos = []
        for number, (turn, there, which) in enumerate(((0.0, self.places, sorted(order)), (self.turn, places, order))):
            shown = side_views.rendered(side_views.bent_bar(turn)[0], *self.stickers(turn, there, which))
            path = self.folder / f"{self.seed}-{kind.replace(' ', '-')}-{number}.png"
            side_views.store(path, light(shown) if light is not None and number else shown, number)
            photos.append(Photograph(path, 5e3 * number, 50.0))
        scene = Bench.scene(self, Change(""))
        made = views.views(photos, scene, kind="tag36h11" if self.tags else "red")
        outcomes = []
        for marker, middle in zip(made.views[-1].markers, true, strict=True):
            off = np.abs(marker.place - made.origin - middle)
            is_off = (off > np.maximum(NEAR, TIMES * 1.96 * marker.error)).any()
            why = "; ".join(marker.reasons) or f"off by {off[0] * 1e3:.2f}, {off[1] * 1e3:.2f} mm"
            outcomes.append(("untrusted" if marker.reasons else "wrong" if is_off else "right", why))
        return outcomes

    device, length = staticmethod(lambda number: (*[None] * 4, side_views.BASE)), side_views.LENGTH


MARKER_KINDS = ("covered", "glint", "doubled", "came off", "swapped")
"""Damages of markers; tags are swapped, dots all else."""
