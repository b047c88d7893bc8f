"""Contact with rigid spheres, cylinders and capsules: a shell in a mould in closed form, Hertz, balances, refusals."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import softmodels as sm
from geometries import CutPlane, Hold, HollowDisk
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.common.schema import length_field
from softmodels.components.contact import ONSET_PRESSURE, RigidShape
from softmodels.materials.laws import NeoHookean
from softmodels.mechanics.body import Body
from softmodels.mechanics.component import ComponentError
from softmodels.mechanics.controls import pressure_control, volume_control
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System, held_force
from tests.support import bodies

MOULD = "neo-Hookean shell in a rigid hollow sphere"
LAW = NeoHookean(30e3, 0.5)
SECTION = HollowDisk(section="axisymmetric")
BALL = RigidShape("sphere", "top", (0.0, 0.0, 0.0265), 0.010)


def test_a_shell_swells_in_a_hollow_sphere(body_of, figure):
    """Without shape change the radii follow from the volume; the mould presses evenly."""
    shell = bodies.Sphere(through=4, along=16)
    mould = RigidShape("sphere", "outer", (0.0, 0.0, 0.0), 1.02 * shell.outer, hollow=True)
    equations = Solver(System(body_of(shell), LAW, components=[mould]))
    system, k, size = equations.system, mould.stiffness, shell.size
    rest = system.rest()
    state = rest
    for growth in (1.15, 1.21, 1.23, 1.25):
        state = equations.solve(volume_control(growth * rest.V), state.w, state.P)
    inner = 1.25 ** (1 / 3)
    outer = (1 + (inner**3 - 1) * (shell.inner / shell.outer) ** 3) ** (1 / 3)
    depth = (outer - 1.02) * shell.outer / size
    assert depth > 5e-3
    pressed = k * (depth - ONSET_PRESSURE / k / 2) / outer**2
    free = [(stretch**-4 + 4 / stretch) / 2 for stretch in (inner, outer)]
    figure(MOULD, "pressure", state.P / (free[1] - free[0] + pressed) - 1, 1e-4)
    figures = system.potential.terms["sphere"].figures(system)
    force = pressed * math.pi * (outer * shell.outer) ** 2 * system.stress_unit
    figure(MOULD, "force", figures["sphere_force_z_N"] / force - 1, 1e-3)
    figure(MOULD, "depth", figures["sphere_depth_mm"] / (depth * size * 1e3) - 1, 1e-2)  # facets are straight


def test_a_shape_grows_harder_before_it_is_passed():
    """A contact so soft that at a constant stiffness a state of 0.6 ml would be refused."""
    ball = dataclasses.replace(BALL, stiffness=3.0, name="ball")
    run = sm.inflate(SECTION, LAW, volumes="0,1.2 ml", components=[ball])
    assert run.added_volume[-1] == pytest.approx(1.2e-6) and 0.2 < run.path["ball_depth_mm"][-1] < 0.5


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ground(HollowDisk):
    """A thick cylinder for half of all space, fine around the middle of its top; its "cavity" is its side."""

    extent: float = length_field(0.060, "radius and height")
    fine: float = length_field(0.0001, "edge length in the middle")

    dimension = 2
    faces = ("top",)
    size = property(lambda self: self.extent)
    cut_planes = (CutPlane("plane2", (0.0, 0.0, -1.0)),)
    holds = (Hold("axis", (1.0, 0.0, 0.0)),)
    copies = 1
    cavity_volume = math.nan

    def check(self):
        pass

    def build(self):
        import gmsh

        occ, mesh = gmsh.model.occ, gmsh.model.mesh
        face = occ.addRectangle(0, 0, 0, self.extent, self.extent)
        occ.synchronize()
        names = ("plane2", "cavity", "top", "axis")
        for tag, ((_, curve), name) in enumerate(zip(gmsh.model.getBoundary([(2, face)], oriented=False), names, strict=True)):
            gmsh.model.addPhysicalGroup(1, [curve], 4 if name == "cavity" else 10 + tag, name)
        gmsh.model.addPhysicalGroup(2, [face], 20, "solid")
        mesh.setSizeCallback(
            lambda dim, tag, x, y, z, size: self.fine + 0.3 * max(0.0, math.hypot(x, y - self.extent) - 20 * self.fine)
        )


class OpenBody(Body):
    """The "cavity" has no pressure and is open."""

    def volume_integrand(self, w):
        return super().volume_integrand(w)


def test_hertz(body_of, figure):
    """A rigid ball pressed a little into thick rubber: F = 16/9 E sqrt(R) d^(3/2)."""
    ground = Ground()
    R, top = 0.050, ground.extent
    ball = RigidShape("sphere", "top", (0.0, 0.0, top + R), R, stiffness=1e5)
    equations = Solver(System(body_of(ground, OpenBody), NeoHookean(30e3, 0.4999), components=[ball]))
    system, term = equations.system, equations.system.potential.terms["sphere"]
    state, found = system.rest(), []
    for d in (1e-5, 3e-5, 6e-5):
        term.take(dataclasses.replace(ball, at=(0.0, 0.0, top + R - d)))
        state = equations.solve(pressure_control(0.0), state.w, 0.0)
        force = term.figures(system)["sphere_force_z_N"]
        found.append(force / (16 / 9 * 3 * 30e3 * math.sqrt(R) * d**1.5) - 1)
    figure("force of Hertz", "rigid ball on thick rubber", found[-1], 0.03)


@pytest.fixture(scope="module")
def pressed(body_of, solved):
    """The disk's section under a ball that stands half a millimetre above it."""
    equations = Solver(System(body_of(SECTION), NeoHookean(28e3), components=[BALL]))
    _, points, end = solved(equations, [0.4])
    assert end is None
    return equations, points


