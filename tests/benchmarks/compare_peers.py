"""Time softmodels against FElupe (PARDISO) and CalculiX on one mesh, side by side in one run, and print a table.

    apt-get install calculix-ccx
    uv run python tests/benchmarks/compare_peers.py --size 2.0 --rounds 3

The thin wedge goes from 0 to 30 cm of water in 11 pressures; one thread each. Programs run one after the other in every
round, and the ratio is taken within the round, so a busy machine slows all alike. The first run of softmodels, which
compiles the equations, is not counted. Compare equal formulations: the two energies differ by 2 % at 30 cm.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
MIXED, DISPLACEMENT = ["--form", "mixed"], ["--form", "displacement"]
ISOCHORIC = ["--energy", "isochoric"]
RUNS: dict[str, tuple[str, list[str]]] = {
    "softmodels, mixed, coupled": ("softmodels_wedge.py", MIXED),
    "FElupe, mixed, coupled": ("felupe_wedge.py", MIXED),
    "softmodels, displacement, isochoric": ("softmodels_wedge.py", DISPLACEMENT + ISOCHORIC),
    "FElupe, displacement, isochoric": ("felupe_wedge.py", DISPLACEMENT + ISOCHORIC),
    "CalculiX, displacement, isochoric": ("calculix_wedge.py", []),
}


def once(name: str, mesh: Path, limit: float) -> dict[str, Any] | None:
    """One run's report; None where it failed or took longer than ``limit`` seconds."""
    script, options = RUNS[name]
    threads = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    # FElupe runs beside the project, in an environment of its own that uv keeps: the project does not depend on it.
    beside = ["uv", "run", "--with", "felupe", "--with", "pypardiso", "python"]
    python = beside if script.startswith("felupe") else [sys.executable]
    command = [*python, str(HERE / script), "--mesh", str(mesh), "--support", "glued", *options]
    try:
        done = subprocess.run(command, env={**os.environ, **threads}, capture_output=True, text=True, timeout=limit, check=True)
    except (subprocess.TimeoutExpired, subprocess.CalledProcessError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return None
    return dict(json.loads(done.stdout.strip().splitlines()[-1]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", default="2.0", help="cell size in mm: 2.0 has 12,000 dofs, 1.0 has 60,000")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--limit", type=float, default=900.0, help="seconds that a run may take")
    parser.add_argument("--only", default="", help="part of the names of what is run, such as mixed")
    args = parser.parse_args()
    runs = [name for name in RUNS if args.only in name]
    with tempfile.TemporaryDirectory() as folder:
        mesh = Path(folder) / "disk.msh"
        subprocess.run([sys.executable, str(HERE / "wedge_mesh.py"), args.size, str(mesh)], check=True)
        for name in runs:
            if name.startswith("softmodels"):
                once(name, mesh, args.limit)
        reports = [{name: once(name, mesh, args.limit) for name in runs} for _ in range(args.rounds)]

    print("| program | dofs | seconds (median) | times softmodels' | apex at 30 cm, mm | apex curve off by |")
    print("|---|---|---|---|---|---|")
    for name in runs:
        ours = next(other for other in runs if other.startswith("softmodels") and other.split(",")[1] == name.split(",")[1])
        good = [(r[name], r[ours]) for r in reports if r[name] and r[ours]]
        if not good:
            print(f"| {name} | | failed | | | |")
            continue
        seconds = statistics.median(one["seconds"] for one, _ in good)
        ratio = statistics.median(one["seconds"] / own["seconds"] for one, own in good)
        curve, own_curve = ([row["apex_mm"] for row in report["results"][1:]] for report in good[0])
        off = max(abs(a / b - 1) for a, b in zip(curve, own_curve, strict=True))
        print(f"| {name} | {good[0][0]['dofs']} | {seconds:.1f} | {ratio:.1f} | {curve[-1]:.3f} | {off:.0e} |")


if __name__ == "__main__":
    main()
