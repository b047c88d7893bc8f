"""Libraries that take long to load, each imported when it is first used.

DOLFINx, PETSc and MPI can be imported only once `softmodels.mechanics.mpi.start` has set them up, and a command that solves
nothing is quicker without them.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import basix.ufl
    import gmsh
    import matplotlib
    import pyvista
    import scipy
    import ufl
    import ufl.core.expr
    from dolfinx import common as common, cpp as cpp, fem as fem, la as la, mesh as meshes, plot as plot
    from matplotlib import cm as cm, colors as colors, figure as figures
    from mpi4py import MPI as MPI
    from petsc4py import PETSc as PETSc
    from rich import console as consoles, progress as progress
else:

    class _Library:
        """A module in whose place this stands until one of its names is looked up; those are kept."""

        def __init__(self, *modules: str):
            self._modules = modules

        def __getattr__(self, name: str) -> object:
            if name.startswith("__") and name not in ("__file__", "__version__"):  # Python itself looks for some
                raise AttributeError(name)
            module, *_ = map(importlib.import_module, self._modules)
            value = self.__dict__[name] = getattr(module, name)
            return value

    basix, scipy, ufl = _Library("basix", "basix.ufl"), _Library("scipy"), _Library("ufl")
    gmsh, pyvista = _Library("gmsh"), _Library("pyvista")
    common, cpp, fem, la, meshes, plot = (
        _Library(f"dolfinx.{name}") for name in ("common", "cpp", "fem", "la", "mesh", "plot")
    )
    matplotlib, consoles, progress = _Library("matplotlib"), _Library("rich.console"), _Library("rich.progress")
    cm, colors, figures = (_Library(f"matplotlib.{name}") for name in ("cm", "colors", "figure"))
    MPI, PETSc = _Library("mpi4py.MPI"), _Library("petsc4py.PETSc")


type Expr = ufl.core.expr.Expr
