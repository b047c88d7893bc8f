"""The dimensions of a seminar actuator that have a least value: walls, widths of channels, and room that its parts need.

Walls and widths are what a workshop puts a least value to. Room that only the shape needs may come down to nothing; it is
counted on top of least_wall, so that one least value suits all. Each is a smooth function of the parameters: where a wall's
thickness changes linearly along it, both ends stand for it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from geometries.seminar_checks import LARGEST_BORE_RATIO, NARROWEST, WIDEST
from geometries.seminar_plan import Channel, edge_distance, half_fan, own, pairs, side, spread

if TYPE_CHECKING:
    from geometries.seminar import SeminarActuator

PLACES = {
    "at the manifold": ("bores", "channel_bore"),
    "half way": ("middle_bores", ""),
    "at the end": ("end_bores", "end_bore"),
}
"""Where a channel's radius is given, the list that gives it and what is common to all without it."""


def clearances(slab: SeminarActuator) -> dict[str, float]:
    """Dimensions in m that have a least value; see `geometries.Actuator.clearances`.

    Where all are least_wall or more, the slab can be made.
    """
    lines = [line for line in half_fan(slab) if line is not None]
    return {
        **_sections(slab, len(lines)),
        **_sides(slab, lines),
        **_neighbours(slab, lines),
        **{f"least_wall and {name}": slab.least_wall + room for name, room in _rooms(slab, lines).items()},
    }


def _sections(slab: SeminarActuator, count: int) -> dict[str, float]:
    """Widths of the manifold and the channels, and the solid above and below them."""
    bores = {"the manifold": slab.manifold_bore}
    for place, (several, common) in PLACES.items():
        if getattr(slab, several):
            bores |= {f"channel {k} {place}": own(slab, several, common, k)[0] for k in range(1, count + 1)}
        elif common:
            bores[f"the channels {place}"] = getattr(slab, common)
    found = {f"width of {name}": 2.0 * bore for name, bore in bores.items()}
    for face, sign in (("top", 1.0), ("bottom", -1.0)):
        found |= {
            f"solid between {name} and the {face}": 0.5 * slab.thickness - sign * slab.offset - bore
            for name, bore in bores.items()
        }
    return found


def _sides(slab: SeminarActuator, lines: list[Channel]) -> dict[str, float]:
    """Solid between the network and the slab's base, sides and tip."""
    radius, bore, half = slab.manifold_radius, slab.manifold_bore, 0.5 * spread(slab)
    normal, _ = side(slab)
    nearest = min(math.atan2(normal[1], normal[0]), half)  # there the arc's distance is flat, so this is smooth
    found = {
        "solid between the manifold and the base": radius * math.cos(half) - bore,
        "solid between the manifold and the side": edge_distance(
            slab, radius * math.cos(nearest), radius * math.sin(nearest)
        )
        - bore,
        f"solid between the end of channel {len(lines)} and the base": lines[-1].centre * math.cos(half)
        - lines[-1].cap,
    }
    if not slab.reaches:
        found["solid between the channels' ends and the side"] = slab.edge
    for number, line in enumerate(lines, 1):
        if slab.reaches:
            found[f"solid between the end of channel {number} and the side"] = _to_side(
                slab, line, line.centre, line.cap
            )
        if slab.middle_bores:
            middle = line.cones[0].end
            wall = _to_side(slab, line, middle, line.radius(middle))
            found[f"solid between the middle of channel {number} and the side"] = wall
    return found


def _to_side(slab: SeminarActuator, line: Channel, along: float, radius: float) -> float:
    return edge_distance(slab, along * math.cos(line.angle), along * math.sin(line.angle)) - radius


def _neighbours(slab: SeminarActuator, lines: list[Channel]) -> dict[str, float]:
    """Solid between neighbouring channels, at the manifold and wherever a cone of either ends."""
    found = {}
    for first, second, one, other, pitch in pairs(lines):
        places = {"at the manifold": (slab.manifold_radius + slab.manifold_bore, 0)}
        for number, line in {first: one, second: other}.items():
            places |= {
                f"{'at the end' if k == len(line.cones) - 1 else 'half way'} of channel {number}": (cone.end, k)
                for k, cone in enumerate(line.cones)
            }
        for place, (along, k) in places.items():
            radii = [cone.bore + cone.slope * (along - cone.start) for cone in (one.cones[k], other.cones[k])]
            found[f"solid between channels {first} and {second} {place}"] = 2.0 * along * math.sin(0.5 * pitch) - sum(
                radii
            )
    return found


def _rooms(slab: SeminarActuator, lines: list[Channel]) -> dict[str, float]:
    """What the shape needs beyond walls: 0 is enough."""
    radius, bore, fillet = slab.manifold_radius, slab.manifold_bore, slab.fillet
    half, shorter = 0.5 * spread(slab), {"length": slab.length, "width": slab.base_width}
    found = {f"room for the thickness in the {name}": 0.5 * size - slab.thickness for name, size in shorter.items()}
    found |= {
        "room for a cell in the thickness": slab.thickness - slab.cell_size,
        "room for the manifold's bore in its radius": radius - 2.0 * bore,
        "room for a wider fan": radius * (math.radians(0.5 * WIDEST) - half),
        "room for a narrower fan": radius * (half - math.radians(0.5 * NARROWEST)),
    }
    if slab.tip_radius:
        found |= {f"room for tip_radius in the {name}": 0.4 * size - slab.tip_radius for name, size in shorter.items()}
    for number, line in enumerate(lines, 1):
        found[f"straight length of channel {number}"] = (
            line.end - line.start - bore - own(slab, "end_bores", "end_bore", number)[0]
        )
    for number, line in enumerate(lines if slab.bores else lines[:1], 1):
        name = f"channel {number}" if slab.bores else "the channels"
        found[f"room for {name} in the manifold's bore"] = LARGEST_BORE_RATIO * bore - line.bore
        if fillet:
            found[f"room for the fillet in {name}"] = line.bore - fillet
    for first, second, one, other, pitch in pairs(lines) if fillet else ():
        room = 2.0 * radius * math.sin(0.5 * pitch) - one.bore - other.bore
        found[f"room for two fillets between channels {first} and {second}"] = room - 2.2 * fillet
    return found
