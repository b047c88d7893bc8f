"""Walls that press on each other: derivatives, balances, flat walls, two shells against their mirror plane, nothing passes."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from geometries import CutPlane, Hold, HollowDisk
from geometries.actuator import reflected
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.common.schema import length_field, number_field
from softmodels.components.contact import Obstacle, Walls, passes
from softmodels.components.pressing import Pairs, Penalty, Pressed, Surface
from softmodels.materials.laws import NeoHookean
from softmodels.mechanics.body import Body
from softmodels.mechanics.component import ComponentError
from softmodels.mechanics.controls import pressure_control, volume_control
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.runs.state_values import Grid, Sampling
from tests.support import bodies
from tests.support.campaigns import sampled
from tests.support.cavities import TubeBody

RUBBER = NeoHookean(30e3, 0.49)
PENALTY = Penalty(300.0, 0.005)
MIRROR = "a shell on the mirror plane of two"


def sheet(dimension, cells, height, inside):
    """A flat wall over [0, 1] or its square: nodes, facets, points of the solid behind it."""
    steps = np.linspace(0.0, 1.0, 2 * cells + 1)
    if dimension == 2:
        nodes = np.column_stack([steps, np.full_like(steps, height)])
        facets = np.array([(2 * i, 2 * i + 2, 2 * i + 1) for i in range(cells)])
        return nodes, facets, np.tile([0.5, inside], (cells, 1))
    nodes = np.array([(x, y, height) for y in steps for x in steps])
    facets = []
    for i in range(0, 2 * cells, 2):
        for j in range(0, 2 * cells, 2):
            square = [(i, j), (i + 2, j), (i + 2, j + 2), (i, j + 2)]
            for corners in (np.array(square)[[0, 1, 2]], np.array(square)[[0, 2, 3]]):
                middles = [(corners[a] + corners[b]) // 2 for a, b in ((1, 2), (2, 0), (0, 1))]
                facets.append([y * len(steps) + x for x, y in (*corners, *middles)])
    return nodes, np.array(facets), np.tile([0.5, 0.5, inside], (len(facets), 1))


def two_sheets(dimension, mirrored=False):
    """Two walls a tenth apart whose facets do not match, which may go on as mirror images, and the upper one's nodes."""
    mirrors = np.eye(dimension)[:-1] if mirrored else []
    upper, lower = sheet(dimension, 3, 0.1, 5.0), sheet(dimension, 4, 0.0, -5.0)
    nodes, facets = np.vstack([upper[0], lower[0]]), np.vstack([upper[1], lower[1] + len(upper[0])])
    walls = np.repeat([0, 1], [len(upper[1]), len(lower[1])])
    surface = Surface(nodes, facets, walls, np.vstack([upper[2], lower[2]]))
    return Pairs(surface, ~np.eye(2, dtype=bool), reflected(mirrors, dimension=dimension)), np.arange(len(nodes)) < len(
        upper[0]
    )


@pytest.fixture(scope="module", params=sampled([(2, False), (3, False), (2, True), (3, True)], 2, whole=True),
                ids=["lines", "triangles", "mirrored lines", "mirrored triangles"])  # fmt: skip
def sheets(request):
    return two_sheets(*request.param)


def test_flat_walls_are_exact_whatever_their_facets(sheets):
    pairs, upper = sheets
    nodes = pairs.surface.nodes.copy()
    nodes[upper, -1] -= 0.11
    pressed = Pressed(pairs, PENALTY, nodes)
    assert pressed.gaps == pytest.approx(-0.01, rel=1e-12)
    assert pressed.energy == pytest.approx(float(PENALTY.rates(np.array(0.01))[0]), rel=2e-3)  # less at corners
    rest = Pressed(pairs, PENALTY, pairs.surface.nodes)
    assert rest.energy == 0.0 and not rest.forces.any() and not rest.stiffness.nnz


