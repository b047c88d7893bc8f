"""A device defined here, without a change to the library: run, limited, fitted and reported like those of the library.

It is half a hollow ball whose rim slides on a table: a whole ball by symmetry, which has a solution in closed form.
"""

from __future__ import annotations

import csv
import dataclasses
import math
import os
import tomllib
from typing import ClassVar

import numpy as np
import pytest

from geometries import Actuator, GeometryError, Hold, HollowDisk, register_device
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.cli.ending import main
from softmodels.cli.options import device_command
from softmodels.common.errors import OWN_MODULES
from softmodels.common.schema import length_field
from softmodels.fitting.outlines.device import MeasuredDevice
from softmodels.fitting.outlines.residuals import Height, HeightResiduals, least_squares_of_heights
from softmodels.fitting.problem import LawChoice
from softmodels.materials.laws import NeoHookean
from softmodels.materials.specimens import sphere_pressure
from softmodels.pictures.offscreen import can_render
from tests.support import runs


@register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class HalfBall(Actuator):
    """Half a hollow ball on a slippery table, as an axisymmetric section."""

    radius: float = length_field(0.010, "inner radius")
    wall: float = length_field(0.005, "thickness of the wall")
    cell_size: float = length_field(0.002, "edge length of the cells")

    stem: ClassVar = "half-ball"
    axial: ClassVar = True
    faces: ClassVar = ("top",)
    stiffer: ClassVar = "a thicker wall (--wall)"
    dimension: ClassVar = 2
    copies: ClassVar = 1
    mesh_order: ClassVar = 2
    cut_planes: ClassVar = ()
    holds: ClassVar = (Hold("support", (0.0, 0.0, 1.0)), Hold("axis", (1.0, 0.0, 0.0)))

    def check(self):
        if self.cell_size > self.wall:
            raise GeometryError("cell_size must not pass wall")

    @property
    def outer_radius(self):
        return self.radius + self.wall

    @property
    def size(self):
        return self.radius

    @property
    def probes(self):
        return {"apex": (0.0, 0.0, self.outer_radius), "ceiling": (0.0, 0.0, self.radius)}

    @property
    def cavity_volume(self):
        return 2 / 3 * math.pi * self.radius**3

    @property
    def solid_volume(self):
        return 2 / 3 * math.pi * self.outer_radius**3 - self.cavity_volume

    def on_profile(self, points):
        return np.abs(np.linalg.norm(points, axis=1) - self.outer_radius) < 1e-9 * self.outer_radius

    def build(self):
        import gmsh

        occ, (r, R) = gmsh.model.occ, (self.radius, self.outer_radius)
        centre, *corners = (occ.addPoint(x, y, 0) for x, y in ((0, 0), (r, 0), (R, 0), (0, R), (0, r)))
        curves = [occ.addLine(corners[0], corners[1]), occ.addCircleArc(corners[1], centre, corners[2]),
                  occ.addLine(corners[2], corners[3]), occ.addCircleArc(corners[3], centre, corners[0])]  # fmt: skip
        face = occ.addPlaneSurface([occ.addCurveLoop(curves)])
        occ.remove([(0, centre)])
        occ.synchronize()
        for curve, role in zip(curves, ("support", "top", "axis", "cavity"), strict=True):
            gmsh.model.addPhysicalGroup(1, [curve], name=role)
        gmsh.model.addPhysicalGroup(2, [face], name="solid")
        gmsh.model.mesh.setSizeCallback(lambda *_: self.cell_size)


command = device_command(HalfBall, "half_ball", pressures="0:20", examples=("--wall 4mm",))
BALL, LAW = HalfBall(), NeoHookean(20e3, 0.5)


