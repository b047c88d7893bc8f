"""Stress, strain and their directions as fields, and along lines: thick walls against their exact integrals, every formulation
against its energy.

The wall of an incompressible sphere with R^3 -> R^3 + A has s_hoop - s_radial = mu (l^2 - l^-4), l = r / R, and the radial
stress is its integral to the free outer surface, d s_radial / dr = 2 (s_hoop - s_radial) / r. That of a tube of constant length
with R^2 -> R^2 + A has mu (l^2 - l^-2) and no factor 2. Nodal stresses come by a linear fit in each cell.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

import softmodels as sm
from softmodels.materials.laws import NeoHookean
from softmodels.mechanics.body import Body
from softmodels.runs.fields import Fields, requestable
from softmodels.runs.states import Probe
from tests.support import bodies
from tests.support.campaigns import sampled
from tests.support.cavities import TubeBody
from tests.support.closed_forms import work_of_stress

LAW = NeoHookean(100e3, 0.5)
SPHERE = "closed integrals of a thick incompressible sphere, radii 10 and 15 mm, inner stretch 1.5, over the pressure"
TUBE = "closed integrals of a thick incompressible tube, radii 10 and 15 mm, inner stretch 1.5, over the pressure"
WORK = "central difference of the stored energy"


def exact(R, device, power):
    """Radial and hoop stress, and the hoop stretch, at undeformed radii R of the wall of a sphere (power 3) or a tube (2)."""
    added = device.inner**power * (1.5**power - 1)

    def stretch(radius):
        return (1 + added / radius**power) ** (1 / power)

    def difference(radius):
        through = stretch(radius) ** (1 - power)
        return LAW.shear_modulus * (stretch(radius) ** 2 - through**2)

    def slope(radius):
        return (power - 1) * difference(radius) / stretch(radius) ** power / radius

    radial = np.array([-quad(slope, one, device.outer)[0] for one in R])
    return radial, radial + difference(R), stretch(R)


WALLS = {
    "sphere": (bodies.Sphere(through=8, along=24), Body, 3, (-0.48, 0.6, -0.64), SPHERE, 0.009),
    "tube": (bodies.Tube(section="quarter", through=4), TubeBody, 2, (-0.6, 0.8, 0.0), TUBE, 0.035),
}


@pytest.mark.parametrize("wall", sampled(WALLS))
def test_stress_along_a_line_through_a_wall(wall, equilibrium, solved, figure):
    """The line lies where neither the section of the sphere nor the quarter of the tube is."""
    device, kind, power, out, against, bound = WALLS[wall]
    equations = equilibrium(device, LAW, kind=kind)
    state = solved(equations, [(1.5**power - 1) * equations.system.rest().V], "volume", "volume")[1][-1].state
    fields = Fields(equations, requested=requestable())
    nodal = fields.nodal(state)
    probe = Probe(device, (fields.grid.points, fields.grid.cells, fields.grid.cell_name))
    hoop = np.array([out[1], -out[0], 0.0]) / np.hypot(*out[:2])
    foot = np.zeros(3) if wall == "sphere" else np.array([0.0, 0.0, 1e-3])
    line = probe.line((foot + device.inner * np.array(out), foot + device.outer * np.array(out)), nodal, 31)
    assert line.inside.all()

    def of(name, a, b):
        return np.einsum("i,kij,j->k", a, line[name], b)

    radial, around, stretch = exact(device.inner + line.distance, device, power)
    pressure = -radial[0]
    for what, found, known in (
        ("radial Cauchy stress", of("cauchy_stress", out, out), radial),
        ("hoop Cauchy stress", of("cauchy_stress", hoop, hoop), around),
        ("Cauchy shear stress", of("cauchy_stress", hoop, out), 0.0),
        ("normal stress along the moved line", line.normal_stress, radial),
        ("first Piola-Kirchhoff hoop stress", of("nominal_stress", hoop, hoop), around / stretch),
        ("largest principal stress", line["principal_stresses"][:, 0], around),
    ):
        figure(against, f"{what}, {wall}", (found - known) / pressure, bound)
    strain = of("green_lagrange_strain", hoop, hoop)
    figure(against, f"hoop stretch by F and by the Green-Lagrange strain, {wall}",
           np.array([of("deformation_gradient", hoop, hoop), np.sqrt(1 + 2 * strain)]) / stretch - 1, bound)  # fmt: skip
    begin, end = probe.through(foot + 1.01 * device.inner * np.array(out))
    figure(against, f"way straight through the wall, {wall}",
           np.linalg.norm(end - begin) / (device.outer - device.inner) - 1, 1e-3)  # fmt: skip
    directions = nodal["principal_stress_directions"]
    turned = directions @ nodal["cauchy_stress"] @ np.swapaxes(directions, -1, -2)
    known = nodal["principal_stresses"][:, :, None] * np.eye(3)
    assert np.allclose(turned, known, atol=1e-9 * pressure) and (np.diff(nodal["principal_stresses"]) <= 0).all()


@pytest.mark.parametrize("formulation", ["mixed", "displacement"])
def test_stress_does_the_work_of_the_energy(formulation, equilibrium, solved, figure):
    law = sm.Yeoh(50e3, 1e3, 50.0, 0.45)
    equations = equilibrium(bodies.Sphere(through=2, along=6), law, formulation)
    state = solved(equations, [0.5])[1][-1].state
    work = work_of_stress(Fields(equations), state)
    figure(WORK, f"work of the Cauchy stress on a displacement, {formulation}", work, 1e-8)
