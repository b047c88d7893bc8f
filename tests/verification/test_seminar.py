"""The seminar actuator's motion, on coarse meshes: what symmetry demands, and what the thesis saw on the bench."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from geometries import SeminarActuator
from softmodels.materials.silicones import SILICONES
from softmodels.mechanics.controls import pressure_control
from softmodels.mechanics.system import held_force
from softmodels.runs.fields import Fields

MIRRORED = "the slab, by the mirrored one on the mirrored mesh"
HALVED = "the full slab, by its half"
LAW = SILICONES["ecoflex-00-30/marechal-2021"].material
COARSE = {"channels": 1, "spread": 20.0, "around": 6.0, "cell_size": 0.006}
PRESSURES = (3e3, 6e3)


@pytest.fixture(scope="module")
def inflated(equilibrium, solved):
    """Return a function that inflates a coarse slab through `PRESSURES`: its figures there."""
    known = {}

    def inflate(**changes):
        slab = SeminarActuator(**COARSE, **changes)
        if slab not in known:
            equations = equilibrium(slab, LAW)
            _, points, end = solved(equations, [P / equations.system.stress_unit for P in PRESSURES])
            assert end is None
            fields = Fields(equations)
            known[slab] = [fields.figures(point.state) for point in points if point.requested]
        return known[slab]

    return inflate


def lifts(figures):
    return np.array([figure.device["tip_z_mm"] for figure in figures])


@pytest.mark.campaign
def test_off_the_middle_it_lifts_away_from_the_channels(inflated):
    assert np.all(lifts(inflated()) > 0) and SeminarActuator().offset < 0


@pytest.mark.campaign
def test_channels_in_the_middle_lift_nothing(inflated, figure):
    """Its mesh is mirrored too, so that nothing tells top from bottom."""
    against = "lift of the eccentric slab"
    figure(against, "lift, channels in the middle", lifts(inflated(offset=0.0)) / lifts(inflated()), 1e-8)


@pytest.mark.campaign
def test_mirrored_channels_lift_the_other_way(inflated, comm, solved, tmp_path, figure):
    """The mirrored slab on the mirror image of the mesh, node by node: what is left is the solver's tolerance."""
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System

    file = SeminarActuator(**COARSE).write(tmp_path / "slab.msh")
    body = Body.from_file(SeminarActuator(**COARSE, offset=-SeminarActuator().offset), file, comm)
    body.mesh.geometry.x[:, 2] *= -1.0
    equations = Solver(System(body, LAW))
    _, points, end = solved(equations, [P / equations.system.stress_unit for P in PRESSURES])
    fields = Fields(equations)
    mirrored = [fields.figures(point.state) for point in points if point.requested]
    assert end is None
    for plain, image in zip(inflated(), mirrored, strict=True):
        figure(MIRRORED, "lift", image.device["tip_z_mm"] / -plain.device["tip_z_mm"] - 1, 3e-12)
        figure(MIRRORED, "tip along the slab", image.device["tip_x_mm"] / plain.device["tip_x_mm"] - 1, 1e-12)
        figure(MIRRORED, "added volume", image.added_volume / plain.added_volume - 1, 1e-12)
        assert image.max_stretch_at == pytest.approx(np.array(plain.max_stretch_at) * (1, 1, -1), abs=1e-9)


@pytest.mark.campaign
def test_half_is_the_full_slab(inflated, figure):
    """The full slab's cells are the half's and their images: what is left is the solver's tolerance."""
    for half, full in zip(inflated(), inflated(part="full"), strict=True):
        for name, value in half.device.items():
            figure(HALVED, "tip's columns", full.device[name] / value - 1, 1e-7)
        figure(HALVED, "added volume", full.added_volume / half.added_volume - 1, 5e-11)
        figure(HALVED, "stored energy", full.stored_energy / half.stored_energy - 1, 8e-11)
        figure(HALVED, "largest stretch", full.max_stretch / half.max_stretch - 1, 1e-10)


def test_motion_grows_faster_than_the_pressure(inflated):
    found = inflated()
    for (P, before), (Q, after) in itertools.pairwise(zip(PRESSURES, found, strict=True)):
        assert after.device["tip_z_mm"] / before.device["tip_z_mm"] > 1.1 * Q / P
        assert after.added_volume / before.added_volume > 1.05 * Q / P


