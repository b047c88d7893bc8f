"""Common style of all pictures: size, line styles and colours, and titles of states.

Figures are made without pyplot, so without global state or a display.
"""

from __future__ import annotations

import dataclasses
import functools
import io
import math
import textwrap
import zlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
import numpy.typing as npt
from cycler import cycler
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize, PowerNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import Bbox
from PIL import Image as Picture
from PIL.PngImagePlugin import PngInfo

from softmodels.common import commands, files
from softmodels.common.arrays import Array
from softmodels.materials import silicones
from softmodels.runs import fields, labels, table

if TYPE_CHECKING:
    from matplotlib.backend_bases import RendererBase

    from softmodels.case.case import Case


DPI = 128
WIDTH_INCHES = 10.0
"""Width of every page in inches: 1280 pixels, as wide as a report shows them."""

CHARACTER_WIDTH = 0.62
"""Width of a character, in sizes of the font: a little more than the mean of the fonts' letters and digits."""

LINES_CMAP = "viridis"
"""Of what has an order, such as states, cycles and pressures: dark is least, as in the pictures of measured outlines."""
LINE_COLOURS = ("#2f6f9f", "#c0392b", "#2e8b57", "#8e5ea2", "#d98b1f", "#5d6d7e", "#16a3a3")
"""Of what has none, such as laws, runs, modes and cavities."""
SPAN = "#e4e7eb"
"""Colour of a band of several laws."""
SOLID = "#d9e2ec"
STYLE: Any = {  # versions of matplotlib differ in the type of their parameters' names
    "font.size": 12,
    "axes.titlesize": 13,
    "legend.fontsize": 11,
    "axes.grid": True,
    "axes.prop_cycle": cycler(color=LINE_COLOURS),
    "grid.alpha": 0.3,
    "lines.linewidth": 2.0,
}
INK, EDGE, FAINT = "#102a43", "#334e68", "#829ab1"
CURVE, WARNING, BRANCH = "#2f6f9f", "#c0392b", "#b7791f"


def chart(height: float, width: float = WIDTH_INCHES) -> tuple[Figure, Axes]:
    """Return a figure of a size in inches that fits its texts, and its only axes."""
    figure = Figure((width, height), dpi=DPI, layout="constrained")
    return figure, figure.subplots()


def shades(count: int) -> Array:
    """Return the colours of lines that have an order, from the least to the most; shape (count, 4)."""
    return matplotlib.colormaps[LINES_CMAP](np.linspace(0.0, 0.88, count))


def title_colour(title: str) -> str:
    """Return the colour of a state's title: the warning colour if walls overlap."""
    return WARNING if labels.INVALID in title else "black"


def wrapped(text: str, width: float, size: float) -> str:
    """Return a text of a size in points as lines that fit a width in inches."""
    return textwrap.fill(text, max(int(width * 72 / (CHARACTER_WIDTH * size)), 12), break_long_words=False)


# ----------------------------------------------------------------------------------------------------------------------
# Colour scale and colour bar of a field, with axes and a scale bar, below a rendered image.


def colormap(colours: str) -> Colormap:
    """Return the colour map of a text such as ``"viridis"``, ``"gray:linear"`` or ``"viridis:bands"``, which has ten bands."""
    name, _, kind = colours.partition(":")
    return matplotlib.colormaps[name].resampled(10) if kind == "bands" else matplotlib.colormaps[name]


