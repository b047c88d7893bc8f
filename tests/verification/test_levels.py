"""The levels of displacements' multigrid against the assembled matrix, and against DOLFINx' interpolation between them."""

from __future__ import annotations

import numpy as np
import pytest

from geometries import HollowDisk, PneuNet
from softmodels.case.materials import Region
from softmodels.materials.laws import NeoHookean
from softmodels.mechanics.iterative import corners_of
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System

LAW = NeoHookean(30e3, 0.45)
DEVICES = {
    "skew wedge": HollowDisk(cell_size=0.008, fillet=0.0, angle=30.0, azimuth=20.0),
    "finger of two regions": PneuNet(chambers=2, cell_size=0.006),
    "section": HollowDisk.variant("shadow", section="axisymmetric", cell_size=0.006),
}
MATRIX, OTHER = "the assembled matrix", "interpolation by DOLFINx"


MOST = 70
"""Iterations of GMRES to 1e-8."""


@pytest.fixture(params=[(name, "mixed") for name in DEVICES] + [("skew wedge", "displacement")], ids="-".join)
def set_up(request, body_of):
    """Return a solver with its levels of a random state near rest, ones at free dofs, and a generator of random numbers."""
    name, formulation = request.param
    components = [Region(NeoHookean(400e3, 0.45), name="base")] if "regions" in name else []
    system = System(body_of(DEVICES[name]), LAW, formulation, components=components)
    solver, generator = Solver(system, "iterative"), np.random.default_rng(0)
    free = np.ones(system.n)
    free[np.concatenate([bc.dof_indices()[0] for bc in system.bcs])] = 0.0
    rest = system.rest()
    solver.factorise(rest)
    system.w.x.array[:] = 1e-3 * generator.standard_normal(system.n) * free
    system._set_pressures(0.1, np.empty(0))
    system.assemble_tangent()
    solver.bordered.factorise()  # the levels that were made at rest take this state's matrix
    return solver, free, generator


def test_products_of_the_quadratic_level(set_up, figure):
    solver, _, generator = set_up
    system, inverse = solver.system, solver.bordered.inverse
    quadratic, _ = inverse._levels
    u, x, y = inverse._u, system.K.createVecRight(), system.K.createVecLeft()
    moved, b = generator.standard_normal(len(u)), generator.standard_normal(len(u))
    x.array_w[u] = moved
    system.K.mult(x, y)
    quadratic.x[:] = moved
    found, known = quadratic.residual(b), b - y.array_r[u]
    figure(MATRIX, "residual of a level in single precision", (found - known) / np.abs(known).max(), 1e-7)


def test_the_linear_level_is_the_quadratic_one_on_linear_displacements(set_up, figure):
    from dolfinx import fem
    from scipy.spatial import cKDTree

    solver, free, generator = set_up
    system, inverse = solver.system, solver.bordered.inverse
    _, linear = inverse._levels
    nodes, d = inverse._nodes, system.body.mesh.geometry.dim
    corners = fem.Function(fem.functionspace(nodes.mesh, ("Lagrange", 1, (d,))))
    places = corners.function_space.tabulate_dof_coordinates()
    own, _ = corners_of(nodes)
    _, at = cKDTree(places).query(inverse._places[own])
    held = free[inverse._u].reshape(-1, d)[own] == 0
    values = np.where(held, 0.0, generator.standard_normal(held.shape))
    corners.x.array.reshape(-1, d)[at] = values
    between = fem.Function(nodes)
    between.interpolate(corners)
    x, y = system.K.createVecRight(), system.K.createVecLeft()
    x.array_w[inverse._u] = between.x.array * free[inverse._u]
    system.K.mult(x, y)
    b, c = linear._matrix.createVecRight(), linear._matrix.createVecLeft()
    b.array_w[:] = values.ravel()
    linear._matrix.mult(b, c)
    figure(OTHER, "energy of linear displacements by the linear level", b.dot(c) / x.dot(y) - 1, 1e-11)


def test_a_cycle_is_linear_and_near_the_inverse(set_up, figure):
    """GMRES needs the first to the last digits, and few iterations the second."""
    solver, free, generator = set_up
    system, inverse = solver.system, solver.bordered.inverse
    one, other, both, x, y, z = (system.K.createVecRight() for _ in range(6))
    for vector in (one, other):
        vector.array_w[:] = generator.standard_normal(system.n) * free
    both.array_w[:] = 3.0 * one.array_r - 1e4 * other.array_r
    for b, into in ((one, x), (other, y), (both, z)):
        inverse.apply(b, into)
    apart = z.array_r - (3.0 * x.array_r - 1e4 * y.array_r)
    figure("theory", "a cycle of a sum less the cycles' sum", apart / np.abs(z.array_r).max(), 1e-11)
    solver.kept.set_columns()
    assert solver.bordered.iterate(one, x, 1e-8) <= MOST
