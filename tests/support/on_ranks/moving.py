"""Columns of devices with mass: a balloon on an air supply, and a beam in three dimensions that a force bends at once."""

from __future__ import annotations

import softmodels as sm
from softmodels.case.load import steps_of

BALLOON = sm.Balloon(neck_radius=0.0, cell_size=4e-3, through=1)
RUBBER = sm.Gent(30e3, 25.0, 0.5).with_memory(branches=[(0.3, "2 ms")])
RESERVOIR = sm.Reservoir(tube_length="0.1 m", tube_bore="8 mm", dead_volume="5 l")
BEAM = sm.Beam(length=0.05, width=0.005, thickness=0.005, cell_size=0.005)
FORCE = sm.Force("tip", "-z")
BENT = steps_of(**{"force": {"force_N": [1e-3, 1e-3]}, "time_s": [0.0, 0.01]})
COLUMNS = {
    "balloon": ("time_s", "pressure_Pa", "added_volume_ml", "stored_energy_mJ", "kinetic_energy_mJ"),
    "beam": ("time_s", "moved_mm", "stored_energy_mJ", "kinetic_energy_mJ"),
}


def figures(comm, folder) -> dict[str, list[float]]:
    """The columns by their names and the device."""
    paths = {
        "balloon": sm.inflate(
            BALLOON, RUBBER, pressures=["2.9 kPa"] * 2, times=[0.0, 0.004], supply=RESERVOIR, inertia=True,
            time_tolerance=5e-4,
        ).path,
        "beam": sm.inflate(
            BEAM, sm.NeoHookean(30e3, 0.4), steps=BENT, components=FORCE, inertia=True,
            time_tolerance=5e-4,
        ).path,
    }  # fmt: skip
    return {f"{column}, {name}": paths[name][column].tolist() for name, columns in COLUMNS.items() for column in columns}
