"""The device in the CAD kernel, in mm, turned so that the mould opens along z, and parted in two."""

from __future__ import annotations

import dataclasses
import math
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from geometries.fields import shown
from geometries.parting import Parting
from softmodels.design.mould.settings import MouldError, Workshop

Array = npt.NDArray[np.float64]
Solid = tuple[int, int]
"""Dimension, which is 3, and tag."""
MM = 1e3
"""Lengths in the model over those in m."""
NEAR = 1e-6
"""What counts as nothing, as a share of the part's size."""
LEAST_SILICONE = 0.5e-3
"""Thinnest silicone around a tube, m: less tears as the tube is pushed in."""
OTHER_SIDE = {"upper": -1.0, "lower": 1.0}
"""Halves by name, and along which direction of z their mould's lid lies."""


@dataclasses.dataclass(frozen=True)
class Parted:
    """The device in the current Gmsh model, as large as the mould makes it.

    Attributes:
        envelope: The device with its cavities filled.
        cores: Its cavities.
        inlet: The solid that leaves room for the tube; none if there is no inlet.
        level: Height of the parting plane, mm.
        low, high: Corners of the envelope's box, mm.
        turn: The rotation that turned it, shape (3, 3).
        scale: Its size over the device's.
    """

    envelope: Solid
    cores: list[Solid]
    inlet: list[Solid]
    level: float
    low: Array
    high: Array
    turn: Array
    scale: float

    def drawn(self, place: Array) -> Array:
        """Where a place in the mould is in the device as drawn, mm."""
        return np.asarray(self.turn.T @ np.asarray(place) / self.scale)

    @property
    def size(self) -> float:
        """Diagonal of the box, mm."""
        return float(np.linalg.norm(self.high - self.low))

    def half(self, name: str, solids: Sequence[Solid]) -> list[Solid]:
        """Copies of what lies above or below the parting plane, of several solids."""
        import gmsh  # type: ignore[import-untyped]

        occ, far = gmsh.model.occ, 2.0 * self.size
        x, y, _ = self.low - 0.5 * self.size
        begin = self.level if name == "upper" else self.level - far
        if not solids:
            return []
        space = occ.addBox(x, y, begin, far, far, far)
        return list(occ.intersect(occ.copy(list(solids)), [(3, space)])[0])


def placed(parting: Parting, workshop: Workshop) -> Array:
    """The rotation, shape (3, 3), that turns the pull into z: as little as can be."""
    pull, z = np.asarray(parting.pull), np.array([0.0, 0.0, 1.0])
    axis, cosine = np.cross(pull, z), float(pull @ z)
    if cosine > 1.0 - 1e-12:
        return np.eye(3)
    if cosine < -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))


def parting_of(device: Actuator, workshop: Workshop) -> Parting | None:
    """Where a device is parted: where its class says so, else along the asked pull, in the middle of the cavities (None).

    Raises:
        MouldError: A pull that is missing, or asked of a device that has its own.
    """
    own = device.parting
    if own is not None:
        if workshop.direction is not None or workshop.level is not None:
            raise MouldError(
                f"pull and split are for imported parts; a {type(device).__name__} is parted where its cavity asks for it"
            )
        return own
    if workshop.direction is None:
        raise MouldError(
            "pull is not given; say in which direction the mould of this part opens, such as --pull '0, 0, 1'"
        )
    return None


def turned(solids: Sequence[Solid], turn: Array) -> None:
    """Turn solids about the origin."""
    import gmsh

    angle = math.acos(max(-1.0, min(1.0, 0.5 * (float(np.trace(turn)) - 1.0))))
    if angle == 0.0:
        return
    skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    axis = skew / np.linalg.norm(skew) if np.linalg.norm(skew) > 1e-9 else np.array([1.0, 0.0, 0.0])
    gmsh.model.occ.rotate(list(solids), 0, 0, 0, *axis, angle)


def scaled(factor: float) -> None:
    """Scale all of the current Gmsh model about the origin; planes, cylinders and the like stay what they are.

    Gmsh's own `dilate` makes splines of them; the scale of an import does not.
    """
    import gmsh

    if factor == 1.0:
        return
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "whole.brep")
        gmsh.model.occ.synchronize()
        gmsh.write(file)
        gmsh.model.occ.remove(gmsh.model.occ.getEntities(3), recursive=True)
        before = gmsh.option.getNumber("Geometry.OCCScaling")
        gmsh.option.setNumber("Geometry.OCCScaling", factor)
        gmsh.model.occ.importShapes(file, format="brep")
        gmsh.option.setNumber("Geometry.OCCScaling", before)
    gmsh.model.occ.synchronize()


