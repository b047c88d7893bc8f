"""How a device is shown: which images of its slice, and from where. The same for every picture of a run."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from softmodels.pictures.colour_scale import Scale
from softmodels.pictures.offscreen import PIXELS, Camera, Layer, Style, lines, surface
from softmodels.pictures.rigid_bodies import shape_layers
from softmodels.pictures.style import EDGE, INK, WARNING
from softmodels.results.skin import CUT, OUTSIDE
from softmodels.results.stored import States
from softmodels.results.triangles import Array

SOLID_STYLE: Style = {"smooth_shading": True, "culling": "back"}
"""Of a solid's closed surface: of what faces away nothing is ever seen."""
BESIDE = 0.5
"""How far beside a device rigid shapes are in the picture, in sizes of the device."""


@dataclasses.dataclass(frozen=True)
class Look:
    """A device to look at.

    Attributes:
        states: Its states.
        kept: The images of the slice that are shown; of a round device about a quarter is left out, to see inside.
        direction: From the device to the viewer, shape (3,).
    """

    states: States
    kept: npt.NDArray[np.intp]
    direction: Array

    @property
    def opened(self) -> bool:
        """Whether images are left out, so that cuts are seen."""
        return len(self.kept) < len(self.states.skin.images)

    @property
    def up(self) -> Array:
        return np.asarray(self.states.actuator.lift)

    def points(self, step: float, kept: npt.NDArray[np.intp] | None = None) -> Array:
        """Deformed vertices of the shown images in m, shape (n, 3)."""
        skin = self.states.skin
        moved = self.states.points + self.states.between(step, "displacement")
        return skin.device(skin.points(moved), self.kept if kept is None else kept)

    def camera(self, steps: list[int], width: int = PIXELS, tallest: float = 0.62) -> Camera:
        """The camera that sees the whole of some states, and of rigid shapes beside them what is near."""
        clouds = [self.points(step) for step in steps]
        low, high = (limit([limit(cloud, axis=0) for cloud in clouds], axis=0) for limit in (np.min, np.max))
        around = BESIDE * float(np.max(high - low))
        shapes = [np.asarray(data.points) for step in steps for data, _ in shape_layers(self.states, step)]
        clouds += [np.clip(cloud, low - around, high + around) for cloud in shapes]
        if self.plate is not None:
            clouds.append(self.plate)
        return Camera.around(clouds, self.direction, self.up, width, tallest)

    @functools.cached_property
    def plate(self) -> Array | None:
        """Corners of the rigid plane that stops the device, as far as it is drawn, in m, shape (k, 3); None without one.

        A cut plane on which walls meet their mirror image is the device's own middle, and is not drawn.
        """
        obstacle, skin = self.states.case.obstacle, self.states.skin
        if obstacle is None or obstacle.on_cut:
            return None
        point, normal = (np.asarray(vector) for vector in obstacle.place(self.states.actuator))
        shown = np.concatenate([skin.device(skin.points(self.states.moved(step))) for step in (0, self.states.main)])
        first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
        along = np.array([first / np.linalg.norm(first), np.cross(normal, first / np.linalg.norm(first))])
        flat = (shown - point) @ along.T
        middle, half = (flat.min(axis=0) + flat.max(axis=0)) / 2, np.ptp(flat, axis=0) / 2
        if self.states.actuator.axial and abs(normal @ self.up) > 1 - 1e-9:
            around = np.linspace(0.0, 2 * np.pi, 97)[:-1]
            corners = np.column_stack([np.cos(around), np.sin(around)])
        else:
            corners = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
        return np.asarray(point + (middle + half * corners) @ along)

    def plate_layers(self, step: float) -> list[Layer]:
        """Layers of what stops the device at a step: shapes, and the plane with a border; none without any."""
        shapes = shape_layers(self.states, step)
        if self.plate is None:
            return shapes
        count = len(self.plate)
        fan = np.column_stack([np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)])
        ring = np.column_stack([np.arange(count), np.roll(np.arange(count), -1)])
        style: Style = {"color": WARNING, "opacity": 0.05, "ambient": 1.0}
        border: Style = {"color": WARNING, "line_width": 2.0}
        return [*shapes, (surface(self.plate, fan), style), (lines(self.plate, ring), border)]

    def scale(self, steps: Sequence[int], field: str = "von_mises") -> Scale:
        """One scale for what is seen in some states: everything where a cut is seen, else the outside alone."""
        states, skin = self.states, self.states.skin
        rows = [states.rows[step] for step in steps]
        if self.opened:
            return Scale(np.array([states.field(step, field) for step in steps]), field, rows=rows)
        seen = np.unique(skin.nodes[skin.triangles[skin.part == OUTSIDE][self._facing(steps[-1])]])
        return Scale(np.array([states.field(step, field)[seen] for step in steps]), field, "on what is seen", rows)

    def _facing(self, step: int) -> npt.NDArray[np.bool_]:
        """Which triangles of the outside face the viewer in one of the images, shape (t,)."""
        skin = self.states.skin
        a, b, c = skin.points(self.states.moved(step))[skin.triangles[skin.part == OUTSIDE]].transpose(1, 0, 2)
        towards = np.linalg.inv(skin.images[self.kept]) @ self.direction
        flipped = np.sign(np.linalg.det(skin.images[self.kept]))
        return np.asarray((np.cross(b - a, c - a) @ towards.T * flipped > 0).any(axis=1))

    def coloured(self, step: float, scale: Scale) -> list[Layer]:
        """Layers of a state, coloured, with its sharp edges."""
        states, skin = self.states, self.states.skin
        moved = skin.points(states.points + states.between(step, "displacement"))
        values = np.tile(scale.share(states.between(step, scale.field))[skin.nodes], len(self.kept))
        shown = skin.device(moved, self.kept)
        data = surface(shown, self.visible, skin.device(skin.normals(moved), self.kept), values)
        style: Style = {**SOLID_STYLE, "scalars": "values", "cmap": scale.colours, "clim": (0.0, 1.0)}
        pairs = skin.device_lines(skin.edges, self.kept)
        if self.opened:
            pairs = np.concatenate([pairs, self.open_rims])
        edges: list[Layer] = [(lines(shown, pairs), {"color": INK, "line_width": 1.5})] if len(pairs) else []
        return [(data, style), *edges, *self.plate_layers(step)]

    def translucent(self, step: float, opacity: float, walls: Style | None) -> list[Layer]:
        """Layers of a state with a translucent outside; its cavities' walls before it in a style, None leaves them out."""
        states, skin = self.states, self.states.skin
        moved = skin.points(states.moved(int(step)))
        everything = np.arange(len(skin.images))
        shown, normals = skin.device(moved), skin.device(skin.normals(moved))
        found: list[Layer] = []
        outside: Style = {"color": "#8fa8c0", "opacity": opacity, "culling": "back"}
        for part, style in ((1, walls), (0, outside)):
            chosen = skin.part > OUTSIDE if part else skin.part == OUTSIDE
            if chosen.any() and style is not None:
                data = surface(shown, skin.device_triangles(chosen, everything), normals)
                found.append((data, {"smooth_shading": True, **style}))
        if len(skin.edges):
            edge = lines(shown, skin.device_lines(skin.edges))
            found.append((edge, {"color": EDGE, "line_width": 1.5, "opacity": 0.6}))
        return found

    @functools.cached_property
    def open_rims(self) -> npt.NDArray[np.int64]:
        """Edges of the cuts at the two ends of the shown images, as vertices of these."""
        return self._single(self.states.skin.device_lines(self.states.skin.rims, self.kept))

    @functools.cached_property
    def visible(self) -> npt.NDArray[np.int64]:
        """Triangles that can be seen, over the vertices of the shown images.

        A whole device hides its cavities, an opened one the cuts between its images.
        """
        skin = self.states.skin
        if not self.opened:
            return skin.device_triangles(skin.part == OUTSIDE, self.kept)
        cuts = self._single(skin.device_triangles(skin.part == CUT, self.kept))
        return np.concatenate([skin.device_triangles(skin.part != CUT, self.kept), cuts])

    def _single(self, corners: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """Of lines or triangles between the shown images, those that are there once; vertices, shape (k, 2 or 3)."""
        states = self.states
        places = states.skin.device(states.skin.points(states.points), self.kept)[corners].mean(axis=1)
        # Off the round numbers that meshes like, where the last digit would decide.
        rounded = np.floor(places / states.actuator.size * 1e6 + 0.4142).astype(np.int64)
        _, first, count = np.unique(rounded, axis=0, return_index=True, return_counts=True)
        return np.asarray(corners[first[count == 1]])


def direction(azimuth: float, elevation: float, up: Array) -> Array:
    """Unit vector at an azimuth and an elevation in degrees, above the plane across ``up``, an axis."""
    a, e = np.radians(azimuth), np.radians(elevation)
    turned = np.roll(
        np.eye(3), int(np.argmax(np.abs(up))) - 2, axis=1
    )  # rows: x, y and z of a device that rises along z
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]) @ turned


