"""Seminar actuators that cannot be: channels that break through a face or each other, found before the mesher starts."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from geometries.cell_count import check_cell_count
from geometries.errors import GeometryError
from geometries.fields import LONGEST, shown
from geometries.seminar_cells import expected_cells
from geometries.seminar_plan import Channel, edge_distance, half_angles, half_count, half_fan, own, pairs, spread

if TYPE_CHECKING:
    from geometries.seminar import SeminarActuator

MOST_CELLS = 3_000_000
"""Meshes expected to be larger are refused: they are typing mistakes far more often than wishes."""

WIDEST, NARROWEST = 160.0, 10.0
"""Largest and smallest spread in degrees; beyond 160 the outermost channels run along the clamp."""

LARGEST_BORE_RATIO = 0.9
"""Largest bore of a channel in bores of the manifold: nearly equal ones meet at tangents, which no mesh survives."""

SAMPLES = 40

LISTS = ("bores", "middle_bores", "end_bores", "angles", "reaches")
"""Parameters with one value for every channel."""


def check_seminar(slab: SeminarActuator) -> None:
    """Check a slab's parameters against each other.

    Raises:
        GeometryError: The first parameter found impossible, with its value and the limit.
    """
    _check_slab(slab)
    _check_lists(slab)
    _check_heights(slab)
    _check_manifold(slab)
    found = [_channel(slab, number, line) for number, line in enumerate(half_fan(slab), 1)]
    _check_sides(slab, found)
    _check_neighbours(slab, found)
    _check_fillet(slab, found)
    _check_cells(slab)


def _mm(value: float) -> str:
    return shown(value, "m")


def _degrees(value: float) -> str:
    return shown(value, "degree")


def _fan(slab: SeminarActuator) -> str:
    """How wide the fan is, by the name it was given."""
    several = f"angles[{half_count(slab)}] {_degrees(slab.angles[-1])}" if slab.angles else ""
    return several or f"spread {_degrees(slab.spread)}"


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


def _check_lists(slab: SeminarActuator) -> None:
    """Lists have one entry for every channel with y >= 0, and directions rise from the middle outwards."""
    count = half_count(slab)
    for name in LISTS:
        entries = len(getattr(slab, name))
        if entries not in (0, count):
            raise GeometryError(
                f"{name} has {entries} {'entry' if entries == 1 else 'entries'}; {slab.channels} channels, alike on both sides "
                f"of the middle, take {count}, from the middle outwards"
            )
    if slab.angles and slab.channels == 1:
        raise GeometryError("angles is given for one channel, which runs in the middle; leave it out")
    if slab.angles and slab.channels % 2 and slab.angles[0] != 0.0:
        raise GeometryError(
            f"angles[1] is {_degrees(slab.angles[0])}; of {slab.channels} channels the first runs in the middle, at 0 deg"
        )
    for number, angle in enumerate(slab.angles, 1):
        least = slab.angles[number - 2] if number > 1 else 0.0
        if angle <= least and (number > 1 or slab.channels % 2 == 0):
            raise GeometryError(
                f"angles[{number}] is {_degrees(angle)}; it must be larger than {_degrees(least)}: channels are given from "
                "the middle outwards"
            )
    arc = math.degrees(spread(slab))
    if not NARROWEST * (1 - 1e-9) <= arc <= WIDEST * (1 + 1e-9):
        given = f"angles[{count}] is {_degrees(0.5 * arc)}" if slab.angles else f"spread is {_degrees(arc)}"
        low, high = (0.5 * NARROWEST, 0.5 * WIDEST) if slab.angles else (NARROWEST, WIDEST)
        raise GeometryError(f"{given}; it must lie between {low:g} and {high:g} deg")


def _bores(slab: SeminarActuator) -> list[tuple[float, str]]:
    """Every radius of the channels that was given, and the name it was given by."""
    pairs = (("bores", "channel_bore"), ("end_bores", "end_bore"))
    found = {
        name: bore
        for number in range(half_count(slab), 0, -1)
        for bore, name in (own(slab, *pair, number) for pair in pairs)
    }
    found |= {f"middle_bores[{number}]": bore for number, bore in enumerate(slab.middle_bores, 1)}
    return [(bore, name) for name, bore in found.items()]


def _check_heights(slab: SeminarActuator) -> None:
    """Solid above and below every part of the network."""
    for bore, name in ((slab.manifold_bore, "manifold_bore"), *_bores(slab)):
        left = 0.5 * slab.thickness - abs(slab.offset) - bore
        given = f"{name} is {_mm(bore)}; with offset {_mm(slab.offset)} in thickness {_mm(slab.thickness)} it"
        _check_wall(slab, left, given, f"the {'top' if slab.offset > 0.0 else 'bottom'} face")


def _check_manifold(slab: SeminarActuator) -> None:
    bore, radius = slab.manifold_bore, slab.manifold_radius
    for number in range(1, half_count(slab) + 1):
        mouth, name = own(slab, "bores", "channel_bore", number)
        if mouth > LARGEST_BORE_RATIO * bore:
            raise GeometryError(
                f"{name} is {_mm(mouth)}; it must not pass {LARGEST_BORE_RATIO:g} times manifold_bore, {_mm(bore)}"
            )
    if radius < 2.0 * bore:
        raise GeometryError(
            f"manifold_radius is {_mm(radius)}; it must be at least twice manifold_bore, {_mm(bore)}, for an arc"
        )
    gap = radius * math.cos(0.5 * spread(slab)) - bore
    given = f"manifold_bore is {_mm(bore)}; with manifold_radius {_mm(radius)} and {_fan(slab)} the"
    _check_wall(slab, gap, f"{given} manifold", "the base")


def _channel(slab: SeminarActuator, number: int, found: Channel | None) -> Channel:
    """The channel, unless it is so short that nothing of it is left outside the manifold."""
    end_bore, name = own(slab, "end_bores", "end_bore", number)
    if found is None or found.end - found.start < slab.manifold_bore + end_bore:
        far = f"reaches[{number}] {_mm(slab.reaches[number - 1])}" if slab.reaches else f"edge {_mm(slab.edge)}"
        raise GeometryError(
            f"manifold_radius is {_mm(slab.manifold_radius)}; with {far} and {name} "
            f"{_mm(end_bore)} no length is left for channel {number}, at {math.degrees(half_angles(slab)[number - 1]):.3g} deg"
        )
    return found


def _check_sides(slab: SeminarActuator, found: list[Channel]) -> None:
    """Solid between the network and the slab's sides, along every centre line."""
    if slab.edge < slab.least_wall:
        raise GeometryError(f"edge is {_mm(slab.edge)}; least_wall asks for {_mm(slab.least_wall)}")
    arc = [0.5 * spread(slab) * k / SAMPLES for k in range(SAMPLES + 1)]
    bore = slab.manifold_bore
    given = f"manifold_bore is {_mm(bore)}; with manifold_radius {_mm(slab.manifold_radius)} and {_fan(slab)} it"
    _check_wall(slab, min(_wall(slab, slab.manifold_radius, angle, bore) for angle in arc), given, "the slab's side")
    for number, line in enumerate(found, 1):
        end_bore, name = own(slab, "end_bores", "end_bore", number)
        given = f"{name} is {_mm(end_bore)}; with manifold_radius {_mm(slab.manifold_radius)} and {_fan(slab)} channel {number}"
        walls = [_wall(slab, line.centre, line.angle, line.cap)]
        for k in range(SAMPLES + 1):
            along = line.start + (line.end - line.start) * k / SAMPLES
            radius = line.radius(along)
            walls += [_wall(slab, along, line.angle, radius), along * math.cos(line.angle) - radius]
        if slab.reaches:
            given = (
                f"reaches[{number}] is {_mm(slab.reaches[number - 1])}; with {name} {_mm(end_bore)} channel {number}"
            )
        _check_wall(slab, min(walls), given, "the slab's side")


