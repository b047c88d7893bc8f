"""Drawings of networks: read from SVG and DXF, and written as SVG.

Open strokes are channels, as wide as the stroke; the colour of a stroke (SVG) or the layer (DXF) is the cavity. The largest
closed path is the outline of the plate. A closed path within it is a hole if it is filled, and a ring of a channel if it is
only a stroke. A small filled dot, or a point of a DXF file, on a channel is where a tube enters. The left end of the outline is
x = 0, the middle of its height y = 0; a drawing without an outline stays where it is.
"""

from __future__ import annotations

import dataclasses
import io
import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.sax import saxutils

import numpy as np

from geometries import network
from geometries.network import Channel, Network, shown_at
from softmodels.common import errors, files
from softmodels.common.arrays import Array
from softmodels.common.errors import GeometryError

FLATTENING_TOLERANCE = 2e-5
"""Largest distance (m) between a curve and its polyline."""
MAX_STROKES = 2_000
NO_LENGTH = 1e-9
"""Extent of a line in m that draws nothing."""
MAX_DOT_RATIO = 3.0
"""Diameter of a dot over the widest stroke, up to which it is an inlet."""
M_PER_PX = 0.0254 / 96
"""Pixel of SVG (CSS) in m."""


@dataclasses.dataclass(frozen=True, eq=False)
class Stroke:
    """A line of a drawing in m, y upwards: its name for messages, corners (n, 2), whether it is closed and filled, the radius
    of the channel that its stroke is (0 for none), its cavity, and what the file says of the channel beside."""

    name: str
    line: Array
    closed: bool
    filled: bool
    radius: float
    cavity: str
    more: Mapping[str, str] = dataclasses.field(default_factory=dict)

    @property
    def area(self) -> float:
        return abs(network.signed_area(self.line)) if self.closed else 0.0


def read(file: str, radius: float, offset: float, width: float, *, outlined: bool) -> Network:
    """Return the network of a drawing.

    Args:
        file: An .svg or .dxf file.
        radius: Of lines without a width, in m.
        offset: Height of channels for which the file gives none, in m.
        width: Width of the outline, or of all if there is none, to which the drawing is scaled, in m; 0: as drawn.
        outlined: Whether the outline is known already, so that the drawing's closed strokes are channels.

    Raises:
        GeometryError: The file cannot be read, or has something that is no channel; the message names the place.
    """
    reader = {".svg": _svg, ".dxf": _dxf}[Path(file).suffix.lower()]
    strokes = list(itertools.islice(reader(file, radius), MAX_STROKES + 1))
    if len(strokes) > MAX_STROKES:
        raise GeometryError(f"network {file} has more than {MAX_STROKES} lines; leave out what is no channel")
    closed = [stroke for stroke in strokes if stroke.closed]
    outer = None if outlined else max(closed, key=lambda stroke: stroke.area, default=None)
    # A line without a length draws nothing; a single point is a dot.
    rest = [s for s in strokes if s is not outer and (len(s.line) == 1 or np.ptp(s.line, axis=0).max() > NO_LENGTH)]
    if width:
        span = np.ptp(outer.line if outer else np.concatenate([stroke.line for stroke in strokes]), axis=0)[0]
        rest = [dataclasses.replace(s, line=s.line * width / span, radius=s.radius * width / span) for s in rest]
        outer = None if outer is None else dataclasses.replace(outer, line=outer.line * width / span)
    if outer is not None:
        low, high = outer.line.min(axis=0), outer.line.max(axis=0)
        origin = np.array([low[0], 0.5 * (low[1] + high[1])])
        rest = [dataclasses.replace(s, line=s.line - origin) for s in rest]
        outer = dataclasses.replace(outer, line=outer.line - origin)
    lines = [s for s in rest if not (s.closed and s.filled)]
    widest = 2.0 * max((s.radius for s in lines), default=0.0)
    channels, holes, inlets = [], [], []
    for stroke in rest:
        span = float(np.ptp(stroke.line, axis=0).max())
        if len(stroke.line) == 1 or (stroke.closed and stroke.filled and span <= MAX_DOT_RATIO * widest):
            inlets.append(0.5 * (stroke.line.min(axis=0) + stroke.line.max(axis=0)))
        elif stroke.closed and stroke.filled:
            holes.append(stroke.line)
        else:
            channels.append(_channel(file, stroke, offset))
    if not channels:
        raise GeometryError(
            f"network {file} has no open stroke, so that it has no channels; draw each channel as a line without filling, as "
            "wide as its bore (filled shapes are outlines and holes)"
        )
    for x, y in inlets:
        places = [(math.dist(place[:2], (x, y)) - r, each.name) for each in channels for place, r in _dense(each)]
        away, name = min(places)
        if away > 0.0:
            raise GeometryError(
                f"network {file} has a dot {shown_at(x, y)}, where a tube would enter, and the nearest "
                f"channel, {name}, is {1e3 * away:.2g} mm away; move it onto a channel"
            )
    paths = tuple(_path(line) for line in ([outer.line] if outer else []) + holes)
    return Network(tuple(channels), paths, tuple((float(x), float(y)) for x, y in inlets))


