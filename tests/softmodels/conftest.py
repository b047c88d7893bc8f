"""Runs that several files of tests look at: of the command line, and made-up ones to draw."""

from __future__ import annotations

import shutil

import pytest

from geometries import HollowDisk, SeminarActuator
from softmodels.cli.options import main
from softmodels.pictures.offscreen import can_render
from tests.support.made_up import finished, made_up, start_drawing
from tests.support.runs import SOFT, called, disk


@pytest.fixture
def ended():
    """Return a function that runs a command in this process: its exit status, what it printed, and its complaints."""

    def run_command(asked, *arguments):
        done = called(lambda: main(asked), "softmodels", *arguments)
        return done.status, done.out, done.err

    return run_command


@pytest.fixture(scope="session")
def whole(tmp_path_factory):
    """A run to 177 cm in 36 steps that nothing disturbed: its folder, and what it said."""
    folder = tmp_path_factory.mktemp("whole") / "disk"
    return folder, disk(folder, "--pressure-cm", "0:177:5")


@pytest.fixture
def whole_copy(whole, tmp_path):
    """The undisturbed run's folder, to be changed."""
    return shutil.copytree(whole[0], tmp_path / "copy")


@pytest.fixture(scope="session")
def limited(tmp_path_factory):
    """A run past a limit point, which it cannot but meet: its folder, and what it said."""
    folder = tmp_path_factory.mktemp("limited") / "disk"
    return folder, disk(folder, *SOFT)


@pytest.fixture(scope="session")
def wedge(tmp_path_factory):
    return made_up(tmp_path_factory.mktemp("wedge"), HollowDisk(cell_size=0.006, refinement=1.0))


@pytest.fixture(scope="session")
def half_section(tmp_path_factory):
    return made_up(tmp_path_factory.mktemp("half"), HollowDisk(section="axisymmetric", cell_size=0.006, refinement=1.0))


@pytest.fixture(scope="session")
def half_slab(tmp_path_factory):
    slab = SeminarActuator(channels=2, spread=40.0, around=6.0, cell_size=0.008)
    return made_up(tmp_path_factory.mktemp("slab"), slab, "slab")


@pytest.fixture(scope="session")
def drawn(wedge, half_slab):
    """Return a function that gives a kind's folder, drawn by the program, and what it said."""
    if not can_render():
        pytest.skip("this machine cannot render")
    folders = {"wedge": wedge, "half_slab": half_slab}
    started = {kind: start_drawing(folder) for kind, folder in folders.items()}
    ended = {kind: finished(process) for kind, process in started.items()}
    return lambda kind: (folders[kind], ended[kind])
