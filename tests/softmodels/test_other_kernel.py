"""Parts drawn in CadQuery, run from case files alone.

Skipped where CadQuery is not installed: ``uv run --group dev --with cadquery pytest tests/softmodels/test_other_kernel.py``.
"""

from __future__ import annotations

import importlib.util
import math
import os
import sys
from pathlib import Path

import pytest

from softmodels.case.case import Case
from tests.support import runs

cadquery = pytest.importorskip("cadquery", reason="CadQuery is not installed (uv run --group dev --with cadquery pytest ...)")

ROUND, FLAT = math.pi * 2.5**2 * 12e-9, 12 * 8 * 2e-9
"""Volumes of the two cavities in m3: a round hole under the middle and a flat one over it."""

CASE = """
[geometry]
device = "ImportedActuator"
file = "{name}.step"
{choices}
pressure_ratios = [0.5, 1]
gauge_point = "at 30, 6, 11 mm"
cell_size = "4 mm"

[material]
silicone = "ecoflex-00-30"

[load]
pressure_cm = [0, 30]
"""
FULL = """
cavities = ["at 12, 0, 3.5 mm", "at 18, 0, 8 mm"]
support = "x = 0 mm"
"""
HALF = """
cavities = ["named round hole", "named flat hole"]
support = "coloured red"
planes = ["named cut"]
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A folder with a block of 30 x 12 x 11 mm with two cavities, and its half, drawn elsewhere and moved by an assembly."""
    folder = tmp_path_factory.mktemp("bench")
    block = cadquery.Workplane().box(30, 12, 11, centered=(False, True, False))
    hole = cadquery.Workplane("YZ", origin=(6, 0, 3.5)).circle(2.5).extrude(12)
    flat = cadquery.Workplane().box(12, 8, 2, centered=(False, True, False)).translate((12, 0, 7))
    part = block.cut(hole).cut(flat)
    cadquery.exporters.export(part, str(folder / "full.step"))
    half = part.intersect(cadquery.Workplane().box(30, 6, 11, centered=False)).translate((100, 5, 0))
    assembly = cadquery.Assembly().add(half, name="half", loc=cadquery.Location((-100, -5, 0)))
    assembly.addSubshape(half.faces("<X").val(), color=cadquery.Color("red"))
    for face in half.faces("<Y").vals():
        assembly.addSubshape(face, name="cut")
    assembly.addSubshape(half.faces("%CYLINDER").val(), name="round hole")
    assembly.addSubshape(half.faces(cadquery.selectors.NearestToPointSelector((118, 7, 7))).val(), name="flat hole")
    assembly.export(str(folder / "half.step"))
    for name, text in (("full", FULL), ("half", HALF)):
        (folder / f"{name}.toml").write_text(CASE.format(name=name, choices=text))
    return folder


@pytest.fixture(autouse=True)
def projects_python(monkeypatch):
    """Runs start in the project's own environment: MPI and HDF5 are not found from one that ``--with`` layers over it."""
    python = Path(importlib.util.find_spec("mpi4py").origin).parents[4] / "bin" / "python"
    if python.is_file():
        monkeypatch.setattr(sys, "executable", str(python))


@pytest.mark.parametrize(("name", "copies"), [("full", 1), ("half", 2)])
def test_volumes_are_those_that_were_drawn(name, copies, bench):
    part = Case.from_file(bench / f"{name}.toml").actuator
    assert part.copies == copies and part.cavity_volume == pytest.approx(0.5 * ROUND + FLAT, rel=1e-4)
    assert part.solid_volume == pytest.approx(30 * 12 * 11e-9 - ROUND - FLAT, rel=1e-9)


def test_half_and_full_run_alike_from_their_case_files(bench):
    last = []
    for name in ("full", "half"):
        words = ("-m", "softmodels", "run", f"{name}.toml", "--output", name, "--no-pictures", "--quiet")
        done = runs.run(*words, cwd=bench, env={**os.environ, "OMP_NUM_THREADS": "1"})
        assert (done.status, done.err) == (0, "")
        last.append(runs.rows(bench / name)[-1])
    full, half = last
    assert full["pressure_cm"] == half["pressure_cm"] == 30
    assert full["max_displacement_mm"] > 1.0
    # Two meshes of one part, 2,000 cells or so with sharp corners.
    for column in ("max_displacement_mm", "added_volume_ml", "stored_energy_mJ"):
        assert half[column] == pytest.approx(full[column], rel=0.03), column


def test_a_name_that_is_not_there_is_refused_before_anything_is_solved(bench):
    (bench / "wrong.toml").write_text(CASE.format(name="half", choices=HALF.replace("round", "square")))
    done = runs.run("-m", "softmodels", "run", "wrong.toml", cwd=bench)
    assert done.status == 2 and "names of faces in the file are cut, flat hole, round hole" in done.err
