"""Products with a solid's tangent, from second derivatives that are kept, against the assembled matrix."""

from __future__ import annotations

import numpy as np
import pytest

import softmodels as sm
from geometries import HollowDisk, PneuNet
from softmodels.materials.laws import NeoHookean, Yeoh
from softmodels.mechanics.assembly import assembled_matrix, sparse_matrix
from softmodels.mechanics.system import System
from tests.support.campaigns import sampled

LAW, OTHER = Yeoh(50e3, 1e3, 50.0, 0.45), NeoHookean(400e3, 0.45)
WEDGE = HollowDisk(cell_size=0.006, fillet=0.0, angle=30.0, azimuth=20.0)
AS = "product from kept second derivatives"


def apart(system, seed):
    """Product with a random direction at a random state, less the assembled matrix', in shares of its largest entry."""
    generator = np.random.default_rng(seed)
    size = 0.02 * system.body.mesh.h(3, system.cells).min()
    free = np.ones(len(system.w.x.array))
    for bc in system.bcs:
        free[bc.dof_indices()[0]] = 0.0
    system.w.x.array[:] = size * generator.standard_normal(len(free)) * free
    system._set_pressures(0.3, np.empty(0))
    x, y = system.K.createVecRight(), system.K.createVecLeft()
    x.array_w[:] = (generator.standard_normal(len(free)) * free)[: system.n]
    product = np.empty(system.n)
    system.tangent_product(x.array_r, product)
    system.assemble_tangent()
    system.K.mult(x, y)
    return (product - y.array_r) / np.abs(product).max()


@pytest.fixture
def system_of(body_of):
    from softmodels.mechanics.system import System

    return lambda actuator, formulation, components=(): System(body_of(actuator), LAW, formulation, components=components)


@pytest.mark.parametrize("formulation", ["mixed", "displacement"])
def test_a_wedge_with_oblique_planes(formulation, system_of, figure):
    system = system_of(WEDGE, formulation)
    assert not system._products.by_forms
    for seed in (1, 2):  # of the second state, not what is kept of the first
        figure(f"{AS}, {formulation}", "assembled matrix, oblique wedge", apart(system, seed), 1e-12)


def test_two_materials(system_of, figure):
    from softmodels.case.materials import Region

    system = system_of(PneuNet(cell_size=0.004, chambers=2), "mixed", [Region(OTHER, name="base")])
    assert len(system._products.kept) == 3
    figure(f"{AS}, mixed", "assembled matrix, two materials", apart(system, 3), 1e-12)


def test_nodes_that_move(system_of, figure):
    """A design moves the mesh of a system that stands."""
    system = system_of(WEDGE, "mixed")
    apart(system, 4)
    nodes = system.body.mesh.geometry.x
    before = nodes.copy()
    try:
        nodes[:] *= [1.1, 1.0, 0.9]
        figure(f"{AS}, mixed", "assembled matrix, nodes moved", apart(system, 4), 1e-12)
    finally:
        nodes[:] = before


def test_a_section_has_forms(system_of):
    assert system_of(HollowDisk(section="axisymmetric", cell_size=0.006), "mixed")._products.by_forms


# -- The mass matrix without places for zeros, against the one with the pattern of its form --------------------------


@pytest.mark.parametrize("formulation", sampled(["mixed", "displacement"]))
@pytest.mark.parametrize("device", sampled([
    sm.HollowDisk(section="axisymmetric", cell_size=0.004),
    sm.HollowDisk(angle=15.0, cell_size=0.008, fillet=0.0, base_fillet=0.0),
]), ids=["section", "wedge"])  # fmt: skip
def test_it_is_the_same_matrix_with_fewer_entries(device, formulation, body_of):
    import ufl
    from dolfinx import fem

    system = System(body_of(device), sm.NeoHookean(30e3, 0.49), formulation)
    space, body = system.space, system.body
    functions = ufl.TrialFunction(space), ufl.TestFunction(space)
    u, v = (ufl.split(f)[0] if system.mixed else f for f in functions)
    form = fem.form(ufl.inner(body.displacement(u), body.displacement(v)) * body.hoop * ufl.dx(body.mesh, degree=4))
    one, other = (make(form, system.bcs) for make in (assembled_matrix, sparse_matrix))
    entries = [matrix.getInfo()["nz_used"] for matrix in (one, other)]
    assert entries[1] < 0.7 * entries[0]
    held = np.unique(np.concatenate([condition.dof_indices()[0] for condition in system.bcs]))
    one.zeroRows(held.astype(np.int32), diag=0.0)
    size = one.norm()
    one.axpy(-1.0, other)
    assert one.norm() < 1e-12 * size
