"""Two processes find what one does; three do in `test_rigid`."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from tests.support.on_ranks import figures as program
from tests.support.ranks import figures_on

NEAR_A_LIMIT = ("lowest eigenvalue",)
"""Figures of a state 0.4 % of the pressure past a limit point. An eigenvalue falls there as the root of the distance from it,
so that a difference of 1e-12 to 1e-11 in the pressure shows a hundred times larger."""
BY_ITERATIONS = ("wedge by iterations",)
"""Figures of linear solves to 1e-9 whose iterates depend on the ranks."""


@pytest.fixture(scope="module")
def meshes(two_cavities, tmp_path_factory):
    folder = tmp_path_factory.mktemp("ranks")
    pair = program.pair_of(shutil.copy(two_cavities, folder / "pair.step"))
    devices = (program.WEDGE, program.SLAB, program.FINGER, program.SECTION, program.TWIN)
    return [*(device.write(folder / f"{device.name}.msh") for device in devices), pair.write(folder / "pair.msh")]


@pytest.fixture(scope="module")
def serial(meshes, comm):
    return program.figures(comm, *meshes)


def _numbers(values):
    """The numbers of a state; one that consists of parts, such as forces by part, gives each of them."""
    parts = [list(one.values()) if isinstance(one, dict) else [one] for one in values]
    return np.array([number for part in parts for number in part], dtype=float)


def test_figures_do_not_depend_on_the_ranks(meshes, serial, figure):
    found = figures_on(2, "figures", *meshes)
    assert found.pop("ranks") == 2
    assert set(found) == set(serial) and "limit" in found and found["end that is named"] == [1.0]
    for state, values in serial.items():
        here, there = _numbers(values), _numbers(found[state])
        assert len(here) == len(there)
        apart = np.subtract(there, here) / np.maximum(np.abs(here), 1e-3)
        figure("one rank", f"{state}, on 2 ranks", apart, 1e-8 if state in (*NEAR_A_LIMIT, *BY_ITERATIONS) else 1e-9)
