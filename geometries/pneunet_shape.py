"""A PneuNet in Gmsh: half of it, of two sides the upper one, in its layers, with a name for every face."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geometries.layers import Entity, add_block, bond, corners_of, face_block, one_solid, set_sizes
from geometries.pneunet_plan import Box, air, gaps, half_width, length, top, upper

if TYPE_CHECKING:
    from geometries.pneunet import PneuNet

CENTRAL = "middle"
"""Role of the plane z = 0 on which the upper side is mirrored into the lower one."""


def build_finger(finger: PneuNet) -> None:
    """Fill the current Gmsh model (mm) with what is meshed, its roles, its regions and its cell sizes."""
    bond(
        {"solid": [_without(upper(finger), [*air(finger), *gaps(finger)])], **_base(finger)},
        lambda tag: _role(finger, tag),
    )
    set_sizes(lambda x, y, z: finger.cell_size)


def build_whole_finger(finger: PneuNet) -> None:
    """Fill the current Gmsh model (mm) with the whole finger, one solid."""
    import gmsh  # type: ignore[import-untyped]

    body = _whole(upper(finger), finger.sides)
    body = Box((*body.low[:2], body.low[2] if finger.sides == 2 else -0.5 * finger.base), body.high)
    _without(
        body, [_whole(box, finger.sides, below) for box in air(finger) + gaps(finger) for below in range(finger.sides)]
    )
    gmsh.model.occ.synchronize()


def _add(box: Box) -> Entity:
    return add_block(box.low, box.high)


def _whole(box: Box, sides: int, below: int = -1) -> Box:
    """A block on both sides of the mirror plane: above the base, below it (1), or from below to above (-1 of two sides)."""
    (x0, _, z0), (x1, y1, z1) = box.low, box.high
    if sides == 2 and below < 0:
        z0 = -z1
    elif below > 0:
        z0, z1 = -z1, -z0
    return Box((x0, -y1, z0), (x1, y1, z1))


def _without(body: Box, empty: list[Box]) -> Entity:
    """A block with others cut out of it."""
    import gmsh

    return one_solid(gmsh.model.occ.cut([_add(body)], [_add(box) for box in empty])[0])


def _base(finger: PneuNet) -> dict[str, list[Entity]]:
    """The layers of the base by region."""
    L, w = length(finger), half_width(finger)

    def layer(low: float, high: float) -> Entity:
        return _add(Box((0.0, 0.0, low), (L, w, high)))

    half, paper, lowest = 0.5 * finger.base, 0.5 * finger.paper, 0.0 if finger.sides == 2 else -0.5 * finger.base
    if not paper:
        return {"base": [layer(lowest, half)]}
    if finger.sides == 2:
        return {"base": [layer(paper, half)], "paper": [layer(0.0, paper)]}
    return {"base": [layer(paper, half), layer(lowest, -paper)], "paper": [layer(-paper, paper)]}


def _role(finger: PneuNet, tag: int) -> str:
    """The role of a face from the block around it, which is flat."""
    low, high = face_block(tag)
    near = 1e-6  # the kernel's blocks are a little larger than what is in them
    flat = int(np.argmin(high - low))
    at = 0.5 * float(low[flat] + high[flat])
    lowest = (CENTRAL, 0.0) if finger.sides == 2 else ("bottom", -0.5 * finger.base)
    for role, axis, place in (
        ("support", 0, 0.0),
        ("tip", 0, length(finger)),
        ("plane0", 1, 0.0),
        ("top", 2, top(finger)),
        (lowest[0], 2, lowest[1]),
    ):
        if flat == axis and abs(at - place) < near:
            return role
    # One face may run along several boxes, as the base's does under the chambers and the channel.
    if all(any(box.holds(corner, corner, near) for box in air(finger)) for corner in corners_of(tag)):
        return "cavity"
    return "chamber_walls" if flat == 0 else "outer"
