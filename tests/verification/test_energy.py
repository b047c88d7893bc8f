"""The work of the cavity pressure is the energy stored, on the way up and past a limit point."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geometries import HollowDisk
from softmodels.materials.laws import NeoHookean, Yeoh
from softmodels.runs.fields import Fields
from tests.support import bodies
from tests.support.campaigns import sampled


def work(points):
    """Integral of P dV over a path (dimensionless): the cubic through both ends of each step and their slopes dP/dV."""
    V, P = (np.array([getattr(point.state, name) for point in points]) for name in ("V", "P"))
    slope = np.array([point.tangent.P / point.tangent.V for point in points])
    step = np.diff(V)
    return float(np.sum(step * (P[:-1] + P[1:]) / 2 + step**2 * (slope[:-1] - slope[1:]) / 12))


CASES = {
    "default": (HollowDisk(section="axisymmetric"), NeoHookean(30e3, 0.49), "auto", "pressure", 0.55, False, 1.7e-9),
    "stiffening": (
        HollowDisk(section="axisymmetric"),
        Yeoh(15e3, 2e3, 100.0, 0.49),
        "auto",
        "pressure",
        0.55,
        False,
        5e-8,
    ),
    "past the limit": (
        HollowDisk.variant("shadow", section="axisymmetric", support="base", cell_size=0.003),
        NeoHookean(20e3, 0.495),
        "arc-length",
        "volume",
        10.0,
        True,
        4e-5,
    ),
}


@pytest.mark.parametrize("name", sampled(CASES))
def test_work_is_stored(name, equilibrium, solved, figure):
    disk, law, control, quantity, goal, falls, most = CASES[name]
    equations = equilibrium(disk, law)
    _, points, end = solved(equations, [goal], control, quantity, largest_step=goal / 25)
    assert end is None
    assert any(point.limit for point in points) == falls
    assert (points[-1].tangent.P < 0) == falls
    equations.system.load(points[-1].state)
    stored = equations.system.stored_energy()
    figure("work of the pressure", f"stored energy, {name}", stored / work(points) - 1, most)
    figures = Fields(equations).figures(points[-1].state)
    assert figures.stored_energy == pytest.approx(
        stored * equations.system.stress_unit * equations.system.volume_unit, rel=1e-12
    )
    assert 0.3 < figures.stored_energy / (figures.pressure * figures.added_volume) < 3.0


# -- What a run reports of the silicone's change of volume is what the equations say of it, not how single cells scatter ---


@pytest.mark.parametrize("poisson", sampled((0.45, 0.5)))
@pytest.mark.parametrize("section", sampled(("solid", "axisymmetric")))
def test_vertices_have_the_volume_of_p(equilibrium, solved, section, poisson, figure):
    """int q (J - 1 - p/bulk) dX = 0 for every linear q: DOLFINx assembles the means of 1 + p/bulk."""
    import ufl
    from dolfinx import fem

    shell = bodies.Octant(cell_size=0.006) if section == "solid" else bodies.Sphere(through=2, along=6)
    law = NeoHookean(100e3, poisson)
    equations = equilibrium(shell, law)
    _, points, _ = solved(equations, [0.6], "volume", "pressure")
    fields, state = Fields(equations), points[-1].state
    figures, nodal = fields.figures(state), fields.nodal(state)

    body = equations.system.body
    linear = fem.functionspace(body.mesh, ("P", 1))
    q, p = ufl.TestFunction(linear), ufl.split(equations.system.w)[1]
    bulk = law.bulk / law.shear_modulus_0
    ratio = 1 + p * (0.0 if math.isinf(bulk) else 1 / bulk)
    dx = body.measures()[0]
    above, below = (fem.assemble_vector(fem.form(form)).array for form in (ratio * q * body.hoop * dx, q * body.hoop * dx))
    means = above / below
    wanted = np.array([means.min(), means.max()])
    figure("1 + p over the bulk modulus", "J in rows", np.subtract(figures.extremes["J"], wanted), 4e-10)
    figure("1 + p over the bulk modulus", "J at vertices", (nodal["J"].min(), nodal["J"].max()) - wanted, 4e-10)
    # Single cells do not keep it: it would be no test if they did.
    J = np.linalg.det(fields.values(state).F).mean(axis=1)
    assert np.ptp(J) > np.ptp(means) + 1e-4
