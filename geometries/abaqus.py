"""Read the nodes, solid elements, triangles, sets and surfaces of a deck of Abaqus or CalculiX, and where its instances stand.

Hexahedra and wedges are split into tetrahedra. Instances are one body where ``*TIE`` bonds surfaces whose nodes coincide. What
would change nodes or elements in ways that are not read is an error. The other keywords are kept: `softmodels.case.abaqus`
reads laws, supports and loads from them.
"""

from __future__ import annotations

import dataclasses
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometries import mesh_arrays
from geometries.mesh_arrays import Ints
from softmodels.common.arrays import Array
from softmodels.common.errors import GeometryError
from softmodels.common.lazy import scipy


class Deck:
    """What a deck holds; `GeometryError` for what is not read.

    Args:
        file: Its name, for messages.
        text: Its content.
    """

    def __init__(self, file: str, text: str):
        self.file, self.size = file, len(text)
        self.model, self.assembly = Scope(), Scope()
        self.parts: dict[str, Scope] = {}
        self.instances: dict[str, Scope] = {}
        self.places: dict[str, list[list[float]]] = {}
        self.scope, self.instance = self.model, ""
        self.cards = list[Card]()
        self.unread_elements = defaultdict[str, int](int)
        self.several = False
        self.material_sets = dict[str, str]()
        """Name of the set of cells of each material, once `mesh` is made."""
        for number, keyword, options, lines in _blocks(text):
            try:
                self._take(number, keyword, options, lines)
            except GeometryError:
                raise
            except (ValueError, IndexError, KeyError) as error:
                raise GeometryError(
                    f"file {file} is not a mesh of the format of its extension (line {number}, *{keyword}: {error})"
                ) from None

    def _take(self, number: int, keyword: str, options: Mapping[str, str], lines: list[Line]) -> None:
        if keyword == "INCLUDE" or "INPUT" in options:
            raise GeometryError(
                f"file {self.file} includes another file (line {number}: {keyword.lower()}), which is not supported; put all "
                "nodes and elements into one file"
            )
        if keyword in UNREAD or (keyword == "NODE" and options.get("SYSTEM", "R").upper() != "R"):
            raise GeometryError(
                f"file {self.file} makes or moves nodes or elements by *{keyword} (line {number}), which is not read; write "
                "every node in rectangular coordinates and every element"
            )
        if keyword == "PART":
            self.scope = self.parts[options["NAME"].upper()] = Scope()
        elif keyword == "ASSEMBLY":
            self.scope = self.assembly
        elif keyword == "INSTANCE":
            self._begin_instance(options, lines)
        elif keyword in ("END PART", "END ASSEMBLY"):
            self.scope = self.model
        elif keyword == "END INSTANCE":
            self.scope = self.assembly
        elif keyword == "NODE":
            self._nodes(options, lines)
        elif keyword == "ELEMENT":
            self._elements(options, lines)
        elif keyword in ("NSET", "ELSET"):
            self._set(keyword, options, lines)
        elif keyword == "SURFACE":
            self._surface(options, lines)
        elif keyword == "SOLID SECTION":
            self._add("sections", options["MATERIAL"], [options["ELSET"]])
        else:
            self.cards.append(Card(number, keyword, dict(options), lines))
            for _, (elset, *load) in lines if keyword == "DLOAD" else ():
                if load and re.fullmatch(r"P\d", load[0].upper()):  # pressure on sides of elements, a surface without a name
                    self._add("surfaces", dload_surface(load[1]), [(elset, f"S{load[0][1]}")])

    def _begin_instance(self, options: Mapping[str, str], lines: list[Line]) -> None:
        part = self.parts[options["PART"].upper()] if "PART" in options else Scope()
        self.instance = options["NAME"].upper()
        copies = {field.name: getattr(part, field.name).copy() for field in dataclasses.fields(part)}
        self.scope = self.instances[self.instance] = Scope(**copies)
        self.places[self.instance] = [[float(word or 0.0) for word in words] for _, words in lines]

    def _nodes(self, options: Mapping[str, str], lines: list[Line]) -> None:
        for _, (number, *place) in lines:
            at = [float(word) if word else 0.0 for word in place[:3]]
            self.scope.nodes[int(number)] = at + [0.0] * (3 - len(at))
        if "NSET" in options:
            self._add("node_sets", options["NSET"], [words[0] for _, words in lines])

    def _elements(self, options: Mapping[str, str], lines: list[Line]) -> None:
        kind = options["TYPE"].upper()
        shape = next((shape for pattern, shape in KINDS if pattern.match(kind)), None)
        if shape is None:
            if OTHER_SOLIDS.match(kind):
                raise GeometryError(
                    f"file {self.file} has cells of type {kind}; tetrahedra (4 or 10 nodes), wedges (6 or 15) and hexahedra "
                    "(8 or 20) are supported"
                )
            self._add("cell_sets", options.get("ELSET", ""), ())  # lines, masses and the like: known, but not read
            self.unread_elements[kind] += len(lines)
            return
        width = 1 + SHAPES[shape].nodes
        numbers = [int(word) for _, words in lines for word in words if word]
        if len(numbers) % width:
            raise ValueError(f"{len(numbers)} numbers are no elements of {width - 1} nodes")
        for i in range(0, len(numbers), width):
            self.scope.cells[numbers[i]] = Element(shape, numbers[i + 1 : i + width])
        if "ELSET" in options:
            self._add("cell_sets", options["ELSET"], map(str, numbers[::width]))

    def _set(self, keyword: str, options: Mapping[str, str], lines: list[Line]) -> None:
        members = [word for _, words in lines for word in words if word]
        if "GENERATE" in options:
            members = [member for line in lines for member in self._range(*line)]
        of = options.get("INSTANCE", "").upper()
        members = [f"{of}.{member}" for member in members] if of else members
        if keyword == "NSET" and "ELSET" in options:
            members = [f"{of}." * bool(of) + NODES_OF + options["ELSET"]]
        self._add("node_sets" if keyword == "NSET" else "cell_sets", options[keyword], members)
        if keyword == "ELSET" and "INTERNAL" in options:  # of a surface, which has a name of its own
            self.scope.internal.add(options[keyword].upper())

    def _surface(self, options: Mapping[str, str], lines: list[Line]) -> None:
        kind = options.get("TYPE", "ELEMENT").upper()
        if kind not in ("ELEMENT", "NODE") or {"COMBINE", "CROP"} & options.keys():
            return  # analytical ones, and those made of others, have no name to choose
        sides = [(words[0], "NODES" if kind == "NODE" else "".join(words[1:2]).upper()) for _, words in lines]
        self._add("surfaces", options["NAME"], [side for side in sides if side[0]])

    def _add[T](self, kind: str, name: str, members: Iterable[T]) -> None:
        sets, key = getattr(self.scope, kind), name.upper()
        self.scope.spelled.setdefault(key, name)
        sets[key] = [*sets.get(key, ()), *members]  # a list may be the part's too

    def _range(self, number: int, words: list[str]) -> Iterator[str]:
        first, last, step = (*(int(word) for word in words if word), 1)[:3]
        if abs(last - first) > self.size:
            raise ValueError(f"line {number} has a set of {', '.join(words)[:80]!r}, more than the file has characters")
        return map(str, range(first, last + 1, step))

    def mesh(self) -> Any:
        """Return the body as a mesh of meshio's, of tetrahedra and triangles; `GeometryError` for none, or several."""
        import meshio

        bodies = {name: body for name, body in (self.instances or self.parts).items() if _has_solids(body)}
        if _has_solids(self.model):
            bodies[""] = self.model
        self.several = len(bodies) > 1
        ties = [card for card in self.cards if card.keyword == "TIE"]
        if len(bodies) > 1 and not ties:
            names = ", ".join(name or "the model itself" for name in bodies)
            raise GeometryError(
                f"file {self.file} has {len(bodies)} bodies ({names}), and no *TIE that bonds them where they touch: tie their "
                "surfaces, or merge them into one part, with common nodes, where it is meshed"
            )
        read = [_Body.of(self, name, body) for name, body in (bodies or {"": self.model}).items()]
        offsets = np.cumsum([0, *(len(body.points) for body in read)])
        points = np.concatenate([body.points for body in read])
        same = np.arange(len(points))
        if len(bodies) > 1:
            for tie in ties:
                for line in tie.lines:
                    self._weld(line, read, offsets, points, same)
        groups = {kind: defaultdict[str, list[Ints]](list) for kind in ("node_sets", "faces", "cell_sets", "sections")}
        elements = defaultdict[str, list[Ints]](list)
        numbers = defaultdict[str, list[Ints]](list)
        for i, (body, offset) in enumerate(zip(read, offsets, strict=False)):
            for kind in ("node_sets", "faces"):
                for key, rows in getattr(body, kind).items():
                    groups[kind][key].append(same[rows + offset])
            for kind in ("cell_sets", "sections"):
                for key, cells in getattr(body, kind).items():
                    groups[kind][key].append(np.column_stack([np.full(len(cells), i), cells]))
            for shape, (own, rows) in body.elements.items():
                elements[shape].append(same[rows + offset])
                numbers[shape].append(np.column_stack([np.full(len(own), i), own]))
        return self._made(meshio, points, groups, elements, numbers)

    def _made(
        self,
        meshio: Any,
        points: Array,
        groups: Mapping[str, Mapping[str, list[Ints]]],
        elements: Mapping[str, list[Ints]],
        numbers: Mapping[str, list[Ints]],
    ) -> Any:
        """Return elements by shape, their bodies and numbers, and names as a mesh."""
        blocks, owners = list[tuple[str, Ints]](), list[Ints]()
        whole = {shape: np.concatenate(rows) for shape, rows in elements.items()}
        middles, points = with_middles(whole, points)
        for shape, rows in whole.items():
            cells, of = split(shape, rows, middles.get(shape))
            blocks.append((SHAPES[shape].piece, cells))
            owners.append(np.concatenate(numbers[shape])[of])
        sets = {key: np.concatenate(members) for key, members in groups["cell_sets"].items()}
        plain = {_plain(key) for key in sets}
        for material, members in groups["sections"].items():
            self.material_sets[material] = f"material {material}" if _plain(material) in plain else material
            sets[self.material_sets[material]] = np.concatenate(members)
        faces = {key: np.concatenate(rows) for key, rows in groups["node_sets"].items()}
        # Beside nodes, shape (n,), the corners of triangles, shape (t, 3).
        faces |= {key: _halved(np.concatenate(rows)) for key, rows in groups["faces"].items()}
        return meshio.Mesh(
            points,
            blocks,
            point_sets=faces,
            cell_sets={key: [np.flatnonzero(_among(owner, members)) for owner in owners] for key, members in sets.items()},
        )

    def _weld(self, line: Line, bodies: list[_Body], offsets: Ints, points: Array, same: Ints) -> None:
        """Join the nodes of two tied surfaces in ``same``; `GeometryError` if they do not coincide."""
        number, names = line
        sides = []
        for name in names[:2]:
            rows = [body.nodes_of(self, name) + offset for body, offset in zip(bodies, offsets, strict=False)]
            sides.append(np.unique(np.concatenate(rows)))
        if not all(map(len, sides)):
            raise GeometryError(f"file {self.file}: *TIE (line {number}) names a surface without nodes ({', '.join(names)})")
        slave, master = sides
        near = TIE_TOLERANCE * float(np.linalg.norm(np.ptp(points, axis=0)))
        away, nearest = scipy.spatial.cKDTree(points[master]).query(points[slave])
        if lonely := int((away > near).sum()):
            x, y, z = points[slave[away.argmax()]]
            raise GeometryError(
                f"file {self.file}: *TIE (line {number}) bonds surfaces whose nodes do not coincide: {lonely} of {len(slave)} "
                f"nodes of {names[0]} are apart from those of {names[1]}, the farthest at {x:.4g}, {y:.4g}, {z:.4g} in the "
                "file's unit; merge both instances into one part and mesh that"
            )
        same[slave] = same[master[nearest]]

    def _names(self, name: str, body: Scope, kind: str) -> Iterator[tuple[str, Scope, str]]:
        """Yield the names of the sets or surfaces of a body and of the assembly, where they are, and these in capitals; where
        several bodies, or the body and the assembly, may have a name, that of the body begins with the instance's."""
        for scope in (body, self.assembly) if name else (body,):
            for text in filter(None, getattr(scope, kind)):
                if kind == "cell_sets" and text in scope.internal:
                    continue
                both = scope is body and name and (self.several or text in getattr(self.assembly, kind)) and kind != "sections"
                yield f"{name}." * bool(both) + scope.spelled[text], scope, text

    def _sides(
        self, name: str, body: Scope, scope: Scope, members: Sequence[tuple[str, str]], within: Within
    ) -> tuple[set[int], list[tuple[Element, list[int]]]]:
        """Return the nodes of a surface of nodes, and elements of another one with the corners of each side, by their places
        in the element."""
        nodes, owned = set[int](), list[tuple[Element, list[int]]]()
        for member, side in members:
            if side == "NODES":
                nodes |= self._members(name, body, scope, "node_sets", [member], within)
                continue
            for cell in sorted(self._members(name, body, scope, "cell_sets", [member], within)):
                if (element := body.cells.get(cell)) is None or side.startswith("E"):
                    continue
                sides = SHAPES[element.shape].sides
                solid = len(sides) > 1
                known = [f"S{i + 1}" for i in range(len(sides))]
                if solid and side not in ("", *known):
                    raise GeometryError(
                        f"file {self.file}: the surface {scope.spelled[within[0][1]]} has the side {side!r} of "
                        f"{SHAPES[element.shape].plural}; these have {', '.join(known)}"
                    )
                owned += [(element, half) for half in ([sides[known.index(side)]] if solid and side else sides)]
        return nodes, owned

    def _members(self, name: str, body: Scope, scope: Scope, kind: str, members: Iterable[str], within: Within) -> set[int]:
        """Return the numbers of a set's nodes or elements; those of other instances are left out."""
        ids: set[int] = set()
        for member in members:
            of, dot, own = member.rpartition(".")
            if of and of.upper() != name:
                continue
            where = body if dot else scope
            if own.isdigit():
                ids.add(int(own))
            elif own.startswith(NODES_OF):
                cells = self._members(name, body, where, "cell_sets", [own.removeprefix(NODES_OF)], within)
                ids.update(node for cell in cells if cell in body.cells for node in body.cells[cell].nodes)
            elif (key := own.upper()) in (known := getattr(where, kind)) and (kind, key) not in within:
                ids |= self._members(name, body, where, kind, known[key], (*within, (kind, key)))
            else:
                of, text = within[-1]
                raise GeometryError(
                    f"file {self.file}: the {'surface' if of == 'surfaces' else 'set'} {scope.spelled.get(text, text)} has "
                    f"{member!r}, which is not defined"
                )
        return ids


