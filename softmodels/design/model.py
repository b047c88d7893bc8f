"""A device as the optimiser sees it: parameters in, values and gradients of quantities out."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from geometries import Actuator, GeometryError
from geometries.parameters import changed, parameter
from softmodels.case.case import Case
from softmodels.design.evaluation import DesignFailure, Evaluation
from softmodels.design.meshed_design import MeshedDesign, PoorMesh
from softmodels.design.quantities.base import Quantity
from softmodels.design.quantities.composite import CompositeQuantity
from softmodels.design.quantities.geometric import DeviceQuantity
from softmodels.design.quantities.limits import OfLimit
from softmodels.design.question import Judged, Question

if TYPE_CHECKING:
    from mpi4py import MPI

Array = npt.NDArray[np.float64]

FARTHEST = 3.0
"""Working pressures up to which a limit point is looked for."""


class DesignModel:
    """Judges designs of one device, each from the states of the one before.

    Args:
        case: The device as it starts, its silicone, sheet, obstacle and formulation.
        names: The parameters that are free, of `geometries.parameters.parameter_names`.
        quantities: What is asked of each design.
        comm: MPI communicator; every call is made by all ranks.
        highest: Pressure in Pa up to which a limit point is looked for where a quantity is of it; by default `FARTHEST` times
            the highest working pressure.
        materials: Numbers of the material by which derivatives are wanted.
        report: Takes sentences on what is going on.

    Raises:
        GeometryError: A parameter that the device's mesh cannot follow.
    """

    def __init__(
        self, case: Case, names: Sequence[str], quantities: Sequence[Quantity], comm: MPI.Comm, *,
        highest: float | None = None, materials: Sequence[str] = (), report: Callable[[str], None] = lambda text: None,
    ):  # fmt: skip
        self.case, self.names, self.comm, self.report = case, tuple(names), comm, report
        if unknown := [name for name in self.names if name not in case.actuator.movable]:
            raise GeometryError(
                f"{unknown[0]} is no parameter that the mesh of {type(case.actuator).__name__} can follow; "
                f"it follows {', '.join(case.actuator.movable) or 'none'}"
            )
        self.quantities = tuple(quantities)
        parts = tuple(dict.fromkeys(part for one in self.quantities for part in _parts(one)))
        loads = tuple(sorted({part.load for part in parts if part.load is not None}))
        self.question = Question(self.names, parts, loads, 0.0, tuple(materials))
        if any(isinstance(part, OfLimit) for part in parts):
            up_to = highest or FARTHEST * self.question.working
            self.question = dataclasses.replace(self.question, highest=up_to)
        self.meshed: MeshedDesign | None = None

    @property
    def start(self) -> Array:
        """The parameters of the case's own device."""
        return np.array([parameter(self.case.actuator, name) for name in self.names])

    def device(self, theta: Array) -> Actuator:
        """The device with these parameters.

        Raises:
            DesignFailure: They make no device.
        """
        try:
            return changed(self.case.actuator, dict(zip(self.names, np.asarray(theta, dtype=float), strict=True)))
        except GeometryError as error:
            raise DesignFailure(str(error)) from error

    def evaluate(self, theta: Array) -> Evaluation:
        """Values and gradients of all quantities at these parameters.

        Raises:
            DesignFailure: They make no device, or it has no stable state at one of the loads.
        """
        device = self.device(theta)
        remeshed = self._ready(device)
        meshed = self.meshed
        assert meshed is not None
        found, notes = meshed.judge()
        own = self._gathered(found)
        return Evaluation(
            np.array(theta, dtype=float), device, {key: judged.value for key, judged in own.items()},
            {key: judged.gradient for key, judged in own.items() if judged.gradient.size},
            {key: judged.by_material for key, judged in own.items() if judged.by_material},
            meshed.design.motion.quality(), meshed.states.newton, remeshed, tuple(notes),
            {key: judged.squares for key, judged in own.items() if judged.squares is not None},
        )  # fmt: skip

    def confirm(self, theta: Array, finer: float = 1.0) -> Evaluation:
        """The values alone, on a fresh mesh and along the whole path.

        Args:
            theta: The parameters.
            finer: How many times smaller the cells are than the case's.

        Raises:
            DesignFailure: As for `evaluate`.
        """
        device = self.device(theta)
        if finer != 1.0:
            device = _finer(device, finer)
        meshed = MeshedDesign.fresh(self.case, device, self.question, self.comm)
        try:
            found, notes = meshed.judge(gradients=False)
            values = {key: judged.value for key, judged in self._gathered(found).items()}
        finally:
            meshed.release()
        return Evaluation(
            np.array(theta, dtype=float), device, values, {}, {}, 1.0, meshed.states.newton, True, tuple(notes)
        )

    def release(self) -> None:
        """Give back what PETSc and MPI hold."""
        if self.meshed is not None:
            self.meshed.release()
            self.meshed = None

    # -- meshes and states ----------------------------------------------------------------------------------------------

    def _ready(self, device: Actuator) -> bool:
        """Bring mesh and states to a device; whether a fresh mesh was made."""
        if self.meshed is not None:
            self.meshed.states.newton = 0
            try:
                self.meshed.follow(device)
                return False
            except PoorMesh as failure:
                self.report(f"meshed again: {failure}")
                if self._meshed_where_it_is(self.meshed) and self._followed(device):
                    return True
            except GeometryError as failure:
                self.report(f"meshed again, and the whole path solved: {failure}")
        # A design that fails leaves the mesh of the one before, to which a search steps back.
        fresh = MeshedDesign.fresh(self.case, device, self.question, self.comm)
        self.release()
        self.meshed = fresh
        return True

    def _meshed_where_it_is(self, before: MeshedDesign) -> bool:
        """Mesh the last design again and take its states over; whether there is a mesh."""
        try:
            fresh = MeshedDesign.fresh(self.case, before.design.motion.device, self.question, self.comm, before)
        except DesignFailure:
            return False
        fresh.states.newton += before.states.newton
        self.release()
        self.meshed = fresh
        return True

    def _followed(self, device: Actuator) -> bool:
        """Whether mesh and states could follow to a device."""
        assert self.meshed is not None
        try:
            self.meshed.follow(device)
        except (GeometryError, PoorMesh) as failure:
            self.report(f"meshed once more, and the whole path solved: {failure}")
            return False
        return True

    # -- values and gradients -------------------------------------------------------------------------------------------

    def _gathered(self, found: dict[str, Judged]) -> dict[str, Judged]:
        """The quantities themselves by key, those of several states put together."""
        own: dict[str, Judged] = {}
        for one in self.quantities:
            if isinstance(one, CompositeQuantity):
                own[one.key] = _combined(one, [found[part.key] for part in one.parts])
            elif isinstance(one, DeviceQuantity):
                own |= {key: found[key] for key in one.values(self.case.actuator)}
            else:
                own[one.key] = found[one.key]
        return own


def _combined(one: CompositeQuantity, parts: Sequence[Judged]) -> Judged:
    values, slopes = np.array([part.value for part in parts]), np.array([part.gradient for part in parts])
    value, weights = one.combined(values)
    gradient = slopes.T @ weights
    squares = one.squares(values, slopes) if gradient.size else None
    names = parts[0].by_material
    rates = {name: float(weights @ np.array([part.by_material[name] for part in parts])) for name in names}
    return Judged(value, gradient, rates, squares)


def _finer(device: Actuator, times: float) -> Actuator:
    """The same device with smaller cells, those around channels too."""
    sizes = {field.name for field in dataclasses.fields(device)}
    changes = {"cell_size": getattr(device, "cell_size", 0.0) / times, "around": getattr(device, "around", 0.0) * times}
    return dataclasses.replace(device, **{name: value for name, value in changes.items() if name in sizes})


def _parts(one: Quantity) -> tuple[Quantity, ...]:
    return one.parts if isinstance(one, CompositeQuantity) else (one,)
