"""Limit points of the pressure: a balloon against its closed form, and whole paths against PETSc's own continuation."""

from __future__ import annotations

import numpy as np
import pytest

from geometries import HollowDisk
from softmodels.materials.laws import NeoHookean
from softmodels.materials.specimens import balloon_limit
from softmodels.mechanics.body import CAVITY_TAG
from softmodels.mechanics.newton import NoConvergence
from softmodels.path import continuation
from tests.support import bodies
from tests.support.campaigns import sampled

THIN = 0.01  # thickness over middle radius
SHELL = "thin-shell theory of a balloon, wall 1/100 of the radius"
CONTROLS = "the thin balloon's limit under automatic control of pressure"
PETSC = "PETSc's SNESNEWTONAL with a residual of its own, far past the limit"
RUBBER = NeoHookean(100e3, 0.5)


@pytest.fixture(scope="module")
def balloon(equilibrium):
    radius = 0.010
    inner, outer = radius * (1 - THIN / 2), radius * (1 + THIN / 2)
    return equilibrium(bodies.Sphere(inner=inner, outer=outer, through=1, along=32), RUBBER)


@pytest.fixture(scope="module")
def limit(balloon, solved):
    """The balloon's limit point, met by a path that was asked for twice the pressure it can bear."""
    _, expected = balloon_limit(RUBBER, THIN)
    _, points, end = solved(balloon, [2 * expected / balloon.system.stress_unit])
    assert end is not None and "limit point" in str(end)
    assert [point.limit for point in points].count(True) == 1
    return end.limit


@pytest.mark.quick
def test_balloon_limit_pressure(balloon, limit, figure):
    """A wall of middle radius R has the pressure of a thin one up to (t/R)^2: 3e-6 here, by the thick wall's integral."""
    _, expected = balloon_limit(RUBBER, THIN)
    figure(SHELL, "limit pressure", limit.state.P * balloon.system.stress_unit / expected - 1, 5e-6)


@pytest.mark.quick
def test_balloon_limit_stretch(balloon, limit, figure):
    """7^(1/6) holds for the middle of the wall. The inner face is stretched by t/R / 2 (1 - stretch^-3) more of itself."""
    shell = balloon.system.body.actuator
    inner = (limit.state.V / balloon.system.rest().V) ** (1 / 3)
    middle = ((shell.inner + shell.outer) / 2 / shell.inner) ** 3
    stretch = ((inner**3 - 1 + middle) / middle) ** (1 / 3)  # the wall between keeps its volume
    figure(SHELL, "stretch at the limit, 7^(1/6)", stretch / 7 ** (1 / 6) - 1, 1e-5)
    assert inner / stretch - 1 == pytest.approx(THIN / 2 * (1 - stretch**-3), rel=0.02)


@pytest.mark.quick
def test_pressure_control_names_the_limit_too(balloon, limit, solved, figure):
    """It cannot pass a limit point; where no step succeeds any more it looks whether one lies ahead."""
    _, points, end = solved(balloon, [2 * limit.state.P], "pressure")
    assert end is not None and "limit point" in str(end)
    assert points[-1].line == "volume"
    figure(CONTROLS, "limit pressure met under pressure", end.limit.state.P / limit.state.P - 1, 2.7e-11)


@pytest.mark.parametrize("control", sampled(["auto", "volume", "arc-length"]))
def test_other_controls_meet_the_same_limit(balloon, limit, solved, control, figure):
    added = limit.state.V - balloon.system.rest().V
    _, points, end = solved(balloon, [0.98 * added, added, 1.02 * added, 1.5 * added], control, "volume")
    assert end is None
    at = [point.state.P for point in points if point.requested]
    figure(CONTROLS, "pressure at the limit's volume: automatic, volume, arc length", at[1] / limit.state.P - 1, 5e-11)
    assert at[1] > max(at[0], at[2], at[3])
    _, points, end = solved(balloon, [0.9 * added, 1.5 * added], control, "volume")
    assert end is None  # a volume past the limit has a state, which no control may refuse
    (again,) = (point.state.P for point in points if point.limit)
    figure(CONTROLS, "limit pressure: automatic, volume, arc length", again / limit.state.P - 1, 2e-10)


def test_a_pressure_beyond_the_limit_ends_a_little_past_it(balloon, limit, solved):
    path, points, _ = solved(balloon, [1.1 * limit.state.P])
    past = (points[-1].state.V - path.history.V0) / (limit.state.V - path.history.V0)
    assert 1.05 < past < 1.5
    assert points[-1].state.P < limit.state.P


