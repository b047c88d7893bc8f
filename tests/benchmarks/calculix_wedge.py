"""Inflate the hollow disk's wedge with CalculiX (ccx), for comparison with softmodels.

    apt-get install calculix-ccx
    export OMP_NUM_THREADS=1
    uv run python tests/benchmarks/calculix_wedge.py --mesh disk.msh --json calculix.json

See `wedge_case.py` for the mesh. Elements are C3D10 (four integration points) and the material is CalculiX's
neo-Hookean one, mu/2 (J^(-2/3) I1 - 3) + K/2 (J - 1)^2, so only the energy "isochoric" can be asked for. The second
cut is held exactly, by linear equations between x and y. Each pressure is one step, which CalculiX may cut by itself.

The deck is in mm, Pa and micronewtons, since CalculiX compares some numbers with fixed ones. With metres the nodal
forces are so small that it takes the residual for zero and stops early, whatever tolerance it is given. With stresses
in a much smaller unit than Pa the material constant D1 = 2/K gets so small that it is silently replaced by another.

"seconds" is the time of the ccx process, which includes reading the deck; "iterations" counts every linear solve.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import wedge_case
from numpy.typing import NDArray

TIGHT = "*CONTROLS, PARAMETERS=FIELD\n1e-7, 1e-5, , , 1e-7, 1e-7, 1e-8, 1e-8\n"
"""Limits on residual and correction in place of the default 0.5 % and 1 %, which are meant for engineering."""


def cards(keyword: str, numbers: Iterable[int]) -> str:
    """A set of nodes or elements, from numbers that count from 0; a line may hold at most 16."""
    values = [str(number + 1) for number in numbers]
    lines = [", ".join(values[at : at + 12]) for at in range(0, len(values), 12)]
    return f"{keyword}\n" + "\n".join(lines) + "\n"


def mesh_deck(wedge: wedge_case.Wedge) -> str:
    """Nodes in mm, elements, the loaded surface and the two nodes that are looked at."""
    parts = ["*NODE, NSET=ALL\n"]
    parts += [f"{n}, {x:.12e}, {y:.12e}, {z:.12e}\n" for n, (x, y, z) in enumerate(1e3 * wedge.points, 1)]
    parts.append("*ELEMENT, TYPE=C3D10, ELSET=SOLID\n")
    parts += [f"{n}, " + ", ".join(str(node + 1) for node in cell) + "\n" for n, cell in enumerate(wedge.cells, 1)]
    parts.append("*SURFACE, NAME=CAVITY, TYPE=ELEMENT\n")
    parts += [f"{owner + 1}, S{side + 1}\n" for owner, side in zip(wedge.owners, wedge.sides, strict=True)]
    parts.append(cards("*NSET, NSET=CENTRE", (wedge.apex, wedge.ceiling)))
    return "".join(parts)


def support_deck(wedge: wedge_case.Wedge, glued: bool) -> str:
    """Held components; no component is named twice, which ccx refuses or resolves as it likes."""
    support, axis = wedge.held["support"], wedge.axis
    # A glued node has nothing left to hold; an equation with only held terms would be an error.
    loose = [np.setdiff1d(nodes, support) if glued else nodes for nodes in (wedge.held["plane0"], wedge.held["plane1"])]
    on_axis = np.intersect1d(axis, loose[0])
    normal_x, normal_y = wedge.normal
    parts = []
    tilted = np.setdiff1d(loose[1], axis)
    # The first term is the one ccx eliminates, so it gets the larger factor. Numbers may have 20 characters.
    terms = sorted([(abs(normal_x), 1, normal_x), (abs(normal_y), 2, normal_y)], reverse=True)
    for node in tilted:
        parts.append("*EQUATION\n2\n" + ", ".join(f"{node + 1}, {k}, {factor:.12e}" for _, k, factor in terms) + "\n")
    sets = {"LEFT": np.setdiff1d(loose[0], axis), "AXIS": on_axis, "SUPPORT": support}
    held = {"LEFT": "2, 2", "AXIS": "1, 2", "SUPPORT": "1, 3" if glued else "3, 3"}
    parts += [cards(f"*NSET, NSET={name}", nodes) for name, nodes in sets.items()]
    parts += ["*BOUNDARY\n"] + [f"{name}, {components}\n" for name, components in held.items() if sets[name].size]
    return "".join(parts)


def write_deck(wedge: wedge_case.Wedge, args: argparse.Namespace) -> str:
    """The whole input: one step for each pressure above zero."""
    parts = [mesh_deck(wedge), support_deck(wedge, args.support == "glued")]
    parts.append("*MATERIAL, NAME=SILICONE\n*HYPERELASTIC, NEO HOOKE\n")
    parts.append(f"{args.shear_modulus / 2:.12e}, {2 / args.bulk:.12e}\n")
    parts.append("*SOLID SECTION, ELSET=SOLID, MATERIAL=SILICONE\n")
    for pressure in args.pascals[args.pascals > 0]:
        parts.append("*STEP, NLGEOM, INC=400\n*STATIC, SOLVER=SPOOLES\n1., 1., 1e-4, 1.\n")
        parts.append(TIGHT if args.tolerance == "tight" else "")
        parts.append(f"*DSLOAD\nCAVITY, P, {pressure:.12e}\n")
        # Displacements are printed at the end of the step only, not after each of its increments.
        parts.append("*NODE PRINT, NSET=CENTRE, FREQUENCY=10000\nU\n*END STEP\n")
    return "".join(parts)


def read_displacements(text: str) -> list[dict[int, NDArray[np.float64]]]:
    """The displacements (x, y, z) in mm by node (from 0) of each completed step."""
    steps: list[dict[int, NDArray[np.float64]]] = []
    for line in text.splitlines():
        if "displacements" in line:
            steps.append({})
        elif (words := line.split()) and len(words) == 4 and words[0].isdigit():
            steps[-1][int(words[0]) - 1] = np.array(words[1:], dtype=float)
    return steps


def main() -> None:
    """Run ccx on a deck in a temporary folder and report."""
    parser = wedge_case.parser(__doc__ or "")
    parser.add_argument("--energy", choices=("isochoric",), default="isochoric")
    parser.add_argument("--tolerance", choices=("default", "tight"), default="default")
    parser.add_argument("--ccx", default="ccx", help="name or path of the CalculiX program")
    args = wedge_case.read_arguments(parser)
    wedge = wedge_case.read_wedge(args.mesh)
    version = subprocess.run([args.ccx, "-v"], capture_output=True, text=True).stdout

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "wedge.inp").write_text(write_deck(wedge, args))
        started = time.perf_counter()
        done = subprocess.run([args.ccx, "wedge"], cwd=folder, capture_output=True, text=True)
        seconds = time.perf_counter() - started
        printed = folder / "wedge.dat"
        steps = read_displacements(printed.read_text() if printed.is_file() else "")
    equations = re.search(r"number of equations\s+(\d+)", done.stdout)
    if equations is None:
        raise SystemExit(f"ccx did not get as far as solving:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")

    heights = [height for height in args.pressures_cm if height > 0]
    rows = [{"pressure_cm": height, "apex_mm": 0.0, "ceiling_mm": 0.0} for height in args.pressures_cm if height == 0]
    for height, step in zip(heights, steps, strict=False):  # fewer steps than heights: ccx gave up
        apex, ceiling = (float(step[node][2]) for node in (wedge.apex, wedge.ceiling))
        rows.append({"pressure_cm": height, "apex_mm": apex, "ceiling_mm": ceiling})
    found = re.search(r"Version\s+(\S+)", version)
    wedge_case.report(
        {
            "tool": "CalculiX",
            "version": found.group(1) if found else "unknown",
            "options": {
                "energy": "isochoric",
                "form": "displacement",
                "support": args.support,
                "plane1": "exact",
                "tolerance": args.tolerance,
            },
            "dofs": 3 * len(wedge.points),
            "equations": int(equations.group(1)),
            "seconds": seconds,
            "iterations": len(re.findall(r"^\s*iteration\s+\d+", done.stdout, re.MULTILINE)),
            "results": rows,
        },
        args.json,
    )


if __name__ == "__main__":
    main()