def test_figures_tell_of_one_tip(inflated):
    slab = SeminarActuator(**COARSE)
    for figure in inflated():
        x, z = figure.device["tip_x_mm"], figure.device["tip_z_mm"]
        assert z == pytest.approx(500 * (figure.rises["tip"] + figure.rises["tip_below"]), rel=1e-12)
        assert figure.device["lift_angle_deg"] == pytest.approx(np.degrees(np.arctan2(z, x)), rel=1e-12)
        # The largest stretch is at the wall of a channel: within one cell of the channels' plane, inside the slab.
        at = np.array(figure.max_stretch_at)
        assert 0 < at[0] < slab.length and abs(at[2] - slab.offset) < 2 * slab.end_bore


@pytest.mark.campaign
def test_sheet_on_the_thin_side_lessens_the_stretch(body_of, solved, inflated):
    from softmodels.components.fibres import Sheet
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System

    plain = inflated()[-1]
    equations = Solver(System(body_of(SeminarActuator(**COARSE)), LAW, components=[Sheet("bottom", 1000.0)]))
    _, points, end = solved(equations, [PRESSURES[-1] / equations.system.stress_unit])
    with_sheet = Fields(equations).figures(points[-1].state)
    assert end is None
    assert with_sheet.max_stretch < plain.max_stretch and with_sheet.added_volume < plain.added_volume
    # A side that cannot grow long bends the slab towards itself: the motion turns round.
    assert with_sheet.device["tip_z_mm"] < 0 < plain.device["tip_z_mm"]


def test_stiffness_is_the_tangents(equilibrium, solved, figure):
    """A dead load a little along its own motion leaves that much of itself unbalanced; and it is a unit load."""
    from softmodels.mechanics.system import face_load

    slab = SeminarActuator(**COARSE)
    equations = equilibrium(slab, LAW)
    _, points, _ = solved(equations, [P / equations.system.stress_unit for P in PRESSURES])
    fields, state = Fields(equations), points[-1].state
    told = [fields.figures(point.state).device["tip_stiffness_N_per_m"] for point in points if point.requested]
    load = face_load(equations.system, "tip", slab.lift)
    lift = int(np.argmax(equations.system.body.skew @ np.asarray(slab.lift)))
    vectors = equations.system.space.sub(0).sub(lift).collapse()[1]
    assert load[vectors].sum() == pytest.approx(1.0, rel=1e-9) and load.sum() == pytest.approx(1.0, rel=1e-9)

    compliance = equations.dead_load_compliance(state, load)
    free = equations.system.by_unknowns(load).copy()
    motion = equations.aside(state, pressure_control(0.0), free, 1e-8).w[: equations.system.n]
    unit = equations.system.stress_unit * equations.system.length_unit * slab.copies
    assert told[-1] == pytest.approx(unit / compliance, rel=1e-9)

    def unbalanced(step):
        equations.system.load(state)
        equations.system.w.x.array[: equations.system.n] += step * motion
        inner = equations.system.internal_forces().copy()
        return inner - state.P * equations.system.pressure_loads()[0]

    step = 1e-5
    slope = (unbalanced(step) - unbalanced(-step)) / (2 * step)
    left = np.linalg.norm(slope - load) / np.linalg.norm(load)
    figure("a unit load at the slab's tip", "forces along its own motion, by differences", left, 4.5e-5)
    # A triangular leaf spring of one stress all along: 2 E I / L^3, I at the base. The slab's tip is round and wider.
    leaf = 6 * LAW.shear_modulus_0 * slab.base_width * slab.thickness**3 / 12 / slab.length**3
    assert told[0] == pytest.approx(leaf, rel=0.25)


def test_held_tip_pushes(inflated, equilibrium):
    """The blocked force is the slope of the energy against the hold: it grows with the pressure and pushes up."""
    held = inflated(tip="held")
    forces = np.array([figure.device["blocked_force_N"] for figure in held])
    assert np.abs(lifts(held)).max() < 1e-9
    assert np.all(forces > 0) and np.all(np.diff(forces) > 0)
    # A free tip carries nothing.
    slab = SeminarActuator(**COARSE)
    equations = equilibrium(slab, LAW)
    from softmodels.path.continuation import Continuation, trace

    *_, last = trace(Continuation(equations), [PRESSURES[-1] / equations.system.stress_unit])
    equations.system.load(last.state)
    unit = equations.system.stress_unit * equations.system.length_unit**2 * slab.copies
    lift = int(np.argmax(equations.system.body.skew @ np.asarray(slab.lift)))
    assert abs(held_force(equations.system, "tip", lift) * unit) < 1e-6 * forces[-1]
    # All that the clamp carries along z balances the pressure alone: a closed cavity pulls nothing.
    assert abs(held_force(equations.system, "support", lift) * unit) < 1e-6 * forces[-1]
