"""Read the nodes, tetrahedra, triangles, sets and surfaces of a deck of Abaqus or CalculiX, and where its instance stands.

Only one body is read: bodies of an assembly are not bonded where they touch. What would change nodes or elements in ways that
are not read is an error.
"""

from __future__ import annotations

import dataclasses
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from geometries import mesh_arrays
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
        element_match = TETRAHEDRA.match(kind) or TRIANGLES.match(kind)
        if not element_match:
            if OTHER_SOLIDS.match(kind):
                raise GeometryError(
                    f"file {self.file} has cells of type {kind}; only tetrahedra of 4 or 10 nodes are supported"
                )
            self._add("cell_sets", options.get("ELSET", ""), ())  # lines, masses and the like: known, but not read
            return
        width = 1 + (6 if element_match[1] == "65" else int(element_match[1]))
        numbers = [int(word) for _, words in lines for word in words if word]
        if len(numbers) % width:
            raise ValueError(f"{len(numbers)} numbers are no elements of {width - 1} nodes")
        for i in range(0, len(numbers), width):
            self.scope.cells[numbers[i]] = numbers[i + 1 : i + width]
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
        """Return the body as a mesh of meshio's; `GeometryError` for none, or several."""
        import meshio

        bodies = {name: body for name, body in (self.instances or self.parts).items() if _has_tetrahedra(body)}
        if _has_tetrahedra(self.model):
            bodies[""] = self.model
        if len(bodies) > 1:
            names = ", ".join(name or "the model itself" for name in bodies)
            raise GeometryError(
                f"file {self.file} has {len(bodies)} bodies ({names}); the bodies of an assembly are not bonded where they "
                "touch: merge them into one part, with common nodes, where it is meshed"
            )
        name, body = next(iter(bodies.items()), ("", self.model))
        row = {number: i for i, number in enumerate(body.nodes)}
        blocks = defaultdict[int, list[int]](list)
        for number, nodes in body.cells.items():
            blocks[len(nodes)].append(number)
        kinds = {3: "triangle", 6: "triangle6", 4: "tetra", 10: "tetra10"}
        try:
            cells = [(kinds[width], [[row[n] for n in body.cells[i]] for i in block]) for width, block in blocks.items()]
        except KeyError as error:
            raise GeometryError(f"file {self.file} has cells with undefined nodes ({error})") from None
        points = np.array(list(body.nodes.values()), dtype=float).reshape(-1, 3)
        node_sets, cell_sets = (
            {
                spelled: self._members(name, body, scope, kind, getattr(scope, kind)[text], ((kind, text),))
                for spelled, scope, text in self._names(name, body, kind)
            }
            for kind in ("node_sets", "cell_sets")
        )
        surfaces = {
            spelled: self._sides(name, body, scope, scope.surfaces[text], (("surfaces", text),))
            for spelled, scope, text in self._names(name, body, "surfaces")
        }
        node_sets |= {key: nodes for key, (nodes, _) in surfaces.items() if nodes}
        faces = {key: np.array([row[n] for n in node_set if n in row], int) for key, node_set in node_sets.items()}
        # Beside nodes, shape (n,), the corners of triangles, shape (t, 3).
        faces |= {key: np.array([[row[n] for n in side] for side in sides]) for key, (_, sides) in surfaces.items() if sides}
        return meshio.Mesh(
            _placed_nodes(points, self.places.get(name, [])),
            cells,
            point_sets=faces,
            cell_sets={
                key: [np.flatnonzero(np.isin(block, list(cell_set))) for block in blocks.values()]
                for key, cell_set in cell_sets.items()
            },
        )

    def _names(self, name: str, body: Scope, kind: str) -> Iterator[tuple[str, Scope, str]]:
        """Yield the names of the sets or surfaces of a body and of the assembly, where they are, and these in capitals; of one
        of each, that of the body begins with the instance's."""
        for scope in (body, self.assembly) if name else (body,):
            for text in filter(None, getattr(scope, kind)):
                both = scope is body and name and text in getattr(self.assembly, kind)
                yield f"{name}." * bool(both) + scope.spelled[text], scope, text

    def _sides(
        self, name: str, body: Scope, scope: Scope, members: Sequence[tuple[str, str]], within: Within
    ) -> tuple[set[int], list[list[int]]]:
        """Return the nodes of a surface of nodes, and the corners of the sides of elements of another one."""
        nodes, owned = set[int](), list[list[int]]()
        for member, side in members:
            if side == "NODES":
                nodes |= self._members(name, body, scope, "node_sets", [member], within)
                continue
            for cell in sorted(self._members(name, body, scope, "cell_sets", [member], within)):
                corners = body.cells.get(cell, [])
                solid = len(corners) in (4, 10)
                if solid and side not in ("", *SIDE_NAMES):
                    raise GeometryError(
                        f"file {self.file}: the surface {scope.spelled[within[0][1]]} has the side {side!r} of tetrahedra; "
                        f"these have {', '.join(SIDE_NAMES)}"
                    )
                sides = (
                    mesh_arrays.SIDES[[SIDE_NAMES.index(side)]]
                    if solid and side
                    else mesh_arrays.SIDES
                    if solid
                    else mesh_arrays.SIDES[:1]
                )
                owned += [[corners[i] for i in half] for half in sides if corners and not side.startswith("E")]
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
                ids.update(node for cell in cells for node in body.cells.get(cell, ()))
            elif (key := own.upper()) in (known := getattr(where, kind)) and (kind, key) not in within:
                ids |= self._members(name, body, where, kind, known[key], (*within, (kind, key)))
            else:
                of, text = within[-1]
                raise GeometryError(
                    f"file {self.file}: the {'surface' if of == 'surfaces' else 'set'} {scope.spelled.get(text, text)} has "
                    f"{member!r}, which is not defined"
                )
        return ids


