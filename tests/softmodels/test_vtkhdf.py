"""VTKHDF beside the XDMF: VTK's own readers give the same from both, while a run goes on and after it."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path
from xml.etree import ElementTree

import h5py
import numpy as np
import pytest

from softmodels.runs import formats
from softmodels.runs.store import Results
from softmodels.runs.table import Row
from tests.support.campaigns import sampled

# VTK and h5py each bring an HDF5: VTK reads in a process of its own.
READ = """
import sys, numpy as np, pyvista
from vtkmodules.vtkIOHDF import vtkHDFReader
from vtkmodules.vtkIOXdmf2 import vtkXdmfReader
from tests.support.campaigns import sampled

def steps(reader, file, count):
    reader.SetFileName(file)
    reader.UpdateInformation()
    times = reader.GetExecutive().GetOutputInformation(0).Get(pyvista._vtk.vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    times = times or (0.0,)  # of a single step
    assert len(times) == count, times
    for time in times:
        reader.UpdateTimeStep(time)
        yield time, pyvista.wrap(reader.GetOutputDataObject(0))

found = {}
for kind, reader, file in (("vtkhdf", vtkHDFReader(), sys.argv[1]), ("xdmf", vtkXdmfReader(), sys.argv[2])):
    for time, grid in steps(reader, file, int(sys.argv[4])):
        grid = grid[0] if isinstance(grid, pyvista.MultiBlock) else grid
        found |= {f"{kind}/{time:g}/{name}": np.asarray(values) for name, values in grid.point_data.items()}
        found |= {f"{kind}/{time:g}/points": grid.points, f"{kind}/{time:g}/cells": grid.cells}
        found[f"{kind}/{time:g}/types"] = grid.celltypes
whole = pyvista.read(sys.argv[1])
assert whole.n_cells == len(found["vtkhdf/0/types"]) and "displacement" in whole.point_data
np.savez(sys.argv[3], **found)
"""
STEPS, MODE = 4, 2
POINTS = np.array([(0, 0), (2, 0), (0, 2), (1, 0), (1, 1), (0, 1), (2, 2), (2, 1), (1, 2)], dtype=float)
MESHES = {
    "Triangle_6": np.array([(0, 1, 2, 3, 4, 5), (1, 6, 2, 7, 8, 4)]),
    "Tetrahedron_10": np.array([(0, 1, 2, 6, 3, 4, 5, 7, 8, 4)]),
}


def fields(step):
    random = np.random.default_rng(step)
    found = {"displacement": random.normal(size=(9, 3)), "J": random.normal(size=9), "F": random.normal(size=(9, 3, 3))}
    return {**found, "mode": random.normal(size=(9, 3))} if step == MODE else found


def read(folder, count, tmp_path):
    """What VTK finds by step and name, of the VTKHDF; it is the same as of the XDMF."""
    words = [folder / "disk.vtkhdf", folder / "disk.xdmf", tmp_path / "found.npz", count]
    done = subprocess.run([sys.executable, "-c", READ, *map(str, words)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "found.npz") as file:
        whole = {name: file[name] for name in file}
    found = {name.removeprefix("vtkhdf/"): values for name, values in whole.items() if name.startswith("vtkhdf")}
    others = {name.removeprefix("xdmf/"): values for name, values in whole.items() if name.startswith("xdmf")}
    assert {f"{step}/{name}" for step in range(count) for name in ("displacement", "J", "points", "cells")} <= set(others)
    for name, values in others.items():
        assert np.array_equal(found[name], values), name
    return found


@pytest.mark.parametrize("cell", sampled(MESHES))
def test_each_step_is_read_while_the_run_goes_on_and_after_it(cell, tmp_path):
    results = Results(tmp_path / "run", "disk")
    results.folder.mkdir()
    results.begin(np.column_stack([POINTS, np.arange(9)]), MESHES[cell], cell)

    def check(count):
        found = read(results.folder, count, tmp_path)
        for step in range(count):
            for name, values in fields(step).items():
                assert np.array_equal(found[f"{step}/{name}"], values.reshape(9, -1).squeeze()), (step, name)
            # VTK wants every array in every step: zeros where there is no mode.
            if step != MODE:
                assert not found.get(f"{step}/mode", np.zeros(1)).any()
        assert np.array_equal(found["0/cells"].reshape(len(MESHES[cell]), -1)[:, 1:], MESHES[cell])

    for step in range(STEPS):
        results.add(formats.StateRecord(Row({"step": step, "bifurcation": int(step == MODE)}), fields(step), {}))
        if step in (0, MODE):
            check(step + 1)
    results.finish()
    check(STEPS)
    assert not results.steps.exists()
    moved = tmp_path / "elsewhere" / "alone.vtkhdf"  # the one file has everything
    moved.parent.mkdir()
    shutil.copy(results.folder / "disk.vtkhdf", moved)
    page = (Path(__file__).parents[2] / "docs" / "pages" / "devices" / "disk.md").read_text()
    shown = re.search(r"```python\n( *import pyvista\n.*?) *```", page, re.DOTALL)[1]
    code = textwrap.dedent(shown).replace("results/disk/disk.vtkhdf", str(moved)) + "print(grid['J'].tolist())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == fields(STEPS - 1)["J"].tolist()


@pytest.mark.parametrize(
    ("columns", "times"),
    [
        ({"pressure_cm": (0.0, 2.5, 5.0), "added_volume_ml": (0.0, 1.0, 2.0)}, (0.0, 2.5, 5.0)),
        ({"pressure_cm": (0.0, -2.5, -5.0)}, (0.0, 2.5, 5.0)),
        ({"pressure_cm": (0.0, 5.0, 4.0), "added_volume_ml": (0.0, 1.0, 2.0)}, (0.0, 1.0, 2.0)),
        ({"pressure_cm": (0.0, 5.0, 4.0), "added_volume_ml": (0.0, 2.0, 1.0)}, (0.0, 1.0, 2.0)),
        ({"pressure_cm": (0.0, 5.0, 4.0), "time_s": (0.0, 0.5, 9.0)}, (0.0, 0.5, 9.0)),
        ({"pressure_cm": (None, None, None)}, (0.0, 1.0, 2.0)),
    ],
)
def test_the_time_of_a_step_is_its_time_or_its_load(columns, times, tmp_path):
    """In both files that ParaView reads; the step's number only where the path turns back."""
    results = Results(tmp_path / "run", "disk")
    results.folder.mkdir()
    results.begin(np.column_stack([POINTS, np.arange(9)]), MESHES["Triangle_6"], "Triangle_6")
    for step in range(3):
        results.add(
            formats.StateRecord(Row({"step": step, **{name: values[step] for name, values in columns.items()}}), fields(0), {})
        )
    for _ in range(2):
        with h5py.File(results.folder / "disk.vtkhdf") as file:
            assert tuple(file["VTKHDF/Steps/Values"]) == times
        values = ElementTree.parse(results.folder / "disk.xdmf").iter("Time")
        assert tuple(float(item.get("Value")) for item in values) == times
        results.finish()


def test_nothing_is_stored_twice(tmp_path):
    results = Results(tmp_path / "run", "disk")
    results.folder.mkdir()
    count = 20_000
    cells = np.random.default_rng(0).integers(0, count, size=(count, 6))
    results.begin(np.zeros((count, 3)), cells, "Triangle_6")
    for step in range(3):
        results.add(
            formats.StateRecord(Row({"step": step}), {"displacement": np.random.default_rng(step).normal(size=(count, 3))}, {})
        )
    light = results.folder / "disk.vtkhdf"
    assert light.stat().st_size < 0.1 * results.heavy.stat().st_size
    results.finish()
    data = 8 * (3 * count + cells.size + 3 * 3 * count)
    assert results.heavy.stat().st_size < 1.05 * data and light.samefile(results.heavy)
    places = [item.text for item in ElementTree.parse(results.folder / "disk.xdmf").iter("DataItem")]
    with h5py.File(results.heavy) as file:
        for place in places:
            name, path = place.split(":")
            assert name == "disk.h5" and not file[path].is_virtual
        assert file["VTKHDF/PointData/displacement"].is_virtual and file["VTKHDF/Connectivity"].is_virtual


def test_a_run_continued_after_its_end_has_all_steps(tmp_path):
    results = Results(tmp_path / "run", "disk")
    results.folder.mkdir()
    results.begin(np.column_stack([POINTS, np.arange(9)]), MESHES["Triangle_6"], "Triangle_6")
    for step in range(2):
        results.add(formats.StateRecord(Row({"step": step}), fields(step), {}))
    results.finish()
    again = Results(tmp_path / "run", "disk")
    again.load()
    again.add(formats.StateRecord(Row({"step": 2}), fields(2), {}))
    for _ in range(2):  # while it goes on, and gathered again
        found = read(again.folder, 3, tmp_path)
        for step in range(3):
            assert np.array_equal(found[f"{step}/J"], fields(step)["J"])
        again.finish()
