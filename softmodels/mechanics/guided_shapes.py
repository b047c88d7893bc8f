"""Rigid shapes that give way along a line when the device presses on them: on a spring, or with a mass that is lifted.

The place on the line is that of least energy, see `softmodels.mechanics.walls.giving_way`; the shape does not turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from softmodels.mechanics.contact_part import StoppingShape, copies_around, shape_figures
from softmodels.mechanics.face_nodes import FaceNodes
from softmodels.mechanics.load_directions import ALONG, direction
from softmodels.mechanics.parts import Equations, PartError, Setting
from softmodels.mechanics.section_axes import in_section
from softmodels.mechanics.walls.giving_way import GivingWay, Stand
from softmodels.mechanics.walls.pressing import PressingTerm
from softmodels.mechanics.walls.samples import PressedSamples

Array = npt.NDArray[np.float64]

ONSET = 1e-3
"""Way in sizes of the device over which a weight is taken off its stand."""


class Guided(StoppingShape, Protocol):
    """A shape with a guide."""

    @property
    def guide(self) -> str: ...
    @property
    def gives_way(self) -> Array: ...
    @property
    def spring(self) -> float: ...
    @property
    def mass(self) -> float: ...


class StandingShape(Protocol):
    """The term of the same shape in its first place.

    Attributes:
        nodes: The faces' nodes.
        crossed: Normals of the cut planes that the shape crosses.
    """

    @property
    def nodes(self) -> FaceNodes: ...
    @property
    def crossed(self) -> Sequence[Array]: ...
    def pressed(self, places: Array) -> PressedSamples: ...
    def clear(self, start: Array, end: Array) -> bool: ...


def check_guide(shape: Guided) -> None:
    """Raise `PartError` for a guide without a spring or a mass, or the other way round, or one that is no direction."""
    if not shape.guide:
        if shape.spring or shape.mass:
            raise PartError(f"{shape.where}: a spring or a mass gives way along a line; say which (guide = 'z')")
        return
    direction(shape.guide, shape.where)
    if not (shape.spring > 0.0 or shape.mass > 0.0) or min(shape.spring, shape.mass) < 0.0:
        raise PartError(
            f"{shape.where}: what gives way along {shape.guide} needs a spring or a mass above zero (spring = '50 N/m', or "
            "mass = '20 g')"
        )


def weight_against(shape: Guided, gravity: Array) -> float:
    """Share of a shape's weight against its guide, in N; below zero where gravity pulls it along.

    Args:
        shape: The shape.
        gravity: Acceleration in m/s2, shape (3,), in device coordinates.
    """
    return -shape.mass * float(gravity @ shape.gives_way)


def check_weight(shape: Guided, gravity: Array) -> None:
    """Raise `PartError` for a mass without a spring that gravity does not pull against its guide."""
    if not shape.spring and weight_against(shape, gravity) <= ALONG * shape.mass * float(np.linalg.norm(gravity)):
        raise PartError(
            f"{shape.where}: gravity along ({', '.join(f'{x:.3g}' for x in gravity)}) m/s^2 does not pull the mass against its "
            f"guide, {shape.guide}, so nothing holds it there; turn the guide or gravity round, or give it a spring "
            "(spring = '50 N/m')"
        )


def check_guide_on(shape: Guided, actuator: Actuator, crossed: Sequence[Array]) -> None:
    """Raise `PartError` for a guide that leaves the symmetry of the device's model."""
    guide = shape.gives_way
    if actuator.dimension == 2 and abs(guide[2]) < 1 - ALONG:
        raise PartError(f"{shape.where}: beside an axisymmetric section a shape gives way along z or -z")
    if any(abs(float(normal @ guide)) > ALONG for normal in crossed):
        raise PartError(
            f"{shape.where}: along {shape.guide} the shape would leave the cut plane that it stands in; take a guide in that "
            f"plane, or use {actuator.fuller}"
        )


class GuidedShapeTerm(PressingTerm[GivingWay]):
    """The energy of contact with such a shape and of what holds it.

    Args:
        shape: The shape.
        standing: Its term in its first place.
        setting: The potential.
    """

    def __init__(self, shape: Guided, standing: StandingShape, setting: Setting):
        super().__init__(standing.nodes)
        self.shape, self.standing, self.setting, self.actuator = shape, standing, setting, setting.body.actuator
        self.along = in_section(shape.gives_way, self.actuator.dimension)
        self._per_pascal, self._s = 0.0, 0.0

    def _stand(self) -> Stand:
        """What holds it, the slice's share of it, with forces in shear moduli times squared sizes."""
        size, share = self.actuator.size, copies_around(self.actuator, self.standing.crossed)
        unit = float(self.setting.per_pascal.value) / size / share
        return Stand(self.shape.spring * unit, weight_against(self.shape, self.setting.gravity) * unit / size, ONSET)

    def pressed(self, places: Array) -> GivingWay:
        found = GivingWay(self.standing.pressed, self._stand(), self.along, places, self._s)
        self._s = found.s
        return found

    def _take(self, w: Array) -> None:
        if self._per_pascal != float(self.setting.per_pascal.value):  # spring and weight keep their newtons
            self._per_pascal = float(self.setting.per_pascal.value)
            self._state[:] = np.nan
        super()._take(w)

    def harder_here(self) -> Array:
        return self._pressed.harder()

    def admits(self, before: Array, after: Array) -> bool:
        start, end = self.nodes.moved(before), self.nodes.moved(after)
        moved = [places - self.pressed(places).s * self.along for places in (start, end)]
        return self.standing.clear(*moved)

    def figures(self, equations: Equations) -> dict[str, float]:
        self._take(equations.w.x.array)
        here, size, label = self._pressed.here, equations.length_unit, self.shape.label
        force = equations.stress_unit * size**2 * here.forces.sum(axis=0)
        found = shape_figures(label, self.actuator, self.standing.crossed, force, here.depth * size)
        return found | {f"{label}_way_mm": self._pressed.s * size * 1e3}
