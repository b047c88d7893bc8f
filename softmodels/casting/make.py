"""Make a device's mould in a separate Gmsh process, with all checks, before anything is written."""

from __future__ import annotations

import dataclasses
import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
import numpy.typing as npt

from geometries import Actuator, actuator, mesh_arrays, meshing
from softmodels.casting import facets, grooves, settings
from softmodels.casting.bodies import (
    FLUSH_TOLERANCE,
    MM_PER_M,
    LostCore,
    Solid,
    Tooling,
    face_namer,
    imported,
    left,
    merged,
    recipe_of,
    scaled,
    tooling,
    turned,
)
from softmodels.casting.facets import Facets
from softmodels.common import cards, schema
from softmodels.common.arrays import Array, triple
from softmodels.common.errors import MeshingError
from softmodels.common.lazy import gmsh

if TYPE_CHECKING:
    from manifold3d import Manifold
    from vtkmodules.vtkCommonDataModel import vtkStaticCellLocator


@dataclasses.dataclass(frozen=True, repr=False)
class Mould(cards.ResultCard):
    """The finished mould; lengths of bodies in mm, everything else in SI units.

    Attributes:
        recipe: How the device is cast, with the cores that are cast of wax, each before the piece that it is for.
        bodies: Of the moulds, piece by piece, in the order in which they leave.
        extras: To print beside them: a jig where pieces are bonded, and a coupon that tests the printer's clearances.
        casts: What is cast in them of silicone, as large as the mould leaves it.
        waxes: The same of wax: the lost cores.
        device: STEP of what the pieces are once bonded, the tube's hole filled, shrunk, in the device's own place; mm.
        differs: How far casts and device differ in volume, centre and moments of inertia, as a share.
        balance: What a piece's block has more than bodies, openings and cast, over its volume.
        volume: Of the device's solid, m3.
        plug, grooved: Volumes that the tube and the grooves for a thread take from it, m3.
        wound: Threads around it, in its own size.
        thinnest: Smallest wall of silicone, m.
        channel: Smallest width of the cavity, m; NaN without one.
        scale: Length in the mould over length in the device.
    """

    recipe: actuator.Recipe
    bodies: tuple[MouldBody, ...]
    extras: tuple[MouldBody, ...]
    casts: tuple[MouldBody, ...]
    waxes: tuple[MouldBody, ...]
    device: bytes
    differs: float
    balance: float
    volume: float
    plug: float
    grooved: float
    wound: grooves.Winding | None
    thinnest: float
    channel: float
    scale: float

    @property
    def printed(self) -> tuple[MouldBody, ...]:
        """The bodies without the cores that are cast of wax."""
        return tuple(body for body in self.bodies if any(body.pull) or not self.waxes)

    def of(self, pour: actuator.Pour) -> tuple[list[MouldBody], MouldBody]:
        """Return the bodies of a piece's mould, and what is cast in it."""
        bodies = [body for body in self.bodies if body.piece == pour.name]
        return bodies, next(cast for cast in (*self.casts, *self.waxes) if cast.piece == pour.name)

    def _line(self) -> str:
        return f"of {len(self.printed)} bodies to print, for {self.cast_volume * 1e6:.4g} ml of silicone"

    def _figures(self) -> cards.Table:
        pieces = f" in {len(self.casts)} parts, bonded" if len(self.casts) > 1 else ""
        channel = [] if math.isnan(self.channel) else [("narrowest part of the cavity", f"{self.channel * 1e3:.3g} mm")]
        return [
            ("to print", ", ".join(body.name for body in self.printed)),
            ("silicone", f"{self.cast_volume * 1e6:.4g} ml{pieces}"),
            ("device", f"{self.volume * 1e6:.4g} ml"),
            ("thinnest wall", f"{self.thinnest * 1e3:.3g} mm"),
            *channel,
            ("casts against the device", f"{self.differs:.1e} (volume, centre, moments of inertia)"),
        ]

    def _remarks(self) -> list[str]:
        return self.notes

    @property
    def notes(self) -> list[str]:
        """What may go wrong with the printed bodies, sentences with the remedy."""
        fins = [(body, fin) for body in self.bodies if body.checked for fin in body.checked.fins if fin.slender]
        return [fin.told(body.name, self.scale) for body, fin in fins]

    @property
    def cast_volume(self) -> float:
        """Volume of all casts after demoulding, m3."""
        return sum(body.facets.volume for body in self.casts) / MM_PER_M**3


def made(device: Actuator, workshop: settings.Workshop, stopped: Callable[[], bool] = bool) -> Mould:
    """Make the mould of a device, slices and sections standing for their whole; ``stopped`` is asked several times a second,
    and once true ends the work.

    Raises:
        MouldError: It cannot be made so.
        GeometryError, MeshingError: The device's whole cannot be made, or a body fails a check.
        MeshingStopped: ``stopped`` was true.
    """
    return meshing.apart(_make_pieces, device, recipe_of(device, workshop), workshop, stopped=stopped)


