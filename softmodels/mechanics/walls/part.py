"""Walls of a device that press on each other where they meet: chambers of a bellows, a cavity's own walls."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from geometries import Actuator
from geometries.fields import field_of
from geometries.kinds import Quantity, Words
from geometries.symmetry import reflected
from softmodels.mechanics.contact import ONSET_PRESSURE
from softmodels.mechanics.contact_part import ContactPart
from softmodels.mechanics.face_nodes import FaceNodes, check_mesh_faces
from softmodels.mechanics.named_places import check_on_mesh
from softmodels.mechanics.parts import Equations, PartError, Setting, register_part
from softmodels.mechanics.section_axes import in_section
from softmodels.mechanics.walls.energy import Pressed
from softmodels.mechanics.walls.gap import Penalty
from softmodels.mechanics.walls.pairs import MOST_IMAGES, Pairs
from softmodels.mechanics.walls.passing import passes
from softmodels.mechanics.walls.pressing import PressingTerm
from softmodels.mechanics.walls.surface import Array, Surface

STIFFNESS = 2000.0
"""Shear moduli of pressure per overlap of one size of the device; seven times that of a rigid plane, since walls are thin."""


@register_part
@dataclasses.dataclass(frozen=True)
class Walls(ContactPart):
    """Walls that press on each other without friction.

    Attributes:
        faces: Roles of the facets, such as ``"cavity"`` or ``"left, right"``: all of them may meet each other and themselves.
        stiffness: Contact pressure per overlap, in shear moduli over `Actuator.size`.
    """

    faces: str = field_of(
        Words(), "faces that press on each other, and each on itself, where they meet, without friction"
    )
    stiffness: float = field_of(
        Quantity(), "shear moduli of contact pressure per overlap of one size of the device", STIFFNESS
    )

    table: ClassVar[str] = "walls"
    softest: ClassVar[float] = 10.0
    usual: ClassVar[float] = STIFFNESS
    needs: ClassVar[str] = "[walls] needs the faces that may meet (faces = 'cavity')"
    figure_texts: ClassVar = {
        r"(\w+)_contact_N": (
            "contact of {0}",
            "sum of the sizes of the forces with which those walls press on each other",
        ),
        r"(\w+)_overlap_mm": ("overlap of {0}", "how deep those walls sink into each other at most"),
        r"(\w+)_gap_mm": ("gap between {0}", "smallest distance between those walls, once they are near each other"),
    }

    def check(self) -> None:
        if not self.roles:
            raise PartError(self.needs)
        if len(set(self.roles)) < len(self.roles):
            raise PartError(f"{self.where}: faces = {self.faces!r} names a face twice")
        self.check_stiffness()

    def check_on(self, actuator: Actuator) -> None:
        check_on_mesh(self.where, actuator, self.roles)

    @property
    def in_model(self) -> str:
        return f" but for {self.faces}, which press on each other without friction"

    def hindrance(self, actuator: Actuator, figure: Callable[[str], float]) -> str:
        depth = figure(f"{self.label}_overlap_mm")
        pressed = f"the walls of {self.where} ({self.faces}) press on each other and overlap by {depth:.3g} mm"
        return self.try_other(pressed) if depth else ""

    def term(self, setting: Setting) -> WallTerm:
        check_mesh_faces(setting.body, self.roles, self.where)
        return WallTerm(self, setting)


class WallTerm(PressingTerm[Pressed]):
    """Contact of deformable walls; see `softmodels.mechanics.walls.gap`.

    Args:
        part: The walls.
        setting: The potential.
    """

    def __init__(self, part: Walls, setting: Setting):
        body = setting.body
        nodes = FaceNodes(body, setting.w.function_space, part.roles)
        super().__init__(nodes)
        self.part = part
        surface = Surface(nodes.places, nodes.facets, nodes.faces, nodes.inside, body.axisymmetric)
        d = body.actuator.dimension
        mirrors = [in_section(plane.normal, d) for plane in body.actuator.cut_planes]
        mirrors += [np.array([1.0, 0.0])] if body.axisymmetric else []  # a section meets its other half at the axis
        meets = np.ones((len(part.roles), len(part.roles)), dtype=np.bool_)
        self.pairs = Pairs(surface, meets, reflected(mirrors, MOST_IMAGES, d))
        self.penalty = Penalty(part.stiffness, ONSET_PRESSURE / part.stiffness)
        self.copies = body.actuator.copies
        self.move(nodes.places)
        if self._pressed.depth > 1e-6:
            raise PartError(
                f"{part.where}: at rest the walls {part.faces} overlap by "
                f"{self._pressed.depth * body.actuator.size * 1e3:.3g} mm; leave room between them, or name others"
            )

    def pressed(self, places: Array) -> Pressed:
        return Pressed(self.pairs, self.penalty, places)

    def admits(self, before: Array, after: Array) -> bool:
        return not passes(self.pairs, self.nodes.moved(before), self.nodes.moved(after))

    def figures(self, equations: Equations) -> dict[str, float]:
        self._take(equations.w.x.array)
        pressed, label, mm = self._pressed, self.part.label, equations.length_unit * 1e3
        force = pressed.pressed_force * equations.stress_unit * equations.length_unit**2 * self.copies
        gap = float(pressed.gaps.min(initial=math.inf))
        return {
            f"{label}_contact_N": force,
            f"{label}_overlap_mm": max(-gap, 0.0) * mm,
            f"{label}_gap_mm": max(gap, 0.0) * mm if math.isfinite(gap) else math.nan,
        }
