"""Pressures below ambient: closed integrals of walls that close, a tube that collapses onto itself, energy through zero.

A vacuum inside an incompressible body does what the same pressure from outside does: an even pressure on all its faces adds
nothing but itself to the stress. The ring's buckling pressure is therefore that of the exact incremental theory for a tube
under pressure from outside. Its branch is held against the elastica of an inextensible ring (Flaherty, Keller and Rubinow 1972,
doi 10.1137/0123047): closed with one constant, which is found here by shooting.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import root

import softmodels as sm
from geometries import Balloon, Bellows, Cylinder, HollowDisk
from softmodels.case.load import steps_of
from softmodels.components.contact import Walls
from softmodels.components.rigid import Rigid
from softmodels.materials.laws import MooneyRivlin, NeoHookean, Yeoh
from softmodels.materials.specimens import sphere_pressure
from softmodels.mechanics import newton
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path import schedule
from softmodels.path.continuation import follow
from softmodels.runs.fields import Fields
from tests.support import bodies, runs
from tests.support.campaigns import sampled
from tests.support.cavities import TubeBody
from tests.support.closed_forms import tube_pressure
from tests.support.ranks import mpirun

CLOSED = "closed integral of a thick incompressible wall under vacuum, radii 10 and 15 mm, closing to a stretch of 0.8"
RING = "elastica of an inextensible ring under vacuum"
SOFT = NeoHookean(100e3, 0.5)
STRETCHES = np.array([0.97, 0.9, 0.8])


def to_vacuum(equations):
    """The same equations for a path on which pressures and volumes fall."""
    system = equations.system
    system.direction = -1
    system.coupling = system.inflating(np.empty(0))
    return equations


@pytest.mark.parametrize(
    "body, kind, exact, power, most",
    sampled(
        [
            (bodies.Sphere(through=4, along=12), None, sphere_pressure, 3, 1e-4),
            (bodies.Tube(through=4), TubeBody, tube_pressure, 2, 1.5e-5),
        ],
        2,
    ),
    ids=["sphere", "tube"],
)
@pytest.mark.parametrize("law", sampled([SOFT, Yeoh(50e3, 1e3, 50.0, 0.5)]), ids=["neo-hookean", "yeoh"])
def test_walls_close_as_the_integral_says(body, kind, exact, power, most, law, equilibrium, solved, figure):
    equations = to_vacuum(equilibrium(body, law, **({"kind": kind} if kind else {})))
    rest = -equations.system.rest().V
    _, points, end = solved(equations, list((1 - STRETCHES**power) * rest), "volume", "volume")
    assert end is None
    found = -np.array([point.state.P for point in points if point.requested]) * equations.system.stress_unit
    wanted = exact(law, body.inner, body.outer, STRETCHES)
    assert (wanted < 0).all()
    figure(CLOSED, f"pressure of the {type(body).__name__.lower()}", found / wanted - 1, most)


THICKNESS, RADIUS = 0.0008, 0.01


def elastica():
    """A quarter of an inextensible ring that pressure from outside flattens; lengths in R, pressures in EI / R^3.

    Balance of the piece from the long half axis on gives the moment, and the curvature 1 + C + p r^2 / 2. The tangent turns by
    a right angle until the piece meets the short axis: that closes C and the long axis.

    Returns:
        Rising pressures, and the short half axis at each.
    """
    pressures, shorts, unknown = np.linspace(3.1, 5.3, 23), [], np.array([1.175, -1.52])

    def end(pressure, unknown):
        long, constant = unknown

        def slopes(s, y):
            return [math.cos(y[2]), math.sin(y[2]), 1.0 + constant + pressure / 2 * (y[0] ** 2 + y[1] ** 2)]

        return solve_ivp(slopes, (0.0, math.pi / 2), [long, 0.0, math.pi / 2], rtol=1e-10, atol=1e-12).y[:, -1]

    for pressure in pressures:
        found = root(lambda u, p=pressure: end(p, u)[[0, 2]] - [0.0, math.pi], unknown, tol=1e-10)
        assert found.success
        unknown = found.x
        shorts.append(end(pressure, unknown)[1])
    return pressures, np.array(shorts)


@pytest.fixture(scope="module")
def ring(body_of):
    """A quarter of a ring with room for two waves, whose inner wall may touch itself."""
    shape = bodies.Tube(
        section="quarter", inner=RADIUS - THICKNESS / 2, outer=RADIUS + THICKNESS / 2, through=1, height=THICKNESS
    )
    return to_vacuum(Solver(System(body_of(shape, TubeBody), SOFT, "mixed", [Walls("cavity")])))


@pytest.fixture(scope="module")
def collapse(ring, solved):
    """The ring's bifurcation, its branch until the walls have met, and the unit of pressure EI / R^3."""
    unit = 4 * SOFT.shear_modulus_0 * (THICKNESS / RADIUS) ** 3 / 12 / ring.system.stress_unit  # E / (1 - 1/4) is 4 mu
    path, points, _ = solved(ring, [3.3 * unit])
    (first,) = (point for point in points if point.bifurcation)
    return first, list(follow(path, first, farthest=5.6 * unit)), unit


