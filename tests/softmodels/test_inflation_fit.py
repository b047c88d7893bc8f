"""Fits to a device's pressure over its size: a spherical shell in closed form, and membranes by shooting."""

from __future__ import annotations

import csv
import dataclasses
import json

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.polynomial.legendre import leggauss

import softmodels as sm
from softmodels.case.case import case_of
from softmodels.cli.material_commands import fit_material, score
from softmodels.fitting.outlines import inflations
from softmodels.fitting.outlines.device import MeasuredDevice
from softmodels.fitting.outlines.shapes import OutlineFitError
from softmodels.fitting.problem import LawChoice
from softmodels.mechanics import mpi
from tests.support.membrane_shooting import CircularMembrane, Yeoh

BALLOON = sm.Balloon(radius=0.015, wall=0.001, neck_radius=0.0, section="axisymmetric", cell_size=0.003)
CAVITY = 4 / 3 * np.pi * 0.015**3
C1, C2 = 15e3, 100.0
STRETCHES = np.linspace(1.03, 2.6, 14)  # the limit point is near 1.4
HOLD = sm.FitOptions(changes={"c3": {"start": 0.0, "fixed": True}}, profiles=False)


def shell(stretch):
    """Pressure in Pa of the incompressible shell whose inner radius has a stretch, by the integral of 2 (s_t - s_r) / r over
    the wall, and the outer radius in m."""
    x, weight = leggauss(30)
    inner, outer = 0.015, 0.016
    R = inner + (outer - inner) * (x + 1) / 2
    r = np.cbrt(R**3 + (stretch**3 - 1) * inner**3)
    hoop = r / R
    I1 = 2 * hoop**2 + hoop**-4
    difference = 2 * (C1 + 2 * C2 * (I1 - 3)) * (hoop**2 - hoop**-4)
    return float((weight * (outer - inner) / 2 * 2 * difference / r * (R / r) ** 2).sum()), float(
        np.cbrt(outer**3 + (stretch**3 - 1) * inner**3)
    )


PRESSURES, OUTER = np.array([shell(stretch) for stretch in STRETCHES]).T
VOLUMES = CAVITY * (STRETCHES**3 - 1)


def case_file(folder, device=BALLOON, **more):
    path = folder / "device.toml"
    path.write_text(case_of(device, sm.NeoHookean(30e3), "0:5 cm", **more).to_toml())
    return path


def write(path, headers, *columns):
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(headers)
        rows.writerows(zip(*columns, strict=True))
    return path


def invoked(command, *arguments):
    return CliRunner().invoke(command, [str(a) for a in arguments])


def test_a_balloon_past_its_limit_point(tmp_path):
    """Noise, readings at rest, and the way back, whose pressures are lower."""
    assert PRESSURES.argmax() < 5
    rng = np.random.default_rng(2)
    noisy = PRESSURES + 0.004 * PRESSURES.max() * rng.standard_normal(len(PRESSURES))
    volumes, pressures = np.r_[0.0, VOLUMES, VOLUMES[-3::-3]], np.r_[0.0, noisy, 0.7 * noisy[-3::-3]]
    table = write(tmp_path / "v.csv", ["Infused volume (mL)", "Pressure (mbar)"], 1e6 * volumes, pressures / 100)
    case = case_file(tmp_path)
    done = invoked(fit_material, case, table, "--material", "yeoh", "--fix", "c3=0Pa", "--no-profiles",
                   "-o", tmp_path / "out")  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "added-volume from column 1 'Infused volume (mL)' in ml, pressure from column 2" in done.output
    assert (tmp_path / "out" / "pressures.png").stat().st_size > 10_000
    assert "Pressures of the device" in (tmp_path / "out" / "report.html").read_text()
    assert "4 readings below an earlier size are left out" in done.output
    law = json.loads((tmp_path / "out" / "fit.json").read_text())["laws"][0]
    known = {p["name"]: p for p in law["parameters"]}
    assert known["c1"]["value"] == pytest.approx(C1, rel=0.01) and known["c2"]["value"] == pytest.approx(C2, rel=0.1)
    for name, truth in (("c1", C1), ("c2", C2)):
        low, high = known[name]["interval_95"]
        assert low < truth < high
    materials = ["--material", tmp_path / "out" / "fitted.toml", "--material", "neo-hookean:shear_modulus=30kPa"]
    done = invoked(score, case, table, *materials, "--stress-error", "3Pa", "-o", tmp_path / "score")
    assert done.exit_code == 0, done.output
    with (tmp_path / "score" / "scores.csv").open() as file:
        fitted, plain = csv.DictReader(file)
    assert float(fitted["rms"]) < 1.5 * 0.004 * PRESSURES.max() < 0.2 * float(plain["rms"])


def source_of(device, kind, sizes, pressures, law="yeoh", components=()):
    measured = MeasuredDevice.of(case_of(device, sm.NeoHookean(30e3), "0:5 cm", components=list(components)))
    model = measured.model(LawChoice.from_text(law), mpi.start())
    return inflations.InflationResiduals(model, inflations.Inflation("table", kind, np.array(sizes), np.array(pressures)))


