"""Pieces of faces and edges between faces, by short texts that stand wherever a component names a face.

    "tip"                                   a face of the device
    "top, tip"                              several faces
    "tip within z > 14 mm"                  the facets of a face whose middle lies there
    "top within 5 mm < r < 9 mm and x > 0 mm"
    "edge of tip and top"                   the edges that two faces share; also with within

Coordinates are those of the undeformed device: x, y, z, the distance r from the z axis, and |x|, |y|, |z|. Only comparisons
with lengths are read, joined by ``and``.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from softmodels.common.arrays import Array
from softmodels.common.errors import ComponentError
from softmodels.common.lazy import la, meshes
from softmodels.common.units import UnitError, brief, quantity
from softmodels.mechanics.mpi import any_rank, largest

Entities = tuple[int, npt.NDArray[np.int32]]
"""Dimension and local indices of mesh entities."""
WITHIN, EDGE = " within ", re.compile(r"edge of (\S+) and (\S+)")
COORDINATE = r"\|[xyz]\||[xyzr]"
COMPARISON = re.compile(rf"(?:(.+?)(<=?)\s*)?({COORDINATE})\s*(?:(<=?|>=?)(.+))?")
EXAMPLE = "'tip within z > 14 mm', 'top within 5 mm < r < 9 mm and x > 0 mm' or 'edge of tip and top'"


@dataclasses.dataclass(frozen=True)
class Piece:
    """A face or an edge, or a part of it.

    Attributes:
        faces: The face, or the two faces whose edge it is.
        bounds: Coordinates with their lowest and highest values in m.
        text: As written.
    """

    faces: tuple[str, ...]
    bounds: tuple[tuple[str, float, float], ...]
    text: str

    def holds(self, places: Array) -> npt.NDArray[np.bool_]:
        """Return which places in device coordinates, m, shape (n, 3), lie within the bounds."""
        found = np.ones(len(places), dtype=bool)
        for name, low, high in self.bounds:
            values = np.hypot(places[:, 0], places[:, 1]) if name == "r" else places[:, "xyz".index(name.strip("|"))]
            values = np.abs(values) if name.startswith("|") else values
            found &= (values >= low) & (values <= high)
        return found


def pieces_in(text: str) -> list[Piece]:
    """Return the pieces of a text, separated by commas; `ComponentError` for a part that has none of the forms above."""
    return [_piece(part.strip()) for part in text.split(",") if part.strip()]


def is_plain(text: str) -> bool:
    """Return whether a text is the name of one face."""
    return "," not in text and WITHIN not in text and not EDGE.match(text.strip())


def _piece(text: str) -> Piece:
    face, _, condition = text.partition(WITHIN)
    if text.endswith(WITHIN.rstrip()):
        raise ComponentError(f"{brief(text)} has no condition; write {EXAMPLE}")
    between = EDGE.fullmatch(face.strip())
    names = between.groups() if between else (face.strip(),)
    parts = condition.split(" and ") if condition else []
    return Piece(names, tuple(bound for part in parts for bound in _bounds(text, part.strip())), text)


def _bounds(text: str, part: str) -> list[tuple[str, float, float]]:
    found = COMPARISON.fullmatch(part)
    if not found or not (found[1] or found[5]) or (found[1] and found[4] and ">" in found[4]):
        if coordinate := re.match(r"\s*\|?([A-Za-z_]\w*)\|?\s*[<>]", part):
            raise ComponentError(
                f"{brief(text)} uses the coordinate {coordinate[1]!r}; x, y, z, r, |x|, |y| and |z| are known"
            )
        raise ComponentError(
            f"{brief(text)}: {brief(part)} is not a comparison of a coordinate with a length; write {EXAMPLE}"
        )
    low, high = -np.inf, np.inf
    if found[1]:
        low = _length(text, found[1])
    if found[5]:
        value = _length(text, found[5])
        low, high = (low, value) if "<" in found[4] else (value, high)
    return [(found[3], low, high)]


def _length(text: str, value: str) -> float:
    plain = value.strip()
    if re.fullmatch(r"[-+]?[\d.]+(e[-+]?\d+)?", plain):
        raise ComponentError(f"{brief(text)}: the length {plain} has no unit; write it like {plain} mm")
    try:
        return quantity(plain, "m")
    except UnitError as error:
        raise ComponentError(f"{brief(text)}: {error}") from None


class Roles(dict[str, Entities]):
    """Mesh entities by role. A text such as ``"tip within z > 14 mm"`` or ``"top, tip"`` is found when it is first asked for;
    iteration goes over the mesh's own roles.

    Args:
        own: The mesh's own.
        find: Returns the entities of a text that is not one of them.
    """

    def __init__(self, own: Mapping[str, Entities], find: Callable[[Roles, str], Entities]):
        super().__init__(own)
        self._find, self._found = find, dict[str, Entities]()

    def __missing__(self, text: str) -> Entities:
        if text not in self:
            raise KeyError(text)
        if text not in self._found:
            self._found[text] = self._find(self, text)
        return self._found[text]

    def __contains__(self, text: object) -> bool:
        if super().__contains__(text):
            return True
        if not isinstance(text, str) or is_plain(text):
            return False
        return all(super(Roles, self).__contains__(face) for piece in pieces_in(text) for face in piece.faces)

    def get[Other](self, text: str, default: Other = None) -> Entities | Other:  # type: ignore[assignment, override]
        return self[text] if text in self else default  # noqa: SIM401


def selected(mesh: meshes.Mesh, actuator: Actuator, roles: Mapping[str, Entities], text: str) -> Entities:
    """Return the local entities of a text's pieces; all ranks call it. `ComponentError` if they select nothing, or faces and
    edges at once."""
    found, dimensions = [], set()
    for piece in pieces_in(text):
        dimension, entities = _common(mesh, roles, piece)
        entities = entities[piece.holds(_middles(mesh, actuator, dimension, entities))]
        if not any_rank(mesh.comm, bool(len(entities))):
            raise ComponentError(f"{brief(piece.text)} selects nothing; {_spans(mesh, actuator, roles, piece)}")
        found.append(entities)
        dimensions.add(dimension)
    if len(dimensions) > 1:
        raise ComponentError(f"{brief(text)} has faces and edges; name one kind at a time")
    return dimensions.pop(), np.unique(np.concatenate(found))


def cells_within(mesh: meshes.Mesh, actuator: Actuator, condition: str) -> npt.NDArray[np.int32]:
    """Return the local cells whose middles meet a condition such as ``"5 mm < r < 9 mm"``, ghosts too; all ranks call it.
    `ComponentError` if they are none."""
    index_map = mesh.topology.index_map(mesh.topology.dim)
    cells = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    cells = cells[condition_of(condition).holds(_middles(mesh, actuator, mesh.topology.dim, cells))]
    if not any_rank(mesh.comm, bool(len(cells))):
        raise ComponentError(f"{brief(condition)} selects no cells; coordinates are those of the undeformed device")
    return cells


def condition_of(text: str) -> Piece:
    """Return a condition without a face, such as ``"5 mm < r < 9 mm"``; `ComponentError` if it is none."""
    return _piece(f"cells{WITHIN}{text}")


def _middles(mesh: meshes.Mesh, actuator: Actuator, dimension: int, entities: npt.NDArray[np.int32]) -> Array:
    """Return the middles of entities in device coordinates, m, shape (n, 3)."""
    mesh.topology.create_connectivity(dimension, mesh.topology.dim)
    middles = meshes.compute_midpoints(mesh, dimension, entities) if len(entities) else np.empty((0, 3))
    return actuator.device_points(middles * actuator.size)


def _common(mesh: meshes.Mesh, roles: Mapping[str, Entities], piece: Piece) -> Entities:
    """Return the facets of a face, or the edges that are of two faces; of an edge between ranks, one of them may know each."""
    if len(piece.faces) == 1:
        return roles[piece.faces[0]]
    topology, dimension = mesh.topology, mesh.topology.dim - 2
    topology.create_entities(dimension)
    topology.create_connectivity(dimension + 1, dimension)
    links = topology.connectivity(dimension + 1, dimension)
    of_both: npt.NDArray[np.bool_] | bool = True
    for face in piece.faces:
        if roles[face][0] != dimension + 1:
            raise ComponentError(f"{brief(piece.text)}: {face!r} is not a face, so it has no edges")
        marked = la.vector(topology.index_map(dimension), 1)
        for facet in roles[face][1]:
            marked.array[links.links(facet)] = 1.0
        marked.scatter_reverse(la.InsertMode.add)
        marked.scatter_forward()
        of_both = of_both & (marked.array > 0.0)
    return dimension, np.flatnonzero(of_both).astype(np.int32)


def _spans(mesh: meshes.Mesh, actuator: Actuator, roles: Mapping[str, Entities], piece: Piece) -> str:
    """Return where the entities lie from which a piece was to be selected, as a clause."""
    dimension, entities = _common(mesh, roles, piece)
    if not any_rank(mesh.comm, bool(len(entities))):
        return f"the faces {' and '.join(piece.faces)} share no edge in the modelled part"
    places = _middles(mesh, actuator, dimension, entities) * 1e3
    low, high = (
        [largest(mesh.comm, float((s * places[:, k]).max(initial=-np.inf))) for k in range(3)] for s in (-1.0, 1.0)
    )
    spans = ", ".join(f"{axis} {0.0 - a:.4g} to {b:.4g} mm" for axis, a, b in zip("xyz", low, high, strict=True))
    return f"the middles of the {'facets' if len(piece.faces) == 1 else 'edges'} of {' and '.join(piece.faces)} lie in {spans}"