@pytest.mark.campaign
def test_tube_buckles_as_a_ring(ring, collapse, figure):
    first, _, unit = collapse
    figure(RING, "buckling pressure, 3 EI / R^3", first.state.P / unit / 3 - 1, 5e-3)
    assert first.stable_under_pressure and (ring.system.volumes() > 0).all()


@pytest.mark.campaign
def test_buckled_tube_flattens_as_the_elastica(ring, collapse, figure):
    """Both ways along the mode are one, turned by a right angle."""
    _, branch, unit = collapse
    pressures, shorts = elastica()
    fields = Fields(ring)
    X = fields.grid.points[:, :2]
    ends = [np.flatnonzero(np.abs(X[:, axis]) < 1e-9) for axis in (0, 1)]
    wanted, found = CubicSpline(shorts[::-1], pressures[::-1]), []
    for point in branch:
        moved = X + fields.nodal(point.state)["displacement"][:, :2]
        short = min(np.linalg.norm(moved[at], axis=1).mean() for at in ends) / RADIUS
        if shorts[0] > short > 1.05 * THICKNESS / 2 / RADIUS:
            found.append(point.state.P / unit / wanted(short) - 1)
    assert len(found) > 2
    figure(RING, "pressure at a flattened height", found, 2e-2)


@pytest.mark.campaign
def test_flattened_tube_touches_itself(ring, collapse, figure):
    """Opposite walls meet where the elastica's half axis is half of the thickness; from there on they press on each other."""
    _, branch, unit = collapse
    pressures, shorts = elastica()
    wanted = float(CubicSpline(shorts[::-1], pressures[::-1])(THICKNESS / 2 / RADIUS))
    (walls,) = (term for name, term in ring.system.potential.terms.items() if "walls" in name)
    states = []
    for point in branch:
        ring.system.load(point.state)
        states.append((point.state.P / unit, walls.figures(ring.system)))
    pressed = [told["walls_contact_N"] > 0.0 for _, told in states]
    at = pressed.index(True)
    assert all(pressed[at:]) and max(told["walls_overlap_mm"] for _, told in states) == 0.0
    assert states[at - 1][0] < wanted < states[at][0] < 1.02 * wanted


def test_work_is_stored_through_zero(equilibrium, figure):
    """Down to a vacuum, up through ambient pressure to as much above it: one smooth curve, whose area is the energy."""
    equations = equilibrium(HollowDisk(section="axisymmetric"), NeoHookean(30e3, 0.49))
    system, goals = equations.system, (-60.0, -45.0, -30.0, -15.0, 0.0, 15.0, 30.0, 45.0, 60.0)
    down, up = [], []
    for share, point in schedule.follow(equations, steps_of(cavity1={"pressure_cm": goals})):
        # On the way down P and V rise as pressure and volume fall.
        P, sign = float(system.drives_at(point.state)[0]), 1 if share > 1.0 else -1
        here = P, sign * point.state.V, point.tangent.P / point.tangent.V
        system.load(point.state)
        (up if share > 1.0 else down).append((*here, system.stored_energy()))
    P, V, slope, energy = np.array([down[-1], *up]).T
    step = np.diff(V)
    work = np.cumsum(step * (P[:-1] + P[1:]) / 2 + step**2 * (slope[:-1] - slope[1:]) / 12)
    assert P[0] == pytest.approx(-P[-1]) and energy[0] > 0.5 * energy[-1] and energy.min() < 1e-12
    figure(
        "work of the pressure",
        "stored energy from -60 cm to 60 cm",
        (energy[1:] - energy[0] - work) / energy[0],
        1.8e-7,
    )


