"""Make a device's mould in a separate Gmsh process, with all checks, before anything is written."""

from __future__ import annotations

import dataclasses
import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import cast

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from geometries.meshing import apart
from softmodels.casting.bodies import (
    MM,
    OTHER_SIDE,
    Hole,
    Parted,
    Solid,
    Tooling,
    face_namer,
    left,
    part,
    scaled,
    tooling,
    turned,
)
from softmodels.casting.facets import Facets, facets_of
from softmodels.casting.settings import MouldError, Workshop
from softmodels.common.arrays import Array
from softmodels.common.cards import Shown, Table
from softmodels.common.errors import MeshingError
from softmodels.common.schema import shown

# ----------------------------------------------------------------------------------------------------------------------
# Checks of every body of a mould before anything is written.


SLIP = math.sin(math.radians(0.1))
"""Sine of the allowed undercut: 0.1 degrees, 2 um on a wall of 1 mm."""
FACING = -0.5
"""Cosine between the normals of two faces below which they are two sides of a wall instead of an edge."""
MOST_RAYS = 20_000
SAME = 1e-6
"""Largest difference between the device and its cast, relative to the device's volume."""
Name = Callable[[Array], str]
"""Names the face of the part at a place in the mould (mm): a clause."""


@dataclasses.dataclass(frozen=True)
class Checked:
    """Check results of one body.

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
    """Check a body against the workshop's limits.

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
        raise MeshingError(f"the {name} is not watertight ({facets.open_edges} open edges); change a length slightly")
    lean, own = _leans(name, facets, made, workshop, named)
    wall, gap = thicknesses(facets)
    allowed = 2.0 * facets.chord
    for what, (value, place), limit, field in (
        ("thin", wall, workshop.least_wall, "least_wall"), ("wide", gap, workshop.least_gap, "least_gap"),
    ):  # fmt: skip
        if value + allowed < MM * limit:
            raise MouldError(
                f"the {name} is {shown(float(f'{value / MM:.3g}'), 'm')} {what} {named(place)}; the printer's "
                f"smallest {'wall' if what == 'thin' else 'gap'} is {shown(limit, 'm')} ({field})"
            )
    bound = facets.chord * _area(facets) / facets.volume
    differs = facets.polyhedron_volume / facets.volume - 1.0
    if abs(differs) > bound + SAME:
        raise MeshingError(
            f"the STL of the {name} differs from its STEP by {differs:.2g} of the volume; use a smaller chord"
        )
    return Checked(
        math.degrees(math.asin(min(1.0, max(-1.0, lean)))), math.degrees(math.asin(min(1.0, max(-1.0, own)))),
        wall[0] / MM, gap[0] / MM, facets.chord / MM, differs,
    )  # fmt: skip


def check_core(facets: Facets, workshop: Workshop, named: Name) -> float:
    """Check the cavity's cores against the printer; return the smallest width in m.

    Raises:
        MouldError: A channel too fine.
    """
    (width, place), _ = thicknesses(facets)
    if width + 2.0 * facets.chord < MM * workshop.least_wall:
        raise MouldError(
            f"a channel is {shown(float(f'{width / MM:.3g}'), 'm')} wide {named(place)}; the printer's smallest rib is "
            f"{shown(workshop.least_wall, 'm')} (least_wall)"
        )
    return width / MM


