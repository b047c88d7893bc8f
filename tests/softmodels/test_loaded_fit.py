"""Fits of devices that hang under their weight, a mass or a force: what they give back, and what one without them would."""

from __future__ import annotations

import csv
import dataclasses
import tomllib

import numpy as np
import pytest
from click.testing import CliRunner

import softmodels as sm
from geometries import HollowDisk, Membrane
from measurement.outline.outline import Outline
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.cli.material_commands import fit_material, score
from softmodels.components.loads import Force, Gravity, Mass, Moment
from softmodels.fitting.curves.curve import TensileCurve
from softmodels.fitting.outlines.device import MeasuredDevice
from softmodels.fitting.outlines.residuals import Height
from softmodels.fitting.outlines.shapes import half_outline, shadow_of
from softmodels.materials.specimens import respond
from softmodels.pictures.curves import profile
from softmodels.runs.grid import QuadraticCurve
from tests.support.campaigns import sampled
from tests.support.simulated import correlated

DOWN = Gravity("-z")
DISK = HollowDisk(section="axisymmetric", cell_size=0.006, fillet=0.0, base_fillet=0.0)
PLATED = Membrane(plate_radius=0.008, clamp_width=0.005, cell_size=0.002)
PLATE = (DOWN, sm.Rigid("plate", name="plate", mass=0.020))
TRUE = sm.Yeoh(9e3, 300.0, 0.0, 0.49)
DEVICES = {
    "disk, its own weight": (DISK, (DOWN,), (20, 50, 80, 110, 140)),
    "disk, with a mass and a thread": (
        DISK, (DOWN, Mass("top", 0.030, name="brass"), Force("top", "z", 0.1, name="thread")), (20, 50, 80, 110, 140),
    ),
    "membrane with a plate of 20 g": (PLATED, PLATE, (5, 7, 9, 11, 13, 15)),
}  # fmt: skip
HOLD = {"c3": {"start": 0.0, "fixed": True}}
QUICK = sm.FitOptions(poisson=0.49, changes=HOLD, profiles=False)
ERROR = 10e-6
"""Standard error of a point in m, and in 10 Pa of a reading."""


def case_of(device, components, law=TRUE):
    return Case("device", device, law, steps=steps_of(pressure_cm=(1.0,)), components=components)


def outer_curve(run, state):
    """The outer curve of a run's state from its stored nodes, in device coordinates."""
    line = profile(state.points, state.displacement, run.case.actuator)
    return QuadraticCurve(np.stack([line[:-2:2], line[2::2], line[1:-1:2]], axis=1))


def photographed(run, cms, rng=None):
    """Outlines as a bench measures them of a run: above the upper edge of the shadow at zero pressure."""
    hung = outer_curve(run, run[0])
    assert run.rows[0]["pressure_cm"] == 0.0
    s = np.linspace(-1.0, 1.0, 401)
    zero = max(hung.at(k, s)[0][:, 1].max() for k in range(len(hung.nodes)))
    made = []
    for cm in cms:
        above = QuadraticCurve(outer_curve(run, run.at(f"{cm} cm")).nodes - [0.0, zero])
        places, normals = half_outline(shadow_of(above).curve, 50e-6)
        places, normals = (np.vstack([half[:0:-1] * [-1.0, 1.0], half]) for half in (places, normals))
        pressure = cm * run.case.column.pascal
        if rng is not None:
            places = places + ERROR * correlated(len(places), 8.0, rng)[:, None] * normals
            pressure += 1e6 * ERROR * float(rng.standard_normal())
        order = np.argsort(places[:, 0], kind="stable")
        x, z = places[order].T
        made.append(Outline(x, z, np.full(len(x), ERROR), pressure, 1e6 * ERROR, f"{cm} cm"))
    return made


