"""Fixtures shared by all folders."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from geometries import ImportedActuator
from geometries.meshing import private_model


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
def step_file():
    """Return a function that writes what ``draw(gmsh.model.occ)`` draws as a STEP file in a unit, and gives its path."""
    import gmsh

    def write(path, draw, unit="MM"):
        with private_model():
            gmsh.option.setString("Geometry.OCCTargetUnit", unit)
            draw(gmsh.model.occ)
            gmsh.model.occ.synchronize()
            gmsh.write(str(path))
            gmsh.option.setString("Geometry.OCCTargetUnit", "")
        return str(path)

    return write


@pytest.fixture(scope="session")
def wedge_part(step_file, tmp_path_factory):
    """Return a function that gives a wedge of a "can" or of the upper half of a "ball" from a STEP file.

    The can has a radius of 15 mm, a height of 10 mm, a flat cavity of 10 mm radius and a held bottom; the ball has radii of
    10 and 15 mm and is cut at z = 0 too. Planes stand at 0 degrees and at the wedge's angle; at 180 they are one.
    """
    folder = tmp_path_factory.mktemp("wedges")
    second = {45: "normal 1, -1, 0", 60: "normal 0.866, -0.5, 0", 90: "x = 0 mm"}

    def part(shape, angle, **changes):
        around = {"angle" if shape == "can" else "angle3": math.radians(angle)}

        def draw(occ):
            if shape == "can":
                whole, hole = (occ.addCylinder(0, 0, z, 0, 0, h, r, **around) for z, h, r in ((0, 10, 15), (3, 4, 10)))
            else:
                whole, hole = (occ.addSphere(0, 0, 0, r, angle1=0, angle2=math.pi / 2, **around) for r in (15, 10))
            occ.cut([(3, whole)], [(3, hole)])

        file = folder / f"{shape}{angle}.step"
        planes = ["y = 0 mm", second.get(angle), "z = 0 mm" if shape == "ball" else None]
        choices = {
            "cavities": ("at 3, 0.5, 5 mm",),
            "support": "z = 0 mm" if shape == "can" else "",
            "cell_size": 0.005,
        }
        return ImportedActuator(
            file=str(file) if file.exists() else step_file(file, draw),
            planes=tuple(filter(None, planes)),
            **{**choices, **changes},
        )

    return part


@pytest.fixture(scope="session")
def comm():
    """The world communicator; the first to ask for it starts MPI, PETSc and DOLFINx in their order."""
    from softmodels.mechanics.mpi import start

    return start()


@pytest.fixture(scope="session")
def two_cavities(step_file, tmp_path_factory):
    """STEP file of a block of 20 x 10 x 10 mm with two like cavities above each other, 1.5 mm apart.

    What one does moves the other's walls. They lie around (11, 0, 2) and (11, 0, -2) mm, and the block begins at x = 0.
    """

    def draw(occ):
        block = occ.addBox(0, -5, -5, 20, 10, 10)
        holes = [occ.addBox(6, -3, z, 10, 6, 2.0) for z in (0.75, -2.75)]
        occ.cut([(3, block)], [(3, hole) for hole in holes])

    return step_file(tmp_path_factory.mktemp("step") / "two_cavities.step", draw)