@dataclasses.dataclass(frozen=True)
class Shape:
    """A shape of elements: its number of nodes; what it is split into; corners of its sides, turned outwards, in the order S1,
    S2, ...; and corners at the ends of the edges whose nodes follow the corners."""

    nodes: int
    piece: str
    plural: str
    sides: list[list[int]]
    edges: list[list[int]] = dataclasses.field(default_factory=list)

    @property
    def corners(self) -> int:
        return 1 + max(max(side) for side in self.sides)

    @property
    def squares(self) -> list[list[int]]:
        """Sides with four corners."""
        return [side for side in self.sides if len(side) == 4]

    def inside(self, side: list[int]) -> list[int]:
        """Return the places of the nodes inside the edges of a side."""
        return [self.corners + i for i, edge in enumerate(self.edges) if set(edge) <= set(side)]

    @property
    def between(self) -> Ints:
        """Which node lies between two corners, of an edge or by the middles that follow its nodes: of squares, and its own."""
        between = np.zeros((self.corners, self.corners), dtype=np.int64)
        pairs = dict(zip(map(tuple, self.edges), range(self.corners, self.nodes), strict=True))
        for i, (a, b, c, d) in enumerate(self.squares):
            pairs |= {(a, c): self.nodes + i, (b, d): self.nodes + i}
        if self.corners == 8:
            pairs |= dict.fromkeys([(0, 6), (1, 7), (2, 4), (3, 5)], self.nodes + len(self.squares))
        for (a, b), node in pairs.items():
            between[a, b] = between[b, a] = node
        return between