def _area(facets: Facets) -> float:
    a, b, c = np.moveaxis(facets.corners, 1, 0)
    return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _leans(name: str, facets: Facets, made: Tooling, workshop: Workshop, named: Name) -> tuple[float, float]:
    """Return the least sine of the lean of the part's faces and of the mould's own, each along the opening direction of its
    body.

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
            f"the pins and holes of the {name} have too little draft; please report this with the parameters"
        )
    values = lean[formed]
    worst = float(values.min(initial=1.0))
    if worst < -SLIP:
        at = facets.corners[formed][np.unravel_index(values.argmin(), values.shape)[0]].mean(axis=0)
        raise MouldError(
            f"the {name} cannot be demoulded: it is undercut by {math.degrees(math.asin(min(1.0, -worst))):.3g} deg "
            f"{named(at)}; choose another direction (--pull) or plane (--split), or change the part"
        )
    return worst, least_own


def _around(places: Array, holes: Sequence[Hole]) -> npt.NDArray[np.bool_]:
    inside = np.zeros(len(places), dtype=bool)
    for hole in holes:
        inside |= np.hypot(*(places[:, :2] - hole.place).T) < hole.mouth + 1e-3
    return inside


def thicknesses(facets: Facets) -> tuple[tuple[float, Array], tuple[float, Array]]:
    """Return the smallest wall and smallest gap of a body in mm, each with its place, measured along the normal to the
    other side."""
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


HALVES = ("upper", "lower")
CAST_CHORD = 0.05
"""Chord error in mm of the casts, used only for their volume."""


@dataclasses.dataclass(frozen=True)
class MouldBody:
    """A body of a mould, or what is cast in it.

    Attributes:
        name: ``"upper cup"``, ``"lower lid"``, ``"upper half"`` (cast) and so on.
        step: Its STEP file in mm.
        facets: Its surface in mm.
        opens: Way along z that it leaves, 1 or -1; 0 of what is cast.
        checked: What was found of it; None of what is cast.
    """

    name: str
    step: bytes
    facets: Facets
    opens: float
    checked: Checked | None

    @property
    def stem(self) -> str:
        """Name of its files."""
        return self.name.replace(" ", "-")


@dataclasses.dataclass(frozen=True, repr=False)
class Made(Shown):
    """The finished mould; lengths of bodies in mm, everything else in SI units.

    Attributes:
        bodies: To print: cup and lid of each half.
        casts: What is cast in them, as large as the mould leaves it.
        device: STEP of what the two halves are once bonded, the tube's hole filled, shrunk, in the device's own place; mm.
        differs: How far casts and device differ in volume, centre and moments of inertia, as a share.
        volume: Of the device's solid, m3.
        plug: Volume that the tube takes from it, m3.
        level: Height of the parting plane in the mould, mm.
        wall_above, wall_below: Silicone between the cavities and the part's faces along the pull, m.
        thinnest: Smallest wall of silicone, m.
        channel: Smallest width of the cavity, m.
    """

    bodies: tuple[MouldBody, ...]
    casts: tuple[MouldBody, ...]
    device: bytes
    differs: float
    volume: float
    plug: float
    level: float
    wall_above: float
    wall_below: float
    thinnest: float
    channel: float

    def _line(self) -> str:
        return f"of {len(self.bodies)} bodies to print, for {self.cast_volume * 1e6:.4g} ml of silicone"

    def _figures(self) -> Table:
        return [
            ("to print", ", ".join(body.name for body in self.bodies)),
            ("silicone", f"{self.cast_volume * 1e6:.4g} ml in {len(self.casts)} parts, bonded"),
            ("device", f"{self.volume * 1e6:.4g} ml"),
            ("thinnest wall", f"{self.thinnest * 1e3:.3g} mm"),
            ("narrowest part of the cavity", f"{self.channel * 1e3:.3g} mm"),
            ("casts against the device", f"{self.differs:.1e} (volume, centre, moments of inertia)"),
        ]

    @property
    def cast_volume(self) -> float:
        """Volume of both halves after demoulding, m3."""
        return sum(body.facets.volume for body in self.casts) / MM**3


def made(device: Actuator, workshop: Workshop, stopped: Callable[[], bool] = bool) -> Made:
    """Make a device's mould.

    Args:
        device: The device; slices and sections stand for their whole.
        workshop: How it is made.
        stopped: Asked several times a second; once true, the work ends.

    Raises:
        MouldError: It cannot be made so.
        GeometryError, MeshingError: The device's whole cannot be made, or a body fails a check.
        MeshingStopped: ``stopped`` was true.
    """
    return apart(_made, device, workshop, stopped=stopped)


def _made(device: Actuator, workshop: Workshop) -> Made:
    from geometries.meshing import private_model

    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        with private_model():
            model = _modelled(device, workshop, folder)
        named = face_namer(device, model.parted)
        bodies = []
        for half in HALVES:
            for kind, way in (("cup", -1.0), ("lid", 1.0)):
                name, file = f"{half} {kind}", folder / f"{half}-{kind}.step"
                facets = facets_of(file, MM * workshop.chord)
                checked = check_body(name, facets, model.toolings[half], workshop, named)
                bodies.append(MouldBody(name, file.read_bytes(), facets, way * OTHER_SIDE[half], checked))
        cores = [facets_of(file, MM * workshop.chord) for file in sorted(folder.glob("core-*.step"))]
        channel = min(check_core(core, workshop, named) for core in cores)
        casts = []
        for half in HALVES:
            file = folder / f"{half}-half.step"
            casts.append(MouldBody(f"{half} half", file.read_bytes(), facets_of(file, CAST_CHORD), 0.0, None))
        silicone = min(thicknesses(cast.facets)[0][0] for cast in casts)
        shrunk = workshop.scale**-3 / MM**3
        inside = np.concatenate([core.points[:, 2] for core in cores])
        top, bottom = casts[0].facets.points[:, 2].max(), casts[1].facets.points[:, 2].min()
        above, below = (gap / MM / workshop.scale for gap in (top - inside.max(), inside.min() - bottom))
        return Made(
            tuple(bodies), tuple(casts), (folder / "device.step").read_bytes(), model.differs,
            sum(cast.facets.volume for cast in casts) * shrunk + model.plug * shrunk, model.plug * shrunk,
            model.parted.level, float(above), float(below), silicone / MM / workshop.scale, channel / workshop.scale,
        )  # fmt: skip


@dataclasses.dataclass(frozen=True)
class _Model:
    """Data to keep after the CAD model is closed; lengths in mm."""

    parted: Parted
    toolings: Mapping[str, Tooling]
    differs: float
    plug: float


def _modelled(device: Actuator, workshop: Workshop, folder: Path) -> _Model:
    """Make bodies and casts in the current Gmsh model, compare them with the device, and write a STEP of each.

    Raises:
        MeshingError: The mould leaves something else than the device.
    """
    import gmsh  # type: ignore[import-untyped]

    occ = gmsh.model.occ
    parted = part(device, workshop)
    toolings = {half: tooling(parted, half, workshop) for half in HALVES}
    voids = {half: left(parted, tools) for half, tools in toolings.items()}
    differs = max(_difference(voids[half], tools.target, parted.size) for half, tools in toolings.items())
    if differs > SAME or any(len(solids) != 1 for solids in voids.values()):
        raise MeshingError(
            f"the cast differs from the device (volumes or moments by {differs:.2g}); change a length slightly"
        )
    plug = list(occ.cut(occ.copy(parted.inlet), parted.cores, removeTool=False)[0]) if parted.inlet else []
    found = _Model(parted, toolings, differs, sum(occ.getMass(*solid) for solid in plug))
    named = {
        f"{half}-{kind}": solid
        for half, tools in toolings.items()
        for kind, solid in (("cup", tools.cup), ("lid", tools.lid))
    }
    named |= {f"{half}-half": solids[0] for half, solids in voids.items()}
    named |= {f"core-{k}": core for k, core in enumerate(parted.cores)}
    named["device"] = _bonded([solids[0] for solids in voids.values()], plug)
    _write_steps(named, folder, parted)
    return found


def _difference(one: list[Solid], other: list[Solid], size: float) -> float:
    """Return how far two bodies differ in volume, centre and moments of inertia, as shares of the volume and of the size.

    Not the volume of what is left of one without the other: the CAD kernel fails on bodies whose faces all coincide.
    """
    import gmsh

    occ, found = gmsh.model.occ, []
    for solids in (one, other):
        mass = np.array([occ.getMass(*solid) for solid in solids])
        centre = np.array([occ.getCenterOfMass(*solid) for solid in solids])
        inertia = np.array([occ.getMatrixOfInertia(*solid) for solid in solids])
        found.append((mass.sum(), mass @ centre, inertia.sum(axis=0)))
    whole = found[1][0]
    return max(
        float(np.abs(np.asarray(a) - b).max()) / (whole * size**k) for k, (a, b) in enumerate(zip(*found, strict=True))
    )


def _bonded(halves: list[Solid], plug: list[Solid]) -> Solid:
    """Return the halves merged, with the tube's hole filled."""
    import gmsh

    parts = [*halves, *plug]
    # Merging faces across the bond is optional, fails at times, and takes as long as the rest.
    gmsh.option.setNumber("Geometry.OCCUnionUnify", 0)
    solids = gmsh.model.occ.fuse(parts[:1], parts[1:], removeObject=False, removeTool=False)[0]
    gmsh.option.setNumber("Geometry.OCCUnionUnify", 1)
    if len(solids) != 1:
        raise MeshingError("the CAD kernel cannot merge the two halves; change a length slightly")
    return (3, int(solids[0][1]))


def _write_steps(named: Mapping[str, Solid], folder: Path, parted: Parted) -> None:
    """Write each of some solids of the current Gmsh model into a file of its own; ``device`` back in its own size and place."""
    import gmsh

    from geometries.meshing import private_model

    occ, file = gmsh.model.occ, str(folder / "all.brep")
    occ.remove([solid for solid in occ.getEntities(3) if solid not in named.values()], recursive=True)
    occ.synchronize()
    order = sorted(named, key=lambda name: named[name][1])  # as Gmsh writes them
    gmsh.write(file)
    for k, name in enumerate(order):
        with private_model():
            solids = occ.importShapes(file, format="brep")
            occ.remove([solid for j, solid in enumerate(solids) if j != k], recursive=True)
            if name == "device":
                turned([solids[k]], parted.turn.T)
                scaled(1.0 / parted.scale)
            occ.synchronize()
            gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
            gmsh.write(str(folder / f"{name}.step"))
            gmsh.option.setString("Geometry.OCCTargetUnit", "")
