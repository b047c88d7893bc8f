"""The seminar actuator's path by CalculiX and by softmodels, on one mesh file: where the tip is, what the cavity takes.

    apt-get install calculix-ccx
    OMP_NUM_THREADS=1 uv run python tests/benchmarks/seminar_calculix.py

The silicone is Ecoflex 00-30 by Yeoh's law, whose energy, (J - 1)^2 included, both programs write alike. CalculiX has C3D10
elements, displacements alone: the same formulation of softmodels is what its figures are held against, and the mixed one,
which a user gets, is told beside it. See `calculix_wedge` for the deck's units.

Measured with CalculiX 2.20, softmodels' displacement formulation against it:

| device | cells around, size | cm | tip rises, CalculiX | off by | cavity's added volume off by |
|---|---|---|---|---|---|
| five channels | 4, 8 mm | 70 | 1.1755 mm | 5e-5 | 6e-5 |
| five channels | 4, 8 mm | 100 | 2.2605 mm | 8e-6 | 2e-5 |
| five channels | 6, 6 mm | 70 | 1.3368 mm | 3e-4 | 9e-6 |

CalculiX's default tolerances cost 0.6 % of the rise. Newton's method there needs seven to fifteen iterations an increment above
70 cm and steps of a few cm; on the finer mesh it was not followed beyond 106 cm. Displacements alone are too stiff: the mixed
formulation rises 6 % more on the finer mesh at 70 cm, 14 % more on the coarser, 16 % at 100 cm.
"""

from __future__ import annotations

import argparse
import dataclasses
import subprocess
import tempfile
import time
from pathlib import Path

import gmsh  # type: ignore[import-untyped]
import numpy as np
from calculix_wedge import cards, read_displacements
from numpy.typing import NDArray
from wedge_case import TETRAHEDRON10, TRIANGLE6, VTK_FROM_GMSH, elements, orient

from geometries import SeminarActuator
from softmodels.common.units import COLUMN
from softmodels.materials.laws import Yeoh
from softmodels.materials.silicones import SILICONES
from softmodels.mechanics.body import Body
from softmodels.mechanics.mpi import start
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path.continuation import Continuation, trace
from softmodels.path.stability import PathEnd
from softmodels.runs.fields import Fields

PATIENT = "*CONTROLS, PARAMETERS=TIME INCREMENTATION\n30, 40, 9, 60, 10, 4, , 10\n"
"""Lets Newton's method fall slowly: displacements alone take it over ten iterations at Poisson's ratio 0.49."""

CLOSE = "*CONTROLS, PARAMETERS=FIELD\n1e-5, 1e-3, , , 1e-5, 1e-5, 1e-8, 1e-8\n"
"""Limits on residual and correction in place of the default 0.5 % and 1 %."""


@dataclasses.dataclass(frozen=True)
class Mesh:
    """A slab's mesh by Gmsh's node tags, from 1.

    Attributes:
        points: Node positions in m by tag, (largest tag + 1, 3).
        cells: Tetrahedra in the order of CalculiX, (cells, 10).
        faces: Triangles by role, (faces, 6); those of the cavity have normals out of the solid.
        owners: Tetrahedron behind each triangle of the cavity, from 0.
        sides: Which of that tetrahedron's sides it is, from 0.
        tips: The tip's upper and lower corner.
    """

    points: NDArray[np.float64]
    cells: NDArray[np.int64]
    faces: dict[str, NDArray[np.int64]]
    owners: NDArray[np.int64]
    sides: NDArray[np.int64]
    tips: list[int]


@dataclasses.dataclass(frozen=True)
class State:
    """What is compared: the middle of the tip's edge in mm, the cavity's added volume in ml (of the whole slab)."""

    x: float
    z: float
    added: float


def read_mesh(path: Path, slab: SeminarActuator) -> Mesh:
    """The mesh that both programs are given."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(path))
        tags, xyz, _ = gmsh.model.mesh.getNodes()
        cells = elements("solid", 3, TETRAHEDRON10)[:, VTK_FROM_GMSH]
        faces = {name: elements(name, 2, TRIANGLE6) for name in ("cavity", "plane0", "support")}
    finally:
        gmsh.finalize()
    points = np.zeros((int(tags.max()) + 1, 3))  # tag 0 is nobody's
    points[tags.astype(np.int64)] = xyz.reshape(-1, 3)
    faces["cavity"], owners, sides = orient(faces["cavity"], points, cells)
    known = np.unique(cells)
    tips = [int(known[np.linalg.norm(points[known] - place, axis=1).argmin()]) for place in slab.probes.values()]
    return Mesh(points, cells, faces, owners, sides, tips)


def write_deck(mesh: Mesh, law: Yeoh, pressures: list[float]) -> str:
    """CalculiX's input (mm, Pa): one step for each pressure."""
    support = np.unique(mesh.faces["support"])
    middle = np.setdiff1d(mesh.faces["plane0"], support)
    printed = np.union1d(mesh.faces["cavity"], mesh.tips)
    parts = ["*NODE, NSET=ALL\n"]
    parts += [
        f"{tag}, {x:.12e}, {y:.12e}, {z:.12e}\n" for tag in np.unique(mesh.cells) for x, y, z in (1e3 * mesh.points[tag],)
    ]
    parts.append("*ELEMENT, TYPE=C3D10, ELSET=SOLID\n")
    parts += [f"{n}, " + ", ".join(map(str, cell)) + "\n" for n, cell in enumerate(mesh.cells, 1)]
    parts.append("*SURFACE, NAME=CAVITY, TYPE=ELEMENT\n")
    parts += [f"{owner + 1}, S{side + 1}\n" for owner, side in zip(mesh.owners, mesh.sides, strict=True)]
    sets = (("SUPPORT", support), ("MIDDLE", middle), ("PRINTED", printed))
    parts += [cards(f"*NSET, NSET={name}", nodes - 1) for name, nodes in sets]
    parts.append("*BOUNDARY\nSUPPORT, 1, 3\nMIDDLE, 2, 2\n")
    parts.append("*MATERIAL, NAME=SILICONE\n*HYPERELASTIC, YEOH\n")
    # D2 and D3 so large that they add nothing: at 0 ccx quietly puts in values of its own.
    parts.append(f"{law.c1:.12e}, {law.c2:.12e}, {law.c3:.12e}, {2 / law.bulk:.12e}, 1e10, 1e10\n")
    parts.append("*SOLID SECTION, ELSET=SOLID, MATERIAL=SILICONE\n")
    for pressure in pressures:
        parts.append("*STEP, NLGEOM, INC=400\n*STATIC, SOLVER=SPOOLES\n0.1, 1., 1e-4, 0.2\n" + PATIENT + CLOSE)
        parts.append(f"*DSLOAD\nCAVITY, P, {pressure:.12e}\n*NODE PRINT, NSET=PRINTED, FREQUENCY=10000\nU\n*END STEP\n")
    return "".join(parts)


