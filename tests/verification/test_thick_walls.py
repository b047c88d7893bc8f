"""Thick-walled spheres and tubes against the closed integrals of `softmodels.materials.specimens`.

Both walls are incompressible, so the cavity's volume gives the stretch of the inner wall and the pressure follows in closed
form. A path under volume control meets the stretches exactly, past the pressure's limit point too, and what is left is the
error of the mesh.

Theory: with P2 displacements and P1 pressures the stresses converge as h^2 and a figure that the energy alone gives, such
as the pressure at a given volume, at twice that rate, h^4. The integration rule of degree 2 and the walls' arcs, which
quadratic edges only follow to h^3 pointwise, may take one power away: between 3 and 4 is what to expect.
"""

from __future__ import annotations

import numpy as np
import pytest

from softmodels.materials.laws import NeoHookean, Ogden, Yeoh
from softmodels.materials.specimens import sphere_pressure
from softmodels.runs.fields import Fields
from tests.support import bodies
from tests.support.campaigns import sampled
from tests.support.cavities import TubeBody
from tests.support.closed_forms import tube_pressure

STRETCHES = (1.1, 1.4, 1.8)
SPHERE = "closed integral of a thick incompressible sphere, radii 10 and 15 mm, inner stretch to 1.8"
TUBE = "closed integral of a thick incompressible tube, radii 10 and 15 mm, inner stretch to 1.8"

LAWS = {
    "neo-hookean": NeoHookean(100e3, 0.5),
    "yeoh": Yeoh(50e3, 1e3, 50.0, 0.5),
    # Treloar's rubber as Ogden fitted it, doi 10.1098/rspa.1972.0026.
    "ogden": Ogden((0.63e6, 1.2e3, -10e3), (1.3, 5.0, -2.0), 0.5),
}

laws = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
a_law = pytest.mark.parametrize("law", sampled(LAWS.values()), ids=LAWS.keys())


def pressures_at(solved, equations, ratios):
    """Pressure in Pa at cavity volumes given as multiples of the undeformed one."""
    rest = equations.system.rest().V
    _, points, end = solved(equations, [(ratio - 1) * rest for ratio in ratios], "volume", "volume")
    assert end is None
    return np.array([point.state.P for point in points if point.requested]) * equations.system.stress_unit


def errors(solved, equations, exact, power):
    stretches = np.array(STRETCHES)
    found = pressures_at(solved, equations, stretches**power)
    shell = equations.system.body.actuator
    return found / exact(equations.system.material, shell.inner, shell.outer, stretches) - 1


@pytest.mark.quick
@laws
def test_sphere_axisymmetric(law, equilibrium, solved, figure):
    equations = equilibrium(bodies.Sphere(through=4, along=12), law)
    figure(SPHERE, f"{law.name}, pressure on the section", errors(solved, equations, sphere_pressure, 3), 7e-5)


@a_law
def test_sphere_octant(law, equilibrium, solved, figure):
    equations = equilibrium(bodies.Octant(cell_size=0.0025), law)
    figure(SPHERE, "all three laws, pressure on a 3-D octant", errors(solved, equations, sphere_pressure, 3), 8e-4)


@a_law
def test_tube_axisymmetric(law, equilibrium, solved, figure):
    equations = equilibrium(bodies.Tube(through=4), law, kind=TubeBody)
    figure(TUBE, "all three laws, pressure on the section", errors(solved, equations, tube_pressure, 2), 5e-6)


def test_tube_quarter(equilibrium, solved, figure):
    equations = equilibrium(bodies.Tube(section="quarter", through=2), LAWS["neo-hookean"], kind=TubeBody)
    figure(TUBE, "neo-Hookean, pressure on a 3-D quarter", errors(solved, equations, tube_pressure, 2), 1.4e-4)


@pytest.mark.campaign
@a_law
def test_sphere_converges(law, equilibrium, solved, figure):
    """Errors measured on 1, 2 and 4 cells through the wall, largest of the three stretches; see the rates above."""
    meshes = [bodies.Sphere(through=n, along=3 * n) for n in (1, 2, 4)]
    table = [np.abs(errors(solved, equilibrium(mesh, law), sphere_pressure, 3)).max() for mesh in meshes]
    rates = np.log2(np.array(table[:-1]) / table[1:])
    figure(SPHERE, "power of the cell size at which the section's error falls", rates, at_least=3.0)


@pytest.mark.campaign
def test_octant_converges(equilibrium, solved, figure):
    sizes = (0.005, 0.0025, 0.00167)
    equations = [equilibrium(bodies.Octant(cell_size=size), LAWS["neo-hookean"]) for size in sizes]
    table = [np.abs(errors(solved, e, sphere_pressure, 3)).max() for e in equations]
    rate = np.polyfit(np.log([len(e.system.cells) ** (-1 / 3) for e in equations]), np.log(table), 1)[0]
    figure(SPHERE, "power of the cell size at which the octant's error falls", rate, at_least=2.7)


@pytest.mark.campaign
def test_tube_converges(equilibrium, solved, figure):
    meshes = [bodies.Tube(through=n, height=0.005 / n) for n in (1, 2, 4)]
    equations = [equilibrium(mesh, LAWS["neo-hookean"], kind=TubeBody) for mesh in meshes]
    table = [np.abs(errors(solved, e, tube_pressure, 2)).max() for e in equations]
    rates = np.log2(np.array(table[:-1]) / table[1:])
    figure(TUBE, "power of the cell size at which the section's error falls", rates, at_least=3.7)


@pytest.mark.quick
def test_rigid_walls_move_as_one(equilibrium, solved, figure):
    """The sphere stays a sphere: the inner wall's nodes all have the stretch that the volume says."""
    equations = equilibrium(bodies.Sphere(through=4, along=12), LAWS["neo-hookean"])
    rest = equations.system.rest().V
    _, points, _ = solved(equations, [(1.5**3 - 1) * rest], "volume", "volume")
    fields = Fields(equations)
    X = fields.grid.points[:, [0, 2]] / equations.system.length_unit
    moved = X + fields.nodal(points[-1].state)["displacement"][:, [0, 2]] / equations.system.length_unit
    inner = np.abs(np.linalg.norm(X, axis=1) - 1) < 1e-6
    assert inner.sum() == 25
    figure(SPHERE, "stretch of the inner wall's nodes, at 1.5", np.linalg.norm(moved[inner], axis=1) / 1.5 - 1, 2e-4)
