"""Clamps: closed forms of a tube whose outside is held, what may be held, and what takes the place of a device's own holds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

import softmodels as sm
from geometries import HollowDisk
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.case.materials import Region
from softmodels.components.rigid import Clamp
from softmodels.materials.laws import NeoHookean
from softmodels.mechanics.body import BodyError
from softmodels.mechanics.component import ComponentError
from softmodels.mechanics.controls import pressure_control
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from tests.support import bodies, membrane_shooting
from tests.support.cavities import TubeBody

LAW = NeoHookean(30e3, 0.3)
DISK = HollowDisk.variant("shadow", section="axisymmetric", support="base", cell_size=0.004)
WEDGE = HollowDisk(angle=15.0, azimuth=20.0, cell_size=0.008, fillet=0.0, base_fillet=0.0)
LAME = "Lame's tube in plane strain, its outside held"


def opening(nu, inner, outer):
    """Inner wall's displacement over its radius per pressure in shear moduli, of a tube that is held at ``outer``.

    With u = A r + B / r and u(outer) = 0, and the radial stress 2 mu ((A - B/r^2) + nu / (1 - 2 nu) 2 A) = -p inside.
    """
    B = 1.0
    A = -B / outer**2
    stress = 2 * ((A - B / inner**2) + nu / (1 - 2 * nu) * 2 * A)
    return -(A * inner + B / inner) / inner / stress


@pytest.mark.parametrize(("clamps", "radius"), [
    ([Clamp("outer", along="x")], "outer"), ([Clamp("outer")], "outer"), ([Clamp("outer", slip="z")], "outer"),
    ([Clamp("shell")], "between"), ([Clamp("shell", name="a", along="x"), Clamp("shell", name="b", slip="x")], "between"),
])  # fmt: skip
def test_tube(clamps, radius, body_of, figure):
    tube = bodies.LayeredTube(through=4)
    components = [*clamps, Region(NeoHookean(60e3, 0.2), name="shell")] if radius == "between" else clamps
    solver = Solver(System(body_of(tube, TubeBody), LAW, components=components))
    solver.factorise(rest := solver.system.rest())
    along = solver.tangent(rest, pressure_control(0.0), 1e-10)
    found = along.V / along.P / (2 * rest.V)
    figure(LAME, "opening per pressure", found / opening(0.3, tube.inner, getattr(tube, radius)) - 1, 1e-4)


class OpenTube(bodies.Tube):
    """A slice of a tube whose upper plane may travel; the library's volume ends in it."""

    @property
    def plate(self):
        return (0.0, 0.0, self.height)


@pytest.mark.parametrize("section", ["axisymmetric", "quarter"])
def test_a_tube_whose_end_travels(section, body_of, figure):
    """A section that stays plane and travels is pulled by the air on the tube's ends."""
    tube, nu = OpenTube(section=section, through=6), LAW.poisson
    solver = Solver(System(body_of(tube), LAW, components=[Clamp("top", along="z", together=True)]))
    solver.factorise(rest := solver.system.rest())
    along = solver.tangent(rest, pressure_control(0.0), 1e-10)
    E = 2 * (1 + nu)
    end = 1 / ((tube.outer / tube.inner) ** 2 - 1)  # stress of the wall along z, and half of the sum of the others
    hoop = end * (1 + (tube.outer / tube.inner) ** 2)
    stretch, opening = (end - 2 * nu * end) / E, (hoop - nu * (-1.0 + end)) / E
    solver.system.unknowns.set_dofs(along.w[: solver.system.dofs])
    (travel,) = solver.system.unknowns.moving["face top"].values
    name = "Lame's tube with closed ends, its section free to travel"
    figure(name, f"stretch along it per pressure, {section}", travel / along.P / (tube.height / tube.size) / stretch - 1, 3e-7)
    figure(name, f"added volume, {section}", along.V / along.P / rest.V / (2 * opening + stretch) - 1, 1e-5)


def test_a_device_held_otherwise(body_of, solved, figure):
    """A glued disk that slides on its bench opens more; the same clamp as its own hold changes nothing."""
    body, law = body_of(DISK), NeoHookean(20e3, 0.495)
    volumes = []
    for components in ([], [Clamp("support")], [Clamp("support", along="z")]):
        solver = Solver(System(body, law, components=components))
        volumes.append(solved(solver, [300.0 / 20e3])[1][-1].state.V - solver.system.rest().V)
    own, same, sliding = volumes
    figure("the disk's own hold", "the same as a clamp, added volume", same / own - 1, 1e-12)
    assert sliding > 1.0001 * own


