"""The solids of a STEP file: one, or several that are glued where they touch, each a region with its own name.

A solid's name is that of its body in the file, else that of its part. Bodies' names do not come through Gmsh; they travel as
colours, as faces' names do (`geometries.face_labels`).
"""

from __future__ import annotations

import dataclasses
import re
from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np

from geometries.errors import GeometryError
from geometries.face_labels import solid_names
from geometries.region_names import region_name

if TYPE_CHECKING:
    from geometries.imported import ImportedActuator

MAIN = "solid"
"""Region of a file with one solid."""
NAMELESS = re.compile(r"Open CASCADE STEP translator.*|SOLID|COMPOUND|")


@dataclasses.dataclass(frozen=True)
class Solids:
    """What is solid in the current Gmsh model.

    Attributes:
        regions: Volumes by region.
        pieces: For each of the file's surfaces, in their order, those that gluing made of it; empty if nothing was glued.
    """

    regions: dict[str, list[int]]
    pieces: tuple[tuple[int, ...], ...] = ()

    @property
    def tags(self) -> list[int]:
        return [tag for tags in self.regions.values() for tag in tags]

    @property
    def boundary(self) -> list[int]:
        """Surfaces around all of it; those between two solids are none."""
        import gmsh  # type: ignore[import-untyped]

        volumes = [(3, tag) for tag in self.tags]
        return [abs(tag) for _, tag in gmsh.model.getBoundary(volumes, combined=len(volumes) > 1, oriented=False)]

    @property
    def volume(self) -> float:
        """In m3."""
        import gmsh

        return sum(float(gmsh.model.occ.getMass(3, tag)) for tag in self.tags)

    @property
    def centre(self) -> np.ndarray:
        """Centre of mass in m, shape (3,)."""
        import gmsh

        masses = [gmsh.model.occ.getMass(3, tag) for tag in self.tags]
        return np.average([gmsh.model.occ.getCenterOfMass(3, tag) for tag in self.tags], axis=0, weights=masses)

    def holds(self, place: list[float]) -> bool:
        """Whether a point (m) lies in the solid."""
        import gmsh

        return any(gmsh.model.isInside(3, tag, place) for tag in self.tags)


def glued(part: ImportedActuator) -> Solids:
    """The solids of the current Gmsh model, read from a part's file, glued where they touch.

    Raises:
        GeometryError: There is none; they overlap; or one touches no other.
    """
    import gmsh

    volumes = gmsh.model.getEntities(3)
    if len(volumes) == 1:
        return Solids({MAIN: [volumes[0][1]]})
    if not volumes:
        raise GeometryError(f"file {part.file} holds no solid, but {len(gmsh.model.getEntities(2))} faces")
    names = _names(part.file, volumes)
    surfaces = gmsh.model.getEntities(2)
    _, made = gmsh.model.occ.fragment(volumes, surfaces)
    gmsh.model.occ.synchronize()
    regions: dict[str, list[int]] = defaultdict(list)
    owner: dict[int, str] = {}
    for name, found in zip(names, made, strict=False):
        for _, tag in found:
            if tag in owner:
                raise GeometryError(
                    f"file {part.file}: the solids {owner[tag]} and {name} overlap; cut one by the other"
                )
            owner[tag] = name
            regions[name].append(tag)
    pieces = tuple(tuple(tag for _, tag in found) for found in made[len(volumes) :])
    solids = Solids(dict(regions), pieces)
    _check_touching(part, solids, owner)
    return solids


def _names(file: str, volumes: list[tuple[int, int]]) -> list[str]:
    """Names of the regions of a file's solids, in the order of the volumes."""
    import gmsh

    found = []
    for number, (own, volume) in enumerate(zip(solid_names(file), volumes, strict=True), 1):
        label = str(gmsh.model.getEntityName(*volume)).rpartition("/")[2]
        text = next((text for text in (own, label) if not NAMELESS.fullmatch(text)), f"solid {number}")
        found.append(region_name(text))
    return found


def _check_touching(part: ImportedActuator, solids: Solids, owner: dict[int, str]) -> None:
    """Refuse a solid that shares no face with those that the first one hangs together with."""
    import gmsh

    beside = defaultdict(set)
    for tag in solids.tags:
        for _, face in gmsh.model.getBoundary([(3, tag)], oriented=False):
            beside[face].add(tag)
    reached, left = {solids.tags[0]}, set(solids.tags[1:])
    while new := {tag for both in beside.values() if both & reached for tag in both & left}:
        reached |= new
        left -= new
    if left:
        names = ", ".join(sorted({owner[tag] for tag in left}))
        raise GeometryError(
            f"file {part.file}: {names} shares no face with {owner[solids.tags[0]]}; the solids of a part are bonded, so they "
            "have to touch"
        )
