"""Dead loads as drivers beside the cavities: a rod under its own weight and a force, against closed forms."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq, minimize_scalar

from geometries import Actuator, Hold, HollowDisk
from softmodels.case.load import steps_of
from softmodels.case.materials import Region
from softmodels.common.schema import length_field, number_field
from softmodels.components.loads import Force, Gravity, Mass, Moment
from softmodels.materials.laws import NeoHookean, Yeoh
from softmodels.mechanics.component import ComponentError
from softmodels.mechanics.controls import pressure_control
from softmodels.mechanics.sensitivity import Sensitivity
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path.continuation import Continuation, trace
from softmodels.path.schedule import PreloadFailure, apply_preload, follow, inflate_from, load_from
from softmodels.path.stability import QUANTITIES, PathEnd
from softmodels.runs.fields import Fields
from tests.support.exact_beam import BEAM, STIFF, elastica

MU, DENSITY, ACCELERATION = 20e3, 1000.0, 1000.0
"""Of the hanging rod: so heavy that it stretches to more than its length at the top."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Rod(Actuator):
    """A rod that hangs from a plate on which it slips, with no cavity: an axisymmetric section."""

    radius: float = length_field(0.002, "radius")
    length: float = length_field(0.040, "length")
    along: float = number_field(24.0, "cells along it")

    dimension = 2
    copies = 1
    mesh_order = 2
    ratios = ()
    cavity_volume = 0.0
    cut_planes = ()
    holds = (Hold("support", (0.0, 0.0, 1.0)), Hold("axis", (1.0, 0.0, 0.0)))
    faces = ("tip",)

    def check(self):
        pass

    @property
    def size(self):
        return self.radius

    @property
    def area(self):
        return math.pi * self.radius**2

    @property
    def solid_volume(self):
        return self.area * self.length

    @property
    def probes(self):
        return {"end": (0.0, 0.0, -self.length)}

    def on_profile(self, points):
        return np.zeros(len(points), dtype=bool)

    def build(self):
        import gmsh

        occ, mesh = gmsh.model.occ, gmsh.model.mesh
        face = occ.addRectangle(0, -self.length, 0, self.radius, self.length)
        occ.synchronize()
        bottom, outside, top, axis = (tag for _, tag in gmsh.model.getBoundary([(2, face)], oriented=False))
        for curve, cells in ((bottom, 1), (top, 1), (outside, self.along), (axis, self.along)):
            mesh.setTransfiniteCurve(curve, round(cells) + 1)
        mesh.setTransfiniteSurface(face)
        gmsh.model.addPhysicalGroup(2, [face], name="solid")
        for curve, name in ((bottom, "tip"), (outside, "outer"), (top, "support"), (axis, "axis")):
            gmsh.model.addPhysicalGroup(1, [curve], name=name)


@dataclasses.dataclass(frozen=True, kw_only=True)
class TwoPartRod(Rod):
    """A rod whose lower half is the region ``lower``."""

    along: float = number_field(12.0, "cells along each half")
    regions = ("lower",)

    def build(self):
        import gmsh

        occ, mesh, half = gmsh.model.occ, gmsh.model.mesh, 0.5 * self.length
        upper, lower = (occ.addRectangle(0, z, 0, self.radius, half) for z in (-half, -self.length))
        occ.fragment([(2, upper)], [(2, lower)])
        occ.synchronize()
        groups = {"outer": [], "support": [], "tip": [], "axis": []}
        for _, curve in gmsh.model.getEntities(1):
            box = np.array(gmsh.model.getBoundingBox(1, curve)).reshape(2, 3)
            (x, z), upright = box.mean(axis=0)[:2], np.ptp(box[:, 1]) > 0.1 * half
            mesh.setTransfiniteCurve(curve, round(self.along if upright else 1) + 1)
            if upright:
                groups["outer" if x > 0.5 * self.radius else "axis"].append(curve)
            elif abs(z + half) > 0.1 * half:
                groups["support" if z > -half else "tip"].append(curve)
        for name, face in (("solid", upper), ("lower", lower)):
            mesh.setTransfiniteSurface(face)
            gmsh.model.addPhysicalGroup(2, [face], name=name)
        for name, curves in groups.items():
            gmsh.model.addPhysicalGroup(1, curves, name=name)