def test_pressure_control_ends_at_the_limit(balloon, limit, solved):
    """What no state of rest can bear is an error that says so.

    Past the limit the balloon turned inside out is in equilibrium too, and Newton's method finds it now and then: no path
    leads there, and a path that jumps would show as a cavity that shrinks.
    """
    _, points, end = solved(balloon, [1.2 * limit.state.P], "pressure")
    assert (np.diff([point.state.V for point in points]) > 0).all()
    assert end is not None
    assert points[-1].state.P < limit.state.P * (1 + 1e-6)


def test_a_step_whose_limit_point_is_not_located_is_halved(balloon, limit, solved, monkeypatch):
    """Walls that meet or part between two states may hide it; the path ends only where short steps do not show it either."""
    located, least = continuation.events, [0.0]

    def of_short_steps(corrector, requested, before, after, report):
        if abs(after.state.V - before.state.V) > least[0]:
            raise NoConvergence("as if walls had met")
        return located(corrector, requested, before, after, report)

    monkeypatch.setattr(continuation, "events", of_short_steps)
    added = limit.state.V - balloon.system.rest().V
    least[0] = 0.15 * added
    _, points, end = solved(balloon, [1.1 * added], quantity="volume")
    assert end is None
    (found,) = (point for point in points if point.limit)
    assert abs(found.state.P / limit.state.P - 1) < 1e-9
    assert max(np.diff([point.state.V for point in points])) <= least[0]
    least[0] = 0.0
    _, points, end = solved(balloon, [1.1 * added], quantity="volume")
    assert end is not None and "a limit point or a requested value on the way was not located" in str(end)


def test_a_step_whose_requested_value_is_not_located_is_halved(balloon, limit, solved, monkeypatch):
    """Between two states that agree the path may be lost to where a part has snapped on the way."""
    located, least = continuation.Continuation.between, [0.0]

    def on_short_steps(path, before, after, value):
        if abs(after.state.V - before.state.V) > least[0]:
            raise NoConvergence("as if a part had snapped")
        return located(path, before, after, value)

    monkeypatch.setattr(continuation.Continuation, "between", on_short_steps)
    added = limit.state.V - balloon.system.rest().V
    least[0] = 0.05 * added
    _, points, end = solved(balloon, [0.6 * limit.state.P], control="volume", quantity="pressure")
    assert end is None and points[-1].requested
    assert pytest.approx(0.6 * limit.state.P, rel=1e-9) == points[-1].state.P
    least[0] = 0.0
    _, points, end = solved(balloon, [0.6 * limit.state.P], control="volume", quantity="pressure")
    assert "a limit point or a requested value on the way was not located" in str(end) and len(points) > 1


# -- PETSc's SNESNEWTONAL on a residual written for it alone ----------------------------------------------------------


