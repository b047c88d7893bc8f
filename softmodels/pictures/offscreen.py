"""Off-screen rendering of surfaces and lines in parallel projection, and a check whether this machine can render."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Literal, TypedDict

import numpy as np
import numpy.typing as npt
from PIL import Image as Picture, ImageFilter

from softmodels.common import commands
from softmodels.common.arrays import Array, triple
from softmodels.common.lazy import pyvista
from softmodels.components import contact, shapes
from softmodels.pictures.style import DPI, EDGE, INK, WARNING, WIDTH_INCHES, Caption, Scale, subject
from softmodels.runs import grid, labels
from softmodels.runs.fields import coloured
from softmodels.runs.states import StoredStates

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from pyvista import Actor, Plotter, PolyData


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


WIDTH_PX = round(WIDTH_INCHES * DPI)
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


def _probe(arguments: list[str]) -> bool:
    try:
        done = subprocess.run([sys.executable, "-P", "-c", PROBE, *arguments], capture_output=True, timeout=60, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0


@dataclasses.dataclass(frozen=True)
class ViewCamera:
    """A camera in parallel projection: unit vectors from the thing to the viewer and up in the picture, the point in the
    picture's middle and half the picture's height in m, and its width and height in pixels."""

    direction: tuple[float, float, float]
    up: tuple[float, float, float]
    focus: tuple[float, float, float]
    scale: float
    size: tuple[int, int]

    @classmethod
    def around(
        cls, clouds: Sequence[Array], direction: Array, up: Array, width: int = WIDTH_PX, tallest: float = 0.62
    ) -> ViewCamera:
        """Return the camera that frames point clouds, each (n, 3) in m, from a direction towards the viewer that is not along
        ``up``, in a picture of a width in pixels whose height over it is at most ``tallest``."""
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
        return cls(triple(direction), triple(up), triple(focus), float(scale), (width, height))

    @property
    def metres(self) -> float:
        """Length of a pixel across the view."""
        return 2 * self.scale / self.size[1]

    @property
    def axes(self) -> Array:
        """Where x, y and z point in the picture, to the right and upwards, shape (3, 2)."""
        right = np.cross(self.up, self.direction)
        right /= np.linalg.norm(right)
        return np.column_stack([right, np.cross(self.direction, right)])

    @property
    def text(self) -> str:
        """The camera as text, for a picture's metadata."""
        names = ("direction", "up", "focus", "scale", "size")
        return "; ".join(f"{name} {np.round(getattr(self, name), 9).tolist()}" for name in names)


FACETS_AROUND = 48
"""Facets around a shape, and from an end to its middle."""


def surface(points: Array, triangles: grid.Cells, normals: Array | None = None, values: Array | None = None) -> PolyData:
    """Return the mesh of triangles; points (n, 3) in m, triangles (t, 3), normals (n, 3), values (n,) to colour them by."""
    data = pyvista.PolyData.from_regular_faces(points, triangles)
    if values is not None:
        data.point_data["values"] = values
    if normals is not None:
        data.point_data.active_normals = normals
    return data


def lines(points: Array, pairs: grid.Cells) -> PolyData:
    """Return the straight lines to draw; points (n, 3) in m, pairs of them (e, 2)."""
    return pyvista.PolyData(points, lines=np.column_stack([np.full(len(pairs), 2), pairs]).ravel())


def seen_lines(points: Array, pairs: grid.Cells) -> list[Layer]:
    """Return the layers of straight lines that are seen on all colours, white with a dark rim; arguments as of `lines`."""
    drawn = lines(points, pairs) if len(pairs) else None
    styles: tuple[Style, ...] = ({"color": INK, "line_width": 4.0}, {"color": "#e4e7eb", "line_width": 2.0})
    return [] if drawn is None else [(drawn, style) for style in styles]


def ring(centre: Array, direction: Array, radius: float) -> PolyData:
    """Return a circle to draw around a place, seen from a direction; lengths in m."""
    return pyvista.Polygon(center=centre, radius=radius, normal=direction, n_sides=FACETS_AROUND, fill=False)


@functools.cache
def _plotter(process: int) -> Plotter:
    """Return a render window with lights, cached by process: a new one recompiles its shaders, and none survives a fork."""
    plotter = pyvista.Plotter(off_screen=True, lighting="none")
    plotter.set_background("white")
    add_lights(plotter)
    plotter.camera.parallel_projection = True
    plotter.disable_anti_aliasing()
    return plotter


