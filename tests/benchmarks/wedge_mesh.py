"""Write the benchmark's mesh: the thin disk's wedge with sharp corners and cells of one size everywhere.

    uv run python tests/benchmarks/wedge_mesh.py 2.0 disk.msh       # size in mm; 2.0 and 1.0 give 12,000 and 60,000 dofs

`python -m geometries` would refine the membrane; equal cells keep the mesh near what the other programs' users would draw.
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import gmsh  # type: ignore[import-untyped]

from geometries import HollowDisk


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvenDisk(HollowDisk):
    """The thin disk, glued, with cells of ``cell_size`` wherever they are."""

    def build(self) -> None:
        super().build()
        gmsh.model.mesh.removeSizeCallback()
        gmsh.option.setNumber("Mesh.MeshSizeMin", self.cell_size)
        gmsh.option.setNumber("Mesh.MeshSizeMax", self.cell_size)


def main() -> None:
    size, path = float(sys.argv[1]) * 1e-3, Path(sys.argv[2])
    thin = dict(HollowDisk.variants["shadow"], support="base", fillet=0.0, base_fillet=0.0, cell_size=size, order=1)
    print(EvenDisk(**thin).write(path))


if __name__ == "__main__":
    main()
