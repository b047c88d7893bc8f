"""A device whose equations are made: its equilibria, its path, its natural frequencies and modes, without files."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from geometries import Actuator
from softmodels.case.case import Case, Values, in_unit
from softmodels.case.entries import CaseError
from softmodels.common.arrays import Array
from softmodels.common.cards import Shown, Table
from softmodels.common.lazy import MPI
from softmodels.common.names import checked, read_only
from softmodels.common.processes import one_at_a_time
from softmodels.components.loads import densities
from softmodels.materials.laws import Material
from softmodels.mechanics.assembly import Inertia
from softmodels.mechanics.body import Body, BodyError
from softmodels.mechanics.compiling import CompilingError, compiling
from softmodels.mechanics.component import Component
from softmodels.mechanics.controls import HeavyPart
from softmodels.mechanics.memory import Motion
from softmodels.mechanics.mpi import is_root, on_root, start
from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State, System
from softmodels.path.continuation import Continuation, trace
from softmodels.path.schedule import HangingEnd, StageEnd, hang, inflate_from, load_from
from softmodels.path.stability import DIRECT, DeadForce, LoadDisplacement, PathEnd, Point, Pressure, Springs, Stability
from softmodels.path.supply import AMBIENT
from softmodels.runs.fields import Fields, Figures, Row
from softmodels.runs.notes import sentences
from softmodels.runs.outcomes import FAILED, NO_EQUILIBRIUM, RunError
from softmodels.runs.states import States


@contextlib.contextmanager
def temporary_folder(comm: MPI.Comm) -> Iterator[Path]:
    """Provide a temporary folder, the same on all ranks."""
    path = on_root(comm, lambda: Path(tempfile.mkdtemp(prefix="softmodels-")))
    try:
        yield path
    finally:
        if is_root(comm):
            shutil.rmtree(path, ignore_errors=True)


def meshed(device: Actuator, comm: MPI.Comm) -> Body:
    """Mesh a device and read its mesh; all ranks call it. `MeshingError` or `MeshFileError` if that fails, `RunError` if
    nothing can be compiled."""
    with temporary_folder(comm) as folder:
        path = folder / "device.msh"
        on_root(comm, lambda: device.write(path))
        return body_of(device, path, comm)


def body_of(device: Actuator, mesh: Path, comm: MPI.Comm) -> Body:
    """Read a device's mesh; all ranks call it. `MeshFileError` if it is none of `Actuator.write`, `RunError` if it is of
    another device, or nothing can be compiled."""
    try:
        return Body.from_file(device, mesh, comm)
    except (BodyError, CompilingError) as error:
        raise RunError(str(error)) from error


class AtRest(Case):
    """A case of a device without a cavity, of which nothing is requested but how it hangs under its dead loads."""

    def _check_load(self) -> None:
        if self.load.values:
            super()._check_load()


@checked
class Model:
    """A device, meshed, and the equations of its equilibrium.

    Under weights and other dead loads every path begins where the device hangs under them. Every call is made by all ranks.

    Args:
        device: The device. One without a cavity has only the state at rest, or under its dead loads.
        material: Its silicone, or the name of one.
        components: Components added to it: `Gravity`, `Rigid`, `Fibres` and others, one or several.
        formulation: ``"mixed"`` (displacement and pressure) or ``"displacement"``.
        solver: How linear equations are solved: ``"auto"``, ``"direct"`` or ``"iterative"``.

    Raises:
        ArgumentError, CaseError: Invalid input.
        RunError: The equations cannot be compiled, or do not fit into memory.
        MeshingError, MeshFileError: The device cannot be meshed.

    Attributes:
        case: The device with all around it; of its load only what is part of the preload matters.
        body, system, solver, fields: Its mesh, its equations, what solves them, and the fields of its states.
    """

    @one_at_a_time
    def __init__(
        self,
        device: Actuator,
        material: Material | str,
        components: Component | Sequence[Component] = (),
        formulation: str = "mixed",
        *,
        solver: str = "auto",
    ):
        kind, pressures = (Case, (1.0,)) if getattr(device, "ratios", True) else (AtRest, ())
        case = kind(
            "model", device, material, pressures_cm=pressures, components=components,  # type: ignore[arg-type]
            formulation=formulation, solver=solver,
        )  # fmt: skip
        comm = start()
        with sentences():
            self._make(case, meshed(device, comm), case.material, case.components)

    @classmethod
    def of(
        cls, case: Case, body: Body, material: Material | None = None, components: Sequence[Component] | None = None
    ) -> Model:
        """The model of a case on a mesh that is read already, with another material or components where they are given;
        `RunError` if its equations cannot be set up or compiled."""
        made = cls.__new__(cls)
        made._make(case, body, material or case.material, case.components if components is None else components)
        return made

    def _make(self, case: Case, body: Body, material: Material, components: Sequence[Component]) -> None:
        self.case, self.body = case, body
        self.components = components
        try:
            with compiling():
                self.system = System(body, material, case.formulation, components, creeping=case.timed)
                self.solver = Solver(self.system, case.solver)
                self.fields = Fields(self.solver, case.gauges, case.fields)
            self.system.direction = case.load.direction
        except (BodyError, CompilingError) as error:
            raise RunError(str(error)) from error

    def __repr__(self) -> str:
        size = self.system.space.dofmap
        return f"<Model of {self.case.actuator.stem}: {size.index_map.size_global * size.index_map_bs} unknowns>"

    def release(self) -> None:
        """Give back what PETSc and MPI hold; the model is not used afterwards."""
        self.solver.release()

    # -- states -------------------------------------------------------------------------------------------------------

    @checked
    @one_at_a_time
    def solve(self, pressure: float | str | None = None, volume: float | str | None = None) -> Equilibrium:
        """The equilibrium at a pressure or an added volume; the path to there is followed.

        Args:
            pressure: In Pa, or a text such as ``"7 kPa"`` or ``"70 cm"``.
            volume: Added volume of the cavity in m3, or a text such as ``"40 ml"``; past a limit point of the pressure too.
                With neither, the state under the dead loads, which is undeformed where there are none.

        Raises:
            ArgumentError, CaseError: Invalid input.
            RunError: There is no such equilibrium on the path, or it was not found.
        """
        if pressure is None and volume is None:
            state = self.hanging() or self.system.rest()
            return Equilibrium(self, state)
        *_, last = self.path(None if pressure is None else [pressure], None if volume is None else [volume])
        return last

    @checked
    def path(
        self, pressures: Values | None = None, volumes: Values | None = None, *, control: str = "auto"
    ) -> Iterator[Equilibrium]:
        """Follow the device from rest, and yield every state: the requested ones, those between, limit points, bifurcations.

        Args:
            pressures: Pressures to stop at, rising: ``"0:177 cm"``, ``"0:17:1 kPa"``, or numbers in Pa.
            volumes: The same of added volumes: ``"0:60 ml"``, or numbers in m3.
            control: What the path follows: ``"auto"``, ``"pressure"``, ``"volume"`` or ``"arc-length"``.

        Raises:
            ArgumentError, CaseError: Invalid input.
            RunError: The path ends before the last requested value.
        """
        if (pressures is None) == (volumes is None):
            raise CaseError("give the pressures or the added volumes that the path goes to, one of them")
        unit, values, what = ("cm", pressures, "pressure") if volumes is None else ("ml", volumes, "volume")
        asked = in_unit(unit, values, what, self.case.cm)
        quantity = {f"{what}s_{unit}": asked, **({"pressures_cm": ()} if unit == "ml" else {})}
        case = dataclasses.replace(self.case, control=control, **quantity)  # type: ignore[arg-type]
        return self.followed(case, what)

    def followed(self, case: Case, quantity: str) -> Iterator[Equilibrium]:
        """Follow the device through the pressures or added volumes of a case; see `path`."""
        self.system.direction = case.load.direction
        unit = self.unit_of(quantity)
        try:
            for point in trace(self.continuation(quantity, case.control), [goal / unit for goal in case.goals]):
                yield Equilibrium(self, point.state, point)
        except PathEnd as end:
            status = NO_EQUILIBRIUM if end.physical else FAILED
            raise RunError(f"the path ends before the last requested {quantity}: {end}", status) from end
        except NoConvergence as failure:
            raise RunError(f"the path could not be followed ({failure})") from failure

    def continuation(
        self, quantity: str = "pressure", control: str = "auto", hung: StageEnd | None = None
    ) -> Continuation:
        """The path to pressures or added volumes, not begun yet; its values are dimensionless. ``hung``: see `hanging`."""
        return Continuation(self.solver, DIRECT[quantity], control, start=self.hanging(hung=hung))

    # -- preload ------------------------------------------------------------------------------------------------------

    def hanging(self, report: Callable[[str], None] = lambda text: None, hung: StageEnd | None = None) -> State | None:
        """The state in which the device hangs under its preload (``hung``, where it is known), from which the path to
        requested values starts; None without dead loads, `RunError` if there is none. ``report`` takes sentences on what is
        going on."""
        hung, driven = self.preload(report) if hung is None else hung, self.case.driven
        if hung is None:
            self.system.coupling = self.system.inflating(np.empty(0))
            return None
        if driven is None:
            return inflate_from(self.solver, hung)
        return load_from(self.solver, hung, len(self.case.actuator.ratios) + self.driven_load)

    def preload(self, report: Callable[[str], None] = lambda text: None) -> StageEnd | None:
        """The state under all loads that act before the first requested value, its drivers not coupled, see `hanging`;
        `RunError` if there is none."""
        case, system, dead = self.case, self.system, self.system.dead
        if not dead.loads:
            return None
        changed = {series.target for series in case.program}
        changed |= {case.driven.of(case.components).key} if case.driven else set()
        kept = [0.0 if load.key in changed else amount for load, amount in zip(dead.loads, dead.amounts, strict=True)]
        ratios = np.array(case.actuator.ratios)
        magnitudes = np.concatenate([np.zeros(len(ratios)), np.array(kept) / dead.units])
        targets = [("its dead loads", magnitudes)]
        if case.driven is not None and case.driven.at_pressure_cm:
            inflated = magnitudes.copy()
            inflated[: len(ratios)] = case.driven.at_pressure_cm * case.cm / system.stress_unit * ratios
            targets.append((f"{case.driven.at_pressure_cm:g} cm", inflated))
        if words := [what for what, amounts in targets if amounts.any()]:
            report(f"applying {', then '.join(words)}")
        try:
            hung = hang(self.solver, targets, report)
        except HangingEnd as end:
            raise RunError(end.sentence, NO_EQUILIBRIUM if end.physical else FAILED) from end
        dead.origins = hung.driven
        return hung

    @property
    def driven_load(self) -> int:
        """Place among the dead loads of the one whose values are requested."""
        assert self.case.driven is not None
        return self.system.dead.index(self.case.driven.of(self.case.components).key)

    def unit_of(self, quantity: str) -> float:
        """SI units in one dimensionless value of a quantity, by its name; of shares of the weight the weight; below 0 for
        pressures and volumes of a path to vacuum, see `System.direction`."""
        system, driven = self.system, self.case.driven
        if quantity == Pressure.name:
            return system.direction * system.stress_unit
        if driven is not None and quantity in (DeadForce.name, LoadDisplacement.name):
            place = self.driven_load
            unit = (system.dead.moved_units if driven.asked.held else system.dead.units)[place]
            return float(unit / (system.dead.amounts[place] if driven.key == "share" else 1.0))
        return system.direction * system.volume_unit

    # -- modes --------------------------------------------------------------------------------------------------------

    @checked
    @one_at_a_time
    def modes(self, equilibrium: Equilibrium | None = None, count: int = 4, *, sealed: bool = False) -> list[Mode]:
        """The natural modes of a state, from the lowest frequency up; unstable ones first.

        They are the vibrations of small amplitude, without damping. The silicone has the density of `Gravity`, or of its data
        sheet, or 1070 kg/m3; regions have their own, and masses and plates bonded to the device swing with it.

        Args:
            equilibrium: A state of this model; that of `solve` without arguments if None.
            count: At least how many.
            sealed: Each cavity is closed, with air that keeps its temperature (at 101325 Pa around the device). Else the
                cavities keep their pressures.

        Raises:
            CaseError: A device without mass, or a sealed one without a cavity.
            RunError: There is no such state, or the modes do not converge.
        """
        density = self._densities[0]
        state = (equilibrium or self.solve()).state
        self.system.load(state)
        springs = self._springs(state, sealed)
        try:
            pairs = self._stability.eigenpairs(state, count, springs)
        except NoConvergence as failure:
            raise RunError(f"the modes were not found ({failure}); ask for fewer, or use smaller cells") from failure
        unit = self.system.stress_unit / self.system.length_unit**2
        return [Mode(value * unit, density, self._shape(w)) for value, w in pairs]

    @functools.cached_property
    def _densities(self) -> list[float]:
        """Densities in kg/m3 of the materials; `CaseError` if the main one has none, or a mass rests on the device."""
        resting = next((part.where for part in self.components if part.lifted and part.weighs), "")
        if resting:
            raise CaseError(
                f"{resting} rests on the device, and neither frequencies nor inertia are computed with it; leave out its mass"
            )
        found = densities(self.system, self.components)
        if not found[0] > 0.0:
            raise CaseError(
                "the silicone has a density of 0 kg/m^3, and without mass no frequency and no inertia; leave out the density"
            )
        return found

    @functools.cached_property
    def _stability(self) -> Stability:
        """Finds the modes with the device's masses."""
        return Stability.of(self.solver) if self._inertia.plain else Stability(self.solver, self._inertia)

    @functools.cached_property
    def _inertia(self) -> Inertia:
        """The device's masses."""
        main, unit = self._densities[0], self._densities[0] * self.system.volume_unit
        heavy = [part for part in self.components if isinstance(part, HeavyPart) and part.weighs]
        return Inertia(
            tuple(density / main for density in self._densities),
            tuple((part.face, part.weighs / unit) for part in heavy),
        )

    def set_in_motion(self) -> None:
        """Let the inertia of the device's masses act from here on, at rest, if the case asks for it."""
        if not self.case.inertia:
            return
        with compiling():
            motion = Motion(self.system, self._inertia, self._densities[0], self.case.spectral_radius)
        self.system.potential.motion = motion

    def _springs(self, state: State, sealed: bool) -> Springs:
        """The stiffness of sealed air, of the loaded state: -dP/dV = P/V at constant temperature, with P above vacuum."""
        cavities = len(self.case.actuator.ratios) if sealed else 0
        if sealed and not cavities:
            raise CaseError(f"{type(self.case.actuator).__name__} has no cavity to be sealed; leave out --sealed")
        pressures = self.system.pressures_at(state)[:cavities] + AMBIENT / self.system.stress_unit
        return Springs(self.system.pressure_loads()[:cavities], pressures / self.system.volumes()[:cavities])

    def _shape(self, w: Array) -> Array:
        shape = self.fields.shape(w)
        found: Array = on_root(self.body.mesh.comm, lambda: np.asarray(shape) / np.abs(np.asarray(shape)).max())
        return read_only(found)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Mode(Shown):
    """A mode of a device at an equilibrium.

    Attributes:
        eigenvalue: Square of its angular frequency times the density, Pa/m2; negative where the equilibrium is not stable.
        density: Of the silicone, kg/m3.
        displacement: Its shape in device coordinates, shape (n, 3), largest entry 1 or -1.
    """

    eigenvalue: float
    density: float
    displacement: Array

    def _line(self) -> str:
        return (
            f"at {self.frequency:.4g} Hz"
            if self.stable
            else f"unstable, grows by a factor of e in {1 / self.rate:.2g} s"
        )

    @property
    def stable(self) -> bool:
        """Whether the device swings in it, and does not leave its state."""
        return self.eigenvalue > 0.0

    @property
    def frequency(self) -> float:
        """Natural frequency in Hz; nan of an unstable mode."""
        return self.rate / (2 * math.pi) if self.stable else math.nan

    @property
    def rate(self) -> float:
        """Angular frequency in 1/s; of an unstable mode how fast it grows, as exp(rate t)."""
        return math.sqrt(abs(self.eigenvalue) / self.density)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Equilibrium(Shown):
    """A state of a `Model`, SI units. Fields are computed when they are asked for first; arrays are read-only.

    Attributes:
        model: Whose state it is.
        state: Its unknowns, dimensionless.
        point: Its point of the path; None of a state that was not followed to.
    """

    model: Model
    state: State
    point: Point | None = None

    def _line(self) -> str:
        gauge = self.model.case.actuator.gauge
        return (
            f"of {self.model.case.actuator.stem} at {self.pressure / 1e3:.4g} kPa: "
            f"{gauge} rise {self.rises[gauge] * 1e3:.4g} mm, largest stretch {self.largest_stretch:.4g}"
        )

    def _figures(self) -> Table:
        return [
            ("pressure", f"{self.pressure / 1e3:.4g} kPa"),
            ("added volume", f"{self.volume * 1e6:.4g} ml"),
            *((f"rise of the {name}", f"{rise * 1e3:.4g} mm") for name, rise in self.rises.items()),
            ("largest stretch", f"{self.largest_stretch:.4g}"),
            ("elastic energy", f"{self.energy * 1e3:.4g} mJ"),
            *([] if self.stable is None else [("stable under this pressure", "yes" if self.stable else "no")]),
        ]

    @property
    def _states(self) -> States:
        """This state as pictures take it."""
        case, grid = self.model.case, self.model.fields.grid
        row = Row({
            "pressure_Pa": self.pressure, "pressure_cm": self.pressure / case.cm, "added_volume_ml": self.volume * 1e6,
            **{f"{name}_mm": rise * 1e3 for name, rise in self.rises.items()}, "max_stretch": self.largest_stretch,
            "requested": 1, "limit": 0,
        })  # fmt: skip
        nodes = self.points, grid.cells, grid.cell_name
        return States(case, [row], nodes, lambda step, name: self.fields[name])

    @functools.cached_property
    def figures(self) -> Figures:
        """All key figures, of the whole device."""
        return self.model.fields.figures(self.state)

    @functools.cached_property
    def fields(self) -> Mapping[str, Array]:
        """Nodal fields by name: ``displacement`` (n, 3), ``p``, ``von_mises``, ``largest_stretch``, ``J`` (n,)."""
        nodal = self.model.fields.nodal(self.state)
        found = on_root(self.model.body.mesh.comm, lambda: nodal or {})
        return {name: read_only(values) for name, values in found.items()}

    @property
    def pressure(self) -> float:
        """Pa."""
        return self.figures.pressure

    @property
    def volume(self) -> float:
        """Volume in m3 that the cavity has taken."""
        return self.figures.added_volume

    @property
    def energy(self) -> float:
        """Elastic energy in J of the whole device."""
        return self.figures.stored_energy

    @property
    def rises(self) -> dict[str, float]:
        """Rise of each probe in m by its name."""
        return dict(self.figures.rises)

    @property
    def largest_stretch(self) -> float:
        """Largest principal stretch at the integration points."""
        return self.figures.max_stretch

    @property
    def displacement(self) -> Array:
        """Displacement in m, in device coordinates, shape (n, 3)."""
        return self.fields["displacement"]

    @property
    def points(self) -> Array:
        """Undeformed nodes in device coordinates, m, shape (n, 3)."""
        grid = self.model.fields.grid
        return read_only(on_root(self.model.body.mesh.comm, lambda: grid.points))

    @property
    def requested(self) -> bool:
        """Whether it is at one of the requested values."""
        return self.point is not None and self.point.requested

    @property
    def limit(self) -> bool:
        """Whether it is a limit point of the pressure."""
        return self.point is not None and self.point.limit

    @property
    def bifurcation(self) -> bool:
        """Whether another branch leaves the path here."""
        return self.point is not None and self.point.bifurcation

    @property
    def stable(self) -> bool | None:
        """Whether it is stable at its pressure; None of a state that was not followed to."""
        return None if self.point is None else self.point.stable_under_pressure
