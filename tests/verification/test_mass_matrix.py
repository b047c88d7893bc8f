"""The mass matrix without places for zeros, against the one with the pattern of its form."""

from __future__ import annotations

import pytest

import softmodels as sm
from softmodels.mechanics.assembly import assembled_matrix, sparse_matrix
from softmodels.mechanics.system import System


@pytest.mark.parametrize("formulation", ["mixed", "displacement"])
@pytest.mark.parametrize("device", [
    sm.HollowDisk(section="axisymmetric", cell_size=0.004),
    sm.HollowDisk(angle=15.0, cell_size=0.008, fillet=0.0, base_fillet=0.0),
], ids=["section", "wedge"])  # fmt: skip
def test_it_is_the_same_matrix_with_fewer_entries(device, formulation, body_of):
    import ufl
    from dolfinx import fem

    system = System(body_of(device), sm.NeoHookean(30e3, 0.49), formulation)
    space, body = system.space, system.body
    functions = ufl.TrialFunction(space), ufl.TestFunction(space)
    u, v = (ufl.split(f)[0] if system.mixed else f for f in functions)
    form = fem.form(ufl.inner(body.displacement(u), body.displacement(v)) * body.hoop * ufl.dx(body.mesh, degree=4))
    one, other = (make(form, system.bcs, 0.0) for make in (assembled_matrix, sparse_matrix))
    entries = [matrix.getInfo()["nz_used"] for matrix in (one, other)]
    assert entries[1] < 0.7 * entries[0]
    size = one.norm()
    one.axpy(-1.0, other)
    assert one.norm() < 1e-12 * size
