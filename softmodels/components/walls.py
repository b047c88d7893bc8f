"""Self-contact of a device's walls: chambers of a bellows, a cavity's own walls."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence, Set
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from geometries.actuator import cavity_roles, reflected
from softmodels.common.arrays import Array
from softmodels.common.schema import Quantity, Words, field_of
from softmodels.components.contact import ONSET_PRESSURE, ContactPart
from softmodels.components.pressing import MOST_IMAGES, Near, Pairs, Penalty, Pressed, PressingTerm, Surface, facing
from softmodels.mechanics.assembly import FaceNodes, check_mesh_faces
from softmodels.mechanics.body import Body, in_section
from softmodels.mechanics.component import (
    ComponentError,
    EnergyTerm,
    Equations,
    FormContext,
    check_on_mesh,
    names_in,
    register_component,
)

# ----------------------------------------------------------------------------------------------------------------------
# Check whether a point passes through a wall between two shapes.


DEEPEST = 0.3
"""Penetration in kernel radii at which a state is rejected: a wall is detected only up to one radius behind it."""
OWN = 0.4
"""Lateral distance from a sample, in facet edges, within which a wall belongs to it; the spacing of samples."""
STRIDE = 2.0
"""Relative motion of points and walls, in kernel radii, between two checks."""
MOST_LOOKS = 60


def passes(pairs: Pairs, before: Array, after: Array) -> bool:
    """Return whether a point gets deeper than `DEEPEST` behind a wall on straight ways between two shapes.

    A point that has jumped over a wall is nowhere near it any more and would feel nothing.

    Args:
        pairs: The walls and their search.
        before, after: Places of the nodes, shape (n, d).
    """
    surface = pairs.surface
    start, end = surface.places(before), surface.places(after)
    motion = end - start
    relative = 2 * float(np.linalg.norm(motion - motion.mean(axis=0), axis=1).max())
    stride = STRIDE * float(pairs.radius.min())
    looks = min(max(math.ceil(relative / stride), 1), MOST_LOOKS)
    times = np.linspace(0.0, 1.0, looks + 1)
    for low, high in itertools.pairwise(times):
        shapes = [before + t * (after - before) for t in (low, high)]
        if _deeper(pairs, shapes, relative / looks / 2):
            return True
    return False


def _deeper(pairs: Pairs, shapes: list[Array], slack: float) -> bool:
    """Return whether a point crosses the surface at `DEEPEST` behind a sample's own part of a wall between two near shapes."""
    surface, count = pairs.surface, len(pairs.surface.owner)
    (a, b), (m, n) = ([surface.places(x) for x in shapes], [pairs.of_all(surface.areas(x)) for x in shapes])
    i, j = pairs.within((a + b) / 2, slack + (DEEPEST + OWN) * float(pairs.radius.max()))
    start, end = a[i] - pairs.of_all(a)[j], b[i] - pairs.of_all(b)[j]
    limit = -DEEPEST * pairs.radius[j % count]
    above = [np.einsum("pi,pi->p", r, v[j]) / np.linalg.norm(v[j], axis=1) for r, v in ((start, m), (end, n))]
    crossed = (above[0] > limit) & (above[1] <= limit)
    i, j, start, end, limit = i[crossed], j[crossed], start[crossed], end[crossed], limit[crossed]
    high, low = above[0][crossed], above[1][crossed]
    t = ((high - limit) / (high - low))[:, None]
    place = start + t * (end - start)
    aside = np.sqrt(np.maximum(np.einsum("pi,pi->p", place, place) - limit**2, 0.0))
    own = aside < OWN * surface.edges[j % count]
    return bool(own.any())


AUTO, NONE = "auto", "none"
APART = 1e-4
"""Minimum undeformed gap, relative to the size, of walls named by the device."""
AHEAD = 1e-3
"""Gap relative to the size at which contact sets in, at most half of the undeformed gap: walls of a coarse mesh
are that rough between the contact points."""
STIFFNESS = 2000.0
"""Shear moduli of pressure per overlap of one size of the device; seven times that of a rigid plane, because walls are thin."""


