"""The discrete equations themselves, at random deformations: load, tangent, derivatives, homogeneous states."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from geometries import HollowDisk
from softmodels.materials.laws import Gent, HomogeneousStrain, MooneyRivlin, NeoHookean, Ogden, Yeoh
from tests.support import bodies

TAYLOR = "Taylor's remainder of the potential, every law, 3-D and axisymmetric"
LAWS = {
    "neo-hookean": NeoHookean(100e3, 0.45),
    "mooney-rivlin": MooneyRivlin(35e3, 15e3, 0.45),
    "yeoh": Yeoh(50e3, 1e3, 50.0, 0.45),
    "ogden": Ogden((0.63e6, 1.2e3, -10e3), (1.3, 5.0, -2.0), 0.45),
    "gent": Gent(100e3, 30.0, 0.45),
}
SECTIONS = ("solid", "axisymmetric")

laws = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
sections = pytest.mark.parametrize("section", SECTIONS)


@pytest.fixture
def shell():
    """A coarse spherical shell as an octant or as a half section."""
    return {"solid": bodies.Octant(cell_size=0.006), "axisymmetric": bodies.Sphere(through=2, along=6)}


def shaken(equations, P=0.3, seed=7):
    """Put the equations into a random state that respects the supports; returns a random direction of the same kind."""
    generator = np.random.default_rng(seed)
    mesh = equations.system.body.mesh
    size = 0.02 * mesh.h(mesh.topology.dim, equations.system.cells).min()  # strains of some 0.2, no cell inside out
    free = np.ones(len(equations.system.w.x.array))
    for bc in equations.system.bcs:
        free[bc.dof_indices()[0]] = 0.0
    equations.system.w.x.array[:] = size * generator.standard_normal(len(free)) * free
    equations.system.potential.P.value = P
    assert equations.system.smallest_J() > 0.2
    return size * generator.standard_normal(len(free)) * free


def force(equations):
    """Residual of the current state: inner forces less the cavity pressure's."""
    inner = equations.system.internal_forces().copy()
    return inner - float(equations.system.potential.P.value) * equations.system.pressure_loads()[0]


def own_assembly(equations, form):
    """A linear form on the equations' space, zero at held dofs."""
    from dolfinx import fem

    return equations.system.assemble([fem.form(form)]).copy()


def traction(equations):
    """The form of the load of a unit pressure: - int cof(F) N . v dS."""
    import ufl

    body, test = equations.system.body, ufl.TestFunction(equations.system.space)
    v = body.displacement(ufl.split(test)[0] if equations.system.mixed else test)
    N = ufl.FacetNormal(body.mesh)
    if body.axisymmetric:
        v, N = ufl.as_vector([v[0], 0, v[1]]), ufl.as_vector([N[0], 0, N[1]])
    F = body.deformation_gradient(ufl.split(equations.system.w)[0] if equations.system.mixed else equations.system.w)
    return -ufl.dot(ufl.dot(ufl.cofac(F), N), v) * body.hoop * body.measures()[1]


DEVICES = {
    "octant": lambda: bodies.Octant(cell_size=0.006),
    "half section": lambda: bodies.Sphere(through=2, along=6),
    "wedge 45": lambda: HollowDisk(cell_size=0.006, fillet=0.0),
    "wedge 30": lambda: HollowDisk(cell_size=0.006, fillet=0.0, angle=30.0, azimuth=20.0),
    "disk section": lambda: HollowDisk(section="axisymmetric", cell_size=0.006),
}


@pytest.mark.parametrize("device", DEVICES.values(), ids=DEVICES.keys())
def test_load_is_the_pressure_on_the_deformed_wall(device, equilibrium, figure):
    """dV[v] of the volume's closed surface integral is the integral of v . n over the wall alone, whatever the state."""
    equations = equilibrium(device(), LAWS["neo-hookean"])
    shaken(equations)
    load = equations.system.pressure_loads()[0].copy()
    apart = (load - own_assembly(equations, traction(equations))) / np.abs(load).max()
    figure("derivative of the cavity's volume", "pressure on the deformed wall", apart, 1e-12)
    assert np.abs(load).max() > 1e-3