@contextlib.contextmanager
def studio(camera: ViewCamera) -> Iterator[Shoot]:
    """Provide a function from layers to an image, shape (height, width, 3), for one camera.

    One at a time in a process. Jagged edges are softened by the mean of two images half a pixel apart, which takes half as
    long as four samples a pixel without a graphics card.
    """
    plotter = _plotter(os.getpid())
    direction, focus = np.asarray(camera.direction), np.asarray(camera.focus)
    far = 4 * camera.scale * max(1.0, camera.size[0] / camera.size[1])

    def shoot(layers: Sequence[Layer]) -> Image:
        plotter.clear_actors()
        for data, style in layers:
            lit = style.get("lighting", "scalars" not in style and not data.n_lines)
            how: Style = {"ambient": 0.5, **style, "lighting": True} if lit else {**style, "lighting": False}
            # Lines are offset towards the viewer; in parallel projection this shifts nothing.
            placed = data.translate(1e-3 * far * direction) if data.n_lines else data
            actor = plotter.add_mesh(placed, show_scalar_bar=False, render=False, reset_camera=False, **how)
            if lit:
                shade(actor)
        plotter.renderer.ResetCameraClippingRange()
        picture, other = (Picture.fromarray(rendered(shift)) for shift in (0.25, -0.25))
        return np.asarray(Picture.blend(picture, other, 0.5))

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


class Style(TypedDict, total=False):
    """Drawing style: keywords of ``pyvista.Plotter.add_mesh``."""

    color: str
    scalars: str
    cmap: Colormap
    clim: tuple[float, float]
    opacity: float
    ambient: float
    lighting: bool
    line_width: float
    culling: Literal["front", "back"]
    smooth_shading: bool


# ----------------------------------------------------------------------------------------------------------------------
# The lights of rendered pictures, and how they shade a surface without a field's colours.
#
# Colours are not shaded (ambient light 1), so that each pixel can be read off the colour bar.
#
# VTK computes specular reflection per light and pixel, nearly half of a picture's time without a graphics
# card. Nothing here is specular, so skipping it changes no pixel.


HEADLIGHT_INTENSITY, LAMP_INTENSITY = 0.5, 0.35
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
    plotter.add_light(pyvista.Light(light_type="headlight", intensity=HEADLIGHT_INTENSITY))
    plotter.add_light(pyvista.Light(light_type="camera light", position=LAMP_PLACE, intensity=LAMP_INTENSITY))


def shade(actor: Actor) -> None:
    """Shade a surface by the lights, without specular reflection."""
    lamp = np.array(LAMP_PLACE) / np.linalg.norm(LAMP_PLACE)
    code = SHADING.format(*lamp, HEADLIGHT_INTENSITY, LAMP_INTENSITY)
    actor.GetShaderProperty().AddFragmentShaderReplacement("//VTK::Light::Impl", True, code, False)


Image = npt.NDArray[np.uint8]


# ----------------------------------------------------------------------------------------------------------------------
# Rigid shapes in pictures: surfaces in rendered ones, outlines in sections.


def shape_surface(shape: contact.RigidShape, reach: float) -> PolyData:
    """Return the surface of a shape, in m; see `shapes.Swept.profile`."""
    form = shape.form
    if isinstance(form, shapes.Stl):
        return surface(*form.surface)
    assert isinstance(form, shapes.Swept)
    axis = form.axis
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    points = form.profile(reach) @ [axis, first]
    pairs = np.column_stack([np.arange(len(points) - 1), np.arange(1, len(points))])
    swept = lines(points, pairs).extrude_rotate(resolution=FACETS_AROUND, rotation_axis=tuple(axis), capping=False)
    return swept.triangulate().clean(polys_to_lines=False).translate(shape.at)


def shapes_of(states: StoredStates) -> list[contact.RigidShape]:
    return [part for part in states.case.components if isinstance(part, contact.RigidShape)]


def way(states: StoredStates, shape: contact.RigidShape, step: float) -> Array:
    """Return the displacement of a shape at a step or between two, in m, shape (3,)."""
    if not shape.guide:
        return np.zeros(3)
    ways = states.rows[f"{shape.label}_travel"]
    return float(np.interp(step, np.arange(len(ways)), ways)) * shape.gives_way


