"""Figures of a wedge, a slab, a finger, a disk past its limit, one that bifurcates and a part with two cavities."""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path

from geometries import Cylinder, HollowDisk, ImportedActuator, PneuNet, SeminarActuator
from softmodels.case.load import steps_of
from tests.support.on_ranks import lifting, rubbing, sealing

WEDGE = HollowDisk(angle=15.0, cell_size=0.006, fillet=0.0015)
SLAB = SeminarActuator(channels=1, spread=20.0, around=6.0, cell_size=0.006)
FINGER = PneuNet(chambers=2, paper=0.0005, cell_size=0.005)
SECTION = HollowDisk.variant("shadow", section="axisymmetric", support="base", cell_size=0.003)
TWIN = HollowDisk.variant("shadow", section="axisymmetric", base=0.002, wall=0.015, cell_size=0.003)
"""With two equal membranes, of which one balloons in the end."""
TUBE = Cylinder(section="axisymmetric", cell_size=0.002)


def pair_of(step: Path) -> ImportedActuator:
    """A block of a STEP file with two cavities."""
    cavities = ("at 11, 0, 2 mm", "at 11, 0, -2 mm")
    return ImportedActuator(file=str(step), cavities=cavities, support="x = 0 mm", cell_size=0.006)


MESHES = {"wedge": WEDGE, "slab": SLAB, "finger": FINGER, "section": SECTION, "twin": TWIN}


def figures(comm, folder: Path) -> dict[str, list[float]]:
    """Key figures by state; the same on every rank."""
    import numpy as np

    from softmodels.materials.laws import NeoHookean, Yeoh
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System
    from softmodels.path.continuation import Continuation, trace
    from softmodels.path.stability import PathEnd
    from softmodels.runs.fields import Fields

    found = {}
    wedge, slab, finger, section, twin, pair = (folder / f"{name}.msh" for name in (*MESHES, "pair"))
    solids = (("wedge", WEDGE, wedge, 1.0), ("slab", SLAB, slab, 1.0), ("finger", FINGER, finger, 0.1))
    for name, device, file, share in solids:
        equations = Solver(System(Body.from_file(device, file, comm), NeoHookean(30e3, 0.49)))
        fields = Fields(equations)
        for point in trace(Continuation(equations), [0.1 * share, 0.4 * share]):
            if point.requested:
                values = dataclasses.asdict(fields.figures(point.state))
                values.update(values.pop("rises"), **values.pop("device"), **values.pop("extremes"))
                found[f"{name} at {point.state.P:g}"] = np.hstack(list(values.values())).tolist()
        if name == "wedge":
            found["wedge, rates and outline"] = rates(equations, 0.1)
    found["wedge whose walls meet"] = meeting(comm, wedge)
    found["wedge that lifts a ball of triangles"] = lifting.figures(comm, WEDGE, wedge)
    found["wedge that rubs on a plate, there and back"] = rubbing.figures(comm, WEDGE, wedge)
    found["cup whose seal opens"] = sealing.figures()
    equations = Solver(System(Body.from_file(SECTION, section, comm), NeoHookean(20e3, 0.495)))
    found["section past its limit, rates and outline"] = rates(equations, 6.0)
    points = []
    try:
        for point in trace(Continuation(equations), [1.0]):
            points.append(point)
    except PathEnd as end:
        found["limit"] = [end.limit.state.P]
    found["negative eigenvalues"] = [float(point.signature.negative_eigenvalues) for point in points]
    found["lowest eigenvalue"] = [points[0].signature.lowest, points[-1].signature.lowest]
    found.update(bifurcation(Solver(System(Body.from_file(TWIN, twin, comm), Yeoh(10e3, 20.0, 3.0, 0.495)))))
    found["pair, one volume held and then changed"] = program(comm, pair)
    found["design, values and gradients"] = design(comm)
    found["section under its weight and a force"] = loaded(comm, section)
    found["wedge by iterations"] = iterated(comm, wedge)
    found["end that is named"] = ending(comm)
    return found