TETRAHEDRA = re.compile(r"C3D(4|10)(?!\d)")
TRIANGLES = re.compile(r"(?:STRI|SFM3D|M3D|R3D|CPS|CPE|CAX|S)(3|65|6)(?!\d)")
OTHER_SOLIDS = re.compile(r"C3D\d+")
UNREAD = ("SYSTEM", "NGEN", "NCOPY", "NFILL", "NMAP", "ELGEN", "ELCOPY", "IMPORT", "SUBMODEL")
"""Keywords that make or move nodes or elements."""

NODES_OF = "nodes of "
"""Before the name of a set of elements whose nodes are in a set."""

SIDE_NAMES = ("S1", "S2", "S3", "S4")
"""Of a tetrahedron, in the order of `SIDES`."""

Within = tuple[tuple[str, str], ...]
"""Kinds and names of the sets and surfaces that one is read for, so that none holds itself."""
Line = tuple[int, list[str]]
"""Number in the file, and words between the commas."""


@dataclasses.dataclass
class Scope:
    """Nodes, elements, sets and surfaces of a part, an instance, the assembly or the model, by their numbers and by names in
    capitals.

    Of a surface there are sets, or numbers, each with which side of these elements belongs to it: ``S1`` to ``S4``; ``NODES``
    of a surface of nodes; all where there is none. ``spelled`` has the names as written.
    """

    nodes: dict[int, list[float]] = dataclasses.field(default_factory=dict)
    cells: dict[int, list[int]] = dataclasses.field(default_factory=dict)
    node_sets: dict[str, list[str]] = dataclasses.field(default_factory=dict)
    cell_sets: dict[str, list[str]] = dataclasses.field(default_factory=dict)
    surfaces: dict[str, list[tuple[str, str]]] = dataclasses.field(default_factory=dict)
    spelled: dict[str, str] = dataclasses.field(default_factory=dict)


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


def _has_tetrahedra(scope: Scope) -> bool:
    return any(len(nodes) in (4, 10) for nodes in scope.cells.values())


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
