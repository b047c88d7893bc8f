"""The states of a run: kept in memory as they are solved, or read from a folder; and one of them as a user looks at it."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

from measurement.own_files import is_same
from measurement.read_only import keep_arrays, read_only
from softmodels.case.case import Case
from softmodels.case.material_errors import SourceBand
from softmodels.mechanics.mpi import on_root
from softmodels.results.restart import Restart
from softmodels.results.row import Row
from softmodels.results.sources import read_sources
from softmodels.results.store import RESTART, Results, ResultsError
from softmodels.results.stored import States
from softmodels.results.stored_step import KEPT
from softmodels.results.writing import hdf5_reason
from softmodels.runs.simulation import Simulation
from softmodels.runs.step import Step

if TYPE_CHECKING:
    from pyvista import UnstructuredGrid

Array = npt.NDArray[np.float64]

VTK_CELLS = {"Triangle_6": 22, "Tetrahedron_10": 24}
"""VTK's number of each kind of cell."""
PUBLIC = ("displacement", "p", "von_mises", "largest_stretch", "J", "mode")
"""Nodal fields of a state; the mode at a bifurcation alone."""


class Source(Protocol):
    """Where a run's states are.

    Attributes:
        case: What was run.
        rows: Rows of ``path.csv``, one for each state.
        points: Undeformed nodes in device coordinates, m, shape (n, 3).
        cells: Node numbers in VTK's order, shape (c, 6 or 10).
        cell_name: ``"Triangle_6"`` or ``"Tetrahedron_10"``.
        others: Rows of the silicone's other sources by name; empty where they were not asked for.
    """

    case: Case
    rows: list[Row]
    points: Array
    cells: npt.NDArray[np.int64]
    cell_name: str
    others: dict[str, list[Row]]

    def fields(self, step: int) -> Mapping[str, Array]:
        """All nodal fields of a state, with what a restart needs where it is kept."""

    def restart(self, step: int) -> Restart:
        """Numbers that a restart needs beside the fields."""

    def mesh(self) -> bytes:
        """The device's mesh as a Gmsh file."""


class InMemory:
    """States that are kept as they are solved, alike on all ranks; see `Source`.

    Args:
        simulation: Prepared, all ranks.
        mesh: Its mesh's file.
    """

    def __init__(self, simulation: Simulation, mesh: Path):
        self.case, self._comm = simulation.case, simulation.comm
        grid = simulation.fields.grid
        self.cell_name = grid.cell_name
        self.points: Array
        self.cells: npt.NDArray[np.int64]
        self._mesh: bytes
        # The grid is whole on rank 0 alone.
        self.points, self.cells, self._mesh = on_root(self._comm, lambda: (grid.points, grid.cells, mesh.read_bytes()))
        self.rows: list[Row] = []
        self.others: dict[str, list[Row]] = {}
        self._fields: list[dict[str, Array]] = []
        self._restarts: list[Restart] = []

    def add(self, step: Step) -> None:
        """Keep a state. What a restart needs to the last bit is kept of the last states alone, as in a folder."""
        public = on_root(self._comm, lambda: _public(step.fields or {}))
        fields = dict(step.fields or public)
        self.rows.append(step.row)
        self._fields.append(fields)
        self._restarts.append(step.restart)
        if len(self._fields) > KEPT:
            self._fields[-KEPT - 1] = _public(self._fields[-KEPT - 1])

    def fields(self, step: int) -> Mapping[str, Array]:
        return self._fields[step]

    def restart(self, step: int) -> Restart:
        return self._restarts[step]

    def mesh(self) -> bytes:
        return self._mesh


class InFolder:
    """States of a folder of results; see `Source`.

    Args:
        folder: Results with their ``case.toml``.
        home: Where the mesh is; the same folder if None.

    Raises:
        ResultsError: No results, or none that can be read.
        CaseError: No case file, or a wrong one.
    """

    def __init__(self, folder: Path, home: Path | None = None):
        folder = _absolute(folder)  # the caller may step into another one
        states = States(folder, Case.from_file(folder / "case.toml").name)
        self.folder, self._results = folder, states.results
        self._mesh = (folder if home is None else home) / f"{states.case.name}.msh"
        self.case, self.rows = states.case, states.rows
        self.points, self.cells, self.cell_name = states.points, states.cells, states.cell_name
        self.others = read_sources(folder) if isinstance(self.case.band, SourceBand) else {}

    def branch(self) -> InFolder | None:
        """The states of the branch that leaves the path; None if none was followed."""
        branch = self._results.branch()
        if not branch.heavy.exists():
            return None
        branch.load()
        return InFolder(branch.folder, self.folder) if branch.stored else None

    def is_in(self, folder: Path) -> bool:
        """Whether these states are in a folder."""
        return is_same(self.folder, folder)

    def fields(self, step: int) -> Mapping[str, Array]:
        from softmodels.results.state_dofs import RAW

        names = [*PUBLIC, *(name for pair in RAW for name in pair)]
        try:
            there = tuple(name for name in names if self._results.has(step, [name]))
            return {name: values.astype(float) for name, values in self._results.fields(step, there).items()}
        except (OSError, KeyError) as error:
            raise self._gone(error) from None

    def restart(self, step: int) -> Restart:
        return self._results.stored[step].restart

    def mesh(self) -> bytes:
        try:
            return self._mesh.read_bytes()
        except OSError as error:
            raise self._gone(error) from None

    def _gone(self, error: Exception) -> ResultsError:
        """What is raised where the folder has changed since it was loaded."""
        reason = error.strerror if isinstance(error, OSError) and error.strerror else hdf5_reason(error)
        return ResultsError(
            f"the states in {self.folder} cannot be read any more ({reason}); put the folder back where it was, or load it "
            "from where it is now"
        )


