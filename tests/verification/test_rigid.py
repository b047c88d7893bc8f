"""Rigid parts: the constraint is exact, its tangent and its inertia are those of the dofs left free."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import softmodels as sm
from geometries import Actuator, CutPlane, Hold
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.case.materials import Region
from softmodels.common.schema import choice_field, length_field
from softmodels.components.loads import Force, Gravity
from softmodels.components.rigid import Clamp, Rigid
from softmodels.mechanics.component import ComponentError
from softmodels.mechanics.controls import pressure_control
from softmodels.mechanics.regions import Turn, amounts, nearest, rotation_vector
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path.schedule import apply_preload, inflate_from
from softmodels.path.stability import Stability

DISK = sm.HollowDisk(section="axisymmetric", cell_size=0.002)
LAW = sm.NeoHookean(28e3)
PLATE = Rigid("top", name="plate")
FREE = "the same state's forces on all dofs"


@pytest.fixture(scope="module")
def plated(body_of):
    """A disk whose top is a free rigid plate, at a pressure: its solver and the state."""
    solver = Solver(System(body_of(DISK), LAW, components=[PLATE]))
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


@pytest.mark.quick
def test_the_face_moves_as_one_and_its_forces_cancel(plated, figure):
    """What makes a state one of equilibrium with a free rigid plate, from the whole body's forces."""
    solver, state = plated
    system = solver.system
    system.load(state)
    rises = state.w[followers(system)] @ system.body.skew_inverse.T
    assert np.ptp(rises, axis=0).max() == 0.0 and not rises[:, 0].any() and abs(rises[0, 1]) > 1e-3
    residual, scale = system.residual(), np.abs(system.residual()).max()
    assert scale > 0.01  # on single dofs of the plate
    figure(FREE, "force left on a free dof or on a rigid plate", np.abs(selection(system).T @ residual).max() / scale, 1e-9)


@pytest.mark.campaign
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


@pytest.mark.campaign
def test_a_case_of_its_own():
    """A plate in a case file: its columns, and the force with which a held one is pushed as a free one is not."""
    text = '[geometry]\ndevice = "HollowDisk"\nsection = "axisymmetric"\ncell_size = "2mm"\n[load]\npressure_cm = [20]\n'
    moved = {}
    for kind in ("free", "held"):
        case = Case.from_toml(text + f'[rigid.plate]\nface = "top"\nkind = "{kind}"\n')
        assert Case.from_toml(case.to_toml()) == case
        run = sm.run(case)
        moved[kind] = {name: values[-1] for name, values in run.path.items()}
    free, held = moved["free"], moved["held"]
    assert free["plate_z_mm"] == pytest.approx(free["apex_mm"], rel=1e-12) and free["plate_z_mm"] < -0.01
    assert abs(free["plate_force_N"]) < 1e-6 * abs(held["plate_force_N"]) and "plate_z_mm" not in held


def test_a_held_end_has_no_end_of_stiffness():
    tube = sm.Cylinder(cell_size=0.003)
    run = sm.inflate(tube, sm.NeoHookean(30e3, 0.49), "0,1 cm", components=[Rigid("end", kind="held", name="plate")])
    assert run.path["end_stiffness_N_per_m"][-1] == np.inf and run.path["end_mm"][-1] == 0.0


def test_what_cannot_be(body_of):
    def refused(**changes):
        with pytest.raises((CaseError, ComponentError)) as error:
            Case(
                "disk",
                DISK,
                LAW,
                steps_of(pressure_cm=(10.0,)),
                components=(Rigid(**{"face": "top", "name": "plate", **changes}),),
            )
        return str(error.value)

    assert "no face 'lid'" in refused(face="lid") and "top" in refused(face="lid")
    assert "kind" in refused(kind="loose")
    assert "direction needs" in refused(direction=(0.0, 0.0, 1.0))
    assert "three numbers" in refused(kind="guided", direction=(1.0, 0.0))
    assert "breaks the symmetry" in refused(kind="guided", direction=(1.0, 0.0, 0.0))
    assert "needs a face" in refused(face="")
    twice = (PLATE, dataclasses.replace(PLATE, name="other"))
    with pytest.raises(ComponentError, match="touches another rigid part"):
        System(body_of(DISK), LAW, components=twice)