@dataclasses.dataclass(frozen=True)
class _DrawnPiece:
    """One piece's mould once its model is closed.

    Attributes:
        folder: A STEP of each body, of ``cast``, and of each jig, core, cavity and plug by its number.
        counts: How many jigs, cores, cavities and plugs there are.
        differs: See `Mould`.
        taken, beyond: Volume of the block in no body, and of bodies not in the block, mm3.
        plug: Volume of the plugs, mm3.
    """

    tools: Tooling
    folder: Path
    counts: Mapping[str, int]
    differs: float
    taken: float
    beyond: float
    plug: float

    def file(self, name: str) -> Path:
        return self.folder / f"{name.replace(' ', '-')}.step"

    def surfaces(self, kind: str, chord: float) -> list[Facets]:
        """Return those of the jigs, cores, cavities or plugs, to a chord in mm."""
        return [facets.facets_of(self.file(f"{kind} {k}"), chord) for k in range(self.counts[kind])]


@dataclasses.dataclass(frozen=True)
class _Piece:
    """One piece's mould, measured; lengths in m, of the device's own size."""

    bodies: list[MouldBody]
    cast: MouldBody
    balance: float
    channel: float


def _make_pieces(device: Actuator, recipe: actuator.Recipe, workshop: settings.Workshop) -> Mould:
    with tempfile.TemporaryDirectory() as place:
        drawn, molten = list[_DrawnPiece](), list[_DrawnPiece]()
        for k, pour in enumerate(recipe.pours):  # all of them before any is measured, which takes most of the time
            drawn.append(_draw(device, recipe, pour, workshop, _new_folder(place, str(k))))
            if pour.lost and workshop.core == "wax":
                molten.append(_draw_wax(drawn[-1], workshop, _new_folder(place, f"{k} wax")))
        # Closed cavities are the same for all pieces: their points as the device lies.
        cavities = drawn[0].surfaces("cavity", MM_PER_M * workshop.chord)
        where = face_namer(device, drawn[0].tools.frame)
        channels = [check_core(cavity, math.nan, workshop, where) / workshop.scale for cavity in cavities]
        inside = np.concatenate([np.zeros((0, 3)), *(cavity.points for cavity in cavities)]) @ drawn[0].tools.frame.turn
        pieces = [_piece(device, drawn_piece, inside, workshop) for drawn_piece in drawn]
        waxes = [_piece(LostCore(drawn_piece.file("cast")), drawn_piece, np.zeros((0, 3)), workshop) for drawn_piece in molten]
        shrunk = workshop.scale**-3 / MM_PER_M**3
        plug, grooved = (
            sum(volumes) * shrunk
            for volumes in zip(*((drawn_piece.plug, drawn_piece.tools.grooved) for drawn_piece in drawn), strict=True)
        )
        casts = tuple(piece.cast for piece in pieces)
        silicone = min(
            thicknesses(cast.facets, _flanks(cast.facets, drawn_piece.tools))[0][0]
            for cast, drawn_piece in zip(casts, drawn, strict=True)
        )
        channels = [width for width in (*channels, *(piece.channel for piece in pieces)) if math.isfinite(width)]
        first = {drawn_piece.tools.pour.name.removesuffix(" core"): drawn_piece.tools.pour for drawn_piece in molten}
        pours = [pour for part in recipe.pours for pour in (first.get(part.name), part) if pour]
        return Mould(
            dataclasses.replace(recipe, pours=tuple(pours)),
            tuple(body for piece in (*waxes, *pieces) for body in piece.bodies), _extras(drawn, workshop), casts,
            tuple(piece.cast for piece in waxes), _bonded_step(drawn, Path(place)),
            max(drawn_piece.differs for drawn_piece in (*drawn, *molten)),
            max((piece.balance for piece in (*pieces, *waxes)), key=abs),
            sum(cast.facets.volume for cast in casts) * shrunk + plug + grooved, plug, grooved,
            next((drawn_piece.tools.wound for drawn_piece in drawn), None), silicone / MM_PER_M / workshop.scale,
            min(channels, default=math.nan), workshop.scale,
        )  # fmt: skip


def _new_folder(place: str, name: str) -> Path:
    folder = Path(place) / name
    folder.mkdir()
    return folder


def _draw_wax(drawn: _DrawnPiece, workshop: settings.Workshop, folder: Path) -> _DrawnPiece:
    """Make the mould in which a piece's lost core is cast of wax, with its peg."""
    tools, name = drawn.tools, f"{drawn.tools.pour.name} core"
    core = facets.facets_of(drawn.file(name), MM_PER_M * workshop.chord)
    with meshing.private_model():
        (solid,) = imported(drawn.file(name))
        box = np.reshape(gmsh.model.occ.getBoundingBox(*solid), (2, 3))
    middle = np.array([*box.mean(axis=0)[:2], tools.level])
    along = None if tools.pour.sideways is None else int(np.abs(tools.frame.turn @ tools.pour.sideways).argmax())
    peg = float(core.points[:, 2].min())
    parting = next((axis for axis in (along, 2, 1, 0) if axis is not None and _parts_sideways(core, axis, middle[axis])), None)
    if parting is None:
        raise settings.MouldError(f"the {name} does not leave a mould in two halves in any direction; print it (--core lost)")
    pour = actuator.Pour(
        name=name, up=(0.0, 0.0, 1.0), level=peg / MM_PER_M, lid=False, wax=True, vented=tools.level / MM_PER_M,
        floor=tools.level / MM_PER_M if parting == 2 else None,
        sideways=None if parting == 2 else triple(np.eye(3)[parting]),
    )  # fmt: skip
    own = dataclasses.replace(workshop, shrinkage=workshop.wax_shrinkage)
    return _draw(LostCore(drawn.file(name)), actuator.Recipe(pours=(pour,), why=""), pour, own, folder)


