"""Seminar actuators that cannot be: channels that break through a face or each other, found before the mesher starts."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from geometries.errors import GeometryError
from geometries.fields import LONGEST, shown
from geometries.seminar_cells import expected_cells
from geometries.seminar_plan import Channel, angles, channel, edge_distance

if TYPE_CHECKING:
    from geometries.seminar import SeminarActuator

MOST_CELLS = 3_000_000
"""Meshes expected to be larger are refused: they are typing mistakes far more often than wishes."""

WIDEST, NARROWEST = 160.0, 10.0
"""Largest and smallest spread in degrees; beyond 160 the outermost channels run along the clamp."""

LARGEST_BORE_RATIO = 0.9
"""Largest bore of a channel in bores of the manifold: nearly equal ones meet at tangents, which no mesh survives."""

SAMPLES = 40


def check_seminar(slab: SeminarActuator) -> None:
    """Check a slab's parameters against each other.

    Raises:
        GeometryError: The first parameter found impossible, with its value and the limit.
    """
    _check_slab(slab)
    _check_heights(slab)
    _check_manifold(slab)
    found = [_channel(slab, angle) for angle in angles(slab) if angle >= -1e-12]
    _check_sides(slab, found)
    _check_neighbours(slab, found)
    _check_fillet(slab)
    _check_cells(slab)


def _mm(value: float) -> str:
    return shown(value, "m")


def _check_wall(slab: SeminarActuator, left: float, given: str, face: str) -> None:
    """Refuse less solid than the least wall between the network and a face; ``given`` begins the sentence."""
    if left < slab.least_wall * (1 - 1e-9):
        raise GeometryError(
            f"{given} "
            + (f"breaks through {face}" if left <= 0.0 else f"leaves {_mm(left)} to {face}")
            + f", and least_wall asks for {_mm(slab.least_wall)}"
        )


def _check_slab(slab: SeminarActuator) -> None:
    if max(slab.length, slab.base_width) > 0.1 * LONGEST:
        raise GeometryError(
            f"length is {_mm(slab.length)} and base_width {_mm(slab.base_width)}; above {0.1 * LONGEST:g} m this looks "
            "like a mistaken unit"
        )
    if slab.thickness > 0.5 * min(slab.length, slab.base_width):
        raise GeometryError(
            f"thickness is {_mm(slab.thickness)}; a slab is at most half as thick as it is long and wide "
            f"({_mm(0.5 * min(slab.length, slab.base_width))})"
        )
    limit = 0.4 * min(slab.base_width, slab.length)
    if slab.tip_radius > limit:
        raise GeometryError(f"tip_radius is {_mm(slab.tip_radius)}; this slab takes at most {_mm(limit)}")
    if slab.tip == "held" and slab.tip_radius == 0.0:
        raise GeometryError("tip is 'held' and tip_radius 0; the rounding is what is held, so it needs a radius")
    if not NARROWEST <= slab.spread <= WIDEST:
        raise GeometryError(
            f"spread is {shown(slab.spread, 'degree')}; it must lie between {NARROWEST:g} and {WIDEST:g} deg"
        )


def _check_heights(slab: SeminarActuator) -> None:
    """Solid above and below every part of the network."""
    for name in ("manifold_bore", "channel_bore", "end_bore"):
        left = 0.5 * slab.thickness - abs(slab.offset) - getattr(slab, name)
        given = f"{name} is {_mm(getattr(slab, name))}; with offset {_mm(slab.offset)} in thickness {_mm(slab.thickness)} it"
        _check_wall(slab, left, given, f"the {'top' if slab.offset > 0.0 else 'bottom'} face")


def _check_manifold(slab: SeminarActuator) -> None:
    bore, radius = slab.manifold_bore, slab.manifold_radius
    if slab.channel_bore > LARGEST_BORE_RATIO * bore:
        raise GeometryError(
            f"channel_bore is {_mm(slab.channel_bore)}; it must not pass {LARGEST_BORE_RATIO:g} times manifold_bore, "
            f"{_mm(bore)}"
        )
    if radius < 2.0 * bore:
        raise GeometryError(
            f"manifold_radius is {_mm(radius)}; it must be at least twice manifold_bore, {_mm(bore)}, for an arc"
        )
    gap = radius * math.cos(0.5 * math.radians(slab.spread)) - bore
    given = f"manifold_bore is {_mm(bore)}; with manifold_radius {_mm(radius)} and spread {shown(slab.spread, 'degree')} the"
    _check_wall(slab, gap, f"{given} manifold", "the base")


def _channel(slab: SeminarActuator, angle: float) -> Channel:
    found = channel(slab, angle)
    if found is None or found.end - found.start < slab.manifold_bore + slab.end_bore:
        raise GeometryError(
            f"manifold_radius is {_mm(slab.manifold_radius)}; with edge {_mm(slab.edge)} and end_bore "
            f"{_mm(slab.end_bore)} no length is left for the channel at {math.degrees(angle):.3g} deg"
        )
    return found


def _check_sides(slab: SeminarActuator, found: list[Channel]) -> None:
    """Solid between the network and the slab's sides, along every centre line."""
    if slab.edge < slab.least_wall:
        raise GeometryError(f"edge is {_mm(slab.edge)}; least_wall asks for {_mm(slab.least_wall)}")
    half = 0.5 * math.radians(slab.spread)
    arc = [half * k / SAMPLES for k in range(SAMPLES + 1)]
    walls = [
        (_wall(slab, slab.manifold_radius, angle, slab.manifold_bore), "manifold_bore", slab.manifold_bore)
        for angle in arc
    ]
    for line in found:
        for k in range(SAMPLES + 1):
            along = line.start + (line.end - line.start) * k / SAMPLES
            radius = line.radius(along)
            walls.append((_wall(slab, along, line.angle, radius), "end_bore", slab.end_bore))
            base = along * math.cos(line.angle) - radius
            walls.append((base, "end_bore", slab.end_bore))
    left, name, bore = min(walls)
    spread = shown(slab.spread, "degree")
    given = f"{name} is {_mm(bore)}; with manifold_radius {_mm(slab.manifold_radius)} and spread {spread} it"
    _check_wall(slab, left, given, "the slab's side")