def test_pull_in(figure):
    """A membrane's clamp without friction: the device's own, and a clamp that takes the place of the full hold."""
    law = NeoHookean(30e3, 0.49)
    own = sm.inflate(sm.Membrane(clamp_width=0.003, clamp="slip"), law, pressures="0,10 cm")
    grip = sm.inflate(
        sm.Membrane(clamp_width=0.003), law, pressures="0,10 cm", components=[Clamp("clamp, clamp_top", along="z")]
    )
    held = sm.inflate(sm.Membrane(clamp_width=0.003), law, pressures="0,10 cm")
    figure("the membrane's own clamp without friction", "the same by [hold]: apex", grip.apex[-1] / own.apex[-1] - 1, 1e-9)
    assert grip.apex[-1] > 1.01 * held.apex[-1]


def test_oblique_planes(body_of):
    """Beside oblique cut planes what is square to both can be held exactly, and a direction between them is refused."""
    body = body_of(WEDGE)
    system = System(body, LAW, components=[Clamp("top", along="z")])
    held = sum(len(dofs) for _, dofs in system.body.held(system.vectors))
    assert held > sum(len(dofs) for _, dofs in body.held(system.vectors))
    with pytest.raises(BodyError, match="neither parallel nor perpendicular to the directions"):
        System(body, LAW, components=[Clamp("top", along="1, 0, 0")])


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("[hold.ring]\nface = 'ring'", "has no 'ring'; known are"),
        ("[hold]\nalong = 'z'", "needs a face"),
        ("[hold]\nface = 'top'\nalong = 'z'\nslip = 'x'", "both along and slip"),
        ("[hold]\nface = 'top'\nslip = 'x'\ntogether = true", "together needs the direction"),
        ("[hold]\nface = 'top'\nalong = 'up'", "is not a direction"),
        ("[hold]\nface = 'top'\nalong = 'y'", "a section has only the directions"),
    ],
)
def test_what_cannot_be_held(table, words):
    with pytest.raises(CaseError, match=words):
        Case.from_toml(Case("disk", DISK, LAW, steps=steps_of(pressure_cm=(5.0,))).to_toml() + table)


def test_case_file():
    components = (Clamp("support", along="z", name="bench"), Clamp("top", slip="x", name="grip"))
    case = Case("disk", DISK, LAW, steps=steps_of(pressure_cm=(5.0,)), components=components)
    assert Case.from_toml(case.to_toml()).components == components


def test_free_to_move(body_of):
    with pytest.raises(ComponentError, match="move as a rigid body"):
        System(body_of(DISK), LAW, components=[Clamp("support", along="x")])
    assert np.isfinite(System(body_of(DISK), LAW, components=[Clamp("support", along="z")]).rest().V)


@pytest.mark.campaign
def test_a_membrane_on_a_hinge_is_that_of_the_membrane_equations(figure):
    """A clamp on an edge of the held rim lets it turn. Held, the rim bends, which costs height; on its lower edge it gains
    some: both by the thickness over the radius, less in thinner membranes."""
    equations = membrane_shooting.CircularMembrane(0.020, 1e-3, membrane_shooting.Yeoh(15e3))
    height, misses = brentq(lambda h: equations.at_height(h).pressure - 950.0, 0.007, 0.0095), {}
    for thickness in (1e-3, 0.5e-3):
        device = sm.Membrane(section="axisymmetric", thickness=thickness, cell_size=thickness)
        for name, parts in (("held", ()), ("hinged", (sm.Clamp("edge of clamp and cavity", name="hinge"),))):
            run = sm.inflate(device, sm.NeoHookean(30e3, 0.5), f"{950e3 * thickness} Pa", components=parts)
            misses[name, thickness] = run.rows[-1]["apex_mm"] * 1e-3 / height - 1
    figure(
        "membrane equations", "height of a hinged membrane, a twentieth as thick as its radius", misses["hinged", 1e-3], 0.03
    )
    assert misses["hinged", 1e-3] > 0.0 > misses["held", 1e-3]
    assert abs(misses["hinged", 0.5e-3]) < 0.7 * misses["hinged", 1e-3]
