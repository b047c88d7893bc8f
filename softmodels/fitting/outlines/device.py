"""A case's device, ready to be solved with the parameters of a law."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Any

from geometries import GeometryError, MeshingError
from softmodels.case.case import Case
from softmodels.fitting.law_parameters import LawChoice
from softmodels.fitting.outlines.forward import Inflation
from softmodels.fitting.problem import FitError
from softmodels.mechanics.mpi import on_root


def device_of(case: Case, choice: LawChoice, comm: Any) -> Inflation:
    """The case's device under a law, meshed and compiled.

    Raises:
        FitError: It cannot be meshed or compiled.
    """
    from softmodels.mechanics.body import Body, BodyError
    from softmodels.mechanics.compiling import CompilingError, compiling
    from softmodels.mechanics.solver import Equilibrium

    folder = on_root(comm, lambda: Path(tempfile.mkdtemp(prefix="softmodels-")))
    mesh = folder / f"{case.name}.msh"
    try:
        on_root(comm, lambda: case.actuator.write(mesh))
        with compiling():
            body = Body.from_file(case.actuator, mesh, comm)
            material = choice.material(choice.from_modulus(30e3))
            return Inflation(Equilibrium(body, material, case.formulation, case.sheet, case.obstacle), choice)
    except (BodyError, CompilingError, MeshingError, GeometryError, OSError) as error:
        raise FitError(str(error)) from error
    finally:
        on_root(comm, lambda: shutil.rmtree(folder, ignore_errors=True))
