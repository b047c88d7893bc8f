"""Load steps: from each way in which they are written, in SI with their texts, and back."""

import pickle

import numpy as np
import pytest

import softmodels as sm
from softmodels.case.load import load_table, steps_of
from softmodels.common.units import COLUMN, Amount
from softmodels.path.steps import Prescribed, Step, StepError, courses, durations_of, is_program, times_of

CM = COLUMN.pascal
DISK, LAW = sm.HollowDisk(section="axisymmetric"), sm.NeoHookean(30e3, 0.49)
BEAM = sm.Beam(length=0.03, width=0.01, thickness=0.005)
PULLS = sm.Force("tip", "x", name="pull"), sm.Force("tip", "-z", name="push"), sm.Gravity("-z")


def test_values_are_in_si_and_keep_their_text():
    (step,) = steps_of(pressure="0,20 cm")
    (one,) = step.prescribed
    assert one.values == (0.0, 20 * CM) and one.quantity == "pressure" and not is_program((step,))
    assert [value.text for value in one.values] == ["0 cm", "20 cm"]
    again = pickle.loads(pickle.dumps(one.values[1]))
    assert again == 20 * CM and (again.number, again.unit) == (20.0, "cm")
    assert isinstance(one.values[1], Amount) and not isinstance(one.values[1] * 2, Amount)
    turned, flow = steps_of(turn_deg=[0, 90]), steps_of(flow_ml_per_min=[60, 60], time_s=[0, 2])
    assert turned[0].prescribed[0].values[-1] == pytest.approx(np.pi / 2, rel=1e-15)
    assert flow[1].prescribed[0].values[0] == pytest.approx(1e-6, rel=1e-15) and flow[1].duration == 2.0


def test_files_say_what_was_written():
    for table in (
        {"pressure_cm": [0.0, 20.0]},
        {"pressure": ["0 kPa", "4 kPa"]},
        {"force_N": [0.0, 1.0], "on": "push", "at_pressure_cm": 4.0},
        {"force_N": [0.0, 1.0], "at_pressure": "400 Pa"},
        {"cavity1": {"pressure": ["4 kPa", "20 cm"]}, "gravity": {"share": [0.5, 1.0]}, "time_s": [0.1, 0.3]},
        {"source_pressure": ["0 Pa", "4 kPa"], "valve": [1.0, 0.0], "time_s": [0.0, 0.7]},
    ):
        assert load_table(steps_of(**table)) == table


def test_what_a_step_does_not_name_stays_as_it_was():
    """Steps of Python: their drivers are found, and a file has the values of all of them."""
    steps = (
        Step((Prescribed("share", (1.0,)),)),
        Step((Prescribed("force", (0.5,), "pull"),)),
        Step((Prescribed("force", (0.2,), "push"), Prescribed("force", (0.0,), "pull"))),
    )
    case = sm.Case("beam", BEAM, LAW, steps, components=PULLS)
    assert case.program and [one.name for one in courses(case.steps)] == ["gravity", "force.pull", "force.push"]
    assert [one.values for one in courses(case.steps)] == [(1.0, 1.0, 1.0), (0.0, 0.5, 0.0), (0.0, 0.0, 0.2)]
    written = load_table(case.steps)
    assert written["force"] == {"pull": {"force_N": [0.0, 0.5, 0.0]}, "push": {"force_N": [0.0, 0.0, 0.2]}}
    again = sm.Case.from_toml(case.to_toml())
    assert courses(again.steps) == courses(case.steps) and sm.Case.from_toml(again.to_toml()) == again


def test_durations_come_back_from_the_times_of_a_file():
    rng = np.random.default_rng(7)
    lengths = tuple(np.cumsum(np.round(rng.uniform(0.0, 3.0, 200), 3)).tolist())
    steps = tuple(Step((Prescribed("pressure", (100.0,)),), duration) for duration in durations_of(lengths))
    assert times_of(steps) == lengths
    case = sm.Case("disk", DISK, LAW, steps_of(pressure_cm=20, rate="0.7 kPa/s", hold=1 / 3, cycles=3))
    assert sm.Case.from_toml(case.to_toml()) == case and case.timed


@pytest.mark.parametrize(
    ("steps", "told"),
    [
        ([Step((Prescribed("pressure", (1e3,)),), 1.0), Step((Prescribed("pressure", (2e3,)),))], "others none"),
        ([Step((Prescribed("pressure", (1e3,)),), -1.0)], "duration of -1 s"),
        ([Step((Prescribed("pressure", (1e3, 2e3)),), 1.0)], "2 values in one of several steps"),
        ([Step((Prescribed("pressure", (2e3, 1e3)),))], "falls from 2000 Pa to 1000 Pa"),
        ([Step((Prescribed("stroke", (1e-6,)),), 1.0)], "strokes are requested in a single step"),
        ([Step((Prescribed("force", (1.0,)),))], r"has no \[force\]"),
        ([], "give exactly one of these"),
        (["0:20 cm"], "must be load steps"),
    ],
)
def test_steps_that_make_no_load_are_told(steps, told):
    with pytest.raises((sm.CaseError, sm.ArgumentError), match=told):
        sm.Case("disk", DISK, LAW, steps)


def test_quantities_are_known():
    with pytest.raises(StepError, match="did you mean pressure"):
        Prescribed("presure", (1.0,))