class Scale:
    """The colour scale of a field, one of `coloured`, for all pictures of a run, from its value at rest up to nearly its
    largest nodal value in SI units, shape (n,) or (states, n).

    Corners make a few nodes stand far out, and a scale up to them would leave the body one colour. The scale therefore ends
    at the next round value above which, in the state that has most, a two-hundredth of the nodes lies. The bar says so, and
    whether its colours follow the value or a power of it. The largest value below the bar is that of the states in the
    picture, from the table, over the integration points of the whole device: nodal values scatter around it.
    """

    def __init__(
        self, values: Array, field: str = "von_mises", rows: Sequence[table.Row] = (), colours: str = commands.COLORMAP
    ):
        shown, how = fields.coloured()[field]
        self.what, self.unit, self.factor, self.low = shown.title, how.unit, how.factor, how.rest
        self._variable = shown.largest.name if shown.largest else ""
        self.field, self.power = field, 1.0 if ":" in colours else how.power
        self.highest = self._highest(rows, values)[0]
        end = float(np.percentile(values, CLIPPING_PERCENTILE, axis=-1).max()) * self.factor
        self.top = self.low + _round_up(end - self.low) if end > self.low else self.low + 1.0
        self.colours = colormap(colours)

    def _highest(self, rows: Sequence[table.Row], values: Array) -> tuple[float, str]:
        """Return the largest value of some states in the bar's unit, and where it is taken."""
        told = [row.shown(self._variable) for row in rows if self._variable in row]
        return (max(told), "at an integration point") if told else (float(values.max()) * self.factor, "at a node")

    def largest(self, rows: Sequence[table.Row], values: Array) -> str:
        """Return the largest value of the states in a picture, from their rows or their nodal values in SI units, in words."""
        value, place = self._highest(rows, values)
        beyond = f"; clipped at the {CLIPPING_PERCENTILE:g}th percentile" if value > self.top else ""
        return f"largest, {place}: {f'{value:.4g} {self.unit}'.strip()}{beyond}"

    @property
    def norm(self) -> Normalize:
        """Map from a value in the bar's unit to its position along the colours, 0 to 1."""
        linear = self.power == 1.0
        return Normalize(self.low, self.top, True) if linear else PowerNorm(self.power, self.low, self.top, True)

    def share(self, values: Array) -> Array:
        """Return the places along the colours, 0 to 1, of values in SI units; any shape."""
        return np.clip((values * self.factor - self.low) / (self.top - self.low), 0.0, 1.0) ** self.power

    def ticks(self) -> list[float]:
        """Return the tick values of a nonlinear colour bar: its ends, and 1, 2 and 5 times powers of ten."""
        high = math.floor(math.log10(self.top))
        series = [k * 10.0**n for n in range(high, high - 4, -1) for k in (5, 2, 1) if k * 10.0**n < self.top]
        chosen, before = [self.top], 1.0
        for value in series:
            place = float(self.norm(value))
            if 0.08 < place < before - 0.09:
                chosen.append(value)
                before = place
        return [self.low, *chosen[::-1]]

    @property
    def kind(self) -> str:
        """How colours follow the field."""
        return {1.0: "linear scale", 0.5: "square-root scale"}.get(self.power, f"scale of the power {self.power:g}")

    def bar(self, figure: Figure, largest: str) -> None:
        """Draw the bar at the foot of a figure, at least `FOOT_INCHES` high, above the `largest` value shown."""
        figure.add_artist(Pixels(self.foot[1], 0, 0))
        figure.text(0.5, 0.14 / figure.get_figheight(), largest, ha="center", fontsize=10.5, color=EDGE)

    @functools.cached_property
    def foot(self) -> tuple[Axes, npt.NDArray[np.uint8]]:
        """The bar's axes and pixels, drawn once: ticks take half of a page's time."""
        figure = Figure((WIDTH_INCHES, FOOT_INCHES), dpi=DPI)
        axes = figure.add_axes((0.2, 0.82 / FOOT_INCHES, 0.6, 0.18 / FOOT_INCHES))
        scale = ScalarMappable(self.norm, self.colours)
        extend = "max" if self.highest > self.top else "neither"
        ticks = None if self.power == 1.0 else self.ticks()
        label = f"{self.what}{f' in {self.unit}' if self.unit else ''}, {self.kind}"
        figure.colorbar(scale, cax=axes, orientation="horizontal", extend=extend, label=label, ticks=ticks)
        return axes, np.asarray(drawn(figure))


