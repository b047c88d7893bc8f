"""A STEP file in Gmsh: its unit, its volumes, its mesh."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

import numpy as np

from geometries.actuator import Vector
from geometries.apart import apart
from geometries.errors import GeometryError, MeshingError
from geometries.fields import shown
from geometries.imported_cells import MOST_TRIANGLES, expected_triangles
from geometries.imported_part import Reading, cavity_role
from geometries.imported_roles import extent, find_roles, outward
from geometries.imported_solids import Solids, glued
from geometries.selections import point

if TYPE_CHECKING:
    from geometries.imported import ImportedActuator

FINE = 40
"""Cells around a circle in the mesh of walls that the cavities' volumes are measured on."""


@functools.lru_cache(maxsize=32)
def read_part(part: ImportedActuator, digest: str) -> Reading:
    """Open the file, in a process of its own, and check every choice against it.

    Args:
        part: The part.
        digest: Hash of the file's bytes: another content is another reading.

    Raises:
        GeometryError: A file or a choice that makes no device.
    """
    try:
        return apart(_read, part)
    except MeshingError as error:
        raise GeometryError(f"file {part.file} cannot be read: {error}") from None


def _read(part: ImportedActuator) -> Reading:
    import gmsh  # type: ignore[import-untyped]

    from geometries.meshing import private_model

    with private_model():
        solids = open_part(part)
        roles = find_roles(part, solids)
        expected = expected_triangles(solids.boundary, part.cell_size, max(part.curvature, FINE))
        if expected > MOST_TRIANGLES:
            raise GeometryError(
                f"cell_size is {shown(part.cell_size, 'm')} with curvature {part.curvature:g}; about {expected:.2g} triangles "
                f"are expected on the part's faces and {MOST_TRIANGLES:,} are allowed"
            )
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", FINE)
        gmsh.option.setNumber("Mesh.MeshSizeMax", part.cell_size)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(2)
        volumes = tuple(_enclosed(solids, roles[cavity_role(i)]) for i in range(part.cavity_count))
        return Reading(
            outward(part, solids, roles),
            _gauge(part, roles.get("support", [])),
            solids.volume,
            volumes,
            tuple(solids.regions) if len(solids.regions) > 1 else (),
        )


def build_part(part: ImportedActuator) -> None:
    """Fill the current Gmsh model with the part, its roles and its cell sizes (m)."""
    import gmsh

    solids = open_part(part)
    for name, tags in solids.regions.items():
        gmsh.model.addPhysicalGroup(3, tags, name=name)
    for role, tags in find_roles(part, solids).items():
        gmsh.model.addPhysicalGroup(2, tags, name=role)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", part.curvature)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 1)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: min(other, part.cell_size))


def open_part(part: ImportedActuator, unit: str = "M") -> Solids:
    """Read the file in metres, or another of the CAD kernel's units, whatever its own; its solids are glued."""
    import gmsh

    gmsh.option.setString("Geometry.OCCTargetUnit", unit)
    gmsh.option.setNumber("Geometry.OCCImportLabels", 1)
    try:
        gmsh.model.occ.importShapes(part.file, format="step")
        gmsh.model.occ.synchronize()
    except Exception as error:  # Gmsh raises bare Exception
        raise GeometryError(
            f"file {part.file} cannot be read as STEP ({str(error).strip() or 'no reason given'})"
        ) from None
    return glued(part)


def _enclosed(solids: Solids, tags: list[int]) -> float:
    """Volume within a wall by the divergence theorem on its mesh, -1/3 int x . n: cut planes through the origin add nothing."""
    import gmsh

    total = 0.0
    for tag in tags:
        for kind in gmsh.model.mesh.getElementTypes(2, tag):
            local, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss4")
            jacobians, determinants, places = gmsh.model.mesh.getJacobians(kind, local, tag)
            normals, at = jacobians.reshape(-1, 3, 3)[:, 2], places.reshape(-1, 3)
            # A face's mesh may be turned either way; the solid lies behind its outward normal.
            turned = 1.0 if solids.holds(list(at[0] - 1e-4 * extent() * normals[0])) else -1.0
            along = np.einsum("ij,ij->i", at, normals) * determinants
            total -= turned * float((along.reshape(-1, len(weights)) @ weights).sum()) / 3.0
    return total


def _gauge(part: ImportedActuator, support: list[int]) -> Vector:
    """The corner nearest to the wanted point, or the one farthest from the held faces, or from the origin."""
    import gmsh

    corners = np.array([gmsh.model.getValue(0, tag, []) for _, tag in gmsh.model.getEntities(0)])
    if not len(corners):
        raise GeometryError(f"file {part.file} has no corner to follow; split an edge where the motion matters")
    if part.gauge_point:
        away = np.linalg.norm(corners - point("gauge_point", part.gauge_point), axis=1)
        if away.min() > 1e-4:
            near = ", ".join(f"{value * 1e3:.6g}" for value in corners[away.argmin()])
            raise GeometryError(
                f"gauge_point is {part.gauge_point!r}; it must be a corner, the nearest is at {near} mm"
            )
        x, y, z = corners[away.argmin()]
    else:
        held = np.mean([gmsh.model.occ.getCenterOfMass(2, tag) for tag in support] or [np.zeros(3)], axis=0)
        x, y, z = corners[np.linalg.norm(corners - held, axis=1).argmax()]
    return float(x), float(y), float(z)
