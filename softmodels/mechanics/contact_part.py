"""What all contact of faces by a penalty has in common, be it with a rigid shape or with each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.contact import SOFTEST, STIFFEST, STIFFNESS
from softmodels.mechanics.named_places import names_in
from softmodels.mechanics.parts import EnergyPart, PartError
from softmodels.mechanics.section_axes import in_space

if TYPE_CHECKING:
    from geometries import Actuator

Array = npt.NDArray[np.float64]


class ContactPart(EnergyPart):
    """Faces that are pressed on; a kind is a dataclass of it with the fields below.

    Attributes:
        faces: Roles of the facets, with commas between.
        stiffness: Contact pressure per penetration, in shear moduli over `Actuator.size`.
        softest, usual: The least stiffness that is taken, and the one that serves most devices.
    """

    faces: str
    stiffness: float
    softest: ClassVar[float] = SOFTEST
    usual: ClassVar[float] = STIFFNESS

    @property
    def roles(self) -> list[str]:
        return names_in(self.faces)

    def try_other(self, pressed: str) -> str:
        """What to try where it may have ended a path; ``pressed`` says that and how deep it is pressed on, a clause."""
        return (
            f"{pressed}: try another stiffness than {self.stiffness:g} (with a larger one they sink in less, a smaller one is "
            "followed more easily), and smaller cells where they touch"
        )

    def check_stiffness(self) -> None:
        """Refuse, with `PartError`, a stiffness with which no contact can be computed."""
        if not self.softest <= self.stiffness <= STIFFEST:
            raise PartError(
                f"{self.where}: the stiffness is {self.stiffness:g} shear moduli per size of the device; {self.softest:g} to "
                f"{STIFFEST:g} are taken, and {self.usual:g} is usual"
            )


class StoppingShape(Protocol):
    """What all rigid shapes have; see `softmodels.mechanics.rigid_shapes.RigidShape`."""

    @property
    def where(self) -> str: ...
    @property
    def label(self) -> str: ...
    @property
    def roles(self) -> list[str]: ...
    @property
    def hollow(self) -> bool: ...
    @property
    def stiffness(self) -> float: ...


def copies_around(actuator: Actuator, crossed: Sequence[Array]) -> int:
    """How many copies of the slice a shape stands in.

    Args:
        actuator: The device.
        crossed: Normals of the cut planes that the shape crosses; where it crosses none, each copy has a shape of its own.
    """
    if actuator.dimension == 2 or not crossed:
        return 1
    return actuator.copies if len(crossed) == len(actuator.cut_planes) else 2


def force_of_all(actuator: Actuator, crossed: Sequence[Array], force: Array) -> Array:
    """Force on a shape of all copies that it stands in; their mirror images take away what is square to a cut plane.

    Args:
        actuator: The device.
        crossed: Normals of the cut planes that the shape crosses.
        force: Of the slice, shape (3,).
    """
    if actuator.dimension == 2:
        return force * [0.0, 0.0, 1.0]
    if not crossed:
        return force
    along = np.linalg.svd(np.array(crossed))[2][np.linalg.matrix_rank(np.array(crossed)) :]
    return np.asarray(copies_around(actuator, crossed) * along.T @ (along @ force))


def shape_figures(
    label: str, actuator: Actuator, crossed: Sequence[Array], force: Array, depth: float
) -> dict[str, float]:
    """Columns of ``path.csv`` of a rigid shape.

    Args:
        label: Of the shape.
        actuator, crossed: See `force_of_all`.
        force: Of the slice on the shape in N, in the mesh's coordinates, shape (d,).
        depth: How deep faces have sunk into it, in m; below zero where none has.
    """
    total = force_of_all(actuator, crossed, in_space(force))
    found = {f"{label}_force_{axis}_N": float(value) for axis, value in zip("xyz", total, strict=True)}
    if actuator.dimension == 2:
        found = {name: value for name, value in found.items() if "_z_" in name}
    return found | {f"{label}_depth_mm": max(depth, 0.0) * 1e3}
