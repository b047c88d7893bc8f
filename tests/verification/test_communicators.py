"""Devices that were solved and dropped give back MPI's communicators: a process has about two thousand of them."""

from __future__ import annotations

import gc

import pytest
from mpi4py import MPI

from geometries import HollowDisk
from softmodels.materials.laws import Yeoh
from softmodels.mechanics.body import Body
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path.continuation import Continuation, trace
from softmodels.runs.fields import Fields
from tests.support.campaigns import sampled

DEVICES = 3


def _free():
    """How many communicators can still be made."""
    made = []
    try:
        while True:
            made.append(MPI.COMM_SELF.Dup())
    except MPI.Exception:
        free = len(made)
    for comm in made:
        comm.Free()
    return free


def _inflate(file, k, section):
    disk = HollowDisk(section=section, angle=15.0, cell_size=0.006, membrane=2e-3 + 1e-5 * k)
    disk.write(file)
    equilibrium = Solver(System(Body.from_file(disk, file, MPI.COMM_SELF), Yeoh(14e3, 60.0)))
    fields = Fields(equilibrium)
    return [fields.figures(point.state).pressure for point in trace(Continuation(equilibrium), [0.02])]


@pytest.mark.campaign
@pytest.mark.skipif("MPICH" not in MPI.Get_library_version(), reason="other MPI libraries have no such limit")
@pytest.mark.parametrize("section", sampled(["axisymmetric", "wedge"]))
def test_devices_that_are_merely_dropped_give_back_their_communicators(section, tmp_path):
    _inflate(tmp_path / "disk.msh", 0, section)  # what the first one keeps is kept once
    gc.collect()
    before = _free()
    for k in range(DEVICES):
        assert _inflate(tmp_path / "disk.msh", k, section)[-1] > 0
        gc.collect()
    assert _free() == before