def shape_layers(states: StoredStates, step: float) -> list[Layer]:
    """Return the translucent surfaces of the shapes beside a device at a step; a cylinder and a plane extend slightly beyond
    it."""
    style: Style = {"color": WARNING, "opacity": 0.25, "smooth_shading": True}
    skin, rigid, layers = states.skin, shapes_of(states), list[Layer]()
    if not rigid:
        return layers
    device = skin.device(skin.points(states.moved(states.main)))
    for shape in rigid:
        form, drawn, reach = shape.form, shape, 0.0
        if isinstance(form, shapes.Plane):
            drawn, reach = below(shape, form.axis, device)
        elif isinstance(form, shapes.Swept):
            reach = 1.1 * float(np.abs((device - np.asarray(shape.at)) @ form.axis).max())
        layers.append((shape_surface(drawn, reach).translate(way(states, shape, step)), style))
    return layers


def below(plane: contact.RigidShape, normal: Array, device: Array) -> tuple[contact.RigidShape, float]:
    """Return a plane with its point next to the centre of a device, points of shape (n, 3), and its drawn radius."""
    middle = (device.min(axis=0) + device.max(axis=0)) / 2
    foot = np.round(middle - ((middle - np.asarray(plane.at)) @ normal) * normal, 12)  # no rounding beside the axis
    beside = device - foot
    beside = beside - np.outer(beside @ normal, normal)
    return dataclasses.replace(plane, at=tuple(map(float, foot))), 1.1 * float(np.linalg.norm(beside, axis=1).max())


def draw_outlines(axes: Axes, states: StoredStates, step: int) -> None:
    """Draw the outlines of shapes at a step into an axisymmetric section in millimetres, whose limits stay."""
    limits = axes.get_xlim(), axes.get_ylim()
    for shape in shapes_of(states):
        form = shape.form
        assert isinstance(form, shapes.Swept)
        line, side = form.profile(10.0), 1.0 if isinstance(form, shapes.Sphere) else np.sign(form.axis[2])
        middle = shape.at[2] + way(states, shape, step)[2]
        axes.plot(1e3 * line[:, 1], 1e3 * (middle + side * line[:, 0]), color=WARNING, linewidth=1.5, linestyle="--")
    axes.set(xlim=limits[0], ylim=limits[1])


# ----------------------------------------------------------------------------------------------------------------------
# Viewpoint of a device: which images of its slice, and the camera direction, the same for every picture of a run.


SOLID_STYLE: Style = {"smooth_shading": True, "culling": "back"}
"""Style of a closed surface: back faces are culled."""
MAX_SHAPE_DISTANCE = 0.5
"""Distance from a device within which rigid shapes are shown, relative to its size."""


