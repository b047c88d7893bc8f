"""The table of a run: arrays in SI by name, from columns with units."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

from geometries import HollowDisk
from softmodels.api.run import Run
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.case.materials import DEFAULT
from softmodels.common import units
from softmodels.runs.columns import every_variable
from softmodels.runs.outcomes import Ended
from softmodels.runs.states import StoredStates
from softmodels.runs.table import UNITS, PathTable, Row, parsed

CELLS = {
    "step": 1,
    "pressure_cm": 10.0,
    "pressure_Pa": 980.0,
    "pressure_1_cm": 5.0,
    "added_volume_ml": 2.0,
    "flow_ml_per_min": 90.0,
    "time_s": 0.5,
    "apex_mm": 3.0,
    "max_von_mises_kPa": 5.0,
    "stored_energy_mJ": 4.0,
    "tilt_deg": 180.0,
    "plate_moment_x_Nmm": 6.0,
    "lip_sealed_mm2": 7.0,
    "least_gap_mm": None,
    "limit": 0,
    "control": "pressure",
}
IN_SI = {
    "step": 1,
    "pressure": 980.0,
    "pressure_1": 490.0,
    "added_volume": 2e-6,
    "flow": 1.5e-6,
    "time": 0.5,
    "apex": 3e-3,
    "max_von_mises": 5e3,
    "stored_energy": 4e-3,
    "tilt": math.pi,
    "plate_moment_x": 6e-3,
    "lip_sealed": 7e-6,
    "least_gap": math.nan,
    "limit": 0,
}


@pytest.fixture
def run():
    rows = [
        Row({name: 0.0 if isinstance(value, float) else value for name, value in CELLS.items()}, 98.0),
        Row(CELLS, 98.0),
    ]
    grid = np.zeros((6, 3)), np.arange(6)[None], "Triangle_6"
    return Run(
        StoredStates(
            Case("disk", HollowDisk(), DEFAULT, steps_of(pressure_cm=(10.0,))),
            rows,
            grid,
            lambda step, name: np.zeros(6),
        ),
        Ended(),
    )


def test_every_variable_is_an_array_in_si_that_tab_completes(run):
    for name, value in IN_SI.items():
        assert run.table[name][1] == pytest.approx(value, rel=1e-15, nan_ok=True), name
        if name != "limit":  # that of a run is where its path ends
            assert getattr(run, name)[1] == pytest.approx(value, rel=1e-15, nan_ok=True), name
    assert list(run.control) == ["pressure", "pressure"] and set(IN_SI) <= set(dir(run))
    with pytest.raises(AttributeError, match="time_s"):
        _ = run.time_s


def test_files_have_the_columns_and_units_of_the_table(run):
    assert run.table.columns == list(CELLS) and run.path["apex_mm"][1] == run.rows[1]["apex_mm"] == 3.0
    row = run.table[1]
    assert (row.told("pressure"), row.told("apex", "+.2f"), row.told("tilt"), row.told("step")) == (
        "10 cm", "+3.00 mm", "180 °", "1"
    )  # fmt: skip
    assert pickle.loads(pickle.dumps(row)) == row and pickle.loads(pickle.dumps(row))["pressure_1"] == 490.0
    assert len(run.table.where("step")) == 2 and run.table[1:]["pressure"].tolist() == [980.0]


def test_a_column_is_read_as_the_variable_that_wrote_it():
    for variable in every_variable():
        assert parsed(variable.key) == (variable.name, UNITS[variable.unit] if variable.unit else parsed("J")[1])
        assert Row(variable.cells(0.7, 98.0), 98.0)[variable.name] == pytest.approx(0.7, rel=1e-15)
        assert Row(variable.cells({"a": 0.7, "b": 1.4}, 98.0), 98.0)["b"] == pytest.approx(1.4, rel=1e-15)


def test_a_point_and_an_angle_of_one_name_do_not_hide_each_other():
    row = Row({"tip_mm": 3.0, "tip_deg": 90.0})
    assert (row["tip"], row["tip_deg"]) == (3e-3, 90.0)


def test_an_empty_table():
    table = PathTable()
    assert len(table) == 0 and table.names == table.columns == [] and "apex" not in table and not table.get("jump").any()


@pytest.mark.parametrize(
    "value, half, text",
    [(-1e-5, 2.2e-3, "0.0000 +- 0.0022 mm"), (3.91318, 0.0057, "3.9132 +- 0.0057 mm"), (-120.4, 23.0, "-120 +- 23 mm"),
     (1.0, 0.0, "1.0000 +- 0.0000 mm"), (1.0, math.nan, "1.0000 +- nan mm")],
)  # fmt: skip
def test_a_number_and_its_error_have_one_unit_and_zero_has_no_sign(value, half, text):
    assert units.with_error(value, half, "mm") == text


def test_a_variable_with_its_band():
    (row,) = PathTable.read([{"step": 1, "apex_mm": -1e-5, "apex_ci95_mm": 2.2e-3, "added_volume_ml": 2.0}])
    assert row.told_with_error("apex") == "0.0000 ± 0.0022 mm (95 %)" and row.told_with_error("added_volume") == "2 ml"
