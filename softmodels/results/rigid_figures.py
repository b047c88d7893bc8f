"""What rigid parts tell of a state: how they have moved, and what the device pushes on them with."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.rigid import symmetric_motions
from softmodels.mechanics.rigid_motion import RigidMotion
from softmodels.mechanics.rotations import rotation_vector
from softmodels.mechanics.section_axes import in_space
from softmodels.mechanics.system import State, System
from softmodels.results.state_values import Sampling

Array = npt.NDArray[np.float64]


def rigid_parts(sampling: Sampling, state: State) -> dict[str, float]:
    """Columns of the rigid parts in the state that is loaded, of the whole device, on all ranks."""
    eq = sampling.system
    moving = eq.unknowns.moving
    if not moving:
        return {}
    surplus = eq.surplus()
    drives = eq.drives_at(state)[len(eq.body.actuator.ratios) :]
    found: dict[str, float] = {}
    for name, motion in moving.items():
        # All that acts on the part's nodes pushes on it, the silicone's weight there too, but what the part itself bears.
        forces = -surplus - eq.dead.borne(motion.dofs.ravel(), drives)
        found |= {f"{name}_{key}": value for key, value in _figures(eq, motion, forces)}
    return found


def _figures(eq: System, motion: RigidMotion, forces: Array) -> Iterator[tuple[str, float]]:
    """Columns of one part, without its name, and their values."""
    actuator, free = eq.body.actuator, motion.freedom
    length, unit = eq.length_unit, eq.stress_unit * eq.length_unit**2 * actuator.copies
    directions, axes = symmetric_motions(actuator)
    for axis in _axes(in_space(free.directions)):
        yield f"{'xyz'[axis]}_mm", float(in_space(motion.translation)[axis]) * length * 1e3
    for axis in _axes(free.axes):
        yield f"turn_{'xyz'[axis]}_deg", float(np.degrees(rotation_vector(motion.rotation)[axis]))
    force, moment = motion.wrench(forces)
    force = in_space(force @ directions.T @ directions) * unit  # the rest, the device's other slices push back
    along = free.directions[0] if len(free.directions) == 1 else None
    yield "force_N", float(force @ (np.asarray(actuator.lift) if along is None else in_space(along)))
    if len(directions) > 1:
        for axis in _axes(in_space(directions)):
            yield f"force_{'xyz'[axis]}_N", float(force[axis])
    for axis in _axes(axes):
        yield f"moment_{'xyz'[axis]}_Nmm", float((moment @ axes.T @ axes)[axis]) * unit * length * 1e3


def _axes(vectors: Array) -> list[int]:
    """The device's axes along which vectors have a part."""
    return [axis for axis in range(3) if np.abs(vectors[:, axis]).max(initial=0.0) > 1e-9]
