"""What all contact of faces by a penalty has in common, be it with a rigid shape or with each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.contact import SOFTEST, STIFFEST, STIFFNESS
from softmodels.mechanics.named_places import names_in
from softmodels.mechanics.parts import EnergyPart, PartError

if TYPE_CHECKING:
    from geometries import Actuator

Array = npt.NDArray[np.float64]


class ContactPart(EnergyPart):
    """Faces that are pressed on without friction; a kind is a dataclass of it with the fields below.

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
        return force  # each copy has a shape of its own
    along = np.linalg.svd(np.array(crossed))[2][np.linalg.matrix_rank(np.array(crossed)) :]
    share = actuator.copies if len(crossed) == len(actuator.cut_planes) else 2
    return np.asarray(share * along.T @ (along @ force))