FOOT_INCHES, LOW_FOOT_INCHES = 1.15, 0.65
"""Inches below a picture for its colour bar, axes, scale bar and text; without a colour bar."""
CLIPPING_PERCENTILE = 99.5
"""Percentile of the nodal values above which the colours end."""


@dataclasses.dataclass(frozen=True)
class Caption:
    """What stands around an image: the title above it, below that the device and its silicone, below these a note in the
    warning colour; metres of one pixel, None where no length can be read off; where x, y and z point in the image, to the
    right and upwards, shape (3, 2); the largest value of the coloured field in the shown state, for the colour bar."""

    title: str
    subject: str = ""
    note: str = ""
    metres: float | None = None
    axes: Array | None = None
    largest: str = ""


def subject(case: Case) -> str:
    """Return the device and the silicone of a case in words."""
    material = case.material
    silicone = silicones.named(material) or material.name
    modulus = f"{material.shear_modulus_0 / 1e3:.3g} kPa initial shear modulus"
    return f"{type(case.actuator).__name__}, {silicone} ({modulus})"


def page(image: npt.NDArray[np.uint8], caption: Caption, scale: Scale | None = None) -> Figure:
    """Return a rendered image under its title, with the colour bar below if it shows a field.

    Title and note go on in further lines where they are wider than the page: a program names every cavity's pressure.
    """
    texts = [(caption.title, 13, title_colour(caption.title)), (caption.subject, 11, EDGE), (caption.note, 11, WARNING)]
    head, placed = 0.17, list[tuple[float, str, int, str]]()
    for text, size, colour in texts:
        if text:
            lines = wrapped(text, WIDTH_INCHES, size)
            placed.append((head, lines, size, colour))
            head += (1 + lines.count("\n")) * 1.25 * size / 72 + 0.02
    head += 0.1
    foot = FOOT_INCHES if scale is not None else LOW_FOOT_INCHES if caption.metres is not None else 0.0
    whole = head + image.shape[0] / DPI + foot
    figure = Figure((WIDTH_INCHES, whole), dpi=DPI)
    figure.add_artist(Pixels(image, 0, round(foot * DPI)))
    for above, text, size, colour in placed:
        figure.text(0.5, 1 - above / whole, text, ha="center", va="top", fontsize=size, color=colour)
    if scale is not None:
        scale.bar(figure, caption.largest)
    if caption.metres is not None and caption.axes is not None:
        rulers(figure, caption.metres, caption.axes)
    return figure


class Pixels(Artist):
    """An image that stands in a figure as it is, ``left`` and ``below`` pixels off its corner: `Figure.figimage` resamples it,
    which takes as long as all else on a page."""

    zorder = 0

    def __init__(self, image: npt.NDArray[np.uint8], left: int, below: int):
        super().__init__()
        self._image, self._corner = image, (left, below)

    def get_window_extent(self, renderer: RendererBase | None = None) -> Bbox:
        return Bbox.from_bounds(*self._corner, *self._image.shape[1::-1])

    def draw(self, renderer: RendererBase) -> None:
        upwards = np.asarray(Picture.fromarray(self._image).convert("RGBA"))[::-1]
        renderer.draw_image(renderer.new_gc(), *self._corner, upwards)


