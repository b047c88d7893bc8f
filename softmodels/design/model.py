"""Evaluator of designs for the optimiser: from parameters to values and gradients of quantities."""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import functools
import io
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from geometries import GeometryError, MeshingError
from softmodels.case import entries
from softmodels.case.case import Case, in_equations, of_shape, value_of, varied
from softmodels.common import errors, folders, processes
from softmodels.common.arrays import Array
from softmodels.common.files import read_text, write_bytes, write_text
from softmodels.common.lazy import MPI
from softmodels.components.loads import weighed
from softmodels.design import result, targets
from softmodels.design.problem import (
    LIMIT_TOLERANCE,
    MAX_EVALUATIONS,
    DesignEvaluator,
    DesignProblem,
    EvaluatedQuantity,
    EvaluationRequest,
    Formulation,
    SearchOptions,
    in_words,
    label,
    shown,
    shown_factor,
)
from softmodels.design.quantities import (
    DesignedBody,
    DesignQuantity,
    DeviceQuantity,
    OfBifurcation,
    OfLimit,
    Slopes,
    TargetMeasure,
)
from softmodels.design.states import Adjoint, Bifurcations, DesignStates, Transfer, WorkingStates
from softmodels.design.trials import (
    PRESSURE,
    DesignError,
    DesignFailure,
    DesignStopped,
    EvaluatedLoad,
    Evaluation,
    Squares,
    Trial,
    Trials,
    factor,
    shown_unit,
)
from softmodels.materials import laws
from softmodels.mechanics import compiling, mpi, newton, regions
from softmodels.mechanics.body import Body
from softmodels.mechanics.component import ComponentError
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State, System
from softmodels.path.stability import Stability
from softmodels.runs.outcomes import RunError


