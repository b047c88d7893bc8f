"""Common style of all pictures: size, line styles and colours, and titles of states.

Figures are made without pyplot, so without global state or a display.
"""

from __future__ import annotations

import io
import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox
from PIL import Image as Picture
from PIL.PngImagePlugin import PngInfo

from softmodels.common.arrays import Array
from softmodels.common.files import write_bytes
from softmodels.runs.columns import OVERLAP_MARK, StateLabels, overlap_text
from softmodels.runs.fields import Row, coloured

DPI = 160
WIDTH = 10.0
"""Width of every page in inches: 1600 pixels."""

CHARACTER = 0.62
"""Width of a character, in sizes of the font: a little more than the mean of the fonts' letters and digits."""

LINES = "viridis"
SPAN = "#e4e7eb"
"""Colour of a band of several laws."""
SOLID = "#d9e2ec"
STYLE: Any = {  # versions of matplotlib differ in the type of their parameters' names
    "font.size": 12,
    "axes.titlesize": 13,
    "legend.fontsize": 11,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "lines.linewidth": 2.0,
}
INK, EDGE, FAINT = "#102a43", "#334e68", "#829ab1"
CURVE, WARNING, BRANCH = "#2f6f9f", "#c0392b", "#b7791f"


def number(value: float) -> str:
    """Return a value for a label: at most one decimal, none if it is round."""
    return f"{round(value, 1) + 0.0:.1f}".removesuffix(".0")  # + 0.0: no minus before a zero


def load(row: Row, words: StateLabels, kilopascals: bool = True) -> str:
    """Return the load of a state in words and units: its pressure, or its program step and every cavity's pressure.

    Args:
        row: The state's row of ``path.csv``.
        words: What its run shows.
        kilopascals: Whether a pressure is shown in kPa too.
    """
    step = f"step {row['load_step']:.3g}: " if "load_step" in row else ""
    pressure = f"{' and '.join(number(row[name]) for name in words.pressures(row))} cm of water"
    if kilopascals and words.pressure and not step:
        pressure += f" ({row['pressure_Pa'] / 1e3:.3g} kPa)"
    overlap = overlap_text(row)
    return f"{step}{words.under(row, pressure)}{f' - {overlap}' if overlap else ''}"


def title_colour(title: str) -> str:
    """Return the colour of a state's title: the warning colour if walls overlap."""
    return WARNING if OVERLAP_MARK in title else "black"


def headline(row: Row, words: StateLabels) -> str:
    """Return the title of a state."""
    return f"{load(row, words)}, {words.gauge} rise {row[f'{words.gauge}_mm']:.2f} mm"


def wrapped(text: str, width: float, size: float) -> str:
    """Return a text of a size in points as lines that fit a width in inches."""
    return textwrap.fill(text, max(int(width * 72 / (CHARACTER * size)), 12), break_long_words=False)


# ----------------------------------------------------------------------------------------------------------------------
# Colour scale and colour bar of a field, below a rendered image.


LINE_COLOURS = ("#2f6f9f", "#c0392b", "#2e8b57", "#8e5ea2", "#d98b1f", "#5d6d7e", "#16a3a3")
COLOURS = "Spectral_r"
FOOT = 1.15
"""Inches below a picture for its colour bar and text."""
CLIPPED = 99.5
"""Percentile of the nodal values at which the colour scale is clipped."""


