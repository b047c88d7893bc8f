"""Figures on any number of ranks, by program.

``mpirun -n 2 python -m tests.support.on_ranks FOLDER PROGRAM ...`` prints them as JSON. Each program is a module with
``figures(comm, folder)``; the meshes it reads lie in the folder.
"""

from __future__ import annotations

import importlib
from pathlib import Path

PROGRAMS = "figures", "creeping", "creeping_rates", "filling", "moving", "regions", "frequencies", "rigid", "touching"
"""Modules; ``rigid-iterative`` is ``rigid`` with the iterative solver, ``pieces-sphere;plane`` two of its cases."""


def found_by(program: str, comm, folder: Path):
    """What a program has found on this communicator."""
    name, _, method = program.partition("-")
    module = importlib.import_module(f"{__name__}.{name}")
    return module.figures(comm, folder, *filter(None, [method]))


def write_meshes(folder: Path) -> None:
    """Write the meshes of all programs, but for that of the imported part."""
    for name in PROGRAMS:
        for mesh, device in getattr(importlib.import_module(f"{__name__}.{name}"), "MESHES", {}).items():
            device.write(folder / f"{mesh}.msh")