@pytest.mark.parametrize("angle", [4.0, -4.0])
def test_a_corner_closes_onto_itself(angle):
    """A wall and a ceiling of one cavity press on each other by their distance, but for where a kernel reaches at rest."""
    wall, ceiling = sheet(2, 12, 0.0, -5.0), sheet(2, 12, 0.0, -5.0)
    upright = np.column_stack([ceiling[0][:, 1], ceiling[0][:, 0]])
    nodes = np.vstack([wall[0], upright])
    inside = np.vstack([wall[2], np.tile([-5.0, 0.5], (12, 1))])
    surface = Surface(nodes, np.vstack([wall[1], ceiling[1] + 25]), np.zeros(24, dtype=int), inside)
    pairs = Pairs(surface, np.ones((1, 1), dtype=bool), np.eye(2)[None])
    rest = Pressed(pairs, PENALTY, nodes)
    assert rest.energy == 0.0 and np.isinf(rest.gaps).all()
    size, turn = upright[:, 1], math.radians(angle)
    closed = Pressed(pairs, PENALTY, np.vstack([wall[0], np.column_stack([math.cos(turn) * size, math.sin(turn) * size])]))
    along = surface.places(np.concatenate([wall[0][:, 0], size])[:, None] * [1.0, 0.0])[:, 0]
    radius = pairs.radius[0]
    near = (along > 2.0 * radius) & (along * abs(math.sin(turn)) < 0.3 * radius)
    assert near.sum() > 6
    assert closed.gaps[near] == pytest.approx(math.sin(turn) * along[near], rel=1e-10)
    assert (closed.energy > 0.0) == (angle < 0.0)


def test_derivatives_and_balances(sheets):
    """Taylor's remainders fall quadratically; neither a push nor a turn is left over."""
    pairs, upper = sheets
    random = np.random.default_rng(3)
    nodes = pairs.surface.nodes + 0.005 * random.standard_normal(pairs.surface.nodes.shape)
    nodes[upper, -1] -= 0.12
    here, way = Pressed(pairs, PENALTY, nodes), random.standard_normal(nodes.shape)
    steps, first, second = np.array([5e-4, 2.5e-4, 1.25e-4]), [], []
    for step in steps:
        there = Pressed(pairs, PENALTY, nodes + step * way)
        first.append(abs(there.energy - here.energy - step * np.sum(here.forces * way)))
        left = (there.forces - here.forces).ravel() - step * (here.stiffness @ way.ravel())
        second.append(np.linalg.norm(left))
    for errors in (first, second):
        assert np.diff(np.log(errors)) / np.diff(np.log(steps)) == pytest.approx(2.0, abs=0.25)
    assert abs(here.stiffness - here.stiffness.T).max() < 1e-9 * abs(here.stiffness).max()
    size, mirrored = np.abs(here.forces).sum(), len(pairs.images) > 1
    assert np.abs(here.forces.sum(axis=0))[-1 if mirrored else 0 :].max() < 1e-12 * size
    if mirrored:  # the images take what is square to their planes
        return
    turns = np.einsum("ni,nj->ij", nodes, here.forces)
    assert np.abs(turns - turns.T).max() < 1e-12 * size


def test_nothing_passes_through(sheets):
    """Neither slowly nor in one leap, however far; past the wall's end there is nothing in the way."""
    pairs, upper = sheets
    rest = pairs.surface.nodes
    for drop, refused in ((0.05, False), (0.12, False), (0.3, True), (3.0, True), (30.0, True)):
        assert passes(pairs, rest, rest - np.outer(upper, np.eye(rest.shape[1])[-1] * drop)) is refused
    aside = rest + np.outer(upper, np.eye(rest.shape[1])[0] * 3.0)
    assert not passes(pairs, rest, aside)
    assert not passes(pairs, aside, aside - np.outer(upper, np.eye(rest.shape[1])[-1] * 3.0))