_HEXAHEDRON = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
_WEDGE = [[0, 2, 1], [3, 4, 5], [0, 1, 4, 3], [1, 2, 5, 4], [2, 0, 3, 5]]
_RING = [[0, 1], [1, 2], [2, 3], [3, 0]]
SHAPES = {
    "triangle": Shape(3, "triangle", "triangles", [[0, 1, 2]]),
    "triangle6": Shape(6, "triangle6", "triangles", [[0, 1, 2]], [[0, 1], [1, 2], [2, 0]]),
    "tetra": Shape(4, "tetra", "tetrahedra", mesh_arrays.SIDES.tolist()),
    "tetra10": Shape(10, "tetra10", "tetrahedra", mesh_arrays.SIDES.tolist(), mesh_arrays.EDGES.tolist()),
    "hexahedron": Shape(8, "tetra", "hexahedra", _HEXAHEDRON),
    "hexahedron20": Shape(
        20, "tetra10", "hexahedra", _HEXAHEDRON,
        [*_RING, *([4 + i, 4 + j] for i, j in _RING), *([i, 4 + i] for i in range(4))],
    ),
    "wedge": Shape(6, "tetra", "wedges", _WEDGE),
    "wedge15": Shape(
        15, "tetra10", "wedges", _WEDGE,
        [[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3], [0, 3], [1, 4], [2, 5]],
    ),
}  # fmt: skip
KINDS = (
    (re.compile(r"C3D4(?!\d)"), "tetra"),
    (re.compile(r"C3D10(?!\d)"), "tetra10"),
    (re.compile(r"C3D8(?!\d)"), "hexahedron"),
    (re.compile(r"C3D20(?!\d)"), "hexahedron20"),
    (re.compile(r"C3D6(?!\d)"), "wedge"),
    (re.compile(r"C3D15(?!\d)"), "wedge15"),
    (re.compile(r"(?:STRI|SFM3D|M3D|R3D|CPS|CPE|CAX|S)3(?!\d)"), "triangle"),
    (re.compile(r"(?:STRI|SFM3D|M3D|R3D|CPS|CPE|CAX|S)(?:65|6)(?!\d)"), "triangle6"),
)
"""Types of elements and their shapes; letters behind stand for hybrid, reduced, modified and the like."""
OTHER_SOLIDS = re.compile(r"C3D\d+")
TIE_TOLERANCE = 1e-5
"""Distance between nodes of tied surfaces that are one, over the model's extent."""


