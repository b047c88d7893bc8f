"""Where rigid parts sit on a mesh, and the unknowns that Newton's method has with them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.body import Body
from softmodels.mechanics.cell_measure import cell_measure
from softmodels.mechanics.mpi import any_rank, total
from softmodels.mechanics.parts import Part, PartError
from softmodels.mechanics.region_space import known_to_all
from softmodels.mechanics.rigid import STILL, Rigid
from softmodels.mechanics.rigid_motion import RigidMotion
from softmodels.mechanics.unknowns import RigidUnknowns, Unknowns

if TYPE_CHECKING:
    from dolfinx import fem

Array = npt.NDArray[np.float64]


class Nodes:
    """The displacement's nodes in a function space.

    Args:
        space: Of w: mixed with p, or of the displacement alone.

    Attributes:
        dofs: Local dofs of w's components at each local node, shape (nodes, d).
        places: Undeformed, in sizes of the device, shape (nodes, d).
    """

    def __init__(self, space: fem.FunctionSpace):
        d = space.mesh.geometry.dim
        mixed = space.dofmap.index_map_bs == 1  # the displacement alone is numbered in blocks
        self.vectors, parents = space.sub(0).collapse() if mixed else (space, None)
        self.places = self.vectors.tabulate_dof_coordinates()[:, :d]
        every = np.arange(len(self.places) * d) if parents is None else np.asarray(parents)
        self.dofs = every.astype(np.int32).reshape(-1, d)

    def on(self, body: Body, part: Rigid) -> npt.NDArray[np.int32]:
        """The local nodes on a part's face, or of its region.

        Raises:
            PartError: The mesh has no such face.
        """
        from dolfinx import fem

        if part.region:
            return np.asarray(
                fem.locate_dofs_topological(self.vectors, body.mesh.topology.dim, body.regions[part.region])
            )
        if part.face not in body.entities:
            raise PartError(f"{part.where}: the mesh has no face {part.face!r}; it has {', '.join(body.entities)}")
        dimension, found = body.entities[part.face]
        body.mesh.topology.create_connectivity(dimension, body.mesh.topology.dim)
        return np.asarray(fem.locate_dofs_topological(self.vectors, dimension, found))


def unknowns_of(
    body: Body, space: fem.FunctionSpace, held: Sequence[fem.DirichletBC], parts: Sequence[Part]
) -> Unknowns:
    """What is solved for on a mesh: its owned dofs, fewer where there are rigid parts.

    Args:
        body: Mesh and roles.
        space: Function space of w.
        held: Conditions on dofs that are zero.
        parts: What is added to the device, rigid parts among them.

    Raises:
        PartError: A rigid part on no face of the mesh, two that meet, or one that meets what holds the device.
    """
    n = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
    rigid = [part for part in parts if isinstance(part, Rigid)]
    if not rigid:
        return Unknowns(n)
    comm, nodes = body.mesh.comm, Nodes(space)
    none = np.empty(0, dtype=np.int32)
    still = np.concatenate([none, *(bc.dof_indices()[0] for bc in held)])
    motions: dict[str, RigidMotion] = {}
    taken = none
    for part in rigid:
        found = nodes.on(body, part)
        dofs, places = nodes.dofs[found], nodes.places[found]
        freedom = part.freedom(body.actuator, _centre(body, part))
        motion = motions[part.label] = RigidMotion(comm, freedom, body.skew, dofs, places, dofs[:, 0] < n)
        if any_rank(comm, bool(np.isin(dofs, taken).any())):
            raise PartError(f"{part.where} meets another rigid part; make them one")
        if any_rank(comm, bool((np.isin(dofs, still)[..., None] & (np.abs(motion.rates()) > STILL)).any())):
            raise PartError(
                f"{part.where} meets the device's support along an edge, so it cannot move; guide it along what the support "
                "leaves free, or use kind = 'held'"
            )
        taken = np.concatenate([taken, dofs.ravel()])
    try:
        return RigidUnknowns(comm, n, motions, still)
    except ValueError as few:
        raise PartError(str(few)) from None


def _centre(body: Body, part: Rigid) -> Array:
    """Centre of a part's whole undeformed face or region, in sizes of the device: what lies beyond cut planes counts too."""
    import ufl
    from dolfinx import fem

    d = body.actuator.dimension
    if d == 2:
        return np.zeros(d)
    area = body.sheet_face(part.face)[0] if part.face else cell_measure(body, body.regions[part.region])
    X = ufl.SpatialCoordinate(body.mesh)
    one = fem.Constant(body.mesh, 1.0)
    size, *moments = (total(body.mesh.comm, fem.assemble_scalar(fem.form(f * area))) for f in (one, *X))
    centre = np.array(moments) / size
    normals = np.array([plane.normal for plane in body.actuator.cut_planes]).reshape(-1, d)
    return np.asarray(centre - np.linalg.pinv(normals) @ normals @ centre)


def still_pressures(body: Body, space: fem.FunctionSpace, parts: Sequence[Part]) -> list[fem.DirichletBC]:
    """Conditions that hold p in rigid regions, where nothing strains: a region has its own p, see `region_space`.

    Args:
        body: The mesh; it has the regions, which `softmodels.mechanics.regions.Regions` checks.
        space: Function space of w.
        parts: What is added to the device, rigid regions among them.
    """
    from dolfinx import fem

    regions = [part.region for part in parts if isinstance(part, Rigid) and part.region]
    if not regions or space.dofmap.index_map_bs != 1:
        return []
    rows = np.array(space.sub(1).dofmap.list)
    dofs = known_to_all(space, np.concatenate([rows[body.regions[name]].ravel() for name in regions]))
    return [fem.dirichletbc(np.array(0.0), dofs, space.sub(1))]