def outer_pressure(law, rise):
    """Pressure in Pa at which a ball's outer surface has risen so far (m)."""
    r, R = BALL.radius, BALL.outer_radius
    return sphere_pressure(law, r, R, np.cbrt(((R + rise) ** 3 - R**3) / r**3 + 1))


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """A run of this very file as a script, with a few pictures and its report where the machine can render."""
    folder = tmp_path_factory.mktemp("ball") / "half-ball"
    pictures = "few" if can_render() else "none"
    done = runs.run(__file__, "--pressure-cm", "0:100:50", "--shear-modulus", "20kPa", "--poisson", "0.5", "--quiet",
                    "--output", folder, "--pictures", pictures)  # fmt: skip
    assert done.status == 0, done.err
    return folder


def test_it_runs_as_its_closed_form_says(ran):
    rows = runs.rows(ran)
    assert [row["pressure_cm"] for row in rows if row["requested"]] == [0.0, 50.0, 100.0]
    for row in rows:
        assert row["pressure_Pa"] == pytest.approx(float(outer_pressure(LAW, row["apex_mm"] * 1e-3)), rel=1e-3, abs=1)
        rise = ((BALL.outer_radius + row["apex_mm"] * 1e-3) ** 3 - BALL.outer_radius**3) * 2 / 3 * math.pi
        assert row["added_volume_ml"] == pytest.approx(rise * 1e6, rel=2e-3, abs=1e-6)
    assert tomllib.loads((ran / "case.toml").read_text())["geometry"]["device"] == "HalfBall"


def test_its_report_names_its_parameters(ran):
    if not can_render():
        pytest.skip("this machine cannot render")
    text = (ran / "report.html").read_text()
    assert "HalfBall" in text and "thickness of the wall" in text and (ran / "stress.png").exists()


def test_a_case_file_names_it(ran):
    case = Case.from_file(ran / "case.toml")
    assert case.actuator == BALL and case.material == LAW and Case.from_toml(case.to_toml()) == case


@pytest.mark.campaign
def test_commands_know_it_by_the_environment(ran, tmp_path):
    """Its limit is the maximum of the closed form; a process that is not told of this file knows no such device."""
    file, environment = ran / "case.toml", {**os.environ, OWN_MODULES: __file__}
    done = runs.run("-m", "softmodels", "limit", file, "--output", tmp_path / "limit", env=environment)
    assert done.status == 0, done.err
    with (tmp_path / "limit" / "limit.csv").open() as table:
        (row,) = csv.DictReader(table)
    stretches = np.linspace(1.0, 3.0, 20001)
    most = sphere_pressure(LAW, BALL.radius, BALL.outer_radius, stretches).max()
    assert row["kind"] == "limit" and float(row["limit_Pa"]) == pytest.approx(most, rel=1e-3)
    done = runs.run("-m", "softmodels", "limit", file, env=dict(os.environ))
    assert done.status == 2 and "HalfBall" in done.err and done.err.count("\n") == 1
    done = runs.run("-m", "softmodels", "limit", file, env={**os.environ, OWN_MODULES: str(tmp_path / "none.py")})
    assert done.status == 2 and "none.py" in done.err and OWN_MODULES in done.err and done.err.count("\n") == 1


@pytest.mark.campaign
def test_its_material_is_fitted_to_its_heights(comm):
    """Heights from the closed form give back the law that they were made with."""
    true = NeoHookean(18e3, 0.5)
    rises = np.linspace(0.2e-3, 1.5e-3, 6)
    heights = [Height(f"photo {k}", float(outer_pressure(true, rise)), rise) for k, rise in enumerate(rises)]
    case = Case("ball", BALL, LAW, steps=steps_of(pressure_cm=(1.0,)))
    device = MeasuredDevice.of(case).model(LawChoice.from_text("neo-hookean"), comm)
    fitted = least_squares_of_heights(HeightResiduals(device, heights))
    assert fitted.values["shear_modulus"] == pytest.approx(18e3, rel=1e-3)


def test_a_name_is_of_one_device():
    class Stranger:
        pass

    Stranger.__name__ = HollowDisk.__name__
    with pytest.raises(ValueError, match="HollowDisk"):
        register_device(Stranger)
    assert register_device(HalfBall) is HalfBall


if __name__ == "__main__":
    main(command)
