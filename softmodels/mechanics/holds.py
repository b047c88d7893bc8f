"""What holds a device: its own holds and those of clamps, as conditions on its displacement."""

from __future__ import annotations

import abc
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from geometries import Actuator, Hold
from softmodels.mechanics.body import Body, in_section
from softmodels.mechanics.component import Component, ComponentError, Sealing
from softmodels.mechanics.regions import RegionPart

if TYPE_CHECKING:
    from dolfinx import fem


FREE = 1e-6
"""Smallest singular value of the held rigid motions, relative to the size, below which one of them is free."""


class HoldingPart(Component):
    """Something that holds faces, edges or regions of a device."""

    @property
    @abc.abstractmethod
    def roles(self) -> list[str]:
        """Names of what it holds."""

    @abc.abstractmethod
    def holds(self, actuator: Actuator) -> list[Hold]:
        """What it holds on a device, and in which directions."""


def held_with(own: Sequence[Hold], actuator: Actuator, components: Sequence[Component]) -> list[Hold]:
    """Return the supports of a device: its own, except those replaced by clamps and by seals, and the clamps."""
    clamps = [part for part in components if isinstance(part, HoldingPart)]
    roles = {role for clamp in clamps for role in clamp.roles} | {
        role for seal in seals(components) for role in seal.roles
    }
    kept = [hold for hold in own if hold.role not in roles]
    return [*kept, *(hold for clamp in clamps for hold in clamp.holds(actuator))]


def seals(components: Sequence[Component]) -> list[Sealing]:
    """Return what closes the first cavity among the components."""
    return [part.sealing for part in components if part.sealing]


def clamped(body: Body, components: Sequence[Component]) -> Body:
    """Return a body with the clamps' supports and its seal, on the same mesh; the body itself if there are none.

    Raises:
        ComponentError: A role that the mesh does not have, or a device that nothing keeps in its place any more.
    """
    clamps = [part for part in components if isinstance(part, HoldingPart)]
    sealing = seals(components)
    if not clamps and not sealing:
        return body
    for clamp in clamps:
        for role in clamp.roles:
            if role not in body.entities and role not in body.regions:
                known = ", ".join([*body.entities, *body.regions])
                raise ComponentError(f"{clamp.where}: the mesh has no {role!r}; it has {known}")
    held = body.held_by(held_with(body.holds, body.actuator, components))
    for seal in sealing:
        held = held.sealed_by(seal.roles, np.asarray(seal.point) / body.actuator.size, seal.normal)
    replaced = {hold.role for hold in body.holds} & {role for clamp in clamps for role in clamp.roles}
    if replaced and all(
        isinstance(part, HoldingPart | RegionPart) for part in components
    ):  # other parts may refer to it
        _check_place(held, clamps[0].where)
    return held


def _check_place(body: Body, where: str) -> None:
    """Reject supports that leave the body a rigid motion."""
    from dolfinx import mesh as meshes

    mesh, d = body.mesh, body.actuator.dimension
    modes = np.zeros((6, 6) if d == 3 else (1, 1))
    wanted = [(plane.name, plane.normal) for plane in body.actuator.cut_planes]
    for role, way in [*wanted, *((hold.role, hold.direction) for hold in body.holds)]:
        dimension, found = body.group(role)
        mesh.topology.create_connectivity(dimension, mesh.topology.dim)
        places = mesh.geometry.x[np.unique(meshes.entities_to_geometry(mesh, dimension, found))]
        for e in np.eye(d) if way is None else in_section(way, d)[None]:
            turns = np.cross(places, np.broadcast_to(e, places.shape)) if d == 3 else np.empty((len(places), 0))
            moves = np.broadcast_to(e if d == 3 else e[1:], (len(places), d if d == 3 else 1))
            rows = np.hstack([moves, turns])
            modes += rows.T @ rows
    modes = mesh.comm.allreduce(modes)
    if np.sqrt(max(np.linalg.eigvalsh(modes)[0], 0.0)) < FREE:
        raise ComponentError(
            f"{where}: with these supports the device can move as a rigid body; hold it in all directions, or hold another "
            f"point"
        )


def conditions(body: Body, vectors: fem.FunctionSpace) -> list[fem.DirichletBC]:
    """Return the components of the displacement that are held at zero.

    Args:
        body: The body.
        vectors: Its displacement's space.
    """
    from dolfinx import fem

    return [fem.dirichletbc(np.array(0.0), dofs, vectors.sub(i)) for i, dofs in body.held(vectors)]