def _wall(slab: SeminarActuator, along: float, angle: float, radius: float) -> float:
    return edge_distance(slab, along * math.cos(angle), along * math.sin(angle)) - radius


def _check_neighbours(slab: SeminarActuator, found: list[Channel]) -> None:
    """Solid between neighbouring channels, outside of the manifold that joins them."""
    if slab.channels == 1:
        return
    pitch = math.radians(slab.spread) / (slab.channels - 1)
    begin = slab.manifold_radius + slab.manifold_bore
    for line in found:
        for k in range(SAMPLES + 1):
            along = begin + (line.end - begin) * k / SAMPLES
            left = 2.0 * (along * math.sin(0.5 * pitch) - line.radius(along))
            if left < slab.least_wall * (1 - 1e-9):
                raise GeometryError(
                    f"channels is {slab.channels}; with spread {shown(slab.spread, 'degree')}, manifold_radius "
                    f"{_mm(slab.manifold_radius)} and channel_bore {_mm(slab.channel_bore)} neighbours "
                    + ("break into each other" if left <= 0.0 else f"are {_mm(left)} apart")
                    + f", and least_wall asks for {_mm(slab.least_wall)}"
                )


def _check_fillet(slab: SeminarActuator) -> None:
    """The rounding must fit on the bores, and two of them between neighbouring channels."""
    limit = slab.channel_bore
    if slab.channels > 1:
        pitch = math.radians(slab.spread) / (slab.channels - 1)
        # Two roundings side by side on the manifold's wall, with a fifth of one to spare.
        limit = min(limit, (slab.manifold_radius * math.sin(0.5 * pitch) - slab.channel_bore) / 1.1)
    if slab.fillet > limit:
        raise GeometryError(
            f"fillet is {_mm(slab.fillet)}; with channel_bore {_mm(slab.channel_bore)} and {slab.channels} channels this "
            f"slab takes at most {_mm(max(limit, 0.0))}"
        )


def _check_cells(slab: SeminarActuator) -> None:
    if not 3.0 <= slab.around <= 64.0:
        raise GeometryError(f"around is {slab.around:g}; it must lie between 3 and 64 cells around a channel")
    if slab.cell_size > slab.thickness:
        raise GeometryError(f"cell_size is {_mm(slab.cell_size)}; it must not pass thickness, {_mm(slab.thickness)}")
    expected = expected_cells(slab)
    if expected > MOST_CELLS:
        raise GeometryError(
            f"cell_size is {_mm(slab.cell_size)} with around {slab.around:g}; about {expected:.2g} cells are expected and "
            f"{MOST_CELLS:,} are allowed"
        )
