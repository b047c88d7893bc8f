"""Surfaces and lines to pixels, off screen, in parallel projection; and whether this machine can do it at all."""

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

from softmodels.pictures.lighting import add_lights, shade
from softmodels.pictures.style import DPI, WIDTH
from softmodels.results.triangles import Array, Cells

if TYPE_CHECKING:
    from matplotlib.colors import Colormap
    from pyvista import Plotter, PolyData

PIXELS = round(WIDTH * DPI)
"""Width of a picture."""

SAMPLES = 4
"""Of a pixel, against jagged edges."""

Image = npt.NDArray[np.uint8]


class Style(TypedDict, total=False):
    """How something is drawn: keywords of ``pyvista.Plotter.add_mesh``."""

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
"""What is drawn, and how."""
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


@functools.cache
def can_render() -> bool:
    """Whether VTK can draw here; on Linux this also settles in which kind of window, through VTK's own variable.

    Without a way to render, VTK does not raise but crashes, so that a process of its own has to try. The kind that
    needs no display comes first, because VTK prints warnings on its own way to it.
    """
    variable = "VTK_DEFAULT_OPENGL_WINDOW"
    if variable in os.environ or sys.platform != "linux":
        return _probe([])
    for window in ("vtkEGLRenderWindow", "vtkXOpenGLRenderWindow", "vtkOSOpenGLRenderWindow"):
        if window != "vtkXOpenGLRenderWindow" or os.environ.get("DISPLAY"):
            os.environ[variable] = window
            if _probe([window]):
                return True
    del os.environ[variable]
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
class Camera:
    """From where something is seen, in parallel projection.

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
    ) -> Camera:
        """The camera that sees all of some clouds of points, each (n, 3) in m, and not much more.

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
        """All of it, for the metadata of a picture."""
        names = ("direction", "up", "focus", "scale", "size")
        return "; ".join(f"{name} {np.round(getattr(self, name), 9).tolist()}" for name in names)

    def smaller(self, width: int) -> Camera:
        """The same view in fewer pixels."""
        return dataclasses.replace(self, size=(width, 2 * round(width * self.size[1] / self.size[0] / 2)))


def _triple(vector: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in vector)
    return x, y, z


def surface(points: Array, triangles: Cells, normals: Array | None = None, values: Array | None = None) -> PolyData:
    """Triangles to draw; points (n, 3) in m, triangles (t, 3), normals (n, 3), values (n,) to colour them by."""
    import pyvista

    data = pyvista.PolyData.from_regular_faces(points, triangles)
    if values is not None:
        data.point_data["values"] = values
    if normals is not None:
        data.point_data.active_normals = normals
    return data


def lines(points: Array, pairs: Cells) -> PolyData:
    """Straight lines to draw; points (n, 3) in m, pairs of them (e, 2)."""
    import pyvista

    return pyvista.PolyData(points, lines=np.column_stack([np.full(len(pairs), 2), pairs]).ravel())


def ring(centre: Array, direction: Array, radius: float) -> PolyData:
    """A circle to draw around a place, seen from a direction; lengths in m."""
    first = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    first /= np.linalg.norm(first)
    around = np.linspace(0.0, 2 * np.pi, 49)[:-1]
    across = np.cross(direction / np.linalg.norm(direction), first)
    points = centre + radius * (np.cos(around)[:, None] * first + np.sin(around)[:, None] * across)
    return lines(points, np.column_stack([np.arange(48), np.roll(np.arange(48), -1)]))


@functools.cache
def _plotter(multisampled: bool, process: int) -> Plotter:
    """A window to render in, with its lights: kept, because a new one compiles its shaders anew.

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
def studio(camera: Camera, draft: bool = False) -> Iterator[Shoot]:
    """A place to take pictures in, with one camera: gives a function from layers to an image, shape (height, width, 3).

    One at a time in a process.

    Args:
        camera: From where it is seen.
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
                # Lifted off the surface towards the viewer; in parallel projection nothing shifts.
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
        """What the window shows, moved by a part of a pixel to the right and upwards."""
        plotter.camera.SetWindowCenter(*(2 * shift / pixels for pixels in camera.size))
        plotter.render_window.Render()  # a second screenshot would not
        return np.asarray(plotter.screenshot(return_img=True))

    if tuple(plotter.window_size) != camera.size:
        plotter.window_size = list(camera.size)
    plotter.camera_position = [focus + 10 * far * direction, focus, camera.up]
    plotter.camera.parallel_scale = camera.scale
    try:
        yield shoot
    finally:
        plotter.clear_actors()
