"""What a notebook shows of results: small pictures on their cards, the device in space, the film.

Imported when something is drawn, so that a script that draws nothing needs no renderer.
"""

from __future__ import annotations

import dataclasses
import io
import operator
import os
import sys
import tempfile
import warnings
from collections.abc import Callable, Mapping
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from PIL import Image as Picture

from softmodels.case.entries import CaseError
from softmodels.common import errors, files, names, processes, units
from softmodels.common.lazy import pyvista
from softmodels.pictures import offscreen, solid
from softmodels.pictures.style import CURVE, INK, STYLE, WARNING, drawn
from softmodels.runs import fields
from softmodels.runs.labels import headline
from softmodels.runs.outcomes import RunError
from softmodels.runs.states import StoredStates

if TYPE_CHECKING:
    from softmodels.casting import make
    from softmodels.design.result import DesignResult
    from softmodels.fitting import comparison
    from softmodels.runs.analyses import Limit


# ----------------------------------------------------------------------------------------------------------------------
# The small picture on a result's card.


CARD_WIDTH_PX = 640
"""Width of a card's picture in pixels; it is shown at two thirds of it."""

type Drawing = Figure | Picture.Image | None


def picture(result: object) -> bytes:
    """Return a result's picture as WebP, small enough for a notebook; empty if it has none."""
    large = matplotlib.rc_context({"font.size": 20, "axes.titlesize": 20, "legend.fontsize": 17, "lines.linewidth": 3.0})
    with matplotlib.rc_context(STYLE), large:  # letters for pictures that are three times as wide
        figure = _figure(result)
        if figure is None:
            return b""
        image = drawn(figure) if isinstance(figure, Figure) else figure
    image.thumbnail((CARD_WIDTH_PX, CARD_WIDTH_PX), Picture.Resampling.LANCZOS)
    stream = io.BytesIO()
    image.save(stream, "WEBP", quality=85)
    return stream.getvalue()


def _figure(result: object) -> Drawing:
    """Draw a result: a run as its path, a state as the deformed device, some by their class; of others the table says all."""
    if (draw := DRAWINGS.get(type(result).__name__)) is not None:
        return draw(result)
    states = getattr(result, "_states", None)
    if states is None or len(states.rows) == 1:
        return None if states is None else _frame(states)
    from softmodels.pictures import curves

    if states.case.program:
        return curves.steps(states.rows, states.words)
    gauge, over = states.words.gauge, curves.over_of(states.case)
    return curves.rise(states.rows, gauge, states.case.column, states.branch, over, states.sources)


def _frame(states: StoredStates) -> Drawing:
    """Draw the last state as a film shows it; where nothing can be rendered, a section."""
    if offscreen.can_render():
        return Picture.fromarray(solid.render_frames(offscreen.look(states), 1)[0])
    if states.actuator.dimension == 3:
        return None
    return solid.section_stress(offscreen.look(states), len(states.rows) - 1)


def _limit(limit: Limit) -> Drawing:
    if not limit.path:
        return None
    from softmodels.pictures import curves

    volumes, pressures = np.array(limit.path).T
    figure = Figure((8.0, 5.0), dpi=80, layout="constrained")
    axes = figure.subplots()
    axes.plot(*curves.smooth(np.column_stack([volumes * 1e6, pressures / 1e3])).T, color=CURVE)
    mark = "D" if limit.exists else "o"
    axes.plot(limit.added_volume * 1e6, limit.pressure / 1e3, mark, color=WARNING, markersize=12)
    axes.set(xlabel="added volume in ml", ylabel="pressure in kPa")
    axes.margins(0.05)
    return figure


def _fit(report: comparison.FitReport) -> Drawing:
    from softmodels.pictures import fits

    if report.curves:
        return fits.draw_curves(report)
    law = report.chosen.choice.name
    return fits.draw_outlines(report.photographs[law], law)


def _design(result: DesignResult) -> Drawing:
    from softmodels.design.result import parameters_told
    from softmodels.pictures import draw_design

    return draw_design.parameters(parameters_told(result))


def _mould(mould: make.Mould) -> Drawing:
    from softmodels.casting import pictures

    return pictures.exploded_picture(mould) if offscreen.can_render() else None


DRAWINGS: Mapping[str, Callable[..., Drawing]] = {
    "Limit": _limit, "FitReport": _fit, "DesignResult": _design, "Mould": _mould,
    "Comparison": operator.methodcaller("plot"),
}  # fmt: skip
"""By class, so that a run's card does not import fits, designs and moulds."""


# ----------------------------------------------------------------------------------------------------------------------
# The device in space, by PyVista.


