"""The work of the cavity pressure is the energy stored, on the way up and past a limit point."""

from __future__ import annotations

import numpy as np
import pytest

from geometries import HollowDisk
from softmodels.materials.laws import NeoHookean, Yeoh
from softmodels.runs.fields import Fields


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


@pytest.mark.parametrize("name", CASES)
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
