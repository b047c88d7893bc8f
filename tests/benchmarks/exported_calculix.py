"""A case's own path against CalculiX's of the deck that is exported from it.

    apt-get install calculix-ccx
    OMP_NUM_THREADS=1 uv run python tests/benchmarks/exported_calculix.py [case.toml | name ...]

Without a case, those of `CASES`: the disk's wedge in Yeoh's law; a slab that hangs by its base under its weight, a mass, a
force and a moment; a finger of two silicones under its weight; a membrane with a rigid plate of its own mass; fingers, half
and whole, whose rigid tip turns; one whose tip a clamp lets slip. Both have displacements alone, the same mesh and the same
energy.
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

which is 2e-7 under loads alone, and 1e-6 to 5e-5 with the air, where CalculiX' tolerance on the residual shows. With rigid
parts it is 9e-6 at most; figures in docs/pages/explanation/verification.md.
"""

from __future__ import annotations

import dataclasses
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from calculix_wedge import read_displacements

import softmodels as sm
from softmodels.case.load import steps_of
from softmodels.decks.deck import LOADS

LAW = sm.Yeoh(14e3, 60.0, 0.0, 0.49)
DISK = sm.Case("disk", sm.HollowDisk(fillet=0.0, cell_size=0.004), LAW, steps=steps_of(pressure_cm=(40.0, 80.0)))
SLAB = sm.Case(
    "slab",
    sm.SeminarActuator(channels=1, spread=20.0, around=6.0, cell_size=0.006),
    LAW,
    steps=steps_of(pressure_cm=(20.0, 40.0)),
    components=(
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
    steps=steps_of(pressure_cm=(6.0, 12.0)),
    components=(sm.Gravity("-z"), sm.Region(sm.MooneyRivlin(200e3, 50e3, 0.45), 1200.0, name="base")),
)
SMALL = sm.PneuNet(chambers=2, cell_size=0.008)
PLATED = sm.Membrane(
    radius=0.02, thickness=0.002, plate_radius=0.008, section="wedge", angle=60.0, cell_size=0.004
)  # fmt: skip
RIGID: dict[str, tuple[sm.Actuator, tuple[float, ...], dict[str, Any]]] = {
    "plate": (PLATED, (5.0, 10.0), {"components": (sm.Rigid("plate", name="plate", mass=0.02), sm.Gravity("-z"))}),
    "tip": (SMALL, (4.0, 8.0), {"components": (sm.Rigid("tip", name="plate", mass=0.01), sm.Gravity("0.6, 0, -0.8"))}),
    "whole": (
        dataclasses.replace(SMALL, part="full"),
        (6.0,),
        {"components": (sm.Rigid("tip", name="plate", mass=0.005), sm.Gravity("0.3, 0.5, -0.8"))},
    ),
    "rail": (SMALL, (8.0,), {"components": (sm.Clamp("tip", slip="z", name="rail"),)}),
}
CASES = [
    DISK,
    SLAB,
    FINGER,
    *(sm.Case(name, it, LAW, steps=steps_of(pressure_cm=cm), **more) for name, (it, cm, more) in RIGID.items()),
]


def main() -> None:
    words = sys.argv[1:]
    chosen = [sm.Case.from_file(word) for word in words if word.endswith(".toml")]
    for case in chosen or [case for case in CASES if case.name in words] or CASES:
        compare(dataclasses.replace(case, formulation="displacement"))


def compare(case: sm.Case) -> None:
    """Print a case's own displacements beside CalculiX'."""
    run = sm.run(case)
    # Dead loads are CalculiX' first step and the state that the path begins with.
    loaded = any(isinstance(part, LOADS) for part in case.components)
    rows = [*run.rows[:loaded], *(row for row in run.rows if row["requested"] and row["pressure_cm"])]
    with tempfile.TemporaryDirectory() as folder:
        deck = sm.export(case, Path(folder) / "deck.inp")
        subprocess.run(["ccx", "deck"], cwd=folder, capture_output=True, check=False)
        steps = read_displacements((Path(folder) / "deck.dat").read_text())
    for row, step in zip(rows, steps, strict=True):
        for name, (ours, theirs, unit) in figures(case, deck.watched, row, step).items():
            off = theirs / ours - 1
            told = f"{ours:.6f} {unit}, CalculiX {theirs:.6f} {unit}"
            print(f"{case.name} {row['pressure_cm']:g} cm, {name}: {told}, off by {off:+.1e}", flush=True)


def figures(
    case: sm.Case, watched: Mapping[str, int], row: Mapping[str, float], step: Mapping[int, npt.NDArray[np.float64]]
) -> dict[str, tuple[float, float, str]]:
    """By name what both programs tell: the rise of probes, ways and turns of rigid parts, where these are not zero."""
    lift = np.array(case.actuator.lift)
    found = {name: (row[f"{name}_mm"], float(step[watched[name]] @ lift), "mm") for name in case.actuator.probes}
    for name in (part.label for part in case.components if isinstance(part, sm.Rigid)):
        for what, key, unit in (("centre", "", "mm"), ("rotation vector", "turn_", "deg")):
            node = next((node for words, node in watched.items() if words.startswith(f"{what} of {name}")), None)
            for axis, theirs in zip("xyz", step[node] if node is not None else (), strict=False):
                ours = row.get(f"{name}_{key}{axis}_{unit}", 0.0)
                if abs(ours) > 1e-9:
                    found[f"{name}_{key}{axis}"] = ours, float(theirs if unit == "mm" else np.degrees(theirs)), unit
    return found


if __name__ == "__main__":
    main()
