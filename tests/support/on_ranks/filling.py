"""Columns of a disk that is filled through a tube and leaks, elastic and with a memory: a section, and a coarse wedge."""

from __future__ import annotations

import softmodels as sm

COLUMNS = ("pressure_Pa", "added_volume_ml", "apex_mm", "flow_ml_per_min", "gas_ml", "time_s")
ELASTIC = sm.Yeoh(14e3, 60.0)
LAWS = {"axisymmetric": ELASTIC.with_memory(branches=[(0.2, 1.0)]), "wedge": ELASTIC}
RESERVOIR = sm.Reservoir(tube_length=2.0, tube_bore=0.5e-3, conductance=1e-10, leak_conductance=5e-12)


def figures(comm, folder) -> dict[str, list[float]]:
    """The columns by their names and the section's."""
    found = {}
    for section, stops in (("axisymmetric", 4), ("wedge", 2)):
        disk = sm.HollowDisk(section=section, angle=15.0, cell_size=6e-3, fillet=1.5e-3)
        load = {"pressures": ["25 cm"] * stops, "valve": [1, 1, 0, 0][:stops], "times": [0.0, 1.0, 1.0, 2.0][:stops]}
        run = sm.inflate(disk, LAWS[section], supply=RESERVOIR, **load)
        found |= {f"{column}, {section}": [float(value) for value in run.path[column]] for column in COLUMNS}
    return found
