"""Fibres and yarns as springs: one for each integration point and family, with the same energy of its stretch.

A fibre along a has an energy of |F a|, and F a is a sum of the displacements of a cell's nodes, on a face of a facet's. So it
is the length of a spring whose end moves by that sum (`softmodels.mechanics.fibres`, `softmodels.mechanics.fabric`). A fabric's
two families of yarns are such fibres, as long as they do not contract each other and their shear costs nothing.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from geometries.mesh_arrays import MeshArrays
from geometries.tetrahedra import WEIGHTS, Ints, tetrahedron_slopes, triangle_tables
from softmodels.case.decks.springs import Springs
from softmodels.case.decks.supports import Terms
from softmodels.mechanics.directions import helix_at
from softmodels.mechanics.fabric import Fabric
from softmodels.mechanics.fibres import Fibres, slope_of
from softmodels.mechanics.named_places import names_in

Array = npt.NDArray[np.float64]

SMALLEST = 1e-4
LONGEST, SHORTEST = 2.5, 0.3
"""Stretches up to which tables go: their strains grow from `SMALLEST` on by the same factor."""
LONGER, SHORTER = 100, 40
"""Entries of a table beyond a stretch of 1, and below."""


@dataclasses.dataclass(frozen=True)
class Family:
    """Threads in one direction.

    Attributes:
        where: The part's table, and its label, for messages and remarks.
        label: The part's name.
        roles: Faces that they are laid on, or regions; the whole body if empty.
        on_faces: Whether they are on faces.
        axis, angle: Of their direction, in degrees; see `softmodels.mechanics.directions.Helix`.
        hand: -1 of the helix that winds the other way.
        across: Whether they run square to that direction, in the face.
        stiffness: In N/m on faces, in Pa else.
        law, exponent, slack: See `softmodels.mechanics.fibres.Fibres`.
    """

    label: str
    roles: list[str]
    on_faces: bool
    axis: tuple[float, ...]
    angle: float
    stiffness: float
    hand: float = 1.0
    across: bool = False
    law: str = "standard"
    exponent: float = 1.0
    slack: bool = False


def threaded(part: object) -> list[Family]:
    """The families of a part; none of one that is no thread, or that is more than its threads."""
    if isinstance(part, Fibres):
        on_faces = part.stiffness > 0.0
        return [
            Family(
                part.label, names_in(part.on), on_faces, part.axis, part.angle, part.stiffness or part.modulus,
                hand, False, part.law, part.exponent, part.slack,
            )
            for hand in (1.0, -1.0)[: part.helices]
        ]  # fmt: skip
    if isinstance(part, Fabric) and not part.poisson and not part.shear:
        along = Family(part.label, names_in(part.on), True, part.axis, part.angle, part.along, slack=part.slack)
        return [along, dataclasses.replace(along, stiffness=part.across, across=True)]
    return []


def threads(mesh: MeshArrays, parts: Sequence[object], size: float) -> list[Springs]:
    """The springs of a device's fibres and fabrics.

    Args:
        mesh: The mesh of its slice.
        parts: What is added to the device.
        size: Its size in m, which the springs are long.
    """
    return [_springs(family, mesh, size) for part in parts for family in threaded(part)]


def _springs(family: Family, mesh: MeshArrays, size: float) -> Springs:
    nodes, places, normals, slopes, weights = (_on_faces if family.on_faces else _in_regions)(family, mesh)
    along = helix_at(places, family.axis, family.angle, family.hand)
    if normals is not None:
        along -= np.einsum("ki,ki->k", along, normals)[:, None] * normals
        if family.across:
            along = np.cross(normals, along)
    lengths = np.linalg.norm(along, axis=1)
    laid = lengths > 1e-6  # elsewhere there is no such direction
    along = along[laid] / lengths[laid, None]
    # Of F a - a: what each node's displacement adds, in 1/m.
    factors = np.einsum("kni,ki->kn", slopes[laid], along)
    terms = [_rows(own, size * one) for own, one in zip(nodes[laid], factors, strict=True)]
    stretches = np.concatenate(
        [
            1 - np.geomspace(1 - SHORTEST, SMALLEST, SHORTER),
            [1.0],
            1 + np.geomspace(SMALLEST, LONGEST - 1, LONGER),
        ]
    )
    slope = family.stiffness * slope_of(family.law, stretches**2 - 1, family.exponent, family.slack)
    forces = np.outer(weights[laid], slope * 2 * stretches / size)
    elongations = np.broadcast_to(size * (stretches - 1), forces.shape)
    where = ", ".join(family.roles) or "the body"
    what = f"threads: springs as long as a thread at the integration points of {where} is stretched"
    return Springs(family.label, what, np.zeros(3), size * along, terms, elongations, forces)


def _rows(nodes: Ints, factors: Array) -> tuple[Terms, Terms, Terms]:
    """What the three components of an end's displacement are the sums of."""
    pairs = [(int(node), float(factor)) for node, factor in zip(nodes, factors, strict=True) if abs(factor) > 1e-12]
    x, y, z = ({(node, i): factor for node, factor in pairs} for i in range(3))
    return x, y, z


type Points = tuple[Ints, Array, Array | None, Array, Array]
"""Of each integration point its nodes, place, the face's normal, the slopes of the nodes' shape functions, volume or area."""


def _on_faces(family: Family, mesh: MeshArrays) -> Points:
    nodes = np.concatenate([mesh.triangles(role) for role in family.roles])
    values, *tables = triangle_tables(nodes.shape[1])
    places, a, b = (np.einsum("qn,kni->kqi", table, mesh.points[nodes]) for table in (values, *tables))
    normals = np.cross(a, b)
    areas = np.linalg.norm(normals, axis=2)
    # The slopes along the face, square to its normal: with the inverse of the tangents and the normal.
    inverse = np.linalg.inv(np.stack([a, b, normals], axis=2))
    slopes = np.einsum("qnj,kqij->kqni", np.stack(tables, axis=2), inverse[..., :2])
    k, q, n, _ = slopes.shape
    whole = np.repeat(nodes, q, axis=0)
    return (
        whole,
        places.reshape(-1, 3),
        (normals / areas[..., None]).reshape(-1, 3),
        slopes.reshape(k * q, n, 3),
        (areas * WEIGHTS / 2).ravel(),
    )


def _in_regions(family: Family, mesh: MeshArrays) -> Points:
    chosen = [mesh.regions[name] for name in family.roles] or [np.arange(len(mesh.cells))]
    nodes = mesh.cells[np.concatenate(chosen)]
    values, tables = tetrahedron_slopes()
    places = np.einsum("qn,kni->kqi", values, mesh.points[nodes])
    jacobians = np.einsum("qnj,kni->kqij", tables, mesh.points[nodes])
    slopes = np.einsum("qnj,kqji->kqni", tables, np.linalg.inv(jacobians))
    k, q, n, _ = slopes.shape
    volumes = np.abs(np.linalg.det(jacobians)) / 24
    return np.repeat(nodes, q, axis=0), places.reshape(-1, 3), None, slopes.reshape(k * q, n, 3), volumes.ravel()