@dataclasses.dataclass(frozen=True)
class Look:
    """A device to look at from a direction, shape (3,): its states, the images of the slice that are shown (of a round device
    about a quarter is left out, to see inside), and the colour map of fields."""

    states: StoredStates
    kept: npt.NDArray[np.intp]
    direction: Array
    colours: str = commands.COLORMAP

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
        return skin.device(skin.points(self.states.moved(step)), self.kept if kept is None else kept)

    def caption(self, step: float, camera: ViewCamera | None = None, scale: Scale | None = None, **more: str) -> Caption:
        """Return what stands around a picture of a state, with further fields of `Caption`; ``scale`` is of its colours."""
        states = self.states
        texts = {"title": labels.headline(states.row(step), states.words), **more}
        of = subject(states.case) + ("; grey: undeformed" if step else "")
        of += "; interpolated between computed states" if step % 1 else ""
        return Caption(
            subject=of,
            metres=None if camera is None else camera.metres,
            axes=None if camera is None else camera.axes,
            largest="" if scale is None else self.largest(scale, step),
            **texts,
        )

    def camera(self, steps: Sequence[float], width: int = WIDTH_PX, tallest: float = 0.62) -> ViewCamera:
        """Return the camera that frames some states, and nearby parts of rigid shapes."""
        clouds = [self.points(step) for step in steps]
        low, high = (limit([limit(cloud, axis=0) for cloud in clouds], axis=0) for limit in (np.min, np.max))
        around = MAX_SHAPE_DISTANCE * float(np.max(high - low))
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
        obstacle, skin = contact.obstacle_of(self.states.case.components), self.states.skin
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

    @functools.cached_property
    def scales(self) -> dict[str, Scale]:
        """The scale of each field, one in all pictures of the run."""
        states, scales = self.states, dict[str, Scale]()
        steps = sorted({*states.shown(), states.main, len(states.rows) - 1})
        for field in coloured():
            values = np.array([states.field(step, field) for step in steps])
            scales[field] = Scale(values, field, [states.row(step) for step in steps], self.colours)
        return scales

    def largest(self, scale: Scale, *steps: float) -> str:
        """Return the largest value of a field in the states of a picture, in words."""
        states = self.states
        values = np.array([states.field(step, scale.field) for step in steps])
        return scale.largest([states.row(step) for step in steps], values)

    def coloured(self, step: float, scale: Scale) -> list[Layer]:
        """Return the layers of a state, coloured, with its sharp edges."""
        states, skin = self.states, self.states.skin
        values = np.tile(scale.share(states.field(step, scale.field))[skin.nodes], len(self.kept))
        shown = self.points(step)
        data = surface(shown, self.visible, None, values)
        style: Style = {"culling": "back", "scalars": "values", "cmap": scale.colours, "clim": (0.0, 1.0)}
        pairs = skin.device_lines(skin.edges, self.kept)
        if self.opened:
            pairs = np.concatenate([pairs, self.open_rims])
        return [(data, style), *seen_lines(shown, pairs), *self.plate_layers(step)]

    def rest(self, kept: npt.NDArray[np.intp]) -> Array:
        """Return the undeformed vertices of some images in m, shape (n, 3)."""
        return self.states.skin.device(self.states.skin.points(self.states.points), kept)

    def at_rest(self, shoot: Shoot, kept: npt.NDArray[np.intp]) -> Image:
        """Return how much of each pixel images of the undeformed slice cover, 0 to 255, shape (height, width)."""
        data = surface(self.rest(kept), self.states.skin.device_triangles(None, kept))
        return 255 - shoot([(data, {"color": "black", "lighting": False})])[..., 0]

    def translucent(self, step: float, walls: Style | None, outside: Style) -> list[Layer]:
        """Return the layers of a state with its outside in a translucent style; its cavities' walls before it in another
        style, None leaves them out."""
        states, skin = self.states, self.states.skin
        moved = skin.points(states.moved(step))
        everything = np.arange(len(skin.images))
        shown, normals = skin.device(moved), skin.device(skin.normals(moved))
        translucent: list[Layer] = []
        for chosen, style in ((skin.part > grid.OUTSIDE_LABEL, walls), (skin.part == grid.OUTSIDE_LABEL, outside)):
            if chosen.any() and style is not None:
                data = surface(shown, skin.device_triangles(chosen, everything), normals)
                translucent.append((data, {"color": "#8fa8c0", "smooth_shading": True, **style}))
        if len(skin.edges):
            edge = lines(shown, skin.device_lines(skin.edges))
            translucent.append((edge, {"color": EDGE, "line_width": 2.0, "opacity": 0.6}))
        return translucent

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
            return skin.device_triangles(skin.part == grid.OUTSIDE_LABEL, self.kept)
        cuts = self._single(skin.device_triangles(skin.part == grid.CUT_LABEL, self.kept))
        return np.concatenate([skin.device_triangles(skin.part != grid.CUT_LABEL, self.kept), cuts])

    def _single(self, corners: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """Of lines or triangles between the shown images, those that are there once; vertices, shape (k, 2 or 3)."""
        places = self.rest(self.kept)[corners].mean(axis=1)
        first = joined_places(places, self.states.actuator.size)
        return np.asarray(corners[np.bincount(first, minlength=len(first))[first] == 1])


def joined_places(points: Array, size: float) -> grid.Cells:
    """Return for each point the first one at its place, shape (n,); lengths and ``size`` in m."""
    # Off the round numbers that meshes like, where the last digit would decide.
    _, first, place = np.unique(np.floor(points / size * 1e6 + 0.4142), axis=0, return_index=True, return_inverse=True)
    return np.asarray(first[place.ravel()])


def direction(azimuth: float, elevation: float, up: Array) -> Array:
    """Return the unit vector at an azimuth and an elevation in degrees, above the plane across ``up``, an axis."""
    a, e = np.radians(azimuth), np.radians(elevation)
    turned = np.roll(np.eye(3), int(np.argmax(np.abs(up))) - 2, axis=1)  # rows: x, y and z of a device that rises along z
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]) @ turned


