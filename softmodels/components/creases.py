"""Folds and creases of a compressed surface, within a few cells of the mesh or a single facet, which no contact can see."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.common.lazy import fem, meshes, ufl
from softmodels.mechanics import compiling, component, mpi
from softmodels.mechanics.system import System

CREASE_LIMIT = 0.647**2
"""Product of a surface's smaller stretch squared and its larger one below which neo-Hookean silicone folds into itself (Hong,
Zhao and Suo 2009, doi 10.1063/1.3211917)."""
MAX_FOLD_CELLS = (6.0, 0.1)
"""Maximum number and fraction of cells in a motion that counts as a mesh fold."""
CLOSED_FOLD_ANGLE = math.radians(150.0)
"""Angle by which a facet turns from one end to the other where it is folded onto itself; a quadratic one turns by 180 degrees
at most, and one beside a held edge by 130 without a crease."""
CORNER_SHARE = 0.9
"""Where on its way from the middle of a facet to a corner its turn is taken: on the axis itself a hoop is 0 / 0, and in a sharp
corner that is blown up a cell's own corner may turn over."""
MIN_CELL_SHARE = 1e-3
"""Share of the largest part that a cell has of a motion, above which it takes part."""


class MotionConcentration:
    """Effective number of cells in a motion (local dofs), by its squared gradient: a fold moves the rest only rigidly. w is
    overwritten.

    ``cells`` is (sum e)^2 / sum e^2 of the cells' integrals e: 1 where one has all of it, all of them where all have as much.
    """

    def __init__(self, system: System, shape: Array):
        self.system, body = system, system.body
        system.w.x.array[:] = shape[: system.dofs]
        test = ufl.TestFunction(fem.functionspace(body.mesh, ("DG", 0)))
        slope = body.deformation_gradient(system.potential.displacement) - ufl.Identity(3)
        form = system.form(ufl.inner(slope, slope) * test * body.hoop * body.measures()[0])
        self._shares = fem.assemble_vector(form).array[: len(system.cells)]
        whole, squares = (mpi.total(system.comm, float((self._shares**k).sum())) for k in (1, 2))
        self.cells = whole**2 / squares if squares else math.inf

    @property
    def local(self) -> bool:
        """Whether the motion is local: in a few of many cells."""
        return self.cells <= min(
            MAX_FOLD_CELLS[0], MAX_FOLD_CELLS[1] * mpi.total(self.system.comm, float(len(self.system.cells)))
        )

    @property
    def part(self) -> npt.NDArray[np.bool_]:
        """Which cells take part, shape (cells,)."""
        return np.asarray(self._shares > MIN_CELL_SHARE * mpi.largest(self.system.comm, float(self._shares.max(initial=0.0))))

    @property
    def place(self) -> tuple[str, str]:
        """The place of the cell with the largest part."""
        mine = int(self._shares.argmax()) if len(self._shares) else 0
        return cell_place(self.system, mine, float(self._shares[mine]) if len(self._shares) else -math.inf)


