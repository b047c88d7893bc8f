"""A PneuNet in Gmsh: half of it, of two sides the upper one, cut into its layers, with a name for every face.

The model is in mm and the mesh is written in m: the CAD kernel's fixed tolerances suit mm.
"""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np

from geometries.errors import MeshingError
from geometries.pneunet_plan import Box, air, gaps, half_width, length, top, upper

if TYPE_CHECKING:
    from geometries.pneunet import PneuNet

Entity = tuple[int, int]

MM = 1e3
"""Model lengths in one metre."""

CENTRAL = "middle"
"""Role of the plane z = 0 on which the upper side is mirrored into the lower one."""


def build_finger(finger: PneuNet) -> None:
    """Fill the current Gmsh model (mm) with what is meshed, its roles, its regions and its cell sizes."""
    import gmsh  # type: ignore[import-untyped]

    layers = {"solid": [_cut(upper(finger), [*air(finger), *gaps(finger)])], **_base(finger)}
    # One point where two layers meet, not two: their faces are made common.
    every = [(solid, name) for name, solids in layers.items() for solid in solids]
    _, parts = gmsh.model.occ.fragment([every[0][0]], [solid for solid, _ in every[1:]])
    gmsh.model.occ.synchronize()
    regions: dict[str, list[int]] = defaultdict(list)
    for (_, name), found in zip(every, parts, strict=True):
        regions[name] += [tag for _, tag in found]
    for name, tags in regions.items():
        gmsh.model.addPhysicalGroup(3, tags, name=name)
    _name_faces(finger, [(3, tag) for tags in regions.values() for tag in tags])
    gmsh.option.setNumber("Mesh.ScalingFactor", 1.0 / MM)
    gmsh.model.mesh.setSizeCallback(lambda *_: MM * finger.cell_size)


def build_whole_finger(finger: PneuNet) -> None:
    """Fill the current Gmsh model (mm) with the whole finger, one solid."""
    import gmsh

    occ = gmsh.model.occ
    body = _whole(upper(finger), finger.sides)
    body = Box((*body.low[:2], body.low[2] if finger.sides == 2 else -0.5 * finger.base), body.high)
    empty = [_whole(box, finger.sides, below) for box in air(finger) + gaps(finger) for below in range(finger.sides)]
    solids, _ = occ.cut([_add(body)], [_add(box) for box in empty])
    if [dimension for dimension, _ in solids] != [3]:
        raise MeshingError(
            f"the CAD kernel made {len(solids)} solids of one finger; please report this with the parameters"
        )
    occ.synchronize()


def _add(box: Box) -> Entity:
    import gmsh

    low, size = MM * np.array(box.low), MM * np.subtract(box.high, box.low)
    return (3, int(gmsh.model.occ.addBox(*low, *size)))


def _whole(box: Box, sides: int, below: int = -1) -> Box:
    """A block on both sides of the mirror plane: above the base, below it (1), or from below to above (-1 of two sides)."""
    (x0, _, z0), (x1, y1, z1) = box.low, box.high
    if sides == 2 and below < 0:
        z0 = -z1
    elif below > 0:
        z0, z1 = -z1, -z0
    return Box((x0, -y1, z0), (x1, y1, z1))


def _cut(body: Box, empty: list[Box]) -> Entity:
    import gmsh

    solids, _ = gmsh.model.occ.cut([_add(body)], [_add(box) for box in empty])
    if [dimension for dimension, _ in solids] != [3]:
        raise MeshingError(
            f"the CAD kernel made {len(solids)} solids of one finger; please report this with the parameters"
        )
    return solids[0]


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


def _name_faces(finger: PneuNet, solids: list[Entity]) -> None:
    """Give every face on the boundary of the finger one role."""
    import gmsh

    roles: dict[str, list[int]] = defaultdict(list)
    for _, tag in gmsh.model.getBoundary(solids, combined=True, oriented=False):
        roles[_role(finger, tag)].append(tag)
    for role, tags in roles.items():
        gmsh.model.addPhysicalGroup(2, tags, name=role)


def _role(finger: PneuNet, tag: int) -> str:
    """The role of a face from the block around it, which is flat."""
    import gmsh

    corners = np.array(gmsh.model.occ.getBoundingBox(2, tag)).reshape(2, 3) / MM
    low, high = corners
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
    if any(box.holds(low, high, near) for box in air(finger)):
        return "cavity"
    return "chamber_walls" if flat == 0 else "outer"
