"""The optimiser on a device in closed form: its optimum, failing trials, starts, resume, limits that are incompatible."""

from __future__ import annotations

import csv
import dataclasses
import json

import numpy as np
import pytest

import softmodels as sm
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.case.materials import MaterialErrors
from softmodels.case.tolerances import Tolerances
from softmodels.design.optimise import FARTHEST_REACH, FIRST_REACH, optimise
from softmodels.design.problem import DesignProblem
from tests.support import fake_design as fake


@pytest.fixture(autouse=True)
def in_closed_form(monkeypatch):
    fake.install(monkeypatch.setattr)


def case_(**changes):
    device = fake.FakeDisk(section="axisymmetric", **changes)
    return Case("disk", device, sm.NeoHookean(30e3), steps=steps_of(pressure_cm=(0.0, 177.0)))


def problem_(keep=None, case=None, **changes):
    given = {
        "parameters": {"membrane": ("2 mm", "9 mm"), "cavity_radius": ("6 mm", "14 mm")},
        "maximise": {"quantity": "rise", "of": "apex", "at": "177 cm"},
        "keep": [
            {"quantity": "max_stretch", "at": "177 cm", "at_most": 1.18},
            {"quantity": "limit_margin", "at_least": 1.3},
            {"quantity": "mass", "at_most": "28 g"},
        ] if keep is None else keep,
    }  # fmt: skip
    return DesignProblem(case or case_(), **{**given, **changes})


def by_brute_force(problem):
    """The best rise on a fine grid of both parameters."""
    model = fake.FakeModel(problem.case, problem.names, problem.quantities)
    best = 0.0
    for h in np.linspace(2e-3, 9e-3, 141):
        for R in np.linspace(6e-3, 14e-3, 161):
            try:
                values = model.values(np.array([R, h]) if problem.names[0] == "cavity_radius" else np.array([h, R]))
            except (fake.DesignFailure, ValueError):
                continue
            kept = all(
                (keep.at_most is None or values[keep.quantity.key] <= keep.at_most)
                and (keep.at_least is None or values[keep.quantity.key] >= keep.at_least)
                for keep in problem.limits
            )
            best = max(best, values[problem.terms[0].quantity.key] if kept else 0.0)
    return best


@pytest.mark.campaign
def test_the_optimum_of_a_grid_in_few_evaluations():
    problem = problem_()
    found = optimise(problem)
    wanted = by_brute_force(problem)
    assert found.feasible and wanted > 1.3 * found.form.objective(found.first)
    assert found.form.objective(found.best) == pytest.approx(wanted, rel=0.01)
    assert found.form.objective(found.best) >= wanted * (1 - 1e-3)  # the grid is no better than it
    assert len(found.trials) <= 20
    assert found.holding.balanced and all("gains" in one for one in found.reasons)
    card, membrane = found._repr_html_(), found.parameters["membrane"] * 1e3
    assert "data:image/webp" in card and f"{membrane:.4g} mm</td>" in card and repr(found).startswith("<DesignResult of ")


def test_the_first_steps_are_short_and_grow_where_they_were_foreseen():
    found = optimise(problem_())
    x = np.array([found.form.x(np.array(trial.theta)) for trial in found.trials])
    steps = np.abs(np.diff(x, axis=0)).max(axis=1)
    assert steps[0] == pytest.approx(FIRST_REACH, abs=1e-6)
    assert FIRST_REACH < steps[:4].max() <= FARTHEST_REACH + 1e-6


def test_no_design_is_evaluated_twice():
    models = []

    def model(problem, comm):
        models.append(fake.FakeModel(problem.case, problem.names, problem.quantities))
        return models[-1]

    found = optimise(problem_(), model=model, starts=3)
    assert len(models[0].calls) == len(set(models[0].calls)) == len(found.trials)
    assert {trial.start for trial in found.trials} == {1, 2, 3}
    assert found.agreement == "the 3 starts agree"


def test_trials_without_a_state_are_stepped_back_from():
    wide = {"membrane": ("1.5 mm", "9 mm"), "cavity_radius": ("6 mm", "18 mm")}
    keep = [{"quantity": "max_stretch", "at": "177 cm", "at_most": 3}]  # the limit point is all that holds it back
    found = optimise(problem_(keep, parameters=wide))
    failed = [trial for trial in found.trials if trial.failed]
    assert failed and all("the device jumps at" in trial.failure for trial in failed)
    assert found.feasible and found.form.objective(found.best) > 2 * found.form.objective(found.first)
    assert len(failed) < 0.7 * len(found.trials)


def test_a_start_without_a_state_is_named_before_anything_else():
    with pytest.raises(sm.RunError, match=r"given device cannot be evaluated: the device jumps at .* cm") as caught:
        optimise(problem_(case=case_(membrane=0.0025)))
    assert caught.value.status == 3