def test_the_ball_takes_what_the_support_holds(pressed, figure):
    equations, points = pressed
    system = equations.system
    system.load(points[-1].state)
    component = int(np.argmax(system.body.skew @ [0.0, 1.0]))
    held = -held_force(system, "support", component) * system.stress_unit * system.length_unit**2
    figures = system.potential.terms["sphere"].figures(system)
    assert figures["sphere_force_z_N"] > 0.01
    figure("force of a disk's support", "force on a ball", figures["sphere_force_z_N"] / held - 1, 1e-8)
    assert 0.0 < figures["sphere_depth_mm"] < 0.01 * SECTION.size * 1e3


def test_no_step_goes_through_the_ball(pressed):
    """A state on the ball's other side is refused, and so is one deep in it."""
    equations, points = pressed
    system, state = equations.system, points[0].state
    lift = int(np.argmax(system.body.skew @ [0.0, 1.0]))
    dofs = np.ravel(system.space.sub(0).sub(lift).collapse()[1])
    for distance, allowed in ((0.02, True), (0.2, False), (5.0, False)):
        moved = state.w.copy()
        moved[dofs] += distance
        assert system.potential.is_admissible(state.w, moved) is allowed


def test_a_case_keeps_its_shapes_and_refuses_what_makes_none(body_of):
    tube = RigidShape("cylinder", "outer", (0.0, 0.0, 0.0), 0.03, (0.0, 0.0, 2.0), hollow=True, name="tube")
    case = Case("disk", SECTION, LAW, steps=steps_of(pressure_cm=(10.0,)), components=(BALL, tube))
    assert Case.from_toml(case.to_toml()) == case
    for changes, words in (
        ({"faces": ""}, "needs faces"),
        ({"at": (0.0, 1.0)}, "three coordinates"),
        ({"radius": 0.0}, "radius above zero"),
        ({"radius": -1.0}, "radius"),
        ({"along": (0.0, 0.0, 0.0)}, "not a direction"),
        ({"length": 0.01}, "'sphere' has no length"),
        ({"shape": "capsule"}, "a capsule needs a length"),
        ({"shape": "cube"}, "cube"),
        ({"stiffness": 0.0}, "shear moduli per size"),
        ({"name": "Ball 1"}, "lower-case letter"),
    ):
        with pytest.raises(ComponentError, match=words):
            dataclasses.replace(BALL, **changes)
    for device, shape, words in (
        (SECTION, dataclasses.replace(BALL, at=(0.001, 0.0, 0.03)), "must be axisymmetric"),
        (SECTION, dataclasses.replace(tube, along=(0.0, 1.0, 0.0)), "must be axisymmetric"),
        (HollowDisk(), dataclasses.replace(BALL, at=(0.0, 0.002, 0.03)), "crosses the cut plane"),
    ):
        with pytest.raises(CaseError, match=words):
            Case("disk", device, LAW, steps=steps_of(pressure_cm=(10.0,)), components=(shape,))
    for shape, words in (
        (dataclasses.replace(BALL, faces="lid"), "no face 'lid'"),
        (dataclasses.replace(BALL, at=(0.0, 0.0, 0.02)), "the undeformed device is"),
        (dataclasses.replace(tube, radius=0.01), "outside of the hollow cylinder"),
    ):
        with pytest.raises(ComponentError, match=words):
            System(body_of(SECTION), LAW, components=[shape])
