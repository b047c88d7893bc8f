"""A law that this file alone defines: run, fitted to curves and to outlines, drawn, written and read like the library's own."""

from __future__ import annotations

import csv
import dataclasses
import math
import tomllib
from typing import ClassVar

import numpy as np
import pytest
import tomli_w
from click.testing import CliRunner

from geometries import HollowDisk, PneuNet
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.case.materials import Region, from_table, own_modules, to_table
from softmodels.fitting.curves.curve import TensileCurve
from softmodels.fitting.curves.fit import fit_curves
from softmodels.fitting.outlines.device import MeasuredDevice
from softmodels.fitting.outlines.fit import fit
from softmodels.fitting.problem import FitOptions, LawChoice, all_laws
from softmodels.materials.laws import LAWS, Material, MaterialError, NeoHookean, parameter, poissons_ratio, register_law
from softmodels.materials.specimens import nominal_stress, respond, sphere_pressure
from tests.support.simulated import SimulatedCamera, simulated_outlines

SERIES = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)
"""Coefficients of Arruda & Boyce 1993, doi 10.1016/0022-5096(93)90013-6."""
TRUTH = {"rigidity": 20e3, "links": 4.0}
CM = 95.1


@dataclasses.dataclass(frozen=True)
class EightChain(Material):
    """Arruda-Boyce: W = n sum C_i / N^(i-1) (I1_bar^i - 3^i), chains of N rigid links; not linear in N."""

    name: ClassVar[str] = "eight-chain"
    rigidity: float = parameter("Pa", "chain density times kT", bounds=(1.0, 1e9))
    links: float = parameter("", "links of a chain", bounds=(1.1, 1e4))
    poisson: float = poissons_ratio()

    def check(self):
        if self.links <= 1.0:
            raise MaterialError(f"eight-chain: links = {self.links:g}; it must be above one")

    @staticmethod
    def shape(strain, m):
        terms = (c / m.links**i * (strain.I1_bar ** (i + 1) - 3 ** (i + 1)) for i, c in enumerate(SERIES))
        return m.rigidity * sum(terms)

    @property
    def shear_modulus_0(self):
        return 2 * self.rigidity * sum((i + 1) * c * 3**i / self.links**i for i, c in enumerate(SERIES))

    @classmethod
    def starting_values(cls, modulus, strain=10.0, terms=0):
        return {"rigidity": 0.8 * modulus, "links": max(strain, 2.0)}


@pytest.fixture
def law():
    """The law, known by its name for one test."""
    yield register_law(EightChain)
    del LAWS[EightChain.name]


def strip():
    stretch = np.linspace(1.02, 3.0, 40)
    return TensileCurve("strip", "uniaxial", stretch, respond(EightChain(**TRUTH, poisson=0.5), stretch).stress)


def test_another_law_of_a_name_is_refused(law):
    with pytest.raises(ValueError, match="'eight-chain' is taken"):
        register_law(dataclasses.dataclass(frozen=True)(type("Other", (EightChain,), {})))
    assert register_law(law) is LAWS["eight-chain"]


def test_the_law_needs_no_name_to_be_fitted_to_a_curve(capfd):
    """By its class alone, without being registered: the true numbers come back, and nothing is printed."""
    report = fit_curves([strip()], EightChain)
    assert report.material == report.chosen.material and report.chosen.choice.law is EightChain
    for name, true in TRUTH.items():
        assert report.chosen.fit.values[name] == pytest.approx(true, rel=1e-6)
    assert report.chosen.interval("links")[0] < 4.0 < report.chosen.interval("links")[1]
    assert capfd.readouterr() == ("", "")


def test_the_default_start_has_the_modulus():
    """What `Material.starting_values` does for a law that does not say where a fit starts."""

    class Plain(EightChain):
        starting_values = Material.__dict__["starting_values"]

    start = Plain.starting_values(30e3)
    assert Plain(**start).shear_modulus_0 == pytest.approx(30e3) and start["links"] == 2.2