@pytest.fixture(scope="module")
def run_of():
    """Return a function that gives the run of one of `DEVICES`."""
    known = {}

    def make(name):
        if name not in known:
            device, components, cms = DEVICES[name]
            known[name] = sm.inflate(device, TRUE, f"0,{','.join(map(str, cms))} cm", components=components)
        return known[name]

    return make


@pytest.mark.parametrize("name", sampled(DEVICES))
def test_outlines_of_a_run_give_its_material_back(name, run_of, figure):
    device, components, cms = DEVICES[name]
    outlines = photographed(run_of(name), cms)
    start = sm.NeoHookean(40e3, 0.49)  # the case's own material is another one
    found = sm.fit(case_of(device, components, start), outlines, "yeoh", QUICK).chosen
    assert found.fit.converged and not found.judgement.warnings
    assert not [note for note in found.judgement.notes if "Poisson's ratio, given as 0.49" not in note]
    for number in ("c1", "c2"):
        assert found.fit.error(number) > 0.002 * getattr(TRUE, number)
        figure("outlines of a run under dead loads, without noise", "what is fitted to them",
               found.fit.values[number] / getattr(TRUE, number) - 1, 5e-8)  # fmt: skip


@pytest.mark.campaign
def test_a_fit_takes_the_solver_of_its_case(run_of, figure):
    """By iterations it comes to the same numbers with the same error bars."""
    device, components, cms = DEVICES["disk, its own weight"]
    outlines = photographed(run_of("disk, its own weight"), cms[::2], np.random.default_rng(5))
    direct, iterative = (
        sm.fit(dataclasses.replace(case_of(device, components), solver=solver), outlines, "yeoh", QUICK).chosen.fit
        for solver in ("direct", "iterative")
    )
    for name in ("c1", "c2"):
        apart = (iterative.values[name] - direct.values[name]) / direct.error(name)
        figure("a fit by a factorisation, in standard errors", "the fit by iterations", apart, 1e-7)
        assert iterative.error(name) == pytest.approx(direct.error(name), rel=1e-5)


@pytest.mark.campaign
def test_error_bars_are_honest_under_a_weight(run_of):
    device, components, cms = DEVICES["membrane with a plate of 20 g"]
    rng, away = np.random.default_rng(7), []
    for _ in range(2):
        outlines = photographed(run_of("membrane with a plate of 20 g"), cms, rng)
        found = sm.fit(case_of(device, components), outlines, "yeoh", QUICK).chosen
        assert not found.judgement.warnings
        away.append([(found.fit.values[n] - getattr(TRUE, n)) / found.fit.error(n) for n in ("c1", "c2")])
    spread = np.sqrt(np.mean(np.square(away), axis=0))
    assert (spread > 0.2).all() and (spread < 1.7).all() and np.mean(np.abs(away) < 1.96) >= 0.8


@pytest.mark.campaign
def test_a_fit_that_ignores_the_weight(run_of):
    """A plate's weight is refused as pressures that contradict each other; a disk's own is taken for a stiffer silicone."""
    device, components, cms = DEVICES["disk, its own weight"]
    outlines = photographed(run_of("disk, its own weight"), cms)
    without = sm.fit(case_of(device, ()), outlines, "yeoh", QUICK)
    (told,) = [note for note in without.notes if "has no [gravity]" in note]
    assert "168 Pa, 0.9 % of the shear modulus" in told
    without = without.chosen
    with_it = sm.fit(case_of(device, components), outlines, "yeoh", QUICK).chosen
    assert without.fit.values["c1"] > 1.02 * TRUE.c1 and with_it.fit.values["c1"] == pytest.approx(TRUE.c1, rel=1e-4)
    assert with_it.interval("c1")[0] < TRUE.c1 < with_it.interval("c1")[1]
    device, components, cms = DEVICES["membrane with a plate of 20 g"]
    outlines = photographed(run_of("membrane with a plate of 20 g"), cms)
    light = (dataclasses.replace(components[1], mass=0.0),)
    assert not sm.fit(case_of(device, light), outlines, "yeoh", QUICK).chosen.sound