@pytest.fixture(scope="module")
def pair_of_shells():
    @dataclasses.dataclass(frozen=True, kw_only=True)
    class Pair(bodies.Sphere):
        """Two half shells whose poles face each other; the upper one has more cells."""

        gap: float = length_field(0.0006, "between the poles")
        more: float = number_field(3, "more cells along the upper one")

        ratios = (1.0, 1.0)
        holds = (Hold("axis", (1.0, 0.0, 0.0)), Hold("far", (0.0, 0.0, 1.0)))
        cut_planes = (CutPlane("equator", (0.0, 0.0, -1.0)),)
        cavity_volume = math.nan

        def build(self):
            import gmsh

            geo, mesh = gmsh.model.geo, gmsh.model.geo.mesh
            groups, solid = {}, []
            for at, up, names, along in (
                (0.0, 1.0, ("equator", "cavity", "lower"), self.along),
                (2 * self.outer + self.gap, -1.0, ("far", "cavity2", "upper"), self.along + self.more),
            ):
                centre = geo.addPoint(0, at, 0)
                a, b = geo.addPoint(self.inner, at, 0), geo.addPoint(self.outer, at, 0)
                c, d = geo.addPoint(0, at + up * self.outer, 0), geo.addPoint(0, at + up * self.inner, 0)
                flat, outside = geo.addLine(a, b), geo.addCircleArc(b, centre, c)
                axis, inside = geo.addLine(c, d), geo.addCircleArc(d, centre, a)
                solid.append(geo.addPlaneSurface([geo.addCurveLoop([flat, outside, axis, inside])]))
                for curve, cells in ((flat, self.through), (axis, self.through), (outside, along), (inside, along)):
                    mesh.setTransfiniteCurve(curve, round(cells) + 1)
                mesh.setTransfiniteSurface(solid[-1])
                for name, curve in zip((*names, "axis"), (flat, inside, outside, axis), strict=True):
                    groups.setdefault(name, []).append(curve)
            geo.synchronize()
            gmsh.model.addPhysicalGroup(2, solid, 1, "solid")
            for tag, (name, curves) in enumerate(groups.items(), 10):
                gmsh.model.addPhysicalGroup(1, curves, tag, name)

    return Pair


def test_two_shells_meet_as_one_meets_its_mirror_plane(pair_of_shells, body_of, solved, figure):
    """Other cells on the other wall, a wall ten times stiffer than a plane; volumes and forces at one pressure."""
    k, pressures = 3000.0, [0.2, 0.3, 0.4]
    shell, pair = bodies.Sphere(through=2, along=24), pair_of_shells(through=2, along=24)
    plane = f"z = {1e3 * (pair.outer + pair.gap / 2)} mm"
    one = Solver(System(body_of(shell, TubeBody), RUBBER, components=[Obstacle("outer", plane, 2 * k)]))
    two = Solver(System(body_of(pair, TubeBody), RUBBER, components=[Walls("lower, upper", k)]))
    found = {}
    for name, equations in (("one", one), ("two", two)):
        _, points, end = solved(equations, pressures)
        assert end is None
        system = equations.system
        states = [point.state for point in points if point.requested]
        assert [state.P for state in states] == pytest.approx(pressures)
        found[name] = np.array([state.V for state in states]) - system.rest().V
        system.load(states[-1])
    figure(MIRROR, "added volume of two", np.abs(found["two"] / found["one"] / 2 - 1).max(), 1e-3)
    figures = two.system.potential.terms["walls"].figures(two.system)
    force = one.system.potential.terms["contact"].figures(one.system)["contact_force_N"]
    figure(MIRROR, "force of two", figures["walls_contact_N"] / force - 1, 0.01)
    assert figures["walls_overlap_mm"] < 0.01 * 1e3 * (pair.outer - pair.inner)