ROD, BLOCK = Rod(), Rod(length=0.004, along=1.0)
GRAVITY = Gravity(direction="-z", density=DENSITY, magnitude=ACCELERATION)
PULL = Force(face="tip", direction="0, 0, -2", name="tip")


def stretch(stress, law_mu=MU):
    """Of an incompressible neo-Hookean fibre under a nominal stress."""
    return brentq(lambda x: law_mu * (x - x**-2) - stress, 0.1, 100.0)


def tip_of(force, weight_share=1.0):
    """Displacement of the rod's end: every section bears what hangs below it."""
    return drawn(DENSITY * weight_share, force, ROD.length)


def drawn(density, force, length):
    """By how much a piece of rod is longer under its own weight and a force at its end."""
    return quad(lambda s: stretch(density * ACCELERATION * s + force / ROD.area) - 1, 0.0, length)[0]


def sag_of():
    """Mean displacement of the rod's material under its own weight: each slice moves what lies above it has stretched."""
    pulled = DENSITY * ACCELERATION
    return quad(lambda s: (stretch(pulled * s) - 1) * s, 0.0, ROD.length)[0] / ROD.length


def solver_of(body_of, device, law, *components):
    return Solver(System(body_of(device), law, components=components))


def magnitudes(solver, **given):
    """All drivers' dimensionless magnitudes: of the dead loads in SI units by their names, the others 0."""
    dead = solver.system.dead
    values = [given.get(load.key.rpartition(".")[2], 0.0) for load in dead.loads]
    return np.concatenate([np.zeros(len(solver.system.volumes())), np.array(values) / dead.units])


def moved(solver, state):
    """What the dead loads have moved at a state, in SI units."""
    solver.system.load(state)
    return solver.system.dead.moved() * solver.system.dead.moved_units


@pytest.fixture(scope="module")
def hanging(body_of):
    """A rod under its own weight, and then pulled as hard again."""
    solver = solver_of(body_of, ROD, NeoHookean(MU, 0.5), GRAVITY, PULL)
    weight = float(solver.system.dead.amounts[0])
    hung = apply_preload(solver, [("its weight", magnitudes(solver, gravity=weight))], lambda text: None)
    goal = weight / solver.system.dead.units[1]
    path = Continuation(solver, QUANTITIES["force"], largest_step=goal / 12, start=load_from(solver, hung, 1))
    points = list(trace(path, [goal / 2, goal]))
    return solver, weight, hung, points


def test_a_hanging_rod(hanging, figure):
    solver, weight, hung, _ = hanging
    sag, tip = hung.driven * solver.system.dead.moved_units
    assert weight == pytest.approx(DENSITY * ACCELERATION * ROD.solid_volume, rel=1e-12)
    against = "a rod under its own weight, stretched to twice its length at the top"
    figure(against, "displacement of its end", tip / tip_of(0.0) - 1, 1.5e-4)
    figure(against, "its sag", sag / sag_of() - 1, 1.5e-4)
    assert tip > 0.3 * ROD.length and stretch(DENSITY * ACCELERATION * ROD.length) > 1.5


@pytest.mark.campaign
def test_a_rod_of_two_densities(body_of, figure):
    """Its lower half is heavier than the upper one: the difference is added, and taken off where it is lighter."""
    law, half = NeoHookean(MU, 0.5), 0.5 * ROD.length
    body = body_of(TwoPartRod())
    for density in (0.4 * DENSITY, 1.6 * DENSITY):
        solver = Solver(System(body, law, components=[GRAVITY, Region(law, density, name="lower"), PULL]))
        weight = float(solver.system.dead.amounts[0])
        assert weight == pytest.approx((DENSITY + density) * ACCELERATION * half * ROD.area, rel=1e-12)
    hung = apply_preload(solver, [("its weight", magnitudes(solver, gravity=weight))], lambda text: None)
    below = density * ACCELERATION * half * ROD.area
    tip = drawn(density, 0.0, half) + drawn(DENSITY, below, half)
    found = (hung.driven * solver.system.dead.moved_units)[1]
    figure("a hanging rod of two densities", "displacement of its end", found / tip - 1, 1.5e-4)