@register_component
@dataclasses.dataclass(frozen=True)
class Walls(ContactPart):
    """Frictionless self-contact of walls.

    Attributes:
        faces: Roles of the facets, such as ``"cavity"`` or ``"left, right"``: all of them may meet each other and themselves.
            ``"auto"`` are those that the device itself names (`geometries.Actuator.meeting`), of a part from a file all of its
            outside that faces itself; names beside it are one more group. ``"none"`` lets walls pass through each other.
        stiffness: Contact pressure per overlap, in shear moduli over `Actuator.size`.
    """

    faces: str = field_of(
        Words(),
        "faces in frictionless contact with each other and themselves: auto (chosen by the "
        "device; under vacuum 'auto, cavity'), none, or names separated by commas",
        AUTO,
    )
    stiffness: float = field_of(
        Quantity(),
        "penalty stiffness: contact pressure in shear moduli per overlap of one size of the device",
        STIFFNESS,
    )

    table: ClassVar[str] = "walls"
    softest: ClassVar[float] = 10.0
    usual: ClassVar[float] = STIFFNESS
    optional: ClassVar[bool] = True
    figure_texts: ClassVar = {
        r"(\w+)_contact_N": (
            "contact of {0}",
            "sum of the magnitudes of the contact forces between those walls",
        ),
        r"(\w+)_overlap_mm": ("overlap of {0}", "largest overlap of those walls"),
        r"(\w+)_gap_mm": ("gap between {0}", "smallest distance between those walls, if they are near each other"),
    }

    def check(self) -> None:
        if not self.roles:
            raise ComponentError(
                f"{self.where} names no faces; give {AUTO!r}, {NONE!r} or face names (faces = 'cavity')"
            )
        if len(set(self.roles)) < len(self.roles):
            raise ComponentError(f"{self.where}: faces = {self.faces!r} names a face twice")
        if NONE in self.roles and len(self.roles) > 1:
            raise ComponentError(f"{self.where}: faces = {self.faces!r}; {NONE!r} cannot be combined with other names")
        self.check_stiffness()

    @property
    def automatic(self) -> bool:
        """Whether the device chooses walls in contact."""
        return AUTO in self.roles

    @property
    def off(self) -> bool:
        """Whether self-contact is off."""
        return self.faces.strip() == NONE

    @property
    def words(self) -> str:
        """Its faces, for a sentence."""
        return "the walls chosen by the device" if self.automatic else f"the walls of {self.where} ({self.faces})"

    def groups(self, actuator: Actuator) -> tuple[list[str], ...] | None:
        """Return the faces that may touch each other and themselves, by group; None if only the mesh shows them."""
        if self.off:
            return ()
        if not self.automatic:
            return (self.roles,)
        if actuator.meeting is None:
            return None
        chosen = [names_in(group) for group in actuator.meeting]
        return (*chosen, *self._beside({role for group in chosen for role in group}))

    def _beside(self, chosen: Set[str]) -> list[list[str]]:
        """Return the faces named beside automatic ones, as a group; none if there are none."""
        named = [role for role in self.roles if role != AUTO and role not in chosen]
        return [named] if named else []

    def check_on(self, actuator: Actuator) -> None:
        for group in self.groups(actuator) or ():
            check_on_mesh(self.where, actuator, group)

    def undesigned(self, actuator: Actuator) -> str:
        return ""

    def hindrance(self, actuator: Actuator, figure: Callable[[str], float]) -> str:
        depth, force = (figure(f"{self.label}_{what}") for what in ("overlap_mm", "contact_N"))
        pressed = f"{self.words} are in contact{f' and overlap by {depth:.3g} mm' if depth else ''}"
        return self.try_other(pressed) if depth or force else ""

    def term(self, setting: FormContext) -> EnergyTerm:
        body = setting.body
        groups = self.groups(body.actuator)
        if groups is None:
            outside = _outside(body)
            groups = (outside, *self._beside(set(outside)))
        else:
            check_mesh_faces(body, [role for group in groups for role in group], self.where)
        if not any(groups):
            return EnergyTerm([])
        nodes = FaceNodes(body, setting.w.function_space, [role for group in groups for role in group])
        if self.automatic:
            nodes = _clear(nodes, body, groups, found=body.actuator.meeting is None)
        return WallTerm(self, body, nodes, groups) if len(nodes.facets) else EnergyTerm([])


def _outside(body: Body) -> list[str]:
    """Return all faces of a mesh around the device, except cut or held ones."""
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
    """Return whether one face may touch another, shape (roles, roles)."""
    number = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
    return np.asarray(number[:, None] == number)


def _clear(nodes: FaceNodes, body: Body, groups: Sequence[Sequence[str]], found: bool) -> FaceNodes:
    """Return those automatically chosen facets that face others and are apart when undeformed.

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
    """Contact of deformable walls; see `softmodels.components.pressing`.

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
            raise ComponentError(
                f"{part.where}: the undeformed walls {part.faces} overlap by "
                f"{-apart * body.actuator.size * 1e3:.3g} mm; leave room between them, or name others"
            )
        ahead = min(AHEAD, max(apart / 2, 0.0))  # no contact when undeformed
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