# -- a part that turns ------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True, kw_only=True)
class Beam(Actuator):
    """A beam along x, held at x = 0; whole, or its half y > 0 on the plane of symmetry."""

    length: float = length_field(0.020, "length")
    edge: float = length_field(0.004, "height and width")
    half: str = choice_field("no", ("no", "yes"), "half of it")
    head: float = length_field(0.0, "length of a block at its end, a region of its own", zero=True)
    dimension, faces, ratios, cavity_volume, mesh_order, probes = 3, ("end", "side"), (), 0.0, 1, {}

    @property
    def regions(self):
        return ("head",) if self.head else ()

    @property
    def size(self):
        return self.edge

    @property
    def copies(self):
        return 2 if self.half == "yes" else 1

    @property
    def cut_planes(self):
        return (CutPlane("plane0", (0.0, -1.0, 0.0)),) if self.half == "yes" else ()

    @property
    def holds(self):
        return (Hold("support", None),)

    @property
    def solid_volume(self):
        return self.length * self.edge**2

    def on_profile(self, points):
        return np.zeros(len(points), dtype=bool)

    def check(self):
        pass

    def build(self):
        import gmsh

        start = 0.0 if self.half == "yes" else -self.edge / 2
        across = self.edge / 2 - start, self.edge
        gmsh.model.occ.addBox(0, start, 0, self.length - self.head, *across)
        if self.head:
            gmsh.model.occ.fragment(
                [(3, 1)], [(3, gmsh.model.occ.addBox(self.length - self.head, start, 0, self.head, *across))]
            )
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(3, [1], name="solid")
        if self.head:
            gmsh.model.addPhysicalGroup(3, [2], name="head")
        groups = {}
        for _, face in gmsh.model.getEntities(2):
            box = np.array(gmsh.model.getBoundingBox(2, face)).reshape(2, 3)
            flat = {"support": box[1, 0], "end": box[0, 0] - self.length}
            flat |= {"plane0": box[1, 1]} if self.half == "yes" else {}
            if np.ptp(box[:, 0]) < 1e-6 and abs(box[0, 0] - (self.length - self.head)) < 1e-6 and self.head:
                continue  # between beam and block
            name = next((name for name, off in flat.items() if abs(off) < 1e-6), "side")
            groups.setdefault(name, []).append(face)
        for name, tags in groups.items():
            gmsh.model.addPhysicalGroup(2, tags, name=name)
        gmsh.model.mesh.setSizeCallback(lambda *args: 0.8 * self.edge)


@pytest.fixture(scope="module")
def bent(body_of):
    """A beam with a rigid plate on its end, bent far by two dead forces: its solver and the state."""
    components = [
        dataclasses.replace(PLATE, face="end"),
        Force("end", "-z", name="down"),
        Force("end", "y", name="aside"),
    ]
    solver = Solver(System(body_of(Beam()), LAW, components=components))
    return solver, apply_preload(
        solver, [("the forces", np.array([0.02, 0.01]) / solver.system.dead.units)], lambda text: None
    ).state


@pytest.mark.campaign
def test_a_turned_plate_is_in_balance(bent, figure):
    """Forces and moments on the plate cancel, its nodes keep their distances, and the rest is in equilibrium."""
    solver, state = bent
    system = solver.system
    system.load(state)
    motion = system.unknowns.moving["plate"]
    assert np.degrees(np.linalg.norm(rotation_vector(motion.rotation))) > 60.0
    residual = system.residual()
    force, moment = motion.wrench(residual)
    free = np.ones(system.n, dtype=bool)
    free[followers(system)] = False
    free[np.concatenate([bc.dof_indices()[0] for bc in system.bcs])] = False
    left = np.concatenate([force, moment, residual[free]])
    figure(FREE, "force or moment left with a turned plate", np.abs(left).max() / np.abs(residual).max(), 1e-8)
    places = motion.places + state.w[motion.dofs] @ system.body.skew_inverse.T
    moved, rest = (np.linalg.norm(x[:, None] - x[None], axis=2) for x in (places, motion.places))
    figure("the undeformed plate", "distances within a turned plate", np.abs(moved - rest).max(), 1e-13)


