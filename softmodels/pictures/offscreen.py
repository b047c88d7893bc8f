"""Off-screen rendering of surfaces and lines in parallel projection, and a check whether this machine can render."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Literal, TypedDict

import numpy as np
import numpy.typing as npt
from PIL import Image as Picture

from softmodels.common.arrays import Array
from softmodels.components.contact import RigidShape, obstacle_of, surface_of
from softmodels.pictures.style import DPI, EDGE, INK, WARNING, WIDTH, Scale, load, number
from softmodels.runs.grid import CUT, OUTSIDE, Cells, Surface
from softmodels.runs.store import States

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from pyvista import Actor, Plotter, PolyData


# ----------------------------------------------------------------------------------------------------------------------
# The lights of rendered pictures, and how they shade a surface.
#
# VTK computes specular reflection per light and pixel, nearly half of a picture's time without a graphics
# card. Nothing here is specular, so skipping it changes no pixel.


HEADLIGHT, LAMP = 0.5, 0.35
"""Intensities of the headlight and of a second light."""
LAMP_PLACE = (-0.4, 1.0, 0.3)
"""Direction of the second light: to the right, upwards, towards the viewer."""
SHADING = """
  float facing = max(0.0, normalVCVSOutput.z);
  float lit = max(0.0, dot(normalVCVSOutput, vec3({:.9f}, {:.9f}, {:.9f})));
  gl_FragData[0] = vec4(ambientColor + diffuseColor * ({:.9f} * facing + {:.9f} * lit), opacity);
"""
"""In VTK's own names, for parallel projection."""


def add_lights(plotter: Plotter) -> None:
    """Add the lights to VTK, for surfaces without `shade`."""
    import pyvista

    plotter.add_light(pyvista.Light(light_type="headlight", intensity=HEADLIGHT))
    plotter.add_light(pyvista.Light(light_type="camera light", position=LAMP_PLACE, intensity=LAMP))


def shade(actor: Actor) -> None:
    """Shade a surface by the lights, without specular reflection."""
    lamp = np.array(LAMP_PLACE) / np.linalg.norm(LAMP_PLACE)
    code = SHADING.format(*lamp, HEADLIGHT, LAMP)
    actor.GetShaderProperty().AddFragmentShaderReplacement("//VTK::Light::Impl", True, code, False)


PIXELS = round(WIDTH * DPI)
"""Width of a picture."""

SAMPLES = 4
"""Subpixel offsets for anti-aliasing."""

Image = npt.NDArray[np.uint8]


class Style(TypedDict, total=False):
    """Drawing style: keywords of ``pyvista.Plotter.add_mesh``."""

    color: str
    scalars: str
    cmap: Colormap
    clim: tuple[float, float]
    opacity: float
    ambient: float
    line_width: float
    culling: Literal["front", "back"]
    smooth_shading: bool
    split_sharp_edges: bool
    feature_angle: float


type Layer = tuple[PolyData, Style]
"""A mesh and its style."""
type Shoot = Callable[[Sequence[Layer]], Image]
"""Takes a picture of layers, shape (height, width, 3)."""

PROBE = """
import sys
import vtkmodules.vtkRenderingOpenGL2
from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow
window = vtkRenderWindow()
window.SetOffScreenRendering(1)
window.AddRenderer(vtkRenderer())
window.Render()
sys.exit(len(sys.argv) > 1 and window.GetClassName() != sys.argv[1])
"""


WINDOW = "VTK_DEFAULT_OPENGL_WINDOW"
"""VTK's variable for the kind of window."""