def volume(points: NDArray[np.float64], faces: NDArray[np.int64]) -> float:
    """Volume before curved triangles (normals into it): minus a third of the integral of x . n; planes through 0 add 0."""
    import basix

    at, weights = basix.make_quadrature(basix.CellType.triangle, 4)
    element = basix.create_element(basix.ElementFamily.P, basix.CellType.triangle, 2, basix.LagrangeVariant.equispaced)
    value, along, across = element.tabulate(1, at)[..., 0]
    corners = points[faces[:, [0, 1, 2, 4, 5, 3]]]  # basix has the middle of an edge where the corner opposite is
    x, a, b = (np.einsum("qn,fni->fqi", table, corners) for table in (value, along, across))
    return -float(np.einsum("q,fqi,fqi->", weights, x, np.cross(a, b)) / 3)


def calculix(mesh: Mesh, law: Yeoh, pressures: list[float], program: str) -> list[State]:
    """The states that CalculiX reaches, in the order of the pressures."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "slab.inp").write_text(write_deck(mesh, law, pressures))
        done = subprocess.run([program, "slab"], cwd=folder, capture_output=True, text=True)
        printed = folder / "slab.dat"
        steps = read_displacements(printed.read_text()) if printed.is_file() else []
    if not steps:
        raise SystemExit(f"ccx did not reach the first pressure:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    found = []
    for step in steps:
        moved = mesh.points.copy()
        for node, shift in step.items():
            moved[node + 1] += 1e-3 * shift
        x, _, z = 1e3 * moved[mesh.tips].mean(axis=0)
        added = volume(moved, mesh.faces["cavity"]) - volume(mesh.points, mesh.faces["cavity"])
        found.append(State(float(x), float(z), 2e6 * added))
    return found


def softmodels(path: Path, slab: SeminarActuator, law: Yeoh, pressures: list[float], formulation: str) -> list[State]:
    """The same by softmodels."""
    equations = Solver(System(Body.from_file(slab, path, start()), law, formulation))
    fields, found = Fields(equations), []
    try:
        for point in trace(Continuation(equations), [pressure / equations.system.stress_unit for pressure in pressures]):
            if point.requested:
                figures = fields.figures(point.state)
                found.append(State(figures.device["tip_x_mm"], figures.device["tip_z_mm"], 1e6 * figures.added_volume))
    except PathEnd as end:
        print(f"softmodels, {formulation}: {end}")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pressures-cm", type=lambda text: [float(part) for part in text.split(",")], default="70,100")
    parser.add_argument("--around", type=float, default=4.0, help="cells around a channel; the device's default is 10")
    parser.add_argument("--cell-size", type=float, default=8.0, help="mm; the device's default is 5")
    parser.add_argument("--channels", type=int, default=5, help="1 takes a minute")
    parser.add_argument("--ccx", default="ccx", help="name or path of the CalculiX program")
    args = parser.parse_args()
    slab = SeminarActuator(around=args.around, cell_size=1e-3 * args.cell_size, channels=args.channels)
    pressures = [height * COLUMN.pascal for height in args.pressures_cm]
    law = dataclasses.replace(SILICONES["ecoflex-00-30"].material, poisson=0.49)
    assert isinstance(law, Yeoh)
    print("| program | cm | tip x, mm | tip z, mm | added, ml | lift off CalculiX | added off CalculiX | seconds in all |")
    print("|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        path = slab.write(Path(folder) / "slab.msh")
        mesh = read_mesh(path, slab)
        reference: list[State] = []
        for name, solve in (
            ("CalculiX, displacement", lambda: calculix(mesh, law, pressures, args.ccx)),
            ("softmodels, displacement", lambda: softmodels(path, slab, law, pressures, "displacement")),
            ("softmodels, mixed", lambda: softmodels(path, slab, law, pressures, "mixed")),
        ):
            began = time.perf_counter()
            states = solve()
            seconds = time.perf_counter() - began
            reference = reference or states
            for height, state, other in zip(args.pressures_cm, states, reference, strict=False):
                print(
                    f"| {name} | {height:g} | {state.x:.4f} | {state.z:.4f} | {state.added:.5f} | "
                    f"{state.z / other.z - 1:+.2e} | {state.added / other.added - 1:+.2e} | {seconds:.0f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