@pytest.mark.campaign
def test_tangent_of_a_turned_plate(bent, figure):
    """The tangent's product against differences of the residual, where the plate has turned on from the state as well."""
    solver, state = bent
    system = solver.system
    q, scalars = system.unknowns.to_reduced(state.w[: system.dofs]).copy(), np.array([state.P, *state.w[system.dofs :]])
    slots = system.unknowns.slots[0][1]
    q[slots] += 0.05 * np.arange(1, 7)
    way = np.random.default_rng(5).standard_normal(system.n)
    way[np.concatenate([system.unknowns.idle, *(bc.dof_indices()[0] for bc in system.bcs)])] = 0.0

    def residual(amount):
        system.set_iterate(q + amount * way, scalars)
        return system.internal_forces().copy() - system.pressures @ system.pressure_loads()

    steps = 1e-5, 2e-5
    first, second = ((residual(step) - residual(-step)) / (2 * step) for step in steps)
    difference = first + (first - second) / 3
    system.set_iterate(q, scalars)
    product = np.empty(system.n)
    system.tangent_product(way, product)
    figure(
        "differences of the residual",
        "tangent with a turning plate",
        np.abs(product - difference).max() / np.abs(product).max(),
        1e-7,
    )
    system.assemble_tangent()
    x, y = system.K.createVecRight(), system.K.createVecLeft()
    x.array_w[:] = way
    system.K.mult(x, y)
    figure(
        "its product",
        "matrix of the tangent with a turning plate",
        np.abs(y.array_r - product).max() / np.abs(product).max(),
        1e-13,
    )


def test_a_plate_beside_a_clamp_moves_as_its_face():
    """A clamp's direction may be a component of w that the device has elsewhere; the plate has to follow."""
    beam = sm.Beam(part="full", length=0.03, cell_size=0.005)
    parts = [Gravity("-z"), Rigid("tip", name="plate"), Clamp("bottom within x < 6 mm", along="y")]
    row = sm.run(Case("beam", beam, LAW, steps_of(share=[1.0]), components=parts)).rows[-1]
    assert row["plate_z_mm"] < -1.0 and row["plate_y_mm"] == pytest.approx(0.0, abs=1e-6)
    assert row["plate_z_mm"] == pytest.approx(row["tip_z_mm"], rel=1e-9)


@pytest.mark.campaign
def test_a_half_beam_is_the_half_of_a_whole_one(body_of, figure):
    """Three motions in a half model against six in a whole one, under a force in the plane of symmetry."""
    found = {}
    for half in ("yes", "no"):
        solver = Solver(
            System(
                body_of(Beam(half=half)),
                LAW,
                components=[dataclasses.replace(PLATE, face="end"), Force("end", "-z", name="down")],
            )
        )
        system = solver.system
        system.load(apply_preload(solver, [("the force", np.array([0.02]) / system.dead.units)], lambda text: None).state)
        motion = system.unknowns.moving["plate"]
        assert motion.freedom.count == (3 if half == "yes" else 6)
        found[half] = np.concatenate([motion.translation, rotation_vector(motion.rotation)])
    # Their meshes are not each other's images.
    figure(
        "the whole beam's",
        "motion of the plate on a half beam",
        np.abs(found["yes"] - found["no"]).max() / np.abs(found["no"]).max(),
        0.01,
    )


