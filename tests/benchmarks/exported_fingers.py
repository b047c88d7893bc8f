"""Fingers that bend, by their own path and by CalculiX's of the deck that is exported: place of the tip, bend angle.

    apt-get install calculix-ccx
    OMP_NUM_THREADS=1 uv run python tests/benchmarks/exported_fingers.py [PneuNet | BendingBellows] [neo-hookean]

Both programs have the same coarse mesh, displacements alone and Yeoh's energy (15 kPa, 60 Pa, Poisson's ratio 0.48); their
elements, tangents, follower pressures and steps are their own. The neo-Hookean law (30 kPa, 0.48) shows how much more it is
when the energies differ: CalculiX has that law in the isochoric stretches, softmodels in the whole ones.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from calculix_wedge import read_displacements

import softmodels as sm
from softmodels.case.load import steps_of
from softmodels.runs.fields import device_columns

FINGERS = {
    "PneuNet": (sm.PneuNet(chambers=2, cell_size=0.004), (6.0, 12.0)),
    "BendingBellows": (sm.BendingBellows(folds=2, cell_size=0.004), (10.0, 20.0)),
}
LAWS = {"yeoh": sm.Yeoh(15e3, 60.0, 0.0, 0.48), "neo-hookean": sm.NeoHookean(30e3, 0.48)}
COLUMNS = ("tip_x_mm", "tip_z_mm", "bend_angle_deg")


def by_calculix(case: sm.Case) -> list[dict[str, float]]:
    """The device's figures at each requested pressure, from CalculiX's displacements of its probes."""
    with tempfile.TemporaryDirectory() as folder:
        deck = Path(folder) / "deck.inp"
        sm.export(case, deck)
        subprocess.run(["ccx", "deck"], cwd=folder, capture_output=True, check=False)
        steps = read_displacements((Path(folder) / "deck.dat").read_text())
        nodes = {int(words[0]) - 1: np.array(words[1:], float) for words in map(str.split, _nodes(deck))}
    found = []
    for step in steps:
        at = {number: nodes[number] for number in step}
        places = {}
        for name, place in case.actuator.probes.items():
            number = min(at, key=lambda node: np.linalg.norm(at[node] - 1e3 * np.array(place)))
            places[name] = 1e-3 * (at[number] + step[number])
        found.append(device_columns(case.actuator, places))
    return found


def _nodes(deck: Path) -> list[str]:
    """The lines of a deck's nodes, words apart by blanks."""
    text = deck.read_text().replace(",", " ")
    begin = text.index("\n", text.index("*NODE")) + 1
    return text[begin : text.index("*", begin)].splitlines()


def main() -> None:
    words = sys.argv[1:]
    law = LAWS["neo-hookean" if "neo-hookean" in words else "yeoh"]
    for name in [word for word in words if word in FINGERS] or FINGERS:
        device, pressures = FINGERS[name]
        apart = (sm.Walls("none"),)  # a deck has no contact of walls
        case = sm.Case(name, device, law, steps=steps_of(pressure_cm=pressures), formulation="displacement", components=apart)
        theirs = by_calculix(case)
        ours = [row for row in sm.run(case).rows if row["requested"] and row["pressure_cm"]]
        for row, other in zip(ours, theirs, strict=False):
            for column in COLUMNS:
                told = f"{row[column]:.6f}, CalculiX {other[column]:.6f}"
                print(f"{name}, {row['pressure_cm']:g} cm, {column}: {told}", flush=True)


if __name__ == "__main__":
    main()
