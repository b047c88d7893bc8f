"""Fits to side views: a finger's tip and angle from another model give its silicone back, by a case file and a table."""

from __future__ import annotations

import csv
import dataclasses
import json
import math

import numpy as np
import pytest
from click.testing import CliRunner

import softmodels as sm
from geometries import Bellows, BendingBellows
from measurement.outline.outline import history_text
from softmodels.case.case import case_of
from softmodels.cli.material_commands import fit_material, score
from softmodels.fitting.curves.residuals import spectrum
from softmodels.fitting.outlines import views
from softmodels.fitting.outlines.creeping import CreepingViews
from softmodels.fitting.outlines.device import MeasuredDevice
from softmodels.fitting.outlines.residuals import nuisances
from softmodels.fitting.outlines.shapes import OutlineFitError
from softmodels.fitting.problem import BENCH, TILT, LawChoice
from softmodels.mechanics import mpi
from tests.support import finger_views

SHORT = BendingBellows(folds=1, cell_size=0.008)
DOWN = sm.Gravity("0.6, 0, -0.8", density=1070.0)
SILICONE = sm.NeoHookean(20e3)
ASIDE = finger_views.Camera(side=-1.0, tilt=0.6, base=(2e-4, -3e-4), offset=15.0)


@pytest.fixture(scope="module")
def filmed():
    return finger_views.views_of(SHORT, SILICONE, [0, 1000, 2200], ASIDE, components=[DOWN])


@pytest.fixture(scope="module")
def rows(filmed):
    return filmed[0]


@pytest.fixture
def table(rows, tmp_path):
    finger_views.write_views(tmp_path / "views.csv", rows)
    return tmp_path


def source_of(table, components=(DOWN,), law="neo-hookean"):
    measured = MeasuredDevice.of(case_of(SHORT, SILICONE, "0,5 cm", components=list(components)), views.seen_in(table))
    model = measured.model(LawChoice.from_text(law), mpi.start())
    shapes, notes = views.prepare(views.read_views(table), model)
    return views.ViewResiduals(model, shapes), notes


def test_a_finger_that_hangs_is_found_seen_from_behind_and_turned(table):
    """The start alone, before any fit; and the Jacobian along a random direction against central differences."""
    source, _ = source_of(table)
    (begin, *_), plain = source.starts({}, ())
    assert begin["shear_modulus"] == pytest.approx(20e3, rel=0.06)
    known = {p.name: p for p in nuisances(source, (*BENCH, TILT))}
    assert known[TILT].start == pytest.approx(math.degrees(0.6), abs=1.0)
    parameters = [*source.model.choice.parameters(begin), *known.values(), *source.hidden_parameters(plain.volumes)]
    values = {p.name: p.start for p in parameters} | {"scale": 0.01, "leak": 0.01, "centre": 1e-4, "zero": -2e-4}
    rng = np.random.default_rng(4)
    way = {p.name: rng.uniform(0.5, 1.0) * 2e-3 * max(p.scale, 1e-12) for p in parameters if not p.fixed}
    way |= {"centre": 1e-5, "zero": -1e-5, "scale": 1e-4, TILT: 0.05}

    def residuals(step):
        return source.evaluate({name: value + step * way.get(name, 0.0) for name, value in values.items()}, False)[0]

    J = source.evaluate(values, True)[1]
    assert J is not None and J.shape == (11, len(source.parameters))  # three for each view, and two readings
    slope = J @ [way.get(name, 0.0) for name in source.parameters]
    assert slope == pytest.approx((residuals(1.0) - residuals(-1.0)) / 2, rel=2e-4, abs=2e-4 * np.abs(slope).max())


def test_markers_are_points_of_the_device(filmed, table):
    """Each on the undeformed device where the node is, and the Jacobian against central differences; also without the tips."""
    rows, states = filmed
    marked = finger_views.marker_rows(SHORT, states, rows, ASIDE, 3, error=1e-6)
    finger_views.write_markers(table / "markers.csv", marked)
    for given, tips in ((table, 3), (table / "markers.csv", 1)):  # the tip at rest shows where the base is
        source, _ = source_of(given)
        count = len(source.markers)
        assert count >= 2
        (begin, *_), plain = source.starts({}, ())
        known = {p.name: p for p in nuisances(source, (*BENCH, TILT))}
        hidden = source.hidden_parameters(plain.volumes)
        parameters = [*source.model.choice.parameters(begin), *known.values(), *hidden]
        assert len([p for p in hidden if p.name.startswith("place")]) == 2 * count
        values = {p.name: p.start for p in parameters} | {"scale": 0.01, "leak": 0.01, "centre": 1e-4, "zero": -2e-4}
        nodes = states[0].points[finger_views.front_nodes(states[0], 3)[0]]
        for name, node in zip(source.markers, nodes, strict=True):
            assert values[f"place along of marker {name}"] == pytest.approx(node[0], abs=6e-4)  # the base is 0.36 mm off
        way = {"scale": 1e-5, TILT: 0.005, "centre": 1e-6, "zero": 1e-6}
        way |= {p.name: 2e-6 for p in hidden if p.name.startswith("place")}
        way |= {p.name: 1e-4 * p.scale for p in parameters if p.name.startswith(("volume", "shear"))}

        def residuals(step):
            return source.evaluate({name: value + step * way.get(name, 0.0) for name, value in values.items()}, False)[0]  # noqa: B023

        J = source.evaluate(values, True)[1]
        assert J.shape == (3 * (tips + 2 * count) + 2, len(source.parameters))
        slope = J @ [way.get(name, 0.0) for name in source.parameters]
        assert slope == pytest.approx((residuals(1.0) - residuals(-1.0)) / 2, rel=2e-3, abs=2e-3 * np.abs(slope).max())


