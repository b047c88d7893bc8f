"""The states of a results folder for drawing: fields on one mesh, and which states to show."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from geometries import Actuator
from geometries.actuator import Vector
from softmodels.case.case import Case
from softmodels.common.arrays import Array
from softmodels.runs.columns import StateLabels, state_labels
from softmodels.runs.formats import opened, read_values
from softmodels.runs.grid import OUTSIDE, Surface, surface_of
from softmodels.runs.row import Row
from softmodels.runs.store import Results, ResultsError

STILLS = 4
"""Maximum number of states shown side by side."""


class States:
    """The states of a folder of results.

    Args:
        folder: Results with their ``case.toml``.
        name: Stem of the result files.

    Attributes:
        case: The case.
        rows: Rows of ``path.csv``, one per state.
        points: Undeformed nodes in device coordinates, m, shape (n, 3).
        cells: Node numbers in VTK's order, shape (c, 10 or 6).
        cell_name: XDMF's name of the cells.

    Raises:
        ResultsError: No results, or none that can be read.
        CaseError: No case file, or a wrong one.
    """

    def __init__(self, folder: Path, name: str):
        self.folder, self.results = folder, Results(folder, name)
        if not self.results.heavy.exists():
            raise ResultsError(f"{folder} holds no {self.results.heavy.name}, so there is nothing to draw")
        self.results.load()
        self.rows: list[Row] = self.results.rows
        if not self.rows:
            raise ResultsError(f"the results in {folder} hold no step yet, so there is nothing to draw")
        self.case = Case.from_file(folder / "case.toml")
        with opened(self.results.heavy) as file:
            self.points, self.cells = (
                np.asarray(read_values(file, "mesh/points")),
                np.asarray(read_values(file, "mesh/cells")),
            )
            self.cell_name = str(file["mesh"].attrs["cell_name"])
        self._read = functools.lru_cache(maxsize=24)(
            lambda step, field: self.results.fields(step, (field,))[field].astype(float)
        )

    @property
    def name(self) -> str:
        return self.results.name

    @property
    def actuator(self) -> Actuator:
        return self.case.actuator

    @functools.cached_property
    def words(self) -> StateLabels:
        """Labels of its states."""
        return state_labels(self.case)

    @functools.cached_property
    def skin(self) -> Surface:
        """The surface of the mesh."""
        return surface_of(self.points, self.cells, self.cell_name, self.actuator)

    @property
    def bifurcation(self) -> int | None:
        """The first bifurcation of the path; None if there is none."""
        return next((step for step, row in enumerate(self.rows) if row.get("bifurcation")), None)

    @functools.cached_property
    def branch(self) -> list[Row]:
        """Rows of the branch followed from there; empty if none was."""
        branch = self.results.branch()
        if branch.heavy.exists():
            branch.load()
        return branch.rows

    @functools.cached_property
    def sources(self) -> dict[str, Sequence[Row]]:
        """Rows of each source of the silicone, the run's own among them; none where no others were solved."""
        return self.results.sources(self.case)

    def field(self, step: int, name: str) -> Array:
        """Return a nodal field of a state, shape (n,) or (n, 3), SI units."""
        return np.asarray(self._read(step, name))

    def moved(self, step: int) -> Array:
        """Return the deformed nodes of a state in m, shape (n, 3)."""
        return self.points + self.field(step, "displacement")

    def between(self, position: float, name: str) -> Array:
        """Return a nodal field between two steps, straight from one to the other; 2.5 is in the middle of steps 2 and 3."""
        step = min(int(position), len(self.rows) - 1)
        share = position - step
        return (
            self.field(step, name)
            if share < 1e-9
            else (1 - share) * self.field(step, name) + share * self.field(step + 1, name)
        )

    @functools.cached_property
    def loaded(self) -> list[int]:
        """Steps that are not at rest."""
        return [k for k, row in enumerate(self.rows) if self.words.loaded(row)]

    @functools.cached_property
    def main(self) -> int:
        """The last requested state under load, or the last of all if there is none."""
        asked = [k for k in self.loaded if self.rows[k]["requested"]]
        return asked[-1] if asked else len(self.rows) - 1

    @functools.cached_property
    def along(self) -> Array:
        """Position of each step along the path, from 0 to 1, shape (steps,).

        Of a program by its steps. Else by the pressure where it only rises; past a limit point by the arc length of
        pressure and volume.
        """
        if self.case.program:
            steps = np.array([row["load_step"] for row in self.rows])
            return steps / (steps[-1] or 1.0)
        # Of a dead load its magnitude stands for the pressure, and what it moves for the volume.
        raised, moved = self.words.along
        pressure = np.array([row[raised] for row in self.rows])
        if len(pressure) == 1:
            return np.zeros(1)
        if (np.diff(pressure) > 0).all():
            return np.asarray((pressure - pressure[0]) / (pressure[-1] - pressure[0]))
        path = np.column_stack([pressure, [row[moved] for row in self.rows]])
        size = np.ptp(path, axis=0)
        lengths = np.linalg.norm(np.diff(path, axis=0) / np.where(size > 0, size, 1.0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(lengths)])
        return np.asarray(along / (along[-1] or 1.0))

    def shown(self, most: int = STILLS) -> list[int]:
        """The states to show: the requested ones under load, or some spread over the path, the last included.

        Args:
            most: At most this many; of more requested ones, some are chosen evenly, with the last.
        """
        asked = [k for k in self.loaded if self.rows[k]["requested"]]
        if len(asked) > most:
            return [asked[round(k)] for k in np.linspace(0, len(asked) - 1, most + 1)[1:]]
        if len(asked) >= 2:
            return asked
        if not self.loaded:
            return [len(self.rows) - 1]
        wanted = np.linspace(0.0, 1.0, most + 1)[1:]
        places = self.along[self.loaded]
        return sorted({self.loaded[int(np.argmin(np.abs(places - value)))] for value in wanted} | set(asked))[-most:]


