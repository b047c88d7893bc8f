"""Fixtures shared by all folders."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared_data():
    """Return a function that gives a folder of measured data beside the checkout, or skips where it is not there."""

    def folder_of(name):
        for folder in Path(__file__).resolve().parents:
            found = folder / "shared" / "data" / name
            if found.is_dir():
                return found
        return pytest.skip(f"no shared/data/{name} beside the project")

    return folder_of


@pytest.fixture(scope="session")
def comm():
    """The world communicator; the first to ask for it starts MPI, PETSc and DOLFINx in their order."""
    from softmodels.parallel import start

    return start()


@pytest.fixture(scope="session")
def two_cavities(tmp_path_factory):
    """STEP file of a block of 20 x 10 x 10 mm with two like cavities above each other, 1.5 mm apart.

    What one does moves the other's walls. They lie around (11, 0, 2) and (11, 0, -2) mm, and the block begins at x = 0.
    """
    import gmsh

    from geometries.meshing import private_model

    file = tmp_path_factory.mktemp("step") / "two_cavities.step"
    with private_model():
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        occ = gmsh.model.occ
        block = occ.addBox(0, -5, -5, 20, 10, 10)
        holes = [occ.addBox(6, -3, z, 10, 6, 2.0) for z in (0.75, -2.75)]
        occ.cut([(3, block)], [(3, hole) for hole in holes])
        occ.synchronize()
        gmsh.write(str(file))
        gmsh.option.setString("Geometry.OCCTargetUnit", "")
    return file
