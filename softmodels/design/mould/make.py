"""A device's mould from beginning to end: in a process of Gmsh's own, with all checks, before anything is written."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from geometries import Actuator
from geometries.apart import apart
from geometries.errors import MeshingError
from softmodels.design.mould.bodies import Tooling, left, tooling
from softmodels.design.mould.checks import SAME, Checked, check_body, check_core, thicknesses
from softmodels.design.mould.face_names import face_namer
from softmodels.design.mould.facets import Facets, facets_of
from softmodels.design.mould.settings import Workshop
from softmodels.design.mould.solids import MM, OTHER_SIDE, Parted, Solid, part, scaled, turned

HALVES = ("upper", "lower")
CAST_CHORD = 0.05
"""Chord error in mm of what is cast, which nobody prints, but whose volume is told."""


@dataclasses.dataclass(frozen=True)
class Body:
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


@dataclasses.dataclass(frozen=True)
class Made:
    """What the mould's making found; lengths of bodies in mm, of everything else in SI units.

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

    bodies: tuple[Body, ...]
    casts: tuple[Body, ...]
    device: bytes
    differs: float
    volume: float
    plug: float
    level: float
    wall_above: float
    wall_below: float
    thinnest: float
    channel: float

    @property
    def cast_volume(self) -> float:
        """Of both halves as the mould leaves them, m3."""
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
                bodies.append(Body(name, file.read_bytes(), facets, way * OTHER_SIDE[half], checked))
        cores = [facets_of(file, MM * workshop.chord) for file in sorted(folder.glob("core-*.step"))]
        channel = min(check_core(core, workshop, named) for core in cores)
        casts = []
        for half in HALVES:
            file = folder / f"{half}-half.step"
            casts.append(Body(f"{half} half", file.read_bytes(), facets_of(file, CAST_CHORD), 0.0, None))
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
    """What has to be known once the CAD kernel's model is gone; lengths in mm."""

    parted: Parted
    toolings: Mapping[str, Tooling]
    differs: float
    plug: float


def _modelled(device: Actuator, workshop: Workshop, folder: Path) -> _Model:
    """Make bodies and casts in the current Gmsh model, hold them against the device, and write a STEP of each.

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
            f"the mould leaves something else than the device (volumes or moments differ by {differs:.2g}); change a "
            "length a little"
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
    """How far two bodies differ in volume, centre and moments of inertia, as shares of the volume and of the size.

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
    """The halves in one piece, the tube's hole filled."""
    import gmsh

    parts = [*halves, *plug]
    # Making one face of two where they go on over the bond is fine to have, fails now and then, and takes as long as the rest.
    gmsh.option.setNumber("Geometry.OCCUnionUnify", 0)
    solids = gmsh.model.occ.fuse(parts[:1], parts[1:], removeObject=False, removeTool=False)[0]
    gmsh.option.setNumber("Geometry.OCCUnionUnify", 1)
    if len(solids) != 1:
        raise MeshingError("the CAD kernel cannot bond the two halves; change a length a little")
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