@functools.cache
def can_render() -> bool:
    """Return whether VTK can render; on Linux this also selects the kind of window, through VTK's variable.

    Without a way to render, VTK does not raise but crashes, so that a process of its own has to try. The kind that
    needs no display comes first, because VTK prints warnings on its own way to it.
    """
    if WINDOW in os.environ or sys.platform != "linux":
        return _probe([])
    for window in ("vtkEGLRenderWindow", "vtkXOpenGLRenderWindow", "vtkOSOpenGLRenderWindow"):
        if window != "vtkXOpenGLRenderWindow" or os.environ.get("DISPLAY"):
            os.environ[WINDOW] = window
            if _probe([window]):
                return True
    del os.environ[WINDOW]
    return False


def _probe(arguments: list[str]) -> bool:
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", PROBE, *arguments], capture_output=True, timeout=60, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0


@dataclasses.dataclass(frozen=True)
class ViewCamera:
    """A camera in parallel projection.

    Attributes:
        direction: Unit vector from the thing to the viewer.
        up: Unit vector that points up in the picture.
        focus: The point in the picture's middle, m.
        scale: Half the picture's height in m.
        size: Width and height in pixels.
    """

    direction: tuple[float, float, float]
    up: tuple[float, float, float]
    focus: tuple[float, float, float]
    scale: float
    size: tuple[int, int]

    @classmethod
    def around(
        cls, clouds: Sequence[Array], direction: Array, up: Array, width: int = PIXELS, tallest: float = 0.62
    ) -> ViewCamera:
        """Return the camera that frames some point clouds, each (n, 3) in m.

        Args:
            clouds: What must be in the picture.
            direction: Towards the viewer; not along ``up``.
            up: Up in the picture.
            width: Of the picture in pixels.
            tallest: Largest height over width.
        """
        direction = direction / np.linalg.norm(direction)
        right = np.cross(up, direction)
        right /= np.linalg.norm(right)
        axes = np.array([right, np.cross(direction, right), direction])
        low = np.min([(cloud @ axes.T).min(axis=0) for cloud in clouds], axis=0)
        high = np.max([(cloud @ axes.T).max(axis=0) for cloud in clouds], axis=0)
        wide, tall = ((high - low) * 1.06)[:2]
        height = 2 * (int(np.clip(width * tall / wide, 0.3 * width, tallest * width)) // 2)
        focus = (low + high) / 2 @ axes
        scale = max(tall, wide * height / width) / 2
        return cls(_triple(direction), _triple(up), _triple(focus), float(scale), (width, height))

    @property
    def text(self) -> str:
        """The camera as text, for a picture's metadata."""
        names = ("direction", "up", "focus", "scale", "size")
        return "; ".join(f"{name} {np.round(getattr(self, name), 9).tolist()}" for name in names)


def _triple(vector: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in vector)
    return x, y, z


AROUND, ALONG = 48, 16
"""Facets around a shape, and from an end to its middle."""


def surface(points: Array, triangles: Cells, normals: Array | None = None, values: Array | None = None) -> PolyData:
    """Return the mesh of triangles; points (n, 3) in m, triangles (t, 3), normals (n, 3), values (n,) to colour them by."""
    import pyvista

    data = pyvista.PolyData.from_regular_faces(points, triangles)
    if values is not None:
        data.point_data["values"] = values
    if normals is not None:
        data.point_data.active_normals = normals
    return data


def lines(points: Array, pairs: Cells) -> PolyData:
    """Return the straight lines to draw; points (n, 3) in m, pairs of them (e, 2)."""
    import pyvista

    return pyvista.PolyData(points, lines=np.column_stack([np.full(len(pairs), 2), pairs]).ravel())


def ring(centre: Array, direction: Array, radius: float) -> PolyData:
    """Return a circle to draw around a place, seen from a direction; lengths in m."""
    import pyvista

    return pyvista.Polygon(center=centre, radius=radius, normal=direction, n_sides=AROUND, fill=False)


@functools.cache
def _plotter(multisampled: bool, process: int) -> Plotter:
    """Return a render window with lights, cached because a new one recompiles its shaders.

    Args:
        multisampled: Whether a pixel has several samples, against jagged edges.
        process: Whose it is; a window does not survive that its process is forked.
    """
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, lighting="none")
    plotter.set_background("white")
    add_lights(plotter)
    plotter.camera.parallel_projection = True
    if multisampled:
        plotter.enable_anti_aliasing("msaa", multi_samples=SAMPLES)
    else:
        plotter.disable_anti_aliasing()
    return plotter


