"""The mesh error of a run's numbers, against meshes with much smaller cells, and where it is printed."""

from __future__ import annotations

import dataclasses
import json
import re

import numpy as np
import pytest

import softmodels as sm
from geometries import meshing
from softmodels.api.calls import case_of
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.case.materials import MaterialErrors
from softmodels.components.loads import Gravity
from softmodels.mechanics import mpi
from softmodels.runs import budget, mesh_error, simulation
from softmodels.runs.simulation import Simulation
from tests.support import runs
from tests.support.campaigns import sampled

DISK = sm.HollowDisk(section="axisymmetric")
LAW = sm.Yeoh(14e3, 60.0)
DEVICES = {
    "disk": (DISK, "0,100 cm"),
    "tube": (sm.Cylinder(section="axisymmetric"), "0,5 kPa"),
    "balloon": (sm.Balloon(), "0,10 cm"),
    "cup": (sm.SuctionCup(), "0,-0.4 kPa"),
}


def last_with(device, pressures, finer, folder):
    """The last state on a mesh with smaller cells."""
    simulation = Simulation(case_of(device.refined(finer), LAW, pressures), mpi.start())
    simulation.write_mesh(folder / "mesh.msh")
    simulation.prepare(folder / "mesh.msh")
    *_, last = simulation.steps()
    simulation.release()
    return last.row


@pytest.mark.parametrize("name", sampled(DEVICES))
def test_the_half_width_holds_the_error(name, tmp_path):
    device, pressures = DEVICES[name]
    run = sm.inflate(device, LAW, pressures, mesh_error=True)
    fine = last_with(device, pressures, 3.0, tmp_path)
    for figure in (device.gauge, "added_volume"):
        error = abs(run.table[-1][figure] - fine[figure])
        assert error < run.mesh_errors[figure] < 4 * error


def test_two_meshes_of_a_solid_that_agree_by_chance(tmp_path):
    """Two meshes of a bending bellows gave an eighth of the true error of its rise: walls with cells wider than they are thick
    do not converge evenly. Larger cells show it."""
    device = sm.BendingBellows(folds=2, finer=2 / 3)
    run = sm.inflate(device, sm.Carroll(15e3, 0.01, 15e3), "0,2 kPa", mesh_error=True)
    fine = sm.inflate(device.refined(9 / 4), run.case.material, "0,2 kPa")
    error, row = abs(run.rise[-1] - fine.rise[-1]), run.table[-1]
    two = mesh_error.MeshErrors(run.case, run.table, {"finer": run._source.meshes["finer"]}).of(row)[device.gauge]
    assert two < 0.5 * error < error < run.mesh_errors[device.gauge] < 4 * error
    assert "cells 1.5 times smaller (finer.csv) and larger (coarser.csv)" in run.budget.mesh.text()
    run.save(tmp_path / "run")
    assert sm.load(tmp_path / "run").mesh_errors == pytest.approx(run.mesh_errors, rel=1e-6)


@pytest.mark.parametrize(
    "device", [DISK, sm.Balloon(), sm.Beam(), sm.Membrane(section="wedge"), sm.HollowDisk()], ids=lambda d: type(d).__name__
)
def test_all_cells_get_smaller(device, tmp_path):
    own, finer = (meshing.summarize(device.refined(n).write(tmp_path / f"{n}.msh")) for n in (1, 1.5))
    assert 1.5**device.dimension == pytest.approx(finer.cells / own.cells, rel=0.3)
    assert finer.measure == pytest.approx(own.measure, rel=2e-3)


def test_on_the_command_line(tmp_path):
    done = runs.disk(tmp_path / "disk", "--pressure-cm", "0,50", "--mesh-error")
    assert done.status == 0 and " +- " in done.out and " mm (95 %): mesh 0.000" in done.out
    errors = json.loads((tmp_path / "disk" / "summary.json").read_text())["errors"]
    assert errors[-1]["apex_mm"]["half_width"] == errors[-1]["apex_mm"]["mesh"] > 0.0
    run = sm.load(tmp_path / "disk")
    assert 1e3 * run.mesh_errors["apex"] == pytest.approx(errors[-1]["apex_mm"]["mesh"], rel=1e-9)
    sentence = run.budget.mesh.text()
    number = r"rise of the apex ([\d.]+) \+- (0\.000\d\d) mm, "
    value, half = re.search(number, sentence).groups()
    assert float(half) == pytest.approx(errors[-1]["apex_mm"]["half_width"], rel=0.05) and len(value) == len(half)
    again = sm.inflate(DISK, run.case.material, "0,50 cm", mesh_error=True)
    assert run.mesh_errors == pytest.approx(again.mesh_errors, rel=1e-3)


def test_of_the_limit_that_is_searched_for():
    limit = sm.limit(sm.Balloon(), sm.NeoHookean(20e3), mesh_error=True)
    fine = sm.limit(sm.Balloon(cell_size=0.0004, through=5), sm.NeoHookean(20e3))
    assert abs(limit.pressure - fine.pressure) < limit.mesh_error < 4 * abs(limit.pressure - fine.pressure)
    words = ("limit", "--device", "Balloon", "--material", "neo-hookean", "--shear-modulus", "20kPa", "--mesh-error")
    done = runs.run("-m", "softmodels", *words)
    assert done.status == 0 and "(95 %: mesh " in done.out


