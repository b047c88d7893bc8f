"""Where the silicone is stretched most: the hundredth of its surface with the largest stretch, bounded by an isoline.

The stretch is the nodal field, continuous over the cells; cells as a whole would make ragged patches of it.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from softmodels.pictures.colour_scale import Scale
from softmodels.pictures.offscreen import Layer, Style, surface
from softmodels.pictures.style import load, number
from softmodels.results.skin import CUT, OUTSIDE
from softmodels.results.stored import States
from softmodels.results.triangles import Array

HOT = 1.0
"""Share of the surface, outside and walls of cavities, in percent, that is shown as hot."""


@dataclasses.dataclass(frozen=True, eq=False)
class HotSpots:
    """What of a state is stretched most.

    Attributes:
        limit: The largest stretch that `HOT` percent of the surface exceeds.
        peak: Where the largest stretch is in the deformed slice, m, shape (3,); None if that is not known.
        note: Its value and place in words.
    """

    limit: float
    peak: Array | None
    note: str


def hot_spots_of(states: States, step: int) -> HotSpots:
    """What of a state is stretched most."""
    return HotSpots(hot_limit(states, step), peak_place(states, step), peak_text(states, step))


def hot_limit(states: States, step: int) -> float:
    """The largest stretch that `HOT` percent of the device's surface (at rest) exceeds."""
    skin = states.skin
    triangles = skin.triangles[skin.part != CUT]
    a, b, c = skin.points(states.points)[triangles].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    value = states.field(step, "largest_stretch")[skin.nodes][triangles].mean(axis=1)
    order = np.argsort(value)
    covered = np.cumsum(area[order]) / area.sum()
    return float(value[order][min(int(np.searchsorted(covered, 1 - HOT / 100)), len(order) - 1)])


def hot_layers(states: States, step: int, limit: float, scale: Scale) -> list[Layer]:
    """Walls of the cavities coloured by stretch, what of the outside is above a limit, and the isoline of the limit."""
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
    """What is shown as hot, in words."""
    return f"The {HOT:g} % of the surface that is stretched most: by more than {limit:.3g}, inside the black line"


def peak_text(states: States, step: int) -> str:
    """Value and place of the largest stretch of a state, from ``path.csv``."""
    row, words = states.rows[step], states.words
    under = load(row, words) if "load_step" in row else words.under(row, f"{number(row['pressure_cm'])} cm")
    if "max_stretch" not in row:
        return f"largest stretch at a node {states.field(step, 'largest_stretch').max():.4g} at {under}"
    text = f"largest stretch {row['max_stretch']:.4g} at {under}"
    if "max_stretch_x_mm" not in row:
        return text
    place = ", ".join(f"{axis} = {row[f'max_stretch_{axis}_mm']:.2f}" for axis in "xyz")
    return f"{text}; at the ring, of the undeformed device at {place} mm"


def peak_place(states: States, step: int) -> Array | None:
    """Where the largest stretch of ``path.csv`` is in the deformed slice, m, shape (3,); None if that is not known."""
    row = states.rows[step]
    if "max_stretch_x_mm" not in row:
        return None
    place = np.array([row[f"max_stretch_{axis}_mm"] for axis in "xyz"]) * 1e-3
    if states.actuator.dimension == 2:
        place = np.array([np.hypot(place[0], place[1]), 0.0, place[2]])
    nearest = np.argsort(np.linalg.norm(states.points - place, axis=1))[:4]
    return np.asarray(place + states.field(step, "displacement")[nearest].mean(axis=0))