@pytest.mark.campaign
def test_a_wrong_row_is_named_under_a_weight(run_of):
    device, components, cms = DEVICES["disk, with a mass and a thread"]
    outlines = photographed(run_of("disk, with a mass and a thread"), cms)
    outlines[2] = dataclasses.replace(outlines[2], pressure=outlines[2].pressure / 2)
    found = sm.fit(case_of(device, components), outlines, "yeoh", QUICK).chosen
    assert not found.sound and "80 cm contradicts the others" in found.objections[0]


@pytest.mark.campaign
def test_laws_profiles_and_a_tensile_curve(run_of):
    """Two laws compared, with profiles, jointly with a curve; the report tells the loads and where heights count from."""
    device, components, cms = DEVICES["disk, with a mass and a thread"]
    rng = np.random.default_rng(3)
    outlines = photographed(run_of("disk, with a mass and a thread"), cms, rng)
    stretch = np.linspace(1.02, 2.0, 30)
    stress = respond(TRUE, stretch).stress
    curve = TensileCurve("pull", "uniaxial", stretch, stress * (1 + 0.01 * rng.standard_normal(len(stretch))))
    options = sm.FitOptions(poisson=0.49, changes=HOLD, stress_error="1%+50Pa")
    report = sm.fit(case_of(device, components), outlines, "neo-hookean,yeoh", options, curves=[curve])
    assert report.chosen.choice.name == "yeoh" and report.chosen.sound
    for number in ("c1", "c2"):
        low, high = report.chosen.profiles[number].interval
        assert low < getattr(TRUE, number) < high
    (told,) = [note for note in report.notes if "dead loads" in note]
    assert "[gravity] (" in told and "[force.thread] (0.1 N)" in told and "below the undeformed top" in told
    alone = sm.fit(case_of(device, components), outlines, "yeoh", QUICK).chosen
    assert report.chosen.fit.error("c1") < alone.fit.error("c1")


@pytest.mark.campaign
@pytest.mark.parametrize("height_datum", sampled(["shadow", "apex", "undeformed"]))
def test_heights_from_where_they_count(height_datum, run_of):
    """A displacement sensor on the plate that was set to zero as it hung, a photograph, and a height above the clamp."""
    device, components, cms = DEVICES["membrane with a plate of 20 g"]
    run = run_of("membrane with a plate of 20 g")
    apex = {cm: run.at(f"{cm} cm").row["apex_mm"] * 1e-3 for cm in (0, *cms)}
    zero = apex[0] if height_datum == "apex" else 0.0  # the clamp is the highest where it hangs, and does not move
    assert apex[0] < -2e-3
    heights = [Height(f"{cm}", cm * run.case.column.pascal, apex[cm] - zero) for cm in cms]
    options = dataclasses.replace(QUICK, height_datum=height_datum)
    found = sm.fit_heights(case_of(device, components), heights, "yeoh", options).chosen
    assert found.fit.values["c1"] == pytest.approx(TRUE.c1, rel=1e-5)
    assert found.fit.values["c2"] == pytest.approx(TRUE.c2, rel=1e-4)


def test_the_weight_is_that_of_the_case_s_silicone():
    """Whatever law is fitted: Ecoflex 00-10 has 1040 kg/m3, silicones without a sheet 1070."""
    named = MeasuredDevice.of(case_of(DISK, (DOWN,), sm.silicone("ecoflex-00-10")))
    assert [part.density for part in named.components] == [1040.0]
    assert [part.density for part in MeasuredDevice.of(case_of(DISK, (DOWN,))).components] == [1070.0]
    given = (dataclasses.replace(DOWN, density=1200.0),)
    assert MeasuredDevice.of(case_of(DISK, given)).components == given