def _parts_sideways(core: Facets, axis: int, level: float) -> bool:
    """Return whether nothing of a core hangs over in a mould of two halves that part along an axis at a level, mm."""
    beyond = core.corners[:, :, axis] - level
    lean = core.normals[:, :, axis] * np.sign(beyond)
    return float(lean[np.abs(beyond) > FLUSH_TOLERANCE].min()) > -UNDERCUT_TOLERANCE


def _extras(drawn: Sequence[_DrawnPiece], workshop: settings.Workshop) -> tuple[MouldBody, ...]:
    """Return the jig and the coupon."""
    chord, folder = MM_PER_M * workshop.chord, drawn[0].folder
    with meshing.private_model():
        own = _DrawnPiece(drawn[0].tools, folder, {}, 0.0, 0.0, 0.0, 0.0)
        _write_steps(facets.coupon_solids(workshop), own)
    files = {"bonding jig": drawn[0].file("jig 0")} if drawn[0].counts["jig"] else {}
    files |= {name: own.file(name) for name in ("coupon", "coupon pin")}
    extras = [MouldBody(name, "", file.read_bytes(), facets.facets_of(file, chord), (0.0, 0.0, 0.0), None)
             for name, file in files.items()]  # fmt: skip
    if leaks := [body.name for body in extras if body.facets.open_edges]:
        raise MeshingError(f"the {leaks[0]} is not watertight; change a length slightly")
    return tuple(extras)


def _draw(
    device: actuator.Castable, recipe: actuator.Recipe, pour: actuator.Pour, workshop: settings.Workshop, folder: Path
) -> _DrawnPiece:
    """Make the mould of one piece, compare its void with the piece, and write its STEP files; `MeshingError` if the mould
    leaves something else than the device."""
    with meshing.private_model():
        tools = tooling(device, recipe, pour, workshop)
        void = left(tools)
        differs = _difference(void, tools.target, tools.size)
        if differs > VOLUME_TOLERANCE or len(void) != 1:
            raise MeshingError(
                f"the cast differs from the device (volumes or moments by {differs:.2g}); change a length slightly"
            )
        if len(recipe.pours) == 1:
            gmsh.model.occ.remove([tools.jig], recursive=True)
        several = {
            "jig": [tools.jig] if len(recipe.pours) > 1 and pour == recipe.pours[0] else [],
            "core": tools.cores,
            "cavity": tools.cavities,
            "plug": tools.plugs,
        }
        named = {body.name: body.solid for body in tools.bodies} | {"cast": void[0]}
        named |= {f"{kind} {k}": solid for kind, solids in several.items() for k, solid in enumerate(solids)}
        plug = sum(gmsh.model.occ.getMass(*solid) for solid in tools.plugs)
        drawn_piece = _DrawnPiece(tools, folder, {kind: len(solids) for kind, solids in several.items()}, differs,
                       *_block_volumes(tools), plug)  # fmt: skip
        _write_steps(named, drawn_piece)
    return drawn_piece


def _piece(device: Actuator | LostCore, drawn: _DrawnPiece, inside: Array, workshop: settings.Workshop) -> _Piece:
    """Measure and check the mould of one piece; ``inside`` are points of closed cavities, shape (n, 3), mm."""
    tools, chord = drawn.tools, MM_PER_M * workshop.chord
    named = {body.name: facets.facets_of(drawn.file(body.name), chord) for body in tools.bodies}
    surfaces = Surfaces(tools, named, facets.facets_of(drawn.file("cast"), CAST_CHORD))
    where = face_namer(device, tools.frame)
    checks = {name: check_body(name, surfaces, workshop, where) for name in named}
    overlap = overlaps(surfaces)
    rest = balance(drawn, surfaces)
    if abs(rest) > VOLUME_TOLERANCE:
        raise MeshingError(
            f"bodies, openings and cast do not fill the mould ({rest:.2g} of it are left); change a length slightly"
        )
    bodies = [
        MouldBody(body.name, tools.pour.name, drawn.file(body.name).read_bytes(), named[body.name], triple(body.pull),
                  dataclasses.replace(checks[body.name], overlap=overlap[body.name] / MM_PER_M))
        for body in tools.bodies
    ]  # fmt: skip
    cores = [] if len(inside) else drawn.surfaces("core", chord)
    widths = [check_core(core, tools.level, workshop, where) for core in cores]
    heights = np.concatenate([inside @ tools.frame.turn[2], *(core.points[:, 2] for core in cores)])
    highest = float(heights[heights < tools.top + FLUSH_TOLERANCE].max(initial=tools.level))
    beyond = (float(surfaces.cast.points[:, 2].max()) - highest) / MM_PER_M / workshop.scale
    cast = MouldBody(f"{tools.pour.name} cast", tools.pour.name, drawn.file("cast").read_bytes(), surfaces.cast,
                     (0.0, 0.0, 0.0), None, beyond)  # fmt: skip
    return _Piece(bodies, cast, rest, min(widths, default=math.nan) / workshop.scale)


CAST_CHORD = 0.05
"""Chord error in mm of the casts."""


