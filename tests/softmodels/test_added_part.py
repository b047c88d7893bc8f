"""A part defined here alone: read from a case file, solved with, in path.csv, known to fits."""

from __future__ import annotations

import csv
import dataclasses
from typing import ClassVar

import numpy as np
import pytest

import softmodels as sm
from softmodels.case.case import Case, difference, identity
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.cli.run import run
from softmodels.common.commands import RunOptions
from softmodels.common.schema import Quantity, Words, field_of
from softmodels.mechanics.component import COMPONENTS, ComponentError, EnergyComponent, EnergyTerm, register_component
from softmodels.runs.columns import term

DISK = sm.HollowDisk(section="axisymmetric")
LAW = sm.NeoHookean(28e3)


@dataclasses.dataclass(frozen=True)
class Springs(EnergyComponent):
    """A face on springs."""

    face: str = field_of(Words(), "face on springs")
    stiffness: float = field_of(Quantity("Pa/m"), "pressure per displacement", 1e5)
    table: ClassVar[str] = "springs"
    figure_texts: ClassVar = {r"(\w+)_energy_mJ": ("energy of {0}", "stored in those springs")}

    def check(self):
        if self.stiffness <= 0.0:
            raise ComponentError(f"{self.where}: the springs have no stiffness")

    def check_on(self, actuator):
        if self.face not in actuator.faces:
            raise ComponentError(f"{self.where}: {type(actuator).__name__} has no face {self.face!r}")

    def term(self, setting):
        import ufl
        from dolfinx import fem

        body = setting.body
        u, area = body.displacement(setting.displacement), body.sheet_face(self.face)[0]
        k = fem.Constant(body.mesh, self.stiffness * body.actuator.size)
        return Stored([setting.per_pascal * k / 2 * ufl.dot(u, u) * body.hoop * area], self.label)


@dataclasses.dataclass(eq=False)
class Stored(EnergyTerm):
    """Springs that report their energy."""

    label: str

    def compile(self, equations):
        self.forms = [equations.form(energy) for energy in self.energies]

    def figures(self, equations):
        unit = equations.stress_unit * equations.volume_unit * 1e3
        return {f"{self.label}_energy_mJ": unit * sum(equations.integral(form) for form in self.forms)}


@pytest.fixture(autouse=True, scope="module")
def registered():
    register_component(Springs)
    yield
    del COMPONENTS["springs"]


def case(*components):
    return Case("disk", DISK, LAW, steps=steps_of(pressure_cm=(0.0, 20.0)), components=components)


def test_one_and_several_in_a_case_file():
    for components in [(Springs("top"),), (Springs("top", 2e5, name="soft"), Springs("top", name="hard"))]:
        text = case(*components).to_toml()
        assert Case.from_toml(text).components == components
    assert "[springs.soft]" in text and "[springs.hard]" in text


def test_the_librarys_own_kinds_come_first_in_files_and_help():
    """In a stated order, whatever is imported first; an added kind follows."""
    own = [
        "gravity", "mass", "force", "moment", "region", "contact.", "contact.between", "contact", "walls", "sheet", "fibres",
        "fabric", "rigid", "hold",
    ]  # fmt: skip
    assert list(COMPONENTS)[: len(own)] == own and len(COMPONENTS) > len(own)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("[springs]\nstiffness = '1 MPa/m'", "needs face"),
        ("[springs]\nface = 'side'", "no face 'side'"),
        ("[springs]\nface = 'top'\nstiffness = '-1 Pa/m'", "no stiffness"),
        ("[springs]\nface = 'top'\nlength = 3", "unknown entry 'length'"),
        ("[springs]\nface = 'top'\n[springs.a]\nface = 'top'", "mixes entries with"),
        ("[springs.A]\nface = 'top'", "lower-case letter"),
        ("[string]\nface = 'top'", "unknown entry 'string'"),
    ],
)
def test_what_cannot_be_meant(table, words):
    with pytest.raises(CaseError, match=words):
        Case.from_toml(case().to_toml() + table)


def test_two_of_one_name():
    with pytest.raises(CaseError, match="several parts are called springs"):
        case(Springs("top"), Springs("top", 2e5))


def test_another_stiffness_is_another_run():
    old, new = (identity(case(Springs("top", k))) for k in (1e5, 2e5))
    assert difference(old, new) == "components.springs"


def test_its_energy_is_in_the_file_and_in_the_stored_energy(tmp_path):
    assert run(case(Springs("top", 1e7)), tmp_path, RunOptions(quiet=True, no_pictures=True)) == 0
    rows = list(csv.DictReader((tmp_path / "path.csv").open()))
    free = sm.inflate(DISK, LAW, "0:20 cm")
    assert 0.0 < float(rows[-1]["apex_mm"]) < 0.5 * free.apex[-1] * 1e3
    assert 0.0 < float(rows[-1]["springs_energy_mJ"]) < float(rows[-1]["stored_energy_mJ"])
    # The work of the pressure is what is stored, springs and silicone together.
    P, V, W = (np.array([float(row[c]) for row in rows]) for c in ("pressure_Pa", "added_volume_ml", "stored_energy_mJ"))
    assert np.trapezoid(P, V * 1e-6) * 1e3 == pytest.approx(W[-1], rel=0.01)
    assert term("springs_energy_mJ").name == "energy of springs"


def test_fits_know_that_it_keeps_its_stiffness(tmp_path):
    from mpi4py import MPI

    from softmodels.mechanics.body import Body
    from softmodels.mechanics.controls import pressure_control
    from softmodels.mechanics.sensitivity import Sensitivity
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System

    body = Body.from_file(DISK, DISK.write(tmp_path / "disk.msh"), MPI.COMM_SELF)

    def state(mu):
        solver = Solver(System(body, sm.NeoHookean(mu), components=[Springs("top", 1e7)]))
        P = 2000.0 / mu
        found = solver.solve(pressure_control(P), solver.system.rest().w, P)
        return solver, found, found.V * solver.system.volume_unit

    solver, found, _ = state(28e3)
    _, rates = Sensitivity(solver).rates(found, pressure_control(found.P), ["shear_modulus"])
    slope = (state(28e3 * 1.001)[2] - state(28e3 * 0.999)[2]) / 56.0
    assert pytest.approx(slope, rel=1e-4) == rates["shear_modulus"].V


def test_what_only_the_mesh_refuses_is_bad_input(tmp_path, monkeypatch, capsys):
    def refused(self, setting):
        raise ComponentError(f"{self.where}: not on this mesh")

    monkeypatch.setattr(Springs, "term", refused)
    assert run(case(Springs("top")), tmp_path / "run", RunOptions(quiet=True, no_pictures=True)) == 2
    assert "[springs]: not on this mesh" in capsys.readouterr().err
    with pytest.raises(ComponentError, match="not on this mesh"):
        sm.inflate(DISK, LAW, "0:20 cm", components=[Springs("top")])
