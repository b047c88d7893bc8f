"""The cell of a plate with many parallel channels: what the plate's stretches across and along them are, away from its edges.

A quarter of the cell is modelled, in the plane across the channel::

    z
    |____________     top
    |            |
    |____        |
         |       |
    air  |       |    wall: the plane in the middle between two channels
     ____|       |
    |            |
    |____________|__  bottom
    0          pitch / 2                x

x = 0 is the plane through the channel's axis, which lies along y. By symmetry the middle planes of channels and of walls stay
plane, and so does every section across the channels; the air pushes on the channels' ends, so that sections are pulled apart.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import ClassVar, NoReturn

import numpy as np
from numpy.typing import NDArray

from geometries import actuator, meshing, registry, revolved
from geometries.actuator import CutPlane, Hold, Vector
from softmodels.common import schema
from softmodels.common.errors import GeometryError
from softmodels.common.lazy import gmsh


@registry.register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class ChannelCell(actuator.Actuator):
    """One channel's cell of a plate with many parallel ones, free to stretch across (x) and along (y) them, but flat.

    The whole device is a piece of one pitch by one pitch. Physical groups: volume "solid"; surfaces "cavity", "top", "bottom",
    the planes "wall" (between channels) and "section", which travel, and "plane0" (x = 0) and "plane1" (y = 0); the point
    "anchor", the lower corner of the wall, whose height stays. Lengths are in m.
    """

    radius: float = schema.length_field(0.0013, "radius of the channels")
    pitch: float = schema.length_field(0.004, "distance between the axes of two channels")
    thickness: float = schema.length_field(0.006, "thickness of the plate")
    offset: float = schema.length_field(
        0.0, "height of the channels' plane above the middle of the thickness", zero=True, signed=True
    )
    around: float = schema.number_field(24.0, "cells around a channel's section", shape=False)

    stem: ClassVar = "cell"
    pressures: ClassVar = "0:100"
    silicone: ClassVar = "ecoflex-00-30"
    faces: ClassVar = ("top", "bottom", "wall", "section")
    unbonded: ClassVar = ()
    stiffer: ClassVar = "narrower channels (--radius), a thicker plate (--thickness)"
    copies: ClassVar = 4
    cut_planes: ClassVar = (CutPlane("plane0", (-1.0, 0.0, 0.0)), CutPlane("plane1", (0.0, -1.0, 0.0)))
    holds: ClassVar = (
        Hold("wall", (1.0, 0.0, 0.0), together=True),
        Hold("section", (0.0, 1.0, 0.0), together=True),
        Hold("anchor", (0.0, 0.0, 1.0), point=True),
    )
    examples: ClassVar = ("--pitch 4mm --radius 1.3mm --thickness 6mm",)

    def check(self) -> None:
        if self.radius > MOST_AIR * 0.5 * self.pitch:
            self.reject("radius", f"it must be at most {MOST_AIR:g} times half of {self.told('pitch')}, or channels merge")
        if self.radius + abs(self.offset) > MOST_AIR * 0.5 * self.thickness:
            self.reject("radius", f"with {self.given('offset')} it comes out of {self.told('thickness')}")
        self.check_most("pitch thickness", 20.0, "radius", "more than {}, suggests a wrong unit")
        if not 8.0 <= self.around <= 100.0:
            self.reject("around", "it must be from 8 to 100")
        self.check_size("pitch", self.pitch, self.thickness)
        self.check_count()

    @property
    def size(self) -> float:
        return self.radius

    @property
    def plate(self) -> Vector:  # type: ignore[override]
        return (0.0, 0.5 * self.pitch, 0.0)

    @property
    def portion(self) -> str:
        return f"{super().portion} of one pitch by one pitch"

    @property
    def remarks(self) -> tuple[str, ...]:  # type: ignore[override]
        if not self.offset:
            return ()
        return ("the cell stays flat: a plate that is free to bend, whose channels lie off its middle, curls as well",)

    @property
    def probes(self) -> Mapping[str, Vector]:
        half, high = 0.5 * self.pitch, 0.5 * self.thickness
        return {"crown": (0.0, 0.0, high), "wall": (half, 0.0, high), "section": (0.0, half, high)}

    figure_texts: ClassVar[Mapping[str, tuple[str, str, str]]] = {
        "stretch_across": ("", "stretch across", "distance of two channels over the undeformed one"),
        "stretch_along": ("", "stretch along", "distance of two sections across the channels over the undeformed one"),
    }
    headline: ClassVar = tuple(figure_texts)

    def device_figures(self, places: Mapping[str, Vector]) -> dict[str, float]:
        half = 0.5 * self.pitch
        return {"stretch_across": places["wall"][0] / half, "stretch_along": places["section"][1] / half}

    @property
    def cavity_volume(self) -> float:
        return math.pi * self.radius**2 * self.pitch

    @property
    def solid_volume(self) -> float:
        return self.pitch**2 * self.thickness - self.cavity_volume

    def on_profile(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """None: no camera sees a cell."""
        return np.zeros(len(points), dtype=bool)

    @property
    def recipe(self) -> NoReturn:
        raise GeometryError("a cell stands for a plate with many channels, and is not cast; make the mould of a ChannelPlate")

    @property
    def edge(self) -> float:
        """Length in m of the cells' edges on the channel."""
        return math.tau * self.radius / self.around

    @property
    def expected_cells(self) -> float:
        return self.solid_volume / self.copies / (2.0 * self.edge) ** 3 / revolved.TETRAHEDRON_VOLUME

    def build(self) -> None:
        occ, half, high = gmsh.model.occ, 0.5 * self.pitch, 0.5 * self.thickness
        block = meshing.add_block((0.0, 0.0, -high), (half, half, high))
        x, y, z, radius = (meshing.MM_PER_M * value for value in (0.0, half, self.offset, self.radius))
        air = (3, occ.addCylinder(x, -y, z, 0.0, 3.0 * y, 0.0, radius))
        solid = meshing.one_solid(occ.cut([block], [air])[0])
        occ.synchronize()
        planes = {"plane0": (0, 0.0), "plane1": (1, 0.0), "wall": (0, half), "section": (1, half), "bottom": (2, -high),
                  "top": (2, high)}  # fmt: skip

        def role_of(tag: int) -> str:
            low, top = meshing.face_block(tag)
            flat = (name for name, (axis, at) in planes.items() if max(abs(low[axis] - at), abs(top[axis] - at)) < SAME_PLACE)
            return next(flat, "cavity")

        meshing.name_group(3, [solid[1]], "solid")
        meshing.name_boundary(role_of)
        anchor = meshing.MM_PER_M * np.array((half, 0.0, -high))
        meshing.name_group(0, meshing.points_at(anchor, meshing.MM_PER_M * SAME_PLACE), "anchor")
        meshing.set_sizes(lambda x, y, z: self.edge + CELL_SIZE_GROWTH * max(math.hypot(x, z - self.offset) - self.radius, 0.0))


MOST_AIR = 0.98
"""Largest share of a channel's width in its pitch, and in the thickness on its side."""
CELL_SIZE_GROWTH = 0.3
SAME_PLACE = 1e-8