def find_crease(system: System, cells: npt.NDArray[np.bool_] | None = None) -> component.PathFailure | None:
    """Return the end of a path where a surface of some cells, a mask of shape (cells,), is compressed until it creases in the
    loaded state, at the most compressed one; None if none is. Without a mask it is that of the cells on whose surface a crease
    has closed already, within one facet, which no contact can see."""
    body, topology, d = system.body, system.body.mesh.topology, system.body.mesh.topology.dim
    F, N = body.deformation_gradient(system.potential.displacement), body.normal
    area = ufl.dot(ufl.cofac(F), N)
    both, product = ufl.inner(F, F) - ufl.inner(F * N, F * N), ufl.inner(area, area)
    smaller = ufl.sqrt((both - ufl.sqrt(ufl.max_value(both**2 - 4 * product, 0.0))) / 2)
    values = ufl.as_vector([smaller, ufl.sqrt(product) / smaller, *(area[k] / ufl.sqrt(product) for k in range(3))])
    middle = np.full(d - 1, 1 / d)
    places = np.vstack([middle, middle + CORNER_SHARE * (np.vstack([np.zeros(d - 1), np.eye(d - 1)]) - middle)])
    topology.create_connectivity(d, d - 1)
    exterior = fem.IntegralType.exterior_facet
    pairs = fem.compute_integration_domains(exterior, topology, body.outer_facets).reshape(-1, 2)
    at = fem.Expression(values, places, jit_options=compiling.JIT).eval(body.mesh, pairs).reshape(len(pairs), len(places), 5)
    smaller, larger, normals = at[:, 0, 0], at[:, 0, 1], at[..., 2:]
    if cells is not None:
        of = cells[pairs[:, 0]]
    else:
        of = np.einsum("fpi,fqi->fpq", normals, normals).min(axis=(1, 2), initial=1.0) < math.cos(CLOSED_FOLD_ANGLE)
    candidates = zip(smaller[of].tolist(), larger[of].tolist(), pairs[of, 0].tolist(), strict=True)
    mine = min(((a**2 * b, a, b, cell) for a, b, cell in candidates), default=(math.inf, 1.0, 1.0, 0))
    product, stretch, other, _ = min(system.comm.allgather(mine))
    if product >= CREASE_LIMIT:
        return None
    return crease_failure(
        stretch, math.sqrt(CREASE_LIMIT / other), *cell_place(system, mine[-1], -mine[0]), closed=cells is None
    )


def fold_failure(cells: float, place: str, at: str) -> component.PathFailure:
    """Return the end of a path at which only a few cells fold, around an undeformed place with its unit; ``at`` is a clause
    that begins with a comma on what it is at, empty inside."""
    few = "one cell" if cells < 1.5 else f"{cells:.0f} cells"
    return component.PathFailure(
        f"{few} of the mesh would fold at {place} of the undeformed device{at}, and the requested quantity turns "
        f"back there: a mesh fold at a sharp edge, not a limit of the device",
        "Round that edge (--fillet, --rounding or --clamp-rounding, as the device has it), add contact to the faces "
        "beside it, or use larger cells there (--cell-size, fewer cells --through); the states up to here are not "
        "affected",
        snaps=True,
        of_mesh=True,
    )


def crease_failure(stretch: float, least: float, place: str, at: str, closed: bool) -> component.PathFailure:
    """Return the end of a path at which the surface creases, or at which it has done so and the crease is ``closed``; the rest
    is as for `fold_failure`."""
    what, first = ("is folded onto itself", "Round") if closed else ("creases", "Stay below, or round")
    return component.PathFailure(
        f"the silicone's surface {what} at {place} of the undeformed device{at}: it is compressed to a stretch of "
        f"{stretch:.2f}, and creases from about {least:.2f} on",
        f"{first} that edge more (--fillet, --rounding or --clamp-rounding, as the device has it), so that its surface is "
        "compressed less; smaller cells there (--cell-size) resolve the fold",
        snaps=True,
    )


def cell_place(system: System, cell: int, amount: float) -> tuple[str, str]:
    """Return the undeformed centre in mm of a cell, and its faces: of the rank with the largest amount, the same on all."""
    body, comm, texts = system.body, system.comm, ("", "")
    topology, d = body.mesh.topology, body.mesh.topology.dim
    topology.create_connectivity(d - 1, 0)
    if amount == mpi.largest(comm, amount):
        middle = meshes.compute_midpoints(body.mesh, d, np.array([cell], dtype=np.int32)) * system.length_unit
        place = ", ".join(f"{x:.4g}" for x in body.actuator.device_points(middle)[0] * 1e3)
        links, corners = topology.connectivity(d - 1, 0).links, set(topology.connectivity(d, 0).links(cell).tolist())
        faces = [
            role
            for role in body.faces
            if any(not corners.isdisjoint(links(facet).tolist()) for facet in body.entities[role][1])
        ]
        texts = (f"({place}) mm", f", where it is at {' and '.join(faces)}" if faces else "")
    return next(pair for pair in comm.allgather(texts) if pair[0])
