"""The interactive 3-D view of a report: the surface of all steps packed small, and the page's own program that draws it.

A program of its own in WebGL, of 13 kB, in place of a library: Plotly's would add 4.8 MB to every report and hold each
step's whole device as numbers of 8 bytes; three.js and vtk.js come from servers or from another language's packages. This
one needs neither network nor installation, keeps one slice and its images, and 10 bytes per vertex and step before packing.
"""

from __future__ import annotations

import base64
import gzip
import json
from typing import TypedDict

import matplotlib
import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from softmodels.pictures.colour_scale import COLOURS, Scale
from softmodels.pictures.style import Array, headline
from softmodels.pictures.viewpoint import Look
from softmodels.results.output_fields import coloured
from softmodels.results.skin import CUT, OUTSIDE
from softmodels.results.stored import States

VALUES = 2_500_000
"""Vertices times steps that a view may hold; of more steps, some are left out."""
FULL = 65535


class FieldColours(TypedDict):
    """The colour scale of a field, in its unit: see `Scale`."""

    what: str
    unit: str
    low: float
    power: float
    top: float
    outside: float


class StepLabel(TypedDict):
    """A step and its title."""

    step: int
    label: str


class Description(TypedDict):
    """What the view's program reads beside the packed numbers; lengths in m."""

    vertices: int
    triangles: int
    outside: int
    low: list[float]
    span: float
    planes: list[list[float]]
    images: list[list[float]]
    box: list[list[float]]
    direction: list[float]
    up: list[float]
    focus: list[float]
    scale: float
    aspect: float
    colours: list[list[int]]
    fields: list[FieldColours]
    steps: list[StepLabel]


def view(look: Look) -> dict[str, object]:
    """What the template ``web_view.html`` shows: the controls' ranges, the data and their description."""
    states = look.states
    steps = _steps(states)
    meta, data = packed(look, steps)
    return {
        "last": len(steps) - 1, "begin": steps.index(states.main), "axial": states.actuator.axial,
        "fields": [field["what"] for field in meta["fields"]], "left_out": _left_out(states, steps),
        "gradient": ",".join(f"rgb({r},{g},{b})" for r, g, b in meta["colours"][::8]),
        "meta": Markup(json.dumps(meta).replace("</", "<\\/")), "data": base64.b64encode(data).decode(),
    }  # fmt: skip


def _steps(states: States) -> list[int]:
    """Steps of the view: all, or as many as it may hold with the requested ones among them first."""
    count = len(states.rows)
    most = max(VALUES // max(len(states.skin.nodes), 1), 2)
    if count <= most:
        return list(range(count))
    spread = {int(k) for k in np.linspace(0, count - 1, most).round()}
    return sorted(spread | {0, states.main, *states.shown()})


def _left_out(states: States, steps: list[int]) -> str:
    left = len(states.rows) - len(steps)
    return f"{left} of {len(states.rows)} steps are left out here." if left else ""


def packed(look: Look, steps: list[int]) -> tuple[Description, bytes]:
    """What the view's program reads.

    Args:
        look: The device.
        steps: Its steps that are in the view.

    Returns:
        The description (lengths in m), and the packed numbers: triangles, then for each step places and fields.
    """
    states, skin = look.states, look.states.skin
    order = np.argsort(skin.part[skin.part != CUT], kind="stable")  # the outside first
    corners = skin.triangles[skin.part != CUT][order]
    used, triangles = np.unique(corners, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    places = [skin.points(states.moved(step))[used] for step in steps]
    low = np.min([place.min(axis=0) for place in places], axis=0)
    span = float(max(np.max([place.max(axis=0) for place in places], axis=0) - low))
    scales = {name: _scales(look, name, steps) for name in coloured()}
    pieces = [_bytes((triangles & 0xFFFF).ravel()), _bytes((triangles >> 16).ravel())]
    before: list[Array | float] = [0] * (1 + len(scales))
    for step, place in zip(steps, places, strict=True):
        columns = [np.round((place - low) / span * FULL).ravel()]
        for name, (everything, _) in scales.items():
            columns.append(np.round(everything.share(states.field(step, name)[skin.nodes[used]]) * FULL))
        for k, column in enumerate(columns):
            pieces.append(_bytes(column - before[k]))
            before[k] = column
    rest = skin.device(skin.points(states.points))
    camera = look.camera([0, states.main])
    colours = (matplotlib.colormaps[COLOURS](np.linspace(0, 1, 128))[:, :3] * 255).round().astype(int)
    meta: Description = {
        "vertices": len(used), "triangles": len(triangles), "outside": int((skin.part == OUTSIDE).sum()),
        "low": low.tolist(), "span": span, "planes": skin.planes.tolist(),
        "images": skin.images.reshape(-1, 9).round(12).tolist(),
        "box": [rest.min(axis=0).tolist(), rest.max(axis=0).tolist()],
        "direction": list(camera.direction), "up": list(camera.up), "focus": list(camera.focus),
        "scale": 1.1 * camera.scale, "aspect": camera.size[0] / camera.size[1], "colours": colours.tolist(),
        "fields": [_colours(everything, outside) for everything, outside in scales.values()],
        "steps": [{"step": step, "label": headline(states.rows[step], states.words)} for step in steps],
    }  # fmt: skip
    return meta, gzip.compress(b"".join(pieces), 6, mtime=0)


def _scales(look: Look, name: str, steps: list[int]) -> tuple[Scale, Scale]:
    """One colour scale of a field over all steps, for everything and for the outside alone."""
    spread = sorted({look.states.main, steps[-1], *look.states.shown(6)})
    everything = Scale(np.array([look.states.field(step, name) for step in spread]), name)
    outside = look.scale(spread, name)
    everything.top = max(everything.top, outside.top)
    return everything, outside


def _colours(everything: Scale, outside: Scale) -> FieldColours:
    return {
        "what": everything.what, "unit": everything.unit, "low": everything.low, "power": everything.power,
        "top": everything.top, "outside": outside.top,
    }  # fmt: skip


def _bytes(column: npt.NDArray[np.number]) -> bytes:
    """Whole numbers modulo 65536, low bytes before high bytes: neighbours differ little, which packs well."""
    return np.asarray(column).astype(np.int64).astype("<u2").view(np.uint8).reshape(-1, 2).T.tobytes()
