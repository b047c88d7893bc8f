"""What a command does before it solves: how ranks wait for each other."""

from __future__ import annotations

import os

import pytest

from softmodels.mechanics import mpi

LOOKS = "MPIR_CVAR_CH4_PROGRESS_THROTTLE_NO_PROGRESS_COUNT"


@pytest.fixture
def looks(monkeypatch):
    """Return a function that gives how often a waiting rank of some looks for messages, on some cores."""

    def found(ranks, cores, before=None):
        monkeypatch.setattr(mpi, "cores", lambda: cores)
        for name, value in (("MPI_LOCALNRANKS", ranks), (LOOKS, before)):
            if value is None:
                monkeypatch.delenv(name, raising=False)
            else:
                monkeypatch.setenv(name, value)
        mpi.start()
        return int(os.environ[LOOKS])

    monkeypatch.setenv(LOOKS, "64")  # put back after the test
    return found


@pytest.mark.parametrize(
    ("ranks", "cores", "wanted"),
    [("2", 2, 16384), ("2", 8, 16384), ("3", 2, 64), ("2", 1, 64), (None, 8, 64), ("two", 8, 64)],
)
def test_ranks_with_a_core_each_look_often_for_messages(looks, ranks, cores, wanted):
    """Another launcher than MPICH's does not tell how many there are on this machine."""
    assert looks(ranks, cores) == wanted


def test_a_users_own_choice_of_how_ranks_wait_stands(looks):
    assert looks("2", 8, before="7") == 7
