"""A case's own path against CalculiX's of the deck that is exported from it.

    apt-get install calculix-ccx
    OMP_NUM_THREADS=1 uv run python tests/benchmarks/exported_calculix.py [case.toml]

Without a case, three of them: the disk's wedge in Yeoh's law; a slab that hangs by its base under its weight, a mass, a force
and a moment; a finger of two silicones under its weight. Both have displacements alone, the same mesh and the same energy.
Measured with CalculiX 2.20, where `Actuator.probes` are:

| case | at | softmodels | CalculiX | softmodels | CalculiX |
|---|---|---|---|---|---|
| disk | 40 cm | 1.094256 mm | 1.094247 mm | 1.346928 mm | 1.346892 mm |
| | 80 cm | 2.051689 mm | 2.051641 mm | 2.683850 mm | 2.683714 mm |
| slab | 0 cm | -35.283363 mm | -35.283360 mm | -32.945668 mm | -32.945670 mm |
| | 20 cm | -35.264425 mm | -35.264470 mm | -32.930831 mm | -32.930870 mm |
| | 40 cm | -35.241141 mm | -35.241230 mm | -32.913083 mm | -32.913160 mm |
| finger | 0 cm | -2.316328 mm | -2.316328 mm | -2.231614 mm | -2.231614 mm |
| | 6 cm | -3.309750 mm | -3.309728 mm | -3.156148 mm | -3.156131 mm |
| | 12 cm | -4.417798 mm | -4.417594 mm | -4.112043 mm | -4.111884 mm |

which is 2e-7 under loads alone, and 1e-6 to 5e-5 with the air, where CalculiX' tolerance on the residual shows.
"""

from __future__ import annotations

import dataclasses
import subprocess
import sys
import tempfile
from pathlib import Path

from calculix_wedge import read_displacements

import softmodels as sm
from softmodels.case.decks.deck import LOADS

LAW = sm.Yeoh(14e3, 60.0, 0.0, 0.49)
DISK = sm.Case("disk", sm.HollowDisk(fillet=0.0, cell_size=0.004), LAW, pressures_cm=(40.0, 80.0))
SLAB = sm.Case(
    "slab",
    sm.SeminarActuator(channels=1, spread=20.0, around=4.0, cell_size=0.006),
    LAW,
    pressures_cm=(20.0, 40.0),
    parts=(
        sm.Gravity("-z", 1070.0),
        sm.Mass("tip", 2e-3),
        sm.Force("tip", "0.6, 0, -0.8", 0.01, name="pull"),
        sm.Moment("tip", "y", 2e-5),
    ),
)
FINGER = sm.Case(
    "finger",
    sm.PneuNet(cell_size=0.006),
    LAW,
    pressures_cm=(6.0, 12.0),
    parts=(sm.Gravity("-z"), sm.Region(sm.MooneyRivlin(200e3, 50e3, 0.45), 1200.0, name="base")),
)


def main() -> None:
    for case in [sm.Case.from_file(file) for file in sys.argv[1:]] or (DISK, SLAB, FINGER):
        compare(dataclasses.replace(case, formulation="displacement"))


def compare(case: sm.Case) -> None:
    """Print a case's own displacements beside CalculiX'."""
    run = sm.run(case)
    # Dead loads are CalculiX' first step and the state that the path begins with.
    loaded = any(isinstance(part, LOADS) for part in case.parts)
    rows = [*run.rows[:loaded], *(row for row in run.rows if row["requested"] and row["pressure_cm"])]
    with tempfile.TemporaryDirectory() as folder:
        sm.export(case, Path(folder) / "deck.inp")
        subprocess.run(["ccx", "deck"], cwd=folder, capture_output=True, check=False)
        steps = read_displacements((Path(folder) / "deck.dat").read_text())
    axis = [abs(value) for value in case.actuator.lift].index(1.0)
    for row, step in zip(rows, steps, strict=True):
        told = sorted(row[f"{probe}_mm"] for probe in case.actuator.probes)
        found = sorted(float(shift[axis]) for shift in step.values())
        for ours, theirs in zip(told, found, strict=True):
            off = theirs / ours - 1
            print(f"{case.name} {row['pressure_cm']:g} cm: {ours:.6f} mm, CalculiX {theirs:.6f} mm, off by {off:+.1e}")


if __name__ == "__main__":
    main()
