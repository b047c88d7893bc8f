"""Programs on several ranks."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

TOP = Path(__file__).parents[2]
PATIENT = {"MPIR_CVAR_CH4_PROGRESS_THROTTLE": "1", "MPIR_CVAR_CH4_PROGRESS_THROTTLE_NO_PROGRESS_COUNT": "4"}
"""Ranks of MPICH wait by spinning: with more of them than cores they keep each other from work, unless told to sleep."""


def mpirun() -> str:
    """The launcher beside this Python or on the path; skips the test without one."""
    beside = Path(sys.executable).with_name("mpirun")
    launcher = str(beside) if beside.exists() else shutil.which("mpirun")
    if launcher is None:
        pytest.skip("no mpirun beside this Python or on the path")
    return launcher


def figures_on(ranks: int, folder: Path, *programs: str, timeout: float = 3600.0):
    """What programs of `tests.support.on_ranks` find on so many ranks, in so many seconds."""
    command = [mpirun(), "-n", str(ranks), sys.executable, "-m", "tests.support.on_ranks", str(folder), *programs]
    environment = {**os.environ, **PATIENT, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(TOP)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=timeout, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.strip().splitlines()[-1])
    assert found.pop("ranks") == ranks
    return found
