"""``softmodels doctor`` and ``app``: the installation checked by a small solve; the bench on a page."""

from __future__ import annotations

import importlib
import importlib.metadata
import os
import platform
import shlex
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import click
import numpy as np

from geometries import HollowDisk
from softmodels.case import materials
from softmodels.case.case import Case
from softmodels.cli import ending, options
from softmodels.common import commands, errors
from softmodels.common.lazy import MPI, PETSc
from softmodels.mechanics import compiling, mpi

PACKAGES = {
    "gmsh": "gmsh",
    "numpy": "numpy",
    "scipy": "scipy",
    "h5py": "h5py",
    "pyvista": "pyvista",
    "vtk": "vtk",
    "mpi4py": "mpi4py",
    "fenics-ufl": "ufl",
    "fenics-basix": "basix",
    "fenics-ffcx": "ffcx",
}


@options.command("doctor")
def doctor() -> None:
    """Check the installation, and solve a small case.

    Versions and what is missing (MPI, compiler) are listed.
    """
    checks: list[tuple[str, Callable[[], str]]] = [
        ("python", lambda: f"{platform.python_version()} on {platform.system()} {platform.machine()}"),
        *((name, lambda name=name, module=module: _version(name, module)) for name, module in PACKAGES.items()),  # type: ignore[misc]
        ("dolfinx", _dolfinx),
        ("petsc", _petsc),
        ("mpi", _mpi),
        ("mpirun", _mpirun),
        ("compiler", _compiler),
        ("cache", _cache),
        ("solve", _solve),
    ]
    failed = 0
    for name, check in checks:
        try:
            print(f"ok      {name:13s} {check()}", flush=True)
        except Exception as error:
            failed += 1
            print(f"FAILED  {name:13s} {error}", flush=True)
    print(
        "all checks passed"
        if not failed
        else f"{failed} of {len(checks)} checks failed; see the installation section of the README"
    )
    sys.exit(1 if failed else 0)


EXPECTED_MM = 1.305
"""Apex rise in mm of the default disk at 54.15 cm of water on a coarse section; the solve must come within 2 %."""


def _version(name: str, module: str) -> str:
    version = importlib.metadata.version(name)
    if module not in ("gmsh", "vtk", "pyvista", "h5py"):  # drawing and HDF5 are imported only where they are used
        importlib.import_module(module)
    return version


def _dolfinx() -> str:
    mpi.start()
    import dolfinx

    if not dolfinx.__version__.startswith("0.11"):
        raise RuntimeError(f"version {dolfinx.__version__}; softmodels is written for 0.11")
    return str(dolfinx.__version__)


def _petsc() -> str:
    mpi.start()  # without shared memory an import would end the process
    matrix = PETSc.Mat().createAIJ((1, 1), comm=PETSc.COMM_SELF)
    matrix.setUp()
    matrix.setValue(0, 0, 1.0)
    matrix.assemble()
    pc = PETSc.PC().create(PETSc.COMM_SELF)
    pc.setOperators(matrix)
    pc.setType("cholesky")
    pc.setFactorSolverType("mumps")
    pc.setUp()  # raises if PETSc was built without MUMPS
    return f"{'.'.join(map(str, PETSc.Sys.getVersion()))}, {np.dtype(PETSc.ScalarType)}, with MUMPS"


def _mpi() -> str:
    mpi.start()
    version = MPI.Get_library_version().splitlines()[0].strip().rstrip("\0")
    library = mpi.mpich_file("libmpi.so.12")
    return f"{version}, {library}" if library else version


def _mpirun() -> str:
    own = mpi.mpich_file("mpirun")
    return _program("mpirun", str(Path(sys.executable).with_name("mpirun")), *([str(own)] if own else []), "mpirun")


def _program(what: str, *names: str) -> str:
    program = next((path for name in names if (path := shutil.which(name))), None)
    if program is None:
        raise RuntimeError(f"{what} not found on the PATH")
    return program


def _compiler() -> str:
    import cffi  # type: ignore[import-untyped]

    try:
        words = compiling.compiler()
    except cffi.VerificationError as error:
        raise RuntimeError(
            f"no C compiler ({error}); the equations are compiled at run time, so install one (Debian: apt-get install gcc; "
            "uv sync --inexact --extra compiler)"
        ) from None
    return shutil.which(words[0]) or words[0] if len(words) == 1 else shlex.join(words)


def _cache() -> str:
    folder = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "fenics"
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        pass
    return f"{folder} ({len(list(folder.glob('*.so')))} compiled forms)"


def _solve() -> str:
    """Inflate the default disk's section to about a third of its working pressure."""
    from softmodels.runs import simulation
    from softmodels.runs.simulation import Model

    disk = HollowDisk(section="axisymmetric")
    body = simulation.meshed(disk, mpi.start())
    started = time.perf_counter()
    model = Model.of(Case("doctor", disk, materials.DEFAULT, simulation.SMALL_PRESSURE), body)
    prepared = time.perf_counter()
    rise = model.solve(pressure=5150.0).rises["apex"] * 1e3
    if abs(rise / EXPECTED_MM - 1) > 0.02:
        raise RuntimeError(f"the test disk rose by {rise:.4f} mm; expected {EXPECTED_MM} mm within 2 %")
    return (
        f"apex {rise:.4f} mm at 5.15 kPa; kernels ready in {prepared - started:.1f} s, "
        f"path in {time.perf_counter() - prepared:.2f} s"
    )


# ----------------------------------------------------------------------------------------------------------------------
# The command ``app``.


@options.command("app", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("project", type=click.Path(path_type=Path, file_okay=False), default=Path("project"))
@click.option("--port", type=click.IntRange(1, 65535), help="Port of the page.  [default: a free one from 8700]")
@click.option("--no-browser", is_flag=True, help="Only print the address.")
@click.option("--lan", is_flag=True, help="Let other machines of the network connect with the key, such as a phone's camera.")
def app(project: Path, port: int | None, no_browser: bool, lan: bool) -> None:
    """Open the bench as a page in the browser.

    The page has photographs, material, device and mould.

    Everything lies in the folder PROJECT (./project if not given) as plain files, which all other commands read. The page is
    served on this machine only, to those who hold the key in its address; it needs no network.
    """
    for package in ("nicegui", "segno"):
        errors.required(package, "app")
    from softmodels.app import server

    try:
        server.serve(project, port, browser=not no_browser, lan=lan)
    except OSError as error:
        where = f"port {port}" if port and not isinstance(error, FileNotFoundError | PermissionError) else str(project)
        ending.fail(f"{where} cannot be used ({errors.reason(error)}); give another one", commands.status_of(error))
