"""A plate of any outline with a network of round channels in it, drawn, of a family, or written.

The plate lies between z = -thickness/2 and thickness/2. Its outline and the channels' centre lines are given in the plane
(x, y); all channels lie `offset` above the middle of the thickness unless one says otherwise. Where channels of one cavity
cross they are joined, and the crease is rounded.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from geometries import actuator, faces, network, plates, registry, slices
from geometries.actuator import Hold, Vector
from geometries.network import Channel, Network, Nodes, Place
from softmodels.common import errors, schema, units
from softmodels.common.arrays import Array
from softmodels.common.errors import GeometryError
from softmodels.common.lazy import scipy

MAX_CORNERS = 40
"""Of an outline whose corners are parameters; others are curves."""


@registry.register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class ChannelPlate(plates.NetworkPlate):
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
    outline_x: tuple[float, ...] = schema.places_field(
        "x of each corner of the outline in place of the drawn one; a design moves those of outlines of at most "
        f"{MAX_CORNERS} corners"
    )
    outline_y: tuple[float, ...] = schema.places_field("y of each corner of the outline")
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
    alike: ClassVar = ("network", "support")
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
        self.check_around()
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
        if field in OUTLINE_LISTS:
            corners = _as_drawn(self, self.digest()).outline[0]
            return tuple(place[OUTLINE_LISTS.index(field)] for place in corners) if len(corners) <= MAX_CORNERS else ()
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

    def without_channels(self, numbers: Sequence[int]) -> Self:
        """Return the plate without some of its written channels, by their numbers from 1; the nodes and radii of the others
        stay where they are. GeometryError if a channel is not written, or what is left of a cavity falls apart."""
        given, own = self.drawn, len(self.channels)
        first = len(given.channels) - own
        left = [number for number in range(len(given.channels)) if number + 1 not in numbers]
        if min(numbers) <= first or not left:
            raise GeometryError(
                f"only written channels can be removed, numbers {first + 1} to {first + own}, and not all of them"
            )
        rest = dataclasses.replace(given, channels=tuple(given.channels[number] for number in left))
        if rest.cavities != given.cavities or network.parts(rest.channels) > network.parts(given.channels):
            raise GeometryError("without these channels a cavity would be gone, or fall apart")
        texts = tuple(self.channels[number - first] for number in left if number >= first)
        lists = {name: getattr(self, name) for name in (*NODE_LISTS, *RADIUS_LISTS) if getattr(self, name)}
        less = self.replaced(channels=texts, **dict.fromkeys(lists, ()))
        _, node = scipy.spatial.cKDTree(self.nodes.places).query(less.nodes.places)
        kept = {name: node if name in NODE_LISTS else np.array(left) for name in lists}
        return less.replaced(**{name: tuple(np.array(own)[kept[name]].tolist()) for name, own in lists.items()})

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
        elif field in OUTLINE_LISTS:
            corner = (*_as_drawn(self, self.digest()).outline[0][int(number) - 1], 0.0)
            places, across = np.array(corner), bool(normals[:, OUTLINE_LISTS.index(field)].any())
        elif field in RADIUS_LISTS:
            places, across = np.array(self.drawn.channels[int(number) - 1].points), False
        else:
            return True
        return not across and bool(slices.on_mirrors(places, normals, slices.SYMMETRY_TOLERANCE * self.size).all())

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
    def normals(self) -> tuple[Vector, ...]:
        """Outward unit normals of the slice that is meshed, of a half or a wedge; none of the whole plate."""
        return _normals(self, self.digest())

    @property
    def copies(self) -> int:
        return self.images

    @property
    def fuller(self) -> str:
        return "--symmetry none"

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

    def side_roles(self, corners: Sequence[Place]) -> list[str]:
        held = {*self.held} if self.support not in ("bottom", "top", "free") else set()
        sides = zip(corners, (*corners[1:], corners[0]), strict=True)
        return ["support" if a in held and b in held else "edge" for a, b in sides]

    def flat_role(self, name: str) -> str:
        return "support" if self.support == name else name

    def vertices(self) -> set[Place]:
        return {*super().vertices(), *(self.held if self.support == "free" else ())}

    def anchors(self, ends: Sequence[Place]) -> Mapping[str, Place]:
        """Return the places that hold a free plate, on its outline: of a slice those where it ends on the first plane."""
        if self.support != "free":
            return {}
        if not self.normals:
            return {f"anchor{k}": place for k, place in enumerate(self.held)}
        x, y, _ = self.normals[0]
        near = (place for place in ends if abs(np.dot(place, (x, y))) < plates.SAME_PLACE)
        own = sorted(near, key=lambda place: float(np.dot(place, (y, -x))))
        return {"anchor0": own[0], "anchor1": own[-1]} if self.copies == 2 else {"anchor0": own[0]}

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
        tip = far.mean(axis=0) if len(far) > 1 and plates.on_side(self.paths[0], far.mean(axis=0)) else far[0]
        x, y = (float(value) for value in tip)
        return {"tip": (x, y, half)}

    def on_profile(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """None: which line a camera would see depends on the network."""
        return np.zeros(len(points), dtype=bool)

    @property
    def recipe(self) -> actuator.Recipe:
        inlets = tuple(((x, y, -self.thickness), (x, y, self.offset)) for x, y in self.drawn.inlets)
        return actuator.in_halves(
            self.lift, self.offset, "Every channel is round about this plane, so that each layer has open grooves.", *inlets
        )


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
OUTLINE_LISTS = ("outline_x", "outline_y")


@functools.lru_cache(maxsize=64)
def _drawn(plate: ChannelPlate, digest: str) -> Network:
    """Return the network of a plate, with nodes, radii and the outline where the plate has them."""
    drawn = _as_drawn(plate, digest)
    scale = np.array([plate.scale_x, plate.scale_y])
    corners = np.array(drawn.outline[0])
    for column, name in enumerate(OUTLINE_LISTS):
        if values := getattr(plate, name):
            if len(values) != len(corners):
                raise GeometryError(
                    f"{name} has {len(values)} entries for {len(corners)} corners of the outline; give one each"
                )
            corners[:, column] = values
    outline = tuple(tuple((x, y) for x, y in (scale * np.array(path)).tolist()) for path in (corners, *drawn.outline[1:]))
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