@pytest.mark.campaign
def test_two_ranks_collapse_a_cavity_alike(tmp_path):
    """Walls of the cavity meet at -60 cm by default, without a word in the case.

    Newton's attempts cycle where the walls first touch, and rounding decides which of them fails: steps between may differ.
    """
    words = ("-m", "softmodels.disk", "--section", "axisymmetric", "--pressure-cm", "0:-70", "--no-pictures", "--quiet")
    for ranks in (1, 2):
        launcher = (mpirun(), "-n", ranks) if ranks > 1 else ()
        done = runs.run(*words, "--output", tmp_path / str(ranks), launcher=launcher)
        assert done.status == 0, done.err
    one, two = (runs.rows(tmp_path / str(ranks)) for ranks in (1, 2))
    requested = [[{**row, "step": 0.0} for row in rows if row["requested"]] for rows in (two, one)]
    runs.same(*requested, 1e-8)
    touching = [next(row["pressure_cm"] for row in rows if row["walls_contact_N"]) for rows in (two, one)]
    assert abs(touching[0] - touching[1]) < 6.0  # a step
    assert one[-1]["pressure_cm"] == -70.0 and one[-1]["added_volume_ml"] < 0.0 < one[-1]["walls_contact_N"]
    assert all(row["stable_under_pressure"] for row in one)


@pytest.mark.campaign
def test_limit_of_a_vacuum_follows_the_modulus(figure):
    """A balloon collapses at a vacuum in proportion to its modulus, at a share of the thin sphere's classical pressure."""
    balloon = Balloon(cell_size=0.002, through=1)
    soft, stiff = (sm.limit(balloon, NeoHookean(modulus, 0.49), vacuum=True) for modulus in (30e3, 60e3))
    assert soft.kind in ("limit", "bifurcation") and soft.added_volume < 0.0
    figure("twice the limit of half the modulus", "limit of a vacuum", stiff.pressure / soft.pressure / 2 - 1, 1e-10)
    middle = balloon.radius + balloon.wall / 2
    classical = 2 * 3 * 30e3 * (balloon.wall / middle) ** 2 / math.sqrt(3 * (1 - 0.25))
    assert 0.2 < -soft.pressure / classical < 1.0


def test_a_shell_that_snaps_back_has_its_limit_named(equilibrium, solved, figure):
    """A sphere's path turns back in pressure and volume at nearly the same state, which their plane shows as a cusp."""
    balloon = Balloon(cell_size=0.002, through=1)
    equations = to_vacuum(equilibrium(balloon, NeoHookean(30e3, 0.49)))
    _, points, end = solved(equations, [0.1], largest_step=0.1 / 12)
    assert end.physical and end.limit in points
    at = points.index(end.limit)
    assert at < len(points) - 1 and not any(point.stable_under_pressure for point in points[at + 1 :])
    limit = sm.limit(balloon, NeoHookean(30e3, 0.49), vacuum=True).pressure
    figure(
        "limit of a vacuum",
        "pressure at which a balloon snaps back",
        -end.limit.state.P * equations.system.stress_unit / limit - 1,
        1e-6,
    )