def _difference(solid_list: list[Solid], other: list[Solid], size: float) -> float:
    """Return how far two bodies differ in volume, centre and moments of inertia, as shares of the volume and of the size.

    Not the volume of what is left of one without the other: the CAD kernel fails on bodies whose faces all coincide.
    """
    occ, differences = gmsh.model.occ, []
    for solids in (solid_list, other):
        mass = np.array([occ.getMass(*solid) for solid in solids])
        centre = np.array([occ.getCenterOfMass(*solid) for solid in solids])
        inertia = np.array([occ.getMatrixOfInertia(*solid) for solid in solids])
        differences.append((mass.sum(), mass @ centre, inertia.sum(axis=0)))
    whole = differences[1][0]
    return max(
        float(np.abs(np.asarray(a) - b).max()) / (whole * size**k) for k, (a, b) in enumerate(zip(*differences, strict=True))
    )


def _bonded_step(pieces: Sequence[_DrawnPiece], folder: Path) -> bytes:
    """Return the STEP of the pieces merged, with the tube's hole filled, in the device's own size and place."""
    file = folder / "device.step"
    with meshing.private_model():
        parts: list[Solid] = []
        for piece in pieces:
            for name in ("cast", *(f"plug {k}" for k in range(piece.counts["plug"]))):
                solids = imported(piece.file(name))
                turned(solids, piece.tools.frame.turn.T)
                parts += solids
        parts = merged(parts, unify=False)
        if len(parts) != 1:
            raise MeshingError("the CAD kernel cannot merge the pieces; change a length slightly")
        scaled(1.0 / pieces[0].tools.frame.scale)
        gmsh.model.occ.synchronize()
        meshing.write_step(file)
    return file.read_bytes()


def _write_steps(named: Mapping[str, Solid], drawn: _DrawnPiece) -> None:
    """Write each of some solids of the current Gmsh model into a file of its own."""
    gmsh.model.occ.synchronize()
    gmsh.option.setNumber("Geometry.OCCExportOnlyVisible", 1)
    gmsh.model.setVisibility(gmsh.model.getEntities(), 0)
    for name, solid in named.items():
        gmsh.model.setVisibility([solid], 1, recursive=True)
        meshing.write_step(drawn.file(name))
        gmsh.model.setVisibility([solid], 0, recursive=True)
    gmsh.option.setNumber("Geometry.OCCExportOnlyVisible", 0)


@dataclasses.dataclass(frozen=True)
class MouldBody:
    """A body of a mould, or what is cast in it, with its STEP file and its surface in mm.

    Attributes:
        name, piece: ``"upper cup"``, ``"lower lid"``, ``"upper cast"`` and so on, and the piece that it belongs to.
        pull: Unit vector along which it leaves; zero of what is cast, and of what is dissolved.
        checked: What was found of it; None of what is cast.
        beyond: Of what is cast: silicone between its core and the cup along z, m; NaN of bodies.
    """

    name: str
    piece: str
    step: bytes
    facets: Facets
    pull: tuple[float, float, float]
    checked: BodyChecks | None
    beyond: float = math.nan

    @property
    def stem(self) -> str:
        """Name of its files."""
        return self.name.replace(" ", "-")


# ----------------------------------------------------------------------------------------------------------------------
# Checks of every body of a mould before anything is written.


UNDERCUT_TOLERANCE = math.sin(math.radians(0.1))
"""Sine of the allowed undercut: 0.1 degrees, 2 um on a wall of 1 mm."""
MAX_FACING_COSINE = -0.8
"""Cosine between the normals of two faces below which they are two sides of a wall instead of an edge."""
MOST_RAYS = 20_000
FACE_SAMPLES = 12
"""Triangles of a face that tell whether it forms the piece."""
VOLUME_TOLERANCE = 1e-6
"""Largest difference between the device and its cast, relative to the device's volume."""
COLLISION_DISTANCES = (0.01, 0.1, 0.4, 1.0)
"""How far a body moves along its pull when collisions are looked for, in heights of the mould."""
MOST_SLENDER, MOST_SLENDER_UPRIGHT = 10.0, 5.0
"""Depth over thickness up to which a fin of printed resin comes out whole, with and without draft."""
LEAST_DRAFT = 0.5
"""Mean draft of a fin's flanks in degrees below which it counts as without."""
FIN_RAYS = 6_000
"""Places about at which a body's fins are measured."""
Name = Callable[[Array], str]
"""Names the face of the part at a place in the mould (mm): a clause."""


