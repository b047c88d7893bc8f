"""A rigid plate with a weight on an inflated membrane, against the membrane equations solved by shooting (`membrane_shooting`).

The equations know no bending and no thickness; a membrane of thickness t bends at the plate and at the clamp within about t.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from geometries import Membrane
from softmodels import inflate, silicone
from softmodels.components import creases
from softmodels.components.loads import Force, Gravity
from softmodels.components.rigid import Rigid
from softmodels.materials.laws import NeoHookean, Yeoh
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System, _nodes_of
from softmodels.path.continuation import Continuation, LoadedState, trace
from softmodels.path.schedule import Stage, apply_preload, inflate_from
from softmodels.path.stability import QUANTITIES
from tests.support import bodies, membrane_shooting as shooting
from tests.support.campaigns import sampled

RADIUS, PLATE, MU, G = 0.020, 0.008, 30e3, 9.80665
AT = (0, 4, 8, 14, 20)
HEIGHTS = np.linspace(0.2, 1.4, 25)[list(AT)] * RADIUS  # 0.2, 0.4, 0.6, 0.9 and 1.2 radii
CASES = {
    "neo-hookean, thin, light": (NeoHookean(MU, 0.5), (15e3,), 0.005, 0.3),
    "neo-hookean, thin, heavy": (NeoHookean(MU, 0.5), (15e3,), 0.005, 0.7),
    "yeoh, thick": (Yeoh(15e3, 300.0, 20.0, 0.5), (15e3, 300.0, 20.0), 0.03, 0.5),
}
"""Law, its numbers in the membrane equations, thickness over radius, and weight over 2 pi a t mu."""
EQUATIONS = "the membrane equations by shooting, with a rigid plate and its weight"


class Plated:
    """A membrane with a plate, a weight on it, and a load cell that can hold it."""

    def __init__(self, case, body_of):
        law, numbers, ratio, share = case
        self.thickness, self.weight = ratio * RADIUS, share * 2 * math.pi * PLATE * ratio * RADIUS * MU
        membrane = Membrane(
            radius=RADIUS, thickness=self.thickness, plate_radius=PLATE, clamp_width=0.0,
            cell_size=min(8 * self.thickness, 1e-3),
        )  # fmt: skip
        exact = shooting.CircularMembrane(RADIUS, self.thickness, shooting.Yeoh(*numbers), PLATE, self.weight)
        path = exact.path(np.linspace(0.2, 1.4, 25) * RADIUS)
        self.exact, self.limit = [path[k] for k in AT], shooting.limit(path)
        plate = Rigid("plate", name="plate", mass=self.weight / G)
        self.solver = Solver(
            System(body_of(membrane), law, components=[plate, Gravity("-z", density=0.0), Force("plate", "z", name="cell")])
        )
        self.system = self.solver.system

    @property
    def loads(self):
        """The drivers' magnitudes with the weight alone, dimensionless."""
        return np.array([0.0, self.weight / self.system.dead.units[0], 0.0])

    def height(self, state):
        self.system.load(state)
        return self.system.unknowns.moving["plate"].values[0] * RADIUS

    def inflated(self):
        """Points of the path from where it hangs, through the volumes that the membrane equations have at `HEIGHTS`."""
        start = inflate_from(self.solver, apply_preload(self.solver, [("the weight", self.loads)], lambda text: None))
        goals = [one.volume / self.system.volume_unit for one in self.exact]
        path = Continuation(self.solver, QUANTITIES["volume"], "volume", 0.05 * goals[-1], start=start)
        return start, list(trace(path, goals))

    def held_at(self, height):
        """Force of the load cell that holds the plate at a height, at the pressure that the membrane equations have there."""
        here = apply_preload(self.solver, [("the weight", self.loads)], lambda text: None)
        pressure = next(one.pressure for one in self.exact if math.isclose(one.height, height))
        for change in ([0.0, 0.0, height / RADIUS - here.driven[2]], [pressure / MU, 0.0, 0.0]):
            stage = Stage.between(here, np.array(change), (2,), here.driven)
            *_, (_, last) = stage.follow(self.solver, "auto", lambda text: None)
            here = LoadedState.at(self.solver.system, last.state)
        return here


