"""Photographs of a balloon beyond its equator, from pictures to a silicone by the command line alone."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from click.testing import CliRunner

from geometries import Balloon, PneuNet
from measurement.__main__ import main as measure
from measurement.outline.outline import Outline
from softmodels.case.case import case_of
from softmodels.cli.material_commands import fit_material, score
from softmodels.fitting.outlines.device import MeasuredDevice
from softmodels.fitting.outlines.residuals import read_heights
from softmodels.fitting.outlines.shapes import OutlineFitError, Silhouette, prepare, read_outlines
from softmodels.fitting.problem import LawChoice
from softmodels.materials.laws import NeoHookean
from softmodels.mechanics import mpi
from tests.support import side_views

PIXEL, CENTRE = 34e-6, np.array([0.0, 13e-3])
MODULUS = 30e3
SIZES = {"radius": 6e-3, "wall": 0.8e-3, "neck_radius": 2e-3, "neck_length": 4e-3, "section": "axisymmetric"}
CASE = """
[geometry]
device = "Balloon"
radius = "6 mm"
wall = "0.8 mm"
neck_radius = "2 mm"
neck_length = "4 mm"
cell_size = "1 mm"
section = "axisymmetric"
[material]
law = "neo-hookean"
shear_modulus = "10 kPa"
[load]
pressure_cm = "0:10"
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A folder with the case, photographs, their list and the setup; the pixels of the base."""
    folder = tmp_path_factory.mktemp("balloon")
    law = NeoHookean(MODULUS)
    measured = MeasuredDevice.of(case_of(Balloon(cell_size=0.8e-3, **SIZES), law, "0,5 cm"), Silhouette)
    model = measured.model(LawChoice.from_text("neo-hookean"), mpi.start())
    values = {"shear_modulus": MODULUS, "poisson": 0.5, "wall": SIZES["wall"]}
    volume = 4.0 / 3.0 * np.pi * SIZES["radius"] ** 3
    states = model.states(values, [0.3 * volume, 0.9 * volume], "volume")
    rows = ["file,pressure,error"]
    rest = model.silhouette.points[..., [0, 2]] - model.silhouette.top[[0, 2]]
    for k, (pressure, nodes) in enumerate([(0.0, rest), *((model.pressure(s), model.curve(s).nodes) for s in states)]):
        chain = nodes[:, [0, 2, 1]].reshape(-1, 2)[::-1] + np.array([0.0, model.silhouette.tall])
        chain = np.vstack([[chain[0, 0], -8e-3], chain])
        chain = chain[np.r_[True, np.linalg.norm(np.diff(chain, axis=0), axis=1) > 1e-9]]
        surface = side_views.revolved(chain)
        side_views.photograph(folder / f"{k}.jpg", surface, colour=(0.08, 0.08, 0.1), seed=k, pixel=PIXEL, centre=CENTRE)
        rows.append(f"{k}.jpg,{pressure:.2f} Pa,10 Pa")
    (folder / "photos.csv").write_text("\n".join(rows) + "\n")
    (folder / "ball.toml").write_text(CASE)
    run(measure, "setup", folder / "0.jpg", "--lens", "none", "--scale", f"{1.0 / PIXEL}px/m", "-o", folder / "setup.toml")
    half = SIZES["neck_radius"] + SIZES["wall"]
    ends = side_views.to_pixels([[-half, 1e-3], [half, 1e-3]], PIXEL, CENTRE)
    return folder, "=".join(f"{x:.0f},{y:.0f}" for x, y in ends)


def run(command, *words):
    done = CliRunner().invoke(command, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    return done.output


def views(bench, listing, output):
    folder, base = bench
    words = ("--setup", folder / "setup.toml", "--revolved", "--camera-distance", "80cm+-2mm", "--ahead", "0+-0.1mm")
    return run(measure, "view", listing, *words, "--base", base, "-o", output, "--no-pictures")


def test_a_balloon_beyond_its_equator_gives_its_silicone(bench, tmp_path):
    shown = views(bench, bench[0] / "photos.csv", tmp_path / "views")
    assert "3 of 3 measured; written to" in shown and "mm wide, top at" in shown
    outlines = read_outlines([tmp_path / "views"])
    assert [outline.whole for outline in outlines] == ["top"] * 3
    # It overhangs: wide beside the neck, far below the undeformed top.
    assert all(outline.x[0] > outline.x.min() + 1e-3 and outline.z.min() < -10e-3 for outline in outlines)
    run(fit_material, bench[0] / "ball.toml", tmp_path / "views", "--material", "neo-hookean", "-o", tmp_path / "fit")
    (law,) = json.loads((tmp_path / "fit" / "fit.json").read_text())["laws"]
    (parameter,) = (p for p in law["parameters"] if p["name"] == "shear_modulus")
    assert parameter["value"] == pytest.approx(MODULUS, rel=0.03)
    low, high = parameter["interval_95"]
    assert low < MODULUS < high
    shown = run(score, bench[0] / "ball.toml", tmp_path / "views", "--material", tmp_path / "fit" / "fitted.toml")
    assert "2.jpg" in shown


def test_heights_from_the_base_are_not_fitted(bench, tmp_path):
    listing = bench[0] / "raised.csv"
    listing.write_text("\n".join((bench[0] / "photos.csv").read_text().splitlines()[::2]) + "\n")
    assert "mm above the base" in views(bench, listing, tmp_path / "views")
    with pytest.raises(OutlineFitError, match="pressure or height is not a number"):
        read_heights(tmp_path / "views" / "heights.csv")
    (outline,) = (Outline.from_csv(file) for file in tmp_path.glob("views/?.csv"))
    assert outline.whole == "base" and outline.z.min() >= -1e-4
    measured = MeasuredDevice.of(case_of(Balloon(cell_size=1e-3, **SIZES), NeoHookean(MODULUS), "0,5 cm"), Silhouette)
    with pytest.raises(OutlineFitError, match=r"1.jpg: its heights count from the base.*one at zero pressure"):
        prepare([outline], measured.actuator, 6.8e-3)
    with pytest.raises(OutlineFitError, match="and a PneuNet is none; measure how it bends"):
        prepare([dataclasses.replace(outline, whole="top")], PneuNet(), 6.8e-3)
