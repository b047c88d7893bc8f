"""Rigid parts and all else that is added to a device, by iterations: the direct solver's states, as cheap as without parts."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import softmodels as sm
from softmodels.case.case import Case
from softmodels.cli.run import run
from softmodels.common.commands import RunOptions
from softmodels.components.loads import Force
from softmodels.components.rigid import Rigid
from softmodels.mechanics.controls import pressure_control
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path.schedule import apply_preload
from softmodels.path.stability import Stability
from tests.support.campaigns import sampled

DIRECT = "the direct solver"
WITHOUT = "the same device without its parts"
METHODS = ("direct", "iterative")
UNLIKE = ("step", "control", "newton_iterations", "lowest_eigenvalue_Pa_per_mm2")
"""Columns of a path that are not the state's own, and the one that has a bound of its own."""
LAW = sm.NeoHookean(30e3, 0.49)
MEMBRANE = sm.Membrane(
    radius=0.02, thickness=0.001, clamp_width=0.0, plate_radius=0.005, rings=(0.008, 0.011), ring_thickness=0.001
)
WEDGE = sm.HollowDisk(angle=15.0, cell_size=0.008, fillet=0.0, base_fillet=0.0)
SECTION = sm.HollowDisk(section="axisymmetric", cell_size=0.003)
BEAM = sm.Beam(length=0.020, width=0.004, thickness=0.004, part="full", cell_size=0.004)
PLATE, RING = Rigid("plate", name="plate"), Rigid(region="ring1", name="ring")
RIGID = {
    "plate and rigid ring on a membrane": (MEMBRANE, (PLATE, RING), "mixed", (0.01, 0.02)),
    "plate on a wedge": (WEDGE, (Rigid("top", name="plate"),), "mixed", (0.1, 0.2)),
    "guided plate on a wedge, displacements alone": (
        WEDGE, (Rigid("top", kind="guided", name="plate"),), "displacement", (0.1, 0.2)
    ),
    "still plate on a wedge": (WEDGE, (Rigid("top", kind="held", name="plate"),), "mixed", (0.1, 0.2)),
}  # fmt: skip


def inflated(system, method, pressures):
    """The solver, the state at the last of some pressures, and the lowest eigenvalue there."""
    solver, state = Solver(system, method), system.rest()
    for pressure in pressures:
        solver.factorise(state)
        state = solver.solve(pressure_control(pressure), state.w, pressure)
    solver.factorise(state)
    return solver, state, Stability.of(solver).lowest()


def iterations(solver, state):
    """Of a solve at a state, to 1e-7."""
    solver.lagged.invalidate()  # a set-up of this state, not of one before
    system, b = solver.system, solver.system.K.createVecRight()
    solver.factorise(state)
    b.array_w[:] = system.pressure_loads()[0]
    return solver.bordered.iterate(b, b.duplicate(), 1e-7)


@pytest.mark.campaign
@pytest.mark.parametrize("case", sampled(RIGID))
def test_rigid_parts(case, body_of, figure):
    device, components, formulation, pressures = RIGID[case]
    systems = [System(body_of(device), LAW, formulation, components=own) for own in (components, components, ())]
    (_, one, low), (solver, other, lowest) = (
        inflated(system, method, pressures) for system, method in zip(systems, METHODS, strict=False)
    )
    assert solver.method.name == "iterative"
    figure(DIRECT, f"volume by iterations, {case}", other.V / one.V - 1, 1e-9)
    figure(DIRECT, f"displacements by iterations, {case}", np.abs(other.w - one.w).max() / np.abs(one.w).max(), 1e-8)
    figure(DIRECT, f"lowest eigenvalue by iterations, {case}", lowest / low - 1, 1e-6)
    assert Stability.of(solver).negative_eigenvalues() == 0
    without, plain, _ = inflated(systems[2], "iterative", pressures)
    figure(WITHOUT, f"iterations of a solve, {case}", iterations(solver, other) / iterations(without, plain), 1.5)


@pytest.mark.campaign
def test_a_plate_that_turns(body_of, figure):
    """By more than 45 degrees: the unknowns of a state count from another rotation than those that the cycle was made for."""
    pushed = [Rigid("tip", name="plate"), Force("tip", "-z", 0.02, name="down"), Force("tip", "y", 0.01, name="aside")]
    found = []
    for method in METHODS:
        solver = Solver(System(body_of(BEAM), LAW, components=pushed), method)
        dead = solver.system.dead
        found.append(apply_preload(solver, [("the forces", dead.amounts / dead.units)]).state)
    one, other = found
    turn = np.trace(solver.system.unknowns.moving["plate"].rotation)
    assert math.degrees(math.acos((turn - 1) / 2)) > 45.0
    apart = np.abs(other.w - one.w).max() / np.abs(one.w).max()
    figure(DIRECT, "displacements by iterations, plate that turns on a beam", apart, 1e-8)


