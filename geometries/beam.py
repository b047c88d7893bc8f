"""A beam of solid silicone with no cavity: clamped at one end, bent by its weight or by forces on its tip."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from geometries import actuator, meshing, registry
from geometries.actuator import CutPlane, Hold, Vector
from softmodels.common import schema
from softmodels.common.errors import GeometryError
from softmodels.common.lazy import gmsh

POINT_TOLERANCE = 1e-9
"""Tolerance of equal positions, in lengths of the beam."""
GMSH_BOX = 1e-6
"""By how much Gmsh's boxes may be wider, in m."""


@registry.register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class Beam(actuator.MirroredHalf):
    """A beam of rectangular section with no cavity, along x, clamped at x = 0; z is up.

    Physical groups: volume "solid"; surfaces "support" (the clamped end), "tip" (the other end), "top", "bottom", "side", and
    the cut planes "plane0" (y = 0) and "plane1" (z = 0); curve "edge", the lower edge of the clamped end. A quarter takes
    loads only along x, a half those along x and z.
    """

    length: float = schema.length_field(0.060, "length, along x")
    width: float = schema.length_field(0.010, "width, along y")
    thickness: float = schema.length_field(0.005, "thickness, along z")
    clamp: str = schema.choice_field(
        "held", ("held", "slip"), "clamped end held, or held only along x and at its lower edge, so that it may thin"
    )
    part: str = schema.choice_field(
        "half", ("quarter", "half", "full"), "half up to the mirror plane y = 0, a quarter also up to z = 0, or all of it"
    )
    cell_size: float = schema.length_field(0.0025, "longest edge of the cells along the axes", shape=False)

    stem: ClassVar = "beam"
    faces: ClassVar = ("tip", "top", "bottom", "side")
    unbonded: ClassVar = ()
    stiffer: ClassVar = "a thicker or shorter beam (--thickness, --length)"
    ratios: ClassVar[tuple[float, ...]] = ()  # type: ignore[assignment]
    cavity_volume: ClassVar[float] = 0.0  # type: ignore[assignment]
    examples: ClassVar = ("--gravity -z --weight-share 0:1", "--force tip --force-direction -z --force-N 0:0.05")

    def check(self) -> None:
        if self.clamp == "slip" and self.part == "full":
            raise GeometryError("clamp = slip leaves a whole beam free to slide sideways; take part = half, or clamp = held")
        for name in ("length", "width", "thickness"):
            self.check_most("cell_size", 1.0, name)
        self.check_most("width thickness", 20.0, "length", "more than {}, suggests a wrong unit")
        self.check_count()

    @property
    def _cells(self) -> tuple[int, int, int]:
        """Number of cells along x, y and z in the modelled part."""
        return tuple(math.ceil(edge / self.cell_size - POINT_TOLERANCE) for edge in self._edges)  # type: ignore[return-value]

    @property
    def _edges(self) -> tuple[float, float, float]:
        """Lengths in m of the modelled part: a half, or a quarter."""
        return self.length, self.width / 2, self.thickness / (2 if self.part == "quarter" else 1)

    @property
    def expected_cells(self) -> float:
        return 6.0 * math.prod(self._cells) * (2 if self.part == "full" else 1)

    @property
    def copies(self) -> int:
        return {"quarter": 4, "half": 2, "full": 1}[self.part]

    @property
    def size(self) -> float:
        return self.thickness

    @property
    def cut_planes(self) -> tuple[CutPlane, ...]:
        planes = (CutPlane("plane0", (0.0, -1.0, 0.0)), CutPlane("plane1", (0.0, 0.0, -1.0)))
        return planes[: {"quarter": 2, "half": 1, "full": 0}[self.part]]

    @property
    def holds(self) -> tuple[Hold, ...]:
        if self.clamp == "held":
            return (Hold("support", None),)
        lower = (Hold("edge", (0.0, 0.0, 1.0)),) if self.part == "half" else ()
        return (Hold("support", (1.0, 0.0, 0.0)), *lower)

    @property
    def probes(self) -> dict[str, Vector]:
        half = 0.5 * self.thickness
        below = {} if self.part == "quarter" else {"tip_below": (self.length, 0.0, -half)}
        return {"tip": (self.length, 0.0, half), **below}

    figure_texts: ClassVar[Mapping[str, tuple[str, str, str]]] = {
        "tip_x": ("mm", "tip place x", "x of the middle of the tip's edge in the plane y = 0, deformed, from the clamped end"),
        "tip_z": ("mm", "tip place z", "z of the middle of the tip's edge in the plane y = 0, deformed, from the axis"),
    }

    def device_figures(self, places: Mapping[str, Vector]) -> dict[str, float]:
        """Return where the middle of the tip's edge is; of a quarter z is that of the axis, 0."""
        top = np.asarray(places["tip"])
        below = np.asarray(places.get("tip_below", top * (1.0, 1.0, -1.0)))
        x, _, z = 0.5 * (top + below)
        return {"tip_x": float(x), "tip_z": float(z)}

    @property
    def solid_volume(self) -> float:
        return self.length * self.width * self.thickness

    @property
    def recipe(self) -> actuator.Recipe:
        beam = actuator.Pour(name="beam", up=(0.0, 0.0, -1.0), level=-0.5 * self.thickness, lid=False)
        return actuator.Recipe(pours=(beam,), why="A solid bar is cast in an open tray and scraped flat.")

    def build_whole(self) -> None:
        half, width = 0.5 * self.thickness, 0.5 * self.width
        meshing.add_block((0.0, -width, -half), (self.length, width, half))
        gmsh.model.occ.synchronize()

    def build(self) -> None:
        model, mesh, edges = gmsh.model, gmsh.model.mesh, self._edges
        low = (0.0, 0.0, 0.0 if self.part == "quarter" else -0.5 * self.thickness)
        solid = model.occ.addBox(*low, *edges)
        model.occ.synchronize()
        for _, curve in model.getEntities(1):
            box = np.reshape(model.getBoundingBox(1, curve), (2, 3))
            along = int(np.argmax(box[1] - box[0]))
            mesh.setTransfiniteCurve(curve, meshing.divided(self._cells[along]) + 1)
            if (
                along == 1
                and np.abs(box.mean(axis=0)[[0, 2]] - (low[0], low[2])).max() < POINT_TOLERANCE * self.length + GMSH_BOX
            ):
                model.addPhysicalGroup(1, [curve], name="edge")
        for _, face in model.getEntities(2):
            mesh.setTransfiniteSurface(face)
        mesh.setTransfiniteVolume(solid)
        model.addPhysicalGroup(3, [solid], name="solid")
        half = "plane1" if self.part == "quarter" else "bottom"
        names = {0: ("support", "tip"), 1: ("plane0", "side"), 2: (half, "top")}
        for _, face in model.getEntities(2):
            box = np.reshape(model.getBoundingBox(2, face), (2, 3))
            axis = int(np.argmin(box[1] - box[0]))
            model.addPhysicalGroup(2, [face], name=names[axis][int(box.mean(axis=0)[axis] > low[axis] + edges[axis] / 2)])