@dataclasses.dataclass(frozen=True)
class Element:
    """An element: its shape, one of `SHAPES`, and its nodes."""

    shape: str
    nodes: list[int]


@dataclasses.dataclass(frozen=True)
class Card:
    """A keyword with its line in the file, options by names in capitals, and data lines."""

    number: int
    keyword: str
    options: dict[str, str]
    lines: list[Line]


def dload_surface(magnitude: str) -> str:
    """Return the name of the surface on which ``*DLOAD`` has a pressure of a magnitude."""
    return f"DLOAD {magnitude}"


def split(shape: str, cells: Ints, middles: Ints | None = None) -> tuple[Ints, Ints]:
    """Return the triangles or tetrahedra of elements of a shape (n, nodes), and the element that each is of; elements of second
    order need their middles, see `with_middles`.

    Each face is halved from its corner of the lowest number, and each element filled from its own, so that neighbours meet
    face to face whatever their shapes. Dompierre and others 1999, "How to subdivide pyramids, prisms and hexahedra into
    tetrahedra".
    """
    kind = SHAPES[shape]
    if kind.nodes == SHAPES[kind.piece].nodes:
        return cells, np.arange(len(cells))
    corners = cells[:, : kind.corners]
    lowest = corners.argmin(axis=1)
    pieces, owners = [], []
    for side in kind.sides:
        turned = _from_lowest(corners, np.array(side))
        free = (turned != lowest[:, None]).all(axis=1)
        for half in ([0, 1, 2], [0, 2, 3])[: len(side) - 2]:
            pieces.append(np.column_stack([lowest[free], turned[free][:, half]]))
            owners.append(np.flatnonzero(free))
    local, owner = np.concatenate(pieces), np.concatenate(owners)
    if middles is not None:
        cells = np.column_stack([cells, middles])
        ends = local[:, mesh_arrays.EDGES]
        local = np.column_stack([local, kind.between[ends[..., 0], ends[..., 1]]])
    return np.take_along_axis(cells[owner], local, axis=1), owner


