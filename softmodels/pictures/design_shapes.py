"""The device as given and the design side by side, deformed: one camera, one colour scale."""

from __future__ import annotations

from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from softmodels.pictures.colour_scale import FOOT, Scale
from softmodels.pictures.offscreen import PIXELS, Camera, Image, studio
from softmodels.pictures.style import DPI, FAINT, INK, WIDTH, headline, wrapped
from softmodels.pictures.viewpoint import Look, look
from softmodels.results.stored import States
from softmodels.results.triangles import outline

NAMES = ("as given", "design")


def shapes(pair: tuple[States, States]) -> Figure:
    """Both devices at their last requested state, coloured by von Mises stress."""
    looks = [look(states) for states in pair]
    scales = [one.scale([one.states.main]) for one in looks]
    scale = max(scales, key=lambda one: one.top)
    scale.largest = max(one.largest for one in scales)
    clouds = [one.points(step) for one in looks for step in (0, one.states.main)]
    camera = Camera.around(clouds, looks[0].direction, looks[0].up, PIXELS // 2, 1.1)
    images = [_image(one, camera, scale) for one in looks]
    wide, tall = WIDTH / 2, WIDTH / 2 * images[0].shape[0] / images[0].shape[1]
    head = 0.85
    whole = head + tall + FOOT
    figure = Figure((WIDTH, whole), dpi=DPI)
    for k, (one, image, name) in enumerate(zip(looks, images, NAMES, strict=True)):
        axes = figure.add_axes((k * 0.5, FOOT / whole, 0.5, tall / whole))
        axes.imshow(image)
        axes.set_axis_off()
        states = one.states
        title = wrapped(f"{name}: {headline(states.rows[states.main], states.words)}", wide, 12)
        figure.text(0.25 + 0.5 * k, 1 - 0.15 / whole, title, ha="center", va="top", fontsize=12)
    scale.bar(figure)
    return figure


def _image(one: Look, camera: Camera, scale: Scale) -> Image:
    with studio(camera) as shoot:
        shot: Image = shoot(one.coloured(one.states.main, scale))
    return shot


def sections(pair: tuple[States, States]) -> Figure:
    """Outlines of both half sections, at rest and deformed; of axisymmetric devices."""
    figure = Figure((WIDTH, 5.6), dpi=DPI, layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, states, name in zip(panels, pair, NAMES, strict=True):
        title = f"{name}: {headline(states.rows[states.main], states.words)}"
        for points, colour in ((states.points, FAINT), (states.moved(states.main), INK)):
            flat = list(outline(points[:, ::2] * 1e3, states.cells))
            axes.add_collection(LineCollection(flat, colors=colour, linewidths=1.4))
        axes.autoscale_view()
        axes.set_aspect("equal")
        axes.set_title(wrapped(title, WIDTH / 2, 12), fontsize=12)
        axes.set_xlabel("radius in mm")
    panels[0].set_ylabel("height in mm")
    return figure
