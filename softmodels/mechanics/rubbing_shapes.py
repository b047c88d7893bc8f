"""Rigid shapes that stand still and that faces rub on; the law is in `softmodels.mechanics.walls.friction`."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.contact_part import StoppingShape, shape_figures
from softmodels.mechanics.guided_shapes import StandingShape
from softmodels.mechanics.parts import Equations, PartError, Setting
from softmodels.mechanics.walls.friction import Grip, Rubbed, Rubbing
from softmodels.mechanics.walls.pressing import PressingTerm

if TYPE_CHECKING:
    import scipy

Array = npt.NDArray[np.float64]

ONSET = 1e-3
"""Way in sizes of the device over which friction sets in, where the user gives none."""
MOST = 3.0
"""Largest coefficient of friction that is taken: rubber on dry glass has 1 to 2."""


class RubbedShape(StoppingShape, Protocol):
    """A shape with friction."""

    @property
    def friction(self) -> float: ...
    @property
    def slip(self) -> float: ...
    @property
    def guide(self) -> str: ...


def check_friction(shape: RubbedShape) -> None:
    """Raise `PartError` for a coefficient that is none, or friction on a shape that gives way."""
    if not 0.0 <= shape.friction <= MOST:
        raise PartError(
            f"{shape.where}: a coefficient of friction of {shape.friction:g} cannot be meant; 0 to {MOST:g} are taken "
            "(silicone on smooth plastic has some 0.3 to 1)"
        )
    if shape.slip and not shape.friction:
        raise PartError(
            f"{shape.where}: a slip belongs to a coefficient of friction (friction = 0.5); give both or neither"
        )
    if shape.friction and shape.guide:
        raise PartError(
            f"{shape.where}: friction is computed on shapes that stand still, and this one gives way along {shape.guide}; "
            "leave out the guide or the friction"
        )


class RubbingShapeTerm(PressingTerm[Rubbed]):
    """The energy of contact with such a shape, and its friction.

    Args:
        shape: The shape.
        standing: Its term without friction.
        setting: The potential.
    """

    remembers: ClassVar[bool] = True

    def __init__(self, shape: RubbedShape, standing: StandingShape, setting: Setting):
        super().__init__(standing.nodes)
        self.shape, self.standing, self.actuator = shape, standing, setting.body.actuator
        self.rubbing = Rubbing(shape.friction, shape.slip / self.actuator.size or ONSET)
        self._begin(standing.nodes.places)

    def _begin(self, places: Array) -> None:
        self.grip = Grip.of_free(self.standing.pressed(places))

    def pressed(self, places: Array) -> Rubbed:
        return Rubbed(self.standing.pressed(places), self.rubbing, self.grip)

    def whole_stiffness_here(self) -> scipy.sparse.csr_array:
        return self._pressed.whole_stiffness

    def keep(self, w: Array, anew: bool = False) -> None:
        if anew:
            self._begin(self.nodes.moved(w))
        else:
            self._take(w)
            self.grip = self._pressed.kept()
        self._state[:] = np.nan  # what follows is asked of what is remembered now

    def admits(self, before: Array, after: Array) -> bool:
        return self.standing.clear(self.nodes.moved(before), self.nodes.moved(after))

    def figures(self, equations: Equations) -> dict[str, float]:
        self._take(equations.w.x.array)
        pressed, size, stress, label = self._pressed, equations.length_unit, equations.stress_unit, self.shape.label
        force = stress * size**2 * pressed.forces.sum(axis=0)
        found = shape_figures(label, self.actuator, self.standing.crossed, force, pressed.depth * size)
        lost = pressed.grip.lost * stress * size**3 * self.actuator.copies
        return found | {
            f"{label}_sliding": pressed.sliding,
            f"{label}_slip_mm": float(pressed.grip.slid.max(initial=0.0)) * size * 1e3,
            f"{label}_friction_mJ": lost * 1e3,
        }
