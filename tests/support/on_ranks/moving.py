"""Columns of devices with mass: a balloon on an air supply, and a coarse wedge that swings."""

from __future__ import annotations

import json

import softmodels as sm

COLUMNS = ("time_s", "pressure_Pa", "added_volume_ml", "stored_energy_mJ", "kinetic_energy_mJ")
BALLOON = sm.Balloon(neck_radius=0.0, cell_size=4e-3, through=1)
RUBBER = sm.Gent(30e3, 25.0, 0.5).with_memory(branches=[(0.3, "2 ms")])
RESERVOIR = sm.Reservoir(tube_length="0.1 m", tube_bore="8 mm", dead_volume="5 l")
WEDGE = sm.HollowDisk(section="wedge", cell_size=6e-3)


def figures() -> dict[str, list[float]]:
    """The columns by their names and the device."""
    runs = {
        "balloon": sm.inflate(
            BALLOON,
            RUBBER,
            pressures=["2.9 kPa"] * 2,
            times=[0.0, 0.004],
            supply=RESERVOIR,
            inertia=True,
            time_tolerance=5e-4,
        ),
        "wedge": sm.inflate(
            WEDGE,
            sm.Yeoh(14e3, 60.0),
            pressures=["10 cm"] * 2,
            times=[0.0, 0.006],
            inertia=True,
            time_tolerance=5e-3,
        ),
    }
    paths = {name: run.path for name, run in runs.items()}
    return {f"{column}, {name}": path[column].tolist() for name, path in paths.items() for column in COLUMNS}


if __name__ == "__main__":
    values = figures()
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        print(json.dumps(values))