def test_tables_that_cannot_be_fitted_say_why(rows, table, tmp_path):
    def written(changes, other=()):
        changed = [list(row) for row in rows]
        for (row, column), text in changes.items():
            changed[row][column] = text
        finger_views.write_views(table / "views.csv", [*changed, *other])
        return table

    with pytest.raises(OutlineFitError, match=r"views.csv, line 3: this view is untrusted \(a shadow\); exclude it"):
        views.read_views(written({(1, 13): "no", (1, 14): "a shadow"}))
    with pytest.raises(OutlineFitError, match=r"line 2: 'far' is not a number"):
        views.read_views(written({(0, 3): "far"}))
    assert [view.source for view in views.read_views(written({(1, 13): "refused"}))] == ["0.jpg", "2.jpg"]
    assert len(views.read_views(written({}), exclude=("2.jpg",))) == 2
    with pytest.raises(OutlineFitError, match="no side view shows the device under pressure"):
        source_of(written({(1, 1): "0", (2, 1): "0"}))
    with pytest.raises(OutlineFitError, match=r"without pressure the tip is .* and 15 mm in the case; check base"):
        source_of(written({(0, 3): "0.1"}), components=())
    _, notes = source_of(written({(1, 1): "-400"}))
    assert notes == ["1.jpg: below the pressure of the room; photograph not used"]
    with pytest.raises(sm.FitError, match="photographs show a memory only at two hold times or more"):
        sm.fit(SHORT, table, options=sm.FitOptions(memory=True))
    with pytest.raises(OutlineFitError, match="give its half or all of it"):
        MeasuredDevice.of(Bellows(section="axisymmetric"), views.TipFace).model(LawChoice.from_text("neo-hookean"), mpi.start())


HOLDS, RISE, HELD = (1.0, 4.0, 28.0), 0.5, 2000.0
CREEPS = SILICONE.with_memory(branches=[(0.25, 10.0)])


def histories():
    """Of a photograph at rest, and of three that are taken while a pressure is held."""
    corners = [(0.0, 0.0), (RISE, HELD), *((RISE + hold, HELD) for hold in HOLDS)]
    return [tuple(corners[:count]) for count in (1, 3, 4, 5)]


def test_times_of_side_views_are_steps_of_a_test(rows, tmp_path):
    """One hidden pressure for the three photographs of a hold; the device at rest is no step, and after venting left out."""
    seen = [(*rows[min(k, 1)], *[""] * (15 - len(rows[0])), "", history_text(told)) for k, told in enumerate(histories())]
    vented = (*rows[0], *[""] * (15 - len(rows[0])), "", history_text((*histories()[-1], (30.0, 0.0))))
    finger_views.write_views(tmp_path / "views.csv", [*seen, vented])
    measured = MeasuredDevice.of(case_of(SHORT, SILICONE, "0,5 cm"), views.seen_in(tmp_path))
    model = measured.model(LawChoice.from_text("neo-hookean"), mpi.start(), spectrum([], HOLDS))
    shapes, notes = views.prepare(views.read_views(tmp_path), model)
    assert [shape.history for shape in shapes] == histories()
    assert notes == ["0.jpg: without pressure after a test; photograph not used"]
    source = CreepingViews(model, shapes)
    assert (source.read, [p.name for p in source.hidden_parameters([])]) == ([1], ["pressure1", *views.BULGES])
    (test,) = source.creep.timetable.tests
    assert [leg.duration for leg in test] == pytest.approx([RISE, 1.0, 3.0, 24.0])
    with pytest.raises(OutlineFitError, match="has no times"):
        CreepingViews(model, [dataclasses.replace(shape, history=()) for shape in shapes])