def _channel(file: str, stroke: Stroke, offset: float) -> Channel:
    """Return the channel of a stroke."""
    line = np.vstack([stroke.line, stroke.line[:1]]) if stroke.closed else stroke.line
    line = line[np.append(True, np.linalg.norm(np.diff(line, axis=0), axis=1) > NO_LENGTH)]
    if not stroke.radius:
        raise GeometryError(
            f"network {file}: {stroke.name} {shown_at(*line[0])} is an open line without a stroke; give it a "
            "stroke as wide as the channel, or close it"
        )
    heights = _written(file, stroke, "data-offset") or [offset]
    if len(heights) != len(line):
        heights = heights[:1] * len(line)
    places = tuple((float(x), float(y), z) for (x, y), z in zip(line, heights, strict=True))
    radii = _written(file, stroke, "data-radii")
    if len(radii) != len(line):
        radii = [stroke.radius] * len(line)
    return Channel(stroke.name, places, tuple(radii), stroke.cavity)


def _written(file: str, stroke: Stroke, key: str) -> list[float]:
    """Return lengths in m that the file says of a channel beside its line, in mm there; none where it does not."""
    text = stroke.more.get(key, "")
    try:
        return [1e-3 * float(value) for value in text.split()]
    except ValueError:
        raise GeometryError(
            f"network {file}: {stroke.name} has {key} {text[:80]!r}; write numbers of mm, or leave it out"
        ) from None


def _dense(channel: Channel) -> Iterator[tuple[Array, float]]:
    """Yield places along a channel, and their radii."""
    for (a, p), (b, q) in itertools.pairwise(zip(np.array(channel.points), channel.radii, strict=True)):
        for share in np.linspace(0.0, 1.0, math.ceil(float(np.linalg.norm(b - a)) / min(p, q)) + 1):
            yield a + share * (b - a), p + share * (q - p)


def _path(line: Array) -> tuple[tuple[float, float], ...]:
    """Return a closed path, counterclockwise, without repeated corners."""
    line = line[np.linalg.norm(line - np.roll(line, 1, axis=0), axis=1) > 1e-9]
    turned = line if network.signed_area(line) > 0.0 else line[::-1]
    return tuple((float(px), float(py)) for px, py in turned)


# ----------------------------------------------------------------------------------------------------------------------
# SVG.


IGNORED = {"Group", "Use", "SVG", "Desc", "Title", "ClipPath", "Pattern", "Viewbox"}
KINDS = {"SimpleLine": "line"}
"""The library's names of shapes where SVG has others."""
LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"