def look(states: States) -> Look:
    """How a device is shown: a round one without a quarter, another one whole, from the side of its free end."""
    skin, up = states.skin, np.asarray(states.actuator.lift)
    whole = np.arange(len(skin.images))
    if not states.actuator.axial:
        return Look(states, whole, direction(-58.0, 24.0, up))
    if len(whole) == 1:
        return Look(states, whole, direction(-45.0, 32.0, up))
    begin = np.degrees(np.arctan2(skin.planes[0][0], -skin.planes[0][1]))  # across the plane's normal (y, -x)
    centre = skin.points(states.points).mean(axis=0)
    x, y, _ = (skin.images @ centre).T
    around = (np.degrees(np.arctan2(y, x)) - begin) % 360.0
    angle = 360.0 / len(whole)
    removed = max(1, round(len(whole) / 4))
    order = np.argsort(around)
    return Look(states, order[: len(whole) - removed], direction(begin - removed * angle / 2, 32.0, up))


def towards_slice(states: States) -> Array:
    """From where a slice is seen: across its first cut plane, a little from the side and from above."""
    up = np.asarray(states.actuator.lift)
    planes = states.skin.planes
    if not len(planes):
        return look(states).direction
    # A wide slice shows its second cut plane too, unless that is seen edge on.
    side = np.cross(up, planes[0])
    turned = np.radians(28.0 if len(planes) > 1 and len(states.skin.images) >= 4 else 14.0)
    flat = np.cos(turned) * planes[0] + np.sin(turned) * side
    return np.cos(np.radians(24.0)) * flat + np.sin(np.radians(24.0)) * up