# ----------------------------------------------------------------------------------------------------------------------
# Section of a device's outer surface by a plane: the undeformed line and its deformed shape.


BESIDE = 1e-7
"""Offset of the cut from the plane, relative to the device's size, so that vertices in the plane do no harm."""


def cut_line(skin: Surface, points: Array, displacement: Array, normal: Vector, at: float, size: float) -> Array:
    """Return the pieces of the deformed section of the outer surface, in device coordinates (m), shape (k, 2, 3).

    Args:
        skin: The device's surface.
        points: Undeformed nodes, m, shape (n, 3).
        displacement: Of the nodes, m, shape (n, 3).
        normal: Unit normal of the plane that cuts the undeformed device.
        at: Its distance from the origin in m.
        size: Of the device in m.
    """
    rest, moved = (skin.device(skin.points(nodal)) for nodal in (points, points + displacement))
    triangles = skin.device_triangles(skin.part == OUTSIDE)
    height = rest @ np.asarray(normal) - at - BESIDE * size
    above = height[triangles] > 0.0
    hit = triangles[above.any(axis=1) & ~above.all(axis=1)]
    pieces = np.empty((len(hit), 2, 3))
    count = np.zeros(len(hit), dtype=int)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        one, two = hit[:, a], hit[:, b]
        rows = np.flatnonzero((height[one] > 0.0) != (height[two] > 0.0))
        one, two = one[rows], two[rows]
        share = (height[one] / (height[one] - height[two]))[:, None]
        pieces[rows, count[rows]] = moved[one] + share * (moved[two] - moved[one])
        count[rows] += 1
    return pieces


def axes_of(normal: Vector, lift: Vector) -> Array:
    """Return two unit vectors in a plane, shape (2, 3): to the right, mostly along x or y, and upwards along the lift or y."""
    n = np.asarray(normal)
    for up in (np.asarray(lift), np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])):
        across = up - (up @ n) * n
        if np.linalg.norm(across) > 0.1:
            break
    across = across / np.linalg.norm(across)
    right = np.cross(across, n)
    return np.array([right if right[np.argmax(np.abs(right))] > 0.0 else -right, across])