def _svg(file: str, radius: float) -> Iterator[Stroke]:
    """Yield the lines of an SVG file."""
    import svgelements

    try:
        drawing = svgelements.SVG.parse(io.StringIO(files.read_text(Path(file))), reify=True)
    except OSError as error:
        raise GeometryError(f"network {file} cannot be read ({errors.reason(error)})") from None
    except (ElementTree.ParseError, ValueError, TypeError, AttributeError, KeyError, IndexError, ZeroDivisionError) as error:
        raise GeometryError(f"network {file} is not an SVG drawing that can be read ({error})") from None
    count = 0
    for element in drawing.elements():
        kind = type(element).__name__
        if kind in IGNORED:
            continue
        label = getattr(element, "id", None) or (element.values or {}).get(LABEL)
        name = str(label or f"{KINDS.get(kind, kind.lower())} {count + 1}")
        if not isinstance(element, svgelements.Shape):
            if kind in ("Text", "Image", "SVGImage"):
                what = "a text" if kind == "Text" else "an image"
                raise GeometryError(f"network {file} has {what} ({name}); turn it into paths, or remove it")
            continue
        stroke, fill = element.stroke, element.fill
        drawn = stroke is not None and stroke.value is not None and stroke.alpha != 0
        filled = fill is not None and fill.value is not None and fill.alpha != 0
        if not (drawn or filled):
            continue
        scale = math.sqrt(abs(element.transform.determinant))  # what is left of it on a turned rectangle
        thick = 0.5 * M_PER_PX * scale * float(element.stroke_width or 0.0) if drawn else 0.0
        whole = abs(svgelements.Path(element))
        more = {key: str(value) for key, value in (element.values or {}).items() if str(key).startswith("data-")}
        for part in whole.as_subpaths():
            piece = svgelements.Path(part)
            if not (line := _flattened(piece)).size:
                continue
            count += 1
            line = M_PER_PX * line * (1.0, -1.0)
            if not np.isfinite(line).all():
                raise GeometryError(f"network {file}: {name} has a place that is no number")
            closed = isinstance(piece[-1], svgelements.Close) or (
                len(line) > 3 and float(np.linalg.norm(line[0] - line[-1])) < FLATTENING_TOLERANCE
            )
            filled_here = filled and closed
            yield Stroke(
                name if count == 1 or len(list(whole.as_subpaths())) == 1 else f"{name} ({count})",
                line[:-1] if closed and len(line) > 1 and np.allclose(line[0], line[-1], atol=1e-9) else line,
                closed, filled_here, thick, more.get("data-cavity", stroke.hexrgb if drawn else ""), more,
            )  # fmt: skip


def _flattened(path: Any) -> Array:
    """Return the corners of an SVG path's polyline, in pixels; shape (n, 2)."""
    import svgelements

    corners: list[tuple[float, float]] = []
    for segment in path:
        if isinstance(segment, svgelements.Move):
            corners.append((segment.end.x, segment.end.y))
        elif isinstance(segment, svgelements.Line | svgelements.Close):
            if segment.end is not None:
                corners.append((segment.end.x, segment.end.y))
        else:
            corners += _curve(segment.point)
    return np.array(corners, dtype=float).reshape(-1, 2)


def _curve(point: Callable[[float], Any]) -> list[tuple[float, float]]:
    """Return corners of a curve behind its start, near enough to it."""
    for pieces in (8, 16, 32, 64, 128, 256):
        places = np.array([[p.x, p.y] for p in map(point, np.linspace(0.0, 1.0, 2 * pieces + 1).tolist())])
        off = np.linalg.norm(places[1::2] - 0.5 * (places[:-1:2] + places[2::2]), axis=1)
        if off.max() * M_PER_PX < FLATTENING_TOLERANCE:
            break
    return [(float(x), float(y)) for x, y in places[2::2]]


# ----------------------------------------------------------------------------------------------------------------------
# DXF.


