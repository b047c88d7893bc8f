"""Rigid parts: the constraint is exact, its tangent and its inertia are those of the dofs left free."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import softmodels as sm
from softmodels.case.case import Case, CaseError
from softmodels.mechanics.controls import pressure_control
from softmodels.mechanics.parts import PartError
from softmodels.mechanics.rigid import Rigid
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path.stability import Stability

DISK = sm.HollowDisk(section="axisymmetric", cell_size=0.002)
LAW = sm.NeoHookean(28e3)
PLATE = Rigid("top", name="plate")
FREE = "the same state's forces on all dofs"


@pytest.fixture(scope="module")
def plated(body_of):
    """A disk whose top is a free rigid plate, at a pressure: its solver and the state."""
    solver = Solver(System(body_of(DISK), LAW, parts=[PLATE]))
    state = solver.system.rest()
    for pressure in (0.1, 0.2):
        solver.factorise(state)
        state = solver.solve(pressure_control(pressure), state.w, pressure)
    return solver, state


def followers(system):
    """Owned dofs on the plate, by component."""
    motion = system.unknowns.moving["plate"]
    return motion.dofs[motion.owned]


def selection(system):
    """T as a dense matrix: columns of the free dofs and one for the plate's rise, built from the dofs' numbers alone."""
    on_plate = followers(system)
    held = np.concatenate([bc.dof_indices()[0] for bc in system.bcs])
    free = np.setdiff1d(np.arange(system.n), np.concatenate([on_plate.ravel(), held]))
    T = np.zeros((system.n, len(free) + 1))
    T[free, np.arange(len(free))] = 1.0
    z = int(np.argmax(system.body.skew @ [0.0, 1.0]))
    T[on_plate[:, z], -1] = 1.0
    return T


def dense(matrix):
    rows, columns, values = matrix.getValuesCSR()
    found = np.zeros((len(rows) - 1, len(rows) - 1))
    found[np.repeat(np.arange(len(rows) - 1), np.diff(rows)), columns] = values
    return found


def test_the_face_moves_as_one_and_its_forces_cancel(plated, figure):
    """What makes a state one of equilibrium with a free rigid plate, from the whole body's forces."""
    solver, state = plated
    system = solver.system
    system.load(state)
    rises = state.w[followers(system)] @ system.body.skew_inverse.T
    assert np.ptp(rises, axis=0).max() == 0.0 and not rises[:, 0].any() and abs(rises[0, 1]) > 1e-3
    residual, scale = system.residual(), np.abs(system.residual()).max()
    assert scale > 0.01  # on single dofs of the plate
    figure(
        FREE, "force left on a free dof or on a rigid plate", np.abs(selection(system).T @ residual).max() / scale, 1e-9
    )


def test_tangent_and_inertia_are_those_of_the_free_dofs(plated, figure):
    """K, its product, its negative eigenvalues and its lowest one, against a dense T^T K T."""
    solver, state = plated
    system, stability = solver.system, Stability.of(solver)
    solver.factorise(state)
    T, p = selection(system), np.concatenate(system.space.sub(1).collapse()[1])
    reduced, mass = (T.T @ dense(matrix) @ T for matrix in (system._whole, stability.mass))
    x, y = np.random.default_rng(3).standard_normal(system.n), np.empty(system.n)
    system.tangent_product(x, y)
    slot = system.unknowns.slots[0][1][0]
    images = np.concatenate([x[T[:, :-1].argmax(axis=0)], [x[slot]]])
    expected = reduced @ images
    found = np.concatenate([y[T[:, :-1].argmax(axis=0)], [y[slot]]])
    figure(
        "a dense T^T K T",
        "tangent with a rigid plate, times a vector",
        np.abs(found - expected).max() / np.abs(expected).max(),
        1e-13,
    )
    values = np.linalg.eigvalsh(reduced)
    assert np.count_nonzero(values < 0) == len(p) and stability.negative_eigenvalues() == 0
    inverse = np.linalg.eigvals(np.linalg.solve(reduced, mass)).real
    figure("a dense T^T K T", "lowest eigenvalue with a rigid plate", stability.lowest() * inverse.max() - 1, 1e-9)


def test_direction_of_the_path(plated, figure):
    """Its rate by the pressure against a difference of solved states."""
    solver, state = plated
    solver.factorise(state)
    rate = solver.tangent(state, pressure_control(state.P), 1e-11).w
    step = 1e-4
    ends = [
        solver.solve(pressure_control(state.P + way * step), state.w + way * step * rate, state.P + way * step).w
        for way in (-1, 1)
    ]
    off = np.abs((ends[1] - ends[0]) / (2 * step) - rate).max() / np.abs(rate).max()
    figure("a difference of solved states", "rate of a state with a rigid plate", off, 1e-6)


def test_a_case_of_its_own():
    """A plate in a case file: its columns, and the force with which a held one is pushed as a free one is not."""
    text = (
        '[geometry]\ndevice = "HollowDisk"\nsection = "axisymmetric"\ncell_size = "2mm"\n[load]\npressure_cm = [20]\n'
    )
    moved = {}
    for kind in ("free", "held"):
        case = Case.from_toml(text + f'[rigid.plate]\nface = "top"\nkind = "{kind}"\n')
        assert Case.from_toml(case.to_toml()) == case
        run = sm.run(case)
        moved[kind] = {name: values[-1] for name, values in run.path.items()}
    free, held = moved["free"], moved["held"]
    assert free["plate_z_mm"] == pytest.approx(free["apex_mm"], rel=1e-12) and free["plate_z_mm"] < -0.01
    assert abs(free["plate_force_N"]) < 1e-6 * abs(held["plate_force_N"]) and "plate_z_mm" not in held


def test_what_cannot_be(body_of):
    def refused(**changes):
        with pytest.raises((CaseError, PartError)) as error:
            Case("disk", DISK, LAW, (10.0,), parts=(Rigid(**{"face": "top", "name": "plate", **changes}),))
        return str(error.value)

    assert "no face 'lid'" in refused(face="lid") and "top" in refused(face="lid")
    assert "kind" in refused(kind="loose")
    assert "direction belongs" in refused(direction=(0.0, 0.0, 1.0))
    assert "three numbers" in refused(kind="guided", direction=(1.0, 0.0))
    assert "leave the symmetry" in refused(kind="guided", direction=(1.0, 0.0, 0.0))
    assert "needs the face" in refused(face="")
    twice = (PLATE, dataclasses.replace(PLATE, name="other"))
    with pytest.raises(PartError, match="meets another rigid part"):
        System(body_of(DISK), LAW, parts=twice)
