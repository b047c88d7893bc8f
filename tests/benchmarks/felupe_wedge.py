"""Inflate the hollow disk's wedge with FElupe (PARDISO through pypardiso), for comparison with softmodels.

    export OMP_NUM_THREADS=1 MKL_NUM_THREADS=1
    uv run --with felupe --with pypardiso python tests/benchmarks/felupe_wedge.py --mesh disk.msh --json felupe.json

See `wedge_case.py` for the mesh. The volume is integrated with four points per tetrahedron, FElupe's default. Newton's
method and two pieces that FElupe has no ready-made part for stand here:

- the pressure that follows the cavity's walls (FElupe has no boundary region for tetrahedra), and
- the second cut, held exactly: the unknowns of its nodes are the displacements along its normal and in the plane, and
  the former are left out. No penalty enters.

"iterations" counts every linear solve, also those of attempts that failed and were repeated with half the step.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import time
from pathlib import Path

import felupe as fem  # type: ignore[import-untyped]
import numpy as np
import wedge_case
from numpy.typing import NDArray
from scipy import sparse

# pypardiso looks for MKL in the interpreter's own folder; `uv run --with` has put it beside the package.
beside = importlib.util.find_spec("pypardiso")
if beside is not None and beside.origin is not None:
    for library in Path(beside.origin).parents[3].glob("libmkl_rt*"):
        os.environ.setdefault("PYPARDISO_MKL_RT", str(library))
from pypardiso import spsolve  # type: ignore[import-untyped]  # noqa: E402

TOLERANCE = 1e-8
"""A step has converged when the residual is this small against the reactions, which is also FElupe's criterion."""

MOST_ITERATIONS = 20
SMALLEST_STEP = 1e-3
"""Step, as a part of the first attempt, below which the solve is given up."""