def _dxf(file: str, radius: float) -> Iterator[Stroke]:
    """Yield the lines of a DXF file."""
    try:
        import ezdxf
        import ezdxf.path
        import ezdxf.units
    except ImportError:
        raise GeometryError(
            f"network {file} is a DXF file, and the package that reads it is missing; install it with "
            "uv sync --extra dxf (or pip install ezdxf), or save the drawing as SVG"
        ) from None
    try:
        document = ezdxf.readfile(file)
    except OSError as error:
        raise GeometryError(f"network {file} cannot be read ({errors.reason(error)})") from None
    except (ezdxf.DXFError, ValueError, UnicodeError) as error:
        raise GeometryError(f"network {file} is not a DXF drawing that can be read ({error})") from None
    unit = document.header.get("$INSUNITS", 0)
    metre = ezdxf.units.conversion_factor(unit, 6) if unit else 1e-3
    layers = {layer.dxf.name for layer in document.layers if layer.is_off() or layer.is_frozen()}
    entities = itertools.chain.from_iterable(
        zip(entity.virtual_entities() if entity.dxftype() == "INSERT" else (entity,), itertools.repeat(entity.dxf.layer))
        for entity in document.modelspace()
    )
    for number, (entity, inserted) in enumerate(entities, 1):
        layer = inserted if entity.dxf.layer == "0" else entity.dxf.layer  # a block's "0" is the layer that it is put into
        if layer in layers:
            continue
        kind, name = entity.dxftype(), f"{entity.dxftype()} {entity.dxf.handle or number} of layer {layer}"
        if kind == "POINT":
            place = metre * np.array([[entity.dxf.location.x, entity.dxf.location.y]])
            yield Stroke(name, place, False, True, 0.0, layer)
            continue
        if kind in ("TEXT", "MTEXT", "DIMENSION", "VIEWPORT", "LEADER", "MULTILEADER"):
            continue  # notes of a draughtsman
        try:
            path = ezdxf.path.make_path(entity)
            line = metre * np.array([(p.x, p.y) for p in path.flattening(FLATTENING_TOLERANCE / metre)])
        except (TypeError, ValueError):
            raise GeometryError(f"network {file} has {name}, which is no line; remove it, or explode it into lines") from None
        thick = 0.5e-5 * entity.dxf.lineweight if entity.dxf.get("lineweight", -1) > 0 else radius
        if kind == "LWPOLYLINE" and entity.dxf.get("const_width", 0.0) > 0.0:
            thick = 0.5 * metre * entity.dxf.const_width
        closed = bool(path.is_closed) and len(line) > 3
        yield Stroke(name, line[:-1] if closed else line, closed, False, thick, layer)


# ----------------------------------------------------------------------------------------------------------------------
# Drawings written.


WRITTEN_BY = "<!-- a network by softmodels draw-network -->"
COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf", "#8c564b", "#e377c2")


def svg_text(drawn: Network) -> str:
    """Return a network as an SVG drawing in mm, from which `read` returns an equal one, to 1e-12 m."""
    places = 1e3 * np.concatenate([np.array(path) for path in drawn.outline])
    (x0, y0), (x1, y1) = places.min(axis=0) - 1.0, places.max(axis=0) + 1.0

    def at(line: Array) -> str:
        return " ".join(f"{1e3 * x:.9f},{-1e3 * y:.9f}" for x, y in line.tolist())

    rows = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{x1 - x0:.9f}mm" height="{y1 - y0:.9f}mm" '
        f'viewBox="{x0:.9f} {-y1:.9f} {x1 - x0:.9f} {y1 - y0:.9f}">',
        WRITTEN_BY,
    ]
    for number, path in enumerate(drawn.outline):
        fill = "#cccccc" if number else "none"
        style = f'fill="{fill}" stroke="black" stroke-width="0.2"'
        rows.append(f'<polygon id="{"hole " + str(number) if number else "outline"}" points="{at(np.array(path))}" {style}/>')
    for channel in drawn.channels:
        colour = COLOURS[drawn.cavities.index(channel.cavity) % len(COLOURS)]
        line = np.array(channel.points)
        heights, radii = (" ".join(f"{1e3 * value:.9f}" for value in values) for values in (line[:, 2], channel.radii))
        cavity = saxutils.quoteattr(channel.cavity)
        rows.append(
            f'<polyline id={saxutils.quoteattr(channel.name)} points="{at(line[:, :2])}" fill="none" stroke="{colour}" '
            f'stroke-width="{2e3 * float(np.mean(channel.radii)):.9f}" stroke-linecap="round" stroke-linejoin="round" '
            f'data-cavity={cavity} data-offset="{heights}" '
            f'data-radii="{radii}"/>'
        )
    for x, y in drawn.inlets:
        rows.append(
            f'<circle cx="{1e3 * x:.9f}" cy="{-1e3 * y:.9f}" r="{1e3 * min(min(c.radii) for c in drawn.channels):.9f}"/>'
        )
    return "\n".join([*rows, "</svg>\n"])
