"""Two processes find what one does, and three do: everything in two launches."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from tests.support import on_ranks
from tests.support.campaigns import sampled
from tests.support.ranks import figures_on

BOUNDS = {"figures": 1e-9, "regions": 1e-9, "rigid": 1e-9, "rigid-iterative": 1e-8, "frequencies": 1e-6, "creeping": 1e-8,
          "creeping_rates": 1e-7, "filling": 1e-8, "moving": 1e-8}  # fmt: skip
"""Of the largest difference by program: relative, and for paths and rates over the largest of a column."""
COLUMNS = "creeping", "creeping_rates", "filling", "moving"
LOOSER = {"lowest eigenvalue": 1e-8, "wedge by iterations": 1e-8}
"""An eigenvalue 0.4 % of the pressure past a limit point falls as the root of the distance from it, so that a difference of
1e-12 to 1e-11 in the pressure shows a hundred times larger. Iterates of linear solves to 1e-9 depend on the ranks."""


@pytest.fixture(scope="module")
def meshes(two_cavities, tmp_path_factory, comm):
    from tests.support.on_ranks.figures import pair_of

    folder = tmp_path_factory.mktemp("ranks")
    on_ranks.write_meshes(folder)
    pair_of(shutil.copy(two_cavities, folder / "pair.step")).write(folder / "pair.msh")
    return folder


@pytest.fixture(scope="module")
def several(meshes, request):
    """Return a function that gives a program's figures on several ranks; those of this run's tests come from one launch."""
    asked = {item.callspec.params["program"] for item in request.session.items if item.path == request.path}
    found = figures_on(2, meshes, *(program for program in BOUNDS if program in asked - {"rigid"}))
    return lambda program: found[program] if program in found else figures_on(3, meshes, program)[program]


def _numbers(values):
    """The numbers of a state; one that consists of parts, such as forces by part, gives each of them."""
    parts = [list(one.values()) if isinstance(one, dict) else [one] for one in values]
    return np.array([number for part in parts for number in part], dtype=float)


@pytest.mark.parametrize("program", sampled(BOUNDS, ()))
def test_figures_do_not_depend_on_the_ranks(program, several, meshes, comm, figure):
    one, found = on_ranks.found_by(program, comm, meshes), several(program)
    assert found.keys() == one.keys()
    ranks = 3 if program == "rigid" else 2
    for name, values in one.items():
        here, there = _numbers(values), _numbers(found[name])
        assert len(here) == len(there)
        size = np.abs(here).max() if program in COLUMNS else np.maximum(np.abs(here), 1e-3)
        what = f"{program.replace('_', ' ')}, every column" if program in COLUMNS else f"{program}: {name}"
        figure("one rank", f"{what}, on {ranks} ranks", (there - here) / size, LOOSER.get(name, BOUNDS[program]))
    if program == "figures":
        assert "limit" in one and found["end that is named"] == [1.0]
    if program.startswith("rigid"):
        assert np.degrees(np.linalg.norm(one["plate that turns"][3:6])) > 45.0  # about two axes, and twisted besides
