"""Runs that several files of tests look at: of the command line, and made-up ones to draw."""

from __future__ import annotations

import shutil
import subprocess
from types import SimpleNamespace

import pytest

from geometries import HollowDisk, SeminarActuator
from softmodels.cli.ending import main
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
def made_run(made_once):
    """Return a function that gives the folder of a run of the disk with these words, and what it said."""

    def run(name, *words):
        folder, said = made_once(name, lambda folder: vars(disk(folder / "disk", *words)))
        return folder / "disk", SimpleNamespace(**said)

    return run


@pytest.fixture(scope="session")
def whole(made_run):
    """A run to 177 cm in 36 steps that nothing disturbed: its folder, and what it said."""
    return made_run("whole", "--pressure-cm", "0:177:5")


@pytest.fixture
def whole_copy(whole, tmp_path):
    """The undisturbed run's folder, to be changed."""
    return shutil.copytree(whole[0], tmp_path / "copy")


@pytest.fixture(scope="session")
def limited(made_run):
    """A run past a limit point, which it cannot but meet: its folder, and what it said."""
    return made_run("limited", *SOFT)


WEDGE = HollowDisk(cell_size=0.006, refinement=1.0)
SLAB = SeminarActuator(channels=2, spread=40.0, around=6.0, cell_size=0.008)


@pytest.fixture(scope="session")
def wedge(tmp_path_factory):
    return made_up(tmp_path_factory.mktemp("wedge"), WEDGE)


@pytest.fixture(scope="session")
def half_section(tmp_path_factory):
    return made_up(tmp_path_factory.mktemp("half"), HollowDisk(section="axisymmetric", cell_size=0.006, refinement=1.0))


@pytest.fixture(scope="session")
def half_slab(tmp_path_factory):
    return made_up(tmp_path_factory.mktemp("slab"), SLAB, "slab")


@pytest.fixture(scope="session")
def drawn(made_once):
    """Return a function that gives a kind's folder, drawn by the program, and what it said."""
    if not can_render():
        pytest.skip("this machine cannot render")

    def draw(folder):
        started = {}
        for kind, device, name, more in (("wedge", WEDGE, "disk", ["--film"]), ("half_slab", SLAB, "slab", [])):
            (folder / kind).mkdir()
            started[kind] = start_drawing(made_up(folder / kind, device, name), *more)
        ended = {kind: finished(process) for kind, process in started.items()}
        return {kind: (done.returncode, done.stdout, done.stderr) for kind, done in ended.items()}

    folder, ended = made_once("drawn", draw)
    return lambda kind: (folder / kind, subprocess.CompletedProcess((), *ended[kind]))