IMPOSSIBLE = {
    "stretch": ([("rise", 9.0e-3, None), ("max_stretch", None, 1.10)], {"rise", "max_stretch"}),
    "margin": ([("rise", 11.0e-3, None), ("limit_margin", 1.5, None)], {"rise", "limit_margin"}),
    "mass": ([("rise", 9.0e-3, None), ("mass", None, 0.020), ("limit_margin", 1.3, None)], {"mass", "limit_margin"}),
    "walls": ([("clearances", 5e-3, None), ("limit_margin", 1.2, None), ("mass", None, 0.008)], {"clearances", "mass"}),
    "bounds": ([("limit_margin", 8.0, None)], {"limit_margin"}),
}


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_a_request_that_cannot_be_met_ends_nearby_with_what_excludes_each_other(name):
    asked, wanted = IMPOSSIBLE[name]
    keep = []
    for quantity, low, high in asked:
        at = {"at": "177 cm"} if fake.REGISTRY[quantity].of_state else {}
        keep.append({"quantity": quantity, **at, **({} if low is None else {"at_least": low}),
                     **({} if high is None else {"at_most": high})})  # fmt: skip
    found = optimise(problem_(keep))
    assert not found.feasible and found.missed
    holders = {holder.row.keep.quantity.name for holder in found.holding.holders if holder.row}
    assert wanted <= holders and found.holding.balanced
    assert found.reasons[0].startswith("the problem is infeasible") and "are incompatible" in found.reasons[0]
    # No small step makes the worst violation smaller.
    model, form = fake.FakeModel(found.problem.case, found.problem.names, found.problem.quantities), found.form
    worst, x = form.worst(found.best)[0], form.x(np.array(found.best.theta))
    for step in np.vstack([np.eye(2), -np.eye(2), [[1, 1], [1, -1], [-1, 1], [-1, -1]]]) * 0.01:
        values = model.values(form.theta(np.clip(x + step, 0, 1)))
        there = max(row.sign * (values[row.key] - row.limit) / row.scale for row in form.rows)
        assert there > worst - 2e-3


def test_a_search_that_was_cut_off_does_not_call_a_request_impossible():
    keep = [{"quantity": "rise", "at": "177 cm", "at_least": 8e-3}]
    found = optimise(problem_(keep), evaluations=2)
    assert not found.feasible and found.missed
    assert found.reasons == [
        "no design so far satisfies all limits (the search ended after 2 evaluations); continue with more evaluations"
    ]
    assert optimise(problem_(keep)).feasible


def test_what_one_more_unit_costs_is_the_price_found_by_asking_again():
    found = optimise(problem_())
    holder = next(one for one in found.holding.holders if one.row and one.row.keep.quantity.name == "max_stretch")
    looser = problem_()
    changed = [{"quantity": "max_stretch", "at": "177 cm", "at_most": 1.185},
               {"quantity": "limit_margin", "at_least": 1.3}, {"quantity": "mass", "at_most": "28 g"}]  # fmt: skip
    again = optimise(problem_(changed))
    assert looser.case == again.problem.case
    price = found.form.size * holder.multiplier / holder.row.scale * 0.005
    assert again.form.objective(again.best) - found.form.objective(found.best) == pytest.approx(price, rel=0.1)
    assert "max stretch at 177 cm at most 1.18: relaxing this limit by 0.05 gains" in holder.sentence


def test_limits_hold_with_95_percent_where_devices_scatter():
    found = optimise(problem_(tolerance={"membrane": "0.196 mm", "wall": "0.392 mm"}))
    assert found.feasible and found.problem.names[2:] == ("wall",)
    model = fake.FakeModel(found.problem.case, found.problem.names, found.problem.quantities)
    generator, spreads = np.random.default_rng(7), found.form.spread.spreads
    thetas = np.array(found.best.theta) + spreads * generator.standard_normal((4000, 3))
    values = [model.values(theta) for theta in thetas]
    for row in found.form.rows:
        kept = np.mean([row.sign * (value[row.key] - row.limit) <= 0.0 for value in values])
        assert kept > 0.94
    met = [row for row, violation in zip(found.form.rows, found.form.violations(found.best), strict=True) if violation > -1e-3]
    assert met and all(np.mean([row.sign * (value[row.key] - row.limit) <= 0.0 for value in values]) < 0.96 for row in met)
    assert any("with 95 % below" in text for text in found.margins)