@pytest.mark.quick
def test_a_rigid_block_is_a_block_whose_nodes_are_moved_so(body_of, figure, monkeypatch):
    """A region that is rigid against the same region with all its nodes held where that motion, computed aside, puts them.

    Both are solved to a thousandth of a run's tolerance: with that itself they differ by 2e-10, each by its own remainder.
    """
    monkeypatch.setattr("softmodels.mechanics.newton.RESIDUAL_TOLERANCE", 1e-12)
    body, block = body_of(Beam(head=0.008)), Rigid(region="head", name="block")
    loads = [Force("side", "-z", name="down"), Force("side", "y", name="aside")]
    solver = Solver(System(body, LAW, components=[block, *loads]))
    stop = apply_preload(solver, [("the forces", np.array([0.04, 0.03]) / solver.system.dead.units)], lambda text: None)
    solver.system.load(stop.state)
    motion = solver.system.unknowns.moving["block"]
    vector = rotation_vector(motion.rotation)
    assert np.degrees(np.linalg.norm(vector)) > 45.0 and len(motion.dofs) > 100
    moved = motion.translation + Rotation.from_rotvec(vector).apply(motion.arms) - motion.arms
    held = Solver(System(body, LAW, components=[Region(LAW, name="head"), Clamp(face="head"), *loads]))
    there = stop.state.w.copy()
    there[motion.dofs] = moved @ body.skew.T
    inflate_from(held, dataclasses.replace(stop, state=dataclasses.replace(stop.state, w=there)))
    residual = held.system.residual()
    free = np.setdiff1d(np.arange(held.system.n), np.concatenate([bc.dof_indices()[0] for bc in held.system.bcs]))
    left = np.abs(residual[free]).max() / np.abs(residual).max()
    figure("all nodes held where its motion puts them", "force left around a rigid block that has turned", left, 1e-12)
    start = 0.97 * stop.state.w  # not from the answer
    start[motion.dofs] = moved @ body.skew.T
    guess = inflate_from(held, dataclasses.replace(stop, state=dataclasses.replace(stop.state, w=start)))
    held.factorise(guess)
    found = held.solve(pressure_control(0.0), guess.w, 0.0)
    assert found.iterations > 1 and (found.w[motion.dofs] == start[motion.dofs]).all()
    dofs = held.system.dofs
    off = np.abs(found.w[:dofs] - stop.state.w[:dofs]).max() / np.abs(stop.state.w).max()
    figure("all nodes held where its motion puts them", "state around a rigid block that has turned", off, 1e-12)


def test_rotations():
    """Derivatives against differences, and the rotation that is found again from turned points."""
    rng, axes, step = np.random.default_rng(2), np.eye(3), 1e-6
    v, points = rng.standard_normal(3), rng.standard_normal((9, 3))
    turn = Turn(v, axes)
    ends = [(Turn(v + step * e, axes), Turn(v - step * e, axes)) for e in axes]
    slopes = np.array([(a.matrix - b.matrix) / (2 * step) for a, b in ends])
    curvatures = np.array([(a.slopes() - b.slopes()) / (2 * step) for a, b in ends])
    assert np.allclose(slopes, turn.slopes(), atol=1e-8) and np.allclose(curvatures, turn.curvatures(), atol=1e-8)
    assert np.allclose(amounts(turn.matrix, axes), v)
    for arms in (points, points * [1.0, 1.0, 0.0]):
        assert np.allclose(nearest((arms @ turn.matrix.T).T @ arms, axes), turn.matrix)
    about = np.array([[0.0, 0.6, 0.8]])
    once = Turn(np.array([1.5]), about).matrix
    assert np.allclose(nearest((points @ once.T).T @ points, about), once)


def test_a_rigid_ring_is_a_very_stiff_one(body_of, figure):
    """A ring bonded on a membrane: rigid, against a region ten thousand times stiffer."""
    device = sm.Membrane(
        radius=0.02, thickness=0.001, clamp_width=0.0, rings=(0.008, 0.011), ring_thickness=0.001, cell_size=0.001
    )
    found = {}
    for part in (Rigid(region="ring1", name="ring"), Region(sm.NeoHookean(28e7), name="ring1")):
        solver = Solver(System(body_of(device), LAW, components=[part]))
        state = solver.system.rest()
        for pressure in (0.01, 0.02, 0.03):
            solver.factorise(state)
            state = solver.solve(pressure_control(pressure), state.w, pressure)
        solver.factorise(state)
        stability = Stability.of(solver)
        assert stability.negative_eigenvalues() == 0
        found[type(part)] = state.V - solver.system.rest().V, stability.lowest()
    off = np.array(found[Rigid]) / found[Region] - 1
    figure("a ring ten thousand times stiffer", "volume that a membrane with a rigid ring has taken up", off[0], 0.005)
    figure("a ring ten thousand times stiffer", "lowest eigenvalue of a membrane with a rigid ring", off[1], 0.02)
