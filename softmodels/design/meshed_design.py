"""One mesh of a device that is being designed, its states and quantities made ready: it follows designs and judges them."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from geometries import Actuator, GeometryError, MeshingError
from geometries.parameters import changed, parameter
from softmodels.case.case import Case
from softmodels.case.parts_entry import without_walls
from softmodels.design.adjoint import Adjoint
from softmodels.design.bifurcations import Bifurcations
from softmodels.design.designed_body import DesignedBody
from softmodels.design.evaluation import DesignFailure
from softmodels.design.known_states import Known
from softmodels.design.loads import PRESSURE, Load
from softmodels.design.quantities.base import Quantity, Slopes, TargetMeasure
from softmodels.design.quantities.geometric import DeviceQuantity
from softmodels.design.quantities.limits import OfBifurcation, OfLimit
from softmodels.design.question import Judged, Question
from softmodels.design.squares import Squares
from softmodels.design.states import WorkingStates
from softmodels.design.transfer import Transfer
from softmodels.mechanics.mpi import on_root
from softmodels.mechanics.newton import NoConvergence
from softmodels.path.stability import Stability

if TYPE_CHECKING:
    from mpi4py import MPI

    from softmodels.mechanics.system import State

Array = npt.NDArray[np.float64]

POOREST = 0.3
"""Quality of a mesh below which the device is meshed again."""
SHORTEST = 1 / 4
"""Shortest step on the way from one design to the next before the states are looked for along the whole path."""


class PoorMesh(RuntimeError):
    """A mesh that has been moved too far to be solved on."""


class UnstableState(DesignFailure):
    """A state that the device leaves by itself."""


class MeshedDesign:
    """A mesh, its equations and states, and the quantities made ready on it.

    Args:
        design: The meshed device, undeformed.
        question: What is asked of it.
    """

    def __init__(self, design: DesignedBody, question: Question):
        self.design, self.solver, self.question = design, design.solver, question
        self.adjoint = Adjoint(design)
        self.measures = {
            part: part.measure(design) for part in question.parts if not isinstance(part, OfLimit | DeviceQuantity)
        }
        forks = any(isinstance(part, OfBifurcation) for part in question.parts)
        self.bifurcations = Bifurcations(design, self.adjoint) if forks else None
        self.states = WorkingStates(design, question.loads, question.highest, self.bifurcations)
        self._stable: tuple[Actuator, Known] | None = None
        """The last design that was judged, and its states."""

    @classmethod
    def fresh(
        cls, case: Case, device: Actuator, question: Question, comm: MPI.Comm, before: MeshedDesign | None = None
    ) -> MeshedDesign:
        """A fresh mesh of a device, with its states.

        Args:
            case: Silicone, sheet, obstacle and formulation.
            device: The device.
            question: What is asked of it.
            comm: MPI communicator.
            before: Another mesh that shows this device now, whose states are interpolated; without it, or where Newton's method
                does not find them so, they are found along the whole path.

        Raises:
            DesignFailure: It cannot be meshed, or a load is not met.
        """
        from softmodels.mechanics.body import Body
        from softmodels.mechanics.compiling import compiling
        from softmodels.mechanics.solver import Solver
        from softmodels.mechanics.system import System

        with tempfile.TemporaryDirectory() as folder:
            file = Path(comm.bcast(folder)) / "design.msh"
            try:
                on_root(comm, lambda: device.write(file))
            except MeshingError as error:
                raise DesignFailure(str(error)) from error
            body = Body.from_file(device, file, comm)
            comm.barrier()
        with compiling():
            system = System(body, case.material, case.formulation, case.sheet, case.obstacle, without_walls(case.parts))
            solver = Solver(system, case.solver)
            made = cls(DesignedBody(solver), question)
        try:
            if before is None or not made._taken_over(before):
                made.states.trace()
        except BaseException:
            made.release()
            raise
        return made

    def _taken_over(self, before: MeshedDesign) -> bool:
        """Take the states of another mesh that shows the same device; whether they were found so."""
        guess = before.states.known.transferred(Transfer(before.design, self.design))
        try:
            self.states.carry(guess)
            for load in self.question.loads:
                self._settled(load)
        except (NoConvergence, DesignFailure):  # which may be the interpolation's fault
            return False
        return True

    def release(self) -> None:
        """Give back what PETSc and MPI hold."""
        self.design.release()

    def follow(self, device: Actuator) -> None:
        """Move the mesh to a device and its states with it, in smaller steps where Newton's method does not follow.

        From the second step on the states are expected on the straight line through the last two. Where that does not help
        either, they are found along the whole path.

        Raises:
            GeometryError: The mesh cannot follow.
            PoorMesh: The cells would be too poor.
            DesignFailure: A load is not met. After any of these, mesh and states are those of before.
        """
        motion, states = self.design.motion, self.states
        start, first = motion.device, states.known
        self._move(device)
        way, step, earlier = 0.0, 1.0, list[tuple[float, Known]]()
        while way < 1.0:
            goal = min(way + step, 1.0)
            try:
                motion.move(device if goal == 1.0 else _between(start, device, goal, self.question.names))
                here = states.known
                states.carry(here.ahead(earlier[0][1], (goal - way) / (way - earlier[0][0])) if earlier else None)
            except NoConvergence:
                step /= 2
                if step < SHORTEST:
                    self._retrace(device, start, first)
                    return
                continue
            except (DesignFailure, GeometryError):
                self._restore(start, first)
                raise
            earlier, way = [(way, here)], goal

    def _retrace(self, device: Actuator, start: Actuator, first: Known) -> None:
        """Find the states of a device along the whole path, on the mesh as it is."""
        self.design.motion.move(device)
        try:
            self.states.trace()
        except DesignFailure:
            self._restore(start, first)
            raise

    def _move(self, device: Actuator) -> None:
        """Move the mesh, unless its cells would become poor: then it stays where it is."""
        motion = self.design.motion
        before = motion.device
        motion.move(device)
        if motion.quality() < POOREST:  # nor will smaller steps make better cells of the last one's
            motion.move(before)
            raise PoorMesh("the moved cells have become poor")

    def _restore(self, device: Actuator, known: Known) -> None:
        self.design.motion.move(device)
        self.states.known = known

    def judge(self, gradients: bool = True) -> tuple[dict[str, Judged], list[str]]:
        """Values and gradients of the question's parts by key, and sentences on how far they can be trusted.

        States that were carried from another design may lie on a branch that is unstable here. Then they are found again along
        the whole path.

        Raises:
            DesignFailure: A state is unstable, or a load is not met. Mesh and states are those of the last judged design then.
        """
        try:
            try:
                found = self._judged(gradients)
            except UnstableState:
                if not self.states.carried:
                    raise
                self.states.trace()
                found = self._judged(gradients)
        except DesignFailure:
            if self._stable is not None:
                self._restore(*self._stable)
            raise
        self._stable = self.design.motion.device, self.states.known
        return found

    def _judged(self, gradients: bool) -> tuple[dict[str, Judged], list[str]]:
        """The same of the states as they are.

        Raises:
            UnstableState: One of them is unstable.
        """
        motion, question = self.design.motion, self.question
        velocities = motion.boundary_velocities(question.names) if gradients else {}
        found: dict[str, Judged] = {}
        notes = []
        for load in (None, *question.loads):
            parts = [part for part in self.measures if part.load == load]
            state = None if load is None or not parts else self._settled(load)
            for part in parts:
                slopes = self.measures[part].slopes(state)
                if slopes.note:
                    notes.append(f"{part.key}: {slopes.note}")
                judged = self._whole(part, slopes, velocities) if gradients else Judged(slopes.value, np.zeros(0), {})
                measure = self.measures[part]
                if gradients and state is not None and load is not None and isinstance(measure, TargetMeasure):
                    judged = dataclasses.replace(judged, squares=self._squares(measure, state, load, velocities))
                found[part.key] = judged
        for part in question.parts:
            if isinstance(part, OfLimit):
                critical = self._critical(part, velocities)
                if critical is None:
                    reached = f"{question.highest / 1e3:.4g} kPa"
                    notes.append(f"{part.key}: there is none up to {reached}, which stands in its place")
                    critical = Judged(
                        question.highest, np.zeros(len(velocities)), dict.fromkeys(question.materials, 0.0)
                    )
                found[part.key] = critical.times(part.factor(question.working))
            elif isinstance(part, DeviceQuantity):
                values, columns = part.values(motion.device), part.derivatives(motion.device, question.names)
                found |= {
                    key: Judged(value, columns[key] if gradients else np.zeros(0), {}) for key, value in values.items()
                }
        return found, notes

    def _settled(self, load: Load) -> State:
        """The state at a load, its tangent factorised.

        Raises:
            UnstableState: The device leaves it by itself.
        """
        state = self.states.states[load]
        self.adjoint.prepare(state)
        if load.kind == PRESSURE:
            negative = Stability.of(self.solver).negative_eigenvalues()
            if negative:
                values = "eigenvalue" if negative == 1 else "eigenvalues"
                raise UnstableState(f"the state at {load} is unstable: its tangent has {negative} negative {values}")
        return state

    def _squares(self, measure: TargetMeasure, state: State, load: Load, velocities: dict[str, Array]) -> Squares:
        """Distances from a target with their derivatives at the settled state."""
        columns = [measure.moved(state, *self.adjoint.rates(load.kind, velocity)) for velocity in velocities.values()]
        return Squares.of(measure.residuals(state), np.array(columns).T, measure.run, measure.sigma)

    def _whole(self, part: Quantity, slopes: Slopes, velocities: dict[str, Array]) -> Judged:
        """A part with its whole derivatives at the settled state."""
        names, load = self.question.materials, part.load
        direct = self.adjoint.by_material(self.measures[part], names) if names and load else dict.fromkeys(names, 0.0)
        by_length, by_material = self.adjoint.gradient(
            slopes, PRESSURE if load is None else load.kind, velocities, direct if load else {}
        )
        return Judged(slopes.value, np.array([by_length[name] for name in velocities]), by_material or direct)

    def _critical(self, part: OfLimit, velocities: dict[str, Array]) -> Judged | None:
        """Pressure in Pa of the limit point or the bifurcation; None if there is none."""
        states, materials = self.states, self.question.materials
        limit, fork = states.limit, states.bifurcation
        if isinstance(part, OfBifurcation):
            if fork is None or self.bifurcations is None:
                return None
            P, found = fork.P, self.bifurcations.gradient(fork, velocities, materials) if velocities else None
        elif limit is None:
            return None
        else:
            P = limit.state.P
            found = (
                self.adjoint.limit_gradient(limit.state, limit.tangent, velocities, materials) if velocities else None
            )
        by_length, by_material = found or ({}, {})
        rates = np.array([by_length[name] for name in velocities])
        return Judged(P * self.design.system.stress_unit, rates, by_material)


def _between(start: Actuator, end: Actuator, share: float, names: Sequence[str]) -> Actuator:
    """The device on the straight line between two."""
    return changed(
        start, {name: (1.0 - share) * parameter(start, name) + share * parameter(end, name) for name in names}
    )
