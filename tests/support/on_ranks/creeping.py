"""Columns of a disk with a memory: a section that is raised, held and let down, and a coarse wedge that is not held."""

from __future__ import annotations

import softmodels as sm

COLUMNS = (
    "added_volume_ml", "apex_mm", "max_von_mises_kPa", "stored_energy_mJ", "dissipated_energy_mJ",
    "lowest_eigenvalue_Pa_per_mm2",
)  # fmt: skip
THINNING = {"share": 0.1, "time": 30.0, "onset": 0.05, "exponent": 0.3, "spring": [[0.8, 1], [0.2, -2]]}
LAW = sm.Yeoh(14e3, 60.0).with_memory(branches=[(0.2, 1.0), THINNING], softening=(1.6, "2 kPa", 0.1))


def figures(comm, folder) -> dict[str, list[float]]:
    """The columns by their names and the section's."""
    found = {}
    for section, pressures, times in (
        ("axisymmetric", ["25 cm", "25 cm", "5 cm"], [5.0, 8.0, 10.0]),
        ("wedge", ["10 cm", "5 cm"], [2.0, 3.0]),
    ):
        disk = sm.HollowDisk(section=section, angle=15.0, cell_size=6e-3, fillet=0.0, base_fillet=0.0)
        run = sm.inflate(disk, LAW, pressures=pressures, times=times)
        found |= {f"{column}, {section}": [float(value) for value in run.path[column]] for column in COLUMNS}
    return found