@dataclasses.dataclass(frozen=True)
class Fin:
    """A thin piece of a body, which stands in the silicone between two faces that form the part, or a rod within one.

    Attributes:
        thickness, depth: Means over the fin, the depth along the pull, m.
        length: Largest extent across pull and thickness, m.
        draft: Mean angle of its flanks from the pull, degrees.
        rod: Whether one face surrounds it.
        place: Its middle, mm.
        alike: How many of the body are like it.
        where: The part's face there, a clause; empty unless it is `slender`.
    """

    thickness: float
    depth: float
    length: float
    draft: float
    rod: bool
    place: Array
    alike: int = 1
    where: str = ""

    @property
    def allowed(self) -> float:
        """Largest depth over thickness that comes out whole."""
        return MOST_SLENDER if self.rod or self.draft >= LEAST_DRAFT else MOST_SLENDER_UPRIGHT

    @property
    def slenderness(self) -> float:
        """Depth over thickness."""
        return self.depth / self.thickness

    @property
    def slender(self) -> bool:
        """Whether it bends or breaks as the silicone is pulled off; a hundredth is left to the measurement."""
        return self.slenderness > 1.01 * self.allowed

    def told(self, body: str, scale: float) -> str:
        """Return a sentence with the numbers and the remedy; ``scale`` is length in the mould over length in the device."""
        kind, hole = ("rod", "hole") if self.rod else ("fin", "gap")
        many = f"{self.alike} {kind}s" if self.alike > 1 else f"a {kind}"
        draft = "without draft" if self.draft < 0.05 else f"with a draft of {self.draft:.2g} deg"
        length = "" if self.rod else f" and {settings.length_text(self.length)} long"
        wide, drafted = (schema.shown(_rounded_up(self.depth / limit / scale), "m") for limit in (self.allowed, MOST_SLENDER))
        drafted = "" if drafted == wide else f" ({drafted} with a draft of {LEAST_DRAFT:g} deg)"
        return (
            f"the {body} has {many} {settings.length_text(self.thickness)} thick, {settings.length_text(self.depth)} "
            f"deep{length} {draft} ({self.where}): {self.slenderness:.3g} times as deep as thick, more than {self.allowed:g}, "
            f"so it may bend or break as the silicone comes off; make the part's {hole} there at least {wide} wide{drafted}, "
            f"or at most {settings.length_text(self.allowed * self.thickness / scale)} deep"
        )


def _rounded_up(value: float) -> float:
    """Return a length in m rounded up to a tenth of a millimetre."""
    return math.ceil(1e4 * value - 0.1) / 1e4


@dataclasses.dataclass(frozen=True)
class BodyChecks:
    """Check results of one body.

    Attributes:
        lean: Least angle in degrees between the pull and the faces that form the part: 0 for an upright wall.
        own_lean: The same of pins, sockets and holes; NaN without any.
        wall, gap: Smallest thickness of the body, and smallest width of its grooves and holes, m.
        chord: Largest distance of the STL from the exact body, m.
        volume_gap: STL's volume over the exact one, less 1.
        overlap: Thickness of what it has in common with other bodies, and with these and the cast on its way out, by the
            triangles, m: the error of the STL at most.
        fins: Its fins, one of those alike, the most slender first.
    """

    lean: float
    own_lean: float
    wall: float
    gap: float
    chord: float
    volume_gap: float
    overlap: float
    fins: tuple[Fin, ...]


@dataclasses.dataclass(frozen=True)
class Surfaces:
    """The triangles of one piece's mould: those of the bodies by name, in the order in which they leave, and of the cast."""

    made: Tooling
    bodies: Mapping[str, Facets]
    cast: Facets


def check_body(name: str, surfaces: Surfaces, workshop: settings.Workshop, named: Name) -> BodyChecks:
    """Check a body: `MouldError` for an undercut, or a wall or gap too fine for the printer, `MeshingError` if it is not
    watertight, or its STL strays."""
    facets = surfaces.bodies[name]
    if facets.open_edges:
        raise MeshingError(f"the {name} is not watertight ({facets.open_edges} open edges); change a length slightly")
    lean, own = _least_draft(name, surfaces, workshop, named)
    wall, gap = thicknesses(facets, _flanks(facets, surfaces.made))
    allowed = 2.0 * facets.chord
    for what, (value, place), limit, field in (
        ("thin", wall, workshop.least_wall, "least_wall"), ("wide", gap, workshop.least_gap, "least_gap"),
    ):  # fmt: skip
        if value + allowed < MM_PER_M * limit:
            raise settings.MouldError(
                f"the {name} is {settings.length_text(value / MM_PER_M)} {what} {named(place)}; the printer's "
                f"smallest {'wall' if what == 'thin' else 'gap'} is {schema.shown(limit, 'm')} ({field})"
            )
    bound = facets.chord * _area(facets) / facets.volume
    differs = facets.polyhedron_volume / facets.volume - 1.0
    if abs(differs) > bound + VOLUME_TOLERANCE:
        raise MeshingError(f"the STL of the {name} differs from its STEP by {differs:.2g} of the volume; use a smaller chord")
    angles = np.degrees(np.arcsin(np.clip([lean, own], -1.0, 1.0)))
    fins = tuple(dataclasses.replace(fin, where=named(fin.place)) if fin.slender else fin for fin in _fins(name, surfaces))
    return BodyChecks(
        float(angles[0]), float(angles[1]), wall[0] / MM_PER_M, gap[0] / MM_PER_M,
        facets.chord / MM_PER_M, differs, math.nan, fins,
    )  # fmt: skip


