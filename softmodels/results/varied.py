"""Whether a parameter that is varied changes anything of a device: one that does not would scatter nothing, in silence."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from geometries import Actuator, GeometryError
from geometries.fields import about, shown
from geometries.options import flag
from softmodels.case.case import CaseError
from softmodels.mechanics.mpi import on_root

if TYPE_CHECKING:
    from mpi4py import MPI

    from softmodels.results.limits import Tolerance


def check_varied(actuator: Actuator, tolerances: Sequence[Tolerance], comm: MPI.Comm) -> None:
    """Refuse a tolerance within which the device stays the same, before anything is solved.

    Args:
        actuator: The device as drawn.
        tolerances: Of its parameters and deviations.
        comm: MPI communicator.

    Raises:
        CaseError: The first such tolerance, or one that makes no device.
        MeshingError, OSError: Only the mesh tells, and it cannot be made.
    """
    for one in tolerances:
        try:
            devices = [actuator.made({one.name: one.middle + way * one.half}) for way in (-1, 1, 0)]
        except GeometryError as error:
            raise CaseError(f"within the tolerances there is a device that cannot be built: {error}") from None
        if len({_figures(device) for device in devices}) == 1 and _of_one_mesh(devices, comm):
            low, high = (shown(one.middle + way * one.half, one.unit) for way in (-1, 1))
            raise CaseError(
                f"--vary {one.name.replace('_', '-')}: this {type(actuator).__name__} is the same at {low} and at {high}"
                f"{_because(actuator, one.name)}, so that nothing scatters; leave it out"
            )


def _figures(device: Actuator) -> str:
    """What a device tells of itself without a mesh; not equal where it has changed, and mostly only there."""
    told = (
        device.cavity_volume, device.solid_volume, device.chamber_volume, device.ratios, dict(device.probes),
        device.cut_planes, device.holds, device.copies, device.size,
    )  # fmt: skip
    return repr(told)


def _of_one_mesh(devices: Sequence[Actuator], comm: MPI.Comm) -> bool:
    """Whether the meshes of all devices are the same to the last digit, on all ranks."""

    def on_rank_0() -> bool:
        with tempfile.TemporaryDirectory() as folder:
            meshes = (device.write(Path(folder) / "device.msh").read_bytes() for device in devices)
            first = next(meshes)
            return all(mesh == first for mesh in meshes)

    return on_root(comm, on_rank_0)


def _because(actuator: Actuator, name: str) -> str:
    """The parameter with which this one means nothing, as far as the device tells; a clause begun with a blank."""
    field = about(actuator).get(name)
    other = field.idle(actuator) if field else ""
    return f" ({flag(name)} means nothing with {flag(other)} {getattr(actuator, other)})" if other else ""
