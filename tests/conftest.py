"""Fixtures shared by all folders."""

from __future__ import annotations

import pytest


@pytest.fixture(scope="session")
def comm():
    """The world communicator; the first to ask for it starts MPI, PETSc and DOLFINx in their order."""
    from softmodels.parallel import start

    return start()