@dataclasses.dataclass(frozen=True, eq=False)
class SolvedState:
    """One state of a run, SI units. Its arrays are read-only; ``state.displacement.copy()`` can be changed.

    Attributes:
        row: Its row of ``path.csv``, with that file's units.
        points: Undeformed nodes in device coordinates, m, shape (n, 3); of a section (r, 0, z).
        cells: Node numbers of the second-order cells in VTK's order, shape (c, 6 or 10).
        cell_name: ``"Triangle_6"`` or ``"Tetrahedron_10"``.
        fields: Nodal fields by name: ``displacement``, ``p``, ``von_mises``, ``largest_stretch``, ``J`` and, at a
            bifurcation, its ``mode``.
    """

    row: Row
    points: Array
    cells: npt.NDArray[np.int64]
    cell_name: str
    fields: Mapping[str, Array]

    def __post_init__(self) -> None:
        # The arrays are the run's own: what `Run.at` solves next and `Run.save` writes starts from them.
        keep_arrays(self)
        fields = {name: read_only(values) for name, values in self.fields.items()}
        object.__setattr__(self, "fields", MappingProxyType(fields))

    @property
    def pressure(self) -> float:
        """Pa; of a program the highest."""
        return float(self.row["pressure_Pa"])

    @property
    def added_volume(self) -> float:
        """m3."""
        return float(self.row["added_volume_ml"]) * 1e-6

    @property
    def displacement(self) -> Array:
        """m, in device coordinates, shape (n, 3)."""
        return self.fields["displacement"]

    @property
    def von_mises(self) -> Array:
        """Von Mises stress in Pa, shape (n,)."""
        return self.fields["von_mises"]

    @property
    def largest_stretch(self) -> Array:
        """Largest principal stretch, shape (n,)."""
        return self.fields["largest_stretch"]

    @property
    def J(self) -> Array:
        """Ratio of the silicone's volume to that at rest, shape (n,)."""
        return self.fields["J"]

    @property
    def p(self) -> Array:
        """Pressure-like unknown in Pa, shape (n,)."""
        return self.fields["p"]

    @property
    def mode(self) -> Array | None:
        """Mode in which the device leaves its path at a bifurcation, shape (n, 3); None in any other state."""
        return self.fields.get("mode")

    @functools.cached_property
    def grid(self) -> UnstructuredGrid:
        """The undeformed device as a `pyvista.UnstructuredGrid` with the fields; ``grid.warp_by_vector("displacement")``
        moves it."""
        import pyvista

        # Copies: VTK writes into what it is given, and a grid is changed freely.
        grid = pyvista.UnstructuredGrid({VTK_CELLS[self.cell_name]: self.cells.copy()}, self.points.copy())
        for name, values in self.fields.items():
            grid.point_data[name] = values.copy()
        return grid


def _absolute(folder: Path) -> Path:
    """A folder from wherever the caller is; `ResultsError` where that is a folder that was deleted."""
    try:
        return folder.absolute()
    except OSError:
        raise ResultsError(
            f"{folder} is counted from the folder that this program runs in, and that is not there any more; step into another "
            "one, or give a whole path"
        ) from None


def _public(fields: Mapping[str, Array]) -> dict[str, Array]:
    """The fields that are not a restart's alone."""
    return {name: values for name, values in fields.items() if not name.startswith(RESTART)}


def state_of(source: Source, step: int) -> SolvedState:
    """One of a source's states."""
    return SolvedState(source.rows[step], source.points, source.cells, source.cell_name, _public(source.fields(step)))


def write_states(source: Source, results: Results) -> None:
    """Store all states of a source into a folder that is prepared for them."""
    results.begin(source.points, source.cells, source.cell_name)
    for step, row in enumerate(source.rows):
        results.add(row, source.fields(step), source.restart(step))