@pytest.mark.quick
def test_a_patch(body_of, figure):
    """One cylinder stands on another with other cells, under an even dead load: what that leaves of an even stretch."""

    @dataclasses.dataclass(frozen=True, kw_only=True)
    class Stack(bodies.Block):
        dimension = 2
        holds = (Hold("axis", (1.0, 0.0, 0.0)),)
        cut_planes = (CutPlane("plane2", (0.0, 0.0, -1.0)),)

        def build(self):
            import gmsh

            geo, mesh, edge = gmsh.model.geo, gmsh.model.geo.mesh, self.edge
            groups, solid = {}, []
            for low, names, cells in (
                (0.0, ("plane2", "side", "under", "axis"), 4),
                (1.001 * edge, ("over", "side", "cavity", "axis"), 5),
            ):
                points = [geo.addPoint(x, low + y, 0) for x, y in ((0, 0), (edge, 0), (edge, edge), (0, edge))]
                curves = [geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
                solid.append(geo.addPlaneSurface([geo.addCurveLoop(curves)]))
                for curve, name in zip(curves, names, strict=True):
                    mesh.setTransfiniteCurve(curve, cells + 1)
                    groups.setdefault(name, []).append(curve)
            geo.synchronize()
            gmsh.model.addPhysicalGroup(2, solid, 1, "solid")
            for tag, (name, curves) in enumerate(groups.items(), 10):
                gmsh.model.addPhysicalGroup(1, curves, tag, name)

    class Loaded(Body):
        def volume_integrand(self, w):
            import ufl

            return -self.displacement(w)[1] * ufl.FacetNormal(self.mesh)[1] * self.hoop

    equations = Solver(System(body_of(Stack(), Loaded), RUBBER, components=[Walls("under, over")]))
    system = equations.system
    w = system.rest().w.copy()
    lift = int(np.argmax(np.abs(system.body.skew[:, 1])))
    space, dofs = system.space.sub(0).sub(lift).collapse()
    upper = space.tabulate_dof_coordinates()[:, 1] > 1.0005
    w[np.ravel(dofs)[upper]] = -system.body.skew[lift, 1] * (0.001 + 2e-4)  # in touch: hanging free it has no stiffness
    for P in (0.05, 0.1, 0.2, 0.3):
        state = equations.solve(pressure_control(P), w, P)
        w = state.w
    stretch = Sampling(equations, Grid(system)).gradients()[..., 2, 2]
    force = system.potential.terms["walls"].figures(system)["walls_contact_N"]
    even = "even stretch of two cylinders with other cells"
    figure(even, "force", force / (0.3 * system.stress_unit * math.pi * 0.01**2) - 1, 1e-6)
    figure(even, "mean error", stretch.std() / (1 - stretch.mean()), 0.01)
    figure(even, "largest error, at the contact", np.abs(stretch / stretch.mean() - 1).max() / (1 - stretch.mean()), 0.1)


def test_every_step_ends_in_the_same_state(pair_of_shells, body_of, solved, figure):
    """One state by many steps of the pressure and by a few of the volume."""
    pair = pair_of_shells(through=2, along=24)
    equations = Solver(System(body_of(pair, TubeBody), RUBBER, components=[Walls("lower, upper")]))
    _, points, end = solved(equations, [0.3])
    assert end is None
    rest, goal = equations.system.rest(), points[-1].state.V
    state = rest
    for share in (0.5, 0.8, 1.0):
        state = equations.solve(volume_control(rest.V + share * (goal - rest.V)), state.w, state.P)
    figure("the path by pressure", "state by three steps of volume", state.P / 0.3 - 1, 1e-7)


def test_a_case_keeps_its_walls_and_refuses_what_makes_none(body_of):
    disk = HollowDisk(section="axisymmetric")
    case = Case(
        "disk",
        disk,
        RUBBER,
        steps=steps_of(pressure_cm=(10.0,)),
        components=(Walls("cavity", name="inside"), Walls("top", 100.0, name="above")),
    )
    assert Case.from_toml(case.to_toml()) == case
    for faces, stiffness, words in (
        ("", 300.0, "names no faces"),
        ("top, top", 300.0, "twice"),
        ("top", 5.0, "shear moduli per size"),
        ("top", math.nan, "stiffness"),
    ):
        with pytest.raises(ComponentError, match=words):
            Walls(faces, stiffness)
    with pytest.raises(CaseError, match="unknown entry 'face'"):
        Case.from_toml(case.to_toml() + "\n[walls.other]\nface = 'top'\n")
    with pytest.raises(ComponentError, match="no face 'lid'"):
        System(body_of(disk), RUBBER, components=[Walls("lid")])