def test_a_force_from_the_hanging_state(hanging, figure):
    solver, weight, hung, points = hanging
    asked = [point for point in points if point.requested]
    forces = np.array([point.state.P for point in asked]) * solver.system.dead.units[1]
    assert forces == pytest.approx([weight / 2, weight])
    tips = np.array([moved(solver, point.state)[1] for point in asked])
    figure("the same rod, pulled besides", "displacement of its end", tips / [tip_of(f) for f in forces] - 1, 1e-4)
    assert np.allclose(points[0].state.w, hung.state.w) and all(point.stable_under_pressure for point in points)


def test_energies_balance(hanging, figure):
    """What is stored on the way is the force's work and what the weight gives up: cubics through states and slopes."""
    solver, weight, _, points = hanging
    system = solver.system
    unit = system.stress_unit * system.volume_unit
    stored, sags, places = [], [], []
    for point in (points[0], points[-1]):
        system.load(point.state)
        stored.append(system.stored_energy() * unit)
        sags.append(moved(solver, point.state)[0])
    places = np.array([point.state.V for point in points])
    force, slope = (np.array(found) for found in zip(*((p.state.P, p.tangent.P / p.tangent.V) for p in points), strict=True))
    step = np.diff(places)
    work = np.sum(step * (force[:-1] + force[1:]) / 2 + step**2 * (slope[:-1] - slope[1:]) / 12) * unit
    given = work + weight * (sags[1] - sags[0])
    figure(
        "energy stored by a force on a hanging rod",
        "work of force and weight",
        given / (stored[1] - stored[0]) - 1,
        1e-5,
    )


def test_any_steps_lead_to_the_same(hanging, body_of, figure):
    """Weight and force together in one step, in another order, and by the end's travel."""
    solver, weight, hung, points = hanging
    wanted = moved(solver, points[-1].state)
    both = apply_preload(solver, [("both", magnitudes(solver, gravity=weight, tip=weight))], lambda text: None)
    turned = apply_preload(
        solver,
        [("the pull", magnitudes(solver, tip=weight)), ("all", magnitudes(solver, gravity=weight, tip=weight))],
        lambda text: None,
    )
    travel = wanted[1] - moved(solver, hung.state)[1]
    steps = steps_of(force={"tip": {"travel_mm": travel * 1e3}})
    *_, (_, last) = follow(solver, steps, preload=hung)
    ways = [stop.driven * solver.system.dead.moved_units for stop in (both, turned)] + [moved(solver, last.state)]
    figure("the same loads in other steps", "what they move", np.array(ways) / wanted - 1, 1e-9)
    assert solver.system.drives_at(last.state)[1] * solver.system.dead.units[1] == pytest.approx(weight, rel=1e-9)


def test_a_pulled_block(body_of, figure):
    solver = solver_of(body_of, BLOCK, NeoHookean(MU, 0.5), PULL)
    path = Continuation(solver, QUANTITIES["travel"], start=load_from(solver, apply_preload(solver, [], print), 0))
    unit = solver.system.length_unit
    *_, last = trace(path, [0.001 / unit, BLOCK.length / unit])
    wanted = MU * (2.0 - 2.0**-2) * BLOCK.area
    figure("a block pulled to twice its length", "force", last.state.P * solver.system.dead.units[0] / wanted - 1, 1e-9)


SOFTENING = Yeoh(10e3, -1100.0, 60.0, 0.5)


def nominal(law, x):
    """Uniaxial nominal stress of an incompressible solid at a stretch."""
    i = x**2 + 2 / x - 3
    return 2 * (x - x**-2) * (law.c1 + 2 * law.c2 * i + 3 * law.c3 * i**2)