@contextlib.contextmanager
def studio(camera: ViewCamera, draft: bool = False) -> Iterator[Shoot]:
    """Provide a function from layers to an image, shape (height, width, 3), for one camera.

    One at a time in a process.

    Args:
        camera: Camera of the view.
        draft: For images that are soon gone by, in two thirds of the time: jagged edges are softened by the mean of two images
            half a pixel apart.
    """
    plotter = _plotter(not draft, os.getpid())
    direction, focus = np.asarray(camera.direction), np.asarray(camera.focus)
    far = 4 * camera.scale * max(1.0, camera.size[0] / camera.size[1])

    def shoot(layers: Sequence[Layer]) -> Image:
        plotter.clear_actors()
        for data, style in layers:
            if data.n_lines and "scalars" not in style:
                # Offset towards the viewer; in parallel projection this shifts nothing.
                lifted = data.translate(1e-3 * far * direction)
                style = {**style, "line_width": math.floor(style["line_width"])} if draft else style
                plotter.add_mesh(
                    lifted, lighting=False, show_scalar_bar=False, render=False, reset_camera=False, **style
                )
            else:
                shaded: Style = {"ambient": 0.5, **style}
                shade(plotter.add_mesh(data, show_scalar_bar=False, render=False, reset_camera=False, **shaded))
        plotter.renderer.ResetCameraClippingRange()
        if not draft:
            return rendered(0.0)
        one, other = (Picture.fromarray(rendered(shift)) for shift in (0.25, -0.25))
        return np.asarray(Picture.blend(one, other, 0.5))

    def rendered(shift: float) -> Image:
        """Return the window's image, shifted by a fraction of a pixel to the right and upwards."""
        plotter.camera.SetWindowCenter(*(2 * shift / pixels for pixels in camera.size))
        plotter.render_window.Render()  # a second screenshot would not render again
        return np.asarray(plotter.screenshot(return_img=True))

    if tuple(plotter.window_size) != camera.size:
        plotter.window_size = list(camera.size)
    plotter.camera_position = [focus + 10 * far * direction, focus, camera.up]
    plotter.camera.parallel_scale = camera.scale
    try:
        yield shoot
    finally:
        plotter.clear_actors()


# ----------------------------------------------------------------------------------------------------------------------
# Rigid shapes in pictures: surfaces in rendered ones, outlines in sections.


def profile(shape: RigidShape, reach: float) -> Array:
    """Return half the outline of a shape by its axis: distance along it and radius in m, shape (n, 2).

    Args:
        shape: The shape.
        reach: Half the length in m of which a cylinder without ends is drawn, and the radius of a plane's disk.
    """
    if shape.shape == "plane":
        return np.array([[0.0, 0.0], [0.0, reach]])
    if shape.shape == "cylinder":
        return np.array([[-reach, shape.radius], [reach, shape.radius]])
    angle = np.linspace(0.0, np.pi / 2, ALONG)
    end = shape.radius * np.column_stack([np.sin(angle), np.cos(angle)])
    shift = np.array([shape.length / 2, 0.0])
    return np.concatenate([end[::-1] * (-1, 1) - shift, end + shift])


def shape_surface(shape: RigidShape, reach: float) -> PolyData:
    """Return the surface of a shape, in m."""
    if shape.file:
        return surface(*surface_of(shape))
    axis = shape.direction
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    points = profile(shape, reach) @ [axis, first]
    pairs = np.column_stack([np.arange(len(points) - 1), np.arange(1, len(points))])
    swept = lines(points, pairs).extrude_rotate(resolution=AROUND, rotation_axis=tuple(axis), capping=False)
    return swept.triangulate().clean(polys_to_lines=False).translate(shape.at)