WHOLE = HollowDisk(cell_size=0.006, fillet=0.0, base_fillet=0.0, angle=360.0)
REFUSED = {
    "a tilted device": (WHOLE, (Gravity("0.6, 0, -0.8"),), {}, "does not act along the device's axis"),
    "a moment": (WHOLE, (Moment("top", "y", 0.001, name="turn"),), {}, r"\[moment.turn\] that does not act along"),
    "a requested force": (DISK, (Force("top", "-z", name="push"),), {}, "whose size is requested.*give it an amount"),
    "no loads to count from": (DISK, (), {"height_datum": "apex"}, "the case has none"),
    "more than it bears": (PLATED, (DOWN, Force("plate", "-z", 1e4, name="press")), {}, "no stiffness fits"),
    "a dome at zero pressure": (DISK, (Gravity("z", magnitude=98.1),), {}, "mm from straight at zero pressure"),
}


@pytest.mark.parametrize(
    ("device", "components", "how", "words"),
    sampled(REFUSED.values(), [row for name, row in REFUSED.items() if name != "more than it bears"]),
    ids=REFUSED.keys(),
)
def test_what_is_refused(device, components, how, words, run_of):
    outlines = photographed(run_of("disk, its own weight"), DEVICES["disk, its own weight"][2])
    if device is WHOLE:
        case = Case("device", device, TRUE, steps=steps_of(pressure_cm=(1.0,)), components=components)
    elif not components or isinstance(components[0], Gravity):
        case = case_of(device, components)
    else:
        case = dataclasses.replace(case_of(device, ()), components=components)
    with pytest.raises(sm.FitError, match=words):
        sm.fit(case, outlines, "yeoh", dataclasses.replace(QUICK, **how))


def test_heights_from_is_one_of_three():
    with pytest.raises(sm.FitError, match="it must be one of shadow, apex, undeformed"):
        sm.FitOptions(height_datum="floor")


@pytest.mark.campaign
def test_the_commands(run_of, tmp_path):
    """``fit`` and ``score`` on a case file with gravity."""
    device, components, cms = DEVICES["disk, its own weight"]
    file, folder = tmp_path / "case.toml", tmp_path / "outlines"
    file.write_text(case_of(device, components).to_toml())
    folder.mkdir()
    for one in photographed(run_of("disk, its own weight"), cms, np.random.default_rng(5)):
        one.to_csv(folder / f"{one.source}.csv")
    words = [str(file), str(folder), "--fix", "c3=0Pa", "--poisson", "0.49", "--no-profiles"]
    done = CliRunner().invoke(fit_material, [*words, "-o", str(tmp_path / "fit")])
    assert done.exit_code == 0, done.output
    assert "dead loads [gravity] (" in done.output and "shadow at zero pressure" in done.output
    fitted = tomllib.loads((tmp_path / "fit" / "fitted.toml").read_text())["fit"]
    low, high = fitted["intervals_95"]["c1"]
    assert low < TRUE.c1 < high and high - low < 0.1 * TRUE.c1
    assert (tmp_path / "fit" / "outlines-yeoh.png").stat().st_size > 20_000
    true = f"yeoh:c1={TRUE.c1}Pa,c2={TRUE.c2}Pa,c3=0Pa,poisson=0.49"
    soft = f"yeoh:c1={0.8 * TRUE.c1}Pa,c2={TRUE.c2}Pa,c3=0Pa,poisson=0.49"
    asked = [str(file), str(folder), "--material", true, "--material", soft, "-o", str(tmp_path / "scores")]
    done = CliRunner().invoke(score, asked)
    assert done.exit_code == 0, done.output
    with (tmp_path / "scores" / "scores.csv").open() as table:
        chi2 = {row["material"]: float(row["chi2_per_value"]) for row in csv.DictReader(table)}
    assert 0.3 < chi2[true] < 2.0 and chi2[soft] > 3 * chi2[true]
    done = CliRunner().invoke(fit_material, [str(file), str(folder), "--height-datum", "floor"])
    assert done.exit_code == 2