def _wall(slab: SeminarActuator, along: float, angle: float, radius: float) -> float:
    return edge_distance(slab, along * math.cos(angle), along * math.sin(angle)) - radius


def _check_neighbours(slab: SeminarActuator, found: list[Channel]) -> None:
    """Solid between neighbouring channels, outside of the manifold that joins them."""
    begin = slab.manifold_radius + slab.manifold_bore
    for first, second, one, other, pitch in pairs(found):
        end = min(one.end, other.end)
        for k in range(SAMPLES + 1):
            along = begin + (end - begin) * k / SAMPLES
            left = 2.0 * along * math.sin(0.5 * pitch) - one.radius(along) - other.radius(along)
            if left < slab.least_wall * (1 - 1e-9):
                mouth, name = own(slab, "bores", "channel_bore", second)
                raise GeometryError(
                    f"channels is {slab.channels}; with {_fan(slab)}, manifold_radius {_mm(slab.manifold_radius)} and "
                    f"{name} {_mm(mouth)} neighbours (channels {first} and {second}) "
                    + ("break into each other" if left <= 0.0 else f"are {_mm(left)} apart")
                    + f", and least_wall asks for {_mm(slab.least_wall)}"
                )


def _check_fillet(slab: SeminarActuator, found: list[Channel]) -> None:
    """The rounding must fit on the bores, and two of them between neighbouring channels."""
    limits = [(line.bore, number) for number, line in enumerate(found, 1)]
    for _, second, one, other, pitch in pairs(found):
        # Two roundings side by side on the manifold's wall, with a fifth of one to spare.
        room = slab.manifold_radius * math.sin(0.5 * pitch) - 0.5 * (one.bore + other.bore)
        limits.append((room / 1.1, second))
    limit, number = min(limits)
    if slab.fillet > limit:
        mouth, name = own(slab, "bores", "channel_bore", number)
        raise GeometryError(
            f"fillet is {_mm(slab.fillet)}; with {name} {_mm(mouth)} and {slab.channels} channels this slab takes at most "
            f"{_mm(max(limit, 0.0))}"
        )


def _check_cells(slab: SeminarActuator) -> None:
    if not 3.0 <= slab.around <= 64.0:
        raise GeometryError(f"around is {slab.around:g}; it must lie between 3 and 64 cells around a channel")
    if slab.cell_size > slab.thickness:
        raise GeometryError(f"cell_size is {_mm(slab.cell_size)}; it must not pass thickness, {_mm(slab.thickness)}")
    check_cell_count(slab.cell_size, expected_cells(slab), MOST_CELLS, f" with around {slab.around:g}")