@pytest.mark.parametrize("device", DEVICES.values(), ids=DEVICES.keys())
def test_volume_of_the_undeformed_cavity(device, equilibrium):
    equations = equilibrium(device(), LAWS["neo-hookean"])
    actuator = equations.system.body.actuator
    rest = equations.system.rest().V * equations.system.volume_unit
    assert rest == pytest.approx(actuator.cavity_volume, rel=3e-3 if equations.system.body.actuator.dimension == 3 else 1e-4)


@laws
@sections
def test_tangent_is_symmetric_and_the_product_is_the_matrix(law, section, shell, equilibrium, figure):
    from scipy.sparse import csr_matrix

    equations = equilibrium(shell[section], law)
    direction = shaken(equations)[: equations.system.n]
    equations.system.assemble_tangent()
    rows, columns, values = equations.system.K.getValuesCSR()
    K = csr_matrix((values, columns, rows))
    figure("tangent, every law", "its transpose", abs(K - K.T).max() / abs(K).max(), 1e-12)
    product = np.empty(equations.system.n)
    equations.system.tangent_product(direction, product)
    figure("tangent, every law", "product without a matrix", (product - K @ direction) / np.abs(product).max(), 1e-12)


@pytest.mark.quick
@laws
@sections
def test_derivatives_follow_the_potential(law, section, shell, equilibrium, figure):
    """Taylor: Pi(w + e d) less its first two terms falls as e^2, less three as e^3."""
    equations = equilibrium(shell[section], law)
    direction = shaken(equations)

    def potential():
        return equations.system.stored_energy() - float(equations.system.potential.P.value) * equations.system.volume()

    w, Pi = equations.system.w.x.array.copy(), potential()
    product = np.empty(equations.system.n)
    equations.system.tangent_product(direction[: equations.system.n], product)
    first, second = force(equations) @ direction[: equations.system.n], product @ direction[: equations.system.n]
    steps, left, left2 = 0.5 ** np.arange(3, 7), [], []
    for step in steps:
        equations.system.w.x.array[:] = w + step * direction
        left.append(potential() - Pi - step * first)
        left2.append(left[-1] - step**2 / 2 * second)
    figure(TAYLOR, "distance of the force's order from 2", np.log2(np.abs(left[:-1]) / np.abs(left[1:]))[-1] - 2.0, 0.003)
    figure(TAYLOR, "distance of the tangent's order from 3", np.log2(np.abs(left2[:-1]) / np.abs(left2[1:]))[-1] - 3.0, 0.2)


@pytest.mark.parametrize("formulation", ["mixed", "displacement"])
def test_residual_of_the_tangent_falls_as_the_square(formulation, shell, equilibrium):
    equations = equilibrium(shell["axisymmetric"], LAWS["neo-hookean"], formulation)
    direction = shaken(equations)
    w, start, product = equations.system.w.x.array.copy(), force(equations), np.empty(equations.system.n)
    equations.system.tangent_product(direction[: equations.system.n], product)
    left = []
    for step in 0.5 ** np.arange(2, 6):
        equations.system.w.x.array[:] = w + step * direction
        left.append(np.linalg.norm(force(equations) - start - step * product))
    assert np.log2(np.array(left[:-1]) / left[1:])[-1] == pytest.approx(2.0, abs=0.1)


# -- homogeneous states -------------------------------------------------------------------------------------------------


def nominal(law, F):
    """First Piola-Kirchhoff stress of a homogeneous F over the shear modulus, by principal stretches and complex steps."""
    left, stretches, right = np.linalg.svd(F)
    h, slopes = 1e-30, []
    for i in range(3):
        moved = [stretch + (1j * h if k == i else 0.0) for k, stretch in enumerate(stretches)]
        slopes.append(np.imag(law.energy(HomogeneousStrain(tuple(moved)))) / h)
    return left @ np.diag(slopes) @ right / law.shear_modulus_0


def imposed(equations, F):
    """Put the equations into the homogeneous state F, with the pressure-like unknown that belongs to it."""
    body, d = equations.system.body, equations.system.body.actuator.dimension
    G = (F - np.eye(3)) if d == 3 else (F - np.eye(3))[np.ix_([0, 2], [0, 2])]
    displacement, pressure = equations.system.w.sub(0), equations.system.w.sub(1)
    displacement.interpolate(lambda X: body.skew @ G @ X[:d])
    value = equations.system.material.bulk / equations.system.stress_unit * (np.linalg.det(F) - 1)
    pressure.interpolate(lambda X: np.full(X.shape[1], value))