def _from_lowest(corners: Ints, side: Ints) -> Ints:
    """Return the corners of one side of elements by their places, beginning with that of the lowest number."""
    first = corners[:, side].argmin(axis=1)
    return np.asarray(side[(first[:, None] + np.arange(len(side))) % len(side)])


def with_middles(elements: Mapping[str, Ints], points: Array) -> tuple[dict[str, Ints], Array]:
    """Return the nodes to add to hexahedra and wedges of second order, in the middles of their squares, once for two that
    share one, and of hexahedra themselves; and the points with these."""
    own = {shape: cells for shape, cells in elements.items() if SHAPES[shape].edges and SHAPES[shape].squares}
    squares = [(cells, kind, side) for shape, cells in own.items() for kind in [SHAPES[shape]] for side in kind.squares]
    if not squares:
        return {}, points
    keys = np.concatenate([np.sort(cells[:, side], axis=1) for cells, _, side in squares])
    places = [
        0.5 * points[cells[:, kind.inside(side)]].sum(axis=1) - 0.25 * points[cells[:, side]].sum(axis=1)
        for cells, kind, side in squares
    ]
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    numbers = np.split(len(points) + number.ravel(), np.cumsum([len(cells) for cells, _, _ in squares])[:-1])
    points = np.concatenate([points, np.concatenate(places)[first]])
    middles = {}
    for shape, cells in own.items():
        count = len(SHAPES[shape].squares)
        columns, numbers = numbers[:count], numbers[count:]
        if SHAPES[shape].corners == 8:
            columns.append(len(points) + np.arange(len(cells)))
            inner = 0.25 * (points[cells[:, 8:]].sum(axis=1) - points[cells[:, :8]].sum(axis=1))
            points = np.concatenate([points, inner])
        middles[shape] = np.column_stack(columns)
    return middles, points


