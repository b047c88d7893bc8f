"""A plate of any outline with a network of round channels in it, drawn, of a family, or written.

The plate lies between z = -thickness/2 and thickness/2. Its outline and the channels' centre lines are given in the plane
(x, y); all channels lie `offset` above the middle of the thickness unless one says otherwise. Where channels of one cavity
cross they are joined, and the crease is rounded.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import itertools
import math
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from geometries import actuator, faces, mesh_arrays, meshing, network, registry, revolved, slices
from geometries.actuator import Hold, Vector
from geometries.network import Channel, Network, Nodes, Place
from softmodels.common import errors, schema, units
from softmodels.common.arrays import Array
from softmodels.common.errors import GeometryError
from softmodels.common.lazy import gmsh, scipy


@registry.register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class ChannelPlate(actuator.Actuator):
    """A plate with a network of round air channels: drawn (SVG, DXF), of a family ("radial:8"), or written as texts.

    Physical groups: volume "solid"; surfaces "cavity", "cavity2", ... (the walls of the channels, a cavity for each colour or
    layer), "support", "top", "bottom" and "edge", the cut planes "plane0" and "plane1" of a half or a wedge. Lengths are in m.
    """

    network: str = schema.text_field(
        "", f"a drawing (.svg, .dxf), or a family and its number, such as radial:8; families: {', '.join(network.FAMILIES)}"
    )
    channels: tuple[str, ...] = schema.list_field(
        (), "further channels, such as '0, 0 to 20, 5 to 30, 5 mm radius 0.8 to 0.5 mm offset -1 mm in left'"
    )
    outline: str = schema.text_field(
        "", "outline of the plate: 'rectangle 40 x 15 mm' (from x = 0), 'circle 40 mm' (diameter), or corners such as "
        "'0, 0, 50, -10, 50, 10 mm'; if not given, the drawing's, else the rectangle above"
    )  # fmt: skip
    node_x: tuple[float, ...] = schema.places_field(
        "x of each node of the network in place of the drawn one; nodes are the ends and "
        "corners of its channels, in the order that draw-network prints"
    )
    node_y: tuple[float, ...] = schema.places_field("y of each node")
    node_offsets: tuple[float, ...] = schema.places_field("height of each node above the middle of the thickness")
    start_radii: tuple[float, ...] = schema.lengths_field("radius of each channel where it begins, in place of the drawn one")
    end_radii: tuple[float, ...] = schema.lengths_field("radius of each channel where it ends")
    scale_x: float = schema.number_field(1.0, "factor on all x of the outline; the channels stay")
    scale_y: float = schema.number_field(1.0, "factor on all y of the outline")
    width: float = schema.length_field(0.0, "width along x of the drawing's outline; 0: as drawn", zero=True)
    thickness: float = schema.length_field(0.006, "thickness of the plate")
    radius: float = schema.length_field(0.0013, "radius of channels that give none")
    offset: float = schema.length_field(
        -0.0005, "height of the channels' plane above the middle of the thickness", zero=True, signed=True
    )
    fillet: float = schema.length_field(
        0.0004, "radius of the rounding where channels meet and turn; 0 for sharp creases", zero=True
    )
    edge: float = schema.length_field(0.0015, "solid between a family's channels and the outline")
    support: str = schema.text_field(
        "x = 0 mm", "what is held: bottom, top, edge, or sides such as 'x = 0 mm' or 'in 0..10, -5..5, 0..0 mm'; free: three "
        "corners hold the plate against rigid motion only"
    )  # fmt: skip
    gauge_point: str = schema.text_field(
        "", "place on the top whose rise is reported, such as 'at 20, 0 mm'; middle for a held edge or a free plate, else the "
        "point of the outline that is farthest from the support"
    )  # fmt: skip
    pressure_ratios: tuple[float, ...] = schema.list_field(
        (), "pressure in each cavity over the requested one; all 1 if not given", numbers=True, shape=False
    )
    least_wall: float = schema.length_field(
        0.0005, "minimum solid between channels, and between them and the plate's faces", shape=False
    )
    cell_size: float = schema.length_field(0.0025, "edge length of the cells far from the channels", shape=False)
    around: float = schema.number_field(10.0, "cells around the narrowest channel's section", shape=False)
    symmetry: str = schema.choice_field(
        "auto", ("auto", "none"), "auto: only a half or a wedge is meshed where drawing and support are their own mirror "
        "image on lines through x = y = 0; none: the whole plate"
    )  # fmt: skip

    stem: ClassVar = "plate"
    pressures: ClassVar = "0:100"
    silicone: ClassVar = "ecoflex-00-30"
    unbonded: ClassVar = ()
    stiffer: ClassVar = "narrower channels (--radius), a thicker plate (--thickness)"
    examples: ClassVar = (
        "--network leaf.svg",
        "--network radial:8 --outline 'circle 40 mm' --support free",
        "--channels '5, 0 to 40, 0 mm radius 1.5 to 0.8 mm'",
    )

    def check(self) -> None:
        if file := self.files.get("network"):
            object.__setattr__(self, "network", errors.whole_path(file))
        for name in ("scale_x", "scale_y"):
            if not 1.0 / MAX_SCALE <= getattr(self, name) <= MAX_SCALE:
                self.reject(name, f"it must be from {1.0 / MAX_SCALE:g} to {MAX_SCALE:g}")
        if len(self.ratios) != len(self.drawn.cavities):
            count = len(self.drawn.cavities)
            raise GeometryError(f"pressure_ratios has {len(self.pressure_ratios)} values for {count} cavities; give one each")
        if not any(self.ratios):
            raise GeometryError("pressure_ratios are all 0; give one other than 0, below it for a vacuum")
        low, high = self.box
        self.check_size("outline", *(high - low).tolist())
        if self.fillet > self.least_wall:
            self.reject("fillet", f"it must be at most {self.told('least_wall')}, or it would fill walls")
        if not 6.0 <= self.around <= 40.0:
            self.reject("around", "it must be from 6 to 40")
        samples = network.Samples.of(self.drawn.channels)
        network.check_plate(self.drawn.channels, samples, self.thickness, self.least_wall)
        network.check_outline(self.drawn.channels, samples, self.paths, self.least_wall)
        network.check_walls(self.drawn.channels, samples, self.least_wall)
        _ = self.holds, self.probes
        self.check_count()

    @property
    def files(self) -> Mapping[str, str]:
        return {"network": self.network} if Path(self.network).suffix.lower() in faces.DRAWINGS else {}

    @property
    def key(self) -> str:
        """Twelve digits that change with the parameters and the drawing's contents."""
        return hashlib.sha256(f"{super().key} {self.digest()}".encode()).hexdigest()[:12]

    @property
    def drawn(self) -> Network:
        """The network, with the outline of the plate."""
        return _drawn(self, self.digest())

    @property
    def nodes(self) -> Nodes:
        """The network's nodes where they were drawn."""
        return _nodes(self, self.digest())

    def entries(self, field: str) -> tuple[float, ...]:
        """Return a list's values, of nodes and radii that are not given those drawn."""
        if given := getattr(self, field):
            return tuple(given)
        if field in NODE_LISTS:
            return tuple(self.nodes.places[:, NODE_LISTS.index(field)].tolist())
        if field in RADIUS_LISTS:
            end = -RADIUS_LISTS.index(field)
            return tuple(each.radii[end] for each in _as_drawn(self, self.digest()).channels)
        return ()

    def with_channels(self, texts: Sequence[str]) -> Self:
        """Return the plate with further channels behind its own, whose nodes and radii stay where they are."""
        lists = {name: getattr(self, name) for name in (*NODE_LISTS, *RADIUS_LISTS) if getattr(self, name)}
        family = self.network or ("" if self.channels else DEFAULT_NETWORK)
        more = self.replaced(network=family, channels=(*self.channels, *texts), **dict.fromkeys(lists, ()))
        return more.replaced(**{name: (*own, *more.entries(name)[len(own) :]) for name, own in lists.items()})

    @property
    def movable(self) -> tuple[str, ...]:
        fixed = {name for name in ("fillet", "width") if not getattr(self, name)}
        return tuple(name for name in actuator.parameter_names(self) if name not in fixed and self._keeps_mirrors(name))

    def why_not_movable(self, name: str) -> str:
        if self._keeps_mirrors(name):
            return super().why_not_movable(name)
        return (
            f"{name} breaks the mirror symmetry of this plate, of which only 1/{self.copies} is meshed; give symmetry = 'none' "
            f"with its geometry ({self.fuller})"
        )

    def _keeps_mirrors(self, name: str) -> bool:
        """Return whether the drawing is still its own mirror image when a parameter changes by itself."""
        field, _, number = name.rstrip("]").partition("[")
        normals = np.array(self.normals).reshape(-1, 3)
        if field in ("scale_x", "scale_y"):
            return all(abs(normal["xy".index(field[-1])]) in (0.0, 1.0) for normal in normals)
        if field in NODE_LISTS:
            places, across = self.nodes.places[int(number) - 1], bool(normals[:, NODE_LISTS.index(field)].any())
        elif field in RADIUS_LISTS:
            places, across = np.array(self.drawn.channels[int(number) - 1].points), False
        else:
            return True
        return not across and bool(slices.on_mirrors(places, normals, slices.SYMMETRY_TOLERANCE * self.size).all())

    def carried(self, other: Self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return carried(self, other, np.asarray(points, dtype=float))

    @property
    def paths(self) -> tuple[tuple[Place, ...], ...]:
        """Closed paths of the outline in m, holes behind it."""
        return self.drawn.outline

    @property
    def box(self) -> tuple[Array, Array]:
        """Lowest and highest corner of the outline in m."""
        return np.min(self.paths[0], axis=0), np.max(self.paths[0], axis=0)

    @property
    def remarks(self) -> tuple[str, ...]:  # type: ignore[override]
        return self.drawn.remarks

    @property
    def portion(self) -> str:
        if not self.normals:
            return super().portion
        what = "half" if self.copies == 2 else f"wedge of {360.0 / self.copies:.4g} degrees"
        return f"{what}, {super().portion}, as the drawing is its own mirror image; --symmetry none meshes all of it"

    @property
    def expected_cells(self) -> float:
        area, volume = 0.0, outline_area(self.paths) * self.thickness
        for each in self.drawn.channels:
            for (a, p), (b, q) in itertools.pairwise(zip(each.points, each.radii, strict=True)):
                area += math.pi * (p + q) * math.dist(a, b)
        edge = min(self.edges.values())
        return 10.0 * area / edge**2 + volume / self.cell_size**3 / revolved.TETRAHEDRON_VOLUME

    @property
    def edges(self) -> dict[str, float]:
        """Length in m of the cells' edges on the walls of each cavity, by its name."""
        least: dict[str, float] = {}
        for each in self.drawn.channels:
            least[each.cavity] = min(least.get(each.cavity, math.inf), *each.radii)
        return {name: math.tau * radius / self.around for name, radius in least.items()}

    @property
    def normals(self) -> tuple[Vector, ...]:
        """Outward unit normals of the slice that is meshed, of a half or a wedge; none of the whole plate."""
        return _normals(self, self.digest())

    @property
    def copies(self) -> int:
        return len(actuator.reflected(self.normals))

    @property
    def fuller(self) -> str:
        return "--symmetry none"

    @property
    def size(self) -> float:
        return self.thickness

    @property
    def cut_planes(self) -> tuple[actuator.CutPlane, ...]:
        return tuple(actuator.CutPlane(f"plane{k}", normal) for k, normal in enumerate(self.normals))

    @property
    def ratios(self) -> tuple[float, ...]:
        return self.pressure_ratios or (1.0,) * len(self.drawn.cavities)

    @property
    def faces(self) -> tuple[str, ...]:  # type: ignore[override]
        return tuple(name for name in ("top", "bottom", "edge") if name != self.support)

    @property
    def held(self) -> tuple[Place, ...]:
        """Corners of the outline that are held, or hold a free plate."""
        corners = [place for path in self.paths for place in path]
        if self.support in ("top", "bottom", "edge"):
            return tuple(corners)
        if self.support == "free":
            places = np.array(self.paths[0])
            first = places[places[:, 0].argmin()]
            second = places[np.linalg.norm(places - first, axis=1).argmax()]
            across = np.array([first[1] - second[1], second[0] - first[0]])
            third = places[np.abs((places - first) @ across).argmax()]
            return tuple((float(x), float(y)) for x, y in (first, second, third))
        choice = faces.faces("support", self.support)
        near = 1e-6 * float(np.ptp(self.paths[0], axis=0).max())
        drawn = {(x, y): (x / self.scale_x, y / self.scale_y) for x, y in corners}
        if choice.normal is not None:
            held = [place for place in corners if abs(np.dot((*drawn[place], 0.0), choice.normal) - choice.at) < near]
        elif choice.box is not None:
            low, high = choice.box
            held = [p for p in corners if all(low[i] - near <= drawn[p][i] <= high[i] + near for i in (0, 1))]
        else:
            raise GeometryError(
                f"support is {self.support!r}; write bottom, top, edge, free, a plane such as 'x = 0 mm' or a box"
            )
        if len(held) < 2:
            (x0, y0), (x1, y1) = 1e3 * np.array(self.box)
            raise GeometryError(
                f"support is {self.support!r}, and no side of the outline lies there; it reaches from ({x0:.4g}, {y0:.4g}) to "
                f"({x1:.4g}, {y1:.4g}) mm"
            )
        return tuple(held)

    @property
    def holds(self) -> tuple[Hold, ...]:
        if self.support != "free":
            return (Hold("support", None),)
        if self.normals:
            # Mirrors leave a half the motions in its plane, a wedge that along the axis.
            half = (-self.normals[0][1], self.normals[0][0], 0.0) if self.copies == 2 else None
            ends = (("anchor0", self.lift), ("anchor0", half), ("anchor1", self.lift)) if half else (("anchor0", self.lift),)
            return tuple(Hold(name, way, point=True) for name, way in ends)
        first, second, _ = np.array(self.held)
        along = (second - first) / np.linalg.norm(second - first)
        x, y = (float(value) for value in along)
        ways = {
            "anchor0": ((x, y, 0.0), (-y, x, 0.0), self.lift),
            "anchor1": ((-y, x, 0.0), self.lift),
            "anchor2": (self.lift,),
        }
        return tuple(Hold(name, way, point=True) for name, each in ways.items() for way in each)

    @property
    def probes(self) -> Mapping[str, Vector]:
        half = 0.5 * self.thickness
        low, high = self.box
        centre = 0.5 * (low + high)
        corners = np.array(self.paths[0])
        if self.gauge_point:
            text = re.sub(r"^\s*at\s*([^,]+,[^,a-z]+)\s*([a-z]+)\s*$", r"at \1, 0 \2", self.gauge_point)
            x, y, _ = faces.point("gauge_point", text)
            return {"gauge": (self.scale_x * x, self.scale_y * y, half)}
        if self.support in ("bottom", "top", "edge", "free"):
            if network.depths(centre[None], self.paths)[0] <= 0.0:
                raise GeometryError("the middle of the outline is not in the plate; give gauge_point, such as 'at 20, 0 mm'")
            return {"middle": (float(centre[0]), float(centre[1]), half)}
        held = np.array(self.held)
        away = np.linalg.norm(corners[:, None] - held.mean(axis=0), axis=2)[:, 0]
        far = corners[away > (1.0 - 1e-9) * away.max()]
        tip = far.mean(axis=0) if len(far) > 1 and _on_side(self.paths[0], far.mean(axis=0)) else far[0]
        x, y = (float(value) for value in tip)
        return {"tip": (x, y, half)}

    @property
    def cavity_volume(self) -> float:
        """Sum of the cavities in m3, each times its pressure ratio, within the walls of the mesh."""
        volumes = (volume(*air) for air in self.air.values())
        return self.copies * sum(ratio * air for ratio, air in zip(self.ratios, volumes, strict=True))

    @property
    def solid_volume(self) -> float:
        return outline_area(self.paths) * self.thickness - self.copies * sum(volume(*air) for air in self.air.values())

    @property
    def air(self) -> dict[str, tuple[Array, mesh_arrays.Ints]]:
        """Curved walls of each cavity in the slice by its role: nodes in m, and triangles of six turned out of the air."""
        return _air(self, self.digest())

    def on_profile(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """None: which line a camera would see depends on the network."""
        return np.zeros(len(points), dtype=bool)

    @property
    def recipe(self) -> actuator.Recipe:
        inlets = tuple(((x, y, -self.thickness), (x, y, self.offset)) for x, y in self.drawn.inlets)
        return actuator.in_halves(
            self.lift, self.offset, "Every channel is round about this plane, so that each layer has open grooves.", *inlets
        )

    def build_whole(self) -> None:
        """Fill the current Gmsh model (mm) with the plate as the CAD kernel draws it, without roundings where channels meet."""
        whole_plate(self)

    def build(self) -> None:
        """Fill the current Gmsh model (mm) with the plate, its roles and its cell sizes."""
        build_plate(self)

    def curve(self) -> None:
        """Move the nodes inside the edges on the channels' walls onto them, and back those that spoil cells in creases."""
        groups = {gmsh.model.getPhysicalName(*group): group for group in gmsh.model.getPhysicalGroups(2)}
        planes = [gmsh.model.mesh.getNodesForPhysicalGroup(*groups[plane.name])[0] for plane in self.cut_planes]
        normals = np.array(self.normals).reshape(-1, 3)
        curved = []
        for name, role in zip(self.drawn.cavities, actuator.cavity_roles(self), strict=True):
            tags, places = gmsh.model.mesh.getNodesForPhysicalGroup(*groups[role])
            distance = network.Distance([each for each in self.drawn.channels if each.cavity == name], self.fillet)
            on = np.array([np.isin(tags, own) for own in planes], dtype=bool).reshape(-1, len(tags)).T
            moved = slices.projected(distance, places.reshape(-1, 3) / meshing.MM_PER_M, normals, on) * meshing.MM_PER_M
            curved += list(zip(tags.tolist(), moved, strict=True))
        _set_nodes(curved)
        try:
            gmsh.model.mesh.optimize("HighOrderElastic")
        except Exception:  # bare: its solver gave up, and has put walls back on straight edges
            _set_nodes(curved)
        meshing.straighten(3, EASED_SHARES)


def _set_nodes(places: Sequence[tuple[int, Array]]) -> None:
    """Move nodes of the mesh in the current Gmsh model to places in mm."""
    for tag, place in places:
        gmsh.model.mesh.setNode(tag, place, [])


RECTANGLE = "rectangle 40 x 15 mm"
DEFAULT_NETWORK = "parallel:4"
CELL_SIZE_GROWTH = 0.5
EASED_SHARES = (0.75, 0.5, 0.25)
"""How much of the way to the wall is left to edges that spoil cells, in the order tried."""
MAX_SCALE = 10.0
"""Largest factor on an outline, and one over the least."""
ROUND_PIECES = 360


def outline_paths(text: str) -> tuple[tuple[Place, ...], ...]:
    """Return the closed path of an outline's text, in m."""
    number = network.NUMBER
    try:
        if match := re.fullmatch(rf"\s*rectangle\s+({number})\s*x\s*({number})\s*([a-z]+)\s*", text):
            length, width = (units.quantity(f"{value} {match[3]}", "m") for value in match.groups()[:2])
            half = 0.5 * width
            return (((0.0, -half), (length, -half), (length, half), (0.0, half)),)
        if match := re.fullmatch(rf"\s*circle\s+({number}\s*[a-z]+)\s*", text):
            radius = 0.5 * units.quantity(match[1], "m")
            turns = math.tau * np.arange(ROUND_PIECES) / ROUND_PIECES
            return (tuple((radius * math.cos(turn), radius * math.sin(turn)) for turn in turns),)
        if match := re.fullmatch(rf"\s*((?:{number}\s*,\s*)+{number})\s*([a-z]+)\s*", text):
            values = [units.quantity(f"{value} {match[2]}", "m") for value in match[1].split(",")]
            if len(values) % 2 == 0 and len(values) >= 6:
                places = tuple(zip(values[::2], values[1::2], strict=True))
                return (places if network.signed_area(places) > 0.0 else places[::-1],)
    except units.UnitError as error:
        raise GeometryError(f"outline: {error}") from None
    raise GeometryError(
        f"outline is {text[:200]!r}; write 'rectangle 40 x 15 mm', 'circle 40 mm', or three corners or more such as "
        "'0, 0, 50, -10, 50, 10 mm'"
    )


NODE_LISTS = ("node_x", "node_y", "node_offsets")
RADIUS_LISTS = ("start_radii", "end_radii")


@functools.lru_cache(maxsize=64)
def _drawn(plate: ChannelPlate, digest: str) -> Network:
    """Return the network of a plate, with nodes, radii and the outline where the plate has them."""
    drawn = _as_drawn(plate, digest)
    scale = np.array([plate.scale_x, plate.scale_y])
    outline = tuple(tuple((x, y) for x, y in (scale * np.array(path)).tolist()) for path in drawn.outline)
    channels = drawn.channels
    if any(getattr(plate, name) for name in (*NODE_LISTS, *RADIUS_LISTS)):
        nodes = Nodes.of(channels)
        ends = np.array([(each.radii[0], each.radii[-1]) for each in channels])
        lists = [np.array(plate.entries(name)) for name in (*NODE_LISTS, *RADIUS_LISTS)]
        for name, values in zip((*NODE_LISTS, *RADIUS_LISTS), lists, strict=True):
            count, what = (len(nodes.places), "nodes") if name in NODE_LISTS else (len(channels), "channels")
            if len(values) != count:
                raise GeometryError(f"{name} has {len(values)} entries for {count} {what}; give one each")
        channels = nodes.moved(channels, np.stack(lists[:3], axis=1) - nodes.places, np.stack(lists[3:], axis=1) - ends)
    return dataclasses.replace(drawn, channels=channels, outline=outline)


@functools.lru_cache(maxsize=64)
def _as_drawn(plate: ChannelPlate, digest: str) -> Network:
    """Return the network of a plate: its drawing's or its family's channels and its own, and its outline."""
    own = [network.channel(text, n, plate.radius, plate.offset) for n, text in enumerate(plate.channels, 1)]
    given = outline_paths(plate.outline) if plate.outline else None
    if plate.files:
        from geometries import drawings

        drawing = drawings.read(plate.network, plate.radius, plate.offset, plate.width, outlined=given is not None)
        paths = given or drawing.outline
        if not paths:
            raise GeometryError(f"{plate.network} has no closed path that is the outline; draw one, or give outline")
        return dataclasses.replace(drawing, channels=(*drawing.channels, *own), outline=paths)
    paths = given or outline_paths(RECTANGLE)
    text = plate.network or ("" if own else DEFAULT_NETWORK)
    lines: list[Array] = []
    if text:
        if (family := network.family(text)) is None:
            raise GeometryError(
                f"network is {text!r}; give a drawing ({' or '.join(faces.DRAWINGS)}) or a family and its number, such as "
                f"radial:8; families: {', '.join(network.FAMILIES)}"
            )
        margin = plate.edge + plate.radius
        low, high = np.min(paths[0], axis=0) + margin, np.max(paths[0], axis=0) - margin
        if (high <= low).any():
            plate.reject("edge", "with radius there is no room for channels in the outline")
        lines = network.FAMILIES[family[0]](family[1], low, high)
    radii = (plate.radius, plate.radius)
    made = [Channel.along(f"airway {n}", line, plate.offset, radii) for n, line in enumerate(lines, 1)]
    return Network((*made, *own), paths)


def outline_area(paths: tuple[tuple[Place, ...], ...]) -> float:
    """Return the area in m2 within an outline and outside of its holes."""
    first, *holes = (abs(network.signed_area(path)) for path in paths)
    return first - sum(holes)


def _on_side(path: tuple[Place, ...], place: Array) -> bool:
    """Return whether a place lies on a piece of a closed path."""
    for a, b in itertools.pairwise((*path, path[0])):
        if abs(math.dist(a, place) + math.dist(place, b) - math.dist(a, b)) < 1e-9 * math.dist(a, b):
            return True
    return False


@functools.lru_cache(maxsize=64)
def _nodes(plate: ChannelPlate, digest: str) -> Nodes:
    return Nodes.of(_as_drawn(plate, digest).channels)


@functools.lru_cache(maxsize=64)
def _normals(plate: ChannelPlate, digest: str) -> tuple[Vector, ...]:
    """Return the outward normals of the slice of a plate that holds its gauge."""
    if plate.symmetry == "none":
        return ()
    held = () if plate.support in ("bottom", "top", "edge", "free") else plate.held
    ((x, y, _),) = plate.probes.values()
    return slices.outward_normals(slices.mirrors(plate.drawn, held), (x, y))


@functools.lru_cache(maxsize=8)
def _air(plate: ChannelPlate, digest: str) -> dict[str, tuple[Array, mesh_arrays.Ints]]:
    walls, normals = {}, np.array(plate.normals).reshape(-1, 3)
    finer = plate.replaced(finer=1.0) if plate.finer != 1.0 else plate
    for (name, edge), role in zip(finer.edges.items(), actuator.cavity_roles(plate), strict=True):
        own = [each for each in plate.drawn.channels if each.cavity == name]
        corners, triangles = slices.air_surface(own, plate.fillet, edge / plate.finer, normals)
        ends = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        edges, number, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
        on = slices.on_mirrors(corners, normals, slices.ON_MIRROR * edge)[edges].all(axis=1) & (count == 1)[:, None]
        middles = slices.projected(network.Distance(own, plate.fillet), corners[edges].mean(axis=1), normals, on)
        walls[role] = np.concatenate([corners, middles]), np.hstack([triangles, len(corners) + number.reshape(-1, 3)])
    return walls


def volume(nodes: Array, triangles: mesh_arrays.Ints) -> float:
    """Return the volume in m3 within closed walls of triangles of six nodes."""
    x, a, b = (np.einsum("qn,kni->kqi", table, nodes[triangles]) for table in mesh_arrays.triangle_tables(6))
    return float(np.einsum("q,kqi,kqi->", mesh_arrays.WEIGHTS, x, np.cross(a, b)) / 6.0)


# ----------------------------------------------------------------------------------------------------------------------
# Where a plate's boundary lies on another one.


def carried(plate: ChannelPlate, other: ChannelPlate, points: Array) -> Array:
    """Return where points on the boundary of a plate lie on another; see `Actuator.carried`."""
    revolved.check_alike(plate, other, ("network", "support"), ("fillet",))
    here, there, normals = plate.drawn, other.drawn, np.array(plate.normals).reshape(-1, 3)
    if plate.normals != other.normals:
        raise GeometryError("two plates have other mirrors, so that another part is meshed; give symmetry = none")
    if [(len(c.points), c.cavity) for c in here.channels] != [(len(c.points), c.cavity) for c in there.channels]:
        raise GeometryError("two plates have channels of other lines or cavities; a mesh cannot follow that, make a new one")
    (low, high), (its_low, its_high) = plate.box, other.box
    scale, gap = (its_high - its_low) / (high - low), 0.25 * plate.least_wall
    outlines = [len(path) for path in here.outline], [len(path) for path in there.outline]
    same = outlines[0] == outlines[1] and all(
        np.allclose(its_low + scale * (np.array(path) - low), its_path, rtol=0.0, atol=1e-9)
        for path, its_path in zip(here.outline, there.outline, strict=True)
    )
    if not same:
        raise GeometryError("two plates have outlines that differ by more than factors on x and y; make a new mesh")
    moved = points.copy()
    inside = (0.5 * plate.thickness - np.abs(points[:, 2]) > gap) & (network.depths(points[:, :2], here.outline) > gap)
    moved[~inside, :2] += its_low - low + (scale - 1.0) * (points[~inside, :2] - low)
    moved[~inside, 2] *= other.thickness / plate.thickness
    walls, nearest = points[inside], np.full(int(inside.sum()), np.inf)
    result = walls.copy()
    for name in here.cavities:
        mine, its = (network.Distance([c for c in d.channels if c.cavity == name], p.fillet)
                     for d, p in ((here, plate), (there, other)))  # fmt: skip
        away = np.abs(mine.distances(walls))
        near = away < nearest
        nearest[near] = away[near]
        result[near] = mine.carried(its, walls[near])
    moved[inside] = result
    for normal, near in zip(normals, slices.on_mirrors(points, normals, 1e-9 * plate.size).T, strict=True):
        moved[near] -= np.outer(moved[near] @ normal, normal)
    return moved


# ----------------------------------------------------------------------------------------------------------------------
# The plate in Gmsh: a prism of its outline, or the slice of it between mirrors, and the channels' walls as triangles that stay.


def build_plate(plate: ChannelPlate) -> None:
    """Fill the current Gmsh model (mm) with a plate or its slice, its roles and its cell sizes."""
    geo, sketch, half = gmsh.model.geo, Sketch(), 0.5 * plate.thickness
    roles: dict[str, list[int]] = defaultdict(list)
    rims: tuple[list[Line], list[Line]] = ([], [])
    ends: list[Place] = []
    for run, held in (each for path in outline_sides(plate) for each in _runs(path)):
        if not _inside(plate, run):
            continue
        low, high = (sketch.line(*((*place, z) for place in run)) for z in (-half, half))
        first, last = (sketch.line(*((*place, z) for z in (-half, half))) for place in (run[0], run[-1]))
        around = geo.addCurveLoop([low.tag, last.tag, -high.tag, -first.tag])
        roles["support" if held else "edge"].append(geo.addSurfaceFilling([around]))
        rims[0].append(low)
        rims[1].append(high)
        ends += [run[0], run[-1]]
    walls = {role: [Wall(sketch, *shell) for shell in _shells(*air)] for role, air in plate.air.items()}
    pieces = [wall for shells in walls.values() for wall in shells]
    ((gauge, top_place),) = plate.probes.items()
    for plane in plate.cut_planes:
        across = np.array(plane.normal)
        axis = [z for wall in pieces for z in wall.axis] if plate.copies > 2 else None
        lines = [line for wall in pieces for line in wall.rim if line.lies_on(across)]
        for k, line in _cut_lines(sketch, across, half, ends, axis, top_place):
            lines.append(line)
            if k is not None:
                rims[k].append(line)
        roles[plane.name] += sketch.faces(lines, np.array([-across[1], across[0], 0.0]))
    (bottom,), (top,) = (sketch.faces(rim, np.array([1.0, 0.0, 0.0])) for rim in rims)
    for name, tag in (("bottom", bottom), ("top", top)):
        roles["support" if plate.support == name else name].append(tag)
    named = {name: sketch.point((*place, -half)) for name, place in _anchors(plate, ends).items()}
    on_line = sketch.has(top_place)
    named[gauge] = sketch.point(top_place)
    open_pieces = [wall for wall in pieces if wall.rim]
    geo.synchronize()
    if not on_line:
        gmsh.model.mesh.embed(0, [named[gauge]], 2, top)
    _set_sizes(plate)
    gmsh.option.setNumber("Mesh.MeshOnlyEmpty", 1)  # the ends of walls on the cut planes stay as they are
    for line in (line for wall in open_pieces for line in wall.rim):
        gmsh.model.mesh.setTransfiniteCurve(line.tag, 2)
    gmsh.model.mesh.generate(1)
    outside = [tag for tags in roles.values() for tag in tags]
    for role, shells in walls.items():
        roles[role] = [wall.add() for wall in shells]
    outside += [wall.tag for wall in open_pieces]
    loops = [geo.addSurfaceLoop(outside), *(geo.addSurfaceLoop([wall.tag]) for wall in pieces if not wall.rim)]
    solid = geo.addVolume(loops)
    geo.synchronize()
    meshing.name_group(3, [solid], "solid")
    meshing.name_groups(2, roles)
    meshing.name_groups(0, {name: [tag] for name, tag in named.items() if name.startswith("anchor")})


@dataclasses.dataclass(frozen=True, eq=False)
class Line:
    """A line of the Gmsh model, a spline through more than two places (m): its tag, and the tags of its ends."""

    tag: int
    ends: tuple[int, int]
    places: Array

    def lies_on(self, normal: Array) -> bool:
        """Return whether it lies in a plane through the origin."""
        return bool(np.abs(self.places @ normal).max() < SAME_PLACE)


class Sketch:
    """Points and lines of the current Gmsh model (mm), each once, by their places in m; and the plane faces between lines."""

    def __init__(self) -> None:
        self.points: dict[tuple[int, ...], int] = {}
        self.lines: dict[tuple[int, ...], Line] = {}

    def has(self, place: Sequence[float]) -> bool:
        return self._key(place) in self.points

    def point(self, place: Sequence[float]) -> int:
        if not self.has(place):
            self.points[self._key(place)] = gmsh.model.geo.addPoint(*(meshing.MM_PER_M * np.array(place)))
        return self.points[self._key(place)]

    @staticmethod
    def _key(place: Sequence[float]) -> tuple[int, ...]:
        return tuple(round(value / SAME_PLACE) for value in place)

    def line(self, *places: Sequence[float]) -> Line:
        tags = tuple(self.point(place) for place in places)
        if tags not in self.lines:
            add = gmsh.model.geo.addSpline(tags) if len(tags) > 2 else gmsh.model.geo.addLine(*tags)
            self.lines[tags] = Line(add, (tags[0], tags[-1]), np.array(places))
        return self.lines[tags]

    def faces(self, lines: Sequence[Line], along: Array) -> list[int]:
        """Return the plane faces between closed loops of lines: one whose extent along a direction lies within that of another
        is a hole in it."""
        at: dict[int, list[Line]] = defaultdict(list)
        for line in lines:
            for end in line.ends:
                at[end].append(line)
        left = dict.fromkeys(lines)
        faces: list[tuple[float, float, list[int]]] = []
        loops = []
        while left:
            line = next(iter(left))
            end, tags, extent = line.ends[0], [], []
            while line in left:
                del left[line]
                forward = line.ends[0] == end
                tags.append(line.tag if forward else -line.tag)
                extent += (line.places @ along).tolist()
                end = line.ends[forward]
                line = next((other for other in at[end] if other in left), line)
            loops.append((min(extent), max(extent), gmsh.model.geo.addCurveLoop(tags)))
        for low, high, tag in sorted(loops):
            around = next((holes for start, stop, holes in faces if start < low and high < stop), None)
            if around is None:
                faces.append((low, high, [tag]))
            else:
                around.append(tag)
        return [gmsh.model.geo.addPlaneSurface(tags) for *_, tags in faces]


class Wall:
    """A connected piece of the channels' walls, corners (m) and triangles: the lines and the heights on the axis where it ends
    on cut planes, and its surface in the Gmsh model."""

    def __init__(self, sketch: Sketch, corners: Array, triangles: mesh_arrays.Ints):
        ends = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        edges, count = np.unique(ends, axis=0, return_counts=True)
        self.corners, self.triangles = corners, triangles
        self.rim = [sketch.line(*corners[edge]) for edge in edges[count == 1]]
        self.points = {int(node): sketch.point(corners[node]) for node in np.unique(edges[count == 1])}
        self.axis = [float(corners[n, 2]) for n in self.points if np.abs(corners[n, :2]).max() < SAME_PLACE]

    def add(self) -> int:
        """Return the tag of its surface, added once the ends of its lines have nodes."""
        self.tag: int = gmsh.model.addDiscreteEntity(2, boundary=[line.tag for line in self.rim])
        number = int(gmsh.model.mesh.getMaxNodeTag()) + 1 + np.arange(len(self.corners))
        inner = np.ones(len(number), dtype=bool)
        for node, point in self.points.items():
            number[node], inner[node] = gmsh.model.mesh.getNodes(0, point)[0][0], False
        gmsh.model.mesh.addNodes(2, self.tag, number[inner], (meshing.MM_PER_M * self.corners[inner]).ravel())
        gmsh.model.mesh.addElementsByType(self.tag, 2, [], number[self.triangles].ravel())
        return self.tag


def _shells(nodes: Array, triangles: mesh_arrays.Ints) -> Iterator[tuple[Array, mesh_arrays.Ints]]:
    """Yield corners and triangles of the connected pieces of walls of triangles of six nodes."""
    corners = triangles[:, :3]
    shell = mesh_arrays.shells(corners, len(nodes))
    for number in np.unique(shell):
        used, own = np.unique(corners[shell == number], return_inverse=True)
        yield nodes[used], own.reshape(-1, 3)


def _cut_lines(
    sketch: Sketch, normal: Array, half: float, ends: Sequence[Place], axis: Sequence[float] | None, gauge: Vector
) -> Iterator[tuple[int | None, Line]]:
    """Yield the lines around a cut plane of a plate, of half a thickness, without those of walls; with 0 those below, with 1
    those on top.

    Args:
        ends: Places where the outline ends on cut planes.
        axis: Heights at which walls end on the axis; None for a half.
        gauge: A place that a line on top has to pass through, if it lies in the plane.
    """
    along = np.array([-normal[1], normal[0]])
    own = dict.fromkeys(place for place in ends if abs(np.dot(place, normal[:2])) < SAME_PLACE)
    places = sorted(own, key=lambda place: float(np.dot(place, along)))
    if len(places) % 2:
        places.append((0.0, 0.0))
        places.sort(key=lambda place: float(np.dot(place, along)))
    for a, b in itertools.batched(places, 2):
        for k, z in enumerate((-half, half)):
            between = k == 1 and _on_side((a, b), np.array(gauge[:2])) and gauge[:2] not in (a, b)
            way = (a, gauge[:2], b) if between else (a, b)
            yield from ((k, sketch.line((*p, z), (*q, z))) for p, q in itertools.pairwise(way))
        for place in (a, b):
            heights = sorted((-half, half, *(axis if axis and place == (0.0, 0.0) else ())))
            yield from ((None, sketch.line((*place, low), (*place, high))) for low, high in itertools.batched(heights, 2))


SAME_PLACE = 1e-9
"""Places nearer than this (m) are one."""


def _inside(plate: ChannelPlate, run: Sequence[Place]) -> bool:
    """Return whether a piece of the outline lies in the slice that is meshed."""
    k = (len(run) - 1) // 2
    middle = 0.5 * np.add(run[k], run[k + 1])
    return all(float(middle @ normal[:2]) < 0.0 for normal in plate.normals)


def _anchors(plate: ChannelPlate, ends: Sequence[Place]) -> dict[str, Place]:
    """Return the places that hold a free plate, on its outline, by name: of a slice those where it ends on the first plane."""
    if plate.support != "free":
        return {}
    if not plate.normals:
        return {f"anchor{k}": place for k, place in enumerate(plate.held)}
    x, y, _ = plate.normals[0]
    own = sorted((p for p in ends if abs(np.dot(p, (x, y))) < SAME_PLACE), key=lambda p: float(np.dot(p, (y, -x))))
    return {"anchor0": own[0], "anchor1": own[-1]} if plate.copies == 2 else {"anchor0": own[0]}


def whole_plate(plate: ChannelPlate) -> None:
    """Fill the current Gmsh model (mm) with a plate as one solid: a prism without cones and balls."""
    occ, mm, half = gmsh.model.occ, meshing.MM_PER_M, 0.5 * plate.thickness
    loops = []
    for path in plate.paths:
        places = {place: occ.addPoint(mm * place[0], mm * place[1], -mm * half) for place in path}
        lines = [[places[place] for place in run] for run, _ in _runs([(place, False, False) for place in path])]
        loops.append(occ.addCurveLoop([occ.addSpline(line) if len(line) > 2 else occ.addLine(*line) for line in lines]))
    face = occ.addPlaneSurface(loops)
    prism = [entity for entity in occ.extrude([(2, face)], 0, 0, mm * plate.thickness) if entity[0] == 3]
    balls: dict[Vector, float] = {}
    cones = []
    for each in plate.drawn.channels:
        for (a, p), (b, q) in itertools.pairwise(zip(each.points, each.radii, strict=True)):
            place, along = mm * np.array(a), mm * np.subtract(b, a)
            cones.append(
                (3, occ.addCylinder(*place, *along, mm * p) if p == q else occ.addCone(*place, *along, mm * p, mm * q))
            )
        for corner, radius in zip(each.points, each.radii, strict=True):
            balls[corner] = max(balls.get(corner, 0.0), radius)
    parts = cones + [(3, occ.addSphere(*(mm * np.array(corner)), mm * radius)) for corner, radius in balls.items()]
    air = occ.fuse(parts[:1], parts[1:])[0]
    meshing.one_solid(occ.cut(prism, air)[0])
    occ.remove([(2, face)], recursive=True)
    occ.synchronize()


def outline_sides(plate: ChannelPlate) -> list[list[tuple[Place, bool, bool]]]:
    """Return the closed paths of the outline, with the gauge's place and those on cut planes among their corners: of each
    corner its place, whether it has to be a vertex of the mesh, and whether the side behind it is held."""
    ((x, y, _),) = plate.probes.values()
    held = {*plate.held} if plate.support not in ("bottom", "top", "free") else set()
    marks = {(x, y), *(plate.held if plate.support == "free" else ())}
    normals = np.array(plate.normals).reshape(-1, 3)[:, :2]
    near = slices.SYMMETRY_TOLERANCE * float(np.ptp(plate.paths[0], axis=0).max())
    paths = []
    for path in plate.paths:
        corners = []
        for a, b in itertools.pairwise((*path, path[0])):
            shares = {0.0: a in marks}
            if a != (x, y) != b and _on_side((a, b), np.array((x, y))):
                shares[math.dist(a, (x, y)) / math.dist(a, b)] = True
            for p, q in zip(normals @ a, normals @ b, strict=True):
                if p * q < 0.0 and min(abs(p), abs(q)) > near:
                    shares[float(p / (p - q))] = True
            for share in sorted(shares):
                place = np.array(a) + share * np.subtract(b, a)
                on = np.abs(normals @ place) < near
                for normal in normals[on]:
                    place -= (place @ normal) * normal
                corners.append(((float(place[0]), float(place[1])), shares[share] or bool(on.any()), a in held and b in held))
        paths.append(corners)
    return paths


def _runs(path: Sequence[tuple[Place, bool, bool]]) -> list[tuple[list[Place], bool]]:
    """Return the smooth pieces of a closed path between its corners, two or more, and whether each is held; a path as of
    `outline_sides`."""
    places = np.array([place for place, _, _ in path])
    along = np.roll(places, -1, axis=0) - places
    before = np.roll(along, 1, axis=0)
    turn = np.abs(np.arctan2(before[:, 0] * along[:, 1] - before[:, 1] * along[:, 0], (before * along).sum(axis=1)))
    breaks = {
        k for k, (_, vertex, held) in enumerate(path) if turn[k] > network.MIN_CORNER_TURN or vertex or held != path[k - 1][2]
    }
    while len(breaks) < 2:
        breaks.add(0 if not breaks else (min(breaks) + len(path) // 2) % len(path))
    ordered = sorted(breaks)
    return [
        ([path[k % len(path)][0] for k in range(start, end + 1)], path[start][2])
        for start, end in itertools.pairwise([*ordered, ordered[0] + len(path)])
    ]


def _set_sizes(plate: ChannelPlate) -> None:
    """Let cells grow away from the channels' walls: sizes on a grid, since Gmsh asks a million times."""
    nodes = [(plate.air[role][0], edge) for role, edge in zip(plate.air, plate.edges.values(), strict=True)]
    low, high = plate.box
    low, high = np.array([*low, -0.5 * plate.thickness]), np.array([*high, 0.5 * plate.thickness])
    step = max(0.7 * min(plate.edges.values()), float(np.cbrt(np.prod(high - low) / 1e6)))
    count = np.ceil((high - low) / step).astype(int) + 1
    grid = np.stack(np.meshgrid(*(low[i] + step * np.arange(count[i]) for i in range(3)), indexing="ij"), axis=-1)
    size = np.full(count, plate.cell_size)
    for places, edge in nodes:
        away, _ = scipy.spatial.cKDTree(places).query(grid.reshape(-1, 3))
        size = np.minimum(size, edge + CELL_SIZE_GROWTH * np.maximum(away.reshape(count) - 0.5 * edge, 0.0))
    (x0, y0, z0), (nx, ny, nz), table = low.tolist(), (count - 1).tolist(), size.tolist()

    def at(x: float, y: float, z: float) -> float:
        i, j, k = round((x - x0) / step), round((y - y0) / step), round((z - z0) / step)
        return float(table[min(max(i, 0), nx)][min(max(j, 0), ny)][min(max(k, 0), nz)])

    meshing.set_sizes(at)