def part(device: Actuator, workshop: Workshop) -> Parted:
    """Fill the current Gmsh model with a device, ready to be moulded.

    Raises:
        MouldError: A device that cannot be parted as asked.
        GeometryError, MeshingError: Its whole cannot be made.
    """
    import gmsh

    parting = parting_of(device, workshop)
    device.build_whole()
    solids = gmsh.model.getEntities(3)
    if len(solids) != 1:
        raise MouldError(f"the device's whole is {len(solids)} solids, and a mould is made of one")
    turn = placed(parting or Parting(workshop.direction or (0.0, 0.0, 1.0), 0.0, None, ""), workshop)
    turned(solids, turn)
    scaled(workshop.scale)
    occ = gmsh.model.occ
    occ.synchronize()
    solids = occ.getEntities(3)
    loops, _ = occ.getSurfaceLoops(solids[0][1])
    shells = [(3, occ.addVolume([loop])) for loop in loops]
    occ.synchronize()
    boxes = [np.array(occ.getBoundingBox(*shell)).reshape(2, 3) for shell in shells]
    order = np.argsort([-np.prod(np.ptp(box, axis=0)) for box in boxes])
    envelope, cores = shells[order[0]], [shells[k] for k in order[1:]]
    if not cores:
        raise MouldError("the part has no closed cavity, so that there is nothing to part it for")
    low, high = boxes[order[0]]
    level = _level(parting, workshop, boxes, order)
    if not low[2] < level < high[2]:
        raise MouldError(
            f"split is {shown(level / MM / workshop.scale, 'm')}; along the pull the part reaches from "
            f"{shown(low[2] / MM / workshop.scale, 'm')} to {shown(high[2] / MM / workshop.scale, 'm')}"
        )
    inlet = _inlet(parting, workshop, envelope) if parting and parting.inlet and workshop.tube else []
    return Parted(envelope, cores, inlet, level, low, high, turn, workshop.scale)


def _level(parting: Parting | None, workshop: Workshop, boxes: list[Array], order: npt.NDArray[np.int64]) -> float:
    if parting is not None:
        return MM * workshop.scale * parting.height
    if workshop.level is not None:
        return MM * workshop.scale * workshop.level
    heights = np.array([boxes[k][:, 2] for k in order[1:]])
    return 0.5 * float(heights.min() + heights.max())


def _inlet(parting: Parting, workshop: Workshop, envelope: Solid) -> list[Solid]:
    """The core of the tube: straight where it lies in the parting plane, else narrower outside by the draft.

    Raises:
        MouldError: The draft closes it.
    """
    import gmsh

    assert parting.inlet is not None
    begin, end = (MM * workshop.scale * np.asarray(place) for place in parting.inlet)
    along = end - begin
    length, radius = float(np.linalg.norm(along)), 0.5 * MM * workshop.tube
    upright = abs(float(along @ np.asarray(parting.pull))) > 0.5 * length
    around = (3, gmsh.model.occ.addCylinder(*begin, *along, radius + MM * LEAST_SILICONE))
    inside = gmsh.model.occ.intersect(gmsh.model.occ.copy([around]), [envelope], removeTool=False)[0]
    found = sum(gmsh.model.occ.getMass(*solid) for solid in inside)
    if found < (1.0 - NEAR) * gmsh.model.occ.getMass(*around):
        raise MouldError(
            f"tube is {shown(workshop.tube, 'm')}; it leaves less than {shown(LEAST_SILICONE, 'm')} of silicone to the part's "
            "outside"
        )
    gmsh.model.occ.remove([around], recursive=True)
    if not upright:
        core = gmsh.model.occ.addCylinder(*begin, *along, radius)
    else:
        tip = radius - length * workshop.slope
        if 2.0 * tip < MM * workshop.least_wall:
            raise MouldError(
                f"draft is {shown(workshop.draft, 'degree')}; over {shown(length / MM, 'm')} it closes the inlet: of its core "
                f"of {shown(workshop.tube, 'm')} {shown(max(2.0 * tip, 0.0) / MM, 'm')} are left, and the printer makes "
                f"{shown(workshop.least_wall, 'm')}"
            )
        same = radius - tip < 1e-9
        core = (
            gmsh.model.occ.addCylinder(*begin, *along, radius)
            if same
            else gmsh.model.occ.addCone(*begin, *along, tip, radius)
        )
    return list(gmsh.model.occ.intersect([(3, core)], [envelope], removeTool=False)[0])