def ending(comm) -> list[float]:
    """Whether the path of a cavity that cannot change, in incompressible silicone that is held all around, ends as such."""
    from softmodels import Clamp, Rigid
    from softmodels.materials.laws import NeoHookean
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.mpi import on_root
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System
    from softmodels.path.continuation import DEVICE_LOCKED, Continuation, trace
    from softmodels.path.stability import AddedVolume, PathEnd

    held = (Rigid(region="cap", kind="held", name="plate"), Clamp("outer", slip="z", name="grip"))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(comm.bcast(folder)) / "tube.msh"
        on_root(comm, lambda: TUBE.write(file))
        equations = Solver(System(Body.from_file(TUBE, file, comm), NeoHookean(30e3, 0.5), components=held))
        comm.barrier()
    try:
        reached = [point.state.V for point in trace(Continuation(equations, AddedVolume()), [10.0])]
    except PathEnd as end:
        return [float(end.cause == DEVICE_LOCKED)]
    return reached


def iterated(comm, wedge: Path) -> list[float]:
    """Volume, compliance, energy and lowest eigenvalue of a state that the iterative solver finds."""
    from softmodels.materials.laws import NeoHookean
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.controls import pressure_control
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System
    from softmodels.path.stability import Stability

    solver = Solver(System(Body.from_file(WEDGE, wedge, comm), NeoHookean(30e3, 0.49)), "iterative")
    state = solver.solve(pressure_control(0.1), solver.system.rest().w, 0.1)
    compliance = solver.tangent(state, pressure_control(0.1), 1e-9).compliance
    return [state.V, compliance, solver.system.stored_energy(), Stability.of(solver).signature(exact=True).lowest]


def loaded(comm, section: Path) -> list[float]:
    """Volume, what the loads move, and signature of a disk that hangs under weights, is inflated and then pushed in."""
    import numpy as np

    from softmodels.components.loads import Force, Gravity, Mass
    from softmodels.materials.laws import NeoHookean
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System
    from softmodels.path.continuation import Continuation, trace
    from softmodels.path.schedule import apply_preload, load_from
    from softmodels.path.stability import QUANTITIES

    components = (
        Gravity(direction="-z"),
        Mass(face="top", amount=0.02),
        Force(face="top", direction="-z", name="push"),
    )
    solver = Solver(System(Body.from_file(SECTION, section, comm), NeoHookean(20e3, 0.495), components=components))
    system = solver.system
    weight = np.concatenate([[0.0], system.dead.amounts / system.dead.units])
    hung = apply_preload(solver, [("its weight", weight), ("a pressure", weight + np.array([0.05, 0.0, 0.0]))])
    path = Continuation(solver, QUANTITIES["force"], start=load_from(solver, hung, 2))
    *_, last = trace(path, [0.3 / system.dead.units[1]])
    system.load(last.state)
    return [*hung.driven.tolist(), *system.driven().tolist(), last.signature.lowest, system.stored_energy()]


def meeting(comm, wedge: Path) -> list[float]:
    """A wedge that is sucked empty until the cavity's floor and ceiling press on each other, images across the cuts too."""
    from softmodels.components.contact import Walls
    from softmodels.materials.laws import NeoHookean
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.controls import volume_control
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System

    equations = Solver(System(Body.from_file(WEDGE, wedge, comm), NeoHookean(30e3, 0.49), components=[Walls("cavity")]))
    system = equations.system
    state = rest = system.rest()
    for share in (0.7, 0.5, 0.4, 0.37):
        state = equations.solve(volume_control(share * rest.V), state.w, state.P)
    equations.factorise(state)
    figures = system.potential.terms["walls"].figures(system)
    pressed = [figures[f"walls_{name}"] for name in ("contact_N", "overlap_mm")]
    return [state.P, system.stored_energy(), *pressed, float(equations.bordered.negative_eigenvalues())]