def test_a_cycle_leaves_still_dofs_alone(body_of):
    """What follows a part has no residual: it would drift from guess to guess."""
    system = System(body_of(MEMBRANE), LAW, components=[PLATE, RING])
    solver = Solver(system, "iterative")
    solver.factorise(system.rest())
    b, x = system.K.createVecRight(), system.K.createVecRight()
    b.array_w[:] = np.random.default_rng(0).normal(size=system.n)
    solver.bordered.inverse.apply(b, x)
    for still in (system.unknowns.idle, np.concatenate([bc.dof_indices()[0] for bc in system.bcs])):
        assert len(still)
        np.testing.assert_array_equal(x.array_r[still], b.array_r[still])


@pytest.mark.campaign
def test_friction(body_of, figure):
    """Newton's product is unsymmetric. The steps are given: what friction has held depends on them."""
    ball = sm.RigidShape("sphere", "top", (0.0, 0.0, 0.026), radius=0.010, friction=0.3, name="ball")
    ways = []
    for method in METHODS:
        solver = Solver(System(body_of(SECTION), LAW, components=[ball]), method)
        system = solver.system
        state = system.rest()
        system.potential.commit(state.w, reset=True)
        for pressure in np.linspace(0.02, 0.2, 10):
            solver.factorise(state)
            state = solver.solve(pressure_control(pressure), state.w, pressure)
            system.potential.commit(state.w)
        ways.append(state.w)
        assert system.assembled.remembers
    figure(
        DIRECT,
        "displacements by iterations, friction on a ball",
        np.abs(np.subtract(*ways)).max() / np.abs(ways[0]).max(),
        1e-8,
    )


PLATED = """
[geometry]
device = "Membrane"
clamp_width = "5 mm"
plate_radius = "8 mm"
[rigid.plate]
face = "plate"
mass = "20 g"
[gravity]
direction = "-z"
"""
CASES = {
    "disk on a ball": """
[geometry]
device = "HollowDisk"
section = "axisymmetric"
[load]
pressure_cm = "0,120"
[contact.ball]
shape = "sphere"
faces = "top"
at = ["0 mm", "0 mm", "26.5 mm"]
radius = "10 mm"
""",
    "bellows on a ball that gives way": """
[geometry]
device = "Bellows"
cell_size = "4 mm"
[contact.cell]
shape = "sphere"
faces = "tip"
at = ["0 mm", "0 mm", "85 mm"]
radius = "50 mm"
guide = "z"
spring = "5 N/mm"
[load]
pressure = "0,3 kPa"
""",
    "muscle with slack fibres that lifts a mass": """
[geometry]
device = "Cylinder"
[fibres.braid]
on = "outer"
angle = "30 deg"
stiffness = "10 kN/m"
slack = true
[gravity]
direction = "z"
[mass.load]
face = "end"
amount = "200 g"
[material]
silicone = "dragon-skin-10-medium"
[load]
pressure = "0,40 kPa"
""",
    "plate with its weight held at a height": PLATED
    + """
[force.cell]
face = "plate"
direction = "z"
[material]
silicone = "dragon-skin-10-medium"
[load]
gravity = [0, 1, 1]
force.cell.travel_mm = [8, 8, 8]
cavity1.pressure_cm = [0, 0, 40]
""",
    "plate that a membrane lifts past its limit points": PLATED
    + """
[material]
silicone = "ecoflex-00-30"
[load]
volume_ml = "0,10,30"
""",
}


@pytest.mark.campaign
@pytest.mark.parametrize("name", sampled(CASES))
def test_other_parts(name, figure):
    """Whole paths from a case file, requested states compared column by column with what each column has at most."""
    case = Case.from_toml(CASES[name])
    runs = [sm.run(dataclasses.replace(case, solver=method)) for method in METHODS]
    tables = [[row for row in one.rows if row["requested"]] for one in runs]
    one, other = ({key: np.array([row[key] for row in rows], float) for key in rows[0] if key not in UNLIKE} for rows in tables)
    apart = max(np.abs(other[key] - one[key]).max() / max(np.abs(one[key]).max(), 1e-12) for key in one)
    figure(DIRECT, f"all of path.csv by iterations, {name}", apart, 1e-8)
    low = [np.array([row["lowest_eigenvalue_Pa_per_mm2"] for row in rows]) for rows in tables]
    figure(DIRECT, f"lowest eigenvalues by iterations, {name}", low[1] / low[0] - 1, 1e-5)


STIFF = """
[geometry]
device = "PneuNet"
chambers = 2
base = "3 mm"
paper = "0.2 mm"
cell_size = "5 mm"
[region.paper]
law = "neo-hookean"
young = "40 GPa"
poisson = 0.3
[load]
pressure = "0,4 kPa"
[solver]
method = "iterative"
"""


@pytest.mark.campaign
def test_what_iterations_do_not_solve_ends_in_a_sentence(tmp_path, capsys):
    """Paper half a million times stiffer than the silicone, in flat cells."""
    assert run(Case.from_toml(STIFF), tmp_path / "finger", RunOptions(no_pictures=True)) == 1
    said = capsys.readouterr().err
    assert "multigrid may fail if one material is much stiffer than another" in said
    assert 'use solver="direct"' in said and "Traceback" not in said