@pytest.mark.parametrize(("kind", "sizes"), [("radius", OUTER), ("rise", 2e-2 * STRETCHES), ("volume", CAVITY + VOLUMES)])
def test_derivatives_at_a_fixed_size(kind, sizes):
    """By the law and by the wall, against central differences; the pressures against the closed form, but for a rise."""
    places = [1, 4, 9]
    components = [sm.Gravity("-z", density=1070.0)] if kind == "rise" else []
    source = source_of(BALLOON, kind, sizes[places], PRESSURES[places], components=components)
    values = {"c1": C1, "c2": C2, "c3": 0.0, "poisson": 0.5, "wall": 0.001}
    off, J, _ = source.evaluate(values, True)
    if kind != "rise":
        assert np.abs(off * source.errors) == pytest.approx(0.0, abs=0.004 * PRESSURES.max())
    way = {"c1": 15.0, "c2": 1.0, "c3": 0.01, "wall": 1e-6}
    ends = [source.evaluate({n: v + side * way.get(n, 0.0) for n, v in values.items()}, False)[0] for side in (1, -1)]
    slope = sum(J[:, source.parameters.index(name)] * step for name, step in way.items())
    assert (ends[0] - ends[1]) / 2 == pytest.approx(slope, rel=2e-3)


def test_the_table_of_a_run_gives_its_silicone_back(tmp_path):
    """Whose columns hold two pressures, heights of a column and pascals."""
    run = sm.inflate(BALLOON, sm.NeoHookean(30e3), pressures="0:1.5 kPa", folder=tmp_path / "run")
    chosen = sm.fit(BALLOON, tmp_path / "run" / "path.csv", "neo-hookean", dataclasses.replace(HOLD, changes={})).chosen
    assert len(run.pressure) > 3
    assert chosen.material.shear_modulus_0 == pytest.approx(30e3, rel=1e-5)


def test_many_readings_keep_the_curve_in_few_groups():
    stretch = np.linspace(1.0, 2.6, 3000)
    pressures = np.interp(stretch, [1.0, *STRETCHES], [0.0, *PRESSURES])
    noise = 0.01 * PRESSURES.max() * np.random.default_rng(3).standard_normal(3000)
    size, pressure = inflations._grouped(stretch**3 - 1, pressures + noise)
    assert 20 < len(size) <= inflations.MAX_GROUPS
    expected = np.interp(size, stretch**3 - 1, pressures)
    assert np.abs(pressure - expected).max() < 0.012 * PRESSURES.max()


@pytest.mark.campaign
@pytest.mark.parametrize(("kind", "thickness"), [("rise", 0.2e-3), ("added-volume", 0.3e-3)])
def test_a_membrane_by_another_method(kind, thickness):
    """The membrane equations under Yeoh's law; the law and its stiffening lie in their intervals."""
    law = Yeoh(20e3, 300.0, 5.0)
    states = CircularMembrane(0.02, thickness, law).path(np.linspace(2e-3, 24e-3, 20))
    pressures = np.array([state.pressure for state in states])
    noise = 0.003 * pressures.max() * np.random.default_rng(6).standard_normal(len(states))
    sizes = np.array([state.height if kind == "rise" else state.volume for state in states])
    table = inflations.Inflation("membrane", kind, sizes, pressures + noise)
    device = sm.Membrane(radius=0.02, thickness=thickness, section="axisymmetric")
    chosen = sm.fit(device, table, "yeoh", dataclasses.replace(HOLD, changes={})).chosen
    assert chosen.sound
    for name, truth in dataclasses.asdict(law).items():
        low, high = chosen.fit.interval(name)
        assert low < truth < high, (name, low, high)
    assert chosen.fit.values["c1"] == pytest.approx(law.c1, rel=0.04)


def test_what_cannot_be_fitted_is_said_before_any_state(tmp_path):
    case = case_file(tmp_path)

    def said(name, headers, *columns, options=()):
        done = invoked(fit_material, case, write(tmp_path / name, headers, *columns), *options, "-o", tmp_path / "out")
        assert done.exit_code == 2, done.output
        return done.output

    size, pressure = 1e6 * VOLUMES, PRESSURES / 1e3
    assert "no line names a volume, radius or rise and a pressure" in said("a.csv", ["flow", "p"], size, pressure)
    assert "'Volume' has no unit" in said("b.csv", ["Volume", "Pressure (kPa)"], size, pressure)
    assert "(m)" not in said("c.csv", ["Volume (kPa)", "Pressure (kPa)"], size, pressure)
    assert "above the room's" in said("d.csv", ["Volume (ml)", "Pressure (kPa)"], size, 101.3 + pressure)
    assert "larger than at rest" in said("e.csv", ["Radius (mm)", "Pressure (kPa)"], STRETCHES, pressure)
    assert "--heights" in said("f.csv", ["height_m", "pressure_Pa", "trusted"], STRETCHES, pressure, ["yes"] * len(size))
    assert "times the undeformed cavity" in said("l.csv", ["V (ml)", "p (kPa)"], 1e3 * size, pressure)
    for headers in (["Volume (ml)", "Vacuum pressure (kPa)"], ["Withdrawn volume (ml)", "Pressure (kPa)"]):
        assert "says that air is drawn out" in said("m.csv", headers, size, pressure)
    good = ["Volume (ml)", "Pressure (kPa)"]
    assert "shows no memory" in said("g.csv", good, size, pressure, options=["--memory"])
    assert "does not show in" in said("h.csv", good, size, pressure, options=["--free", "poisson"])
    assert "fit each table by itself" in said("i.csv", good, size, pressure, options=[tmp_path / "g.csv"])
    assert "there is no such photograph" in said("j.csv", good, size, pressure, options=["--exclude", "line 99"])
    columns = ["--columns", "volume=2[ml],pressure=1[kPa]", "--exclude", "line 99"]
    assert "line 14" in said("k.csv", ["a", "b"], pressure, size, options=columns)
    with pytest.raises(OutlineFitError, match="does not widen beyond a radius"):
        source_of(BALLOON, "radius", 10 * OUTER, PRESSURES).path()