def shapes_of(states: States) -> list[RigidShape]:
    return [part for part in states.case.components if isinstance(part, RigidShape)]


def way(states: States, shape: RigidShape, step: float) -> Array:
    """Return the displacement of a shape at a step or between two, in m, shape (3,)."""
    if not shape.guide:
        return np.zeros(3)
    ways = [row[f"{shape.label}_travel_mm"] for row in states.rows]
    return 1e-3 * float(np.interp(step, np.arange(len(ways)), ways)) * shape.gives_way


def shape_layers(states: States, step: float) -> list[Layer]:
    """Return the translucent surfaces of the shapes beside a device at a step; a cylinder and a plane extend slightly beyond
    it."""
    style: Style = {"color": WARNING, "opacity": 0.25, "smooth_shading": True}
    skin, shapes, found = states.skin, shapes_of(states), list[Layer]()
    if not shapes:
        return found
    device = skin.device(skin.points(states.moved(states.main)))
    for shape in shapes:
        drawn, reach = shape, 1.1 * float(np.abs((device - np.asarray(shape.at)) @ shape.direction).max())
        if shape.shape == "plane":
            drawn, reach = below(shape, device)
        found.append((shape_surface(drawn, reach).translate(way(states, shape, step)), style))
    return found


def below(plane: RigidShape, device: Array) -> tuple[RigidShape, float]:
    """Return a plane with its point next to the centre of a device, points of shape (n, 3), and its drawn
    radius."""
    middle, normal = (device.min(axis=0) + device.max(axis=0)) / 2, plane.direction
    foot = np.round(middle - ((middle - np.asarray(plane.at)) @ normal) * normal, 12)  # no rounding beside the axis
    beside = device - foot
    beside = beside - np.outer(beside @ normal, normal)
    return dataclasses.replace(plane, at=tuple(map(float, foot))), 1.1 * float(np.linalg.norm(beside, axis=1).max())


def draw_outlines(axes: Axes, states: States, step: int) -> None:
    """Draw the outlines of shapes at a step into an axisymmetric section in millimetres, whose limits stay."""
    limits = axes.get_xlim(), axes.get_ylim()
    for shape in shapes_of(states):
        line = profile(shape, 10.0)
        side = np.sign(shape.direction[2]) if shape.shape != "sphere" else 1.0
        middle = shape.at[2] + way(states, shape, step)[2]
        axes.plot(1e3 * line[:, 1], 1e3 * (middle + side * line[:, 0]), color=WARNING, linewidth=1.5, linestyle="--")
    axes.set(xlim=limits[0], ylim=limits[1])


# ----------------------------------------------------------------------------------------------------------------------
# Viewpoint of a device: which images of its slice, and the camera direction, the same for every picture of a run.