def show(states: StoredStates, field: str) -> object:
    """Show the last of some states, coloured by a field, and return what a notebook shows; the picture's file where there is
    neither a notebook nor a display; None of a window. `CaseError` for another field, `RunError` if this machine cannot
    render."""
    if field not in fields.coloured():
        raise CaseError(f"field is {units.brief(field)}; {errors.known_are(field, fields.coloured())}")
    windowed = not processes.in_notebook() and (sys.platform != "linux" or bool(os.environ.get("DISPLAY")))
    if not windowed:
        _check_rendering()
    elif sys.platform == "linux":
        os.environ[offscreen.WINDOW] = "vtkXOpenGLRenderWindow"  # pictures may have chosen one that is never shown
    plotter = pyvista.Plotter(lighting="none", off_screen=not windowed)
    _fill(plotter, offscreen.look(states), len(states.rows) - 1, field)
    if not processes.in_notebook() and not windowed:
        file = Path(tempfile.mkdtemp(prefix="softmodels-")) / f"{states.case.name}.png"
        plotter.screenshot(file)
        plotter.close()
        return file
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it shows a picture where trame is missing
        return plotter.show(return_viewer=processes.in_notebook())


def _check_rendering() -> None:
    if not offscreen.can_render():
        raise RunError("this machine cannot render; softmodels doctor names what is missing")


COLOUR_BAR_LABELS = 5
"""Labels of a colour bar."""
FOOT_SHARE, HEAD_SHARE = 0.17, 0.05
"""Shares of a window for the colour bar and for the title."""


def _fill(plotter: pyvista.Plotter, shown: offscreen.Look, step: int, field: str) -> None:
    """Add a deformed device to a plotter, with its colour bar, title and camera."""
    states, scale = shown.states, shown.scales[field]
    offscreen.add_lights(plotter)
    plotter.set_background("white")
    plotter.enable_anti_aliasing("msaa", multi_samples=4)
    ticks = scale.ticks() if scale.power != 1.0 else np.linspace(scale.low, scale.top, COLOUR_BAR_LABELS).tolist()
    labels = {float(scale.norm(value)): f"{value:.3g}" for value in ticks}
    title = f"{scale.what} ({scale.unit})" if scale.unit else scale.what
    bar = {"title": title, "n_labels": 0, "color": INK, "width": 0.6, "position_x": 0.2, "position_y": 0.06}
    for data, style in shown.coloured(step, scale):
        if "scalars" in style:
            plotter.add_mesh(data, lighting=False, annotations=labels, scalar_bar_args=bar, **style)
        else:
            plotter.add_mesh(data, lighting="ambient" in style, show_scalar_bar=False, **style)
    plotter.add_text(headline(states.rows[step], states.words), font_size=10, color=INK)
    camera = shown.camera([step])
    direction, (wide, high) = np.asarray(camera.direction), plotter.window_size
    upwards = np.cross(direction, np.cross(camera.up, direction))
    # The device stands between the title and the colour bar, and as wide as the window.
    reach = camera.scale * max(1.0, camera.size[0] / camera.size[1] * high / wide) / (1.0 - FOOT_SHARE - HEAD_SHARE)
    focus = np.asarray(camera.focus) - (FOOT_SHARE - HEAD_SHARE) * reach * upwards / np.linalg.norm(upwards)
    plotter.camera_position = [focus + 40 * camera.scale * direction, focus, camera.up]
    plotter.camera.parallel_projection = True
    plotter.camera.parallel_scale = reach
    plotter.renderer.ResetCameraClippingRange()


# ----------------------------------------------------------------------------------------------------------------------
# The film.


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Animation:
    """The film of a run, which a notebook plays; frames are of shape (height, width, 3)."""

    frames: tuple[offscreen.Image, ...]

    def __repr__(self) -> str:
        height, width, _ = self.frames[0].shape
        return f"<Animation of {len(self.frames)} frames, {width} x {height} pixels, {solid.MOTION_SECONDS:g} s>"

    def _repr_html_(self) -> str:
        source = files.data_uri(solid.webp([*self.frames]), "image/webp")
        return f'<img alt="{escape(repr(self))}" src="{source}" style="width:40em;max-width:100%">'

    def save(self, path: str | Path) -> Path:
        """Write the film, ``.gif``, ``.webp`` or ``.mp4``, and return the file; an earlier one is replaced.

        Raises:
            CaseError: Another ending.
            ImportError: MP4 without imageio-ffmpeg.
            RunError: The film could not be encoded.
            OSError: The file cannot be written.
        """
        file, frames = names.place("path", path), [*self.frames]
        encoders = {".gif": solid.gif, ".webp": solid.webp}
        if file.suffix == ".mp4":
            errors.required("imageio_ffmpeg", "film")
            try:
                solid.write_mp4(file, frames)
            except RuntimeError as error:
                raise RunError(str(error)) from error
        elif file.suffix in encoders:
            files.write_bytes(file, encoders[file.suffix](frames))
        else:
            raise CaseError(f"{file} ends in {file.suffix or 'nothing'}; a film is a .gif, .webp or .mp4")
        return file


def animate(states: StoredStates) -> Animation:
    """Return the film of some states; `RunError` if this machine cannot render."""
    _check_rendering()
    return Animation(tuple(solid.render_frames(offscreen.look(states))))