class Pixels(Artist):
    """An image on a page, pixel by pixel, without matplotlib's resampling, which takes ten times as long.

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
    """Return a rendered image under its title, with the colour bar below if it shows a field.

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
    """The colour scale of a field, from its smallest value at rest up to nearly its largest.

    Corners make a few nodes stand far out, and a scale up to them would leave the body one colour. The scale therefore ends
    where, in the state that has most, a two-hundredth of the nodes lies above it, as the colour bar states. The largest value
    on the bar is the one of ``path.csv``, over the integration points of the whole device: nodal values scatter around it.

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
        """Map from a value in the bar's unit to its position along the colours, 0 to 1."""
        return (
            PowerNorm(self.power, self.low, self.top, clip=True) if self.power != 1.0 else Normalize(self.low, self.top)
        )

    def share(self, values: Array) -> Array:
        """Return the places along the colours, 0 to 1, of values in SI units; any shape."""
        return np.clip((values * self.factor - self.low) / (self.top - self.low), 0.0, 1.0) ** self.power

    def ticks(self) -> list[float]:
        """Return the tick values of a nonlinear colour bar: 1, 2 and 5 times powers
        of ten."""
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
        note = f"colour scale clipped at the {CLIPPED:g}th percentile; largest{anywhere}, {self.defined}: {largest}"
        scale = ScalarMappable(self.norm, self.colours)
        extend = "max" if self.largest > self.top else "neither"
        bar = figure.colorbar(scale, cax=axes, orientation="horizontal", extend=extend, label=f"{self.what}{unit}")
        if self.power != 1.0:
            bar.set_ticks(self.ticks())
        figure.text(0.5, 0.14 / whole, note, ha="center", fontsize=10.5, color=EDGE)


# ----------------------------------------------------------------------------------------------------------------------
# A folder for pictures, and a record of the written files.


COMPRESSION = 3
"""Compression level of a PNG: 5 takes a third longer and saves a sixth."""


class DrawnFolder:
    """A folder for pictures that records the written files; as a context manager it waits until all are on disk.

    Pictures are encoded beside what draws the next one: encoders are written in C and let Python run on.

    Args:
        path: The folder.
        shrink: Makes of a picture what a page holds of it, if there is to be a page.
        each: Is called with each file once it is drawn.
    """

    def __init__(
        self,
        path: Path,
        shrink: Callable[[Picture.Image], str] | None = None,
        each: Callable[[Path], object] = lambda path: None,
    ):
        self._each = each
        self.path = path
        self.written: list[Path] = []
        self._shrink = shrink
        self._beside = ThreadPoolExecutor(1)
        self._pages: dict[str, Future[str]] = {}

    def __enter__(self) -> DrawnFolder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._beside.shutdown()  # pictures drawn before an error are written too
        if error is None:
            self.pages()

    def save(self, name: str, figure: Figure, metadata: Mapping[str, str] | None = None) -> None:
        """Write a figure as NAME.png, with texts in its header."""
        image, dpi = drawn(figure), figure.dpi
        self._write(name, lambda: (image, encoded(image, dpi, metadata)))

    def add(self, name: str, picture: bytes) -> None:
        """Write a picture as NAME.png."""
        self._write(name, lambda: (Picture.open(io.BytesIO(picture)), picture))

    def _write(self, name: str, make: Callable[[], tuple[Picture.Image, bytes]]) -> None:
        path = self.path / f"{name}.png"

        def write() -> str:
            image, data = make()
            write_bytes(path, data)
            return self._shrink(image) if self._shrink else ""

        self._pages[path.name] = self._beside.submit(write)
        self.drew(path)

    def drew(self, path: Path) -> None:
        """Record a drawn file."""
        self.written.append(path)
        self._each(path)

    def pages(self) -> dict[str, str]:
        """Wait for pending files; return the data of each picture for the report, by file name.

        Raises:
            OSError: One could not be written.
        """
        return {name: page.result() for name, page in self._pages.items()}


def drawn(figure: Figure) -> Picture.Image:
    """Return a figure's pixels, without transparency, which would double the
    time."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return Picture.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])


def encoded(image: Picture.Image, dpi: float, texts: Mapping[str, str] | None = None) -> bytes:
    """Return a PNG.

    Args:
        image: The picture.
        dpi: Its pixels per inch.
        texts: What stands in its header.
    """
    header = PngInfo()
    for key, text in {"Software": "softmodels", **(texts or {})}.items():
        header.add_itxt(key, text)
    stream = io.BytesIO()
    image.save(stream, "PNG", compress_level=COMPRESSION, pnginfo=header, dpi=(dpi, dpi))
    return stream.getvalue()


def png(figure: Figure, texts: Mapping[str, str] | None = None) -> bytes:
    """Return a figure as a PNG; ``texts`` stand in its header."""
    return encoded(drawn(figure), figure.dpi, texts)
