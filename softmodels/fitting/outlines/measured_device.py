"""A device that was measured, ready to be solved with the parameters of a law."""

from __future__ import annotations

import dataclasses
import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from geometries import Actuator, GeometryError, MeshingError
from geometries.fields import about
from measurement.arguments import checked, one_of
from softmodels.case.case import Case
from softmodels.fitting.law_parameters import LawChoice
from softmodels.fitting.outlines.device_model import MODULUS, DeviceModel
from softmodels.fitting.outlines.kept_loads import measured_parts
from softmodels.fitting.problem import FitError
from softmodels.materials.material import Material
from softmodels.mechanics.contact import Obstacle
from softmodels.mechanics.mpi import on_root
from softmodels.mechanics.parts import Part, PartError
from softmodels.mechanics.sheet import Sheet

if TYPE_CHECKING:
    from mpi4py import MPI


@checked
@dataclasses.dataclass(frozen=True)
class MeasuredDevice:
    """What was inflated.

    Attributes:
        actuator: Its geometry.
        name: What reports call it.
        material: What it is known to be made of, whose modulus a fit is held against; None if that is not known.
        formulation: See `softmodels.case.case.Case`.
        sheet: A sheet bonded to one of its faces.
        obstacle: A plane that it comes to rest on.
        parts: What else is added to it.
        solver: See `softmodels.case.case.Case`.
        heights_from: What heights count from where it hangs under loads or its top is not flat, see
            `softmodels.fitting.outlines.hanging.Hanging`.
    """

    actuator: Actuator
    name: str = "device"
    material: Material | None = None
    formulation: str = "mixed"
    sheet: Sheet | None = None
    obstacle: Obstacle | None = None
    parts: tuple[Part, ...] = ()
    solver: str = "auto"
    heights_from: str = ""

    @classmethod
    def of(cls, device: Actuator | Case | MeasuredDevice) -> MeasuredDevice:
        """A device, alone or of a case; one that turns about its axis as its section.

        Raises:
            FitError: A case with loads that a fit does not take.
        """
        if isinstance(device, MeasuredDevice):
            section = as_section(device.actuator)
            parts = measured_parts(device.parts, section, device.material)
            return dataclasses.replace(device, actuator=section, parts=parts)
        if isinstance(device, Case):
            if rubbing := [part.where for part in device.parts if part.remembers]:
                raise FitError(
                    f"{rubbing[0]} has friction, whose derivatives by the material a fit does not know; leave it out "
                    "(friction = 0)"
                )
            case, section = device, as_section(device.actuator)
            parts = measured_parts(case.parts, section, case.material)
            around = (case.sheet, case.obstacle, parts, case.solver)
            return cls(section, case.name, case.material, case.formulation, *around)
        one_of("device", device, Actuator, "a device, such as sm.HollowDisk(), or a Case")
        return cls(as_section(device), device.name)

    def counting_from(self, heights_from: str) -> MeasuredDevice:
        """The same device with heights that count from there; see `heights_from`, empty to leave it."""
        return dataclasses.replace(self, heights_from=heights_from or self.heights_from)

    def model(self, choice: LawChoice, comm: MPI.Comm) -> DeviceModel:
        """The device under a law, meshed and compiled.

        Raises:
            FitError: It cannot be meshed or compiled; or ``heights_from`` makes no difference to it.
        """
        from softmodels.mechanics.body import Body, BodyError
        from softmodels.mechanics.compiling import CompilingError, compiling
        from softmodels.mechanics.solver import Solver
        from softmodels.mechanics.system import System

        folder = on_root(comm, lambda: Path(tempfile.mkdtemp(prefix="softmodels-")))
        mesh = folder / f"{self.name}.msh"
        try:
            on_root(comm, lambda: self.actuator.write(mesh))
            with compiling():
                body = Body.from_file(self.actuator, mesh, comm)
                material = choice.material(choice.from_modulus(30e3))
                around = (self.sheet, self.obstacle, self.parts)
                system = System(body, material, self.formulation, *around)
                modulus = self.material.shear_modulus_0 if self.material and system.dead.loads else MODULUS
                return DeviceModel(Solver(system, self.solver), choice, self.heights_from, modulus)
        except (BodyError, CompilingError, PartError, MeshingError, GeometryError, OSError) as error:
            raise FitError(str(error)) from error
        finally:
            on_root(comm, lambda: shutil.rmtree(folder, ignore_errors=True))


def as_section(actuator: Actuator) -> Actuator:
    """A device that turns about its axis as its section, which gives the same outline in a hundredth of the time."""
    section = about(actuator).get("section")
    turns = section is not None and "axisymmetric" in getattr(section.kind, "choices", ())
    return dataclasses.replace(actuator, section="axisymmetric") if turns else actuator  # type: ignore[call-arg]