def _halved(sides: Ints) -> Ints:
    """Return the triangles (t, 3) of sides (n, 4), of which triangles repeat their last corner, split as elements are."""
    turned = np.take_along_axis(sides, _from_lowest(sides, np.arange(4)), axis=1)
    halves = np.concatenate([turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]])
    ends = np.sort(halves, axis=1)
    return halves[(ends[:, 0] != ends[:, 1]) & (ends[:, 1] != ends[:, 2])]


def _among(owner: Ints, members: Ints) -> NDArray[np.bool_]:
    """Return which rows of pairs of body and number are among others."""
    shift = 1 + max(int(owner[:, 1].max(initial=0)), int(members[:, 1].max(initial=0)))
    return np.isin(owner[:, 0] * shift + owner[:, 1], members[:, 0] * shift + members[:, 1])


def _plain(name: str) -> str:
    return re.sub(r"\W+", "_", name).strip("_").lower()


@dataclasses.dataclass(frozen=True, eq=False)
class _Body:
    """A body of a deck where its instance stands: points (n, 3); numbers and nodes of elements by shape; by name nodes, sides
    (n, 4) by their corners, of which triangles repeat the last, and numbers of elements of sets and of materials."""

    name: str
    scope: Scope
    points: Array
    row: dict[int, int]
    elements: dict[str, tuple[Ints, Ints]]
    node_sets: dict[str, Ints]
    faces: dict[str, Ints]
    cell_sets: dict[str, Ints]
    sections: dict[str, Ints]

    @classmethod
    def of(cls, deck: Deck, name: str, scope: Scope) -> _Body:
        row = {number: i for i, number in enumerate(scope.nodes)}
        blocks = defaultdict[str, list[int]](list)
        for number, element in scope.cells.items():
            blocks[element.shape].append(number)
        try:
            elements = {
                shape: (np.array(block), np.array([[row[n] for n in scope.cells[i].nodes] for i in block]))
                for shape, block in blocks.items()
            }
        except KeyError as error:
            raise GeometryError(f"file {deck.file} has cells with undefined nodes ({error})") from None
        node_sets, cell_sets, sections = (
            {
                spelled: np.array(
                    sorted(deck._members(name, scope, where, sets, getattr(where, kind)[text], ((kind, text),))), int
                )
                for spelled, where, text in deck._names(name, scope, kind)
            }
            for kind, sets in (("node_sets", "node_sets"), ("cell_sets", "cell_sets"), ("sections", "cell_sets"))
        )
        node_sets = {key: np.array([row[n] for n in nodes.tolist() if n in row], int) for key, nodes in node_sets.items()}
        faces = {}
        for spelled, where, text in deck._names(name, scope, "surfaces"):
            nodes, sides = deck._sides(name, scope, where, where.surfaces[text], (("surfaces", text),))
            if nodes:
                node_sets[spelled] = np.array([row[n] for n in sorted(nodes) if n in row], int)
            if sides:
                faces[spelled] = np.array([[row[element.nodes[i]] for i in (*half, half[-1])[:4]] for element, half in sides])
        points = np.array(list(scope.nodes.values()), dtype=float).reshape(-1, 3)
        points = _placed_nodes(points, deck.places.get(name, []))
        return cls(name, scope, points, row, elements, node_sets, faces, cell_sets, sections)

    def nodes_of(self, deck: Deck, surface: str) -> Ints:
        """Return the rows of the nodes of a surface, those inside edges among them; empty where it has none here."""
        rows = set[int]()
        for _, where, text in deck._names(self.name, self.scope, "surfaces"):
            if text == surface.upper():
                nodes, sides = deck._sides(self.name, self.scope, where, where.surfaces[text], (("surfaces", text),))
                rows |= {self.row[n] for n in nodes if n in self.row}
                for element, half in sides:
                    rows |= {self.row[element.nodes[i]] for i in (*half, *SHAPES[element.shape].inside(half))}
        return np.array(sorted(rows), dtype=np.int64)


