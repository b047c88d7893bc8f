"""Runs of the command line in processes of their own, and what they leave behind."""

from __future__ import annotations

import csv
import os
import shutil
import subprocess
import sys
import types
from xml.etree import ElementTree

import h5py
import numpy as np
import pytest

from geometries import HollowDisk, SeminarActuator
from geometries.meshing import private_model
from softmodels.case.case import Case
from softmodels.case.materials import DEFAULT
from softmodels.cli.options import main
from softmodels.pictures.offscreen import can_render
from softmodels.runs.row import Row
from softmodels.runs.store import Results

DISK = ("-m", "softmodels.disk", "--section", "axisymmetric", "--no-pictures")
SOFT = ("--variant", "shadow", "--pressure-cm", "0,52.5,52.9,60", "--quiet")


def start(*arguments, **options):
    """Start a Python process, its output kept as text; the words follow the interpreter's name."""
    command = [*map(str, options.pop("launcher", ())), sys.executable, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


def run(*arguments, **options):
    """Run a Python process to its end: ``status``, ``out`` and ``err``."""
    process = start(*arguments, **options)
    out, err = process.communicate(timeout=300)
    return types.SimpleNamespace(status=process.returncode, out=out, err=err)


def disk(folder, *arguments, **options):
    """Run the axisymmetric disk without pictures into a folder."""
    return run(*DISK, "--output", folder, *arguments, **options)


def rows(folder):
    """The table of a folder of results; numbers as numbers, None for an empty cell."""
    with (folder / "path.csv").open() as file:
        return [
            {key: value if key == "following" else float(value) if value else None for key, value in row.items()}
            for row in csv.DictReader(file)
        ]


def readable(folder):
    """Number of states in a folder, after everything the XDMF refers to has been read."""
    xdmf = ElementTree.parse(folder / "disk.xdmf")
    places = {item.text: item.get("Dimensions") for item in xdmf.iter("DataItem")}
    for place, shape in places.items():
        name, inside = place.split(":")
        with h5py.File(folder / name) as file:
            assert np.isfinite(file[inside][:]).all() and " ".join(map(str, file[inside].shape)) == shape
    return len(xdmf.findall(".//Time"))


def same(found, wanted, tolerance):
    """Whether two tables hold the same numbers, to a share of each column's largest one."""
    assert [row["step"] for row in found] == [row["step"] for row in wanted]
    for name in wanted[0]:
        if name == "following":
            assert [row[name] for row in found] == [row[name] for row in wanted]
        elif name != "newton_iterations":
            assert [row[name] is None for row in found] == [row[name] is None for row in wanted]
            column = [row[name] or 0.0 for row in wanted]
            assert [row[name] or 0.0 for row in found] == pytest.approx(
                column, rel=0, abs=tolerance * max(map(abs, column))
            ), name


@pytest.fixture(scope="session")
def runs():
    """The functions of this file: modules of tests cannot import each other."""
    return types.SimpleNamespace(
        DISK=DISK, SOFT=SOFT, start=start, run=run, disk=disk, rows=rows, readable=readable, same=same
    )


@pytest.fixture
def ended(monkeypatch, capsys):
    """Return a function that runs a command in this process: its exit status, what it printed, and its complaints."""

    def run_command(asked, *arguments):
        monkeypatch.setattr(sys, "argv", ["softmodels", *map(str, arguments)])
        status = 0
        try:
            main(asked)
        except SystemExit as end:
            status = end.code or 0
        printed = capsys.readouterr()
        return status, printed.out, printed.err

    return run_command


@pytest.fixture(scope="session")
def whole(tmp_path_factory):
    """A run to 177 cm in 36 steps that nothing disturbed: its folder, and what it said."""
    folder = tmp_path_factory.mktemp("whole") / "disk"
    return folder, disk(folder, "--pressure-cm", "0:177:5")


@pytest.fixture
def whole_copy(whole, tmp_path):
    """The undisturbed run's folder, to be changed."""
    return shutil.copytree(whole[0], tmp_path / "copy")


@pytest.fixture(scope="session")
def limited(tmp_path_factory):
    """A run past a limit point, which it cannot but meet: its folder, and what it said."""
    folder = tmp_path_factory.mktemp("limited") / "disk"
    return folder, disk(folder, *SOFT)


# -- made-up results to draw --------------------------------------------------------------------------------------------

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
    (folder / "case.toml").write_text(Case(name, device, DEFAULT, (50.0, 100.0, 150.0)).to_toml())
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
        results.add(Row(row), {**fields, "p": stress, "largest_stretch": 1 + 1e-5 * stress, "J": 1 + 0 * stress}, {})
    results.finish()
    return folder


def command(*arguments):
    """Start the drawing program in a process of its own, as it is meant to run, and without a display."""
    environment = {key: value for key, value in os.environ.items() if key != "DISPLAY"}
    line = [sys.executable, "-m", "softmodels.pictures.draw", *map(str, arguments)]
    return subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)


def finished(process):
    """Wait for a process of `command`."""
    out, err = process.communicate(timeout=240)
    return subprocess.CompletedProcess(process.args, process.returncode, out, err)


@pytest.fixture(scope="session")
def drawings():
    """The functions of made-up results."""
    return types.SimpleNamespace(
        grid_of=grid_of, displacement=displacement, command=lambda *words: finished(command(*words))
    )


@pytest.fixture(scope="session")
def wedge(tmp_path_factory):
    return made_up(tmp_path_factory.mktemp("wedge"), HollowDisk(cell_size=0.006, refinement=1.0))


@pytest.fixture(scope="session")
def half_section(tmp_path_factory):
    return made_up(tmp_path_factory.mktemp("half"), HollowDisk(section="axisymmetric", cell_size=0.006, refinement=1.0))


@pytest.fixture(scope="session")
def half_slab(tmp_path_factory):
    slab = SeminarActuator(channels=2, spread=40.0, around=6.0, cell_size=0.008)
    return made_up(tmp_path_factory.mktemp("slab"), slab, "slab")


@pytest.fixture(scope="session")
def drawn(wedge, half_slab):
    """Return a function that gives a kind's folder, drawn by the program, and what it said."""
    if not can_render():
        pytest.skip("this machine cannot render")
    folders = {"wedge": wedge, "half_slab": half_slab}
    started = {kind: command(folder) for kind, folder in folders.items()}
    ended = {kind: finished(process) for kind, process in started.items()}
    return lambda kind: (folders[kind], ended[kind])
