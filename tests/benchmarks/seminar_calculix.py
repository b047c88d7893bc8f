"""One state of the seminar actuator by CalculiX and by softmodels, on one mesh file; print both tips' rises.

    apt-get install calculix-ccx
    OMP_NUM_THREADS=1 uv run python tests/benchmarks/seminar_calculix.py --pressure-cm 70

The silicone is Ecoflex 00-30 by Yeoh's law, whose energy, (J - 1)^2 included, both programs write alike. CalculiX has C3D10
elements, displacements alone: the same formulation of softmodels is what its figure is held against, and the mixed one,
which a user gets, is told beside it. See `calculix_wedge` for the deck's units and tolerances.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
import time
from pathlib import Path

import gmsh  # type: ignore[import-untyped]
import numpy as np
from calculix_wedge import TIGHT, cards, read_displacements
from wedge_case import TETRAHEDRON10, TRIANGLE6, VTK_FROM_GMSH, elements, orient

from geometries import SeminarActuator
from measurement.units import pascal_per_cm
from softmodels.body import Body
from softmodels.equilibrium import Equilibrium
from softmodels.fields import Fields
from softmodels.loading import Path as LoadPath
from softmodels.loading import trace
from softmodels.materials import Yeoh
from softmodels.parallel import start
from softmodels.silicones import SILICONES


def write_deck(mesh: Path, slab: SeminarActuator, law: Yeoh, pressure: float, tight: bool) -> tuple[str, list[int]]:
    """CalculiX's input (mm, Pa), and the nodes of the tip's upper and lower corner, from 0."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(mesh))
        tags, xyz, _ = gmsh.model.mesh.getNodes()
        cells = elements("solid", 3, TETRAHEDRON10)[:, VTK_FROM_GMSH]
        faces = {name: elements(name, 2, TRIANGLE6) for name in ("cavity", "plane0", "support")}
    finally:
        gmsh.finalize()
    points = np.zeros((int(tags.max()) + 1, 3))  # by Gmsh's tag; tag 0 is nobody's
    points[tags.astype(np.int64)] = xyz.reshape(-1, 3)
    _, owners, sides = orient(faces["cavity"], points, cells)
    support = np.unique(faces["support"])
    middle = np.setdiff1d(faces["plane0"], support)
    known = np.unique(cells)
    tips = [int(known[np.linalg.norm(points[known] - place, axis=1).argmin()]) for place in slab.probes.values()]

    parts = ["*NODE, NSET=ALL\n"]
    parts += [f"{tag}, {x:.12e}, {y:.12e}, {z:.12e}\n" for tag in known for x, y, z in (1e3 * points[tag],)]
    parts.append("*ELEMENT, TYPE=C3D10, ELSET=SOLID\n")
    parts += [f"{n}, " + ", ".join(map(str, cell)) + "\n" for n, cell in enumerate(cells, 1)]
    parts.append("*SURFACE, NAME=CAVITY, TYPE=ELEMENT\n")
    parts += [f"{owner + 1}, S{side + 1}\n" for owner, side in zip(owners, sides, strict=True)]
    sets = (("SUPPORT", support), ("MIDDLE", middle), ("TIPS", np.array(tips)))
    parts += [cards(f"*NSET, NSET={name}", nodes - 1) for name, nodes in sets]
    parts.append("*BOUNDARY\nSUPPORT, 1, 3\nMIDDLE, 2, 2\n")
    parts.append("*MATERIAL, NAME=SILICONE\n*HYPERELASTIC, YEOH\n")
    # D2 and D3 so large that they add nothing: at 0 ccx quietly puts in values of its own.
    parts.append(f"{law.c1:.12e}, {law.c2:.12e}, {law.c3:.12e}, {2 / law.bulk:.12e}, 1e10, 1e10\n")
    parts.append("*SOLID SECTION, ELSET=SOLID, MATERIAL=SILICONE\n")
    parts.append("*STEP, NLGEOM, INC=400\n*STATIC, SOLVER=SPOOLES\n0.25, 1., 1e-4, 0.5\n" + (TIGHT if tight else ""))
    parts.append(f"*DSLOAD\nCAVITY, P, {pressure:.12e}\n*NODE PRINT, NSET=TIPS, FREQUENCY=10000\nU\n*END STEP\n")
    return "".join(parts), [tip - 1 for tip in tips]


def calculix(mesh: Path, slab: SeminarActuator, law: Yeoh, pressure: float, program: str, tight: bool = False) -> float:
    """Rise of the tip's middle in mm."""
    deck, tips = write_deck(mesh, slab, law, pressure, tight)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "slab.inp").write_text(deck)
        done = subprocess.run([program, "slab"], cwd=folder, capture_output=True, text=True)
        printed = folder / "slab.dat"
        steps = read_displacements(printed.read_text()) if printed.is_file() else []
    if not steps:
        raise SystemExit(f"ccx did not reach the pressure:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return float(np.mean([steps[-1][tip] for tip in tips]))


def softmodels(mesh: Path, slab: SeminarActuator, law: Yeoh, pressure: float, formulation: str) -> float:
    """The same by softmodels."""
    equations = Equilibrium(Body.from_file(slab, mesh, start()), law, formulation)
    *_, last = trace(LoadPath(equations), [pressure / equations.stress_unit])
    return Fields(equations).figures(last.state).device["tip_z_mm"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pressure-cm", type=float, default=70.0)
    parser.add_argument("--around", type=float, default=10.0, help="cells around a channel; 6 for a quick look")
    parser.add_argument("--channels", type=int, default=5, help="1 with --around 4 takes a minute")
    parser.add_argument("--tight", action="store_true", help="CalculiX's tolerances far below its default of 0.5 %%")
    parser.add_argument("--ccx", default="ccx", help="name or path of the CalculiX program")
    args = parser.parse_args()
    slab, pressure = SeminarActuator(around=args.around, channels=args.channels), args.pressure_cm * pascal_per_cm()
    law = SILICONES["ecoflex-00-30"].material
    assert isinstance(law, Yeoh)
    with tempfile.TemporaryDirectory() as folder:
        mesh = slab.write(Path(folder) / "slab.msh")
        rows = []
        for name, solve in (
            ("CalculiX, displacement", lambda: calculix(mesh, slab, law, pressure, args.ccx, args.tight)),
            ("softmodels, displacement", lambda: softmodels(mesh, slab, law, pressure, "displacement")),
            ("softmodels, mixed", lambda: softmodels(mesh, slab, law, pressure, "mixed")),
        ):
            began = time.perf_counter()
            rows.append((name, solve(), time.perf_counter() - began))
    print(f"tip at {args.pressure_cm:g} cm\n| program | rise, mm | off CalculiX by | seconds |\n|---|---|---|---|")
    for name, rise, seconds in rows:
        print(f"| {name} | {rise:.4f} | {rise / rows[0][1] - 1:+.2e} | {seconds:.0f} |")


if __name__ == "__main__":
    main()
