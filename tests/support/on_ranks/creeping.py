"""Columns of a disk with a memory that is raised, held and let down: a section, and a coarse wedge."""

from __future__ import annotations

import json

import softmodels as sm

COLUMNS = (
    "added_volume_ml", "apex_mm", "max_von_mises_kPa", "stored_energy_mJ", "dissipated_energy_mJ",
    "lowest_eigenvalue_Pa_per_mm2",
)  # fmt: skip
THINNING = {"share": 0.1, "time": 30.0, "onset": 0.05, "exponent": 0.3, "spring": [[0.8, 1], [0.2, -2]]}
LAW = sm.Yeoh(14e3, 60.0).with_memory(branches=[(0.2, 1.0), THINNING], softening=(1.6, "2 kPa", 0.1))


def figures() -> dict[str, list[float]]:
    """The columns by their names and the section's."""
    found = {}
    for section, size in (("axisymmetric", 3e-3), ("wedge", 6e-3)):
        disk = sm.HollowDisk(section=section, cell_size=size)
        run = sm.inflate(disk, LAW, pressures=["25 cm", "25 cm", "5 cm"], times=[5.0, 8.0, 10.0])
        found |= {f"{column}, {section}": [float(value) for value in run.path[column]] for column in COLUMNS}
    return found


if __name__ == "__main__":
    values = figures()
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        print(json.dumps(values))