class FollowerPressure:
    """Force of a unit pressure on the deformed cavity, and its derivative, on six-node triangles."""

    # Six points integrate degree four, which is the degree of a shape function times the deformed normal.
    NEAR, FAR = (0.091576213509771, 0.445948490915965)
    WEIGHTS = np.repeat([0.109951743655322 / 2, 0.223381589678011 / 2], 3)

    def __init__(self, faces: NDArray[np.int64], unknowns: int) -> None:
        self.faces, self.unknowns = faces, unknowns
        r, s = np.array([p for a in (self.NEAR, self.FAR) for p in ((a, a), (1 - 2 * a, a), (a, 1 - 2 * a))]).T
        t, zero = 1 - r - s, np.zeros_like(r)
        self.shape = np.array([t * (2 * t - 1), r * (2 * r - 1), s * (2 * s - 1), 4 * t * r, 4 * r * s, 4 * s * t])
        self.by_r = np.array([1 - 4 * t, 4 * r - 1, zero, 4 * (t - r), 4 * s, -4 * s])
        self.by_s = np.array([1 - 4 * t, zero, 4 * s - 1, -4 * r, 4 * r, 4 * (t - s)])
        entries = (3 * faces[:, :, None] + np.arange(3)).reshape(len(faces), 18)
        self.entries = entries
        self.rows = np.repeat(entries, 18, axis=1).ravel()
        self.columns = np.tile(entries, 18).ravel()

    def force(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Integral of shape function times normal; the pressure pushes the solid the other way."""
        x = positions[self.faces]
        normal = np.cross(np.einsum("aq,fai->fqi", self.by_r, x), np.einsum("aq,fai->fqi", self.by_s, x))
        values = np.einsum("q,aq,fqi->fai", self.WEIGHTS, self.shape, normal)
        return np.bincount(self.entries.ravel(), values.ravel(), minlength=self.unknowns)

    def tangent(self, positions: NDArray[np.float64]) -> sparse.csr_matrix:
        """Derivative of `force` with respect to the positions."""
        x = positions[self.faces]
        along_r, along_s = (np.einsum("aq,fai->fqi", d, x) for d in (self.by_r, self.by_s))
        # The normal is along_r x along_s; a node's movement d changes it by d x along_s and along_r x d.
        turn_r, turn_s = (np.cross(v[..., None, :], np.eye(3)).swapaxes(-1, -2) for v in (along_r, along_s))
        weighted = self.WEIGHTS * self.shape
        values = np.einsum("aq,bq,fqij->faibj", weighted, self.by_s, turn_r, optimize=True)
        values -= np.einsum("aq,bq,fqij->faibj", weighted, self.by_r, turn_s, optimize=True)
        shape = (self.unknowns, self.unknowns)
        return sparse.coo_matrix((values.ravel(), (self.rows, self.columns)), shape=shape).tocsr()


class Model:
    """FElupe's solid with the wedge's pressure and supports."""

    def __init__(self, wedge: wedge_case.Wedge, args: argparse.Namespace) -> None:
        region = fem.RegionQuadraticTetra(fem.Mesh(wedge.points, wedge.cells, "tetra10"))
        mixed = args.form == "mixed"
        self.field = fem.FieldsMixed(region, n=3) if mixed else fem.FieldContainer([fem.Field(region, dim=3)])
        # Without its own volume term each of the two is what is left of the energy beside bulk/2 (J - 1)^2.
        coupled = args.energy == "coupled"
        shear = fem.NeoHookeCompressible(mu=args.shear_modulus) if coupled else fem.NeoHooke(mu=args.shear_modulus)
        bulk = args.lame if coupled else args.bulk
        material = fem.NearlyIncompressible(shear, bulk=bulk) if mixed else shear & fem.Volumetric(bulk=bulk)
        self.solid = fem.SolidBody(material, self.field)
        self.sizes = [field.values.size for field in self.field.fields]
        self.unknowns, self.points = sum(self.sizes), wedge.points
        self.load = FollowerPressure(wedge.cavity, self.unknowns)
        self.turn = self._turn(wedge)
        held = np.zeros(self.unknowns, dtype=bool)
        held[3 * wedge.held["plane0"] + 1] = True
        held[3 * wedge.held["plane1"]] = True
        # On the axis the two cuts together leave z only.
        held[3 * wedge.axis] = held[3 * wedge.axis + 1] = True
        for component in range(3) if args.support == "glued" else [2]:
            held[3 * wedge.held["support"] + component] = True
        self.held, self.free = np.flatnonzero(held), np.flatnonzero(~held)
        self.iterations = 0

    def _turn(self, wedge: wedge_case.Wedge) -> sparse.csr_matrix:
        """Matrix from the unknowns to FElupe's: x and y of the second cut's nodes stand for normal and in-plane."""
        x = 3 * wedge.held["plane1"]
        along, normal = np.ones(self.unknowns), wedge.normal
        along[x], along[x + 1] = normal[0], -normal[0]
        across = np.full(x.size, normal[1])
        # Normal and in-plane direction are the columns, (n0, n1) and (n1, -n0).
        rows, columns = np.concatenate([x, x + 1]), np.concatenate([x + 1, x])
        mixing = sparse.coo_matrix((np.tile(across, 2), (rows, columns)), shape=(self.unknowns, self.unknowns))
        return (sparse.diags(along) + mixing).tocsr()

    def state(self) -> list[NDArray[np.float64]]:
        """Copy the values of all fields."""
        return [field.values.copy() for field in self.field.fields]

    def set_state(self, state: list[NDArray[np.float64]]) -> None:
        """Go back to a copy made by `state`."""
        for field, values in zip(self.field.fields, state, strict=True):
            field.values[:] = values

    def solve(self, pressure: float) -> bool:
        """Newton's method at one pressure, from the present state; False when it diverges."""
        for iteration in range(MOST_ITERATIONS + 1):
            positions = self.points + self.field[0].values
            with np.errstate(all="ignore"):
                residual = self.solid.assemble.vector(self.field).toarray().ravel()
            residual = self.turn.T @ (residual + pressure * self.load.force(positions))
            # Not every energy gives NaN where a cell is turned inside out, so the volumes are looked at themselves.
            if not np.isfinite(residual).all() or fem.math.det(self.solid.results.kinematics[0]).min() <= 0:
                return False
            if np.linalg.norm(residual[self.free]) <= TOLERANCE * np.linalg.norm(residual[self.held]):
                return True
            if iteration == MOST_ITERATIONS:
                return False
            stiffness = self.solid.assemble.matrix() + pressure * self.load.tangent(positions)
            stiffness = (self.turn.T @ stiffness @ self.turn).tocsr()[self.free][:, self.free]
            change = np.zeros(self.unknowns)
            change[self.free] = -spsolve(stiffness, residual[self.free])
            self.iterations += 1
            parts = np.split(self.turn @ change, np.cumsum(self.sizes)[:-1])
            for field, part in zip(self.field.fields, parts, strict=True):
                field.values += part.reshape(field.values.shape)
        return False

    def reach(self, start: float, pressure: float) -> bool:
        """Go from one pressure to the next, with smaller steps where the whole one fails."""
        step, done = 1.0, 0.0
        while done < 1.0:
            before, trial = self.state(), min(1.0, done + step)
            if self.solve(start + trial * (pressure - start)):
                done = trial
                continue
            self.set_state(before)
            step = (trial - done) / 2
            if step < SMALLEST_STEP:
                return False
        return True


def main() -> None:
    """Solve at all pressures and report."""
    parser = wedge_case.parser(__doc__ or "")
    parser.add_argument("--energy", choices=("coupled", "isochoric"), default="coupled")
    parser.add_argument("--form", choices=("displacement", "mixed"), default="displacement", help="mixed: u, p, J")
    args = wedge_case.read_arguments(parser)
    wedge = wedge_case.read_wedge(args.mesh)

    started = time.perf_counter()
    model = Model(wedge, args)
    rows, reached = [], 0.0
    for height, pressure in zip(args.pressures_cm, args.pascals, strict=True):
        if not model.reach(reached, pressure):
            break
        reached = pressure
        apex, ceiling = (1e3 * float(model.field[0].values[node, 2]) for node in (wedge.apex, wedge.ceiling))
        rows.append({"pressure_cm": height, "apex_mm": apex, "ceiling_mm": ceiling})
    wedge_case.report(
        {
            "tool": "FElupe",
            "version": fem.__version__,
            "options": {"energy": args.energy, "form": args.form, "support": args.support, "plane1": "exact"},
            "dofs": model.unknowns,
            "equations": int(model.free.size),
            "seconds": time.perf_counter() - started,
            "iterations": model.iterations,
            "results": rows,
        },
        args.json,
    )


if __name__ == "__main__":
    main()