def design(comm) -> list[float]:
    """Quantities of a design and their gradients by lengths and the silicone, on its own mesh and on one that has moved."""
    import numpy as np

    from softmodels.case.case import Case
    from softmodels.design.extremes import PeakStretch
    from softmodels.design.model import DesignModel
    from softmodels.design.quantities import AddedVolume, LimitMargin, Mass, Rise
    from softmodels.design.trials import EvaluatedLoad
    from softmodels.materials.laws import NeoHookean

    quantities = (
        Rise(at=2000.0),
        PeakStretch(at=2000.0),
        AddedVolume(at=2000.0),
        Rise(at=EvaluatedLoad("volume", 40e-6)),
        LimitMargin(),
        Mass(),
    )
    case = Case(name="design", actuator=SECTION, material=NeoHookean(20e3, 0.49), steps=steps_of(pressure_cm=(20.0,)))
    model = DesignModel(case, ("membrane", "cavity_radius"), quantities, comm, materials=("shear_modulus",))
    found = []
    for shares in ((1.0, 1.0), (1.05, 0.97)):
        judged = model.evaluate(model.start * shares)
        found += [*judged.values.values(), *np.hstack(list(judged.gradients.values()))]
        found += [rate for rates in judged.material_gradients.values() for rate in rates.values()]
    model.release()
    return found


def program(comm, pair: Path) -> list[float]:
    """Pressures, volumes, rise and signature at the steps of a program."""
    from softmodels.case.load import steps_of
    from softmodels.materials.laws import NeoHookean
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System
    from softmodels.path.schedule import follow
    from softmodels.runs.fields import Fields

    equations = Solver(System(Body.from_file(pair_of(pair.with_suffix(".step")), pair, comm), NeoHookean(30e3, 0.49)))
    fields, found = Fields(equations), []
    steps = steps_of(cavity1={"pressure_cm": [40, 40]}, cavity2={"volume_ml": [0, 0.03]})
    for _, point in follow(equations, steps):
        if point.requested:
            figures = fields.figures(point.state)
            found += [
                *figures.cavity_pressures,
                *figures.cavity_volumes[:1],
                figures.rises["tip"],
                point.signature.lowest,
            ]
    return found


def bifurcation(equations) -> dict[str, list[float]]:
    """Volume and pressure where two equal membranes begin to differ, and some states further along that branch."""
    import itertools

    from softmodels.path.continuation import Continuation, follow, trace
    from softmodels.path.stability import AddedVolume

    path = Continuation(equations, AddedVolume(), largest_step=2.0)
    first = next(point for point in trace(path, [12.0]) if point.bifurcation)
    branch = [point.state for point in itertools.islice(follow(path, first), 2)]
    return {
        "bifurcation": [first.state.V, first.state.P],
        "branch": [value for state in branch for value in (state.V, state.P)],
    }


def rates(equations, added: float) -> list[float]:
    """Derivatives of a state's pressure and of its outline, and the outline's distances from some points."""
    import numpy as np

    from softmodels.fitting.outlines.shapes import Silhouette
    from softmodels.mechanics.controls import volume_control
    from softmodels.mechanics.sensitivity import MeshMotion, Sensitivity
    from softmodels.path.continuation import Continuation, trace
    from softmodels.path.stability import AddedVolume

    moving = MeshMotion(equations.system.body)
    sensitivity, silhouette = Sensitivity(equations, moving), Silhouette(equations.system)
    moving.move(dataclasses.replace(moving.base, membrane=1.02 * moving.base.membrane))
    state = list(trace(Continuation(equations, AddedVolume()), [added]))[-1].state
    _, found = sensitivity.rates(state, volume_control(state.V), ("shear_modulus", "poisson", "membrane"))
    curve = silhouette.curve(state)
    size = equations.system.length_unit
    closest = curve.closest(size * np.array([[0.1, 0.3], [0.5, 0.2], [0.9, 0.1]]))
    moved = closest.moved(silhouette.moved(found["membrane"].w, found["membrane"].X))
    moving.move(moving.base)
    return [*(rate.P for rate in found.values()), *closest.distance.tolist(), *moved.tolist()]