@pytest.fixture(scope="module", params=sampled(CASES.values(), whole=True), ids=CASES)
def plated(request, body_of):
    made = Plated(request.param, body_of)
    return made, *made.inflated()


def test_pressure_and_height_are_the_membrane_equations(plated, figure):
    made, start, points = plated
    assert made.height(start) < -0.05 * RADIUS  # it hangs
    asked = [point for point in points if point.requested and point.tangent is not None and point.state.V > start.V]
    assert len(asked) == len(HEIGHTS)
    found = np.array([(point.state.P * MU, made.height(point.state)) for point in asked])
    shares = found / [(one.pressure, one.height) for one in made.exact] - 1
    if made.thickness < 0.01 * RADIUS:
        figure(EQUATIONS, "pressure at heights of 0.2 to 1.2 radii, same volume, 0.005", shares[:, 0], 0.01)
        figure(EQUATIONS, "height of the plate there, 0.005", shares[:, 1], 0.01)
    else:
        figure(EQUATIONS, "pressure at heights of 0.9 and 1.2 radii, same volume, 0.03", shares[3:, 0], 0.02)
        figure(EQUATIONS, "height of the plate there, 0.03", shares[3:, 1], 0.015)


def test_its_limit_point(plated, figure):
    made, _, points = plated
    if made.limit is None:
        assert not any(point.limit for point in points)
        return
    found = next(point for point in points if point.limit)
    figure(EQUATIONS, "limit pressure", found.state.P * MU / made.limit[1] - 1, 3e-3)
    assert found.signature.negative_eigenvalues == 0 and points[-1].signature.negative_eigenvalues == 1


def test_the_weight_works_too(plated, figure):
    """Stored is what the air has worked less what the weight has been lifted by."""
    made, start, points = plated
    system, ends = made.system, []
    for state in (start, points[-1].state):
        height = made.height(state)
        ends.append((system.stored_energy() * MU * RADIUS**3, height))
    V, P = (np.array([getattr(point.state, name) for point in points]) for name in "VP")
    slopes = [point.tangent.P / point.tangent.V for point in points]
    order = np.argsort(V)
    work = CubicHermiteSpline(V[order], P[order], np.array(slopes)[order]).integrate(V.min(), V.max()) * MU * RADIUS**3
    stored, lifted = np.subtract(ends[1], ends[0])
    figure(
        "work of the air and of the weight",
        "energy stored by a loaded membrane",
        (work - made.weight * lifted) / stored - 1,
        2e-5,
    )


@pytest.mark.campaign
def test_a_load_cell_at_a_given_height(body_of, figure):
    """The plate held at a height, and the air's pressure raised to what the equations have there: the cell bears nothing."""
    made = Plated(CASES["neo-hookean, thin, light"], body_of)
    here = made.held_at(HEIGHTS[2])
    assert made.height(here.state) == pytest.approx(HEIGHTS[2], rel=1e-8)
    force = here.drives[2] * made.system.dead.units[1]
    figure(EQUATIONS, "force on a load cell at a given height, over the weight", force / made.weight, 0.01)


WIDE = Membrane(radius=0.070, thickness=0.002, plate_radius=0.0254, chamber_depth=0.1)
"""That of Campbell and others, arXiv 2504.01156; `tests/benchmarks/plated_membranes.py` has more weights and silicones."""