class Continuation:
    """The same discrete body, once more: own residual, own boundary conditions, own volume, PETSc's arc length.

    The pressure enters as traction -P cof(F) N, the volume as the integral of z e_z . n; neither form, nor any code of the
    library's solver, is shared. Axisymmetric, neo-Hookean, P2/P1; lengths and stresses dimensionless.
    """

    def __init__(self, mesh, cavity, material, held):
        import basix.ufl
        import ufl
        from dolfinx import fem

        cell = mesh.basix_cell()
        pair = [basix.ufl.element("P", cell, 2, shape=(2,)), basix.ufl.element("P", cell, 1)]
        self.space = fem.functionspace(mesh, basix.ufl.mixed_element(pair))
        self.w, self.P = fem.Function(self.space), fem.Constant(mesh, 0.0)
        u, p = ufl.split(self.w)
        r, N = ufl.SpatialCoordinate(mesh)[0], ufl.FacetNormal(mesh)
        plane, hoop = ufl.Identity(2) + ufl.grad(u), 1 + u[0] / r
        J, inverse_bulk = ufl.det(plane) * hoop, material.shear_modulus / material.bulk
        I1 = ufl.tr(plane.T * plane) + hoop**2
        energy = (I1 - 3) / 2 - ufl.ln(J) + p * (J - 1) - fem.Constant(mesh, inverse_bulk) / 2 * p**2
        ring = 2 * np.pi * r
        dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": 2})
        ds = ufl.ds(cavity[1], domain=mesh, subdomain_data=cavity[0], metadata={"quadrature_degree": 4})
        test, trial = ufl.TestFunction(self.space), ufl.TrialFunction(self.space)
        area = ufl.det(plane) * ufl.inv(plane).T * N * hoop
        load = -ufl.dot(area, ufl.split(test)[0]) * ring * ds
        residual = ufl.derivative(energy * ring * dx, self.w, test) - self.P * load
        self.load, self.residual = fem.form(load), fem.form(residual)
        self.tangent = fem.form(ufl.derivative(residual, self.w, trial))
        height = ufl.SpatialCoordinate(mesh)[1] + u[1]
        self.volume = fem.form(-height * area[1] * ring * ds)
        self.bcs = []
        for component, where in held:
            part = self.space.sub(0).sub(component)
            dofs = fem.locate_dofs_geometrical((part, part.collapse()[0]), where)
            self.bcs.append(fem.dirichletbc(fem.Function(part.collapse()[0]), dofs, part))

    def follow(self, highest, step, steps):
        """Pressures and volumes of the states on the path, from rest on, shape (n, 2)."""
        from dolfinx import fem
        from dolfinx.fem import petsc
        from petsc4py import PETSc

        def take(snes, x):
            self.P.value = highest * snes.getNewtonALLoadParameter()
            petsc.assign(x, self.w)

        def residual(snes, x, b):
            take(snes, x)
            b.set(0.0)
            petsc.assemble_vector(b, self.residual)
            petsc.set_bc(b, self.bcs, x0=x, alpha=-1.0)

        def tangent(snes, x, A, _):
            take(snes, x)
            A.zeroEntries()
            petsc.assemble_matrix(A, self.tangent, bcs=self.bcs)
            A.assemble()

        def load(snes, x, q):
            take(snes, x)
            q.set(0.0)
            petsc.assemble_vector(q, self.load)
            petsc.set_bc(q, self.bcs, alpha=0.0)
            q.scale(highest)

        path = []

        def record(snes, iteration, norm):
            if snes.getConvergedReason() > 0:
                take(snes, snes.getSolution())
                path.append((float(self.P.value), fem.assemble_scalar(self.volume)))

        snes = PETSc.SNES().create(self.w.function_space.mesh.comm)
        snes.setType("newtonal")
        A, b, x = petsc.create_matrix(self.tangent), petsc.create_vector(self.space), petsc.create_vector(self.space)
        snes.setFunction(residual, b)
        snes.setJacobian(tangent, A)
        snes.setNewtonALFunction(load)
        snes.setMonitor(record)
        snes.setTolerances(rtol=1e-11, atol=1e-11, max_it=30)
        ksp = snes.getKSP()
        ksp.setType("preonly")
        ksp.getPC().setType("lu")
        ksp.getPC().setFactorSolverType("mumps")
        options = PETSc.Options()
        given = {"step_size": step, "max_continuation_steps": steps, "psisq": 0.0, "lambda_min": 0.0, "lambda_max": 1.0}
        snes.setOptionsPrefix("continuation_")
        for name, value in given.items():
            options[f"continuation_snes_newtonal_{name}"] = value
        snes.setFromOptions()
        for name in given:
            options.delValue(f"continuation_snes_newtonal_{name}")
        snes.solve(None, x)
        return np.array(path)


def compared(equations, solved, held, highest, step, steps):
    """PETSc's path, and the library's pressures at the volumes of its states."""
    body = equations.system.body
    reference = Continuation(body.mesh, (body.cavity, CAVITY_TAG), equations.system.material, held)
    path = reference.follow(highest, step, steps)
    order = np.argsort(path[:, 1])
    path = path[order][path[order, 1] > equations.system.rest().V * (1 + 1e-9)]
    _, points, end = solved(equations, path[:, 1] - equations.system.rest().V, "volume", "volume")
    assert end is None
    return path, np.array([point.state.P for point in points if point.requested])


def test_sphere_path_matches_petsc(equilibrium, solved, figure):
    equations = equilibrium(bodies.Sphere(through=2, along=6), RUBBER)
    held = [(1, lambda X: np.isclose(X[1], 0)), (0, lambda X: np.isclose(X[0], 0))]
    path, found = compared(equations, solved, held, highest=2.0, step=0.6, steps=25)
    top = int(np.argmax(path[:, 0]))
    assert 3 < top < len(path) - 3
    figure(PETSC, "sphere, pressure at equal volume", found / path[:, 0] - 1, 8e-10)


def test_disk_path_matches_petsc(equilibrium, solved, figure):
    disk = HollowDisk.variant("shadow", section="axisymmetric", support="base", cell_size=0.003)
    equations = equilibrium(disk, NeoHookean(20e3, 0.495))
    held = [(0, lambda X: np.isclose(X[0], 0) | np.isclose(X[1], 0)), (1, lambda X: np.isclose(X[1], 0))]
    path, found = compared(equations, solved, held, highest=2.0, step=2.0, steps=20)
    top = int(np.argmax(path[:, 0]))
    assert 3 < top < len(path) - 3
    figure(PETSC, "thin disk, pressure at equal volume", found / path[:, 0] - 1, 5e-11)