UNREAD = ("SYSTEM", "NGEN", "NCOPY", "NFILL", "NMAP", "ELGEN", "ELCOPY", "IMPORT", "SUBMODEL")
"""Keywords that make or move nodes or elements."""

NODES_OF = "nodes of "
"""Before the name of a set of elements whose nodes are in a set."""

Within = tuple[tuple[str, str], ...]
"""Kinds and names of the sets and surfaces that one is read for, so that none holds itself."""
Line = tuple[int, list[str]]
"""Number in the file, and words between the commas."""


@dataclasses.dataclass
class Scope:
    """Nodes, elements, sets and surfaces of a part, an instance, the assembly or the model, by their numbers and by names in
    capitals.

    Of a surface there are sets, or numbers, each with which side of these elements belongs to it: ``S1`` and on; ``NODES`` of a
    surface of nodes; all where there is none. ``sections`` are sets of elements by material, ``spelled`` the names as written,
    and ``internal`` those that a program made for itself.
    """

    nodes: dict[int, list[float]] = dataclasses.field(default_factory=dict)
    cells: dict[int, Element] = dataclasses.field(default_factory=dict)
    node_sets: dict[str, list[str]] = dataclasses.field(default_factory=dict)
    cell_sets: dict[str, list[str]] = dataclasses.field(default_factory=dict)
    surfaces: dict[str, list[tuple[str, str]]] = dataclasses.field(default_factory=dict)
    sections: dict[str, list[str]] = dataclasses.field(default_factory=dict)
    spelled: dict[str, str] = dataclasses.field(default_factory=dict)
    internal: set[str] = dataclasses.field(default_factory=set)


def _blocks(text: str) -> Iterator[tuple[int, str, dict[str, str], list[Line]]]:
    """Yield the keywords of a deck with their line, options by names in capitals, and data lines."""
    head, lines, begun = "", list[Line](), 0
    for number, line in enumerate([*text.splitlines(), "*END"], 1):
        line = line.strip()
        if line.startswith("**") or not line:
            continue
        if head.endswith(",") and not lines and begun:  # goes on in this line
            head += line
        elif line.startswith("*"):
            if begun:
                yield begun, *_options(head), lines
            head, lines, begun = line, [], number
        elif begun:
            lines.append((number, [word.strip() for word in line.split(",")]))


def _options(head: str) -> tuple[str, dict[str, str]]:
    keyword, *options = (word.strip() for word in head[1:].split(","))
    pairs = (option.partition("=") for option in options if option)
    return " ".join(keyword.upper().split()), {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}


def _has_solids(scope: Scope) -> bool:
    return any(not element.shape.startswith("triangle") for element in scope.cells.values())


def _placed_nodes(points: Array, lines: list[list[float]]) -> Array:
    """Return the places of a part's nodes where its instance stands, from its data lines: a translation, and after it a turn,
    about the axis through two points, by an angle in degrees."""
    for line in lines:
        if len(line) < 7:
            points = points + np.array([*line, 0.0, 0.0, 0.0])[:3]
        else:
            first, second = np.array(line[:3]), np.array(line[3:6])
            axis = (second - first) / np.linalg.norm(second - first)
            turn = scipy.spatial.transform.Rotation.from_rotvec(np.radians(line[6]) * axis)
            points = first + turn.apply(points - first)
    return points
