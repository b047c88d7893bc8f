"""Fixtures shared by all folders."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared_data():
    """Return a function that gives a folder of measured data beside the checkout, or skips where it is not there."""

    def folder_of(name):
        for folder in Path(__file__).resolve().parents:
            found = folder / "shared" / "data" / name
            if found.is_dir():
                return found
        return pytest.skip(f"no shared/data/{name} beside the project")

    return folder_of


@pytest.fixture(scope="session")
def comm():
    """The world communicator; the first to ask for it starts MPI, PETSc and DOLFINx in their order."""
    from softmodels.parallel import start

    return start()