def test_a_force_past_its_limit_point(body_of, figure):
    """A law that softens and stiffens again: the force ends there, and a travel passes it."""
    solver = solver_of(body_of, BLOCK, SOFTENING, PULL)
    most = minimize_scalar(lambda x: -nominal(SOFTENING, x), bounds=(1.2, 3.0), method="bounded", options={"xatol": 1e-10})
    top = nominal(SOFTENING, most.x) * BLOCK.area
    unit = solver.system.dead.units[0]

    def path(quantity):
        return Continuation(solver, QUANTITIES[quantity], start=load_from(solver, apply_preload(solver, [], print), 0))

    with pytest.raises(PathEnd) as end:
        list(trace(path("force"), [1.2 * top / unit]))
    assert end.value.limit is not None
    figure("the largest nominal stress of the law", "force at its limit", end.value.limit.state.P * unit / top - 1, 1e-9)
    points = list(trace(path("travel"), [(1.4 * most.x - 1) * BLOCK.length / solver.system.length_unit]))
    assert [point.limit for point in points].count(True) == 1
    held = nominal(SOFTENING, 1.4 * most.x) * BLOCK.area
    figure("the largest nominal stress of the law", "force past it", points[-1].state.P * unit / held - 1, 1e-9)
    assert not points[-1].stable_under_pressure
    with pytest.raises(PreloadFailure, match="limit point") as end:
        apply_preload(solver, [("the pull", magnitudes(solver, tip=1.2 * top))], lambda text: None)
    assert 0.5 < end.value.share < 0.9


DISK = HollowDisk(section="axisymmetric", cell_size=0.003)


def test_a_weight_on_a_disk(body_of, figure):
    """Loads and pressure in any order; with the loads kept, a path of the pressure starts where the disk hangs."""
    components = (Gravity(direction="-z"), Mass(face="top", amount=0.05, name="plate"))
    solver = solver_of(body_of, DISK, NeoHookean(30e3, 0.49), *components)
    system = solver.system
    amount = float(system.dead.amounts[0])
    assert amount == pytest.approx(9.81 * (0.05 + 1070 * DISK.solid_volume), rel=1e-4)
    weight = magnitudes(solver, gravity=amount)
    hung = apply_preload(solver, [("its weight", weight)], lambda text: None)
    assert hung.driven[1] > 0 and hung.driven[0] < system.scales()[0] * (1 + hung.driven[1])
    *_, last = trace(Continuation(solver, start=inflate_from(solver, hung)), [0.1])
    pressure = np.array([0.1, 0.0])
    other = apply_preload(solver, [("a pressure", pressure), ("the weight", pressure + weight)], lambda text: None)
    together = apply_preload(solver, [("all", pressure + weight)], lambda text: None)
    system.load(last.state)
    wanted = system.driven()
    figure("weight first, then pressure", "volume and sag", np.array([other.driven, together.driven]) / wanted - 1, 1e-8)


def test_several_masses_on_one_face(body_of):
    """Two of them hang as one of their sum does."""
    solvers = [
        solver_of(body_of, DISK, NeoHookean(30e3, 0.49), Gravity(direction="-z"), *masses)
        for masses in (
            [Mass(face="top", amount=0.05, name="plate"), Mass(face="top", amount=0.02, name="nut")],
            [Mass(face="top", amount=0.07, name="plate")],
        )
    ]
    both, one = (solver.system.dead.amounts[0] * solver.system.pressure_loads()[-1] for solver in solvers)
    np.testing.assert_allclose(both, one, rtol=1e-10, atol=1e-12 * np.abs(one).max())


@pytest.mark.campaign
def test_a_cantilever_in_large_deflection(body_of, figure):
    """Its weight first, then a force on its tip; and pure bending by a moment, on coarse cells, as thick as the beam."""
    components = (
        GRAVITY_OF_A_BEAM,
        Force(face="tip", direction="-z", name="tip"),
        Moment(face="tip", axis="-y", name="end"),
    )
    solver = solver_of(body_of, BEAM, STIFF, *components)
    fields, weight = Fields(solver), float(solver.system.dead.amounts[0])
    moment = 1.6 * 2 * STIFF.shear_modulus_0 * 1.49 * BEAM.width * BEAM.thickness**3 / 12 / BEAM.length
    for name, loads in (("weight", {}), ("weight and a force", {"tip": 0.3 * weight})):
        hung = apply_preload(solver, [(name, magnitudes(solver, gravity=weight, **loads))], lambda text: None)
        device = fields.figures(hung.state).device
        wanted = elastica(weight, loads.get("tip", 0.0))
        apart = np.array([device["tip_x_mm"], device["tip_z_mm"]]) * 1e-3 - wanted
        figure("a geometrically exact beam", f"place of the tip by its {name}, in deflections", apart / -wanted[1], 5e-3)
        assert -wanted[1] > 0.75 * BEAM.length
    hung = apply_preload(solver, [("a moment", magnitudes(solver, end=moment))], lambda text: None)
    device = fields.figures(hung.state).device
    angle = brentq(lambda t: t - 1.6 * np.cos(t), 0.0, 1.5)  # the forces keep their direction: M cos t is left
    wanted = BEAM.length / angle * np.array([np.sin(angle), 1 - np.cos(angle)])
    apart = np.array([device["tip_x_mm"], device["tip_z_mm"]]) * 1e-3 - wanted
    figure("an arc, by dead forces", "place of the tip by a moment, in deflections", apart / wanted[1], 1.5e-2)


