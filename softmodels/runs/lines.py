"""Values along a line through the body: from place to place, or from a point of the surface straight through its wall.

A line is drawn in the undeformed body and moves with it. It may leave the modelled section or slice: its points are found in
what is modelled, and their vectors and tensors are turned back from there.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from geometries.actuator import reflected
from softmodels.case.entries import CaseError
from softmodels.common.arrays import Array
from softmodels.common.units import brief
from softmodels.runs.fields import OUTPUTS, OutputField
from softmodels.runs.formats import CELL_TYPES
from softmodels.runs.state_values import FacingWalls, principal
from softmodels.runs.store import NodalGrid

if TYPE_CHECKING:
    from pyvista import UnstructuredGrid

POINTS = 201
"""Default number of points of a line."""
BESIDE = 5e-4
"""Distance from the body within which a point counts as in it, over the device's size."""
NAMES = {"displacement": "xyz", "principal_stresses": "123", "principal_stretches": "123"}
"""Names of a vector's components in columns."""


@dataclasses.dataclass(frozen=True, eq=False)
class Line:
    """Values of a state along a straight line of the undeformed device, SI units, nan outside the silicone.

    ``line["cauchy_stress"]`` is a field's values there.

    Attributes:
        points: Undeformed places in device coordinates, m, shape (k, 3).
        fields: Values by the field's name, shape (k,), (k, 3) or (k, 3, 3), in device coordinates.
    """

    points: Array
    fields: Mapping[str, Array]

    def __getitem__(self, name: str) -> Array:
        return self.fields[name]

    @property
    def distance(self) -> Array:
        """Distance from the line's beginning in the undeformed device, m, shape (k,)."""
        return np.asarray(np.linalg.norm(self.points - self.points[0], axis=1))

    @property
    def places(self) -> Array:
        """Deformed places, m, shape (k, 3)."""
        return self.points + self.fields["displacement"]

    @property
    def inside(self) -> npt.NDArray[np.bool_]:
        """Whether a point is in the silicone, shape (k,)."""
        return np.isfinite(self.fields["displacement"][:, 0])

    @property
    def normal_stress(self) -> Array:
        """Normal stress along the deformed line in Pa, shape (k,): minus the pressure where the line leaves a pressed wall at
        right angles."""
        along = self.fields["deformation_gradient"] @ (self.points[-1] - self.points[0])
        along /= np.linalg.norm(along, axis=1)[:, None]
        return np.einsum("ki,kij,kj->k", along, self.fields["cauchy_stress"], along)

    @property
    def columns(self) -> dict[str, Array]:
        """All values within the silicone by the name of a CSV column, in mm, kPa or pure numbers."""
        inside = self.inside
        found = {"distance_mm": self.distance * 1e3}
        for what, places in (("", self.points), ("_moved", self.places)):
            found |= {f"{axis}{what}_mm": places[:, k] * 1e3 for k, axis in enumerate("xyz")}
        found["normal_stress_kPa"] = self.normal_stress / 1e3
        for name, values in self.fields.items():
            known = OUTPUTS.get(name)
            unit = known.unit if isinstance(known, OutputField) else ""
            ending, factor = {"Pa": ("_kPa", 1e-3), "m": ("_mm", 1e3)}.get(unit, ("", 1.0))
            axes = NAMES.get(name, "123" if name.startswith("principal") else "xyz")
            parts = [""] if values.ndim == 1 else [f"_{i}" for i in axes] if values.ndim == 2 else [
                f"_{i}{j}" for i in axes for j in "xyz"
            ]  # fmt: skip
            flat = values.reshape(len(values), -1)
            found |= {f"{name}{part}{ending}": flat[:, k] * factor for k, part in enumerate(parts)}
        return {name: values[inside] for name, values in found.items()}


