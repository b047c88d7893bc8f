"""The budget of a run's numbers: its parts against devices solved with other lengths and readings, and where it is printed."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest

import softmodels as sm
from softmodels.api.calls import case_of
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.case.materials import MaterialErrors
from softmodels.case.tolerances import Tolerances
from softmodels.common.units import HALF_WIDTH_95
from softmodels.mechanics import mpi
from softmodels.pictures import comparison
from softmodels.runs import budget, mesh_error, simulation
from tests.support import runs

LAW = sm.NeoHookean(30e3)
DISK = sm.HollowDisk(section="axisymmetric")
TOLERANCE = {"membrane": "0.1 mm", "cavity_radius": "1 %", "gauge": "0.5 cm", "water_density": "1 %"}
ERRORS = MaterialErrors(("shear_modulus",), ((1500.0**2,),))


@pytest.fixture(scope="module")
def run():
    return sm.inflate(DISK, LAW, "0,100 cm", band=ERRORS, tolerance=TOLERANCE)


def meshed_anew(length, half, name):
    """Half the difference of a variable between devices made too large and too small, each meshed anew."""
    made = [DISK.replaced(**{length: getattr(DISK, length) + sign * half}) for sign in (1.0, -1.0)]
    high, low = (sm.inflate(device, LAW, "0,100 cm").table[-1][name] for device in made)
    return abs(high - low) / 2


@pytest.mark.parametrize("length, half", [("membrane", 0.1e-3), ("cavity_radius", 0.01 * DISK.cavity_radius)])
def test_lengths_move_the_state_as_devices_meshed_anew(run, length, half):
    row = run.table[-1]
    for name in ("apex", "added_volume"):
        assert row[f"{name}_ci95_{length}"] == pytest.approx(meshed_anew(length, half, name), rel=0.03)


def test_readings_move_the_state_along_the_path(run):
    row, cm = run.table[-1], run.case.column.pascal
    high, low = (sm.inflate(DISK, LAW, f"0,{100 + way} cm").table[-1] for way in (0.5, -0.5))
    for name in ("apex", "added_volume"):
        assert row[f"{name}_ci95_gauge"] == pytest.approx((high[name] - low[name]) / 2, rel=1e-3)
        assert row[f"{name}_ci95_water_density"] == pytest.approx(2 * row[f"{name}_ci95_gauge"], rel=1e-6)
    assert row["pressure_ci95_gauge"] == pytest.approx(0.5 * cm, rel=1e-9)


def test_the_half_width_is_of_all_parts(run):
    row = run.table[-1]
    parts = budget.parts(row, "apex", {})
    assert list(parts) == ["material", "cavity_radius", "membrane", "gauge", "water_density"]
    assert row["apex_ci95"] == pytest.approx(math.hypot(*parts.values()), rel=1e-12)
    alone = sm.inflate(DISK, LAW, "0,100 cm", band=ERRORS).table[-1]
    assert parts["material"] == pytest.approx(alone["apex_ci95"], rel=1e-6) and not budget.causes_in(alone, "apex")


def test_volumes_that_are_requested(run):
    volume = run.added_volume[-1]
    kept = sm.inflate(DISK, LAW, volumes=[volume], band=ERRORS, tolerance=TOLERANCE).table[-1]
    for cause in ("material", "membrane", "cavity_radius", "gauge"):
        assert kept[f"pressure_ci95_{cause}"] == pytest.approx(run.table[-1][f"pressure_ci95_{cause}"], rel=1e-4)
    assert kept["apex_ci95_gauge"] == kept["added_volume_ci95"] == 0.0 < kept["apex_ci95_membrane"]


def test_on_the_command_line(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(
        'geometry = { device = "HollowDisk", section = "axisymmetric" }\nmaterial = { law = "neo-hookean", shear_modulus = '
        '"30 kPa" }\nload = { pressure_cm = "0,100" }\ntolerance = { process = "resin", gauge = "0.5 cm" }\n'
    )
    done = runs.run("-m", "softmodels", "run", file, "-o", tmp_path / "out", "--pictures", "none", "--budget", "auto")
    line = next(line for line in done.out.splitlines() if line.startswith("apex rise "))
    number, parts = line.split(" (95 %): ")
    halves = [float(re.search(r" ([0-9.]+) mm$", part)[1]) for part in parts.split(", ")]  # each with its unit
    assert halves[:-1] == sorted(halves[:-1], reverse=True) and "3 others 0.00" in parts
    assert "membrane +-0.1 mm 0.0" in parts and "gauge +-0.5 cm 0.0" in parts
    assert "not in these intervals: the silicone (--band)" in done.out
    stored = json.loads((tmp_path / "out" / "summary.json").read_text())["errors"][-1]["apex_mm"]
    own = [half for cause, half in stored.items() if cause not in ("value", "half_width")]
    assert stored["half_width"] == pytest.approx(np.hypot.reduce(own), rel=1e-12)
    assert number == f"apex rise {stored['value']:.3f} +- {stored['half_width']:.3f} mm" and stored["mesh"] > 0.0
    assert sm.load(tmp_path / "out").case.tolerance == Tolerances((("gauge", "0.5 cm"),), "resin")


@pytest.mark.parametrize(
    "tolerance, said",
    [
        ({"membrine": "0.1 mm"}, "did you mean membrane"),
        ({"membrane": 0.1}, "write it with its unit"),
        ({"membrane": "0.1"}, "has no unit"),
        ({"membrane": "90 mm"}, "below 6 mm"),
        ({"gauge": "0 %"}, "must be above 0"),
        ({"process": "casting"}, "resin, filament, machined"),
        ({}, "is empty"),
    ],
)
def test_tolerances_that_are_none(tolerance, said):
    with pytest.raises(CaseError, match=said):
        case_of(DISK, LAW, "0,5 cm", tolerance=tolerance)


def test_no_tolerance_of_what_has_no_band():
    with pytest.raises(CaseError, match="pressures and volumes"):
        case_of(DISK, LAW, steps=steps_of(share="0:1"), components=[sm.Gravity("-z")], tolerance=TOLERANCE)


def test_sources_span_the_silicones_part():
    run = sm.inflate(DISK, "ecoflex-00-30", "0,10 cm", band="ecoflex-00-30")
    first, *others = run.budget.contributions(run.table[-1], "apex")
    assert first.text == "silicone" and not others
    apex = [rows[-1]["apex_mm"] for rows in run.sources.values()]
    assert 1e3 * first.half == pytest.approx(max(abs(value - run.rows[-1]["apex_mm"]) for value in apex), rel=1e-9)
    assert "not in these intervals: lengths as made" in run.budget.lines()[-1]
    (table,) = run.budget.tables()  # as in summary.json: neither words nor counts have errors
    assert {"step", "apex_mm", "added_volume_ml"} <= {*table} and not {"control", "newton_iterations", "limit"} & {*table}


def test_the_mesh_alone_is_no_advice_to_refine(run):
    """Where the silicone is not in the budget, its part is mostly the larger one."""
    alone = sm.inflate(DISK, LAW, "0,20 cm", mesh_error=True)
    row = alone.table[-1]
    assert alone.budget.half_text(row, "apex").endswith(" mm (95 %, mesh only)")
    assert "state the others first: the silicone (--band)" in alone.budget.next_step(row, "apex")
    assert "The largest contribution is" in run.budget.next_step(run.table[-1], "apex")
    assert run.budget.half_text(run.table[-1], "apex").endswith(" mm (95 %)")


def test_which_path_the_mesh_error_is_from():
    wedge = case_of(sm.HollowDisk(angle=180.0), LAW, "0,5 cm")
    section = mesh_error.companion(wedge, unasked=True)
    assert section.actuator == sm.HollowDisk(angle=180.0, section="axisymmetric", finer=2.0)
    assert mesh_error.companion(wedge, unasked=False) is None
    sideways = case_of(sm.HollowDisk(angle=180.0), LAW, "0,5 cm", components=[sm.Gravity("x")])
    assert mesh_error.companion(sideways, unasked=True) is None
    assert mesh_error.companion(case_of(sm.PneuNet(), LAW, "0,5 kPa"), unasked=True) is None


def test_a_mesh_error_that_costs_more_than_half_of_the_run_is_left_out(monkeypatch):
    said = []
    own = simulation.Simulation(case_of(sm.Bellows(), LAW, "0,1 cm"), mpi.start())
    monkeypatch.setattr(own.listener, "say", said.append)
    expected = 4 * mesh_error.SECONDS_PER_CELL * 1e4
    assert not simulation.solve_meshes(own, 1e4)
    assert said == [f"the mesh error is left out, which would take about {expected:.2g} s more (--mesh-error)"]
    assert simulation.solve_meshes(own, 0.1)["finer"][-1]["requested"] and "solving again" in said[1]


def test_a_limit_pressure_has_a_budget_of_its_own(tmp_path):
    device, law, half = sm.Balloon(), sm.NeoHookean(20e3), 0.05e-3
    errors = MaterialErrors(("shear_modulus",), ((500.0**2,),))
    limit = sm.limit(device, law, band=errors, tolerance={"wall": "0.05 mm", "gauge": "1 %"})
    others = {
        "wall": [sm.limit(device.replaced(wall=device.wall + way * half), law).pressure for way in (1, -1)],
        "material": [sm.limit(device, sm.NeoHookean(20e3 + way * HALF_WIDTH_95 * 500.0)).pressure for way in (1, -1)],
        "gauge": [1.01 * limit.pressure, 0.99 * limit.pressure],
    }
    assert [part.name for part in limit.errors] == ["material", "wall", "gauge"]
    for part in limit.errors:
        high, low = others[part.name]
        assert part.half == pytest.approx(abs(high - low) / 2, rel=2e-3)
    assert limit.half_width == pytest.approx(math.hypot(*(part.half for part in limit.errors)))
    file = tmp_path / "balloon.toml"
    file.write_text(
        'geometry = { device = "Balloon" }\nmaterial = { law = "neo-hookean", shear_modulus = "20 kPa" }\n'
        'load = { pressure_cm = "1" }\ntolerance = { wall = "0.05 mm" }\n'
    )
    done = runs.run("-m", "softmodels", "limit", file, "-o", tmp_path / "out")
    assert " cm (95 %: wall +-0.05 mm 0.8" in done.out
    (row,) = json.loads((tmp_path / "out" / "limit.json").read_text())
    assert row["limit_ci95_Pa"] == row["limit_ci95_wall_Pa"] == pytest.approx(limit.errors[1].half, rel=1e-6)


def test_a_difference_of_two_meshes_is_below_the_error_of_both():
    coarse, fine = (sm.inflate(DISK.replaced(finer=finer), LAW, "0,20 cm", mesh_error=True) for finer in (1.0, 1.5))
    found = sm.compare(coarse, fine)
    rise, half = found.figures[0], [run.mesh_errors["apex"] * 1e3 for run in (coarse, fine)]
    assert rise.errors == pytest.approx((math.hypot(*half),)) and rise.errors[0] > abs(rise.values[1] - rise.values[0])
    assert f"below the error of both, +- {rise.errors[0]:.2g} mm" in str(found) and "below the error of both" in found.html()


def test_a_difference_between_stored_states_has_nearly_the_error_of_one_that_is_stored():
    """Shares of the mesh and of the silicone vary slowly with the load."""
    errors = MaterialErrors(("shear_modulus",), ((500.0**2,),))
    first = sm.inflate(DISK, LAW, "0,17 cm", mesh_error=True)
    paths = ("0,17,24 cm", "0,24 cm")
    stored, between = (sm.inflate(DISK, LAW, pressures, mesh_error=True, band=errors) for pressures in paths)
    for number in range(2):  # the rise and the added volume
        wanted, read = (sm.compare(first, other).figures[number] for other in (stored, between))
        assert wanted.what.endswith("at 17 cm") and read.what.endswith("interpolated")
        assert read.errors == pytest.approx(wanted.errors, rel=0.02)


def test_the_silicone_that_two_runs_share_counts_by_its_difference():
    """The difference of two devices of one cast is better known than that of two casts."""
    high, low = (sm.NeoHookean(30e3 + way * HALF_WIDTH_95 * 1500.0) for way in (1.0, -1.0))
    thin, thick = DISK, DISK.replaced(membrane=1.3 * DISK.membrane)
    runs = [sm.inflate(device, LAW, "0,20 cm", band=ERRORS) for device in (thin, thick)]
    rise = sm.compare(*runs).figures[0]
    away = [sm.inflate(thick, law, "0,20 cm").apex[-1] - sm.inflate(thin, law, "0,20 cm").apex[-1] for law in (high, low)]
    assert rise.errors[0] == pytest.approx(1e3 * abs(away[0] - away[1]) / 2, rel=0.01)
    assert f"%; error of both, +- {rise.errors[0]:.2g} mm)" in rise.texts[1]
    other = sm.inflate(thick, sm.NeoHookean(31e3), "0,20 cm", band=ERRORS)
    halves = [1e3 * run.table[-1]["apex_ci95"] for run in (runs[0], other)]
    assert sm.compare(runs[0], other).figures[0].errors[0] == pytest.approx(math.hypot(*halves))
    assert math.isnan(sm.compare(runs[0], sm.inflate(thick, LAW, "0,20 cm")).figures[0].errors[0])


def last_of(device, material, pressure):
    """The apex rise and the added volume of a device at a pressure, by its own path of few steps."""
    case = case_of(device, material, [pressure])
    own = simulation.Simulation(case, mpi.start())
    own.min_steps = simulation.MIN_COMPANION_STEPS
    with simulation.temporary_folder(own.comm) as folder:
        own.write_mesh(folder / "disk.msh")
        own.prepare(folder / "disk.msh")
        *_, last = own.steps()
    own.release()
    return last.row["apex"], last.row["added_volume"]


@pytest.mark.campaign
def test_the_sum_of_the_parts_against_devices_at_random():
    """Halton's points of membrane, shear modulus and pressure, each device meshed and solved by itself."""
    from scipy import stats

    tolerance = {"membrane": "0.08 mm", "gauge": "3 cm"}
    run = sm.inflate(DISK, LAW, "0,100 cm", band=ERRORS, tolerance=tolerance)
    normal = stats.norm.ppf(stats.qmc.Halton(3, seed=3).random(160)) / HALF_WIDTH_95
    sizes = 0.08e-3, HALF_WIDTH_95 * 1500.0, 3.0 * run.case.column.pascal
    values = [
        last_of(DISK.replaced(membrane=DISK.membrane + t), sm.NeoHookean(30e3 + m), run.pressure[-1] + p)
        for t, m, p in normal * sizes
    ]
    for name, own in zip(("apex", "added_volume"), np.transpose(values), strict=True):
        assert HALF_WIDTH_95 * np.std(own, ddof=1) == pytest.approx(run.table[-1][f"{name}_ci95"], rel=0.05)


def test_a_figure_that_is_0_in_a_state_has_no_share_there(monkeypatch):
    run = sm.inflate(DISK, LAW, "0,17 cm")
    (result, _) = sm.compare(run, run).results
    monkeypatch.setattr(comparison, "_halves", lambda _, row, variable: {"mesh": 0.01})
    size, rise = result.rising[0][-1], 1e3 * run.apex[-1]
    assert run.apex[0] == 0.0 and comparison._halves_at_load(result, "apex", size) == {"mesh": pytest.approx(0.01, rel=1e-9)}
    assert comparison._halves_at_load(result, "apex", 0.5 * size)["mesh"] < 0.01 < rise
