"""Products with a solid's tangent, from second derivatives that are kept, against the assembled matrix."""

from __future__ import annotations

import numpy as np
import pytest

from geometries import HollowDisk, PneuNet
from softmodels.materials.laws import NeoHookean, Yeoh

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

    return lambda actuator, formulation, components=(): System(
        body_of(actuator), LAW, formulation, components=components
    )


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