GRAVITY_OF_A_BEAM = Gravity(direction="-z", density=1000.0)


def test_derivatives_with_a_weight(body_of, figure):
    """A weight keeps its newtons as the silicone changes: the volume's derivative at a pressure, against solved states."""
    solver = solver_of(body_of, DISK, NeoHookean(30e3, 0.49), Gravity(direction="-z"), Mass(face="top", amount=0.1))
    system, volumes = solver.system, []
    for mu in (30e3, 30.03e3, 29.97e3):
        system.set_material(NeoHookean(mu, 0.49))
        weight = magnitudes(solver, gravity=float(system.dead.amounts[0]))
        hung = apply_preload(solver, [("its weight", weight)], lambda text: None)
        *_, last = trace(Continuation(solver, start=inflate_from(solver, hung)), [3e3 / mu])
        volumes.append(last.state.V * system.volume_unit)
        if mu == 30e3:
            _, rates = Sensitivity(solver).rates(last.state, pressure_control(last.state.P), ["shear_modulus"])
    slope = (volumes[1] - volumes[2]) / 60.0
    figure(
        "differences of solved states",
        "derivative of a loaded disk's volume",
        rates["shear_modulus"].V / slope - 1,
        3e-5,
    )


def test_nothing_changes_without_loads(body_of):
    """The same numbers to the last digit: of a load that is there and does not act, too, but for rounding."""
    plain, loaded = (solver_of(body_of, DISK, NeoHookean(30e3, 0.49), *components) for components in ((), (PULL_TOP,)))
    found = [list(trace(Continuation(solver), [0.2])) for solver in (plain, loaded)]
    assert [point.state.V for point in found[0]] == pytest.approx([point.state.V for point in found[1]], rel=1e-12)


PULL_TOP = Force(face="top", direction="z", name="top")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Gravity(direction="down"), "'down' is not a direction; write one like -z"),
        (lambda: Gravity(direction="0, 0, 0"), "is not a direction"),
        (lambda: Gravity(direction="-z", density=-1.0), "density of -1 kg/m"),
        (lambda: Gravity(direction="-z", magnitude=0.0), r"\[gravity\]: magnitude is 0; it must be above zero"),
        (lambda: Gravity(direction="-x").check_on(DISK), "takes loads along its axis"),
        (
            lambda: Force(face="top", direction="y", name="up").check_on(HollowDisk()),
            r"\[force.up\]: its direction leaves",
        ),
        (lambda: Mass(face="top", amount=0.0, name="m"), "amount is 0; it must be above zero"),
    ],
)
def test_loads_that_cannot_be_meant(make, message):
    with pytest.raises(ComponentError, match=message):
        make()


@pytest.mark.parametrize(
    ("part", "message"),
    [
        (Force(face="lid", direction="z", name="up"), r"\[force.up\]: the mesh has no face named 'lid'; it has"),
        (Force(face="support", direction="z", name="up"), r"\[force.up\] acts only on held dofs"),
        (Gravity(direction="z", density=0.0), "gravity acts on no mass"),
    ],
)
def test_loads_that_are_not_on_the_mesh(body_of, part, message):
    with pytest.raises(ComponentError, match=message):
        System(body_of(ROD), NeoHookean(MU, 0.5), components=(part,))