@pytest.mark.campaign
def test_a_finger_that_creeps_gives_its_memory_back(tmp_path, figure):
    """A pressure held for 28 s: share and modulus within their intervals, by a gauge that reads 12 Pa too much."""
    run = sm.inflate(SHORT, CREEPS, [f"{HELD} Pa"] * 4, times=[RISE, *(RISE + hold for hold in HOLDS)])
    held = [state for state, row in zip(run, run.table, strict=True) if row["requested"]][-3:]
    rest, rng, rows = sm.inflate(SHORT, SILICONE, "1 Pa").at("1 Pa"), np.random.default_rng(0), []
    for number, (state, told) in enumerate(zip([rest, *held], histories(), strict=True)):
        place, angle = finger_views.tip_of(SHORT, state)
        place, angle = place + 2e-5 * rng.standard_normal(2), angle + 1e-3 * rng.standard_normal()
        reading = HELD + 12.0 if number else 0.0
        numbers = reading, 20.0, place[0], 2e-5, place[1], 2e-5, math.degrees(angle), math.degrees(1e-3)
        rows.append((f"{number}.jpg", *map(repr, map(float, numbers)), *[""] * 4, "yes", "", "", history_text(told)))
    finger_views.write_views(tmp_path / "views.csv", rows)
    report = sm.fit(SHORT, tmp_path, "neo-hookean", sm.FitOptions(memory=True, profiles=False))
    fit = report.chosen.fit
    for name, true, bound in (("share_10s", 0.25, 0.2), ("shear_modulus", 20e3, 0.05)):
        low, high = fit.interval(name)
        assert low <= true <= high
        figure("side views of a finger that creeps", name, fit.values[name] / true - 1, bound)


def random_finger(seed):
    """A finger as it is and as its case describes it, the silicone, the true pressures in Pa, and who looks at it."""
    rng = np.random.default_rng(seed)
    lengths = {"folds": 1, "radius": rng.uniform(5e-3, 7e-3), "wall": rng.uniform(1.2e-3, 1.8e-3)}
    modulus = math.exp(rng.uniform(math.log(15e3), math.log(80e3)))
    law = sm.Yeoh(c1=modulus / 2, c2=modulus / 200) if rng.random() < 0.5 else sm.NeoHookean(modulus)
    turn = rng.uniform(0.0, math.tau)
    gravity = sm.Gravity(f"{math.cos(turn):.4f}, 0, {math.sin(turn):.4f}", density=1070.0)
    camera = finger_views.Camera(
        rng.choice([-1.0, 1.0]), rng.uniform(-3.0, 3.0), tuple(3e-4 * rng.standard_normal(2)), 0.005 * rng.standard_normal(),
        15.0 * rng.standard_normal(), pressure_error=15.0,
    )  # fmt: skip
    pressures = [round(modulus * share, 1) for share in (0.0, 0.03, 0.06, 0.09, 0.12)]
    return (
        BendingBellows(cell_size=4.5e-3, **lengths),
        BendingBellows(cell_size=5.5e-3, **lengths),
        law,
        gravity,
        pressures,
        camera,
    )


@pytest.mark.campaign
@pytest.mark.parametrize("seed", [1])
def test_fingers_give_their_silicone_back_to_two_commands(seed, tmp_path, figure):
    """Other cells, another law or none, gravity in any direction of the plane, an offset, another scale; the fitted material
    then has the best score."""
    true, device, law, gravity, pressures, camera = random_finger(seed)
    rows = finger_views.rows_of(true, law, pressures, camera, seed, components=[gravity])
    finger_views.write_views(tmp_path / "views.csv", rows)
    case, fitted = tmp_path / "finger.toml", tmp_path / "fit"
    case.write_text(case_of(device, "ecoflex-00-30", "0,5 cm", components=[gravity], name="finger").to_toml())
    asked = ["--material", "neo-hookean", "--silicone", "any", "--no-profiles", "-o", str(fitted)]
    ran = CliRunner().invoke(fit_material, [str(case), str(tmp_path), *asked])
    assert ran.exit_code == 0, ran.output
    report = json.loads((fitted / "fit.json").read_text())
    (modulus,) = (p for p in report["laws"][0]["parameters"] if p["name"] == "shear_modulus")
    low, high = modulus["interval_95"]
    assert low <= law.shear_modulus_0 <= high
    assert "side views, measured and simulated" in (fitted / "report.html").read_text()
    off = modulus["value"] / law.shear_modulus_0 - 1
    figure("side views of fingers by other cells and laws", "the modulus fitted", off, 0.03)
    materials = ["--material", str(fitted / "fitted.toml"), "--material", "yeoh:c1=2kPa"]
    ran = CliRunner().invoke(score, [str(case), str(tmp_path), *materials, "-o", str(tmp_path / "scores")])
    assert ran.exit_code == 0, ran.output
    with (tmp_path / "scores" / "scores.csv").open() as file:
        own, other = csv.DictReader(file)
    assert own["data"] == "5 side views of finger"
    assert float(own["chi2_per_value"]) < 5.0 < float(other["chi2_per_value"])
