"""PETSc's example ex77 (SNES tutorials, the block whose sides are held): by both linear solvers, and written out in UFL.

A unit cube of W = mu/2 tr C + p (J - 1) + kappa/2 (J - 1)^2 with mu = 1, kappa = 3 and J = 1 is pressed on one face by a
pressure of 1 that follows it; the four faces around that one are held, the one opposite is free. The second route shares
with the library its mesh and its function space and nothing else: the weak form as the example states it, on DOLFINx's own
`NonlinearProblem`.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from softmodels.materials.laws import Material, parameter
from softmodels.mechanics.controls import pressure_control
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from tests.support import bodies

MU, KAPPA = 1.0, 3.0
PRESSURES = (1.0, 2.0, 3.0, 4.0)
"""The example's own, and up to four times that: the block then moves by a quarter of its edge."""
EX77 = "PETSc's ex77 written out in UFL"


@dataclasses.dataclass(frozen=True)
class Augmented(Material):
    """The example's energy; -mu (J - 1) only moves p, so that p is zero at rest."""

    name = "ex77"
    isochoric = False
    shear_modulus: float = parameter("Pa", "shear modulus mu")
    poisson: float = parameter("", "Poisson's ratio", 0.5)

    @staticmethod
    def shape(strain, m):
        mu, J = m.shear_modulus, strain.J
        return mu / 2 * (strain.I1 - 3) - mu * (J - 1) + KAPPA / MU * mu / 2 * (J - 1) ** 2

    @property
    def shear_modulus_0(self):
        return self.shear_modulus


def by_path(block, method):
    """The equations, and the nodes' displacements at all pressures, shape (k, n, 3)."""
    from dolfinx import fem

    system = System(block, Augmented(MU))
    solver, state, W, found = Solver(system, method), system.rest(), fem.Function(system.space), []
    for pressure in PRESSURES:
        state = solver.solve(pressure_control(pressure), state.w, state.P)
        W.x.array[:] = state.w
        found.append(displacement(W) @ block.skew_inverse.T)
    return system, np.array(found)


def written_out(system, block):
    """The same from the example's own equations."""
    import ufl
    from dolfinx import fem
    from dolfinx.fem import petsc

    space = system.space
    W, test = fem.Function(space), ufl.TestFunction(space)
    (u, p), (v, q) = ufl.split(W), ufl.split(test)
    F = ufl.Identity(3) + ufl.grad(u)
    J, cofactor = ufl.det(F), ufl.cofac(F)
    wall = fem.Constant(block.mesh, 0.0)
    dx = ufl.dx(block.mesh, metadata={"quadrature_degree": 2})
    ds = ufl.ds(block.mesh, subdomain_data=block.cavity, metadata={"quadrature_degree": 4})(1)
    normal = ufl.dot(cofactor, ufl.FacetNormal(block.mesh))
    residual = (
        ufl.inner(MU * F + (p + KAPPA * (J - 1)) * cofactor, ufl.grad(v)) * dx
        + q * (J - 1) * dx
        + wall * ufl.dot(normal, v) * ds
    )
    flat, _ = space.sub(0).collapse()
    held = fem.locate_dofs_topological((space.sub(0), flat), *block.entities["sides"])
    problem = petsc.NonlinearProblem(
        residual, W, bcs=[fem.dirichletbc(fem.Function(flat), held, space.sub(0))], petsc_options_prefix="ex77",
        petsc_options={"snes_type": "newtonls", "snes_linesearch_type": "none", "snes_rtol": 1e-14, "snes_atol": 1e-13,
                       "snes_max_it": 30, "snes_error_if_not_converged": True, "ksp_type": "preonly", "pc_type": "lu",
                       "pc_factor_mat_solver_type": "mumps"},
    )  # fmt: skip
    W.sub(1).interpolate(lambda x: np.full(x.shape[1], -MU))
    found = []
    for pressure in PRESSURES:
        wall.value = pressure
        problem.solve()
        found.append(displacement(W))
    return np.array(found)


def displacement(W):
    return W.sub(0).collapse().x.array.reshape(-1, 3)


@pytest.mark.campaign
@pytest.mark.parametrize("method", ["direct", "iterative"])
@pytest.mark.parametrize("cells", [3, 5])
def test_both_solvers_give_the_examples_deformation(cells, method, body_of, figure):
    block = body_of(bodies.HeldBlock(cells=cells))
    system, found = by_path(block, method)
    expected = written_out(system, block)
    assert np.abs(expected[-1]).max() > 0.2
    apart = np.abs(found - expected).max(axis=(1, 2)) / np.abs(expected).max(axis=(1, 2))
    figure(EX77, f"displacement, {cells} cells along an edge, {method} solver", apart, 1e-8)