def test_the_tolerances_of_the_case_count_unless_the_problem_has_its_own():
    errors = MaterialErrors(("shear_modulus",), ((500.0**2,),))
    own = Tolerances.of({"membrane": "5 %", "gauge": "1 %"})
    tolerant = dataclasses.replace(case_(), tolerance=own, band=errors)
    half = 0.05 * tolerant.actuator.membrane
    assert problem_(case=tolerant).spreads == pytest.approx({"membrane": half / 1.959964})
    assert any("the tolerance of gauge is not in them" in note for note in problem_(case=tolerant).notes)
    assert not problem_().notes
    assert problem_(case=tolerant).errors is errors and problem_().errors is None and not problem_().spreads
    made = problem_(case=tolerant, tolerance={"process": "filament", "membrane": "0.1 mm"}).spreads
    assert made["membrane"] == pytest.approx(0.1e-3 / 1.959964) and made["wall"] == pytest.approx(0.3e-3 / 1.959964)


def test_a_fitted_materials_errors_count(tmp_path):
    fitted = tmp_path / "fitted.toml"
    law = '[material]\nlaw = "neo-hookean"\nshear_modulus = "30 kPa"\n'
    fitted.write_text(f"{law}[fit]\nintervals_95 = {{ shear_modulus = [28000.0, 32000.0] }}\n")
    keep = [{"quantity": "limit_margin", "at_least": 1.3}]
    found = optimise(problem_(keep, material_errors=str(fitted)))
    sigma = 4000.0 / (2 * 1.959964) / 30e3  # the margin goes with the modulus
    assert found.best.values["limit margin"] * (1 - 1.645 * sigma) == pytest.approx(1.3, rel=2e-3)
    fit = {"law": "neo-hookean", "free": ["leak", "shear_modulus"], "covariance": [[1.0, 0.0], [0.0, 500.0**2]]}
    (tmp_path / "fit.json").write_text(json.dumps({"laws": [fit]}))
    assert optimise(problem_(keep, material_errors=str(fitted))).best.values["limit margin"] < 1.36
    other = Case("disk", fake.FakeDisk(), sm.NeoHookean(31e3), steps=steps_of(pressure_cm=(0.0, 177.0)))
    with pytest.raises(sm.DesignError, match="another material"):
        problem_(case=other, material_errors=str(fitted))


def test_every_trial_is_kept_and_gone_on_from(tmp_path):
    calls = []

    def model(problem, comm):
        made = fake.FakeModel(problem.case, problem.names, problem.quantities)
        calls.append(made.calls)
        return made

    whole = optimise(problem_(), tmp_path / "whole", model=model)
    rows = list(csv.DictReader((tmp_path / "whole" / "iterates.csv").open()))
    assert len(rows) == len(whole.trials) and float(rows[0]["membrane (mm)"]) == 6.0
    assert float(rows[0]["rise at 177 cm (mm)"]) == pytest.approx(1e3 * whole.form.objective(whole.first))
    for trial in whole.trials:
        device = Case.from_file(tmp_path / "whole" / "iterates" / f"{trial.number:04d}.toml").actuator
        assert [getattr(device, name) for name in whole.problem.names] == list(trial.theta)
    assert Case.from_file(tmp_path / "whole" / "design.toml") == whole.case

    part = optimise(problem_(), tmp_path / "part", model=model, stopped=lambda: len(calls[-1]) >= 3)
    assert part.stopped and len(part.trials) == 3 and part.best.number == 2
    assert Case.from_file(tmp_path / "part" / "design.toml") == part.case
    resumed = optimise(problem_(), tmp_path / "part", model=model, resume=True)
    assert len(calls[-1]) == len(whole.trials) - 3 and not set(calls[-1]) & set(calls[-2])
    assert [trial.theta for trial in resumed.trials] == [trial.theta for trial in whole.trials]
    with pytest.raises(sm.DesignError, match="the limits changed"):
        optimise(problem_(keep=[]), tmp_path / "part", model=model, resume=True)
    again = optimise(problem_(), tmp_path / "part", model=model)  # without resume all is done anew
    assert len(calls[-1]) == len(again.trials) == len(list((tmp_path / "part" / "iterates").glob("*.json"))) - 1


def test_somebody_elses_folder_is_left_alone(tmp_path):
    (tmp_path / "letter.txt").write_text("dear")
    with pytest.raises(sm.DesignError, match=r"letter\.txt"):
        optimise(problem_(), tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["letter.txt"]


def test_a_device_that_cannot_be_confirmed_is_reported():
    class Fresh(fake.FakeModel):
        def confirm(self, theta, finer=1.0):
            raise fake.DesignFailure("no state at 177 cm")

    found = optimise(problem_(), model=lambda problem, comm: Fresh(problem.case, problem.names, problem.quantities))
    assert "could not be confirmed on a fresh mesh: no state at 177 cm" in found.trouble
