"""Walls of a device that press on each other where they meet: chambers of a bellows, a cavity's own walls."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from geometries.fields import field_of
from geometries.kinds import Quantity, Words
from geometries.openings import cavity_roles
from geometries.symmetry import reflected
from softmodels.mechanics.body import Body
from softmodels.mechanics.contact import ONSET_PRESSURE
from softmodels.mechanics.contact_part import ContactPart
from softmodels.mechanics.face_nodes import FaceNodes, check_mesh_faces
from softmodels.mechanics.named_places import check_on_mesh, names_in
from softmodels.mechanics.parts import Equations, PartError, Setting, Term, register_part
from softmodels.mechanics.section_axes import in_section
from softmodels.mechanics.walls.energy import Pressed
from softmodels.mechanics.walls.gap import Near, Penalty
from softmodels.mechanics.walls.pairs import MOST_IMAGES, Pairs, facing
from softmodels.mechanics.walls.passing import passes
from softmodels.mechanics.walls.pressing import PressingTerm
from softmodels.mechanics.walls.surface import Array, Surface

AUTO, NONE = "auto", "none"
APART = 1e-4
"""Least gap at rest, in sizes, of walls that a device names itself."""
AHEAD = 1e-3
"""Gap in sizes of the device from which walls press on each other, at most half of that at rest: walls of a coarse mesh are
rough by as much between the points that press."""
STIFFNESS = 2000.0
"""Shear moduli of pressure per overlap of one size of the device; seven times that of a rigid plane, since walls are thin."""


@register_part
@dataclasses.dataclass(frozen=True)
class Walls(ContactPart):
    """Walls that press on each other without friction.

    Attributes:
        faces: Roles of the facets, such as ``"cavity"`` or ``"left, right"``: all of them may meet each other and themselves.
            ``"auto"`` are those that the device itself names (`geometries.Actuator.meeting`), of a part from a file all of its
            outside that faces itself; ``"none"`` lets walls pass through each other.
        stiffness: Contact pressure per overlap, in shear moduli over `Actuator.size`.
    """

    faces: str = field_of(
        Words(),
        "faces that press on each other, and each on itself, where they meet, without friction: auto (those that the device "
        "names), none, or their names with commas between",
        AUTO,
    )
    stiffness: float = field_of(
        Quantity(), "shear moduli of contact pressure per overlap of one size of the device", STIFFNESS
    )

    table: ClassVar[str] = "walls"
    softest: ClassVar[float] = 10.0
    usual: ClassVar[float] = STIFFNESS
    optional: ClassVar[bool] = True
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
            raise PartError(f"{self.where} names no faces; say {AUTO!r}, {NONE!r} or which may meet (faces = 'cavity')")
        if len(set(self.roles)) < len(self.roles):
            raise PartError(f"{self.where}: faces = {self.faces!r} names a face twice")
        for word in (AUTO, NONE):
            if word in self.roles and len(self.roles) > 1:
                raise PartError(f"{self.where}: faces = {self.faces!r}; {word!r} stands alone")
        self.check_stiffness()

    @property
    def automatic(self) -> bool:
        """Whether the device says which of its walls press on each other."""
        return self.faces.strip() == AUTO

    @property
    def off(self) -> bool:
        """Whether none do."""
        return self.faces.strip() == NONE

    @property
    def words(self) -> str:
        """Its faces, for a sentence."""
        return "the walls that the device names" if self.automatic else f"the walls of {self.where} ({self.faces})"

    def groups(self, actuator: Actuator) -> tuple[list[str], ...] | None:
        """Faces that may meet each other and themselves, by group; None where only the mesh shows them."""
        if self.off:
            return ()
        if not self.automatic:
            return (self.roles,)
        return None if actuator.meeting is None else tuple(names_in(group) for group in actuator.meeting)

    def check_on(self, actuator: Actuator) -> None:
        for group in self.groups(actuator) or ():
            check_on_mesh(self.where, actuator, group)

    def undesigned(self, actuator: Actuator) -> str:
        return "" if self.off or self.automatic else super().undesigned(actuator)

    def hindrance(self, actuator: Actuator, figure: Callable[[str], float]) -> str:
        depth, force = (figure(f"{self.label}_{what}") for what in ("overlap_mm", "contact_N"))
        pressed = f"{self.words} press on each other{f' and overlap by {depth:.3g} mm' if depth else ''}"
        return self.try_other(pressed) if depth or force else ""

    def term(self, setting: Setting) -> Term:
        body = setting.body
        groups = self.groups(body.actuator)
        if groups is None:
            groups = (_outside(body),)
        else:
            check_mesh_faces(body, [role for group in groups for role in group], self.where)
        if not any(groups):
            return Term([])
        nodes = FaceNodes(body, setting.w.function_space, [role for group in groups for role in group])
        if self.automatic:
            nodes = _clear(nodes, body, groups, found=body.actuator.meeting is None)
        return WallTerm(self, body, nodes, groups) if len(nodes.facets) else Term([])


def _outside(body: Body) -> list[str]:
    """All faces of a mesh around the device, but for those that are cut or held."""
    device, facets = body.actuator, body.mesh.topology.dim - 1
    others = {*cavity_roles(device), *(plane.name for plane in device.cut_planes), *(hold.role for hold in body.holds)}
    return [role for role, (dimension, _) in body.entities.items() if dimension == facets and role not in others]


def _images(body: Body) -> Array:
    """Mirror images of the walls, which are there too, shape (g, d, d)."""
    d = body.actuator.dimension
    mirrors = [in_section(plane.normal, d) for plane in body.actuator.cut_planes]
    mirrors += [np.array([1.0, 0.0])] if body.axisymmetric else []  # a section meets its other half at the axis
    return reflected(mirrors, MOST_IMAGES, d)


def _surface(nodes: FaceNodes, body: Body) -> Surface:
    return Surface(nodes.places, nodes.facets, nodes.faces, nodes.inside, body.axisymmetric)


def _meets(groups: Sequence[Sequence[str]]) -> npt.NDArray[np.bool_]:
    """Whether one face may press on another, shape (roles, roles)."""
    number = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
    return np.asarray(number[:, None] == number)


def _clear(nodes: FaceNodes, body: Body, groups: Sequence[Sequence[str]], found: bool) -> FaceNodes:
    """Those facets of a device's own choice that can press on others: they face some, and are apart at rest.

    The smooth distance of a wall that is curved more sharply than its cells resolve may be below zero at rest.

    Args:
        nodes: Of the faces.
        body: The mesh.
        groups: The faces by group.
        found: Whether they are the whole outside of the device.
    """
    images = _images(body)
    if found:
        nodes = nodes.only(facing(_surface(nodes, body), images, 1.0))
    while len(nodes.facets):
        surface = _surface(nodes, body)
        gaps = Near.of(Pairs(surface, _meets(groups), images), *surface.rest).gaps(len(surface.owner))
        apart = (gaps.reshape(len(nodes.facets), -1) > APART).all(axis=1)
        if apart.all():
            break
        nodes = nodes.only(apart)
    return nodes


class WallTerm(PressingTerm[Pressed]):
    """Contact of deformable walls; see `softmodels.mechanics.walls.gap`.

    Args:
        part: The walls.
        body: The mesh.
        nodes: Nodes of their facets.
        groups: Their faces, by group.
    """

    def __init__(self, part: Walls, body: Body, nodes: FaceNodes, groups: Sequence[Sequence[str]]):
        super().__init__(nodes)
        self.part = part
        self.pairs = Pairs(_surface(nodes, body), _meets(groups), _images(body))
        surface, self.copies = self.pairs.surface, body.actuator.copies
        apart = float(Near.of(self.pairs, *surface.rest).gaps(len(surface.owner)).min(initial=math.inf))
        if apart < -1e-6:
            raise PartError(
                f"{part.where}: at rest the walls {part.faces} overlap by "
                f"{-apart * body.actuator.size * 1e3:.3g} mm; leave room between them, or name others"
            )
        ahead = min(AHEAD, max(apart / 2, 0.0))  # nothing presses at rest
        self.penalty = Penalty(part.stiffness, ONSET_PRESSURE / part.stiffness, ahead=ahead)

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