@pytest.mark.campaign
def test_solves_that_do_not_get_nearer_end_early(monkeypatch, figure):
    """Folds of a bellows that press on each other: steps that are too long are given up after six iterations or a few more, not
    after fifteen, and the path ends where it ended with all of them."""
    ends, checked = [], newton.Newton._converged

    def recorded(self, snes, iteration, norms):
        reason = checked(self, snes, iteration, norms)
        if reason < 0:
            ends.append((int(reason), iteration))
        return reason

    monkeypatch.setattr(newton.Newton, "_converged", recorded)
    both = [sm.inflate(Bellows(), NeoHookean(30e3), "-25 cm", components=Walls("auto, cavity"))]
    stagnant = [iteration for reason, iteration in ends if reason == -8]
    assert len(stagnant) > 5 and np.median(stagnant) < 10
    monkeypatch.setattr(newton, "MAX_STAGNANT_ITERATIONS", 99)
    both.append(sm.inflate(Bellows(), NeoHookean(30e3), "-25 cm", components=Walls("auto, cavity")))
    assert [run.path["pressure_cm"][-1] for run in both] == [-25.0, -25.0]
    volume, without = (run.path["added_volume_ml"][-1] for run in both)
    figure("without the rule", "added volume of a bellows whose folds touch", volume / without - 1.0, 1e-9)


@pytest.mark.campaign
def test_a_thin_balloon_collapses_onto_its_neck(figure):
    """A cusp first, where long steps would leap to a part of the curve that has lost energy; then the edge of the neck presses
    into the wall above, which is beside that edge and not behind it."""
    balloon = Balloon(
        radius=7.13e-3, wall=0.729e-3, neck_radius=2.68e-3, neck_length=3.73e-3, fillet=0.484e-3, held="end",
        cell_size=0.42e-3, section="axisymmetric",
    )  # fmt: skip
    walls = Walls("auto, cavity")
    run = sm.inflate(balloon, NeoHookean(50.9e3, 0.49), "-40 cm", control="arc-length", components=walls)
    V, P, energy = (run.path[name] for name in ("added_volume_ml", "pressure_Pa", "stored_energy_mJ"))
    touching = int(np.flatnonzero(run.path["walls_contact_N"] > 0.0)[0])
    assert P.min() < -1700.0 and V[-1] < -1.43 and not run.path["jump"].any() and 10 < touching < len(V) - 10
    work = np.cumsum(np.diff(V) * (P[:-1] + P[1:]) / 2e3)
    figure("work of the pressure", "stored energy of a balloon that collapses", (energy[1:] - work) / energy[-1], 1e-2)


@pytest.mark.campaign
def test_a_step_beyond_a_limit_point_does_not_leap_to_where_the_walls_have_met(figure):
    """The volume at given pressure turns so sharply there that a smooth curve through both ends of a long step, which loses an
    eighth of the energy, would turn back."""
    balloon = Balloon(
        radius=25.03e-3, wall=1.095e-3, neck_radius=7.23e-3, neck_length=8.91e-3, fillet=1.765e-3, held="end",
        cell_size=1.65e-3, section="axisymmetric",
    )  # fmt: skip
    law, walls = MooneyRivlin(5461.0, 1365.0, 0.45), Walls("auto, cavity")
    run = sm.inflate(balloon, law, "-7 cm", control="pressure", components=walls)
    V, P, energy = (run.path[name] for name in ("added_volume_ml", "pressure_Pa", "stored_energy_mJ"))
    assert P.min() < -82.5 and V[-1] < -2.95
    work = np.cumsum(np.diff(V) * (P[:-1] + P[1:]) / 2e3)
    figure("work of the pressure", "stored energy beside a cusp of the path", (energy[1:] - work) / energy[-1], 1e-2)


@pytest.mark.campaign
def test_a_cap_is_sucked_along_a_stiff_tube(figure):
    """It lies against the wall from the corner on, in which it does not run into it."""
    tube = Cylinder(
        inner_radius=13.2e-3, wall=3e-3, length=96e-3, cap=6.4e-3, fillet=1.3e-3, section="axisymmetric", end="free",
        cell_size=3.75e-3,
    )  # fmt: skip
    parts = Walls("auto, cavity"), Rigid(name="wall", kind="held", region="wall")
    run = sm.inflate(tube, MooneyRivlin(22043.0, 5511.0, 0.49), "-160 cm", components=parts)
    assert run.path["pressure_cm"][-1] == pytest.approx(-160.0) and run.path["end_mm"][-1] < -7.0
    least = np.nanmin(run.path["least_gap_mm"])  # empty while no walls are near
    figure("a gap of 0", "overlap of a cap with its tube, per wall", -least / 3.0, 3e-2)
    assert not run.path["walls_touch"].any()
