"""A part meshed elsewhere: a mesh of Gmsh's or Abaqus', or the surfaces of an STL file."""

from __future__ import annotations

import dataclasses
import functools
from typing import ClassVar

import numpy as np

from geometries.errors import GeometryError
from geometries.fields import choice_field, length_field
from geometries.foreign_meshes import FORMATS, read_mesh
from geometries.imported_part import ImportedPart, Reading
from geometries.mesh_roles import cavity_volumes, find_roles, gauge, outward, put_on_planes
from geometries.region_names import region_name
from geometries.registry import register
from geometries.tetrahedra import TO_GMSH, Tetrahedra

UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "inch": 0.0254}


@register
@dataclasses.dataclass(frozen=True, kw_only=True)
class ImportedMesh(ImportedPart):
    """A part from a mesh: ``.msh`` of Gmsh, ``.inp`` of Abaqus and CalculiX, or an ``.stl`` of its surfaces, air's included.

    Cells are tetrahedra, of 4 or of 10 nodes, and are taken as they are. An STL file is filled with cells of ``cell_size``.
    Faces are picked as of a drawing, "named x" by a node set, a set of triangles or a physical surface; cells with a name are
    a region.
    """

    unit: str = choice_field("mm", tuple(UNITS), "unit of the file's lengths, which such files do not tell")
    cell_size: float = length_field(0.003, "longest edge of the cells, of an STL file alone", shape=False)

    meshed: ClassVar[bool] = True
    kind: ClassVar[str] = "mesh (--file part.msh, part.inp or part.stl)"

    def check_cells(self) -> None:
        """Nothing: a mesh is taken as it is."""

    @property
    def mesh(self) -> Tetrahedra:
        """The mesh in m; read once."""
        return _read(self, self.digest())[0]

    @property
    def reading(self) -> Reading:
        return _read(self, self.digest())[1]

    @property
    def regions(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names that the file has for some of the cells."""
        return tuple(self._named)

    @property
    def _named(self) -> dict[str, str]:
        """The file's names by those of the regions."""
        every = len(self.mesh.cells)
        return {region_name(name): name for name, cells in self.mesh.regions.items() if 0 < len(cells) < every}

    @property
    def mesh_order(self) -> int:
        return 1 if self.mesh.cells.shape[1] == 4 else 2

    @property
    def expected_cells(self) -> float:
        return float(len(self.mesh.cells))

    def build(self) -> None:
        """Put the mesh into the current Gmsh model, every role a group of its boundary, every region of its cells."""
        import gmsh  # type: ignore[import-untyped]

        mesh = self.mesh
        second = mesh.cells.shape[1] == 10
        solid = gmsh.model.addDiscreteEntity(3)
        gmsh.model.mesh.addNodes(3, solid, np.arange(1, len(mesh.points) + 1), mesh.points.ravel())
        left = np.ones(len(mesh.cells), dtype=bool)
        parts = []
        for name, given in self._named.items():
            cells = mesh.regions[given]
            inside = cells[left[cells]]
            left[inside] = False
            parts.append((name, inside, gmsh.model.addDiscreteEntity(3)))
        parts.append(("solid", np.flatnonzero(left), solid))
        for name, cells, tag in parts:
            if not len(cells):
                continue
            nodes = mesh.cells[cells][:, TO_GMSH] if second else mesh.cells[cells]
            gmsh.model.mesh.addElementsByType(tag, 11 if second else 4, [], (nodes + 1).ravel())
            gmsh.model.addPhysicalGroup(3, [tag], name=name)
        for role, triangles in find_roles(self, mesh).items():
            tag = gmsh.model.addDiscreteEntity(2)
            gmsh.model.mesh.addElementsByType(tag, 9 if second else 2, [], (mesh.triangles[triangles] + 1).ravel())
            gmsh.model.addPhysicalGroup(2, [tag], name=role)


@functools.lru_cache(maxsize=8)
def _read(part: ImportedMesh, digest: str) -> tuple[Tetrahedra, Reading]:
    """Read the file and check every choice against it.

    Args:
        part: The part.
        digest: Hash of the file's bytes: another content is another reading.
    """
    mesh = read_mesh(part.file, UNITS[part.unit], part.cell_size)
    if not 1e-5 < mesh.extent < 10.0:
        raise GeometryError(
            f"file {part.file} spans {1e3 * mesh.extent:.4g} mm with unit {part.unit!r}; give the unit of its lengths"
        )
    roles = find_roles(part, mesh)
    normals = outward(part, mesh, roles)
    mesh = put_on_planes(mesh, roles, normals)
    volumes = cavity_volumes(part, mesh, roles)
    return mesh, Reading(normals, gauge(part, mesh, roles), mesh.volume, volumes)


__all__ = ["FORMATS", "UNITS", "ImportedMesh"]