def _fins(name: str, surfaces: Surfaces) -> list[Fin]:
    """Return the fins of a body: where a ray into it from a face that forms the part leaves through another one, by the pairs
    of these faces; one of those alike, the most slender first."""
    facets = surfaces.bodies[name]
    pull = next(body.pull for body in surfaces.made.bodies if body.name == name)
    if not pull.any():
        return []
    formed = _forming_faces(facets, surfaces.cast) & ~_release_faces(facets, surfaces.made)
    corners, normals = facets.corners, _flat_normals(facets)
    pieces, own, areas = _spread(corners, formed & np.any(normals, axis=1))
    pairs: dict[tuple[int, int], list[tuple[int, float]]] = {}
    cast_ray = _ray_caster(facets)
    for k, (place, triangle) in enumerate(zip(pieces.mean(axis=1), own, strict=True)):
        step = -normals[triangle]
        cell, distance = cast_ray(place, step)
        if cell >= 0 and formed[cell] and normals[triangle] @ normals[cell] < MAX_FACING_COSINE:
            a, b = sorted((int(facets.face[triangle]), int(facets.face[cell])))
            pairs.setdefault((a, b), []).append((k, distance))
    fins: list[Fin] = []
    for (a, b), hits in pairs.items():
        chosen = np.array([k for k, _ in hits])
        fin = _fin(pieces[chosen], normals[own[chosen]], areas[chosen], np.array([d for _, d in hits]), pull, rod=a == b)
        if fin is None:
            continue
        twin = next((k for k, other in enumerate(fins) if _same_fin(fin, other)), None)
        if twin is None:
            fins.append(fin)
        else:
            fins[twin] = dataclasses.replace(fins[twin], alike=fins[twin].alike + 1)
    return sorted(fins, key=lambda fin: -fin.slenderness)


def _fin(pieces: Array, normals: Array, areas: Array, thicknesses: Array, pull: Array, rod: bool) -> Fin | None:
    """Return the fin between two faces by small triangles on both in mm, their normals, areas and thicknesses; None where it
    lies across the pull, as a floor does, or is thicker than deep."""
    weights = areas / areas.sum()
    across = np.linalg.eigh((normals * weights[:, None]).T @ normals)[1][:, 2]
    across = across - (across @ pull) * pull
    if np.linalg.norm(across) < 0.7:
        return None
    along = np.cross(across / np.linalg.norm(across), pull)
    length = float(np.ptp(pieces @ along))
    depth = float(np.ptp(pieces @ pull)) if rod else 0.5 * float(areas.sum()) / length
    draft = math.degrees(math.asin(float(np.clip(-weights @ normals @ pull, 0.0, 1.0))))
    fin = Fin(
        float(weights @ thicknesses) / MM_PER_M, depth / MM_PER_M, length / MM_PER_M, draft, rod, weights @ pieces.mean(axis=1)
    )
    return fin if fin.slenderness >= 1.0 else None


def _same_fin(fin: Fin, other: Fin) -> bool:
    """Return whether two fins have the same lengths within 5 %, and the same draft."""
    pairs = [(fin.thickness, other.thickness), (fin.depth, other.depth), (fin.length, other.length)]
    same = all(abs(a - b) < 0.05 * max(a, b) for a, b in pairs)
    return same and fin.rod == other.rod and abs(fin.draft - other.draft) < 0.1


def _flat_normals(facets: Facets) -> Array:
    """Return the unit normals of the flat triangles, shape (n, 3); zero for those without area."""
    corners = facets.corners
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(flat, axis=1)
    flat[areas <= 1e-12] = 0.0
    return flat / np.maximum(areas, 1e-12)[:, None]