@dataclasses.dataclass(frozen=True, eq=False)
class Probe:
    """Takes values at places of the whole device from the nodes of what is modelled.

    Attributes:
        device: The device.
        mesh: Its undeformed nodes and cells.
    """

    device: Actuator
    mesh: NodalGrid

    @functools.cached_property
    def _grid(self) -> UnstructuredGrid:
        import pyvista

        points, cells, name = self.mesh
        return pyvista.UnstructuredGrid({CELL_TYPES[name]: cells.copy()}, points.copy())

    def modelled(self, points: Array) -> tuple[Array, Array]:
        """Return where points of the device, shape (k, 3), lie in the modelled part, and the rotations or reflections that take
        its vectors to them, shape (k, 3, 3)."""
        turns = np.broadcast_to(np.eye(3), (len(points), 3, 3)).copy()
        if self.device.dimension == 2:
            radius = np.hypot(points[:, 0], points[:, 1])
            with np.errstate(invalid="ignore"):
                cos, sin = np.where(radius > 0.0, points[:, :2].T / radius, [[1.0], [0.0]])
            turns[:, 0, 0], turns[:, 0, 1], turns[:, 1, 0], turns[:, 1, 1] = cos, -sin, sin, cos
            points = np.column_stack([radius, np.zeros(len(points)), points[:, 2]])
        normals = np.array([plane.normal for plane in self.device.cut_planes]).reshape(-1, 3)
        images = reflected(normals)
        back = np.einsum("mij,ki->kmj", images, points)  # the transposed images take a point to the slice
        beyond = (back @ normals.T).max(axis=2) if len(normals) else np.zeros(back.shape[:2])
        chosen = np.argmin(np.maximum(beyond, 0.0), axis=1)
        return back[np.arange(len(points)), chosen], turns @ images[chosen]

    def at(self, points: Array, fields: Mapping[str, Array], beside: float = BESIDE) -> dict[str, Array]:
        """Return nodal scalars, vectors and tensors at places of the undeformed device, shape (k, 3), interpolated within the
        cells; nan farther outside than ``beside`` times the device's size."""
        import pyvista

        places, turns = self.modelled(points)
        grid = self._grid
        grid.clear_data()
        for name, values in fields.items():
            grid.point_data[name] = values.reshape(len(values), -1)
        found = pyvista.PolyData(places).sample(grid, tolerance=beside * self.device.size)
        outside = ~found["vtkValidPointMask"].astype(bool)
        result = {}
        for name, values in fields.items():
            here = np.asarray(found[name]).reshape(len(points), *values.shape[1:]).astype(float)
            here[outside] = np.nan
            if values.ndim == 2:
                here = np.einsum("kij,kj->ki", turns, here)
            elif values.ndim == 3:
                here = turns @ here @ np.swapaxes(turns, -1, -2)
            result[name] = here
        return result

    def line(self, ends: tuple[Array, Array], fields: Mapping[str, Array], count: int = POINTS) -> Line:
        """Return the values along a line.

        Raises:
            CaseError: It has no length, or does not meet the silicone.
        """
        begin, end = ends
        if not np.linalg.norm(end - begin) > 0.0:
            raise CaseError(f"the line begins and ends at {told(begin)}; give two different places")
        if not isinstance(count, int) or isinstance(count, bool) or count < 2:
            raise CaseError(f"points is {brief(count)}; give a whole number, 2 or more")
        points = begin + np.linspace(0.0, 1.0, count)[:, None] * (end - begin)
        smooth = {name: values for name, values in fields.items() if not name.startswith("principal")}
        found = self.at(points, smooth)
        inside = np.isfinite(found["displacement"][:, 0])
        if not inside.any():
            raise CaseError(
                f"the line from {told(begin)} to {told(end)} does not meet the silicone of {type(self.device).__name__}; "
                "places are in device coordinates of the undeformed body"
            )
        # Principal values change their order between nodes, so they are those of the interpolated tensors.
        F = found["deformation_gradient"]
        tensors = {"stresses": found["cauchy_stress"], "stretches": np.swapaxes(F, -1, -2) @ F}
        for name, tensor in tensors.items():
            values = np.full((count, 3), np.nan)
            values[inside] = principal(tensor[inside])[0]
            found[f"principal_{name}"] = values if name == "stresses" else np.sqrt(values)
        return Line(points, found)

    def through(self, point: Array) -> tuple[Array, Array]:
        """Return both ends of the way straight through the wall at the surface point nearest to a place.

        The surface is that of the modelled part, cut planes excluded.
        """
        [place], [turn] = self.modelled(point[None])
        planes = [plane.normal for plane in self.device.cut_planes]
        walls = FacingWalls(*self.mesh, planes)
        begin, inwards, thickness = walls.into(place)
        low, high = 0.0, 1.5 * thickness
        nodes = {"inside": np.ones(len(self.mesh[0]))}
        for _ in range(3):  # each finds the end of the way a hundred times closer
            way = np.linspace(low, high, 201)[1:]
            outside = np.isnan(self.at(begin + way[:, None] * inwards, nodes, 1e-7)["inside"])
            last = int(np.argmax(outside)) if outside.any() else len(way) - 1
            low, high = (way[last - 1] if last else low), way[last]
        return _round(turn @ begin), _round(turn @ (begin + low * inwards))


def _round(place: Array) -> Array:
    return np.asarray(place.round(12) + 0.0)


def told(place: Array) -> str:
    """Return a place as text, in mm."""
    return f"({', '.join(f'{1e3 * value:.4g}' for value in place)}) mm"
