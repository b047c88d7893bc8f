"""A case's own path against CalculiX's of the deck that is exported from it.

    apt-get install calculix-ccx
    OMP_NUM_THREADS=1 uv run python tests/benchmarks/exported_calculix.py [case.toml]

Without a case: the disk's wedge in Yeoh's law on cells of 4 mm. Both have displacements
alone, the same mesh and the same energy.
Measured with CalculiX 2.20:

| cm | apex, softmodels | CalculiX | ceiling, softmodels | CalculiX |
|---|---|---|---|---|
| 40 | 1.094256 mm | 1.094247 mm | 1.346928 mm | 1.346892 mm |
| 80 | 2.051689 mm | 2.051641 mm | 2.683850 mm | 2.683714 mm |

which is 8e-6 to 5e-5; the case is looked at where `Actuator.probes` are.
"""

from __future__ import annotations

import dataclasses
import subprocess
import sys
import tempfile
from pathlib import Path

from calculix_wedge import read_displacements

import softmodels as sm

DISK = sm.HollowDisk(fillet=0.0, cell_size=0.004)


def main() -> None:
    case = sm.Case("disk", DISK, sm.Yeoh(14e3, 60.0, 0.0, 0.49), pressures_cm=(40.0, 80.0))
    case = sm.Case.from_file(sys.argv[1]) if len(sys.argv) > 1 else case
    case = dataclasses.replace(case, formulation="displacement")
    rows = [row for row in sm.run(case).rows if row["requested"] and row["pressure_cm"]]
    with tempfile.TemporaryDirectory() as folder:
        sm.export(case, Path(folder) / "deck.inp")
        subprocess.run(["ccx", "deck"], cwd=folder, capture_output=True, check=False)
        steps = read_displacements((Path(folder) / "deck.dat").read_text())
    axis = [abs(value) for value in case.actuator.lift].index(1.0)
    for row, step in zip(rows, steps, strict=False):
        told = sorted(row[f"{probe}_mm"] for probe in case.actuator.probes)
        found = sorted(float(shift[axis]) for shift in step.values())
        for ours, theirs in zip(told, found, strict=True):
            print(
                f"{row['pressure_cm']:g} cm: {ours:.6f} mm, CalculiX {theirs:.6f} mm, off by {theirs / ours - 1:+.1e}"
            )


if __name__ == "__main__":
    main()
