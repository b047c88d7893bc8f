"""Inflate the hollow disk's wedge with softmodels, on the mesh file and with the report that the other programs have.

    uv run python tests/benchmarks/softmodels_wedge.py --mesh disk.msh --support glued --json softmodels.json

"seconds" holds everything from the mesh in memory to the last state (building the equations from compiled forms included);
"iterations" counts Newton iterations, "factorisations" the factorised tangents among them.
"""

from __future__ import annotations

import time
from pathlib import Path

import wedge_case

import softmodels
from geometries import HollowDisk
from softmodels.materials.laws import Material, NeoHookean, Yeoh
from softmodels.mechanics.body import Body
from softmodels.mechanics.mpi import start
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path.continuation import Continuation, trace
from softmodels.runs.fields import Fields


def main() -> None:
    made = wedge_case.parser(__doc__ or "")
    made.set_defaults(support="glued")
    made.add_argument("--form", choices=("mixed", "displacement"), default="mixed")
    made.add_argument("--energy", choices=("coupled", "isochoric"), default="coupled")
    args = wedge_case.read_arguments(made)
    if args.support != "glued":
        made.error("softmodels' disk is glued (--support glued) or held at its rim")
    comm = start()
    # Only the roles and the probes of the device count here: the mesh is the file's.
    disk = HollowDisk.variant("shadow", support="base", fillet=0.0, base_fillet=0.0)
    body = Body.from_file(disk, Path(args.mesh), comm)
    mu, nu = args.shear_modulus, args.poisson
    law: Material = NeoHookean(mu, nu) if args.energy == "coupled" else Yeoh(mu / 2, poisson=nu)

    started = time.perf_counter()
    equilibrium = Solver(System(body, law, args.form))
    points = list(trace(Continuation(equilibrium), [p / equilibrium.system.stress_unit for p in args.pascals]))
    seconds = time.perf_counter() - started

    fields = Fields(equilibrium)
    wanted = [fields.figures(point.state) for point in points if point.requested]
    wedge_case.report(
        {
            "tool": "softmodels",
            "version": softmodels.__version__,
            "options": f"{args.form} {args.energy}",
            "dofs": equilibrium.system.space.dofmap.index_map.size_global * equilibrium.system.space.dofmap.index_map_bs,
            "seconds": seconds,
            "steps": len(points) - 1,
            "iterations": sum(point.state.iterations for point in points),
            "factorisations": equilibrium.bordered.factorisations,
            "results": [
                {"pressure_cm": cm, "apex_mm": f.rises["apex"] * 1e3, "ceiling_mm": f.rises["ceiling"] * 1e3}
                for cm, f in zip(args.pressures_cm, wanted, strict=True)
            ],
        },
        args.json,
    )


if __name__ == "__main__":
    main()