def _spread(corners: Array, chosen: npt.NDArray[np.bool_]) -> tuple[Array, facets.Cells, Array]:
    """Return the corners of about `FIN_RAYS` small triangles spread evenly over chosen ones, shape (n, 3, 3), the large one of
    each, and the area it stands for."""
    a, b, c = np.moveaxis(corners, 1, 0)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1) * chosen
    longest = np.linalg.norm([b - a, c - b, a - c], axis=2).max(axis=0)
    step = 2.0 * math.sqrt(float(area.sum()) / FIN_RAYS)
    small = np.flatnonzero((area > 0.0) & (longest <= step))
    pieces, own = [corners[small]], [small]
    for k in np.flatnonzero((area > 0.0) & (longest > step)):
        n = int(np.ceil(longest[k] / step))
        grid = np.indices((n, n)).reshape(2, -1).T
        lower, other = grid[grid.sum(axis=1) < n], grid[grid.sum(axis=1) < n - 1]
        shares = np.vstack([lower[:, None] + [(0, 0), (1, 0), (0, 1)], other[:, None] + [(1, 0), (1, 1), (0, 1)]]) / n
        pieces.append(a[k] + shares[..., :1] * (b[k] - a[k]) + shares[..., 1:] * (c[k] - a[k]))
        own.append(np.full(len(shares), k))
    every = max(1, sum(map(len, own)) // (2 * FIN_RAYS))
    triangle = np.concatenate(own)
    areas = every * area[triangle] / np.bincount(triangle, minlength=len(area))[triangle]
    return np.vstack(pieces)[::every], triangle[::every], areas[::every]


def _flanks(facets: Facets, made: Tooling) -> npt.NDArray[np.bool_] | None:
    """Return which triangles are on the flanks of grooves for threads, whose widths `winding` checks; None without any."""
    if made.wound is None:
        return None
    near, scale = 1e-3, MM_PER_M * made.frame.scale
    outer, inner = scale * made.wound.radius, scale * (made.wound.radius - made.wound.depth)
    radius = np.linalg.norm(facets.corners[:, :, :2], axis=2)
    between = ((radius > inner - near) & (radius < outer + near)).all(axis=1)
    on_one = [(np.abs(radius - cylinder) < near).all(axis=1) for cylinder in (outer, inner)]
    return np.asarray(between & ~on_one[0] & ~on_one[1])


def check_core(facets: Facets, foot: float, workshop: settings.Workshop, named: Name) -> float:
    """Return the smallest width in m of a core of the cavity; `MouldError` if that is too fine for the printer. ``foot`` is
    the height in mm of the plane in which it stands on a lid: that face is inside of a body."""
    (width, place), _ = thicknesses(facets, np.abs(facets.corners[:, :, 2] - foot).max(axis=1) < 1e-4)
    if width + 2.0 * facets.chord < MM_PER_M * workshop.least_wall:
        raise settings.MouldError(
            f"a channel is {settings.length_text(width / MM_PER_M)} wide {named(place)}; the "
            f"printer's smallest rib is {schema.shown(workshop.least_wall, 'm')} (least_wall)"
        )
    return width / MM_PER_M


def _area(facets: Facets) -> float:
    a, b, c = np.moveaxis(facets.corners, 1, 0)
    return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _least_draft(name: str, surfaces: Surfaces, workshop: settings.Workshop, named: Name) -> tuple[float, float]:
    """Return the least sine of the lean of the part's faces along the body's pull, and of the pins and holes along theirs;
    `MouldError` for a face that hangs over, `MeshingError` for a pin, a socket or a hole with less than the draft."""
    facets, made = surfaces.bodies[name], surfaces.made
    pull = next(body.pull for body in made.bodies if body.name == name)
    if not pull.any():
        return 1.0, math.nan
    lean = -facets.normals @ pull
    own, formed = _release_faces(facets, made), _forming_faces(facets, surfaces.cast)
    least_own = float(np.abs(facets.normals[own, :, 2]).min(initial=1.0)) if own.any() else math.nan
    if least_own < math.sin(math.radians(workshop.draft)) - 1e-4:
        raise MeshingError(f"the pins and holes of the {name} have too little draft; please report this with the parameters")
    formed &= ~own
    worst = float(lean[formed].min(initial=1.0))
    if worst < -UNDERCUT_TOLERANCE:
        at = facets.corners[formed][np.unravel_index(lean[formed].argmin(), lean[formed].shape)[0]].mean(axis=0)
        lost = ", let its core be lost (--core lost)" if name.endswith("lid") else ""
        raise settings.MouldError(
            f"the {name} cannot be demoulded: it is undercut by {math.degrees(math.asin(min(1.0, -worst))):.3g} deg "
            f"{named(at)}; choose another direction (--pull) or plane (--split){lost}, or change the part"
        )
    return worst, least_own


def _release_faces(facets: Facets, made: Tooling) -> npt.NDArray[np.bool_]:
    """Return which triangles are on pins, sockets and holes along the pull, without their ends."""
    steep = np.abs(facets.normals[:, :, 2]).max(axis=1) < 0.9
    inside = np.zeros(len(steep), dtype=bool)
    x, y, z = np.moveaxis(facets.corners, 2, 0)
    for hole in made.drafted:
        low, high = hole.heights
        near = np.hypot(x - hole.place[0], y - hole.place[1]) < hole.mouth + 1e-3
        inside |= (near & (z > low - 1e-3) & (z < high + 1e-3)).all(axis=1)
    return inside & steep


def _forming_faces(facets: Facets, formed_by: Facets) -> npt.NDArray[np.bool_]:
    """Return which triangles are on faces that form the cast: most of each lies on it."""
    locator = _locator(formed_by)
    near = facets.chord + formed_by.chord + 1e-3
    middles = facets.corners.mean(axis=1)
    formed = np.zeros(len(middles), dtype=bool)
    closest = [0.0] * 3
    part, cell, off = cast(int, _mutable(0)), cast(int, _mutable(0)), _mutable(0.0)
    for face in np.unique(facets.face):
        own = np.flatnonzero(facets.face == face)
        tried = own[np.linspace(0, len(own) - 1, min(len(own), FACE_SAMPLES)).astype(int)]
        hits = 0
        for k in tried:
            locator.FindClosestPoint(list(middles[k]), closest, cell, part, off)
            hits += float(off) < near**2
        formed[own] = 2 * hits > len(tried)
    return formed


def _mutable(value: float) -> float:
    """Return a number that VTK writes into, whatever its types say."""
    from vtkmodules.vtkCommonCore import mutable

    return cast(float, mutable(value))


def _locator(facets: Facets) -> vtkStaticCellLocator:
    """Return what finds the triangles of a surface."""
    from pyvista import PolyData
    from vtkmodules.vtkCommonDataModel import vtkStaticCellLocator

    locator = vtkStaticCellLocator()
    locator.SetDataSet(PolyData.from_regular_faces(np.array(facets.points), np.array(facets.triangles)))
    locator.BuildLocator()
    return locator


def thicknesses(
    facets: Facets, without: npt.NDArray[np.bool_] | None = None
) -> tuple[tuple[float, Array], tuple[float, Array]]:
    """Return the smallest wall and smallest gap of a body in mm, each with its place, measured along the normal to the
    other side; triangles of ``without``, a mask, are no sides."""
    cast_ray = _ray_caster(facets)
    corners, flat = facets.corners, _flat_normals(facets)
    skipped = np.zeros(len(flat), dtype=bool) if without is None else without
    chosen = np.flatnonzero(np.any(flat, axis=1) & ~skipped)
    if len(chosen) > MOST_RAYS:
        chosen = chosen[np.linspace(0, len(chosen) - 1, MOST_RAYS).astype(int)]
    lengths = []
    for way in (-1.0, 1.0):
        best, place = math.inf, np.zeros(3)
        for k in chosen:
            begin = corners[k].mean(axis=0)
            cell, distance = cast_ray(begin, way * flat[k])
            if cell < 0 or skipped[cell]:
                continue
            if flat[k] @ flat[cell] < MAX_FACING_COSINE and distance < best:
                best, place = distance, begin
        lengths.append((best, place))
    return lengths[0], lengths[1]


def _ray_caster(facets: Facets) -> Callable[[Array, Array], tuple[int, float]]:
    """Return what finds the triangle that a ray from a place on one along a unit vector meets, -1 for none, and how far."""
    locator, far = _locator(facets), float(np.linalg.norm(np.ptp(facets.points, axis=0)))
    hit, local = [0.0] * 3, [0.0] * 3
    t, part, cell = _mutable(0.0), cast(int, _mutable(0)), cast(int, _mutable(0))

    def cast_ray(begin: Array, way: Array) -> tuple[int, float]:
        ends = list(begin + 1e-4 * way), list(begin + far * way)
        if not locator.IntersectWithLine(*ends, 0.0, t, hit, local, part, cell):
            return -1, math.inf
        return int(cell), float(np.linalg.norm(hit - begin))

    return cast_ray


# ----------------------------------------------------------------------------------------------------------------------
# Bodies against each other, by two routes: the CAD kernel's exact faces, and the triangles of the files.


def manifold_of(facets: Facets) -> Manifold:
    """Return the polyhedron of a surface."""
    return mesh_arrays.manifold(facets.points, facets.triangles)


def common_thickness(manifold: Manifold, other: Manifold) -> float:
    """Return the thickness in mm of the thickest piece that two polyhedra have in common: its volume over half its area."""
    pieces = (manifold ^ other).decompose()
    return max((2.0 * piece.volume() / piece.surface_area() for piece in pieces if piece.surface_area() > 0.0), default=0.0)


def overlaps(surfaces: Surfaces) -> dict[str, float]:
    """Return for each body how thick its overlap is with others in place, and with others and the cast on its way out, mm; an
    error if that is more than the triangles' distance from the exact faces."""
    from manifold3d import Manifold, OpType

    made, solids = surfaces.made, {name: manifold_of(facets) for name, facets in surfaces.bodies.items()}
    piece = manifold_of(surfaces.cast)
    allowed = surfaces.cast.chord + max(facets.chord for facets in surfaces.bodies.values()) + 1e-6
    height, worst = float(made.high[2] - made.low[2]), {}
    for k, body in enumerate(made.bodies):
        others = [other for other in made.bodies[k + 1 :] if body.pull.any() or other.pull.any()]
        kept = [other for other in made.bodies[:k] if not other.pull.any()]
        rest = Manifold.batch_boolean([piece, *(solids[other.name] for other in (*others, *kept))], OpType.Add)
        ways = (0.0, *(way * height for way in COLLISION_DISTANCES)) if body.pull.any() else (0.0,)
        worst[body.name] = max(common_thickness(solids[body.name].translate(tuple(way * body.pull)), rest) for way in ways)
        if worst[body.name] > allowed:
            raise settings.MouldError(
                f"the {body.name} cannot be demoulded: on its way out it is {schema.shown(worst[body.name] / MM_PER_M, 'm')} "
                "deep in the part or another body; choose another direction (--pull), or change the part"
            )
    return worst


def _block_volumes(made: Tooling) -> tuple[float, float]:
    """Return the volume of the block that is in no body, and that of bodies outside of the block, in mm3, by the CAD kernel."""
    occ = gmsh.model.occ
    solids, low, high = [body.solid for body in made.bodies], made.low, made.high
    slack = occ.cut(occ.copy(made.openings), solids, removeTool=False)[0] if made.openings else []
    box = (3, occ.addBox(*low, *(high - low)))
    inside = sum(occ.getMass(*solid) for solid in occ.intersect(slack, [box], removeTool=False)[0]) if slack else 0.0
    boxes = {solid: np.reshape(occ.getBoundingBox(*solid), (2, 3)) for solid in solids}
    outer = [solid for solid, box in boxes.items() if (box[0] <= low - 1e-3).any() or (box[1] >= high + 1e-3).any()]
    beyond = sum(occ.getMass(*solid) for solid in occ.cut(occ.copy(outer), [box])[0]) if outer else 0.0
    return inside + sum(occ.getMass(*solid) for solid in made.target), beyond


def balance(drawn: _DrawnPiece, surfaces: Surfaces) -> float:
    """Return what the block has more than bodies, openings and the piece, as a share of the block.

    The bodies' volumes are integrals over their faces as meshed from the STEP files, the others are the CAD kernel's.
    """
    block = float(np.prod(surfaces.made.high - surfaces.made.low))
    bodies = sum(facets.volume for facets in surfaces.bodies.values())
    return (block - (bodies - drawn.beyond) - drawn.taken) / block