def test_of_frequencies():
    beam = sm.Beam(part="full", cell_size=0.005)
    modes = sm.modes(beam, sm.NeoHookean(50e3, 0.45), count=2, mesh_error=True)
    fine = sm.modes(dataclasses.replace(beam, cell_size=0.0025), sm.NeoHookean(50e3, 0.45), count=2)
    errors = np.abs(modes.frequency - fine.frequency)
    assert np.all(errors < modes.mesh_error) and np.all(modes.mesh_error < 0.05 * modes.frequency)


def test_frequencies_of_a_device_on_an_edge_have_none():
    """A disk's section on its rim, a point: with cells half as large its frequency falls by 6 %, and again and again."""
    modes, glued = (
        sm.modes(dataclasses.replace(DISK, support=support), LAW, count=1, mesh_error=True) for support in ("rim", "base")
    )
    assert not modes.convergent and np.isnan(modes.mesh_error).all()
    assert any("held along edges or at points ('support')" in note for note in modes.notes)
    assert glued.convergent and np.all(glued.mesh_error < 0.01 * glued.frequency)


def test_of_a_limit_point():
    run = sm.inflate(sm.Balloon(), sm.NeoHookean(20e3), "0:60 cm", mesh_error=True)
    limit = run.table.where("limit")[0]
    errors = mesh_error.MeshErrors(run.case, run.table, run._source.meshes).of(limit)
    assert any(line.startswith("limit pressure ") and "cm (95 %): mesh " in line for line in run.budget.lines())
    assert 0.0 < errors["pressure"] < 0.01 * limit["pressure"]


@pytest.mark.campaign
def test_smaller_cells_cure_a_mesh_that_is_told_to_be_too_coarse():
    coarse = sm.inflate(sm.SuctionCup(cell_size=0.004, through=1), LAW, "0,-0.4 kPa", mesh_error=True)
    assert any("the mesh error of the added volume" in note and "finer=2" in note for note in coarse.notes)
    finer = sm.inflate(sm.SuctionCup(cell_size=0.004, through=1, finer=2), LAW, "0,-0.4 kPa", mesh_error=True)
    assert finer.mesh_errors["added_volume"] < 0.6 * coarse.mesh_errors["added_volume"]


@pytest.mark.campaign
def test_cells_for_an_accuracy(tmp_path):
    asked = sm.inflate(DISK, LAW, "0,100 cm", accuracy="0.05%")
    assert not asked.case.accuracy and asked.case.actuator.finer == 2.0
    fine = last_with(DISK, "0,100 cm", 6.0, tmp_path)
    for name in ("apex", "added_volume"):
        true = abs(asked.table[-1][name] - fine[name])
        assert true <= asked.mesh_errors[name] <= 5e-4 * abs(fine[name])


def test_cells_for_an_accuracy_on_the_command_line(tmp_path):
    done = runs.disk(tmp_path / "disk", "--pressure-cm", "0,50", "--accuracy", "0.05%")
    assert done.status == 0 and "with --finer 2 the mesh error" in done.err
    stored = sm.load(tmp_path / "disk")
    assert stored.case.actuator.finer == 2.0 and stored.mesh_errors["apex"] <= 5e-4 * abs(stored.rise[-1])


def test_an_accuracy_that_cannot_be_reached(monkeypatch):
    monkeypatch.setattr(simulation, "MOST_REFINEMENTS", 1)
    with pytest.raises(CaseError, match="must be 0"):
        case_of(DISK, LAW, "0,100 cm", accuracy=3.0)
    with pytest.raises(sm.RunError, match="is not reached: with finer=1 the mesh error"):
        sm.inflate(DISK, LAW, "0,5 cm", accuracy=1e-5)


def test_an_accuracy_is_of_runs():
    with pytest.raises(CaseError, match="of a run only"):
        sm.limit(DISK, LAW, accuracy=0.01)
    with pytest.raises(CaseError, match="of a run only"):
        sm.modes(DISK, LAW, accuracy=0.01)


def test_of_a_cup_whose_held_lip_is_a_notch():
    """With its mirror image below the plane the inner edge of the lip is a notch of 280 degrees."""
    run = sm.inflate(sm.SuctionCup(), LAW, "0,-0.4 kPa", mesh_error=True)
    assert run.mesh_errors["added_volume"] < 0.02 * abs(run.added_volume[-1])
    assert run.mesh_errors[run.case.actuator.gauge] < 0.02 * abs(run.rise[-1])


def test_with_the_materials_errors():
    run = sm.inflate(DISK, LAW, "0,50 cm", band=MaterialErrors(("c1",), ((700.0**2,),)), mesh_error=True)
    parts = budget.parts(run.table[-1], "apex", run.mesh_errors)
    assert set(parts) == {"material", "mesh"} and parts["material"] > 10 * parts["mesh"]


def test_a_part_whose_mesh_is_given(tmp_path):
    sm.Beam().write(tmp_path / "beam.msh")
    part = sm.ImportedMesh(file=str(tmp_path / "beam.msh"), unit="m", support="x = 0 mm", cavities=("none",))
    weight = steps_of(share="0:1")
    with pytest.raises(CaseError, match="mesh the part more finely"):
        case_of(part, LAW, mesh_error=True, steps=weight, components=[Gravity("-z")])