SOLID_STYLE: Style = {"smooth_shading": True, "culling": "back"}
"""Style of a closed surface: back faces are culled."""
BESIDE = 0.5
"""Distance from a device within which rigid shapes are shown, relative to its size."""


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
        """Whether some images are omitted, so that cuts are visible."""
        return len(self.kept) < len(self.states.skin.images)

    @property
    def up(self) -> Array:
        return np.asarray(self.states.actuator.lift)

    def points(self, step: float, kept: npt.NDArray[np.intp] | None = None) -> Array:
        """Return the deformed vertices of the shown images in m, shape (n, 3)."""
        skin = self.states.skin
        moved = self.states.points + self.states.between(step, "displacement")
        return skin.device(skin.points(moved), self.kept if kept is None else kept)

    def camera(self, steps: list[int], width: int = PIXELS, tallest: float = 0.62) -> ViewCamera:
        """Return the camera that frames some states, and nearby parts of rigid shapes."""
        clouds = [self.points(step) for step in steps]
        low, high = (limit([limit(cloud, axis=0) for cloud in clouds], axis=0) for limit in (np.min, np.max))
        around = BESIDE * float(np.max(high - low))
        shapes = [np.asarray(data.points) for step in steps for data, _ in shape_layers(self.states, step)]
        clouds += [np.clip(cloud, low - around, high + around) for cloud in shapes]
        if self.plate is not None:
            clouds.append(self.plate)
        return ViewCamera.around(clouds, self.direction, self.up, width, tallest)

    @functools.cached_property
    def plate(self) -> Array | None:
        """Corners of the drawn part of the contact plane, in m, shape (k, 3); None without one.

        A cut plane on which walls meet their mirror image is the device's own middle, and is not drawn.
        """
        obstacle, skin = obstacle_of(self.states.case.components), self.states.skin
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
        """Return the layers of contact obstacles at a step: shapes, and the plane with a border; empty without any."""
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
        """Return a common scale for the visible surface of some states: everything if a cut is visible, else only the
        outside."""
        states, skin = self.states, self.states.skin
        rows = [states.rows[step] for step in steps]
        if self.opened:
            return Scale(np.array([states.field(step, field) for step in steps]), field, rows=rows)
        seen = np.unique(skin.nodes[skin.triangles[skin.part == OUTSIDE][self._facing(steps[-1])]])
        return Scale(np.array([states.field(step, field)[seen] for step in steps]), field, "visible surface", rows)

    def _facing(self, step: int) -> npt.NDArray[np.bool_]:
        """Return which triangles of the outside face the viewer in one of the images, shape (t,)."""
        skin = self.states.skin
        a, b, c = skin.points(self.states.moved(step))[skin.triangles[skin.part == OUTSIDE]].transpose(1, 0, 2)
        towards = np.linalg.inv(skin.images[self.kept]) @ self.direction
        flipped = np.sign(np.linalg.det(skin.images[self.kept]))
        return np.asarray((np.cross(b - a, c - a) @ towards.T * flipped > 0).any(axis=1))

    def coloured(self, step: float, scale: Scale) -> list[Layer]:
        """Return the layers of a state, coloured, with its sharp edges."""
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
        """Return the layers of a state with a translucent outside; its cavities' walls before it in a style, None leaves them
        out."""
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
    """Return the unit vector at an azimuth and an elevation in degrees, above the plane across ``up``, an axis."""
    a, e = np.radians(azimuth), np.radians(elevation)
    turned = np.roll(
        np.eye(3), int(np.argmax(np.abs(up))) - 2, axis=1
    )  # rows: x, y and z of a device that rises along z
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]) @ turned


def look(states: States) -> Look:
    """Return how a device is shown: a round one without a quarter, another one whole, from the side of its free end."""
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
    """Return the view of a slice; that of a whole device if it is one."""
    if not len(states.skin.planes):
        return look(states).direction
    return across_cut(states.skin, np.asarray(states.actuator.lift))


def across_cut(skin: Surface, up: Array) -> Array:
    """Return the view across the first cut plane of a slice, a little from the side and from above."""
    planes = skin.planes
    # A wide slice shows its second cut plane too, unless the view is edge-on to it.
    side = np.cross(up, planes[0])
    turned = np.radians(28.0 if len(planes) > 1 and len(skin.images) >= 4 else 14.0)
    flat = np.cos(turned) * planes[0] + np.sin(turned) * side
    return np.cos(np.radians(24.0)) * flat + np.sin(np.radians(24.0)) * up


# ----------------------------------------------------------------------------------------------------------------------
# Regions of largest stretch: 1 % of the surface, bounded by an isoline.
#
# The stretch is the nodal field, continuous over the cells; whole cells would give ragged patches.


HOT = 1.0
"""Percentage of the surface (outside and cavity walls) shown as hot."""