def look(states: StoredStates, colours: str = commands.COLORMAP) -> Look:
    """Return how a device is shown: a round one without a quarter, another one whole, from the side of its free end."""
    skin, up = states.skin, np.asarray(states.actuator.lift)
    whole = np.arange(len(skin.images))
    if not states.actuator.axial:
        return Look(states, whole, direction(-58.0, 24.0, up), colours)
    if len(whole) == 1:
        return Look(states, whole, direction(-45.0, 32.0, up), colours)
    begin = np.degrees(np.arctan2(skin.planes[0][0], -skin.planes[0][1]))  # across the plane's normal (y, -x)
    centre = skin.points(states.points).mean(axis=0)
    x, y, _ = (skin.images @ centre).T
    around = (np.degrees(np.arctan2(y, x)) - begin) % 360.0
    angle = 360.0 / len(whole)
    removed = max(1, round(len(whole) / 4))
    order = np.argsort(around)
    return Look(states, order[: len(whole) - removed], direction(begin - removed * angle / 2, 32.0, up), colours)


def towards_slice(states: StoredStates) -> Array:
    """Return the view of a slice; that of a whole device if it is one."""
    if not len(states.skin.planes):
        return look(states).direction
    return across_cut(states.skin, np.asarray(states.actuator.lift))


def across_cut(skin: grid.Surface, up: Array) -> Array:
    """Return the view across the first cut plane of a slice, a little from the side and from above."""
    planes = skin.planes
    # A wide slice shows its second cut plane too, unless the view is edge-on to it.
    side = np.cross(up, planes[0])
    turned = np.radians(28.0 if len(planes) > 1 and len(skin.images) >= 4 else 14.0)
    flat = np.cos(turned) * planes[0] + np.sin(turned) * side
    return np.cos(np.radians(24.0)) * flat + np.sin(np.radians(24.0)) * up


# ----------------------------------------------------------------------------------------------------------------------
# The place of the largest stretch: on which wall it is, and where.


@dataclasses.dataclass(frozen=True, eq=False)
class HotSpot:
    """The largest stretch of a state: its place in the deformed slice, m, shape (3,), the wall that it is on in words and as
    part (`OUTSIDE` or the number of a cavity; None inside the silicone), and the load and the place at rest in words."""

    value: float
    place: Array
    part: int | None
    wall: str
    note: str


def hot_spot(states: StoredStates, step: int) -> HotSpot:
    """Return the largest stretch of a state: that of ``path.csv``, or without its place there the largest at a node."""
    row, stretch, skin = states.rows[step], states.field(step, "largest_stretch"), states.skin
    value = row["max_stretch"] if "max_stretch" in row else float(stretch.max())
    rest = states.points[int(np.argmax(stretch))]
    if "max_stretch_x" in row:
        rest = np.array([row[f"max_stretch_{axis}"] for axis in "xyz"])
    flat = np.array([np.hypot(*rest[:2]), 0.0, rest[2]]) if states.actuator.dimension == 2 else rest
    # The wall that the nearest cell has nodes on, and of these the one nearest to the place.
    cell = states.cells[np.argmin(np.linalg.norm(states.points[states.cells].mean(axis=1) - flat, axis=1))]
    part_of = np.full(len(states.points), grid.CUT_LABEL)
    for walls in range(skin.cavities + 1):
        part_of[skin.nodes[skin.triangles[skin.part == walls]]] = walls
    near = cell[np.argsort(np.linalg.norm(states.points[cell] - flat, axis=1))]
    part = next((int(part_of[node]) for node in near if part_of[node] != grid.CUT_LABEL), None)
    name = {None: "inside the silicone", grid.OUTSIDE_LABEL: "on the outer face"}.get(part, f"on the wall of cavity {part}")
    name = "on the cavity's wall" if part == skin.cavities == 1 else name
    words = states.words
    pressure = f"{labels.number(row.shown('pressure'))} {words.unit}"
    under = labels.load(row, words) if "load_step" in row else words.under(row, pressure)
    at = ", ".join(f"{axis} = {1e3 * x:.2f}" for axis, x in zip("xyz", rest, strict=True))
    return HotSpot(
        value, flat + states.field(step, "displacement")[near[:4]].mean(axis=0), part, name,
        f"largest stretch {value:.4g} at {under}; at the ring, undeformed position {at} mm",
    )  # fmt: skip


def outlined(images: Sequence[Image], covered: Image) -> list[Image]:
    """Return images with the outline of what covers a part of them; ``covered`` as of `Look.at_rest`."""
    soft = np.asarray(Picture.fromarray(covered).filter(ImageFilter.BoxBlur(1)), dtype=np.float32) / 255
    line = 1 - np.abs(2 * soft - 1)
    on, outlined_images = line > 0.02, [image.copy() for image in images]
    for image in outlined_images:
        image[on] = image[on] + line[on, None] * (np.array(OUTLINE_COLOUR) - image[on])
    return outlined_images


OUTLINE_COLOUR = (150, 150, 150)