class MeshedDesign:
    """A mesh of a device, its equations and states, and the quantities prepared on it. ``case`` is what mesh and equations
    show now."""

    def __init__(self, design: DesignedBody, question: EvaluationRequest, case: Case):
        self.design, self.solver, self.question, self.case = design, design.solver, question, case
        self.adjoint = Adjoint(design)
        self.measures = {
            part: part.measure(design) for part in question.parts if not isinstance(part, OfLimit | DeviceQuantity)
        }
        forks = any(isinstance(part, OfBifurcation) for part in question.parts)
        self.bifurcations = Bifurcations(design, self.adjoint) if forks else None
        self.states = WorkingStates(design, question.loads, question.highest, self.bifurcations)
        self._stable: tuple[Case, DesignStates] | None = None
        """The last evaluated design, and its states."""

    @classmethod
    def fresh(cls, case: Case, question: EvaluationRequest, comm: MPI.Comm, before: MeshedDesign | None = None) -> MeshedDesign:
        """Return a fresh mesh of a device, with its states. Those of another mesh ``before`` that shows this device now are
        interpolated; without it, or where Newton's method does not find them so, they are found along the whole path.
        DesignFailure where it cannot be meshed, or a load is not met."""
        with tempfile.TemporaryDirectory() as folder:
            file = Path(comm.bcast(folder)) / "design.msh"
            try:
                mpi.on_root(comm, lambda: case.actuator.write(file))
            except MeshingError as error:
                raise DesignFailure(str(error)) from error
            body = Body.from_file(case.actuator, file, comm)
            comm.barrier()
        with compiling.compiling():
            system = System(body, case.material, case.formulation, case.components)
            system.direction = case.load.direction
            solver = Solver(system, case.solver)
            forms = [name for name in question.materials if name in laws.FORM_ENERGIES]
            made = cls(DesignedBody(solver, forms), question, case)
        try:
            made.show(case)
            if before is None or made.states.depend_on_path or not made._taken_over(before):
                made._trace()
        except BaseException:
            made.release()
            raise
        return made

    def _taken_over(self, before: MeshedDesign) -> bool:
        """Take over the states of another mesh of the same device; return whether they converged."""
        guess = before.states.save().transferred(Transfer(before.design, self.design))
        try:
            self.states.carry(guess)
            for load in self.question.loads:
                self._settled(load)
        except (newton.NoConvergence, DesignFailure):  # possibly due to the interpolation
            return False
        return True

    def release(self) -> None:
        """Give back what PETSc and MPI hold."""
        self.design.release()

    def show(self, case: Case) -> None:
        """Move the mesh and the numbers of the equations to a case; GeometryError where the mesh cannot follow."""
        if case.actuator != self.design.motion.device:
            self.design.motion.move(case.actuator)
        material, components = regions.relaxed(case.material, case.components)
        self.design.system.take(material, components, case.actuator.ratios)
        self.case = case

    def follow(self, case: Case) -> None:
        """Move the mesh and its states to a case, in smaller steps if Newton's method fails.

        From the second step on the states are expected on the straight line through the last two. Where that does not help
        either, they are found along the whole path. Mesh and states are those of before after a GeometryError (the mesh
        cannot follow), PoorMesh or DesignFailure (a load is not met).
        """
        states = self.states
        start, first = self.case, states.save()
        self._move(case)
        if states.depend_on_path:
            self._retrace(case, start, first)
            return
        way, step, earlier = 0.0, 1.0, list[tuple[float, DesignStates]]()
        while way < 1.0:
            goal = min(way + step, 1.0)
            try:
                self.show(case if goal == 1.0 else _case_between(start, case, goal, self.question.names))
                here = states.save()
                states.carry(here.ahead(earlier[0][1], (goal - way) / (way - earlier[0][0])) if earlier else None)
            except newton.NoConvergence:
                step /= 2
                if step < MIN_DESIGN_STEP:
                    self._retrace(case, start, first)
                    return
                continue
            except (DesignFailure, GeometryError):
                self._restore(start, first)
                raise
            earlier, way = [(way, here)], goal

    def _retrace(self, case: Case, start: Case, first: DesignStates) -> None:
        """Solve the states of a case along the whole path, on the current mesh."""
        self.show(case)
        try:
            self._trace()
        except DesignFailure:
            self._restore(start, first)
            raise

    def _trace(self) -> None:
        self.states.trace(self.adjoint.sensitivity, [*self.question.shape, *self._others])

    def _move(self, case: Case) -> None:
        """Move the mesh, unless its cells would become poor."""
        before = self.case
        self.show(case)
        if self.design.motion.quality() < MIN_MESH_QUALITY:  # smaller steps would not improve the cells
            self.show(before)
            raise PoorMesh("the quality of the moved mesh is too low")

    def _restore(self, case: Case, known: DesignStates) -> None:
        self.show(case)
        self.states.restore(known)

    def judge(self, gradients: bool = True) -> tuple[dict[str, EvaluatedQuantity], list[str]]:
        """Return the values and gradients of the question's parts by key, and warnings.

        States that were carried from another design may lie on a branch that is unstable here. Then they are found again
        along the whole path. After a DesignFailure mesh and states are those of the last judged design.
        """
        try:
            try:
                quantities = self._judged(gradients)
            except UnstableState:
                if not self.states.carried:
                    raise
                self._trace()
                quantities = self._judged(gradients)
        except DesignFailure:
            if self._stable is not None:
                self._restore(*self._stable)
            raise
        self._stable = self.case, self.states.save()
        return quantities

    def _judged(self, gradients: bool) -> tuple[dict[str, EvaluatedQuantity], list[str]]:
        """Return the same for the current states; UnstableState if one of them is."""
        motion, question = self.design.motion, self.question
        velocities = motion.boundary_velocities(question.shape) if gradients else {}
        quantities: dict[str, EvaluatedQuantity] = {}
        notes = self.design.system.mesh_notes
        for load in (None, *question.loads):
            parts = [part for part in self.measures if part.load == load]
            state = None if load is None or not parts else self._settled(load)
            for part in parts:
                slopes = self.measures[part].slopes(state)
                if slopes.note:
                    notes.append(f"{part.key}: {slopes.note}")
                judged = (
                    self._whole(part, slopes, velocities) if gradients else EvaluatedQuantity(slopes.value, np.zeros(0), {})
                )
                measure = self.measures[part]
                if gradients and state is not None and load is not None and isinstance(measure, TargetMeasure):
                    judged = dataclasses.replace(judged, squares=self._squares(measure, state, load, velocities))
                quantities[part.key] = judged
        for part in question.parts:
            if isinstance(part, OfLimit):
                critical = self._critical(part, velocities, gradients)
                if critical is None:
                    reached = f"{question.highest / 1e3:.4g} kPa"
                    notes.append(f"{part.key}: none found up to {reached}, which is used instead")
                    critical = EvaluatedQuantity(
                        question.highest, np.zeros(len(question.names)), dict.fromkeys(question.materials, 0.0)
                    )
                quantities[part.key] = critical.times(part.factor(question.working))
            elif isinstance(part, DeviceQuantity):
                values, columns = part.values(motion.device), part.derivatives(motion.device, question.shape)
                for key, value in values.items():
                    rates = dict(zip(question.shape, columns[key], strict=True))
                    whole = np.array([rates.get(name, 0.0) for name in question.names])
                    quantities[key] = EvaluatedQuantity(value, whole if gradients else np.zeros(0), {})
        return quantities, notes

    def _settled(self, load: EvaluatedLoad) -> State:
        """Return the state at a load, its tangent factorised; UnstableState where the device leaves it by itself."""
        state = self.states.states[load]
        self.states.restore_friction(load)
        self.adjoint.prepare(state)
        if load.kind == PRESSURE:
            negative = Stability.of(self.solver).negative_eigenvalues()
            if negative:
                values = "eigenvalue" if negative == 1 else "eigenvalues"
                raise UnstableState(f"the state at {load} is unstable: its tangent has {negative} negative {values}")
        return state

    def solve_adjoint(self, part: DesignQuantity, velocities: Mapping[str, Array]) -> tuple[float, dict[str, float]]:
        """Load the state of a part and set `Adjoint.multiplier` to its multipliers: a small change of the residual changes the
        part by minus their product. Return its value and its derivatives by velocities of the boundary."""
        if isinstance(part, OfLimit):
            limit, factor = self.states.limit, part.factor(self.question.working)
            if limit is None:
                self.adjoint.set_multiplier(np.zeros(self.design.system.n))
                return factor * self.question.highest, dict.fromkeys(velocities, 0.0)
            slopes_by, _ = self.adjoint.limit_gradient(limit.state, limit.tangent, velocities)
            unit = factor * self.design.direction * self.design.system.stress_unit
            self.adjoint.multiplier.x.array[:] *= -unit
            return unit * limit.state.P, {name: factor * slope for name, slope in slopes_by.items()}
        assert part.load is not None
        slopes = self.measures[part].slopes(self._settled(part.load))
        by_length, _ = self.adjoint.gradient(slopes, part.load.kind, velocities)
        return slopes.value, by_length

    def _squares(self, measure: TargetMeasure, state: State, load: EvaluatedLoad, velocities: dict[str, Array]) -> Squares:
        """Return the distances from a target with their derivatives at the settled state."""
        columns = []
        for name in self.question.names:
            along = {name: 1.0} if name in velocities else in_equations(self.case, name)
            rates = {share: self._rates(load, velocities.get(share, share), share) for share in along}
            moved = [along[parameter] * measure.moved(state, w, X) for parameter, (w, X) in rates.items()]
            columns.append(sum(moved, np.zeros(len(measure.residuals(state)))))
        residuals = measure.residuals(state)
        return Squares.of(residuals, np.reshape(columns, (-1, len(residuals))).T, measure.run, measure.sigma)

    def _rates(self, load: EvaluatedLoad, way: Array | str, name: str) -> tuple[Array, Array]:
        """Return the derivatives of the settled state's dofs and of the mesh's nodes by a parameter."""
        if not self.states.depend_on_path:
            return self.adjoint.rates(load.kind, way)
        rate, motion = self.states.followed[load].rates[name], self.design.motion
        still = np.zeros((motion.entries // motion.dimension, motion.dimension))
        return rate.w[: len(self.design.system.w.x.array)], still if rate.X is None else rate.X

    def _whole(self, part: DesignQuantity, slopes: Slopes, velocities: dict[str, Array]) -> EvaluatedQuantity:
        """Return a part with its total derivatives at the settled state."""
        names, load = self._others, part.load
        direct = self.adjoint.by_material(self.measures[part], names) if names and load else dict.fromkeys(names, 0.0)
        if load is not None and self.states.depend_on_path:
            followed, measure = self.states.followed[load], self.measures[part]
            rates = {name: self.adjoint.along_path(measure, slopes, followed, name) for name in followed.rates}
            by_length = {name: rates[name] for name in self.question.shape}
            return self._gathered(slopes.value, by_length, {name: rates[name] + direct[name] for name in names})
        by_length, by_other = self.adjoint.gradient(
            slopes, PRESSURE if load is None else load.kind, velocities, direct if load else {}
        )
        return self._gathered(slopes.value, by_length, by_other or direct)

    @property
    def _others(self) -> list[str]:
        """Numbers of the equations by which derivatives are wanted, beside lengths."""
        free = (name for name in self.question.names if name not in self.question.shape)
        return list(
            dict.fromkeys([*self.question.materials, *(field for name in free for field in in_equations(self.case, name))])
        )

    def _gathered(self, value: float, by_length: Mapping[str, float], by_other: Mapping[str, float]) -> EvaluatedQuantity:
        """Return a value with its derivatives by the question's parameters and by the material's numbers."""
        rates = []
        for name in self.question.names:
            own = {} if name in by_length else in_equations(self.case, name)
            rates.append(by_length.get(name, 0.0) + sum(rate * by_other[key] for key, rate in own.items()))
        return EvaluatedQuantity(value, np.array(rates), {name: by_other[name] for name in self.question.materials})

    def _critical(self, part: OfLimit, velocities: dict[str, Array], gradients: bool) -> EvaluatedQuantity | None:
        """Return the pressure in Pa of the limit point or the bifurcation; None if there is none."""
        states, materials = self.states, self._others
        limit, fork = states.limit, states.bifurcation
        if isinstance(part, OfBifurcation):
            if fork is None or self.bifurcations is None:
                return None
            P, gradient = fork.P, self.bifurcations.gradient(fork, velocities, materials) if gradients else None
        elif limit is None:
            return None
        else:
            P = limit.state.P
            gradient = self.adjoint.limit_gradient(limit.state, limit.tangent, velocities, materials) if gradients else None
        pressure = self.design.direction * P * self.design.system.stress_unit
        return EvaluatedQuantity(pressure, np.zeros(0), {}) if gradient is None else self._gathered(pressure, *gradient)


def _case_between(start: Case, end: Case, share: float, names: Sequence[str]) -> Case:
    return varied(start, {name: (1.0 - share) * value_of(start, name) + share * value_of(end, name) for name in names})


MAX_LIMIT_RATIO = 3.0
"""Multiple of the working pressure up to which a limit point is searched."""


class DesignModel:
    """Evaluates designs of one device, each from the states of the previous one, on all ranks.

    Where a quantity needs it, a limit point is looked for up to ``highest``, Pa; by default `MAX_LIMIT_RATIO` times the highest
    working pressure. ``materials`` are the numbers of the material by which derivatives are wanted. GeometryError for
    a parameter that the device's mesh cannot follow.
    """

    def __init__(
        self, case: Case, names: Sequence[str], quantities: Sequence[DesignQuantity], comm: MPI.Comm, *,
        highest: float | None = None, materials: Sequence[str] = (), report: Callable[[str], None] = lambda text: None,
    ):  # fmt: skip
        case = dataclasses.replace(case, components=weighed(case.components, case.material))
        self.case, self.names, self.comm, self.report = case, tuple(names), comm, report
        shape = tuple(name for name in self.names if of_shape(case, name))
        if unknown := [name for name in shape if name not in case.actuator.movable]:
            raise GeometryError(case.actuator.why_not_movable(unknown[0]))
        self.quantities = tuple(quantities)
        parts = tuple(dict.fromkeys(part for quantity in self.quantities for part in getattr(quantity, "parts", (quantity,))))
        loads = tuple(sorted({part.load for part in parts if part.load is not None}))
        self.question = EvaluationRequest(self.names, parts, loads, 0.0, tuple(materials), shape)
        if any(isinstance(part, OfLimit) for part in parts):
            up_to = highest or MAX_LIMIT_RATIO * self.question.working
            self.question = dataclasses.replace(self.question, highest=up_to)
        self.meshed: MeshedDesign | None = None

    @property
    def start(self) -> Array:
        """The parameters of the case's own device."""
        return np.array([value_of(self.case, name) for name in self.names])

    def at(self, theta: Array) -> Case:
        """Return the case with these parameters; DesignFailure if they make no device."""
        try:
            return varied(self.case, dict(zip(self.names, map(float, theta), strict=True)))
        except entries.INPUT_ERRORS as error:
            raise DesignFailure(str(error)) from error

    def evaluate(self, theta: Array) -> Evaluation:
        """Return the values and gradients of all quantities at these parameters; DesignFailure if they make no device, or it
        has no stable state at one of the loads."""
        case = self.at(theta)
        remeshed = self._ready(case)
        meshed = self.meshed
        assert meshed is not None
        quantities, notes = meshed.judge()
        own = self._gathered(quantities, notes)
        return Evaluation(
            np.array(theta, dtype=float), case.actuator, {key: judged.value for key, judged in own.items()},
            {key: judged.gradient for key, judged in own.items() if judged.gradient.size},
            {key: judged.by_material for key, judged in own.items() if judged.by_material},
            meshed.design.motion.quality(), meshed.states.newton, remeshed, tuple(notes),
            {key: judged.squares for key, judged in own.items() if judged.squares is not None},
        )  # fmt: skip

    def confirm(self, theta: Array, finer: float = 1.0) -> Evaluation:
        """Return only the values, on a fresh mesh whose cells are a number of times finer than the case's, along the whole
        path."""
        case = self.at(theta)
        if finer != 1.0:
            case = dataclasses.replace(case, actuator=case.actuator.refined(finer))
        values_only = dataclasses.replace(self.question, names=(), shape=(), materials=())
        meshed = MeshedDesign.fresh(case, values_only, self.comm)
        try:
            quantities, notes = meshed.judge(gradients=False)
            values = {key: judged.value for key, judged in self._gathered(quantities, notes).items()}
        finally:
            meshed.release()
        return Evaluation(
            np.array(theta, dtype=float), case.actuator, values, {}, {}, 1.0, meshed.states.newton, True, tuple(notes)
        )

    def release(self) -> None:
        """Give back what PETSc and MPI hold."""
        if self.meshed is not None:
            self.meshed.release()
            self.meshed = None

    # -- meshes and states ----------------------------------------------------------------------------------------------

    def _ready(self, case: Case) -> bool:
        """Bring mesh and states to a case; return whether it was remeshed."""
        if self.meshed is not None:
            self.meshed.states.newton = 0
            try:
                self.meshed.follow(case)
                return False
            except PoorMesh as failure:
                self.report(f"remeshed: {failure}")
                if self._meshed_where_it_is(self.meshed) and self._followed(case):
                    return True
            except GeometryError as failure:
                self.report(f"remeshed, and the whole path solved: {failure}")
        # A failed design leaves the mesh of the previous one, to which a search returns.
        try:
            fresh = MeshedDesign.fresh(case, self.question, self.comm)
        except ComponentError as error:  # such as a shape that the undeformed design reaches into
            if self.meshed is None:
                raise
            raise DesignFailure(str(error)) from error
        self.release()
        self.meshed = fresh
        return True

    def _meshed_where_it_is(self, before: MeshedDesign) -> bool:
        """Remesh the last design and take over its states; return whether it succeeded."""
        try:
            fresh = MeshedDesign.fresh(before.case, self.question, self.comm, before)
        except DesignFailure:
            return False
        fresh.states.newton += before.states.newton
        self.release()
        self.meshed = fresh
        return True

    def _followed(self, case: Case) -> bool:
        """Return whether mesh and states could follow to a case."""
        assert self.meshed is not None
        try:
            self.meshed.follow(case)
        except (GeometryError, PoorMesh) as failure:
            self.report(f"remeshed once more, and the whole path solved: {failure}")
            return False
        return True

    # -- values and gradients -------------------------------------------------------------------------------------------

    def _gathered(self, quantities: dict[str, EvaluatedQuantity], notes: list[str]) -> dict[str, EvaluatedQuantity]:
        """Return the quantities by key, combined over states; add their notes."""
        own: dict[str, EvaluatedQuantity] = {}
        for quantity in self.quantities:
            if isinstance(quantity, targets.CompositeQuantity):
                parts = [quantities[part.key] for part in quantity.parts]
                own[quantity.key] = _combined_gradient(quantity, parts)
                if note := quantity.note(np.array([part.value for part in parts])):
                    notes.append(f"{quantity.key}: {note}")
            elif isinstance(quantity, DeviceQuantity):
                own |= {key: quantities[key] for key in quantity.values(self.case.actuator)}
            else:
                own[quantity.key] = quantities[quantity.key]
        return own


def _combined_gradient(quantity: targets.CompositeQuantity, parts: Sequence[EvaluatedQuantity]) -> EvaluatedQuantity:
    values, slopes = np.array([part.value for part in parts]), np.array([part.gradient for part in parts])
    value, weights = quantity.combined(values)
    gradient = slopes.T @ weights
    squares = quantity.squares(values, slopes) if gradient.size else None
    names = parts[0].by_material
    rates = {name: float(weights @ np.array([part.by_material[name] for part in parts])) for name in names}
    return EvaluatedQuantity(value, gradient, rates, squares)


# ----------------------------------------------------------------------------------------------------------------------
# A mesh of a device under design with its states and quantities: follows designs and evaluates them.


MIN_MESH_QUALITY = 0.3
"""Mesh quality below which the device is remeshed."""
MIN_DESIGN_STEP = 1 / 4
"""Minimum step between designs, below which the states are solved along the whole path."""


class PoorMesh(RuntimeError):
    """The mesh was moved too far to be solved on."""


class UnstableState(DesignFailure):
    """An unstable state."""


# ----------------------------------------------------------------------------------------------------------------------
# The evaluator of a problem's designs: finite elements, unless the caller gives another.


def evaluator(problem: DesignProblem, comm: MPI.Comm, how: SearchOptions) -> DesignEvaluator:
    """Return an evaluator with the interface of `DesignModel`; `GeometryError` for a parameter that the mesh cannot follow."""
    if (make := how.get("model")) is not None:
        return make(problem, comm)
    errors = problem.errors
    return DesignModel(
        problem.case, problem.names, problem.quantities, comm, highest=problem.highest,
        materials=() if errors is None else errors.names, report=functools.partial(report, comm, how),
    )  # fmt: skip


def report(comm: MPI.Comm, how: SearchOptions, text: str) -> None:
    """Report a line from rank 0 to who listens."""
    if mpi.is_root(comm) and (listener := how.get("progress")) is not None:
        listener(text)


# ----------------------------------------------------------------------------------------------------------------------
# Evaluate designs, the same on all ranks: none twice on one mesh, each stored and reported at once.


TYPICAL_EVALUATIONS = 18
"""Typical number of evaluations of a start, to estimate the remaining time."""


class EnoughError(Exception):
    """A search has reached its maximum number of evaluations."""


class Evaluator:
    """Evaluates the designs of one optimisation and keeps its trials, on rank 0 in a folder if there is one.

    ``form`` is the problem in scaled numbers, None until a design could be judged. The start and the mesh under way are
    counted from 1; `fresh_mesh` begins another. ``visited`` are the numbers of the trials of this search.
    """

    def __init__(
        self, problem: DesignProblem, model: DesignEvaluator, folder: DesignFolder | None, comm: MPI.Comm, how: SearchOptions
    ):
        self.problem, self.model, self.folder, self.comm, self.how = problem, model, folder, comm, how
        self.trials = Trials()
        self.form: Formulation | None = None
        self.start, self.mesh = 1, 1
        self.visited: set[int] = set()
        self._seconds: list[float] = []
        for trial in mpi.on_root(comm, lambda: [] if folder is None else folder.trials):
            self.trials.add(trial)

    def trial(self, theta: Array) -> Trial:
        """Return a design's values, stored or evaluated; DesignStopped if the user asked to stop, EnoughError if this search
        has used up its evaluations."""
        theta = mpi.on_root(self.comm, lambda: theta)
        trial = self.trials.find(theta, self.mesh)
        new = trial is None
        if trial is None:
            if mpi.on_root(self.comm, self.how.get("stopped", bool)):
                raise DesignStopped
            if len(self.visited) >= self.how.get("evaluations", MAX_EVALUATIONS):
                raise EnoughError
            trial = self._evaluated(theta)
            self.trials.add(trial)
        if self.form is None and not trial.failed:
            self.form = Formulation(self.problem, trial)
        if new:
            mpi.on_root(self.comm, self._keep)
        self.visited.add(trial.number)
        return trial

    def fresh_mesh(self) -> None:
        """Mesh the next design anew, and reuse no earlier evaluation."""
        self.mesh += 1
        self.visited = set()
        self.release()

    def release(self) -> None:
        """Release the model."""
        self.model.release()

    def confirmed(self, best: Trial) -> tuple[dict[str, float], str]:
        """Return the values on a fresh mesh along the whole path, and the reason if there are none."""
        try:
            confirmed = self.model.confirm(np.array(best.theta), self.how.get("finer", 1.0))
        except (DesignFailure, GeometryError, MeshingError) as error:
            return {}, f"the design could not be confirmed on a fresh mesh: {error}"
        return mpi.on_root(self.comm, lambda: {key: float(value) for key, value in confirmed.values.items()}), ""

    def tell(self, text: str) -> None:
        """Report a line from rank 0."""
        report(self.comm, self.how, text)

    def _evaluated(self, theta: Array) -> Trial:
        begun, number = time.monotonic(), len(self.trials.all) + 1
        place = (number, self.start, tuple(map(float, theta)), self.mesh)
        try:
            made = Trial.of(place, self.model.evaluate(theta), time.monotonic() - begun)
        except (DesignFailure, GeometryError, MeshingError) as error:
            limit = getattr(error, "limit", None)
            more = "" if limit is None else f" (its limit is at {self.problem.case.column.text(limit)})"
            made = Trial(*place, seconds=time.monotonic() - begun, failure=f"{error}{more}")
        except ValueError as error:  # a quantity missing in this device
            if self.trials.all:
                raise
            raise DesignError(str(error)) from None
        made = mpi.on_root(self.comm, lambda: made)
        self._seconds.append(made.seconds)
        return made

    def _keep(self) -> None:
        if self.folder is not None:
            try:
                self.folder.add(self.trials.all, self.form)
            except (folders.OwnFolderError, OSError) as error:
                why = getattr(error, "strerror", None) or error
                raise RunError(f"the designs cannot be written into {self.folder.path} ({why})") from None
        self.tell(line(self.problem, self.trials.all[-1], self.form, self._left()))

    def _left(self) -> float | None:
        """Estimate the remaining seconds; None if unknown."""
        if len(self._seconds) < 2:
            return None
        starts = self.how.get("starts", 1) - self.start
        per_start = min(TYPICAL_EVALUATIONS, self.how.get("evaluations", MAX_EVALUATIONS))
        return float(np.mean(self._seconds[1:])) * (max(per_start - len(self.visited), 1) + starts * per_start)


# ----------------------------------------------------------------------------------------------------------------------
# The folder of an optimisation: stores every trial at once, and the best design so far.


KIND, ITERATES = "design", "iterates"
TABLE, DESIGN, START = "iterates.csv", "design.toml", "start.toml"


def identity(problem: DesignProblem) -> dict[str, str]:
    """Return all input that the values of a problem's designs depend on, by display name."""
    case = problem.case
    keeps = [(_identity(keep.quantity), keep.at_least, keep.at_most) for keep in problem.limits]
    errors = problem.errors
    return {
        "the case": case.to_toml(),
        "the free parameters": repr(
            [
                *((free.name, free.low, free.high) for free in problem.free),
                *((name, *ends) for name, ends in problem.counts.items()),
            ]
        ),
        "the objective and limits": repr(
            (problem.objective, [(_identity(term.quantity), term.weight) for term in problem.terms])
        ),
        "the limits": repr(keeps),
        **({"how it grows": repr(problem.growth)} if problem.growth else {}),
        "the tolerances": repr(sorted(problem.spreads.items())),
        "the material's errors": repr(None if errors is None else (errors.names, errors.matrix.tolist())),
    }


def _identity(asked: DesignQuantity) -> str:
    """Return a quantity's key with all that it was given; of a file what was read, wherever it is."""
    given = {field.name: getattr(asked, field.name) for field in dataclasses.fields(asked) if field.name != "file"}
    return f"{asked.key} {given}"


class DesignFolder:
    """The folder of one optimisation, locked; only rank 0 has one. By default it is ``results/NAME``, or the next number
    where that holds something else. To resume is to take up the ``trials`` that an earlier run left. Inputs are never
    written. DesignError where the folder cannot be used."""

    def __init__(self, problem: DesignProblem, output: Path | None, resume: bool, inputs: Sequence[Path] = ()):
        self.problem, self.identity = problem, identity(problem)
        self.trials: list[Trial] = []
        self._best = 0
        try:
            default = Path("results") / problem.name
            self.own = folders.take_default(default, KIND, self.identity) if output is None else folders.OwnFolder(output, KIND)
            self.own.take()
        except (folders.InUseError, folders.OwnFolderError) as error:
            raise DesignError(str(error)) from None
        except OSError as error:
            raise DesignError(f"the folder {output or default} cannot be written ({errors.reason(error)})") from None
        self._iterates = folders.OwnFolder(self.path / ITERATES, ITERATES)
        try:
            self._new = not (resume and self._take_up())
            self.own.check_inputs(inputs)
        except folders.OwnFolderError as error:
            self.leave()
            raise DesignError(str(error)) from None
        except BaseException:
            self.leave()
            raise

    @property
    def path(self) -> Path:
        return self.own.path

    def _take_up(self) -> bool:
        """Read the earlier trials; return whether there are any."""
        before = self.own.about.get("inputs")
        if before is None:
            return False
        for name, value in self.identity.items():
            if before.get(name) != value:
                raise DesignError(
                    f"{self.path} holds designs of another problem: {name} changed; run without --resume, "
                    f"or use another folder (--output)"
                )
        for number in range(1, 100000):
            file = self.path / ITERATES / f"{number:04d}.json"
            if not file.is_file():
                break
            try:
                self.trials.append(Trial.from_json(read_text(file)))
            except (OSError, ValueError):
                raise DesignError(f"{file} cannot be read as a design; run without --resume") from None
        return bool(self.trials)

    # -- writing --------------------------------------------------------------------------------------------------------

    def add(self, trials: Sequence[Trial], form: Formulation | None) -> None:
        """Write the last of some trials, the table of all, and the best design so far; OwnFolderError or OSError if that
        fails."""
        if self._new:
            self.own.remove(self.own.files)
            self.own.claim([TABLE, DESIGN, START, f"{ITERATES}/"], {"inputs": self.identity})
            write_text(self.path / START, result.case_text(self.problem, self.problem.case))
            self._new = False
        (self.path / ITERATES).mkdir(exist_ok=True)
        trial = trials[-1]
        names = [f"{trial.number:04d}.json", f"{trial.number:04d}.toml"]
        self._iterates.claim(names)
        with contextlib.suppress(*entries.INPUT_ERRORS):  # an invalid device has no case
            write_text(self.path / ITERATES / names[1], result.case_text(self.problem, result.case_of(self.problem, trial)))
        write_text(self.path / ITERATES / names[0], trial.to_json())
        write_text(self.path / TABLE, table(self.problem, trials, form))
        # Compare only values of one mesh: those of the previous one may satisfy limits that are violated on a fresh one.
        if form is None:
            return
        best = form.best([done for done in trials if done.mesh == trial.mesh])
        if best is not None and (trial.start == 1 or best is form.best(trials)):
            self._write_best(best)

    def settle(self, best: Trial, trials: Sequence[Trial]) -> Path:
        """Write the final design of an optimisation; return its folder."""
        if trials and not self._new:
            self._write_best(best)
        return self.path

    def _write_best(self, best: Trial) -> None:
        if best.number != self._best:
            write_text(self.path / DESIGN, result.case_text(self.problem, result.case_of(self.problem, best)))
            self._best = best.number

    def write(self, files: Mapping[str, str | bytes]) -> None:
        """Write further files, such as the summary and the pictures."""
        self.own.claim(list(files))
        for name, content in files.items():
            if isinstance(content, str):
                write_text(self.path / name, content)
            else:
                write_bytes(self.path / name, content)

    def leave(self) -> None:
        """Release the folder."""
        self.own.leave()


def table(problem: DesignProblem, trials: Sequence[Trial], form: Formulation | None) -> str:
    """Return ``iterates.csv``: one row per trial, units in the heads of the columns."""
    keys: dict[str, tuple[str, float]] = {}
    for trial in trials:
        for asked in problem.quantities:
            for key in trial.values:
                if key == asked.key or key.startswith(f"{asked.key.removesuffix('s')}:"):
                    words = label(asked, problem.case) if key == asked.key else key
                    unit = "" if shown(asked) == "1" else f" ({shown(asked)})"
                    keys[key] = words + unit, shown_factor(asked)
    units = [(free, shown_unit(free.unit) or "1") for free in problem.free]
    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow([
        "number", "start", *(free.name + ("" if unit == "1" else f" ({unit})") for free, unit in units),
        *(words for words, _ in keys.values()), "limits kept", "worst limit (share passed)", "newton_iterations", "seconds",
        "mesh_quality", "remeshed", "failure",
    ])  # fmt: skip
    for trial in trials:
        kept = form is not None and not trial.failed
        worst = f"{form.worst(trial)[0]:.6g}" if kept and form is not None else ""
        rows.writerow([
            trial.number, trial.start,
            *(f"{value / factor(unit, free.unit or '1'):.9g}" for (free, unit), value in zip(units, trial.theta, strict=False)),
            *(f"{trial.values[key] / per:.9g}" if key in trial.values else "" for key, (_, per) in keys.items()),
            int(form.feasible(trial)) if form is not None and kept else "", worst, trial.newton, f"{trial.seconds:.3f}",
            f"{trial.quality:.4g}", int(trial.remeshed), trial.failure,
        ])  # fmt: skip
    return out.getvalue()


def line(problem: DesignProblem, trial: Trial, form: Formulation | None, left: float | None) -> str:
    """Return a trial in one line, for the terminal."""
    head = f"design {trial.number:3d} (start {trial.start})"
    if trial.failed or form is None:
        more = "" if trial.number == 1 else "; retrying with a shorter step"
        return f"{head}  {trial.failure or 'evaluated'}{more}  {trial.seconds:.1f} s"
    asked = problem.terms[0].quantity
    worst, row = form.worst(trial)
    limits = "no limits"
    if row is not None:
        limits = f"{'VIOLATED' if worst > LIMIT_TOLERANCE else 'satisfied'}: {row.compared(trial.values[row.key], worst)}"
    return (
        f"{head}  {label(asked, problem.case)} {in_words(asked, form.objective(trial), 5)}  "
        f"{limits}  {trial.newton} iterations  {trial.seconds:.1f} s{processes.time_left(left)}"
    )
