"""What every body of a mould is held against before anything is written."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import cast

import numpy as np
import numpy.typing as npt

from geometries.errors import MeshingError
from geometries.fields import shown
from softmodels.design.mould.bodies import Hole, Tooling
from softmodels.design.mould.facets import Array, Facets
from softmodels.design.mould.settings import MouldError, Workshop
from softmodels.design.mould.solids import MM, OTHER_SIDE

SLIP = math.sin(math.radians(0.1))
"""Sine of the lean by which a face may hang over: 0.1 degrees, 2 um on a wall of 1 mm."""
FACING = -0.5
"""Cosine between the normals of two faces below which they are two sides of one wall, and not of an edge."""
MOST_RAYS = 20_000
SAME = 1e-6
"""Largest difference between the device and what its mould leaves, in volumes of the device."""
Name = Callable[[Array], str]
"""Names the face of the part at a place in the mould (mm): a clause."""


@dataclasses.dataclass(frozen=True)
class Checked:
    """What was found of one body.

    Attributes:
        lean: Least angle in degrees between the pull and the faces that form the part: 0 for an upright wall.
        own_lean: The same of pins, sockets and holes.
        wall: Smallest thickness of the body, m.
        gap: Smallest width of its grooves and holes, m.
        chord: Largest distance of the STL from the exact body, m.
        volume_gap: STL's volume over the exact one, less 1.
    """

    lean: float
    own_lean: float
    wall: float
    gap: float
    chord: float
    volume_gap: float


def check_body(name: str, facets: Facets, made: Tooling, workshop: Workshop, named: Name) -> Checked:
    """Hold a body against what a workshop needs of it.

    Args:
        name: ``"upper cup"`` and the like.
        facets: Its surface.
        made: The mould that it belongs to.
        workshop: The limits.
        named: Names a face of the part.

    Raises:
        MouldError: An undercut, a wall or a gap too fine for the printer.
        MeshingError: It is not watertight, or its STL strays.
    """
    if facets.open_edges:
        raise MeshingError(f"the {name} is not watertight ({facets.open_edges} open edges); change a length a little")
    lean, own = _leans(name, facets, made, workshop, named)
    wall, gap = thicknesses(facets)
    allowed = 2.0 * facets.chord
    for what, (value, place), limit, field in (
        ("thin", wall, workshop.least_wall, "least_wall"), ("wide", gap, workshop.least_gap, "least_gap"),
    ):  # fmt: skip
        if value + allowed < MM * limit:
            raise MouldError(
                f"the {name} is {shown(float(f'{value / MM:.3g}'), 'm')} {what} {named(place)}, and the printer makes "
                f"{'walls' if what == 'thin' else 'gaps'} from {shown(limit, 'm')} ({field})"
            )
    bound = facets.chord * _area(facets) / facets.volume
    differs = facets.polyhedron_volume / facets.volume - 1.0
    if abs(differs) > bound + SAME:
        raise MeshingError(
            f"the STL of the {name} differs from its STEP by {differs:.2g} of the volume; take a smaller chord"
        )
    return Checked(
        math.degrees(math.asin(min(1.0, max(-1.0, lean)))), math.degrees(math.asin(min(1.0, max(-1.0, own)))),
        wall[0] / MM, gap[0] / MM, facets.chord / MM, differs,
    )  # fmt: skip


def check_core(facets: Facets, workshop: Workshop, named: Name) -> float:
    """Hold the whole cavity against the printer, which makes its cores; return its smallest width in m.

    Raises:
        MouldError: A channel too fine.
    """
    (width, place), _ = thicknesses(facets)
    if width + 2.0 * facets.chord < MM * workshop.least_wall:
        raise MouldError(
            f"a channel is {shown(float(f'{width / MM:.3g}'), 'm')} wide {named(place)}, and the printer makes ribs from "
            f"{shown(workshop.least_wall, 'm')} (least_wall)"
        )
    return width / MM


def _area(facets: Facets) -> float:
    a, b, c = np.moveaxis(facets.corners, 1, 0)
    return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _leans(name: str, facets: Facets, made: Tooling, workshop: Workshop, named: Name) -> tuple[float, float]:
    """Least sine of the lean of the part's faces and of the mould's own, each along the way its body leaves.

    Raises:
        MouldError: A face hangs over.
        MeshingError: A pin, a socket or a hole has less than the draft.
    """
    lid = name.endswith("lid")
    leaves = OTHER_SIDE[made.half] * (1.0 if lid else -1.0)
    lean = -leaves * facets.normals[:, :, 2]
    heights = facets.corners[:, :, 2]
    back = made.high[2] if leaves > 0 else made.low[2]
    outside = (np.abs(heights - back) < 1e-3).all(axis=1)
    middles = facets.corners.mean(axis=1)
    sides = np.isclose(middles[:, :2], made.low[:2], atol=1e-3) | np.isclose(middles[:, :2], made.high[:2], atol=1e-3)
    beyond = OTHER_SIDE[made.half] * (middles[:, 2] - made.level) > 1e-4  # on the lid's side of the parting plane
    holes = beyond & lid & _around(middles, [made.pour, *made.vents])
    pins = beyond & _around(
        middles,
        [Hole((float(x), float(y)), 0.0, MM * (0.5 * workshop.pin + 2.0 * workshop.clearance)) for x, y in made.pins],
    )
    steep = np.abs(facets.normals[:, :, 2]).max(axis=1) < 0.9  # not the end of a pin
    lean = np.where(holes[:, None], -lean, lean)
    own = (holes | pins) & steep & ~outside
    formed = ~own & ~outside & ~sides.any(axis=1) & ~beyond
    least_own = float(lean[own].min(initial=1.0))
    if least_own < math.sin(math.radians(workshop.draft)) - 1e-4:
        raise MeshingError(
            f"the pins and holes of the {name} have less than the draft; please report this with the parameters"
        )
    values = lean[formed]
    worst = float(values.min(initial=1.0))
    if worst < -SLIP:
        at = facets.corners[formed][np.unravel_index(values.argmin(), values.shape)[0]].mean(axis=0)
        raise MouldError(
            f"the {name} cannot be pulled off: it is undercut by {math.degrees(math.asin(min(1.0, -worst))):.3g} deg "
            f"{named(at)}; choose another direction (--pull) or plane (--split), or change the part"
        )
    return worst, least_own


def _around(places: Array, holes: Sequence[Hole]) -> npt.NDArray[np.bool_]:
    inside = np.zeros(len(places), dtype=bool)
    for hole in holes:
        inside |= np.hypot(*(places[:, :2] - hole.place).T) < hole.mouth + 1e-3
    return inside


def thicknesses(facets: Facets) -> tuple[tuple[float, Array], tuple[float, Array]]:
    """Smallest wall and smallest gap of a body in mm, each with its place: straight in, or out, to the other side."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import mutable, vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData, vtkStaticCellLocator

    body, points, cells = vtkPolyData(), vtkPoints(), vtkCellArray()
    points.SetData(numpy_to_vtk(facets.points, deep=True))
    padded = np.column_stack([np.full(len(facets.triangles), 3), facets.triangles]).astype(np.int64)
    cells.SetCells(len(padded), numpy_to_vtkIdTypeArray(padded.ravel(), deep=True))
    body.SetPoints(points)
    body.SetPolys(cells)
    locator = vtkStaticCellLocator()
    locator.SetDataSet(body)
    locator.BuildLocator()
    corners = facets.corners
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(flat, axis=1)
    good = areas > 1e-12
    flat[good] /= areas[good, None]
    far = float(np.linalg.norm(np.ptp(facets.points, axis=0)))
    chosen = np.flatnonzero(good)
    if len(chosen) > MOST_RAYS:
        chosen = chosen[np.linspace(0, len(chosen) - 1, MOST_RAYS).astype(int)]
    hit, local = [0.0] * 3, [0.0] * 3
    # VTK writes into these three, whatever its types say.
    t, part, cell = cast(float, mutable(0.0)), cast(int, mutable(0)), cast(int, mutable(0))
    found = []
    for way in (-1.0, 1.0):
        best, place = math.inf, np.zeros(3)
        for k in chosen:
            begin = corners[k].mean(axis=0)
            step = way * flat[k]
            if not locator.IntersectWithLine(
                list(begin + 1e-4 * step), list(begin + far * step), 0.0, t, hit, local, part, cell
            ):
                continue
            if flat[k] @ flat[int(cell)] < FACING and (distance := float(np.linalg.norm(hit - begin))) < best:
                best, place = distance, begin
        found.append((best, place))
    return found[0], found[1]
