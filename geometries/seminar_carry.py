"""Where the boundary of a seminar actuator lies on another one.

The outer faces follow the outline, from corner to corner and from tangent point to tangent point, the walls of the air go their
own way (`geometries.seminar_network`). On the mirror plane, what lies between the air and the faces follows both, more
the nearer one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import scipy

from geometries.errors import GeometryError
from geometries.seminar_junction import Array
from geometries.seminar_network import carry_network
from geometries.seminar_plan import half_fan, side

if TYPE_CHECKING:
    from geometries.seminar import SeminarActuator

NEARLY = 0.95
"""Part of a channel's length whose motion the faces above and below follow."""


def movable(slab: SeminarActuator) -> tuple[str, ...]:
    """Names of the parameters that `carried` follows; see `Actuator.movable`."""
    from geometries.parameters import parameter_names

    # A corner has no rounding's faces, and a slab symmetric about z = 0 stays so.
    fixed = {name for name in ("tip_radius", "fillet", "offset") if getattr(slab, name) == 0.0}
    if slab.channels % 2:
        fixed.add("angles[1]")
    return tuple(name for name in parameter_names(slab) if name not in fixed)


def carried(slab: SeminarActuator, other: SeminarActuator, points: Array) -> Array:
    """Where points on the boundary of a slab lie on another; see `Actuator.carried`."""
    _check_alike(slab, other)
    points = np.asarray(points, dtype=float)
    if other == slab:
        return points.copy()
    folded = np.column_stack([points[:, 0], np.abs(points[:, 1]), points[:, 2]])
    near, result = carry_network(slab, other, folded)
    outer = _prism(slab, other, folded)
    away = _to_faces(slab, folded)
    near = np.maximum(near, 0.0)
    # On a face nothing of the network's motion is left, on a wall nothing of the faces'.
    share = near / np.maximum(near + away, 1e-300)
    share = (share**2 * (3.0 - 2.0 * share))[:, None]
    found = (1.0 - share) * result + share * outer
    found[:, 1] = np.where(np.abs(points[:, 1]) < 1e-10 * slab.length, 0.0, np.copysign(found[:, 1], points[:, 1]))
    return found


def _check_alike(slab: SeminarActuator, other: SeminarActuator) -> None:
    """Refuse another kind of device, other choices, and a list, a rounding or a level that only one of them has."""
    if type(other) is not type(slab):
        raise GeometryError(f"the mesh of a {type(slab).__name__} cannot follow a {type(other).__name__}")
    for name in ("channels", "part", "tip", "order"):
        if getattr(slab, name) != getattr(other, name):
            raise GeometryError(
                f"{name} is {getattr(slab, name)} and {getattr(other, name)}; a mesh cannot follow that, make a new one"
            )
    for name in ("tip_radius", "fillet", "middle_bores"):
        if bool(getattr(slab, name)) != bool(getattr(other, name)):
            raise GeometryError(f"only one of two slabs has {name}; a mesh cannot follow that, make a new one")


def _lengths(slab: SeminarActuator, other: SeminarActuator) -> Callable[[Array], Array]:
    """A smooth, rising function from places along one slab's straight sides to those along the other's.

    The faces move along with the network below them: with the manifold and with the end of the channel that reaches farthest.
    """
    knots = []
    for device in (slab, other):
        far = max((line.centre + line.cap) * math.cos(line.angle) for line in half_fan(device) if line)
        start = device.manifold_radius
        knots.append([0.0, start, start + NEARLY * (far - start), side(device)[1][0]])
    if knots[0][2] > NEARLY * knots[0][3]:  # the channels reach into the tip
        knots = [[low, start, end] for low, start, _, end in knots]
    if min(np.diff(knots[1])) <= 0.0:
        raise GeometryError(
            "the channels reach so much farther into the tip that the mesh cannot follow; make a new mesh"
        )
    carry = scipy.interpolate.PchipInterpolator(*knots)
    return lambda x: np.asarray(carry(np.clip(x, 0.0, knots[0][-1])))


def _prism(slab: SeminarActuator, other: SeminarActuator, points: Array) -> Array:
    """The slab without channels onto the other's."""
    x, y, z = points.T
    (_, (corner, edge)), (_, (its_corner, its_edge)) = side(slab), side(other)
    wide, its_wide = 0.5 * slab.base_width, 0.5 * other.base_width
    to = _lengths(slab, other)(x)
    width, its_width = wide + (edge - wide) * (x / corner), its_wide + (its_edge - its_wide) * (to / its_corner)
    found = np.column_stack([to, y * its_width / np.maximum(width, 1e-300), z * (other.thickness / slab.thickness)])
    if slab.tip_radius:
        middle, its_middle = slab.length - slab.tip_radius, other.length - other.tip_radius
        bend = math.atan2(its_edge, its_corner - its_middle) / math.atan2(edge, corner - middle)
        turn = np.arccos(np.clip((x - middle) / slab.tip_radius, -1.0, 1.0))
        growth = other.tip_radius / slab.tip_radius
        ratio = growth * np.where(turn > 1e-7, np.sin(bend * turn) / np.sin(np.maximum(turn, 1e-7)), bend)
        round_ = (x > corner)[:, None]
        found = np.where(
            round_,
            np.column_stack([its_middle + other.tip_radius * np.cos(bend * turn), y * ratio, found[:, 2]]),
            found,
        )
    return found


def _to_faces(slab: SeminarActuator, points: Array) -> Array:
    """A smooth distance from all outer faces: 0 on each, below the least of the distances inside."""
    x, y, z = points.T
    normal, (corner, edge) = side(slab)
    middle = slab.length - slab.tip_radius
    straight = (corner - x) * normal[0] + (edge - y) * normal[1]
    along = (x - corner) * normal[1] - (y - edge) * normal[0]
    flank = np.where(along > 0.0, slab.tip_radius - np.hypot(x - middle, y), straight)
    half, least = 0.5 * slab.thickness, 1e-9 * slab.thickness  # nearer is on it: the flank's distance is rounded
    gaps = [np.where(gap > least, gap, 1e-30) for gap in (half - z, half + z, x, flank)]
    return 1.0 / np.sum([1.0 / gap for gap in gaps], axis=0)