@dataclasses.dataclass(frozen=True, eq=False)
class HotSpots:
    """The regions of largest stretch of a state.

    Attributes:
        limit: The largest stretch that `HOT` percent of the surface exceeds.
        peak: Where the largest stretch is in the deformed slice, m, shape (3,); None if unknown.
        note: Its value and place in words.
    """

    limit: float
    peak: Array | None
    note: str


def hot_spots_of(states: States, step: int) -> HotSpots:
    """Return the regions of largest stretch of a state."""
    return HotSpots(hot_limit(states, step), peak_place(states, step), peak_text(states, step))


def hot_limit(states: States, step: int) -> float:
    """Return the largest stretch that `HOT` percent of the device's surface (at rest) exceeds."""
    skin = states.skin
    triangles = skin.triangles[skin.part != CUT]
    a, b, c = skin.points(states.points)[triangles].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    value = states.field(step, "largest_stretch")[skin.nodes][triangles].mean(axis=1)
    order = np.argsort(value)
    covered = np.cumsum(area[order]) / area.sum()
    return float(value[order][min(int(np.searchsorted(covered, 1 - HOT / 100)), len(order) - 1)])


def hot_layers(states: States, step: int, limit: float, scale: Scale) -> list[Layer]:
    """Return the walls of the cavities coloured by stretch, the outside above a limit, and the isoline of the
    limit."""
    skin = states.skin
    stretch = states.field(step, scale.field)[skin.nodes]
    everything = np.arange(len(skin.images))
    points = skin.device(skin.points(states.moved(step)))
    layers: list[Layer] = []
    style: Style = {"scalars": "values", "cmap": scale.colours, "clim": (0.0, 1.0), "ambient": 0.7}
    for inside in (True, False):
        chosen = skin.part > OUTSIDE if inside else skin.part == OUTSIDE
        if not chosen.any():
            continue
        data = surface(points, skin.device_triangles(chosen, everything))
        data.point_data["stretch"] = np.tile(stretch, len(everything))
        data.point_data["values"] = np.tile(scale.share(states.field(step, scale.field))[skin.nodes], len(everything))
        shown = data if inside else data.clip_scalar(scalars="stretch", invert=False, value=limit)
        if shown.n_cells:
            layers.append((shown, style))
        lines = data.contour([limit], scalars="stretch")
        if lines.n_cells:
            layers.append((lines, {"color": "black", "line_width": 2.5}))
    return layers


def hot_title(limit: float) -> str:
    """Return the title of the picture."""
    return f"The {HOT:g} % of the surface with the largest stretch: above {limit:.3g}, inside the black line"


def peak_text(states: States, step: int) -> str:
    """Return the value and place of the largest stretch of a state, from ``path.csv``."""
    row, words = states.rows[step], states.words
    under = load(row, words) if "load_step" in row else words.under(row, f"{number(row['pressure_cm'])} cm")
    if "max_stretch" not in row:
        return f"largest stretch at a node {states.field(step, 'largest_stretch').max():.4g} at {under}"
    text = f"largest stretch {row['max_stretch']:.4g} at {under}"
    if "max_stretch_x_mm" not in row:
        return text
    place = ", ".join(f"{axis} = {row[f'max_stretch_{axis}_mm']:.2f}" for axis in "xyz")
    return f"{text}; at the ring, undeformed position {place} mm"


def peak_place(states: States, step: int) -> Array | None:
    """Return where the largest stretch of ``path.csv`` is in the deformed slice, m, shape (3,); None if unknown."""
    row = states.rows[step]
    if "max_stretch_x_mm" not in row:
        return None
    place = np.array([row[f"max_stretch_{axis}_mm"] for axis in "xyz"]) * 1e-3
    if states.actuator.dimension == 2:
        place = np.array([np.hypot(place[0], place[1]), 0.0, place[2]])
    nearest = np.argsort(np.linalg.norm(states.points - place, axis=1))[:4]
    return np.asarray(place + states.field(step, "displacement")[nearest].mean(axis=0))