def linear_field(equations, A):
    """Dof values of the virtual displacement v = A X, nothing in the pressure's part."""
    from dolfinx import fem

    field, d = fem.Function(equations.system.space), equations.system.body.actuator.dimension
    field.sub(0).interpolate(lambda X: equations.system.body.skew @ A @ X[:d])
    return field.x.array


GRADIENT = np.array([[1.3, 0.2, -0.1], [0.05, 0.9, 0.3], [-0.2, 0.1, 1.1]])


def exactness(law):
    """Ogden's stretches carry the smoothing of `softmodels.materials.laws.eigenvalues`, 1e-8 of the strain's own size."""
    return 3e-8 if isinstance(law, Ogden) else 1e-10


@pytest.mark.quick
@laws
def test_patch_of_tetrahedra_has_the_laws_stress(law, equilibrium):
    """Any homogeneous F: no force inside, and forces on the faces that are exactly the law's stress."""
    from dolfinx import fem

    equations = equilibrium(bodies.Block(cells=2), law)
    imposed(equations, GRADIENT)
    forces = fem.assemble_vector(equations.system._internal[0]).array
    coordinates = equations.system.space.sub(0).collapse()[0].tabulate_dof_coordinates()
    inside = ((coordinates > 1e-9) & (coordinates < 1 - 1e-9)).all(axis=1)
    assert inside.sum() > 5
    dofs = np.array(equations.system.space.sub(0).collapse()[1]).reshape(-1, 3)
    near = exactness(law)
    assert np.abs(forces[dofs[inside]]).max() < near
    assert np.abs(forces[np.setdiff1d(np.arange(len(forces)), dofs)]).max() < near
    found = np.empty((3, 3))
    for i, j in np.ndindex(3, 3):
        unit = np.zeros((3, 3))
        unit[i, j] = 1.0
        found[i, j] = forces @ linear_field(equations, unit)
    assert found == pytest.approx(nominal(law, GRADIENT), abs=near)


@pytest.mark.quick
@laws
def test_patch_of_triangles_has_the_laws_stress(law, equilibrium):
    """A cylinder stretched along and across its axis; the work of r e_r is that of both stresses across."""
    from dolfinx import fem

    equations = equilibrium(bodies.Block(section="axisymmetric", cells=3), law)
    F = np.diag([1.3, 1.3, 0.8])
    imposed(equations, F)
    forces = fem.assemble_vector(equations.system._internal[0]).array
    P, near = nominal(law, F), exactness(law)
    assert forces @ linear_field(equations, np.diag([1.0, 0.0])) == pytest.approx(np.pi * (P[0, 0] + P[1, 1]), abs=near)
    assert forces @ linear_field(equations, np.diag([0.0, 1.0])) == pytest.approx(np.pi * P[2, 2], abs=near)
    space, dofs = equations.system.space.sub(0).collapse()
    coordinates = space.tabulate_dof_coordinates()[:, :2]
    inside = (coordinates[:, 1] > 1e-9) & (coordinates < 1 - 1e-9).all(axis=1)  # the axis is inside the cylinder
    assert np.abs(forces[np.array(dofs).reshape(-1, 2)[inside]]).max() < near


@laws
@pytest.mark.parametrize("section", ["cube", "axisymmetric"])
def test_block_under_pressure_from_all_sides(law, section, equilibrium, figure):
    """A real solve whose answer is homogeneous, up to the solver's own tolerance: J is the root of dW/dJ = -P."""
    from scipy.optimize import brentq

    from softmodels.mechanics.controls import pressure_control

    law = dataclasses.replace(law, poisson=0.3)
    equations = equilibrium(bodies.Block(section=section, cells=2), law)
    state = equations.system.rest()
    equations.factorise(state)
    for P in (0.25, 0.5):
        state = equations.solve(pressure_control(P), state.w, P)

    def out_of_balance(stretch):
        return np.diag(nominal(law, stretch * np.eye(3))).mean() / stretch**2 + P

    stretch = brentq(out_of_balance, 0.3, 1.0, xtol=1e-15)
    volume = -(stretch**3) * (1.0 if section == "cube" else np.pi)
    figure("root of dW/dJ = -P, a block pressed from all sides", "volume, every law", state.V / volume - 1, 6e-10)
    equations.system.load(state)
    ratios = equations.system._J.eval(equations.system.body.mesh, equations.system.cells)
    assert ratios == pytest.approx(stretch**3, rel=1e-9)
