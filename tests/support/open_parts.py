"""Parts whose air is open to the outside through bores, drawn by the CAD kernel: lengths in mm."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import gmsh
import numpy as np

from geometries import meshing


@dataclasses.dataclass(frozen=True)
class Bore:
    """A bore of a radius from a point on the part's outside, over a length along a unit vector inwards."""

    place: tuple[float, float, float]
    axis: tuple[float, float, float]
    radius: float
    length: float

    def draw(self) -> tuple[int, int]:
        """Draw it, from 2 mm outside of the part on."""
        place, axis = np.array(self.place), np.array(self.axis)
        return 3, gmsh.model.occ.addCylinder(*(place - 2.0 * axis), *((self.length + 2.0) * axis), self.radius)


@dataclasses.dataclass(frozen=True)
class OpenPart:
    """A block of some size with a corner at the origin, with air: each space of boxes (corner, size) and spheres (middle,
    radius) that hang together, the bores that lead there, and blind holes; blocks taken off its outside leave grooves."""

    size: tuple[float, float, float]
    spaces: tuple[tuple[tuple[float, ...], ...], ...]
    bores: tuple[tuple[Bore, ...], ...]
    holes: tuple[Bore, ...] = ()
    grooves: tuple[tuple[float, ...], ...] = ()

    def draw(self) -> tuple[int, list[float]]:
        """Draw it into the current model; return its volume's tag and the volume in mm3 of the air in the block that belongs to
        each space, with its bores."""
        occ = gmsh.model.occ
        block = [(3, occ.addBox(0.0, 0.0, 0.0, *self.size))]
        if self.grooves:
            block, _ = occ.cut(block, [(3, occ.addBox(*groove)) for groove in self.grooves])
        volumes, tools = [], [hole.draw() for hole in self.holes]
        for space, bores in zip(self.spaces, self.bores, strict=True):
            pieces = [(3, occ.addBox(*p) if len(p) == 6 else occ.addSphere(*p)) for p in space]
            pieces += [bore.draw() for bore in bores]
            air = occ.fuse(pieces[:1], pieces[1:])[0] if len(pieces) > 1 else pieces
            inside, _ = occ.intersect(air, block, removeObject=False, removeTool=False)
            occ.synchronize()
            volumes.append(sum(float(occ.getMass(*piece)) for piece in inside))
            occ.remove([piece for piece in inside if piece not in air], recursive=True)  # closed air is its own intersection
            tools += air
        left, _ = occ.cut(block, tools)
        occ.synchronize()
        assert len(left) == 1
        return left[0][1], volumes

    def write(self, file: Path) -> list[float]:
        """Write it as a STEP file; return the spaces' volumes as `draw` does."""
        with meshing.private_model():
            _, volumes = self.draw()
            meshing.write_step(file)
        return volumes

    def surface(self, size: float = 3.0) -> tuple[np.ndarray, np.ndarray]:
        """Return corners (n, 3) in m and triangles (t, 3) of its surface, of edges up to a size in mm."""
        with meshing.private_model():
            self.draw()
            gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 24)
            gmsh.option.setNumber("Mesh.MeshSizeMax", size)
            gmsh.model.mesh.generate(2)
            tags, places, _ = gmsh.model.mesh.getNodes()
            number = np.zeros(int(tags.max()) + 1, dtype=np.int64)
            number[tags.astype(np.int64)] = np.arange(len(tags))
            triangles = number[gmsh.model.mesh.getElementsByType(2)[1].astype(np.int64)].reshape(-1, 3)
        return places.reshape(-1, 3) * 1e-3, triangles


def finger(bore: float = 1.5, slot: float = 2.0) -> OpenPart:
    """Return a bending finger of five chambers on a channel, with grooves between them and a bore at its end x = 0."""
    pitch, first = slot + 5.5, 10.0
    chambers = tuple((first + 2.0 + k * pitch, 2.0, 2.0, slot, 12.0, 10.0) for k in range(5))
    grooves = tuple((first + 4.0 + slot + k * pitch, -1.0, 5.0, 1.5, 18.0, 10.0) for k in range(5))
    channel = (first - 2.0, 6.5, 2.0, 4.0 + 4.0 * pitch + slot, 3.0, 2.0)
    inlet = Bore((0.0, 8.0, 4.5), (1.0, 0.0, 0.0), bore, first + 2.0 + slot / 2)
    return OpenPart((first + 5.0 * pitch + 4.0, 16.0, 14.0), ((channel, *chambers),), ((inlet,),), grooves=grooves)


def random_part(seed: int) -> OpenPart:
    """Return a block with one or two spaces of boxes or spheres, bores into each from any side, and blind holes."""
    draw = np.random.default_rng(seed)
    size = draw.uniform((50.0, 24.0, 18.0), (90.0, 40.0, 26.0))
    count = int(draw.integers(1, 3))
    spaces, bores = [], []
    for k in range(count):
        low, high = size[0] * k / count + 4.0, size[0] * (k + 1) / count - 4.0
        middle = np.array([0.5 * (low + high), *(0.5 * size[1:])])
        wall = draw.uniform(2.0, 3.5)
        half = np.array([0.5 * (high - low), *(0.5 * size[1:] - wall)]) * draw.uniform(0.75, 1.0, 3)
        if draw.random() < 0.3:
            radius = float(half.min())
            spaces.append(((*middle, radius),))
        else:
            pieces = [(*(middle - half), *(2.0 * half))]
            if draw.random() < 0.5:  # two chambers joined by a narrow channel instead of one
                third = 2.0 * half[0] / 3.0
                pieces = [
                    (*(middle - half), third, *(2.0 * half[1:])),
                    (middle[0] + half[0] - third, *(middle - half)[1:], third, *(2.0 * half[1:])),
                    (*(middle - (half[0] - 1.0, 1.0, 1.0)), 2.0 * half[0] - 2.0, 2.0, 2.0),
                ]
            spaces.append(tuple(pieces))
            radius = float(half.min())
        own = []
        for side in draw.permutation(4)[: 1 + int(draw.random() < 0.25)]:
            way = np.zeros(3)
            way[1 + side // 2] = 1.0 if side % 2 else -1.0
            target = middle.copy()
            if len(spaces[-1]) == 3:
                target[0] = spaces[-1][0][0] + 0.5 * spaces[-1][0][3]
            slant = way + draw.uniform(-0.3, 0.3, 3) * (1.0 - np.abs(way))
            axis = slant / np.linalg.norm(slant)
            axis_to = axis * (0.5 * size[1 + side // 2] / abs(axis[1 + side // 2]))
            place = target - axis_to
            bore = float(draw.uniform(0.8, min(2.5, 0.4 * radius)))
            own.append(Bore(tuple(place), tuple(axis), bore, float(np.linalg.norm(axis_to))))
        bores.append(tuple(own))
    holes = tuple(
        Bore((float(x), float(y), 0.0), (0.0, 0.0, 1.0), float(draw.uniform(0.6, 1.0)), 1.5)
        for x, y in draw.uniform((1.5, 1.5), (3.0, size[1] - 1.5), (int(draw.integers(0, 3)), 2))
    )
    return OpenPart(tuple(size), tuple(spaces), tuple(bores), holes)