def test_it_is_compared_written_and_read(law):
    assert law.name in all_laws() and LawChoice.from_text("eight-chain").names == ("rigidity", "links")
    report = fit_curves([strip()], "neo-hookean,eight-chain", FitOptions(profiles=False))
    assert report.chosen.choice.name == "eight-chain"
    table = tomllib.loads(tomli_w.dumps(to_table(report.material)))
    assert from_table(table) == report.material
    with pytest.raises(MaterialError, match="eight-chain needs links"):
        from_table({"law": "eight-chain", "rigidity": "20 kPa"})


def test_its_curves_are_drawn(law, tmp_path):
    from softmodels.cli.material_commands import curve

    words = [
        "--material",
        "eight-chain:rigidity=20kPa,links=4,poisson=0.5",
        "--stretch",
        "1:3",
        "-o",
        str(tmp_path / "c"),
    ]
    done = CliRunner().invoke(curve, words)
    assert done.exit_code == 0, done.output
    assert (tmp_path / "c" / "curves.png").stat().st_size > 10_000
    *_, last = csv.DictReader((tmp_path / "c" / "curves.csv").read_text().splitlines())
    # dW/dL along uniaxial tension: W' (2 L - 2 / L^2), W' = n sum i C_i I1^(i-1) / N^(i-1).
    first = 9 + 2 / 3
    slope = 20e3 * sum((i + 1) * c * first**i / 4.0**i for i, c in enumerate(SERIES))
    assert float(last["uniaxial_nominal_Pa"]) == pytest.approx(slope * (6 - 2 / 9), rel=1e-8)


@pytest.mark.campaign
def test_it_is_run_and_fitted_to_outlines(comm):
    """Outlines simulated under the law lead back to it, and the device's path is the one of its own energy."""
    disk = HollowDisk(section="axisymmetric", cell_size=0.006, fillet=0.0, base_fillet=0.0)
    choice = LawChoice.from_law(EightChain, 0.49)
    model = MeasuredDevice(disk).model(choice, comm)
    pressures = [25 * CM, 60 * CM, 100 * CM, 140 * CM]
    camera = SimulatedCamera(spacing=2e-4)
    outlines = simulated_outlines(model, TRUTH, pressures, camera)
    report = fit(disk, outlines, EightChain, FitOptions(poisson=0.49, profiles=False, silicone="any"), comm=comm)
    assert report.chosen.fit.converged
    modulus = EightChain(**TRUTH).shear_modulus_0
    assert report.material.shear_modulus_0 == pytest.approx(modulus, rel=0.02)
    assert nominal_stress(report.material, [1.5]) == pytest.approx(nominal_stress(EightChain(**TRUTH), [1.5]), rel=0.02)


def test_closed_forms_take_it():
    """A thin sphere's pressure is a balloon's."""
    law = EightChain(**TRUTH, poisson=0.5)
    thin = sphere_pressure(law, 20e-3, 20.02e-3, 1.3)
    assert float(thin) == pytest.approx(2 * 0.001 * float(nominal_stress(law, 1.3, "equibiaxial")) / 1.3**2, rel=0.01)
    assert math.isinf(law.strain_limit) and law.remark == ""


def test_another_process_is_told_of_it_wherever_it_is_used():
    """The process that draws imports this file, be the law that of the device or of a region."""
    law, plain = EightChain(**TRUTH), NeoHookean(30e3)
    finger = PneuNet()
    region = Case(
        "finger",
        finger,
        plain,
        steps=steps_of(pressure_cm=(1.0,)),
        components=(Region(EightChain(**TRUTH), name="base"),),
    )
    assert own_modules(Case("finger", finger, plain, steps=steps_of(pressure_cm=(1.0,)))) == ""
    assert own_modules(region) == own_modules(Case("finger", finger, law, steps=steps_of(pressure_cm=(1.0,)))) == __file__
