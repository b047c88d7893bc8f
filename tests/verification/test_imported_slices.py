"""Wedges of one imported part are one device: cut planes need not follow the axes nor stand square."""

from __future__ import annotations

import numpy as np
import pytest

from softmodels.components.fibres import Sheet
from softmodels.materials.laws import NeoHookean
from softmodels.materials.specimens import sphere_pressure
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.runs.fields import Fields

STRETCH = 1.4


@pytest.mark.parametrize(("angle", "copies"), [(45, 16), (60, 12), (90, 8)])
def test_a_wedge_of_a_ball_inflates_as_the_ball(angle, copies, wedge_part, equilibrium, solved, figure):
    part = wedge_part("ball", angle, cell_size=0.0025)
    assert part.copies == copies and part.cavity_volume == pytest.approx(4 / 3 * np.pi * 0.01**3, rel=1e-4)
    equations = equilibrium(part, NeoHookean(100e3, 0.5))
    _, points, end = solved(equations, [(STRETCH**3 - 1) * equations.system.rest().V], "volume", "volume")
    assert end is None
    exact = sphere_pressure(equations.system.material, 0.010, 0.015, STRETCH)
    against = "closed integral of a thick incompressible sphere"
    figure(
        against,
        "1/16, 1/12 and 1/8 of an imported ball",
        points[-1].state.P * equations.system.stress_unit / exact - 1,
        4e-4,
    )


def test_a_sheet_bonded_to_chosen_faces_holds_them_back(wedge_part, body_of, solved):
    part = wedge_part("can", 45, surfaces=("lid = z = 10 mm",), gauge_point="at 0, 0, 10 mm")
    rises = []
    for sheet in (None, Sheet(part.faces[0], 100.0)):
        equations = Solver(System(body_of(part), NeoHookean(30e3, 0.49), components=[sheet] if sheet else []))
        _, points, end = solved(equations, [3e3 / equations.system.stress_unit])
        assert end is None
        rises.append(Fields(equations).figures(points[-1].state).rises["tip"])
    assert 0 < rises[1] < 0.9 * rises[0]