@pytest.mark.campaign
def test_the_default_mesh_turns_over_its_clamp(figure):
    """To a height of a radius with 1.5 kg, where a sharp edge of the clamp would fold a few cells at 741 ml."""
    law, weight = silicone("ecoflex-00-30/liao-2021"), 1.5 * 9.81
    exact = shooting.CircularMembrane(
        WIDE.radius, WIDE.thickness, shooting.Yeoh(law.c1, law.c2, law.c3), WIDE.plate_radius, weight
    )
    path = exact.path(np.linspace(0.3, 1.05, 26) * WIDE.radius)
    components = (Rigid("plate", name="plate", mass=1.5), Gravity("-z", density=0.0))
    run = inflate(WIDE, law, volumes="500,800,1300 ml", components=components)
    assert run.limit is None
    asked = [row for row in run.rows if row["requested"]]
    found = np.array([(row["pressure_Pa"], row["plate_z_mm"] * 1e-3) for row in asked])
    volumes = [one.volume for one in path]
    columns = ([one.pressure for one in path], [one.height for one in path])
    there = np.column_stack([np.interp([5e-4, 8e-4, 1.3e-3], volumes, values) for values in columns])
    shares = found / there - 1
    figure(EQUATIONS, "pressure at 500, 800 and 1300 ml, a membrane of 70 mm with 1.5 kg", shares[:, 0], 0.015)
    figure(EQUATIONS, "height of its plate there", shares[:, 1], 0.015)


def test_a_motion_of_the_whole_is_no_fold_of_the_mesh(body_of):
    """How many cells take part in a bend of the whole, and in a shift of one node."""
    system = System(body_of(Membrane(cell_size=2e-3)), NeoHookean(MU, 0.5))
    _, dofs, places = _nodes_of(system.space)
    bent, one = np.zeros(system.dofs), np.zeros(system.dofs)
    bent[dofs[:, 1]] = np.cos(np.pi * places[:, 0])
    one[dofs[len(dofs) // 2, 1]] = 1.0
    whole, part = creases.MotionConcentration(system, bent), creases.MotionConcentration(system, one)
    assert not whole.local and whole.cells > 0.3 * len(system.cells)
    assert part.local and part.cells < 6


@pytest.mark.parametrize(
    "section, stretches, known",
    sampled(
        [
            ("cube", (0.6, 1.0, 1 / 0.6), (0.6, 0.647)),
            ("cube", (0.7, 1.0, 1 / 0.7), None),
            ("cube", (0.7, 0.8, 1 / 0.56), (0.7, 0.647 / math.sqrt(0.8))),
            ("axisymmetric", (0.74, 0.74, 0.74**-2), (0.74, 0.647 / math.sqrt(0.74))),
            ("axisymmetric", (0.76, 0.76, 0.76**-2), None),
        ]
    ),
)
def test_a_surface_creases_from_a_compression_of_a_third_on(section, stretches, known, body_of):
    """Of a quarter if it is compressed both ways; the face across it that is stretched does not. None of its facets is folded
    onto itself as long as none turns over."""
    body = body_of(bodies.Block(section=section))
    system = System(body, NeoHookean(MU, 0.5))
    _, dofs, places = _nodes_of(system.space)
    one, rest = np.zeros(system.dofs), system.rest()
    corner = places.sum(axis=1).argmax()
    one[dofs[corner, -1]] = 1.0
    fold, w = creases.MotionConcentration(system, one), rest.w.copy()
    moved = places * (np.array(stretches)[[0, 1, 2] if section == "cube" else [0, 2]] - 1.0)
    w[dofs] = moved @ body.skew.T
    system.load(dataclasses.replace(rest, w=w))
    found = creases.find_crease(system, fold.part)
    assert (found is None) == (known is None)
    assert creases.find_crease(system) is None
    if known is None:
        return
    at = "stretch of {:.2f}, and creases from about {:.2f} on".format(*known)
    assert "surface creases at" in found.clause and at in found.clause
    # The node between two corners of a facet, moved past the other one, turns the surface over behind it.
    near = np.abs(places[:, -1] - places[corner, -1]) < 1e-12
    apart = np.linalg.norm(places - places[corner], axis=1)
    between = np.flatnonzero(near)[np.argsort(apart[near])[1]]
    w[dofs[between]] -= 0.72 * (moved + places)[[corner, between]].T @ [1.0, -1.0] @ body.skew.T
    system.load(dataclasses.replace(rest, w=w))
    assert "surface is folded onto itself at" in creases.find_crease(system).clause
