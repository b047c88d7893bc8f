"""The colours of a field and their bar, and a rendered image above them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist
from matplotlib.backend_bases import RendererBase
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from softmodels.pictures.style import DPI, EDGE, WARNING, WIDTH, Array, title_colour, wrapped
from softmodels.results.output_fields import coloured
from softmodels.results.row import Row

COLOURS = "Spectral_r"
FOOT = 1.15
"""Inches below a picture for the bar of its colours and what is said of it."""
CLIPPED = 99.5
"""Percentile of the nodal values at which the colours end."""


class Pixels(Artist):
    """An image on a page, pixel for pixel: matplotlib's own would be resampled, which takes ten times as long.

    Args:
        image: Shape (height, width, 3).
        above: Pixels below it.
        left: Pixels to the left of it.
    """

    def __init__(self, image: npt.NDArray[np.uint8], above: int, left: int = 0):
        super().__init__()
        self._image, self._above, self._left = image, above, left

    def get_window_extent(self, renderer: RendererBase | None = None) -> Bbox:
        return Bbox.from_bounds(self._left, self._above, self._image.shape[1], self._image.shape[0])

    def draw(self, renderer: RendererBase) -> None:
        opaque = np.full((*self._image.shape[:2], 1), 255, dtype=np.uint8)
        renderer.draw_image(renderer.new_gc(), self._left, self._above, np.dstack([self._image, opaque])[::-1])


def page(image: npt.NDArray[np.uint8], title: str, scale: Scale | None = None, note: str = "") -> Figure:
    """A rendered image under its title, with the colour bar below if it shows a field.

    Title and note go on in further lines where they are wider than the page: a program names every cavity's pressure.
    """
    title, note = wrapped(title, WIDTH, 13), wrapped(note, WIDTH, 11)
    above = 0.28 + 0.22 * title.count("\n")  # to the last line of the title, inches
    below = 0.32 + 0.19 * note.count("\n") if note else 0.0
    head, foot = above + below + (0.25 if note else 0.27), 0.0 if scale is None else FOOT
    whole = head + image.shape[0] / DPI + foot
    figure = Figure((WIDTH, whole), dpi=DPI)
    figure.add_artist(Pixels(image, round(foot * DPI)))
    figure.text(0.5, 1 - 0.17 / whole, title, ha="center", va="top", fontsize=13, color=title_colour(title))
    figure.text(0.5, 1 - (above + 0.23) / whole, note, ha="center", va="top", fontsize=11, color=WARNING)
    if scale is not None:
        scale.bar(figure)
    return figure


class Scale:
    """The colours of a field, from its least value at rest up to nearly its largest.

    Corners make a few nodes stand far out, and a scale up to them would leave the body one colour. The scale therefore
    ends where, in the state that has most, a two-hundredth of the nodes lies above it; the bar says so. The largest value
    that it tells is the one of ``path.csv``, over the integration points of the whole device: nodal values scatter around it.

    Args:
        values: Nodal values of the states that are shown, SI units, shape (n,) or (states, n).
        field: Name of the field, one of `coloured`.
        where: Words for where the values were taken, such as "outside"; empty for everywhere.
        rows: Rows of ``path.csv`` of the states that are shown, for the largest value.
    """

    def __init__(self, values: Array, field: str = "von_mises", where: str = "", rows: Sequence[Row] = ()):
        shown, colours = coloured()[field]
        self.what, self.unit, self.factor, self.low = shown.title, colours.unit, colours.factor, colours.rest
        column = shown.largest.column if shown.largest else ""
        self.field, self.where = field, where
        told = [float(row[column]) for row in rows if column in row]
        self.largest = max(told) if told else float(values.max()) * self.factor
        self.defined = "at an integration point" if told else "at a node"
        self.top = float(np.percentile(values, CLIPPED, axis=-1).max()) * self.factor
        if not self.top > self.low:
            self.top = max(self.largest, self.low + 1.0)
        self.power = colours.power
        self.colours = matplotlib.colormaps[COLOURS]

    @property
    def norm(self) -> Normalize:
        """From a value in the bar's unit to its place along the colours, 0 to 1."""
        return (
            PowerNorm(self.power, self.low, self.top, clip=True) if self.power != 1.0 else Normalize(self.low, self.top)
        )

    def share(self, values: Array) -> Array:
        """Places along the colours, 0 to 1, of values in SI units; any shape."""
        return np.clip((values * self.factor - self.low) / (self.top - self.low), 0.0, 1.0) ** self.power

    def ticks(self) -> list[float]:
        """Values of the bar's unit to write below colours that are not spread evenly: 1, 2 and 5 times powers of ten."""
        high = math.floor(math.log10(self.top))
        series = [k * 10.0**n for n in range(high, high - 4, -1) for k in (5, 2, 1) if k * 10.0**n <= self.top]
        chosen, before = [], 1.15
        for value in series:
            place = float(self.norm(value))
            if 0.08 < place < before - 0.09:
                chosen.append(value)
                before = place
        return [self.low, *chosen[::-1]]

    def bar(self, figure: Figure) -> None:
        """Draw the bar at the foot of a figure, which must be `FOOT` inches high or more."""
        whole = figure.get_figheight()
        axes = figure.add_axes((0.2, 0.82 / whole, 0.6, 0.18 / whole))
        unit = (f" in {self.unit}" if self.unit else "") + (f", {self.where}" if self.where else "")
        largest = f"{self.largest:.4g} {self.unit}".strip()
        anywhere = " in the whole device" if self.where else ""
        note = f"{CLIPPED:g} % of the nodes lie within the colours; largest{anywhere}, {self.defined}: {largest}"
        scale = ScalarMappable(self.norm, self.colours)
        extend = "max" if self.largest > self.top else "neither"
        bar = figure.colorbar(scale, cax=axes, orientation="horizontal", extend=extend, label=f"{self.what}{unit}")
        if self.power != 1.0:
            bar.set_ticks(self.ticks())
        figure.text(0.5, 0.14 / whole, note, ha="center", fontsize=10.5, color=EDGE)
