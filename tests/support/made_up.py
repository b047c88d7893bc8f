"""Made-up results to draw, and the drawing program in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np

from geometries.meshing import private_model
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.case.materials import DEFAULT
from softmodels.runs import formats
from softmodels.runs.store import Results
from softmodels.runs.table import Row

RISE, SPREAD, STEPS = 4e-3, 0.05, 6
"""Of the made-up displacement at full load: rise of the top in m, radial strain; and the number of states."""


def grid_of(device, folder):
    """Points in device coordinates and cells in VTK's order of nodes."""
    import gmsh

    gmsh_type, count, order, name = {
        2: (9, 6, [0, 1, 2, 3, 4, 5], "Triangle_6"),
        3: (11, 10, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8], "Tetrahedron_10"),
    }[device.dimension]
    file = device.write(folder / "made-up.msh")
    with private_model():
        gmsh.merge(str(file))
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        _, nodes = gmsh.model.mesh.getElementsByType(gmsh_type)
    number_of = np.zeros(int(tags.max()) + 1, dtype=int)
    number_of[tags.astype(int)] = np.arange(len(tags))
    cells = number_of[nodes.astype(int)].reshape(-1, count)[:, order]
    return device.device_points(coordinates.reshape(-1, 3)), cells, name


def displacement(device, points, share):
    """A dome that also spreads, or a slab that bends, at a share of the full load."""
    if not device.axial:
        return share * RISE * np.column_stack([0 * points[:, :2], (points[:, 0] / device.length) ** 2])
    u = np.zeros_like(points)
    u[:, :2] = share * SPREAD * points[:, :2]
    radius = np.hypot(points[:, 0], points[:, 1]) / device.outer_radius
    u[:, 2] = share * RISE * (1 - radius**2) * points[:, 2] / device.height
    return u


def made_up(folder, device, name="disk"):
    """Results with a limit point before the last step; 50 cm and 100 cm were requested."""
    results = Results(folder, name, device.gauge)
    results.clear()
    points, cells, kind = grid_of(device, folder)
    results.begin(points, cells, kind)
    (folder / "case.toml").write_text(Case(name, device, DEFAULT, steps_of(pressure_cm=(50.0, 100.0, 150.0))).to_toml())
    for k, pressure in enumerate((0.0, 25.0, 50.0, 100.0, 120.0, 110.0)):
        share = k / (STEPS - 1)
        stress = share * 1e4 * (1 + np.hypot(points[:, 0], points[:, 1]) / 0.02)
        row = {
            "step": k,
            "pressure_cm": pressure,
            "pressure_Pa": 95.0 * pressure,
            "added_volume_ml": share,
            f"{device.gauge}_mm": share * RISE * 1e3,
            "requested": int(pressure in (50.0, 100.0)),
            "limit": int(pressure == 120.0),
            "of_tomorrow_N": 1.0 / 3.0 + k,
        }
        fields = {"displacement": displacement(device, points, share), "von_mises": stress}
        nodal = {**fields, "p": stress, "largest_stretch": 1 + 1e-5 * stress, "J": 1 + 0 * stress}
        results.add(formats.StateRecord(Row(row), nodal, {}))
    results.finish()
    return folder


def start_drawing(*arguments):
    """Start the drawing program in a process of its own, as it is meant to run, and without a display."""
    environment = {key: value for key, value in os.environ.items() if key != "DISPLAY"}
    line = [sys.executable, "-m", "softmodels.pictures.draw", *map(str, arguments)]
    return subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)


def finished(process):
    """Wait for a process of `start_drawing`."""
    out, err = process.communicate(timeout=240)
    return subprocess.CompletedProcess(process.args, process.returncode, out, err)


def command(*arguments):
    """Run the drawing program to its end."""
    return finished(start_drawing(*arguments))