def rulers(figure: Figure, metres: float, axes: Array) -> None:
    """Draw the axes and a scale bar in the lower corners of a page; arguments as of `Caption`."""
    size = DPI * np.array([figure.get_figwidth(), figure.get_figheight()])

    def line(begin: Array, end: Array, width: float) -> None:
        figure.add_artist(Line2D(*(np.array([begin, end]) / size).T, color=INK, linewidth=width))

    centre = DPI * np.array([0.9, 0.4])
    for name, way in zip("xyz", axes, strict=True):
        if (length := float(np.linalg.norm(way))) > 0.15:
            line(centre, centre + 0.29 * DPI * way, 1.6)
            x, y = (centre + (0.29 + 0.08 / length) * DPI * way) / size
            figure.text(x, y, name, ha="center", va="center", fontsize=10, color=INK)
    length = next(k * 10.0**n for n in range(3, -5, -1) for k in (5, 2, 1) if k * 10.0**n <= 1.44e3 * DPI * metres)
    middle, half = np.array([0.9 * size[0], 0.31 * DPI]), np.array([length * 1e-3 / metres / 2, 0.0])
    line(middle - half, middle + half, 2.5)
    up = np.array([0.0, 1.0])
    for end in (middle - half, middle + half):
        line(end - 6 * up, end + 6 * up, 1.6)
    x, y = (middle + 10 * up) / size
    figure.text(x, y, f"{length:g} mm", ha="center", va="bottom", fontsize=10.5, color=INK)


ROUND_NUMBERS = (1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0)


def _round_up(value: float) -> float:
    """Return the next round number above a positive one."""
    unit = 10.0 ** math.floor(math.log10(value))
    return next(k * unit for k in ROUND_NUMBERS if k * unit >= value * (1 - 1e-9))


# ----------------------------------------------------------------------------------------------------------------------
# A folder for pictures, and a record of the written files.


class PictureFolder:
    """A folder for pictures that records the written files; as a context manager it waits until all are on disk.

    Pictures are encoded beside what draws the next one: encoders are written in C and let Python run on. ``each`` is called
    with each file once it is drawn.
    """

    def __init__(self, path: Path, each: Callable[[Path], object] = lambda path: None):
        self.path, self._each = path, each
        self.written: list[Path] = []
        self._beside, self._pending = ThreadPoolExecutor(1), list[Future[None]]()

    def __enter__(self) -> PictureFolder:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._beside.shutdown()  # pictures drawn before an error are written too
        if kind is None:
            self.wait()

    def save(self, name: str, figure: Figure, metadata: Mapping[str, str] | None = None, again: str = "") -> None:
        """Write a figure as NAME.png, and as AGAIN.png if that is given, with texts in its header."""
        picture = self._beside.submit(encoded, drawn(figure), figure.dpi, metadata)
        for stem in filter(None, (name, again)):
            self._write(stem, picture.result)

    def add(self, name: str, picture: bytes) -> None:
        """Write a picture as NAME.png."""
        self._write(name, lambda: picture)

    def _write(self, name: str, picture: Callable[[], bytes]) -> None:
        path = self.path / f"{name}.png"
        self._pending.append(self._beside.submit(lambda: files.write_bytes(path, picture())))
        self.drew(path)

    def drew(self, path: Path) -> None:
        """Record a drawn file."""
        self.written.append(path)
        self._each(path)

    def wait(self) -> None:
        """Wait for pending files. OSError if one could not be written."""
        for file in self._pending:
            file.result()


def drawn(figure: Figure) -> Picture.Image:
    """Return a figure's pixels, without transparency, which would double the time."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return Picture.frombuffer("RGBA", canvas.get_width_height(), canvas.buffer_rgba(), "raw", "RGBA", 0, 1).convert("RGB")


def encoded(image: Picture.Image, dpi: float, texts: Mapping[str, str] | None = None) -> bytes:
    """Return a picture with ``dpi`` pixels per inch as a PNG; ``texts`` stand in its header."""
    header = PngInfo()
    for key, text in {"Software": "softmodels", **(texts or {})}.items():
        header.add_itxt(key, text)
    stream = io.BytesIO()
    # Run lengths: fields and white are even, so that no other way of zlib packs them better in this time.
    image.save(stream, "PNG", compress_level=1, compress_type=zlib.Z_RLE, pnginfo=header, dpi=(dpi, dpi))
    return stream.getvalue()


def png(figure: Figure, texts: Mapping[str, str] | None = None) -> bytes:
    """Return a figure as a PNG; ``texts`` stand in its header."""
    return encoded(drawn(figure), figure.dpi, texts)
